//! N lanes as arrays: the fall-back for machines without AVX2. LLVM turns the loops into SSE2 or NEON.

use super::{Mask, Real, Uint, sin_cos_turns_f32};
use core::array::from_fn;
use core::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

/// `N` single-precision lanes.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub struct Portable<const N: usize>(pub [f32; N]);

/// `N` unsigned lanes.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub struct PortableUint<const N: usize>(pub [u32; N]);

/// `N` truth values, all bits of a lane set or none: selects become bit operations.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub struct PortableMask<const N: usize>(pub [u32; N]);

macro_rules! operator {
    ($type:ident, $($trait:ident $method:ident |$a:ident, $b:ident| $e:expr),*) => {$(
        impl<const N: usize> $trait for $type<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                $type(from_fn(|i| { let ($a, $b) = (self.0[i], other.0[i]); $e }))
            }
        }
    )*};
}
operator!(Portable, Add add |a, b| a + b, Sub sub |a, b| a - b, Mul mul |a, b| a * b, Div div |a, b| a / b);
operator!(PortableUint,
    BitAnd bitand |a, b| a & b, BitOr bitor |a, b| a | b, BitXor bitxor |a, b| a ^ b,
    Add add |a, b| a.wrapping_add(b), Sub sub |a, b| a.wrapping_sub(b), Mul mul |a, b| a.wrapping_mul(b));
operator!(PortableMask, BitAnd bitand |a, b| a & b, BitOr bitor |a, b| a | b);

impl<const N: usize> Neg for Portable<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Portable(self.0.map(|x| -x))
    }
}
impl<const N: usize> Not for PortableMask<N> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        PortableMask(self.0.map(|x| !x))
    }
}

impl<const N: usize> super::sealed::Sealed for PortableMask<N> {}
impl<const N: usize> super::sealed::Sealed for PortableUint<N> {}
impl<const N: usize> super::sealed::Sealed for Portable<N> {}

impl<const N: usize> Mask for PortableMask<N> {
    #[inline(always)]
    fn bits(self) -> u32 {
        (0..N).fold(0, |bits, i| bits | (self.0[i] & 1) << i)
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        PortableMask(from_fn(|i| 0u32.wrapping_sub(bits >> i & 1)))
    }
}

#[inline(always)]
fn mask<const N: usize>(f: impl Fn(usize) -> bool) -> PortableMask<N> {
    PortableMask(from_fn(|i| 0u32.wrapping_sub(f(i) as u32)))
}

/// Packs the set lanes of `lanes` to `slice[at..]`.
#[inline(always)]
fn compress<T: Copy, const N: usize>(lanes: [T; N], mask: PortableMask<N>, slice: &mut [T], at: usize) {
    let out = &mut slice[at..at + N];
    let mut n = 0;
    for (i, lane) in lanes.into_iter().enumerate() {
        out[n] = lane;
        n += (mask.0[i] & 1) as usize;
    }
}

impl<const N: usize> Uint for PortableUint<N> {
    type Mask = PortableMask<N>;
    #[inline(always)]
    fn splat(x: u32) -> Self {
        PortableUint([x; N])
    }
    #[inline(always)]
    fn load(slice: &[u32], at: usize) -> Self {
        PortableUint(from_fn(|i| slice[at..at + N][i]))
    }
    #[inline(always)]
    fn store(self, slice: &mut [u32], at: usize) {
        slice[at..at + N].copy_from_slice(&self.0);
    }
    #[inline(always)]
    unsafe fn gather(slice: &[u32], index: Self) -> Self {
        // SAFETY: the caller's promise.
        PortableUint(index.0.map(|i| unsafe { *slice.get_unchecked(i as usize) }))
    }
    #[inline(always)]
    fn compress(self, mask: Self::Mask, slice: &mut [u32], at: usize) {
        compress(self.0, mask, slice, at);
    }
    #[inline(always)]
    fn shl<const K: u32>(self) -> Self {
        PortableUint(self.0.map(|x| x << K))
    }
    #[inline(always)]
    fn shr<const K: u32>(self) -> Self {
        PortableUint(self.0.map(|x| x >> K))
    }
    #[inline(always)]
    fn mul_high(self, other: Self) -> Self {
        PortableUint(from_fn(|i| ((self.0[i] as u64 * other.0[i] as u64) >> 32) as u32))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Self::Mask {
        mask(|i| self.0[i] == other.0[i])
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        mask(|i| self.0[i] < other.0[i])
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        PortableUint(from_fn(|i| a.0[i] & mask.0[i] | b.0[i] & !mask.0[i]))
    }
    #[inline(always)]
    fn permute(self, index: Self) -> Self {
        PortableUint(from_fn(|i| self.0[index.0[i] as usize & (N - 1)]))
    }
    #[inline(always)]
    fn shr_each(self, by: Self) -> Self {
        PortableUint(from_fn(|i| self.0[i] >> (by.0[i] & 31)))
    }
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        PortableUint(self.0.map(u32::reverse_bits))
    }
}

impl<const N: usize> Real for Portable<N> {
    type Mask = PortableMask<N>;
    type Uint = PortableUint<N>;
    const LANES: usize = N;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Portable([x; N])
    }
    #[inline(always)]
    fn lit(x: f64) -> Self {
        Portable([x as f32; N])
    }
    #[inline(always)]
    fn load(slice: &[f32], at: usize) -> Self {
        Portable(from_fn(|i| slice[at..at + N][i]))
    }
    #[inline(always)]
    fn store(self, slice: &mut [f32], at: usize) {
        slice[at..at + N].copy_from_slice(&self.0);
    }
    #[inline(always)]
    unsafe fn gather(slice: &[f32], index: Self::Uint) -> Self {
        // SAFETY: the caller's promise.
        Portable(index.0.map(|i| unsafe { *slice.get_unchecked(i as usize) }))
    }
    #[inline(always)]
    fn compress(self, mask: Self::Mask, slice: &mut [f32], at: usize) {
        compress(self.0, mask, slice, at);
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Portable(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Portable(from_fn(|i| if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Portable(from_fn(|i| if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Portable(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn xor_sign(self, sign: Self) -> Self {
        Portable(from_fn(|i| f32::from_bits(self.0[i].to_bits() ^ sign.0[i].to_bits() & 0x8000_0000)))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        mask(|i| self.0[i] < other.0[i])
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        mask(|i| self.0[i] <= other.0[i])
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Self::Mask {
        mask(|i| self.0[i] == other.0[i])
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Portable(from_fn(|i| f32::from_bits(a.0[i].to_bits() & mask.0[i] | b.0[i].to_bits() & !mask.0[i])))
    }
    #[inline(always)]
    fn from_uint(u: Self::Uint) -> Self {
        Portable(u.0.map(|x| x as i32 as f32))
    }
    #[inline(always)]
    fn to_uint(self) -> Self::Uint {
        PortableUint(self.0.map(|x| x as i32 as u32))
    }
    #[inline(always)]
    fn sin_cos_turns(self) -> (Self, Self) {
        sin_cos_turns_f32(self)
    }
    #[inline(always)]
    fn to_bits(self) -> Self::Uint {
        PortableUint(self.0.map(f32::to_bits))
    }
    #[inline(always)]
    fn from_bits(u: Self::Uint) -> Self {
        Portable(u.0.map(f32::from_bits))
    }
}
