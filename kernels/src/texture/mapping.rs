//! From a point of a surface to texture coordinates.

use super::Point;
use crate::lanes::{Real, Uint};
use crate::math::Vec3;
use core::f64::consts::{FRAC_1_PI, FRAC_PI_2};

/// An affine map of points, three rows of four.
pub type Affine = [[f32; 4]; 3];

/// How texture coordinates (s, t) follow from a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mapping {
    /// From those of the surface: (scale\[0\] u + delta\[0\], scale\[1\] v + delta\[1\]).
    Uv {
        /// Factors.
        scale: [f32; 2],
        /// Summands.
        delta: [f32; 2],
    },
    /// Polar angle over pi, azimuth over 2 pi.
    Spherical {
        /// Takes points of the world into the space of the texture.
        texture_from_world: Affine,
    },
    /// Azimuth over 2 pi, from -x on; height.
    Cylindrical {
        /// Takes points of the world into the space of the texture.
        texture_from_world: Affine,
        /// The height is that of the direction to the point, as in pbrt-v3, not of the point.
        of_direction: bool,
    },
    /// Two affine functions of the point: three factors and a summand each.
    Planar {
        /// The first.
        s: [f32; 4],
        /// The second.
        t: [f32; 4],
    },
}

impl Mapping {
    /// All its numbers, to be checked.
    pub(super) fn numbers(&self) -> Vec<f32> {
        match self {
            Mapping::Uv { scale, delta } => [scale.as_slice(), delta].concat(),
            Mapping::Spherical { texture_from_world } | Mapping::Cylindrical { texture_from_world, .. } => {
                texture_from_world.as_flattened().to_vec()
            }
            Mapping::Planar { s, t } => [s.as_slice(), t].concat(),
        }
    }

    /// The coordinates.
    #[inline(always)]
    pub(super) fn map<F: Real>(&self, at: &Point<F>) -> [F; 2] {
        match self {
            Mapping::Uv { scale, delta } => [
                F::splat(scale[0]).mul_add(at.uv[0], F::splat(delta[0])),
                F::splat(scale[1]).mul_add(at.uv[1], F::splat(delta[1])),
            ],
            Mapping::Spherical { texture_from_world } => {
                let p = transform_point(texture_from_world, at.position);
                [polar_angle(p) * F::lit(FRAC_1_PI), azimuth_turns(p.x, p.y)]
            }
            Mapping::Cylindrical { texture_from_world, of_direction } => {
                let p = transform_point(texture_from_world, at.position);
                let turns = azimuth_turns(-p.x, -p.y);
                let height = if *of_direction { p.z / p.length2().sqrt() } else { p.z };
                [turns, height]
            }
            Mapping::Planar { s, t } => [row(s, at.position), row(t, at.position)],
        }
    }
}

#[inline(always)]
fn row<F: Real>(row: &[f32; 4], p: Vec3<F>) -> F {
    let [x, y, z, w] = *row;
    F::splat(x).mul_add(p.x, F::splat(y).mul_add(p.y, F::splat(z).mul_add(p.z, F::splat(w))))
}

/// A point through an affine map.
#[inline(always)]
pub(super) fn transform_point<F: Real>(m: &Affine, p: Vec3<F>) -> Vec3<F> {
    Vec3::new(row(&m[0], p), row(&m[1], p), row(&m[2], p))
}

/// A vector through an affine map.
#[inline(always)]
pub(super) fn transform_vector<F: Real>(m: &Affine, v: Vec3<F>) -> Vec3<F> {
    let row = |r: &[f32; 4]| F::splat(r[0]).mul_add(v.x, F::splat(r[1]).mul_add(v.y, F::splat(r[2]) * v.z));
    Vec3::new(row(&m[0]), row(&m[1]), row(&m[2]))
}

/// The angle of (x, y), x and y not negative, in [0, pi / 2]; 0 for (0, 0).
///
/// Abramowitz and Stegun 4.4.49, with an error below 2e-8 before rounding, of the smaller ratio.
#[inline(always)]
fn angle<F: Real>(x: F, y: F) -> F {
    let steep = x.lt(y);
    let (low, high) = (x.min(y), x.max(y));
    let ratio = low / high.max(F::lit(f32::MIN_POSITIVE as f64));
    let r2 = ratio * ratio;
    let series = F::lit(0.002_866_225_7)
        .mul_add(r2, F::lit(-0.016_165_736_7))
        .mul_add(r2, F::lit(0.042_909_613_8))
        .mul_add(r2, F::lit(-0.075_289_640_0))
        .mul_add(r2, F::lit(0.106_562_639_3))
        .mul_add(r2, F::lit(-0.142_088_994_4))
        .mul_add(r2, F::lit(0.199_935_508_5))
        .mul_add(r2, F::lit(-0.333_331_452_8));
    let small = (series * r2).mul_add(ratio, ratio);
    F::select(steep, F::lit(FRAC_PI_2) - small, small)
}

/// The azimuth of (x, y) in turns, in [0, 1]; 0 for (0, 0).
#[inline(always)]
pub(crate) fn azimuth_turns<F: Real>(x: F, y: F) -> F {
    let quarter = angle(x.abs(), y.abs()) * F::lit(0.5 * FRAC_1_PI);
    let half = F::select(x.lt(F::zero()), F::lit(0.5) - quarter, quarter);
    F::select(y.lt(F::zero()), F::one() - half, half)
}

/// The angle between a vector and +z, in [0, pi].
#[inline(always)]
pub(crate) fn polar_angle<F: Real>(p: Vec3<F>) -> F {
    let across = p.x.mul_add(p.x, p.y * p.y).sqrt();
    let from_axis = angle(p.z.abs(), across);
    F::select(p.z.lt(F::zero()), F::lit(core::f64::consts::PI) - from_axis, from_axis)
}

/// The largest whole number that is not above `x`; `x` itself from 2^23 on, where all numbers are whole.
#[inline(always)]
pub(super) fn floor<F: Real>(x: F) -> F {
    let limit = F::lit(8_388_608.0);
    let magnitude = x.abs();
    let whole = F::from_uint(magnitude.min(limit).to_uint()).xor_sign(x);
    let floor = F::select(x.lt(whole), whole - F::one(), whole);
    F::select(magnitude.lt(limit), floor, x)
}

/// The whole number `x` modulo `n`, a power of two up to 2^23.
#[inline(always)]
pub(super) fn whole_modulo<F: Real>(x: F, n: f64) -> F::Uint {
    let rest = floor(x * F::lit(1.0 / n)).neg_mul_add(F::lit(n), x);
    // Numbers that are none are nowhere.
    rest.max(F::zero()).min(F::lit(n - 1.0)).to_uint() & F::Uint::splat(n as u32 - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_library() {
        let mut worst = 0.0f64;
        for i in 0..2000 {
            let phi = i as f64 * 0.003_141_7;
            let (y, x) = phi.sin_cos();
            let (x, y) = (x as f32 * 3.0, y as f32 * 3.0);
            let want = (y as f64).atan2(x as f64).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
            let off = (azimuth_turns(x, y) as f64 - want).abs();
            worst = worst.max(off.min(1.0 - off));
            let p = Vec3::new(x * 0.6, x * 0.8, y);
            let want = (p.x.hypot(p.y) as f64).atan2(y as f64);
            worst = worst.max((polar_angle(p) as f64 - want).abs());
        }
        assert!(worst < 4e-7, "{worst}");
        assert_eq!(azimuth_turns(0.0f32, 0.0), 0.0);
    }

    #[test]
    fn floors_are_those_of_the_library() {
        for x in [0.0f32, 0.5, -0.5, -1.0, 1.0, 3.999, -3.999, 8_388_607.5, -8_388_607.5, 1e20, -1e20] {
            assert_eq!(floor(x), x.floor(), "{x}");
        }
        for (x, want) in [(0.0f32, 0), (255.0, 255), (256.0, 0), (-1.0, 255), (-257.0, 255)] {
            assert_eq!(whole_modulo::<f32>(x, 256.0).0, want, "{x}");
        }
    }
}
