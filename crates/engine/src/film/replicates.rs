//! To which replicate each sample of a pixel belongs.
//!
//! Replicates are scrambled independently of each other; the spread of their means tells the error. Which one a sample
//! belongs to, and its number there, follows from its number in the pixel alone, so that a render of 64 samples is a part of
//! one of 256, and any render can be gone on with. Replicates open as samples grow: few samples in many replicates
//! would lose what Owen-scrambled points are good for, since each is stratified by itself.
//!
//! | samples | go to replicates | then there are |
//! |---|---|---|
//! | first 4 | 0, then 1 | 2 of 2 |
//! | up to 16 | 0 and 1 in turn | 2 of 8 |
//! | up to 32 | 2 and 3 in turn | 4 of 8 |
//! | up to 64 | 0 to 3 in turn | 4 of 16 |
//! | up to 128 | 4 to 7 in turn | 8 of 16 |
//! | from there on | 0 to 7 in turn | 8 |
//!
//! The replicates of even and of odd number are two halves, which adaptive sampling gives different numbers of samples. A
//! half by itself follows the same rule: the samples of a half, in the order of the whole.

use std::ops::Range;

/// Replicates that samples are dealt to.
pub const REPLICATES: u32 = 8;

/// Samples up to number `end` go to `members` replicates from `first` on, in turn.
struct Segment {
    end: u32,
    first: u32,
    members: u32,
}

const fn segment(end: u32, first: u32, members: u32) -> Segment {
    Segment { end, first, members }
}

const WHOLE: [Segment; 7] = [
    segment(2, 0, 1),
    segment(4, 1, 1),
    segment(16, 0, 2),
    segment(32, 2, 2),
    segment(64, 0, 4),
    segment(128, 4, 4),
    segment(u32::MAX, 0, 8),
];

/// Of a half, whose members are the replicates 0, 2, 4, 6 or 1, 3, 5, 7.
const HALF: [Segment; 5] =
    [segment(8, 0, 1), segment(16, 1, 1), segment(32, 0, 2), segment(64, 2, 2), segment(u32::MAX, 0, 4)];

/// How many of the first `samples` a member gets.
fn dealt(segments: &[Segment], member: u32, samples: u32) -> u32 {
    let (mut start, mut count) = (0, 0);
    for segment in segments {
        let taken = u64::from(samples.clamp(start, segment.end) - start);
        if let Some(turn) = member.checked_sub(segment.first).filter(|turn| *turn < segment.members) {
            count += (taken + u64::from(segment.members - 1 - turn)) / u64::from(segment.members);
        }
        start = segment.end;
    }
    count as u32
}

/// How many of the first `samples` samples of a pixel belong to a replicate; their numbers there begin with 0.
pub fn samples_of(replicate: u32, samples: u32) -> u32 {
    dealt(&WHOLE, replicate, samples)
}

/// The same of a half: how many of the first `samples` samples of the half that the replicate belongs to.
pub fn samples_of_half(replicate: u32, samples: u32) -> u32 {
    dealt(&HALF, replicate / 2, samples)
}

/// How many replicates there are in the first `samples` samples of a pixel.
pub fn opened(samples: u32) -> u32 {
    (0..REPLICATES).filter(|&replicate| samples_of(replicate, samples) > 0).count() as u32
}

/// The numbers in the pixel of samples that are given by their numbers in the replicates, `held` for each: as ranges, in
/// ascending order.
pub fn numbers_in_pixel(held: &[Vec<Range<u32>>]) -> Vec<Range<u32>> {
    let end_of =
        |replicate: u32| held.get(replicate as usize).and_then(|ranges| ranges.last()).map(|range| range.end);
    let mut numbers: Vec<Range<u32>> = Vec::new();
    // How far each replicate has come, and which of its ranges is next.
    let (mut counts, mut next) = ([0u32; REPLICATES as usize], [0usize; REPLICATES as usize]);
    let mut number = 0;
    let mut segments = WHOLE.iter();
    let Some(mut segment) = segments.next() else { return numbers };
    let mut start = 0;
    while (0..REPLICATES)
        .any(|replicate| end_of(replicate).is_some_and(|end| counts[replicate as usize] < end))
    {
        if number == segment.end {
            start = segment.end;
            match segments.next() {
                Some(following) => segment = following,
                None => break,
            }
        }
        let replicate = (segment.first + (number - start) % segment.members) as usize;
        let own = counts[replicate];
        counts[replicate] += 1;
        if let Some(ranges) = held.get(replicate) {
            while ranges.get(next[replicate]).is_some_and(|range| range.end <= own) {
                next[replicate] += 1;
            }
            if ranges.get(next[replicate]).is_some_and(|range| range.start <= own) {
                match numbers.last_mut() {
                    Some(last) if last.end == number => last.end += 1,
                    _ => numbers.push(number..number + 1),
                }
            }
        }
        number += 1;
    }
    numbers
}

/// Where to stop on the way from `from` on so that all replicates that are open have come as far as they can: sample
/// numbers that double first, then steps of 16 samples a replicate.
pub(crate) fn next_stop(from: u32) -> u32 {
    match from {
        0 => 1,
        1..64 => from.saturating_add(1).next_power_of_two().max(2),
        64..128 => 128,
        _ => (from / 128 + 1).saturating_mul(128),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replicates_open_as_samples_grow() {
        let counts = |samples| -> Vec<u32> {
            (0..opened(samples)).map(|replicate| samples_of(replicate, samples)).collect()
        };
        assert!(counts(0).is_empty());
        assert_eq!(counts(1), [1]);
        assert_eq!(counts(3), [2, 1]);
        assert_eq!(counts(16), [8; 2]);
        assert_eq!(counts(20), [8, 8, 2, 2]);
        assert_eq!(counts(32), [8; 4]);
        assert_eq!(counts(64), [16; 4]);
        assert_eq!(counts(128), [16; 8]);
        assert_eq!(counts(1024), [128; 8]);
        assert_eq!(counts(1027), [129, 129, 129, 128, 128, 128, 128, 128]);
        assert_eq!(samples_of(0, u32::MAX), 1 << 29);
    }

    /// Each sample belongs to one replicate, and is the next one there; a half has those of the whole in the same order.
    #[test]
    fn every_sample_has_one_place() {
        let mut halves = [0; 2];
        for samples in 0..2000 {
            let grown: Vec<u32> = (0..REPLICATES)
                .filter(|&replicate| samples_of(replicate, samples + 1) > samples_of(replicate, samples))
                .collect();
            let [replicate] = grown[..] else { panic!("sample {samples}: {grown:?}") };
            let half = (replicate % 2) as usize;
            let own = |samples| samples_of_half(replicate, samples);
            assert_eq!(own(halves[half]), samples_of(replicate, samples));
            assert_eq!(own(halves[half] + 1), samples_of(replicate, samples) + 1);
            halves[half] += 1;
        }
    }

    #[test]
    fn numbers_in_the_pixel_come_back() {
        for (first, end) in [(0, 1), (0, 64), (3, 5), (17, 300), (129, 1000), (5, 5)] {
            let of = |replicate| samples_of(replicate, first)..samples_of(replicate, end);
            let held: Vec<_> = (0..REPLICATES)
                .map(|k| Vec::from_iter(Some(of(k)).filter(|range| !range.is_empty())))
                .collect();
            let numbers = numbers_in_pixel(&held);
            assert_eq!(numbers, Vec::from_iter(Some(first..end).filter(|range| !range.is_empty())));
        }
        assert_eq!(numbers_in_pixel(&[vec![], vec![0..1, 3..4]]), [2..3, 7..8]);
    }

    #[test]
    fn stops_are_where_open_replicates_are_even() {
        let mut stops = vec![0];
        while stops.last() < Some(&512) {
            stops.push(next_stop(stops[stops.len() - 1]));
        }
        assert_eq!(stops, [0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 384, 512]);
        assert_eq!((next_stop(5), next_stop(100), next_stop(300)), (8, 128, 384));
        assert_eq!(next_stop(u32::MAX), u32::MAX);
    }
}
