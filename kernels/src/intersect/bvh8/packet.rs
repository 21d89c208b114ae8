//! As many rays at a time as a vector has lanes: one box, or one triangle, against all of them in one step.
//!
//! A node is loaded once for all rays, and nothing is sorted or compared for a single one of them. That pays as long as
//! the rays stay together; where few of a packet enter a node, they go on one by one ([`super::single`]).

use super::{BLOCK, Bvh8, Child, EMPTY, WIDTH};
use crate::intersect::{Hit, PacketHit, TraversalStack, sphere, test_round, triangle};
use crate::isa::Isa;
use crate::lanes::{Mask, Real, Uint, map3};
use crate::math::Vec3;
use crate::scene::MISS;

/// The rays of a packet, prepared for boxes and triangles.
struct Packet<F: Real> {
    origin: [F; 3],
    direction: [F; 3],
    inverse: [F; 3],
    /// Axis along which the direction is longest, if it is the same for all rays.
    axis: Option<usize>,
    /// Lanes whose longest axis is x, y.
    longest: [F::Mask; 2],
    /// As in [`triangle::ShearedRay`].
    shear: [F; 3],
    sheared_origin: [F; 3],
}

impl<F: Real> Packet<F> {
    #[inline(always)]
    fn new(origin: Vec3<F>, direction: Vec3<F>, active: F::Mask) -> Self {
        let (origin, direction) = ([origin.x, origin.y, origin.z], [direction.x, direction.y, direction.z]);
        let inverse = map3!(direction, |x| {
            let small = x.abs().lt(F::lit(1e-30));
            F::select(small, F::lit(1e30).xor_sign(x), F::select(small, F::one(), x).recip())
        });
        let [x, y, z] = map3!(direction, |x| x.abs());
        let along_x = x.gt(y) & x.gt(z);
        let along_y = !along_x & y.gt(z);
        let lanes = active.bits();
        let axis = match (along_x.bits() & lanes, along_y.bits() & lanes) {
            (a, _) if a == lanes => Some(0),
            (_, b) if b == lanes => Some(1),
            (0, 0) => Some(2),
            _ => None,
        };
        let mut packet = Packet {
            origin,
            direction,
            inverse,
            axis,
            longest: [along_x, along_y],
            shear: [F::zero(); 3],
            sheared_origin: [F::zero(); 3],
        };
        let [dx, dy, dz] = packet.permute(direction);
        let scale = dz.recip();
        packet.shear = [dx * scale, dy * scale, scale];
        packet.sheared_origin = packet.permute(origin);
        packet
    }

    /// Coordinates with the longest axis of each ray last, cyclically.
    #[inline(always)]
    fn permute(&self, v: [F; 3]) -> [F; 3] {
        let [x, y, z] = v;
        match self.axis {
            Some(0) => [y, z, x],
            Some(1) => [z, x, y],
            Some(_) => [x, y, z],
            None => {
                let pick = |a: F, b: F, c: F| F::select(self.longest[0], a, F::select(self.longest[1], b, c));
                [pick(y, z, x), pick(z, x, y), pick(x, y, z)]
            }
        }
    }

    /// All rays against one triangle.
    #[inline(always)]
    fn triangle(&self, corners: [[f32; 3]; 3], t_max: F) -> triangle::TriangleHits<F> {
        let ([sx, sy, sz], [ox, oy, oz]) = (self.shear, self.sheared_origin);
        let sheared = map3!(corners, |corner| {
            let [x, y, z] = self.permute(map3!(corner, |x| F::splat(x)));
            let z = z - oz;
            [(x - ox) - sx * z, (y - oy) - sy * z, sz * z]
        });
        triangle::intersect_sheared(sheared, t_max)
    }

    /// Distances at which the rays enter a box, and the lanes that do so before `limit`.
    #[inline(always)]
    fn enter(&self, bounds: &[[f32; WIDTH]; 6], child: usize, limit: F) -> (F, F::Mask) {
        let side = |k: usize| (F::splat(bounds[k][child]) - self.origin[k / 2]) * self.inverse[k / 2];
        let (ax, bx, ay, by, az, bz) = (side(0), side(1), side(2), side(3), side(4), side(5));
        let enter = ax.min(bx).max(ay.min(by)).max(az.min(bz)).max(F::zero());
        let leave = ax.max(bx).min(ay.max(by)).min(az.max(bz)) * F::lit(1.0 + 4.0 * f32::EPSILON as f64);
        (enter, enter.le(leave.min(limit)))
    }
}

/// The best hits so far.
struct Best<'a, F: Real> {
    hit: &'a mut PacketHit<F>,
    limit: &'a mut F,
    margin: F,
}

impl<F: Real> Best<'_, F> {
    /// Takes over the hits of a primitive where they are better.
    #[inline(always)]
    fn keep<const ANY: bool>(&mut self, primitive: u32, t: F, u: F, v: F, met: F::Mask) {
        let id = F::Uint::splat(primitive);
        let hit = &mut *self.hit;
        let better = met & self.limit.ge(F::zero()) & (t.lt(hit.t) | (t.eq(hit.t) & id.lt(hit.primitive)));
        hit.t = F::select(better, t, hit.t);
        hit.primitive = F::Uint::select(better, id, hit.primitive);
        hit.u = F::select(better, u, hit.u);
        hit.v = F::select(better, v, hit.v);
        let next = if ANY { F::lit(-1.0) } else { t * self.margin };
        *self.limit = F::select(better, next, *self.limit);
    }
}

impl Bvh8<'_> {
    /// With so few rays left in a subtree they go on one by one. Four of eight or sixteen: measured, flat from 3 to 6.
    const TOGETHER: usize = 4;

    /// Walks the tree with all `active` rays. `ANY`: a ray stops at its first hit.
    #[inline(always)]
    pub(super) fn walk_packet<I: Isa, const ANY: bool>(
        &self,
        origin: Vec3<I::Wide>,
        direction: Vec3<I::Wide>,
        t_max: I::Wide,
        active: <I::Wide as Real>::Mask,
        stack: &mut TraversalStack,
    ) -> PacketHit<I::Wide> {
        type Int<F> = <F as Real>::Uint;
        let mut hit = PacketHit {
            t: t_max,
            primitive: Int::<I::Wide>::splat(MISS),
            u: I::Wide::zero(),
            v: I::Wide::zero(),
        };
        if self.nodes.is_empty() {
            return hit;
        }
        let packet = Packet::new(origin, direction, active);
        let behind = I::Wide::lit(-1.0);
        let margin = I::Wide::lit(1.0 + 4.0 * f32::EPSILON as f64);
        // Distance up to which nodes matter to each ray; negative for rays that are done.
        let mut limit = I::Wide::select(active, t_max * margin, behind);
        assert!(stack.packets.len() >= self.stack);
        let waiting = stack.packets.as_mut_ptr();
        let mut held = 0usize;
        let mut current = Child(0);
        let mut entered = I::Wide::zero();
        loop {
            let alive = entered.le(limit);
            let count = alive.count();
            if count == 0 {
                // Nothing to do here.
            } else if count <= Self::TOGETHER {
                self.one_by_one::<I, ANY>(&packet, current, alive.bits(), &mut hit, stack);
                let found = !hit.primitive.eq(Int::<I::Wide>::splat(MISS));
                let open = limit.ge(I::Wide::zero());
                limit = I::Wide::select(open, hit.t * margin, behind);
                if ANY {
                    limit = I::Wide::select(found, behind, limit);
                }
            } else if current.0 & Child::LEAF == 0 {
                // SAFETY: inner children are numbers of nodes; `self.stack` entries hold all that any way down leaves
                // behind, and `waiting` has them.
                unsafe {
                    let node = self.nodes.get_unchecked(current.0 as usize);
                    let mut nearest: Option<(u32, I::Wide)> = None;
                    for child in 0..WIDTH {
                        if node.child[child] == EMPTY.0 {
                            break;
                        }
                        let (enter, lanes) = packet.enter(&node.bounds, child, limit);
                        if !lanes.any() {
                            continue;
                        }
                        let enter = I::Wide::select(lanes, enter, I::Wide::lit(f64::INFINITY));
                        let mut put = |(node, enter): (u32, I::Wide)| {
                            let entry = &mut *waiting.add(held);
                            entry.0 = node;
                            enter.store(&mut entry.1.0, 0);
                            held += 1;
                        };
                        // The one that any ray enters first goes on; the others wait in the order of the boxes.
                        // Sorting them by the distance of one ray cost as much as it saved.
                        nearest = Some(match nearest {
                            None => (node.child[child], enter),
                            Some(best) if enter.lt(best.1).any() => {
                                put(best);
                                (node.child[child], enter)
                            }
                            Some(best) => {
                                put((node.child[child], enter));
                                best
                            }
                        });
                    }
                    if let Some((node, enter)) = nearest {
                        (current, entered) = (Child(node), enter);
                        continue;
                    }
                }
            } else {
                self.packet_leaf::<I, ANY>(&packet, current, alive, &mut hit, &mut limit, margin);
            }
            if ANY && !limit.ge(I::Wide::zero()).any() {
                return hit;
            }
            if held == 0 {
                return hit;
            }
            held -= 1;
            // SAFETY: entries below `held` were written.
            let entry = unsafe { &*waiting.add(held) };
            current = Child(entry.0);
            entered = I::Wide::load(&entry.1.0, 0);
        }
    }

    /// All rays of a packet against the primitives of a leaf.
    #[inline(always)]
    fn packet_leaf<I: Isa, const ANY: bool>(
        &self,
        packet: &Packet<I::Wide>,
        leaf: Child,
        alive: <I::Wide as Real>::Mask,
        hit: &mut PacketHit<I::Wide>,
        limit: &mut I::Wide,
        margin: I::Wide,
    ) {
        let mut best = Best { hit, limit, margin };
        if leaf.0 & Child::ROUND != 0 {
            for place in leaf.range() {
                let primitive = self.round[place];
                if primitive < self.geometry.first_quadric() {
                    let index = (primitive - self.geometry.first_sphere()) as usize;
                    let [x, y, z, r] = self.geometry.spheres[index];
                    let centre = map3!([x, y, z], |x| I::Wide::splat(x));
                    let far = I::Wide::lit(f64::INFINITY);
                    let (t, met) =
                        sphere::intersect(packet.origin, packet.direction, centre, I::Wide::splat(r), far);
                    if met.any() {
                        best.keep::<ANY>(primitive, t, I::Wide::zero(), I::Wide::zero(), met);
                    }
                } else {
                    let (t, met) = self.quadric_lanes::<I>(packet, primitive, alive.bits());
                    best.keep::<ANY>(primitive, t, I::Wide::zero(), I::Wide::zero(), met);
                }
            }
            return;
        }
        for place in leaf.range() {
            // SAFETY: leaves hold numbers of blocks.
            let block = unsafe { self.blocks.get_unchecked(place) };
            for lane in 0..BLOCK {
                let primitive = block.primitive[lane];
                // Short blocks repeat their last triangle.
                if lane > 0 && primitive == block.primitive[lane - 1] {
                    break;
                }
                let corners = map3!(&block.corners, |corner| map3!(corner, |axis| axis[lane]));
                let found = packet.triangle(corners, I::Wide::lit(f64::INFINITY));
                if found.hit.any() {
                    best.keep::<ANY>(primitive, found.t, found.u, found.v, found.hit);
                }
            }
        }
    }

    /// Rays against a quadric, one at a time: they are rare.
    #[inline(always)]
    fn quadric_lanes<I: Isa>(
        &self,
        packet: &Packet<I::Wide>,
        primitive: u32,
        mut lanes: u32,
    ) -> (I::Wide, <I::Wide as Real>::Mask) {
        let origin = map3!(packet.origin, |x| x.to_array());
        let direction = map3!(packet.direction, |x| x.to_array());
        let mut t = [0.0; 16];
        let mut met = 0;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let mut hit = Hit::none(f32::INFINITY);
            test_round(
                self.geometry,
                primitive,
                map3!(&origin, |x| x[lane]),
                map3!(&direction, |x| x[lane]),
                &mut hit,
            );
            t[lane] = hit.t;
            met |= ((hit.primitive != MISS) as u32) << lane;
        }
        (I::Wide::load(&t, 0), <I::Wide as Real>::Mask::from_bits(met))
    }

    /// The set lanes go through a subtree one by one.
    #[inline(always)]
    fn one_by_one<I: Isa, const ANY: bool>(
        &self,
        packet: &Packet<I::Wide>,
        start: Child,
        mut lanes: u32,
        hit: &mut PacketHit<I::Wide>,
        stack: &mut TraversalStack,
    ) {
        let origin = map3!(packet.origin, |x| x.to_array());
        let direction = map3!(packet.direction, |x| x.to_array());
        let (mut t, mut primitive) = (hit.t.to_array(), hit.primitive.to_array());
        let (mut u, mut v) = (hit.u.to_array(), hit.v.to_array());
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize & 15;
            lanes &= lanes - 1;
            let before = Hit { t: t[lane], primitive: primitive[lane], u: u[lane], v: v[lane] };
            let after = self.walk::<I, ANY>(
                start,
                map3!(&origin, |x| x[lane]),
                map3!(&direction, |x| x[lane]),
                before,
                stack,
            );
            t[lane] = after.t;
            primitive[lane] = after.primitive;
            u[lane] = after.u;
            v[lane] = after.v;
        }
        hit.t = I::Wide::load(&t, 0);
        hit.primitive = <I::Wide as Real>::Uint::load(&primitive, 0);
        hit.u = I::Wide::load(&u, 0);
        hit.v = I::Wide::load(&v, 0);
    }
}
