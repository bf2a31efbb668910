//! `keygraph detect --annotate`: pictures that are written, and inputs that are not.

use std::fs;

use image::imageops;

use crate::astronaut;
use crate::program::{Folder, frame, pixels};

#[test]
fn annotated_pictures_have_the_names_and_sizes_of_the_frames() {
    let folder = Folder::new("annotate");
    let model = astronaut(&folder);
    let half = folder.join("half.png");
    imageops::resize(&pixels(&frame(1)), 321, 240, imageops::FilterType::Triangle).save(&half).unwrap();
    let target = Folder::new("annotate-target");
    let run = keygraph!("detect", "-m", model, frame(0), half, frame(24), "--json", "--annotate", target.0);
    let lines = run.ended_with(0).lines();
    assert_eq!(lines.len(), 3);
    assert_eq!(target.names(), ["0000.jpg", "0024.jpg", "half.png"]);
    for (name, input) in [("0000.jpg", frame(0)), ("half.png", half), ("0024.jpg", frame(24))] {
        let (drawn, original) = (pixels(&target.join(name)), pixels(&input));
        assert_eq!(drawn.dimensions(), original.dimensions(), "{name}");
        assert_ne!(drawn, original, "{name} has nothing drawn onto it");
    }
}

#[test]
fn one_annotated_picture_goes_to_a_file() {
    let folder = Folder::new("annotate-file");
    let model = astronaut(&folder);
    let (one, two) = (folder.join("one.png"), folder.join("two.png"));
    let run = keygraph!("detect", "-m", model, frame(0), "--annotate", one).ended_with(0);
    assert_eq!(run.err, format!("keygraph: written: {}\n", one.display()));
    assert_eq!(pixels(&one).dimensions(), (640, 480));
    keygraph!("detect", "-m", model, frame(0), frame(1), "--annotate", two).ended_with(1).said(&[
        "two.png",
        "one picture",
        "give a folder",
    ]);
}

#[test]
fn an_input_is_never_overwritten() {
    let folder = Folder::new("overwrite");
    let model = astronaut(&folder);
    let input = folder.join("frame.jpg");
    fs::copy(frame(0), &input).unwrap();
    keygraph!("detect", "-m", model, input, "--annotate", input).ended_with(1).said(&["overwrite", "another folder"]);
    keygraph!("detect", "-m", model, input, "--annotate", folder.0).ended_with(1).said(&["overwrite"]);
    assert_eq!(fs::read(&input).unwrap(), fs::read(frame(0)).unwrap(), "the input is as it was");
}

#[test]
fn another_input_is_not_overwritten_either_and_equal_names_are_numbered() {
    let folder = Folder::new("overwrite-other");
    let model = astronaut(&folder);
    let (a, b) = (folder.join("a"), folder.join("b"));
    for place in [&a, &b] {
        fs::create_dir(place).unwrap();
        fs::copy(frame(0), place.join("x.jpg")).unwrap();
    }
    let inputs = [a.join("x.jpg"), b.join("x.jpg")];
    keygraph!("detect", "-m", model, inputs[0], inputs[1], "--annotate", b).ended_with(1).said(&["overwrite"]);
    assert_eq!(fs::read(&inputs[1]).unwrap(), fs::read(frame(0)).unwrap(), "the second input is as it was");
    let out = folder.join("out");
    keygraph!("detect", "-m", model, inputs[0], inputs[1], "--annotate", out).ended_with(0);
    let mut names: Vec<_> = fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["x-2.jpg", "x.jpg"]);
}
