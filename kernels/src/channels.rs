//! Output channels: what a film holds of each pixel, radiance among others. One table; a channel is a row of it and a file
//! with what a film must know of it and the function that fills it, copied from the shape of `depth.rs`.
//!
//! A channel that is not asked for has no column, no kernel and no place in the film. Both engines fill channels through
//! [`fill_first_hit`], the wavefront in the kernel [`FirstHits`].

mod depth;

use crate::intersect::Hit;
use crate::isa::{Isa, Kernel};
use crate::lanes::{Real, Uint};
use crate::math::Vec3;
use crate::queue::{HitQueue, PAD, PathQueue, SLOT_BITS};
use crate::scene::{Camera, MISS, Projection};
use core::ops::Range;

/// What a film does with the values of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Adds them up, exactly.
    Sum {
        /// Whether a sample may be negative; otherwise one that is makes the sample invalid.
        signed: bool,
    },
    /// The value names a thing (the bits of a `u32`): the film keeps how much of the pixel each thing covers. Names are no
    /// numbers, and are not added up.
    Keyed,
}

/// What the sum of a pixel is divided by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Divisor {
    /// The filter weights of all samples of the pixel.
    FilterWeight,
    /// The number of samples of the pixel.
    Samples,
    /// The filter weights of those samples of the pixel that have a value.
    Coverage,
    /// The number of light paths in the whole film: for splats, which come to a pixel from anywhere.
    LightPaths,
}

/// A row of the table: what a film must know of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Row {
    /// Name, as `--aov` takes it; the layer in files.
    pub name: &'static str,
    /// Names of the components, at most [`MOST_COMPONENTS`].
    pub components: &'static [&'static str],
    /// What is done with the values.
    pub kind: Kind,
    /// What a pixel's sum is divided by.
    pub divisor: Divisor,
    /// Whether sums are kept apart by replicate, so that the error of the means can be told.
    pub replicated: bool,
    /// What it holds, and its unit.
    pub holds: &'static str,
}

/// Most components of a channel.
pub const MOST_COMPONENTS: usize = 4;

/// The values of a sample in one channel; those behind the last component do not count.
pub type Values<F> = [F; MOST_COMPONENTS];

macro_rules! channels {
    (
        path { $($(#[doc = $path_doc:literal])* $path:ident: $path_row:expr;)* }
        first_hit { $($(#[doc = $hit_doc:literal])* $hit:ident: $hit_row:expr, $fill:path;)* }
    ) => {
        /// The channels.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u8)]
        pub enum Channel {
            $($(#[doc = $path_doc])* $path,)*
            $($(#[doc = $hit_doc])* $hit,)*
        }

        impl Channel {
            /// All of them.
            pub const ALL: &'static [Channel] = &[$(Channel::$path,)* $(Channel::$hit,)*];
            /// Those that are filled where a camera ray first meets something.
            pub const FIRST_HIT: &'static [Channel] = &[$(Channel::$hit,)*];

            /// The row of the table.
            pub const fn row(self) -> &'static Row {
                match self {
                    $(Channel::$path => const { &$path_row },)*
                    $(Channel::$hit => const { &$hit_row },)*
                }
            }
        }

        /// The values of a channel of [`Channel::FIRST_HIT`]; [`NOTHING`] in the first one where nothing is hit, and in
        /// all channels that are filled otherwise.
        #[inline(always)]
        pub fn fill_first_hit<F: Real>(channel: Channel, first: &FirstHit<F>) -> Values<F> {
            let mut values = match channel {
                $(Channel::$path => [F::splat(NOTHING); MOST_COMPONENTS],)*
                $(Channel::$hit => $fill(first),)*
            };
            values[0] = F::select(first.missed, F::splat(NOTHING), values[0]);
            values
        }
    };
}

channels! {
    path {
        /// Radiance along the camera's rays.
        Radiance: Row {
            name: "radiance",
            components: &["R", "G", "B"],
            kind: Kind::Sum { signed: false },
            divisor: Divisor::FilterWeight,
            replicated: true,
            holds: "radiance, linear, with Rec. 709 primaries",
        };
    }
    first_hit {
        /// How far the first surface is.
        Depth: depth::ROW, depth::fill;
    }
}

/// Stands for the value of a sample that has none: it is not added up.
pub const NOTHING: f32 = f32::INFINITY;

impl Channel {
    /// The channel of that name.
    pub fn named(name: &str) -> Option<Channel> {
        Channel::ALL.iter().copied().find(|channel| channel.row().name == name)
    }
}

/// Channels beside radiance, which is always there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ChannelSet(u32);

impl ChannelSet {
    /// All that there are.
    pub fn all() -> Self {
        Channel::ALL.iter().fold(ChannelSet::default(), |set, &channel| set.with(channel))
    }
    /// With another one.
    pub fn with(self, channel: Channel) -> Self {
        ChannelSet(self.0 | if channel as u8 == Channel::Radiance as u8 { 0 } else { 1 << channel as u8 })
    }
    /// With all of another set.
    pub fn and(self, other: ChannelSet) -> Self {
        ChannelSet(self.0 | other.0)
    }
    /// Is it asked for?
    pub fn has(self, channel: Channel) -> bool {
        channel == Channel::Radiance || self.0 >> channel as u8 & 1 != 0
    }
    /// Radiance alone?
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }
    /// All of them, radiance first, in the order of the table.
    pub fn iter(self) -> impl Iterator<Item = Channel> {
        Channel::ALL.iter().copied().filter(move |&channel| self.has(channel))
    }
    /// Those that are filled where a camera ray first meets something, in the order of the table.
    pub fn first_hit(self) -> impl Iterator<Item = Channel> {
        Channel::FIRST_HIT.iter().copied().filter(move |&channel| self.has(channel))
    }
}

impl FromIterator<Channel> for ChannelSet {
    fn from_iter<T: IntoIterator<Item = Channel>>(channels: T) -> Self {
        channels.into_iter().fold(ChannelSet::default(), ChannelSet::with)
    }
}

/// Where a camera ray first meets something: what the channels are made of.
#[derive(Clone, Copy, Debug)]
pub struct FirstHit<F: Real> {
    /// Unit vector from the camera into the scene, perpendicular to the image.
    pub axis: Vec3<F>,
    /// Unit direction of the ray.
    pub direction: Vec3<F>,
    /// Distance along the ray.
    pub t: F,
    /// Primitive.
    pub primitive: F::Uint,
    /// Where nothing is met.
    pub missed: F::Mask,
}

impl<F: Real> FirstHit<F> {
    /// Of a ray, for all lanes.
    #[inline(always)]
    pub fn of(axis: [f32; 3], direction: Vec3<F>, hit: Hit) -> Self {
        let primitive = F::Uint::splat(hit.primitive);
        let missed = primitive.eq(F::Uint::splat(MISS));
        FirstHit { axis: Vec3::splat(axis), direction, t: F::splat(hit.t), primitive, missed }
    }
}

impl Camera {
    /// Unit vector into the scene, perpendicular to the image; 0 if the image is a line.
    pub fn axis(&self) -> [f32; 3] {
        if let Projection::Orthographic { axis } | Projection::Sphere { axis, .. } = self.projection() {
            return *axis;
        }
        let wide = |v: [f32; 3]| v.map(f64::from);
        let ([a, b, c], [d, e, f]) = (wide(self.right()), wide(self.down()));
        let normal = [b * f - c * e, c * d - a * f, a * e - b * d];
        let along = |v: [f64; 3]| v.iter().zip(&normal).map(|(x, n)| x * n).sum::<f64>();
        // `corner` is at camera z = 1: in front.
        let length = along(normal).sqrt().copysign(along(wide(self.corner())));
        if length == 0.0 { [0.0; 3] } else { normal.map(|x| (x / length) as f32) }
    }
}

/// The values of the paths in the channels that are asked for, by slot: they stay while a path lives, as
/// [`crate::queue::SlotTable`] does.
#[derive(Clone, Debug, Default)]
pub struct ChannelTable {
    channels: Vec<Channel>,
    /// A column a component.
    columns: Vec<Vec<f32>>,
}

impl ChannelTable {
    /// For as many slots. Without channels that a first hit fills, there are no columns.
    pub fn new(capacity: usize, channels: ChannelSet) -> Self {
        let channels: Vec<Channel> = channels.first_hit().collect();
        let components: usize = channels.iter().map(|channel| channel.row().components.len()).sum();
        ChannelTable { columns: vec![vec![NOTHING; capacity + PAD]; components], channels }
    }
    /// Is there nothing to fill?
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }
    /// The values of the path in a slot, a channel after the other.
    pub fn of(&self, slot: usize) -> impl Iterator<Item = Values<f32>> {
        let mut first = 0;
        self.channels.iter().map(move |channel| {
            let mut values = [0.0; MOST_COMPONENTS];
            let components = channel.row().components.len();
            for (value, column) in values.iter_mut().zip(&self.columns[first..first + components]) {
                *value = column[slot];
            }
            first += components;
            values
        })
    }
    /// Bytes a path, and the names of the columns.
    pub fn columns(channels: ChannelSet) -> impl Iterator<Item = (String, &'static str)> {
        let of_row =
            |row: &'static Row| row.components.iter().map(|c| (format!("slot.{}.{c}", row.name), row.holds));
        channels.first_hit().flat_map(move |channel| of_row(channel.row()))
    }
}

/// The kernel: fills the channels of paths that come from the camera.
pub struct FirstHits<'a> {
    /// See [`Camera::axis`].
    pub axis: [f32; 3],
    /// The paths.
    pub paths: &'a PathQueue,
    /// What they met.
    pub hits: &'a HitQueue,
    /// Places of the paths that come from the camera.
    pub range: Range<usize>,
    /// Receives the values.
    pub table: &'a mut ChannelTable,
}

impl Kernel for FirstHits<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) {
        first_hits::<I::Wide>(self.axis, self.paths, self.hits, self.range, self.table);
    }
}

#[inline(always)]
fn first_hits<F: Real>(
    axis: [f32; 3],
    paths: &PathQueue,
    hits: &HitQueue,
    range: Range<usize>,
    table: &mut ChannelTable,
) {
    let mut at = range.start;
    while at < range.end {
        let count = (range.end - at).min(F::LANES);
        let primitive = F::Uint::load(&hits.primitive, at);
        let load = |column: &[f32]| F::load(column, at);
        let first = FirstHit {
            axis: Vec3::splat(axis),
            direction: Vec3::new(
                load(&paths.direction_x),
                load(&paths.direction_y),
                load(&paths.direction_z),
            ),
            t: load(&hits.t),
            primitive,
            missed: primitive.eq(F::Uint::splat(MISS)),
        };
        let mut columns = table.columns.iter_mut();
        for &channel in &table.channels {
            let values = fill_first_hit(channel, &first);
            for (value, column) in
                values.into_iter().zip(columns.by_ref().take(channel.row().components.len()))
            {
                let lanes = value.to_array();
                for lane in 0..count {
                    column[(paths.slot_depth[at + lane] & ((1 << SLOT_BITS) - 1)) as usize] = lanes[lane];
                }
            }
        }
        at += count;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_sound() {
        for (k, channel) in Channel::ALL.iter().enumerate() {
            let row = channel.row();
            assert_eq!(*channel as usize, k);
            assert!((1..=MOST_COMPONENTS).contains(&row.components.len()), "{}", row.name);
            assert_eq!(Channel::named(row.name), Some(*channel), "names are unique");
            if row.kind == Kind::Keyed {
                assert_eq!((row.components.len(), row.divisor), (1, Divisor::FilterWeight));
            }
        }
        assert!(Channel::ALL.len() <= 32);
        assert_eq!(ChannelSet::default().iter().collect::<Vec<_>>(), [Channel::Radiance]);
        assert_eq!(ChannelSet::all().iter().count(), Channel::ALL.len());
    }

    /// A mirror image of the camera looks the same way.
    #[test]
    fn the_axis_points_into_the_scene() {
        use crate::scene::{CameraParts, Filter, FilterAxis};
        let filter = || Filter::new([FilterAxis::constant(0.5), FilterAxis::constant(0.5)]);
        for mirror in [1.0, -1.0, 0.0] {
            let camera = Camera::new(CameraParts {
                origin: [0.0; 3],
                corner: [-2.0 * mirror, 1.0, 3.0],
                right: [0.1 * mirror, 0.0, 0.0],
                down: [0.0, -0.2, 0.0],
                lens: None,
                filter: filter().unwrap(),
            })
            .unwrap();
            let expected = if mirror == 0.0 { [0.0; 3] } else { [0.0, 0.0, 1.0] };
            assert_eq!(camera.axis(), expected);
        }
    }
}
