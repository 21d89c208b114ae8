//! A scene with both trees, ready to be rendered by any variant of an engine.

use super::{Clock, Effort};
use crate::engine::stats::Stats;
use crate::engine::{EngineKind, Tree, wavefront};
use crate::film::Film;
use crate::render::Render;
use crate::scene::{SamplerKind, Scene};
use wavepath_kernels::intersect::{Accelerator, Policy};
use wavepath_kernels::isa::Level;

/// Which engine, and how.
#[derive(Clone, Copy, Debug)]
pub struct Variant {
    /// Engine.
    pub engine: EngineKind,
    /// Random numbers.
    pub sampler: SamplerKind,
    /// Instruction set.
    pub level: Level,
    /// How rays go through the tree.
    pub policy: Policy,
    /// Paths in the pool of a worker.
    pub batch: usize,
    /// Worker threads.
    pub threads: usize,
    /// Everything switched on, whether or not the scene needs it.
    pub everything: bool,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// The wavefront as it is by default, on one thread.
impl Default for Variant {
    fn default() -> Self {
        Variant {
            engine: EngineKind::Wavefront,
            sampler: SamplerKind::Sobol,
            level: Level::detect(),
            policy: Policy::Auto,
            batch: wavefront::DEFAULT_BATCH,
            threads: 1,
            everything: false,
            seed: 0,
        }
    }
}

/// One render.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Pixel samples.
    pub samples: u64,
    /// Seconds of wall clock.
    pub wall: f64,
    /// Seconds of processor time.
    pub processor: f64,
    /// What the workers counted.
    pub stats: Stats,
}

impl Measured {
    /// Pixel samples per second of processor time.
    pub fn rate(&self) -> f64 {
        self.samples as f64 / self.processor
    }
}

/// A scene to measure.
pub struct Subject<'a> {
    /// Name for tables.
    pub name: String,
    scene: &'a Scene,
    wide: Tree<'a>,
    naive: Tree<'a>,
}

impl<'a> Subject<'a> {
    /// Builds both trees.
    pub fn new(name: String, scene: &'a Scene) -> Self {
        Subject {
            name,
            scene,
            wide: scene.tree(EngineKind::Wavefront),
            naive: scene.tree(EngineKind::Megakernel),
        }
    }

    /// Width and height of the image.
    pub fn resolution(&self) -> [u32; 2] {
        self.scene.resolution()
    }
    /// Number of primitives.
    pub fn primitives(&self) -> usize {
        self.scene.tables().geometry().primitives()
    }
    /// Bytes of the wavefront's tree.
    pub fn tree_bytes(&self) -> usize {
        self.wide.bytes()
    }
    /// Bytes of all queues, a path.
    pub fn bytes_per_path(&self) -> usize {
        self.scene.plan().bytes_per_path
    }

    /// Renders `spp` samples of each pixel.
    fn render(&self, variant: &Variant, spp: u32) -> (Measured, Film) {
        let tree = if variant.engine == EngineKind::Megakernel { &self.naive } else { &self.wide };
        let render = Render::new(self.scene)
            .everything(variant.everything)
            .engine(variant.engine)
            .sampler(variant.sampler)
            .threads(variant.threads)
            .seed(variant.seed)
            .batch(variant.batch)
            .level(variant.level)
            .traversal(variant.policy)
            .spp(spp);
        let film = render.film().expect("the film fits into memory");
        let mut session = render.session(tree, &film).expect("threads can be started");
        let clock = Clock::start();
        session.run(None, |_| ());
        let (stats, elapsed) = (session.stats().clone(), session.elapsed());
        let processor = clock.processor();
        let samples = spp as u64 * film.pixels();
        (Measured { samples, wall: elapsed.as_secs_f64(), processor, stats }, film)
    }

    /// The picture of a render.
    pub fn image(&self, variant: &Variant, spp: u32) -> (Measured, Vec<[f32; 3]>) {
        let (measured, film) = self.render(variant, spp);
        (measured, film.develop().pixels)
    }

    /// Samples a pixel with which a variant takes about as long as a measurement shall.
    fn samples_for(&self, variant: &Variant, effort: Effort) -> u32 {
        let pixels = self.resolution().map(u64::from).iter().product::<u64>();
        // Enough that the pool is full for most of the time.
        let least = (3 * (variant.batch * variant.threads) as u64).div_ceil(pixels).max(1) as u32;
        let mut spp = least;
        loop {
            let seconds = self.render(variant, spp).0.wall;
            let wanted = effort.each.as_secs_f64();
            if seconds >= wanted / 8.0 || spp >= 1 << 20 {
                return ((spp as f64 * wanted / seconds).round() as u32).max(least);
            }
            spp *= 8;
        }
    }

    /// Measures all variants, round after round: the result is by round, then by variant.
    pub fn rounds(&self, variants: &[Variant], effort: Effort) -> Vec<Vec<Measured>> {
        let spp: Vec<u32> = variants.iter().map(|v| self.samples_for(v, effort)).collect();
        (0..effort.rounds)
            .map(|_| variants.iter().zip(&spp).map(|(v, &spp)| self.render(v, spp).0).collect())
            .collect()
    }
}
