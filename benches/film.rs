//! The film: samples a second into the sums of a work unit, pixels a second from there into the film, and from the film
//! to the picture.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use support::Loaded;
use wavepath::engine::schedule::Unit;
use wavepath_kernels::generate::BLOCK_PIXELS;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::queue::unit_and_pixel;

fn film(c: &mut Criterion) {
    let loaded = Loaded::shipped("cornell");
    let film = loaded.film();
    let [_, (_, round)] = loaded.first_and_deep(&Bvh8::new(loaded.scene.geometry()));
    let slots = &round.lit_slots;
    let mut sums = film.sums();
    let mut group = c.benchmark_group("film");
    group.throughput(Throughput::Elements(round.finished.len() as u64));
    group.bench_function("samples", |b| {
        b.iter(|| {
            for &slot in &round.finished {
                let slot = slot as usize;
                let (_, pixel) = unit_and_pixel(slots.place[slot]);
                let radiance = [slots.radiance_r[slot], slots.radiance_g[slot], slots.radiance_b[slot]];
                sums.add(pixel, radiance, None);
            }
        });
    });
    group.throughput(Throughput::Elements(BLOCK_PIXELS as u64));
    // Always new samples, of a film whose sums have got as wide as they do in a long render.
    let mut first = 0;
    group.bench_function("blocks", |b| {
        b.iter(|| {
            film.add(Unit { block: 0, replicate: 0, first, samples: 1 }, &sums).expect("new samples");
            first += 1;
        })
    });
    group.throughput(Throughput::Elements(film.pixels()));
    group.bench_function("develop", |b| b.iter(|| film.develop()));
}

criterion_group! { name = benches; config = support::short(); targets = film }
criterion_main!(benches);
