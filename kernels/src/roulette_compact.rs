//! Stage `roulette_compact`: Russian roulette, and the compaction of the survivors.

use crate::isa::{Isa, Kernel, Promise};
use crate::lanes::{Mask, Real, Uint};
use crate::math::Rgb;
use crate::queue::{OrderLists, PathQueue, SLOT_BITS, SlotTable};
use crate::sampler::{Sampler, Stream, dimension, vertex_dimension};
use core::marker::PhantomData;

/// Paths are not played for before they have scattered this often.
pub const FIRST_ROULETTE: u32 = 3;

/// Probability of survival: the square root of the largest component of the throughput, with the radiance scaling of
/// refraction taken out (light inside of glass is not more important for its radiance being higher), at most 1.
///
/// The throughput itself, from the second scattering on (pbrt's rule), ends paths sooner than it pays. Efficiency
/// 1 / (relMSE seconds) relative to that rule, in a Cornell box, among aluminium, inside a spherical light, in a closed
/// furnace, before caustics: square root from the second on 1.14, 1.27, 1.61, 1.59, 1.06; from the third on 1.14,
/// 1.45, 2.5, 2.6, 1.05; from the fourth on 1.16, 1.52, 3.0, 4.4, 0.92.
#[inline(always)]
pub fn survival<F: Real>(throughput: Rgb<F>, eta_scale: F, scattered: F::Uint) -> F {
    let played = (throughput.max_component() * eta_scale).sqrt().min(F::one());
    let early = scattered.lt(F::Uint::splat(FIRST_ROULETTE));
    F::select(early, F::one(), played)
}

/// Plays for a path that has scattered `scattered` times: its throughput afterwards and whether it lives.
#[inline(always)]
pub fn roulette<F: Real, S: Sampler>(
    stream: Stream<F::Uint>,
    throughput: Rgb<F>,
    eta_scale: F,
    scattered: F::Uint,
) -> (Rgb<F>, F::Mask) {
    let q = survival(throughput, eta_scale, scattered);
    let certain = q.ge(F::one());
    let possible = throughput.max_component().gt(F::zero());
    if (!certain & possible).any() {
        // The dimension belongs to the vertex just left.
        let vertex = scattered - F::Uint::splat(1);
        let u = S::one::<F>(stream, vertex_dimension(vertex, dimension::ROULETTE));
        (throughput.scale(q.recip()), possible & (certain | u.lt(q)))
    } else {
        (throughput, possible)
    }
}

/// The kernel: plays for all paths of a queue and packs the survivors to its front. Slots of the others join the
/// free ones, whose number it returns; above [`SLOT_BITS`] they tell how many rays the path had after the first one.
///
/// Promise: the queues are as long as their `new` made them; the slots in the whole column of `paths`, those behind its
/// end included, are below the capacity of `slots`, and hold places of units that have an entry in `first_sample`.
pub struct RouletteCompact<'a, S> {
    /// Paths; packed in place.
    pub paths: &'a mut PathQueue,
    /// Random streams, and where a throughput that is not finite is made known.
    pub slots: &'a mut SlotTable,
    /// Index of the first sample of each work unit.
    pub first_sample: &'a [u32],
    /// Receives the slots of ended paths, behind the free ones.
    pub order: &'a mut OrderLists,
    /// How many slots are free already.
    pub free: usize,
    /// Random numbers.
    pub sampler: PhantomData<S>,
    /// See there.
    pub promise: Promise,
}

impl<S: Sampler> Kernel for RouletteCompact<'_, S> {
    type Output = usize;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> usize {
        roulette_compact::<I::Wide, S>(self.paths, self.slots, self.first_sample, self.order, self.free)
    }
}

#[inline(always)]
fn roulette_compact<F: Real, S: Sampler>(
    paths: &mut PathQueue,
    slots: &mut SlotTable,
    first_sample: &[u32],
    order: &mut OrderLists,
    mut free: usize,
) -> usize {
    let weighed = !paths.pdf.is_empty();
    let scales = !slots.eta_scale.is_empty();
    let n = paths.len;
    let mut to = 0;
    let mut at = 0;
    while at < n {
        let count = (n - at).min(F::LANES);
        let active = F::Mask::first(count);
        // Columns are padded, so a whole vector can be read; lanes behind the end hold what earlier rounds left.
        let real = |column: &[f32]| F::load(column, at);
        let slot_depth = F::Uint::load(&paths.slot_depth, at);
        let slot = slot_depth & F::Uint::splat((1 << SLOT_BITS) - 1);
        let throughput =
            Rgb::new(real(&paths.throughput_r), real(&paths.throughput_g), real(&paths.throughput_b));

        // The sum, not the maximum: that of a NaN and a number is the number.
        let finite = throughput.sum().lt(F::lit(f64::INFINITY));
        if (!finite & active).any() {
            poison::<F>(slots, slot, !finite & active);
        }
        // SAFETY: slots were given out by `generate` and are below the capacity of the table; lanes behind the end
        // hold slots of earlier rounds, or 0.
        let (stream, eta_scale) = unsafe {
            let eta_scale = if scales { F::gather(&slots.eta_scale, slot) } else { F::one() };
            (slots.stream(first_sample, slot), eta_scale)
        };
        let scattered = slot_depth.shr::<SLOT_BITS>();
        let (throughput, lives) = roulette::<F, S>(stream, throughput, eta_scale, scattered);
        let lives = lives & active & finite;
        let ends = active & !lives;

        // Packed in place: `to` never passes `at`, and the vector at `at` has been read, but the other columns of it
        // have not: each is read just before it is written.
        macro_rules! pack {
            ($($column:ident),*) => {$(
                F::load(&paths.$column, at).compress(lives, &mut paths.$column, to);
            )*};
        }
        pack!(origin_x, origin_y, origin_z, direction_x, direction_y, direction_z);
        if weighed {
            pack!(pdf);
        }
        throughput.r.compress(lives, &mut paths.throughput_r, to);
        throughput.g.compress(lives, &mut paths.throughput_g, to);
        throughput.b.compress(lives, &mut paths.throughput_b, to);
        slot_depth.compress(lives, &mut paths.slot_depth, to);
        // The last vertex was scattered from in vain.
        (slot_depth - F::Uint::splat(1 << SLOT_BITS)).compress(ends, &mut order.list, free);
        to += lives.count();
        free += ends.count();
        at += count;
    }
    paths.len = to;
    free
}

/// A throughput that is infinite or not a number makes the sample invalid: it is counted when the path ends.
#[cold]
fn poison<F: Real>(slots: &mut SlotTable, slot: F::Uint, lanes: F::Mask) {
    let slot = slot.to_array();
    for i in (0..F::LANES).filter(|i| lanes.bits() >> i & 1 == 1) {
        slots.radiance_r[slot[i] as usize] = f32::NAN;
    }
}
