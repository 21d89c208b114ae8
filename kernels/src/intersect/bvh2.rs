//! The tree as obvhs builds it, and obvhs' own traversal of it: the baseline.

use super::{Accelerator, Hit, TraversalStack, bounds, test_round, test_triangle};
use crate::intersect::triangle::ShearedRay;
use crate::isa::Isa;
use crate::lanes::Real;
use crate::scene::{Geometry, MISS};
use core::time::Duration;
use glam::{Vec3A, vec3a};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::ray::{Ray, RayHit};

/// Builds obvhs' binary tree (PLOC, then reinsertion) over all primitives, with at most `leaf` primitives a leaf.
///
/// Primitives with equal boxes enter as one and are told apart at the end: PLOC merges few of equal neighbours a pass,
/// so that time and depth would grow with the square and the number of them.
pub fn build(geometry: &Geometry, leaf: u32) -> Bvh2 {
    let boxes: Vec<Aabb> = (0..geometry.primitives() as u32)
        .map(|p| {
            let (low, high) = bounds(geometry, p);
            Aabb { min: Vec3A::from(low), max: Vec3A::from(high) }
        })
        .collect();
    let key = |p: u32| {
        let b = &boxes[p as usize];
        [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z].map(f32::to_bits)
    };
    let mut alike: Vec<u32> = (0..boxes.len() as u32).collect();
    alike.sort_unstable_by_key(|&p| (key(p), p));
    // Each group in the order of primitives, the groups in the order of their first.
    let mut groups: Vec<&[u32]> = alike.chunk_by(|&a, &b| key(a) == key(b)).collect();
    groups.sort_unstable_by_key(|group| group[0]);
    let unique: Vec<Aabb> = groups.iter().map(|group| boxes[group[0] as usize]).collect();
    let parameters = BvhBuildParams { max_prims_per_leaf: leaf, ..BvhBuildParams::medium_build() };
    let mut tree = obvhs::bvh2::builder::build_bvh2(&unique, parameters, &mut Duration::default());
    if unique.len() < boxes.len() {
        expand(&mut tree, &groups, leaf as usize);
    }
    tree
}

/// Puts the primitives of each group in place of its number, and halves leaves that have become too large.
fn expand(tree: &mut Bvh2, groups: &[&[u32]], leaf: usize) {
    let mut primitives = Vec::new();
    let mut added_depth = 0;
    for n in 0..tree.nodes.len() {
        let node = tree.nodes[n];
        if !node.is_leaf() {
            continue;
        }
        let first = node.first_index as usize;
        let begin = primitives.len();
        for &group in &tree.primitive_indices[first..first + node.prim_count as usize] {
            primitives.extend(groups[group as usize]);
        }
        let mut pending = vec![(n, begin..primitives.len(), 0)];
        while let Some((n, range, depth)) = pending.pop() {
            added_depth = depth.max(added_depth);
            if range.len() <= leaf {
                tree.nodes[n] = Bvh2Node::new(*node.aabb(), range.len() as u32, range.start as u32);
                continue;
            }
            let children = tree.nodes.len();
            tree.nodes.extend([node; 2]);
            tree.nodes[n].make_inner(children as u32);
            let middle = range.start + range.len() / 2;
            pending.push((children, range.start..middle, depth + 1));
            pending.push((children + 1, middle..range.end, depth + 1));
        }
    }
    tree.primitive_indices = primitives;
    tree.max_depth += added_depth;
}

/// obvhs' tree with the primitives in the order of its leaves.
pub struct NaiveBvh<'a> {
    tree: Bvh2,
    geometry: &'a Geometry,
    /// Corners of the triangles in the order of the leaves; unused places for other primitives.
    corners: Vec<[[f32; 3]; 3]>,
}

/// 1 / x for box tests: finite for every x. obvhs' own clamp (8.4e6) makes axis-parallel rays miss thin boxes far
/// away.
#[inline(always)]
pub(super) fn inverse(x: f32) -> f32 {
    if x.abs() < 1e-30 { 1e30f32.copysign(x) } else { 1.0 / x }
}

/// A distance a little beyond `t`: boxes entered there may still hold a hit at `t` itself, which wins if its number
/// is lower; and boxes left there, by a ray that touches them, must not be lost to rounding (Ize 2013).
#[inline(always)]
pub(super) fn beyond<F: Real>(t: F) -> F {
    t * F::lit(1.0 + 4.0 * f32::EPSILON as f64)
}

/// Grows all boxes by 32 units in the last place of the scene's size. obvhs' box test has no margin for the rounding
/// of distances (Ize 2013), which for rays from within ten times the size of the scene this makes good: without it
/// rays slip past the corners of boxes.
fn inflate(tree: &mut Bvh2) {
    let Some(root) = tree.nodes.first() else { return };
    let root = *root.aabb();
    let size = root.max.abs().max(root.min.abs()).max_element();
    let pad = Vec3A::splat(32.0 * f32::EPSILON * size);
    for node in &mut tree.nodes {
        let b = *node.aabb();
        node.set_aabb(Aabb { min: b.min - pad, max: b.max + pad });
    }
}

impl<'a> NaiveBvh<'a> {
    /// Builds the tree.
    pub fn new(geometry: &'a Geometry) -> Self {
        let mut tree = if geometry.primitives() == 0 { Bvh2::default() } else { build(geometry, 4) };
        inflate(&mut tree);
        let corners =
            tree.primitive_indices
                .iter()
                .map(|&p| {
                    if p < geometry.first_sphere() {
                        geometry.corners(p as usize)
                    } else {
                        Default::default()
                    }
                })
                .collect();
        NaiveBvh { tree, geometry, corners }
    }

    /// Walks the tree; `done` says after each primitive whether that was enough.
    #[inline(always)]
    fn walk(&self, origin: [f32; 3], direction: [f32; 3], t_max: f32, any: bool) -> Hit {
        let mut hit = Hit::none(t_max);
        let mut ray = Ray::new(Vec3A::from(origin), Vec3A::from(direction), 0.0, beyond(t_max));
        let [x, y, z] = direction.map(inverse);
        ray.inv_direction = vec3a(x, y, z);
        let sheared = ShearedRay::new(origin, direction);
        let mut leaf = |node: &Bvh2Node, ray: &mut Ray, _: &mut RayHit| {
            let first = node.first_index as usize;
            for place in first..first + node.prim_count as usize {
                let primitive = self.tree.primitive_indices[place];
                if primitive < self.geometry.first_sphere() {
                    test_triangle(&self.corners[place], primitive, &sheared, &mut hit);
                } else {
                    test_round(self.geometry, primitive, origin, direction, &mut hit);
                }
                if any && hit.primitive != MISS {
                    return false;
                }
            }
            ray.tmax = beyond(hit.t);
            true
        };
        obvhs::fast_stack!(u32, (96, 192), self.tree.max_depth, stack, {
            self.tree.ray_traverse_dynamic(&mut stack, ray, &mut RayHit::none(), &mut leaf)
        });
        hit
    }
}

impl Accelerator for NaiveBvh<'_> {
    const NAME: &'static str = "obvhs BVH2";

    #[inline(always)]
    fn closest<I: Isa>(&self, _: I, origin: [f32; 3], direction: [f32; 3], _: &mut TraversalStack) -> Hit {
        self.walk(origin, direction, f32::INFINITY, false)
    }
    #[inline(always)]
    fn occluded<I: Isa>(
        &self,
        _: I,
        origin: [f32; 3],
        direction: [f32; 3],
        distance: f32,
        _: &mut TraversalStack,
    ) -> bool {
        self.walk(origin, direction, distance, true).primitive != MISS
    }
    fn bounds(&self) -> [[f32; 3]; 2] {
        self.tree.nodes.first().map_or([[0.0; 3]; 2], |root| [root.aabb().min.into(), root.aabb().max.into()])
    }
    fn stack(&self) -> TraversalStack {
        TraversalStack::default()
    }
    fn bytes(&self) -> usize {
        size_of_val(&self.tree.nodes[..])
            + size_of_val(&self.tree.primitive_indices[..])
            + size_of_val(&self.corners[..])
    }
}
