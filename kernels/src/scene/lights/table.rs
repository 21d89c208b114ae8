//! The light table: kinds, rows, the choice among lights.

use super::alias::Alias;
use super::environment_map::{EnvironmentMap, sample_maps};
use super::picture::LightPicture;
use super::{
    COMMON, Common, EnvironmentRow, FlatPictureRow, HIDDEN, HIDDEN_TWO_SIDED, LONGEST, Light, LightKind,
    LightRow, LightSample, PROBABILITY, PicturePointRow, TWO_SIDED, kind,
};
use crate::lanes::{Real, Uint};
use crate::math::Vec3;
use crate::scene::error::{BuildError, finite, not_negative};
use crate::scene::rows::Row;

/// What every light has, whatever its kind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Emitter {
    /// Radiance; intensity of lights at a point; irradiance of parallel light.
    pub radiance: [f32; 3],
    /// Does a surface shine on both sides?
    pub two_sided: bool,
    /// Row of the material of an emitting surface; 0 for lights without one.
    pub material: u32,
    /// What it counts for when lights are chosen. Of those that cannot be sampled it is not looked at.
    pub power: f64,
}

/// Lights on their way into a [`LightTable`].
#[derive(Clone, Debug, Default)]
pub struct LightList {
    lights: Vec<(Emitter, Light)>,
    hidden: Vec<u32>,
    maps: Vec<EnvironmentMap>,
    pictures: Vec<LightPicture>,
}

impl LightList {
    /// Adds a light and returns its number.
    pub fn push(&mut self, emitter: Emitter, light: Light) -> u32 {
        self.lights.push((emitter, light));
        self.lights.len() as u32 - 1
    }
    /// Says that no ray meets this light: light sampling alone finds it, as it finds points. What has its form is not to be
    /// among the primitives.
    ///
    /// # Panics
    /// If there is no such light.
    pub fn hide(&mut self, light: u32) {
        assert!((light as usize) < self.lights.len(), "no such light");
        self.hidden.push(light);
    }
    /// Adds a picture of the sky as a light and returns its number; `power` is what it counts for when lights are
    /// chosen.
    pub fn push_map(&mut self, map: EnvironmentMap, power: f64) -> u32 {
        let number = self.maps.len() as f32;
        self.maps.push(map);
        let emitter = Emitter { radiance: [1.0; 3], power, ..Emitter::default() };
        self.push(emitter, Light::Environment(EnvironmentRow { number }))
    }
    /// Adds a picture that lights refer to by its number, which is returned.
    pub fn push_picture(&mut self, picture: LightPicture) -> u32 {
        self.pictures.push(picture);
        self.pictures.len() as u32 - 1
    }
    /// A picture.
    pub fn picture(&self, number: u32) -> Option<&LightPicture> {
        self.pictures.get(number as usize)
    }
    /// How many lights.
    pub fn len(&self) -> usize {
        self.lights.len()
    }
    /// No lights?
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }
}

/// Lights with a place, and emitting surfaces (each triangle of an emitting mesh is a light).
#[derive(Clone, Debug, Default)]
pub struct LightTable {
    /// One of [`kind`] a light.
    kinds: Vec<u32>,
    /// `stride` numbers a light: [`Common`], then the row of its kind. Behind them [`LONGEST`] zeros, so that columns of
    /// kinds that do not occur can be read.
    rows: Vec<f32>,
    /// As many as the longest row needs that occurs.
    stride: usize,
    /// Row of the material of each light's surface.
    materials: Vec<u32>,
    /// Alias table (Walker 1977, Vose 1991), see [`LightTable::choose`]: entry `i` takes light `i` itself below this
    /// threshold, in units of 2^-32, else `alias_other[i]`.
    alias_keep: Vec<u32>,
    /// See `alias_keep`.
    alias_other: Vec<u32>,
    /// Union of all kinds.
    kinds_present: u32,
    /// Pictures of the sky, each of them a light.
    maps: Vec<EnvironmentMap>,
    /// Pictures of other lights.
    pictures: Vec<LightPicture>,
}

impl LightTable {
    /// Most lights of a table: their numbers share a word with other things.
    pub const MAX: usize = 1 << crate::scene::PrimitiveTag::ID_BITS;

    /// The table of some lights.
    ///
    /// # Errors
    /// Where a number is not finite, a radiance negative, or there are too many.
    pub fn new(list: LightList) -> Result<Self, BuildError> {
        let n = list.len();
        if n > Self::MAX {
            return Err(BuildError::TooMany { what: "lights", found: n, limit: Self::MAX });
        }
        let longest = list.lights.iter().map(|(_, light)| light.numbers().len()).max().unwrap_or(0);
        let stride = COMMON + longest;
        let mut table = LightTable {
            kinds: Vec::with_capacity(n),
            rows: vec![0.0; n * stride + LONGEST],
            stride,
            materials: Vec::with_capacity(n),
            ..LightTable::default()
        };
        let mut powers = Vec::with_capacity(n);
        let mut lights_of_maps = vec![None; list.maps.len()];
        for (id, ((emitter, light), row)) in
            list.lights.iter().zip(table.rows.chunks_exact_mut(stride)).enumerate()
        {
            not_negative("light", id, "its radiance", &emitter.radiance)?;
            finite("light", id, "a number of its geometry", light.numbers())?;
            let common = Common {
                radiance: emitter.radiance,
                probability: 0.0,
                two_sided: emitter.two_sided as u8 as f32,
            };
            row[..COMMON].copy_from_slice(common.numbers());
            row[COMMON..][..light.numbers().len()].copy_from_slice(light.numbers());
            let kind = light.kind().bit();
            table.kinds.push(kind);
            table.kinds_present |= kind;
            table.materials.push(emitter.material);
            powers.push(emitter.power);
            if let Light::PicturePoint(PicturePointRow { number, .. })
            | Light::PictureTriangle(FlatPictureRow { number, .. }) = light
            {
                let (found, exist) = (*number as usize, list.pictures.len());
                if found >= exist {
                    return Err(BuildError::Missing { of: "light", id, what: "picture", found, exist });
                }
            }
            if let Light::Environment(EnvironmentRow { number }) = light {
                let exist = lights_of_maps.len();
                let place = lights_of_maps.get_mut(*number as usize).filter(|place| place.is_none());
                let (what, found) = ("an environment map of its own", *number as usize);
                *place.ok_or(BuildError::Missing { of: "light", id, what, found, exist })? = Some(id);
            }
        }
        for &light in &list.hidden {
            let two_sided = &mut table.rows[light as usize * stride + TWO_SIDED];
            *two_sided = if *two_sided > 0.0 { HIDDEN_TWO_SIDED } else { HIDDEN };
        }
        table.choose_by_power(&powers);
        (table.maps, table.pictures) = (list.maps, list.pictures);
        let rows: Vec<f32> = table.rows().map(|row| row[PROBABILITY]).collect();
        for (map, light) in table.maps.iter_mut().zip(lights_of_maps) {
            map.probability = light.map_or(0.0, |light| rows[light]);
        }
        Ok(table)
    }

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
        self.kinds_present & kind::SAMPLED
    }
    /// How many lights of each kind that occurs.
    pub fn census(&self) -> Vec<(LightKind, usize)> {
        let count = |k: LightKind| self.kinds.iter().filter(|&&bit| bit == k.bit()).count();
        LightKind::ALL.into_iter().map(|k| (k, count(k))).filter(|&(_, n)| n > 0).collect()
    }
    /// Largest component of any light's radiance or intensity; 0 without lights.
    pub fn brightest(&self) -> f32 {
        self.rows().flat_map(|row| &row[..3]).fold(0.0, |a, &b| a.max(b))
    }
    fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.rows.chunks_exact(self.stride.max(1)).take(self.len())
    }
    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.kinds[..])
            + size_of_val(&self.rows[..])
            + size_of_val(&self.materials[..])
            + size_of_val(&self.alias_keep[..])
            + size_of_val(&self.alias_other[..])
            + self.maps.iter().map(EnvironmentMap::bytes).sum::<usize>()
            + self.pictures.iter().map(|picture| picture.picture.bytes()).sum::<usize>()
    }
    /// Pictures of the sky.
    #[inline(always)]
    pub fn maps(&self) -> &[EnvironmentMap] {
        &self.maps
    }
    /// Samples the picture of the sky that the light of each lane is, in the lanes that have one: takes over these lanes
    /// of `out`. 32 random bits, and `u` uniform in the unit square.
    #[inline(always)]
    pub fn sample_map<F: Real>(
        &self,
        light: &LightRow<F>,
        origin: Vec3<F>,
        bits: F::Uint,
        u: [F; 2],
        out: &mut LightSample<F>,
    ) {
        sample_maps(&self.maps, light, origin, bits, u, out);
    }
    /// The row of the material of the surface of a light; 0 for lights without one.
    ///
    /// # Panics
    /// If there is no such light.
    pub fn material_of(&self, light: usize) -> u32 {
        self.materials[light]
    }

    /// The row of light `id`.
    ///
    /// # Safety
    /// Every lane of `id` is below [`LightTable::len`].
    #[inline(always)]
    pub unsafe fn row<F: Real>(&self, id: F::Uint) -> LightRow<'_, F> {
        // SAFETY: the caller's promise; all columns are of one length, rows `stride` times that and [`LONGEST`].
        unsafe { LightRow::new(&self.kinds, &self.rows, &self.pictures, self.stride as u32, id) }
    }

    /// The row of the material of the surface of light `id`.
    ///
    /// # Safety
    /// Every lane of `id` is below [`LightTable::len`].
    #[inline(always)]
    pub unsafe fn material<U: Uint>(&self, id: U) -> U {
        // SAFETY: the caller's promise.
        unsafe { U::gather(&self.materials, id) }
    }

    /// Chooses a light from 32 random bits, by its probability.
    ///
    /// The bits are spent twice: the upper half of `bits * n` is the entry of the alias table, the lower half (uniform
    /// and independent of it up to n / 2^32) decides between the two lights of the entry.
    ///
    /// # Safety
    /// There is a light.
    #[inline(always)]
    pub unsafe fn choose<U: Uint>(&self, bits: U) -> U {
        let n = U::splat(self.len() as u32);
        let entry = bits.mul_high(n);
        // SAFETY: `entry` < n, and both tables have n entries.
        let (threshold, other) =
            unsafe { (U::gather(&self.alias_keep, entry), U::gather(&self.alias_other, entry)) };
        U::select((bits * n).lt(threshold), entry, other)
    }

    /// Builds the alias table for a choice in proportion to `power` (one number a light, 0 for those that cannot be
    /// sampled), and sets the probability of each light. If all powers are 0, all lights that can be sampled are
    /// equally likely.
    ///
    /// The probability is not the share of the power but exactly how many of the 2^32 random numbers choose the
    /// light, at least one if it has power: estimates divide by it, and a faint lamp beside a sun would come out
    /// several times too bright if its share were merely close.
    fn choose_by_power(&mut self, power: &[f64]) {
        let sampled = |i: usize| self.kinds[i] & kind::SAMPLED != 0;
        let n = self.len();
        let mut share: Vec<f64> = (0..n)
            .map(|i| if sampled(i) && power[i].is_finite() { power[i].max(0.0) } else { 0.0 })
            .collect();
        if share.iter().sum::<f64>() <= 0.0 {
            share = (0..n).map(|i| sampled(i) as u8 as f64).collect();
        }
        let dark = share.iter().all(|&s| s == 0.0);
        let Alias { keep, other, chances } = Alias::new(share);
        (self.alias_keep, self.alias_other) = (keep, other);
        if dark {
            return;
        }
        for (row, chances) in self.rows.chunks_exact_mut(self.stride.max(1)).zip(chances) {
            row[PROBABILITY] = (chances as f64 / 4_294_967_296.0) as f32;
        }
    }
}
