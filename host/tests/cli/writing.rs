//! Files that are written: whole or not at all, and never onto an input. What may fail is made to
//! fail: the disk, the number of open files, the program itself.
#![cfg(unix)]

use std::ffi::OsString;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use keygraph::output::is_draft;

use crate::program::{Folder, frame, keygraph, picture};
use crate::{ASTRONAUT, astronaut};

/// Runs the program in a shell that has taken `limits`, such as `ulimit -n 5`.
fn limited(limits: &str, arguments: &[OsString]) -> Output {
    let script = format!("{limits}; exec \"$@\"");
    Command::new("bash")
        .args(["-c", &script, "bash", env!("CARGO_BIN_EXE_keygraph")])
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn make_fifo(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// Two models, a model `out.kgm` of one of them, and the arguments that pack both into it.
fn packing(folder: &Folder) -> (PathBuf, Vec<OsString>) {
    let (one, two, out) = (astronaut(folder), folder.file("two.kgm", &ASTRONAUT), folder.file("out.kgm", &ASTRONAUT));
    let arguments = args!["pack", one, two, "-o", out].to_vec();
    (out, arguments)
}

/// What [`packing`] makes when nothing fails.
fn packed(folder: &Folder) -> Vec<u8> {
    let (out, arguments) = packing(folder);
    keygraph(&arguments).ended_with(0);
    fs::read(out).unwrap()
}

// -------------------------------------------------------------------- inputs

#[test]
fn no_model_is_written_onto_an_input() {
    let folder = Folder::new("onto");
    let (model, photo) = (astronaut(&folder), folder.join("photo.jpg"));
    fs::copy(picture("astronaut"), &photo).unwrap();
    let [link, hard, photo_link] = ["link.kgm", "hard.kgm", "photo.kgm"].map(|n| folder.join(n));
    symlink(&model, &link).unwrap();
    fs::hard_link(&model, &hard).unwrap();
    symlink(&photo, &photo_link).unwrap();
    for output in [&model, &link, &hard] {
        keygraph!("pack", model, "-o", output).refused_with(&["would overwrite an input"]);
        keygraph!("train", photo, "-o", output, "--beside", model).refused_with(&["would overwrite an input"]);
    }
    keygraph!("train", photo, "-o", photo_link).refused_with(&["would overwrite an input"]);
    keygraph!("train", photo, "-o", photo).refused_with(&["photo.jpg", "must end with .kgm"]);
    keygraph!("train", picture("coffee"), "-o", photo).refused_with(&["photo.jpg", "must end with .kgm"]);
    let notes = folder.file("notes.kgm", b"to do");
    keygraph!("train", photo, "-o", notes).refused_with(&["notes.kgm is no model and would be lost"]);
    assert_eq!(fs::read(&model).unwrap(), *ASTRONAUT);
    assert_eq!(fs::read(&photo).unwrap(), fs::read(picture("astronaut")).unwrap());
}

#[test]
fn annotated_frames_need_an_extension_that_is_known_and_spare_other_names_of_inputs() {
    let folder = Folder::new("annotate-writing");
    let (model, input) = (astronaut(&folder), folder.join("frame.jpg"));
    fs::copy(frame(0), &input).unwrap();
    for name in ["out.gif", "out.xyz", "out.kgm"] {
        let run = keygraph!("detect", "-m", model, input, "--annotate", folder.join(name));
        run.refused_with(&[name, "not known", ".png", ".mp4", "a folder"]);
    }
    let [hard, link] = ["hard.jpg", "link.jpg"].map(|n| folder.join(n));
    fs::hard_link(&input, &hard).unwrap();
    symlink(&input, &link).unwrap();
    for other in [hard, link] {
        keygraph!("detect", "-m", model, input, "--annotate", other).refused_with(&["would overwrite the input"]);
        keygraph!("assess", input, "--annotate", other).refused_with(&["would overwrite an input"]);
    }
    assert_eq!(fs::read(&input).unwrap(), fs::read(frame(0)).unwrap());
    assert_eq!(folder.names(), ["astronaut.kgm", "frame.jpg", "hard.jpg", "link.jpg"], "no folder was made");
    keygraph!("detect", "-m", model, input, "--annotate", format!("{}/run.1/", folder.0.display())).ended_with(0);
    assert!(folder.join("run.1/frame.jpg").is_file());
}

#[test]
fn names_with_control_characters_are_refused() {
    let folder = Folder::new("control");
    let model = folder.join("m.kgm");
    for name in ["a\nb", "\u{1b}[2J", " "] {
        let run = keygraph!("train", picture("astronaut"), "-o", model, "--name", name);
        assert!(run.ended_with(2).err.contains("name"));
    }
    let strange = folder.join("a\u{1b}[2J\n.jpg");
    fs::copy(picture("astronaut"), &strange).unwrap();
    let run = keygraph!("train", strange, "-o", model, "--preset", "compact").ended_with(0);
    assert!(run.out.contains("a\\u{1b}[2J\\n.jpg") && !run.out.contains('\u{1b}'), "{}", run.out);
    assert!(keygraph!("inspect", model).ended_with(0).out.contains("object     a_[2J_, "));
}

// -------------------------------------------------------------------- faults

#[test]
fn a_file_that_cannot_grow_leaves_the_one_before() {
    let folder = Folder::new("grow");
    let (out, arguments) = packing(&folder);
    let (heat, before) = (folder.file("heat.png", b"old"), folder.names());
    let draw = args!["detect", "-m", astronaut(&folder), frame(0), "--annotate", heat];
    let change = args!["pack", "-m", out, "--replace", astronaut(&folder)];
    // The signal would end the program; without it, writing fails as on a full disk.
    for arguments in [&arguments[..], &draw, &change] {
        let run = limited("trap '' XFSZ; ulimit -f 64", arguments);
        let said = String::from_utf8_lossy(&run.stderr);
        assert!(run.status.code() == Some(1) && said.contains("cannot write"), "{said}");
    }
    assert_eq!((fs::read(out).unwrap(), fs::read(heat).unwrap()), (ASTRONAUT.clone(), b"old".to_vec()));
    assert_eq!(folder.names(), before);
}

#[test]
fn too_few_open_files_leave_the_file_before_or_a_whole_one() {
    let folder = Folder::new("few");
    let new = packed(&folder);
    let (out, arguments) = packing(&folder);
    let before = folder.names();
    for most in 3..12 {
        fs::write(&out, &*ASTRONAUT).unwrap();
        let run = limited(&format!("ulimit -n {most}"), &arguments);
        let now = fs::read(&out).unwrap();
        assert!(now == new || (!run.status.success() && now == *ASTRONAUT), "{most} files: {:?}", run.status);
        assert_eq!(folder.names(), before, "{most} files");
    }
}

#[test]
fn a_program_that_is_killed_leaves_the_file_before_or_a_whole_one() {
    let folder = Folder::new("killed");
    let new = packed(&folder);
    let (out, arguments) = packing(&folder);
    let before = folder.names();
    for step in 0..16 {
        fs::write(&out, &*ASTRONAUT).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_keygraph"))
            .args(&arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let started = |names: Vec<String>| names.iter().any(|name| is_draft(Path::new(name)));
        while child.try_wait().unwrap().is_none() && !started(folder.names()) {
            thread::sleep(Duration::from_micros(50));
        }
        thread::sleep(Duration::from_micros(200 * step));
        child.kill().unwrap();
        child.wait().unwrap();
        let now = fs::read(&out).unwrap();
        assert!(now == new || now == *ASTRONAUT, "step {step}: {} bytes", now.len());
        for name in folder.names().into_iter().filter(|name| !before.contains(name)) {
            assert!(is_draft(Path::new(&name)), "step {step}: {name}");
            fs::remove_file(folder.join(&name)).unwrap();
        }
    }
}

#[test]
fn pipes_and_devices_are_outputs_too() {
    let folder = Folder::new("direct");
    let model = astronaut(&folder);
    let run = limited("true", &args!["pack", model, "-o", "/dev/stdout"]);
    assert!(run.status.success() && run.stdout.starts_with(b"KGM"), "{:?}", run.status);
    keygraph!("pack", model, "-o", "/dev/null").ended_with(0);
    if Path::new("/dev/full").exists() {
        keygraph!("pack", model, "-o", "/dev/full").refused_with(&["cannot write /dev/full", "No space left"]);
    }
}

// ------------------------------------------------------------ strange inputs

#[test]
fn pipes_devices_and_links_do_not_stop_a_search() {
    let folder = Folder::new("strange");
    let (models, frames) = (folder.join("models"), folder.join("frames"));
    for place in [&models, &frames] {
        fs::create_dir(place).unwrap();
    }
    fs::copy(frame(0), frames.join("0.jpg")).unwrap();
    make_fifo(&frames.join("1.jpg"));
    fs::write(models.join("a.kgm"), &*ASTRONAUT).unwrap();
    fs::create_dir(models.join("b.kgm")).unwrap();
    make_fifo(&models.join("c.kgm"));
    symlink("/dev/zero", models.join("d.kgm")).unwrap();
    let run = keygraph!("camera", "--replay", frames, "--models", models, "--frames", "1", "--json").ended_with(0);
    for name in ["b.kgm", "c.kgm", "d.kgm"] {
        assert!(run.err.lines().any(|l| l.contains(name) && l.contains("not a regular file")), "{name}: {}", run.err);
    }
    assert_eq!(run.lines()[0]["detections"][0]["object"], "astronaut");
    keygraph!("detect", "-m", "/dev/zero", frame(0)).refused_with(&["/dev/zero", "a device"]);
    keygraph!("train", "/dev/zero", "-o", folder.join("m.kgm")).refused_with(&["/dev/zero", "a device"]);
}
