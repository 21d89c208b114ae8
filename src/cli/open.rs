//! Opens the scene that a subcommand is about.

use std::path::Path;

use super::args::FrameArgs;
use super::on_demand::make_missing;
use super::render::set_frame;
use super::{Failure, output};
use crate::pbrt::{self, LoadOptions, Loaded};
use crate::scene::{Scene, SceneOptions};

/// Reads and builds a scene, or the part of it that is asked for; warnings go to standard error unless `quiet`.
pub(super) fn open(
    path: &Path,
    options: &SceneOptions,
    frame: &FrameArgs,
    quiet: bool,
) -> Result<Scene, Failure> {
    let scene = Scene::read(path.display().to_string(), options, || {
        let load_options = LoadOptions { lenient: options.lenient, set: options.set.clone(), list: false };
        let mut loaded = load(path, &load_options, quiet)?;
        set_frame(&mut loaded.scene, frame)?;
        Ok::<_, Failure>(loaded)
    })?;
    if !quiet {
        for warning in scene.warnings() {
            output::note(warning);
        }
    }
    Ok(scene)
}

/// Reads a scene; makes meshes that are missing, if the scene says how.
pub(super) fn load(path: &Path, options: &LoadOptions, quiet: bool) -> Result<Loaded, Failure> {
    let load = |path| pbrt::load_with_options(path, options);
    let failed = |error: pbrt::Error| Failure::Input(error.to_string());
    match load(path) {
        Err(_) if make_missing(path, quiet)? => load(path).map_err(failed),
        result => result.map_err(failed),
    }
}
