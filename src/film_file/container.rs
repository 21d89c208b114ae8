//! Sections of a file, each with its length and checksums: written one after another, found without reading them.
//!
//! `docs/film-files.md` has the layout. Nothing is taken on the word of a number that its checksum does not confirm, and
//! never more memory than a section of that many bytes can become.

use super::FilmFileError;
use crc32fast::Hasher;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// What every film file begins with. A program that takes it for text and changes its line ends shows itself.
const MAGIC: &[u8; 16] = b"wavepath film\r\n\x1a";

/// The version that is written, and the only one that is read.
const VERSION: u32 = 1;

/// Bytes before the first section.
const START: u64 = 20;

/// Bytes in front of the contents of a section.
const SECTION_HEAD: usize = 36;

/// What is in a section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// What the film is of.
    Head,
    /// What the picture depends on.
    Identity,
    /// Where it comes from, and what it has cost.
    About,
    /// Where a render that decides by what it sees is.
    Round,
    /// Blocks of pixels.
    Blocks,
    /// Nothing more.
    End,
}

impl Kind {
    const ALL: [Kind; 6] = [Kind::Head, Kind::Identity, Kind::About, Kind::Round, Kind::Blocks, Kind::End];

    fn name(self) -> &'static [u8; 4] {
        match self {
            Kind::Head => b"HEAD",
            Kind::Identity => b"IDEN",
            Kind::About => b"ABOU",
            Kind::Round => b"RNDS",
            Kind::Blocks => b"BLKS",
            Kind::End => b"END ",
        }
    }
}

/// Contents as they are.
const PLAIN: u32 = 0;
/// A block of LZ4.
const LZ4: u32 = 1;

/// LZ4 makes at most so many bytes of one.
const MOST_GROWTH: u64 = 255;

/// Most bytes of a section's contents.
const MOST_BYTES: u64 = 1 << 30;

/// Writes sections.
pub(super) struct SectionWriter<'a> {
    to: &'a mut dyn Write,
    number: u32,
    /// Of the heads of all sections so far.
    all: Hasher,
    stored: Vec<u8>,
}

impl<'a> SectionWriter<'a> {
    pub(super) fn new(to: &'a mut dyn Write) -> io::Result<Self> {
        to.write_all(MAGIC)?;
        to.write_all(&VERSION.to_le_bytes())?;
        Ok(SectionWriter { to, number: 0, all: Hasher::new(), stored: Vec::new() })
    }

    pub(super) fn write(&mut self, kind: Kind, contents: &[u8]) -> io::Result<()> {
        self.stored.resize(lz4_flex::block::get_maximum_output_size(contents.len()), 0);
        let compressed = lz4_flex::block::compress_into(contents, &mut self.stored).unwrap_or(usize::MAX);
        let (codec, stored) = match self.stored.get(..compressed) {
            Some(stored) if compressed < contents.len() => (LZ4, stored),
            _ => (PLAIN, contents),
        };
        let mut head = Vec::with_capacity(SECTION_HEAD);
        head.extend(kind.name());
        head.extend(self.number.to_le_bytes());
        head.extend(codec.to_le_bytes());
        head.extend((stored.len() as u64).to_le_bytes());
        head.extend((contents.len() as u64).to_le_bytes());
        head.extend(crc32fast::hash(stored).to_le_bytes());
        head.extend(crc32fast::hash(&head).to_le_bytes());
        self.all.update(&head);
        self.to.write_all(&head)?;
        self.to.write_all(stored)?;
        self.number += 1;
        Ok(())
    }

    /// The last section: how many there are, and the checksum of all their heads.
    pub(super) fn end(mut self) -> io::Result<()> {
        let mut contents = self.number.to_le_bytes().to_vec();
        contents.extend(self.all.clone().finalize().to_le_bytes());
        self.write(Kind::End, &contents)
    }
}

/// A section, as its head has it.
#[derive(Clone, Copy, Debug)]
struct Section {
    kind: Kind,
    codec: u32,
    /// Of its contents, in the file.
    at: u64,
    stored: u64,
    bytes: u64,
    checksum: u32,
}

/// Reads sections.
pub(super) struct SectionReader {
    path: PathBuf,
    file: BufReader<File>,
    sections: Vec<Section>,
}

impl SectionReader {
    /// Opens a file, goes through the heads of all its sections and checks that it has its end.
    pub(super) fn open(path: &Path) -> Result<Self, FilmFileError> {
        let name = path.display().to_string();
        let failed = |error: io::Error| FilmFileError::Read { file: name.clone(), reason: error.to_string() };
        let wrong = |at: u64, what: String| FilmFileError::Format { file: name.clone(), at, what };
        let file = File::open(path).map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        if !metadata.is_file() {
            return Err(failed(io::Error::other("is no file that can be read twice")));
        }
        let length = metadata.len();
        let mut file = BufReader::new(file);
        let mut start = [0; START as usize];
        let found = read_up_to(&mut file, &mut start).map_err(failed)?;
        if found < MAGIC.len() || start[..MAGIC.len()] != *MAGIC {
            return Err(wrong(0, "it does not begin like a film file".into()));
        }
        if found < start.len() {
            return Err(wrong(length, "it ends in its first bytes".into()));
        }
        let version = u32::from_le_bytes(array(&start[16..]));
        if version != VERSION {
            let newer = if version > VERSION { ", written by a newer program" } else { "" };
            let what = format!("version {version}{newer}; this program reads version {VERSION}");
            return Err(wrong(16, what));
        }
        let (mut sections, mut at, mut all) = (Vec::<Section>::new(), START, Hasher::new());
        loop {
            let mut head = [0; SECTION_HEAD];
            if read_up_to(&mut file, &mut head).map_err(failed)? < SECTION_HEAD {
                return Err(wrong(at, format!("it ends early, after {} sections", sections.len())));
            }
            let checked = &head[..SECTION_HEAD - 4];
            if crc32fast::hash(checked) != u32::from_le_bytes(array(&head[SECTION_HEAD - 4..])) {
                return Err(wrong(
                    at,
                    "the head of a section is damaged: its checksum is another one".into(),
                ));
            }
            let u32_at = |at: usize| u32::from_le_bytes(array(&head[at..]));
            let u64_at = |at: usize| u64::from_le_bytes(array(&head[at..]));
            let Some(kind) = Kind::ALL.into_iter().find(|kind| kind.name()[..] == head[..4]) else {
                return Err(wrong(at, "a section of no kind that this program knows".into()));
            };
            let (number, codec, stored, bytes) = (u32_at(4), u32_at(8), u64_at(12), u64_at(20));
            if number as usize != sections.len() {
                return Err(wrong(at, format!("section {number} where {} should be", sections.len())));
            }
            let possible = match codec {
                PLAIN => bytes == stored,
                LZ4 => bytes <= stored.saturating_mul(MOST_GROWTH),
                _ => return Err(wrong(at, format!("compression {codec}, which this program does not know"))),
            };
            if !possible || bytes > MOST_BYTES {
                return Err(wrong(at, format!("a section whose {stored} bytes are to become {bytes}")));
            }
            let contents = at + SECTION_HEAD as u64;
            let Some(end) = contents.checked_add(stored).filter(|end| *end <= length) else {
                return Err(wrong(at, "it ends early, in a section".into()));
            };
            sections.push(Section { kind, codec, at: contents, stored, bytes, checksum: u32_at(28) });
            if kind == Kind::End {
                if end != length {
                    return Err(wrong(end, "it goes on behind its end".into()));
                }
                break;
            }
            all.update(&head);
            file.seek_relative(stored as i64).map_err(failed)?;
            at = end;
        }
        let mut reader = SectionReader { path: path.to_path_buf(), file, sections };
        let end = reader.read(reader.sections.len() - 1)?;
        let count = reader.sections.len() as u32 - 1;
        let mut expected = count.to_le_bytes().to_vec();
        expected.extend(all.finalize().to_le_bytes());
        if end != expected {
            return Err(
                reader.wrong(reader.sections.len() - 1, "the sections are not those that were written")
            );
        }
        Ok(reader)
    }

    /// The kinds of the sections, in their order.
    pub(super) fn kinds(&self) -> impl Iterator<Item = (usize, Kind)> {
        self.sections.iter().map(|section| section.kind).enumerate()
    }

    /// Bytes of all sections of a kind, uncompressed.
    pub(super) fn bytes_of(&self, kind: Kind) -> u64 {
        self.sections.iter().filter(|section| section.kind == kind).map(|section| section.bytes).sum()
    }

    /// The contents of a section, by its number.
    pub(super) fn read(&mut self, number: usize) -> Result<Vec<u8>, FilmFileError> {
        let Section { codec, at, stored, bytes, checksum, .. } = self.sections[number];
        let file = self.path.display().to_string();
        let failed = |error: io::Error| FilmFileError::Read { file: file.clone(), reason: error.to_string() };
        self.file.seek(SeekFrom::Start(at)).map_err(failed)?;
        let mut contents = Vec::new();
        (&mut self.file).take(stored).read_to_end(&mut contents).map_err(failed)?;
        if contents.len() as u64 != stored || crc32fast::hash(&contents) != checksum {
            return Err(self.wrong(number, "a section is damaged: its checksum is another one"));
        }
        if codec == PLAIN {
            return Ok(contents);
        }
        match lz4_flex::block::decompress(&contents, bytes as usize) {
            Ok(contents) if contents.len() as u64 == bytes => Ok(contents),
            _ => Err(self.wrong(number, "a section cannot be decompressed")),
        }
    }

    /// The only section of a kind.
    pub(super) fn read_one(&mut self, kind: Kind) -> Result<Option<Vec<u8>>, FilmFileError> {
        let mut of_kind = self.kinds().filter(|(_, other)| *other == kind).map(|(number, _)| number);
        let (first, second) = (of_kind.next(), of_kind.next());
        drop(of_kind);
        if let Some(second) = second {
            return Err(self.wrong(second, "a section that may be there only once"));
        }
        first.map(|number| self.read(number)).transpose()
    }

    /// Something is wrong in a section.
    pub(super) fn wrong(&self, number: usize, what: impl Into<String>) -> FilmFileError {
        let at = self.sections.get(number).map_or(START, |section| section.at);
        FilmFileError::Format { file: self.path.display().to_string(), at, what: what.into() }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
    core::array::from_fn(|k| bytes[k])
}

/// How many bytes there were, if not all.
fn read_up_to(from: &mut impl Read, to: &mut [u8]) -> io::Result<usize> {
    let mut count = 0;
    while count < to.len() {
        match from.read(&mut to[count..]) {
            Ok(0) => break,
            Ok(more) => count += more,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(count)
}
