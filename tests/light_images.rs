//! Pictures that shine: of the sky, through points, on surfaces. How scene files name them, what they bring, and that
//! engines agree about them.

mod support;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use support::{ENGINES, Render, SAMPLERS, scene};
use wavepath::engine::EngineKind;
use wavepath::pbrt;
use wavepath::picture::{Raster, RasterSamples, Transfer};
use wavepath::scene::{Light, LightImage, PictureMapping, Scene, SceneDescription, SkyMapping};

const VIEW: &str = r#"
    LookAt 0 3 -7  0 .6 0  0 1 0
    Camera "perspective" "float fov" 38
    Integrator "path" "integer maxdepth" 5
    Film "rgb" "integer xresolution" 24 "integer yresolution" 17
    PixelFilter "box"
    WorldBegin
"#;

const THINGS: &str = r#"
    Material "diffuse" "rgb reflectance" [ .6 .5 .4 ]
    Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 ] "point3 P" [ -6 0 -6  -6 0 6  6 0 6  6 0 -6 ]
    AttributeBegin Material "conductor" "float roughness" .2
        Translate -1 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "dielectric" Translate 1 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
"#;

/// Looks straight down at a white floor, which it fills; one reflection.
const DOWN: &str = r#"
    LookAt 0 2 0  0 0 0  0 0 1
    Camera "perspective" "float fov" 20
    Integrator "path" "integer maxdepth" 1
    Film "rgb" "integer xresolution" 8 "integer yresolution" 8
    PixelFilter "box"
    WorldBegin
    Material "diffuse" "rgb reflectance" [ 1 1 1 ]
    Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 ] "point3 P" [ -9 0 -9  -9 0 9  9 0 9  9 0 -9 ]
"#;

const TURN: DMat3 = DMat3::from_cols_array(&[0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6]);

fn floats(width: u32, height: u32, colour: impl Fn(u32, u32) -> [f32; 3]) -> Arc<Raster> {
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let samples = places.flat_map(|(x, y)| colour(x, y)).collect();
    Arc::new(Raster::new(width, height, 3, RasterSamples::Floats(samples)).unwrap())
}

/// Dim here and bright there, black in between.
fn patchy(width: u32, height: u32) -> Arc<Raster> {
    floats(width, height, |x, y| match (3 * x + 5 * y) % 17 {
        0 => [30.0, 20.0, 8.0],
        1..9 => [0.1, 0.2, 0.4],
        _ => [0.0; 3],
    })
}

fn add_map(scene: &mut SceneDescription, raster: Arc<Raster>, mapping: SkyMapping, matrix: DMat3) {
    let image = LightImage { image: scene.add_light_image(raster), transfer: Transfer::Linear };
    let light =
        Light::EnvironmentMap { radiance: [1.0; 3], image, mapping, light_from_world: matrix, portal: None };
    scene.lights.push(light);
}

fn add_point(scene: &mut SceneDescription, raster: Arc<Raster>, mapping: PictureMapping, position: DVec3) {
    let image = LightImage { image: scene.add_light_image(raster), transfer: Transfer::Linear };
    scene.lights.push(Light::PicturePoint {
        intensity: [3.0, 4.0, 5.0],
        position,
        image,
        mapping,
        light_from_world: TURN,
        half_size: [1.0, 0.7],
    });
}

/// Scenes with a kind of picture each, and one with all.
fn all_scenes() -> Vec<(&'static str, SceneDescription)> {
    let base = || scene(&format!("{VIEW}{THINGS}"));
    let mut scenes = Vec::new();
    let mut all = scene(&format!(
        "{VIEW}{THINGS}
         LightSource \"infinite\" \"rgb L\" [ .1 .12 .2 ]
         LightSource \"distant\" \"point3 from\" [ 1 4 -2 ]
         AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [ 9 8 7 ]
         Translate 0 4 -1 Shape \"sphere\" \"float radius\" .4 AttributeEnd"
    ));
    for (name, mapping, height) in
        [("equal areas", SkyMapping::EqualArea, 24), ("latitude", SkyMapping::LatLong, 12)]
    {
        let mut one = base();
        add_map(&mut one, patchy(24, height), mapping, TURN);
        scenes.push((name, one));
        add_map(&mut all, patchy(24, height), mapping, TURN.transpose());
    }
    for (name, mapping) in [
        ("projection", PictureMapping::Projection),
        ("smooth projection", PictureMapping::SmoothProjection),
        ("goniometric, equal areas", PictureMapping::EqualArea),
        ("goniometric, latitude", PictureMapping::LatLong),
    ] {
        let mut one = base();
        for x in [-1.0, 1.0] {
            add_point(&mut one, patchy(9, 9), mapping, DVec3::new(x, 3.0, -1.0));
        }
        scenes.push((name, one));
        add_point(&mut all, patchy(8, 8), mapping, DVec3::new(0.0, 3.0, 1.0));
    }
    let mut lamp = scene(&format!(
        "{VIEW}{THINGS} AreaLightSource \"diffuse\" \"rgb L\" [ 1 1 1 ]
         Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \"point3 P\" [ -1 3 -1  1 3 -1  1 3 1  -1 3 1 ]
         \"point2 uv\" [ 0 0 1 0 1 1 0 1 ]"
    ));
    let image = LightImage { image: lamp.add_light_image(patchy(6, 7)), transfer: Transfer::Linear };
    for shape in &mut lamp.shapes {
        if let Some(emission) = &mut shape.emission {
            emission.image = Some(image);
        }
    }
    scenes.extend([("picture on a lamp", lamp), ("all", all)]);
    let mut specular = base();
    specular.materials.iter_mut().for_each(|material| {
        *material = wavepath::scene::Material::Mirror { reflectance: [0.9; 3].into() };
    });
    add_map(&mut specular, patchy(5, 5), SkyMapping::EqualArea, TURN);
    scenes.push(("nothing to sample lights for", specular));
    scenes
}

#[test]
fn engines_threads_and_batches_agree_to_the_bit() {
    for (name, scene) in all_scenes() {
        for sampler in SAMPLERS {
            let render = Render { sampler, spp: Some(6), ..Render::default() };
            let expected = render.of(&scene);
            assert_eq!(expected.developed.invalid, 0, "{name}");
            assert!(expected.mean()[2] > 0.0, "{name}");
            for engine in [EngineKind::Megakernel, EngineKind::MegakernelWide] {
                let other = Render { engine, ..render.clone() }.of(&scene);
                assert!(other.bits() == expected.bits(), "{name}, {sampler:?}, {engine:?}");
                assert_eq!(other.rays(), expected.rays(), "{name}, {sampler:?}, {engine:?}");
            }
            for (threads, batch) in [(1, 64), (3, 1000)] {
                let other = Render { threads, batch, ..render.clone() }.of(&scene);
                assert!(other.bits() == expected.bits(), "{name}, {threads} threads, batch {batch}");
            }
        }
    }
}

#[test]
fn only_scenes_with_pictures_have_their_kernel() {
    let runs = |description: &SceneDescription| {
        let scene = Scene::new("test", description.clone()).unwrap();
        let parts = &scene.plan().parts;
        parts.iter().find(|part| part.name == "shade: environment maps").unwrap().runs
    };
    for (name, scene) in all_scenes() {
        let has = scene.lights.iter().any(|light| matches!(light, Light::EnvironmentMap { .. }));
        assert_eq!(runs(&scene), has, "{name}");
    }
    // A picture that is black all over is none.
    let mut dark = scene(DOWN);
    add_map(&mut dark, floats(4, 4, |_, _| [0.0; 3]), SkyMapping::EqualArea, TURN);
    assert!(!runs(&dark));
    assert_eq!(Render::default().of(&dark).mean(), [0.0; 3]);
}

/// A white picture is a white sky, whatever finds it.
#[test]
fn a_white_picture_is_a_white_sky() {
    for (mapping, matrix) in [
        (SkyMapping::EqualArea, TURN),
        (SkyMapping::LatLong, TURN),
        (SkyMapping::LatLong, DMat3::from_diagonal(DVec3::new(1.0, -2.0, 0.4))),
    ] {
        let mut white = scene(&format!("{VIEW}{THINGS}"));
        let sky = scene(&format!("{VIEW} LightSource \"infinite\" {THINGS}"));
        add_map(&mut white, floats(16, 8, |_, _| [1.0; 3]), mapping, matrix);
        for engine in ENGINES {
            let render = Render { engine, spp: Some(256), ..Render::default() };
            let (map, constant) = (render.of(&white).mean(), render.of(&sky).mean());
            for k in 0..3 {
                let ratio = map[k] / constant[k];
                assert!((ratio - 1.0).abs() < 4e-3, "{mapping:?}, {engine:?}: {ratio}");
            }
        }
    }
}

/// A floor under half a sky of radiance `c` next to a dark one: irradiance pi c / 2 where the border is overhead. And a
/// sun of one texel in 1024 x 512 over a floor: its radiance times solid angle times cosine, over pi.
#[test]
fn floors_get_what_the_sky_sends() {
    let mut half = scene(DOWN);
    // The picture's +z looks along the world's z.
    let bright = |y: u32| if y < 16 { [2.0, 1.0, 0.5] } else { [0.0; 3] };
    add_map(&mut half, floats(64, 32, |_, y| bright(y)), SkyMapping::LatLong, DMat3::IDENTITY);
    let mut sun = scene(DOWN);
    let (x, y) = (200, 100);
    let picture = floats(1024, 512, |i, j| if (i, j) == (x, y) { [4e5, 2e5, 1e5] } else { [0.0; 3] });
    let up = DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y);
    add_map(&mut sun, picture, SkyMapping::LatLong, up);
    let step = std::f64::consts::PI / 512.0;
    let theta = (f64::from(y) + 0.5) * step;
    // A tent of this height over two texels each way, which weighs as much as the texel.
    let sun_sends = 4e5 * step * step * theta.sin() * theta.cos() / std::f64::consts::PI;
    for engine in ENGINES {
        let render = Render { engine, spp: Some(1024), ..Render::default() };
        for (what, description, want) in [("half a sky", &half, 1.0), ("a sun", &sun, sun_sends)] {
            let mean = render.of(description).mean();
            for (found, share) in mean.iter().zip([1.0, 0.5, 0.25]) {
                let ratio = found / (want * share);
                assert!((ratio - 1.0).abs() < 5e-3, "{what}, {engine:?}: {ratio}");
            }
        }
    }
}

/// A lamp that shows a picture of two halves is two lamps.
#[test]
fn a_picture_on_a_lamp_is_where_it_belongs() {
    let lamp = |x: [f64; 2], radiance: &str| {
        let [a, b] = x;
        format!(
            "AttributeBegin Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ]
             AreaLightSource \"diffuse\" {radiance} Shape \"bilinearmesh\"
             \"point3 P\" [ {a} 1 -1  {b} 1 -1  {a} 1 1  {b} 1 1 ] AttributeEnd "
        )
    };
    let folder = tempfile::tempdir().unwrap();
    // The upper row of the file is where v is 1: at the far edge.
    let pixel = |x: usize, y: usize| match (x / 8, y / 8) {
        (0, 0) => [5.0f32, 0.0, 0.0],
        (1, 0) => [0.0, 4.0, 0.0],
        (0, _) => [0.0, 0.0, 3.0],
        _ => [0.0; 3],
    };
    write_pfm(&folder.path().join("four.pfm"), 16, 16, pixel);
    let read = |text: &str| pbrt::load_str(text, "test", folder.path()).unwrap().scene;
    let view = DOWN.replace("LookAt 0 2 0", "LookAt .3 .8 .2");
    let pictured = read(&format!("{view}{}", lamp([-1.0, 1.0], "\"string filename\" \"four.pfm\"")));
    let quarter = |x: [f64; 2], z: [f64; 2], radiance: &str| {
        let [[a, b], [c, d]] = [x, z];
        format!(
            "AttributeBegin Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ]
             AreaLightSource \"diffuse\" \"rgb L\" [ {radiance} ] Shape \"bilinearmesh\"
             \"point3 P\" [ {a} 1 {c}  {b} 1 {c}  {a} 1 {d}  {b} 1 {d} ] AttributeEnd "
        )
    };
    let parts = [
        quarter([-1.0, 0.0], [0.0, 1.0], "5 0 0"),
        quarter([0.0, 1.0], [0.0, 1.0], "0 4 0"),
        quarter([-1.0, 0.0], [-1.0, 0.0], "0 0 3"),
    ];
    let parted = read(&format!("{view}{}", parts.concat()));
    for engine in ENGINES {
        let render = Render { engine, spp: Some(512), ..Render::default() };
        let (pictured, parted) = (render.of(&pictured).mean(), render.of(&parted).mean());
        for k in 0..3 {
            // Interpolation blurs the borders.
            let ratio = pictured[k] / parted[k];
            assert!((ratio - 1.0).abs() < 0.03, "{engine:?}, channel {k}: {ratio}");
        }
    }
}

/// A projection of four fields onto the floor.
#[test]
fn projections_fall_where_they_should() {
    let folder = tempfile::tempdir().unwrap();
    // Red, green; blue, black.
    let pixel = |x: usize, y: usize| match (x / 4, y / 4) {
        (0, 0) => [1.0f32, 0.0, 0.0],
        (1, 0) => [0.0, 1.0, 0.0],
        (0, _) => [0.0, 0.0, 1.0],
        _ => [0.0; 3],
    };
    write_pfm(&folder.path().join("four.pfm"), 8, 8, pixel);
    let colours = |light: &str| {
        let text = format!("{DOWN} AttributeBegin Translate 0 1 0 Rotate 90 1 0 0 {light} AttributeEnd");
        let text = match light.contains("mapname") {
            true => text.replace("\"rgb\"", "\"image\"").replace("point3", "point"),
            false => text,
        };
        let description = pbrt::load_str(&text, "test", folder.path()).unwrap().scene;
        let image = Render { spp: Some(16), ..Render::default() }.of(&description).image;
        // The camera sees x to the right and z upwards.
        [(1, 1), (6, 1), (1, 6), (6, 6)].map(|(x, y)| {
            let pixel = image.pixel(x, y);
            (0..3).find(|&k| pixel[k] > 0.0)
        })
    };
    // The light shines down, with its y along the world's z; version 4 has the picture upright in there.
    let four = colours("LightSource \"projection\" \"string filename\" \"four.pfm\" \"float fov\" 90");
    let three = colours("LightSource \"projection\" \"string mapname\" \"four.pfm\" \"float fov\" 90");
    assert_eq!(four, [Some(0), Some(1), Some(2), None]);
    assert_eq!(three, [Some(2), None, Some(0), Some(1)]);
}

fn write_pfm(path: &Path, width: usize, height: usize, pixel: impl Fn(usize, usize) -> [f32; 3]) {
    let mut bytes = format!("PF\n{width} {height}\n-1\n").into_bytes();
    for y in (0..height).rev() {
        for x in 0..width {
            bytes.extend(pixel(x, y).iter().flat_map(|c| c.to_le_bytes()));
        }
    }
    std::fs::write(path, bytes).unwrap();
}

struct Files(tempfile::TempDir);

impl Files {
    fn new() -> Self {
        let files = Files(tempfile::tempdir().unwrap());
        write_pfm(&files.path("square.pfm"), 64, 64, |_, _| [1.0, 2.0, 3.0]);
        write_pfm(&files.path("wide.pfm"), 8, 4, |_, _| [1.0; 3]);
        write_pfm(&files.path("nan.pfm"), 4, 4, |x, y| [if (x, y) == (2, 1) { f32::NAN } else { 1.0 }; 3]);
        files
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn read(&self, text: &str) -> Result<SceneDescription, String> {
        let film = if text.contains("mapname") { "image" } else { "rgb" };
        let head = format!("Film \"{film}\" WorldBegin\n");
        let loaded = pbrt::load_str(&format!("{head}{text}"), "t.pbrt", self.0.path());
        loaded.map(|loaded| loaded.scene).map_err(|error| error.to_string())
    }
}

#[test]
fn scenes_name_their_skies() {
    let files = Files::new();
    let read = |text: &str| files.read(text).unwrap_or_else(|error| panic!("{error}"));
    let scene = read(
        "Rotate 90 0 0 1 LightSource \"infinite\" \"string filename\" \"square.pfm\" \"float scale\" 3\n\
         LightSource \"infinite\" \"string filename\" \"square.pfm\" \"float illuminance\" 7",
    );
    assert_eq!(scene.light_images.len(), 1, "read once");
    let Light::EnvironmentMap { radiance, mapping, light_from_world, portal, .. } = scene.lights[0] else {
        panic!("{:?}", scene.lights)
    };
    assert_eq!((radiance, mapping, portal), ([3.0; 3], SkyMapping::EqualArea, None));
    assert!((light_from_world * DVec3::Y - DVec3::X).length() < 1e-12);
    // A hemisphere of luminance L has the illuminance pi L; pbrt takes it for half of that.
    let Light::EnvironmentMap { radiance, .. } = scene.lights[1] else { panic!() };
    let luminance = 0.2126 + 2.0 * 0.7152 + 3.0 * 0.0722;
    let want = 7.0 / (luminance * std::f64::consts::PI / 2.0);
    assert!((f64::from(radiance[0]) / want - 1.0).abs() < 0.02, "{radiance:?}, {want}");

    let three = read("LightSource \"infinite\" \"string mapname\" \"wide.pfm\" \"rgb L\" [ 1 2 3 ]");
    let Light::EnvironmentMap { radiance, mapping, image, .. } = three.lights[0] else { panic!() };
    assert_eq!((radiance, mapping), ([1.0, 2.0, 3.0], SkyMapping::LatLong));
    assert_eq!(image.transfer, Transfer::Linear);

    let portal = "\"point3 portal\" [ 0 0 0  2 0 0  2 0 3  0 0 3 ]";
    let scene = read(&format!("Scale 2 2 2 LightSource \"infinite\" {portal} \"rgb L\" [ 1 2 3 ]"));
    let Light::EnvironmentMap { radiance, portal: Some(opening), .. } = scene.lights[0] else { panic!() };
    assert_eq!(radiance, [1.0, 2.0, 3.0]);
    assert_eq!(opening, [DVec3::ZERO, DVec3::Z * 3.0, DVec3::X * 2.0]);
}

#[test]
fn wrong_pictures_are_named_with_their_place() {
    let files = Files::new();
    for (text, expected) in [
        ("LightSource \"infinite\" \"string filename\" \"wide.pfm\"", vec!["t.pbrt:2:42", "8 x 4", "equal"]),
        (
            "LightSource \"infinite\" \"string filename\" \"no.exr\"",
            vec!["t.pbrt:2:42", "no.exr", "expected an image"],
        ),
        ("LightSource \"infinite\" \"string filename\" \"nan.pfm\"", vec!["t.pbrt:2:42", "column 2, row 1"]),
        (
            "LightSource \"infinite\" \"string filename\" \"square.pfm\" \"rgb L\" [ 1 1 1 ]",
            vec!["t.pbrt:2:55", "\"L\"", "\"filename\""],
        ),
        ("LightSource \"infinite\" \"point3 portal\" [ 0 0 0 1 0 0 ]", vec!["2 corners", "four"]),
        ("LightSource \"infinite\" \"point3 portal\" [ 0 0 0 1 0 0 3 0 1 0 0 1 ]", vec!["no rectangle"]),
        ("LightSource \"projection\"", vec!["t.pbrt:2:1", "without an image"]),
        (
            "LightSource \"projection\" \"string filename\" \"wide.pfm\" \"float fov\" 180",
            vec!["fov", "below 180"],
        ),
        ("LightSource \"goniometric\" \"string filename\" \"wide.pfm\"", vec!["8 x 4"]),
        (
            "AreaLightSource \"diffuse\" \"string filename\" \"square.pfm\" Shape \"sphere\"",
            vec!["a picture on the area light", "not supported"],
        ),
    ] {
        let error = files.read(&format!("{text} Shape \"disk\"")).unwrap_err();
        for expected in expected {
            assert!(error.contains(expected), "{expected} in: {error}");
        }
    }
}

#[test]
fn points_and_lamps_with_pictures_have_their_power() {
    let files = Files::new();
    let read = |text: &str| files.read(text).unwrap_or_else(|error| panic!("{error}"));
    let luminance = 0.2126 + 2.0 * 0.7152 + 3.0 * 0.0722;
    let scene = read(
        "LightSource \"goniometric\" \"string filename\" \"square.pfm\" \"float power\" 8\n\
         LightSource \"projection\" \"string filename\" \"square.pfm\" \"float power\" 8 \"float fov\" 90\n\
         AreaLightSource \"diffuse\" \"string filename\" \"square.pfm\" \"float power\" 8\n\
         Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 ]",
    );
    let pi = std::f64::consts::PI;
    // The mean of the channels is 2; a face of a cube is a sixth of the sphere.
    for (light, want) in [(0, 8.0 / (4.0 * pi * 2.0)), (1, 8.0 / (luminance * 4.0 * pi / 6.0))] {
        let Light::PicturePoint { intensity, .. } = scene.lights[light] else { panic!() };
        assert!((f64::from(intensity[0]) / want - 1.0).abs() < 0.02, "{intensity:?}, {want}");
    }
    let emission = scene.shapes[0].emission.unwrap();
    assert!((f64::from(emission.radiance[0]) * luminance - 1.0).abs() < 1e-3 && emission.power == Some(8.0));
    assert_eq!(scene.meshes[0].uvs, [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]);
}
