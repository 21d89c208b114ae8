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
pub const LEAST_PILOT: u32 = 32;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::tests::{film, unit};

    fn half(pixels: u64, samples: u32, noise: f64) -> HalfBlock {
        let error = noise * pixels as f64 / f64::from(samples);
        HalfBlock { pixels, samples, bounces: 0, error }
    }

    fn blocks(noise: &[f64]) -> Vec<[HalfBlock; 2]> {
        noise.iter().map(|noise| [half(256, 8, *noise); 2]).collect()
    }

    #[test]
    fn samples_follow_the_root_of_the_noise() {
        let shares = Shares::best(&blocks(&[1.0, 4.0]), 2);
        let [[a, _], [b, _]] = shares.density[..] else { panic!() };
        assert!((b / a - 2.0).abs() < 1e-9 && ((a + b) / 2.0 - 1.0).abs() < 1e-9);
        // Errors 1 + 4 evenly, and (1 + 2)^2 / 2 at best.
        assert!((shares.gain - 5.0 / 4.5).abs() < 1e-9);
        let dear = |bounces| [HalfBlock { bounces, ..half(256, 8, 1.0) }; 2];
        let shares = Shares::best(&[dear(0), dear(256 * 8)], 2);
        let [[a, _], [b, _]] = shares.density[..] else { panic!() };
        assert!((a / b - (1.0 + BOUNCE_COST).sqrt()).abs() < 1e-9);
    }

    /// What a half knows decides for the other one.
    #[test]
    fn halves_decide_on_each_other() {
        let mut blocks = blocks(&[1.0; 16]);
        blocks[5][0].error *= 9.0;
        let shares = Shares::best(&blocks, 4);
        let [a, b] = shares.density[5];
        assert!((b / a - 3.0).abs() < 0.8, "{a} {b}");
        assert!(shares.gain < 1.01, "noise that one half alone has seen is no gain: {}", shares.gain);
    }

    #[test]
    fn shares_stay_in_their_range() {
        let mut noise = vec![0.0; 400];
        noise[7] = 1e30;
        noise[300] = f64::NAN;
        let shares = Shares::best(&blocks(&noise), 20);
        assert!(shares.density.iter().flatten().all(|d| (DENSITIES[0]..=DENSITIES[1]).contains(d)));
        assert_eq!(Shares::best(&blocks(&[0.0; 4]), 2), Shares { density: vec![[1.0; 2]; 4], gain: 1.0 });
    }

    /// The budget is kept to a sample of the smallest block, nobody loses samples, and steps are whole.
    #[test]
    fn targets_keep_the_budget() {
        let mut blocks = blocks(&[1.0, 9.0, 0.1, 100.0, 3.0, 0.0]);
        for halves in &mut blocks[4..] {
            *halves = halves.map(|half| HalfBlock { pixels: 48, ..half });
        }
        blocks[2] = blocks[2].map(|half| HalfBlock { samples: 30, ..half });
        let shares = Shares::best(&blocks, 2);
        for (mean, step) in [(32, 2), (37, 4), (64, 4), (1000, 1)] {
            let targets = shares.targets(&blocks, mean, step);
            let mut total = 0;
            for (halves, targets) in blocks.iter().zip(&targets) {
                for (half, target) in halves.iter().zip(targets) {
                    assert!(*target >= half.samples);
                    total += half.pixels * u64::from(*target);
                }
            }
            let budget = u64::from(mean) * blocks.iter().map(|halves| halves[0].pixels).sum::<u64>();
            assert!(total <= budget && total + 48 > budget, "{total} of {budget}");
        }
        let targets = shares.targets(&blocks, 64, 4);
        assert!(targets.iter().flatten().filter(|target| *target % 4 != 0).count() <= 4, "{targets:?}");
    }

    /// Pixels of mean 1, some with rare bright samples: mean and standard error over many films of 64 samples a pixel, 16
    /// of them before a decision. If `cross`, halves decide on each other, as they should; otherwise on themselves.
    fn mean_of_films(cross: bool) -> (f64, f64) {
        let mut state = 77u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        let films = 4000;
        let means: Vec<f64> = (0..films)
            .map(|_| {
                let film = film(4, 64);
                let mut fill = |block: usize, replicate: u32, samples: std::ops::Range<u32>| {
                    let rare: f32 = if block == 2 { 1.0 / 128.0 } else { 0.5 };
                    let mut sums = film.sums();
                    for sample in 0..64 * samples.len() {
                        let value = if random() < rare { rare.recip() } else { 0.0 };
                        sums.add(sample % 64, [value; 3], None);
                    }
                    if !samples.is_empty() {
                        film.add(unit(block, replicate, samples), &sums).unwrap();
                    }
                };
                for (block, replicate) in (0..4).flat_map(|block| (0..4).map(move |k| (block, k))) {
                    fill(block, replicate, 0..4);
                }
                let halves = film.halves();
                let mut shares = Shares::best(&halves, 1);
                if !cross {
                    shares.density.iter_mut().for_each(|density| density.reverse());
                }
                film.split();
                for (block, targets) in shares.targets(&halves, 64, 2).iter().enumerate() {
                    for replicate in 0..4 {
                        let target = (targets[replicate % 2] + 1 - replicate as u32 / 2) / 2;
                        fill(block, replicate as u32, 4..target);
                    }
                }
                let pixels = film.develop().pixels;
                pixels.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / pixels.len() as f64
            })
            .collect();
        let mean = means.iter().sum::<f64>() / films as f64;
        let variance = means.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (films - 1) as f64;
        (mean, (variance / films as f64).sqrt())
    }

    /// No film is too dark for its fireflies having decided on their own dilution. Of 48000 films, the mean is 1.0014 +-
    /// 0.0002, and 0.9952 if halves decide on themselves: what is left comes from the budget, which both halves share.
    #[test]
    fn the_mean_is_unbiased() {
        let (mean, error) = mean_of_films(true);
        assert!((mean - 1.0).abs() < 0.0035 && error < 0.0007, "{mean} +- {error}");
        // The test can fail.
        let (mean, error) = mean_of_films(false);
        assert!(mean < 0.9975, "{mean} +- {error}");
        println!("halves that decide on themselves: {mean} +- {error}");
    }
}
