//! Output files of the subcommands: checked before the work, written after it.

use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

use super::Failure;
use crate::atomic_file;
use crate::picture;
use crate::report::Report;

/// Prints a line on standard output. A reader that has seen enough (`wavepath plan ... | head`) is no failure.
///
/// # Errors
/// [`Failure::Work`] if it cannot be written for another reason.
pub fn say(text: impl Display) -> Result<(), Failure> {
    match writeln!(io::stdout(), "{text}") {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::Work(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints a line on standard error. What cannot be told (a full disk, a closed pipe) must not cost the work.
pub fn note(text: impl Display) {
    // In one piece, so that lines of several processes do not mix.
    let _ = io::stderr().lock().write_all(format!("{text}\n").as_bytes());
}

/// Where a command speaks: on standard output, unless a file goes there; then on standard error.
#[derive(Debug, Clone, Copy)]
pub struct Voice {
    quiet: bool,
    taken: bool,
}

impl Voice {
    /// For a command that writes `outputs`.
    pub fn new(quiet: bool, outputs: &[&Path]) -> Self {
        Voice { quiet, taken: outputs.iter().any(|path| atomic_file::is_standard_output(path)) }
    }

    /// Prints a line, unless it is to be quiet.
    ///
    /// # Errors
    /// As [`say`].
    pub fn tell(&self, text: impl Display) -> Result<(), Failure> {
        if self.quiet {
            return Ok(());
        }
        if self.taken {
            note(text);
            return Ok(());
        }
        say(text)
    }

    /// Says that a file was written.
    ///
    /// # Errors
    /// As [`say`].
    pub fn wrote(&self, path: &Path) -> Result<(), Failure> {
        let is_file = !atomic_file::is_standard_output(path);
        if is_file { self.tell(format_args!("wrote {}", path.display())) } else { Ok(()) }
    }
}

/// Checks that images can be written to all `paths`, which `option` names.
///
/// # Errors
/// [`Failure::Usage`], as [`check_image`].
pub fn check_images(paths: &[&Path], option: &str) -> Result<(), Failure> {
    paths.iter().try_for_each(|path| check_image(path)).map_err(|failure| match failure {
        Failure::Usage(message) => Failure::Usage(format!("{option}: {message}")),
        other => other,
    })
}

/// Checks that no two of the outputs (option and file) are the same file, through links, too, and none of them is one
/// of the `inputs`.
///
/// # Errors
/// [`Failure::Usage`].
pub fn check_distinct(outputs: &[(&str, &Path)], inputs: &[impl AsRef<Path>]) -> Result<(), Failure> {
    for (index, (option, path)) in outputs.iter().enumerate() {
        for (other, earlier) in &outputs[..index] {
            if atomic_file::is_same_file(path, earlier) {
                let both = if atomic_file::is_standard_output(path) {
                    "standard output".to_string()
                } else {
                    format!("the same file, \"{}\"", path.display())
                };
                return Err(Failure::Usage(format!(
                    "{other} and {option} are both {both}: expected a file for each"
                )));
            }
        }
        if inputs.iter().any(|input| atomic_file::is_same_file(path, input.as_ref())) {
            return Err(Failure::Usage(format!(
                "{option} \"{}\" is an input of this command: expected another file",
                path.display()
            )));
        }
    }
    Ok(())
}

/// Checks that none of the outputs exists, if that is asked for.
///
/// # Errors
/// [`Failure::Usage`].
pub fn check_clobber(outputs: &[(&str, &Path)], no_clobber: bool) -> Result<(), Failure> {
    match outputs.iter().find(|(_, path)| no_clobber && atomic_file::is_taken(path)) {
        Some((option, path)) => Err(Failure::Usage(format!(
            "--no-clobber: {option} \"{}\" exists; expected an unused name",
            path.display()
        ))),
        None => Ok(()),
    }
}

/// Checks that a picture under a name that nobody typed replaces nothing but an earlier picture of the same scene.
///
/// # Errors
/// [`Failure::Usage`].
pub fn check_default_name(path: &Path, scene: &Path) -> Result<(), Failure> {
    if !atomic_file::is_taken(path) {
        return Ok(());
    }
    let refuse = |why: &str| {
        let name = path.display();
        Err(Failure::Usage(format!(
            "\"{name}\", the default of -o, exists and {why}: expected -o {name} to replace it, or another name"
        )))
    };
    let metadata = picture::read_metadata(path).unwrap_or_default();
    let report = metadata.report.and_then(|report| serde_json::from_str::<Report>(&report).ok());
    match report {
        None => refuse("was not rendered by wavepath"),
        Some(report) if !is_same_scene(Path::new(&report.scene), scene) => {
            refuse(&format!("shows another scene, \"{}\"", report.scene))
        }
        Some(_) => Ok(()),
    }
}

/// Whether a scene named in a report, perhaps from another folder, is this one.
fn is_same_scene(recorded: &Path, scene: &Path) -> bool {
    if recorded == scene {
        return true;
    }
    match (std::fs::canonicalize(recorded), std::fs::canonicalize(scene)) {
        (Ok(a), Ok(b)) => a == b,
        // The recorded name means nothing here.
        (Err(_), _) => recorded.file_name() == scene.file_name(),
        (Ok(_), Err(_)) => false,
    }
}

/// Checks that an image can be written to `path`, whose ending must name a format.
///
/// # Errors
/// [`Failure::Usage`]: nothing has been done yet, so the command line is what has to change.
pub fn check_image(path: &Path) -> Result<(), Failure> {
    picture::check_writable(path).map_err(|error| Failure::Usage(error.to_string()))
}

/// Checks that a report can be written to `path`.
///
/// # Errors
/// [`Failure::Usage`], as [`check_image`].
pub fn check_report(path: &Path) -> Result<(), Failure> {
    atomic_file::check_writable(path)
        .map_err(|error| Failure::Usage(format!("cannot write report \"{}\": {error}", path.display())))
}

/// Checks that a file of another kind, `what`, can be written to `path`.
///
/// # Errors
/// [`Failure::Usage`], as [`check_image`].
pub fn check_file(path: &Path, what: &str) -> Result<(), Failure> {
    atomic_file::check_writable(path)
        .map_err(|error| Failure::Usage(format!("cannot write {what} \"{}\": {error}", path.display())))
}

/// Checks that a film can be written to `path`.
///
/// # Errors
/// [`Failure::Usage`], as [`check_image`].
pub fn check_film(path: &Path) -> Result<(), Failure> {
    atomic_file::check_durable(path)
        .map_err(|error| Failure::Usage(format!("cannot write film \"{}\": {error}", path.display())))
}

/// Writes `report` as JSON to `path`.
///
/// # Errors
/// [`Failure::Work`], which names the file.
pub fn write_report(path: &Path, report: &Report) -> Result<(), Failure> {
    report
        .write(path)
        .map_err(|error| Failure::Work(format!("cannot write report \"{}\": {error}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;

    #[test]
    fn what_cannot_be_written_is_a_wrong_command_line() {
        let folder = TestFolder::new("cli-output");
        check_image(&folder.file("a.exr")).unwrap();
        check_report(&folder.file("a.json")).unwrap();
        for failure in [
            check_image(&folder.file("a.tif")).unwrap_err(),
            check_image(&folder.file("none/a.exr")).unwrap_err(),
            check_report(&folder.file("none/a.json")).unwrap_err(),
        ] {
            assert!(matches!(failure, Failure::Usage(_)), "{failure}");
        }
        assert!(folder.names().is_empty());
    }

    #[test]
    fn the_same_file_twice_is_refused() {
        let folder = TestFolder::new("cli-same");
        let (a, b) = (folder.file("a.exr"), folder.file("b.json"));
        let none: [&Path; 0] = [];
        check_distinct(&[("-o", &a), ("--report", &b)], &none).unwrap();
        let dash = Path::new("-");
        for (outputs, inputs) in [
            (vec![("-o", a.as_path()), ("--report", a.as_path())], vec![]),
            (vec![("-o", dash), ("--report", dash)], vec![]),
            (vec![("-o", a.as_path())], vec![a.as_path()]),
        ] {
            let failure = check_distinct(&outputs, &inputs).unwrap_err();
            assert!(matches!(&failure, Failure::Usage(message) if message.contains("-o")), "{failure}");
        }
        std::fs::write(&a, "x").unwrap();
        assert!(check_clobber(&[("-o", &a)], true).is_err());
        check_clobber(&[("-o", &a)], false).unwrap();
        check_clobber(&[("-o", &b), ("-o", dash)], true).unwrap();
        let failure = check_default_name(&a, Path::new("a.pbrt")).unwrap_err();
        assert!(failure.to_string().contains("not rendered by wavepath"), "{failure}");
    }
}
