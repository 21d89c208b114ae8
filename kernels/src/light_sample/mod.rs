//! Stage `light_sample`: traces the rays towards lights and adds what the unblocked ones bring.
//!
//! The directions come from [`lights`]; the shade kernels draw and weigh them, because the weight needs the material.

pub mod lights;

pub use lights::LightTable;

use crate::intersect::{Accelerator, TraversalStack};
use crate::isa::{Isa, Kernel};
use crate::lanes::{Mask, Real};
use crate::math::Vec3;
use crate::queue::{ShadowQueue, SlotTable};

/// The kernel. Returns how many rays were unblocked.
pub struct LightSample<'a, A> {
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// The rays.
    pub shadows: &'a ShadowQueue,
    /// Receives the radiance.
    pub slots: &'a mut SlotTable,
    /// Scratch of the traversal.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for LightSample<'_, A> {
    type Output = usize;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> usize {
        let (rays, slots) = (self.shadows, self.slots);
        let mut unblocked = 0;
        let mut at = 0;
        while at < rays.len {
            // Columns are padded, so whole vectors can be read.
            let count = (rays.len - at).min(I::Wide::LANES);
            let active = <I::Wide as Real>::Mask::first(count);
            let column = |c: &[f32]| I::Wide::load(c, at);
            let origin = Vec3::new(column(&rays.origin_x), column(&rays.origin_y), column(&rays.origin_z));
            let direction =
                Vec3::new(column(&rays.direction_x), column(&rays.direction_y), column(&rays.direction_z));
            let distance = column(&rays.distance);
            let blocked =
                self.accelerator.occluded_packet(isa, origin, direction, distance, active, self.stack);
            let mut free = (active & !blocked).bits();
            unblocked += free.count_ones() as usize;
            while free != 0 {
                let i = at + free.trailing_zeros() as usize;
                free &= free - 1;
                let slot = rays.slot[i] as usize;
                slots.radiance_r[slot] += rays.radiance_r[i];
                slots.radiance_g[slot] += rays.radiance_g[i];
                slots.radiance_b[slot] += rays.radiance_b[i];
            }
            at += count;
        }
        unblocked
    }
}
