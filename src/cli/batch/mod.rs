//! `wavepath batch`: many renders, one after another or some at once.
//!
//! A queue is read ([`queue`]: jobs, settings, sweeps, names of outputs), and what of it is not done yet is done ([`run`]): a
//! process for each job, so that one that fails, or that the system ends, takes no other along. What was done is kept in a
//! folder ([`state`]), with hashes of everything that the picture depends on; several runs of a queue share it by locks in
//! that folder.

mod names;
mod queue;
mod run;
mod scenes;
mod state;
mod sweep;
mod table;

use super::Failure;
use super::args::BatchArgs;
use std::path::{Path, PathBuf};

/// A render.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Job {
    /// Its own, also that of its files in the folder of the queue.
    name: String,
    /// The arguments of `wavepath`, from `render` on; without the outputs.
    arguments: Vec<String>,
    outputs: Vec<PathBuf>,
    /// Values that are swept, by name: for the summary.
    swept: Vec<(String, String)>,
}

/// Jobs, and where they are at home.
#[derive(Debug)]
struct Queue {
    jobs: Vec<Job>,
    /// The folder in which they run: names of files are relative to it.
    folder: PathBuf,
    /// Where the state is kept.
    state: PathBuf,
}

/// Does the queue.
pub(super) fn run(args: &BatchArgs) -> Result<(), Failure> {
    let queue = open(args)?;
    if args.dry_run {
        return table::dry(&queue, args.json);
    }
    let results = run::run(&queue, args)?;
    table::print(&results, args)?;
    run::verdict(&results)
}

/// The queue that the command line names.
fn open(args: &BatchArgs) -> Result<Queue, Failure> {
    let is_queue =
        |path: &PathBuf| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"));
    let mut queue = match args.what.as_slice() {
        [path] if is_queue(path) => {
            if args.output.is_some() {
                return Err(Failure::Usage(
                    "-o is for scenes: expected the names of outputs in the queue, as output = \"...\""
                        .into(),
                ));
            }
            let text = std::fs::read_to_string(path)
                .map_err(|error| Failure::Input(format!("cannot read {}: {error}", path.display())))?;
            let jobs = queue::read(&text, &path.display().to_string(), &args.options)?;
            let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
            Queue { jobs, folder, state: path.with_extension("batch") }
        }
        paths if paths.iter().any(is_queue) => {
            return Err(Failure::Usage("expected one queue (.toml), or scenes, folders and patterns".into()));
        }
        paths => {
            let jobs = scenes::jobs(paths, args.output.as_deref(), &args.options)?;
            Queue { jobs, folder: PathBuf::new(), state: "wavepath.batch".into() }
        }
    };
    if let Some(state) = &args.state {
        queue.state.clone_from(state);
    }
    Ok(queue)
}
