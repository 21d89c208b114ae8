//! Opens the scene that a subcommand is about.

use std::path::Path;

use super::args::FrameArgs;
use super::render::set_frame;
use super::{Failure, output};
use crate::scene::{Scene, SceneOptions};

/// Reads and builds a scene, or the part of it that is asked for; warnings go to standard error unless `quiet`.
pub(super) fn open(
    path: &Path,
    options: &SceneOptions,
    frame: &FrameArgs,
    quiet: bool,
) -> Result<Scene, Failure> {
    let scene = Scene::read(path.display().to_string(), options, || {
        let load = if options.lenient { crate::pbrt::load_leniently } else { crate::pbrt::load };
        let mut loaded = load(path).map_err(|error| Failure::Input(error.to_string()))?;
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
