//! Lamps: from near and far, from inside, in their plane, behind screens.
//!
//! - *sphere*: of radius r, its centre h above a white floor and clear of it: irradiance pi L (r / h)^2, so the floor shows
//!   L (r / h)^2 (Howell, A-1). L is chosen so that this is 1.
//! - *disk*: of radius a at height h: L a^2 / (a^2 + h^2).
//! - *square*, *wall*: [`exact::square_above`], [`exact::wall`].
//! - *inside*: a surface inside of a lamp that shines inwards sees L all over: its albedo times L.

use super::text::{Text, ceiling, diffuse, floor, glass, lamp, perfect_mirror, quad, sphere};
use super::{Case, Computed, Subject, Tolerance, exact};
use std::f64::consts::PI;
use wavepath_kernels::lanes::Uint;
use wavepath_kernels::math::Vec3;
use wavepath_kernels::scene::lights::{self, AllLights};

const SPHERE: Tolerance = Tolerance::relative(1e-4, "the standard that spherical lamps are held to");
const NOISY: Tolerance = Tolerance::relative(1e-3, "samples by area are noisier");
const FORM_FACTOR: Tolerance = Tolerance::relative(1e-3, "the field of view; noise");
const INSIDE: Tolerance = Tolerance::relative(1e-4, "every path ends on the lamp; lens-like paths are many");

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases = spheres();
    cases.extend(densities());
    cases.extend(just_outside());
    cases.extend(inside());
    cases.extend(flat());
    cases.extend(grazed());
    cases.extend(hidden());
    cases.extend(sides());
    cases.extend(several());
    cases.push(polar_angles());
    cases
}

/// The camera's height over the floor has to be below the tangent of the sphere: half of its elevation, at most 45
/// degrees.
fn spheres() -> Vec<Case> {
    let mut cases = Vec::new();
    let ratios = [1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999];
    for ratio in ratios {
        let elevation = 0.5 * (PI / 2.0 - f64::asin(ratio)).min(PI / 2.0);
        let (sin, cos) = elevation.sin_cos();
        // A patch that is stretched by 1 / sin stays a thousandth of the height.
        let fov = (0.05 * sin).min(0.05);
        let scene = Text::look([cos, sin, 0.0], [0.0; 3], fov)
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 3.0)))
            .block(format!("{}\n{}", lamp(1.0 / (ratio * ratio)), sphere([0.0, 1.0, 0.0], ratio)));
        let what = format!("floor under a sphere of {ratio} times its height");
        cases.push(Case::picture(format!("lamps/sphere-{ratio:e}"), what, scene.end(), 1.0, SPHERE));
        if (1e-5..=0.9).contains(&ratio) {
            let what = format!("the same sampled by area, {ratio} times its height");
            let case =
                Case::picture(format!("lamps/sphere-by-area-{ratio:e}"), what, scene.end(), 1.0, NOISY);
            cases.push(case.by_area());
        }
    }
    cases
}

/// Density of a cone: 1 / (2 pi (1 - cos)), 1 - cos = x / (1 + sqrt(1 - x)), x = (r / d)^2.
fn densities() -> Vec<Case> {
    let one = |(name, radius, distance): (String, f32, f32)| {
        let x = (f64::from(radius) / f64::from(distance)).powi(2);
        let exact = (1.0 + (1.0 - x).sqrt()) / (2.0 * PI * x);
        // Just outside, the rounding of x is doubled by the root of what is left of 1.
        let near = 1e-7 / (1.0 - x).sqrt();
        let tolerance = Tolerance::relative(1e-6 + near, "roundings of (r / d)^2, and of what it lacks to 1");
        Case::compute(
            format!("lamps/cone-density-{name}"),
            format!("density of directions to a sphere of radius {radius:e} from {distance}"),
            exact,
            tolerance,
            move |subject: &Subject| f64::from((subject.formulas.cone_density)(radius, distance)),
        )
    };
    let far = (1..=7).map(|k| (format!("1e-{k}"), 10f32.powi(-k), 1.0));
    let near = (3..=7).map(|k| {
        let gap = 10f64.powi(-k);
        (format!("1-1e-{k}"), (1.0 - gap) as f32, 1.0)
    });
    far.chain(near).map(one).collect()
}

/// Irradiance from a sphere that almost touches: mean of L cos / pdf over a grid of samples, at the kernels' own
/// precision.
fn just_outside() -> Vec<Case> {
    let one = |k: i32| {
        let radius = (1.0 - 10f64.powi(-k)) as f32;
        let expected = f64::from(radius).powi(2);
        let tolerance =
            Tolerance::relative(1e-3, "a grid of 256 x 256 samples; the density's rounding just outside");
        Case::compute(
            format!("lamps/just-outside-1e-{k}"),
            format!("irradiance over pi, 1e-{k} radii from the surface of a sphere"),
            expected,
            tolerance,
            move |_| irradiance(radius),
        )
    };
    (1..=7).map(one).collect()
}

/// Mean over a grid of samples towards a sphere whose centre is 1 above.
fn irradiance(radius: f32) -> Computed {
    const N: usize = 256;
    let scene = super::text::lit(&sphere([0.0, 0.0, 1.0], radius.into()));
    // SAFETY: the scene has one light.
    let light = unsafe { scene.tables().lights().row::<f32>(Uint::splat(0)) };
    let (mut sum, mut invalid) = (0.0, 0);
    for i in 0..N {
        for j in 0..N {
            let u = [i, j].map(|k| (k as f32 + 0.5) / N as f32);
            let s = lights::sample::<f32, AllLights>(&light, Vec3::zero(), u);
            if s.valid {
                let value = f64::from(s.direction.z) / f64::from(s.pdf) / PI;
                invalid += u64::from(!value.is_finite());
                sum += value;
            }
        }
    }
    Computed { value: sum / (N * N) as f64, invalid }
}

/// Materials before and inside of a lamp.
fn inside() -> Vec<Case> {
    let materials = [
        ("lambert", diffuse(0.5), 0.5),
        ("mirror", perfect_mirror(), 1.0),
        ("glass", glass(1.5), 1.0),
        ("thin-glass", "Material \"thindielectric\" \"float eta\" 1.5".to_string(), 1.0),
    ];
    let mut cases = Vec::new();
    for (name, material, expected) in &materials {
        for radius in [0.5, 0.999, 0.999_999] {
            // The camera is half-way between the ball and the lamp.
            let eye = 0.5 * (1.0 + radius);
            let scene = Text::look([0.0, 0.0, eye], [0.0; 3], 20.0)
                .depth(200)
                .block(format!("ReverseOrientation\n{}\n{}", lamp(1.0), sphere([0.0; 3], 1.0)))
                .block(format!("{material}\n{}", sphere([0.0; 3], radius)));
            cases.push(Case::picture(
                format!("lamps/inside-{name}-{radius}"),
                format!("a ball, {name}, of {radius} times the radius of the lamp around it"),
                scene.end(),
                *expected,
                INSIDE,
            ));
        }
        // A square close to the inner side of the lamp, seen from the middle.
        for k in [2, 4, 6] {
            let gap = 10f64.powi(-k);
            // Within the circle in which its plane cuts the lamp.
            let half = 0.5 * (2.0 * gap).sqrt();
            if *name == "glass" {
                continue; // A surface that closes nothing is no glass.
            }
            let fov = (0.2 * half).to_degrees();
            let scene = Text::look([0.0; 3], [0.0, -1.0, 0.0], fov)
                .depth(50)
                .block(format!("ReverseOrientation\n{}\n{}", lamp(1.0), sphere([0.0; 3], 1.0)))
                .block(format!("{material}\n{}", floor(-(1.0 - gap), half)));
            cases.push(Case::picture(
                format!("lamps/near-inner-wall-{name}-1e-{k}"),
                format!("a square, {name}, 1e-{k} from the inner side of a spherical lamp"),
                scene.end(),
                *expected,
                INSIDE,
            ));
        }
    }
    cases
}

/// Disks and squares, from far to so near that they fill the sky.
fn flat() -> Vec<Case> {
    let mut cases = Vec::new();
    for k in [-6, -4, -2, 0, 2, 4, 6] {
        let a = 10f64.powi(k);
        let eye = [1.5, 0.5, 0.0];
        let value = a * a / (a * a + 1.0);
        let scene = Text::look(eye, [0.0; 3], 0.05)
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 3.0)))
            .block(format!(
                "{}\nTranslate 0 1 0\nRotate 90 1 0 0\nShape \"disk\" \"float radius\" [{a:e}]",
                lamp(1.0 / value)
            ));
        cases.push(Case::picture(
            format!("lamps/disk-1e{k}"),
            format!("floor under a disk of 1e{k} times its height"),
            scene.end(),
            1.0,
            FORM_FACTOR,
        ));
        let value = exact::square_above(a, 1.0);
        let scene = Text::look(eye, [0.0; 3], 0.05)
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 3.0)))
            .block(format!("{}\n{}", lamp(1.0 / value), ceiling(1.0, a)));
        cases.push(Case::picture(
            format!("lamps/square-1e{k}"),
            format!("floor under a square of half side 1e{k} times its height"),
            scene.end(),
            1.0,
            FORM_FACTOR,
        ));
    }
    // The sun as a disk, in millimetres.
    let (radius, distance) = (6.96e11, 1.496e14);
    let scene = Text::look([0.3, 1.0, 0.0], [0.0; 3], 0.2)
        .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 0.5)))
        .block(format!(
            "{}\nTranslate 0 {distance:e} 0\nRotate 90 1 0 0\nShape \"disk\" \"float radius\" [{radius:e}]",
            lamp(1e5)
        ));
    cases.push(Case::picture(
        "lamps/sun-in-millimetres",
        "floor under a disk of the sun's size and distance, in millimetres",
        scene.end(),
        1e5 * radius * radius / (radius * radius + distance * distance),
        FORM_FACTOR,
    ));
    cases
}

/// Lamps that stand on the floor, at the horizon, in the plane of the floor.
fn grazed() -> Vec<Case> {
    let mut cases = Vec::new();
    for k in 0..=4 {
        let gap = 10f64.powi(-k);
        let fov = (0.02 * gap).to_degrees();
        let wall = quad([[0.0, 0.0, -1.0], [0.0, 2.0, -1.0], [0.0, 2.0, 1.0], [0.0, 0.0, 1.0]]);
        let scene = Text::look([gap + 0.5, 0.5, 0.0], [gap, 0.0, 0.0], fov)
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 3.0)))
            .block(format!("{} \"bool twosided\" true\n{wall}", lamp(1.0)));
        cases.push(Case::picture(
            format!("lamps/standing-1e-{k}"),
            format!("floor 1e-{k} before a lamp that stands on it"),
            scene.end(),
            exact::wall(1.0, 2.0, gap),
            FORM_FACTOR,
        ));
    }
    // A square of half side 1e-4 at the distance 1 and a small elevation e, upright, faces the point: L A cos e sin e / pi
    // but for (size / elevation)^2.
    for k in 1..=3 {
        let elevation = 10f64.powi(-k);
        let (sin, cos) = elevation.sin_cos();
        let h = 1e-5;
        let tile = quad([[cos, sin - h, -h], [cos, sin - h, h], [cos, sin + h, h], [cos, sin + h, -h]]);
        let radiance = PI / (4.0 * h * h * cos * sin);
        let scene = Text::look([0.0, 1.0, 1.0], [0.0; 3], 0.001)
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 3.0)))
            .block(format!("{} \"bool twosided\" true\n{tile}", lamp(radiance)));
        cases.push(Case::picture(
            format!("lamps/horizon-1e-{k}"),
            format!("floor lit by a small square 1e-{k} above the horizon"),
            scene.end(),
            1.0,
            FORM_FACTOR,
        ));
    }
    let tile = quad([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 1.0], [1.0, 0.0, 1.0]]);
    let scene = Text::look([0.0, 2.0, 1.0], [0.0; 3], 5.0)
        .block(format!(
            "{}\n{}",
            diffuse(1.0),
            quad([[-1.0, 0.0, -1.0], [-1.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.5, 0.0, -1.0],])
        ))
        .block(format!("{} \"bool twosided\" true\n{tile}", lamp(1e6)));
    cases.push(Case::picture(
        "lamps/in-its-plane",
        "floor in the plane of a lamp: no light",
        scene.end(),
        0.0,
        Tolerance::EXACT,
    ));
    cases
}

/// A lamp behind a screen stays hidden.
fn hidden() -> Vec<Case> {
    let one = |k: i32| {
        let gap = 10f64.powi(-k);
        let scene = |lamp_shape: String| {
            Text::look([1.5, 0.5, 0.0], [0.0; 3], 1.0)
                .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 3.0)))
                .block(format!("{}\n{}", diffuse(0.0), floor(1.0 - gap, 0.3)))
                .block(format!("{}\n{lamp_shape}", lamp(1e3)))
                .end()
        };
        let square = Case::picture(
            format!("lamps/hidden-square-1e-{k}"),
            format!("a square lamp 1e-{k} of the distance behind a screen"),
            scene(ceiling(1.0, 0.1)),
            0.0,
            Tolerance::EXACT,
        );
        let ball = Case::picture(
            format!("lamps/hidden-sphere-1e-{k}"),
            format!("a spherical lamp 1e-{k} of the distance behind a screen"),
            scene(sphere([0.0, 1.1, 0.0], 0.1)),
            0.0,
            Tolerance::EXACT,
        );
        [square, ball]
    };
    (2..=6).flat_map(one).collect()
}

/// The side on which a lamp shines.
fn sides() -> Vec<Case> {
    let seen = |name: &str, before: &str, eye: f64, expected: f64| {
        let scene = Text::look([0.0, 0.0, eye], [0.0; 3], 10.0).block(format!(
            "{before}\n{}\n{}",
            lamp(1.0),
            sphere([0.0; 3], 1.0)
        ));
        let what =
            format!("a spherical lamp seen from {eye}{}", if before.is_empty() { "" } else { ", turned" });
        Case::picture(
            format!("lamps/{name}"),
            what,
            scene.end(),
            expected,
            Tolerance::relative(1e-6, "seen as it is"),
        )
    };
    let turned = "ReverseOrientation";
    vec![
        seen("outside-seen-from-outside", "", 1.000_001, 1.0),
        seen("outside-seen-from-inside", "", 0.999_999, 0.0),
        seen("inside-seen-from-outside", turned, 1.000_001, 0.0),
        seen("inside-seen-from-inside", turned, 0.999_999, 1.0),
    ]
}

/// The sun beside a lamp, over floors of all sizes: how large the floor is must not change how well either is sampled. A
/// point light of intensity 1 at height 1 gives 1 / pi, a distant light from above its irradiance over pi.
fn several() -> Vec<Case> {
    let one = |k: i32| {
        let half = 10f64.powi(k);
        let scene = Text::look([1.5, 0.5, 0.0], [0.0; 3], 0.05)
            .add("LightSource \"distant\" \"point3 from\" [0 1 0] \"point3 to\" [0 0 0] \"rgb L\" [0.01 0.01 0.01]")
            .add("LightSource \"point\" \"point3 from\" [0 1 0] \"rgb I\" [1 1 1]")
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, half)));
        Case::picture(
            format!("lamps/sun-and-lamp-1e{k}"),
            format!("floor of half side 1e{k} under a point light and a faint distant one"),
            scene.end(),
            1.01 / PI,
            FORM_FACTOR,
        )
    };
    [0, 2, 4, 6].into_iter().map(one).collect()
}

/// Heights that rounding has put beyond the pole.
fn polar_angles() -> Case {
    Case::compute(
        "lamps/polar-angle-beyond-the-pole",
        "polar angle at the height of the radius and one rounding more",
        0.0,
        Tolerance::EXACT,
        |subject: &Subject| {
            let radius = 0.1f64;
            let value = (subject.formulas.polar_angle)(radius.next_up(), radius);
            Computed { value, invalid: u64::from(!value.is_finite()) }
        },
    )
}
