//! The files of a scene: opening them, and showing a line of them when something is wrong.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::read::MultiGzDecoder;

use super::error::{Diagnostic, Error, Excerpt, FileId, Location, Place, Problem, Severity, Span};
use super::foreign;
use super::lexer::Lexer;

/// Longest part of a line that an excerpt shows on each side of the caret, in bytes.
const EXCERPT_WINDOW: u64 = 100;

/// Longest row of carets.
const MAX_CARETS: usize = 60;

enum Origin {
    File(PathBuf),
    Text(Arc<[u8]>),
}

struct Source {
    /// As printed.
    name: String,
    origin: Origin,
}

/// All scene files that were opened, by [`FileId`].
#[derive(Default)]
pub(crate) struct Sources {
    sources: Vec<Source>,
    /// Every file that was read, scene files and others.
    pub inputs: Vec<PathBuf>,
}

/// Opens a file for reading, decompressing it if its name ends in `.gz`.
///
/// Only regular files: opening a pipe would wait for a writer that may never come.
pub(crate) fn open_maybe_gzipped(path: &Path) -> io::Result<Box<dyn Read>> {
    let file = open_regular(path)?;
    if is_gzipped(path) {
        Ok(Box::new(MultiGzDecoder::new(io::BufReader::new(file))))
    } else {
        Ok(Box::new(file))
    }
}

fn open_regular(path: &Path) -> io::Result<File> {
    if !path.metadata()?.is_file() {
        return Err(io::Error::other("is not a regular file"));
    }
    File::open(path)
}

fn is_gzipped(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz"))
}

/// The bytes of a pipe or device, which can be read once only; `None` for a regular file or directory.
pub(crate) fn read_special(path: &Path) -> io::Result<Option<Vec<u8>>> {
    const MOST: u64 = 1 << 30;
    let kind = path.metadata()?.file_type();
    if kind.is_file() || kind.is_dir() {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(MOST + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST {
        return Err(io::Error::other("is a pipe with more than 1 GiB"));
    }
    Ok(Some(bytes))
}

impl Sources {
    /// Registers a file and opens it.
    pub(crate) fn open(&mut self, path: &Path) -> io::Result<Lexer> {
        let reader = open_maybe_gzipped(path)?;
        self.inputs.push(path.to_path_buf());
        let id = self.add(path.display().to_string(), Origin::File(path.to_path_buf()));
        Ok(Lexer::new(id, reader))
    }

    /// Registers a text that is in memory.
    pub(crate) fn open_text(&mut self, name: &str, text: &[u8]) -> Lexer {
        let text: Arc<[u8]> = text.into();
        let id = self.add(name.to_string(), Origin::Text(text.clone()));
        Lexer::new(id, Box::new(Cursor::new(text)))
    }

    /// Registers a text that is not to be read as a scene, for messages.
    pub(crate) fn add_text(&mut self, name: &str, text: &str) -> FileId {
        self.add(name.to_string(), Origin::Text(text.as_bytes().into()))
    }

    fn add(&mut self, name: String, origin: Origin) -> FileId {
        self.sources.push(Source { name, origin });
        FileId(self.sources.len() as u32 - 1)
    }

    fn reopen(&self, file: FileId, offset: u64) -> io::Result<Box<dyn Read>> {
        let mut reader: Box<dyn Read> = match &self.sources[file.0 as usize].origin {
            Origin::File(path) if !is_gzipped(path) => {
                let mut file = open_regular(path)?;
                file.seek(io::SeekFrom::Start(offset))?;
                return Ok(Box::new(file));
            }
            Origin::File(path) => open_maybe_gzipped(path)?,
            Origin::Text(text) => Box::new(Cursor::new(text.clone())),
        };
        io::copy(&mut reader.by_ref().take(offset), &mut io::sink())?;
        Ok(reader)
    }

    fn read_range(&self, file: FileId, start: u64, end: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.reopen(file, start)?.take(end - start).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Span of one value of an array, by reading the array again; the array's own if that fails.
    pub(crate) fn value_span(&self, array: Span, index: usize) -> Span {
        let Ok(reader) = self.reopen(array.file, array.start) else {
            return array;
        };
        Lexer::resume(array, reader).nth_value(index).unwrap_or(array)
    }

    /// A complaint about a file that is no pbrt scene but something known.
    pub(crate) fn foreign(&self, file: FileId) -> Option<Box<Problem>> {
        let beginning = self.read_range(file, 0, foreign::BEGINNING).ok()?;
        foreign::explain(&self.sources[file.0 as usize].name, &beginning)
    }

    /// Names of the scene files, in the order of their handles.
    pub(crate) fn names(&self) -> Vec<String> {
        self.sources.iter().map(|source| source.name.clone()).collect()
    }

    fn locate(&self, span: Span) -> Location {
        let name = self.sources[span.file.0 as usize].name.clone();
        let from = span.line_start.max(span.start.saturating_sub(EXCERPT_WINDOW));
        let to = span.start + EXCERPT_WINDOW + 1;
        let excerpt = self.read_range(span.file, from, to).ok().map(|bytes| excerpt_of(&bytes, from, span));
        // Columns count characters; a line too long to be looked at as a whole is taken to be ASCII before the window.
        let column = match &excerpt {
            Some(excerpt) => (from - span.line_start) as usize + excerpt.caret_start + 1,
            None => (span.start - span.line_start) as usize + 1,
        };
        let excerpt = excerpt.map(|e| if from > span.line_start { with_ellipsis(e) } else { e });
        Location { file: name, line: span.line, column: column as u32, excerpt }
    }

    fn location(&self, place: &Place) -> Option<Location> {
        match place {
            Place::Nowhere => None,
            Place::Scene => self.sources.first().map(|source| Location {
                file: source.name.clone(),
                line: 0,
                column: 0,
                excerpt: None,
            }),
            Place::Span(span) => Some(self.locate(*span)),
            Place::Value(span, index) => Some(self.locate(self.value_span(*span, *index))),
            Place::Other(file) => Some(Location { file: file.clone(), line: 0, column: 0, excerpt: None }),
        }
    }

    /// Adds the source lines to a complaint.
    pub(crate) fn render(&self, problem: &Problem, severity: Severity) -> Diagnostic {
        Diagnostic {
            severity,
            message: problem.message.clone(),
            label: problem.label.clone(),
            location: self.location(&problem.place),
            notes: problem.notes.iter().map(|(place, text)| (self.location(place), text.clone())).collect(),
        }
    }

    /// Adds the source lines to errors, of which there is one at least. What has no place of its own concerns the
    /// scene as a whole, which is the first file.
    pub(crate) fn error(&self, problems: &[Problem]) -> Error {
        let mut diagnostics = problems.iter().map(|problem| self.render(problem, Severity::Error));
        Error {
            first: Box::new(diagnostics.next().expect("there is a complaint")),
            others: diagnostics.collect(),
        }
    }
}

/// Cuts the line of `span` out of `bytes`, which begin at offset `from` of the file.
fn excerpt_of(bytes: &[u8], from: u64, span: Span) -> Excerpt {
    let caret = ((span.start - from) as usize).min(bytes.len());
    let line_end =
        bytes[caret..].iter().position(|&b| b == b'\n' || b == b'\r').map_or(bytes.len(), |i| caret + i);
    let token_end = (caret + (span.end - span.start) as usize).min(line_end);
    let before = printable(&bytes[..caret]);
    let token = printable(&bytes[caret..token_end]);
    let after = printable(&bytes[token_end..line_end]);
    let caret_len = token.chars().count().clamp(1, MAX_CARETS);
    Excerpt { caret_start: before.chars().count(), caret_len, text: format!("{before}{token}{after}") }
}

fn with_ellipsis(mut excerpt: Excerpt) -> Excerpt {
    excerpt.text.insert_str(0, "...");
    excerpt.caret_start += 3;
    excerpt
}

/// Text that is safe to print: no control characters, no broken UTF-8.
fn printable(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes)
        .chars()
        .map(|c| if c.is_control() && c != '\t' { '\u{fffd}' } else { c })
        .collect()
}
