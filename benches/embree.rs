//! Our traversal against Embree's on the same triangles and the same rays, recorded from renders: one thread, rounds of
//! each in turn. Prints a table of throughput and of ratios, and one of rays on whose hits the two do not agree.
//!
//! Both read rays from the same queue and write distances and primitives to the same kind of queue. Rays go through our
//! tree as the engine sends them. Embree has its default settings and, where that is said, those that are watertight, as
//! ours always is (`RTC_SCENE_FLAG_ROBUST`); trees of `RTC_BUILD_QUALITY_HIGH` and, where that is said, `MEDIUM`, its
//! default; denormal numbers are flushed to zero for it, as its manual asks, and not for ours.
//!
//! `cargo bench --features embree --bench embree [-- [SCENE] [--spp N]]`; needs Embree 3 (Debian: `libembree-dev`).

mod support;

use std::ffi::c_void;
use std::ops::ControlFlow;
use std::time::Instant;

use support::{Lamp, Loaded};
use wavepath::bench::{Clock, Spread};
use wavepath::engine::wavefront::DEFAULT_BATCH;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, Intersect, RayClass, Traversal};
use wavepath_kernels::isa::Level;
use wavepath_kernels::light_sample::LightSample;
use wavepath_kernels::queue::{
    HitQueue, PAD, PathQueue, Requirements, SHADOW_RAYS, SLOT_BITS, ShadowQueue, SlotTable,
};
use wavepath_kernels::scene::{Geometry, MISS};

/// The part of Embree 3's interface that is needed here, after its manual.
mod rtc {
    use std::ffi::{c_char, c_void};

    pub type Handle = *mut c_void;
    pub const GEOMETRY_TYPE_TRIANGLE: u32 = 0;
    pub const BUFFER_TYPE_INDEX: u32 = 0;
    pub const BUFFER_TYPE_VERTEX: u32 = 1;
    pub const FORMAT_UINT3: u32 = 0x5003;
    pub const FORMAT_FLOAT3: u32 = 0x9003;
    pub const BUILD_QUALITY_MEDIUM: u32 = 1;
    pub const BUILD_QUALITY_HIGH: u32 = 2;
    pub const SCENE_FLAG_NONE: u32 = 0;
    pub const SCENE_FLAG_ROBUST: u32 = 4;
    pub const INVALID: u32 = u32::MAX;

    /// All rays of a packet count.
    #[repr(align(64))]
    pub struct Valid(pub [i32; 16]);
    pub static ALL_VALID: Valid = Valid([-1; 16]);

    #[repr(C)]
    pub struct Context {
        pub coherent: u32,
        pub filter: *const c_void,
        pub instance: u32,
    }

    /// As Embree wants its packets: 16, 32 or 64 bytes by their size.
    #[repr(C, align(64))]
    #[derive(Clone, Copy)]
    pub struct Aligned<T>(pub T);

    /// `RTCRay` (N = 1), `RTCRay8`, `RTCRay16`, to be [`Aligned`].
    #[repr(C)]
    #[derive(Clone, Copy)]
    pub struct Rays<const N: usize> {
        pub origin: [[f32; N]; 3],
        pub near: [f32; N],
        pub direction: [[f32; N]; 3],
        pub time: [f32; N],
        pub far: [f32; N],
        pub mask: [u32; N],
        pub id: [u32; N],
        pub flags: [u32; N],
    }

    /// `RTCRayHit` and its packets: the hits follow the rays without a gap. To be [`Aligned`].
    #[repr(C)]
    #[derive(Clone, Copy)]
    pub struct RayHits<const N: usize> {
        pub rays: Rays<N>,
        pub normal: [[f32; N]; 3],
        pub u: [f32; N],
        pub v: [f32; N],
        pub primitive: [u32; N],
        pub geometry: [u32; N],
        pub instance: [u32; N],
    }

    #[link(name = "embree3")]
    unsafe extern "C" {
        pub fn rtcNewDevice(config: *const c_char) -> Handle;
        pub fn rtcReleaseDevice(device: Handle);
        pub fn rtcGetDeviceError(device: Handle) -> u32;
        pub fn rtcNewScene(device: Handle) -> Handle;
        pub fn rtcReleaseScene(scene: Handle);
        pub fn rtcSetSceneBuildQuality(scene: Handle, quality: u32);
        pub fn rtcSetSceneFlags(scene: Handle, flags: u32);
        pub fn rtcNewGeometry(device: Handle, kind: u32) -> Handle;
        pub fn rtcReleaseGeometry(geometry: Handle);
        pub fn rtcSetGeometryBuildQuality(geometry: Handle, quality: u32);
        pub fn rtcSetNewGeometryBuffer(
            geometry: Handle,
            kind: u32,
            slot: u32,
            format: u32,
            stride: usize,
            count: usize,
        ) -> *mut c_void;
        pub fn rtcCommitGeometry(geometry: Handle);
        pub fn rtcAttachGeometry(scene: Handle, geometry: Handle) -> u32;
        pub fn rtcCommitScene(scene: Handle);
        pub fn rtcIntersect1(scene: Handle, context: *mut Context, rays: *mut RayHits<1>);
        pub fn rtcIntersect8(valid: *const i32, scene: Handle, context: *mut Context, rays: *mut RayHits<8>);
        pub fn rtcIntersect16(
            valid: *const i32,
            scene: Handle,
            context: *mut Context,
            rays: *mut RayHits<16>,
        );
        pub fn rtcOccluded1(scene: Handle, context: *mut Context, rays: *mut Rays<1>);
        pub fn rtcOccluded8(valid: *const i32, scene: Handle, context: *mut Context, rays: *mut Rays<8>);
        pub fn rtcOccluded16(valid: *const i32, scene: Handle, context: *mut Context, rays: *mut Rays<16>);
    }
}

/// Rays a packet, or one.
#[derive(Clone, Copy, PartialEq)]
enum Width {
    One,
    Eight,
    Sixteen,
}

/// How Embree is used.
struct Way {
    name: &'static str,
    width: Width,
    quality: u32,
    flags: u32,
}

const WAYS: [Way; 6] = [
    Way { name: "single", width: Width::One, quality: rtc::BUILD_QUALITY_HIGH, flags: rtc::SCENE_FLAG_NONE },
    Way {
        name: "single, medium",
        width: Width::One,
        quality: rtc::BUILD_QUALITY_MEDIUM,
        flags: rtc::SCENE_FLAG_NONE,
    },
    Way {
        name: "single, robust",
        width: Width::One,
        quality: rtc::BUILD_QUALITY_HIGH,
        flags: rtc::SCENE_FLAG_ROBUST,
    },
    Way { name: "by 8", width: Width::Eight, quality: rtc::BUILD_QUALITY_HIGH, flags: rtc::SCENE_FLAG_NONE },
    Way {
        name: "by 16",
        width: Width::Sixteen,
        quality: rtc::BUILD_QUALITY_HIGH,
        flags: rtc::SCENE_FLAG_NONE,
    },
    Way {
        name: "by 16, robust",
        width: Width::Sixteen,
        quality: rtc::BUILD_QUALITY_HIGH,
        flags: rtc::SCENE_FLAG_ROBUST,
    },
];

/// An Embree scene of one mesh.
struct Embree {
    device: rtc::Handle,
    scene: rtc::Handle,
}

impl Embree {
    fn new(geometry: &Geometry, quality: u32, flags: u32) -> Self {
        // SAFETY: calls in the order of the manual; the buffers have room for what is copied.
        unsafe {
            let device = rtc::rtcNewDevice(c"threads=1".as_ptr());
            assert!(!device.is_null(), "Embree has no device");
            let scene = rtc::rtcNewScene(device);
            rtc::rtcSetSceneBuildQuality(scene, quality);
            rtc::rtcSetSceneFlags(scene, flags);
            let mesh = rtc::rtcNewGeometry(device, rtc::GEOMETRY_TYPE_TRIANGLE);
            rtc::rtcSetGeometryBuildQuality(mesh, quality);
            let fill = |kind: u32, format: u32, from: *const u8, count: usize| {
                let to = rtc::rtcSetNewGeometryBuffer(mesh, kind, 0, format, 12, count);
                assert!(!to.is_null(), "Embree has no memory");
                std::ptr::copy_nonoverlapping(from, to.cast(), 12 * count);
            };
            let (vertices, triangles) = (&geometry.vertices(), &geometry.triangles());
            fill(rtc::BUFFER_TYPE_VERTEX, rtc::FORMAT_FLOAT3, vertices.as_ptr().cast(), vertices.len());
            fill(rtc::BUFFER_TYPE_INDEX, rtc::FORMAT_UINT3, triangles.as_ptr().cast(), triangles.len());
            rtc::rtcCommitGeometry(mesh);
            rtc::rtcAttachGeometry(scene, mesh);
            rtc::rtcReleaseGeometry(mesh);
            rtc::rtcCommitScene(scene);
            assert_eq!(rtc::rtcGetDeviceError(device), 0, "Embree could not build its tree");
            Embree { device, scene }
        }
    }

    /// Closest hits of all rays.
    fn closest(&self, width: Width, coherent: bool, rays: &PathQueue, hits: &mut HitQueue) {
        // SAFETY: layouts and alignment are those of the manual.
        unsafe {
            match width {
                Width::One => self.closest_by::<1>(coherent, rays, hits, |_, scene, context, rays| {
                    rtc::rtcIntersect1(scene, context, rays);
                }),
                Width::Eight => self.closest_by::<8>(coherent, rays, hits, |valid, scene, context, rays| {
                    rtc::rtcIntersect8(valid, scene, context, rays);
                }),
                Width::Sixteen => {
                    self.closest_by::<16>(coherent, rays, hits, |valid, scene, context, rays| {
                        rtc::rtcIntersect16(valid, scene, context, rays);
                    })
                }
            }
        }
    }

    #[inline(always)]
    fn closest_by<const N: usize>(
        &self,
        coherent: bool,
        rays: &PathQueue,
        hits: &mut HitQueue,
        intersect: impl Fn(*const i32, rtc::Handle, *mut rtc::Context, *mut rtc::RayHits<N>),
    ) {
        let mut context = context(coherent);
        for at in (0..rays.len).step_by(N) {
            let mut packet = rtc::Aligned(rtc::RayHits::<N> {
                rays: rays_at(
                    [&rays.origin_x, &rays.origin_y, &rays.origin_z],
                    [&rays.direction_x, &rays.direction_y, &rays.direction_z],
                    [f32::INFINITY; N],
                    at,
                ),
                normal: [[0.0; N]; 3],
                u: [0.0; N],
                v: [0.0; N],
                primitive: [rtc::INVALID; N],
                geometry: [rtc::INVALID; N],
                instance: [rtc::INVALID; N],
            });
            let rtc::Aligned(packet) = &mut packet;
            intersect(rtc::ALL_VALID.0.as_ptr(), self.scene, &mut context, packet);
            hits.t[at..at + N].copy_from_slice(&packet.rays.far);
            hits.primitive[at..at + N].copy_from_slice(&packet.primitive);
            if !hits.u.is_empty() {
                hits.u[at..at + N].copy_from_slice(&packet.u);
                hits.v[at..at + N].copy_from_slice(&packet.v);
            }
        }
    }

    /// Adds to `slots` what the unblocked rays bring.
    fn unoccluded(&self, width: Width, coherent: bool, rays: &ShadowQueue, slots: &mut SlotTable) {
        // SAFETY: layouts and alignment are those of the manual.
        unsafe {
            match width {
                Width::One => self.unoccluded_by::<1>(coherent, rays, slots, |_, scene, context, rays| {
                    rtc::rtcOccluded1(scene, context, rays);
                }),
                Width::Eight => {
                    self.unoccluded_by::<8>(coherent, rays, slots, |valid, scene, context, rays| {
                        rtc::rtcOccluded8(valid, scene, context, rays);
                    })
                }
                Width::Sixteen => {
                    self.unoccluded_by::<16>(coherent, rays, slots, |valid, scene, context, rays| {
                        rtc::rtcOccluded16(valid, scene, context, rays);
                    });
                }
            }
        }
    }

    #[inline(always)]
    fn unoccluded_by<const N: usize>(
        &self,
        coherent: bool,
        rays: &ShadowQueue,
        slots: &mut SlotTable,
        occluded: impl Fn(*const i32, rtc::Handle, *mut rtc::Context, *mut rtc::Rays<N>),
    ) {
        let mut context = context(coherent);
        for at in (0..rays.len).step_by(N) {
            let mut packet = rtc::Aligned(rays_at::<N>(
                [&rays.origin_x, &rays.origin_y, &rays.origin_z],
                [&rays.direction_x, &rays.direction_y, &rays.direction_z],
                part(&rays.distance, at),
                at,
            ));
            let rtc::Aligned(packet) = &mut packet;
            occluded(rtc::ALL_VALID.0.as_ptr(), self.scene, &mut context, packet);
            for lane in 0..N {
                // Embree says "occluded" by a distance of minus infinity.
                if packet.far[lane] >= 0.0 {
                    let slot = rays.slot[at + lane] as usize;
                    slots.radiance_r[slot] += rays.radiance_r[at + lane];
                    slots.radiance_g[slot] += rays.radiance_g[at + lane];
                    slots.radiance_b[slot] += rays.radiance_b[at + lane];
                }
            }
        }
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: both were made by `new`.
        unsafe {
            rtc::rtcReleaseScene(self.scene);
            rtc::rtcReleaseDevice(self.device);
        }
    }
}

fn context(coherent: bool) -> rtc::Context {
    rtc::Context { coherent: coherent as u32, filter: std::ptr::null::<c_void>(), instance: rtc::INVALID }
}

/// Some rays of a queue, as Embree wants them.
#[inline(always)]
fn rays_at<const N: usize>(
    origin: [&[f32]; 3],
    direction: [&[f32]; 3],
    far: [f32; N],
    at: usize,
) -> rtc::Rays<N> {
    rtc::Rays {
        origin: origin.map(|column| part(column, at)),
        near: [0.0; N],
        direction: direction.map(|column| part(column, at)),
        time: [0.0; N],
        far,
        mask: [u32::MAX; N],
        id: [0; N],
        flags: [0; N],
    }
}

#[inline(always)]
fn part<const N: usize>(column: &[f32], at: usize) -> [f32; N] {
    column[at..at + N].try_into().expect("N numbers")
}

/// Runs `work` with denormal numbers flushed to zero.
fn flushing_denormals<R>(work: impl FnOnce() -> R) -> R {
    use std::arch::asm;
    const FLUSH_TO_ZERO_AND_DENORMALS_ARE_ZERO: u32 = 0x8040;
    let mut before = 0u32;
    // SAFETY: the register is as it was when this returns; in between numbers are only moved, and Embree computes.
    unsafe {
        asm!("stmxcsr [{}]", in(reg) &mut before, options(nostack));
        let during = before | FLUSH_TO_ZERO_AND_DENORMALS_ARE_ZERO;
        asm!("ldmxcsr [{}]", in(reg) &during, options(nostack, readonly));
        let result = work();
        asm!("ldmxcsr [{}]", in(reg) &before, options(nostack, readonly));
        result
    }
}

/// Rays of one class, and what is needed to trace them.
enum Rays {
    Closest { paths: PathQueue, hits: HitQueue },
    Shadow { shadows: ShadowQueue, slots: SlotTable },
}

struct Class {
    name: &'static str,
    kind: RayClass,
    rays: Rays,
    capacity: usize,
    /// Rays that the engine traces at a time.
    piece: usize,
}

/// Classes by place in this list.
const CAMERA: usize = 0;
const FIRST_SHADOW: usize = 1;
const BOUNCE: usize = 2;
const DEEP: usize = 3;
const LATER_SHADOW: usize = 4;
/// Bounces of the deep rays, at least.
const DEEP_FROM: u32 = 4;

impl Class {
    fn len(&self) -> usize {
        match &self.rays {
            Rays::Closest { paths, .. } => paths.len,
            Rays::Shadow { shadows, .. } => shadows.len,
        }
    }

    fn push_path(&mut self, from: &PathQueue, i: usize) {
        let Rays::Closest { paths: to, .. } = &mut self.rays else { unreachable!("a class of paths") };
        if to.len < self.capacity {
            let at = to.len;
            macro_rules! copy {
                ($($column:ident)*) => { $(to.$column[at] = from.$column[i];)* };
            }
            copy!(origin_x origin_y origin_z direction_x direction_y direction_z);
            to.len += 1;
        }
    }

    fn push_shadow(&mut self, from: &ShadowQueue, i: usize) {
        let Rays::Shadow { shadows: to, .. } = &mut self.rays else { unreachable!("a class of shadow rays") };
        if to.len < self.capacity {
            let at = to.len;
            macro_rules! copy {
                ($($column:ident)*) => { $(to.$column[at] = from.$column[i];)* };
            }
            copy!(origin_x origin_y origin_z direction_x direction_y direction_z distance);
            // Each ray has a slot of its own here, and adds 1 if nothing is in its way.
            (to.radiance_r[at], to.slot[at]) = (1.0, at as u32);
            to.len += 1;
        }
    }

    /// Forgets rays behind the last whole packet, and earlier results.
    fn clear(&mut self) {
        match &mut self.rays {
            Rays::Closest { paths, hits } => {
                paths.len &= !15;
                hits.t.fill(f32::NAN);
            }
            Rays::Shadow { shadows, slots } => {
                shadows.len &= !15;
                slots.radiance_r.fill(0.0);
            }
        }
    }

    /// Distances of the hits, infinite for none; of shadow rays: infinite if nothing is in the way, otherwise 0.
    fn results(&self) -> Vec<f32> {
        match &self.rays {
            Rays::Closest { paths, hits } => {
                let miss = |i: usize| hits.primitive[i] == MISS;
                (0..paths.len).map(|i| if miss(i) { f32::INFINITY } else { hits.t[i] }).collect()
            }
            Rays::Shadow { shadows, slots } => slots.radiance_r[..shadows.len]
                .iter()
                .map(|&r| if r > 0.0 { f32::INFINITY } else { 0.0 })
                .collect(),
        }
    }

    /// Seconds of processor time that our tree takes, mean of some times.
    fn trace(&mut self, tree: &Bvh8, traversal: Traversal, level: Level, times: usize) -> f64 {
        self.clear();
        let mut stack = tree.stack();
        let mut order = vec![0; DEFAULT_BATCH + PAD];
        let clock = Clock::start();
        for _ in 0..times {
            // In pieces as the engine has them.
            let (len, piece) = (self.len(), self.piece);
            for start in (0..len).step_by(piece) {
                let (range, stack, order) = (start..len.min(start + piece), &mut stack, &mut order[..]);
                match &mut self.rays {
                    Rays::Closest { paths, hits } => {
                        level.run(Intersect {
                            accelerator: tree,
                            traversal,
                            paths,
                            range,
                            hits,
                            stack,
                            order,
                        });
                    }
                    Rays::Shadow { shadows, slots } => {
                        level.run(LightSample { accelerator: tree, traversal, shadows, range, slots, stack });
                    }
                }
            }
        }
        clock.processor() / times as f64
    }

    /// Seconds that Embree takes, likewise.
    fn trace_by_embree(&mut self, embree: &Embree, width: Width, times: usize) -> f64 {
        self.clear();
        let coherent = self.kind.is_coherent();
        flushing_denormals(|| {
            let clock = Clock::start();
            for _ in 0..times {
                match &mut self.rays {
                    Rays::Closest { paths, hits } => embree.closest(width, coherent, paths, hits),
                    Rays::Shadow { shadows, slots } => embree.unoccluded(width, coherent, shadows, slots),
                }
            }
            clock.processor() / times as f64
        })
    }
}

/// Rays of a render of the scene, up to `capacity` of each class.
fn record(loaded: &Loaded, tree: &Bvh8, spp: u32, capacity: usize) -> Vec<Class> {
    let requirements = Requirements {
        light_sampling: true,
        smooth_normals: loaded.plan.requirements().smooth_normals,
        ..Requirements::default()
    };
    let closest = || Rays::Closest {
        paths: PathQueue::new(capacity, requirements),
        hits: HitQueue::new(capacity, requirements),
    };
    let shadow = || Rays::Shadow {
        shadows: ShadowQueue::new(capacity, requirements),
        slots: SlotTable::new(capacity, requirements),
    };
    let class = |name, kind, rays| {
        let piece = if matches!(rays, Rays::Closest { .. }) { DEFAULT_BATCH } else { SHADOW_RAYS };
        Class { name, kind, rays, capacity, piece }
    };
    let mut classes = vec![
        class("camera", RayClass::Camera, closest()),
        class("first shadow", RayClass::FirstShadow, shadow()),
        class("bounce", RayClass::Bounce, closest()),
        class("deep bounce", RayClass::Bounce, closest()),
        class("later shadow", RayClass::LaterShadow, shadow()),
    ];
    loaded.rounds(tree, spp, &mut |round| {
        for i in 0..round.paths.len {
            let class = match round.paths.slot_depth[i] >> SLOT_BITS {
                0 => CAMERA,
                1..DEEP_FROM => BOUNCE,
                _ => DEEP,
            };
            classes[class].push_path(&round.paths, i);
        }
        for (range, class) in round.shadow_runs {
            let class = if class == RayClass::FirstShadow { FIRST_SHADOW } else { LATER_SHADOW };
            range.for_each(|i| classes[class].push_shadow(&round.shadows, i));
        }
        let full = classes.iter().all(|class| class.len() == capacity);
        if full { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    classes
}

fn median(numbers: &[f64]) -> f64 {
    Spread::of(numbers.iter().copied()).median
}

/// The part of the rays whose hits differ by more than 1e-4 of their distance.
fn disagreement(ours: &[f32], theirs: &[f32]) -> f64 {
    let differ = |(a, b): (&f32, &f32)| !(a == b || (a - b).abs() <= 1e-4 * a.abs().max(b.abs()));
    ours.iter().zip(theirs).filter(|&pair| differ(pair)).count() as f64 / ours.len() as f64
}

/// Rays on whose hits the two may differ.
const MAY_DIFFER: f64 = 1e-4;
/// How rays can go through our tree.
const TRAVERSALS: [Traversal; 4] =
    [Traversal::Packets, Traversal::Sorted, Traversal::Single, Traversal::Interleaved];

/// Both trees over a scene.
struct Trees<'a> {
    ours: Bvh8<'a>,
    embree: Vec<((u32, u32), Embree)>,
    /// What building took.
    built: String,
}

impl<'a> Trees<'a> {
    fn new(geometry: &'a Geometry) -> Self {
        assert_eq!(geometry.primitives(), geometry.triangles().len(), "only triangles are the same for both");
        let started = Instant::now();
        let ours = Bvh8::new(geometry);
        let mut built = format!("{:.1} s, {} MiB |", started.elapsed().as_secs_f64(), ours.bytes() >> 20);
        let mut embree: Vec<((u32, u32), Embree)> = Vec::new();
        for way in &WAYS {
            let key = (way.quality, way.flags);
            if embree.iter().all(|(other, _)| *other != key) {
                let started = Instant::now();
                embree.push((key, Embree::new(geometry, way.quality, way.flags)));
                built += &format!(" {:.1} s |", started.elapsed().as_secs_f64());
            }
        }
        Trees { ours, embree, built }
    }

    fn embree(&self, way: &Way) -> &Embree {
        let key = (way.quality, way.flags);
        &self.embree.iter().find(|(other, _)| *other == key).expect("a tree for each way").1
    }
}

/// The tables, row by row.
#[derive(Default)]
struct Tables {
    against: String,
    among: String,
    differing: String,
    built: String,
}

impl Tables {
    fn add(&mut self, scene: &str, class: &mut Class, trees: &Trees, level: Level, rounds: usize) {
        let start = format!("| {scene} | {} |", class.name);
        let picked = trees.ours.traversal(class.kind);
        // Once for the results, to warm everything up, and to see how often it takes for some milliseconds.
        class.trace(&trees.ours, picked, level, 1);
        let results = class.results();
        let seconds = class.trace(&trees.ours, picked, level, 1);
        let times = (if rounds > 1 { 0.02 / seconds.max(1e-6) } else { 1.0 }).ceil() as usize;
        self.differing += &start;
        for way in &WAYS {
            class.trace_by_embree(trees.embree(way), way.width, 1);
            let part = disagreement(&results, &class.results());
            self.differing += &format!(" {part:.1e}{} |", if part > MAY_DIFFER { " (!)" } else { "" });
        }
        self.differing.push('\n');

        let mut ours = vec![Vec::new(); TRAVERSALS.len()];
        let mut theirs = vec![Vec::new(); WAYS.len()];
        for _ in 0..rounds {
            for (&traversal, ours) in TRAVERSALS.iter().zip(&mut ours) {
                ours.push(class.trace(&trees.ours, traversal, level, times));
            }
            for (way, theirs) in WAYS.iter().zip(&mut theirs) {
                let times = if way.width == Width::One { times.div_ceil(4) } else { times };
                theirs.push(class.trace_by_embree(trees.embree(way), way.width, times));
            }
        }
        let rate = |seconds: &[f64]| class.len() as f64 / median(seconds) * 1e-6;
        let of_picked = TRAVERSALS.iter().position(|t| *t == picked).expect("one of them");
        self.against += &format!("{start} {:.2} |", rate(&ours[of_picked]));
        for theirs in &theirs {
            let ratio = Spread::of(theirs.iter().zip(&ours[of_picked]).map(|(theirs, ours)| theirs / ours));
            let Spread { median, min, max } = ratio;
            self.against += &format!(" {:.2} ({median:.2}, {min:.2} to {max:.2}) |", rate(theirs));
        }
        self.among += &start;
        for (traversal, ours) in TRAVERSALS.iter().zip(&ours) {
            let mark = if *traversal == picked { " *" } else { "" };
            self.among += &format!(" {:.2}{mark} |", rate(ours));
        }
        self.against.push('\n');
        self.among.push('\n');
    }

    fn print(&self) {
        let table = |columns: &[&str], rows: &str| {
            println!("| {} |\n|{}\n{rows}", columns.join(" | "), "---|".repeat(columns.len()));
        };
        let ways = WAYS.map(|way| way.name);
        println!("Ours and Embree's, and in brackets ours over Embree's: median, least and largest.\n");
        table(&[&["scene", "rays", "ours"], &ways[..]].concat(), &self.against);
        println!("Ours in each way; * that of the engine.\n");
        table(&["scene", "rays", "packets", "sorted packets", "single", "interleaved"], &self.among);
        println!(
            "Part of the rays whose hits differ by more than 1e-4 of their distance; (!): more than {MAY_DIFFER:.0e}.\n"
        );
        table(&[&["scene", "rays"], &ways[..]].concat(), &self.differing);
        println!("Time to build the trees, one thread.\n");
        table(&["scene", "ours", "high", "medium", "high, robust"], &self.built);
    }
}

fn main() {
    let (mut filter, mut test, mut spp) = (None, false, support::SPP);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--test" => test = true,
            "--spp" => {
                let number = arguments.next().and_then(|number| number.parse().ok());
                spp = number.filter(|spp| *spp > 0).expect("--spp: a number of samples a pixel");
            }
            flag if flag.starts_with('-') => {}
            name => filter = Some(name.to_string()),
        }
    }
    let (rounds, capacity) = if test { (1, 1 << 10) } else { (11, 1 << 17) };
    let scenes: &[fn(Lamp) -> Loaded] =
        if test { &[Loaded::knot] } else { &[Loaded::knot, Loaded::menger, Loaded::terrain] };
    let level = Level::detect();
    let mut tables = Tables::default();
    for scene in scenes {
        let loaded = scene(Lamp::Square);
        if filter.as_ref().is_some_and(|filter| !loaded.name.contains(filter.as_str())) {
            continue;
        }
        let trees = Trees::new(loaded.scene.geometry());
        tables.built += &format!("| {} | {}\n", loaded.name, trees.built);
        for class in &mut record(&loaded, &trees.ours, spp, capacity) {
            tables.add(loaded.name, class, &trees, level, rounds);
        }
    }
    println!(
        "Millions of rays a second, {}, one thread, median of {rounds} rounds; {spp} samples a pixel.",
        level.name()
    );
    tables.print();
}
