//! Random numbers as pure functions of (seed, pixel, replicate, sample, dimension).
//!
//! A stream is two words: `seed`, a hash of (render seed, pixel, replicate), and `index`, the number of the sample
//! within its replicate. A path draws pairs and single numbers by dimension; nothing is stored between draws, so
//! paths can be cut, sorted and continued anywhere. Dimensions are laid out in [`dimension`].

use crate::lanes::{Real, Uint};
use core::num::Wrapping;

/// Which number serves what. A vertex owns [`dimension::PER_VERTEX`] of them, after those of the camera.
pub mod dimension {
    /// Place in the pixel's filter (pair).
    pub const FILTER: u32 = 0;
    /// Place on the lens (pair).
    pub const LENS: u32 = 1;
    /// First dimension of the first vertex.
    pub const VERTICES: u32 = 2;
    /// Dimensions a vertex, of a bank.
    pub const PER_VERTEX: u32 = 4;
    /// Distance of banks. What a vertex needs beyond its first dimensions comes from further banks, so that new purposes
    /// move no old ones: renders keep their bits.
    pub const BANK: u32 = 1 << 24;
    /// Direction sampled from the BSDF (pair); the choice of a lobe for specular surfaces (its first number).
    pub const BSDF: u32 = 0;
    /// Place on the light (pair).
    pub const LIGHT: u32 = 1;
    /// Choice of the light (single, 32 bits).
    pub const LIGHT_CHOICE: u32 = 2;
    /// Russian roulette (single).
    pub const ROULETTE: u32 = 3;
    /// Choice of a lobe where a direction is sampled, too (single).
    pub const LOBE: u32 = 4;
    /// Choice of a material of a mixture (single).
    pub const MIXTURE: u32 = 5;
    /// Choice of a part of the sky (single, 32 bits).
    pub const SKY: u32 = 7;
}

/// The numbers of one sample a lane.
#[derive(Clone, Copy, Debug)]
pub struct Stream<U> {
    /// Hash of (render seed, pixel, replicate).
    pub seed: U,
    /// Number of the sample within its replicate.
    pub index: U,
}

/// A generator: what turns a [`Stream`] and a dimension into numbers.
pub trait Sampler: Copy + Send + Sync + 'static {
    /// Name as on the command line.
    const NAME: &'static str;
    /// 32 random bits.
    fn bits<U: Uint>(stream: Stream<U>, dimension: U) -> U;
    /// Two times 32 random bits, stratified together.
    fn bits2<U: Uint>(stream: Stream<U>, dimension: U) -> [U; 2];
    /// A number in [0, 1).
    #[inline(always)]
    fn one<F: Real>(stream: Stream<F::Uint>, dimension: F::Uint) -> F {
        F::unit_from_bits(Self::bits(stream, dimension))
    }
    /// A point in the unit square.
    #[inline(always)]
    fn two<F: Real>(stream: Stream<F::Uint>, dimension: F::Uint) -> [F; 2] {
        let [x, y] = Self::bits2(stream, dimension);
        [F::unit_from_bits(x), F::unit_from_bits(y)]
    }
}

/// The dimension that serves `purpose` (a constant of [`dimension`]) at the vertex number `depth`, 0 the first.
#[inline(always)]
pub fn vertex_dimension<U: Uint>(depth: U, purpose: u32) -> U {
    use dimension::{BANK, PER_VERTEX, VERTICES};
    let (bank, place) = (purpose / PER_VERTEX, purpose % PER_VERTEX);
    depth * U::splat(PER_VERTEX) + U::splat(bank * BANK + VERTICES + place)
}

/// A well-mixed permutation of 32 bits (lowbias32 by Wellons, in the variant with the least bias).
#[inline(always)]
pub fn mix<U: Uint>(x: U) -> U {
    let x = x ^ x.shr::<16>();
    let x = x * U::splat(0x21F0_AAAD);
    let x = x ^ x.shr::<15>();
    let x = x * U::splat(0xD35A_2D97);
    x ^ x.shr::<15>()
}

/// Hash of a value under a seed.
#[inline(always)]
fn hash<U: Uint>(seed: U, value: U) -> U {
    mix(seed ^ mix(value * U::splat(0x9E37_79B9) + U::splat(0x7F4A_7C15)))
}

/// The `seed` of a [`Stream`] for a pixel (its number in the full image) and a replicate.
///
/// Both halves of the render's seed enter, so that all 2^64 seeds differ.
#[inline(always)]
pub fn stream_seed<U: Uint>(render_seed: u64, pixel: U, replicate: u32) -> U {
    let low = hash(Wrapping(render_seed as u32), Wrapping(replicate)).0;
    let high = hash(Wrapping((render_seed >> 32) as u32 ^ 0x5851_F42D), Wrapping(low)).0;
    hash(U::splat(high), pixel)
}

/// Independent uniform numbers: a hash of everything.
#[derive(Clone, Copy, Debug)]
pub struct Independent;

impl Sampler for Independent {
    const NAME: &'static str = "independent";
    #[inline(always)]
    fn bits<U: Uint>(stream: Stream<U>, dimension: U) -> U {
        mix(hash(stream.seed, dimension) ^ mix(stream.index + U::splat(0x6C07_8965)))
    }
    #[inline(always)]
    fn bits2<U: Uint>(stream: Stream<U>, dimension: U) -> [U; 2] {
        let first = Self::bits(stream, dimension);
        [first, mix(first ^ U::splat(0xB529_7A4D))]
    }
}

/// Owen-scrambled Sobol points, padded two dimensions at a time, each with its own shuffle of the index
/// (Burley 2020, "Practical Hash-based Owen Scrambling"). Good for 2^32 samples.
#[derive(Clone, Copy, Debug)]
pub struct Sobol;

/// Owen scrambling by hash, of numbers whose bits are reversed: each bit is flipped by a hash of the bits below it.
/// (Laine and Karras 2011, with the constants of Vegdahl 2021 that avalanche best.)
#[inline(always)]
fn scramble_reversed<U: Uint>(x: U, seed: U) -> U {
    let x = x ^ (x * U::splat(0x3D20_ADEA));
    let x = x + seed;
    let x = x * (seed.shr::<16>() | U::splat(1));
    let x = x ^ (x * U::splat(0x0552_6C56));
    x ^ (x * U::splat(0x53A2_2864))
}

/// Multiplies by the generator matrix of the second Sobol dimension, all bits reversed: bit i of the result is the
/// sum over j of C(j, i) times bit j, modulo 2. Pascal's triangle modulo 2 is the fifth Kronecker power of
/// [[1, 1], [0, 1]], so five shifts do what 32 table entries would.
#[inline(always)]
fn pascal<U: Uint>(x: U) -> U {
    let x = x ^ x.shr::<1>() & U::splat(0x5555_5555);
    let x = x ^ x.shr::<2>() & U::splat(0x3333_3333);
    let x = x ^ x.shr::<4>() & U::splat(0x0F0F_0F0F);
    let x = x ^ x.shr::<8>() & U::splat(0x00FF_00FF);
    x ^ x.shr::<16>()
}

impl Sobol {
    /// The index in shuffled order: a random permutation that keeps each aligned power-of-two block together.
    #[inline(always)]
    fn shuffled_index<U: Uint>(stream: Stream<U>, seed: U) -> U {
        scramble_reversed(stream.index.reverse_bits(), seed).reverse_bits()
    }
}

impl Sampler for Sobol {
    const NAME: &'static str = "sobol";
    #[inline(always)]
    fn bits<U: Uint>(stream: Stream<U>, dimension: U) -> U {
        let seed = hash(stream.seed, dimension);
        // The first Sobol dimension is the index with its bits reversed, so its reverse is the index itself.
        let index = Self::shuffled_index(stream, seed);
        scramble_reversed(index, mix(seed ^ U::splat(0x9E37_79B9))).reverse_bits()
    }
    #[inline(always)]
    fn bits2<U: Uint>(stream: Stream<U>, dimension: U) -> [U; 2] {
        let seed = hash(stream.seed, dimension);
        let index = Self::shuffled_index(stream, seed);
        let seed_x = (seed * U::splat(0x9E37_79B1)) ^ U::splat(0x85EB_CA77);
        let seed_y = (seed * U::splat(0xC2B2_AE3D)) ^ U::splat(0x27D4_EB2F);
        [
            scramble_reversed(index, seed_x ^ seed_x.shr::<15>()).reverse_bits(),
            scramble_reversed(pascal(index), seed_y ^ seed_y.shr::<15>()).reverse_bits(),
        ]
    }
}
