//! 4 and 8 lanes for AVX2 and FMA. Only to be used from functions compiled with those features ([`crate::isa`]).

use super::{Mask, Real, Uint, sin_cos_turns_f32};
use core::arch::x86_64::*;
use core::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

/// Lane orders that pack the set bits of an 8-bit mask to the front.
static PACK: [[u32; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut bits = 0;
    while bits < 256 {
        let (mut n, mut lane) = (0, 0);
        while lane < 8 {
            if bits >> lane & 1 == 1 {
                table[bits][n] = lane as u32;
                n += 1;
            }
            lane += 1;
        }
        bits += 1;
    }
    table
};

/// Byte shuffles that reverse the bits of a nibble (low and high) and the bytes of a word.
pub(super) const NIBBLE_LOW: [u8; 16] =
    [0x00, 0x80, 0x40, 0xC0, 0x20, 0xA0, 0x60, 0xE0, 0x10, 0x90, 0x50, 0xD0, 0x30, 0xB0, 0x70, 0xF0];
pub(super) const NIBBLE_HIGH: [u8; 16] =
    [0x0, 0x8, 0x4, 0xC, 0x2, 0xA, 0x6, 0xE, 0x1, 0x9, 0x5, 0xD, 0x3, 0xB, 0x7, 0xF];
pub(super) const BYTES: [u8; 16] = [3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12];

// SAFETY (all `unsafe` blocks around intrinsics in this file): the types are constructed and used only inside
// functions compiled with AVX2 and FMA, which `isa` enters after checking the CPU. Loads and stores go through
// slices whose bounds were checked.

macro_rules! lanes {
    ($n:literal, $F:ident, $U:ident, $M:ident, $f:ident, $i:ident,
     $set1_ps:ident, $set1_epi32:ident, $loadu_ps:ident, $storeu_ps:ident, $loadu_si:ident, $storeu_si:ident,
     $add_ps:ident, $sub_ps:ident, $mul_ps:ident, $div_ps:ident, $fmadd_ps:ident, $fmsub_ps:ident, $fnmadd_ps:ident,
     $sqrt_ps:ident, $min_ps:ident, $max_ps:ident, $and_ps:ident, $or_ps:ident, $xor_ps:ident, $andnot_ps:ident,
     $cmp_ps:ident, $blendv_ps:ident, $movemask_ps:ident, $cvtepi32_ps:ident, $cvttps_epi32:ident,
     $castsi_ps:ident, $castps_si:ident,
     $and_si:ident, $or_si:ident, $xor_si:ident, $add_epi32:ident, $sub_epi32:ident, $mullo_epi32:ident,
     $cmpeq_epi32:ident, $max_epu32:ident, $sllv:ident, $srlv:ident, $mul_epu32:ident, $srli_epi64:ident,
     $blend_epi32:ident, $odd:literal, $shuffle_epi8:ident, $set1_epi8:ident, $srli_epi16:ident, $permute:expr, $repeat:expr) => {
        #[doc = concat!(stringify!($n), " single-precision lanes.")]
        #[derive(Clone, Copy, Debug)]
        pub struct $F(pub $f);
        #[doc = concat!(stringify!($n), " unsigned lanes.")]
        #[derive(Clone, Copy, Debug)]
        pub struct $U(pub $i);
        #[doc = concat!(stringify!($n), " truth values, the sign bit of each lane counts.")]
        #[derive(Clone, Copy, Debug)]
        pub struct $M(pub $f);

        lanes!(@op $F, Add add $add_ps, Sub sub $sub_ps, Mul mul $mul_ps, Div div $div_ps);
        lanes!(@op $U, Add add $add_epi32, Sub sub $sub_epi32, Mul mul $mullo_epi32,
            BitAnd bitand $and_si, BitOr bitor $or_si, BitXor bitxor $xor_si);
        lanes!(@op $M, BitAnd bitand $and_ps, BitOr bitor $or_ps);

        impl Neg for $F {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                unsafe { $F($xor_ps(self.0, $set1_ps(-0.0))) }
            }
        }
        impl Not for $M {
            type Output = Self;
            #[inline(always)]
            fn not(self) -> Self {
                unsafe { $M($xor_ps(self.0, $castsi_ps($set1_epi32(-1)))) }
            }
        }
        impl super::sealed::Sealed for $M {}
        impl super::sealed::Sealed for $U {}
        impl super::sealed::Sealed for $F {}

        impl Mask for $M {
            #[inline(always)]
            fn bits(self) -> u32 {
                unsafe { $movemask_ps(self.0) as u32 }
            }
            #[inline(always)]
            fn from_bits(bits: u32) -> Self {
                const BIT: [u32; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
                unsafe {
                    let bit = $loadu_si(BIT.as_ptr().cast());
                    let lane = $and_si($set1_epi32(bits as i32), bit);
                    $M($castsi_ps($cmpeq_epi32(lane, bit)))
                }
            }
        }
        impl Uint for $U {
            type Mask = $M;
            #[inline(always)]
            fn splat(x: u32) -> Self {
                unsafe { $U($set1_epi32(x as i32)) }
            }
            #[inline(always)]
            fn load(slice: &[u32], at: usize) -> Self {
                let from = &slice[at..at + $n];
                unsafe { $U($loadu_si(from.as_ptr().cast())) }
            }
            #[inline(always)]
            fn store(self, slice: &mut [u32], at: usize) {
                let to = &mut slice[at..at + $n];
                unsafe { $storeu_si(to.as_mut_ptr().cast(), self.0) }
            }
            #[inline(always)]
            unsafe fn gather(slice: &[u32], index: Self) -> Self {
                let mut at = [0u32; $n];
                index.store(&mut at, 0);
                // Scalar loads: hardware gathers made the renderer 10 to 13 % slower (microcode against GDS).
                // No `array::map`: it is not always inlined here, depending on what else is in the program.
                let mut lanes = [Default::default(); $n];
                for (lane, i) in lanes.iter_mut().zip(at) {
                    // SAFETY: the caller's promise.
                    *lane = unsafe { *slice.get_unchecked(i as usize) };
                }
                Self::load(&lanes, 0)
            }
            #[inline(always)]
            fn compress(self, mask: $M, slice: &mut [u32], at: usize) {
                let to = &mut slice[at..at + $n];
                unsafe {
                    let order = $loadu_si(PACK[mask.bits() as usize].as_ptr().cast());
                    $storeu_si(to.as_mut_ptr().cast(), $permute(self.0, order))
                }
            }
            #[inline(always)]
            fn shl<const K: u32>(self) -> Self {
                unsafe { $U($sllv(self.0, $set1_epi32(K as i32))) }
            }
            #[inline(always)]
            fn shr<const K: u32>(self) -> Self {
                unsafe { $U($srlv(self.0, $set1_epi32(K as i32))) }
            }
            #[inline(always)]
            fn mul_high(self, other: Self) -> Self {
                unsafe {
                    let even = $srli_epi64::<32>($mul_epu32(self.0, other.0));
                    let odd = $mul_epu32($srli_epi64::<32>(self.0), $srli_epi64::<32>(other.0));
                    $U($blend_epi32::<$odd>(even, odd))
                }
            }
            #[inline(always)]
            fn eq(self, other: Self) -> $M {
                unsafe { $M($castsi_ps($cmpeq_epi32(self.0, other.0))) }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $M {
                // AVX2 compares signed only: a < b unless max(a, b) = a.
                unsafe { !$M($castsi_ps($cmpeq_epi32($max_epu32(self.0, other.0), self.0))) }
            }
            #[inline(always)]
            fn select(mask: $M, a: Self, b: Self) -> Self {
                unsafe { $U($castps_si($blendv_ps($castsi_ps(b.0), $castsi_ps(a.0), mask.0))) }
            }
            #[inline(always)]
            fn permute(self, index: Self) -> Self {
                unsafe { $U($permute(self.0, index.0)) }
            }
            #[inline(always)]
            fn shr_each(self, by: Self) -> Self {
                unsafe { $U($srlv(self.0, by.0)) }
            }
            #[inline(always)]
            fn reverse_bits(self) -> Self {
                unsafe {
                    let repeat = |table: [u8; 16]| {
                        let mut bytes = [0u8; $n * 4];
                        let mut k = 0;
                        while k < $n * 4 {
                            bytes[k] = table[k % 16];
                            k += 1;
                        }
                        $loadu_si(bytes.as_ptr().cast())
                    };
                    let low = $and_si(self.0, $set1_epi8(15));
                    let high = $and_si($srli_epi16::<4>(self.0), $set1_epi8(15));
                    let bits = $or_si(
                        $shuffle_epi8(repeat(NIBBLE_LOW), low),
                        $shuffle_epi8(repeat(NIBBLE_HIGH), high),
                    );
                    $U($shuffle_epi8(bits, repeat(BYTES)))
                }
            }
        }
        impl Real for $F {
            type Mask = $M;
            type Uint = $U;
            const LANES: usize = $n;
            #[inline(always)]
            fn splat(x: f32) -> Self {
                unsafe { $F($set1_ps(x)) }
            }
            #[inline(always)]
            fn lit(x: f64) -> Self {
                Self::splat(x as f32)
            }
            #[inline(always)]
            fn load(slice: &[f32], at: usize) -> Self {
                let from = &slice[at..at + $n];
                unsafe { $F($loadu_ps(from.as_ptr())) }
            }
            #[inline(always)]
            fn store(self, slice: &mut [f32], at: usize) {
                let to = &mut slice[at..at + $n];
                unsafe { $storeu_ps(to.as_mut_ptr(), self.0) }
            }
            #[inline(always)]
            unsafe fn gather(slice: &[f32], index: $U) -> Self {
                let mut at = [0u32; $n];
                index.store(&mut at, 0);
                // No `array::map`: it is not always inlined here, depending on what else is in the program.
                let mut lanes = [Default::default(); $n];
                for (lane, i) in lanes.iter_mut().zip(at) {
                    // SAFETY: the caller's promise.
                    *lane = unsafe { *slice.get_unchecked(i as usize) };
                }
                Self::load(&lanes, 0)
            }
            #[inline(always)]
            fn compress(self, mask: $M, slice: &mut [f32], at: usize) {
                self.to_bits().compress(mask, bytemuck::cast_slice_mut(slice), at);
            }
            #[inline(always)]
            fn repeat(four: &[f32; 4]) -> Self {
                unsafe { $F($repeat(_mm_loadu_ps(four.as_ptr()))) }
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                unsafe { $F($fmadd_ps(self.0, a.0, b.0)) }
            }
            #[inline(always)]
            fn mul_sub(self, a: Self, b: Self) -> Self {
                unsafe { $F($fmsub_ps(self.0, a.0, b.0)) }
            }
            #[inline(always)]
            fn neg_mul_add(self, a: Self, b: Self) -> Self {
                unsafe { $F($fnmadd_ps(self.0, a.0, b.0)) }
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                unsafe { $F($sqrt_ps(self.0)) }
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                unsafe { $F($min_ps(self.0, other.0)) }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                unsafe { $F($max_ps(self.0, other.0)) }
            }
            #[inline(always)]
            fn abs(self) -> Self {
                unsafe { $F($andnot_ps($set1_ps(-0.0), self.0)) }
            }
            #[inline(always)]
            fn xor_sign(self, sign: Self) -> Self {
                unsafe { $F($xor_ps(self.0, $and_ps(sign.0, $set1_ps(-0.0)))) }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $M {
                unsafe { $M($cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) }
            }
            #[inline(always)]
            fn le(self, other: Self) -> $M {
                unsafe { $M($cmp_ps::<_CMP_LE_OQ>(self.0, other.0)) }
            }
            #[inline(always)]
            fn eq(self, other: Self) -> $M {
                unsafe { $M($cmp_ps::<_CMP_EQ_OQ>(self.0, other.0)) }
            }
            #[inline(always)]
            fn select(mask: $M, a: Self, b: Self) -> Self {
                unsafe { $F($blendv_ps(b.0, a.0, mask.0)) }
            }
            #[inline(always)]
            fn from_uint(u: $U) -> Self {
                unsafe { $F($cvtepi32_ps(u.0)) }
            }
            #[inline(always)]
            fn to_uint(self) -> $U {
                unsafe { $U($cvttps_epi32(self.0)) }
            }
            #[inline(always)]
            fn sin_cos_turns(self) -> (Self, Self) {
                sin_cos_turns_f32(self)
            }
            #[inline(always)]
            fn to_bits(self) -> $U {
                unsafe { $U($castps_si(self.0)) }
            }
            #[inline(always)]
            fn from_bits(u: $U) -> Self {
                unsafe { $F($castsi_ps(u.0)) }
            }
        }
    };
    (@op $type:ident, $($trait:ident $method:ident $intrinsic:ident),*) => {$(
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                unsafe { $type($intrinsic(self.0, other.0)) }
            }
        }
    )*};
}

lanes!(
    8,
    F32x8,
    U32x8,
    M32x8,
    __m256,
    __m256i,
    _mm256_set1_ps,
    _mm256_set1_epi32,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_loadu_si256,
    _mm256_storeu_si256,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    _mm256_div_ps,
    _mm256_fmadd_ps,
    _mm256_fmsub_ps,
    _mm256_fnmadd_ps,
    _mm256_sqrt_ps,
    _mm256_min_ps,
    _mm256_max_ps,
    _mm256_and_ps,
    _mm256_or_ps,
    _mm256_xor_ps,
    _mm256_andnot_ps,
    _mm256_cmp_ps,
    _mm256_blendv_ps,
    _mm256_movemask_ps,
    _mm256_cvtepi32_ps,
    _mm256_cvttps_epi32,
    _mm256_castsi256_ps,
    _mm256_castps_si256,
    _mm256_and_si256,
    _mm256_or_si256,
    _mm256_xor_si256,
    _mm256_add_epi32,
    _mm256_sub_epi32,
    _mm256_mullo_epi32,
    _mm256_cmpeq_epi32,
    _mm256_max_epu32,
    _mm256_sllv_epi32,
    _mm256_srlv_epi32,
    _mm256_mul_epu32,
    _mm256_srli_epi64,
    _mm256_blend_epi32,
    0xAA,
    _mm256_shuffle_epi8,
    _mm256_set1_epi8,
    _mm256_srli_epi16,
    _mm256_permutevar8x32_epi32,
    |four| _mm256_set_m128(four, four)
);
lanes!(
    4,
    F32x4,
    U32x4,
    M32x4,
    __m128,
    __m128i,
    _mm_set1_ps,
    _mm_set1_epi32,
    _mm_loadu_ps,
    _mm_storeu_ps,
    _mm_loadu_si128,
    _mm_storeu_si128,
    _mm_add_ps,
    _mm_sub_ps,
    _mm_mul_ps,
    _mm_div_ps,
    _mm_fmadd_ps,
    _mm_fmsub_ps,
    _mm_fnmadd_ps,
    _mm_sqrt_ps,
    _mm_min_ps,
    _mm_max_ps,
    _mm_and_ps,
    _mm_or_ps,
    _mm_xor_ps,
    _mm_andnot_ps,
    _mm_cmp_ps,
    _mm_blendv_ps,
    _mm_movemask_ps,
    _mm_cvtepi32_ps,
    _mm_cvttps_epi32,
    _mm_castsi128_ps,
    _mm_castps_si128,
    _mm_and_si128,
    _mm_or_si128,
    _mm_xor_si128,
    _mm_add_epi32,
    _mm_sub_epi32,
    _mm_mullo_epi32,
    _mm_cmpeq_epi32,
    _mm_max_epu32,
    _mm_sllv_epi32,
    _mm_srlv_epi32,
    _mm_mul_epu32,
    _mm_srli_epi64,
    _mm_blend_epi32,
    0b1010,
    _mm_shuffle_epi8,
    _mm_set1_epi8,
    _mm_srli_epi16,
    |v, order| _mm_castps_si128(_mm_permutevar_ps(_mm_castsi128_ps(v), order)),
    |four| four
);
