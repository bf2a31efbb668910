//! Objects learned by `keygraph camera` and by `keygraph train --from-camera`, over HTTP,
//! and the files of their models.
//!
//! In: a frame of the sequence in place of a camera, and the true outline in it. Out:
//! whether the learned object is found there, also after a restart.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use camera_live::{Live, outline, truth};
use keygraph::render::corner_error;
use keygraph_core::MAGIC;
use program::{Folder, frame, keygraph, picture};
use serde_json::json;

/// The true outline in the frame of [`held_up`].
fn shown() -> [[f32; 2]; 4] {
    truth(2, "astronaut", [512.0, 512.0]).unwrap()
}

fn corners() -> String {
    shown().as_flattened().iter().map(|v| format!("{v:.1}")).collect::<Vec<_>>().join(",")
}

/// Makes a folder with one frame: an object that does not move.
fn held_up(folder: &Folder) -> String {
    let frames = folder.join("frames");
    std::fs::create_dir_all(&frames).unwrap();
    std::fs::copy(frame(2), frames.join("0.jpg")).unwrap();
    frames.to_str().unwrap().to_string()
}

#[test]
fn an_object_is_learned_from_a_frame_and_removed_again() {
    let folder = Folder::new("learning");
    let live = Live::start(&["--replay", &held_up(&folder), "--fps", "10", "--web", "127.0.0.1:0"]);
    let frame = live.frame(None, false);
    assert_eq!(frame.line["detections"], json!([]));
    let path = format!("/learn?name=me%20%26%20you&corners={}", corners());

    let refused = live.ask("POST", "/learn?name=x&corners=1,2,3", &[], &frame.jpeg);
    assert!(refused.status == 400 && refused.text().contains("eight numbers"), "{}", refused.text());
    let refused = live.ask("POST", &path, &[], b"no picture");
    assert!(refused.status == 400 && refused.text().contains("no picture that can be learned"), "{}", refused.text());

    let learned = live.ask("POST", &path, &[], &frame.jpeg);
    assert_eq!(learned.status, 201, "{}", learned.text());
    assert!(learned.json()["found"].as_f64().is_some_and(|s| s > 0.9), "{}", learned.text());
    let seen = live.frame_with(|f| f.detection("me & you").is_some());
    let error = corner_error(&outline(seen.detection("me & you").unwrap()), &shown());
    assert!(error < 0.03, "the outline is off by {error} of its size");

    let models = live.get("/status").json()["models"].clone();
    assert_eq!(models[0]["objects"][0]["name"], "me & you");
    let saved = live.get(&format!("/models/{}", models[0]["id"]));
    assert!(saved.body.starts_with(&MAGIC));
    assert_eq!(live.ask("DELETE", &format!("/models/{}", models[0]["id"]), &[], b"").status, 204);
    live.frame_with(|f| f.line["detections"] == json!([]));
    assert_eq!(live.ask("POST", "/models?name=again", &[], &saved.body).status, 201);
    live.frame_with(|f| f.detection("me & you").is_some());
    let damaged = live.ask("POST", "/models?name=bad", &[], &saved.body[..saved.body.len() / 2]);
    assert_eq!(damaged.status, 400, "{}", damaged.text());

    assert_eq!(live.ask("PUT", "/threshold?value=0.9", &[], b"").status, 204);
    live.frame_with(|f| f.line["threshold"] == 0.9);
    assert_eq!(live.ask("PUT", "/threshold?value=7", &[], b"").status, 400);
}

#[test]
fn an_object_is_learned_from_a_picture_of_it() {
    let folder = Folder::new("from-picture");
    let live = Live::start(&["--replay", &held_up(&folder), "--fps", "10", "--web", "127.0.0.1:0"]);
    let learn = |query: &str, bytes: &[u8]| live.ask("POST", &format!("/learn?{query}"), &[], bytes);
    let jpeg = std::fs::read(picture("astronaut")).unwrap();
    let refused = learn("name=x", &jpeg);
    assert!(refused.status == 400 && refused.text().contains("from=picture"), "{}", refused.text());
    assert_eq!(learn("name=x&from=afar", &jpeg).status, 400);
    let mut plain = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(300, 200).write_to(&mut plain, image::ImageFormat::Png).unwrap();
    let refused = learn("name=x&from=picture", plain.get_ref());
    assert!(refused.status == 400 && refused.text().contains("too little to hold on to"), "{}", refused.text());
    let refused = learn("name=x&from=picture", &jpeg[..jpeg.len() / 2]);
    assert!(refused.status == 400 && refused.text().contains("cut off"), "{}", refused.text());
    // ffmpeg reads AVIF for the command line, and nothing for the page.
    let refused = learn("name=x&from=picture", b"\0\0\0\x1cftypavif\0\0\0\0avifmif1miaf");
    assert!(refused.status == 400 && refused.text().contains("send a PNG, JPEG, WebP"), "{}", refused.text());

    let learned = learn("name=whole&from=picture", &jpeg);
    assert_eq!((learned.status, &learned.json()["warning"]), (201, &json!(null)), "{}", learned.text());
    let seen = live.frame_with(|f| f.detection("whole").is_some());
    let error = corner_error(&outline(seen.detection("whole").unwrap()), &shown());
    assert!(error < 0.03, "the outline is off by {error} of its size");
    assert_eq!(live.ask("DELETE", "/models/1", &[], b"").status, 204);

    // The same picture within clear surroundings, which do not belong to the object.
    let (astronaut, mut clear) = (image::open(picture("astronaut")).unwrap(), image::RgbaImage::new(700, 600));
    image::imageops::overlay(&mut clear, &astronaut, 120, 40);
    let mut png = std::io::Cursor::new(Vec::new());
    clear.write_to(&mut png, image::ImageFormat::Png).unwrap();
    assert_eq!(learn("name=clear&from=picture", png.get_ref()).status, 201);
    let seen = live.frame_with(|f| f.detection("clear").is_some());
    let error = corner_error(&outline(seen.detection("clear").unwrap()), &shown());
    assert!(error < 0.03, "the outline is off by {error} of its size");
    assert_eq!(live.ask("DELETE", "/models/2", &[], b"").status, 204);

    // A part of a photograph: the frame itself.
    let photograph = std::fs::read(frame(2)).unwrap();
    let learned = learn(&format!("name=part&from=picture&corners={}", corners()), &photograph);
    assert_eq!(learned.status, 201, "{}", learned.text());
    live.frame_with(|f| f.detection("part").is_some());
}

#[test]
fn what_is_learned_is_kept_until_it_is_removed() {
    let folder = Folder::new("kept");
    let (frames, models) = (held_up(&folder), folder.join("models"));
    std::fs::create_dir(&models).unwrap();
    std::fs::write(models.join("damaged.kgm"), b"no model").unwrap();
    let arguments = ["--replay", &frames, "--fps", "10", "--models", models.to_str().unwrap(), "--web", "127.0.0.1:0"];

    let mut live = Live::start(&arguments);
    assert!(live.logged.iter().any(|l| l.contains("left out") && l.contains("damaged.kgm")), "{:?}", live.logged);
    let seen = live.frame(None, false);
    let learned = live.ask("POST", &format!("/learn?name=visitor&corners={}", corners()), &[], &seen.jpeg);
    assert_eq!((learned.status, &learned.json()["file"]), (201, &json!("visitor.kgm")), "{}", learned.text());
    let saved = std::fs::read(models.join("visitor.kgm")).unwrap();
    assert_eq!(live.get("/models/1").body, saved);
    // An object with the name of another one gets its own file.
    let again = live.ask("POST", "/models?name=visitor", &[], &saved);
    assert_eq!(again.json()["file"], "visitor-2.kgm");
    assert_eq!(live.ask("DELETE", &format!("/models/{}", again.json()["id"]), &[], b"").status, 204);
    assert!(!models.join("visitor-2.kgm").exists(), "the file of a model that was removed is there");
    live.signal("TERM");
    assert!(live.end().0.success());

    let live = Live::start(&arguments);
    let seen = live.frame_with(|f| f.detection("visitor").is_some());
    let error = corner_error(&outline(seen.detection("visitor").unwrap()), &shown());
    assert!(error < 0.03, "the outline is off by {error} of its size");
    let listed = live.get("/status").json()["models"].clone();
    assert_eq!((listed.as_array().unwrap().len(), &listed[0]["file"]), (1, &json!("visitor.kgm")));
    // When a file cannot be removed, its model stays: no removed model returns at the next
    // start.
    std::fs::remove_file(models.join("visitor.kgm")).unwrap();
    std::fs::create_dir_all(models.join("visitor.kgm/full")).unwrap();
    let path = format!("/models/{}", listed[0]["id"]);
    let refused = live.ask("DELETE", &path, &[], b"");
    assert!(refused.status == 400 && refused.text().contains("cannot remove"), "{}", refused.text());
    std::fs::remove_dir_all(models.join("visitor.kgm")).unwrap();
    assert_eq!(live.ask("DELETE", &path, &[], b"").status, 204);
    live.frame_with(|f| f.line["detections"] == json!([]));
}

#[test]
fn train_from_camera_with_an_outline() {
    let folder = Folder::new("outline");
    let (frames, output) = (held_up(&folder), folder.join("visitor.kgm"));
    let from = ["train", "--from-camera", "--replay", &frames, "--fps", "10", "-o", output.to_str().unwrap()];
    let run = keygraph(&[&from[..], &["--outline", &corners(), "--countdown", "1", "--preset", "compact"]].concat())
        .ended_with(0)
        .said(&["hold the object up: the picture is taken in 1 s"]);
    assert!(run.out.contains("the picture of visitor, ") && run.out.contains("keygraphs"), "{}", run.out);
    let found = keygraph(&["detect", "-m", output.to_str().unwrap(), "--json", frame(2).to_str().unwrap()]);
    let line = &found.ended_with(0).lines()[0];
    assert_eq!(line["detections"][0]["object"], "visitor", "{line}");
    let error = corner_error(&outline(&line["detections"][0]), &shown());
    assert!(error < 0.03, "the outline is off by {error} of its size");

    let refused = |outline: &str, words: &[&str]| {
        keygraph(&[&from[..], &["--outline", outline, "--countdown", "0"]].concat()).refused_with(words);
    };
    refused("10,10,20,10,20,20,10,20", &["closer to the camera"]);
    refused("10,10,2000,10,2000,200,10,200", &["leaves the picture"]);
}

#[test]
fn train_from_camera_with_the_page() {
    let folder = Folder::new("page");
    let (frames, output) = (held_up(&folder), folder.join("visitor.kgm"));
    let arguments = ["--replay", &frames, "--fps", "10", "-o", output.to_str().unwrap(), "--preset", "compact"];
    let train = || Live::run("train", &[&["--from-camera", "--web", "127.0.0.1:0", "--json"], &arguments[..]].concat());

    let mut live = train();
    assert_eq!(live.get("/status").json()["errand"]["name"], "visitor");
    let seen = live.frame(None, false);
    let refused = live.ask("POST", "/learn?name=x&corners=1,1,9,1,9,9,1,9", &[], &seen.jpeg);
    assert_eq!(refused.status, 400, "what cannot be learned ends nothing: {}", refused.text());
    let learned = live.ask("POST", &format!("/learn?name=me&corners={}", corners()), &[], &seen.jpeg);
    assert_eq!(learned.status, 201, "{}", learned.text());
    assert!(learned.json()["found"].as_f64().is_some_and(|s| s > 0.9), "{}", learned.text());
    let (status, out, _) = live.end();
    assert!(status.success(), "{status}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    let bytes = std::fs::read(&output).unwrap();
    assert_eq!((report["bytes"].as_u64().unwrap() as usize, bytes.len() <= 512 << 10), (bytes.len(), true));
    let inspected = keygraph(&["inspect", output.to_str().unwrap()]).ended_with(0);
    assert!(inspected.out.contains("object     me, "), "{}", inspected.out);

    std::fs::remove_file(&output).unwrap();
    let mut live = train();
    live.signal("INT");
    live.wait_for("ended before an object was learned");
    assert_eq!(live.end().0.code(), Some(1));
    assert!(!output.exists());
}

#[test]
fn what_train_cannot_do_from_a_camera_is_refused() {
    let usage = |arguments: &[&str], word: &str| {
        keygraph(&[&["train", "-o", "m.kgm"], arguments].concat()).ended_with(2).said(&[word]);
    };
    let astronaut = picture("astronaut");
    let astronaut = astronaut.to_str().unwrap();
    usage(&[], "PICTURE");
    usage(&[astronaut, "--replay", "clip.mp4"], "--from-camera");
    usage(&[astronaut, "--from-camera"], "--from-camera");
    usage(&["--from-camera", "--crop", "1,1,50,50"], "--crop");
    usage(&["--from-camera", "--outline", "1,2,3"], "eight numbers");
    usage(&["--from-camera", "--countdown", "5"], "--outline");
    keygraph(&["train", "--from-camera", "--replay", "/no/such", "-o", "m.kgm", "--web", "127.0.0.1:0"])
        .refused_with(&["cannot replay /no/such"]);
    keygraph(&["train", "--from-camera", "--replay", "/no/such", "-o", "/no/folder/m.kgm"])
        .refused_with(&["the folder /no/folder does not exist"]);
}
