//! Smooths outlines from frame to frame.
//!
//! In: the detections of a frame, with the numbers that a tracker gave them. Out: the same, each moved towards where the
//! frames before had it. An outline that stands still is averaged over some frames; one that moves is taken as it is: the
//! farther it is from the average, in halves of a pixel, the more the new one counts. So the average lags by less
//! than a pixel of the searched frame, however fast an object moves, and jumps are followed at once.
//!
//! Memory: 1 KB for each instance. Cost: some hundred nanoseconds for each.

use std::collections::HashMap;

use keygraph_core::{Detection, Homography, Model, Surface};

/// Distance from the average at which the new outline counts twice, px of the searched frame.
const NEAR_PX: f32 = 0.5;

type Corners = [[f32; 2]; 4];

/// What is known of an instance from the frames before.
#[derive(Clone, Debug)]
struct Known {
    corners: Corners,
    surface: Option<Surface>,
}

/// The averages of all instances of a sequence.
#[derive(Clone, Debug, Default)]
pub struct Smoother {
    known: HashMap<u32, Known>,
}

impl Smoother {
    /// Smooths the outlines and surfaces of a frame over about `frames` frames. `seen` are its instances: number,
    /// outline, and surface where there is one. An instance that was not in the frame before is taken as it is.
    pub fn smooth<'a>(
        &mut self,
        seen: impl Iterator<Item = (u32, &'a mut Detection, Option<&'a mut Surface>)>,
        model: &Model<'_>,
        frames: u8,
    ) {
        let mut now = HashMap::new();
        for (id, d, mut surface) in seen {
            let object = model.object(usize::from(d.object));
            let size = [object.width as f32, object.height as f32];
            if let Some(before) = self.known.remove(&id) {
                let share = share(&before.corners, &d.corners, frames);
                *d = at(d, &mean(&before.corners, &d.corners, share), size);
                if let (Some(then), Some(surface)) = (&before.surface, &mut surface) {
                    bend(then, surface, size, frames);
                }
            }
            now.insert(id, Known { corners: d.corners, surface: surface.copied() });
        }
        self.known = now;
    }
}

/// A detection at another place.
fn at(d: &Detection, corners: &Corners, size: [f32; 2]) -> Detection {
    let mut moved = *d;
    (moved.corners, moved.homography) = (*corners, Homography::onto(corners, size).normalised());
    moved
}

/// Moves a surface towards where it was, grid and plane.
fn bend(before: &Surface, now: &mut Surface, [w, h]: [f32; 2], frames: u8) {
    let share = share(&before.points, &now.points, frames);
    now.points = mean(&before.points, &now.points, share);
    let planes = [before, now].map(|s| s.homography.outline(w, h));
    now.homography = Homography::onto(&mean(&planes[0], &planes[1], share), [w, h]).normalised();
}

/// The share with which new places count beside the average of those before.
fn share<const N: usize>(before: &[[f32; 2]; N], now: &[[f32; 2]; N], frames: u8) -> f32 {
    let distance = |(a, b): (&[f32; 2], &[f32; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
    let far = before.iter().zip(now).map(distance).sum::<f32>() / N as f32 / NEAR_PX;
    let new = 1.0 + far * far;
    new / (new + f32::from(frames))
}

/// Places between those before and the new ones.
fn mean<const N: usize>(before: &[[f32; 2]; N], now: &[[f32; 2]; N], share: f32) -> [[f32; 2]; N] {
    core::array::from_fn(|i| [0, 1].map(|k| before[i][k] + share * (now[i][k] - before[i][k])))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: Corners = [[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]];
    const FRAMES: u8 = 8;

    fn moved(by: [f32; 2]) -> Corners {
        SQUARE.map(|p| [p[0] + by[0], p[1] + by[1]])
    }

    /// The averages of places along a line, px.
    fn averages(places: impl Iterator<Item = f32>) -> Vec<f32> {
        let mut before = None;
        let next = |x: f32| {
            let now = moved([x, 0.0]);
            let average = before.map_or(now, |b: Corners| mean(&b, &now, share(&b, &now, FRAMES)));
            before = Some(average);
            average[0][0]
        };
        places.map(next).collect()
    }

    #[test]
    fn what_trembles_is_averaged() {
        // Noise that repeats after 37 frames, of 0.1 px.
        let noise = |i: usize| ((i * 17 % 37) as f32 / 18.0 - 1.0) * 0.17;
        let still = averages((0..400).map(noise));
        let spread = |v: &[f32]| (v.iter().map(|x| x * x).sum::<f32>() / v.len() as f32).sqrt();
        let raw: Vec<f32> = (0..400).map(noise).collect();
        assert!(spread(&still[100..]) < 0.4 * spread(&raw[100..]), "{} of {}", spread(&still[100..]), spread(&raw));
    }

    #[test]
    fn no_motion_leaves_the_average_behind_by_more_than_a_pixel() {
        for speed in [0.02, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0] {
            let at = averages((0..200).map(|i| speed * i as f32));
            let lag = speed * 199.0 - at[199];
            assert!((0.0..0.8).contains(&lag), "{speed} px a frame: {lag} px behind");
        }
    }

    #[test]
    fn a_jump_is_followed_at_once() {
        let at = averages((0..60).map(|i| if i < 50 { 0.0 } else { 25.0 }));
        assert!((at[50] - 25.0).abs() < 0.1, "{}", at[50]);
    }

    #[test]
    fn the_map_of_an_outline_follows_its_corners() {
        let h = Homography::affine([1.0, 0.0, 5.0, 0.0, 1.0, 7.0]);
        let d = Detection::new(3, &h, [100.0; 2]);
        let there = at(&d, &moved([6.0, 7.5]), [100.0; 2]);
        let shown = there.homography.outline(100.0, 100.0);
        for (a, b) in shown.iter().zip(there.corners) {
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-3, "{shown:?}");
        }
        assert_eq!((there.object, there.score), (d.object, d.score));
    }
}
