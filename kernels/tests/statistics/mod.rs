//! What the statistical tests share: random inputs, the chi-squared test, means with their standard error, quadrature.
//!
//! All seeds are fixed, so a test that passes today passes tomorrow. The significance says how likely a *change* of
//! the numbers (another seed, a reordered draw) would fail a correct program: [`SIGNIFICANCE`] for all
//! configurations of one test together, by Sidak's correction.

// Every test file uses its own part of this.
#![allow(dead_code)]

use core::f64::consts::TAU;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability that a whole family of tests rejects something correct.
pub const SIGNIFICANCE: f64 = 1e-3;

/// Bins with fewer expected samples are pooled.
const FEWEST_EXPECTED: f64 = 5.0;

/// SplitMix64 (Steele, Lea, Flood 2014): random inputs that owe nothing to the samplers under test.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x1234_5678_9ABC_DEF0)
    }
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let x = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ x >> 31
    }
    /// Uniform in [0, 1), 24 bits: exact in single and in double precision.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 40) as f64 / 16_777_216.0
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    /// Uniform in the logarithm.
    pub fn magnitude(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }
    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        let z = self.between(-1.0, 1.0);
        let (sin, cos) = self.between(0.0, TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    }
    /// Uniform in the cube [-half, half]^3.
    pub fn point(&mut self, half: f64) -> [f64; 3] {
        core::array::from_fn(|_| self.between(-half, half))
    }
}

/// Probability that a chi-squared variable with `freedom` degrees of freedom exceeds `statistic`.
pub fn chi_squared_tail(statistic: f64, freedom: f64) -> f64 {
    ChiSquared::new(freedom).expect("degrees of freedom").sf(statistic)
}

/// Pearson's statistic and its degrees of freedom. Bins of which fewer than five samples are expected are pooled; many
/// samples in a pool that expects few make the statistic infinite.
pub fn chi_squared_statistic(observed: &[u64], expected: &[f64]) -> (f64, f64) {
    assert_eq!(observed.len(), expected.len());
    let (mut statistic, mut bins) = (0.0, 0.0);
    let mut add = |o: f64, e: f64| {
        statistic += (o - e) * (o - e) / e;
        bins += 1.0;
    };
    let mut pool = (0.0, 0.0);
    for (&o, &e) in observed.iter().zip(expected) {
        assert!(e >= -1e-6, "expected {e} samples");
        if e < FEWEST_EXPECTED {
            pool = (pool.0 + o as f64, pool.1 + e.max(0.0));
            if pool.1 >= FEWEST_EXPECTED {
                add(pool.0, pool.1);
                pool = (0.0, 0.0);
            }
        } else {
            add(o as f64, e);
        }
    }
    // What is left in the pool expects less than five: as a Poisson count it may be some, but not many.
    if pool.0 > 30.0 {
        return (f64::INFINITY, bins);
    }
    (statistic, (bins - 1.0).max(1.0))
}

/// Fails unless the samples observed in the bins agree with the expected numbers, as one of `family` tests.
pub fn assert_distributed(what: &str, observed: &[u64], expected: &[f64], family: usize) {
    let (statistic, freedom) = chi_squared_statistic(observed, expected);
    assert_chi_squared(what, statistic, freedom, family);
}

/// Fails if the statistic is too large, as one of `family` tests.
pub fn assert_chi_squared(what: &str, statistic: f64, freedom: f64, family: usize) {
    let p = if statistic.is_finite() { chi_squared_tail(statistic, freedom) } else { 0.0 };
    let level = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / family as f64);
    assert!(p > level, "{what}: chi squared {statistic:.1} with {freedom} degrees of freedom, p = {p:.2e}");
}

/// Running mean and variance (Welford 1962).
#[derive(Clone, Copy, Default)]
pub struct Mean {
    pub n: f64,
    pub mean: f64,
    squares: f64,
}

impl Mean {
    pub fn of(samples: impl IntoIterator<Item = f64>) -> Self {
        let mut mean = Mean::default();
        samples.into_iter().for_each(|x| mean.add(x));
        mean
    }
    pub fn add(&mut self, x: f64) {
        self.n += 1.0;
        let step = x - self.mean;
        self.mean += step / self.n;
        self.squares += step * (x - self.mean);
    }
    pub fn variance(&self) -> f64 {
        self.squares / (self.n - 1.0)
    }
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.n).sqrt()
    }
    /// Fails unless the mean is within 4.9 standard errors (p = 1e-6) of `want`, or within the relative `rounding`.
    pub fn assert_near(&self, what: &str, want: f64, rounding: f64) {
        let error = (self.mean - want).abs();
        let bound = 4.9 * self.standard_error() + rounding * want.abs();
        assert!(
            error <= bound,
            "{what}: {} +- {}, not {want} (ratio {})",
            self.mean,
            self.standard_error(),
            self.mean / want
        );
    }
}

/// Five-point Gauss-Legendre rule on [0, 1]: nodes and weights.
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_5),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_2),
    (0.5, 0.284_444_444_444_444_4),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_2),
    (0.953_089_922_969_332, 0.118_463_442_528_094_5),
];

/// Integral of `f` over the rectangle `[x0, x1]` times `[y0, y1]`: Gauss-Legendre, quartered until the sum of the
/// parts agrees with the whole to `tolerance` (absolute), at most `depth` times.
pub fn integrate(
    f: &impl Fn(f64, f64) -> f64,
    [x0, x1]: [f64; 2],
    [y0, y1]: [f64; 2],
    tolerance: f64,
    depth: u32,
) -> f64 {
    fn rule(f: &impl Fn(f64, f64) -> f64, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> f64 {
        let mut sum = 0.0;
        for (x, wx) in GAUSS {
            for (y, wy) in GAUSS {
                sum += wx * wy * f(x0 + x * (x1 - x0), y0 + y * (y1 - y0));
            }
        }
        sum * (x1 - x0) * (y1 - y0)
    }
    fn refine(
        f: &impl Fn(f64, f64) -> f64,
        x: [f64; 2],
        y: [f64; 2],
        whole: f64,
        tolerance: f64,
        (depth, most): (u32, u32),
    ) -> f64 {
        let (xm, ym) = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]));
        let parts = [
            ([x[0], xm], [y[0], ym]),
            ([xm, x[1]], [y[0], ym]),
            ([x[0], xm], [ym, y[1]]),
            ([xm, x[1]], [ym, y[1]]),
        ]
        .map(|(x, y)| (x, y, rule(f, x, y)));
        let sum: f64 = parts.iter().map(|p| p.2).sum();
        if depth == 0 || depth <= most && (sum - whole).abs() <= tolerance {
            return sum;
        }
        parts.iter().map(|&(x, y, part)| refine(f, x, y, part, 0.5 * tolerance, (depth - 1, most))).sum()
    }
    let whole = rule(f, [x0, x1], [y0, y1]);
    // Two levels at least: the corner of a light in a bin is not overlooked.
    refine(f, [x0, x1], [y0, y1], whole, tolerance, (depth, depth - 2))
}

/// The sphere of directions, mapped from the unit square around an axis: `q = tan^2(theta / 2) / (spread^2 + that)`.
pub struct Around {
    axis: [f64; 3],
    s: [f64; 3],
    t: [f64; 3],
    spread2: f64,
}

impl Around {
    /// Edges of the bins in q: fine towards 1, where a narrow lobe meets the horizon.
    const EDGES: [f64; 25] = [
        0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85,
        0.9, 0.95, 0.98, 0.995, 0.999, 0.9999, 1.0,
    ];
    const AZIMUTHS: usize = 24;

    pub fn new(axis: [f64; 3], spread: f64) -> Self {
        let [s, t] = tangents(axis);
        Around { axis, s, t, spread2: spread * spread }
    }
    /// The direction, and the solid angle a unit of (q, azimuth).
    pub fn direction(&self, q: f64, phi: f64) -> ([f64; 3], f64) {
        let tan2 = self.spread2 * q / (1.0 - q);
        let (sin, cos) = (2.0 * tan2.sqrt() / (1.0 + tan2), (1.0 - tan2) / (1.0 + tan2));
        let (x, y) = (sin * phi.cos(), sin * phi.sin());
        let v = core::array::from_fn(|k| x * self.s[k] + y * self.t[k] + cos * self.axis[k]);
        (v, 2.0 * self.spread2 / ((1.0 - q) * (1.0 + tan2)).powi(2))
    }
    pub fn bin(&self, v: [f64; 3]) -> usize {
        let (x, y, z) = (dot(v, self.s), dot(v, self.t), dot(v, self.axis));
        let sin = (x * x + y * y).sqrt();
        // tan(theta / 2) = sin / (1 + cos) = (1 - cos) / sin.
        let tan = if z > 0.0 { sin / (1.0 + z) } else { (1.0 - z) / sin };
        let tan2 = tan * tan;
        let q = tan2 / (self.spread2 + tan2);
        let phi = y.atan2(x).rem_euclid(TAU) / TAU;
        let row = Self::EDGES[1..].iter().position(|&edge| q < edge).unwrap_or(Self::EDGES.len() - 2);
        row * Self::AZIMUTHS + ((phi * Self::AZIMUTHS as f64) as usize).min(Self::AZIMUTHS - 1)
    }
    /// Integrals of a function of the direction over all bins.
    pub fn integrals(&self, f: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
        let g = |q: f64, phi: f64| {
            let (v, measure) = self.direction(q, phi);
            f(v) * measure
        };
        let phi = |j: usize| TAU * j as f64 / Self::AZIMUTHS as f64;
        Self::EDGES
            .windows(2)
            .flat_map(|q| (0..Self::AZIMUTHS).map(move |j| ([q[0], q[1]], [phi(j), phi(j + 1)])))
            .map(|(q, phi)| integrate(&g, q, phi, 4e-6, 8))
            .collect()
    }
}

// Vectors in double precision, for the oracles.

pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
pub fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|k| a[k] + b[k])
}
pub fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|k| a[k] - b[k])
}
pub fn scale(a: [f64; 3], s: f64) -> [f64; 3] {
    a.map(|x| x * s)
}
pub fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
pub fn normalize(a: [f64; 3]) -> [f64; 3] {
    scale(a, 1.0 / length(a))
}
pub fn wide(a: [f32; 3]) -> [f64; 3] {
    a.map(f64::from)
}
pub fn narrow(a: [f64; 3]) -> [f32; 3] {
    a.map(|x| x as f32)
}
/// Two unit vectors that make a right-handed frame with the unit vector `n`.
pub fn tangents(n: [f64; 3]) -> [[f64; 3]; 2] {
    let helper = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let s = normalize(cross(helper, n));
    [s, cross(n, s)]
}
