//! Adaptive sampling: blocks of pixels get samples in proportion to their noise.
//!
//! A round gives out samples; then the film says how noisy each block is, and the next round brings every block nearer
//! to its share. A block whose pixels have a squared relative error of `v` with one sample has `v / n` with `n` of them,
//! which take the time `c n`. The sum of the errors is least, for a given time, with `n` in proportion to
//! `sqrt(v / c)` (Neyman 1934).
//!
//! What decides on the samples of a pixel must not depend on what that pixel happened to see: one whose first samples
//! are bright would get more of them, which dilute those, one whose first samples are dark would keep them, and the
//! picture would be too dark (Kirk and Arvo 1991). So each block has two halves, the replicates of even and of odd number.
//! The noise of either decides on the samples of the other, and both count the same in the mean, whatever samples they
//! have (see [`Film::split`]).
//!
//! All of this is a function of the film's exact sums after whole rounds: threads, batch and engine change nothing.
//!
//! [`Film::split`]: crate::film::Film::split

use crate::film::HalfBlock;

/// Least samples of each pixel before the first decision.
pub const LEAST_PILOT: u32 = 16;

/// Least replicates of a film: the noise of a half shows in two of them.
pub const LEAST_REPLICATES: u32 = 4;

/// Fewest and most samples of a half block, relative to the mean.
const DENSITIES: [f64; 2] = [0.125, 16.0];

/// Predicted gain from which on samples are spread unevenly. Noisy blocks show more geometry, and a ray takes longer there
/// than elsewhere, which the prediction does not know: of a gain of 1.2, nothing is left in `spotlight.pbrt`.
pub const LEAST_GAIN: f64 = 1.25;

/// The noise of a block is taken for at least this part of that of the blocks around it.
const FROM_NEIGHBOURS: f64 = 0.25;

/// Cost of a ray that goes on along a path and of all that is done for it, with that of a ray from the camera for unit.
const BOUNCE_COST: f64 = 3.0;

/// How samples are to be spread.
#[derive(Clone, Debug, PartialEq)]
pub struct Shares {
    /// Samples of each half of each block, relative to the mean over all pixels.
    pub density: Vec<[f64; 2]>,
    /// Predicted efficiency, 1 / (relMSE x time), over that of samples spread evenly.
    pub gain: f64,
}

impl Shares {
    /// The best shares for blocks that lie row by row, `columns` in each.
    ///
    /// # Panics
    /// If the blocks are not whole rows of them.
    pub fn best(blocks: &[[HalfBlock; 2]], columns: usize) -> Self {
        assert!(columns > 0 && blocks.len().is_multiple_of(columns));
        let pixels = || blocks.iter().map(|halves| halves[0].pixels as f64);
        let cost: Vec<f64> = blocks.iter().map(cost).collect();
        let noise: Vec<[f64; 2]> =
            (0..blocks.len()).map(|k| [0, 1].map(|half| noise(blocks, columns, k, half))).collect();
        let best: Vec<[f64; 2]> = noise
            .iter()
            .zip(&cost)
            .map(|(noise, cost)| [(noise[1] / cost).sqrt(), (noise[0] / cost).sqrt()])
            .collect();
        let flat = || best.iter().flatten().copied().filter(|best| *best > 0.0);
        let least = flat().fold(f64::INFINITY, f64::min);
        if least == f64::INFINITY {
            return Shares { density: vec![[1.0; 2]; blocks.len()], gain: 1.0 };
        }
        let [low, high] = DENSITIES;
        let density =
            |scale: f64| best.iter().map(move |best| best.map(|best| (scale * best).clamp(low, high)));
        // Over all pixels of both halves.
        let sum = |values: &mut dyn Iterator<Item = [f64; 2]>| -> f64 {
            pixels().zip(values).map(|(pixels, [a, b])| pixels * (a + b)).sum()
        };
        let all = sum(&mut std::iter::repeat([1.0; 2]));
        let scale = largest(high / least, all, |scale| sum(&mut density(scale)));
        let density: Vec<[f64; 2]> = density(scale).collect();
        // A half's noise is independent of its density: the prediction is not better than the truth.
        let error = sum(&mut noise.iter().zip(&density).map(|(v, d)| [v[0] / d[0], v[1] / d[1]]));
        let time = sum(&mut cost.iter().zip(&density).map(|(c, d)| d.map(|d| c * d)));
        let even = sum(&mut noise.iter().copied()) * sum(&mut cost.iter().map(|c| [*c; 2]));
        Shares { density, gain: even / (error * time) }
    }

    /// Samples of a pixel in each half of each block: `mean` for both halves together, on average over the pixels, but
    /// never less than there are. As many as there can be are multiples of `step`.
    pub fn targets(&self, blocks: &[[HalfBlock; 2]], mean: u32, step: u32) -> Vec<[u32; 2]> {
        let pixels = |cell: usize| blocks[cell / 2][cell % 2].pixels;
        let present = |cell: usize| blocks[cell / 2][cell % 2].samples;
        let cells = 0..2 * blocks.len();
        let mut left = mean as u64 * cells.clone().map(pixels).sum::<u64>() / 2;
        let wanted = |scale: f64, cell: usize| {
            let share = self.density[cell / 2][cell % 2] * 0.5 * f64::from(mean);
            (scale * share).max(f64::from(present(cell)))
        };
        let scale = largest(1.0, left as f64, |scale| {
            cells.clone().map(|cell| pixels(cell) as f64 * wanted(scale, cell)).sum()
        });
        let mut targets = vec![[0; 2]; blocks.len()];
        let mut lacking = Vec::with_capacity(cells.len());
        for cell in cells {
            let wanted = wanted(scale, cell);
            let target = (wanted as u32 / step * step).max(present(cell));
            targets[cell / 2][cell % 2] = target;
            lacking.push((wanted - f64::from(target), cell));
            left = left.saturating_sub(pixels(cell) * u64::from(target));
        }
        // What rounding left over goes to those that lack most.
        lacking.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for step in [step, 1] {
            for &(_, cell) in &lacking {
                let samples = pixels(cell) * u64::from(step);
                if samples <= left {
                    targets[cell / 2][cell % 2] += step;
                    left -= samples;
                }
            }
        }
        targets
    }
}

/// The largest argument up to `most` for which a growing function is at most `value`.
fn largest(most: f64, value: f64, f: impl Fn(f64) -> f64) -> f64 {
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

/// Mean cost of a sample of a block, in rays from the camera.
fn cost(halves: &[HalfBlock; 2]) -> f64 {
    let samples: u64 = halves.iter().map(|half| half.pixels * u64::from(half.samples)).sum();
    let bounces: u64 = halves.iter().map(|half| half.bounces).sum();
    1.0 + BOUNCE_COST * bounces as f64 / samples.max(1) as f64
}

/// The squared relative error of one sample, mean over the pixels, as a half of a block knows it.
fn noise(blocks: &[[HalfBlock; 2]], columns: usize, block: usize, half: usize) -> f64 {
    let sum = |half: &HalfBlock| {
        let noise = half.error * f64::from(half.samples);
        if noise.is_finite() { noise.max(0.0) } else { 0.0 }
    };
    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let (mut around, mut pixels) = (0.0, 0.0);
    for row in near(block / columns, blocks.len() / columns) {
        for column in near(block % columns, columns) {
            let other = &blocks[row * columns + column][half];
            around += sum(other);
            pixels += other.pixels as f64;
        }
    }
    let own = &blocks[block][half];
    (sum(own) / own.pixels as f64).max(FROM_NEIGHBOURS * around / pixels)
}
