//! Superellipsoids: between box, ball, cylinder and octahedron.

use super::error::{check_count, check_range, check_triangles};
use super::lattice::{lattice, lattice_triangles};
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::DVec3;

/// The superellipsoid `(|x|^(2/e) + |z|^(2/e))^(e/n) + |y|^(2/n) = 1` (Barr 1981), scaled.
///
/// Exponents near 0 are boxy, 1 is round, 2 is a double cone (`n`) or square (`e`) with flat sides.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Superellipsoid {
    /// Exponent n, from pole to pole
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().north))]
    pub north: f64,
    /// Exponent e, around the y axis
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().east))]
    pub east: f64,
    /// Half the size along x, y and z
    #[cfg_attr(feature = "cli", arg(long, num_args = 3, value_names = ["X", "Y", "Z"], default_values_t = Self::default().radii))]
    pub radii: Vec<f64>,
    /// Cells along the edges of the cube that is bent; the mesh has 12 times its square triangles
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().cells))]
    pub cells: u32,
}

impl Default for Superellipsoid {
    fn default() -> Self {
        Superellipsoid { north: 0.5, east: 0.5, radii: vec![1.0; 3], cells: 32 }
    }
}

impl Superellipsoid {
    /// Makes the mesh: `12 * cells^2` triangles, Euler characteristic 2.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_range("north", self.north, 0.1, 2.0)?;
        check_range("east", self.east, 0.1, 2.0)?;
        let radii = super::error::three("radii", &self.radii, 1e-6, 1e6)?;
        check_count("cells", self.cells, 1, 1 << 20)?;
        check_triangles("cells", self.cells, lattice_triangles(self.cells))?;

        let (lattice, triangles) = lattice(self.cells);
        let (around, along) = (2.0 / self.east, 2.0 / self.north);
        let ratio = self.east / self.north;
        let mut b = Builder { triangles, ..Builder::default() };
        for k in lattice {
            let n = f64::from(self.cells);
            let p = DVec3::from(k.map(|i| (2.0 * f64::from(i) - n) / n));
            let ring = p.x.abs().powf(around) + p.z.abs().powf(around);
            // Homogeneous of degree `along`, so that the way to the surface along the ray through p is closed form.
            let value = ring.powf(ratio) + p.y.abs().powf(along);
            let on = p * value.powf(-0.5 * self.north);
            // Gradient, up to a factor.
            let outer = if ring > 0.0 { ring.powf(ratio - 1.0) } else { 0.0 };
            let slope = |x: f64, power: f64| {
                if x == 0.0 { 0.0 } else { x.signum() * x.abs().powf(power - 1.0) }
            };
            let gradient =
                DVec3::new(outer * slope(p.x, around), slope(p.y, along), outer * slope(p.z, around));
            b.vertex(on * radii, (gradient / radii).normalize());
        }
        Ok(b.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;

    #[test]
    fn exponents_of_one_make_an_ellipsoid() {
        let ball =
            Superellipsoid { north: 1.0, east: 1.0, radii: vec![1.0, 2.0, 3.0], ..Superellipsoid::default() };
        let mesh = ball.build().unwrap();
        let topology = assert_closed(&mesh);
        assert_eq!(topology.euler_characteristic, 2);
        assert!((topology.signed_volume / (8.0 * std::f64::consts::PI) - 1.0).abs() < 5e-3, "{topology:?}");
        for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
            let exact = glam::DVec3::new(p[0], p[1] / 4.0, p[2] / 9.0).as_vec3().normalize();
            assert!(exact.distance(glam::Vec3::from(*n)) < 1e-5);
        }
    }

    #[test]
    fn every_pair_of_exponents_gives_a_closed_surface() {
        for north in [0.1, 0.5, 1.0, 1.7, 2.0] {
            for east in [0.1, 0.5, 1.0, 1.7, 2.0] {
                for cells in [3, 10, 21] {
                    let shape = Superellipsoid { north, east, cells, ..Superellipsoid::default() };
                    assert_eq!(assert_closed(&shape.build().unwrap()).euler_characteristic, 2);
                }
            }
        }
    }

    #[test]
    fn bad_parameters_are_refused_by_name() {
        let good = Superellipsoid::default();
        for (bad, option) in [
            (Superellipsoid { north: 0.0, ..good.clone() }, "north"),
            (Superellipsoid { east: f64::NAN, ..good.clone() }, "east"),
            (Superellipsoid { radii: vec![1.0, 2.0], ..good.clone() }, "radii"),
            (Superellipsoid { radii: vec![1.0, -2.0, 1.0], ..good.clone() }, "radii"),
            (Superellipsoid { cells: 1 << 20, ..good.clone() }, "cells"),
        ] {
            let message = bad.build().unwrap_err().to_string();
            assert!(message.starts_with(&format!("--{option}: ")), "{message}");
        }
    }
}
