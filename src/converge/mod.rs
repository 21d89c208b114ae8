//! Convergence experiments: how the error of several variants falls with run time.
//!
//! A variant (engine, sampler, settings) renders the scene once for each seed and stops at checkpoints, usually at
//! doubling times; each checkpoint's picture is compared with a reference. What was measured is an [`Experiment`]:
//! plain data. From it follow
//!
//! | module | what it makes |
//! |---|---|
//! | [`summary`] | figures with 95 % intervals: slopes, efficiencies, ratios at equal time and at equal error |
//! | [`table`] | a table for the terminal |
//! | [`csv`] | every measured point, one a row |
//! | [`plots`] | SVG: error against time, stage times, efficiency |
//! | [`html`] | one page with all of it and a viewer for the images, which opens without a network |
//! | [`files`] | the folder with all of these and `converge.json` |
//!
//! [`experiment`] renders and measures. [`statistics`], [`curve`] and [`bias`] hold the methods, [`replicates`] makes a reference where there is none,
//! [`external`] reads pictures of other programs from the command line.

pub mod bias;
pub mod csv;
pub mod curve;
pub(crate) mod escape;
pub mod experiment;
pub mod external;
mod figures;
pub mod files;
pub mod html;
mod pictures;
pub mod plots;
pub mod replicates;
mod sentences;
pub mod statistics;
pub mod summary;
#[cfg(test)]
mod synthetic;
pub mod table;

use serde::{Serialize, Serializer};

use crate::compare::Comparison;

/// Everything that was measured, and how.
///
/// Serialised as the field names have it; an unknown figure or one that is not finite is `null`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Experiment {
    /// Path of the scene file, as given.
    pub scene: String,
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Where it ran.
    pub machine: Machine,
    /// Version of wavepath.
    pub version: String,
    /// Commit that it was built from, if known.
    pub commit: Option<String>,
    /// The command line, word by word, the program's name first.
    pub command_line: Vec<String>,
    /// What the pictures are compared with.
    pub reference: Reference,
    /// The error that the times to a given error are for, in relMSE; `None`: one that all variants reach.
    pub target_relmse: Option<f64>,
    /// The variants, in the order in which they are shown.
    pub variants: Vec<Variant>,
    /// Pictures of other programs.
    pub externals: Vec<External>,
}

/// The machine of an experiment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Name of the processor.
    pub cpu: String,
    /// Instruction set that the kernels ran with.
    pub isa: String,
    /// Worker threads.
    pub threads: usize,
    /// Operating system.
    pub os: String,
}

/// The picture that stands for the truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reference {
    /// Where it comes from.
    pub kind: ReferenceKind,
    /// Samples per pixel, if known.
    pub spp: Option<f64>,
    /// What it is itself off by, if known: the expected error between it and the converged picture. It is
    /// subtracted from every measured error.
    pub own_error: Option<OwnError>,
}

/// Where a reference comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReferenceKind {
    /// A file.
    File {
        /// Its path, as given.
        path: String,
    },
    /// The mean of pictures that this experiment rendered with seeds of their own.
    Replicates {
        /// How many.
        count: usize,
    },
}

/// The reference's own error, in the measures of [`Errors`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OwnError {
    /// MSE, radiance squared.
    pub mse: f64,
    /// relMSE.
    pub relmse: f64,
    /// relMSE, trimmed.
    pub relmse_trimmed: f64,
}

/// One way of rendering, and what it measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Variant {
    /// What it is called in tables and plots, such as `wavefront/sobol`; unique in the experiment.
    pub name: String,
    /// `wavefront` or `megakernel`.
    pub engine: String,
    /// `sobol` or `independent`.
    pub sampler: String,
    /// Other settings by name, such as `batch`; an object in JSON.
    #[serde(serialize_with = "as_map")]
    pub settings: Vec<(String, String)>,
    /// One run for each seed. Variants that share seeds are compared in pairs.
    pub runs: Vec<Run>,
    /// For the last pictures of the runs, [`bias::error_products`]: the error common to all seeds follows from it.
    pub error_products: Option<Vec<Vec<f64>>>,
}

/// One render from the first sample to the end of the budget.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Run {
    /// Seed of the random numbers.
    pub seed: u64,
    /// Time before the first sample (reading, building the BVH), in seconds of wall clock.
    pub setup_seconds: f64,
    /// The checkpoints, in order of time.
    pub points: Vec<Point>,
}

/// A render at a checkpoint. All figures count from the start of the render.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    /// Time spent rendering, in seconds of wall clock, without setup and without comparing.
    pub seconds: f64,
    /// Samples per pixel; the mean where pixels differ.
    pub spp: f64,
    /// Pixel samples.
    pub samples: u64,
    /// Distance from the reference, as measured: the reference's own error is part of it.
    #[serde(flatten)]
    pub errors: Errors,
    /// relMSE that the render itself estimates, without a reference.
    pub estimated_relmse: Option<f64>,
    /// Seconds in each stage, summed over the workers, in the order the stages run; an object in JSON.
    #[serde(serialize_with = "as_map")]
    pub stage_seconds: Vec<(String, f64)>,
    /// Samples that came out NaN, infinite or negative and were dropped.
    pub invalid_samples: u64,
}

/// Error measures as [`crate::compare`] defines them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Errors {
    /// Mean squared error, radiance squared.
    pub mse: f64,
    /// Relative mean squared error.
    pub relmse: f64,
    /// The same without the 0.1 % of pixels with the largest error.
    pub relmse_trimmed: f64,
    /// Mean of the picture over mean of the reference, for red, green, blue; NaN where the reference is black.
    pub mean_ratio: [f64; 3],
}

impl From<&Comparison> for Errors {
    fn from(comparison: &Comparison) -> Self {
        let Comparison { mse, relmse, relmse_trimmed, mean_ratio, .. } = *comparison;
        Self { mse, relmse, relmse_trimmed, mean_ratio }
    }
}

/// A picture that another program rendered.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct External {
    /// What it is called in tables and plots.
    pub name: String,
    /// Its file, as given.
    pub file: String,
    /// How long it took, in seconds, as given.
    pub seconds: f64,
    /// Distance from the reference.
    #[serde(flatten)]
    pub errors: Errors,
}

/// The measures of error that can be plotted against time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// [`Errors::relmse`].
    Relmse,
    /// [`Errors::relmse_trimmed`].
    RelmseTrimmed,
    /// [`Errors::mse`].
    Mse,
}

impl Measure {
    /// All of them; the first is the one that headlines are about.
    pub const ALL: [Self; 3] = [Self::Relmse, Self::RelmseTrimmed, Self::Mse];

    /// The name in tables and plots.
    pub fn name(self) -> &'static str {
        match self {
            Self::Relmse => "relMSE",
            Self::RelmseTrimmed => "relMSE, trimmed",
            Self::Mse => "MSE",
        }
    }

    /// Its value.
    pub fn of(self, errors: &Errors) -> f64 {
        match self {
            Self::Relmse => errors.relmse,
            Self::RelmseTrimmed => errors.relmse_trimmed,
            Self::Mse => errors.mse,
        }
    }

    /// The reference's own error; 0 if it is not known.
    pub fn own(self, reference: &Reference) -> f64 {
        reference.own_error.map_or(0.0, |own| match self {
            Self::Relmse => own.relmse,
            Self::RelmseTrimmed => own.relmse_trimmed,
            Self::Mse => own.mse,
        })
    }
}

/// A list of names and values as a JSON object that keeps their order.
fn as_map<S: Serializer, V: Serialize>(entries: &[(String, V)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(entries.iter().map(|(name, value)| (name, value)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_is_flat_where_it_reads_better_and_keeps_the_order_of_stages() {
        let point = Point {
            seconds: 1.0,
            spp: 4.0,
            samples: 400,
            errors: Errors {
                mse: 0.5,
                relmse: 0.25,
                relmse_trimmed: 0.125,
                mean_ratio: [1.0, f64::NAN, 1.0],
            },
            estimated_relmse: None,
            stage_seconds: vec![("shade".into(), 0.5), ("film".into(), 0.25)],
            invalid_samples: 0,
        };
        let json = serde_json::to_string(&point).unwrap();
        for part in [
            r#""mse":0.5,"relmse":0.25,"relmse_trimmed":0.125,"mean_ratio":[1.0,null,1.0]"#,
            r#""estimated_relmse":null"#,
            r#""stage_seconds":{"shade":0.5,"film":0.25}"#,
        ] {
            assert!(json.contains(part), "{json}");
        }
    }
}
