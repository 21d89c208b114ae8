//! Pictures as kernels look them up: colours of lights by place or direction.

use crate::lanes::{Real, Uint};
use crate::math::Rgb;
use crate::scene::error::BuildError;

/// The texels of a [`Picture`], rows from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// A word each: red in the lowest byte, then green and blue.
    Bytes {
        /// The words.
        words: Vec<u32>,
        /// What each byte stands for: 256 numbers.
        values: Vec<f32>,
    },
    /// Two words each: red in the lower half of the first as 16-bit floating point, then green; blue.
    Halves(Vec<u32>),
    /// Red, green and blue each.
    Floats(Vec<f32>),
}

/// A picture whose colours are finite and not negative.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    width: u32,
    height: u32,
    texels: Texels,
}

impl Picture {
    /// Most texels.
    pub const MAX: u64 = 1 << 28;

    /// A picture of a certain size.
    ///
    /// # Errors
    /// Where there are no texels, too many, not as many as the size says, or a number that is negative or not finite.
    pub fn new(width: u32, height: u32, texels: Texels) -> Result<Self, BuildError> {
        let count = u64::from(width) * u64::from(height);
        if count > Self::MAX {
            let (found, limit) = (count as usize, Self::MAX as usize);
            return Err(BuildError::TooMany { what: "texels", found, limit });
        }
        let (of, found, expected) = match &texels {
            Texels::Bytes { words, values } if values.len() == 256 => ("texels", words.len(), count),
            Texels::Bytes { values, .. } => ("values of bytes", values.len(), 256),
            Texels::Halves(words) => ("words of texels", words.len(), 2 * count),
            Texels::Floats(numbers) => ("numbers of texels", numbers.len(), 3 * count),
        };
        if count == 0 || found as u64 != expected {
            return Err(BuildError::Length { of, found, expected: expected.max(1) as usize });
        }
        let good = |x: &f32| x.is_finite() && *x >= 0.0;
        let wrong = match &texels {
            Texels::Bytes { values, .. } => values.iter().position(|x| !good(x)),
            // Negative, infinite or none: the sign, or all bits of the exponent.
            Texels::Halves(words) => words
                .iter()
                .position(|word| [word & 0xffff, word >> 16].iter().any(|half| *half >= 0x7c00))
                .map(|word| word / 2),
            Texels::Floats(numbers) => numbers.iter().position(|x| !good(x)).map(|number| number / 3),
        };
        match wrong {
            Some(id) => {
                let what = "a colour is negative or not finite".to_string();
                Err(BuildError::Number { of: "texel", id, what })
            }
            None => Ok(Picture { width, height, texels }),
        }
    }

    /// Texels per row.
    pub fn width(&self) -> u32 {
        self.width
    }
    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }
    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        match &self.texels {
            Texels::Bytes { words, values } => size_of_val(&words[..]) + size_of_val(&values[..]),
            Texels::Halves(words) => size_of_val(&words[..]),
            Texels::Floats(numbers) => size_of_val(&numbers[..]),
        }
    }

    /// The texel in column `x` and row `y`; those outside are moved to the edge.
    #[inline(always)]
    pub fn texel<F: Real>(&self, x: F::Uint, y: F::Uint) -> Rgb<F> {
        let (x, y) = (below::<F>(x, self.width), below::<F>(y, self.height));
        let at = y * F::Uint::splat(self.width) + x;
        // SAFETY (all): `x` and `y` are inside, and there are as many words or numbers as `new` asked for; bytes are
        // below 256.
        match &self.texels {
            Texels::Bytes { words, values } => unsafe {
                let word = F::Uint::gather(words, at);
                let byte = F::Uint::splat(0xff);
                Rgb::new(
                    F::gather(values, word & byte),
                    F::gather(values, word.shr::<8>() & byte),
                    F::gather(values, word.shr::<16>() & byte),
                )
            },
            Texels::Halves(words) => unsafe {
                let at = at + at;
                let first = F::Uint::gather(words, at);
                let second = F::Uint::gather(words, at + F::Uint::splat(1));
                let half = F::Uint::splat(0xffff);
                Rgb::new(from_half(first & half), from_half(first.shr::<16>()), from_half(second & half))
            },
            Texels::Floats(numbers) => unsafe {
                let at = at * F::Uint::splat(3);
                Rgb::new(
                    F::gather(numbers, at),
                    F::gather(numbers, at + F::Uint::splat(1)),
                    F::gather(numbers, at + F::Uint::splat(2)),
                )
            },
        }
    }

    /// The texel that holds a point of the unit square.
    #[inline(always)]
    pub fn nearest<F: Real>(&self, [u, v]: [F; 2]) -> Rgb<F> {
        self.texel(scaled(u, self.width), scaled(v, self.height))
    }

    /// Interpolated between the four texels whose centres are around a point of the unit square; beyond the outermost
    /// centres as at the edge.
    #[inline(always)]
    pub fn bilinear<F: Real>(&self, [u, v]: [F; 2]) -> Rgb<F> {
        let (x, across) = between_centres(u, self.width);
        let (y, down) = between_centres(v, self.height);
        self.blend([before::<F>(x), x], [before::<F>(y), y], across, down)
    }

    /// The same, but beyond the left and right edge the picture begins again.
    #[inline(always)]
    pub fn bilinear_around<F: Real>(&self, [u, v]: [F; 2]) -> Rgb<F> {
        let (column, across) = between_centres(u, self.width);
        let (row, down) = between_centres(v, self.height);
        self.blend_around(column, row, across, down)
    }

    /// What is between the centres of the texels in column `column` (of which the one behind the last is the first) and
    /// the one before it, and likewise of the rows, of which there is nothing behind the last.
    #[inline(always)]
    pub(crate) fn blend_around<F: Real>(&self, column: F::Uint, row: F::Uint, across: F, down: F) -> Rgb<F> {
        let (zero, width) = (F::Uint::splat(0), F::Uint::splat(self.width));
        let column = F::Uint::select(column.lt(width), column, zero);
        let last = F::Uint::splat(self.width - 1);
        let left = F::Uint::select(column.eq(zero), last, before::<F>(column));
        self.blend([left, column], [before::<F>(row), row], across, down)
    }

    /// The four texels of two columns and two rows, blended.
    #[inline(always)]
    pub fn blend<F: Real>(&self, x: [F::Uint; 2], y: [F::Uint; 2], across: F, down: F) -> Rgb<F> {
        let upper = mix(self.texel(x[0], y[0]), self.texel(x[1], y[0]), across);
        let lower = mix(self.texel(x[0], y[1]), self.texel(x[1], y[1]), across);
        mix(upper, lower, down)
    }

    /// What the colours of all texels add up to, each times a weight of its place: column, row.
    pub fn weighted_sum(&self, mut weight: impl FnMut(u32, u32) -> f64) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for y in 0..self.height {
            for x in 0..self.width {
                let (weight, colour) = (weight(x, y), self.colour(x, y));
                for (sum, c) in sum.iter_mut().zip(colour) {
                    *sum += weight * f64::from(c);
                }
            }
        }
        sum
    }

    /// One texel, moved to the edge if outside.
    pub fn colour(&self, x: u32, y: u32) -> [f32; 3] {
        use core::num::Wrapping;
        let Rgb { r, g, b } = self.texel::<f32>(Wrapping(x), Wrapping(y));
        [r, g, b]
    }
}

/// `x`, or the last number below `n`.
#[inline(always)]
fn below<F: Real>(x: F::Uint, n: u32) -> F::Uint {
    F::Uint::select(x.lt(F::Uint::splat(n)), x, F::Uint::splat(n - 1))
}

/// The number before, but 0 before 0.
#[inline(always)]
fn before<F: Real>(x: F::Uint) -> F::Uint {
    let zero = F::Uint::splat(0);
    F::Uint::select(x.eq(zero), zero, x - F::Uint::splat(1))
}

/// Which of `n` equal parts of the unit interval a number is in; the first or last one outside of it.
#[inline(always)]
pub(crate) fn scaled<F: Real>(u: F, n: u32) -> F::Uint {
    (u * F::lit(f64::from(n))).max(F::zero()).min(F::lit(f64::from(n))).to_uint()
}

/// Where a number of the unit interval is among the centres of `n` texels: how many are before it, and the share of
/// the way from the last of those to the next.
#[inline(always)]
pub(crate) fn between_centres<F: Real>(u: F, n: u32) -> (F::Uint, F) {
    let half = F::lit(0.5);
    let at = u.mul_add(F::lit(f64::from(n)), half).max(F::zero()).min(F::lit(f64::from(n) + 0.5));
    let place = at.to_uint();
    (place, at - F::from_uint(place))
}

/// The way from `a` to `b`, a share of it.
#[inline(always)]
fn mix<F: Real>(a: Rgb<F>, b: Rgb<F>, share: F) -> Rgb<F> {
    let rest = F::one() - share;
    Rgb {
        r: b.r.mul_add(share, a.r * rest),
        g: b.g.mul_add(share, a.g * rest),
        b: b.b.mul_add(share, a.b * rest),
    }
}

/// The number that 16 bits of floating point stand for, whose sign is 0 and which is finite.
///
/// With the bits moved to their place in single precision the exponent is 2^112 too small, which multiplying mends,
/// exactly, also of numbers that are subnormal in half precision.
#[inline(always)]
fn from_half<F: Real>(half: F::Uint) -> F {
    F::from_bits(half.shl::<13>()) * F::lit(5.192_296_858_534_828e33)
}
