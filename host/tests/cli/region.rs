//! `keygraph detect --roi` and `--mirror`: parts of frames, and frames that are mirrored.

use image::imageops;
use serde_json::Value;

use crate::astronaut;
use crate::lines::{assert_line, assert_outline, corners, distance, list, only, path, size, without_times};
use crate::program::{CLEAR, Folder, frame, numbers, photograph, pixels};

/// Asserts that an outline lies where it should, to 2 % of its size.
#[track_caller]
fn assert_near(found: [[f64; 2]; 4], expected: [[f64; 2]; 4]) {
    let off = found.iter().zip(expected).map(|(&a, b)| distance(a, b)).fold(0.0, f64::max) / size(expected);
    assert!(off < 0.02, "{found:?} is not {expected:?}");
}

/// The determinant of the homography of a detection.
fn determinant(detection: &Value) -> f64 {
    let m = numbers::<9>(&detection["homography"]);
    let minor = |a: usize, b: usize, c: usize, d: usize| m[a] * m[d] - m[b] * m[c];
    m[0] * minor(4, 5, 7, 8) - m[1] * minor(3, 5, 6, 8) + m[2] * minor(3, 4, 6, 7)
}

#[test]
fn a_small_object_in_a_large_frame_is_found_in_its_region() {
    let folder = Folder::new("roi");
    let (model, large) = (astronaut(&folder), folder.join("large.png"));
    // 160 px of 2560: at the size of the detector, 40 px of 640 are left.
    let (scale, [x, y]) = (160.0 / 512.0, [1801.0, 903.0]);
    photograph("astronaut", &[scale, 0.0, x, 0.0, scale, y, 0.0, 0.0, 1.0], (2560, 1440), &CLEAR, &large);
    let truth = [[x, y], [x + 160.0, y], [x + 160.0, y + 160.0], [x, y + 160.0]];

    let all = keygraph!("detect", "-m", model, large, "--json").ended_with(0).lines();
    assert!(list(&all[0], "detections").is_empty(), "too small to be found in the whole frame: {}", all[0]);
    assert!(all[0].get("roi").is_none(), "{}", all[0]);
    let line = &keygraph!("detect", "-m", model, large, "--json", "--roi", "1601,701,640,480").ended_with(0).lines()[0];
    assert_line(line, &path(&large), 0, (2560, 1440));
    assert_eq!(line["roi"], serde_json::json!([1601, 701, 640, 480]));
    assert_near(only(line), truth);
    assert_outline(&line["detections"][0], [512.0, 512.0], 0.05);
    // A region that is larger than the detector is scaled down, by itself.
    let scaled =
        &keygraph!("detect", "-m", model, large, "--json", "--roi", "1300,500,960,720").ended_with(0).lines()[0];
    assert_near(only(scaled), truth);
    // The same region in percent.
    let percent = keygraph!("detect", "-m", model, large, "--json", "--roi", "50%,50%,37.5%,720").ended_with(0).lines();
    let px = keygraph!("detect", "-m", model, large, "--json", "--roi", "1280,720,960,720").ended_with(0).lines();
    assert_near(only(&px[0]), truth);
    assert_eq!(without_times(percent), without_times(px));
}

#[test]
fn what_lies_outside_of_the_region_is_not_found() {
    let folder = Folder::new("roi-outside");
    let run = keygraph!("detect", "-m", astronaut(&folder), frame(0), "--json", "--roi", "450,0,190,480").ended_with(0);
    assert!(list(&run.lines()[0], "detections").is_empty(), "{}", run.out);
}

#[test]
fn a_region_that_does_not_suit_ends_the_program_with_advice() {
    let folder = Folder::new("roi-bad");
    let model = astronaut(&folder);
    let elongated = folder.join("elongated.png");
    imageops::resize(&pixels(&frame(0)), 1600, 480, imageops::FilterType::Triangle).save(&elongated).unwrap();
    for (input, roi, words) in [
        (frame(0), "10,20,30", &["25%,0,50%,100%"][..]),
        (frame(0), "10,20,0,30", &["above 0"]),
        (frame(0), "-5,20,40,30", &["25%,0,50%,100%"]),
        (frame(0), "60%,0,50%,100%", &["beyond 100 %"]),
        (frame(0), "600,0,100,100", &["0000.jpg", "--roi 600,0,100,100 leaves", "640x480 px", "in percent"]),
        (frame(0), "600,0,12,100", &["12x100 px of the frame, which has 640x480 px", "16 px or more"]),
        (elongated, "0,0,1600,20", &["1600x480 px, 640x8 at this profile", "less elongated"]),
    ] {
        let run = keygraph!("detect", "-m", model, input, "--json", "--roi", roi).ended_with(2).said(words);
        assert_eq!(run.out, "", "standard output with --roi {roi}");
    }
    // A video that is being written is given up.
    let folder_of_video = Folder::new("roi-bad-video");
    let video = folder_of_video.join("out.mp4");
    keygraph!("detect", "-m", model, frame(0), "--annotate", video, "--roi", "600,0,100,100").ended_with(2);
    assert!(folder_of_video.names().is_empty(), "{:?}", folder_of_video.names());
}

#[test]
fn the_region_is_drawn() {
    let folder = Folder::new("roi-drawn");
    let (input, drawn) = (folder.join("frame.png"), folder.join("drawn.png"));
    pixels(&frame(24)).save(&input).unwrap();
    let run = keygraph!("detect", "-m", astronaut(&folder), input, "--annotate", drawn, "--roi", "100,50,300,200");
    run.ended_with(0);
    let (before, after) = (pixels(&input), pixels(&drawn));
    // Corners are drawn over the border.
    let gray = |x: u32, y: u32| after.get_pixel(x, y).0 == [200; 3];
    assert!((100..400).filter(|&x| gray(x, 50) && gray(x, 249)).count() > 200, "rows");
    assert!((50..250).filter(|&y| gray(100, y) && gray(399, y)).count() > 120, "columns");
    for (x, y, pixel) in after.enumerate_pixels() {
        let margin = 8;
        let near = (100 - margin..400 + margin).contains(&x) && (50 - margin..250 + margin).contains(&y);
        assert!(near || pixel == before.get_pixel(x, y), "({x}, {y}) lies outside of what was searched");
    }
}

#[test]
fn a_mirrored_frame_is_found_with_mirror_in_px_of_the_frame_as_it_came() {
    let folder = Folder::new("mirror");
    let (model, mirrored) = (astronaut(&folder), folder.join("mirrored.png"));
    imageops::flip_horizontal(&pixels(&frame(1))).save(&mirrored).unwrap();
    let straight = keygraph!("detect", "-m", model, frame(1), "--json").ended_with(0).lines();
    let expected = only(&straight[0]).map(|[x, y]| [639.0 - x, y]);
    for options in [&[][..], &["--profile", "qvga"], &["--format", "uyvy"], &["--roi", "150,60,490,420"]] {
        let mut arguments = args!["detect", "-m", model, mirrored, "--json", "--mirror"].to_vec();
        arguments.extend(options.iter().map(Into::into));
        let run = crate::program::keygraph(&arguments).ended_with(0);
        assert_eq!(run.err, "", "standard error when all is well");
        let line = &run.lines()[0];
        assert_line(line, &path(&mirrored), 0, (640, 480));
        assert_eq!(line["mirror"], true, "{line}");
        assert_near(only(line), expected);
        assert_outline(&line["detections"][0], [512.0, 512.0], 0.05);
        assert!(determinant(&line["detections"][0]) < 0.0, "{line}");
    }
    assert!(determinant(&straight[0]["detections"][0]) > 0.0, "{}", straight[0]);
    assert_eq!(corners(&straight[0]["detections"][0]), only(&straight[0]));
    assert!(straight[0].get("mirror").is_none(), "{}", straight[0]);
}

#[test]
fn a_picture_that_was_mirrored_is_told() {
    let folder = Folder::new("mirror-hint");
    let (model, mirrored) = (astronaut(&folder), folder.join("mirrored.png"));
    imageops::flip_horizontal(&pixels(&frame(1))).save(&mirrored).unwrap();
    let said = |arguments: &[std::ffi::OsString]| {
        let run = crate::program::keygraph(arguments).ended_with(0);
        for line in run.lines() {
            assert!(list(&line, "detections").is_empty(), "{line}");
        }
        run.err
    };
    let hint = format!("keygraph: {}: found when mirrored: use --mirror\n", path(&mirrored));
    assert_eq!(said(&args!["detect", "-m", model, "--json", mirrored]), hint);
    assert_eq!(said(&args!["detect", "-m", model, "--json", mirrored, frame(24), mirrored]), hint, "it is told once");
    let hint = format!("keygraph: {}: found when not mirrored: leave out --mirror\n", path(&frame(1)));
    assert_eq!(said(&args!["detect", "-m", model, "--json", "--mirror", frame(1)]), hint);
    // Neither a frame that does not show the object nor a sequence of a camera is worth a word.
    assert_eq!(said(&args!["detect", "-m", model, "--json", frame(24)]), "");
    assert_eq!(said(&args!["detect", "-m", model, "--json", "--track", mirrored]), "");
    // Where something was found, frames are as they should be.
    let run = keygraph!("detect", "-m", model, "--json", mirrored, frame(1)).ended_with(0);
    assert_eq!(run.err, "");
}

#[test]
fn poses_are_not_those_of_a_mirrored_world() {
    let folder = Folder::new("mirror-pose");
    let model = astronaut(&folder);
    keygraph!("detect", "-m", model, frame(0), "--mirror", "--intrinsics", "600,600,320,240", "--width-mm", "200")
        .ended_with(2)
        .said(&["--mirror", "--intrinsics"]);
}
