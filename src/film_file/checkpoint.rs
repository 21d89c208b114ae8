//! Checkpoints: film files that are written while the film goes on growing.

use super::{About, Identity, save};
use crate::engine::session::{Ended, Rounds};
use crate::film::Film;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Time between two checkpoints, unless it is chosen, or would take more than half a per cent of the time.
pub const DEFAULT_INTERVAL: Duration = Duration::from_secs(60);

/// Where no interval is chosen, writing takes at most this part of the time of all threads.
const COST: f64 = 0.005;

/// Called after each checkpoint, also one that could not be written.
type Told<'s> = Box<dyn Fn(&io::Result<Duration>) + Send + Sync + 's>;

/// Where a render keeps what it has, and how often. [`crate::Render::checkpoint`] takes it.
pub struct Checkpoint<'s> {
    path: PathBuf,
    every: Option<Duration>,
    until_done: bool,
    told: Told<'s>,
}

impl fmt::Debug for Checkpoint<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Checkpoint")
            .field("path", &self.path)
            .field("every", &self.every)
            .finish_non_exhaustive()
    }
}

impl<'s> Checkpoint<'s> {
    /// Into this file: every minute, or as seldom that it takes half a per cent of the time; and at the end.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Checkpoint { path: path.into(), every: None, until_done: false, told: Box::new(|_| ()) }
    }
    /// Time from one to the next.
    pub fn every(mut self, interval: Duration) -> Self {
        self.every = Some(interval);
        self
    }
    /// None at the end of a render that was not interrupted: its picture is all that is wanted.
    pub fn until_done(mut self) -> Self {
        self.until_done = true;
        self
    }
    /// Calls `told` after each one, from another thread, with the time that it took. One that could not be written has left the
    /// last good one as it was, and the render goes on.
    pub fn on_written(mut self, told: impl Fn(&io::Result<Duration>) + Send + Sync + 's) -> Self {
        self.told = Box::new(told);
        self
    }
    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// After one that took so long, on one of so many threads.
    fn interval(&self, took: Duration, threads: usize) -> Duration {
        let least = took.div_f64(COST * threads.max(1) as f64);
        self.every.unwrap_or_else(|| least.max(DEFAULT_INTERVAL))
    }
}

/// What a render has done so far, for those who look from another thread.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    /// Pixel samples.
    pub(crate) samples: AtomicU64,
    /// Rays.
    pub(crate) rays: AtomicU64,
    /// The render has ended: what is being written is given up.
    pub(crate) is_over: AtomicBool,
}

/// All that checkpoints of a render are made of.
pub(crate) struct Checkpoints<'a> {
    pub(crate) checkpoint: &'a Checkpoint<'a>,
    pub(crate) film: &'a Film,
    pub(crate) identity: &'a Identity,
    pub(crate) progress: &'a Progress,
    pub(crate) threads: usize,
    /// Where the render is, if it decides by what it sees. No round begins while one is written: what is in the file is of
    /// this round.
    pub(crate) rounds: Option<Rounds>,
}

impl Checkpoints<'_> {
    /// Writes one after another until the other end of the channel is gone.
    pub(crate) fn keep_writing(&self, about: impl Fn() -> About, end: &Receiver<()>) {
        let mut interval = self.checkpoint.interval(Duration::ZERO, self.threads);
        while end.recv_timeout(interval) == Err(RecvTimeoutError::Timeout) {
            let written = self.write_one(&about(), Some(&self.progress.is_over));
            if let Ok(took) = &written {
                interval = self.checkpoint.interval(*took, self.threads);
            }
            // What was given up comes at the end.
            if !self.progress.is_over.load(Ordering::Relaxed) || written.is_ok() {
                (self.checkpoint.told)(&written);
            }
        }
    }

    /// The last one.
    pub(crate) fn finish(&self, about: &About, ended: Ended) {
        if self.checkpoint.until_done && ended != Ended::Interrupt {
            return;
        }
        (self.checkpoint.told)(&self.write_one(about, None));
    }

    fn write_one(&self, about: &About, given_up: Option<&AtomicBool>) -> io::Result<Duration> {
        let started = Instant::now();
        let round = self.rounds.as_ref().map(|rounds| rounds.lock().unwrap_or_else(PoisonError::into_inner));
        save(&self.checkpoint.path, self.film, self.identity, about, round.as_deref(), given_up)?;
        Ok(started.elapsed())
    }
}
