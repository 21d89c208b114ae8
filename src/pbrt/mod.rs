//! Reads scenes in pbrt's format (version 4, with version 3's names accepted).
//!
//! The way of a scene:
//!
//! 1. `lexer` streams tokens with their places out of a file, compressed or not;
//! 2. `parser` knows the format: it follows `Include`, and yields directives with typed parameters;
//! 3. `interpret` knows wavepath: it turns directives into a [`SceneDescription`], with the help of `ply`
//!    (meshes), `spectra` (colours) and `transform`.
//!
//! The parser knows nothing of what wavepath supports, and the interpreter nothing of brackets and quotes.
//!
//! What pbrt has and wavepath lacks is an error that names it; where the picture stays right without it, a warning.
//! No input makes the reader panic, hang, or take memory on a header's word.
//!
//! ```
//! let text = r#"
//!     LookAt 0 0 -5  0 0 0  0 1 0
//!     Camera "perspective" "float fov" 40
//!     WorldBegin
//!     LightSource "infinite" "rgb L" [ 1 1 1 ]
//!     Material "diffuse" "rgb reflectance" [ 0.5 0.5 0.5 ]
//!     Shape "sphere" "float radius" 1
//! "#;
//! let loaded = wavepath::pbrt::load_str(text, "example", std::path::Path::new("."))?;
//! assert_eq!(loaded.scene.shapes.len(), 1);
//! assert!(loaded.warnings.is_empty());
//! # Ok::<(), wavepath::pbrt::Error>(())
//! ```

mod dialect;
mod error;
mod foreign;
mod graphics_state;
mod interpret;
mod lexer;
mod overrides;
mod parameters;
mod parser;
mod ply;
mod polygon;
mod source;
mod spectra;
mod subdivision;
mod suggest;
pub(crate) mod transform;

use std::path::{Path, PathBuf};

pub(crate) use ply::reading_time;

pub use overrides::Override;
#[cfg(feature = "cli")]
pub(crate) use suggest::did_you_mean;

pub use error::{Diagnostic, Error, Excerpt, Location, Severity};

use crate::scene::SceneDescription;
use dialect::Dialect;
use error::{Place, Problem};
use interpret::{Builder, Flow};
use lexer::Lexer;
use overrides::Overrides;
use parser::Parser;
use source::Sources;

/// A scene, and what there is to say about its files.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: SceneDescription,
    /// What deserves a look, in the order in which it was found.
    pub warnings: Vec<Diagnostic>,
    /// Every file that was read: the scene, included files, meshes, spectra.
    pub inputs: Vec<PathBuf>,
    /// Where its shapes stand.
    pub places: Places,
    /// Names and values of what can be set from outside, if [`LoadOptions::list`] asks for them.
    pub names: Vec<(String, String)>,
}

/// How to read a scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// As [`load_leniently`].
    pub lenient: bool,
    /// What is set from outside.
    pub set: Vec<Override>,
    /// Whether to list what can be set.
    pub list: bool,
}

impl LoadOptions {
    fn lenient(lenient: bool) -> Self {
        LoadOptions { lenient, ..LoadOptions::default() }
    }
}

/// Where the shapes of a scene stand in its files.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Places {
    /// Names of the scene files.
    files: Vec<String>,
    /// For each shape, the number of its file and its line.
    shapes: Vec<(u32, u32)>,
}

impl Places {
    /// File and line of a shape, for those that were read from a file. Of an instance, those of the instance.
    pub fn shape(&self, number: usize) -> Option<(&str, u32)> {
        let &(file, line) = self.shapes.get(number)?;
        Some((self.files.get(file as usize)?, line))
    }
}

/// Reads a scene file and all files that it refers to. A name that ends in `.gz` is decompressed. The scene may
/// come from a pipe; the files that it refers to may not.
///
/// # Errors
/// The first thing in the files that is wrong, or everything that wavepath cannot render rightly.
pub fn load(path: &Path) -> Result<Loaded, Error> {
    load_with_options(path, &LoadOptions::default())
}

/// As [`load`], but what wavepath lacks is replaced by something that it has, or left out, and each replacement is
/// among the warnings: for benchmarks, where the light need not be right.
///
/// # Errors
/// The first thing in the files that is wrong.
pub fn load_leniently(path: &Path) -> Result<Loaded, Error> {
    load_with_options(path, &LoadOptions::lenient(true))
}

/// As [`load`], with options.
///
/// # Errors
/// As [`load`], and what is set from outside and cannot be.
pub fn load_with_options(path: &Path, options: &LoadOptions) -> Result<Loaded, Error> {
    let cannot = |error: std::io::Error| {
        Problem::new(Place::Nowhere, format!("cannot read {}: {error}", path.display()))
    };
    // The files of a scene from standard input are not beside the device.
    let is_device = ["/dev", "/proc"].iter().any(|root| path.starts_with(root));
    let directory = if is_device { Path::new("") } else { path.parent().unwrap_or(Path::new("")) };
    let special = source::read_special(path);
    let special = special.map_err(|error| Sources::default().error(&[*cannot(error)]))?;
    if let Some(bytes) = special {
        return load_text(&bytes, &path.display().to_string(), directory, options);
    }
    let open = |sources: &mut Sources| {
        let lexer = sources.open(path).map_err(cannot)?;
        Ok((lexer, Some(path.to_path_buf()), directory.to_path_buf()))
    };
    load_with(open, options)
}

/// Reads a scene from a text. `name` stands for the file in messages; file names in the text are relative to
/// `base_dir`.
///
/// # Errors
/// As [`load`].
pub fn load_str(text: &str, name: &str, base_dir: &Path) -> Result<Loaded, Error> {
    load_bytes(text.as_bytes(), name, base_dir)
}

/// As [`load_str`], for bytes that are perhaps not UTF-8.
///
/// # Errors
/// As [`load`].
pub fn load_bytes(bytes: &[u8], name: &str, base_dir: &Path) -> Result<Loaded, Error> {
    load_text(bytes, name, base_dir, &LoadOptions::default())
}

/// As [`load_bytes`], with options.
///
/// # Errors
/// As [`load_with_options`].
pub fn load_text(bytes: &[u8], name: &str, base_dir: &Path, options: &LoadOptions) -> Result<Loaded, Error> {
    load_with(|sources| Ok((sources.open_text(name, bytes), None, base_dir.to_path_buf())), options)
}

type Opened = (Lexer, Option<PathBuf>, PathBuf);

fn load_with(
    open: impl Fn(&mut Sources) -> error::Result<Opened>,
    options: &LoadOptions,
) -> Result<Loaded, Error> {
    match load_as(&open, Dialect::default(), options) {
        Err(Outcome::Restart) => match load_as(&open, Dialect::v3(), options) {
            Ok(loaded) => Ok(loaded),
            Err(Outcome::Failed(error)) => Err(error),
            Err(Outcome::Restart) => {
                unreachable!("the dialect is settled, so nothing can be revised")
            }
        },
        Err(Outcome::Failed(error)) => Err(error),
        Ok(loaded) => Ok(loaded),
    }
}

enum Outcome {
    Restart,
    Failed(Error),
}

fn load_as(
    open: &impl Fn(&mut Sources) -> error::Result<Opened>,
    dialect: Dialect,
    options: &LoadOptions,
) -> Result<Loaded, Outcome> {
    let mut sources = Sources::default();
    let fail = |sources: &Sources, problems: &[Problem]| match problems.iter().any(|problem| problem.restart)
    {
        true => Outcome::Restart,
        false => Outcome::Failed(sources.error(problems)),
    };
    let (lexer, path, directory) = open(&mut sources).map_err(|problem| fail(&sources, &[*problem]))?;
    let mut parser = Parser::new(lexer, path.as_deref(), &directory);
    let mut builder = Builder::new(dialect, directory, options.lenient);
    let overrides = Overrides::new(&options.set, options.list, &mut sources);
    let mut overrides = overrides.map_err(|problem| fail(&sources, &[*problem]))?;
    builder.set_pose(overrides.pose().map_err(|problem| fail(&sources, &[*problem]))?);
    loop {
        match parser.next(&mut sources) {
            Ok(Some(mut statement)) => {
                let before = overrides.apply(&mut statement, builder.is_v3());
                let all = before.map(|before| before.into_iter().chain([statement]));
                let mut all = all.map_err(|problem| fail(&sources, &builder.failure(*problem)))?;
                let flow = all.try_fold(Flow::On, |flow, statement| match flow {
                    Flow::On => builder.statement(statement, parser.directory()),
                    Flow::Ended => Ok(Flow::Ended),
                });
                match flow {
                    Ok(Flow::On) => {}
                    Ok(Flow::Ended) => break,
                    Err(problem) => return Err(fail(&sources, &builder.failure(*parser.trace(problem)))),
                }
            }
            Ok(None) => break,
            Err(problem) => {
                // What is wrong with a file of another format is that it is one.
                let foreign = match problem.place {
                    Place::Span(span) => sources.foreign(span.file),
                    _ => None,
                };
                let problem = parser.trace(foreign.unwrap_or(problem));
                return Err(fail(&sources, &builder.failure(*problem)));
            }
        }
    }
    let names = overrides.finish().map_err(|problem| fail(&sources, &builder.failure(*problem)))?;
    let finished = builder.finish().map_err(|problems| fail(&sources, &problems))?;
    let warnings =
        finished.warnings.iter().map(|problem| sources.render(problem, Severity::Warning)).collect();
    sources.inputs.extend(finished.inputs);
    let shapes = finished.shape_spans.iter().map(|span| (span.file.0, span.line)).collect();
    let places = Places { files: sources.names(), shapes };
    Ok(Loaded { scene: finished.scene, warnings, inputs: sources.inputs, places, names })
}
