//! Torus knots: a tube around a closed curve that winds round a torus.

use super::error::{bad, check_count, check_range, check_triangles};
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::DVec3;
use std::f64::consts::TAU;

/// A tube along the (p, q) torus knot, around the y axis.
///
/// The curve, for t in [0, 2 pi): `((R + r cos qt) cos pt, r sin qt, (R + r cos qt) sin pt)`. Where the tube is
/// thicker than the knot has room for, it runs through itself: still closed, but no solid to make of glass.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct TorusKnot {
    /// Times that the curve runs round the y axis
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().p))]
    pub p: u32,
    /// Times that it runs round the ring; no common divisor with p
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().q))]
    pub q: u32,
    /// Radius R of the ring
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().radius))]
    pub radius: f64,
    /// Distance r of the curve from the ring
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().distance))]
    pub distance: f64,
    /// Radius of the tube
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().tube))]
    pub tube: f64,
    /// Segments along the curve
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().segments))]
    pub segments: u32,
    /// Sides around the tube
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().sides))]
    pub sides: u32,
}

impl Default for TorusKnot {
    fn default() -> Self {
        TorusKnot { p: 2, q: 3, radius: 1.0, distance: 0.45, tube: 0.22, segments: 384, sides: 32 }
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

impl TorusKnot {
    /// Makes the mesh: `2 * segments * sides` triangles, Euler characteristic 0.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_count("p", self.p, 1, 1000)?;
        check_count("q", self.q, 1, 1000)?;
        if gcd(self.p, self.q) != 1 {
            return Err(bad("q", self.q, format!("a number without a common divisor with --p {}", self.p)));
        }
        check_range("radius", self.radius, 1e-6, 1e6)?;
        check_range("distance", self.distance, 1e-3 * self.radius, 0.999 * self.radius)?;
        check_range("tube", self.tube, 1e-4 * self.distance, self.distance)?;
        check_count("segments", self.segments, 3, 1 << 26)?;
        check_count("sides", self.sides, 3, 1 << 26)?;
        check_triangles("segments", self.segments, 2 * u128::from(self.segments) * u128::from(self.sides))?;

        let mut b = Builder::default();
        let (p, q) = (f64::from(self.p), f64::from(self.q));
        for i in 0..self.segments {
            let t = TAU * f64::from(i) / f64::from(self.segments);
            let ((sp, cp), (sq, cq)) = ((p * t).sin_cos(), (q * t).sin_cos());
            let ring = self.radius + self.distance * cq;
            let center = DVec3::new(ring * cp, self.distance * sq, ring * sp);
            let tangent = DVec3::new(
                -q * self.distance * sq * cp - p * ring * sp,
                q * self.distance * cq,
                -q * self.distance * sq * sp + p * ring * cp,
            )
            .normalize();
            // The torus' own normal is perpendicular to the curve on it: a frame that closes without a twist.
            let normal = DVec3::new(cq * cp, sq, cq * sp);
            let binormal = tangent.cross(normal);
            for j in 0..self.sides {
                let (s, c) = (TAU * f64::from(j) / f64::from(self.sides)).sin_cos();
                let n = c * normal + s * binormal;
                b.vertex(center + self.tube * n, n);
            }
        }
        for i in 0..self.segments {
            let next = (i + 1) % self.segments;
            for j in 0..self.sides {
                let up = (j + 1) % self.sides;
                let at = |i: u32, j: u32| i * self.sides + j;
                b.quad(at(i, j), at(i, up), at(next, up), at(next, j));
            }
        }
        Ok(b.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;

    #[test]
    fn knots_are_closed_tubes_of_the_expected_volume() {
        for (p, q) in [(1, 1), (2, 3), (3, 2), (3, 5), (5, 2)] {
            let knot = TorusKnot { p, q, tube: 0.05, segments: 2000, sides: 24, ..TorusKnot::default() };
            let mesh = knot.build().unwrap();
            let topology = assert_closed(&mesh);
            assert_eq!(topology.euler_characteristic, 0);
            // Pappus: volume = area of the tube's section times length of the curve.
            let points = 100_000;
            let at = |i: u32| {
                let t = TAU * f64::from(i) / f64::from(points);
                let ring = knot.radius + knot.distance * (f64::from(q) * t).cos();
                let (s, c) = (f64::from(p) * t).sin_cos();
                DVec3::new(ring * c, knot.distance * (f64::from(q) * t).sin(), ring * s)
            };
            let length: f64 = (0..points).map(|i| at(i).distance(at((i + 1) % points))).sum();
            let section = 0.5 * 24.0 * (TAU / 24.0).sin() * knot.tube * knot.tube;
            assert!((topology.signed_volume / (section * length) - 1.0).abs() < 1e-3, "{p} {q} {topology:?}");
        }
    }

    #[test]
    fn bad_parameters_are_refused_by_name() {
        let fails = |knot: TorusKnot, option: &str| {
            let message = knot.build().unwrap_err().to_string();
            assert!(message.starts_with(&format!("--{option}: ")), "{message}");
        };
        let knot = TorusKnot::default();
        fails(TorusKnot { p: 0, ..knot.clone() }, "p");
        fails(TorusKnot { p: 2, q: 4, ..knot.clone() }, "q");
        fails(TorusKnot { segments: 0, ..knot.clone() }, "segments");
        fails(TorusKnot { sides: 2, ..knot.clone() }, "sides");
        fails(TorusKnot { tube: f64::NAN, ..knot.clone() }, "tube");
        fails(TorusKnot { segments: 1 << 26, sides: 1 << 26, ..knot.clone() }, "segments");
    }
}
