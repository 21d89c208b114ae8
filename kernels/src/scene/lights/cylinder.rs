//! Round cylinder, open at both ends, or a part of one by azimuth: sampled uniformly over its surface.
//!
//! From outside the near wall hides the inside of the far one, and what of the outside looks away is left out by its
//! normal; what of the inside is seen through the ends, shadow rays find out.

use super::{LightRow, LightSample, SHADOW_SHORTENING, sphere_slack, towards_point};
use crate::lanes::Real;
use crate::math::Vec3;
use crate::scene::rows::row;

row! {
    /// A cylinder. Its points are `base + u axis + radius (cos phi, sin phi)` in the plane across the axis.
    CylinderRow CylinderLanes {
        /// Centre of one rim.
        base: [f32; 3],
        /// From there to the centre of the other.
        axis: [f32; 3],
        /// From the base to where the azimuth is 0.
        first: [f32; 3],
        /// Largest azimuth in turns; negative, azimuths run the other way around the axis.
        turns: f32,
        /// 1: the outside emits; -1: the inside.
        side: f32,
    }
}

/// Radius and area.
#[inline(always)]
fn size<F: Real>(row: &CylinderLanes<F>) -> (F, F) {
    let radius = row.first().length2().sqrt();
    let around = F::lit(core::f64::consts::TAU) * radius * row.turns().abs();
    (radius, around * row.axis().length2().sqrt())
}

#[inline(always)]
pub(super) fn sample<F: Real>(light: &LightRow<F>, origin: Vec3<F>, u: [F; 2]) -> LightSample<F> {
    let row = light.of::<CylinderRow>();
    let (axis, first, turns) = (row.axis(), row.first(), row.turns());
    let (radius, area) = size(&row);
    let second = axis.normalize().cross(first);
    let (sin, cos) = (u[0] * turns.abs()).sin_cos_turns();
    let outwards = first.scale(cos) + second.scale(sin.xor_sign(turns));
    let point = axis.mul_add(u[1], row.base() + outwards);
    let normal = outwards.scale(radius.recip()).xor_sign(row.side());
    let mut out = towards_point(light, origin, point, normal, area);
    let cos = normal.dot(out.direction).abs();
    let slack = sphere_slack(radius, radius * cos);
    out.distance = out.distance.mul_add(F::lit(1.0 - SHADOW_SHORTENING), -slack).max(F::zero());
    out
}

#[inline(always)]
pub(super) fn pdf<F: Real>(
    light: &LightRow<F>,
    _origin: Vec3<F>,
    direction: Vec3<F>,
    t: F,
    normal: Vec3<F>,
) -> F {
    let (_, area) = size(&light.of::<CylinderRow>());
    t * t / (normal.dot(direction).abs() * area)
}
