//! The wavefront engine: each worker owns a pool of paths that fits its cache and runs all stages over it, refilling
//! what ended. No barrier, and no counter shared between workers but the one that gives out work units.

pub mod record;

use super::schedule::Unit;
use super::stats::{Laps, Stage, Stats};
use super::{Job, add_to_film};
use crate::film::BlockSums;
use std::marker::PhantomData;
use std::ops::Range;
use wavepath_kernels::channels::{ChannelTable, FirstHits};
use wavepath_kernels::cutout::{PassAll, ShadowsPast};
use wavepath_kernels::generate::{Batch, Generate};
use wavepath_kernels::intersect::{Accelerator, Intersect, RayClass, TraversalStack};
use wavepath_kernels::isa::{Isa, Kernel, Promise};
use wavepath_kernels::light_sample::LightSample;
use wavepath_kernels::material_sort::{MaterialSort, Sorted, list};
use wavepath_kernels::mixture::Mixture;
use wavepath_kernels::queue::{
    HitQueue, MAX_BATCH, OrderLists, PathQueue, Requirements, SHADOW_RAYS, SLOT_BITS, ShadowQueue, SlotTable,
    unit_and_pixel,
};
use wavepath_kernels::roulette_compact::RouletteCompact;
use wavepath_kernels::scene::MaterialClass;
use wavepath_kernels::shade::emission::Emission;
use wavepath_kernels::shade::environment::{Environment, EnvironmentMaps};
use wavepath_kernels::shade::materials::{ForMaterial, Material};
use wavepath_kernels::shade::{Features, Shade};
use wavepath_kernels::texture::{EvaluateTextures, PIECE, TexturedRows};

/// Paths of a pool, if the user does not say otherwise: 2 to 8 thousand were best, as they fit a 1 MiB L2.
pub const DEFAULT_BATCH: usize = 4096;

/// What a pool may hold: at least some vectors, at most what a slot number can count.
pub const BATCHES: std::ops::RangeInclusive<usize> = 64..=MAX_BATCH;

/// Camera rays that go through the tree together: the widest packet.
const PACKET: usize = 16;

/// One worker of the engine.
pub(crate) struct Worker<'a, P, A> {
    /// What is rendered.
    pub(crate) job: &'a Job<'a>,
    /// What rays are traced through: a tree of the job's scene.
    pub(crate) accelerator: &'a A,
    /// Paths in the pool.
    pub(crate) batch: usize,
    /// Features: those of the job's plan, or more.
    pub(crate) features: PhantomData<P>,
}

impl<P: Features, A: Accelerator> Kernel for Worker<'_, P, A> {
    type Output = Stats;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> Stats {
        if I::SPECIALISED {
            Pool::<P, A>::new(self.job, self.accelerator, self.batch).work(isa)
        } else {
            Pool::<P::General, A>::new(self.job, self.accelerator, self.batch).work(isa)
        }
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
    /// What beside radiance is asked for, by slot.
    channels: ChannelTable,
    /// The camera's viewing axis.
    axis: [f32; 3],
    shadows: ShadowQueue,
    /// Parameters of the paths of a piece, if their materials are textured.
    rows: TexturedRows,
    order: OrderLists,
    /// Paths that have bounced; those behind them in the queue come from the camera.
    survivors: usize,
    /// Slots at the front of `order.list`.
    free: usize,
    units: Vec<OpenUnit>,
    /// Index of the first sample of each unit.
    first_sample: Vec<u32>,
    free_units: Vec<u32>,
    /// The unit whose paths are being started.
    current: Option<u32>,
    stack: TraversalStack,
    stats: Stats,
    features: PhantomData<P>,
}

impl<'a, P: Features, A: Accelerator> Pool<'a, P, A> {
    fn new(job: &'a Job<'a>, accelerator: &'a A, batch: usize) -> Self {
        let requirements: Requirements = job.plan.requirements();
        // Slots must fit their bits beside the depth.
        let batch = batch.clamp(PACKET, MAX_BATCH);
        // Units end in any order: room for those that hold the paths, and as many with stragglers.
        let unit_count = 2 * batch.div_ceil(job.schedule.unit_paths()) + 6;
        let unit = || OpenUnit {
            unit: Unit { block: 0, replicate: 0, first: 0, samples: 0 },
            started: 0,
            paths: 0,
            ended: 0,
            sums: job.film.sums(),
        };
        let mut order = OrderLists::new(batch, requirements);
        for (k, slot) in order.list.iter_mut().enumerate() {
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
            channels: ChannelTable::new(batch, requirements.channels),
            axis: job.scene.camera().axis(),
            shadows: ShadowQueue::new(SHADOW_RAYS, requirements),
            rows: TexturedRows::new(job.scene),
            order,
            survivors: 0,
            free: batch,
            units: (0..unit_count).map(|_| unit()).collect(),
            first_sample: vec![0; unit_count],
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
            // Bounce rays, then the camera rays behind them: each kind in its own way through the tree.
            let (bounced, all) = (self.survivors, self.paths.len);
            for (class, range) in [(RayClass::Bounce, 0..bounced), (RayClass::Camera, bounced..all)] {
                let rays = range.len();
                self.intersect(isa, class, range);
                laps.lap_rays(&mut self.stats, Stage::Intersect, class, rays);
            }
            self.first_hits(isa);
            if self.job.plan.requirements().mixtures {
                self.mixture(isa);
                laps.lap(&mut self.stats, Stage::Mixture);
            }
            let sorted = self.material_sort(isa);
            laps.lap(&mut self.stats, Stage::MaterialSort);
            self.light_met(isa, &sorted);
            for &class in self.job.plan.shade_kernels() {
                let textured = self.job.scene.programs().has_class(class);
                for (piece, coherent) in self.pieces(class, textured, &sorted) {
                    if textured {
                        self.texture(isa, piece.clone());
                        laps.lap(&mut self.stats, Stage::Texture);
                    }
                    self.shade(isa, class, textured, piece);
                    laps.lap(&mut self.stats, Stage::Shade);
                    if P::LIGHTS != 0 && self.shadows.len > 0 {
                        let class = if coherent { RayClass::FirstShadow } else { RayClass::LaterShadow };
                        self.light_sample(isa, class);
                        laps.lap_rays(&mut self.stats, Stage::LightSample, class, self.shadows.len);
                    }
                }
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
            let rest = open.paths - open.started;
            // A unit that does not fit is cut where a packet ends, so that packets keep to few pixels.
            let count = if rest > self.free { self.free / PACKET * PACKET } else { rest };
            self.current = Some(id);
            if count == 0 {
                break;
            }
            let from = self.free - count;
            isa.run(Generate::<P::Sampler> {
                camera: self.job.scene.camera(),
                batch: Batch {
                    block: &self.job.film.blocks()[open.unit.block],
                    image_width: self.job.film.image_width(),
                    seed: self.job.seed,
                    replicate: open.unit.replicate,
                    first_sample: open.unit.first,
                    samples: open.unit.samples,
                    first: open.started,
                    unit: id,
                },
                free: &self.order.list[from..self.free],
                paths: &mut self.paths,
                slots: &mut self.slots,
                sampler: PhantomData,
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
        open.paths = self.job.film.blocks()[unit.block].pixels() * unit.samples as usize;
        open.sums.clear();
        self.first_sample[id as usize] = unit.first;
        Some(id)
    }

    fn intersect<I: Isa>(&mut self, isa: I, class: RayClass, range: Range<usize>) {
        self.hits.len = range.end;
        isa.run(Intersect {
            accelerator: self.accelerator,
            traversal: self.job.policy.pick(self.accelerator, class),
            paths: &self.paths,
            range: range.clone(),
            hits: &mut self.hits,
            stack: &mut self.stack,
            // Behind the free slots there is room for a number a path.
            order: &mut self.order.list[self.free..],
        });
        if self.job.plan.requirements().cutouts {
            isa.run(PassAll {
                scene: self.job.scene,
                accelerator: self.accelerator,
                paths: &self.paths,
                range,
                hits: &mut self.hits,
                stack: &mut self.stack,
            });
        }
    }

    /// The channels of paths that come from the camera.
    fn first_hits<I: Isa>(&mut self, isa: I) {
        if !self.channels.is_empty() {
            let (paths, hits, range) = (&self.paths, &self.hits, self.survivors..self.paths.len);
            isa.run(FirstHits { axis: self.axis, paths, hits, range, table: &mut self.channels });
        }
    }

    /// The materials of surfaces that are mixtures.
    fn mixture<I: Isa>(&mut self, isa: I) {
        isa.run(Mixture::<P::Sampler> {
            scene: self.job.scene,
            paths: &self.paths,
            hits: &mut self.hits,
            slots: &self.slots,
            first_sample: &self.first_sample,
            sampler: PhantomData,
            // SAFETY: as for `shade`; the plan is the scene's, and has the columns.
            promise: unsafe { Promise::new() },
        });
    }

    fn material_sort<I: Isa>(&mut self, isa: I) -> Sorted {
        isa.run(MaterialSort {
            tags: self.job.scene.geometry().tags(),
            max_depth: self.job.scene.max_depth(),
            paths: &self.paths,
            hits: &self.hits,
            order: &mut self.order,
            free: self.free,
        })
    }

    /// The light that paths met by themselves: the sky, and emitting surfaces.
    fn light_met<I: Isa>(&mut self, isa: I, sorted: &Sorted) {
        let scene = self.job.scene;
        if self.job.plan.has_environment_maps() {
            isa.run(EnvironmentMaps::<P::Lights> {
                scene,
                list: &self.order.list[sorted.range(list::MISSED)],
                paths: &self.paths,
                slots: &mut self.slots,
                lights: PhantomData,
                // SAFETY: as for `shade`; the plan has densities where there are lights to sample.
                promise: unsafe { Promise::new() },
            });
        } else if self.job.plan.has_environment() {
            isa.run(Environment {
                radiance: scene.environment(),
                list: &self.order.list[sorted.range(list::MISSED)],
                paths: &self.paths,
                slots: &mut self.slots,
                // SAFETY: as for `shade`.
                promise: unsafe { Promise::new() },
            });
        }
        if sorted.emitting > 0 {
            isa.run(Emission::<P::Lights> {
                scene,
                keys: &self.order.key[..self.paths.len],
                paths: &self.paths,
                hits: &self.hits,
                slots: &mut self.slots,
                lights: PhantomData,
                // SAFETY: as for `shade`; the sort wrote the keys. The plan is the scene's, and has densities where
                // there are lights to sample.
                promise: unsafe { Promise::new() },
            });
        }
        self.scattered.len = 0;
    }

    /// The paths of a class, as places in `order.list`, in pieces whose shadow rays and rows of parameters fit their
    /// queues; and whether the pieces hold paths from the camera, whose shadow rays stay together.
    fn pieces(
        &self,
        class: MaterialClass,
        textured: bool,
        sorted: &Sorted,
    ) -> impl Iterator<Item = (Range<usize>, bool)> + use<P, A> {
        let range = sorted.range(list::of(class));
        // The sort is stable: paths that have bounced come first, those from the camera last.
        let list = &self.order.list[range.clone()];
        let middle = range.start + list.partition_point(|&i| (i as usize) < self.survivors);
        let size = if P::LIGHTS != 0 && class.samples_lights() { SHADOW_RAYS } else { usize::MAX };
        let size = if textured { size.min(PIECE) } else { size };
        [(range.start..middle, false), (middle..range.end, true)].into_iter().flat_map(
            move |(part, coherent)| {
                let end = part.end;
                part.step_by(size).map(move |start| (start..end.min(start.saturating_add(size)), coherent))
            },
        )
    }

    fn texture<I: Isa>(&mut self, isa: I, piece: Range<usize>) {
        isa.run(EvaluateTextures {
            scene: self.job.scene,
            list: &self.order.list[piece],
            paths: &self.paths,
            hits: &self.hits,
            rows: &mut self.rows,
            // SAFETY: as for `shade`; pieces are short enough, and the plan has barycentric weights where there are
            // textures.
            promise: unsafe { Promise::new() },
        });
    }

    fn shade<I: Isa>(&mut self, isa: I, class: MaterialClass, textured: bool, piece: Range<usize>) {
        self.shadows.len = 0;
        // No path is on an absorber: `material_sort` ends them.
        let _ = class.with(ShadePiece { isa, pool: self, textured, piece });
    }

    fn light_sample<I: Isa>(&mut self, isa: I, class: RayClass) {
        self.stats.shadow_rays += self.shadows.len as u64;
        if self.job.plan.requirements().cutouts {
            isa.run(ShadowsPast {
                scene: self.job.scene,
                accelerator: self.accelerator,
                shadows: &self.shadows,
                slots: &mut self.slots,
                stack: &mut self.stack,
            });
            return;
        }
        isa.run(LightSample {
            accelerator: self.accelerator,
            traversal: self.job.policy.pick(self.accelerator, class),
            shadows: &self.shadows,
            range: 0..self.shadows.len,
            slots: &mut self.slots,
            stack: &mut self.stack,
        });
    }

    /// Returns how many paths ended in this round; their slots are those behind the free ones.
    fn roulette_compact<I: Isa>(&mut self, isa: I, sorted: &Sorted) -> usize {
        // The lists of ended paths are next to the free slots: places become slots where they stand, with the rays that
        // were traced after the first one above them.
        let mut free = self.free;
        for k in [list::MISSED, list::ENDED] {
            for entry in &mut self.order.list[sorted.range(k)] {
                *entry = self.paths.slot_depth[*entry as usize];
            }
            free += sorted.range(k).len();
        }
        let free = isa.run(RouletteCompact::<P::Sampler> {
            paths: &mut self.scattered,
            slots: &mut self.slots,
            first_sample: &self.first_sample,
            order: &mut self.order,
            free,
            sampler: PhantomData,
            // SAFETY: the queues are this pool's; all slots that were ever written come from `generate`, and the others
            // are 0.
            promise: unsafe { Promise::new() },
        });
        self.survivors = self.scattered.len;
        self.stats.bounce_rays += self.survivors as u64;
        std::mem::swap(&mut self.paths, &mut self.scattered);
        free - self.free
    }

    /// Adds ended paths to their units, and complete units to the film.
    fn film(&mut self, finished: usize) {
        let weighted = !self.slots.filter_weight.is_empty();
        for k in self.free..self.free + finished {
            let (slot, bounces) =
                (self.order.list[k] & ((1 << SLOT_BITS) - 1), self.order.list[k] >> SLOT_BITS);
            self.order.list[k] = slot;
            let slot = slot as usize;
            let (id, pixel) = unit_and_pixel(self.slots.place[slot]);
            let open = &mut self.units[id];
            let radiance =
                [self.slots.radiance_r[slot], self.slots.radiance_g[slot], self.slots.radiance_b[slot]];
            let weight = weighted.then(|| self.slots.filter_weight[slot]);
            open.sums.add(pixel, radiance, weight);
            for (channel, values) in self.channels.of(slot).enumerate() {
                open.sums.add_to_channel(channel, pixel, values, weight);
            }
            open.sums.bounces += u64::from(bounces);
            open.ended += 1;
            if open.ended == open.paths {
                add_to_film(self.job, &open.unit, &open.sums, &mut self.stats);
                self.free_units.push(id as u32);
            }
        }
        self.free += finished;
    }
}

/// [`Pool::shade`] for a material.
struct ShadePiece<'p, 'a, I, P, A> {
    isa: I,
    pool: &'p mut Pool<'a, P, A>,
    textured: bool,
    piece: Range<usize>,
}

impl<I: Isa, P: Features, A: Accelerator> ForMaterial for ShadePiece<'_, '_, I, P, A> {
    type Output = ();
    #[inline(always)]
    fn run<M: Material>(self) {
        let ShadePiece { isa, pool, textured, piece } = self;
        isa.run(Shade::<M, M::Sees<P>> {
            scene: pool.job.scene,
            list: &pool.order.list[piece],
            paths: &pool.paths,
            hits: &pool.hits,
            textured: textured.then(|| pool.rows.piece()),
            slots: &mut pool.slots,
            first_sample: &pool.first_sample,
            scattered: &mut pool.scattered,
            shadows: &mut pool.shadows,
            kernel: PhantomData,
            // SAFETY: the queues are the pool's, whose columns nobody replaces; the lists are those of `material_sort`,
            // made of hits in a tree of this scene (see `Job::new`), and each holds primitives of its class; slots come
            // from `generate`, with units of the pool; shadow rays fit as `pieces` are short; `texture` wrote the rows of
            // the piece.
            promise: unsafe { Promise::new() },
        });
    }
}
