//! The engines against each other and against themselves: one definition of a path, so the same bits whatever
//! executes it, and the same counts.

mod support;

use std::sync::atomic::Ordering;
use std::time::Duration;

use support::{ENGINES, Render, Rendered, SAMPLERS, scene, shipped, sized};
use wavepath::compare::compare;
use wavepath::engine::EngineKind;
use wavepath::engine::stats::Stage;
use wavepath::scene::{Filter, SamplerKind, SceneDescription};
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

/// Camera and film: 24 x 17 pixels, so that no block of 16 is whole at the border.
const VIEW: &str = r#"
    LookAt 0 2 -9  0 1 0  0 1 0
    Camera "perspective" "float fov" 38
    Integrator "path" "integer maxdepth" 8
    Film "rgb" "integer xresolution" 24 "integer yresolution" 17
    PixelFilter "box"
    WorldBegin
"#;

const FLOOR: &str = r#"
    Material "diffuse" "rgb reflectance" [ .6 .5 .4 ]
    Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 ] "point3 P" [ -6 0 -6  -6 0 6  6 0 6  6 0 -6 ]
"#;

/// A row of balls, each of another material.
const BALLS: &str = r#"
    AttributeBegin Material "diffuse" "rgb reflectance" [ .2 .4 .8 ] "float sigma" 30
        Translate -3 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "conductor" "float roughness" 0
        Translate -1.8 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "conductor" "float roughness" .2
        Translate -.6 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "dielectric" "float eta" 1.5
        Translate .6 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "thindielectric" "float eta" 1.5
        Translate 1.8 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "diffuse" "rgb reflectance" [ 0 0 0 ]
        Translate 3 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "diffuse" Translate 0 .3 -2 Scale .5 .3 .4 Shape "sphere" AttributeEnd
    AttributeBegin Material "diffuse" Translate 1.5 .3 -2
        Shape "sphere" "float radius" .4 "float zmin" -.2 "float zmax" .3 "float phimax" 250 AttributeEnd
    AttributeBegin Material "conductor" "float roughness" .01 "bool remaproughness" false
        Translate -1.5 .6 -2 Rotate 30 1 0 0 Shape "disk" "float radius" .5 "float innerradius" .2 AttributeEnd
    AttributeBegin Material "diffusetransmission" "rgb reflectance" [ .2 .5 .3 ] "rgb transmittance" [ .6 .2 .3 ]
        Translate 0 1.2 -1 Shape "sphere" "float radius" .3 AttributeEnd
    MakeNamedMaterial "clay" "string type" "diffuse" "rgb reflectance" [ .8 .3 .2 ]
    MakeNamedMaterial "steel" "string type" "conductor" "float roughness" .1
    MakeNamedMaterial "glass" "string type" "dielectric"
    MakeNamedMaterial "both" "string type" "mix" "string materials" [ "clay" "steel" ] "float amount" .3
    AttributeBegin NamedMaterial "both" Translate -3 1.5 0 Shape "sphere" "float radius" .3 AttributeEnd
    AttributeBegin Material "mix" "string materials" [ "both" "glass" ] "float amount" .6
        AreaLightSource "diffuse" "rgb L" [ .1 .2 .3 ]
        Translate -2 1.5 0 Shape "sphere" "float radius" .3 AttributeEnd
    AttributeBegin Material "dielectric" "float roughness" .1
        Translate -1 1.5 0 Shape "sphere" "float radius" .3 AttributeEnd
    AttributeBegin Material "coateddiffuse" "rgb reflectance" [ .2 .6 .3 ]
        Translate 1 1.5 0 Shape "sphere" "float radius" .3 AttributeEnd
    AttributeBegin Material "coateddiffuse" "rgb reflectance" [ .2 .3 .7 ] "float roughness" .2
        Translate 2 1.5 0 Shape "sphere" "float radius" .3 AttributeEnd
    AttributeBegin Material "dielectric" Translate 3 1.5 1 Scale .3 .3 .3
        Shape "plymesh" "string filename" "meshes/block.ply" AttributeEnd
"#;

/// Textures of every kind for parameters of several materials, relief and what is not everywhere there.
const TEXTURED: &str = r#"
    Texture "checks" "spectrum" "checkerboard" "float uscale" 6 "float vscale" 6 "rgb tex1" [ .1 .2 .3 ]
    Texture "solid" "spectrum" "checkerboard" "integer dimension" 3 "texture tex1" "checks" "rgb tex2" [ .9 .5 .1 ]
    Texture "noise" "float" "fbm" Texture "wrinkles" "float" "wrinkled" Texture "wind" "float" "windy"
    Texture "veins" "spectrum" "marble" "float scale" 3
    Texture "dots" "float" "dots" "float uscale" 8 "float vscale" 8
    Texture "ramp" "spectrum" "bilerp" "string mapping" "spherical" "rgb v00" [ .8 .1 .1 ]
    Texture "low" "float" "scale" "texture tex" "noise" "float scale" .1
    Texture "mixed" "spectrum" "mix" "texture tex1" "veins" "texture tex2" "solid" "texture amount" "wrinkles"
    Texture "turned" "spectrum" "directionmix" "texture tex1" "mixed" "texture tex2" "ramp"
    Texture "degrees" "float" "scale" "texture tex" "wind" "float scale" 60
    Material "diffuse" "texture reflectance" "solid" "texture sigma" "degrees"
    Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 ] "point3 P" [ -6 0 -6  -6 0 6  6 0 6  6 0 -6 ]
    Material "diffuse" "texture reflectance" "turned" "texture displacement" "low"
    AttributeBegin Translate -3 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Translate -1 .5 0 Shape "cylinder" "float radius" .4 AttributeEnd
    Material "diffusetransmission" "texture reflectance" "checks" "texture transmittance" "ramp"
    AttributeBegin Translate 1 .5 0 Shape "sphere" "float radius" .5 "texture alpha" "dots" AttributeEnd
    AttributeBegin Translate 3 .5 0 Rotate 90 1 0 0 Shape "disk" "float radius" .7 "float alpha" .5 AttributeEnd
"#;

/// What only version 3 has.
const BALLS_V3: &str = r#"
    MakeNamedMaterial "clay" "string type" "matte" "rgb Kd" [ .8 .3 .2 ] "float sigma" 20
    MakeNamedMaterial "silver" "string type" "mirror"
    AttributeBegin Material "mix" "string namedmaterial1" "clay" "string namedmaterial2" "silver" "rgb amount" [ .2 .5 .9 ]
        Translate -2 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "plastic" "rgb Kd" [ .1 .2 .6 ] Translate -1 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "substrate" "rgb Kd" [ .1 .6 .2 ] Translate 0 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "uber" "rgb Kd" [ .3 .1 .1 ] "rgb Kr" [ .2 .2 .2 ] "rgb Kt" [ .2 .3 .4 ] "rgb opacity" [ .5 .7 .9 ]
        Translate 1 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "translucent" "rgb Kd" [ .5 .4 .3 ] "float roughness" .3
        Translate 2 .5 0 Shape "sphere" "float radius" .5 AttributeEnd
    AttributeBegin Material "glass" "float uroughness" .2 "float vroughness" .2 "rgb Kt" [ .9 .8 .9 ]
        Translate 0 1.5 1 Shape "sphere" "float radius" .5 AttributeEnd
"#;

/// Every kind of light.
const LIGHTS: &str = r#"
    LightSource "infinite" "rgb L" [ .1 .12 .2 ]
    LightSource "distant" "rgb L" [ .5 .4 .3 ] "point3 from" [ 1 4 -2 ] "point3 to" [ 0 0 0 ]
    LightSource "point" "rgb I" [ 3 4 5 ] "point3 from" [ -4 3 -2 ]
    LightSource "spot" "rgb I" [ 20 20 15 ] "point3 from" [ 4 5 -3 ] "point3 to" [ 1 0 0 ] "float coneangle" 25
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 9 8 7 ]
        Translate 0 4 -1 Shape "sphere" "float radius" .4 AttributeEnd
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 5 2 2 ] "bool twosided" true
        Shape "trianglemesh" "integer indices" [ 0 1 2 ] "point3 P" [ -4 2 2  -3 3 2  -3 2 2.5 ] AttributeEnd
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 2 5 2 ]
        Translate 3 3 2 Rotate 120 1 0 0 Shape "disk" "float radius" .6 AttributeEnd
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 2 2 5 ]
        Translate -2 3 2 Scale 1 .5 .7 Shape "sphere" "float radius" .5 AttributeEnd
"#;

const LAMP: &str = r#"
    AttributeBegin Material "diffuse" "rgb reflectance" [ 0 0 0 ] AreaLightSource "diffuse" "rgb L" [ 20 18 15 ]
        Translate 0 4 -1 Shape "sphere" "float radius" .4 AttributeEnd
"#;

/// Everything that there is.
fn everything() -> SceneDescription {
    scene(&format!("{VIEW}{LIGHTS}{FLOOR}{BALLS}"))
}

/// Scenes that differ in what the plan leaves out.
fn all_scenes() -> Vec<(&'static str, SceneDescription)> {
    let sky = "LightSource \"infinite\" \"rgb L\" [ 1 .9 .8 ]";
    let texts = [
        ("everything", format!("{VIEW}{LIGHTS}{FLOOR}{BALLS}")),
        ("spherical lamp, transmission", format!("{VIEW}{LAMP}{FLOOR}{BALLS}")),
        ("spherical lamp, nothing transmits", format!("{VIEW}{LAMP}{FLOOR}")),
        ("lights, nothing transmits", format!("{VIEW}{LIGHTS}{FLOOR}")),
        ("materials of version 3", format!("{VIEW}{LAMP}{FLOOR}{BALLS_V3}")),
        ("sky only", format!("{VIEW}{sky}{FLOOR}{BALLS}")),
        ("no lights", format!("{VIEW}{FLOOR}{BALLS}")),
        ("no primitives", format!("{VIEW}{sky}")),
        ("nothing at all", VIEW.to_string()),
        ("no triangles", format!("{VIEW}{LAMP}Material \"diffuse\" Shape \"sphere\"")),
        ("lamp alone", format!("{VIEW}{LAMP}")),
        ("textures", format!("{VIEW}{LIGHTS}{TEXTURED}")),
        ("textures, sky only", format!("{VIEW}{sky}{TEXTURED}")),
    ];
    let mut scenes: Vec<_> = texts.iter().map(|(name, text)| (*name, scene(text))).collect();
    for name in [
        "cornell.pbrt",
        "inside-emitter.pbrt",
        "wineglass.pbrt",
        "many-lights.pbrt",
        "metals.pbrt",
        "glass-pane.pbrt",
    ] {
        scenes.push((name, sized(shipped(name), 20, 14)));
    }
    for max_depth in [0, 1, 2] {
        scenes.push(("few bounces", SceneDescription { max_depth, ..everything() }));
    }
    let mitchell = Filter::Mitchell { radius: [2.0; 2], b: 1.0 / 3.0, c: 1.0 / 3.0 };
    scenes.push(("Mitchell filter", SceneDescription { filter: mitchell, ..everything() }));
    scenes.push(("Gaussian filter", SceneDescription { filter: Filter::default(), ..everything() }));
    let mut blurred = everything();
    (blurred.camera.lens_radius, blurred.camera.focal_distance) = (0.3, 8.0);
    scenes.push(("depth of field", blurred));
    scenes
}

/// Levels whose kernels fuse multiplications and additions: they round alike. The first one is the one to hold the
/// others against.
fn fused_levels() -> Vec<Level> {
    Level::available().filter(|&level| level != Level::BASELINE).collect()
}

fn assert_consistent(what: &str, rendered: &Rendered) {
    assert_eq!(rendered.developed.invalid, 0, "{what}: invalid samples");
    assert_eq!(rendered.stats.camera_rays, rendered.developed.samples, "{what}: a camera ray a sample");
}

fn assert_same(what: &str, a: &Rendered, b: &Rendered) {
    let differing = a.bits().iter().zip(b.bits()).filter(|(a, b)| **a != *b).count();
    assert_eq!(differing, 0, "{what}: {differing} of {} pixels differ", a.pixels);
    assert_eq!(a.rays(), b.rays(), "{what}: rays");
    assert_eq!(a.developed.relmse, b.developed.relmse, "{what}: estimated error");
}

/// All engines, all scenes, both samplers. Without FMA the one-lane and the wide kernels are compiled to the same
/// separate roundings, so the baseline agrees with itself as well.
#[test]
fn engines_give_the_same_bits() {
    for (name, scene) in all_scenes() {
        for sampler in SAMPLERS {
            for level in Level::available() {
                let what = format!("{name}, {sampler:?}, {level:?}");
                let render = |engine| Render { engine, sampler, level, spp: Some(6), ..Render::default() };
                let wavefront = render(EngineKind::Wavefront).of(&scene);
                assert_consistent(&what, &wavefront);
                for engine in [EngineKind::Megakernel, EngineKind::MegakernelWide] {
                    let megakernel = render(engine).of(&scene);
                    assert_consistent(&what, &megakernel);
                    assert_same(&what, &wavefront, &megakernel);
                }
            }
        }
    }
}

#[test]
fn instruction_sets_with_fused_arithmetic_give_the_same_bits() {
    for (name, scene) in all_scenes() {
        for engine in ENGINES {
            let images: Vec<_> = fused_levels()
                .into_iter()
                .map(|level| Render { level, engine, spp: Some(4), ..Render::default() }.of(&scene))
                .collect();
            for pair in images.windows(2) {
                assert_same(&format!("{name}, {engine:?}"), &pair[0], &pair[1]);
            }
        }
    }
}

/// The baseline rounds differently, so that now and then a path takes another branch and the two images are as
/// different there as two independent ones. Independent renders would differ by twice the estimated relMSE; ones that
/// share nearly all their paths differ by less. A bias would show in the means, whose standard error is about
/// sqrt(2 relMSE / pixels) if pixels err independently: five of those are allowed.
#[test]
fn the_baseline_agrees_within_the_noise() {
    let Some(&level) = fused_levels().first() else { return };
    for (name, scene) in [("everything", everything()), ("cornell", sized(shipped("cornell.pbrt"), 32, 32))] {
        let render = |level| Render { level, spp: Some(64), ..Render::default() }.of(&scene);
        let (fused, baseline) = (render(level), render(Level::BASELINE));
        let comparison = compare(&baseline.image, &fused.image).unwrap();
        let noise = fused.developed.relmse.unwrap();
        assert!(comparison.relmse < 2.0 * noise, "{name}: {} at a noise of {noise}", comparison.relmse);
        let tolerance = 5.0 * (2.0 * noise / fused.pixels as f64).sqrt();
        for ratio in comparison.mean_ratio {
            assert!((ratio - 1.0).abs() < tolerance, "{name}: mean ratio {ratio}, tolerance {tolerance}");
        }
    }
}

#[test]
fn threads_and_batches_change_no_bit() {
    let scene = everything();
    for sampler in SAMPLERS {
        // 7 samples and 2 replicates: not divisible.
        let base = Render { sampler, spp: Some(7), ..Render::default() };
        let expected = Render { threads: 1, ..base.clone() }.of(&scene);
        assert_eq!(expected.developed.samples, 7 * 24 * 17);
        for threads in [1, 2, 3, 5] {
            for batch in [64, 500, 4096, 100_000] {
                let rendered = Render { threads, batch, ..base.clone() }.of(&scene);
                assert_same(&format!("{threads} threads, batch {batch}"), &rendered, &expected);
            }
            for policy in
                [Policy::Single, Policy::Mixed, Policy::Packets, Policy::Sorted, Policy::Interleaved]
            {
                let rendered = Render { threads, policy, ..base.clone() }.of(&scene);
                assert_same(&format!("{policy:?}, {threads} threads"), &rendered, &expected);
            }
            let engine = EngineKind::Megakernel;
            let rendered = Render { threads, engine, ..base.clone() }.of(&scene);
            assert_same(&format!("megakernel, {threads} threads"), &rendered, &expected);
        }
    }
}

/// 1 to 33 samples over 1, 2 and 4 replicates: every pixel gets exactly as many as asked for.
#[test]
fn samples_need_not_divide_among_the_replicates() {
    let scene = sized(everything(), 9, 5);
    for spp in [1, 3, 5, 31, 33, 67] {
        let [a, b] = ENGINES.map(|engine| Render { engine, spp: Some(spp), ..Render::default() }.of(&scene));
        assert_eq!(a.developed.samples, spp as u64 * 45);
        assert_same(&format!("{spp} spp"), &a, &b);
    }
}

#[test]
fn a_crop_is_cut_out_of_the_whole() {
    let full = sized(everything(), 50, 37);
    for engine in ENGINES {
        let render = Render { engine, spp: Some(5), ..Render::default() };
        let whole = render.of(&full);
        for bounds in [[0, 50, 0, 37], [16, 32, 16, 32], [3, 4, 5, 6], [7, 41, 11, 37], [49, 50, 36, 37]] {
            let mut cropped = full.clone();
            cropped.film.pixel_bounds = bounds;
            let part = render.of(&cropped);
            let [x0, x1, y0, y1] = bounds;
            let cut = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
            let cut: Vec<_> = cut.map(|(x, y)| whole.image.pixel(x, y).map(f32::to_bits)).collect();
            assert_eq!(part.bits(), cut, "{bounds:?}");
        }
    }
}

#[test]
fn any_size_of_image() {
    for (width, height) in [(1, 1), (17, 33), (1, 40), (16, 16), (33, 2)] {
        let scene = sized(everything(), width, height);
        let [a, b] =
            ENGINES.map(|engine| Render { engine, threads: 3, spp: Some(9), ..Render::default() }.of(&scene));
        let what = format!("{width} x {height}");
        assert_consistent(&what, &a);
        assert_same(&what, &a, &b);
        assert_eq!(a.developed.samples, 9 * (width * height) as u64, "{what}");
        assert_eq!(a.developed.pixels.len(), (width * height) as usize, "{what}");
    }
}

/// Inside a sphere that emits 0.5 and reflects half, `maxdepth` n gives 1 - 0.5^(n + 1) in every pixel.
#[test]
fn the_depth_limit_counts_scattering_vertices() {
    let mut scene = scene(
        r#"
        Camera "perspective"
        Film "rgb" "integer xresolution" 20 "integer yresolution" 20
        WorldBegin
        Material "diffuse" "rgb reflectance" [ .5 .5 .5 ]
        AreaLightSource "diffuse" "rgb L" [ .5 .5 .5 ]
        ReverseOrientation
        Shape "sphere"
        "#,
    );
    for max_depth in [0, 1, 2, 5] {
        scene.max_depth = max_depth;
        for engine in ENGINES {
            let rendered = Render { engine, spp: Some(64), ..Render::default() }.of(&scene);
            assert_consistent("closed sphere", &rendered);
            let want = 1.0 - 0.5f64.powi(max_depth as i32 + 1);
            // The roulette may end paths of the deeper ones: a little noise.
            let tolerance = if max_depth < 3 { 1e-5 } else { 3e-3 };
            for mean in rendered.mean() {
                assert!((mean - want).abs() < tolerance, "maxdepth {max_depth}: {mean}, not {want}");
            }
            assert_eq!(rendered.stats.bounce_rays == 0, max_depth == 0);
        }
    }
}

/// A mirror inside of a sphere that emits 1 shows itself in itself: `maxdepth` + 1, however deep.
#[test]
fn thousands_of_bounces_are_counted() {
    let scene = scene(
        r#"
        LookAt .1 .2 .1  .4 .3 .8  0 1 0
        Camera "perspective"
        Integrator "path" "integer maxdepth" 12000
        Film "rgb" "integer xresolution" 4 "integer yresolution" 3
        WorldBegin
        Material "conductor" "rgb eta" [ 1 1 1 ] "rgb k" [ 1e6 1e6 1e6 ]
        AreaLightSource "diffuse" "rgb L" [ 1 1 1 ]
        ReverseOrientation
        Shape "sphere"
        "#,
    );
    let [a, b] = ENGINES.map(|engine| Render { engine, spp: Some(4), ..Render::default() }.of(&scene));
    assert_same("mirror sphere", &a, &b);
    assert_consistent("mirror sphere", &a);
    for mean in a.mean() {
        assert!((mean / 12_001.0 - 1.0).abs() < 1e-4, "{mean}");
    }
}

/// A flat sheet under a sky of radiance 1 reflects its share of it and lets its share pass: the sum, from both sides,
/// however light is found; and lit from behind by a lamp it shows what passes alone.
#[test]
fn a_sheet_reflects_and_transmits() {
    let sheet = |from_z: f64, light: &str| {
        scene(&format!(
            r#"
            LookAt 0 0 {from_z}  0 0 0  0 1 0
            Camera "perspective" "float fov" 10
            Integrator "path" "integer maxdepth" 1
            Film "rgb" "integer xresolution" 8 "integer yresolution" 8
            WorldBegin
            {light}
            Material "diffusetransmission" "rgb reflectance" [ .2 .5 .3 ] "rgb transmittance" [ .6 .2 .3 ]
            Shape "disk" "float radius" 5
            "#
        ))
    };
    let sky = r#"LightSource "infinite" "rgb L" [ 1 1 1 ]"#;
    // At 60 degrees, so that the irradiance is pi.
    let lamp = r#"LightSource "distant" "rgb L" [ 2 2 2 ] "float scale" 3.14159265
        "point3 from" [ 0 1.7320508 1 ] "point3 to" [ 0 0 0 ]"#;
    for (from_z, light, want) in [
        (4.0, sky, [0.8, 0.7, 0.6]),
        (-4.0, sky, [0.8, 0.7, 0.6]),
        (4.0, lamp, [0.2, 0.5, 0.3]),
        (-4.0, lamp, [0.6, 0.2, 0.3]),
    ] {
        let scene = sheet(from_z, light);
        let [a, b] = ENGINES.map(|engine| Render { engine, spp: Some(256), ..Render::default() }.of(&scene));
        assert_same("sheet", &a, &b);
        assert_consistent("sheet", &a);
        for (mean, want) in a.mean().into_iter().zip(want) {
            assert!((mean - want).abs() < 4e-3, "{light} from z {from_z}: {mean}, not {want}");
        }
    }
}

/// A sky of radiance 1 and nothing else: 1 in every pixel, whatever the filter and its negative lobes.
#[test]
fn an_empty_scene_shows_its_sky() {
    let empty = scene(&format!("{VIEW}LightSource \"infinite\" \"rgb L\" [ 1 2 .5 ]"));
    let mitchell = Filter::Mitchell { radius: [2.0; 2], b: 1.0 / 3.0, c: 1.0 / 3.0 };
    for filter in [Filter::Box { radius: [0.5; 2] }, Filter::default(), mitchell] {
        let scene = SceneDescription { filter, ..empty.clone() };
        for engine in ENGINES {
            let rendered = Render { engine, spp: Some(64), ..Render::default() }.of(&scene);
            assert_eq!(rendered.developed.relmse, Some(0.0));
            assert!(rendered.developed.pixels.iter().all(|&pixel| pixel == [1.0, 2.0, 0.5]), "{filter:?}");
            assert_eq!(rendered.rays(), [64 * 24 * 17, 0, 0]);
        }
    }
    let dark = Render::default().of(&scene(VIEW));
    assert!(dark.developed.pixels.iter().all(|&pixel| pixel == [0.0; 3]));
}

/// A long render that is interrupted: what was begun is complete, and the image is right.
#[test]
fn an_interrupted_render_is_consistent() {
    for engine in ENGINES {
        let time = Some(Duration::from_secs(600));
        let render = Render { engine, spp: None, time, batch: 1000, ..Render::default() };
        let rendered = render.watched(&everything(), |done, interrupted| {
            interrupted.store(done.samples.load(Ordering::Relaxed) > 20_000, Ordering::Relaxed);
        });
        assert_consistent("interrupted", &rendered);
        assert!(rendered.developed.samples > 20_000);
    }
}

#[test]
fn a_time_limit_gives_every_pixel_a_sample() {
    let sky = scene(&format!("{VIEW}LightSource \"infinite\" \"rgb L\" [ 1 1 1 ]"));
    for engine in ENGINES {
        for (limit, spp) in [(0, None), (30, None), (1, Some(1_000_000)), (100_000, Some(19))] {
            let time = Some(Duration::from_millis(limit));
            let render = Render { engine, spp, time, ..Render::default() };
            let what = format!("{engine:?}, {limit} ms, {spp:?} spp");
            let rendered = render.of(&sky);
            assert_consistent(&what, &rendered);
            assert!(rendered.developed.samples >= rendered.pixels, "{what}");
            assert!(rendered.developed.pixels.iter().all(|&pixel| pixel == [1.0; 3]), "{what}");
            assert_consistent(&what, &render.of(&everything()));
        }
    }
    // The order of work differs with a time limit; the samples do not.
    let scene = everything();
    let limited = Render { spp: Some(19), time: Some(Duration::from_secs(1000)), ..Render::default() };
    assert_same("in time", &limited.of(&scene), &Render { spp: Some(19), ..Render::default() }.of(&scene));
}

/// Stages are measured without gaps and by each worker on its own, so that together they cannot exceed what the
/// workers had; the slack is for clocks.
#[test]
fn stages_add_up() {
    let scene = sized(scene(&format!("{VIEW}{LIGHTS}{FLOOR}{BALLS}{TEXTURED}")), 64, 48);
    for engine in ENGINES {
        for threads in [1, 2] {
            let rendered = Render { engine, threads, spp: Some(32), ..Render::default() }.of(&scene);
            let stages = rendered.stats.stages.map(|stage| stage.as_secs_f64());
            let (sum, available) = (stages.iter().sum::<f64>(), threads as f64 * rendered.seconds);
            assert!(sum > 0.0 && sum <= 1.05 * available + 0.01, "{sum} s in stages, {available} s in all");
            for stage in Stage::ALL {
                let of_megakernel = stage == Stage::Megakernel;
                let used = of_megakernel == (engine == EngineKind::Megakernel);
                assert_eq!(stages[stage as usize] > 0.0, used, "{engine:?}: {}", stage.name());
            }
        }
    }
}

/// Another seed is another image, and another sampler as well.
#[test]
fn seeds_and_samplers_matter() {
    let scene = everything();
    let base = Render::default().of(&scene).bits();
    assert_ne!(base, Render { seed: 2, ..Render::default() }.of(&scene).bits());
    assert_ne!(base, Render { seed: 1 << 40 | 1, ..Render::default() }.of(&scene).bits());
    let sampler = SamplerKind::Independent;
    assert_ne!(base, Render { sampler, ..Render::default() }.of(&scene).bits());
}
