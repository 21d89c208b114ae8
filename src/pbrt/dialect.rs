//! Whether a file follows pbrt-v3 or pbrt-v4.
//!
//! The formats carry no version, and some signs come late (`WorldEnd` is at the very end). So a file is taken for
//! v4 until a sign of v3 turns up. If by then something was decided that v3 decides otherwise, the file is read
//! once more, as v3 from the start.

use super::error::{Problem, Result, Span};

/// What is known about the version.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Version {
    #[default]
    Unknown,
    V3,
    V4,
}

/// The version, and what was decided before it was known.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Dialect {
    version: Version,
    decided_as_v4: bool,
}

impl Dialect {
    /// Known to be v3 from the start.
    pub(crate) fn v3() -> Dialect {
        Dialect { version: Version::V3, decided_as_v4: false }
    }

    /// Whether the rules of v3 hold. Call it only where the versions differ: the answer may have to be revised.
    pub(crate) fn is_v3(&mut self) -> bool {
        self.decided_as_v4 |= self.version == Version::Unknown;
        self.version == Version::V3
    }

    /// Whether v3 is settled. Other than [`Dialect::is_v3`], asking decides nothing.
    pub(crate) fn is_surely_v3(&self) -> bool {
        self.version == Version::V3
    }

    /// Whether a sign of v4 was seen, so that no revision can come.
    pub(crate) fn is_surely_v4(&self) -> bool {
        self.version == Version::V4
    }

    /// Something was found that only v4 has, early enough to settle it.
    pub(crate) fn saw_v4(&mut self) {
        if self.version == Version::Unknown {
            self.version = Version::V4;
        }
    }

    /// Something was found that only v3 has. In a file known to be v4 it is tolerated and settles nothing.
    pub(crate) fn saw_v3(&mut self, span: Span) -> Result<()> {
        if self.version != Version::Unknown {
            return Ok(());
        }
        self.version = Version::V3;
        if !self.decided_as_v4 {
            return Ok(());
        }
        let mut problem = Problem::at(span, "pbrt-v3 syntax after pbrt-v4 was taken for granted");
        problem.restart = true;
        Err(problem)
    }
}
