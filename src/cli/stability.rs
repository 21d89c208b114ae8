//! `wavepath stability`: stiff and extreme cases whose values are known.

use std::fs;
use std::time::Instant;

use wavepath_kernels::isa::Level;

use super::args::StabilityArgs;
use super::{Failure, output};
use crate::atomic_file::write_whole;
use crate::engine::EngineKind;
use crate::machine;
use crate::stability::table::Results;
use crate::stability::{self, Case, Subject, page};

/// Measures, prints the table, writes the page. Fails if a case does.
pub(super) fn run(args: &StabilityArgs) -> Result<(), Failure> {
    let wanted = |case: &Case| args.case.is_empty() || args.case.iter().any(|part| case.name.contains(part));
    let cases: Vec<Case> = stability::cases().into_iter().filter(wanted).collect();
    if cases.is_empty() {
        return Err(Failure::Usage(format!(
            "--case: no case's name contains {}; expected a part of a name that --list prints",
            args.case.iter().map(|part| format!("\"{part}\"")).collect::<Vec<_>>().join(" or ")
        )));
    }
    if args.list {
        let names: Vec<&str> = cases.iter().map(|case| case.name.as_str()).collect();
        return output::say(names.join("\n"));
    }
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder).map_err(|reason| {
            Failure::Usage(format!("cannot write to folder \"{}\": {reason}", folder.display()))
        })?;
    }
    let level = args.isa.unwrap_or_else(Level::detect);
    let engine = EngineKind::from(args.engine);
    let subject = Subject { engine, level, leak_rays: args.rays, ..Subject::default() };
    let started = Instant::now();
    let rows = stability::run_all(&cases, &subject, |row| {
        if !args.quiet && row.verdict.is_failure() {
            eprintln!("{} {}", row.verdict.name(), row.name);
        }
    });
    let results = Results {
        version: env!("CARGO_PKG_VERSION"),
        cpu: machine::cpu_name(),
        engine: engine.name().into(),
        isa: level.name().into(),
        leak_rays: args.rays,
        seconds: started.elapsed().as_secs_f64(),
        rows,
    };
    if let Some(folder) = &args.output {
        for (name, text) in [(page::FILE, page::write(&results)), ("stability.json", results.json())] {
            let path = folder.join(name);
            write_whole(&path, |file| std::io::Write::write_all(file, text.as_bytes())).map_err(
                |reason: std::io::Error| {
                    Failure::Work(format!("cannot write \"{}\": {reason}", path.display()))
                },
            )?;
        }
    }
    match (args.json, args.markdown) {
        (true, _) => output::say(results.json())?,
        (_, true) => output::say(results.markdown())?,
        _ => output::say(results.text())?,
    }
    match results.failed() {
        true => Err(Failure::Work(results.summary())),
        false => Ok(()),
    }
}
