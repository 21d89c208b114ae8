//! The wavefront engine: each worker owns a pool of paths that fits its cache and runs all stages over it, refilling
//! what ended. No barrier, and no counter shared between workers but the one that gives out work units.

use super::schedule::Unit;
use super::stats::{Laps, Stage, Stats};
use super::{Job, add_to_film};
use crate::film::BlockSums;
use std::marker::PhantomData;
use wavepath_kernels::generate::{Batch, Generate};
use wavepath_kernels::intersect::{Accelerator, Intersect, TraversalStack};
use wavepath_kernels::isa::{Isa, Kernel};
use wavepath_kernels::light_sample::LightSample;
use wavepath_kernels::material_sort::{MaterialSort, Sorted, list};
use wavepath_kernels::queue::{
    HitQueue, OrderLists, PIXEL_BITS, PathQueue, Requirements, SLOT_BITS, ShadowQueue, SlotTable,
};
use wavepath_kernels::roulette_compact::RouletteCompact;
use wavepath_kernels::scene::MaterialClass;
use wavepath_kernels::shade::emission::Emission;
use wavepath_kernels::shade::environment::Environment;
use wavepath_kernels::shade::{self, Features, Shade};

/// Paths of a pool, if the user does not say otherwise: 2 to 8 thousand were best, as they fit a 1 MiB L2.
pub const DEFAULT_BATCH: usize = 4096;

/// One worker of the engine.
pub struct Worker<'a, P, A> {
    /// What is rendered.
    pub job: &'a Job<'a>,
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// Paths in the pool.
    pub batch: usize,
    /// Features.
    pub features: PhantomData<P>,
}

impl<P: Features, A: Accelerator> Kernel for Worker<'_, P, A> {
    type Output = Stats;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> Stats {
        Pool::<P, A>::new(self.job, self.accelerator, self.batch).work(isa)
    }
}

/// A work unit some of whose paths are alive.
struct OpenUnit {
    unit: Unit,
    /// Paths that were started.
    started: usize,
    /// Paths that it has.
    paths: usize,
    /// Paths that ended.
    ended: usize,
    sums: BlockSums,
}

/// The paths of a worker, and all that it needs to advance them. Allocated once.
struct Pool<'a, P, A> {
    job: &'a Job<'a>,
    accelerator: &'a A,
    paths: PathQueue,
    scattered: PathQueue,
    hits: HitQueue,
    slots: SlotTable,
    shadows: ShadowQueue,
    /// Where each run of shadow rays ends, and whether they start at what the camera sees.
    shadow_classes: Vec<(usize, bool)>,
    order: OrderLists,
    /// Paths that have bounced; those behind them in the queue come from the camera.
    survivors: usize,
    /// Slots in `order.free`.
    free: usize,
    units: Vec<OpenUnit>,
    free_units: Vec<u32>,
    /// The unit whose paths are being started.
    current: Option<u32>,
    stack: TraversalStack,
    stats: Stats,
    features: PhantomData<P>,
}

impl<'a, P: Features, A: Accelerator> Pool<'a, P, A> {
    fn new(job: &'a Job<'a>, accelerator: &'a A, batch: usize) -> Self {
        let requirements: Requirements = job.plan.requirements;
        // Units end in any order: room for those that hold the paths, and as many with stragglers.
        let unit_count = 2 * batch.div_ceil(job.schedule.unit_paths()) + 6;
        let unit = || OpenUnit {
            unit: Unit { block: 0, replicate: 0, first: 0, samples: 0 },
            started: 0,
            paths: 0,
            ended: 0,
            sums: BlockSums::new(wavepath_kernels::generate::BLOCK_PIXELS, requirements),
        };
        let mut order = OrderLists::new(batch, requirements);
        for (k, slot) in order.free.iter_mut().enumerate() {
            // Slots are taken from the end: the first ones first.
            *slot = (batch.saturating_sub(k + 1)) as u32;
        }
        Pool {
            job,
            accelerator,
            paths: PathQueue::new(batch, requirements),
            scattered: PathQueue::new(batch, requirements),
            hits: HitQueue::new(batch, requirements),
            slots: SlotTable::new(batch, requirements),
            shadows: ShadowQueue::new(batch, requirements),
            shadow_classes: Vec::with_capacity(2 * MaterialClass::COUNT),
            order,
            survivors: 0,
            free: batch,
            units: (0..unit_count).map(|_| unit()).collect(),
            free_units: (0..unit_count as u32).collect(),
            current: None,
            stack: accelerator.stack(),
            stats: Stats::default(),
            features: PhantomData,
        }
    }

    fn work<I: Isa>(mut self, isa: I) -> Stats {
        let mut laps = Laps::start();
        loop {
            self.generate(isa);
            laps.lap(&mut self.stats, Stage::Generate);
            if self.paths.len == 0 {
                return self.stats;
            }
            self.intersect(isa);
            laps.lap(&mut self.stats, Stage::Intersect);
            let sorted = self.material_sort(isa);
            laps.lap(&mut self.stats, Stage::MaterialSort);
            self.shade(isa, &sorted);
            laps.lap(&mut self.stats, Stage::Shade);
            if P::LIGHTS != 0 {
                self.light_sample(isa);
                laps.lap(&mut self.stats, Stage::LightSample);
            }
            let finished = self.roulette_compact(isa, &sorted);
            laps.lap(&mut self.stats, Stage::RouletteCompact);
            self.film(finished);
            laps.lap(&mut self.stats, Stage::Film);
        }
    }

    /// Fills the pool, once enough of it is free for vectors and packets to be full.
    fn generate<I: Isa>(&mut self, isa: I) {
        let capacity = self.paths.capacity();
        if self.paths.len > 0 && self.free < (capacity / 4).clamp(16, 1024) {
            return;
        }
        while self.free > 0 {
            let Some(id) = self.current.or_else(|| self.open_unit()) else { break };
            let open = &mut self.units[id as usize];
            let count = self.free.min(open.paths - open.started);
            let from = self.free - count;
            isa.run(Generate::<P> {
                camera: &self.job.scene.camera,
                batch: Batch {
                    block: &self.job.film.blocks[open.unit.block],
                    image_width: self.job.film.image_width,
                    seed: self.job.seed,
                    replicate: open.unit.replicate,
                    first_sample: open.unit.first,
                    first: open.started,
                    unit: id,
                },
                free: &self.order.free[from..self.free],
                paths: &mut self.paths,
                slots: &mut self.slots,
                features: PhantomData,
            });
            self.free = from;
            open.started += count;
            self.stats.camera_rays += count as u64;
            self.current = (open.started < open.paths).then_some(id);
        }
    }

    /// Takes a work unit, if there is one and room for it.
    fn open_unit(&mut self) -> Option<u32> {
        let id = *self.free_units.last()?;
        let unit = self.job.schedule.take()?;
        self.free_units.pop();
        let open = &mut self.units[id as usize];
        open.unit = unit;
        open.started = 0;
        open.ended = 0;
        open.paths = self.job.film.blocks[unit.block].pixels() * unit.samples as usize;
        open.sums.clear();
        Some(id)
    }

    /// Bounce rays, then the camera rays behind them: each kind in its own way through the tree.
    fn intersect<I: Isa>(&mut self, isa: I) {
        for (range, coherent) in [(0..self.survivors, false), (self.survivors..self.paths.len, true)] {
            isa.run(Intersect {
                accelerator: self.accelerator,
                traversal: self.accelerator.traversal(coherent),
                paths: &self.paths,
                range,
                hits: &mut self.hits,
                stack: &mut self.stack,
            });
        }
        self.hits.len = self.paths.len;
    }

    fn material_sort<I: Isa>(&mut self, isa: I) -> Sorted {
        isa.run(MaterialSort {
            tags: &self.job.scene.geometry.tags,
            max_depth: self.job.scene.max_depth,
            paths: &self.paths,
            hits: &self.hits,
            order: &mut self.order,
        })
    }

    fn shade<I: Isa>(&mut self, isa: I, sorted: &Sorted) {
        let scene = self.job.scene;
        self.scattered.len = 0;
        self.shadows.len = 0;
        self.shadow_classes.clear();
        if self.job.plan.has_environment {
            isa.run(Environment {
                radiance: scene.environment,
                list: &self.order.sorted[sorted.range(list::MISSED)],
                paths: &self.paths,
                slots: &mut self.slots,
            });
        }
        if sorted.emitting > 0 {
            isa.run(Emission::<P> {
                scene,
                list: &self.order.emitting[..sorted.emitting],
                paths: &self.paths,
                hits: &self.hits,
                slots: &mut self.slots,
                features: PhantomData,
            });
        }
        for &class in &self.job.plan.shade_kernels {
            let list = &self.order.sorted[sorted.range(class as usize)];
            // The sort is stable: paths that have bounced come first, those from the camera last.
            let (bounced, first) = list.split_at(list.partition_point(|&i| (i as usize) < self.survivors));
            macro_rules! run {
                ($material:ident) => {
                    for (list, coherent) in [(bounced, false), (first, true)] {
                        if list.is_empty() {
                            continue;
                        }
                        isa.run(Shade::<shade::$material, P> {
                            scene,
                            list,
                            paths: &self.paths,
                            hits: &self.hits,
                            slots: &self.slots,
                            scattered: &mut self.scattered,
                            shadows: &mut self.shadows,
                            kernel: PhantomData,
                        });
                        self.shadow_classes.push((self.shadows.len, coherent));
                    }
                };
            }
            match class {
                MaterialClass::Absorber => {}
                MaterialClass::Lambert => run!(LambertMaterial),
                MaterialClass::OrenNayar => run!(OrenNayarMaterial),
                MaterialClass::Conductor => run!(ConductorMaterial),
                MaterialClass::RoughConductor => run!(RoughConductorMaterial),
                MaterialClass::Dielectric => run!(DielectricMaterial),
                MaterialClass::ThinDielectric => run!(ThinDielectricMaterial),
            }
        }
    }

    fn light_sample<I: Isa>(&mut self, isa: I) {
        self.stats.shadow_rays += self.shadows.len as u64;
        let mut start = 0;
        for &(end, coherent) in &self.shadow_classes {
            isa.run(LightSample {
                accelerator: self.accelerator,
                traversal: self.accelerator.traversal(coherent),
                shadows: &self.shadows,
                range: start..end,
                slots: &mut self.slots,
                stack: &mut self.stack,
            });
            start = end;
        }
    }

    /// Returns how many paths ended in this round; their slots are the first of `order.finished`.
    fn roulette_compact<I: Isa>(&mut self, isa: I, sorted: &Sorted) -> usize {
        let mut finished = 0;
        for k in [MaterialClass::Absorber as usize, list::ENDED, list::MISSED] {
            for &place in &self.order.sorted[sorted.range(k)] {
                self.order.finished[finished] =
                    self.paths.slot_depth[place as usize] & ((1 << SLOT_BITS) - 1);
                finished += 1;
            }
        }
        let finished = isa.run(RouletteCompact::<P> {
            paths: &mut self.scattered,
            slots: &mut self.slots,
            order: &mut self.order,
            finished,
            features: PhantomData,
        });
        self.survivors = self.scattered.len;
        self.stats.bounce_rays += self.survivors as u64;
        std::mem::swap(&mut self.paths, &mut self.scattered);
        finished
    }

    /// Adds ended paths to their units, and complete units to the film.
    fn film(&mut self, finished: usize) {
        let weighted = !self.slots.filter_weight.is_empty();
        for k in 0..finished {
            let slot = self.order.finished[k] as usize;
            let place = self.slots.place[slot];
            let (id, pixel) = (place >> PIXEL_BITS, place & ((1 << PIXEL_BITS) - 1));
            let open = &mut self.units[id as usize];
            let radiance =
                [self.slots.radiance_r[slot], self.slots.radiance_g[slot], self.slots.radiance_b[slot]];
            let weight = weighted.then(|| self.slots.filter_weight[slot]);
            open.sums.add(self.job.film.quantum, pixel as usize, radiance, weight);
            open.ended += 1;
            self.order.free[self.free + k] = slot as u32;
            if open.ended == open.paths {
                add_to_film(self.job, &open.unit, &open.sums, &mut self.stats);
                self.free_units.push(id);
            }
        }
        self.free += finished;
    }
}
