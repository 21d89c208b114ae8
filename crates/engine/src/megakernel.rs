//! The megakernel: one path at a time, from the camera to its end. The naive baseline that the wavefront is held
//! against: what a good engineer writes first, never hobbled, never tuned.

use super::schedule::Unit;
use super::stats::{Laps, Stage, Stats};
use super::{Job, Tree, add_to_film};
use crate::film::BlockSums;
use std::marker::PhantomData;
use std::num::Wrapping;
use wavepath_kernels::channels::{Channel, FirstHit, MOST_COMPONENTS, NOTHING, Values, fill_first_hit};
use wavepath_kernels::cutout::{Blocked, Pass, Seen};
use wavepath_kernels::generate::camera_ray;
use wavepath_kernels::intersect::{Accelerator, Hit, TraversalStack};
use wavepath_kernels::isa::{Isa, Kernel};
use wavepath_kernels::lanes::{Real, Uint};
use wavepath_kernels::material_sort::{list, list_of, list_of_class};
use wavepath_kernels::math::{Rgb, Vec3};
use wavepath_kernels::mixture::settle;
use wavepath_kernels::roulette_compact::roulette;
use wavepath_kernels::sampler::{Stream, stream_seed};
use wavepath_kernels::scene::{PrimitiveTag, Scene};
use wavepath_kernels::shade::bsdf::Bsdf;
use wavepath_kernels::shade::emission::emitted;
use wavepath_kernels::shade::environment::sky;
use wavepath_kernels::shade::materials::{ForMaterial, Material};
use wavepath_kernels::shade::parameters::Parameters;
use wavepath_kernels::shade::surface::Surface;
use wavepath_kernels::shade::{Features, InPlace, Scattered, Shared, Vertex, material_of, scatter, tangent};
use wavepath_kernels::texture::{EvaluateOne, WIDEST};

/// One worker of the engine: takes tiles until there are none left.
pub(crate) struct Worker<'a, P> {
    /// What is rendered.
    pub(crate) job: &'a Job<'a>,
    /// What rays are traced through: a tree of the job's scene.
    pub(crate) tree: &'a Tree<'a>,
    /// Features: those of the job's plan, or more.
    pub(crate) features: PhantomData<P>,
}

impl<P: Features> Kernel for Worker<'_, P> {
    type Output = Stats;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> Stats {
        if I::SPECIALISED { self.tiles::<I, P>(isa) } else { self.tiles::<I, P::General>(isa) }
    }
}

impl<P> Worker<'_, P> {
    /// Takes tiles, with the features `Q`.
    #[inline(always)]
    fn tiles<I: Isa, Q: Features>(self, isa: I) -> Stats {
        let Worker { job, tree, .. } = self;
        let mut stats = Stats::default();
        let mut laps = Laps::start();
        let mut stack = tree.stack();
        let mut sums = job.film.sums();
        while let Some(unit) = job.schedule.take() {
            sums.clear();
            isa.run(Tile::<Q> {
                job,
                tree,
                unit: &unit,
                sums: &mut sums,
                stack: &mut stack,
                stats: &mut stats,
                features: PhantomData,
            });
            add_to_film(job, &unit, &sums, &mut stats);
            laps.lap(&mut stats, Stage::Megakernel);
        }
        stats
    }
}

/// All samples of a work unit.
struct Tile<'a, P> {
    job: &'a Job<'a>,
    tree: &'a Tree<'a>,
    unit: &'a Unit,
    sums: &'a mut BlockSums,
    stack: &'a mut TraversalStack,
    stats: &'a mut Stats,
    features: PhantomData<P>,
}

impl<P: Features> Kernel for Tile<'_, P> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        let Job { scene, film, seed, .. } = *self.job;
        let block = &film.blocks()[self.unit.block];
        let weighted = scene.camera().filter().has_negative_lobes();
        let before = self.stats.bounce_rays;
        // What beside radiance is asked for: nothing, mostly.
        let channels: Vec<Channel> = self.job.plan.requirements().channels.first_hit().collect();
        let mut values = vec![[NOTHING; MOST_COMPONENTS]; channels.len()];
        let mut channels =
            ChannelsOf { axis: scene.camera().axis(), channels: &channels, values: &mut values };
        for pixel in 0..block.pixels() {
            let (x, y) = (block.x + block.columns()[pixel], block.y + block.rows()[pixel]);
            let splat = <<I as Isa>::One as Real>::Uint::splat;
            let number = splat(y.wrapping_mul(film.image_width()).wrapping_add(x));
            let stream_seed = stream_seed(seed, number, self.unit.replicate);
            for sample in 0..self.unit.samples {
                let stream = Stream { seed: stream_seed, index: splat(self.unit.first + sample) };
                let ray = camera_ray::<I::One, P::Sampler>(scene.camera(), stream, splat(x), splat(y));
                let radiance = trace::<I, P>(
                    isa,
                    scene,
                    self.tree,
                    stream,
                    ray.origin,
                    ray.direction,
                    self.stack,
                    self.stats,
                    &mut channels,
                );
                let weight = weighted.then(|| ray.weight.to_array()[0]);
                self.sums.add(pixel, radiance, weight);
                for (channel, values) in channels.values.iter().enumerate() {
                    self.sums.add_to_channel(channel, pixel, *values, weight);
                }
            }
        }
        self.sums.bounces += self.stats.bounce_rays - before;
    }
}

/// The channels of a sample beside radiance.
struct ChannelsOf<'a> {
    axis: [f32; 3],
    channels: &'a [Channel],
    values: &'a mut [Values<f32>],
}

impl ChannelsOf<'_> {
    /// From where the camera ray first meets something.
    #[inline(always)]
    fn fill<F: Real>(&mut self, direction: Vec3<F>, hit: Hit) {
        if self.channels.is_empty() {
            return;
        }
        let first = FirstHit::of(self.axis, direction, hit);
        for (channel, values) in self.channels.iter().zip(&mut *self.values) {
            let [a, b, c, d] = fill_first_hit(*channel, &first);
            *values = [a.to_array()[0], b.to_array()[0], c.to_array()[0], d.to_array()[0]];
        }
    }
}

/// Radiance along a camera ray.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn trace<I: Isa, P: Features>(
    isa: I,
    scene: &Scene,
    tree: &Tree,
    stream: Stream<<I::One as Real>::Uint>,
    mut origin: Vec3<I::One>,
    mut direction: Vec3<I::One>,
    stack: &mut TraversalStack,
    stats: &mut Stats,
    channels: &mut ChannelsOf,
) -> [f32; 3] {
    let one = I::One::one();
    let mut throughput = Rgb::all(one);
    let mut eta_scale = one;
    let mut pdf = I::One::zero();
    let mut radiance = [0.0f32; 3];
    let mut row = [0.0; WIDEST];
    let cutouts = !scene.geometry().opacities().is_empty();
    let mut add = |light: Rgb<I::One>| {
        for (sum, x) in radiance.iter_mut().zip(light.lane(0)) {
            *sum += x;
        }
    };
    stats.camera_rays += 1;
    for depth in 0.. {
        let mut hit = tree.closest(isa, origin.lane(0), direction.lane(0), stack);
        if cutouts {
            let (origin, direction) = (origin.lane(0), direction.lane(0));
            let (distance, seen) = (f32::INFINITY, Seen::ByPaths);
            hit = isa.run(Pass {
                scene,
                accelerator: tree,
                origin,
                direction,
                hit,
                distance,
                seen,
                stack: &mut *stack,
            });
        }
        if depth == 0 {
            channels.fill(direction, hit);
        }
        let (list, emits) = list_of(scene.geometry().tags(), scene.max_depth(), hit.primitive, depth);
        if list == list::MISSED {
            if scene.lights().maps().is_empty() {
                add(throughput * Rgb::splat(scene.environment()));
            } else {
                add(throughput * sky::<I::One, P::Lights>(scene, origin, direction, pdf));
            }
            break;
        }
        let splat = I::One::splat;
        let uint = <<I as Isa>::One as Real>::Uint::splat;
        let tag = scene.geometry().tags()[hit.primitive as usize];
        // SAFETY: the primitive was hit, so it exists.
        let mut surface = unsafe {
            Surface::new(scene.geometry(), uint(hit.primitive), origin, direction, splat(hit.t), || {
                (splat(hit.u), splat(hit.v))
            })
        };
        let (material, weight) = if scene.materials().has_mixtures() {
            let [seed, index] = [stream.seed, stream.index].map(|x| Wrapping(x.to_array()[0]));
            let met = || (hit.primitive, surface, [hit.u, hit.v]);
            settle::<I, I::One, P::Sampler>(isa, scene, PrimitiveTag(tag), Stream { seed, index }, depth, met)
        } else {
            (PrimitiveTag(tag), [1.0; 3])
        };
        let list = list_of_class(scene.max_depth(), material.class(), depth);
        if emits {
            let light = uint(tag & PrimitiveTag::ID_MASK);
            // SAFETY: the tag of an emitting primitive holds the number of its light.
            let light = unsafe {
                emitted::<I::One, P::Lights>(
                    scene,
                    light,
                    origin,
                    direction,
                    splat(hit.t),
                    surface.normal,
                    pdf,
                )
            };
            add(throughput * light);
        }
        let Some(class) = list::class(list) else { break };
        if weight != [1.0; 3] {
            throughput = throughput * Rgb::splat(weight);
        }
        let primitive = hit.primitive;
        let textured = scene.programs().has_class(class);
        if textured {
            let barycentric = [hit.u, hit.v];
            let material = scene.row_of(material.0);
            let of = EvaluateOne { scene, primitive, material, surface, barycentric, row: &mut row };
            surface.shading_normal = isa.run(of);
        }
        let textured = textured.then_some(&row[..]);
        let tangent = Vec3::zero();
        let vertex =
            Vertex { surface, tangent, direction, throughput, eta_scale, stream, depth: uint(depth) };
        let step = Step::<_, _, P> {
            isa,
            scene,
            tag: material.0,
            primitive,
            textured,
            vertex: &vertex,
            features: PhantomData,
        };
        let Some(next) = class.with(step) else { break };
        if P::LIGHTS != 0 && next.shadow.valid {
            stats.shadow_rays += 1;
            let (origin, direction) = (next.shadow.origin.lane(0), next.shadow.direction.lane(0));
            let distance = next.shadow.distance.to_array()[0];
            let blocked = if cutouts {
                let accelerator = tree;
                isa.run(Blocked { scene, accelerator, origin, direction, distance, stack: &mut *stack })
            } else {
                tree.occluded(isa, origin, direction, distance, stack)
            };
            if !blocked {
                add(next.shadow.radiance);
            }
        }
        if next.throughput.lane(0).iter().sum::<f32>().is_finite() {
            let (weighed, lives) =
                roulette::<I::One, P::Sampler>(stream, next.throughput, next.eta_scale, uint(depth + 1));
            if !lives {
                break;
            }
            throughput = weighed;
        } else {
            // An invalid sample: it is counted by the film.
            add(Rgb::all(splat(f32::NAN)));
            break;
        }
        (origin, direction) = (next.origin, next.direction);
        (pdf, eta_scale) = (next.pdf, next.eta_scale);
        stats.bounce_rays += 1;
    }
    radiance
}

/// The path step at a surface with this tag.
struct Step<'a, I, F: Real, P> {
    isa: I,
    scene: &'a Scene,
    tag: u32,
    /// The row of parameters there, if it is not that of the material.
    textured: Option<&'a [f32]>,
    primitive: u32,
    vertex: &'a Vertex<F>,
    features: PhantomData<P>,
}

impl<I: Isa, F: Real, P: Features> ForMaterial for Step<'_, I, F, P> {
    type Output = Scattered<F>;
    #[inline(always)]
    fn run<M: Material>(self) -> Scattered<F> {
        // SAFETY: the tag is one of the scene's, and of the class of `M`; a textured row is one of `M`.
        let bsdf = unsafe {
            M::bsdf::<F>(match self.textured {
                None => {
                    let material = material_of(self.scene, F::Uint::splat(self.tag));
                    self.scene.materials().evaluate::<M, F>(material)
                }
                Some(row) => <M as Parameters>::evaluate::<F>(row, F::Uint::splat(0)),
            })
        };
        let mut vertex = *self.vertex;
        if M::Bsdf::<F>::ANISOTROPIC {
            let primitive = F::Uint::splat(self.primitive);
            // SAFETY: the primitive was hit, so it exists.
            vertex.tangent = unsafe { tangent(self.scene.geometry(), primitive, &vertex.surface, &bsdf) };
        }
        if M::Bsdf::<F>::COMMON {
            scatter::<F, M::Bsdf<F>, P, _>(InPlace, self.scene, &vertex, &bsdf)
        } else {
            scatter::<F, M::Bsdf<F>, P, _>(Shared(self.isa), self.scene, &vertex, &bsdf)
        }
    }
}
