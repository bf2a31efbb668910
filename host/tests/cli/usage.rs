//! Wrong command lines, help, and models that cannot be read.

use std::fs;
use std::process::Command;

use image::RgbImage;

use crate::lines::path;
use crate::program::{Folder, frame, keygraph, picture, run_in};
use crate::{ASTRONAUT, astronaut};

#[test]
fn a_wrong_command_line_ends_with_2() {
    let folder = Folder::new("usage");
    let (m, f) = (path(&astronaut(&folder)), path(&frame(0)));
    let (m, f) = (m.as_str(), f.as_str());
    let wrong: &[&[&str]] = &[
        &[],
        &["fnid"],
        &["detect", "-m", m, f, "--colour"],
        &["detect", "-m", m],
        &["detect", f],
        &["detect", "-m", m, f, "--threshold", "2"],
        &["detect", "-m", m, f, "--threshold", "-0.5"],
        &["detect", "-m", m, f, "--threshold", "NaN"],
        &["detect", "-m", m, f, "--threshold", "high"],
        &["detect", "-m", m, f, "--threads", "0"],
        &["detect", "-m", m, f, "--track", "--json", "--digests"],
        &["detect", "-m", m, f, "--smooth"],
        &["detect", "-m", m, f, "--track", "--smooth=0"],
        &["detect", "-m", m, f, "--profile", "8k"],
        &["train", f],
        &["train", "-o", "m.kgm"],
        &["train", f, "-o", "m.kgm", "--preset", "huge"],
        &["pack", "-o", "all.kgm"],
        &["pack", m],
        &["pack", "-m", m],
        &["pack", "-m", m, "-o", "all.kgm"],
        &["pack", "-m", m, "--add"],
        &["pack", m, "--add", m, "-o", "all.kgm"],
        &["pack", m, "-m", m, "--remove", "astronaut"],
        &["inspect"],
        &["assess"],
        &["assess", f, "--views", "0"],
    ];
    for arguments in wrong {
        let run = run_in(&folder.0, arguments, b"");
        assert_eq!((run.status, run.out.as_str()), (2, ""), "{arguments:?}: {}", run.err);
        assert!(run.err.contains("Usage") || run.err.contains("error"), "{arguments:?}: {}", run.err);
    }
    assert_eq!(folder.names(), ["astronaut.kgm"]);
}

#[test]
fn help_and_version_end_with_0() {
    for arguments in [&["--help"][..], &["detect", "--help"], &["--version"]] {
        let run = keygraph(arguments).ended_with(0);
        assert!(run.out.contains("keygraph"), "{arguments:?}: {}", run.out);
    }
}

#[test]
fn colours_are_shown_when_asked_for() {
    let said = |arguments: &[&str], colour: Option<&str>| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_keygraph"));
        program.args(arguments).env_remove("NO_COLOR");
        program.envs(colour.map(|value| ("NO_COLOR", value)));
        let done = program.output().unwrap();
        String::from_utf8([done.stderr, done.stdout].concat()).unwrap().contains('\u{1b}')
    };
    for command in [&["detect", "--nonsense"][..], &["inspect", "/no/such.kgm"], &["train", "--help"]] {
        let with = |more: &[&'static str]| [command, more].concat();
        assert!(!said(command, None), "no terminal, no colours: {command:?}");
        assert!(said(&with(&["--color", "always"]), None), "{command:?}");
        assert!(said(&with(&["--color=always"]), Some("1")), "what is asked for here counts: {command:?}");
        assert!(!said(&with(&["--color", "never"]), None), "{command:?}");
    }
    keygraph(&["inspect", "m.kgm", "--color", "blue"]).ended_with(2).said(&["always"]);
}

#[test]
fn quiet_leaves_errors_and_results() {
    let folder = Folder::new("quiet");
    let (model, frames, out) = (astronaut(&folder), folder.join("frames"), folder.join("out"));
    fs::create_dir(&frames).unwrap();
    fs::copy(frame(0), frames.join("0.jpg")).unwrap();
    folder.file("frames/notes.txt", b"");
    let told = keygraph!("detect", "-m", model, frames, "--annotate", out).ended_with(0);
    told.said(&["left out", "notes.txt", "written: 1 file in ", &path(&out)]);
    let run = keygraph!("-q", "detect", "-m", model, frames, "--annotate", out).ended_with(0);
    assert_eq!((run.err.as_str(), run.out.lines().count()), ("", 1), "{}", run.out);
    let run = keygraph!("detect", "--quiet", "-m", model, frames, folder.join("none.jpg")).ended_with(1);
    assert_eq!(run.err.lines().count(), 1, "{}", run.err);
    run.said(&["none.jpg", "no such file"]);
    let made = folder.join("made.kgm");
    let run = keygraph!("train", picture("brick"), "-o", made, "--preset", "compact", "-q").ended_with(0);
    assert_eq!((run.out.as_str(), run.err.as_str()), ("", ""));
    let run = keygraph!("pack", made, "-o", folder.join("all.kgm"), "-q").ended_with(0);
    assert_eq!((run.out.as_str(), run.err.as_str()), ("", ""));
}

#[test]
fn a_damaged_model_or_another_file_is_refused_with_advice() {
    let folder = Folder::new("damaged");
    let whole = &*ASTRONAUT;
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    let mut newer = whole.clone();
    newer[4] = 200;
    let mut png = Vec::new();
    RgbImage::new(32, 32).write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let table: [(&str, &[u8], &[&str]); 5] = [
        ("cut.kgm", &whole[..1000], &["cut off", "1000", "copy it again"]),
        ("flipped.kgm", &flipped, &["damaged", "copy it again"]),
        ("newer.kgm", &newer, &["version 200", "update"]),
        ("picture.png", &png, &["not a keygraph model", "keygraph train"]),
        ("empty.kgm", b"", &["not a keygraph model", "keygraph train"]),
    ];
    for (name, bytes, words) in table {
        let (model, all) = (folder.file(name, bytes), folder.join("all.kgm"));
        for run in [
            keygraph!("detect", "-m", model, frame(0), "--json"),
            keygraph!("inspect", model, "--json"),
            keygraph!("pack", model, "-o", all),
        ] {
            run.refused_with(words).said(&[name]);
        }
        assert!(!all.exists(), "{name} was packed");
    }
}

#[test]
fn a_missing_model_is_named() {
    let model = std::env::temp_dir().join("keygraph-cli-no-such.kgm");
    let words = ["cannot read the model", "keygraph-cli-no-such.kgm"];
    keygraph!("detect", "-m", model, frame(0), "--json").refused_with(&words);
    keygraph!("inspect", model).refused_with(&words);
}

#[test]
fn a_missing_model_comes_with_advice() {
    let model = std::env::temp_dir().join("keygraph-cli-no-such.kgm");
    keygraph!("detect", "-m", model, frame(0), "--json").refused_with(&["keygraph train"]);
}

#[test]
fn completions_and_pages_of_the_manual() {
    let folder = Folder::new("extras");
    let run = keygraph!("extras", folder.0).ended_with(0);
    for (file, words) in [
        ("completions/keygraph", &["keygraph,detect)", "--exit-code"][..]),
        ("completions/_keygraph", &["#compdef keygraph", "--rectify"]),
        ("completions/keygraph.fish", &["complete -c keygraph", "find"]),
        ("man1/keygraph-find.1", &[".TH keygraph-find 1", "PICTURE"]),
    ] {
        let text = std::fs::read_to_string(folder.join(file)).unwrap();
        assert!(words.iter().all(|word| text.replace("\\-", "-").contains(word)), "{file}: {text:.300}");
        assert!(run.out.contains(file), "{}", run.out);
    }
}
