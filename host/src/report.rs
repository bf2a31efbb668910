//! Results as JSON: the lines and objects that other programs read.
//!
//! In: results of a command. Out: JSON values. Memory and cost: the text.

use keygraph_core::stages::surface::SIDE;
use keygraph_core::{Cylinder, Detection, Model, PlanePose, Pose, Stage, State, Track};
use serde_json::{Map, Value, json};

use crate::alike::Alike;
use crate::assess::Assessment;
use crate::bench::{Bench, Held, StageCost, Times};
use crate::pose::Place;
use crate::search::Found;
use crate::structure::Structure;
use crate::sweep::{Cell, Row, Sweep};

/// A number rounded to `digits` decimals.
pub(crate) fn rounded(v: impl Into<f64>, digits: i32) -> Value {
    let k = 10f64.powi(digits);
    json!((v.into() * k).round() / k)
}

fn milliseconds(ns: u64) -> Value {
    json!((ns as f64 / 1e3).round() / 1e3)
}

fn pose_object(pose: &Pose) -> Value {
    json!({
        "rotation": pose.rotation.map(|v| rounded(v, 6)),
        "translation_mm": pose.translation_mm.map(|v| rounded(v, 3)),
        "error_px": rounded(pose.error_px, 4),
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
        "radius_mm": rounded(c.radius_mm, 3),
        "inside": c.is_inside,
        "axis": c.axis.map(|v| rounded(v, 6)),
        "centre_mm": c.centre_mm.map(|v| rounded(v, 3)),
    });
    if let (Value::Object(all), Value::Object(pose)) = (&mut object, pose_object(&c.pose)) {
        all.extend(pose);
    }
    object
}

/// The names of the columns of [`csv_lines`].
pub const CSV_HEAD: &str = "source,frame,object,score,visible,x1,y1,x2,y2,x3,y3,x4,y4";

/// A line of comma-separated values for each detection of a frame: corners in px of the frame, clockwise from
/// the picture's top left.
#[must_use]
pub fn csv_lines(source: &str, frame: u64, model: &Model<'_>, found: &Found) -> String {
    // As RFC 4180 has it. A line break in a name would make two lines of one.
    let quoted = |text: &str| {
        let text = text.replace(['\n', '\r'], " ");
        if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
    };
    let line = |d: &Detection| {
        let corners = d.corners.iter().flatten().map(|v| format!(",{v:.2}")).collect::<String>();
        let name = quoted(model.object(usize::from(d.object)).name);
        format!("{},{frame},{name},{:.4},{:.3}{corners}", quoted(source), d.score, d.appearance.visible)
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
        let points: Vec<_> = surface.points.iter().map(|p| p.map(|v| rounded(v, 3))).collect();
        entry["surface"] = json!({
            "bent": surface.is_bent,
            "homography": surface.homography.0.map(f64::from),
            "cols": SIDE,
            "rows": SIDE,
            "points": points,
        });
    }
    if let Some(rivals) = found.rivals.get(index) {
        let name = |&(object, score): &(u16, f32)| json!({"object": model.object(usize::from(object)).name, "score": rounded(score, 6)});
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
        "score": rounded(d.score, 6),
        "visible": rounded(d.appearance.visible, 3),
        "homography": d.homography.0.map(f64::from),
        "corners": d.corners.map(|p| p.map(|v| rounded(v, 3))),
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
    })
}

/// An object that looks like the one that was trained, as `train --json` has it.
#[must_use]
pub fn alike_object(object: &str, alike: &Alike) -> Value {
    json!({"object": object, "share": rounded(alike.share, 3), "score": rounded(alike.score, 6)})
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
        "passes": b.passes,
        "detections": b.detections,
        "digest": format!("{:08x}", b.digest),
        "total": times(&b.total),
        "stages": b.stages.iter().map(stage).collect::<Map<_, _>>(),
        "detector_bytes": b.detector_bytes,
        "buffers": b.buffers.iter().map(buffer).collect::<Vec<_>>(),
        "tracking": b.tracking.as_ref().map(|t| json!({"followed": t.followed, "times": times(&t.times), "searched": times(&t.searched)})),
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
