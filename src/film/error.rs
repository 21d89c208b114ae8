//! The error of a film's pixels, from the spread of their replicates.

use super::{FilmBlock, MOST_REPLICATES, Quantum};
use crate::compare::EPSILON;
use wavepath_kernels::generate::{BLOCK_PIXELS, BLOCK_SIDE, PixelBlock};
use wavepath_kernels::isa::{Isa, Kernel};

/// A number a replicate. Loops over all of them are compiled to vectors; those without samples hold zeros.
type Lanes = [f64; MOST_REPLICATES];

/// The sums of a pixel over the samples of each replicate.
#[derive(Clone, Copy, Default)]
pub(super) struct Replicates {
    /// By channel.
    radiance: [Lanes; 3],
    weight: Lanes,
}

impl Replicates {
    #[inline(always)]
    pub(super) fn new(state: &FilmBlock, pixel: usize, quantum: Quantum) -> Self {
        let scale = quantum.value(1);
        let mut out = Replicates::default();
        for (k, (sums, &samples)) in state.sums.iter().zip(&state.samples).enumerate() {
            out.weight[k] = sums.weight.get(pixel).map_or(f64::from(samples), |&weight| weight as f64);
            for (radiance, &sum) in out.radiance.iter_mut().zip(&sums.radiance[pixel]) {
                // In halves, as there is no instruction for the whole; it is off by a rounding at most.
                radiance[k] = ((sum >> 64) as i64 as f64 * TWO_64 + sum as u64 as f64) * scale;
            }
        }
        out
    }

    /// Variance of the mean of all `count` replicates that have samples, as their spread tells; NaN if there are fewer
    /// than two.
    #[inline(always)]
    pub(super) fn variance(&self, count: usize) -> [f64; 3] {
        let weight = sum(&self.weight);
        let mut out = [f64::NAN; 3];
        if count < 2 || weight <= 0.0 {
            return out;
        }
        let count = count as f64;
        for (out, radiance) in out.iter_mut().zip(&self.radiance) {
            let mean = sum(radiance) / weight;
            // Of a ratio, to first order: of what each replicate adds to the sum beyond its share.
            let mut squares = 0.0;
            for k in 0..MOST_REPLICATES {
                let beyond = radiance[k] - mean * self.weight[k];
                squares += beyond * beyond;
            }
            *out = squares * count / (count - 1.0) / (weight * weight);
        }
        out
    }

    /// What all replicates but one add up to, by that one.
    #[inline(always)]
    fn others(&self) -> Self {
        let mut out = *self;
        let others = |lanes: &mut Lanes| {
            let total = sum(lanes);
            for lane in lanes {
                *lane = total - *lane;
            }
        };
        others(&mut out.weight);
        out.radiance.iter_mut().for_each(others);
        out
    }
}

const TWO_64: f64 = 18_446_744_073_709_551_616.0;

#[inline(always)]
fn sum(lanes: &Lanes) -> f64 {
    lanes.iter().sum()
}

/// How far a neighbourhood reaches, in pixels; it ends with the block.
const REACH: usize = 2;

/// Sums over the pixels around one.
#[derive(Clone, Copy, Default)]
struct Neighbourhood {
    pixels: f64,
    /// What all replicates but one add up to, by that one.
    others: Replicates,
    variance: [f64; 3],
}

impl Neighbourhood {
    #[inline(always)]
    fn add(&mut self, other: &Neighbourhood) {
        let add = |to: &mut Lanes, from: &Lanes| {
            for k in 0..MOST_REPLICATES {
                to[k] += from[k];
            }
        };
        self.pixels += other.pixels;
        add(&mut self.others.weight, &other.others.weight);
        for c in 0..3 {
            add(&mut self.others.radiance[c], &other.others.radiance[c]);
            self.variance[c] += other.variance[c];
        }
    }
}

/// The kernel: estimated errors of the pixels of a block; none if there are fewer than two replicates with samples.
pub(super) struct BlockErrors<'a> {
    pub state: &'a FilmBlock,
    pub block: &'a PixelBlock,
    pub quantum: Quantum,
}

impl Kernel for BlockErrors<'_> {
    type Output = ErrorSum;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> ErrorSum {
        let BlockErrors { state, block, quantum } = self;
        let mut errors = ErrorSum::default();
        let count = state.replicates();
        if count < 2 {
            return errors;
        }
        let samples = f64::from(state.samples.iter().sum::<u32>());
        let mut share = Lanes::default();
        for (share, &own) in share.iter_mut().zip(&state.samples) {
            *share = f64::from(own) * (samples - f64::from(own)) / (samples * samples);
        }
        let mut pixels = vec![Replicates::default(); BLOCK_PIXELS];
        let mut single = vec![Neighbourhood::default(); BLOCK_PIXELS];
        for pixel in 0..block.pixels() {
            let place = place(block, pixel);
            let own = Replicates::new(state, pixel, quantum);
            let (others, variance) = (own.others(), own.variance(count));
            pixels[place] = own;
            single[place] = Neighbourhood { pixels: 1.0, others, variance };
        }
        // Over the neighbours of a row, then over those of a column.
        let near = |at: usize| at.saturating_sub(REACH)..BLOCK_SIDE.min(at + REACH + 1);
        let mut rows = vec![Neighbourhood::default(); BLOCK_PIXELS];
        for row in 0..BLOCK_SIDE {
            for column in 0..BLOCK_SIDE {
                for c in near(column) {
                    rows[row * BLOCK_SIDE + column].add(&single[row * BLOCK_SIDE + c]);
                }
            }
        }
        for pixel in 0..block.pixels() {
            let place = place(block, pixel);
            let mut around = Neighbourhood::default();
            for row in near(place / BLOCK_SIDE) {
                around.add(&rows[row * BLOCK_SIDE + place % BLOCK_SIDE]);
            }
            errors.add(relative_error(&pixels[place], &single[place].others, &around, &share, count));
        }
        errors
    }
}

#[inline(always)]
fn place(block: &PixelBlock, pixel: usize) -> usize {
    block.rows[pixel] as usize * BLOCK_SIDE + block.columns[pixel] as usize
}

/// Squared error of a pixel's mean relative to the truth, mean over the channels.
///
/// Each replicate is held against all others, which stand for the reference. With a variance of s a sample, the
/// means of n and of m samples differ by s (1/n + 1/m) in the mean square; the variance of the mean of all is
/// s / (n + m). So squared differences count with the `share` nm / (n + m)^2. What the error is relative to is the mean
/// of the others, too: relative to a mean that a firefly is part of, no firefly has an error above 1. (That was tried:
/// it stated a quarter of the true error of a Cornell box with caustics.)
///
/// Where few of the samples find any light, most of the means of the others are too dark, and errors relative to
/// them too large: up to seven times at 64 spp. There the means over the neighbourhood stand in, as far as pixel
/// and neighbourhood differ by no more than noise.
#[inline(always)]
fn relative_error(
    own: &Replicates,
    others: &Replicates,
    around: &Neighbourhood,
    share: &Lanes,
    count: usize,
) -> f64 {
    // Divisions are what this takes its time for.
    let (mut per_own, mut per_other, mut per_around) = Default::default();
    let invert = |to: &mut Lanes, of: &Lanes| {
        for k in 0..MOST_REPLICATES {
            to[k] = 1.0 / of[k];
        }
    };
    invert(&mut per_own, &own.weight);
    invert(&mut per_other, &others.weight);
    invert(&mut per_around, &around.others.weight);
    let mut errors = Lanes::default();
    for c in 0..3 {
        let variance = around.variance[c] / around.pixels;
        let noisy = variance > 0.0;
        let scale = 0.25 / variance;
        for k in 0..MOST_REPLICATES {
            let mean = own.radiance[c][k] * per_own[k];
            let reference = others.radiance[c][k] * per_other[k];
            // Between a pixel's mean and that of the neighbourhood: the more of their distance can be noise, the nearer
            // to the latter.
            let mean_around = around.others.radiance[c][k] * per_around[k];
            let distance = (reference - mean_around) * (reference - mean_around) * scale;
            let blended = reference + (mean_around - reference) / (1.0 + distance * distance);
            let relative_to = if noisy & (around.others.weight[k] > 0.0) { blended } else { reference };
            let error = share[k] * (mean - reference) * (mean - reference)
                / (relative_to * relative_to + EPSILON);
            // Where negative lobes outweigh the rest there is no mean to speak of.
            let counts = (own.weight[k] > 0.0) & (others.weight[k] > 0.0);
            errors[k] += if counts { error } else { 0.0 };
        }
    }
    sum(&errors) / (3 * count) as f64
}

/// An estimate of the error of a film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorEstimate {
    /// relMSE against the converged picture.
    pub relmse: f64,
    /// Its 95 % interval.
    pub interval: [f64; 2],
}

/// Sums over pixels, whose errors are independent of each other.
///
/// The interval is from the spread over pixels: of two neighbours `a` and `b`, the variance of `a + b` is the mean of
/// `(a - b)^2`, if both expect the same; where they do not, it is less, and the interval too wide.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ErrorSum {
    pub sum: f64,
    pub pixels: u64,
    /// Sum over pairs of neighbours of the squared difference.
    squares: f64,
    /// A pixel whose neighbour is to come.
    last: Option<f64>,
}

impl ErrorSum {
    /// The error of the next pixel.
    #[inline(always)]
    fn add(&mut self, error: f64) {
        self.sum += error;
        self.pixels += 1;
        self.last = match self.last {
            Some(last) => {
                self.squares += (error - last).powi(2);
                None
            }
            None => Some(error),
        };
    }
    pub(super) fn merge(&mut self, other: &ErrorSum) {
        self.sum += other.sum;
        self.pixels += other.pixels;
        self.squares += other.squares + other.last.map_or(0.0, |last| last * last);
    }
    pub(super) fn estimate(&self) -> Option<ErrorEstimate> {
        (self.pixels > 0).then(|| {
            let pixels = self.pixels as f64;
            let relmse = self.sum / pixels;
            let half = 1.96 * self.squares.sqrt() / pixels;
            ErrorEstimate { relmse, interval: [(relmse - half).max(0.0), relmse + half] }
        })
    }
}
