//! Ray/sphere intersection after Haines, Guenther and Akenine-Moeller (Ray Tracing Gems, chapter 7): no cancellation
//! for small spheres far away, nor for rays that start on the surface. Plain sums and products, so that every build
//! gives the same bits.

use crate::lanes::Real;

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
    let c = (length - radius.abs()) * (length + radius.abs());
    let (t0, t1) = (c / q, q / d2);
    let (near, far) = (t0.min(t1), t0.max(t1));
    let t = F::select(near.gt(F::zero()), near, far);
    (t, meets & t.gt(F::zero()) & t.le(t_max))
}
