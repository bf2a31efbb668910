//! Rendered sequences of a picture that moves before the camera, with its true pose
//! in every frame.
//!
//! In: a picture, and what happens. Out: frames, each with the homographies of the
//! copies in it.

use keygraph::input::{Picture, read_picture};
use keygraph::render::{Exposure, Pose, Print, Random, Scene};
use keygraph_core::geometry::{Homography, area, contains};

use crate::file;

/// What happens in a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Nothing moves.
    Still,
    /// It goes about at up to 8 px a frame, turning, tilting, coming and going.
    Slow,
    /// It goes about at up to 30 px a frame.
    Fast,
    /// It moves by 25 px at once, and stands for a third of a second.
    Jumps,
    /// It leaves the frame and comes back elsewhere.
    Leaving,
    /// Something passes before it until nothing is left to see.
    Hidden,
    /// Two copies pass each other.
    Copies,
}

impl Motion {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Still, Self::Slow, Self::Fast, Self::Jumps, Self::Leaving, Self::Hidden, Self::Copies];

    /// Frames after which it begins again.
    const PERIOD: usize = 120;

    /// Where the copies are in frame `i`, of 640 x 480 px.
    fn poses(self, i: usize) -> Vec<Pose> {
        let t = (i % Self::PERIOD) as f32 / Self::PERIOD as f32;
        let wave = |times: f32, phase: f32| (core::f32::consts::TAU * (times * t + phase)).sin();
        let still = Pose { side_px: 220.0, rotation_deg: 12.0, tilt_deg: 25.0, axis_deg: 40.0, centre: [318.3, 241.7] };
        let at = |x: f32, y: f32| Pose { centre: [x, y], ..still };
        match self {
            Self::Still | Self::Hidden => vec![still],
            Self::Slow => vec![Pose {
                side_px: 220.0 + 60.0 * wave(1.0, 0.1),
                rotation_deg: 12.0 + 60.0 * wave(1.0, 0.3),
                tilt_deg: 20.0 + 15.0 * wave(2.0, 0.6),
                axis_deg: 40.0 + 80.0 * wave(1.0, 0.0),
                ..at(320.0 + 120.0 * wave(1.0, 0.0), 240.0 + 60.0 * wave(2.0, 0.2))
            }],
            Self::Fast => vec![Pose {
                rotation_deg: 12.0 + 40.0 * wave(2.0, 0.3),
                ..at(320.0 + 190.0 * wave(3.0, 0.0), 240.0 + 80.0 * wave(2.0, 0.2))
            }],
            Self::Jumps => {
                let n = (i / 10 % 4) as f32;
                vec![at(280.0 + 18.0 * n, 220.0 + 18.0 * n)]
            }
            Self::Leaving => {
                // Out to the right, in again from the left, lower.
                let x = 320.0 + 900.0 * t;
                vec![if x < 770.0 { at(x, 240.0) } else { at(x - 900.0, 280.0) }]
            }
            Self::Copies => {
                let smaller = |x: f32, y: f32| Pose { side_px: 150.0, ..at(x, y) };
                vec![smaller(320.0 + 200.0 * wave(1.0, 0.0), 120.0), smaller(320.0 - 200.0 * wave(1.0, 0.0), 350.0)]
            }
        }
    }

    /// The rectangle that something covers in frame `i`: corner and size, px.
    fn cover(self, i: usize) -> Option<[[f32; 2]; 2]> {
        let x = -300.0 + (i % Self::PERIOD) as f32 * 10.0;
        (self == Self::Hidden).then_some([[x, 20.0], [300.0, 440.0]])
    }
}

/// A frame and what is in it.
#[derive(Debug)]
pub struct Shot {
    /// The frame.
    pub picture: Picture,
    /// The true outline of each copy, frame px, and the part of it that is seen.
    pub copies: Vec<([[f32; 2]; 4], f32)>,
}

/// A motion of one picture, before dead leaves.
#[derive(Debug)]
pub struct Sequence {
    motion: Motion,
    exposure: Exposure,
    background: Scene,
    print: Print,
    size: (f32, f32),
    seed: u64,
}

impl Sequence {
    /// Frames of 640 x 480 px of `picture`; each channel has noise of this spread, of
    /// 255.
    #[must_use]
    pub fn new(picture: &Picture, motion: Motion, noise: f32, seed: u64) -> Self {
        Self {
            motion,
            exposure: Exposure { gain: 0.9, blur_px: 0.7, noise },
            background: Scene::dead_leaves(640, 480, &mut Random::of(&[seed, 1])),
            print: Print::new(picture),
            size: (picture.width as f32, picture.height as f32),
            seed,
        }
    }

    /// Frame `i`; the same whatever was asked for before.
    #[must_use]
    pub fn shot(&self, i: usize) -> Shot {
        let mut random = Random::of(&[self.seed, 2, i as u64]);
        let mut scene = self.background.clone();
        let poses: Vec<Homography> = self.motion.poses(i).iter().map(|p| scene.lay(&self.print, p)).collect();
        let cover = self.motion.cover(i);
        if let Some([corner, size]) = cover {
            // It looks the same in every frame.
            scene.cover(corner, size, &mut Random::of(&[self.seed, 3]));
        }
        let copies = poses.iter().map(|h| {
            let outline = h.outline(self.size.0, self.size.1);
            (outline, seen(&outline, cover))
        });
        Shot { copies: copies.collect(), picture: scene.expose(&self.exposure, &mut random) }
    }
}

/// The part of an outline that lies in the frame and is not covered.
fn seen(outline: &[[f32; 2]; 4], cover: Option<[[f32; 2]; 2]>) -> f32 {
    let covered = |x: f32, y: f32| cover.is_some_and(|[[a, b], [w, h]]| x >= a && x < a + w && y >= b && y < b + h);
    let inside = |i: usize| {
        let (x, y) = ((i % 160 * 4) as f32 + 2.0, (i / 160 * 4) as f32 + 2.0);
        contains(outline, [x, y]) && !covered(x, y)
    };
    16.0 * (0..160 * 120).filter(|&i| inside(i)).count() as f32 / area(outline)
}

/// The picture that the sequences show.
///
/// # Panics
/// When it is not there.
#[must_use]
#[allow(clippy::unwrap_used, reason = "a missing picture ends the test")]
pub fn astronaut() -> Picture {
    read_picture(&file("assets/pictures/astronaut.jpg")).unwrap()
}
