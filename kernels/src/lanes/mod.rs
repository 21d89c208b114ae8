//! Lane types: one set of number traits, under which the physics is written once.
//!
//! | type | lanes | used by |
//! |---|---|---|
//! | [`f32`], [`FusedF32`] | 1 | the megakernel, without and with fused multiply-add |
//! | [`f64`] | 1 | the double-precision oracle and tests |
//! | [`Portable<N>`](Portable) | N | machines without AVX2 (SSE2, NEON): arrays that LLVM vectorises |
//! | `F32x4`, `F32x8` | 4, 8 | AVX2 and FMA |
//! | `F32x16` | 16 | AVX-512 F, DQ, VL, BW |
//!
//! All operations but the gathers are IEEE-exact in every type, so a formula gives the same bits at every width as
//! long as fused multiply-add is used in all of them or in none ([`crate::isa`] sees to that). Approximate
//! reciprocals and square roots are left out on purpose: they differ between makers, and engines would not agree.
//!
//! Every method is `#[inline(always)]`: a helper that is not inlined into a `#[target_feature]` function is compiled
//! without the features and costs a factor of 1.3 to 18 (measured).

use core::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

/// `[f(a), f(b), f(c)]`, written out. `array::map` and closures that are used more than once are not always inlined, and
/// what is not inlined is compiled without the instruction set of the kernel: it made traversal three times slower.
macro_rules! map3 {
    ($array:expr, |$x:pat_param| $f:expr) => {{
        let [a, b, c] = $array;
        [
            {
                let $x = a;
                $f
            },
            {
                let $x = b;
                $f
            },
            {
                let $x = c;
                $f
            },
        ]
    }};
}
pub(crate) use map3;

mod portable;
mod scalar;
#[cfg(target_arch = "x86_64")]
mod x86;
#[cfg(target_arch = "x86_64")]
mod x86_512;

pub use portable::{Portable, PortableMask, PortableUint};
pub use scalar::FusedF32;
#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{F32x4, F32x8};
#[cfg(target_arch = "x86_64")]
pub(crate) use x86_512::F32x16;

/// Lanes and instruction sets are those of this crate: kernels rely on how many lanes there are, and on what each
/// operation does.
pub(crate) mod sealed {
    /// See the module.
    pub trait Sealed {}
}

/// One truth value a lane.
pub trait Mask:
    sealed::Sealed + Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self>
{
    /// Bit `i` is lane `i`; bits above the lanes are 0.
    fn bits(self) -> u32;
    /// The inverse of [`Mask::bits`]; bits above the lanes are ignored.
    fn from_bits(bits: u32) -> Self;
    /// The first `n` lanes, `n` up to 16.
    #[inline(always)]
    fn first(n: usize) -> Self {
        Self::from_bits(((1u64 << n) - 1) as u32)
    }
    /// Is any lane set?
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
    /// How many lanes are set.
    #[inline(always)]
    fn count(self) -> usize {
        self.bits().count_ones() as usize
    }
}

/// One `u32` a lane, with wrapping arithmetic.
pub trait Uint:
    sealed::Sealed
    + Copy
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
{
    /// The mask with as many lanes.
    type Mask: Mask;
    /// The same value in all lanes.
    fn splat(x: u32) -> Self;
    /// Lanes from `slice[at..]`; panics when too few are there.
    fn load(slice: &[u32], at: usize) -> Self;
    /// Lanes to `slice[at..]`; panics when too little room is there.
    fn store(self, slice: &mut [u32], at: usize);
    /// `slice[index]` a lane.
    ///
    /// # Safety
    /// Every lane of `index` is below `slice.len()`.
    unsafe fn gather(slice: &[u32], index: Self) -> Self;
    /// The set lanes, packed, to `slice[at..]`. Writes a whole vector: needs room for all lanes, panics otherwise.
    fn compress(self, mask: Self::Mask, slice: &mut [u32], at: usize);
    /// Shift left by a constant below 32.
    fn shl<const K: u32>(self) -> Self;
    /// Logical shift right by a constant below 32.
    fn shr<const K: u32>(self) -> Self;
    /// The upper half of the 64-bit product.
    fn mul_high(self, other: Self) -> Self;
    /// Lanes equal.
    fn eq(self, other: Self) -> Self::Mask;
    /// Unsigned less-than.
    fn lt(self, other: Self) -> Self::Mask;
    /// `mask ? a : b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Bits in reverse order.
    fn reverse_bits(self) -> Self;
    /// Lane `i` is lane `index[i]`, whose bits above the number of lanes do not count.
    fn permute(self, index: Self) -> Self;
    /// Logical shift right, each lane by its own number below 32.
    fn shr_each(self, by: Self) -> Self;
    /// Lane values in an array; only the first lanes of the type count.
    #[inline(always)]
    fn to_array(self) -> [u32; 16] {
        let mut out = [0; 16];
        self.store(&mut out, 0);
        out
    }
}

/// One real number a lane. In memory it is always `f32`.
pub trait Real:
    sealed::Sealed
    + Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The mask with as many lanes.
    type Mask: Mask;
    /// The integers with as many lanes.
    type Uint: Uint<Mask = Self::Mask>;
    /// How many lanes, 1 to 16.
    const LANES: usize;

    /// The same value in all lanes.
    fn splat(x: f32) -> Self;
    /// A literal in all lanes, in the full precision of the type.
    fn lit(x: f64) -> Self;
    /// Lanes from `slice[at..]`; panics when too few are there.
    fn load(slice: &[f32], at: usize) -> Self;
    /// Lanes to `slice[at..]`; panics when too little room is there.
    fn store(self, slice: &mut [f32], at: usize);
    /// `slice[index]` a lane.
    ///
    /// # Safety
    /// Every lane of `index` is below `slice.len()`.
    unsafe fn gather(slice: &[f32], index: Self::Uint) -> Self;
    /// The set lanes, packed, to `slice[at..]`. Writes a whole vector: needs room for all lanes, panics otherwise.
    fn compress(self, mask: Self::Mask, slice: &mut [f32], at: usize);
    /// `self * a + b`, fused where the type has it.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root; NaN below zero.
    fn sqrt(self) -> Self;
    /// The smaller; `other` if either is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger; `other` if either is NaN.
    fn max(self, other: Self) -> Self;
    /// Without the sign.
    fn abs(self) -> Self;
    /// `self`, negated where `sign` is negative (or -0).
    fn xor_sign(self, sign: Self) -> Self;
    /// `self < other`, false with NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`, false with NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `self == other`, false with NaN.
    fn eq(self, other: Self) -> Self::Mask;
    /// `mask ? a : b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// The number that an integer below 2^24 stands for.
    fn from_uint(u: Self::Uint) -> Self;
    /// Towards zero, of a number in [0, 2^31).
    fn to_uint(self) -> Self::Uint;
    /// Sine and cosine of `2 pi self`, for `self` in [0, 1]; absolute error below 2e-7 in single precision.
    fn sin_cos_turns(self) -> (Self, Self);
    /// Lane `i` is lane `index[i]`, whose bits above the number of lanes do not count.
    #[inline(always)]
    fn permute(self, index: Self::Uint) -> Self {
        Self::from_bits(self.to_bits().permute(index))
    }
    /// The bits of the lane as single precision.
    fn to_bits(self) -> Self::Uint;
    /// The inverse of [`Real::to_bits`].
    fn from_bits(u: Self::Uint) -> Self;

    /// `self > other`, false with NaN.
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// `self >= other`, false with NaN.
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// `b - self * a`, fused where the type has it.
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        (-self).mul_add(a, b)
    }
    /// `self * a - b`, fused where the type has it.
    #[inline(always)]
    fn mul_sub(self, a: Self, b: Self) -> Self {
        self.mul_add(a, -b)
    }
    /// 0.
    #[inline(always)]
    fn zero() -> Self {
        Self::lit(0.0)
    }
    /// 1.
    #[inline(always)]
    fn one() -> Self {
        Self::lit(1.0)
    }
    /// 1 / self, by division: exact rounding in every type.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::one() / self
    }
    /// The square.
    #[inline(always)]
    fn sqr(self) -> Self {
        self * self
    }
    /// Lane values in an array; only the first [`Real::LANES`] count.
    #[inline(always)]
    fn to_array(self) -> [f32; 16] {
        let mut out = [0.0; 16];
        self.store(&mut out, 0);
        out
    }
    /// The four numbers again and again.
    #[inline(always)]
    fn repeat(four: &[f32; 4]) -> Self {
        let mut out = [0.0; 16];
        for i in 0..16 {
            out[i] = four[i % 4];
        }
        Self::load(&out, 0)
    }
    /// The smallest lane. Which one it is with NaN is not said.
    #[inline(always)]
    fn least(self) -> f32 {
        // In halves: one after the other would wait for each comparison.
        let mut lanes = self.to_array();
        let mut half = Self::LANES / 2;
        while half > 0 {
            for i in 0..half {
                lanes[i] = if lanes[i + half] < lanes[i] { lanes[i + half] } else { lanes[i] };
            }
            half /= 2;
        }
        lanes[0]
    }
    /// The largest lane. Which one it is with NaN is not said.
    #[inline(always)]
    fn largest(self) -> f32 {
        -(-self).least()
    }
    /// A uniform number in [0, 1) from the upper 24 bits of a random integer.
    #[inline(always)]
    fn unit_from_bits(u: Self::Uint) -> Self {
        Self::from_uint(u.shr::<8>()) * Self::lit(1.0 / 16_777_216.0)
    }
}

/// [`Real::sin_cos_turns`] for single-precision lanes: reduction to an eighth of a turn, then minimax polynomials.
///
/// The reduction is exact: `self - q/4` has no rounding in [0, 1].
#[inline(always)]
fn sin_cos_turns_f32<F: Real>(turns: F) -> (F, F) {
    let quarter = turns.mul_add(F::lit(4.0), F::lit(0.5)).to_uint();
    let r = F::from_uint(quarter).neg_mul_add(F::lit(0.25), turns) * F::lit(core::f64::consts::TAU);
    let r2 = r * r;
    let sin = r2
        .mul_add(F::lit(-1.951_529_6e-4), F::lit(8.332_160_9e-3))
        .mul_add(r2, F::lit(-1.666_665_5e-1))
        .mul_add(r2 * r, r);
    let cos = r2
        .mul_add(F::lit(2.443_315_7e-5), F::lit(-1.388_731_6e-3))
        .mul_add(r2, F::lit(4.166_664_6e-2))
        .mul_add(r2 * r2, r2.mul_add(F::lit(-0.5), F::one()));
    let one = F::Uint::splat(1);
    let two = F::Uint::splat(2);
    let odd = (quarter & one).eq(one);
    let s = F::select(odd, cos, sin);
    let c = F::select(odd, sin, cos);
    let sin_sign = F::from_bits((quarter & two).shl::<30>());
    let cos_sign = F::from_bits(((quarter + one) & two).shl::<30>());
    (s.xor_sign(sin_sign), c.xor_sign(cos_sign))
}

#[cfg(test)]
mod tests;
