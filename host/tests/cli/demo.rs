//! `keygraph demo`.

use std::fs;

use crate::program::{Folder, assets, run_in};

#[test]
fn the_demo_finds_its_objects() {
    let folder = Folder::new("demo");
    let run = keygraph!("demo", "--assets", assets(), "--out", folder.0).ended_with(0);
    let tally = |name: &str| -> usize {
        let line = run.out.lines().find(|l| l.contains(&format!("{name}: found in "))).unwrap_or_else(|| {
            panic!("no summary of {name} in\n{}", run.out);
        });
        line.split("found in ").nth(1).and_then(|l| l.split(' ').next()).unwrap().parse().unwrap()
    };
    assert!(tally("astronaut") >= 34, "{}", run.out);
    assert!(tally("coffee") >= 15, "{}", run.out);
    assert!(run.out.contains("48 frames"), "{}", run.out);
    assert_eq!(folder.names(), ["demo.kgm", "frames"]);
    assert_eq!(fs::read_dir(folder.join("frames")).unwrap().count(), 48, "annotated frames");
}

#[test]
fn the_demo_outside_the_repository_says_what_to_do() {
    let folder = Folder::new("demo-elsewhere");
    run_in(&folder.0, &["demo"], b"").refused_with(&["assets/sequence", "in the repository", "--assets"]);
    assert!(folder.names().is_empty(), "left behind: {:?}", folder.names());
}
