//! Displaced spheres: planets, moons, rocks.

use super::error::{check_count, check_range, check_triangles};
use super::icosphere::{icosphere, icosphere_triangles};
use super::noise::Noise;
use super::normals::smooth_normals;
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::DVec3;
use std::f64::consts::TAU;

/// A sphere whose surface is moved along its normals by fractal noise and craters.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct DisplacedSphere {
    /// Parts into which the edges of an icosahedron are cut; the mesh has 20 times its square triangles
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().frequency))]
    pub frequency: u32,
    /// Radius before displacement
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().radius))]
    pub radius: f64,
    /// Height of the noise as a part of the radius
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().relief))]
    pub relief: f64,
    /// Features across the radius
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().scale))]
    pub scale: f64,
    /// Octaves of noise
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().octaves))]
    pub octaves: u32,
    /// Sharp ridges in place of soft hills
    #[cfg_attr(feature = "cli", arg(long))]
    pub ridged: bool,
    /// Number of craters
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().craters))]
    pub craters: u32,
    /// Seed of noise and craters
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().seed))]
    pub seed: u32,
}

impl Default for DisplacedSphere {
    fn default() -> Self {
        DisplacedSphere {
            frequency: 64,
            radius: 1.0,
            relief: 0.1,
            scale: 2.0,
            octaves: 6,
            ridged: false,
            craters: 0,
            seed: 1,
        }
    }
}

/// A crater: where it is, and its angular radius.
struct Crater {
    center: DVec3,
    angle: f64,
}

impl Crater {
    /// Place and size of number `index`: uniform over the sphere, small ones more frequent.
    fn new(noise: &Noise, index: u32) -> Crater {
        let number = |k: u32| noise.uniform(index.wrapping_mul(3).wrapping_add(k));
        let z = 2.0 * number(0) - 1.0;
        let (s, c) = (TAU * number(1)).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Crater { center: DVec3::new(r * c, r * s, z), angle: 0.05 / (number(2) + 0.02).sqrt() }
    }

    /// Height that it adds at unit vector `at`: a bowl with a rim, in parts of the radius of the sphere.
    fn height(&self, at: DVec3) -> f64 {
        let x = at.distance(self.center) / self.angle;
        if x > 2.0 {
            return 0.0;
        }
        let bowl = (x * x - 1.0).clamp(-0.75, 0.0);
        let rim = 0.35 * (-16.0 * (x - 1.0) * (x - 1.0)).exp();
        0.4 * self.angle * (bowl + rim)
    }
}

impl DisplacedSphere {
    /// Makes the mesh: `20 * frequency^2` triangles, Euler characteristic 2.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_count("frequency", self.frequency, 1, 1 << 20)?;
        check_triangles("frequency", self.frequency, icosphere_triangles(self.frequency))?;
        check_range("radius", self.radius, 1e-6, 1e6)?;
        check_range("relief", self.relief, 0.0, 0.5)?;
        check_range("scale", self.scale, 1e-3, 1e3)?;
        check_count("octaves", self.octaves, 0, 16)?;
        check_count("craters", self.craters, 0, 10_000)?;

        let noise = Noise::new(self.seed);
        let craters: Vec<Crater> = (0..self.craters).map(|i| Crater::new(&noise, i)).collect();
        let (mut positions, triangles) = icosphere(self.frequency);
        for p in &mut positions {
            let q = *p * self.scale;
            let hills = if self.ridged {
                2.0 * noise.ridged(q, self.octaves) - 1.0
            } else {
                noise.fractal(q, self.octaves)
            };
            let pits: f64 = craters.iter().map(|c| c.height(*p)).sum();
            // A floor that no heap of craters goes below keeps the surface star-shaped, so closed and simple.
            *p *= self.radius * (1.0 + self.relief * hills + pits).max(0.2);
        }
        let normals = smooth_normals(&positions, &triangles);
        Ok(Builder { positions, normals, triangles }.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;

    #[test]
    fn without_relief_it_is_a_sphere() {
        let ball = DisplacedSphere { relief: 0.0, radius: 2.0, ..DisplacedSphere::default() };
        let topology = assert_closed(&ball.build().unwrap());
        assert_eq!(topology.euler_characteristic, 2);
        assert!((topology.signed_volume / (4.0 / 3.0 * 8.0 * std::f64::consts::PI) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn moons_and_rocks_are_closed_and_follow_the_seed() {
        let moon = DisplacedSphere { craters: 200, relief: 0.03, ..DisplacedSphere::default() };
        let mesh = moon.build().unwrap();
        assert_eq!(assert_closed(&mesh).euler_characteristic, 2);
        assert_eq!(moon.build().unwrap(), mesh);
        assert_ne!(DisplacedSphere { seed: 2, ..moon }.build().unwrap(), mesh);
        let rock = DisplacedSphere { ridged: true, relief: 0.3, octaves: 3, ..DisplacedSphere::default() };
        assert_eq!(assert_closed(&rock.build().unwrap()).euler_characteristic, 2);
    }

    #[test]
    fn bad_parameters_are_refused_by_name() {
        let ball = DisplacedSphere::default();
        for (bad, option) in [
            (DisplacedSphere { frequency: 0, ..ball.clone() }, "frequency"),
            (DisplacedSphere { frequency: 1 << 20, ..ball.clone() }, "frequency"),
            (DisplacedSphere { relief: -1.0, ..ball.clone() }, "relief"),
            (DisplacedSphere { octaves: 400, ..ball.clone() }, "octaves"),
        ] {
            let message = bad.build().unwrap_err().to_string();
            assert!(message.starts_with(&format!("--{option}: ")), "{message}");
        }
    }
}
