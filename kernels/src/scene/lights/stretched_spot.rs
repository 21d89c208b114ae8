//! A spot light under a transform that does not keep angles: its cone is round in the light's own space, and an ellipse
//! in the world.

use super::{LightRow, LightSample, SHADOW_SHORTENING, fall_off};
use crate::lanes::{Mask, Real};
use crate::math::Vec3;
use crate::scene::rows::row;

row! {
    /// A point with a cone in a space of its own. The radiance of the light is the intensity on the axis.
    StretchedSpotRow StretchedSpotLanes {
        /// Where, in the world.
        position: [f32; 3],
        /// Rows of the matrix that takes directions of the world into the light's space.
        x: [f32; 3],
        /// See `x`.
        y: [f32; 3],
        /// See `x`.
        z: [f32; 3],
        /// Unit axis of the cone in the light's space, away from the light.
        axis: [f32; 3],
        /// Cosine of the angle where it begins to fade, in the light's space.
        cos_falloff_start: f32,
        /// Cosine of the angle where it is dark, in the light's space.
        cos_total_width: f32,
        /// How it fades, one of [`fade`](super::fade).
        fade: f32,
    }
}

/// The direction towards the point; irradiance falls with the squared distance, which is one of the world.
#[inline(always)]
pub(super) fn sample<F: Real>(light: &LightRow<F>, origin: Vec3<F>, _: [F; 2]) -> LightSample<F> {
    let row = light.of::<StretchedSpotRow>();
    let to = row.position() - origin;
    let d2 = to.length2();
    let d = d2.sqrt();
    let direction = to.scale(d.recip());
    let local = Vec3::new(row.x().dot(direction), row.y().dot(direction), row.z().dot(direction));
    let cos = -row.axis().dot(local.normalize());
    let fall_off = fall_off(cos, row.cos_falloff_start(), row.cos_total_width(), row.fade());
    LightSample {
        direction,
        distance: d * F::lit(1.0 - SHADOW_SHORTENING),
        radiance: light.radiance().scale(fall_off / d2),
        pdf: F::one(),
        delta: F::Mask::from_bits(u32::MAX),
        valid: d2.gt(F::zero()) & fall_off.gt(F::zero()),
    }
}
