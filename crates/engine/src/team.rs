//! A render by several processes: one has the schedule, and gives units of it to the others.
//!
//! A unit is what it is, whoever renders it, and films add up exactly; so the picture has the same bits for any number of
//! processes. How units and films travel is not this crate's affair: a [`Helpers`] stands for the others where the schedule
//! is, a [`Feed`] for the schedule where the others are.

use super::schedule::{Schedule, Unit};
use super::session::SessionError;
use super::stats::Stats;
use super::{Done, Job, Settings, Tree, check_together, execute};
use crate::film::replicates::REPLICATES;
use crate::film::{Film, Header};
use crate::plan::Plan;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use wavepath_kernels::scene::Scene;

/// Others who take units of a render.
pub trait Helpers: Sync {
    /// Threads that render there.
    fn workers(&self) -> usize;

    /// Gives out units of a schedule, on a thread of its own beside the workers of this process. Returns what the others
    /// counted, once there is nothing more to give out and the samples of all that was given out are in the film. What they
    /// have done meanwhile is told in `done`.
    fn work(&self, schedule: &Schedule, film: &Film, done: &Done) -> Stats;
}

/// Units that come from elsewhere.
#[derive(Debug)]
pub struct Feed {
    blocks: usize,
    queue: Mutex<Queue>,
    changed: Condvar,
    /// Nanoseconds that workers had nothing to do, added up.
    waited: AtomicU64,
}

#[derive(Debug, Default)]
struct Queue {
    units: VecDeque<Unit>,
    is_closed: bool,
}

impl Feed {
    /// Of units of a film like this one.
    pub fn new(film: &Film) -> Self {
        Feed {
            blocks: film.blocks().len(),
            queue: Mutex::default(),
            changed: Condvar::new(),
            waited: AtomicU64::new(0),
        }
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a unit; false if there can be no such unit.
    pub fn push(&self, unit: Unit) -> bool {
        let is_right = unit.block < self.blocks
            && unit.replicate < REPLICATES
            && (1..=Schedule::CHUNK).contains(&unit.samples)
            && unit.first.checked_add(unit.samples).is_some();
        if is_right {
            self.queue().units.push_back(unit);
            self.changed.notify_one();
        }
        is_right
    }

    /// There are no more.
    pub fn close(&self) {
        self.queue().is_closed = true;
        self.changed.notify_all();
    }

    /// Units that nobody has taken yet.
    pub fn waiting(&self) -> usize {
        self.queue().units.len()
    }

    /// How long workers had nothing to do, added up over all of them.
    pub fn waited(&self) -> Duration {
        Duration::from_nanos(self.waited.load(Ordering::Relaxed))
    }

    /// Takes the next one, and waits for it; none once there are no more.
    pub(crate) fn take(&self) -> Option<Unit> {
        let mut queue = self.queue();
        loop {
            if let Some(unit) = queue.units.pop_front() {
                return Some(unit);
            }
            if queue.is_closed {
                return None;
            }
            let began = Instant::now();
            queue = self.changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
            self.waited.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
        }
    }
}

/// Renders what a feed brings into an empty film, until the feed is closed. Returns what the workers counted.
///
/// # Errors
/// As [`super::session::Session::new`].
#[allow(clippy::too_many_arguments, reason = "they are the parts of a render")]
pub fn work(
    scene: &Scene,
    plan: &Plan,
    tree: &Tree,
    film: &Film,
    settings: &Settings,
    pool: &rayon::ThreadPool,
    feed: Arc<Feed>,
    done: &Done,
) -> Result<Stats, SessionError> {
    settings.check()?;
    check_together(scene, plan, film)?;
    if !tree.is_of(scene, settings.engine) {
        return Err(SessionError::Foreign { what: "tree", of: "another scene or engine" });
    }
    let header = Header::of_render(film.header().frame, plan.requirements(), settings);
    film.header().check_same(&Header { parts: film.parts(), ..header })?;
    if feed.blocks != film.blocks().len() {
        return Err(SessionError::Foreign { what: "feed", of: "another film" });
    }
    let schedule = Schedule::fed(film, feed);
    let job =
        Job { scene, plan, film, schedule: &schedule, seed: settings.seed, policy: settings.policy, done };
    Ok(execute(pool, &job, tree, settings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::tests::film;

    #[test]
    fn a_feed_gives_what_it_gets_and_ends() {
        let film = film(40, 20);
        let feed = Arc::new(Feed::new(&film));
        let unit = Unit { block: 1, replicate: 2, first: 16, samples: 16 };
        let schedule = Schedule::fed(&film, Arc::clone(&feed));
        std::thread::scope(|scope| {
            let worker = scope.spawn(|| std::iter::from_fn(|| schedule.take()).count());
            for k in 0..100 {
                assert!(feed.push(Unit { first: 16 * k, ..unit }));
            }
            feed.close();
            assert_eq!(worker.join().unwrap(), 100);
        });
        assert_eq!((schedule.take(), feed.waiting()), (None, 0));
        for wrong in [
            Unit { block: 1000, ..unit },
            Unit { replicate: 8, ..unit },
            Unit { samples: 0, ..unit },
            Unit { samples: 17, ..unit },
            Unit { first: u32::MAX, ..unit },
        ] {
            assert!(!feed.push(wrong), "{wrong:?}");
        }
    }
}
