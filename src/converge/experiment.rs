//! The experiment itself: every engine with every sampler renders the scene once for each seed, in turn: all of them with
//! the first seed, then all with the second. So what disturbs the machine for a while disturbs all. Engines share seeds
//! and are compared in pairs. A run is paused at its checkpoints, at doubling times; only the time between pauses counts.
//! The scene is read once, and each tree is built once: that is the setup, and counted apart.

use super::external::ExternalSpec;
use super::replicates::{FinalPicture, PooledReference};
use super::{
    Errors, Experiment, External, Machine, Measure, OwnError, Point, Reference, ReferenceKind, Run, Variant,
    bias,
};
use crate::compare::{SizeMismatch, compare};
use crate::engine::session::Ended;
use crate::engine::{EngineKind, SamplerKind, Tree, wavefront};
use crate::film::{Developed, Film};
use crate::machine;
use crate::memory;
use crate::picture::{DataWindow, Image};
use crate::render::{Render, RenderError, image_of, stages};
use crate::report::Report;
use crate::scene::{Scene, SceneDescription};
use crate::time_span;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use wavepath_kernels::isa::Level;

/// Checkpoints of a run: the first is after 1/64 of the time.
const CHECKPOINTS: u32 = 7;

/// What is compared, and for how long.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// Engines.
    pub engines: Vec<EngineKind>,
    /// Samplers: every engine runs with every one.
    pub samplers: Vec<SamplerKind>,
    /// Each of them with and without adaptive sampling.
    pub adaptive: bool,
    /// Rendering time of each run.
    pub budget: Duration,
    /// Runs of each, every one with a seed of its own; without a reference at least 2.
    pub seeds: usize,
    /// Worker threads.
    pub threads: usize,
    /// The converged picture and its file; none: for each run, the mean of the runs with other seeds.
    pub reference: Option<(PathBuf, Image)>,
    /// Pictures of other programs.
    pub externals: Vec<(ExternalSpec, Image)>,
    /// The command, word by word, for the record.
    pub command_line: Vec<String>,
    /// Ends the experiment early once it is set: complete runs are evaluated.
    pub interrupted: Arc<AtomicBool>,
}

/// Why there is no experiment.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvergeError {
    /// Something is compared with itself.
    #[error("{name} is asked for twice: expected each name once")]
    Twice {
        /// Engine and sampler.
        name: String,
    },
    /// Too few seeds to compare runs with each other.
    #[error(
        "without --reference, each run is compared with the mean of the other seeds: expected --seeds 2 or more"
    )]
    Seeds,
    /// The pictures do not fit into the memory that is free.
    #[error(
        "{scene}: the pictures of {runs} runs at {} x {} pixels need {}; {} of memory are free for them: expected a \
         smaller --resolution or fewer --seeds{hint}",
        resolution[0], resolution[1], memory::in_gib(*needed), memory::in_gib(*free)
    )]
    Memory {
        /// Name of the scene.
        scene: String,
        /// Runs.
        runs: u64,
        /// Width and height.
        resolution: [u32; 2],
        /// Bytes.
        needed: u64,
        /// Bytes.
        free: u64,
        /// What else would help.
        hint: &'static str,
    },
    /// Pictures of different sizes.
    #[error(transparent)]
    Size(#[from] SizeMismatch),
    /// A render did not begin.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// It was ended too early.
    #[error("interrupted before there was anything to compare: nothing is written")]
    Interrupted,
}

/// The pixels that are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Where they lie in the image.
    pub window: DataWindow,
}

impl Frame {
    /// Of a scene.
    pub fn of(description: &SceneDescription) -> Self {
        let [x0, x1, y0, y1] = description.film.pixel_bounds;
        let [full_width, full_height] = description.film.resolution;
        let window = DataWindow { x: x0 as i32, y: y0 as i32, full_width, full_height };
        Self { width: x1 - x0, height: y1 - y0, window }
    }
}

/// An engine with a sampler, adaptive or not.
#[derive(Clone, Copy, PartialEq)]
struct Choice {
    engine: EngineKind,
    sampler: SamplerKind,
    adaptive: bool,
}

impl Choice {
    fn name(self) -> String {
        format!(
            "{}/{}{}",
            self.engine.name(),
            self.sampler.name(),
            if self.adaptive { "/adaptive" } else { "" }
        )
    }
}

/// Every engine with every sampler, and again adaptive if that is to be compared.
fn variants(conditions: &Conditions) -> Result<Vec<Choice>, ConvergeError> {
    let mut variants = Vec::new();
    for &engine in &conditions.engines {
        for &sampler in &conditions.samplers {
            let choice = Choice { engine, sampler, adaptive: false };
            if variants.contains(&choice) {
                return Err(ConvergeError::Twice { name: choice.name() });
            }
            variants.push(choice);
            if conditions.adaptive {
                variants.push(Choice { adaptive: true, ..choice });
            }
        }
    }
    Ok(variants)
}

/// A run with its pictures.
struct Measured {
    choice: Choice,
    run: Run,
    last: FinalPicture,
    /// What [`Point::errors`] is still to be computed from; empty if it has been.
    pictures: Vec<Image>,
}

/// What an experiment works with.
struct Work<'a> {
    scene: &'a Scene,
    conditions: &'a Conditions,
}

/// Checks what can be checked before anything is rendered.
///
/// # Errors
/// [`ConvergeError`].
pub fn check(scene: &Scene, conditions: &Conditions) -> Result<(), ConvergeError> {
    if conditions.reference.is_none() && conditions.seeds < 2 {
        return Err(ConvergeError::Seeds);
    }
    let variants = variants(conditions)?;
    Work { scene, conditions }.check_memory(variants.len(), conditions.reference.is_none())
}

/// Runs the experiment; `say` is told how far it is.
///
/// # Errors
/// [`ConvergeError`].
pub fn measure(
    scene: &Scene,
    conditions: &Conditions,
    say: &mut dyn FnMut(&str),
) -> Result<(Experiment, Results), ConvergeError> {
    check(scene, conditions)?;
    let work = Work { scene, conditions };
    let reference = conditions.reference.as_ref().map(|(_, image)| image);
    let measured = work.measure(&variants(conditions)?, reference, say)?;
    work.evaluate(measured)
}

impl Work<'_> {
    /// Pictures that are kept to the end must fit into memory.
    fn check_memory(&self, variants: usize, all_checkpoints: bool) -> Result<(), ConvergeError> {
        let film = &self.scene.description().film;
        let runs = (variants * self.conditions.seeds) as u64;
        let kept = if all_checkpoints { u64::from(CHECKPOINTS) } else { 0 } + 2;
        let frame = Frame::of(self.scene.description());
        let pictures =
            runs * kept * u64::from(frame.width) * u64::from(frame.height) * size_of::<[f32; 3]>() as u64;
        let needed = pictures + Film::bytes_for_render(film.frame(), self.scene.plan().requirements(), None);
        if needed <= memory::limit() {
            return Ok(());
        }
        Err(ConvergeError::Memory {
            scene: self.scene.name().into(),
            runs,
            resolution: [frame.width, frame.height],
            needed,
            free: memory::limit(),
            hint: if all_checkpoints { ", or a --reference" } else { "" },
        })
    }

    /// All runs that were completed.
    fn measure(
        &self,
        variants: &[Choice],
        reference: Option<&Image>,
        say: &mut dyn FnMut(&str),
    ) -> Result<Vec<Measured>, ConvergeError> {
        let Conditions { seeds, budget, .. } = *self.conditions;
        let loading: Duration = self.scene.setup().iter().map(|(_, time)| *time).sum();
        let mut trees = Vec::new();
        for choice in variants {
            let started = Instant::now();
            let tree = self.scene.tree(choice.engine);
            trees.push((tree, loading + started.elapsed()));
        }
        let runs = variants.len() * seeds;
        let total = budget.saturating_mul(u32::try_from(runs).unwrap_or(u32::MAX));
        say(&format!(
            "{} variants x {seeds} seeds x {} s: about {} of rendering",
            variants.len(),
            budget.as_secs_f64(),
            time_span::clock(total)
        ));
        let used = reference.and_then(report_of).map(|report| report.seed);
        // The reference's own random numbers would agree with it.
        let seeds: Vec<u64> = (1..).filter(|seed| Some(*seed) != used).take(seeds).collect();
        let mut measured = Vec::with_capacity(runs);
        for &seed in &seeds {
            for (choice, (tree, setup)) in variants.iter().zip(&trees) {
                let Some(run) = self.run(*choice, seed, tree, *setup, reference)? else {
                    return self.interrupted(measured, say);
                };
                let last = run.run.points.last().expect("a run has a checkpoint");
                let error = last.estimated_relmse.map_or("unknown".into(), |error| format!("{error:.2e}"));
                say(&format!(
                    "{:>3} of {runs}: {}, seed {seed}: {:.1} spp, estimated relMSE {error}",
                    measured.len() + 1,
                    choice.name(),
                    last.spp
                ));
                measured.push(run);
            }
        }
        Ok(measured)
    }

    /// What is left of an experiment that was interrupted.
    fn interrupted(
        &self,
        measured: Vec<Measured>,
        say: &mut dyn FnMut(&str),
    ) -> Result<Vec<Measured>, ConvergeError> {
        let mut seeds: Vec<u64> = measured.iter().map(|run| run.run.seed).collect();
        seeds.dedup();
        let needed = if self.conditions.reference.is_some() { 1 } else { 2 };
        if seeds.len() < needed {
            return Err(ConvergeError::Interrupted);
        }
        say(&format!("interrupted: {} complete runs", measured.len()));
        Ok(measured)
    }

    /// One run; `None` if it was interrupted.
    fn run(
        &self,
        choice: Choice,
        seed: u64,
        tree: &Tree,
        setup: Duration,
        reference: Option<&Image>,
    ) -> Result<Option<Measured>, ConvergeError> {
        let render = Render::new(self.scene)
            .engine(choice.engine)
            .sampler(choice.sampler)
            .adaptive(choice.adaptive)
            .threads(self.conditions.threads)
            .seed(seed)
            .time(self.conditions.budget)
            .stop_on(self.conditions.interrupted.clone());
        let film = render.film()?;
        let mut session = render.session(tree, &film)?;
        let (mut points, mut pictures, mut last) = (Vec::<Point>::new(), Vec::new(), None);
        for checkpoint in (0..CHECKPOINTS).rev().map(|halvings| self.conditions.budget / (1 << halvings)) {
            // The first samples of all pixels may have taken longer.
            if session.elapsed() >= checkpoint && !points.is_empty() {
                continue;
            }
            if session.run(Some(checkpoint), |_| ()) == Ended::Interrupt {
                return Ok(None);
            }
            let Developed { pixels, samples, invalid, relmse, .. } = film.develop();
            // Nothing new in the moment that was left.
            if points.last().is_some_and(|point| point.samples == samples) {
                continue;
            }
            let image = image_of(self.scene.description(), pixels);
            let errors = match reference {
                Some(reference) => Errors::from(&compare(&image, reference)?),
                // Not known before all runs are done.
                None => {
                    let unknown = f64::NAN;
                    pictures.push(image.clone());
                    Errors {
                        mse: unknown,
                        relmse: unknown,
                        relmse_trimmed: unknown,
                        mean_ratio: [unknown; 3],
                    }
                }
            };
            points.push(Point {
                seconds: session.elapsed().as_secs_f64(),
                spp: samples as f64 / film.pixels() as f64,
                samples,
                errors,
                estimated_relmse: relmse,
                stage_seconds: stages(session.stats()),
                invalid_samples: invalid,
            });
            last = Some((image, samples));
        }
        Ok(last.map(|(image, samples)| Measured {
            choice,
            run: Run { seed, setup_seconds: setup.as_secs_f64(), points },
            last: FinalPicture {
                seed,
                sampler: choice.sampler.name().to_string(),
                samples,
                image,
                variance: film.statistics().variance,
            },
            pictures,
        }))
    }

    /// The experiment, and the reference of its pictures.
    fn evaluate(&self, measured: Vec<Measured>) -> Result<(Experiment, Results), ConvergeError> {
        let mut runs = Vec::new();
        let mut finals = Vec::new();
        for Measured { choice, run, last, pictures } in measured {
            runs.push((choice, run, pictures));
            finals.push(last);
        }
        let (about, image, products): (Reference, Image, Products) = match &self.conditions.reference {
            Some((path, image)) => {
                let about = from_file(path, image, &runs);
                let products = Box::new(|pictures: &[&FinalPicture], image: &Image| {
                    let images: Vec<&Image> = pictures.iter().map(|picture| &picture.image).collect();
                    Ok(Some(bias::error_products(&images, image)?))
                });
                (about, image.clone(), products)
            }
            None => {
                let all = PooledReference::of(&finals, &[]).expect("there are pictures");
                for (_, run, pictures) in &mut runs {
                    let others = PooledReference::of(&finals, &[run.seed]).expect("there are two seeds");
                    for (point, picture) in run.points.iter_mut().zip(std::mem::take(pictures)) {
                        let errors = Errors::from(&compare(&picture, &others.image)?);
                        point.errors = others.translate(errors, &all.own_error);
                    }
                }
                let about = Reference {
                    kind: ReferenceKind::Replicates { count: all.count },
                    spp: Some((all.spp * 10.0).round() / 10.0),
                    own_error: Some(all.own_error),
                };
                let (finals, own) = (&finals, all.own_error);
                let products: Products =
                    Box::new(move |pictures, _| products_of_replicates(pictures, finals, &own));
                (about, all.image, products)
            }
        };
        let mut variants: Vec<Variant> = Vec::new();
        let mut shown = Vec::new();
        for choice in self::variants(self.conditions)? {
            let of_choice = || runs.iter().zip(&finals).filter(|((c, ..), _)| *c == choice);
            let pictures: Vec<&FinalPicture> = of_choice().map(|(_, picture)| picture).collect();
            let Some(first) = pictures.first() else { continue };
            let runs: Vec<Run> = of_choice().map(|((_, run, _), _)| run.clone()).collect();
            let last = runs[0].points.last().expect("a run has a checkpoint");
            let caption = format!("{:.2} s, {:.1} spp, seed {}", last.seconds, last.spp, runs[0].seed);
            shown.push((choice.name(), caption, first.image.clone()));
            let batch = (choice.engine == EngineKind::Wavefront)
                .then(|| ("batch".to_string(), wavefront::DEFAULT_BATCH.to_string()));
            let adaptive = choice.adaptive.then(|| ("adaptive".to_string(), "yes".to_string()));
            variants.push(Variant {
                name: choice.name(),
                engine: choice.engine.name().to_string(),
                sampler: choice.sampler.name().to_string(),
                settings: batch.into_iter().chain(adaptive).collect(),
                runs,
                error_products: products(&pictures, &image)?,
            });
        }
        let externals = self
            .conditions
            .externals
            .iter()
            .map(|(spec, picture)| Ok(External::measure(spec, picture, &image)?))
            .collect::<Result<Vec<_>, ConvergeError>>()?;
        drop(products);
        let experiment = Experiment {
            scene: self.scene.name().to_string(),
            width: image.width,
            height: image.height,
            machine: Machine {
                cpu: machine::cpu_name(),
                isa: Level::detect().name().to_string(),
                threads: self.conditions.threads,
                os: std::env::consts::OS.to_string(),
            },
            version: env!("CARGO_PKG_VERSION").to_string(),
            commit: option_env!("WAVEPATH_COMMIT").map(String::from),
            command_line: self.conditions.command_line.clone(),
            reference: about,
            target_relmse: None,
            variants,
            externals,
        };
        Ok((experiment, Results { reference: image, shown }))
    }
}

/// [`Variant::error_products`] of some last pictures.
type Products<'a> =
    Box<dyn Fn(&[&FinalPicture], &Image) -> Result<Option<Vec<Vec<f64>>>, ConvergeError> + 'a>;

/// Pictures to show.
#[derive(Clone, Debug)]
pub struct Results {
    /// What all are compared with.
    pub reference: Image,
    /// Name, caption and picture of each variant.
    pub shown: Vec<(String, String, Image)>,
}

/// Each two pictures against the mean of the seeds of neither; `None` if no seed is left.
fn products_of_replicates(
    pictures: &[&FinalPicture],
    finals: &[FinalPicture],
    own: &OwnError,
) -> Result<Option<Vec<Vec<f64>>>, ConvergeError> {
    let count = pictures.len();
    let mut products = vec![vec![0.0; count]; count];
    for i in 0..count {
        for j in 0..=i {
            let (a, b) = (pictures[i], pictures[j]);
            let Some(others) = PooledReference::of(finals, &[a.seed, b.seed]) else { return Ok(None) };
            let product = bias::error_products(&[&a.image, &b.image], &others.image)?[0][1];
            let product = product - others.own_error.relmse + own.relmse;
            (products[i][j], products[j][i]) = (product, product);
        }
    }
    Ok(Some(products))
}

/// The report that wavepath wrote into the picture, if it speaks of all of it.
fn report_of(image: &Image) -> Option<Report> {
    let report: Report = serde_json::from_str(image.metadata.report.as_deref()?).ok()?;
    ((report.width, report.height) == (image.width, image.height)).then_some(report)
}

/// A reference from a file. Its own relMSE is what its render estimated; the other measures are in proportion, as they
/// are in the last pictures of the runs.
fn from_file(path: &Path, image: &Image, runs: &[(Choice, Run, Vec<Image>)]) -> Reference {
    let report = report_of(image);
    let last = || runs.iter().filter_map(|(_, run, _)| run.points.last()).map(|point| point.errors);
    let sum = |measure: Measure| last().map(|errors| measure.of(&errors)).sum::<f64>();
    let own_error = report.as_ref().and_then(|report| report.estimated_relmse).map(|relmse| {
        let in_proportion = |measure| relmse * sum(measure) / sum(Measure::Relmse);
        OwnError {
            mse: in_proportion(Measure::Mse),
            relmse,
            relmse_trimmed: in_proportion(Measure::RelmseTrimmed),
        }
    });
    let path = path.display().to_string();
    Reference { kind: ReferenceKind::File { path }, spp: report.map(|report| report.spp), own_error }
}
