//! Cylinder.

use super::{QuadricSurface, azimuth_within};
use glam::DVec3;

/// Around the z axis, open at both ends, with the normal away from the axis: z in `[z_min, z_max]` and azimuths up to
/// `phi_max` are there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder {
    /// Radius.
    pub radius: f32,
    /// Lowest z.
    pub z_min: f32,
    /// Highest z.
    pub z_max: f32,
    /// Largest azimuth.
    pub phi_max: f32,
}

impl QuadricSurface for Cylinder {
    fn numbers(&self) -> [f32; 4] {
        [self.radius, self.z_min, self.z_max, self.phi_max]
    }
    fn fault(&self) -> Option<String> {
        let Cylinder { radius, z_min, z_max, .. } = *self;
        if radius <= 0.0 {
            return Some(format!("its radius is {radius}; expected more than 0"));
        }
        (z_min >= z_max).then(|| format!("it reaches from z = {z_min} to {z_max}; expected from low to high"))
    }
    /// As of a sphere, in the plane across the axis.
    fn distances(&self, o: [f64; 3], d: [f64; 3]) -> [f64; 2] {
        let r = self.radius as f64;
        let a = d[0] * d[0] + d[1] * d[1];
        let b = -(o[0] * d[0] + o[1] * d[1]);
        let length = o[0].hypot(o[1]);
        let c = (length - r) * (length + r);
        let s = b / a;
        let closest = (o[0] + s * d[0]).powi(2) + (o[1] + s * d[1]).powi(2);
        let discriminant = a * (r * r - closest);
        // A ray along the axis meets it nowhere: `s` is no number then.
        if discriminant.is_nan() || discriminant < 0.0 {
            return [f64::NAN; 2];
        }
        let q = b + discriminant.sqrt().copysign(b);
        let roots = [c / q, q / a];
        [roots[0].min(roots[1]), roots[0].max(roots[1])]
    }
    fn holds(&self, p: [f64; 3]) -> bool {
        p[2] >= self.z_min as f64 && p[2] <= self.z_max as f64 && azimuth_within(p, self.phi_max)
    }
    fn noise(&self) -> f64 {
        1e-7 * self.radius as f64
    }
    fn equation(&self, p: [f64; 3]) -> (f64, [f64; 3]) {
        let r = self.radius as f64;
        (0.5 * (p[0] * p[0] + p[1] * p[1] - r * r), [p[0], p[1], 0.0])
    }
    fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let r = self.radius;
        ([-r, -r, self.z_min], [r, r, self.z_max])
    }
    fn point(&self, u: f64, v: f64) -> DVec3 {
        let [radius, z_min, z_max, phi_max] = self.numbers().map(f64::from);
        let phi = v * phi_max;
        DVec3::new(radius * phi.cos(), radius * phi.sin(), z_min + u * (z_max - z_min))
    }
}
