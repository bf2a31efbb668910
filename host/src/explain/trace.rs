//! What each stage of a search made, kept for people to look at.
//!
//! In: the outputs that a detector shows its observer. Out: a [`Trace`], in px of the frame that was searched.
//! Tiles are left out: the trace is that of the whole frame. Memory: copies of the outputs. Cost: the copies.

use keygraph_core::stages::geometry::Point;
use keygraph_core::stages::hough::Candidate;
use keygraph_core::stages::pyramid::to_level0;
use keygraph_core::stages::vote::Vote;
use keygraph_core::{Detection, Homography, Model, Observer, Output};

/// A triangle.
pub type Triangle = [[f32; 2]; 3];

/// A pyramid level that was searched.
#[derive(Debug, Default)]
pub struct Level {
    /// 0 is the frame's own size, 1 is half of it, and so on.
    pub level: u8,
    /// Corners of the level.
    pub corners: Vec<[f32; 2]>,
    /// Triangles of its nested triangulations.
    pub triangles: Vec<Triangle>,
    /// Number of triangles that are keygraphs.
    pub keygraphs: usize,
}

/// What a search made of a frame.
#[derive(Debug, Default)]
pub struct Trace {
    /// Levels in the order in which they were searched, the coarse ones first.
    pub levels: Vec<Level>,
    /// All votes.
    pub votes: Vec<Vote>,
    /// Poses with the most votes, heaviest first, as they were when they were looked at last.
    pub candidates: Vec<Candidate>,
    /// Number of candidates that were grown, with each of the priors.
    pub grown: usize,
    /// Poses that were aligned to the frame.
    pub aligned: Vec<Detection>,
    /// Number of corners of levels without keygraphs.
    unplaced: usize,
    /// Corners and triples of the level that is being searched.
    points: Vec<Point>,
    triples: Vec<[u16; 3]>,
    /// Whether the search has gone on in tiles.
    in_tiles: bool,
}

impl Observer for Trace {
    fn now(&mut self) -> u64 {
        0
    }

    fn saw(&mut self, output: Output<'_>) {
        match output {
            Output::Corners(points) => self.points = points.to_vec(),
            Output::Triangles(triples) => self.triples = triples.to_vec(),
            Output::Keygraphs(keygraphs) => {
                // Nothing says which level has no keygraphs.
                let Some(level) = keygraphs.first().map(|k| k.level) else {
                    self.unplaced += self.points.len();
                    return;
                };
                self.in_tiles |= self.levels.iter().any(|l| l.level == level);
                if !self.in_tiles {
                    let corners: Vec<_> = self.points.iter().map(|&p| to_level0(p, usize::from(level))).collect();
                    let triangles = self.triples.iter().map(|t| t.map(|i| corners[usize::from(i)])).collect();
                    self.levels.push(Level { level, corners, triangles, keygraphs: keygraphs.len() });
                }
            }
            Output::Votes(votes) if !self.in_tiles => self.votes.extend_from_slice(votes),
            Output::Candidates(candidates) if !self.in_tiles && !candidates.is_empty() => {
                self.candidates = candidates.to_vec();
            }
            Output::Grown(Some(_)) if !self.in_tiles => self.grown += 1,
            Output::Aligned(Some(d)) if !self.in_tiles => self.aligned.push(*d),
            _ => {}
        }
    }
}

/// A keygraph of the picture beside the one of the frame that it was matched to.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Vertices in the picture, px.
    pub picture: Triangle,
    /// Vertices in the frame, px.
    pub frame: Triangle,
}

/// Largest distance of a vertex from where a pose puts it, as a share of the object's size in the frame.
const NEAR: f32 = 0.05;

impl Trace {
    /// The matches whose vertices lie where a pose puts them, largest triangles first. `keygraphs` are those of the
    /// frame ([`keygraph_core::Detector::keygraphs`]).
    #[must_use]
    pub fn pairs(&self, model: &Model<'_>, homography: &Homography, object: u16, keygraphs: &[Triangle]) -> Vec<Pair> {
        let size = {
            let o = model.object(usize::from(object));
            area(&homography.outline(o.width as f32, o.height as f32)).sqrt()
        };
        let near = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) < NEAR * size;
        let pair = |vote: &Vote| {
            let (view, points) = model.keygraph(vote.model_keygraph as usize);
            let to_picture = model.view(view).to_picture;
            let picture = points.map(|p| to_picture.apply(p.px()));
            let frame = *keygraphs.get(usize::from(vote.frame_keygraph))?;
            let agrees = (0..3).all(|i| near(homography.apply(picture[i]), frame[i]));
            agrees.then_some(Pair { picture, frame })
        };
        let mut pairs: Vec<_> = self.votes.iter().filter(|v| v.object == object).filter_map(pair).collect();
        pairs.sort_by(|a, b| area(&b.frame).total_cmp(&area(&a.frame)));
        pairs.dedup_by(|a, b| a.frame == b.frame);
        pairs
    }

    /// Number of corners on all levels.
    #[must_use]
    pub fn corners(&self) -> usize {
        self.unplaced + self.levels.iter().map(|l| l.corners.len()).sum::<usize>()
    }

    /// Number of keygraphs on all levels.
    #[must_use]
    pub fn keygraphs(&self) -> usize {
        self.levels.iter().map(|l| l.keygraphs).sum()
    }
}

/// The area of a polygon, square px, whichever way it runs.
pub fn area(polygon: &[[f32; 2]]) -> f32 {
    keygraph_core::stages::geometry::area(polygon).abs()
}

/// The homography of a similarity pose: from px of the picture to px of the frame.
#[must_use]
pub fn homography(model: &Model<'_>, candidate: &Candidate) -> Homography {
    let object = model.object(usize::from(candidate.object));
    let (w, h) = (object.width as f32, object.height as f32);
    let scale = candidate.pose.size_px() / (w * h).sqrt();
    let [x, y] = candidate.pose.centre;
    let to_origin = Homography::affine([1.0, 0.0, -(w - 1.0) / 2.0, 0.0, 1.0, -(h - 1.0) / 2.0]);
    let scaled = Homography::scaling([scale; 2]).after(&to_origin);
    Homography::affine([1.0, 0.0, x, 0.0, 1.0, y]).after(&candidate.pose.turn().after(&scaled))
}
