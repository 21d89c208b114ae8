//! Building the wide tree: triangles a second, for n and 4n of them. The time of one grows by the logarithm of their number
//! and no faster, whatever their arrangement: regular rows and stacks, which real scenes have, are the worst for many
//! builders.

mod support;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::scene::{Geometry, GeometryParts};

/// How triangles are arranged: the corners of the `i`th of `n`.
type Arrangement = fn(usize, usize) -> [[f32; 3]; 3];

const ARRANGEMENTS: [(&str, Arrangement); 6] = [
    ("row", |i, _| corner([i as f32, 0.0, 0.0], 1.0)),
    ("stack", |i, _| corner([0.0, 0.0, i as f32], 100.0)),
    ("concentric", |i, _| corner([-(i as f32); 3], 2.0 * i as f32)),
    ("identical", |_, _| corner([0.0; 3], 1.0)),
    ("grid", |i, n| {
        let side = n.isqrt();
        corner([(i % side) as f32, (i / side) as f32, 0.0], 1.0)
    }),
    ("soup", |i, n| {
        // The R3 sequence of Roberts (2018): even, in no order.
        let place = [0.819_172_5, 0.671_043_6, 0.549_700_5].map(|a: f64| (i as f64 * a).fract() as f32);
        corner(place, 2.0 / (n as f32).cbrt())
    }),
];

fn corner([x, y, z]: [f32; 3], size: f32) -> [[f32; 3]; 3] {
    [[x, y, z], [x + size, y, z], [x, y + size, z + 0.5 * size]]
}

fn setup(c: &mut Criterion) {
    for (name, arrangement) in ARRANGEMENTS {
        let mut group = c.benchmark_group(format!("setup/{name}"));
        for n in [25_000, 100_000] {
            let geometry = {
                let vertices: Vec<_> = (0..n).flat_map(|i| arrangement(i, n)).collect();
                Geometry::new(GeometryParts {
                    vertices,
                    triangles: (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
                    planes: vec![[0.0, 0.0, 1.0, 0.0]; n],
                    tags: vec![0; n],
                    ..GeometryParts::default()
                })
                .expect("triangles")
            };
            group.throughput(Throughput::Elements(n as u64));
            group.bench_function(BenchmarkId::from_parameter(n), |b| b.iter(|| Bvh8::new(&geometry)));
        }
    }
}

criterion_group! { name = benches; config = support::short(); targets = setup }
criterion_main!(benches);
