//! Scenes that single precision does not hold without care: large and small, thin, and far from the origin. Values are
//! known in closed form; both engines and all traversals give the same bits.

mod support;

use support::{ENGINES, Render, Rendered, scene};
use wavepath::compare::compare;
use wavepath_kernels::intersect::Policy;

const SKY: &str = "LightSource \"infinite\" \"rgb L\" [1 1 1]";
const BLACK: &str = "Material \"diffuse\" \"rgb reflectance\" [0 0 0]";
const WHITE: &str = "Material \"diffuse\" \"rgb reflectance\" [1 1 1]";
const GLASS: &str = "Material \"dielectric\" \"float eta\" 1.5";

/// The head of a scene.
fn view(eye: [f64; 3], look: [f64; 3], fov: f64, size: u32, spp: u32, depth: u32) -> String {
    let [a, b, c] = eye;
    let [x, y, z] = look;
    format!(
        "LookAt {a} {b} {c}  {x} {y} {z}  0 0 1\nCamera \"perspective\" \"float fov\" {fov}\n\
         Film \"rgb\" \"integer xresolution\" {size} \"integer yresolution\" {size}\nPixelFilter \"box\"\n\
         Sampler \"sobol\" \"integer pixelsamples\" {spp}\nIntegrator \"path\" \"integer maxdepth\" {depth}\nWorldBegin\n"
    )
}

fn ball(centre: [f64; 3], radius: f64) -> String {
    let [x, y, z] = centre;
    format!("AttributeBegin Translate {x} {y} {z} Shape \"sphere\" \"float radius\" {radius} AttributeEnd\n")
}

/// A rectangle across the z axis, with its normal up or down.
fn square(z: f64, half: f64, up: bool) -> String {
    let order = if up { "0 1 2 0 2 3" } else { "0 2 1 0 3 2" };
    let h = half;
    format!(
        "Shape \"trianglemesh\" \"integer indices\" [{order}] \
         \"point3 P\" [-{h} -{h} {z} {h} -{h} {z} {h} {h} {z} -{h} {h} {z}]\n"
    )
}

/// Renders with both engines and through all traversals, which agree to the bit.
fn rendered(what: &str, text: &str) -> Rendered {
    let scene = scene(text);
    let render = Render { spp: None, ..Render::default() };
    let one = render.of(&scene);
    assert_eq!(one.developed.invalid, 0, "{what}: invalid samples");
    let policies = [Policy::Single, Policy::Packets, Policy::Interleaved, Policy::Sorted];
    let others = policies.into_iter().map(|policy| Render { policy, ..render.clone() });
    let engines = ENGINES.into_iter().map(|engine| Render { engine, threads: 1, ..render.clone() });
    for other in others.chain(engines) {
        assert_eq!(other.of(&scene).bits(), one.bits(), "{what}: {other:?}");
    }
    one
}

fn mean(rendered: &Rendered) -> f64 {
    let pixels = &rendered.image.pixels;
    pixels.iter().flatten().map(|&x| f64::from(x)).sum::<f64>() / (3 * pixels.len()) as f64
}

fn assert_mean(what: &str, text: &str, expected: f64, tolerance: f64) {
    let found = mean(&rendered(what, text));
    assert!((found - expected).abs() <= tolerance * expected, "{what}: {found}, not {expected}");
}

/// A black ball of radius r with its centre r over a floor, seen from a point of the floor at distance d, takes
/// r^2 h / (d^2 + h^2)^(3/2) of the irradiance of the sky, h = r (the form factor of a sphere).
#[test]
fn balls_on_spheres_that_stand_for_the_ground() {
    let d = 0.6f64;
    let expected = 1.0 - 1.0 / (d * d + 1.0).powf(1.5);
    for radius in [1e2, 1e4, 1e5, 1e6] {
        let text = format!(
            "{}{SKY}\n{WHITE}\n{}{BLACK}\n{}",
            view([3.6, 0.3, 1.5], [d, 0.0, -d * d / (2.0 * radius)], 0.05, 8, 64, 1),
            ball([0.0, 0.0, -radius], radius),
            ball([0.0, 0.0, 1.0], 1.0),
        );
        // The ground falls away below the ball.
        let tolerance = 0.01 + 1.0 / radius;
        assert_mean(&format!("ball on a ground of radius {radius}"), &text, expected, tolerance);
    }
}

/// Nothing absorbs.
#[test]
fn hollow_glass_with_thin_walls_is_white() {
    for wall in [1e-2, 1e-4, 1e-6] {
        let inner = ball([0.0; 3], 1.0 - wall);
        let text = format!(
            "{}{SKY}\n{GLASS}\n{}ReverseOrientation\n{inner}",
            view([0.0, 3.0, 0.2], [0.0; 3], 30.0, 8, 64, 300),
            ball([0.0; 3], 1.0),
        );
        assert_mean(&format!("walls of {wall}"), &text, 1.0, 2e-3);
    }
}

/// Before black, a sheet of reflectance R at each side shows 2 R / (1 + R) of the sky (Born and Wolf, section 1.6, without
/// interference), whatever its thickness.
#[test]
fn thick_and_thin_sheets_of_glass() {
    let (cos, sin) = (0.5f64, 0.75f64.sqrt());
    let cos_t = (1.0 - (sin / 1.5).powi(2)).sqrt();
    let [parallel, perpendicular] =
        [(1.5 * cos - cos_t) / (1.5 * cos + cos_t), (cos - 1.5 * cos_t) / (cos + 1.5 * cos_t)].map(|r| r * r);
    let r = 0.5 * (parallel + perpendicular);
    for thickness in [1e-1, 1e-4, 1e-6] {
        let text = format!(
            "{}{SKY}\n{GLASS}\n{}{}{BLACK}\n{}",
            view([-2.0 * sin, 0.0, 2.0 * cos], [0.0; 3], 0.05, 8, 256, 200),
            square(0.5 * thickness, 1.0, true),
            square(-0.5 * thickness, 1.0, false),
            square(-0.5, 3.0, true),
        );
        assert_mean(&format!("a sheet of {thickness}"), &text, 2.0 * r / (1.0 + r), 0.02);
    }
}

/// A scene far from the origin looks as it does there.
#[test]
fn scenes_far_from_the_origin() {
    let text = |at: [f64; 3]| {
        let [x, y, z] = at;
        let [eye, look] = [[x, y - 6.0, z + 1.2], [x, y, z + 0.6]];
        format!(
            "{}{SKY}\nTranslate {x} {y} {z}\nMaterial \"diffuse\" \"rgb reflectance\" [.3 .3 .3]\n{}\
             Material \"diffuse\" \"rgb reflectance\" [.8 .8 .8]\n{}\
             Translate 2 0 0 Scale .5 .5 .7 Shape \"cylinder\" \"float zmin\" 0\nTranslate -4 1 1 Shape \"disk\"\n\
             AreaLightSource \"diffuse\" \"rgb L\" [2 1 1] Translate 0 0 5 ReverseOrientation Shape \"disk\" \"float radius\" .5\n",
            view(eye, look, 25.0, 32, 16, 4),
            square(0.0, 30.0, true),
            ball([0.0, 0.0, 1.0], 1.0),
        )
    };
    let near = rendered("at the origin", &text([0.0; 3]));
    for far in [1e4, 1e6, 1e9, 1e12] {
        let moved = rendered(&format!("at {far}"), &text([far, 0.7 * far, 0.3 * far]));
        // What double precision has lost of the camera's place is 1e-4 at 1e12.
        let error = compare(&moved.image, &near.image).unwrap().relmse;
        assert!(error < 1e-3, "at {far}: relMSE {error}");
        assert!((mean(&moved) / mean(&near) - 1.0).abs() < 2e-3, "at {far}");
    }
}

/// A lamp close behind a screen stays hidden.
#[test]
fn lamps_behind_screens() {
    for gap in [1e-2, 1e-4] {
        let lamp = "AreaLightSource \"diffuse\" \"rgb L\" [1000 1000 1000]";
        let lamps = [square(1.0, 0.1, false), ball([0.0, 0.0, 1.1], 0.1)];
        for shape in lamps {
            let text = format!(
                "{}{WHITE}\n{}{BLACK}\n{}{lamp}\n{shape}",
                view([1.5, 0.0, 0.5], [0.0; 3], 1.0, 8, 64, 3),
                square(0.0, 3.0, true),
                square(1.0 - gap, 0.3, false),
            );
            assert_mean(&format!("a lamp {gap} behind a screen"), &text, 0.0, 0.0);
        }
    }
}
