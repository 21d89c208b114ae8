//! Clipped and stretched spheres, and disks: one ray, one surface, in object space and double precision. They are
//! rare; being right counts.

use crate::scene::{Quadric, QuadricForm};

impl Quadric {
    /// The nearest distance in (0, t_max] at which a ray meets the surface.
    pub fn intersect(&self, origin: [f32; 3], direction: [f32; 3], t_max: f32) -> Option<f32> {
        let m = self.object_from_world.map(|row| row.map(f64::from));
        let row =
            |i: usize, v: [f32; 3]| m[i][0] * v[0] as f64 + m[i][1] * v[1] as f64 + m[i][2] * v[2] as f64;
        let o: [f64; 3] = core::array::from_fn(|i| row(i, origin) + m[i][3]);
        let d: [f64; 3] = core::array::from_fn(|i| row(i, direction));
        let at = |t: f64| -> [f64; 3] { core::array::from_fn(|i| o[i] + t * d[i]) };
        let azimuth = |p: [f64; 3], phi_max: f32| {
            phi_max >= core::f32::consts::TAU
                || p[1].atan2(p[0]).rem_euclid(core::f64::consts::TAU) <= phi_max as f64
        };
        let in_range = |t: f64| t > 0.0 && (t as f32) > 0.0 && t as f32 <= t_max;
        match self.form {
            QuadricForm::Sphere { radius, z_min, z_max, phi_max } => {
                let r = radius as f64;
                let a: f64 = d.iter().map(|x| x * x).sum();
                let b: f64 = -(0..3).map(|i| o[i] * d[i]).sum::<f64>();
                let length = o.iter().map(|x| x * x).sum::<f64>().sqrt();
                let c = (length - r) * (length + r);
                let s = b / a;
                let closest: f64 = (0..3).map(|i| (o[i] + s * d[i]).powi(2)).sum();
                let discriminant = a * (r * r - closest);
                if discriminant < 0.0 {
                    return None;
                }
                let q = b + discriminant.sqrt().copysign(b);
                let roots = [c / q, q / a];
                let [near, far] = [roots[0].min(roots[1]), roots[0].max(roots[1])];
                // A ray that starts on the surface meets it at a distance of about 0, which is not a hit.
                let noise = 1e-7 * r / a.sqrt();
                [near, far]
                    .into_iter()
                    .find(|&t| {
                        let z = at(t)[2];
                        let unclipped = z_min <= -radius && z_max >= radius;
                        in_range(t)
                            && t > noise
                            && (unclipped || z >= z_min as f64 && z <= z_max as f64)
                            && azimuth(at(t), phi_max)
                    })
                    .map(|t| t as f32)
            }
            QuadricForm::Disk { height, radius, inner_radius, phi_max } => {
                let t = (height as f64 - o[2]) / d[2];
                let p = at(t);
                let r2 = p[0] * p[0] + p[1] * p[1];
                let ring = r2 <= (radius as f64).powi(2) && r2 >= (inner_radius as f64).powi(2);
                (in_range(t) && ring && azimuth(p, phi_max)).then_some(t as f32)
            }
        }
    }

    /// Corners of a box in object space around the whole surface: lowest, highest.
    pub fn object_bounds(&self) -> ([f32; 3], [f32; 3]) {
        match self.form {
            QuadricForm::Sphere { radius: r, z_min, z_max, .. } => {
                ([-r, -r, z_min.max(-r)], [r, r, z_max.min(r)])
            }
            QuadricForm::Disk { height, radius: r, .. } => ([-r, -r, height], [r, r, height]),
        }
    }
}
