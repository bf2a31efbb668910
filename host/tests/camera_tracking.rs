//! `keygraph camera` from frame to frame: the states of an object that comes and goes.
//!
//! In: frames of the repository in place of a camera. Out: JSON lines, and the bodies that
//! the page gets.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation)]

mod camera_live;
mod program;

use std::io::{BufRead, BufReader, Write};

use camera_live::Live;
use program::{Folder, keygraph, picture};
use serde_json::Value;

/// Makes a small model of the astronaut, and a folder with some frames of the sequence.
fn setup(folder: &Folder, frames: impl Iterator<Item = u32>) -> (String, String) {
    let model = folder.join("astronaut.kgm").to_str().unwrap().to_string();
    keygraph(&["train", picture("astronaut").to_str().unwrap(), "--preset", "compact", "-o", &model]).ended_with(0);
    let replay = folder.join("frames");
    std::fs::create_dir(&replay).unwrap();
    for (i, frame) in frames.enumerate() {
        std::fs::copy(program::frame(frame), replay.join(format!("{i:03}.jpg"))).unwrap();
    }
    (model, replay.to_str().unwrap().to_string())
}

#[test]
fn what_comes_and_goes_is_found_tracked_lost_and_found_with_its_id() {
    let folder = Folder::new("comes-and-goes");
    // Eight frames show the object, six do not. At this rate few frames are dropped, even on
    // a slow machine.
    let (model, replay) = setup(&folder, [2; 8].into_iter().chain([26; 6]));
    let arguments = ["camera", "--replay", &replay, "--fps", "4", "-m", &model, "--json", "--frames", "24"];
    let run = keygraph(&arguments).ended_with(0);
    let mut states: Vec<String> = Vec::new();
    for line in run.lines() {
        let (detections, lost) = (line["detections"].as_array().unwrap(), line["lost"].as_array().unwrap());
        let entry = match (&detections[..], &lost[..]) {
            ([seen], []) => seen,
            ([], [gone]) => gone,
            // A round may begin before the object was seen at all.
            ([], []) if states.is_empty() => continue,
            _ => panic!("one instance, seen or lost: {line}"),
        };
        assert_eq!(entry["id"], 0, "{line}");
        assert_eq!(entry["corners"].as_array().unwrap().len(), 4, "{line}");
        let state = entry["state"].as_str().unwrap();
        assert_eq!(line["state"], if state == "lost" { "searching" } else { "tracking" }, "{line}");
        assert!(state == "tracked" || line["searched"] == true, "found and lost are told by a search: {line}");
        if states.last().is_none_or(|s| s != state) {
            states.push(state.into());
        }
    }
    assert!(states.starts_with(&["found", "tracked", "lost", "found"].map(String::from)), "{states:?}");
    let followed = run.lines().iter().filter(|l| l["searched"] == false).count();
    assert!(followed >= 4, "{followed} of 24 frames were only followed");
    run.said(&["astronaut found", "astronaut lost"]);
}

#[test]
fn poses_are_told_live_through_a_lens() {
    let folder = Folder::new("space");
    let (model, replay) = setup(&folder, [5; 3].into_iter());
    let arguments = ["camera", "--replay", &replay, "--fps", "20", "-m", &model, "--json", "--frames", "6"];
    let camera = [
        "--intrinsics",
        "600,600,319.5,239.5",
        "--distortion",
        "0,0,0,0",
        "--width-mm",
        "other=70",
        "--width-mm",
        "200",
    ];
    let run = keygraph(&[&arguments[..], &camera].concat()).ended_with(0);
    for line in run.lines() {
        let seen = &line["detections"][0];
        let away = seen["pose"]["translation_mm"][2].as_f64().unwrap();
        assert!((away - 276.6).abs() < 3.0, "{seen}");
        assert_eq!(
            (seen["surface"]["bent"].as_bool(), seen["axes"].as_array().unwrap().len()),
            (Some(false), 4),
            "{seen}"
        );
    }
    // An object whose width is not known has no pose. All models of a folder are taken.
    let in_folder = arguments.map(|a| if a == model { folder.0.to_str().unwrap() } else { a });
    let run = keygraph(&[&in_folder[..], &camera[..6]].concat()).ended_with(0);
    assert!(run.lines().iter().all(|line| line["detections"][0]["pose"].is_null()));
    keygraph(&[&arguments[..], &camera[..2]].concat())
        .ended_with(2)
        .said(&["--intrinsics needs --width-mm, or --distortion"]);
}

#[test]
fn frames_are_followed_but_searched_while_corners_are_wanted() {
    let folder = Folder::new("wanted");
    let (model, replay) = setup(&folder, [2].into_iter());
    let live = Live::start(&["--replay", &replay, "--fps", "10", "-m", &model, "--web", "127.0.0.1:0"]);
    let followed = live.frame_with(|f| f.line["searched"] == false);
    assert_eq!(followed.detection("astronaut").unwrap()["state"], "tracked", "{}", followed.line);
    // Some frames pass until a request has its effect.
    let mut number = followed.number;
    let mut with_corners = 0;
    for _ in 0..20 {
        let frame = live.frame(Some(number), true);
        number = frame.number;
        assert!(frame.details == 0 || frame.line["searched"] == true, "corners of a followed frame: {}", frame.line);
        assert!(with_corners == 0 || frame.details > 0, "they are gone again: {}", frame.line);
        assert_eq!(frame.detection("astronaut").unwrap()["id"], 0, "{}", frame.line);
        with_corners += usize::from(frame.details > 0);
    }
    assert!(with_corners > 5, "{with_corners} of 20 frames have corners");

    let mut events = live.connect();
    write!(events, "GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", live.place).unwrap();
    let mut lines = BufReader::new(events).lines().map(Result::unwrap);
    let data = lines.find_map(|l| l.strip_prefix("data: ").map(str::to_string)).unwrap();
    let event: Value = serde_json::from_str(&data).unwrap();
    assert_eq!((&event["detections"][0]["state"], &event["detections"][0]["id"]), (&"tracked".into(), &0.into()));
}
