//! `wavepath render`: a scene in, a picture and its cost out.

use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::args::{FrameArgs, RenderArgs, Resolution};
use super::films::{self, is_film};
use super::output::{self, Voice};
use super::part_args::ProgressArg;
use super::ranks::{Dealer, World};
use super::{Failure, model, open};
use crate::atomic_file::is_standard_output;
use crate::engine::session::Ended;
use crate::film::Film;
use crate::film_file::{Checkpoint, DEFAULT_INTERVAL, FilmFile};
use crate::pbrt::{LoadOptions, Loaded};
use crate::picture::{self, Image, ImageFormat};
use crate::progress::Progress;
use crate::render::Render;
use crate::scene::{self, Scene, SceneDescription, SceneOptions};
use crate::tev::Tev;
use wavepath_kernels::channels::ChannelSet;

/// Size and part of the image, over the scene's own.
pub(super) fn set_frame(description: &mut SceneDescription, frame: &FrameArgs) -> Result<(), Failure> {
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
    films: Vec<PathBuf>,
    voice: Voice,
}

impl Outputs {
    /// Checks what the command line names.
    fn of(args: &RenderArgs) -> Result<Self, Failure> {
        let named = named_outputs(args, &args.output);
        let paths: Vec<&Path> = named.iter().map(|(_, path)| *path).collect();
        let (films, images): (Vec<PathBuf>, Vec<PathBuf>) =
            args.output.iter().cloned().partition(|path| is_film(path));
        images.iter().try_for_each(|path| output::check_image(path))?;
        films.iter().chain(&args.long.checkpoint).try_for_each(|path| output::check_film(path))?;
        if (args.layers || !args.aov.is_empty()) && !images.is_empty() {
            let is_exr =
                |path: &PathBuf| picture::ImageFormat::from_path(path).ok() == Some(ImageFormat::Exr);
            if films.is_empty() && !images.iter().any(is_exr) {
                return Err(Failure::Usage(format!(
                    "{}: \"{}\" has no room for them; expected a name ending in .exr",
                    if args.layers { "--layers" } else { "--aov" },
                    images[0].display()
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
        Ok(Outputs { images, films, voice: Voice::new(args.quiet, &paths) })
    }

    /// With the scene known: its name for the picture, if there is no other, and its files, which are not to be written.
    fn with_scene(
        mut self,
        args: &RenderArgs,
        description: &SceneDescription,
        inputs: &[PathBuf],
    ) -> Result<Self, Failure> {
        if self.images.is_empty() && self.films.is_empty() {
            let path = default_output(description, &args.scene[0]);
            output::check_image(&path)?;
            if !args.no_clobber {
                output::check_default_name(&path, &args.scene[0])?;
            }
            self.images.push(path);
        }
        let written: Vec<PathBuf> = self.images.iter().chain(&self.films).cloned().collect();
        let named = named_outputs(args, &written);
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
    // A checkpoint may be replaced: by the run that goes on with it.
    images.chain(report).chain(scene).collect()
}

/// Reads the scene that the command line names, or makes one around meshes.
fn read(args: &RenderArgs, voice: &Voice) -> Result<Loaded, Failure> {
    if args.scene.iter().all(|path| model::is_mesh(path)) {
        let resolution = args.frame.resolution.map(|r| [r.width, r.height]);
        return model::load(&args.scene, &args.model, resolution, &args.frame.set, voice);
    }
    if let [scene] = args.scene.as_slice() {
        let model = &args.model;
        if model.up.is_some() || model.material.is_some() || model.write_scene.is_some() {
            return Err(Failure::Usage(format!(
                "--up, --material and --write-scene are for a mesh alone; \"{}\" is a scene",
                scene.display()
            )));
        }
        let options = LoadOptions { lenient: args.lenient, set: args.frame.set.clone(), list: false };
        return open::load(scene, &options, args.quiet);
    }
    let other = args.scene.iter().find(|path| !model::is_mesh(path)).expect("not all are meshes");
    Err(Failure::Usage(format!(
        "\"{}\" is no mesh: expected one scene, or meshes (.ply, .ply.gz) only",
        other.display()
    )))
}

/// The scene that is to be rendered.
fn open_scene(args: &RenderArgs, voice: &Voice) -> Result<Scene, Failure> {
    let options = SceneOptions {
        spherical_lights: args.spherical_lights.into(),
        set: args.frame.set.clone(),
        ..SceneOptions::default()
    };
    Scene::read(args.scene[0].display().to_string(), &options, || {
        let mut loaded = read(args, voice)?;
        set_frame(&mut loaded.scene, &args.frame)?;
        crate::check::add_severe(&mut loaded);
        Ok::<_, Failure>(loaded)
    })
}

/// Renders what rank 0 of several processes gives out; it has the picture and says everything.
#[cfg(feature = "mpi")]
pub(super) fn help(args: &RenderArgs, world: &World) -> Result<(), Failure> {
    // It is told to end by rank 0, which hears of signals, too.
    let _ = crate::interrupt::flag();
    let scene = open_scene(&RenderArgs { quiet: true, ..args.clone() }, &Voice::new(true, &[]))?;
    Ok(crate::mpi::help(world, &choose(Render::new(&scene), args))?)
}

/// Renders, with the other processes of `world` if there are any.
pub(super) fn run(args: &RenderArgs, world: Option<&World>) -> Result<(), Failure> {
    let outputs = Outputs::of(args)?;
    let scene = open_scene(args, &outputs.voice)?;
    if !args.quiet {
        for warning in scene.warnings() {
            output::note(warning);
        }
    }
    let outputs = outputs.with_scene(args, scene.description(), scene.inputs())?;
    let interrupted = crate::interrupt::flag()
        .map_err(|error| Failure::Work(format!("cannot watch for signals: {error}")))?;
    // Before the render that borrows it, so that it is dropped later.
    #[allow(clippy::needless_late_init, reason = "the order of dropping")]
    let dealer;
    let mut render = long_render(choose(Render::new(&scene), args), args)?.stop_on(interrupted.clone());
    let mut earlier = Earlier::default();
    if let Some(file) = resumed(args)? {
        earlier = Earlier::of(&file);
        render = render.resume(file);
    }
    // What the others have is in a checkpoint only if it is handed in before.
    let every = args.long.checkpoint_every.unwrap_or(DEFAULT_INTERVAL);
    let hand_in = args.long.checkpoint.as_ref().map(|_| every.mul_f64(0.9));
    dealer = world.map(|world| Dealer::new(world, &render, hand_in)).transpose().map_err(Failure::Work)?;
    if let Some(dealer) = &dealer {
        render = render.with_helpers(dealer);
    }
    let total = render.total_samples();
    let most_spp = render.most_spp();
    let mut progress = match args.long.progress {
        ProgressArg::Auto => Progress::new(total, args.time, args.error, args.quiet),
        ProgressArg::Json => Progress::json(total, args.time, args.error),
    };
    let viewer = RefCell::new(Viewer::open(args, &scene));
    let half = scene.description().film.half;
    let mut saved = Instant::now();
    let picture = render
        .on_update(|update| {
            // Of several processes, each has a part of the film only.
            let error = if progress.is_visible() && world.is_none() { update.error() } else { None };
            progress.begin_at(update.samples_before);
            progress.update(update.samples, update.rays, error);
            viewer.borrow_mut().show(update.film, false);
            if args.long.save_every.is_some_and(|every| saved.elapsed() >= every) {
                if let Err(failure) = outputs.write_images(args, &update.picture(), half) {
                    output::note(format_args!("warning: {failure}; the render goes on"));
                }
                saved = Instant::now();
            }
            ControlFlow::Continue(())
        })
        .run()?;
    progress.finish();
    viewer.into_inner().show(picture.film(), true);

    let mut report = picture.report().clone();
    if let Some(dealer) = &dealer {
        let elapsed = Duration::try_from_secs_f64(report.seconds - earlier.seconds).unwrap_or_default();
        let busy = report.stages.iter().map(|(_, seconds)| seconds).sum::<f64>() - earlier.busy;
        report.set_ranks(dealer.finish(elapsed, busy, report.samples - earlier.samples));
    }
    let ended = picture.ended();
    let interrupt = crate::interrupt::caught().filter(|_| ended == Ended::Interrupt);
    if let (Some((signal, name)), 0) = (interrupt, report.samples) {
        let what = format!("interrupted by {name} before the first sample: wrote no picture");
        return Err(Failure::Interrupted(signal, what));
    }
    for path in &outputs.films {
        picture.save_film(&scene, path).map_err(|error| films::failed(path, &error))?;
    }
    let layers = if args.layers { picture.layers() } else { Vec::new() };
    let mut image = picture.into_image();
    image.channels.extend(layers);
    image.metadata.report = Some(report.to_json());
    outputs.write_images(args, &image, half)?;
    if let Some(path) = &args.report {
        output::write_report(path, &report)?;
    }
    if let (true, Some(path)) =
        (args.long.checkpoint_until_done && ended != Ended::Interrupt, &args.long.checkpoint)
    {
        match std::fs::remove_file(path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                output::note(format_args!(
                    "warning: cannot remove checkpoint \"{}\": {error}",
                    path.display()
                ));
            }
            _ => {}
        }
    }
    if !args.quiet
        && let (Some(error), Ended::Samples) = (args.error, ended)
    {
        output::note(format_args!(
            "--error {error} was not reached: the limit is {most_spp} samples a pixel"
        ));
    }
    outputs.voice.tell(&report)?;
    outputs.images.iter().chain(&outputs.films).try_for_each(|path| outputs.voice.wrote(path))?;
    match interrupt {
        Some((signal, name)) => {
            Err(Failure::Interrupted(signal, format!("interrupted by {name}: wrote what was done")))
        }
        None => Ok(()),
    }
}

/// What an earlier run, which is gone on with, has in its report.
#[derive(Default)]
struct Earlier {
    seconds: f64,
    /// Of workers, added up.
    busy: f64,
    samples: u64,
}

impl Earlier {
    fn of(file: &FilmFile) -> Self {
        let report = &file.about.report;
        let busy = report.stages.iter().map(|(_, seconds)| seconds).sum();
        Earlier { seconds: report.seconds, busy, samples: file.film.sample_count() }
    }
}

/// Checkpoints and parts.
fn long_render<'s>(render: Render<'s>, args: &RenderArgs) -> Result<Render<'s>, Failure> {
    let long = &args.long;
    let words = std::env::args().skip_while(|word| word != "render").skip(1);
    let mut render = render.command(films::common_words(words));
    if let Some(path) = &long.checkpoint {
        let mut checkpoint = Checkpoint::new(path);
        if let Some(interval) = long.checkpoint_every {
            checkpoint = checkpoint.every(interval);
        }
        if long.checkpoint_until_done {
            checkpoint = checkpoint.until_done();
        }
        let name = path.display().to_string();
        render = render.checkpoint(checkpoint.on_written(move |written| {
            if let Err(error) = written {
                output::note(format_args!(
                    "warning: cannot write checkpoint \"{name}\": {error}; the last one is kept, and the render goes on"
                ));
            }
        }));
    }
    if long.samples.is_none() && long.part.is_none() {
        return Ok(render);
    }
    let option = if long.samples.is_some() { "--samples" } else { "--part" };
    let refused =
        [("--adaptive", args.adaptive), ("--error", args.error.is_some()), ("--time", args.time.is_some())];
    if let Some((other, _)) = refused.iter().find(|(_, given)| *given) {
        return Err(Failure::Usage(format!(
            "{option} and {other}: what ends a part must not depend on what is in it; expected a number of samples"
        )));
    }
    if let Some(samples) = &long.samples {
        render = render.samples(samples.0.clone());
    }
    let Some(part) = long.part else { return Ok(render) };
    if long.tiles {
        return Ok(render.tile(part.number - 1, part.count));
    }
    let all = render.last_sample().unwrap_or_default();
    let samples = part.samples(all);
    if samples.is_empty() {
        return Err(Failure::Usage(format!(
            "--part {}/{}: it has none of the {all} samples a pixel; expected at most as many parts as samples",
            part.number, part.count
        )));
    }
    Ok(render.samples(samples).target(all))
}

/// The film to go on with.
fn resumed(args: &RenderArgs) -> Result<Option<FilmFile>, Failure> {
    let long = &args.long;
    let path = match (&long.resume, &long.checkpoint) {
        (Some(path), _) => path,
        (None, Some(path)) if long.resume_if_there => path,
        (None, Some(path)) if path.exists() => {
            return Err(Failure::Usage(format!(
                "--checkpoint \"{}\" exists: expected --resume-if-there to go on with it, or an unused name",
                path.display()
            )));
        }
        (None, None) if long.resume_if_there => {
            return Err(Failure::Usage("--resume-if-there: expected --resume or --checkpoint, too".into()));
        }
        _ => return Ok(None),
    };
    if long.resume_if_there && !path.exists() {
        return Ok(None);
    }
    Ok(Some(FilmFile::read(path)?))
}

/// What the command line chooses.
fn choose<'s>(mut render: Render<'s>, args: &RenderArgs) -> Render<'s> {
    let channels = args.aov.iter().fold(ChannelSet::default(), |all, aov| all.and(aov.0));
    render = render.engine(args.engine.into()).traversal(args.traversal.into()).adaptive(args.adaptive);
    if !channels.is_empty() {
        render = render.channels(channels);
    }
    if let Some(sampler) = args.sampler {
        render = render.sampler(sampler.into());
    }
    if let Some(spp) = args.spp {
        render = render.spp(spp);
    }
    if let Some(time) = args.time {
        render = render.time(time);
    }
    if let Some(error) = args.error {
        render = render.error(error);
    }
    if let Some(seed) = args.seed {
        render = render.seed(seed);
    }
    if let Some(threads) = args.threads {
        render = render.threads(threads);
    }
    if let Some(batch) = args.batch {
        render = render.batch(batch);
    }
    render
}

/// The viewer that `--tev` names. What goes wrong with it is told once, and the render goes on.
struct Viewer {
    tev: Option<Tev>,
    quiet: bool,
}

impl Viewer {
    fn open(args: &RenderArgs, scene: &Scene) -> Self {
        let mut viewer = Viewer { tev: None, quiet: args.quiet };
        if let Some(address) = &args.tev {
            let [x0, x1, y0, y1] = scene.description().film.pixel_bounds;
            match Tev::connect(address, scene.name(), x1 - x0, y1 - y0) {
                Ok(tev) => viewer.tev = Some(tev),
                Err(error) => viewer.warn(&format!("no tev at {address}: {error}")),
            }
        }
        viewer
    }

    /// Shows the film, if it is time, or in any case.
    fn show(&mut self, film: &Film, now: bool) {
        let Some(tev) = self.tev.as_mut().filter(|tev| now || tev.is_due()) else { return };
        let started = Instant::now();
        if let Err(error) = tev.show(&film.develop().pixels, started) {
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
        _ => named_after(scene),
    }
}

/// A picture of its name, in the current folder.
pub(super) fn named_after(scene: &Path) -> PathBuf {
    let name = scene.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    let stem = [".pbrt", ".ply"].iter().find_map(|ending| name.strip_suffix(ending)).unwrap_or(name);
    format!("{stem}.exr").into()
}
