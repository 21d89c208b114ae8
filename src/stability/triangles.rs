//! Triangles: long, slender, degenerate, and the edges between them.
//!
//! - *strip*: a lamp of some width and length, of which the picture shows nothing but its middle: 1.
//! - *needle*, *leaks*, *thin-box*: rays that cannot miss; what is counted is those that do.
//! - *belly*: a point of a white ball whose normal is at an angle gamma from the zenith sees the sky above a black plane:
//!   (1 + cos gamma) / 2.
//! - *ball-on-floor*: the floor half a radius beside the foot of a black ball loses the share that the ball fills,
//!   cos sin^2 = 0.8^1.5, whatever the size of the floor.
//! - *offset*: where rays leave a surface: clear of it, and not by more than 1e-4 of its size.

use super::text::{Point, Text, cuboid, diffuse, floor, lamp, mesh, perfect_mirror, quad, sphere};
use super::{Case, Measure, Subject, Tolerance};
use crate::scene::Scene;
use std::collections::BTreeSet;
use std::sync::Arc;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, Closest, Intersect, Traversal};
use wavepath_kernels::isa::Level;
use wavepath_kernels::queue::{HitQueue, PathQueue, Requirements};
use wavepath_kernels::scene::{Geometry, MISS};

const SEEN: Tolerance = Tolerance::relative(1e-6, "every ray meets it, whatever its distance");
const FURNACE: Tolerance = Tolerance::relative(1e-5, "every path brings the albedo times the sky, exactly");
const CONTACT: Tolerance = Tolerance::relative(2e-3, "noise; the field of view");

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = strips().collect();
    cases.extend(needles());
    cases.extend(degenerate());
    cases.extend(floors());
    cases.extend(enclosures());
    cases.extend(leaks());
    cases.extend(thin_boxes());
    cases.extend(offsets());
    cases.extend(beyond_the_horizon());
    cases
}

fn strips() -> impl Iterator<Item = Case> {
    let strip = |half: f64, long: f64| {
        quad([[-long, 0.0, -half], [-long, 0.0, half], [long, 0.0, half], [long, 0.0, -half]])
    };
    let one = move |(half, k): (f64, i32)| {
        let long = 10f64.powi(k);
        let scene =
            Text::look([1.0, 1.5, 0.0], [0.0; 3], 1.0).block(format!("{}\n{}", lamp(1.0), strip(half, long)));
        Case::picture(
            format!("triangles/strip-{half}-1e{k}"),
            format!("middle of a strip {} wide and 2e{k} long, from 1.8", 2.0 * half),
            scene.end(),
            1.0,
            SEEN,
        )
        .spp(16)
    };
    [(0.075, 3), (0.075, 4), (0.075, 5), (0.075, 6), (0.075, 7), (100.0, 6), (1e7, 7)].into_iter().map(one)
}

/// Rays along an axis at needles of an aspect, aimed at their inside.
fn needles() -> impl Iterator<Item = Case> {
    [2, 4, 6, 7].into_iter().map(|k| {
        let width = 10f64.powi(-k);
        Case::compute(
            format!("triangles/needle-1e{k}"),
            format!("rays of 10,000 that miss a triangle of aspect 1e{k}"),
            0.0,
            Tolerance::EXACT,
            move |_| {
                let (a, b, c) = ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, width, 0.0]);
                let geometry = geometry_of(&mesh(&[a, b, c], &[[0, 1, 2]]));
                let mut random = Random(7);
                let rays: Vec<_> = (0..10_000)
                    .map(|_| {
                        // Well inside: weights of 0.1 and more.
                        let (u, v) = (0.1 + 0.35 * random.unit(), 0.1 + 0.35 * random.unit());
                        let point = [u + 0.5 * v, v * width, 0.0];
                        ([point[0] as f32, point[1] as f32, 1.0], [0.0, 0.0, -1.0])
                    })
                    .collect();
                let tree = Bvh8::new(&geometry);
                missed(&tree, &rays, Level::detect(), Traversal::Single) as f64
            },
        )
    })
}

fn degenerate() -> Vec<Case> {
    let corners: [Point; 6] = [
        [-3.0, 0.0, -3.0],
        [-3.0, 0.0, 3.0],
        [3.0, 0.0, 3.0],
        [3.0, 0.0, -3.0],
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 1.0],
    ];
    let one = |name: &str, what: &str, triangles: &[[usize; 3]], shapes: &[String]| {
        let mut scene = Text::look([0.3, 2.0, 0.1], [0.0; 3], 20.0).depth(5).sky(1.0).add(diffuse(0.5));
        if !triangles.is_empty() {
            scene = scene.add(mesh(&corners, triangles));
        }
        for shape in shapes {
            scene = scene.add(shape);
        }
        Case::picture(format!("triangles/{name}"), what, scene.end(), 0.5, FURNACE)
    };
    vec![
        one(
            "without-area",
            "floor of albedo 1/2 with triangles of no area in it",
            &[[0, 1, 2], [0, 2, 3], [4, 4, 5], [0, 4, 2], [5, 5, 5]],
            &[],
        ),
        one(
            "duplicated",
            "floor of albedo 1/2, three times",
            &[[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]],
            &[],
        ),
        one("coplanar", "two floors of albedo 1/2 in one plane", &[[0, 1, 2], [0, 2, 3]], &[floor(0.0, 2.0)]),
    ]
}

/// Floors of all sizes under a ball.
fn floors() -> Vec<Case> {
    let mut cases = Vec::new();
    for k in [1, 3, 4, 5, 6, 7] {
        let half = 10f64.powi(k);
        if k >= 3 {
            // The camera looks at the belly from 30 degrees below the equator: gamma = 120 degrees.
            let (sin, cos) = 30f64.to_radians().sin_cos();
            let foot = [cos, 1.0 - sin, 0.0];
            let scene = Text::look([foot[0] + 0.5 * cos, foot[1] - 0.5 * sin + 0.05, 0.0], foot, 0.5)
                .depth(1)
                .sky(1.0)
                .block(format!("{}\n{}", diffuse(0.0), floor(0.0, half)))
                .block(format!("{}\n{}", diffuse(1.0), sphere([0.0, 1.0, 0.0], 1.0)));
            cases.push(Case::picture(
                format!("triangles/belly-1e{k}"),
                format!("lower side of a ball over a black floor of half side 1e{k}"),
                scene.end(),
                0.25,
                Tolerance::relative(3e-3 + 2.0 / half, "noise; the field of view; beyond the edge is sky"),
            ));
        }
        let scene = Text::look([3.5, 1.5, 0.0], [0.5, 0.0, 0.0], 0.05)
            .depth(1)
            .sky(1.0)
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, half)))
            .block(format!("{}\n{}", diffuse(0.0), sphere([0.0, 1.0, 0.0], 1.0)));
        cases.push(Case::picture(
            format!("triangles/ball-on-floor-1e{k}"),
            format!("floor of half side 1e{k} beside a black ball on it"),
            scene.end(),
            1.0 - 0.8f64.powf(1.5),
            CONTACT,
        ));
    }
    cases
}

/// Closed rooms: no light comes in.
fn enclosures() -> Vec<Case> {
    let mut cases = Vec::new();
    for k in [2, 3, 4, 5, 6] {
        let long = 10f64.powi(k);
        let scene = Text::look([0.1, 0.2, 0.3], [1.1, 1.2, 0.5], 20.0)
            .depth(5)
            .sky(1.0)
            .add(diffuse(0.0))
            .add(cuboid([-2.5, -long, -2.5], [2.5, long, 2.5]));
        cases.push(Case::picture(
            format!("triangles/tunnel-1e{k}"),
            format!("light in a black tunnel of 5 x 5 x 2e{k}"),
            scene.end(),
            0.0,
            Tolerance::EXACT,
        ));
    }
    for (name, low, high) in [
        ("cube", [-1.0; 3], [1.0; 3]),
        ("long", [-1.0, -1e3, -1.0], [1.0, 1e3, 1.0]),
        ("flat", [-1.0, -1e-3, -1.0], [1.0, 1e-3, 1.0]),
        ("aside", [-0.5, -0.25, -0.7], [3.0, 2.0, 1.1]),
    ] {
        for depth in [100, 1000] {
            let scene = Text::look([0.1, 2e-4, 0.3], [0.7, 1e-3, -0.2], 70.0)
                .depth(depth)
                .sky(1.0)
                .add(perfect_mirror())
                .add(cuboid(low, high));
            cases.push(
                Case::picture(
                    format!("triangles/mirror-box-{name}-{depth}"),
                    format!("light that comes into a closed mirror box, {name}, in {depth} bounces"),
                    scene.end(),
                    0.0,
                    Tolerance::EXACT,
                )
                .spp(if depth == 100 { 32 } else { 4 }),
            );
        }
    }
    cases
}

/// The tables of a scene of some shapes.
pub(super) fn geometry_of(shapes: &str) -> Geometry {
    let text = Text::look([0.0; 3], [0.0, 0.0, 1.0], 40.0).add(shapes);
    let scene = Scene::parse(&text.end()).expect("the battery's own meshes are right");
    scene.tables().geometry().clone()
}

/// SplitMix64 (Steele, Lea, Flood 2014): inputs that owe nothing to the samplers under test.
pub(super) struct Random(pub u64);

impl Random {
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let x = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ x >> 31
    }
    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
    fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }
}

/// Vertices and triangles of an icosahedron, each face cut into four `levels` times, on the unit sphere.
fn icosphere(levels: u32) -> (Vec<Point>, Vec<[usize; 3]>) {
    let g = 0.5 * (1.0 + 5f64.sqrt());
    let mut points: Vec<Point> = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        points.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
    }
    let between = |p: &Point, q: &Point| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>();
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let sides = [(i, j), (j, k), (i, k)];
                if sides.iter().all(|&(p, q)| (between(&points[p], &points[q]) - 4.0).abs() < 1e-9) {
                    faces.push([i, j, k]);
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for face in &faces {
            let mut middle = |a: usize, b: usize| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    points.push(core::array::from_fn(|k| 0.5 * (points[a][k] + points[b][k])));
                    points.len() - 1
                })
            };
            let [a, b, c] = *face;
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = finer;
    }
    for p in &mut points {
        let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        *p = p.map(|x| x / length);
    }
    (points, faces)
}

/// A closed mesh around the origin, or around `centre`, for rays from inside.
struct Closed {
    name: &'static str,
    points: Vec<Point>,
    triangles: Vec<[usize; 3]>,
    /// Share of the box around it in which rays start.
    inner: f64,
}

fn closed_meshes() -> Vec<Closed> {
    let (ball, faces) = icosphere(3);
    let stretched = |name, s: Point, centre: Point| Closed {
        name,
        points: ball.iter().map(|p| core::array::from_fn(|k| centre[k] + s[k] * p[k])).collect(),
        triangles: faces.clone(),
        inner: 0.4,
    };
    let corner = |i: usize| [i >> 2 & 1, i >> 1 & 1, i & 1].map(|bit| bit as f64 * 2.0 - 1.0);
    let cube = |name, s: Point| Closed {
        name,
        points: (0..8).map(corner).map(|p| core::array::from_fn(|k| s[k] * p[k])).collect(),
        triangles: super::text::CUBOID.to_vec(),
        inner: 0.9,
    };
    vec![
        stretched("ball", [1.0; 3], [0.0; 3]),
        stretched("ball-stretched", [1e4, 1.0, 1.0], [0.0; 3]),
        stretched("ball-flattened", [1.0, 1e-4, 1.0], [0.0; 3]),
        stretched("ball-tiny", [1e-8; 3], [0.0; 3]),
        stretched("ball-huge", [1e8; 3], [0.0; 3]),
        stretched("ball-moved", [1.0; 3], [1e3, -7e2, 3e2]),
        cube("cube", [1.0; 3]),
        cube("cube-stretched", [1.0, 1e4, 1.0]),
        cube("cube-flattened", [1.0, 1.0, 1e-4]),
    ]
}

impl Closed {
    fn geometry(&self) -> Geometry {
        geometry_of(&mesh(&self.points, &self.triangles))
    }

    /// Rays from inside, at vertices and at points of edges as the tables have them, which may be elsewhere: scenes far
    /// from the origin are moved.
    fn rays(&self, geometry: &Geometry, count: usize, seed: u64) -> Vec<super::formulas::Ray> {
        let edges: BTreeSet<(usize, usize)> = self
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
            .map(|(a, b)| (a.min(b), a.max(b)))
            .collect();
        let edges: Vec<_> = edges.into_iter().collect();
        let points: Vec<Point> = geometry.vertices().iter().map(|p| p.map(f64::from)).collect();
        let corner = |pick: fn(f64, f64) -> f64| -> Point {
            core::array::from_fn(|k| points.iter().map(|p| p[k]).reduce(pick).unwrap_or(0.0))
        };
        let (low, high) = (corner(f64::min), corner(f64::max));
        let mut random = Random(seed);
        (0..count)
            .map(|i| {
                let origin: [f32; 3] = core::array::from_fn(|k| {
                    let around = self.inner * (random.unit() - 0.5);
                    (0.5 * (low[k] + high[k]) + around * (high[k] - low[k])) as f32
                });
                let (a, b) = edges[random.below(edges.len())];
                let share = if i % 2 == 0 { 0.0 } else { random.unit() };
                let target: Point =
                    core::array::from_fn(|k| points[a][k] + share * (points[b][k] - points[a][k]));
                let d: Point = core::array::from_fn(|k| target[k] - f64::from(origin[k]));
                let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
                (origin, d.map(|x| (x / length) as f32))
            })
            .collect()
    }
}

/// How many rays miss everything.
fn missed(tree: &Bvh8, rays: &[super::formulas::Ray], level: Level, traversal: Traversal) -> usize {
    let n = rays.len();
    let needs = Requirements { smooth_normals: true, ..Requirements::default() };
    let (mut paths, mut hits) = (PathQueue::new(n, needs), HitQueue::new(n, needs));
    for (i, (o, d)) in rays.iter().enumerate() {
        [paths.origin_x[i], paths.origin_y[i], paths.origin_z[i]] = *o;
        [paths.direction_x[i], paths.direction_y[i], paths.direction_z[i]] = *d;
    }
    paths.len = n;
    let (mut stack, mut order) = (tree.stack(), vec![0; n]);
    level.run(Intersect {
        accelerator: tree,
        traversal,
        paths: &paths,
        range: 0..n,
        hits: &mut hits,
        stack: &mut stack,
        order: &mut order,
    });
    hits.primitive[..n].iter().filter(|&&primitive| primitive == MISS).count()
}

const TRAVERSALS: [(&str, Traversal); 4] = [
    ("single", Traversal::Single),
    ("packets", Traversal::Packets),
    ("sorted", Traversal::Sorted),
    ("interleaved", Traversal::Interleaved),
];

/// Closed meshes from inside, rays at edges and vertices, every way through the tree.
fn leaks() -> Vec<Case> {
    let mut cases = Vec::new();
    for closed in closed_meshes().into_iter().map(Arc::new) {
        for (way, traversal) in TRAVERSALS {
            let closed = closed.clone();
            cases.push(Case::compute(
                format!("triangles/leaks-{}-{way}", closed.name),
                format!("rays at edges and vertices that leave a closed mesh, {}, {way}", closed.name),
                0.0,
                Tolerance::EXACT,
                move |subject: &Subject| {
                    // In portions, so that long runs need no memory.
                    const PORTION: usize = 1 << 16;
                    let geometry = closed.geometry();
                    let tree = Bvh8::new(&geometry);
                    let (mut missing, mut done) = (0, 0);
                    while done < subject.leak_rays {
                        let count = PORTION.min(subject.leak_rays - done);
                        let rays = closed.rays(&geometry, count, 11 + done as u64);
                        missing += missed(&tree, &rays, subject.level, traversal);
                        done += count;
                    }
                    missing as f64
                },
            ));
        }
    }
    // The test of triangles alone, so that another can be put in its place.
    cases.push(Case::compute(
        "triangles/watertight-test",
        "rays of 20,000 at edges and vertices that leave a closed ball",
        0.0,
        Tolerance::EXACT,
        |subject: &Subject| {
            let closed = &closed_meshes()[0];
            let geometry = closed.geometry();
            let met = (subject.formulas.meets)(&geometry, &closed.rays(&geometry, 20_000, 11));
            met.iter().filter(|&&met| !met).count() as f64
        },
    ));
    cases
}

/// Rays along an axis into boxes as thin as 1e-5 at the distance 1e5, through corners and edges of their faces.
fn thin_boxes() -> impl Iterator<Item = Case> {
    [0, 1, 2].into_iter().map(|axis| {
        Case::compute(
            format!("triangles/thin-box-axis-{}", ["x", "y", "z"][axis]),
            "rays along an axis that miss a thin box at the distance 1e5",
            0.0,
            Tolerance::EXACT,
            move |_| {
                let (mut low, mut high) = ([-1.0; 3], [1.0; 3]);
                // One rounding of 1e5 thin.
                (low[axis], high[axis]) = (1e5, 1e5 + 0.007_812_5);
                let geometry = geometry_of(&cuboid(low, high));
                let corner = geometry.vertices().iter().fold([f32::INFINITY; 3], |least, vertex| {
                    std::array::from_fn(|k| least[k].min(vertex[k]))
                });
                let tree = Bvh8::new(&geometry);
                let (mut stack, level) = (tree.stack(), Level::detect());
                let mut direction = [0.0f32; 3];
                direction[axis] = 1.0;
                let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut wrong = 0;
                for i in -8..=8 {
                    for j in -8..=8 {
                        // From where the box is: tables of scenes far from the origin are moved there.
                        let mut origin = corner;
                        origin[axis] -= 1e5;
                        origin[b] += 1.0 + i as f32 / 8.0;
                        origin[c] += 1.0 + j as f32 / 8.0;
                        let hit =
                            level.run(Closest { accelerator: &tree, origin, direction, stack: &mut stack });
                        wrong += u32::from(hit.primitive == MISS || (hit.t - 1e5).abs() > 0.02);
                    }
                }
                f64::from(wrong)
            },
        )
    })
}

/// Where rays leave a square: on their side of it by more than nothing, and near.
fn offsets() -> impl Iterator<Item = Case> {
    [-8, -4, 0, 4, 8].into_iter().map(|k| {
        let s = 10f64.powi(k);
        Case::compute(
            format!("triangles/offset-1e{k}"),
            format!("rays of 1,000 that leave a square of size 1e{k} from its wrong side, or from afar"),
            0.0,
            Tolerance::EXACT,
            move |subject: &Subject| {
                // The plane x + 2 y + 3 z = s, of a square away from the origin.
                let n = [1.0, 2.0, 3.0].map(|x: f64| x / 14f64.sqrt());
                let (u, v) = ([2.0, -1.0, 0.0], [3.0, 6.0, -5.0].map(|x: f64| x / 70f64.sqrt()));
                let at = |a: f64, b: f64| -> Point {
                    core::array::from_fn(|i| s * (n[i] / 14f64.sqrt() + a * u[i] / 5f64.sqrt() + b * v[i]))
                };
                let geometry =
                    geometry_of(&quad([at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]));
                let tree = Bvh8::new(&geometry);
                let (mut stack, level) = (tree.stack(), Level::detect());
                let mut random = Random(17);
                let mut wrong = 0;
                for i in 0..1000 {
                    let target = at(1.8 * random.unit() - 0.9, 1.8 * random.unit() - 0.9);
                    let side = if i % 2 == 0 { 1.0 } else { -1.0 };
                    let from: Point = core::array::from_fn(|i| {
                        target[i]
                            + s * (side * n[i] + 0.5 * random.unit() * u[i] - 0.3 * random.unit() * v[i])
                    });
                    let d: Point = core::array::from_fn(|i| target[i] - from[i]);
                    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
                    let ray = (from.map(|x| x as f32), d.map(|x| (x / length) as f32));
                    let hit = level.run(Closest {
                        accelerator: &tree,
                        origin: ray.0,
                        direction: ray.1,
                        stack: &mut stack,
                    });
                    if hit.primitive == MISS {
                        wrong += 1;
                        continue;
                    }
                    let back = ray.1.map(|x| -x);
                    let start = (subject.formulas.leave)(&geometry, hit.primitive, ray, hit.t, back);
                    // Against the plane of the rounded corners.
                    let [a, b, c] =
                        geometry.corners(hit.primitive as usize).map(|p| glam::DVec3::from(p.map(f64::from)));
                    let normal = (b - a).cross(c - a).normalize();
                    let height = normal.dot(glam::DVec3::from(start.map(f64::from)) - a)
                        * side
                        * normal.dot(glam::DVec3::from(n)).signum();
                    wrong += u32::from(!(height > 0.0 && height < 1e-4 * s));
                }
                f64::from(wrong)
            },
        )
    })
}

/// Vertex normals so far from the surface's own that light comes from beyond their horizon: no more than the sky, and
/// numbers all of it.
fn beyond_the_horizon() -> Vec<Case> {
    let square = |tilt: f64| {
        let (sin, cos) = tilt.to_radians().sin_cos();
        let one = super::text::numbers(&[sin, cos, 0.0]);
        format!("{} \"normal N\" [{one} {one} {one} {one}]", floor(0.0, 3.0))
    };
    let mut cases = Vec::new();
    for tilt in [30.0, 80.0, 89.0] {
        for (name, material) in [
            ("lambert", diffuse(1.0)),
            ("mirror", perfect_mirror()),
            ("rough", format!("{} \"float roughness\" 0.3", perfect_mirror())),
        ] {
            for theta in [60.0, 89.0f64] {
                let (sin, cos) = theta.to_radians().sin_cos();
                // From the side away from the normals.
                let scene = Text::look([-2.0 * sin, 2.0 * cos, 0.0], [0.0; 3], 0.5 * cos)
                    .depth(5)
                    .sky(1.0)
                    .block(format!("{material}\n{}", square(tilt)));
                cases.push(
                    Case::picture(
                        format!("triangles/normals-{name}-{tilt}-{theta}"),
                        format!("floor, {name}, normals tilted by {tilt}, seen at {theta} degrees: at most the sky"),
                        scene.end(),
                        1.0,
                        Tolerance::relative(1e-4, "roundings"),
                    )
                    .measure(Measure::Largest)
                    .at_most(),
                );
            }
        }
    }
    cases
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn icospheres_are_closed() {
        let (points, faces) = icosphere(2);
        assert_eq!((points.len(), faces.len()), (162, 320));
        let mut edges = std::collections::BTreeMap::new();
        for [a, b, c] in faces {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *edges.entry((p.min(q), p.max(q))).or_insert(0) += 1;
            }
        }
        assert!(edges.values().all(|&n| n == 2));
    }

    #[test]
    fn an_open_mesh_leaks() {
        let closed = &closed_meshes()[0];
        let geometry = geometry_of(&mesh(&closed.points, &closed.triangles[1..]));
        let tree = Bvh8::new(&geometry);
        let rays = closed.rays(&geometry, 20_000, 11);
        for (name, traversal) in TRAVERSALS {
            assert!(missed(&tree, &rays, Level::detect(), traversal) > 0, "{name}");
        }
    }
}
