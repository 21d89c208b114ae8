//! The battery of stiff and extreme cases: a part of it in every run of the tests, that it can fail, and the command.
//!
//! `wavepath stability` runs all of it.

use std::process::{Command, Output};
use wavepath::stability::formulas::Ray;
use wavepath::stability::{self, Case, Formulas, Row, Subject, Verdict};
use wavepath_kernels::scene::Geometry;

/// Names of cases that the short run takes, by what they begin with: some of every family, and what is quick.
const SHORT: [&str; 26] = [
    "scale/lamp-1e-8",
    "scale/lamp-1e8",
    "scale/ball-1e",
    "scale/box-1e",
    "moved/ball-1e3",
    "turned/",
    "lamps/sphere-1e",
    "lamps/cone-density",
    "lamps/just-outside",
    "lamps/disk-",
    "lamps/in-its-plane",
    "lamps/inside-seen",
    "lamps/outside-seen",
    "radiance/emission-1e",
    "radiance/furnace-depth",
    "diffuse/oren-nayar-20",
    "diffuse/lambert",
    "diffuse/reciprocity",
    "conductors/fresnel-2e-1",
    "conductors/furnace-1e-1",
    "glass/critical",
    "glass/furnace-1.5",
    "triangles/needle",
    "spheres/far-1e7",
    "cameras/fov",
    "samplers/late",
];

fn chosen(wanted: impl Fn(&str) -> bool) -> Vec<Case> {
    stability::cases().into_iter().filter(|case| wanted(&case.name)).collect()
}

fn failures(rows: &[Row]) -> Vec<String> {
    let failing = rows.iter().filter(|row| row.verdict.is_failure());
    failing.map(|row| format!("{}: {} for {} {:?}", row.name, row.found, row.expected, row.failure)).collect()
}

#[test]
fn a_part_of_the_battery_passes() {
    let cases = chosen(|name| SHORT.iter().any(|part| name.starts_with(part)));
    assert!(cases.len() > 60, "{}", cases.len());
    let rows = stability::run_all(&cases, &Subject::default(), |_| {});
    assert_eq!(failures(&rows), Vec::<String>::new());
}

// Textbook formulas that single precision breaks.

/// 1 - cos of the half opening, as it is written: 0 for small spheres.
fn naive_cone_density(radius: f32, distance: f32) -> f32 {
    let ratio = radius / distance;
    let cos = (1.0 - ratio * ratio).sqrt();
    1.0 / (2.0 * std::f32::consts::PI * (1.0 - cos))
}

/// Moeller and Trumbore (1997), with their epsilon and without a bound of the error.
fn moeller_trumbore(corners: [[f32; 3]; 3], (origin, direction): Ray) -> bool {
    let sub = |a: [f32; 3], b: [f32; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = |a: [f32; 3], b: [f32; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let (e1, e2) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
    let p = cross(direction, e2);
    let determinant = dot(e1, p);
    if determinant.abs() < 1e-6 {
        return false;
    }
    let s = sub(origin, corners[0]);
    let u = dot(s, p) / determinant;
    let q = cross(s, e1);
    let v = dot(direction, q) / determinant;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && dot(e2, q) / determinant > 1e-6
}

fn naive_meets(geometry: &Geometry, rays: &[Ray]) -> Vec<bool> {
    let all = 0..geometry.triangles().len();
    rays.iter().map(|&ray| all.clone().any(|t| moeller_trumbore(geometry.corners(t), ray))).collect()
}

/// The point at the distance, moved by a constant along the normal.
fn naive_leave(geometry: &Geometry, primitive: u32, ray: Ray, t: f32, direction: [f32; 3]) -> [f32; 3] {
    let [x, y, z, _] = geometry.surfaces()[4 * primitive as usize..][..4] else { unreachable!() };
    let n = [x, y, z];
    let side = (0..3).map(|k| n[k] * direction[k]).sum::<f32>().signum();
    std::array::from_fn(|k| ray.0[k] + t * ray.1[k] + 1e-4 * side * n[k])
}

/// The arc cosine as it is: no number beyond the poles.
fn naive_polar_angle(z: f64, radius: f64) -> f64 {
    (z / radius).acos()
}

/// Cases that fail with these formulas.
fn caught_by(formulas: Formulas) -> Vec<String> {
    let cases = chosen(|name| {
        ["lamps/cone-density", "lamps/polar-angle", "triangles/offset", "triangles/watertight-test"]
            .iter()
            .any(|part| name.starts_with(part))
    });
    let rows = stability::run_all(&cases, &Subject { formulas, ..Subject::default() }, |_| {});
    rows.into_iter().filter(|row| row.verdict == Verdict::Fail).map(|row| row.name).collect()
}

#[test]
fn naive_formulas_are_caught() {
    let own = Formulas::default();
    assert_eq!(caught_by(own), Vec::<String>::new(), "the kernels' own formulas pass");
    let caught = caught_by(Formulas { cone_density: naive_cone_density, ..own });
    for case in ["lamps/cone-density-1e-7", "lamps/cone-density-1e-4", "lamps/cone-density-1e-3"] {
        assert!(caught.iter().any(|name| name == case), "1 - cos: {caught:?}");
    }
    let caught = caught_by(Formulas { meets: naive_meets, ..own });
    assert_eq!(caught, ["triangles/watertight-test"], "Moeller and Trumbore");
    let caught = caught_by(Formulas { leave: naive_leave, ..own });
    for case in ["triangles/offset-1e-8", "triangles/offset-1e-4", "triangles/offset-1e8"] {
        assert!(caught.iter().any(|name| name == case), "a constant offset: {caught:?}");
    }
    let caught = caught_by(Formulas { polar_angle: naive_polar_angle, ..own });
    assert_eq!(caught, ["lamps/polar-angle-beyond-the-pole"], "unclamped acos");
}

fn wavepath(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wavepath")).args(words).output().unwrap()
}

#[test]
fn the_command_writes_tables_and_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().display().to_string();
    let few =
        ["stability", "--case", "radiance/furnace-depth", "--case", "samplers/ends-lambert", "-o", &name];
    let output = wavepath(&few);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}");
    assert!(
        text.contains("radiance/furnace-depth-3 ") && text.contains("14 cases: 14 pass, 0 fail"),
        "{text}"
    );
    let page = std::fs::read_to_string(folder.path().join("stability.html")).unwrap();
    assert!(page.contains("furnace-depth-3") && !page.contains("://"), "the page stands alone");
    let json = std::fs::read_to_string(folder.path().join("stability.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), 14);
    assert_eq!(json["rows"][0]["verdict"], "pass");

    let output = wavepath(&["stability", "--case", "furnace-depth-0", "--json", "--engine", "megakernel"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["engine"].as_str(), json["rows"][0]["found"].as_f64()), (Some("megakernel"), Some(1.0)));

    let output = wavepath(&["stability", "--case", "no such case"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--list"));
    let output = wavepath(&["stability", "--isa", "mmx"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("expected a set that this machine has"));
}

#[test]
fn check_prints_what_it_finds_and_render_what_is_severe() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("hidden.pbrt");
    let text = "LookAt 0 0 5 0 0 0 0 1 0\nCamera \"perspective\"\n\
                Film \"rgb\" \"integer xresolution\" 2 \"integer yresolution\" 2\nWorldBegin\n\
                LightSource \"point\"\nShape \"sphere\"\n\
                Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2 2 1 0]\n";
    std::fs::write(&scene, text).unwrap();
    let name = scene.display().to_string();
    let output = wavepath(&["check", &name]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains(&format!("severe: {name}:6: a point light")), "{text}");
    assert!(text.contains(&format!("note: {name}:7: 1 triangles stand")), "{text}");
    assert!(text.contains("1 severe, 1 notes") && text.contains("digits are left"), "{text}");
    let output = wavepath(&["check", &name, "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (json["findings"][0]["kind"].as_str(), json["findings"][0]["line"].as_u64()),
        (Some("hidden-light"), Some(6))
    );
    let image = folder.path().join("a.png").display().to_string();
    let output = wavepath(&["render", &name, "-o", &image, "--spp", "1"]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    assert!(
        errors.contains("hidden.pbrt:6:1: a point light") && !errors.contains("stand at the place"),
        "{errors}"
    );
    let output = wavepath(&["check", "nowhere.pbrt"]);
    assert_eq!(output.status.code(), Some(2));
}
