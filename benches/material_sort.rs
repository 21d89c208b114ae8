//! Stage `material_sort`: paths a second, in a scene of three materials and in one of five.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use support::Loaded;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::isa::Level;
use wavepath_kernels::material_sort::MaterialSort;

fn material_sort(c: &mut Criterion) {
    let level = Level::detect();
    for loaded in [Loaded::shipped("cornell"), Loaded::shipped("wineglass")] {
        let tree = Bvh8::new(loaded.scene.geometry());
        let mut group = c.benchmark_group(format!("material_sort/{}", loaded.name));
        for (when, round) in loaded.first_and_deep(&tree) {
            let mut order = round.order.clone();
            group.throughput(Throughput::Elements(round.paths.len as u64));
            group.bench_function(when, |b| {
                b.iter(|| {
                    level.run(MaterialSort {
                        tags: loaded.scene.geometry().tags(),
                        max_depth: loaded.scene.max_depth(),
                        paths: &round.paths,
                        hits: &round.hits,
                        order: &mut order,
                        free: round.free,
                    })
                });
            });
        }
    }
}

criterion_group! { name = benches; config = support::short(); targets = material_sort }
criterion_main!(benches);
