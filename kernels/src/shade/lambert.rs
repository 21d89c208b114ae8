//! Lambert: ideal diffuse reflection.
//!
//! f = reflectance / pi.

use super::bsdf::{Bsdf, BsdfSample};
use super::materials::Material;
use super::parameters::{UNIT, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3, cosine_hemisphere};
use core::f64::consts::FRAC_1_PI;

parameters! {
    /// A Lambert surface.
    Lambert {
        /// Albedo.
        reflectance: [f32; 3], UNIT;
    }
}

impl Material for Lambert {
    type Bsdf<F: Real> = DiffuseReflection<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> DiffuseReflection<F> {
        DiffuseReflection { reflectance: at.reflectance }
    }
}

/// Ideal diffuse reflection.
#[derive(Clone, Copy)]
pub struct DiffuseReflection<F: Real> {
    reflectance: Rgb<F>,
}

impl<F: Real> Bsdf<F> for DiffuseReflection<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;
    const COMMON: bool = true;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, _lobe: F, u: [F; 2]) -> BsdfSample<F> {
        let wi = cosine_hemisphere(u);
        BsdfSample {
            wi,
            // f cos / pdf = (reflectance / pi) cos / (cos / pi).
            weight: self.reflectance,
            pdf: self.pdf(wo, wi),
            eta_scale: F::one(),
            valid: wi.z.gt(F::zero()),
        }
    }
    #[inline(always)]
    fn eval(&self, _wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        self.reflectance.scale(wi.z.max(F::zero()) * F::lit(FRAC_1_PI))
    }
    #[inline(always)]
    fn pdf(&self, _wo: Vec3<F>, wi: Vec3<F>) -> F {
        wi.z.max(F::zero()) * F::lit(FRAC_1_PI)
    }
}
