//! The command line: its arguments, its subcommands and how they fail.
//!
//! | exit status | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | the work failed |
//! | 2 | the command line or an input is wrong |

pub mod args;
mod bench;
mod compare;
mod converge;
mod failure;
mod open;
pub mod output;
mod parse;
mod plan;
mod render;

use clap::{Parser, Subcommand};

pub use failure::Failure;

/// A data-oriented wavefront path tracer for the CPU that reports its error against its run time.
#[derive(Debug, Parser)]
#[command(name = "wavepath", version, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene and report its cost and its error
    Render(args::RenderArgs),
    /// Print what a scene needs, and what is left out
    Plan(args::PlanArgs),
    /// Make a mesh by procedure
    Mesh(crate::meshes::MeshArgs),
    /// Measure engines against each other, and what each part of them brings
    Bench(args::BenchArgs),
    /// Compare an image with a reference and print the error measures
    Compare(args::CompareArgs),
    /// Measure the error of engines and samplers against their run time
    Converge(args::ConvergeArgs),
}

impl Cli {
    /// Does what the command line asks for.
    ///
    /// # Errors
    /// [`Failure`], which knows its exit status.
    pub fn run(&self) -> Result<(), Failure> {
        match &self.command {
            Command::Render(args) => render::run(args),
            Command::Plan(args) => plan::run(args),
            Command::Mesh(args) => match crate::meshes::run(args) {
                Ok(summary) => output::say(summary),
                Err(error) if error.is_usage() => Err(Failure::Usage(error.to_string())),
                Err(error) => Err(Failure::Work(error.to_string())),
            },
            Command::Bench(args) => bench::run(args),
            Command::Compare(args) => compare::run(args),
            Command::Converge(args) => converge::run(args),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_consistent() {
        super::Cli::command().debug_assert();
    }
}
