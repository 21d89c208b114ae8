//! Lambert and Oren-Nayar at all angles.
//!
//! - *oren-nayar*: a distant light of irradiance 1 from a direction, seen from another:
//!   cos_i (A + B max(0, cos phi) sin alpha tan beta) / pi ([`exact::oren_nayar`]).
//! - *furnace*: under a white sky the directional albedo ([`exact::oren_nayar_albedo`]). For small sigma the model itself
//!   reflects more than it gets at grazing angles, A + B / 2: up to 1.0147.
//! - *reciprocity*: f(a, b) = f(b, a), at the kernels' own precision.

use super::text::{Text, above, diffuse, floor, numbers};
use super::{Case, Computed, Tolerance, exact};
use std::f64::consts::PI;
use wavepath_kernels::lanes::Uint;
use wavepath_kernels::math::Vec3;
use wavepath_kernels::scene::MaterialTable;
use wavepath_kernels::shade::bsdf::Bsdf;
use wavepath_kernels::shade::materials::{Lambert, Material, OrenNayar, RoughConductor};

const VALUE: Tolerance = Tolerance::relative(
    3e-4,
    "at 89.9 degrees a rounding of a direction is 1e-4 of its cosine; the field of view",
);
const ALBEDO: Tolerance = Tolerance::relative(1e-3, "noise");
const WHITE: Tolerance =
    Tolerance::relative(1e-5, "every path brings the albedo, exactly; roundings of the film");

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases = lit();
    cases.extend(furnaces());
    cases.extend(reciprocity());
    cases
}

fn material(sigma: f64, reflectance: f64) -> String {
    format!("{} \"float sigma\" [{sigma:e}]", diffuse(reflectance))
}

fn lit() -> Vec<Case> {
    // Name; polar angles of light and camera, angle between the azimuths.
    let geometries = [
        ("normal", 0.0, 0.0, 0.0),
        ("forward", 45.0, 45.0, 180.0),
        ("retro", 45.0, 45.0, 0.0),
        ("aside", 70.0, 60.0, 60.0),
        ("grazing-incidence", 89.9, 45.0, 0.0),
        ("grazing-emergence", 45.0, 89.9, 0.0),
        ("grazing-retro", 89.9, 89.9, 0.0),
    ];
    let mut cases = Vec::new();
    for sigma in [0.0, 1e-3, 1.0, 10.0, 20.0, 45.0, 90.0] {
        for (name, theta_i, theta_o, phi) in geometries {
            let [ti, to, phi] = [theta_i, theta_o, phi].map(f64::to_radians);
            let light = [ti.sin() * phi.cos(), ti.cos(), ti.sin() * phi.sin()];
            let fov = 0.05 * to.cos().max(1e-3);
            let scene = Text::look(above(theta_o, 2.0), [0.0; 3], fov)
                .add(format!(
                    "LightSource \"distant\" \"point3 from\" [{}] \"point3 to\" [0 0 0] \"rgb L\" [1 1 1]",
                    numbers(&light)
                ))
                .block(format!("{}\n{}", material(sigma, 0.8), floor(0.0, 3.0)));
            let expected = 0.8 * ti.cos() * exact::oren_nayar(sigma, ti, to, phi) / PI;
            cases.push(
                Case::picture(
                    format!("diffuse/oren-nayar-{sigma}-{name}"),
                    format!("sigma {sigma}, light at {theta_i}, seen at {theta_o} degrees, {name}"),
                    scene.end(),
                    expected,
                    VALUE,
                )
                .spp(16),
            );
        }
    }
    cases
}

fn furnaces() -> Vec<Case> {
    let mut cases = Vec::new();
    for sigma in [0.0, 10.0, 30.0, 90.0] {
        for theta in [0.0, 60.0, 85.0, 89.9f64] {
            let fov = 0.05 * theta.to_radians().cos().max(1e-3);
            let scene = Text::look(above(theta, 2.0), [0.0; 3], fov).depth(5).sky(1.0).block(format!(
                "{}\n{}",
                material(sigma, 1.0),
                floor(0.0, 3.0)
            ));
            cases.push(Case::picture(
                format!("diffuse/furnace-{sigma}-{theta}"),
                format!("albedo of a white floor of sigma {sigma}, seen at {theta} degrees"),
                scene.end(),
                exact::oren_nayar_albedo(sigma, theta.to_radians()),
                ALBEDO,
            ));
        }
    }
    for (name, albedo) in [("1e-6", 1e-6), ("0.5", 0.5), ("1-1e-6", 1.0 - 1e-6), ("1", 1.0)] {
        let scene = Text::look(above(89.99, 2.0), [0.0; 3], 1e-5).depth(5).sky(1.0).block(format!(
            "{}\n{}",
            diffuse(albedo),
            floor(0.0, 3.0)
        ));
        cases.push(Case::picture(
            format!("diffuse/lambert-{name}"),
            format!("floor of albedo {name} under a white sky, seen at 89.99 degrees"),
            scene.end(),
            albedo,
            WHITE,
        ));
    }
    cases
}

/// The lobes of a material, by way of the table.
pub(super) fn lobes<M: Material>(material: &M) -> M::Bsdf<f32> {
    let mut table = MaterialTable::default();
    let handle = table.add(material).expect("a material in its range");
    // SAFETY: the table has this material.
    M::bsdf::<f32>(unsafe { table.evaluate::<M, f32>(Uint::splat(handle.row)) })
}

/// Largest |f(a, b) - f(b, a)| over their sum, for directions from the pole to the horizon.
fn asymmetry<M: Material>(material: &M) -> Computed {
    const STEPS: [f32; 9] = [1.0, 0.999_9, 0.9, 0.5, 0.1, 1e-2, 1e-3, 1e-4, 1e-6];
    let bsdf = lobes(material);
    let direction = |cos: f32, phi: f32| {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
    };
    let (mut worst, mut invalid) = (0.0f64, 0);
    for cos_a in STEPS {
        for cos_b in STEPS {
            for step in 0..12 {
                let (a, b) = (direction(cos_a, 0.3), direction(cos_b, 0.3 + step as f32 * 0.55));
                // Values are times the cosine of the second direction.
                let ab = f64::from(bsdf.eval(a, b).r) / f64::from(cos_b);
                let ba = f64::from(bsdf.eval(b, a).r) / f64::from(cos_a);
                invalid += u64::from(!(ab.is_finite() && ba.is_finite()));
                // Far out in the tail of a lobe values vanish, and so do their digits.
                if ab + ba > 1e-20 {
                    worst = worst.max((ab - ba).abs() / (ab + ba));
                }
            }
        }
    }
    Computed { value: worst, invalid }
}

fn reciprocity() -> Vec<Case> {
    let tolerance = |absolute| {
        Tolerance::relative(0.0, "some roundings; a half vector's, over the width of the lobe").and(absolute)
    };
    let mut cases = vec![Case::compute(
        "diffuse/reciprocity-lambert",
        "largest relative difference of f(a, b) and f(b, a)",
        0.0,
        tolerance(1e-6),
        |_| asymmetry(&Lambert { reflectance: [0.7; 3].into() }),
    )];
    for sigma in [10.0f32, 45.0, 90.0] {
        cases.push(Case::compute(
            format!("diffuse/reciprocity-oren-nayar-{sigma}"),
            "largest relative difference of f(a, b) and f(b, a)",
            0.0,
            tolerance(1e-6),
            move |_| asymmetry(&OrenNayar { reflectance: [0.7; 3].into(), sigma: sigma.into() }),
        ));
    }
    for alpha in [0.01f32, 0.1, 1.0] {
        cases.push(Case::compute(
            format!("conductors/reciprocity-{alpha}"),
            "largest relative difference of f(a, b) and f(b, a)",
            0.0,
            tolerance(1e-5),
            move |_| {
                let (eta, k) = ([0.2; 3].into(), [3.0; 3].into());
                asymmetry(&RoughConductor { eta, k, alpha: alpha.into() })
            },
        ));
    }
    cases
}
