//! The surface of a box of lattice points, for everything that is a bent cube.

use std::collections::HashMap;

/// Triangles of [`lattice`].
pub(super) fn lattice_triangles(n: u32) -> u128 {
    12 * u128::from(n) * u128::from(n)
}

/// The surface of the cube of lattice points `0..=n` on each axis: the points on it, and two triangles a unit square,
/// facing outwards.
pub(super) fn lattice(n: u32) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
    let mut points = Vec::new();
    let mut index: HashMap<[u32; 3], u32> = HashMap::new();
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [0, n] {
            for j in 0..n {
                for i in 0..n {
                    let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(di, dj)| {
                        let mut p = [side; 3];
                        p[(axis + 1) % 3] = i + di;
                        p[(axis + 2) % 3] = j + dj;
                        *index.entry(p).or_insert_with(|| {
                            points.push(p);
                            points.len() as u32 - 1
                        })
                    });
                    if side == 0 {
                        triangles.extend([[a, d, c], [a, c, b]]);
                    } else {
                        triangles.extend([[a, b, c], [a, c, d]]);
                    }
                }
            }
        }
    }
    (points, triangles)
}
