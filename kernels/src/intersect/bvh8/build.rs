//! Building the tree in two steps, so that nothing large is held twice: first which primitives lie under which node,
//! by several threads from the root down; then, with the references gone and all sizes known, nodes and blocks in place.

use super::super::bounds;
use super::super::partition::{Extent, Partitioner, Reference, references};
use super::{BLOCK, Block, Bvh8, Child, EMPTY, LeafKind, MAX_LEAF, Node, WIDTH};
use crate::huge::HugeArray;
use crate::scene::Geometry;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use rayon::prelude::*;

/// Most spheres and quadrics of a leaf.
const MAX_ROUND: usize = 4;
/// A subtree of at least so many primitives is shared out among threads.
const SHARED: usize = 1 << 12;
/// Nodes that a thread fills at once.
const CHUNK: usize = 1 << 10;

/// Sets up to this size become wide nodes at the least cost; in larger ones the largest child is parted until there are
/// eight. Measured nodes and blocks of a bounce ray and bytes, the largest child parted everywhere : least cost up to 4096 :
/// everywhere, each with [`APART`]: metals 5.49 + 2.00, 2.7 MB : 5.28 + 1.80, 2.5 MB : 5.21 + 2.05, 2.3 MB; an avenue of 219
/// thousand triangles 7.78 + 2.43, 14.5 MB : 7.38 + 2.46, 13.2 MB : 7.33 + 2.55, 12.0 MB.
const SMALL: usize = 1 << 12;

/// Cost of a node's test in tests of a block. With 1 : 2 : 3 a bounce ray in metals meets 5.5 : 5.3 : 5.2 nodes and
/// 2.1 : 2.3 : 2.5 blocks.
const NODE_COST: f32 = 1.0;

/// Triangles of one block are parted if their boxes become so much smaller in sum: a floor and a wall, which every ray would
/// test together. With 0.7 : 0.9 : 1 a shadow ray in metals meets 3.9 : 2.9 : 3.9 blocks, and there are 11.1 : 12.1 : 13.3
/// thousand of them.
const APART: f32 = 0.9;

/// Which children a node has. Of a leaf, `count` primitives from place `first` of the order on; of an inner node,
/// `count` is [`Topology::INNER`] and `first` is its number; 0 is none.
#[derive(Clone, Copy)]
struct Topology {
    first: [u32; WIDTH],
    count: [u8; WIDTH],
}

impl Topology {
    const INNER: u8 = u8::MAX;
    const NONE: Topology = Topology { first: [0; WIDTH], count: [0; WIDTH] };

    /// The leaves: lane, and the places of their primitives.
    fn leaves(&self) -> impl Iterator<Item = (usize, core::ops::Range<usize>)> {
        let (first, count) = (self.first, self.count);
        (0..WIDTH).filter(move |&lane| !matches!(count[lane], 0 | Self::INNER)).map(move |lane| {
            let first = first[lane] as usize;
            (lane, first..first + count[lane] as usize)
        })
    }
}

/// Nodes below one node, each before those below it and each subtree in one piece, and the stack entries that a
/// traversal can need.
struct Subtree {
    nodes: Vec<Topology>,
    stack: usize,
}

/// A set of primitives that is to be a child.
#[derive(Clone, Copy)]
struct Part {
    first: usize,
    len: usize,
    extent: Extent,
    depth: u32,
    leaf: bool,
}

impl Part {
    fn of<'s>(&self, set: &'s mut [Reference]) -> &'s mut [Reference] {
        &mut set[self.first..self.first + self.len]
    }
}

/// A node of the binary tree over a small set, and the least that it can cost to test.
struct Binary {
    /// What it is about; a leaf if that is cheaper than a wide node.
    part: Part,
    /// The two halves; none where one test is all.
    halves: [u32; 2],
    /// `cost[k - 1]`: of all that is below as at most `k` children of a wide node.
    cost: [f32; WIDTH],
    /// `split[k - 1]`: how many of those children the first half has; 0: it is one child.
    split: [u8; WIDTH],
    /// The same, if it is a wide node itself.
    node_split: u8,
}

/// Nodes of a binary tree that become the children of a wide one.
struct Children {
    numbers: [u32; WIDTH],
    len: usize,
}

impl Children {
    fn push(&mut self, number: u32) {
        self.numbers[self.len] = number;
        self.len += 1;
    }
    /// Adds what is below `number`, as at most `k` children.
    fn gather(&mut self, tree: &[Binary], number: u32, k: usize) {
        let binary = &tree[number as usize];
        match binary.split[k - 1] as usize {
            0 => self.push(number),
            first => {
                self.gather(tree, binary.halves[0], first);
                self.gather(tree, binary.halves[1], k - first);
            }
        }
    }
}

struct Builder {
    partitioner: Partitioner,
    /// Number of the first primitive that is no triangle.
    first_round: u32,
}

impl Builder {
    /// Can the primitives of a set be one leaf?
    fn fits(&self, set: &[Reference]) -> bool {
        let round = set.iter().filter(|r| r.primitive >= self.first_round).count();
        round == 0 && set.len() <= MAX_LEAF as usize || round == set.len() && round <= MAX_ROUND
    }

    /// Adds the binary tree over a small set to `tree`, halves before the whole; returns its number.
    ///
    /// Of all ways to take nodes of a binary tree for the children of wide ones, the one with the least sum of areas times
    /// costs over all nodes and leaves is found from the leaves up (Ylitie, Karras and Laine 2017, "Efficient incoherent
    /// ray traversal on GPUs through compressed wide BVHs", section 4.1).
    fn binary(
        &self,
        set: &mut [Reference],
        first: usize,
        extent: Extent,
        depth: u32,
        tree: &mut Vec<Binary>,
    ) -> u32 {
        let area = extent.bounds.half_area();
        let tests = if set[0].primitive >= self.first_round { set.len() } else { set.len().div_ceil(BLOCK) };
        let fits = self.fits(set);
        let as_leaf = if fits { area * tests as f32 } else { f32::INFINITY };
        let part = Part { first, len: set.len(), extent, depth, leaf: true };
        let mut node =
            Binary { part, halves: [0; 2], cost: [as_leaf; WIDTH], split: [0; WIDTH], node_split: 0 };
        if set.len() > 1 {
            let (middle, [a, b]) = self.partitioner.part(set, &extent, depth);
            // What is one test can only be better in two where their boxes are small: a floor and a wall.
            if fits && tests == 1 && a.bounds.half_area() + b.bounds.half_area() >= APART * area {
                tree.push(node);
                return tree.len() as u32 - 1;
            }
            let (left, right) = set.split_at_mut(middle);
            let left = self.binary(left, first, a, depth + 1, tree);
            let right = self.binary(right, first + middle, b, depth + 1, tree);
            node.halves = [left, right];
            let [a, b] = [&tree[left as usize].cost, &tree[right as usize].cost];
            for k in 2..=WIDTH {
                node.cost[k - 1] = f32::INFINITY;
                for i in 1..k {
                    let cost = a[i - 1] + b[k - i - 1];
                    // The first way also where boxes overflow, and all costs are infinite.
                    if cost < node.cost[k - 1] || i == 1 {
                        (node.cost[k - 1], node.split[k - 1]) = (cost, i as u8);
                    }
                }
            }
            node.node_split = node.split[WIDTH - 1];
            let as_node = area * NODE_COST + node.cost[WIDTH - 1];
            node.part.leaf = fits && as_leaf <= as_node;
            node.cost[0] = if node.part.leaf { as_leaf } else { as_node };
            for k in 1..WIDTH {
                if node.cost[0] <= node.cost[k] {
                    (node.cost[k], node.split[k]) = (node.cost[0], 0);
                }
            }
        }
        tree.push(node);
        tree.len() as u32 - 1
    }

    /// Is a set best as one leaf, cheaper than as nodes or as two children of the same node?
    fn is_leaf(&self, set: &mut [Reference], extent: &Extent, depth: u32) -> bool {
        if set.len() > MAX_LEAF as usize {
            return false;
        }
        let mut tree = Vec::with_capacity(2 * MAX_LEAF as usize);
        let root = self.binary(set, 0, *extent, depth, &mut tree);
        tree[root as usize].part.leaf && tree[root as usize].split[1] == 0
    }

    /// Adds the wide nodes over what `root` of the binary tree over `set` stands for; arguments as of `subtree`.
    fn small(
        &self,
        set: &mut [Reference],
        at: usize,
        tree: &[Binary],
        root: u32,
        held: usize,
        out: &mut Subtree,
    ) {
        let mut children = Children { numbers: [0; WIDTH], len: 0 };
        let whole = &tree[root as usize];
        if whole.part.leaf {
            children.push(root);
        } else {
            let first = whole.node_split as usize;
            children.gather(tree, whole.halves[0], first);
            children.gather(tree, whole.halves[1], WIDTH - first);
        }
        let node = out.nodes.len();
        out.nodes.push(Topology::NONE);
        out.stack = out.stack.max(held + children.len + WIDTH);
        for (lane, &child) in children.numbers[..children.len].iter().enumerate() {
            let part = &tree[child as usize].part;
            if part.leaf {
                part.of(set).sort_unstable_by_key(|r| r.primitive);
                out.nodes[node].first[lane] = (at + part.first) as u32;
                out.nodes[node].count[lane] = part.len as u8;
            }
        }
        for (lane, &child) in children.numbers[..children.len].iter().enumerate() {
            if !tree[child as usize].part.leaf {
                out.nodes[node].first[lane] = out.nodes.len() as u32;
                out.nodes[node].count[lane] = Topology::INNER;
                self.small(set, at, tree, child, held + children.len, out);
            }
        }
    }

    /// Adds the node over `set`, and all below it. `at` is the place of the set in the order, `held` the number of stack
    /// entries that a traversal holds when it gets there.
    fn subtree(
        &self,
        set: &mut [Reference],
        at: usize,
        extent: Extent,
        depth: u32,
        held: usize,
        out: &mut Subtree,
    ) {
        if set.len() <= SMALL {
            let mut tree = Vec::with_capacity(set.len());
            let root = self.binary(set, 0, extent, depth, &mut tree);
            self.small(set, at, &tree, root, held, out);
            return;
        }
        let mut parts = [Part { first: 0, len: set.len(), extent, depth, leaf: false }; WIDTH];
        let mut children = 1;
        // The largest inner one is parted until there are eight.
        while children < WIDTH {
            let area = |part: &Part| part.extent.bounds.half_area();
            let inner = parts[..children].iter().enumerate().filter(|(_, part)| !part.leaf);
            let Some((place, _)) = inner.max_by(|a, b| area(a.1).total_cmp(&area(b.1))) else { break };
            let whole = parts[place];
            let here = whole.of(set);
            let depth = whole.depth + 1;
            let (first, extents) = self.partitioner.part(here, &whole.extent, whole.depth);
            let (left, right) = here.split_at_mut(first);
            let side = |set: &mut [Reference], first, extent| Part {
                first,
                len: set.len(),
                extent,
                depth,
                leaf: self.is_leaf(set, &extent, depth),
            };
            parts[place] = side(left, whole.first, extents[0]);
            parts[children] = side(right, whole.first + first, extents[1]);
            children += 1;
        }
        let parts = &parts[..children];
        let node = out.nodes.len();
        out.nodes.push(Topology::NONE);
        out.stack = out.stack.max(held + children + WIDTH);
        for (lane, part) in parts.iter().enumerate().filter(|(_, part)| part.leaf) {
            part.of(set).sort_unstable_by_key(|r| r.primitive);
            out.nodes[node].first[lane] = (at + part.first) as u32;
            out.nodes[node].count[lane] = part.len as u8;
        }
        let inner = parts.iter().enumerate().filter(|(_, part)| !part.leaf);
        if set.len() < SHARED {
            for (lane, part) in inner {
                out.nodes[node].first[lane] = out.nodes.len() as u32;
                out.nodes[node].count[lane] = Topology::INNER;
                self.subtree(part.of(set), at + part.first, part.extent, part.depth, held + children, out);
            }
            return;
        }
        // The same, each child by itself and then behind the one before.
        let mut tasks: Vec<(usize, &Part)> = inner.collect();
        tasks.sort_unstable_by_key(|(_, part)| part.first);
        let (mut rest, mut begin) = (set, 0);
        let mut disjoint = Vec::new();
        for (lane, part) in tasks {
            let (_, from) = core::mem::take(&mut rest).split_at_mut(part.first - begin);
            let (set, behind) = from.split_at_mut(part.len);
            (rest, begin) = (behind, part.first + part.len);
            disjoint.push((lane, part, set));
        }
        let mut subtrees: Vec<(usize, Subtree)> = disjoint
            .into_par_iter()
            .map(|(lane, part, set)| {
                let mut below = Subtree { nodes: Vec::new(), stack: 0 };
                self.subtree(set, at + part.first, part.extent, part.depth, held + children, &mut below);
                (lane, below)
            })
            .collect();
        subtrees.sort_unstable_by_key(|(lane, _)| *lane);
        for (lane, below) in subtrees {
            let offset = out.nodes.len() as u32;
            out.nodes[node].first[lane] = offset;
            out.nodes[node].count[lane] = Topology::INNER;
            out.nodes.extend(below.nodes.into_iter().map(|mut topology| {
                for lane in 0..WIDTH {
                    if topology.count[lane] == Topology::INNER {
                        topology.first[lane] += offset;
                    }
                }
                topology
            }));
            out.stack = out.stack.max(below.stack);
        }
    }
}

impl<'a> Bvh8<'a> {
    /// Builds the tree, with the threads of rayon's current pool: it is the same with any number of them. Scenes of up
    /// to four primitives walk it as well: testing them all without their boxes took 0.99 to 1.005 of the time.
    pub fn new(geometry: &'a Geometry) -> Self {
        let mut tree = Subtree { nodes: Vec::new(), stack: WIDTH };
        let mut order = Vec::new();
        if geometry.primitives() > 0 {
            let (mut set, extent) = references(geometry, BLOCK as u32);
            let partitioner = Partitioner::new(set.len(), BLOCK as u32);
            let builder = Builder { partitioner, first_round: geometry.first_sphere() };
            builder.subtree(&mut set, 0, extent, 0, 0, &mut tree);
            order = set.iter().map(|reference| reference.primitive).collect();
        }
        fill(geometry, tree, &order)
    }
}

/// A run of nodes and what belongs to their leaves.
struct Run<'r> {
    topology: &'r [Topology],
    nodes: &'r mut [Node],
    first_block: usize,
    blocks: &'r mut [Block],
    first_round: usize,
    round: &'r mut [u32],
}

/// Writes nodes, blocks and the order of other primitives.
fn fill<'a>(geometry: &'a Geometry, tree: Subtree, order: &[u32]) -> Bvh8<'a> {
    let topology = tree.nodes;
    let is_round = |places: &core::ops::Range<usize>| order[places.start] >= geometry.first_sphere();
    let sizes = |topology: &Topology| {
        topology.leaves().fold((0, 0), |(blocks, round), (_, places)| {
            if is_round(&places) {
                (blocks, round + places.len())
            } else {
                (blocks + places.len().div_ceil(BLOCK), round)
            }
        })
    };
    let chunks: Vec<(usize, usize)> = topology
        .par_chunks(CHUNK)
        .map(|chunk| chunk.iter().map(sizes).fold((0, 0), |sum, size| (sum.0 + size.0, sum.1 + size.1)))
        .collect();
    let (all_blocks, all_round) = chunks.iter().fold((0, 0), |sum, size| (sum.0 + size.0, sum.1 + size.1));
    let mut nodes = HugeArray::<Node>::zeroed(topology.len());
    let mut blocks = HugeArray::<Block>::zeroed(all_blocks);
    let mut round = vec![0; all_round];
    {
        let mut runs = Vec::with_capacity(chunks.len());
        let (mut nodes, mut blocks, mut round) = (&mut nodes[..], &mut blocks[..], &mut round[..]);
        let (mut first_block, mut first_round) = (0, 0);
        for (topology, &(block_count, round_count)) in topology.chunks(CHUNK).zip(&chunks) {
            let (these, behind) = nodes.split_at_mut(topology.len());
            nodes = behind;
            let (block_run, behind) = blocks.split_at_mut(block_count);
            blocks = behind;
            let (round_run, behind) = round.split_at_mut(round_count);
            round = behind;
            runs.push(Run {
                topology,
                nodes: these,
                first_block,
                blocks: block_run,
                first_round,
                round: round_run,
            });
            first_block += block_count;
            first_round += round_count;
        }
        runs.into_par_iter().for_each(|run| run.fill(geometry, order));
    }
    // Each node stands before those below it, so that from the last to the first all boxes below are known.
    for n in (0..topology.len()).rev() {
        for lane in 0..WIDTH {
            if topology[n].count[lane] == Topology::INNER {
                let below = nodes[topology[n].first[lane] as usize].around();
                nodes[n].set_lane(lane, &below);
            }
        }
    }
    nodes.par_chunks_mut(CHUNK).for_each(|chunk| chunk.iter_mut().for_each(Node::set_order));
    Bvh8 { geometry, nodes, blocks, round, stack: tree.stack }
}

impl Run<'_> {
    /// All but the boxes of inner children, which may not be known yet.
    fn fill(self, geometry: &Geometry, order: &[u32]) {
        let (mut block, mut round) = (0, 0);
        for (topology, node) in self.topology.iter().zip(self.nodes) {
            // Absent children are turned inside out: every ray enters them at infinity.
            let (low, high) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
            *node =
                Node { bounds: [low, high, low, high, low, high], child: [EMPTY.0; WIDTH], order: [0; 8] };
            for lane in 0..WIDTH {
                if topology.count[lane] == Topology::INNER {
                    node.child[lane] = topology.first[lane];
                }
            }
            for (lane, places) in topology.leaves() {
                let primitives = &order[places];
                let around = primitives.iter().map(|&p| {
                    let (low, high) = bounds(geometry, p);
                    Aabb { min: Vec3A::from(low), max: Vec3A::from(high) }
                });
                node.set_lane(lane, &around.reduce(|a, b| a.union(&b)).unwrap_or_default());
                let child = if primitives[0] >= geometry.first_sphere() {
                    let first = round;
                    round += primitives.len();
                    self.round[first..round].copy_from_slice(primitives);
                    Child::leaf(LeafKind::Others, self.first_round + first, primitives.len())
                } else {
                    let first = block;
                    block += primitives.len().div_ceil(BLOCK);
                    for (block, four) in self.blocks[first..block].iter_mut().zip(primitives.chunks(BLOCK)) {
                        *block = Block::new(geometry, four);
                    }
                    Child::leaf(LeafKind::Blocks, self.first_block + first, block - first)
                };
                node.child[lane] = child.0;
            }
        }
    }
}

impl Node {
    fn set_lane(&mut self, lane: usize, bounds: &Aabb) {
        for axis in 0..3 {
            self.bounds[2 * axis][lane] = bounds.min[axis];
            self.bounds[2 * axis + 1][lane] = bounds.max[axis];
        }
    }

    /// The box around all children.
    pub(super) fn around(&self) -> Aabb {
        let low = |row: usize| self.bounds[row].iter().copied().fold(f32::INFINITY, f32::min);
        let high = |row: usize| self.bounds[row].iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Aabb { min: Vec3A::new(low(0), low(2), low(4)), max: Vec3A::new(high(1), high(3), high(5)) }
    }

    /// Sets [`Node::order`]: by the corner of each box where rays of the octant enter it, along the diagonal. Absent
    /// children come first.
    fn set_order(&mut self) {
        for octant in 0..8 {
            let entry = |lane: usize| -> f32 {
                let side = |axis: usize| {
                    let (row, sign) = if octant >> axis & 1 == 0 { (0, 1.0) } else { (1, -1.0) };
                    sign * self.bounds[2 * axis + row][lane]
                };
                side(0) + side(1) + side(2)
            };
            let entries: [f32; WIDTH] = core::array::from_fn(entry);
            let mut lanes: [u8; WIDTH] = core::array::from_fn(|lane| lane as u8);
            lanes.sort_by(|&a, &b| entries[b as usize].total_cmp(&entries[a as usize]));
            self.order[octant] = lanes.iter().rev().fold(0, |bits, &lane| bits << 3 | lane as u32);
        }
    }
}

impl Block {
    /// Up to four triangles; the last is repeated where there are fewer.
    fn new(geometry: &Geometry, triangles: &[u32]) -> Self {
        let mut block = Block { corners: [[[0.0; BLOCK]; 3]; 3], primitive: [0; BLOCK] };
        for lane in 0..BLOCK {
            let p = triangles[lane.min(triangles.len() - 1)];
            for (k, corner) in geometry.corners(p as usize).iter().enumerate() {
                for (axis, &x) in corner.iter().enumerate() {
                    block.corners[k][axis][lane] = x;
                }
            }
            block.primitive[lane] = p;
        }
        block
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_number_of_threads_builds_the_same_tree() {
        // Enough to be shared, and in no order; xorshift.
        let mut state = 0x2545_f491_u32;
        let mut unit = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let n = 100_000;
        let vertices = (0..n).flat_map(|_| {
            let at = [unit(), unit(), unit()];
            core::array::from_fn::<_, 3, _>(|_| at.map(|x| x + 0.01 * unit()))
        });
        let spheres = (0..1_000).map(|i| [i as f32 * 0.001, 0.5, 0.5, 0.01]).collect();
        let geometry = Geometry::soup(vertices.collect(), spheres);
        let build = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Bvh8::new(&geometry))
        };
        let (one, many) = (build(1), build(5));
        assert!(bytemuck::cast_slice::<_, u32>(&one.nodes) == bytemuck::cast_slice::<_, u32>(&many.nodes));
        assert!(bytemuck::cast_slice::<_, u32>(&one.blocks) == bytemuck::cast_slice::<_, u32>(&many.blocks));
        assert_eq!(one.round, many.round);
        assert_eq!(one.stack, many.stack);
        // Every primitive is in one leaf.
        let mut found = one.round.to_vec();
        for block in &one.blocks[..] {
            let mut primitives = block.primitive.to_vec();
            primitives.dedup();
            found.extend(primitives);
        }
        found.sort_unstable();
        assert!(found.into_iter().eq(0..geometry.primitives() as u32));
    }
}
