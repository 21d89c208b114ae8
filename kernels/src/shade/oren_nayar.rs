//! Oren-Nayar: diffuse reflection of rough surfaces (Oren and Nayar 1994, the qualitative model).
//!
//! | column | parameter | range |
//! |---|---|---|
//! | 0..3 | `reflectance` | [0, 1] |
//! | 3 | `A` = 1 - s^2 / (2 (s^2 + 0.33)) | [0.5, 1] |
//! | 4 | `B` = 0.45 s^2 / (s^2 + 0.09) | [0, 0.45] |
//!
//! s is the standard deviation of the facets' slope angle in radians.
//! f = (reflectance / pi) (A + B max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta)), alpha the larger and beta the
//! smaller of the two polar angles.

use super::bsdf::{Bsdf, BsdfSample, MaterialRow};
use crate::lanes::Real;
use crate::math::{Vec3, cosine_hemisphere};
use core::f64::consts::FRAC_1_PI;

/// Oren-Nayar.
#[derive(Clone, Copy)]
pub struct OrenNayar<F: Real> {
    reflectance: Vec3<F>,
    a: F,
    b: F,
}

/// The parameters of an Oren-Nayar material; `sigma` in degrees.
pub fn row(reflectance: [f32; 3], sigma: f32) -> [f32; 8] {
    let [r, g, b] = reflectance;
    let s2 = (sigma as f64).to_radians().powi(2);
    let a = 1.0 - s2 / (2.0 * (s2 + 0.33));
    let bb = 0.45 * s2 / (s2 + 0.09);
    [r, g, b, a as f32, bb as f32, 0.0, 0.0, 0.0]
}

impl<F: Real> OrenNayar<F> {
    /// A + B max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta), without trigonometry: with the projections of the unit
    /// directions onto the tangent plane, sin_i sin_o cos(phi_i - phi_o) = x_i x_o + y_i y_o, and
    /// sin(alpha) tan(beta) = sin_i sin_o / max(cos_i, cos_o).
    #[inline(always)]
    fn roughness_factor(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let tangential = wo.x.mul_add(wi.x, wo.y * wi.y).max(F::zero());
        let larger_cos = wo.z.max(wi.z);
        // Both at the horizon: the term has no limit; its bound is taken, which the cosine makes irrelevant.
        let ratio = tangential / larger_cos.max(F::lit(1e-7));
        self.b.mul_add(ratio, self.a)
    }
}

impl<F: Real> Bsdf<F> for OrenNayar<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;

    #[inline(always)]
    fn load(row: MaterialRow<F>) -> Self {
        OrenNayar { reflectance: row.vector(0), a: row.get(3), b: row.get(4) }
    }
    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
        let wi = cosine_hemisphere(u);
        BsdfSample {
            wi,
            weight: self.reflectance.scale(self.roughness_factor(wo, wi)),
            pdf: self.pdf(wo, wi),
            eta_scale: F::one(),
            valid: wi.z.gt(F::zero()),
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Vec3<F> {
        let cos = wi.z.max(F::zero());
        self.reflectance.scale(self.roughness_factor(wo, wi) * cos * F::lit(FRAC_1_PI))
    }
    #[inline(always)]
    fn pdf(&self, _wo: Vec3<F>, wi: Vec3<F>) -> F {
        wi.z.max(F::zero()) * F::lit(FRAC_1_PI)
    }
}
