//! Films as files: checkpoints, parts of renders, and what was merged from them.
//!
//! A [`FilmFile`] is a film and what has to be known to go on with it or to add it to others: what the picture depends on
//! ([`Identity`]), where it comes from and what it has cost ([`About`]), and where a render that decides by what it sees
//! stands ([`Round`]). `docs/film-files.md` has the layout of the bytes.
//!
//! ```
//! # let folder = std::env::temp_dir().join(format!("wavepath-doc-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let (half, other) = (folder.join("half.film"), folder.join("other.film"));
//! use wavepath::film_file::FilmFile;
//! let scene = wavepath::Scene::parse(
//!     r#"Camera "perspective" "float fov" 40
//!        Film "rgb" "integer xresolution" 8 "integer yresolution" 8
//!        WorldBegin
//!        LightSource "infinite" "rgb L" [ 0.5 0.5 0.5 ]"#,
//! )?;
//! // Two parts, and a film file for each.
//! wavepath::Render::new(&scene).samples(0..8).run()?.save_film(&scene, &half)?;
//! wavepath::Render::new(&scene).samples(8..16).run()?.save_film(&scene, &other)?;
//! // They are the whole, to the bit.
//! let whole = FilmFile::merge(&[&half, &other])?.into_picture();
//! assert_eq!(whole.image().pixels, wavepath::Render::new(&scene).spp(16).run()?.image().pixels);
//! // Or one of them is gone on with.
//! let picture = wavepath::Render::new(&scene).spp(16).resume(FilmFile::read(&half)?).run()?;
//! assert_eq!(picture.image().pixels, whole.image().pixels);
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod checkpoint;
mod container;
mod gaps;
mod identity;

pub use checkpoint::{Checkpoint, DEFAULT_INTERVAL};
pub(crate) use checkpoint::{Checkpoints, Progress};
pub use gaps::{Gap, Holding};
pub(crate) use identity::Contents;
pub use identity::Identity;

use crate::atomic_file;
use crate::engine::session::Round;
use crate::film::{Film, FilmError, Head, Header};
use crate::memory;
use crate::report::Report;
use container::{Kind, SectionReader, SectionWriter};
use serde::{Deserialize, Serialize};
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Blocks are put together up to so many bytes, so that neither side ever holds much of them.
const GROUP_BYTES: usize = 1 << 20;

/// What cannot be done with a film file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FilmFileError {
    /// The system does not give its bytes.
    #[error("cannot read \"{file}\": {reason}")]
    Read {
        /// Its name.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// It is no film file, or a damaged one.
    #[error("\"{file}\": no film file, or a damaged one: {what} (byte {at})")]
    Format {
        /// Its name.
        file: String,
        /// Where it shows.
        at: u64,
        /// What is wrong.
        what: String,
    },
    /// It does not fit into the memory that is free.
    #[error("\"{file}\": its film needs {}; {} of memory are free for it", memory::in_gib(*needed), memory::in_gib(*free))]
    Memory {
        /// Its name.
        file: String,
        /// Bytes.
        needed: u64,
        /// Bytes.
        free: u64,
    },
    /// Films that cannot be added.
    #[error("\"{file}\" and \"{other}\" do not belong together: {what}")]
    Mismatch {
        /// Name of the first.
        file: String,
        /// Name of the one that does not belong to it.
        other: String,
        /// What differs.
        what: String,
    },
    /// The same samples are in two of them.
    #[error(
        "\"{file}\" has samples that an earlier part has, too, in the block of pixels at ({}, {}); expected each sample once",
        pixel[0], pixel[1]
    )]
    Overlap {
        /// Its name.
        file: String,
        /// First pixel of the block.
        pixel: [u32; 2],
    },
    /// Another reason of the film's own.
    #[error("\"{file}\": {reason}")]
    Film {
        /// Its name.
        file: String,
        /// What is wrong.
        reason: FilmError,
    },
}

/// Where a film comes from, and what it has cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// What it cost so far; what follows from the film itself is not kept up.
    pub report: Report,
    /// Whether samples were spread by the error.
    pub adaptive: bool,
    /// Samples a pixel of the render that it is, or is a part of; none if something else ends it.
    pub target: Option<u32>,
    /// Number and count, from 1, if it is one of several parts that are blocks of pixels.
    pub tile: Option<[u32; 2]>,
    /// Words of a command line that renders all of it: the scene, and what was chosen.
    pub command: Vec<String>,
    /// Whether the scene asks for 16-bit floating point in its picture.
    pub half: bool,
    /// World to camera space, as OpenEXR has it.
    pub world_to_camera: [f32; 16],
    /// World to screen, as OpenEXR has it.
    pub world_to_ndc: [f32; 16],
}

/// A film, and what has to be known of it.
#[derive(Debug)]
pub struct FilmFile {
    /// Its samples.
    pub film: Film,
    /// What its picture depends on.
    pub identity: Identity,
    /// Where it comes from.
    pub about: About,
    /// The round that it is in, for renders that decide by what they see.
    pub round: Option<Round>,
}

impl FilmFile {
    /// Reads a file. Nothing in it is trusted.
    ///
    /// # Errors
    /// [`FilmFileError`] names the file and what is wrong with it.
    pub fn read(path: impl AsRef<Path>) -> Result<FilmFile, FilmFileError> {
        let mut reader = Reader::open(path.as_ref())?;
        let film = reader.empty_film(reader.head.header.clone())?;
        reader.add_to(&film)?;
        Ok(FilmFile { film, identity: reader.identity, about: reader.about, round: reader.round })
    }

    /// Adds the films of several files, each sample once, in any order and grouping to the same bits. They are read one
    /// after another and block by block: the sum alone is in memory.
    ///
    /// Films that differ by their seeds only are independent renders; their samples are added, too, all with the same
    /// weight.
    ///
    /// # Errors
    /// [`FilmFileError::Mismatch`] if they are not of the same, [`FilmFileError::Overlap`] if a sample is in two of them,
    /// and as [`FilmFile::read`].
    pub fn merge(paths: &[impl AsRef<Path>]) -> Result<FilmFile, FilmFileError> {
        let Some((first, others)) = paths.split_first() else {
            let reason = "there are none".to_string();
            return Err(FilmFileError::Read { file: "parts".into(), reason });
        };
        let mut sum = Reader::open(first.as_ref())?;
        let mut header = sum.head.header.clone();
        // All of them first: what does not belong together is told before the work.
        for path in others {
            let other = Reader::open(path.as_ref())?;
            sum.check_same(&other)?;
            header = header.with_seeds_of(&other.head.header);
        }
        let film = sum.empty_film(header)?;
        sum.add_to(&film)?;
        for path in others {
            let mut other = Reader::open(path.as_ref())?;
            sum.check_same(&other)?;
            other.add_to(&film)?;
            add_cost(&mut sum.about, &other.about);
        }
        // What was decided in one of them says nothing about all.
        let round = if others.is_empty() { sum.round } else { None };
        Ok(FilmFile { film, identity: sum.identity, about: sum.about, round })
    }

    /// Writes it: beside, to disk, and then under its name. If that fails, an earlier file of that name stays as it is.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&self, path: impl AsRef<Path>) -> io::Result<()> {
        let FilmFile { film, identity, about, round } = self;
        save(path.as_ref(), film, identity, about, round.as_ref(), None)
    }
}

/// Writes a film file, to which others may add meanwhile; given up when the flag is raised.
pub(crate) fn save(
    path: &Path,
    film: &Film,
    identity: &Identity,
    about: &About,
    round: Option<&Round>,
    given_up: Option<&AtomicBool>,
) -> io::Result<()> {
    atomic_file::write_durably(path, |file| {
        let _held = film.has_splats().then(|| film.hold());
        let mut sections = SectionWriter::new(file)?;
        sections.write(Kind::Head, &film.head().to_bytes())?;
        sections.write(Kind::Identity, &serde_json::to_vec(identity)?)?;
        sections.write(Kind::About, &serde_json::to_vec(about)?)?;
        if let Some(round) = round {
            sections.write(Kind::Round, &round_to_bytes(round))?;
        }
        let (mut group, blocks) = (Vec::new(), film.blocks().len());
        let mut first = 0;
        for block in 0..blocks {
            if first == block {
                group.clear();
                group.extend((first as u64).to_le_bytes());
                // How many blocks; written below.
                group.extend([0; 8]);
            }
            film.block_to_bytes(block, &mut group);
            if group.len() >= GROUP_BYTES || block + 1 == blocks {
                group[8..16].copy_from_slice(&((block + 1 - first) as u64).to_le_bytes());
                sections.write(Kind::Blocks, &group)?;
                first = block + 1;
                if given_up.is_some_and(|flag| flag.load(Ordering::Relaxed)) {
                    return Err(io::Error::new(io::ErrorKind::Interrupted, "given up"));
                }
            }
        }
        sections.end()
    })
}

/// A film file whose blocks are still to be read.
pub(crate) struct Reader {
    sections: SectionReader,
    pub(crate) head: Head,
    pub(crate) identity: Identity,
    pub(crate) about: About,
    round: Option<Round>,
}

impl Reader {
    pub(crate) fn open(path: &Path) -> Result<Reader, FilmFileError> {
        let mut sections = SectionReader::open(path)?;
        let file = path.display().to_string();
        let film_error = |reason: FilmError| FilmFileError::Film { file: file.clone(), reason };
        let mut needed = |kind, what: &str| {
            let contents = sections.read_one(kind)?;
            contents.ok_or_else(|| sections.wrong(0, format!("it does not say {what}")))
        };
        let head = needed(Kind::Head, "what its film is of")?;
        let identity = needed(Kind::Identity, "what its picture depends on")?;
        let about = needed(Kind::About, "where it comes from")?;
        let head = Head::from_bytes(&head).map_err(film_error)?;
        let json = |error: serde_json::Error| FilmFileError::Format {
            file: file.clone(),
            at: 0,
            what: format!("what it says of itself cannot be understood: {error}"),
        };
        let identity: Identity = serde_json::from_slice(&identity).map_err(json)?;
        let about: About = serde_json::from_slice(&about).map_err(json)?;
        let blocks = sections.bytes_of(Kind::Blocks);
        if head.least_bytes() > blocks {
            return Err(sections.wrong(0, "there are not enough bytes for so many pixels"));
        }
        let round = match sections.read_one(Kind::Round)? {
            Some(bytes) => Some(
                round_from_bytes(&bytes, head.blocks())
                    .ok_or_else(|| sections.wrong(0, "its round is none of its film"))?,
            ),
            None => None,
        };
        Ok(Reader { sections, head, identity, about, round })
    }

    fn name(&self) -> String {
        self.sections.path().display().to_string()
    }

    fn film_error(&self, reason: FilmError) -> FilmFileError {
        FilmFileError::Film { file: self.name(), reason }
    }

    /// A film without samples.
    fn empty_film(&self, header: Header) -> Result<Film, FilmFileError> {
        let (needed, free) = (self.sections.bytes_of(Kind::Blocks), memory::limit());
        if needed > free {
            return Err(FilmFileError::Memory { file: self.name(), needed, free });
        }
        Film::new(header).map_err(|reason| self.film_error(reason))
    }

    /// Adds all samples to a film.
    fn add_to(&mut self, film: &Film) -> Result<(), FilmFileError> {
        film.add_head(&self.head).map_err(|reason| self.film_error(reason))?;
        let numbers: Vec<usize> = {
            let blocks = self.sections.kinds().filter(|(_, kind)| *kind == Kind::Blocks);
            blocks.map(|(number, _)| number).collect()
        };
        let (mut next, all) = (0u64, self.head.blocks());
        for number in numbers {
            let contents = self.sections.read(number)?;
            let Some((start, bytes)) = contents.split_at_checked(16) else {
                return Err(self.sections.wrong(number, "blocks without a number"));
            };
            let [first, count] = [0, 8].map(|at| u64::from_le_bytes(core::array::from_fn(|k| start[at + k])));
            if first != next || count == 0 || count > all - next {
                return Err(self.sections.wrong(number, "blocks that do not follow each other"));
            }
            next += count;
            let blocks = first as usize..next as usize;
            match film.add_blocks(blocks, &self.head.header, bytes) {
                Ok(used) if used == bytes.len() => {}
                Ok(_) => return Err(self.sections.wrong(number, "blocks that are too long")),
                Err(FilmError::Overlap { pixel, .. }) => {
                    return Err(FilmFileError::Overlap { file: self.name(), pixel });
                }
                Err(reason) => return Err(self.film_error(reason)),
            }
        }
        if next != all {
            return Err(self.sections.wrong(0, format!("{next} of {all} blocks are there")));
        }
        Ok(())
    }

    /// Checks that another one is of the same, but for its seeds.
    fn check_same(&self, other: &Reader) -> Result<(), FilmFileError> {
        let mismatch =
            |what: String| FilmFileError::Mismatch { file: self.name(), other: other.name(), what };
        let changes = self.identity.changes(&other.identity);
        if !changes.is_empty() {
            return Err(mismatch(format!("they are of different scenes ({})", changes.join(", "))));
        }
        let all = self.head.header.with_seeds_of(&other.head.header);
        let Header { seed, more_seeds, .. } = all.clone();
        match all.check_same(&Header { seed, more_seeds, ..other.head.header.clone() }) {
            Err(FilmError::Mismatch { what, own, other }) => {
                Err(mismatch(format!("{what} {own} and {other}")))
            }
            Err(reason) => Err(self.film_error(reason)),
            Ok(()) => Ok(()),
        }
    }
}

/// Adds what another film has cost.
fn add_cost(to: &mut About, from: &About) {
    let (own, other) = (&mut to.report, &from.report);
    own.seconds += other.seconds;
    own.setup_seconds += other.setup_seconds;
    add_named(&mut own.setup_stages, &other.setup_stages);
    add_named(&mut own.stages, &other.stages);
    own.rays.camera += other.rays.camera;
    own.rays.bounce += other.rays.bounce;
    own.rays.shadow += other.rays.shadow;
    own.peak_memory_bytes = own.peak_memory_bytes.max(other.peak_memory_bytes);
    own.threads = own.threads.max(other.threads);
    for (own, other) in
        [(&mut own.cpu, &other.cpu), (&mut own.isa, &other.isa), (&mut own.engine, &other.engine)]
    {
        if !own.split(" and ").any(|part| part == other) {
            *own = format!("{own} and {other}");
        }
    }
    to.target = to.target.max(from.target);
    // One of several kinds of parts says nothing about all.
    to.tile = match (to.tile, from.tile) {
        (Some([_, own]), Some([_, other])) if own == other => Some([0, own]),
        _ => None,
    };
    to.adaptive |= from.adaptive;
}

fn add_named(to: &mut Vec<(String, f64)>, from: &[(String, f64)]) {
    for (name, seconds) in from {
        match to.iter_mut().find(|(own, _)| own == name) {
            Some((_, own)) => *own += seconds,
            None => to.push((name.clone(), *seconds)),
        }
    }
}

/// Beginning and end (4 bytes each), predicted gain (8; NaN: none), and for each half of each block first sample and the one
/// behind the last (4 each), if they are not the same for all.
fn round_to_bytes(round: &Round) -> Vec<u8> {
    let mut out = Vec::new();
    out.extend(round.from.to_le_bytes());
    out.extend(round.to.to_le_bytes());
    out.extend(round.predicted_gain.unwrap_or(f64::NAN).to_le_bytes());
    for range in round.ranges.iter().flatten().flatten() {
        out.extend(range.start.to_le_bytes());
        out.extend(range.end.to_le_bytes());
    }
    out
}

fn round_from_bytes(bytes: &[u8], blocks: u64) -> Option<Round> {
    let (start, ranges) = bytes.split_at_checked(16)?;
    let u32_of = |bytes: &[u8]| u32::from_le_bytes(core::array::from_fn(|k| bytes[k]));
    let gain = f64::from_le_bytes(core::array::from_fn(|k| start[8 + k]));
    let range = |bytes: &[u8]| u32_of(bytes)..u32_of(&bytes[4..]);
    let all: Vec<[Range<u32>; 2]> =
        ranges.as_chunks::<16>().0.iter().map(|both| [range(both), range(&both[8..])]).collect();
    let fits = ranges.is_empty() || ranges.len() as u64 == blocks.saturating_mul(16);
    let (from, to) = (u32_of(start), u32_of(&start[4..]));
    let ascending = from <= to && all.iter().flatten().all(|range| range.start <= range.end);
    (fits && ascending).then(|| Round {
        from,
        to,
        ranges: (!all.is_empty()).then_some(all),
        predicted_gain: (!gain.is_nan()).then_some(gain),
    })
}

#[cfg(test)]
mod tests;
