//! Choosing one of many in a table of constant cost.

/// An alias table (Walker 1977, Vose 1991): entry `i` takes `i` itself below a threshold, in units of 2^-32, else
/// `other[i]`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Alias {
    pub(crate) keep: Vec<u32>,
    pub(crate) other: Vec<u32>,
    /// How many of the 2^32 random numbers choose each.
    pub(crate) chances: Vec<u64>,
}

impl Alias {
    /// For a choice in proportion to numbers that are not negative; a number above 0 has at least one chance, others
    /// have none. Without a number above 0 there are no chances.
    pub(crate) fn new(mut share: Vec<f64>) -> Self {
        let n = share.len();
        let total: f64 = share.iter().sum();
        let mut alias =
            Alias { keep: vec![u32::MAX; n], other: (0..n as u32).collect(), chances: vec![0; n] };
        if total <= 0.0 {
            return alias;
        }
        let dark: Vec<bool> = share.iter().map(|&s| s == 0.0).collect();
        let largest = (0..n).max_by(|&a, &b| share[a].total_cmp(&share[b])).unwrap_or(0);
        share.iter_mut().for_each(|s| *s *= n as f64 / total);
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| share[i] < 1.0);
        while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
            small.pop();
            // A threshold of n is met by one random number at least.
            let threshold = (share[s] * 4_294_967_296.0) as u32;
            alias.keep[s] = if dark[s] { 0 } else { threshold.max(n as u32) };
            alias.other[s] = l as u32;
            share[l] -= 1.0 - share[s];
            if share[l] < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        // What is left is 1 but for rounding; what has probability 0 must still never be taken.
        for i in small.into_iter().filter(|&i| dark[i]) {
            alias.keep[i] = 0;
            alias.other[i] = largest as u32;
        }
        // Entry i serves the random numbers from ceil(2^32 i / n), its own number those below the threshold.
        for i in 0..n {
            let at = |offset: u64| (((i as u64) << 32) + offset).div_ceil(n as u64);
            let (begin, end) = (at(0), at(1 << 32));
            let other = alias.other[i] as usize;
            let split = if other == i { end } else { at(alias.keep[i] as u64) };
            alias.chances[i] += split - begin;
            alias.chances[other] += end - split;
        }
        alias
    }
}
