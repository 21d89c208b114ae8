//! `wavepath render`: a scene in, a picture and its cost out.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

use super::args::{Engine, RenderArgs, SamplerChoice, SphericalLights, Traversal};
use super::{Failure, output};
use crate::engine::schedule::Stop;
use crate::engine::session::{self, Ended, MOST_SPP, Session};
use crate::engine::stats::{Stage, Stats};
use crate::engine::{Done, EngineKind, Settings, Tree, wavefront};
use crate::film::live_error::LiveError;
use crate::film::{Developed, Film, PixelStatistics};
use crate::machine;
use crate::memory;
use crate::picture::{self, Channel, DataWindow, Image, Samples};
use crate::plan::Plan;
use crate::progress::Progress;
use crate::report::{Adaptive, Rays, Report};
use crate::scene::{self, SamplerKind, SceneDescription};
use crate::tev::Tev;
use wavepath_kernels::scene::Scene;

/// Reads a scene and builds its tables; warnings go to standard error unless `quiet`.
pub(super) fn load(
    path: &Path,
    spherical: scene::SphericalLights,
    resolution: Option<(u32, u32)>,
    quiet: bool,
) -> Result<(SceneDescription, Scene), Failure> {
    let loaded = crate::pbrt::load(path).map_err(|error| Failure::Input(error.to_string()))?;
    if !quiet {
        for warning in &loaded.warnings {
            eprintln!("{warning}");
        }
    }
    let mut description = loaded.scene;
    if let Some((width, height)) = resolution {
        scene::set_resolution(&mut description, width, height);
    }
    let built = scene::build(&description, spherical)
        .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))?;
    scene::release_meshes(&mut description);
    Ok((description, built))
}

/// Renders.
pub(super) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let spherical = match args.spherical_lights {
        SphericalLights::Cone => scene::SphericalLights::Cone,
        SphericalLights::Area => scene::SphericalLights::Area,
    };
    if let Some(path) = &args.output {
        output::check_image(path)?;
        if args.layers && picture::ImageFormat::from_path(path)? != picture::ImageFormat::Exr {
            return Err(Failure::Usage(format!(
                "--layers: \"{}\" has no room for them; expected a name ending in .exr",
                path.display()
            )));
        }
    }
    if let Some(path) = &args.report {
        output::check_report(path)?;
    }
    let resolution = args.resolution.map(|r| (r.width, r.height));
    let (description, scene) = load(&args.scene, spherical, resolution, args.quiet)?;
    let image_path = match &args.output {
        Some(path) => path.clone(),
        None => {
            let path = default_output(&description, &args.scene);
            output::check_image(&path)?;
            path
        }
    };
    let plan = Plan::new(&scene);
    let settings = settings(args, &description);
    // A time limit or an error alone is the end; otherwise the scene's samples are.
    let open = args.time.is_some() || args.error.is_some();
    let spp = args.spp.or((!open).then_some(description.sampler.pixel_samples));
    // What must know its error from the first samples on has all replicates, whatever the limit.
    let film_spp = spp.filter(|_| args.error.is_none());
    let film = film(&args.scene, &description, &scene, &plan, film_spp)?;
    let tree = Tree::build(settings.engine, &scene);
    let interrupted = crate::interrupt::flag()
        .map_err(|error| Failure::Work(format!("cannot watch for Ctrl-C: {error}")))?;
    let stop = Stop { spp, time: args.time, interrupted: interrupted.clone() };
    let setup = started.elapsed();

    let total = spp.map(|spp| spp as u64 * film.pixels());
    let progress = Progress::new(total, args.time, args.error, args.quiet);
    let mut viewer = Viewer::open(args, &film);
    let mut live = LiveError::new(&film, settings.threads);
    let watch = |done: &Done| {
        let samples = done.samples.load(Ordering::Relaxed);
        let error = if progress.is_visible() { live.update() } else { None };
        progress.update(samples, done.rays.load(Ordering::Relaxed), error);
        viewer.show(false);
    };
    let mut session = Session::new(&scene, &plan, &tree, &film, &settings, stop)
        .map_err(|error| Failure::Work(format!("cannot start {} threads: {error}", settings.threads)))?;
    let ended = match args.error {
        Some(error) => session.run_to_error(error, args.time, watch),
        None => session.run(args.time, watch),
    };
    progress.finish();
    viewer.show(true);

    let developed = film.develop();
    let report = report(args, &settings, &film, &developed, &session, setup, ended);
    let mut image = picture_of(&description, developed.pixels);
    if args.layers {
        image.channels = layers(&film.statistics());
    }
    image.metadata.report = Some(report.to_json());
    picture::write(&image_path, &image, args.exposure).map_err(|error| Failure::Work(error.to_string()))?;
    if let Some(path) = &args.report {
        output::write_report(path, &report)?;
    }
    if !args.quiet {
        if interrupted.load(Ordering::Relaxed) {
            eprintln!("interrupted: wrote what was done");
        }
        if let (Some(error), Ended::Samples) = (args.error, ended) {
            eprintln!(
                "--error {error} was not reached: the limit is {} samples a pixel",
                spp.unwrap_or(MOST_SPP)
            );
        }
        output::say(&report)?;
        output::say(format_args!("wrote {}", image_path.display()))?;
    }
    Ok(())
}

/// The viewer that `--tev` names. What goes wrong with it is told once, and the render goes on.
struct Viewer<'a> {
    tev: Option<Tev>,
    film: &'a Film,
    quiet: bool,
}

impl<'a> Viewer<'a> {
    fn open(args: &RenderArgs, film: &'a Film) -> Self {
        let mut viewer = Viewer { tev: None, film, quiet: args.quiet };
        if let Some(address) = &args.tev {
            let [x0, x1, y0, y1] = film.bounds;
            let name = args.scene.display().to_string();
            match Tev::connect(address, &name, x1 - x0, y1 - y0) {
                Ok(tev) => viewer.tev = Some(tev),
                Err(error) => viewer.warn(&format!("no tev at {address}: {error}")),
            }
        }
        viewer
    }

    /// Shows the film, if it is time, or in any case.
    fn show(&mut self, now: bool) {
        let Some(tev) = self.tev.as_mut().filter(|tev| now || tev.is_due()) else { return };
        let started = Instant::now();
        if let Err(error) = tev.show(&self.film.develop().pixels, started) {
            self.tev = None;
            self.warn(&format!("tev is gone: {error}"));
        }
    }

    fn warn(&self, message: &str) {
        if !self.quiet {
            eprintln!("warning: {message}; the render goes on");
        }
    }
}

/// The file that the scene names, or one named after the scene, in the current folder.
fn default_output(description: &SceneDescription, scene: &Path) -> std::path::PathBuf {
    match &description.film.filename {
        Some(name) if picture::ImageFormat::from_path(Path::new(name)).is_ok() => name.into(),
        _ => {
            let stem = scene.file_stem().unwrap_or_default();
            let stem = Path::new(stem).file_stem().unwrap_or(stem);
            Path::new(stem).with_extension("exr")
        }
    }
}

/// One for each processor.
pub(super) fn default_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The engine of that name.
pub(super) fn engine_kind(engine: Engine) -> EngineKind {
    match engine {
        Engine::Wavefront => EngineKind::Wavefront,
        Engine::Megakernel => EngineKind::Megakernel,
        Engine::MegakernelWide => EngineKind::MegakernelWide,
    }
}

/// The sampler of that name.
pub(super) fn sampler_kind(sampler: SamplerChoice) -> SamplerKind {
    match sampler {
        SamplerChoice::Sobol => SamplerKind::Sobol,
        SamplerChoice::Independent => SamplerKind::Independent,
    }
}

fn settings(args: &RenderArgs, description: &SceneDescription) -> Settings {
    let threads = args.threads.unwrap_or_else(default_threads);
    Settings {
        engine: engine_kind(args.engine),
        sampler: args.sampler.map_or(description.sampler.kind, sampler_kind),
        threads,
        seed: args.seed.unwrap_or(description.sampler.seed),
        batch: args.batch.unwrap_or(wavefront::DEFAULT_BATCH),
        level: Level::detect(),
        policy: match args.traversal {
            Traversal::Auto => Policy::Auto,
            Traversal::Single => Policy::Single,
            Traversal::Mixed => Policy::Mixed,
            Traversal::Packets => Policy::Packets,
            Traversal::Sorted => Policy::Sorted,
            Traversal::Interleaved => Policy::Interleaved,
        },
        adaptive: args.adaptive,
    }
}

/// The film of a scene, if there is memory for it.
pub(super) fn film(
    path: &Path,
    description: &SceneDescription,
    scene: &Scene,
    plan: &Plan,
    spp: Option<u32>,
) -> Result<Film, Failure> {
    let film = &description.film;
    let needed = Film::bytes_for_render(film.frame(), plan.requirements, spp);
    if needed > memory::limit() {
        let [width, height] = film.resolution;
        return Err(Failure::Input(format!(
            "{}: an image of {width} x {height} pixels needs {}; {} of memory are free for it",
            path.display(),
            memory::in_gib(needed),
            memory::in_gib(memory::limit()),
        )));
    }
    Ok(Film::for_render(film.frame(), scene, plan.requirements, spp))
}

/// The pixels as a picture, with its place in the frame.
pub(super) fn picture_of(description: &SceneDescription, pixels: Vec<[f32; 3]>) -> Image {
    let [x0, x1, y0, y1] = description.film.pixel_bounds;
    let [full_width, full_height] = description.film.resolution;
    let mut image = Image::new(x1 - x0, y1 - y0, pixels);
    image.window = DataWindow { x: x0 as i32, y: y0 as i32, full_width, full_height };
    image
}

/// Seconds in each stage that took any.
pub(super) fn stages(stats: &Stats) -> Vec<(String, f64)> {
    let seconds = |stage: Stage| (stage.name().to_string(), stats.stages[stage as usize].as_secs_f64());
    Stage::ALL.into_iter().map(seconds).filter(|(_, seconds)| *seconds > 0.0).collect()
}

/// Standard error and samples of each pixel, as channels of an EXR.
fn layers(statistics: &PixelStatistics) -> Vec<Channel> {
    let colours = ["stderr.R", "stderr.G", "stderr.B"].into_iter().enumerate();
    let colours = colours.map(|(index, name)| Channel {
        name: name.into(),
        samples: Samples::Float(statistics.variance.iter().map(|colour| colour[index].sqrt()).collect()),
    });
    let samples = Channel { name: "samples".into(), samples: Samples::Uint(statistics.samples.clone()) };
    colours.chain([samples]).collect()
}

fn report(
    args: &RenderArgs,
    settings: &Settings,
    film: &Film,
    developed: &Developed,
    session: &Session,
    setup: Duration,
    ended: Ended,
) -> Report {
    let stats = session.stats();
    let [x0, x1, y0, y1] = film.bounds;
    let wavefront = settings.engine == EngineKind::Wavefront;
    let [least_spp, most_spp] = film.sample_range();
    let session::Adaptive { predicted_gain, is_uneven: used } = session.adaptive();
    Report {
        scene: args.scene.display().to_string(),
        engine: args.engine.to_string(),
        width: x1 - x0,
        height: y1 - y0,
        spp: developed.samples as f64 / film.pixels() as f64,
        seconds: session.elapsed().as_secs_f64(),
        setup_seconds: setup.as_secs_f64(),
        samples: developed.samples,
        rays: Rays { camera: stats.camera_rays, bounce: stats.bounce_rays, shadow: stats.shadow_rays },
        stages: stages(stats),
        invalid_samples: developed.invalid,
        estimated_relmse: developed.relmse,
        estimated_relmse_interval: developed.relmse_interval,
        adaptive: settings.adaptive.then_some(Adaptive { used, predicted_gain, least_spp, most_spp }),
        stopped_by: Some(ended.name().to_string()),
        peak_memory_bytes: machine::peak_memory_bytes(),
        threads: settings.threads,
        batch: wavefront.then_some(settings.batch),
        cpu: machine::cpu_name(),
        isa: settings.level.name().to_string(),
        sampler: settings.sampler.name().to_string(),
        seed: settings.seed,
        version: env!("CARGO_PKG_VERSION").to_string(),
    }
}
