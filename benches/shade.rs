//! Stage `shade`: paths a second, one bench for each class of materials, for emitting surfaces and for the sky.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::marker::PhantomData;
use support::{Lamp, Loaded, NoLamps, SphericalLamps, measure};
use wavepath::engine::wavefront::record::Round;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::isa::{Level, Promise};
use wavepath_kernels::material_sort::list;
use wavepath_kernels::queue::{PathQueue, SHADOW_RAYS, ShadowQueue};
use wavepath_kernels::scene::lights::Spheres;
use wavepath_kernels::shade::emission::Emission;
use wavepath_kernels::shade::environment::Environment;
use wavepath_kernels::shade::materials::{
    Conductor, Dielectric, DiffuseTransmission, Lambert, Material, OrenNayar, RoughConductor, ThinDielectric,
};
use wavepath_kernels::shade::{Features, Shade};

/// Scatters the paths of a class: all of the first round, those that have bounced of a later one.
fn scatter<M: Material, P: Features>(c: &mut Criterion, loaded: &Loaded) {
    let class = M::CLASS;
    let level = Level::detect();
    let requirements = loaded.plan.requirements();
    let mut group = c.benchmark_group(format!("shade/{}/{}", class.name(), loaded.name));
    for (when, round) in loaded.first_and_deep(&Bvh8::new(loaded.scene.geometry())) {
        let all = round.list(class);
        let bounced = all.partition_point(|&place| (place as usize) < round.survivors);
        let list = if when == "first" { all } else { &all[..bounced] };
        if list.is_empty() {
            continue;
        }
        let mut state = (
            round.slots.clone(),
            PathQueue::new(round.paths.capacity(), requirements),
            ShadowQueue::new(SHADOW_RAYS, requirements),
        );
        group.throughput(Throughput::Elements(list.len() as u64));
        group.bench_function(when, |b| {
            measure(
                b,
                &mut state,
                // Glass multiplies what is there.
                |(slots, scattered, _)| {
                    slots.eta_scale.copy_from_slice(&round.slots.eta_scale);
                    scattered.len = 0;
                },
                |(slots, scattered, shadows)| {
                    for piece in list.chunks(SHADOW_RAYS) {
                        shadows.len = 0;
                        level.run(Shade::<M, P> {
                            scene: &loaded.scene,
                            list: piece,
                            paths: &round.paths,
                            hits: &round.hits,
                            textured: None,
                            slots,
                            first_sample: &round.first_sample,
                            scattered,
                            shadows,
                            kernel: PhantomData,
                            // SAFETY: a round of a render, each queue as the stage found it.
                            promise: unsafe { Promise::new() },
                        });
                    }
                },
            );
        });
    }
}

fn materials(c: &mut Criterion) {
    let (cornell, sponge) = (Loaded::shipped("cornell"), Loaded::menger(Lamp::Ball));
    let (still_life, metals) = (Loaded::shipped("wineglass"), Loaded::shipped("metals"));
    let panes = Loaded::shipped("glass-pane");
    let paper = Loaded::menger(Lamp::Ball).of_paper();
    scatter::<Lambert, SphericalLamps>(c, &cornell);
    scatter::<Lambert, SphericalLamps>(c, &sponge);
    scatter::<OrenNayar, SphericalLamps>(c, &still_life);
    scatter::<DiffuseTransmission, SphericalLamps>(c, &paper);
    scatter::<Conductor, NoLamps>(c, &metals);
    scatter::<RoughConductor, SphericalLamps>(c, &metals);
    scatter::<Dielectric, NoLamps>(c, &still_life);
    scatter::<ThinDielectric, NoLamps>(c, &panes);
}

/// The light that paths find by themselves, in a round in which they have bounced.
fn light_met(c: &mut Criterion) {
    let level = Level::detect();
    let loaded = Loaded::shipped("metals");
    let [_, (_, round)]: [(_, Round); 2] = loaded.first_and_deep(&Bvh8::new(loaded.scene.geometry()));
    // Radiance grows from run to run; nothing depends on it.
    let mut slots = round.slots.clone();
    let mut group = c.benchmark_group(format!("shade/{}", loaded.name));
    group.throughput(Throughput::Elements(round.sorted.emitting as u64));
    group.bench_function("emission", |b| {
        b.iter(|| {
            level.run(Emission::<Spheres> {
                scene: &loaded.scene,
                keys: &round.order.key[..round.paths.len],
                paths: &round.paths,
                hits: &round.hits,
                slots: &mut slots,
                lights: PhantomData,
                // SAFETY: a round of a render, each queue as the stage found it.
                promise: unsafe { Promise::new() },
            });
        });
    });
    let missed = &round.order.list[round.sorted.range(list::MISSED)];
    group.throughput(Throughput::Elements(missed.len() as u64));
    group.bench_function("environment", |b| {
        b.iter(|| {
            level.run(Environment {
                radiance: loaded.scene.environment(),
                list: missed,
                paths: &round.paths,
                slots: &mut slots,
                // SAFETY: a round of a render, each queue as the stage found it.
                promise: unsafe { Promise::new() },
            });
        });
    });
}

criterion_group! { name = benches; config = support::short(); targets = materials, light_met }
criterion_main!(benches);
