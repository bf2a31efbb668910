//! Results as sentences and tables, for people.
//!
//! In: what a command found out. Out: lines of text without a line break at the end. Control
//! characters in names are escaped.
//! Memory and cost: the text.

use std::borrow::Cow;
use std::path::Path;

use keygraph_core::{Detection, FeatureKind, Model, Trained};

use crate::advice::Review;
use crate::assess::Assessment;
use crate::bench::Bench;
use crate::input::LeftOut;
use crate::output::plain;
use crate::pose::Place;
use crate::run::Searched;
use crate::sweep::{Cell, frames};

/// What of a folder is not read, with the names of the first three files.
#[must_use]
pub fn left_out(left: &LeftOut) -> String {
    let counted = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let names = left.files.iter().filter_map(|p| Some(p.file_name()?.to_string_lossy().into_owned()));
    let mut parts = Vec::new();
    if !left.files.is_empty() {
        let more = if left.files.len() > 3 { ", ..." } else { "" };
        let names = names.take(3).collect::<Vec<_>>().join(", ");
        let number = counted(left.files.len(), "file");
        parts.push(format!("{number} without the name of a picture or a video ({names}{more})"));
    }
    if left.folders > 0 {
        parts.push(format!("{} (--recursive reads them)", counted(left.folders, "folder")));
    }
    plain(&format!("left out in {}: {}", left.folder.display(), parts.join(", "))).into_owned()
}

/// What training did: views, keypoints, keygraphs.
#[must_use]
pub fn training(t: &Trained) -> String {
    let each = t.view_keypoints.iter().map(u16::to_string).collect::<Vec<_>>().join(" ");
    let sum: u32 = t.view_keypoints.iter().map(|&n| u32::from(n)).sum();
    format!(
        "views      {}, with {each} keypoints: {sum}\nlikely     {} keygraphs, of which the caps left out {}",
        t.view_keypoints.len(),
        t.keygraphs.seen,
        t.keygraphs.dropped
    )
}

/// A model that was trained on one picture, for its user: what it is, whether the object is found in its own picture,
/// how good the picture is, and what to do next. `label` names the picture, `path` is the model's file.
#[must_use]
pub fn trained(model: &Model<'_>, label: &str, size: (u32, u32), review: &Review, path: &Path) -> String {
    let found = match review.found {
        Some(own) => format!("yes, in its own picture: score {:.2}, outline {:.1} px off", own.score, own.off_px),
        None => "no, not even in its own picture".into(),
    };
    let good = match review.is_good {
        None => "not judged: the method of the paper is for comparison",
        Some(true) => "good: enough corners and contrast, and nothing that repeats",
        Some(false) if review.limits.is_empty() => "could be better, as said above",
        Some(false) => "could be better:",
    };
    let file = path.display().to_string();
    let mut lines = vec![
        format!("object     {}, from {label}, {}x{} px", plain(model.object(0).name), size.0, size.1),
        format!("keygraphs  {}", grouped(model.keygraphs() as u64)),
        format!("found      {found}"),
        format!("picture    {good}"),
    ];
    lines.extend(review.limits.iter().map(|limit| format!("           - {}", limit.text)));
    lines.push(format!("written    {}, {}", plain(&file), bytes(model.bytes().len())));
    lines.push(format!("next       keygraph detect -m {} photo.jpg", plain(&shell_word(&file))));
    lines.join("\n")
}

/// A count with commas between thousands.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let comma = |(i, c): (usize, char)| {
        let is_first = i > 0 && (digits.len() - i).is_multiple_of(3);
        is_first.then_some(',').into_iter().chain([c])
    };
    digits.chars().enumerate().flat_map(comma).collect()
}

/// A size of a file, with two digits.
fn bytes(n: usize) -> String {
    match n {
        1_000_000.. => format!("{:.1} MB", n as f64 / 1e6),
        1_000.. => format!("{:.0} KB", n as f64 / 1e3),
        _ => format!("{n} bytes"),
    }
}

/// A word as a shell takes it.
fn shell_word(text: &str) -> Cow<'_, str> {
    let is_bare = |c: char| c.is_alphanumeric() || "-_./+=@:,%".contains(c);
    if text.chars().all(is_bare) && !text.starts_with('-') {
        return text.into();
    }
    let quoted = format!("'{}'", text.replace('\'', r"'\''"));
    if text.starts_with('-') { format!("./{quoted}").into() } else { quoted.into() }
}

/// What a model holds; `path` is its file.
#[must_use]
pub fn model(model: &Model<'_>, path: &Path) -> String {
    let (used, largest) = model.occupancy();
    let triples: u64 = (0..model.objects()).map(|i| u64::from(model.object(i).triples)).sum();
    let slim = if model.is_slim() { ", slim: those of the lists alone" } else { "" };
    format!(
        "method     {}\ntriples    {triples} possible\nkeygraphs  {}{slim}\nsubsets    {used} used, the largest has {largest}\n\
         model      {}, {} bytes, feature {}",
        model.method().name(),
        model.keygraphs(),
        plain(&path.display().to_string()),
        model.bytes().len(),
        match model.feature() {
            FeatureKind::Both => "both (luma and chroma)",
            other => other.name(),
        }
    )
}

/// The objects of a model, one a line.
#[must_use]
pub fn objects(model: &Model<'_>) -> String {
    let line = |i: usize| {
        let o = model.object(i);
        format!("object     {}, {}x{} px, {} keypoints", plain(o.name), o.width, o.height, o.keypoints)
    };
    (0..model.objects()).map(line).collect::<Vec<_>>().join("\n")
}

/// An assessment: object, score, table and limits.
#[must_use]
pub fn assessment(a: &Assessment) -> String {
    let mut lines = vec![format!("{:17}  {}", "object", plain(&a.name))];
    if let Some(s) = &a.structure {
        let feature = if s.luma_only { "luma alone" } else { "luma and chroma" };
        lines[0] +=
            &format!(", {}x{} px, {} keypoints, {} keygraphs, {feature}", s.size.0, s.size.1, s.keypoints, s.keygraphs);
    }
    if let Some(score) = a.score {
        lines.push(format!("{:17}  {score} of 100", "score"));
    }
    if let Some(sweep) = &a.sweep {
        for row in &sweep.rows {
            let cell = |c: &Cell| format!("{}: {:.0} %", c.value, c.rate(sweep.views) * 100.0);
            let cells = row.cells.iter().map(cell).collect::<Vec<_>>().join("   ");
            let head = format!("{}, {}", row.condition.name(), row.condition.unit());
            lines.push(format!("{head:17}  {cells}"));
        }
        lines.push(format!("{:17}  {} outlines in {} frames", "wrong", sweep.wrong, frames(sweep.views)));
        let cell = |c: &Cell| format!("{} % exchanged: {:.0} %", c.value, c.rate(sweep.views) * 100.0);
        let cells = sweep.taken.iter().map(cell).collect::<Vec<_>>().join("   ");
        lines.push(format!("{:17}  {cells}", "look-alikes taken"));
    }
    let mut head = "limits";
    for limit in &a.limits {
        lines.push(format!("{head:17}  {}", limit.text));
        head = "";
    }
    if a.limits.is_empty() {
        lines.push(format!("{head:17}  none"));
    }
    lines.join("\n")
}

/// A benchmark: times by stage, memory by buffer, digest.
#[must_use]
pub fn benchmark(b: &Bench, model: &Model<'_>) -> String {
    let mut lines = vec![
        format!(
            "{} objects, {} keygraphs, {} bytes of model; {} frames, {} passes, {}",
            model.objects(),
            model.keygraphs(),
            model.bytes().len(),
            b.frames,
            b.passes,
            if b.threads > 1 { format!("{} threads", b.threads) } else { "one thread".into() }
        ),
        format!(
            "\n{:10} {:>10} {:>10} {:>9}  a plain copy of the bytes it moves",
            "stage", "median ms", "95 % ms", "dropped"
        ),
    ];
    for s in &b.stages {
        let copy =
            s.moved.zip(s.copy_ms).map_or_else(String::new, |(moved, copy)| format!("  {copy:.3} ms for {moved}"));
        let (name, times) = (s.stage.name(), &s.times);
        lines.push(format!("{name:10} {:10.3} {:10.3} {:9}{copy}", times.median, times.p95, s.dropped));
    }
    lines.push(format!("{:10} {:10.3} {:10.3}", "total", b.total.median, b.total.p95));
    if let Some(t) = &b.tracking {
        lines.push(format!(
            "{:10} {:10.3} {:10.3}  {} of {} frames",
            "followed", t.times.median, t.times.p95, t.followed, b.frames
        ));
    }
    lines.push(format!("\n{:14} {:>9} {:>9} {:>11}", "buffer", "bytes", "capacity", "high water"));
    for h in &b.buffers {
        lines.push(format!("{:14} {:9} {:9} {:11}", h.buffer.name(), h.room.bytes, h.room.capacity, h.high_water));
    }
    lines.push(format!("{:14} {:9}, all fixed when it was compiled", "the detector", b.detector_bytes));
    lines.push(format!("\n{} detections in a pass; digest {:08x}, equal on every machine", b.detections, b.digest));
    lines.join("\n")
}

/// What was found in frame `index` of `source`.
#[must_use]
pub fn frame(source: &str, index: u64, model: &Model<'_>, searched: &Searched) -> String {
    let found = &searched.found;
    let what = if found.detections.is_empty() {
        "nothing found".to_string()
    } else {
        let place = |i: usize| searched.places.as_ref().map(|places| &places[i]);
        let one = |(i, d)| detection(model, d, place(i));
        found.detections.iter().enumerate().map(one).collect::<Vec<_>>().join("; ")
    };
    let source = plain(source);
    format!("{source} [{index}]: {what} ({:.1} ms)", found.total_ns as f64 / 1e6)
}

fn detection(model: &Model<'_>, d: &Detection, place: Option<&Place>) -> String {
    let [x, y] = [0, 1].map(|i| d.corners.iter().map(|c| c[i]).sum::<f32>() / 4.0);
    let side = |a: [f32; 2], b: [f32; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
    let [a, b, c, _] = d.corners;
    // Adding 0 turns -0, which would be written as -0, into 0.
    let angle = (b[1] - a[1]).atan2(b[0] - a[0]).to_degrees().round() + 0.0;
    let distance = place.and_then(Place::middle_mm).map_or_else(String::new, |middle| {
        let mm = middle.iter().map(|v| v * v).sum::<f32>().sqrt();
        format!(", {mm:.0} mm away")
    });
    format!(
        "{} at ({x:.0}, {y:.0}), {:.0}x{:.0} px, turned by {angle:.0} degrees, score {:.2}{distance}",
        plain(model.object(usize::from(d.object)).name),
        side(a, b),
        side(b, c),
        d.score
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_sizes_are_easy_to_read() {
        let counts = [0, 999, 1_000, 42_634, 1_234_567].map(grouped);
        assert_eq!(counts, ["0", "999", "1,000", "42,634", "1,234,567"]);
        assert_eq!([900, 65_536, 1_995_388].map(bytes), ["900 bytes", "66 KB", "2.0 MB"]);
    }

    #[test]
    fn a_command_can_be_pasted() {
        assert_eq!(shell_word("out/a-b_2.kgm"), "out/a-b_2.kgm");
        assert_eq!(shell_word("my book's.kgm"), r"'my book'\''s.kgm'");
        assert_eq!(shell_word("-o.kgm"), "./'-o.kgm'");
    }
}
