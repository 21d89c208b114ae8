//! The summary of a queue.

use super::super::args::BatchArgs;
use super::super::{Failure, output};
use super::run::{Finished, Outcome};
use super::state::State;
use super::{Job, Queue};
use crate::report::Report;
use serde_json::{Value, json};

/// Prints what became of the jobs.
pub(super) fn print(results: &[Finished], args: &BatchArgs) -> Result<(), Failure> {
    if args.json {
        let all: Vec<Value> = results.iter().map(object).collect();
        return output::say(format_args!("{:#}", Value::Array(all)));
    }
    if args.quiet {
        return Ok(());
    }
    let header = ["job", "", "spp", "seconds", "relMSE", "efficiency, 1/s", "output"].map(String::from);
    let rows = results.iter().map(|Finished { job, outcome }| {
        let output = job.outputs.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
        let (word, report) = state(outcome);
        let [spp, seconds, error, efficiency] = match report {
            None => Default::default(),
            Some(report) => [
                report.spp.to_string(),
                format!("{:.2}", report.seconds),
                report.estimated_relmse.map(|error| format!("{error:.3e}")).unwrap_or_default(),
                efficiency(report).map(|e| format!("{e:.3}")).unwrap_or_default(),
            ],
        };
        [job.name.clone(), word.into(), spp, seconds, error, efficiency, output]
    });
    let rows: Vec<[String; 7]> = [header].into_iter().chain(rows).collect();
    let widths: [usize; 7] =
        std::array::from_fn(|i| rows.iter().map(|row| row[i].chars().count()).max().unwrap_or(0));
    let line = |row: &[String; 7]| {
        let cells: Vec<String> = row
            .iter()
            .zip(widths)
            .enumerate()
            .map(|(i, (cell, width))| match i {
                2..=5 => format!("{cell:>width$}"),
                _ => format!("{cell:width$}"),
            })
            .collect();
        cells.join("  ").trim_end().to_string()
    };
    output::say(rows.iter().map(line).collect::<Vec<_>>().join("\n"))
}

fn state(outcome: &Outcome) -> (&'static str, Option<&Report>) {
    match outcome {
        Outcome::Done(report) => ("done", Some(report)),
        Outcome::Skipped(report) => ("was done", Some(report)),
        Outcome::Failed(_) => ("failed", None),
        Outcome::Interrupted => ("interrupted", None),
    }
}

/// 1 / (relMSE x time).
fn efficiency(report: &Report) -> Option<f64> {
    let product = report.estimated_relmse? * report.seconds;
    (product > 0.0).then(|| 1.0 / product)
}

fn object(Finished { job, outcome }: &Finished) -> Value {
    let (word, report) = state(outcome);
    let swept: serde_json::Map<_, _> =
        job.swept.iter().map(|(name, value)| (name.clone(), value.clone().into())).collect();
    let mut object = json!({ "job": job.name, "state": word, "outputs": job.outputs, "swept": swept });
    if let Some(report) = report {
        object["spp"] = json!(report.spp);
        object["seconds"] = json!(report.seconds);
        object["estimated_relmse"] = json!(report.estimated_relmse);
        object["efficiency"] = json!(efficiency(report));
    }
    if let Outcome::Failed(why) = outcome {
        object["error"] = json!(why);
    }
    object
}

/// Prints what would be done.
pub(super) fn dry(queue: &Queue, json: bool) -> Result<(), Failure> {
    let state = State::look(&queue.state, &queue.folder);
    let of_job = |job: &Job| {
        let word = if state.done(job).is_some() { "is done" } else { "to do" };
        let outputs = job.outputs.iter().map(|path| format!("--output={}", path.display()));
        let words: Vec<String> = job.arguments.iter().cloned().chain(outputs).collect();
        (word, words)
    };
    if json {
        let object = |job: &Job| {
            let (word, words) = of_job(job);
            json!({ "job": job.name, "state": word, "arguments": words })
        };
        let all: Vec<Value> = queue.jobs.iter().map(object).collect();
        return output::say(format_args!("{:#}", Value::Array(all)));
    }
    let lines: Vec<String> = queue
        .jobs
        .iter()
        .map(|job| {
            let (word, words) = of_job(job);
            let words: Vec<String> = words.iter().map(|word| quoted(word)).collect();
            format!("{}: {word}: wavepath {}", job.name, words.join(" "))
        })
        .collect();
    output::say(lines.join("\n"))
}

/// As a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_=./,:+%@".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.into();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}
