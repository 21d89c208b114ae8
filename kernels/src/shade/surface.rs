//! The point where a ray met a surface: put back onto the primitive, with its normals.

use crate::intersect::sphere;
use crate::lanes::{Mask, Real, Uint, map3};
use crate::math::Vec3;
use crate::scene::Geometry;

/// A point on a surface.
#[derive(Clone, Copy)]
pub struct Surface<F: Real> {
    /// The point, on the primitive to within half of `error`.
    pub point: Vec3<F>,
    /// Geometric normal, unit, oriented (its side emits; it points out of a dielectric).
    pub normal: Vec3<F>,
    /// Shading normal, unit, on the side of the geometric normal as the mesh has it.
    pub shading_normal: Vec3<F>,
    /// How far off the surface rays start: above the rounding errors, along the normal, of `point`, of their start and of
    /// the test that must not meet the surface from there.
    pub error: F,
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
        // `off` has 3 roundings, the point and the start of a ray 1 each.
        let mut error = rounding(point, normal) * F::lit(8.0);
        if (!triangle).any() {
            // Sphere: a is the centre, b the radius, negative where the normal points inwards.
            let radius = b.abs();
            let mut outwards = (raw - a).normalize();
            let mut on_sphere = outwards.mul_add(radius, a);
            // 4 or 5 roundings of the radius in the point, 3 or 4 in the test of the sphere.
            let mut of_sphere =
                (radius * F::lit(8.0 * ROUNDING)) + rounding(on_sphere, outwards) * F::lit(4.0);
            // On large spheres close to the origin, points are known better than their place relative to the centre.
            let size = a.x.abs().max(a.y.abs()).max(a.z.abs()) + radius;
            let near = raw.x.abs().max(raw.y.abs()).max(raw.z.abs());
            let doubtful = !triangle & (near * F::lit(64.0)).lt(size);
            if doubtful.any() {
                (outwards, on_sphere) = on_large_spheres(doubtful, raw, a, radius, (outwards, on_sphere));
                let of_point = rounding(on_sphere, outwards)
                    .mul_add(F::lit(8.0), size * F::lit(sphere::DOUBLE_ROUNDING));
                of_sphere = F::select(doubtful, of_point, of_sphere);
            }
            point = Vec3::select(triangle, point, on_sphere);
            normal = Vec3::select(triangle, normal, outwards.xor_sign(b));
            error = F::select(triangle, error, of_sphere);
        }
        if !geometry.quadrics().is_empty() {
            let quadric = !primitive.lt(F::Uint::splat(geometry.first_quadric()));
            if quadric.any() {
                (point, normal, error) =
                    on_quadrics(geometry, quadric, primitive, raw, (point, normal, error));
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
        Surface { point, normal, shading_normal, error }
    }

    /// Where a ray in `direction` starts: off the surface, to the side into which it leaves, by more than the
    /// rounding error of the point. No constant epsilon: scenes of any scale work.
    #[inline(always)]
    pub fn leave(&self, direction: Vec3<F>) -> Vec3<F> {
        self.normal.mul_add(self.error.xor_sign(self.normal.dot(direction)), self.point)
    }
}

/// Half of a unit in the last place of 1: the largest relative error of one rounding.
const ROUNDING: f64 = f32::EPSILON as f64 * 0.5;

/// How far rounding a point moves it along the normal, at most.
#[inline(always)]
fn rounding<F: Real>(point: Vec3<F>, normal: Vec3<F>) -> F {
    let sum = (point.x * normal.x).abs() + (point.y * normal.y).abs() + (point.z * normal.z).abs();
    sum * F::lit(ROUNDING)
}

/// Outward normals and points of some lanes on spheres, in double precision.
#[cold]
#[inline(never)]
fn on_large_spheres<F: Real>(
    lanes: F::Mask,
    raw: Vec3<F>,
    centre: Vec3<F>,
    radius: F,
    others: (Vec3<F>, Vec3<F>),
) -> (Vec3<F>, Vec3<F>) {
    let arrays = |v: Vec3<F>| [v.x.to_array(), v.y.to_array(), v.z.to_array()];
    let (raw, centre, radius) = (arrays(raw), arrays(centre), radius.to_array());
    let (mut normal, mut point) = (arrays(others.0), arrays(others.1));
    for i in (0..F::LANES).filter(|i| lanes.bits() >> i & 1 == 1) {
        let from: [f64; 3] = core::array::from_fn(|k| raw[k][i] as f64 - centre[k][i] as f64);
        let length = from.iter().map(|x| x * x).sum::<f64>().sqrt();
        let off = length - radius[i] as f64;
        for k in 0..3 {
            let n = from[k] / length;
            normal[k][i] = n as f32;
            point[k][i] = (raw[k][i] as f64 - off * n) as f32;
        }
    }
    let vector = |a: &[[f32; 16]; 3]| Vec3::new(F::load(&a[0], 0), F::load(&a[1], 0), F::load(&a[2], 0));
    (vector(&normal), vector(&point))
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
    let (point, normal, error) = others;
    let ids = primitive.to_array();
    let mut p = [point.x.to_array(), point.y.to_array(), point.z.to_array()];
    let mut n = [normal.x.to_array(), normal.y.to_array(), normal.z.to_array()];
    let mut e = error.to_array();
    let r = [raw.x.to_array(), raw.y.to_array(), raw.z.to_array()];
    for i in (0..F::LANES).filter(|i| lanes.bits() >> i & 1 == 1) {
        let quadric = &geometry.quadrics()[(ids[i] - geometry.first_quadric()) as usize];
        let (point, normal, error) = quadric.surface([r[0][i], r[1][i], r[2][i]]);
        for axis in 0..3 {
            p[axis][i] = point[axis];
            n[axis][i] = normal[axis];
        }
        e[i] = error;
    }
    let vector = |a: &[[f32; 16]; 3]| Vec3::new(F::load(&a[0], 0), F::load(&a[1], 0), F::load(&a[2], 0));
    (vector(&p), vector(&n), F::load(&e, 0))
}
