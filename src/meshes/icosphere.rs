//! The unit sphere as a subdivided icosahedron: the starting point of everything round without poles.

use glam::DVec3;

/// Triangles of [`icosphere`].
pub(super) fn icosphere_triangles(frequency: u32) -> u128 {
    20 * u128::from(frequency) * u128::from(frequency)
}

/// Unit vectors and triangles (outward) of an icosahedron whose edges are cut into `frequency` parts and whose
/// points are then pushed onto the sphere: `10 f^2 + 2` vertices, `20 f^2` triangles.
pub(super) fn icosphere(frequency: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut corners = Vec::new();
    for (a, b) in [(-1.0, -golden), (1.0, -golden), (-1.0, golden), (1.0, golden)] {
        corners.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    // The edges are the pairs of corners at distance 2, the nearest; the faces are their triangles.
    let near = |a: usize, b: usize| corners[a].distance_squared(corners[b]) < 4.1;
    let mut edges = Vec::new();
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in (a + 1..12).filter(|&b| near(a, b)) {
            edges.push((a, b));
            for c in (b + 1..12).filter(|&c| near(a, c) && near(b, c)) {
                let outward = corners[a].dot(corners[b].cross(corners[c])) > 0.0;
                faces.push(if outward { [a, b, c] } else { [a, c, b] });
            }
        }
    }

    let n = frequency as usize;
    let mut points = Vec::with_capacity(10 * n * n + 2);
    points.extend_from_slice(&corners);
    for &(a, b) in &edges {
        for k in 1..n {
            points.push(corners[a].lerp(corners[b], k as f64 / n as f64));
        }
    }
    let mut triangles = Vec::with_capacity(20 * n * n);
    for [a, b, c] in faces {
        // Index of the point i steps towards b and j steps towards c.
        let inside = points.len();
        let on_edge = |from: usize, to: usize, step: usize| {
            let (low, high, step) = if from < to { (from, to, step) } else { (to, from, n - step) };
            match step {
                0 => low,
                s if s == n => high,
                s => {
                    let edge = edges.iter().position(|&e| e == (low, high));
                    12 + edge.expect("two corners of a face share an edge") * (n - 1) + s - 1
                }
            }
        };
        let mut row_start = vec![0];
        for i in 1..n {
            row_start.push(points.len() - inside);
            for j in 1..n - i {
                let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
                points.push(corners[a] * (1.0 - u - v) + corners[b] * u + corners[c] * v);
            }
        }
        let index = |i: usize, j: usize| {
            let at = match (i, j) {
                (i, 0) => on_edge(a, b, i),
                (0, j) => on_edge(a, c, j),
                (i, j) if i + j == n => on_edge(b, c, j),
                (i, j) => inside + row_start[i] + j - 1,
            };
            at as u32
        };
        for i in 0..n {
            for j in 0..n - i {
                triangles.push([index(i, j), index(i + 1, j), index(i, j + 1)]);
                if i + j + 1 < n {
                    triangles.push([index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)]);
                }
            }
        }
    }
    for p in &mut points {
        *p = p.normalize();
    }
    (points, triangles)
}

#[cfg(test)]
mod tests {
    use super::super::{Builder, topology::assert_closed};
    use super::*;

    #[test]
    fn every_frequency_is_a_closed_sphere() {
        for frequency in [1, 2, 3, 5, 8, 33] {
            let (points, triangles) = icosphere(frequency);
            assert_eq!(triangles.len() as u128, icosphere_triangles(frequency));
            assert_eq!(points.len() as u32, 10 * frequency * frequency + 2);
            let mesh = Builder { normals: points.clone(), positions: points, triangles }.finish();
            assert_eq!(assert_closed(&mesh).euler_characteristic, 2);
        }
    }
}
