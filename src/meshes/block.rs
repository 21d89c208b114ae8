//! Boxes, with sharp or rounded edges.

use super::error::{bad, check_count, check_range, check_triangles};
use super::lattice::{lattice, lattice_triangles};
use super::normals::creased;
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::DVec3;
use std::f64::consts::FRAC_PI_4;

/// A box centred at the origin whose edges may be rounded.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Block {
    /// Length along x, y and z
    #[cfg_attr(feature = "cli", arg(long, num_args = 3, value_names = ["X", "Y", "Z"], default_values_t = Self::default().size))]
    pub size: Vec<f64>,
    /// Radius of the rounded edges, 0 for sharp ones
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().rounding))]
    pub rounding: f64,
    /// Segments of each half of a rounded edge
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().segments))]
    pub segments: u32,
}

impl Default for Block {
    fn default() -> Self {
        Block { size: vec![1.0; 3], rounding: 0.1, segments: 4 }
    }
}

impl Block {
    /// Makes the mesh: 12 triangles if sharp, `12 * (2 * segments + 1)^2` if rounded; Euler characteristic 2.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        let half = 0.5 * super::error::three("size", &self.size, 1e-6, 1e6)?;
        check_range("rounding", self.rounding, 0.0, 1e6)?;
        let r = self.rounding;
        if r > 0.499 * 2.0 * half.min_element() {
            let limit = format!("less than half of the shortest side, {}", half.min_element());
            return Err(bad("rounding", r, limit));
        }
        check_count("segments", self.segments, 1, 1 << 20)?;
        let s = self.segments;
        if r == 0.0 {
            let (points, triangles) = lattice(1);
            let corner = |k: &[u32; 3]| (2.0 * DVec3::from(k.map(f64::from)) - 1.0) * half;
            return Ok(creased(&points.iter().map(corner).collect::<Vec<_>>(), &triangles, 30.0));
        }
        check_triangles("segments", s, lattice_triangles(2 * s + 1))?;

        // Each axis has the arcs' points at both ends and one long cell between; a point on the sharp box of the
        // corner, seen from the inner box, gives the direction in which the rounded surface is.
        let arc = |k: u32| (FRAC_PI_4 * f64::from(k) / f64::from(s)).tan();
        let offset = |k: u32| if k <= s { -arc(s - k) } else { arc(k - s - 1) };
        let (points, triangles) = lattice(2 * s + 1);
        let mut b = Builder { triangles, ..Builder::default() };
        for k in points {
            let inner = (half - r) * DVec3::from(k.map(|i| if i <= s { -1.0 } else { 1.0 }));
            let normal = DVec3::from(k.map(offset)).normalize();
            b.vertex(inner + r * normal, normal);
        }
        Ok(b.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;

    #[test]
    fn a_sharp_box_has_twelve_triangles_and_the_exact_volume() {
        let mesh = Block { size: vec![1.0, 2.0, 3.0], rounding: 0.0, segments: 1 }.build().unwrap();
        assert_eq!((mesh.triangles.len(), mesh.positions.len()), (12, 24));
        let topology = assert_closed(&mesh);
        assert_eq!(topology.euler_characteristic, 2);
        assert!((topology.signed_volume - 6.0).abs() < 1e-9);
    }

    #[test]
    fn a_rounded_box_holds_what_steiners_formula_says() {
        use std::f64::consts::PI;
        let (size, r) = ([1.0, 2.0, 3.0], 0.3);
        let mesh = Block { size: size.to_vec(), rounding: r, segments: 40 }.build().unwrap();
        let topology = assert_closed(&mesh);
        assert_eq!(topology.euler_characteristic, 2);
        let [a, b, c] = size.map(|x| x - 2.0 * r);
        let faces = 2.0 * (a * b + b * c + c * a) * r;
        let exact = a * b * c + faces + PI * r * r * (a + b + c) + 4.0 / 3.0 * PI * r * r * r;
        assert!((topology.signed_volume / exact - 1.0).abs() < 1e-3, "{topology:?} {exact}");
    }

    #[test]
    fn too_round_a_box_is_refused() {
        let error = Block { rounding: 0.6, ..Block::default() }.build().unwrap_err();
        assert!(error.to_string().starts_with("--rounding: found 0.6"), "{error}");
    }
}
