//! The Menger sponge.

use super::error::{check_count, check_range, check_triangles};
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::DVec3;

/// A Menger sponge, centred at the origin: its surface only, as squares of the finest cubes' size.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Menger {
    /// Times that the cube is cut into 27 and hollowed out; 0 is the cube
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().levels))]
    pub levels: u32,
    /// Length of an edge
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().size))]
    pub size: f64,
}

impl Default for Menger {
    fn default() -> Self {
        Menger { levels: 3, size: 2.0 }
    }
}

/// True if the finest cube at these places is there: at no level two of the three base-3 digits are the middle one.
fn solid(mut p: [u32; 3]) -> bool {
    while p != [0; 3] {
        if p.iter().filter(|&&x| x % 3 == 1).count() >= 2 {
            return false;
        }
        p = p.map(|x| x / 3);
    }
    true
}

impl Menger {
    /// Makes the mesh: `4 * 20^levels + 8 * 8^levels` triangles.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_count("levels", self.levels, 0, 12)?;
        check_triangles("levels", self.levels, 4 * 20u128.pow(self.levels) + 8 * 8u128.pow(self.levels))?;
        check_range("size", self.size, 1e-6, 1e6)?;

        let n = 3u32.pow(self.levels);
        let mut b = Builder::default();
        for z in 0..n {
            for y in 0..n {
                for x in 0..n {
                    let cell = [x, y, z];
                    if solid(cell) {
                        self.faces(&mut b, cell, n);
                    }
                }
            }
        }
        Ok(b.finish())
    }

    /// Adds the faces of a solid cell that no other cell covers.
    fn faces(&self, b: &mut Builder, cell: [u32; 3], n: u32) {
        for axis in 0..3 {
            for positive in [false, true] {
                let mut neighbour = cell;
                neighbour[axis] = if positive { cell[axis] + 1 } else { cell[axis].wrapping_sub(1) };
                if neighbour[axis] < n && solid(neighbour) {
                    continue;
                }
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut normal = DVec3::ZERO;
                normal[axis] = if positive { 1.0 } else { -1.0 };
                let [p, q, r, s] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| {
                    let mut at = cell;
                    at[axis] += u32::from(positive);
                    at[u] += i;
                    at[v] += j;
                    // The same lattice point gives the same bits from every cell around it.
                    let place = at.map(|x| self.size * (f64::from(x) / f64::from(n) - 0.5));
                    b.vertex(DVec3::from(place), normal)
                });
                if positive { b.quad(p, q, r, s) } else { b.quad(p, s, r, q) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_closed;
    use super::*;

    #[test]
    fn sponges_are_closed_and_hold_what_is_left() {
        for levels in 0..4 {
            let mesh = Menger { levels, size: 2.0 }.build().unwrap();
            assert_eq!(mesh.triangles.len(), 4 * 20usize.pow(levels) + 8 * 8usize.pow(levels));
            let topology = assert_closed(&mesh);
            let left = 8.0 * (20.0f64 / 27.0).powi(levels as i32);
            assert!((topology.signed_volume - left).abs() < 1e-4, "{topology:?}");
            if levels < 2 {
                // A cube; then five tunnels: six openings meet in one chamber.
                assert_eq!(topology.euler_characteristic, [2, 2 - 2 * 5][levels as usize]);
            }
        }
    }

    #[test]
    fn too_many_levels_are_refused() {
        let error = Menger { levels: 6, size: 2.0 }.build().unwrap_err();
        assert!(error.to_string().starts_with("--levels: found 6, which makes"), "{error}");
    }
}
