//! Quaternion Julia sets, by marching tetrahedra.

use super::error::{bad, check_count, check_range};
use super::normals::smooth_normals;
use super::{Builder, MAX_TRIANGLES, MeshError};
use crate::scene::Mesh;
use glam::{DVec3, DVec4};

/// The surface around the Julia set of `q -> q^2 + c` over quaternions, cut at its fourth dimension 0.
///
/// Where an estimate of the distance to the set equals `shell` (Hart, Sandin & Kauffman 1989). Sampled on a cubic
/// lattice, each cube cut into six tetrahedra along its diagonal (Kuhn), which always gives a closed surface.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Julia {
    /// The constant c: real part, i, j, k
    #[cfg_attr(feature = "cli", arg(long, num_args = 4, value_names = ["R", "I", "J", "K"], allow_negative_numbers = true,
          default_values_t = Self::default().c))]
    pub c: Vec<f64>,
    /// Cells along each side of the lattice
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().cells))]
    pub cells: u32,
    /// Distance of the surface from the set
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().shell))]
    pub shell: f64,
    /// Iterations after which a point counts as inside
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().iterations))]
    pub iterations: u32,
}

impl Default for Julia {
    fn default() -> Self {
        Julia { c: vec![-0.2, 0.6, 0.2, 0.2], cells: 96, shell: 0.02, iterations: 24 }
    }
}

/// The six ways from one corner of a cube to the opposite one along its edges: each a tetrahedron. Corners are bits:
/// 1 for x, 2 for y, 4 for z.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]];

impl Julia {
    /// Makes the mesh. The number of triangles follows from the set: about 10 times `cells` squared.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        if self.c.len() != 4 || !self.c.iter().all(|x| x.abs() <= 2.0) {
            return Err(bad("c", format!("{:?}", self.c), "four numbers from -2 to 2"));
        }
        check_count("cells", self.cells, 2, 2048)?;
        check_range("shell", self.shell, 1e-6, 0.5)?;
        check_count("iterations", self.iterations, 1, 1000)?;
        let c = DVec4::new(self.c[1], self.c[2], self.c[3], self.c[0]);

        // Everything further out than this escapes.
        let reach = 0.5 * (1.0 + (1.0 + 4.0 * c.length()).sqrt()) + 2.0 * self.shell;
        let n = self.cells as usize;
        let side = n + 1;
        let place = |x: usize, y: usize, z: usize| {
            let at = |k: usize| reach * (2.0 * k as f64 / n as f64 - 1.0);
            DVec3::new(at(x), at(y), at(z))
        };
        let slice = |z: usize| -> Vec<f64> {
            let border = |k: usize| k == 0 || k == n;
            let mut values = Vec::with_capacity(side * side);
            for y in 0..side {
                for x in 0..side {
                    let value = self.distance(c, place(x, y, z)) - self.shell;
                    // What touches the lattice's border is cut off there rather than left open.
                    let outside = border(x) || border(y) || border(z);
                    values.push(if outside { value.max(0.25 * self.shell) } else { value });
                }
            }
            values
        };

        // Vertices on the edges that start at a lattice point of the lower and of the upper slice, by direction.
        const NONE: u32 = u32::MAX;
        let mut made = [vec![[NONE; 8]; side * side], vec![[NONE; 8]; side * side]];
        let mut values = [slice(0), slice(1)];
        let mut positions: Vec<DVec3> = Vec::new();
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        for z in 0..n {
            if z > 0 {
                made.swap(0, 1);
                made[1].fill([NONE; 8]);
                values.swap(0, 1);
                values[1] = slice(z + 1);
            }
            for y in 0..n {
                for x in 0..n {
                    let corner = |k: usize| (x + (k & 1), y + (k >> 1 & 1), k >> 2);
                    let value = |k: usize| {
                        let (x, y, z) = corner(k);
                        values[z][y * side + x]
                    };
                    let inside: [bool; 8] = std::array::from_fn(|k| value(k) < 0.0);
                    if inside == [false; 8] || inside == [true; 8] {
                        continue;
                    }
                    // Vertex on the edge between two corners of a tetrahedron: the bits of one contain the other's.
                    let mut cut = |a: usize, b: usize| {
                        let (a, b) = (a.min(b), a.max(b));
                        let (ax, ay, az) = corner(a);
                        let slot = &mut made[az][ay * side + ax][b - a];
                        if *slot == NONE {
                            *slot = positions.len() as u32;
                            let (bx, by, bz) = corner(b);
                            // Away from the corners, so that no triangle shrinks to nothing.
                            let t = (value(a) / (value(a) - value(b))).clamp(0.05, 0.95);
                            positions.push(place(ax, ay, z + az).lerp(place(bx, by, z + bz), t));
                        }
                        *slot
                    };
                    for tetrahedron in TETRAHEDRA {
                        march(tetrahedron, &inside, &mut cut, &mut triangles);
                    }
                }
            }
            if triangles.len() as u64 > MAX_TRIANGLES {
                let limit = format!("fewer: the surface has more than {MAX_TRIANGLES} triangles");
                return Err(bad("cells", self.cells, limit));
            }
        }
        if triangles.is_empty() {
            return Err(bad(
                "shell",
                self.shell,
                "more: at this c and --cells nothing is near enough to the set",
            ));
        }
        let normals = smooth_normals(&positions, &triangles);
        Ok(Builder { positions, normals, triangles }.finish())
    }

    /// Estimate of the distance from `p` to the set, at most 1; 0 inside.
    fn distance(&self, c: DVec4, p: DVec3) -> f64 {
        // Imaginary parts in x, y, z, the real part in w.
        let mut q = DVec4::new(p.y, p.z, 0.0, p.x);
        let mut derivative = 1.0;
        for _ in 0..self.iterations {
            let r = q.length();
            if r > 1e3 {
                return (0.5 * r * r.ln() / derivative).min(1.0);
            }
            // 0 at q = 0, from where the way out says nothing about the distance: then the cap above holds.
            derivative *= 2.0 * r;
            let real = q.w * q.w - q.truncate().length_squared();
            q = (q.truncate() * (2.0 * q.w)).extend(real) + c;
        }
        0.0
    }
}

/// Adds the piece of surface in one tetrahedron, which parts its inside corners from its outside ones.
fn march(
    tetrahedron: [usize; 4],
    inside: &[bool; 8],
    cut: &mut impl FnMut(usize, usize) -> u32,
    triangles: &mut Vec<[u32; 3]>,
) {
    let (mut ins, mut outs) = ([0; 4], [0; 4]);
    let (mut i, mut o) = (0, 0);
    for k in tetrahedron {
        if inside[k] {
            ins[i] = k;
            i += 1;
        } else {
            outs[o] = k;
            o += 1;
        }
    }
    // Edges of the tetrahedron around the piece, in order.
    let around: &[(usize, usize)] = match (i, o) {
        (1, 3) => &[(ins[0], outs[0]), (ins[0], outs[1]), (ins[0], outs[2])],
        (3, 1) => &[(ins[0], outs[0]), (ins[1], outs[0]), (ins[2], outs[0])],
        (2, 2) => &[(ins[0], outs[0]), (ins[0], outs[1]), (ins[1], outs[1]), (ins[1], outs[0])],
        _ => return,
    };
    // Which way round it faces outwards does not depend on where on the edges it runs: look at the midpoints.
    let corner = |k: usize| DVec3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64);
    let middle = |e: (usize, usize)| 0.5 * (corner(e.0) + corner(e.1));
    let [a, b, c] = [middle(around[0]), middle(around[1]), middle(around[2])];
    let outwards = (b - a).cross(c - a).dot(corner(outs[0]) - corner(ins[0])) > 0.0;
    let first = cut(around[0].0, around[0].1);
    for pair in around[1..].windows(2) {
        let (second, third) = (cut(pair[0].0, pair[0].1), cut(pair[1].0, pair[1].1));
        triangles.push(if outwards { [first, second, third] } else { [first, third, second] });
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::{Topology, assert_closed};
    use super::*;

    #[test]
    fn with_c_zero_it_is_the_unit_sphere_with_its_shell() {
        let ball = Julia { c: vec![0.0; 4], cells: 48, ..Julia::default() };
        let topology = assert_closed(&ball.build().unwrap());
        assert_eq!(topology.euler_characteristic, 2);
        // Distance r - 1 is estimated as r ln r / 2 there, which reaches the shell at about 1.04.
        let radius = (topology.signed_volume * 0.75 / std::f64::consts::PI).cbrt();
        assert!((radius - 1.04).abs() < 0.01, "{radius}");
    }

    #[test]
    fn julia_sets_are_closed() {
        for c in [[-0.2, 0.6, 0.2, 0.2], [-1.0, 0.2, 0.0, 0.0], [0.3, 0.0, 0.6, 0.1]] {
            let mesh = Julia { c: c.to_vec(), cells: 40, ..Julia::default() }.build().unwrap();
            let topology = Topology::of(&mesh);
            assert!(topology.is_closed() && topology.signed_volume > 0.0, "{c:?} {topology:?}");
        }
    }

    #[test]
    fn bad_parameters_are_refused_by_name() {
        let good = Julia::default();
        for (bad, option) in [
            (Julia { c: vec![0.0; 3], ..good.clone() }, "c"),
            (Julia { c: vec![f64::NAN; 4], ..good.clone() }, "c"),
            (Julia { cells: 1, ..good.clone() }, "cells"),
            (Julia { c: vec![2.0; 4], shell: 1e-6, cells: 8, ..good.clone() }, "shell"),
        ] {
            let message = bad.build().unwrap_err().to_string();
            assert!(message.starts_with(&format!("--{option}: ")), "{message}");
        }
    }
}
