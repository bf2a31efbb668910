//! Matches vote for a pose of their object.
//!
//! In: a match, and its vertices in the view and in the frame. Out: a [`Vote`]. The similarity that
//! maps the three vertices best (least squares) gives the middle of the object, its rotation and
//! its size. [`Votes`] keeps the votes of a frame: first the votes that support a detection, then
//! the open votes.
//!
//! Memory: 24 bytes for each vote. Cost: about 100 operations for each match. Full: further votes
//! are counted as dropped.

use heapless::{Vec, VecView};

use crate::base::geometry::Homography;
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::classify::Match;
use crate::model::parse::{Object, View};

/// A pose as a similarity: position of the object's middle, rotation and size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Similarity {
    /// Middle of the picture in the frame, px.
    pub centre: [f32; 2],
    /// Rotation from the x axis towards the y axis; 65,536 is a full turn.
    pub rotation: u16,
    /// Size in the frame (square root of the area): `256 log2(px)`.
    pub size: i16,
}

impl Similarity {
    /// Size in the frame (square root of the area), px.
    #[must_use]
    pub fn size_px(&self) -> f32 {
        math::exp(f32::from(self.size) * (core::f32::consts::LN_2 / 256.0))
    }

    /// Rotation, radians.
    #[must_use]
    pub fn radians(&self) -> f32 {
        f32::from(self.rotation) * (core::f32::consts::TAU / 65536.0)
    }

    /// Rotation of the pose as a homography, without its size and position.
    #[inline(never)]
    #[must_use]
    pub fn turn(&self) -> Homography {
        let (sin, cos) = math::sin_cos(self.radians());
        Homography::affine([cos, -sin, 0.0, sin, cos, 0.0])
    }
}

/// A match and the pose that it votes for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Vote {
    /// Pose that the match votes for.
    pub pose: Similarity,
    /// Index of the model keygraph.
    pub model_keygraph: u32,
    /// Index of the frame keygraph.
    pub frame_keygraph: u16,
    /// Index of the object.
    pub object: u16,
    /// Weight of the vote, 1 to 16.
    pub weight: u8,
}

/// Returns the pose that maps the vertices `from` of a view to the vertices `to` of the frame best,
/// by least squares, both in px. `object_size` is the square root of the picture's area, px. `None`
/// for degenerate vertices.
#[must_use]
pub fn similarity(view: &View, object_size: f32, from: [[f32; 2]; 3], to: [[f32; 2]; 3]) -> Option<Similarity> {
    let mean = |p: &[[f32; 2]; 3], i: usize| (p[0][i] + p[1][i] + p[2][i]) / 3.0;
    let (fx, fy, tx, ty) = (mean(&from, 0), mean(&from, 1), mean(&to, 0), mean(&to, 1));
    // The similarity is z = sum(conj(from) * to) / sum(|from|^2), as complex numbers.
    let (mut re, mut im, mut norm) = (0.0, 0.0, 0.0);
    for (f, t) in from.iter().zip(&to) {
        let (ax, ay, bx, by) = (f[0] - fx, f[1] - fy, t[0] - tx, t[1] - ty);
        re += ax * bx + ay * by;
        im += ax * by - ay * bx;
        norm += ax * ax + ay * ay;
    }
    let (re, im) = (re / norm, im / norm);
    let scale2 = re * re + im * im;
    if !(scale2 > 1e-6 && scale2 < 1e6) {
        return None;
    }
    let (cx, cy) = (view.centre[0] - fx, view.centre[1] - fy);
    let size = math::coarse_sqrt(scale2) * view.scale * object_size;
    let turns = math::coarse_atan2(im, re) * (65536.0 / core::f32::consts::TAU);
    Some(Similarity {
        centre: [tx + re * cx - im * cy, ty + re * cy + im * cx],
        rotation: math::round(turns).rem_euclid(65536).try_into().unwrap_or(0),
        size: i16::try_from(math::round(math::log2(size.max(1.0)) * 256.0)).unwrap_or(i16::MAX),
    })
}

/// Makes the vote of a match. `from` are the match's vertices in `view` of `object`, px. `to` are
/// the vertices of the frame keygraph in level 0, px. `None` for degenerate vertices.
#[must_use]
pub fn cast(
    object: &Object<'_>,
    view: &View,
    m: Match,
    frame_keygraph: u16,
    [from, to]: [[[f32; 2]; 3]; 2],
    weight: u8,
) -> Option<Vote> {
    let object_size = math::coarse_sqrt(object.width as f32 * object.height as f32);
    let pose = similarity(view, object_size, from, to)?;
    Some(Vote { pose, model_keygraph: m.keygraph, frame_keygraph, object: view.object, weight })
}

/// The votes of a frame: first the supporters, which agree with a detection, then the open votes,
/// which may still lead to a detection.
///
/// Invariant: the first `supporters` votes of `list` are the supporters, and `supporters` is at
/// most the length of `list`. The owner holds `Votes<Vec<Vote, N>>`, and functions take
/// `Votes<VecView<Vote>>`.
#[derive(Debug)]
pub struct Votes<L: ?Sized> {
    supporters: usize,
    list: L,
}

impl<const N: usize> Votes<Vec<Vote, N>> {
    /// Creates an empty list of votes.
    #[must_use]
    pub const fn new() -> Self {
        Self { supporters: 0, list: Vec::new() }
    }

    /// All votes, supporters first.
    #[must_use]
    pub fn all(&self) -> &[Vote] {
        &self.list
    }
}

impl<const N: usize> Default for Votes<Vec<Vote, N>> {
    fn default() -> Self {
        Self::new()
    }
}

impl Votes<VecView<Vote>> {
    /// All votes, supporters first.
    #[must_use]
    pub fn all(&self) -> &[Vote] {
        &self.list
    }

    /// Open votes: those that agree with no detection so far.
    #[must_use]
    pub fn open(&self) -> &[Vote] {
        &self.list[self.supporters..]
    }

    /// Open votes, mutable so that they can be sorted.
    pub fn open_mut(&mut self) -> &mut [Vote] {
        &mut self.list[self.supporters..]
    }

    /// Removes all votes.
    pub fn clear(&mut self) {
        self.supporters = 0;
        self.list.clear();
    }

    /// Adds an open vote.
    ///
    /// # Errors
    /// Returns the vote when there is no room for it.
    pub fn cast(&mut self, vote: Vote) -> Result<(), Vote> {
        self.list.push(vote)
    }

    /// Makes every vote for which `supports` is true a supporter, and every other vote an open one.
    /// Open votes for which `is_spent` is true are removed.
    pub fn settle(&mut self, supports: impl Fn(&Vote) -> bool, is_spent: impl Fn(&Vote) -> bool, pace: &mut dyn Pace) {
        let mut supporters = 0;
        for i in 0..self.list.len() {
            pace.goes_on();
            if supports(&self.list[i]) {
                self.list.swap(i, supporters);
                supporters += 1;
            }
        }
        self.supporters = supporters;
        let mut i = 0;
        self.list.retain(|v| {
            pace.goes_on();
            i += 1;
            i <= supporters || !is_spent(v)
        });
    }

    /// Removes the open votes.
    pub fn drop_open(&mut self) {
        self.list.truncate(self.supporters);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;

    #[test]
    fn a_similarity_is_read_off_three_vertices() {
        let view = View {
            object: 0,
            keypoints: 3,
            first: 0,
            to_picture: Homography::IDENTITY,
            centre: [50.0, 40.0],
            scale: 0.5,
        };
        // A quarter turn, twice as large, moved by (300, 20).
        let to = |[x, y]: [f32; 2]| [300.0 - 2.0 * y, 20.0 + 2.0 * x];
        let from = [[10.0, 10.0], [70.0, 20.0], [30.0, 60.0]];
        let s = similarity(&view, 100.0, from, from.map(to)).unwrap();
        assert!((s.centre[0] - 220.0).abs() < 1e-3 && (s.centre[1] - 120.0).abs() < 1e-3, "{s:?}");
        assert!(s.rotation.abs_diff(16384) < 32, "{s:?}");
        assert!((s.size_px() - 100.0).abs() < 0.2, "2 * 0.5 * 100, not {}", s.size_px());
        assert!(similarity(&view, 100.0, [[5.0, 5.0]; 3], from).is_none());
    }

    #[test]
    fn supporters_come_first_and_open_votes_stay_in_order() {
        let vote = |i: u16| Vote { frame_keygraph: i, ..Vote::default() };
        let mut owner: Votes<Vec<Vote, 8>> = Votes::new();
        let votes: &mut Votes<VecView<Vote>> = &mut owner;
        for i in 0..8 {
            votes.cast(vote(i)).unwrap();
        }
        assert!(votes.cast(vote(8)).is_err(), "full");
        votes.settle(|v| v.frame_keygraph % 3 == 2, |v| v.frame_keygraph == 4, &mut Steady);
        let ids = |votes: &[Vote]| votes.iter().map(|v| v.frame_keygraph).collect::<std::vec::Vec<_>>();
        assert_eq!(ids(votes.all()), [2, 5, 0, 3, 1, 6, 7]);
        assert_eq!(ids(votes.open()), [0, 3, 1, 6, 7]);
        votes.drop_open();
        assert_eq!((ids(votes.all()), votes.open().len()), (std::vec![2, 5], 0));
        votes.settle(|_| false, |_| false, &mut Steady);
        assert_eq!(ids(votes.open()), [2, 5], "a supporter can become open again");
    }
}
