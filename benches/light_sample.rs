//! Stage `light_sample`: shadow rays a second, of what the camera sees and of what paths have bounced to, in a small
//! scene and in a large one, in every way through the wide tree, and through the binary one by obvhs.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use support::{Lamp, Loaded};
use wavepath_kernels::intersect::bvh2::NaiveBvh;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, RayClass, Traversal};
use wavepath_kernels::isa::Level;
use wavepath_kernels::light_sample::LightSample;

fn light_sample(c: &mut Criterion) {
    let level = Level::detect();
    for loaded in [Loaded::shipped("cornell"), Loaded::menger(Lamp::Ball)] {
        let geometry = loaded.scene.geometry();
        let (wide, naive) = (Bvh8::new(geometry), NaiveBvh::new(geometry));
        let rounds = loaded.many(&wide);
        // Radiance grows from run to run; nothing depends on it.
        let mut slots = rounds[0].slots.clone();
        for class in [RayClass::FirstShadow, RayClass::LaterShadow] {
            let pieces: Vec<_> = rounds
                .iter()
                .flat_map(|round| round.shadow_runs.iter().map(move |(range, c)| (&round.shadows, range, c)))
                .filter(|(_, _, c)| **c == class)
                .collect();
            let rays: usize = pieces.iter().map(|(_, range, _)| range.len()).sum();
            let mut group = c.benchmark_group(format!("light_sample/{}/{}", loaded.name, class.name()));
            group.throughput(Throughput::Elements(rays as u64));
            macro_rules! bench {
                ($name:expr, $accelerator:expr, $traversal:expr) => {{
                    let mut stack = $accelerator.stack();
                    group.bench_function($name, |b| {
                        b.iter(|| {
                            for &(shadows, range, _) in &pieces {
                                level.run(LightSample {
                                    accelerator: &$accelerator,
                                    traversal: $traversal,
                                    shadows,
                                    range: range.clone(),
                                    slots: &mut slots,
                                    stack: &mut stack,
                                });
                            }
                        });
                    });
                }};
            }
            bench!("packets", wide, Traversal::Packets);
            bench!("single", wide, Traversal::Single);
            bench!("interleaved", wide, Traversal::Interleaved);
            bench!("bvh2", naive, Traversal::Single);
        }
    }
}

criterion_group! { name = benches; config = support::short(); targets = light_sample }
criterion_main!(benches);
