//! The point where a ray met a surface: put back onto the primitive, with its normals.

use crate::lanes::{Mask, Real, Uint, map3};
use crate::math::Vec3;
use crate::scene::Geometry;

/// A point on a surface.
#[derive(Clone, Copy)]
pub struct Surface<F: Real> {
    /// The point, on the primitive to within a few units in the last place of `size`.
    pub point: Vec3<F>,
    /// Geometric normal, unit, oriented (its side emits; it points out of a dielectric).
    pub normal: Vec3<F>,
    /// Shading normal, unit, on the side of the geometric normal as the mesh has it.
    pub shading_normal: Vec3<F>,
    /// Largest coordinate that entered the computation of `point`: what its rounding error is relative to.
    pub size: F,
}

impl<F: Real> Surface<F> {
    /// The point at distance `t` along a ray, on `primitive`; `u` and `v` are read where the primitive has vertex
    /// normals.
    ///
    /// The distance alone leaves an error that grows with the length of the ray. Projecting onto the plane of the
    /// triangle or onto the sphere takes out its part along the normal, which is the part that matters.
    ///
    /// # Safety
    /// Every lane of `primitive` is below `geometry.primitives()`.
    #[inline(always)]
    pub unsafe fn new(
        geometry: &Geometry,
        primitive: F::Uint,
        origin: Vec3<F>,
        direction: Vec3<F>,
        t: F,
        barycentric: impl FnOnce() -> (F, F),
    ) -> Self {
        let raw = direction.mul_add(t, origin);
        let first = primitive.shl::<2>();
        // SAFETY: `surfaces` holds four numbers for every primitive.
        let (a, b) = unsafe {
            let at = |k: u32| F::gather(geometry.surfaces(), first + F::Uint::splat(k));
            (Vec3::new(at(0), at(1), at(2)), at(3))
        };
        let triangle = primitive.lt(F::Uint::splat(geometry.first_sphere()));
        // Triangle: a is the normal, b its product with any point of the plane.
        let off = a.dot(raw) - b;
        let mut normal = a;
        let mut point = a.mul_add(-off, raw);
        let mut size = F::zero();
        if (!triangle).any() {
            // Sphere: a is the centre, b the radius, negative where the normal points inwards.
            let outwards = (raw - a).normalize();
            let on_sphere = outwards.mul_add(b.abs(), a);
            point = Vec3::select(triangle, point, on_sphere);
            normal = Vec3::select(triangle, normal, outwards.xor_sign(b));
            let of_sphere = a.x.abs().max(a.y.abs()).max(a.z.abs()).max(b.abs());
            size = F::select(triangle, size, of_sphere);
        }
        if !geometry.quadrics().is_empty() {
            let quadric = !primitive.lt(F::Uint::splat(geometry.first_quadric()));
            if quadric.any() {
                (point, normal, size) = on_quadrics(geometry, quadric, primitive, raw, (point, normal, size));
            }
        }
        let mut shading_normal = normal;
        if geometry.smooth_triangles() != 0 {
            let smooth = primitive.lt(F::Uint::splat(geometry.smooth_triangles() as u32));
            if smooth.any() {
                let (u, v) = barycentric();
                // Lanes without vertex normals read those of triangle 0.
                let triangle = F::Uint::select(smooth, primitive, F::Uint::splat(0));
                // SAFETY: the first `smooth_triangles` triangles have three normals each, which exist.
                let n = unsafe { interpolated_normal(geometry, triangle, u, v) };
                shading_normal = Vec3::select(smooth, n, normal);
            }
        }
        let size = size.max(point.x.abs()).max(point.y.abs()).max(point.z.abs());
        Surface { point, normal, shading_normal, size }
    }

    /// Where a ray in `direction` starts: off the surface, to the side into which it leaves, by more than the
    /// rounding error of the point. No constant epsilon: scenes of any scale work.
    #[inline(always)]
    pub fn leave(&self, direction: Vec3<F>) -> Vec3<F> {
        // 16 units in the last place cover the errors of projection (4) and of this sum, with a margin.
        let distance = self.size * F::lit(16.0 / 16_777_216.0);
        self.normal.mul_add(distance.xor_sign(self.normal.dot(direction)), self.point)
    }
}

/// Unit normal between those of the corners.
///
/// # Safety
/// Every lane of `triangle` is below `geometry.smooth_triangles()`, whose normals exist.
#[inline(always)]
unsafe fn interpolated_normal<F: Real>(geometry: &Geometry, triangle: F::Uint, u: F, v: F) -> Vec3<F> {
    let first = triangle * F::Uint::splat(3);
    // SAFETY: the caller's promise.
    let [a, b, c] = map3!([0, 1, 2], |k| unsafe {
        let n = F::Uint::gather(geometry.triangle_normals(), first + F::Uint::splat(k)) * F::Uint::splat(3);
        let [x, y, z] = map3!([0, 1, 2], |c| F::gather(geometry.normals(), n + F::Uint::splat(c)));
        Vec3::new(x, y, z)
    });
    let w = F::one() - u - v;
    a.mul_add(w, b.mul_add(u, c.scale(v))).normalize()
}

/// Points and normals of the quadric lanes, one at a time: they are rare.
#[inline(always)]
fn on_quadrics<F: Real>(
    geometry: &Geometry,
    lanes: F::Mask,
    primitive: F::Uint,
    raw: Vec3<F>,
    others: (Vec3<F>, Vec3<F>, F),
) -> (Vec3<F>, Vec3<F>, F) {
    let (point, normal, size) = others;
    let ids = primitive.to_array();
    let mut p = [point.x.to_array(), point.y.to_array(), point.z.to_array()];
    let mut n = [normal.x.to_array(), normal.y.to_array(), normal.z.to_array()];
    let mut s = size.to_array();
    let r = [raw.x.to_array(), raw.y.to_array(), raw.z.to_array()];
    for i in (0..F::LANES).filter(|i| lanes.bits() >> i & 1 == 1) {
        let quadric = &geometry.quadrics()[(ids[i] - geometry.first_quadric()) as usize];
        let (point, normal, size) = quadric.surface([r[0][i], r[1][i], r[2][i]]);
        for axis in 0..3 {
            p[axis][i] = point[axis];
            n[axis][i] = normal[axis];
        }
        s[i] = size;
    }
    let vector = |a: &[[f32; 16]; 3]| Vec3::new(F::load(&a[0], 0), F::load(&a[1], 0), F::load(&a[2], 0));
    (vector(&p), vector(&n), F::load(&s, 0))
}
