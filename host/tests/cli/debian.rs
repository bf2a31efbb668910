//! The package for Debian: every file that its list in `host/Cargo.toml` names is there, or is made by
//! `scripts/package-deb`, and nothing is made that the list leaves out. The package itself is not built here.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::program::{Folder, assets};

/// The folder in which the list looks for what `scripts/package-deb` makes.
const STAGE: &str = "../target/deb/";

/// The paths that the list names, relative to `host`, and where they go.
fn listed(manifest: &str) -> Vec<(String, String)> {
    let section = manifest.split("[package.metadata.deb]").nth(1).unwrap();
    let assets = section.split("assets = [").nth(1).unwrap().split("\n]").next().unwrap();
    let rows = assets.lines().filter(|row| row.contains('"'));
    let texts = rows.map(|row| row.split('"').skip(1).step_by(2).map(String::from).collect::<Vec<_>>());
    texts.map(|row| (row[0].clone(), row[1].clone())).collect()
}

/// All files in a folder and below, relative to it.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

#[test]
fn every_file_of_the_package_is_there_or_is_made() {
    let root = assets().join("..");
    if Command::new("python3").arg("--version").output().is_err() {
        assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no python3, and nothing may be skipped");
        // A print would be hidden.
        let _ =
            writeln!(std::io::stderr(), "SKIPPED: no python3 for scripts/package-deb: sudo apt-get install python3");
        return;
    }
    let folder = Folder::new("debian");
    let stage = folder.join("stage");
    let run = Command::new(root.join("scripts/package-deb"))
        .args(["--stage", env!("CARGO_BIN_EXE_keygraph")])
        .arg(&stage)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));

    let listed = listed(&fs::read_to_string(root.join("host/Cargo.toml")).unwrap());
    assert!(listed.len() > 8, "{listed:?}");
    let mut made = files(&stage);
    for (path, place) in &listed {
        if path == "target/release/keygraph" {
            assert_eq!(place, "usr/bin/", "systemd and the manual look for it there");
        } else if let Some(name) = path.strip_prefix(STAGE) {
            let before = made.len();
            // A name may end with an asterisk.
            let wanted = stage.join(name.trim_end_matches('*'));
            made.retain(|file| if name.ends_with('*') { !file.starts_with(&wanted) } else { *file != wanted });
            assert!(made.len() < before, "scripts/package-deb does not make {path}");
        } else {
            assert!(root.join("host").join(path).is_file(), "host/Cargo.toml names {path}, which is not there");
        }
    }
    assert!(made.is_empty(), "host/Cargo.toml leaves out what scripts/package-deb makes: {made:?}");
    for script in ["postinst", "prerm", "postrm"] {
        assert!(root.join("host/debian").join(script).is_file(), "{script}");
    }

    let unit = fs::read_to_string(stage.join("keygraph.service")).unwrap();
    assert!(unit.starts_with("[Unit]"), "the instructions are left out: {unit}");
    assert!(unit.contains("ExecStart=/usr/bin/keygraph camera --config /etc/keygraph/keygraph.toml\n"), "{unit}");
    assert!(!unit.contains("/usr/local") && !unit.contains("cover.kgm"), "{unit}");
    let options = fs::read_to_string(root.join("docs/keygraph.toml")).unwrap();
    assert!(options.contains("\nmodels = \"/var/lib/keygraph\""), "what is learned is kept where the unit may write");
    let page = fs::read(stage.join("man1/keygraph-camera.1.gz")).unwrap();
    assert!(page.starts_with(&[0x1f, 0x8b]), "pages of the manual are compressed");
}
