//! Faint and bright light, many bounces, roulette.
//!
//! - *emission*, *point*, *distant*: linear in the light.
//! - *furnace-depth*: inside of a sphere that emits L and reflects rho, a path of d bounces brings
//!   L (1 + rho + ... + rho^d) = L (1 - rho^(d + 1)) / (1 - rho) in every direction, exactly.

use super::text::{Point, Text, ceiling, cuboid, diffuse, emits, floor, lamp, perfect_mirror, sphere};
use super::{Case, Tolerance, exact};
use std::f64::consts::PI;

const LINEAR: Tolerance = Tolerance::relative(1e-3, "the field of view; noise");
const SERIES: Tolerance = Tolerance::relative(1e-4, "roundings of up to 200 products; roulette");
const BOX: Tolerance = Tolerance::relative(2e-3, "noise: twelve lamps, one chosen at a time");
const MIRRORS: Tolerance = Tolerance::relative(2e-3, "ten thousand roundings of the throughput");

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = bright_and_faint().collect();
    cases.extend(points());
    cases.extend(dark_floors());
    cases.extend(furnaces());
    cases.extend(mirrors());
    cases
}

fn bright_and_faint() -> impl Iterator<Item = Case> {
    [-36, -30, -20, -10, -6, 0, 6, 10, 20, 30, 36].into_iter().map(|k| {
        let radiance = 10f64.powi(k);
        let scene = Text::look([0.3, 2.0, 0.0], [0.0; 3], 0.2)
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 5.0)))
            .block(format!("{}\n{}", lamp(radiance), ceiling(1.0, 0.1)));
        Case::picture(
            format!("radiance/emission-1e{k}"),
            format!("floor under a square lamp of radiance 1e{k}"),
            scene.end(),
            radiance * exact::square_above(0.1, 1.0),
            LINEAR,
        )
    })
}

fn points() -> Vec<Case> {
    let mut cases = Vec::new();
    let above = |light: String, expected: f64, name: String, what: String, s: f64| {
        let scene = Text::look([1.5 * s, 0.5 * s, 0.0], [0.0; 3], 0.02).add(light).block(format!(
            "{}\n{}",
            diffuse(1.0),
            floor(0.0, 3.0 * s)
        ));
        Case::picture(name, what, scene.end(), expected, LINEAR)
    };
    for k in [-6, -3, 0, 3, 6, 9, 12] {
        let i = 10f64.powi(k);
        cases.push(above(
            format!("LightSource \"point\" \"point3 from\" [0 1 0] \"rgb I\" [{i:e} {i:e} {i:e}]"),
            i / PI,
            format!("radiance/point-1e{k}"),
            format!("floor under a point light of intensity 1e{k}"),
            1.0,
        ));
    }
    // Intensity as the square of the distance, so that the floor shows the same.
    for k in [-6, -3, 3, 6, 9, 11] {
        let d = 10f64.powi(k);
        let i = d * d;
        let s = d.min(1.0);
        cases.push(above(
            format!("LightSource \"point\" \"point3 from\" [0 {d:e} 0] \"rgb I\" [{i:e} {i:e} {i:e}]"),
            1.0 / PI,
            format!("radiance/point-at-1e{k}"),
            format!("floor under a point light at 1e{k}, of intensity 1e{}", 2 * k),
            s,
        ));
    }
    for k in [-30, 0, 30] {
        let e = 10f64.powi(k);
        cases.push(above(
            format!(
                "LightSource \"distant\" \"point3 from\" [0 1 0] \"point3 to\" [0 0 0] \"rgb L\" [{e:e} {e:e} {e:e}]"
            ),
            e / PI,
            format!("radiance/distant-1e{k}"),
            format!("floor under a distant light of irradiance 1e{k}"),
            1.0,
        ));
    }
    cases
}

/// A floor that reflects 1e-k of a sky of 1e+k.
fn dark_floors() -> impl Iterator<Item = Case> {
    [3, 6, 10, 14, 18, 24, 30].into_iter().map(|k| {
        let bright = 10f64.powi(k);
        let scene = Text::look([1.5, 0.5, 0.0], [0.0; 3], 1.0).sky(bright).block(format!(
            "{}\n{}",
            diffuse(1.0 / bright),
            floor(0.0, 3.0)
        ));
        Case::picture(
            format!("radiance/dark-floor-1e{k}"),
            format!("floor of albedo 1e-{k} under a sky of 1e{k}"),
            scene.end(),
            1.0,
            LINEAR,
        )
    })
}

/// Inside of a sphere that emits and reflects.
fn furnace(albedo: f64, depth: u32, radiance: f64) -> String {
    Text::look([0.1, 0.2, 0.3], [0.9, 0.1, -0.5], 40.0)
        .depth(depth)
        .block(format!(
            "ReverseOrientation\n{}\n{}\n{}",
            diffuse(albedo),
            emits(radiance),
            sphere([0.0; 3], 1.0)
        ))
        .end()
}

fn furnaces() -> Vec<Case> {
    let mut cases = Vec::new();
    for depth in 0..=12 {
        cases.push(Case::picture(
            format!("radiance/furnace-depth-{depth}"),
            format!("furnace of albedo 0.9, at most {depth} bounces"),
            furnace(0.9, depth, 1.0),
            exact::geometric(f64::from(0.9f32), depth + 1),
            Tolerance::relative(1e-3, "roulette from the third bounce on"),
        ));
    }
    for (name, albedo, depth) in
        [("1-1e-6", 1.0 - 1e-6, 200), ("1e-6", 1e-6, 20), ("1e-20", 1e-20, 20), ("1", 1.0, 500)]
    {
        cases.push(Case::picture(
            format!("radiance/furnace-albedo-{name}"),
            format!("furnace of albedo {name}, at most {depth} bounces"),
            furnace(albedo, depth, 1.0),
            exact::geometric(f64::from(albedo as f32), depth + 1),
            SERIES,
        ));
    }
    for k in [-30, 30] {
        cases.push(Case::picture(
            format!("radiance/furnace-emission-1e{k}"),
            format!("furnace of albedo 0.5 that emits 1e{k}, at most 20 bounces"),
            furnace(0.5, 20, 10f64.powi(k)),
            10f64.powi(k) * exact::geometric(0.5, 21),
            Tolerance::relative(1e-3, "roulette from the third bounce on"),
        ));
    }
    let (low, high): (Point, Point) = ([-1.0, -0.8, -1.2], [1.0, 0.8, 1.2]);
    for (depth, radiance) in [(0, 1.0), (1, 1.0), (2, 1.0), (5, 1.0), (50, 1.0), (50, 1e36)] {
        let scene = Text::look([0.1, 0.2, 0.3], [0.9, 0.1, -0.5], 40.0).depth(depth).block(format!(
            "ReverseOrientation\n{}\n{}\n{}",
            diffuse(0.5),
            emits(radiance),
            cuboid(low, high)
        ));
        cases.push(Case::picture(
            format!("radiance/furnace-box-{radiance:e}-depth-{depth}"),
            format!("box of albedo 0.5 that emits {radiance:e}, at most {depth} bounces"),
            scene.end(),
            radiance * exact::geometric(0.5, depth + 1),
            BOX,
        ));
    }
    cases
}

/// Inside of a sphere that emits and mirrors: d bounces bring d + 1, or the geometric sum of its reflectance.
fn mirrors() -> Vec<Case> {
    let scene = |material: &str, depth| {
        Text::look([0.1, 0.2, 0.3], [0.9, 0.1, -0.5], 40.0)
            .depth(depth)
            .resolution(4, 4)
            .block(format!("ReverseOrientation\n{material}\n{}\n{}", emits(1.0), sphere([0.0; 3], 1.0)))
            .end()
    };
    let mut cases = Vec::new();
    for depth in [10, 100, 1000, 4000, 10_000] {
        cases.push(
            Case::picture(
                format!("radiance/mirror-bounces-{depth}"),
                format!("inside of a perfect mirror that emits, at most {depth} bounces"),
                scene(&perfect_mirror(), depth),
                f64::from(depth) + 1.0,
                MIRRORS,
            )
            .spp(4),
        );
    }
    // A ray through the centre of the sphere meets it squarely, always: reflectance at normal incidence is as given, up to
    // the largest of 0.9999 that a reflectance may have.
    let through_centre = |depth| {
        Text::look([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 1e-3)
            .depth(depth)
            .resolution(4, 4)
            .block(format!(
                "ReverseOrientation\nMaterial \"conductor\" \"rgb reflectance\" [0.9999 0.9999 0.9999]\n{}\n{}",
                emits(1.0),
                sphere([0.0; 3], 1.0)
            ))
            .end()
    };
    for depth in [100, 1000, 10_000] {
        let k = (2.0 * 0.9999f64.sqrt() / (1.0f64 - 0.9999).sqrt()) as f32;
        let r = exact::conductor(0.0, 1.0, f64::from(k));
        cases.push(
            Case::picture(
                format!("radiance/mirror-0.9999-bounces-{depth}"),
                format!("inside of a mirror of 0.9999 that emits, at most {depth} bounces"),
                through_centre(depth),
                exact::geometric(r, depth + 1),
                MIRRORS,
            )
            .spp(16),
        );
    }
    cases
}
