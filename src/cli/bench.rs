//! `wavepath bench`: engines against each other, and what each part of them brings.

use super::args::{BenchArgs, FrameArgs};
use super::{Failure, open, output};
use crate::bench::{self, Effort, Figures, Subject};
use crate::machine;
use crate::pbrt::LoadOptions;
use crate::scene::{self, Scene, SceneOptions};
use std::path::{Path, PathBuf};
use wavepath_kernels::isa::Level;

/// Scenes that are measured if none are named: few primitives; 40 and 200 thousand triangles; two million, twice.
const SCENES: [&str; 5] = ["cornell", "metals", "depth-of-field", "terrain", "julia"];

/// Pixels of the images that are measured, at most.
const PIXELS: f64 = 65_536.0;

/// Measures.
pub(super) fn run(args: &BenchArgs) -> Result<(), Failure> {
    if args.scale {
        return scale(args);
    }
    let scenes = if args.scenes.is_empty() { shipped()? } else { args.scenes.clone() };
    let most = machine::threads();
    let effort = Effort { rounds: args.rounds, each: args.each, threads: args.threads.unwrap_or(most) };
    let mut figures = Figures {
        cpu: machine::cpu_name(),
        isa: Level::detect().name(),
        rounds: effort.rounds,
        processor_time: cfg!(unix),
        version: env!("CARGO_PKG_VERSION"),
        scenes: Vec::new(),
    };
    let options = LoadOptions { lenient: args.lenient, ..LoadOptions::default() };
    // All scenes are read before the first is measured, so that a wrong one is told at once.
    let read = |path: &PathBuf| open::load(path, &options, args.json);
    let loaded = scenes.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    for (path, loaded) in scenes.iter().zip(loaded) {
        let mut description = loaded.scene;
        let [width, height] = description.film.resolution.map(f64::from);
        let scale = (PIXELS / (width * height)).sqrt().min(1.0);
        let side = |x: f64| ((x * scale).round() as u32).max(1);
        scene::set_resolution(&mut description, side(width), side(height));
        let scene = Scene::new(path.display().to_string(), description)?;
        let subject = Subject::new(path.display().to_string(), &scene);
        let said = |what: &str| {
            if !args.json {
                output::note(format_args!("{}: {what}", path.display()));
            }
        };
        figures.scenes.push(bench::measure(&subject, effort, said));
    }
    if args.json {
        output::say(serde_json::to_string_pretty(&figures).expect("numbers and names"))
    } else {
        output::say(figures)
    }
}

/// The scenes of the project, whose folder must be here.
fn shipped() -> Result<Vec<PathBuf>, Failure> {
    let folder = Path::new("scenes");
    let scenes: Vec<_> = SCENES.iter().map(|name| folder.join(name).with_extension("pbrt")).collect();
    if let Some(missing) = scenes.iter().find(|path| !path.is_file()) {
        return Err(Failure::Usage(format!(
            "no {} in the current folder: call bench in wavepath's folder, or name scenes",
            missing.display()
        )));
    }
    Ok(scenes)
}

/// What a scene would take on many nodes.
fn scale(args: &BenchArgs) -> Result<(), Failure> {
    let [path] = args.scenes.as_slice() else {
        return Err(Failure::Usage("--scale is of one scene: expected SCENE.pbrt".into()));
    };
    let options = SceneOptions { lenient: args.lenient, ..SceneOptions::default() };
    let scene = open::open(path, &options, &FrameArgs::default(), args.json)?;
    let spp = args.spp.unwrap_or(scene.description().sampler.pixel_samples);
    let threads = args.threads.unwrap_or_else(machine::threads);
    let inputs = bench::scale::measure(&scene, spp, threads, args.each * args.rounds as u32)?;
    let scaling = bench::scale::Scaling::of(inputs, args.network as f64);
    if args.json {
        output::say(serde_json::to_string_pretty(&scaling).expect("numbers and names"))
    } else {
        output::say(scaling)
    }
}
