//! The film in whole renders: parts and prefixes, channels, light of any size.

mod support;

use std::ops::Range;

use support::{ENGINES, Render, SAMPLERS, scene, shipped, sized};
use wavepath::Scene;
use wavepath::engine::EngineKind;
use wavepath::film::{Film, FilmError, replicates};
use wavepath::scene::{Filter, SceneDescription};
use wavepath_kernels::channels::{Channel, ChannelSet};

/// Glass, metal, lamps, and a filter with negative lobes.
fn lobed() -> SceneDescription {
    let mitchell = Filter::Mitchell { radius: [2.0; 2], b: 1.0 / 3.0, c: 1.0 / 3.0 };
    SceneDescription { filter: mitchell, ..sized(shipped("metals.pbrt"), 40, 29) }
}

fn prepared(description: &SceneDescription) -> Scene {
    Scene::new("test", description.clone()).unwrap()
}

/// Renders some samples of each pixel into a film of their own, or adds them to one.
fn samples(render: &Render, scene: &Scene, range: Range<u32>, film: Option<Film>) -> Film {
    let render = render.render(scene).channels(ChannelSet::all());
    let film = film.unwrap_or_else(|| render.film().unwrap());
    let tree = scene.tree(render.settings().engine);
    render.session(&tree, &film).unwrap().samples(range).run(None, |_| ());
    film
}

/// A render that is cut into parts by sample numbers, each by another engine and number of threads, is that in one piece,
/// in whatever order the parts are added.
#[test]
fn parts_make_the_whole() {
    const SPP: u32 = 70;
    for description in [lobed(), sized(shipped("caustics.pbrt"), 33, 20)] {
        let scene = prepared(&description);
        for sampler in SAMPLERS {
            let base = Render { sampler, ..Render::default() };
            let whole = samples(&base, &scene, 0..SPP, None);
            assert_eq!(whole.sample_range(), [SPP; 2]);
            let bits = whole.to_bytes();
            for cut in [2, 3, 7] {
                let part = |k: u32| {
                    let engine = ENGINES[k as usize % 2];
                    let render = Render { engine, threads: 1 + k as usize % 3, batch: 1000, ..base.clone() };
                    samples(&render, &scene, SPP * k / cut..SPP * (k + 1) / cut, None)
                };
                let mut parts: Vec<Film> = (0..cut).map(part).collect();
                // As they may come from another machine.
                parts.iter_mut().for_each(|part| *part = Film::from_bytes(&part.to_bytes()).unwrap());
                for turn in 0..2 {
                    let sum = Film::new(whole.header().clone()).unwrap();
                    for k in 0..cut as usize {
                        let k = if turn == 0 { cut as usize - 1 - k } else { k * 5 % cut as usize };
                        sum.merge(&parts[k]).unwrap();
                    }
                    assert!(sum.to_bytes() == bits, "{cut} parts are not the whole");
                    assert!(matches!(sum.merge(&parts[0]), Err(FilmError::Overlap { .. })));
                }
            }
        }
    }
}

/// A render of 64 samples is a part of one of 256: the film of the one can be gone on with to the other, wherever it was
/// stopped.
#[test]
fn a_render_is_a_prefix_of_a_longer_one() {
    let scene = prepared(&lobed());
    let base = Render { spp: Some(256), ..Render::default() };
    let whole = samples(&base, &scene, 0..256, None).to_bytes();
    for ends in [vec![64], vec![1, 3, 17, 100], vec![130, 131]] {
        let mut film = samples(&base, &scene, 0..ends[0], None);
        let prefix = film.to_bytes();
        for end in ends.iter().copied().chain([256]) {
            // All samples are asked for, and those that are there are not rendered again.
            film = samples(&base, &scene, 0..end, Some(Film::from_bytes(&film.to_bytes()).unwrap()));
            assert_eq!(film.sample_range(), [end; 2]);
        }
        assert!(film.to_bytes() == whole && prefix != whole, "{ends:?}");
    }
}

/// Whatever ends a render, the samples that it took are the first ones, but for what was being worked on.
#[test]
fn time_and_error_take_the_same_samples() {
    let scene = prepared(&sized(shipped("oren-nayar.pbrt"), 32, 32));
    let render = Render::default().render(&scene).error(4e-3);
    let (tree, film) = (scene.tree(EngineKind::Wavefront), render.film().unwrap());
    let mut session = render.session(&tree, &film).unwrap();
    session.run_to_error(4e-3, None, |_| ());
    let rays = session.stats().camera_rays;
    let [spp, most] = film.sample_range();
    assert_eq!((spp, rays), (most, u64::from(spp) * 1024));
    for block in 0..film.blocks().len() {
        for replicate in 0..replicates::REPLICATES {
            let held = film.held(block, replicate);
            let expected = replicates::samples_of(replicate, spp);
            let expected = (expected > 0).then_some(0..expected);
            assert_eq!(held, expected.into_iter().collect::<Vec<_>>());
        }
    }
}

/// A film is filled with what it is of, or not at all.
#[test]
fn a_film_of_something_else_is_refused() {
    let scene = prepared(&sized(shipped("two-spheres.pbrt"), 16, 16));
    let tree = scene.tree(EngineKind::Wavefront);
    let film = Render { seed: 1, ..Render::default() }.render(&scene).film().unwrap();
    for (render, why) in [
        (Render { seed: 2, ..Render::default() }.render(&scene), "do not belong together"),
        (Render { sampler: SAMPLERS[1], ..Render::default() }.render(&scene), "do not belong together"),
        (Render::default().render(&scene).channels(ChannelSet::all()), "made for other channels"),
    ] {
        let error = render.session(&tree, &film).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
}

/// The depths that the film of a render holds, and its picture.
fn depths(render: &Render, description: &SceneDescription) -> (Vec<f32>, Vec<[f32; 3]>) {
    let scene = prepared(description);
    let render = render.render(&scene).channels(ChannelSet::default().with(Channel::Depth));
    let picture = render.run().unwrap();
    let film = picture.film();
    let [plane] = &film.develop_channel(film.number_of(Channel::Depth).unwrap())[..] else { panic!() };
    let [channel] = &picture.image().channels[..] else { panic!() };
    assert_eq!(channel.name, "depth.Z");
    assert_eq!(channel.samples, wavepath::picture::Samples::Float(plane.clone()));
    (plane.clone(), picture.image().pixels.clone())
}

/// Both engines have the same depths, to the bit, with any pool, through lenses and filters; and the picture is what it is
/// without.
#[test]
fn engines_agree_on_depth() {
    for description in
        [lobed(), sized(shipped("depth-of-field.pbrt"), 33, 20), sized(shipped("sky-only.pbrt"), 9, 9)]
    {
        let base = Render { spp: Some(9), ..Render::default() };
        let plain = base.of(&description);
        let (expected, pixels) = depths(&base, &description);
        assert_eq!(pixels, plain.developed.pixels);
        for (engine, batch, threads) in [
            (EngineKind::Megakernel, 4096, 1),
            (EngineKind::MegakernelWide, 4096, 2),
            (EngineKind::Wavefront, 333, 3),
        ] {
            let (found, pixels) = depths(&Render { engine, batch, threads, ..base.clone() }, &description);
            assert!(found.iter().map(|z| z.to_bits()).eq(expected.iter().map(|z| z.to_bits())), "{engine:?}");
            assert_eq!(pixels, plain.developed.pixels);
        }
    }
}

const CAMERA: &str = r#"
    LookAt 1 2 -3  1 2 0  0 1 0
    Camera "perspective" "float fov" 40
    Film "rgb" "integer xresolution" 31 "integer yresolution" 21
    PixelFilter "box"
    WorldBegin
    LightSource "infinite"
"#;

/// Along the viewing axis, not along the ray: of a plane that faces the camera, all depths are the same.
#[test]
fn depth_of_a_plane_is_its_distance() {
    let wall = "Translate 0 0 4 Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \
        \"point3 P\" [ -90 -90 0  -90 90 0  90 90 0  90 -90 0 ]";
    for lens in ["", "\"float lensradius\" .3 \"float focaldistance\" 5"] {
        let text = CAMERA.replace("\"float fov\" 40", &format!("\"float fov\" 40 {lens}")) + wall;
        for z in depths(&Render::default(), &scene(&text)).0 {
            assert!((z - 7.0).abs() < 2e-6 * 7.0, "{z}");
        }
    }
    // A floor below: z = height f / y of the raster, f the distance of the plane whose pixels are 1.
    let floor = "Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \
        \"point3 P\" [ -9e4 1 -9e4  -9e4 1 9e4  9e4 1 9e4  9e4 1 -9e4 ]";
    let (found, _) =
        depths(&Render { spp: Some(1024), ..Render::default() }, &scene(&(CAMERA.to_string() + floor)));
    let focal = 10.5 / 20f64.to_radians().tan();
    for row in 0..21 {
        // Mean of f / y over the pixel, below the horizon at 10.5.
        let (top, bottom) = (f64::from(row) - 10.5, f64::from(row) - 9.5);
        let z = f64::from(found[row as usize * 31 + 13]);
        match row {
            // Nothing is above the horizon.
            0..10 => assert_eq!(z, 0.0),
            12.. => {
                let expected = focal * (bottom / top).ln();
                assert!((z / expected - 1.0).abs() < 2e-3, "row {row}: {z}, not {expected}");
            }
            _ => assert!(z > 0.0),
        }
    }
}

/// Where a part of a pixel is covered, depth is that of what is hit; where nothing is, it is 0.
#[test]
fn depth_of_a_sphere() {
    let text = CAMERA.to_string() + "Translate 1 2 2 Shape \"sphere\" \"float radius\" 1";
    let (found, _) = depths(&Render { spp: Some(256), ..Render::default() }, &scene(&text));
    let (distance, focal) = (5.0, 10.5 / 20f64.to_radians().tan());
    // The nearer root of |s d - distance e|^2 = 1, for d with z = 1.
    let depth = |x: f64, y: f64| {
        let (x, y) = ((x - 15.5) / focal, (y - 10.5) / focal);
        let length2 = x * x + y * y + 1.0;
        let discriminant = distance * distance - length2 * (distance * distance - 1.0);
        (discriminant > 0.0).then(|| (distance - discriminant.sqrt()) / length2)
    };
    let mut kinds = [0; 3];
    for (place, &z) in found.iter().enumerate() {
        let (column, row) = ((place % 31) as f64, (place / 31) as f64);
        let n = 200;
        let at = |k: usize| (k as f64 + 0.5) / n as f64;
        let all = || (0..n * n).map(|k| depth(column + at(k % n), row + at(k / n)));
        let hits = all().flatten().count();
        let mean = all().flatten().sum::<f64>() / hits.max(1) as f64;
        match hits {
            0 => {
                kinds[0] += 1;
                assert_eq!(z, 0.0, "({column}, {row})");
            }
            _ if hits == n * n => {
                kinds[1] += 1;
                assert!((f64::from(z) / mean - 1.0).abs() < 2e-3, "({column}, {row}): {z}, not {mean}");
            }
            // So little that samples may miss it.
            _ if hits < n * n / 20 => {}
            _ => {
                kinds[2] += 1;
                assert!((f64::from(z) / mean - 1.0).abs() < 2e-2, "({column}, {row}): {z}, not {mean}");
            }
        }
    }
    assert!(kinds.iter().all(|count| *count > 10), "{kinds:?}");
}

/// A room of diffuse walls, a ball of glass and a lamp of some radiance.
fn room(radiance: f32, size: f64) -> SceneDescription {
    let text = format!(
        "LookAt 0 1 -3  0 1 0  0 1 0\nCamera \"perspective\" \"float fov\" 50\n\
         Film \"rgb\" \"integer xresolution\" 24 \"integer yresolution\" 18\nPixelFilter \"box\"\n\
         Integrator \"path\" \"integer maxdepth\" 6\nScale {size} {size} {size}\nWorldBegin\n\
         AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [ {radiance:e} {radiance:e} {radiance:e} ]\n\
         Translate 0 2 1 Shape \"sphere\" \"float radius\" .2 AttributeEnd\n\
         Material \"diffuse\" \"rgb reflectance\" [ .5 .6 .7 ]\n\
         Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \"point3 P\" [ -4 0 -4  -4 0 4  4 0 4  4 0 -4 ]\n\
         Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \"point3 P\" [ -4 0 3  -4 4 3  4 4 3  4 0 3 ]\n\
         Material \"dielectric\" Translate .5 .5 0 Shape \"sphere\" \"float radius\" .5\n"
    );
    scene(&text)
}

/// Emission from 1e-30 to 1e30: the picture of a lamp that is brighter by a power of two is brighter by that.
#[test]
fn light_of_any_size_counts() {
    let render = Render { spp: Some(32), ..Render::default() };
    let plain = render.of(&room(4.0, 1.0)).developed;
    assert_eq!(plain.invalid, 0);
    for exponent in [-102, -64, -20, 20, 64, 96] {
        let factor = f64::from(exponent).exp2();
        let scaled = render.of(&room((4.0 * factor) as f32, 1.0)).developed;
        assert_eq!(scaled.invalid, 0);
        for (found, plain) in scaled.pixels.iter().flatten().zip(plain.pixels.iter().flatten()) {
            let (found, expected) = (f64::from(*found), f64::from(*plain) * factor);
            assert!((found - expected).abs() <= 1e-5 * expected, "2^{exponent}: {found}, not {expected}");
        }
    }
}

/// A lamp with an intensity, as far away as the sun or a micrometre: of a floor that reflects half, lit from above, the
/// radiance is 0.5 / pi I / d^2.
#[test]
fn intensities_of_any_size_count() {
    for (distance, size) in [(1.5e11, 1.0), (1.0, 1e-2), (1e-6, 1e-8), (3e-9, 1e-10)] {
        let intensity = 0.5 * distance * distance * std::f64::consts::PI;
        let text = format!(
            "LookAt 0 {size:e} 0  0 0 0  0 0 1\nCamera \"perspective\" \"float fov\" 40\n\
             Film \"rgb\" \"integer xresolution\" 4 \"integer yresolution\" 4\nPixelFilter \"box\"\nWorldBegin\n\
             LightSource \"point\" \"rgb I\" [ {i:e} {i:e} {i:e} ] \"point3 from\" [ 0 {distance:e} 0 ]\n\
             Material \"diffuse\" \"rgb reflectance\" [ .5 .5 .5 ] Scale {s:e} {s:e} {s:e}\n\
             Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \"point3 P\" [ -1 0 -1  -1 0 1  1 0 1  1 0 -1 ]",
            i = intensity,
            s = 10.0 * size,
        );
        let developed = Render { spp: Some(16), ..Render::default() }.of(&scene(&text)).developed;
        assert_eq!(developed.invalid, 0);
        for value in developed.pixels.iter().flatten() {
            assert!((value / 0.25 - 1.0).abs() < 2e-2, "at {distance}: {value}");
        }
    }
}
