//! A picture of the sky: radiance from infinity by direction, sampled by importance.
//!
//! Directions are sampled by cells ([`super::cells`]). Equal-area pictures (pbrt-v4's) are constant over a texel, and a
//! texel is a cell: the density is in proportion to the brightness. Pictures by latitude and longitude (pbrt-v3's) are
//! interpolated between the centres of texels; a cell is what lies between four of them, weighed by their mean and its
//! solid angle. In a cell directions are uniform over the square, so the density over solid angle is
//!
//! ```text
//!     equal area         P(cell) cells / (4 pi)
//!     latitude           P(cell) cells / (2 pi^2 sin(theta))
//! ```
//!
//! with twice that in the cells at the poles, which are half as high. A linear map that takes directions of the world to
//! those of the picture, l = M d with |det M| = 1, changes densities by 1 / |M d|^3.

use super::cells::{Cell, CellTable};
use super::{EnvironmentRow, LightRow, LightSample};
use crate::lanes::{Mask, Real, Uint};
use crate::math::{Rgb, Vec3};
use crate::scene::error::{BuildError, finite, not_negative};
use crate::scene::picture::{Picture, between_centres, scaled};
use crate::sphere_maps::{
    equal_area_to_sphere, lat_long_to_sphere, sin_to_z, sphere_to_equal_area, sphere_to_lat_long,
};
use core::f64::consts::PI;

/// How a picture covers the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkyMapping {
    /// By equal areas, constant over a texel.
    EqualArea,
    /// By azimuth and angle to +z, interpolated between texels.
    LatLong,
}

/// What an [`EnvironmentMap`] is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentParts {
    /// The picture.
    pub picture: Picture,
    /// How it covers the sphere.
    pub mapping: SkyMapping,
    /// Times which its colours are radiance.
    pub scale: [f32; 3],
    /// Rows of the matrix that takes directions of the world to those of the picture, but for their length.
    pub light_from_world: [[f64; 3]; 3],
    /// An opening through which alone the sky is seen.
    pub portal: Option<Portal>,
}

/// A parallelogram that lets the light of a sky through, on the way to the side of `first` x `second`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Portal {
    /// A corner.
    pub corner: [f32; 3],
    /// The edges that meet there.
    pub first: [f32; 3],
    /// See `first`.
    pub second: [f32; 3],
}

/// A picture of the sky with what it takes to sample it.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    picture: Picture,
    mapping: SkyMapping,
    scale: [f32; 3],
    light_from_world: [[f32; 3]; 3],
    world_from_light: [[f32; 3]; 3],
    portal: Option<Portal>,
    cells: CellTable,
    mean: [f64; 3],
    /// Probability of being chosen among the lights.
    pub(super) probability: f32,
}

impl EnvironmentMap {
    /// Builds the table.
    ///
    /// # Errors
    /// [`BuildError`] if a number is not finite, the matrix is singular or the map is black all over.
    pub fn new(parts: EnvironmentParts) -> Result<Self, BuildError> {
        let EnvironmentParts { picture, mapping, scale, light_from_world, portal } = parts;
        let wrong = |what: &str| BuildError::Number { of: "environment map", id: 0, what: what.into() };
        not_negative("environment map", 0, "its scale", &scale)?;
        let (light_from_world, world_from_light) =
            normalised(light_from_world).ok_or_else(|| wrong("its transform has no inverse"))?;
        if let Some(Portal { corner, first, second }) = &portal {
            let numbers = [*corner, *first, *second];
            finite("environment map", 0, "a number of its portal", numbers.as_flattened())?;
        }
        let (width, height) = (picture.width(), picture.height());
        let bright = |x: u32, y: u32| {
            picture.colour(x, y).iter().zip(scale).map(|(c, s)| f64::from(c * s)).sum::<f64>()
        };
        let cells = match mapping {
            SkyMapping::EqualArea => CellTable::new(width, height, bright),
            SkyMapping::LatLong => {
                // Solid angle of a row of cells.
                let edge = |row: u32| ((f64::from(row) - 0.5) / f64::from(height)).clamp(0.0, 1.0) * PI;
                let solid: Vec<f64> = (0..=height).map(|row| edge(row).cos() - edge(row + 1).cos()).collect();
                CellTable::new(width, height + 1, |x, y| {
                    let columns = [x.checked_sub(1).unwrap_or(width - 1), x];
                    let rows = [y.saturating_sub(1), y.min(height - 1)];
                    let corners = rows.map(|y| bright(columns[0], y) + bright(columns[1], y));
                    (corners[0] + corners[1]) * solid[y as usize]
                })
            }
        };
        let cells = cells.ok_or_else(|| wrong("it is black"))?;
        let mean = mean_radiance(&picture, mapping, scale);
        Ok(EnvironmentMap {
            picture,
            mapping,
            scale,
            light_from_world,
            world_from_light,
            portal,
            cells,
            mean,
            probability: 0.0,
        })
    }

    /// Probability of being chosen among the lights.
    #[inline(always)]
    pub fn probability(&self) -> f32 {
        self.probability
    }
    /// Mean radiance over all directions.
    pub fn mean(&self) -> [f64; 3] {
        self.mean
    }
    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        self.picture.bytes() + self.cells.bytes()
    }

    /// Is the sky seen from `origin` in this direction?
    #[inline(always)]
    fn is_seen<F: Real>(&self, origin: Vec3<F>, direction: Vec3<F>) -> F::Mask {
        let Some(Portal { corner, first, second }) = self.portal else {
            return F::Mask::from_bits(u32::MAX);
        };
        let (first, second) = (Vec3::<F>::splat(first), Vec3::<F>::splat(second));
        let normal = first.cross(second);
        let from_corner = origin - Vec3::splat(corner);
        let towards = direction.dot(normal);
        let t = -from_corner.dot(normal) / towards;
        let at = direction.mul_add(t, from_corner);
        // Coordinates along the edges, times the square of the normal's length.
        let (a, b, all) = (at.cross(second).dot(normal), first.cross(at).dot(normal), normal.length2());
        let zero = F::zero();
        towards.gt(zero) & t.ge(zero) & a.ge(zero) & a.le(all) & b.ge(zero) & b.le(all)
    }

    /// The place in the picture of a unit direction of its own space: cell, and for interpolated pictures where in it.
    #[inline(always)]
    fn place<F: Real>(&self, d: Vec3<F>) -> Place<F> {
        let (width, height) = (self.picture.width(), self.picture.height());
        match self.mapping {
            SkyMapping::EqualArea => {
                let [u, v] = sphere_to_equal_area(d);
                let (column, row) = (scaled(u, width), scaled(v, height));
                Place { column, row, across: F::zero(), down: F::zero() }
            }
            SkyMapping::LatLong => {
                let [u, v] = sphere_to_lat_long(d);
                let (column, across) = between_centres(u, width);
                // The last half column is the first.
                let wraps = column.lt(F::Uint::splat(width));
                let column = F::Uint::select(wraps, column, F::Uint::splat(0));
                let (row, down) = between_centres(v, height);
                Place { column, row, across, down }
            }
        }
    }

    /// Radiance at a place.
    #[inline(always)]
    fn radiance<F: Real>(&self, place: &Place<F>) -> Rgb<F> {
        let colour = match self.mapping {
            SkyMapping::EqualArea => self.picture.texel(place.column, place.row),
            SkyMapping::LatLong => {
                self.picture.blend_around(place.column, place.row, place.across, place.down)
            }
        };
        colour * Rgb::splat(self.scale)
    }

    /// Density over solid angle in the picture's space, from the probability of a cell.
    #[inline(always)]
    fn density<F: Real>(&self, probability: F, row: F::Uint, d: Vec3<F>) -> F {
        let (width, height) = (f64::from(self.picture.width()), f64::from(self.picture.height()));
        match self.mapping {
            SkyMapping::EqualArea => probability * F::lit(width * height / (4.0 * PI)),
            SkyMapping::LatLong => {
                let at_pole = row.eq(F::Uint::splat(0)) | !row.lt(F::Uint::splat(self.picture.height()));
                let even = F::lit(width * height / (2.0 * PI * PI));
                let even = F::select(at_pole, even + even, even);
                // At the very pole any number will do.
                probability * even / sin_to_z(d).max(F::lit(1e-9))
            }
        }
    }

    /// Radiance from a direction of the world as seen from `origin`, and the density with which [`Self::sample`] takes
    /// it, without the probability of choosing the light.
    #[inline(always)]
    pub fn met<F: Real>(&self, origin: Vec3<F>, direction: Vec3<F>) -> (Rgb<F>, F) {
        let local = times(&self.light_from_world, direction);
        let stretch = local.length2().sqrt().recip();
        let local = local.scale(stretch);
        let place = self.place(local);
        let radiance = self.radiance(&place);
        let probability = self.cells.probability::<F>(place.column, place.row);
        let pdf = self.density(probability, place.row, local) * (stretch * stretch * stretch);
        (Rgb::select(self.is_seen(origin, direction), radiance, Rgb::zero()), pdf)
    }

    /// Samples a direction, with 32 random bits and `u` uniform in the unit square.
    #[inline(always)]
    pub fn sample<F: Real>(&self, origin: Vec3<F>, bits: F::Uint, u: [F; 2]) -> LightSample<F> {
        let Cell { column, row, rest, probability } = self.cells.choose(bits, u[0]);
        let (width, height) = (self.picture.width(), self.picture.height());
        let part = |n: u32| F::lit(f64::from(n).recip());
        let (place, local) = match self.mapping {
            SkyMapping::EqualArea => {
                let at =
                    [(F::from_uint(column) + rest) * part(width), (F::from_uint(row) + u[1]) * part(height)];
                (Place { column, row, across: rest, down: u[1] }, equal_area_to_sphere(at))
            }
            SkyMapping::LatLong => {
                let half = F::lit(0.5);
                let first = row.eq(F::Uint::splat(0));
                let last = !row.lt(F::Uint::splat(height));
                let down = F::select(first, u[1].mul_add(half, half), F::select(last, u[1] * half, u[1]));
                let across = (F::from_uint(column) + rest - half) * part(width);
                let azimuth = F::select(across.lt(F::zero()), across + F::one(), across);
                let at = [azimuth, (F::from_uint(row) + down - half) * part(height)];
                (Place { column, row, across: rest, down }, lat_long_to_sphere(at))
            }
        };
        let world = times(&self.world_from_light, local);
        let stretch = world.length2().sqrt();
        let direction = world.scale(stretch.recip());
        LightSample {
            direction,
            distance: F::lit(f64::from(f32::INFINITY)),
            radiance: self.radiance(&place),
            pdf: self.density(probability, row, local) * (stretch * stretch * stretch),
            delta: F::Mask::from_bits(0),
            valid: self.is_seen(origin, direction),
        }
    }
}

/// A place in a picture a lane.
struct Place<F: Real> {
    column: F::Uint,
    row: F::Uint,
    across: F,
    down: F,
}

#[inline(always)]
fn times<F: Real>(rows: &[[f32; 3]; 3], v: Vec3<F>) -> Vec3<F> {
    Vec3::new(
        Vec3::<F>::splat(rows[0]).dot(v),
        Vec3::<F>::splat(rows[1]).dot(v),
        Vec3::<F>::splat(rows[2]).dot(v),
    )
}

/// Three rows of a matrix.
type Rows = [[f32; 3]; 3];

/// A matrix and its inverse, both scaled to a determinant of 1 or -1.
fn normalised(rows: [[f64; 3]; 3]) -> Option<(Rows, Rows)> {
    let largest = rows.as_flattened().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    let matrix = glam::DMat3::from_cols_array_2d(&rows) * largest.recip();
    let scale = matrix.determinant().abs().cbrt().recip();
    let matrix = matrix * scale;
    let inverse = matrix.inverse();
    let single = |m: glam::DMat3| m.to_cols_array_2d().map(|row| row.map(|x| x as f32));
    let finite = scale.is_finite() && matrix.is_finite() && inverse.is_finite();
    finite.then(|| (single(matrix), single(inverse)))
}

/// Mean radiance over all directions.
fn mean_radiance(picture: &Picture, mapping: SkyMapping, scale: [f32; 3]) -> [f64; 3] {
    let (width, height) = (f64::from(picture.width()), f64::from(picture.height()));
    let sum = match mapping {
        SkyMapping::EqualArea => picture.weighted_sum(|_, _| (width * height).recip()),
        SkyMapping::LatLong => {
            let edge = |y: u32| (f64::from(y) / height * PI).cos();
            let shares: Vec<f64> =
                (0..picture.height()).map(|y| (edge(y) - edge(y + 1)) / (2.0 * width)).collect();
            picture.weighted_sum(|_, y| shares[y as usize])
        }
    };
    core::array::from_fn(|k| sum[k] * f64::from(scale[k]))
}

/// Samples the map that the light of each lane is, in the lanes that have one.
#[inline(always)]
pub(super) fn sample_maps<F: Real>(
    maps: &[EnvironmentMap],
    light: &LightRow<F>,
    origin: Vec3<F>,
    bits: F::Uint,
    u: [F; 2],
    out: &mut LightSample<F>,
) {
    let lanes = light.is(super::kind::ENVIRONMENT);
    if !lanes.any() {
        return;
    }
    let number = light.of::<EnvironmentRow>().number();
    for (k, map) in maps.iter().enumerate() {
        let lanes = lanes & number.eq(F::lit(k as f64));
        if lanes.any() {
            out.merge(lanes, map.sample(origin, bits, u));
        }
    }
}
