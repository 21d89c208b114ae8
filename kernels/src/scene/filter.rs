//! The reconstruction filter, and how it is sampled.

use super::error::{BuildError, finite};
use crate::lanes::{Real, Uint};

/// A separable reconstruction filter, sampled by importance: every pixel owns its samples.
#[derive(Clone, Debug)]
pub struct Filter {
    axes: [FilterAxis; 2],
}

/// One axis of a filter: its inverse cumulative distribution, tabulated.
///
/// Between the entries the inverse is linear, so the density is constant there. The 2048 cells are finest towards the
/// ends: cell `k` begins at the quantile 2 t^2 for t = k / 2048 up to 1/2, and symmetrically above. With cells of
/// equal probability the outermost thousandth of a filter that falls to zero would be spread evenly over its tail, as
/// a halo around bright pixels.
#[derive(Clone, Debug)]
pub struct FilterAxis {
    /// Offsets from the pixel's centre where the cells begin, and where the last one ends, ascending. Two: the density
    /// is constant.
    quantiles: Vec<f32>,
    /// Distance from the centre beyond which the filter is negative; infinite if it nowhere is.
    negative_beyond: f32,
}

impl FilterAxis {
    /// Cells of the table.
    const CELLS: usize = 2048;

    /// Constant on `[-radius, radius]`.
    pub fn constant(radius: f64) -> Self {
        FilterAxis { quantiles: vec![-radius as f32, radius as f32], negative_beyond: f32::INFINITY }
    }

    /// The symmetric function `f` on `[-radius, radius]`; where it is negative its absolute value is sampled.
    pub fn tabulate(radius: f64, f: impl Fn(f64) -> f64) -> Self {
        // Cumulative sums by the midpoint rule on a grid much finer than the cells.
        const STEPS: usize = 32 * FilterAxis::CELLS;
        let step = 2.0 * radius / STEPS as f64;
        let at = |k: usize| -radius + (k as f64 + 0.5) * step;
        let mut cumulative = Vec::with_capacity(STEPS + 1);
        cumulative.push(0.0f64);
        for k in 0..STEPS {
            cumulative.push(cumulative[k] + f(at(k)).abs());
        }
        let total = cumulative[STEPS];
        let mut k = 0;
        let quantiles = (0..=Self::CELLS)
            .map(|cell| {
                let t = cell as f64 / Self::CELLS as f64;
                let target = total * if t <= 0.5 { 2.0 * t * t } else { 1.0 - 2.0 * (1.0 - t) * (1.0 - t) };
                while k < STEPS - 1 && cumulative[k + 1] < target {
                    k += 1;
                }
                let width = cumulative[k + 1] - cumulative[k];
                let within =
                    if width > 0.0 { ((target - cumulative[k]) / width).clamp(0.0, 1.0) } else { 0.0 };
                (-radius + (k as f64 + within) * step) as f32
            })
            .collect();
        let negative = (0..STEPS).map(at).filter(|&x| x >= 0.0 && f(x) < 0.0).fold(f64::INFINITY, f64::min);
        FilterAxis { quantiles, negative_beyond: negative as f32 }
    }

    /// Offsets from the pixel's centre where the cells begin, and where the last one ends, ascending.
    pub fn quantiles(&self) -> &[f32] {
        &self.quantiles
    }

    /// Distance from the centre beyond which the filter is negative; infinite if it nowhere is.
    #[inline(always)]
    pub fn negative_beyond(&self) -> f32 {
        self.negative_beyond
    }

    /// Offset for a uniform number in [0, 1).
    #[inline(always)]
    pub fn sample<F: Real>(&self, u: F) -> F {
        if let [low, high] = self.quantiles[..] {
            return u.mul_add(F::splat(high - low), F::splat(low));
        }
        // t = sqrt(u / 2) in the lower half, mirrored in the upper one.
        let upper = u.ge(F::lit(0.5));
        let t = (F::select(upper, F::one() - u, u) * F::lit(0.5)).sqrt();
        let scaled = F::select(upper, F::one() - t, t) * F::lit(Self::CELLS as f64);
        // Numbers outside of [0, 1) and what is no number stay among the cells, too.
        let cell = scaled.max(F::zero()).min(F::lit(Self::CELLS as f64 - 1.0)).to_uint();
        // SAFETY: an axis that is not constant has one more than CELLS entries.
        let (low, high) = unsafe {
            (F::gather(&self.quantiles, cell), F::gather(&self.quantiles, cell + F::Uint::splat(1)))
        };
        (scaled - F::from_uint(cell)).mul_add(high - low, low)
    }
}

impl Filter {
    /// A filter with a horizontal and a vertical axis.
    ///
    /// # Errors
    /// If the axes were made of numbers that are not finite.
    pub fn new(axes: [FilterAxis; 2]) -> Result<Self, BuildError> {
        for (k, axis) in axes.iter().enumerate() {
            finite("filter axis", k, "an offset", &axis.quantiles)?;
        }
        Ok(Filter { axes })
    }
    /// Horizontal, vertical.
    #[inline(always)]
    pub fn axes(&self) -> &[FilterAxis; 2] {
        &self.axes
    }
    /// Are there weights of -1?
    pub fn has_negative_lobes(&self) -> bool {
        self.axes.iter().any(|a| a.negative_beyond.is_finite())
    }
}
