//! Stage `intersect`: the closest hit of every path. And what all ray queries share: the test of one primitive, the
//! rule for ties, the trees.
//!
//! Two trees over the same primitives, both by the same builder: [`bvh2::NaiveBvh`] is binary and walked by obvhs, one
//! ray at a time, and is what a good engineer writes first; [`bvh8::Bvh8`] is 8 wide and walked here.
//!
//! Of several primitives at the same distance the one with the lowest number is hit, in every tree: coincident faces
//! are common in real scenes, and engines must agree on them.

pub mod bvh2;
pub mod bvh8;
mod partition;
pub mod ray_sort;
pub mod sphere;
pub mod triangle;

use crate::isa::{Isa, Kernel};
use crate::lanes::{Mask, Real, Uint};
use crate::math::Vec3;
use crate::queue::{HitQueue, PathQueue, ShadowQueue, list_lanes};
use crate::scene::{Geometry, MISS};
use core::ops::Range;
use ray_sort::RaySorter;
use triangle::ShearedRay;

/// The closest hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance; infinite for none.
    pub t: f32,
    /// Primitive, or [`MISS`].
    pub primitive: u32,
    /// Barycentric weight of the second corner of a triangle.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
}

impl Hit {
    /// None within `t_max`.
    #[inline(always)]
    pub fn none(t_max: f32) -> Self {
        Hit { t: t_max, primitive: MISS, u: 0.0, v: 0.0 }
    }
    /// Is `primitive` at distance `t` to be preferred? Nearer, or as near and with a lower number.
    #[inline(always)]
    pub fn yields_to(&self, t: f32, primitive: u32) -> bool {
        t < self.t || t == self.t && primitive < self.primitive
    }
}

/// Room for a traversal, one a worker.
#[derive(Clone, Debug, Default)]
pub struct TraversalStack {
    /// Nodes to visit.
    pub(crate) nodes: Vec<u32>,
    /// The distance at which the ray enters them.
    pub(crate) distances: Vec<f32>,
    /// Nodes to visit, and the distance at which each ray of some packets enters them.
    pub(crate) packets: Vec<(u32, PacketDistances)>,
    /// Nodes to visit, and the rays of some packets that enter them, a bit each.
    pub(crate) lanes: Vec<(u32, u64)>,
    /// Puts rays in order.
    pub(crate) sorter: RaySorter,
}

impl TraversalStack {
    /// Nodes that have room when packets are traced.
    pub fn room(&self) -> usize {
        self.lanes.len()
    }
}

/// A distance for each ray of as many packets as go together, whole cache lines.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub struct PacketDistances(pub [[f32; 16]; TOGETHER]);

/// As many rays as a vector has lanes.
#[derive(Clone, Copy, Debug)]
pub struct RayPacket<F: Real> {
    /// Where they start.
    pub origin: Vec3<F>,
    /// Unit directions.
    pub direction: Vec3<F>,
    /// Those that count.
    pub active: F::Mask,
}

impl<F: Real> RayPacket<F> {
    /// No rays.
    #[inline(always)]
    pub fn none() -> Self {
        let zero = Vec3::splat([0.0; 3]);
        RayPacket { origin: zero, direction: zero, active: F::Mask::first(0) }
    }
}

impl<F: Real> PacketHit<F> {
    /// None.
    #[inline(always)]
    pub fn none() -> Self {
        PacketHit { t: F::lit(f64::INFINITY), primitive: F::Uint::splat(MISS), u: F::zero(), v: F::zero() }
    }
}

/// The closest hits of a packet of rays, as [`Hit`].
#[derive(Clone, Copy, Debug)]
pub struct PacketHit<F: Real> {
    /// Distance; infinite for none.
    pub t: F,
    /// Primitive, or [`MISS`].
    pub primitive: F::Uint,
    /// Barycentric weight of the second corner of a triangle.
    pub u: F,
    /// Barycentric weight of the third corner.
    pub v: F,
}

/// What rays are traced through.
pub trait Accelerator: Sync {
    /// Name for reports.
    const NAME: &'static str;
    /// The closest hit of a ray with a unit direction.
    fn closest<I: Isa>(
        &self,
        isa: I,
        origin: [f32; 3],
        direction: [f32; 3],
        stack: &mut TraversalStack,
    ) -> Hit;
    /// Is anything hit at a distance in (0, `distance`]?
    fn occluded<I: Isa>(
        &self,
        isa: I,
        origin: [f32; 3],
        direction: [f32; 3],
        distance: f32,
        stack: &mut TraversalStack,
    ) -> bool;
    /// The closest hits of the active rays of some packets that go together.
    #[inline(always)]
    fn closest_packets<I: Isa, const V: usize>(
        &self,
        isa: I,
        rays: &[RayPacket<I::Wide>; V],
        stack: &mut TraversalStack,
    ) -> [PacketHit<I::Wide>; V] {
        let mut out = [PacketHit::none(); V];
        for (out, packet) in out.iter_mut().zip(rays) {
            let (mut t, mut primitive) = ([f32::INFINITY; 16], [MISS; 16]);
            let (mut u, mut v) = ([0.0; 16], [0.0; 16]);
            for lane in set_lanes(packet.active.bits()) {
                let hit = self.closest(isa, packet.origin.lane(lane), packet.direction.lane(lane), stack);
                (t[lane], primitive[lane], u[lane], v[lane]) = (hit.t, hit.primitive, hit.u, hit.v);
            }
            *out = PacketHit {
                t: I::Wide::load(&t, 0),
                primitive: <I::Wide as Real>::Uint::load(&primitive, 0),
                u: I::Wide::load(&u, 0),
                v: I::Wide::load(&v, 0),
            };
        }
        out
    }
    /// The active rays of some packets that go together which hit anything within their distance, a bit each: the first
    /// packet's in the lowest [`PACKET_BITS`].
    #[inline(always)]
    fn occluded_packets<I: Isa, const V: usize>(
        &self,
        isa: I,
        rays: &[RayPacket<I::Wide>; V],
        distance: &[I::Wide; V],
        stack: &mut TraversalStack,
    ) -> u64 {
        let mut blocked = 0;
        for v in 0..V {
            let (packet, distance) = (&rays[v], distance[v].to_array());
            for lane in set_lanes(packet.active.bits()) {
                let (origin, direction) = (packet.origin.lane(lane), packet.direction.lane(lane));
                let met = self.occluded(isa, origin, direction, distance[lane], stack);
                blocked |= (met as u64) << (PACKET_BITS * v + lane);
            }
        }
        blocked
    }
    /// The closest hits of the paths at the places `range`, several in flight at a time.
    #[inline(always)]
    fn closest_interleaved<I: Isa>(
        &self,
        isa: I,
        paths: &PathQueue,
        range: Range<usize>,
        hits: &mut HitQueue,
        stack: &mut TraversalStack,
    ) {
        for i in range {
            let (origin, direction) = paths.ray(i);
            hits.put(i, self.closest(isa, origin, direction, stack));
        }
    }
    /// Calls `unblocked` with the place of each shadow ray in `range` that meets nothing, several in flight at a time.
    /// In what order is not said.
    #[inline(always)]
    fn unoccluded_interleaved<I: Isa>(
        &self,
        isa: I,
        shadows: &ShadowQueue,
        range: Range<usize>,
        stack: &mut TraversalStack,
        mut unblocked: impl FnMut(usize),
    ) {
        for i in range {
            let (origin, direction, distance) = shadows.ray(i);
            if !self.occluded(isa, origin, direction, distance, stack) {
                unblocked(i);
            }
        }
    }
    /// How a batch of rays of a class goes through this tree.
    fn traversal(&self, _class: RayClass) -> Traversal {
        Traversal::Single
    }
    /// The box around everything: lowest and highest corner.
    fn bounds(&self) -> [[f32; 3]; 2];
    /// Room that a traversal needs.
    fn stack(&self) -> TraversalStack;
    /// Bytes on the heap.
    fn bytes(&self) -> usize;
}

/// The places of the set bits.
#[inline(always)]
fn set_lanes(mut bits: u32) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        let some = bits != 0;
        bits &= bits.wrapping_sub(1);
        some.then_some(lane & 15)
    })
}

/// The closest hit of one ray, as a kernel of its own: engines that trace ray by ray call it, and it is compiled once.
pub struct Closest<'a, A> {
    /// What the ray is traced through.
    pub accelerator: &'a A,
    /// Where it starts.
    pub origin: [f32; 3],
    /// Unit direction.
    pub direction: [f32; 3],
    /// Scratch.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for Closest<'_, A> {
    type Output = Hit;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> Hit {
        self.accelerator.closest(isa, self.origin, self.direction, self.stack)
    }
}

/// Whether one ray meets anything within `distance`, as a kernel of its own.
pub struct Occluded<'a, A> {
    /// What the ray is traced through.
    pub accelerator: &'a A,
    /// Where it starts.
    pub origin: [f32; 3],
    /// Unit direction.
    pub direction: [f32; 3],
    /// How far to look.
    pub distance: f32,
    /// Scratch.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for Occluded<'_, A> {
    type Output = bool;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> bool {
        self.accelerator.occluded(isa, self.origin, self.direction, self.distance, self.stack)
    }
}

/// Tests one triangle and keeps the better hit.
#[inline(always)]
pub fn test_triangle(corners: &[[f32; 3]; 3], primitive: u32, ray: &ShearedRay, hit: &mut Hit) {
    let h = triangle::intersect::<f32>(ray, corners, hit.t);
    if h.hit && hit.yields_to(h.t, primitive) {
        *hit = Hit { t: h.t, primitive, u: h.u, v: h.v };
    }
}

/// Tests one sphere or quadric and keeps the better hit.
#[inline(always)]
pub fn test_round(geometry: &Geometry, primitive: u32, origin: [f32; 3], direction: [f32; 3], hit: &mut Hit) {
    let t = if primitive < geometry.first_quadric() {
        let [x, y, z, r] = geometry.spheres()[(primitive - geometry.first_sphere()) as usize];
        let (t, meets) = sphere::intersect::<f32>(origin, direction, [x, y, z], r, hit.t);
        if !meets {
            return;
        }
        t
    } else {
        let quadric = &geometry.quadrics()[(primitive - geometry.first_quadric()) as usize];
        match quadric.intersect(origin, direction, hit.t) {
            Some(t) => t,
            None => return,
        }
    };
    if hit.yields_to(t, primitive) {
        *hit = Hit { t, primitive, u: 0.0, v: 0.0 };
    }
}

/// The bounds of a primitive: lowest corner, highest corner.
///
/// Padded by two units in the last place of their largest coordinate: what the tests of the primitives' own hits are
/// accurate to. Without it a ray along an edge shared by two boxes could slip between them.
pub fn bounds(geometry: &Geometry, primitive: u32) -> ([f32; 3], [f32; 3]) {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    let mut add = |p: [f32; 3]| {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    };
    if primitive < geometry.first_sphere() {
        geometry.corners(primitive as usize).into_iter().for_each(add);
    } else if primitive < geometry.first_quadric() {
        let [x, y, z, r] = geometry.spheres()[(primitive - geometry.first_sphere()) as usize];
        let r = r.abs();
        add([x - r, y - r, z - r]);
        add([x + r, y + r, z + r]);
    } else {
        let quadric = &geometry.quadrics()[(primitive - geometry.first_quadric()) as usize];
        let (low, high) = quadric.bounds();
        add(low);
        add(high);
    }
    for k in 0..3 {
        let pad = 2.0 * f32::EPSILON * low[k].abs().max(high[k].abs());
        low[k] -= pad;
        high[k] += pad;
    }
    (low, high)
}

/// Classes of rays that an engine treats in different ways.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum RayClass {
    /// From the camera.
    Camera,
    /// From surfaces onwards.
    Bounce,
    /// Towards lights, from what the camera sees.
    FirstShadow,
    /// Towards lights, from further on.
    LaterShadow,
}

impl RayClass {
    /// How many there are.
    pub const COUNT: usize = 4;
    /// All of them.
    pub const ALL: [RayClass; Self::COUNT] =
        [RayClass::Camera, RayClass::Bounce, RayClass::FirstShadow, RayClass::LaterShadow];
    /// Do rays of this class stay together? They start where the camera, or what it sees, is.
    pub fn is_coherent(self) -> bool {
        matches!(self, RayClass::Camera | RayClass::FirstShadow)
    }
    /// Name for tables.
    pub fn name(self) -> &'static str {
        match self {
            RayClass::Camera => "camera",
            RayClass::Bounce => "bounce",
            RayClass::FirstShadow => "first shadow",
            RayClass::LaterShadow => "later shadow",
        }
    }
}

/// How the rays of a batch go through a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Traversal {
    /// As many at a time as a vector has lanes: for rays that stay together, and for small trees.
    Packets,
    /// One after the other.
    Single,
    /// As packets, of rays that are put in order first; shadow rays in the order in which they come.
    Sorted,
    /// Several at a time, a node each in turn, so that the memory of one is fetched while the others compute: for rays
    /// that go different ways through a tree that is larger than the cache.
    Interleaved,
}

/// How an engine picks the [`Traversal`] of a batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// What is fastest, by the class of the rays and the size of the tree ([`Accelerator::traversal`]).
    #[default]
    Auto,
    /// All rays one by one.
    Single,
    /// Rays from the camera, and of the first shadows, in packets; others one by one.
    Mixed,
    /// All rays in packets.
    Packets,
    /// All rays in packets, bounce rays put in order first.
    Sorted,
    /// All rays interleaved.
    Interleaved,
}

impl Policy {
    /// The traversal of a batch of rays of a class.
    pub fn pick<A: Accelerator>(self, accelerator: &A, class: RayClass) -> Traversal {
        match self {
            Policy::Auto => accelerator.traversal(class),
            Policy::Mixed if class.is_coherent() => Traversal::Packets,
            Policy::Single | Policy::Mixed => Traversal::Single,
            Policy::Sorted if !class.is_coherent() => Traversal::Sorted,
            Policy::Packets | Policy::Sorted => Traversal::Packets,
            Policy::Interleaved => Traversal::Interleaved,
        }
    }
}

/// The kernel: closest hits of some paths of a queue.
pub struct Intersect<'a, A> {
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// How.
    pub traversal: Traversal,
    /// The rays.
    pub paths: &'a PathQueue,
    /// Places of those to trace.
    pub range: Range<usize>,
    /// Receives the hits.
    pub hits: &'a mut HitQueue,
    /// Scratch of the traversal.
    pub stack: &'a mut TraversalStack,
    /// Scratch for a number a ray.
    pub order: &'a mut [u32],
}

impl<A: Accelerator> Kernel for Intersect<'_, A> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        match self.traversal {
            Traversal::Packets => self.packets(isa),
            Traversal::Sorted => self.sorted(isa),
            Traversal::Single => self.single(isa),
            Traversal::Interleaved => {
                self.accelerator.closest_interleaved(isa, self.paths, self.range, self.hits, self.stack);
            }
        }
    }
}

impl<A: Accelerator> Intersect<'_, A> {
    #[inline(always)]
    fn packets<I: Isa>(self, isa: I) {
        let (rays, hits) = (self.paths, self.hits);
        let barycentric = !hits.u.is_empty();
        let mut at = self.range.start;
        while at < self.range.end {
            // Columns are padded, so whole vectors can be read and written. What is written behind the range is
            // written again by its owner: ranges are traced in ascending order.
            let mut packets = [RayPacket::none(); TOGETHER];
            for (k, packet) in packets.iter_mut().enumerate() {
                let at = (at + k * I::Wide::LANES).min(self.range.end);
                *packet = rays.packet(at, self.range.end - at);
            }
            let found = self.accelerator.closest_packets(isa, &packets, self.stack);
            for hit in &found {
                if at < self.range.end {
                    hit.t.store(&mut hits.t, at);
                    hit.primitive.store(&mut hits.primitive, at);
                    if barycentric {
                        hit.u.store(&mut hits.u, at);
                        hit.v.store(&mut hits.v, at);
                    }
                }
                at += I::Wide::LANES;
            }
        }
    }

    #[inline(always)]
    fn sorted<I: Isa>(self, isa: I) {
        let (rays, hits) = (self.paths, self.hits);
        let barycentric = !hits.u.is_empty();
        let n = self.range.len();
        let [x, y, z] = [&rays.direction_x, &rays.direction_y, &rays.direction_z].map(Vec::len);
        let [a, b, c] = [&rays.origin_x, &rays.origin_y, &rays.origin_z].map(Vec::len);
        assert!(self.range.end <= x.min(y).min(z).min(a).min(b).min(c), "more rays than there are");
        // Hits are not known yet: their part of the column of primitives holds the keys.
        let keys = &mut hits.primitive[self.range.start..];
        self.stack.sorter.sort::<I::Wide>(rays, self.range, keys, self.order);
        let mut at = 0;
        while at < n {
            let (place, count) = list_lanes::<I::Wide>(&self.order[..n], at);
            // SAFETY: the list holds places in the range, all of which are rays.
            let packet = unsafe { rays.packet_of(place, count) };
            let [hit] = self.accelerator.closest_packets(isa, &[packet], self.stack);
            let (t, primitive) = (hit.t.to_array(), hit.primitive.to_array());
            let (u, v) = (hit.u.to_array(), hit.v.to_array());
            let place = place.to_array();
            for lane in 0..count {
                let i = place[lane] as usize;
                hits.t[i] = t[lane];
                hits.primitive[i] = primitive[lane];
                if barycentric {
                    hits.u[i] = u[lane];
                    hits.v[i] = v[lane];
                }
            }
            at += count;
        }
    }

    #[inline(always)]
    fn single<I: Isa>(self, isa: I) {
        for i in self.range {
            let (origin, direction) = self.paths.ray(i);
            let hit = self.accelerator.closest(isa, origin, direction, self.stack);
            self.hits.put(i, hit);
        }
    }
}

/// Vectors of rays, in the order in which they came into being, that go through the tree together.
pub const TOGETHER: usize = 2;
/// Bits that a packet has in a word with a bit for each ray of some: the lanes of the widest vector.
pub const PACKET_BITS: usize = 16;

/// A [`RayPacket`] of a queue, whose columns are read as is said.
macro_rules! packet {
    ($queue:expr, |$column:ident| $read:expr, $active:expr) => {{
        macro_rules! vector {
            ($x:ident, $y:ident, $z:ident) => {
                Vec3::new(
                    {
                        let $column = &$queue.$x;
                        $read
                    },
                    {
                        let $column = &$queue.$y;
                        $read
                    },
                    {
                        let $column = &$queue.$z;
                        $read
                    },
                )
            };
        }
        RayPacket {
            origin: vector!(origin_x, origin_y, origin_z),
            direction: vector!(direction_x, direction_y, direction_z),
            active: $active,
        }
    }};
}

macro_rules! packets {
    ($queue:ident) => {
        impl $queue {
            /// Up to `count` rays from place `at` on.
            #[inline(always)]
            pub fn packet<F: Real>(&self, at: usize, count: usize) -> RayPacket<F> {
                packet!(self, |column| F::load(column, at), F::Mask::first(count.min(F::LANES)))
            }
        }
    };
}
packets!(PathQueue);
packets!(ShadowQueue);

impl PathQueue {
    /// The rays at some places, of which the first `count` matter.
    ///
    /// # Safety
    /// All places are below the capacity.
    #[inline(always)]
    unsafe fn packet_of<F: Real>(&self, place: F::Uint, count: usize) -> RayPacket<F> {
        // SAFETY: the caller's promise.
        packet!(self, |column| unsafe { F::gather(column, place) }, F::Mask::first(count))
    }

    /// Origin and direction of the ray at place `i`.
    #[inline(always)]
    pub fn ray(&self, i: usize) -> ([f32; 3], [f32; 3]) {
        (
            [self.origin_x[i], self.origin_y[i], self.origin_z[i]],
            [self.direction_x[i], self.direction_y[i], self.direction_z[i]],
        )
    }
}

impl HitQueue {
    /// Sets the hit at place `i`.
    #[inline(always)]
    pub fn put(&mut self, i: usize, hit: Hit) {
        self.t[i] = hit.t;
        self.primitive[i] = hit.primitive;
        if !self.u.is_empty() {
            self.u[i] = hit.u;
            self.v[i] = hit.v;
        }
    }
}

impl ShadowQueue {
    /// Origin, direction and length of the ray at place `i`.
    #[inline(always)]
    pub fn ray(&self, i: usize) -> ([f32; 3], [f32; 3], f32) {
        (
            [self.origin_x[i], self.origin_y[i], self.origin_z[i]],
            [self.direction_x[i], self.direction_y[i], self.direction_z[i]],
            self.distance[i],
        )
    }
}
