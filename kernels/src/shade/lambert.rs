//! Lambert: ideal diffuse reflection.
//!
//! | column | parameter | range |
//! |---|---|---|
//! | 0..3 | `reflectance` | [0, 1] |
//!
//! f = reflectance / pi.

use super::bsdf::{Bsdf, BsdfSample, MaterialRow};
use crate::lanes::Real;
use crate::math::{Vec3, cosine_hemisphere};
use core::f64::consts::FRAC_1_PI;

/// Lambert.
#[derive(Clone, Copy)]
pub struct Lambert<F: Real> {
    reflectance: Vec3<F>,
}

/// The parameters of a Lambert material.
pub fn row(reflectance: [f32; 3]) -> [f32; 8] {
    let [r, g, b] = reflectance;
    [r, g, b, 0.0, 0.0, 0.0, 0.0, 0.0]
}

impl<F: Real> Bsdf<F> for Lambert<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;

    #[inline(always)]
    fn load(row: MaterialRow<F>) -> Self {
        Lambert { reflectance: row.vector(0) }
    }
    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
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
    fn eval(&self, _wo: Vec3<F>, wi: Vec3<F>) -> Vec3<F> {
        self.reflectance.scale(wi.z.max(F::zero()) * F::lit(FRAC_1_PI))
    }
    #[inline(always)]
    fn pdf(&self, _wo: Vec3<F>, wi: Vec3<F>) -> F {
        wi.z.max(F::zero()) * F::lit(FRAC_1_PI)
    }
}
