//! `keygraph bench` as a program: times, memory, and one digest.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation)]

mod program;

use program::{Folder, assets, keygraph, picture, run_in};
use serde_json::Value;

/// Runs `bench` with the compact model of the astronaut on some frames of the sequence.
fn bench(folder: &Folder, more: &[&str]) -> Value {
    let model = folder.join("astronaut.kgm");
    if !model.exists() {
        let train =
            ["train".into(), picture("astronaut"), "-o".into(), model.clone(), "--preset".into(), "compact".into()];
        run_in(&folder.0, &train, b"").ended_with(0);
    }
    let mut arguments = vec!["bench".into(), "-m".into(), model, assets().join("sequence"), "--json".into()];
    arguments.extend(["--passes", "2", "--frames", "3"].iter().chain(more).map(Into::into));
    serde_json::from_str(&run_in(&folder.0, &arguments, b"").ended_with(0).out).unwrap()
}

#[test]
fn times_memory_and_a_digest_are_told() {
    let folder = Folder::new("bench");
    let b = bench(&folder, &["--profile", "qvga", "--track"]);
    assert_eq!((b["frames"].as_u64(), b["passes"].as_u64()), (Some(3), Some(2)));
    assert!(b["detections"].as_u64() >= Some(2), "{b}");
    let ms = |v: &Value| v["median_ms"].as_f64().unwrap();
    let stages = b["stages"].as_object().unwrap();
    assert_eq!(stages.len(), 11);
    let sum: f64 = stages.values().map(ms).sum();
    assert!(sum > 0.0 && sum <= 1.5 * ms(&b["total"]), "the stages are part of the whole: {b}");
    for stage in ["convert", "pyramid", "corners"] {
        assert!(
            stages[stage]["bytes_moved"].as_u64() > Some(0) && stages[stage]["copy_ms"].as_f64() > Some(0.0),
            "{b}"
        );
    }
    let buffers = b["buffers"].as_array().unwrap();
    assert_eq!(buffers.len(), 12);
    for buffer in buffers {
        let n = |key: &str| buffer[key].as_u64().unwrap();
        assert!(0 < n("high_water") && n("high_water") <= n("capacity") && n("capacity") <= n("bytes"), "{buffer}");
    }
    let bytes: u64 = buffers.iter().map(|b| b["bytes"].as_u64().unwrap()).sum();
    let detector = b["detector_bytes"].as_u64().unwrap();
    assert!(bytes <= detector && detector - bytes < 16 << 10, "{bytes} of {detector} are buffers");
    assert!(b["tracking"]["followed"].as_u64() >= Some(1), "{b}");
    let mut each: Vec<f64> = b["each_ms"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    each.sort_by(f64::total_cmp);
    assert_eq!((each.len(), each[1]), (3, ms(&b["total"])), "{b}");
}

#[test]
fn the_digest_stands_for_what_was_found() {
    let folder = Folder::new("bench-digest");
    let of = |more: &[&str]| bench(&folder, more)["digest"].as_str().unwrap().to_string();
    let one = of(&["--profile", "qvga"]);
    assert_eq!(one, of(&["--profile", "qvga"]), "each run gives the same");
    assert_eq!(one, of(&["--profile", "qvga", "--threads", "2"]), "and so do several threads");
    assert_ne!(one, of(&["--profile", "qqvga"]), "other frames give another");
}

#[test]
fn it_says_what_it_lacks() {
    let folder = Folder::new("bench-elsewhere");
    run_in(&folder.0, &["bench"], b"").refused_with(&["assets/sequence", "--assets"]);
    keygraph(&["bench", "frame.png"]).ended_with(2);
    keygraph(&["bench", "--passes", "0"]).ended_with(2);
}
