//! What the lobes of every material offer: sample, eval, pdf, in the frame of its shading normal.

use crate::lanes::{Mask, Real};
use crate::math::{Rgb, Vec3};

/// A sampled direction.
#[derive(Clone, Copy)]
pub struct BsdfSample<F: Real> {
    /// Incident direction (towards the light), unit, in the frame of the shading normal.
    pub wi: Vec3<F>,
    /// f |cos| / pdf; for a specular lobe its reflectance over the probability of choosing it.
    pub weight: Rgb<F>,
    /// Density over solid angle; 0 says specular: no other strategy finds this direction.
    pub pdf: F,
    /// What the sample does to the radiance scaling of the path: the squared relative index where it refracts, 1
    /// elsewhere (see `roulette_compact`).
    pub eta_scale: F,
    /// Lanes in which there is such a direction. Others end the path.
    pub valid: F::Mask,
}

/// The lobes of a material at a point. Directions are unit, away from the surface, in the frame of the shading normal; `wo` is on
/// the side of +z for materials that do not transmit (the frame is turned), on either side for those that do.
pub trait Bsdf<F: Real>: Copy {
    /// Are all lobes specular? Then lights are not sampled and [`Bsdf::eval`] is not called.
    const SPECULAR: bool;
    /// Does light pass through?
    const TRANSMITS: bool;
    /// Does light that passes change its radiance, by another index of refraction on the other side? Then
    /// [`BsdfSample::eta_scale`] is heeded.
    const SCALES_RADIANCE: bool;
    /// Is it worth a kernel for each set of kinds of lights? Others have one for none and one for all, so that more
    /// materials do not take many times longer to compile.
    const COMMON: bool = false;
    /// Does it matter which way the tangents lie? Then the first of the frame is along the coordinate u.
    const ANISOTROPIC: bool = false;
    /// Lanes in which it does, of those that are [`Bsdf::ANISOTROPIC`].
    #[inline(always)]
    fn stretched(&self) -> F::Mask {
        F::Mask::from_bits(0)
    }
    /// Samples an incident direction: a lobe by the number `lobe`, a direction of it by `u`, all uniform in [0, 1) and
    /// independent. Where all lobes are specular, and take no direction, `lobe` is the first number of `u`.
    fn sample(&self, wo: Vec3<F>, lobe: F, u: [F; 2]) -> BsdfSample<F>;
    /// f(wo, wi) |cos wi| for radiance.
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F>;
    /// Density over solid angle with which [`Bsdf::sample`] takes `wi`.
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F;
}
