//! What kind of surface a mesh is: closed or not, how many holes, how much it holds.

use crate::scene::Mesh;
use glam::DVec3;
use std::collections::HashMap;

/// Topology and volume of a mesh, its vertices merged by position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Topology {
    /// Vertices with distinct positions.
    pub vertices: usize,
    /// Distinct edges.
    pub edges: usize,
    /// Triangles.
    pub faces: usize,
    /// Edges that do not belong to exactly two triangles running along them in opposite directions.
    pub open_edges: usize,
    /// Triangles that have two corners at the same place.
    pub collapsed_faces: usize,
    /// Vertices - edges + faces: 2 - 2 * genus, summed over the closed surfaces of the mesh.
    pub euler_characteristic: i64,
    /// Volume enclosed by a closed mesh, above 0 if its triangles face outwards.
    pub signed_volume: f64,
}

impl Topology {
    /// Measures a mesh. Memory: about 100 bytes a triangle.
    pub fn of(mesh: &Mesh) -> Topology {
        let mut by_position: HashMap<[u64; 3], u32> = HashMap::with_capacity(mesh.positions.len());
        let merged: Vec<u32> = mesh
            .positions
            .iter()
            .map(|p| {
                let next = by_position.len() as u32;
                // Adding 0 turns -0 into +0.
                *by_position.entry(p.map(|x| (x + 0.0).to_bits())).or_insert(next)
            })
            .collect();

        let mut edges: HashMap<(u32, u32), [u32; 2]> = HashMap::with_capacity(mesh.triangles.len() * 3 / 2);
        let (mut collapsed_faces, mut signed_volume) = (0, 0.0);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| DVec3::from(mesh.positions[i as usize]));
            signed_volume += a.dot(b.cross(c)) / 6.0;
            let m = t.map(|i| merged[i as usize]);
            collapsed_faces += usize::from(m[0] == m[1] || m[1] == m[2] || m[2] == m[0]);
            for (from, to) in [(m[0], m[1]), (m[1], m[2]), (m[2], m[0])] {
                let uses = edges.entry((from.min(to), from.max(to))).or_default();
                uses[usize::from(from > to)] += 1;
            }
        }
        let vertices = by_position.len();
        Topology {
            vertices,
            edges: edges.len(),
            faces: mesh.triangles.len(),
            open_edges: edges.values().filter(|uses| **uses != [1, 1]).count(),
            collapsed_faces,
            euler_characteristic: vertices as i64 - edges.len() as i64 + mesh.triangles.len() as i64,
            signed_volume,
        }
    }

    /// True if the surface has no border, no edge shared by more than two triangles and no two neighbours that
    /// disagree about the outside.
    pub fn is_closed(&self) -> bool {
        self.faces > 0 && self.open_edges == 0 && self.collapsed_faces == 0
    }
}

/// What every generator's mesh must satisfy, for the tests beside them.
#[cfg(test)]
pub(super) fn assert_sound(mesh: &Mesh) -> Topology {
    use glam::Vec3;
    assert_eq!(mesh.normals.len(), mesh.positions.len());
    assert!(mesh.uvs.is_empty() || mesh.uvs.len() == mesh.positions.len());
    for n in &mesh.normals {
        assert!((Vec3::from(*n).length() - 1.0).abs() < 1e-5, "{n:?}");
    }
    let mut used = vec![false; mesh.positions.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| DVec3::from(mesh.positions[i as usize]));
        let face = (b - a).cross(c - a);
        let mean: DVec3 = t.iter().map(|&i| DVec3::from(mesh.normals[i as usize].map(f64::from))).sum();
        assert!(face.dot(mean) > 0.0, "normals of {t:?} look inwards: {a} {b} {c} {mean}");
        for &i in t {
            used[i as usize] = true;
        }
    }
    assert!(used.iter().all(|&u| u), "a vertex belongs to no triangle");
    Topology::of(mesh)
}

/// [`assert_sound`] for a closed surface.
#[cfg(test)]
pub(super) fn assert_closed(mesh: &Mesh) -> Topology {
    let topology = assert_sound(mesh);
    assert!(topology.is_closed(), "{topology:?}");
    assert!(topology.signed_volume > 0.0, "{topology:?}");
    topology
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn a_tetrahedron_is_closed_and_holds_a_sixth() {
        let topology = Topology::of(&tetrahedron());
        assert!(topology.is_closed());
        assert_eq!(topology.euler_characteristic, 2);
        assert!((topology.signed_volume - 1.0 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn a_missing_or_turned_triangle_is_found() {
        let mut open = tetrahedron();
        open.triangles.pop();
        assert_eq!(Topology::of(&open).open_edges, 3);
        let mut turned = tetrahedron();
        turned.triangles[0].swap(0, 1);
        assert_eq!(Topology::of(&turned).open_edges, 3);
    }
}
