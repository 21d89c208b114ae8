//! The error that a render states, against the error that it has.

mod support;

use support::{Render, Rendered, SAMPLERS, scenes, shipped, sized};
use wavepath::compare::compare;
use wavepath::engine::EngineKind;
use wavepath::engine::session::Ended;
use wavepath::film::Developed;
use wavepath::picture::{self, Image};
use wavepath::report::Report;
use wavepath::scene::{SamplerKind, Scene, SceneDescription};

/// A reference of the project's own, and its own error.
fn reference(name: &str) -> (Image, f64) {
    let image = picture::read(&scenes().join(format!("references/{name}.exr"))).unwrap();
    let report: Report = serde_json::from_str(image.metadata.report.as_deref().unwrap()).unwrap();
    (image, report.estimated_relmse.unwrap())
}

fn small(name: &str) -> SceneDescription {
    sized(shipped(&format!("{name}.pbrt")), 64, 64)
}

/// Estimated and true relMSE.
fn errors(rendered: &Rendered, reference: &(Image, f64)) -> (f64, f64) {
    let measured = compare(&rendered.image, &reference.0).unwrap().relmse;
    (rendered.developed.relmse.unwrap(), measured - reference.1)
}

/// Mean over some seeds of the estimated and of the true error, and the ratios of single renders.
fn mean_errors(
    scene: &SceneDescription,
    reference: &(Image, f64),
    (sampler, spp): (SamplerKind, u32),
    seeds: u64,
) -> (f64, f64, Vec<f64>) {
    let render = |seed| Render { sampler, spp: Some(spp), seed, ..Render::default() };
    let errors: Vec<(f64, f64)> = (0..seeds).map(|seed| errors(&render(seed).of(scene), reference)).collect();
    let mean = |of: fn(&(f64, f64)) -> f64| errors.iter().map(of).sum::<f64>() / seeds as f64;
    let ratios = errors.iter().map(|(estimated, truth)| estimated / truth).collect();
    (mean(|error| error.0), mean(|error| error.1), ratios)
}

/// In all scenes that ship with the project the estimate is the truth within 20 %, by the mean over some seeds.
#[test]
fn the_estimate_is_calibrated() {
    for name in CALIBRATED {
        let (scene, reference) = (small(name), reference(name));
        for sampler in SAMPLERS {
            // At 72 half of the replicates have just opened, and have an eighth of the samples of the others.
            for spp in [64, 72, 256] {
                let (estimated, truth, _) = mean_errors(&scene, &reference, (sampler, spp), 3);
                let ratio = estimated / truth;
                // A hundred lamps, few of which find a pixel at 64 spp: the figures of many seeds are in docs/error.md.
                let limits = if name == "many-lights" { 0.65..1.5 } else { 0.8..1.25 };
                assert!(limits.contains(&ratio), "{name}, {sampler:?}, {spp} spp: {estimated} / {truth}");
            }
        }
    }
}

/// The interval of each estimate is around it, and not wide where noise is spread over all pixels.
#[test]
fn the_interval_is_around_the_estimate() {
    for name in ["oren-nayar", "sky-only", "cornell", "inside-emitter"] {
        for sampler in SAMPLERS {
            let rendered = Render { sampler, spp: Some(64), ..Render::default() }.of(&small(name));
            let estimated = rendered.developed.relmse.unwrap();
            let [low, high] = rendered.developed.relmse_interval.unwrap();
            assert!(low < estimated && estimated < high && high < 1.5 * estimated, "{name}, {sampler:?}");
        }
    }
}

/// The interval covers the mean of the estimates of many seeds about as often as it says.
#[test]
fn the_interval_covers() {
    let scene = sized(shipped("oren-nayar.pbrt"), 32, 32);
    let estimates: Vec<Developed> = (0..40)
        .map(|seed| Render { spp: Some(32), seed, ..Render::default() }.of(&scene).developed)
        .collect();
    let mean = estimates.iter().map(|e| e.relmse.unwrap()).sum::<f64>() / estimates.len() as f64;
    let covers = |e: &&Developed| e.relmse_interval.is_some_and(|[low, high]| low <= mean && mean <= high);
    let covered = estimates.iter().filter(covers).count();
    // 95 % of 40 is 38; fewer than 33 would happen once in a thousand times.
    assert!(covered >= 33, "{covered} of 40");
}

/// All of the shipped scenes, as a table: means over seeds, and the ratios of single ones.
#[test]
#[ignore = "prints a table, in some minutes"]
fn table() {
    const SEEDS: u64 = 8;
    println!(
        "| scene | sampler | spp | estimated | true | ratio | of single renders |\n|---|---|---|---|---|---|---|"
    );
    for name in CALIBRATED {
        let (scene, reference) = (small(name), reference(name));
        for sampler in SAMPLERS {
            for spp in [20, 48, 64, 72, 96, 256, 1024] {
                let (estimated, truth, ratios) = mean_errors(&scene, &reference, (sampler, spp), SEEDS);
                let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
                let most = ratios.iter().copied().fold(0.0, f64::max);
                let ratio = estimated / truth;
                println!(
                    "| {name} | {} | {spp} | {estimated:.2e} | {truth:.2e} | {ratio:.2} | {least:.2} to {most:.2} |",
                    format!("{sampler:?}").to_lowercase()
                );
            }
        }
    }
}

/// The scenes that ship with the project.
const CALIBRATED: [&str; 12] = [
    "two-spheres",
    "oren-nayar",
    "inside-emitter",
    "sky-only",
    "cornell",
    "glass-pane",
    "depth-of-field",
    "metals",
    "spotlight",
    "many-lights",
    "wineglass",
    "caustics",
];

/// What a render to an error came to.
struct Stopped {
    ended: Ended,
    developed: Developed,
    image: Image,
    spp: f64,
}

fn to_error(scene: &SceneDescription, error: f64, spp: Option<u32>, threads: usize, seed: u64) -> Stopped {
    let built = Scene::new("test", scene.clone()).unwrap();
    let tree = built.tree(EngineKind::Wavefront);
    let mut render = wavepath::Render::new(&built).error(error).threads(threads).seed(seed);
    if let Some(spp) = spp {
        render = render.spp(spp);
    }
    let render = render.sampler(SamplerKind::Sobol);
    let film = render.film().unwrap();
    let mut session = render.session(&tree, &film).unwrap();
    let ended = session.run_to_error(error, None, |_| ());
    let developed = film.develop();
    let [width, height] = scene.film.resolution;
    let image = Image::new(width, height, developed.pixels.clone());
    let spp = developed.samples as f64 / film.pixels() as f64;
    Stopped { ended, developed, image, spp }
}

/// A render to an error has that error, within 25 %, and ends at the same sample on any number of threads.
#[test]
fn an_error_is_reached() {
    for (name, error) in [("oren-nayar", 4e-4), ("sky-only", 1e-3), ("cornell", 0.01)] {
        let (scene, (reference, own)) = (small(name), reference(name));
        for seed in [1, 2] {
            let stopped = to_error(&scene, error, None, 2, seed);
            let truth = compare(&stopped.image, &reference).unwrap().relmse - own;
            assert_eq!(stopped.ended, Ended::Error);
            assert!(stopped.developed.relmse.unwrap() <= error);
            assert!(
                (0.75..1.25).contains(&(truth / error)),
                "{name}: {truth}, not {error}, at {} spp",
                stopped.spp
            );
            println!(
                "{name}, seed {seed}: {truth:.3e} of {error:.0e}, {:.2}, {} spp",
                truth / error,
                stopped.spp
            );
            if seed == 1 {
                let alone = to_error(&scene, error, None, 1, seed);
                assert_eq!((alone.spp, alone.image), (stopped.spp, stopped.image));
            }
        }
    }
}

#[test]
fn the_limit_of_samples_comes_first() {
    let scene = sized(shipped("two-spheres.pbrt"), 16, 16);
    for spp in [1, 2, 7, 40] {
        let stopped = to_error(&scene, 1e-30, Some(spp), 2, 1);
        assert_eq!((stopped.ended, stopped.spp), (Ended::Samples, f64::from(spp)));
        // The same picture as without an error to reach, as far as the scrambling is the same.
        assert!(stopped.image.pixels.iter().flatten().all(|value| value.is_finite()));
    }
}
