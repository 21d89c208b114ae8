//! Rough conductor whose microfacets are wider along one tangent than along the other: brushed metal.
//!
//! f = F(wi.h) D(h) G2(wo, wi) / (4 cos_i cos_o), h the half vector, as for [`rough_conductor`](super::rough_conductor),
//! which is the case of equal roughness.

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::microfacet::{Ggx, reflect};
use super::parameters::{NOT_NEGATIVE, Range, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};

parameters! {
    /// A brushed conductor.
    AnisotropicConductor {
        /// Real part of the index.
        eta: [f32; 3], NOT_NEGATIVE;
        /// Absorption coefficient.
        k: [f32; 3], NOT_NEGATIVE;
        /// GGX alpha along the first tangent.
        alpha_u: f32, Range { least: 1e-4, ..NOT_NEGATIVE };
        /// GGX alpha along the second tangent.
        alpha_v: f32, Range { least: 1e-4, ..NOT_NEGATIVE };
    }
}

impl Material for AnisotropicConductor {
    type Bsdf<F: Real> = BrushedConductor<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> BrushedConductor<F> {
        BrushedConductor { eta: at.eta, k: at.k, ggx: Ggx { u: at.alpha_u, v: at.alpha_v } }
    }
}

/// Reflection from the microfacets of a brushed conductor.
#[derive(Clone, Copy)]
pub struct BrushedConductor<F: Real> {
    eta: Rgb<F>,
    k: Rgb<F>,
    ggx: Ggx<F>,
}

impl<F: Real> Bsdf<F> for BrushedConductor<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;
    const ANISOTROPIC: bool = true;

    #[inline(always)]
    fn stretched(&self) -> F::Mask {
        self.ggx.stretched()
    }

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, _lobe: F, u: [F; 2]) -> BsdfSample<F> {
        let h = self.ggx.sample(wo, u);
        let wi = reflect(wo, h);
        let pdf = self.ggx.visible(wo, h) * F::lit(0.25);
        let valid =
            wi.z.gt(F::zero()) & wo.z.gt(F::zero()) & pdf.gt(F::zero()) & pdf.lt(F::lit(f32::MAX as f64));
        let reflected = fresnel::conductor(wo.dot(h).max(F::zero()), self.eta, self.k);
        BsdfSample {
            wi,
            weight: reflected.scale(self.ggx.seen_again(wo, wi)),
            pdf,
            eta_scale: F::one(),
            valid,
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let h = (wo + wi).normalize();
        let value = self.ggx.distribution(h) * self.ggx.shadowing(wo, wi) * F::lit(0.25) * wi.z;
        let reflected = fresnel::conductor(wo.dot(h).max(F::zero()), self.eta, self.k).scale(value);
        Rgb::select(wi.z.gt(F::zero()) & wo.z.gt(F::zero()), reflected, Rgb::zero())
    }
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let h = (wo + wi).normalize();
        let density = self.ggx.visible(wo, h) * F::lit(0.25);
        F::select(wi.z.gt(F::zero()) & wo.z.gt(F::zero()), density, F::zero())
    }
}
