//! Conductors: Fresnel's equations with complex indices, GGX from smooth to rough.
//!
//! - *fresnel*: a plane mirror shows a white sky times [`exact::conductor`].
//! - *furnace*: rough, reflecting everything: [`exact::ggx_albedo`].
//! - *highlight*: a distant light of irradiance 1 seen in the direction of the mirror: D(0) G2 / (4 cos_o) for a
//!   reflectance of 1, D(0) = 1 / (pi alpha^2).
//! - *channels*: reflectances of exactly 0 and nearly 1 side by side.

use super::text::{Text, above, floor, lamp, numbers, perfect_mirror, sphere};
use super::{Case, Measure, Tolerance, exact};
use std::f64::consts::PI;

const FRESNEL: Tolerance =
    Tolerance::relative(1e-4, "some roundings; the field of view at grazing angles").and(3e-7);
const ALBEDO: Tolerance = Tolerance::relative(1e-3, "noise");
const HIGHLIGHT: Tolerance = Tolerance::relative(2e-3, "roundings of directions, over the width of the lobe");

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases = fresnel();
    cases.extend(channels());
    cases.extend(rough());
    cases
}

fn fresnel() -> Vec<Case> {
    let indices = [
        (0.2, 3.9),
        (1.37, 1.77),
        (1.0, 0.0),
        (1.5, 0.0),
        (1.0, 1e-3),
        (0.05, 4.0),
        (1e-3, 1e-3),
        (1.0, 1e3),
        (1.0, 1e6),
        (1.0, 1e10),
        (1e10, 1.0),
        (1e6, 1e-6),
        (1e18, 1e18),
    ];
    let mut cases = Vec::new();
    for (eta, k) in indices {
        for theta in [0.0, 45.0, 80.0, 89.9f64] {
            let fov = 0.01 * theta.to_radians().cos().max(1e-3);
            let scene = Text::look(above(theta, 2.0), [0.0; 3], fov).depth(3).sky(1.0).block(format!(
                "Material \"conductor\" \"rgb eta\" [{}] \"rgb k\" [{}]\n{}",
                numbers(&[eta; 3]),
                numbers(&[k; 3]),
                floor(0.0, 3.0)
            ));
            cases.push(
                Case::picture(
                    format!("conductors/fresnel-{eta:e}-{k:e}-{theta}"),
                    format!("mirror of index {eta:e} + i {k:e} at {theta} degrees"),
                    scene.end(),
                    exact::conductor(theta.to_radians(), eta, k),
                    FRESNEL,
                )
                .spp(4),
            );
        }
    }
    cases
}

/// Reflectances 0, 0.25 and 0.9999 (the most that a reflectance may be), smooth and rough.
fn channels() -> Vec<Case> {
    let mut cases = Vec::new();
    for roughness in [0.0, 0.05] {
        for (channel, reflectance) in [0.0, 0.25, 0.9999].into_iter().enumerate() {
            let scene = Text::look(above(0.0, 2.0), [0.0; 3], 0.01).depth(3).sky(1.0).block(format!(
                "Material \"conductor\" \"rgb reflectance\" [0 0.25 0.9999] \"float roughness\" [{roughness}] \
                 \"bool remaproughness\" false\n{}",
                floor(0.0, 3.0)
            ));
            let albedo = if roughness == 0.0 { 1.0 } else { exact::ggx_albedo(roughness, 0.0) };
            cases.push(
                Case::picture(
                    format!("conductors/channel-{reflectance}-roughness-{roughness}"),
                    format!("channel of reflectance {reflectance} beside others, roughness {roughness}"),
                    scene.end(),
                    reflectance * albedo,
                    Tolerance::relative(1e-3, "microfacets are met at angles near 0 only").and(1e-7),
                )
                .measure(Measure::Channel(channel)),
            );
        }
    }
    cases
}

fn rough() -> Vec<Case> {
    let mut cases = Vec::new();
    let metal = |alpha: f64| {
        format!("{} \"float roughness\" [{alpha:e}] \"bool remaproughness\" false", perfect_mirror())
    };
    for alpha in [0.0, 1e-4, 9e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3, 0.6, 1.0] {
        for theta in [0.0, 60.0, 85.0, 89.9f64] {
            let fov = 0.01 * theta.to_radians().cos().max(1e-3);
            let scene = Text::look(above(theta, 2.0), [0.0; 3], fov).depth(3).sky(1.0).block(format!(
                "{}\n{}",
                metal(alpha),
                floor(0.0, 3.0)
            ));
            // Below 1e-3, surfaces count as smooth.
            let expected = if alpha < 1e-3 { 1.0 } else { exact::ggx_albedo(alpha, theta.to_radians()) };
            cases.push(Case::picture(
                format!("conductors/furnace-{alpha:e}-{theta}"),
                format!("albedo of a white conductor of alpha {alpha:e}, seen at {theta} degrees"),
                scene.end(),
                expected,
                ALBEDO,
            ));
        }
    }
    for alpha in [1e-3, 3e-3, 1e-2, 0.1, 1.0] {
        for theta in [0.0, 60.0, 85.0f64] {
            let (sin, cos) = theta.to_radians().sin_cos();
            let scene = Text::look(above(theta, 2.0), [0.0; 3], 1e-4 * cos)
                .add(format!(
                    "LightSource \"distant\" \"point3 from\" [{}] \"point3 to\" [0 0 0] \"rgb L\" [1 1 1]",
                    numbers(&[-sin, cos, 0.0])
                ))
                .block(format!("{}\n{}", metal(alpha), floor(0.0, 3.0)));
            let expected = exact::ggx_shadowing(alpha, cos, cos) / (PI * alpha * alpha * 4.0 * cos);
            cases.push(Case::picture(
                format!("conductors/highlight-{alpha:e}-{theta}"),
                format!("highlight of a white conductor of alpha {alpha:e} at {theta} degrees"),
                scene.end(),
                expected,
                HIGHLIGHT,
            ));
        }
    }
    // The limit of smoothness: a lamp of 10 degrees, in the middle of which the mirror looks.
    for alpha in [0.0, 1e-4, 1e-3, 2e-3, 5e-3] {
        let eye = above(45.0, 2.0);
        let scene = Text::look(eye, [0.0; 3], 0.01)
            .depth(2)
            .block(format!("{}\n{}", metal(alpha), floor(0.0, 3.0)))
            .block(format!("{}\n{}", lamp(1.0), sphere([-20.0, 20.0, 0.0], 5.0)));
        cases.push(
            Case::picture(
                format!("conductors/limit-{alpha:e}"),
                format!("a lamp mirrored by a conductor of alpha {alpha:e}"),
                scene.end(),
                1.0,
                // Outside of the lamp, 5 degrees of the normal's turn away, is alpha^2 / tan^2 of the distribution.
                Tolerance::relative(1e-3 + 2.0 * (alpha / 0.087f64).powi(2), "noise; the tail of the lobe"),
            )
            .spp(256),
        );
    }
    cases
}
