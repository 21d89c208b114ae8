//! A binary tree, and obvhs' own traversal of it: the baseline.

use super::partition::{Partitioner, references};
use super::{Accelerator, Hit, TraversalStack, test_round, test_triangle};
use crate::intersect::triangle::ShearedRay;
use crate::isa::Isa;
use crate::lanes::Real;
use crate::scene::{Geometry, MISS};
use glam::{Vec3A, vec3a};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::ray::{Ray, RayHit};

/// Most primitives of a leaf.
const MAX_LEAF: usize = 4;

/// Builds a binary tree over all primitives.
fn build(geometry: &Geometry) -> Bvh2 {
    let (mut set, extent) = references(geometry, 1);
    let partitioner = Partitioner::new(set.len(), 1);
    let mut nodes = vec![Bvh2Node::default()];
    let mut deepest = 0;
    let mut pending = vec![(0, 0..set.len(), extent, 0)];
    while let Some((node, places, extent, depth)) = pending.pop() {
        deepest = deepest.max(depth);
        let part = &mut set[places.clone()];
        nodes[node] = Bvh2Node::new(extent.bounds, part.len() as u32, places.start as u32);
        if part.len() <= MAX_LEAF {
            continue;
        }
        let (first, [left, right]) = partitioner.part(part, &extent, depth);
        let middle = places.start + first;
        let children = nodes.len();
        nodes[node].make_inner(children as u32);
        nodes.extend([Bvh2Node::default(); 2]);
        pending.push((children, places.start..middle, left, depth + 1));
        pending.push((children + 1, middle..places.end, right, depth + 1));
    }
    Bvh2 {
        nodes,
        primitive_indices: set.iter().map(|reference| reference.primitive).collect(),
        // A traversal holds at most one node of each level, and both children of the last.
        max_depth: deepest as usize + 2,
        ..Bvh2::default()
    }
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
        let mut tree = if geometry.primitives() == 0 { Bvh2::default() } else { build(geometry) };
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

    /// Is this the tree of `geometry`, the very same?
    pub fn is_of(&self, geometry: &Geometry) -> bool {
        core::ptr::eq(self.geometry, geometry)
    }

    /// Walks the tree; `done` says after each primitive whether that was enough.
    #[inline(always)]
    fn walk(&self, origin: [f32; 3], direction: [f32; 3], t_max: f32, any: bool) -> Hit {
        let mut hit = Hit::none(t_max);
        let [x, y, z] = direction.map(inverse);
        // Not by its `new`, which asserts in debug builds that a ray is one: broken samples make others.
        let ray = Ray {
            origin: Vec3A::from(origin),
            direction: Vec3A::from(direction),
            inv_direction: vec3a(x, y, z),
            tmin: 0.0,
            tmax: beyond(t_max),
        };
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
