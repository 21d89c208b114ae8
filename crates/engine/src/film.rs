//! The film: exact sums, so that the order of samples, the number of threads and the way a render is cut into parts
//! never change a bit of the image.
//!
//! Floating-point sums depend on their order, and paths end in an order that depends on everything. The film adds
//! integers: each sample is rounded once to a multiple of a quantum, and the sums are 128 bits wide. Integer addition
//! is associative, so any schedule gives the same bits. The quantum is 2^-64 of the brightest light of the scene: far
//! below the rounding of an `f32` for anything that can be seen, and there is room above for 2^25 samples that are
//! each 2^38 times brighter than that light.

mod error;
pub mod live_error;

pub use error::ErrorEstimate;

use error::{BlockErrors, BlockVariances, ErrorSum, Known, Replicates};
use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use wavepath_kernels::generate::{BLOCK_PIXELS, BLOCK_SIDE, PixelBlock};
use wavepath_kernels::isa::Level;
use wavepath_kernels::queue::Requirements;
use wavepath_kernels::scene::Scene;

/// Added to the squared reference in relMSE, the mean of `(I - R)^2 / (R^2 + EPSILON)`: black pixels count, too.
pub const EPSILON: f64 = 0.01;

/// The pixels that are rendered, and their place in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Width of the full image; numbers pixels.
    pub image_width: u32,
    /// Pixels to render: `[x0, x1, y0, y1]`, half open.
    pub bounds: [u32; 4],
}

/// Which multiple of which power of two samples are rounded to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quantum {
    exponent: i32,
}

impl Quantum {
    /// Bits between the quantum and the brightest light.
    const BELOW: i32 = 64;
    /// Bits between the brightest light and the largest sample.
    const ABOVE: i32 = 38;

    /// For a scene whose brightest light has this radiance (or intensity).
    pub fn for_brightest(radiance: f32) -> Self {
        let exponent = if radiance > 0.0 && radiance.is_finite() { radiance.log2().ceil() as i32 } else { 0 };
        Quantum { exponent: exponent - Self::BELOW }
    }

    /// `x` as a multiple of the quantum, to nearest; none if it is not a number, infinite, negative or too large.
    #[inline]
    pub fn count(self, x: f32) -> Option<i128> {
        let bits = x.to_bits();
        if bits >> 31 != 0 {
            // -0 is 0.
            return (bits == 0x8000_0000).then_some(0);
        }
        let field = (bits >> 23) as i32;
        let mantissa = bits & 0x007F_FFFF | if field == 0 { 0 } else { 0x0080_0000 };
        let shift = field.max(1) - 150 - self.exponent;
        if field == 255 || shift > Self::BELOW + Self::ABOVE - 24 {
            return None;
        }
        let mantissa = mantissa as i128;
        Some(if shift >= 0 {
            mantissa << shift
        } else if shift < -25 {
            0
        } else {
            (mantissa + (1 << (-shift - 1))) >> -shift
        })
    }

    /// The number that a count stands for.
    pub fn value(self, count: i128) -> f64 {
        count as f64 * (self.exponent as f64).exp2()
    }
}

/// Sums over some samples of the pixels of a block.
#[derive(Clone, Debug)]
pub struct BlockSums {
    /// Radiance, in quanta, weighted by the filter.
    pub radiance: Vec<[i128; 3]>,
    /// Filter weights; empty if all are 1.
    pub weight: Vec<i64>,
    /// Samples that were dropped.
    pub invalid: u64,
    /// Rays that were traced beyond those from the camera and towards lights.
    pub bounces: u64,
}

impl BlockSums {
    /// No samples of `pixels` pixels.
    pub fn new(pixels: usize, requirements: Requirements) -> Self {
        BlockSums {
            radiance: vec![[0; 3]; pixels],
            weight: if requirements.filter_weights { vec![0; pixels] } else { Vec::new() },
            invalid: 0,
            bounces: 0,
        }
    }
    /// Back to no samples.
    pub fn clear(&mut self) {
        self.radiance.fill([0; 3]);
        self.weight.fill(0);
        self.invalid = 0;
        self.bounces = 0;
    }
    /// Adds a sample. What is not a number, infinite or negative counts as black and is counted.
    #[inline]
    pub fn add(&mut self, quantum: Quantum, pixel: usize, radiance: [f32; 3], weight: Option<f32>) {
        let counts = radiance.map(|x| quantum.count(x));
        let sign = match weight {
            None => 1,
            Some(w) => {
                let sign = if w < 0.0 { -1 } else { 1 };
                self.weight[pixel] += sign;
                sign as i128
            }
        };
        match counts {
            [Some(r), Some(g), Some(b)] => {
                let sum = &mut self.radiance[pixel];
                sum[0] += sign * r;
                sum[1] += sign * g;
                sum[2] += sign * b;
            }
            _ => self.invalid += 1,
        }
    }
}

/// A block of the film.
#[derive(Debug)]
struct FilmBlock {
    /// By replicate.
    sums: Vec<BlockSums>,
    /// Samples of each pixel, by replicate.
    samples: Vec<u32>,
}

impl FilmBlock {
    /// Samples of a pixel in the replicates of even (0) or odd (1) number.
    fn samples_of_half(&self, half: usize) -> u32 {
        self.samples.iter().skip(half).step_by(2).sum()
    }
}

/// The film.
#[derive(Debug)]
pub struct Film {
    /// The pixels of each block.
    pub blocks: Vec<PixelBlock>,
    /// Width of the full image; numbers pixels.
    pub image_width: u32,
    /// Pixels that are rendered: `[x0, x1, y0, y1]`.
    pub bounds: [u32; 4],
    /// Independently scrambled replicates of each pixel.
    pub replicates: u32,
    /// How samples are rounded.
    pub quantum: Quantum,
    /// What the scene needs.
    pub requirements: Requirements,
    state: Vec<Mutex<FilmBlock>>,
    split: AtomicBool,
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
    /// An empty film of the pixels in `bounds` (`[x0, x1, y0, y1]`) of an image `image_width` wide.
    pub fn new(
        image_width: u32,
        bounds: [u32; 4],
        replicates: u32,
        quantum: Quantum,
        requirements: Requirements,
    ) -> Self {
        assert!(replicates as usize <= MOST_REPLICATES);
        let [x0, x1, y0, y1] = bounds;
        let side = BLOCK_SIDE as u32;
        let mut blocks = Vec::new();
        for y in (y0..y1).step_by(BLOCK_SIDE) {
            for x in (x0..x1).step_by(BLOCK_SIDE) {
                let size = |from: u32, to: u32| (to - from).min(side) as usize;
                blocks.push(PixelBlock::new(x, y, size(x, x1), size(y, y1)));
            }
        }
        let state = blocks
            .iter()
            .map(|b| {
                Mutex::new(FilmBlock {
                    sums: vec![BlockSums::new(b.pixels(), requirements); replicates as usize],
                    samples: vec![0; replicates as usize],
                })
            })
            .collect();
        let split = AtomicBool::new(false);
        Film { blocks, image_width, bounds, replicates, quantum, requirements, state, split }
    }

    /// An empty film for `spp` samples of each pixel of a scene; `None`: as many as the time allows.
    pub fn for_render(frame: Frame, scene: &Scene, requirements: Requirements, spp: Option<u32>) -> Self {
        let replicates = replicates_for(spp, pixels_in(frame.bounds), requirements);
        let quantum = Quantum::for_brightest(scene.brightest());
        Film::new(frame.image_width, frame.bounds, replicates, quantum, requirements)
    }

    /// Replicates that [`Film::for_render`] keeps of each pixel.
    pub fn replicates_for_render(frame: Frame, requirements: Requirements, spp: Option<u32>) -> u32 {
        replicates_for(spp, pixels_in(frame.bounds), requirements)
    }

    /// Bytes that [`Film::for_render`] takes.
    pub fn bytes_for_render(frame: Frame, requirements: Requirements, spp: Option<u32>) -> u64 {
        let pixels = pixels_in(frame.bounds);
        Film::bytes(pixels, replicates_for(spp, pixels, requirements), requirements)
    }

    /// Bytes of a film.
    pub fn bytes(pixels: u64, replicates: u32, requirements: Requirements) -> u64 {
        let weight = if requirements.filter_weights { size_of::<i64>() } else { 0 };
        pixels * replicates as u64 * (size_of::<[i128; 3]>() + weight) as u64
    }

    /// How many pixels are rendered.
    pub fn pixels(&self) -> u64 {
        pixels_in(self.bounds)
    }

    /// Adds the sums of `samples` samples of each pixel of a block.
    pub fn add(&self, block: usize, replicate: u32, samples: u32, sums: &BlockSums) {
        let mut state = self.state[block].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        state.samples[replicate as usize] += samples;
        let to = &mut state.sums[replicate as usize];
        for (to, from) in to.radiance.iter_mut().zip(&sums.radiance) {
            for (to, from) in to.iter_mut().zip(from) {
                *to += from;
            }
        }
        for (to, from) in to.weight.iter_mut().zip(&sums.weight) {
            *to += from;
        }
        to.invalid += sums.invalid;
        to.bounces += sums.bounces;
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
            let state = state.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            out.samples += state.samples.iter().map(|&n| n as u64).sum::<u64>() * block.pixels() as u64;
            out.invalid += state.sums.iter().map(|s| s.invalid).sum::<u64>();
            for pixel in 0..block.pixels() {
                out.pixels[self.place(block, pixel)] = self.mean(&state, pixel);
            }
            error.merge(&self.block_error(&state, block));
        }
        let estimate = error.estimate();
        out.relmse = estimate.map(|estimate| estimate.relmse);
        out.relmse_interval = estimate.map(|estimate| estimate.interval);
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
            let state = state.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            [0, 1].map(|half| HalfBlock {
                pixels: block.pixels() as u64,
                samples: state.samples_of_half(half),
                bounces: state.sums.iter().skip(half).step_by(2).map(|sums| sums.bounces).sum(),
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

    /// Blocks of a row.
    pub fn block_columns(&self) -> usize {
        (self.bounds[1] - self.bounds[0]).div_ceil(BLOCK_SIDE as u32) as usize
    }

    /// Fewest and most samples of a pixel.
    pub fn sample_range(&self) -> [u32; 2] {
        let samples = (0..self.blocks.len()).map(|block| self.samples(block));
        samples.fold([u32::MAX, 0], |[least, most], n| [least.min(n), most.max(n)])
    }

    /// Samples of each pixel of a block.
    fn samples(&self, block: usize) -> u32 {
        let state = self.state[block].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        state.samples.iter().sum()
    }

    /// The error of a block, and the samples of each of its pixels.
    fn error_of_block(&self, block: usize) -> (ErrorSum, u64) {
        let state = self.state[block].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let samples = state.samples.iter().map(|&n| n as u64).sum();
        (self.block_error(&state, &self.blocks[block]), samples)
    }

    /// Variance and number of samples of each pixel.
    pub fn statistics(&self) -> PixelStatistics {
        let pixels = self.pixels() as usize;
        let mut out = PixelStatistics { variance: vec![[0.0; 3]; pixels], samples: vec![0; pixels] };
        for (block, state) in self.blocks.iter().zip(&self.state) {
            let state = state.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            let samples = state.samples.iter().sum();
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
        let [x0, x1, y0, _] = self.bounds;
        let (x, y) = (block.x + block.columns()[pixel], block.y + block.rows()[pixel]);
        (y - y0) as usize * (x1 - x0) as usize + (x - x0) as usize
    }

    /// Mean of one pixel: the sum over replicates is exact, and rounded once.
    fn mean(&self, state: &FilmBlock, pixel: usize) -> [f32; 3] {
        if self.is_split() {
            let halves = [0, 1].map(|half| self.mean_of(state, pixel, half, 2));
            if let [Some(a), Some(b)] = halves {
                return core::array::from_fn(|k| (0.5 * (a[k] + b[k])) as f32);
            }
        }
        self.mean_of(state, pixel, 0, 1).map_or([0.0; 3], |mean| mean.map(|x| x as f32))
    }

    /// Mean of a pixel in some replicates; none where negative lobes outweigh the rest.
    fn mean_of(&self, state: &FilmBlock, pixel: usize, first: usize, step: usize) -> Option<[f64; 3]> {
        let sums = || state.sums.iter().skip(first).step_by(step);
        let weight: i64 = if self.requirements.filter_weights {
            sums().filter_map(|sums| sums.weight.get(pixel)).sum()
        } else {
            state.samples.iter().skip(first).step_by(step).map(|&n| i64::from(n)).sum()
        };
        let total = |k| self.quantum.value(sums().map(|sums| sums.radiance[pixel][k]).sum());
        (weight > 0).then(|| core::array::from_fn(|k| total(k) / weight as f64))
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
        let known = Known { replicates, block, quantum: self.quantum, scale: 1.0 };
        Level::detect().run(BlockErrors(known)).sum
    }

    fn block_error(&self, state: &FilmBlock, block: &PixelBlock) -> ErrorSum {
        Level::detect().run(BlockErrors(self.known(state, block)))
    }

    /// All replicates of a block.
    fn known<'a>(&self, state: &'a FilmBlock, block: &'a PixelBlock) -> Known<'a> {
        let (replicates, scale) = (Replicates::all(state), self.split_loss(state));
        Known { replicates, block, quantum: self.quantum, scale }
    }
}

/// Most replicates of a film.
const MOST_REPLICATES: usize = 8;

/// Pixels in `[x0, x1, y0, y1]`.
fn pixels_in([x0, x1, y0, y1]: [u32; 4]) -> u64 {
    (x1 - x0) as u64 * (y1 - y0) as u64
}

/// How many replicates for so many samples of so many pixels: enough for an estimate of the image's error, few enough
/// that each keeps the advantage of stratified samples, and that the film stays below 4 GiB where two will do that.
fn replicates_for(spp: Option<u32>, pixels: u64, requirements: Requirements) -> u32 {
    const FILM_BYTES: u64 = 4 << 30;
    let mut replicates = match spp {
        Some(0..4) => 1,
        Some(4..32) => 2,
        Some(32..128) => 4,
        _ => 8,
    };
    while replicates > 2 && Film::bytes(pixels, replicates, requirements) > FILM_BYTES {
        replicates /= 2;
    }
    replicates
}

/// Largest number of paths that a work unit of `samples` samples has.
pub fn unit_paths(samples: u32) -> usize {
    BLOCK_PIXELS * samples as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_round_to_nearest_and_refuse_what_is_invalid() {
        let quantum = Quantum::for_brightest(1.0);
        for x in [0.0, 1.0, 0.3, 1e-6, 123.456, 1e9] {
            let back = quantum.value(quantum.count(x).unwrap());
            assert!((back - x as f64).abs() <= (-64.0f64).exp2(), "{x} came back as {back}");
        }
        assert_eq!(quantum.count(-0.0), Some(0));
        for x in [f32::NAN, f32::INFINITY, -1.0, -1e-30, 1e12] {
            assert_eq!(quantum.count(x), None, "{x}");
        }
        assert_eq!(quantum.count(f32::MIN_POSITIVE / 8.0), Some(0));
        let dim = Quantum::for_brightest(1e-30);
        let x = 3.25e-31;
        assert!((dim.value(dim.count(x).unwrap()) / x as f64 - 1.0).abs() < 1e-7);
    }

    #[test]
    fn sums_do_not_depend_on_their_order() {
        let quantum = Quantum::for_brightest(10.0);
        let samples: Vec<[f32; 3]> = (0..1000)
            .map(|k| [(k as f32 * 0.37).sin().abs() * 1e3, 1.0 / (k + 1) as f32, k as f32])
            .collect();
        let sum = |order: &mut dyn Iterator<Item = &[f32; 3]>| {
            let mut sums = BlockSums::new(1, Requirements::default());
            order.for_each(|s| sums.add(quantum, 0, *s, None));
            sums.radiance[0]
        };
        assert_eq!(sum(&mut samples.iter()), sum(&mut samples.iter().rev()));
    }

    #[test]
    fn invalid_samples_are_black_and_counted() {
        let film = Film::new(4, [0, 4, 0, 4], 2, Quantum::for_brightest(1.0), Requirements::default());
        let mut sums = BlockSums::new(16, Requirements::default());
        for pixel in 0..16 {
            sums.add(film.quantum, pixel, [1.0, 2.0, 0.5], None);
        }
        sums.add(film.quantum, 0, [f32::NAN, 1.0, 1.0], None);
        film.add(0, 0, 1, &sums);
        film.add(0, 1, 1, &sums);
        let picture = film.develop();
        assert_eq!((picture.invalid, picture.samples), (2, 32));
        assert_eq!(picture.pixels[15], [1.0, 2.0, 0.5]);
        assert_eq!(picture.relmse, Some(0.0));
    }
}
