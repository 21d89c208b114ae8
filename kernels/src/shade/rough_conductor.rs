//! Rough conductor: GGX microfacets (Walter et al. 2007) with height-correlated Smith shadowing (Heitz 2014),
//! sampled by visible normals (Heitz 2018; the spherical-cap form of Dupuy and Benyoub 2023).
//!
//! f = F(wi.h) D(h) G2(wo, wi) / (4 cos_i cos_o), h the half vector.

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::parameters::{NOT_NEGATIVE, Range, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};
use core::f64::consts::PI;

parameters! {
    /// A rough conductor.
    RoughConductor {
        /// Real part of the index.
        eta: [f32; 3], NOT_NEGATIVE;
        /// Absorption coefficient.
        k: [f32; 3], NOT_NEGATIVE;
        /// GGX alpha.
        alpha: f32, Range { least: 1e-3, ..NOT_NEGATIVE };
    }
}

impl Material for RoughConductor {
    type Bsdf<F: Real> = MicrofacetConductor<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> MicrofacetConductor<F> {
        MicrofacetConductor { eta: at.eta, k: at.k, alpha: at.alpha }
    }
}

/// Reflection from the microfacets of a conductor.
#[derive(Clone, Copy)]
pub struct MicrofacetConductor<F: Real> {
    eta: Rgb<F>,
    k: Rgb<F>,
    alpha: F,
}

impl<F: Real> MicrofacetConductor<F> {
    /// GGX distribution of normals.
    ///
    /// 1 - cos^2 (1 - alpha^2) is formed as sin^2 + alpha^2 cos^2: no cancellation for small alpha near the normal.
    #[inline(always)]
    fn distribution(&self, h: Vec3<F>) -> F {
        let a2 = self.alpha * self.alpha;
        let sin2 = h.x.mul_add(h.x, h.y * h.y);
        let s = a2.mul_add(h.z * h.z, sin2);
        a2 / (F::lit(PI) * s * s)
    }
    /// sqrt(1 + alpha^2 tan^2) cos = sqrt(cos^2 + alpha^2 sin^2): Smith's Lambda is (that / cos - 1) / 2.
    #[inline(always)]
    fn smith(&self, w: Vec3<F>) -> F {
        let sin2 = w.x.mul_add(w.x, w.y * w.y);
        (self.alpha * self.alpha).mul_add(sin2, w.z * w.z).sqrt()
    }
    #[inline(always)]
    fn half(wo: Vec3<F>, wi: Vec3<F>) -> Vec3<F> {
        (wo + wi).normalize()
    }
}

impl<F: Real> Bsdf<F> for MicrofacetConductor<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;
    const COMMON: bool = true;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, _lobe: F, u: [F; 2]) -> BsdfSample<F> {
        // The hemisphere configuration, a uniform point on the spherical cap below wo, and back.
        let stretched = Vec3::new(wo.x * self.alpha, wo.y * self.alpha, wo.z).normalize();
        // z = (1 - u)(1 + wo.z) - wo.z.
        let z = (F::one() - u[0]).mul_sub(F::one() + stretched.z, stretched.z);
        let r = z.neg_mul_add(z, F::one()).max(F::zero()).sqrt();
        let (sin, cos) = u[1].sin_cos_turns();
        let cap = Vec3::new(r * cos, r * sin, z);
        let n = cap + stretched;
        let h = Vec3::new(n.x * self.alpha, n.y * self.alpha, n.z.max(F::zero())).normalize();
        let wo_h = wo.dot(h);
        let wi = h.mul_add(wo_h + wo_h, -wo).normalize();
        let (lo, li) = (self.smith(wo), self.smith(wi));
        // f cos / pdf = F G2 / G1(wo) = F wi.z (wo.z + lo) / (wi.z lo + wo.z li).
        let ratio = wi.z * (wo.z + lo) / (wi.z.mul_add(lo, wo.z * li));
        let pdf = self.distribution(h) / (F::lit(2.0) * (wo.z + lo));
        let valid =
            wi.z.gt(F::zero()) & wo.z.gt(F::zero()) & pdf.gt(F::zero()) & pdf.lt(F::lit(f32::MAX as f64));
        BsdfSample {
            wi,
            weight: fresnel::conductor(wo_h.max(F::zero()), self.eta, self.k).scale(ratio),
            pdf,
            eta_scale: F::one(),
            valid,
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let h = Self::half(wo, wi);
        let (lo, li) = (self.smith(wo), self.smith(wi));
        // D G2 / (4 cos_o cos_i) cos_i, with G2 = 2 cos_i cos_o / (cos_i lo + cos_o li).
        let cos = wi.z.max(F::zero());
        let value = self.distribution(h) * F::lit(0.5) * cos / (wi.z.mul_add(lo, wo.z * li));
        let above = wi.z.gt(F::zero()) & wo.z.gt(F::zero());
        let reflected = fresnel::conductor(wo.dot(h).max(F::zero()), self.eta, self.k).scale(value);
        Rgb::select(above, reflected, Rgb::zero())
    }
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let h = Self::half(wo, wi);
        // G1(wo) D(h) / (4 cos_o), with G1 = 2 cos_o / (cos_o + lo).
        let density = self.distribution(h) / (F::lit(2.0) * (wo.z + self.smith(wo)));
        F::select(wi.z.gt(F::zero()) & wo.z.gt(F::zero()), density, F::zero())
    }
}
