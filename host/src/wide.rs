//! A picture searched once more as it looks squeezed along each of eight directions.
//!
//! An object that is seen from far to the side is narrow along one direction. Squeezing the picture along the other
//! one makes the object look as from nearer the front ([`Squeeze`]). The searches of the squeezed pictures are those of
//! any picture, with the same thresholds; of several outlines at one place the best stays. What is found is then searched
//! for once more, squeezed as its own outline says.
//!
//! In: a picture, a model. Out: [`Found`], in px of the picture. Memory: a copy of the picture, and for each thread a
//! squeezed one and the detector of the next larger profile, because a squeezed picture is long. Cost: that of eight
//! searches, and of one for each object that is found.

use std::mem::take;
use std::ops::Range;
use std::panic::resume_unwind;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use keygraph_core::stages::frame::MIN_SIDE;
use keygraph_core::stages::plane::Plane;
use keygraph_core::stages::squeeze::Squeeze;
use keygraph_core::{CellMatch, Detection, Frame, Homography, Model, Object, PixelFormat, Surface};

use crate::input::Picture;
use crate::search::{AnyDetector, Found, Profile, Request, prepare_for, search_for, search_frame, with_detector};
use crate::sensor::sense;

/// Factor by which a picture is squeezed.
const FACTOR: u8 = 5;

/// Number of directions. With a factor of 5 and eight of them, an object that is tilted by 80 degrees along any
/// direction looks tilted by 70 degrees at most in one of the squeezed pictures.
const DIRECTIONS: usize = 8;

/// How many times as narrow as from the front an object looks in the picture in which its outline is refined. Models
/// have views that are narrower.
const TILTED: f32 = 1.5;

/// The score from which on the one object of a model is found without doubt, so that nothing more is searched.
const SURE: f32 = 0.97;

/// Searches `picture` as [`search_for`] does, and where [`is_wanted`] says so as [`search_squeezed`] does.
///
/// # Errors
/// When the picture is too small, and as [`search_squeezed`].
pub fn search_widely(picture: &Picture, model: &Model<'_>, request: &Request, slots: Range<usize>) -> Result<Found> {
    let start = Instant::now();
    let found = search_for(picture, model, request, slots.start)?;
    if !is_wanted(&found, model, request) {
        return Ok(found);
    }
    search_squeezed(found, picture, model, request, (slots, start))
}

/// Whether a picture is searched squeezed when a search of it has found `found`: with [`Request::wide`], unless the
/// model has one object and that is found without doubt, and not from far to the side. A second copy of it is then not
/// looked for.
#[must_use]
pub fn is_wanted(found: &Found, model: &Model<'_>, request: &Request) -> bool {
    let is_sure = |d: &Detection| d.score >= SURE && narrow(&model.object(d.object.into()), &d.homography).is_none();
    request.wide && !(model.objects() == 1 && found.detections.first().is_some_and(is_sure))
}

/// Adds to what a search of `picture` has found what is seen from far to the side. The detectors of the threads `slots`
/// share the work; what they find does not depend on their number. `start` is the time at which the search of the picture
/// began.
///
/// # Errors
/// When the region of the request does not suit the picture, and when the request has a lens: straight lines are taken as
/// straight.
pub fn search_squeezed(
    found: Found,
    picture: &Picture,
    model: &Model<'_>,
    request: &Request,
    (slots, start): (Range<usize>, Instant),
) -> Result<Found> {
    let (first, step) = (slots.start, slots.len().max(1));
    // Each thread has squeezed pictures of its own.
    let request = &Request { threads: if step > 1 { 1 } else { request.threads }, ..*request };
    let wide = match Wide::new(picture, model, request, start)? {
        Some(wide) => wide,
        None => return Ok(stopped(found)),
    };
    let search =
        |k: usize| with_detector(larger(request.profile), first + k, |detector| wide.search(detector, k, step));
    let parts = thread::scope(|scope| {
        let others: Vec<_> = (1..step).map(|k| scope.spawn(move || search(k))).collect();
        let mut parts = vec![search(0)];
        parts.extend(others.into_iter().map(|other| other.join().unwrap_or_else(|panic| resume_unwind(panic))));
        parts
    });
    let mut all = Vec::new();
    for part in parts {
        all.extend(part?);
    }
    // The order of the directions does not depend on the number of threads.
    all.sort_by_key(|(i, _)| *i);
    let found = wide.joined(found, all.into_iter().map(|(_, found)| found));
    with_detector(larger(request.profile), first, |detector| wide.refined(detector, found))
}

/// Does what [`search_squeezed`] does with one detector, of the profile that [`larger`] tells.
///
/// # Errors
/// As [`search_squeezed`], and when the detector is too small.
pub fn search_squeezed_by(
    detector: &mut AnyDetector,
    found: Found,
    picture: &Picture,
    model: &Model<'_>,
    (request, start): (&Request, Instant),
) -> Result<Found> {
    let Some(wide) = Wide::new(picture, model, request, start)? else { return Ok(stopped(found)) };
    let all = wide.search(detector, 0, 1)?;
    wide.refined(detector, wide.joined(found, all.into_iter().map(|(_, found)| found)))
}

/// A picture that is searched squeezed.
struct Wide<'a> {
    /// The picture as Gray8 or I420, scaled so that each squeezed picture fits the detector.
    data: Vec<u8>,
    size: (usize, usize),
    format: PixelFormat,
    to_picture: Homography,
    model: &'a Model<'a>,
    request: Request,
    start: Instant,
}

impl<'a> Wide<'a> {
    /// Prepares the picture. `None` when no time is left.
    fn new(picture: &Picture, model: &'a Model<'a>, request: &Request, start: Instant) -> Result<Option<Self>> {
        ensure!(request.lens.is_none(), "a wide search takes straight lines as straight: leave out the lens");
        if left(request, start) == Some(Duration::ZERO) {
            return Ok(None);
        }
        // The squeezed pictures have the format that squeezing gives them.
        let request = Request { details: false, digests: false, format: None, ..*request };
        let (side, pixels) = (larger(request.profile).limits().0, request.profile.limits().1);
        let scaled = prepare_for(picture, &request, |size| squeezable(size, side, pixels))?;
        let format = if scaled.format == PixelFormat::Gray8 { PixelFormat::Gray8 } else { PixelFormat::I420 };
        let (width, height, data) = sense(scaled.format, (scaled.width, scaled.height), &scaled.data, format);
        let (size, to_picture) = ((width, height), scaled.to_picture);
        Ok(Some(Self { data, size, format, to_picture, model, request, start }))
    }

    /// What is found in the pictures that are squeezed along each `step`th direction from number `first` on, in px of
    /// the prepared picture, with the number of the direction.
    fn search(&self, detector: &mut AnyDetector, first: usize, step: usize) -> Result<Vec<(usize, Found)>> {
        let mut all = Vec::new();
        for i in (first..DIRECTIONS).step_by(step) {
            let squeeze = Squeeze::new(self.size, FACTOR, 180.0 * i as f32 / DIRECTIONS as f32);
            all.extend(self.search_one(detector, &squeeze)?.map(|found| (i, found)));
        }
        Ok(all)
    }

    /// What is found in one squeezed picture, in px of the prepared picture. `None` when it is too small.
    fn search_one(&self, detector: &mut AnyDetector, squeeze: &Squeeze) -> Result<Option<Found>> {
        if squeeze.width.min(squeeze.height) < MIN_SIDE {
            return Ok(None);
        }
        let budget = left(&self.request, self.start);
        if budget == Some(Duration::ZERO) {
            return Ok(Some(stopped(Found::default())));
        }
        let bytes = squeezed(&self.data, self.size, self.format, squeeze);
        let frame = Frame::new(self.format, squeeze.width, squeeze.height, &bytes)?;
        let mut found = search_frame(detector, &frame, self.model, &Request { budget, ..self.request })?;
        found.map_back(&squeeze.to_frame);
        Ok(Some(found))
    }

    /// Searches for what has been found once more, in pictures that are squeezed as each detection says: its outline
    /// is then exact.
    fn refined(&self, detector: &mut AnyDetector, found: Found) -> Result<Found> {
        let Some(to_prepared) = self.to_picture.inverse() else { return Ok(found) };
        let mut all = Vec::new();
        for d in found.detections.iter().take(DIRECTIONS) {
            let (object, seen) = (self.model.object(d.object.into()), to_prepared.after(&d.homography));
            let Some((factor, direction_deg)) = narrow(&object, &seen) else { continue };
            all.extend(self.search_one(detector, &Squeeze::new(self.size, factor, direction_deg))?);
        }
        Ok(if all.is_empty() { found } else { self.joined(found, all.into_iter()) })
    }

    /// What the search of the picture and those of the squeezed pictures have found, in px of the picture. They are
    /// compared in px of the prepared one: outlines in a mirrored picture turn the other way.
    fn joined(&self, mut plain: Found, squeezed: impl Iterator<Item = Found>) -> Found {
        let Some(to_prepared) = self.to_picture.inverse() else { return plain };
        plain.map_back(&to_prepared);
        let mut found = merged(plain, squeezed, self.request.all_names);
        found.map_back(&self.to_picture);
        found.total_ns = u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        found
    }
}

/// How a picture is squeezed so that an object in it looks as one that is tilted by [`TILTED`], and along which direction,
/// degrees. `None` when it is hardly tilted more. `seen` leads from px of the object to px of the picture.
fn narrow(object: &Object<'_>, seen: &Homography) -> Option<(u8, f32)> {
    let [x, y] = [object.width as f32 / 2.0, object.height as f32 / 2.0];
    let [middle, right, below] = [[x, y], [x + 1.0, y], [x, y + 1.0]].map(|p| seen.apply(p));
    let ([a, c], [b, d]) = ([0, 1].map(|i| right[i] - middle[i]), [0, 1].map(|i| below[i] - middle[i]));
    // The ellipse that a circle on the object looks like: its long axis and the ratio of its axes.
    let (xx, xy, yy) = (a * a + b * b, a * c + b * d, c * c + d * d);
    let direction = (2.0 * xy).atan2(xx - yy) / 2.0;
    let apart = (xx - yy).hypot(2.0 * xy);
    let ratio = ((xx + yy + apart) / (xx + yy - apart).max(f32::MIN_POSITIVE)).sqrt();
    let factor = (ratio / TILTED).round().min(f32::from(2 * FACTOR));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small number")]
    (factor >= 2.0).then_some((factor as u8, direction.to_degrees()))
}

/// What is left of the time of a search that began at `start`; `None` when it has no end.
fn left(request: &Request, start: Instant) -> Option<Duration> {
    request.budget.map(|most| most.saturating_sub(start.elapsed()))
}

/// What a search has found that its time has ended.
fn stopped(mut found: Found) -> Found {
    found.stats.stopped = true;
    found
}

/// The profile whose detector takes the squeezed pictures of a search with this profile: they are long.
#[must_use]
pub const fn larger(profile: Profile) -> Profile {
    match profile {
        Profile::Hd | Profile::Vga => Profile::Hd,
        Profile::Qvga => Profile::Vga,
        Profile::Qqvga => Profile::Qvga,
    }
}

/// The longer side of a picture of this size, px, when all its squeezed pictures have sides of at most `side` px and
/// at most `pixels` px, and no limit of its own pixels.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sizes of pictures")]
fn squeezable((width, height): (usize, usize), side: usize, pixels: usize) -> (usize, usize) {
    let (w, h) = (width as f64, height as f64);
    // The longest squeezed picture is as long as a diagonal, and the largest is squeezed along a diagonal of a square.
    // Sides are rounded to even numbers; the detector has room for some pixels more.
    let fits = (side as f64 - 1.0) / w.hypot(h);
    let holds = (2.0 * f64::from(FACTOR) * pixels as f64).sqrt() / (w + h);
    ((w.max(h) * fits.min(holds)) as usize, usize::MAX)
}

/// The planes of a picture, of Gray8 or I420, squeezed.
fn squeezed(data: &[u8], (w, h): (usize, usize), format: PixelFormat, squeeze: &Squeeze) -> Vec<u8> {
    let mut out = vec![0; format.bytes(squeeze.width, squeeze.height)];
    let (luma, chroma) = data.split_at(w * h);
    let (to, to_chroma) = out.split_at_mut(squeeze.width * squeeze.height);
    let apply = |squeeze: &Squeeze, plane: &[u8], (w, h), out: &mut [u8]| {
        if let Some(plane) = Plane::new(plane, w, h) {
            squeeze.apply(&plane, out);
        }
    };
    apply(squeeze, luma, (w, h), to);
    let planes = chroma.chunks(w * h / 4).zip(to_chroma.chunks_mut((to.len() / 4).max(1)));
    planes.for_each(|(plane, out)| apply(&squeeze.halved(), plane, (w / 2, h / 2), out));
    out
}

/// One detection with what is known of it.
struct Entry {
    detection: Detection,
    rivals: Vec<(u16, f32)>,
    surface: Option<Surface>,
    supporters: Vec<[[f32; 2]; 3]>,
    matches: Vec<CellMatch>,
}

/// What several searches of one picture have found: at each place the best outline of an object, and the object that
/// fits best, unless all names are asked for. Counts and times are those of all searches, the rest that of the picture.
fn merged(mut plain: Found, squeezed: impl Iterator<Item = Found>, all_names: bool) -> Found {
    let mut all = taken_from(&mut plain);
    for mut found in squeezed {
        all.extend(taken_from(&mut found));
        plain.stats.add(&found.stats);
    }
    all.sort_by(|a, b| b.detection.score.total_cmp(&a.detection.score));
    let mut best: Vec<Entry> = Vec::new();
    for entry in all {
        match best.iter_mut().find(|b| b.detection.is_twin(&entry.detection)) {
            Some(twin) => twin.rivals.extend(entry.rivals),
            None => best.push(entry),
        }
    }
    if !all_names {
        best = best_names(best);
    }
    for Entry { detection, mut rivals, surface, supporters, matches } in best {
        // Of each object the best score, and the best of all first.
        rivals.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
        rivals.dedup_by_key(|r| r.0);
        rivals.sort_by(|a, b| b.1.total_cmp(&a.1));
        plain.detections.push(detection);
        plain.rivals.push(rivals);
        plain.surfaces.push(surface);
        plain.supporters.push(supporters);
        plain.matches.push(matches);
    }
    plain
}

/// Takes the detections out of what a search has found.
fn taken_from(found: &mut Found) -> Vec<Entry> {
    let mut rivals = take(&mut found.rivals).into_iter();
    let mut surfaces = take(&mut found.surfaces).into_iter();
    let mut supporters = take(&mut found.supporters).into_iter();
    let mut matches = take(&mut found.matches).into_iter();
    let entry = |detection| Entry {
        detection,
        rivals: rivals.next().unwrap_or_default(),
        surface: surfaces.next().flatten(),
        supporters: supporters.next().unwrap_or_default(),
        matches: matches.next().unwrap_or_default(),
    };
    take(&mut found.detections).into_iter().map(entry).collect()
}

/// The object that fits best at each place. What it beats is among its rivals.
fn best_names(all: Vec<Entry>) -> Vec<Entry> {
    let is_best: Vec<bool> = all.iter().map(|a| !all.iter().any(|b| b.detection.beats(&a.detection))).collect();
    let (mut best, mut beaten) = (Vec::new(), Vec::new());
    all.into_iter().zip(is_best).for_each(|(entry, is_best)| if is_best { &mut best } else { &mut beaten }.push(entry));
    for winner in &mut best {
        for lost in beaten.iter().filter(|b| b.detection.is_rival(&winner.detection)) {
            winner.rivals.push((lost.detection.object, lost.detection.score));
            let others = lost.rivals.iter().filter(|(object, _)| *object != winner.detection.object);
            winner.rivals.extend(others);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::input::read_picture;
    use crate::learn::{Preset, train};

    fn found(all: &[(u16, f32, f32)]) -> Found {
        let at = |&(object, x, score): &(u16, f32, f32)| {
            let mut d = Detection::new(object, &Homography::affine([1.0, 0.0, x, 0.0, 1.0, 0.0]), [50.0; 2]);
            (d.score, d.appearance.blocks, d.appearance.support) = (score, 36, 30.0 * score);
            d
        };
        let detections: Vec<_> = all.iter().map(at).collect();
        Found { rivals: vec![Vec::new(); all.len()], ..Found { detections, ..Found::default() } }
    }

    fn told(found: &Found) -> Vec<(u16, f32)> {
        found.detections.iter().map(|d| (d.object, d.score)).collect()
    }

    #[test]
    fn at_each_place_the_best_outline_stays() {
        let join = |all_names| {
            let squeezed = [found(&[(0, 4.0, 0.95), (0, 200.0, 0.85)]), found(&[(1, 2.0, 0.97)])];
            let plain = Found { rivals: vec![vec![(2, 0.4)]], ..found(&[(0, 0.0, 0.9)]) };
            merged(plain, squeezed.into_iter(), all_names)
        };
        let best = join(false);
        assert_eq!(told(&best), [(1, 0.97), (0, 0.85)]);
        assert_eq!(best.rivals, [vec![(0, 0.95), (2, 0.4)], vec![]], "a rival of a twin of what was beaten, too");
        assert_eq!(told(&join(true)), [(1, 0.97), (0, 0.95), (0, 0.85)]);
        assert_eq!(best.surfaces.len(), 2);
    }

    #[test]
    fn only_what_is_plainly_seen_from_the_front_needs_no_squeezed_pictures() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/pictures/coffee.jpg");
        let (bytes, _) =
            train(&read_picture(&file).expect("a picture"), "coffee", Preset::Compact, false).expect("texture");
        let model = Model::parse(&bytes).expect("a model");
        let request = Request { wide: true, ..Request::new(Profile::Vga, 0.8) };
        let wanted = |width: f32, score: f32| {
            let mut found = found(&[(0, 0.0, score)]);
            found.detections[0].homography = Homography::affine([width, 0.0, 0.0, 0.0, 1.0, 0.0]);
            is_wanted(&found, &model, &request)
        };
        assert_eq!([wanted(1.0, 0.98), wanted(0.5, 0.98)], [false; 2]);
        assert_eq!([wanted(1.0, 0.95), wanted(0.3, 0.99), is_wanted(&found(&[]), &model, &request)], [true; 3]);
        assert!(!is_wanted(&found(&[]), &model, &Request { wide: false, ..request }));
    }

    #[test]
    fn squeezed_pictures_of_any_shape_fit_the_larger_detector() {
        for (width, height) in [(640, 480), (1000, 750), (4000, 3000), (3000, 40), (700, 700), (90, 1200)] {
            for profile in [Profile::Hd, Profile::Vga, Profile::Qvga, Profile::Qqvga] {
                let (side, pixels) = (larger(profile).limits().0, profile.limits().1);
                let longer = squeezable((width, height), side, pixels).0.min(width.max(height));
                let scale = longer as f64 / width.max(height) as f64;
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sizes of pictures")]
                let size = [width, height].map(|v| (v as f64 * scale) as usize);
                let size = (size[0], size[1]);
                for i in 0..DIRECTIONS {
                    let s = Squeeze::new(size, FACTOR, 180.0 * i as f32 / DIRECTIONS as f32);
                    assert!(s.width.max(s.height) <= side, "{size:?}: {} x {}", s.width, s.height);
                    assert!(s.width * s.height <= larger(profile).limits().1, "{size:?}: {} x {}", s.width, s.height);
                }
            }
        }
    }

    #[test]
    fn planes_of_colour_are_squeezed_with_the_luma() {
        let (w, h) = (64, 48);
        let data: Vec<u8> = [vec![100; w * h], vec![60; w * h / 4], vec![200; w * h / 4]].concat();
        let squeeze = Squeeze::new((w, h), FACTOR, 22.5);
        let out = squeezed(&data, (w, h), PixelFormat::I420, &squeeze);
        let n = squeeze.width * squeeze.height;
        assert_eq!(out.len(), n * 3 / 2);
        assert!(out[..n].iter().all(|&v| v == 100) && out[n..n * 5 / 4].iter().all(|&v| v == 60));
        assert!(out[n * 5 / 4..].iter().all(|&v| v == 200));
        assert!(squeezed(&data[..w * h], (w, h), PixelFormat::Gray8, &squeeze).iter().all(|&v| v == 100));
    }
}
