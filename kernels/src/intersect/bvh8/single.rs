//! One ray at a time: eight boxes, then four triangles, in one step each.

use super::{BLOCK, Bvh8, Child, LeafKind, WIDTH};
use crate::intersect::bvh2::{beyond, inverse};
use crate::intersect::triangle::{self, ShearedRay};
use crate::intersect::{Hit, TraversalStack, test_round};
use crate::isa::Isa;
use crate::lanes::{Mask, Real, Uint, map3};
use crate::scene::MISS;
use core::slice;

/// A ray on its way through the tree.
#[derive(Clone, Copy)]
pub(super) struct Walk {
    origin: [f32; 3],
    direction: [f32; 3],
    inverse: [f32; 3],
    sheared: ShearedRay,
    /// Which of the two sides of an axis the ray meets first, as a row of [`super::Node::bounds`].
    near: [usize; 3],
    /// As a place in [`super::Node::order`].
    octant: usize,
    /// Best hit so far.
    pub hit: Hit,
    /// Where it is.
    pub current: Child,
    /// Nodes that wait on its stack.
    held: usize,
}

impl Walk {
    /// A ray at the node `start`.
    #[inline(always)]
    pub fn new(start: Child, origin: [f32; 3], direction: [f32; 3], hit: Hit) -> Self {
        let inverse = map3!(direction, |x| inverse(x));
        let [x, y, z] = map3!(inverse, |x| (x < 0.0) as usize);
        Walk {
            origin,
            direction,
            inverse,
            sheared: ShearedRay::new(origin, direction),
            near: [x, 2 + y, 4 + z],
            octant: x | y << 1 | z << 2,
            hit,
            current: start,
            held: 0,
        }
    }
}

/// The stack of a ray.
#[derive(Clone, Copy)]
pub(super) struct Waiting {
    /// Nodes to visit.
    pub nodes: *mut u32,
    /// The distance at which the ray enters them.
    pub distances: *mut f32,
}

/// Places of the children in [`super::Node::order`].
const SHIFTS: [u32; WIDTH] = [0, 3, 6, 9, 12, 15, 18, 21];

impl Bvh8<'_> {
    /// Walks the tree below `start` and improves `hit`. `ANY`: stops at the first hit.
    #[inline(always)]
    pub(super) fn walk<I: Isa, const ANY: bool>(
        &self,
        start: Child,
        origin: [f32; 3],
        direction: [f32; 3],
        hit: Hit,
        stack: &mut TraversalStack,
    ) -> Hit {
        if self.nodes.is_empty() {
            return hit;
        }
        self.fit(stack);
        let mut ray = Walk::new(start, origin, direction, hit);
        let waiting = Waiting { nodes: stack.nodes.as_mut_ptr(), distances: stack.distances.as_mut_ptr() };
        // SAFETY: the stack has room for `self.stack` entries.
        while unsafe { self.step::<I, ANY>(&mut ray, waiting) } {}
        ray.hit
    }

    /// One node or leaf. Returns whether there is more to do.
    ///
    /// # Safety
    /// `waiting` points to `self.stack` entries, those below `ray.held` written by earlier steps of this ray.
    #[inline(always)]
    pub(super) unsafe fn step<I: Isa, const ANY: bool>(&self, ray: &mut Walk, waiting: Waiting) -> bool {
        type Lanes<I> = <<I as Isa>::Eight as Real>::Uint;
        if ray.current.0 & Child::LEAF == 0 {
            // SAFETY: inner children are numbers of nodes, and rows are below 6.
            let (node, near, far) = unsafe {
                let node = self.nodes.get_unchecked(ray.current.0 as usize);
                let near = map3!(ray.near, |row| node.bounds.get_unchecked(row));
                let far = map3!(ray.near, |row| node.bounds.get_unchecked(row ^ 1));
                (node, near, far)
            };
            let origin = map3!(ray.origin, |x| I::Eight::splat(x));
            let inverse = map3!(ray.inverse, |x| I::Eight::splat(x));
            // (side - origin) * inverse, not a fused side * inverse - origin * inverse: that cancels for rays almost
            // parallel to an axis.
            let [x, y, z] = map3!([0, 1, 2], |k| (I::Eight::load(near[k], 0) - origin[k]) * inverse[k]);
            let enter = x.max(y).max(z).max(I::Eight::zero());
            let [x, y, z] = map3!([0, 1, 2], |k| (I::Eight::load(far[k], 0) - origin[k]) * inverse[k]);
            let leave = beyond(x.min(y).min(z));
            // Two comparisons: a ray that is no number enters nothing, not even children that are not there.
            let lanes = enter.le(leave) & enter.le(I::Eight::splat(beyond(ray.hit.t)));
            // The children that the ray enters, the farthest first, in an order that depends on the octant of the
            // direction alone; the nearest is visited next, the others go onto the stack at once. Sorting them by
            // distance instead, with branches that are never predicted well, was as fast for single rays in small
            // trees, but interleaved rays took 1.02 to 1.06 times as long. Pushing all of them and taking the nearest
            // back from the stack waits for the store: 1.07 times as long.
            if lanes.any() {
                // SAFETY: an octant is below 8, and so is a lane; `self.stack` entries hold all that any way down
                // leaves behind, and a vector more.
                unsafe {
                    let order = *node.order.get_unchecked(ray.octant);
                    let places = Lanes::<I>::splat(order).shr_each(Lanes::<I>::load(&SHIFTS, 0));
                    let far = I::Eight::lit(f64::INFINITY);
                    let enter = I::Eight::select(lanes, enter, far).permute(places);
                    let child = Lanes::<I>::load(&node.child, 0).permute(places);
                    let lanes = enter.lt(far).bits();
                    let nearest = lanes.ilog2();
                    let others = lanes ^ 1 << nearest;
                    let mask = <I::Eight as Real>::Mask::from_bits(others);
                    enter.compress(
                        mask,
                        slice::from_raw_parts_mut(waiting.distances.add(ray.held), WIDTH),
                        0,
                    );
                    child.compress(mask, slice::from_raw_parts_mut(waiting.nodes.add(ray.held), WIDTH), 0);
                    ray.held += others.count_ones() as usize;
                    ray.current = Child(*node.child.get_unchecked((order >> (3 * nearest)) as usize & 7));
                }
                return true;
            }
        } else {
            self.leaf::<I, ANY>(ray.current, &ray.sheared, ray.origin, ray.direction, &mut ray.hit);
            if ANY && ray.hit.primitive != MISS {
                return false;
            }
        }
        // The next node that is not behind the hit.
        while ray.held > 0 {
            ray.held -= 1;
            // SAFETY: entries below `held` were written.
            let (node, t) = unsafe { (*waiting.nodes.add(ray.held), *waiting.distances.add(ray.held)) };
            if t <= beyond(ray.hit.t) {
                ray.current = Child(node);
                return true;
            }
        }
        false
    }

    #[inline(always)]
    fn leaf<I: Isa, const ANY: bool>(
        &self,
        leaf: Child,
        sheared: &ShearedRay,
        origin: [f32; 3],
        direction: [f32; 3],
        hit: &mut Hit,
    ) {
        match leaf.kind() {
            LeafKind::Blocks => {}
            LeafKind::Others => {
                for place in leaf.range() {
                    test_round(self.geometry, self.round[place], origin, direction, hit);
                }
                return;
            }
        }
        for place in leaf.range() {
            // SAFETY: leaves hold numbers of blocks, and axes are below 3.
            let (block, corners) = unsafe {
                let block = self.blocks.get_unchecked(place);
                let corners = map3!(&block.corners, |corner| map3!(sheared.axes, |axis| {
                    I::Four::load(corner.get_unchecked(axis), 0)
                }));
                (block, corners)
            };
            let found = triangle::intersect_permuted::<I::Four>(sheared, corners, I::Four::splat(hit.t));
            let mut lanes = found.hit.bits();
            if lanes == 0 {
                continue;
            }
            let (t, u, v) = (found.t.to_array(), found.u.to_array(), found.v.to_array());
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & (BLOCK - 1);
                lanes &= lanes - 1;
                if hit.yields_to(t[lane], block.primitive[lane]) {
                    *hit = Hit { t: t[lane], primitive: block.primitive[lane], u: u[lane], v: v[lane] };
                }
            }
            if ANY {
                return;
            }
        }
    }
}
