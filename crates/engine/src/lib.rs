//! The engines of the wavepath path tracer: two ways to execute one definition of a path, the film that they fill, and
//! the plan that says what a scene needs.
//!
//! [`wavefront`] runs batch kernels over pools of paths; [`megakernel`] follows one path at a time. Both draw the same
//! random numbers and share the estimator, down to the bit.

#![deny(missing_docs)]

pub mod adaptive;
pub mod film;
pub mod megakernel;
pub mod plan;
pub mod schedule;
pub mod session;
pub mod stats;
pub mod team;
pub mod wavefront;

use crate::film::{BlockSums, Film};
use crate::plan::Plan;
use schedule::{Schedule, Stop, Unit};
use session::{Session, SessionError};
use stats::Stats;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use wavepath_kernels::channels::Channel;
use wavepath_kernels::intersect::bvh2::NaiveBvh;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, Closest, Hit, Occluded, Policy, TraversalStack};
use wavepath_kernels::isa::{Isa, Level};
use wavepath_kernels::sampler::{Independent, Sampler, Sobol};
use wavepath_kernels::scene::Scene;
use wavepath_kernels::scene::lights::{LightKinds, NoLights, WithLights, with_lights};
use wavepath_kernels::shade::Features;

/// Which random numbers drive the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SamplerKind {
    /// Owen-scrambled Sobol points, padded 2D (Burley 2020).
    Sobol,
    /// Independent uniform numbers from a hash.
    Independent,
}

impl SamplerKind {
    /// All of them.
    pub const ALL: [SamplerKind; 2] = [SamplerKind::Sobol, SamplerKind::Independent];

    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self {
            SamplerKind::Sobol => "sobol",
            SamplerKind::Independent => "independent",
        }
    }
}

/// How paths are executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineKind {
    /// Stage by stage over pools of paths, in SIMD kernels.
    Wavefront,
    /// One path at a time, through a binary tree by obvhs' traversal: the naive baseline.
    Megakernel,
    /// One path at a time, through the wavefront's tree: tells what is layout and what is wavefront.
    MegakernelWide,
}

impl EngineKind {
    /// All of them.
    pub const ALL: [EngineKind; 3] =
        [EngineKind::Wavefront, EngineKind::Megakernel, EngineKind::MegakernelWide];

    /// Name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            EngineKind::Wavefront => "wavefront",
            EngineKind::Megakernel => "megakernel",
            EngineKind::MegakernelWide => "megakernel-wide",
        }
    }
}

/// What is chosen for a render, beside the scene.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Engine.
    pub engine: EngineKind,
    /// Random numbers.
    pub sampler: SamplerKind,
    /// Worker threads, at least 1.
    pub threads: usize,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Paths in the pool of each worker; 16 to 2^18, and what is outside counts as the nearest.
    pub batch: usize,
    /// Instruction set.
    pub level: Level,
    /// How rays go through the tree, wavefront engine.
    pub policy: Policy,
    /// More samples where the error is.
    pub adaptive: bool,
}

/// The tree that an engine traces rays through, built once a scene.
pub enum Tree<'a> {
    /// 8 wide.
    Bvh8(Bvh8<'a>),
    /// Binary, walked by obvhs.
    Naive(NaiveBvh<'a>),
}

impl<'a> Tree<'a> {
    /// Is it the tree of `scene`, for an engine of this kind?
    pub fn is_of(&self, scene: &Scene, engine: EngineKind) -> bool {
        let wide = matches!(engine, EngineKind::Wavefront | EngineKind::MegakernelWide);
        match self {
            Tree::Bvh8(tree) => wide && tree.is_of(scene.geometry()),
            Tree::Naive(tree) => !wide && tree.is_of(scene.geometry()),
        }
    }
    /// Builds the tree of an engine.
    pub fn build(engine: EngineKind, scene: &'a Scene) -> Self {
        match engine {
            EngineKind::Wavefront | EngineKind::MegakernelWide => Tree::Bvh8(Bvh8::new(scene.geometry())),
            EngineKind::Megakernel => Tree::Naive(NaiveBvh::new(scene.geometry())),
        }
    }
}

/// Ray by ray, as the megakernel asks: it is compiled once for both trees, and the choice costs a branch that never
/// misses.
impl Accelerator for Tree<'_> {
    const NAME: &'static str = "either";
    #[inline(always)]
    fn closest<I: Isa>(
        &self,
        isa: I,
        origin: [f32; 3],
        direction: [f32; 3],
        stack: &mut TraversalStack,
    ) -> Hit {
        match self {
            Tree::Bvh8(tree) => isa.run(Closest { accelerator: tree, origin, direction, stack }),
            Tree::Naive(tree) => isa.run(Closest { accelerator: tree, origin, direction, stack }),
        }
    }
    #[inline(always)]
    fn occluded<I: Isa>(
        &self,
        isa: I,
        origin: [f32; 3],
        direction: [f32; 3],
        distance: f32,
        stack: &mut TraversalStack,
    ) -> bool {
        match self {
            Tree::Bvh8(tree) => isa.run(Occluded { accelerator: tree, origin, direction, distance, stack }),
            Tree::Naive(tree) => isa.run(Occluded { accelerator: tree, origin, direction, distance, stack }),
        }
    }
    fn bounds(&self) -> [[f32; 3]; 2] {
        match self {
            Tree::Bvh8(tree) => tree.bounds(),
            Tree::Naive(tree) => tree.bounds(),
        }
    }
    fn stack(&self) -> TraversalStack {
        match self {
            Tree::Bvh8(tree) => tree.stack(),
            Tree::Naive(tree) => tree.stack(),
        }
    }
    fn bytes(&self) -> usize {
        match self {
            Tree::Bvh8(tree) => tree.bytes(),
            Tree::Naive(tree) => tree.bytes(),
        }
    }
}

/// What is done so far, for those who watch.
#[derive(Debug, Default)]
pub struct Done {
    /// Pixel samples.
    pub samples: AtomicU64,
    /// Rays.
    pub rays: AtomicU64,
}

/// What all workers of a render share. Its parts belong together: kernels rely on it.
pub struct Job<'a> {
    scene: &'a Scene,
    plan: &'a Plan,
    film: &'a Film,
    schedule: &'a Schedule<'a>,
    seed: u64,
    policy: Policy,
    done: &'a Done,
}

impl<'a> Job<'a> {
    /// Work on a scene by its plan, given out by `schedule`, whose samples go into `film`; what is done so far is told in
    /// `done`. The seed is that of the random numbers; the policy says how rays go through the tree, wavefront engine.
    ///
    /// # Errors
    /// [`SessionError::Foreign`] if the plan is another scene's, or the film or the schedule were made for another.
    pub fn new(
        scene: &'a Scene,
        plan: &'a Plan,
        film: &'a Film,
        schedule: &'a Schedule<'a>,
        (seed, policy): (u64, Policy),
        done: &'a Done,
    ) -> Result<Self, SessionError> {
        check_together(scene, plan, film)?;
        if !schedule.is_of(film) {
            return Err(SessionError::Foreign { what: "schedule", of: "another film" });
        }
        Ok(Job { scene, plan, film, schedule, seed, policy, done })
    }
}

/// Checks that plan and film are made for a scene.
fn check_together(scene: &Scene, plan: &Plan, film: &Film) -> Result<(), SessionError> {
    if plan.scene() != scene.id() {
        return Err(SessionError::Foreign { what: "plan", of: "another scene" });
    }
    let (film, requirements) = (film.header(), plan.requirements());
    if film.filter_weights != requirements.filter_weights {
        return Err(SessionError::Foreign { what: "film", of: "another filter" });
    }
    if !requirements.channels.iter().map(Channel::row).eq(film.channels.iter().copied()) {
        return Err(SessionError::Foreign { what: "film", of: "other channels" });
    }
    Ok(())
}

/// Adds a complete work unit to the film.
fn add_to_film(job: &Job, unit: &Unit, sums: &BlockSums, stats: &mut Stats) {
    // A schedule gives out what the film does not have. If someone else has added it since, these are the same samples.
    let _ = job.film.add(*unit, sums);
    let samples = job.film.blocks()[unit.block].pixels() as u64 * unit.samples as u64;
    job.done.samples.fetch_add(samples, Ordering::Relaxed);
    job.done.rays.fetch_add(stats.unpublished(), Ordering::Relaxed);
}

/// Features as the plan has them.
#[derive(Clone, Copy, Debug)]
struct Planned<S, L>(PhantomData<(S, L)>);

impl<S: Sampler, L: LightKinds> Features for Planned<S, L> {
    type Sampler = S;
    type Lights = L;
    type General = Planned<S, L::General>;
    type Specular = Planned<S, NoLights>;
}

/// Renders until the rule says stop; `watch` is called about ten times a second meanwhile. Returns what all workers
/// counted, and how long it took.
///
/// # Errors
/// [`SessionError`] if it cannot begin.
pub fn render(
    scene: &Scene,
    plan: &Plan,
    tree: &Tree,
    film: &Film,
    settings: &Settings,
    stop: Stop,
    watch: impl FnMut(&Done),
) -> Result<(Stats, Duration), SessionError> {
    let time = stop.time;
    let mut session = Session::new(scene, plan, tree, film, settings, stop)?;
    session.run(time, watch);
    Ok((session.stats().clone(), session.elapsed()))
}

/// Runs the engine. Not generic, and not to be inlined into what is: every crate that calls [`render`] would compile
/// all kernels again, which takes minutes.
#[inline(never)]
fn execute(pool: &rayon::ThreadPool, job: &Job, tree: &Tree, settings: &Settings) -> Stats {
    match settings.sampler {
        SamplerKind::Sobol => with_sampler::<Sobol>(pool, job, tree, settings),
        SamplerKind::Independent => with_sampler::<Independent>(pool, job, tree, settings),
    }
}

/// Runs `work` on a thread of its own and calls `watch` on this one until it is done.
fn watched<R: Send>(done: &Done, mut watch: impl FnMut(&Done), work: impl FnOnce() -> R + Send) -> R {
    std::thread::scope(|scope| {
        let (send, receive) = std::sync::mpsc::channel();
        let worker = scope.spawn(move || {
            let result = work();
            // The receiver waits for this.
            let _ = send.send(());
            result
        });
        while let Err(std::sync::mpsc::RecvTimeoutError::Timeout) =
            receive.recv_timeout(Duration::from_millis(100))
        {
            watch(done);
        }
        match worker.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    })
}

fn with_sampler<S: Sampler>(pool: &rayon::ThreadPool, job: &Job, tree: &Tree, settings: &Settings) -> Stats {
    let work = Work { pool, job, tree, settings, sampler: PhantomData::<S> };
    let workers = with_lights(job.plan.light_kinds(), work);
    workers.iter().fold(Stats::default(), |mut sum, worker| {
        sum.merge(worker);
        sum
    })
}

/// What all workers of a pool do.
struct Work<'a, S> {
    pool: &'a rayon::ThreadPool,
    job: &'a Job<'a>,
    tree: &'a Tree<'a>,
    settings: &'a Settings,
    sampler: PhantomData<S>,
}

impl<S: Sampler> WithLights for Work<'_, S> {
    type Output = Vec<Stats>;
    fn run<L: LightKinds>(self) -> Vec<Stats> {
        let Work { pool, job, tree, settings, .. } = self;
        let (level, batch) = (settings.level, settings.batch);
        match settings.engine {
            EngineKind::Wavefront => {
                let Tree::Bvh8(accelerator) = tree else { unreachable!("built for this engine") };
                pool.broadcast(|_| {
                    let features = PhantomData::<Planned<S, L>>;
                    level.run(wavefront::Worker { job, accelerator, batch, features })
                })
            }
            EngineKind::Megakernel | EngineKind::MegakernelWide => pool.broadcast(|_| {
                level.run(megakernel::Worker { job, tree, features: PhantomData::<Planned<S, L>> })
            }),
        }
    }
}
