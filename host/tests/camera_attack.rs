//! The page of `keygraph camera` against those who want in, or want it to stop: weak tokens,
//! guesses, requests that are half sent, pictures that are too large.
//!
//! In: frames of the repository. Out: answers, the log, and the memory of the program.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use camera_live::{LIMIT, Live};
use program::{Folder, assets, keygraph};

/// A token that is long enough.
const TOKEN: &str = "a+long/enough=token";

/// The memory that the unit of systemd allows, kB.
const MOST_KB: u64 = 256 << 10;

fn sequence() -> String {
    assets().join("sequence").to_str().unwrap().to_string()
}

fn start(more: &[&str]) -> Live {
    Live::start(&[&["--replay", &sequence(), "--fps", "10", "--web", "127.0.0.1:0"], more].concat())
}

#[test]
fn short_tokens_are_refused_and_no_given_token_is_logged() {
    for short in ["", "hunter2"] {
        let run = keygraph(&["camera", "--replay", &sequence(), "--web", "127.0.0.1:0", "--token", short])
            .refused_with(&["16 characters", "leave it out"]);
        assert!(short.is_empty() || !run.err.contains(short), "{}", run.err);
        let run = Command::new(env!("CARGO_BIN_EXE_keygraph"))
            .args(["camera", "--replay", &sequence(), "--web", "127.0.0.1:0"])
            .env("KEYGRAPH_TOKEN", short)
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&run.stderr);
        assert!(!run.status.success() && told.contains("16 characters"), "{told}");
        assert!(short.is_empty() || !told.contains(short), "{told}");
    }
    let mut live = start(&["--token", TOKEN, "--log", "trace"]);
    assert_eq!(live.get("/status?token=a%2Blong%2Fenough%3Dtoken").status, 200, "the query is decoded");
    live.token = Some(TOKEN.into());
    assert_eq!(live.get("/status").status, 200);
    live.signal("TERM");
    live.wait_for("ending");
    assert!(live.logged.iter().all(|l| !l.contains(TOKEN)), "{}", live.logged.join("\n"));
}

#[test]
fn guesses_are_slowed_and_logged_without_the_guess() {
    let mut live = start(&["--token", TOKEN]);
    live.token = Some("a-wrong-guess-or-two".into());
    let begin = Instant::now();
    let place = &live;
    let codes: Vec<u16> = thread::scope(|scope| {
        let guesses: Vec<_> = (0..12).map(|_| scope.spawn(|| place.get("/status").status)).collect();
        guesses.into_iter().map(|g| g.join().unwrap()).collect()
    });
    let count = |code: u16| codes.iter().filter(|&&c| c == code).count();
    assert!(count(401) >= 4 && count(429) > 0 && count(401) + count(429) == 12, "{codes:?}");
    assert!(begin.elapsed() >= Duration::from_millis(900), "the fourth guess waits for a second");
    let line = live.wait_for("a wrong token from 127.0.0.1");
    assert!(!line.contains("guess"), "{line}");
    live.token = Some(TOKEN.into());
    let begin = Instant::now();
    assert_eq!(live.get("/status").status, 200);
    assert!(begin.elapsed() < Duration::from_millis(900), "the right token does not wait");
}

/// Waits until the server has closed a connection, or has answered and closed it.
fn is_closed(mut stream: &TcpStream, end: Instant) -> bool {
    let left = end.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
    stream.set_read_timeout(Some(left)).unwrap();
    let mut rest = Vec::new();
    match stream.read_to_end(&mut rest) {
        Ok(_) => true,
        Err(error) => error.kind() == std::io::ErrorKind::ConnectionReset,
    }
}

#[test]
fn requests_that_are_half_sent_cost_nothing() {
    let live = start(&[]);
    let before = live.memory_kb("VmRSS");
    let host = &live.place;
    let mut open = Vec::new();
    for i in 0..20 {
        let mut stream = live.connect();
        // Some are silent, others stop within the head.
        if i % 2 == 0 {
            write!(stream, "GET /status HTTP/1.1\r\nHost: {host}\r\nX-Half").unwrap();
        }
        open.push(stream);
    }
    for i in 0..60 {
        let mut stream = live.connect();
        let path = if i % 2 == 0 { "/learn?name=x&corners=1,1,9,1,9,9,1,9" } else { "/models?name=x" };
        write!(stream, "POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: 16000000\r\n\r\n\0\0\0").unwrap();
        open.push(stream);
    }
    thread::sleep(Duration::from_millis(300));
    let begin = Instant::now();
    assert_eq!(live.get("/status").status, 200);
    let refused = live.ask("POST", "/learn?name=x&corners=1,1,9,1,9,9,1,9", &[], b"no picture");
    assert!(refused.status == 400 && refused.text().contains("no picture"), "{} {}", refused.status, refused.text());
    assert!(begin.elapsed() < Duration::from_secs(5), "answered after {:?}", begin.elapsed());
    let grown = live.memory_kb("VmRSS").saturating_sub(before);
    assert!(grown < 16 << 10, "80 requests took {grown} kB");
    let end = Instant::now() + LIMIT / 3;
    assert!(open.iter().all(|stream| is_closed(stream, end)), "a connection stays open");
}

#[test]
fn more_connections_than_there_are_places_are_answered_in_the_end() {
    let live = start(&[]);
    let silent: Vec<_> = (0..300).map(|_| live.connect()).collect();
    assert_eq!(live.get("/health").status, 200, "silent connections make room");
    drop(silent);
}

/// The head of a JPEG of this size, and an end: nothing in between.
fn claims(width: u16, height: u16) -> Vec<u8> {
    let mut jpeg = std::fs::read(program::frame(2)).unwrap();
    let at = jpeg.windows(2).position(|w| matches!(w, [0xFF, 0xC0 | 0xC2])).unwrap() + 5;
    jpeg[at..at + 2].copy_from_slice(&height.to_be_bytes());
    jpeg[at + 2..at + 4].copy_from_slice(&width.to_be_bytes());
    jpeg
}

#[test]
fn four_learners_at_a_time_stay_within_the_memory_of_the_unit() {
    let live = start(&[]);
    let learn = |jpeg: &[u8]| {
        let path = "/learn?name=x&corners=10,10,2000,10,2000,2000,10,2000";
        let answer = live.ask("POST", path, &[], jpeg);
        (answer.status, answer.text())
    };
    // The first is refused by its header. The second is as large as is allowed: all of it is
    // decoded, and most of it is gray. So is the third, with four bytes a pixel.
    let clear = image::RgbaImage::from_fn(4000, 3000, |x, y| image::Rgba([x as u8, y as u8, 9, 200]));
    let mut png = std::io::Cursor::new(Vec::new());
    clear.write_to(&mut png, image::ImageFormat::Png).unwrap();
    drop(clear);
    let large = [
        (claims(14_000, 12_000), "at most 12.5 megapixels"),
        (claims(4000, 3000), "damaged"),
        (png.into_inner(), "damaged"),
    ];
    for (jpeg, words) in large {
        thread::scope(|scope| {
            let learners: Vec<_> = (0..4).map(|_| scope.spawn(|| learn(&jpeg))).collect();
            for learner in learners {
                let (status, text) = learner.join().unwrap();
                let known =
                    status == 400 && text.contains(words) || status == 201 || status == 400 && words == "damaged";
                assert!(known, "{status} {text}");
            }
        });
    }
    let peak = live.memory_kb("VmHWM");
    assert!(peak < MOST_KB, "{peak} kB at most");
    assert_eq!(live.get("/health").status, 200);
}

#[test]
fn a_picture_too_large_to_train_on_is_refused_before_it_is_decoded() {
    let folder = Folder::new("large-picture");
    let path = folder.file("large.png", LARGE_PNG);
    let run = Command::new("sh")
        .args(["-c", "ulimit -v 500000; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_keygraph")])
        .args(["train", path.to_str().unwrap(), "-o", folder.join("m.kgm").to_str().unwrap()])
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.code() == Some(1) && told.contains("30000x30000 px"), "{}: {told}", run.status);
}

/// The head of a PNG of 30000 x 30000 px of gray: memory is reserved by this alone.
const LARGE_PNG: &[u8] = b"\x89PNG\r\n\x1a\n\
    \0\0\0\x0dIHDR\0\0\x75\x30\0\0\x75\x30\x08\0\0\0\0\x43\x4c\xa7\x66\
    \0\0\0\0IDAT\x35\xaf\x06\x1e";
