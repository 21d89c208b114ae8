//! `wavepath converge`: the error of engines and samplers against their run time.
//!
//! Every engine with every sampler renders the scene once for each seed, in turn: all of them with the first seed, then
//! all with the second. So what disturbs the machine for a while disturbs all. Engines share seeds and are compared in
//! pairs. A run is paused at its checkpoints, at doubling times; only the time between pauses counts. The scene is
//! read once, and each tree is built once: that is the setup, and counted apart.

use std::path::Path;
use std::time::{Duration, Instant};

use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;
use wavepath_kernels::scene::Scene;

use super::args::{ConvergeArgs, Engine, SamplerChoice};
use super::{Failure, output, render};
use crate::compare::compare;
use crate::converge::external::ExternalSpec;
use crate::converge::files::{self, FilesError};
use crate::converge::html;
use crate::converge::replicates::{FinalPicture, PooledReference};
use crate::converge::summary::Summary;
use crate::converge::{
    Errors, Experiment, External, Machine, Measure, OwnError, Point, Reference, ReferenceKind, Run, Variant,
    bias, table,
};
use crate::engine::schedule::Stop;
use crate::engine::session::{Ended, Session};
use crate::engine::{Settings, Tree, wavefront};
use crate::film::{Developed, Film};
use crate::machine;
use crate::memory;
use crate::picture::{self, DataWindow, Image};
use crate::plan::Plan;
use crate::report::Report;
use crate::scene::{SceneDescription, SphericalLights};
use crate::time_span;

/// Checkpoints of a run: the first is after 1/64 of the time.
const CHECKPOINTS: u32 = 7;

/// Measures, prints the table and writes the folder.
pub(super) fn run(args: &ConvergeArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let resolution = args.resolution.map(|r| (r.width, r.height));
    let (description, scene) = render::load(&args.scene, SphericalLights::Cone, resolution, args.quiet)?;
    let loading = started.elapsed();
    let like = Frame::of(&description);
    let reference = args.reference.as_deref().map(|path| read(path, &like)).transpose()?;
    let externals = args
        .external
        .iter()
        .map(|spec| Ok((spec, read(&spec.file, &like)?)))
        .collect::<Result<Vec<_>, Failure>>()?;
    if reference.is_none() && args.seeds < 2 {
        return Err(Failure::Usage(
            "without --reference, each run is compared with the mean of the other seeds: expected --seeds 2 or more"
                .into(),
        ));
    }
    let variants = variants(args)?;
    let plan = Plan::new(&scene);
    let work = Work { args, description: &description, scene: &scene, plan: &plan, loading };
    work.check_memory(variants.len(), reference.is_none())?;
    // Makes the folder: nothing that can be wrong with the command line or the inputs comes after this.
    files::prepare(&args.output).map_err(|error| Failure::Usage(error.to_string()))?;
    let measured = work.measure(&variants, reference.as_ref())?;
    let (experiment, reference) = work.evaluate(measured, reference, &externals)?;
    work.write(&experiment, &reference, &externals)
}

/// The pixels that are rendered.
struct Frame {
    width: u32,
    height: u32,
    window: DataWindow,
}

impl Frame {
    fn of(description: &SceneDescription) -> Self {
        let [x0, x1, y0, y1] = description.film.pixel_bounds;
        let [full_width, full_height] = description.film.resolution;
        let window = DataWindow { x: x0 as i32, y: y0 as i32, full_width, full_height };
        Self { width: x1 - x0, height: y1 - y0, window }
    }
}

/// Reads a picture that shows what is rendered, or more.
fn read(path: &Path, like: &Frame) -> Result<Image, Failure> {
    let image = picture::read(path)?;
    let Frame { width, height, window } = *like;
    if (image.width, image.height) == (width, height) {
        return Ok(image);
    }
    if let Some(part) = image.crop(window, width, height) {
        return Ok(Image { metadata: image.metadata, ..part });
    }
    let whole = (image.window.full_width, image.window.full_height) == (image.width, image.height);
    let hint = if whole {
        format!("; --resolution {}x{} renders that size", image.width, image.height)
    } else {
        String::new()
    };
    Err(Failure::Input(format!(
        "cannot compare with \"{}\": it has {} x {} pixels, the scene {width} x {height}{hint}",
        path.display(),
        image.width,
        image.height,
    )))
}

/// An engine with a sampler, adaptive or not.
#[derive(Clone, Copy, PartialEq)]
struct Choice {
    engine: Engine,
    sampler: SamplerChoice,
    adaptive: bool,
}

impl Choice {
    fn name(self) -> String {
        format!("{}/{}{}", self.engine, self.sampler, if self.adaptive { "/adaptive" } else { "" })
    }
}

/// Every engine with every sampler, and again adaptive if that is to be compared.
fn variants(args: &ConvergeArgs) -> Result<Vec<Choice>, Failure> {
    let mut variants = Vec::new();
    for &engine in &args.engines {
        for &sampler in &args.samplers {
            let choice = Choice { engine, sampler, adaptive: false };
            if variants.contains(&choice) {
                let name = choice.name();
                return Err(Failure::Usage(format!("{name} is asked for twice: expected each name once")));
            }
            variants.push(choice);
            if args.adaptive {
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
    args: &'a ConvergeArgs,
    description: &'a SceneDescription,
    scene: &'a Scene,
    plan: &'a Plan,
    loading: Duration,
}

impl Work<'_> {
    fn threads(&self) -> usize {
        self.args.threads.unwrap_or_else(render::default_threads)
    }

    /// Pictures that are kept to the end must fit into memory.
    fn check_memory(&self, variants: usize, all_checkpoints: bool) -> Result<(), Failure> {
        let film = &self.description.film;
        let runs = (variants * self.args.seeds) as u64;
        let kept = if all_checkpoints { u64::from(CHECKPOINTS) } else { 0 } + 2;
        let frame = Frame::of(self.description);
        let pictures =
            runs * kept * u64::from(frame.width) * u64::from(frame.height) * size_of::<[f32; 3]>() as u64;
        let needed = pictures + Film::bytes_for_render(film.frame(), self.plan.requirements, None);
        if needed <= memory::limit() {
            return Ok(());
        }
        Err(Failure::Input(format!(
            "{}: the pictures of {runs} runs at {} x {} pixels need {}; {} of memory are free for them: expected a \
             smaller --resolution or fewer --seeds{}",
            self.args.scene.display(),
            frame.width,
            frame.height,
            memory::in_gib(needed),
            memory::in_gib(memory::limit()),
            if all_checkpoints { ", or a --reference" } else { "" },
        )))
    }

    /// All runs that were completed.
    fn measure(&self, variants: &[Choice], reference: Option<&Image>) -> Result<Vec<Measured>, Failure> {
        let ConvergeArgs { seeds, budget, quiet, .. } = *self.args;
        let interrupted = crate::interrupt::flag()
            .map_err(|error| Failure::Work(format!("cannot watch for Ctrl-C: {error}")))?;
        let mut trees = Vec::new();
        for choice in variants {
            let started = Instant::now();
            let tree = Tree::build(render::engine_kind(choice.engine), self.scene);
            trees.push((tree, self.loading + started.elapsed()));
        }
        let runs = variants.len() * seeds;
        if !quiet {
            let total = budget.saturating_mul(u32::try_from(runs).unwrap_or(u32::MAX));
            output::note(format_args!(
                "{} variants x {seeds} seeds x {} s: about {} of rendering",
                variants.len(),
                budget.as_secs_f64(),
                time_span::clock(total)
            ));
        }
        let used = reference.and_then(report_of).map(|report| report.seed);
        // The reference's own random numbers would agree with it.
        let seeds: Vec<u64> = (1..).filter(|seed| Some(*seed) != used).take(seeds).collect();
        let mut measured = Vec::with_capacity(runs);
        for &seed in &seeds {
            for (choice, (tree, setup)) in variants.iter().zip(&trees) {
                let stop = Stop { spp: None, time: Some(budget), interrupted: interrupted.clone() };
                let Some(run) = self.run(*choice, seed, tree, *setup, stop, reference)? else {
                    return self.interrupted(measured);
                };
                if !quiet {
                    let last = run.run.points.last().expect("a run has a checkpoint");
                    let error =
                        last.estimated_relmse.map_or("unknown".into(), |error| format!("{error:.2e}"));
                    output::note(format_args!(
                        "{:>3} of {runs}: {}, seed {seed}: {:.1} spp, estimated relMSE {error}",
                        measured.len() + 1,
                        choice.name(),
                        last.spp
                    ));
                }
                measured.push(run);
            }
        }
        Ok(measured)
    }

    /// What is left of an experiment that was interrupted.
    fn interrupted(&self, measured: Vec<Measured>) -> Result<Vec<Measured>, Failure> {
        let mut seeds: Vec<u64> = measured.iter().map(|run| run.run.seed).collect();
        seeds.dedup();
        let needed = if self.args.reference.is_some() { 1 } else { 2 };
        if seeds.len() < needed {
            return Err(Failure::Work(
                "interrupted before there was anything to compare: nothing is written".into(),
            ));
        }
        output::note(format_args!("interrupted: {} complete runs", measured.len()));
        Ok(measured)
    }

    /// One run; `None` if it was interrupted.
    fn run(
        &self,
        choice: Choice,
        seed: u64,
        tree: &Tree,
        setup: Duration,
        stop: Stop,
        reference: Option<&Image>,
    ) -> Result<Option<Measured>, Failure> {
        let film = render::film(&self.args.scene, self.description, self.scene, self.plan, None)?;
        let threads = self.threads();
        let settings = Settings {
            engine: render::engine_kind(choice.engine),
            sampler: render::sampler_kind(choice.sampler),
            threads,
            seed,
            batch: wavefront::DEFAULT_BATCH,
            level: Level::detect(),
            policy: Policy::Auto,
            adaptive: choice.adaptive,
        };
        let mut session = Session::new(self.scene, self.plan, tree, &film, &settings, stop)
            .map_err(|error| Failure::Work(format!("cannot start {threads} threads: {error}")))?;
        let (mut points, mut pictures, mut last) = (Vec::<Point>::new(), Vec::new(), None);
        for checkpoint in (0..CHECKPOINTS).rev().map(|halvings| self.args.budget / (1 << halvings)) {
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
            let image = render::picture_of(self.description, pixels);
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
                stage_seconds: render::stages(session.stats()),
                invalid_samples: invalid,
            });
            last = Some((image, samples));
        }
        Ok(last.map(|(image, samples)| Measured {
            choice,
            run: Run { seed, setup_seconds: setup.as_secs_f64(), points },
            last: FinalPicture {
                seed,
                sampler: choice.sampler.to_string(),
                samples,
                image,
                variance: film.statistics().variance,
            },
            pictures,
        }))
    }

    /// The experiment, and the reference of its pictures.
    fn evaluate(
        &self,
        measured: Vec<Measured>,
        reference: Option<Image>,
        externals: &[(&ExternalSpec, Image)],
    ) -> Result<(Experiment, Results), Failure> {
        let mut runs = Vec::new();
        let mut finals = Vec::new();
        for Measured { choice, run, last, pictures } in measured {
            runs.push((choice, run, pictures));
            finals.push(last);
        }
        let (about, image, products): (Reference, Image, Products) = match (reference, &self.args.reference) {
            (Some(image), Some(path)) => {
                let about = from_file(path, &image, &runs);
                let products = Box::new(|pictures: &[&FinalPicture], image: &Image| {
                    let images: Vec<&Image> = pictures.iter().map(|picture| &picture.image).collect();
                    Ok(Some(bias::error_products(&images, image)?))
                });
                (about, image, products)
            }
            _ => {
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
        for choice in self::variants(self.args)? {
            let of_choice = || runs.iter().zip(&finals).filter(|((c, ..), _)| *c == choice);
            let pictures: Vec<&FinalPicture> = of_choice().map(|(_, picture)| picture).collect();
            let Some(first) = pictures.first() else { continue };
            let runs: Vec<Run> = of_choice().map(|((_, run, _), _)| run.clone()).collect();
            let last = runs[0].points.last().expect("a run has a checkpoint");
            let caption = format!("{:.2} s, {:.1} spp, seed {}", last.seconds, last.spp, runs[0].seed);
            shown.push((choice.name(), caption, first.image.clone()));
            let batch = (choice.engine == Engine::Wavefront)
                .then(|| ("batch".to_string(), wavefront::DEFAULT_BATCH.to_string()));
            let adaptive = choice.adaptive.then(|| ("adaptive".to_string(), "yes".to_string()));
            variants.push(Variant {
                name: choice.name(),
                engine: choice.engine.to_string(),
                sampler: choice.sampler.to_string(),
                settings: batch.into_iter().chain(adaptive).collect(),
                runs,
                error_products: products(&pictures, &image)?,
            });
        }
        let externals = externals
            .iter()
            .map(|(spec, picture)| Ok(External::measure(spec, picture, &image)?))
            .collect::<Result<Vec<_>, Failure>>()?;
        drop(products);
        let experiment = Experiment {
            scene: self.args.scene.display().to_string(),
            width: image.width,
            height: image.height,
            machine: Machine {
                cpu: machine::cpu_name(),
                isa: Level::detect().name().to_string(),
                threads: self.threads(),
                os: std::env::consts::OS.to_string(),
            },
            version: env!("CARGO_PKG_VERSION").to_string(),
            commit: option_env!("WAVEPATH_COMMIT").map(String::from),
            command_line: std::env::args().collect(),
            reference: about,
            target_relmse: None,
            variants,
            externals,
        };
        Ok((experiment, Results { reference: image, shown }))
    }

    fn write(
        &self,
        experiment: &Experiment,
        results: &Results,
        externals: &[(&ExternalSpec, Image)],
    ) -> Result<(), Failure> {
        let mut pictures: Vec<html::Picture> = results
            .shown
            .iter()
            .map(|(name, caption, image)| html::Picture { name, caption, image })
            .collect();
        let captions: Vec<String> = externals.iter().map(|(spec, _)| format!("{} s", spec.seconds)).collect();
        for ((spec, image), caption) in externals.iter().zip(&captions) {
            pictures.push(html::Picture { name: &spec.name, caption, image });
        }
        files::write(&self.args.output, experiment, &results.reference, &pictures).map_err(|error| {
            match error {
                FilesError::Pictures(_) => Failure::Input(error.to_string()),
                FilesError::Folder { .. } | FilesError::File { .. } => Failure::Work(error.to_string()),
            }
        })?;
        let table = table::write(experiment, &Summary::of(experiment, Measure::Relmse));
        output::say(format_args!("{table}wrote {}", self.args.output.join("report.html").display()))
    }
}

/// [`Variant::error_products`] of some last pictures.
type Products<'a> = Box<dyn Fn(&[&FinalPicture], &Image) -> Result<Option<Vec<Vec<f64>>>, Failure> + 'a>;

/// Pictures to show.
struct Results {
    reference: Image,
    /// Name, caption and picture of each variant.
    shown: Vec<(String, String, Image)>,
}

/// Each two pictures against the mean of the seeds of neither; `None` if no seed is left.
fn products_of_replicates(
    pictures: &[&FinalPicture],
    finals: &[FinalPicture],
    own: &OwnError,
) -> Result<Option<Vec<Vec<f64>>>, Failure> {
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
