//! Renders a scene: what to choose, and one call.
//!
//! ```
//! let scene = wavepath::Scene::parse(
//!     r#"Camera "perspective" "float fov" 40
//!        Film "rgb" "integer xresolution" 8 "integer yresolution" 8
//!        WorldBegin
//!        LightSource "infinite" "rgb L" [ 0.5 0.5 0.5 ]"#,
//! )?;
//! let picture = wavepath::Render::new(&scene).spp(16).seed(1).run()?;
//! assert_eq!(picture.image().pixel(0, 0), [0.5; 3]);
//! assert_eq!(picture.error().relmse(), 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod finished;

pub use finished::{Picture, PictureError, channels_of, image_of, stages};

use crate::engine::schedule::Stop;
use crate::engine::session::{self, MOST_SPP, Session, SessionError};
use crate::engine::stats::Stats;
use crate::engine::team::Helpers;
use crate::engine::{Done, EngineKind, SamplerKind, Settings, Tree, wavefront};
use crate::film::live_error::LiveError;
use crate::film::{Film, FilmError, Header};
use crate::film_file::{About, Checkpoint, Checkpoints, FilmFile, Progress};
use crate::machine;
use crate::memory;
use crate::picture::Image;
use crate::plan::Plan;
use crate::report::{self, Report};
use crate::scene::Scene;
use std::cell::RefCell;
use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};
use wavepath_kernels::channels::ChannelSet;
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

/// Why a render did not begin.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// A choice that cannot be.
    #[error("{what} is {found}: expected {expected}")]
    Choice {
        /// What was chosen.
        what: &'static str,
        /// As what.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// The film does not fit into the memory that is free.
    #[error(
        "an image of {} x {} pixels needs {}; {} of memory are free for it",
        resolution[0], resolution[1], memory::in_gib(*needed), memory::in_gib(*free)
    )]
    Memory {
        /// Width and height.
        resolution: [u32; 2],
        /// Bytes.
        needed: u64,
        /// Bytes.
        free: u64,
    },
    /// A film that cannot be gone on with: the scene or a setting is another one.
    #[error("cannot go on with this film: {what}")]
    Changed {
        /// What changed, in words.
        what: String,
    },
    /// The files of the scene cannot be read again, to tell them from others.
    #[error("cannot read the files of the scene again: {0}")]
    Files(String),
    /// The film cannot be, or is of something else.
    #[error(transparent)]
    Film(FilmError),
    /// A tree or a film that was made for something else.
    #[error(transparent)]
    Session(SessionError),
    /// The system does not give the threads.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// How many.
        threads: usize,
        /// What the system said.
        reason: String,
    },
}

impl From<SessionError> for RenderError {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Choice { what, found, expected } => RenderError::Choice { what, found, expected },
            SessionError::Film(error) => RenderError::Film(error),
            SessionError::Threads { threads, reason } => {
                RenderError::Threads { threads, reason: reason.to_string() }
            }
            other => RenderError::Session(other),
        }
    }
}

/// How far a render is.
#[derive(Debug)]
pub struct Update<'a> {
    live: &'a RefCell<LiveError<'a>>,
    about: &'a About,
    /// The film so far.
    pub film: &'a Film,
    /// Pixel samples so far.
    pub samples: u64,
    /// Rays so far.
    pub rays: u64,
    /// Pixel samples in all, if they are known.
    pub total_samples: Option<u64>,
    /// Since the first sample, or since the render was gone on with.
    pub elapsed: Duration,
    /// Those of the pixel samples that a film had which the render goes on with.
    pub samples_before: u64,
}

impl Update<'_> {
    /// Estimated relMSE so far, if it is known. Looking takes a small part of the time, the less the less it is asked
    /// for.
    pub fn error(&self) -> Option<f64> {
        self.live.borrow_mut().update()
    }
    /// The picture so far, with a report.
    pub fn picture(&self) -> Image {
        let mut about = self.about.clone();
        about.report.seconds += self.elapsed.as_secs_f64();
        finished::picture_of(self.film, &mut about)
    }
}

/// Called about ten times a second with an [`Update`]; may end the render.
type Watch<'s> = Box<dyn FnMut(&Update) -> ControlFlow<()> + 's>;

/// A render: the scene, and what is chosen.
///
/// Without [`Render::spp`], [`Render::time`] and [`Render::error`] the scene's samples a pixel are the end; with several
/// of them, whichever is first.
pub struct Render<'s> {
    scene: &'s Scene,
    settings: Settings,
    spp: Option<u32>,
    part: Option<Range<u32>>,
    /// Samples a pixel of the render that this is a part of.
    target: Option<u32>,
    /// Number, from 0, and count, if only some blocks of pixels are rendered.
    tile: Option<[u32; 2]>,
    time: Option<Duration>,
    error: Option<f64>,
    checkpoint: Option<Checkpoint<'s>>,
    resumed: Option<FilmFile>,
    command: Vec<String>,
    /// In place of the scene's.
    plan: Option<Plan>,
    stop: Arc<AtomicBool>,
    helpers: Option<&'s dyn Helpers>,
    watch: Option<Watch<'s>>,
}

impl<'s> Render<'s> {
    /// With the scene's samples, its random numbers, and everything else as is fastest.
    pub fn new(scene: &'s Scene) -> Self {
        let sampler = scene.description().sampler;
        let settings = Settings {
            engine: EngineKind::Wavefront,
            sampler: sampler.kind,
            threads: machine::threads(),
            seed: sampler.seed,
            batch: wavefront::DEFAULT_BATCH,
            level: Level::detect(),
            policy: Policy::Auto,
            adaptive: false,
        };
        let stop = Arc::default();
        Render {
            scene,
            settings,
            spp: None,
            part: None,
            target: None,
            tile: None,
            time: None,
            error: None,
            checkpoint: None,
            resumed: None,
            command: Vec::new(),
            plan: None,
            stop,
            helpers: None,
            watch: None,
        }
    }

    /// Samples a pixel, at least 1; their mean over the pixels if samples are adaptive.
    pub fn spp(mut self, spp: u32) -> Self {
        self.spp = Some(spp);
        self
    }
    /// A part of the samples of each pixel: those of a range, in place of [`Render::spp`]. Films of parts add up to the film
    /// of the whole, to the bit ([`Film::merge`]).
    pub fn samples(mut self, part: Range<u32>) -> Self {
        self.part = Some(part);
        self
    }
    /// Samples a pixel of the render that [`Render::samples`] makes a part of: what merged parts shall have.
    pub fn target(mut self, spp: u32) -> Self {
        self.target = Some(spp);
        self
    }
    /// One of `count` parts of the image, number `number` from 0: every `count`-th block of pixels, so that none of them is dear.
    /// Films of parts add up to the film of the whole, to the bit.
    pub fn tile(mut self, number: u32, count: u32) -> Self {
        self.tile = Some([number, count]);
        self
    }
    /// Time to render for, with that of earlier runs that are gone on with. The first sample of each pixel is always taken.
    pub fn time(mut self, time: Duration) -> Self {
        self.time = Some(time);
        self
    }
    /// Estimated relMSE to render to, above 0.
    pub fn error(mut self, relmse: f64) -> Self {
        self.error = Some(relmse);
        self
    }
    /// Seed of the random numbers. The same seed gives the same bits, whatever else is chosen but the sampler.
    pub fn seed(mut self, seed: u64) -> Self {
        self.settings.seed = seed;
        self
    }
    /// Random numbers.
    pub fn sampler(mut self, sampler: SamplerKind) -> Self {
        self.settings.sampler = sampler;
        self
    }
    /// How paths are executed.
    pub fn engine(mut self, engine: EngineKind) -> Self {
        self.settings.engine = engine;
        self
    }
    /// Worker threads, at least 1.
    pub fn threads(mut self, threads: usize) -> Self {
        self.settings.threads = threads;
        self
    }
    /// Paths in the pool of each worker: see [`wavefront::BATCHES`].
    pub fn batch(mut self, batch: usize) -> Self {
        self.settings.batch = batch;
        self
    }
    /// Instruction set: one that this machine has.
    pub fn level(mut self, level: Level) -> Self {
        self.settings.level = level;
        self
    }
    /// How rays go through the tree.
    pub fn traversal(mut self, policy: Policy) -> Self {
        self.settings.policy = policy;
        self
    }
    /// More samples where the error is, if that pays.
    pub fn adaptive(mut self, adaptive: bool) -> Self {
        self.settings.adaptive = adaptive;
        self
    }
    /// Everything switched on, whether or not the scene needs it: what leaving out brings is the difference.
    pub fn everything(mut self, everything: bool) -> Self {
        let channels = self.plan().requirements().channels;
        let plan = if everything { Plan::everything(self.scene.tables()) } else { self.scene.plan().clone() };
        self.plan = Some(plan.with_channels(channels));
        self
    }
    /// What the film shall hold beside radiance. What is not asked for costs nothing.
    pub fn channels(mut self, channels: ChannelSet) -> Self {
        self.plan = Some(self.plan().clone().with_channels(channels));
        self
    }
    /// A flag that ends the render early once it is set; what is done by then is the picture.
    pub fn stop_on(mut self, flag: Arc<AtomicBool>) -> Self {
        self.stop = flag;
        self
    }
    /// Keeps what is done in a film file as the render goes on, and at its end.
    pub fn checkpoint(mut self, checkpoint: Checkpoint<'s>) -> Self {
        self.checkpoint = Some(checkpoint);
        self
    }
    /// Goes on with a film, whatever ended it; what is in it is not rendered again. With the same scene and settings the
    /// picture is that of a render without a break, to the bit, on any number of threads; with more samples, that of a render
    /// of so many.
    pub fn resume(mut self, film: FilmFile) -> Self {
        self.resumed = Some(film);
        self
    }
    /// Words of a command line that renders the same: kept in film files, for messages.
    pub fn command(mut self, command: Vec<String>) -> Self {
        self.command = command;
        self
    }
    /// Others who render along, such as processes on other machines; the picture has the same bits.
    pub fn with_helpers(mut self, helpers: &'s dyn Helpers) -> Self {
        self.helpers = Some(helpers);
        self
    }
    /// Calls `watch` about ten times a second; [`ControlFlow::Break`] ends the render early, and what is done by then is
    /// the picture.
    pub fn on_update(mut self, watch: impl FnMut(&Update) -> ControlFlow<()> + 's) -> Self {
        self.watch = Some(Box::new(watch));
        self
    }

    /// What is chosen.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
    /// The scene.
    pub fn scene(&self) -> &'s Scene {
        self.scene
    }
    /// What it needs: the scene's plan, or everything, and the channels that are asked for.
    pub fn plan(&self) -> &Plan {
        self.plan.as_ref().unwrap_or_else(|| self.scene.plan())
    }
    /// How many pixels are rendered.
    pub fn pixels(&self) -> u64 {
        let [x0, x1, y0, y1] = self.scene.description().film.pixel_bounds;
        u64::from(x1 - x0) * u64::from(y1 - y0)
    }
    /// Samples a pixel at which it ends, if samples end it.
    pub fn last_sample(&self) -> Option<u32> {
        // A time limit or an error alone is the end; otherwise the scene's samples are.
        let open = self.time.is_some() || self.error.is_some();
        let last = self.part.as_ref().map(|part| part.end).or(self.spp);
        last.or((!open).then_some(self.scene.description().sampler.pixel_samples))
    }

    /// Checks the choices.
    ///
    /// # Errors
    /// [`RenderError::Choice`].
    pub fn check(&self) -> Result<(), RenderError> {
        self.settings.check()?;
        let wrong = |what, found: String, expected: &str| {
            Err(RenderError::Choice { what, found, expected: expected.into() })
        };
        if self.spp == Some(0) {
            return wrong("the number of samples a pixel", "0".into(), "1 or more");
        }
        if let Some(part) = &self.part {
            if part.is_empty() {
                return wrong("the part of the samples", format!("{part:?}"), "a first one below the end");
            }
            if self.settings.adaptive || self.error.is_some() {
                return wrong("the end of a part", "adaptive or an error".into(), "the range of its samples");
            }
        }
        if let Some([number, count]) = self.tile {
            if number >= count {
                return wrong("the number of the part", number.to_string(), &format!("below {count}"));
            }
            if self.settings.adaptive || self.error.is_some() || self.time.is_some() {
                return wrong(
                    "the end of a part",
                    "adaptive, a time or an error".into(),
                    "a number of samples",
                );
            }
        }
        if let Some(error) = self.error
            && (error.is_nan() || error <= 0.0)
        {
            return wrong("the error to render to", error.to_string(), "a number above 0");
        }
        Ok(())
    }

    /// An empty film for the render.
    ///
    /// # Errors
    /// [`RenderError::Memory`] if it does not fit, [`RenderError::Film`] if there can be no such film.
    pub fn film(&self) -> Result<Film, RenderError> {
        self.check_memory()?;
        let frame = self.scene.description().film.frame();
        Film::for_render(frame, self.plan().requirements(), &self.settings).map_err(RenderError::Film)
    }

    /// Checks that its film fits into the memory that is free.
    fn check_memory(&self) -> Result<(), RenderError> {
        let (description, plan) = (self.scene.description(), self.plan());
        let frame = description.film.frame();
        let needed = Film::bytes_for_render(frame, plan.requirements(), self.last_sample());
        let needed = self.tile.map_or(needed, |[_, count]| needed.div_ceil(u64::from(count.max(1))));
        let free = memory::limit();
        if needed > free {
            return Err(RenderError::Memory { resolution: description.film.resolution, needed, free });
        }
        Ok(())
    }

    /// A session that fills `film`, to be paused and gone on with: [`Render::run`] does that for you. Samples that the film
    /// has already are not rendered again.
    ///
    /// # Errors
    /// [`RenderError::Choice`], [`RenderError::Film`] if the film is of something else, and [`RenderError::Threads`] if the
    /// threads cannot be started.
    pub fn session<'a>(&'a self, tree: &'a Tree<'a>, film: &'a Film) -> Result<Session<'a>, RenderError> {
        self.check()?;
        let stop = Stop { spp: self.last_sample(), time: self.time, interrupted: self.stop.clone() };
        let (tables, plan) = (self.scene.tables(), self.plan());
        let session = Session::new(tables, plan, tree, film, &self.settings, stop);
        let session = session.map(|session| match self.helpers {
            Some(helpers) => session.with_helpers(helpers),
            None => session,
        });
        let session = session.map(|session| match (&self.part, self.tile, self.last_sample()) {
            (part, Some([number, count]), Some(last)) => {
                let first = part.as_ref().map_or(0, |part| part.start);
                session.blocks(first..last, |block| block as u64 % u64::from(count) == u64::from(number))
            }
            (Some(part), _, _) => session.samples(part.clone()),
            _ => session,
        });
        Ok(session?)
    }

    /// Renders.
    ///
    /// # Errors
    /// [`RenderError`] if it could not begin.
    pub fn run(self) -> Result<Picture, RenderError> {
        self.check()?;
        let started = Instant::now();
        let (scene, engine) = (self.scene, self.settings.engine);
        // As many threads as render. A thread that waits for another pool takes up other work of its own, which may be such
        // a render, one in the other: what runs in a pool already builds there.
        let tree = if rayon::current_thread_index().is_some() {
            scene.tree(engine)
        } else {
            match rayon::ThreadPoolBuilder::new().num_threads(self.settings.threads).build() {
                Ok(pool) => pool.install(|| scene.tree(engine)),
                // The session says what is wrong.
                Err(_) => scene.tree(engine),
            }
        };
        self.run_in(&tree, started.elapsed())
    }

    /// As [`Render::run`], through a tree that was built in `building` by [`Scene::tree`] for the same engine.
    ///
    /// # Errors
    /// As [`Render::run`].
    pub fn run_in(mut self, tree: &Tree, building: Duration) -> Result<Picture, RenderError> {
        let started = Instant::now();
        let resumed = self.resumed.take();
        let (film, earlier) = match resumed {
            Some(file) => {
                self.check_same(&file)?;
                self.check_memory()?;
                (file.film, Some((file.about.report, file.round)))
            }
            None => (self.film()?, None),
        };
        let film_time = started.elapsed();
        let decides = self.settings.adaptive || self.error.is_some();
        let checkpoint = self.checkpoint.take();
        let identity = match &checkpoint {
            Some(_) => Some(self.scene.identity().map_err(|error| RenderError::Files(error.to_string()))?),
            None => None,
        };
        let mut setup = self.scene.setup().to_vec();
        setup.extend([("film", film_time), ("tree", building)]);
        let mut watch = self.watch.take();
        let total_samples = self.total_samples();
        let samples_before = film.sample_count();
        let earlier_stats = earlier.as_ref().map(|(report, _)| stats_of(report)).unwrap_or_default();
        let elapsed_before =
            earlier.as_ref().and_then(|(report, _)| Duration::try_from_secs_f64(report.seconds).ok());
        let elapsed_before = elapsed_before.unwrap_or_default();
        let (ended, about, round) = {
            let live = RefCell::new(LiveError::new(&film, self.settings.threads));
            let (stop, started) = (self.stop.clone(), Instant::now());
            let progress = Progress::default();
            let template = self.about(&setup);
            let mut about_before = template.clone();
            finished::set_cost(&mut about_before.report, &earlier_stats, elapsed_before);
            let on_done = |done: &Done| {
                let (samples, rays) =
                    (done.samples.load(Ordering::Relaxed), done.rays.load(Ordering::Relaxed));
                progress.samples.store(samples, Ordering::Relaxed);
                progress.rays.store(rays, Ordering::Relaxed);
                let Some(watch) = &mut watch else { return };
                let update = Update {
                    live: &live,
                    about: &about_before,
                    film: &film,
                    samples: samples_before + samples,
                    rays,
                    total_samples,
                    elapsed: started.elapsed(),
                    samples_before,
                };
                if watch(&update).is_break() {
                    stop.store(true, Ordering::Relaxed);
                }
            };
            let mut session = self.session(tree, &film)?;
            if let Some((_, round)) = &earlier {
                let round = round.as_ref().filter(|_| decides);
                session = session.go_on(round, &earlier_stats, elapsed_before)?;
            }
            let run = |session: &mut Session| match self.error {
                Some(error) => session.run_to_error(error, self.time, on_done),
                None => session.run(self.time, on_done),
            };
            let about = |stats: &Stats, elapsed: Duration| {
                let mut about = template.clone();
                finished::set_cost(&mut about.report, stats, elapsed);
                about
            };
            let rounds = decides.then(|| session.rounds());
            let ended = match (&checkpoint, identity) {
                (Some(checkpoint), Some(identity)) => {
                    let (film, progress) = (&film, &progress);
                    let (threads, rounds) = (self.settings.threads, rounds.clone());
                    let checkpoints = Checkpoints { checkpoint, film, identity, progress, threads, rounds };
                    // Rays by class are counted by the workers, each for itself, until they are done.
                    let about_now = || {
                        let samples = samples_before + progress.samples.load(Ordering::Relaxed);
                        let rays = earlier_stats.rays() + progress.rays.load(Ordering::Relaxed);
                        let bounces = film.bounces();
                        let shadow = rays.saturating_sub(samples + bounces);
                        let stages = earlier.as_ref().map(|(report, _)| report.stages.as_slice());
                        let stats =
                            Stats::earlier([samples, bounces, shadow], times(stages.unwrap_or_default()));
                        about(&stats, elapsed_before + started.elapsed())
                    };
                    let ended = std::thread::scope(|scope| {
                        let (still_on, end) = std::sync::mpsc::channel();
                        let checkpoints = &checkpoints;
                        scope.spawn(move || checkpoints.keep_writing(about_now, &end));
                        let ended = run(&mut session);
                        progress.is_over.store(true, Ordering::Relaxed);
                        drop(still_on);
                        ended
                    });
                    checkpoints.finish(&about(session.stats(), session.elapsed()), ended);
                    ended
                }
                _ => run(&mut session),
            };
            let round = rounds.map(|rounds| rounds.lock().unwrap_or_else(PoisonError::into_inner).clone());
            let mut about = about(session.stats(), session.elapsed());
            let session::Adaptive { predicted_gain, is_uneven: used } = session.adaptive();
            about.report.adaptive = self.settings.adaptive.then(|| {
                let [least_spp, most_spp] = film.sample_range();
                report::Adaptive { used, predicted_gain, least_spp, most_spp }
            });
            about.report.stopped_by = Some(ended.name().to_string());
            (ended, about, round)
        };
        Ok(Picture::new(film, about, round, ended))
    }

    /// Where films of this render come from.
    fn about(&self, setup: &[(&'static str, Duration)]) -> About {
        let report = finished::report_of(self.scene, &self.settings, setup);
        let (world_to_camera, world_to_ndc) = finished::camera_matrices(self.scene.description());
        About {
            report,
            adaptive: self.settings.adaptive,
            target: self.target.or_else(|| self.last_sample().filter(|_| self.part.is_none())),
            tile: self.tile.map(|[number, count]| [number + 1, count]),
            command: self.command.clone(),
            half: self.scene.description().film.half,
            world_to_camera,
            world_to_ndc,
        }
    }

    /// Checks that a film can be gone on with.
    fn check_same(&self, file: &FilmFile) -> Result<(), RenderError> {
        let changed = |what: String| Err(RenderError::Changed { what });
        let identity = self.scene.identity().map_err(|error| RenderError::Files(error.to_string()))?;
        let changes = file.identity.changes(identity);
        if !changes.is_empty() {
            return changed(format!("the scene is another one ({})", changes.join(", ")));
        }
        let adaptive = |is: bool| if is { "with" } else { "without" };
        if file.about.adaptive != self.settings.adaptive {
            let (was, is) = (adaptive(file.about.adaptive), adaptive(self.settings.adaptive));
            return changed(format!("it was rendered {was} adaptive sampling, and is to go on {is}"));
        }
        let frame = self.scene.description().film.frame();
        let now = Header::of_render(frame, self.plan().requirements(), &self.settings);
        match file.film.header().check_same(&Header { parts: file.film.parts(), ..now }) {
            Err(FilmError::Mismatch { what, own, other }) => {
                changed(format!("the {what} was {own}, and is {other} now"))
            }
            Err(error) => Err(RenderError::Film(error)),
            Ok(()) => Ok(()),
        }
    }

    /// Pixel samples in all, if samples end it; of a part that is blocks of pixels, about so many.
    pub fn total_samples(&self) -> Option<u64> {
        let first = self.part.as_ref().map_or(0, |part| part.start);
        let tiles = self.tile.map_or(1, |[_, count]| u64::from(count.max(1)));
        self.last_sample().map(|last| u64::from(last.saturating_sub(first)) * self.pixels() / tiles)
    }

    /// Samples a pixel at which a render to an error ends if it does not reach it.
    pub fn most_spp(&self) -> u32 {
        self.last_sample().unwrap_or(MOST_SPP)
    }
}

/// What an earlier part of the render counted.
fn stats_of(report: &Report) -> Stats {
    let report::Rays { camera, bounce, shadow } = report.rays;
    Stats::earlier([camera, bounce, shadow], times(&report.stages))
}

fn times(stages: &[(String, f64)]) -> impl Iterator<Item = (&str, Duration)> {
    stages
        .iter()
        .filter_map(|(name, seconds)| Some((name.as_str(), Duration::try_from_secs_f64(*seconds).ok()?)))
}
