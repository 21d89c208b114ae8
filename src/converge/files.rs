//! The folder that an experiment leaves behind.
//!
//! | file | content |
//! |---|---|
//! | `report.html` | everything for people, in one page |
//! | `converge.json` | everything for programs: what was measured, and the figures in each measure |
//! | `converge.csv` | one row for each measured point |
//! | `error.svg` | relMSE against time |
//! | `stages.svg` | time in each stage |
//! | `efficiency.svg` | efficiency |

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::html::{self, Picture, PictureError};
use super::plots::{self, Against};
use super::summary::Summary;
use super::{Experiment, Measure, csv};
use crate::atomic_file::{self, write_whole};
use crate::picture::Image;

/// The names of the files; the page comes last, when all that it links to is there.
pub const NAMES: [&str; 6] =
    ["converge.csv", "converge.json", "error.svg", "stages.svg", "efficiency.svg", "report.html"];

/// Why a folder could not be written.
#[derive(Debug, thiserror::Error)]
pub enum FilesError {
    /// The folder does not exist and cannot be made, or takes no files.
    #[error("cannot write to folder \"{}\": {reason}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is in the way.
        reason: io::Error,
    },
    /// A file cannot be written.
    #[error("cannot write \"{}\": {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is in the way.
        reason: io::Error,
    },
    /// The pictures cannot be shown.
    #[error(transparent)]
    Pictures(#[from] PictureError),
}

/// `converge.json`: the experiment with its figures.
#[derive(Serialize)]
struct Record<'a> {
    #[serde(flatten)]
    experiment: &'a Experiment,
    summaries: &'a [Summary],
}

/// Makes the folder if it is missing, and checks that all the files could be written: to be called before the work.
///
/// # Errors
/// [`FilesError::Folder`]
pub fn prepare(folder: &Path) -> Result<(), FilesError> {
    let failed = |reason| FilesError::Folder { path: folder.into(), reason };
    match fs::metadata(folder) {
        Ok(metadata) if !metadata.is_dir() => {
            return Err(failed(io::Error::other(
                "a file of this name exists; expected a folder or an unused name",
            )));
        }
        Ok(_) => {}
        Err(_) => fs::create_dir_all(folder).map_err(failed)?,
    }
    NAMES.iter().try_for_each(|name| atomic_file::check_writable(&folder.join(name)).map_err(failed))
}

/// Writes all the files into `folder`, which is made if it is missing; each appears whole or not at all.
///
/// The `pictures` belong to variants and other programs, in the order in which they are shown.
///
/// # Errors
/// [`FilesError`]; the files before the one that failed are there.
pub fn write(
    folder: &Path,
    experiment: &Experiment,
    reference: &Image,
    pictures: &[Picture],
) -> Result<(), FilesError> {
    prepare(folder)?;
    let summaries = Measure::ALL.map(|measure| Summary::of(experiment, measure));
    let first = &summaries[0];
    let page = html::write(experiment, &summaries, reference, pictures)?;
    let record = Record { experiment, summaries: &summaries };
    let mut json = serde_json::to_string_pretty(&record).expect("records of numbers and strings");
    json.push('\n');
    let contents = [
        csv::write(experiment),
        json,
        plots::error(experiment, first, Against::Seconds),
        plots::stages(experiment, first),
        plots::efficiency(experiment, first),
        page,
    ];
    for (name, content) in NAMES.iter().zip(contents) {
        let path = folder.join(name);
        write_whole(&path, |file| file.write_all(content.as_bytes()))
            .map_err(|reason| FilesError::File { path: path.clone(), reason })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;
    use crate::converge::synthetic;

    /// Writes the synthetic experiment.
    fn write_example(folder: &Path) {
        let (experiment, reference, images) = synthetic::full();
        let pictures: Vec<Picture> =
            images.iter().map(|(name, image)| Picture { name, caption: "8.00 s, seed 1", image }).collect();
        write(folder, &experiment, &reference, &pictures).unwrap();
    }

    #[test]
    fn the_folder_has_all_the_files_and_no_others() {
        let outer = TestFolder::new("converge-files");
        let folder = outer.file("deeper/results");
        write_example(&folder);
        let mut names: Vec<String> = fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        let mut expected = NAMES.map(String::from);
        expected.sort();
        assert_eq!(names, expected);
        let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
        let before = NAMES.map(read);
        let json: serde_json::Value = serde_json::from_str(&before[1]).unwrap();
        assert_eq!(json["variants"].as_array().unwrap().len(), 4);
        assert_eq!(json["machine"]["threads"], 2);
        assert_eq!(json["variants"][0]["runs"][0]["points"].as_array().unwrap().len(), 6);
        assert_eq!(json["summaries"][0]["measure"], "relmse");
        assert_eq!(json["summaries"][0]["pairs"].as_array().unwrap().len(), 6);
        assert!(json["summaries"][0]["variants"][0]["slope"]["interval"][0].is_f64());
        for name in ["error.svg", "stages.svg", "efficiency.svg"] {
            roxmltree::Document::parse(&read(name)).unwrap();
        }
        // Written again, over itself, byte for byte.
        write_example(&folder);
        assert_eq!(NAMES.map(read), before);
    }

    /// For `.ci/report-in-browser`, which names the folder; nothing to do otherwise.
    #[test]
    fn an_example_for_the_browser() {
        if let Some(folder) = std::env::var_os("WAVEPATH_EXAMPLE_REPORT") {
            write_example(Path::new(&folder));
        }
    }

    #[test]
    fn what_is_in_the_way_is_named() {
        let folder = TestFolder::new("converge-folder");
        let file = folder.file("results");
        fs::write(&file, "").unwrap();
        let message = prepare(&file).unwrap_err().to_string();
        let expected = format!(
            "cannot write to folder \"{}\": a file of this name exists; expected a folder or an unused name",
            file.display()
        );
        assert_eq!(message, expected);
        assert!(prepare(&file.join("deeper")).unwrap_err().to_string().starts_with("cannot write to folder"));
        let blocked = folder.file("blocked");
        fs::create_dir_all(blocked.join("error.svg")).unwrap();
        let message = prepare(&blocked).unwrap_err().to_string();
        assert!(message.contains("error.svg is a folder"), "{message}");
    }
}
