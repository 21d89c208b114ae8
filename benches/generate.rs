//! Stage `generate`: camera rays a second, through a pinhole and through a lens.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::marker::PhantomData;
use support::Loaded;
use wavepath::engine::wavefront::DEFAULT_BATCH;
use wavepath_kernels::generate::{Batch, Generate};
use wavepath_kernels::isa::Level;
use wavepath_kernels::queue::{PathQueue, SlotTable};
use wavepath_kernels::sampler::Sobol;

fn generate(c: &mut Criterion) {
    let level = Level::detect();
    let mut group = c.benchmark_group("generate");
    group.throughput(Throughput::Elements(DEFAULT_BATCH as u64));
    for (name, lens) in [("cornell", "pinhole"), ("depth-of-field", "lens")] {
        let loaded = Loaded::shipped(name);
        let (film, requirements) = (loaded.film(), loaded.plan.requirements());
        let mut paths = PathQueue::new(DEFAULT_BATCH, requirements);
        let mut slots = SlotTable::new(DEFAULT_BATCH, requirements);
        let free: Vec<u32> = (0..DEFAULT_BATCH as u32).collect();
        // Blocks in turn, so that pixels and samples differ from batch to batch.
        let mut turn = 0;
        group.bench_function(lens, |b| {
            b.iter(|| {
                turn += 1;
                paths.len = 0;
                level.run(Generate::<Sobol> {
                    camera: loaded.scene.camera(),
                    batch: Batch {
                        block: &film.blocks()[turn % 64],
                        image_width: film.image_width(),
                        seed: 1,
                        replicate: 0,
                        first_sample: 16 * (turn / 64) as u32,
                        samples: 16,
                        first: 0,
                        unit: 0,
                    },
                    free: &free,
                    paths: &mut paths,
                    slots: &mut slots,
                    sampler: PhantomData,
                });
            });
        });
    }
}

criterion_group! { name = benches; config = support::short(); targets = generate }
criterion_main!(benches);
