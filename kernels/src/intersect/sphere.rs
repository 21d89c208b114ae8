//! Ray/sphere intersection after Haines, Guenther and Akenine-Moeller (Ray Tracing Gems, chapter 7): no cancellation
//! for small spheres far away, nor for rays that start on the surface. Plain sums and products, so that every build
//! gives the same bits.

use crate::lanes::{Mask, Real};

/// Distances of a ray from `origin` along the unit `direction` to spheres: the nearest in (0, t_max], and the lanes
/// that have one. Radii may be negative (turned normals).
#[inline(always)]
pub fn intersect<F: Real>(
    origin: [F; 3],
    direction: [F; 3],
    centre: [F; 3],
    radius: F,
    t_max: F,
) -> (F, F::Mask) {
    let [fx, fy, fz] = [origin[0] - centre[0], origin[1] - centre[1], origin[2] - centre[2]];
    let [dx, dy, dz] = direction;
    let d2 = dx * dx + dy * dy + dz * dz;
    let b = -(fx * dx + fy * dy + fz * dz);
    let r2 = radius * radius;
    // From the centre to the closest approach.
    let s = b / d2;
    let [lx, ly, lz] = [fx + s * dx, fy + s * dy, fz + s * dz];
    let discriminant = r2 - (lx * lx + ly * ly + lz * lz);
    let meets = discriminant.ge(F::zero());
    // q = b + sign(b) sqrt(d2 discriminant): the root without cancellation; the other is c / q.
    let root = (d2 * discriminant.max(F::zero())).sqrt();
    let q = b + root.xor_sign(b);
    // c = |f|^2 - r^2, as a product that keeps its digits where the two are close.
    let length = (fx * fx + fy * fy + fz * fz).sqrt();
    let (height, sum) = (length - radius.abs(), length + radius.abs());
    let c = height * sum;
    let (t0, t1) = (c / q, q / d2);
    let (near, far) = (t0.min(t1), t0.max(t1));
    let mut t = F::select(near.gt(F::zero()), near, far);
    let close = height.abs().lt(sum * F::lit(5e-4));
    if close.any() {
        // Close to a sphere that is large, as seen from the origin of the world, the ray's origin is known better than its
        // place relative to the centre.
        let size = centre[0].abs().max(centre[1].abs()).max(centre[2].abs()) + radius.abs();
        let from_origin = origin[0].abs().max(origin[1].abs()).max(origin[2].abs());
        let doubtful = close & (from_origin * F::lit(32.0)).lt(size);
        if doubtful.any() {
            t = in_double_precision(
                origin,
                direction,
                (centre, radius),
                doubtful,
                F::select(meets, t, F::zero()),
            );
            return (t, t.gt(F::zero()) & t.le(t_max));
        }
    }
    (t, meets & t.gt(F::zero()) & t.le(t_max))
}

/// What rounding in double precision does to heights over a sphere, relative to its size, at most.
pub(crate) const DOUBLE_ROUNDING: f64 = f64::EPSILON * 64.0;

/// Distances in double precision; 0 in lanes that miss.
#[cold]
#[inline(never)]
fn in_double_precision<F: Real>(
    origin: [F; 3],
    direction: [F; 3],
    sphere: ([F; 3], F),
    lanes: F::Mask,
    single: F,
) -> F {
    let [o, d, c] = [origin, direction, sphere.0].map(|v| v.map(|x| x.to_array()));
    let radius = sphere.1.to_array();
    let mut out = single.to_array();
    for i in (0..F::LANES).filter(|i| lanes.bits() >> i & 1 == 1) {
        let f: [f64; 3] = core::array::from_fn(|k| o[k][i] as f64 - c[k][i] as f64);
        let d = [d[0][i] as f64, d[1][i] as f64, d[2][i] as f64];
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (d2, b, r) = (dot(d, d), -dot(f, d), (radius[i] as f64).abs());
        let length = dot(f, f).sqrt();
        let c = (length - r) * (length + r);
        let closest: [f64; 3] = core::array::from_fn(|k| f[k] + b / d2 * d[k]);
        let discriminant = r * r - dot(closest, closest);
        out[i] = 0.0;
        if discriminant >= 0.0 {
            let q = b + (d2 * discriminant).sqrt().copysign(b);
            let (near, far) = ((c / q).min(q / d2), (c / q).max(q / d2));
            out[i] = if near > 0.0 { near } else { far } as f32;
        }
    }
    F::load(&out, 0)
}
