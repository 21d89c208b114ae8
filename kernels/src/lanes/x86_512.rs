//! 16 lanes for AVX-512 F, DQ, VL and BW. Only to be used from functions compiled with those features
//! ([`crate::isa`]).

use super::x86::{BYTES, NIBBLE_HIGH, NIBBLE_LOW};
use super::{Mask, Real, Uint, sin_cos_turns_f32};
use core::arch::x86_64::*;
use core::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

// SAFETY (all `unsafe` blocks around intrinsics in this file): the types are constructed and used only inside
// functions compiled with these features, which `isa` enters after checking the CPU. Loads and stores go through
// slices whose bounds were checked.

/// `[f(a[0]), f(a[1]), ...]`, written out: `array::map` is not always inlined here, depending on what else is in the
/// program, and what is not inlined is compiled without the instruction set (it made whole renders a sixth slower).
macro_rules! each16 {
    ($array:expr, |$x:ident| $f:expr) => {
        each16!(@ $array, $x, $f, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15)
    };
    (@ $array:expr, $x:ident, $f:expr, $($k:literal)*) => {
        [$({
            let $x = $array[$k];
            $f
        }),*]
    };
}

/// 16 single-precision lanes.
#[derive(Clone, Copy, Debug)]
pub struct F32x16(pub __m512);
/// 16 unsigned lanes.
#[derive(Clone, Copy, Debug)]
pub struct U32x16(pub __m512i);
/// 16 truth values.
#[derive(Clone, Copy, Debug)]
pub struct M16(pub u16);

macro_rules! operator {
    ($type:ident, $($trait:ident $method:ident $intrinsic:ident),*) => {$(
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                unsafe { $type($intrinsic(self.0, other.0)) }
            }
        }
    )*};
}
operator!(F32x16, Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps);
operator!(U32x16, Add add _mm512_add_epi32, Sub sub _mm512_sub_epi32, Mul mul _mm512_mullo_epi32,
    BitAnd bitand _mm512_and_si512, BitOr bitor _mm512_or_si512, BitXor bitxor _mm512_xor_si512);

impl Neg for F32x16 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        unsafe { F32x16(_mm512_xor_ps(self.0, _mm512_set1_ps(-0.0))) }
    }
}
impl BitAnd for M16 {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        M16(self.0 & other.0)
    }
}
impl BitOr for M16 {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        M16(self.0 | other.0)
    }
}
impl Not for M16 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        M16(!self.0)
    }
}
impl super::sealed::Sealed for M16 {}
impl super::sealed::Sealed for U32x16 {}
impl super::sealed::Sealed for F32x16 {}

impl Mask for M16 {
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0 as u32
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        M16(bits as u16)
    }
}

impl Uint for U32x16 {
    type Mask = M16;
    #[inline(always)]
    fn splat(x: u32) -> Self {
        unsafe { U32x16(_mm512_set1_epi32(x as i32)) }
    }
    #[inline(always)]
    fn load(slice: &[u32], at: usize) -> Self {
        let from = &slice[at..at + 16];
        unsafe { U32x16(_mm512_loadu_si512(from.as_ptr().cast())) }
    }
    #[inline(always)]
    fn store(self, slice: &mut [u32], at: usize) {
        let to = &mut slice[at..at + 16];
        unsafe { _mm512_storeu_si512(to.as_mut_ptr().cast(), self.0) }
    }
    #[inline(always)]
    unsafe fn gather(slice: &[u32], index: Self) -> Self {
        let at = index.to_array();
        // Scalar loads: hardware gathers made the renderer 10 to 13 % slower (microcode against GDS).
        // SAFETY: the caller's promise.
        let lanes = each16!(at, |i| unsafe { *slice.get_unchecked(i as usize) });
        Self::load(&lanes, 0)
    }
    #[inline(always)]
    fn compress(self, mask: M16, slice: &mut [u32], at: usize) {
        let to = &mut slice[at..at + 16];
        // In a register, then a plain store: compressing into memory is microcode on Zen 4 and 5.
        unsafe { _mm512_storeu_si512(to.as_mut_ptr().cast(), _mm512_maskz_compress_epi32(mask.0, self.0)) }
    }
    #[inline(always)]
    fn shl<const K: u32>(self) -> Self {
        unsafe { U32x16(_mm512_slli_epi32::<K>(self.0)) }
    }
    #[inline(always)]
    fn shr<const K: u32>(self) -> Self {
        unsafe { U32x16(_mm512_srli_epi32::<K>(self.0)) }
    }
    #[inline(always)]
    fn mul_high(self, other: Self) -> Self {
        unsafe {
            let even = _mm512_srli_epi64::<32>(_mm512_mul_epu32(self.0, other.0));
            let odd = _mm512_mul_epu32(_mm512_srli_epi64::<32>(self.0), _mm512_srli_epi64::<32>(other.0));
            U32x16(_mm512_mask_blend_epi32(0xAAAA, even, odd))
        }
    }
    #[inline(always)]
    fn eq(self, other: Self) -> M16 {
        unsafe { M16(_mm512_cmpeq_epi32_mask(self.0, other.0)) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> M16 {
        unsafe { M16(_mm512_cmplt_epu32_mask(self.0, other.0)) }
    }
    #[inline(always)]
    fn select(mask: M16, a: Self, b: Self) -> Self {
        unsafe { U32x16(_mm512_mask_blend_epi32(mask.0, b.0, a.0)) }
    }
    #[inline(always)]
    fn permute(self, index: Self) -> Self {
        unsafe { U32x16(_mm512_permutexvar_epi32(index.0, self.0)) }
    }
    #[inline(always)]
    fn shr_each(self, by: Self) -> Self {
        unsafe { U32x16(_mm512_srlv_epi32(self.0, by.0)) }
    }
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        unsafe {
            let repeat = |table: [u8; 16]| _mm512_broadcast_i32x4(_mm_loadu_si128(table.as_ptr().cast()));
            let nibble = _mm512_set1_epi8(15);
            let low = _mm512_and_si512(self.0, nibble);
            let high = _mm512_and_si512(_mm512_srli_epi16::<4>(self.0), nibble);
            let bits = _mm512_or_si512(
                _mm512_shuffle_epi8(repeat(NIBBLE_LOW), low),
                _mm512_shuffle_epi8(repeat(NIBBLE_HIGH), high),
            );
            U32x16(_mm512_shuffle_epi8(bits, repeat(BYTES)))
        }
    }
}

impl Real for F32x16 {
    type Mask = M16;
    type Uint = U32x16;
    const LANES: usize = 16;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        unsafe { F32x16(_mm512_set1_ps(x)) }
    }
    #[inline(always)]
    fn lit(x: f64) -> Self {
        Self::splat(x as f32)
    }
    #[inline(always)]
    fn load(slice: &[f32], at: usize) -> Self {
        let from = &slice[at..at + 16];
        unsafe { F32x16(_mm512_loadu_ps(from.as_ptr())) }
    }
    #[inline(always)]
    fn store(self, slice: &mut [f32], at: usize) {
        let to = &mut slice[at..at + 16];
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    unsafe fn gather(slice: &[f32], index: U32x16) -> Self {
        let at = index.to_array();
        // SAFETY: the caller's promise.
        let lanes = each16!(at, |i| unsafe { *slice.get_unchecked(i as usize) });
        Self::load(&lanes, 0)
    }
    #[inline(always)]
    fn compress(self, mask: M16, slice: &mut [f32], at: usize) {
        let to = &mut slice[at..at + 16];
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), _mm512_maskz_compress_ps(mask.0, self.0)) }
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        unsafe { F32x16(_mm512_fmadd_ps(self.0, a.0, b.0)) }
    }
    #[inline(always)]
    fn mul_sub(self, a: Self, b: Self) -> Self {
        unsafe { F32x16(_mm512_fmsub_ps(self.0, a.0, b.0)) }
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        unsafe { F32x16(_mm512_fnmadd_ps(self.0, a.0, b.0)) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        unsafe { F32x16(_mm512_sqrt_ps(self.0)) }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        unsafe { F32x16(_mm512_min_ps(self.0, other.0)) }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { F32x16(_mm512_max_ps(self.0, other.0)) }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { F32x16(_mm512_abs_ps(self.0)) }
    }
    #[inline(always)]
    fn xor_sign(self, sign: Self) -> Self {
        unsafe { F32x16(_mm512_xor_ps(self.0, _mm512_and_ps(sign.0, _mm512_set1_ps(-0.0)))) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> M16 {
        unsafe { M16(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0)) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> M16 {
        unsafe { M16(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0)) }
    }
    #[inline(always)]
    fn eq(self, other: Self) -> M16 {
        unsafe { M16(_mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, other.0)) }
    }
    #[inline(always)]
    fn select(mask: M16, a: Self, b: Self) -> Self {
        unsafe { F32x16(_mm512_mask_blend_ps(mask.0, b.0, a.0)) }
    }
    #[inline(always)]
    fn from_uint(u: U32x16) -> Self {
        unsafe { F32x16(_mm512_cvtepi32_ps(u.0)) }
    }
    #[inline(always)]
    fn to_uint(self) -> U32x16 {
        unsafe { U32x16(_mm512_cvttps_epi32(self.0)) }
    }
    #[inline(always)]
    fn sin_cos_turns(self) -> (Self, Self) {
        sin_cos_turns_f32(self)
    }
    #[inline(always)]
    fn to_bits(self) -> U32x16 {
        unsafe { U32x16(_mm512_castps_si512(self.0)) }
    }
    #[inline(always)]
    fn from_bits(u: U32x16) -> Self {
        unsafe { F32x16(_mm512_castsi512_ps(u.0)) }
    }
    #[inline(always)]
    fn repeat(four: &[f32; 4]) -> Self {
        unsafe { F32x16(_mm512_broadcast_f32x4(_mm_loadu_ps(four.as_ptr()))) }
    }
    #[inline(always)]
    fn least(self) -> f32 {
        unsafe { _mm512_reduce_min_ps(self.0) }
    }
    #[inline(always)]
    fn largest(self) -> f32 {
        unsafe { _mm512_reduce_max_ps(self.0) }
    }
}
