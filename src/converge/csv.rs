//! Every measured point as comma-separated values (RFC 4180), one a row.

use std::fmt::Write;

use super::{Errors, Experiment};

/// The columns before those of the stages.
const COLUMNS: &str = "variant,engine,sampler,seed,setup_seconds,seconds,spp,samples,mse,relmse,relmse_trimmed,\
    mean_ratio_red,mean_ratio_green,mean_ratio_blue,estimated_relmse,invalid_samples";

/// The whole file. Times are in seconds; errors are as measured, with the reference's own error in them. After the fixed
/// columns, each stage of any variant has one: its seconds summed over the workers. A figure that is unknown or does
/// not apply is an empty field. The pictures of other programs come last, with an empty seed.
pub fn write(experiment: &Experiment) -> String {
    let stages = stage_names(experiment);
    let mut text = COLUMNS.to_string();
    for stage in &stages {
        text.push_str(&format!(",{}", field(&format!("{stage}_seconds"))));
    }
    text.push('\n');
    for variant in &experiment.variants {
        let names = [&variant.name, &variant.engine, &variant.sampler].map(|name| field(name)).join(",");
        for run in &variant.runs {
            for point in &run.points {
                let (setup, seconds) = (number(run.setup_seconds), number(point.seconds));
                let (spp, samples) = (number(point.spp), point.samples);
                write!(text, "{names},{},{setup},{seconds},{spp},{samples}", run.seed).expect(STRING);
                push_errors(&mut text, &point.errors);
                let estimated = point.estimated_relmse.map_or_else(String::new, number);
                write!(text, ",{estimated},{}", point.invalid_samples).expect(STRING);
                for stage in &stages {
                    let spent = point.stage_seconds.iter().find(|(name, _)| name == stage);
                    text.push(',');
                    text.push_str(&spent.map_or_else(String::new, |(_, seconds)| number(*seconds)));
                }
                text.push('\n');
            }
        }
    }
    for external in &experiment.externals {
        write!(text, "{},,,,,{},,", field(&external.name), number(external.seconds)).expect(STRING);
        push_errors(&mut text, &external.errors);
        text.push_str(&",".repeat(2 + stages.len()));
        text.push('\n');
    }
    text
}

const STRING: &str = "a string takes everything";

fn push_errors(text: &mut String, errors: &Errors) {
    let Errors { mse, relmse, relmse_trimmed, mean_ratio: [red, green, blue] } = *errors;
    for value in [mse, relmse, relmse_trimmed, red, green, blue] {
        text.push(',');
        text.push_str(&number(value));
    }
}

/// The stages of all points, in order of appearance.
fn stage_names(experiment: &Experiment) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    let runs = experiment.variants.iter().flat_map(|variant| &variant.runs);
    for (name, _) in runs.flat_map(|run| &run.points).flat_map(|point| &point.stage_seconds) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    names
}

/// The shortest text that reads back as the same number; empty if it is not finite.
fn number(value: f64) -> String {
    match value.abs() {
        _ if !value.is_finite() => String::new(),
        0.0 | 1e-4..1e15 => value.to_string(),
        _ => format!("{value:e}"),
    }
}

/// `text` as a field, in quotes where it needs them. A first character that would make a spreadsheet take the field for
/// a formula gets an apostrophe in front.
fn field(text: &str) -> String {
    let guarded =
        if text.starts_with(['=', '+', '-', '@', '\t', '\r']) { format!("'{text}") } else { text.into() };
    let plain = !guarded.contains([',', '"', '\n', '\r']);
    if plain { guarded } else { format!("\"{}\"", guarded.replace('"', "\"\"")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::synthetic;

    #[test]
    fn one_row_for_each_point_and_as_many_fields_in_each() {
        let (experiment, ..) = synthetic::full();
        let text = write(&experiment);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 1 + 4 * 5 * 6 + 1);
        let header: Vec<&str> = lines[0].split(',').collect();
        assert_eq!(header.last(), Some(&"megakernel_seconds"));
        assert!(lines.iter().all(|line| line.split(',').count() == header.len()));
        let column = |name: &str| header.iter().position(|field| *field == name).unwrap();
        let first: Vec<&str> = lines[1].split(',').collect();
        let point = &experiment.variants[0].runs[0].points[0];
        let read = |name: &str| first[column(name)].parse::<f64>().unwrap();
        assert_eq!((read("seconds"), read("relmse")), (point.seconds, point.errors.relmse));
        assert_eq!((first[column("seed")], first[column("megakernel_seconds")]), ("1", ""));
        let last: Vec<&str> = lines[121].split(',').collect();
        assert_eq!((last[0], last[column("seed")], last[column("relmse")]), ("pbrt-v4", "", "0.015"));
        assert_eq!((last[column("seconds")], last[column("estimated_relmse")]), ("5", ""));
    }

    #[test]
    fn names_are_quoted_where_they_need_it() {
        assert_eq!(field("wavefront/sobol"), "wavefront/sobol");
        assert_eq!(field("a, \"b\"\n"), "\"a, \"\"b\"\"\n\"");
        assert_eq!(field("=1+1"), "'=1+1");
    }

    #[test]
    fn numbers_read_back_and_unknown_ones_are_empty() {
        for value in [0.0, 1.0, 0.1, 1e-7, 1.234_567_890_123e-300, 1e20, 123_456_789.0] {
            assert_eq!(number(value).parse::<f64>().unwrap(), value);
            assert!(number(value).len() < 24, "{}", number(value));
        }
        assert_eq!((number(f64::NAN), number(f64::INFINITY)), (String::new(), String::new()));
    }
}
