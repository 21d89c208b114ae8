//! As many rays at a time as a vector has lanes: one box, or one triangle, against all of them in one step.
//!
//! A node is loaded once for all rays, and nothing is sorted or compared for a single one of them. Where all rays go the
//! same way along each axis, one test of their common bounds tells which of the eight children any of them can enter.
//! That pays as long as the rays stay together; where few of a packet enter a node, they go on one by one
//! ([`super::single`]), and where few reach a leaf, each meets four triangles at a time.

use super::{BLOCK, Block, Bvh8, Child, EMPTY, Node, WIDTH};
use crate::intersect::{Hit, PacketHit, TraversalStack, sphere, test_round, triangle};
use crate::isa::Isa;
use crate::lanes::{Mask, Real, Uint, map3};
use crate::math::Vec3;
use crate::scene::MISS;

/// Axes in their cyclic order with x, y or z last.
const AXES: [[usize; 3]; 3] = [[1, 2, 0], [2, 0, 1], [0, 1, 2]];

/// 0, 1, 2, ...
static NUMBERS: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
/// Each number four times.
static BY_FOUR: [u32; 64] = {
    let mut out = [0; 64];
    let mut k = 0;
    while k < 64 {
        out[k] = k as u32 / BLOCK as u32;
        k += 1;
    }
    out
};

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
    /// Bounds of all rays, if they agree in the signs of their directions.
    beam: Option<Beam>,
}

/// Bounds of the rays of a packet that go the same way along each axis: for each axis the origin and the direction of a
/// ray that would enter boxes no later than any of them, and of one that would leave them no earlier.
///
/// Packets whose rays go both ways along some axis do without. Bounds for them, too (from both sides, and never leaving),
/// and cutting them into a packet for each octant were tried: as fast, and 1.2 times as slow for first shadow rays.
struct Beam {
    /// Which of the two sides of an axis the rays meet first, as a row of [`super::Node::bounds`].
    near: [usize; 3],
    /// The coordinate of the origins that is nearest to those sides, and the smallest inverse direction.
    first: [[f32; 2]; 3],
    /// The coordinate that is furthest from the other sides, and the largest inverse direction.
    last: [[f32; 2]; 3],
}

impl Beam {
    #[inline(always)]
    fn new<F: Real>(origin: [F; 3], inverse: [F; 3], active: F::Mask) -> Option<Self> {
        let lanes = active.bits();
        // What is not a number is in none of the masks, so there is no beam with it.
        let up = map3!(inverse, |x| x.gt(F::zero()).bits() & lanes == lanes);
        let down = map3!(inverse, |x| x.lt(F::zero()).bits() & lanes == lanes);
        let number = map3!(origin, |x| x.eq(x).bits() & lanes == lanes);
        let agree = map3!([0, 1, 2], |k| (up[k] | down[k]) & number[k]);
        if !(agree[0] & agree[1] & agree[2]) {
            return None;
        }
        let (high, low) = (F::lit(f64::INFINITY), F::lit(f64::NEG_INFINITY));
        macro_rules! range {
            ($x:expr) => {
                [F::select(active, $x, high).least(), F::select(active, $x, low).largest()]
            };
        }
        let (origin, inverse) = (map3!(origin, |x| range!(x)), map3!(inverse, |x| range!(x)));
        // Upwards, a lower side is met first by rays from the highest origin; downwards it is all the other way round.
        let [least, largest] = [map3!(down, |down| down as usize), map3!(down, |down| !down as usize)];
        Some(Beam {
            near: map3!([0, 1, 2], |k| 2 * k + least[k]),
            first: map3!([0, 1, 2], |k| [origin[k][largest[k]], inverse[k][least[k]]]),
            last: map3!([0, 1, 2], |k| [origin[k][least[k]], inverse[k][largest[k]]]),
        })
    }

    /// The children of a node that a ray of the beam may enter before `limit`, and no fewer: rounding is monotonic, so
    /// what holds for the bounds holds for the rays. (Where a distance is below 0 it bounds nothing, but then neither
    /// does it matter.)
    #[inline(always)]
    fn enters<F: Real>(&self, node: &Node, limit: f32) -> u32 {
        macro_rules! distance {
            ($row:expr, $ray:expr) => {
                (F::load(&node.bounds[$row], 0) - F::splat($ray[0])) * F::splat($ray[1])
            };
        }
        let [x, y, z] = map3!([0, 1, 2], |k| distance!(self.near[k], self.first[k]));
        let enter = x.max(y).max(z).max(F::zero());
        let [x, y, z] = map3!([0, 1, 2], |k| distance!(self.near[k] ^ 1, self.last[k]));
        let leave = x.min(y).min(z) * F::lit(1.0 + 4.0 * f32::EPSILON as f64);
        (enter.le(leave) & enter.le(F::splat(limit))).bits()
    }
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
            beam: Beam::new(origin, inverse, active),
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

    /// All rays against one triangle of a block.
    #[inline(always)]
    fn triangle(&self, block: &Block, lane: usize) -> triangle::TriangleHits<F> {
        let ([sx, sy, sz], [ox, oy, oz]) = (self.shear, self.sheared_origin);
        let corners = match self.axis {
            Some(axis) => {
                let axes = AXES[axis];
                map3!(&block.corners, |corner| map3!(axes, |k| F::splat(corner[k][lane])))
            }
            None => map3!(&block.corners, |corner| self.permute(map3!(corner, |x| F::splat(x[lane])))),
        };
        let sheared = map3!(corners, |corner| {
            let [x, y, z] = corner;
            let z = z - oz;
            [(x - ox) - sx * z, (y - oy) - sy * z, sz * z]
        });
        triangle::intersect_sheared(sheared, F::lit(f64::INFINITY))
    }

    /// The four triangles of a block, repeated, against some of the rays, each repeated four times: for leaves that few
    /// rays reach.
    #[inline(always)]
    fn block<const ANY: bool>(&self, block: &Block, axis: usize, rays: F::Mask, best: &mut Best<F>) {
        let axes = AXES[axis];
        let corners = map3!(&block.corners, |corner| map3!(axes, |k| F::repeat(&corner[k])));
        // The numbers of the rays, packed.
        let mut packed = [0u32; 16];
        F::Uint::load(&NUMBERS, 0).compress(rays, &mut packed, 0);
        let numbers = F::Uint::load(&packed, 0);
        let total = rays.count();
        for first in (0..total).step_by(F::LANES / BLOCK) {
            let count = (total - first).min(F::LANES / BLOCK) * BLOCK;
            let lanes = numbers.permute(F::Uint::load(&BY_FOUR, first * BLOCK));
            let [sx, sy, sz] = map3!(self.shear, |x| x.permute(lanes));
            let [ox, oy, oz] = map3!(self.sheared_origin, |x| x.permute(lanes));
            let sheared = map3!(corners, |corner| {
                let [x, y, z] = corner;
                let z = z - oz;
                [(x - ox) - sx * z, (y - oy) - sy * z, sz * z]
            });
            let found = triangle::intersect_sheared(sheared, F::lit(f64::INFINITY));
            let mut hits = found.hit.bits() & ((1u64 << count) - 1) as u32;
            if hits == 0 {
                continue;
            }
            let (t, u, v) = (found.t.to_array(), found.u.to_array(), found.v.to_array());
            while hits != 0 {
                let lane = hits.trailing_zeros() as usize & 15;
                hits &= hits - 1;
                let (t, u, v) = (F::splat(t[lane]), F::splat(u[lane]), F::splat(v[lane]));
                let ray = F::Mask::from_bits(1 << packed[(first + lane / BLOCK) & 15]);
                best.keep::<ANY>(block.primitive[lane % BLOCK], t, u, v, ray);
            }
        }
    }

    /// Distances at which the rays enter a box, and the lanes that do so before `limit`.
    #[inline(always)]
    fn enter(&self, bounds: &[[f32; WIDTH]; 6], child: usize, limit: F) -> (F, F::Mask) {
        if let Some(beam) = &self.beam {
            let [x, y, z] = map3!([0, 1, 2], |k| {
                (F::splat(bounds[beam.near[k]][child]) - self.origin[k]) * self.inverse[k]
            });
            let enter = x.max(y).max(z).max(F::zero());
            let [x, y, z] = map3!([0, 1, 2], |k| {
                (F::splat(bounds[beam.near[k] ^ 1][child]) - self.origin[k]) * self.inverse[k]
            });
            let leave = x.min(y).min(z) * F::lit(1.0 + 4.0 * f32::EPSILON as f64);
            return (enter, enter.le(leave) & enter.le(limit));
        }
        let side = |k: usize| (F::splat(bounds[k][child]) - self.origin[k / 2]) * self.inverse[k / 2];
        let (ax, bx, ay, by, az, bz) = (side(0), side(1), side(2), side(3), side(4), side(5));
        let enter = ax.min(bx).max(ay.min(by)).max(az.min(bz)).max(F::zero());
        let leave = ax.max(bx).min(ay.max(by)).min(az.max(bz)) * F::lit(1.0 + 4.0 * f32::EPSILON as f64);
        (enter, enter.le(leave) & enter.le(limit))
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
    /// With so few rays left in a subtree they go on one by one, unless they are a beam. Measured: flat from 1 to 3.
    const TOGETHER: usize = 2;

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
            } else if current.0 & Child::LEAF != 0 {
                self.packet_leaf::<I, ANY>(&packet, current, alive, &mut hit, &mut limit, margin);
            } else if packet.beam.is_none() && count <= Self::TOGETHER {
                let best = &mut Best { hit: &mut hit, limit: &mut limit, margin };
                self.one_by_one::<I, ANY>(&packet, current, alive.bits(), best, stack);
            } else {
                // SAFETY: inner children are numbers of nodes; `self.stack` entries hold all that any way down leaves
                // behind, and `waiting` has them.
                unsafe {
                    let node = self.nodes.get_unchecked(current.0 as usize);
                    let (mut nearest, mut nearest_enter) = (EMPTY.0, I::Wide::zero());
                    let mut children = match &packet.beam {
                        Some(beam) => beam.enters::<I::Eight>(node, limit.largest()),
                        None => 0xFF,
                    };
                    while children != 0 {
                        let child = children.trailing_zeros() as usize;
                        children &= children - 1;
                        if node.child[child] == EMPTY.0 {
                            break;
                        }
                        let (enter, lanes) = packet.enter(&node.bounds, child, limit);
                        if !lanes.any() {
                            continue;
                        }
                        self.prefetch(Child(node.child[child]));
                        let enter = I::Wide::select(lanes, enter, I::Wide::lit(f64::INFINITY));
                        // The one that any ray enters first goes on; the others wait in the order of the boxes.
                        // Sorting them by the distance of one ray cost as much as it saved.
                        let (mut waits, mut waits_enter) = (node.child[child], enter);
                        if nearest == EMPTY.0 || enter.lt(nearest_enter).any() {
                            core::mem::swap(&mut nearest, &mut waits);
                            (nearest_enter, waits_enter) = (enter, nearest_enter);
                        }
                        if waits != EMPTY.0 {
                            let entry = &mut *waiting.add(held);
                            entry.0 = waits;
                            waits_enter.store(&mut entry.1.0, 0);
                            held += 1;
                        }
                    }
                    if nearest != EMPTY.0 {
                        (current, entered) = (Child(nearest), nearest_enter);
                        continue;
                    }
                }
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
        let rays = alive.count();
        for place in leaf.range() {
            // SAFETY: leaves hold numbers of blocks.
            let block = unsafe { self.blocks.get_unchecked(place) };
            // Short blocks repeat their last triangle.
            let [a, b, c, d] = block.primitive;
            let triangles = 1 + (a != b) as usize + (b != c) as usize + (c != d) as usize;
            // Vectors of the widest kind hold the block four times, or twice.
            let copies = I::Wide::LANES / BLOCK;
            if let Some(axis) = packet.axis
                && copies > 0
                && rays.div_ceil(copies.max(1)) < triangles
            {
                packet.block::<ANY>(block, axis, alive, &mut best);
                continue;
            }
            for lane in 0..triangles {
                let found = packet.triangle(block, lane);
                if found.hit.any() {
                    best.keep::<ANY>(block.primitive[lane], found.t, found.u, found.v, found.hit);
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
        best: &mut Best<I::Wide>,
        stack: &mut TraversalStack,
    ) {
        let origin = map3!(packet.origin, |x| x.to_array());
        let direction = map3!(packet.direction, |x| x.to_array());
        let (t, primitive) = (best.hit.t.to_array(), best.hit.primitive.to_array());
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize & 15;
            lanes &= lanes - 1;
            let before = Hit { t: t[lane], primitive: primitive[lane], u: 0.0, v: 0.0 };
            let (origin, direction) = (map3!(&origin, |x| x[lane]), map3!(&direction, |x| x[lane]));
            let after = self.walk::<I, ANY>(start, origin, direction, before, stack);
            if after.primitive != before.primitive {
                let (t, u, v) = (I::Wide::splat(after.t), I::Wide::splat(after.u), I::Wide::splat(after.v));
                best.keep::<ANY>(after.primitive, t, u, v, <I::Wide as Real>::Mask::from_bits(1 << lane));
            }
        }
    }
}
