//! A point light that shines more in some directions than in others, as luminaires do.
//!
//! One pattern so far, the batwing of lamps that light streets and large rooms: around the axis, with `c` the cosine of
//! the angle between axis and direction, the intensity relative to the largest one is
//!
//! ```text
//!     (1 / (2 c))^3    for 1/2 <= c,
//!     3 x^2 - 2 x^3    for 0 <= c < 1/2, x = 2 c,
//!     0                behind.
//! ```
//!
//! On a plane across the axis the irradiance of a point light falls with c^3 (c^2 for the distance, c for the
//! inclination), so out to 60 degrees it is the same everywhere; it fades out further on. The pattern integrates to 7/8
//! pi over all directions.

use super::{LightRow, LightSample, SHADOW_SHORTENING};
use crate::lanes::{Mask, Real};
use crate::math::Vec3;
use crate::scene::rows::row;

row! {
    /// A point and an axis. The radiance of the light is its largest intensity.
    GoniometricRow GoniometricLanes {
        /// Where.
        position: [f32; 3],
        /// Unit axis of the pattern, away from the light.
        axis: [f32; 3],
    }
}

/// Integral of [`pattern`] over all directions.
pub const INTEGRAL: f64 = 7.0 / 8.0 * core::f64::consts::PI;

/// The intensity relative to the largest one, at an angle to the axis with this cosine.
#[inline(always)]
pub fn pattern<F: Real>(cos: F) -> F {
    let x = cos.max(F::zero()) * F::lit(2.0);
    let near_axis = (x * x * x).recip();
    let outside = x * x * x.neg_mul_add(F::lit(2.0), F::lit(3.0));
    F::select(x.ge(F::one()), near_axis, outside)
}

/// The direction towards the point; irradiance falls with the squared distance.
#[inline(always)]
pub(super) fn sample<F: Real>(light: &LightRow<F>, origin: Vec3<F>, _: [F; 2]) -> LightSample<F> {
    let row = light.of::<GoniometricRow>();
    let to = row.position() - origin;
    let d2 = to.length2();
    let d = d2.sqrt();
    let direction = to.scale(d.recip());
    let pattern = pattern(-row.axis().dot(direction));
    LightSample {
        direction,
        distance: d * F::lit(1.0 - SHADOW_SHORTENING),
        radiance: light.radiance().scale(pattern / d2),
        pdf: F::one(),
        delta: F::Mask::from_bits(u32::MAX),
        valid: d2.gt(F::zero()) & pattern.gt(F::zero()),
    }
}
