//! As many rays at a time as a vector has lanes, or two vectors: one box, or one triangle, against all of them in one step.
//!
//! A node is loaded once for all rays, and nothing is sorted or compared for a single one of them. One test of their common
//! [`bounds`] tells which of the eight children any of them can enter. That pays as long as the rays stay together; where
//! few of a packet enter a node, they go on one by one ([`super::single`]), and where few reach a leaf, each meets four
//! triangles at a time.
//!
//! Rays in the order in which they came into being, which start close together, go as two vectors with common bounds. Time
//! against one vector: camera rays 0.84 to 0.98, first shadow rays 0.8 to 0.9; four vectors: no better than two. Rays that
//! were sorted go as one: two take 1.05 to 1.3 times the time.

// Rays, their limits and their hits stand in arrays side by side.
#![allow(clippy::needless_range_loop)]

mod any;
mod bounds;
mod closest;

use super::{BLOCK, Block, Bvh8, Node};
use crate::intersect::bvh2::beyond;
use crate::intersect::{Hit, RayPacket, sphere, test_round, triangle};
use crate::isa::Isa;
use crate::lanes::{Mask, Real, Uint, map3};
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
#[derive(Clone, Copy)]
struct Prepared<F: Real> {
    origin: [F; 3],
    direction: [F; 3],
    inverse: [F; 3],
    /// Those that count.
    active: F::Mask,
    /// Axis along which the direction is longest, if it is the same for all rays.
    axis: Option<usize>,
    /// Lanes whose longest axis is x, y.
    longest: [F::Mask; 2],
    /// As in [`triangle::ShearedRay`].
    shear: [F; 3],
    sheared_origin: [F; 3],
}

/// Takes hits of single rays. (A closure in its place was compiled without the instruction set of the kernel: 1.2 to 2.5
/// times the time of camera rays.)
trait Meet<F: Real> {
    /// The ray in lane `ray` of its packet meets the triangle in a lane of `found`, which repeats the block.
    fn meet(&mut self, block: &Block, ray: usize, lane: usize, found: &triangle::TriangleHits<F>);
}

impl<F: Real> Prepared<F> {
    #[inline(always)]
    fn new(rays: &RayPacket<F>) -> Self {
        let (origin, direction, active) = (rays.origin, rays.direction, rays.active);
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
        let mut packet = Prepared {
            origin,
            direction,
            inverse,
            active,
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

    /// Origin and direction of the ray in a lane.
    #[inline(always)]
    fn ray(&self, lane: usize) -> ([f32; 3], [f32; 3]) {
        let lane = lane & 15;
        (map3!(self.origin, |x| x.to_array()[lane]), map3!(self.direction, |x| x.to_array()[lane]))
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
    fn triangle(&self, block: &Block, lane: usize, t_max: F) -> triangle::TriangleHits<F> {
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
        triangle::intersect_sheared(sheared, t_max)
    }

    /// The four triangles of a block, repeated, against some of the rays, each repeated four times: for leaves that few
    /// rays reach.
    #[inline(always)]
    fn block(&self, block: &Block, axis: usize, rays: F::Mask, t_max: F, to: &mut impl Meet<F>) {
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
            let found = triangle::intersect_sheared(sheared, t_max.permute(lanes));
            let mut hits = found.hit.bits() & ((1u64 << count) - 1) as u32;
            while hits != 0 {
                let lane = hits.trailing_zeros() as usize & 15;
                hits &= hits - 1;
                to.meet(block, packed[(first + lane / BLOCK) & 15] as usize & 15, lane, &found);
            }
        }
    }

    /// The axis to test a block along with [`Prepared::block`], if that takes fewer steps than its triangles one by one.
    #[inline(always)]
    fn few(&self, rays: usize, triangles: usize) -> Option<usize> {
        // Vectors of the widest kind hold the block four times, or twice; a scalar holds none.
        let copies = F::LANES / BLOCK;
        self.axis.filter(|_| copies > 0 && rays.div_ceil(copies.max(1)) < triangles)
    }

    /// Distances at which the rays enter a box, and the lanes that do so before `limit`. `near`: as of
    /// [`bounds::Bounds::near`].
    #[inline(always)]
    fn enter(&self, node: &Node, near: Option<[usize; 3]>, child: usize, limit: F) -> (F, F::Mask) {
        macro_rules! distance {
            ($row:expr, $axis:expr) => {
                (F::splat(node.bounds[$row][child]) - self.origin[$axis]) * self.inverse[$axis]
            };
        }
        let (enter, leave) = match near {
            Some(near) => {
                let [x, y, z] = map3!([0, 1, 2], |k| distance!(near[k], k));
                let enter = x.max(y).max(z);
                let [x, y, z] = map3!([0, 1, 2], |k| distance!(near[k] ^ 1, k));
                (enter, x.min(y).min(z))
            }
            None => {
                let a = map3!([0, 1, 2], |k| distance!(2 * k, k));
                let b = map3!([0, 1, 2], |k| distance!(2 * k + 1, k));
                let [x, y, z] = map3!([0, 1, 2], |k| a[k].min(b[k]));
                let enter = x.max(y).max(z);
                let [x, y, z] = map3!([0, 1, 2], |k| a[k].max(b[k]));
                (enter, x.min(y).min(z))
            }
        };
        let enter = enter.max(F::zero());
        (enter, enter.le(beyond(leave)) & enter.le(limit))
    }
}

impl Block {
    /// How many triangles there are: short blocks repeat their last one.
    #[inline(always)]
    fn triangles(&self) -> usize {
        let [a, b, c, d] = self.primitive;
        1 + (a != b) as usize + (b != c) as usize + (c != d) as usize
    }
}

impl Bvh8<'_> {
    /// Rays against a sphere or a quadric: distances, and the lanes that meet it.
    #[inline(always)]
    fn round_lanes<I: Isa>(
        &self,
        packet: &Prepared<I::Wide>,
        primitive: u32,
        rays: <I::Wide as Real>::Mask,
    ) -> (I::Wide, <I::Wide as Real>::Mask) {
        if primitive >= self.geometry.first_quadric() {
            return self.quadric_lanes::<I>(packet, primitive, rays.bits());
        }
        let [x, y, z, r] = self.geometry.spheres()[(primitive - self.geometry.first_sphere()) as usize];
        let centre = map3!([x, y, z], |x| I::Wide::splat(x));
        let far = I::Wide::lit(f64::INFINITY);
        sphere::intersect(packet.origin, packet.direction, centre, I::Wide::splat(r), far)
    }

    /// Rays against a quadric, one at a time: they are rare.
    #[inline(always)]
    fn quadric_lanes<I: Isa>(
        &self,
        packet: &Prepared<I::Wide>,
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
}
