//! The samplers: stratification, uniformity, independence, and the same numbers at every width.

mod statistics;

use core::num::Wrapping;
use statistics::{Mean, assert_chi_squared, assert_distributed, chi_squared_statistic};
use wavepath_kernels::isa::{Isa, Kernel, Level};
use wavepath_kernels::lanes::{Real, Uint};
use wavepath_kernels::queue::MAX_DEPTH;
use wavepath_kernels::sampler::{
    Independent, Sampler, Sobol, Stream, dimension, stream_seed, vertex_dimension,
};

fn stream(pixel: u32, replicate: u32, index: u32) -> Stream<Wrapping<u32>> {
    Stream { seed: stream_seed(7, Wrapping(pixel), replicate), index: Wrapping(index) }
}

fn bits<S: Sampler>(pixel: u32, replicate: u32, index: u32, dimension: u32) -> u32 {
    S::bits(stream(pixel, replicate, index), Wrapping(dimension)).0
}

fn bits2<S: Sampler>(pixel: u32, replicate: u32, index: u32, dimension: u32) -> [u32; 2] {
    S::bits2(stream(pixel, replicate, index), Wrapping(dimension)).map(|x| x.0)
}

/// Every elementary interval of area 2^-k holds exactly one of 2^k points.
fn assert_net(points: &[[u32; 2]], what: &str) {
    let k = points.len().trailing_zeros();
    let mut seen = vec![u32::MAX; points.len()];
    for a in 0..=k {
        let b = k - a;
        for &[x, y] in points {
            let cell = ((x as u64 >> (32 - a)) << b | y as u64 >> (32 - b)) as usize;
            assert_ne!(seen[cell], a, "{what}: two of {} points in a cell of 2^-{a} x 2^-{b}", points.len());
            seen[cell] = a;
        }
    }
}

/// No two purposes of any two vertices share a dimension, nor with the camera, and the first ones are where they were
/// before there were others.
#[test]
fn dimensions_do_not_meet() {
    use dimension::{BSDF, FILTER, LENS, LIGHT, LIGHT_CHOICE, LOBE, ROULETTE};
    let mut all = vec![FILTER, LENS];
    for depth in 0..=MAX_DEPTH + 1 {
        let purposes = [BSDF, LIGHT, LIGHT_CHOICE, ROULETTE, LOBE];
        let own = purposes.map(|purpose| vertex_dimension(Wrapping(depth), purpose).0);
        assert_eq!(own[..4], [2, 3, 4, 5].map(|first| 4 * depth + first));
        all.extend(own);
    }
    let count = all.len();
    all.sort_unstable();
    all.dedup();
    assert_eq!(all.len(), count);
}

#[test]
fn sobol_pairs_are_nets_in_base_two() {
    for pixel in [0, 1, 12_345, 8_294_399] {
        for dimension in [0, 1, 2, 3, 6, 41, 4_094] {
            for k in 0..=10 {
                let points: Vec<_> = (0..1 << k).map(|i| bits2::<Sobol>(pixel, 0, i, dimension)).collect();
                assert_net(&points, &format!("pixel {pixel}, dimension {dimension}"));
            }
        }
    }
}

#[test]
fn sobol_blocks_of_the_sequence_are_nets() {
    // A sequence, not a single net: each aligned block of 2^k points is one. This is what makes samples A..B of a
    // render as good as the first ones. Up to the last index that there is.
    for start in [64u32, 448, 65_536 - 64, 65_536, 1 << 31, u32::MAX - 63] {
        for dimension in [0, 2, 5] {
            let points: Vec<_> = (start..=start + 63).map(|i| bits2::<Sobol>(3, 1, i, dimension)).collect();
            assert_net(&points, &format!("from {start}, dimension {dimension}"));
        }
    }
}

#[test]
fn sobol_goes_beyond_65536_samples() {
    let points: Vec<_> = (0..1 << 18).map(|i| bits2::<Sobol>(77, 0, i, 2)).collect();
    assert_net(&points, "262,144 points");
    let mut single: Vec<_> = (0..1u32 << 18).map(|i| bits::<Sobol>(77, 0, i, 4) >> 14).collect();
    single.sort_unstable();
    assert!(single.iter().enumerate().all(|(i, &x)| i as u32 == x), "262,144 single numbers");
}

#[test]
fn sobol_single_numbers_stratify() {
    for pixel in [0, 99, 1_000_000] {
        for dimension in [4, 5, 8, 9, 1_001] {
            for k in 0..=12 {
                let mut cells: Vec<_> = (0..1u32 << k)
                    .map(|i| (bits::<Sobol>(pixel, 2, i, dimension) as u64) >> (32 - k))
                    .collect();
                cells.sort_unstable();
                assert!(cells.iter().enumerate().all(|(i, &c)| c == i as u64), "{pixel} {dimension} {k}");
            }
        }
    }
}

/// 256 bins over many pixels for each of some samples and dimensions, and 16 x 16 bins for the pairs.
fn assert_uniform<S: Sampler>() {
    const PIXELS: u32 = 1 << 14;
    let indices = [0, 1, 2, 3, 17, 65_536, 1 << 31];
    let dimensions = [0, 1, 2, 3, 4, 5, 30];
    let family = 3 * indices.len() * dimensions.len();
    let expected = [PIXELS as f64 / 256.0; 256];
    for index in indices {
        for dimension in dimensions {
            let what = format!("{}: sample {index}, dimension {dimension}", S::NAME);
            let (mut single, mut low, mut pair) = ([0; 256], [0; 256], [0; 256]);
            for pixel in 0..PIXELS {
                let b = bits::<S>(pixel, 0, index, dimension);
                single[(b >> 24) as usize] += 1;
                low[(b & 255) as usize] += 1;
                let [x, y] = bits2::<S>(pixel, 0, index, dimension);
                pair[(x >> 28 << 4 | y >> 28) as usize] += 1;
            }
            assert_distributed(&format!("{what}, upper bits"), &single, &expected, family);
            assert_distributed(&format!("{what}, lower bits"), &low, &expected, family);
            assert_distributed(&format!("{what}, pairs"), &pair, &expected, family);
        }
    }
}

#[test]
fn sobol_is_uniform_over_pixels() {
    assert_uniform::<Sobol>();
}

#[test]
fn independent_is_uniform_over_pixels() {
    assert_uniform::<Independent>();
}

/// Pairs of numbers that must have nothing to do with each other, by name: dimension, pixel, replicate, index of each.
const STRANGERS: [(&str, [u32; 4], [u32; 4]); 12] = [
    ("filter and lens", [0, 0, 0, 0], [1, 0, 0, 0]),
    ("BSDF and light", [2, 0, 0, 0], [3, 0, 0, 0]),
    ("light and choice of light", [3, 0, 0, 0], [4, 0, 0, 0]),
    ("choice of light and roulette", [4, 0, 0, 0], [5, 0, 0, 0]),
    ("BSDF of two vertices", [2, 0, 0, 0], [6, 0, 0, 0]),
    ("far vertices", [2, 0, 0, 0], [402, 0, 0, 0]),
    ("neighbours in a row", [2, 0, 0, 0], [2, 1, 0, 0]),
    ("neighbours in a column", [2, 0, 0, 0], [2, 1920, 0, 0]),
    ("pixel and dimension exchanged", [2, 3, 0, 0], [3, 2, 0, 0]),
    ("replicates", [2, 0, 0, 0], [2, 0, 1, 0]),
    ("far replicates", [2, 0, 0, 0], [2, 0, 15, 0]),
    ("replicate and pixel exchanged", [2, 1, 0, 0], [2, 0, 1, 0]),
];

/// 16 x 16 bins of (first, second) over the samples of a pixel, the statistic summed over pixels.
///
/// `freedom` degrees for each pixel, after the statistic was scaled. Independent numbers: 255. Owen-scrambled ones
/// fill rows and columns evenly: each 16 samples make a random permutation matrix, in which a cell has the variance
/// (1/16)(15/16) under 15 x 15 degrees of freedom, so that 15/16 of the statistic has their distribution.
fn assert_strangers<S: Sampler>(freedom: f64, scale: f64) {
    const SAMPLES: u32 = 4096;
    const PIXELS: u32 = 48;
    let expected = [SAMPLES as f64 / 256.0; 256];
    for (name, a, b) in STRANGERS {
        let (mut statistic, mut correlation) = (0.0, Mean::default());
        for pixel in 0..PIXELS {
            let mut cells = [0; 256];
            let mut product = 0.0;
            for index in 0..SAMPLES {
                // Spread, so that shifted pixels are not themselves compared.
                let at = |q: [u32; 4]| bits::<S>(pixel * 4_001 + q[1], q[2], index + q[3], q[0]);
                let (x, y) = (at(a), at(b));
                cells[(x >> 28 << 4 | y >> 28) as usize] += 1;
                product += (x as f64 / 4294967296.0 - 0.5) * (y as f64 / 4294967296.0 - 0.5);
            }
            statistic += chi_squared_statistic(&cells, &expected).0;
            correlation.add(12.0 * product / SAMPLES as f64);
        }
        let what = format!("{}: {name}", S::NAME);
        assert_chi_squared(&what, scale * statistic, freedom * PIXELS as f64, STRANGERS.len());
        correlation.assert_near(&format!("{what}, correlation"), 0.0, 0.0);
    }
}

#[test]
fn sobol_dimensions_pixels_and_replicates_are_uncorrelated() {
    assert_strangers::<Sobol>(225.0, 15.0 / 16.0);
}

#[test]
fn independent_dimensions_pixels_and_replicates_are_uncorrelated() {
    assert_strangers::<Independent>(255.0, 1.0);
}

#[test]
fn independent_samples_of_a_pixel_are_uncorrelated() {
    const SAMPLES: u32 = 1 << 16;
    let expected = [SAMPLES as f64 / 256.0; 256];
    let gaps = [1u32, 2, 3, 16, 64, 4096, 1 << 31];
    for dimension in [0, 2, 3, 7] {
        for gap in gaps {
            let mut cells = [0; 256];
            let mut within = [0; 256];
            for index in 0..SAMPLES {
                let x = bits::<Independent>(5, 0, index, dimension);
                let y = bits::<Independent>(5, 0, index.wrapping_add(gap), dimension);
                cells[(x >> 28 << 4 | y >> 28) as usize] += 1;
                let [x, y] = bits2::<Independent>(gap, 0, index, dimension);
                within[(x >> 28 << 4 | y >> 28) as usize] += 1;
            }
            let what = format!("dimension {dimension}, gap {gap}");
            // Pairs that overlap in a chain are not independent of each other, but each cell's count is nearly so.
            assert_distributed(&what, &cells, &expected, 2 * 4 * gaps.len());
            assert_distributed(&format!("{what}, within a pair"), &within, &expected, 2 * 4 * gaps.len());
        }
    }
}

#[test]
fn all_bits_of_the_render_seed_count() {
    let mut seen = std::collections::HashSet::new();
    for bit in 0..64 {
        assert!(seen.insert(stream_seed(1u64 << bit, Wrapping(0), 0).0), "bit {bit}");
    }
    assert!(seen.insert(stream_seed(0, Wrapping(0), 0).0));
}

/// Mean squared error of the mean of `f` over `n` samples, over many pixels.
fn squared_error<S: Sampler>(n: u32, f: impl Fn(f32, f32) -> f64, truth: f64) -> f64 {
    Mean::of((0..400).map(|pixel| {
        let mean = (0..n)
            .map(|i| {
                let [x, y] = S::two::<f32>(stream(pixel, 0, i), Wrapping(2));
                f(x, y)
            })
            .sum::<f64>()
            / n as f64;
        (mean - truth).powi(2)
    }))
    .mean
}

#[test]
fn sobol_converges_faster_than_independent_numbers() {
    // exp(-x) cos(y): integral (1 - 1/e) sin(1).
    let f = |x: f32, y: f32| (-x as f64).exp() * (y as f64).cos();
    let truth = (1.0 - (-1f64).exp()) * 1f64.sin();
    let slope = |few: f64, many: f64| (many / few).ln() / 64f64.ln();
    let independent =
        slope(squared_error::<Independent>(16, f, truth), squared_error::<Independent>(1024, f, truth));
    let sobol = slope(squared_error::<Sobol>(16, f, truth), squared_error::<Sobol>(1024, f, truth));
    // Standard error of a slope from 400 squares of normal variables at each end: sqrt(2 * 2 / 400) / ln 64 = 0.024.
    assert!((independent + 1.0).abs() < 0.12, "independent: {independent}");
    // Owen (1997): n^-3 up to logarithms for smooth integrands.
    assert!(sobol < -2.4, "Owen-scrambled Sobol: {sobol}");
    // Also for an edge, which no smoothness helps with.
    let edge = |x: f32, y: f32| (x + y < 0.7) as u8 as f64;
    let truth = 0.245;
    let gain = squared_error::<Independent>(256, edge, truth) / squared_error::<Sobol>(256, edge, truth);
    assert!(gain > 5.0, "gain at an edge with 256 samples: {gain}");
}

#[test]
fn wide_lanes_draw_the_same_numbers() {
    struct Draw;
    impl Kernel for Draw {
        type Output = ();
        #[inline(always)]
        fn run<I: Isa>(self, _: I) {
            compare::<I::Wide, Sobol>();
            compare::<I::Wide, Independent>();
            compare::<I::Eight, Sobol>();
            compare::<I::Four, Independent>();
            compare::<I::One, Sobol>();
        }
    }
    #[inline(always)]
    fn compare<F: Real, S: Sampler>() {
        for round in 0..64u32 {
            let pixels: [u32; 16] = core::array::from_fn(|i| round * 31 + i as u32);
            let indices: [u32; 16] = core::array::from_fn(|i| (round << 26) ^ (i as u32 * 77));
            let dimensions: [u32; 16] = core::array::from_fn(|i| i as u32 % 7 + round);
            let lanes = Stream {
                seed: stream_seed(7, F::Uint::load(&pixels, 0), round),
                index: F::Uint::load(&indices, 0),
            };
            let dimension = F::Uint::load(&dimensions, 0);
            let (one, two) =
                (S::bits(lanes, dimension).to_array(), S::bits2(lanes, dimension).map(Uint::to_array));
            let unit = S::one::<F>(lanes, dimension).to_array();
            for i in 0..F::LANES {
                let s = stream(pixels[i], round, indices[i]);
                assert_eq!(one[i], S::bits(s, Wrapping(dimensions[i])).0);
                assert_eq!([two[0][i], two[1][i]], S::bits2(s, Wrapping(dimensions[i])).map(|x| x.0));
                assert_eq!(unit[i], S::one::<f32>(s, Wrapping(dimensions[i])));
                assert!((0.0..1.0).contains(&unit[i]));
            }
        }
    }
    Level::available().for_each(|level| level.run(Draw));
}
