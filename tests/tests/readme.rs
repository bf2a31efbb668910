//! Checks the statements of the README that a machine can check.

use std::mem::size_of;

use keygraph_core::{HdDetector, QqvgaDetector, QvgaDetector, VgaDetector};

const README: &str = include_str!("../../README.md");

/// Checks that the memory table gives the sizes of the types.
#[test]
fn sizes_of_the_detectors() {
    let profiles = [
        ("qqvga", 160, 120, size_of::<QqvgaDetector>()),
        ("qvga", 320, 240, size_of::<QvgaDetector>()),
        ("vga", 640, 480, size_of::<VgaDetector>()),
        ("hd", 1280, 720, size_of::<HdDetector>()),
    ];
    let rows: Vec<String> = profiles
        .iter()
        .map(|(name, w, h, size)| {
            let with_frame = size + 2 * w * h;
            format!("| {name} | {w}x{h} | {} KB | {} KB |", size.div_ceil(1024), with_frame.div_ceil(1024))
        })
        .collect();
    let missing: Vec<&String> = rows.iter().filter(|r| !README.contains(*r)).collect();
    assert!(missing.is_empty(), "README.md lacks these rows of its memory table:\n{missing:#?}");
}

/// Checks that the scripts that the README names exist.
#[test]
fn commands_exist() {
    let commands: Vec<&str> = README
        .match_indices("scripts/")
        .map(|(at, _)| README[at..].split(|c: char| !c.is_alphanumeric() && !"/-_.".contains(c)).next().unwrap_or(""))
        .collect();
    assert!(commands.len() > 5, "too few to be all: {commands:?}");
    for command in commands {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(command);
        // A Python package is run by the name of its folder.
        assert!(path.is_file() || path.join("__main__.py").is_file(), "{command}");
    }
}
