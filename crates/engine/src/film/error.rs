//! The error of a film's pixels, from the spread of their replicates.

use super::block::{FilmBlock, Part};
use super::{EPSILON, exact};
use wavepath_kernels::generate::{BLOCK_PIXELS, BLOCK_SIDE, PixelBlock};
use wavepath_kernels::isa::{Isa, Kernel};

/// A number a pixel of a block, row by row. Loops over all of them are compiled to vectors; pixels that a block at the
/// border lacks hold zeros.
type Plane = [f64; BLOCK_PIXELS];

const ZEROS: Plane = [0.0; BLOCK_PIXELS];

/// Some replicates of a block, or parts in which several are together: every `step`th.
#[derive(Clone, Copy)]
pub(super) struct Replicates<'a> {
    pub state: &'a FilmBlock,
    pub first: usize,
    pub step: usize,
}

impl<'a> Replicates<'a> {
    pub(super) fn all(state: &'a FilmBlock) -> Self {
        Replicates { state, first: 0, step: 1 }
    }

    /// Those that have samples, and how many.
    #[inline(always)]
    fn used(self) -> impl Iterator<Item = (&'a Part, f64)> {
        let fitting = self.state.parts().filter(move |(k, _)| k % self.step == self.first);
        fitting.filter(|(_, part)| part.samples > 0).map(|(_, part)| (part, f64::from(part.samples)))
    }

    /// Samples of all, and the sum of the squares of their shares.
    #[inline(always)]
    fn samples(self) -> (f64, f64) {
        let samples: f64 = self.used().map(|(_, samples)| samples).sum();
        (samples, self.used().map(|(_, own)| (own / samples) * (own / samples)).sum())
    }
}

/// The sums over the samples of a replicate.
#[derive(Clone)]
struct Sums {
    weight: Plane,
    /// By channel.
    radiance: [Plane; 3],
}

impl Sums {
    const NONE: Sums = Sums { weight: ZEROS, radiance: [ZEROS; 3] };

    #[inline(always)]
    fn planes(&self) -> [&Plane; 4] {
        [&self.weight, &self.radiance[0], &self.radiance[1], &self.radiance[2]]
    }

    #[inline(always)]
    fn planes_mut(&mut self) -> [&mut Plane; 4] {
        let [r, g, b] = &mut self.radiance;
        [&mut self.weight, r, g, b]
    }
}

/// The sums of a block.
struct BlockPlanes {
    /// By replicate, of those that have samples.
    replicates: Vec<Sums>,
    /// Over all of them.
    total: Sums,
}

impl BlockPlanes {
    #[inline(always)]
    fn new(used: Replicates, block: &PixelBlock) -> Self {
        let mut replicates = Vec::with_capacity(used.state.parts.len());
        let mut total = Sums::NONE;
        for (part, samples) in used.used() {
            let mut own = Sums::NONE;
            let radiance = &part.channels[0].sums;
            for pixel in 0..block.pixels() {
                let place = place(block, pixel);
                own.weight[place] = part.weight.get(pixel).map_or(samples, |&weight| f64::from(weight));
                for c in 0..3 {
                    let (bins, base) = radiance.get(3 * pixel + c);
                    own.radiance[c][place] = exact::about(&bins, base);
                }
            }
            for (total, own) in total.planes_mut().into_iter().zip(own.planes()) {
                for p in 0..BLOCK_PIXELS {
                    total[p] += own[p];
                }
            }
            replicates.push(own);
        }
        BlockPlanes { replicates, total }
    }

    /// Variance of the mean of all replicates, by channel, as their spread tells; NaN if there are fewer than two.
    /// `squares` is the sum of the squares of their shares of the samples: with a variance of s a sample, the squared sum
    /// of what a replicate of n samples of N adds beyond its share is s (n - n^2 / N) in the mean, and s N over all.
    #[inline(always)]
    fn variance(&self, squares: f64) -> [Plane; 3] {
        let mut variance = [ZEROS; 3];
        let count = self.replicates.len() as f64;
        let (weight, factor) = (&self.total.weight, (1.0 - squares).recip());
        for (c, variance) in variance.iter_mut().enumerate() {
            let total = &self.total.radiance[c];
            // Of a ratio, to first order: of what each replicate adds to the sum beyond its share.
            for own in &self.replicates {
                for p in 0..BLOCK_PIXELS {
                    let beyond = own.radiance[c][p] - total[p] / weight[p] * own.weight[p];
                    variance[p] += beyond * beyond;
                }
            }
            for p in 0..BLOCK_PIXELS {
                let known = (count > 1.0) & (weight[p] > 0.0);
                variance[p] *= if known { factor / (weight[p] * weight[p]) } else { f64::NAN };
            }
        }
        variance
    }
}

/// Where a pixel of a block is in a plane.
#[inline(always)]
fn place(block: &PixelBlock, pixel: usize) -> usize {
    block.rows()[pixel] as usize * BLOCK_SIDE + block.columns()[pixel] as usize
}

/// How far a neighbourhood reaches, in pixels; it ends with the block.
const REACH: usize = 2;

/// Sums over the neighbourhood of each pixel.
#[inline(always)]
fn around(plane: &Plane) -> Plane {
    let mut rows = ZEROS;
    for row in 0..BLOCK_SIDE {
        let start = row * BLOCK_SIDE;
        let mut padded = [0.0; BLOCK_SIDE + 2 * REACH];
        padded[REACH..REACH + BLOCK_SIDE].copy_from_slice(&plane[start..start + BLOCK_SIDE]);
        for reach in 0..=2 * REACH {
            for column in 0..BLOCK_SIDE {
                rows[start + column] += padded[column + reach];
            }
        }
    }
    let mut sums = ZEROS;
    for row in 0..BLOCK_SIDE {
        for near in row.saturating_sub(REACH)..BLOCK_SIDE.min(row + REACH + 1) {
            for column in 0..BLOCK_SIDE {
                sums[row * BLOCK_SIDE + column] += rows[near * BLOCK_SIDE + column];
            }
        }
    }
    sums
}

/// Sums over the neighbourhood of each pixel without itself.
#[inline(always)]
fn beside(plane: &Plane) -> Plane {
    let mut sums = around(plane);
    for p in 0..BLOCK_PIXELS {
        sums[p] -= plane[p];
    }
    sums
}

/// Some replicates of a block, and the film's part in what they tell.
pub(super) struct Known<'a> {
    pub replicates: Replicates<'a>,
    pub block: &'a PixelBlock,
    /// What variances and errors are multiplied by.
    pub scale: f64,
}

/// The kernel: variances of the means of the pixels of a block, in their order.
pub(super) struct BlockVariances<'a>(pub Known<'a>);

impl Kernel for BlockVariances<'_> {
    type Output = Vec<[f64; 3]>;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> Vec<[f64; 3]> {
        let Known { replicates, block, scale } = self.0;
        let (_, squares) = replicates.samples();
        let variance = BlockPlanes::new(replicates, block).variance(squares);
        let places = (0..block.pixels()).map(|pixel| place(block, pixel));
        places.map(|place| [0, 1, 2].map(|c| scale * variance[c][place])).collect()
    }
}

/// The kernel: estimated errors of the pixels of a block; none if there are fewer than two replicates with samples.
///
/// Each replicate is held against all others, which stand for the reference. With a variance of s a sample, the
/// means of n and of m samples differ by s (1/n + 1/m) in the mean square; the variance of the mean of all is
/// s / (n + m). So squared differences count with the share nm / (n + m)^2, and each replicate tells as much as its share of
/// the samples, n / (n + m): one that has few knows little, and few points are less well stratified. What the error is relative to is the mean
/// of the others, too: relative to a mean that a firefly is part of, no firefly has an error above 1. (That was tried:
/// it stated a quarter of the true error of a Cornell box with caustics.)
///
/// Where few of the samples find any light, most of the means of the others are too dark, and errors relative to
/// them too large: up to seven times at 64 spp. There the means over the pixels beside stand in, as far as pixel and
/// neighbourhood differ by no more than noise. The noise is that of the pixel or of its neighbourhood, whichever is larger:
/// a pixel that has found no light shows none, and one with a firefly hides it in the mean of its neighbourhood. (By the
/// neighbourhood alone, that firefly stood in the means which the other replicates are held against, and the stated error
/// of caustics at 64 spp was 0.82 of the true one.)
pub(super) struct BlockErrors<'a>(pub Known<'a>);

impl Kernel for BlockErrors<'_> {
    type Output = ErrorSum;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> ErrorSum {
        let Known { replicates, block, scale } = self.0;
        let mut out = ErrorSum::default();
        let (samples, squares) = replicates.samples();
        let planes = BlockPlanes::new(replicates, block);
        if planes.replicates.len() < 2 {
            return out;
        }
        let mut present = ZEROS;
        (0..block.pixels()).for_each(|pixel| present[place(block, pixel)] = 1.0);
        let pixels = around(&present);
        // By what squared distances between pixel and neighbourhood are multiplied; 0 where there is no noise.
        let mut nearness = planes.variance(squares);
        for plane in &mut nearness {
            let variance = around(plane);
            for p in 0..BLOCK_PIXELS {
                let variance = (variance[p] / pixels[p]).max(plane[p]);
                plane[p] = if variance > 0.0 { 0.25 / variance } else { 0.0 };
            }
        }
        let mut errors = ZEROS;
        for (own, (_, own_samples)) in planes.replicates.iter().zip(replicates.used()) {
            let share = own_samples * (samples - own_samples) / (samples * samples) * (own_samples / samples);
            let mut others = Sums::NONE;
            for ((others, own), total) in
                others.planes_mut().into_iter().zip(own.planes()).zip(planes.total.planes())
            {
                for p in 0..BLOCK_PIXELS {
                    others[p] = total[p] - own[p];
                }
            }
            let weight_around = beside(&others.weight);
            for (c, nearness) in nearness.iter().enumerate() {
                let radiance_around = beside(&others.radiance[c]);
                for p in 0..BLOCK_PIXELS {
                    let mean = own.radiance[c][p] / own.weight[p];
                    let reference = others.radiance[c][p] / others.weight[p];
                    // Between a pixel's mean and that of the neighbourhood: the more of their distance can be noise, the
                    // nearer to the latter.
                    let mean_around = radiance_around[p] / weight_around[p];
                    let distance = mean_around - reference;
                    let in_noise = distance * distance * nearness[p];
                    let blended = reference + distance / (1.0 + in_noise * in_noise);
                    let noisy = (nearness[p] > 0.0) & (weight_around[p] > 0.0);
                    let relative_to = if noisy { blended } else { reference };
                    let difference = mean - reference;
                    let error = share * difference * difference / (relative_to * relative_to + EPSILON);
                    // Where negative lobes outweigh the rest there is no mean to speak of.
                    let counts = (own.weight[p] > 0.0) & (others.weight[p] > 0.0);
                    errors[p] += if counts { error } else { 0.0 };
                }
            }
        }
        let scale = scale / 3.0;
        (0..block.pixels()).for_each(|pixel| out.add(errors[place(block, pixel)] * scale));
        out
    }
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
