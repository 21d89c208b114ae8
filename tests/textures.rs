//! Textures against what they should be, computed here in double precision: on a surface under a uniform sky of radiance 1
//! that sees nothing of itself, the radiance of a diffuse reflector is its reflectance.

mod support;

use std::path::{Path, PathBuf};

use support::{ENGINES, Render, scene};
use wavepath::scene::SceneDescription;

const SIZE: usize = 12;

/// Seen from (0, 0, -2), 90 degrees wide; pixels are points.
fn view(world: &str) -> String {
    format!(
        "LookAt 0 0 -2  0 0 0  0 1 0 Camera \"perspective\" \"float fov\" 90\n\
         Film \"rgb\" \"integer xresolution\" {SIZE} \"integer yresolution\" {SIZE}\n\
         PixelFilter \"box\" \"float xradius\" 1e-5 \"float yradius\" 1e-5\n\
         WorldBegin LightSource \"infinite\"\n{world}"
    )
}

/// Where the ray through the centre of a pixel goes, and its colour in the picture of both engines.
fn pixels(scene: &SceneDescription) -> Vec<([f64; 3], [f64; 3])> {
    let renders = ENGINES.map(|engine| Render { engine, spp: Some(1), ..Render::default() }.of(scene));
    assert_eq!(renders[0].bits(), renders[1].bits(), "engines agree");
    let centre = |i: usize| (2 * i + 1) as f64 / SIZE as f64 - 1.0;
    let pixels = renders[0].developed.pixels.iter().enumerate();
    pixels.map(|(i, pixel)| ([centre(i % SIZE), -centre(i / SIZE), 1.0], pixel.map(f64::from))).collect()
}

/// Compares each pixel whose ray meets something with the colour there. Colours jump at edges, which may be a rounding
/// error away: `near` says where not to look.
fn compare(what: &str, world: &str, want: impl Fn([f64; 3]) -> Option<[f64; 3]>) {
    let scene = scene(&view(world));
    let mut met = 0;
    for (direction, got) in pixels(&scene) {
        let Some(want) = want(direction) else { continue };
        met += 1;
        for k in 0..3 {
            assert!((got[k] - want[k]).abs() < 2e-5, "{what}: {direction:?}: {got:?}, expected {want:?}");
        }
    }
    assert!(met >= SIZE * SIZE / 12, "{what}: {met} pixels");
}

/// The point of the plane z = 0.
fn on_plane([x, y, _]: [f64; 3]) -> [f64; 2] {
    [2.0 * x, 2.0 * y]
}

/// The first point of the sphere of radius 1 around the origin.
fn on_sphere([x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
    let length = (x * x + y * y + z * z).sqrt();
    let d = [x, y, z].map(|c| c / length);
    let b = 2.0 * d[2];
    let discriminant = b * b - 3.0;
    (discriminant > 1e-3).then(|| {
        let t = b - discriminant.sqrt();
        [t * d[0], t * d[1], t * d[2] - 2.0]
    })
}

/// Red is u, green is v.
const UV: &str = "Texture \"uv\" \"spectrum\" \"bilerp\" \"rgb v00\" [ 0 0 0 ] \"rgb v01\" [ 0 1 0 ] \
     \"rgb v10\" [ 1 0 0 ] \"rgb v11\" [ 1 1 0 ] Material \"diffuse\" \"texture reflectance\" \"uv\"\n";

const QUAD: &str = "Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \
     \"point3 P\" [ -2 -2 0 2 -2 0 2 2 0 -2 2 0 ]";

fn turns(y: f64, x: f64) -> f64 {
    y.atan2(x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU
}

#[test]
fn coordinates_of_surfaces() {
    let given = format!("{UV}{QUAD} \"point2 uv\" [ .1 .2 .7 .2 .7 1 .1 1 ]");
    compare("given", &given, |d| {
        let [x, y] = on_plane(d);
        Some([0.1 + 0.6 * (x + 2.0) / 4.0, 0.2 + 0.8 * (y + 2.0) / 4.0, 0.0])
    });
    // (0, 0), (1, 0), (1, 1) at the corners of each triangle.
    compare("none", &format!("{UV}{QUAD}"), |d| {
        let [x, y] = on_plane(d).map(|c| (c + 2.0) / 4.0);
        let second = y > x;
        Some(if second { [y, y - x, 0.0] } else { [x, y, 0.0] }).filter(|_| (x - y).abs() > 1e-6)
    });
    // From 0 to 1 on each patch, whatever they share: 00, 10, 01, 11.
    let patches = "Shape \"bilinearmesh\" \"integer indices\" [ 0 1 3 4 1 2 4 5 ] \
         \"point3 P\" [ -2 -2 0 0 -2 0 2 -2 0 -2 2 0 0 2 0 2 2 0 ]";
    compare("patches", &format!("{UV}{patches}"), |d| {
        let [x, y] = on_plane(d);
        Some([(x / 2.0).rem_euclid(1.0), (y + 2.0) / 4.0, 0.0])
    });
    let sphere = |p: [f64; 3]| Some([turns(p[1], p[0]), 1.0 - p[2].acos() / std::f64::consts::PI, 0.0]);
    compare("sphere", &format!("{UV} Shape \"sphere\""), |d| sphere(on_sphere(d)?));
    compare("sphere, reversed", &format!("{UV} ReverseOrientation Shape \"sphere\""), |d| {
        sphere(on_sphere(d)?)
    });
    compare(
        "turned sphere",
        &format!("{UV} Rotate 90 0 1 0 Scale .5 .5 .5 Shape \"sphere\" \"float radius\" 2"),
        |d| {
            // z becomes x.
            let [x, y, z] = on_sphere(d)?;
            sphere([-z, y, x])
        },
    );
    // Clipped and stretched to the whole sphere's form: the far half, azimuths up to 180 degrees, seen from inside.
    let part = "Shape \"sphere\" \"float zmin\" -.999 \"float zmax\" .5 \"float phimax\" 180";
    compare("part of a sphere", &format!("{UV} {part}"), |d| {
        let p = on_sphere(d).filter(|p| p[1] > 1e-3 && p[2] > -0.99 && p[2] < 0.49)?;
        let (low, high) = ((-0.999f64).acos(), 0.5f64.acos());
        Some([2.0 * turns(p[1], p[0]), (p[2].acos() - low) / (high - low), 0.0])
    });
    compare("disk", &format!("{UV} Shape \"disk\" \"float radius\" 2 \"float innerradius\" .5"), |d| {
        let [x, y] = on_plane(d);
        let r = x.hypot(y);
        (r > 0.51 && r < 1.99).then(|| [turns(y, x), (2.0 - r) / 1.5, 0.0])
    });
    // Around the x axis, which Rotate makes of z; of the outside one sees the side at z = -1.
    compare(
        "cylinder",
        &format!("{UV} Rotate 90 0 1 0 Shape \"cylinder\" \"float zmin\" -2 \"float zmax\" 2"),
        |d| {
            let [x, y, z] = d;
            let (a, b) = (y * y + z * z, 2.0 * z);
            let discriminant = b * b - 3.0 * a;
            (discriminant > 1e-3).then(|| {
                let t = (b - discriminant.sqrt()) / a;
                let p = [x * t, y * t, z * t - 2.0];
                [turns(p[1], -p[2]), (p[0] + 2.0) / 4.0, 0.0]
            })
        },
    );
}

#[test]
fn mappings() {
    let bilerp = |mapping: &str| {
        format!(
            "AttributeBegin Translate .25 0 0 Scale 2 2 2 Texture \"t\" \"spectrum\" \"bilerp\" \"rgb v00\" [ 0 0 0 ]\n\
             \"rgb v01\" [ 0 .25 0 ] \"rgb v10\" [ .25 0 0 ] \"rgb v11\" [ .25 .25 0 ] {mapping} AttributeEnd\n\
             Material \"diffuse\" \"texture reflectance\" \"t\" {QUAD} \"point2 uv\" [ 0 0 1 0 1 1 0 1 ]"
        )
    };
    let quarter = |s: f64, t: f64| Some([0.25 * s, 0.25 * t, 0.0]);
    // In the texture's space.
    let local = |d| on_plane(d).map(|c| c / 2.0);
    let uv = "\"float uscale\" 2 \"float vscale\" .5 \"float udelta\" .5 \"float vdelta\" .25";
    compare("uv", &bilerp(uv), |d| {
        let [x, y] = on_plane(d).map(|c| (c + 2.0) / 4.0);
        quarter(2.0 * x + 0.5, 0.5 * y + 0.25)
    });
    let planar = "\"string mapping\" \"planar\" \"vector3 v1\" [ .5 .25 0 ] \"vector3 v2\" [ 0 1 0 ] \
         \"float udelta\" 2 \"float vdelta\" 2";
    compare("planar", &bilerp(planar), |d| {
        let [x, y] = local(d);
        let x = x - 0.125;
        quarter(2.0 + 0.5 * x + 0.25 * y, 2.0 + y)
    });
    compare("spherical", &bilerp("\"string mapping\" \"spherical\""), |d| {
        let [x, y] = local(d);
        quarter(0.5, turns(y, x - 0.125))
    });
    compare("cylindrical", &bilerp("\"string mapping\" \"cylindrical\""), |d| {
        let [x, y] = local(d);
        quarter(turns(-y, -(x - 0.125)), 0.0)
    });
}

#[test]
fn checks_in_the_plane_and_in_space() {
    let world = format!(
        "Texture \"a\" \"spectrum\" \"checkerboard\" \"float uscale\" 5 \"float vscale\" 5\n\
         \"rgb tex1\" [ .1 .2 .3 ] \"rgb tex2\" [ .9 .8 .7 ]\n\
         AttributeBegin Rotate 30 1 1 0 Scale .3 .3 .3 Texture \"b\" \"spectrum\" \"checkerboard\"\n\
         \"integer dimension\" 3 \"texture tex1\" \"a\" \"rgb tex2\" [ .5 0 0 ] AttributeEnd\n\
         Material \"diffuse\" \"texture reflectance\" \"b\" {QUAD} \"point2 uv\" [ 0 0 1 0 1 1 0 1 ]"
    );
    let axis = [0.5f64.sqrt(), 0.5f64.sqrt(), 0.0];
    compare("checks", &world, |d| {
        let [x, y] = on_plane(d);
        let [u, v] = [5.0 * (x + 2.0) / 4.0, 5.0 * (y + 2.0) / 4.0];
        // Turned back by 30 degrees, after Rodrigues.
        let (sin, cos) = (-30f64).to_radians().sin_cos();
        let along = axis[0] * x + axis[1] * y;
        let cross = [axis[1] * 0.0, -axis[0] * 0.0, axis[0] * y - axis[1] * x];
        let p: [f64; 3] = std::array::from_fn(|k| {
            let c = [x, y, 0.0][k];
            (c * cos + cross[k] * sin + axis[k] * along * (1.0 - cos)) / 0.3
        });
        let whole = |c: f64| c.floor() as i64;
        let far = |c: f64| (c - c.round()).abs() > 1e-4;
        let inner = whole(u) + whole(v);
        let outer = whole(p[0]) + whole(p[1]) + whole(p[2]);
        let colour = match (outer & 1, inner & 1) {
            (0, 0) => [0.1, 0.2, 0.3],
            (0, _) => [0.9, 0.8, 0.7],
            _ => [0.5, 0.0, 0.0],
        };
        [u, v, p[0], p[1], p[2]].into_iter().all(far).then_some(colour)
    });
}

#[test]
fn arithmetic_of_textures() {
    let world = format!(
        "Texture \"u\" \"float\" \"bilerp\" \"float v00\" 0 \"float v01\" 0 \"float v10\" 1 \"float v11\" 1\n\
         Texture \"half\" \"float\" \"scale\" \"texture tex\" \"u\" \"float scale\" .5\n\
         Texture \"m\" \"spectrum\" \"mix\" \"rgb tex1\" [ .2 .4 .6 ] \"rgb tex2\" [ .8 0 .6 ] \"texture amount\" \"half\"\n\
         Texture \"s\" \"spectrum\" \"scale\" \"texture tex\" \"m\" \"texture scale\" \"u\"\n\
         Texture \"d\" \"spectrum\" \"directionmix\" \"texture tex1\" \"s\" \"rgb tex2\" [ 1 1 1 ] \"vector3 dir\" [ 0 3 4 ]\n\
         Material \"diffuse\" \"texture reflectance\" \"d\" {QUAD} \"point2 uv\" [ 0 0 1 0 1 1 0 1 ]"
    );
    compare("arithmetic", &world, |d| {
        let u = (on_plane(d)[0] + 2.0) / 4.0;
        let mixed = |a: f64, b: f64| u * (a * (1.0 - u / 2.0) + b * u / 2.0);
        Some([mixed(0.2, 0.8), mixed(0.4, 0.0), mixed(0.6, 0.6)].map(|c| 0.8 * c + 0.2))
    });
}

/// A folder of its own, and a picture of 2 x 2 colours in it, in linear light: rows from the bottom, as PFM has them.
fn picture(name: &str) -> (PathBuf, [[[f32; 3]; 2]; 2]) {
    let folder = std::env::temp_dir().join(format!("wavepath-textures-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let rows = [[[0.1, 0.2, 0.3], [0.9, 0.1, 0.5]], [[0.3, 0.8, 0.2], [0.25, 0.5, 0.75]]];
    let mut bytes = b"PF\n2 2\n-1.0\n".to_vec();
    rows.iter().flatten().flatten().for_each(|x: &f32| bytes.extend(x.to_le_bytes()));
    std::fs::write(folder.join("four.pfm"), bytes).expect("written");
    (folder, rows)
}

fn load(folder: &Path, text: &str) -> Result<SceneDescription, String> {
    std::fs::write(folder.join("scene.pbrt"), text).expect("written");
    match wavepath::pbrt::load(&folder.join("scene.pbrt")) {
        Ok(loaded) => Ok(loaded.scene),
        Err(error) => Err(error.to_string()),
    }
}

#[test]
fn pictures_are_mixed_between_pixels_and_go_on_as_asked() {
    let (folder, rows) = picture("mixed");
    for (wrap, options, scale, invert) in [
        ("repeat", "", 1.0, false),
        ("clamp", "\"float scale\" .5 \"bool invert\" true", 0.5, true),
        ("black", "", 1.0, false),
    ] {
        let world = format!(
            "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"four.pfm\" \"string wrap\" \"{wrap}\" {options}\n\
             Texture \"again\" \"spectrum\" \"imagemap\" \"string filename\" \"four.pfm\"\n\
             Material \"diffuse\" \"texture reflectance\" \"t\" {QUAD} \"point2 uv\" [ -1 -1 2 -1 2 2 -1 2 ]\n\
             Material \"diffuse\" \"texture reflectance\" \"again\" Translate 0 0 -50 Shape \"sphere\" \"float radius\" .01"
        );
        let scene = load(&folder, &view(&world)).expect("a scene");
        assert_eq!(scene.images.len(), 1, "read once");
        let pixel = |x: i64, y: i64| -> [f64; 3] {
            let inside = (0..2).contains(&x) && (0..2).contains(&y);
            let (x, y) = match wrap {
                "repeat" => (x.rem_euclid(2), y.rem_euclid(2)),
                "black" if !inside => return [0.0; 3],
                _ => (x.clamp(0, 1), y.clamp(0, 1)),
            };
            rows[y as usize][x as usize].map(f64::from)
        };
        for (d, got) in pixels(&scene) {
            let [x, y] = on_plane(d);
            let [s, t] =
                [2.0 * (3.0 * (x + 2.0) / 4.0 - 1.0) - 0.5, 2.0 * (3.0 * (y + 2.0) / 4.0 - 1.0) - 0.5];
            let (i, j) = (s.floor(), t.floor());
            for k in 0..3 {
                let at = |di: i64, dj: i64| pixel(i as i64 + di, j as i64 + dj)[k];
                let (fs, ft) = (s - i, t - j);
                let value = (1.0 - ft) * ((1.0 - fs) * at(0, 0) + fs * at(1, 0))
                    + ft * ((1.0 - fs) * at(0, 1) + fs * at(1, 1));
                let value = scale * value;
                let want = if invert { 1.0 - value } else { value };
                assert!((got[k] - want).abs() < 2e-5, "{wrap}: {d:?}: {got:?}, expected {want} in {k}");
            }
        }
    }
    // What nothing uses may be missing; what is missing says where it was looked for.
    let missing = "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"no/such.png\"\n";
    assert!(load(&folder, &view(&format!("{missing}{QUAD}"))).expect("a scene").images.is_empty());
    let used = format!("{missing}Material \"diffuse\" \"texture reflectance\" \"t\" {QUAD}");
    let error = load(&folder, &view(&used)).expect_err("missing");
    assert!(error.contains("no/such.png") && error.contains("looked for"), "{error}");
    std::fs::remove_dir_all(folder).expect("removed");
}

/// The share of rays that a surface of opacity 0.25 lets through: of the sky behind it, and of light that reaches a
/// floor below. With a texture, where it is 0 and 1 it is sure.
#[test]
fn what_is_not_there_is_not_seen_and_casts_no_shadow() {
    let black = "Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ]";
    let mean = |world: &str| {
        let scene = scene(&view(world));
        let renders = ENGINES.map(|engine| Render { engine, spp: Some(64), ..Render::default() }.of(&scene));
        assert_eq!(renders[0].bits(), renders[1].bits(), "engines agree");
        let pixels = &renders[0].developed.pixels;
        pixels.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / pixels.len() as f64
    };
    // 9216 samples: 5 standard errors of sqrt(p q / n) are 0.023.
    let seen = mean(&format!("{black} {QUAD} \"float alpha\" .25"));
    assert!((seen - 0.75).abs() < 0.023, "{seen}");
    let checks = "Texture \"c\" \"float\" \"checkerboard\" \"float uscale\" 6 \"float vscale\" 6";
    let seen =
        mean(&format!("{checks} {black} {QUAD} \"point2 uv\" [ 0 0 1 0 1 1 0 1 ] \"texture alpha\" \"c\""));
    assert!((seen - 0.5).abs() < 1e-6, "{seen}");
    // A lamp behind a sheet, a floor before it: half of its light.
    let lit = |alpha: &str| {
        let text = format!(
            "LookAt 0 0 -2  0 0 0  0 1 0 Camera \"perspective\" \"float fov\" 20\n\
             Film \"rgb\" \"integer xresolution\" 8 \"integer yresolution\" 8 WorldBegin\n\
             LightSource \"point\" \"point3 from\" [ 0 0 -1 ] \"rgb I\" [ 1 1 1 ] Shape \"disk\" \"float radius\" 5\n\
             {black} Shape \"disk\" \"float height\" -.5 {alpha}"
        );
        let scene = scene(&text);
        let renders = ENGINES.map(|engine| Render { engine, spp: Some(256), ..Render::default() }.of(&scene));
        assert_eq!(renders[0].bits(), renders[1].bits(), "engines agree");
        let pixels = &renders[0].developed.pixels;
        pixels.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / pixels.len() as f64
    };
    let (all, none) = (lit("\"float alpha\" 0"), lit("\"float alpha\" 1"));
    let half = lit("\"float alpha\" .5");
    assert_eq!(none, 0.0);
    // The sheet is passed twice, by the path and by the ray towards the light.
    assert!((half / all - 0.25).abs() < 0.02, "{half} of {all}");
}
