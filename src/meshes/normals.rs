//! Vertex normals from the triangles around them.

use super::{MAX_TRIANGLES, round};
use crate::scene::Mesh;
use glam::DVec3;

/// Normals as the mean of the faces around each vertex, weighted by area. Every vertex belongs to a triangle.
pub(super) fn smooth_normals(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for t in triangles {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let area = (b - a).cross(c - a);
        for &i in t {
            normals[i as usize] += area;
        }
    }
    for n in &mut normals {
        *n = n.normalize_or(DVec3::Y);
    }
    normals
}

/// Turns a mesh of shared vertices into one with normals, smooth over edges where the faces meet at less than
/// `crease` degrees and sharp elsewhere; vertices on sharp edges are split. Vertex order follows the triangles.
pub(super) fn creased(positions: &[DVec3], triangles: &[[u32; 3]], crease: f64) -> Mesh {
    debug_assert!(triangles.len() as u64 <= MAX_TRIANGLES);
    let limit = crease.to_radians().cos();
    let faces: Vec<DVec3> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            (b - a).cross(c - a)
        })
        .collect();

    // Triangles around each vertex, one list after the other.
    let mut start = vec![0u32; positions.len() + 1];
    for &i in triangles.iter().flatten() {
        start[i as usize + 1] += 1;
    }
    for i in 1..start.len() {
        start[i] += start[i - 1];
    }
    let mut fill = start.clone();
    let mut around = vec![0u32; 3 * triangles.len()];
    for (f, t) in triangles.iter().enumerate() {
        for &i in t {
            around[fill[i as usize] as usize] = f as u32;
            fill[i as usize] += 1;
        }
    }

    // One output vertex per vertex and distinct normal there.
    let mut mesh = Mesh::default();
    let mut made: Vec<Vec<(DVec3, u32)>> = vec![Vec::new(); positions.len()];
    for (f, t) in triangles.iter().enumerate() {
        let own = faces[f].normalize_or_zero();
        mesh.triangles.push(t.map(|i| {
            let i = i as usize;
            let near = &around[start[i] as usize..start[i + 1] as usize];
            let sum: DVec3 = near
                .iter()
                .map(|&g| faces[g as usize])
                .filter(|g| g.normalize_or_zero().dot(own) >= limit)
                .sum();
            let normal = sum.normalize_or(own);
            // Normals of one smooth patch are sums of the same faces and so are the same to rounding.
            if let Some(&(_, index)) = made[i].iter().find(|(n, _)| n.dot(normal) > 1.0 - 1e-12) {
                return index;
            }
            let index = mesh.positions.len() as u32;
            mesh.positions.push(round(positions[i]).map(f64::from));
            mesh.normals.push(round(normal));
            made[i].push((normal, index));
            index
        }));
    }
    mesh
}
