//! An 8-wide tree with triangles gathered four to a block.

mod build;
mod interleaved;
mod packet;
mod single;

use super::ray_sort::RaySorter;
use super::{Accelerator, Hit, PacketDistances, PacketHit, RayClass, RayPacket, Traversal, TraversalStack};
use crate::huge::HugeArray;
use crate::isa::Isa;
use crate::queue::{HitQueue, PathQueue, ShadowQueue};
use crate::scene::{Geometry, MISS};
use bytemuck::{Pod, Zeroable};
use core::ops::Range;
use interleaved::IN_FLIGHT;

/// Children of a node.
const WIDTH: usize = 8;
/// Triangles of a block.
const BLOCK: usize = 4;
/// Most triangles of a leaf.
const MAX_LEAF: u32 = 8;

/// A child that is not there.
const EMPTY: Child = Child(u32::MAX);

/// What a leaf holds. The walks ask with a `match`: a further kind is a variant here and an arm in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
enum LeafKind {
    /// Blocks of triangles.
    Blocks = 0,
    /// Other primitives, by number: spheres, and what [`crate::scene::shapes`] holds.
    Others = 1,
}

/// A node's child: an inner node (its number), or a leaf: the top bit is set, then two bits hold the [`LeafKind`], two
/// the number of blocks or primitives less one, the rest the number of the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;
    const KIND_SHIFT: u32 = 29;
    const COUNT_SHIFT: u32 = 27;
    const MOST: usize = 1 << (Self::KIND_SHIFT - Self::COUNT_SHIFT);
    const FIRST: u32 = (1 << Self::COUNT_SHIFT) - 1;

    fn leaf(kind: LeafKind, first: usize, count: usize) -> Self {
        assert!(first <= Self::FIRST as usize && (1..=Self::MOST).contains(&count));
        let (kind, count) = ((kind as u32) << Self::KIND_SHIFT, (count as u32 - 1) << Self::COUNT_SHIFT);
        Child(Self::LEAF | kind | count | first as u32)
    }
    /// What a leaf holds.
    #[inline(always)]
    fn kind(self) -> LeafKind {
        match self.0 >> Self::KIND_SHIFT & 3 {
            0 => LeafKind::Blocks,
            _ => LeafKind::Others,
        }
    }
    #[inline(always)]
    fn range(self) -> core::ops::Range<usize> {
        let first = (self.0 & Self::FIRST) as usize;
        first..first + 1 + (self.0 >> Self::COUNT_SHIFT) as usize % Self::MOST
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

impl Bvh8<'_> {
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
}

impl Bvh8<'_> {
    /// Is this the tree of `geometry`, the very same?
    pub fn is_of(&self, geometry: &Geometry) -> bool {
        core::ptr::eq(self.geometry, geometry)
    }

    /// Sees to it that a stack has room for rays in flight and for packets: one of another tree may be shorter.
    #[inline(always)]
    fn fit(&self, stack: &mut TraversalStack) {
        // The columns are made together, in `stack`, and keep their lengths: one of them tells of all.
        if stack.lanes.len() < self.stack {
            self.renew_stack(stack);
        }
        debug_assert!(stack.nodes.len() >= IN_FLIGHT * self.stack && stack.packets.len() >= self.stack);
        debug_assert_eq!(stack.nodes.len(), stack.distances.len());
    }
    #[cold]
    #[inline(never)]
    fn renew_stack(&self, stack: &mut TraversalStack) {
        *stack = self.stack();
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
        self.nodes.first().map_or([[0.0; 3]; 2], |root| {
            let around = root.around();
            [around.min.into(), around.max.into()]
        })
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
