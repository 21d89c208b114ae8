//! Adaptive sampling: blocks of pixels get samples in proportion to their noise.
//!
//! A round gives out samples, the next one looks at what the film says and brings every block nearer to its share. A
//! block whose pixels have a squared relative error of `v` with one sample has `v / n` with `n` of them; the sum over
//! all blocks is least, for a given sum of the samples, with `n` in proportion to `sqrt(v)` (Neyman's allocation).
//!
//! What decides on the samples of a pixel must not depend on what that pixel happened to see, or it will be too dark:
//! a pixel whose first samples are bright gets more of them, one whose first samples are dark keeps them (Kirk and Arvo
//! 1991). So blocks are as large as they are, look at their neighbours too, and have [`LEAST_PILOT`] samples before
//! anything is decided; and shares stay between [`LEAST_DENSITY`] and [`MOST_DENSITY`].
//!
//! All of this is a function of the film's exact sums after whole rounds: threads, batch and engine change nothing.

use crate::film::BlockError;

/// Least samples of each pixel before the first decision.
pub const LEAST_PILOT: u32 = 8;

/// Fewest samples of a block, relative to the mean.
const LEAST_DENSITY: f64 = 0.125;

/// Most samples of a block, relative to the mean.
const MOST_DENSITY: f64 = 16.0;

/// Least gain for which samples are spread unevenly.
const LEAST_GAIN: f64 = 1.15;

fn tune(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|x| x.parse().ok()).unwrap_or(default)
}

/// How samples are to be spread.
#[derive(Clone, Debug, PartialEq)]
pub struct Shares {
    /// Samples of each block, relative to the mean over all pixels.
    pub density: Vec<f64>,
    /// relMSE of as many samples spread evenly, over that of these shares.
    pub gain: f64,
}

impl Shares {
    /// The same for all.
    pub fn even(blocks: usize) -> Self {
        Shares { density: vec![1.0; blocks], gain: 1.0 }
    }

    /// The best shares for blocks that lie row by row, `columns` in each; even ones where these gain too little.
    pub fn best(blocks: &[BlockError], columns: usize) -> Self {
        let noise = smoothed(blocks, columns);
        let pixels = blocks.iter().map(|block| block.pixels as f64);
        let all: f64 = pixels.clone().sum();
        let share = |scale: f64, noise: f64| {
            (scale * noise.sqrt()).clamp(tune("LOW", LEAST_DENSITY), tune("HIGH", MOST_DENSITY))
        };
        let largest = noise.iter().copied().fold(0.0, f64::max).sqrt();
        let least = noise.iter().copied().filter(|noise| *noise > 0.0).fold(f64::INFINITY, f64::min).sqrt();
        if largest <= 0.0 {
            return Shares::even(blocks.len());
        }
        // Between a scale that leaves all at the bottom and one that takes all that have any noise to the top.
        let scale = solve(MOST_DENSITY / least, all, |scale| {
            pixels.clone().zip(&noise).map(|(pixels, noise)| pixels * share(scale, *noise)).sum()
        });
        let density: Vec<f64> = noise.iter().map(|noise| share(scale, *noise)).collect();
        let error = |density: &dyn Fn(usize) -> f64| -> f64 {
            pixels.clone().zip(&noise).enumerate().map(|(k, (p, noise))| p * noise / density(k)).sum()
        };
        let gain = error(&|_| 1.0) / error(&|block| density[block]);
        if gain < tune("GAIN", LEAST_GAIN) { Shares { gain, ..Shares::even(blocks.len()) } } else { Shares { density, gain } }
    }

    /// Samples of a pixel of each block, `mean` on average, never less than there are; multiples of `step` as far as
    /// that leaves no samples over.
    pub fn targets(&self, blocks: &[BlockError], mean: u32, step: u32) -> Vec<u32> {
        let mut left: u64 = blocks.iter().map(|block| block.pixels).sum::<u64>() * mean as u64;
        let wanted = |scale: f64, k: usize| (scale * self.density[k] * mean as f64).max(blocks[k].samples as f64);
        let scale = solve(1.0, left as f64, |scale| {
            (0..blocks.len()).map(|k| blocks[k].pixels as f64 * wanted(scale, k)).sum()
        });
        let mut order: Vec<(f64, usize)> = Vec::with_capacity(blocks.len());
        let mut targets: Vec<u32> = Vec::with_capacity(blocks.len());
        for (k, block) in blocks.iter().enumerate() {
            let wanted = wanted(scale, k);
            let whole = (wanted as u32 / step * step).max(block.samples as u32);
            left = left.saturating_sub(block.pixels * whole as u64);
            order.push((wanted - whole as f64, k));
            targets.push(whole);
        }
        // What rounding left over goes to those that lack most.
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for step in [step, 1] {
            for &(_, k) in &order {
                if blocks[k].pixels * step as u64 <= left {
                    targets[k] += step;
                    left -= blocks[k].pixels * step as u64;
                }
            }
        }
        targets
    }
}

/// The largest argument up to `most` for which a growing function is at most `value`.
fn solve(most: f64, value: f64, f: impl Fn(f64) -> f64) -> f64 {
    if f(most) <= value {
        return most;
    }
    let (mut low, mut high) = (0.0, most);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if f(middle) <= value { low = middle } else { high = middle }
    }
    low
}

/// The squared relative error of one sample, mean over the pixels of a block and its neighbours.
fn smoothed(blocks: &[BlockError], columns: usize) -> Vec<f64> {
    let rows = blocks.len() / columns;
    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let centre = tune("CENTRE", 2.0);
    let maximum = tune("MAX", 0.0) > 0.0;
    let own = |k: usize| {
        let b = &blocks[k];
        let v = b.error * b.samples as f64 / b.pixels as f64;
        if v.is_finite() && v > 0.0 { v } else { 0.0 }
    };
    let mut out = Vec::with_capacity(blocks.len());
    for row in 0..rows {
        for column in 0..columns {
            let (mut sum, mut weights) = (0.0, 0.0);
            for r in near(row, rows) {
                for c in near(column, columns) {
                    let k = r * columns + c;
                    let w = (if r == row { centre } else { 1.0 }) * (if c == column { centre } else { 1.0 });
                    let w = w * blocks[k].pixels as f64;
                    sum += w * own(k);
                    weights += w;
                }
            }
            let s = sum / weights;
            out.push(if maximum { s.max(own(row * columns + column)) } else { s });
        }
    }
    out
}
