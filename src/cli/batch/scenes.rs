//! A queue from scenes, folders and patterns.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use super::super::Failure;
use super::names::{self, Fields};
use super::queue::{check, stem};
use super::{Job, sweep};

/// A job for each scene: a file as it is, all scenes of a folder, all files that fit a pattern.
pub(super) fn jobs(paths: &[PathBuf], output: Option<&str>, options: &[String]) -> Result<Vec<Job>, Failure> {
    let mut scenes: Vec<PathBuf> = Vec::new();
    for path in paths {
        let found = expand(path)?;
        if found.is_empty() {
            return Err(Failure::Usage(format!("\"{}\": no scenes there (.pbrt, .pbrt.gz)", path.display())));
        }
        scenes.extend(found.into_iter().filter(|scene| !paths.contains(scene)));
        if path.is_file() {
            scenes.push(path.clone());
        }
    }
    let mut known = std::collections::HashSet::new();
    scenes.retain(|scene| known.insert(scene.clone()));
    if scenes.len() > sweep::MOST_JOBS {
        return Err(Failure::Usage(format!(
            "{} scenes: expected at most {}",
            scenes.len(),
            sweep::MOST_JOBS
        )));
    }
    let mut jobs: Vec<Job> = Vec::new();
    for (index, scene) in scenes.iter().enumerate() {
        let text = scene
            .to_str()
            .ok_or_else(|| Failure::Usage(format!("\"{}\": the name is not UTF-8", scene.display())))?;
        let stem = stem(text);
        let values = [("scene".to_string(), stem.clone())];
        let fields = Fields { frame: index as u64 + 1, values: &values };
        let path = names::fill(output.unwrap_or("{scene}.exr"), &fields).map_err(Failure::Usage)?;
        let folder = scene.parent().unwrap_or(Path::new("")).display().to_string();
        let is_double =
            scenes.iter().filter(|other| self::stem(&other.to_string_lossy()) == stem).count() > 1;
        let name = if is_double && !folder.is_empty() { format!("{folder}/{stem}") } else { stem };
        let arguments = ["render".to_string(), text.to_string()].into_iter().chain(options.iter().cloned());
        let job = Job {
            name: names::file_name(&name),
            arguments: arguments.collect(),
            outputs: vec![path.into()],
            swept: Vec::new(),
        };
        if let Some(other) = jobs.iter().find(|other| other.outputs == job.outputs || other.name == job.name)
        {
            return Err(Failure::Usage(format!(
                "\"{}\" and \"{}\" both write \"{}\": expected -o with a pattern that tells them apart, such as \
                 {{scene}} or ####",
                other.arguments[1],
                text,
                job.outputs[0].display()
            )));
        }
        check(&job).map_err(Failure::Usage)?;
        jobs.push(job);
    }
    Ok(jobs)
}

fn expand(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let cannot =
        |error: &dyn std::fmt::Display| Failure::Input(format!("cannot read {}: {error}", path.display()));
    if path.is_dir() {
        let mut scenes = Vec::new();
        for entry in path.read_dir().map_err(|error| cannot(&error))? {
            let file = entry.map_err(|error| cannot(&error))?.path();
            let name = file.to_string_lossy().to_lowercase();
            if file.is_file() && (name.ends_with(".pbrt") || name.ends_with(".pbrt.gz")) && is_whole(&file) {
                scenes.push(file);
            }
        }
        scenes.sort();
        return Ok(scenes);
    }
    if path.is_file() {
        return Ok(vec![path.to_path_buf()]);
    }
    let pattern = path.to_str().filter(|text| text.contains(['*', '?', '[']));
    let Some(pattern) = pattern else { return Err(cannot(&"no such file or folder")) };
    let found = glob::glob(pattern).map_err(|error| Failure::Usage(format!("\"{pattern}\": {error}")))?;
    Ok(found.filter_map(Result::ok).filter(|path| path.is_file()).collect())
}

/// Whether a file is a scene and not a part of one, which others include.
fn is_whole(path: &Path) -> bool {
    let Ok(file) = File::open(path) else { return false };
    // What is compressed is not looked into.
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz")) {
        return true;
    }
    let mut lines = BufReader::new(file).split(b'\n');
    let begins = |line: &[u8]| {
        let line = line.trim_ascii_start();
        line.starts_with(b"WorldBegin") || line.windows(11).any(|window| window == b" WorldBegin")
    };
    lines.any(|line| line.is_ok_and(|line| begins(&line)))
}
