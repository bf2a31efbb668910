//! `keygraph camera` when something beside it stands still: nobody reads its lines, a viewer
//! or a broker hangs, files cannot be opened for a while, a frame cannot be searched.
//!
//! In: frames of the repository. Out: what the program does meanwhile, and how soon it ends.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use camera_live::{LIMIT, Live, truth};
use program::{Folder, assets, frame, keygraph, picture};

/// Maximum time from a signal to the end, and what a busy test machine adds.
const END: Duration = Duration::from_millis(2000 + 500);

fn sequence() -> String {
    assets().join("sequence").to_str().unwrap().to_string()
}

fn model(folder: &Folder) -> String {
    let path = folder.join("astronaut.kgm").to_str().unwrap().to_string();
    keygraph(&["train", picture("astronaut").to_str().unwrap(), "--preset", "compact", "-o", &path]).ended_with(0);
    path
}

/// The value of a number of `GET /metrics`.
fn metric(live: &Live, name: &str) -> f64 {
    let answer = live.get("/metrics");
    assert_eq!(answer.status, 200, "{}", answer.text());
    let text = answer.text();
    let line = text.lines().find_map(|l| l.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("no {name} in\n{text}")).parse().unwrap()
}

/// Waits until a number of `GET /metrics` is more than `least`: threads count after they tell.
#[track_caller]
fn waits_for_more(live: &Live, name: &str, least: f64) {
    let end = Instant::now() + Duration::from_secs(10);
    while metric(live, name) <= least {
        assert!(Instant::now() < end, "{name} stays at {least}");
        thread::sleep(Duration::from_millis(20));
    }
}

#[track_caller]
fn ends_in_time(live: &mut Live) {
    let start = Instant::now();
    live.signal("TERM");
    let status = live.ended();
    let time = start.elapsed();
    assert!(status.success(), "{status}");
    assert!(time < END, "ended after {time:?}");
}

#[test]
fn lines_that_nobody_reads_stop_nothing() {
    let folder = Folder::new("unread");
    let small = folder.join("small.y4m");
    let mut stream = b"YUV4MPEG2 W64 H64 F500:1 Cmono\n".to_vec();
    (0..500).for_each(|_| stream.extend([&b"FRAME\n"[..], &[90; 64 * 64]].concat()));
    std::fs::write(&small, stream).unwrap();
    let arguments = ["-m", &model(&folder), "--json", "--web", "127.0.0.1:0"];
    // Standard output is a pipe that this test does not read: it holds some hundred lines.
    let mut live = Live::start(&[&["--replay", small.to_str().unwrap()], &arguments[..]].concat());
    live.wait_for("standard output is not read");
    let before = metric(&live, "keygraph_frames_total");
    waits_for_more(&live, "keygraph_lines_dropped_total", 0.0);
    waits_for_more(&live, "keygraph_frames_total", before + 20.0);
    ends_in_time(&mut live);
}

#[test]
fn viewers_learners_and_brokers_that_hang_do_not_delay_the_end() {
    let folder = Folder::new("hanging");
    // A broker that takes the connection and says nothing.
    let broker = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("mqtt://{}/test", broker.local_addr().unwrap());
    let web = ["--mqtt", &url, "--web", "127.0.0.1:0"];
    let mut live = Live::start(&[&["--replay", &sequence(), "-m", &model(&folder)], &web[..]].concat());
    let shown = live.frame(None, false);
    let request = format!("GET /frame HTTP/1.1\r\nHost: {}\r\n\r\n", live.place);
    let mut sleeper = live.connect();
    sleeper.write_all(request.repeat(1000).as_bytes()).unwrap();
    let corners = truth(2, "astronaut", [512.0, 512.0]).unwrap();
    let corners: Vec<_> = corners.as_flattened().iter().map(|v| format!("{v:.1}")).collect();
    let mut learners: Vec<_> = (0..2).map(|_| live.connect()).collect();
    for learner in &mut learners {
        let path = format!("/learn?name=x&corners={}", corners.join(","));
        let length = shown.jpeg.len();
        write!(learner, "POST {path} HTTP/1.1\r\nHost: {}\r\nContent-Length: {length}\r\n\r\n", live.place).unwrap();
        learner.write_all(&shown.jpeg).unwrap();
    }
    thread::sleep(Duration::from_millis(200));
    ends_in_time(&mut live);
}

#[test]
fn a_log_that_nobody_reads_does_not_delay_the_end() {
    let mut live = Live::start(&["--replay", &sequence(), "--web", "127.0.0.1:0", "--token", "a-token-of-the-page"]);
    live.token = Some("a-token-of-the-page".into());
    live.frame(None, false);
    live.stop_reading_the_log();
    // The thread that serves the page logs a wrong token, and waits for ever.
    let mut guess = live.connect();
    write!(guess, "GET /status?token=a-wrong-guess HTTP/1.1\r\nHost: {}\r\n\r\n", live.place).unwrap();
    thread::sleep(Duration::from_millis(500));
    ends_in_time(&mut live);
}

#[test]
fn a_busy_machine_does_not_delay_the_end() {
    let folder = Folder::new("busy");
    // No address of this network is in use (RFC 5737).
    let arguments = ["--fps", "50", "--json", "--web", "127.0.0.1:0", "--mqtt", "mqtt://192.0.2.1/test"];
    let mut live = Live::start(&[&["--replay", &sequence(), "-m", &model(&folder)], &arguments[..]].concat());
    let shown = live.frame(None, false);
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        for _ in 0..50 {
            let mut viewer = live.connect();
            let request = format!("GET /frame?details=1 HTTP/1.1\r\nHost: {}\r\n\r\n", live.place);
            viewer.write_all(request.repeat(1000).as_bytes()).unwrap();
            scope.spawn(move || std::io::copy(&mut viewer, &mut std::io::sink()));
        }
        let mut learners: Vec<_> = (0..4).map(|_| live.connect()).collect();
        for learner in &mut learners {
            let path = "/learn?name=x&corners=10,10,300,10,300,200,10,200";
            let length = shown.jpeg.len();
            write!(learner, "POST {path} HTTP/1.1\r\nHost: {}\r\nContent-Length: {length}\r\n\r\n", live.place)
                .unwrap();
            learner.write_all(&shown.jpeg).unwrap();
        }
        for _ in 0..20 {
            scope.spawn(|| {
                while !done.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        thread::sleep(Duration::from_secs(2));
        let start = Instant::now();
        live.signal("TERM");
        let status = live.ended();
        let time = start.elapsed();
        done.store(true, Ordering::Relaxed);
        assert!(status.success() && time < END, "{status} after {time:?}");
    });
}

#[test]
fn a_frame_that_cannot_be_searched_is_told_once() {
    let folder = Folder::new("told-once");
    let thin = folder.join("thin.y4m");
    let mut stream = b"YUV4MPEG2 W8 H8 F1000:1 Cmono\n".to_vec();
    (0..1000).for_each(|_| stream.extend([&b"FRAME\n"[..], &[90; 64]].concat()));
    std::fs::write(&thin, stream).unwrap();
    let mut live = Live::start(&["--replay", thin.to_str().unwrap(), "-m", &model(&folder), "--web", "127.0.0.1:0"]);
    live.wait_for("frame ");
    thread::sleep(Duration::from_secs(2));
    ends_in_time(&mut live);
    live.wait_for("ending");
    assert!(live.logged.len() < 10, "{} lines:\n{}", live.logged.len(), live.logged[..10].join("\n"));
}

#[test]
fn a_replay_goes_on_after_too_many_open_files() {
    let folder = Folder::new("too-many-files");
    let frames = folder.join("frames");
    std::fs::create_dir(&frames).unwrap();
    std::fs::copy(frame(2), frames.join("0.jpg")).unwrap();
    let mut live = Live::start(&["--replay", frames.to_str().unwrap(), "--fps", "20", "--web", "127.0.0.1:0"]);
    live.frame(None, false);
    let limit = |files: u32| {
        let limit = format!("--nofile={files}:4096");
        Command::new("prlimit").args(["--pid", &live.id().to_string(), &limit]).status().is_ok_and(|s| s.success())
    };
    if !limit(3) {
        assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no prlimit, and nothing may be skipped");
        let _ = writeln!(std::io::stderr(), "SKIPPED: no prlimit: sudo apt-get install util-linux");
        return;
    }
    // The page takes no connection meanwhile.
    thread::sleep(Duration::from_secs(2));
    assert!(limit(1024));
    live.wait_for("Too many open files");
    live.wait_for("can be read again");
    live.frame(None, false);
    let told = live.logged.iter().filter(|l| l.contains("cannot replay")).count();
    assert_eq!(told, 1, "{}", live.logged.join("\n"));
    assert_eq!(live.get("/health").status, 200);
    ends_in_time(&mut live);
}

#[test]
fn health_tells_whether_frames_arrive() {
    let folder = Folder::new("health");
    let frames = folder.join("frames");
    std::fs::create_dir(&frames).unwrap();
    std::fs::copy(frame(2), frames.join("0.jpg")).unwrap();
    let arguments = ["--fps", "20", "-m", &model(&folder), "--web", "0.0.0.0:0"];
    let mut live = Live::start(&[&["--replay", frames.to_str().unwrap()], &arguments[..]].concat());
    live.frame(None, false);
    let token = live.token.take();
    let answer = live.get("/health");
    assert_eq!(
        (answer.status, answer.json()),
        (200, serde_json::json!({"alive": true, "camera": true, "models": 1})),
        "no token is needed"
    );
    assert_eq!(live.get("/metrics").status, 401);
    live.token = token;
    assert!(metric(&live, "keygraph_search_seconds_count") >= 1.0 && metric(&live, "keygraph_models") > 0.0);
    let mut viewer = live.connect();
    let bearer = live.token.clone().unwrap();
    write!(viewer, "GET /events HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {bearer}\r\n\r\n").unwrap();
    viewer.read_exact(&mut [0]).unwrap();
    assert!(metric(&live, "keygraph_viewers") >= 1.0);
    std::fs::remove_file(frames.join("0.jpg")).unwrap();
    live.wait_for("trying again");
    let end = Instant::now() + LIMIT;
    // A camera counts as alive for a moment after its last frame.
    let answer = loop {
        let answer = live.get("/health");
        if answer.status == 503 {
            break answer;
        }
        assert!(Instant::now() < end, "a camera without frames is not told");
        thread::sleep(Duration::from_millis(100));
    };
    assert_eq!(answer.json()["camera"], serde_json::json!(false));
    let end = Instant::now() + LIMIT;
    std::fs::copy(frame(2), frames.join("0.jpg")).unwrap();
    while live.get("/health").status != 200 {
        assert!(Instant::now() < end, "frames do not come back");
        thread::sleep(Duration::from_millis(100));
    }
}
