//! Smooth conductor: mirror reflection with the Fresnel reflectance of a complex index, or with the same reflectance at
//! every angle (an ideal mirror).
//!
//! | column | parameter | range |
//! |---|---|---|
//! | 0..3 | `eta`, real part of the index; of an ideal mirror its reflectance | above 0 |
//! | 3..6 | `k`, absorption coefficient | 0 and above |
//! | 6 | whether it is an ideal mirror | 0 or 1 |

use super::bsdf::{Bsdf, BsdfSample, MaterialRow};
use super::fresnel;
use crate::lanes::Real;
use crate::math::Vec3;

/// Smooth conductor.
#[derive(Clone, Copy)]
pub struct Conductor<F: Real> {
    eta: Vec3<F>,
    k: Vec3<F>,
    ideal: F::Mask,
}

/// The parameters of an ideal mirror.
pub fn mirror_row(reflectance: [f32; 3]) -> [f32; 8] {
    let [r, g, b] = reflectance;
    [r, g, b, 0.0, 0.0, 0.0, 1.0, 0.0]
}

/// The parameters of a smooth conductor.
pub fn row(eta: [f32; 3], k: [f32; 3]) -> [f32; 8] {
    [eta[0], eta[1], eta[2], k[0], k[1], k[2], 0.0, 0.0]
}

impl<F: Real> Bsdf<F> for Conductor<F> {
    const SPECULAR: bool = true;
    const TRANSMITS: bool = false;

    #[inline(always)]
    fn load(row: MaterialRow<F>) -> Self {
        Conductor { eta: row.vector(0), k: row.vector(3), ideal: row.get(6).gt(F::zero()) }
    }
    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, _u: [F; 2]) -> BsdfSample<F> {
        BsdfSample {
            wi: Vec3::new(-wo.x, -wo.y, wo.z),
            weight: Vec3::select(self.ideal, self.eta, fresnel::conductor(wo.z, self.eta, self.k)),
            pdf: F::zero(),
            eta_scale: F::one(),
            valid: wo.z.gt(F::zero()),
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
