//! Closest hits.

use super::bounds::Bounds;
use super::{Meet, Prepared};
use crate::intersect::bvh2::beyond;
use crate::intersect::bvh8::{BLOCK, Block, Bvh8, Child, EMPTY, LeafKind};
use crate::intersect::triangle::TriangleHits;
use crate::intersect::{Hit, PacketHit, RayPacket, TraversalStack};
use crate::isa::Isa;
use crate::lanes::{Mask, Real, Uint, map3};

/// The best hits so far.
struct Best<'a, F: Real> {
    hit: &'a mut PacketHit<F>,
    limit: &'a mut F,
}

impl<F: Real> Best<'_, F> {
    /// Takes over the hits of a primitive where they are better.
    #[inline(always)]
    fn keep(&mut self, primitive: u32, t: F, u: F, v: F, met: F::Mask) {
        let id = F::Uint::splat(primitive);
        let hit = &mut *self.hit;
        let better = met & (t.lt(hit.t) | (t.eq(hit.t) & id.lt(hit.primitive)));
        hit.t = F::select(better, t, hit.t);
        hit.primitive = F::Uint::select(better, id, hit.primitive);
        hit.u = F::select(better, u, hit.u);
        hit.v = F::select(better, v, hit.v);
        *self.limit = F::select(better, beyond(t), *self.limit);
    }
}

impl<F: Real> Meet<F> for Best<'_, F> {
    #[inline(always)]
    fn meet(&mut self, block: &Block, ray: usize, lane: usize, found: &TriangleHits<F>) {
        let [t, u, v] = map3!([found.t, found.u, found.v], |x| F::splat(x.to_array()[lane]));
        self.keep(block.primitive[lane % BLOCK], t, u, v, F::Mask::from_bits(1 << ray));
    }
}

impl Bvh8<'_> {
    /// With so few rays left in a subtree they go on one by one, unless they are a beam. Measured: flat from 1 to 3.
    const FEW: usize = 2;

    /// Walks the tree with all active rays.
    #[inline(always)]
    pub(in crate::intersect::bvh8) fn walk_packets<I: Isa, const V: usize>(
        &self,
        rays: &[RayPacket<I::Wide>; V],
        stack: &mut TraversalStack,
    ) -> [PacketHit<I::Wide>; V] {
        let mut hit = [PacketHit::none(); V];
        if self.nodes.is_empty() {
            return hit;
        }
        let far = I::Wide::lit(f64::INFINITY);
        let mut packets = [Prepared::new(&rays[0]); V];
        // Distance up to which nodes matter to each ray; negative for rays that do not count.
        let mut limit = [I::Wide::lit(-1.0); V];
        for v in 0..V {
            packets[v] = Prepared::new(&rays[v]);
            limit[v] = I::Wide::select(rays[v].active, far, limit[v]);
        }
        let bounds = Bounds::new(&packets);
        let near = bounds.near();
        // The largest of them.
        let mut reach = f32::INFINITY;
        self.fit(stack);
        let waiting = stack.packets.as_mut_ptr();
        let mut held = 0usize;
        let mut current = Child(0);
        let mut entered = [I::Wide::zero(); V];
        loop {
            let (mut alive, mut count) = ([rays[0].active; V], 0);
            for v in 0..V {
                alive[v] = entered[v].le(limit[v]);
                count += alive[v].count();
            }
            if count == 0 {
                // Nothing to do here.
            } else if current.0 & Child::LEAF != 0 {
                let mut furthest = I::Wide::lit(-1.0);
                for v in 0..V {
                    if alive[v].any() {
                        let best = Best { hit: &mut hit[v], limit: &mut limit[v] };
                        self.packet_leaf::<I>(&packets[v], current, alive[v], best);
                    }
                    furthest = furthest.max(limit[v]);
                }
                reach = furthest.largest();
            } else if near.is_none() && count <= Self::FEW {
                for v in 0..V {
                    let best = Best { hit: &mut hit[v], limit: &mut limit[v] };
                    self.one_by_one::<I>(&packets[v], current, alive[v].bits(), best, stack);
                }
            } else {
                // SAFETY: inner children are numbers of nodes; `self.stack` entries hold all that any way down leaves
                // behind, and `waiting` has them.
                unsafe {
                    let node = self.nodes.get_unchecked(current.0 as usize);
                    let (mut nearest, mut nearest_enter) = (EMPTY.0, [far; V]);
                    let mut children = bounds.enters::<I::Eight>(node, reach);
                    while children != 0 {
                        let child = children.trailing_zeros() as usize;
                        children &= children - 1;
                        let (mut enter, mut any, mut first) = ([far; V], 0, 0);
                        for v in 0..V {
                            let (t, lanes) = packets[v].enter(node, near, child, limit[v]);
                            enter[v] = I::Wide::select(lanes, t, far);
                            any |= lanes.bits();
                            first |= enter[v].lt(nearest_enter[v]).bits();
                        }
                        if any == 0 {
                            continue;
                        }
                        self.prefetch(Child(node.child[child]));
                        // The one that any ray enters first goes on; the others wait in the order of the boxes.
                        // Sorting them by the distance of one ray cost as much as it saved.
                        let mut waits = node.child[child];
                        if first != 0 {
                            core::mem::swap(&mut nearest, &mut waits);
                            core::mem::swap(&mut nearest_enter, &mut enter);
                        }
                        if waits != EMPTY.0 {
                            let entry = &mut *waiting.add(held);
                            entry.0 = waits;
                            for v in 0..V {
                                enter[v].store(&mut entry.1.0[v], 0);
                            }
                            held += 1;
                        }
                    }
                    if nearest != EMPTY.0 {
                        (current, entered) = (Child(nearest), nearest_enter);
                        continue;
                    }
                }
            }
            if held == 0 {
                return hit;
            }
            held -= 1;
            // SAFETY: entries below `held` were written.
            let entry = unsafe { &*waiting.add(held) };
            current = Child(entry.0);
            for v in 0..V {
                entered[v] = I::Wide::load(&entry.1.0[v], 0);
            }
        }
    }

    /// Rays of a packet against the primitives of a leaf.
    #[inline(always)]
    fn packet_leaf<I: Isa>(
        &self,
        packet: &Prepared<I::Wide>,
        leaf: Child,
        rays: <I::Wide as Real>::Mask,
        mut best: Best<I::Wide>,
    ) {
        let (zero, far) = (I::Wide::zero(), I::Wide::lit(f64::INFINITY));
        match leaf.kind() {
            LeafKind::Blocks => {}
            LeafKind::Others => {
                for place in leaf.range() {
                    let primitive = self.round[place];
                    let (t, met) = self.round_lanes::<I>(packet, primitive, rays);
                    best.keep(primitive, t, zero, zero, met & packet.active);
                }
                return;
            }
        }
        for place in leaf.range() {
            // SAFETY: leaves hold numbers of blocks.
            let block = unsafe { self.blocks.get_unchecked(place) };
            let triangles = block.triangles();
            if let Some(axis) = packet.few(rays.count(), triangles) {
                packet.block(block, axis, rays, far, &mut best);
                continue;
            }
            for lane in 0..triangles {
                let found = packet.triangle(block, lane, far);
                if found.hit.any() {
                    let met = found.hit & packet.active;
                    best.keep(block.primitive[lane], found.t, found.u, found.v, met);
                }
            }
        }
    }

    /// The set lanes go through a subtree one by one.
    #[inline(always)]
    fn one_by_one<I: Isa>(
        &self,
        packet: &Prepared<I::Wide>,
        start: Child,
        mut lanes: u32,
        mut best: Best<I::Wide>,
        stack: &mut TraversalStack,
    ) {
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize & 15;
            lanes &= lanes - 1;
            let (t, primitive) = (best.hit.t.to_array()[lane], best.hit.primitive.to_array()[lane]);
            let before = Hit { t, primitive, u: 0.0, v: 0.0 };
            let (origin, direction) = packet.ray(lane);
            let after = self.walk::<I, false>(start, origin, direction, before, stack);
            if after.primitive != before.primitive {
                let [t, u, v] = map3!([after.t, after.u, after.v], |x| I::Wide::splat(x));
                best.keep(after.primitive, t, u, v, <I::Wide as Real>::Mask::from_bits(1 << lane));
            }
        }
    }
}
