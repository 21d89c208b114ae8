//! What is set from outside of a scene: the same as if the file had it, and an error that helps where there is no such thing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use wavepath::Render;
use wavepath::glam::DVec3;
use wavepath::pbrt::{self, LoadOptions, Override};
use wavepath::scene::{Light, Material, Parameter, Scene, SceneDescription, SceneOptions};

const SCENE: &str = r#"LookAt 0 0 -5  0 0 0  0 1 0
Camera "perspective" "float fov" 30
Film "rgb" "integer xresolution" 16 "integer yresolution" 12
Sampler "sobol" "integer pixelsamples" 2
WorldBegin
LightSource "infinite" "rgb L" [ 0.5 1 2 ]
LightSource "point" "float scale" 3 "point3 from" [ 0 5 0 ]
MakeNamedMaterial "my.clay" "string type" "diffuse" "rgb reflectance" [ 0.25 0.5 0.75 ]
Material "conductor" "float roughness" 0.25
Shape "sphere"
NamedMaterial "my.clay"
Shape "sphere" "float radius" 0.5
"#;

fn set(settings: &[&str]) -> LoadOptions {
    let set = settings.iter().map(|text| text.parse().unwrap()).collect();
    LoadOptions { set, ..LoadOptions::default() }
}

fn load(text: &str, settings: &[&str]) -> Result<pbrt::Loaded, pbrt::Error> {
    pbrt::load_text(text.as_bytes(), "scene", Path::new(""), &set(settings))
}

#[track_caller]
fn scene(settings: &[&str]) -> SceneDescription {
    load(SCENE, settings).unwrap_or_else(|error| panic!("{error}")).scene
}

#[track_caller]
fn refused(settings: &[&str], expected: &[&str]) {
    let message = load(SCENE, settings).unwrap_err().to_string();
    for part in expected {
        assert!(message.contains(part), "{settings:?}: no {part:?} in {message}");
    }
}

#[test]
fn parameters_of_every_kind_of_directive() {
    let plain = scene(&[]);
    let changed = scene(&[
        "camera.fov=45",
        "camera.lensradius = 0.1",
        "film.xresolution=32",
        "sampler.pixelsamples=9",
        "sampler.type=independent",
        "integrator.maxdepth=3",
        "filter.type=mitchell",
        "filter.B=0.5",
        "light.0.L=1, 2, 3",
        "light.1.scale=7",
        "light.1.from=[1 2 3]",
        "material.my.clay.reflectance=0.125",
        "material.my.clay.sigma=20",
        "material.0.roughness=0.5",
        "shape.1.radius=0.75",
    ]);
    assert_eq!((plain.camera.fov, changed.camera.fov, changed.camera.lens_radius), (30.0, 45.0, 0.1));
    assert_eq!(changed.film.resolution, [32, 12]);
    assert_eq!((changed.sampler.pixel_samples, changed.max_depth), (9, 3));
    assert_eq!(changed.sampler.kind, wavepath::scene::SamplerKind::Independent);
    assert!(matches!(changed.filter, wavepath::scene::Filter::Mitchell { b: 0.5, .. }));
    assert_eq!(changed.lights[0], Light::Infinite { radiance: [1.0, 2.0, 3.0] });
    assert_eq!(changed.lights[1], Light::Point { intensity: [7.0; 3], position: DVec3::new(1.0, 2.0, 3.0) });
    let Material::Diffuse { reflectance, sigma } = changed.materials[1] else { panic!() };
    assert_eq!(reflectance, Parameter::Constant([0.125; 3]));
    assert_eq!(sigma, Parameter::Constant(20.0));
    let Material::Conductor { alpha, .. } = changed.materials[0] else { panic!() };
    assert_eq!(alpha[0], Parameter::Constant(0.5f32.sqrt()));
    assert!(matches!(changed.shapes[1].geometry, wavepath::scene::Geometry::Sphere { radius: 0.75, .. }));
}

#[test]
fn types_all_of_a_kind_and_textures() {
    let changed = scene(&["light.*.scale=2", "light.0.L=blackbody 6500"]);
    let colours: Vec<_> = changed.lights.iter().map(Light::colour).collect();
    assert_eq!(colours[1], [2.0; 3]);
    assert!(colours[0][0] > 0.0 && colours[0] != [1.0, 2.0, 4.0], "{colours:?}");
    let textured = SCENE
        .replace(
            "MakeNamedMaterial",
            "Texture \"rough\" \"float\" \"constant\" \"float value\" 10 MakeNamedMaterial",
        )
        .replace("\"rgb reflectance\"", "\"texture sigma\" \"rough\" \"rgb reflectance\"");
    for settings in [["texture.rough.value=30"], ["material.my.clay.sigma=30"]] {
        let changed = load(&textured, &settings).unwrap().scene;
        let Material::Diffuse { sigma, .. } = changed.materials[1] else { panic!() };
        assert_eq!(sigma, Parameter::Constant(30.0), "{settings:?}");
    }
}

#[test]
fn the_picture_is_that_of_the_file_with_the_value_in_it() {
    let file = SCENE
        .replace("\"float fov\" 30", "\"float fov\" 20")
        .replace("\"float scale\" 3", "\"float scale\" 1.5");
    let render = |scene: &Scene| {
        let picture = Render::new(scene).spp(4).threads(2).run().unwrap();
        picture.image().pixels.clone()
    };
    let described = load(SCENE, &["camera.fov=20", "light.1.scale=1.5"]).unwrap().scene;
    let other = Scene::new("scene", described).unwrap();
    assert_eq!(render(&Scene::parse(&file).unwrap()), render(&other));
}

#[test]
fn options_that_the_file_does_not_have() {
    let bare = "WorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\n";
    let changed = load(
        bare,
        &[
            "camera.fov=50",
            "film.xresolution=20",
            "film.yresolution=10",
            "integrator.maxdepth=2",
            "filter.xradius=1",
        ],
    );
    let changed = changed.unwrap_or_else(|error| panic!("{error}")).scene;
    assert_eq!((changed.camera.fov, changed.film.resolution, changed.max_depth), (50.0, [20, 10], 2));
    // A file of version 3 stays one.
    let old = "Film \"image\"\nWorldBegin\nMaterial \"matte\"\nShape \"sphere\"\nWorldEnd\n";
    let changed = load(old, &["filter.xwidth=1", "sampler.pixelsamples=3"]).unwrap().scene;
    assert_eq!(changed.sampler.pixel_samples, 3);
}

#[test]
fn the_camera_moves() {
    let at = |settings: &[&str]| scene(settings).camera.world_from_camera;
    let plain = at(&[]);
    assert_eq!(at(&["camera.orbit=0"]), plain);
    let turned = at(&["camera.orbit=180"]);
    assert!((turned.translation - DVec3::new(0.0, 0.0, 5.0)).length() < 1e-12);
    assert!((turned.matrix3.z_axis + DVec3::Z).length() < 1e-12);
    let placed = at(&["camera.eye=3,0,0", "camera.look=0 0 4"]);
    assert!((placed.matrix3.z_axis - DVec3::new(-0.6, 0.0, 0.8)).length() < 1e-12);
    // What hangs on the camera goes along.
    let lit = SCENE.replace("WorldBegin", "WorldBegin CoordSysTransform \"camera\"");
    let Light::Point { position, .. } = load(&lit, &["camera.move=1 0 0"]).unwrap().scene.lights[1] else {
        panic!()
    };
    assert!((position - DVec3::new(1.0, 5.0, -5.0)).length() < 1e-12);
    let message = load(&SCENE.replace("LookAt 0 0 -5  0 0 0  0 1 0", "Translate 0 0 5"), &["camera.orbit=9"]);
    assert!(message.unwrap_err().to_string().contains("camera.look"));
}

#[test]
fn names_that_do_not_exist() {
    refused(&["camera.fvo=3"], &["--set:1:1", "unknown parameter \"fvo\"", "did you mean \"fov\"?"]);
    refused(&["camera.fov=3", "material.my.caly.sigma=3"], &["--set:2:1", "material.my.clay", "material.0"]);
    refused(&["light.2.scale=3"], &["the scene has no light.2", "light.0, light.1"]);
    refused(&["texture.wood.scale=3"], &["the scene has no texture of its own"]);
    refused(&["camra.fov=3"], &["did you mean \"camera\"?"]);
    refused(&["fov=3"], &["names nothing", "camera.fov"]);
    refused(&["camera.fov=3", "camera.fov=4"], &["set twice"]);
    refused(&["light.0.reflectance=3"], &["unknown parameter \"reflectance\" for light"]);
}

#[test]
fn values_that_cannot_be() {
    refused(&["camera.fov=wide"], &["--set:1:1", "has type string", "expected type float"]);
    refused(&["camera.fov=200"], &["--set:1:12", "camera.fov=200", "between 0 and 180"]);
    refused(&["light.0.L=rgb 1 2"], &["\"L\" has 2 values"]);
    refused(&["light.0.L=rgb 1 2 x"], &["not a value of type rgb"]);
    refused(&["film.xresolution=1.5"], &["expected type integer"]);
    refused(&["camera.eye=1,2"], &["not three numbers"]);
    refused(&["camera.eye=0,0,0"], &["the camera cannot be put there"]);
    refused(&["camera.elevate=90"], &["the camera cannot be put there", "zenith"]);
    refused(&["material.0.type=conducter"], &["did you mean \"conductor\"?"]);
    for wrong in ["camera.fov", "=3", "camera.fov=", ""] {
        assert!(wrong.parse::<Override>().unwrap_err().contains("NAME=VALUE"), "{wrong}");
    }
}

#[test]
fn what_can_be_set_is_listed() {
    let options = LoadOptions { list: true, ..set(&["camera.fov=45"]) };
    let names = pbrt::load_text(SCENE.as_bytes(), "scene", Path::new(""), &options).unwrap().names;
    let value = |name: &str| {
        names.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str()).unwrap_or_default()
    };
    assert_eq!(value("camera.fov"), "float 45");
    assert_eq!(value("light.0.type"), "infinite");
    assert_eq!(value("material.my.clay.reflectance"), "rgb 0.25 0.5 0.75");
    assert_eq!(value("shape.1.radius"), "float 0.5");
    // What is listed can be set, and changes nothing.
    let same: Vec<String> = names.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let same: Vec<&str> = same.iter().map(String::as_str).collect();
    assert_eq!(format!("{:?}", scene(&same).materials), format!("{:?}", scene(&["camera.fov=45"]).materials));
}

struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("wavepath-set-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        fs::write(path.join("s.pbrt"), SCENE).unwrap();
        Scratch(path)
    }
    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_wavepath")).args(arguments).current_dir(&self.0).output().unwrap()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn the_command_and_its_report() {
    let scratch = Scratch::new("command");
    let arguments = ["render", "s.pbrt", "-q", "-o", "a.exr", "--report", "a.json", "--set", "camera.fov=20"];
    let output = scratch.run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(scratch.0.join("a.json")).unwrap()).unwrap();
    assert_eq!(report["set"], serde_json::json!({ "camera.fov": "20" }));
    let image = wavepath::picture::read(&scratch.0.join("a.exr")).unwrap();
    assert!(image.metadata.report.unwrap().contains("\"set\":{\"camera.fov\":\"20\"}"));
    for command in ["render", "plan", "check", "converge"] {
        let output = scratch.run(&[command, "s.pbrt", "-o", "out", "--set", "camera.fow=20"][..]);
        let output = match command {
            "plan" | "check" => scratch.run(&[command, "s.pbrt", "--set", "camera.fow=20"]),
            "render" => scratch.run(&[command, "s.pbrt", "-o", "b.exr", "--set", "camera.fow=20"]),
            _ => output,
        };
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{command}: {message}");
        assert!(message.contains("did you mean \"fov\"?"), "{command}: {message}");
    }
    let names = scratch.run(&["plan", "s.pbrt", "--names"]);
    assert!(String::from_utf8_lossy(&names.stdout).contains("\nlight.1.scale=float 3\n"));
    // As a library.
    let options =
        SceneOptions { set: vec![Override::new("film.xresolution", "4")], ..SceneOptions::default() };
    let scene = Scene::open_with(scratch.0.join("s.pbrt"), &options).unwrap();
    assert_eq!((scene.resolution(), scene.overrides().len()), ([4, 12], 1));
}
