//! An 8-wide tree, collapsed from obvhs' binary one, with triangles gathered four to a block.

mod interleaved;
mod packet;
mod single;

use super::ray_sort::RaySorter;
use super::{
    Accelerator, Hit, PacketDistances, PacketHit, RayClass, RayPacket, Traversal, TraversalStack, bvh2,
};
use crate::huge::HugeArray;
use crate::isa::Isa;
use crate::queue::{HitQueue, PathQueue, ShadowQueue};
use crate::scene::{Geometry, MISS};
use bytemuck::{Pod, Zeroable};
use core::ops::Range;
use interleaved::IN_FLIGHT;
use obvhs::bvh2::Bvh2;

/// Children of a node.
const WIDTH: usize = 8;
/// Triangles of a block.
const BLOCK: usize = 4;
/// Most triangles of a leaf.
const MAX_LEAF: u32 = 8;

/// A child that is not there.
const EMPTY: Child = Child(u32::MAX);

/// A node's child: an inner node (its number), or a leaf: the top bit is set, then one bit says triangles (0) or
/// others (1), three bits hold the number of blocks or primitives less one, the rest the number of the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;
    const ROUND: u32 = 1 << 30;
    const COUNT_SHIFT: u32 = 27;
    const FIRST: u32 = (1 << Self::COUNT_SHIFT) - 1;

    fn leaf(round: bool, first: usize, count: usize) -> Self {
        assert!(first as u32 <= Self::FIRST && (1..=8).contains(&count));
        let kind = if round { Self::ROUND } else { 0 };
        Child(Self::LEAF | kind | (count as u32 - 1) << Self::COUNT_SHIFT | first as u32)
    }
    #[inline(always)]
    fn range(self) -> core::ops::Range<usize> {
        let first = (self.0 & Self::FIRST) as usize;
        first..first + 1 + (self.0 >> Self::COUNT_SHIFT & 7) as usize
    }
}

/// Eight boxes: `bounds[2 * axis]` holds the lower, `bounds[2 * axis + 1]` the upper sides. Four cache lines.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct Node {
    bounds: [[f32; WIDTH]; 6],
    child: [u32; WIDTH],
    /// For each octant of directions (bit `axis` is set if that component is negative), the children from the farthest
    /// to the nearest: three bits each, the farthest lowest.
    order: [u32; 8],
}

impl Node {
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
            let mut lanes: [usize; WIDTH] = core::array::from_fn(|lane| lane);
            lanes.sort_by(|&a, &b| entry(b).total_cmp(&entry(a)));
            self.order[octant] = lanes.iter().rev().fold(0, |bits, &lane| bits << 3 | lane as u32);
        }
    }
}

/// Four triangles; the last is repeated where there are fewer.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
struct Block {
    /// Corner, axis, triangle.
    corners: [[[f32; BLOCK]; 3]; 3],
    primitive: [u32; BLOCK],
}

/// The tree.
pub struct Bvh8<'a> {
    geometry: &'a Geometry,
    nodes: HugeArray<Node>,
    blocks: HugeArray<Block>,
    /// Spheres and quadrics in the order of the leaves.
    round: Vec<u32>,
    /// Stack entries that a traversal can need, and a vector behind them.
    stack: usize,
}

/// What the collapse knows about a node of the binary tree.
#[derive(Clone, Copy, Default)]
struct Summary {
    triangles: u32,
    round: u32,
    cost: f32,
    leaf: bool,
}

struct Collapse<'t, 'a> {
    tree: &'t Bvh2,
    summaries: Vec<Summary>,
    out: Parts<'a>,
}

/// What the collapse makes.
struct Parts<'a> {
    geometry: &'a Geometry,
    nodes: Vec<Node>,
    blocks: Vec<Block>,
    round: Vec<u32>,
    stack: usize,
}

impl<'a> Parts<'a> {
    fn finish(self) -> Bvh8<'a> {
        let Parts { geometry, nodes, blocks, round, stack } = self;
        Bvh8 { geometry, nodes: nodes.into(), blocks: blocks.into(), round, stack }
    }
}

impl<'a> Bvh8<'a> {
    /// Bounce rays go through trees up to this size (bytes) in packets: nodes are few, and a packet loads each of them
    /// once.
    ///
    /// Measured time of bounce rays, packets : single : interleaved. Cornell box (16 primitives) 1 : 3.7 : 3.7; panes
    /// (0.5 MiB) 1 : 1.8 : 2.1; 144 lamps (0.6 MiB) 1 : 1.4 : 1.3; glass (0.8 MiB) 1 : 0.9 : 0.9; still life (1.9 MiB)
    /// 1 : 1 : 0.8; knot (6 MiB) 1 : 0.6 : 0.36; two million triangles (151 MiB) 1 : 0.8 : 0.2.
    ///
    /// They are put in order first, but where the tree is one node. Measured time of intersection without order over
    /// that with it: Cornell box 1.21; caustics 1.06, a glass pane 1.04, 97 lamps 1.03, a row of matt figures 0.94; two
    /// spheres in one node 0.97. Of shadow rays: 0.80 to 1.03.
    const PACKETS_BOUNCE: usize = 768 << 10;
    /// The same for later shadow rays. They stop at the first hit, and go where the lamps are.
    ///
    /// Measured as above. Cornell box 1 : 4 : 5; glass 1 : 2 : 2; still life 1 : 1.2 : 1.1; metals (3.2 MiB)
    /// 1 : 1.4 : 1.4; knot 1 : 1 : 0.6; two million triangles 1 : 1 : 0.3.
    const PACKETS_SHADOW: usize = 4 << 20;

    /// Builds the tree. Scenes of up to four primitives walk it as well: testing them all without their boxes took 0.99
    /// to 1.005 of the time.
    pub fn new(geometry: &'a Geometry) -> Self {
        let out = Parts { geometry, nodes: Vec::new(), blocks: Vec::new(), round: Vec::new(), stack: WIDTH };
        if geometry.primitives() == 0 {
            return out.finish();
        }
        let tree = bvh2::build(geometry, 1);
        let mut collapse =
            Collapse { summaries: vec![Summary::default(); tree.nodes.len()], tree: &tree, out };
        collapse.summarise();
        collapse.nodes();
        collapse.out.finish()
    }
}

impl Collapse<'_, '_> {
    fn is_round(&self, node: usize) -> bool {
        let n = &self.tree.nodes[node];
        self.tree.primitive_indices[n.first_index as usize] >= self.out.geometry.first_sphere()
    }

    /// Bottom-up surface-area cost of every subtree, as a leaf or not. Without recursion: trees of equal boxes can be
    /// as deep as they have primitives.
    fn summarise(&mut self) {
        let mut order = vec![0usize];
        let mut at = 0;
        while at < order.len() {
            let node = &self.tree.nodes[order[at]];
            if !node.is_leaf() {
                order.extend([node.first_index as usize, node.first_index as usize + 1]);
            }
            at += 1;
        }
        for &n in order.iter().rev() {
            let node = &self.tree.nodes[n];
            let area = node.aabb().half_area();
            self.summaries[n] = if node.is_leaf() {
                let round = self.is_round(n);
                let count = node.prim_count;
                Summary {
                    triangles: if round { 0 } else { count },
                    round: if round { count } else { 0 },
                    cost: area,
                    leaf: true,
                }
            } else {
                let left = self.summaries[node.first_index as usize];
                let right = self.summaries[node.first_index as usize + 1];
                let triangles = left.triangles + right.triangles;
                let round = left.round + right.round;
                let pure = triangles == 0 || round == 0;
                let blocks = triangles.div_ceil(BLOCK as u32) + round;
                let as_leaf = area * blocks as f32;
                // Half the cost of a block test: a node of eight shares its test among the children of three levels.
                let as_node = area * 0.5 + left.cost + right.cost;
                let leaf = pure
                    && triangles <= MAX_LEAF
                    && round <= 4
                    && left.leaf
                    && right.leaf
                    && (as_leaf <= as_node || (round == 0 && triangles <= BLOCK as u32));
                Summary { triangles, round, cost: if leaf { as_leaf } else { as_node }, leaf }
            };
        }
    }

    /// Primitives under a node that became a leaf.
    fn primitives(&self, node: usize) -> Vec<u32> {
        let mut out = Vec::new();
        let mut stack = vec![node];
        while let Some(n) = stack.pop() {
            let node = &self.tree.nodes[n];
            let first = node.first_index as usize;
            if node.is_leaf() {
                out.extend(&self.tree.primitive_indices[first..first + node.prim_count as usize]);
            } else {
                stack.extend([first, first + 1]);
            }
        }
        out.sort_unstable();
        out.dedup();
        out
    }

    fn leaf(&mut self, node: usize) -> Child {
        let primitives = self.primitives(node);
        if self.summaries[node].round > 0 {
            let first = self.out.round.len();
            self.out.round.extend(&primitives);
            return Child::leaf(true, first, primitives.len());
        }
        let first = self.out.blocks.len();
        for four in primitives.chunks(BLOCK) {
            let mut block = Block { corners: [[[0.0; BLOCK]; 3]; 3], primitive: [0; BLOCK] };
            for lane in 0..BLOCK {
                let p = four[lane.min(four.len() - 1)];
                let corners = self.out.geometry.corners(p as usize);
                for (k, corner) in corners.iter().enumerate() {
                    for (axis, &x) in corner.iter().enumerate() {
                        block.corners[k][axis][lane] = x;
                    }
                }
                block.primitive[lane] = p;
            }
            self.out.blocks.push(block);
        }
        Child::leaf(false, first, self.out.blocks.len() - first)
    }

    /// Children of a wide node: the binary node's, with the largest inner one opened until there are eight.
    fn children(&self, node: usize) -> Vec<usize> {
        let mut children = vec![node];
        while children.len() < WIDTH {
            let area = |&n: &usize| self.tree.nodes[n].aabb().half_area();
            let inner = children.iter().copied().enumerate().filter(|(_, n)| !self.summaries[*n].leaf);
            let Some((place, open)) = inner.max_by(|a, b| area(&a.1).total_cmp(&area(&b.1))) else { break };
            let first = self.tree.nodes[open].first_index as usize;
            children[place] = first;
            children.push(first + 1);
        }
        children
    }

    fn nodes(&mut self) {
        // Depth first, so that a subtree is contiguous; the place to fill in is kept with each entry, and the number
        // of stack entries that a traversal holds when it gets there.
        let mut pending = vec![(0usize, None::<(usize, usize)>, 0usize)];
        let mut root_is_leaf = self.summaries[0].leaf;
        while let Some((binary, parent, held)) = pending.pop() {
            let id = self.out.nodes.len();
            if let Some((node, lane)) = parent {
                self.out.nodes[node].child[lane] = id as u32;
            }
            // Absent children are turned inside out: every ray enters them at infinity.
            let (low, high) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
            let mut node =
                Node { bounds: [low, high, low, high, low, high], child: [EMPTY.0; WIDTH], order: [0; 8] };
            let children = if root_is_leaf { vec![binary] } else { self.children(binary) };
            root_is_leaf = false;
            self.out.stack = self.out.stack.max(held + children.len() + WIDTH);
            let mut inner = Vec::new();
            for (lane, &child) in children.iter().enumerate() {
                let bounds = *self.tree.nodes[child].aabb();
                for axis in 0..3 {
                    node.bounds[2 * axis][lane] = bounds.min[axis];
                    node.bounds[2 * axis + 1][lane] = bounds.max[axis];
                }
                if self.summaries[child].leaf {
                    node.child[lane] = self.leaf(child).0;
                } else {
                    inner.push((child, Some((id, lane)), held + children.len()));
                }
            }
            node.set_order();
            self.out.nodes.push(node);
            pending.extend(inner.into_iter().rev());
        }
    }
}

impl Accelerator for Bvh8<'_> {
    const NAME: &'static str = "BVH8";

    #[inline(always)]
    fn closest<I: Isa>(
        &self,
        _: I,
        origin: [f32; 3],
        direction: [f32; 3],
        stack: &mut TraversalStack,
    ) -> Hit {
        let none = Hit::none(f32::INFINITY);
        self.walk::<I, false>(Child(0), origin, direction, none, stack)
    }
    #[inline(always)]
    fn occluded<I: Isa>(
        &self,
        _: I,
        origin: [f32; 3],
        direction: [f32; 3],
        distance: f32,
        stack: &mut TraversalStack,
    ) -> bool {
        let none = Hit::none(distance);
        self.walk::<I, true>(Child(0), origin, direction, none, stack).primitive != MISS
    }
    #[inline(always)]
    fn closest_packets<I: Isa, const V: usize>(
        &self,
        _: I,
        rays: &[RayPacket<I::Wide>; V],
        stack: &mut TraversalStack,
    ) -> [PacketHit<I::Wide>; V] {
        self.walk_packets::<I, V>(rays, stack)
    }
    #[inline(always)]
    fn occluded_packets<I: Isa, const V: usize>(
        &self,
        _: I,
        rays: &[RayPacket<I::Wide>; V],
        distance: &[I::Wide; V],
        stack: &mut TraversalStack,
    ) -> u64 {
        self.walk_packets_any::<I, V>(rays, distance, stack)
    }
    #[inline(always)]
    fn closest_interleaved<I: Isa>(
        &self,
        _: I,
        paths: &PathQueue,
        mut range: Range<usize>,
        hits: &mut HitQueue,
        stack: &mut TraversalStack,
    ) {
        let next = || {
            let i = range.next()?;
            let (origin, direction) = paths.ray(i);
            Some((i, origin, direction, f32::INFINITY))
        };
        self.walk_interleaved::<I, false>(stack, next, |i, hit| hits.put(i, hit));
    }
    #[inline(always)]
    fn unoccluded_interleaved<I: Isa>(
        &self,
        _: I,
        shadows: &ShadowQueue,
        mut range: Range<usize>,
        stack: &mut TraversalStack,
        mut unblocked: impl FnMut(usize),
    ) {
        let next = || {
            let i = range.next()?;
            let (origin, direction, distance) = shadows.ray(i);
            Some((i, origin, direction, distance))
        };
        self.walk_interleaved::<I, true>(stack, next, |i, hit| {
            if hit.primitive == MISS {
                unblocked(i);
            }
        });
    }
    fn traversal(&self, class: RayClass) -> Traversal {
        let small = match class {
            RayClass::Camera | RayClass::FirstShadow => true,
            RayClass::Bounce => self.bytes() <= Self::PACKETS_BOUNCE,
            RayClass::LaterShadow => self.bytes() <= Self::PACKETS_SHADOW,
        };
        match class {
            _ if !small => Traversal::Interleaved,
            RayClass::Bounce if self.nodes.len() > 1 => Traversal::Sorted,
            _ => Traversal::Packets,
        }
    }
    fn bounds(&self) -> [[f32; 3]; 2] {
        let Some(root) = self.nodes.first() else { return [[0.0; 3]; 2] };
        let low = |row: usize| root.bounds[row].iter().copied().fold(f32::INFINITY, f32::min);
        let high = |row: usize| root.bounds[row].iter().copied().fold(f32::NEG_INFINITY, f32::max);
        [[low(0), low(2), low(4)], [high(1), high(3), high(5)]]
    }
    fn stack(&self) -> TraversalStack {
        TraversalStack {
            nodes: vec![0; IN_FLIGHT * self.stack],
            distances: vec![0.0; IN_FLIGHT * self.stack],
            sorter: RaySorter::new(self.bounds()),
            lanes: vec![(0, 0); self.stack],
            packets: vec![(0, PacketDistances::default()); self.stack],
        }
    }
    fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.blocks[..]) + size_of_val(&self.round[..])
    }
}
