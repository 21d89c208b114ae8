//! Work units, given out one by one: some samples of one replicate of one block of pixels.
//!
//! To which replicate a sample belongs follows from its number in the pixel (see [`crate::film::replicates`]). What a unit
//! computes depends on its samples alone; who computes it, and when, changes nothing (see [`crate::film`]).

use crate::film::replicates::{REPLICATES, next_stop, samples_of, samples_of_half};
use crate::film::{Film, unit_paths};
use crate::team::Feed;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
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

/// Gives out work units: all samples of a range, in an order that is good to stop in anywhere. Samples that the film has
/// already when the schedule is made are left out.
///
/// A schedule may be paused and gone on with: it keeps its place.
#[derive(Debug)]
pub struct Schedule<'a> {
    film: &'a Film,
    blocks: u64,
    samples: Samples,
    /// One after another.
    stages: Vec<Stage>,
    /// Samples of a unit, at most.
    chunk: u32,
    /// The first sample of every pixel is among them.
    from_the_first: bool,
    /// How far apart in the image units are that follow each other, in blocks.
    stride: u64,
    next: AtomicU64,
    /// The film had samples already.
    goes_on: bool,
    /// Parts of units of which the film has some samples.
    pieces: Mutex<Vec<Unit>>,
    deadline: Option<Instant>,
    interrupted: Arc<AtomicBool>,
    /// Where units come from instead.
    feed: Option<Arc<Feed>>,
}

/// Which samples a schedule gives out.
#[derive(Clone, Debug)]
enum Samples {
    /// Those of a range, of each pixel.
    Same(Range<u32>),
    /// Those of a range for each half of each block, by number in the half.
    ByHalf(Vec<[Range<u32>; 2]>),
}

/// A part of a schedule whose units go through all blocks, turn by turn; the replicates take turns.
#[derive(Clone, Debug)]
struct Stage {
    /// Of all samples; those of halves are one stage.
    range: Range<u32>,
    /// Those that have samples in it.
    replicates: Vec<u32>,
    /// Turns of each replicate.
    rounds: u32,
    /// Number of its first turn.
    first_turn: u64,
}

impl Stage {
    fn turns(&self) -> u64 {
        u64::from(self.rounds) * self.replicates.len() as u64
    }
}

/// Stages of a schedule that may end any moment, before the last one, which is for the rest.
const MOST_STAGES: usize = 16;

impl<'a> Schedule<'a> {
    /// Most samples of a unit: 256 pixels times 16 samples fill a pool.
    pub(crate) const CHUNK: u32 = 16;

    /// For a film, `workers` threads and a rule to stop.
    pub fn new(film: &'a Film, workers: usize, stop: Stop) -> Self {
        let end = stop.spp.unwrap_or(u32::MAX);
        let growing = stop.time.is_some() || stop.spp.is_none();
        Schedule::of(film, workers, 0..end, growing, stop.interrupted)
    }

    /// The samples of a range. If it is `growing`, every pixel gets a few samples soon: for a range that may be left at
    /// any moment.
    pub(crate) fn of(
        film: &'a Film,
        workers: usize,
        range: Range<u32>,
        growing: bool,
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        Schedule::made(film, workers, Samples::Same(range), growing, interrupted)
    }

    /// The samples of a range for each half of each block, the replicates of even and of odd number. Wherever it is
    /// left, all of them have about the same part of theirs. Blocks without ranges get no samples.
    pub(crate) fn by_half(
        film: &'a Film,
        workers: usize,
        ranges: &[[Range<u32>; 2]],
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        Schedule::made(film, workers, Samples::ByHalf(ranges.to_vec()), false, interrupted)
    }

    /// What someone else gives out.
    pub(crate) fn fed(film: &'a Film, feed: Arc<Feed>) -> Self {
        let schedule = Schedule::made(film, 1, Samples::Same(0..0), true, Arc::default());
        Schedule { feed: Some(feed), goes_on: false, ..schedule }
    }

    fn made(
        film: &'a Film,
        workers: usize,
        samples: Samples,
        growing: bool,
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        let blocks = film.blocks().len() as u64;
        let whole = match &samples {
            Samples::Same(range) => range.clone(),
            Samples::ByHalf(_) => 0..u32::MAX,
        };
        let from_the_first = matches!(&samples, Samples::Same(range) if range.start == 0);
        let mut schedule = Schedule {
            film,
            blocks,
            samples,
            stages: Vec::new(),
            chunk: Self::CHUNK,
            from_the_first,
            stride: 1,
            next: AtomicU64::new(0),
            goes_on: !film.is_empty(),
            pieces: Mutex::default(),
            deadline: None,
            interrupted,
            feed: None,
        };
        if !growing {
            // Small renders: enough units that no worker waits long at the end.
            let (replicates, longest) = schedule.replicates_in(&whole);
            let turns = (blocks * replicates.len() as u64).max(1);
            let rounds = (16 * workers as u64).div_ceil(turns).clamp(1, longest.max(1).into()) as u32;
            schedule.chunk = Self::CHUNK.min(longest.div_ceil(rounds)).max(1);
            schedule.add_stage(whole);
            return schedule;
        }
        let mut start = whole.start;
        while start < whole.end {
            let all = schedule.stages.len() >= MOST_STAGES;
            let end = if all { whole.end } else { next_stop(start).min(whole.end) };
            schedule.add_stage(start..end);
            start = end;
        }
        schedule
    }

    /// Replicates that have samples in a range, and most samples that one of them has.
    fn replicates_in(&self, range: &Range<u32>) -> (Vec<u32>, u32) {
        let blocks = match self.samples {
            Samples::Same(_) => 1,
            Samples::ByHalf(_) => self.blocks,
        };
        let most = |&replicate: &u32| -> u32 {
            let of_block = |block| {
                let own = self.own(block, replicate, range);
                own.end - own.start
            };
            (0..blocks).map(of_block).max().unwrap_or(0)
        };
        let replicates: Vec<u32> = (0..REPLICATES).filter(|replicate| most(replicate) > 0).collect();
        let longest = replicates.iter().map(most).max().unwrap_or(0);
        (replicates, longest)
    }

    fn add_stage(&mut self, range: Range<u32>) {
        let (replicates, longest) = self.replicates_in(&range);
        let first_turn = self.stages.last().map_or(0, |stage| stage.first_turn + stage.turns());
        self.stages.push(Stage { range, replicates, rounds: longest.div_ceil(self.chunk), first_turn });
    }

    /// The samples of a replicate of a block in a stage of that range, by number in the replicate.
    fn own(&self, block: u64, replicate: u32, range: &Range<u32>) -> Range<u32> {
        let (of, range): (fn(u32, u32) -> u32, _) = match &self.samples {
            Samples::Same(_) => (samples_of, range.clone()),
            Samples::ByHalf(ranges) => {
                let halves = ranges.get(block as usize);
                (samples_of_half, halves.map_or(0..0, |halves| halves[replicate as usize % 2].clone()))
            }
        };
        let start = of(replicate, range.start);
        start..of(replicate, range.end).max(start)
    }

    /// Does it give out work for this film?
    pub(crate) fn is_of(&self, film: &Film) -> bool {
        std::ptr::eq(self.film, film)
    }

    /// The same samples in another order of blocks, all over the image: so that the first units show all of it.
    pub fn scattered(mut self) -> Self {
        let common_divisor = |mut a: u64, mut b: u64| {
            while b > 0 {
                (a, b) = (b, a % b);
            }
            a
        };
        // By the golden ratio.
        let first = (self.blocks * 618 / 1000).max(1);
        self.stride = (first..).find(|&stride| common_divisor(stride, self.blocks) == 1).unwrap_or(1);
        self
    }

    /// No more units after this moment, but for the first sample of every pixel.
    pub fn pause_at(&mut self, deadline: Option<Instant>) {
        self.deadline = deadline;
    }

    /// Whether all units have been given out.
    pub fn is_complete(&self) -> bool {
        if self.pieces.lock().is_ok_and(|pieces| !pieces.is_empty()) {
            return false;
        }
        let mut next = self.next.load(Ordering::Relaxed);
        loop {
            match self.unit(next) {
                None => return true,
                Some(Some(unit)) if !self.missing(unit).is_empty() => return false,
                Some(_) => next += 1,
            }
        }
    }

    /// Units that are left to be given out, at most.
    pub fn remaining(&self) -> u64 {
        let turns = self.stages.last().map_or(0, |stage| stage.first_turn + stage.turns());
        turns.saturating_mul(self.blocks).saturating_sub(self.next.load(Ordering::Relaxed))
    }

    /// Whether someone asked for an early end.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Paths of the largest unit.
    pub fn unit_paths(&self) -> usize {
        unit_paths(self.chunk)
    }

    /// The unit number `n`, or none if there is nothing left from there on.
    fn unit(&self, n: u64) -> Option<Option<Unit>> {
        let (turn, block) = (n / self.blocks, n % self.blocks * self.stride % self.blocks);
        let stage =
            &self.stages[self.stages.partition_point(|stage| stage.first_turn <= turn).checked_sub(1)?];
        let turn = turn - stage.first_turn;
        if turn >= stage.turns() {
            return None;
        }
        let members = stage.replicates.len() as u64;
        let (round, replicate) = (turn / members, stage.replicates[(turn % members) as usize]);
        let own = self.own(block, replicate, &stage.range);
        let rounds = u64::from((own.end - own.start).div_ceil(self.chunk));
        // One with fewer samples takes part in some of the rounds only, evenly spaced.
        let done = |round: u64| round * rounds / u64::from(stage.rounds);
        if done(round + 1) == done(round) {
            return Some(None);
        }
        let first = own.start + done(round) as u32 * self.chunk;
        let samples = self.chunk.min(own.end - first);
        Some(Some(Unit { block: block as usize, replicate, first, samples }))
    }

    /// Those of a unit's samples that the film did not have before.
    fn missing(&self, unit: Unit) -> Vec<Unit> {
        if !self.goes_on {
            return vec![unit];
        }
        let missing = self.film.missing(unit.block, unit.replicate, unit.first..unit.first + unit.samples);
        missing.into_iter().map(|m| Unit { first: m.start, samples: m.end - m.start, ..unit }).collect()
    }

    /// Takes the next unit, if there is one and no rule says stop.
    pub fn take(&self) -> Option<Unit> {
        if let Some(feed) = &self.feed {
            return feed.take();
        }
        loop {
            // The first sample of every pixel is taken whatever the rules say, but for an interrupt.
            let obligatory = self.from_the_first && self.next.load(Ordering::Relaxed) < self.blocks;
            let late = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
            if self.is_interrupted() || late && !obligatory {
                return None;
            }
            if self.goes_on
                && let Some(unit) = self.pieces.lock().ok().and_then(|mut pieces| pieces.pop())
            {
                return Some(unit);
            }
            let n = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(unit) = self.unit(n)? else { continue };
            if !self.goes_on {
                return Some(unit);
            }
            let mut missing = self.missing(unit).into_iter();
            if let Some(first) = missing.next() {
                if let Ok(mut pieces) = self.pieces.lock() {
                    pieces.extend(missing);
                }
                return Some(first);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::tests::film as film_of;
    use std::collections::HashMap;

    fn film() -> Film {
        film_of(40, 20)
    }

    fn stop(spp: Option<u32>, time: Option<Duration>) -> Stop {
        Stop { spp, time, interrupted: Default::default() }
    }

    /// How often each sample was given out, by block, replicate and number.
    type Seen = HashMap<(usize, u32, u32), u32>;

    fn take_all(schedule: &Schedule, seen: &mut Seen) {
        while let Some(unit) = schedule.take() {
            assert!(unit.samples as usize * 256 <= schedule.unit_paths());
            for index in unit.first..unit.first + unit.samples {
                *seen.entry((unit.block, unit.replicate, index)).or_default() += 1;
            }
        }
    }

    /// All samples of a range of every pixel, each once.
    fn check(seen: &Seen, film: &Film, range: Range<u32>) {
        assert!(seen.values().all(|&n| n == 1));
        assert_eq!(seen.len(), film.blocks().len() * range.len());
        for &(_, replicate, index) in seen.keys() {
            assert!((samples_of(replicate, range.start)..samples_of(replicate, range.end)).contains(&index));
        }
    }

    /// Every sample once, whatever the end, and the same ones whether or not it may come early.
    #[test]
    fn units_cover_all_samples_once() {
        let film = film();
        for spp in [1, 2, 3, 5, 16, 17, 40, 64, 100, 133, 300, 1000, 5000] {
            for time in [None, Some(Duration::from_secs(3600))] {
                let schedule = Schedule::new(&film, 2, stop(Some(spp), time));
                let mut seen = Seen::new();
                take_all(&schedule, &mut seen);
                check(&seen, &film, 0..spp);
                assert!(schedule.is_complete());
            }
        }
    }

    /// At any moment, no pixel has much more than another, and replicates open as they should.
    #[test]
    fn what_may_end_early_grows_evenly() {
        let film = film();
        let schedule = Schedule::new(&film, 2, stop(None, Some(Duration::from_secs(3600))));
        let mut samples = vec![0; film.blocks().len()];
        let mut most_replicate = 0;
        while samples[0] < 700 {
            let unit = schedule.take().unwrap();
            samples[unit.block] += unit.samples;
            most_replicate = most_replicate.max(unit.replicate);
            let (least, most) = (samples.iter().min().unwrap(), samples.iter().max().unwrap());
            assert!(most - least <= unit.samples.max(1), "{samples:?}");
            assert!(most_replicate < crate::film::replicates::opened(*most), "{samples:?}");
        }
    }

    #[test]
    fn the_first_sample_is_taken_even_without_time() {
        let film = film();
        for spp in [None, Some(64)] {
            let mut schedule = Schedule::new(&film, 2, stop(spp, Some(Duration::ZERO)));
            schedule.pause_at(Some(Instant::now()));
            let units: Vec<Unit> = std::iter::from_fn(|| schedule.take()).collect();
            assert_eq!(units.len(), film.blocks().len());
            assert!(units.iter().all(|u| u.samples == 1));
        }
    }

    /// Ranges one after another, each paused and gone on with, give each sample once.
    #[test]
    fn ranges_follow_each_other_without_gap() {
        let film = film();
        let mut seen = Seen::new();
        for range in [0..5, 5..6, 6..29, 29..29, 29..200] {
            let mut schedule = Schedule::of(&film, 2, range.clone(), range.start == 0, Default::default());
            let mut first = true;
            let mut own = Seen::new();
            while !schedule.is_complete() {
                schedule.pause_at(std::mem::take(&mut first).then(Instant::now));
                take_all(&schedule, &mut own);
            }
            check(&own, &film, range);
            own.into_iter().for_each(|(key, n)| *seen.entry(key).or_default() += n);
        }
        check(&seen, &film, 0..200);
    }

    /// Each half of each block its own range.
    #[test]
    fn halves_get_their_samples() {
        let film = film();
        let ranges: Vec<[Range<u32>; 2]> =
            (0..film.blocks().len() as u32).map(|k| [k..10 * k, 16..16 + 30 * k]).collect();
        let schedule = Schedule::by_half(&film, 2, &ranges, Default::default());
        let mut seen = Seen::new();
        take_all(&schedule, &mut seen);
        assert!(seen.values().all(|&n| n == 1));
        for (block, halves) in ranges.iter().enumerate() {
            for (half, range) in halves.iter().enumerate() {
                for replicate in (half as u32..REPLICATES).step_by(2) {
                    let own: Vec<u32> =
                        (0..1000).filter(|k| seen.contains_key(&(block, replicate, *k))).collect();
                    let of = |samples| samples_of_half(replicate, samples);
                    assert_eq!(own, (of(range.start)..of(range.end)).collect::<Vec<_>>());
                }
            }
        }
    }

    /// What the film has is not given out again.
    #[test]
    fn a_film_is_gone_on_with() {
        let film = film();
        for (replicate, range) in [(0, 0..3), (0, 5..6), (1, 2..40), (3, 0..16)] {
            film.add(crate::film::tests::unit(2, replicate, range), &film.sums()).unwrap();
        }
        for growing in [false, true] {
            let schedule = Schedule::of(&film, 2, 0..64, growing, Default::default());
            let mut seen = Seen::new();
            take_all(&schedule, &mut seen);
            assert!(schedule.is_complete());
            assert!(seen.values().all(|&n| n == 1));
            // Of replicate 1, 16 samples are below 64 a pixel.
            assert_eq!(seen.len(), film.blocks().len() * 64 - (3 + 1 + 14 + 16));
            assert!(!seen.keys().any(|&(block, replicate, k)| block == 2 && replicate == 0 && k < 3));
        }
    }

    #[test]
    fn an_interrupt_ends_everything() {
        let film = film();
        let rule = stop(Some(1000), None);
        let schedule = Schedule::new(&film, 2, rule.clone());
        assert!(schedule.take().is_some());
        rule.interrupted.store(true, Ordering::Relaxed);
        assert_eq!(schedule.take(), None);
    }

    #[test]
    fn blocks_come_from_all_over() {
        let film = film();
        let schedule = Schedule::new(&film, 2, stop(Some(100), None)).scattered();
        let mut seen = Seen::new();
        take_all(&schedule, &mut seen);
        check(&seen, &film, 0..100);
    }
}
