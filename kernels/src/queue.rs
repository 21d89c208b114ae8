//! Queues: structures of arrays, one table of columns each. A queue allocates only the columns whose feature the
//! plan asks for.
//!
//! A queue belongs to one worker, is allocated once and never grows. Columns are padded by [`PAD`] elements, so that
//! kernels may write whole vectors past the last element.

use crate::channels::{ChannelSet, ChannelTable};
use crate::lanes::{Real, Uint};
use crate::sampler::Stream;
use crate::sampler::dimension::{BANK, PER_VERTEX, VERTICES};

/// Elements behind the capacity of every column: the widest vector.
pub const PAD: usize = 16;

/// When a column is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Always.
    Always,
    /// In scenes where light crosses the surface of a dielectric.
    Transmission,
    /// In scenes with vertex normals, or textures.
    Barycentric,
    /// In scenes with lights to sample.
    LightSampling,
    /// With a reconstruction filter that has negative lobes.
    FilterWeights,
    /// In scenes with mixtures of materials.
    Mixtures,
    /// In scenes with instances: no scene has any yet, copies stand for them.
    Instances,
}

/// What a scene needs: decided by the plan, once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Requirements {
    /// See [`Needs::Transmission`].
    pub transmission: bool,
    /// There are vertex normals.
    pub smooth_normals: bool,
    /// There are textured materials.
    pub textures: bool,
    /// There are shapes with an opacity.
    pub cutouts: bool,
    /// See [`Needs::LightSampling`].
    pub light_sampling: bool,
    /// See [`Needs::FilterWeights`].
    pub filter_weights: bool,
    /// See [`Needs::Mixtures`].
    pub mixtures: bool,
    /// See [`Needs::Instances`].
    pub instances: bool,
    /// What the film holds beside radiance.
    pub channels: ChannelSet,
}

impl Requirements {
    /// Is `need` met?
    pub fn have(self, need: Needs) -> bool {
        match need {
            Needs::Always => true,
            Needs::Transmission => self.transmission,
            Needs::Barycentric => self.smooth_normals || self.textures || self.cutouts,
            Needs::LightSampling => self.light_sampling,
            Needs::FilterWeights => self.filter_weights,
            Needs::Mixtures => self.mixtures,
            Needs::Instances => self.instances,
        }
    }
}

/// A column as the plan prints it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Queue and name.
    pub queue: &'static str,
    /// Name.
    pub name: &'static str,
    /// Bytes an element.
    pub bytes: usize,
    /// The feature that it needs.
    pub needs: Needs,
    /// What it holds.
    pub holds: &'static str,
}

macro_rules! queues {
    ($($(#[doc = $doc:literal])* $queue:ident $label:literal {
        $($name:ident: $type:ty, $needs:ident, $holds:literal;)*
    })*) => {
        $(
            $(#[doc = $doc])*
            #[derive(Clone, Debug, Default)]
            pub struct $queue {
                /// Elements in use.
                pub len: usize,
                capacity: usize,
                $(#[doc = $holds] pub $name: Vec<$type>,)*
            }

            impl $queue {
                /// The table of columns.
                pub const COLUMNS: &'static [Column] = &[$(Column {
                    queue: $label,
                    name: stringify!($name),
                    bytes: size_of::<$type>(),
                    needs: Needs::$needs,
                    holds: $holds,
                }),*];

                /// Room for `capacity` elements, in the columns that are needed.
                pub fn new(capacity: usize, requirements: Requirements) -> Self {
                    $queue {
                        len: 0,
                        capacity,
                        $($name: if requirements.have(Needs::$needs) {
                            vec![Default::default(); capacity + PAD]
                        } else {
                            Vec::new()
                        },)*
                    }
                }
                /// How many elements fit.
                pub fn capacity(&self) -> usize {
                    self.capacity
                }
            }
        )*

        /// All columns of all queues: what a path costs in memory.
        pub fn columns() -> impl Iterator<Item = &'static Column> {
            [$($queue::COLUMNS),*].into_iter().flatten()
        }
    };
}

queues! {
    /// Paths between two vertices: a ray, and what it carries. Two of them, read and written in turn.
    PathQueue "path (twice)" {
        origin_x: f32, Always, "ray origin, x";
        origin_y: f32, Always, "ray origin, y";
        origin_z: f32, Always, "ray origin, z";
        direction_x: f32, Always, "unit ray direction, x";
        direction_y: f32, Always, "unit ray direction, y";
        direction_z: f32, Always, "unit ray direction, z";
        throughput_r: f32, Always, "throughput, red";
        throughput_g: f32, Always, "throughput, green";
        throughput_b: f32, Always, "throughput, blue";
        pdf: f32, LightSampling, "density of the direction over solid angle; 0: specular, or from the camera";
        slot_depth: u32, Always, "slot (low 18 bits) and number of the next vertex (high 14 bits)";
    }
    /// Closest hits of the paths, by place in the path queue.
    HitQueue "hit" {
        t: f32, Always, "distance along the ray";
        primitive: u32, Always, "primitive, or none";
        u: f32, Barycentric, "barycentric weight of the second corner";
        v: f32, Barycentric, "barycentric weight of the third corner";
        material: u32, Mixtures, "class and row of the material that was chosen";
        weight_r: f32, Mixtures, "what the material's light is multiplied by, red";
        weight_g: f32, Mixtures, "what the material's light is multiplied by, green";
        weight_b: f32, Mixtures, "what the material's light is multiplied by, blue";
        instance: u32, Instances, "instance that the primitive is a part of";
    }
    /// What stays in place while a path lives, by slot.
    SlotTable "slot" {
        seed: u32, Always, "random stream: hash of render seed, pixel and replicate";
        place: u32, Always, "work unit, sample in it (4 bits), pixel in its block (low 8 bits)";
        radiance_r: f32, Always, "radiance so far, red";
        radiance_g: f32, Always, "radiance so far, green";
        radiance_b: f32, Always, "radiance so far, blue";
        eta_scale: f32, Transmission, "product of the squared relative indices crossed, for roulette";
        filter_weight: f32, FilterWeights, "1, or -1 in the negative lobes of the filter";
    }
    /// Shadow rays of some paths of a round, and what they add if nothing is in their way.
    ShadowQueue "shadow (some)" {
        origin_x: f32, LightSampling, "ray origin, x";
        origin_y: f32, LightSampling, "ray origin, y";
        origin_z: f32, LightSampling, "ray origin, z";
        direction_x: f32, LightSampling, "unit ray direction, x";
        direction_y: f32, LightSampling, "unit ray direction, y";
        direction_z: f32, LightSampling, "unit ray direction, z";
        distance: f32, LightSampling, "how far to look";
        radiance_r: f32, LightSampling, "radiance that it adds, red";
        radiance_g: f32, LightSampling, "radiance that it adds, green";
        radiance_b: f32, LightSampling, "radiance that it adds, blue";
        slot: u32, LightSampling, "slot of the path";
    }
    /// What is to be done with which path. There are as many free slots and paths together as the pool has places, so
    /// both lists share a column: the free slots are in front.
    OrderLists "order" {
        list: u32, Always, "slots without a path, then places in the path queue, by what the paths met";
        key: u8, Always, "what the path met, by place";
    }
}

/// Bits of [`PathQueue::slot_depth`] that hold the slot.
pub const SLOT_BITS: u32 = 18;
/// Largest number of paths of one worker.
pub const MAX_BATCH: usize = 1 << SLOT_BITS;
/// Largest `maxdepth` that fits beside the slot: the number of a vertex goes one further.
pub const MAX_DEPTH: u32 = (1 << (32 - SLOT_BITS)) - 2;
const _: () = assert!(
    MAX_DEPTH * PER_VERTEX + VERTICES < BANK,
    "dimensions of the first bank must not reach the second"
);
/// Bits of [`SlotTable::place`] that hold the pixel in its block.
pub const PIXEL_BITS: u32 = 8;
/// Bits of [`SlotTable::place`] above them that hold the sample in its work unit.
pub const SAMPLE_BITS: u32 = 4;

/// A path's place in the film, as [`SlotTable::place`] has it: number of the work unit, sample in it, pixel in its
/// block.
pub fn place(unit: u32, sample: u32, pixel: u32) -> u32 {
    debug_assert!(sample >> SAMPLE_BITS == 0 && pixel >> PIXEL_BITS == 0);
    (unit << SAMPLE_BITS | sample) << PIXEL_BITS | pixel
}

/// Work unit and pixel of a [`place`].
pub fn unit_and_pixel(place: u32) -> (usize, usize) {
    ((place >> (PIXEL_BITS + SAMPLE_BITS)) as usize, (place & ((1 << PIXEL_BITS) - 1)) as usize)
}

impl SlotTable {
    /// Random numbers of the paths in some slots; `first_sample` is the index of the first sample of each work unit.
    ///
    /// # Safety
    /// The slots are below the capacity of the table, and their places name units of `first_sample`.
    #[inline(always)]
    pub unsafe fn stream<U: Uint>(&self, first_sample: &[u32], slot: U) -> Stream<U> {
        // SAFETY: the caller's promise.
        unsafe {
            let place = U::gather(&self.place, slot);
            let first = U::gather(first_sample, place.shr::<{ PIXEL_BITS + SAMPLE_BITS }>());
            let sample = place.shr::<PIXEL_BITS>() & U::splat((1 << SAMPLE_BITS) - 1);
            Stream { seed: U::gather(&self.seed, slot), index: first + sample }
        }
    }
}

/// The lanes of a list from place `at`: indices (the last lanes repeat the first one if too few are left), and how
/// many count.
#[inline(always)]
pub(crate) fn list_lanes<F: Real>(list: &[u32], at: usize) -> (F::Uint, usize) {
    let count = (list.len() - at).min(F::LANES);
    if count == F::LANES {
        return (F::Uint::load(list, at), count);
    }
    let mut lanes = [list[at]; 16];
    lanes[..count].copy_from_slice(&list[at..]);
    (F::Uint::load(&lanes, 0), count)
}

/// Most shadow rays that wait at a time: light sampling follows shading in pieces, so that the rays are still in the
/// first-level cache and take no memory for each path.
pub const SHADOW_RAYS: usize = 512;

/// Bytes that a path takes in all queues together, and bytes of the queue of shadow rays of a worker.
pub fn bytes_per_path(requirements: Requirements) -> (usize, usize) {
    let (mut path, mut shadow) = (0, 0);
    for column in columns().filter(|c| requirements.have(c.needs)) {
        match column.queue {
            "path (twice)" => path += 2 * column.bytes,
            "shadow (some)" => shadow += SHADOW_RAYS * column.bytes,
            _ => path += column.bytes,
        }
    }
    path += ChannelTable::columns(requirements.channels).count() * size_of::<f32>();
    (path, shadow)
}
