//! Whole renders on one thread: pixel samples a second of every engine, in a Cornell box and by a mesh of 80 thousand
//! triangles. Reading the scene and building the tree are not measured.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use support::{Lamp, Loaded};
use wavepath::engine::schedule::Stop;
use wavepath::engine::wavefront::DEFAULT_BATCH;
use wavepath::engine::{self, EngineKind, Settings, Tree};
use wavepath::scene::SamplerKind;
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

const SPP: u32 = 16;

fn render(c: &mut Criterion) {
    for loaded in [Loaded::shipped("cornell"), Loaded::knot(Lamp::Ball)].map(|loaded| loaded.sized(96, 96)) {
        let mut group = c.benchmark_group(format!("render/{}", loaded.name));
        group.throughput(Throughput::Elements(loaded.film().pixels() * SPP as u64));
        for (name, engine) in [
            ("wavefront", EngineKind::Wavefront),
            ("megakernel", EngineKind::Megakernel),
            ("megakernel-wide", EngineKind::MegakernelWide),
        ] {
            let tree = Tree::build(engine, &loaded.scene);
            let settings = Settings {
                engine,
                sampler: SamplerKind::Sobol,
                threads: 1,
                seed: 1,
                batch: DEFAULT_BATCH,
                level: Level::detect(),
                policy: Policy::Auto,
                adaptive: false,
            };
            group.bench_function(name, |b| {
                b.iter_custom(|times| {
                    let one = || {
                        let film = loaded.film();
                        let stop = Stop { spp: Some(SPP), time: None, interrupted: Default::default() };
                        let watch = |_: &_| {};
                        engine::render(&loaded.scene, &loaded.plan, &tree, &film, &settings, stop, watch)
                            .expect("a thread")
                            .1
                    };
                    (0..times).map(|_| one()).sum::<Duration>()
                });
            });
        }
    }
}

criterion_group! { name = benches; config = support::short(); targets = render }
criterion_main!(benches);
