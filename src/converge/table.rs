//! The figures of an experiment as a table for the terminal.

use super::curve::Reading;
use super::figures::{self, known, number, seconds};
use super::sentences::sentences;
use super::statistics::Estimate;
use super::summary::{Summary, VariantSummary};
use super::{Experiment, ReferenceKind};

/// Column heads and rows of the figures of each variant and of the pictures of other programs.
pub struct Figures {
    /// Heads, the first one for the names.
    pub heads: Vec<String>,
    /// As many cells in each row as there are heads.
    pub rows: Vec<Vec<String>>,
}

impl Figures {
    /// The main table.
    pub fn of(summary: &Summary) -> Self {
        let measure = summary.measure.name();
        let at = summary.equal_seconds.map_or_else(String::new, |time| format!(" at {}", seconds(time)));
        let target =
            summary.target_error.map_or_else(String::new, |error| format!(" {}", round_number(error)));
        let heads = [
            "variant",
            &format!("{measure}{at}"),
            "slope",
            "efficiency, 1/s",
            &format!("seconds to {measure}{target}"),
        ];
        let row = |variant: &VariantSummary| {
            vec![
                variant.name.clone(),
                known(variant.error.as_ref(), figures::reading),
                known(variant.slope.as_ref(), |slope| figures::slope(slope, "+-", "-")),
                known(variant.efficiency.as_ref(), figures::estimate),
                known(variant.seconds_to_target.as_ref(), figures::reading),
            ]
        };
        let mut rows: Vec<Vec<String>> = summary.variants.iter().map(row).collect();
        for external in &summary.externals {
            let error = known(external.error.as_ref(), |error| number(*error));
            let efficiency = known(external.efficiency.as_ref(), |efficiency| number(*efficiency));
            let unknown = || figures::UNKNOWN.to_string();
            let cost = format!("{error} at {}", seconds(external.seconds));
            rows.push(vec![external.name.clone(), cost, unknown(), efficiency, unknown()]);
        }
        Self { heads: heads.map(String::from).into(), rows }
    }

    /// The ratios of every two variants.
    pub fn ratios(experiment: &Experiment, summary: &Summary) -> Self {
        let heads = ["better : worse", "less error at equal time", "less time to equal error"];
        let name = |index: usize| &experiment.variants[index].name;
        let pairs = summary.pairs.iter().map(|pair| {
            vec![
                format!("{} : {}", name(pair.better), name(pair.worse)),
                known(pair.equal_time.as_ref(), times),
                known(pair.equal_error.as_ref(), times),
            ]
        });
        let mut rows: Vec<Vec<String>> = pairs.collect();
        for external in &summary.externals {
            for (index, variant) in experiment.variants.iter().enumerate() {
                let (time, error) = (external.equal_time[index], external.equal_error[index]);
                let worse = time.is_some_and(|reading| reading.estimate.value < 1.0);
                let turned = |r: Reading| Reading { estimate: r.estimate.recip(), ..r };
                let (first, second, time, error) = if worse {
                    (&external.name, &variant.name, time.map(turned), error.map(turned))
                } else {
                    (&variant.name, &external.name, time, error)
                };
                let ratios = [known(time.as_ref(), times), known(error.as_ref(), times)];
                rows.push([vec![format!("{first} : {second}")], ratios.into()].concat());
            }
        }
        Self { heads: heads.map(String::from).into(), rows }
    }

    /// What shows whether the figures can be trusted.
    pub fn checks(summary: &Summary) -> Self {
        let heads = [
            "variant",
            "seeds",
            "squared bias, relMSE",
            "mean ratio R, G, B",
            "estimated : measured",
            "invalid",
        ];
        let row = |variant: &VariantSummary| {
            let ratios = variant.mean_ratio.each_ref();
            let ratios = ratios.map(|ratio| known(ratio.as_ref(), |ratio| format!("{:.4}", ratio.value)));
            vec![
                variant.name.clone(),
                variant.seeds.to_string(),
                known(variant.squared_bias.as_ref(), plus_minus),
                ratios.join(", "),
                known(variant.estimated_over_measured.as_ref(), figures::estimate),
                variant.invalid_samples.to_string(),
            ]
        };
        Self { heads: heads.map(String::from).into(), rows: summary.variants.iter().map(row).collect() }
    }

    /// Lines with columns of equal width, two spaces between them.
    fn lines(&self) -> String {
        let width = |column: usize| {
            let cells = self.rows.iter().map(|row| &row[column]).chain([&self.heads[column]]);
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.heads.len()).map(width).collect();
        let line = |cells: &[String]| {
            let padded = cells.iter().zip(&widths).map(|(cell, &width)| format!("{cell:<width$}"));
            let line = padded.collect::<Vec<_>>().join("  ");
            format!("{}\n", line.trim_end())
        };
        let rule: usize = widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1);
        let mut text = line(&self.heads);
        text.push_str(&format!("{}\n", "-".repeat(rule)));
        self.rows.iter().for_each(|row| text.push_str(&line(row)));
        text
    }
}

fn times(reading: &Reading) -> String {
    format!("{} x", figures::reading(reading))
}

/// Both signs occur, so the interval is written by its half width.
fn plus_minus(estimate: &Estimate) -> String {
    match estimate.half_width() {
        Some(half) => format!("{} +- {}", number(estimate.value), number(half)),
        None => number(estimate.value),
    }
}

/// A number that was rounded to one digit: `0.002`, `5e-6`.
pub fn round_number(value: f64) -> String {
    if (1e-3..1e4).contains(&value) { value.to_string() } else { format!("{value:e}") }
}

/// What the errors are relative to.
pub fn reference(experiment: &Experiment) -> String {
    let reference = &experiment.reference;
    let kind = match &reference.kind {
        ReferenceKind::File { path } => path.clone(),
        ReferenceKind::Replicates { count } => format!("mean of {count} renders of this experiment"),
    };
    let spp = reference.spp.map_or_else(String::new, |spp| format!(", {spp} spp"));
    let own = match reference.own_error {
        Some(own) => format!("its own relMSE of {} is subtracted", number(own.relmse)),
        None => "its own error is not known and not subtracted".into(),
    };
    format!("{kind}{spp}; {own}")
}

/// The text for the terminal, with a last line break.
pub fn write(experiment: &Experiment, summary: &Summary) -> String {
    let Experiment { scene, width, height, machine, .. } = experiment;
    let plural = if machine.threads == 1 { "" } else { "s" };
    let mut text = format!(
        "{scene}, {width} x {height}\n{}, {} thread{plural}, {}\nreference: {}\n\n",
        machine.cpu,
        machine.threads,
        machine.isa,
        reference(experiment)
    );
    text.push_str(&Figures::of(summary).lines());
    let ratios = Figures::ratios(experiment, summary);
    if !ratios.rows.is_empty() {
        text.push_str(&format!("\n{}", ratios.lines()));
    }
    text.push_str(&format!("\n{}\n", Figures::checks(summary).lines()));
    for sentence in sentences(experiment, summary) {
        text.push_str(&format!("{sentence}\n"));
    }
    text.push_str(
        "Intervals are 95 %, from the spread between seeds; ~ marks what had to be extrapolated.\n",
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::{Measure, synthetic};

    #[test]
    fn the_table_has_every_variant_and_fits_a_terminal() {
        let (experiment, ..) = synthetic::full();
        let text = write(&experiment, &Summary::of(&experiment, Measure::Relmse));
        for part in [
            "scenes/cornell.pbrt, 96 x 64\n",
            "reference: cornell.exr, 65536 spp; its own relMSE of 2.00e-6 is subtracted",
            "wavefront/sobol : megakernel/sobol",
            "wavefront/sobol : pbrt-v4",
            "+-",
            "pbrt-v4                 0.0150 at 5.00 s",
        ] {
            assert!(text.contains(part), "{part} is missing in\n{text}");
        }
        let tables = text.lines().filter(|line| line.contains("---")).map(str::len);
        assert!(tables.max().unwrap() <= 130, "{text}");
        assert!(text.lines().all(|line| line.trim_end() == line), "{text}");
    }

    #[test]
    fn round_numbers_are_short() {
        assert_eq!([0.002, 5e-6, 10.0, 1e7].map(round_number), ["0.002", "5e-6", "10", "1e7"]);
    }
}
