//! What can be wrong with the parts of a scene.

use core::fmt;

/// Why parts do not make a scene: what is wrong, and where. Everything that kernels take for granted is checked.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BuildError {
    /// A number that is not finite, or outside of its range.
    Number {
        /// Of what: "vertex", "light", "sphere", ...
        of: &'static str,
        /// Its number among them.
        id: usize,
        /// Which number, and what is wrong with it.
        what: String,
    },
    /// Something refers to what does not exist.
    Missing {
        /// What refers.
        of: &'static str,
        /// Its number among them.
        id: usize,
        /// What it refers to.
        what: &'static str,
        /// The number that it names.
        found: usize,
        /// How many there are.
        exist: usize,
    },
    /// A primitive refers to a material that does not exist, or is of another class.
    NoMaterial {
        /// The primitive.
        primitive: usize,
        /// Name of the class that its tag says.
        class: &'static str,
        /// The row that it, or its light, refers to.
        row: u32,
    },
    /// Two tables that go together are not of one length.
    Length {
        /// The table.
        of: &'static str,
        /// Its length.
        found: usize,
        /// What it should be.
        expected: usize,
    },
    /// More of something than can be numbered.
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        found: usize,
        /// How many there may be.
        limit: usize,
    },
}

impl fmt::Display for BuildError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            BuildError::Number { of, id, what } => write!(f, "{of} {id}: {what}"),
            BuildError::Missing { of, id, what, found, exist } => {
                write!(f, "{of} {id} refers to {what} {found}, but there are {exist}")
            }
            BuildError::NoMaterial { primitive, class, row } => {
                write!(
                    f,
                    "primitive {primitive} refers to {class} in row {row} of the materials, but there is none"
                )
            }
            BuildError::Length { of, found, expected } => {
                write!(f, "{found} {of}; expected {expected}")
            }
            BuildError::TooMany { what, found, limit } => {
                write!(f, "{found} {what}; at most {limit} are supported")
            }
        }
    }
}

impl core::error::Error for BuildError {}

/// Checks that numbers are finite.
pub(crate) fn finite(of: &'static str, id: usize, what: &str, numbers: &[f32]) -> Result<(), BuildError> {
    match numbers.iter().find(|x| !x.is_finite()) {
        None => Ok(()),
        Some(x) => {
            Err(BuildError::Number { of, id, what: format!("{what} is {x}; expected a finite number") })
        }
    }
}

/// Checks that numbers are finite and not negative.
pub(crate) fn not_negative(
    of: &'static str,
    id: usize,
    what: &str,
    numbers: &[f32],
) -> Result<(), BuildError> {
    finite(of, id, what, numbers)?;
    match numbers.iter().find(|&&x| x < 0.0) {
        None => Ok(()),
        Some(x) => Err(BuildError::Number { of, id, what: format!("{what} is {x}; expected 0 or more") }),
    }
}

/// Checks that a number names something that exists.
pub(crate) fn exists(
    of: &'static str,
    id: usize,
    what: &'static str,
    found: usize,
    exist: usize,
) -> Result<(), BuildError> {
    if found < exist { Ok(()) } else { Err(BuildError::Missing { of, id, what, found, exist }) }
}
