//! One ray at a time: eight boxes, then four triangles, in one step each.

use super::{BLOCK, Bvh8, Child, Node, WIDTH};
use crate::intersect::bvh2::{beyond, inverse};
use crate::intersect::triangle::{self, ShearedRay};
use crate::intersect::{Hit, test_round};
use crate::isa::Isa;
use crate::lanes::{Mask, Real, map3};
use crate::scene::MISS;

/// A ray on its way through the tree.
#[derive(Clone, Copy)]
pub(super) struct Walk {
    origin: [f32; 3],
    direction: [f32; 3],
    inverse: [f32; 3],
    sheared: ShearedRay,
    /// Which of the two sides of an axis the ray meets first, as a row of [`super::Node::bounds`].
    near: [usize; 3],
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
        Walk {
            origin,
            direction,
            inverse,
            sheared: ShearedRay::new(origin, direction),
            near: map3!([0, 1, 2], |axis| 2 * axis + (inverse[axis] < 0.0) as usize),
            hit,
            current: start,
            held: 0,
        }
    }
}

impl Bvh8<'_> {
    /// Walks the tree below `start` and improves `hit`. `ANY`: stops at the first hit.
    #[inline(always)]
    pub(super) fn walk<I: Isa, const ANY: bool>(
        &self,
        start: Child,
        origin: [f32; 3],
        direction: [f32; 3],
        hit: Hit,
        stack: &mut [(u32, f32)],
    ) -> Hit {
        if self.nodes.is_empty() {
            return hit;
        }
        assert!(stack.len() >= self.stack);
        let mut ray = Walk::new(start, origin, direction, hit);
        // SAFETY: the stack has room for `self.stack` entries.
        while unsafe { self.step::<I, ANY>(&mut ray, stack.as_mut_ptr()) } {}
        ray.hit
    }

    /// One node or leaf. Returns whether there is more to do.
    ///
    /// # Safety
    /// `stack` points to `self.stack` entries, those below `ray.held` written by earlier steps of this ray.
    #[inline(always)]
    pub(super) unsafe fn step<I: Isa, const ANY: bool>(
        &self,
        ray: &mut Walk,
        stack: *mut (u32, f32),
    ) -> bool {
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
            // Rounding of the far sides must not lose boxes (Ize 2013).
            let leave = x.min(y).min(z) * I::Eight::lit(1.0 + 4.0 * f32::EPSILON as f64);
            let lanes = enter.le(leave.min(I::Eight::splat(beyond(ray.hit.t)))).bits();
            if lanes != 0 {
                let mut at = [0.0f32; WIDTH];
                enter.store(&mut at, 0);
                // SAFETY: `self.stack` entries hold all that any way down leaves behind.
                unsafe { descend(ray, node, &at, lanes, stack) };
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
            let (node, t) = unsafe { *stack.add(ray.held) };
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
        if leaf.0 & Child::ROUND != 0 {
            for place in leaf.range() {
                test_round(self.geometry, self.round[place], origin, direction, hit);
            }
            return;
        }
        for place in leaf.range() {
            // SAFETY: leaves hold numbers of blocks.
            let block = unsafe { self.blocks.get_unchecked(place) };
            let corners = map3!(&block.corners, |corner| map3!(corner, |axis| I::Four::load(axis, 0)));
            let found = triangle::intersect::<I::Four>(sheared, &corners, I::Four::splat(hit.t));
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

/// Goes on with the nearest of the children in `lanes`; the others wait on the stack, nearest on top.
///
/// # Safety
/// `stack` has room for the children above `ray.held`, and all lanes are below [`WIDTH`].
#[inline(always)]
unsafe fn descend(ray: &mut Walk, node: &Node, at: &[f32; WIDTH], mut lanes: u32, stack: *mut (u32, f32)) {
    // SAFETY: the caller's promise.
    unsafe {
        macro_rules! next {
            () => {{
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                (*node.child.get_unchecked(lane), *at.get_unchecked(lane))
            }};
        }
        let first = next!();
        if lanes == 0 {
            ray.current = Child(first.0);
            return;
        }
        let second = next!();
        let (nearer, farther) = if first.1 <= second.1 { (first, second) } else { (second, first) };
        let base = ray.held;
        stack.add(base).write(farther);
        if lanes == 0 {
            ray.held = base + 1;
            ray.current = Child(nearer.0);
            return;
        }
        stack.add(base + 1).write(nearer);
        let mut held = base + 2;
        // Farthest first, by insertion.
        while lanes != 0 {
            let entry = next!();
            let mut place = held;
            while place > base && (*stack.add(place - 1)).1 < entry.1 {
                stack.add(place).write(*stack.add(place - 1));
                place -= 1;
            }
            stack.add(place).write(entry);
            held += 1;
        }
        ray.held = held - 1;
        ray.current = Child((*stack.add(held - 1)).0);
    }
}
