//! What a worker counts and measures.

use std::time::{Duration, Instant};
pub use wavepath_kernels::intersect::RayClass;

/// The stages in the order in which they run, as they are named in reports, profiles and benches; and what else takes
/// time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Stage {
    /// Camera rays.
    Generate,
    /// Closest hits.
    Intersect,
    /// Materials of mixtures.
    Mixture,
    /// Index lists by material.
    MaterialSort,
    /// Parameters of textured materials.
    Texture,
    /// Scattering, emission, sky.
    Shade,
    /// Rays towards lights.
    LightSample,
    /// Russian roulette and compaction.
    RouletteCompact,
    /// Adding ended paths to the film.
    Film,
    /// Everything, in an engine without stages.
    Megakernel,
}

impl Stage {
    /// How many there are.
    pub const COUNT: usize = 10;
    /// All of them.
    pub const ALL: [Stage; Self::COUNT] = [
        Stage::Generate,
        Stage::Intersect,
        Stage::Mixture,
        Stage::MaterialSort,
        Stage::Texture,
        Stage::Shade,
        Stage::LightSample,
        Stage::RouletteCompact,
        Stage::Film,
        Stage::Megakernel,
    ];
    /// The name of its file.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Generate => "generate",
            Stage::Intersect => "intersect",
            Stage::Mixture => "mixture",
            Stage::MaterialSort => "material_sort",
            Stage::Texture => "texture",
            Stage::Shade => "shade",
            Stage::LightSample => "light_sample",
            Stage::RouletteCompact => "roulette_compact",
            Stage::Film => "film",
            Stage::Megakernel => "megakernel",
        }
    }
}

/// Counts and times of one worker, or of all.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Rays from the camera: as many as samples.
    pub camera_rays: u64,
    /// Rays from surfaces onwards.
    pub bounce_rays: u64,
    /// Rays towards lights.
    pub shadow_rays: u64,
    /// Time in each stage.
    pub stages: [Duration; Stage::COUNT],
    /// Rays traced, by class, in an engine with stages.
    pub traced: [u64; RayClass::COUNT],
    /// Time in which they were traced: parts of that of the stages.
    pub tracing: [Duration; RayClass::COUNT],
    /// Rays that the progress display knows of.
    published: u64,
}

impl Stats {
    /// Rays of all classes.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.bounce_rays + self.shadow_rays
    }
    /// Those of an earlier part of the same render: rays by class (camera, bounce, shadow), and times of stages by name.
    pub fn earlier<'a>(rays: [u64; 3], stages: impl IntoIterator<Item = (&'a str, Duration)>) -> Self {
        let [camera_rays, bounce_rays, shadow_rays] = rays;
        let published = camera_rays + bounce_rays + shadow_rays;
        let mut stats = Stats { camera_rays, bounce_rays, shadow_rays, published, ..Stats::default() };
        for (name, time) in stages {
            if let Some(stage) = Stage::ALL.into_iter().find(|stage| stage.name() == name) {
                stats.stages[stage as usize] += time;
            }
        }
        stats
    }
    /// As numbers, for another process: rays by class, those traced by class, and nanoseconds of tracing and of the stages.
    pub fn to_numbers(&self) -> Vec<u64> {
        let times = self.tracing.iter().chain(&self.stages).map(|time| time.as_nanos() as u64);
        let rays = [self.camera_rays, self.bounce_rays, self.shadow_rays];
        rays.into_iter().chain(self.traced).chain(times).collect()
    }
    /// Of [`Stats::to_numbers`]; what is missing is 0.
    pub fn from_numbers(numbers: &[u64]) -> Self {
        let mut numbers = numbers.iter().copied();
        let mut next = || numbers.next().unwrap_or(0);
        let [camera_rays, bounce_rays, shadow_rays] = [next(), next(), next()];
        let traced = std::array::from_fn(|_| next());
        let tracing = std::array::from_fn(|_| Duration::from_nanos(next()));
        let stages = std::array::from_fn(|_| Duration::from_nanos(next()));
        Stats { camera_rays, bounce_rays, shadow_rays, stages, traced, tracing, published: 0 }
    }
    /// Rays since the last call.
    pub fn unpublished(&mut self) -> u64 {
        let new = self.rays() - self.published;
        self.published = self.rays();
        new
    }
    /// Adds those of another worker.
    pub fn merge(&mut self, other: &Stats) {
        self.camera_rays += other.camera_rays;
        self.bounce_rays += other.bounce_rays;
        self.shadow_rays += other.shadow_rays;
        for (to, from) in self.stages.iter_mut().zip(&other.stages) {
            *to += *from;
        }
        for (to, from) in self.traced.iter_mut().zip(&other.traced) {
            *to += *from;
        }
        for (to, from) in self.tracing.iter_mut().zip(&other.tracing) {
            *to += *from;
        }
    }
}

/// Measures stages without gaps: what passes between two laps belongs to the stage that the second one names.
pub struct Laps {
    last: Instant,
}

impl Laps {
    /// Starts now.
    pub fn start() -> Self {
        Laps { last: Instant::now() }
    }
    /// Gives the time since the last lap to a stage.
    #[inline(always)]
    pub fn lap(&mut self, stats: &mut Stats, stage: Stage) {
        let now = Instant::now();
        stats.stages[stage as usize] += now - self.last;
        self.last = now;
    }
    /// The same for a stage that traced `rays` of a class.
    #[inline(always)]
    pub fn lap_rays(&mut self, stats: &mut Stats, stage: Stage, class: RayClass, rays: usize) {
        let last = self.last;
        self.lap(stats, stage);
        stats.traced[class as usize] += rays as u64;
        stats.tracing[class as usize] += self.last - last;
    }
}
