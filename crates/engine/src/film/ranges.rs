//! Which samples a film holds: sets of ranges of their numbers.

use std::ops::Range;

/// A set of numbers, as ranges in ascending order that do not touch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Ranges(Vec<Range<u32>>);

impl Ranges {
    /// How many numbers.
    pub(super) fn len(&self) -> u64 {
        self.0.iter().map(|range| u64::from(range.end - range.start)).sum()
    }

    /// In ascending order.
    pub(super) fn iter(&self) -> impl ExactSizeIterator<Item = &Range<u32>> {
        self.0.iter()
    }

    /// Whether one of these numbers is in the set.
    pub(super) fn meets(&self, range: &Range<u32>) -> bool {
        let next = self.0.partition_point(|held| held.end <= range.start);
        range.start < range.end && self.0.get(next).is_some_and(|held| held.start < range.end)
    }

    /// Those of the numbers that are not in the set.
    pub(super) fn missing(&self, range: Range<u32>) -> Vec<Range<u32>> {
        let first = self.0.partition_point(|held| held.end <= range.start);
        let (mut start, mut missing) = (range.start, Vec::new());
        for held in self.0[first..].iter().take_while(|held| held.start < range.end) {
            if start < held.start {
                missing.push(start..held.start);
            }
            start = held.end;
        }
        if start < range.end {
            missing.push(start..range.end);
        }
        missing
    }

    /// Adds a range that does not meet the set, and is not empty.
    pub(super) fn insert(&mut self, range: Range<u32>) {
        debug_assert!(range.start < range.end && !self.meets(&range));
        let at = self.0.partition_point(|held| held.end < range.start);
        let joins_left = self.0.get(at).is_some_and(|held| held.end == range.start);
        let right = at + joins_left as usize;
        let joins_right = self.0.get(right).is_some_and(|held| held.start == range.end);
        match (joins_left, joins_right) {
            (true, true) => {
                self.0[at].end = self.0[right].end;
                self.0.remove(right);
            }
            (true, false) => self.0[at].end = range.end,
            (false, true) => self.0[at].start = range.start,
            (false, false) => self.0.insert(at, range),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Against a set of numbers.
    #[test]
    fn they_are_sets() {
        let mut state = 1u32;
        let mut random = |below: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % below
        };
        for _ in 0..50 {
            let (mut ranges, mut set) = (Ranges::default(), BTreeSet::new());
            for _ in 0..60 {
                let start = random(100);
                let range = start..start + random(8);
                let missing: Vec<u32> = ranges.missing(range.clone()).into_iter().flatten().collect();
                let expected: Vec<u32> = range.clone().filter(|n| !set.contains(n)).collect();
                assert_eq!(missing, expected);
                let meets = range.clone().any(|n| set.contains(&n));
                assert_eq!(ranges.meets(&range), meets);
                if !meets && !range.is_empty() {
                    ranges.insert(range.clone());
                    set.extend(range);
                }
                assert_eq!(ranges.len(), set.len() as u64);
                assert_eq!(
                    ranges.0.iter().cloned().flatten().collect::<Vec<_>>(),
                    Vec::from_iter(set.clone())
                );
                assert!(ranges.0.windows(2).all(|pair| pair[0].end < pair[1].start));
            }
        }
        assert!(Ranges::default().missing(3..3).is_empty());
    }
}
