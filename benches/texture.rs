//! Stage `texture`: paths a second, on textured materials of one class.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use support::Loaded;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::isa::{Level, Promise};
use wavepath_kernels::material_sort::list;
use wavepath_kernels::scene::MaterialClass;
use wavepath_kernels::texture::{EvaluateTextures, PIECE, TexturedRows};

fn texture(c: &mut Criterion) {
    let level = Level::detect();
    let loaded = Loaded::shipped("textures");
    let tree = Bvh8::new(loaded.scene.geometry());
    let mut rows = TexturedRows::new(&loaded.scene);
    let mut group = c.benchmark_group(format!("texture/{}", loaded.name));
    for (when, round) in loaded.first_and_deep(&tree) {
        let list = &round.order.list[round.sorted.range(list::of(MaterialClass::Lambert))];
        group.throughput(Throughput::Elements(list.len() as u64));
        group.bench_function(when, |b| {
            b.iter(|| {
                for piece in list.chunks(PIECE) {
                    level.run(EvaluateTextures {
                        scene: &loaded.scene,
                        list: piece,
                        paths: &round.paths,
                        hits: &round.hits,
                        rows: &mut rows,
                        // SAFETY: a round of a render, each queue as the stage found it; pieces are short enough.
                        promise: unsafe { Promise::new() },
                    });
                }
            });
        });
    }
}

criterion_group! { name = benches; config = support::short(); targets = texture }
criterion_main!(benches);
