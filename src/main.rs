//! The command `wavepath`: a thin shell around the library.

use std::process::ExitCode;

use clap::Parser;
use wavepath::cli::Cli;

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
