//! Ray queries: each primitive against double precision, watertight meshes, and trees that agree with brute force to
//! the bit on every instruction set.

mod statistics;

use core::num::Wrapping;
use statistics::{Random, add, cross, dot, length, narrow, normalize, scale, sub, tangents, wide};
use wavepath_kernels::intersect::bvh2::NaiveBvh;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::triangle::ShearedRay;
use wavepath_kernels::intersect::{
    Accelerator, Hit, Intersect, Traversal, sphere, test_round, test_triangle, triangle,
};
use wavepath_kernels::isa::{Isa, Kernel, Level};
use wavepath_kernels::lanes::Real;
use wavepath_kernels::light_sample::LightSample;
use wavepath_kernels::math::Vec3;
use wavepath_kernels::queue::{HitQueue, PathQueue, Requirements, ShadowQueue, SlotTable};
use wavepath_kernels::scene::shapes::{Cylinder, Disk, Quadric, QuadricForm, SpherePart};
use wavepath_kernels::scene::{Geometry, GeometryParts, MISS};
use wavepath_kernels::shade::surface::Surface;

type Triangle = [[f32; 3]; 3];
type Ray = ([f32; 3], [f32; 3]);

const EPSILON: f64 = f32::EPSILON as f64;

/// Tables of some primitives, without materials.
fn geometry(triangles: &[Triangle], spheres: &[[f32; 4]], quadrics: &[Quadric]) -> Geometry {
    let mut g = GeometryParts {
        spheres: spheres.to_vec(),
        quadrics: quadrics.to_vec(),
        tags: vec![0; triangles.len() + spheres.len() + quadrics.len()],
        ..GeometryParts::default()
    };
    for corners in triangles {
        let first = g.vertices.len() as u32;
        g.vertices.extend(corners);
        g.triangles.push([first, first + 1, first + 2]);
        let [a, b, c] = corners.map(wide);
        let n = normalize(cross(sub(b, a), sub(c, a)));
        let [x, y, z] = narrow(n);
        g.planes.push([x, y, z, dot(n, a) as f32]);
    }
    Geometry::new(g).unwrap()
}

fn brute_force(g: &Geometry, (origin, direction): Ray, t_max: f32) -> Hit {
    let mut hit = Hit::none(t_max);
    let sheared = ShearedRay::new(origin, direction);
    for p in 0..g.primitives() as u32 {
        if p < g.first_sphere() {
            test_triangle(&g.corners(p as usize), p, &sheared, &mut hit);
        } else {
            test_round(g, p, origin, direction, &mut hit);
        }
    }
    hit
}

struct Closest<'a, A>(&'a A, &'a [Ray]);
impl<A: Accelerator> Kernel for Closest<'_, A> {
    type Output = Vec<Hit>;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> Vec<Hit> {
        let mut stack = self.0.stack();
        self.1.iter().map(|&(o, d)| self.0.closest(isa, o, d, &mut stack)).collect()
    }
}

struct Occluded<'a, A>(&'a A, &'a [(Ray, f32)]);
impl<A: Accelerator> Kernel for Occluded<'_, A> {
    type Output = Vec<bool>;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> Vec<bool> {
        let mut stack = self.0.stack();
        self.1.iter().map(|&((o, d), t)| self.0.occluded(isa, o, d, t, &mut stack)).collect()
    }
}

/// All instruction sets, and the one for comparisons.
fn levels() -> impl Iterator<Item = Level> {
    Level::available().chain(Level::one_lane())
}

/// The ways through a tree, for rays in queues.
const TRAVERSALS: [Traversal; 4] =
    [Traversal::Packets, Traversal::Single, Traversal::Sorted, Traversal::Interleaved];

fn requirements() -> Requirements {
    Requirements { smooth_normals: true, light_sampling: true, ..Requirements::default() }
}

/// Closest hits of rays in a queue.
fn traced(level: Level, tree: &Bvh8, rays: &[Ray], traversal: Traversal) -> Vec<Hit> {
    let n = rays.len();
    let (mut paths, mut hits) = (PathQueue::new(n, requirements()), HitQueue::new(n, requirements()));
    for (i, (o, d)) in rays.iter().enumerate() {
        [paths.origin_x[i], paths.origin_y[i], paths.origin_z[i]] = *o;
        [paths.direction_x[i], paths.direction_y[i], paths.direction_z[i]] = *d;
    }
    paths.len = n;
    let mut stack = tree.stack();
    // In two pieces, which begin anywhere.
    for range in [0..n / 3, n / 3..n] {
        level.run(Intersect {
            accelerator: tree,
            traversal,
            paths: &paths,
            range,
            hits: &mut hits,
            stack: &mut stack,
            order: &mut vec![0; n],
        });
    }
    (0..n).map(|i| Hit { t: hits.t[i], primitive: hits.primitive[i], u: hits.u[i], v: hits.v[i] }).collect()
}

/// Whether rays in a queue meet anything within their distance.
fn in_the_way(level: Level, tree: &Bvh8, rays: &[(Ray, f32)], traversal: Traversal) -> Vec<bool> {
    let n = rays.len();
    let (mut shadows, mut slots) = (ShadowQueue::new(n, requirements()), SlotTable::new(n, requirements()));
    for (i, ((o, d), distance)) in rays.iter().enumerate() {
        [shadows.origin_x[i], shadows.origin_y[i], shadows.origin_z[i]] = *o;
        [shadows.direction_x[i], shadows.direction_y[i], shadows.direction_z[i]] = *d;
        (shadows.distance[i], shadows.radiance_r[i], shadows.slot[i]) = (*distance, 1.0, i as u32);
    }
    shadows.len = n;
    let mut stack = tree.stack();
    let (accelerator, range) = (tree, 0..n);
    level.run(LightSample {
        accelerator,
        traversal,
        shadows: &shadows,
        range,
        slots: &mut slots,
        stack: &mut stack,
    });
    slots.radiance_r[..n].iter().map(|&r| r == 0.0).collect()
}

/// Both trees on all instruction sets find what brute force finds: primitive, bits of t, u, v; and say rightly whether
/// anything is nearer than some distance. So do rays in queues, whatever way they go through the wide tree. Returns the
/// hits.
fn assert_trees_agree(what: &str, g: &Geometry, rays: &[Ray]) -> Vec<Hit> {
    let (naive, wide) = (NaiveBvh::new(g), Bvh8::new(g));
    let want: Vec<Hit> = rays.iter().map(|&r| brute_force(g, r, f32::INFINITY)).collect();
    // Just at the hit, just before it, half-way, and any distance.
    let mut shadows = Vec::new();
    for (&ray, hit) in rays.iter().zip(&want) {
        if hit.primitive != MISS {
            shadows.extend([hit.t, hit.t.next_down(), 0.5 * hit.t].map(|t| (ray, t)));
        }
        shadows.push((ray, f32::INFINITY));
    }
    let blocked: Vec<bool> = shadows
        .iter()
        .enumerate()
        .map(|(i, &(ray, t))| match t {
            f32::INFINITY => {
                i > 0 && shadows[i - 1].0 == ray && shadows[i - 1].1 > 0.0
                    || brute_force(g, ray, t).primitive != MISS
            }
            t => brute_force(g, ray, t).primitive != MISS,
        })
        .collect();
    for level in levels() {
        let mut results = vec![
            (NaiveBvh::NAME.into(), level.run(Closest(&naive, rays)), level.run(Occluded(&naive, &shadows))),
            (Bvh8::NAME.into(), level.run(Closest(&wide, rays)), level.run(Occluded(&wide, &shadows))),
        ];
        results.extend(TRAVERSALS.map(|way| {
            (format!("{way:?}"), traced(level, &wide, rays, way), in_the_way(level, &wide, &shadows, way))
        }));
        for (name, got, any) in results {
            let what = format!("{what}, {name}, {}", level.name());
            for ((ray, got), want) in rays.iter().zip(&got).zip(&want) {
                assert_eq!(got, want, "{what}: {ray:?}");
            }
            for ((shadow, got), want) in shadows.iter().zip(&any).zip(&blocked) {
                assert_eq!(got, want, "{what}: any hit of {shadow:?}");
            }
        }
    }
    want
}

fn ray(origin: [f64; 3], towards: [f64; 3]) -> Ray {
    let origin = narrow(origin);
    (origin, narrow(normalize(sub(towards, wide(origin)))))
}

fn random_triangle(random: &mut Random, half: f64, size: f64) -> Triangle {
    let centre = random.point(half);
    [(); 3].map(|_| narrow(add(centre, random.point(size))))
}

fn inside(random: &mut Random, corners: &Triangle) -> [f64; 3] {
    let [a, b, c] = corners.map(wide);
    let (mut u, mut v) = (random.unit(), random.unit());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    add(a, add(scale(sub(b, a), u), scale(sub(c, a), v)))
}

// ---------------------------------------------------------------------------------------------------- primitives

/// Single precision and its lanes against double-precision geometry: whether it hits, wherever that can be told, and
/// the distance.
fn assert_triangle(what: &str, corners: &Triangle, ray: Ray) {
    let hit = triangle::intersect::<f32>(&ShearedRay::new(ray.0, ray.1), &corners.map(|c| c), f32::INFINITY);
    let [a, b, c] = corners.map(|c| sub(wide(c), wide(ray.0)));
    let d = wide(ray.1);
    // Signed volumes of the ray with each edge, over the length of the edge: distances of the ray from the edges.
    let edge = |p: [f64; 3], q: [f64; 3]| dot(d, cross(p, q)) / length(cross(d, sub(q, p))).max(1e-300);
    let edges = [edge(a, b), edge(b, c), edge(c, a)];
    let n = cross(sub(b, a), sub(c, a));
    let t = dot(n, a) / dot(n, d);
    let largest = [a, b, c].iter().map(|&p| length(p)).fold(0.0, f64::max);
    // Corners relative to the origin, sheared: a few roundings of their size each.
    let blur = 3.0 * EPSILON * largest;
    let (least, most) =
        (edges.into_iter().fold(f64::INFINITY, f64::min), edges.into_iter().fold(-f64::INFINITY, f64::max));
    let clearly_in = (least > blur || most < -blur) && t > 0.0;
    let clearly_out = least < -blur && most > blur || t < -1e-3 * largest;
    let cos = (dot(n, d) / length(n)).abs();
    let spread = [a, b, c].iter().map(|&p| dot(p, d)).fold(0.0, |s: f64, z| s.max((z - t).abs()));
    // Sliding off by the blur moves the distance by its tangent, but not out of the triangle. The weights are quotients
    // of areas, whose rounding is relative to the squared reach of the corners around the ray: slivers feel it.
    let reach = [a, b, c].iter().map(|&p| length(cross(p, d))).fold(0.0, f64::max);
    let weight_error = 12.0 * (EPSILON * reach + blur) * reach / dot(n, d).abs();
    let t_error = (4.0 * blur / cos + weight_error * spread).min(spread) + 4.0 * EPSILON * largest;
    if clearly_in && t > t_error {
        assert!(hit.hit, "{what}: lost {corners:?} {ray:?} at {t}, edges {edges:?}");
    }
    if clearly_out {
        assert!(!hit.hit, "{what}: imagined {corners:?} {ray:?} at {t}, edges {edges:?}");
    }
    if hit.hit && clearly_in {
        assert!(
            (hit.t as f64 - t).abs() <= t_error,
            "{what}: {} not {t} ({t_error}) {corners:?} {ray:?}",
            hit.t
        );
    }
    if hit.hit {
        let (u, v) = (hit.u, hit.v);
        assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6, "{what}: weights {u} {v}");
    }
}

#[test]
fn triangles_near_and_far_large_and_small() {
    let mut random = Random::new(1);
    for (name, distance, size) in [
        ("near", 3.0, 1.0),
        ("tiny", 3e-5, 1e-5),
        ("huge", 3e5, 1e5),
        ("far", 1e4, 1.0),
        ("very far", 3e5, 1.0),
        ("small and far", 1e3, 1e-2),
        ("around the origin", 0.1, 1.0),
    ] {
        for _ in 0..20_000 {
            let corners = random_triangle(&mut random, 0.0, size);
            let from = scale(random.direction(), distance);
            let target =
                if random.unit() < 0.7 { inside(&mut random, &corners) } else { random.point(2.0 * size) };
            assert_triangle(name, &corners, ray(from, target));
        }
    }
}

#[test]
fn triangles_at_grazing_angles_and_slivers() {
    let mut random = Random::new(2);
    for _ in 0..50_000 {
        let mut corners = random_triangle(&mut random, 0.0, 1.0);
        let flat = random.magnitude(1e-4, 1.0) as f32;
        corners.iter_mut().for_each(|c| c[2] *= flat);
        let from = [random.between(-10.0, 10.0), random.between(-10.0, 10.0), random.magnitude(1e-3, 1.0)];
        assert_triangle("grazing", &corners, ray(from, inside(&mut random, &corners)));
        let mut sliver = random_triangle(&mut random, 0.0, 1.0);
        let width = random.magnitude(1e-4, 1.0) as f32;
        sliver[2] = core::array::from_fn(|k| sliver[1][k] + width * (sliver[2][k] - sliver[1][k]));
        assert_triangle("sliver", &sliver, ray(random.point(5.0), inside(&mut random, &sliver)));
    }
}

#[test]
fn triangles_and_rays_along_axes() {
    let mut random = Random::new(3);
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            for _ in 0..3_000 {
                let corners = random_triangle(&mut random, 0.0, 1.0);
                let mut direction = [0.0; 3];
                direction[axis] = sign;
                let target = inside(&mut random, &corners);
                let mut origin = narrow(target);
                origin[axis] = -3.0 * sign;
                assert_triangle("along an axis", &corners, (origin, direction));
            }
        }
    }
}

#[test]
fn wide_triangles_equal_one() {
    struct Compare;
    impl Kernel for Compare {
        type Output = ();
        #[inline(always)]
        fn run<I: Isa>(self, _: I) {
            compare::<I::Four>();
            compare::<I::Wide>();
        }
    }
    #[inline(always)]
    fn compare<F: Real>() {
        let mut random = Random::new(4);
        for _ in 0..3_000 {
            let triangles: [Triangle; 16] = core::array::from_fn(|_| random_triangle(&mut random, 0.2, 1.0));
            let target = inside(&mut random, &triangles[0]);
            // Every third ray through a corner, which all the coincident edges share.
            let target = if random.below(3) == 0 { wide(triangles[0][1]) } else { target };
            let ray = ray(random.point(3.0), target);
            let sheared = ShearedRay::new(ray.0, ray.1);
            let corners = [0, 1, 2].map(|k| {
                [0, 1, 2]
                    .map(|axis| F::load(&core::array::from_fn::<f32, 16, _>(|i| triangles[i][k][axis]), 0))
            });
            let many = triangle::intersect::<F>(&sheared, &corners, F::splat(4.0));
            use wavepath_kernels::lanes::Mask;
            for (i, corners) in triangles.iter().enumerate().take(F::LANES) {
                let one = triangle::intersect::<f32>(&sheared, corners, 4.0);
                assert_eq!(many.hit.bits() >> i & 1 == 1, one.hit);
                if one.hit {
                    let lane = |x: F| x.to_array()[i];
                    assert_eq!([lane(many.t), lane(many.u), lane(many.v)], [one.t, one.u, one.v]);
                }
            }
        }
    }
    Level::available().for_each(|level| level.run(Compare));
}

#[test]
fn spheres_near_and_far_large_and_small() {
    let mut random = Random::new(5);
    for (ratio_low, ratio_high) in [(1.001, 10.0), (10.0, 1e3), (1e3, 1e6), (0.01, 0.999)] {
        for _ in 0..30_000 {
            let r = random.magnitude(1e-5, 1e5) as f32;
            let centre = narrow(scale(random.direction(), r as f64 * random.magnitude(0.1, 1e3)));
            let distance = r as f64 * random.magnitude(ratio_low, ratio_high);
            let from = add(wide(centre), scale(random.direction(), distance));
            let target = add(wide(centre), scale(random.direction(), 1.2 * r as f64 * random.unit()));
            let ray = ray(from, target);
            let (t, hit) = sphere::intersect::<f32>(ray.0, ray.1, centre, -r, f32::INFINITY);
            let (f, d, r) = (sub(wide(ray.0), wide(centre)), wide(ray.1), r as f64);
            let s = -dot(f, d) / dot(d, d);
            let miss = length(add(f, scale(d, s)));
            // The vector to the centre is rounded in each coordinate, and so is the closest approach.
            let blur = 4.0 * EPSILON * length(f);
            let inside = length(f) < r;
            if miss > r + blur || s < 0.0 && !inside {
                assert!(!hit, "imagined: {ray:?} {centre:?} {r}");
            } else if miss < r - blur {
                assert!(hit, "lost: {ray:?} {centre:?} {r}");
                let half = (r * r - miss * miss).sqrt() / length(d);
                let want = if inside { s + half } else { s - half };
                let error = 2.0 * blur * r / half + 4.0 * EPSILON * (want.abs() + r);
                assert!(
                    (t as f64 - want).abs() <= error,
                    "{t}, not {want} ({error}): {ray:?} {centre:?} {r}"
                );
            }
        }
    }
}

fn quadric(form: QuadricForm, columns: [[f64; 3]; 3], centre: [f64; 3]) -> Quadric {
    let world = glam::DAffine3 {
        matrix3: glam::DMat3::from_cols_array_2d(&columns),
        translation: glam::DVec3::from_array(centre),
    };
    Quadric::new(form, &world, false).unwrap()
}

/// World to object space as quadrics keep it, three rows of four.
fn object_from_world(columns: [[f64; 3]; 3], centre: [f64; 3]) -> [[f64; 4]; 3] {
    let inverse = glam::DAffine3 {
        matrix3: glam::DMat3::from_cols_array_2d(&columns),
        translation: glam::DVec3::from_array(centre),
    }
    .inverse();
    let at = |r: usize, c: usize| if c < 3 { inverse.matrix3.col(c)[r] } else { inverse.translation[r] };
    core::array::from_fn(|r| core::array::from_fn(|c| at(r, c) as f32 as f64))
}

#[test]
fn quadrics_are_what_they_say() {
    let mut random = Random::new(6);
    let forms = [
        QuadricForm::Sphere(SpherePart { radius: 1.0, z_min: -1.0, z_max: 1.0, phi_max: 7.0 }),
        QuadricForm::Sphere(SpherePart { radius: 2.0, z_min: -0.5, z_max: 1.5, phi_max: 7.0 }),
        QuadricForm::Sphere(SpherePart { radius: 1.5, z_min: -1.5, z_max: 1.5, phi_max: 2.0 }),
        QuadricForm::Disk(Disk { height: 0.5, radius: 1.0, inner_radius: 0.0, phi_max: 7.0 }),
        QuadricForm::Disk(Disk { height: -0.3, radius: 2.0, inner_radius: 1.0, phi_max: 4.0 }),
        QuadricForm::Cylinder(Cylinder { radius: 1.0, z_min: -1.0, z_max: 1.5, phi_max: 7.0 }),
        QuadricForm::Cylinder(Cylinder { radius: 0.7, z_min: 0.5, z_max: 2.0, phi_max: 4.5 }),
    ];
    let (mut hits, mut misses) = (0, 0);
    for round in 0..40_000 {
        let form = forms[round % forms.len()];
        let n = random.direction();
        let [s, t] = tangents(n);
        let stretch = [0; 3].map(|_| random.magnitude(0.3, 3.0));
        let centre = random.point(5.0);
        let columns = [scale(s, stretch[0]), scale(t, stretch[1]), scale(n, stretch[2])];
        let q = quadric(form, columns, centre);
        let ray = ray(random.point(12.0), add(centre, random.point(2.0)));
        // March along the ray in object space: the first place where the implicit function changes sign on the
        // part that is left.
        let m = object_from_world(columns, centre);
        let object = |p: [f64; 3], w: f64| -> [f64; 3] {
            core::array::from_fn(|i| m[i][0] * p[0] + m[i][1] * p[1] + m[i][2] * p[2] + w * m[i][3])
        };
        let (o, d) = (object(wide(ray.0), 1.0), object(wide(ray.1), 0.0));
        let at = |t: f64| add(o, scale(d, t));
        let azimuth = |p: [f64; 3]| p[1].atan2(p[0]).rem_euclid(core::f64::consts::TAU);
        let value = |t: f64| match form {
            QuadricForm::Sphere(sphere) => length(at(t)) - sphere.radius as f64,
            QuadricForm::Disk(disk) => at(t)[2] - disk.height as f64,
            QuadricForm::Cylinder(cylinder) => at(t)[0].hypot(at(t)[1]) - cylinder.radius as f64,
        };
        // Signed distance from the edges of the clipped part: positive inside.
        let part = |p: [f64; 3]| match form {
            QuadricForm::Sphere(SpherePart { radius, z_min, z_max, phi_max }) => {
                let unclipped = z_min <= -radius && z_max >= radius;
                let z = if unclipped { 1.0 } else { (p[2] - z_min as f64).min(z_max as f64 - p[2]) };
                z.min(phi_max as f64 - azimuth(p))
            }
            QuadricForm::Disk(Disk { radius, inner_radius, phi_max, .. }) => {
                let r = p[0].hypot(p[1]);
                let inner = if inner_radius > 0.0 { r - inner_radius as f64 } else { 1.0 };
                (radius as f64 - r).min(inner).min(phi_max as f64 - azimuth(p))
            }
            QuadricForm::Cylinder(Cylinder { z_min, z_max, phi_max, .. }) => {
                (p[2] - z_min as f64).min(z_max as f64 - p[2]).min(phi_max as f64 - azimuth(p))
            }
        };
        const STEPS: usize = 4000;
        let (step, mut want, mut doubtful) = (60.0 / STEPS as f64, None, false);
        let mut before = value(0.0);
        for k in 1..=STEPS {
            let now = value(k as f64 * step);
            if (before < 0.0) != (now < 0.0) {
                let (mut low, mut high) = ((k - 1) as f64 * step, k as f64 * step);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if (value(middle) < 0.0) == (before < 0.0) { low = middle } else { high = middle }
                }
                let edge = part(at(low));
                doubtful |= edge.abs() < 1e-4;
                if edge > 0.0 && want.is_none() {
                    want = Some(low);
                }
            }
            before = now;
        }
        // Grazing rays that cross twice within a step.
        let flat = |p: [f64; 3]| [p[0], p[1], 0.0];
        let closest = match form {
            QuadricForm::Sphere(sphere) => Some((length(at(-dot(o, d) / dot(d, d))), sphere.radius)),
            QuadricForm::Cylinder(cylinder) => {
                let nearest = at(-dot(flat(o), flat(d)) / dot(flat(d), flat(d)));
                Some((length(flat(nearest)), cylinder.radius))
            }
            QuadricForm::Disk(_) => None,
        };
        if let Some((closest, radius)) = closest {
            doubtful |= (closest - radius as f64).abs() < 0.02 * radius as f64;
        }
        if doubtful {
            continue;
        }
        match (q.intersect(ray.0, ray.1, f32::INFINITY), want) {
            (Some(got), Some(want)) => {
                hits += 1;
                assert!((got as f64 - want).abs() < 1e-6 * want.max(1.0), "{form:?}: {got}, not {want}");
                assert_eq!(q.intersect(ray.0, ray.1, got), Some(got));
                assert!(q.intersect(ray.0, ray.1, 0.99 * got).is_none());
                let hit = narrow(add(wide(ray.0), scale(wide(ray.1), got as f64)));
                let (point, normal, _) = q.surface(hit);
                assert!((length(wide(normal)) - 1.0).abs() < 1e-6);
                assert!(length(sub(wide(point), wide(hit))) < 1e-5 * want.max(5.0));
            }
            (None, None) => misses += 1,
            other => panic!("{form:?}: {other:?}, edge {:?}", want.map(|t| part(at(t)))),
        }
    }
    assert!(hits > 5_000 && misses > 5_000, "{hits} hits, {misses} misses");
}

fn surface(g: &Geometry, primitive: u32, (o, d): Ray, t: f32) -> Surface<f32> {
    let v = |a: [f32; 3]| Vec3::new(a[0], a[1], a[2]);
    // SAFETY: the primitive is one of the geometry's.
    unsafe { Surface::new(g, Wrapping(primitive), v(o), v(d), t, || (0.0, 0.0)) }
}

#[test]
fn rays_that_leave_a_surface_do_not_meet_it_again() {
    let mut random = Random::new(7);
    let v = |a: [f32; 3]| Vec3::new(a[0], a[1], a[2]);
    let mut leaving = 0;
    for _ in 0..60_000 {
        let size = random.magnitude(1e-4, 1e4);
        let half = size * random.magnitude(1e-2, 1e2);
        let triangle = random_triangle(&mut random, half, size);
        let centre = random.point(half);
        let sphere = [centre[0] as f32, centre[1] as f32, centre[2] as f32, size as f32];
        let n = random.direction();
        let [s, t] = tangents(n);
        let disk = quadric(
            QuadricForm::Disk(Disk { height: 0.0, radius: 1.0, inner_radius: 0.0, phi_max: 7.0 }),
            [s, t, n].map(|a| scale(a, size)),
            centre,
        );
        let ball = quadric(
            QuadricForm::Sphere(SpherePart { radius: 1.0, z_min: -1.0, z_max: 0.5, phi_max: 7.0 }),
            [s, t, scale(n, 0.5)].map(|a| scale(a, size)),
            centre,
        );
        let tube = quadric(
            QuadricForm::Cylinder(Cylinder { radius: 1.0, z_min: -1.0, z_max: 0.5, phi_max: 7.0 }),
            [s, t, scale(n, 0.5)].map(|a| scale(a, size)),
            centre,
        );
        let g = geometry(&[triangle], &[sphere], &[disk, ball, tube]);
        for primitive in 0..5u32 {
            let target = match primitive {
                0 => inside(&mut random, &triangle),
                1 => add(centre, scale(random.direction(), size)),
                2 => add(
                    centre,
                    add(scale(s, 0.5 * size * random.unit()), scale(t, 0.5 * size * random.unit())),
                ),
                _ => add(centre, scale(random.direction(), size)),
            };
            let from = add(target, scale(random.direction(), size * random.magnitude(1e-3, 1e2)));
            let ray = ray(from, target);
            let mut hit = Hit::none(f32::INFINITY);
            let query = |origin: [f32; 3], direction: [f32; 3], hit: &mut Hit| match primitive {
                0 => test_triangle(&triangle, 0, &ShearedRay::new(origin, direction), hit),
                p => test_round(&g, p, origin, direction, hit),
            };
            query(ray.0, ray.1, &mut hit);
            if hit.primitive == MISS {
                continue;
            }
            let point = surface(&g, primitive, ray, hit.t);
            let normal = wide(point.normal.lane(0));
            for _ in 0..4 {
                // Any direction, and grazing ones; what counts is the side of the normal on which it leaves.
                let mut direction = random.direction();
                if random.unit() < 0.5 {
                    let tangential = sub(direction, scale(normal, dot(direction, normal)));
                    let lift = random.magnitude(1e-6, 1e-1) * if random.unit() < 0.5 { 1.0 } else { -1.0 };
                    direction = add(normalize(tangential), scale(normal, lift));
                }
                let direction = narrow(normalize(direction));
                let origin = point.leave(v(direction)).lane(0);
                let mut again = Hit::none(f32::INFINITY);
                query(origin, direction, &mut again);
                leaving += 1;
                let cos = dot(wide(direction), normal);
                if primitive == 1 && cos < 0.0 {
                    // Through the ball: the other side, and nothing nearer.
                    let chord = -2.0 * size * cos;
                    let extent = centre.iter().fold(size, |a, x| a.max(x.abs()));
                    let blur = 64.0 * EPSILON * extent;
                    if chord * chord > 100.0 * blur * size {
                        assert_eq!(
                            again.primitive, 1,
                            "lost the far side: {sphere:?} {origin:?} {direction:?}"
                        );
                        assert!(
                            (again.t as f64 / chord - 1.0).abs() < 0.3,
                            "{} for a chord of {chord}",
                            again.t
                        );
                    }
                } else if primitive >= 3 && cos < 0.0 {
                    // The far side of a dented ball or a tube, or nothing where it is cut off; but not the place it left.
                    if cos < -1e-2 && again.primitive != MISS {
                        assert!(
                            again.t as f64 > 1e-4 * size,
                            "{} after leaving {:?}",
                            again.t,
                            g.quadrics()[primitive as usize - 2]
                        );
                    }
                } else {
                    assert_eq!(
                        again.primitive, MISS,
                        "primitive {primitive} met again at {}: {g:?} {origin:?} {direction:?}, cos {cos}",
                        again.t
                    );
                }
            }
        }
    }
    assert!(leaving > 100_000);
}

// ------------------------------------------------------------------------------------------------------- meshes

/// A closed mesh: an octahedron, each face split into four `levels` times, on the unit sphere.
fn ball(levels: u32) -> Vec<[[f64; 3]; 3]> {
    let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let minus = |a: [f64; 3]| scale(a, -1.0);
    let mut faces = Vec::new();
    for (a, b) in [(x, y), (y, minus(x)), (minus(x), minus(y)), (minus(y), x)] {
        faces.push([a, b, z]);
        faces.push([b, a, minus(z)]);
    }
    for _ in 0..levels {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc, ca) = (normalize(add(a, b)), normalize(add(b, c)), normalize(add(c, a)));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    faces
}

#[test]
fn closed_meshes_do_not_leak() {
    let mut random = Random::new(8);
    for (size, offset) in [(1.0, 0.0), (1e-5, 0.0), (1e5, 0.0), (1.0, 1e3), (1e-5, 1.0), (1e-3, 10.0)] {
        // The same vertex has the same bits in all its faces; turned, so that nothing lies along an axis.
        let turn = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
        let centre = [offset, -0.7 * offset, 0.3 * offset];
        let place = |p: [f64; 3]| add(centre, scale(turn.map(|row| dot(row, p)), size));
        let triangles: Vec<Triangle> =
            ball(3).iter().map(|face| face.map(|corner| narrow(place(corner)))).collect();
        let g = geometry(&triangles, &[], &[]);
        let mut rays = Vec::new();
        for _ in 0..6_000 {
            let from = place(random.point(0.4));
            let [a, b, c] = triangles[random.below(triangles.len())].map(wide);
            let along = random.unit();
            let target = match random.below(4) {
                0 => a,
                1 => add(a, scale(sub(b, a), along)),
                2 => scale(add(b, c), 0.5),
                _ => inside(&mut random, &triangles[0]),
            };
            rays.push(ray(from, target));
        }
        let what = format!("ball of size {size} at {offset}");
        let hits = assert_trees_agree(&what, &g, &rays);
        for (hit, ray) in hits.iter().zip(&rays) {
            assert_ne!(hit.primitive, MISS, "{what}: leaked {ray:?}");
        }
        // From outside, near and far: whatever goes through the middle is stopped.
        for distance in [1.5, 30.0, 1e3, 1e5] {
            let rays: Vec<Ray> = (0..500)
                .map(|_| {
                    let from = add(centre, scale(random.direction(), distance * size));
                    let [a, b, _] = triangles[random.below(triangles.len())].map(wide);
                    let middle = add(a, scale(sub(b, a), random.unit()));
                    ray(from, add(centre, scale(sub(middle, centre), 0.5)))
                })
                .collect();
            let what = format!("{what}, from {distance}");
            for (hit, ray) in assert_trees_agree(&what, &g, &rays).iter().zip(&rays) {
                assert_ne!(hit.primitive, MISS, "{what}: leaked {ray:?}");
            }
        }
    }
}

#[test]
fn fans_do_not_leak_at_their_hub() {
    let mut random = Random::new(9);
    for size in [1.0, 1e-5, 1e5] {
        for blades in [3, 4, 7, 64, 1000] {
            let hub = random.point(size);
            let rim: Vec<[f64; 3]> = (0..blades)
                .map(|i| {
                    let (sin, cos) = (core::f64::consts::TAU * i as f64 / blades as f64).sin_cos();
                    add(hub, scale([cos, sin, random.between(-0.3, 0.3)], size))
                })
                .collect();
            let triangles: Vec<Triangle> =
                (0..blades).map(|i| [hub, rim[i], rim[(i + 1) % blades]].map(narrow)).collect();
            let g = geometry(&triangles, &[], &[]);
            let rays: Vec<Ray> = (0..1_000)
                .map(|i| {
                    let sideways = random.point(0.5 * size);
                    let from = add(hub, [sideways[0], sideways[1], random.between(1.0, 20.0) * size]);
                    // The hub as single precision has it, points on spokes, and points close to the hub.
                    let spoke = sub(wide(triangles[random.below(blades)][1]), wide(narrow(hub)));
                    let on = scale(spoke, random.magnitude(1e-6, 0.9));
                    ray(from, if i % 3 == 0 { wide(narrow(hub)) } else { add(wide(narrow(hub)), on) })
                })
                .collect();
            let what = format!("fan of {blades}, size {size}");
            for (hit, ray) in assert_trees_agree(&what, &g, &rays).iter().zip(&rays) {
                assert_ne!(hit.primitive, MISS, "{what}: leaked {ray:?}");
            }
        }
    }
}

#[test]
fn grids_do_not_leak_along_their_lines() {
    // Axis-parallel rays onto the vertices and edges of an axis-parallel grid: every test is a tie.
    let n = 12;
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let p = |a: i32, b: i32| [a as f32 - 6.0, b as f32 - 6.0, 0.0];
            triangles.push([p(i, j), p(i + 1, j), p(i + 1, j + 1)]);
            triangles.push([p(i, j), p(i + 1, j + 1), p(i, j + 1)]);
        }
    }
    let turned: Vec<Triangle> = triangles.iter().map(|t| t.map(|[x, y, z]| [z, x, y])).collect();
    for (what, triangles, axis) in [("flat", triangles, 2), ("upright", turned, 0)] {
        let g = geometry(&triangles, &[], &[]);
        let mut rays = Vec::new();
        for i in -23..=23 {
            for j in -23..=23 {
                for sign in [-1.0f32, 1.0] {
                    let (a, b) = (i as f32 * 0.25, j as f32 * 0.25);
                    let (mut o, mut d) = ([0.0; 3], [0.0; 3]);
                    (o[(axis + 1) % 3], o[(axis + 2) % 3], o[axis]) = (a, b, -1e4 * sign);
                    d[axis] = sign;
                    rays.push((o, d));
                }
            }
        }
        for (hit, ray) in assert_trees_agree(what, &g, &rays).iter().zip(&rays) {
            assert_ne!(hit.primitive, MISS, "{what}: leaked {ray:?}");
            assert_eq!(hit.t, 1e4);
        }
    }
}

#[test]
fn thin_boxes_far_away_are_met_along_axes() {
    let mut random = Random::new(10);
    for axis in 0..3 {
        let mut triangles = Vec::new();
        let mut rays = Vec::new();
        for i in 0..200 {
            let thickness = 1e-3;
            let low: [f64; 3] =
                core::array::from_fn(|k| if k == axis { 1e4 } else { 3.0 * ((i * (k + 2)) % 29) as f64 });
            let high: [f64; 3] = core::array::from_fn(|k| low[k] + if k == axis { 2.0 } else { thickness });
            let corner = |bits: usize| {
                narrow(core::array::from_fn(|k| if bits >> k & 1 == 0 { low[k] } else { high[k] }))
            };
            for side in 0..3 {
                let (p, q, r) = (1 << side, 1 << ((side + 1) % 3), 1 << ((side + 2) % 3));
                for base in [0, p] {
                    triangles.push([corner(base), corner(base + q), corner(base + q + r)]);
                    triangles.push([corner(base), corner(base + q + r), corner(base + r)]);
                }
            }
            let mut origin = narrow(core::array::from_fn(|k| low[k] + thickness * random.between(0.2, 0.8)));
            let mut direction = [0.0; 3];
            (origin[axis], direction[axis]) = (0.0, 1.0);
            rays.push((origin, direction));
        }
        let g = geometry(&triangles, &[], &[]);
        for (hit, ray) in assert_trees_agree("thin boxes", &g, &rays).iter().zip(&rays) {
            assert!(hit.primitive != MISS && (hit.t - 1e4).abs() < 3e-3, "axis {axis}: {ray:?} met {hit:?}");
        }
    }
}

// -------------------------------------------------------------------------------------------------------- trees

fn random_rays(random: &mut Random, n: usize, half: f64) -> Vec<Ray> {
    (0..n)
        .map(|i| {
            let origin = random.point(half);
            if i % 10 == 0 {
                let mut d = [0.0; 3];
                d[random.below(3)] = if random.unit() < 0.5 { 1.0 } else { -1.0 };
                return (narrow(origin), d);
            }
            (narrow(origin), narrow(random.direction()))
        })
        .collect()
}

#[test]
fn triangle_soups() {
    let mut random = Random::new(11);
    for (half, size) in [(10.0, 1.0), (10.0, 0.1), (1e-4, 1e-5), (1e5, 1e4), (1.0, 3.0)] {
        let triangles: Vec<_> = (0..1_500).map(|_| random_triangle(&mut random, half, size)).collect();
        let g = geometry(&triangles, &[], &[]);
        let rays = random_rays(&mut random, 1_500, 1.5 * half);
        let hits = assert_trees_agree(&format!("soup {half} {size}"), &g, &rays);
        assert!(hits.iter().any(|h| h.primitive != MISS));
    }
}

#[test]
fn the_lowest_of_coincident_triangles_is_met() {
    let mut random = Random::new(12);
    // Far from the camera and on planes through the origin of space, where boxes have no thickness.
    for (flat, distance) in [(false, 20.0), (true, 20.0), (true, 1e4), (false, 1e4)] {
        let mut triangles = Vec::new();
        for _ in 0..300 {
            let mut t = random_triangle(&mut random, 10.0, 1.0);
            if flat {
                let axis = random.below(3);
                t.iter_mut().for_each(|c| c[axis] = 0.0);
            }
            triangles.push(t);
        }
        // Each four times, in another order.
        let mut all = triangles.clone();
        for copy in 1..4 {
            all.extend((0..300).map(|i| triangles[(i * 7 + copy * 31) % 300]));
        }
        let g = geometry(&all, &[], &[]);
        let rays: Vec<Ray> = (0..4_000)
            .map(|_| {
                let chosen = random.below(300);
                let target = inside(&mut random, &triangles[chosen]);
                ray(scale(random.direction(), distance), target)
            })
            .collect();
        let hits = assert_trees_agree(&format!("duplicates, flat {flat}, from {distance}"), &g, &rays);
        assert!(hits.iter().all(|h| h.primitive == MISS || h.primitive < 300));
        assert!(hits.iter().filter(|h| h.primitive != MISS).count() > 3_900);
    }
}

#[test]
fn ten_thousand_spheres() {
    let mut random = Random::new(13);
    let spheres: Vec<[f32; 4]> = (0..10_000)
        .map(|_| {
            let [x, y, z] = narrow(random.point(10.0));
            [x, y, z, random.magnitude(1e-3, 0.5) as f32 * if random.unit() < 0.5 { 1.0 } else { -1.0 }]
        })
        .collect();
    let g = geometry(&[], &spheres, &[]);
    let rays = random_rays(&mut random, 1_000, 15.0);
    let hits = assert_trees_agree("spheres", &g, &rays);
    assert!(hits.iter().filter(|h| h.primitive != MISS).count() > 100);
}

#[test]
fn mixed_primitives() {
    let mut random = Random::new(14);
    let mut triangles: Vec<_> = (0..800).map(|_| random_triangle(&mut random, 10.0, 1.0)).collect();
    triangles.extend(triangles.clone());
    let mut spheres: Vec<[f32; 4]> = (0..400)
        .map(|_| {
            let [x, y, z] = narrow(random.point(10.0));
            [x, y, z, random.magnitude(0.05, 1.0) as f32]
        })
        .collect();
    spheres.extend(spheres.clone());
    let quadrics: Vec<_> = (0..200)
        .map(|i| {
            let n = random.direction();
            let [s, t] = tangents(n);
            let form = match i % 3 {
                0 => QuadricForm::Disk(Disk { height: 0.1, radius: 1.0, inner_radius: 0.3, phi_max: 5.0 }),
                1 => QuadricForm::Sphere(SpherePart { radius: 1.0, z_min: -0.7, z_max: 0.8, phi_max: 4.0 }),
                _ => QuadricForm::Cylinder(Cylinder { radius: 0.6, z_min: -0.7, z_max: 1.1, phi_max: 5.0 }),
            };
            quadric(form, [s, t, scale(n, random.between(0.3, 2.0))], random.point(10.0))
        })
        .collect();
    let g = geometry(&triangles, &spheres, &quadrics);
    let rays = random_rays(&mut random, 2_000, 15.0);
    let hits = assert_trees_agree("mixed", &g, &rays);
    let count = |low: u32, high: u32| hits.iter().filter(|h| (low..high).contains(&h.primitive)).count();
    assert!(count(0, 800) > 100 && count(1_600, 2_000) > 100 && count(2_400, 2_600) > 30);
    assert_eq!(count(800, 1_600) + count(2_000, 2_400), 0, "duplicates with higher numbers");
}

/// Rays that stay together, as packets have them: from one place, from places close to each other, or towards one.
/// Every octant, and directions along axes and planes, where the signs of tiny components differ.
#[test]
fn rays_that_stay_together() {
    let mut random = Random::new(15);
    let mut triangles: Vec<_> = ball(4).iter().map(|face| face.map(|c| narrow(scale(c, 3.0)))).collect();
    triangles.extend((0..1_000).map(|_| random_triangle(&mut random, 10.0, 0.5)));
    let spheres = [[4.0, 1.0, -2.0, 1.5], [-3.0, -4.0, 2.0, 1.0]];
    let g = geometry(&triangles, &spheres, &[]);
    let mut rays = Vec::new();
    for bundle in 0..200 {
        let (start, end) = (random.point(8.0), random.point(4.0));
        let mut middle = normalize(sub(end, start));
        if bundle % 4 == 0 {
            middle[random.below(3)] = 0.0;
        }
        if bundle % 8 == 0 {
            middle = [0.0, 0.0, 1.0];
            middle.rotate_left(random.below(3));
        }
        let width = random.magnitude(1e-5, 0.3);
        // Not a whole number of packets: they begin anywhere.
        for _ in 0..19 {
            let (a, b) = (random.point(width), random.point(width));
            rays.push(match bundle % 3 {
                0 => ray(start, add(add(start, scale(middle, 10.0)), a)),
                1 => (narrow(add(start, a)), narrow(normalize(add(middle, scale(b, 1e-3))))),
                _ => ray(add(start, a), end),
            });
        }
    }
    let hits = assert_trees_agree("bundles", &g, &rays);
    let met = hits.iter().filter(|h| h.primitive != MISS).count();
    assert!(met > 1_000, "{met}");
}

/// A ray that is not a number, as a broken sample makes it, costs its neighbours in the packet nothing.
#[test]
fn rays_that_are_no_numbers_meet_nothing_and_harm_no_other() {
    let mut random = Random::new(16);
    let triangles: Vec<_> = (0..2_000).map(|_| random_triangle(&mut random, 5.0, 0.7)).collect();
    let g = geometry(&triangles, &[], &[]);
    let mut rays: Vec<Ray> =
        (0..640).map(|_| ray(narrow([20.0, 18.0, 22.0]).map(|x| x as f64), random.point(5.0))).collect();
    for (i, (origin, direction)) in rays.iter_mut().enumerate().filter(|(i, _)| i % 16 == 5 || i % 48 == 7) {
        match i % 3 {
            0 => direction[i / 48 % 3] = f32::NAN,
            1 => origin[i / 48 % 3] = f32::NAN,
            _ => *direction = [f32::NAN; 3],
        }
    }
    let tree = Bvh8::new(&g);
    for level in levels() {
        for way in TRAVERSALS {
            let hits = traced(level, &tree, &rays, way);
            let shadows: Vec<_> = rays.iter().map(|&r| (r, f32::INFINITY)).collect();
            let met = in_the_way(level, &tree, &shadows, way);
            let mut found = 0;
            for ((&r, hit), met) in rays.iter().zip(hits).zip(met) {
                let want = brute_force(&g, r, f32::INFINITY);
                assert_eq!((hit, met), (want, want.primitive != MISS), "{way:?}, {}: {r:?}", level.name());
                found += met as usize;
            }
            assert!(found > 100, "{found}");
        }
    }
}

#[test]
fn empty_and_single() {
    let mut random = Random::new(15);
    let rays = random_rays(&mut random, 200, 2.0);
    let empty = assert_trees_agree("empty", &geometry(&[], &[], &[]), &rays);
    assert!(empty.iter().all(|h| h.primitive == MISS));
    let one = [[-1.0, -1.0, 0.0], [2.0, -1.0, 0.0], [-1.0, 2.0, 0.0]];
    let down = (([0.0, 0.0, 5.0]), [0.0, 0.0, -1.0]);
    assert_eq!(assert_trees_agree("triangle", &geometry(&[one], &[], &[]), &[down])[0].t, 5.0);
    let sphere = geometry(&[], &[[0.0, 0.0, 0.0, 1.0]], &[]);
    assert_eq!(assert_trees_agree("sphere", &sphere, &[down])[0].t, 4.0);
    let form = QuadricForm::Disk(Disk { height: 0.0, radius: 1.0, inner_radius: 0.0, phi_max: 7.0 });
    let disk = quadric(form, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]);
    assert_eq!(assert_trees_agree("disk", &geometry(&[], &[], &[disk]), &[down])[0].t, 5.0);
    for g in [geometry(&[one], &[], &[]), sphere] {
        assert_trees_agree("single", &g, &rays);
    }
}

#[test]
fn identical_triangles_make_no_stack_overflow() {
    let one: Triangle = [[-1.0, -1.0, 0.5], [2.0, -1.0, 0.25], [-1.0, 2.0, 0.0]];
    let g = geometry(&vec![one; 100_000], &[], &[]);
    let rays = [([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]), ([0.1, 0.2, -5.0], [0.0, 0.0, 1.0])];
    let hits = assert_trees_agree("identical", &g, &rays);
    assert!(hits.iter().all(|h| h.primitive == 0));
}

#[test]
fn nested_shells_make_no_stack_overflow() {
    // Each box holds all the next ones: as deep as trees of real scenes get.
    let triangles: Vec<Triangle> = (0..5_000)
        .map(|i| {
            let s = 1.005f32.powi(-i);
            [[-s, -s, s], [2.0 * s, -s, s], [-s, 2.0 * s, -s]]
        })
        .collect();
    let g = geometry(&triangles, &[], &[]);
    let mut random = Random::new(16);
    assert_trees_agree("nested", &g, &random_rays(&mut random, 100, 2.0));
}

#[test]
fn regular_things_in_large_numbers_make_shallow_trees() {
    // What a builder that pairs neighbours takes steps by the square of the number for.
    let n = 200_000;
    let down = |x: f64, y: f64, z: f64| ray([x, y, z + 5.0], [x, y, z]);
    type Place = fn(f32) -> Triangle;
    let cases: [(&str, Place, [Ray; 2]); 3] = [
        (
            "row",
            |x| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]],
            [down(1_000.25, 0.25, 0.0), down(199_999.25, 0.25, 0.0)],
        ),
        (
            "stack",
            |x| [[0.0, 0.0, x], [100.0, 0.0, x], [0.0, 100.0, x]],
            [down(10.0, 10.0, 200_000.0), down(25.0, 70.0, 100.0)],
        ),
        (
            "concentric",
            |x| [[-1.0 - x, -1.0 - x, 1.0 + x], [1.0 + x, -1.0 - x, 1.0 + x], [-1.0 - x, 1.0 + x, -1.0 - x]],
            [down(0.0, -0.5, 5.0), down(-3.0, -5.0, 100.0)],
        ),
    ];
    for (what, place, rays) in cases {
        let triangles: Vec<Triangle> = (0..n).map(|i| place(i as f32)).collect();
        let g = geometry(&triangles, &[], &[]);
        let hits = assert_trees_agree(what, &g, &rays);
        assert!(hits.iter().all(|hit| hit.primitive != MISS), "{what}");
        // Seven siblings wait at each level, of which there are at most one for each of the binary tree.
        let stack = Bvh8::new(&g).stack().room();
        assert!(stack <= 8 * (3 * 17 + 25), "{what}: {stack}");
    }
}
