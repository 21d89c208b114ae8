//! Stage `light_sample`: traces the rays towards lights and adds what the unblocked ones bring.
//!
//! The directions come from [`lights`]; the shade kernels draw and weigh them, because the weight needs the material.

pub mod lights;

pub use lights::LightTable;

use crate::intersect::{Accelerator, TraversalStack};
use crate::isa::{Isa, Kernel};
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
        for i in 0..rays.len {
            let origin = [rays.origin_x[i], rays.origin_y[i], rays.origin_z[i]];
            let direction = [rays.direction_x[i], rays.direction_y[i], rays.direction_z[i]];
            if self.accelerator.occluded(isa, origin, direction, rays.distance[i], self.stack) {
                continue;
            }
            let slot = rays.slot[i] as usize;
            slots.radiance_r[slot] += rays.radiance_r[i];
            slots.radiance_g[slot] += rays.radiance_g[i];
            slots.radiance_b[slot] += rays.radiance_b[i];
            unblocked += 1;
        }
        unblocked
    }
}
