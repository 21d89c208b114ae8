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
    /// Origin and direction as they are.
    pub ray: ([f32; 3], [f32; 3]),
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
            ray: (origin, direction),
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

/// The planes of the triangles of all lanes, looked up where a ray's line goes through the triangle.
pub trait Planes<F: Real> {
    /// Distances at which the rays of some lanes meet the planes, and the lanes that do so in (0, t_max].
    fn meet(&self, lanes: F::Mask, between: Between<F, F::Mask>, t_max: F) -> (F, F::Mask);
}

/// The distances of a triangle's corners, between which it is met.
#[derive(Clone, Copy)]
pub struct Between<F, M> {
    /// The nearest corner.
    pub least: F,
    /// The farthest corner.
    pub most: F,
    /// All corners are in front, for certain, and so is what is between them.
    pub in_front: M,
}

impl<F: Real> Between<F, F::Mask> {
    /// The nearest point of this range, and whether it counts: in front.
    #[inline(always)]
    fn clamp(&self, distance: F) -> (F, F::Mask) {
        let t = distance.max(self.least).min(self.most);
        (t, (distance.gt(F::zero()) | self.in_front) & t.gt(F::zero()))
    }
}

/// The plane of a triangle, as [`crate::scene::Geometry::surfaces`] has it: unit normal, and its product with the points of
/// the plane.
#[inline(always)]
fn plane(surfaces: &[f32], primitive: u32) -> [f32; 4] {
    let row = &surfaces[primitive as usize * 4..][..4];
    [row[0], row[1], row[2], row[3]]
}

/// Heights of rays' origins over planes, and what single precision tells from them.
#[derive(Clone, Copy)]
struct Heights<F: Real> {
    /// Height over the plane, and how much of it a unit of the ray gains.
    height: F,
    speed: F,
    /// The signs of both are certain, and the distance is off by little more than what rounding the origin does to it.
    certain: F::Mask,
    /// The plane is behind, for certain: most rays start on the triangle and leave it.
    behind: F::Mask,
}

impl<F: Real> Heights<F> {
    #[inline(always)]
    fn new(plane: [F; 4], origin: [F; 3], direction: [F; 3]) -> Self {
        let ([nx, ny, nz, b], [ox, oy, oz], [dx, dy, dz]) = (plane, origin, direction);
        let (x, y, z) = (nx * ox, ny * oy, nz * oz);
        let height = (x + y) + (z - b);
        let speed = (nx * dx + ny * dy) + nz * dz;
        // Heights are off by little more than 3 roundings of their terms, speeds by less than 6 of 1.
        let terms = x.abs() + y.abs() + z.abs();
        let certain =
            height.abs().gt(terms * F::lit(4.0 * ROUNDING)) & speed.abs().gt(F::lit(6.0 * ROUNDING));
        Heights { height, speed, certain, behind: certain & height.xor_sign(speed).gt(F::zero()) }
    }

    #[inline(always)]
    fn distance(&self) -> F {
        -(self.height / self.speed)
    }
}

/// As [`Heights::distance`], in double precision, in which the products are exact.
#[inline(always)]
fn distance_in_double_precision(plane: [f32; 4], origin: [f32; 3], direction: [f32; 3]) -> f32 {
    let n = map3!([0, 1, 2], |k| plane[k] as f64);
    let height =
        n[0] * origin[0] as f64 + n[1] * origin[1] as f64 + n[2] * origin[2] as f64 - plane[3] as f64;
    let speed = n[0] * direction[0] as f64 + n[1] * direction[1] as f64 + n[2] * direction[2] as f64;
    // A plane along the ray is not met, whichever way rounding tells.
    if speed == 0.0 { 0.0 } else { -(height / speed) as f32 }
}

/// [`Planes::meet`], a lane at a time: `primitive` and `ray` of a lane.
#[inline(always)]
pub(super) fn meet_by_lanes<F: Real>(
    surfaces: &[f32],
    lanes: F::Mask,
    between: Between<F, F::Mask>,
    t_max: F,
    primitive: impl Fn(usize) -> u32,
    ray: impl Fn(usize) -> ([f32; 3], [f32; 3]),
) -> (F, F::Mask) {
    let (least, most, t_max) = (between.least.to_array(), between.most.to_array(), t_max.to_array());
    let in_front = between.in_front.bits();
    let (mut distances, mut met) = ([0.0; 16], 0);
    let mut left = lanes.bits();
    while left != 0 {
        let lane = left.trailing_zeros() as usize & 15;
        left &= left - 1;
        let (origin, direction) = ray(lane);
        let plane = plane(surfaces, primitive(lane));
        let in_front = in_front >> lane & 1 == 1;
        let heights = Heights::<f32>::new(plane, origin, direction);
        if heights.behind && !in_front {
            continue;
        }
        let distance = if heights.certain {
            heights.distance()
        } else {
            distance_in_double_precision(plane, origin, direction)
        };
        let (t, counts) = Between { least: least[lane], most: most[lane], in_front }.clamp(distance);
        distances[lane] = t;
        met |= ((counts && t <= t_max[lane]) as u32) << lane;
    }
    (F::load(&distances, 0), F::Mask::from_bits(met))
}

/// One ray, and some triangles, again and again.
#[derive(Clone, Copy)]
pub struct OneRay<'a> {
    /// [`crate::scene::Geometry::surfaces`].
    pub surfaces: &'a [f32],
    /// Triangles: a power of two of them, of which lane `i` has number `i` modulo how many there are.
    pub primitives: &'a [u32],
    /// Origin of the ray.
    pub origin: [f32; 3],
    /// Its direction.
    pub direction: [f32; 3],
}

impl<F: Real> Planes<F> for OneRay<'_> {
    #[inline(always)]
    fn meet(&self, lanes: F::Mask, between: Between<F, F::Mask>, t_max: F) -> (F, F::Mask) {
        let primitive = |lane: usize| self.primitives[lane & (self.primitives.len() - 1)];
        meet_by_lanes(self.surfaces, lanes, between, t_max, primitive, |_| (self.origin, self.direction))
    }
}

/// A ray a lane, and one triangle.
#[derive(Clone, Copy)]
pub struct OneTriangle<'a, F> {
    /// [`crate::scene::Geometry::surfaces`].
    pub surfaces: &'a [f32],
    /// The triangle.
    pub primitive: u32,
    /// Origins of the rays.
    pub origin: &'a [F; 3],
    /// Their directions.
    pub direction: &'a [F; 3],
}

impl<F: Real> OneTriangle<'_, F> {
    /// Lanes that single precision cannot tell.
    #[cold]
    #[inline(never)]
    fn in_double_precision(&self, lanes: F::Mask, between: Between<F, F::Mask>, t_max: F) -> (F, F::Mask) {
        let (origin, direction) = (self.origin.map(|x| x.to_array()), self.direction.map(|x| x.to_array()));
        let ray = |lane: usize| (origin.map(|x| x[lane]), direction.map(|x| x[lane]));
        meet_by_lanes(self.surfaces, lanes, between, t_max, |_| self.primitive, ray)
    }
}

impl<F: Real> Planes<F> for OneTriangle<'_, F> {
    #[inline(always)]
    fn meet(&self, lanes: F::Mask, between: Between<F, F::Mask>, t_max: F) -> (F, F::Mask) {
        let row = plane(self.surfaces, self.primitive);
        let plane = [F::splat(row[0]), F::splat(row[1]), F::splat(row[2]), F::splat(row[3])];
        let heights = Heights::new(plane, *self.origin, *self.direction);
        let lanes = lanes & (!heights.behind | between.in_front);
        if !lanes.any() {
            return (F::zero(), lanes);
        }
        let (t, counts) = between.clamp(heights.distance());
        let met = lanes & counts & t.le(t_max);
        let doubtful = lanes & !heights.certain;
        if !doubtful.any() {
            return (t, met);
        }
        let (double, too) = self.in_double_precision(doubtful, between, t_max);
        (F::select(doubtful, double, t), (met & heights.certain) | too)
    }
}

/// One ray against the triangles of all lanes. `corners[k][axis]` is the coordinate of corner `k`, axes in world
/// order; planes and numbers of the triangles as in [`OneRay`].
#[inline(always)]
pub fn intersect<F: Real>(
    ray: &ShearedRay,
    corners: &[[F; 3]; 3],
    surfaces: &[f32],
    primitives: &[u32],
    t_max: F,
) -> TriangleHits<F> {
    let permuted = map3!(*corners, |corner| map3!(ray.axes, |axis| corner[axis]));
    intersect_permuted(ray, permuted, surfaces, primitives, t_max)
}

/// As [`intersect`], with the coordinates in the order of the ray's axes: for callers that load them in this order. An
/// array that is indexed by what only the ray knows goes through memory.
#[inline(always)]
pub fn intersect_permuted<F: Real>(
    ray: &ShearedRay,
    corners: [[F; 3]; 3],
    surfaces: &[f32],
    primitives: &[u32],
    t_max: F,
) -> TriangleHits<F> {
    let [sx, sy, sz] = map3!(ray.shear, |x| F::splat(x));
    let [ox, oy, oz] = map3!(ray.origin, |x| F::splat(x));
    // Corners relative to the ray, sheared: the ray is the z axis.
    let sheared = map3!(corners, |corner| {
        let [x, y, z] = corner;
        let z = z - oz;
        [(x - ox) - sx * z, (y - oy) - sy * z, sz * z]
    });
    let (origin, direction) = ray.ray;
    intersect_sheared(sheared, OneRay { surfaces, primitives, origin, direction }, t_max)
}

/// Half of a unit in the last place of 1: the largest relative error of one rounding.
const ROUNDING: f64 = f32::EPSILON as f64 * 0.5;

/// The z axis against triangles whose corners are given in the ray's sheared coordinates.
///
/// Which triangles the line of the ray meets is decided by the signs of the edge functions. Where it meets them is decided by
/// their planes, whose distances are off by what the origin of the ray is, and which rays start off, too
/// ([`crate::shade::surface`]). Distances from the weights are off by the square of the triangle over the share of it that
/// the ray sees: of a large triangle around the origin of a ray they do not tell whether it is met in front or behind.
#[inline(always)]
pub fn intersect_sheared<F: Real>(corners: [[F; 3]; 3], planes: impl Planes<F>, t_max: F) -> TriangleHits<F> {
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
    // Not where it is no number either: distances to planes would be some.
    inside = inside & determinant.abs().gt(zero) & determinant.abs().le(F::lit(f32::MAX as f64));
    let nothing = TriangleHits { t: zero, u: zero, v: zero, hit: inside };
    if !inside.any() {
        return nothing;
    }
    let (least, most) = (az.min(bz).min(cz), az.max(bz).max(cz));
    // Corners are off by three roundings of their distance: in front by more than that is in front.
    let in_front = least.gt(most.max(-least) * F::lit(3.0 * ROUNDING));
    let (t, hit) = planes.meet(inside, Between { least, most, in_front }, t_max);
    if !hit.any() {
        return TriangleHits { hit, ..nothing };
    }
    let inverse = determinant.recip();
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
