//! The command line: its arguments, its subcommands and how they fail.
//!
//! | exit status | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | the work failed |
//! | 2 | the command line or an input is wrong |
//! | 128 + n | signal n ended a render, which has written what was done |

pub mod args;
mod batch;
mod bench;
mod check;
mod compare;
mod converge;
mod convert;
mod failure;
mod films;
mod legend;
mod model;
mod on_demand;
mod open;
pub mod output;
mod parse;
pub mod part_args;
mod plan;
mod ranks;
mod render;
mod stability;

use clap::{Parser, Subcommand};

pub use failure::Failure;

/// A data-oriented wavefront path tracer for the CPU that reports its error against its run time.
#[derive(Debug, Parser)]
#[command(
    name = "wavepath",
    version,
    arg_required_else_help = true,
    max_term_width = 120,
    after_help = "\
Examples:
  wavepath render scene.pbrt -o picture.png --time 1m
      a picture in a minute
  wavepath render model.ply
      a mesh, with a camera and light of its own
  wavepath compare picture.exr reference.exr
      how far off it is

`wavepath COMMAND --help` has examples of each command."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
#[allow(clippy::large_enum_variant, reason = "there is one, for the length of the process")]
pub enum Command {
    /// Render a scene and report its cost and its error
    #[command(after_help = "\
Examples:
  wavepath render scene.pbrt -o a.exr -o a.png --tonemap agx
      linear and for the screen in one go
  wavepath render scene.pbrt --error 0.005 --time 10m
      until it is good enough, ten minutes at most
  wavepath render scene.pbrt --crop 0.4,0.6,0.4,0.6 --spp 1024
      the middle of the image, with many samples
  wavepath render model.ply --up z --write-scene model.pbrt
      a mesh, and the scene made around it
  wavepath render scene.pbrt --spp 9999 --checkpoint a.film --resume-if-there
      starts, and goes on if it was interrupted")]
    Render(args::RenderArgs),
    /// Add film files: parts of a render, or independent renders
    #[command(after_help = "\
Examples:
  wavepath merge -o whole.exr part-1.film part-2.film
      the picture of both, as if rendered in one go
  wavepath merge -o half.film part-1.film part-2.film
      to be merged again, or gone on with: render --resume half.film
  wavepath merge -o whole.exr part-*.film --complete
      fails if samples are missing, and says which")]
    Merge(part_args::MergeArgs),
    /// Say what a film file, or a picture made by wavepath, holds
    #[command(after_help = "\
Examples:
  wavepath info part-1.film             samples, error, what is missing
  wavepath info a.exr                   how it was made
  wavepath info part-1.film --json      the same for scripts")]
    Info(part_args::InfoArgs),
    /// Print the commands that render a scene in parts
    #[command(after_help = "\
Examples:
  wavepath split scene.pbrt --parts 4
      four commands, and the one that merges
  wavepath split scene.pbrt --parts 16 -o out/a.exr -- --spp 4096 --seed 2
      with options for all of them
  wavepath split scene.pbrt --parts 4 --tiles
      parts of the image in place of samples")]
    Split(part_args::SplitArgs),
    /// Convert a picture: crop, exposure, tone curve, layers, precision
    #[command(after_help = "\
Examples:
  wavepath convert a.exr a.png --exposure 1 --tonemap agx
      for the screen, a stop brighter
  wavepath convert a.exr small.exr --half --drop-layers
      half the size
  wavepath convert a.exr noise.png --layer stderr
      where the noise is, of a render with --layers

--exposure brightens EXR files here, too.")]
    Convert(args::ConvertArgs),
    /// Print what a scene needs, and what is left out
    #[command(after_help = "\
Examples:
  wavepath plan scene.pbrt
      stages, kernels, queue columns
  wavepath plan scene.pbrt --resolution 3840x2160
      memory of a larger film
  wavepath plan scene.pbrt --spp 4096 --json
      for scripts")]
    Plan(args::PlanArgs),
    /// Make a mesh by procedure
    #[command(
        override_usage = "wavepath mesh KIND [OPTIONS] -o FILE.ply",
        after_help = "\
Examples:
  wavepath mesh torus-knot -o knot.ply
  wavepath mesh menger --levels 3 -o sponge.ply
  wavepath mesh julia --help
      options of a kind"
    )]
    Mesh(crate::meshes::MeshArgs),
    /// Measure engines against each other, and what each part of them brings
    #[command(after_help = "\
Examples:
  wavepath bench
      the scenes of the project, in its folder
  wavepath bench scene.pbrt --rounds 9 --each 1s
      one's own, measured longer
  wavepath bench scene.pbrt --json > bench.json
      for scripts")]
    Bench(args::BenchArgs),
    /// Compare an image with a reference and print the error measures, or where it estimates its own
    #[command(after_help = "\
Examples:
  wavepath compare a.exr reference.exr
      error measures
  wavepath compare a.exr --map noise.png
      where the noise is, by its own estimate (of a render with --layers)
  wavepath compare a.exr reference.exr --map error.png
      and where the error is
  wavepath compare a.exr reference.exr --fail-above 1e-3
      status 1 if it is worse: for make and CI")]
    Compare(args::CompareArgs),
    /// Measure the error of engines and samplers against their run time
    #[command(after_help = "\
Examples:
  wavepath converge scene.pbrt --budget 10s -o out
      a page with plots: out/report.html
  wavepath converge scene.pbrt --reference ref.exr --engines wavefront -o out
  wavepath converge scene.pbrt --external pbrt:90s:p.exr --reference r.exr -o d")]
    Converge(args::ConvergeArgs),
    /// Render many scenes, frames or settings: a queue, of which what is done is not done again
    #[command(after_help = "\
Examples:
  wavepath batch jobs.toml
      all jobs of a queue; once more, only what has changed
  wavepath batch jobs.toml --dry-run
      what there is to do, as commands
  wavepath batch scenes/ -o 'out/{scene}.exr' -- --spp 64
      all scenes of a folder")]
    Batch(args::BatchArgs),
    /// Look for what in a scene is numerically dangerous, or probably a mistake
    #[command(after_help = "\
Examples:
  wavepath check scene.pbrt             what deserves a look, and digits left
  wavepath check scene.pbrt --json      the same for scripts
  wavepath check scene.pbrt | head      the first of it")]
    Check(args::CheckArgs),
    /// Measure stiff and extreme cases whose values are known
    #[command(after_help = "\
Examples:
  wavepath stability                    all cases, in some minutes
  wavepath stability --case glass       those with glass in their name
  wavepath stability -o out             with a page: out/stability.html")]
    Stability(args::StabilityArgs),
}

impl Cli {
    /// Does what the command line asks for.
    ///
    /// # Errors
    /// [`Failure`], which knows its exit status.
    pub fn run(&self) -> Result<(), Failure> {
        match &self.command {
            Command::Render(args) => ranks::run(args),
            Command::Merge(args) => films::merge(args),
            Command::Info(args) => films::info(args),
            Command::Split(args) => films::split(args),
            Command::Convert(args) => convert::run(args),
            Command::Plan(args) => plan::run(args),
            Command::Mesh(args) => match crate::meshes::run(args) {
                // The mesh itself may be on standard output.
                Ok(summary) if args.output.as_deref().is_some_and(crate::atomic_file::is_standard_output) => {
                    output::note(summary);
                    Ok(())
                }
                Ok(summary) => output::say(summary),
                Err(error) if error.is_usage() => Err(Failure::Usage(error.to_string())),
                Err(error) => Err(Failure::Work(error.to_string())),
            },
            Command::Bench(args) => bench::run(args),
            Command::Compare(args) => compare::run(args),
            Command::Converge(args) => converge::run(args),
            Command::Batch(args) => batch::run(args),
            Command::Check(args) => check::run(args),
            Command::Stability(args) => stability::run(args),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn every_command_has_three_examples() {
        for command in super::Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let examples = help.lines().filter(|line| line.starts_with("  wavepath ")).count();
            assert!(examples >= 3, "{}: {help}", command.get_name());
            for line in help.lines() {
                assert!(line.len() <= 80, "{line}");
            }
        }
    }

    #[test]
    fn the_definition_is_consistent() {
        super::Cli::command().debug_assert();
    }
}
