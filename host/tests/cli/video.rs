//! `keygraph detect` on videos and streams.

use std::path::Path;
use std::process::Command;

use image::RgbImage;
use serde_json::Value;

use crate::astronaut;
use crate::lines::{assert_line, count, distance, list, only, path, size, text};
use crate::program::{Folder, assets, frame, has_ffmpeg, pixels, run_in};

/// Makes a video of the first `frames` frames of the sequence. Returns false when there is no ffmpeg.
fn make_video(frames: u32, output: &Path) -> bool {
    if !has_ffmpeg(&format!("make {}", output.display())) {
        return false;
    }
    let status = Command::new("ffmpeg")
        .args(["-v", "error", "-nostdin", "-y", "-framerate", "5", "-i"])
        .arg(assets().join("sequence/%04d.jpg"))
        .args(["-frames:v", &frames.to_string(), "-c:v", "mpeg4", "-q:v", "2", "-pix_fmt", "yuv420p"])
        .arg(output)
        .status()
        .unwrap();
    assert!(status.success(), "ffmpeg makes {}", output.display());
    true
}

/// Asserts that the lines of a video have `frames` frames, and that each frame has the
/// astronaut at the place where it is in the pictures of the sequence.
#[track_caller]
fn assert_video(lines: &[Value], source: &str, frames: u32) {
    let folder = Folder::new(&format!("compare-{}", source.replace(|c: char| !c.is_alphanumeric(), "")));
    let mut arguments = args!["detect", "-m", astronaut(&folder), "--json"].to_vec();
    arguments.extend((0..frames).map(|i| frame(i).into_os_string()));
    let stills = run_in(&folder.0, &arguments, b"").ended_with(0).lines();
    assert_eq!(lines.len(), frames as usize, "frames of {source}");
    for (i, (line, still)) in lines.iter().zip(&stills).enumerate() {
        assert_line(line, source, i as u64, (640, 480));
        assert!(line.get("time").is_none(), "a video has no time of day: {line}");
        let (found, right) = (only(line), only(still));
        let off = found.iter().zip(right).map(|(&a, b)| distance(a, b)).sum::<f64>() / 4.0 / size(right);
        assert!(off < 0.03, "frame {i} of {source}: {found:?} is not {right:?}");
    }
}

#[test]
fn a_video_is_read_and_written() {
    let folder = Folder::new("video");
    let (model, clip) = (astronaut(&folder), folder.join("clip.mp4"));
    if !make_video(4, &clip) {
        return;
    }
    let target = folder.join("target");
    let run = keygraph!("detect", "-m", model, clip, "--json", "--annotate", target).ended_with(0);
    assert_video(&run.lines(), &path(&clip), 4);

    // Frames of a video go into a file, and pictures into a video. All can be read again.
    let (again, of_stills) = (folder.join("again.mkv"), folder.join("stills.mp4"));
    keygraph!("detect", "-m", model, clip, "--json", "--annotate", again).ended_with(0);
    keygraph!("detect", "-m", model, frame(0), frame(1), "--json", "--annotate", of_stills).ended_with(0);
    for (video, frames) in [(target.join("clip.mp4"), 4), (again, 4), (of_stills, 2)] {
        let lines = keygraph!("detect", "-m", model, video, "--json").ended_with(0).lines();
        assert_eq!(lines.len(), frames, "frames of {}", video.display());
        for (i, line) in lines.iter().enumerate() {
            assert_line(line, &path(&video), i as u64, (640, 480));
        }
    }

    let picture = folder.join("picture.png");
    keygraph!("detect", "-m", model, clip, "--annotate", picture).ended_with(1).said(&[
        "picture.png",
        "clip.mp4",
        "give a folder",
    ]);
    let junk = folder.file("junk.mp4", b"this is no video");
    let run = keygraph!("detect", "-m", model, junk, frame(0), "--json").ended_with(1).said(&["junk.mp4"]);
    let lines = run.lines();
    assert_eq!((lines.len(), text(&lines[0], "source")), (2, path(&junk).as_str()), "{}", run.out);
    assert!(!text(&lines[0], "error").is_empty() && list(&lines[0], "detections").is_empty(), "{}", lines[0]);
    only(&lines[1]);
}

/// One YUV4MPEG2 frame: full planes of Y, then Cb and Cr at half the size, video
/// range of BT.601.
fn yuv4mpeg(picture: &RgbImage) -> Vec<u8> {
    let (w, h) = picture.dimensions();
    let component = |[r, g, b]: [f64; 3], k: [f64; 4]| (k[0] + k[1] * r + k[2] * g + k[3] * b).round() as u8;
    let rgb = |x: u32, y: u32| picture.get_pixel(x, y).0.map(f64::from);
    let mut frame = b"FRAME\n".to_vec();
    for y in 0..h {
        frame.extend((0..w).map(|x| component(rgb(x, y), [16.0, 0.257, 0.504, 0.098])));
    }
    for k in [[128.0, -0.148, -0.291, 0.439], [128.0, 0.439, -0.368, -0.071]] {
        for y in (0..h).step_by(2) {
            frame.extend((0..w).step_by(2).map(|x| {
                let four = [rgb(x, y), rgb(x + 1, y), rgb(x, y + 1), rgb(x + 1, y + 1)];
                component([0, 1, 2].map(|c| four.iter().map(|p| p[c]).sum::<f64>() / 4.0), k)
            }));
        }
    }
    frame
}

#[test]
fn a_stream_is_read_from_standard_input() {
    let folder = Folder::new("stream");
    let arguments = args!["detect", "-m", astronaut(&folder), "-", "--json"];
    let frames: Vec<_> = (0..3).map(|i| yuv4mpeg(&pixels(&frame(i)))).collect();
    let header = b"YUV4MPEG2 W640 H480 F5:1 Ip A1:1 C420jpeg\n".to_vec();
    let stream = [header.clone(), frames.concat()].concat();
    let run = run_in(&folder.0, &arguments, &stream).ended_with(0);
    assert_eq!(run.err, "", "standard error");
    assert_video(&run.lines(), "-", 3);

    // A stream that is cut off in its last frame gives the frames before it, and an error.
    let run = run_in(&folder.0, &arguments, &stream[..stream.len() - 1000]).ended_with(1).said(&["ends inside"]);
    let lines = run.lines();
    assert_video(&lines[..2], "-", 2);
    assert_eq!((lines.len(), count(&lines[2], "frame")), (3, 2), "{}", run.out);
    assert!(text(&lines[2], "error").contains("ends inside the frame"), "{}", lines[2]);

    let run =
        run_in(&folder.0, &arguments, b"this is no stream").ended_with(1).said(&["neither a picture nor a video"]);
    assert_eq!(run.lines().len(), 1, "{}", run.out);
}
