//! The command `wavepath`: a thin shell around the library.

use std::process::ExitCode;

use clap::Parser;
use wavepath::cli::{Cli, output};
use wavepath::memory::Allocator;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output::note(failure.to_diagnostic());
            ExitCode::from(failure.exit_code())
        }
    }
}
