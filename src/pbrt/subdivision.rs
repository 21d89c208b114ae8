//! Loop's subdivision surfaces (Loop 1987, with the rules for borders, limit positions and tangents of Hoppe et al. 1994
//! and of Biermann, Levin, Zorin 2000).

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// A mesh of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Subdivided {
    /// Places of vertices.
    pub positions: Vec<DVec3>,
    /// Their normals, not of unit length, on the side from which triangles turn clockwise: where pbrt has them.
    pub normals: Vec<DVec3>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

/// Triangles and vertices after some subdivisions, as far as they can be told without making them.
pub(crate) fn size(triangles: usize, vertices: usize, levels: u32) -> (u64, u64) {
    let (mut triangles, mut vertices) = (triangles as u64, vertices as u64);
    // From then on there are more than can be counted, or none.
    for _ in 0..levels.min(40) {
        // At most three edges a triangle, each of which gets a vertex.
        vertices = vertices.saturating_add(triangles.saturating_mul(3));
        triangles = triangles.saturating_mul(4);
    }
    (triangles, vertices)
}

/// Subdivides `levels` times, and moves the vertices to the limit surface.
pub(crate) fn subdivide(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, levels: u32) -> Subdivided {
    let (mut positions, mut triangles) = (positions, triangles);
    for _ in 0..levels {
        if triangles.is_empty() {
            break;
        }
        let edges = Edges::of(&triangles);
        let mut next = smoothed(&positions, &edges, even_weight, 1.0 / 8.0);
        let first = next.len() as u32;
        next.extend(edges.all.iter().map(|edge| edge.middle(&positions)));
        let middle = |a: u32, b: u32| first + edges.number[&ordered(a, b)];
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
        positions = next;
    }
    let edges = Edges::of(&triangles);
    let limit = smoothed(&positions, &edges, limit_weight, 1.0 / 5.0);
    let normals = normals(&limit, &triangles);
    Subdivided { positions: limit, normals, triangles }
}

/// Weight of each neighbour for a vertex that stays, by how many there are.
fn even_weight(valence: f64) -> f64 {
    if valence == 3.0 { 3.0 / 16.0 } else { 3.0 / (8.0 * valence) }
}

/// Weight of each neighbour for the limit.
fn limit_weight(valence: f64) -> f64 {
    (valence + 3.0 / (8.0 * even_weight(valence))).recip()
}

fn ordered(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

/// An edge, and the third vertices of its triangles.
struct Edge {
    ends: [u32; 2],
    opposite: [u32; 2],
    triangles: u32,
}

impl Edge {
    /// Of one triangle, or of more than two.
    fn is_border(&self) -> bool {
        self.triangles != 2
    }

    /// Where the new vertex goes.
    fn middle(&self, positions: &[DVec3]) -> DVec3 {
        let sum = |pair: [u32; 2]| positions[pair[0] as usize] + positions[pair[1] as usize];
        match self.is_border() {
            true => sum(self.ends) * 0.5,
            false => sum(self.ends) * (3.0 / 8.0) + sum(self.opposite) * (1.0 / 8.0),
        }
    }
}

struct Edges {
    number: HashMap<(u32, u32), u32>,
    all: Vec<Edge>,
}

impl Edges {
    fn of(triangles: &[[u32; 3]]) -> Edges {
        let mut edges = Edges { number: HashMap::with_capacity(triangles.len() * 2), all: Vec::new() };
        for &[a, b, c] in triangles {
            for (from, to, opposite) in [(a, b, c), (b, c, a), (c, a, b)] {
                let next = edges.all.len() as u32;
                let number = *edges.number.entry(ordered(from, to)).or_insert(next);
                if number == next {
                    edges.all.push(Edge { ends: [from, to], opposite: [opposite; 2], triangles: 0 });
                }
                let edge = &mut edges.all[number as usize];
                if edge.triangles == 1 {
                    edge.opposite[1] = opposite;
                }
                edge.triangles += 1;
            }
        }
        edges
    }
}

/// Every vertex moved towards its neighbours: by `inside` of their number where triangles are all around, by `border`
/// along the border elsewhere.
fn smoothed(positions: &[DVec3], edges: &Edges, inside: fn(f64) -> f64, border: f64) -> Vec<DVec3> {
    let n = positions.len();
    let (mut sum, mut count) = (vec![DVec3::ZERO; n], vec![0u32; n]);
    let (mut border_sum, mut border_count) = (vec![DVec3::ZERO; n], vec![0u32; n]);
    for edge in &edges.all {
        let [a, b] = edge.ends.map(|end| end as usize);
        for (vertex, neighbour) in [(a, b), (b, a)] {
            sum[vertex] += positions[neighbour];
            count[vertex] += 1;
            if edge.is_border() {
                border_sum[vertex] += positions[neighbour];
                border_count[vertex] += 1;
            }
        }
    }
    (0..n)
        .map(|vertex| match (count[vertex], border_count[vertex]) {
            (0, _) => positions[vertex],
            (valence, 0) => {
                let valence = f64::from(valence);
                let weight = inside(valence);
                positions[vertex] * (1.0 - valence * weight) + sum[vertex] * weight
            }
            (_, 2) => positions[vertex] * (1.0 - 2.0 * border) + border_sum[vertex] * border,
            // Where borders meet.
            _ => positions[vertex],
        })
        .collect()
}

/// Normals from the two tangents of the limit surface.
fn normals(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    // For each vertex the pairs of neighbours that make a triangle with it, counter-clockwise, one after the other.
    let mut first = vec![0usize; positions.len() + 1];
    for &vertex in triangles.as_flattened() {
        first[vertex as usize + 1] += 1;
    }
    for vertex in 0..positions.len() {
        first[vertex + 1] += first[vertex];
    }
    let mut pairs = vec![[0u32; 2]; triangles.len() * 3];
    let mut free = first.clone();
    for &[a, b, c] in triangles {
        for (vertex, pair) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
            pairs[free[vertex as usize]] = pair;
            free[vertex as usize] += 1;
        }
    }
    let mut ring = Vec::new();
    (0..positions.len())
        .map(|vertex| {
            let pairs = &mut pairs[first[vertex]..first[vertex + 1]];
            let flat = || {
                let own = positions[vertex];
                let cross =
                    |[a, b]: &[u32; 2]| (positions[*b as usize] - own).cross(positions[*a as usize] - own);
                pairs.iter().map(cross).sum::<DVec3>()
            };
            let fallback = flat();
            match ring_of(pairs, &mut ring) {
                Some(closed) => {
                    let points: Vec<DVec3> = ring.iter().map(|&i| positions[i as usize]).collect();
                    let [s, t] = tangents(positions[vertex], &points, closed);
                    // Counter-clockwise around the vertex, `s` x `t` is up inside; pbrt's looks down.
                    let normal = if closed { t.cross(s) } else { s.cross(t) };
                    if normal.is_finite() && normal != DVec3::ZERO { normal } else { fallback }
                }
                None => fallback,
            }
        })
        .collect()
}

/// Puts the neighbours in order, counter-clockwise; whether they go all around. `None` if they make no single fan.
fn ring_of(pairs: &mut [[u32; 2]], ring: &mut Vec<u32>) -> Option<bool> {
    ring.clear();
    let is_end = |vertex: u32, pairs: &[[u32; 2]]| !pairs.iter().any(|pair| pair[1] == vertex);
    let start = pairs.iter().map(|pair| pair[0]).find(|&vertex| is_end(vertex, pairs));
    let closed = start.is_none();
    let start = start.or_else(|| pairs.first().map(|pair| pair[0]))?;
    let mut at = start;
    for left in (0..pairs.len()).rev() {
        ring.push(at);
        let next = pairs[..=left].iter().position(|pair| pair[0] == at)?;
        at = pairs[next][1];
        pairs.swap(next, left);
    }
    match closed {
        true => (at == start).then_some(true),
        false => {
            ring.push(at);
            Some(false)
        }
    }
}

/// Two tangents at a vertex in its limit position, from the ring around it.
fn tangents(vertex: DVec3, ring: &[DVec3], closed: bool) -> [DVec3; 2] {
    let n = ring.len();
    if closed {
        let weighted = |f: fn(f64) -> f64| {
            ring.iter().enumerate().map(|(j, p)| *p * f(TAU * j as f64 / n as f64)).sum::<DVec3>()
        };
        return [weighted(f64::cos), weighted(f64::sin)];
    }
    let along = ring[n - 1] - ring[0];
    let across = match *ring {
        [a, b] => a + b - vertex * 2.0,
        [_, b, _] => b - vertex,
        [a, b, c, d] => (b + c) * 2.0 - a - d - vertex * 2.0,
        _ => {
            let theta = PI / (n - 1) as f64;
            let ends = (ring[0] + ring[n - 1]) * theta.sin();
            let factor = 2.0 * theta.cos() - 2.0;
            let between = (1..n - 1).map(|k| ring[k] * (factor * (k as f64 * theta).sin()));
            -(ends + between.sum::<DVec3>())
        }
    };
    [along, across]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn icosahedron() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let g = (1.0 + 5f64.sqrt()) / 2.0;
        let mut p = Vec::new();
        for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
            p.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
        }
        let mut triangles = Vec::new();
        for a in 0..12usize {
            for b in 0..12 {
                for c in 0..12 {
                    let near = |i: usize, j: usize| (p[i] - p[j]).length() < 2.1;
                    let outward = (p[b] - p[a]).cross(p[c] - p[a]).dot(p[a]) > 0.0;
                    if a < b && a < c && b != c && near(a, b) && near(b, c) && near(c, a) && outward {
                        triangles.push([a, b, c].map(|i| i as u32));
                    }
                }
            }
        }
        assert_eq!(triangles.len(), 20);
        (p, triangles)
    }

    #[test]
    fn a_closed_surface_becomes_smooth() {
        let (p, triangles) = icosahedron();
        let out = subdivide(p, triangles, 3);
        assert_eq!((out.triangles.len(), out.positions.len()), (20 * 64, 10 * 64 + 2));
        // Nearly a ball, whose normals look inwards when triangles turn counter-clockwise from outside.
        let radii: Vec<f64> = out.positions.iter().map(|p| p.length()).collect();
        let (least, most) = radii.iter().fold((f64::MAX, 0.0f64), |(a, b), &r| (a.min(r), b.max(r)));
        assert!(most / least < 1.04, "{least} {most}");
        for (p, n) in out.positions.iter().zip(&out.normals) {
            assert!(p.normalize().dot(n.normalize()) < -0.99);
        }
    }

    #[test]
    fn the_limit_does_not_depend_on_the_level() {
        let (p, triangles) = icosahedron();
        let [coarse, fine] = [0, 3].map(|levels| subdivide(p.clone(), triangles.clone(), levels));
        for k in 0..12 {
            assert!((coarse.positions[k] - fine.positions[k]).length() < 1e-12);
            assert!(coarse.normals[k].normalize().dot(fine.normals[k].normalize()) > 1.0 - 1e-9);
        }
    }

    #[test]
    fn flat_surfaces_stay_flat_and_borders_keep_to_themselves() {
        // A square of 3 x 3 vertices.
        let p: Vec<DVec3> = (0..9).map(|k| DVec3::new((k % 3) as f64, (k / 3) as f64, 0.0)).collect();
        let cell = |x: u32, y: u32| {
            let a = x + 3 * y;
            [[a, a + 1, a + 4], [a, a + 4, a + 3]]
        };
        let triangles: Vec<_> =
            [(0, 0), (1, 0), (0, 1), (1, 1)].iter().flat_map(|&(x, y)| cell(x, y)).collect();
        for levels in [0, 1, 2] {
            let out = subdivide(p.clone(), triangles.clone(), levels);
            assert_eq!(out.triangles.len(), 8 << (2 * levels));
            for (p, n) in out.positions.iter().zip(&out.normals) {
                assert!(p.z == 0.0 && n.normalize().z < -0.999_999, "{p} {n}");
            }
            // The middle of an edge of the border stays on it; corners are rounded.
            assert!(out.positions.iter().any(|p| (*p - DVec3::new(1.0, 0.0, 0.0)).length() < 1e-12));
            assert!(out.positions.iter().all(|p| (*p - DVec3::ZERO).length() > 0.1));
        }
        // Where the two tangents of a lone triangle's corners are taken from its two neighbours.
        let alone = subdivide(p[..5].to_vec(), vec![[0, 1, 3]], 2);
        assert!(alone.normals[..2].iter().all(|n| n.normalize().z < -0.999_999));
        // The vertex that no triangle has stays where it is.
        assert_eq!(alone.positions[2], p[2]);
    }

    #[test]
    fn what_is_no_surface_does_no_harm() {
        let p: Vec<DVec3> = (0..6).map(|k| DVec3::new(k as f64, (k * k) as f64, (k % 2) as f64)).collect();
        for triangles in [
            vec![],
            vec![[0, 0, 0]],
            vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]],
            vec![[0, 1, 2], [0, 3, 4]],
            vec![[0, 1, 2], [0, 1, 2], [2, 1, 0]],
        ] {
            let out = subdivide(p.clone(), triangles, 2);
            assert_eq!(out.positions.len(), out.normals.len());
            assert!(out.positions.iter().chain(&out.normals).all(|v| v.is_finite()));
        }
        assert_eq!(size(1, 3, 1), (4, 6));
        assert!(size(1, 3, u32::MAX).0 > 1 << 60 && size(0, 3, u32::MAX).0 == 0);
        assert_eq!(subdivide(p.clone(), vec![], u32::MAX).positions, p);
    }
}
