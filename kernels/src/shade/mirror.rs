//! Ideal mirror: the same reflectance at every angle, as pbrt-v3's `mirror` has it.

use super::bsdf::{Bsdf, BsdfSample};
use super::materials::Material;
use super::parameters::{UNIT, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};

parameters! {
    /// An ideal mirror.
    Mirror {
        /// What it reflects.
        reflectance: [f32; 3], UNIT;
    }
}

impl Material for Mirror {
    type Bsdf<F: Real> = IdealReflection<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> IdealReflection<F> {
        IdealReflection { reflectance: at.reflectance }
    }
}

/// Mirror reflection by the same share at every angle.
#[derive(Clone, Copy)]
pub struct IdealReflection<F: Real> {
    reflectance: Rgb<F>,
}

impl<F: Real> Bsdf<F> for IdealReflection<F> {
    const SPECULAR: bool = true;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, _lobe: F, _u: [F; 2]) -> BsdfSample<F> {
        BsdfSample {
            wi: Vec3::new(-wo.x, -wo.y, wo.z),
            weight: self.reflectance,
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
