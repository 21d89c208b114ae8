//! The materials: sampling against density, value against formula, reciprocity, energy, Fresnel, single against
//! double precision, wide lanes against one.

mod statistics;

use core::f64::consts::{FRAC_1_PI, PI};
use core::num::Wrapping;
use statistics::{Around, Mean, Random, assert_distributed, cross, dot, normalize};
use wavepath_kernels::isa::{Isa, Kernel, Level};
use wavepath_kernels::lanes::{Mask, Real, Uint};
use wavepath_kernels::math::{Rgb, Vec3};
use wavepath_kernels::scene::{MaterialHandle, MaterialTable, PrimitiveTag};
use wavepath_kernels::shade::bsdf::{Bsdf, BsdfSample};
use wavepath_kernels::shade::coated::{Coat, Passage};
use wavepath_kernels::shade::coated_conductor::Layers;
use wavepath_kernels::shade::fresnel;
use wavepath_kernels::shade::materials::{
    AnisotropicConductor, Coated, CoatedConductor, Conductor, Dielectric, DiffuseTransmission, Lambert,
    Listed, Material, MaterialClass, MaterialError, Mirror, OrenNayar, RoughConductor, RoughDielectric,
    ThinDielectric, Uber,
};
use wavepath_kernels::shade::parameters::{BadParameter, Parameter, Parameters, TextureId};

/// One lane, single or double precision.
trait Scalar: Real<Mask = bool, Uint = Wrapping<u32>> + Into<f64> {}
impl Scalar for f32 {}
impl Scalar for f64 {}

/// The lobes of a material, by way of the table: its second material, so that its row does not begin at 0.
fn bsdf<M: Material, F: Real>(material: M) -> M::Bsdf<F> {
    let mut table = MaterialTable::default();
    table.add(&oren_nayar([0.3; 3], 5.0)).unwrap();
    let handle = table.add(&material).unwrap();
    // SAFETY: the table has this material.
    M::bsdf::<F>(unsafe { table.evaluate::<M, F>(F::Uint::splat(handle.row)) })
}

fn lambert(reflectance: [f32; 3]) -> Lambert {
    Lambert { reflectance: reflectance.into() }
}
fn oren_nayar(reflectance: [f32; 3], sigma: f32) -> OrenNayar {
    OrenNayar { reflectance: reflectance.into(), sigma: sigma.into() }
}
fn conductor(eta: [f32; 3], k: [f32; 3]) -> Conductor {
    Conductor { eta: eta.into(), k: k.into() }
}
fn mirror(reflectance: [f32; 3]) -> Mirror {
    Mirror { reflectance: reflectance.into() }
}
fn rough_conductor(eta: [f32; 3], k: [f32; 3], alpha: f32) -> RoughConductor {
    RoughConductor { eta: eta.into(), k: k.into(), alpha: alpha.into() }
}
fn dielectric(eta: f32, reflectance: [f32; 3], transmittance: [f32; 3]) -> Dielectric {
    Dielectric { eta: eta.into(), reflectance: reflectance.into(), transmittance: transmittance.into() }
}
fn thin_dielectric(eta: f32) -> ThinDielectric {
    ThinDielectric { eta: eta.into() }
}
fn diffuse_transmission(reflectance: [f32; 3], transmittance: [f32; 3]) -> DiffuseTransmission {
    DiffuseTransmission { reflectance: reflectance.into(), transmittance: transmittance.into() }
}

fn rough_dielectric(eta: f32, alpha: [f32; 2]) -> RoughDielectric {
    RoughDielectric {
        eta: eta.into(),
        reflectance: [1.0; 3].into(),
        transmittance: [1.0; 3].into(),
        alpha_u: alpha[0].into(),
        alpha_v: alpha[1].into(),
    }
}
fn coated(coat: Coat, reflectance: [f32; 3], specular: [f32; 3], eta: f32, alpha: [f32; 2]) -> Coated {
    layered(coat, reflectance, specular, eta, alpha, (0.01, 5.0))
}
/// With a thickness, and reflections at the base that are followed.
fn layered(
    coat: Coat,
    reflectance: [f32; 3],
    specular: [f32; 3],
    eta: f32,
    alpha: [f32; 2],
    (thickness, orders): (f32, f32),
) -> Coated {
    let passage = Passage::new(coat, eta as f64, alpha.map(f64::from), thickness as f64);
    Coated {
        reflectance: reflectance.into(),
        specular: specular.into(),
        eta: eta.into(),
        alpha_u: alpha[0].into(),
        alpha_v: alpha[1].into(),
        orders: orders.into(),
        coat: coat.number().into(),
        passage: passage.columns().into(),
    }
}

fn brushed(alpha: [f32; 2]) -> AnisotropicConductor {
    let [alpha_u, alpha_v] = alpha.map(Parameter::Constant);
    AnisotropicConductor { eta: GOLD.0.into(), k: GOLD.1.into(), alpha_u, alpha_v }
}
fn uber() -> Uber {
    let [a, b, c] = [[0.1f32, 0.3, 0.2], [0.2, 0.4, 0.3], [0.5, 0.25, 0.4]];
    Uber {
        diffuse: a.into(),
        glossy: c.into(),
        mirrored: a.into(),
        refracted: b.into(),
        opacity: [0.8, 0.7, 0.9].into(),
        reflect: [0.4, 0.5, 0.6].into(),
        transmit: [0.6, 0.5, 0.4].into(),
        eta: 1.4.into(),
        alpha_u: 0.4.into(),
        alpha_v: 0.4.into(),
    }
}

/// Gold, roughly, under a coat.
fn layers_on_gold(alpha: f64, conductor_alpha: f64) -> Layers {
    let index = |c: [f32; 3]| c.map(|x| x as f64 / 1.5);
    Layers {
        eta: 1.5,
        alpha,
        thickness: 0.01,
        conductor_eta: index(GOLD.0),
        conductor_k: index(GOLD.1),
        conductor_alpha,
        orders: 5,
    }
}
fn coated_conductor(layers: Layers) -> CoatedConductor {
    let [once, more] = layers.columns();
    CoatedConductor {
        eta: (layers.eta as f32).into(),
        alpha: (layers.alpha as f32).into(),
        once: once.into(),
        more: more.into(),
    }
}

/// Draws a direction as the path step does.
fn draw<F: Real, B: Bsdf<F>>(bsdf: &B, wo: [f64; 3], random: &mut Random) -> BsdfSample<F> {
    let u = [random.unit(), random.unit()].map(F::lit);
    bsdf.sample(lanes(wo), if B::SPECULAR { u[0] } else { F::lit(random.unit()) }, u)
}

fn lanes<F: Real>(v: [f64; 3]) -> Vec3<F> {
    Vec3::new(F::lit(v[0]), F::lit(v[1]), F::lit(v[2]))
}

fn array<F: Scalar>(v: Vec3<F>) -> [f64; 3] {
    [v.x.into(), v.y.into(), v.z.into()]
}

fn channels<F: Scalar>(c: Rgb<F>) -> [f64; 3] {
    [c.r.into(), c.g.into(), c.b.into()]
}

/// Unit direction at the azimuth 0.7 with this cosine.
fn direction(cos: f64) -> [f64; 3] {
    let sin = (1.0 - cos * cos).sqrt();
    [sin * 0.7f64.cos(), sin * 0.7f64.sin(), cos]
}

/// The direction as single precision has it: both precisions then speak of the same one.
fn single(v: [f64; 3]) -> [f64; 3] {
    v.map(|x| x as f32 as f64)
}

const COSINES: [f64; 5] = [1.0, 0.9, 0.5, 0.1, 0.01];
/// Coats, smooth and rough, some of them wider along one tangent.
fn coats() -> impl Iterator<Item = (String, Coated)> {
    let coats = [
        (Coat::Layered, 1.5, [0.0; 2]),
        (Coat::Layered, 1.33, [0.3; 2]),
        (Coat::Layered, 2.0, [1.0; 2]),
        (Coat::Added, 1.0 / 1.5, [0.4; 2]),
        (Coat::Added, 1.5, [0.25, 0.6]),
        (Coat::Blended, 1.5, [0.7, 0.3]),
        (Coat::Blended, 1.5, [0.5; 2]),
    ];
    coats.into_iter().map(|(coat, eta, alpha)| {
        let material = coated(coat, [0.2, 0.5, 0.9], [0.5, 0.4, 0.25], eta, alpha);
        (format!("{coat:?}, index {eta}, alpha {alpha:?}"), material)
    })
}
const DIELECTRICS: [(f32, [f32; 2]); 5] =
    [(1.5, [0.3; 2]), (1.0 / 1.3, [0.6; 2]), (1.1, [1.0; 2]), (1.7, [0.25, 0.8]), (2.4, [0.5; 2])];
const SIGMAS: [f32; 3] = [10.0, 20.0, 60.0];
const ALPHAS: [f32; 6] = [0.01, 0.03, 0.1, 0.3, 0.6, 1.0];
/// What is reflected diffusely, and what passes diffusely.
const SHARES: [([f32; 3], [f32; 3]); 4] = [
    ([0.25; 3], [0.25; 3]),
    ([0.2, 0.5, 0.9], [0.75, 0.1, 0.05]),
    ([0.0; 3], [0.5, 0.25, 1.0]),
    ([0.6; 3], [0.0; 3]),
];
/// Gold, roughly; and what reflects everything.
const GOLD: ([f32; 3], [f32; 3]) = ([0.18, 0.42, 1.37], [3.42, 2.35, 1.77]);
const PERFECT: ([f32; 3], [f32; 3]) = ([0.0; 3], [1.0; 3]);

fn rough(alpha: f32) -> RoughConductor {
    rough_conductor(GOLD.0, GOLD.1, alpha)
}

/// A map of the sphere in which the density of the material's samples is mild.
fn map_for(wo: [f64; 3], alpha: Option<f32>) -> Around {
    match alpha {
        Some(alpha) if alpha < 0.5 => Around::new([-wo[0], -wo[1], wo[2]], alpha as f64),
        // The horizon is an edge of bins: q = 0.75.
        _ => Around::new([0.0, 0.0, 1.0], (1f64 / 3.0).sqrt()),
    }
}

/// Samples in precision `F` fall into bins as the density, integrated in double precision, says; what it lacks to one
/// is the share of invalid samples.
fn assert_samples<F: Scalar, M: Material>(
    what: &str,
    material: M,
    wo: [f64; 3],
    map: &Around,
    integrals: &[f64],
    family: usize,
) {
    const SAMPLES: usize = 100_000;
    let bsdf = bsdf::<M, F>(material);
    let total: f64 = integrals.iter().sum();
    let mut expected: Vec<f64> = integrals.iter().map(|p| p * SAMPLES as f64).collect();
    expected.push((1.0 - total).max(0.0) * SAMPLES as f64);
    let mut observed = vec![0u64; expected.len()];
    let mut random = Random::new(1);
    for _ in 0..SAMPLES {
        let s = draw(&bsdf, wo, &mut random);
        // A specular lobe beside others has no density.
        let bin = if s.valid && s.pdf.into() > 0.0 { map.bin(array(s.wi)) } else { integrals.len() };
        observed[bin] += 1;
    }
    assert_distributed(what, &observed, &expected, family);
}

/// [`COSINES`], and for materials that are seen from both sides the same on the other.
fn cosines<M: Material>() -> impl Iterator<Item = f64> {
    let behind = COSINES.map(|cos| -cos);
    COSINES.into_iter().chain(behind.into_iter().filter(|_| M::Bsdf::<f64>::TRANSMITS))
}

fn assert_sampling<M: Material>(what: &str, material: M, alpha: Option<f32>, family: usize) {
    let oracle = bsdf::<M, f64>(material);
    for cos in cosines::<M>() {
        let wo = single(direction(cos));
        let what = format!("{what}, cos {cos}");
        let map = map_for(wo, alpha);
        let integrals = map.integrals(|wi| oracle.pdf(lanes(wo), lanes(wi)));
        let total: f64 = integrals.iter().sum();
        assert!(total <= 1.0 + 1e-4, "{what}: density integrates to {total}");
        assert_samples::<f64, M>(&format!("{what}, double"), material, wo, &map, &integrals, 2 * family);
        assert_samples::<f32, M>(&format!("{what}, single"), material, wo, &map, &integrals, 2 * family);
    }
}

#[test]
fn samples_follow_their_density() {
    let sided = 2 * (SHARES.len() + DIELECTRICS.len() + 1);
    let family = (1 + SIGMAS.len() + ALPHAS.len() + sided + coats().count() + 3) * COSINES.len();
    for (what, material) in coats() {
        assert_sampling(&what, material, None, family);
    }
    assert_sampling("uber", uber(), None, family);
    assert_sampling("brushed metal", brushed([0.25, 0.7]), None, family);
    assert_sampling("coated conductor", coated_conductor(layers_on_gold(0.0, 0.5)), None, family);
    assert_sampling("coated conductor", coated_conductor(layers_on_gold(0.5, 0.3)), None, family);
    for (eta, alpha) in DIELECTRICS {
        let what = format!("rough dielectric {eta}, alpha {alpha:?}");
        assert_sampling(&what, rough_dielectric(eta, alpha), None, family);
    }
    assert_sampling::<Lambert>("Lambert", lambert([0.5; 3]), None, family);
    for sigma in SIGMAS {
        let row = oren_nayar([0.5; 3], sigma);
        assert_sampling::<OrenNayar>(&format!("Oren-Nayar {sigma}"), row, None, family);
    }
    for alpha in ALPHAS {
        let what = format!("rough conductor {alpha}");
        assert_sampling::<RoughConductor>(&what, rough(alpha), Some(alpha), family);
    }
    for (reflectance, transmittance) in SHARES {
        let what = format!("diffuse transmission {reflectance:?} {transmittance:?}");
        let material = diffuse_transmission(reflectance, transmittance);
        assert_sampling::<DiffuseTransmission>(&what, material, None, family);
    }
}

/// The weight and the density that come with a sample are those of `eval` and `pdf`.
fn assert_weights<F: Scalar, M: Material>(what: &str, material: M, tolerance: impl Fn(f64, f64) -> f64) {
    let bsdf = bsdf::<M, F>(material);
    let mut random = Random::new(2);
    for _ in 0..20_000 {
        let behind = M::Bsdf::<F>::TRANSMITS && random.unit() < 0.5;
        let wo = direction(random.magnitude(1e-3, 1.0) * if behind { -1.0 } else { 1.0 });
        let s: BsdfSample<F> = draw(&bsdf, wo, &mut random);
        if !s.valid || s.pdf.into() == 0.0 {
            continue;
        }
        let wi = array(s.wi);
        assert!((dot(wi, wi) - 1.0).abs() < 1e-6, "{what}: unit direction {wi:?}");
        let pdf: f64 = bsdf.pdf(lanes(wo), s.wi).into();
        let own: f64 = s.pdf.into();
        let bound = tolerance(wo[2], wi[2]);
        assert!((own / pdf - 1.0).abs() < bound, "{what}: pdf {own} and {pdf} for {wo:?}, {wi:?}");
        let (weight, eval) = (channels(s.weight), channels(bsdf.eval(lanes(wo), s.wi)));
        for c in 0..3 {
            let ratio = eval[c] / pdf;
            assert!(
                (weight[c] - ratio).abs() <= bound * ratio,
                "{what}: weight {} but eval / pdf = {ratio} for {wo:?}, {wi:?}",
                weight[c]
            );
        }
    }
}

#[test]
fn weight_is_value_over_density() {
    assert_weights::<f64, Lambert>("Lambert", lambert([0.2, 0.5, 1.0]), |_, _| 1e-12);
    assert_weights::<f32, Lambert>("Lambert", lambert([0.2, 0.5, 1.0]), |_, _| 1e-6);
    for sigma in SIGMAS {
        let row = oren_nayar([0.2, 0.5, 1.0], sigma);
        assert_weights::<f64, OrenNayar>(&format!("Oren-Nayar {sigma}"), row, |_, _| 1e-12);
        assert_weights::<f32, OrenNayar>(&format!("Oren-Nayar {sigma}"), row, |_, _| 1e-6);
    }
    for alpha in [1e-3, 0.01, 0.1, 0.3, 1.0] {
        // The half vector is found again from directions that are unit but for rounding: relative to the width of
        // the lobe, and stretched by grazing angles.
        let sensitivity = |o: f64, i: f64| 1.0 + 1.0 / (alpha as f64 * (o + i));
        let what = format!("rough conductor {alpha}");
        assert_weights::<f64, RoughConductor>(&what, rough(alpha), |o, i| 1e-14 * sensitivity(o, i) + 1e-12);
        assert_weights::<f32, RoughConductor>(&what, rough(alpha), |o, i| 2e-6 * sensitivity(o, i));
    }
    for (reflectance, transmittance) in SHARES {
        let material = diffuse_transmission(reflectance, transmittance);
        assert_weights::<f64, _>("diffuse transmission", material, |_, _| 1e-12);
        assert_weights::<f32, _>("diffuse transmission", material, |_, _| 1e-6);
    }
}

#[test]
fn weight_is_value_over_density_of_coats_and_rough_glass() {
    let sensitivity = |o: f64, i: f64| 1.0 + 1.0 / (o.abs() + i.abs());
    for (what, material) in coats() {
        assert_weights::<f64, _>(&what, material, |o, i| 1e-12 * sensitivity(o, i));
        assert_weights::<f32, _>(&what, material, |o, i| 4e-6 * sensitivity(o, i));
    }
    assert_weights::<f64, _>("uber", uber(), |o, i| 1e-10 * sensitivity(o, i));
    assert_weights::<f32, _>("uber", uber(), |o, i| 1e-4 * sensitivity(o, i));
    for (eta, alpha) in DIELECTRICS {
        // The half vector of refraction is a difference, of the size of eta - 1.
        let bend = 1.0 / (eta as f64 - 1.0).abs();
        let what = format!("rough dielectric {eta}, alpha {alpha:?}");
        let material = rough_dielectric(eta, alpha);
        assert_weights::<f64, _>(&what, material, |o, i| 1e-10 * bend * sensitivity(o, i));
        assert_weights::<f32, _>(&what, material, |o, i| 1e-4 * (1.0 + bend * bend) * sensitivity(o, i));
    }
}

fn assert_reciprocal<M: Material>(what: &str, material: M) {
    let bsdf = bsdf::<M, f64>(material);
    let transmits = M::Bsdf::<f64>::TRANSMITS;
    let mut random = Random::new(3);
    for _ in 0..2_000 {
        let side = |z: f64| if transmits { z } else { z.abs() };
        let [a, b] = [0; 2].map(|_| random.direction()).map(|[x, y, z]| [x, y, side(z)]);
        let ab = channels(bsdf.eval(lanes(a), lanes(b)));
        let ba = channels(bsdf.eval(lanes(b), lanes(a)));
        for c in 0..3 {
            let (f, g) = (ab[c] / b[2].abs(), ba[c] / a[2].abs());
            assert!((f - g).abs() <= 1e-9 * (f + g), "{what}: {f} and {g} for {a:?}, {b:?}");
        }
        if !transmits {
            assert_eq!(channels(bsdf.eval(lanes(a), lanes([b[0], b[1], -b[2]]))), [0.0; 3], "{what}: below");
            assert_eq!(bsdf.pdf(lanes(a), lanes([b[0], b[1], -b[2]])), 0.0, "{what}: below");
        }
    }
}

#[test]
fn materials_are_reciprocal() {
    assert_reciprocal::<Lambert>("Lambert", lambert([0.2, 0.5, 1.0]));
    for sigma in SIGMAS {
        assert_reciprocal::<OrenNayar>("Oren-Nayar", oren_nayar([0.2, 0.5, 1.0], sigma));
    }
    for alpha in ALPHAS {
        assert_reciprocal::<RoughConductor>("rough conductor", rough(alpha));
    }
    for (reflectance, transmittance) in SHARES {
        assert_reciprocal("diffuse transmission", diffuse_transmission(reflectance, transmittance));
    }
}

/// Of equal roughness along both tangents, brushed metal is rough metal; a turn by a right angle exchanges them.
#[test]
fn brushed_metal_is_rough_metal_stretched() {
    let mut random = Random::new(37);
    let (equal, plain) = (bsdf::<_, f64>(brushed([0.3; 2])), bsdf::<_, f64>(rough(0.3)));
    let [along, across] = [[0.1, 0.4], [0.4, 0.1]].map(|alpha| bsdf::<_, f64>(brushed(alpha)));
    let turned = |[x, y, z]: [f64; 3]| [-y, x, z];
    for _ in 0..2_000 {
        let [wo, wi] = [0; 2].map(|_| random.direction()).map(|[x, y, z]| [x, y, z.abs()]);
        let near =
            |a: f64, b: f64| assert!((a - b).abs() <= 1e-9 * (a + b), "{a}, not {b}, for {wo:?}, {wi:?}");
        near(equal.eval(lanes(wo), lanes(wi)).g, plain.eval(lanes(wo), lanes(wi)).g);
        near(equal.pdf(lanes(wo), lanes(wi)), plain.pdf(lanes(wo), lanes(wi)));
        let [there, back] = [wo, wi].map(turned);
        near(along.eval(lanes(wo), lanes(wi)).r, across.eval(lanes(there), lanes(back)).r);
        near(along.pdf(lanes(wo), lanes(wi)), across.pdf(lanes(there), lanes(back)));
    }
}

#[test]
fn coats_are_reciprocal() {
    assert_reciprocal("coated conductor", coated_conductor(layers_on_gold(0.4, 0.2)));
    assert_reciprocal("brushed metal", brushed([0.1, 0.5]));
    for (what, material) in coats() {
        assert_reciprocal(&what, material);
    }
}

/// Reflection is reciprocal; refraction is when radiance is counted over the squared index (Veach 1997, section 5.2).
#[test]
fn rough_glass_is_reciprocal_but_for_the_index() {
    let mut random = Random::new(31);
    for (eta, alpha) in DIELECTRICS {
        let bsdf = bsdf::<_, f64>(rough_dielectric(eta, alpha));
        let mut refracted = 0;
        for _ in 0..2_000 {
            let [a, b] = [0; 2].map(|_| random.direction());
            let index2 = |w: [f64; 3]| if w[2] > 0.0 { 1.0 } else { (eta as f64).powi(2) };
            // Radiance that comes from wi falls or rises by the index on the side of wo.
            let f = bsdf.eval(lanes(a), lanes(b)).r / b[2].abs() / index2(a);
            let g = bsdf.eval(lanes(b), lanes(a)).r / a[2].abs() / index2(b);
            assert!((f - g).abs() <= 1e-6 * (f + g), "index {eta}: {f} and {g} for {a:?}, {b:?}");
            refracted += (a[2] * b[2] < 0.0 && f > 0.0) as u32;
        }
        assert!(refracted > 20, "index {eta}: {refracted}");
    }
}

/// What is not reflected passes, with the index taken out: all of it where facets are nearly smooth, never more.
#[test]
fn rough_glass_keeps_energy() {
    let mut random = Random::new(32);
    for eta in [1.5f32, 1.0 / 1.5, 1.1, 2.4] {
        for (alpha, least) in [(1e-3, 0.998), (0.05, 0.95), (0.3, 0.65), (1.0, 0.3)] {
            for cos in [0.95, 0.6, 0.3, -0.3, -0.9] {
                let (fast, wo) = (bsdf::<_, f32>(rough_dielectric(eta, [alpha; 2])), single(direction(cos)));
                let mean = Mean::of((0..20_000).map(|_| {
                    let s = draw(&fast, wo, &mut random);
                    if s.valid { (s.weight.r * s.eta_scale) as f64 } else { 0.0 }
                }));
                let got = mean.mean;
                assert!(got < 1.0 + 1e-5 && got > least, "index {eta}, alpha {alpha}, cos {cos}: {got}");
            }
        }
    }
}

/// A walk between the surface of a coat and a diffuse base, as pbrt-v4 takes it: the share of light that comes back, by
/// quarter of the squared cosine. An oracle that knows nothing of the closed form but the microfacets.
fn walk(
    random: &mut Random,
    wo: [f64; 3],
    (albedo, eta, alpha, thickness): (f64, f64, f64, f64),
    orders: u32,
) -> (usize, f64) {
    let coat = |w: [f64; 3], random: &mut Random| -> Option<([f64; 3], f64)> {
        // Above the coat z is positive; a smooth coat is a dielectric.
        if alpha == 0.0 {
            let s = draw(&bsdf::<_, f64>(dielectric(eta as f32, [1.0; 3], [1.0; 3])), w, random);
            return s.valid.then(|| (array(s.wi), s.weight.r * s.eta_scale));
        }
        let s = draw(&bsdf::<_, f64>(rough_dielectric(eta as f32, [alpha as f32; 2])), w, random);
        s.valid.then(|| (array(s.wi), s.weight.r * s.eta_scale))
    };
    let quarter = |w: [f64; 3]| ((w[2] * w[2] * 4.0) as usize).min(3);
    let Some((mut w, mut beta)) = coat(wo, random) else { return (0, 0.0) };
    if w[2] > 0.0 {
        return (quarter(w), beta);
    }
    for _ in 0..orders {
        // Down to the base, and up again by the cosine.
        beta *= (thickness / w[2]).exp() * albedo;
        let (r2, phi) = (random.unit(), random.unit() * 2.0 * PI);
        let up = [r2.sqrt() * phi.cos(), r2.sqrt() * phi.sin(), (1.0 - r2).sqrt()];
        beta *= (-thickness / up[2]).exp();
        // The coat from below: the direction that the light comes from is -up.
        let Some((next, weight)) = coat([-up[0], -up[1], -up[2]], random) else { return (0, 0.0) };
        (w, beta) = (next, beta * weight);
        if w[2] > 0.0 {
            return (quarter(w), beta);
        }
    }
    (0, 0.0)
}

/// The closed form of layers is the mean of the random walk between them.
#[test]
fn layers_are_what_a_walk_between_them_finds() {
    const SAMPLES: usize = 60_000;
    let mut random = Random::new(33);
    for (eta, alpha) in [(1.5, 0.0), (1.5, 0.1), (1.33, 0.5), (1.7, 0.5), (1.5, 1.0)] {
        for (albedo, thickness, orders) in [(0.8, 0.01, 5), (1.0, 0.1, 12)] {
            let layers = (thickness, orders as f32);
            let material = layered(Coat::Layered, [albedo; 3], [1.0; 3], eta, [alpha; 2], layers);
            let closed = bsdf::<_, f32>(material);
            for cos in [0.95, 0.55, 0.15] {
                let wo = single(direction(cos));
                let mut means = [(); 4].map(|()| [Mean::default(), Mean::default()]);
                for _ in 0..SAMPLES {
                    let s = draw(&closed, wo, &mut random);
                    let numbers = (albedo as f64, eta as f64, alpha as f64, thickness as f64);
                    let (at, beta) = walk(&mut random, wo, numbers, orders);
                    for (quarter, [one, other]) in means.iter_mut().enumerate() {
                        let here = s.valid && ((s.wi.z * s.wi.z * 4.0) as usize).min(3) == quarter;
                        one.add(if here { s.weight.r as f64 } else { 0.0 });
                        other.add(if at == quarter { beta } else { 0.0 });
                    }
                }
                for (quarter, [one, other]) in means.iter().enumerate() {
                    let (a, b) = (one.mean, other.mean);
                    let noise = one.standard_error().hypot(other.standard_error());
                    assert!(
                        (a - b).abs() < 4.5 * noise + 3e-3 * b,
                        "index {eta}, alpha {alpha}, albedo {albedo}, cos {cos}, quarter {quarter}: {a}, not {b}"
                    );
                }
            }
        }
    }
}

/// pbrt-v3's plastic and substrate, by their formulas.
#[test]
fn coats_of_version_three_are_their_formulas() {
    let mut random = Random::new(34);
    let (kd, ks, alpha) = ([0.2f32, 0.5, 0.9], [0.5f32, 0.4, 0.25], 0.3);
    let plastic = bsdf::<_, f64>(coated(Coat::Added, kd, ks, 1.0 / 1.5, [alpha; 2]));
    let substrate = bsdf::<_, f64>(coated(Coat::Blended, kd, ks, 1.5, [alpha; 2]));
    let fifth = |x: f64| x.powi(5);
    for _ in 0..2_000 {
        let [wo, wi] =
            [0; 2].map(|_| random.direction()).map(|[x, y, z]| [x, y, z.abs().max(1e-3)]).map(normalize);
        let h = normalize(statistics::add(wo, wi));
        let cos = dot(wi, h);
        // Total reflection: as from inside.
        let f = fresnel::dielectric(cos, (1.0f32 / 1.5) as f64).0;
        let d = ggx(wo, wi, alpha) * 4.0 * wo[2] * wi[2];
        let shadowed = {
            let a2 = (alpha as f64).powi(2);
            let tan2 = |w: [f64; 3]| (w[0] * w[0] + w[1] * w[1]) / (w[2] * w[2]);
            let lambda = |w: [f64; 3]| 0.5 * ((1.0 + a2 * tan2(w)).sqrt() - 1.0);
            1.0 / (1.0 + lambda(wo) + lambda(wi))
        };
        let (one, other) =
            (channels(plastic.eval(lanes(wo), lanes(wi))), channels(substrate.eval(lanes(wo), lanes(wi))));
        for c in 0..3 {
            let (kd, ks) = (kd[c] as f64, ks[c] as f64);
            let want = (kd * FRAC_1_PI + ks * f * ggx(wo, wi, alpha)) * wi[2];
            assert!((one[c] / want - 1.0).abs() < 1e-6, "plastic: {}, not {want}", one[c]);
            let base = 28.0 / (23.0 * PI)
                * kd
                * (1.0 - ks)
                * (1.0 - fifth(1.0 - 0.5 * wi[2]))
                * (1.0 - fifth(1.0 - 0.5 * wo[2]));
            let schlick = ks + (1.0 - ks) * fifth(1.0 - cos);
            let want = (base + d / shadowed * schlick / (4.0 * cos * wi[2].max(wo[2]))) * wi[2];
            assert!((other[c] / want - 1.0).abs() < 1e-5, "substrate: {}, not {want}", other[c]);
        }
    }
}

/// What comes back from a conductor under a coat has the energy of a walk between the two, whatever its shape.
#[test]
fn coated_conductors_have_the_energy_of_a_walk() {
    let mut random = Random::new(36);
    for (alpha, conductor_alpha) in [(0.0, 0.0), (0.0, 0.5), (0.5, 0.0), (0.5, 0.2), (0.2, 0.5)] {
        let layers = layers_on_gold(alpha, conductor_alpha);
        let fast = bsdf::<_, f32>(coated_conductor(layers));
        let metal = rough_conductor(
            layers.conductor_eta.map(|x| x as f32),
            layers.conductor_k.map(|x| x as f32),
            conductor_alpha.max(1e-3) as f32,
        );
        let (coat, metal) =
            (bsdf::<_, f64>(rough_dielectric(1.5, [alpha.max(1e-3) as f32; 2])), bsdf::<_, f64>(metal));
        for cos in [0.95, 0.6, 0.3] {
            let wo = single(direction(cos));
            let mut walk = || {
                let s = draw(&coat, wo, &mut random);
                let (mut w, mut beta) = (array(s.wi), s.weight.r * s.eta_scale);
                if !s.valid || w[2] > 0.0 {
                    return if s.valid { beta } else { 0.0 };
                }
                for _ in 0..5 {
                    let at = w.map(|x| -x);
                    let s = draw(&metal, at, &mut random);
                    if !s.valid {
                        return 0.0;
                    }
                    let up = array(s.wi);
                    beta *= s.weight.r * (-0.01 / at[2] - 0.01 / up[2]).exp();
                    let s = draw(&coat, up.map(|x| -x), &mut random);
                    if !s.valid {
                        return 0.0;
                    }
                    (w, beta) = (array(s.wi), beta * s.weight.r * s.eta_scale);
                    if w[2] > 0.0 {
                        return beta;
                    }
                }
                0.0
            };
            let want = Mean::of((0..40_000).map(|_| walk()));
            let got = Mean::of((0..40_000).map(|_| {
                let s = draw(&fast, wo, &mut random);
                if s.valid { s.weight.r as f64 } else { 0.0 }
            }));
            let noise = want.standard_error().hypot(got.standard_error());
            assert!(
                (got.mean - want.mean).abs() < 4.5 * noise + 0.02 * want.mean,
                "alpha {alpha} and {conductor_alpha}, cos {cos}: {}, not {}",
                got.mean,
                want.mean
            );
            assert!(got.mean < 1.0 + 4.0 * noise);
        }
    }
}

/// A layered coat never reflects more than it gets.
#[test]
fn layers_keep_energy() {
    let mut random = Random::new(35);
    for eta in [1.05f32, 1.5, 2.5] {
        for alpha in [0.0, 0.02, 0.1, 0.4, 1.0] {
            let material = layered(Coat::Layered, [1.0; 3], [1.0; 3], eta, [alpha; 2], (0.0, 255.0));
            let fast = bsdf::<_, f32>(material);
            for cos in [1.0, 0.7, 0.3, 0.05] {
                let wo = single(direction(cos));
                let mean = Mean::of((0..40_000).map(|_| {
                    let s = draw(&fast, wo, &mut random);
                    if s.valid { s.weight.r as f64 } else { 0.0 }
                }));
                let (got, noise) = (mean.mean, mean.standard_error());
                let what = format!("index {eta}, alpha {alpha}, cos {cos}: {got}");
                assert!(got < 1.003 + 4.0 * noise, "{what}");
                // Without absorption and roughness nothing is lost.
                assert!(alpha > 0.0 || got > 0.997 - 4.0 * noise, "{what}");
            }
        }
    }
}

/// Directional albedo by quadrature, checked against the mean weight of samples in single precision.
fn albedo<M: Material>(what: &str, material: M, wo: [f64; 3], alpha: Option<f32>) -> f64 {
    let (double, fast) = (bsdf::<M, f64>(material), bsdf::<M, f32>(material));
    let exact: f64 = map_for(wo, alpha).integrals(|wi| double.eval(lanes(wo), lanes(wi)).r).iter().sum();
    let mut random = Random::new(4);
    let mean = Mean::of((0..100_000).map(|_| {
        let s = draw(&fast, wo, &mut random);
        if s.valid { s.weight.r as f64 } else { 0.0 }
    }));
    mean.assert_near(&format!("{what}: albedo"), exact, 1e-4);
    exact
}

#[test]
fn furnaces_are_white() {
    for cos in COSINES {
        let wo = single(direction(cos));
        let lambert = albedo::<Lambert>("Lambert", lambert([1.0; 3]), wo, None);
        assert!((lambert - 1.0).abs() < 1e-5, "Lambert, cos {cos}: {lambert}");
        // What is not reflected passes: seen from either side.
        for (share, side) in [(0.0, 1.0), (0.3, 1.0), (0.3, -1.0), (1.0, -1.0)] {
            let material = diffuse_transmission([share; 3], [1.0 - share; 3]);
            let wo = [wo[0], wo[1], side * wo[2]];
            let got = albedo("diffuse transmission", material, wo, None);
            assert!((got - 1.0).abs() < 1e-5, "diffuse transmission {share}, cos {cos}: {got}");
        }
        for sigma in SIGMAS {
            let row = oren_nayar([1.0; 3], sigma);
            let oren_nayar = albedo::<OrenNayar>("Oren-Nayar", row, wo, None);
            // The qualitative model itself exceeds 1 a little for small sigma at grazing angles, where its albedo
            // is A + B / 2: 1.0146 at 10 degrees.
            let s2 = (sigma as f64).to_radians().powi(2);
            let bound = (1.0 - s2 / (2.0 * (s2 + 0.33)) + 0.5 * 0.45 * s2 / (s2 + 0.09)).max(1.0);
            assert!(
                oren_nayar > 0.6 && oren_nayar < bound + 1e-5,
                "Oren-Nayar {sigma}, cos {cos}: {oren_nayar}"
            );
        }
        for alpha in ALPHAS {
            let row = rough_conductor(PERFECT.0, PERFECT.1, alpha);
            let what = format!("rough conductor {alpha}, cos {cos}");
            let got = albedo::<RoughConductor>(&what, row, wo, Some(alpha));
            let want: f64 = map_for(wo, Some(alpha)).integrals(|wi| ggx(wo, wi, alpha) * wi[2]).iter().sum();
            assert!((got - want).abs() < 1e-4, "{what}: {got}, not {want}");
            assert!(got <= 1.0 + 1e-4, "{what}: {got}");
            if alpha < 0.02 && cos > 0.4 {
                assert!(got > 0.995, "{what}: smooth, but {got}");
            }
        }
        let smooth = bsdf::<Conductor, f32>(conductor(PERFECT.0, PERFECT.1));
        let s = smooth.sample(lanes(wo), 0.3, [0.3, 0.8]);
        assert_eq!(s.weight.lane(0), [1.0; 3]);
        assert!(s.valid && s.pdf == 0.0);
        assert_eq!(s.wi.lane(0), [-wo[0] as f32, -wo[1] as f32, wo[2] as f32]);
        // An ideal mirror reflects the same at every angle.
        let mirror = bsdf::<_, f32>(mirror([0.25, 0.5, 1.0]));
        let s = mirror.sample(lanes(wo), 0.3, [0.3, 0.8]);
        assert_eq!((s.weight.lane(0), s.valid), ([0.25, 0.5, 1.0], true));
        assert_eq!(s.wi.lane(0), [-wo[0] as f32, -wo[1] as f32, wo[2] as f32]);
    }
}

/// Height-correlated GGX with a reflectance of one, in the form of the papers, with tangents; 0 below the horizon.
fn ggx(wo: [f64; 3], wi: [f64; 3], alpha: f32) -> f64 {
    if wi[2] <= 0.0 || wo[2] <= 0.0 {
        return 0.0;
    }
    let a2 = (alpha as f64).powi(2);
    let tan2 = |w: [f64; 3]| (w[0] * w[0] + w[1] * w[1]) / (w[2] * w[2]);
    let h = normalize(statistics::add(wo, wi));
    let d = a2 / (PI * h[2].powi(4) * (a2 + tan2(h)).powi(2));
    let lambda = |w: [f64; 3]| 0.5 * ((1.0 + a2 * tan2(w)).sqrt() - 1.0);
    d / (1.0 + lambda(wo) + lambda(wi)) / (4.0 * wo[2] * wi[2])
}

#[test]
fn rough_conductor_is_ggx() {
    let mut random = Random::new(5);
    for alpha in [1e-3, 0.01, 0.1, 0.5, 1.0] {
        let perfect = bsdf::<RoughConductor, f64>(rough_conductor(PERFECT.0, PERFECT.1, alpha));
        let gold = bsdf::<RoughConductor, f64>(rough(alpha));
        for _ in 0..2_000 {
            let [wo, wi] =
                [0; 2].map(|_| random.direction()).map(|[x, y, z]| [x, y, z.abs().max(1e-3)]).map(normalize);
            let want = ggx(wo, wi, alpha) * wi[2];
            let got = perfect.eval(lanes(wo), lanes(wi)).r;
            assert!((got / want - 1.0).abs() < 1e-9, "{got}, not {want}");
            let h = normalize(statistics::add(wo, wi));
            let tinted = gold.eval(lanes(wo), lanes(wi));
            let f = complex_fresnel(dot(wo, h), GOLD.0[1] as f64, GOLD.1[1] as f64);
            assert!((tinted.g / (want * f) - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn oren_nayar_is_the_formula() {
    let mut random = Random::new(6);
    for sigma in [0.0, 10.0, 20.0, 60.0, 90.0f32] {
        let bsdf = bsdf::<OrenNayar, f64>(oren_nayar([1.0, 0.5, 0.25], sigma));
        let s2 = (sigma as f64).to_radians().powi(2);
        let (a, b) = (1.0 - s2 / (2.0 * (s2 + 0.33)), 0.45 * s2 / (s2 + 0.09));
        for _ in 0..2_000 {
            let [wo, wi] = [0; 2].map(|_| random.direction()).map(|[x, y, z]| [x, y, z.abs()]);
            let (to, ti) = (wo[2].acos(), wi[2].acos());
            let delta = wi[1].atan2(wi[0]) - wo[1].atan2(wo[0]);
            let (alpha, beta) = (to.max(ti), to.min(ti));
            let f = FRAC_1_PI * (a + b * delta.cos().max(0.0) * alpha.sin() * beta.tan());
            let got = bsdf.eval(lanes(wo), lanes(wi));
            // A and B are kept in single precision.
            for (got, tint) in [(got.r, 1.0), (got.g, 0.5), (got.b, 0.25)] {
                let want = tint * f * wi[2];
                assert!((got - want).abs() <= 1e-6 * want + 1e-12, "sigma {sigma}: {got}, not {want}");
            }
        }
    }
}

/// Fresnel reflectance for a complex index, from the amplitudes, with complex arithmetic.
fn complex_fresnel(cos_i: f64, eta: f64, k: f64) -> f64 {
    type C = (f64, f64);
    let mul = |a: C, b: C| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let norm2 = |a: C| a.0 * a.0 + a.1 * a.1;
    let n = (eta, k);
    // n cos_t = sqrt(n^2 - sin_i^2), the principal root.
    let n2 = mul(n, n);
    let w = (n2.0 - (1.0 - cos_i * cos_i), n2.1);
    let r = norm2(w).sqrt().sqrt();
    let half = 0.5 * w.1.atan2(w.0);
    let n_cos_t = (r * half.cos(), r * half.sin());
    let ratio = |x: C, y: C| norm2((x.0 - y.0, x.1 - y.1)) / norm2((x.0 + y.0, x.1 + y.1));
    let s = ratio((cos_i, 0.0), n_cos_t);
    // n^2 cos_i against n cos_t.
    let p = ratio((n2.0 * cos_i, n2.1 * cos_i), n_cos_t);
    0.5 * (s + p)
}

#[test]
fn fresnel_of_dielectrics() {
    // Normal incidence: glass, water, diamond.
    for (eta, want) in [(1.5, 0.04), (1.333, 0.020_373), (2.417, 0.171_96)] {
        let (r, cos_t, total) = fresnel::dielectric(1.0f64, eta);
        assert!((r - ((eta - 1.0) / (eta + 1.0)).powi(2)).abs() < 1e-15 && (r - want).abs() < 1e-5);
        assert!((cos_t - 1.0).abs() < 1e-15 && !total);
        // From inside the same.
        assert!((fresnel::dielectric(1.0f64, 1.0 / eta).0 - r).abs() < 1e-15);
        // Brewster's angle, tan = eta: no parallel component is reflected, so half of the perpendicular one is left.
        let cos = 1.0 / (1.0 + eta * eta).sqrt();
        let perpendicular = ((1.0 - eta * eta) / (1.0 + eta * eta)).powi(2);
        assert!((fresnel::dielectric(cos, eta).0 - 0.5 * perpendicular).abs() < 1e-15);
        // Total reflection from the critical angle on.
        let critical = (1.0 - 1.0 / (eta * eta)).sqrt();
        assert!(fresnel::dielectric(critical - 1e-9, 1.0 / eta).2);
        assert_eq!(fresnel::dielectric(critical - 1e-9, 1.0 / eta).0, 1.0);
        assert!(!fresnel::dielectric(critical + 1e-9, 1.0 / eta).2);
        assert!((fresnel::dielectric(0.0, eta).0 - 1.0).abs() < 1e-15);
    }
    let mut random = Random::new(7);
    for _ in 0..50_000 {
        let eta = (1.0 + random.magnitude(1e-6, 2.0)).powi(if random.unit() < 0.5 { 1 } else { -1 }) as f32;
        let cos = (random.magnitude(1e-4, 1.0) as f32).min(1.0);
        let (double, cos_t, total) = fresnel::dielectric(cos as f64, eta as f64);
        let oracle = complex_fresnel(cos as f64, eta as f64, 0.0);
        assert!((double - oracle).abs() < 1e-9, "cos {cos}, eta {eta}: {double}, not {oracle}");
        let (fast, fast_cos_t, fast_total) = fresnel::dielectric(cos, eta);
        // The reflectance rises like a square root at the critical angle: errors of the input are magnified by
        // 1 / cos_t, and with R small against 1 everything is known relative to the amplitude, not to R.
        let rounding = 2e-7 / (eta as f64 * cos_t).max(3e-4);
        assert!(
            (fast as f64 - double).abs() <= rounding * double.sqrt().max(1e-3) * 4.0 + 1e-6 * double,
            "cos {cos}, eta {eta}: {fast}, not {double}"
        );
        assert!((fast_cos_t as f64 - cos_t).abs() <= rounding + 2e-7);
        assert!(fast_total == total || cos_t < 1e-3);
        assert!((0.0..=1.0).contains(&fast));
    }
}

#[test]
fn fresnel_of_conductors() {
    let one = |cos: f64, eta: f64, k: f64| fresnel::conductor(cos, Rgb::all(eta), Rgb::all(k)).r;
    for (eta, k) in [(0.18, 3.42), (1.37, 1.77), (0.05, 4.2), (2.9, 3.0), (1.0, 1e-3)] {
        let normal = ((eta - 1f64).powi(2) + k * k) / ((eta + 1f64).powi(2) + k * k);
        assert!((one(1.0, eta, k) - normal).abs() < 1e-12);
        assert!((one(0.0, eta, k) - 1.0).abs() < 1e-12);
    }
    let mut random = Random::new(8);
    for _ in 0..50_000 {
        let eta = random.magnitude(0.02, 5.0) as f32;
        let k = random.magnitude(1e-3, 10.0) as f32;
        let cos = random.magnitude(1e-3, 1.0).min(1.0) as f32;
        let oracle = complex_fresnel(cos as f64, eta as f64, k as f64);
        let double = one(cos as f64, eta as f64, k as f64);
        assert!((double - oracle).abs() < 1e-10, "cos {cos}, eta {eta}, k {k}: {double}, not {oracle}");
        let fast = fresnel::conductor(cos, Rgb::all(eta), Rgb::all(k)).r;
        assert!((fast as f64 - oracle).abs() < 1e-5, "cos {cos}, eta {eta}, k {k}: {fast}, not {oracle}");
        // What a metal absorbs is a small number that mirrors see many times.
        if k > 2.0 && cos > 0.1 {
            let (got, want) = (1.0 - fast as f64, 1.0 - oracle);
            assert!(
                (got - want).abs() < 1e-3 * want + 3e-7,
                "absorbed {got}, not {want}: cos {cos}, {eta} + {k} i"
            );
        }
        // No absorption: a dielectric.
        let clear = one(cos as f64, eta as f64, 0.0);
        let dielectric = fresnel::dielectric(cos as f64, eta as f64).0;
        assert!((clear - dielectric).abs() < 1e-9, "cos {cos}, eta {eta}: {clear}, not {dielectric}");
    }
}

/// Indices whose fourth power single precision does not hold, and none at all: reflectances are numbers from 0 to 1, and
/// right.
#[test]
fn fresnel_of_extreme_conductors() {
    let magnitudes = [0.0, 1e-12, 1e-6, 1.0, 1e6, 1e9, 1e10, 1e15, 1e30];
    for (eta, k) in magnitudes.into_iter().flat_map(|eta| magnitudes.map(|k| (eta, k))) {
        for cos in [0.0f32, 0.1, 0.5, 0.9, 0.999, 1.0] {
            let fast = fresnel::conductor(cos, Rgb::all(eta), Rgb::all(k)).r;
            assert!((0.0..=1.0 + 1e-6).contains(&fast), "cos {cos}, eta {eta}, k {k}: {fast}");
            let oracle = complex_fresnel(cos as f64, eta as f64, k as f64);
            // Light that does not feel the surface, along it, and none that could be refracted: 0 over 0.
            if oracle.is_finite() && cos > 0.0 && (eta > 0.0 || k > 0.0) {
                let bound = if eta < 1e-3 && k < 1e-3 { 1e-3 } else { 1e-5 };
                assert!(
                    (fast as f64 - oracle).abs() < bound,
                    "cos {cos}, {eta} + {k} i: {fast}, not {oracle}"
                );
            }
        }
    }
    for cos in [0.1f32, 0.3, 0.7, 0.95, 1.0] {
        assert!(
            fresnel::conductor(cos, Rgb::all(1.0), Rgb::all(0.0)).r < 1e-6,
            "nothing is there to reflect"
        );
    }
}

const TINTS: ([f32; 3], [f32; 3]) = ([1.0, 0.5, 0.25], [0.9, 0.8, 0.125]);

fn assert_dielectric<F: Scalar>(eta: f64, cos: f64, rounding: f64) {
    let what = format!("index {eta}, cos {cos}");
    let eta = eta as f32 as f64;
    let bsdf = bsdf::<Dielectric, F>(dielectric(eta as f32, TINTS.0, TINTS.1));
    let wo = single(normalize([direction(cos.abs())[0], direction(cos.abs())[1], cos]));
    let relative = if wo[2] > 0.0 { eta } else { 1.0 / eta };
    let want = complex_fresnel(wo[2].abs(), relative, 0.0);
    let mut random = Random::new(9);
    let mut reflected = Mean::default();
    for _ in 0..10_000 {
        let s = draw(&bsdf, wo, &mut random);
        assert!(s.valid && s.pdf.into() == 0.0);
        let (wi, weight, scale): (_, _, f64) = (array(s.wi), channels(s.weight), s.eta_scale.into());
        assert!((dot(wi, wi) - 1.0).abs() < 4.0 * rounding);
        let reflects = wi[2] * wo[2] > 0.0;
        reflected.add(reflects as u8 as f64);
        if reflects {
            assert!(
                (0..2).all(|k| (wi[k] + wo[k]).abs() < 2.0 * rounding)
                    && (wi[2] - wo[2]).abs() < 2.0 * rounding
            );
            assert!(scale == 1.0 && (0..3).all(|c| weight[c] as f32 == TINTS.0[c]), "{what}: {weight:?}");
            continue;
        }
        // Snell's law, in the plane of incidence, to the other side.
        let sines = (wo[0].hypot(wo[1]), wi[0].hypot(wi[1]));
        assert!(
            (sines.0 - relative * sines.1).abs() < 8.0 * rounding * relative.max(1.0),
            "{what}: {sines:?}"
        );
        assert!(cross([wo[0], wo[1], 0.0], [wi[0], wi[1], 0.0])[2].abs() < 4.0 * rounding);
        assert!(wo[0] * wi[0] + wo[1] * wi[1] <= 0.0);
        assert!((scale / (relative * relative) - 1.0).abs() < 4.0 * rounding, "{what}: eta scale {scale}");
        for (got, tint) in weight.into_iter().zip(TINTS.1) {
            let want = tint as f64 / (relative * relative);
            assert!((got / want - 1.0).abs() < 6.0 * rounding, "{what}: weight {weight:?}");
        }
        // Back again: the same way out, and all scaling undone.
        let back_wo = s.wi;
        let back = (0..).map(|_| bsdf.sample(back_wo, F::lit(random.unit()), [F::zero(); 2]));
        let back = back.into_iter().find(|b| b.wi.z.into() * wi[2] < 0.0).unwrap();
        let product: f64 = (s.eta_scale * back.eta_scale).into();
        assert!((product - 1.0).abs() < 4.0 * rounding, "{what}: there and back {product}");
        let (there, out) = (wo, array(back.wi));
        assert!(
            (0..3).all(|k| (there[k] - out[k]).abs() < 40.0 * rounding / wo[2].abs().max(0.05)),
            "{what}: {there:?}, {out:?}"
        );
        for (there, (out, tint)) in weight.into_iter().zip(channels(back.weight).into_iter().zip(TINTS.1)) {
            let ratio = there * out / (tint as f64).powi(2);
            assert!((ratio - 1.0).abs() < 8.0 * rounding, "{what}: {ratio}");
        }
    }
    reflected.assert_near(&format!("{what}: reflected"), want, 1e-9);
}

#[test]
fn dielectric_reflects_by_fresnel_and_refracts_by_snell() {
    for eta in [1.5, 1.0 / 1.5, 2.4, 1.05] {
        for cos in [1.0, 0.8, 0.45, 0.1, 0.02, -1.0, -0.8, -0.45, -0.1] {
            assert_dielectric::<f64>(eta, cos, 1e-7);
            assert_dielectric::<f32>(eta, cos, 2e-7);
        }
    }
}

#[test]
fn index_one_is_not_there() {
    let bsdf = bsdf::<Dielectric, f32>(dielectric(1.0, [1.0; 3], [1.0; 3]));
    let mut random = Random::new(10);
    for _ in 0..1_000 {
        let wo = single(random.direction());
        let s = bsdf.sample(lanes(wo), random.unit() as f32, [0.5; 2]);
        let wi = array(s.wi);
        assert!((0..3).all(|k| (wi[k] + wo[k]).abs() < 3e-7), "{wo:?} to {wi:?}");
        assert!(s.valid && s.weight.lane(0) == [1.0; 3] && s.eta_scale == 1.0);
    }
}

#[test]
fn thin_dielectric_reflects_all_orders() {
    let mut random = Random::new(11);
    for eta in [1.5f32, 1.1, 2.4, 1.0 / 1.5] {
        let bsdf = bsdf::<ThinDielectric, f32>(thin_dielectric(eta));
        for cos in [1.0f64, 0.6, 0.2, -0.05, -0.6] {
            let wo = single([(1.0 - cos * cos).sqrt(), 0.0, cos]);
            // The series: R + T R T + T R^3 T + ...
            let r = complex_fresnel(cos.abs(), eta as f64, 0.0);
            let t = 1.0 - r;
            let want = (0..200).fold(r, |sum, n| sum + t * t * r.powi(2 * n + 1));
            let mean = Mean::of((0..20_000).map(|_| {
                let s = draw(&bsdf, wo, &mut random);
                assert!(s.valid && s.pdf == 0.0 && s.eta_scale == 1.0 && s.weight.lane(0) == [1.0; 3]);
                let wi = array(s.wi);
                assert!(wi[0] == -wo[0] && wi[2].abs() == wo[2].abs());
                (wi[2] == wo[2]) as u8 as f64
            }));
            mean.assert_near(&format!("index {eta}, cos {cos}"), want, 1e-6);
        }
    }
}

/// Single precision against double, for the same directions: relative error of value and density.
fn assert_precise<M: Material>(what: &str, material: M, tolerance: f64) {
    let (fast, double) = (bsdf::<M, f32>(material), bsdf::<M, f64>(material));
    let mut random = Random::new(12);
    for _ in 0..50_000 {
        let wo = single(direction(random.magnitude(1e-5, 1.0)));
        let wi = if random.unit() < 0.3 {
            let [x, y, z] = random.direction();
            single([x, y, z.abs()])
        } else {
            let s = draw(&double, wo, &mut random);
            if !s.valid {
                continue;
            }
            single(array(s.wi))
        };
        if wi[2] == 0.0 {
            continue;
        }
        let (f, g) = (fast.pdf(lanes(wo), lanes(wi)) as f64, double.pdf(lanes(wo), lanes(wi)));
        assert!((f - g).abs() <= tolerance * g, "{what}: density {f}, not {g}, for {wo:?}, {wi:?}");
        let (f, g) = (channels(fast.eval(lanes(wo), lanes(wi))), channels(double.eval(lanes(wo), lanes(wi))));
        for c in 0..3 {
            assert!(
                (f[c] - g[c]).abs() <= tolerance * g[c],
                "{what}: value {f:?}, not {g:?}, for {wo:?}, {wi:?}"
            );
        }
    }
}

#[test]
fn single_precision_is_enough() {
    assert_precise::<Lambert>("Lambert", lambert([0.2, 0.5, 1.0]), 1e-6);
    for sigma in SIGMAS {
        assert_precise::<OrenNayar>("Oren-Nayar", oren_nayar([0.2, 0.5, 1.0], sigma), 1e-6);
    }
    for (reflectance, transmittance) in SHARES {
        assert_precise("diffuse transmission", diffuse_transmission(reflectance, transmittance), 1e-6);
    }
    for (what, material) in coats() {
        assert_precise(&what, material, 1e-4);
    }
    for alpha in [1e-3, 0.01, 0.1, 0.3, 1.0] {
        // Rounding of the half vector (1e-7), relative to the width of the lobe.
        let tolerance = 2e-6 + 8e-7 / alpha as f64;
        assert_precise::<RoughConductor>(&format!("rough conductor {alpha}"), rough(alpha), tolerance);
    }
}

/// Corners of the unit square and grazing directions: whatever is valid is finite.
fn assert_finite<M: Material>(what: &str, material: M) {
    let bsdf = bsdf::<M, f32>(material);
    let corner = [0.0, 1.0 / 16_777_216.0, 0.25, 0.5, 0.75, 1.0 - 1.0 / 16_777_216.0];
    for cos in [1.0, 1.0 - 1e-7, 0.5, 1e-3, 1e-5, 1e-7, 1e-12, 1e-30, 0.0] {
        for (u, v) in corner.iter().flat_map(|&u| corner.map(|v| (u as f32, v as f32))) {
            let wo = direction(cos);
            let s = bsdf.sample(lanes(wo), u, [u, v]);
            if !s.valid {
                continue;
            }
            let what = format!("{what}, cos {cos}, u {u} {v}");
            let (wi, weight) = (s.wi.lane(0), s.weight.lane(0));
            assert!((dot(statistics::wide(wi), statistics::wide(wi)) - 1.0).abs() < 1e-6, "{what}: {wi:?}");
            assert!(weight.iter().all(|w| w.is_finite() && *w >= 0.0), "{what}: {weight:?}");
            assert!(s.pdf.is_finite() && s.eta_scale.is_finite());
            if !M::Bsdf::<f32>::SPECULAR {
                // 0 where a specular lobe beside others was taken.
                assert!(s.pdf >= 0.0, "{what}");
                if s.pdf == 0.0 {
                    continue;
                }
                assert!(bsdf.pdf(lanes(wo), s.wi).is_finite(), "{what}");
                assert!(
                    bsdf.eval(lanes(wo), s.wi).lane(0).iter().all(|f| f.is_finite() && *f >= 0.0),
                    "{what}"
                );
            }
        }
    }
}

#[test]
fn extremes_stay_finite() {
    assert_finite::<Lambert>("Lambert", lambert([1.0; 3]));
    assert_finite::<OrenNayar>("Oren-Nayar", oren_nayar([1.0; 3], 60.0));
    assert_finite("mirror", mirror([1.0; 3]));
    assert_finite("uber", uber());
    assert_finite("coated conductor", coated_conductor(layers_on_gold(0.0, 0.3)));
    assert_finite("coated conductor", coated_conductor(layers_on_gold(0.3, 0.0)));
    assert_finite("diffuse transmission", diffuse_transmission([1.0; 3], [1.0; 3]));
    assert_finite("diffuse transmission, black", diffuse_transmission([0.0; 3], [0.0; 3]));
    assert_finite::<Conductor>("conductor", conductor(GOLD.0, GOLD.1));
    for alpha in [1e-3, 1e-2, 0.1, 1.0] {
        assert_finite::<RoughConductor>(&format!("rough conductor {alpha}"), rough(alpha));
    }
    for (what, material) in coats() {
        assert_finite(&what, material);
    }
    for eta in [1.5, 0.1, 1.0001, 10.0] {
        for alpha in [1e-4, 1e-3, 0.1, 1.0] {
            assert_finite(&format!("rough dielectric {eta}, {alpha}"), rough_dielectric(eta, [alpha; 2]));
        }
    }
    for eta in [1.5, 0.1, 1.0, 1.0001, 10.0] {
        assert_finite::<Dielectric>(&format!("dielectric {eta}"), dielectric(eta, [1.0; 3], [1.0; 3]));
        assert_finite::<ThinDielectric>(&format!("thin {eta}"), thin_dielectric(eta));
    }
}

#[test]
fn wide_lanes_scatter_to_the_same_bits() {
    struct Scatter;
    impl Kernel for Scatter {
        type Output = ();
        #[inline(always)]
        fn run<I: Isa>(self, _: I) {
            compare::<I::Wide, I::One, Lambert>(lambert([0.2, 0.5, 1.0]));
            compare::<I::Wide, I::One, OrenNayar>(oren_nayar([0.2, 0.5, 1.0], 20.0));
            compare::<I::Wide, I::One, Conductor>(conductor(GOLD.0, GOLD.1));
            compare::<I::Wide, I::One, RoughConductor>(rough(0.2));
            compare::<I::Wide, I::One, _>(mirror([0.2, 0.5, 1.0]));
            compare::<I::Wide, I::One, _>(diffuse_transmission([0.2, 0.5, 0.9], [0.6, 0.1, 0.05]));
            compare::<I::Wide, I::One, Dielectric>(dielectric(1.5, TINTS.0, TINTS.1));
            compare::<I::Wide, I::One, ThinDielectric>(thin_dielectric(1.5));
            compare::<I::Wide, I::One, _>(rough_dielectric(1.5, [0.2, 0.4]));
            compare::<I::Wide, I::One, _>(uber());
            compare::<I::Wide, I::One, _>(brushed([0.2, 0.5]));
            compare::<I::Wide, I::One, _>(coated_conductor(layers_on_gold(0.0, 0.3)));
            compare::<I::Wide, I::One, _>(coated(Coat::Layered, [0.2; 3], [1.0; 3], 1.5, [0.0; 2]));
            compare::<I::Wide, I::One, _>(coated(Coat::Layered, [0.2; 3], [1.0; 3], 1.5, [0.3; 2]));
            compare::<I::Wide, I::One, _>(coated(Coat::Blended, [0.2; 3], [0.5; 3], 1.5, [0.3; 2]));
        }
    }
    #[inline(always)]
    fn compare<W: Real, O: Real, M: Material>(material: M) {
        let (wide, one) = (bsdf::<M, W>(material), bsdf::<M, O>(material));
        let mut random = Random::new(13);
        for _ in 0..500 {
            let wo: [[f64; 3]; 16] = core::array::from_fn(|_| random.direction());
            let u: [[f32; 2]; 16] = core::array::from_fn(|_| [random.unit() as f32, random.unit() as f32]);
            let pack = |f: &dyn Fn(usize) -> f32| W::load(&core::array::from_fn::<f32, 16, _>(f), 0);
            let wo_wide =
                Vec3::new(pack(&|i| wo[i][0] as f32), pack(&|i| wo[i][1] as f32), pack(&|i| wo[i][2] as f32));
            let lobe = pack(&|i| 1.0 - u[i][0]);
            let many = wide.sample(wo_wide, lobe, [pack(&|i| u[i][0]), pack(&|i| u[i][1])]);
            let (eval, pdf) = (wide.eval(wo_wide, many.wi), wide.pdf(wo_wide, many.wi).to_array());
            for i in 0..W::LANES {
                let wo = lanes::<O>(wo[i]);
                let s = one.sample(wo, O::splat(1.0 - u[i][0]), [O::splat(u[i][0]), O::splat(u[i][1])]);
                assert_eq!(many.valid.bits() >> i & 1 == 1, s.valid.any());
                if !s.valid.any() {
                    continue;
                }
                assert_eq!(many.wi.lane(i), s.wi.lane(0));
                assert_eq!(many.weight.lane(i), s.weight.lane(0));
                assert_eq!(many.pdf.to_array()[i], s.pdf.to_array()[0]);
                assert_eq!(many.eta_scale.to_array()[i], s.eta_scale.to_array()[0]);
                assert_eq!(eval.lane(i), one.eval(wo, s.wi).lane(0));
                assert_eq!(pdf[i], one.pdf(wo, s.wi).to_array()[0]);
            }
        }
    }
    Level::available().for_each(|level| level.run(Scatter));
}

/// Half of the light of the formula on each side, whichever side is looked at.
#[test]
fn diffuse_transmission_is_lambert_on_both_sides() {
    let (reflectance, transmittance) = ([0.2f32, 0.5, 0.9], [0.6f32, 0.1, 0.05]);
    let bsdf = bsdf::<_, f64>(diffuse_transmission(reflectance, transmittance));
    let mut random = Random::new(14);
    for _ in 0..2_000 {
        let [wo, wi] = [0; 2].map(|_| random.direction());
        let share = if wo[2] * wi[2] > 0.0 { reflectance } else { transmittance };
        let got = channels(bsdf.eval(lanes(wo), lanes(wi)));
        for c in 0..3 {
            let want = share[c] as f64 * FRAC_1_PI * wi[2].abs();
            assert!((got[c] - want).abs() < 1e-12, "{got:?}, not {share:?} / pi cos for {wo:?}, {wi:?}");
        }
    }
}

/// Numbers out of range, infinite ones and those that are none are refused, with the names of material and parameter.
#[test]
fn bad_parameters_are_refused() {
    fn refused<M: Material>(material: M) -> (&'static str, BadParameter) {
        let mut table = MaterialTable::default();
        table.add(&lambert([0.5; 3])).unwrap();
        let Err(MaterialError::Parameter { material, problem }) = table.add(&material) else {
            panic!("taken: {material:?}")
        };
        // Nothing is left of it.
        assert_eq!((table.len(), table.add(&lambert([0.5; 3])).unwrap().row as usize), (1, Lambert::WIDTH));
        (material, problem)
    }
    for bad in [-1.0, 1.5, f32::NAN, f32::INFINITY, -f32::INFINITY] {
        let (material, problem) = refused(lambert([0.5, bad, 0.5]));
        assert_eq!((material, problem.parameter), ("lambert", "reflectance"));
        assert_eq!((problem.found, &problem.expected[..]), (bad.to_string(), "numbers from 0 to 1"));
        assert_eq!(refused(oren_nayar([0.5; 3], 100.0 * bad)).1.parameter, "sigma");
        assert_eq!(refused(diffuse_transmission([0.5; 3], [bad; 3])).1.parameter, "transmittance");
        assert_eq!(refused(mirror([bad; 3])).0, "mirror");
    }
    for bad in [-1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(refused(conductor([bad; 3], [1.0; 3])).1.parameter, "eta");
        assert_eq!(refused(rough_conductor([1.0; 3], [bad; 3], 0.1)).1.parameter, "k");
        assert_eq!(refused(rough_conductor([1.0; 3], [1.0; 3], bad)).1.parameter, "alpha");
        assert_eq!(refused(dielectric(1.5, [1.0; 3], [bad; 3])).1.parameter, "transmittance");
    }
    for bad in [0.0, -1.5, f32::NAN] {
        assert_eq!(refused(dielectric(bad, [1.0; 3], [1.0; 3])).1.expected, "numbers above 0");
        assert_eq!(refused(thin_dielectric(bad)).0, "thin_dielectric");
    }
    // Whether there is such a texture is seen when the scene is put together.
    let mut table = MaterialTable::default();
    table.add(&Lambert { reflectance: Parameter::Texture(TextureId(3)) }).unwrap();
    let (_, textured) = table.textured().next().unwrap();
    assert_eq!((textured.len(), textured[0].texture, textured[0].width), (1, TextureId(3), 3));
}

/// Rows are as long as their parameters, and the table knows which places are rows of which class.
#[test]
fn the_table_knows_its_materials() {
    let mut table = MaterialTable::default();
    let handles = [
        table.add(&lambert([0.1, 0.2, 0.3])).unwrap(),
        table.add(&rough(0.25)).unwrap(),
        table.add(&thin_dielectric(1.25)).unwrap(),
        table.add(&lambert([0.4, 0.5, 0.6])).unwrap(),
    ];
    assert_eq!(handles.map(|h| h.row), [0, 3, 10, 11]);
    assert_eq!((Lambert::CLASS, handles[1].class), (MaterialClass::Lambert, MaterialClass::RoughConductor));
    for row in 0..20 {
        for class in MaterialClass::ALL {
            let handle = MaterialHandle { class, row };
            let there = class == MaterialClass::Absorber || handles.contains(&handle);
            assert_eq!(table.contains(handle), there, "{handle:?}");
        }
    }
    // SAFETY: there are such materials in those places.
    let (colour, pane) = unsafe {
        (
            table.evaluate::<Lambert, f32>(Wrapping(11)).reflectance,
            table.evaluate::<ThinDielectric, f32>(Wrapping(10)).eta,
        )
    };
    assert_eq!((colour.lane(0), pane), ([0.4, 0.5, 0.6], 1.25));
}

/// What engines and plan ask of the classes is what their lobes say.
#[test]
fn classes_need_what_their_lobes_need() {
    let names = |asks: fn(MaterialClass) -> bool| -> Vec<&str> {
        MaterialClass::ALL.into_iter().filter(|&class| asks(class)).map(MaterialClass::name).collect()
    };
    assert_eq!(
        names(MaterialClass::samples_lights),
        [
            "lambert",
            "oren_nayar",
            "rough_conductor",
            "diffuse_transmission",
            "anisotropic_conductor",
            "rough_dielectric",
            "coated",
            "coated_conductor",
            "uber"
        ]
    );
    assert_eq!(names(MaterialClass::scales_radiance), ["dielectric", "rough_dielectric", "uber"]);
    assert_eq!(MaterialClass::scattering().count(), MaterialClass::COUNT - 2);
    for (number, class) in MaterialClass::ALL.into_iter().enumerate() {
        assert_eq!(class as usize, number);
    }
}

/// Of a mixture, each material scatters its share of each colour, in mixtures of mixtures, too.
#[test]
fn mixtures_choose_by_their_amounts() {
    let mut table = MaterialTable::default();
    let (clay, silver) = (table.add(&lambert([0.5; 3])).unwrap(), table.add(&mirror([1.0; 3])).unwrap());
    let glass = table.add(&thin_dielectric(1.5)).unwrap();
    assert!(!table.has_mixtures());
    let (inner, outer) = ([0.25f32, 0.5, 0.75], [0.5f32; 3]);
    let both = table.add_mixture([clay, silver], inner.into()).unwrap();
    let all = table.add_mixture([both, glass], outer.into()).unwrap();
    assert!(table.has_mixtures() && table.contains(all));
    assert_eq!(
        table.classes(all),
        [MaterialClass::Lambert, MaterialClass::Mirror, MaterialClass::ThinDielectric]
    );
    let shares = |row: u32| {
        const N: usize = 40_000;
        let mut sums = [[0.0f64; 3]; 3];
        for k in 0..N {
            let (tag, weight) = table.choose(row, (k as f32 + 0.5) / N as f32, |_| None);
            let which = [clay, silver, glass].iter().position(|m| tag == PrimitiveTag::material(*m)).unwrap();
            (0..3).for_each(|c| sums[which][c] += weight[c] as f64 / N as f64);
        }
        sums
    };
    let near = |got: [f64; 3], want: [f32; 3]| {
        assert!((0..3).all(|c| (got[c] - want[c] as f64).abs() < 1e-3), "{got:?}, not {want:?}");
    };
    let [first, second, third] = shares(both.row);
    near(first, inner.map(|x| 1.0 - x));
    near(second, inner);
    near(third, [0.0; 3]);
    let [first, second, third] = shares(all.row);
    near(first, inner.map(|x| 0.5 * (1.0 - x)));
    near(second, inner.map(|x| 0.5 * x));
    near(third, outer);
    // Nothing of one of them, nothing of the other.
    for (amount, only) in [(0.0, clay), (1.0, silver)] {
        let mixture = table.add_mixture([clay, silver], [amount; 3].into()).unwrap();
        for u in [0.0, 0.5, 1.0 - 1.0 / 16_777_216.0] {
            assert_eq!(table.choose(mixture.row, u, |_| None), (PrimitiveTag::material(only), [1.0; 3]));
        }
    }
    assert!(table.add_mixture([clay, silver], [1.5; 3].into()).is_err());
}
