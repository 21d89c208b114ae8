//! Experiments with a known answer, for tests.

use super::statistics::Estimate;
use super::{
    Errors, Experiment, External, Machine, OwnError, Point, Reference, ReferenceKind, Run, Variant, bias,
};
use crate::picture::Image;

/// Normal deviates from a fixed seed: SplitMix64 (Steele, Lea and Flood, 2014) and the transform of Box and Muller.
pub struct Normal(u64);

impl Normal {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Mean 0, variance 1.
    pub fn draw(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// From 0 to below 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// How many of 1000 intervals cover the truth, as a fraction.
pub fn coverage(truth: f64, mut estimate: impl FnMut() -> Estimate) -> f64 {
    let covered = (0..1000).filter(|_| {
        let estimate = estimate();
        assert!(estimate.interval.is_some(), "an interval");
        !estimate.excludes(truth)
    });
    covered.count() as f64 / 1000.0
}

/// The share has a standard deviation of 0.7 % itself: 90 to 99 % would fail by chance never in practice.
pub fn covers_as_promised(truth: f64, estimate: impl FnMut() -> Estimate) {
    let coverage = coverage(truth, estimate);
    assert!((0.9..=0.99).contains(&coverage), "{coverage}");
}

/// How the error of a synthetic variant falls.
#[derive(Clone, Copy)]
pub struct Law {
    pub error_at_one_second: f64,
    pub slope: f64,
    /// Standard deviation of the logarithm of the error.
    pub spread: f64,
    /// Seconds of the first of the six checkpoints.
    pub slowness: f64,
}

/// An experiment of variants that follow `laws`: six checkpoints at doubling times, whose deviations are correlated
/// within a seed as those of a real render are: half of each deviation is that of the checkpoint before.
pub fn experiment(normal: &mut Normal, laws: &[Law], seeds: u64) -> Experiment {
    let names = ["wavefront/sobol", "megakernel/sobol", "wavefront/independent", "megakernel/independent"];
    let variants = laws.iter().zip(names).map(|(law, name)| {
        let (engine, sampler) = name.split_once('/').unwrap();
        Variant {
            name: name.into(),
            engine: engine.into(),
            sampler: sampler.into(),
            settings: vec![("batch".into(), "4096".into())],
            runs: (1..=seeds).map(|seed| run(normal, law, engine, seed)).collect(),
            error_products: None,
        }
    });
    let errors = Errors { mse: 0.02, relmse: 0.015, relmse_trimmed: 0.014, mean_ratio: [1.01, 1.0, 0.99] };
    Experiment {
        scene: "scenes/cornell.pbrt".into(),
        width: 96,
        height: 64,
        machine: Machine {
            cpu: "Example Processor @ 2.80GHz".into(),
            isa: "avx512".into(),
            threads: 2,
            os: "linux".into(),
        },
        version: "0.1.0".into(),
        commit: Some("0123abc".into()),
        command_line: ["wavepath", "converge", "scenes/cornell.pbrt", "-o", "a folder"]
            .map(String::from)
            .into(),
        reference: Reference {
            kind: ReferenceKind::File { path: "cornell.exr".into() },
            spp: Some(65536.0),
            own_error: None,
        },
        target_relmse: None,
        variants: variants.collect(),
        externals: vec![External { name: "pbrt-v4".into(), file: "pbrt.exr".into(), seconds: 5.0, errors }],
    }
}

fn run(normal: &mut Normal, law: &Law, engine: &str, seed: u64) -> Run {
    let mut deviation = 0.0;
    let mut point = |index: i32| {
        let seconds = law.slowness * 2.0_f64.powi(index) * (1.0 + 0.01 * (normal.uniform() - 0.5));
        // Keeps the variance: 0.25 + 0.75.
        let fresh = normal.draw();
        deviation = if index == 0 { fresh } else { 0.5 * deviation + 0.75_f64.sqrt() * fresh };
        let error = law.error_at_one_second * seconds.powf(law.slope) * (law.spread * deviation).exp();
        let spp = 16.0 * f64::from(1 << index);
        let stages = [("generate", 0.1), ("intersect", 0.9), ("material_sort", 0.1), ("shade", 0.5)];
        let stages = stages.into_iter().chain([("light_sample", 0.3), ("film", 0.08)]);
        let stages = stages.map(|(name, share)| (name.to_string(), share * seconds)).collect();
        Point {
            seconds,
            spp,
            samples: (spp * 96.0 * 64.0) as u64,
            errors: Errors {
                mse: 0.5 * error,
                relmse: error,
                relmse_trimmed: 0.8 * error,
                mean_ratio: [0; 3].map(|_| 1.0 + 0.001 * normal.draw()),
            },
            estimated_relmse: Some(0.97 * error),
            stage_seconds: if engine == "wavefront" { stages } else { vec![(engine.into(), 1.98 * seconds)] },
            invalid_samples: 0,
        }
    };
    Run { seed, setup_seconds: 0.1, points: (0..6).map(&mut point).collect() }
}

/// An experiment as it usually looks, with pictures: four variants and a reference of 96 x 64 pixels.
pub fn full() -> (Experiment, Image, Vec<(String, Image)>) {
    let law = |error_at_one_second, slope| Law { error_at_one_second, slope, spread: 0.06, slowness: 0.25 };
    let laws = [law(0.006, -1.08), law(0.03, -1.05), law(0.018, -1.0), law(0.085, -0.99)];
    let mut normal = Normal::new(2026);
    let mut experiment = experiment(&mut normal, &laws, 5);
    experiment.reference.own_error = Some(OwnError { mse: 1e-6, relmse: 2e-6, relmse_trimmed: 1.8e-6 });
    let reference = picture(&mut normal, 0.0);
    let mut images = Vec::new();
    for (variant, law) in experiment.variants.iter_mut().zip(laws) {
        let error = law.error_at_one_second * 8.0_f64.powf(law.slope);
        let pictures: Vec<Image> = variant.runs.iter().map(|_| picture(&mut normal, error.sqrt())).collect();
        let products = bias::error_products(&pictures.iter().collect::<Vec<_>>(), &reference);
        variant.error_products = Some(products.unwrap());
        images.push((variant.name.clone(), pictures.into_iter().next().unwrap()));
    }
    images.push(("pbrt-v4".into(), picture(&mut normal, 0.12)));
    (experiment, reference, images)
}

/// A sky with a bright sun and a ball, with relative noise.
fn picture(normal: &mut Normal, noise: f64) -> Image {
    let (width, height) = (96, 64);
    let mut pixel = |index: u32| {
        let (x, y) = (f64::from(index % width) / 64.0, f64::from(index / width) / 64.0);
        let ball = (x - 0.6).hypot(y - 0.55);
        let sun = (x - 1.2).hypot(y - 0.2);
        let colour = if sun < 0.08 {
            [12.0, 10.0, 6.0]
        } else if ball < 0.3 {
            let light = 0.02 + (0.3 - ball) * 2.0 * (1.1 - y);
            [0.9 * light, 0.3 * light, 0.2 * light]
        } else {
            [0.2 + 0.3 * y, 0.35 + 0.3 * y, 0.7 - 0.1 * y]
        };
        colour.map(|value: f64| (value * (1.0 + noise * normal.draw())).max(0.0) as f32)
    };
    Image::new(width, height, (0..width * height).map(&mut pixel).collect())
}
