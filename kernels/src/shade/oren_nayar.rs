//! Oren-Nayar: diffuse reflection of rough surfaces (Oren and Nayar 1994, the qualitative model).
//!
//! f = (reflectance / pi) (A + B max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta)), alpha the larger and beta the
//! smaller of the two polar angles, A and B functions of the standard deviation s of the facets' slope angle, in
//! radians.

use super::bsdf::{Bsdf, BsdfSample};
use super::materials::Material;
use super::parameters::{Range, UNIT, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3, cosine_hemisphere};
use core::f64::consts::FRAC_1_PI;

parameters! {
    /// An Oren-Nayar surface.
    OrenNayar {
        /// Albedo.
        reflectance: [f32; 3], UNIT;
        /// Standard deviation of the facets' slope angle, degrees.
        sigma: f32, Range { least: 0.0, most: 90.0 };
    } derived {
        /// A, in [0.5, 1].
        a: f32 = coefficients(sigma).0;
        /// B, in [0, 0.45].
        b: f32 = coefficients(sigma).1;
    }
}

impl Material for OrenNayar {
    type Bsdf<F: Real> = RoughDiffuseReflection<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> RoughDiffuseReflection<F> {
        RoughDiffuseReflection { reflectance: at.reflectance, a: at.a, b: at.b }
    }
}

/// The qualitative model.
#[derive(Clone, Copy)]
pub struct RoughDiffuseReflection<F: Real> {
    reflectance: Rgb<F>,
    a: F,
    b: F,
}

/// A = 1 - s^2 / (2 (s^2 + 0.33)) and B = 0.45 s^2 / (s^2 + 0.09), of `sigma` in degrees.
fn coefficients(sigma: f32) -> (f32, f32) {
    let s2 = (sigma as f64).to_radians().powi(2);
    let a = 1.0 - s2 / (2.0 * (s2 + 0.33));
    let b = 0.45 * s2 / (s2 + 0.09);
    (a as f32, b as f32)
}

impl<F: Real> RoughDiffuseReflection<F> {
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

impl<F: Real> Bsdf<F> for RoughDiffuseReflection<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;
    const COMMON: bool = true;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, _lobe: F, u: [F; 2]) -> BsdfSample<F> {
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
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let cos = wi.z.max(F::zero());
        self.reflectance.scale(self.roughness_factor(wo, wi) * cos * F::lit(FRAC_1_PI))
    }
    #[inline(always)]
    fn pdf(&self, _wo: Vec3<F>, wi: Vec3<F>) -> F {
        wi.z.max(F::zero()) * F::lit(FRAC_1_PI)
    }
}
