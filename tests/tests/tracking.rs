//! Tests tracking on rendered sequences with known poses. An object must stay at its place, be
//! reported lost when it is gone, and be found again when it comes back.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::sync::LazyLock;

use keygraph::input::Picture;
use keygraph::learn::{Preset, train};
use keygraph::render::{RIGHT, corner_error};
use keygraph::report::frame_line;
use keygraph::search::{Follower, Found, Profile, Request, follow, search};
use keygraph_core::{DEFAULT_THRESHOLD, Model, State};
use keygraph_tests::motion::{Motion, Sequence, Shot, astronaut};

static PICTURE: LazyLock<Picture> = LazyLock::new(astronaut);
static MODEL: LazyLock<Vec<u8>> = LazyLock::new(|| train(&PICTURE, "astronaut", Preset::Compact, false).unwrap().0);

/// Tracks frames of a sequence with a new tracker, and returns each frame with its result. Each
/// test has a detector of its own in `slot`.
fn run(motion: Motion, noise: f32, frames: impl Iterator<Item = usize>, slot: usize) -> Vec<(Shot, Found)> {
    run_as(&Request::new(Profile::Vga, DEFAULT_THRESHOLD), motion, noise, frames, slot)
}

fn run_as(
    request: &Request,
    motion: Motion,
    noise: f32,
    frames: impl Iterator<Item = usize>,
    slot: usize,
) -> Vec<(Shot, Found)> {
    let sequence = Sequence::new(&PICTURE, motion, noise, 7);
    let model = Model::parse(&MODEL).unwrap();
    let mut follower = Follower::default();
    let look = |i| {
        let shot = sequence.shot(i);
        let found = follow(&shot.picture, &model, request, slot, &mut follower).unwrap();
        (shot, found)
    };
    frames.map(look).collect()
}

fn is_right(shot: &Shot, found: &Found) -> bool {
    found.detections.len() == shot.copies.len()
        && shot.copies.iter().all(|(t, _)| found.detections.iter().any(|d| corner_error(&d.corners, t) < RIGHT))
}

fn searched(found: &Found) -> bool {
    found.tracking.as_ref().unwrap().searched
}

#[test]
fn corners_of_what_stands_still_jitter_by_less_than_a_third_of_a_pixel() {
    let frames = run(Motion::Still, 8.0, 0..20, 0);
    assert_eq!(frames.iter().filter(|(_, f)| searched(f)).count(), 1, "the first frame");
    let n = frames.len() as f32;
    for c in 0..4 {
        for k in 0..2 {
            let values: Vec<f32> = frames.iter().map(|(_, f)| f.detections[0].corners[c][k]).collect();
            let mean = values.iter().sum::<f32>() / n;
            let spread = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / n).sqrt();
            assert!(spread < 0.3, "corner {c}: {spread} px");
        }
    }
}

/// The mean second difference of the corners from frame to frame, minus that of the truth, px.
fn jitter(frames: &[(Shot, Found)]) -> f32 {
    let off = |(shot, found): &(Shot, Found)| -> [[f32; 2]; 4] {
        let (corners, truth) = (found.detections[0].corners, shot.copies[0].0);
        std::array::from_fn(|c| [0, 1].map(|k| corners[c][k] - truth[c][k]))
    };
    let off: Vec<_> = frames.iter().map(off).collect();
    let bend = |w: &[[[f32; 2]; 4]], c: usize| {
        let at = |k: usize| w[0][c][k] - 2.0 * w[1][c][k] + w[2][c][k];
        at(0).hypot(at(1))
    };
    let bends: Vec<f32> = off.windows(3).flat_map(|w| (0..4).map(|c| bend(w, c)).collect::<Vec<_>>()).collect();
    bends.iter().sum::<f32>() / bends.len() as f32
}

#[test]
fn smoothed_outlines_stand_still_and_do_not_stay_behind() {
    let plain = Request::new(Profile::Vga, DEFAULT_THRESHOLD);
    let smooth = Request { smooth: 8, ..plain };
    let [before, after] = [plain, smooth].map(|request| run_as(&request, Motion::Still, 8.0, 0..24, 7));
    let [a, b] = [&before, &after].map(|frames| jitter(&frames[4..]));
    assert!(b < 0.3 * a, "jitter {b} px, {a} without");
    for ((_, a), (_, b)) in before.iter().zip(&after) {
        assert_eq!(searched(a), searched(b), "what is searched does not change");
        assert_eq!(a.detections[0].score, b.detections[0].score);
    }
    for (shot, found) in run_as(&smooth, Motion::Fast, 5.0, 0..40, 7) {
        let (d, truth) = (&found.detections[0], &shot.copies[0].0);
        let far = d.corners.iter().zip(truth).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).sum::<f32>() / 4.0;
        assert!(far < 1.0, "{far} px behind");
        let shown = d.homography.outline(PICTURE.width as f32, PICTURE.height as f32);
        assert!(corner_error(&shown, &d.corners) < 1e-3, "the map and the corners differ");
    }
}

#[test]
fn a_thousand_frames_do_not_drift() {
    // The noise repeats after 20 frames.
    let sequence = Sequence::new(&PICTURE, Motion::Still, 8.0, 7);
    let shots: Vec<Shot> = (0..20).map(|i| sequence.shot(i)).collect();
    let model = Model::parse(&MODEL).unwrap();
    let mut follower = Follower::default();
    let request = Request::new(Profile::Qvga, DEFAULT_THRESHOLD);
    // Returns the mean offset of the corners from the truth over 100 frames.
    let hundred = |start: usize, follower: &mut Follower| {
        let mut sum = [[0.0; 2]; 4];
        for i in start..start + 100 {
            let shot = &shots[i % 20];
            let found = follow(&shot.picture, &model, &request, 4, follower).unwrap();
            assert!(is_right(shot, &found), "frame {i}: {:?} for {:?}", found.detections, shot.copies);
            let (corners, truth) = (found.detections[0].corners, shot.copies[0].0);
            for (c, k) in (0..8).map(|v| (v / 2, v % 2)) {
                sum[c][k] += (corners[c][k] - truth[c][k]) / 100.0;
            }
        }
        sum
    };
    let first = hundred(0, &mut follower);
    for start in (100..900).step_by(100) {
        let _ = hundred(start, &mut follower);
    }
    let last = hundred(900, &mut follower);
    for (a, b) in first.as_flattened().iter().zip(last.as_flattened()) {
        assert!((a - b).abs() < 0.02, "corners of the last hundred frames {last:?}, of the first {first:?}");
    }
}

#[test]
fn what_is_hidden_in_part_is_found_as_by_searching_and_what_is_not_seen_is_lost() {
    let model = Model::parse(&MODEL).unwrap();
    let (mut tracked, mut searched) = ([0, 0], [0, 0]);
    for (i, (shot, found)) in run(Motion::Hidden, 5.0, (0..120).step_by(4), 5).iter().enumerate() {
        let untracked = search(&shot.picture, &model, Profile::Vga, DEFAULT_THRESHOLD, false, 6).unwrap();
        for (found, [right, wrong]) in [(found, &mut tracked), (&untracked, &mut searched)] {
            let ok = usize::from(found.detections.iter().any(|d| corner_error(&d.corners, &shot.copies[0].0) < RIGHT));
            *right += ok;
            *wrong += found.detections.len() - ok;
        }
        let tracking = found.tracking.as_ref().unwrap();
        let ids: Vec<u32> = tracking.seen.iter().map(|s| s.0).chain(tracking.lost.iter().map(|t| t.id)).collect();
        assert_eq!(ids, [0], "frame {i}: one instance, seen or lost");
        assert!(shot.copies[0].1 > 0.0 || found.detections.is_empty(), "frame {i}: nothing of it is seen");
    }
    let ([found, wrong], [untracked, untracked_wrong]) = (tracked, searched);
    assert!(found >= untracked, "tracked {found} of 30, searched {untracked}");
    assert!(wrong <= untracked_wrong, "wrong: tracked {wrong}, searched {untracked_wrong}");
}

#[test]
fn what_moves_fast_is_followed() {
    let frames = run(Motion::Fast, 5.0, 0..24, 1);
    for (i, (shot, found)) in frames.iter().enumerate() {
        assert!(is_right(shot, found), "frame {i}: {:?} for {:?}", found.detections, shot.copies);
        assert_eq!(found.tracking.as_ref().unwrap().seen[0].0, 0, "frame {i}: the id");
    }
    let searches = frames.iter().filter(|(_, f)| searched(f)).count();
    assert!(searches <= 6, "{searches} of 24 frames were searched");
}

#[test]
fn what_leaves_is_lost_and_comes_back_with_its_id() {
    // The object is whole until frame 35, gone by frame 59, and whole again from frame 93 on.
    let frames = run(Motion::Leaving, 5.0, (20..30).chain(59..63).chain(93..97), 2);
    let model = Model::parse(&MODEL).unwrap();
    for (i, (shot, found)) in frames.iter().enumerate() {
        let line = frame_line("", 0, (640, 480), &model, found, None);
        if (10..14).contains(&i) {
            assert!(found.detections.is_empty(), "frame {i}: {:?}", found.detections);
            assert_eq!((&line["state"], &line["searched"]), (&"searching".into(), &true.into()), "frame {i}");
            assert_eq!((&line["lost"][0]["state"], &line["lost"][0]["id"]), (&"lost".into(), &0.into()), "frame {i}");
            continue;
        }
        assert!(is_right(shot, found), "frame {i}: {:?} for {:?}", found.detections, shot.copies);
        let state = if [0, 14].contains(&i) { "found" } else { "tracked" };
        let entry = &line["detections"][0];
        assert_eq!((&entry["state"], &entry["id"]), (&state.into(), &0.into()), "frame {i}");
        assert_eq!(line["lost"].as_array().unwrap().len(), 0, "frame {i}");
    }
}

#[test]
fn two_copies_are_two_instances() {
    let frames = run(Motion::Copies, 5.0, 0..12, 3);
    for (i, (shot, found)) in frames.iter().enumerate() {
        assert!(is_right(shot, found), "frame {i}: {:?} for {:?}", found.detections, shot.copies);
        let tracking = found.tracking.as_ref().unwrap();
        let mut ids: Vec<u32> = tracking.seen.iter().map(|s| s.0).collect();
        ids.sort_unstable();
        assert_eq!(ids, [0, 1], "frame {i}");
        assert!(i == 0 || tracking.seen.iter().all(|s| s.1 == State::Tracked), "frame {i}: {tracking:?}");
    }
}
