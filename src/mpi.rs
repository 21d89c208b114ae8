//! A render by the processes that `mpirun` (or `srun`) has started: they share the samples, and the first has the picture.
//!
//! Rank 0 has the schedule. The others ask it for work units as theirs run out, so that fast machines do more; when there is
//! none left, their films are added up along a tree, exactly. So the bits are those of one process, for any number of ranks
//! and threads, also with `--adaptive` and `--error`, which decide by the whole film.
//!
//! Messages go between rank 0 and the others, but for films, which go along the tree:
//!
//! | message | from | holds |
//! |---|---|---|
//! | `HELLO` | others, once | what is rendered (it must be the same everywhere), threads, host |
//! | `WANT` | others | units wanted; samples and rays since the last one |
//! | `UNITS` | rank 0 | what to do, and the units |
//! | `FILM` | each to its parent in the tree | bytes of a film, in pieces |
//! | `COUNTS` | others | what their workers counted |
//!
//! Nobody spins: who waits for a message looks for it now and then, and the processors belong to the workers.

use crate::bench::scale::stock;
use crate::engine::schedule::{Schedule, Unit};
use crate::engine::stats::{Stage, Stats};
use crate::engine::team::{self, Feed, Helpers};
use crate::engine::{Done, EngineKind};
use crate::film::Film;
use crate::render::{Render, RenderError};
use crate::report::Rank;
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

const HELLO: i32 = 1;
const WANT: i32 = 2;
const UNITS: i32 = 3;
const FILM: i32 = 4;
const COUNTS: i32 = 5;

/// First number of a message `UNITS`: units follow.
const WORK: u32 = 0;
/// End what is there, and hand in the film.
const HAND_IN: u32 = 1;
/// The render is over.
const STOP: u32 = 2;

/// A film goes in pieces of so many bytes: lengths are 32 bits in MPI.
const PIECE: usize = 1 << 28;

/// Longest time between two looks for a message: a small part of a stock. Looking more often costs time of the workers.
const PATIENCE: Duration = Duration::from_millis(2);

/// Most units of a message.
const MOST_UNITS: u64 = 1 << 16;

/// What launchers set for the processes that they start.
const LAUNCHED: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK", "MPI_LOCALNRANKS"];

/// The processes that were started together, of which this is one.
pub struct World {
    communicator: SimpleCommunicator,
    /// Ends MPI when it is dropped.
    _universe: Universe,
}

// SAFETY: a communicator is a handle that any thread may use if MPI was started for threads, one at a time: `join` refuses
// less than that. The thread that calls changes hands only where one ends and another goes on: a render's helper thread begins
// after the hellos, and `finish` comes after it.
unsafe impl Sync for World {}

/// What a process has to say about itself.
#[derive(Clone, Debug, PartialEq)]
struct Hello {
    identity: String,
    threads: usize,
    host: String,
}

impl World {
    /// Joins the other processes, if a launcher has started this one together with some.
    ///
    /// # Errors
    /// In words, if MPI is there but cannot be used.
    pub fn join() -> Result<Option<World>, String> {
        if !LAUNCHED.iter().any(|name| std::env::var_os(name).is_some()) {
            return Ok(None);
        }
        let (universe, threading) =
            mpi::initialize_with_threading(mpi::Threading::Serialized).ok_or("MPI was started before")?;
        if threading < mpi::Threading::Serialized {
            return Err(format!(
                "this MPI supports {threading:?} only; expected one for threads, Serialized"
            ));
        }
        let communicator = universe.world();
        let world = World { communicator, _universe: universe };
        Ok((world.size() > 1).then_some(world))
    }

    /// Number of this process.
    pub fn rank(&self) -> usize {
        self.communicator.rank() as usize
    }

    /// How many there are.
    pub fn size(&self) -> usize {
        self.communicator.size() as usize
    }

    /// Ends all processes.
    pub fn abort(&self, status: u8) -> ! {
        self.communicator.abort(status.into())
    }

    fn send<T: Equivalence>(&self, rank: usize, tag: i32, message: &[T]) {
        self.communicator.process_at_rank(rank as i32).send_with_tag(message, tag);
    }

    /// Waits for a message.
    fn receive<T: Equivalence>(&self, rank: usize, tag: i32) -> Vec<T> {
        let source = self.communicator.process_at_rank(rank as i32);
        wait(|| source.immediate_probe_with_tag(tag));
        source.receive_vec_with_tag(tag).0
    }

    /// The rank whose message of this kind is there, if there is one.
    fn waiting(&self, tag: i32) -> Option<usize> {
        let status = self.communicator.any_process().immediate_probe_with_tag(tag)?;
        Some(status.source_rank() as usize)
    }

    fn send_film(&self, rank: usize, film: &Film) {
        let bytes = film.to_bytes();
        self.send(rank, FILM, &[bytes.len() as u64]);
        bytes.chunks(PIECE).for_each(|piece| self.send(rank, FILM, piece));
    }

    fn receive_film(&self, rank: usize) -> Result<Film, String> {
        let length = self.receive::<u64>(rank, FILM).first().copied().unwrap_or(0);
        let mut bytes: Vec<u8> = Vec::new();
        while (bytes.len() as u64) < length {
            let piece = self.receive::<u8>(rank, FILM);
            if piece.is_empty() {
                return Err("it ends too soon".into());
            }
            bytes.extend(piece);
        }
        Film::from_bytes(&bytes).map_err(|error| error.to_string())
    }

    /// Adds up the films of all ranks in that of rank 0: along a binomial tree, rank r + 2^k to rank r.
    fn reduce(&self, film: &Film) -> Result<(), String> {
        let (rank, size) = (self.rank(), self.size());
        let mut bit = 1;
        while bit < size {
            if rank & bit != 0 {
                self.send_film(rank - bit, film);
                return Ok(());
            }
            if rank + bit < size {
                let other = self
                    .receive_film(rank + bit)
                    .and_then(|other| film.merge(&other).map_err(|error| error.to_string()));
                other.map_err(|error| format!("the film of rank {}: {error}", rank + bit))?;
            }
            bit *= 2;
        }
        Ok(())
    }

    /// Says what this process renders, and learns of the others; rank 0 checks that it is the same everywhere.
    fn meet(&self, own: &Hello) -> Result<Vec<Hello>, String> {
        if self.rank() > 0 {
            let text = format!("{}\n{}\n{}", own.threads, own.host, own.identity);
            self.send(0, HELLO, text.as_bytes());
            return Ok(Vec::new());
        }
        let mut all = vec![own.clone()];
        for rank in 1..self.size() {
            let text = String::from_utf8_lossy(&self.receive::<u8>(rank, HELLO)).into_owned();
            let mut lines = text.splitn(3, '\n');
            let threads = lines.next().and_then(|threads| threads.parse().ok()).unwrap_or(1);
            let host = lines.next().unwrap_or_default().to_string();
            let identity = lines.next().unwrap_or_default().to_string();
            if identity != own.identity {
                let differs = identity.lines().zip(own.identity.lines()).find(|(a, b)| a != b);
                let (theirs, ours) = differs.unwrap_or(("another number of lines", ""));
                return Err(format!(
                    "rank {rank} on {host} renders something else: it has {theirs}, rank 0 has {ours}"
                ));
            }
            all.push(Hello { identity, threads, host });
        }
        Ok(all)
    }
}

/// Looks until something is there, and sleeps in between.
fn wait<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let mut pause = Duration::from_micros(20);
    loop {
        if let Some(found) = look() {
            return found;
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(PATIENCE);
    }
}

/// What must be the same for all, a line each.
fn identity(render: &Render) -> String {
    let (scene, settings) = (render.scene(), render.settings());
    let header = crate::engine::film::Header::of_render(
        scene.description().film.frame(),
        render.plan().requirements(),
        settings,
    );
    let hash = xxhash_rust::xxh3::xxh3_128(format!("{:?}", scene.description()).as_bytes());
    format!(
        "scene {hash:032x}\n{} bytes of geometry\nfilm {header:?}\nversion {}",
        scene.plan().geometry_bytes,
        env!("CARGO_PKG_VERSION")
    )
}

fn hello(render: &Render) -> Hello {
    let host = mpi::environment::processor_name().unwrap_or_default();
    Hello { identity: identity(render), threads: render.settings().threads, host }
}

/// Rank 0's view of the others.
pub struct Dealer<'w> {
    world: &'w World,
    hellos: Vec<Hello>,
    /// Films are handed in so often, for checkpoints.
    hand_in_every: Option<Duration>,
    ranks: Mutex<Vec<Counted>>,
    /// What ranks ask that have handed in their films, while others have not.
    early: Mutex<VecDeque<(usize, Vec<u64>)>>,
}

/// What a rank has done.
#[derive(Clone, Debug, Default)]
struct Counted {
    samples: u64,
    /// Time of workers, added up, in which they rendered.
    busy: Duration,
}

impl<'w> Dealer<'w> {
    /// For rank 0: waits until all processes have read the scene.
    ///
    /// # Errors
    /// In words, if they render something else.
    pub fn new(world: &'w World, render: &Render, hand_in_every: Option<Duration>) -> Result<Self, String> {
        let hellos = world.meet(&hello(render))?;
        let ranks = Mutex::new(vec![Counted::default(); world.size()]);
        Ok(Dealer { world, hellos, hand_in_every, ranks, early: Mutex::default() })
    }

    /// Lets the others go home; what all have done. `elapsed` is the time of the render, `busy` that of all workers in seconds,
    /// `samples` what they took.
    pub fn finish(&self, elapsed: Duration, busy: f64, samples: u64) -> Vec<Rank> {
        for _ in 1..self.world.size() {
            let (rank, _) = self.next_want();
            self.world.send(rank, UNITS, &[STOP]);
        }
        let mut counted = self.ranks.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let others: u64 = counted.iter().map(|rank| rank.samples).sum();
        let others_busy: f64 = counted.iter().map(|rank| rank.busy.as_secs_f64()).sum();
        counted[0] = Counted {
            samples: samples.saturating_sub(others),
            busy: Duration::try_from_secs_f64(busy - others_busy).unwrap_or_default(),
        };
        let of_rank = |(rank, (counted, hello)): (usize, (&Counted, &Hello))| {
            let seconds = counted.busy.as_secs_f64() / hello.threads.max(1) as f64;
            Rank {
                rank,
                host: hello.host.clone(),
                threads: hello.threads,
                samples: counted.samples,
                busy_seconds: seconds,
                samples_per_second: if seconds > 0.0 { counted.samples as f64 / seconds } else { 0.0 },
                busy: (seconds / elapsed.as_secs_f64().max(1e-9)).min(1.0),
            }
        };
        counted.iter().zip(&self.hellos).enumerate().map(of_rank).collect()
    }

    /// Who wants units next.
    fn next_want(&self) -> (usize, Vec<u64>) {
        let early = self.early.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
        early.unwrap_or_else(|| {
            let rank = wait(|| self.world.waiting(WANT));
            (rank, self.world.receive::<u64>(rank, WANT))
        })
    }

    /// Gives out units until there are none, or films are to be handed in. Returns whether there are none.
    fn deal(&self, schedule: &Schedule, done: &Done) -> bool {
        let others = self.world.size() - 1;
        let due = self.hand_in_every.map(|every| Instant::now() + every);
        let (mut told, mut is_over) = (0, false);
        let mut is_told = vec![false; self.world.size()];
        let mut early = VecDeque::new();
        while told < others {
            let (rank, message) = self.next_want();
            if is_told[rank] {
                // It is through, and asks for what comes next.
                early.push_back((rank, message));
                continue;
            }
            let number = |at: usize| message.get(at).copied().unwrap_or(0);
            done.samples.fetch_add(number(1), Ordering::Relaxed);
            done.rays.fetch_add(number(2), Ordering::Relaxed);
            if told == 0 && due.is_some_and(|due| Instant::now() >= due) {
                (told, is_told[rank]) = (told + 1, true);
                self.world.send(rank, UNITS, &[HAND_IN]);
                continue;
            }
            let mut reply = vec![WORK];
            if told == 0 {
                // Less at the end, so that all come to it together.
                let share = schedule.remaining() / (2 * self.world.size() as u64);
                for _ in 0..number(0).clamp(1, MOST_UNITS).min(share.max(1)) {
                    let Some(Unit { block, replicate, first, samples }) = schedule.take() else {
                        is_over = true;
                        break;
                    };
                    reply.extend([block as u32, replicate, first, samples]);
                }
            }
            if reply.len() == 1 {
                (told, is_told[rank]) = (told + 1, true);
                reply[0] = HAND_IN;
            }
            self.world.send(rank, UNITS, &reply);
        }
        *self.early.lock().unwrap_or_else(PoisonError::into_inner) = early;
        is_over
    }

    /// Films and counts of the others.
    fn collect(&self, film: &Film, stats: &mut Stats) -> Result<(), String> {
        self.world.reduce(film)?;
        for rank in 1..self.world.size() {
            let numbers = self.world.receive::<u64>(rank, COUNTS);
            let [samples, busy, counts @ ..] = numbers.as_slice() else {
                return Err(format!("rank {rank} has lost count"));
            };
            stats.merge(&Stats::from_numbers(counts));
            let mut ranks = self.ranks.lock().unwrap_or_else(PoisonError::into_inner);
            ranks[rank].samples += samples;
            ranks[rank].busy += Duration::from_nanos(*busy);
        }
        Ok(())
    }
}

impl Helpers for Dealer<'_> {
    fn workers(&self) -> usize {
        self.hellos.iter().skip(1).map(|hello| hello.threads).sum()
    }

    fn work(&self, schedule: &Schedule, film: &Film, done: &Done) -> Stats {
        let mut stats = Stats::default();
        loop {
            let is_over = self.deal(schedule, done);
            if let Err(error) = self.collect(film, &mut stats) {
                eprintln!("error: {error}");
                self.world.abort(1);
            }
            if is_over {
                return stats;
            }
        }
    }
}

/// For the other ranks: renders what rank 0 gives out, until it is over.
///
/// # Errors
/// [`RenderError`] if it cannot begin.
pub fn help(world: &World, render: &Render) -> Result<(), RenderError> {
    render.check()?;
    let (scene, plan, settings) = (render.scene(), render.plan(), render.settings());
    let tree = scene.tree(settings.engine);
    let threads = settings.threads;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|reason| RenderError::Threads { threads, reason: reason.to_string() })?;
    // Rank 0 says what is wrong.
    let _ = world.meet(&hello(render));
    // Units a second, to be found out.
    let mut rate = 0.0;
    loop {
        let film = render.film()?;
        let feed = Arc::new(Feed::new(&film));
        let done = Done::default();
        let (mut taken, began) = (0u64, Instant::now());
        let mut told = [0; 2];
        let (stats, is_over) = std::thread::scope(|scope| {
            let feed_of_workers = Arc::clone(&feed);
            let (pool, film, tree, done) = (&pool, &film, &tree, &done);
            let work = scope.spawn(move || {
                team::work(scene.tables(), plan, tree, film, settings, pool, feed_of_workers, done)
            });
            let is_over = loop {
                let stock = ((rate * stock(world.size()).as_secs_f64()) as usize).max(2 * threads);
                if feed.waiting() >= stock {
                    std::thread::sleep(PATIENCE);
                    continue;
                }
                let now = [done.samples.load(Ordering::Relaxed), done.rays.load(Ordering::Relaxed)];
                world.send(0, WANT, &[stock as u64, now[0] - told[0], now[1] - told[1]]);
                told = now;
                let reply = world.receive::<u32>(0, UNITS);
                for unit in reply.get(1..).unwrap_or_default().chunks_exact(4) {
                    let &[block, replicate, first, samples] = unit else { unreachable!("chunks of four") };
                    taken += 1;
                    if !feed.push(Unit { block: block as usize, replicate, first, samples }) {
                        eprintln!("error: rank {}: there is no such work unit", world.rank());
                        world.abort(1);
                    }
                }
                match reply.first() {
                    Some(&WORK) => {}
                    first => {
                        feed.close();
                        break first != Some(&HAND_IN);
                    }
                }
                let elapsed = began.elapsed().as_secs_f64();
                if elapsed > 0.02 {
                    rate = (taken - feed.waiting() as u64) as f64 / elapsed;
                }
            };
            let stats = match work.join() {
                Ok(stats) => stats,
                Err(panic) => std::panic::resume_unwind(panic),
            };
            (stats, is_over)
        });
        let mut stats = stats?;
        if is_over {
            return Ok(());
        }
        let samples: u64 = done.samples.load(Ordering::Relaxed);
        if let Err(error) = world.reduce(&film) {
            eprintln!("error: rank {}: {error}", world.rank());
            world.abort(1);
        }
        // Waiting for units belongs to the stage that takes them.
        let taking = match settings.engine {
            EngineKind::Wavefront => Stage::Generate,
            _ => Stage::Megakernel,
        };
        let taking = &mut stats.stages[taking as usize];
        *taking = taking.saturating_sub(feed.waited());
        let busy: Duration = stats.stages.iter().sum();
        let mut numbers = vec![samples, busy.as_nanos() as u64];
        numbers.extend(stats.to_numbers());
        world.send(0, COUNTS, &numbers);
    }
}
