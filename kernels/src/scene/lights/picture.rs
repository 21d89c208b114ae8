//! Lights that shine through a picture: points that project one or have one around them, and surfaces that show one.

use super::{FlatPictureRow, LightRow, LightSample, PicturePointRow, SHADOW_SHORTENING, kind};
use crate::lanes::{Mask, Real};
use crate::math::{Rgb, Vec3};
use crate::scene::picture::Picture;
use crate::sphere_maps::{sphere_to_equal_area, sphere_to_lat_long};

/// How a light looks up its picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureMapping {
    /// Projected along +z of the light's space, the right edge towards +x, the lower one towards +y: the texel that
    /// holds the place. (pbrt-v4's projection light.)
    Projection,
    /// The same, interpolated between texels. (pbrt-v3's.)
    SmoothProjection,
    /// Around the light, by equal areas; the texel that holds the place. (pbrt-v4's goniometric light.)
    EqualArea,
    /// Around the light, by azimuth and angle to +z, interpolated. (pbrt-v3's.)
    LatLong,
    /// On a surface with coordinates u to the right and v upwards, interpolated. (pbrt-v4's area lights.)
    Surface,
}

/// A picture of lights, and how it is looked up.
#[derive(Clone, Debug, PartialEq)]
pub struct LightPicture {
    /// The picture.
    pub picture: Picture,
    /// How it is looked up.
    pub mapping: PictureMapping,
}

impl LightPicture {
    /// The colour in a direction of the light's space, away from it. The picture of a projection ends at `extent` (beyond
    /// which it is black) to each side, as seen at distance 1.
    #[inline(always)]
    fn around<F: Real>(&self, direction: Vec3<F>, extent: [F; 2]) -> Rgb<F> {
        let (zero, one, half) = (F::zero(), F::one(), F::lit(0.5));
        match self.mapping {
            PictureMapping::Projection | PictureMapping::SmoothProjection => {
                let u = (direction.x / (direction.z * extent[0])).mul_add(half, half);
                let v = (direction.y / (direction.z * extent[1])).mul_add(half, half);
                let inside = direction.z.gt(zero) & u.ge(zero) & u.le(one) & v.ge(zero) & v.le(one);
                let colour = if self.mapping == PictureMapping::Projection {
                    self.picture.nearest([u, v])
                } else {
                    self.picture.bilinear([u, v])
                };
                Rgb::select(inside, colour, Rgb::zero())
            }
            PictureMapping::EqualArea => self.picture.nearest(sphere_to_equal_area(direction)),
            PictureMapping::LatLong => self.picture.bilinear_around(sphere_to_lat_long(direction)),
            PictureMapping::Surface => Rgb::all(one),
        }
    }
}

/// The point light: irradiance falls with the squared distance.
#[inline(always)]
pub(super) fn sample<F: Real>(light: &LightRow<F>, origin: Vec3<F>, _: [F; 2]) -> LightSample<F> {
    let row = light.of::<PicturePointRow>();
    let to = row.position() - origin;
    let d2 = to.length2();
    let d = d2.sqrt();
    let direction = to.scale(d.recip());
    let local = -Vec3::new(row.x().dot(direction), row.y().dot(direction), row.z().dot(direction));
    let local = local.normalize();
    let (number, extent) = (row.number(), [row.half_width(), row.half_height()]);
    let lanes = light.is(kind::PICTURE_POINT);
    let mut colour = Rgb::zero();
    for (k, picture) in light.pictures.iter().enumerate() {
        let lanes = lanes & number.eq(F::lit(k as f64));
        if lanes.any() {
            colour = Rgb::select(lanes, picture.around(local, extent), colour);
        }
    }
    let radiance = light.radiance() * colour;
    LightSample {
        direction,
        distance: d * F::lit(1.0 - SHADOW_SHORTENING),
        radiance: radiance.scale(d2.recip()),
        pdf: F::one(),
        delta: F::Mask::from_bits(u32::MAX),
        valid: d2.gt(F::zero()) & radiance.max_component().gt(F::zero()),
    }
}

/// The colour that surfaces with a picture show at a point of theirs; white in lanes of other lights.
#[inline(always)]
pub(super) fn shown<F: Real>(light: &LightRow<F>, point: Vec3<F>) -> Rgb<F> {
    let white = Rgb::all(F::one());
    let lanes = light.is(kind::PICTURE_TRIANGLE);
    if !lanes.any() {
        return white;
    }
    let row = light.of::<FlatPictureRow>();
    let from_corner = point - row.corner();
    let u = row.along_u().dot(from_corner) + row.u();
    let v = row.along_v().dot(from_corner) + row.v();
    let at = [u, F::one() - v];
    let number = row.number();
    let mut colour = white;
    for (k, picture) in light.pictures.iter().enumerate() {
        let lanes = lanes & number.eq(F::lit(k as f64));
        if lanes.any() {
            colour = Rgb::select(lanes, picture.picture.bilinear(at), colour);
        }
    }
    colour
}
