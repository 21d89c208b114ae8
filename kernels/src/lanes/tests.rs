//! Every lane type against the one-lane types, on all instruction sets of this machine.

use super::*;
use crate::isa::{Isa, Kernel, Level};

/// Runs `check::<I>()` on every instruction set.
macro_rules! on_all_sets {
    ($check:ident) => {{
        struct Run;
        impl Kernel for Run {
            type Output = ();
            #[inline(always)]
            fn run<I: Isa>(self, _: I) {
                $check::<I::Wide>();
                $check::<I::Eight>();
                $check::<I::Four>();
                $check::<I::One>();
            }
        }
        Level::available().for_each(|level| level.run(Run));
    }};
}

const VALUES: [f32; 20] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    3.75,
    -2.25e-3,
    1e30,
    -1e30,
    1e-30,
    7.0,
    0.1,
    0.9999999,
    123456.7,
    -8.5,
    2.0,
    3.0,
    f32::INFINITY,
    1e-40,
    42.0,
];

#[inline(always)]
fn reals<F: Real>() {
    for at in 0..=VALUES.len() - F::LANES {
        let a = F::load(&VALUES, at);
        let b = F::load(&VALUES, VALUES.len() - F::LANES - at);
        let check = |name: &str, got: F, want: fn(f32, f32) -> f32| {
            for i in 0..F::LANES {
                let (x, y) = (VALUES[at + i], VALUES[VALUES.len() - F::LANES - at + i]);
                let (got, want) = (got.to_array()[i], want(x, y));
                assert!(
                    got.to_bits() == want.to_bits() || got.is_nan() && want.is_nan(),
                    "{name}({x}, {y}) = {got}, not {want}"
                );
            }
        };
        check("add", a + b, |x, y| x + y);
        check("sub", a - b, |x, y| x - y);
        check("mul", a * b, |x, y| x * y);
        check("div", a / b, |x, y| x / y);
        check("neg", -a, |x, _| -x);
        check("abs", a.abs(), |x, _| x.abs());
        check("sqrt", a.sqrt(), |x, _| x.sqrt());
        check("min", a.min(b), |x, y| if x < y { x } else { y });
        check("max", a.max(b), |x, y| if x > y { x } else { y });
        check("xor_sign", a.xor_sign(b), |x, y| if y.is_sign_negative() { -x } else { x });
        check("select", F::select(a.lt(b), a, b), |x, y| if x < y { x } else { y });
        check("select le", F::select(a.le(b), F::one(), F::zero()), |x, y| (x <= y) as u8 as f32);
        check("bits", F::from_bits(a.to_bits()), |x, _| x);
        let lanes = &VALUES[at..at + F::LANES];
        assert_eq!(a.least(), lanes.iter().copied().fold(f32::INFINITY, f32::min));
        assert_eq!(a.largest(), lanes.iter().copied().fold(f32::NEG_INFINITY, f32::max));
        let repeated = F::repeat(&[1.0, 2.0, 3.0, 4.0]).to_array();
        assert!((0..F::LANES).all(|i| repeated[i] == (i % 4 + 1) as f32));
    }
}

#[inline(always)]
fn packing<F: Real>() {
    let numbers: [f32; 16] = core::array::from_fn(|i| i as f32 + 1.0);
    let v = F::load(&numbers, 0);
    for bits in 0..1u32 << F::LANES.min(10) {
        let mask = F::Mask::from_bits(bits);
        assert_eq!(mask.bits(), bits & ((1u64 << F::LANES) - 1) as u32);
        let mut out = [0.0; 20];
        v.compress(mask, &mut out, 2);
        let want: Vec<f32> = (0..F::LANES).filter(|i| bits >> i & 1 == 1).map(|i| numbers[i]).collect();
        assert_eq!(out[2..2 + want.len()], want);
        assert_eq!(mask.count(), want.len());
        assert_eq!(
            (!mask).count(),
            if F::LANES == 1 { 1 - want.len() } else { (!mask).bits().count_ones() as usize }
        );
    }
}

#[inline(always)]
fn integers<F: Real>() {
    let a: [u32; 16] = core::array::from_fn(|i| (i as u32 + 3).wrapping_mul(0x9E37_79B9));
    let b: [u32; 16] = core::array::from_fn(|i| (i as u32 + 7).wrapping_mul(0x85EB_CA6B));
    let (x, y) = (F::Uint::load(&a, 0), F::Uint::load(&b, 0));
    let check = |name: &str, got: F::Uint, want: fn(u32, u32) -> u32| {
        for i in 0..F::LANES {
            assert_eq!(got.to_array()[i], want(a[i], b[i]), "{name} of {} and {}", a[i], b[i]);
        }
    };
    check("add", x + y, u32::wrapping_add);
    check("sub", x - y, u32::wrapping_sub);
    check("mul", x * y, u32::wrapping_mul);
    check("mul_high", x.mul_high(y), |a, b| ((a as u64 * b as u64) >> 32) as u32);
    check("shl", x.shl::<5>(), |a, _| a << 5);
    check("shr", x.shr::<9>(), |a, _| a >> 9);
    check("reverse", x.reverse_bits(), |a, _| a.reverse_bits());
    check("lt", F::Uint::select(x.lt(y), x, y), u32::min);
    check("eq", F::Uint::select(x.eq(x), x, y), |a, _| a);
    check("xor", x ^ y, |a, b| a ^ b);
    check("shr_each", x.shr_each(y & F::Uint::splat(31)), |a, b| a >> (b & 31));
    let permuted = x.permute(y).to_array();
    let permuted_reals = F::from_bits(x).permute(y).to_bits().to_array();
    for i in 0..F::LANES {
        assert_eq!(permuted[i], a[b[i] as usize % F::LANES]);
        assert_eq!(permuted_reals[i], permuted[i]);
    }
    let index: [u32; 16] = core::array::from_fn(|i| (15 - i) as u32);
    // SAFETY: all indices are below 16.
    let gathered = unsafe { F::Uint::gather(&a, F::Uint::load(&index, 0)) };
    for i in 0..F::LANES {
        assert_eq!(gathered.to_array()[i], a[15 - i]);
        let u = F::unit_from_bits(x).to_array()[i];
        assert_eq!(u, (a[i] >> 8) as f32 / 16_777_216.0);
    }
}

#[inline(always)]
fn trigonometry<F: Real>() {
    for k in 0..=4096 {
        let turns = k as f32 / 4096.0;
        let (sin, cos) = F::splat(turns).sin_cos_turns();
        let (s, c) = (core::f64::consts::TAU * turns as f64).sin_cos();
        assert!((sin.to_array()[0] as f64 - s).abs() < 2e-7, "sin of {turns} turns");
        assert!((cos.to_array()[0] as f64 - c).abs() < 2e-7, "cos of {turns} turns");
    }
}

#[test]
fn operations_equal_the_scalar_ones() {
    on_all_sets!(reals);
    reals::<f32>();
}

#[test]
fn compress_packs_the_set_lanes() {
    on_all_sets!(packing);
}

#[test]
fn integer_operations_equal_the_scalar_ones() {
    on_all_sets!(integers);
}

#[test]
fn sine_and_cosine_are_accurate() {
    on_all_sets!(trigonometry);
    trigonometry::<f64>();
}
