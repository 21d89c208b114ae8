//! Thin pane of a smooth dielectric: both interfaces and all reflections between them in one, without an offset.
//!
//! With R the Fresnel reflectance of one interface: reflected R + (1 - R)^2 R / (1 - R^2) = 2 R / (1 + R), the rest
//! goes straight on.

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::parameters::{POSITIVE, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};

parameters! {
    /// A thin pane.
    ThinDielectric {
        /// Index of the pane over the index around it.
        eta: f32, POSITIVE;
    }
}

impl Material for ThinDielectric {
    type Bsdf<F: Real> = SpecularPane<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> SpecularPane<F> {
        SpecularPane { eta: at.eta }
    }
}

/// Reflection from a thin pane, and the way straight through it.
#[derive(Clone, Copy)]
pub struct SpecularPane<F: Real> {
    eta: F,
}

impl<F: Real> Bsdf<F> for SpecularPane<F> {
    const SPECULAR: bool = true;
    const TRANSMITS: bool = true;
    const SCALES_RADIANCE: bool = false;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, lobe: F, _u: [F; 2]) -> BsdfSample<F> {
        let (once, _, _) = fresnel::dielectric(wo.z.abs(), self.eta);
        let reflected = (once + once) / (F::one() + once);
        let reflect = lobe.lt(reflected);
        BsdfSample {
            wi: Vec3::new(-wo.x, -wo.y, F::select(reflect, wo.z, -wo.z)),
            weight: Rgb::all(F::one()),
            pdf: F::zero(),
            eta_scale: F::one(),
            valid: wo.z.abs().gt(F::zero()),
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
