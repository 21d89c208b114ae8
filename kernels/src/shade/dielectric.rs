//! Smooth dielectric: reflects with the Fresnel reflectance, refracts the rest by Snell's law.
//!
//! The normal points outside. Radiance that crosses the interface is scaled by the squared relative index
//! (Veach 1997, section 5.2).

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::parameters::{NOT_NEGATIVE, POSITIVE, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};

parameters! {
    /// A smooth dielectric.
    Dielectric {
        /// Index inside over index outside.
        eta: f32, POSITIVE;
        /// Tint of reflected light.
        reflectance: [f32; 3], NOT_NEGATIVE;
        /// Tint of transmitted light.
        transmittance: [f32; 3], NOT_NEGATIVE;
    }
}

impl Material for Dielectric {
    type Bsdf<F: Real> = SpecularDielectric<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> SpecularDielectric<F> {
        SpecularDielectric { eta: at.eta, reflectance: at.reflectance, transmittance: at.transmittance }
    }
}

/// Reflection and refraction at a smooth interface.
#[derive(Clone, Copy)]
pub struct SpecularDielectric<F: Real> {
    eta: F,
    reflectance: Rgb<F>,
    transmittance: Rgb<F>,
}

impl<F: Real> Bsdf<F> for SpecularDielectric<F> {
    const SPECULAR: bool = true;
    const TRANSMITS: bool = true;
    const SCALES_RADIANCE: bool = true;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, lobe: F, _u: [F; 2]) -> BsdfSample<F> {
        let cos_o = wo.z.abs();
        // Relative index seen from the side of wo.
        let eta = F::select(wo.z.gt(F::zero()), self.eta, self.eta.recip());
        let (reflected, cos_t, total) = fresnel::dielectric(cos_o, eta);
        // The lobe is chosen by its Fresnel reflectance, so weights are the tints alone.
        let reflect = lobe.lt(reflected) | total;
        let inverse = eta.recip();
        let refracted = Vec3::new(-wo.x * inverse, -wo.y * inverse, (-cos_t).xor_sign(wo.z));
        let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
        let scale = F::select(reflect, F::one(), eta * eta);
        let tint = Rgb::select(reflect, self.reflectance, self.transmittance);
        BsdfSample {
            wi: Vec3::select(reflect, mirrored, refracted).normalize(),
            // Radiance falls by eta^2 on its way from the denser side.
            weight: tint.scale(scale.recip()),
            pdf: F::zero(),
            eta_scale: scale,
            valid: cos_o.gt(F::zero()),
        }
    }
    #[inline(always)]
    fn eval(&self, _wo: Vec3<F>, _wi: Vec3<F>) -> Rgb<F> {
        Rgb::zero()
    }
    #[inline(always)]
    fn pdf(&self, _wo: Vec3<F>, _wi: Vec3<F>) -> F {
        F::zero()
    }
}
