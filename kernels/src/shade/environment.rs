//! Light of the sky, for paths that leave the scene.
//!
//! A sky that has the same radiance in all directions is found by BSDF sampling alone, with weight 1: sampling it as a
//! light would only compete with the BSDF, which samples it as well or better. Pictures of the sky are lights, too, and
//! weighed.

use super::add_radiance;
use crate::isa::{Isa, Kernel, Promise};
use crate::lanes::{Real, Uint};
use crate::math::{Rgb, Vec3, power_heuristic};
use crate::queue::{PathQueue, SLOT_BITS, SlotTable, list_lanes};
use crate::scene::Scene;
use crate::scene::lights::{LightKinds, kind};
use core::marker::PhantomData;

/// The kernel: adds the sky to the listed paths.
///
/// Promise: the columns of the queue are as long as its `new` made them, and the list holds places of paths.
pub struct Environment<'a> {
    /// Radiance of the sky.
    pub radiance: [f32; 3],
    /// Places of paths that left the scene.
    pub list: &'a [u32],
    /// The paths.
    pub paths: &'a PathQueue,
    /// Receives the radiance.
    pub slots: &'a mut SlotTable,
    /// See there.
    pub promise: Promise,
}

impl Kernel for Environment<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) {
        environment::<I::Wide>(self.radiance, self.list, self.paths, self.slots);
    }
}

#[inline(always)]
fn environment<F: Real>(radiance: [f32; 3], list: &[u32], paths: &PathQueue, slots: &mut SlotTable) {
    let sky = Rgb::<F>::splat(radiance);
    let mut at = 0;
    while at < list.len() {
        let (place, count) = list_lanes::<F>(list, at);
        // SAFETY: listed places are below `paths.len`.
        let (slot, throughput) = unsafe {
            let real = |column: &[f32]| F::gather(column, place);
            let slot = F::Uint::gather(&paths.slot_depth, place) & F::Uint::splat((1 << SLOT_BITS) - 1);
            (slot, Rgb::new(real(&paths.throughput_r), real(&paths.throughput_g), real(&paths.throughput_b)))
        };
        add_radiance::<F>(slots, slot, throughput * sky, count);
        at += count;
    }
}

/// Radiance of the whole sky along a ray that meets nothing, its pictures weighed against light sampling by the power
/// heuristic. `pdf_bsdf` is the density of the ray's direction, 0 for specular lobes and camera rays, which light
/// sampling never serves.
#[inline(always)]
pub fn sky<F: Real, L: LightKinds>(
    scene: &Scene,
    origin: Vec3<F>,
    direction: Vec3<F>,
    pdf_bsdf: F,
) -> Rgb<F> {
    let mut sum = Rgb::splat(scene.environment());
    for map in scene.lights().maps() {
        let (radiance, pdf) = map.met(origin, direction);
        let weighed = if L::KINDS & kind::ENVIRONMENT != 0 {
            let weight = power_heuristic(pdf_bsdf, pdf * F::splat(map.probability()));
            let specular = pdf_bsdf.eq(F::zero());
            radiance.scale(F::select(specular, F::one(), weight))
        } else {
            radiance
        };
        sum = Rgb { r: sum.r + weighed.r, g: sum.g + weighed.g, b: sum.b + weighed.b };
    }
    sum
}

/// The kernel: adds the sky to the listed paths, in scenes that have pictures of it.
///
/// Promise: as for [`Environment`]; if `L` holds environment maps, paths have densities.
pub struct EnvironmentMaps<'a, L> {
    /// Scene.
    pub scene: &'a Scene,
    /// Places of paths that left the scene.
    pub list: &'a [u32],
    /// The paths.
    pub paths: &'a PathQueue,
    /// Receives the radiance.
    pub slots: &'a mut SlotTable,
    /// Lights that are sampled, too.
    pub lights: PhantomData<L>,
    /// See there.
    pub promise: Promise,
}

impl<L: LightKinds> Kernel for EnvironmentMaps<'_, L> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) {
        environment_maps::<I::Wide, L>(self.scene, self.list, self.paths, self.slots);
    }
}

#[inline(always)]
fn environment_maps<F: Real, L: LightKinds>(
    scene: &Scene,
    list: &[u32],
    paths: &PathQueue,
    slots: &mut SlotTable,
) {
    let mut at = 0;
    while at < list.len() {
        let (place, count) = list_lanes::<F>(list, at);
        // SAFETY: listed places are below `paths.len`.
        let (slot, radiance) = unsafe {
            let real = |column: &[f32]| F::gather(column, place);
            let slot = F::Uint::gather(&paths.slot_depth, place) & F::Uint::splat((1 << SLOT_BITS) - 1);
            let origin = Vec3::new(real(&paths.origin_x), real(&paths.origin_y), real(&paths.origin_z));
            let direction =
                Vec3::new(real(&paths.direction_x), real(&paths.direction_y), real(&paths.direction_z));
            let pdf = if L::KINDS & kind::ENVIRONMENT != 0 { real(&paths.pdf) } else { F::zero() };
            let throughput =
                Rgb::new(real(&paths.throughput_r), real(&paths.throughput_g), real(&paths.throughput_b));
            (slot, throughput * sky::<F, L>(scene, origin, direction, pdf))
        };
        add_radiance::<F>(slots, slot, radiance, count);
        at += count;
    }
}
