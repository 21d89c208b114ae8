//! Stage `shade`: one batch kernel for each class of materials, for emitting surfaces and for the sky.
//!
//! [`scatter`] is the path step at a surface, written once: light sampling, then the next direction. The kernels run
//! it over index lists at full width, the megakernel one path at a time.

pub mod anisotropic_conductor;
pub mod bsdf;
pub mod coated;
pub mod coated_conductor;
pub mod conductor;
pub mod dielectric;
pub mod diffuse_transmission;
pub mod emission;
pub mod environment;
pub mod fresnel;
pub mod lambert;
pub mod materials;
pub mod microfacet;
pub mod mirror;
pub mod oren_nayar;
pub mod parameters;
pub mod rough_conductor;
pub mod rough_dielectric;
pub mod surface;
pub mod thin_dielectric;
pub mod uber;

use crate::isa::{Isa, Kernel, Promise};
use crate::lanes::{Mask, Real, Uint};
use crate::math::{Frame, Rgb, Vec3, power_heuristic};
use crate::queue::{HitQueue, PathQueue, SLOT_BITS, ShadowQueue, SlotTable, list_lanes};
use crate::sampler::{Sampler, Stream, dimension, vertex_dimension};
use crate::scene::lights::{LightKinds, LightRow, LightSample, LightTable, kind, sample};
use crate::scene::parametrization::tangents;
use crate::scene::{Geometry, PrimitiveTag, Scene};
use crate::texture::TexturedPiece;
use bsdf::Bsdf;
use core::marker::PhantomData;
use materials::Material;
use surface::Surface;

/// What the plan settled, as constants of the kernels: absent features cost nothing.
///
/// Kernels take of it what they can tell apart and no more, so that each is compiled once for all it serves.
pub trait Features: Copy + Send + Sync + 'static {
    /// Which random numbers.
    type Sampler: Sampler;
    /// Which lights.
    type Lights: LightKinds;
    /// Their kinds.
    const LIGHTS: u32 = <Self::Lights as LightKinds>::KINDS;
    /// Features that include these, the same for many.
    type General: Features;
    /// What the kernels of specular materials can tell apart: they sample no lights.
    type Specular: Features;
}

/// A path at a surface.
#[derive(Clone, Copy)]
pub struct Vertex<F: Real> {
    /// Where.
    pub surface: Surface<F>,
    /// How the point changes with the coordinate u: looked at by anisotropic lobes only. Of any length, 0 where there is
    /// no such direction.
    pub tangent: Vec3<F>,
    /// Direction of the ray that came here.
    pub direction: Vec3<F>,
    /// Throughput so far.
    pub throughput: Rgb<F>,
    /// Product of the squared relative indices so far.
    pub eta_scale: F,
    /// Random numbers.
    pub stream: Stream<F::Uint>,
    /// Number of this vertex, 0 the first.
    pub depth: F::Uint,
}

/// A ray towards a light, and what it adds if nothing is in its way.
#[derive(Clone, Copy)]
pub struct ShadowRay<F: Real> {
    /// Where it starts.
    pub origin: Vec3<F>,
    /// Unit direction.
    pub direction: Vec3<F>,
    /// How far to look.
    pub distance: F,
    /// What it adds to the path's radiance.
    pub radiance: Rgb<F>,
    /// Lanes with such a ray.
    pub valid: F::Mask,
}

/// A path that leaves a surface.
#[derive(Clone, Copy)]
pub struct Scattered<F: Real> {
    /// Ray towards a light.
    pub shadow: ShadowRay<F>,
    /// Where the next ray starts.
    pub origin: Vec3<F>,
    /// Its unit direction.
    pub direction: Vec3<F>,
    /// Throughput; 0 in lanes where the path ended.
    pub throughput: Rgb<F>,
    /// Density of the direction over solid angle, 0 if specular.
    pub pdf: F,
    /// Product of the squared relative indices.
    pub eta_scale: F,
}

/// How the code comes to that which samples lights, most of what there is to compile of a material.
pub trait LightSampling: Copy {
    /// A direction towards a light from `origin`; `sky` chooses among the pixels of a picture of the sky.
    fn sample<F: Real, L: LightKinds>(
        self,
        lights: &LightTable,
        light: &LightRow<F>,
        origin: Vec3<F>,
        u: [F; 2],
        sky: F::Uint,
    ) -> LightSample<F>;
}

/// It has a copy of it.
#[derive(Clone, Copy, Debug)]
pub struct InPlace;

impl LightSampling for InPlace {
    #[inline(always)]
    fn sample<F: Real, L: LightKinds>(
        self,
        lights: &LightTable,
        light: &LightRow<F>,
        origin: Vec3<F>,
        u: [F; 2],
        sky: F::Uint,
    ) -> LightSample<F> {
        let mut towards = sample::<F, L>(light, origin, u);
        if L::KINDS & kind::ENVIRONMENT != 0 && !lights.maps().is_empty() {
            lights.sample_map(light, origin, sky, u, &mut towards);
        }
        towards
    }
}

/// It calls the one that all materials share that are not [`Bsdf::COMMON`].
#[derive(Clone, Copy, Debug)]
pub struct Shared<I>(pub I);

impl<I: Isa> LightSampling for Shared<I> {
    #[inline(always)]
    fn sample<F: Real, L: LightKinds>(
        self,
        lights: &LightTable,
        light: &LightRow<F>,
        origin: Vec3<F>,
        u: [F; 2],
        sky: F::Uint,
    ) -> LightSample<F> {
        self.0.run(SampleLight { lights, light: *light, origin, u, sky, kinds: PhantomData::<L> })
    }
}

/// The kernel: one vector of directions towards lights.
struct SampleLight<'a, F: Real, L> {
    lights: &'a LightTable,
    light: LightRow<'a, F>,
    origin: Vec3<F>,
    u: [F; 2],
    sky: F::Uint,
    kinds: PhantomData<L>,
}

impl<F: Real, L: LightKinds> Kernel for SampleLight<'_, F, L> {
    type Output = LightSample<F>;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> LightSample<F> {
        let SampleLight { lights, light, origin, u, sky, .. } = self;
        InPlace.sample::<F, L>(lights, &light, origin, u, sky)
    }
}

/// The path step at a surface of material `B`: samples a light, weighs it against the BSDF, then samples the BSDF.
#[inline(always)]
pub fn scatter<F: Real, B: Bsdf<F>, P: Features, S: LightSampling>(
    lights: S,
    scene: &Scene,
    vertex: &Vertex<F>,
    bsdf: &B,
) -> Scattered<F> {
    let surface = &vertex.surface;
    let wo = -vertex.direction;
    // The frame is on the side of wo, but for materials that tell inside from outside.
    let normal = if B::TRANSMITS {
        surface.shading_normal
    } else {
        surface.shading_normal.xor_sign(surface.shading_normal.dot(wo))
    };
    let frame =
        if B::ANISOTROPIC { Frame::along(normal, vertex.tangent) } else { Frame::from_normal(normal) };
    let wo_local = frame.to_local(wo);

    let shadow = if P::LIGHTS != 0 && !B::SPECULAR && !scene.lights().is_empty() {
        light_ray::<F, B, P, S>(lights, scene, vertex, bsdf, &frame, wo_local)
    } else {
        ShadowRay {
            origin: surface.point,
            direction: wo,
            distance: F::zero(),
            radiance: Rgb::zero(),
            valid: F::Mask::from_bits(0),
        }
    };

    let u = P::Sampler::two::<F>(vertex.stream, vertex_dimension(vertex.depth, dimension::BSDF));
    // Specular lobes take no direction: which of them it is takes the first of its numbers. What `sample` does not use
    // is not drawn.
    let lobe = if B::SPECULAR {
        u[0]
    } else {
        P::Sampler::one::<F>(vertex.stream, vertex_dimension(vertex.depth, dimension::LOBE))
    };
    let next = bsdf.sample(wo_local, lobe, u);
    let direction = frame.to_world(next.wi);
    let throughput = Rgb::select(next.valid, vertex.throughput * next.weight, Rgb::zero());
    Scattered {
        shadow,
        origin: surface.leave(direction),
        direction,
        throughput,
        pdf: next.pdf,
        eta_scale: if B::SCALES_RADIANCE { vertex.eta_scale * next.eta_scale } else { vertex.eta_scale },
    }
}

/// Next-event estimation: one light, one direction, weighed by the power heuristic against the BSDF.
#[inline(always)]
fn light_ray<F: Real, B: Bsdf<F>, P: Features, S: LightSampling>(
    sampling: S,
    scene: &Scene,
    vertex: &Vertex<F>,
    bsdf: &B,
    frame: &Frame<F>,
    wo_local: Vec3<F>,
) -> ShadowRay<F> {
    let lights = scene.lights();
    let id = if lights.len() > 1 {
        let bits = P::Sampler::bits(vertex.stream, vertex_dimension(vertex.depth, dimension::LIGHT_CHOICE));
        // SAFETY: there are lights.
        unsafe { lights.choose(bits) }
    } else {
        F::Uint::splat(0)
    };
    // SAFETY: `choose` returns lights that exist; light 0 exists, as `scatter` asked.
    let light = unsafe { lights.row::<F>(id) };
    let u = P::Sampler::two::<F>(vertex.stream, vertex_dimension(vertex.depth, dimension::LIGHT));
    // The same reference point as that of a BSDF ray on this side, so that both strategies speak of one density.
    let reference = vertex.surface.leave(-vertex.direction);
    let sky = if P::LIGHTS & kind::ENVIRONMENT != 0 && !lights.maps().is_empty() {
        P::Sampler::bits(vertex.stream, vertex_dimension(vertex.depth, dimension::SKY))
    } else {
        F::Uint::splat(0)
    };
    let towards = sampling.sample::<F, P::Lights>(lights, &light, reference, u, sky);
    let wi_local = frame.to_local(towards.direction);
    let value = bsdf.eval(wo_local, wi_local);
    let pdf_light = towards.pdf * light.probability();
    let weight = power_heuristic(pdf_light, bsdf.pdf(wo_local, wi_local));
    let weight = F::select(towards.delta, F::one(), weight);
    // The reflected share first: radiance over a small density may leave the range of numbers, and times 0 be none.
    let radiance = vertex.throughput * value.scale(weight / pdf_light) * towards.radiance;
    // Rays that bring nothing are not traced; what is not a number is, so that it shows and is counted.
    let nothing = radiance.sum().le(F::zero());
    let valid = towards.valid & !nothing;
    ShadowRay {
        origin: vertex.surface.leave(towards.direction),
        direction: towards.direction,
        distance: towards.distance,
        radiance,
        valid,
    }
}

/// How the point of a primitive changes with its coordinate u, in lanes whose lobes care; 0 in others, and where the scene
/// keeps no coordinates.
///
/// # Safety
/// Every lane of `primitive` is below `geometry.primitives()`.
#[inline(always)]
pub unsafe fn tangent<F: Real, B: Bsdf<F>>(
    geometry: &Geometry,
    primitive: F::Uint,
    surface: &Surface<F>,
    bsdf: &B,
) -> Vec3<F> {
    if !B::ANISOTROPIC || !geometry.has_coordinates() {
        return Vec3::zero();
    }
    let stretched = bsdf.stretched();
    if !stretched.any() {
        return Vec3::zero();
    }
    // SAFETY: the caller's promise; there are coordinates.
    let u = unsafe { tangents(geometry, primitive, surface) }.u;
    Vec3::select(stretched, u, Vec3::zero())
}

/// The row of the material of a primitive with this tag.
///
/// # Safety
/// The tag is one of the scene's.
#[inline(always)]
pub unsafe fn material_of<U: Uint>(scene: &Scene, tag: U) -> U {
    let id = tag & U::splat(PrimitiveTag::ID_MASK);
    let emits = !(tag & U::splat(PrimitiveTag::EMITS)).eq(U::splat(0));
    if emits.any() {
        // SAFETY: emitting lanes hold the number of a light; the others read light 0, which then exists.
        let of_light = unsafe { scene.lights().material(U::select(emits, id, U::splat(0))) };
        U::select(emits, of_light, id)
    } else {
        id
    }
}

/// The kernel: scatters the paths of one class.
///
/// Promise: the queues are as long as their `new` made them; `list` holds places of `paths`, each of which has a hit on a
/// primitive of the scene whose tag is of the class `M` (in scenes with mixtures the material of the hit is); their slots
/// are below the capacity of `slots`, and hold places of units that have an entry in `first_sample`; if `P` samples lights,
/// `shadows` has room for the list; textured rows are those of the list, and a vector's more.
pub struct Shade<'a, M, P> {
    /// Scene.
    pub scene: &'a Scene,
    /// Places in `paths` of the paths to scatter.
    pub list: &'a [u32],
    /// Paths that arrive.
    pub paths: &'a PathQueue,
    /// Where they arrive.
    pub hits: &'a HitQueue,
    /// Rows of parameters in the order of `list`, from the stage `texture`; none where the rows of the materials do.
    pub textured: Option<TexturedPiece<'a>>,
    /// Random streams; the radiance scaling of refraction is kept there.
    pub slots: &'a mut SlotTable,
    /// Index of the first sample of each work unit.
    pub first_sample: &'a [u32],
    /// Paths that leave, appended in the order of `list`.
    pub scattered: &'a mut PathQueue,
    /// Rays towards lights, appended.
    pub shadows: &'a mut ShadowQueue,
    /// Material and features.
    pub kernel: PhantomData<(M, P)>,
    /// See there.
    pub promise: Promise,
}

impl<M: Material, P: Features> Kernel for Shade<'_, M, P> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        shade::<I, I::Wide, M, P>(
            isa,
            self.scene,
            self.list,
            self.paths,
            self.hits,
            self.textured,
            self.slots,
            self.first_sample,
            self.scattered,
            self.shadows,
        );
    }
}

/// Numbers of lanes.
const LANES: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn shade<I: Isa, F: Real, M: Material, P: Features>(
    isa: I,
    scene: &Scene,
    list: &[u32],
    paths: &PathQueue,
    hits: &HitQueue,
    textured: Option<TexturedPiece>,
    slots: &mut SlotTable,
    first_sample: &[u32],
    scattered: &mut PathQueue,
    shadows: &mut ShadowQueue,
) {
    let scales = M::Bsdf::<F>::SCALES_RADIANCE && !slots.eta_scale.is_empty();
    let mut at = 0;
    while at < list.len() {
        let (place, count) = list_lanes::<F>(list, at);
        // SAFETY (block): `material_sort` lists places below `paths.len`, all of which have a hit on a primitive of
        // the scene whose tag is of the class `M`; slots are below the capacity of the table; tags hold materials and
        // lights of the scene.
        let (vertex, bsdf, slot) = unsafe {
            let real = |column: &[f32]| F::gather(column, place);
            let slot_depth = F::Uint::gather(&paths.slot_depth, place);
            let slot = slot_depth & F::Uint::splat((1 << SLOT_BITS) - 1);
            let primitive = F::Uint::gather(&hits.primitive, place);
            let direction =
                Vec3::new(real(&paths.direction_x), real(&paths.direction_y), real(&paths.direction_z));
            let mut surface = Surface::new(
                scene.geometry(),
                primitive,
                Vec3::new(real(&paths.origin_x), real(&paths.origin_y), real(&paths.origin_z)),
                direction,
                real(&hits.t),
                || (real(&hits.u), real(&hits.v)),
            );
            if let Some([x, y, z]) = textured.and_then(|piece| piece.normals) {
                surface.shading_normal = Vec3::new(F::load(x, at), F::load(y, at), F::load(z, at));
            }
            // Where there are mixtures, the hits know what was chosen.
            let mixes = !hits.material.is_empty();
            let parameters = match textured {
                None if mixes => {
                    let row = F::Uint::gather(&hits.material, place) & F::Uint::splat(PrimitiveTag::ID_MASK);
                    scene.materials().evaluate::<M, F>(row)
                }
                None => {
                    let tag = F::Uint::gather(scene.geometry().tags(), primitive);
                    scene.materials().evaluate::<M, F>(material_of(scene, tag))
                }
                Some(TexturedPiece { rows, .. }) => {
                    let row = F::Uint::splat(at as u32) + F::Uint::load(&LANES, 0);
                    M::evaluate::<F>(rows, row * F::Uint::splat(M::WIDTH as u32))
                }
            };
            let throughput =
                Rgb::new(real(&paths.throughput_r), real(&paths.throughput_g), real(&paths.throughput_b));
            let throughput = if mixes {
                throughput * Rgb::new(real(&hits.weight_r), real(&hits.weight_g), real(&hits.weight_b))
            } else {
                throughput
            };
            let bsdf = M::bsdf(parameters);
            let vertex = Vertex {
                surface,
                tangent: tangent(scene.geometry(), primitive, &surface, &bsdf),
                direction,
                throughput,
                eta_scale: if scales { F::gather(&slots.eta_scale, slot) } else { F::one() },
                stream: slots.stream(first_sample, slot),
                depth: slot_depth.shr::<SLOT_BITS>(),
            };
            (vertex, bsdf, slot)
        };
        let out = if M::Bsdf::<F>::COMMON {
            scatter::<F, M::Bsdf<F>, P, _>(InPlace, scene, &vertex, &bsdf)
        } else {
            scatter::<F, M::Bsdf<F>, P, _>(Shared(isa), scene, &vertex, &bsdf)
        };

        if P::LIGHTS != 0 && !M::Bsdf::<F>::SPECULAR {
            let valid = out.shadow.valid & F::Mask::first(count);
            push_shadow::<F>(shadows, &out.shadow, valid, slot);
        }

        let to = scattered.len;
        out.origin.x.store(&mut scattered.origin_x, to);
        out.origin.y.store(&mut scattered.origin_y, to);
        out.origin.z.store(&mut scattered.origin_z, to);
        out.direction.x.store(&mut scattered.direction_x, to);
        out.direction.y.store(&mut scattered.direction_y, to);
        out.direction.z.store(&mut scattered.direction_z, to);
        out.throughput.r.store(&mut scattered.throughput_r, to);
        out.throughput.g.store(&mut scattered.throughput_g, to);
        out.throughput.b.store(&mut scattered.throughput_b, to);
        if !scattered.pdf.is_empty() {
            out.pdf.store(&mut scattered.pdf, to);
        }
        if scales {
            let (slot, eta_scale) = (slot.to_array(), out.eta_scale.to_array());
            for lane in 0..count {
                slots.eta_scale[slot[lane] as usize] = eta_scale[lane];
            }
        }
        let next = (vertex.depth + F::Uint::splat(1)).shl::<SLOT_BITS>() | slot;
        next.store(&mut scattered.slot_depth, to);
        scattered.len = to + count;
        at += count;
    }
}

/// Appends the rays of the set lanes.
#[inline(always)]
fn push_shadow<F: Real>(queue: &mut ShadowQueue, ray: &ShadowRay<F>, valid: F::Mask, slot: F::Uint) {
    let to = queue.len;
    ray.origin.x.compress(valid, &mut queue.origin_x, to);
    ray.origin.y.compress(valid, &mut queue.origin_y, to);
    ray.origin.z.compress(valid, &mut queue.origin_z, to);
    ray.direction.x.compress(valid, &mut queue.direction_x, to);
    ray.direction.y.compress(valid, &mut queue.direction_y, to);
    ray.direction.z.compress(valid, &mut queue.direction_z, to);
    ray.distance.compress(valid, &mut queue.distance, to);
    ray.radiance.r.compress(valid, &mut queue.radiance_r, to);
    ray.radiance.g.compress(valid, &mut queue.radiance_g, to);
    ray.radiance.b.compress(valid, &mut queue.radiance_b, to);
    slot.compress(valid, &mut queue.slot, to);
    queue.len = to + valid.count();
}

/// Adds to the radiance of each path: `radiance` of lane `i` to slot `slot[i]`, for the first `count` lanes.
/// Slots within a vector differ, as each path is in one place.
#[inline(always)]
pub(crate) fn add_radiance<F: Real>(slots: &mut SlotTable, slot: F::Uint, radiance: Rgb<F>, count: usize) {
    let slot = slot.to_array();
    let (r, g, b) = (radiance.r.to_array(), radiance.g.to_array(), radiance.b.to_array());
    for i in 0..count {
        let s = slot[i] as usize;
        slots.radiance_r[s] += r[i];
        slots.radiance_g[s] += g[i];
        slots.radiance_b[s] += b[i];
    }
}
