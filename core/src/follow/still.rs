//! Tells whether a frame shows anything that the last searched frame did not show.
//!
//! In: the pyramids of frames. Out: whether something has changed. A frame is reduced to at most 80 x
//! 60 cells, the means of 8 x 8 px or more. Two frames are compared in blocks of 4 x 4 cells. In
//! each, the light may have changed by a factor and a constant, so that flicker and slow changes of
//! exposure count for nothing. Noise counts for little, because a cell is the mean of many pixels.
//! The frame before is always one that was searched, so that what arrives slowly adds up.
//!
//! Memory: 4.8 KB in [`Still`]. Cost: some 60 operations for each cell.

use crate::base::capacity::LEVELS;
use crate::image::plane::Plane;
use crate::image::pyramid::PyramidView;

/// Maximum number of cells: those of the coarsest level of a frame of 640 x 480 px.
const CELLS: usize = 80 * 60;
/// Number of cells along each side of a block.
const BLOCK: usize = 4;
/// Root mean square by which the cells of a block may differ, gray levels.
const NOISE: f32 = 7.0;
/// Factors by which the contrast of a block may change.
const GAINS: [f32; 2] = [0.7, 1.0 / 0.7];

/// The cells of the last searched frame; at first of none.
#[derive(Debug)]
pub(super) struct Still {
    cells: [u8; CELLS],
    columns: usize,
    rows: usize,
}

/// The coarsest level of a frame, of which each cell is the mean of `step` x `step` pixels.
struct Cells<'a> {
    level: Plane<'a, u8>,
    step: usize,
    columns: usize,
    rows: usize,
}

impl<'a> Cells<'a> {
    fn new(frame: &PyramidView<'a>) -> Self {
        let level = frame.luma(LEVELS - 1);
        let (w, h) = (level.width(), level.height());
        let fits = |step: &usize| (w / step) * (h / step) <= CELLS;
        let step = (1..).find(fits).unwrap_or(1);
        Self { level, step, columns: w / step, rows: h / step }
    }

    fn at(&self, column: usize, row: usize) -> u8 {
        let n = self.step;
        let rows = (row * n..row * n + n).map(|y| self.level.row(y));
        let sum: usize = rows.flat_map(|r| &r[column * n..][..n]).map(|&v| usize::from(v)).sum();
        u8::try_from(sum / (n * n)).unwrap_or(u8::MAX)
    }
}

impl Still {
    pub(super) const NOTHING: Self = Self { cells: [0; CELLS], columns: 0, rows: 0 };

    /// Forgets the frame.
    pub(super) const fn forget(&mut self) {
        (self.columns, self.rows) = (0, 0);
    }

    /// Remembers a frame that was searched.
    pub(super) fn remember(&mut self, frame: &PyramidView<'_>) {
        let cells = Cells::new(frame);
        (self.columns, self.rows) = (cells.columns, cells.rows);
        for (row, out) in self.cells.chunks_exact_mut(cells.columns.max(1)).take(cells.rows).enumerate() {
            out.iter_mut().enumerate().for_each(|(column, cell)| *cell = cells.at(column, row));
        }
    }

    /// Whether a frame shows what the remembered frame shows.
    pub(super) fn holds(&self, frame: &PyramidView<'_>) -> bool {
        let cells = Cells::new(frame);
        if (cells.columns, cells.rows) != (self.columns, self.rows) {
            return false;
        }
        // The last block of a row or column ends with it, and overlaps the one before.
        let starts = |n: usize| (0..n.div_ceil(BLOCK)).map(move |i| (i * BLOCK).min(n.saturating_sub(BLOCK)));
        starts(self.rows).all(|row| starts(self.columns).all(|column| self.block_holds(&cells, column, row)))
    }

    /// Whether the block that begins at this cell shows what it showed.
    fn block_holds(&self, cells: &Cells<'_>, column: usize, row: usize) -> bool {
        let mut sums = Sums::default();
        for y in row..(row + BLOCK).min(self.rows) {
            for x in column..(column + BLOCK).min(self.columns) {
                sums.add(self.cells[y * self.columns + x].into(), cells.at(x, y).into());
            }
        }
        sums.are_alike()
    }
}

/// Sums over the cells of a block, before and now.
#[derive(Default)]
struct Sums {
    n: u32,
    before: u32,
    now: u32,
    before_squared: u32,
    now_squared: u32,
    product: u32,
}

impl Sums {
    const fn add(&mut self, before: u32, now: u32) {
        self.n += 1;
        self.before += before;
        self.now += now;
        self.before_squared += before * before;
        self.now_squared += now * now;
        self.product += before * now;
    }

    /// Whether the cells agree, but for a factor, a constant and noise.
    fn are_alike(&self) -> bool {
        // `n` squared times the variances and the covariance: below 2^24, exact in `f32`.
        let spread = |squares: u32, a: u32, b: u32| (i64::from(self.n * squares) - i64::from(a) * i64::from(b)) as f32;
        let before = spread(self.before_squared, self.before, self.before);
        let now = spread(self.now_squared, self.now, self.now);
        let both = spread(self.product, self.before, self.now);
        let gain = if before > 0.0 { (both / before).clamp(GAINS[0], GAINS[1]) } else { 1.0 };
        let rest = now - 2.0 * gain * both + gain * gain * before;
        rest <= NOISE * NOISE * (self.n * self.n) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::frame::Frame;
    use crate::image::pixels::PixelFormat;
    use crate::image::pyramid::Pyramid;
    use std::prelude::rust_2024::*;

    /// A frame whose pixels are those of `value`, as a pyramid.
    fn pyramid(w: usize, h: usize, value: impl Fn(usize, usize) -> u8) -> Box<Pyramid<108_800, 27_200>> {
        let bytes: Vec<u8> = (0..w * h).map(|i| value(i % w, i / w)).collect();
        let mut pyramid = Box::new(Pyramid::new());
        pyramid.planes_mut().load(&Frame::new(PixelFormat::Gray8, w, h, &bytes).unwrap()).unwrap();
        pyramid.planes_mut().reduce();
        pyramid
    }

    fn texture(x: usize, y: usize) -> u8 {
        let block = ((x / 9) * 7 + (y / 9) * 13) as u32;
        (block.wrapping_mul(0x9e37_79b9) >> 25) as u8 + 60
    }

    #[test]
    fn light_counts_for_nothing_and_texture_counts_wherever_it_is() {
        let mut still = Still::NOTHING;
        let holds = |still: &Still, value: &dyn Fn(usize, usize) -> u8| still.holds(&pyramid(320, 240, value).view());
        assert!(!holds(&still, &texture), "nothing has been seen yet");
        still.remember(&pyramid(320, 240, texture).view());
        assert!(holds(&still, &texture));
        assert!(holds(&still, &|x, y| texture(x, y) - 50), "darker");
        assert!(holds(&still, &|x, y| (usize::from(texture(x, y)) * (95 + x / 32) / 120) as u8), "a lamp on one side");
        assert!(!holds(&still, &|x, y| 120 + texture(x, y) / 10), "much less contrast");
        assert!(!holds(&still, &|_, _| 100), "what was there is gone");
        // A patch of 30 px with another texture, at every place.
        for (px, py) in (0..290).step_by(29).flat_map(|x| (0..210).step_by(30).map(move |y| (x, y))) {
            let inside = |x: usize, y: usize| (px..px + 30).contains(&x) && (py..py + 30).contains(&y);
            let patched = |x, y| if inside(x, y) { texture(x + 77, y + 31) } else { texture(x, y) };
            assert!(!holds(&still, &patched), "{px} {py}");
        }
        still.forget();
        assert!(!holds(&still, &texture));
    }

    #[test]
    fn a_plain_frame_shows_what_comes_and_no_noise() {
        let mut still = Still::NOTHING;
        still.remember(&pyramid(320, 240, |_, _| 128).view());
        let noise = |x: usize, y: usize| 120 + ((x * 7919 + y * 104_729) % 17) as u8;
        assert!(still.holds(&pyramid(320, 240, noise).view()));
        let square = |x: usize, y: usize| if x / 24 == 5 && y / 24 == 5 { 60 } else { 128 };
        assert!(!still.holds(&pyramid(320, 240, square).view()));
        assert!(!still.holds(&pyramid(312, 240, |_, _| 128).view()), "a frame of another size");
    }

    #[test]
    fn frames_of_every_size_fit() {
        let mut still = Still::NOTHING;
        for (w, h) in [(16, 16), (17, 23), (16, 320), (320, 16), (319, 239), (301, 41)] {
            let p = pyramid(w, h, texture);
            still.remember(&p.view());
            assert!(still.holds(&p.view()), "{w}x{h}");
        }
        let wide: Plane<'_, u8> = Plane::new(&[0; 160 * 90], 160, 90).unwrap();
        assert_eq!((1..).find(|s| (wide.width() / s) * (wide.height() / s) <= CELLS), Some(2), "1280 x 720 px");
    }
}
