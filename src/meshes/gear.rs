//! Gears: spur gears with involute teeth.

use super::MeshError;
use super::error::{bad, check_count, check_range, check_triangles};
use super::normals::creased;
use crate::scene::Mesh;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Angle between a tooth's flank and the way to the centre, on the pitch circle: 20 degrees, as is usual.
const PRESSURE_ANGLE: f64 = 20.0 / 180.0 * PI;

/// A spur gear around the y axis, centred at the origin, with a bore, bevelled edges and a web thinner than the rim.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Gear {
    /// Number of teeth
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().teeth))]
    pub teeth: u32,
    /// Radius of the pitch circle; the teeth reach 2 / teeth of it further out
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().radius))]
    pub radius: f64,
    /// Thickness of rim and hub
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().thickness))]
    pub thickness: f64,
    /// Radius of the bore
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().bore))]
    pub bore: f64,
    /// Thickness of the web between rim and hub, as a part of the whole thickness
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().web))]
    pub web: f64,
    /// Width of the bevel, as a part of a tooth's height
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().bevel))]
    pub bevel: f64,
    /// Segments of a flank
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().segments))]
    pub segments: u32,
}

impl Default for Gear {
    fn default() -> Self {
        Gear { teeth: 18, radius: 1.0, thickness: 0.4, bore: 0.2, web: 0.5, bevel: 0.08, segments: 4 }
    }
}

/// Rings of vertices in [`Gear::build`], and rows of quads between them.
const RINGS: usize = 18;

impl Gear {
    /// Makes the mesh, Euler characteristic 0: a ring.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_count("teeth", self.teeth, 8, 10_000)?;
        check_range("radius", self.radius, 1e-6, 1e6)?;
        check_range("thickness", self.thickness, 1e-3 * self.radius, 1e3 * self.radius)?;
        check_range("web", self.web, 0.05, 0.95)?;
        check_range("bevel", self.bevel, 0.01, 0.15)?;
        check_count("segments", self.segments, 1, 10_000)?;
        let root = self.root();
        check_range("bore", self.bore, 0.02 * self.radius, 0.45 * root)?;
        let bevel = self.bevel * (self.tip() - root);
        if 2.0 * bevel > 0.5 * (1.0 - self.web) * self.thickness {
            return Err(bad("thickness", self.thickness, "more, or a narrower --bevel, or a thinner --web"));
        }
        let columns = u128::from(self.teeth) * (2 * u128::from(self.segments) + 4);
        check_triangles("segments", self.segments, 2 * RINGS as u128 * columns)?;

        let outline = self.outline();
        let inset = inset(&outline, bevel);
        let way: Vec<DVec2> = outline.iter().map(|p| p.normalize()).collect();
        let circle = |r: f64| way.iter().map(|w| r * w).collect::<Vec<_>>();
        let (h, w) = (0.5 * self.thickness, 0.5 * self.web * self.thickness);
        let (rim, hub) = (root - 0.14 * self.radius.min(root), self.bore + 0.3 * (root - self.bore));
        // From the teeth over the top to the bore and back below: every ring is a closed line of the same number of
        // points, at the same azimuths but for the bevel's.
        let rings: [(Vec<DVec2>, f64); RINGS] = [
            (outline.clone(), -h + bevel),
            (outline, h - bevel),
            (inset.clone(), h),
            (circle(rim + bevel), h),
            (circle(rim), h - bevel),
            (circle(rim - bevel), w),
            (circle(hub + bevel), w),
            (circle(hub), h - bevel),
            (circle(hub - bevel), h),
            (circle(self.bore), h),
            (circle(self.bore), -h),
            (circle(hub - bevel), -h),
            (circle(hub), -h + bevel),
            (circle(hub + bevel), -w),
            (circle(rim - bevel), -w),
            (circle(rim), -h + bevel),
            (circle(rim + bevel), -h),
            (inset, -h),
        ];

        let mut positions = Vec::new();
        for (ring, y) in &rings {
            positions.extend(ring.iter().map(|p| DVec3::new(p.x, *y, p.y)));
        }
        let (rows, columns) = (rings.len() as u32, way.len() as u32);
        let mut triangles = Vec::new();
        for i in 0..rows {
            for j in 0..columns {
                let at = |i: u32, j: u32| (i % rows) * columns + j % columns;
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        Ok(creased(&positions, &triangles, 25.0))
    }

    /// Radius of the circle between the teeth.
    fn root(&self) -> f64 {
        self.radius * (1.0 - 2.5 / f64::from(self.teeth))
    }

    /// Radius of the circle around the teeth.
    fn tip(&self) -> f64 {
        self.radius * (1.0 + 2.0 / f64::from(self.teeth))
    }

    /// Half the angle that a tooth takes at radius `r`.
    fn half_tooth(&self, r: f64) -> f64 {
        let involute = |angle: f64| angle.tan() - angle;
        let base = self.radius * PRESSURE_ANGLE.cos();
        let at_pitch = 0.5 * PI / f64::from(self.teeth) + involute(PRESSURE_ANGLE);
        // Inside the base circle there is no involute: the flank goes on nearly straight, widening a little.
        let fillet = 0.25 * (base - r).max(0.0) / base;
        at_pitch - involute((base / r).min(1.0).acos()) + fillet
    }

    /// The outline seen along -y, by growing azimuth, which makes it star-shaped around the axis.
    fn outline(&self) -> Vec<DVec2> {
        let (root, tip) = (self.root(), self.tip());
        let mut points = Vec::new();
        for tooth in 0..self.teeth {
            let center = TAU * f64::from(tooth) / f64::from(self.teeth);
            let mut add = |r: f64, azimuth: f64| points.push(r * DVec2::from_angle(center + azimuth));
            let radius_at = |i: u32| root + (tip - root) * f64::from(i) / f64::from(self.segments);
            for i in 0..=self.segments {
                add(radius_at(i), -self.half_tooth(radius_at(i)));
            }
            add(tip, 0.0);
            for i in (0..=self.segments).rev() {
                add(radius_at(i), self.half_tooth(radius_at(i)));
            }
            add(root, PI / f64::from(self.teeth));
        }
        points
    }
}

/// A closed line (counter-clockwise) moved inwards by `distance`.
fn inset(line: &[DVec2], distance: f64) -> Vec<DVec2> {
    let n = line.len();
    let inward = |a: DVec2, b: DVec2| (b - a).perp().normalize();
    (0..n)
        .map(|i| {
            let (before, here, after) = (line[(i + n - 1) % n], line[i], line[(i + 1) % n]);
            let (u, v) = (inward(before, here), inward(here, after));
            here + (u + v) * (distance / (1.0 + u.dot(v)))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;

    #[test]
    fn gears_are_closed_rings() {
        for teeth in [8, 12, 18, 41, 120] {
            let mesh = Gear { teeth, ..Gear::default() }.build().unwrap();
            assert_eq!(assert_closed(&mesh).euler_characteristic, 0, "{teeth}");
        }
    }

    #[test]
    fn outlines_are_star_shaped_with_and_without_bevel() {
        for teeth in [8, 18, 120] {
            let gear = Gear { teeth, bevel: 0.15, ..Gear::default() };
            let outline = gear.outline();
            for line in [inset(&outline, 0.15 * (gear.tip() - gear.root())), outline] {
                for (i, p) in line.iter().enumerate() {
                    assert!(p.perp_dot(line[(i + 1) % line.len()]) > 0.0, "{teeth} teeth, point {i}");
                }
            }
        }
    }

    #[test]
    fn bad_parameters_are_refused_by_name() {
        let gear = Gear::default();
        for (bad, option) in [
            (Gear { teeth: 0, ..gear.clone() }, "teeth"),
            (Gear { bore: 1.0, ..gear.clone() }, "bore"),
            (Gear { thickness: 0.02, ..gear.clone() }, "thickness"),
            (Gear { teeth: 10_000, segments: 10_000, thickness: 0.4, ..gear.clone() }, "segments"),
        ] {
            let message = bad.build().unwrap_err().to_string();
            assert!(message.starts_with(&format!("--{option}: ")), "{message}");
        }
    }
}
