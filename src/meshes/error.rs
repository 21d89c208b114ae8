//! What can be wrong with a request for a mesh, and the checks that find it.

use super::MAX_TRIANGLES;
use glam::DVec3;
use std::path::PathBuf;

/// Why a mesh was not made or not written.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// An option has a value out of its range.
    #[error("--{option}: found {found}, expected {expected}")]
    Option {
        /// Long name of the option, without the dashes.
        option: &'static str,
        /// The value as given.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// The file could not be written. Nothing is left under its name.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file that was asked for.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl MeshError {
    /// True where the command line is at fault (exit status 2), false where the work failed (exit status 1).
    pub fn is_usage(&self) -> bool {
        matches!(self, MeshError::Option { .. })
    }
}

/// An error that names `option`.
pub(super) fn bad(option: &'static str, found: impl ToString, expected: impl ToString) -> MeshError {
    MeshError::Option { option, found: found.to_string(), expected: expected.to_string() }
}

/// Checks that a count lies in `min..=max`.
pub(super) fn check_count(option: &'static str, value: u32, min: u32, max: u32) -> Result<(), MeshError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(bad(option, value, format!("a whole number from {min} to {max}")))
}

/// Checks that a number lies in `[min, max]` (which no NaN does).
pub(super) fn check_range(option: &'static str, value: f64, min: f64, max: f64) -> Result<(), MeshError> {
    if value >= min && value <= max {
        return Ok(());
    }
    Err(bad(option, value, format!("a number from {min} to {max}")))
}

/// Checks the number of triangles, before any of them is made. `option` is the one that drives it.
pub(super) fn check_triangles(option: &'static str, value: u32, triangles: u128) -> Result<(), MeshError> {
    if triangles <= u128::from(MAX_TRIANGLES) {
        return Ok(());
    }
    Err(bad(
        option,
        format!("{value}, which makes {triangles} triangles"),
        format!("at most {MAX_TRIANGLES} triangles"),
    ))
}

/// Three numbers of one option, each in `[min, max]`.
pub(super) fn three(option: &'static str, values: &[f64], min: f64, max: f64) -> Result<DVec3, MeshError> {
    match *values {
        [x, y, z] if [x, y, z].iter().all(|v| (min..=max).contains(v)) => Ok(DVec3::new(x, y, z)),
        _ => Err(bad(option, format!("{values:?}"), format!("three numbers from {min} to {max}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_says_what_was_found_and_what_is_expected() {
        let error = check_count("sides", 0, 3, 1000).unwrap_err();
        assert_eq!(error.to_string(), "--sides: found 0, expected a whole number from 3 to 1000");
        assert!(error.is_usage());
        assert!(check_range("radius", f64::NAN, 0.0, 1.0).is_err());
        assert!(check_range("radius", f64::INFINITY, 0.0, 1e30).is_err());
        assert!(check_triangles("segments", 7, u128::MAX).is_err());
    }
}
