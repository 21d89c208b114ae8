//! What all trees are built by: primitives are parted in two by the surface-area heuristic, from the root down.
//!
//! Large sets are parted between bins (Wald 2007), small ones anywhere (a sweep). Every part takes time proportional to
//! its size. A set is parted so at most [`Partitioner::deepest`] levels deep, further down in halves: so the depth of a
//! tree over n primitives is O(log n) and its build O(n log n), whatever they are. Rows, stacks and shells of equal or
//! nested things, which lead builders from the leaves up and their searches into one merge a pass, are no case apart.
//!
//! The result does not depend on the number of threads: bins are sums of whole numbers and unions of boxes, and what has
//! equal places is told apart by its number.

use super::bounds;
use crate::scene::Geometry;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use rayon::prelude::*;

/// Bins of an axis. Measured tests (of nodes and blocks) of a bounce ray with 16 : 32 : 64 of them: terrain
/// 14.85 : 14.82 : 14.84, knot 12.6 : 12.7 : 12.6, menger sponge 10.1 : 10.0 : 10.1.
const BINS: usize = 16;
/// Up to this size a set is parted by a sweep. Measured as above with 8 : 16 : 32: terrain 14.82 : 14.82 : 14.83.
const SMALL: usize = 8;
/// A parting that costs more than this share of leaving the set whole is poor: then the sizes are looked at as well.
/// Measured tests of a bounce ray: long sticks along three axes without sizes 633, with them 50; soup and meshes the
/// same with and without. With 0.7 : 0.8 : 0.9 of it: sticks 49 : 53 : 239.
const POOR: f32 = 0.7;
/// So are they where one side is larger than this share of the whole: a floor lies among the feet of what stands on it.
const LARGE: f32 = 0.8;
/// From this size on several threads look at a set.
const SHARED: usize = 1 << 16;
/// What a thread takes of it at once.
const CHUNK: usize = 1 << 14;

/// Nothing: the union with it changes no box.
const NOTHING: Aabb = Aabb { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY };

/// A primitive on its way into a tree.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub(super) struct Reference {
    low: [f32; 3],
    /// Its number.
    pub primitive: u32,
    high: [f32; 3],
    /// What its test costs, in triangles of a block.
    weight: u32,
}

impl Reference {
    #[inline(always)]
    fn bounds(&self) -> Aabb {
        Aabb { min: Vec3A::from_array(self.low), max: Vec3A::from_array(self.high) }
    }
    #[inline(always)]
    fn key(&self, by: Key) -> Vec3A {
        let (low, high) = (Vec3A::from_array(self.low), Vec3A::from_array(self.high));
        match by {
            Key::Centre => low + high,
            Key::Size => high - low,
        }
    }
    /// The same along one axis.
    #[inline(always)]
    fn key_along(&self, by: Key, axis: usize) -> f32 {
        match by {
            Key::Centre => self.low[axis] + self.high[axis],
            Key::Size => self.high[axis] - self.low[axis],
        }
    }
}

/// What primitives are told apart by, along an axis.
#[derive(Clone, Copy, PartialEq)]
enum Key {
    /// Twice the centre of the box.
    Centre,
    /// The size of the box: parts long from short, and what lies along one axis from what lies along another.
    Size,
}

/// What is known about a set of primitives.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    /// The box around them.
    pub bounds: Aabb,
    /// The box around the centres of their boxes, times two.
    centres: Aabb,
}

impl Extent {
    const NOTHING: Extent = Extent { bounds: NOTHING, centres: NOTHING };

    #[inline(always)]
    fn add(&mut self, reference: &Reference) {
        self.bounds = self.bounds.union(&reference.bounds());
        let centre = reference.key(Key::Centre);
        self.centres = self.centres.union(&Aabb { min: centre, max: centre });
    }
    fn union(self, other: Extent) -> Extent {
        Extent { bounds: self.bounds.union(&other.bounds), centres: self.centres.union(&other.centres) }
    }
    fn of(set: &[Reference]) -> Extent {
        let of = |set: &[Reference]| {
            set.iter().fold(Extent::NOTHING, |mut extent, reference| {
                extent.add(reference);
                extent
            })
        };
        if set.len() < SHARED {
            of(set)
        } else {
            set.par_chunks(CHUNK).map(of).reduce(|| Extent::NOTHING, Extent::union)
        }
    }
}

/// References to all primitives, in the order of their numbers, and their extent. `block` triangles are tested at the
/// price of one other primitive.
pub(super) fn references(geometry: &Geometry, block: u32) -> (Vec<Reference>, Extent) {
    let reference = |primitive: u32| {
        let (low, high) = bounds(geometry, primitive);
        let weight = if primitive < geometry.first_sphere() { 1 } else { block };
        Reference { low, primitive, high, weight }
    };
    let all: Vec<Reference> =
        (0..geometry.primitives() as u32).into_par_iter().with_min_len(CHUNK).map(reference).collect();
    let extent = Extent::of(&all);
    (all, extent)
}

/// The boxes and weights of what lies in each bin.
#[derive(Clone)]
struct Bins {
    boxes: [[Aabb; BINS]; 3],
    weights: [[u32; BINS]; 3],
}

/// Where keys fall into bins.
#[derive(Clone, Copy)]
struct Scale {
    by: Key,
    low: Vec3A,
    scale: Vec3A,
}

impl Scale {
    const NONE: Scale = Scale { by: Key::Centre, low: Vec3A::ZERO, scale: Vec3A::ZERO };

    fn new(by: Key, range: &Aabb) -> Self {
        // A little less than the number of bins, so that the last key falls into the last bin. Not finite where all
        // keys are one or cannot be told apart: then what is no number falls into the first bin, as if it were.
        let scale = Vec3A::splat(BINS as f32 * 0.999_999) / (range.max - range.min);
        Scale { by, low: range.min, scale }
    }
    #[inline(always)]
    fn bins(&self, reference: &Reference) -> [usize; 3] {
        let place = (reference.key(self.by) - self.low) * self.scale;
        place.to_array().map(bin)
    }
}

/// The bin of a place in units of bins; what is no number falls into the first.
#[inline(always)]
fn bin(place: f32) -> usize {
    (place as i32 as usize).min(BINS - 1)
}

impl Bins {
    const EMPTY: Bins = Bins { boxes: [[NOTHING; BINS]; 3], weights: [[0; BINS]; 3] };

    fn of(set: &[Reference], scale: Scale) -> Bins {
        let mut bins = Bins::EMPTY;
        for reference in set {
            let bounds = reference.bounds();
            for (axis, bin) in scale.bins(reference).into_iter().enumerate() {
                let filled = &mut bins.boxes[axis][bin];
                *filled = filled.union(&bounds);
                bins.weights[axis][bin] += reference.weight;
            }
        }
        bins
    }
    fn union(mut self, other: &Bins) -> Bins {
        for axis in 0..3 {
            for bin in 0..BINS {
                self.boxes[axis][bin] = self.boxes[axis][bin].union(&other.boxes[axis][bin]);
                self.weights[axis][bin] += other.weights[axis][bin];
            }
        }
        self
    }
}

/// The cheapest way to part a set so far.
struct Best {
    cost: f32,
    /// How unequal the sides are, which decides between equal costs: those of what has no area are all 0.
    imbalance: u32,
    axis: usize,
    /// Bins or primitives of the first side; 0 for none.
    first: usize,
    /// Area of the larger side.
    larger: f32,
    /// Where the bins are.
    scale: Scale,
}

impl Best {
    const NONE: Best =
        Best { cost: f32::INFINITY, imbalance: u32::MAX, axis: 0, first: 0, larger: 0.0, scale: Scale::NONE };

    #[inline(always)]
    fn offer(&mut self, cost: f32, imbalance: u32, axis: usize, first: usize, larger: f32, scale: Scale) {
        if cost < self.cost || cost == self.cost && imbalance < self.imbalance {
            *self = Best { cost, imbalance, axis, first, larger, scale };
        }
    }
}

/// How sets are parted.
#[derive(Clone, Copy)]
pub(super) struct Partitioner {
    /// Triangles tested at the price of one.
    block: u32,
    /// From this depth on sets are parted in halves.
    deepest: u32,
}

impl Partitioner {
    pub fn new(primitives: usize, block: u32) -> Self {
        Partitioner { block, deepest: 2 * primitives.max(1).ilog2() + 24 }
    }

    /// Parts a set of at least two at `depth` below the root: puts it in order and returns the size of the first side,
    /// and the extents of both.
    pub fn part(&self, set: &mut [Reference], extent: &Extent, depth: u32) -> (usize, [Extent; 2]) {
        debug_assert!(set.len() >= 2);
        let first = if depth >= self.deepest {
            None
        } else if set.len() <= SMALL {
            self.sweep(set)
        } else {
            let best = self.between_bins(set, extent);
            (best.first > 0).then(|| swap_sides(set, &best))
        };
        let first = first.unwrap_or_else(|| halve(set, extent));
        let (a, b) = set.split_at(first);
        (first, [Extent::of(a), Extent::of(b)])
    }

    #[inline(always)]
    fn cost(&self, area: f32, weight: u32) -> f32 {
        area * weight.div_ceil(self.block) as f32
    }

    /// The best way to part a set between bins of places, or of sizes where that is poor.
    fn between_bins(&self, set: &[Reference], extent: &Extent) -> Best {
        let mut best = Best::NONE;
        let weight = self.try_bins(set, Scale::new(Key::Centre, &extent.centres), &mut best);
        let whole = extent.bounds.half_area();
        if best.cost > POOR * self.cost(whole, weight) || best.larger > LARGE * whole {
            self.try_bins(set, Scale::new(Key::Size, &sizes(set)), &mut best);
        }
        best
    }

    /// Offers all ways to part a set between bins. Returns its weight.
    fn try_bins(&self, set: &[Reference], scale: Scale, best: &mut Best) -> u32 {
        let bins = if set.len() < SHARED {
            Bins::of(set, scale)
        } else {
            let parts = set.par_chunks(CHUNK).map(|chunk| Bins::of(chunk, scale));
            parts.reduce(|| Bins::EMPTY, |a, b| a.union(&b))
        };
        for axis in 0..3 {
            let (boxes, weights) = (&bins.boxes[axis], &bins.weights[axis]);
            // The second sides: area, cost and weight of bin `k` and all behind it.
            let mut behind = [(0.0, 0.0, 0); BINS];
            let (mut around, mut weight) = (NOTHING, 0);
            for k in (1..BINS).rev() {
                around = around.union(&boxes[k]);
                weight += weights[k];
                let area = around.half_area();
                behind[k] = (area, self.cost(area, weight), weight);
            }
            let (mut around, mut weight) = (NOTHING, 0);
            for k in 1..BINS {
                around = around.union(&boxes[k - 1]);
                weight += weights[k - 1];
                let (other_area, other_cost, other) = behind[k];
                if weight > 0 && other > 0 {
                    let area = around.half_area();
                    let cost = self.cost(area, weight) + other_cost;
                    best.offer(cost, weight.abs_diff(other), axis, k, area.max(other_area), scale);
                }
            }
        }
        bins.weights[0].iter().sum()
    }

    /// The size of the first side, where every place was looked at; the set is in order.
    fn sweep(&self, set: &mut [Reference]) -> Option<usize> {
        let n = set.len();
        let mut best = Best::NONE;
        let mut order = [[0u8; SMALL]; 3];
        for (axis, order) in order.iter_mut().enumerate() {
            let mut keys = [(0.0f32, 0u32, 0u8); SMALL];
            for (place, (key, reference)) in keys.iter_mut().zip(&*set).enumerate() {
                *key = (reference.key_along(Key::Centre, axis), reference.primitive, place as u8);
            }
            keys[..n].sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for (place, key) in order.iter_mut().zip(&keys) {
                *place = key.2;
            }
            let mut behind = [(0.0, 0); SMALL];
            let (mut around, mut weight) = (NOTHING, 0);
            for k in (1..n).rev() {
                let reference = &set[order[k] as usize];
                around = around.union(&reference.bounds());
                weight += reference.weight;
                behind[k] = (self.cost(around.half_area(), weight), weight);
            }
            let (mut around, mut weight) = (NOTHING, 0);
            for k in 1..n {
                let reference = &set[order[k - 1] as usize];
                around = around.union(&reference.bounds());
                weight += reference.weight;
                let (cost, other) = behind[k];
                let cost = self.cost(around.half_area(), weight) + cost;
                best.offer(cost, weight.abs_diff(other), axis, k, 0.0, Scale::NONE);
            }
        }
        if best.first == 0 {
            return None;
        }
        let mut sorted = [set[0]; SMALL];
        for (to, &place) in sorted.iter_mut().zip(&order[best.axis][..n]) {
            *to = set[place as usize];
        }
        set.copy_from_slice(&sorted[..n]);
        Some(best.first)
    }
}

/// The range of the boxes' sizes.
fn sizes(set: &[Reference]) -> Aabb {
    set.iter().fold(NOTHING, |sizes, reference| {
        let size = reference.key(Key::Size);
        sizes.union(&Aabb { min: size, max: size })
    })
}

/// Puts what lies in the bins of the first side first, and returns how many those are. Without a branch, which would be
/// foretold wrongly for every second reference.
fn swap_sides(set: &mut [Reference], best: &Best) -> usize {
    let (scale, axis) = (&best.scale, best.axis);
    let (by, low, scale) = (scale.by, scale.low[axis], scale.scale[axis]);
    let mut first = 0;
    for place in 0..set.len() {
        let reference = set[place];
        // As in `Scale::bins`, along one axis.
        let bin = bin((reference.key_along(by, axis) - low) * scale);
        set[place] = set[first];
        set[first] = reference;
        first += usize::from(bin < best.first);
    }
    first
}

/// Parts a set in halves: along the axis on which places differ most, or sizes where all are at one place.
fn halve(set: &mut [Reference], extent: &Extent) -> usize {
    let range = extent.centres.max - extent.centres.min;
    let (by, range) = if range.max_element() > 0.0 {
        (Key::Centre, range)
    } else {
        let sizes = sizes(set);
        (Key::Size, sizes.max - sizes.min)
    };
    let axis = range.max_position();
    let key = |reference: &Reference| reference.key_along(by, axis);
    let half = set.len() / 2;
    set.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.primitive.cmp(&b.primitive)));
    half
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `n` triangles that builders from the leaves up, or without a limit of depth, take a square of steps for.
    fn triangle(what: &str, n: usize, i: usize) -> [[f32; 3]; 3] {
        let x = i as f32;
        match what {
            "row" => [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]],
            "stack" => [[0.0, 0.0, x], [100.0, 0.0, x], [0.0, 100.0, x]],
            "diagonal strip" => [[x, x, x], [x + 1.0, x, x], [x, x + 1.0, x + 1.0]],
            "identical" => [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            "concentric" => [[-1.0 - x; 3], [1.0 + x; 3], [-1.0 - x, 1.0 + x, 1.0 + x]],
            "without area" => [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x + 0.5, 0.0, 0.0]],
            "exponential, apart" => {
                let x = 2f64.powf(200.0 * i as f64 / n as f64 - 100.0) as f32;
                [[x, 0.0, 0.0], [x * 1.001, 0.0, 0.0], [x, x * 0.001, 0.0]]
            }
            "exponential, overlapping" => {
                let x = 2f64.powf(200.0 * i as f64 / n as f64 - 100.0) as f32;
                [[x, 0.0, 0.0], [x * 1.5, 0.0, 0.0], [x, x, x]]
            }
            "huge" => [[x * 8e33, 0.0, -3e38], [3e38, x, 3e38], [-3e38, 1.0, 0.0]],
            _ => unreachable!(),
        }
    }

    const KINDS: [&str; 9] = [
        "row",
        "stack",
        "diagonal strip",
        "identical",
        "concentric",
        "without area",
        "exponential, apart",
        "exponential, overlapping",
        "huge",
    ];

    fn geometry(what: &str, n: usize) -> Geometry {
        Geometry::soup((0..n).flat_map(|i| triangle(what, n, i)).collect(), Vec::new())
    }

    /// Parts all down to single primitives. Returns the depth, and how many references were looked at.
    fn part_all(geometry: &Geometry) -> (u32, usize) {
        let (mut set, extent) = references(geometry, 4);
        let partitioner = Partitioner::new(set.len(), 4);
        let (mut deepest, mut steps) = (0, 0);
        let mut pending = vec![(0..set.len(), extent, 0)];
        while let Some((places, extent, depth)) = pending.pop() {
            deepest = deepest.max(depth);
            if places.len() == 1 {
                continue;
            }
            steps += places.len();
            let (first, [a, b]) = partitioner.part(&mut set[places.clone()], &extent, depth);
            assert!(0 < first && first < places.len());
            let middle = places.start + first;
            pending.push((places.start..middle, a, depth + 1));
            pending.push((middle..places.end, b, depth + 1));
        }
        let mut primitives: Vec<u32> = set.iter().map(|r| r.primitive).collect();
        primitives.sort_unstable();
        assert!(primitives.into_iter().eq(0..geometry.primitives() as u32));
        (deepest, steps)
    }

    #[test]
    fn steps_are_n_log_n_and_depth_is_log_n() {
        for what in KINDS {
            let [few, many] = [10_000, 40_000].map(|n| part_all(&geometry(what, n)));
            // 3 log2(n) + 25 is what the limit allows; 5 times the steps for 4 times the primitives is far from 16.
            assert!(few.0 <= 3 * 13 + 25 && many.0 <= 3 * 15 + 25, "{what}: {few:?} {many:?}");
            assert!(many.1 <= 5 * few.1, "{what}: {few:?} {many:?}");
            assert!(many.1 <= 40_000 * 64, "{what}: {many:?}");
        }
    }

    #[test]
    fn sizes_tell_apart_what_places_do_not() {
        // Long along x, or along y, everywhere: in two sets the boxes are a fraction as large as in any two regions.
        let n = 1_000;
        let stick = |i: usize| {
            let [x, y] = [i % 31, i / 31 % 33].map(|k| k as f32);
            let [along, across] = if i.is_multiple_of(2) { [100.0, 0.01] } else { [0.01, 100.0] };
            [[x - along, y - across, 0.0], [x + along, y - across, 0.0], [x + along, y + across, 0.0]]
        };
        let g = Geometry::soup((0..n).flat_map(stick).collect(), Vec::new());
        let (mut set, extent) = references(&g, 4);
        let (first, _) = Partitioner::new(n, 4).part(&mut set, &extent, 0);
        let (a, b) = set.split_at(first);
        for side in [a, b] {
            assert_eq!(side.len(), n / 2);
            assert!(side.iter().all(|r| r.primitive % 2 == side[0].primitive % 2));
        }
    }
}
