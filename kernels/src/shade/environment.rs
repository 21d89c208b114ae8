//! Light of the sky, for paths that leave the scene.
//!
//! The sky has the same radiance in all directions. Sampling it as a light would only compete with the BSDF, which
//! samples it as well or better: it is found by BSDF sampling alone, with weight 1.

use super::add_radiance;
use crate::isa::{Isa, Kernel, Promise};
use crate::lanes::{Real, Uint};
use crate::math::Rgb;
use crate::queue::{PathQueue, SLOT_BITS, SlotTable, list_lanes};

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
