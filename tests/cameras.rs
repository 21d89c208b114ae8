//! Cameras that are not perspective: what stands where in their images, and that engines agree about them.

mod support;

use support::{ENGINES, Render, SAMPLERS, scene};
use wavepath::pbrt;
use wavepath::scene::{CameraKind, SkyMapping};

/// Lamps, black otherwise, around the origin: towards +x red, +y green, +z blue, and behind (-z) white.
const AROUND: &str = r#"
    Material "diffuse" "rgb reflectance" [ 0 0 0 ]
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 1 0 0 ] Translate 5 0 0 Shape "sphere" AttributeEnd
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 0 1 0 ] Translate 0 5 0 Shape "sphere" AttributeEnd
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 0 0 1 ] Translate 0 0 5 Shape "sphere" AttributeEnd
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 1 1 1 ] Translate 0 0 -5 Shape "sphere" AttributeEnd
"#;

fn view(camera: &str, width: u32, height: u32) -> String {
    format!(
        "Camera {camera} Film \"rgb\" \"integer xresolution\" {width} \"integer yresolution\" {height}
         PixelFilter \"box\" WorldBegin\n"
    )
}

#[test]
fn directions_have_their_places() {
    // Equal areas: up (camera y) in the middle, x at the right edge, z at the lower one, -z at the upper one.
    // By azimuth: from x over z; up is the upper row.
    for (mapping, width, height, places) in [
        ("equalarea", 64, 64, [(63, 32), (32, 32), (32, 63), (32, 0)]),
        ("equirectangular", 64, 32, [(0, 16), (20, 0), (16, 16), (48, 16)]),
    ] {
        let camera = format!("\"spherical\" \"string mapping\" \"{mapping}\"");
        let around = scene(&format!("{}{AROUND}", view(&camera, width, height)));
        let image = Render { spp: Some(16), ..Render::default() }.of(&around).image;
        let colours = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]];
        for ((x, y), colour) in places.into_iter().zip(colours) {
            assert_eq!(image.pixel(x, y), colour, "{mapping}: {x}, {y}");
        }
        // A lamp of radius 1 at distance 5 fills (1 - cos) / 2 of the sphere; its image as much of the square.
        if mapping == "equalarea" {
            let mean = image.pixels.iter().map(|p| f64::from(p[1])).sum::<f64>() / image.pixels.len() as f64;
            let want = 2.0 * (1.0 - 0.96f64.sqrt()) / 2.0;
            assert!((mean / want - 1.0).abs() < 0.02, "{mean}, expected {want}");
        }
    }
}

#[test]
fn an_orthographic_camera_sees_sizes_whatever_the_distance() {
    // Two squares of the same size at different distances, left and right.
    let square = |x: f64, z: f64, colour: &str| {
        format!(
            "AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [ {colour} ] \"bool twosided\" true
             Shape \"bilinearmesh\" \"point3 P\" [ {x} 0 {z} {} 0 {z} {x} 1 {z} {} 1 {z} ] AttributeEnd ",
            x + 1.0,
            x + 1.0
        )
    };
    let things = format!(
        "Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ] {}{}",
        square(-2.0, 3.0, "1 0 0"),
        square(1.0, 30.0, "0 1 0")
    );
    let camera = "\"orthographic\" \"float screenwindow\" [ -4 4 -2 2 ]";
    let picture = scene(&format!("{}{things}", view(camera, 64, 32)));
    assert_eq!(picture.camera.kind, CameraKind::Orthographic);
    for engine in ENGINES {
        let image = Render { engine, spp: Some(4), ..Render::default() }.of(&picture).image;
        let seen = |k: usize| {
            let at = (0..64 * 32).filter(|&i| image.pixels[i][k] > 0.5);
            at.map(|i| (i % 64, i / 64)).collect::<Vec<_>>()
        };
        // 8 pixels a unit: x from -2 is column 16, y from 0 to 1 rows 8 to 15.
        let block = |x: usize| -> Vec<_> { (8..16).flat_map(|y| (x..x + 8).map(move |x| (x, y))).collect() };
        assert_eq!(seen(0), block(16));
        assert_eq!(seen(1), block(40));
    }
}

#[test]
fn engines_agree_to_the_bit() {
    for camera in [
        "\"orthographic\"",
        "\"orthographic\" \"float lensradius\" .1 \"float focaldistance\" 4",
        "\"spherical\"",
        "\"spherical\" \"string mapping\" \"equirectangular\"",
    ] {
        let text = view(camera, 20, 14).replace("\"box\"", "\"gaussian\" \"float xradius\" 3");
        let text = format!(
            "LookAt .1 .2 .3 1 2 3 0 1 0 {text} LightSource \"infinite\" {AROUND} Material \"diffuse\" Shape \"disk\" \"float radius\" 9"
        );
        let scene = scene(&text);
        for sampler in SAMPLERS {
            let [a, b] = ENGINES
                .map(|engine| Render { engine, sampler, spp: Some(6), ..Render::default() }.of(&scene));
            assert!(a.bits() == b.bits(), "{camera}, {sampler:?}");
            assert_eq!((a.rays(), a.developed.invalid), (b.rays(), 0), "{camera}, {sampler:?}");
        }
    }
}

/// As in pbrt, a lens makes a perspective of it, whose points in focus are those of the screen window.
#[test]
fn an_orthographic_lens_keeps_the_plane_in_focus() {
    let square = "Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ]
        AreaLightSource \"diffuse\" \"rgb L\" [ 1 1 1 ] \"bool twosided\" true
        Shape \"bilinearmesh\" \"point3 P\" [ 0 0 6 1 0 6 0 1 6 1 1 6 ]";
    let camera = "\"orthographic\" \"float screenwindow\" [ -2 2 -2 2 ] \"float lensradius\" .5 \"float focaldistance\" 6";
    let image = Render { spp: Some(16), ..Render::default() }
        .of(&scene(&format!("{}{square}", view(camera, 16, 16))))
        .image;
    for y in 0..16 {
        for x in 0..16 {
            let inside = (8..12).contains(&x) && (4..8).contains(&y);
            assert_eq!(image.pixel(x, y)[0] > 0.9, inside, "{x}, {y}");
        }
    }
}

#[test]
fn scene_files_name_them() {
    let kind = |text: &str| {
        pbrt::load_str(text, "t", "".as_ref())
            .map(|loaded| loaded.scene.camera.kind)
            .map_err(|e| e.to_string())
    };
    let world = "WorldBegin LightSource \"infinite\"";
    let four = |camera: &str| kind(&format!("Camera {camera} Film \"rgb\" {world}"));
    assert_eq!(four("\"spherical\""), Ok(CameraKind::Spherical(SkyMapping::EqualArea)));
    let three = kind(&format!("Camera \"environment\" {world}"));
    assert_eq!(three, Ok(CameraKind::Spherical(SkyMapping::LatLong)));
    assert!(four("\"spherical\" \"string mapping\" \"cube\"").unwrap_err().contains("equirectangular"));
    assert!(four("\"realistic\"").unwrap_err().contains("not supported"));
}
