//! One lane: `f32`, `f32` with fused multiply-add, and `f64`.

use super::{Mask, Real, Uint, sin_cos_turns_f32};
use core::num::Wrapping;
use core::ops::{Add, Div, Mul, Neg, Sub};

impl super::sealed::Sealed for bool {}
impl super::sealed::Sealed for Wrapping<u32> {}
impl super::sealed::Sealed for f32 {}
impl super::sealed::Sealed for FusedF32 {}
impl super::sealed::Sealed for f64 {}

impl Mask for bool {
    #[inline(always)]
    fn bits(self) -> u32 {
        self as u32
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> bool {
        bits & 1 != 0
    }
}

impl Uint for Wrapping<u32> {
    type Mask = bool;
    #[inline(always)]
    fn splat(x: u32) -> Self {
        Wrapping(x)
    }
    #[inline(always)]
    fn load(slice: &[u32], at: usize) -> Self {
        Wrapping(slice[at])
    }
    #[inline(always)]
    fn store(self, slice: &mut [u32], at: usize) {
        slice[at] = self.0;
    }
    #[inline(always)]
    unsafe fn gather(slice: &[u32], index: Self) -> Self {
        debug_assert!((index.0 as usize) < slice.len());
        // SAFETY: the caller's promise.
        Wrapping(unsafe { *slice.get_unchecked(index.0 as usize) })
    }
    #[inline(always)]
    fn compress(self, mask: bool, slice: &mut [u32], at: usize) {
        if mask {
            slice[at] = self.0;
        }
    }
    #[inline(always)]
    fn shl<const K: u32>(self) -> Self {
        Wrapping(self.0 << K)
    }
    #[inline(always)]
    fn shr<const K: u32>(self) -> Self {
        Wrapping(self.0 >> K)
    }
    #[inline(always)]
    fn mul_high(self, other: Self) -> Self {
        Wrapping(((self.0 as u64 * other.0 as u64) >> 32) as u32)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self.0 == other.0
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.0 < other.0
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn permute(self, _: Self) -> Self {
        self
    }
    #[inline(always)]
    fn shr_each(self, by: Self) -> Self {
        Wrapping(self.0 >> (by.0 & 31))
    }
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        Wrapping(self.0.reverse_bits())
    }
}

/// `f32` whose [`Real::mul_add`] is fused. For code that is compiled with the FMA feature only: elsewhere `mul_add`
/// is a call into libm, right but slow.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct FusedF32(pub f32);

macro_rules! newtype_operator {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl $trait for FusedF32 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                FusedF32(self.0 $op other.0)
            }
        }
    )*};
}
newtype_operator!(Add add +, Sub sub -, Mul mul *, Div div /);
impl Neg for FusedF32 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        FusedF32(-self.0)
    }
}

/// The methods that the three one-lane types share. `$wrap` and `$get` convert from and to the base type.
macro_rules! one_lane {
    ($base:ident, $wrap:expr, $get:expr) => {
        type Mask = bool;
        type Uint = Wrapping<u32>;
        const LANES: usize = 1;
        #[inline(always)]
        fn splat(x: f32) -> Self {
            $wrap(x as $base)
        }
        #[inline(always)]
        fn lit(x: f64) -> Self {
            $wrap(x as $base)
        }
        #[inline(always)]
        fn load(slice: &[f32], at: usize) -> Self {
            $wrap(slice[at] as $base)
        }
        #[inline(always)]
        fn store(self, slice: &mut [f32], at: usize) {
            slice[at] = $get(self) as f32;
        }
        #[inline(always)]
        unsafe fn gather(slice: &[f32], index: Wrapping<u32>) -> Self {
            debug_assert!((index.0 as usize) < slice.len());
            // SAFETY: the caller's promise.
            $wrap(unsafe { *slice.get_unchecked(index.0 as usize) } as $base)
        }
        #[inline(always)]
        fn compress(self, mask: bool, slice: &mut [f32], at: usize) {
            if mask {
                slice[at] = $get(self) as f32;
            }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            $wrap($get(self).sqrt())
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            if $get(self) < $get(other) { self } else { other }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            if $get(self) > $get(other) { self } else { other }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            $wrap($get(self).abs())
        }
        #[inline(always)]
        fn xor_sign(self, sign: Self) -> Self {
            if $get(sign).is_sign_negative() { -self } else { self }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> bool {
            $get(self) < $get(other)
        }
        #[inline(always)]
        fn le(self, other: Self) -> bool {
            $get(self) <= $get(other)
        }
        #[inline(always)]
        fn eq(self, other: Self) -> bool {
            $get(self) == $get(other)
        }
        #[inline(always)]
        fn select(mask: bool, a: Self, b: Self) -> Self {
            if mask { a } else { b }
        }
        #[inline(always)]
        fn from_uint(u: Wrapping<u32>) -> Self {
            // Through i32: one instruction, and the values are below 2^24.
            $wrap(u.0 as i32 as $base)
        }
        #[inline(always)]
        fn to_uint(self) -> Wrapping<u32> {
            Wrapping($get(self) as i32 as u32)
        }
        #[inline(always)]
        fn to_bits(self) -> Wrapping<u32> {
            Wrapping(($get(self) as f32).to_bits())
        }
        #[inline(always)]
        fn from_bits(u: Wrapping<u32>) -> Self {
            $wrap(f32::from_bits(u.0) as $base)
        }
    };
}

impl Real for f32 {
    one_lane!(f32, |x: f32| x, |x: f32| x);
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn sin_cos_turns(self) -> (Self, Self) {
        sin_cos_turns_f32(self)
    }
}

impl Real for FusedF32 {
    one_lane!(f32, FusedF32, |x: FusedF32| x.0);
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        FusedF32(self.0.mul_add(a.0, b.0))
    }
    #[inline(always)]
    fn sin_cos_turns(self) -> (Self, Self) {
        sin_cos_turns_f32(self)
    }
}

impl Real for f64 {
    one_lane!(f64, |x: f64| x, |x: f64| x);
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn sin_cos_turns(self) -> (Self, Self) {
        (core::f64::consts::TAU * self).sin_cos()
    }
}
