//! `keygraph camera` with a file in place of a camera: lines, page, token, signals.
//!
//! In: the sequence of the repository. Out: what the program prints and answers. Objects
//! are learned in `camera_learn.rs`; the page is tested in `camera_page.rs`.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

use camera_live::{Live, outline, truth};
use keygraph::render::corner_error;
use program::{Folder, assets, frame, is_stamp, keygraph, picture};
use serde_json::Value;

fn sequence() -> String {
    assets().join("sequence").to_str().unwrap().to_string()
}

/// Trains a small model on a picture of the repository.
fn model(folder: &Folder, name: &str) -> String {
    let path = folder.join(&format!("{name}.kgm")).to_str().unwrap().to_string();
    let picture = picture(name);
    keygraph(&["train", picture.to_str().unwrap(), "--preset", "compact", "-o", &path]).ended_with(0);
    path
}

#[test]
fn lines_of_a_replay() {
    let folder = Folder::new("lines");
    let astronaut = model(&folder, "astronaut");
    let run = keygraph(&["camera", "--replay", &sequence(), "-m", &astronaut, "--json", "--frames", "4"]).ended_with(0);
    let lines = run.lines();
    assert_eq!(lines.len(), 4);
    let mut found = 0;
    for line in &lines {
        let frame = line["frame"].as_u64().unwrap();
        for key in ["source", "width", "stages", "time_ms", "fps", "dropped", "age_ms", "lost"] {
            assert!(!line[key].is_null(), "{key} is not in {line}");
        }
        assert!(is_stamp(&line["time"]), "{line}");
        for detection in line["detections"].as_array().unwrap() {
            assert!(["found", "tracked"].contains(&detection["state"].as_str().unwrap()), "{detection}");
            let truth = truth(frame, "astronaut", [512.0, 512.0]).unwrap();
            let error = corner_error(&outline(detection), &truth);
            assert!(error < 0.03, "frame {frame}: the outline is off by {error} of its size");
            found += 1;
        }
    }
    assert!(found > 0, "nothing was found:\n{}", run.out);
    run.said(&["astronaut found"]);
    let quiet = ["camera", "-q", "--replay", &sequence(), "-m", &astronaut, "--json", "--frames", "1"];
    assert_eq!(keygraph(&quiet).ended_with(0).err, "");
}

/// Frames that are mirrored and searched in part, in px of the frames as they come.
#[test]
fn a_region_of_mirrored_frames() {
    let folder = Folder::new("region");
    let (astronaut, replay) = (model(&folder, "astronaut"), folder.join("frames"));
    std::fs::create_dir(&replay).unwrap();
    for frame in [0, 1] {
        let mirrored = image::imageops::flip_horizontal(&program::pixels(&program::frame(frame)));
        mirrored.save(replay.join(format!("{frame}.png"))).unwrap();
    }
    let replay = replay.to_str().unwrap();
    let looking = |roi: &str| {
        let camera = ["camera", "--replay", replay, "-m", &astronaut, "--json", "--frames", "4", "--mirror"];
        keygraph(&[&camera[..], &["--roi", roi]].concat())
    };
    let run = looking("170,50,350,370").ended_with(0);
    let mut found = 0;
    for line in run.lines() {
        assert_eq!(line["roi"], serde_json::json!([170, 50, 350, 370]), "{line}");
        assert_eq!(line["mirror"], true, "{line}");
        for detection in line["detections"].as_array().unwrap() {
            // The tracker may have seen another of the two frames before.
            let seen = outline(detection);
            let error = |frame: u64| {
                let truth = truth(frame, "astronaut", [512.0, 512.0]).unwrap().map(|[x, y]| [639.0 - x, y]);
                corner_error(&seen, &truth)
            };
            let least = error(0).min(error(1));
            assert!(least < 0.03, "the outline is off by {least} of its size: {line}");
            found += 1;
        }
    }
    assert!(found > 0, "nothing was found:\n{}", run.out);
    let run = looking("600,0,100,100").ended_with(2).said(&["--roi 600,0,100,100 leaves", "640x480 px"]);
    assert_eq!(run.out, "");
}

#[test]
fn the_newest_frame_is_searched_and_the_others_are_counted() {
    let folder = Folder::new("newest");
    // The object is in no frame of the sequence: a full search takes longer than reading a
    // frame.
    let chelsea = model(&folder, "chelsea");
    let arguments = ["--fps", "500", "-m", &chelsea, "--json", "--frames", "6"];
    let run = keygraph(&[&["camera", "--replay", &sequence()], &arguments[..]].concat()).ended_with(0);
    let lines = run.lines();
    let of = |line: &Value, key: &str| line[key].as_u64().unwrap();
    for (before, line) in (0_u64..).zip(lines.windows(2)) {
        // All frames before this one were searched or are counted as dropped by now, and no
        // frame was counted as dropped before it arrived: a frame that waits is replaced by
        // each newer one.
        let skipped = of(&line[1], "frame") - (before + 1);
        assert!(of(&line[0], "dropped") <= skipped && skipped <= of(&line[1], "dropped"), "{}\n{}", line[0], line[1]);
    }
    assert!(of(lines.last().unwrap(), "dropped") > 0, "nothing was dropped:\n{}", run.out);
}

#[test]
fn damaged_frames_are_skipped_counted_and_told_of_once() {
    let folder = Folder::new("damaged");
    let astronaut = model(&folder, "astronaut");
    let frames = folder.join("frames");
    std::fs::create_dir(&frames).unwrap();
    let whole = std::fs::read(program::frame(2)).unwrap();
    std::fs::write(frames.join("0.jpg"), &whole).unwrap();
    for bad in ["1.jpg", "2.jpg"] {
        std::fs::write(frames.join(bad), &whole[..200]).unwrap();
    }
    let arguments = ["--fps", "20", "-m", &astronaut, "--json", "--frames", "4", "--profile", "qvga"];
    let run = keygraph(&[&["camera", "--replay", frames.to_str().unwrap()], &arguments[..]].concat()).ended_with(0);
    let lines = run.lines();
    assert!(lines.iter().all(|l| l["detections"][0]["object"] == "astronaut"), "{}", run.out);
    assert!(lines[3]["damaged"].as_u64().unwrap() >= 6, "two of three frames are damaged: {}", lines[3]);
    assert_eq!(run.err.matches("a damaged frame is skipped").count(), 1, "{}", run.err);
}

#[test]
fn standard_input_is_replayed_to_its_end() {
    let folder = Folder::new("stdin");
    let astronaut = model(&folder, "astronaut");
    let motion = [0, 1, 2].map(|i| std::fs::read(frame(i)).unwrap()).concat();
    let arguments = ["camera", "--replay", "-", "-m", &astronaut, "--json", "--profile", "qvga", "--fps", "5"];
    let run = program::run_in(&folder.0, &arguments, &motion).ended_with(0);
    let lines = run.lines();
    // A busy machine may be too slow for a frame in the middle. The last one is never left out.
    let last = lines.last().unwrap();
    assert_eq!((&last["frame"], lines.len() as u64 + last["dropped"].as_u64().unwrap()), (&2.into(), 3), "{}", run.out);
    assert!(lines.iter().all(|l| l["detections"][0]["object"] == "astronaut" && l["source"] == "-"), "{}", run.out);
    program::run_in(&folder.0, &arguments, b"").refused_with(&["standard input", "is empty"]);
}

#[test]
fn options_from_a_file() {
    let folder = Folder::new("options");
    model(&folder, "astronaut");
    let text = format!("model = \"astronaut.kgm\"\nreplay = {:?}\njson = true\nfps = 20\nframes = 1\n", sequence());
    let file = folder.file("k.toml", text.as_bytes()).to_str().unwrap().to_string();
    let camera = ["camera", "--config", &file];
    let run = keygraph(&camera).ended_with(0);
    assert_eq!((run.lines().len(), run.lines()[0]["source"].as_str()), (1, Some(sequence().as_str())), "{}", run.err);
    assert_eq!(keygraph(&[&camera[..], &["--frames", "2"]].concat()).ended_with(0).lines().len(), 2);
    folder.file("k.toml", b"json = true\nthresold = 0.5\n");
    keygraph(&camera)
        .ended_with(2)
        .said(&["k.toml, line 2: there is no option \"thresold\"; did you mean \"threshold\"?"]);
    keygraph(&["camera", "--config", "/no/such.toml"]).refused_with(&["cannot read the options in /no/such.toml"]);

    // A token in the file is not in the list of processes.
    let secret = "a-token-of-the-file";
    let text = format!("replay = {:?}\nweb = \"127.0.0.1:0\"\ntoken = {secret:?}\n", sequence());
    let open = std::fs::Permissions::from_mode(0o644);
    std::fs::set_permissions(folder.file("k.toml", text.as_bytes()), open).unwrap();
    let mut live = Live::start(&["--config", &file]);
    live.wait_for("k.toml, line 3: everybody may read token");
    let line = live.wait_for("the page is at http://");
    live.place = line.split("http://").nth(1).unwrap().split('/').next().unwrap().to_string();
    assert_eq!(live.get("/status").status, 401);
    live.token = Some(secret.to_string());
    assert_eq!(live.get("/status").status, 200);
    let processes = std::fs::read(format!("/proc/{}/cmdline", live.id())).unwrap();
    assert!(!String::from_utf8_lossy(&processes).contains(secret));
}

#[test]
fn every_request_is_documented() {
    let text = std::fs::read_to_string(assets().join("../docs/camera.md")).unwrap();
    let routes = include_str!("../src/camera/web.rs").split(".route(\"").skip(1);
    let routes: Vec<_> = routes.map(|rest| rest.split('"').next().unwrap().replace("{id}", "ID")).collect();
    assert!(routes.len() > 8, "{routes:?}");
    for route in routes {
        assert!(text.contains(&format!(" {route}`")) || text.contains(&format!(" {route}?")), "{route}");
    }
}

#[test]
fn what_cannot_be_is_refused() {
    keygraph(&["camera", "--replay", &sequence()]).refused_with(&["give a model with -m", "--web"]);
    keygraph(&["camera", "--replay", "/no/such", "--web", "127.0.0.1:0"])
        .refused_with(&["cannot replay /no/such", "no such file"]);
    keygraph(&["camera", "--replay", "x", "-m", "/no/such.kgm"]).refused_with(&["cannot read the model /no/such.kgm"]);
    keygraph(&["camera", "--replay", &sequence(), "--web", "--mqtt", "broker"]).refused_with(&["mqtt://"]);
    let folder = Folder::new("nothing");
    keygraph(&["camera", "--replay", &sequence(), "--models", folder.join("none").to_str().unwrap()])
        .refused_with(&["nothing to look for"]);
    let file = folder.file("file", b"");
    keygraph(&["camera", "--replay", &sequence(), "--models", file.to_str().unwrap()])
        .refused_with(&["cannot make the folder"]);
    keygraph(&["camera", "--token", "x"]).ended_with(2).said(&["--web"]);
    keygraph(&["camera", "--size", "big"]).ended_with(2).said(&["640x480"]);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    keygraph(&["camera", "--replay", &sequence(), "--web", &address])
        .refused_with(&["give another address with --web"]);
    if cfg!(not(feature = "camera")) {
        keygraph(&["camera", "--list"]).refused_with(&["libclang-dev", "--features keygraph/camera", "--replay"]);
        keygraph(&["camera", "--web", "127.0.0.1:0"]).refused_with(&["built without cameras"]);
    }
}

#[test]
fn the_page_shows_what_is_found_to_several_viewers() {
    let folder = Folder::new("viewers");
    let astronaut = model(&folder, "astronaut");
    let live = Live::start(&["--replay", &sequence(), "--fps", "10", "-m", &astronaut, "--web", "127.0.0.1:0"]);
    let page = live.get("/");
    assert_eq!(page.status, 200);
    assert!(page.head.contains("content-security-policy"), "{}", page.head);
    assert!(!page.head.contains("unsafe-inline"), "{}", page.head);
    assert!(page.text().contains("<canvas"));
    for file in page.text().split(['"', '\'']).filter(|f| f.ends_with(".js") || f.ends_with(".css")) {
        let part = live.get(&format!("/{file}"));
        let kind = if file.ends_with(".js") { "text/javascript" } else { "text/css" };
        assert!(part.status == 200 && part.head.contains(kind) && !part.body.is_empty(), "{file}: {}", part.head);
    }

    // A viewer that asks for more frames than all buffers hold, and reads none, delays
    // nobody.
    let mut sleeper = live.connect();
    let request = format!("GET /frame HTTP/1.1\r\nHost: {}\r\n\r\n", live.place);
    sleeper.write_all(request.repeat(1000).as_bytes()).unwrap();
    let mut asleep = live.connect();
    write!(asleep, "GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", live.place).unwrap();
    std::thread::scope(|scope| {
        for details in [false, true] {
            let live = &live;
            scope.spawn(move || {
                let mut after = None;
                for _ in 0..4 {
                    let frame = live.frame(after, details);
                    assert_ne!(Some(frame.number), after);
                    let image = image::load_from_memory(&frame.jpeg).unwrap();
                    assert_eq!((image.width(), image.height()), (640, 480));
                    assert!(details || frame.details == 0, "{}", frame.header);
                    after = Some(frame.number);
                }
            });
        }
    });
    let frame = live.frame_with(|f| f.detection("astronaut").is_some());
    let truth = truth(frame.number, "astronaut", [512.0, 512.0]).expect("it is in this frame");
    let error = corner_error(&outline(frame.detection("astronaut").unwrap()), &truth);
    assert!(error < 0.03, "the outline is off by {error} of its size");

    let mut events = live.connect();
    write!(events, "GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", live.place).unwrap();
    let mut lines = BufReader::new(events).lines().map(Result::unwrap);
    let data = lines.find_map(|l| l.strip_prefix("data: ").map(str::to_string)).unwrap();
    assert!(serde_json::from_str::<Value>(&data).unwrap()["detections"].is_array(), "{data}");
}

#[test]
fn corners_and_triangles_come_when_asked_for() {
    let folder = Folder::new("details");
    let astronaut = model(&folder, "astronaut");
    let live = Live::start(&["--replay", &sequence(), "-m", &astronaut, "--web", "127.0.0.1:0"]);
    let mut frame = live.frame(None, true);
    for _ in 0..50 {
        let of = |key: &str| frame.header[key].as_u64().unwrap() as usize;
        assert!(frame.details == 0 || frame.details == 4 * of("corners") + 12 * (of("keygraphs") + of("votes")));
        if of("corners") > 50 && of("keygraphs") > 50 && of("votes") > 2 {
            return;
        }
        frame = live.frame(Some(frame.number), true);
    }
    panic!("no corners, triangles or votes: {}", frame.header);
}

#[test]
fn other_addresses_need_a_token_and_other_pages_change_nothing() {
    let mut live = Live::start(&["--replay", &sequence(), "--web", "0.0.0.0:0"]);
    let token = live.token.clone().expect("a token was printed");
    assert!(token.len() >= 32, "{token}");
    assert_eq!(live.get("/status").status, 200);
    live.token = None;
    let missing = live.get("/status");
    assert!(missing.status == 401 && missing.text().contains("a token is needed"), "{}", missing.text());
    let wrong = live.get("/status?token=wrong");
    assert!(wrong.status == 401 && wrong.text().contains("the token is wrong"), "{}", wrong.text());
    assert_eq!(live.get(&format!("/status?token={token}")).status, 200);
    live.token = Some("wrong".into());
    assert_eq!(live.get("/frame").status, 401);
    live.token = Some(token);
    let from = |origin: &str| live.ask("PUT", "/threshold?value=0.6", &[("Origin", origin)], b"").status;
    assert_eq!(from("http://evil.example"), 403);
    assert_eq!(from(&format!("http://{}", live.place)), 204);

    let local = Live::start(&["--replay", &sequence(), "--web", "127.0.0.1:0"]);
    assert!(local.token.is_none());
    assert_eq!(local.ask("GET", "/status", &[("Host", "evil.example")], b"").status, 403, "a name that points here");
    assert_eq!(local.get("/status").status, 200);
}

#[test]
fn signals_end_it_cleanly() {
    let folder = Folder::new("signals");
    let astronaut = model(&folder, "astronaut");
    for signal in ["INT", "TERM"] {
        let mut live = Live::start(&["--replay", &sequence(), "-m", &astronaut, "--json", "--web", "127.0.0.1:0"]);
        live.frame(None, false);
        // A viewer that waits for an event stream must not delay the end.
        let mut events = live.connect();
        write!(events, "GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", live.place).unwrap();
        events.read_exact(&mut [0]).unwrap();
        live.signal(signal);
        let (status, out, time) = live.end();
        assert!(status.success(), "{signal}: {status}");
        assert!(time < Duration::from_secs(20), "{signal}: ended after {time:?}");
        assert!(out.lines().all(|l| serde_json::from_str::<Value>(l).is_ok()), "a line was cut:\n{out}");
    }
}
