//! Smooth conductor: mirror reflection with the Fresnel reflectance of a complex index.
//!

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::parameters::{NOT_NEGATIVE, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};

parameters! {
    /// A smooth conductor.
    Conductor {
        /// Real part of the index.
        eta: [f32; 3], NOT_NEGATIVE;
        /// Absorption coefficient.
        k: [f32; 3], NOT_NEGATIVE;
    }
}

impl Material for Conductor {
    type Bsdf<F: Real> = SpecularConductor<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> SpecularConductor<F> {
        SpecularConductor { eta: at.eta, k: at.k }
    }
}

/// Mirror reflection of a conductor.
#[derive(Clone, Copy)]
pub struct SpecularConductor<F: Real> {
    eta: Rgb<F>,
    k: Rgb<F>,
}

impl<F: Real> Bsdf<F> for SpecularConductor<F> {
    const SPECULAR: bool = true;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, _lobe: F, _u: [F; 2]) -> BsdfSample<F> {
        BsdfSample {
            wi: Vec3::new(-wo.x, -wo.y, wo.z),
            weight: fresnel::conductor(wo.z, self.eta, self.k),
            pdf: F::zero(),
            eta_scale: F::one(),
            valid: wo.z.gt(F::zero()),
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
