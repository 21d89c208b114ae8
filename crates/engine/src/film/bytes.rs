//! A film as bytes, and back: whole, or its [`Head`] and its blocks one by one, so that nobody needs all bytes at once. There
//! are no checksums and no compression here: who writes files adds them.
//!
//! All numbers are little-endian; a text is its length (`u32`) and its bytes.
//!
//! | what | bytes |
//! |---|---|
//! | `wavepath film`, 0, 0, 0 | 16 |
//! | version, 1 | 4 |
//! | width and height of the image; x0, x1, y0, y1 | 24 |
//! | parts; filter weights (0 or 1); halves count the same (0 or 1); 0 | 4 |
//! | number of seeds, then the seeds | 4, 8 each |
//! | sampler, estimator, pattern of arithmetic | texts |
//! | number of channels, then the name of each | 4, texts |
//! | light paths, by part | 8 each |
//! | the blocks, row by row | see below |
//!
//! A block: for each seed, for each of the 8 replicates the number of ranges (`u32`), and first sample and the one behind the last of each;
//! a byte whose bit `k` says that part `k` is there, and one that is 1 if channels that are not replicated are. Then those
//! parts, each: invalid samples and bounce rays (8 each), filter weights (4 a pixel, where there are some), the replicated
//! channels; at the end the other channels. Pixels are in Morton order.
//!
//! A channel: additions (8), which say how many bytes a bin takes; bases, lower and upper parts of the bins; coverage (4 a
//! pixel, where it is the divisor); the number of names (`u32`), and for each its pixel (2), name (4) and weight (8).

use super::block::{FilmBlock, FilmChannel, Keys, Layout, Part};
use super::exact::{self, PackedSums};
use super::header::{MOST_SEEDS, MOST_TEXT};
use super::ranges::Ranges;
use super::replicates::REPLICATES;
use super::{Film, FilmError, Frame, Header, locked};
use crate::SamplerKind;
use std::ops::Range;
use std::sync::atomic::Ordering;
use wavepath_kernels::channels::{Channel, Divisor, Row};

const MAGIC: &[u8; 16] = b"wavepath film\0\0\0";

/// The version that is written, and the only one that is read.
pub(super) const VERSION: u32 = 1;

/// Fewest bytes of a block in a film of so many seeds.
fn least_block(seeds: usize) -> u64 {
    4 * u64::from(REPLICATES) * seeds as u64 + 2
}

/// What a film is of, and what of it belongs to no block.
#[derive(Clone, Debug, PartialEq)]
pub struct Head {
    /// What it is of.
    pub header: Header,
    /// Whether both halves of the replicates count the same: see [`Film::split`].
    pub is_split: bool,
    /// Light paths, by part.
    pub light_paths: Vec<u64>,
}

impl Head {
    /// As bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        out.extend_from_slice(MAGIC);
        let Header {
            frame,
            channels,
            filter_weights,
            parts,
            seed: _,
            more_seeds,
            sampler,
            estimator,
            arithmetic,
        } = &self.header;
        let Frame { image_width, image_height, bounds } = *frame;
        put(&mut out, [VERSION, image_width, image_height].into_iter().chain(bounds));
        out.extend([*parts as u8, *filter_weights as u8, self.is_split as u8, 0]);
        put(&mut out, [1 + more_seeds.len() as u32]);
        self.header.seeds().for_each(|seed| out.extend(seed.to_le_bytes()));
        for text in [sampler.name(), estimator, arithmetic] {
            put_text(&mut out, text);
        }
        put(&mut out, [channels.len() as u32]);
        channels.iter().for_each(|row| put_text(&mut out, row.name));
        self.light_paths.iter().for_each(|paths| out.extend(paths.to_le_bytes()));
        out
    }

    /// What [`Head::to_bytes`] made bytes of.
    ///
    /// # Errors
    /// [`FilmError::Bytes`], [`FilmError::Header`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Head, FilmError> {
        let mut from = Reader { bytes, at: 0 };
        let head = from.head()?;
        from.end()?;
        Ok(head)
    }

    /// How many blocks the film has.
    pub fn blocks(&self) -> u64 {
        let [first_column, end_column, first_row, end_row] = self.header.frame.blocks();
        u64::from(end_column - first_column) * u64::from(end_row - first_row)
    }

    /// Fewest bytes that the blocks of such a film are.
    pub fn least_bytes(&self) -> u64 {
        self.blocks().saturating_mul(least_block(1 + self.header.more_seeds.len()))
    }
}

impl Film {
    /// The film as bytes: the same ones for the same samples, in whatever order and parts they came.
    ///
    /// Whoever commits work units meanwhile waits; no unit is in it by half.
    pub fn to_bytes(&self) -> Vec<u8> {
        let _alone = self.alone();
        let mut out = self.head().to_bytes();
        let seeds = 1 + self.header.more_seeds.len();
        self.state.iter().for_each(|state| put_block(&mut out, &locked(state), seeds));
        out
    }

    /// What it is of, and what of it belongs to no block.
    pub fn head(&self) -> Head {
        let paths = &self.light_paths[..self.header.parts as usize];
        let light_paths = paths.iter().map(|paths| paths.load(Ordering::Relaxed)).collect();
        Head { header: self.header.clone(), is_split: self.is_split(), light_paths }
    }

    /// Appends a block as bytes, all work units that are in it whole. Others may add to the film meanwhile; only where
    /// there are splats ([`Film::has_splats`]) does a unit touch several blocks.
    pub fn block_to_bytes(&self, block: usize, out: &mut Vec<u8>) {
        if let Some(state) = self.state.get(block) {
            put_block(out, &locked(state), 1 + self.header.more_seeds.len());
        }
    }

    /// Adds what belongs to no block of a film that shall be added: the first step, before [`Film::add_blocks`].
    ///
    /// # Errors
    /// [`FilmError::Mismatch`] if it is of something else, or has a seed that this one does not have.
    pub fn add_head(&self, head: &Head) -> Result<(), FilmError> {
        let Header { seed, more_seeds, .. } = self.header.clone();
        self.header.check_same(&Header { seed, more_seeds, ..head.header.clone() })?;
        self.seeds_of(&head.header)?;
        for (own, other) in self.light_paths.iter().zip(&head.light_paths) {
            own.fetch_add(*other, Ordering::Relaxed);
        }
        if head.is_split {
            self.split();
        }
        Ok(())
    }

    /// Adds the samples of some blocks of another film, whose header is `of`: from the beginning of `bytes`. Returns how many
    /// bytes that were.
    ///
    /// # Errors
    /// [`FilmError::Bytes`], [`FilmError::Overlap`], [`FilmError::TooMany`]. Some blocks may have been added then.
    pub fn add_blocks(&self, blocks: Range<usize>, of: &Header, bytes: &[u8]) -> Result<usize, FilmError> {
        let seeds = self.seeds_of(of)?;
        let mut from = Reader { bytes, at: 0 };
        for block in blocks {
            let (Some(pixels), Some(state)) = (self.blocks.get(block), self.state.get(block)) else {
                return Err(from.wrong("there is no such block"));
            };
            let other = from.block(self.layout(), pixels.pixels(), seeds.len())?.with_seeds(&seeds);
            let mut own = locked(state);
            if let Some(replicate) = own.shared_replicate(&other) {
                return Err(FilmError::Overlap { pixel: [pixels.x, pixels.y], replicate });
            }
            if u64::from(own.samples()) + u64::from(other.samples()) > exact::MOST_ADDITIONS {
                return Err(FilmError::TooMany);
            }
            match own.parts.is_empty() && own.shared.is_empty() {
                true => *own = other,
                false => own.merge(self.layout(), pixels.pixels(), &other),
            }
        }
        Ok(from.at)
    }

    /// The places of the seeds of another film among those of this one.
    fn seeds_of(&self, other: &Header) -> Result<Vec<usize>, FilmError> {
        let place = |seed: u64| self.header.seeds().position(|own| own == seed);
        let places: Option<Vec<usize>> = other.seeds().map(place).collect();
        places.ok_or_else(|| FilmError::Mismatch {
            what: "seed",
            own: self.header.seed.to_string(),
            other: other.seed.to_string(),
        })
    }

    /// Whether samples reach other pixels than their own.
    pub fn has_splats(&self) -> bool {
        self.header.channels.iter().any(|row| row.divisor == Divisor::LightPaths)
    }

    /// The film that [`Film::to_bytes`] made bytes of. Nothing in them is trusted, and no memory is taken on their word.
    ///
    /// # Errors
    /// [`FilmError::Bytes`] says what is wrong and where, [`FilmError::Header`] that there can be no such film.
    pub fn from_bytes(bytes: &[u8]) -> Result<Film, FilmError> {
        let mut from = Reader { bytes, at: 0 };
        let head = from.head()?;
        if head.least_bytes() > from.left() {
            return Err(from.wrong("there are not enough bytes for so many pixels"));
        }
        let film = Film::new(head.header.clone())?;
        film.add_head(&head)?;
        let seeds = 1 + head.header.more_seeds.len();
        for (block, state) in film.blocks.iter().zip(&film.state) {
            *locked(state) = from.block(film.layout(), block.pixels(), seeds)?;
        }
        from.end()?;
        Ok(film)
    }
}

fn put(out: &mut Vec<u8>, numbers: impl IntoIterator<Item = u32>) {
    numbers.into_iter().for_each(|number| out.extend(number.to_le_bytes()));
}

fn put_text(out: &mut Vec<u8>, text: &str) {
    put(out, [text.len() as u32]);
    out.extend_from_slice(text.as_bytes());
}

fn put_block(out: &mut Vec<u8>, block: &FilmBlock, seeds: usize) {
    for replicate in 0..REPLICATES * seeds as u32 {
        let ranges = block.held(replicate).map(Ranges::iter);
        put(out, [ranges.as_ref().map_or(0, ExactSizeIterator::len) as u32]);
        for range in ranges.into_iter().flatten() {
            put(out, [range.start, range.end]);
        }
    }
    let there = block.parts().fold(0, |there, (k, _)| there | 1u8 << k);
    out.extend([there, !block.shared.is_empty() as u8]);
    for (_, part) in block.parts() {
        out.extend(part.invalid.to_le_bytes());
        out.extend(part.bounces.to_le_bytes());
        part.weight.iter().for_each(|weight| out.extend(weight.to_le_bytes()));
        part.channels.iter().for_each(|channel| put_channel(out, channel));
    }
    block.shared.iter().for_each(|channel| put_channel(out, channel));
}

fn put_channel(out: &mut Vec<u8>, channel: &FilmChannel) {
    out.extend(channel.sums.additions().to_le_bytes());
    channel.sums.write(out);
    channel.coverage.iter().for_each(|weight| out.extend(weight.to_le_bytes()));
    put(out, [channel.keys.len() as u32]);
    for (&(pixel, name), &weight) in &channel.keys {
        out.extend(pixel.to_le_bytes());
        put(out, [name]);
        out.extend(weight.to_le_bytes());
    }
}

/// Bytes, and how far they are read.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn wrong(&self, what: impl Into<String>) -> FilmError {
        FilmError::Bytes { at: self.at, what: what.into() }
    }

    fn left(&self) -> u64 {
        (self.bytes.len() - self.at) as u64
    }

    fn take(&mut self, count: u64) -> Result<&'a [u8], FilmError> {
        if count > self.left() {
            return Err(self.wrong("it ends too early"));
        }
        let taken = &self.bytes[self.at..self.at + count as usize];
        self.at += count as usize;
        Ok(taken)
    }

    fn end(&self) -> Result<(), FilmError> {
        if self.left() > 0 { Err(self.wrong("it goes on behind its end")) } else { Ok(()) }
    }

    fn head(&mut self) -> Result<Head, FilmError> {
        if self.take(MAGIC.len() as u64)? != MAGIC {
            return Err(self.wrong("it does not begin like a film"));
        }
        let version = self.u32()?;
        if version != VERSION {
            return Err(self.wrong(format!("version {version}; this program reads version {VERSION}")));
        }
        let [image_width, image_height, x0, x1, y0, y1] = self.u32s()?;
        let frame = Frame { image_width, image_height, bounds: [x0, x1, y0, y1] };
        let [parts, filter_weights, is_split, _] = self.array()?;
        let mut more_seeds = Vec::new();
        let count = self.u32()? as usize;
        if !(1..=MOST_SEEDS).contains(&count) {
            return Err(self.wrong(format!("{count} seeds")));
        }
        for _ in 0..count {
            more_seeds.push(self.u64()?);
        }
        let seed = more_seeds.remove(0);
        let name = self.text()?;
        let Some(sampler) = SamplerKind::ALL.into_iter().find(|kind| kind.name() == name) else {
            return Err(self.wrong(format!("there is no sampler \"{name}\"")));
        };
        let (estimator, arithmetic) = (self.text()?, self.text()?);
        let count = self.u32()? as usize;
        let mut channels = Vec::new();
        for _ in 0..count {
            let name = self.text()?;
            let Some(channel) = Channel::named(&name) else {
                return Err(self.wrong(format!("there is no channel \"{name}\"")));
            };
            channels.push(channel.row());
            if channels.len() > Channel::ALL.len() {
                return Err(self.wrong("more channels than there are"));
            }
        }
        let header = Header {
            frame,
            channels,
            filter_weights: filter_weights != 0,
            parts: parts.into(),
            seed,
            more_seeds,
            sampler,
            estimator,
            arithmetic,
        };
        header.check()?;
        let mut light_paths = Vec::new();
        for _ in 0..header.parts {
            light_paths.push(self.u64()?);
        }
        Ok(Head { header, is_split: is_split != 0, light_paths })
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], FilmError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N as u64)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, FilmError> {
        self.array().map(u32::from_le_bytes)
    }

    fn u32s<const N: usize>(&mut self) -> Result<[u32; N], FilmError> {
        let mut numbers = [0; N];
        for number in &mut numbers {
            *number = self.u32()?;
        }
        Ok(numbers)
    }

    fn u64(&mut self) -> Result<u64, FilmError> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Result<String, FilmError> {
        let length = self.u32()?;
        if length as usize > MOST_TEXT {
            return Err(self.wrong("a text is too long"));
        }
        let bytes = self.take(length.into())?;
        String::from_utf8(bytes.to_vec()).map_err(|_| self.wrong("a text is not UTF-8"))
    }

    fn block(&mut self, layout: Layout, pixels: usize, seeds: usize) -> Result<FilmBlock, FilmError> {
        let mut block = FilmBlock::default();
        let mut samples = [0u64; REPLICATES as usize];
        for replicate in 0..REPLICATES * seeds as u32 {
            let mut end = None;
            for _ in 0..self.u32()? {
                let [first, last] = self.u32s()?;
                if first >= last || end.is_some_and(|end| first <= end) {
                    return Err(self.wrong("the samples are no ascending ranges"));
                }
                end = Some(last);
                block.held_mut(replicate).insert(first..last);
                samples[(replicate % layout.parts) as usize] += u64::from(last - first);
            }
        }
        let all = samples.iter().sum::<u64>();
        if all > exact::MOST_ADDITIONS {
            return Err(self.wrong("more samples than a film can have"));
        }
        let [there, is_shared] = self.array()?;
        for (k, &samples) in samples.iter().enumerate() {
            let is_there = there >> k & 1 != 0;
            if !is_there && samples > 0 || is_there && k >= layout.parts as usize {
                return Err(self.wrong("parts and samples do not belong together"));
            }
            if is_there {
                let part = self.part(layout, pixels, samples as u32)?;
                block.parts.resize_with(k, || None);
                block.parts.push(Some(Box::new(part)));
            }
        }
        let has_shared = layout.channels_of(false).next().is_some();
        if is_shared > 1 || is_shared == 1 && !has_shared || is_shared == 0 && has_shared && all > 0 {
            return Err(self.wrong("channels and samples do not belong together"));
        }
        if is_shared == 1 {
            for row in layout.channels_of(false) {
                block.shared.push(self.channel(row, pixels, all)?);
            }
        }
        Ok(block)
    }

    fn part(&mut self, layout: Layout, pixels: usize, samples: u32) -> Result<Part, FilmError> {
        let (invalid, bounces) = (self.u64()?, self.u64()?);
        let weight = self.weights(if layout.filter_weights { pixels } else { 0 }, samples.into())?;
        let mut channels = Vec::new();
        for row in layout.channels_of(true) {
            channels.push(self.channel(row, pixels, samples.into())?);
        }
        Ok(Part { samples, invalid, bounces, weight, channels })
    }

    /// Sums of as many weights of 1 and -1.
    fn weights(&mut self, count: usize, samples: u64) -> Result<Vec<i32>, FilmError> {
        let bytes = self.take(4 * count as u64)?;
        let weights: Vec<i32> = bytes.as_chunks().0.iter().map(|bytes| i32::from_le_bytes(*bytes)).collect();
        match weights.iter().all(|weight| u64::from(weight.unsigned_abs()) <= samples) {
            true => Ok(weights),
            false => Err(self.wrong("weights of more samples than there are")),
        }
    }

    fn channel(&mut self, row: &'static Row, pixels: usize, samples: u64) -> Result<FilmChannel, FilmError> {
        let mut channel = FilmChannel::new(row, pixels);
        let additions = self.u64()?;
        let is_splat = row.divisor == Divisor::LightPaths;
        if additions > exact::MOST_ADDITIONS || !is_splat && additions != samples {
            return Err(self.wrong(format!("channel \"{}\" has not the sums of its samples", row.name)));
        }
        let sums = channel.sums_per_block();
        let bytes = self.take(PackedSums::written_bytes(sums as u64, additions))?;
        channel.sums = PackedSums::read(sums, additions, bytes)
            .ok_or_else(|| self.wrong(format!("channel \"{}\" has sums of no numbers", row.name)))?;
        channel.coverage = self.weights(channel.coverage.len(), samples)?;
        channel.keys = self.keys(row, pixels, samples)?;
        Ok(channel)
    }

    fn keys(&mut self, row: &Row, pixels: usize, samples: u64) -> Result<Keys, FilmError> {
        let mut keys = Keys::new();
        let count = self.u32()?;
        if count > 0 && row.kind != wavepath_kernels::channels::Kind::Keyed {
            return Err(self.wrong(format!("channel \"{}\" has no names", row.name)));
        }
        for _ in 0..count {
            let pixel = u16::from_le_bytes(self.array()?);
            let name = self.u32()?;
            let weight = i64::from_le_bytes(self.array()?);
            let follows = keys.last_key_value().is_none_or(|(last, _)| *last < (pixel, name));
            if usize::from(pixel) >= pixels || !follows || weight == 0 || weight.unsigned_abs() > samples {
                return Err(self.wrong("names and weights that cannot be"));
            }
            keys.insert((pixel, name), weight);
        }
        Ok(keys)
    }
}
