//! The figures that an experiment comes down to, with 95 % intervals from the spread between its seeds.
//!
//! | figure | how |
//! |---|---|
//! | error | geometric mean over the seeds, each read off its [`Curve`]; the reference's own error is subtracted |
//! | slope | of `ln error` against `ln seconds` by least squares, one for each seed; their mean, Student's t over seeds |
//! | efficiency | `1 / (error * seconds)` at the last checkpoint of each seed; geometric mean |
//! | time to an error | read off each seed's curve; geometric mean |
//! | ratios | for each seed that two variants share; geometric mean: what the seeds have in common cancels |
//! | bias | [`super::bias`] |

use serde::Serialize;

use super::bias::squared_bias;
use super::curve::{Curve, Reading};
use super::statistics::{CONFIDENCE, Estimate, geometric_mean, mean};
use super::{Experiment, External, Measure, Point, Variant, as_map};

/// All figures of an experiment in one measure of error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The measure that "error" stands for here.
    pub measure: Measure,
    /// Confidence of all intervals.
    pub confidence: f64,
    /// The time that every run of every variant reached, in seconds; `None` without runs.
    pub equal_seconds: Option<f64>,
    /// The error that times are given to; `None` without runs.
    pub target_error: Option<f64>,
    /// Each variant by itself, in the experiment's order.
    pub variants: Vec<VariantSummary>,
    /// Every two variants.
    pub pairs: Vec<Pair>,
    /// Pictures of other programs.
    pub externals: Vec<ExternalSummary>,
}

/// The figures of one variant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VariantSummary {
    /// Its name.
    pub name: String,
    /// Seeds.
    pub seeds: usize,
    /// Error after [`Summary::equal_seconds`].
    pub error: Option<Reading>,
    /// Slope of the error against time in log-log coordinates: -1 for plain Monte Carlo.
    pub slope: Option<Estimate>,
    /// Efficiency, in 1/s for the relative measures.
    pub efficiency: Option<Estimate>,
    /// Seconds to [`Summary::target_error`].
    pub seconds_to_target: Option<Reading>,
    /// Pixel samples per second at the last checkpoint.
    pub samples_per_second: Option<Estimate>,
    /// Squared bias in relMSE at the last checkpoint, less the reference's own error; in every summary the same.
    pub squared_bias: Option<Estimate>,
    /// Mean of the picture over mean of the reference for red, green, blue at the last checkpoint.
    pub mean_ratio: [Option<Estimate>; 3],
    /// relMSE that the render estimates over relMSE against the reference, at the last checkpoint: 1 if the estimate
    /// is right. In every summary the same.
    pub estimated_over_measured: Option<Estimate>,
    /// Seconds in each stage, summed over the workers, for each second of rendering; mean over the seeds.
    #[serde(serialize_with = "as_map")]
    pub stages: Vec<(String, f64)>,
    /// Samples dropped, over all seeds.
    pub invalid_samples: u64,
    /// Points of all seeds that were not used: too close to the reference's own error, or not a positive number.
    pub points_left_out: usize,
    /// The curve of all seeds: the checkpoints that every seed has and that are above the reference's own error.
    pub band: Vec<BandPoint>,
}

/// A checkpoint of all seeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BandPoint {
    /// Time; the geometric mean over the seeds.
    pub seconds: f64,
    /// Samples per pixel; the mean over the seeds.
    pub spp: f64,
    /// Error of the seeds at that time.
    pub error: Estimate,
}

/// How two variants compare.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// Index of the one with the smaller error at equal time.
    pub better: usize,
    /// Index of the other.
    pub worse: usize,
    /// The time at which errors are compared: what all of the runs reached, in seconds.
    pub seconds: f64,
    /// How many times less error the better one has after this time.
    pub equal_time: Option<Reading>,
    /// The error at which times are compared: what all of the runs reached.
    pub error: f64,
    /// How many times less time the better one needs to this error.
    pub equal_error: Option<Reading>,
}

/// How another program's picture compares.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExternalSummary {
    /// Its name.
    pub name: String,
    /// Its time, in seconds.
    pub seconds: f64,
    /// Its error less the reference's own; `None` if it is too close to that.
    pub error: Option<f64>,
    /// `1 / (error * seconds)`.
    pub efficiency: Option<f64>,
    /// For each variant: how many times less error it has after the picture's time.
    pub equal_time: Vec<Option<Reading>>,
    /// For each variant: how many times less time it needs to the picture's error.
    pub equal_error: Vec<Option<Reading>>,
}

impl Summary {
    /// Computes all figures in one measure.
    pub fn of(experiment: &Experiment, measure: Measure) -> Self {
        let curves: Vec<_> =
            experiment.variants.iter().map(|variant| curves(experiment, variant, measure)).collect();
        let all = || curves.iter().flatten().flatten();
        let equal_seconds = all().map(|curve| curve.last().0).reduce(f64::min);
        let given = experiment.target_relmse.filter(|_| measure == Measure::Relmse);
        let target_error = given.or_else(|| all().map(|curve| curve.last().1).reduce(f64::max).map(round_up));
        let variants = experiment.variants.iter().zip(&curves);
        let variants = variants.map(|(variant, curves)| {
            let summary = VariantSummary::of(experiment, variant, measure, curves);
            let error = equal_seconds.and_then(|seconds| read(curves, |curve| curve.error_at(seconds)));
            let seconds_to_target =
                target_error.and_then(|error| read(curves, |curve| curve.seconds_to(error)));
            VariantSummary { error, seconds_to_target, ..summary }
        });
        let variants = variants.collect();
        let indices = 0..curves.len();
        let indices = indices.flat_map(|a| (a + 1..curves.len()).map(move |b| (a, b)));
        let pairs = indices.filter_map(|(a, b)| pair(experiment, &curves, a, b)).collect();
        let own = measure.own(&experiment.reference);
        let externals =
            experiment.externals.iter().map(|external| beside(external, measure, own, &curves)).collect();
        Self { measure, confidence: CONFIDENCE, equal_seconds, target_error, variants, pairs, externals }
    }

    /// The pair of two variants, whichever of them is the better one.
    pub fn pair(&self, a: usize, b: usize) -> Option<&Pair> {
        self.pairs
            .iter()
            .find(|pair| (pair.better, pair.worse) == (a, b) || (pair.better, pair.worse) == (b, a))
    }
}

impl VariantSummary {
    fn of(experiment: &Experiment, variant: &Variant, measure: Measure, curves: &[Option<Curve>]) -> Self {
        let curved = || curves.iter().flatten();
        let slopes: Option<Vec<f64>> = curved().map(Curve::slope).collect();
        let efficiencies: Vec<f64> =
            curved().map(|curve| (curve.last().0 * curve.last().1).recip()).collect();
        let last: Vec<&Point> = variant.runs.iter().filter_map(|run| run.points.last()).collect();
        let of_last =
            |figure: &dyn Fn(&Point) -> f64| -> Vec<f64> { last.iter().map(|p| figure(p)).collect() };
        let points: usize = variant.runs.iter().map(|run| run.points.len()).sum();
        let own = Measure::Relmse.own(&experiment.reference);
        let honesty = |p: &Point| {
            p.estimated_relmse.unwrap_or(f64::NAN) / less_own(p.errors.relmse, own).unwrap_or(f64::NAN)
        };
        Self {
            name: variant.name.clone(),
            seeds: variant.runs.len(),
            error: None,
            slope: slopes.and_then(|slopes| mean(&slopes)),
            efficiency: geometric_mean(&efficiencies),
            seconds_to_target: None,
            samples_per_second: geometric_mean(&of_last(&|p| p.samples as f64 / p.seconds)),
            squared_bias: variant.error_products.as_ref().and_then(|products| squared_bias(products, own)),
            mean_ratio: [0, 1, 2].map(|channel| mean(&of_last(&|p| p.errors.mean_ratio[channel]))),
            estimated_over_measured: geometric_mean(&of_last(&honesty)),
            stages: stages(&last),
            points_left_out: points - curved().map(Curve::len).sum::<usize>(),
            invalid_samples: last.iter().map(|point| point.invalid_samples).sum(),
            band: band(variant, measure, measure.own(&experiment.reference), curves),
        }
    }
}

fn curves(experiment: &Experiment, variant: &Variant, measure: Measure) -> Vec<Option<Curve>> {
    variant.runs.iter().map(|run| Curve::of(run, measure, &experiment.reference)).collect()
}

/// The geometric mean over the curves of what is read off each; `None` if one of them cannot be read.
fn read<'a>(
    curves: impl IntoIterator<Item = &'a Option<Curve>>,
    off: impl Fn(&Curve) -> Option<(f64, bool)>,
) -> Option<Reading> {
    mean_reading(curves.into_iter().flatten().map(off))
}

fn mean_reading(readings: impl Iterator<Item = Option<(f64, bool)>>) -> Option<Reading> {
    let readings: Vec<(f64, bool)> = readings.collect::<Option<_>>()?;
    let values: Vec<f64> = readings.iter().map(|reading| reading.0).collect();
    let extrapolated = readings.iter().any(|reading| reading.1);
    geometric_mean(&values).map(|estimate| Reading { estimate, extrapolated })
}

/// The checkpoints that every run has; one is left out if it is below the reference's own error in any.
fn band(variant: &Variant, measure: Measure, own: f64, curves: &[Option<Curve>]) -> Vec<BandPoint> {
    let checkpoints = variant.runs.iter().map(|run| run.points.len()).min().unwrap_or(0);
    let checkpoint = |index: usize| {
        let points = variant.runs.iter().map(|run| &run.points[index]);
        let times: Vec<f64> = points.clone().map(|point| point.seconds).collect();
        let seconds = geometric_mean(&times)?.value;
        let spp = points.clone().map(|point| point.spp).sum::<f64>() / times.len() as f64;
        let errors = points.zip(curves).map(|(point, curve)| {
            let error = less_own(measure.of(&point.errors), own)?;
            // A curve of a single point has no slope to go elsewhere with.
            Some(curve.as_ref()?.error_at(seconds).map_or(error, |reading| reading.0))
        });
        let error = geometric_mean(&errors.collect::<Option<Vec<f64>>>()?)?;
        Some(BandPoint { seconds, spp, error })
    };
    (0..checkpoints).filter_map(checkpoint).collect()
}

/// A measured error less the reference's own, if that is a small part of it.
fn less_own(measured: f64, own: f64) -> Option<f64> {
    (measured >= super::curve::REFERENCE_LIMIT * own && measured > 0.0).then_some(measured - own)
}

/// Seconds in each stage for each second of rendering, mean over the points; stages in order of appearance.
fn stages(points: &[&Point]) -> Vec<(String, f64)> {
    let mut stages: Vec<(String, f64)> = Vec::new();
    for point in points {
        for (name, seconds) in &point.stage_seconds {
            let share = seconds / point.seconds / points.len() as f64;
            match stages.iter_mut().find(|stage| stage.0 == *name) {
                Some(stage) => stage.1 += share,
                None => stages.push((name.clone(), share)),
            }
        }
    }
    stages
}

/// Compares two variants; `None` if they have no runs to pair.
fn pair(experiment: &Experiment, curves: &[Vec<Option<Curve>>], a: usize, b: usize) -> Option<Pair> {
    let runs = paired(&experiment.variants[a], &experiment.variants[b]);
    let curves: Option<Vec<(&Curve, &Curve)>> =
        runs.into_iter().map(|(i, j)| Some((curves[a][i].as_ref()?, curves[b][j].as_ref()?))).collect();
    let curves = curves.filter(|curves| !curves.is_empty())?;
    let ends = || curves.iter().flat_map(|(a, b)| [a.last(), b.last()]);
    let (seconds, error) = ends().reduce(|x, y| (x.0.min(y.0), x.1.max(y.1)))?;
    let ratios = |read: &dyn Fn(&Curve) -> Option<(f64, bool)>| {
        let ratio = |(a, b): &(&Curve, &Curve)| {
            let (a, b) = (read(a)?, read(b)?);
            Some((b.0 / a.0, a.1 || b.1))
        };
        mean_reading(curves.iter().map(ratio))
    };
    let equal_time = ratios(&|curve| curve.error_at(seconds));
    let equal_error = ratios(&|curve| curve.seconds_to(error));
    let a_is_better = equal_time.is_none_or(|ratio| ratio.estimate.value >= 1.0);
    if a_is_better {
        return Some(Pair { better: a, worse: b, seconds, equal_time, error, equal_error });
    }
    let turned = |ratio: Option<Reading>| ratio.map(|r| Reading { estimate: r.estimate.recip(), ..r });
    let (equal_time, equal_error) = (turned(equal_time), turned(equal_error));
    Some(Pair { better: b, worse: a, seconds, equal_time, error, equal_error })
}

/// Indices of the runs that belong together: those with the same seed, or, if there are none, those at the same place.
fn paired(a: &Variant, b: &Variant) -> Vec<(usize, usize)> {
    let seed = |i: usize| b.runs.iter().position(|run| run.seed == a.runs[i].seed).map(|j| (i, j));
    let by_seed: Vec<(usize, usize)> = (0..a.runs.len()).filter_map(seed).collect();
    if by_seed.is_empty() { (0..a.runs.len().min(b.runs.len())).map(|i| (i, i)).collect() } else { by_seed }
}

fn beside(external: &External, measure: Measure, own: f64, curves: &[Vec<Option<Curve>>]) -> ExternalSummary {
    let seconds = external.seconds;
    let error = less_own(measure.of(&external.errors), own);
    let inverse = |r: Reading, factor: f64| Reading { estimate: r.estimate.recip().map(|x| factor * x), ..r };
    let equal_time =
        |curves: &Vec<Option<Curve>>| Some(inverse(read(curves, |curve| curve.error_at(seconds))?, error?));
    let equal_error = |curves: &Vec<Option<Curve>>| {
        let error = error?;
        Some(inverse(read(curves, |curve| curve.seconds_to(error))?, seconds))
    };
    ExternalSummary {
        name: external.name.clone(),
        seconds,
        error,
        efficiency: error.map(|error| (error * seconds).recip()),
        equal_time: curves.iter().map(equal_time).collect(),
        equal_error: curves.iter().map(equal_error).collect(),
    }
}

/// The next larger 1, 2 or 5 times a power of ten.
fn round_up(value: f64) -> f64 {
    let power = value.log10().floor() as i32;
    let candidates = (power - 1..=power + 1).flat_map(|power| [1, 2, 5].map(|digit| (digit, power)));
    // Read from text, so that 0.002 is the number nearest to 0.002.
    let parsed = candidates.filter_map(|(digit, power)| format!("{digit}e{power}").parse().ok());
    parsed.into_iter().find(|candidate| *candidate >= value).unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::synthetic::{Law, Normal, covers_as_promised, experiment};
    use crate::converge::{Errors, OwnError};

    /// Two laws, the second three times as slow and with a flatter slope.
    fn laws() -> [Law; 2] {
        let fast = Law { error_at_one_second: 0.02, slope: -1.0, spread: 0.1, slowness: 1.0 };
        [fast, Law { error_at_one_second: 0.06, slope: -0.9, slowness: 3.0, ..fast }]
    }

    fn relmse(experiment: &Experiment) -> Summary {
        Summary::of(experiment, Measure::Relmse)
    }

    #[test]
    fn without_noise_the_figures_are_the_laws() {
        let laws = laws().map(|law| Law { spread: 0.0, ..law });
        let summary = relmse(&experiment(&mut Normal::new(1), &laws, 3));
        let close =
            |value: f64, expected: f64| assert!((value / expected - 1.0).abs() < 1e-6, "{value} {expected}");
        let [fast, slow] = &summary.variants[..] else { panic!() };
        let seconds = summary.equal_seconds.unwrap();
        close(fast.slope.unwrap().value, -1.0);
        close(slow.slope.unwrap().value, -0.9);
        close(fast.error.unwrap().estimate.value, 0.02 / seconds);
        close(fast.efficiency.unwrap().value, 50.0);
        let target = summary.target_error.unwrap();
        close(fast.seconds_to_target.unwrap().estimate.value, 0.02 / target);
        close(slow.seconds_to_target.unwrap().estimate.value, (target / 0.06).powf(-1.0 / 0.9));
        let pair = &summary.pairs[0];
        assert_eq!((pair.better, pair.worse), (0, 1));
        close(pair.equal_time.unwrap().estimate.value, 3.0 * pair.seconds.powf(0.1));
        let times = (pair.error / 0.06).powf(-1.0 / 0.9) / (0.02 / pair.error);
        close(pair.equal_error.unwrap().estimate.value, times);
        assert!(!pair.equal_time.unwrap().extrapolated && !pair.equal_error.unwrap().extrapolated);
        assert_eq!(summary.pair(1, 0), Some(pair));
        assert_eq!((fast.band.len(), fast.points_left_out), (6, 0));
    }

    #[test]
    fn the_better_one_comes_first_whatever_the_order() {
        let mut laws = laws();
        laws.reverse();
        let summary = relmse(&experiment(&mut Normal::new(2), &laws, 5));
        let pair = &summary.pairs[0];
        assert_eq!((pair.better, pair.worse), (1, 0));
        assert!(
            pair.equal_time.unwrap().estimate.excludes(1.0) && pair.equal_time.unwrap().estimate.value > 2.0
        );
    }

    #[test]
    fn the_references_own_error_is_subtracted_everywhere() {
        let laws = laws().map(|law| Law { spread: 0.0, ..law });
        let plain = experiment(&mut Normal::new(3), &laws, 2);
        let mut shifted = plain.clone();
        let own = 1e-4;
        shifted.reference.own_error = Some(OwnError { mse: own, relmse: own, relmse_trimmed: own });
        let points =
            shifted.variants.iter_mut().flat_map(|v| v.runs.iter_mut()).flat_map(|run| &mut run.points);
        points.for_each(|point| point.errors.relmse += own);
        shifted.externals[0].errors.relmse += own;
        let (a, b) = (relmse(&plain), relmse(&shifted));
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        for (a, b) in a.variants.iter().zip(&b.variants) {
            close(a.slope.unwrap().value, b.slope.unwrap().value);
            close(a.efficiency.unwrap().value, b.efficiency.unwrap().value);
            close(a.estimated_over_measured.unwrap().value, b.estimated_over_measured.unwrap().value);
        }
        close(a.externals[0].efficiency.unwrap(), b.externals[0].efficiency.unwrap());
        close(
            a.externals[0].equal_time[0].unwrap().estimate.value,
            b.externals[0].equal_time[0].unwrap().estimate.value,
        );
    }

    #[test]
    fn what_is_too_close_to_the_reference_is_left_out() {
        let laws = laws().map(|law| Law { spread: 0.0, ..law });
        let mut experiment = experiment(&mut Normal::new(3), &laws, 2);
        // The first variant's last point of each seed is at 0.02 / 32.
        experiment.reference.own_error = Some(OwnError { mse: 1e-3, relmse: 6e-4, relmse_trimmed: 1e-3 });
        let summary = relmse(&experiment);
        assert_eq!((summary.variants[0].points_left_out, summary.variants[0].band.len()), (2, 5));
        assert_eq!(summary.variants[1].points_left_out, 0);
    }

    #[test]
    fn one_seed_has_figures_without_intervals_and_none_has_none() {
        let summary = relmse(&experiment(&mut Normal::new(4), &laws(), 1));
        let fast = &summary.variants[0];
        assert!(fast.slope.unwrap().interval.is_none() && summary.pairs[0].equal_time.is_some());
        let summary = relmse(&experiment(&mut Normal::new(4), &laws(), 0));
        assert_eq!((summary.equal_seconds, summary.target_error, summary.pairs.len()), (None, None, 0));
        assert!(summary.variants[0].slope.is_none() && summary.variants[0].band.is_empty());
    }

    #[test]
    fn a_given_target_may_need_extrapolation() {
        let mut experiment = experiment(&mut Normal::new(5), &laws(), 3);
        experiment.target_relmse = Some(1e-9);
        let summary = relmse(&experiment);
        assert_eq!(summary.target_error, Some(1e-9));
        assert!(summary.variants[0].seconds_to_target.unwrap().extrapolated);
        assert_ne!(Summary::of(&experiment, Measure::Mse).target_error, Some(1e-9));
    }

    #[test]
    fn externals_are_compared_at_their_time_and_error() {
        let laws = laws().map(|law| Law { spread: 0.0, ..law });
        let mut experiment = experiment(&mut Normal::new(6), &laws, 2);
        let errors = Errors { mse: 0.1, relmse: 0.1, relmse_trimmed: 0.1, mean_ratio: [1.0; 3] };
        experiment.externals = vec![External { name: "x".into(), file: "x".into(), seconds: 1.0, errors }];
        let summary = relmse(&experiment);
        let external = &summary.externals[0];
        assert!((external.efficiency.unwrap() - 10.0).abs() < 1e-9);
        assert!((external.equal_time[0].unwrap().estimate.value - 5.0).abs() < 1e-6);
        assert!((external.equal_error[0].unwrap().estimate.value - 5.0).abs() < 1e-6);
    }

    #[test]
    fn seeds_are_paired_by_number_or_else_by_place() {
        let experiment = experiment(&mut Normal::new(7), &laws(), 3);
        let [a, mut b] = [experiment.variants[0].clone(), experiment.variants[1].clone()];
        b.runs.reverse();
        assert_eq!(paired(&a, &b), [(0, 2), (1, 1), (2, 0)]);
        b.runs.iter_mut().for_each(|run| run.seed += 100);
        assert_eq!(paired(&a, &b), [(0, 0), (1, 1), (2, 2)]);
    }

    #[test]
    fn targets_are_round() {
        for (value, expected) in [(0.0011, 0.002), (0.002, 0.002), (0.3, 0.5), (6.0, 10.0), (1e-7, 1e-7)] {
            assert_eq!(round_up(value), expected);
        }
    }

    #[test]
    fn intervals_of_all_figures_cover_the_truth() {
        let laws = laws();
        let mut normal = Normal::new(8);
        let mut draw = || relmse(&experiment(&mut normal, &laws, 5));
        covers_as_promised(-0.9, || draw().variants[1].slope.unwrap());
        covers_as_promised(50.0, || draw().variants[0].efficiency.unwrap());
        // Where the time and the error of a comparison come from the draw itself, the truth depends on them.
        covers_as_promised(1.0, || {
            let summary = draw();
            let truth = (summary.target_error.unwrap() / 0.06).powf(-1.0 / 0.9);
            summary.variants[1].seconds_to_target.unwrap().estimate.map(|seconds| seconds / truth)
        });
        covers_as_promised(1.0, || {
            let pair = draw().pairs[0].clone();
            let truth = 3.0 * pair.seconds.powf(0.1);
            pair.equal_time.unwrap().estimate.map(|ratio| ratio / truth)
        });
        covers_as_promised(1.0, || {
            let pair = draw().pairs[0].clone();
            let truth = (pair.error / 0.06).powf(-1.0 / 0.9) / (0.02 / pair.error);
            pair.equal_error.unwrap().estimate.map(|ratio| ratio / truth)
        });
    }
}
