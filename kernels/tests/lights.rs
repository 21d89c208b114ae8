//! Lights: sampled directions against density, irradiance against analytic values, shadow rays that stop in time, the
//! choice among lights, and the sum of both strategies.

mod statistics;

use core::f64::consts::PI;
use core::marker::PhantomData;
use core::num::Wrapping;
use statistics::{
    Around, Mean, Random, add, assert_distributed, cross, dot, length, narrow, normalize, scale, sub,
    tangents, wide,
};
use wavepath_kernels::intersect::triangle::ShearedRay;
use wavepath_kernels::intersect::{Hit, sphere, test_triangle};
use wavepath_kernels::lanes::{Real, Uint};
use wavepath_kernels::math::{Rgb, Vec3};
use wavepath_kernels::sampler::{Independent, Sampler, Sobol, Stream, stream_seed};
use wavepath_kernels::scene::lights::{
    self, AllLights, CylinderRow, DistantRow, Emitter, FlatRow, GoniometricRow, LightKind, LightKinds,
    LightList, LightRow, LightTable, NoLights, PointRow, SphereRow, Spheres, StretchedSpotRow, WithLights,
    fade, goniometric, kind, with_lights,
};
use wavepath_kernels::scene::{
    BuildError, Camera, CameraParts, Filter, FilterAxis, Geometry, MaterialTable, NoRow, Scene, SceneParts,
};
use wavepath_kernels::shade::bsdf::Bsdf;
use wavepath_kernels::shade::emission::emitted;
use wavepath_kernels::shade::materials::{Lambert, Material, RoughConductor};
use wavepath_kernels::shade::surface::Surface;
use wavepath_kernels::shade::{Features, InPlace, Vertex, scatter};

/// One lane, single or double precision.
trait Scalar: Real<Mask = bool, Uint = Wrapping<u32>> + Into<f64> {}
impl Scalar for f32 {}
impl Scalar for f64 {}

fn lanes<F: Real>(v: [f64; 3]) -> Vec3<F> {
    Vec3::new(F::lit(v[0]), F::lit(v[1]), F::lit(v[2]))
}
fn array<F: Scalar>(v: Vec3<F>) -> [f64; 3] {
    [v.x.into(), v.y.into(), v.z.into()]
}

/// A light with a place, as the tests know it.
#[derive(Clone, Copy, Debug)]
enum Shape {
    /// Centre, signed radius.
    Sphere([f32; 3], f32),
    /// The same, sampled by area.
    SphereArea([f32; 3], f32),
    /// Corner, two edges.
    Triangle([f32; 3], [f32; 3], [f32; 3]),
    /// Centre, two half axes, at right angles and as long.
    Disk([f32; 3], [f32; 3], [f32; 3]),
    /// Base, axis, radius towards azimuth 0, turns, side.
    Tube(CylinderRow),
}
use Shape::{Disk, Sphere, SphereArea, Triangle, Tube};

const RADIANCE: [f32; 3] = [2.0, 1.0, 0.5];

const EMITTER: Emitter = Emitter { radiance: RADIANCE, two_sided: false, material: 0, power: 1.0 };

/// The table of some lights.
fn table_of(lights: impl IntoIterator<Item = (Emitter, lights::Light)>) -> LightTable {
    let mut list = LightList::default();
    for (emitter, light) in lights {
        list.push(emitter, light);
    }
    LightTable::new(list).unwrap()
}

struct Light {
    shape: Shape,
    two_sided: bool,
    table: LightTable,
}

struct Sample {
    direction: [f64; 3],
    distance: f64,
    radiance: f64,
    pdf: f64,
    valid: bool,
}

impl Light {
    fn new(shape: Shape, two_sided: bool) -> Self {
        let light = match shape {
            Sphere(centre, radius) => lights::Light::Sphere(SphereRow { centre, radius }),
            SphereArea(centre, radius) => lights::Light::SphereArea(SphereRow { centre, radius }),
            Tube(row) => lights::Light::Cylinder(row),
            Triangle(corner, first, second) | Disk(corner, first, second) => {
                let across = cross(wide(first), wide(second));
                let (parallelogram, normal) = (length(across), narrow(normalize(across)));
                let row = |share: f64| {
                    let area = (parallelogram * share) as f32;
                    FlatRow { corner, first, second, area, normal }
                };
                match shape {
                    Triangle(..) => lights::Light::Triangle(row(0.5)),
                    _ => lights::Light::Disk(row(PI)),
                }
            }
        };
        let table = table_of([(Emitter { two_sided, ..EMITTER }, light)]);
        Light { shape, two_sided, table }
    }
    fn row<F: Real>(&self) -> LightRow<'_, F> {
        // SAFETY: the table has one light.
        unsafe { self.table.row(F::Uint::splat(0)) }
    }
    fn sample<F: Scalar>(&self, origin: [f64; 3], u: [f64; 2]) -> Sample {
        let s = lights::sample::<F, AllLights>(&self.row(), lanes(origin), u.map(F::lit));
        assert!(!s.delta);
        Sample {
            direction: array(s.direction),
            distance: s.distance.into(),
            radiance: s.radiance.r.into(),
            pdf: s.pdf.into(),
            valid: s.valid,
        }
    }
    /// Where a ray meets the light first: distance, oriented normal.
    fn meet(&self, origin: [f64; 3], d: [f64; 3]) -> Option<(f64, [f64; 3])> {
        match self.shape {
            Sphere(c, r) | SphereArea(c, r) => {
                let (f, r) = (sub(wide(c), origin), r as f64);
                let along = dot(f, d);
                let across = sub(f, scale(d, along));
                let half = (r * r - dot(across, across)).max(-1.0);
                if half < 0.0 {
                    return None;
                }
                let half = half.sqrt();
                let t = if along - half > 0.0 { along - half } else { along + half };
                (t > 0.0).then(|| (t, scale(sub(add(origin, scale(d, t)), wide(c)), 1.0 / r)))
            }
            Tube(tube) => {
                let (base, axis, x) = (wide(tube.base), wide(tube.axis), wide(tube.first));
                let (up, height) = (normalize(axis), length(axis));
                let y = scale(cross(up, x), (tube.turns as f64).signum());
                let (r2, turns) = (dot(x, x), tube.turns.abs() as f64);
                // Across the axis, in units of the radius.
                let flat = |v: [f64; 3]| [dot(v, x) / r2, dot(v, y) / r2];
                let (o, across) = (flat(sub(origin, base)), flat(d));
                let (a, b) = (across[0].powi(2) + across[1].powi(2), o[0] * across[0] + o[1] * across[1]);
                let c = o[0] * o[0] + o[1] * o[1] - 1.0;
                let root = (b * b - a * c).max(-1.0);
                if root < 0.0 {
                    return None;
                }
                [-b - root.sqrt(), -b + root.sqrt()].into_iter().map(|t| t / a).find_map(|t| {
                    let p = sub(add(origin, scale(d, t)), base);
                    let along = dot(p, up);
                    let [cos, sin] = flat(p);
                    let azimuth = sin.atan2(cos).rem_euclid(2.0 * PI);
                    let there = t > 0.0 && (0.0..=height).contains(&along) && azimuth <= 2.0 * PI * turns;
                    let outwards = normalize(sub(p, scale(up, along)));
                    there.then(|| (t, scale(outwards, tube.side as f64)))
                })
            }
            Triangle(p, a, b) | Disk(p, a, b) => {
                let (p, a, b) = (wide(p), wide(a), wide(b));
                let n = normalize(cross(a, b));
                let t = dot(n, sub(p, origin)) / dot(n, d);
                let q = sub(add(origin, scale(d, t)), p);
                // Coordinates of q in the basis (a, b).
                let (aa, ab, bb) = (dot(a, a), dot(a, b), dot(b, b));
                let det = aa * bb - ab * ab;
                let x = (bb * dot(q, a) - ab * dot(q, b)) / det;
                let y = (aa * dot(q, b) - ab * dot(q, a)) / det;
                let inside = match self.shape {
                    Triangle(..) => x >= 0.0 && y >= 0.0 && x + y <= 1.0,
                    _ => x * x + y * y <= 1.0,
                };
                (t > 0.0 && inside).then_some((t, n))
            }
        }
    }
    /// The density of a direction, 0 where the light is not seen, for samples and rays alike.
    fn density<F: Scalar>(&self, origin: [f64; 3], d: [f64; 3]) -> f64 {
        match self.meet(origin, d) {
            Some((t, n)) if self.two_sided || dot(n, d) < 0.0 => {
                lights::pdf::<F, AllLights>(&self.row(), lanes(origin), lanes(d), F::lit(t), lanes(n)).into()
            }
            _ => 0.0,
        }
    }
    /// A map of directions around the light.
    fn map(&self, origin: [f64; 3]) -> Around {
        let (centre, extent) = match self.shape {
            Sphere(c, r) | SphereArea(c, r) => {
                let d = length(sub(wide(c), origin));
                let sin = (r.abs() as f64 / d).min(1.0);
                // The rim is an edge of bins: tan(theta / 2), q = 1/2. Sampled by area it is crowded, and rounding
                // takes samples across: there it lies within a bin.
                let beyond = if let SphereArea(..) = self.shape { 1.05 } else { 1.0 };
                let spread = if sin < 1.0 { beyond * sin / (1.0 + (1.0 - sin * sin).sqrt()) } else { 1.0 };
                return Around::new(
                    if d > 0.0 { normalize(sub(wide(c), origin)) } else { [0.0, 0.0, 1.0] },
                    spread,
                );
            }
            Triangle(p, a, b) => {
                let third = add(wide(p), scale(add(wide(a), wide(b)), 1.0 / 3.0));
                (third, 0.4 * length(wide(a)).max(length(wide(b))))
            }
            Disk(p, a, _) => (wide(p), length(wide(a))),
            Tube(tube) => {
                let half = length(wide(tube.axis)) / 2.0;
                let centre = add(wide(tube.base), scale(wide(tube.axis), 0.5));
                // From within it is all around.
                (
                    centre,
                    if length(sub(centre, origin)) < half {
                        1e3
                    } else {
                        half.hypot(length(wide(tube.first)))
                    },
                )
            }
        };
        let to = sub(centre, origin);
        Around::new(normalize(to), (0.5 * extent / length(to)).min(1.0))
    }
}

/// A sphere of radius 1 seen from where r / d is `ratio`; turned inwards if `turn` is negative.
fn ball(ratio: f64, turn: f32) -> (Shape, [f64; 3]) {
    (Sphere([0.0; 3], turn), narrow(scale(normalize([0.3, -0.5, 0.8]), 1.0 / ratio)).map(f64::from))
}

fn by_area(shape: Shape) -> Shape {
    match shape {
        Sphere(c, r) => SphereArea(c, r),
        other => other,
    }
}

fn flat_lights() -> Vec<(String, Shape, [f64; 3], bool)> {
    let triangle = Triangle([-1.0, -0.5, 0.0], [2.0, 0.25, 0.5], [0.5, 1.5, -0.25]);
    let turned = Triangle([-1.0, -0.5, 0.0], [0.5, 1.5, -0.25], [2.0, 0.25, 0.5]);
    let disk = Disk([0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]);
    let mut all = Vec::new();
    for (where_, origin) in [
        ("near", [0.2, 0.1, 0.75]),
        ("far", [3.0, -8.0, 30.0]),
        ("aside", [2.5, 0.5, 2.0]),
        ("below", [0.3, 0.2, -2.0]),
    ] {
        for (name, shape) in [("triangle", triangle), ("turned triangle", turned), ("disk", disk)] {
            for two_sided in [false, true] {
                all.push((format!("{name}, {where_}, two-sided {two_sided}"), shape, origin, two_sided));
            }
        }
    }
    all
}

/// Cylinders that do not hide themselves: their outside, and their inside from within.
fn tubes() -> Vec<(String, Shape, [f64; 3])> {
    // At right angles in single precision, too.
    let (axis, first) = ([0.4, -0.8, 1.2], [0.56, 0.28, 0.0]);
    let row = CylinderRow { base: [0.1, 0.5, -0.6], axis, first, turns: 1.0, side: 1.0 };
    let on_axis = add(wide(row.base), scale(wide(axis), 0.4));
    let mut all = Vec::new();
    for turns in [1.0, -1.0, 0.3, -0.6] {
        let row = CylinderRow { turns, ..row };
        for (place, origin) in [("aside", [3.0, 1.0, 0.5]), ("over its end", [1.0, -1.8, 2.5])] {
            all.push((format!("tube of {turns}, {place}"), Tube(row), origin));
        }
        all.push((format!("inside of {turns}"), Tube(CylinderRow { side: -1.0, ..row }), on_axis));
    }
    all
}

/// Samples in both precisions fall into bins as the double-precision density says.
fn assert_sampling(what: &str, light: &Light, origin: [f64; 3], family: usize) {
    let map = light.map(origin);
    let integrals = map.integrals(|d| light.density::<f64>(origin, d));
    let total: f64 = integrals.iter().sum();
    assert!(total < 1.0 + 2e-4, "{what}: density integrates to {total}");
    let lost = if total > 1.0 - 2e-4 { 0.0 } else { 1.0 - total };
    let shares: Vec<f64> = integrals.into_iter().chain([lost]).collect();
    assert_shares::<f64>(&format!("{what}, double"), light, origin, &map, &shares, 2 * family);
    assert_shares::<f32>(&format!("{what}, single"), light, origin, &map, &shares, 2 * family);
}

fn assert_shares<F: Scalar>(
    what: &str,
    light: &Light,
    origin: [f64; 3],
    map: &Around,
    shares: &[f64],
    family: usize,
) {
    const SAMPLES: usize = 50_000;
    let expected: Vec<f64> = shares.iter().map(|p| p * SAMPLES as f64).collect();
    let mut observed = vec![0; expected.len()];
    let mut random = Random::new(1);
    for _ in 0..SAMPLES {
        let s = light.sample::<F>(origin, [random.unit(), random.unit()]);
        let bin = if s.valid { map.bin(s.direction) } else { shares.len() - 1 };
        observed[bin] += 1;
        if s.valid {
            assert!((length(s.direction) - 1.0).abs() < 1e-6, "{what}: {:?}", s.direction);
            assert_eq!(s.radiance, RADIANCE[0] as f64);
        }
    }
    assert_distributed(what, &observed, &expected, family);
}

#[test]
fn samples_follow_their_density() {
    let flat = flat_lights();
    let ratios = [0.999, 0.9, 0.5, 0.1, 1e-2, 1e-3];
    let family = flat.len() + tubes().len() + 4 * ratios.len() + 6;
    for (what, shape, origin, two_sided) in flat {
        let light = Light::new(shape, two_sided);
        assert_sampling(&what, &light, origin, family);
    }
    for (what, shape, origin) in tubes() {
        assert_sampling(&what, &Light::new(shape, false), origin, family);
    }
    for ratio in ratios {
        for turn in [1.0, -1.0] {
            let (shape, origin) = ball(ratio, turn);
            for shape in [shape, by_area(shape)] {
                let what = format!("{shape:?}, r / d = {ratio}");
                // Turned inwards and seen from outside it is dark, unless both sides emit.
                let light = Light::new(shape, turn < 0.0);
                assert_sampling(&what, &light, origin, family);
            }
        }
    }
    for origin in [[0.0, 0.0, 0.0], [0.5, 0.2, -0.4], [0.0, 0.0, 0.999]] {
        for shape in [Sphere([0.0; 3], -1.0), SphereArea([0.0; 3], -1.0)] {
            let light = Light::new(shape, false);
            assert_sampling(&format!("{shape:?} from within, {origin:?}"), &light, origin, family);
        }
    }
}

#[test]
fn densities_are_those_of_the_samples_and_integrate_to_one() {
    let mut random = Random::new(2);
    for ratio in [0.999_999, 0.9, 0.1, 1e-3, 1e-4, 1e-5, 1e-6] {
        let (shape, origin) = ball(ratio, 1.0);
        let light = Light::new(shape, false);
        let d2 = dot(origin, origin);
        // Solid angle of the cone in double precision: 1 - cos = sin^2 / (1 + cos).
        let solid_angle = 2.0 * PI / d2 / (1.0 + (1.0 - 1.0 / d2).max(0.0).sqrt());
        for _ in 0..200 {
            let u = [random.unit(), random.unit()];
            let (fast, double) = (light.sample::<f32>(origin, u), light.sample::<f64>(origin, u));
            assert!(
                (double.pdf * solid_angle - 1.0).abs() < 1e-9,
                "r / d = {ratio}: {}",
                double.pdf * solid_angle
            );
            let tolerance = 2e-6 + 1e-7 / (1.0 - 1.0 / d2).max(1e-6).sqrt();
            assert!(
                (fast.pdf / double.pdf - 1.0).abs() < tolerance,
                "r / d = {ratio}: {} {}",
                fast.pdf,
                double.pdf
            );
            assert!(fast.valid && double.valid);
            let apart = length(sub(fast.direction, double.direction));
            assert!(apart < tolerance, "r / d = {ratio}: directions differ by {apart}");
            // Within the cone, as well as single precision has directions.
            let sine = length(cross(fast.direction, normalize(origin)));
            assert!(sine < ratio + 2e-7, "r / d = {ratio}: {sine}");
        }
    }
    // A sample's own density is that of a ray in its direction.
    let tubes = tubes().into_iter().map(|(what, shape, origin)| (what, shape, origin, false));
    for (what, shape, origin, two_sided) in flat_lights().into_iter().chain(tubes) {
        let light = Light::new(shape, two_sided);
        for _ in 0..200 {
            let s = light.sample::<f64>(origin, [random.unit(), random.unit()]);
            if s.valid && light.meet(origin, s.direction).is_some() {
                let pdf = light.density::<f64>(origin, s.direction);
                assert!((s.pdf / pdf - 1.0).abs() < 1e-6, "{what}: {} and {pdf}", s.pdf);
            }
        }
    }
}

/// Mean of radiance * cos / pdf over samples in single precision.
fn irradiance(light: &Light, origin: [f64; 3], normal: [f64; 3]) -> Mean {
    let mut random = Random::new(3);
    Mean::of((0..60_000).map(|_| {
        let s = light.sample::<f32>(origin, [random.unit(), random.unit()]);
        if s.valid { s.radiance * dot(s.direction, normal).max(0.0) / s.pdf } else { 0.0 }
    }))
}

/// The third strategy: uniform directions, and see what they meet.
fn irradiance_by_direction(light: &Light, origin: [f64; 3], normal: [f64; 3]) -> Mean {
    let mut random = Random::new(4);
    Mean::of((0..400_000).map(|_| {
        let d = random.direction();
        match light.meet(origin, d) {
            Some((_, n)) if light.two_sided || dot(n, d) < 0.0 => {
                4.0 * PI * RADIANCE[0] as f64 * dot(d, normal).max(0.0)
            }
            _ => 0.0,
        }
    }))
}

/// Places within the unit sphere.
const WITHIN: [[f64; 3]; 3] = [[0.0; 3], [0.5, 0.2, -0.4], [0.0, 0.0, 0.99]];

#[test]
fn spheres_give_their_analytic_irradiance() {
    let radiance = RADIANCE[0] as f64;
    for ratio in [0.9, 0.5, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
        let (shape, origin) = ball(ratio, 1.0);
        let d2 = dot(origin, origin);
        let to = scale(normalize(origin), -1.0);
        let [s, _] = tangents(to);
        // Normals for which the whole sphere is above the horizon: cos above r / d.
        for cos in [1.0f64, 0.95, ratio + 0.5 * (1.0 - ratio)] {
            let normal = add(scale(to, cos), scale(s, (1.0 - cos * cos).sqrt()));
            let want = PI * radiance * cos / d2;
            for shape in [shape, by_area(shape)] {
                let what = format!("{shape:?}, r / d = {ratio}, cos {cos}");
                irradiance(&Light::new(shape, false), origin, normal).assert_near(&what, want, 2e-5);
            }
            if ratio > 0.2 {
                let what = format!("directions, r / d = {ratio}, cos {cos}");
                irradiance_by_direction(&Light::new(shape, false), origin, normal)
                    .assert_near(&what, want, 0.0);
            }
        }
        // Half-set: all three strategies give the same.
        if ratio >= 0.1 {
            let cos = 0.3 * ratio;
            let normal = add(scale(to, cos), scale(s, (1.0 - cos * cos).sqrt()));
            let cone = irradiance(&Light::new(shape, false), origin, normal);
            let area = irradiance(&Light::new(by_area(shape), false), origin, normal);
            let direction = irradiance_by_direction(&Light::new(shape, false), origin, normal);
            for (name, other) in [("area", area), ("direction", direction)] {
                let error = cone.standard_error().hypot(other.standard_error());
                assert!((cone.mean - other.mean).abs() < 4.9 * error, "r / d = {ratio}: cone and {name}");
            }
        }
    }
    // From within, wherever: every surface sees nothing but light, which sampling by area finds.
    for origin in WITHIN {
        let normal = normalize([0.2, -0.3, 0.7]);
        let what = format!("from within, {origin:?}");
        let by_area = Light::new(SphereArea([0.0; 3], -1.0), false);
        irradiance(&by_area, origin, normal).assert_near(&what, PI * radiance, 1e-5);
        irradiance_by_direction(&by_area, origin, normal).assert_near(&what, PI * radiance, 0.0);
    }
    // Sides that do not emit.
    let dark = |shape, origin| irradiance(&Light::new(shape, false), origin, [0.0, 0.0, 1.0]).mean;
    assert_eq!(dark(Sphere([0.0, 0.0, 3.0], -1.0), [0.0; 3]), 0.0);
    assert_eq!(dark(SphereArea([0.0, 0.0, 3.0], -1.0), [0.0; 3]), 0.0);
    assert_eq!(dark(Sphere([0.0; 3], 1.0), [0.1; 3]), 0.0);
    assert_eq!(dark(SphereArea([0.0; 3], 1.0), [0.1; 3]), 0.0);
}

#[test]
fn flat_lights_give_their_analytic_irradiance() {
    let radiance = RADIANCE[0] as f64;
    for (r, h) in [(1.0, 0.5), (1.0, 3.0), (0.01, 5.0), (50.0, 1.0)] {
        let disk = Disk([0.0, 0.0, h as f32], [0.0, r as f32, 0.0], [r as f32, 0.0, 0.0]);
        let want = PI * radiance * r * r / (r * r + h * h);
        let up = [0.0, 0.0, 1.0];
        irradiance(&Light::new(disk, false), [0.0; 3], up).assert_near(&format!("disk {r} {h}"), want, 1e-5);
        let other_side = irradiance(&Light::new(disk, false), [0.0, 0.0, 2.0 * h], [0.0, 0.0, -1.0]);
        assert_eq!(other_side.mean, 0.0, "the disk emits on one side");
        let both = irradiance(&Light::new(disk, true), [0.0, 0.0, 2.0 * h], [0.0, 0.0, -1.0]);
        both.assert_near(&format!("two-sided disk {r} {h}"), want, 1e-5);
    }
    let mut random = Random::new(5);
    for round in 0..40 {
        let p: [[f64; 3]; 3] = [(); 3].map(|_| add(random.point(1.0), [0.0, 0.0, 2.0]));
        let p = p.map(|p| wide(narrow(p)));
        // Seen from the origin on the emitting side.
        let n = cross(sub(p[1], p[0]), sub(p[2], p[0]));
        let [b, c] = if dot(n, p[0]) < 0.0 { [p[1], p[2]] } else { [p[2], p[1]] };
        // Lambert's formula for polygons above the horizon.
        let up = [0.0, 0.0, 1.0];
        let edge = |a: [f64; 3], b: [f64; 3]| {
            let angle = dot(normalize(a), normalize(b)).clamp(-1.0, 1.0).acos();
            angle * dot(normalize(cross(a, b)), up)
        };
        let want = 0.5 * radiance * (edge(p[0], b) + edge(b, c) + edge(c, p[0])).abs();
        let shape = Triangle(narrow(p[0]), narrow(sub(b, p[0])), narrow(sub(c, p[0])));
        irradiance(&Light::new(shape, false), [0.0; 3], up).assert_near(
            &format!("triangle {round}"),
            want,
            1e-4,
        );
        let turned = Triangle(narrow(p[0]), narrow(sub(c, p[0])), narrow(sub(b, p[0])));
        assert_eq!(irradiance(&Light::new(turned, false), [0.0; 3], up).mean, 0.0, "turned triangle {round}");
    }
}

#[test]
fn shadow_rays_stop_short_of_the_light_and_not_long_before() {
    let mut random = Random::new(6);
    for gap in [1e4, 1e2, 10.0, 1.0, 0.1, 1e-2, 1e-3, 1e-4] {
        for radius in [1.0, 1e-3, 1e4f64] {
            for _ in 0..2_000 {
                let centre = narrow(random.point(radius));
                let origin = add(wide(centre), scale(random.direction(), radius * (1.0 + gap)));
                let origin = wide(narrow(origin));
                for shape in [Sphere(centre, radius as f32), SphereArea(centre, radius as f32)] {
                    let light = Light::new(shape, false);
                    let s = light.sample::<f32>(origin, [random.unit(), random.unit()]);
                    if !s.valid {
                        continue;
                    }
                    let (_, hit) = sphere::intersect::<f32>(
                        narrow(origin),
                        narrow(s.direction),
                        centre,
                        radius as f32,
                        s.distance as f32,
                    );
                    assert!(!hit, "{shape:?}, gap {gap}: the light shadows itself");
                    // Where the ray meets the sphere at no grazing angle, things just in front of it throw a shadow.
                    let Some((t, n)) = light.meet(origin, s.direction) else { continue };
                    let cos = -dot(n, s.direction);
                    if cos > 0.1 {
                        let short = t - s.distance;
                        // The distance is known to some roundings of the coordinates over the cosine.
                        let bound = 2e-4 * t + 1e-5 * radius / cos + 1e-6 * length(origin);
                        assert!(short < bound, "{shape:?}, gap {gap}: stops {short} short of {t}");
                    }
                }
            }
        }
    }
    for (what, shape, origin, _) in flat_lights() {
        if let Triangle(p, a, b) = shape {
            let corners = [p, narrow(add(wide(p), wide(a))), narrow(add(wide(p), wide(b)))];
            let light = Light::new(shape, true);
            for _ in 0..2_000 {
                let s = light.sample::<f32>(origin, [random.unit(), random.unit()]);
                let mut hit = Hit::none(s.distance as f32);
                test_triangle(&corners, 0, &ShearedRay::new(narrow(origin), narrow(s.direction)), &mut hit);
                assert!(hit.primitive != 0, "{what}: the light shadows itself");
                assert!(light.meet(origin, s.direction).is_none_or(|(t, _)| t - s.distance < 2e-4 * t));
            }
        }
    }
}

#[test]
fn lights_without_extent() {
    let sample = |table: &LightTable, origin: [f64; 3]| {
        // SAFETY: the table has one light.
        let row = unsafe { table.row::<f32>(Wrapping(0)) };
        let s = lights::sample::<f32, AllLights>(&row, lanes(origin), [0.3, 0.6]);
        assert!(s.delta && s.pdf == 1.0);
        s
    };
    let mut random = Random::new(7);
    let position = [1.0f32, -2.0, 3.0];
    let point = table_of([(EMITTER, lights::Light::Point(PointRow { position, ..PointRow::default() }))]);
    let axis = narrow(normalize([0.2, 0.5, -0.8]));
    let (start, end) = (30f64.to_radians().cos(), 45f64.to_radians().cos());
    let spot = |start: f64, end: f64, fade: f32| {
        let (cos_falloff_start, cos_total_width) = (start as f32, end as f32);
        let row = PointRow { position, axis, cos_falloff_start, cos_total_width, fade };
        table_of([(EMITTER, lights::Light::Spot(row))])
    };
    let (soft, sharp) = (spot(start, end, fade::SMOOTHSTEP), spot(end, end, fade::SMOOTHSTEP));
    let fourth = spot(start, end, fade::FOURTH_POWER);
    // In a space that is stretched.
    let matrix = [[1.0f32, 0.5, 0.0], [0.0, 2.0, 0.25], [-0.5, 0.0, 0.5]];
    let [x, y, z] = matrix;
    let (cos_falloff_start, cos_total_width) = (start as f32, end as f32);
    let row = StretchedSpotRow {
        position,
        x,
        y,
        z,
        axis,
        cos_falloff_start,
        cos_total_width,
        fade: fade::SMOOTHSTEP,
    };
    let stretched = table_of([(EMITTER, lights::Light::StretchedSpot(row))]);
    for _ in 0..5_000 {
        let origin = wide(narrow(random.point(10.0)));
        let to = sub(wide(position), origin);
        let (d2, towards) = (dot(to, to), normalize(to));
        let s = sample(&point, origin);
        assert!(s.valid && length(sub(array(s.direction), towards)) < 5e-7);
        for (got, intensity) in s.radiance.lane(0).into_iter().zip(RADIANCE) {
            assert!((got as f64 / (intensity as f64 / d2) - 1.0).abs() < 1e-6);
        }
        let distance = d2.sqrt();
        assert!((s.distance as f64) < distance && s.distance as f64 > 0.999 * distance);
        // Smoothstep between the cosines.
        let cos = -dot(towards, wide(axis));
        let x = ((cos - end) / (start - end)).clamp(0.0, 1.0);
        let want = RADIANCE[0] as f64 / d2 * x * x * (3.0 - 2.0 * x);
        let s = sample(&soft, origin);
        let got = if s.valid { s.radiance.r as f64 } else { 0.0 };
        assert!((got - want).abs() < 1e-5 * RADIANCE[0] as f64 / d2, "{got}, not {want}");
        let s = sample(&fourth, origin);
        let got = if s.valid { s.radiance.r as f64 } else { 0.0 };
        let want = RADIANCE[0] as f64 / d2 * x.powi(4);
        assert!((got - want).abs() < 1e-5 * RADIANCE[0] as f64 / d2, "fourth power: {got}, not {want}");
        let inside = normalize(matrix.map(|row| dot(wide(row), towards)));
        let x = ((-dot(inside, wide(axis)) - end) / (start - end)).clamp(0.0, 1.0);
        let want = RADIANCE[0] as f64 / d2 * x * x * (3.0 - 2.0 * x);
        let s = sample(&stretched, origin);
        assert!(length(sub(array(s.direction), towards)) < 5e-7);
        let got = if s.valid { s.radiance.r as f64 } else { 0.0 };
        assert!((got - want).abs() < 1e-5 * RADIANCE[0] as f64 / d2, "stretched: {got}, not {want}");
        let s = sample(&sharp, origin);
        if (cos - end).abs() > 1e-6 {
            assert_eq!(s.valid && s.radiance.r > 0.0, cos > end);
        }
    }
    assert!(!sample(&point, wide(position)).valid, "at the point light itself");
    let distant = table_of([(EMITTER, lights::Light::Distant(DistantRow { direction: [0.6, 0.0, 0.8] }))]);
    let s = sample(&distant, [5.0, 6.0, 7.0]);
    assert!(s.valid && s.distance == f32::INFINITY && s.direction.lane(0) == [0.6, 0.0, 0.8]);
    assert_eq!(s.radiance.lane(0), RADIANCE);
}

fn lights_of_power(power: &[f64]) -> LightTable {
    table_of(
        power.iter().map(|&power| (Emitter { power, ..EMITTER }, lights::Light::Point(PointRow::default()))),
    )
}

fn probability(table: &LightTable, light: usize) -> f64 {
    // SAFETY: callers name lights of the table.
    unsafe { table.row::<f32>(Wrapping(light as u32)) }.probability() as f64
}

/// The light that these bits choose.
fn chosen(table: &LightTable, bits: Wrapping<u32>) -> usize {
    assert!(!table.is_empty());
    // SAFETY: there is a light.
    unsafe { table.choose(bits) }.0 as usize
}

/// How many of the 2^32 values of the bits choose each light: counted by bisection, as an entry of the alias table
/// gives its own light first and the other one after.
fn census(table: &LightTable) -> Vec<u64> {
    let n = table.len() as u64;
    let mut counts = vec![0u64; table.len()];
    let chosen = |bits: u64| chosen(table, Wrapping(bits as u32));
    for entry in 0..n {
        let (begin, end) = ((entry << 32).div_ceil(n), ((entry + 1) << 32).div_ceil(n));
        let first = chosen(begin);
        // First value that chooses another light.
        let (mut low, mut high) = (begin, end);
        while high - low > 1 {
            let middle = (low + high) / 2;
            if chosen(middle) == first { low = middle } else { high = middle }
        }
        counts[first] += high - begin;
        if high < end {
            counts[chosen(high)] += end - high;
        }
    }
    assert_eq!(counts.iter().sum::<u64>(), 1 << 32);
    counts
}

#[test]
fn lights_are_chosen_with_their_probability() {
    let mut random = Random::new(8);
    let many: Vec<f64> = (0..1000).map(|_| random.magnitude(1e-3, 1e3)).collect();
    let mut sparse = vec![0.0; 1000];
    (sparse[17], sparse[500], sparse[999]) = (1.0, 2.0, 3.0);
    let lamp_and_sun = vec![1e-3, 1e5, 1.0];
    let extreme: Vec<f64> = (0..100).map(|_| random.magnitude(1e-6, 1e6)).collect();
    for (what, power) in [
        ("one", vec![5.0]),
        ("one dark", vec![0.0]),
        ("equal", vec![1.0, 1.0]),
        ("two", vec![1.0, 3.0]),
        ("dark and bright", vec![0.0, 1.0]),
        ("thousand", many),
        ("sparse", sparse),
        ("lamp and sun", lamp_and_sun),
        ("extreme", extreme),
    ] {
        let table = lights_of_power(&power);
        let total: f64 = power.iter().sum();
        let counts = census(&table);
        let mut sum = 0.0;
        for (i, &count) in counts.iter().enumerate() {
            let (stated, real) = (probability(&table, i), count as f64 / 2f64.powi(32));
            sum += stated;
            // What an estimate divides by is exactly how often it is made, or the light would be too bright or dark.
            assert!(
                (stated / real - 1.0).abs() < 1e-6 || stated == real,
                "{what}: light {i}: {stated}, really {real}"
            );
            let share = if total > 0.0 { power[i] / total } else { 1.0 / power.len() as f64 };
            assert_eq!(count == 0, share == 0.0, "{what}: light {i} of share {share} has {count} chances");
            assert!(
                (real - share).abs() < 1e-3 * share + 1e-9 * power.len() as f64,
                "{what}: {real}, share {share}"
            );
        }
        assert!((sum - 1.0).abs() < 1e-5, "{what}: probabilities sum to {sum}");
        // And with random bits.
        let mut observed = vec![0; power.len()];
        for index in 0..100_000 {
            let stream = Stream { seed: stream_seed(1, Wrapping(index), 0), index: Wrapping(0) };
            observed[chosen(&table, Independent::bits(stream, Wrapping(4)))] += 1;
        }
        let expected: Vec<f64> = (0..power.len()).map(|i| 1e5 * probability(&table, i)).collect();
        assert_distributed(what, &observed, &expected, 9);
    }
}

#[test]
fn lights_that_cannot_be_sampled_are_not_chosen() {
    for power in [[5.0, 1.0], [5.0, 0.0], [0.0, 0.0], [f64::NAN, f64::INFINITY]] {
        let [chance, sampled] = power.map(|power| Emitter { power, ..EMITTER });
        let table = table_of([
            (chance, lights::Light::Unsampled(NoRow)),
            (sampled, lights::Light::Sphere(SphereRow::default())),
        ]);
        assert_eq!(census(&table), [0, 1 << 32]);
        assert_eq!((probability(&table, 0), probability(&table, 1)), (0.0, 1.0));
    }
}

// -------------------------------------------------------------------------- both strategies, by the path step

#[derive(Clone, Copy)]
struct Plan<L, S>(PhantomData<(L, S)>);
impl<L: LightKinds, S: Sampler> Features for Plan<L, S> {
    type Sampler = S;
    type Lights = L;
    type General = Self;
    type Specular = Self;
}

fn scene_of(light: &Light, materials: MaterialTable) -> Scene {
    let axis = || FilterAxis::constant(0.5);
    let camera = Camera::new(CameraParts {
        origin: [0.0; 3],
        corner: [0.0, 0.0, 1.0],
        right: [1.0, 0.0, 0.0],
        down: [0.0, 1.0, 0.0],
        lens: None,
        filter: Filter::new([axis(), axis()]).unwrap(),
    })
    .unwrap();
    Scene::new(SceneParts {
        camera,
        geometry: Geometry::default(),
        materials,
        textures: Default::default(),
        lights: light.table.clone(),
        environment: [0.0; 3],
        max_depth: 5,
    })
    .unwrap()
}

/// Light that a surface at the origin, seen from `wo`, reflects from one light: shadow ray and scattered ray of the
/// path step together.
fn reflected<M: Material, P: Features>(light: &Light, material: M, wo: [f64; 3]) -> Mean {
    let mut materials = MaterialTable::default();
    let handle = materials.add(&material).unwrap();
    let scene = scene_of(light, materials);
    // SAFETY: the table has this material.
    let bsdf = M::bsdf::<f32>(unsafe { scene.materials().evaluate::<M, f32>(Wrapping(handle.row)) });
    let up = Vec3::new(0.0, 0.0, 1.0);
    // A size of 0: rays start at the origin itself, so that analytic values are exact.
    let surface = Surface { point: Vec3::zero(), normal: up, shading_normal: up, error: 0.0f32 };
    Mean::of((0..60_000u32).map(|sample| {
        let stream = Stream { seed: stream_seed(3, Wrapping(sample), 0), index: Wrapping(sample & 7) };
        let vertex = Vertex {
            surface,
            tangent: Vec3::zero(),
            direction: -lanes::<f32>(wo),
            throughput: Rgb::all(1.0),
            eta_scale: 1.0,
            stream,
            depth: Wrapping(0),
        };
        let out = scatter::<f32, M::Bsdf<f32>, P, _>(InPlace, &scene, &vertex, &bsdf);
        let mut sum = if out.shadow.valid { out.shadow.radiance.r as f64 } else { 0.0 };
        if out.throughput.r > 0.0 {
            let d = array(out.direction);
            if let Some((t, n)) = light.meet([0.0; 3], d) {
                // SAFETY: light 0 exists.
                let found = unsafe {
                    emitted::<f32, P::Lights>(
                        &scene,
                        Wrapping(0),
                        out.origin,
                        out.direction,
                        t as f32,
                        lanes(n),
                        out.pdf,
                    )
                };
                sum += (out.throughput.r * found.r) as f64;
            }
        }
        sum
    }))
}

/// From within, a sphere fills all directions: it is not sampled, and the ray that the surface scatters finds it with
/// its full weight.
#[test]
fn a_sphere_around_everything_is_left_to_the_bsdf() {
    let mut random = Random::new(10);
    let grey = Lambert { reflectance: [0.5; 3].into() };
    let wo = normalize([0.5, 0.1, 0.6]);
    for origin in WITHIN {
        for (radius, two_sided) in [(-1.0, false), (1.0, true), (1.0, false)] {
            let light = Light::new(Sphere([0.0; 3], radius), two_sided);
            for _ in 0..1_000 {
                assert!(!light.sample::<f32>(origin, [random.unit(), random.unit()]).valid);
                assert!(!light.sample::<f64>(origin, [random.unit(), random.unit()]).valid);
                let d = random.direction();
                assert_eq!((light.density::<f32>(origin, d), light.density::<f64>(origin, d)), (0.0, 0.0));
            }
            // The path step starts at the origin: the sphere goes there instead.
            let light = Light::new(Sphere(narrow(scale(origin, -1.0)), radius), two_sided);
            let shines = radius < 0.0 || two_sided;
            let want = if shines { 0.5 * RADIANCE[0] as f64 } else { 0.0 };
            let what = format!("Lambert at {origin:?} within radius {radius}, two-sided {two_sided}");
            reflected::<Lambert, Plan<AllLights, Independent>>(&light, grey, wo)
                .assert_near(&what, want, 1e-6);
            reflected::<Lambert, Plan<Spheres, Sobol>>(&light, grey, wo).assert_near(&what, want, 1e-6);
        }
    }
}

#[test]
fn both_strategies_together_are_unbiased() {
    let wo = normalize([0.5, 0.1, 0.6]);
    let wo = wide(narrow(wo));
    let radiance = RADIANCE[0] as f64;
    let grey = Lambert { reflectance: [0.5; 3].into() };
    for (shape, two_sided) in [
        (Sphere([0.0, 0.0, 1.2], 1.0), false),
        (Sphere([0.3, 0.4, 5.0], 1.0), false),
        (Sphere([0.3, 0.4, 500.0], 1.0), false),
        (Sphere([0.1, 0.0, 0.2], -1.0), false),
        (Triangle([-1.0, -1.0, 1.0], [0.0, 3.0, 0.2], [2.0, 0.0, 0.0]), false),
        (Triangle([-1.0, -1.0, 1.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.2]), true),
        (Disk([0.0, 0.0, 0.5], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]), false),
        (
            Tube(CylinderRow {
                base: [-0.8, 0.1, 1.0],
                axis: [1.6, 0.2, 0.4],
                first: narrow(scale(tangents(normalize([1.6, 0.2, 0.4]))[0], 0.4)),
                turns: 1.0,
                side: 1.0,
            }),
            false,
        ),
    ] {
        let light = Light::new(shape, two_sided);
        // What is reflected, by quadrature over the light's directions.
        let quadrature = |eval: &dyn Fn([f64; 3]) -> f64| -> f64 {
            light
                .map([0.0; 3])
                .integrals(|d| match light.meet([0.0; 3], d) {
                    Some((_, n)) if d[2] > 0.0 && (two_sided || dot(n, d) < 0.0) => radiance * eval(d),
                    _ => 0.0,
                })
                .iter()
                .sum()
        };
        let want = quadrature(&|d| 0.5 / PI * d[2]);
        let what = format!("Lambert under {shape:?}");
        let lambert = |light: &Light| reflected::<Lambert, Plan<AllLights, Independent>>(light, grey, wo);
        lambert(&light).assert_near(&what, want, 2e-4);
        reflected::<Lambert, Plan<AllLights, Sobol>>(&light, grey, wo).assert_near(&what, want, 2e-4);
        if let Sphere(..) = shape {
            // As scenes with nothing but such spheres are rendered, and by area.
            reflected::<Lambert, Plan<Spheres, Sobol>>(&light, grey, wo).assert_near(&what, want, 2e-4);
            lambert(&Light::new(by_area(shape), two_sided)).assert_near(&format!("{what}, area"), want, 2e-4);
        }
        // Without light sampling: the same, more noise.
        let alone = reflected::<Lambert, Plan<NoLights, Independent>>(&light, grey, wo);
        if want > 0.01 {
            alone.assert_near(&format!("{what}, BSDF alone"), want, 2e-4);
        }
        for alpha in [0.05, 0.3] {
            let rough = RoughConductor { eta: [0.2; 3].into(), k: [3.0; 3].into(), alpha: alpha.into() };
            let mut table = MaterialTable::default();
            let row = table.add(&rough).unwrap().row;
            // SAFETY: the table has this material.
            let oracle =
                RoughConductor::bsdf::<f64>(unsafe { table.evaluate::<RoughConductor, f64>(Wrapping(row)) });
            let want = quadrature(&|d| oracle.eval(lanes(wo), lanes(d)).r);
            let got = reflected::<RoughConductor, Plan<AllLights, Independent>>(&light, rough, wo);
            got.assert_near(&format!("rough conductor {alpha} under {shape:?}"), want, 1e-3);
        }
    }
}

// -------------------------------------------------------------------------- the table of kinds

#[test]
fn kinds_have_bits_and_names_of_their_own() {
    let mut all = 0;
    for (k, one) in LightKind::ALL.into_iter().enumerate() {
        assert_eq!(one.bit().count_ones(), 1);
        assert_eq!(all & one.bit(), 0);
        all |= one.bit();
        assert!(LightKind::ALL[..k].iter().all(|other| other.name() != one.name()));
    }
    assert_eq!(all, kind::ALL);
    assert_eq!(kind::ALL & !kind::SAMPLED, kind::UNSAMPLED);
    let points = kind::POINT
        | kind::SPOT
        | kind::STRETCHED_SPOT
        | kind::GONIOMETRIC
        | kind::PICTURE_POINT
        | kind::DISTANT;
    assert_eq!(kind::ALL & !kind::SURFACES, points | kind::ENVIRONMENT);
}

#[test]
fn engines_get_the_smallest_set_that_holds_all_kinds() {
    struct Set;
    impl WithLights for Set {
        type Output = u32;
        fn run<L: LightKinds>(self) -> u32 {
            assert_eq!(L::KINDS & !<L::General as LightKinds>::KINDS, 0, "the general set holds less");
            L::KINDS
        }
    }
    assert_eq!(with_lights(0, Set), 0);
    assert_eq!(with_lights(kind::SPHERE, Set), kind::SPHERE);
    for kind in LightKind::ALL.into_iter().filter(|&k| k != LightKind::Sphere) {
        assert_eq!(with_lights(kind.bit(), Set), kind::ALL);
        assert_eq!(with_lights(kind.bit() | kind::SPHERE, Set), kind::ALL);
    }
    // Bits of no kind.
    assert_eq!(with_lights(u32::MAX, Set), kind::ALL);
}

#[test]
fn what_is_no_light_is_refused() {
    let error = |emitter: Emitter, light: lights::Light| {
        let mut list = LightList::default();
        list.push(EMITTER, lights::Light::Point(PointRow::default()));
        list.push(emitter, light);
        match LightTable::new(list) {
            Err(BuildError::Number { of: "light", id: 1, what }) => what,
            other => panic!("{other:?}"),
        }
    };
    let point = lights::Light::Point(PointRow::default());
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        error(Emitter { radiance: [0.0, bad, 0.0], ..EMITTER }, point);
    }
    for bad in [f32::NAN, f32::NEG_INFINITY] {
        error(EMITTER, lights::Light::Sphere(SphereRow { centre: [0.0; 3], radius: bad }));
        error(EMITTER, lights::Light::Distant(DistantRow { direction: [0.0, bad, 1.0] }));
    }
    // Powers that are no numbers count for nothing.
    let table = lights_of_power(&[f64::NAN, 1.0, f64::INFINITY, -1.0]);
    assert_eq!(census(&table), [0, 1 << 32, 0, 0]);
}

// -------------------------------------------------------------------------- goniometric

/// The batwing: brightest at 60 degrees, dark behind; and its integral over directions.
#[test]
fn the_batwing_has_its_shape_and_its_integral() {
    let at = |degrees: f64| goniometric::pattern::<f64>(degrees.to_radians().cos());
    assert!((at(0.0) - 0.125).abs() < 1e-12 && (at(60.0) - 1.0).abs() < 1e-12);
    assert_eq!((at(91.0), at(180.0), goniometric::pattern::<f32>(0.0)), (0.0, 0.0, 0.0));
    // Continuous, nowhere steeper than at 60 degrees (3 tan 60 a radian), and never above 1.
    let mut last = at(0.0);
    for k in 1..=1800 {
        let next = at(k as f64 / 10.0);
        assert!((next - last).abs() < 9.1e-3 && (0.0..=1.0 + 1e-12).contains(&next));
        last = next;
    }
    const N: usize = 1_000_000;
    let mean: f64 =
        (0..N).map(|k| goniometric::pattern::<f64>(2.0 * (k as f64 + 0.5) / N as f64 - 1.0)).sum::<f64>()
            / N as f64;
    assert!((4.0 * PI * mean / goniometric::INTEGRAL - 1.0).abs() < 1e-9);
}

/// On a plane across the axis all points within 60 degrees get as much light.
#[test]
fn the_batwing_lights_a_plane_evenly() {
    let height = 2.5f32;
    let axis = [0.0, 0.0, -1.0];
    let row = GoniometricRow { position: [1.0, -2.0, height], axis };
    let table = table_of([(EMITTER, lights::Light::Goniometric(row))]);
    // SAFETY: the table has one light.
    let light = unsafe { table.row::<f32>(Wrapping(0)) };
    let mut random = Random::new(77);
    for _ in 0..10_000 {
        let origin = wide(narrow([20.0 * random.unit() - 10.0, 20.0 * random.unit() - 10.0, 0.0]));
        let s = lights::sample::<f32, AllLights>(&light, lanes(origin), [0.3, 0.6]);
        let across = length([origin[0] - 1.0, origin[1] + 2.0, 0.0]);
        let degrees = (across / height as f64).atan().to_degrees();
        assert!(s.delta && s.pdf == 1.0 && s.valid);
        let irradiance = s.radiance.r as f64 * array(s.direction)[2];
        let even = RADIANCE[0] as f64 / 8.0 / (height as f64).powi(2);
        if degrees < 59.99 {
            assert!((irradiance / even - 1.0).abs() < 2e-6, "{irradiance} at {degrees} degrees, not {even}");
        } else if degrees > 60.01 {
            assert!(irradiance < even);
        }
        assert!((s.distance as f64) < across.hypot(height as f64));
    }
    // Behind it there is none.
    let s = lights::sample::<f32, AllLights>(&light, lanes([1.0, 0.0, 4.0]), [0.3, 0.6]);
    assert!(!s.valid);
    // Nor at the light itself.
    assert!(!lights::sample::<f32, AllLights>(&light, lanes([1.0, -2.0, 2.5]), [0.3, 0.6]).valid);
}
