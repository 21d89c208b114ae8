//! A battery of stiff and extreme cases with known answers: whether the renderer is right where single precision breaks.
//!
//! A [`Case`] is a small scene, or a function of the kernels, whose value is known in closed form. Its name tells its
//! family, its comment the form. [`run`] measures it and gives a [`Row`]: expected, found, the relative error, how well it
//! is known, and a [`Verdict`].
//!
//! | file | cases |
//! |---|---|
//! | `scale` | scenes scaled, moved and turned |
//! | `lamps` | spheres, disks, quads from near and far, in their plane, behind screens |
//! | `radiance` | faint and bright light, many bounces, roulette |
//! | `diffuse` | Lambert and Oren-Nayar at grazing angles |
//! | `conductors` | Fresnel, GGX |
//! | `glass` | dielectrics: faint and strong, thin walls, total reflection |
//! | `triangles` | long, slender, degenerate, shared edges |
//! | `spheres` | tiny, huge, stretched |
//! | `cameras` | fields of view, lenses, sizes of images |
//! | `samplers` | the ends of the unit interval, the last of 2^32 samples |
//! | `bits` | engines, traversals, threads: the same bits |
//!
//! `exact` holds the closed forms, in double precision, and `text` writes scenes.
//!
//! **How a case is judged.** A picture is rendered with several seeds, until three standard errors of the mean are within
//! the tolerance (or 512 seeds have not sufficed: then the case is *noisy*, which fails: an estimator that does not
//! converge is broken, too). It passes if the error is at most the tolerance and three standard errors. Invalid samples
//! fail in any case.
//!
//! **What the input has lost.** Cases that move a scene far away name the coordinates and the length that counts. If
//! rounding those coordinates to `f32` moves them by more than the tolerance of that length, no renderer that takes its
//! scene in single precision can be right; a wrong value is called *input lost* then, and does not fail. (A renderer that
//! keeps the numbers of the file can still be right, and passes.)
//!
//! ```
//! use wavepath::stability::{self, Subject, Verdict};
//!
//! let case = stability::cases().into_iter().find(|case| case.name == "radiance/furnace-depth-3").unwrap();
//! assert_eq!(stability::run(&case, &Subject::default()).verdict, Verdict::Pass);
//! ```

pub mod bits;
pub mod cameras;
pub mod conductors;
pub mod diffuse;
pub mod exact;
pub mod formulas;
pub mod glass;
pub mod lamps;
pub mod page;
pub mod radiance;
pub mod samplers;
pub mod scale;
pub mod spheres;
pub mod table;
pub mod text;
pub mod triangles;

pub use formulas::Formulas;

use crate::engine::EngineKind;
use crate::render::Render;
use crate::scene::{Scene, SceneOptions, SphericalLights};
use rayon::prelude::*;
use serde::Serialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Instant;
use wavepath_kernels::isa::Level;

/// What is put to the test.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// Engine that renders.
    pub engine: EngineKind,
    /// Instruction set.
    pub level: Level,
    /// Formulas of the cases that look at one formula: the kernels' own, or others to see whether the battery notices.
    pub formulas: Formulas,
    /// Rays that are aimed at edges and vertices, for each mesh and traversal.
    pub leak_rays: usize,
}

impl Default for Subject {
    fn default() -> Self {
        Subject {
            engine: EngineKind::Wavefront,
            level: Level::detect(),
            formulas: Formulas::default(),
            leak_rays: 200_000,
        }
    }
}

/// What of a picture is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// Mean of all pixels and channels.
    Mean,
    /// Mean of one channel.
    Channel(usize),
    /// The largest value of a pixel.
    Largest,
}

/// How far a value may be off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Share of the expected value.
    pub relative: f64,
    /// And so much more: for values of 0, and shares of 1.
    pub absolute: f64,
    /// Why so much.
    pub why: &'static str,
}

impl Tolerance {
    /// A share of the expected value.
    pub const fn relative(relative: f64, why: &'static str) -> Self {
        Tolerance { relative, absolute: 0.0, why }
    }
    /// No error at all.
    pub const EXACT: Tolerance = Tolerance { relative: 0.0, absolute: 0.0, why: "exact" };
    /// With an absolute part.
    pub const fn and(self, absolute: f64) -> Self {
        Tolerance { absolute, ..self }
    }
    /// The largest error of a value.
    pub fn of(&self, expected: f64) -> f64 {
        self.relative * expected.abs() + self.absolute
    }
}

/// The numbers of a scene that single precision may not hold.
#[derive(Clone, Debug)]
pub struct Input {
    /// World coordinates of what counts.
    pub coordinates: Vec<f64>,
    /// The length in the scene that the value depends on: an error of a share of it is one of about that share, or twice
    /// that, in the value.
    pub length: f64,
}

impl Input {
    /// How large a share of the value rounding to `f32` may change.
    pub fn loss(&self) -> f64 {
        let rounding = self.coordinates.iter().map(|&x| (x - f64::from(x as f32)).abs());
        2.0 * rounding.fold(0.0, f64::max) / self.length
    }
}

/// A value found otherwise than by a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Computed {
    /// The value.
    pub value: f64,
    /// Results on the way that were no numbers.
    pub invalid: u64,
}

impl From<f64> for Computed {
    fn from(value: f64) -> Self {
        Computed { value, invalid: 0 }
    }
}

/// How a case is measured.
pub enum Work {
    /// A picture of a scene in pbrt's format.
    Picture {
        /// The scene.
        scene: String,
        /// Samples a pixel for each seed.
        spp: u32,
        /// What of it counts.
        measure: Measure,
        /// How spherical lamps are sampled.
        spherical: SphericalLights,
    },
    /// A function.
    Compute(Box<dyn Fn(&Subject) -> Computed + Send + Sync>),
}

/// A question with a known answer.
pub struct Case {
    /// `family/name`.
    pub name: String,
    /// What is measured.
    pub what: String,
    /// The right value.
    pub expected: f64,
    /// An upper bound, not a value: less is right, too.
    pub at_most: bool,
    /// How far it may be off.
    pub tolerance: Tolerance,
    /// What rounding of the input can do, where it can do something.
    pub input: Option<Input>,
    /// How it is measured.
    pub work: Work,
}

impl Case {
    /// The mean of a picture, at 64 samples a pixel.
    pub fn picture(
        name: impl Into<String>,
        what: impl Into<String>,
        scene: String,
        expected: f64,
        tolerance: Tolerance,
    ) -> Self {
        let spherical = SphericalLights::Cone;
        let work = Work::Picture { scene, spp: 64, measure: Measure::Mean, spherical };
        Case { name: name.into(), what: what.into(), expected, at_most: false, tolerance, input: None, work }
    }

    /// A function's value.
    pub fn compute<C: Into<Computed>>(
        name: impl Into<String>,
        what: impl Into<String>,
        expected: f64,
        tolerance: Tolerance,
        function: impl Fn(&Subject) -> C + Send + Sync + 'static,
    ) -> Self {
        let work = Work::Compute(Box::new(move |subject| function(subject).into()));
        Case { name: name.into(), what: what.into(), expected, at_most: false, tolerance, input: None, work }
    }

    /// Another number of samples a pixel.
    pub fn spp(mut self, samples: u32) -> Self {
        if let Work::Picture { spp, .. } = &mut self.work {
            *spp = samples;
        }
        self
    }
    /// Another measure of the picture.
    pub fn measure(mut self, of: Measure) -> Self {
        if let Work::Picture { measure, .. } = &mut self.work {
            *measure = of;
        }
        self
    }
    /// Spherical lamps sampled by area.
    pub fn by_area(mut self) -> Self {
        if let Work::Picture { spherical, .. } = &mut self.work {
            *spherical = SphericalLights::Area;
        }
        self
    }
    /// What rounding the input can do.
    pub fn input(mut self, coordinates: impl Into<Vec<f64>>, length: f64) -> Self {
        self.input = Some(Input { coordinates: coordinates.into(), length });
        self
    }
    /// The expected value is an upper bound.
    pub fn at_most(mut self) -> Self {
        self.at_most = true;
        self
    }
    /// How far a value is off, to the wrong side.
    fn error_of(&self, found: f64) -> f64 {
        let above = found - self.expected;
        if self.at_most { above.max(0.0) } else { above.abs() }
    }
    /// Is the value known as well as it has to be?
    fn is_sharp(&self, measured: &Measured) -> bool {
        let spread = 3.0 * measured.standard_error();
        let allowed = self.tolerance.of(self.expected);
        spread <= allowed || self.at_most && measured.mean() + spread <= self.expected + allowed
    }
    /// What the name begins with.
    pub fn family(&self) -> &str {
        self.name.split('/').next().unwrap_or_default()
    }
}

/// What comes of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Right.
    Pass,
    /// Wrong.
    Fail,
    /// Not known well enough after the most seeds: counts as wrong.
    Noisy,
    /// Wrong, but the input as `f32` does not hold the geometry any more.
    InputLost,
}

impl Verdict {
    /// Does the battery fail by it?
    pub fn is_failure(self) -> bool {
        matches!(self, Verdict::Fail | Verdict::Noisy)
    }
    /// For tables.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Pass => "pass",
            Verdict::Fail => "FAIL",
            Verdict::Noisy => "NOISY",
            Verdict::InputLost => "input lost",
        }
    }
}

/// A measured case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the case.
    pub name: String,
    /// What is measured.
    pub what: String,
    /// The right value, or its bound.
    pub expected: f64,
    /// Is `expected` an upper bound?
    pub at_most: bool,
    /// What was found.
    pub found: f64,
    /// Standard error of `found` from the seeds; 0 where nothing is random.
    pub standard_error: f64,
    /// Error relative to the expected value; absolute where that is 0.
    pub error: f64,
    /// The largest error allowed, in the same measure.
    pub tolerance: f64,
    /// Why that is allowed.
    pub why: &'static str,
    /// What rounding the input to `f32` can change, relative; 0 where the case does not depend on it.
    pub input_loss: f64,
    /// Samples that were NaN, infinite or negative.
    pub invalid_samples: u64,
    /// Seeds.
    pub seeds: usize,
    /// The verdict.
    pub verdict: Verdict,
    /// Why there is no value, if there is none.
    pub failure: Option<String>,
    /// Time that it took.
    pub seconds: f64,
}

/// Seeds of every picture.
const LEAST_SEEDS: usize = 4;
/// Seeds after which a picture is called noisy.
const MOST_SEEDS: usize = 512;

/// All cases, families in the order of the module's table.
pub fn cases() -> Vec<Case> {
    let families: [fn() -> Vec<Case>; 11] = [
        scale::cases,
        lamps::cases,
        radiance::cases,
        diffuse::cases,
        conductors::cases,
        glass::cases,
        triangles::cases,
        spheres::cases,
        cameras::cases,
        samplers::cases,
        bits::cases,
    ];
    families.into_iter().flat_map(|family| family()).collect()
}

/// Measures all of `cases`, on all threads; `done` is called with each row as it is known.
pub fn run_all(cases: &[Case], subject: &Subject, done: impl Fn(&Row) + Sync) -> Vec<Row> {
    let measure = |case: &Case| {
        let row = run(case, subject);
        done(&row);
        row
    };
    cases.par_iter().with_max_len(1).map(measure).collect()
}

/// Measures a case.
pub fn run(case: &Case, subject: &Subject) -> Row {
    let started = Instant::now();
    // A panic is the worst answer to a hard scene, but still one about that scene alone.
    let measured = catch_unwind(AssertUnwindSafe(|| measure(case, subject)))
        .unwrap_or_else(|_| Err("it panicked".to_string()));
    let mut row = judge(case, measured);
    row.seconds = started.elapsed().as_secs_f64();
    row
}

/// What was measured.
struct Measured {
    values: Vec<f64>,
    invalid: u64,
}

impl Measured {
    fn mean(&self) -> f64 {
        self.values.iter().sum::<f64>() / self.values.len() as f64
    }
    /// Standard error of the mean.
    fn standard_error(&self) -> f64 {
        let n = self.values.len() as f64;
        if n < 2.0 {
            return 0.0;
        }
        let mean = self.mean();
        let squares: f64 = self.values.iter().map(|x| (x - mean).powi(2)).sum();
        // Values that are equal in single precision are equal.
        let error = (squares / (n - 1.0) / n).sqrt();
        if error < 1e-9 * mean.abs() { 0.0 } else { error }
    }
}

fn measure(case: &Case, subject: &Subject) -> Result<Measured, String> {
    let (scene, spp, of, spherical) = match &case.work {
        Work::Compute(function) => {
            let Computed { value, invalid } = function(subject);
            return Ok(Measured { values: vec![value], invalid });
        }
        Work::Picture { scene, spp, measure, spherical } => (scene, *spp, *measure, *spherical),
    };
    let loaded = crate::pbrt::load_str(scene, &case.name, Path::new("")).map_err(|e| e.to_string())?;
    let options = SceneOptions { spherical_lights: spherical, ..SceneOptions::default() };
    let scene = Scene::new_with(case.name.clone(), loaded.scene, &options).map_err(|e| e.to_string())?;
    let mut measured = Measured { values: Vec::new(), invalid: 0 };
    loop {
        for _ in 0..LEAST_SEEDS {
            let seed = measured.values.len() as u64 + 1;
            let render = Render::new(&scene)
                .spp(spp)
                .seed(seed)
                .threads(1)
                .engine(subject.engine)
                .level(subject.level);
            let picture = render.run().map_err(|e| e.to_string())?;
            measured.invalid += picture.report().invalid_samples;
            measured.values.push(value_of(&picture.image().pixels, of));
        }
        if is_settled(case, &measured) {
            return Ok(measured);
        }
    }
}

/// Would more seeds change nothing?
fn is_settled(case: &Case, measured: &Measured) -> bool {
    let (n, spread) = (measured.values.len(), measured.standard_error());
    let error = case.error_of(measured.mean());
    let allowed = case.tolerance.of(case.expected);
    let few = n < 2 * LEAST_SEEDS;
    // Nothing is random; or nothing is allowed, and there is something.
    if spread == 0.0 || allowed == 0.0 && error > 0.0 {
        return true;
    }
    // No number, or far from right; or as well known as it has to be.
    let hopeless = error.is_nan() || error - 8.0 * spread > allowed;
    !few && (hopeless || case.is_sharp(measured) || n >= MOST_SEEDS)
}

fn value_of(pixels: &[[f32; 3]], measure: Measure) -> f64 {
    let n = pixels.len() as f64;
    match measure {
        Measure::Mean => pixels.iter().flatten().map(|&x| f64::from(x)).sum::<f64>() / (3.0 * n),
        Measure::Channel(c) => pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / n,
        Measure::Largest => pixels.iter().flatten().fold(0.0, |a: f64, &b| a.max(f64::from(b))),
    }
}

fn judge(case: &Case, measured: Result<Measured, String>) -> Row {
    let input_loss = case.input.as_ref().map_or(0.0, Input::loss);
    let unit = if case.expected == 0.0 { 1.0 } else { case.expected.abs() };
    let allowed = case.tolerance.of(case.expected);
    let lost = input_loss > allowed / unit || input_loss.is_nan();
    let mut row = Row {
        name: case.name.clone(),
        what: case.what.clone(),
        expected: case.expected,
        at_most: case.at_most,
        found: f64::NAN,
        standard_error: 0.0,
        error: f64::NAN,
        tolerance: allowed / unit,
        why: case.tolerance.why,
        input_loss,
        invalid_samples: 0,
        seeds: 0,
        verdict: if lost { Verdict::InputLost } else { Verdict::Fail },
        failure: None,
        seconds: 0.0,
    };
    let measured = match measured {
        Ok(measured) => measured,
        Err(failure) => {
            row.failure = Some(failure);
            return row;
        }
    };
    row.found = measured.mean();
    row.standard_error = measured.standard_error();
    row.seeds = measured.values.len();
    row.invalid_samples = measured.invalid;
    let error = case.error_of(row.found);
    row.error = error / unit;
    let noise = if allowed == 0.0 { 0.0 } else { 3.0 * row.standard_error };
    let right = error <= allowed + noise;
    row.verdict = if measured.invalid > 0 {
        Verdict::Fail
    } else if !right {
        if lost { Verdict::InputLost } else { Verdict::Fail }
    } else if !case.is_sharp(&measured) {
        Verdict::Noisy
    } else {
        Verdict::Pass
    };
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(expected: f64, tolerance: f64) -> Case {
        Case::compute("a/b", "", expected, Tolerance::relative(tolerance, ""), |_| 0.0)
    }
    fn measured(values: &[f64], invalid: u64) -> Result<Measured, String> {
        Ok(Measured { values: values.to_vec(), invalid })
    }

    #[test]
    fn verdicts() {
        let verdict = |case: &Case, m| judge(case, m).verdict;
        assert_eq!(verdict(&case(1.0, 0.01), measured(&[1.005], 0)), Verdict::Pass);
        assert_eq!(verdict(&case(1.0, 0.01), measured(&[1.02], 0)), Verdict::Fail);
        assert_eq!(verdict(&case(1.0, 0.01), measured(&[f64::NAN], 0)), Verdict::Fail);
        assert_eq!(verdict(&case(1.0, 0.01), measured(&[1.0], 1)), Verdict::Fail, "an invalid sample");
        assert_eq!(verdict(&case(1.0, 0.01), measured(&[0.0, 2.0], 0)), Verdict::Noisy);
        assert_eq!(verdict(&case(1.0, 0.01), Err("no".into())), Verdict::Fail);
        assert_eq!(verdict(&case(1.0, 0.01).at_most(), measured(&[0.3], 0)), Verdict::Pass);
        assert_eq!(verdict(&case(1.0, 0.01).at_most(), measured(&[1.3], 0)), Verdict::Fail);
        // 1e7 + 0.3 is 1e7 in single precision.
        let far = case(1.0, 0.01).input([1e7 + 0.3], 1.0);
        assert_eq!(verdict(&far, measured(&[1.5], 0)), Verdict::InputLost);
        assert_eq!(verdict(&far, measured(&[1.0], 0)), Verdict::Pass, "better than its input");
        let held = case(1.0, 0.01).input([1e7], 1.0);
        assert_eq!(verdict(&held, measured(&[1.5], 0)), Verdict::Fail, "1e7 is held exactly");
    }

    #[test]
    fn names_are_unique_and_say_their_family() {
        let cases = cases();
        let mut names: Vec<&str> = cases.iter().map(|case| case.name.as_str()).collect();
        names.sort_unstable();
        names.windows(2).for_each(|pair| assert_ne!(pair[0], pair[1]));
        assert!(cases.iter().all(|case| case.name.contains('/') && !case.family().is_empty()));
        assert!(cases.len() > 150, "{}", cases.len());
    }
}
