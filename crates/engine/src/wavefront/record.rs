//! Records what the stages of a round are given, so that each can be run again by itself: for benches and for whoever
//! wants to look at the queues of a real scene.

use super::super::{EngineKind, Job, Planned, SamplerKind, Settings};
use super::Pool;
use crate::session::SessionError;
use std::marker::PhantomData;
use std::ops::{ControlFlow, Range};
use wavepath_kernels::intersect::RayClass;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::isa::{Isa, Kernel, Level};
use wavepath_kernels::material_sort::{Sorted, list};
use wavepath_kernels::queue::{HitQueue, OrderLists, PathQueue, ShadowQueue, SlotTable};
use wavepath_kernels::sampler::Sobol;
use wavepath_kernels::scene::MaterialClass;
use wavepath_kernels::scene::lights::{AllLights, NoLights};
use wavepath_kernels::shade::Features;

/// The queues of one round, each as the first stage that reads it found it.
#[derive(Clone, Debug)]
pub struct Round {
    /// Rays for `intersect`.
    pub paths: PathQueue,
    /// So many of the paths have bounced; those behind them come from the camera.
    pub survivors: usize,
    /// What `intersect` found.
    pub hits: HitQueue,
    /// The slots after `generate`.
    pub slots: SlotTable,
    /// Index of the first sample of each work unit.
    pub first_sample: Vec<u32>,
    /// Free slots.
    pub free: usize,
    /// The lists as `material_sort` left them.
    pub order: OrderLists,
    /// Where the lists of `order` are.
    pub sorted: Sorted,
    /// Rays towards lights, of all paths.
    pub shadows: ShadowQueue,
    /// The pieces in which they were traced: places in `shadows`.
    pub shadow_runs: Vec<(Range<usize>, RayClass)>,
    /// Paths that left a surface, for `roulette_compact`.
    pub scattered: PathQueue,
    /// The slots after `light_sample`.
    pub lit_slots: SlotTable,
    /// Slots of the paths that ended in this round, for the film.
    pub finished: Vec<u32>,
}

impl Round {
    /// Places in `paths` of those that `shade` scatters from a class of materials: first those that have bounced, then
    /// those from the camera.
    pub fn list(&self, class: MaterialClass) -> &[u32] {
        &self.order.list[self.sorted.range(list::of(class))]
    }
}

/// Executes a job as one worker of the wavefront does, and hands over each round, until `each` breaks or there is
/// nothing left to do.
///
/// The numbers are [`Sobol`]'s. Not generic, and only over kernels that a render needs anyway: it costs no build time.
///
/// # Errors
/// [`SessionError`] if the tree is not of the job's scene, or there are too few or too many paths.
#[inline(never)]
pub fn record(
    job: &Job,
    accelerator: &Bvh8,
    batch: usize,
    level: Level,
    each: &mut dyn FnMut(Round) -> ControlFlow<()>,
) -> Result<(), SessionError> {
    if !accelerator.is_of(job.scene.geometry()) {
        return Err(SessionError::Foreign { what: "tree", of: "another scene" });
    }
    let (engine, sampler, policy) = (EngineKind::Wavefront, SamplerKind::Sobol, job.policy);
    Settings { engine, sampler, threads: 1, seed: job.seed, batch, level, policy, adaptive: false }
        .check()?;
    if job.plan.light_kinds() == 0 {
        let features = PhantomData::<Planned<Sobol, NoLights>>;
        level.run(Record { job, accelerator, batch, each, features });
    } else {
        let features = PhantomData::<Planned<Sobol, AllLights>>;
        level.run(Record { job, accelerator, batch, each, features });
    }
    Ok(())
}

struct Record<'r, 'a, P> {
    job: &'r Job<'r>,
    accelerator: &'r Bvh8<'a>,
    batch: usize,
    each: &'r mut dyn FnMut(Round) -> ControlFlow<()>,
    features: PhantomData<P>,
}

impl<P: Features> Kernel for Record<'_, '_, P> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        let mut pool = Pool::<P, _>::new(self.job, self.accelerator, self.batch);
        loop {
            pool.generate(isa);
            if pool.paths.len == 0 {
                return;
            }
            let round = pool.record_round(isa);
            if (self.each)(round).is_break() {
                return;
            }
        }
    }
}

impl<P: Features> Pool<'_, P, Bvh8<'_>> {
    /// A round as in [`Pool::work`], with a look at the queues between the stages.
    fn record_round<I: Isa>(&mut self, isa: I) -> Round {
        let (survivors, free, slots) = (self.survivors, self.free, self.slots.clone());
        self.intersect(isa, RayClass::Bounce, 0..survivors);
        self.intersect(isa, RayClass::Camera, survivors..self.paths.len);
        self.first_hits(isa);
        let (paths, hits) = (self.paths.clone(), self.hits.clone());
        let sorted = self.material_sort(isa);
        let order = self.order.clone();
        self.light_met(isa, &sorted);
        let mut shadows = ShadowQueue::new(self.paths.capacity(), self.job.plan.requirements());
        let mut shadow_runs = Vec::new();
        for &class in self.job.plan.shade_kernels() {
            let textured = self.job.scene.programs().has_class(class);
            for (piece, coherent) in self.pieces(class, textured, &sorted) {
                if textured {
                    self.texture(isa, piece.clone());
                }
                self.shade(isa, class, textured, piece);
                if P::LIGHTS != 0 && self.shadows.len > 0 {
                    let start = shadows.len;
                    append(&mut shadows, &self.shadows);
                    let class = if coherent { RayClass::FirstShadow } else { RayClass::LaterShadow };
                    shadow_runs.push((start..shadows.len, class));
                    self.light_sample(isa, class);
                }
            }
        }
        let (scattered, lit_slots) = (self.scattered.clone(), self.slots.clone());
        let finished = self.roulette_compact(isa, &sorted);
        self.film(finished);
        let finished_slots = self.order.list[self.free - finished..self.free].to_vec();
        Round {
            paths,
            survivors,
            hits,
            slots,
            first_sample: self.first_sample.clone(),
            free,
            order,
            sorted,
            shadows,
            shadow_runs,
            scattered,
            lit_slots,
            finished: finished_slots,
        }
    }
}

/// Adds the rays of a queue to another.
fn append(to: &mut ShadowQueue, from: &ShadowQueue) {
    let (start, end) = (to.len, to.len + from.len);
    macro_rules! columns {
        ($($column:ident)*) => {$(to.$column[start..end].copy_from_slice(&from.$column[..from.len]);)*};
    }
    columns!(origin_x origin_y origin_z direction_x direction_y direction_z distance);
    columns!(radiance_r radiance_g radiance_b slot);
    to.len = end;
}
