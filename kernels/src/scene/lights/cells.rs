//! Choosing a cell of a grid in proportion to its weight: for pictures of the sky, of which one cell may hold the sun.
//!
//! Cells stand together in tiles of 4 x 4. A tile is chosen by an alias table, from 32 bits, with the exact number of
//! outcomes that choose it; a cell of it by its share, a whole number from 1 to 255, or 0 where the cell is black. So a
//! cell's probability is known without rounding to speak of, black cells are never chosen, and the table takes 1.75
//! bytes a cell: 59 MB for a picture of 8192 x 4096, where a threshold, an alias and a density for each cell would take
//! 400.

use super::alias::Alias;
use crate::lanes::{Real, Uint};

/// Cells along the side of a tile.
const SIDE: u32 = 4;
/// Largest share of a cell.
const MOST: f64 = 255.0;

/// The table.
#[derive(Clone, Debug)]
pub(crate) struct CellTable {
    /// Cells in a row, and rows.
    columns: u32,
    rows: u32,
    /// log2 of the tiles in a row.
    shift: u32,
    keep: Vec<u32>,
    other: Vec<u32>,
    /// Probability of a tile over the sum of its shares.
    unit: Vec<f32>,
    /// Four words a tile, one for each row of it; in a word the cells from left to right, from the lowest byte up.
    shares: Vec<u32>,
}

/// A chosen cell a lane.
#[derive(Clone, Copy)]
pub(crate) struct Cell<F: Real> {
    pub(crate) column: F::Uint,
    pub(crate) row: F::Uint,
    /// A number in \[0, 1): what is left of the one by which the cell was chosen.
    pub(crate) rest: F,
    pub(crate) probability: F,
}

impl CellTable {
    /// A table of `columns` x `rows` cells, whose weights are not negative. `None` if all are 0.
    pub(crate) fn new(columns: u32, rows: u32, weight: impl Fn(u32, u32) -> f64) -> Option<Self> {
        let across = columns.div_ceil(SIDE).next_power_of_two();
        let down = rows.div_ceil(SIDE);
        let count = across as usize * down as usize;
        let mut table = CellTable {
            columns,
            rows,
            shift: across.trailing_zeros(),
            keep: Vec::new(),
            other: Vec::new(),
            unit: Vec::with_capacity(count),
            shares: Vec::with_capacity(count * SIDE as usize),
        };
        let mut sums = Vec::with_capacity(count);
        for tile in 0..count as u32 {
            let (x, y) = (tile % across * SIDE, tile / across * SIDE);
            let mut weights = [[0.0f64; SIDE as usize]; SIDE as usize];
            for (row, y) in weights.iter_mut().zip(y..rows) {
                for (cell, x) in row.iter_mut().zip(x..columns) {
                    *cell = weight(x, y);
                }
            }
            let largest = weights.as_flattened().iter().fold(0.0f64, |a, &b| a.max(b));
            let share = |weight: f64| if weight > 0.0 { (weight / largest * MOST).ceil() as u8 } else { 0 };
            table.shares.extend(weights.map(|row| u32::from_le_bytes(row.map(share))));
            sums.push(weights.as_flattened().iter().sum::<f64>());
        }
        if !sums.iter().any(|&sum| sum > 0.0) {
            return None;
        }
        let Alias { keep, other, chances } = Alias::new(sums);
        for (chances, words) in chances.iter().zip(table.shares.as_chunks::<{ SIDE as usize }>().0) {
            let shares: u32 = words.iter().flat_map(|word| word.to_le_bytes()).map(u32::from).sum();
            table.unit.push((*chances as f64 / 4_294_967_296.0 / f64::from(shares.max(1))) as f32);
        }
        (table.keep, table.other) = (keep, other);
        Some(table)
    }

    /// Bytes on the heap.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.keep[..])
            + size_of_val(&self.other[..])
            + size_of_val(&self.unit[..])
            + size_of_val(&self.shares[..])
    }

    /// Chooses a cell from 32 random bits and a number in \[0, 1).
    #[inline(always)]
    pub(crate) fn choose<F: Real>(&self, bits: F::Uint, u: F) -> Cell<F> {
        let n = F::Uint::splat(self.keep.len() as u32);
        let entry = bits.mul_high(n);
        // SAFETY: `entry` is below n, and so is all that the table names; there are four words a tile.
        let (tile, words, unit) = unsafe {
            let own = (bits * n).lt(F::Uint::gather(&self.keep, entry));
            let tile = F::Uint::select(own, entry, F::Uint::gather(&self.other, entry));
            let first = tile.shl::<2>();
            let word = |k: u32| F::Uint::gather(&self.shares, first + F::Uint::splat(k));
            (tile, [word(0), word(1), word(2), word(3)], F::gather(&self.unit, tile))
        };
        let sums = [
            F::from_uint(sum_of_bytes(words[0])),
            F::from_uint(sum_of_bytes(words[1])),
            F::from_uint(sum_of_bytes(words[2])),
            F::from_uint(sum_of_bytes(words[3])),
        ];
        let total = (sums[0] + sums[1]) + (sums[2] + sums[3]);
        let (row, at) = find(u * total, sums);
        let word = F::Uint::select(row.lt(F::Uint::splat(1)), words[0], words[1]);
        let word = F::Uint::select(row.lt(F::Uint::splat(2)), word, words[2]);
        let word = F::Uint::select(row.lt(F::Uint::splat(3)), word, words[3]);
        let byte = F::Uint::splat(0xff);
        let shares = [
            F::from_uint(word & byte),
            F::from_uint(word.shr::<8>() & byte),
            F::from_uint(word.shr::<16>() & byte),
            F::from_uint(word.shr::<24>()),
        ];
        let (column, at) = find(at, shares);
        let share = F::select(column.lt(F::Uint::splat(1)), shares[0], shares[1]);
        let share = F::select(column.lt(F::Uint::splat(2)), share, shares[2]);
        let share = F::select(column.lt(F::Uint::splat(3)), share, shares[3]);
        let across = F::Uint::splat((1 << self.shift) - 1);
        let side = F::Uint::splat(SIDE);
        Cell {
            column: (tile & across) * side + column,
            row: tile.shr_each(F::Uint::splat(self.shift)) * side + row,
            rest: (at / share).min(F::lit(1.0 - f64::from(f32::EPSILON))),
            probability: unit * share,
        }
    }

    /// The probability of a cell; of those outside of the grid that of the one at the edge.
    #[inline(always)]
    pub(crate) fn probability<F: Real>(&self, column: F::Uint, row: F::Uint) -> F {
        let clamp = |x: F::Uint, n: u32| F::Uint::select(x.lt(F::Uint::splat(n)), x, F::Uint::splat(n - 1));
        let (column, row) = (clamp(column, self.columns), clamp(row, self.rows));
        let tile = row.shr::<2>() * F::Uint::splat(1 << self.shift) + column.shr::<2>();
        let three = F::Uint::splat(SIDE - 1);
        // SAFETY: the cell is in the grid, and so its tile in the table.
        let (word, unit) = unsafe {
            (F::Uint::gather(&self.shares, tile.shl::<2>() + (row & three)), F::gather(&self.unit, tile))
        };
        let share = word.shr_each((column & three).shl::<3>()) & F::Uint::splat(0xff);
        unit * F::from_uint(share)
    }
}

/// The sum of the four bytes of a word.
#[inline(always)]
fn sum_of_bytes<U: Uint>(word: U) -> U {
    let even = U::splat(0x00ff_00ff);
    let pairs = (word & even) + (word.shr::<8>() & even);
    (pairs * U::splat(0x0001_0001)).shr::<16>()
}

/// Which of four parts that follow each other holds the place `at`, and how far it is from that one's begin. All are
/// small whole numbers, `at` is not negative. Parts of length 0 hold nothing, not even where `at` is rounded up to the
/// sum, unless all are.
#[inline(always)]
fn find<F: Real>(at: F, parts: [F; 4]) -> (F::Uint, F) {
    let [a, b, c, d] = parts;
    let (ab, abc) = (a + b, a + b + c);
    let total = abc + d;
    let beyond_a = at.ge(a) & a.lt(total);
    let beyond_b = at.ge(ab) & ab.lt(total);
    let beyond_c = at.ge(abc) & abc.lt(total);
    let part = F::Uint::select(beyond_a, F::Uint::splat(1), F::Uint::splat(0));
    let part = F::Uint::select(beyond_b, F::Uint::splat(2), part);
    let part = F::Uint::select(beyond_c, F::Uint::splat(3), part);
    let begin = F::select(beyond_a, a, F::zero());
    let begin = F::select(beyond_b, ab, begin);
    let begin = F::select(beyond_c, abc, begin);
    (part, at - begin)
}

const _: () = assert!(SIDE == 4, "a row of a tile is a word");
