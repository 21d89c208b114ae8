//! Meshes by procedure that a scene names and that are not there yet: the scene says how they are made, in a comment
//!
//! ```text
//! # made by: wavepath mesh menger --levels 4 -o meshes/generated/menger-4.ply
//! ```
//!
//! whose file is relative to the scene's folder and below it. They are made when a scene cannot be read, if that is all
//! that it lacks.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Component, Path, PathBuf};

use clap::{Args, FromArgMatches};

use super::{Failure, output};
use crate::meshes::{self, MeshArgs};

/// What a line that says how a mesh is made begins with.
const MADE_BY: &str = "# made by: wavepath mesh ";

/// Makes the meshes of a scene that are missing, and says so unless `quiet`. Returns whether there were any.
pub(super) fn make_missing(scene: &Path, quiet: bool) -> Result<bool, Failure> {
    // Pipes are read once.
    if !scene.is_file() {
        return Ok(false);
    }
    let Ok(file) = File::open(scene) else { return Ok(false) };
    let folder = scene.parent().unwrap_or(Path::new(""));
    let mut made = false;
    for line in BufReader::new(file).split(b'\n').map_while(Result::ok) {
        let Some(command) = std::str::from_utf8(&line).ok().and_then(|line| line.strip_prefix(MADE_BY))
        else {
            continue;
        };
        let failed =
            |what: String| Failure::Input(format!("{}: \"{}\": {what}", scene.display(), command.trim()));
        let mut args = parse(command).map_err(failed)?;
        let Some(path) = args.output.as_deref().and_then(below) else {
            return Err(failed("expected -o and a file below the scene's folder".into()));
        };
        let path = folder.join(path);
        if path.exists() {
            continue;
        }
        if !quiet {
            output::note(format_args!("making {}, which {} needs", path.display(), scene.display()));
        }
        let failed = |what: String| Failure::Work(format!("cannot make {}: {what}", path.display()));
        std::fs::create_dir_all(path.parent().unwrap_or(folder))
            .map_err(|error| failed(error.to_string()))?;
        args.output = Some(path.clone());
        meshes::run(&args).map_err(|error| failed(error.to_string()))?;
        made = true;
    }
    Ok(made)
}

fn parse(command: &str) -> Result<MeshArgs, String> {
    let words = std::iter::once("mesh").chain(command.split_whitespace());
    let matches = MeshArgs::augment_args(clap::Command::new("mesh").disable_help_flag(true))
        .try_get_matches_from(words);
    let args = matches.and_then(|matches| MeshArgs::from_arg_matches(&matches));
    args.map_err(|error| error.to_string().lines().next().unwrap_or_default().to_string())
}

/// A scene makes no files elsewhere.
fn below(path: &Path) -> Option<PathBuf> {
    path.components().all(|part| matches!(part, Component::Normal(_))).then(|| path.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_scene_lacks_is_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("s.pbrt");
        let line = format!("{MADE_BY}box -o meshes/made/box.ply\r\nWorldBegin\n");
        std::fs::write(&scene, line).unwrap();
        assert!(make_missing(&scene, true).unwrap());
        let mesh = folder.path().join("meshes/made/box.ply");
        assert!(mesh.is_file());
        std::fs::write(&mesh, "other").unwrap();
        assert!(!make_missing(&scene, true).unwrap());
        assert_eq!(std::fs::read(&mesh).unwrap(), b"other");
    }

    #[test]
    fn nothing_is_made_elsewhere_or_from_nonsense() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("s.pbrt");
        for (command, expected) in [
            ("box -o ../box.ply", "below the scene's folder"),
            ("box -o /tmp/wavepath-elsewhere.ply", "below the scene's folder"),
            ("box", "below the scene's folder"),
            ("teapot -o t.ply", "teapot"),
            ("menger --levels 99 -o m.ply", "levels"),
        ] {
            std::fs::write(&scene, format!("{MADE_BY}{command}\n")).unwrap();
            let failure = make_missing(&scene, true).unwrap_err();
            assert!(failure.to_string().contains(expected), "{command}: {failure}");
        }
        assert!(!make_missing(&folder.path().join("missing.pbrt"), true).unwrap());
    }
}
