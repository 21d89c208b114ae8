//! Pictures that other programs rendered: `--external name:time:file.exr`.

use std::path::PathBuf;

use super::{Errors, External};
use crate::compare::{SizeMismatch, compare};
use crate::picture::Image;

/// A picture of another program as the command line names it.
#[derive(Debug, Clone, PartialEq)]
pub struct ExternalSpec {
    /// What it is called in tables and plots; without a colon.
    pub name: String,
    /// How long it took, in seconds; more than 0.
    pub seconds: f64,
    /// Its file.
    pub file: PathBuf,
}

/// Parses `name:time:file.exr`, for clap. The file name may have colons.
///
/// # Errors
/// A message that says what was found and what is expected.
pub fn parse(text: &str) -> Result<ExternalSpec, String> {
    const FORM: &str = "expected NAME:TIME:FILE.exr, such as pbrt:31.5s:pbrt.exr";
    let mut parts = text.splitn(3, ':');
    let (name, seconds, file) = (parts.next().unwrap_or("").trim(), parts.next(), parts.next());
    let Some(seconds) = seconds else { return Err(format!("found no \":\"; {FORM}")) };
    let Some(file) = file else { return Err(format!("found one \":\" only; {FORM}")) };
    if name.is_empty() {
        return Err(format!("found no name before the first \":\"; {FORM}"));
    }
    let time = crate::time_span::parse(seconds)
        .map_err(|reason| format!("found \"{seconds}\": {reason}; {FORM}"))?;
    let number = time.as_secs_f64();
    if file.is_empty() {
        return Err(format!("found no file name after the second \":\"; {FORM}"));
    }
    Ok(ExternalSpec { name: name.into(), seconds: number, file: file.into() })
}

impl External {
    /// Compares the picture that `spec` names with the reference.
    ///
    /// # Errors
    /// [`SizeMismatch`] if they do not show the same part of a frame.
    pub fn measure(spec: &ExternalSpec, image: &Image, reference: &Image) -> Result<Self, SizeMismatch> {
        let errors = Errors::from(&compare(image, reference)?);
        let (name, file) = (spec.name.clone(), spec.file.display().to_string());
        Ok(Self { name, file, seconds: spec.seconds, errors })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_may_have_colons() {
        let spec = parse("Mitsuba 3: 31.5 :C:/a b.exr").unwrap();
        let expected = ExternalSpec { name: "Mitsuba 3".into(), seconds: 31.5, file: "C:/a b.exr".into() };
        assert_eq!(spec, expected);
        assert_eq!(parse("a:1e2:b").unwrap().seconds, 100.0);
    }

    #[test]
    fn messages_say_what_was_found_and_what_is_expected() {
        let form = "expected NAME:TIME:FILE.exr, such as pbrt:31.5s:pbrt.exr";
        for (text, message) in [
            ("pbrt", format!("found no \":\"; {form}")),
            ("", format!("found no \":\"; {form}")),
            ("pbrt:31", format!("found one \":\" only; {form}")),
            (" :31:a.exr", format!("found no name before the first \":\"; {form}")),
            (
                "pbrt:soon:a.exr",
                format!("found \"soon\": expected a time such as 30s, 1m30s, 2h or 500ms; {form}"),
            ),
            ("pbrt::a.exr", format!("found \"\": expected a time such as 30s, 1m30s, 2h or 500ms; {form}")),
            ("pbrt:31:", format!("found no file name after the second \":\"; {form}")),
        ] {
            assert_eq!(parse(text).unwrap_err(), message, "{text}");
        }
        for (seconds, reason) in
            [("0", "more than zero"), ("-3", "more than zero"), ("inf", "such as"), ("nan", "such as")]
        {
            let message = parse(&format!("pbrt:{seconds}:a.exr")).unwrap_err();
            assert!(
                message.contains(&format!("found \"{seconds}\"")) && message.contains(reason),
                "{message}"
            );
        }
        assert_eq!(parse("pbrt:1m30s:a.exr").unwrap().seconds, 90.0);
    }

    #[test]
    fn a_picture_is_measured_against_the_reference() {
        let image = Image::new(1, 1, vec![[1.5, 1.0, 1.0]]);
        let reference = Image::new(1, 1, vec![[1.0; 3]]);
        let external = External::measure(&parse("x:2:x.exr").unwrap(), &image, &reference).unwrap();
        assert!((external.errors.relmse - 0.25 / 3.03).abs() < 1e-12);
        assert_eq!((external.seconds, external.errors.mean_ratio[0]), (2.0, 1.5));
        let small = Image::new(1, 2, vec![[1.0; 3]; 2]);
        assert!(External::measure(&parse("x:2:x.exr").unwrap(), &image, &small).is_err());
    }
}
