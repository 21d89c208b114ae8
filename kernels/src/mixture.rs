//! Stage `mixture`, of scenes with mixtures of materials: which of its materials a path meets on such a surface.
//!
//! One of them is chosen for each path and vertex, with a number of its own, so that everything behind this stage knows
//! single materials only.

use crate::isa::{Isa, Kernel, Promise};
use crate::lanes::Real;
use crate::math::Vec3;
use crate::queue::{HitQueue, PathQueue, SLOT_BITS, SlotTable};
use crate::sampler::{Sampler, Stream, dimension, vertex_dimension};
use crate::scene::{MISS, MaterialClass, PrimitiveTag, Scene};
use crate::shade::materials::AMOUNT;
use crate::shade::surface::Surface;
use crate::texture::{EvaluateOne, WIDEST};
use core::marker::PhantomData;
use core::num::Wrapping;

/// The material that a path meets on a primitive with this tag at its vertex number `depth`: its tag (which never says
/// that it emits), and what the light that it scatters is multiplied by.
///
/// `met` is asked for the primitive, the point and the barycentric weights there if shares are textures.
#[inline(always)]
pub fn settle<I: Isa, F: Real<Uint = Wrapping<u32>>, S: Sampler>(
    isa: I,
    scene: &Scene,
    tag: PrimitiveTag,
    stream: Stream<Wrapping<u32>>,
    depth: u32,
    met: impl Fn() -> (u32, Surface<F>, [f32; 2]),
) -> (PrimitiveTag, [f32; 3]) {
    let row = scene.row_of(tag.0);
    if tag.class() != MaterialClass::Mixture as u32 {
        return (PrimitiveTag(tag.class() << PrimitiveTag::CLASS_SHIFT | row), [1.0; 3]);
    }
    let u = S::one::<f32>(stream, vertex_dimension(Wrapping(depth), dimension::MIXTURE));
    let textured = scene.programs().has_class(MaterialClass::Mixture);
    scene.materials().choose(row, u, |material| {
        textured.then(|| {
            let (primitive, surface, barycentric) = met();
            let mut row = [0.0; WIDEST];
            isa.run(EvaluateOne { scene, primitive, material, surface, barycentric, row: &mut row });
            [row[AMOUNT], row[AMOUNT + 1], row[AMOUNT + 2]]
        })
    })
}

/// The kernel: writes the material of each hit.
///
/// Promise: the queues are as long as their `new` made them for a scene with mixtures; the paths' hits are misses or
/// primitives of the scene; their slots are below the capacity of `slots`, and hold places of units that have an entry
/// in `first_sample`; where shares are textures, hits have barycentric weights.
pub struct Mixture<'a, S> {
    /// Scene.
    pub scene: &'a Scene,
    /// Paths that arrive.
    pub paths: &'a PathQueue,
    /// Where they arrive; receives the materials.
    pub hits: &'a mut HitQueue,
    /// Random streams.
    pub slots: &'a SlotTable,
    /// Index of the first sample of each work unit.
    pub first_sample: &'a [u32],
    /// Random numbers.
    pub sampler: PhantomData<S>,
    /// See there.
    pub promise: Promise,
}

impl<S: Sampler> Kernel for Mixture<'_, S> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        let Mixture { scene, paths, hits, slots, first_sample, .. } = self;
        for place in 0..paths.len {
            let primitive = hits.primitive[place];
            if primitive == MISS {
                continue;
            }
            let tag = PrimitiveTag(scene.geometry().tags()[primitive as usize]);
            let slot_depth = paths.slot_depth[place];
            let slot = Wrapping(slot_depth & ((1 << SLOT_BITS) - 1));
            // SAFETY: the promise.
            let stream = unsafe { slots.stream(first_sample, slot) };
            let vector = |[x, y, z]: [&[f32]; 3]| {
                Vec3::new(I::One::splat(x[place]), I::One::splat(y[place]), I::One::splat(z[place]))
            };
            let met = || {
                let barycentric = [hits.u[place], hits.v[place]];
                // SAFETY: the primitive was hit, so it exists.
                let surface = unsafe {
                    Surface::new(
                        scene.geometry(),
                        Wrapping(primitive),
                        vector([&paths.origin_x, &paths.origin_y, &paths.origin_z]),
                        vector([&paths.direction_x, &paths.direction_y, &paths.direction_z]),
                        I::One::splat(hits.t[place]),
                        || (I::One::splat(barycentric[0]), I::One::splat(barycentric[1])),
                    )
                };
                (primitive, surface, barycentric)
            };
            let (material, weight) =
                settle::<I, I::One, S>(isa, scene, tag, stream, slot_depth >> SLOT_BITS, met);
            hits.material[place] = material.0;
            [hits.weight_r[place], hits.weight_g[place], hits.weight_b[place]] = weight;
        }
    }
}
