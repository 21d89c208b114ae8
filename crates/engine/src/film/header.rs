//! What a film is of: two films can be added if this is the same.

use super::replicates::REPLICATES;
use crate::{SamplerKind, Settings};
use std::fmt;
use wavepath_kernels::channels::{Channel, Kind, MOST_COMPONENTS, Row};
use wavepath_kernels::generate::BLOCK_SIDE;
use wavepath_kernels::isa::Level;
use wavepath_kernels::queue::Requirements;

/// The pixels that are rendered, and their place in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Width of the full image; numbers pixels.
    pub image_width: u32,
    /// Height of the full image.
    pub image_height: u32,
    /// Pixels to render: `[x0, x1, y0, y1]`, half open.
    pub bounds: [u32; 4],
}

impl Frame {
    /// Pixels to render.
    pub fn pixels(&self) -> u64 {
        let [x0, x1, y0, y1] = self.bounds;
        u64::from(x1.saturating_sub(x0)) * u64::from(y1.saturating_sub(y0))
    }

    /// Where blocks begin that have pixels of the frame: `[x0, x1, y0, y1]` in blocks. They are aligned to the image, not to
    /// the bounds, so that a crop has the work units of the image.
    pub(super) fn blocks(&self) -> [u32; 4] {
        let [x0, x1, y0, y1] = self.bounds;
        let side = BLOCK_SIDE as u32;
        [x0 / side, x1.div_ceil(side), y0 / side, y1.div_ceil(side)]
    }
}

/// Most pixels of a film. Their numbers in the image seed the streams of random numbers.
pub const MOST_PIXELS: u64 = 1 << 32;

/// What a film is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// The pixels.
    pub frame: Frame,
    /// Channels, radiance first.
    pub channels: Vec<&'static Row>,
    /// Whether the filter has negative lobes, and samples weigh 1 or -1.
    pub filter_weights: bool,
    /// In how many parts replicates are kept apart: 1, 2, 4 or 8. Fewer take less memory and know less of the error; samples
    /// and means are the same.
    pub parts: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Seeds of independent renders whose samples are in the film, too, each above the one before and above `seed`.
    pub more_seeds: Vec<u64>,
    /// Random numbers.
    pub sampler: SamplerKind,
    /// What else the samples depend on, in words: the estimator and its settings.
    pub estimator: String,
    /// The pattern of arithmetic. Machines with the same one compute the same bits.
    pub arithmetic: String,
}

/// Most seeds of independent renders in one film.
pub(super) const MOST_SEEDS: usize = 1 << 16;

/// Most bytes of a text in a header.
pub(super) const MOST_TEXT: usize = 1 << 16;

impl Header {
    /// For a render of a frame with a plan's requirements.
    pub fn of_render(frame: Frame, requirements: Requirements, settings: &Settings) -> Self {
        Header {
            frame,
            channels: requirements.channels.iter().map(Channel::row).collect(),
            filter_weights: requirements.filter_weights,
            parts: parts_for(frame.pixels(), requirements),
            seed: settings.seed,
            more_seeds: Vec::new(),
            sampler: settings.sampler,
            estimator: "path".into(),
            arithmetic: arithmetic(settings.level).into(),
        }
    }

    /// All seeds.
    pub fn seeds(&self) -> impl Iterator<Item = u64> {
        std::iter::once(self.seed).chain(self.more_seeds.iter().copied())
    }

    /// The same with the seeds of another header, too: for a film that takes the samples of both.
    pub fn with_seeds_of(&self, other: &Header) -> Header {
        let mut seeds: Vec<u64> = self.seeds().chain(other.seeds()).collect();
        seeds.sort_unstable();
        seeds.dedup();
        let seed = seeds.remove(0);
        Header { seed, more_seeds: seeds, ..self.clone() }
    }

    /// Checks that there can be such a film.
    ///
    /// # Errors
    /// [`FilmError::Header`].
    pub fn check(&self) -> Result<(), FilmError> {
        let wrong = |what: &'static str, found: String, expected: &str| {
            Err(FilmError::Header { what, found, expected: expected.into() })
        };
        let Frame { image_width: width, image_height: height, bounds } = self.frame;
        let [x0, x1, y0, y1] = bounds;
        if !(x0 < x1 && x1 <= width && y0 < y1 && y1 <= height) {
            let expected = format!("x0 < x1 <= {width} and y0 < y1 <= {height}");
            return wrong("the pixels [x0, x1, y0, y1]", format!("{bounds:?}"), &expected);
        }
        if u64::from(width) * u64::from(height) > MOST_PIXELS {
            return wrong("the image", format!("{width} x {height}"), "at most 2^32 pixels");
        }
        if !(self.parts.is_power_of_two() && self.parts <= REPLICATES) {
            return wrong("the number of parts", self.parts.to_string(), "1, 2, 4 or 8");
        }
        if self.channels.first() != Some(&Channel::Radiance.row()) {
            let found = self.channels.first().map_or("none", |row| row.name);
            return wrong("the first channel", found.into(), "radiance");
        }
        for (k, row) in self.channels.iter().enumerate() {
            if !(1..=MOST_COMPONENTS).contains(&row.components.len())
                || row.kind == Kind::Keyed && row.components.len() != 1
            {
                return wrong(
                    "the number of components of a channel",
                    row.components.len().to_string(),
                    "1 to 4",
                );
            }
            if self.channels[..k].iter().any(|other| other.name == row.name) {
                return wrong("the channels", row.name.into(), "each name once");
            }
        }
        let seeds: Vec<u64> = self.seeds().collect();
        if seeds.len() > MOST_SEEDS || seeds.windows(2).any(|pair| pair[0] >= pair[1]) {
            return wrong("the seeds", format!("{} of them", seeds.len()), "ascending, at most 65536");
        }
        if self.estimator.len() > MOST_TEXT || self.arithmetic.len() > MOST_TEXT {
            return wrong("a text", "too long".into(), "at most 65536 bytes");
        }
        Ok(())
    }

    /// Checks that another film is of the same.
    ///
    /// # Errors
    /// [`FilmError::Mismatch`] names what differs.
    pub fn check_same(&self, other: &Header) -> Result<(), FilmError> {
        let check = |what: &'static str, own: String, other: String| match own == other {
            true => Ok(()),
            false => Err(FilmError::Mismatch { what, own, other }),
        };
        let size = |frame: &Frame| format!("{} x {}", frame.image_width, frame.image_height);
        let names = |header: &Header| -> String {
            header.channels.iter().map(|row| row.name).collect::<Vec<_>>().join(",")
        };
        let seeds =
            |header: &Header| header.seeds().map(|seed| seed.to_string()).collect::<Vec<_>>().join(", ");
        check("image", size(&self.frame), size(&other.frame))?;
        check("crop", format!("{:?}", self.frame.bounds), format!("{:?}", other.frame.bounds))?;
        check("channels", names(self), names(other))?;
        check("filter weights", self.filter_weights.to_string(), other.filter_weights.to_string())?;
        check("number of parts", self.parts.to_string(), other.parts.to_string())?;
        check("seed", seeds(self), seeds(other))?;
        check("sampler", self.sampler.name().into(), other.sampler.name().into())?;
        check("estimator", self.estimator.clone(), other.estimator.clone())?;
        check("arithmetic", self.arithmetic.clone(), other.arithmetic.clone())?;
        if self != other {
            return Err(FilmError::Mismatch { what: "channels", own: names(self), other: names(other) });
        }
        Ok(())
    }
}

/// The pattern of arithmetic of an instruction set: every operation is exact IEEE arithmetic, and multiply-add is fused
/// everywhere or nowhere.
pub fn arithmetic(level: Level) -> &'static str {
    if level == Level::BASELINE { "f32" } else { "f32 with fused multiply-add" }
}

/// In how many parts a film of so many pixels keeps replicates apart: all, as long as it stays below 4 GiB then, and two
/// in any case. It changes what is known of the error, not what is sampled.
pub(super) fn parts_for(pixels: u64, requirements: Requirements) -> u32 {
    const FILM_BYTES: u64 = 4 << 30;
    let mut parts = REPLICATES;
    while parts > 2 && super::Film::bytes(pixels, u64::from(parts) * 16, parts, requirements) > FILM_BYTES {
        parts /= 2;
    }
    parts
}

/// What cannot be done with a film.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilmError {
    /// There can be no such film.
    Header {
        /// What is wrong.
        what: &'static str,
        /// As it is.
        found: String,
        /// As it may be.
        expected: String,
    },
    /// Films are not of the same.
    Mismatch {
        /// What differs.
        what: &'static str,
        /// In the film.
        own: String,
        /// In the other.
        other: String,
    },
    /// The film has some of the samples already.
    Overlap {
        /// First pixel of the block, whether or not it is in the bounds.
        pixel: [u32; 2],
        /// Replicate of one of them.
        replicate: u32,
    },
    /// More samples of a pixel than a film can have.
    TooMany,
    /// A work unit that the film has no place for.
    Unit {
        /// What is wrong.
        what: &'static str,
    },
    /// Bytes that are no film.
    Bytes {
        /// Where it shows.
        at: usize,
        /// What is wrong.
        what: String,
    },
}

impl fmt::Display for FilmError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            FilmError::Header { what, found, expected } => write!(f, "{what}: {found}; expected {expected}"),
            FilmError::Mismatch { what, own, other } => {
                write!(f, "the films do not belong together: {what} {own} and {other}")
            }
            FilmError::Overlap { pixel: [x, y], replicate } => {
                write!(f, "the film has samples of replicate {replicate} in the block at ({x}, {y}) already")
            }
            FilmError::TooMany => write!(f, "a film has room for 2147483647 samples of a pixel"),
            FilmError::Unit { what } => write!(f, "the film has no place for the work unit: {what}"),
            FilmError::Bytes { at, what } => write!(f, "no film: {what} (byte {at})"),
        }
    }
}

impl std::error::Error for FilmError {}
