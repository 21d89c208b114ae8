//! Work units, given out one by one: some samples of one replicate of one block of pixels.
//!
//! Sample `s` of a pixel is number `s / K` of replicate `s % K`, so that any number of samples is spread evenly.
//! What a unit computes depends on its number alone; who computes it, and when, changes nothing (see [`crate::film`]).

use crate::film::{Film, unit_paths};
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

/// Gives out work units.
#[derive(Debug)]
pub struct Schedule {
    blocks: u64,
    replicates: u64,
    spp: Option<u32>,
    /// Samples of a unit, at most.
    chunk: u32,
    /// Units that grow from one sample on, because the time may end any moment.
    growing: bool,
    next: AtomicU64,
    started: Instant,
    stop: Stop,
}

impl Schedule {
    /// Most samples of a unit: 256 pixels times 16 samples fill a pool.
    const CHUNK: u32 = 16;

    /// For a film, `workers` threads and a rule to stop.
    pub fn new(film: &Film, workers: usize, stop: Stop) -> Self {
        let blocks = film.blocks.len() as u64;
        let replicates = film.replicates as u64;
        let growing = stop.time.is_some();
        let mut chunk = Self::CHUNK;
        if let Some(spp) = stop.spp {
            // Small renders: enough units that no worker waits long at the end.
            let per_replicate = spp.div_ceil(film.replicates).max(1);
            let wanted = 16 * workers as u64;
            let rounds = wanted.div_ceil(blocks * replicates).clamp(1, per_replicate as u64) as u32;
            chunk = chunk.min(per_replicate.div_ceil(rounds)).max(1);
        }
        Schedule {
            blocks,
            replicates,
            spp: stop.spp,
            chunk,
            growing,
            next: AtomicU64::new(0),
            started: Instant::now(),
            stop,
        }
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
        let (turn, block) = (n / self.blocks, n % self.blocks);
        let (round, replicate) = (turn / self.replicates, turn % self.replicates);
        let (first, samples) = self.round(round);
        let end = match self.spp {
            None => u32::MAX as u64,
            // How many of the numbers below spp belong to this replicate.
            Some(spp) => (spp as u64 + self.replicates - 1 - replicate) / self.replicates,
        };
        // The first replicate has the most samples: when it has none left, nobody has.
        let most = self.spp.map_or(u32::MAX as u64, |spp| (spp as u64).div_ceil(self.replicates));
        if first >= most {
            return None;
        }
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
            let obligatory = self.next.load(Ordering::Relaxed) < self.blocks;
            let late = self.stop.time.is_some_and(|time| self.started.elapsed() >= time);
            if self.stop.interrupted.load(Ordering::Relaxed) || late && !obligatory {
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
            [(1, 1, None), (7, 2, None), (64, 4, None), (133, 8, Some(Duration::MAX))]
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
        let schedule = Schedule::new(&film, 2, stop(None, Some(Duration::ZERO)));
        let units: Vec<Unit> = std::iter::from_fn(|| schedule.take()).collect();
        assert_eq!(units.len(), film.blocks.len());
        assert!(units.iter().all(|u| u.samples == 1));
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
