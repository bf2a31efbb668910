//! Rendered sequences of a picture that moves before the camera. The true pose is known in every frame.
//!
//! In: a picture and a motion. Out: frames, each with the true outlines of the copies in it.

use keygraph::input::{Picture, read_picture};
use keygraph::random::Random;
use keygraph::render::{Exposure, Pose, Print, Scene};
use keygraph_core::Homography;
use keygraph_core::stages::geometry::{area, contains};

use crate::file;

/// The motion of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Nothing moves.
    Still,
    /// The object moves at up to 8 px per frame. It turns, tilts, and changes its distance.
    Slow,
    /// The object moves at up to 30 px per frame.
    Fast,
    /// The object jumps by 25 px, and then stands still for a third of a second.
    Jumps,
    /// The object leaves the frame and comes back at another place.
    Leaving,
    /// A cover passes before the object until nothing of the object is seen.
    Hidden,
    /// Two copies pass each other.
    Copies,
}

impl Motion {
    /// All motions.
    pub const ALL: [Self; 7] =
        [Self::Still, Self::Slow, Self::Fast, Self::Jumps, Self::Leaving, Self::Hidden, Self::Copies];

    /// Number of frames after which a motion repeats.
    const PERIOD: usize = 120;

    /// Returns the poses of the copies in frame `i`. The frame has 640 x 480 px.
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
                // The object leaves at the right, and comes in again from the left and lower.
                let x = 320.0 + 900.0 * t;
                vec![if x < 770.0 { at(x, 240.0) } else { at(x - 900.0, 280.0) }]
            }
            Self::Copies => {
                let smaller = |x: f32, y: f32| Pose { side_px: 150.0, ..at(x, y) };
                vec![smaller(320.0 + 200.0 * wave(1.0, 0.0), 120.0), smaller(320.0 - 200.0 * wave(1.0, 0.0), 350.0)]
            }
        }
    }

    /// Returns the rectangle that is covered in frame `i`: corner and size, px.
    fn cover(self, i: usize) -> Option<[[f32; 2]; 2]> {
        let x = -300.0 + (i % Self::PERIOD) as f32 * 10.0;
        (self == Self::Hidden).then_some([[x, 20.0], [300.0, 440.0]])
    }
}

/// A frame and the copies in it.
#[derive(Debug)]
pub struct Shot {
    /// The frame.
    pub picture: Picture,
    /// The true outline of each copy in frame px, and the part of it that is seen, 0 to 1.
    pub copies: Vec<([[f32; 2]; 4], f32)>,
}

/// A motion of one picture before a background of dead leaves.
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
    /// Creates a sequence that shows `picture` in frames of 640 x 480 px. `noise` is the spread of
    /// the noise in each channel, of 255.
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

    /// Renders frame `i`. The result does not depend on earlier calls.
    #[must_use]
    pub fn shot(&self, i: usize) -> Shot {
        let mut random = Random::of(&[self.seed, 2, i as u64]);
        let mut scene = self.background.clone();
        let poses: Vec<Homography> = self.motion.poses(i).iter().map(|p| scene.lay(&self.print, p)).collect();
        let cover = self.motion.cover(i);
        if let Some([corner, size]) = cover {
            // The cover looks the same in every frame.
            scene.cover(corner, size, &mut Random::of(&[self.seed, 3]));
        }
        let copies = poses.iter().map(|h| {
            let outline = h.outline(self.size.0, self.size.1);
            (outline, seen(&outline, cover))
        });
        Shot { copies: copies.collect(), picture: scene.expose(&self.exposure, &mut random) }
    }
}

/// Returns the part of an outline that lies in the frame and is not covered, 0 to 1.
fn seen(outline: &[[f32; 2]; 4], cover: Option<[[f32; 2]; 2]>) -> f32 {
    let covered = |x: f32, y: f32| cover.is_some_and(|[[a, b], [w, h]]| x >= a && x < a + w && y >= b && y < b + h);
    let inside = |i: usize| {
        let (x, y) = ((i % 160 * 4) as f32 + 2.0, (i / 160 * 4) as f32 + 2.0);
        contains(outline, [x, y]) && !covered(x, y)
    };
    16.0 * (0..160 * 120).filter(|&i| inside(i)).count() as f32 / area(outline)
}

/// Reads the picture that the sequences show.
///
/// # Panics
/// Panics if the picture cannot be read.
#[must_use]
#[allow(clippy::unwrap_used, reason = "a missing picture ends the test")]
pub fn astronaut() -> Picture {
    read_picture(&file("assets/pictures/astronaut.jpg")).unwrap()
}
