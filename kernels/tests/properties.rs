//! Properties of the geometric and BSDF routines for inputs that nobody picked: energy, reciprocity, samples that agree
//! with their values and densities, numbers for all finite inputs, points on their surfaces within the bound that is
//! stated for them.
//!
//! What is right is computed in double precision, which is 2^29 times finer. The inputs are the same in every run: what
//! passes today passes tomorrow.

use core::f64::consts::TAU;
use core::num::Wrapping;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, RngSeed};
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, Closest, Hit, sphere};
use wavepath_kernels::isa::Level;
use wavepath_kernels::lanes::Uint;
use wavepath_kernels::math::{
    Frame, Rgb, Vec3, cosine_hemisphere, power_heuristic, uniform_disk, uniform_sphere,
};
use wavepath_kernels::scene::lights::{self, AllLights, Emitter, Light, LightList, LightTable, SphereRow};
use wavepath_kernels::scene::{Geometry, GeometryParts, MISS, MaterialTable};
use wavepath_kernels::shade::bsdf::Bsdf;
use wavepath_kernels::shade::fresnel;
use wavepath_kernels::shade::materials::{
    Conductor, Dielectric, Lambert, Material, OrenNayar, RoughConductor, ThinDielectric,
};
use wavepath_kernels::shade::surface::Surface;

/// Half of a unit in the last place of 1.
const ROUNDING: f64 = f32::EPSILON as f64 / 2.0;

fn config(cases: u32) -> Config {
    Config {
        cases,
        rng_algorithm: RngAlgorithm::ChaCha,
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..Config::default()
    }
}

// Inputs.

/// A number between two magnitudes, uniform in the logarithm.
fn magnitude(low: f64, high: f64) -> impl Strategy<Value = f32> {
    (low.ln()..high.ln()).prop_map(|x| x.exp() as f32)
}
/// A uniform number as the samplers make them, the ends of the interval often.
fn uniform() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => (0u32..1 << 24).prop_map(|bits| bits as f32 / 16_777_216.0),
        1 => Just(0.0f32),
        1 => Just(1.0 - 1.0 / 16_777_216.0),
    ]
}
fn two() -> impl Strategy<Value = [f32; 2]> {
    [uniform(), uniform()]
}
/// A direction above the surface, grazing ones often.
fn above() -> impl Strategy<Value = [f32; 3]> {
    let cos = prop_oneof![3 => 1e-3f64..1.0, 1 => (1e-10f64.ln()..0.0f64).prop_map(f64::exp), 1 => Just(1.0)];
    (cos, 0.0..TAU).prop_map(|(cos, phi)| {
        let sin = (1.0 - cos * cos).sqrt();
        [(sin * phi.cos()) as f32, (sin * phi.sin()) as f32, cos as f32]
    })
}
/// A direction on the unit sphere.
fn direction() -> impl Strategy<Value = [f64; 3]> {
    (-1.0..=1.0f64, 0.0..TAU).prop_map(|(z, phi)| {
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    })
}
fn rgb(low: f32, high: f32) -> impl Strategy<Value = [f32; 3]> {
    let channel = move || prop_oneof![6 => low..=high, 1 => Just(low), 1 => Just(high)];
    [channel(), channel(), channel()]
}
/// A complex index: ordinary metals, and extreme ones.
fn index() -> impl Strategy<Value = ([f32; 3], [f32; 3])> {
    let eta = || prop_oneof![4 => magnitude(0.03, 5.0), 1 => magnitude(1e-12, 1e15), 1 => Just(1.0f32)];
    let k = || prop_oneof![4 => magnitude(0.1, 10.0), 1 => magnitude(1e-12, 1e15), 1 => Just(0.0f32)];
    ([eta(), eta(), eta()], [k(), k(), k()])
}

// Helpers.

fn vector(v: [f32; 3]) -> Vec3<f32> {
    Vec3::splat(v)
}
fn wide(v: [f32; 3]) -> [f64; 3] {
    v.map(f64::from)
}
fn narrow(v: [f64; 3]) -> [f32; 3] {
    v.map(|x| x as f32)
}
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
fn bsdf<M: Material>(material: &M) -> M::Bsdf<f32> {
    let mut table = MaterialTable::default();
    let handle = table.add(material).unwrap();
    // SAFETY: the table has this material.
    M::bsdf::<f32>(unsafe { table.evaluate::<M, f32>(Uint::splat(handle.row)) })
}
fn channels(c: Rgb<f32>) -> [f32; 3] {
    [c.r, c.g, c.b]
}

/// A sample is a unit direction with numbers that are none below 0, and no more than `most` of the light.
fn assert_sample<M: Material>(
    material: &M,
    wo: [f32; 3],
    u: [f32; 2],
    most: f32,
) -> Result<(), TestCaseError> {
    let s = bsdf(material).sample(vector(wo), u[0], u);
    if !s.valid {
        return Ok(());
    }
    let wi = wide(s.wi.lane(0));
    prop_assert!((dot(wi, wi) - 1.0).abs() < 1e-5, "unit: {wi:?}");
    for weight in channels(s.weight) {
        prop_assert!((0.0..=most * s.eta_scale.recip().max(1.0)).contains(&weight), "weight {weight}");
    }
    prop_assert!(s.pdf >= 0.0 && s.pdf.is_finite(), "density {}", s.pdf);
    Ok(())
}

/// Value over density is the weight, and the density that comes with the sample that of the direction, within `bound`.
fn assert_consistent<M: Material>(
    material: &M,
    wo: [f32; 3],
    u: [f32; 2],
    bound: impl Fn(f32) -> f32,
) -> Result<(), TestCaseError> {
    let bsdf = bsdf(material);
    let wo = vector(wo);
    let s = bsdf.sample(wo, u[0], u);
    if !s.valid || s.wi.z < 1e-4 {
        return Ok(());
    }
    let (pdf, bound) = (bsdf.pdf(wo, s.wi), bound(s.wi.z));
    prop_assert!((s.pdf - pdf).abs() <= bound * pdf, "densities {} and {pdf}, bound {bound}", s.pdf);
    let (value, weight) = (channels(bsdf.eval(wo, s.wi)), channels(s.weight));
    for c in 0..3 {
        let ratio = value[c] / pdf;
        prop_assert!((weight[c] - ratio).abs() <= bound * (ratio + 1e-6), "{} and {ratio}", weight[c]);
    }
    Ok(())
}

/// f(a, b) = f(b, a), within a share.
fn assert_reciprocal<M: Material>(
    material: &M,
    a: [f32; 3],
    b: [f32; 3],
    bound: f64,
) -> Result<(), TestCaseError> {
    let bsdf = bsdf(material);
    let (va, vb) = (vector(a), vector(b));
    let (ab, ba) = (channels(bsdf.eval(va, vb)), channels(bsdf.eval(vb, va)));
    for c in 0..3 {
        let (f, g) = (f64::from(ab[c]) / f64::from(b[2]), f64::from(ba[c]) / f64::from(a[2]));
        prop_assert!(f.is_finite() && g.is_finite() && f >= 0.0, "{f} {g}");
        prop_assert!((f - g).abs() <= bound * (f + g) + 1e-20, "{f} and {g}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(config(4000))]

    #[test]
    fn lambert_and_oren_nayar(
        albedo in rgb(0.0, 1.0), sigma in 0.0f32..=90.0, wo in above(), wi in above(), u in two()
    ) {
        let smooth = Lambert { reflectance: albedo.into() };
        let rough = OrenNayar { reflectance: albedo.into(), sigma: sigma.into() };
        assert_sample(&smooth, wo, u, 1.0)?;
        // A + B sin tan, at most A + B / cos of the steeper direction's: single weights are above 1.
        assert_sample(&rough, wo, u, 1.0 + 0.45 / wo[2].max(1e-7))?;
        assert_consistent(&smooth, wo, u, |_| 1e-6)?;
        assert_consistent(&rough, wo, u, |_| 1e-6)?;
        assert_reciprocal(&smooth, wo, wi, 1e-6)?;
        assert_reciprocal(&rough, wo, wi, 1e-6)?;
    }

    #[test]
    fn conductors(
        (eta, k) in index(), alpha in magnitude(1e-3, 1.0), wo in above(), wi in above(), u in two()
    ) {
        assert_sample(&Conductor { eta: eta.into(), k: k.into() }, wo, u, 1.0 + 1e-6)?;
        let row = RoughConductor { eta: eta.into(), k: k.into(), alpha: alpha.into() };
        assert_sample(&row, wo, u, 1.0 + 1e-5)?;
        // An index of about 1 reflects little, the difference of two numbers of about 1, whose rounding the bound does not
        // know; above 5 % it does.
        let reflects = |(eta, k): (&f32, &f32)| (eta - 1.0).powi(2) + k * k > 0.25;
        let reflects = eta.iter().zip(&k).all(reflects);
        // The half vector is found again from directions that are unit but for rounding: relative to the width of the
        // lobe, and stretched by grazing angles.
        let bound = |cos_i: f32| 4e-6 * (1.0 + 1.0 / (alpha * (wo[2] + cos_i)));
        if wo[2] > 1e-3 && reflects {
            assert_consistent(&row, wo, u, bound)?;
        }
        let bound = 4e-6 * f64::from(1.0 + 1.0 / (alpha * (wo[2] + wi[2])));
        if bound < 0.1 && reflects {
            assert_reciprocal(&row, wo, wi, bound)?;
        }
    }

    #[test]
    fn dielectrics(eta in magnitude(1e-3, 1e3), wo in above(), below in any::<bool>(), u in two()) {
        let wo = if below { [wo[0], wo[1], -wo[2]] } else { wo };
        // Radiance grows by eta^2 on its way into the denser side.
        let most = (eta * eta).max(1.0 / (eta * eta)) * (1.0 + 1e-5);
        let (reflectance, transmittance) = ([1.0; 3].into(), [1.0; 3].into());
        assert_sample(&Dielectric { eta: eta.into(), reflectance, transmittance }, wo, u, most)?;
        assert_sample(&ThinDielectric { eta: eta.into() }, wo, u, 1.0 + 1e-6)?;
    }

    #[test]
    fn fresnel_is_a_share(cos in 0.0f32..=1.0, eta in magnitude(1e-6, 1e6), (n, k) in index()) {
        let (reflected, cos_t, total) = fresnel::dielectric::<f32>(cos, eta);
        prop_assert!((0.0..=1.0).contains(&reflected) && (0.0..=1.0 + 1e-6).contains(&cos_t));
        prop_assert!(!total || reflected == 1.0);
        for r in channels(fresnel::conductor::<f32>(cos, Rgb { r: n[0], g: n[1], b: n[2] }, Rgb { r: k[0], g: k[1], b: k[2] })) {
            prop_assert!((0.0..=1.0 + 1e-6).contains(&r), "{r}");
        }
    }

    #[test]
    fn frames_are_orthonormal(n in direction()) {
        let frame = Frame::from_normal(vector(narrow(n)));
        let [s, t, n] = [frame.s, frame.t, frame.n].map(|v| wide(v.lane(0)));
        for (a, b, expected) in [(s, s, 1.0), (t, t, 1.0), (s, t, 0.0), (s, n, 0.0), (t, n, 0.0)] {
            prop_assert!((dot(a, b) - expected).abs() < 1e-6, "{s:?} {t:?} {n:?}");
        }
    }

    #[test]
    fn shapes_stay_within_themselves(u in two()) {
        let unit = |v: Vec3<f32>| (f64::from(v.length2()) - 1.0).abs() < 2e-6;
        prop_assert!(unit(uniform_sphere(u)));
        let hemisphere = cosine_hemisphere(u);
        prop_assert!(unit(hemisphere) && hemisphere.z >= 0.0);
        let (x, y) = uniform_disk::<f32>(u);
        prop_assert!(x * x + y * y <= 1.0 + 1e-6);
    }

    #[test]
    fn weights_of_two_strategies_add_up(a in magnitude(1e-37, 1e37), b in magnitude(1e-37, 1e37)) {
        let (one, other) = (power_heuristic(a, b), power_heuristic(b, a));
        prop_assert!((one + other - 1.0).abs() < 1e-6, "{one} {other}");
    }

    /// The point where a ray meets a sphere is as far from the centre as the radius, but for some roundings of the
    /// distance to the centre.
    #[test]
    fn rays_meet_spheres_on_them(
        centre in [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0],
        radius in magnitude(1e-4, 1e4),
        far in magnitude(1e-3, 1e5),
        from in direction(), to in direction(), reach in 0.0f64..0.999,
    ) {
        let r = f64::from(radius);
        let origin = narrow(core::array::from_fn(|k| f64::from(centre[k]) + r * f64::from(far) * from[k]));
        // Aimed at a point within the sphere.
        let target: [f64; 3] = core::array::from_fn(|k| f64::from(centre[k]) + reach * r * to[k]);
        let d = sub(target, wide(origin));
        let d = narrow(d.map(|x| x / length(d)));
        let f = sub(wide(origin), wide(centre));
        let (t, hit) = sphere::intersect::<f32>(origin, d, centre, radius, f32::INFINITY);
        // Rays are rounded: what misses by a rounding of the distance misses.
        let near = length(cross(f, wide(d)));
        let blur = 8.0 * ROUNDING * (length(f) + r);
        if near < r - blur && length(f) > r + blur {
            prop_assert!(hit, "lost: {near} of {r}");
        }
        if hit {
            let point: [f64; 3] = core::array::from_fn(|k| f[k] + f64::from(t) * f64::from(d[k]));
            let off = (length(point) - r).abs();
            prop_assert!(off <= blur, "{off} beside a sphere of {r}, bound {blur}");
        }
    }

    /// A ray at the inside of a triangle meets it; the ray that leaves from there starts on its side of the plane.
    #[test]
    fn rays_meet_triangles_and_leave_them(
        a in direction(), b in direction(), c in direction(), scale in magnitude(1e-6, 1e6),
        share in [0.1f64..0.4, 0.1f64..0.4], from in direction(), far in magnitude(0.1, 100.0),
    ) {
        let s = f64::from(scale);
        let corners = [a, b, c].map(|p| narrow(p.map(|x| s * x)));
        let [a, b, c] = corners.map(wide);
        let area = cross(sub(b, a), sub(c, a));
        // Neither slender nor grazed: those are counted in the battery.
        prop_assume!(length(area) > 0.05 * s * s);
        let n = area.map(|x| x / length(area));
        let target: [f64; 3] =
            core::array::from_fn(|k| a[k] + share[0] * (b[k] - a[k]) + share[1] * (c[k] - a[k]));
        let origin = narrow(core::array::from_fn(|k| target[k] + s * f64::from(far) * from[k]));
        let d = sub(target, wide(origin));
        let d = d.map(|x| x / length(d));
        prop_assume!(dot(d, n).abs() > 0.05);
        let d = narrow(d);
        let plane = narrow(n);
        let distance = dot(wide(plane), a) as f32;
        let parts = GeometryParts {
            vertices: corners.to_vec(),
            triangles: vec![[0, 1, 2]],
            planes: vec![[plane[0], plane[1], plane[2], distance]],
            tags: vec![0],
            ..GeometryParts::default()
        };
        let geometry = Geometry::new(parts).unwrap();
        let tree = Bvh8::new(&geometry);
        let hit: Hit = Level::detect().run(Closest {
            accelerator: &tree,
            origin,
            direction: d,
            stack: &mut tree.stack(),
        });
        prop_assert!(hit.primitive != MISS, "lost");
        // SAFETY: there is one primitive.
        let surface = unsafe {
            Surface::<f32>::new(&geometry, Wrapping(0), vector(origin), vector(d), hit.t, || (hit.u, hit.v))
        };
        for sign in [1.0f32, -1.0] {
            let way = narrow(n.map(|x| x * f64::from(sign)));
            let start = wide(surface.leave(vector(way)).lane(0));
            // Off the plane of the table; and off the triangle's own, but for the rounding of the table's.
            let height = (dot(wide(plane), start) - f64::from(distance)) * f64::from(sign);
            prop_assert!(height > 0.0 && height < 1e-4 * s, "starts {height} from a triangle of {s}");
            let tilt = (0..3).map(|k| (n[k] * (start[k] - a[k])).abs()).sum::<f64>() + f64::from(distance.abs());
            let height = dot(n, sub(start, a)) * f64::from(sign);
            prop_assert!(height > -0.5 * f64::from(f32::EPSILON) * tilt, "starts {height} from a triangle of {s}");
        }
    }

    /// Directions towards spherical lamps: within the cone, their density that of the cone and of `pdf`, shadow rays short
    /// of the lamp.
    #[test]
    fn spherical_lamps(radius in magnitude(1e-6, 0.999), to in direction(), u in two()) {
        let centre = narrow(to);
        let mut list = LightList::default();
        let emitter = Emitter { radiance: [1.0; 3], two_sided: false, material: 0, power: 1.0 };
        list.push(emitter, Light::Sphere(SphereRow { centre, radius }));
        let table = LightTable::new(list).unwrap();
        // SAFETY: the table has one light.
        let light = unsafe { table.row::<f32>(Wrapping(0)) };
        let s = lights::sample::<f32, AllLights>(&light, Vec3::zero(), u);
        prop_assert!(s.valid && s.pdf > 0.0 && s.pdf.is_finite());
        let (c, r, d) = (wide(centre), f64::from(radius), wide(s.direction.lane(0)));
        prop_assert!((dot(d, d) - 1.0).abs() < 1e-5);
        let x = (r / length(c)).powi(2);
        let density = (1.0 + (1.0 - x).sqrt()) / (TAU * x);
        prop_assert!((f64::from(s.pdf) / density - 1.0).abs() < 1e-5 / (1.0 - x).sqrt());
        let again = lights::pdf::<f32, AllLights>(&light, Vec3::zero(), s.direction, s.distance, -s.direction);
        prop_assert_eq!(s.pdf, again);
        let sine = length(cross(c, d));
        prop_assert!(sine <= r + 4.0 * ROUNDING + 1e-6 * r, "{sine} beside a lamp of {r}");
        let along = dot(c, d) - (r * r - sine * sine).max(0.0).sqrt();
        prop_assert!(f64::from(s.distance) <= along * (1.0 + 4.0 * ROUNDING) + 4.0 * ROUNDING, "{} beyond {along}", s.distance);
    }
}
