//! The ends of the unit interval, and the last of 2^32 samples.
//!
//! Every routine that takes uniform numbers is called with 0, 2^-24, 1/2 and 1 - 2^-24 in every dimension; what is counted
//! is results that are no numbers, directions that are not unit, densities that are not positive.

use super::text::{Text, lit, mesh, sphere};
use super::{Case, Computed, Tolerance};
use crate::scene::{Scene, SceneOptions, SphericalLights};
use std::ops::RangeInclusive;
use wavepath_kernels::lanes::Uint;
use wavepath_kernels::math::{Vec3, cosine_hemisphere, uniform_disk, uniform_sphere};
use wavepath_kernels::sampler::{Independent, Sampler, Sobol, Stream};
use wavepath_kernels::scene::FilterAxis;
use wavepath_kernels::scene::lights::{self, AllLights};
use wavepath_kernels::shade::bsdf::Bsdf;
use wavepath_kernels::shade::materials::{
    Conductor, Dielectric, Lambert, Material, Mirror, OrenNayar, RoughConductor, ThinDielectric,
};

/// The ends and the middle of the unit interval.
const ENDS: [f32; 5] = [0.0, 1.0 / 16_777_216.0, 0.5, 1.0 - 2.0 / 16_777_216.0, 1.0 - 1.0 / 16_777_216.0];
/// Cosines of directions, from the pole to the horizon.
const COSINES: [f32; 7] = [1.0, 0.999_999, 0.5, 1e-2, 1e-4, 1e-6, 1e-10];
/// Squared lengths of unit directions.
const UNIT: RangeInclusive<f32> = 1.0 - 1e-5..=1.0 + 1e-5;

fn each_u() -> impl Iterator<Item = [f32; 2]> {
    ENDS.into_iter().flat_map(|a| ENDS.into_iter().map(move |b| [a, b]))
}

fn is_unit(v: Vec3<f32>) -> bool {
    UNIT.contains(&v.length2())
}

const WHITE: [f32; 3] = [1.0; 3];
/// A metal, what reflects nothing, what reflects everything: index and absorption.
const INDEX: ([f32; 3], [f32; 3]) = ([0.2, 1.0, 1e-12], [3.0, 0.0, 1.0]);

fn rough(alpha: f32) -> Computed {
    bad_samples(&RoughConductor { eta: INDEX.0.into(), k: INDEX.1.into(), alpha: alpha.into() }, false)
}

fn glass(eta: f32) -> Computed {
    let (reflectance, transmittance) = (WHITE.into(), WHITE.into());
    bad_samples(&Dielectric { eta: eta.into(), reflectance, transmittance }, true)
}

/// Bad samples of a material.
fn bad_samples<M: Material>(material: &M, both_sides: bool) -> Computed {
    let bsdf = super::diffuse::lobes(material);
    let mut bad = 0;
    let signs: &[f32] = if both_sides { &[1.0, -1.0] } else { &[1.0] };
    for cos in COSINES {
        for sign in signs {
            let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, sign * cos);
            for u in each_u() {
                let s = bsdf.sample(wo, u[0], u);
                if !s.valid {
                    continue;
                }
                let weight = [s.weight.r, s.weight.g, s.weight.b];
                let numbers = weight.iter().all(|w| w.is_finite() && *w >= 0.0);
                let density = s.pdf.is_finite() && s.pdf >= 0.0 && s.eta_scale > 0.0;
                bad += u64::from(!(numbers && density && is_unit(s.wi)));
            }
        }
    }
    Computed { value: bad as f64, invalid: 0 }
}

/// Bad samples of the light of a scene, seen from places near and far.
fn bad_lights(scene: &Scene) -> Computed {
    // SAFETY: the scene has a light.
    let light = unsafe { scene.tables().lights().row::<f32>(Uint::splat(0)) };
    let mut bad = 0;
    for z in [-1e6f32, -1.0, -1e-3, 0.0, 0.499_999, 0.5, 0.500_001, 1.0, 1.5, 1e6] {
        for u in each_u() {
            let origin = Vec3::new(0.1, 0.05, z);
            let s = lights::sample::<f32, AllLights>(&light, origin, u);
            if s.valid {
                let good = is_unit(s.direction)
                    && s.pdf > 0.0
                    && s.pdf.is_finite()
                    && s.distance >= 0.0
                    && s.radiance.r.is_finite();
                bad += u64::from(!good);
            }
        }
    }
    (bad as f64).into()
}

/// The family.
pub fn cases() -> Vec<Case> {
    let count = |name: &str, what: String, f: fn() -> Computed| {
        Case::compute(format!("samplers/{name}"), what, 0.0, Tolerance::EXACT, move |_| f())
    };
    let ends = |of: &str| format!("bad samples of {of} at the ends of the unit interval");
    let mut cases = vec![
        count("ends-lambert", ends("Lambert"), || bad_samples(&Lambert { reflectance: WHITE.into() }, false)),
        count("ends-oren-nayar", ends("Oren-Nayar"), || {
            bad_samples(&OrenNayar { reflectance: WHITE.into(), sigma: 90.0.into() }, false)
        }),
        count("ends-mirror", ends("mirrors"), || bad_samples(&Mirror { reflectance: WHITE.into() }, false)),
        count("ends-conductor", ends("smooth conductors"), || {
            bad_samples(&Conductor { eta: INDEX.0.into(), k: INDEX.1.into() }, false)
        }),
        count("ends-rough-1e-3", ends("rough conductors of alpha 1e-3"), || rough(1e-3)),
        count("ends-rough-1", ends("rough conductors of alpha 1"), || rough(1.0)),
        count("ends-glass", ends("glass"), || glass(1.5)),
        count("ends-faint-glass", ends("glass of index 1 + 1e-6"), || glass(1.000_001)),
        count("ends-thin-glass", ends("thin panes"), || {
            bad_samples(&ThinDielectric { eta: 1.5.into() }, true)
        }),
        count("ends-sphere-light", ends("spherical lamps"), || {
            bad_lights(&lit(&sphere([0.0, 0.0, 1.0], 0.5)))
        }),
        count("ends-sphere-light-by-area", ends("spherical lamps by area"), || {
            let description = lit(&sphere([0.0, 0.0, 1.0], 0.5)).description().clone();
            let options = SceneOptions { spherical_lights: SphericalLights::Area, ..Default::default() };
            bad_lights(&Scene::new_with("by area", description, &options).expect("the same scene"))
        }),
        count("ends-triangle-light", ends("triangular lamps"), || {
            bad_lights(&lit(&mesh(&[[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]], &[[0, 1, 2]])))
        }),
        count("ends-disk-light", ends("disk lamps"), || {
            bad_lights(&lit("Translate 0 0 1\nRotate 180 1 0 0\nShape \"disk\""))
        }),
        count("ends-point-light", ends("point lights"), || {
            bad_lights(&without_surface("\"point\" \"point3 from\" [0 0 1]"))
        }),
        count("ends-spot-light", ends("spot lights"), || {
            bad_lights(&without_surface("\"spot\" \"point3 from\" [0 0 1] \"point3 to\" [0 0 0]"))
        }),
        count("ends-distant-light", ends("distant lights"), || {
            bad_lights(&without_surface("\"distant\" \"point3 from\" [0 0 1] \"point3 to\" [0 0 0]"))
        }),
        count("ends-shapes", ends("disks, spheres and hemispheres"), shapes),
        count("ends-filters", ends("filters"), filters),
        count(
            "late-sobol",
            "strata without exactly one of the last 2^16 of 2^32 Sobol points".into(),
            || late_strata().into(),
        ),
        count("late-range", "numbers of the last 2^16 of 2^32 samples outside of [0, 1)".into(), late_range),
    ];
    let mean = |name: &str, f: fn() -> f64, tolerance| {
        Case::compute(format!("samplers/{name}"), "mean of the last 2^16 of 2^32 samples", 0.5, tolerance, {
            move |_| f()
        })
    };
    cases.push(mean(
        "late-mean-sobol",
        late_mean::<Sobol>,
        Tolerance::relative(1e-4, "half of a stratum of 2^-16, and its jitter"),
    ));
    cases.push(mean(
        "late-mean-independent",
        late_mean::<Independent>,
        Tolerance::relative(9e-3, "four standard errors of 2^16 uniform numbers"),
    ));
    cases
}

/// A scene with one light that has no surface.
fn without_surface(light: &str) -> Scene {
    let text = Text::look([0.0; 3], [0.0, 0.0, 1.0], 40.0).add(format!("LightSource {light}"));
    Scene::parse(&text.end()).expect("the battery's own scene")
}

fn shapes() -> Computed {
    let mut bad = 0;
    for u in each_u() {
        bad += u64::from(!is_unit(uniform_sphere::<f32>(u)));
        let hemisphere = cosine_hemisphere::<f32>(u);
        bad += u64::from(!is_unit(hemisphere) || hemisphere.z < 0.0);
        let (x, y) = uniform_disk::<f32>(u);
        bad += u64::from((x * x + y * y).is_nan() || x * x + y * y > 1.0 + 1e-6);
    }
    (bad as f64).into()
}

fn filters() -> Computed {
    let tent = FilterAxis::tabulate(2.0, |x| 2.0 - x.abs());
    let axes = [FilterAxis::constant(0.5), tent];
    let mut bad = 0;
    for axis in &axes {
        let (low, high) = (axis.quantiles()[0], axis.quantiles()[axis.quantiles().len() - 1]);
        for u in ENDS {
            bad += u64::from(!(low..=high).contains(&axis.sample::<f32>(u)));
        }
    }
    (bad as f64).into()
}

const LATE: u32 = 1 << 16;

/// The last 2^16 sample numbers.
fn late() -> impl Iterator<Item = Stream<core::num::Wrapping<u32>>> {
    let seed = Uint::splat(0x1234_5678);
    (0..LATE).map(move |i| Stream { seed, index: Uint::splat(u32::MAX - i) })
}

/// An aligned block of 2^16 points of a (0, 2)-sequence has one in each of its elementary boxes: here of 2^16 x 1,
/// 2^8 x 2^8 and 1 x 2^16. Returns how many have not.
fn late_strata() -> f64 {
    let mut counts = [(); 3].map(|()| vec![0u8; LATE as usize]);
    for stream in late() {
        let [x, y] = Sobol::bits2(stream, Uint::splat(3)).map(|bits| bits.0);
        let places = [x >> 16, (x >> 24) << 8 | y >> 24, y >> 16];
        for (count, place) in counts.iter_mut().zip(places) {
            count[place as usize] = count[place as usize].saturating_add(1);
        }
    }
    counts.iter().flatten().filter(|&&n| n != 1).count() as f64
}

fn late_range() -> Computed {
    let mut bad = 0;
    for stream in late() {
        let pairs =
            [Sobol::two::<f32>(stream, Uint::splat(2)), Independent::two::<f32>(stream, Uint::splat(2))];
        let single =
            [Sobol::one::<f32>(stream, Uint::splat(9)), Independent::one::<f32>(stream, Uint::splat(9))];
        let all = pairs.iter().flatten().chain(&single);
        bad += all.filter(|u| !(0.0..1.0).contains(*u)).count();
    }
    (bad as f64).into()
}

fn late_mean<S: Sampler>() -> f64 {
    late().map(|stream| f64::from(S::one::<f32>(stream, Uint::splat(5)))).sum::<f64>() / f64::from(LATE)
}
