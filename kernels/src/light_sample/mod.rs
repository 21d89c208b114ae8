//! Stage `light_sample`: traces the rays towards lights and adds what the unblocked ones bring.
//!
//! The directions come from [`lights`]; the shade kernels draw and weigh them, because the weight needs the material.

pub mod lights;

pub use lights::LightTable;

use crate::intersect::{Accelerator, Traversal, TraversalStack};
use crate::isa::{Isa, Kernel};
use crate::lanes::{Mask, Real, Uint};
use crate::math::Vec3;
use crate::queue::{PAD, SHADOW_RAYS, ShadowQueue, SlotTable};
use crate::shade::list_lanes;
use core::ops::Range;

/// The kernel: traces some of the rays. A path has at most one of them, so their order does not matter.
pub struct LightSample<'a, A> {
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// How.
    pub traversal: Traversal,
    /// The rays.
    pub shadows: &'a ShadowQueue,
    /// Places of those to trace.
    pub range: Range<usize>,
    /// Receives the radiance.
    pub slots: &'a mut SlotTable,
    /// Scratch of the traversal.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for LightSample<'_, A> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        match self.traversal {
            Traversal::Packets => self.packets(isa),
            Traversal::Sorted => self.sorted(isa),
            Traversal::Single => {
                let Self { accelerator, shadows, range, slots, stack, .. } = self;
                for i in range {
                    let (origin, direction, distance) = shadows.ray(i);
                    if !accelerator.occluded(isa, origin, direction, distance, stack) {
                        slots.add_shadow(shadows, i);
                    }
                }
            }
            Traversal::Interleaved => {
                let Self { accelerator, shadows, range, slots, stack, .. } = self;
                let add = |i| slots.add_shadow(shadows, i);
                accelerator.unoccluded_interleaved(isa, shadows, range, stack, add);
            }
        }
    }
}

impl<A: Accelerator> LightSample<'_, A> {
    #[inline(always)]
    fn packets<I: Isa>(self, isa: I) {
        let rays = self.shadows;
        let mut at = self.range.start;
        while at < self.range.end {
            // Columns are padded, so whole vectors can be read.
            let count = (self.range.end - at).min(I::Wide::LANES);
            let active = <I::Wide as Real>::Mask::first(count);
            let column = |c: &[f32]| I::Wide::load(c, at);
            let origin = Vec3::new(column(&rays.origin_x), column(&rays.origin_y), column(&rays.origin_z));
            let direction =
                Vec3::new(column(&rays.direction_x), column(&rays.direction_y), column(&rays.direction_z));
            let distance = column(&rays.distance);
            let blocked =
                self.accelerator.occluded_packet(isa, origin, direction, distance, active, self.stack);
            let mut free = (active & !blocked).bits();
            while free != 0 {
                self.slots.add_shadow(rays, at + free.trailing_zeros() as usize);
                free &= free - 1;
            }
            at += count;
        }
    }
}

impl<A: Accelerator> LightSample<'_, A> {
    #[inline(always)]
    fn sorted<I: Isa>(self, isa: I) {
        let rays = self.shadows;
        let (mut keys, mut order) = ([0; SHADOW_RAYS + PAD], [0; SHADOW_RAYS]);
        for start in self.range.clone().step_by(SHADOW_RAYS) {
            let piece = start..self.range.end.min(start + SHADOW_RAYS);
            let n = piece.len();
            self.stack.sorter.sort::<I::Wide>(rays, piece, &mut keys, &mut order);
            let mut at = 0;
            while at < n {
                let (place, count) = list_lanes::<I::Wide>(&order[..n], at);
                let active = <I::Wide as Real>::Mask::first(count);
                // SAFETY: the list holds places of rays.
                let column = |c: &[f32]| unsafe { I::Wide::gather(c, place) };
                let origin =
                    Vec3::new(column(&rays.origin_x), column(&rays.origin_y), column(&rays.origin_z));
                let direction = Vec3::new(
                    column(&rays.direction_x),
                    column(&rays.direction_y),
                    column(&rays.direction_z),
                );
                let distance = column(&rays.distance);
                let blocked =
                    self.accelerator.occluded_packet(isa, origin, direction, distance, active, self.stack);
                let mut free = (active & !blocked).bits();
                let place = place.to_array();
                while free != 0 {
                    self.slots.add_shadow(rays, place[free.trailing_zeros() as usize & 15] as usize);
                    free &= free - 1;
                }
                at += count;
            }
        }
    }
}

impl SlotTable {
    /// Adds what the unblocked shadow ray at place `i` brings.
    #[inline(always)]
    fn add_shadow(&mut self, rays: &ShadowQueue, i: usize) {
        let slot = rays.slot[i] as usize;
        self.radiance_r[slot] += rays.radiance_r[i];
        self.radiance_g[slot] += rays.radiance_g[i];
        self.radiance_b[slot] += rays.radiance_b[i];
    }
}
