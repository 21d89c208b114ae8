//! Stage `generate`: camera rays. The reconstruction filter and the lens are sampled by importance.

use crate::isa::{Isa, Kernel};
use crate::lanes::{Mask, Real, Uint};
use crate::math::{Vec3, uniform_disk};
use crate::queue::{PathQueue, SAMPLE_BITS, SlotTable, place};
use crate::sampler::{Sampler, Stream, dimension, stream_seed};
use crate::scene::lights::SkyMapping;
use crate::scene::{Camera, FilterAxis, Projection};
use crate::sphere_maps::{equal_area_to_sphere, lat_long_to_sphere};
use core::marker::PhantomData;
use core::ops::Range;
use std::sync::Arc;

/// Side of a block of pixels, the unit of work and of the film.
pub const BLOCK_SIDE: usize = 16;
/// Pixels of a whole block.
pub const BLOCK_PIXELS: usize = BLOCK_SIDE * BLOCK_SIDE;

/// A camera ray.
#[derive(Clone, Copy)]
pub struct CameraRay<F: Real> {
    /// Where it starts.
    pub origin: Vec3<F>,
    /// Unit direction.
    pub direction: Vec3<F>,
    /// 1, or -1 in the negative lobes of the filter.
    pub weight: F,
}

/// The camera ray of a sample of pixel (`x`, `y`).
#[inline(always)]
pub fn camera_ray<F: Real, S: Sampler>(
    camera: &Camera,
    stream: Stream<F::Uint>,
    x: F::Uint,
    y: F::Uint,
) -> CameraRay<F> {
    let [u, v] = S::two::<F>(stream, F::Uint::splat(dimension::FILTER));
    let [horizontal, vertical] = camera.filter().axes();
    let (dx, dy) = (horizontal.sample(u), vertical.sample(v));
    let half = F::lit(0.5);
    let raster_x = F::from_uint(x) + (half + dx);
    let raster_y = F::from_uint(y) + (half + dy);
    let through = Vec3::<F>::splat(camera.down())
        .mul_add(raster_y, Vec3::splat(camera.right()).mul_add(raster_x, Vec3::splat(camera.corner())));
    let mut origin = Vec3::splat(camera.origin());
    let mut direction = through;
    match camera.projection() {
        Projection::Perspective => {}
        Projection::Orthographic { axis } => {
            origin = origin + through;
            direction = Vec3::splat(*axis);
        }
        Projection::Sphere { mapping, axes, pixel, .. } => {
            let place = [raster_x * F::splat(pixel[0]), raster_y * F::splat(pixel[1])];
            let d = match mapping {
                SkyMapping::EqualArea => equal_area_to_sphere(inside_square(place)),
                SkyMapping::LatLong => lat_long_to_sphere(inside_rectangle(place)),
            };
            let [x, y, z] = axes;
            direction =
                Vec3::splat(*x).mul_add(d.x, Vec3::splat(*y).mul_add(d.y, Vec3::splat(*z).scale(d.z)));
        }
    }
    if let Some(lens) = camera.lens() {
        let (lx, ly) = uniform_disk(S::two::<F>(stream, F::Uint::splat(dimension::LENS)));
        let on_lens = Vec3::<F>::splat(lens.x).scale(lx) + Vec3::splat(lens.y).scale(ly);
        origin = origin + on_lens;
        direction = through.scale(F::splat(lens.focal_distance)) - on_lens;
    }
    let weight = if camera.filter().has_negative_lobes() {
        let sign = |offset: F, axis: &FilterAxis| {
            F::select(offset.abs().gt(F::splat(axis.negative_beyond())), F::lit(-1.0), F::one())
        };
        sign(dx, horizontal) * sign(dy, vertical)
    } else {
        F::one()
    };
    CameraRay { origin, direction: direction.normalize(), weight }
}

/// The point of the octahedron's square where one beyond its edge lies, by less than its side: edges are folded at their
/// middle.
#[inline(always)]
fn inside_square<F: Real>([u, v]: [F; 2]) -> [F; 2] {
    let (one, two) = (F::one(), F::lit(2.0));
    let (left, right) = (u.lt(F::zero()), u.gt(one));
    let v = F::select(left | right, one - v, v);
    let u = F::select(left, -u, F::select(right, two - u, u));
    let (above, below) = (v.lt(F::zero()), v.gt(one));
    let u = F::select(above | below, one - u, u);
    let v = F::select(above, -v, F::select(below, two - v, v));
    [u, v]
}

/// The same for azimuth and angle to +z: the azimuth goes around, beyond a pole is the other side.
#[inline(always)]
fn inside_rectangle<F: Real>([u, v]: [F; 2]) -> [F; 2] {
    let (one, two, half) = (F::one(), F::lit(2.0), F::lit(0.5));
    let (above, below) = (v.lt(F::zero()), v.gt(one));
    let u = F::select(above | below, u + half, u);
    let v = F::select(above, -v, F::select(below, two - v, v));
    let u = F::select(u.lt(F::zero()), u + one, u);
    let u = F::select(u.ge(one), u - one, u);
    [u, v]
}

/// A block of pixels, perhaps cut off by the edge of the image.
#[derive(Clone, Debug)]
pub struct PixelBlock {
    /// First pixel of the block in the full image.
    pub x: u32,
    /// See `x`.
    pub y: u32,
    /// Blocks of the same shape share them.
    columns: Arc<[u32]>,
    rows: Arc<[u32]>,
}

impl PixelBlock {
    /// A block of `width` times `height` pixels, each at most [`BLOCK_SIDE`], in Morton order: neighbours in the
    /// queue are squares of the image, whose rays stay together.
    pub fn new(x: u32, y: u32, width: usize, height: usize) -> Self {
        assert!((1..=BLOCK_SIDE).contains(&width) && (1..=BLOCK_SIDE).contains(&height));
        PixelBlock::part(x, y, 0..width as u32, 0..height as u32)
    }
    /// Some columns and rows of a block, in Morton order. Those beyond [`BLOCK_SIDE`] do not exist.
    pub fn part(x: u32, y: u32, columns: Range<u32>, rows: Range<u32>) -> Self {
        let even_bits = |m: usize| (0..4).fold(0, |n, k| n | (m >> (2 * k) & 1) << k) as u32;
        let morton = (0..BLOCK_PIXELS).map(|m| (even_bits(m), even_bits(m >> 1)));
        let inside: Vec<_> = morton.filter(|(c, r)| columns.contains(c) && rows.contains(r)).collect();
        PixelBlock {
            x,
            y,
            columns: inside.iter().map(|&(c, _)| c).collect(),
            rows: inside.iter().map(|&(_, r)| r).collect(),
        }
    }
    /// The same pixels of another block.
    pub fn moved_to(&self, x: u32, y: u32) -> Self {
        PixelBlock { x, y, ..self.clone() }
    }
    /// How many pixels.
    pub fn pixels(&self) -> usize {
        self.columns.len()
    }
    /// Column of each pixel in the order of generation.
    #[inline(always)]
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }
    /// Row of each pixel in the order of generation.
    #[inline(always)]
    pub fn rows(&self) -> &[u32] {
        &self.rows
    }
}

/// Which paths to start: those from number `first` on, of all samples of a work unit.
///
/// Path `p` is sample `p % samples` of pixel `p / samples`: neighbours, which go through the tree together, come from one
/// pixel or from a few that lie next to each other.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// The pixels.
    pub block: &'a PixelBlock,
    /// Width of the full image: pixels are numbered across it.
    pub image_width: u32,
    /// Seed of the render.
    pub seed: u64,
    /// Replicate.
    pub replicate: u32,
    /// Index within the replicate of the first sample.
    pub first_sample: u32,
    /// Samples of each pixel.
    pub samples: u32,
    /// First path.
    pub first: usize,
    /// Number of the work unit, kept with each path.
    pub unit: u32,
}

/// The kernel: starts one path for each of `free`.
///
/// Panics if the unit has fewer paths, more than 16 samples a pixel or none, or if a queue is too small.
pub struct Generate<'a, S> {
    /// Camera.
    pub camera: &'a Camera,
    /// Which paths.
    pub batch: Batch<'a>,
    /// Slots to use.
    pub free: &'a [u32],
    /// Paths are appended.
    pub paths: &'a mut PathQueue,
    /// Slots are set up.
    pub slots: &'a mut SlotTable,
    /// Random numbers.
    pub sampler: PhantomData<S>,
}

impl<S: Sampler> Kernel for Generate<'_, S> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) {
        generate::<I::Wide, S>(self.camera, &self.batch, self.free, self.paths, self.slots);
    }
}

#[inline(always)]
fn generate<F: Real, S: Sampler>(
    camera: &Camera,
    batch: &Batch,
    free: &[u32],
    paths: &mut PathQueue,
    slots: &mut SlotTable,
) {
    static NUMBERS: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
    let samples = batch.samples as usize;
    // What the multiplication below is exact for.
    assert!((1..=1 << SAMPLE_BITS).contains(&samples), "{samples} samples of a pixel");
    assert!((batch.first + free.len()).div_ceil(samples) <= batch.block.pixels(), "more paths than samples");
    // `k / samples` for the `k` that occur, as a multiplication: rounded up, it is exact up to 2^16 / samples.
    let per_sample = F::Uint::splat((1u32 << 16).div_ceil(batch.samples));
    let weights = !slots.filter_weight.is_empty();
    let scales = !slots.eta_scale.is_empty();
    let mut done = 0;
    while done < free.len() {
        let path = batch.first + done;
        let count = (free.len() - done).min(F::LANES);
        // Samples of the first lane's pixel and on into those of the next.
        let offset = F::Uint::load(&NUMBERS, 0) + F::Uint::splat((path % samples) as u32);
        let turn = (offset * per_sample).shr::<16>();
        let pixel = F::Uint::splat((path / samples) as u32) + turn;
        let sample = offset - turn * F::Uint::splat(batch.samples);
        let active = F::Mask::first(count);
        // SAFETY: pixels of the block, which has as many columns as rows; other lanes take the first one.
        let (x, y) = unsafe {
            let pixel = F::Uint::select(active, pixel, F::Uint::splat(0));
            (F::Uint::gather(&batch.block.columns, pixel), F::Uint::gather(&batch.block.rows, pixel))
        };
        let (x, y) = (x + F::Uint::splat(batch.block.x), y + F::Uint::splat(batch.block.y));
        let number = y * F::Uint::splat(batch.image_width) + x;
        let stream = Stream {
            seed: stream_seed(batch.seed, number, batch.replicate),
            index: F::Uint::splat(batch.first_sample) + sample,
        };
        let ray = camera_ray::<F, S>(camera, stream, x, y);

        let to = paths.len;
        ray.origin.x.store(&mut paths.origin_x, to);
        ray.origin.y.store(&mut paths.origin_y, to);
        ray.origin.z.store(&mut paths.origin_z, to);
        ray.direction.x.store(&mut paths.direction_x, to);
        ray.direction.y.store(&mut paths.direction_y, to);
        ray.direction.z.store(&mut paths.direction_z, to);
        F::one().store(&mut paths.throughput_r, to);
        F::one().store(&mut paths.throughput_g, to);
        F::one().store(&mut paths.throughput_b, to);
        if !paths.pdf.is_empty() {
            F::zero().store(&mut paths.pdf, to);
        }
        let (seed, weight) = (stream.seed.to_array(), ray.weight.to_array());
        let (pixel, sample) = (pixel.to_array(), sample.to_array());
        debug_assert_eq!(active.count(), count);
        for lane in 0..count {
            let slot = free[done + lane];
            paths.slot_depth[to + lane] = slot;
            let slot = slot as usize;
            slots.seed[slot] = seed[lane];
            slots.place[slot] = place(batch.unit, sample[lane], pixel[lane]);
            slots.radiance_r[slot] = 0.0;
            slots.radiance_g[slot] = 0.0;
            slots.radiance_b[slot] = 0.0;
            if scales {
                slots.eta_scale[slot] = 1.0;
            }
            if weights {
                slots.filter_weight[slot] = weight[lane];
            }
        }
        paths.len = to + count;
        done += count;
    }
}
