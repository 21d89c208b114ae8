//! One ray at a time: eight boxes, then four triangles, in one step each.

use super::{BLOCK, Bvh8, Child, WIDTH};
use crate::intersect::bvh2::{beyond, inverse};
use crate::intersect::triangle::{self, ShearedRay};
use crate::intersect::{Hit, test_round};
use crate::isa::Isa;
use crate::lanes::{Mask, Real, map3};
use crate::scene::MISS;

impl Bvh8<'_> {
    /// Walks the tree below `start` and improves `hit`. `ANY`: stops at the first hit.
    #[inline(always)]
    pub(super) fn walk<I: Isa, const ANY: bool>(
        &self,
        start: Child,
        origin: [f32; 3],
        direction: [f32; 3],
        mut hit: Hit,
        stack: &mut [(u32, f32)],
    ) -> Hit {
        if self.nodes.is_empty() {
            return hit;
        }
        let sheared = ShearedRay::new(origin, direction);
        let inverse = map3!(direction, |x| inverse(x));
        let o = map3!(origin, |x| I::Eight::splat(x));
        let inv = map3!(inverse, |x| I::Eight::splat(x));
        // Which of the two sides of an axis the ray meets first.
        let near = map3!([0, 1, 2], |axis| 2 * axis + (inverse[axis] < 0.0) as usize);
        assert!(stack.len() >= self.stack);
        let stack = stack.as_mut_ptr();
        let mut held = 0usize;
        let mut current = start.0;
        let mut limit = I::Eight::splat(beyond(hit.t));
        loop {
            if current & Child::LEAF == 0 {
                // SAFETY: inner children are numbers of nodes.
                let node = unsafe { self.nodes.get_unchecked(current as usize) };
                // (side - origin) * inverse, not a fused side * inverse - origin * inverse: that cancels for rays
                // almost parallel to an axis.
                let enter = |axis: usize| (I::Eight::load(&node.bounds[near[axis]], 0) - o[axis]) * inv[axis];
                let leave =
                    |axis: usize| (I::Eight::load(&node.bounds[near[axis] ^ 1], 0) - o[axis]) * inv[axis];
                let t_enter = enter(0).max(enter(1)).max(enter(2)).max(I::Eight::zero());
                // Rounding of the far sides must not lose boxes (Ize 2013).
                let t_leave =
                    leave(0).min(leave(1)).min(leave(2)) * I::Eight::lit(1.0 + 4.0 * f32::EPSILON as f64);
                let mut lanes = t_enter.le(t_leave.min(limit)).bits();
                if lanes != 0 {
                    let mut at = [0.0f32; WIDTH];
                    t_enter.store(&mut at, 0);
                    // SAFETY: `self.stack` entries hold all that any way down leaves behind, and `stack` has them;
                    // lanes are below WIDTH.
                    unsafe {
                        let base = held;
                        let mut pop = || {
                            let lane = lanes.trailing_zeros() as usize;
                            lanes &= lanes - 1;
                            ((*node.child.get_unchecked(lane), *at.get_unchecked(lane)), lanes)
                        };
                        let (first, rest) = pop();
                        if rest == 0 {
                            current = first.0;
                            continue;
                        }
                        let (second, mut rest) = pop();
                        if rest == 0 {
                            let (nearer, farther) =
                                if first.1 <= second.1 { (first, second) } else { (second, first) };
                            stack.add(held).write(farther);
                            held += 1;
                            current = nearer.0;
                            continue;
                        }
                        // Farthest first, by insertion.
                        let (a, b) = if first.1 >= second.1 { (first, second) } else { (second, first) };
                        stack.add(held).write(a);
                        stack.add(held + 1).write(b);
                        held += 2;
                        while rest != 0 {
                            let (entry, left) = pop();
                            rest = left;
                            let mut place = held;
                            while place > base && (*stack.add(place - 1)).1 < entry.1 {
                                stack.add(place).write(*stack.add(place - 1));
                                place -= 1;
                            }
                            stack.add(place).write(entry);
                            held += 1;
                        }
                        held -= 1;
                        current = (*stack.add(held)).0;
                    }
                    continue;
                }
            } else {
                self.leaf::<I, ANY>(Child(current), &sheared, origin, direction, &mut hit);
                if ANY && hit.primitive != MISS {
                    return hit;
                }
                limit = I::Eight::splat(beyond(hit.t));
            }
            // The next node that is not behind the hit.
            loop {
                if held == 0 {
                    return hit;
                }
                held -= 1;
                // SAFETY: entries below `held` were written.
                let (node, t) = unsafe { *stack.add(held) };
                if t <= beyond(hit.t) {
                    current = node;
                    break;
                }
            }
        }
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
