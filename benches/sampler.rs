//! Random numbers: points in the unit square a second, Owen-scrambled Sobol and independent, on every instruction set.

mod support;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::marker::PhantomData;
use wavepath_kernels::isa::{Isa, Kernel, Level};
use wavepath_kernels::lanes::{Real, Uint};
use wavepath_kernels::sampler::{Independent, Sampler, Sobol, Stream};

/// A point for each seed.
struct Draw<'a, S> {
    seeds: &'a [u32],
    x: &'a mut [f32],
    y: &'a mut [f32],
    sampler: PhantomData<S>,
}

impl<S: Sampler> Kernel for Draw<'_, S> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _: I) {
        type Lanes<I> = <<I as Isa>::Wide as Real>::Uint;
        for at in (0..self.seeds.len()).step_by(I::Wide::LANES) {
            let seed = Lanes::<I>::load(self.seeds, at);
            let stream = Stream { seed, index: Lanes::<I>::splat(at as u32) };
            let [x, y] = S::two::<I::Wide>(stream, Lanes::<I>::splat(7));
            x.store(self.x, at);
            y.store(self.y, at);
        }
    }
}

fn sampler(c: &mut Criterion) {
    const POINTS: usize = 4096;
    let seeds: Vec<u32> = (0..POINTS as u32).map(|k| k.wrapping_mul(0x9E37_79B9)).collect();
    let (mut x, mut y) = (vec![0.0; POINTS], vec![0.0; POINTS]);
    let one_lane = Level::one_lane();
    for level in Level::available().chain(one_lane) {
        let mut group = c.benchmark_group(format!("sampler/{}", level.name()));
        group.throughput(Throughput::Elements(POINTS as u64));
        macro_rules! bench {
            ($sampler:ident) => {
                group.bench_function($sampler::NAME, |b| {
                    b.iter(|| {
                        let (seeds, x, y) = (&seeds[..], &mut x[..], &mut y[..]);
                        level.run(Draw::<$sampler> { seeds, x, y, sampler: PhantomData });
                    });
                });
            };
        }
        bench!(Sobol);
        bench!(Independent);
    }
}

criterion_group! { name = benches; config = support::short(); targets = sampler }
criterion_main!(benches);
