//! `wavepath bench`: engines against each other, and what each part of them brings.

use super::args::BenchArgs;
use super::{Failure, output};
use crate::bench::{self, Effort, Figures, Subject};
use crate::machine;
use crate::meshes::{MeshArgs, MeshError};
use crate::scene::{self, Scene};
use clap::{Args, FromArgMatches};
use std::path::{Path, PathBuf};
use wavepath_kernels::isa::Level;

/// Scenes that are measured if none are named: few primitives; 40 and 200 thousand triangles; two million, twice.
const SCENES: [&str; 5] = ["cornell", "metals", "depth-of-field", "terrain", "julia"];

/// How the meshes of the scenes are made.
const MESHES: &str = include_str!("../../scenes/make-meshes.sh");

/// Pixels of the images that are measured, at most.
const PIXELS: f64 = 65_536.0;

/// Measures.
pub(super) fn run(args: &BenchArgs) -> Result<(), Failure> {
    let scenes = if args.scenes.is_empty() { shipped(args)? } else { args.scenes.clone() };
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
    // All scenes are read before the first is measured, so that a wrong one is told at once.
    let load = if args.lenient { crate::pbrt::load_leniently } else { crate::pbrt::load };
    let read = |path: &PathBuf| load(path).map_err(|error| Failure::Input(error.to_string()));
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

/// The scenes of the project, whose folder must be here; makes their large meshes.
fn shipped(args: &BenchArgs) -> Result<Vec<PathBuf>, Failure> {
    let folder = Path::new("scenes");
    let scenes: Vec<_> = SCENES.iter().map(|name| folder.join(name).with_extension("pbrt")).collect();
    if let Some(missing) = scenes.iter().find(|path| !path.is_file()) {
        return Err(Failure::Usage(format!(
            "no {} in the current folder: call bench in wavepath's folder, or name scenes",
            missing.display()
        )));
    }
    for line in MESHES.lines().map(str::trim).filter_map(|line| line.strip_prefix("mesh ")) {
        let Some(file) = line.split_whitespace().last().map(|file| folder.join(file)) else { continue };
        let name = file.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
        if file.is_file() || !SCENES.contains(&name) {
            continue;
        }
        if !args.json {
            output::note(format_args!("making {}", file.display()));
        }
        let failed = |what: String| Failure::Work(format!("cannot make {}: {what}", file.display()));
        std::fs::create_dir_all(file.parent().expect("in a folder")).map_err(|e| failed(e.to_string()))?;
        let command = MeshArgs::augment_args(clap::Command::new("mesh"));
        let words = std::iter::once("mesh").chain(line.split_whitespace());
        let mut mesh = command
            .try_get_matches_from(words)
            .and_then(|matches| MeshArgs::from_arg_matches(&matches))
            .map_err(|e| failed(e.to_string()))?;
        mesh.output = Some(file.clone());
        crate::meshes::run(&mesh).map_err(|e: MeshError| failed(e.to_string()))?;
    }
    Ok(scenes)
}
