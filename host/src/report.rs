//! Results as JSON: the lines and objects that other programs read.
//!
//! In: results of a command. Out: JSON values. Every number has the digits that mean something, and is rounded
//! here alone: the command line, the bindings and the boards print equal lines. Memory and cost: the text.

use std::time::SystemTime;

use keygraph_core::stages::surface::SIDE;
use keygraph_core::{Cylinder, Detection, Homography, Model, PlanePose, Pose, Stage, State, Track};
use serde_json::{Map, Value, json};

use crate::alike::Alike;
use crate::assess::Assessment;
use crate::bench::{Bench, Held, StageCost, Times};
#[cfg(feature = "calibrate")]
use crate::calibrate::Calibrated;
use crate::clock::stamp;
use crate::pose::Place;
use crate::search::Found;
use crate::structure::Structure;
use crate::sweep::{Cell, Row, Sweep};

/// A number rounded to `digits` decimals.
pub(crate) fn rounded(v: impl Into<f64>, digits: i32) -> Value {
    let k = 10f64.powi(digits);
    // Adding 0 turns -0 into 0.
    json!((v.into() * k).round() / k + 0.0)
}

/// A length or a place in px.
pub(crate) fn px(v: impl Into<f64>) -> Value {
    rounded(v, 2)
}

fn point(p: [f32; 2]) -> [Value; 2] {
    p.map(px)
}

fn mm(v: f32) -> Value {
    rounded(v, 2)
}

/// A score, 0 to 1. Near 1 its order is in the last digits.
pub(crate) fn score(v: f32) -> Value {
    rounded(v, 6)
}

/// An element of a rotation, or of a direction.
fn direction(v: f32) -> Value {
    rounded(v, 6)
}

fn milliseconds(ns: u64) -> Value {
    rounded(ns as f64 / 1e6, 3)
}

/// A number with its first `digits` digits, wherever its point is.
fn significant(v: impl Into<f64>, digits: usize) -> Value {
    let v = v.into() + 0.0;
    // What is written so is a number.
    json!(format!("{v:.0$e}", digits - 1).parse().unwrap_or(v))
}

/// The map has the digits that a 32-bit number has. What it maps is right to 0.01 px, as corners are.
fn homography(h: &Homography) -> [Value; 9] {
    h.0.map(|v| significant(v, 7))
}

fn pose_object(pose: &Pose) -> Value {
    json!({
        "rotation": pose.rotation.map(direction),
        "translation_mm": pose.translation_mm.map(mm),
        "error_px": px(pose.error_px),
    })
}

/// The better pose with the other one in `mirrored`; null when there is no pose.
#[must_use]
pub fn plane_pose_object(poses: Option<&PlanePose>) -> Value {
    let Some(poses) = poses else { return Value::Null };
    let mut object = pose_object(&poses.best);
    object["ambiguous"] = json!(poses.is_ambiguous());
    object["mirrored"] = pose_object(&poses.mirrored);
    object
}

/// A cylinder, with the pose of the label on it.
fn cylinder_object(c: &Cylinder) -> Value {
    let mut object = json!({
        "radius_mm": mm(c.radius_mm),
        "inside": c.is_inside,
        "axis": c.axis.map(direction),
        "centre_mm": c.centre_mm.map(mm),
    });
    if let (Value::Object(all), Value::Object(pose)) = (&mut object, pose_object(&c.pose)) {
        all.extend(pose);
    }
    object
}

/// The names of the columns of [`csv_lines`].
pub const CSV_HEAD: &str = "source,frame,object,score,visible,x1,y1,x2,y2,x3,y3,x4,y4";

/// A line of comma-separated values for each detection of a frame: corners in px of the frame, clockwise from
/// the picture's top left. Numbers are those of [`frame_line`].
#[must_use]
pub fn csv_lines(source: &str, frame: u64, model: &Model<'_>, found: &Found) -> String {
    // As RFC 4180 has it. A line break in a name would make two lines of one.
    let quoted = |text: &str| {
        let text = text.replace(['\n', '\r'], " ");
        if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
    };
    let line = |d: &Detection| {
        let corners = d.corners.iter().flatten().map(|&v| format!(",{}", px(v))).collect::<String>();
        let name = quoted(model.object(usize::from(d.object)).name);
        let (score, visible) = (score(d.score), rounded(d.appearance.visible, 3));
        format!("{},{frame},{name},{score},{visible}{corners}", quoted(source))
    };
    found.detections.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// The line of a frame that was read. `places` has one entry a detection.
#[must_use]
pub fn frame_line(
    source: &str,
    frame: u64,
    size: (u32, u32),
    model: &Model<'_>,
    found: &Found,
    places: Option<&[Place]>,
) -> Value {
    let mut detections: Vec<Value> = (0..found.detections.len()).map(|i| detection_entry(model, found, i)).collect();
    for (entry, place) in detections.iter_mut().zip(places.unwrap_or_default()) {
        entry["pose"] = plane_pose_object(place.pose.as_ref());
        if let Some(cylinder) = &place.cylinder {
            entry["cylinder"] = cylinder_object(cylinder);
        }
    }
    let mut stages = Map::new();
    let mut times = Map::new();
    times.insert("total".into(), milliseconds(found.total_ns));
    for (i, s) in Stage::ALL.iter().enumerate() {
        let c = &found.stats.stages[i];
        stages.insert(s.name().into(), json!({"seen": c.seen, "kept": c.kept, "dropped": c.dropped}));
        times.insert(s.name().into(), milliseconds(found.stats.ticks[i]));
    }
    let mut line = json!({
        "source": source, "frame": frame, "width": size.0, "height": size.1,
        "detections": detections, "stages": stages, "time_ms": times,
    });
    if let Some(part) = found.part {
        line["roi"] = json!([part.x, part.y, part.width, part.height]);
    }
    if found.mirrored {
        line["mirror"] = json!(true);
    }
    if found.stats.stopped {
        line["complete"] = json!(false);
    }
    if let Some(digests) = &found.digests {
        let digest = |s: &Stage| (s.name().to_string(), Value::from(format!("{:08x}", digests.of(*s))));
        line["digests"] = Stage::ALL.iter().map(digest).collect();
    }
    if let Some(tracking) = &found.tracking {
        let lost = |t: &Track| lost_entry(model, t);
        line["state"] = json!(if found.detections.is_empty() { "searching" } else { "tracking" });
        line["searched"] = json!(tracking.searched);
        line["lost"] = tracking.lost.iter().map(lost).collect();
    }
    line
}

/// Detection `index` of a frame, as the line of the frame has it.
#[must_use]
pub fn detection_entry(model: &Model<'_>, found: &Found, index: usize) -> Value {
    let track = found.tracking.as_ref().map(|t| t.seen[index]);
    let state = track.map_or(State::Found, |(_, state)| state);
    let mut entry = detection_object(model, &found.detections[index], state);
    if let Some(surface) = found.surface(index) {
        let points: Vec<_> = surface.points.iter().map(|&p| point(p)).collect();
        entry["surface"] = json!({
            "bent": surface.is_bent,
            "homography": homography(&surface.homography),
            "cols": SIDE,
            "rows": SIDE,
            "points": points,
        });
    }
    if let Some(rivals) = found.rivals.get(index) {
        let name =
            |&(object, v): &(u16, f32)| json!({"object": model.object(usize::from(object)).name, "score": score(v)});
        entry["rivals"] = rivals.iter().map(name).collect();
    }
    if let Some((id, _)) = track {
        entry["id"] = json!(id);
    }
    entry
}

/// An instance that is lost, as the line of a frame has it.
#[must_use]
pub fn lost_entry(model: &Model<'_>, track: &Track) -> Value {
    let mut entry = detection_object(model, &track.detection, track.state);
    entry["id"] = json!(track.id);
    entry["unseen"] = json!(track.unseen);
    entry
}

fn detection_object(model: &Model<'_>, d: &Detection, state: State) -> Value {
    json!({
        "object": model.object(usize::from(d.object)).name,
        "state": state.name(),
        "score": score(d.score),
        "visible": rounded(d.appearance.visible, 3),
        "homography": homography(&d.homography),
        "corners": d.corners.map(point),
        "votes": d.votes,
        "agreeing": d.agreeing,
        "correlation": rounded(d.appearance.median, 4),
        "support": rounded(d.appearance.support, 2),
        "strong": rounded(d.appearance.strong, 2),
        "blocks": d.appearance.blocks,
        "inside": d.appearance.inside,
        "chroma": rounded(d.appearance.chroma, 4),
    })
}

/// The line of a frame that could not be read or searched.
#[must_use]
pub fn error_line(source: &str, frame: u64, error: &str) -> Value {
    json!({"source": source, "frame": frame, "error": error, "detections": []})
}

/// The line of a frame with the time at which the frame came, if it has one.
#[must_use]
pub fn timed(mut line: Value, time: Option<SystemTime>) -> Value {
    if let Some(time) = time {
        line["time"] = json!(stamp(time));
    }
    line
}

/// The object that `train --json` and `inspect --json` print.
#[must_use]
pub fn model_object(model: &Model<'_>) -> Value {
    let objects = || (0..model.objects()).map(|i| model.object(i));
    let (cells_used, largest_cell) = model.occupancy();
    json!({
        "objects": objects().map(|o| json!({"name": o.name, "width": o.width, "height": o.height})).collect::<Vec<_>>(),
        "keypoints": model.keypoints(),
        "triples": objects().map(|o| u64::from(o.triples)).sum::<u64>(),
        "keygraphs": model.keygraphs(),
        "cells_used": cells_used,
        "largest_cell": largest_cell,
        "bytes": model.bytes().len(),
        "feature": model.feature().name(),
        "views": model.views(),
        "method": model.method().name(),
        "slim": model.is_slim(),
    })
}

/// An object that looks like the one that was trained, as `train --json` has it.
#[must_use]
pub fn alike_object(object: &str, alike: &Alike) -> Value {
    json!({"object": object, "share": rounded(alike.share, 3), "score": score(alike.score)})
}

/// The object that `bench --json` prints.
#[must_use]
pub fn bench_object(b: &Bench) -> Value {
    let ms = |v: f64| rounded(v, 4);
    let times = |t: &Times| json!({"median_ms": ms(t.median), "p95_ms": ms(t.p95)});
    let stage = |s: &StageCost| {
        let mut entry = times(&s.times);
        entry["dropped"] = json!(s.dropped);
        if let (Some(moved), Some(copy)) = (s.moved, s.copy_ms) {
            entry["bytes_moved"] = json!(moved);
            entry["copy_ms"] = ms(copy);
        }
        (s.stage.name().to_string(), entry)
    };
    let buffer = |h: &Held| json!({"name": h.buffer.name(), "bytes": h.room.bytes, "capacity": h.room.capacity, "high_water": h.high_water});
    json!({
        "frames": b.frames,
        "threads": b.threads,
        "passes": b.passes,
        "detections": b.detections,
        "digest": format!("{:08x}", b.digest),
        "total": times(&b.total),
        "each_ms": b.each.iter().map(|&v| ms(v)).collect::<Vec<_>>(),
        "stages": b.stages.iter().map(stage).collect::<Map<_, _>>(),
        "detector_bytes": b.detector_bytes,
        "buffers": b.buffers.iter().map(buffer).collect::<Vec<_>>(),
        "tracking": b.tracking.as_ref().map(|t| json!({"followed": t.followed, "times": times(&t.times), "searched": times(&t.searched)})),
    })
}

/// The object that `calibrate --json` prints, with the number of frames, and the name of each view.
#[cfg(feature = "calibrate")]
#[must_use]
pub fn calibration_object<'a>(c: &Calibrated, frames: usize, views: impl Iterator<Item = &'a str>) -> Value {
    let number = |(name, (&value, &sigma)): (&&str, (&f64, &f64))| {
        ((*name).to_string(), json!({"value": significant(value, 7), "uncertainty": significant(sigma, 2)}))
    };
    let numbers: Map<_, _> = c.kind.names().iter().zip(c.numbers.iter().zip(&c.uncertainty)).map(number).collect();
    let view = |(name, error): (&str, &Option<f64>)| json!({"frame": name, "error_px": error.map(px)});
    json!({
        "numbers": numbers,
        "error_px": px(c.error_px),
        "reach": rounded(c.reach, 3),
        "frames": frames,
        "views": views.zip(&c.views).map(view).collect::<Vec<_>>(),
    })
}

/// The object that `assess --json` prints for each object of a model.
#[must_use]
pub fn assessment_object(a: &Assessment) -> Value {
    let list = |cells: &[Cell]| cells.iter().map(|c| json!({"value": c.value, "found": c.found})).collect::<Vec<_>>();
    let table = |s: &Sweep| {
        let row = |r: &Row| json!({"condition": r.condition.name(), "unit": r.condition.unit(), "rate": rounded(r.rate(s.views), 4), "cells": list(&r.cells)});
        s.rows.iter().map(row).collect::<Vec<_>>()
    };
    let structure = |s: &Structure| {
        json!({
            "keypoints": s.keypoints,
            "keygraphs": s.keygraphs,
            "spread": rounded(s.spread, 3),
            "contrast": rounded(s.contrast, 1),
            "repetition": rounded(s.repetition, 3),
            "width": s.size.0,
            "height": s.size.1,
            "luma_only": s.luma_only,
        })
    };
    json!({
        "object": a.name,
        "score": a.score,
        "views": a.sweep.as_ref().map(|s| s.views),
        "table": a.sweep.as_ref().map(table),
        "wrong": a.sweep.as_ref().map(|s| s.wrong),
        "look_alikes": a.sweep.as_ref().map(|s| list(&s.taken)),
        "structure": a.structure.as_ref().map(structure),
        "limits": a.limits.iter().map(|l| json!({"kind": l.kind, "text": l.text})).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_mean_something() {
        let text = |v: Value| v.to_string();
        assert_eq!(text(px(209.603_f32)), "209.6");
        assert_eq!(text(px(-68.7651_f32)), "-68.77");
        assert_eq!(text(px(-0.001_f32)), "0.0", "no -0");
        assert_ne!(score(0.999_91), score(0.999_94), "the order near 1 stays");
        assert_eq!(text(score(0.998_125_4)), "0.998125");
        for (v, told) in [
            (0.902_733_45_f32, "0.9027334"),
            (-123.456_79, "-123.4568"),
            (1.234_567_8e-5, "0.00001234568"),
            (1.0, "1.0"),
            (-0.0, "0.0"),
        ] {
            let text = text(significant(v, 7));
            assert_eq!(text.parse::<f64>(), told.parse::<f64>(), "{v} is told as {text}");
            assert!(!text.starts_with("-0.0") || v < 0.0, "{text}");
        }
        assert_eq!(significant(f64::INFINITY, 7), Value::Null);
    }

    #[test]
    fn a_homography_maps_as_the_one_that_was_found() {
        let h = [
            0.987_654_3_f32,
            -0.123_456_79,
            209.603_45,
            0.234_567_9,
            1.012_345_7,
            -68.765_434,
            1.234_567_8e-4,
            -2.345_678_9e-5,
            1.0,
        ];
        let told = homography(&Homography(h)).map(|v| v.as_f64().expect("a number"));
        let map = |h: [f64; 9], x: f64, y: f64| {
            let z = h[6] * x + h[7] * y + h[8];
            [(h[0] * x + h[1] * y + h[2]) / z, (h[3] * x + h[4] * y + h[5]) / z]
        };
        for (x, y) in [(0.0, 0.0), (4000.0, 0.0), (4000.0, 3000.0), (0.0, 3000.0)] {
            let (exact, told) = (map(h.map(f64::from), x, y), map(told, x, y));
            assert!(exact.iter().zip(told).all(|(a, b)| (a - b).abs() < 5e-3), "{exact:?} is told as {told:?}");
        }
    }
}
