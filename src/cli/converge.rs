//! `wavepath converge`: the error of engines and samplers against their run time.

use std::path::Path;

use super::args::{ConvergeArgs, FrameArgs};
use super::open::open;
use super::{Failure, output};
use crate::converge::experiment::{self, Conditions, ConvergeError, Frame, Results};
use crate::converge::files::{self, FilesError};
use crate::converge::summary::Summary;
use crate::converge::{Experiment, Measure, html, table};
use crate::machine;
use crate::picture::{self, Image};
use crate::scene::SceneOptions;

/// Measures, prints the table and writes the folder.
pub(super) fn run(args: &ConvergeArgs) -> Result<(), Failure> {
    let frame = FrameArgs { resolution: args.resolution, ..FrameArgs::default() };
    let options = SceneOptions { set: args.set.clone(), ..SceneOptions::default() };
    let scene = open(&args.scene, &options, &frame, args.quiet)?;
    let like = Frame::of(scene.description());
    let reference = match &args.reference {
        Some(path) => Some((path.clone(), read(path, &like)?)),
        None => None,
    };
    let externals = args
        .external
        .iter()
        .map(|spec| Ok((spec.clone(), read(&spec.file, &like)?)))
        .collect::<Result<Vec<_>, Failure>>()?;
    let conditions = Conditions {
        engines: args.engines.iter().map(|&engine| engine.into()).collect(),
        samplers: args.samplers.iter().map(|&sampler| sampler.into()).collect(),
        adaptive: args.adaptive,
        budget: args.budget,
        seeds: args.seeds,
        threads: args.threads.unwrap_or_else(machine::threads),
        reference,
        externals,
        command_line: std::env::args().collect(),
        interrupted: crate::interrupt::flag()
            .map_err(|error| Failure::Work(format!("cannot watch for Ctrl-C: {error}")))?,
    };
    experiment::check(&scene, &conditions)?;
    // Makes the folder: nothing that can be wrong with the command line or the inputs comes after this.
    files::prepare(&args.output).map_err(|error| Failure::Usage(error.to_string()))?;
    let (experiment, results) = experiment::measure(&scene, &conditions, &mut |text| {
        if !args.quiet {
            output::note(text);
        }
    })?;
    write(args, &conditions, &experiment, &results)?;
    match crate::interrupt::caught() {
        Some((signal, name)) => {
            Err(Failure::Interrupted(signal, format!("interrupted by {name}: wrote what was done")))
        }
        None => Ok(()),
    }
}

impl From<ConvergeError> for Failure {
    fn from(error: ConvergeError) -> Self {
        match error {
            ConvergeError::Twice { .. } | ConvergeError::Seeds => Self::Usage(error.to_string()),
            ConvergeError::Memory { .. } | ConvergeError::Size(_) => Self::Input(error.to_string()),
            ConvergeError::Render(error) => error.into(),
            ConvergeError::Interrupted => Self::Work(error.to_string()),
        }
    }
}

/// Reads a picture that shows what is rendered, or more.
fn read(path: &Path, like: &Frame) -> Result<Image, Failure> {
    let image = picture::read(path)?;
    let Frame { width, height, window } = *like;
    if (image.width, image.height) == (width, height) {
        return Ok(image);
    }
    if let Some(part) = image.crop(window, width, height) {
        return Ok(Image { metadata: image.metadata, ..part });
    }
    let whole = (image.window.full_width, image.window.full_height) == (image.width, image.height);
    let hint = if whole {
        format!("; --resolution {}x{} renders that size", image.width, image.height)
    } else {
        String::new()
    };
    Err(Failure::Input(format!(
        "cannot compare with \"{}\": it has {} x {} pixels, the scene {width} x {height}{hint}",
        path.display(),
        image.width,
        image.height,
    )))
}

fn write(
    args: &ConvergeArgs,
    conditions: &Conditions,
    experiment: &Experiment,
    results: &Results,
) -> Result<(), Failure> {
    let mut pictures: Vec<html::Picture> =
        results.shown.iter().map(|(name, caption, image)| html::Picture { name, caption, image }).collect();
    let captions: Vec<String> =
        conditions.externals.iter().map(|(spec, _)| format!("{} s", spec.seconds)).collect();
    for ((spec, image), caption) in conditions.externals.iter().zip(&captions) {
        pictures.push(html::Picture { name: &spec.name, caption, image });
    }
    files::write(&args.output, experiment, &results.reference, &pictures).map_err(|error| match error {
        FilesError::Pictures(_) => Failure::Input(error.to_string()),
        FilesError::Folder { .. } | FilesError::File { .. } => Failure::Work(error.to_string()),
    })?;
    let table = table::write(experiment, &Summary::of(experiment, Measure::Relmse));
    output::say(format_args!("{table}wrote {}", args.output.join("report.html").display()))
}
