//! Stage `intersect`: closest hits a second, of camera rays and of bounce rays, in a small scene and in a large one, in
//! every way through the wide tree, and through the binary one by obvhs.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use support::{Lamp, Loaded};
use wavepath::engine::wavefront::DEFAULT_BATCH;
use wavepath::engine::wavefront::record::Round;
use wavepath_kernels::intersect::bvh2::NaiveBvh;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, Intersect, RayClass, Traversal};
use wavepath_kernels::isa::Level;
use wavepath_kernels::queue::HitQueue;

fn intersect(c: &mut Criterion) {
    let level = Level::detect();
    for loaded in [Loaded::shipped("cornell"), Loaded::menger(Lamp::Ball)] {
        let geometry = loaded.scene.geometry();
        let (wide, naive) = (Bvh8::new(geometry), NaiveBvh::new(geometry));
        let rounds = loaded.many(&wide);
        let mut hits = HitQueue::new(DEFAULT_BATCH, loaded.plan.requirements());
        let mut order = vec![0; DEFAULT_BATCH];
        for class in [RayClass::Camera, RayClass::Bounce] {
            let rays = |round: &Round| match class {
                RayClass::Camera => round.survivors..round.paths.len,
                _ => 0..round.survivors,
            };
            let mut group = c.benchmark_group(format!("intersect/{}/{}", loaded.name, class.name()));
            group.throughput(Throughput::Elements(rounds.iter().map(|round| rays(round).len() as u64).sum()));
            macro_rules! bench {
                ($name:expr, $accelerator:expr, $traversal:expr) => {{
                    let mut stack = $accelerator.stack();
                    group.bench_function($name, |b| {
                        b.iter(|| {
                            for round in &rounds {
                                level.run(Intersect {
                                    accelerator: &$accelerator,
                                    traversal: $traversal,
                                    paths: &round.paths,
                                    range: rays(round),
                                    hits: &mut hits,
                                    stack: &mut stack,
                                    order: &mut order,
                                });
                            }
                        });
                    });
                }};
            }
            bench!("packets", wide, Traversal::Packets);
            bench!("sorted", wide, Traversal::Sorted);
            bench!("single", wide, Traversal::Single);
            bench!("interleaved", wide, Traversal::Interleaved);
            bench!("bvh2", naive, Traversal::Single);
        }
    }
}

criterion_group! { name = benches; config = support::short(); targets = intersect }
criterion_main!(benches);
