//! `wavepath render`: a scene in, a picture and its cost out.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use glam::{DMat4, DVec3};
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

use super::args::{Engine, FrameArgs, RenderArgs, Resolution, SamplerChoice, SphericalLights, Traversal};
use super::output::{self, Voice};
use super::{Failure, model};
use crate::atomic_file::is_standard_output;
use crate::engine::schedule::Stop;
use crate::engine::session::{self, Ended, MOST_SPP, Session};
use crate::engine::stats::{Stage, Stats};
use crate::engine::{Done, EngineKind, Settings, Tree, wavefront};
use crate::film::live_error::LiveError;
use crate::film::{Developed, Film, PixelStatistics};
use crate::machine;
use crate::memory;
use crate::pbrt::Loaded;
use crate::picture::{self, Channel, DataWindow, Image, ImageFormat, Samples};
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
    let resolution = resolution.map(|(width, height)| Resolution { width, height });
    load_part(path, spherical, &FrameArgs { resolution, ..FrameArgs::default() }, quiet)
}

/// As [`load`], a part of the image.
pub(super) fn load_part(
    path: &Path,
    spherical: scene::SphericalLights,
    frame: &FrameArgs,
    quiet: bool,
) -> Result<(SceneDescription, Scene), Failure> {
    let loaded = crate::pbrt::load(path).map_err(|error| Failure::Input(error.to_string()))?;
    build(loaded, path, spherical, frame, quiet).map(|(description, scene, _)| (description, scene))
}

/// Builds the tables of a scene that was read; also gives all its files.
fn build(
    loaded: Loaded,
    path: &Path,
    spherical: scene::SphericalLights,
    frame: &FrameArgs,
    quiet: bool,
) -> Result<(SceneDescription, Scene, Vec<PathBuf>), Failure> {
    if !quiet {
        for warning in &loaded.warnings {
            output::note(warning);
        }
    }
    let mut description = loaded.scene;
    set_frame(&mut description, frame)?;
    let built = scene::build(&description, spherical)
        .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))?;
    Ok((description, built, loaded.inputs))
}

/// Size and part of the image, over the scene's own.
fn set_frame(description: &mut SceneDescription, frame: &FrameArgs) -> Result<(), Failure> {
    if let Some(Resolution { width, height }) = frame.resolution {
        scene::set_resolution(description, width, height);
    }
    if let Some(crop) = frame.part() {
        let film = &mut description.film;
        film.pixel_bounds =
            crop.bounds(film.resolution).map_err(|what| Failure::Usage(format!("--crop: {what}")))?;
    }
    Ok(())
}

/// All that a render writes, checked before the work.
struct Outputs {
    images: Vec<PathBuf>,
    voice: Voice,
}

impl Outputs {
    /// Checks what the command line names.
    fn of(args: &RenderArgs) -> Result<Self, Failure> {
        let named = named_outputs(args, &args.output);
        let paths: Vec<&Path> = named.iter().map(|(_, path)| *path).collect();
        args.output.iter().try_for_each(|path| output::check_image(path))?;
        if args.layers && !args.output.is_empty() {
            let is_exr =
                |path: &PathBuf| picture::ImageFormat::from_path(path).ok() == Some(ImageFormat::Exr);
            if !args.output.iter().any(is_exr) {
                return Err(Failure::Usage(format!(
                    "--layers: \"{}\" has no room for them; expected a name ending in .exr",
                    args.output[0].display()
                )));
            }
        }
        for (option, path) in &named {
            match *option {
                "--report" => output::check_report(path)?,
                "--write-scene" => output::check_file(path, "scene")?,
                _ => {}
            }
        }
        output::check_distinct(&named, &args.scene)?;
        output::check_clobber(&named, args.no_clobber)?;
        Ok(Outputs { images: args.output.clone(), voice: Voice::new(args.quiet, &paths) })
    }

    /// With the scene known: its name for the picture, if there is no other, and its files, which are not to be written.
    fn with_scene(
        mut self,
        args: &RenderArgs,
        description: &SceneDescription,
        inputs: &[PathBuf],
    ) -> Result<Self, Failure> {
        if self.images.is_empty() {
            let path = default_output(description, &args.scene[0]);
            output::check_image(&path)?;
            if !args.no_clobber {
                output::check_default_name(&path, &args.scene[0])?;
            }
            self.images.push(path);
        }
        let named = named_outputs(args, &self.images);
        output::check_distinct(&named, inputs)?;
        output::check_clobber(&named, args.no_clobber)?;
        Ok(self)
    }

    fn write_images(&self, args: &RenderArgs, image: &Image, half: bool) -> Result<(), Failure> {
        let encoding = args.encoding.encoding(half);
        self.images.iter().try_for_each(|path| Ok(picture::write_encoded(path, image, &encoding)?))
    }
}

/// Option and file of all that is written, with these images.
fn named_outputs<'a>(args: &'a RenderArgs, images: &'a [PathBuf]) -> Vec<(&'static str, &'a Path)> {
    let images = images.iter().map(|path| ("-o", path.as_path()));
    let report = args.report.iter().map(|path| ("--report", path.as_path()));
    let scene = args.model.write_scene.iter().map(|path| ("--write-scene", path.as_path()));
    images.chain(report).chain(scene).collect()
}

/// Reads the scene that the command line names, or makes one around meshes.
fn read(args: &RenderArgs, voice: &Voice) -> Result<Loaded, Failure> {
    if args.scene.iter().all(|path| model::is_mesh(path)) {
        let resolution = args.frame.resolution.map(|r| [r.width, r.height]);
        return model::load(&args.scene, &args.model, resolution, voice);
    }
    if let [scene] = args.scene.as_slice() {
        let model = &args.model;
        if model.up.is_some() || model.material.is_some() || model.write_scene.is_some() {
            return Err(Failure::Usage(format!(
                "--up, --material and --write-scene are for a mesh alone; \"{}\" is a scene",
                scene.display()
            )));
        }
        return crate::pbrt::load(scene).map_err(|error| Failure::Input(error.to_string()));
    }
    let other = args.scene.iter().find(|path| !model::is_mesh(path)).expect("not all are meshes");
    Err(Failure::Usage(format!(
        "\"{}\" is no mesh: expected one scene, or meshes (.ply, .ply.gz) only",
        other.display()
    )))
}

/// Takes the time of the parts of the setup.
struct SetupClock {
    last: Instant,
    stages: Vec<(String, f64)>,
}

impl SetupClock {
    fn start() -> Self {
        SetupClock { last: Instant::now(), stages: Vec::new() }
    }

    /// What has passed since the last call belongs to `name`.
    fn lap(&mut self, name: &str) {
        let now = Instant::now();
        self.stages.push((name.into(), (now - self.last).as_secs_f64()));
        self.last = now;
    }

    /// As [`SetupClock::lap`] for reading; mesh files, which may be read by several threads, apart.
    fn lap_reading(&mut self, meshes: Duration) {
        self.lap("reading");
        let reading = &mut self.stages.last_mut().expect("a lap was taken").1;
        let meshes = meshes.as_secs_f64().min(*reading);
        *reading -= meshes;
        self.stages.push(("meshes".into(), meshes));
    }
}

/// What is known of the picture beside its pixels and its report.
fn describe(image: &mut Image, description: &SceneDescription, report: &Report) {
    let metadata = &mut image.metadata;
    metadata.samples_per_pixel = Some(report.spp.round() as u32);
    metadata.render_time_seconds = Some(report.seconds as f32);
    metadata.capture_date = machine::utc_now();
    metadata.comments = Some(format!("{}, rendered by wavepath {}", report.scene, report.version));
    let (camera, ndc) = camera_matrices(description);
    metadata.world_to_camera = Some(camera);
    metadata.world_to_ndc = Some(ndc);
}

/// World to camera space, and to the screen, whose shorter axis spans 0 to 1 and whose z goes from 0 at 0.01 to 1 at
/// 1000: what pbrt writes. Rows of matrices for points as columns.
fn camera_matrices(description: &SceneDescription) -> ([f32; 16], [f32; 16]) {
    let camera = DMat4::from(description.camera.world_from_camera).inverse();
    let (near, far) = (1e-2, 1000.0);
    let focal = 1.0 / (description.camera.fov.to_radians() / 2.0).tan();
    let screen = DMat4::from_cols_array_2d(&[
        [focal, 0.0, 0.0, 0.0],
        [0.0, focal, 0.0, 0.0],
        [0.0, 0.0, far / (far - near), 1.0],
        [0.0, 0.0, -far * near / (far - near), 0.0],
    ]);
    let to_unit = DMat4::from_translation(DVec3::splat(0.5)) * DMat4::from_scale(DVec3::new(0.5, 0.5, 1.0));
    let rows = |matrix: DMat4| matrix.transpose().to_cols_array().map(|value| value as f32);
    (rows(camera), rows(to_unit * screen * camera))
}

/// Renders.
pub(super) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let spherical = match args.spherical_lights {
        SphericalLights::Cone => scene::SphericalLights::Cone,
        SphericalLights::Area => scene::SphericalLights::Area,
    };
    let outputs = Outputs::of(args)?;
    let mut clock = SetupClock::start();
    let mesh_time = crate::pbrt::reading_time();
    let loaded = read(args, &outputs.voice)?;
    clock.lap_reading(crate::pbrt::reading_time().saturating_sub(mesh_time));
    let (description, scene, inputs) = build(loaded, &args.scene[0], spherical, &args.frame, args.quiet)?;
    let outputs = outputs.with_scene(args, &description, &inputs)?;
    clock.lap("tables");
    let plan = Plan::new(&scene);
    let settings = settings(args, &description);
    // A time limit or an error alone is the end; otherwise the scene's samples are.
    let open = args.time.is_some() || args.error.is_some();
    let spp = args.spp.or((!open).then_some(description.sampler.pixel_samples));
    // What must know its error from the first samples on has all replicates, whatever the limit.
    let film_spp = spp.filter(|_| args.error.is_none());
    let film = film(&args.scene[0], &description, &scene, &plan, film_spp)?;
    clock.lap("film");
    let tree = Tree::build(settings.engine, &scene);
    clock.lap("tree");
    let interrupted = crate::interrupt::flag()
        .map_err(|error| Failure::Work(format!("cannot watch for Ctrl-C: {error}")))?;
    let stop = Stop { spp, time: args.time, interrupted: interrupted.clone() };
    let setup = started.elapsed();

    let total = spp.map(|spp| spp as u64 * film.pixels());
    let mut progress = Progress::new(total, args.time, args.error, args.quiet);
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
    let mut report = report(args, &settings, &film, &developed, &session, setup, ended);
    report.setup_stages = clock.stages;
    let mut image = picture_of(&description, developed.pixels);
    if args.layers {
        image.channels = layers(&film.statistics());
    }
    image.metadata.report = Some(report.to_json());
    describe(&mut image, &description, &report);
    outputs.write_images(args, &image, description.film.half)?;
    if let Some(path) = &args.report {
        output::write_report(path, &report)?;
    }
    if !args.quiet {
        if interrupted.load(Ordering::Relaxed) {
            output::note("interrupted: wrote what was done");
        }
        if let (Some(error), Ended::Samples) = (args.error, ended) {
            output::note(format_args!(
                "--error {error} was not reached: the limit is {} samples a pixel",
                spp.unwrap_or(MOST_SPP)
            ));
        }
    }
    outputs.voice.tell(&report)?;
    outputs.images.iter().try_for_each(|path| outputs.voice.wrote(path))
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
            let name = args.scene[0].display().to_string();
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
            output::note(format_args!("warning: {message}; the render goes on"));
        }
    }
}

/// The file that the scene names, or one named after the scene, in the current folder.
fn default_output(description: &SceneDescription, scene: &Path) -> PathBuf {
    match &description.film.filename {
        // Standard output is for those who ask for it.
        Some(name)
            if ImageFormat::from_path(Path::new(name)).is_ok() && !is_standard_output(Path::new(name)) =>
        {
            name.into()
        }
        _ => {
            let name = scene.file_name().unwrap_or_default().to_string_lossy();
            let name = name.strip_suffix(".gz").unwrap_or(&name);
            let stem = [".pbrt", ".ply"].iter().find_map(|ending| name.strip_suffix(ending)).unwrap_or(name);
            format!("{stem}.exr").into()
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
        scene: args.scene[0].display().to_string(),
        engine: args.engine.to_string(),
        width: x1 - x0,
        height: y1 - y0,
        spp: developed.samples as f64 / film.pixels() as f64,
        seconds: session.elapsed().as_secs_f64(),
        setup_seconds: setup.as_secs_f64(),
        setup_stages: Vec::new(),
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
