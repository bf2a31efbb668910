//! Light of the blocks of a template: how each is lit in the frame, and how much it counts.
//!
//! In: sums over the pixels of a block. Out: the [`Moments`] of a correlation; a [`Shade`], which
//! carries brightness of the frame to brightness of the template, and the weight of the block.
//!
//! Memory: 720 bytes for the light of a template. Cost: two square roots a block.

use crate::base::math;

/// Number of blocks in each direction.
pub(crate) const BLOCKS: usize = 6;

/// Minimum spread of a block of the template that counts, gray levels.
const LEAST_SPREAD: f32 = 5.0;

/// Moments of a correlation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Moments {
    /// Number of pixels.
    pub(crate) n: f32,
    /// Mean of the template and mean of the frame.
    pub(crate) mean: [f32; 2],
    /// Variance of the template, variance of the frame, and covariance.
    pub(crate) t: f32,
    pub(crate) f: f32,
    pub(crate) tf: f32,
}

impl Moments {
    /// The moments of these sums: the number of pixels; the pixels of the template and of the
    /// frame; their squares; their products.
    pub(crate) fn new([n, t, f, tt, ff, tf]: [f32; 6]) -> Self {
        let k = 1.0 / n.max(1.0);
        let mean = [t * k, f * k];
        Self { n, mean, t: tt * k - mean[0] * mean[0], f: ff * k - mean[1] * mean[1], tf: tf * k - mean[0] * mean[1] }
    }

    /// Whether the template has enough texture for a correlation.
    #[inline(always)]
    pub(crate) fn is_textured(&self) -> bool {
        self.t >= LEAST_SPREAD * LEAST_SPREAD
    }

    /// Correlation of template and frame, -1 to 1. A flat block of the frame correlates with nothing.
    #[inline(never)]
    pub(crate) fn correlation(&self) -> f32 {
        self.tf / math::coarse_sqrt(self.t * self.f.max(4.0))
    }
}

/// Light of a block: its mean and spread in template and frame, and the weight of the block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shade {
    /// Reciprocal of the spread of the template.
    pub(crate) scale_t: f32,
    /// Reciprocal of the spread of the frame.
    pub(crate) scale_f: f32,
    /// Difference between the mean of the template and the mean of the frame, each times its scale.
    pub(crate) offset: f32,
    /// Weight of the block, 0 to 1: its agreement.
    pub(crate) weight: f32,
    /// Minimum step of a pixel that counts, gray levels: the sum of its absolute steps along the
    /// row and across it.
    pub(crate) flat: f32,
}

/// Light of all blocks of a template.
pub(crate) type Light = [Shade; BLOCKS * BLOCKS];

/// Light before a frame has been looked at.
pub(crate) const NO_LIGHT: Light =
    [Shade { scale_t: 0.0, scale_f: 0.0, offset: 0.0, weight: 0.0, flat: 0.0 }; BLOCKS * BLOCKS];

/// Minimum step of a pixel that counts: [`FLAT`] spreads of its block, at most [`STEEP`] gray
/// levels. Flat pixels are left out, because they show mostly noise.
const FLAT: f32 = 0.8;
const STEEP: f32 = 16.0;

/// Minimum weight of a block that counts.
pub(crate) const LEAST_WEIGHT: f32 = 0.05;

impl Shade {
    pub(crate) fn new(m: &Moments) -> Self {
        let usable = m.t > 4.0 && m.f > 1.0;
        let correlation = if usable { m.tf / math::coarse_sqrt(m.t * m.f) } else { 0.0 };
        let [scale_t, scale_f] = [m.t, m.f].map(|v| 1.0 / math::coarse_sqrt(v.max(1.0)));
        let offset = m.mean[0] * scale_t - m.mean[1] * scale_f;
        Self { scale_t, scale_f, offset, weight: agreement(correlation), flat: (FLAT / scale_t).min(STEEP) }
    }
}

/// Agreement of a block with this correlation, 0 to 1. A correlation that arises by chance counts
/// as 0, and so does a hidden block: it does not pull.
pub(crate) fn agreement(correlation: f32) -> f32 {
    let a = ((correlation - 0.2) / 0.8).max(0.0);
    a * a
}
