//! Part of a sphere.

use super::{QuadricSurface, azimuth_within};
use glam::DVec3;

/// A sphere around the origin, of which z in `[z_min, z_max]` and azimuths up to `phi_max` are there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpherePart {
    /// Radius.
    pub radius: f32,
    /// Lowest z.
    pub z_min: f32,
    /// Highest z.
    pub z_max: f32,
    /// Largest azimuth.
    pub phi_max: f32,
}

impl QuadricSurface for SpherePart {
    fn numbers(&self) -> [f32; 4] {
        [self.radius, self.z_min, self.z_max, self.phi_max]
    }
    fn fault(&self) -> Option<String> {
        (self.radius <= 0.0).then(|| format!("its radius is {}; expected more than 0", self.radius))
    }
    /// After Haines, Guenther and Akenine-Moeller (Ray Tracing Gems, chapter 7).
    fn distances(&self, o: [f64; 3], d: [f64; 3]) -> [f64; 2] {
        let r = self.radius as f64;
        let a: f64 = d.iter().map(|x| x * x).sum();
        let b: f64 = -(0..3).map(|i| o[i] * d[i]).sum::<f64>();
        let length = o.iter().map(|x| x * x).sum::<f64>().sqrt();
        let c = (length - r) * (length + r);
        let s = b / a;
        let closest: f64 = (0..3).map(|i| (o[i] + s * d[i]).powi(2)).sum();
        let discriminant = a * (r * r - closest);
        if discriminant < 0.0 {
            return [f64::NAN; 2];
        }
        let q = b + discriminant.sqrt().copysign(b);
        let roots = [c / q, q / a];
        [roots[0].min(roots[1]), roots[0].max(roots[1])]
    }
    fn holds(&self, p: [f64; 3]) -> bool {
        let SpherePart { radius, z_min, z_max, phi_max } = *self;
        let unclipped = z_min <= -radius && z_max >= radius;
        (unclipped || p[2] >= z_min as f64 && p[2] <= z_max as f64) && azimuth_within(p, phi_max)
    }
    fn noise(&self) -> f64 {
        1e-7 * self.radius as f64
    }
    fn equation(&self, p: [f64; 3]) -> (f64, [f64; 3]) {
        let r = self.radius as f64;
        let l2 = p.iter().map(|x| x * x).sum::<f64>();
        (0.5 * (l2 - r * r), p)
    }
    fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let r = self.radius;
        ([-r, -r, self.z_min.max(-r)], [r, r, self.z_max.min(r)])
    }
    fn point(&self, u: f64, v: f64) -> DVec3 {
        let [radius, z_min, z_max, phi_max] = self.numbers().map(f64::from);
        let [low, high] = [z_min, z_max].map(|z| polar_angle(z, radius));
        let (theta, phi) = (low + u * (high - low), v * phi_max);
        radius * DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }
}

/// Polar angle of the points at height `z` on a sphere around the origin. Heights beyond the poles, where rounding may put
/// them, count as the poles.
pub fn polar_angle(z: f64, radius: f64) -> f64 {
    (z / radius).clamp(-1.0, 1.0).acos()
}
