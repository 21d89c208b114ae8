//! What a film keeps of a block of pixels, and the sums of a work unit on their way there.

use super::exact::{self, Bins, PackedSums};
use super::ranges::Ranges;
use super::replicates::REPLICATES;
use std::collections::BTreeMap;
use wavepath_kernels::channels::{Divisor, Kind, MOST_COMPONENTS, NOTHING, Row, Values};

/// Weights of things by pixel and name: how much of each pixel each thing covers, in units of a sample.
pub(super) type Keys = BTreeMap<(u16, u32), i64>;

/// Sums over some samples of the pixels of a block: what a work unit collects. [`Film::sums`](super::Film::sums) makes an
/// empty one for a film.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockSums {
    /// As the film has them, radiance first.
    channels: Vec<ChannelSums>,
    /// Sums of the filter's weights, 1 or -1; empty if all are 1.
    weight: Vec<i32>,
    /// Samples that were dropped.
    pub(super) invalid: u64,
    /// Rays that were traced beyond those from the camera and towards lights.
    pub bounces: u64,
    pixels: usize,
}

/// The sums of a channel.
#[derive(Clone, Debug, PartialEq)]
struct ChannelSums {
    row: &'static Row,
    /// By pixel, then by component; empty if the channel is keyed.
    bins: Vec<Bins>,
    bases: Vec<u8>,
    /// Filter weights of the samples that have a value; empty unless they are the divisor.
    coverage: Vec<i32>,
    keys: Keys,
}

impl BlockSums {
    pub(super) fn new(pixels: usize, channels: &[&'static Row], filter_weights: bool) -> Self {
        let of_row = |&row: &&'static Row| ChannelSums {
            row,
            bins: vec![Bins::default(); sums_of(row, pixels)],
            bases: vec![0; sums_of(row, pixels)],
            coverage: vec![0; coverage_of(row, pixels)],
            keys: Keys::new(),
        };
        BlockSums {
            channels: channels.iter().map(of_row).collect(),
            weight: if filter_weights { vec![0; pixels] } else { Vec::new() },
            invalid: 0,
            bounces: 0,
            pixels,
        }
    }

    /// Back to no samples.
    pub fn clear(&mut self) {
        for channel in &mut self.channels {
            channel.bins.fill(Bins::default());
            channel.bases.fill(0);
            channel.coverage.fill(0);
            channel.keys.clear();
        }
        self.weight.fill(0);
        self.invalid = 0;
        self.bounces = 0;
    }

    /// Adds a sample. What is not a number, infinite or negative counts as black and is counted. The weight is that of the
    /// filter, 1 or -1, for a film that keeps weights. A pixel that the block does not have is not there.
    #[inline(always)]
    pub fn add(&mut self, pixel: usize, radiance: [f32; 3], weight: Option<f32>) {
        let sign = match (weight, self.weight.get_mut(pixel)) {
            (Some(weight), Some(sum)) => {
                let sign = if weight < 0.0 { -1 } else { 1 };
                *sum += sign;
                i64::from(sign)
            }
            _ => 1,
        };
        // -0 becomes 0.
        let bits = radiance.map(|x| (x + 0.0).to_bits());
        let most = bits[0].max(bits[1]).max(bits[2]);
        if most >= INFINITE {
            self.invalid += 1;
            return;
        }
        if most == 0 {
            return;
        }
        let channel = &mut self.channels[0];
        let at = 3 * pixel;
        let (Some(bins), Some(bases)) = (channel.bins.get_mut(at..at + 3), channel.bases.get_mut(at..at + 3))
        else {
            return;
        };
        for k in 0..3 {
            exact::add(&mut bins[k], &mut bases[k], bits[k], sign);
        }
    }

    /// Adds the value of a sample in a channel beside radiance: `channel` 0 is the first of those that the film has. Where
    /// the first component is not finite there is no value.
    pub fn add_to_channel(&mut self, channel: usize, pixel: usize, values: Values<f32>, weight: Option<f32>) {
        let Some(channel) = self.channels.get_mut(channel + 1).filter(|_| pixel < self.pixels) else {
            return;
        };
        let sign = if weight.is_some_and(|weight| weight < 0.0) { -1 } else { 1 };
        if channel.row.kind == Kind::Keyed {
            if values[0].to_bits() != NOTHING.to_bits() {
                *channel.keys.entry((pixel as u16, values[0].to_bits())).or_default() += i64::from(sign);
            }
            return;
        }
        let components = channel.row.components.len();
        let values = &values[..components];
        if !is_valid(channel.row, values) {
            self.invalid += (values[0] != NOTHING) as u64;
            return;
        }
        if let Some(coverage) = channel.coverage.get_mut(pixel) {
            *coverage += sign;
        }
        let sums = pixel * components..(pixel + 1) * components;
        for ((value, bins), base) in
            values.iter().zip(&mut channel.bins[sums.clone()]).zip(&mut channel.bases[sums])
        {
            let (magnitude, negative) = (value.to_bits() & 0x7FFF_FFFF, value.to_bits() >> 31);
            exact::add(bins, base, magnitude, i64::from(sign) * (1 - 2 * i64::from(negative)));
        }
    }

    /// Whether these are sums for pixels and channels like those.
    pub(super) fn fits(&self, pixels: usize, channels: &[&'static Row], filter_weights: bool) -> bool {
        // Blocks at the border have fewer pixels than the sums that a worker uses for all blocks.
        self.pixels >= pixels
            && self.channels.iter().map(|channel| channel.row).eq(channels.iter().copied())
            && self.weight.is_empty() != filter_weights
    }
}

const INFINITE: u32 = 0x7F80_0000;

/// Can these values be added up?
fn is_valid(row: &Row, values: &[f32]) -> bool {
    let signed = row.kind == Kind::Sum { signed: true };
    values.iter().all(|value| value.is_finite() && (signed || *value >= 0.0))
}

/// Sums of a channel in a block.
fn sums_of(row: &Row, pixels: usize) -> usize {
    if row.kind == Kind::Keyed { 0 } else { row.components.len().min(MOST_COMPONENTS) * pixels }
}

/// Sums of weights of a channel in a block.
fn coverage_of(row: &Row, pixels: usize) -> usize {
    if row.divisor == Divisor::Coverage && row.kind != Kind::Keyed { pixels } else { 0 }
}

/// A channel of a block in the film.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FilmChannel {
    pub(super) sums: PackedSums,
    pub(super) coverage: Vec<i32>,
    pub(super) keys: Keys,
}

impl FilmChannel {
    pub(super) fn new(row: &Row, pixels: usize) -> Self {
        FilmChannel {
            sums: PackedSums::new(sums_of(row, pixels)),
            coverage: vec![0; coverage_of(row, pixels)],
            keys: Keys::new(),
        }
    }

    /// Sums in a block.
    pub(super) fn sums_per_block(&self) -> usize {
        self.sums.count()
    }

    /// Bytes a pixel, without keys, for so many samples.
    pub(super) fn bytes_per_pixel(row: &Row, samples: u64) -> u64 {
        sums_of(row, 1) as u64 * PackedSums::bytes(samples) + 4 * coverage_of(row, 1) as u64
    }

    fn add(&mut self, samples: u64, unit: &ChannelSums) {
        self.sums.add(samples, &unit.bins, &unit.bases);
        add_weights(&mut self.coverage, &unit.coverage);
        add_keys(&mut self.keys, &unit.keys);
    }

    pub(super) fn merge(&mut self, other: &FilmChannel) {
        self.sums.merge(&other.sums);
        add_weights(&mut self.coverage, &other.coverage);
        add_keys(&mut self.keys, &other.keys);
    }
}

fn add_weights(to: &mut [i32], from: &[i32]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
}

fn add_keys(to: &mut Keys, from: &Keys) {
    for (&key, &weight) in from {
        let sum = to.entry(key).or_default();
        *sum += weight;
        // Nothing and an exact 0 are the same, in whatever order they came.
        if *sum == 0 {
            to.remove(&key);
        }
    }
}

/// The sums over the samples of one or more replicates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    /// Samples of each pixel.
    pub(super) samples: u32,
    /// Samples that were dropped.
    pub(super) invalid: u64,
    /// Rays that were traced beyond those from the camera and towards lights.
    pub(super) bounces: u64,
    /// Sums of the filter's weights; empty if all are 1.
    pub(super) weight: Vec<i32>,
    /// The replicated channels, radiance first.
    pub(super) channels: Vec<FilmChannel>,
}

/// What all blocks of a film have in common.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout<'a> {
    pub(super) channels: &'a [&'static Row],
    pub(super) filter_weights: bool,
    /// Parts that replicates are kept apart in.
    pub(super) parts: u32,
}

impl Layout<'_> {
    pub(super) fn channels_of(&self, replicated: bool) -> impl Iterator<Item = &'static Row> {
        self.channels.iter().copied().filter(move |row| row.replicated == replicated)
    }

    /// The row of a channel, and its place among those that are replicated or among those that are not.
    pub(super) fn place_of(&self, channel: usize) -> (&'static Row, usize) {
        let row = self.channels[channel];
        let before = self.channels[..channel].iter().filter(|other| other.replicated == row.replicated);
        (row, before.count())
    }

    fn part(&self, pixels: usize) -> Part {
        Part {
            samples: 0,
            invalid: 0,
            bounces: 0,
            weight: vec![0; if self.filter_weights { pixels } else { 0 }],
            channels: self.channels_of(true).map(|row| FilmChannel::new(row, pixels)).collect(),
        }
    }
}

/// A block of the film.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct FilmBlock {
    /// Samples that are in it, by seed and replicate: first all replicates of the first seed of the header.
    pub(super) held: Vec<Ranges>,
    /// Replicate `r` is in part `r % parts`; those from the last one that has something on are not there.
    pub(super) parts: Vec<Option<Box<Part>>>,
    /// The channels that are not replicated; empty if there is nothing in the block.
    pub(super) shared: Vec<FilmChannel>,
}

impl FilmBlock {
    /// The samples of a replicate.
    pub(super) fn held(&self, replicate: u32) -> Option<&Ranges> {
        self.held.get(replicate as usize)
    }

    pub(super) fn held_mut(&mut self, replicate: u32) -> &mut Ranges {
        let wanted = replicate as usize + 1;
        if self.held.len() < wanted {
            self.held.resize_with(wanted, Ranges::default);
        }
        &mut self.held[replicate as usize]
    }

    /// Parts, and their numbers.
    pub(super) fn parts(&self) -> impl Iterator<Item = (usize, &Part)> {
        self.parts.iter().enumerate().filter_map(|(k, part)| Some((k, part.as_deref()?)))
    }

    /// The part that a replicate is in.
    pub(super) fn part_mut(&mut self, layout: Layout, replicate: u32, pixels: usize) -> &mut Part {
        let at = (replicate % layout.parts) as usize;
        if self.parts.len() <= at {
            self.parts.resize_with(at + 1, || None);
        }
        self.parts[at].get_or_insert_with(|| Box::new(layout.part(pixels)))
    }

    pub(super) fn shared_mut(&mut self, layout: Layout, pixels: usize) -> &mut [FilmChannel] {
        if self.shared.is_empty() {
            self.shared = layout.channels_of(false).map(|row| FilmChannel::new(row, pixels)).collect();
        }
        &mut self.shared
    }

    /// Samples of a pixel.
    pub(super) fn samples(&self) -> u32 {
        self.parts().map(|(_, part)| part.samples).sum()
    }

    /// Samples of a pixel in the replicates of even (0) or odd (1) number.
    pub(super) fn samples_of_half(&self, half: usize) -> u32 {
        self.parts().filter(|(k, _)| k % 2 == half).map(|(_, part)| part.samples).sum()
    }

    /// Sum of the filter's weights of a pixel, in the parts whose number fits.
    pub(super) fn weight(&self, pixel: usize, fits: impl Fn(usize) -> bool) -> i64 {
        let of_part = |part: &Part| i64::from(part.weight.get(pixel).copied().unwrap_or(part.samples as i32));
        self.parts().filter(|(k, _)| fits(*k)).map(|(_, part)| of_part(part)).sum()
    }

    /// Adds samples that are not in it yet.
    pub(super) fn add(
        &mut self,
        layout: Layout,
        pixels: usize,
        replicate: u32,
        range: std::ops::Range<u32>,
        unit: &BlockSums,
    ) {
        let samples = range.len() as u32;
        self.held_mut(replicate).insert(range);
        let part = self.part_mut(layout, replicate, pixels);
        part.samples += samples;
        part.invalid += unit.invalid;
        part.bounces += unit.bounces;
        add_weights(&mut part.weight, &unit.weight);
        let with = |replicated: bool| {
            unit.channels.iter().filter(move |channel| channel.row.replicated == replicated)
        };
        for (to, from) in part.channels.iter_mut().zip(with(true)) {
            to.add(u64::from(samples), from);
        }
        for (to, from) in self.shared_mut(layout, pixels).iter_mut().zip(with(false)) {
            to.add(u64::from(samples), from);
        }
    }

    /// The replicate of a sample that is in both.
    pub(super) fn shared_replicate(&self, other: &FilmBlock) -> Option<u32> {
        let mut pairs = self.held.iter().zip(&other.held);
        let place = pairs.position(|(own, other)| other.iter().any(|range| own.meets(range)))?;
        Some(place as u32 % REPLICATES)
    }

    /// The same with its seeds at other places.
    pub(super) fn with_seeds(mut self, places: &[usize]) -> FilmBlock {
        for (k, ranges) in std::mem::take(&mut self.held).into_iter().enumerate() {
            let (seed, replicate) = (k / REPLICATES as usize, k as u32 % REPLICATES);
            if let (Some(place), true) = (places.get(seed), ranges.len() > 0) {
                *self.held_mut(*place as u32 * REPLICATES + replicate) = ranges;
            }
        }
        self
    }

    /// Adds another one, with other samples.
    pub(super) fn merge(&mut self, layout: Layout, pixels: usize, other: &FilmBlock) {
        for (replicate, ranges) in (0..).zip(&other.held) {
            ranges.iter().for_each(|range| self.held_mut(replicate).insert(range.clone()));
        }
        for (k, from) in other.parts() {
            let to = self.part_mut(layout, k as u32, pixels);
            to.samples += from.samples;
            to.invalid += from.invalid;
            to.bounces += from.bounces;
            add_weights(&mut to.weight, &from.weight);
            to.channels.iter_mut().zip(&from.channels).for_each(|(to, from)| to.merge(from));
        }
        if !other.shared.is_empty() {
            let shared = self.shared_mut(layout, pixels);
            shared.iter_mut().zip(&other.shared).for_each(|(to, from)| to.merge(from));
        }
    }

    /// How many numbers were added to a sum of a channel at most, in the part that a replicate is in.
    pub(super) fn additions(&self, layout: Layout, replicate: u32, channel: usize) -> u64 {
        let (row, number) = layout.place_of(channel);
        let channels = match row.replicated {
            true => self
                .parts
                .get((replicate % layout.parts) as usize)
                .and_then(Option::as_deref)
                .map(|part| &part.channels),
            false => Some(&self.shared),
        };
        channels.and_then(|channels| channels.get(number)).map_or(0, |channel| channel.sums.additions())
    }

    /// Adds a splat to a channel, by its number in the film.
    pub(super) fn splat(
        &mut self,
        layout: Layout,
        pixels: usize,
        replicate: u32,
        (channel, pixel): (usize, usize),
        values: &Values<f32>,
    ) {
        let (row, number) = layout.place_of(channel);
        let channels = match row.replicated {
            true => &mut self.part_mut(layout, replicate, pixels).channels,
            false => self.shared_mut(layout, pixels),
        };
        let components = row.components.len();
        for (k, value) in values[..components].iter().enumerate() {
            channels[number].sums.add_one(pixel * components + k, *value);
        }
    }
}

/// Whether a splat's values can be added up.
pub(super) fn is_splat(row: &Row, values: &Values<f32>) -> bool {
    row.divisor == Divisor::LightPaths
        && row.kind != Kind::Keyed
        && is_valid(row, &values[..row.components.len()])
}
