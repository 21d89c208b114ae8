//! Opens the scene that a subcommand is about.

use std::path::Path;

use super::{Failure, output};
use crate::scene::{Scene, SceneOptions};

/// Reads and builds a scene; warnings go to standard error unless `quiet`.
pub(super) fn open(path: &Path, options: &SceneOptions, quiet: bool) -> Result<Scene, Failure> {
    let scene = Scene::open_with(path, options)?;
    if !quiet {
        for warning in scene.warnings() {
            output::note(warning);
        }
    }
    Ok(scene)
}
