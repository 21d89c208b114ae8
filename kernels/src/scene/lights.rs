//! Lights: the table of their kinds, and how each kind is sampled: a direction towards it, the density of that
//! direction, and the same density for a direction that was found otherwise.
//!
//! To add a kind: a file beside `goniometric.rs`, and a line in `light_kinds!`.

pub(crate) mod alias;
mod cells;
mod cylinder;
mod environment_map;
pub mod goniometric;
mod picture;
mod stretched_spot;
mod table;

pub use cylinder::CylinderRow;
pub use environment_map::{EnvironmentMap, EnvironmentParts, Portal, SkyMapping};
pub use goniometric::GoniometricRow;
pub use picture::{LightPicture, PictureMapping};
pub use stretched_spot::StretchedSpotRow;
pub use table::{Emitter, LightList, LightTable};

use crate::lanes::{Mask, Real, Uint};
use crate::math::{Frame, Rgb, Vec3, uniform_disk, uniform_sphere};
use crate::scene::rows::{NoRow, Row, row};

/// The table of kinds. A line: kind, its bit, its columns, its name in plans. Kinds that are sampled by one function
/// stand together, behind what they are:
///
/// | | |
/// |---|---|
/// | `surface(sample, pdf)` | a surface that emits: sampled, and met by paths |
/// | `delta(sample)` | without extent: sampled, never met |
/// | `chance()` | a surface that emits and cannot be sampled |
/// | `sky()` | light from infinity: sampled ([`LightTable::sample_map`]), and met by paths that leave the scene |
macro_rules! light_kinds {
    ($use:ident) => {
        $use! {
            surface(sample_sphere, pdf_of_sphere) {
                /// Full sphere, sampled by the cone it fills; from inside left to the directions of the BSDF.
                Sphere SPHERE SphereRow "sphere (by solid angle)";
            }
            surface(sample_sphere_area, pdf_of_sphere_area) {
                /// Full sphere, sampled uniformly over its surface: for comparison.
                SphereArea SPHERE_AREA SphereRow "sphere (by area)";
            }
            surface(sample_flat, pdf_of_flat) {
                /// Triangle, sampled uniformly over its surface.
                Triangle TRIANGLE FlatRow "triangle";
                /// Full disk (or ellipse), sampled uniformly over its surface.
                Disk DISK FlatRow "disk";
                /// Triangle that shows a picture, sampled uniformly over its surface.
                PictureTriangle PICTURE_TRIANGLE FlatPictureRow "triangle with a picture";
            }
            surface(cylinder::sample, cylinder::pdf) {
                /// Round cylinder without ends, sampled uniformly over its surface.
                Cylinder CYLINDER CylinderRow "cylinder";
            }
            delta(sample_point) {
                /// Point.
                Point POINT PointRow "point";
                /// Point with a cone.
                Spot SPOT PointRow "spot";
            }
            delta(goniometric::sample) {
                /// Point that shines more in some directions than in others.
                Goniometric GONIOMETRIC GoniometricRow "goniometric";
            }
            delta(stretched_spot::sample) {
                /// Point with a cone that is round in a stretched space.
                StretchedSpot STRETCHED_SPOT StretchedSpotRow "stretched spot";
            }
            delta(picture::sample) {
                /// Point that shines through a picture.
                PicturePoint PICTURE_POINT PicturePointRow "point with a picture";
            }
            delta(sample_distant) {
                /// Parallel light.
                Distant DISTANT DistantRow "distant";
            }
            sky() {
                /// Picture of the sky.
                Environment ENVIRONMENT EnvironmentRow "environment map";
            }
            chance() {
                /// Emitting surface that cannot be sampled (a clipped or stretched sphere, a stretched cylinder): found by chance only.
                Unsampled UNSAMPLED NoRow "surface found by chance only";
            }
        }
    };
}

/// The sets of kinds that engines are compiled for, the smaller ones first; and for each the one that serves where
/// engines are compiled for few.
macro_rules! light_sets {
    ($use:ident) => {
        $use! {
            /// No lights, and no light sampling.
            NoLights = 0, NoLights;
            /// Spheres, sampled by solid angle.
            Spheres = kind::SPHERE, AllLights;
            /// All kinds.
            AllLights = kind::ALL, AllLights;
        }
    };
}

macro_rules! kinds {
    ($($class:ident($($function:path),*) {
        $($(#[doc = $doc:literal])* $kind:ident $bit:ident $row:ident $name:literal;)*
    })*) => {
        /// What kind of light.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u32)]
        pub enum LightKind {
            $($($(#[doc = $doc])* $kind,)*)*
        }

        /// Kinds of light, as bits, so that a set of them is a constant of a kernel.
        pub mod kind {
            use super::LightKind;
            $($($(#[doc = $doc])* pub const $bit: u32 = LightKind::$kind.bit();)*)*
            /// All kinds.
            pub const ALL: u32 = 0 $($(| $bit)*)*;
            /// Those that light sampling can choose.
            pub const SAMPLED: u32 = 0 $($(| is_sampled!($class $bit))*)*;
            /// Those that paths can meet.
            pub const SURFACES: u32 = 0 $($(| is_surface!($class $bit))*)*;
        }

        impl LightKind {
            /// All of them.
            pub const ALL: [LightKind; kind::ALL.count_ones() as usize] = [$($(LightKind::$kind),*),*];
            /// One of [`kind`].
            pub const fn bit(self) -> u32 {
                1 << self as u32
            }
            /// Name for plans.
            pub fn name(self) -> &'static str {
                match self {
                    $($(LightKind::$kind => $name,)*)*
                }
            }
        }

        /// A light of some kind, with the numbers that its kind needs.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum Light {
            $($($(#[doc = $doc])* $kind($row),)*)*
        }

        impl Light {
            /// Its kind.
            pub fn kind(&self) -> LightKind {
                match self {
                    $($(Light::$kind(_) => LightKind::$kind,)*)*
                }
            }
            /// The numbers of its row, behind those that every light has.
            fn numbers(&self) -> &[f32] {
                match self {
                    $($(Light::$kind(row) => row.numbers(),)*)*
                }
            }
        }

        /// Numbers of the longest row, behind those that every light has.
        const LONGEST: usize = {
            let (mut longest, lengths) = (0, [$($($row::LEN),*),*]);
            let mut k = 0;
            while k < lengths.len() {
                longest = if lengths[k] > longest { lengths[k] } else { longest };
                k += 1;
            }
            longest
        };

        /// Samples a direction from `origin` towards the light, with `u` uniform in the unit square. `L` holds every
        /// kind that occurs.
        #[inline(always)]
        pub fn sample<F: Real, L: LightKinds>(
            light: &LightRow<F>,
            origin: Vec3<F>,
            u: [F; 2],
        ) -> LightSample<F> {
            let mut out = LightSample::none();
            $(sample_kinds!($class($($function),*) [$($bit)*] L light origin u out);)*
            // Spheres that are sampled by solid angle are met.
            if L::KINDS & !kind::SPHERE != 0 {
                out.delta = out.delta | light.hidden();
            }
            out
        }

        /// Density with which [`sample`] takes the direction of a ray that met the light at distance `t` with the
        /// geometric normal `normal`, from `origin` over solid angle, without the probability of choosing the light.
        #[inline(always)]
        pub fn pdf<F: Real, L: LightKinds>(
            light: &LightRow<F>,
            origin: Vec3<F>,
            direction: Vec3<F>,
            t: F,
            normal: Vec3<F>,
        ) -> F {
            let mut pdf = F::zero();
            $(pdf_of_kinds!($class($($function),*) [$($bit)*] L light origin direction t normal pdf);)*
            pdf
        }
    };
}

macro_rules! is_sampled {
    (chance $bit:ident) => {
        0
    };
    ($class:ident $bit:ident) => {
        $bit
    };
}

macro_rules! is_surface {
    (delta $bit:ident) => {
        0
    };
    (sky $bit:ident) => {
        0
    };
    ($class:ident $bit:ident) => {
        $bit
    };
}

/// Samples the lanes of some kinds, if any can occur.
macro_rules! sample_kinds {
    (chance() $($rest:tt)*) => {};
    (sky() $($rest:tt)*) => {};
    ($class:ident($sample:path $(, $pdf:path)?) [$($bit:ident)*] $L:ident $light:ident $origin:ident $u:ident $out:ident) => {
        let here = const { 0 $(| kind::$bit)* };
        if $L::KINDS & here != 0 {
            let alone = $L::KINDS & !here == 0;
            let lanes = if alone { F::Mask::from_bits(u32::MAX) } else { F::Mask::from_bits(0) $(| $light.is(kind::$bit))* };
            if alone || lanes.any() {
                $out.merge(lanes, $sample($light, $origin, $u));
            }
        }
    };
}

/// Takes over the density of the lanes of some kinds, if any can occur.
macro_rules! pdf_of_kinds {
    (surface($sample:path, $pdf:path) [$($bit:ident)*] $L:ident $light:ident $origin:ident $direction:ident $t:ident $normal:ident $out:ident) => {
        if $L::KINDS & const { 0 $(| kind::$bit)* } != 0 {
            let lanes = F::Mask::from_bits(0) $(| $light.is(kind::$bit))*;
            if lanes.any() {
                $out = F::select(lanes, $pdf($light, $origin, $direction, $t, $normal), $out);
            }
        }
    };
    ($class:ident $($rest:tt)*) => {};
}

light_kinds!(kinds);

/// Kinds of lights to sample, as a type: what a kernel that depends on nothing else is compiled for.
pub trait LightKinds: Copy + Send + Sync + 'static {
    /// Kinds ([`kind`]), or more; 0: none, and no light sampling.
    const KINDS: u32;
    /// More of them, for where kernels are compiled for few sets.
    type General: LightKinds;
}

/// What is to be done with a set of kinds as a type.
pub trait WithLights {
    /// What it returns.
    type Output;
    /// Does it.
    fn run<L: LightKinds>(self) -> Self::Output;
}

macro_rules! sets {
    ($($(#[doc = $doc:literal])* $set:ident = $kinds:expr, $general:ident;)*) => {
        $(
            $(#[doc = $doc])*
            #[derive(Clone, Copy, Debug)]
            pub struct $set;
            impl LightKinds for $set {
                const KINDS: u32 = $kinds;
                type General = $general;
            }
        )*

        /// Does something with the smallest set that engines are compiled for and that holds some kinds.
        #[inline(always)]
        pub fn with_lights<W: WithLights>(kinds: u32, work: W) -> W::Output {
            $(
                if kinds & !$set::KINDS == 0 {
                    return work.run::<$set>();
                }
            )*
            // Bits of no kind.
            work.run::<AllLights>()
        }
    };
}
light_sets!(sets);

row! {
    /// The front of every row.
    Common CommonLanes {
        /// Radiance or intensity.
        radiance: [f32; 3],
        /// Probability of being chosen.
        probability: f32,
        /// 1 or 0; of lights that no ray meets 2 or -1.
        two_sided: f32,
    }
}

row! {
    /// A sphere.
    SphereRow SphereLanes {
        /// Centre.
        centre: [f32; 3],
        /// Signed radius: negative, the inside emits.
        radius: f32,
    }
}

row! {
    /// A triangle or a disk.
    FlatRow FlatLanes {
        /// Corner of a triangle, centre of a disk.
        corner: [f32; 3],
        /// Edge to the second corner, first half axis.
        first: [f32; 3],
        /// Edge to the third corner, second half axis.
        second: [f32; 3],
        /// Area.
        area: f32,
        /// Unit normal on the emitting side. A column of its own: in single precision the cross product of the edges
        /// loses it for slender triangles, and its square leaves the range of numbers for large and small ones.
        normal: [f32; 3],
    }
}

row! {
    /// A triangle that shows a picture. It begins as a [`FlatRow`].
    FlatPictureRow FlatPictureLanes {
        /// See [`FlatRow`].
        corner: [f32; 3],
        /// See [`FlatRow`].
        first: [f32; 3],
        /// See [`FlatRow`].
        second: [f32; 3],
        /// See [`FlatRow`].
        area: f32,
        /// See [`FlatRow`].
        normal: [f32; 3],
        /// Gradient of the coordinate u over the surface.
        along_u: [f32; 3],
        /// Gradient of the coordinate v.
        along_v: [f32; 3],
        /// u at the corner.
        u: f32,
        /// v at the corner.
        v: f32,
        /// Number of the picture.
        number: f32,
    }
}

row! {
    /// A point that shines through a picture.
    PicturePointRow PicturePointLanes {
        /// Where.
        position: [f32; 3],
        /// Rows of the matrix that takes directions of the world to the light's space.
        x: [f32; 3],
        /// See `x`.
        y: [f32; 3],
        /// See `x`.
        z: [f32; 3],
        /// Half the width of a projection at distance 1.
        half_width: f32,
        /// Half the height.
        half_height: f32,
        /// Number of the picture.
        number: f32,
    }
}

row! {
    /// A point, perhaps with a cone.
    PointRow PointLanes {
        /// Where.
        position: [f32; 3],
        /// Unit axis of the cone, away from the light.
        axis: [f32; 3],
        /// Cosine of the angle where it begins to fade.
        cos_falloff_start: f32,
        /// Cosine of the angle where it is dark.
        cos_total_width: f32,
        /// How it fades, one of [`fade`].
        fade: f32,
    }
}

/// How a spot light fades between its two cosines, of which x in \[0, 1\] is the way from the dark one to the bright.
pub mod fade {
    /// x^2 (3 - 2 x), as pbrt-v4 has it.
    pub const SMOOTHSTEP: f32 = 0.0;
    /// x^4, as pbrt-v3 has it.
    pub const FOURTH_POWER: f32 = 1.0;
}

row! {
    /// Parallel light.
    DistantRow DistantLanes {
        /// Unit direction towards it.
        direction: [f32; 3],
    }
}

row! {
    /// A picture of the sky, which has a table of its own.
    EnvironmentRow EnvironmentLanes {
        /// Its number among them.
        number: f32,
    }
}

/// Numbers that every light has.
const COMMON: usize = Common::LEN;
/// Place of the probability in a row.
const PROBABILITY: usize = core::mem::offset_of!(Common, probability) / size_of::<f32>();
/// Place of the word that says whether it shines on both sides.
const TWO_SIDED: usize = core::mem::offset_of!(Common, two_sided) / size_of::<f32>();
/// What stands there of a light that no ray meets and that shines on one side.
const HIDDEN: f32 = -1.0;
/// And on both.
const HIDDEN_TWO_SIDED: f32 = 2.0;

/// The numbers of one light a lane.
#[derive(Clone, Copy)]
pub struct LightRow<'a, F: Real> {
    rows: &'a [f32],
    pictures: &'a [LightPicture],
    first: F::Uint,
    kind: F::Uint,
}

impl<'a, F: Real> LightRow<'a, F> {
    /// # Safety
    /// `kinds` has an element and `rows` `stride` numbers for each light, and every lane of `id` is one; behind them all
    /// are [`LONGEST`] more numbers.
    #[inline(always)]
    unsafe fn new(
        kinds: &'a [u32],
        rows: &'a [f32],
        pictures: &'a [LightPicture],
        stride: u32,
        id: F::Uint,
    ) -> Self {
        // SAFETY: the caller's promise.
        let kind = unsafe { F::Uint::gather(kinds, id) };
        LightRow { rows, pictures, first: id * F::Uint::splat(stride), kind }
    }
    #[inline(always)]
    fn common(&self) -> CommonLanes<'a, F> {
        // SAFETY: every row begins so, and exists by the promise made to `new`.
        unsafe { Common::lanes(self.rows, self.first) }
    }
    /// The columns of a kind. In lanes of other kinds they hold numbers of those.
    #[inline(always)]
    fn of<R: Row>(&self) -> R::Lanes<'a, F> {
        const { assert!(R::LEN <= LONGEST) };
        // SAFETY: behind the last row there is room for the longest, by the promise made to `new`.
        unsafe { R::lanes(self.rows, self.first + F::Uint::splat(COMMON as u32)) }
    }
    #[inline(always)]
    fn is(&self, kind: u32) -> F::Mask {
        self.kind.eq(F::Uint::splat(kind))
    }
    /// Radiance or intensity.
    #[inline(always)]
    pub fn radiance(&self) -> Rgb<F> {
        let Vec3 { x: r, y: g, z: b } = self.common().radiance();
        Rgb { r, g, b }
    }
    /// Probability of being chosen.
    #[inline(always)]
    pub fn probability(&self) -> F {
        self.common().probability()
    }
    #[inline(always)]
    fn two_sided(&self) -> F::Mask {
        self.common().two_sided().gt(F::zero())
    }
    /// Does no ray meet it?
    #[inline(always)]
    fn hidden(&self) -> F::Mask {
        let two_sided = self.common().two_sided();
        two_sided.lt(F::zero()) | two_sided.gt(F::one())
    }
    /// Emitted radiance towards `-direction` for a ray that meets the surface at `origin + t direction`, where the normal
    /// is `normal`: on the side of the normal, or on both.
    #[inline(always)]
    pub fn emitted(&self, normal: Vec3<F>, origin: Vec3<F>, direction: Vec3<F>, t: F) -> Rgb<F> {
        let seen = normal.dot(direction).lt(F::zero()) | self.two_sided();
        let mut radiance = self.radiance();
        if !self.pictures.is_empty() {
            radiance = radiance * picture::shown(self, direction.mul_add(t, origin));
        }
        Rgb::select(seen, radiance, Rgb::zero())
    }
}

/// A direction towards a light.
#[derive(Clone, Copy)]
pub struct LightSample<F: Real> {
    /// Unit direction from the reference point.
    pub direction: Vec3<F>,
    /// How far a shadow ray has to look: just short of the light.
    pub distance: F,
    /// Radiance that arrives if nothing is in between; for a light without extent the irradiance on a plane that
    /// faces it.
    pub radiance: Rgb<F>,
    /// Density over solid angle, without the probability of choosing the light; 1 for lights without extent.
    pub pdf: F,
    /// Lights without extent: no other strategy finds them.
    pub delta: F::Mask,
    /// Lanes in which there is something to see.
    pub valid: F::Mask,
}

impl<F: Real> LightSample<F> {
    /// Nothing to see.
    #[inline(always)]
    fn none() -> Self {
        LightSample {
            direction: Vec3::new(F::zero(), F::zero(), F::one()),
            distance: F::zero(),
            radiance: Rgb::zero(),
            pdf: F::one(),
            delta: F::Mask::from_bits(0),
            valid: F::Mask::from_bits(0),
        }
    }
    /// Takes over some lanes.
    #[inline(always)]
    fn merge(&mut self, lanes: F::Mask, with: LightSample<F>) {
        self.direction = Vec3::select(lanes, with.direction, self.direction);
        self.distance = F::select(lanes, with.distance, self.distance);
        self.radiance = Rgb::select(lanes, with.radiance, self.radiance);
        self.pdf = F::select(lanes, with.pdf, self.pdf);
        self.delta = self.delta | (lanes & with.delta);
        self.valid = self.valid | (lanes & with.valid);
    }
}

/// Shadow rays stop this much short of the light, relative to the distance, so as not to meet it: where nothing better is
/// known, and at most.
const SHADOW_SHORTENING: f64 = 1e-4;

/// The largest coordinate, without its sign.
#[inline(always)]
fn largest<F: Real>(v: Vec3<F>) -> F {
    v.x.abs().max(v.y.abs()).max(v.z.abs())
}

/// What rounding does to the distance of a light that a ray meets squarely: some units in the last place of the distance
/// and of the coordinates of both ends, the one of which is twice off the surface that the ray leaves.
#[inline(always)]
fn blur<F: Real>(origin: Vec3<F>, point: Vec3<F>, distance: F) -> F {
    let sum = distance + largest(point) + largest(origin) * F::lit(2.0);
    sum * F::lit(12.0 * f32::EPSILON as f64)
}

/// Half of a cone's opening: `(1 - cos, sin^2)` of the largest angle under which a sphere of radius `r` is seen from
/// the distance `d2.sqrt()`, without cancellation: 1 - sqrt(1 - x) = x / (1 + sqrt(1 - x)).
#[inline(always)]
fn cone<F: Real>(r2: F, d2: F) -> (F, F) {
    let sin2 = (r2 / d2).min(F::one());
    (sin2 / (F::one() + (F::one() - sin2).max(F::zero()).sqrt()), sin2)
}

/// How much shorter still a shadow ray towards a sphere has to be. The square of half the chord is known to some units
/// in the last place of r^2, so half the chord itself to eps r^2 over it: little where the ray meets the sphere
/// squarely, sqrt(eps) r where it grazes. (A constant share of r would let a large sphere shine through whatever is
/// close to it.)
#[inline(always)]
fn sphere_slack<F: Real>(radius: F, half_chord: F) -> F {
    let r = radius.abs();
    (F::lit(32.0 * f32::EPSILON as f64) * r * r / half_chord).min(F::lit(5e-4) * r)
}

/// Density of [`sample`]'s spheres over solid angle: uniform in the cone from outside, none from inside.
#[inline(always)]
fn sphere_pdf<F: Real>(r2: F, d2: F) -> F {
    let (one_minus_cos, _) = cone(r2, d2);
    let outside = (F::lit(core::f64::consts::TAU) * one_minus_cos).recip();
    F::select(d2.gt(r2), outside, F::zero())
}

/// Density of the cone's directions.
#[inline(always)]
fn pdf_of_sphere<F: Real>(
    light: &LightRow<F>,
    origin: Vec3<F>,
    _direction: Vec3<F>,
    _t: F,
    _normal: Vec3<F>,
) -> F {
    let sphere = light.of::<SphereRow>();
    let radius = sphere.radius();
    let d2 = (sphere.centre() - origin).length2();
    sphere_pdf(radius * radius, d2)
}

/// Density of points that are uniform over the surface of a sphere.
#[inline(always)]
fn pdf_of_sphere_area<F: Real>(
    light: &LightRow<F>,
    _origin: Vec3<F>,
    direction: Vec3<F>,
    t: F,
    normal: Vec3<F>,
) -> F {
    let radius = light.of::<SphereRow>().radius();
    let area = F::lit(4.0 * core::f64::consts::PI) * radius * radius;
    t * t / (normal.dot(direction).abs() * area)
}

/// Density of points that are uniform over a triangle or a disk.
#[inline(always)]
fn pdf_of_flat<F: Real>(
    light: &LightRow<F>,
    _origin: Vec3<F>,
    direction: Vec3<F>,
    t: F,
    normal: Vec3<F>,
) -> F {
    t * t / (normal.dot(direction).abs() * light.of::<FlatRow>().area())
}

/// Uniform in the cone of directions that meet the sphere.
///
/// From inside, every direction meets it: the light is a sky, and the directions to sample are those of the BSDF,
/// whose next ray finds it with weight 1. Sampling all directions uniformly and weighing the two was tried: 0.75 to
/// 0.81 of the efficiency, for about the same error and one more ray a vertex.
#[inline(always)]
fn sample_sphere<F: Real>(light: &LightRow<F>, origin: Vec3<F>, u: [F; 2]) -> LightSample<F> {
    let sphere = light.of::<SphereRow>();
    let to_centre = sphere.centre() - origin;
    let radius = sphere.radius();
    let r2 = radius * radius;
    let d2 = to_centre.length2();
    let (one_minus_cos_max, _) = cone(r2, d2);
    // 1 - cos is uniform in the cone; sin^2 = (1 - cos)(1 + cos) does not cancel.
    let one_minus_cos = u[0] * one_minus_cos_max;
    let sin2 = one_minus_cos * (F::lit(2.0) - one_minus_cos);
    let (sin_phi, cos_phi) = u[1].sin_cos_turns();
    let sin = sin2.max(F::zero()).sqrt();
    let local = Vec3::new(sin * cos_phi, sin * sin_phi, F::one() - one_minus_cos);
    let axis = to_centre.scale(d2.sqrt().recip());
    let direction = Frame::from_normal(axis).to_world(local);
    // Distance to the near side.
    let along = to_centre.dot(direction);
    let half_chord = d2.neg_mul_add(sin2, r2).max(F::zero()).sqrt();
    // At a slant all errors count for more.
    let distance = along - half_chord;
    let slant = radius.abs() / half_chord;
    let slack = (blur(origin, sphere.centre(), along) * slant).min(distance * F::lit(SHADOW_SHORTENING));
    let distance = (distance - slack - sphere_slack(radius, half_chord)).max(F::zero());
    // A positive radius emits outwards.
    let emits = radius.gt(F::zero()) | light.two_sided();
    LightSample {
        direction,
        distance,
        radiance: light.radiance(),
        pdf: sphere_pdf(r2, d2),
        delta: F::Mask::from_bits(0),
        valid: d2.gt(r2) & emits,
    }
}

/// Uniform over the surface of the sphere: half of the samples lie on the far side. Kept for comparison.
#[inline(always)]
fn sample_sphere_area<F: Real>(light: &LightRow<F>, origin: Vec3<F>, u: [F; 2]) -> LightSample<F> {
    let sphere = light.of::<SphereRow>();
    let radius = sphere.radius();
    let normal = uniform_sphere(u);
    let point = normal.mul_add(radius.abs(), sphere.centre());
    let area = F::lit(4.0 * core::f64::consts::PI) * radius * radius;
    let mut out = towards_point(light, origin, point, normal.xor_sign(radius), area);
    // The near side of the sphere hides the far side; a shadow ray that stops short of the far side could slip past
    // a grazing near side, so the far side is left out by its normal.
    let outside = (sphere.centre() - origin).length2().gt(radius * radius);
    let cos = -normal.dot(out.direction);
    let faces = cos.gt(F::zero());
    out.valid = out.valid & ((outside & faces) | (!outside & !faces));
    let slack = F::select(outside, sphere_slack(radius, radius.abs() * cos.abs()), F::zero());
    out.distance = out.distance.mul_add(F::lit(1.0 - SHADOW_SHORTENING), -slack).max(F::zero());
    out
}

/// Triangles (folded square) and disks (uniform disk), both uniform over their surface.
#[inline(always)]
fn sample_flat<F: Real>(light: &LightRow<F>, origin: Vec3<F>, u: [F; 2]) -> LightSample<F> {
    let flat = light.of::<FlatRow>();
    let (e1, e2) = (flat.first(), flat.second());
    // Low-distortion map of the square onto the triangle (Heitz 2019, "A Low-Distortion Map Between Triangle and
    // Square").
    let half = F::lit(0.5);
    let lower = u[0].lt(u[1]);
    let a = F::select(lower, u[0] * half, u[1].neg_mul_add(half, u[0]));
    let b = F::select(lower, u[0].neg_mul_add(half, u[1]), u[1] * half);
    let (x, y) = uniform_disk(u);
    let disk = light.is(kind::DISK);
    let (a, b) = (F::select(disk, x, a), F::select(disk, y, b));
    let point = e1.mul_add(a, e2.mul_add(b, flat.corner()));
    let mut out = towards_point(light, origin, point, flat.normal(), flat.area());
    if !light.pictures.is_empty() {
        out.radiance = out.radiance * picture::shown(light, point);
    }
    // At a slant errors count for more, and on slender triangles: longest edge^2 / (area cos).
    let distance = out.distance;
    let slant = e1.length2().max(e2.length2()) * out.pdf / (distance * distance);
    let slack = (blur(origin, point, distance) * slant).min(distance * F::lit(SHADOW_SHORTENING));
    out.distance = distance - slack;
    out
}

/// The sample at `point`, chosen uniformly from `area`, with the whole distance.
#[inline(always)]
fn towards_point<F: Real>(
    light: &LightRow<F>,
    origin: Vec3<F>,
    point: Vec3<F>,
    normal: Vec3<F>,
    area: F,
) -> LightSample<F> {
    let to = point - origin;
    let d2 = to.length2();
    let d = d2.sqrt();
    let direction = to.scale(d.recip());
    let cos = -normal.dot(direction);
    let pdf = d2 / (cos.abs() * area);
    LightSample {
        direction,
        distance: d,
        radiance: light.radiance(),
        pdf,
        delta: F::Mask::from_bits(0),
        valid: (cos.gt(F::zero()) | (light.two_sided() & cos.lt(F::zero())))
            & pdf.lt(F::lit(f32::MAX as f64)),
    }
}

/// Share of a spot light's intensity at an angle to its axis with this cosine.
#[inline(always)]
fn fall_off<F: Real>(cos: F, start: F, end: F, fade: F) -> F {
    let x = ((cos - end) / (start - end)).max(F::zero()).min(F::one());
    let x2 = x * x;
    let fourth_power = fade.eq(F::lit(fade::FOURTH_POWER as f64));
    let soft = F::select(fourth_power, x2 * x2, x2 * x.neg_mul_add(F::lit(2.0), F::lit(3.0)));
    // Where both cosines are equal the edge is sharp.
    F::select(start.gt(end), soft, F::select(cos.ge(end), F::one(), F::zero()))
}

/// Point and spot lights: irradiance falls with the squared distance, the spot's also from its axis outwards.
#[inline(always)]
fn sample_point<F: Real>(light: &LightRow<F>, origin: Vec3<F>, _: [F; 2]) -> LightSample<F> {
    let point = light.of::<PointRow>();
    let to = point.position() - origin;
    let d2 = to.length2();
    let d = d2.sqrt();
    let direction = to.scale(d.recip());
    let cos = -point.axis().dot(direction);
    let spot = fall_off(cos, point.cos_falloff_start(), point.cos_total_width(), point.fade());
    let fall_off = F::select(light.is(kind::SPOT), spot, F::one());
    LightSample {
        direction,
        distance: d * F::lit(1.0 - SHADOW_SHORTENING),
        radiance: light.radiance().scale(fall_off / d2),
        pdf: F::one(),
        delta: F::Mask::from_bits(u32::MAX),
        valid: d2.gt(F::zero()) & fall_off.gt(F::zero()),
    }
}

#[inline(always)]
fn sample_distant<F: Real>(light: &LightRow<F>, _: Vec3<F>, _: [F; 2]) -> LightSample<F> {
    LightSample {
        direction: light.of::<DistantRow>().direction(),
        distance: F::lit(f32::INFINITY as f64),
        radiance: light.radiance(),
        pdf: F::one(),
        delta: F::Mask::from_bits(u32::MAX),
        valid: F::Mask::from_bits(u32::MAX),
    }
}
