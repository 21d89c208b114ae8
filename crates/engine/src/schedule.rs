//! Work units, given out one by one: some samples of one replicate of one block of pixels.
//!
//! Sample `s` of a pixel is number `s / K` of replicate `s % K`, so that any number of samples is spread evenly.
//! What a unit computes depends on its number alone; who computes it, and when, changes nothing (see [`crate::film`]).

use crate::film::{Film, unit_paths};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A work unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Number of the block.
    pub block: usize,
    /// Replicate.
    pub replicate: u32,
    /// First sample, its number within the replicate.
    pub first: u32,
    /// Samples of each pixel.
    pub samples: u32,
}

/// When to stop.
#[derive(Clone, Debug)]
pub struct Stop {
    /// Samples a pixel; none: as many as the time allows.
    pub spp: Option<u32>,
    /// Time to render for. The first sample of every pixel is always taken.
    pub time: Option<Duration>,
    /// Set from outside to end early.
    pub interrupted: std::sync::Arc<AtomicBool>,
}

/// Gives out work units: all samples of a range, in an order that is good to stop in anywhere.
///
/// A schedule may be paused and gone on with: it keeps its place.
#[derive(Debug)]
pub struct Schedule {
    blocks: u64,
    replicates: u64,
    /// Samples of each pixel: `groups` ranges a block, each for the replicates whose number leaves that remainder.
    ranges: Vec<Range<u32>>,
    groups: u64,
    /// Most samples that a replicate of a pixel gets.
    longest: u32,
    /// Samples of a unit, at most.
    chunk: u32,
    /// Units that grow from one sample on, because the end may come any moment.
    growing: bool,
    next: AtomicU64,
    deadline: Option<Instant>,
    interrupted: Arc<AtomicBool>,
}

impl Schedule {
    /// Most samples of a unit: 256 pixels times 16 samples fill a pool.
    const CHUNK: u32 = 16;

    /// For a film, `workers` threads and a rule to stop.
    pub fn new(film: &Film, workers: usize, stop: Stop) -> Self {
        let end = stop.spp.unwrap_or(u32::MAX);
        Schedule::of(film, workers, 0..end, stop.time.is_some(), stop.interrupted)
    }

    /// The samples of a range. If it is `growing`, every pixel gets a few samples soon: for a range that may be left at
    /// any moment.
    pub(crate) fn of(
        film: &Film,
        workers: usize,
        range: Range<u32>,
        growing: bool,
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        let ranges = vec![range; film.blocks.len()];
        Schedule { growing, ..Schedule::grouped(film, workers, ranges, 1, interrupted) }
    }

    /// The samples of a range for each half of each block, the replicates of even and of odd number. Wherever it is
    /// left, all of them have about the same part of theirs.
    pub(crate) fn by_half(
        film: &Film,
        workers: usize,
        ranges: &[[Range<u32>; 2]],
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        Schedule::grouped(film, workers, ranges.as_flattened().to_vec(), 2, interrupted)
    }

    fn grouped(
        film: &Film,
        workers: usize,
        ranges: Vec<Range<u32>>,
        groups: u32,
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        let blocks = film.blocks.len() as u64;
        let replicates = film.replicates as u64;
        let longest = ranges.iter().map(|range| range.len() as u32).max().unwrap_or(0);
        let longest = longest.div_ceil((film.replicates / groups).max(1));
        // Small renders: enough units that no worker waits long at the end.
        let wanted = 16 * workers as u64;
        let rounds = wanted.div_ceil((blocks * replicates).max(1)).clamp(1, longest.max(1) as u64) as u32;
        let chunk = Self::CHUNK.min(longest.div_ceil(rounds)).max(1);
        let next = AtomicU64::new(0);
        let (growing, groups, deadline) = (false, u64::from(groups), None);
        Schedule { blocks, replicates, ranges, groups, longest, chunk, growing, next, deadline, interrupted }
    }

    /// Does it give out work for a film like this one?
    pub(crate) fn is_of(&self, film: &Film) -> bool {
        self.blocks == film.blocks.len() as u64 && self.replicates == u64::from(film.replicates)
    }

    /// No more units after this moment, but for the first sample of every pixel.
    pub fn pause_at(&mut self, deadline: Option<Instant>) {
        self.deadline = deadline;
    }

    /// Whether all units have been given out.
    pub fn is_complete(&self) -> bool {
        let mut next = self.next.load(Ordering::Relaxed);
        loop {
            match self.unit(next) {
                None => return true,
                Some(Some(_)) => return false,
                Some(None) => next += 1,
            }
        }
    }

    /// Whether someone asked for an early end.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Paths of the largest unit.
    pub fn unit_paths(&self) -> usize {
        unit_paths(self.chunk)
    }

    /// First sample and number of samples of round `k` of a replicate.
    fn round(&self, k: u64) -> (u64, u64) {
        let chunk = self.chunk as u64;
        if !self.growing {
            return (k * chunk, chunk);
        }
        // 1, 1, 2, 4, ... up to the chunk, and on with that.
        let doublings = chunk.ilog2() as u64;
        match k {
            0 => (0, 1),
            k if k <= doublings => (1 << (k - 1), 1 << (k - 1)),
            k => ((1 << doublings) + (k - doublings - 1) * chunk, chunk),
        }
    }

    /// The unit number `n`, or none if there is nothing left from there on.
    fn unit(&self, n: u64) -> Option<Option<Unit>> {
        if self.blocks == 0 || self.replicates == 0 {
            return None;
        }
        let (turn, block) = (n / self.blocks, n % self.blocks);
        let (round, replicate) = (turn / self.replicates, turn % self.replicates);
        // No replicate has more.
        if self.round(round).0 >= self.longest as u64 {
            return None;
        }
        let (group, member) = (replicate % self.groups, replicate / self.groups);
        let members = (self.replicates / self.groups).max(1);
        let range = &self.ranges[(block * self.groups + group) as usize];
        let own = (range.len() as u64).div_ceil(members);
        // One with fewer samples takes part in some of the rounds only, evenly spaced.
        let round = if own == self.longest as u64 {
            round
        } else {
            let chunks = |samples: u64| samples.div_ceil(self.chunk as u64);
            let done = |rounds: u64| rounds * chunks(own) / chunks(self.longest as u64);
            if done(round + 1) == done(round) {
                return Some(None);
            }
            done(round)
        };
        // How many of the numbers below `n` belong to this replicate.
        let below = |n: u32| (n as u64 + members - 1 - member) / members;
        let (start, end) = (below(range.start), below(range.end));
        let (first, samples) = self.round(round);
        let first = start + first;
        let samples = samples.min(end.saturating_sub(first));
        Some((samples > 0).then_some(Unit {
            block: block as usize,
            replicate: replicate as u32,
            first: first as u32,
            samples: samples as u32,
        }))
    }

    /// Takes the next unit, if there is one and no rule says stop.
    pub fn take(&self) -> Option<Unit> {
        loop {
            // The first sample of every pixel is taken whatever the rules say, but for an interrupt.
            let obligatory = self.ranges.first().is_some_and(|range| range.start == 0)
                && self.next.load(Ordering::Relaxed) < self.blocks;
            let late = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
            if self.is_interrupted() || late && !obligatory {
                return None;
            }
            let n = self.next.fetch_add(1, Ordering::Relaxed);
            match self.unit(n)? {
                Some(unit) => return Some(unit),
                // This replicate is complete; the next one may not be.
                None => continue,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::Quantum;
    use std::collections::HashMap;
    use wavepath_kernels::queue::Requirements;

    fn film(replicates: u32) -> Film {
        Film::new(40, [0, 40, 0, 20], replicates, Quantum::for_brightest(1.0), Requirements::default())
    }

    fn stop(spp: Option<u32>, time: Option<Duration>) -> Stop {
        Stop { spp, time, interrupted: Default::default() }
    }

    /// Every sample of every replicate once, and all replicates together `spp`.
    #[test]
    fn units_cover_all_samples_once() {
        for (spp, replicates, time) in
            [(1, 1, None), (7, 2, None), (64, 4, None), (133, 8, Some(Duration::from_secs(3600)))]
        {
            let film = film(replicates);
            let schedule = Schedule::new(&film, 2, stop(Some(spp), time));
            let mut seen: HashMap<(usize, u32, u32), u32> = HashMap::new();
            while let Some(unit) = schedule.take() {
                assert!(unit.samples as usize * 256 <= schedule.unit_paths());
                for index in unit.first..unit.first + unit.samples {
                    *seen.entry((unit.block, unit.replicate, index)).or_default() += 1;
                }
            }
            assert!(seen.values().all(|&n| n == 1));
            assert_eq!(seen.len(), film.blocks.len() * spp as usize);
            for &(_, replicate, index) in seen.keys() {
                assert!(index * replicates + replicate < spp);
            }
        }
    }

    #[test]
    fn the_first_sample_is_taken_even_without_time() {
        let film = film(8);
        let mut schedule = Schedule::new(&film, 2, stop(None, Some(Duration::ZERO)));
        schedule.pause_at(Some(Instant::now()));
        let units: Vec<Unit> = std::iter::from_fn(|| schedule.take()).collect();
        assert_eq!(units.len(), film.blocks.len());
        assert!(units.iter().all(|u| u.samples == 1));
    }

    /// Ranges one after another, each paused and gone on with, give each sample once.
    #[test]
    fn ranges_follow_each_other_without_gap() {
        let film = film(4);
        let mut seen: HashMap<(usize, u32, u32), u32> = HashMap::new();
        for range in [0..5, 5..6, 6..29, 29..200] {
            let mut schedule = Schedule::of(&film, 2, range.clone(), range.start == 0, Default::default());
            let mut first = true;
            while !schedule.is_complete() {
                schedule.pause_at(std::mem::take(&mut first).then(Instant::now));
                while let Some(unit) = schedule.take() {
                    for index in unit.first..unit.first + unit.samples {
                        assert!(range.contains(&(index * 4 + unit.replicate)));
                        *seen.entry((unit.block, unit.replicate, index)).or_default() += 1;
                    }
                }
            }
        }
        assert!(seen.values().all(|&n| n == 1));
        assert_eq!(seen.len(), film.blocks.len() * 200);
    }

    #[test]
    fn an_interrupt_ends_everything() {
        let film = film(1);
        let rule = stop(Some(1000), None);
        let schedule = Schedule::new(&film, 2, rule.clone());
        assert!(schedule.take().is_some());
        rule.interrupted.store(true, Ordering::Relaxed);
        assert_eq!(schedule.take(), None);
    }
}
