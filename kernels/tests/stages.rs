//! Stages as free functions over queues: paths in, paths out, none lost and none twice.

mod statistics;

use core::marker::PhantomData;
use statistics::{Mean, Random};
use std::collections::HashSet;
use wavepath_kernels::generate::{Batch, Generate, PixelBlock};
use wavepath_kernels::isa::{Level, Promise};
use wavepath_kernels::material_sort::{EMITS, LISTS, MaterialSort, list};
use wavepath_kernels::queue::{
    HitQueue, OrderLists, PathQueue, Requirements, SLOT_BITS, SlotTable, place, unit_and_pixel,
};
use wavepath_kernels::roulette_compact::{FIRST_ROULETTE, RouletteCompact};
use wavepath_kernels::sampler::{Sobol, stream_seed};
use wavepath_kernels::scene::{
    Camera, CameraParts, Filter, FilterAxis, MISS, MaterialClass, MaterialHandle, PrimitiveTag,
};

fn all() -> Requirements {
    Requirements {
        transmission: true,
        smooth_normals: true,
        light_sampling: true,
        filter_weights: true,
        mixtures: false,
        instances: true,
        ..Requirements::default()
    }
}

#[test]
fn material_sort_is_a_stable_partition() {
    let mut random = Random::new(1);
    let tags: Vec<u32> = MaterialClass::ALL
        .iter()
        .flat_map(|&class| {
            let material = MaterialHandle { class, row: 5 };
            [PrimitiveTag::material(material).0, PrimitiveTag::light(class, 3).0]
        })
        .collect();
    for n in [0, 1, 7, 16, 17, 1000, 4096] {
        let max_depth = 5;
        let (mut paths, mut hits) = (PathQueue::new(4096, all()), HitQueue::new(4096, all()));
        (paths.len, hits.len) = (n, n);
        for i in 0..n {
            hits.primitive[i] = if random.below(9) == 0 { MISS } else { random.below(tags.len()) as u32 };
            paths.slot_depth[i] = (random.below(7) as u32) << SLOT_BITS | i as u32;
        }
        for level in Level::available() {
            let mut order = OrderLists::new(4096, all());
            let free = (4096 - n).min(3);
            order.list[..free].fill(u32::MAX);
            let (paths, hits, order) = (&paths, &hits, &mut order);
            let sorted = level.run(MaterialSort { tags: &tags, max_depth, paths, hits, order, free });
            assert_eq!((sorted.starts[0], sorted.starts[LISTS]), (free, free + n));
            assert!(order.list[..free].iter().all(|&s| s == u32::MAX), "free slots stay");
            let mut seen = vec![false; n];
            for k in 0..LISTS {
                let places = &order.list[sorted.range(k)];
                assert!(places.is_sorted_by(|a, b| a < b), "list {k} keeps the order");
                for &place in places {
                    let i = place as usize;
                    assert!(!std::mem::replace(&mut seen[i], true), "place {i} twice");
                    let (primitive, depth) = (hits.primitive[i], paths.slot_depth[i] >> SLOT_BITS);
                    let want = if primitive == MISS {
                        list::MISSED
                    } else {
                        let class =
                            MaterialClass::ALL[PrimitiveTag(tags[primitive as usize]).class() as usize];
                        if depth >= max_depth || class == MaterialClass::Absorber {
                            list::ENDED
                        } else {
                            list::of(class)
                        }
                    };
                    assert_eq!(k, want);
                }
            }
            assert!(seen.iter().all(|&s| s));
            for i in 0..n {
                let primitive = hits.primitive[i];
                let emits = primitive != MISS && PrimitiveTag(tags[primitive as usize]).emits();
                assert_eq!(order.key[i] & EMITS != 0, emits);
            }
            let emitting = order.key[..n].iter().filter(|&&k| k & EMITS != 0).count();
            assert_eq!(sorted.emitting, emitting);
        }
    }
}

/// Paths with random throughputs in random slots; `dead` of a hundred have ended.
fn paths_to_play(random: &mut Random, n: usize, capacity: usize, dead: usize) -> (PathQueue, SlotTable) {
    let (mut paths, mut slots) = (PathQueue::new(capacity, all()), SlotTable::new(capacity, all()));
    let mut free: Vec<u32> = (0..capacity as u32).collect();
    for i in 0..n {
        let slot = free.swap_remove(random.below(free.len()));
        let depth = random.below(6) as u32 + 1;
        let scale = if random.below(100) < dead { 0.0 } else { random.magnitude(1e-3, 2.0) as f32 };
        paths.slot_depth[i] = depth << SLOT_BITS | slot;
        paths.throughput_r[i] = scale;
        paths.throughput_g[i] = scale * random.unit() as f32;
        paths.throughput_b[i] = scale * random.unit() as f32;
        slots.eta_scale[slot as usize] = [1.0, 2.25, 1.0 / 2.25][random.below(3)];
        for column in [&mut paths.origin_x, &mut paths.origin_y, &mut paths.origin_z] {
            column[i] = slot as f32;
        }
        for column in [&mut paths.direction_x, &mut paths.direction_y, &mut paths.direction_z, &mut paths.pdf]
        {
            column[i] = slot as f32 + 0.5;
        }
        slots.seed[slot as usize] = random.bits() as u32;
        slots.place[slot as usize] = place(0, random.below(16) as u32, 0);
    }
    paths.len = n;
    (paths, slots)
}

#[test]
fn roulette_packs_the_survivors_and_accounts_for_all_slots() {
    let mut random = Random::new(2);
    let capacity = 1500;
    for n in [0, 1, 5, 15, 16, 17, 100, 1499, 1500] {
        for dead in [0, 30, 100] {
            let (before, slots) = paths_to_play(&mut random, n, capacity, dead);
            let mut first = None;
            for level in Level::available() {
                let (mut paths, mut slots) = (before.clone(), slots.clone());
                let mut order = OrderLists::new(capacity, all());
                let already = capacity - n;
                order.list[..already].fill(u32::MAX);
                let finished = level.run(RouletteCompact::<Sobol> {
                    paths: &mut paths,
                    slots: &mut slots,
                    first_sample: &[7],
                    order: &mut order,
                    free: already,
                    sampler: PhantomData,
                    // SAFETY: slots are below the capacity, and name unit 0.
                    promise: unsafe { Promise::new() },
                });
                assert!(order.list[..already].iter().all(|&s| s == u32::MAX), "earlier entries stay");
                let slot_mask = (1 << SLOT_BITS) - 1;
                let dead: HashSet<u32> =
                    order.list[already..finished].iter().map(|s| s & slot_mask).collect();
                let alive: Vec<u32> = paths.slot_depth[..paths.len].iter().map(|s| s & slot_mask).collect();
                assert_eq!((dead.len(), dead.len() + alive.len()), (finished - already, n));
                let slot_of = |i: usize| (before.slot_depth[i] & slot_mask) as usize;
                // The order of those that live is kept, and each keeps its columns.
                let want: Vec<usize> =
                    (0..n).filter(|&i| !dead.contains(&(before.slot_depth[i] & slot_mask))).collect();
                assert_eq!(want.len(), paths.len);
                for (to, &from) in want.iter().enumerate() {
                    assert_eq!(paths.slot_depth[to], before.slot_depth[from]);
                    let columns = |p: &PathQueue, i: usize| {
                        [
                            p.origin_x[i],
                            p.origin_y[i],
                            p.origin_z[i],
                            p.direction_x[i],
                            p.direction_y[i],
                            p.direction_z[i],
                            p.pdf[i],
                        ]
                    };
                    assert_eq!(columns(&paths, to), columns(&before, from));
                    let q = if before.slot_depth[from] >> SLOT_BITS < FIRST_ROULETTE {
                        1.0
                    } else {
                        (before.throughput_r[from] * slots.eta_scale[slot_of(from)]).sqrt().min(1.0)
                    };
                    let want = before.throughput_r[from] * (1.0 / q);
                    assert!((paths.throughput_r[to] / want - 1.0).abs() < 1e-6);
                }
                for i in 0..n {
                    let early = before.slot_depth[i] >> SLOT_BITS < FIRST_ROULETTE;
                    let lives = !dead.contains(&(before.slot_depth[i] & slot_mask));
                    if before.throughput_r[i] == 0.0 {
                        assert!(!lives, "without throughput");
                    } else if early || before.throughput_r[i] * slots.eta_scale[slot_of(i)] >= 1.0 {
                        assert!(lives, "not played for");
                    }
                }
                // All instruction sets: the same survivors.
                assert_eq!(*first.get_or_insert_with(|| alive.clone()), alive, "{}", level.name());
            }
        }
    }
}

#[test]
fn roulette_keeps_the_expectation() {
    let mut random = Random::new(3);
    let n = 4096;
    let (mut before, mut after, mut lived) = (Mean::default(), [Mean::default(); 3], Mean::default());
    for _ in 0..40 {
        let (mut paths, mut slots) = paths_to_play(&mut random, n, n, 5);
        // One throughput for all, so that the mean after is to be compared with a number.
        for (column, value) in
            [(&mut paths.throughput_r, 0.3), (&mut paths.throughput_g, 0.2), (&mut paths.throughput_b, 0.01)]
        {
            column[..n].fill(value);
        }
        paths.slot_depth[..n].iter_mut().for_each(|s| *s = *s & ((1 << SLOT_BITS) - 1) | 3 << SLOT_BITS);
        slots.eta_scale[..n].fill(1.0);
        before.add(0.3);
        let mut order = OrderLists::new(n, all());
        Level::detect().run(RouletteCompact::<Sobol> {
            paths: &mut paths,
            slots: &mut slots,
            first_sample: &[7],
            order: &mut order,
            free: 0,
            sampler: PhantomData,
            // SAFETY: slots are below the capacity, and name unit 0.
            promise: unsafe { Promise::new() },
        });
        lived.add(paths.len as f64 / n as f64);
        for (mean, column) in
            after.iter_mut().zip([&paths.throughput_r, &paths.throughput_g, &paths.throughput_b])
        {
            mean.add(column[..paths.len].iter().map(|&x| x as f64).sum::<f64>() / n as f64);
        }
    }
    lived.assert_near("survivors", 0.3f64.sqrt(), 1e-6);
    for (mean, want) in after.iter().zip([0.3, 0.2, 0.01]) {
        mean.assert_near("throughput", want, 1e-6);
    }
}

#[test]
fn throughput_that_is_not_finite_ends_and_is_made_known() {
    for (r, g, b) in [
        (f32::NAN, 1.0, 1.0),
        (1.0, f32::INFINITY, 1.0),
        (1.0, 1.0, f32::NAN),
        (f32::INFINITY, 0.0, f32::NAN),
    ] {
        for level in Level::available() {
            let mut random = Random::new(4);
            let (mut paths, mut slots) = paths_to_play(&mut random, 20, 20, 0);
            // Early paths, which all live otherwise.
            paths.slot_depth[..20].iter_mut().for_each(|s| *s = *s & ((1 << SLOT_BITS) - 1) | 1 << SLOT_BITS);
            (paths.throughput_r[13], paths.throughput_g[13], paths.throughput_b[13]) = (r, g, b);
            let slot = paths.slot_depth[13] & ((1 << SLOT_BITS) - 1);
            let mut order = OrderLists::new(20, all());
            let finished = level.run(RouletteCompact::<Sobol> {
                paths: &mut paths,
                slots: &mut slots,
                first_sample: &[7],
                order: &mut order,
                free: 0,
                sampler: PhantomData,
                // SAFETY: slots are below the capacity, and name unit 0.
                promise: unsafe { Promise::new() },
            });
            assert_eq!((finished, paths.len, order.list[0]), (1, 19, slot));
            for s in 0..20 {
                assert_eq!(!slots.radiance_r[s].is_finite(), s == slot as usize);
            }
        }
    }
}

#[test]
fn generate_starts_every_sample_of_every_pixel_once() {
    let axis = || FilterAxis::constant(0.5);
    let camera = Camera::new(CameraParts {
        origin: [1.0, 2.0, 3.0],
        corner: [-1.0, 1.0, 1.0],
        right: [0.01, 0.0, 0.0],
        down: [0.0, -0.01, 0.0],
        lens: None,
        filter: Filter::new([axis(), axis()]).unwrap(),
    })
    .unwrap();
    for (width, height) in [(16, 16), (1, 1), (1, 16), (16, 3), (7, 5), (13, 16), (3, 1), (6, 2)] {
        for samples in [1, 2, 3, 4, 12, 16] {
            let first_sample = [40; 78];
            for level in Level::available() {
                let block = PixelBlock::new(32, 48, width, height);
                assert_eq!(block.pixels(), width * height);
                let total = samples * block.pixels();
                let (mut paths, mut slots) = (PathQueue::new(1024, all()), SlotTable::new(1024, all()));
                let mut seen = HashSet::new();
                let (mut first, mut round) = (0, 0);
                while first < total {
                    // Odd numbers of free slots, from the far end.
                    let count = (total - first).min(5 + 37 * round);
                    let free: Vec<u32> = (0..count as u32).map(|i| 1023 - i).collect();
                    paths.len = 0;
                    let batch = Batch {
                        block: &block,
                        image_width: 100,
                        seed: 9,
                        replicate: 2,
                        first_sample: 40,
                        samples: samples as u32,
                        first,
                        unit: 77,
                    };
                    level.run(Generate::<Sobol> {
                        camera: &camera,
                        batch,
                        free: &free,
                        paths: &mut paths,
                        slots: &mut slots,
                        sampler: PhantomData,
                    });
                    assert_eq!(paths.len, count);
                    for (i, &slot) in free.iter().enumerate() {
                        assert_eq!(paths.slot_depth[i], slot, "the slot, at depth 0");
                        let s = slot as usize;
                        let (unit, pixel) = unit_and_pixel(slots.place[s]);
                        assert_eq!(unit, 77);
                        // SAFETY: the slot is in the table, and its unit has a first sample.
                        let stream = unsafe { slots.stream(&first_sample, core::num::Wrapping(slot)) };
                        assert!(seen.insert((pixel, stream.index.0)), "pixel {pixel} twice");
                        let (x, y) = (32 + block.columns()[pixel], 48 + block.rows()[pixel]);
                        let seed = stream_seed(9, core::num::Wrapping(y * 100 + x), 2).0;
                        assert_eq!(slots.seed[s], seed);
                        assert_eq!([slots.radiance_r[s], slots.radiance_g[s], slots.radiance_b[s]], [0.0; 3]);
                        assert_eq!(
                            [paths.throughput_r[i], paths.throughput_g[i], paths.throughput_b[i]],
                            [1.0; 3]
                        );
                        assert_eq!(
                            (paths.pdf[i], slots.eta_scale[s], slots.filter_weight[s]),
                            (0.0, 1.0, 1.0)
                        );
                        assert_eq!(
                            [paths.origin_x[i], paths.origin_y[i], paths.origin_z[i]],
                            [1.0, 2.0, 3.0]
                        );
                        // Within its pixel.
                        let (dx, dy) = (
                            paths.direction_x[i] / paths.direction_z[i],
                            paths.direction_y[i] / paths.direction_z[i],
                        );
                        let (rx, ry) = ((dx + 1.0) * 100.0 - x as f32, (1.0 - dy) * 100.0 - y as f32);
                        assert!((-1e-3..1.001).contains(&rx) && (-1e-3..1.001).contains(&ry), "{rx} {ry}");
                    }
                    first += count;
                    round += 1;
                }
                let want = (0..block.pixels()).flat_map(|p| (40..40 + samples as u32).map(move |s| (p, s)));
                assert_eq!(seen, want.collect());
                let places: HashSet<_> = block.columns().iter().zip(block.rows()).collect();
                assert_eq!(places.len(), width * height);
            }
        }
    }
}
