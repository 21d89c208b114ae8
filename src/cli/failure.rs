//! How a command fails.

use std::fmt;
use std::io;

use crate::compare::SizeMismatch;
use crate::picture::ImageError;
use crate::render::RenderError;
use crate::scene::SceneError;

/// Why a command failed, and with which exit status.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The command line asks for something that cannot be: exit status 2.
    Usage(String),
    /// A scene or another input file is wrong: exit status 2.
    Input(String),
    /// The work itself failed: exit status 1.
    Work(String),
    /// A signal ended it, and what was done is written: exit status 128 + the signal's number.
    Interrupted(i32, String),
}

impl Failure {
    /// The exit status of the process: 2 if the user's input is wrong, 128 and more if a signal ended it, else 1.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) | Self::Input(_) => 2,
            Self::Work(_) => 1,
            Self::Interrupted(signal, _) => u8::try_from(128 + signal).unwrap_or(1),
        }
    }

    /// The message as it is printed: with `error: ` in front, once. What comes from the scene reader has that already.
    pub fn to_diagnostic(&self) -> String {
        let message = self.to_string();
        if message.starts_with("error: ") || matches!(self, Self::Interrupted(..)) {
            message
        } else {
            format!("error: {message}")
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Usage(message)
        | Self::Input(message)
        | Self::Work(message)
        | Self::Interrupted(_, message)) = self;
        f.write_str(message)
    }
}

impl std::error::Error for Failure {}

impl From<ImageError> for Failure {
    fn from(error: ImageError) -> Self {
        match error {
            ImageError::UnknownFormat { .. } => Self::Usage(error.to_string()),
            ImageError::Read { .. } => Self::Input(error.to_string()),
            ImageError::Write { .. } => Self::Work(error.to_string()),
        }
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Input(error.to_string())
    }
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Choice { .. } => Self::Usage(error.to_string()),
            RenderError::Changed { .. } => Self::Usage(error.to_string()),
            RenderError::Memory { .. } | RenderError::Film(_) | RenderError::Files(_) => {
                Self::Input(error.to_string())
            }
            RenderError::Threads { .. } | RenderError::Session(_) => Self::Work(error.to_string()),
        }
    }
}

impl From<SizeMismatch> for Failure {
    fn from(error: SizeMismatch) -> Self {
        Self::Input(error.to_string())
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Work(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_input_and_failed_work_have_their_own_status() {
        assert_eq!(Failure::Usage("a".into()).exit_code(), 2);
        assert_eq!(Failure::Input("a".into()).exit_code(), 2);
        assert_eq!(Failure::Work("a".into()).exit_code(), 1);
        for message in ["no a.pbrt", "error: no a.pbrt"] {
            assert_eq!(Failure::Input(message.into()).to_diagnostic(), "error: no a.pbrt");
        }
        let unknown = ImageError::UnknownFormat { path: "a.jpg".into() };
        assert_eq!(Failure::from(unknown).exit_code(), 2);
    }
}
