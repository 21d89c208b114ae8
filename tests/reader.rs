//! The scene reader from outside: good scenes give what they say, bad ones an error at the right place.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DVec3};
use wavepath::kernels::texture::Texture;
use wavepath::pbrt::{self, Error, Loaded};
use wavepath::scene::{
    Coat, Fade, Filter, Geometry, Light, Material, MaterialId, Mesh, Parameter, SamplerKind,
    SceneDescription, Shape,
};

fn read(text: &str) -> Result<Loaded, Error> {
    pbrt::load_str(text, "t.pbrt", Path::new("."))
}

fn scene(text: &str) -> SceneDescription {
    match read(text) {
        Ok(loaded) => loaded.scene,
        Err(error) => panic!("{error}\nin:\n{text}"),
    }
}

/// A scene of v4 with this inside the world.
fn world(text: &str) -> SceneDescription {
    scene(&format!("Film \"rgb\"\nWorldBegin\n{text}"))
}

fn failure(text: &str) -> Error {
    match read(text) {
        Ok(_) => panic!("no error for:\n{text}"),
        Err(error) => error,
    }
}

fn close(a: [f32; 3], b: [f64; 3]) {
    let near = a.iter().zip(b).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-5 * b.abs().max(1.0));
    assert!(near, "{a:?} is not {b:?}");
}

/// A directory that is removed at the end of a test.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Scratch {
        let path = std::env::temp_dir().join(format!("wavepath-reader-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Scratch(path)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn write_gzipped(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        self.write(name, encoder.finish().unwrap())
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Uses most of the format.
const EVERYTHING: &str = r#"
# Options
LookAt 0 1.7 -5  0 0.7 0  0 1 0
Camera "perspective" "float fov" [ 42 ] "float lensradius" 0.1 "float focaldistance" [ 5 ]
Sampler "zsobol" "integer pixelsamples" [ 64 ] "integer seed" 7
Integrator "path" "integer maxdepth" [ 16 ]
Film "rgb" "integer xresolution" [ 200 ] "integer yresolution" [ 100 ] "string filename" [ "a.exr" ]
    "float cropwindow" [ 0.25 0.75 0 1 ]
PixelFilter "box" "float xradius" [ 0.5 ] "float yradius" [ 0.5 ]
WorldBegin
LightSource "infinite" "rgb L" [ 0.35 0.4 0.5 ]
LightSource "distant" "point3 from" [ 0 10 0 ] "point3 to" [ 0 0 0 ] "rgb L" [ 2 2 2 ]
MakeNamedMaterial "al" "string type" [ "conductor" ] "spectrum eta" "metal-Al-eta" "spectrum k" "metal-Al-k"
    "float roughness" [ 0.1 ] "bool remaproughness" false
Texture "grey" "spectrum" "constant" "rgb value" [ .25 .25 .25 ]
AttributeBegin
  Material "diffuse" "texture reflectance" "grey" "float sigma" 20
  Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 ] "point3 P" [ -6 0 -6 -6 0 6 6 0 6 6 0 -6 ]
    "normal N" [ 0 1 0 0 1 0 0 1 0 0 1 0 ] "point2 uv" [ 0 0 0 1 1 1 1 0 ]
AttributeEnd
AttributeBegin
  NamedMaterial "al"
  AreaLightSource "diffuse" "blackbody L" [ 6500 ] "float scale" 3 "bool twosided" true
  ReverseOrientation
  Translate -1.15 0.5 -0.2
  Rotate 90 0 1 0
  Scale 1 2 1
  Shape "sphere" "float radius" [ 0.5 ]
AttributeEnd
ObjectBegin "tri"
  Material "dielectric" "float eta" 1.3
  Shape "bilinearmesh" "point3 P" [ 0 0 0  1 0 0  0 1 0  1 1 0 ]
ObjectEnd
Translate 0 3 0
ObjectInstance "tri"
Scale -1 1 1
ObjectInstance "tri"
Attribute "shape" "float radius" 0.25
Shape "disk" "float height" 1
"#;

#[test]
fn everything_is_understood() {
    let loaded = read(EVERYTHING).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let scene = loaded.scene;
    assert_eq!(scene.film.resolution, [200, 100]);
    assert_eq!(scene.film.pixel_bounds, [50, 150, 0, 100]);
    assert_eq!(scene.film.filename.as_deref(), Some("a.exr"));
    assert_eq!(scene.filter, Filter::Box { radius: [0.5; 2] });
    assert_eq!(scene.sampler.kind, SamplerKind::Sobol);
    assert_eq!((scene.sampler.pixel_samples, scene.sampler.seed, scene.max_depth), (64, 7, 16));
    assert_eq!(scene.camera.fov, 42.0);
    assert!((scene.camera.world_from_camera.translation - DVec3::new(0.0, 1.7, -5.0)).length() < 1e-12);
    let [Light::Infinite { .. }, Light::Distant { direction, .. }] = scene.lights[..] else { panic!() };
    assert_eq!(direction, -DVec3::Y);
    assert_eq!(scene.shapes.len(), 5);
    assert_eq!(scene.materials.len(), 4);
    let Geometry::Disk { radius, height, .. } = scene.shapes[4].geometry else { panic!() };
    assert_eq!((radius, height), (0.25, 1.0));
}

#[test]
fn attributes_are_saved_and_defaults_end_with_them() {
    let scene = world(
        "AttributeBegin Attribute \"shape\" \"float radius\" 3 Material \"conductor\"\n\
         AreaLightSource \"diffuse\" Shape \"sphere\" AttributeEnd Shape \"sphere\"",
    );
    let radius = |shape: &Shape| match shape.geometry {
        Geometry::Sphere { radius, .. } => radius,
        _ => panic!(),
    };
    assert_eq!(scene.shapes.iter().map(radius).collect::<Vec<_>>(), [3.0, 1.0]);
    assert!(scene.shapes[0].emission.is_some() && scene.shapes[1].emission.is_none());
    assert!(matches!(scene.materials[0], Material::Conductor { .. }));
    assert!(matches!(
        scene.materials[1],
        Material::Diffuse { reflectance: Parameter::Constant([0.5, 0.5, 0.5]), .. }
    ));
}

fn sphere_transform(text: &str) -> DAffine3 {
    match world(&format!("{text}\nShape \"sphere\"")).shapes[0].geometry {
        Geometry::Sphere { world_from_object, .. } => world_from_object,
        _ => panic!(),
    }
}

#[test]
fn transforms_multiply_from_the_right() {
    let probe = DVec3::new(1.0, 2.0, 3.0);
    for (text, expected) in [
        ("Translate 1 2 3 Scale 2 3 4", [3.0, 8.0, 15.0]),
        ("Scale 2 3 4 Translate 1 2 3", [4.0, 12.0, 24.0]),
        ("Rotate 90 1 0 0", [1.0, -3.0, 2.0]),
        ("Translate 9 9 9 Transform [ 1 0 0 0  0 1 0 0  0 0 1 0  5 6 7 1 ]", [6.0, 8.0, 10.0]),
        ("Translate 1 0 0 ConcatTransform [ 0 1 0 0  -1 0 0 0  0 0 1 0  0 0 0 1 ]", [-1.0, 1.0, 3.0]),
        ("Translate 1 0 0 CoordinateSystem \"c\" Identity CoordSysTransform \"c\"", [2.0, 2.0, 3.0]),
        ("TransformBegin Translate 1 0 0 TransformEnd", [1.0, 2.0, 3.0]),
        ("ActiveTransform All Translate 1 0 0 TransformTimes 0 1", [2.0, 2.0, 3.0]),
        (
            "ActiveTransform StartTime Translate 1 0 0 ActiveTransform EndTime Translate 1 0 0",
            [2.0, 2.0, 3.0],
        ),
    ] {
        let found = sphere_transform(text).transform_point3(probe);
        assert!((found - DVec3::from_array(expected)).length() < 1e-12, "{text}: {found}");
    }
}

#[test]
fn the_camera_has_its_coordinate_system() {
    let text = "LookAt 0 0 -5 0 0 0 0 1 0 Camera \"perspective\" Film \"rgb\" WorldBegin\n\
        CoordSysTransform \"camera\" Translate 0 0 1 Shape \"sphere\"";
    let Geometry::Sphere { world_from_object, .. } = scene(text).shapes[0].geometry else { panic!() };
    assert!((world_from_object.translation - DVec3::new(0.0, 0.0, -4.0)).length() < 1e-12);
}

const TRIANGLE: &str =
    "Shape \"trianglemesh\" \"point3 P\" [ 0 0 0  1 0 0  0 1 0 ] \"normal3 N\" [ 0 0 1 0 1 1 0 0 2 ]";

/// Normal of a mesh's first triangle as the description defines it.
fn normal(scene: &SceneDescription, shape: &Shape) -> DVec3 {
    let Geometry::Mesh(id) = shape.geometry else { panic!() };
    let mesh: &Mesh = &scene.meshes[id.0 as usize];
    let [a, b, c] = mesh.triangles[0].map(|i| DVec3::from_array(mesh.positions[i as usize].map(f64::from)));
    let normal = (b - a).cross(c - a).normalize();
    if shape.flip_normal { -normal } else { normal }
}

#[test]
fn orientation_follows_pbrt() {
    // A mirror flips the winding in the world and the flag, so that the normal is what the transform makes of it.
    for (text, flip, expected) in [
        ("", false, DVec3::Z),
        ("ReverseOrientation", true, -DVec3::Z),
        ("Scale -1 1 1", true, DVec3::Z),
        ("Scale -1 1 1 ReverseOrientation", false, -DVec3::Z),
        ("Scale 1 1 -1", true, -DVec3::Z),
    ] {
        let direct = world(&format!("{text}\n{TRIANGLE}"));
        let instanced =
            world(&format!("ObjectBegin \"o\"\n{text} {TRIANGLE}\nObjectEnd ObjectInstance \"o\""));
        let outside = world(&format!(
            "AttributeBegin\nObjectBegin \"o\" {TRIANGLE} ObjectEnd AttributeEnd\n{text}\nObjectInstance \"o\""
        ));
        for scene in [&direct, &instanced] {
            assert_eq!(scene.shapes[0].flip_normal, flip, "{text}");
            assert!((normal(scene, &scene.shapes[0]) - expected).length() < 1e-9, "{text}");
        }
        // The reversal at the instance is not the object's.
        if !text.contains("Reverse") {
            assert!((normal(&outside, &outside.shapes[0]) - expected).length() < 1e-9, "{text}");
        }
        let sphere = world(&format!("{text}\nShape \"sphere\""));
        assert_eq!(sphere.shapes[0].flip_normal, flip, "{text}");
    }
    // A mirrored instance of a sphere still faces outwards: pbrt transforms its normal as a vector.
    let mirrored = world("ObjectBegin \"o\" Shape \"sphere\" ObjectEnd Scale -1 1 1 ObjectInstance \"o\"");
    assert!(!mirrored.shapes[0].flip_normal);
    let reversed = world(&format!("ReverseOrientation Scale 1 2 1 {TRIANGLE}"));
    assert_eq!(reversed.meshes[0].normals[0], [0.0, 0.0, -1.0]);
    close(reversed.meshes[0].normals[1], [0.0, -0.5 / 1.25f64.sqrt(), -1.0 / 1.25f64.sqrt()]);
}

#[test]
fn instances_are_copies_under_both_transforms() {
    let scene = world(
        "AttributeBegin Translate 1 0 0 ObjectBegin \"o\" Translate 0 1 0 Shape \"sphere\" ObjectEnd AttributeEnd\n\
         Scale 2 2 2 ObjectInstance \"o\" Translate 0 0 1 ObjectInstance \"o\"",
    );
    let centre = |shape: &Shape| match shape.geometry {
        Geometry::Sphere { world_from_object, .. } => world_from_object.translation,
        _ => panic!(),
    };
    assert_eq!(centre(&scene.shapes[0]), DVec3::new(2.0, 2.0, 0.0));
    assert_eq!(centre(&scene.shapes[1]), DVec3::new(2.0, 2.0, 2.0));
}

#[test]
fn instances_may_stand_before_their_objects() {
    let scene = world("ObjectInstance \"o\" ObjectBegin \"o\" Shape \"disk\" ObjectEnd");
    assert_eq!(scene.shapes.len(), 1);
}

#[test]
fn lights_inside_objects_are_dropped_with_a_warning() {
    let loaded = read(
        "Film \"rgb\" WorldBegin AreaLightSource \"diffuse\" Shape \"sphere\"\n\
         ObjectBegin \"o\" Shape \"sphere\" ObjectEnd ObjectInstance \"o\"",
    )
    .unwrap();
    assert!(loaded.scene.shapes[0].emission.is_some() && loaded.scene.shapes[1].emission.is_none());
    assert_eq!(loaded.warnings.len(), 1);
    assert!(loaded.warnings[0].message.contains("inside objects"));
}

#[test]
fn degenerate_triangles_are_counted_once() {
    let loaded = read(
        "Film \"rgb\" WorldBegin LightSource \"infinite\"\n\
         Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 0 1 0 1 3 ] \"point3 P\" [ 0 0 0 1 0 0 0 1 0 2 0 0 ]\n\
         Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 1 1 2 2 2 ]",
    )
    .unwrap();
    assert_eq!(loaded.scene.meshes.len(), 1);
    assert_eq!(loaded.scene.meshes[0].triangles, [[0, 1, 2]]);
    assert_eq!(loaded.warnings.len(), 1);
    assert!(loaded.warnings[0].message.starts_with("3 degenerate triangles"));
    assert_eq!(loaded.warnings[0].line(), 2);
}

/// The value of a parameter that is the same everywhere.
fn value<T: Copy>(parameter: Parameter<T>) -> T {
    parameter.constant().expect("not textured")
}

#[test]
fn materials_have_pbrts_defaults_and_remappings() {
    let material = |text: &str| world(&format!("{text} Shape \"sphere\"")).materials[0];
    let Material::Conductor { eta, k, alpha } = material("Material \"conductor\"") else { panic!() };
    // pbrt-v3's constants over the tint of its white.
    let white = [1.2049759, 0.948279, 0.9086246];
    close(value(eta), [0.200438 / white[0], 0.924033 / white[1], 1.102212 / white[2]]);
    close(value(k), [3.912949 / white[0], 2.452848 / white[1], 2.142188 / white[2]]);
    assert_eq!(alpha.map(value), [0.0; 2]);
    let Material::Conductor { eta, k, alpha } = material(
        "Material \"conductor\" \"rgb reflectance\" [ .5 .9 1 ] \"float roughness\" .04 \"float vroughness\" .09",
    ) else {
        panic!()
    };
    close(value(eta), [1.0; 3]);
    close(value(k), [2.0, 6.0, 2.0 * (0.9999f64 / 0.0001).sqrt()]);
    assert_eq!(alpha.map(value), [0.2, 0.3]);
    let tiny = material("Material \"conductor\" \"float roughness\" .0005 \"bool remaproughness\" false");
    assert!(matches!(tiny, Material::Conductor { alpha, .. } if alpha.map(value) == [0.0; 2]));
    let Material::Dielectric { eta, .. } = material("Material \"dielectric\"") else { panic!() };
    assert_eq!(value(eta), 1.5);
    let mixed = "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" MakeNamedMaterial \"b\" \"string type\" \"diffuse\"\n";
    let mixed = format!("{mixed} Material \"mix\" \"string materials\" [ \"a\" \"b\" ]");
    assert!(matches!(material(&mixed), Material::Diffuse { .. }));
    let constant =
        "Material \"conductor\" \"spectrum eta\" [ 400 1.5 700 1.5 ] \"spectrum k\" [ 300 2 800 2 ]";
    let Material::Conductor { eta, k, .. } = material(constant) else { panic!() };
    assert_eq!((value(eta), value(k)), ([1.5; 3], [2.0; 3]));
    let forward = "NamedMaterial \"later\" Shape \"sphere\" MakeNamedMaterial \"later\" \"string type\" \"thindielectric\"";
    assert_eq!(world(forward).materials, [Material::ThinDielectric { eta: 1.5.into() }]);
}

#[test]
fn diffuse_transmission_has_pbrts_defaults_and_scale() {
    let shares = |text: &str| {
        let text = format!("Material \"diffusetransmission\" {text} Shape \"sphere\"");
        let Material::DiffuseTransmission { reflectance, transmittance } = world(&text).materials[0] else {
            panic!()
        };
        (value(reflectance), value(transmittance))
    };
    assert_eq!(shares(""), ([0.25; 3], [0.25; 3]));
    assert_eq!(
        shares("\"rgb transmittance\" [ .5 .25 0 ] \"float scale\" .5"),
        ([0.125; 3], [0.25, 0.125, 0.0])
    );
    // Clamped after scaling.
    assert_eq!(shares("\"rgb reflectance\" [ .5 .25 0 ] \"float scale\" 3"), ([1.0, 0.75, 0.0], [0.75; 3]));
}

#[test]
fn depths_beyond_the_limit_are_limited_with_a_warning() {
    let loaded = |depth: u32| {
        let options = format!("Integrator \"path\" \"integer maxdepth\" {depth}");
        read(&format!("{options}\nWorldBegin LightSource \"infinite\" Shape \"sphere\"")).unwrap()
    };
    let deep = loaded(10_000);
    assert_eq!((deep.scene.max_depth, deep.warnings.len()), (10_000, 0));
    let deeper = loaded(100_000);
    assert_eq!((deeper.scene.max_depth, deeper.warnings.len()), (16_382, 1));
    let warning = deeper.warnings[0].to_string();
    assert!(warning.contains("100000") && warning.contains("16382"), "{warning}");
}

#[test]
fn reflectances_and_dispersion_warn() {
    let warnings = |text: &str| {
        let text = format!("Film \"rgb\" WorldBegin LightSource \"infinite\" {text}");
        read(&text).unwrap().warnings.into_iter().map(|w| w.message).collect::<Vec<_>>()
    };
    assert!(warnings("Material \"diffuse\" \"rgb reflectance\" [ 2 0 0 ]")[0].contains("outside [0, 1]"));
    assert!(warnings("Material \"dielectric\" \"spectrum eta\" \"glass-BK7\"")[0].contains("1.5168"));
    let twice = "Shape \"sphere\" \"float radius\" 1 \"float radius\" 2";
    assert!(warnings(twice)[0].contains("given twice"));
    assert!(read("Film \"rgb\" WorldBegin").unwrap().warnings[0].message.contains("no lights"));
}

#[test]
fn lights_have_pbrts_units() {
    let lights = world(
        "LightSource \"infinite\" \"float illuminance\" 10 \"rgb L\" [ 1 2 3 ]\n\
         LightSource \"point\" \"rgb I\" [ 1 1 1 ] \"float power\" 20 \"point3 from\" [ 1 2 3 ] \"float scale\" 2\n\
         Translate 0 0 1\n\
         LightSource \"spot\" \"float coneangle\" 60 \"float conedeltaangle\" 60 \"float power\" 3\n\
         LightSource \"distant\" \"float illuminance\" 5 \"point3 from\" [ 0 0 5 ] \"point3 to\" [ 0 0 0 ]",
    )
    .lights;
    let pi = std::f64::consts::PI;
    let Light::Infinite { radiance } = lights[0] else { panic!() };
    close(radiance, [10.0 / pi, 20.0 / pi, 30.0 / pi]);
    let Light::Point { intensity, position } = lights[1] else { panic!() };
    close(intensity, [2.0 * 20.0 / (4.0 * pi); 3]);
    assert_eq!(position, DVec3::new(1.0, 2.0, 3.0));
    let Light::Spot { intensity, position, direction, cos_falloff_start, cos_total_width, .. } = lights[2]
    else {
        panic!()
    };
    close(intensity, [3.0 / (2.0 * pi * 0.25); 3]);
    assert_eq!((position, direction, cos_falloff_start), (DVec3::Z, DVec3::Z, 1.0));
    assert!((cos_total_width - 0.5).abs() < 1e-12);
    let Light::Distant { radiance, direction } = lights[3] else { panic!() };
    close(radiance, [5.0; 3]);
    assert_eq!(direction, -DVec3::Z);
    let lamp =
        world("AreaLightSource \"diffuse\" \"float power\" 60 \"rgb L\" [ 1 .5 .25 ] Shape \"sphere\"");
    let emission = lamp.shapes[0].emission.unwrap();
    assert_eq!(
        (emission.power, emission.radiance, emission.two_sided),
        (Some(60.0), [1.0, 0.5, 0.25], false)
    );
}

#[test]
fn cylinders_are_read() {
    let shapes = world(
        "Shape \"cylinder\"\n\
         Translate 0 0 5 Shape \"cylinder\" \"float radius\" 2 \"float zmin\" 3 \"float zmax\" -1 \"float phimax\" 90",
    )
    .shapes;
    let Geometry::Cylinder { radius, z_min, z_max, phi_max, .. } = shapes[0].geometry else { panic!() };
    assert_eq!((radius, z_min, z_max, phi_max), (1.0, -1.0, 1.0, 360.0));
    let Geometry::Cylinder { world_from_object, radius, z_min, z_max, phi_max } = shapes[1].geometry else {
        panic!()
    };
    assert_eq!((radius, z_min, z_max, phi_max), (2.0, -1.0, 3.0, 90.0));
    assert_eq!(world_from_object.translation, DVec3::new(0.0, 0.0, 5.0));
    for (parameters, expected) in
        [("\"float radius\" 0", "radius"), ("\"float zmin\" 1 \"float zmax\" 1", "nothing is left")]
    {
        let text = format!("Film \"rgb\" WorldBegin Shape \"cylinder\" {parameters}");
        let error = read(&text).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains(":1:"), "{error}");
    }
}

#[test]
fn goniometric_lights_have_a_pattern_around_z() {
    let lights = world(
        "Translate 1 2 3 Rotate 90 0 1 0\n\
         LightSource \"goniometric\" \"string pattern\" \"batwing\" \"rgb I\" [ 1 2 3 ] \"float scale\" 2\n\
         LightSource \"goniometric\" \"string pattern\" \"batwing\" \"float power\" 7",
    )
    .lights;
    let Light::Goniometric { intensity, position, axis } = lights[0] else { panic!() };
    assert_eq!((intensity, position), ([2.0, 4.0, 6.0], DVec3::new(1.0, 2.0, 3.0)));
    assert!((axis - DVec3::X).length() < 1e-12);
    // The pattern integrates to 7/8 pi.
    let Light::Goniometric { intensity, .. } = lights[1] else { panic!() };
    close(intensity, [8.0 / std::f64::consts::PI; 3]);
    for (parameters, expected) in [
        ("", "without a pattern"),
        ("\"string pattern\" \"moth\"", "batwing"),
        ("\"string filename\" \"lamp.exr\"", "cannot read image"),
    ] {
        let text =
            format!("Film \"rgb\" WorldBegin LightSource \"goniometric\" {parameters} Shape \"sphere\"");
        let error = read(&text).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains(":1:"), "{error}");
    }
}

#[test]
fn dark_lights_are_left_out() {
    let scene = world(
        "LightSource \"point\" \"float scale\" 0 AreaLightSource \"diffuse\" \"rgb L\" [ 0 0 0 ] Shape \"sphere\"",
    );
    assert!(scene.lights.is_empty() && scene.shapes[0].emission.is_none());
}

#[test]
fn spectra_come_from_files_and_names() {
    let scratch = Scratch::new("spectra");
    scratch.write("flat.spd", "# nm value\n400 2.5\n500 2.5 # middle\n700 2.5\n");
    let main = |k: &str| {
        let text =
            format!("Film \"rgb\" WorldBegin Material \"conductor\" \"spectrum k\" \"{k}\" Shape \"sphere\"");
        pbrt::load(&scratch.write("main.pbrt", text))
    };
    let loaded = main("flat.spd").unwrap();
    assert!(matches!(
        loaded.scene.materials[0],
        Material::Conductor { k: Parameter::Constant([2.5, 2.5, 2.5]), .. }
    ));
    assert_eq!(loaded.inputs.len(), 2);
    scratch.write("flat.spd", "400 2.5\n500 zwei\n");
    let error = main("flat.spd").unwrap_err().to_string();
    assert!(error.contains("flat.spd:2: `zwei` is not a number"), "{error}");
    let white = world("LightSource \"infinite\" \"spectrum L\" \"stdillum-D65\" \"float scale\" 3");
    assert_eq!(white.lights, [Light::Infinite { radiance: [3.0; 3] }]);
}

#[test]
fn coats_have_pbrts_defaults() {
    let used = |text: &str| {
        read(&format!("Film \"image\" WorldBegin {text} Shape \"sphere\"")).unwrap().scene.materials[0]
    };
    let diffuse = |x: f32| Material::Diffuse { reflectance: [x; 3].into(), sigma: 0.0.into() };
    let bare = "\"rgb Kd\" [ .5 .5 .5 ] \"rgb Ks\" [ 0 0 0 ]";
    for kind in ["plastic", "uber"] {
        assert_eq!(used(&format!("Material \"{kind}\" {bare}")), diffuse(0.5), "{kind} without a coat");
    }
    // pbrt-v3's polynomial at 0.1.
    let rough = 0.46176;
    for (kind, coat, share, eta) in [
        ("plastic", Coat::Added, 0.25, 1.0 / 1.5),
        ("uber", Coat::Added, 0.25, 1.5),
        ("substrate", Coat::Blended, 0.5, 1.5),
    ] {
        let Material::Coated { coat: found, reflectance, specular, eta: index, alpha, .. } =
            used(&format!("Material \"{kind}\""))
        else {
            panic!("{kind}")
        };
        assert_eq!(
            (found, value(reflectance), value(specular), value(index)),
            (coat, [share; 3], [share; 3], eta)
        );
        for alpha in alpha.map(value) {
            assert!((alpha - rough).abs() < 1e-4, "{kind}: {alpha}");
        }
    }
    let Material::Coated { coat, reflectance, specular, eta, alpha, thickness, max_depth } =
        world("Material \"coateddiffuse\" Shape \"sphere\"").materials[0]
    else {
        panic!()
    };
    assert_eq!((coat, value(reflectance), value(specular)), (Coat::Layered, [0.5; 3], [1.0; 3]));
    assert_eq!((value(eta), alpha.map(value), thickness, max_depth), (1.5, [0.0; 2], 0.01, 10));
}

#[test]
fn uber_and_translucent_have_pbrts_defaults() {
    let used = |text: &str| {
        read(&format!("Film \"image\" WorldBegin Material {text} Shape \"sphere\"")).unwrap().scene.materials
            [0]
    };
    for (name, found) in [("Kr", [0.5, 0.0, 1.0]), ("Kt", [0.0, 0.5, 1.0]), ("opacity", [0.0, 0.0, 0.5])] {
        let Material::Uber { diffuse, glossy, mirrored, refracted, opacity, reflect, transmit, eta, .. } =
            used(&format!("\"uber\" \"rgb {name}\" [ .5 .5 .5 ]"))
        else {
            panic!("{name}")
        };
        assert_eq!([diffuse, glossy].map(value), [[0.25; 3]; 2]);
        assert_eq!([mirrored, refracted, opacity].map(|c| value(c)[0]), found, "{name}");
        assert_eq!(([reflect, transmit].map(value), value(eta)), ([[1.0; 3], [0.0; 3]], 1.5));
    }
    let Material::Uber { diffuse, glossy, mirrored, refracted, opacity, reflect, transmit, .. } =
        used("\"translucent\"")
    else {
        panic!()
    };
    assert_eq!([diffuse, glossy, reflect, transmit].map(|c| value(c)[0]), [0.25, 0.25, 0.5, 0.5]);
    assert_eq!([mirrored, refracted, opacity].map(|c| value(c)[0]), [0.0, 0.0, 1.0]);
    let matt = used("\"translucent\" \"rgb Kd\" [ .5 .5 .5 ] \"rgb Ks\" [ 0 0 0 ]");
    let quarter = Parameter::Constant([0.25; 3]);
    assert_eq!(matt, Material::DiffuseTransmission { reflectance: quarter, transmittance: quarter });
}

/// v4's amount is the share of the second material, v3's that of the first, and may differ from colour to colour.
#[test]
fn mixtures_come_behind_their_materials() {
    let two = "MakeNamedMaterial \"a\" \"string type\" \"mirror\" MakeNamedMaterial \"b\" \"string type\" \"matte\"";
    let v3 = |more: &str| {
        read(&format!("Film \"image\" WorldBegin {two} {more} Shape \"sphere\"")).unwrap().scene.materials
    };
    let mix = "\"mix\" \"string namedmaterial1\" \"a\" \"string namedmaterial2\" \"b\"";
    let materials = v3(&format!("Material {mix} \"rgb amount\" [ .25 .5 .75 ]"));
    let [first, second] = [MaterialId(0), MaterialId(1)];
    let expected = Material::Mixture { materials: [first, second], amount: [0.25, 0.5, 0.75].into() };
    assert!(
        matches!(materials[0], Material::Diffuse { .. }) && matches!(materials[1], Material::Mirror { .. })
    );
    assert_eq!(materials[2..], [expected]);
    assert!(matches!(v3(&format!("Material {mix} \"float amount\" 1"))[..], [Material::Mirror { .. }]));
    let two = "MakeNamedMaterial \"a\" \"string type\" \"dielectric\" MakeNamedMaterial \"b\" \"string type\" \"diffuse\"";
    let mix = "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [ \"a\" \"b\" ] \"float amount\" .75";
    let nested = "Material \"mix\" \"string materials\" [ \"m\" \"a\" ]";
    let materials = world(&format!("{two} {mix} {nested} Shape \"sphere\"")).materials;
    assert_eq!(materials[2], Material::Mixture { materials: [first, second], amount: [0.75; 3].into() });
    let outer = Material::Mixture { materials: [MaterialId(2), first], amount: [0.5; 3].into() };
    assert_eq!(materials[3..], [outer]);
}

#[test]
fn flat_bumps_are_none() {
    let used = |text: &str| read(&format!("Film \"image\" WorldBegin {text} Shape \"sphere\""));
    let diffuse = |x: f32| Material::Diffuse { reflectance: [x; 3].into(), sigma: 0.0.into() };
    let bumps = "Texture \"flat\" \"float\" \"constant\" Material \"matte\" \"texture bumpmap\" \"flat\"";
    assert_eq!(used(bumps).unwrap().scene.materials, [diffuse(0.5)]);
}

#[test]
fn textures_of_constants_are_constants() {
    let scene = world(
        "Texture \"a\" \"spectrum\" \"constant\" \"rgb value\" [ .5 .25 1 ]\n\
         Texture \"b\" \"spectrum\" \"scale\" \"texture tex\" \"a\" \"float scale\" .5\n\
         Texture \"c\" \"spectrum\" \"mix\" \"texture tex1\" \"a\" \"texture tex2\" \"b\" \"float amount\" .5\n\
         Material \"diffuse\" \"texture reflectance\" \"c\" Shape \"sphere\"",
    );
    let Material::Diffuse { reflectance, .. } = scene.materials[0] else { panic!() };
    close(value(reflectance), [0.375, 0.1875, 0.75]);
}

#[test]
fn film_exposure_scales_light() {
    let scene = scene(
        "Film \"rgb\" \"float iso\" 200 \"float exposuretime\" 2 WorldBegin\n\
         LightSource \"infinite\" \"rgb L\" [ 1 2 3 ] AreaLightSource \"diffuse\" Shape \"sphere\"",
    );
    assert_eq!(scene.lights, [Light::Infinite { radiance: [4.0, 8.0, 12.0] }]);
    assert_eq!(scene.shapes[0].emission.unwrap().radiance, [4.0; 3]);
}

fn printed(scene: &SceneDescription) -> String {
    format!("{scene:#?}")
}

/// A scene of v3.
const V3: &str = r#"
        LookAt 0 0 -5  0 0 0  0 1 0
        Camera "perspective" "float halffov" 25
        Film "image" "integer xresolution" [64] "integer yresolution" [32]
        Sampler "halton" "integer pixelsamples" 4
        Integrator "path" "integer maxdepth" 3
        WorldBegin
        AttributeBegin
        AreaLightSource "area" "color L" [ 1 2 3 ] "bool twosided" "true" "integer nsamples" 4
        Shape "trianglemesh" "integer indices" [ 0 1 2 ] "point P" [ 0 0 0 1 0 0 0 1 0 ]
            "normal N" [ 0 0 1 0 0 1 0 0 1 ] "float st" [ 0 0 1 0 0 1 ]
        AttributeEnd
        Material "matte" "color Kd" [ .1 .2 .3 ] "float sigma" 10
        Shape "sphere"
        Material "glass" "float index" 1.4
        Shape "disk"
        WorldEnd
    "#;

#[test]
fn both_versions_of_a_scene_are_the_same() {
    let v4 = r#"
        LookAt 0 0 -5  0 0 0  0 1 0
        Camera "perspective" "float fov" 50
        Film "rgb" "integer xresolution" 64 "integer yresolution" 32
        PixelFilter "box"
        Sampler "halton" "integer pixelsamples" 4
        Integrator "path" "integer maxdepth" 3
        WorldBegin
        AttributeBegin
        AreaLightSource "diffuse" "rgb L" [ 1 2 3 ] "bool twosided" true
        Shape "trianglemesh" "point3 P" [ 0 0 0 1 0 0 0 1 0 ] "normal3 N" [ 0 0 1 0 0 1 0 0 1 ] "point2 uv" [ 0 0 1 0 0 1 ]
        AttributeEnd
        Material "diffuse" "rgb reflectance" [ .1 .2 .3 ] "float sigma" 10
        Shape "sphere"
        Material "dielectric" "float eta" 1.4
        Shape "disk"
    "#;
    assert_eq!(printed(&scene(v4)), printed(&scene(V3)));
    // Without a film, v3 shows itself only after the first decisions.
    let late = |text: &str| {
        let lines = text.lines().filter(|line| !line.contains("Film") && !line.contains("PixelFilter"));
        lines.collect::<Vec<_>>().join("\n")
    };
    assert_eq!(scene(&late(V3)).filter, Filter::Box { radius: [0.5; 2] });
    assert_eq!(scene(&late(v4)).filter, Filter::default());
}

#[test]
fn v3_forgives_unknown_parameters_even_when_recognised_late() {
    let text = "Camera \"perspective\" \"float foo\" 1 WorldBegin LightSource \"infinite\"";
    assert!(failure(text).message.contains("unknown parameter \"foo\""));
    let loaded = read(&format!("{text} WorldEnd")).unwrap();
    assert!(loaded.warnings[0].message.contains("unknown parameter \"foo\""));
    assert_eq!(loaded.scene.filter, Filter::Box { radius: [0.5; 2] });
    let units = "WorldBegin AreaLightSource \"diffuse\" \"blackbody L\" [ 5000 2 ] Shape \"sphere\"";
    let radiance = scene(units).shapes[0].emission.unwrap().radiance;
    assert!(radiance[1] > 1.5 && radiance[1] < 2.1, "{radiance:?}");
}

#[test]
fn v3_filters_and_metals() {
    let gaussian = scene("PixelFilter \"gaussian\" \"float xwidth\" 3 \"float alpha\" 8 WorldBegin").filter;
    assert_eq!(gaussian, Filter::Gaussian { radius: [3.0, 2.0], sigma: 0.25 });
    let metal = scene("Film \"image\" WorldBegin Material \"metal\" \"float roughness\" 1 Shape \"sphere\"")
        .materials[0];
    assert!(matches!(metal, Material::Conductor { alpha, .. } if alpha.map(value) == [1.62142; 2]));
}

#[test]
fn includes_imports_and_compressed_files() {
    let scratch = Scratch::new("include");
    scratch.write(
        "main.pbrt",
        "Film \"rgb\" WorldBegin Include \"parts/a.pbrt\" Import \"parts/b.pbrt.gz\" Shape \"sphere\"",
    );
    scratch.write("parts/a.pbrt", "Material \"conductor\" Include \"inner.pbrt\"");
    scratch.write("parts/inner.pbrt", "Shape \"plymesh\" \"string filename\" \"m.ply.gz\"");
    scratch.write_gzipped("parts/m.ply.gz", PLY.as_bytes());
    scratch.write_gzipped("parts/b.pbrt.gz", b"Material \"dielectric\" Translate 1 0 0 Shape \"sphere\"");
    let loaded = pbrt::load(&scratch.0.join("main.pbrt")).unwrap();
    assert_eq!(loaded.inputs.len(), 5);
    let scene = loaded.scene;
    assert_eq!(scene.meshes[0].triangles, [[0, 1, 2], [0, 2, 3]]);
    assert!(matches!(scene.materials[scene.shapes[1].material.0 as usize], Material::Dielectric { .. }));
    let last = &scene.shapes[2];
    assert_eq!(last.material, scene.shapes[0].material);
    let Geometry::Sphere { world_from_object, .. } = last.geometry else { panic!() };
    assert_eq!(world_from_object, DAffine3::IDENTITY);
    scratch.write_gzipped("whole.pbrt.gz", EVERYTHING.as_bytes());
    let whole = pbrt::load(&scratch.0.join("whole.pbrt.gz")).unwrap().scene;
    assert_eq!(printed(&whole), printed(&scene_of_everything()));
}

fn scene_of_everything() -> SceneDescription {
    scene(EVERYTHING)
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";

#[test]
fn faults_in_files_name_the_file_and_who_asked_for_it() {
    let scratch = Scratch::new("faults");
    let main = scratch.write("main.pbrt", "Film \"rgb\" WorldBegin\n  Include \"a.pbrt\"");
    scratch.write("a.pbrt", "# one\nShape \"plymesh\" \"string filename\" \"m.ply\"");
    let error = pbrt::load(&main).unwrap_err().to_string();
    assert!(error.contains("m.ply: cannot read the file"), "{error}");
    scratch.write("m.ply", PLY.replace("1 1 0", "1 inf 0"));
    let error = pbrt::load(&main).unwrap_err().to_string();
    assert!(error.contains("m.ply:12: \"y\" of a vertex is not finite"), "{error}");
    assert!(error.contains("a.pbrt:2:35: the mesh is named here"), "{error}");
    assert!(error.contains("main.pbrt:2:3: included from here"), "{error}");
    scratch.write("m.ply", PLY.replace("0 1 2 3", "0 1 2 7"));
    let error = pbrt::load(&main).unwrap_err().to_string();
    assert!(error.contains("m.ply:14: vertex index 7, but there are 4 vertices"), "{error}");
    scratch.write("a.pbrt", "Include \"main.pbrt\"");
    let error = pbrt::load(&main).unwrap_err().to_string();
    assert!(error.contains("Include of a file that is being read"), "{error}");
    scratch.write("a.pbrt", "Shape \"sphere\" AttributeBegin");
    let error = pbrt::load(&main).unwrap_err().to_string();
    assert!(error.contains("a.pbrt:1:16: AttributeBegin is never closed"), "{error}");
    assert!(pbrt::load(&scratch.0.join("none.pbrt")).unwrap_err().message.contains("cannot read"));
    assert!(pbrt::load(&scratch.0).unwrap_err().message.contains("cannot read"));
    scratch.write("b.pbrt.gz", "this is not gzip");
    assert!(pbrt::load(&scratch.0.join("b.pbrt.gz")).unwrap_err().message.contains("cannot read on"));
}

#[test]
fn errors_print_like_a_compiler() {
    let error = failure("Film \"rgb\"\nWorldBegin\n  Shape \"shpere\" \"float radius\" [ 1 ]\n");
    let expected = concat!(
        "t.pbrt:3:9: unknown shape \"shpere\"\n",
        "    3 |   Shape \"shpere\" \"float radius\" [ 1 ]\n",
        "      |         ^^^^^^^^ expected one of sphere, disk, cylinder, trianglemesh, plymesh, bilinearmesh, loopsubdiv; ",
        "did you mean \"sphere\"?",
    );
    assert_eq!(error.to_string(), expected);
    // On its own, a complaint says how bad it is.
    assert_eq!(error.first.to_string(), format!("error: {expected}"));
}

/// Text, line, column, a phrase of the message or the label.
const BROKEN: &[(&str, u32, u32, &str)] = &[
    // Tokens and numbers.
    ("WorldBegin\nShape \"sphere", 2, 7, "string without an end"),
    ("WorldBegin Shape \"sp\\qhere\"", 1, 18, "unknown escape `\\q`"),
    ("Translate 1 nan 0", 1, 13, "`nan` is not a number"),
    ("Translate 1 1e400 0", 1, 13, "too large"),
    ("Translate 1 2", 1, 14, "the end of the file"),
    ("Translate 1 2 WorldBegin", 1, 15, "`WorldBegin` is not a number"),
    ("Translate [ 1 2 3 4 ]", 1, 19, "expected `]`"),
    ("Transform [ 1 0 0 0  0 1 0 0  0 0 1 1  0 0 0 1 ]", 1, 1, "projective"),
    ("Scale 1e200 1 1 Scale 1e200 1 1", 1, 17, "not finite"),
    ("Scale 1 0 1 Camera \"perspective\"", 1, 13, "cannot be inverted"),
    ("WorldBegin Scale 1 0 1 LightSource \"spot\"", 1, 24, "cannot be inverted"),
    ("Rotate 10 0 0 0", 1, 1, "no direction"),
    ("LookAt 0 0 0  0 1 0  0 1 0", 1, 1, "no direction"),
    ("1 2 3", 1, 1, "unknown directive `1`"),
    ("[", 1, 1, "`[` where a directive"),
    ("\u{e9}\u{e9} Shap", 1, 1, "unknown directive"),
    ("Shap \"sphere\"", 1, 1, "did you mean \"Shape\""),
    // Parameters.
    ("WorldBegin Shape \"sphere\" \"radius\" 1", 1, 27, "\"type name\""),
    ("WorldBegin Shape \"sphere\" \"flaot radius\" 1", 1, 27, "did you mean \"float\""),
    ("WorldBegin Shape \"sphere\" \"float radius\"", 1, 41, "the file ends"),
    ("WorldBegin Shape \"sphere\" \"float radius\" [ 1", 1, 45, "the file ends"),
    ("WorldBegin Shape \"sphere\" \"float radius\" [ ]", 1, 42, "without values"),
    ("WorldBegin Shape \"sphere\" \"float radius\" [ 1 2 ]", 1, 46, "has 2 values"),
    ("WorldBegin Shape \"sphere\" \"float radius\" \"1\"", 1, 42, "not a value of type float"),
    ("WorldBegin Shape \"sphere\" \"integer radius\" 1", 1, 27, "expected type float"),
    ("WorldBegin Shape \"sphere\" \"float raduis\" 1", 1, 27, "did you mean \"radius\""),
    ("Film \"rgb\" WorldBegin Shape \"sphere\" \"float a\" 1", 1, 38, "unknown parameter \"a\""),
    ("Film \"rgb\" \"integer xresolution\" 1.5", 1, 34, "not a whole number"),
    ("Film \"rgb\" \"integer xresolution\" 3000000000", 1, 34, "32 bits"),
    ("WorldBegin AreaLightSource \"diffuse\" \"bool twosided\" 1", 1, 54, "true or false"),
    ("WorldBegin Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 ]", 1, 52, "multiple of 3"),
    // Order and nesting.
    ("Shape \"sphere\"", 1, 1, "before WorldBegin"),
    ("AttributeBegin", 1, 1, "before WorldBegin"),
    ("WorldBegin Camera \"perspective\"", 1, 12, "inside the world"),
    ("WorldBegin WorldBegin", 1, 12, "inside the world"),
    ("WorldBegin AttributeEnd", 1, 12, "without AttributeBegin"),
    ("WorldBegin\n AttributeBegin", 2, 2, "never closed"),
    ("WorldBegin AttributeBegin ObjectEnd", 1, 27, "expected AttributeEnd"),
    ("Film \"rgb\" WorldBegin AttributeBegin WorldEnd", 1, 23, "never closed"),
    ("WorldBegin ObjectBegin \"a\" ObjectBegin \"b\"", 1, 28, "inside an object"),
    ("WorldBegin ObjectBegin \"a\" ObjectInstance \"a\"", 1, 28, "inside an object"),
    ("WorldBegin ObjectInstance \"a\"", 1, 27, "unknown object \"a\""),
    ("WorldBegin ObjectBegin \"a\" ObjectEnd ObjectBegin \"a\"", 1, 50, "defined twice"),
    ("WorldBegin Import \"nowhere.pbrt\"", 1, 19, "cannot read"),
    // Options.
    ("Camera \"realistic\" WorldBegin", 1, 8, "not supported"),
    ("Camera \"perpective\"", 1, 8, "did you mean \"perspective\""),
    ("Camera \"perspective\" \"float fov\" 180", 1, 34, "between 0 and 180"),
    ("Camera \"perspective\" \"float screenwindow\" [ 0 1 ]", 1, 45, "not a window"),
    (
        "ActiveTransform EndTime Translate 1 0 0 Camera \"perspective\" WorldBegin",
        1,
        41,
        "motion is not supported",
    ),
    ("Film \"spectral\" WorldBegin", 1, 6, "not supported"),
    ("Film \"rgb\" \"integer xresolution\" 0", 1, 34, "1 to 65536"),
    ("Film \"rgb\" \"integer xresolution\" 60000 \"integer yresolution\" 60000", 1, 34, "pixels"),
    ("Film \"rgb\" \"string sensor\" \"canon_eos_100d\" WorldBegin", 1, 28, "cie1931"),
    ("Film \"rgb\" \"float cropwindow\" [ 0 0 0 1 ]", 1, 33, "at least one pixel"),
    ("PixelFilter \"sinc\" WorldBegin", 1, 13, "not supported"),
    ("PixelFilter \"box\" \"float xradius\" -1", 1, 35, "above 0"),
    ("Sampler \"sobol\" \"integer pixelsamples\" 0", 1, 40, "at least 1"),
    ("Sampler \"sobl\"", 1, 9, "did you mean \"sobol\""),
    ("Integrator \"ambientocclusion\" WorldBegin", 1, 12, "not supported"),
    ("Integrator \"path\" \"integer maxdepth\" -1", 1, 38, "at least 0"),
    ("ColorSpace \"rec2020\" WorldBegin", 1, 12, "not supported"),
    ("Option \"fast\" true", 1, 8, "unknown option"),
    ("ActiveTransform Now", 1, 17, "expected StartTime"),
    // Materials, textures, media.
    ("WorldBegin Material \"subsurface\" Shape \"disk\"", 1, 21, "\"subsurface\" is not supported"),
    ("WorldBegin Material \"coateddiffuse\" \"integer maxdepth\" 0", 1, 56, "at least 1"),
    ("WorldBegin Material \"coateddiffuse\" \"float thickness\" -1", 1, 55, "expected 0 to"),
    ("WorldBegin Material \"hair\" Shape \"disk\"", 1, 21, "\"hair\" is not supported"),
    ("WorldBegin Material \"difuse\"", 1, 21, "did you mean \"diffuse\""),
    ("WorldBegin Material \"diffuse\" \"rgb reflectance\" [ 1 1 ]", 1, 51, "multiple of 3"),
    ("WorldBegin Material \"dielectric\" \"float roughness\" -.1", 1, 52, "not negative"),
    ("WorldBegin Material \"dielectric\" \"float eta\" 0", 1, 46, "above 0"),
    (
        "WorldBegin Material \"conductor\" \"spectrum eta\" \"metal-Cuu-eta\"",
        1,
        48,
        "did you mean \"metal-Cu-eta\"",
    ),
    ("WorldBegin Material \"conductor\" \"spectrum eta\" [ 500 1 400 1 ]", 1, 50, "rising wavelengths"),
    (
        "WorldBegin Material \"diffuse\" \"texture displacement\" \"x\" Shape \"disk\"",
        1,
        54,
        "unknown float texture",
    ),
    (
        "WorldBegin Material \"diffuse\" \"string normalmap\" \"x\" Shape \"disk\"",
        1,
        50,
        "there is no picture",
    ),
    ("WorldBegin Material \"diffuse\" \"texture reflectance\" \"x\"", 1, 53, "unknown spectrum texture"),
    (
        "WorldBegin Texture \"t\" \"spectrum\" \"ptex\"\nMaterial \"diffuse\" \"texture reflectance\" \"t\" Shape \"disk\"",
        2,
        42,
        "\"ptex\" are not supported",
    ),
    ("WorldBegin Texture \"t\" \"spectrum\" \"imagemap\"", 1, 35, "without a file"),
    (
        "WorldBegin Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"no.png\"\nMaterial \"diffuse\" \"texture sigma\" \"t\" Shape \"disk\"",
        1,
        61,
        "no picture \"no.png\"",
    ),
    ("WorldBegin Texture \"t\" \"float\" \"dots\" \"string mapping\" \"uw\"", 1, 56, "expected one of uv"),
    ("WorldBegin Texture \"t\" \"float\" \"checkerboard\" \"integer dimension\" 4", 1, 67, "expected 2 or 3"),
    ("WorldBegin Scale 1 0 1 Texture \"t\" \"float\" \"fbm\"", 1, 44, "cannot be inverted"),
    ("WorldBegin Texture \"t\" \"spectrum\" \"imagmap\"", 1, 35, "did you mean \"imagemap\""),
    ("WorldBegin NamedMaterial \"m\" Shape \"sphere\"", 1, 26, "unknown material \"m\""),
    ("WorldBegin MakeNamedMaterial \"m\"", 1, 30, "string type"),
    ("WorldBegin MediumInterface \"fog\" \"\" Shape \"sphere\"", 1, 28, "media are not supported"),
    ("MediumInterface \"\" \"fog\" Camera \"perspective\" WorldBegin", 1, 20, "media are not supported"),
    (
        "Film \"rgb\" WorldBegin Texture \"t\" \"float\" \"constant\" Texture \"t\" \"float\" \"constant\"",
        1,
        62,
        "defined twice",
    ),
    (
        "WorldBegin Material \"conductor\" \"spectrum k\" \"metal-CuZn-k\" Shape \"disk\"",
        1,
        46,
        "not supported",
    ),
    (
        "Film \"image\" WorldBegin Shape \"sphere\" \"color Kd\" [ 1 0 0 ]",
        1,
        40,
        "material parameters on a shape",
    ),
    // Lights.
    ("WorldBegin LightSource \"infinite\" \"string filename\" \"sky.exr\"", 1, 53, "cannot read image"),
    ("WorldBegin LightSource \"projection\"", 1, 12, "without an image"),
    ("WorldBegin LightSource \"point\" \"rgb I\" [ 1 -1 1 ]", 1, 44, "negative"),
    ("WorldBegin LightSource \"point\" \"rgb I\" [ 1e39 1 1 ]", 1, 42, "single precision"),
    ("WorldBegin LightSource \"distant\" \"point3 to\" [ 0 0 0 ]", 1, 12, "no direction"),
    ("WorldBegin LightSource \"spot\" \"float conedeltaangle\" 40", 1, 54, "cone"),
    ("WorldBegin AreaLightSource \"diffuse\" \"blackbody L\" 0", 1, 52, "kelvin"),
    ("WorldBegin AreaLightSource \"diffuse\" \"string filename\" \"a.png\"", 1, 56, "cannot read image"),
    // Shapes.
    ("WorldBegin Shape \"cone\"", 1, 18, "\"cone\" is not supported"),
    ("WorldBegin Shape \"sphere\" \"float radius\" 0", 1, 42, "above 0"),
    ("WorldBegin Shape \"sphere\" \"float radius\" 1e-60", 1, 12, "too small"),
    ("WorldBegin Shape \"disk\" \"float innerradius\" 2", 1, 45, "less than the radius"),
    ("WorldBegin Shape \"trianglemesh\"", 1, 12, "point3 P"),
    ("WorldBegin Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 0 0 ]", 1, 12, "without indices"),
    (
        "WorldBegin Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 ]\n\"integer indices\" [ 0 1 2 0 1\n  3 ]",
        3,
        3,
        "index 3 is out of range",
    ),
    ("WorldBegin Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1e39 0 0 0 1 0 ]", 1, 12, "too far away"),
    (
        "WorldBegin Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 nan 0 0 1 0 ]",
        1,
        54,
        "vertex 1 is not finite",
    ),
    ("WorldBegin Shape \"sphere\" \"float radius\" nan", 1, 42, "`nan` is not a number"),
    ("", 0, 0, "the file is empty"),
    ("LookAt 0 0 1 0 0 0 0 1 0", 0, 0, "no WorldBegin"),
    ("v 0 0 1\nv 1 0 0\nvn 0 0 1\nf 1 2 3", 0, 0, "Wavefront OBJ"),
    ("<scene version=\"3.0.0\">", 0, 0, "Mitsuba"),
    ("WorldBegin LightSource \"infinite\" \"float scale\" 1e300", 1, 12, "single precision"),
    ("WorldBegin Shape \"plymesh\"", 1, 12, "without a file"),
];

#[test]
fn broken_scenes_fail_at_the_right_place() {
    let mut wrong = Vec::new();
    for (text, line, column, phrase) in BROKEN {
        let error = failure(text);
        let says = error.to_string().contains(phrase);
        if (error.line(), error.column()) != (*line, *column) || !says {
            wrong.push(format!("{text}\nexpected {line}:{column} {phrase}\n{error}\n"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn bytes_that_are_no_text_are_refused_outside_comments() {
    let load = |bytes: &[u8]| pbrt::load_bytes(bytes, "t", Path::new("."));
    assert!(load(b"# caf\xe9\nWorldBegin").is_ok());
    let error = load(b"WorldBegin\nShape \"sph\xe9re\"").unwrap_err();
    assert_eq!((error.line(), error.column()), (2, 11));
    assert!(error.message.contains("UTF-8"));
    assert!(load(b"\xef\xbb\xbfFilm \"rgb\" WorldBegin").is_ok());
}

#[test]
fn long_lines_are_cut_in_messages() {
    let mut text = String::from(
        "WorldBegin Shape \"trianglemesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 ] \"integer indices\" [",
    );
    text.push_str(&" 0 1 2".repeat(200_000));
    text.push_str(" 0 1 9 ]");
    let error = failure(&text);
    assert!(error.message.contains("index 9"));
    assert!(error.to_string().len() < 600);
    assert_eq!(error.column() as usize, text.len() - 2);
}

#[test]
fn deep_nesting_ends_in_an_error() {
    let error = failure(&format!("WorldBegin {}", "AttributeBegin ".repeat(100_000)));
    assert!(error.message.contains("nested"));
}

/// Deterministic numbers: xorshift64*.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % limit
    }
}

/// What exporters leave behind, as version 3 takes it.
const EXPORTED: &str = r#"
Film "image" WorldBegin LightSource "spot" "float power" 3 Scale 1 1 0
Texture "a" "color" "mix" "rgb tex1" [ 1 0 0 ] "texture tex2" "none" "float amount" .5
MakeNamedMaterial "m" "string type" "matte" "texture Kd" "a"
MakeNamedMaterial "n" "string type" "mix" "string namedmaterial1" "m" "string namedmaterial2" "m"
MakeNamedMedium "fog" "string type" "homogeneous" MediumInterface "fog" "fog"
AttributeBegin NamedMaterial "n" TransformBegin Rotate 10 0 0 1 AttributeEnd
Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 1 ] "point P" [ 0 0 0 1 0 0 1 1 0 0 1 0 nan 0 0 ]
    "normal N" [ 0 0 1 nan 0 1 0 0 0 0 0 1 0 0 0 ] "float uv" [ 0 0 1 0 1 1 ] "float st" [ ]
Scale 1 1 1 Material "none" AreaLightSource "diffuse" Shape "sphere" NamedMaterial "nowhere" AttributeEnd
Shape "bilinearmesh" "point P" [ 0 0 0 1 0 0 0 1 0 1 1 1 ]
ObjectBegin "o" Shape "disk" ObjectInstance "o" ObjectEnd ObjectInstance "o" ObjectInstance "p"
"#;

#[test]
fn damaged_scenes_never_panic() {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let words: [&[u8]; 8] =
        [b"\"", b"[", b"]", b" 1e308 ", b" -1 ", b"ObjectBegin \"x\" ", b"AttributeEnd ", b" 0 "];
    let mut accepted = 0;
    for round in 0..8000 {
        let original = [V3, EXPORTED, EVERYTHING, EVERYTHING][round % 4];
        let mut bytes = original.as_bytes().to_vec();
        for _ in 0..=random.below(4) {
            let at = random.below(bytes.len());
            match random.below(5) {
                0 => bytes.truncate(at.max(1)),
                1 => bytes[at] = random.below(256) as u8,
                2 => drop(bytes.remove(at)),
                3 => {
                    let word = words[random.below(words.len())];
                    bytes.splice(at..at, word.iter().copied());
                }
                _ => {
                    let end = (at + random.below(40)).min(bytes.len());
                    let copy = bytes[at..end].to_vec();
                    let to = random.below(bytes.len());
                    bytes.splice(to..to, copy);
                }
            }
            if bytes.len() < 2 {
                break;
            }
        }
        match pbrt::load_bytes(&bytes, "t", Path::new(".")) {
            Ok(loaded) => {
                accepted += 1;
                assert_valid(&loaded.scene);
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    assert!(accepted > 100, "the damage is too great to test anything: {accepted}");
}

/// What the rest of wavepath relies on.
fn assert_valid(scene: &SceneDescription) {
    for mesh in &scene.meshes {
        assert!(!mesh.triangles.is_empty());
        assert!(mesh.triangles.iter().flatten().all(|i| (*i as usize) < mesh.positions.len()));
        assert!(mesh.positions.iter().flatten().all(|c| c.is_finite()));
        assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.positions.len());
        assert!(mesh.uvs.is_empty() || mesh.uvs.len() == mesh.positions.len());
    }
    for shape in &scene.shapes {
        assert!((shape.material.0 as usize) < scene.materials.len());
    }
    let [x0, x1, y0, y1] = scene.film.pixel_bounds;
    assert!(x0 < x1 && x1 <= scene.film.resolution[0] && y0 < y1 && y1 <= scene.film.resolution[1]);
    assert!(scene.sampler.pixel_samples >= 1);
}

fn messages(loaded: &Loaded) -> Vec<&str> {
    loaded.warnings.iter().map(|warning| warning.message.as_str()).collect()
}

#[test]
fn a_scene_says_all_that_it_lacks_and_only_what_it_uses() {
    let unused = "Texture \"a\" \"spectrum\" \"ptex\"\n\
        Texture \"b\" \"spectrum\" \"scale\" \"texture tex\" \"a\" \"float scale\" .5\n\
        Texture \"c\" \"spectrum\" \"mix\" \"texture tex1\" \"b\" \"rgb tex2\" [ 1 0 0 ] \"float amount\" .5\n\
        MakeNamedMaterial \"m\" \"string type\" \"coateddiffuse\"\n\
        MakeNamedMaterial \"n\" \"string type\" \"mix\" \"string materials\" [ \"m\" \"m\" ]\n\
        MakeNamedMedium \"fog\" \"string type\" \"homogeneous\"\n\
        AttributeBegin MediumInterface \"fog\" \"\" AttributeEnd\n\
        ObjectBegin \"o\" Shape \"hyperboloid\" Shape \"sphere\" \"float alpha\" 0 ObjectEnd\n\
        LightSource \"infinite\"";
    let head = "Film \"rgb\" WorldBegin\n";
    let loaded = read(&format!("{head}{unused} Shape \"sphere\"")).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let used = format!(
        "{head}{unused}\nMaterial \"diffuse\" \"texture reflectance\" \"c\" \"string normalmap\" \"n.png\"\n\
         Shape \"sphere\" Shape \"cone\" Shape \"cone\" NamedMaterial \"n\" Shape \"disk\" ObjectInstance \"o\"\n\
         MediumInterface \"fog\" \"\" Shape \"sphere\" LightSource \"infinite\""
    );
    let error = failure(&used);
    let mut all: Vec<&str> = error.others.iter().map(|other| other.message.as_str()).collect();
    all.push(&error.message);
    let lacks = [
        "shape \"cone\"",
        "shape \"hyperboloid\"",
        "participating media",
        "no picture \"n.png\"",
        "class \"ptex\"",
    ];
    for lack in lacks {
        assert_eq!(all.iter().filter(|message| message.contains(lack)).count(), 1, "{lack} in {all:#?}");
    }
    assert!(all.len() == lacks.len() || all.len() == lacks.len() + 1, "{all:#?}");
    let text = error.to_string();
    assert!(text.contains("the scene has this once more") && !text.contains("error: error"), "{text}");
    assert!(text.starts_with("t.pbrt:") && text.contains("\nerror: t.pbrt:"), "{text}");
}

#[test]
fn lenient_reading_replaces_what_is_lacking_and_says_so() {
    let scratch = Scratch::new("lenient");
    let main = scratch.write(
        "main.pbrt",
        "Film \"rgb\" PixelFilter \"sinc\" WorldBegin LightSource \"infinite\"\n\
         Material \"subsurface\" \"rgb reflectance\" [ .1 .2 .3 ] Shape \"sphere\" Shape \"cone\"\n\
         Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"t.png\" Texture \"u\" \"spectrum\" \"ptex\"\n\
         Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"disk\"",
    );
    assert_eq!(pbrt::load(&main).unwrap_err().others.len(), 3);
    let loaded = pbrt::load_leniently(&main).unwrap();
    let diffuse =
        |reflectance: [f32; 3]| Material::Diffuse { reflectance: reflectance.into(), sigma: 0.0.into() };
    assert_eq!(loaded.scene.materials.len(), 2);
    assert_eq!(loaded.scene.materials[0], diffuse([0.1, 0.2, 0.3]));
    // A picture that is missing is grey.
    assert!(matches!(
        &loaded.scene.materials[1],
        Material::Diffuse { reflectance: Parameter::Texture(_), .. }
    ));
    assert_eq!(loaded.scene.textures, [Texture::Constant([0.5; 3])]);
    assert_eq!(loaded.scene.shapes.len(), 2);
    assert_eq!(loaded.scene.lights, [Light::Infinite { radiance: [1.0; 3] }]);
    let labels: Vec<&str> = loaded.warnings.iter().map(|warning| warning.label.as_str()).collect();
    for instead in ["the default filter", "the shape is left out", "a diffuse surface", "0.5"] {
        assert_eq!(labels.iter().filter(|label| label.contains(instead)).count(), 1, "{instead}: {labels:?}");
    }
    // Mistakes stay mistakes.
    scratch.write("main.pbrt", "Film \"rgb\" WorldBegin Shape \"shpere\"");
    assert!(pbrt::load_leniently(&main).is_err());
}

/// A quad of which a v3 scene is made.
const QUAD: &str =
    "Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \"point P\" [ 0 0 0 1 0 0 1 1 0 0 1 0 ]";

#[test]
fn v3_reports_mistakes_and_goes_on() {
    let head = "WorldBegin LightSource \"infinite\" Material \"matte\" \"rgb Kd\" [ .5 .5 .5 ]";
    // A mistake, a phrase of the warning, how many shapes are left.
    for (text, phrase, shapes) in [
        (format!("AttributeBegin {QUAD}"), "AttributeBegin is never closed", 1),
        (format!("TransformBegin {QUAD}"), "TransformBegin is never closed", 1),
        (format!("AttributeEnd {QUAD}"), "AttributeEnd without AttributeBegin", 1),
        (format!("AttributeBegin TransformBegin AttributeEnd TransformEnd {QUAD}"), "AttributeEnd inside", 1),
        (format!("NamedMaterial \"nowhere\" {QUAD}"), "unknown material \"nowhere\"", 1),
        (format!("Material \"mate\" {QUAD}"), "unknown material \"mate\"", 1),
        (format!("Shape \"shpere\" {QUAD}"), "unknown shape \"shpere\"", 1),
        (format!("LightSource \"sun\" {QUAD}"), "unknown light \"sun\"", 1),
        (format!("ObjectInstance \"o\" {QUAD}"), "unknown object \"o\"", 1),
        (format!("{QUAD} \"float uv\" [ ]"), "without values", 1),
        (format!("{QUAD} \"normal N\" [ 0 0 1 0 ]"), "4 numbers for a parameter of type normal3", 1),
        (format!("{QUAD} \"float N\" [ 0 0 1 ]"), "unknown parameter \"N\"", 1),
        (format!("{} {QUAD}", QUAD.replace("2 3 ]", "2 7 ]")), "index 7 is out of range", 1),
        (format!("Shape \"trianglemesh\" \"point P\" [ ] {QUAD}"), "without values", 1),
        (format!("Material \"matte\" \"texture Kd\" \"t\" {QUAD}"), "unknown spectrum texture", 1),
        (
            format!("{QUAD} WorldEnd LookAt 0 0 1 0 0 0 0 1 0 WorldBegin Shape \"sphere\""),
            "after WorldEnd",
            1,
        ),
    ] {
        // Known to be of version 3 from the start, or only at the end.
        for film in ["Film \"image\"", ""] {
            let loaded =
                read(&format!("{film} {head} {text} WorldEnd")).unwrap_or_else(|e| panic!("{text}: {e}"));
            let found = loaded.warnings.iter().filter(|w| w.to_string().contains(phrase)).count();
            assert_eq!((found, loaded.scene.shapes.len()), (1, shapes), "{text}: {:?}", messages(&loaded));
            let grey = Material::Diffuse { reflectance: [0.5; 3].into(), sigma: 0.0.into() };
            assert_eq!(loaded.scene.materials, [grey], "{text}");
        }
        // Version 4 does not go on.
        if !text.contains("after WorldEnd") && !text.contains("WorldEnd") {
            let v4 = format!(
                "Film \"rgb\" {}",
                format!("{head} {text}").replace("\"matte\" \"rgb Kd\"", "\"diffuse\" \"rgb reflectance\"")
            );
            assert!(read(&v4).is_err(), "{v4}");
        }
    }
}

#[test]
fn crossing_blocks_restore_what_v3_saved() {
    // The end of the attributes takes the transform that TransformBegin saved, and the other end the first one.
    let text = "Film \"image\" WorldBegin Translate 1 0 0 AttributeBegin Material \"mirror\" Translate 1 0 0\n\
        TransformBegin Translate 1 0 0 AttributeEnd Shape \"sphere\" TransformEnd Shape \"sphere\" WorldEnd";
    let scene = scene(text);
    let x = |i: usize| match scene.shapes[i].geometry {
        Geometry::Sphere { world_from_object, .. } => world_from_object.translation.x,
        _ => panic!(),
    };
    assert_eq!((x(0), x(1)), (2.0, 1.0));
    assert_eq!(scene.materials, [Material::Diffuse { reflectance: [0.5; 3].into(), sigma: 0.0.into() }]);
}

#[test]
fn versions_differ_in_meaning() {
    let v3 = |text: &str| read(&format!("Film \"image\" WorldBegin {text} WorldEnd")).unwrap();
    let v4 = |text: &str| read(&format!("Film \"rgb\" WorldBegin {text}")).unwrap();
    // How a spot light fades.
    let spot = "LightSource \"spot\"";
    assert!(matches!(v3(spot).scene.lights[0], Light::Spot { fade: Fade::FourthPower, .. }));
    assert!(matches!(v4(spot).scene.lights[0], Light::Spot { fade: Fade::Smoothstep, .. }));
    // A mirror is ideal; metals and spectra carry the tint of equal energy, an index of 0 reflects everything.
    let mirror = v3("Material \"mirror\" \"rgb Kr\" [ .5 .6 .7 ] Shape \"sphere\"").scene.materials[0];
    assert_eq!(mirror, Material::Mirror { reflectance: [0.5, 0.6, 0.7].into() });
    let Material::Conductor { eta, .. } = v3("Material \"metal\" Shape \"sphere\"").scene.materials[0] else {
        panic!()
    };
    close(value(eta), [0.200438, 0.924033, 1.102212]);
    let grey = "\"spectrum k\" [ 300 2 800 2 ] \"rgb eta\" [ 0 0 0 ] Shape \"sphere\"";
    let Material::Conductor { k, .. } = v3(&format!("Material \"metal\" {grey}")).scene.materials[0] else {
        panic!()
    };
    let k = value(k);
    assert!(k[0] > 2.37 && k[1] < 1.93 && k[2] < 1.85, "{k:?}");
    let Material::Conductor { k, .. } = v4(&format!("Material \"conductor\" {grey}")).scene.materials[0]
    else {
        panic!()
    };
    assert_eq!(value(k), [2.0; 3]);
    // The energy that arrives while the shutter is open counts in version 4.
    let shutter = "Camera \"perspective\" \"float shutteropen\" .25 \"float shutterclose\" .75";
    let sky = "WorldBegin LightSource \"infinite\" \"rgb L\" [ 2 2 2 ]";
    let lights = |film: &str| scene(&format!("{shutter} Film \"{film}\" {sky}")).lights;
    assert_eq!(lights("rgb"), [Light::Infinite { radiance: [1.0; 3] }]);
    assert_eq!(lights("image"), [Light::Infinite { radiance: [2.0; 3] }]);
    let closed = "Camera \"perspective\" \"float shutterclose\" 0 Film \"rgb\" WorldBegin";
    assert!(failure(closed).message.contains("shutterclose"));
    // Version 3 has no power and no illuminance.
    let point = "LightSource \"point\" \"rgb I\" [ 1 1 1 ] \"float power\" 20";
    let loaded = v3(point);
    assert!(matches!(loaded.scene.lights[0], Light::Point { intensity: [1.0, 1.0, 1.0], .. }));
    assert!(messages(&loaded)[0].contains("unknown parameter \"power\""));
    // Quads of a PLY file that are not plane are patches in version 4.
    let scratch = Scratch::new("versions");
    scratch.write("bent.ply", PLY.replace("1 1 0", "1 1 1"));
    for (film, triangles) in [("image", 2), ("rgb", 2 * 14 * 14)] {
        let text = format!("Film \"{film}\" WorldBegin Shape \"plymesh\" \"string filename\" \"bent.ply\"");
        let scene = pbrt::load(&scratch.write("main.pbrt", text)).unwrap().scene;
        let meshes: usize = scene
            .shapes
            .iter()
            .map(|shape| match shape.geometry {
                Geometry::Mesh(id) => scene.meshes[id.0 as usize].triangles.len(),
                _ => 0,
            })
            .sum();
        assert!(meshes == triangles || (triangles > 2 && meshes > 100), "{film}: {meshes}");
    }
    // Other integrators of version 3 are the path integrator, with a warning.
    let direct = read(
        "Integrator \"directlighting\" \"string strategy\" \"one\" Film \"image\" WorldBegin LightSource \"infinite\"",
    );
    assert!(messages(&direct.unwrap())[0].contains("rendered as \"path\""));
}

#[test]
fn roundings_of_exporters_are_none_of_motion_and_projection() {
    for text in [
        "Transform [ 1 0 0 1e-17  0 1 0 -1e-9  0 0 1 0  5 6 7 1 ]",
        "Transform [ 2 0 0 0  0 2 0 0  0 0 2 1e-8  10 12 14 2 ]",
        "Translate 5 6 7 ActiveTransform StartTime Rotate 30 0 0 1 ActiveTransform EndTime Rotate 10 0 0 1\n\
         Rotate 20 0 0 1 ActiveTransform All Rotate -30 0 0 1",
        "ActiveTransform StartTime Translate 5 6 7 ActiveTransform EndTime Translate 5.0000001 6 7",
    ] {
        let found = sphere_transform(text);
        assert!((found.transform_point3(DVec3::ONE) - DVec3::new(6.0, 7.0, 8.0)).length() < 1e-6, "{text}");
    }
    for (text, phrase) in [
        ("Transform [ 1 0 0 1e-4  0 1 0 0  0 0 1 0  0 0 0 1 ]", "projective"),
        ("ActiveTransform StartTime Translate 1e-3 0 0", "motion"),
        ("ActiveTransform StartTime Rotate .01 0 0 1", "motion"),
    ] {
        let error = failure(&format!("Film \"rgb\" WorldBegin {text} ActiveTransform All Shape \"sphere\""));
        assert!(error.message.contains(phrase), "{error}");
    }
}

#[test]
fn flattened_things_are_seen_as_far_as_they_can_be() {
    let flat = read(&format!(
        "Film \"rgb\" WorldBegin LightSource \"infinite\" Scale 1 1 0\n\
         {QUAD} \"normal N\" [ 0 0 1 0 0 1 0 .6 .8 0 0 1 ] Shape \"sphere\" Scale 0 0 0 {QUAD}\n\
         AttributeBegin Translate 1 2 3 AttributeEnd"
    ))
    .unwrap();
    assert_eq!((flat.scene.shapes.len(), flat.scene.meshes[0].triangles.len()), (1, 2));
    assert_eq!(flat.scene.meshes[0].normals, [[0.0, 0.0, 1.0]; 4]);
    let warnings = messages(&flat);
    assert!(warnings.contains(&"1 shape left out: the transform makes it flat, and cannot be inverted"));
    assert!(warnings.iter().any(|w| w.starts_with("2 degenerate triangles")), "{warnings:?}");
    assert_eq!(warnings.len(), 2);
    // Normals that lie in the direction which is gone are those of the plane.
    let lying = world(&format!("Scale 1 1 0 {QUAD} \"normal N\" [ 1 0 0 1 0 0 1 0 0 1 0 0 ]"));
    assert!(lying.meshes[0].normals.is_empty());
}

#[test]
fn what_a_mesh_can_do_without_is_left_out_and_counted() {
    let loaded =
        |text: &str| read(&format!("Film \"rgb\" WorldBegin LightSource \"infinite\" {text}")).unwrap();
    for (text, warning) in [
        ("\"normal N\" [ 0 0 1 0 0 1 0 0 1 ]", "1 array of normals left out"),
        ("\"point2 uv\" [ 0 0 1 0 1 1 ]", "1 array of texture coordinates left out"),
        ("\"normal N\" [ nan nan nan nan nan nan nan 0 1 -nan 0 1 ]", "4 normals left out"),
        ("\"point2 uv\" [ 0 0 1 0 nan 1 0 inf ]", "2 texture coordinates left out"),
    ] {
        let loaded = loaded(&format!("{QUAD} {text}"));
        let mesh = &loaded.scene.meshes[0];
        assert!(messages(&loaded)[0].starts_with(warning), "{text}: {:?}", messages(&loaded));
        assert!(mesh.normals.is_empty() && mesh.triangles.len() == 2, "{text}");
        assert_valid(&loaded.scene);
    }
    let seven = loaded(&QUAD.replace("0 2 3 ]", "0 2 3 1 ]"));
    assert_eq!(messages(&seven), ["1 index left out behind the last whole face of a mesh"]);
    assert_eq!(seven.scene.meshes[0].triangles.len(), 2);
    // A vertex that nothing uses may be anything.
    let unused = loaded(&QUAD.replace("0 1 0 ]", "0 1 0 nan 1e300 -inf ]"));
    assert_valid(&unused.scene);
    assert!(unused.warnings.is_empty());
    // Normals of 0 are none: silently, as in pbrt.
    let zero = loaded(&format!("{QUAD} \"normal N\" [ 0 0 0 0 0 0 0 0 0 0 0 0 ]"));
    assert!(zero.scene.meshes[0].normals.is_empty() && zero.warnings.is_empty());
    // Only the face that has one is flat, and on the side that its winding gives: here the other one is turned.
    let one = loaded(&format!("ReverseOrientation {QUAD} \"normal N\" [ 0 0 1 nan 0 1 0 .6 .8 0 0 1 ]"));
    let mesh = &one.scene.meshes[0];
    let normals = |i: usize| mesh.triangles[i].map(|v| mesh.normals[v as usize]);
    assert_eq!(normals(0), [[0.0, 0.0, -1.0]; 3]);
    close(normals(1)[1], [0.0, -0.6, -0.8]);
    assert!(messages(&one)[0].starts_with("1 normal left out"));
}

#[test]
fn surfaces_that_are_not_there_are_left_out() {
    let head = "LightSource \"infinite\" Material \"interface\"";
    let loaded =
        read(&format!("Film \"rgb\" WorldBegin {head} Shape \"sphere\" Material \"diffuse\" {QUAD}"));
    let loaded = loaded.unwrap();
    assert_eq!((loaded.scene.shapes.len(), loaded.scene.materials.len()), (1, 1));
    assert!(loaded.warnings.is_empty());
    // Version 4 drops lamps of that material, version 3 lets them shine.
    let lamp = "AreaLightSource \"diffuse\" Shape \"sphere\"";
    let v4 = read(&format!("Film \"rgb\" WorldBegin {head} {lamp}")).unwrap();
    assert!(v4.scene.shapes.is_empty());
    assert!(v4.warnings.is_empty());
    for none in ["none", ""] {
        let v3 = scene(&format!("Film \"image\" WorldBegin Material \"{none}\" {lamp}"));
        assert_eq!(v3.shapes.len(), 1);
        assert!(v3.shapes[0].emission.is_some());
        assert!(matches!(v3.materials[0], Material::Dielectric { eta, .. } if value(eta) == 1.0));
    }
}

#[test]
fn bent_quads_are_patches_with_their_own_normals() {
    // z = x y over the unit square: the area is the integral of sqrt(1 + x^2 + y^2), 1.2807905.
    let bent = world("Shape \"bilinearmesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 1 1 1 ]");
    let mesh = &bent.meshes[0];
    let point = |i: u32| DVec3::from_array(mesh.positions[i as usize].map(f64::from));
    let area: f64 = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(point);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    let n = 400;
    let exact: f64 = (0..n * n)
        .map(|i| {
            let (x, y) = ((f64::from(i % n) + 0.5) / f64::from(n), (f64::from(i / n) + 0.5) / f64::from(n));
            (1.0 + x * x + y * y).sqrt() / f64::from(n * n)
        })
        .sum();
    assert!((area / exact - 1.0).abs() < 1e-3, "{area}, not {exact}");
    for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
        let [x, y, z] = p.map(f64::from);
        assert!((z - x * y).abs() < 1e-6);
        let exact = DVec3::new(-y, -x, 1.0).normalize();
        assert!((DVec3::from_array(n.map(f64::from)) - exact).length() < 1e-6);
    }
    // Mirrored and reversed, the normals turn as those of a mesh do.
    let turned = world(
        "ReverseOrientation Scale 1 1 -1 Shape \"bilinearmesh\" \"point3 P\" [ 0 0 0 1 0 0 0 1 0 1 1 1 ]",
    );
    close(turned.meshes[0].normals[0], [0.0, 0.0, 1.0]);
    let folded = read(
        "Film \"rgb\" WorldBegin LightSource \"infinite\" Shape \"bilinearmesh\" \"point3 P\" [ 0 0 0 2 0 0 0 2 0 .5 .5 0 ]",
    );
    assert!(messages(&folded.unwrap())[0].starts_with("1 quad with a reflex corner"));
}

#[test]
fn polygons_of_a_mesh_are_cut_with_a_note() {
    let scratch = Scratch::new("polygons");
    let ply = PLY.replace("vertex 4", "vertex 6").replace("face 1", "face 2").replace(
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
        "0 0 0\n2 0 0\n2 1 0\n1 1 0\n1 2 0\n0 2 0\n6 0 1 2 3 4 5\n2 0 1\n",
    );
    scratch.write("l.ply", ply);
    let text =
        "Film \"rgb\" WorldBegin LightSource \"infinite\" Shape \"plymesh\" \"string filename\" \"l.ply\"";
    let loaded = pbrt::load(&scratch.write("main.pbrt", text)).unwrap();
    let mesh = &loaded.scene.meshes[0];
    let area: f64 = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| DVec3::from_array(mesh.positions[i as usize].map(f64::from)));
            0.5 * (b - a).cross(c - a).z
        })
        .sum();
    assert!((area - 3.0).abs() < 1e-6);
    let warnings = messages(&loaded);
    assert!(
        warnings[0].starts_with("1 face left out") && warnings[1].starts_with("1 face with more than four")
    );
}

#[test]
fn stretched_spot_lights_keep_their_cone_in_their_own_space() {
    let spot = |transform: &str| {
        let light = "LightSource \"spot\" \"point3 from\" [ 0 0 1 ] \"point3 to\" [ 3 0 5 ]";
        match world(&format!("{transform} {light}")).lights[0] {
            Light::Spot { direction, light_from_world, .. } => (direction, light_from_world),
            _ => panic!(),
        }
    };
    for rigid in ["", "Scale 2 2 2", "Scale -1 1 1", "Rotate 33 1 2 3 Scale .1 .1 -.1"] {
        assert!(spot(rigid).1.is_none(), "{rigid}");
    }
    let (direction, matrix) = spot("Scale 1 1 3");
    let matrix = matrix.unwrap();
    assert!((direction - DVec3::new(0.6, 0.0, 0.8)).length() < 1e-12);
    // The axis of the world, (3, 0, 12), is that of the light.
    let axis = (matrix * DVec3::new(3.0, 0.0, 12.0)).normalize();
    assert!((axis - direction).length() < 1e-12);
}

#[test]
fn scenes_from_standard_input_look_in_the_working_directory() {
    let scratch = Scratch::new("stdin");
    scratch.write("m.ply", PLY);
    let text =
        "Film \"rgb\" WorldBegin LightSource \"infinite\" Shape \"plymesh\" \"string filename\" \"m.ply\"";
    let file = scratch.write("main.txt", text);
    for from_pipe in [true, false] {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_wavepath"));
        child.args(["plan", "/dev/stdin"]).current_dir(&scratch.0).stdout(std::process::Stdio::piped());
        child.stderr(std::process::Stdio::piped());
        let output = if from_pipe {
            let mut child = child.stdin(std::process::Stdio::piped()).spawn().unwrap();
            child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
            child.wait_with_output().unwrap()
        } else {
            child.stdin(std::fs::File::open(&file).unwrap()).output().unwrap()
        };
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{error}");
        assert!(String::from_utf8_lossy(&output.stdout).contains("2 triangles"));
    }
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_wavepath"))
        .args(["plan", "nowhere.pbrt"])
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(
        error.starts_with("error: cannot read nowhere.pbrt") && output.status.code() == Some(2),
        "{error}"
    );
}

#[test]
fn surfaces_are_subdivided() {
    let tetrahedron = "\"point3 P\" [ 1 1 1  -1 -1 1  -1 1 -1  1 -1 -1 ] \"integer indices\" [ 0 2 1  0 1 3  0 3 2  1 2 3 ]";
    for (levels, triangles) in [("", 4 << 6), ("\"integer levels\" 0", 4), ("\"integer levels\" 1", 16)] {
        let scene = world(&format!("Shape \"loopsubdiv\" {tetrahedron} {levels}"));
        let mesh = &scene.meshes[0];
        assert_eq!(mesh.triangles.len(), triangles);
        assert_eq!(mesh.normals.len(), mesh.positions.len());
        // The limit of a vertex with three neighbours, whatever the level: 2/5 of it, 1/5 of each of them.
        let corner = DVec3::from(mesh.positions[0].map(f64::from));
        assert!((corner - DVec3::splat(0.2)).length() < 1e-6, "{corner}");
    }
    let error =
        read(&format!("Film \"rgb\" WorldBegin Shape \"loopsubdiv\" {tetrahedron} \"integer levels\" -1"));
    assert!(error.unwrap_err().to_string().contains("not negative"));
    let error =
        read(&format!("Film \"rgb\" WorldBegin Shape \"loopsubdiv\" {tetrahedron} \"integer levels\" 30"));
    assert!(error.unwrap_err().to_string().contains("too m"));
}
