//! Measures engines against each other on a scene: what `wavepath bench` prints.
//!
//! All variants of a comparison are measured in turn, round after round, so that what else the machine does hits all of
//! them alike. Figures are medians over the rounds, with the smallest and the largest. Ratios are formed within a round.
//!
//! Where the system tells it, rates are per second of processor time, which does not count the time when another
//! process had the processor; only the comparison of thread counts is by wall clock.

mod clock;
pub mod scale;
mod subject;
mod table;

pub use clock::Clock;
pub use subject::{Subject, Variant};

use crate::engine::stats::{RayClass, Stage};
use crate::engine::{EngineKind, wavefront};
use crate::scene::SamplerKind;
use serde::Serialize;
use std::time::Duration;
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

/// How much to measure.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Rounds, at least 1.
    pub rounds: usize,
    /// Time that one measurement shall take.
    pub each: Duration,
    /// Most worker threads.
    pub threads: usize,
}

/// The median of some measurements, the smallest and the largest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// Of at least one number.
    pub fn of(numbers: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = numbers.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        let median = (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0;
        Spread { median, min: sorted[0], max: sorted[n - 1] }
    }
}

/// A variant of the ablation.
#[derive(Clone, Debug, Serialize)]
pub struct Step {
    /// What is added to the variant before.
    pub name: &'static str,
    /// Random numbers.
    pub sampler: &'static str,
    /// Pixel samples per second of processor time.
    pub samples_per_second: Spread,
    /// Rate over that of the naive megakernel with the same sampler.
    pub over_naive: Spread,
    /// Rate over that of the megakernel through the wide tree with the same sampler.
    pub over_wide: Spread,
}

/// A stage of the wavefront as it runs by default.
#[derive(Clone, Debug, Serialize)]
pub struct StageCost {
    /// Name.
    pub name: &'static str,
    /// Share of the time in all stages.
    pub share: f64,
    /// Items a pixel sample: paths that pass the stage, rays for those that trace.
    pub items_per_sample: f64,
    /// Nanoseconds an item.
    pub nanoseconds_per_item: Spread,
    /// Cycles of the time-stamp counter an item, where there is one.
    pub cycles_per_item: Option<f64>,
}

/// Rays of a class.
#[derive(Clone, Debug, Serialize)]
pub struct RayRate {
    /// Class.
    pub class: &'static str,
    /// Rays a pixel sample.
    pub per_sample: f64,
    /// Millions a second in which rays of this class were traced.
    pub mrays_per_second: Spread,
}

/// Rate at a certain number of something, relative to the rate at another.
#[derive(Clone, Debug, Serialize)]
pub struct Relative {
    /// The number.
    pub number: usize,
    /// Ratio of the rates.
    pub ratio: Spread,
}

/// Owen-scrambled Sobol points against independent numbers.
#[derive(Clone, Debug, Serialize)]
pub struct SamplerGain {
    /// Samples a pixel.
    pub spp: u32,
    /// MSE with independent numbers over MSE with Sobol points, at equal samples.
    pub at_equal_samples: f64,
    /// The same at equal processor time.
    pub at_equal_time: f64,
}

/// All figures of a scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneFigures {
    /// Path as given.
    pub scene: String,
    /// Pixels of the image that was measured.
    pub resolution: [u32; 2],
    /// Primitives.
    pub primitives: usize,
    /// Bytes of the wavefront's tree.
    pub tree_bytes: usize,
    /// Bytes of all queues, a path.
    pub bytes_per_path: usize,
    /// What each step brings.
    pub ablation: Vec<Step>,
    /// Where the time goes.
    pub stages: Vec<StageCost>,
    /// Rays by class.
    pub rays: Vec<RayRate>,
    /// By paths in the pool of a worker, relative to the default.
    pub batches: Vec<Relative>,
    /// By worker threads, relative to one, by wall clock.
    pub threads: Vec<Relative>,
    /// Rate with the scene's own plan over the rate with everything switched on.
    pub plan_over_everything: Spread,
    /// The samplers.
    pub samplers: Vec<SamplerGain>,
}

/// All figures of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Processor.
    pub cpu: String,
    /// Instruction set.
    pub isa: &'static str,
    /// Rounds of each comparison.
    pub rounds: usize,
    /// Are rates per second of processor time? Else of wall clock.
    pub processor_time: bool,
    /// Version of wavepath.
    pub version: &'static str,
    /// Scenes.
    pub scenes: Vec<SceneFigures>,
}

/// The step at which the engine is what it is by default.
const DEFAULT_STEP: &str = "+ streams, or packets for all";

impl SceneFigures {
    /// The engine as it is by default.
    fn default_engine(&self) -> &Step {
        self.ablation.iter().find(|step| step.name == DEFAULT_STEP).expect("a step of every ablation")
    }
}

/// Pools of the sweep.
const BATCHES: [usize; 7] = [64, 256, 1 << 10, 1 << 12, 1 << 14, 1 << 16, 1 << 18];

/// Measures a scene; `said` is told what is being done.
pub fn measure(subject: &Subject, effort: Effort, mut said: impl FnMut(&str)) -> SceneFigures {
    said("ablation");
    let ablation = ablation(subject, effort);
    said("stages");
    let (stages, rays) = stages(subject, effort);
    said("batch sizes");
    let sweep = |batch| Variant { batch, ..Variant::default() };
    let at_default = BATCHES.iter().position(|&b| b == wavefront::DEFAULT_BATCH).expect("in the list");
    let batches = relative(subject, effort, &BATCHES, at_default, sweep, |m| m.rate());
    said("threads");
    let counts: Vec<usize> = thread_counts(effort.threads);
    let threaded = |threads| Variant { threads, ..Variant::default() };
    let threads = relative(subject, effort, &counts, 0, threaded, |m| m.samples as f64 / m.wall);
    said("plan");
    let everything = [false, true].map(|everything| Variant { everything, ..Variant::default() });
    let rounds = subject.rounds(&everything, effort);
    let plan_over_everything = Spread::of(rounds.iter().map(|round| round[0].rate() / round[1].rate()));
    said("samplers");
    let samplers = [16, 64].map(|spp| sampler_gain(subject, effort, spp)).to_vec();
    SceneFigures {
        scene: subject.name.clone(),
        resolution: subject.resolution(),
        primitives: subject.primitives(),
        tree_bytes: subject.tree_bytes(),
        bytes_per_path: subject.bytes_per_path(),
        ablation,
        stages,
        rays,
        batches,
        threads,
        plan_over_everything,
        samplers,
    }
}

/// From the naive megakernel to the engine as it is, a step at a time.
fn ablation(subject: &Subject, effort: Effort) -> Vec<Step> {
    let wide = Level::detect();
    let wavefront = |level, policy| Variant { level, policy, ..Variant::default() };
    let mut steps = vec![
        ("megakernel", Variant { engine: EngineKind::Megakernel, ..Variant::default() }),
        ("+ wide tree", Variant { engine: EngineKind::MegakernelWide, ..Variant::default() }),
    ];
    if let Some(one_lane) = Level::one_lane() {
        steps.push(("wavefront, one lane", wavefront(one_lane, Policy::Single)));
    }
    steps.extend([
        ("+ SIMD", wavefront(wide, Policy::Single)),
        ("+ packets for coherent rays", wavefront(wide, Policy::Mixed)),
        (DEFAULT_STEP, wavefront(wide, Policy::Auto)),
        ("packets for all, bounces in order (not the default)", wavefront(wide, Policy::Sorted)),
    ]);
    let samplers = [SamplerKind::Sobol, SamplerKind::Independent];
    let names: Vec<_> =
        samplers.iter().flat_map(|&s| steps.iter().map(move |(name, _)| (*name, s))).collect();
    let variants: Vec<_> = samplers
        .iter()
        .flat_map(|&sampler| steps.iter().map(move |(_, v)| Variant { sampler, ..*v }))
        .collect();
    let rounds = subject.rounds(&variants, effort);
    let over = |of: usize, base: usize| Spread::of(rounds.iter().map(|r| r[of].rate() / r[base].rate()));
    names
        .into_iter()
        .enumerate()
        .map(|(k, (name, sampler))| {
            let naive = k / steps.len() * steps.len();
            Step {
                name,
                sampler: sampler.name(),
                samples_per_second: Spread::of(rounds.iter().map(|r| r[k].rate())),
                over_naive: over(k, naive),
                over_wide: over(k, naive + 1),
            }
        })
        .collect()
}

/// Costs of the stages, and rates of the rays, of the engine as it is.
fn stages(subject: &Subject, effort: Effort) -> (Vec<StageCost>, Vec<RayRate>) {
    let rounds: Vec<_> =
        subject.rounds(&[Variant::default()], effort).into_iter().map(|mut round| round.remove(0)).collect();
    let stats = &rounds[0].stats;
    let samples = stats.camera_rays as f64;
    let paths = stats.camera_rays + stats.bounce_rays;
    let total = |m: &subject::Measured| m.stats.stages.iter().map(Duration::as_secs_f64).sum::<f64>();
    let cycles = clock::tsc_hertz();
    let items = |stage| match stage {
        Stage::Generate | Stage::Film => stats.camera_rays,
        Stage::LightSample => stats.shadow_rays,
        _ => paths,
    };
    let costs = Stage::ALL
        .into_iter()
        .filter(|&stage| stats.stages[stage as usize] > Duration::ZERO && items(stage) > 0)
        .map(|stage| {
            let seconds = |m: &subject::Measured| m.stats.stages[stage as usize].as_secs_f64();
            let each = Spread::of(rounds.iter().map(|m| 1e9 * seconds(m) / items(stage) as f64));
            StageCost {
                name: stage.name(),
                share: Spread::of(rounds.iter().map(|m| seconds(m) / total(m))).median,
                items_per_sample: items(stage) as f64 / samples,
                nanoseconds_per_item: each,
                cycles_per_item: cycles.map(|hertz| each.median * 1e-9 * hertz),
            }
        })
        .collect();
    let rays = RayClass::ALL
        .into_iter()
        .filter(|&class| stats.traced[class as usize] > 0)
        .map(|class| {
            let k = class as usize;
            let rate =
                |m: &subject::Measured| m.stats.traced[k] as f64 / m.stats.tracing[k].as_secs_f64() / 1e6;
            RayRate {
                class: class.name(),
                per_sample: stats.traced[k] as f64 / samples,
                mrays_per_second: Spread::of(rounds.iter().map(rate)),
            }
        })
        .collect();
    (costs, rays)
}

/// Rates of the variants for some numbers, relative to that of the number at place `base`.
fn relative(
    subject: &Subject,
    effort: Effort,
    numbers: &[usize],
    base: usize,
    variant: impl Fn(usize) -> Variant,
    rate: impl Fn(&subject::Measured) -> f64,
) -> Vec<Relative> {
    let variants: Vec<_> = numbers.iter().map(|&n| variant(n)).collect();
    let rounds = subject.rounds(&variants, effort);
    let ratio = |k: usize| Spread::of(rounds.iter().map(|r| rate(&r[k]) / rate(&r[base])));
    numbers.iter().enumerate().map(|(k, &number)| Relative { number, ratio: ratio(k) }).collect()
}

/// 1, 2, 4 and so on, and the largest.
fn thread_counts(most: usize) -> Vec<usize> {
    let mut counts: Vec<usize> = (0..).map(|k| 1 << k).take_while(|&n| n < most).collect();
    counts.push(most);
    counts
}

/// MSE by both samplers. Two renders of different seeds differ by twice the variance of either, so no reference is
/// needed.
fn sampler_gain(subject: &Subject, effort: Effort, spp: u32) -> SamplerGain {
    let mut mse = [0.0f64; 2];
    let mut seconds = [0.0f64; 2];
    for pair in 0..effort.rounds.max(2) as u64 {
        for (k, sampler) in [SamplerKind::Sobol, SamplerKind::Independent].into_iter().enumerate() {
            let images = [2 * pair + 1, 2 * pair + 2].map(|seed| {
                let (measured, pixels) = subject.image(&Variant { sampler, seed, ..Variant::default() }, spp);
                seconds[k] += measured.processor;
                pixels
            });
            let [a, b] = &images;
            let differences = a.iter().zip(b).flat_map(|(a, b)| (0..3).map(|c| (a[c] - b[c]) as f64));
            mse[k] += differences.map(|d| d * d).sum::<f64>();
        }
    }
    SamplerGain {
        spp,
        at_equal_samples: mse[1] / mse[0],
        // The error of independent numbers falls as 1 / time.
        at_equal_time: mse[1] / mse[0] * seconds[1] / seconds[0],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert_eq!(Spread::of([3.0, 1.0, 2.0]), Spread { median: 2.0, min: 1.0, max: 3.0 });
        assert_eq!(Spread::of([4.0, 1.0]), Spread { median: 2.5, min: 1.0, max: 4.0 });
    }

    #[test]
    fn counts_of_threads() {
        assert_eq!(thread_counts(1), [1]);
        assert_eq!(thread_counts(2), [1, 2]);
        assert_eq!(thread_counts(6), [1, 2, 4, 6]);
    }
}
