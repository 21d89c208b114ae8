//! Queues: structures of arrays, one table of columns each. A queue allocates only the columns whose feature the
//! plan asks for.
//!
//! A queue belongs to one worker, is allocated once and never grows. Columns are padded by [`PAD`] elements, so that
//! kernels may write whole vectors past the last element.

/// Elements behind the capacity of every column: the widest vector.
pub const PAD: usize = 16;

/// When a column is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Always.
    Always,
    /// In scenes where light crosses the surface of a dielectric.
    Transmission,
    /// In scenes with vertex normals.
    SmoothNormals,
    /// In scenes with lights to sample.
    LightSampling,
    /// With a reconstruction filter that has negative lobes.
    FilterWeights,
}

/// What a scene needs: decided by the plan, once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Requirements {
    /// See [`Needs::Transmission`].
    pub transmission: bool,
    /// See [`Needs::SmoothNormals`].
    pub smooth_normals: bool,
    /// See [`Needs::LightSampling`].
    pub light_sampling: bool,
    /// See [`Needs::FilterWeights`].
    pub filter_weights: bool,
}

impl Requirements {
    /// Is `need` met?
    pub fn have(self, need: Needs) -> bool {
        match need {
            Needs::Always => true,
            Needs::Transmission => self.transmission,
            Needs::SmoothNormals => self.smooth_normals,
            Needs::LightSampling => self.light_sampling,
            Needs::FilterWeights => self.filter_weights,
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
        pdf: f32, Always, "density of the direction over solid angle; 0: specular, or from the camera";
        eta_scale: f32, Transmission, "product of the squared relative indices crossed, for roulette";
        slot_depth: u32, Always, "slot (low 20 bits) and number of the next vertex (high 12 bits)";
    }
    /// Closest hits of the paths, by place in the path queue.
    HitQueue "hit" {
        t: f32, Always, "distance along the ray";
        primitive: u32, Always, "primitive, or none";
        u: f32, SmoothNormals, "barycentric weight of the second corner";
        v: f32, SmoothNormals, "barycentric weight of the third corner";
    }
    /// What stays in place while a path lives, by slot.
    SlotTable "slot" {
        seed: u32, Always, "random stream: hash of render seed, pixel and replicate";
        index: u32, Always, "random stream: number of the sample";
        place: u32, Always, "work unit (high bits) and pixel in its block (low 8 bits)";
        radiance_r: f32, Always, "radiance so far, red";
        radiance_g: f32, Always, "radiance so far, green";
        radiance_b: f32, Always, "radiance so far, blue";
        filter_weight: f32, FilterWeights, "1, or -1 in the negative lobes of the filter";
    }
    /// Shadow rays of one round, and what they add if nothing is in their way.
    ShadowQueue "shadow" {
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
    /// Lists of places, written by `material_sort`, and slots that are free or finished.
    OrderLists "order" {
        sorted: u32, Always, "places in the path queue, by material class";
        emitting: u32, Always, "places whose primitive emits";
        finished: u32, Always, "slots of paths that ended in this round";
        free: u32, Always, "slots without a path";
    }
}

/// Bits of [`PathQueue::slot_depth`] that hold the slot.
pub const SLOT_BITS: u32 = 20;
/// Largest number of paths of one worker.
pub const MAX_BATCH: usize = 1 << SLOT_BITS;
/// Largest `maxdepth` that fits beside the slot.
pub const MAX_DEPTH: u32 = (1 << (32 - SLOT_BITS)) - 2;
/// Bits of [`SlotTable::place`] that hold the pixel in its block.
pub const PIXEL_BITS: u32 = 8;

/// Bytes that a path takes in all queues together.
pub fn bytes_per_path(requirements: Requirements) -> usize {
    columns()
        .filter(|c| requirements.have(c.needs))
        .map(|c| c.bytes * if c.queue.ends_with("(twice)") { 2 } else { 1 })
        .sum()
}
