//! Stage `roulette_compact`: paths a second, before roulette begins and long after.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::marker::PhantomData;
use support::{Lamp, Loaded, measure};
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::isa::{Level, Promise};
use wavepath_kernels::roulette_compact::RouletteCompact;
use wavepath_kernels::sampler::Sobol;

fn roulette_compact(c: &mut Criterion) {
    let level = Level::detect();
    for loaded in [Loaded::shipped("cornell"), Loaded::menger(Lamp::Ball)] {
        let tree = Bvh8::new(loaded.scene.geometry());
        let mut group = c.benchmark_group(format!("roulette_compact/{}", loaded.name));
        for (when, round) in loaded.first_and_deep(&tree) {
            let mut slots = round.lit_slots.clone();
            let mut order = round.order.clone();
            group.throughput(Throughput::Elements(round.scattered.len as u64));
            group.bench_function(when, |b| {
                measure(
                    b,
                    &mut (round.scattered.clone(), &mut slots, &mut order),
                    // Paths are packed in place.
                    |(paths, ..)| *paths = round.scattered.clone(),
                    |(paths, slots, order)| {
                        level.run(RouletteCompact::<Sobol> {
                            paths,
                            slots,
                            first_sample: &round.first_sample,
                            order,
                            free: 0,
                            sampler: PhantomData,
                            // SAFETY: a round of a render, each queue as the stage found it.
                            promise: unsafe { Promise::new() },
                        });
                    },
                );
            });
        }
    }
}

criterion_group! { name = benches; config = support::short(); targets = roulette_compact }
criterion_main!(benches);
