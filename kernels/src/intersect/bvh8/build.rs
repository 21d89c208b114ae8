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

/// Cost of a node's test in tests of a block: a node of eight shares its test among the children of three levels.
const NODE_COST: f32 = 0.5;

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

/// What it costs to test a small set.
struct Cost {
    cost: f32,
    leaf: bool,
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

    /// Is a set cheaper as a leaf or as nodes? Bottom-up, as far as leaves reach.
    fn cost(&self, set: &mut [Reference], extent: &Extent, depth: u32) -> Cost {
        let area = extent.bounds.half_area();
        let fits = self.fits(set);
        let round = set[0].primitive >= self.first_round;
        let tests = if round { set.len() } else { set.len().div_ceil(BLOCK) };
        let as_leaf = area * tests as f32;
        if fits && tests == 1 {
            return Cost { cost: as_leaf, leaf: true };
        }
        let (first, [a, b]) = self.partitioner.part(set, extent, depth);
        let (left, right) = set.split_at_mut(first);
        let left = self.cost(left, &a, depth + 1);
        let right = self.cost(right, &b, depth + 1);
        let as_node = area * NODE_COST + left.cost + right.cost;
        let leaf = fits && left.leaf && right.leaf && as_leaf <= as_node;
        Cost { cost: if leaf { as_leaf } else { as_node }, leaf }
    }

    fn is_leaf(&self, set: &mut [Reference], extent: &Extent, depth: u32) -> bool {
        set.len() <= MAX_LEAF as usize && self.cost(set, extent, depth).leaf
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
        let leaf = depth == 0 && self.is_leaf(set, &extent, 0);
        let mut parts = [Part { first: 0, len: set.len(), extent, depth, leaf }; WIDTH];
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
