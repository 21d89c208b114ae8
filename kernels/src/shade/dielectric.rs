//! Smooth dielectric: reflects with the Fresnel reflectance, refracts the rest by Snell's law.
//!
//! | column | parameter | range |
//! |---|---|---|
//! | 0 | `eta`, index inside over index outside | above 0 |
//! | 1..4 | tint of reflected light | 0 and above |
//! | 4..7 | tint of transmitted light | 0 and above |
//!
//! The normal points outside. Radiance that crosses the interface is scaled by the squared relative index
//! (Veach 1997, section 5.2).

use super::bsdf::{Bsdf, BsdfSample, MaterialRow};
use super::fresnel;
use crate::lanes::Real;
use crate::math::Vec3;

/// Smooth dielectric.
#[derive(Clone, Copy)]
pub struct Dielectric<F: Real> {
    eta: F,
    reflectance: Vec3<F>,
    transmittance: Vec3<F>,
}

/// The parameters of a smooth dielectric.
pub fn row(eta: f32, reflectance: [f32; 3], transmittance: [f32; 3]) -> [f32; 8] {
    let ([r0, r1, r2], [t0, t1, t2]) = (reflectance, transmittance);
    [eta, r0, r1, r2, t0, t1, t2, 0.0]
}

impl<F: Real> Bsdf<F> for Dielectric<F> {
    const SPECULAR: bool = true;
    const TRANSMITS: bool = true;

    #[inline(always)]
    fn load(row: MaterialRow<F>) -> Self {
        Dielectric { eta: row.get(0), reflectance: row.vector(1), transmittance: row.vector(4) }
    }
    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
        let cos_o = wo.z.abs();
        // Relative index seen from the side of wo.
        let eta = F::select(wo.z.gt(F::zero()), self.eta, self.eta.recip());
        let (reflected, cos_t, total) = fresnel::dielectric(cos_o, eta);
        // The lobe is chosen by its Fresnel reflectance, so weights are the tints alone.
        let reflect = u[0].lt(reflected) | total;
        let inverse = eta.recip();
        let refracted = Vec3::new(-wo.x * inverse, -wo.y * inverse, (-cos_t).xor_sign(wo.z));
        let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
        let scale = F::select(reflect, F::one(), eta * eta);
        let tint = Vec3::select(reflect, self.reflectance, self.transmittance);
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
    fn eval(&self, _wo: Vec3<F>, _wi: Vec3<F>) -> Vec3<F> {
        Vec3::zero()
    }
    #[inline(always)]
    fn pdf(&self, _wo: Vec3<F>, _wi: Vec3<F>) -> F {
        F::zero()
    }
}
