//! Adaptive sampling: as bright as without it, the same on any machine, better where noise is uneven, off elsewhere.

mod support;

use std::time::Duration;

use support::{ENGINES, Render, Rendered, SAMPLERS, shipped, sized};
use wavepath::compare::compare;
use wavepath::engine::EngineKind;
use wavepath::scene::{Filter, SamplerKind, SceneDescription};

/// Noise in a part of the picture only.
fn uneven() -> SceneDescription {
    sized(shipped("glass-pane.pbrt"), 128, 128)
}

fn adaptive() -> Render {
    Render { adaptive: true, spp: Some(64), ..Render::default() }
}

fn is_uneven(rendered: &Rendered) -> bool {
    rendered.sample_range[0] < rendered.sample_range[1]
}

/// Brightness of adaptive renders over that of plain ones, less 1: mean over seeds and its standard error, by channel. The
/// differences are taken in pairs, as the first samples are the same. And how many of them were uneven.
fn brightness(
    scene: &SceneDescription,
    samplers: &[SamplerKind],
    spp: u32,
    seeds: usize,
) -> ([(f64, f64); 3], usize) {
    let mut uneven = 0;
    let mut differences = [const { Vec::new() }; 3];
    for seed in 0..seeds {
        let sampler = samplers[seed % samplers.len()];
        let render = Render { seed: seed as u64, sampler, spp: Some(spp), ..adaptive() };
        let rendered = render.of(scene);
        uneven += is_uneven(&rendered) as usize;
        let (mean, plain) = (rendered.mean(), Render { adaptive: false, ..render }.of(scene).mean());
        for (channel, differences) in differences.iter_mut().enumerate() {
            differences.push(mean[channel] / plain[channel] - 1.0);
        }
    }
    let means = differences.map(|differences| {
        let n = seeds as f64;
        let mean = differences.iter().sum::<f64>() / n;
        let variance = differences.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (variance / n).sqrt())
    });
    (means, uneven)
}

/// The mean over seeds is that of plain renders within three standard errors of their difference; and those are small
/// enough to say something: a rule by which blocks decide on their own samples is too dark by 0.2 % in `caustics.pbrt`.
#[test]
fn the_picture_is_as_bright_as_without() {
    let (means, uneven) = brightness(&uneven(), &SAMPLERS, 64, 24);
    assert_eq!(uneven, 24);
    for (mean, error) in means {
        assert!(error < 1e-3 && mean.abs() < 3.0 * error, "{mean} +- {error}");
    }
}

/// The same of a scene whose light is in few paths.
#[test]
#[ignore = "prints a table, in a minute"]
fn brightness_of_caustics() {
    let scene = sized(shipped("caustics.pbrt"), 128, 128);
    for sampler in SAMPLERS {
        let (means, uneven) = brightness(&scene, &[sampler], 256, 20);
        for (mean, error) in means {
            println!("{sampler:?}, {uneven} uneven: {:.3} % +- {:.3} %", 100.0 * mean, 100.0 * error);
        }
    }
}

#[test]
fn threads_batches_and_engines_change_no_bit() {
    let scene = uneven();
    for sampler in SAMPLERS {
        let base = Render { sampler, ..adaptive() };
        let expected = Render { threads: 1, ..base.clone() }.of(&scene);
        assert!(is_uneven(&expected));
        for (threads, batch, engine) in [
            (2, 4096, EngineKind::Wavefront),
            (3, 500, EngineKind::Wavefront),
            (2, 4096, EngineKind::Megakernel),
        ] {
            let rendered = Render { threads, batch, engine, ..base.clone() }.of(&scene);
            assert_eq!(rendered.bits(), expected.bits(), "{threads} threads, batch {batch}, {engine:?}");
            assert_eq!(rendered.rays(), expected.rays());
            assert_eq!(rendered.developed.relmse, expected.developed.relmse);
        }
    }
}

/// Against a reference of 1024 samples: less error with the same samples, as the report says it is.
#[test]
fn error_is_smaller_where_noise_is_uneven() {
    let scene = uneven();
    let reference = Render { spp: Some(1024), seed: 99, ..Render::default() }.of(&scene);
    for sampler in SAMPLERS {
        let error = |render: Render| {
            let rendered = render.of(&scene);
            let own = reference.developed.relmse.unwrap();
            let truth = compare(&rendered.image, &reference.image).unwrap().relmse - own;
            let estimate = rendered.developed.relmse.unwrap() / truth;
            assert!((0.75..1.3).contains(&estimate), "estimated {estimate} of the true error");
            truth
        };
        let plain = error(Render { sampler, spp: Some(64), ..Render::default() });
        let gain = plain / error(Render { sampler, ..adaptive() });
        println!("{sampler:?}: {gain:.2}");
        assert!(gain > 1.2, "{sampler:?}: {gain}");
    }
}

/// Where it would not pay, or there is too little to decide on, nothing changes.
#[test]
fn even_noise_gives_the_same_bits() {
    let cornell = sized(shipped("cornell.pbrt"), 64, 64);
    for (scene, spp) in [(&cornell, 100), (&uneven(), 1), (&uneven(), 3), (&uneven(), 63)] {
        let render = Render { spp: Some(spp), ..adaptive() };
        let (rendered, plain) = (render.of(scene), Render { adaptive: false, ..render }.of(scene));
        assert_eq!(rendered.bits(), plain.bits());
        assert_eq!(rendered.developed.relmse, plain.developed.relmse);
    }
}

#[test]
fn the_budget_is_kept() {
    let mut cropped = uneven();
    cropped.film.pixel_bounds = [3, 117, 5, 122];
    let mitchell = Filter::Mitchell { radius: [2.0; 2], b: 1.0 / 3.0, c: 1.0 / 3.0 };
    let lobes = SceneDescription { filter: mitchell, ..uneven() };
    for (scene, spp) in [(uneven(), 64), (uneven(), 150), (cropped, 150), (lobes, 150)] {
        let rendered = Render { spp: Some(spp), ..adaptive() }.of(&scene);
        assert!(is_uneven(&rendered), "{spp} spp: {:?}", rendered.sample_range);
        let (samples, budget) = (rendered.developed.samples, u64::from(spp) * rendered.pixels);
        assert!(samples <= budget && samples + 256 > budget, "{samples} of {budget}");
        assert_eq!(rendered.stats.camera_rays, samples);
        assert!(rendered.developed.pixels.iter().flatten().all(|x| x.is_finite()));
    }
}

/// Any size, and an end at any moment.
#[test]
fn any_size_and_any_end() {
    for (width, height) in [(1, 1), (16, 16), (33, 2)] {
        let scene = sized(shipped("two-spheres.pbrt"), width, height);
        for engine in ENGINES {
            let rendered = Render { engine, ..adaptive() }.of(&scene);
            let budget = 64 * rendered.pixels;
            assert!(rendered.developed.samples <= budget && rendered.developed.samples + 256 > budget);
        }
    }
    let scene = uneven();
    for milliseconds in [0, 300] {
        let time = Some(Duration::from_millis(milliseconds));
        let render = Render { spp: None, time, sampler: SamplerKind::Independent, ..adaptive() };
        let rendered = render.of(&scene);
        assert!(rendered.sample_range[0] >= 1);
        assert_eq!(rendered.stats.camera_rays, rendered.developed.samples);
    }
}

/// The shipped scenes as a table: relMSE with as many samples, samples in as much processor time, and the product of
/// both, efficiency. Ratios of adaptive over plain renders, medians over seeds.
#[test]
#[ignore = "prints a table, in some minutes"]
fn table() {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    println!(
        "| scene | sampler | spp | used | equal samples | speed | efficiency |\n|---|---|---|---|---|---|---|"
    );
    for name in [
        "caustics",
        "wineglass",
        "glass-pane",
        "two-spheres",
        "oren-nayar",
        "depth-of-field",
        "many-lights",
        "spotlight",
        "metals",
        "cornell",
        "inside-emitter",
        "sky-only",
    ] {
        let scene = sized(shipped(&format!("{name}.pbrt")), 128, 128);
        let reference = Render { spp: Some(2048), seed: 777, ..Render::default() }.of(&scene);
        for sampler in SAMPLERS {
            for spp in [64, 256] {
                let measure = |adaptive, seed| {
                    let spp = Some(spp);
                    let rendered = Render { adaptive, seed, sampler, spp, ..Render::default() }.of(&scene);
                    let own = reference.developed.relmse.unwrap();
                    let error = compare(&rendered.image, &reference.image).unwrap().relmse - own;
                    (error, rendered.processor, is_uneven(&rendered))
                };
                let mut columns = [const { Vec::new() }; 3];
                let mut used = 0;
                for seed in 1..=5 {
                    // Neither is always the first.
                    let (plain, adaptive) = if seed % 2 == 0 {
                        let plain = measure(false, seed);
                        (plain, measure(true, seed))
                    } else {
                        let adaptive = measure(true, seed);
                        (measure(false, seed), adaptive)
                    };
                    let (error, speed) = (plain.0 / adaptive.0, plain.1 / adaptive.1);
                    used += u32::from(adaptive.2);
                    columns[0].push(error);
                    columns[1].push(speed);
                    columns[2].push(error * speed);
                }
                let [error, speed, efficiency] = columns.map(median);
                println!(
                    "| {name} | {sampler:?} | {spp} | {used} of 5 | {error:.2} | {speed:.2} | {efficiency:.2} |"
                );
            }
        }
    }
}
