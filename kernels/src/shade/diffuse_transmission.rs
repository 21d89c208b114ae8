//! Diffuse reflection and diffuse transmission, as of paper, leaves and lampshades (pbrt-v4's `diffusetransmission`).
//!
//! f = reflectance / pi for directions on the same side of the surface, transmittance / pi for those on two sides.

use super::bsdf::{Bsdf, BsdfSample};
use super::materials::Material;
use super::parameters::{UNIT, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3, cosine_hemisphere};
use core::f64::consts::FRAC_1_PI;

parameters! {
    /// A surface that scatters light to both sides, in all directions alike.
    DiffuseTransmission {
        /// Share of the light that is reflected.
        reflectance: [f32; 3], UNIT;
        /// Share of the light that passes.
        transmittance: [f32; 3], UNIT;
    }
}

impl Material for DiffuseTransmission {
    type Bsdf<F: Real> = DiffuseReflectionTransmission<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> DiffuseReflectionTransmission<F> {
        let (reflected, passed) = (at.reflectance.max_component(), at.transmittance.max_component());
        DiffuseReflectionTransmission {
            reflectance: at.reflectance,
            transmittance: at.transmittance,
            // Where both are 0 nothing is sampled; the density there is 0, not 0 / 0.
            reflects: reflected / (reflected + passed).max(F::lit(f32::MIN_POSITIVE as f64)),
            transmits: passed / (reflected + passed).max(F::lit(f32::MIN_POSITIVE as f64)),
        }
    }
}

/// Ideal diffuse reflection and transmission.
#[derive(Clone, Copy)]
pub struct DiffuseReflectionTransmission<F: Real> {
    reflectance: Rgb<F>,
    transmittance: Rgb<F>,
    /// Probability of sampling the reflection: by the largest channels.
    reflects: F,
    /// Probability of sampling the transmission.
    transmits: F,
}

impl<F: Real> DiffuseReflectionTransmission<F> {
    /// Cosine of `wi` to the normal on its own side, and whether it is on the side of `wo`.
    #[inline(always)]
    fn side(wo: Vec3<F>, wi: Vec3<F>) -> (F, F::Mask) {
        (wi.z.abs(), wi.z.xor_sign(wo.z).gt(F::zero()))
    }
}

impl<F: Real> Bsdf<F> for DiffuseReflectionTransmission<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = true;
    const SCALES_RADIANCE: bool = false;
    const COMMON: bool = true;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, lobe: F, u: [F; 2]) -> BsdfSample<F> {
        let reflect = lobe.lt(self.reflects);
        let up = cosine_hemisphere(u);
        let cos = up.z.xor_sign(wo.z);
        let wi = Vec3::new(up.x, up.y, F::select(reflect, cos, -cos));
        // f cos / pdf = (reflectance / pi) cos / (probability cos / pi).
        let colour = Rgb::select(reflect, self.reflectance, self.transmittance);
        let probability = F::select(reflect, self.reflects, self.transmits);
        BsdfSample {
            wi,
            weight: colour.scale(probability.recip()),
            pdf: probability * up.z * F::lit(FRAC_1_PI),
            eta_scale: F::one(),
            valid: up.z.gt(F::zero()) & probability.gt(F::zero()),
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let (cos, same) = Self::side(wo, wi);
        Rgb::select(same, self.reflectance, self.transmittance).scale(cos * F::lit(FRAC_1_PI))
    }
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let (cos, same) = Self::side(wo, wi);
        F::select(same, self.reflects, self.transmits) * cos * F::lit(FRAC_1_PI)
    }
}
