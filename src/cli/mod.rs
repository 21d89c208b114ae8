//! The command line: its arguments, its subcommands and how they fail.
//!
//! | exit status | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | the work failed |
//! | 2 | the command line or an input is wrong |

pub mod args;
mod compare;
mod failure;
pub mod output;
mod parse;

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
    /// Compare an image with a reference and print the error measures
    Compare(args::CompareArgs),
}

impl Cli {
    /// Does what the command line asks for.
    ///
    /// # Errors
    /// [`Failure`], which knows its exit status.
    pub fn run(&self) -> Result<(), Failure> {
        match &self.command {
            Command::Compare(args) => compare::run(args),
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
