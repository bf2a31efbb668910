//! Why an object is found in a frame, or is not: each stage as a picture and in words.
//!
//! In: the model of one picture, the picture, and a frame. Out: an [`Explanation`]. A frame in which nothing is found
//! is searched again in other ways, to tell what would help. Memory: a canvas for each stage. Cost: one search, and up
//! to fourteen more where nothing is found.

mod draw;
mod trace;

use std::time::Instant;

use anyhow::Result;
use keygraph_core::{Detection, Frame, Model};

use crate::canvas::Canvas;
use crate::input::Picture;
use crate::run::default_threads;
use crate::search::{Found, Profile, Request, depth_of, fit, search_for, with_detector};
use crate::wide::search_squeezed;
use trace::{Pair, Trace, homography};

/// Minimum of corners in a frame with texture, on all levels: photographs have 300 and more.
const FEW_CORNERS: usize = 120;
/// Minimum mean luma of a frame with enough light, of 255.
const DARK: f32 = 30.0;
/// Share of blocks that agree from which the best pose may well be right.
const LOOKS_RIGHT: f32 = 0.3;
/// Score from which a pose that is not believed is worth a look.
const NEARLY: f32 = 0.2;

/// What a chapter is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// Corners of the frame.
    Corners,
    /// Triangles that join them.
    Triangles,
    /// One keygraph, in the picture and in the frame.
    Keygraph,
    /// Keygraphs that look alike.
    Matches,
    /// Votes for a place.
    Votes,
    /// Poses that were tried.
    Poses,
    /// The picture beside what is seen.
    Look,
}

impl Topic {
    /// All topics, in the order of the chapters.
    pub const ALL: [Self; 7] =
        [Self::Corners, Self::Triangles, Self::Keygraph, Self::Matches, Self::Votes, Self::Poses, Self::Look];

    /// The title of the chapter.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Corners => "Corners",
            Self::Triangles => "Triangles",
            Self::Keygraph => "Keygraph",
            Self::Matches => "Matches",
            Self::Votes => "Votes",
            Self::Poses => "Poses",
            Self::Look => "Look",
        }
    }

    /// The name of the file with its picture.
    #[must_use]
    pub fn file_name(self) -> String {
        format!("{}-{}.jpg", self as usize + 1, self.title().to_lowercase())
    }
}

/// One stage of the explanation.
#[derive(Debug)]
pub struct Chapter {
    /// What it is about.
    pub topic: Topic,
    /// The picture.
    pub canvas: Canvas,
    /// What the picture shows, and what the stage made.
    pub text: String,
}

/// Why an object is found, or is not.
#[derive(Debug)]
pub struct Explanation {
    /// One sentence.
    pub verdict: String,
    /// What to do, most helpful first; nothing where all is well.
    pub advice: Vec<String>,
    /// The stages, in their order.
    pub chapters: Vec<Chapter>,
}

/// Explains the search of a frame for the first object of a model, whose picture is `picture`.
///
/// # Errors
/// When the frame is too small.
pub fn explain(model: &Model<'_>, picture: &Picture, frame: &Picture, request: &Request) -> Result<Explanation> {
    let (side, pixels) = request.profile.limits();
    let scaled = fit(frame, side, pixels);
    let shown = Canvas::from_picture(&scaled.picture());
    let view = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data)?;
    let search = |threshold: f32| {
        with_detector(request.profile, 0, |detector| {
            let mut trace = Trace::default();
            detector.set_depth(request.depth);
            detector.set_min_visible(0.0);
            let found = detector.detect(&view, model, threshold, &mut trace)?.to_vec();
            let keygraphs: Vec<_> = detector.keygraphs().collect();
            Ok::<_, keygraph_core::FrameError>((trace, found, keygraphs))
        })
    };
    let (trace, found, keygraphs) = search(request.threshold)?;
    // Nothing is believed: what would be, if everything were?
    let best = match found.first() {
        Some(d) => Some(*d),
        None => search(0.0)?.1.into_iter().max_by(|a, b| a.score.total_cmp(&b.score)),
    };
    let map = best.map(|d| d.homography).or_else(|| Some(homography(model, trace.candidates.first()?)));
    let pairs = map.map_or(Vec::new(), |map| trace.pairs(model, &map, 0, &keygraphs));
    let picture = Canvas::from_picture(picture);
    let look = best.map(|d| draw::look(&shown, &picture, &d.homography));
    let case = Case { model, picture, shown, trace, found, best, look, pairs, request };
    let is_scaled = scaled.width < frame.width as usize;
    let trials = if case.found.is_empty() { trials(model, frame, request, is_scaled)? } else { Vec::new() };
    let chapters = case.chapters();
    Ok(Explanation { verdict: case.verdict(), advice: case.advice(&trials, (frame.width, frame.height)), chapters })
}

/// Other ways to search a frame in which nothing was found: the option, and whether it finds something.
fn trials(
    model: &Model<'_>,
    frame: &Picture,
    request: &Request,
    is_scaled: bool,
) -> Result<Vec<(&'static str, Found)>> {
    let plain = Request { budget: None, ..*request };
    let mut ways = vec![("--mirror", Request { mirror: !request.mirror, ..plain })];
    if request.depth != depth_of(true) {
        ways.push(("--thorough", Request { depth: depth_of(true), ..plain }));
    }
    if is_scaled && request.profile != Profile::Hd {
        ways.push(("--profile hd", Request { profile: Profile::Hd, ..plain }));
        ways.push(("--profile hd --thorough", Request { profile: Profile::Hd, depth: depth_of(true), ..plain }));
    }
    let mut helped = Vec::new();
    for (option, way) in ways {
        let found = search_for(frame, model, &way, 0)?;
        if !found.detections.is_empty() {
            helped.push((option, found));
        }
    }
    let start = Instant::now();
    let squeezed = search_squeezed(Found::default(), frame, model, &plain, (0..default_threads(), start))?;
    if !squeezed.detections.is_empty() {
        helped.push(("--wide", squeezed));
    }
    Ok(helped)
}

/// What is known of the search.
struct Case<'a> {
    model: &'a Model<'a>,
    picture: Canvas,
    /// The frame as it was searched.
    shown: Canvas,
    trace: Trace,
    found: Vec<Detection>,
    /// The pose with the best score, believed or not.
    best: Option<Detection>,
    /// The picture beside what is seen at the best pose, and the share of the blocks that agree.
    look: Option<(Canvas, f32)>,
    /// Matches that agree with the best pose, or with the heaviest candidate.
    pairs: Vec<Pair>,
    request: &'a Request,
}

impl Case<'_> {
    fn name(&self) -> &str {
        self.model.object(0).name
    }

    fn verdict(&self) -> String {
        let (name, threshold) = (self.name(), self.request.threshold);
        match (self.found.first(), self.best) {
            (Some(d), _) => {
                let more = if self.found.len() > 1 { format!(", {} times", self.found.len()) } else { String::new() };
                let (score, visible) = (d.score, 100.0 * d.appearance.visible);
                format!("{name} is found{more}, with a score of {score:.2}. {visible:.0} % of it is seen and agrees.")
            }
            (None, Some(d)) if d.score >= NEARLY => format!(
                "{name} is not found. The best pose has a score of {:.2}, and {threshold:.2} is the minimum.",
                d.score
            ),
            _ => format!("{name} is not found, and no pose comes near."),
        }
    }

    fn chapters(&self) -> Vec<Chapter> {
        let (trace, frame) = (&self.trace, &self.shown);
        let coarse = trace.levels.first();
        let sizes: Vec<_> = trace.levels.iter().map(|l| format!("{} at 1/{}", l.corners.len(), 1 << l.level)).collect();
        let mut chapters = vec![
            Chapter {
                topic: Topic::Corners,
                canvas: draw::corners(frame, &trace.levels),
                text: format!(
                    "Corners are places whose surroundings change in every direction. Each level of the pyramid has its \
                     own: {} corners{}. Green: the finest level. Blue: coarser levels, larger dots. \
                     The object needs corners on it; a blurred, dark or plain object has none.",
                    trace.corners(),
                    if sizes.is_empty() {
                        String::new()
                    } else {
                        format!(" ({} of the frame's size)", sizes.join(", "))
                    }
                ),
            },
            Chapter {
                topic: Topic::Triangles,
                canvas: draw::triangles(frame, coarse),
                text: format!(
                    "Nested Delaunay triangulations join corners to triangles, large and small; here those of level {}. \
                     {} triangles of all levels are keygraphs: thick, with three different sides.",
                    coarse.map_or(0, |l| l.level),
                    trace.keygraphs()
                ),
            },
        ];
        if let Some(pair) = self.pairs.first() {
            chapters.push(Chapter {
                topic: Topic::Keygraph,
                canvas: draw::keygraph(frame, &self.picture, pair),
                text: "One keygraph of the picture (left) and the one of the frame that it was matched to (right), turned, \
                       scaled and tilted to one shape. Its feature is light and colour in and around the triangle."
                    .into(),
            });
        }
        let which = if self.best.is_some() { "best pose" } else { "heaviest candidate" };
        chapters.push(Chapter {
            topic: Topic::Matches,
            canvas: draw::matches(frame, &self.picture, &self.pairs),
            text: format!(
                "Each keygraph of the frame is compared with those of the picture that have its angles. {} matches look \
                 alike, in their surroundings too; {} of them agree with the {which}. Lines join some of those.",
                trace.votes.len(),
                self.pairs.len()
            ),
        });
        let weights: Vec<_> = trace.candidates.iter().take(3).map(|c| c.weight.to_string()).collect();
        chapters.push(Chapter {
            topic: Topic::Votes,
            canvas: draw::votes(frame, trace),
            text: format!(
                "Each match votes for a place, a size and a rotation. A dot is where a vote puts the middle of the object; \
                 right votes lie on one spot, wrong ones anywhere. {} candidates (red circles, the heaviest filled), with \
                 weights of {}.",
                trace.candidates.len(),
                if weights.is_empty() { "nothing".into() } else { weights.join(", ") }
            ),
        });
        chapters.push(Chapter {
            topic: Topic::Poses,
            canvas: draw::poses(frame, &trace.aligned, &self.found),
            text: format!(
                "Candidates grow over the corners that agree, and are aligned to the frame by its gradients: {} grew, and \
                 {} could be aligned (red). What is believed is green.",
                trace.grown,
                trace.aligned.len()
            ),
        });
        if let (Some(d), Some((canvas, share))) = (self.best, &self.look) {
            chapters.push(Chapter {
                topic: Topic::Look,
                canvas: canvas.clone(),
                text: format!(
                    "The picture, what the frame shows at the {}, and block by block whether the two agree (green) or not \
                     (red): {:.0} % of the blocks with texture do. The score is {:.2}: what agrees speaks for the object, and \
                     what contradicts speaks against it.",
                    if self.found.is_empty() { "best pose, which is not believed" } else { "pose" },
                    100.0 * share,
                    d.score
                ),
            });
        }
        chapters
    }

    fn advice(&self, trials: &[(&str, Found)], (width, height): (u32, u32)) -> Vec<String> {
        let mut advice = Vec::new();
        if !self.found.is_empty() {
            return advice;
        }
        for (option, found) in trials {
            let score = found.detections.first().map_or(0.0, |d| d.score);
            advice.push(format!("`detect {option}` finds it, with a score of {score:.2}."));
        }
        let luma = mean_luma(&self.shown);
        if luma < DARK {
            advice.push(format!(
                "The frame is dark: its mean is {luma:.0} of 255. Give more light, or a longer exposure."
            ));
        }
        if self.trace.corners() < FEW_CORNERS {
            advice.push(format!(
                "The frame has {} corners, and photographs have 300 and more: it is blurred, dark or plain. Focus, hold \
                 the camera still, or go nearer.",
                self.trace.corners()
            ));
        }
        let [w, h] = [self.shown.width(), self.shown.height()];
        if trials.is_empty() && width > w {
            advice.push(format!(
                "The frame was scaled from {width}x{height} to {w}x{h} px. A small object has more pixels with {}--roi \
                 around its place.",
                if self.request.profile == Profile::Hd { "" } else { "--profile hd, or with " }
            ));
        }
        let share = self.look.as_ref().map_or(0.0, |(_, share)| *share);
        if let Some(d) = self.best.filter(|d| d.score >= NEARLY && share >= LOOKS_RIGHT) {
            let lowest = (d.score * 20.0).floor() / 20.0;
            advice.push(format!(
                "Look at the outline and at the last picture. If they are right, a part of the object is hidden, bent, or \
                 in glare: show more of it, or search with --threshold {lowest:.2}."
            ));
        } else if trials.is_empty() {
            advice.push(
                "Is the object in the frame at all? It should be 75 px or larger, tilted by 80 degrees or less, and half \
                 of it or more should be seen."
                    .into(),
            );
        }
        advice.push("How well the picture can be found at all: keygraph assess PICTURE.".into());
        advice
    }
}

/// The mean of green, which is near that of luma, of 255.
fn mean_luma(canvas: &Canvas) -> f32 {
    let pixels = canvas.rgb().as_chunks::<3>().0;
    pixels.iter().map(|p| f32::from(p[1])).sum::<f32>() / pixels.len().max(1) as f32
}
