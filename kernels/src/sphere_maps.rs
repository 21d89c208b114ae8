//! Maps between directions and the unit square, with which pictures cover the sphere.
//!
//! Squares are as pictures have them: `u` to the right, `v` downwards.

use crate::lanes::Real;
use crate::math::Vec3;

/// atan(x) in turns, for x in \[0, 1\]; relative error below 3e-9 but for rounding. (The Chebyshev interpolation of
/// atan(x) / x in x^2.)
#[inline(always)]
fn atan_turns<F: Real>(x: F) -> F {
    const COEFFICIENTS: [f64; 10] = [
        0.159_154_942_639_982_14,
        -0.053_051_556_913_171_19,
        0.031_827_925_333_235_176,
        -0.022_695_520_481_981_5,
        0.017_399_361_897_377_476,
        -0.013_289_000_028_332_484,
        0.009_086_085_036_403_659,
        -0.004_830_649_323_588_46,
        0.001_669_161_226_055_357,
        -0.000_270_749_625_990_542_96,
    ];
    let x2 = x * x;
    let mut sum = F::lit(COEFFICIENTS[9]);
    let mut k = 9;
    while k > 0 {
        k -= 1;
        sum = sum.mul_add(x2, F::lit(COEFFICIENTS[k]));
    }
    sum * x
}

/// The angle of (x, y), none of them negative, in turns: 0 to 1/4; 0 for (0, 0).
#[inline(always)]
fn quadrant_turns<F: Real>(x: F, y: F) -> F {
    let longer = x.max(y);
    let ratio = x.min(y) / F::select(longer.gt(F::zero()), longer, F::one());
    let turns = atan_turns(ratio);
    F::select(y.gt(x), F::lit(0.25) - turns, turns)
}

/// The azimuth of (x, y) in turns: 0 to 1.
#[inline(always)]
fn turns<F: Real>(x: F, y: F) -> F {
    let turns = quadrant_turns(x.abs(), y.abs());
    let turns = F::select(x.lt(F::zero()), F::lit(0.5) - turns, turns);
    F::select(y.lt(F::zero()), F::one() - turns, turns)
}

/// Latitude and longitude: `u` is the azimuth in turns, `v` the angle to +z in half turns. For unit directions.
#[inline(always)]
pub fn sphere_to_lat_long<F: Real>(d: Vec3<F>) -> [F; 2] {
    let sin = sin_to_z(d);
    let down = quadrant_turns(d.z.abs(), sin);
    let down = F::select(d.z.lt(F::zero()), F::lit(0.5) - down, down);
    [turns(d.x, d.y), down * F::lit(2.0)]
}

/// Sine of the angle to +z.
#[inline(always)]
pub fn sin_to_z<F: Real>(d: Vec3<F>) -> F {
    d.x.mul_add(d.x, d.y * d.y).sqrt()
}

/// The inverse of [`sphere_to_lat_long`].
#[inline(always)]
pub fn lat_long_to_sphere<F: Real>([u, v]: [F; 2]) -> Vec3<F> {
    let (sin_phi, cos_phi) = u.max(F::zero()).min(F::one()).sin_cos_turns();
    let (sin, cos) = (v.max(F::zero()).min(F::one()) * F::lit(0.5)).sin_cos_turns();
    let sin = sin.abs();
    Vec3::new(sin * cos_phi, sin * sin_phi, cos)
}

/// The equal-area map of Clarberg ("Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD", 2008): the octahedron's
/// upper half in the inner square, the lower one folded out to the corners, with the same solid angle everywhere. For
/// unit directions.
#[inline(always)]
pub fn sphere_to_equal_area<F: Real>(d: Vec3<F>) -> [F; 2] {
    let one = F::one();
    // 1 - |z|, without cancellation.
    let r = (d.x.mul_add(d.x, d.y * d.y) / (one + d.z.abs())).sqrt();
    let along = quadrant_turns(d.x.abs(), d.y.abs()) * F::lit(4.0) * r;
    let (u, v) = (r - along, along);
    let below = d.z.lt(F::zero());
    let (u, v) = (F::select(below, one - v, u), F::select(below, one - u, v));
    let half = F::lit(0.5);
    [u.xor_sign(d.x).mul_add(half, half), v.xor_sign(d.y).mul_add(half, half)]
}

/// The inverse of [`sphere_to_equal_area`].
#[inline(always)]
pub fn equal_area_to_sphere<F: Real>([u, v]: [F; 2]) -> Vec3<F> {
    let (one, two) = (F::one(), F::lit(2.0));
    let (u, v) = (u.mul_add(two, -one), v.mul_add(two, -one));
    let (across, along) = (u.abs(), v.abs());
    let inside = one - (across + along);
    let r = (one - inside.abs()).max(F::zero());
    // An eighth of a turn is where both are equal.
    let ratio = (along - across) / F::select(r.gt(F::zero()), r, one);
    let phi = (ratio + one) * F::lit(0.125);
    let (sin, cos) = phi.max(F::zero()).min(F::lit(0.25)).sin_cos_turns();
    let flat = r * r.neg_mul_add(r, two).sqrt();
    let z = r.neg_mul_add(r, one).xor_sign(inside);
    // Rounding may leave a sine or cosine just below 0.
    Vec3::new((cos.abs() * flat).xor_sign(u), (sin.abs() * flat).xor_sign(v), z)
}
