//! What is left when a signal ends a command in the middle: nothing.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpListener;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::astronaut;
use crate::program::{Folder, frame, has_ffmpeg};

/// Maximum time of any wait; an ffmpeg that is left waits for 15 seconds.
const LIMIT: Duration = Duration::from_secs(60);

/// Starts `keygraph detect` with `more` arguments, in a folder that is also that of its temporary files.
fn start(folder: &Folder, more: &[&str]) -> Child {
    let model = astronaut(folder);
    let mut command = Command::new(env!("CARGO_BIN_EXE_keygraph"));
    command.current_dir(&folder.0).env("TMPDIR", &folder.0).arg("detect").arg("-m").arg(model).args(more);
    command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits until a folder has a file that it did not have before the start.
fn wait_for_file(folder: &Folder) {
    let end = Instant::now() + LIMIT;
    while folder.names() == ["astronaut.kgm"] {
        assert!(Instant::now() < end, "no file is written");
        thread::sleep(Duration::from_millis(10));
    }
}

/// Sends a signal. Asserts that it ends the program, which says nothing and leaves nothing.
fn end(mut child: Child, folder: &Folder, (name, number): (&str, i32)) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let status = child.wait().unwrap();
    let mut told = String::new();
    child.stderr.take().unwrap().read_to_string(&mut told).unwrap();
    assert_eq!((status.signal(), told.as_str()), (Some(number), ""), "{status}");
    assert_eq!(folder.names(), ["astronaut.kgm"]);
}

#[test]
fn ffmpeg_that_waits_for_a_silent_camera_is_ended() {
    if !has_ffmpeg("wait for a camera") {
        return;
    }
    let (folder, server) = (Folder::new("silent"), TcpListener::bind("127.0.0.1:0").unwrap());
    let child = start(&folder, &[&format!("http://{}/stream.mjpg", server.local_addr().unwrap())]);
    let (mut stream, _) = server.accept().unwrap();
    let start = Instant::now();
    let mut request = [0; 1000];
    assert!(stream.read(&mut request).unwrap() > 0);
    end(child, &folder, ("TERM", 15));
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    let closed = stream.read(&mut request);
    let is_closed = matches!(&closed, Ok(0)) || closed.as_ref().is_err_and(|e| e.kind() == ErrorKind::ConnectionReset);
    let time = start.elapsed();
    assert!(is_closed && time < Duration::from_secs(10), "ffmpeg is there {time:?} later: {closed:?}");
}

#[test]
fn the_copy_of_standard_input_is_removed() {
    let folder = Folder::new("copy");
    let mut child = start(&folder, &["-"]);
    // A GIF has to be a file, and its end does not come.
    child.stdin.as_mut().unwrap().write_all(b"GIF89a and more bytes than tell what it is").unwrap();
    wait_for_file(&folder);
    end(child, &folder, ("INT", 2));
}

#[test]
fn a_video_that_is_not_finished_is_removed() {
    if !has_ffmpeg("wait for a camera") {
        return;
    }
    let folder = Folder::new("unfinished");
    let mut child = start(&folder, &["--annotate", "out.mkv", "-"]);
    let picture = fs::read(frame(0)).unwrap();
    child.stdin.as_mut().unwrap().write_all(&[picture.as_slice(), &picture, &picture].concat()).unwrap();
    wait_for_file(&folder);
    end(child, &folder, ("TERM", 15));
}
