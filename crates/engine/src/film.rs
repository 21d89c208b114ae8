//! The film: exact sums, so that the order of samples, the number of threads and the way a render is cut into parts
//! never change a bit of the image.
//!
//! Floating-point sums depend on their order, and paths end in an order that depends on everything. The film adds
//! digits, as integers (`film/exact.rs`): any order, any grouping gives the same bits, for samples of any size.
//!
//! It holds the channels of a [`Header`], radiance first, and knows which samples of which pixels are in it; a sample is
//! never added twice. Films of the same header, of different samples, can be added: [`Film::merge`].

mod block;
mod bytes;
mod error;
mod exact;
mod header;
pub mod live_error;
mod ranges;
pub mod replicates;

pub use block::BlockSums;
pub use bytes::Head;
pub use error::ErrorEstimate;
pub use header::{FilmError, Frame, Header, MOST_PIXELS, arithmetic};

use crate::Settings;
use crate::schedule::Unit;
use block::{FilmBlock, FilmChannel, Layout};
use error::{BlockErrors, BlockVariances, ErrorSum, Known, Replicates};
use rayon::prelude::*;
use replicates::REPLICATES;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, RwLock, RwLockReadGuard, RwLockWriteGuard};
use wavepath_kernels::channels::{Channel, Divisor, Kind, Row, Values};
use wavepath_kernels::generate::{BLOCK_PIXELS, BLOCK_SIDE, PixelBlock};
use wavepath_kernels::isa::Level;
use wavepath_kernels::queue::Requirements;

/// Added to the squared reference in relMSE, the mean of `(I - R)^2 / (R^2 + EPSILON)`: black pixels count, too.
pub const EPSILON: f64 = 0.01;

/// The film.
#[derive(Debug)]
pub struct Film {
    header: Header,
    blocks: Vec<PixelBlock>,
    state: Vec<Mutex<FilmBlock>>,
    /// Light paths, by part.
    light_paths: [AtomicU64; REPLICATES as usize],
    split: AtomicBool,
    /// Shared by all who commit work units; who holds it alone sees none half committed.
    whole: RwLock<()>,
}

/// A complete work unit: what comes into the film together, or not at all.
#[derive(Clone, Copy, Debug)]
pub struct Commit<'a> {
    /// Which samples.
    pub unit: Unit,
    /// Their sums.
    pub sums: &'a BlockSums,
    /// Light paths that were followed with them.
    pub light_paths: u64,
    /// What those light paths brought to pixels anywhere.
    pub splats: &'a [Splat],
}

/// Keeps a film as it is: [`Film::hold`].
#[derive(Debug)]
pub struct Held<'a> {
    _alone: RwLockWriteGuard<'a, ()>,
}

/// What a light path brings to a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Column and row in the full image. Outside of the film's bounds it counts for nothing.
    pub pixel: [u32; 2],
    /// Number of the channel in the header; it is divided by light paths.
    pub channel: usize,
    /// What is added.
    pub values: Values<f32>,
}

/// A finished picture.
#[derive(Clone, Debug)]
pub struct Developed {
    /// Pixel means, row by row, of the pixels in the bounds.
    pub pixels: Vec<[f32; 3]>,
    /// Pixel samples taken.
    pub samples: u64,
    /// Samples that were dropped.
    pub invalid: u64,
    /// Estimated relMSE; none with fewer than two replicates.
    pub relmse: Option<f64>,
    /// Its 95 % interval.
    pub relmse_interval: Option<[f64; 2]>,
}

/// What half of the replicates know of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HalfBlock {
    /// Pixels.
    pub pixels: u64,
    /// Samples of each pixel.
    pub samples: u32,
    /// Rays of all samples beyond those from the camera and towards lights.
    pub bounces: u64,
    /// Estimated relative squared error of the half's means, sum over the pixels; 0 with fewer than two replicates.
    pub error: f64,
}

/// What is known of each pixel beside its mean; row by row, of the pixels in the bounds.
#[derive(Clone, Debug)]
pub struct PixelStatistics {
    /// Estimated variance of each pixel's mean, radiance squared; NaN with fewer than two replicates.
    pub variance: Vec<[f32; 3]>,
    /// Samples.
    pub samples: Vec<u32>,
}

impl Film {
    /// An empty film.
    ///
    /// # Errors
    /// [`FilmError::Header`] if there can be none.
    pub fn new(header: Header) -> Result<Self, FilmError> {
        header.check()?;
        let [x0, x1, y0, y1] = header.frame.bounds;
        let [first_column, end_column, first_row, end_row] = header.frame.blocks();
        let side = BLOCK_SIDE as u32;
        let whole = PixelBlock::part(0, 0, 0..side, 0..side);
        let mut blocks = Vec::new();
        for y in (first_row..end_row).map(|row| row * side) {
            for x in (first_column..end_column).map(|column| column * side) {
                let part = |from: u32, to: u32, at: u32| from.saturating_sub(at)..(to - at).min(side);
                let (columns, rows) = (part(x0, x1, x), part(y0, y1, y));
                blocks.push(match columns == (0..side) && rows == (0..side) {
                    true => whole.moved_to(x, y),
                    false => PixelBlock::part(x, y, columns, rows),
                });
            }
        }
        let state = blocks.iter().map(|_| Mutex::default()).collect();
        let (light_paths, split, whole) = Default::default();
        Ok(Film { header, blocks, state, light_paths, split, whole })
    }

    /// An empty film for a render.
    ///
    /// # Errors
    /// As [`Film::new`].
    pub fn for_render(
        frame: Frame,
        requirements: Requirements,
        settings: &Settings,
    ) -> Result<Self, FilmError> {
        Film::new(Header::of_render(frame, requirements, settings))
    }

    /// Parts that a film of a render keeps replicates apart in, with so many samples of each pixel; `None`: any number.
    pub fn replicates_for_render(frame: Frame, requirements: Requirements, spp: Option<u32>) -> u32 {
        header::parts_for(frame.pixels(), requirements).min(replicates::opened(spp.unwrap_or(u32::MAX)))
    }

    /// Bytes that the film of a render takes with so many samples of each pixel; `None`: any number.
    pub fn bytes_for_render(frame: Frame, requirements: Requirements, spp: Option<u32>) -> u64 {
        let parts = Film::replicates_for_render(frame, requirements, spp);
        Film::bytes(frame.pixels(), spp.unwrap_or(u32::MAX).into(), parts, requirements)
    }

    /// Bytes of a film with so many samples of each pixel in so many parts.
    pub fn bytes(pixels: u64, samples: u64, parts: u32, requirements: Requirements) -> u64 {
        let of_channels = |replicated: bool, samples: u64| -> u64 {
            let rows =
                requirements.channels.iter().map(Channel::row).filter(|row| row.replicated == replicated);
            rows.map(|row| FilmChannel::bytes_per_pixel(row, samples)).sum()
        };
        let weight = if requirements.filter_weights { size_of::<i32>() as u64 } else { 0 };
        let parts = u64::from(parts);
        let of_pixel =
            parts * (of_channels(true, samples / parts.max(1)) + weight) + of_channels(false, samples);
        pixels.saturating_mul(of_pixel)
    }

    /// What it is of.
    pub fn header(&self) -> &Header {
        &self.header
    }
    /// The pixels of each block, row by row of blocks.
    pub fn blocks(&self) -> &[PixelBlock] {
        &self.blocks
    }
    /// Width of the full image; numbers pixels.
    pub fn image_width(&self) -> u32 {
        self.header.frame.image_width
    }
    /// Pixels that are rendered: `[x0, x1, y0, y1]`.
    pub fn bounds(&self) -> [u32; 4] {
        self.header.frame.bounds
    }
    /// In how many parts replicates are kept apart, at most.
    pub fn parts(&self) -> u32 {
        self.header.parts
    }
    /// How many pixels are rendered.
    pub fn pixels(&self) -> u64 {
        self.header.frame.pixels()
    }

    /// Sums of no samples, for the work units of this film.
    pub fn sums(&self) -> BlockSums {
        BlockSums::new(BLOCK_PIXELS, &self.header.channels, self.header.filter_weights)
    }

    fn layout(&self) -> Layout<'_> {
        let Header { channels, filter_weights, parts, .. } = &self.header;
        Layout { channels, filter_weights: *filter_weights, parts: *parts }
    }

    /// Adds the samples of a work unit.
    ///
    /// # Errors
    /// As [`Film::commit`].
    pub fn add(&self, unit: Unit, sums: &BlockSums) -> Result<(), FilmError> {
        self.commit(&Commit { unit, sums, light_paths: 0, splats: &[] })
    }

    /// Adds a work unit and its splats. Nobody sees a part of it.
    ///
    /// # Errors
    /// [`FilmError::Unit`] if it does not belong to this film, [`FilmError::Overlap`] if some of its samples are there
    /// already, [`FilmError::TooMany`]. The film is then as before.
    pub fn commit(&self, commit: &Commit) -> Result<(), FilmError> {
        let Commit { unit: Unit { block, replicate, first, samples }, sums, light_paths, splats } = *commit;
        let wrong = |what: &'static str| Err(FilmError::Unit { what });
        let (layout, parts) = (self.layout(), self.header.parts);
        let Some(pixels) = self.blocks.get(block) else { return wrong("there is no such block") };
        let count = pixels.pixels();
        if replicate >= REPLICATES {
            return wrong("there is no such replicate");
        }
        let range = match first.checked_add(samples) {
            Some(end) if samples > 0 => first..end,
            _ => return wrong("there are no such samples"),
        };
        if !sums.fits(count, layout.channels, layout.filter_weights) {
            return wrong("it has other channels");
        }
        for splat in splats {
            let row = layout.channels.get(splat.channel);
            if !row.is_some_and(|row| block::is_splat(row, &splat.values)) {
                return wrong("a splat to no channel of splats, or of no number");
            }
        }
        let _shared = self.shared();
        for splat in splats {
            // By far: others may be adding, too.
            let full = |block| {
                self.block(block).additions(layout, replicate, splat.channel) > exact::MOST_ADDITIONS / 2
            };
            if self.find(splat.pixel).is_some_and(|(block, _)| full(block)) {
                return Err(FilmError::TooMany);
            }
        }
        {
            let mut state = self.block(block);
            if state.held(replicate).is_some_and(|held| held.meets(&range)) {
                return Err(FilmError::Overlap { pixel: [pixels.x, pixels.y], replicate });
            }
            if u64::from(state.samples()) + u64::from(samples) > exact::MOST_ADDITIONS {
                return Err(FilmError::TooMany);
            }
            state.add(layout, count, replicate, range, sums);
        }
        self.light_paths[(replicate % parts) as usize].fetch_add(light_paths, Ordering::Relaxed);
        for splat in splats {
            if let Some((block, pixel)) = self.find(splat.pixel) {
                let count = self.blocks[block].pixels();
                self.block(block).splat(layout, count, replicate, (splat.channel, pixel), &splat.values);
            }
        }
        Ok(())
    }

    /// Block, and pixel in it, of a pixel of the image.
    fn find(&self, [x, y]: [u32; 2]) -> Option<(usize, usize)> {
        let [x0, x1, y0, y1] = self.bounds();
        if !((x0..x1).contains(&x) && (y0..y1).contains(&y)) {
            return None;
        }
        let [first_column, _, first_row, _] = self.header.frame.blocks();
        let side = BLOCK_SIDE as u32;
        let number =
            (y / side - first_row) as usize * self.block_columns() + (x / side - first_column) as usize;
        let block = &self.blocks[number];
        let pixel =
            block.columns().iter().zip(block.rows()).position(|(&c, &r)| (c, r) == (x % side, y % side))?;
        Some((number, pixel))
    }

    /// Adds the samples of another film of the same header.
    ///
    /// # Errors
    /// [`FilmError::Mismatch`], or [`FilmError::Overlap`] if a sample is in both, or [`FilmError::TooMany`]. The film is
    /// then as before.
    pub fn merge(&self, other: &Film) -> Result<(), FilmError> {
        self.header.check_same(&other.header)?;
        if std::ptr::eq(self, other) {
            return Err(FilmError::Overlap { pixel: [0, 0], replicate: 0 });
        }
        // In one order, whichever is added to the other.
        let (_alone, _other_alone) = match std::ptr::from_ref(self) < std::ptr::from_ref(other) {
            true => {
                let own = self.alone();
                (own, other.alone())
            }
            false => {
                let others = other.alone();
                (self.alone(), others)
            }
        };
        let pairs = || self.state.iter().zip(&other.state).zip(&self.blocks);
        for ((own, other), pixels) in pairs() {
            let (own, other) = (locked(own), locked(other));
            if let Some(replicate) = own.shared_replicate(&other) {
                return Err(FilmError::Overlap { pixel: [pixels.x, pixels.y], replicate });
            }
            if u64::from(own.samples()) + u64::from(other.samples()) > exact::MOST_ADDITIONS {
                return Err(FilmError::TooMany);
            }
        }
        for ((own, other), pixels) in pairs() {
            locked(own).merge(self.layout(), pixels.pixels(), &locked(other));
        }
        for (own, other) in self.light_paths.iter().zip(&other.light_paths) {
            own.fetch_add(other.load(Ordering::Relaxed), Ordering::Relaxed);
        }
        if other.is_split() {
            self.split();
        }
        Ok(())
    }

    /// Those of some samples of a replicate of a block that are not in the film.
    pub fn missing(&self, block: usize, replicate: u32, samples: Range<u32>) -> Vec<Range<u32>> {
        let Some(state) = self.state.get(block) else { return Vec::new() };
        match locked(state).held(replicate) {
            Some(held) => held.missing(samples),
            None if samples.is_empty() => Vec::new(),
            None => vec![samples],
        }
    }

    /// The samples of a replicate of a block that are in the film, as ranges in ascending order.
    pub fn held(&self, block: usize, replicate: u32) -> Vec<Range<u32>> {
        let held = self.state.get(block).map(locked);
        held.and_then(|state| Some(state.held(replicate)?.iter().cloned().collect())).unwrap_or_default()
    }

    /// The same of one of several seeds of the header: see [`Header::seeds`].
    pub fn held_of_seed(&self, block: usize, seed: usize, replicate: u32) -> Vec<Range<u32>> {
        self.held(block, seed as u32 * REPLICATES + replicate)
    }

    /// Whether no sample is in the film.
    pub fn is_empty(&self) -> bool {
        self.state.iter().all(|state| locked(state).held.iter().all(|held| held.len() == 0))
    }

    /// As long as it is held, nobody adds to the film: for those who look at several blocks of a film with splats.
    pub fn hold(&self) -> Held<'_> {
        Held { _alone: self.alone() }
    }

    fn shared(&self) -> RwLockReadGuard<'_, ()> {
        self.whole.read().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn alone(&self) -> RwLockWriteGuard<'_, ()> {
        self.whole.write().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn block(&self, block: usize) -> MutexGuard<'_, FilmBlock> {
        locked(&self.state[block])
    }

    /// Pixel means, and the estimate of their error from the spread of the replicates.
    pub fn develop(&self) -> Developed {
        let mut out = Developed {
            pixels: vec![[0.0; 3]; self.pixels() as usize],
            samples: 0,
            invalid: 0,
            relmse: None,
            relmse_interval: None,
        };
        let mut error = ErrorSum::default();
        for (block, state) in self.blocks.iter().zip(&self.state) {
            let state = locked(state);
            out.samples += u64::from(state.samples()) * block.pixels() as u64;
            out.invalid += state.parts().map(|(_, part)| part.invalid).sum::<u64>();
            self.means(&state, 0, block.pixels(), |pixel, mean| {
                out.pixels[self.place(block, pixel)] = [mean[0] as f32, mean[1] as f32, mean[2] as f32];
            });
            error.merge(&self.block_error(&state, block));
        }
        let estimate = error.estimate();
        out.relmse = estimate.map(|estimate| estimate.relmse);
        out.relmse_interval = estimate.map(|estimate| estimate.interval);
        out
    }

    /// Number of a channel in the header.
    pub fn number_of(&self, channel: Channel) -> Option<usize> {
        self.header.channels.iter().position(|row| *row == channel.row())
    }

    /// Pixel means of a channel, by its number in the header: a plane a component, row by row of the pixels in the bounds.
    /// No planes for what is no number of a channel, or one of names.
    pub fn develop_channel(&self, channel: usize) -> Vec<Vec<f32>> {
        let Some(row) = self.header.channels.get(channel).filter(|row| row.kind != Kind::Keyed) else {
            return Vec::new();
        };
        let mut planes = vec![vec![0.0; self.pixels() as usize]; row.components.len()];
        for (block, state) in self.blocks.iter().zip(&self.state) {
            let state = locked(state);
            self.means(&state, channel, block.pixels(), |pixel, mean| {
                let place = self.place(block, pixel);
                planes.iter_mut().zip(mean).for_each(|(plane, mean)| plane[place] = mean as f32);
            });
        }
        planes
    }

    /// What covers each pixel, in a channel of names: name and share, the largest first; row by row of the pixels in the
    /// bounds. Nothing for other channels.
    pub fn develop_keys(&self, channel: usize) -> Vec<Vec<(u32, f32)>> {
        let Some(row) = self.header.channels.get(channel).filter(|row| row.kind == Kind::Keyed) else {
            return Vec::new();
        };
        let mut out = vec![Vec::new(); self.pixels() as usize];
        for (block, state) in self.blocks.iter().zip(&self.state) {
            let state = locked(state);
            let mut sums = block::Keys::new();
            for channel in self.channels_of(&state, channel, |_| true) {
                for (&key, &weight) in &channel.keys {
                    *sums.entry(key).or_default() += weight;
                }
            }
            for ((pixel, name), weight) in sums {
                let all = match row.divisor {
                    Divisor::Samples => i64::from(state.samples()),
                    _ => state.weight(pixel.into(), |_| true),
                };
                if all > 0 && usize::from(pixel) < block.pixels() {
                    let share = (weight as f64 / all as f64) as f32;
                    out[self.place(block, pixel.into())].push((name, share));
                }
            }
        }
        out.iter_mut().for_each(|keys| keys.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0))));
        out
    }

    /// The estimate of the error alone; none with fewer than two replicates.
    pub fn error(&self) -> Option<ErrorEstimate> {
        // Summed in the order of the blocks, so that threads change nothing.
        let errors: Vec<ErrorSum> =
            (0..self.blocks.len()).into_par_iter().map(|block| self.error_of_block(block).0).collect();
        let mut error = ErrorSum::default();
        errors.iter().for_each(|block| error.merge(block));
        error.estimate()
    }

    /// Both halves of each block: the replicates of even and of odd number.
    pub fn halves(&self) -> Vec<[HalfBlock; 2]> {
        let of_block = |(block, state): (&PixelBlock, &Mutex<FilmBlock>)| {
            let state = locked(state);
            [0, 1].map(|half| HalfBlock {
                pixels: block.pixels() as u64,
                samples: state.samples_of_half(half),
                bounces: state.parts().filter(|(k, _)| k % 2 == half).map(|(_, part)| part.bounces).sum(),
                error: self.error_of_half(&state, block, half),
            })
        };
        // In the order of the blocks, so that threads change nothing.
        (&self.blocks, &self.state).into_par_iter().map(of_block).collect()
    }

    /// From now on both halves of the replicates count the same in a mean, even if one has more samples: for samples
    /// of either half that depend on what the other has seen. Weighed by their samples, the half that has seen more
    /// light would count less.
    pub fn split(&self) {
        self.split.store(true, Ordering::Relaxed);
    }

    /// Rays of all samples beyond those from the camera and towards lights.
    pub fn bounces(&self) -> u64 {
        let of_block =
            |state: &Mutex<FilmBlock>| -> u64 { locked(state).parts().map(|(_, part)| part.bounces).sum() };
        self.state.iter().map(of_block).sum()
    }

    /// Pixel samples that are in the film.
    pub fn sample_count(&self) -> u64 {
        let of_block =
            |(block, pixels): (usize, &PixelBlock)| u64::from(self.samples(block)) * pixels.pixels() as u64;
        self.blocks.iter().enumerate().map(of_block).sum()
    }

    /// Blocks of a row.
    pub fn block_columns(&self) -> usize {
        let [first, end, _, _] = self.header.frame.blocks();
        (end - first) as usize
    }

    /// Fewest and most samples of a pixel.
    pub fn sample_range(&self) -> [u32; 2] {
        let samples = (0..self.blocks.len()).map(|block| self.samples(block));
        samples.fold([u32::MAX, 0], |[least, most], n| [least.min(n), most.max(n)])
    }

    /// Samples of each pixel of a block.
    fn samples(&self, block: usize) -> u32 {
        self.block(block).samples()
    }

    /// The error of a block, and the samples of each of its pixels.
    fn error_of_block(&self, block: usize) -> (ErrorSum, u64) {
        let state = self.block(block);
        (self.block_error(&state, &self.blocks[block]), state.samples().into())
    }

    /// Variance and number of samples of each pixel.
    pub fn statistics(&self) -> PixelStatistics {
        let pixels = self.pixels() as usize;
        let mut out = PixelStatistics { variance: vec![[0.0; 3]; pixels], samples: vec![0; pixels] };
        for (block, state) in self.blocks.iter().zip(&self.state) {
            let state = locked(state);
            let samples = state.samples();
            let variances = Level::detect().run(BlockVariances(self.known(&state, block)));
            for (pixel, variance) in variances.into_iter().enumerate() {
                let place = self.place(block, pixel);
                out.variance[place] = variance.map(|x| x as f32);
                out.samples[place] = samples;
            }
        }
        out
    }

    /// Where a pixel of a block is in a picture.
    fn place(&self, block: &PixelBlock, pixel: usize) -> usize {
        let [x0, x1, y0, _] = self.bounds();
        let (x, y) = (block.x + block.columns()[pixel], block.y + block.rows()[pixel]);
        (y - y0) as usize * (x1 - x0) as usize + (x - x0) as usize
    }

    /// The parts of a channel in a block, by its number in the header.
    fn channels_of<'a>(
        &self,
        state: &'a FilmBlock,
        channel: usize,
        fits: impl Fn(usize) -> bool,
    ) -> impl Iterator<Item = &'a FilmChannel> {
        let (Row { replicated, .. }, number) = self.layout().place_of(channel);
        let replicated = *replicated;
        let parts = state.parts().filter(move |(k, _)| replicated && fits(*k));
        let shared = if replicated { None } else { state.shared.get(number) };
        parts.map(move |(_, part)| &part.channels[number]).chain(shared)
    }

    /// Means of the pixels of a block in a channel, by its number in the header: the sums over replicates are exact, and
    /// rounded once. 0 where negative lobes outweigh the rest.
    fn means(&self, state: &FilmBlock, channel: usize, pixels: usize, mut each: impl FnMut(usize, [f64; 4])) {
        let all = self.side(state, channel, |_| true);
        // The halves of what is not kept apart cannot be told.
        let halves = (self.is_split() && self.header.channels[channel].replicated)
            .then(|| [0, 1].map(|half| self.side(state, channel, |k| k % 2 == half)));
        for pixel in 0..pixels {
            let of_halves = halves.as_ref().and_then(|[a, b]| Some((a.mean(pixel)?, b.mean(pixel)?)));
            let mean = match of_halves {
                Some((a, b)) => core::array::from_fn(|k| 0.5 * (a[k] + b[k])),
                None => all.mean(pixel).unwrap_or_default(),
            };
            each(pixel, mean);
        }
    }

    /// Some parts of a block in a channel.
    fn side<'a>(
        &self,
        state: &'a FilmBlock,
        channel: usize,
        fits: impl Fn(usize) -> bool + Copy,
    ) -> Side<'a> {
        let parts = || state.parts().filter(move |(k, _)| fits(*k)).map(|(_, part)| part);
        let light_paths = self.light_paths.iter().enumerate().filter(|(k, _)| fits(*k));
        Side {
            row: self.header.channels[channel],
            channels: self.channels_of(state, channel, fits).collect(),
            weights: if self.header.filter_weights {
                parts().map(|part| &part.weight[..]).collect()
            } else {
                Vec::new()
            },
            samples: parts().map(|part| i64::from(part.samples)).sum(),
            light_paths: light_paths.map(|(_, paths)| paths.load(Ordering::Relaxed) as i64).sum(),
        }
    }

    fn is_split(&self) -> bool {
        self.split.load(Ordering::Relaxed)
    }

    /// Variance of the mean over that of a mean in which all samples count the same.
    fn split_loss(&self, state: &FilmBlock) -> f64 {
        let [a, b] = [0, 1].map(|half| f64::from(state.samples_of_half(half)));
        if self.is_split() && a > 0.0 && b > 0.0 { (a + b) * (a + b) / (4.0 * a * b) } else { 1.0 }
    }

    /// Relative squared error of the mean of a half, sum over the pixels.
    fn error_of_half(&self, state: &FilmBlock, block: &PixelBlock, half: usize) -> f64 {
        let replicates = Replicates { state, first: half, step: 2 };
        Level::detect().run(BlockErrors(Known { replicates, block, scale: 1.0 })).sum
    }

    fn block_error(&self, state: &FilmBlock, block: &PixelBlock) -> ErrorSum {
        Level::detect().run(BlockErrors(self.known(state, block)))
    }

    /// All replicates of a block.
    fn known<'a>(&self, state: &'a FilmBlock, block: &'a PixelBlock) -> Known<'a> {
        Known { replicates: Replicates::all(state), block, scale: self.split_loss(state) }
    }
}

/// Some parts of a block in a channel.
struct Side<'a> {
    row: &'static Row,
    channels: Vec<&'a FilmChannel>,
    /// By part; none if all weights are 1.
    weights: Vec<&'a [i32]>,
    samples: i64,
    light_paths: i64,
}

impl Side<'_> {
    /// Mean of a pixel; none where negative lobes outweigh the rest.
    fn mean(&self, pixel: usize) -> Option<[f64; 4]> {
        let divisor: i64 = match self.row.divisor {
            Divisor::FilterWeight if self.weights.is_empty() => self.samples,
            Divisor::FilterWeight => self.weights.iter().map(|weights| i64::from(weights[pixel])).sum(),
            Divisor::Samples => self.samples,
            Divisor::Coverage => self.channels.iter().map(|channel| i64::from(channel.coverage[pixel])).sum(),
            Divisor::LightPaths => self.light_paths,
        };
        if divisor <= 0 {
            return None;
        }
        let (mut mean, components) = ([0.0; 4], self.row.components.len());
        for (k, mean) in mean.iter_mut().take(components).enumerate() {
            let (mut bins, mut base) = Default::default();
            for channel in &self.channels {
                let (other, other_base) = channel.sums.get(pixel * components + k);
                exact::merge(&mut bins, &mut base, other, other_base);
            }
            *mean = exact::value(&bins, base) / divisor as f64;
        }
        Some(mean)
    }
}

fn locked(state: &Mutex<FilmBlock>) -> MutexGuard<'_, FilmBlock> {
    state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Largest number of paths that a work unit of `samples` samples has.
pub fn unit_paths(samples: u32) -> usize {
    BLOCK_PIXELS * samples as usize
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init, reason = "lists of ranges, of which there is one here")]
pub(crate) mod tests;
