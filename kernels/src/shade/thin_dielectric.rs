//! Thin pane of a smooth dielectric: both interfaces and all reflections between them in one, without an offset.
//!
//! | column | parameter | range |
//! |---|---|---|
//! | 0 | `eta`, index of the pane over the index around it | above 0 |
//!
//! With R the Fresnel reflectance of one interface: reflected R + (1 - R)^2 R / (1 - R^2) = 2 R / (1 + R), the rest
//! goes straight on.

use super::bsdf::{Bsdf, BsdfSample, MaterialRow};
use super::fresnel;
use crate::lanes::Real;
use crate::math::Vec3;

/// Thin pane.
#[derive(Clone, Copy)]
pub struct ThinDielectric<F: Real> {
    eta: F,
}

/// The parameters of a thin pane.
pub fn row(eta: f32) -> [f32; 8] {
    [eta, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
}

impl<F: Real> Bsdf<F> for ThinDielectric<F> {
    const SPECULAR: bool = true;
    const TRANSMITS: bool = true;

    #[inline(always)]
    fn load(row: MaterialRow<F>) -> Self {
        ThinDielectric { eta: row.get(0) }
    }
    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
        let (once, _, _) = fresnel::dielectric(wo.z.abs(), self.eta);
        let reflected = (once + once) / (F::one() + once);
        let reflect = u[0].lt(reflected);
        BsdfSample {
            wi: Vec3::new(-wo.x, -wo.y, F::select(reflect, wo.z, -wo.z)),
            weight: Vec3::all(F::one()),
            pdf: F::zero(),
            eta_scale: F::one(),
            valid: wo.z.abs().gt(F::zero()),
        }
    }
    #[inline(always)]
    fn eval(&self, _wo: Vec3<F>, _wi: Vec3<F>) -> Vec3<F> {
        Vec3::zero()
    }
    #[inline(always)]
    fn pdf(&self, _wo: Vec3<F>, _wi: Vec3<F>) -> F {
        F::zero()
    }
}
