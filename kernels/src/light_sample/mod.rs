//! Stage `light_sample`: traces the rays towards lights and adds what the unblocked ones bring.
//!
//! The directions come from [`crate::scene::lights`]; the shade kernels draw and weigh them, because the weight needs the material.

use crate::intersect::{Accelerator, PACKET_BITS, RayPacket, TOGETHER, Traversal, TraversalStack};
use crate::isa::{Isa, Kernel};
use crate::lanes::{Mask, Real};
use crate::queue::{ShadowQueue, SlotTable};
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
            // In order they took 1.00 to 1.28 times the time: they go to few lights, and are in order as they come.
            Traversal::Packets | Traversal::Sorted => self.packets(isa),
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
        let (rays, end) = (self.shadows, self.range.end);
        let mut at = self.range.start;
        while at < end {
            // Columns are padded, so whole vectors can be read.
            let mut packets = [RayPacket::none(); TOGETHER];
            let mut distance = [I::Wide::zero(); TOGETHER];
            for (v, (packet, distance)) in packets.iter_mut().zip(&mut distance).enumerate() {
                let at = (at + v * I::Wide::LANES).min(end);
                *packet = rays.packet(at, end - at);
                *distance = I::Wide::load(&rays.distance, at);
            }
            let blocked = self.accelerator.occluded_packets(isa, &packets, &distance, self.stack);
            for (v, packet) in packets.iter().enumerate() {
                let mut free = packet.active.bits() & !(blocked >> (PACKET_BITS * v)) as u32;
                while free != 0 {
                    self.slots.add_shadow(rays, at + free.trailing_zeros() as usize);
                    free &= free - 1;
                }
                at += I::Wide::LANES;
            }
        }
    }
}

impl SlotTable {
    /// Adds what the unblocked shadow ray at place `i` brings.
    #[inline(always)]
    pub(crate) fn add_shadow(&mut self, rays: &ShadowQueue, i: usize) {
        let slot = rays.slot[i] as usize;
        self.radiance_r[slot] += rays.radiance_r[i];
        self.radiance_g[slot] += rays.radiance_g[i];
        self.radiance_b[slot] += rays.radiance_b[i];
    }
}
