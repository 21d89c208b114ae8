//! Errors and warnings: where, what was found, what was expected.
//!
//! Inside the reader a complaint is a [`Problem`]: a place in a file and words. It costs nothing to make. Only
//! when it leaves the reader is the source line fetched and a [`Diagnostic`] made, which prints like this:
//!
//! ```text
//! error: scenes/a.pbrt:12:7: unknown shape "shpere"
//!    12 | Shape "shpere" "float radius" [ 1 ]
//!       |       ^^^^^^^^ expected one of sphere, disk, trianglemesh; did you mean "sphere"?
//! ```

use std::fmt;
use unicode_width::UnicodeWidthStr;

/// Handle of a file that the reader opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileId(pub u32);

/// A range of bytes in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Which file.
    pub file: FileId,
    /// Line, from 1.
    pub line: u32,
    /// Offset of the line's first byte (after decompression).
    pub line_start: u64,
    /// Offset of the first byte.
    pub start: u64,
    /// Offset behind the last byte.
    pub end: u64,
}

/// What a [`Problem`] points at.
#[derive(Clone, Debug)]
pub(crate) enum Place {
    /// Nothing that could be shown.
    Nowhere,
    /// The scene as a whole: its main file.
    Scene,
    /// A range of a scene file.
    Span(Span),
    /// The value of this index behind the bracket (or the single value) at the span. Values have no spans of
    /// their own, because a mesh has millions: the array is read again to find the one at fault.
    Value(Span, usize),
    /// A place in another file, as it should be printed: `mesh.ply:17` or `mesh.ply, byte 1234`.
    Other(String),
}

/// A complaint that has not been rendered yet.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    pub place: Place,
    pub message: String,
    /// Stands behind the carets: what was expected.
    pub label: String,
    /// Further places that explain: where something was opened, who asked for the file.
    pub notes: Vec<(Place, String)>,
    /// Not an error: the file turned out to follow other rules (pbrt-v3) after something had been decided by the
    /// rules of pbrt-v4, and must be read again from the start.
    pub restart: bool,
    /// Not a mistake: pbrt has it and wavepath lacks it. It matters only if something uses it. Says what can be
    /// rendered instead.
    pub lacking: Option<&'static str>,
}

/// Result inside the reader. Boxed, so that the good case stays small.
pub(crate) type Result<T> = std::result::Result<T, Box<Problem>>;

impl Problem {
    pub(crate) fn new(place: Place, message: impl Into<String>) -> Box<Problem> {
        Box::new(Problem {
            place,
            message: message.into(),
            label: String::new(),
            notes: Vec::new(),
            restart: false,
            lacking: None,
        })
    }

    pub(crate) fn at(span: Span, message: impl Into<String>) -> Box<Problem> {
        Problem::new(Place::Span(span), message)
    }

    pub(crate) fn label(mut self: Box<Self>, label: impl Into<String>) -> Box<Problem> {
        self.label = label.into();
        self
    }

    /// Marks what pbrt has and wavepath lacks, with what can be rendered instead.
    pub(crate) fn lacking(mut self: Box<Self>, instead: &'static str) -> Box<Problem> {
        self.lacking = Some(instead);
        self
    }

    pub(crate) fn note(mut self: Box<Self>, place: Place, text: impl Into<String>) -> Box<Problem> {
        self.notes.push((place, text.into()));
        self
    }
}

/// How bad a [`Diagnostic`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The scene cannot be rendered.
    Error,
    /// The scene can be rendered, but something deserves a look.
    Warning,
}

/// The line at fault, cut to a window around the caret where it is very long.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Excerpt {
    /// The line's text, without its end.
    pub text: String,
    /// Characters of `text` before the carets.
    pub caret_start: usize,
    /// Number of carets, at least 1.
    pub caret_len: usize,
}

/// A place in a file, with the line's text where it could be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// File name as it was opened; for places in binary files also the byte.
    pub file: String,
    /// Line, from 1; 0 where a line has no meaning.
    pub line: u32,
    /// Column in characters, from 1; 0 where a line has no meaning.
    pub column: u32,
    /// The line.
    pub excerpt: Option<Excerpt>,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line == 0 {
            f.write_str(&self.file)
        } else {
            write!(f, "{}:{}:{}", self.file, self.line, self.column)
        }
    }
}

/// An error or a warning about a scene, with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Error or warning.
    pub severity: Severity,
    /// What was found.
    pub message: String,
    /// What was expected; may be empty.
    pub label: String,
    /// Where.
    pub location: Option<Location>,
    /// Other places that explain it.
    pub notes: Vec<(Option<Location>, String)>,
}

impl Diagnostic {
    /// Line of the place, 0 without one.
    pub fn line(&self) -> u32 {
        self.location.as_ref().map_or(0, |l| l.line)
    }

    /// Column of the place in characters, 0 without one.
    pub fn column(&self) -> u32 {
        self.location.as_ref().map_or(0, |l| l.column)
    }
}

fn write_excerpt(f: &mut fmt::Formatter<'_>, location: &Location, label: &str) -> fmt::Result {
    let Some(excerpt) = &location.excerpt else {
        return if label.is_empty() { Ok(()) } else { write!(f, "\n      = {label}") };
    };
    // In columns of the terminal: a character takes none to two. A tab stays one, however far it reaches.
    let split = |text: &str, count: usize| text.char_indices().nth(count).map_or(text.len(), |(at, _)| at);
    let (before, rest) = excerpt.text.split_at(split(&excerpt.text, excerpt.caret_start));
    let padding: String = before
        .split_inclusive('\t')
        .map(|part| match part.strip_suffix('\t') {
            Some(part) => format!("{}\t", " ".repeat(part.width())),
            None => " ".repeat(part.width()),
        })
        .collect();
    // Carets may go beyond the line, where its end is meant.
    let token = &rest[..split(rest, excerpt.caret_len)];
    let beyond = excerpt.caret_len - token.chars().count();
    let carets = "^".repeat((token.width() + beyond).max(1));
    write!(f, "\n{:5} | {}", location.line, excerpt.text)?;
    write!(f, "\n      | {padding}{carets}")?;
    if !label.is_empty() {
        write!(f, " {label}")?;
    }
    Ok(())
}

impl Diagnostic {
    /// All but the word `error` or `warning` before it.
    fn write_text(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.location {
            Some(location) => {
                write!(f, "{location}: {}", self.message)?;
                write_excerpt(f, location, &self.label)?;
            }
            None if self.label.is_empty() => f.write_str(&self.message)?,
            None => write!(f, "{} ({})", self.message, self.label)?,
        }
        for (location, text) in &self.notes {
            match location {
                Some(location) => {
                    write!(f, "\nnote: {location}: {text}")?;
                    write_excerpt(f, location, "")?;
                }
                None => write!(f, "\nnote: {text}")?,
            }
        }
        Ok(())
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.severity {
            Severity::Error => "error: ",
            Severity::Warning => "warning: ",
        })?;
        self.write_text(f)
    }
}

/// Why a scene could not be read: the first complaint, and further ones, so that all that a scene lacks is known at
/// once. Prints all of them; the first without the word `error`, which whoever prints an error puts before it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct Error {
    /// The first complaint.
    pub first: Box<Diagnostic>,
    /// Further ones.
    pub others: Vec<Diagnostic>,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.first.write_text(f)?;
        self.others.iter().try_for_each(|other| write!(f, "\n{other}"))
    }
}

impl std::ops::Deref for Error {
    type Target = Diagnostic;

    fn deref(&self) -> &Diagnostic {
        &self.first
    }
}
