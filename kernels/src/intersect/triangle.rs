//! Watertight ray/triangle intersection (Woop, Benthin, Wald 2013), over any number of triangles at a time.
//!
//! Sums and products are plain, never fused: an edge must give the same number from both of its triangles, and every
//! build and lane type must give the same bits.

use crate::lanes::{Mask, Real, map3};

/// A ray prepared for triangles: axes permuted so that its direction is longest along the last one, and sheared so
/// that it points along it.
#[derive(Clone, Copy, Debug)]
pub struct ShearedRay {
    /// Axis that becomes x, y, z.
    pub axes: [usize; 3],
    /// Shear along x and y, scale along z.
    pub shear: [f32; 3],
    /// Ray origin, axes permuted.
    pub origin: [f32; 3],
}

impl ShearedRay {
    /// Prepares a ray; `direction` is not zero.
    #[inline(always)]
    pub fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        let [x, y, z] = map3!(direction, |x| x.abs());
        let kz = if x > y && x > z {
            0
        } else if y > z {
            1
        } else {
            2
        };
        // The winding turns with the sign of the direction, and with it the signs of all edge functions and of their
        // sum: distances and weights are the same, to the bit.
        let (kx, ky) = ([1, 2, 0][kz], [2, 0, 1][kz]);
        let scale = 1.0 / direction[kz];
        ShearedRay {
            axes: [kx, ky, kz],
            shear: [direction[kx] * scale, direction[ky] * scale, scale],
            origin: [origin[kx], origin[ky], origin[kz]],
        }
    }
}

/// Hits of some triangles by one ray.
#[derive(Clone, Copy, Debug)]
pub struct TriangleHits<F: Real> {
    /// Distance, where `hit`.
    pub t: F,
    /// Barycentric weight of the second corner.
    pub u: F,
    /// Barycentric weight of the third corner.
    pub v: F,
    /// Lanes whose triangle is hit at a distance in (0, t_max].
    pub hit: F::Mask,
}

/// One ray against the triangles of all lanes. `corners[k][axis]` is the coordinate of corner `k`, axes in world
/// order.
#[inline(always)]
pub fn intersect<F: Real>(ray: &ShearedRay, corners: &[[F; 3]; 3], t_max: F) -> TriangleHits<F> {
    let permuted = map3!(*corners, |corner| map3!(ray.axes, |axis| corner[axis]));
    intersect_permuted(ray, permuted, t_max)
}

/// As [`intersect`], with the coordinates in the order of the ray's axes: for callers that load them in this order. An
/// array that is indexed by what only the ray knows goes through memory.
#[inline(always)]
pub fn intersect_permuted<F: Real>(ray: &ShearedRay, corners: [[F; 3]; 3], t_max: F) -> TriangleHits<F> {
    let [sx, sy, sz] = map3!(ray.shear, |x| F::splat(x));
    let [ox, oy, oz] = map3!(ray.origin, |x| F::splat(x));
    // Corners relative to the ray, sheared: the ray is the z axis.
    let sheared = map3!(corners, |corner| {
        let [x, y, z] = corner;
        let z = z - oz;
        [(x - ox) - sx * z, (y - oy) - sy * z, sz * z]
    });
    intersect_sheared(sheared, t_max)
}

/// The z axis against triangles whose corners are given in the ray's sheared coordinates.
#[inline(always)]
pub fn intersect_sheared<F: Real>(corners: [[F; 3]; 3], t_max: F) -> TriangleHits<F> {
    let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = corners;
    // Scaled barycentric coordinates: edge functions around the origin.
    let mut u = cx * by - cy * bx;
    let mut v = ax * cy - ay * cx;
    let mut w = bx * ay - by * ax;
    let zero = F::zero();
    let negative = u.lt(zero) | v.lt(zero) | w.lt(zero);
    let positive = u.gt(zero) | v.gt(zero) | w.gt(zero);
    let mut inside = !(negative & positive);
    let on_edge = (u.eq(zero) | v.eq(zero) | w.eq(zero)) & inside;
    if on_edge.any() {
        // Single precision cannot tell on which side of an edge the ray passes.
        (u, v, w) = in_double_precision([(ax, ay), (bx, by), (cx, cy)], on_edge, (u, v, w));
        let negative = u.lt(zero) | v.lt(zero) | w.lt(zero);
        let positive = u.gt(zero) | v.gt(zero) | w.gt(zero);
        inside = !(negative & positive);
    }
    let determinant = u + v + w;
    inside = inside & !determinant.eq(zero);
    let nothing = TriangleHits { t: zero, u: zero, v: zero, hit: inside };
    if !inside.any() {
        return nothing;
    }
    let inverse = determinant.recip();
    let t = (u * az + v * bz + w * cz) * inverse;
    let hit = inside & t.gt(zero) & t.le(t_max);
    if !hit.any() {
        return TriangleHits { hit, ..nothing };
    }
    // The weights have one sign, so `t` lies between the corners' distances: if all of those are in front of the ray's
    // origin by more than their rounding error, so is the hit.
    let gamma = |n: f64| F::lit(n * f32::EPSILON as f64 * 0.5 / (1.0 - n * f32::EPSILON as f64 * 0.5));
    let max3 = |a: F, b: F, c: F| a.abs().max(b.abs()).max(c.abs());
    let max_z = max3(az, bz, cz);
    let delta_z = gamma(3.0) * max_z;
    let in_front = az.min(bz).min(cz).gt(delta_z);
    let mut hit = hit;
    if (hit & !in_front).any() {
        // Triangles around the origin: distances that rounding alone could have made positive do not count (Pharr,
        // Jakob, Humphreys, section 6.8.7). Not for the others: the bound grows with the square of the distance over
        // the size of the triangle, and would lose all triangles further away than 3e5 times their size.
        let (max_x, max_y) = (max3(ax, bx, cx), max3(ay, by, cy));
        let delta_x = gamma(5.0) * (max_x + max_z);
        let delta_y = gamma(5.0) * (max_y + max_z);
        let two = F::lit(2.0);
        let delta_e = two * (gamma(2.0) * max_x * max_y + delta_y * max_x + delta_x * max_y);
        let max_e = max3(u, v, w);
        let delta_t =
            F::lit(3.0) * (gamma(3.0) * max_e * max_z + delta_e * max_z + delta_z * max_e) * inverse.abs();
        hit = hit & (in_front | t.gt(delta_t));
    }
    TriangleHits { t, u: v * inverse, v: w * inverse, hit }
}

/// The edge functions once more in double precision, in which their products are exact.
#[cold]
#[inline(never)]
fn in_double_precision<F: Real>(corners: [(F, F); 3], lanes: F::Mask, single: (F, F, F)) -> (F, F, F) {
    let c = corners.map(|(x, y)| (x.to_array(), y.to_array()));
    let mut out = [single.0.to_array(), single.1.to_array(), single.2.to_array()];
    for i in (0..F::LANES).filter(|i| lanes.bits() >> i & 1 == 1) {
        let p = c.map(|(x, y)| (x[i] as f64, y[i] as f64));
        let edge = |a: (f64, f64), b: (f64, f64)| (a.0 * b.1 - a.1 * b.0) as f32;
        out[0][i] = edge(p[2], p[1]);
        out[1][i] = edge(p[0], p[2]);
        out[2][i] = edge(p[1], p[0]);
    }
    (F::load(&out[0], 0), F::load(&out[1], 0), F::load(&out[2], 0))
}
