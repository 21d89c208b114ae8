//! What is in a film, and what is missing.

use crate::film::Film;
use crate::film::replicates::{REPLICATES, numbers_in_pixel};
use std::collections::BTreeMap;
use std::ops::Range;

/// Samples that are in a film, by their numbers in the pixel, and in how many blocks of pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holding {
    /// Seed that they are of.
    pub seed: u64,
    /// Samples of each pixel, in ascending order. Where samples were spread by the error they are those that the halves of
    /// the pixel have.
    pub samples: Vec<Range<u32>>,
    /// The blocks, by number.
    pub blocks: Vec<usize>,
}

impl Holding {
    /// All that a film has, blocks with the same samples together; the first block's first.
    pub fn of(film: &Film) -> Vec<Holding> {
        let mut out = Vec::new();
        for (place, seed) in film.header().seeds().enumerate() {
            let mut by_samples: BTreeMap<Pairs, Vec<usize>> = BTreeMap::new();
            // By what the replicates have.
            let mut numbers_of: BTreeMap<Vec<Pairs>, Pairs> = BTreeMap::new();
            for block in 0..film.blocks().len() {
                let held: Vec<Vec<Range<u32>>> =
                    (0..REPLICATES).map(|replicate| film.held_of_seed(block, place, replicate)).collect();
                let key = held.iter().map(|ranges| pairs(ranges)).collect();
                let samples = numbers_of.entry(key).or_insert_with(|| pairs(&numbers_in_pixel(&held)));
                by_samples.entry(samples.clone()).or_default().push(block);
            }
            let mut of_seed: Vec<Holding> = by_samples
                .into_iter()
                .map(|(samples, blocks)| Holding {
                    seed,
                    samples: samples.into_iter().map(|(start, end)| start..end).collect(),
                    blocks,
                })
                .collect();
            of_seed.sort_by_key(|holding| holding.blocks[0]);
            out.append(&mut of_seed);
        }
        out
    }
}

/// Ranges that can be put in order.
type Pairs = Vec<(u32, u32)>;

fn pairs(ranges: &[Range<u32>]) -> Pairs {
    ranges.iter().map(|range| (range.start, range.end)).collect()
}

/// Samples that a film lacks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Numbers in the pixel.
    pub samples: Range<u32>,
    /// Blocks that lack them, by number.
    pub blocks: Vec<usize>,
}

impl Gap {
    /// What a film of one seed lacks of the first `target` samples of each pixel; without a target, of as many as the
    /// furthest pixel has.
    pub fn of(film: &Film, target: Option<u32>) -> Vec<Gap> {
        let holdings = Holding::of(film);
        let furthest = || holdings.iter().filter_map(|holding| Some(holding.samples.last()?.end)).max();
        let target = target.or_else(furthest).unwrap_or(0);
        let mut missing: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
        for holding in &holdings {
            let mut start = 0;
            for held in holding.samples.iter().chain([&(target..target)]) {
                let end = held.start.min(target);
                if start < end {
                    missing.entry((start, end)).or_default().extend(&holding.blocks);
                }
                start = start.max(held.end);
            }
        }
        let gap = |((start, end), mut blocks): (_, Vec<usize>)| {
            blocks.sort_unstable();
            Gap { samples: start..end, blocks }
        };
        missing.into_iter().map(gap).collect()
    }
}
