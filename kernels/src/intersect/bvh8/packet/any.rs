//! Whether rays meet anything.
//!
//! No distances are kept and nothing is ordered: a node that waits has a bit for each ray that enters it. (As
//! [`super::closest`] does it: 1.1 to 1.25 times the time.)

use super::bounds::Bounds;
use super::{Meet, Prepared};
use crate::intersect::bvh2::beyond;
use crate::intersect::bvh8::{Block, Bvh8, Child, LeafKind};
use crate::intersect::triangle::TriangleHits;
use crate::intersect::{Hit, PACKET_BITS, RayPacket, TraversalStack};
use crate::isa::Isa;
use crate::lanes::{Mask, Real};
use crate::scene::MISS;

/// Rays that have met nothing, a bit each.
struct Free<'a>(&'a mut u32);

impl<F: Real> Meet<F> for Free<'_> {
    #[inline(always)]
    fn meet(&mut self, _: &Block, ray: usize, _: usize, _: &TriangleHits<F>) {
        *self.0 &= !(1 << ray);
    }
}

impl Bvh8<'_> {
    /// The active rays that meet anything within their distance, as of
    /// [`occluded_packets`](crate::intersect::Accelerator::occluded_packets).
    #[inline(always)]
    pub(in crate::intersect::bvh8) fn walk_packets_any<I: Isa, const V: usize>(
        &self,
        rays: &[RayPacket<I::Wide>; V],
        distance: &[I::Wide; V],
        stack: &mut TraversalStack,
    ) -> u64 {
        let mut packets = [Prepared::new(&rays[0]); V];
        let mut limit = [I::Wide::zero(); V];
        let mut furthest = I::Wide::zero();
        let mut active = 0;
        for v in 0..V {
            packets[v] = Prepared::new(&rays[v]);
            limit[v] = beyond(distance[v]);
            // A distance that is no number is none of the largest.
            furthest = I::Wide::select(rays[v].active & furthest.lt(limit[v]), limit[v], furthest);
            active |= (rays[v].active.bits() as u64) << (PACKET_BITS * v);
        }
        if self.nodes.is_empty() || active == 0 {
            return 0;
        }
        let bounds = Bounds::new(&packets);
        let (near, reach) = (bounds.near(), furthest.largest());
        self.fit(stack);
        let waiting = stack.lanes.as_mut_ptr();
        let mut held = 0usize;
        // Rays that have met nothing, and those of them that are in the current node.
        let mut free = active;
        let mut current = Child(0);
        let mut lanes = active;
        loop {
            if current.0 & Child::LEAF != 0 {
                for v in 0..V {
                    let rays = (lanes >> (PACKET_BITS * v)) as u16 as u32;
                    if rays != 0 {
                        let met = self.packet_leaf_any::<I>(&packets[v], current, rays, distance[v]);
                        free &= !((met as u64) << (PACKET_BITS * v));
                    }
                }
            } else if near.is_none() && lanes & (lanes - 1) == 0 {
                // One ray that has left the others. (Where they are a beam it goes on with them: going on alone took 1.1
                // times the time.)
                let bit = lanes.trailing_zeros() as usize;
                let (v, lane) = (bit / PACKET_BITS % V, bit % PACKET_BITS);
                let (origin, direction) = packets[v].ray(lane);
                let none = Hit::none(distance[v].to_array()[lane]);
                if self.walk::<I, true>(current, origin, direction, none, stack).primitive != MISS {
                    free &= !lanes;
                }
            } else {
                // SAFETY: inner children are numbers of nodes; `self.stack` entries hold all that any way down leaves
                // behind, and `waiting` has them.
                unsafe {
                    let node = self.nodes.get_unchecked(current.0 as usize);
                    let mut children = bounds.enters::<I::Eight>(node, reach);
                    while children != 0 {
                        let child = children.trailing_zeros() as usize;
                        children &= children - 1;
                        let mut entering = 0;
                        for v in 0..V {
                            let (_, lanes) = packets[v].enter(node, near, child, limit[v]);
                            entering |= (lanes.bits() as u64) << (PACKET_BITS * v);
                        }
                        entering &= lanes;
                        *waiting.add(held) = (node.child[child], entering);
                        self.prefetch(Child(node.child[child]));
                        // Without a branch: what nothing enters is written over.
                        held += (entering != 0) as usize;
                    }
                }
            }
            // The next node that some ray enters which has met nothing so far.
            loop {
                if held == 0 || free == 0 {
                    return active & !free;
                }
                held -= 1;
                // SAFETY: entries below `held` were written.
                let entry = unsafe { *waiting.add(held) };
                (current, lanes) = (Child(entry.0), entry.1 & free);
                if lanes != 0 {
                    break;
                }
            }
        }
    }

    /// Which rays of a packet meet a primitive of a leaf within their distance.
    #[inline(always)]
    fn packet_leaf_any<I: Isa>(
        &self,
        packet: &Prepared<I::Wide>,
        leaf: Child,
        rays: u32,
        distance: I::Wide,
    ) -> u32 {
        let mut free = rays;
        for place in leaf.range() {
            let mask = <I::Wide as Real>::Mask::from_bits(free);
            match leaf.kind() {
                LeafKind::Others => {
                    let (t, met) = self.round_lanes::<I>(packet, self.round[place], mask);
                    free &= !(met & t.le(distance)).bits();
                }
                LeafKind::Blocks => {
                    // SAFETY: leaves hold numbers of blocks.
                    let block = unsafe { self.blocks.get_unchecked(place) };
                    let triangles = block.triangles();
                    if let Some(axis) = packet.few(mask.count(), triangles) {
                        packet.block(block, axis, mask, distance, &mut Free(&mut free));
                    } else {
                        for lane in 0..triangles {
                            free &= !packet.triangle(block, lane, distance).hit.bits();
                        }
                    }
                }
            }
            if free == 0 {
                break;
            }
        }
        rays & !free
    }
}
