//! The light table, and how each kind of light is sampled: a direction towards it, the density of that direction,
//! and the same density for a direction that was found otherwise.

use crate::lanes::{Mask, Real, Uint};
use crate::math::{Frame, Rgb, Vec3, uniform_disk, uniform_sphere};

/// Kinds of light, as bits, so that a set of them is a constant of a kernel.
pub mod kind {
    /// Full sphere, sampled by the cone it fills; from inside left to the directions of the BSDF.
    pub const SPHERE: u32 = 1;
    /// Full sphere, sampled uniformly over its surface: for comparison.
    pub const SPHERE_AREA: u32 = 2;
    /// Triangle, sampled uniformly over its surface.
    pub const TRIANGLE: u32 = 4;
    /// Full disk (or ellipse), sampled uniformly over its surface.
    pub const DISK: u32 = 8;
    /// Point.
    pub const POINT: u32 = 16;
    /// Point with a cone.
    pub const SPOT: u32 = 32;
    /// Parallel light.
    pub const DISTANT: u32 = 64;
    /// Emitting surface that cannot be sampled (a clipped or stretched sphere): found by chance only.
    pub const UNSAMPLED: u32 = 128;
    /// All kinds.
    pub const ALL: u32 = 255;
}

/// Lights with a place, and emitting surfaces (each triangle of an emitting mesh is a light).
#[derive(Clone, Debug, Default)]
pub struct LightTable {
    /// One of [`kind`] a light.
    pub kinds: Vec<u32>,
    /// [`LightTable::STRIDE`] numbers a light: radiance or intensity (0..3), probability of being chosen (3), two-sided
    /// (4, 0 or 1), then by kind: sphere centre (5..8) and signed radius (8); triangle corner (5..8), edges to the two
    /// others (8..11, 11..14) in such an order that their cross product is on the emitting side, area (14); disk
    /// centre (5..8), half axes (8..11, 11..14) ordered likewise, area (14); point and spot position (5..8), spot axis
    /// (8..11), cosines where it begins to fade (11) and is dark (12); distant: direction towards the light (5..8).
    pub rows: Vec<f32>,
    /// Material of each light's surface.
    pub materials: Vec<u32>,
    /// Alias table (Walker 1977, Vose 1991), see [`choose`]: entry `i` takes light `i` itself below this threshold, in
    /// units of 2^-32, else `alias_other[i]`.
    pub alias_keep: Vec<u32>,
    /// See `alias_keep`.
    pub alias_other: Vec<u32>,
    /// Union of all kinds.
    pub kinds_present: u32,
}

impl LightTable {
    /// Numbers a light.
    pub const STRIDE: usize = 15;

    /// How many lights.
    pub fn len(&self) -> usize {
        self.kinds.len()
    }
    /// No lights?
    pub fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }
    /// The kinds that light sampling can choose.
    pub fn sampled_kinds(&self) -> u32 {
        self.kinds_present & !kind::UNSAMPLED
    }

    /// Adds a light; its probability is set by [`LightTable::choose_by_power`].
    pub fn push(&mut self, kind: u32, row: [f32; Self::STRIDE], material: u32) -> u32 {
        self.kinds.push(kind);
        self.kinds_present |= kind;
        self.rows.extend(row);
        self.materials.push(material);
        self.kinds.len() as u32 - 1
    }

    /// Builds the alias table for a choice in proportion to `power` (one number a light, 0 for those that cannot be
    /// sampled), and sets the probability of each light. If all powers are 0, all lights that can be sampled are
    /// equally likely.
    ///
    /// The probability is not the share of the power but exactly how many of the 2^32 random numbers choose the
    /// light, at least one if it has power: estimates divide by it, and a faint lamp beside a sun would come out
    /// several times too bright if its share were merely close.
    pub fn choose_by_power(&mut self, power: &[f64]) {
        assert_eq!(power.len(), self.len());
        let sampled = |i: usize| self.kinds[i] != kind::UNSAMPLED;
        let n = self.len();
        let mut share: Vec<f64> = (0..n)
            .map(|i| if sampled(i) && power[i].is_finite() { power[i].max(0.0) } else { 0.0 })
            .collect();
        if share.iter().sum::<f64>() <= 0.0 {
            share = (0..n).map(|i| sampled(i) as u8 as f64).collect();
        }
        let total: f64 = share.iter().sum();
        self.alias_keep = vec![u32::MAX; n];
        self.alias_other = (0..n as u32).collect();
        if total <= 0.0 {
            return;
        }
        let dark: Vec<bool> = share.iter().map(|&s| s == 0.0).collect();
        let largest = (0..n).max_by(|&a, &b| share[a].total_cmp(&share[b])).unwrap_or(0);
        share.iter_mut().for_each(|s| *s *= n as f64 / total);
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| share[i] < 1.0);
        while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
            small.pop();
            // A threshold of n is met by one random number at least.
            let threshold = (share[s] * 4_294_967_296.0) as u32;
            self.alias_keep[s] = if dark[s] { 0 } else { threshold.max(n as u32) };
            self.alias_other[s] = l as u32;
            share[l] -= 1.0 - share[s];
            if share[l] < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        // What is left is 1 but for rounding; a light of probability 0 must still never be taken.
        for i in small.into_iter().filter(|&i| dark[i]) {
            self.alias_keep[i] = 0;
            self.alias_other[i] = largest as u32;
        }
        // Entry i serves the random numbers from ceil(2^32 i / n), the own light those below the threshold.
        let mut chances = vec![0u64; n];
        for i in 0..n {
            let at = |offset: u64| (((i as u64) << 32) + offset).div_ceil(n as u64);
            let (begin, end) = (at(0), at(1 << 32));
            let other = self.alias_other[i] as usize;
            let split = if other == i { end } else { at(self.alias_keep[i] as u64) };
            chances[i] += split - begin;
            chances[other] += end - split;
        }
        for (row, chances) in self.rows.chunks_exact_mut(Self::STRIDE).zip(chances) {
            row[3] = (chances as f64 / 4_294_967_296.0) as f32;
        }
    }
}

/// The numbers of one light a lane.
#[derive(Clone, Copy)]
pub struct LightRow<'a, F: Real> {
    table: &'a LightTable,
    first: F::Uint,
    kind: F::Uint,
}

impl<'a, F: Real> LightRow<'a, F> {
    /// The row of light `id`.
    ///
    /// # Safety
    /// Every lane of `id` is below `table.len()`.
    #[inline(always)]
    pub unsafe fn new(table: &'a LightTable, id: F::Uint) -> Self {
        // SAFETY: the caller's promise.
        let kind = unsafe { F::Uint::gather(&table.kinds, id) };
        LightRow { table, first: id * F::Uint::splat(LightTable::STRIDE as u32), kind }
    }
    #[inline(always)]
    fn get(&self, column: u32) -> F {
        debug_assert!((column as usize) < LightTable::STRIDE);
        // SAFETY: `rows` has STRIDE numbers for each light, and the light exists by the promise made to `new`.
        unsafe { F::gather(&self.table.rows, self.first + F::Uint::splat(column)) }
    }
    #[inline(always)]
    fn vector(&self, column: u32) -> Vec3<F> {
        Vec3::new(self.get(column), self.get(column + 1), self.get(column + 2))
    }
    #[inline(always)]
    fn is(&self, kind: u32) -> F::Mask {
        self.kind.eq(F::Uint::splat(kind))
    }
    /// Radiance or intensity.
    #[inline(always)]
    pub fn radiance(&self) -> Rgb<F> {
        Rgb::new(self.get(0), self.get(1), self.get(2))
    }
    /// Probability of being chosen.
    #[inline(always)]
    pub fn probability(&self) -> F {
        self.get(3)
    }
    #[inline(always)]
    fn two_sided(&self) -> F::Mask {
        self.get(4).gt(F::zero())
    }
    /// Emitted radiance towards `-direction` for a ray that meets the surface with normal `normal`: on the side of
    /// the normal, or on both.
    #[inline(always)]
    pub fn emitted(&self, normal: Vec3<F>, direction: Vec3<F>) -> Rgb<F> {
        let seen = normal.dot(direction).lt(F::zero()) | self.two_sided();
        Rgb::select(seen, self.radiance(), Rgb::zero())
    }
}

/// Chooses a light from 32 random bits, by its probability.
///
/// The bits are spent twice: the upper half of `bits * n` is the entry of the alias table, the lower half (uniform
/// and independent of it up to n / 2^32) decides between the two lights of the entry.
#[inline(always)]
pub fn choose<F: Real>(table: &LightTable, bits: F::Uint) -> F::Uint {
    let n = F::Uint::splat(table.len() as u32);
    let entry = bits.mul_high(n);
    // SAFETY: `entry` < n, and both tables have n entries.
    let (threshold, other) =
        unsafe { (F::Uint::gather(&table.alias_keep, entry), F::Uint::gather(&table.alias_other, entry)) };
    F::Uint::select((bits * n).lt(threshold), entry, other)
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

/// Shadow rays stop this much short of the light, relative to the distance, so as not to meet it.
const SHADOW_SHORTENING: f64 = 1e-4;

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

/// Samples a direction from `origin` towards the light, with `u` uniform in the unit square. `KINDS` holds every kind
/// that occurs.
#[inline(always)]
pub fn sample<F: Real, const KINDS: u32>(light: &LightRow<F>, origin: Vec3<F>, u: [F; 2]) -> LightSample<F> {
    let mut out = LightSample {
        direction: Vec3::new(F::zero(), F::zero(), F::one()),
        distance: F::zero(),
        radiance: Rgb::zero(),
        pdf: F::one(),
        delta: F::Mask::from_bits(0),
        valid: F::Mask::from_bits(0),
    };
    if KINDS & kind::SPHERE != 0 {
        let lanes = if KINDS == kind::SPHERE { F::Mask::from_bits(u32::MAX) } else { light.is(kind::SPHERE) };
        if KINDS == kind::SPHERE || lanes.any() {
            merge(&mut out, lanes, sample_sphere(light, origin, u));
        }
    }
    if KINDS & kind::SPHERE_AREA != 0 && light.is(kind::SPHERE_AREA).any() {
        merge(&mut out, light.is(kind::SPHERE_AREA), sample_sphere_area(light, origin, u));
    }
    if KINDS & (kind::TRIANGLE | kind::DISK) != 0 {
        let lanes = light.is(kind::TRIANGLE) | light.is(kind::DISK);
        if lanes.any() {
            merge(&mut out, lanes, sample_flat(light, origin, u));
        }
    }
    if KINDS & (kind::POINT | kind::SPOT) != 0 {
        let lanes = light.is(kind::POINT) | light.is(kind::SPOT);
        if lanes.any() {
            merge(&mut out, lanes, sample_point(light, origin));
        }
    }
    if KINDS & kind::DISTANT != 0 && light.is(kind::DISTANT).any() {
        merge(&mut out, light.is(kind::DISTANT), sample_distant(light));
    }
    out
}

/// Density with which [`sample`] takes the direction of a ray that met the light at distance `t` with the
/// geometric normal `normal`, from `origin` over solid angle, without the probability of choosing the light.
#[inline(always)]
pub fn pdf<F: Real, const KINDS: u32>(
    light: &LightRow<F>,
    origin: Vec3<F>,
    direction: Vec3<F>,
    t: F,
    normal: Vec3<F>,
) -> F {
    let mut pdf = F::zero();
    if KINDS & kind::SPHERE != 0 {
        let radius = light.get(8);
        let d2 = (light.vector(5) - origin).length2();
        pdf = F::select(light.is(kind::SPHERE), sphere_pdf(radius * radius, d2), pdf);
    }
    if KINDS & (kind::TRIANGLE | kind::DISK | kind::SPHERE_AREA) != 0 {
        let sphere = light.is(kind::SPHERE_AREA);
        let radius = light.get(8);
        let area = F::select(sphere, F::lit(4.0 * core::f64::consts::PI) * radius * radius, light.get(14));
        let by_area = t * t / (normal.dot(direction).abs() * area);
        pdf = F::select(sphere | light.is(kind::TRIANGLE) | light.is(kind::DISK), by_area, pdf);
    }
    pdf
}

#[inline(always)]
fn merge<F: Real>(out: &mut LightSample<F>, lanes: F::Mask, with: LightSample<F>) {
    out.direction = Vec3::select(lanes, with.direction, out.direction);
    out.distance = F::select(lanes, with.distance, out.distance);
    out.radiance = Rgb::select(lanes, with.radiance, out.radiance);
    out.pdf = F::select(lanes, with.pdf, out.pdf);
    out.delta = out.delta | (lanes & with.delta);
    out.valid = out.valid | (lanes & with.valid);
}

/// Uniform in the cone of directions that meet the sphere.
///
/// From inside, every direction meets it: the light is a sky, and the directions to sample are those of the BSDF,
/// whose next ray finds it with weight 1. Sampling all directions uniformly and weighing the two was tried: 0.75 to
/// 0.81 of the efficiency, for about the same error and one more ray a vertex.
#[inline(always)]
fn sample_sphere<F: Real>(light: &LightRow<F>, origin: Vec3<F>, u: [F; 2]) -> LightSample<F> {
    let to_centre = light.vector(5) - origin;
    let radius = light.get(8);
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
    let slack = sphere_slack(radius, half_chord);
    let distance = (along - half_chord).mul_add(F::lit(1.0 - SHADOW_SHORTENING), -slack).max(F::zero());
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
    let radius = light.get(8);
    let normal = uniform_sphere(u);
    let point = normal.mul_add(radius.abs(), light.vector(5));
    let area = F::lit(4.0 * core::f64::consts::PI) * radius * radius;
    let mut out = towards_point(light, origin, point, normal.xor_sign(radius), area);
    // The near side of the sphere hides the far side; a shadow ray that stops short of the far side could slip past
    // a grazing near side, so the far side is left out by its normal.
    let outside = (light.vector(5) - origin).length2().gt(radius * radius);
    let cos = -normal.dot(out.direction);
    let faces = cos.gt(F::zero());
    out.valid = out.valid & ((outside & faces) | (!outside & !faces));
    let slack = F::select(outside, sphere_slack(radius, radius.abs() * cos.abs()), F::zero());
    out.distance = (out.distance - slack).max(F::zero());
    out
}

/// Triangles (folded square) and disks (uniform disk), both uniform over their surface.
#[inline(always)]
fn sample_flat<F: Real>(light: &LightRow<F>, origin: Vec3<F>, u: [F; 2]) -> LightSample<F> {
    let (e1, e2) = (light.vector(8), light.vector(11));
    // Low-distortion map of the square onto the triangle (Heitz 2019, "A Low-Distortion Map Between Triangle and
    // Square").
    let half = F::lit(0.5);
    let lower = u[0].lt(u[1]);
    let a = F::select(lower, u[0] * half, u[1].neg_mul_add(half, u[0]));
    let b = F::select(lower, u[0].neg_mul_add(half, u[1]), u[1] * half);
    let (x, y) = uniform_disk(u);
    let disk = light.is(kind::DISK);
    let (a, b) = (F::select(disk, x, a), F::select(disk, y, b));
    let point = e1.mul_add(a, e2.mul_add(b, light.vector(5)));
    towards_point(light, origin, point, e1.cross(e2).normalize(), light.get(14))
}

/// The sample at `point`, chosen uniformly from `area`.
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
        distance: d * F::lit(1.0 - SHADOW_SHORTENING),
        radiance: light.radiance(),
        pdf,
        delta: F::Mask::from_bits(0),
        valid: (cos.gt(F::zero()) | (light.two_sided() & cos.lt(F::zero())))
            & pdf.lt(F::lit(f32::MAX as f64)),
    }
}

/// Point and spot lights: irradiance falls with the squared distance, the spot's also from its axis outwards by
/// smoothstep of the cosine.
#[inline(always)]
fn sample_point<F: Real>(light: &LightRow<F>, origin: Vec3<F>) -> LightSample<F> {
    let to = light.vector(5) - origin;
    let d2 = to.length2();
    let d = d2.sqrt();
    let direction = to.scale(d.recip());
    let cos = -light.vector(8).dot(direction);
    let (start, end) = (light.get(11), light.get(12));
    let x = ((cos - end) / (start - end)).max(F::zero()).min(F::one());
    let smooth = x * x * x.neg_mul_add(F::lit(2.0), F::lit(3.0));
    // Where both cosines are equal the edge is sharp.
    let smooth = F::select(start.gt(end), smooth, F::select(cos.ge(end), F::one(), F::zero()));
    let fall_off = F::select(light.is(kind::SPOT), smooth, F::one());
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
fn sample_distant<F: Real>(light: &LightRow<F>) -> LightSample<F> {
    LightSample {
        direction: light.vector(5),
        distance: F::lit(f32::INFINITY as f64),
        radiance: light.radiance(),
        pdf: F::one(),
        delta: F::Mask::from_bits(u32::MAX),
        valid: F::Mask::from_bits(u32::MAX),
    }
}
