//! Holds luma and chroma of one frame with their half-size levels.
//!
//! In: a checked [`Frame`]. Out: [`LEVELS`] levels of luma and of both chroma planes. Each level is
//! the 2x2 mean of the level below it. A mean of chroma leaves out blocks that have no chroma.
//! Level `l` of a `w` x `h` frame has `(w >> l)` x `(h >> l)` px of luma and `(w / 2 >> l)` x
//! `(h / 2 >> l)` px of chroma.
//!
//! Memory: `LUMA + 2 * CHROMA` bytes. Cost: one pass over a third more pixels than the frame has.
//! Full: this cannot happen, because a frame that does not fit is refused.

use crate::base::capacity::{LEVELS, pixels_of};
use crate::base::geometry::{Homography, Point};
use crate::base::pace::{Pace, Steady};
use crate::image::frame::{Frame, FrameError, MAX_SIDE, Window};
use crate::image::halve::{halve_chroma, halve_luma};
use crate::image::plane::Plane;

/// Owns the planes of one frame.
#[derive(Debug)]
pub struct Pyramid<const LUMA: usize, const CHROMA: usize> {
    /// Width and height of level 0, px.
    size: [usize; 2],
    luma: [u8; LUMA],
    chroma: [[i8; CHROMA]; 2],
}

impl<const LUMA: usize, const CHROMA: usize> Default for Pyramid<LUMA, CHROMA> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const LUMA: usize, const CHROMA: usize> Pyramid<LUMA, CHROMA> {
    /// Makes an empty pyramid. All its bytes are zero.
    #[must_use]
    pub const fn new() -> Self {
        Self { size: [0; 2], luma: [0; LUMA], chroma: [[0; CHROMA]; 2] }
    }

    /// Returns whether a frame of this size fits.
    #[must_use]
    pub const fn fits(width: usize, height: usize) -> bool {
        plane_bytes(width, height) <= LUMA && plane_bytes(width / 2, height / 2) <= CHROMA
    }

    /// Returns the planes for writing, without their const generics.
    pub fn planes_mut(&mut self) -> PyramidMut<'_> {
        let Self { size, luma, chroma: [a, b] } = self;
        PyramidMut { size, luma, chroma: [a, b] }
    }

    /// Returns a view for the stages.
    #[must_use]
    pub fn view(&self) -> PyramidView<'_> {
        let Self { size, luma, chroma: [a, b] } = self;
        PyramidView { width: size[0], height: size[1], luma, a, b }
    }
}

/// The planes of a [`Pyramid`], borrowed for writing.
#[derive(Debug)]
pub struct PyramidMut<'a> {
    /// Width and height of level 0, px.
    size: &'a mut [usize; 2],
    luma: &'a mut [u8],
    chroma: [&'a mut [i8]; 2],
}

impl<'a> PyramidMut<'a> {
    /// Returns whether a frame of this size fits.
    #[must_use]
    pub const fn fits(&self, width: usize, height: usize) -> bool {
        plane_bytes(width, height) <= self.luma.len() && plane_bytes(width / 2, height / 2) <= self.chroma[0].len()
    }

    /// Converts `frame` into level 0. [`PyramidMut::reduce`] makes the other levels.
    ///
    /// # Errors
    /// Returns [`FrameError::TooLarge`] when the frame does not fit.
    pub fn load(&mut self, frame: &Frame<'_>) -> Result<(), FrameError> {
        self.load_at(frame, &mut Steady)
    }

    /// Converts a frame as [`PyramidMut::load`] does.
    pub(crate) fn load_at(&mut self, frame: &Frame<'_>, pace: &mut dyn Pace) -> Result<(), FrameError> {
        let (w, h) = (frame.width(), frame.height());
        if !self.fits(w, h) {
            let (pixels, max_pixels) = (w * h, pixels_of(self.luma.len()));
            return Err(FrameError::TooLarge { pixels, max_pixels, side: w.max(h), max_side: MAX_SIDE });
        }
        *self.size = [w, h];
        let [a, b] = &mut self.chroma;
        frame.convert_at(self.luma, a, b, pace);
        Ok(())
    }

    /// Converts the luma of a part of a frame into level 0. The part must fit. The chroma planes
    /// keep their old bytes, which then mean nothing.
    pub(crate) fn load_luma(&mut self, frame: &Frame<'_>, part: Window) {
        *self.size = [part.width, part.height];
        frame.convert_luma_of(part, &mut self.luma[..part.width * part.height]);
    }

    /// Sets the size and returns level 0 for writing: luma, then both chroma planes. Returns `None`
    /// when the size does not fit.
    pub fn level0(&mut self, width: usize, height: usize) -> Option<(&mut [u8], &mut [i8], &mut [i8])> {
        if !self.fits(width, height) {
            return None;
        }
        *self.size = [width, height];
        let c = (width / 2) * (height / 2);
        let [a, b] = &mut self.chroma;
        Some((&mut self.luma[..width * height], &mut a[..c], &mut b[..c]))
    }

    /// Makes the levels above level 0.
    pub fn reduce(&mut self) {
        self.reduce_at(&mut Steady);
    }

    /// Makes the levels above level 0.
    pub(crate) fn reduce_at(&mut self, pace: &mut dyn Pace) {
        self.reduce_luma(pace);
        let [width, height] = *self.size;
        for plane in &mut self.chroma {
            reduce_chroma(plane, width / 2, height / 2, pace);
        }
    }

    /// Makes the luma levels above level 0.
    pub(crate) fn reduce_luma(&mut self, pace: &mut dyn Pace) {
        let [width, height] = *self.size;
        reduce_all(self.luma, width, height, halve_luma, pace);
    }

    /// Turns the planes into a view for the stages, which lives as long as the planes are borrowed.
    #[must_use]
    pub fn into_view(self) -> PyramidView<'a> {
        let Self { size: &mut [width, height], luma, chroma: [a, b] } = self;
        PyramidView { width, height, luma, a, b }
    }

    /// Returns a view for the stages.
    #[must_use]
    pub fn view(&self) -> PyramidView<'_> {
        let [width, height] = *self.size;
        let [a, b] = &self.chroma;
        PyramidView { width, height, luma: self.luma, a, b }
    }
}

/// Number of rows of a level that are made at a time.
const ROWS: usize = 16;

/// Makes the levels above level 0. Level 0 lies at the start of `data` and has `w` x `h` px. The
/// other levels follow it. `halve` makes one row of two.
pub(crate) fn reduce_all<T: Copy>(
    data: &mut [T],
    mut w: usize,
    mut h: usize,
    halve: impl Fn(&[T], &[T], &mut [T]),
    pace: &mut dyn Pace,
) {
    let mut rest = data;
    for _ in 1..LEVELS {
        let (source, target) = rest.split_at_mut(w * h);
        let (hw, hh) = (w / 2, h / 2);
        for (y, out) in target[..hw * hh].chunks_exact_mut(hw.max(1)).enumerate() {
            // A level is made to its end, so that what is known can be followed.
            if y % ROWS == 0 {
                pace.goes_on();
            }
            let (top, low) = source[2 * y * w..][..2 * w].split_at(w);
            halve(top, low, out);
        }
        rest = target;
        (w, h) = (hw, hh);
    }
}

/// Makes the levels above level 0 of a chroma plane. The function is not inlined, because boards
/// have room for one copy of it.
#[inline(never)]
fn reduce_chroma(plane: &mut [i8], width: usize, height: usize, pace: &mut dyn Pace) {
    reduce_all(plane, width, height, halve_chroma, pace);
}

/// All levels of one frame, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct PyramidView<'a> {
    width: usize,
    height: usize,
    luma: &'a [u8],
    a: &'a [i8],
    b: &'a [i8],
}

impl<'a> PyramidView<'a> {
    /// Returns the width of level 0, px.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Returns the height of level 0, px.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Returns the luma of level `level`.
    ///
    /// # Panics
    /// Panics when the view has no such level.
    #[must_use]
    pub fn luma(&self, level: usize) -> Plane<'a, u8> {
        level_of(self.luma, self.width, self.height, level)
    }

    /// Returns both chroma planes of level `level`. They have half the size of its luma.
    ///
    /// # Panics
    /// Panics when the view has no such level.
    #[must_use]
    pub fn chroma(&self, level: usize) -> [Plane<'a, i8>; 2] {
        [self.a, self.b].map(|p| level_of(p, self.width / 2, self.height / 2, level))
    }
}

/// Returns the number of bytes of all levels of a plane of this size, at one byte a pixel.
pub(crate) const fn plane_bytes(width: usize, height: usize) -> usize {
    let (mut bytes, mut l) = (0, 0);
    while l < LEVELS {
        bytes += (width >> l) * (height >> l);
        l += 1;
    }
    bytes
}

/// Returns level `level` of a plane whose level 0 has `width` x `height` px.
pub(crate) fn level_of<T>(data: &[T], width: usize, height: usize, level: usize) -> Plane<'_, T> {
    assert!(level < LEVELS, "a pyramid has {LEVELS} levels");
    let start = (0..level).map(|l| (width >> l) * (height >> l)).sum();
    let (width, height) = (width >> level, height >> level);
    Plane::of_first(&data[start..], width, height)
}

/// Returns the map from px of level 0 to px of level `level`.
#[must_use]
pub fn into_level(level: usize) -> Homography {
    Homography::scaling([1.0 / f32::from(1u8 << level); 2])
}

/// Returns the map from px of level `level` to px of level 0.
#[must_use]
pub fn out_of_level(level: usize) -> Homography {
    Homography::scaling([f32::from(1u8 << level); 2])
}

/// Returns the position in level 0, px, of the point `p` of level `level`. Pixel centres lie at
/// integers on both levels.
#[must_use]
pub fn to_level0(p: Point, level: usize) -> [f32; 2] {
    let scale = f32::from(1u8 << level);
    p.px().map(|v| v * scale + (scale - 1.0) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::pixels::{NO_CHROMA, PixelFormat};

    #[test]
    fn levels_are_means_of_the_level_below() {
        let mut data = [0u8; 18 * 16];
        data.iter_mut().enumerate().for_each(|(i, v)| *v = (i % 18 * 10) as u8);
        let mut p: Pyramid<400, 100> = Pyramid::new();
        p.planes_mut().load(&Frame::new(PixelFormat::Gray8, 18, 16, &data).unwrap()).unwrap();
        p.planes_mut().reduce();
        let v = p.view();
        assert_eq!(v.luma(1).row(3), [5, 25, 45, 65, 85, 105, 125, 145, 165]);
        assert_eq!(v.luma(2).row(0), [15, 55, 95, 135]);
        assert_eq!((v.chroma(2)[0].width(), v.chroma(2)[0].height()), (2, 2));
        assert_eq!(v.chroma(1)[1].nearest(9, 9), NO_CHROMA);
    }

    #[test]
    fn a_frame_that_does_not_fit_is_refused() {
        let mut p: Pyramid<340, 85> = Pyramid::new();
        let data = [0; 17 * 17];
        assert!(p.planes_mut().load(&Frame::new(PixelFormat::Gray8, 16, 16, &data[..256]).unwrap()).is_ok());
        assert!(matches!(
            p.planes_mut().load(&Frame::new(PixelFormat::Gray8, 17, 17, &data).unwrap()),
            Err(FrameError::TooLarge { pixels: 289, max_pixels: 256, .. })
        ));
    }
}
