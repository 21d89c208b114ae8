//! Disk.

use super::{QuadricSurface, azimuth_within};
use glam::DVec3;

/// In the plane z = `height`, with the normal +z: distances from the axis in `[inner_radius, radius]` and azimuths up to
/// `phi_max` are there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disk {
    /// Height.
    pub height: f32,
    /// Outer radius.
    pub radius: f32,
    /// Inner radius.
    pub inner_radius: f32,
    /// Largest azimuth.
    pub phi_max: f32,
}

impl QuadricSurface for Disk {
    fn numbers(&self) -> [f32; 4] {
        [self.height, self.radius, self.inner_radius, self.phi_max]
    }
    fn fault(&self) -> Option<String> {
        (self.radius <= 0.0).then(|| format!("its radius is {}; expected more than 0", self.radius))
    }
    fn distances(&self, o: [f64; 3], d: [f64; 3]) -> [f64; 2] {
        [(self.height as f64 - o[2]) / d[2], f64::NAN]
    }
    fn holds(&self, p: [f64; 3]) -> bool {
        let r2 = p[0] * p[0] + p[1] * p[1];
        let ring = r2 <= (self.radius as f64).powi(2) && r2 >= (self.inner_radius as f64).powi(2);
        ring && azimuth_within(p, self.phi_max)
    }
    fn noise(&self) -> f64 {
        0.0
    }
    fn equation(&self, p: [f64; 3]) -> (f64, [f64; 3]) {
        (p[2] - self.height as f64, [0.0, 0.0, 1.0])
    }
    fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let (r, z) = (self.radius, self.height);
        ([-r, -r, z], [r, r, z])
    }
    fn point(&self, u: f64, v: f64) -> DVec3 {
        let [height, radius, inner_radius, phi_max] = self.numbers().map(f64::from);
        let (r, phi) = (inner_radius + u * (radius - inner_radius), v * phi_max);
        DVec3::new(r * phi.cos(), r * phi.sin(), height)
    }
}
