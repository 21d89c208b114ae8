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
}
