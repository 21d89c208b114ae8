//! The sphere flake: spheres on spheres on spheres.

use super::error::{check_count, check_range, check_triangles};
use super::icosphere::{icosphere, icosphere_triangles};
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_3, FRAC_PI_6, PI};

/// A sphere that carries nine spheres of a third of its size, which carry nine each, and so on.
///
/// After Haines' sphere flake (Standard Procedural Databases, 1987): six children around the equator, three above.
/// Each sphere is a closed surface of its own; neighbours touch in a point.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct SphereFlake {
    /// Generations of children
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().levels))]
    pub levels: u32,
    /// Radius of the central sphere
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().radius))]
    pub radius: f64,
    /// Parts into which the edges of the central icosahedron are cut; smaller spheres are coarser
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().frequency))]
    pub frequency: u32,
}

impl Default for SphereFlake {
    fn default() -> Self {
        SphereFlake { levels: 3, radius: 1.0, frequency: 12 }
    }
}

impl SphereFlake {
    /// Fineness of the spheres of a generation.
    fn frequency_at(&self, level: u32) -> u32 {
        ((f64::from(self.frequency) * 0.65f64.powi(level as i32)).round() as u32).max(1)
    }

    /// Makes the mesh: 9^level spheres of each generation, Euler characteristic twice their number.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_count("levels", self.levels, 0, 8)?;
        check_range("radius", self.radius, 1e-6, 1e6)?;
        check_count("frequency", self.frequency, 1, 10_000)?;
        let triangles =
            (0..=self.levels).map(|l| 9u128.pow(l) * icosphere_triangles(self.frequency_at(l))).sum();
        check_triangles("levels", self.levels, triangles)?;

        let mut b = Builder::default();
        // Centre and axis of the spheres of one generation.
        let mut spheres = vec![(DVec3::ZERO, DVec3::Y)];
        let mut radius = self.radius;
        for level in 0..=self.levels {
            let (points, triangles) = icosphere(self.frequency_at(level));
            let mut children = Vec::new();
            for &(center, axis) in &spheres {
                let base = b.positions.len() as u32;
                for &n in &points {
                    b.vertex(center + radius * n, n);
                }
                b.triangles.extend(triangles.iter().map(|t| t.map(|i| i + base)));
                if level == self.levels {
                    continue;
                }
                let (side, front) = axis.any_orthonormal_pair();
                for k in 0..9 {
                    let (azimuth, elevation) = match k {
                        0..6 => (f64::from(k) * FRAC_PI_3, 0.0),
                        _ => (f64::from(k - 6) * 2.0 * FRAC_PI_3 + FRAC_PI_6, 0.3 * PI),
                    };
                    let ((sa, ca), (se, ce)) = (azimuth.sin_cos(), elevation.sin_cos());
                    let way = ce * (ca * side + sa * front) + se * axis;
                    children.push((center + radius * (4.0 / 3.0) * way, way));
                }
            }
            spheres = children;
            radius /= 3.0;
        }
        Ok(b.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;

    #[test]
    fn a_flake_is_as_many_closed_spheres_as_it_should_be() {
        for (levels, spheres) in [(0, 1), (1, 10), (2, 91), (3, 820)] {
            let flake = SphereFlake { levels, frequency: 4, ..SphereFlake::default() };
            let topology = assert_closed(&flake.build().unwrap());
            assert_eq!(topology.euler_characteristic, 2 * spheres);
        }
    }

    #[test]
    fn too_many_levels_are_refused() {
        let error = SphereFlake { levels: 8, ..SphereFlake::default() }.build().unwrap_err();
        assert!(error.to_string().starts_with("--levels: found 8, which makes"), "{error}");
    }
}
