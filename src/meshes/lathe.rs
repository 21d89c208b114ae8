//! Lathes: a profile turned round the y axis.

use super::error::{check_count, check_range, check_triangles};
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// What the lathe turns. All are about 1 high and stand on y = 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum LatheProfile {
    /// A wine glass with a wall: one closed body of glass, hollow above
    WineGlass,
    /// A bellied vase with a wall
    Vase,
    /// A chess pawn
    Pawn,
}

impl LatheProfile {
    /// The profile as (radius, height), from the axis below, outwards, up and back to the axis. Smooth curves run
    /// through the points of each piece; pieces meet in sharp edges.
    fn pieces(self) -> &'static [&'static [(f64, f64)]] {
        match self {
            LatheProfile::WineGlass => &[&[
                // Foot: hollow below, round at the rim.
                (0.0, 0.014),
                (0.16, 0.010),
                (0.29, 0.001),
                (0.305, 0.0),
                (0.314, 0.007),
                (0.305, 0.015),
                // Up the foot and the stem.
                (0.20, 0.026),
                (0.09, 0.048),
                (0.042, 0.09),
                (0.028, 0.17),
                (0.026, 0.29),
                (0.030, 0.40),
                // Bowl outside.
                (0.060, 0.452),
                (0.145, 0.50),
                (0.235, 0.58),
                (0.283, 0.69),
                (0.283, 0.80),
                (0.258, 0.92),
                (0.238, 1.0),
                // Rim.
                (0.2345, 1.004),
                (0.231, 1.0),
                // Bowl inside.
                (0.249, 0.92),
                (0.273, 0.80),
                (0.273, 0.69),
                (0.226, 0.587),
                (0.138, 0.512),
                (0.060, 0.478),
                (0.0, 0.468),
            ]],
            LatheProfile::Vase => &[
                &[(0.0, 0.0), (0.19, 0.0)],
                &[
                    (0.19, 0.0),
                    (0.27, 0.10),
                    (0.35, 0.25),
                    (0.365, 0.40),
                    (0.30, 0.58),
                    (0.18, 0.74),
                    (0.135, 0.85),
                    (0.16, 0.94),
                    (0.215, 0.995),
                    (0.215, 1.01),
                    (0.20, 1.008),
                    (0.145, 0.955),
                    (0.115, 0.85),
                    (0.16, 0.73),
                    (0.275, 0.57),
                    (0.34, 0.40),
                    (0.325, 0.26),
                    (0.25, 0.12),
                    (0.15, 0.045),
                    (0.0, 0.03),
                ],
            ],
            LatheProfile::Pawn => &[
                &[(0.0, 0.0), (0.30, 0.0)],
                &[(0.30, 0.0), (0.325, 0.035), (0.30, 0.075)],
                &[(0.30, 0.075), (0.275, 0.085), (0.265, 0.11)],
                &[(0.265, 0.11), (0.255, 0.14), (0.215, 0.165), (0.18, 0.18)],
                &[(0.18, 0.18), (0.13, 0.26), (0.105, 0.38), (0.095, 0.52)],
                &[(0.095, 0.52), (0.165, 0.535), (0.18, 0.55), (0.165, 0.565), (0.092, 0.58)],
                // Head: a ball around (0, 0.73).
                &[(0.092, 0.58), (0.152, 0.642), (0.176, 0.73), (0.152, 0.818), (0.088, 0.882), (0.0, 0.906)],
            ],
        }
    }
}

/// A body of revolution around the y axis.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Lathe {
    /// What to turn
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Self::default().profile))]
    pub profile: LatheProfile,
    /// Height; everything scales with it
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().height))]
    pub height: f64,
    /// Sides around the axis
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().sides))]
    pub sides: u32,
    /// Steps between two points of the profile
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().steps))]
    pub steps: u32,
}

impl Default for Lathe {
    fn default() -> Self {
        Lathe { profile: LatheProfile::WineGlass, height: 1.0, sides: 96, steps: 4 }
    }
}

/// The curve through `points` between points `i` and `i + 1`, at `t` in [0, 1]: a centripetal Catmull-Rom spline, which
/// neither overshoots nor loops (Yuksel et al. 2011), by Barry and Goldman's pyramid. It leaves the axis at a right
/// angle and other ends in the direction of the next point.
fn spline(points: &[(f64, f64)], i: usize, t: f64) -> DVec2 {
    let at = |i: usize| DVec2::new(points[i].0, points[i].1);
    let beyond = |end: DVec2, next: DVec2| {
        if end.x == 0.0 { DVec2::new(-next.x, next.y) } else { 2.0 * end - next }
    };
    let (b, c) = (at(i), at(i + 1));
    let a = if i > 0 { at(i - 1) } else { beyond(b, c) };
    let d = if i + 2 < points.len() { at(i + 2) } else { beyond(c, b) };
    let ta = 0.0;
    let tb = ta + a.distance(b).sqrt();
    let tc = tb + b.distance(c).sqrt();
    let td = tc + c.distance(d).sqrt();
    let t = tb + t * (tc - tb);
    let mix = |p: DVec2, q: DVec2, tp: f64, tq: f64| (p * (tq - t) + q * (t - tp)) / (tq - tp);
    let (ab, bc, cd) = (mix(a, b, ta, tb), mix(b, c, tb, tc), mix(c, d, tc, td));
    mix(mix(ab, bc, ta, tc), mix(bc, cd, tb, td), tb, tc)
}

impl Lathe {
    /// Makes the mesh, Euler characteristic 2.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_range("height", self.height, 1e-6, 1e6)?;
        check_count("sides", self.sides, 3, 1 << 26)?;
        check_count("steps", self.steps, 1, 1 << 20)?;
        let pieces = self.profile.pieces();
        let spans: usize = pieces.iter().map(|p| p.len() - 1).sum();
        let rows = u128::from(self.steps) * spans as u128;
        // A row of quads, but only one triangle a side at the two poles.
        check_triangles("sides", self.sides, 2 * (rows - 1) * u128::from(self.sides))?;

        let circle: Vec<(f64, f64)> =
            (0..self.sides).map(|j| (TAU * f64::from(j) / f64::from(self.sides)).sin_cos()).collect();
        let mut b = Builder::default();
        for points in pieces {
            let mut previous: Option<Ring> = None;
            for row in 0..=(points.len() - 1) as u32 * self.steps {
                let span = ((row / self.steps) as usize).min(points.len() - 2);
                let t = f64::from(row - span as u32 * self.steps) / f64::from(self.steps);
                let ring = self.ring(&mut b, points, span, t, &circle);
                if let Some(previous) = previous {
                    self.join(&mut b, previous, ring);
                }
                previous = Some(ring);
            }
        }
        Ok(b.finish())
    }

    /// Adds the vertices of one place of the profile.
    fn ring(
        &self,
        b: &mut Builder,
        points: &[(f64, f64)],
        span: usize,
        t: f64,
        circle: &[(f64, f64)],
    ) -> Ring {
        // At a control point take its numbers as they stand, so that two pieces meet bit for bit.
        let p = match t {
            0.0 => DVec2::from(points[span]),
            1.0 => DVec2::from(points[span + 1]),
            _ => spline(points, span, t),
        } * self.height;
        let step = 1e-5;
        let tangent = spline(points, span, (t + step).min(1.0)) - spline(points, span, (t - step).max(0.0));
        if p.x == 0.0 {
            // Outside is on the right of the way along the profile: below where it starts, above where it ends.
            let up = if tangent.x > 0.0 { -DVec3::Y } else { DVec3::Y };
            return Ring::Pole(b.vertex(DVec3::new(0.0, p.y, 0.0), up));
        }
        let normal = DVec2::new(tangent.y, -tangent.x).normalize();
        let first = b.positions.len() as u32;
        for &(s, c) in circle {
            b.vertex(DVec3::new(p.x * c, p.y, p.x * s), DVec3::new(normal.x * c, normal.y, normal.x * s));
        }
        Ring::Circle(first)
    }

    /// Adds the triangles between two neighbouring places of the profile.
    fn join(&self, b: &mut Builder, low: Ring, high: Ring) {
        for j in 0..self.sides {
            let k = (j + 1) % self.sides;
            match (low, high) {
                (Ring::Circle(l), Ring::Circle(h)) => b.quad(l + j, h + j, h + k, l + k),
                (Ring::Pole(l), Ring::Circle(h)) => b.triangles.push([l, h + j, h + k]),
                (Ring::Circle(l), Ring::Pole(h)) => b.triangles.push([l + j, h, l + k]),
                (Ring::Pole(_), Ring::Pole(_)) => {}
            }
        }
    }
}

/// The vertices of one place of the profile.
#[derive(Clone, Copy)]
enum Ring {
    /// On the axis: one vertex.
    Pole(u32),
    /// Off the axis: as many vertices as the lathe has sides, from this one on.
    Circle(u32),
}

#[cfg(all(test, feature = "cli"))]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;
    use clap::ValueEnum;

    #[test]
    fn every_profile_turns_into_a_closed_body() {
        for &profile in LatheProfile::value_variants() {
            for (sides, steps) in [(3, 1), (16, 2), (48, 5)] {
                let lathe = Lathe { profile, sides, steps, ..Lathe::default() };
                let topology = assert_closed(&lathe.build().unwrap());
                assert_eq!(topology.euler_characteristic, 2, "{profile:?}");
            }
        }
    }

    #[test]
    fn a_wine_glass_is_mostly_air() {
        let glass = Lathe { sides: 64, ..Lathe::default() }.build().unwrap();
        let volume = Topology::of(&glass).signed_volume;
        // The bowl alone, were it solid, would hold more than 0.08.
        assert!((0.005..0.02).contains(&volume), "{volume}");
    }

    #[test]
    fn the_walls_do_not_cross() {
        // No two pieces of the profile may meet, except where they follow each other.
        for &profile in LatheProfile::value_variants() {
            let mut line = Vec::new();
            for points in profile.pieces() {
                for span in 0..points.len() - 1 {
                    line.extend((0..8).map(|k| spline(points, span, f64::from(k) / 8.0)));
                }
            }
            let side = |a: DVec2, b: DVec2, p: DVec2| (b - a).perp_dot(p - a) > 0.0;
            for i in 0..line.len() - 1 {
                assert!(line[i].x >= 0.0);
                for j in i + 2..line.len() - 1 {
                    let (a, b, c, d) = (line[i], line[i + 1], line[j], line[j + 1]);
                    assert!(
                        side(a, b, c) == side(a, b, d) || side(c, d, a) == side(c, d, b),
                        "{profile:?}: {a} {b} crosses {c} {d}"
                    );
                }
            }
        }
    }

    use super::super::Topology;
}
