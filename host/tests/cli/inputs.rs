//! `keygraph detect` on what comes by standard input, from addresses and from folders in folders.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::Command;
use std::thread;

use image::ImageFormat;

use crate::astronaut;
use crate::lines::{assert_outline, count, only, path, text};
use crate::program::{Folder, frame, pixels, run_in};

#[test]
fn standard_input_may_be_a_picture_or_many() {
    let folder = Folder::new("stdin");
    let model = astronaut(&folder);
    let mut png = Vec::new();
    pixels(&frame(0)).write_to(&mut std::io::Cursor::new(&mut png), ImageFormat::Png).unwrap();
    let mut webp = Vec::new();
    pixels(&frame(0)).write_to(&mut std::io::Cursor::new(&mut webp), ImageFormat::WebP).unwrap();
    let [a, b] = [0, 1].map(|i| fs::read(frame(i)).unwrap());
    let motion = [a.clone(), b.clone(), a.clone()].concat();
    for (input, frames) in [(a.clone(), 1), (png, 1), (webp, 1), (motion, 3)] {
        let run = run_in(&folder.0, &["detect", "-m", model.to_str().unwrap(), "--json", "-"], &input).ended_with(0);
        let lines = run.lines();
        assert_eq!(lines.len(), frames, "{}", run.out);
        for (index, line) in lines.iter().enumerate() {
            assert_eq!((text(line, "source"), count(line, "frame")), ("-", index as u64));
            only(line);
            assert_outline(&line["detections"][0], [512.0, 512.0], 0.01);
        }
    }
    // A single picture is drawn as one, and not as a video.
    let drawn = folder.join("drawn.png");
    let arguments = ["detect", "-m", model.to_str().unwrap(), "--annotate", drawn.to_str().unwrap(), "-"];
    run_in(&folder.0, &arguments, &fs::read(frame(0)).unwrap()).ended_with(0);
    assert_eq!(pixels(&drawn).dimensions(), (640, 480));
    // What is cut off is told, behind what could be read.
    let cut = [b.clone(), b[..b.len() / 2].to_vec()].concat();
    let run = run_in(&folder.0, &["detect", "-m", model.to_str().unwrap(), "-"], &cut).ended_with(1);
    assert_eq!(run.out.lines().count(), 1, "{}", run.out);
    run.said(&["frame 1", "ends inside a picture"]);
    run_in(&folder.0, &["detect", "-m", model.to_str().unwrap(), "-"], b"")
        .refused_with(&["standard input", "is empty"]);
}

#[test]
fn folders_in_folders_are_read_when_asked_for() {
    let folder = Folder::new("recursive");
    let model = astronaut(&folder);
    let inner = folder.join("all/b/c");
    fs::create_dir_all(&inner).unwrap();
    fs::copy(frame(0), folder.join("all/a.jpg")).unwrap();
    pixels(&frame(1)).save(inner.join("d.bmp")).unwrap();
    let all = folder.join("all");
    let run =
        keygraph!("detect", "-m", model, all, "--json").ended_with(0).said(&["1 folder (--recursive reads them)"]);
    assert_eq!(run.lines().len(), 1, "{}", run.out);
    let run = keygraph!("detect", "-m", model, all, "--json", "--recursive").ended_with(0);
    let sources: Vec<_> = run.lines().iter().map(|l| text(l, "source").to_string()).collect();
    assert_eq!(sources, [path(&folder.join("all/a.jpg")), path(&inner.join("d.bmp"))]);
    assert!(run.lines().iter().all(|l| l["detections"].as_array().unwrap().len() == 1), "{}", run.out);
    assert_eq!(run.err, "");
}

/// Whether there is an ffmpeg. Prints a line that cargo does not hide when there is none.
pub fn has_ffmpeg() -> bool {
    if Command::new("ffmpeg").arg("-version").output().is_ok() {
        return true;
    }
    assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no ffmpeg, and nothing may be skipped");
    let _ = writeln!(std::io::stderr(), "SKIPPED: no ffmpeg to read an address with");
    false
}

#[test]
fn an_address_is_read_by_ffmpeg_and_told_without_its_password() {
    let folder = Folder::new("address");
    if !has_ffmpeg() {
        return;
    }
    let model = astronaut(&folder);
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = server.local_addr().unwrap().port();
    thread::spawn(move || {
        let jpeg = fs::read(frame(0)).unwrap();
        for (at, stream) in server.incoming().enumerate() {
            let mut stream = stream.unwrap();
            let _ = stream.read(&mut [0; 4096]);
            // The second answer does not tell its length.
            let length = if at == 0 { format!("Content-Length: {}\r\n", jpeg.len()) } else { String::new() };
            let head = format!("HTTP/1.1 200 OK\r\nContent-Type: image/jpeg\r\n{length}Connection: close\r\n\r\n");
            let _ = stream.write_all(head.as_bytes());
            let _ = stream.write_all(&jpeg);
        }
    });
    let address = format!("http://me:secret@127.0.0.1:{port}/now.jpg");
    let run = keygraph!("detect", "-m", model, address, "--json").ended_with(0);
    assert_eq!(text(&run.lines()[0], "source"), format!("http://me:***@127.0.0.1:{port}/now.jpg"));
    only(&run.lines()[0]);
    let address = format!("http://127.0.0.1:{port}/now?token=secret");
    let run = keygraph!("detect", "-m", model, address, "--json").ended_with(0);
    assert_eq!(run.lines().len(), 1, "{}", run.out);
    assert_eq!(text(&run.lines()[0], "source"), format!("http://127.0.0.1:{port}/now?token=***"));
    let run = keygraph!("detect", "-m", model, "http://me:secret@127.0.0.1:9/", "ftp://host/x").ended_with(1);
    assert!(!run.err.contains("secret"), "{}", run.err);
    run.said(&["Connection refused", "addresses start with rtsp, rtsps, http or https, not ftp"]);
}
