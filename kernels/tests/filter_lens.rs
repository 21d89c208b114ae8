//! Camera rays: the reconstruction filter, the lens, the plane in focus, the pixel centres.

mod statistics;

use core::num::Wrapping;
use statistics::{Random, add, assert_distributed, cross, dot, length, narrow, normalize, scale, sub, wide};
use wavepath_kernels::generate::{CameraRay, camera_ray};
use wavepath_kernels::lanes::Uint;
use wavepath_kernels::sampler::{Independent, Sampler, Sobol, Stream};
use wavepath_kernels::scene::{Camera, CameraParts, Filter, FilterAxis, Lens};

const BINS: usize = 100;
const SAMPLES: usize = 200_000;

fn gaussian(radius: f64, sigma: f64) -> impl Fn(f64) -> f64 {
    let g = move |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
    move |x| (g(x) - g(radius)).max(0.0)
}

/// Mitchell and Netravali (1988), B = C = 1/3, scaled from [-2, 2] to [-radius, radius].
fn mitchell(radius: f64) -> impl Fn(f64) -> f64 {
    let (b, c) = (1.0 / 3.0, 1.0 / 3.0);
    move |x| {
        let x = (2.0 * x / radius).abs();
        let near =
            (12.0 - 9.0 * b - 6.0 * c) * x.powi(3) + (-18.0 + 12.0 * b + 6.0 * c) * x * x + 6.0 - 2.0 * b;
        let far = (-b - 6.0 * c) * x.powi(3) + (6.0 * b + 30.0 * c) * x * x - (12.0 * b + 48.0 * c) * x
            + 8.0 * b
            + 24.0 * c;
        (if x < 1.0 {
            near
        } else if x < 2.0 {
            far
        } else {
            0.0
        }) / 6.0
    }
}

/// Offsets of a table fall into bins as |f|, integrated by a fine midpoint rule, says; and the entries of the table
/// are the quantiles of |f|.
fn assert_filter(what: &str, axis: &FilterAxis, radius: f64, f: impl Fn(f64) -> f64) {
    const STEPS: usize = 1000;
    let width = 2.0 * radius / BINS as f64;
    let mass: Vec<f64> = (0..BINS)
        .map(|bin| {
            let at = |k: usize| -radius + width * (bin as f64 + (k as f64 + 0.5) / STEPS as f64);
            (0..STEPS).map(|k| f(at(k)).abs()).sum()
        })
        .collect();
    let total: f64 = mass.iter().sum();
    let expected: Vec<f64> = mass.iter().map(|m| m / total * SAMPLES as f64).collect();
    let mut observed = vec![0; BINS];
    let mut random = Random::new(1);
    for _ in 0..SAMPLES {
        let u = random.unit() as f32;
        let x = axis.sample(u) as f64;
        assert!(x.abs() <= radius * (1.0 + 1e-6), "{what}: {x}");
        // Where the filter crosses zero the inverse is steep.
        assert!((axis.sample(u as f64) - x).abs() < 1e-5 * radius, "{what}: precisions differ at {u}");
        observed[(((x + radius) / width) as usize).min(BINS - 1)] += 1;
        // The sign that goes with the sample is that of the filter.
        if (f(x).abs()) > 1e-6 {
            assert_eq!(x.abs() > axis.negative_beyond() as f64, f(x) < 0.0, "{what}: sign at {x}");
        }
    }
    assert_distributed(what, &observed, &expected, 8);
    // The cumulative distribution by Simpson's rule on a grid of its own.
    let fine = |x: f64| f(x).abs();
    let grid = 30_000;
    let h = 2.0 * radius / grid as f64;
    let (mut cells, mut sum) = (Vec::with_capacity(grid + 1), 0.0);
    cells.push(0.0);
    for k in 0..grid {
        let x = -radius + k as f64 * h;
        sum += (fine(x) + 4.0 * fine(x + 0.5 * h) + fine(x + h)) / 6.0;
        cells.push(sum);
    }
    let entries = axis.quantiles().len() - 1;
    for (k, &quantile) in axis.quantiles().iter().enumerate() {
        let at = ((quantile as f64 + radius) / h).clamp(0.0, grid as f64 - 1e-9);
        let cell = at as usize;
        let cumulative = (cells[cell] + (at - cell as f64) * (cells[cell + 1] - cells[cell])) / sum;
        let t = k as f64 / entries as f64;
        let want = match entries {
            1 => t,
            _ if t <= 0.5 => 2.0 * t * t,
            _ => 1.0 - 2.0 * (1.0 - t).powi(2),
        };
        assert!(
            (cumulative - want).abs() < 2e-6,
            "{what}: entry {k} at {quantile} is the quantile {cumulative}"
        );
    }
    // Symmetric, ascending, to both ends.
    assert!(axis.quantiles().is_sorted());
    let (first, last) = (axis.sample(0.0f32), axis.sample(1.0 - f32::EPSILON / 2.0));
    assert!(first == -radius as f32 && last <= radius as f32 && last > 0.3 * radius as f32);
}

#[test]
fn filters_are_sampled_as_they_are() {
    assert_filter("box", &FilterAxis::constant(0.5), 0.5, |_| 1.0);
    assert_filter("wide box", &FilterAxis::constant(1.7), 1.7, |_| 1.0);
    for radius in [1.0, 2.0] {
        let triangle = |x: f64| (radius - x.abs()).max(0.0);
        assert_filter("triangle", &FilterAxis::tabulate(radius, triangle), radius, triangle);
        let axis = FilterAxis::tabulate(radius, mitchell(radius));
        assert!(
            (axis.negative_beyond() as f64 - 0.5 * radius * 1.144).abs() < 0.05,
            "{}",
            axis.negative_beyond()
        );
        assert_filter("mitchell", &axis, radius, mitchell(radius));
    }
    for (radius, sigma) in [(1.5, 0.5), (3.0, 0.3)] {
        let axis = FilterAxis::tabulate(radius, gaussian(radius, sigma));
        assert_eq!(axis.negative_beyond(), f32::INFINITY);
        assert_filter("gaussian", &axis, radius, gaussian(radius, sigma));
    }
}

/// A sampler that says 1/2 always: the centre of filter and lens.
#[derive(Clone, Copy)]
struct Centre;
impl Sampler for Centre {
    const NAME: &'static str = "centre";
    fn bits<U: Uint>(_: Stream<U>, _: U) -> U {
        U::splat(1 << 31)
    }
    fn bits2<U: Uint>(_: Stream<U>, _: U) -> [U; 2] {
        [U::splat(1 << 31), U::splat(1 << 31)]
    }
}

/// Camera to world: axes right, up, forward; a raster of `size` pixels over the tangents `half`.
struct View {
    position: [f64; 3],
    axes: [[f64; 3]; 3],
    size: [f64; 2],
    half: [f64; 2],
}

impl View {
    fn new(position: [f64; 3], target: [f64; 3]) -> Self {
        let forward = normalize(sub(target, position));
        let right = normalize(cross([0.0, 1.0, 0.0], forward));
        let up = cross(forward, right);
        View {
            position,
            axes: [right, up, forward],
            size: [1920.0, 1080.0],
            half: [0.7, 0.7 * 1080.0 / 1920.0],
        }
    }
    fn world(&self, v: [f64; 3]) -> [f64; 3] {
        core::array::from_fn(|k| (0..3).map(|axis| self.axes[axis][k] * v[axis]).sum())
    }
    /// Direction through a raster position, on the plane z = 1 of the camera, in the world.
    fn through(&self, x: f64, y: f64) -> [f64; 3] {
        let (sx, sy) = (2.0 * x / self.size[0] - 1.0, 1.0 - 2.0 * y / self.size[1]);
        self.world([sx * self.half[0], sy * self.half[1], 1.0])
    }
    fn camera(&self, lens: Option<(f64, f64)>, filter: FilterAxis) -> Camera {
        let corner = self.through(0.0, 0.0);
        Camera::new(CameraParts {
            origin: narrow(self.position),
            corner: narrow(corner),
            right: narrow(sub(self.through(1.0, 0.0), corner)),
            down: narrow(sub(self.through(0.0, 1.0), corner)),
            lens: lens.map(|(radius, focal_distance)| Lens {
                x: narrow(scale(self.axes[0], radius)),
                y: narrow(scale(self.axes[1], radius)),
                focal_distance: focal_distance as f32,
            }),
            filter: Filter::new([filter.clone(), filter]).unwrap(),
        })
        .unwrap()
    }
}

fn stream(index: u32) -> Stream<Wrapping<u32>> {
    Stream { seed: Wrapping(0xBAD5EED), index: Wrapping(index) }
}

#[test]
fn rays_through_pixel_centres_are_right() {
    let mut random = Random::new(2);
    for _ in 0..200 {
        let view = View::new(random.point(50.0), random.point(5.0));
        let camera = view.camera(None, FilterAxis::constant(0.5));
        for _ in 0..50 {
            let (x, y) = (random.below(1920) as u32, random.below(1080) as u32);
            let ray: CameraRay<f32> = camera_ray::<f32, Centre>(&camera, stream(0), Wrapping(x), Wrapping(y));
            let want = normalize(view.through(x as f64 + 0.5, y as f64 + 0.5));
            let got = wide(ray.direction.lane(0));
            // A hundredth of a pixel: 1.4 / 1920 wide.
            assert!(length(sub(got, want)) < 7e-6, "pixel {x} {y}: {got:?}, not {want:?}");
            assert!((length(got) - 1.0).abs() < 3e-7);
            assert_eq!(ray.origin.lane(0), narrow(view.position));
            assert_eq!(ray.weight, 1.0);
        }
    }
}

#[test]
fn rays_of_a_pixel_meet_on_the_plane_in_focus() {
    let mut random = Random::new(3);
    for (radius, focal) in [(0.1, 5.0), (0.5, 2.0), (1e-3, 100.0)] {
        let view = View::new(random.point(10.0), random.point(3.0));
        // A filter without extent, so that all rays go through the centre of the pixel.
        let camera = view.camera(Some((radius, focal)), FilterAxis::constant(0.0));
        for _ in 0..20 {
            let (x, y) = (random.below(1920) as u32, random.below(1080) as u32);
            let focus = add(view.position, scale(view.through(x as f64 + 0.5, y as f64 + 0.5), focal));
            for index in 0..200 {
                let ray = camera_ray::<f32, Sobol>(&camera, stream(index), Wrapping(x), Wrapping(y));
                let (o, d) = (wide(ray.origin.lane(0)), wide(ray.direction.lane(0)));
                let t = dot(sub(focus, o), d);
                let off = length(sub(add(o, scale(d, t)), focus));
                assert!(off < 1e-6 * (focal + 30.0), "pixel {x} {y}: passes the focus at {off}");
                let on_lens = sub(o, view.position);
                assert!(length(on_lens) <= radius + 2e-6 && dot(on_lens, view.axes[2]).abs() < 2e-6);
            }
        }
    }
}

#[test]
fn lens_points_are_uniform_on_the_disk() {
    let view = View::new([0.0, 0.0, -5.0], [0.0; 3]);
    let camera = view.camera(Some((2.0, 5.0)), FilterAxis::constant(0.5));
    // Rings of equal area times sectors of equal angle.
    let (mut observed, mut pixel) = (vec![0u64; 10 * 16], vec![0u64; 16 * 16]);
    for index in 0..SAMPLES as u32 {
        let ray = camera_ray::<f32, Independent>(&camera, stream(index), Wrapping(960), Wrapping(540));
        let p = sub(wide(ray.origin.lane(0)), view.position);
        let (x, y) = (dot(p, view.axes[0]) / 2.0, dot(p, view.axes[1]) / 2.0);
        let ring = ((x * x + y * y) * 10.0) as usize;
        let sector = (y.atan2(x).rem_euclid(core::f64::consts::TAU) / core::f64::consts::TAU * 16.0) as usize;
        observed[ring.min(9) * 16 + sector.min(15)] += 1;
        // Place in the pixel against place on the lens: independent of each other.
        let d = wide(ray.direction.lane(0));
        let focus = add(wide(ray.origin.lane(0)), scale(d, 5.0 / dot(d, view.axes[2])));
        let sx =
            (dot(sub(focus, view.position), view.axes[0]) / 5.0 / view.half[0] + 1.0) * 0.5 * view.size[0]
                - 960.0;
        pixel[((sx * 16.0) as usize).min(15) * 16 + sector.min(15)] += 1;
    }
    assert_distributed("lens", &observed, &[SAMPLES as f64 / 160.0; 160], 2);
    assert_distributed("pixel and lens", &pixel, &[SAMPLES as f64 / 256.0; 256], 2);
}

#[test]
fn negative_lobes_weigh_minus_one() {
    let view = View::new([0.0, 0.0, -5.0], [0.0; 3]);
    let axis = FilterAxis::tabulate(2.0, mitchell(2.0));
    let camera = view.camera(None, axis.clone());
    assert!(camera.filter().has_negative_lobes());
    // The mean weight is the integral of the filter over that of its absolute value.
    let f = mitchell(2.0);
    let at = |k: usize| -2.0 + 4.0 * (k as f64 + 0.5) / 1e5;
    let ratio =
        (0..100_000).map(|k| f(at(k))).sum::<f64>() / (0..100_000).map(|k| f(at(k)).abs()).sum::<f64>();
    let mean = statistics::Mean::of((0..SAMPLES as u32).map(|index| {
        let ray = camera_ray::<f32, Independent>(&camera, stream(index), Wrapping(9), Wrapping(9));
        assert!(ray.weight.abs() == 1.0);
        ray.weight as f64
    }));
    mean.assert_near("mean weight", ratio * ratio, 1e-3);
}
