//! A render that can be paused, looked at and gone on with.
//!
//! Whoever measures the error of a render as it goes on pauses it: only what passes inside of [`Session::run`] and
//! [`Session::run_to_error`] counts as rendering time.

use super::adaptive::{LEAST_GAIN, LEAST_PILOT, LEAST_REPLICATES, Shares};
use super::schedule::{Schedule, Stop};
use super::stats::Stats;
use super::team::Helpers;
use super::wavefront::BATCHES;
use super::{Done, Job, Settings, Tree, check_together, execute, watched};
use crate::film::replicates::{REPLICATES, samples_of};
use crate::film::{Film, FilmError, Header};
use crate::plan::Plan;
use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use wavepath_kernels::scene::Scene;

/// Where a render that is to reach an error ends if it does not: samples a pixel.
pub const MOST_SPP: u32 = 1 << 20;

/// Why a render ended or paused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// All samples are taken.
    Samples,
    /// The time is over.
    Time,
    /// The estimated error is small enough.
    Error,
    /// Someone raised the flag.
    Interrupt,
}

impl Ended {
    /// As reports name it.
    pub fn name(self) -> &'static str {
        match self {
            Ended::Samples => "samples",
            Ended::Time => "time",
            Ended::Error => "error",
            Ended::Interrupt => "interrupt",
        }
    }
}

/// What adaptive sampling did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptive {
    /// Efficiency over that of samples spread evenly, as the last decision predicted it; none if there was none.
    pub predicted_gain: Option<f64>,
    /// Whether samples were spread unevenly.
    pub is_uneven: bool,
}

/// A round of a render, and what was decided for it: with the film, all that a render which decides by what it sees needs to
/// be gone on with, to the same bits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Round {
    /// Samples a pixel at its beginning, mean over the pixels.
    pub from: u32,
    /// The same at its end.
    pub to: u32,
    /// Samples of both halves of each block, if they are spread unevenly, by number in the half.
    pub ranges: Option<Vec<[Range<u32>; 2]>>,
    /// Efficiency over that of samples spread evenly, as predicted by the last decision.
    pub predicted_gain: Option<f64>,
}

/// Where a render is. No round begins as long as someone holds the lock: what a film has then is of this round or of earlier
/// ones.
pub type Rounds = Arc<Mutex<Round>>;

fn locked(rounds: &Mutex<Round>) -> MutexGuard<'_, Round> {
    rounds.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Whether there is enough to decide on.
fn can_adapt(settings: &Settings, film: &Film) -> bool {
    settings.adaptive && film.parts() >= LEAST_REPLICATES
}

/// Why a render cannot begin.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
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
    /// Something that was made for something else.
    #[error("the {what} was made for {of}")]
    Foreign {
        /// What.
        what: &'static str,
        /// For what it was made.
        of: &'static str,
    },
    /// A film of something else than the plan and the settings say.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// The system does not give the threads.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// How many.
        threads: usize,
        /// What the system said.
        reason: rayon::ThreadPoolBuildError,
    },
}

impl Settings {
    /// Checks the choices.
    ///
    /// # Errors
    /// [`SessionError::Choice`].
    pub fn check(&self) -> Result<(), SessionError> {
        let wrong = |what, found: String, expected: &str| {
            Err(SessionError::Choice { what, found, expected: expected.into() })
        };
        if !(1..=MOST_THREADS).contains(&self.threads) {
            let expected = format!("1 to {MOST_THREADS}");
            return wrong("the number of threads", self.threads.to_string(), &expected);
        }
        if !BATCHES.contains(&self.batch) {
            let (least, most) = BATCHES.into_inner();
            let expected = format!("{least} to {most}");
            return wrong("the number of paths in a pool", self.batch.to_string(), &expected);
        }
        Ok(())
    }
}

/// Most threads of a render.
pub const MOST_THREADS: usize = 1 << 14;

/// A render.
pub struct Session<'a> {
    scene: &'a Scene,
    plan: &'a Plan,
    tree: &'a Tree<'a>,
    film: &'a Film,
    settings: &'a Settings,
    spp: Option<u32>,
    interrupted: Arc<AtomicBool>,
    helpers: Option<&'a dyn Helpers>,
    /// The render may end any moment.
    growing: bool,
    pool: rayon::ThreadPool,
    schedule: Schedule<'a>,
    /// Samples a pixel, mean over the pixels, once all of the schedule is given out.
    planned: u32,
    /// As the last decision had it.
    predicted_gain: Option<f64>,
    /// Blocks may have different numbers of samples.
    is_uneven: bool,
    rounds: Rounds,
    /// The round was begun by an earlier session.
    goes_on: bool,
    stats: Stats,
    elapsed: Duration,
    done: Done,
}

impl<'a> Session<'a> {
    /// Starts the threads. `film` takes the samples; those that it has already are not rendered again.
    ///
    /// Without a time in `stop`, samples are dealt in the order that is fastest if all of them are taken; with one, so
    /// that the render may end any moment. The time itself is an argument of [`Session::run`].
    ///
    /// # Errors
    /// [`SessionError`]: a setting that cannot be, parts that are made for something else, or threads that cannot be
    /// started.
    pub fn new(
        scene: &'a Scene,
        plan: &'a Plan,
        tree: &'a Tree<'a>,
        film: &'a Film,
        settings: &'a Settings,
        stop: Stop,
    ) -> Result<Self, SessionError> {
        settings.check()?;
        check_together(scene, plan, film)?;
        if !tree.is_of(scene, settings.engine) {
            return Err(SessionError::Foreign { what: "tree", of: "another scene or engine" });
        }
        let header = Header::of_render(film.header().frame, plan.requirements(), settings);
        film.header().check_same(&Header { parts: film.parts(), ..header })?;
        let threads = settings.threads;
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|reason| SessionError::Threads { threads, reason })?;
        let (spp, interrupted) = (stop.spp, stop.interrupted.clone());
        let planned = if can_adapt(settings, film) { first_round(spp) } else { spp.unwrap_or(u32::MAX) };
        let growing = stop.time.is_some() || spp.is_none();
        let schedule = Schedule::of(film, settings.threads, 0..planned, growing, stop.interrupted);
        let (stats, elapsed, done) = (Stats::default(), Duration::ZERO, Done::default());
        Ok(Session {
            scene,
            plan,
            tree,
            film,
            settings,
            spp,
            interrupted,
            helpers: None,
            growing,
            pool,
            schedule,
            planned,
            predicted_gain: None,
            is_uneven: false,
            rounds: Arc::new(Mutex::new(Round { to: planned, ..Round::default() })),
            goes_on: false,
            stats,
            elapsed,
            done,
        })
    }

    /// Renders together with others, to the same bits. To be called first.
    pub fn with_helpers(mut self, helpers: &'a dyn Helpers) -> Self {
        self.helpers = Some(helpers);
        let interrupted = Arc::clone(&self.interrupted);
        self.schedule = Schedule::of(self.film, self.workers(), 0..self.planned, self.growing, interrupted);
        self
    }

    /// Threads that render, here and elsewhere.
    fn workers(&self) -> usize {
        self.settings.threads + self.helpers.map_or(0, |helpers| helpers.workers())
    }

    /// Renders a part only: of all samples of each pixel, those of a range. Not for adaptive renders or renders to an
    /// error, which decide by what is in the whole film.
    pub fn samples(mut self, range: Range<u32>) -> Self {
        let interrupted = Arc::clone(&self.interrupted);
        self.schedule = Schedule::of(self.film, self.workers(), range.clone(), false, interrupted);
        (self.planned, self.spp) = (range.end, Some(range.end));
        self
    }

    /// Renders blocks of pixels only: of each, the samples of a range, and none of those blocks that `with` does not name.
    /// As [`Session::samples`] otherwise.
    pub fn blocks(mut self, samples: Range<u32>, with: impl Fn(usize) -> bool) -> Self {
        let of_half = |half: u32, samples: u32| -> u32 {
            (half..REPLICATES).step_by(2).map(|replicate| samples_of(replicate, samples)).sum()
        };
        let halves = [0, 1].map(|half| of_half(half, samples.start)..of_half(half, samples.end));
        let none = [0..0, 0..0];
        let of_block = |block: usize| if with(block) { halves.clone() } else { none.clone() };
        let ranges: Vec<[Range<u32>; 2]> = (0..self.film.blocks().len()).map(of_block).collect();
        let interrupted = Arc::clone(&self.interrupted);
        self.schedule = Schedule::by_half(self.film, self.workers(), &ranges, interrupted);
        (self.planned, self.spp) = (samples.end, Some(samples.end));
        self
    }

    /// Goes on where an earlier session ended, whose film this one has: in the middle of a round, with what that one counted
    /// and the time that it took. Only renders that decide by what they see need the round; others go by the film.
    ///
    /// # Errors
    /// [`SessionError::Foreign`] if it is the round of another film.
    pub fn go_on(
        mut self,
        round: Option<&Round>,
        stats: &Stats,
        elapsed: Duration,
    ) -> Result<Self, SessionError> {
        self.stats.merge(stats);
        self.elapsed += elapsed;
        let Some(round) = round else { return Ok(self) };
        let (film, workers, interrupted) = (self.film, self.workers(), Arc::clone(&self.interrupted));
        let Round { from, to, ref ranges, predicted_gain } = *round;
        let fits = |ranges: &Vec<[Range<u32>; 2]>| {
            ranges.len() == film.blocks().len()
                && ranges.iter().flatten().all(|range| range.start <= range.end)
        };
        if from > to || !ranges.as_ref().is_none_or(fits) {
            return Err(SessionError::Foreign { what: "round", of: "another film" });
        }
        self.schedule = match ranges {
            Some(ranges) => Schedule::by_half(film, workers, ranges, interrupted),
            None => Schedule::of(film, workers, from..to, from == 0, interrupted),
        };
        if ranges.is_some() {
            film.split();
        }
        (self.planned, self.predicted_gain, self.is_uneven) = (to, predicted_gain, ranges.is_some());
        *locked(&self.rounds) = round.clone();
        self.goes_on = true;
        Ok(self)
    }

    /// Where it is.
    pub fn rounds(&self) -> Rounds {
        Arc::clone(&self.rounds)
    }

    /// What all workers counted so far.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Time spent rendering so far.
    pub fn elapsed(&self) -> Duration {
        self.elapsed
    }

    /// Renders until all samples are taken, or until the rendering time is `until` in all; `watch` is called about ten
    /// times a second meanwhile.
    pub fn run(&mut self, until: Option<Duration>, mut watch: impl FnMut(&Done)) -> Ended {
        let most = self.spp.unwrap_or(u32::MAX);
        loop {
            let ended = self.run_round(until, &mut watch);
            if ended != Ended::Samples || self.planned >= most {
                return ended;
            }
            self.begin_round(next_round(self.planned, self.spp));
        }
    }

    /// Plans the samples from here to `to` a pixel, mean over the pixels.
    fn begin_round(&mut self, to: u32) {
        // Deciding is a part of the work.
        let started = Instant::now();
        let (film, workers, from) = (self.film, self.workers(), self.planned);
        let interrupted = Arc::clone(&self.interrupted);
        let rounds = Arc::clone(&self.rounds);
        let mut round = locked(&rounds);
        let ranges = self.uneven_ranges(to);
        self.schedule = match &ranges {
            Some(ranges) => Schedule::by_half(film, workers, ranges, interrupted),
            None => Schedule::of(film, workers, from..to, from == 0, interrupted),
        };
        self.planned = to;
        *round = Round { from, to, ranges, predicted_gain: self.predicted_gain };
        self.elapsed += started.elapsed();
    }

    /// The samples from here to `to` of both halves of each block; none if they are the same for all.
    fn uneven_ranges(&mut self, to: u32) -> Option<Vec<[Range<u32>; 2]>> {
        let film = self.film;
        if !can_adapt(self.settings, film) || self.planned < LEAST_PILOT {
            return None;
        }
        let halves = self.pool.install(|| film.halves());
        let shares = Shares::best(&halves, film.block_columns());
        self.predicted_gain = Some(shares.gain);
        // What is uneven stays so: to fill up what is behind would not pay.
        if !self.is_uneven && shares.gain < LEAST_GAIN {
            return None;
        }
        self.is_uneven = true;
        film.split();
        let targets = shares.targets(&halves, to, film.parts() / 2);
        let ranges = halves.iter().zip(targets).map(|(halves, to)| [0, 1].map(|k| halves[k].samples..to[k]));
        Some(ranges.collect())
    }

    /// What adaptive sampling did.
    pub fn adaptive(&self) -> Adaptive {
        Adaptive { predicted_gain: self.predicted_gain, is_uneven: self.is_uneven }
    }

    /// As [`Session::run`], to the end of the schedule.
    fn run_round(&mut self, until: Option<Duration>, watch: impl FnMut(&Done)) -> Ended {
        let started = Instant::now();
        // A time too far away for the clock is no limit.
        let deadline = until.and_then(|until| started.checked_add(until.saturating_sub(self.elapsed)));
        self.schedule.pause_at(deadline);
        let Session { scene, plan, film, settings, schedule, helpers, done, .. } = &*self;
        // Checked when the session began.
        let job = Job { scene, plan, film, schedule, seed: settings.seed, policy: settings.policy, done };
        let work = || execute(&self.pool, &job, self.tree, self.settings);
        let stats = watched(&self.done, watch, || match helpers {
            Some(helpers) => together(work, || helpers.work(schedule, film, done)),
            None => work(),
        });
        self.stats.merge(&stats);
        self.elapsed += started.elapsed();
        if self.schedule.is_interrupted() {
            Ended::Interrupt
        } else if self.schedule.is_complete() {
            Ended::Samples
        } else {
            Ended::Time
        }
    }

    /// Renders until the film estimates a relMSE of at most `error`, or as [`Session::run`]; without a number of samples
    /// in the rule, [`MOST_SPP`] are the end.
    ///
    /// The film is looked at after whole numbers of samples only, the same in every pixel. Which ones follows from
    /// what the film says there, so that the same seed ends at the same sample on any number of threads. Looking often
    /// would stop at the first estimate that is too small by chance: the next look is where the error should be reached
    /// if it falls as 1 / spp, and at most at twice the samples.
    pub fn run_to_error(
        &mut self,
        error: f64,
        until: Option<Duration>,
        mut watch: impl FnMut(&Done),
    ) -> Ended {
        let most = self.spp.unwrap_or(MOST_SPP);
        if !std::mem::take(&mut self.goes_on) {
            self.planned = 0;
            self.begin_round(FIRST_LOOK.min(most));
        }
        loop {
            let to = self.planned;
            let ended = self.run_round(until, &mut watch);
            if ended != Ended::Samples {
                return ended;
            }
            // Looking is a part of the work that an error costs.
            let looking = Instant::now();
            let estimate = self.pool.install(|| self.film.error()).map(|estimate| estimate.relmse);
            self.elapsed += looking.elapsed();
            if estimate.is_some_and(|estimate| estimate <= error) {
                return Ended::Error;
            }
            if to >= most {
                return Ended::Samples;
            }
            let factor = estimate.map_or(2.0, |estimate| (estimate / error).clamp(SMALLEST_STEP, 2.0));
            self.begin_round(next_look(to, factor).min(most));
        }
    }
}

/// Both at the same time; what both counted.
fn together(work: impl FnOnce() -> Stats, help: impl FnOnce() -> Stats + Send) -> Stats {
    std::thread::scope(|scope| {
        let help = scope.spawn(help);
        let mut stats = work();
        match help.join() {
            Ok(helped) => stats.merge(&helped),
            Err(panic) => std::panic::resume_unwind(panic),
        }
        stats
    })
}

/// Samples a pixel of the first round of an adaptive render: a quarter of all if those are known and it is enough; so
/// many that doubling them some times gives all.
fn first_round(spp: Option<u32>) -> u32 {
    let halvings = |spp: u32| (spp / LEAST_PILOT).max(1).ilog2().min(2);
    spp.map_or(LEAST_PILOT, |spp| spp.div_ceil(1 << halvings(spp)))
}

/// Samples a pixel of the round after one that ends with `planned`.
fn next_round(planned: u32, spp: Option<u32>) -> u32 {
    planned.saturating_mul(2).min(spp.unwrap_or(u32::MAX))
}

/// Samples a pixel before the film is first asked for its error: one for each replicate.
const FIRST_LOOK: u32 = 8;

/// The least factor by which the samples grow between two looks.
const SMALLEST_STEP: f64 = 1.04;

/// At least one sample further.
fn next_look(spp: u32, factor: f64) -> u32 {
    ((spp as f64 * factor).ceil() as u32).max(spp.saturating_add(1))
}
