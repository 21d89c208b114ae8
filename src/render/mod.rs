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
use crate::engine::session::{MOST_SPP, Session, SessionError};
use crate::engine::{Done, EngineKind, SamplerKind, Settings, Tree, wavefront};
use crate::film::live_error::LiveError;
use crate::film::{Film, FilmError};
use crate::machine;
use crate::memory;
use crate::plan::Plan;
use crate::scene::Scene;
use std::cell::RefCell;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
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
    /// The film so far.
    pub film: &'a Film,
    /// Pixel samples so far.
    pub samples: u64,
    /// Rays so far.
    pub rays: u64,
    /// Pixel samples in all, if they are known.
    pub total_samples: Option<u64>,
    /// Since the first sample.
    pub elapsed: Duration,
}

impl Update<'_> {
    /// Estimated relMSE so far, if it is known. Looking takes a small part of the time, the less the less it is asked
    /// for.
    pub fn error(&self) -> Option<f64> {
        self.live.borrow_mut().update()
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
    time: Option<Duration>,
    error: Option<f64>,
    /// In place of the scene's.
    plan: Option<Plan>,
    stop: Arc<AtomicBool>,
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
            time: None,
            error: None,
            plan: None,
            stop,
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
    /// Time to render for. The first sample of each pixel is always taken.
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
        let (description, plan) = (self.scene.description(), self.plan());
        let frame = description.film.frame();
        let needed = Film::bytes_for_render(frame, plan.requirements(), self.last_sample());
        let free = memory::limit();
        if needed > free {
            return Err(RenderError::Memory { resolution: description.film.resolution, needed, free });
        }
        Film::for_render(frame, plan.requirements(), &self.settings).map_err(RenderError::Film)
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
        let session = session.map(|session| match &self.part {
            Some(part) => session.samples(part.clone()),
            None => session,
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
        // As many threads as render; the pool of the session lives no longer than its render, which needs the tree.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.settings.threads).build();
        let tree = match pool {
            Ok(pool) => pool.install(|| scene.tree(engine)),
            // The session says what is wrong.
            Err(_) => scene.tree(engine),
        };
        self.run_in(&tree, started.elapsed())
    }

    /// As [`Render::run`], through a tree that was built in `building` by [`Scene::tree`] for the same engine.
    ///
    /// # Errors
    /// As [`Render::run`].
    pub fn run_in(mut self, tree: &Tree, building: Duration) -> Result<Picture, RenderError> {
        let started = Instant::now();
        let film = self.film()?;
        let film_time = started.elapsed();
        let mut watch = self.watch.take();
        let first = self.part.as_ref().map_or(0, |part| part.start);
        let total_samples =
            self.last_sample().map(|last| u64::from(last.saturating_sub(first)) * film.pixels());
        let (ended, stats, elapsed, adaptive) = {
            let live = RefCell::new(LiveError::new(&film, self.settings.threads));
            let (stop, started) = (self.stop.clone(), Instant::now());
            let on_done = |done: &Done| {
                let Some(watch) = &mut watch else { return };
                let update = Update {
                    live: &live,
                    film: &film,
                    samples: done.samples.load(Ordering::Relaxed),
                    rays: done.rays.load(Ordering::Relaxed),
                    total_samples,
                    elapsed: started.elapsed(),
                };
                if watch(&update).is_break() {
                    stop.store(true, Ordering::Relaxed);
                }
            };
            let mut session = self.session(tree, &film)?;
            let ended = match self.error {
                Some(error) => session.run_to_error(error, self.time, on_done),
                None => session.run(self.time, on_done),
            };
            (ended, session.stats().clone(), session.elapsed(), session.adaptive())
        };
        let mut setup = self.scene.setup().to_vec();
        setup.extend([("film", film_time), ("tree", building)]);
        Ok(Picture::new(self.scene, &self.settings, film, &stats, elapsed, &setup, ended, adaptive))
    }

    /// Samples a pixel at which a render to an error ends if it does not reach it.
    pub fn most_spp(&self) -> u32 {
        self.last_sample().unwrap_or(MOST_SPP)
    }
}
