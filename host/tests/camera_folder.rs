//! `keygraph camera --models DIR` while somebody else changes the files in the folder.
//!
//! In: the sequence of the repository, and models of its pictures. Out: what the log and the lines say.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::fs;
use std::thread;
use std::time::Duration;

use camera_live::Live;
use program::{Folder, assets, keygraph, picture};
use serde_json::Value;

/// Time in which the program looks at the folder twice.
const TWO_LOOKS: Duration = Duration::from_millis(2500);

/// A small model of a picture of the repository, under a name.
fn model(folder: &Folder, name: &str, of: &str) -> Vec<u8> {
    let (from, to) = (picture(of), folder.join("trained.kgm"));
    let (from, to) = (from.to_str().unwrap(), to.to_str().unwrap());
    keygraph(&["train", from, "--preset", "compact", "--name", name, "-o", to]).ended_with(0);
    fs::read(to).unwrap()
}

/// Waits until an object is found.
fn wait_for_object(live: &Live, name: &str) {
    live.frame_with(|frame| frame.detection(name).is_some());
}

#[test]
fn files_that_come_change_and_go_are_noticed_while_frames_go_on() {
    let (folder, frames) = (Folder::new("follow"), assets().join("sequence"));
    let shelf = folder.join("models");
    fs::create_dir(&shelf).unwrap();
    let [astronaut, coffee, cup] = [("astronaut", "astronaut"), ("coffee", "coffee"), ("cup", "coffee")]
        .map(|(name, of)| model(&folder, name, of));
    let at = |name: &str| shelf.join(name);
    fs::write(at("astronaut.kgm"), &astronaut).unwrap();
    fs::write(at("damaged.kgm"), &coffee[..999]).unwrap();
    let arguments = ["--replay", frames.to_str().unwrap(), "--fps", "5", "--json", "--web", "127.0.0.1:0"];
    let mut live = Live::start(&[&arguments[..], &["--models", shelf.to_str().unwrap()]].concat());
    wait_for_object(&live, "astronaut");

    fs::write(at("coffee.kgm"), &coffee).unwrap();
    live.wait_for("model coffee added: ");
    wait_for_object(&live, "coffee");

    // Half of another model in its place.
    fs::write(at("coffee.kgm"), &cup[..cup.len() / 2]).unwrap();
    let told = live.wait_for("left out: ");
    assert!(told.contains("coffee.kgm") && told.contains("the model before stays in use"), "{told}");
    wait_for_object(&live, "coffee");
    fs::write(at("coffee.kgm"), &cup).unwrap();
    live.wait_for("model coffee exchanged: ");
    wait_for_object(&live, "cup");

    fs::remove_file(at("astronaut.kgm")).unwrap();
    live.wait_for("model astronaut removed: ");
    let names = |live: &Live| -> Vec<String> {
        let status = live.get("/status").json();
        let objects = status["models"].as_array().unwrap().iter().map(|m| m["objects"][0]["name"].as_str().unwrap());
        objects.map(str::to_string).collect()
    };
    assert_eq!(names(&live), ["cup"]);

    // What the program writes itself is no change from outside.
    let loaded = live.ask("POST", "/models?name=astronaut", &[], &astronaut);
    assert_eq!((loaded.status, at("astronaut.kgm").exists()), (201, true));
    thread::sleep(TWO_LOOKS);
    assert_eq!(names(&live), ["cup", "astronaut"]);
    fs::write(at("damaged.kgm"), &coffee).unwrap();
    live.wait_for("model damaged added: ");
    // Both are of one picture, and one name is told.
    assert_eq!(names(&live), ["cup", "astronaut", "coffee"]);
    live.frame_with(|frame| frame.line["models"] == 6);

    live.signal("TERM");
    let (status, out, _) = live.end();
    assert!(status.success(), "{status}");
    let told = live.logged.join("\n");
    assert_eq!(told.matches("damaged.kgm").count(), 2, "at the start, and when it is whole:\n{told}");
    let lines: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let merges: Vec<u64> = lines.iter().map(|line| line["models"].as_u64().unwrap()).collect();
    assert!(merges.is_sorted() && merges.last() == Some(&6), "one merge for each change: {merges:?}");
    // A busy machine leaves out some frames, but does not stand still.
    let numbers: Vec<u64> = lines.iter().map(|line| line["frame"].as_u64().unwrap()).collect();
    let gap = numbers.windows(2).map(|pair| pair[1] - pair[0]).max();
    assert!(gap <= Some(10), "{gap:?} frames from one line to the next");
}
