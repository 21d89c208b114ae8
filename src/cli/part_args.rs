//! Options of long renders: checkpoints, parts, and what is told while they run.

use clap::{Args, ValueEnum};
use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

use super::parse;

const LONG: &str = "Long renders and parts";
const REPORTS: &str = "Reports";

/// Checkpoints, parts, progress.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub struct PartArgs {
    /// Keep what is done in this film file, as the render goes on and at its end
    #[arg(long, value_name = "FILE.film", help_heading = LONG)]
    pub checkpoint: Option<PathBuf>,

    /// Time from one checkpoint to the next [default: a minute, or as seldom that it takes half a per cent of the time]
    #[arg(long, value_name = "TIME", value_parser = parse::duration, allow_hyphen_values = true,
          requires = "checkpoint", help_heading = LONG)]
    pub checkpoint_every: Option<Duration>,

    /// Remove the checkpoint once the render is done and its pictures are written
    #[arg(long, requires = "checkpoint", help_heading = LONG)]
    pub checkpoint_until_done: bool,

    /// Go on with a film file: a checkpoint, a part, or a finished render that is to get more samples
    #[arg(long, value_name = "FILE.film", help_heading = LONG)]
    pub resume: Option<PathBuf>,

    /// Go on with the file of --resume, or of --checkpoint, if it exists; begin otherwise: the same command line starts and
    /// restarts
    #[arg(long, help_heading = LONG)]
    pub resume_if_there: bool,

    /// Render a part: of the samples of each pixel those from A on, before B. With -o PART.film, for merge
    #[arg(long, value_name = "A..B", value_parser = parse_samples, allow_hyphen_values = true,
          conflicts_with_all = ["spp", "part"], help_heading = LONG)]
    pub samples: Option<SampleRange>,

    /// Render a part: number I, from 1, of N parts with the same share of the samples. With -o PART.film, for merge
    #[arg(long, value_name = "I/N", value_parser = parse_part, allow_hyphen_values = true, help_heading = LONG)]
    pub part: Option<PartOf>,

    /// Parts are blocks of pixels, not samples: for films that do not fit into the memory of a machine
    #[arg(long, requires = "part", help_heading = LONG)]
    pub tiles: bool,

    /// Refresh the picture on disk this often while the render goes on
    #[arg(long, value_name = "TIME", value_parser = parse::duration, allow_hyphen_values = true, help_heading = LONG)]
    pub save_every: Option<Duration>,

    /// How progress is told on standard error: as it suits the terminal, or a line of JSON a second
    #[arg(long, value_enum, default_value_t = ProgressArg::Auto, hide_default_value = true, help_heading = REPORTS)]
    pub progress: ProgressArg,
}

/// Numbers of samples in a pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SampleRange(pub Range<u32>);

/// One of several parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartOf {
    /// From 1.
    pub number: u32,
    /// How many there are.
    pub count: u32,
}

impl PartOf {
    /// Its share of so many samples; parts without samples have none.
    pub fn samples(self, all: u32) -> Range<u32> {
        let at = |number: u32| (u64::from(all) * u64::from(number) / u64::from(self.count)) as u32;
        at(self.number - 1)..at(self.number)
    }
}

/// How progress is told.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum ProgressArg {
    /// A bar on a terminal, a line a minute elsewhere
    #[default]
    Auto,
    /// A line of JSON a second
    Json,
}

fn parse_samples(text: &str) -> Result<SampleRange, String> {
    let expected = || format!("found \"{text}\"; expected A..B with A below B, such as 0..256");
    let (first, end) = text.split_once("..").ok_or_else(expected)?;
    let number = |word: &str| word.trim().parse::<u32>().map_err(|_| expected());
    let (first, end) = (number(first)?, number(end)?);
    if first < end && end <= 1 << 31 { Ok(SampleRange(first..end)) } else { Err(expected()) }
}

fn parse_part(text: &str) -> Result<PartOf, String> {
    let expected = || format!("found \"{text}\"; expected I/N with I from 1 to N, such as 2/7");
    let (number, count) = text.split_once('/').ok_or_else(expected)?;
    let word = |word: &str| word.trim().parse::<u32>().map_err(|_| expected());
    let (number, count) = (word(number)?, word(count)?);
    if (1..=count).contains(&number) { Ok(PartOf { number, count }) } else { Err(expected()) }
}

/// Arguments of `wavepath merge`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct MergeArgs {
    /// Film files: parts, checkpoints, or what was merged before
    #[arg(value_name = "PART.film", required = true)]
    pub parts: Vec<PathBuf>,

    /// What to write: a film file (.film), or the picture (.exr, .png); may be given more than once
    #[arg(short, long, value_name = "OUT.film|OUT.exr|OUT.png", required = true)]
    pub output: Vec<PathBuf>,

    /// Fail, and write nothing, if samples are missing
    #[arg(long)]
    pub complete: bool,

    /// Add each pixel's standard error (stderr.R, .G, .B) and number of samples (samples) to EXR files
    #[arg(long)]
    pub layers: bool,

    /// Write the report as JSON to this file; - is standard output
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,

    /// Refuse to replace any file that exists
    #[arg(long)]
    pub no_clobber: bool,

    /// How pictures become files.
    #[command(flatten)]
    pub encoding: super::args::EncodingArgs,

    /// Print errors only
    #[arg(short, long)]
    pub quiet: bool,
}

/// Arguments of `wavepath info`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct InfoArgs {
    /// A film file, or a picture that wavepath made
    #[arg(value_name = "FILE.film|FILE.exr")]
    pub file: PathBuf,

    /// Print one JSON object instead of text
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `wavepath split`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct SplitArgs {
    /// Scene to render
    #[arg(value_name = "SCENE.pbrt")]
    pub scene: PathBuf,

    /// How many parts
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub parts: u32,

    /// Picture of the whole; parts are named after it [default: the scene's name with .exr, here]
    #[arg(short, long, value_name = "OUT.exr|OUT.png")]
    pub output: Option<PathBuf>,

    /// Parts are blocks of pixels, not samples
    #[arg(long)]
    pub tiles: bool,

    /// Options of render for all parts, after --, such as -- --spp 4096 --seed 2
    #[arg(last = true, value_name = "OPTIONS")]
    pub options: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_fair_and_whole() {
        for (all, count) in [(64, 1), (64, 7), (3, 5), (u32::MAX, 9), (1, 2)] {
            let parts: Vec<Range<u32>> =
                (1..=count).map(|number| PartOf { number, count }.samples(all)).collect();
            assert_eq!((parts[0].start, parts[parts.len() - 1].end), (0, all));
            assert!(parts.windows(2).all(|pair| pair[0].end == pair[1].start));
            let sizes = parts.iter().map(|part| part.end - part.start);
            assert!(sizes.clone().max().unwrap() - sizes.min().unwrap() <= 1);
        }
    }

    #[test]
    fn what_is_no_part_is_told() {
        assert_eq!(parse_samples("3..9"), Ok(SampleRange(3..9)));
        assert_eq!(parse_part("2/7"), Ok(PartOf { number: 2, count: 7 }));
        for wrong in ["", "3", "3..", "..9", "9..3", "3..3", "-1..3", "a..b", "0..4294967295"] {
            let error = parse_samples(wrong).unwrap_err();
            assert!(error.contains("expected A..B"), "{wrong}: {error}");
        }
        for wrong in ["", "1", "0/3", "4/3", "1/0", "-1/3", "1/3/5", "a/b"] {
            let error = parse_part(wrong).unwrap_err();
            assert!(error.contains("expected I/N"), "{wrong}: {error}");
        }
    }
}
