//! What the figures say, in sentences.

use super::curve::Reading;
use super::figures::{self, number, seconds};
use super::summary::{Pair, Summary};
use super::{Experiment, Measure};

/// The headline, and what there is to know beside it; plain text, one sentence each.
pub fn sentences(experiment: &Experiment, summary: &Summary) -> Vec<String> {
    let mut all = Vec::new();
    let name = |index: usize| experiment.variants[index].name.as_str();
    let mut pairs: Vec<&Pair> = summary.pairs.iter().filter(|pair| pair.equal_time.is_some()).collect();
    // Largest first: what the experiment is about.
    let ratio = |pair: &Pair| pair.equal_time.map_or(1.0, |reading| reading.estimate.value);
    pairs.sort_by(|a, b| ratio(b).total_cmp(&ratio(a)));
    // All of few; of many those with the best variant.
    let best = pairs.first().map(|pair| pair.better);
    let few = experiment.variants.len() <= 3;
    for pair in pairs.iter().filter(|pair| few || Some(pair.better) == best) {
        all.push(equal_time(pair, name(pair.better), name(pair.worse), summary.measure));
    }
    for external in &summary.externals {
        for (index, reading) in external.equal_time.iter().enumerate() {
            let Some(reading) = reading.filter(|_| few || Some(index) == best) else { continue };
            let (ratio, time) = (read(&reading), seconds(external.seconds));
            let (name, other, measure) = (name(index), &external.name, summary.measure.name());
            all.push(format!("After {time}, {name} has {ratio} times less {measure} than {other}."));
        }
    }
    all.extend(bias(experiment, summary));
    let invalid: u64 = summary.variants.iter().map(|variant| variant.invalid_samples).sum();
    if invalid > 0 {
        all.push(format!("{invalid} samples came out invalid and were dropped."));
    }
    let left_out: usize = summary.variants.iter().map(|variant| variant.points_left_out).sum();
    if left_out > 0 {
        all.push(format!(
            "{left_out} points are too close to the reference's own error to be used; it needs more samples."
        ));
    }
    all
}

fn equal_time(pair: &Pair, better: &str, worse: &str, measure: Measure) -> String {
    let Some(reading) = pair.equal_time else { return String::new() };
    let measure = measure.name();
    if !reading.estimate.excludes(1.0) && reading.estimate.interval.is_some() {
        let ratio = figures::estimate(&reading.estimate.recip());
        return format!(
            "At equal time {better} and {worse} differ in {measure} by no more than chance: {ratio}."
        );
    }
    let ratio = read(&reading);
    let time = pair.equal_error.map(|ratio| {
        let ratio = read(&ratio);
        format!(", and needs {ratio} times less time to an equal one")
    });
    let time = time.unwrap_or_default();
    format!("At equal time {better} has {ratio} times less {measure} than {worse}{time}.")
}

/// A figure in a sentence.
fn read(reading: &Reading) -> String {
    let mark = if reading.extrapolated { " (extrapolated)" } else { "" };
    format!("{}{mark}", figures::estimate(&reading.estimate))
}

/// Which variants have a bias that is more than chance.
fn bias(experiment: &Experiment, summary: &Summary) -> Vec<String> {
    let known = summary.variants.iter().filter_map(|variant| Some((variant, variant.squared_bias?)));
    let known: Vec<_> = known.filter(|(_, bias)| bias.interval.is_some()).collect();
    if known.is_empty() {
        return Vec::new();
    }
    let biased = known.iter().filter(|(_, bias)| bias.excludes(0.0) && bias.value > 0.0);
    let described: Vec<String> = biased
        .map(|(variant, bias)| {
            format!("{} by {} ({} of a pixel's value)", variant.name, number(bias.value), percent(bias.value))
        })
        .collect();
    if described.is_empty() {
        return vec!["No variant differs from the reference by more than its noise.".into()];
    }
    let subject = if experiment.reference.own_error.is_some() {
        "Not noise: after averaging over the seeds, relMSE stays above zero for"
    } else {
        "Not noise, but bias or the reference's own error: averaged over the seeds, relMSE stays above zero for"
    };
    vec![format!("{subject} {}.", described.join(", "))]
}

/// A squared relative error as a percentage of what it is relative to.
fn percent(squared: f64) -> String {
    format!("{} %", number(100.0 * squared.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::OwnError;
    use crate::converge::synthetic::{self, Law, Normal};

    #[test]
    fn the_largest_difference_is_the_headline() {
        let (experiment, ..) = synthetic::full();
        let sentences = sentences(&experiment, &Summary::of(&experiment, Measure::Relmse));
        let start = "At equal time wavefront/sobol has ";
        assert!(
            sentences[0].starts_with(start) && sentences[0].contains("than megakernel/independent"),
            "{sentences:?}"
        );
        assert!(sentences.iter().any(|s| s.contains("less relMSE than pbrt-v4")), "{sentences:?}");
        assert!(
            sentences.iter().any(|s| s.starts_with("No variant differs from the reference")),
            "{sentences:?}"
        );
    }

    #[test]
    fn chance_is_called_chance() {
        let law = Law { error_at_one_second: 0.1, slope: -1.0, spread: 0.3, slowness: 1.0 };
        let experiment = synthetic::experiment(&mut Normal::new(5), &[law, law], 4);
        let sentences = sentences(&experiment, &Summary::of(&experiment, Measure::Relmse));
        assert!(sentences[0].contains("by no more than chance"), "{sentences:?}");
    }

    #[test]
    fn a_bias_and_dropped_samples_are_told() {
        let (mut experiment, ..) = synthetic::full();
        let pairs = |i: usize, j: usize| if i == j { 1e-2 } else { 6e-4 + 1e-6 * (i + j) as f64 };
        experiment.variants[1].error_products =
            Some((0..5).map(|i| (0..5).map(|j| pairs(i, j)).collect()).collect());
        experiment.variants[1].runs[0].points[5].invalid_samples = 7;
        experiment.reference.own_error = Some(OwnError { mse: 1e-4, relmse: 5e-4, relmse_trimmed: 1e-4 });
        let text = sentences(&experiment, &Summary::of(&experiment, Measure::Relmse)).join(" ");
        assert!(
            text.contains("stays above zero for megakernel/sobol by 1.04e-4 (1.02 % of a pixel's value)"),
            "{text}"
        );
        assert!(text.contains("7 samples came out invalid and were dropped."), "{text}");
        assert!(text.ends_with("it needs more samples."), "{text}");
    }
}
