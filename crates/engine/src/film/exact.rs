//! Exact sums of single-precision numbers: no order changes a bit, no scene needs a scale.
//!
//! A positive `f32` is a whole number of 2^-149, below 2^277: nine digits of 32 bits, of which a sample touches two next to
//! each other. A sum keeps, for each of the three highest digits that occur, the plain sum of that digit over the samples,
//! without carries. Which digits those are follows from the largest sample alone; when a larger one comes, the window
//! slides up, and the lowest digit leaves it whole, with all that samples had in it. So a sum is always that of the digits
//! of all samples inside of the final window: a function of the set of samples, whatever their order and grouping.
//!
//! What is lost is below the window, 65 to 96 bits below the largest sample: for n samples less than n 2^-64 of the sum of
//! magnitudes, which is 2^-40 for sixteen million of them. A digit has 31 bits of headroom.

use wavepath_kernels::isa::{Isa, Kernel, Level};

/// Digits of a window.
pub(super) const DIGITS: usize = 3;

/// Most numbers that a sum may have.
pub(crate) const MOST_ADDITIONS: u64 = (1 << 31) - 1;

/// Sums of the digits in a window, the lowest first. Beside it goes the number of the lowest digit, the base.
pub(crate) type Bins = [i64; DIGITS];

/// Adds a finite number: its bits without that of the sign, times 1 or -1.
#[inline(always)]
pub(crate) fn add(bins: &mut Bins, base: &mut u8, magnitude: u32, sign: i64) {
    let field = magnitude >> 23;
    let mantissa = magnitude & 0x007F_FFFF | field.min(1) << 23;
    // Where the lowest bit of the mantissa is, in bits above 2^-149.
    let position = field.max(1) - 1;
    let (digit, shift) = (position >> 5, position & 31);
    let both = u64::from(mantissa) << shift;
    let (low, high) = ((both & 0xFFFF_FFFF) as i64, (both >> 32) as i64);
    let at = digit.wrapping_sub(u32::from(*base)) as usize;
    if at < DIGITS - 1 + (high == 0) as usize {
        bins[at] += low * sign;
        // Where there is no digit above, this adds nothing to the same one.
        bins[(at + 1).min(DIGITS - 1)] += high * sign;
    } else {
        add_beyond(bins, base, digit as u8, low * sign, high * sign);
    }
}

/// As [`add`], of a number whose digits are not all in the window.
fn add_beyond(bins: &mut Bins, base: &mut u8, digit: u8, low: i64, high: i64) {
    if low == 0 && high == 0 {
        return;
    }
    let top = digit + (high != 0) as u8;
    slide(bins, base, top.saturating_sub(DIGITS as u8 - 1));
    for (digit, value) in [(digit, low), (digit + 1, high)] {
        if let Some(bin) = digit.checked_sub(*base).and_then(|at| bins.get_mut(at as usize)) {
            *bin += value;
        }
    }
}

/// Moves the window up, to a base that is not below `to`.
#[inline(always)]
fn slide(bins: &mut Bins, base: &mut u8, to: u8) {
    if to > *base {
        *bins = match to - *base {
            1 => [bins[1], bins[2], 0],
            2 => [bins[2], 0, 0],
            _ => [0; DIGITS],
        };
        *base = to;
    }
}

/// Adds another sum.
#[inline(always)]
pub(super) fn merge(bins: &mut Bins, base: &mut u8, mut other: Bins, mut other_base: u8) {
    if *base != other_base {
        slide(bins, base, other_base);
        slide(&mut other, &mut other_base, *base);
    }
    for (to, from) in bins.iter_mut().zip(other) {
        *to += from;
    }
}

/// The number that a sum stands for, rounded once.
pub(super) fn value(bins: &Bins, base: u8) -> f64 {
    let [low, middle, high] = bins.map(i128::from);
    (low + (middle << 32) + (high << 64)) as f64 * unit(base)
}

/// The same, faster, with up to three roundings.
#[inline(always)]
pub(super) fn about(bins: &Bins, base: u8) -> f64 {
    const DIGIT: f64 = 4_294_967_296.0;
    let (low, middle, high) = (bins[0] as f64, bins[1] as f64, bins[2] as f64);
    ((high * DIGIT + middle) * DIGIT + low) * unit(base)
}

/// What one in the lowest digit stands for: 2^(32 base - 149).
#[inline(always)]
fn unit(base: u8) -> f64 {
    f64::from_bits(((1023 - 149 + 32 * i64::from(base)) as u64) << 52)
}

/// Many sums in little room: bins take 32 bits and what the number of additions needs above them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PackedSums {
    bases: Vec<u8>,
    /// [`DIGITS`] a sum.
    lows: Vec<u32>,
    highs: Highs,
    additions: u64,
}

/// The upper parts of bins. A bin of `n` digits is at least `-n` and below `n`, in units of 2^32.
#[derive(Clone, Debug, PartialEq)]
enum Highs {
    Narrow(Vec<i8>),
    Medium(Vec<i16>),
    Wide(Vec<i32>),
}

impl Highs {
    /// Bytes a bin, for so many additions.
    fn width(additions: u64) -> usize {
        match additions {
            0..=0x80 => 1,
            0x81..=0x8000 => 2,
            _ => 4,
        }
    }

    fn zeros(width: usize, bins: usize) -> Self {
        match width {
            1 => Highs::Narrow(vec![0; bins]),
            2 => Highs::Medium(vec![0; bins]),
            _ => Highs::Wide(vec![0; bins]),
        }
    }

    fn current_width(&self) -> usize {
        match self {
            Highs::Narrow(_) => 1,
            Highs::Medium(_) => 2,
            Highs::Wide(_) => 4,
        }
    }

    #[inline(always)]
    fn get(&self, at: usize) -> i64 {
        match self {
            Highs::Narrow(highs) => i64::from(highs[at]),
            Highs::Medium(highs) => i64::from(highs[at]),
            Highs::Wide(highs) => i64::from(highs[at]),
        }
    }
}

/// Integers that the upper parts are kept in.
trait High: Copy {
    fn widen(self) -> i64;
    /// Of a number that fits.
    fn narrow(wide: i64) -> Self;
}

macro_rules! high {
    ($($type:ty)*) => {$(
        impl High for $type {
            #[inline(always)]
            fn widen(self) -> i64 {
                i64::from(self)
            }
            #[inline(always)]
            fn narrow(wide: i64) -> Self {
                debug_assert!(<$type>::try_from(wide).is_ok());
                wide as $type
            }
        }
    )*};
}
high!(i8 i16 i32);

impl PackedSums {
    /// So many sums of nothing.
    pub(super) fn new(sums: usize) -> Self {
        let bins = DIGITS * sums;
        PackedSums { bases: vec![0; sums], lows: vec![0; bins], highs: Highs::zeros(1, bins), additions: 0 }
    }

    /// Bytes of a sum of so many numbers.
    pub(super) fn bytes(additions: u64) -> u64 {
        (1 + DIGITS * (4 + Highs::width(additions))) as u64
    }

    /// How many sums.
    pub(super) fn count(&self) -> usize {
        self.bases.len()
    }

    /// How many numbers were added to a sum, at most.
    pub(super) fn additions(&self) -> u64 {
        self.additions
    }

    #[inline(always)]
    pub(super) fn get(&self, sum: usize) -> (Bins, u8) {
        let bin = |k: usize| self.highs.get(DIGITS * sum + k) << 32 | i64::from(self.lows[DIGITS * sum + k]);
        ([bin(0), bin(1), bin(2)], self.bases[sum])
    }

    /// Adds to all sums, each at most `additions` numbers: bins, and their bases, of as many sums.
    pub(super) fn add(&mut self, additions: u64, bins: &[Bins], bases: &[u8]) {
        let first = self.additions == 0;
        self.reserve(additions);
        let sums = (self.bases.as_mut_slice(), self.lows.as_mut_slice());
        let (level, unit) = (Level::detect(), (bins, bases));
        match &mut self.highs {
            Highs::Narrow(highs) => level.run(AddAll { first, sums, highs, unit }),
            Highs::Medium(highs) => level.run(AddAll { first, sums, highs, unit }),
            Highs::Wide(highs) => level.run(AddAll { first, sums, highs, unit }),
        }
    }

    /// Adds another one of as many sums.
    pub(super) fn merge(&mut self, other: &PackedSums) {
        let (bins, bases): (Vec<Bins>, Vec<u8>) = (0..other.count()).map(|sum| other.get(sum)).unzip();
        self.add(other.additions, &bins, &bases);
    }

    /// Adds one number to a sum.
    pub(super) fn add_one(&mut self, sum: usize, value: f32) {
        self.reserve(1);
        let (mut bins, mut base) = self.get(sum);
        let bits = value.to_bits();
        add(&mut bins, &mut base, bits & 0x7FFF_FFFF, 1 - 2 * i64::from(bits >> 31));
        self.bases[sum] = base;
        let at = DIGITS * sum;
        let lows = &mut self.lows[at..at + DIGITS];
        match &mut self.highs {
            Highs::Narrow(highs) => set(&bins, lows, &mut highs[at..at + DIGITS]),
            Highs::Medium(highs) => set(&bins, lows, &mut highs[at..at + DIGITS]),
            Highs::Wide(highs) => set(&bins, lows, &mut highs[at..at + DIGITS]),
        }
    }

    /// Room for further numbers in each sum.
    fn reserve(&mut self, additions: u64) {
        self.additions += additions;
        let width = Highs::width(self.additions);
        if width > self.highs.current_width() {
            let bins = 0..self.lows.len();
            self.highs = match width {
                2 => Highs::Medium(bins.map(|at| self.highs.get(at) as i16).collect()),
                _ => Highs::Wide(bins.map(|at| self.highs.get(at) as i32).collect()),
            };
        }
    }

    /// Bytes of so many sums of so many numbers in [`PackedSums::write`]'s form.
    pub(super) fn written_bytes(sums: u64, additions: u64) -> u64 {
        sums * PackedSums::bytes(additions)
    }

    /// Bases, lower parts, upper parts.
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.bases);
        self.lows.iter().for_each(|low| out.extend_from_slice(&low.to_le_bytes()));
        match &self.highs {
            Highs::Narrow(highs) => highs.iter().for_each(|high| out.extend_from_slice(&high.to_le_bytes())),
            Highs::Medium(highs) => highs.iter().for_each(|high| out.extend_from_slice(&high.to_le_bytes())),
            Highs::Wide(highs) => highs.iter().for_each(|high| out.extend_from_slice(&high.to_le_bytes())),
        }
    }

    /// From as many bytes as [`PackedSums::written_bytes`] says; none if they stand for no sums of so many numbers.
    pub(super) fn read(sums: usize, additions: u64, bytes: &[u8]) -> Option<Self> {
        let bins = DIGITS * sums;
        let (bases, rest) = bytes.split_at_checked(sums)?;
        let (lows, highs) = rest.split_at_checked(4 * bins)?;
        let width = Highs::width(additions);
        if highs.len() != width * bins || bases.iter().any(|base| *base > LAST_BASE) {
            return None;
        }
        let lows = lows.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        let highs = match width {
            1 => Highs::Narrow(highs.iter().map(|byte| *byte as i8).collect()),
            2 => Highs::Medium(highs.as_chunks().0.iter().map(|bytes| i16::from_le_bytes(*bytes)).collect()),
            _ => Highs::Wide(highs.as_chunks().0.iter().map(|bytes| i32::from_le_bytes(*bytes)).collect()),
        };
        // What no numbers add up to would overflow later.
        let most = i64::try_from(additions).ok()?;
        if (0..bins).any(|at| !(-most..most.max(1)).contains(&highs.get(at))) {
            return None;
        }
        Some(PackedSums { bases: bases.to_vec(), lows, highs, additions })
    }
}

/// The largest base: that of the largest number.
const LAST_BASE: u8 = 6;

/// The kernel: adds the sums of a work unit to those of a film.
struct AddAll<'a, H> {
    /// There is nothing in the film's sums yet.
    first: bool,
    /// Bases and lower parts of the film's bins.
    sums: (&'a mut [u8], &'a mut [u32]),
    /// Their upper parts.
    highs: &'a mut [H],
    /// Bins and bases of the unit.
    unit: (&'a [Bins], &'a [u8]),
}

/// Sums whose bases are compared together.
const GROUP: usize = 16;

impl<H: High> Kernel for AddAll<'_, H> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) {
        let AddAll { first, sums: (bases, lows), highs, unit: (bins, unit_bases) } = self;
        let (lows, highs) = (lows.chunks_mut(DIGITS * GROUP), highs.chunks_mut(DIGITS * GROUP));
        let unit = bins.chunks(GROUP).zip(unit_bases.chunks(GROUP));
        for (((bases, lows), highs), (bins, unit_bases)) in
            bases.chunks_mut(GROUP).zip(lows).zip(highs).zip(unit)
        {
            let unit_bases = &unit_bases[..bases.len()];
            if first {
                bases.copy_from_slice(unit_bases);
            }
            if bases == unit_bases {
                for ((bin, low), high) in bins.as_flattened().iter().zip(lows).zip(highs) {
                    let bin = bin + (high.widen() << 32 | i64::from(*low));
                    *low = bin as u32;
                    *high = H::narrow(bin >> 32);
                }
                continue;
            }
            let (lows, highs) = (lows.as_chunks_mut::<DIGITS>().0, highs.as_chunks_mut::<DIGITS>().0);
            for (sum, ((base, lows), highs)) in bases.iter_mut().zip(lows).zip(highs).enumerate() {
                let mut own = Bins::default();
                for ((own, high), low) in own.iter_mut().zip(&*highs).zip(&*lows) {
                    *own = high.widen() << 32 | i64::from(*low);
                }
                merge(&mut own, base, bins[sum], unit_bases[sum]);
                set(&own, lows, highs);
            }
        }
    }
}

#[inline(always)]
fn set<H: High>(bins: &Bins, lows: &mut [u32], highs: &mut [H]) {
    for ((bin, low), high) in bins.iter().zip(lows).zip(highs) {
        *low = *bin as u32;
        *high = H::narrow(*bin >> 32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Debug, Default, PartialEq)]
    struct Sum {
        bins: Bins,
        base: u8,
    }

    impl Sum {
        fn add(&mut self, x: f32) {
            let bits = x.to_bits();
            add(&mut self.bins, &mut self.base, bits & 0x7FFF_FFFF, 1 - 2 * i64::from(bits >> 31));
        }
        fn of(numbers: impl IntoIterator<Item = f32>) -> Self {
            let mut sum = Sum::default();
            numbers.into_iter().for_each(|x| sum.add(x));
            sum
        }
        fn value(&self) -> f64 {
            value(&self.bins, self.base)
        }
    }

    /// Random numbers.
    fn random(seed: u64) -> impl FnMut() -> u64 {
        let mut state = seed;
        move || {
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let x = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
            x ^ x >> 31
        }
    }

    #[test]
    fn every_finite_number_comes_back() {
        for x in [0.0, -0.0, 1.0, f32::MAX, -f32::MAX, f32::MIN_POSITIVE, f32::from_bits(1), 1e-30, -3.7e22] {
            assert_eq!(Sum::of([x]).value(), f64::from(x), "{x}");
        }
        let mut random = random(1);
        for _ in 0..100_000 {
            let x = f32::from_bits(random() as u32);
            if x.is_finite() {
                assert_eq!(Sum::of([x]).value(), f64::from(x), "{x}");
                let (bins, base) = (Sum::of([x]).bins, Sum::of([x]).base);
                assert_eq!(about(&bins, base), f64::from(x));
            }
        }
    }

    /// Of numbers of any size and sign, in any order, in any grouping.
    #[test]
    fn no_order_and_no_grouping_changes_a_bit() {
        let mut random = random(2);
        for round in 0..300 {
            let spread = 1 + round % 254;
            let numbers: Vec<f32> = (0..40)
                .map(|_| {
                    let bits = random() as u32;
                    let field = (127 - spread / 2 + bits % spread) << 23;
                    f32::from_bits(bits & 0x8000_0000 | field | bits >> 9)
                })
                .collect();
            let sum = Sum::of(numbers.iter().copied());
            for _ in 0..5 {
                let mut shuffled = numbers.clone();
                for k in (1..shuffled.len()).rev() {
                    shuffled.swap(k, random() as usize % (k + 1));
                }
                assert_eq!(Sum::of(shuffled.iter().copied()), sum);
                let mut grouped = Sum::default();
                for group in shuffled.chunks(1 + random() as usize % 9) {
                    let group = Sum::of(group.iter().copied());
                    merge(&mut grouped.bins, &mut grouped.base, group.bins, group.base);
                }
                assert_eq!(grouped, sum);
            }
            // Sorted by magnitude, double precision is much better than what may be lost only if its own error is allowed.
            let magnitudes: f64 = numbers.iter().map(|x| f64::from(x.abs())).sum();
            let exact: f64 = {
                let mut sorted = numbers.clone();
                sorted.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
                sorted.iter().map(|x| f64::from(*x)).sum()
            };
            assert!((sum.value() - exact).abs() <= magnitudes * (-46.0f64).exp2());
        }
    }

    /// What leaves the window is less than it may be: one number of 1, and as many small ones as a test can add.
    #[test]
    fn little_is_lost() {
        for exponent in [0, -10, -40, -60, -90, -140] {
            for large in [1.0f32, 2048.0, 2047.0, 3e38] {
                let small = (exponent as f32).exp2();
                let n = 100_000;
                let mut sum = Sum::of((0..n).map(|_| small));
                sum.add(large);
                let exact = f64::from(large) + n as f64 * f64::from(small);
                assert!((sum.value() - exact).abs() <= exact * (-47.0f64).exp2(), "{large} and {small}");
            }
        }
    }

    #[test]
    fn packed_sums_are_the_same_sums() {
        const SUMS: usize = 37;
        let mut random = random(3);
        let mut packed = PackedSums::new(SUMS);
        let mut plain = vec![Sum::default(); SUMS];
        for round in 0..500u64 {
            let mut unit = vec![Sum::default(); SUMS];
            let additions = 1 + round % 17 * (round % 5) * 20;
            for (k, sum) in unit.iter_mut().enumerate() {
                for _ in 0..additions {
                    // All of the same sign for long, so that the upper parts fill; in most rounds of the same size.
                    let sign = if round < 250 { 0 } else { 0x8000_0000 };
                    let size = if round % 100 == 7 * k as u64 { 0x4780_0000 } else { 0x3F80_0000 };
                    sum.add(f32::from_bits(sign | size | random() as u32 >> 9));
                }
            }
            let (bins, bases): (Vec<Bins>, Vec<u8>) = unit.iter().map(|sum| (sum.bins, sum.base)).unzip();
            packed.add(additions, &bins, &bases);
            for (k, (plain, unit)) in plain.iter_mut().zip(&unit).enumerate() {
                merge(&mut plain.bins, &mut plain.base, unit.bins, unit.base);
                assert_eq!(packed.get(k), (plain.bins, plain.base));
            }
        }
        assert_eq!(packed.highs.current_width(), 4);
        let mut bytes = Vec::new();
        packed.write(&mut bytes);
        assert_eq!(bytes.len() as u64, PackedSums::written_bytes(SUMS as u64, packed.additions()));
        assert_eq!(PackedSums::read(SUMS, packed.additions(), &bytes), Some(packed.clone()));
        assert_eq!(PackedSums::read(SUMS, packed.additions(), &bytes[1..]), None);
        bytes[0] = LAST_BASE + 1;
        assert_eq!(PackedSums::read(SUMS, packed.additions(), &bytes), None);
    }

    /// The most digits of the most numbers that a width is for.
    #[test]
    fn no_width_overflows() {
        for (additions, sign) in [(128u64, 1), (128, -1), (32768, 1), (32768, -1)] {
            let mut packed = PackedSums::new(1);
            let mut sum = Sum::default();
            for _ in 0..additions {
                // All bits of its digit.
                sum.bins[2] += sign * 0xFFFF_FFFF;
            }
            packed.add(additions, &[sum.bins], &[0]);
            assert_eq!(packed.get(0).0, sum.bins);
            assert_eq!(packed.highs.current_width(), Highs::width(additions));
        }
    }
}
