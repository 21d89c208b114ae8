//! Light that a path finds by itself: emitting surfaces.

use super::add_radiance;
use crate::isa::{Isa, Kernel, Promise};
use crate::lanes::{Real, Uint};
use crate::material_sort::EMITS;
use crate::math::{Rgb, Vec3, power_heuristic};
use crate::queue::{HitQueue, PathQueue, SLOT_BITS, SlotTable, list_lanes};
use crate::scene::lights::{LightKinds, pdf};
use crate::scene::{PrimitiveTag, Scene};
use crate::shade::surface::Surface;
use core::marker::PhantomData;

/// Emitted radiance along a ray that met light `light` at distance `t`, weighed against light sampling by the power
/// heuristic. `pdf_bsdf` is the density of the ray's direction, 0 for specular lobes and camera rays, which light
/// sampling never serves.
///
/// # Safety
/// Every lane of `light` is a light of the scene.
#[inline(always)]
pub unsafe fn emitted<F: Real, L: LightKinds>(
    scene: &Scene,
    light: F::Uint,
    origin: Vec3<F>,
    direction: Vec3<F>,
    t: F,
    normal: Vec3<F>,
    pdf_bsdf: F,
) -> Rgb<F> {
    // SAFETY: the caller's promise.
    let row = unsafe { scene.lights().row::<F>(light) };
    let radiance = row.emitted(normal, origin, direction, t);
    if L::KINDS == 0 {
        return radiance;
    }
    let pdf_light = pdf::<F, L>(&row, origin, direction, t, normal);
    let weight = power_heuristic(pdf_bsdf, pdf_light * row.probability());
    let specular = pdf_bsdf.eq(F::zero());
    let weighed = radiance.scale(F::select(specular, F::one(), weight));
    // Unseen sides emit nothing, whatever their weight came out as.
    Rgb::select(radiance.max_component().gt(F::zero()), weighed, Rgb::zero())
}

/// The kernel: adds the emitted radiance of the paths whose key says that they met a light.
///
/// Promise: the queues are as long as their `new` made them; there is a path for each key, and where the key says so it
/// has a hit on a primitive of the scene that emits; if `L` is not empty, paths have densities.
pub struct Emission<'a, L> {
    /// Scene.
    pub scene: &'a Scene,
    /// What the paths met, by place.
    pub keys: &'a [u8],
    /// Paths that arrive.
    pub paths: &'a PathQueue,
    /// Where they arrive.
    pub hits: &'a HitQueue,
    /// Receives the radiance.
    pub slots: &'a mut SlotTable,
    /// Lights that are sampled, too.
    pub lights: PhantomData<L>,
    /// See there.
    pub promise: Promise,
}

impl<L: LightKinds> Kernel for Emission<'_, L> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) {
        emission::<I::Wide, L>(self.scene, self.keys, self.paths, self.hits, self.slots);
    }
}

/// Emitting paths that are collected before they are worked on: whole vectors, and a fraction.
const COLLECTED: usize = 64;

#[inline(always)]
fn emission<F: Real, L: LightKinds>(
    scene: &Scene,
    keys: &[u8],
    paths: &PathQueue,
    hits: &HitQueue,
    slots: &mut SlotTable,
) {
    let mut list = [0u32; COLLECTED];
    let (mut held, mut next) = (0, 0);
    while next < keys.len() {
        while next < keys.len() && held < COLLECTED {
            list[held] = next as u32;
            held += (keys[next] & EMITS != 0) as usize;
            next += 1;
        }
        let mut at = 0;
        while at < held {
            let (place, count) = list_lanes::<F>(&list[..held], at);
            // SAFETY: places in the list are below `paths.len` and hit an emitting primitive.
            let (slot, radiance) = unsafe { emission_at::<F, L>(scene, place, paths, hits) };
            add_radiance::<F>(slots, slot, radiance, count);
            at += count;
        }
        held = 0;
    }
}

/// Slots of the paths at some places, and the radiance that reaches them from what they met.
///
/// # Safety
/// Every lane of `place` is below `paths.len` and hit an emitting primitive, whose tag holds the number of its light.
#[inline(always)]
unsafe fn emission_at<F: Real, L: LightKinds>(
    scene: &Scene,
    place: F::Uint,
    paths: &PathQueue,
    hits: &HitQueue,
) -> (F::Uint, Rgb<F>) {
    // SAFETY: the caller's promise.
    unsafe {
        let real = |column: &[f32]| F::gather(column, place);
        let slot = F::Uint::gather(&paths.slot_depth, place) & F::Uint::splat((1 << SLOT_BITS) - 1);
        let primitive = F::Uint::gather(&hits.primitive, place);
        let origin = Vec3::new(real(&paths.origin_x), real(&paths.origin_y), real(&paths.origin_z));
        let direction =
            Vec3::new(real(&paths.direction_x), real(&paths.direction_y), real(&paths.direction_z));
        let t = real(&hits.t);
        let surface = Surface::new(scene.geometry(), primitive, origin, direction, t, || {
            (real(&hits.u), real(&hits.v))
        });
        let light =
            F::Uint::gather(scene.geometry().tags(), primitive) & F::Uint::splat(PrimitiveTag::ID_MASK);
        let pdf = if L::KINDS != 0 { real(&paths.pdf) } else { F::zero() };
        let emitted = emitted::<F, L>(scene, light, origin, direction, t, surface.normal, pdf);
        let throughput =
            Rgb::new(real(&paths.throughput_r), real(&paths.throughput_g), real(&paths.throughput_b));
        (slot, throughput * emitted)
    }
}
