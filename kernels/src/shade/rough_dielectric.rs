//! Rough dielectric: reflection and refraction by GGX microfacets (Walter et al. 2007).
//!
//! With h the half vector of reflection, or the one of refraction, wo + eta wi (eta the index on the side of wi over that
//! on the side of wo), turned to the side of wo:
//!
//! - reflected f = F D G2 / (4 cos_i cos_o)
//! - refracted f = (1 - F) D G2 |wi.h wo.h / (cos_i cos_o (wi.h + wo.h / eta)^2)| / eta^2
//!
//! for radiance, which is scaled by the squared relative index as it crosses (Veach 1997, section 5.2).

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::microfacet::{Ggx, reflect};
use super::parameters::{NOT_NEGATIVE, POSITIVE, Range, parameters};
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};

parameters! {
    /// A rough dielectric.
    RoughDielectric {
        /// Index inside over index outside, not 1.
        eta: f32, POSITIVE;
        /// Tint of reflected light.
        reflectance: [f32; 3], NOT_NEGATIVE;
        /// Tint of transmitted light.
        transmittance: [f32; 3], NOT_NEGATIVE;
        /// GGX alpha along the first tangent.
        alpha_u: f32, Range { least: 1e-4, ..NOT_NEGATIVE };
        /// GGX alpha along the second tangent.
        alpha_v: f32, Range { least: 1e-4, ..NOT_NEGATIVE };
    }
}

impl Material for RoughDielectric {
    type Bsdf<F: Real> = MicrofacetDielectric<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> MicrofacetDielectric<F> {
        MicrofacetDielectric {
            eta: at.eta,
            reflectance: at.reflectance,
            transmittance: at.transmittance,
            ggx: Ggx { u: at.alpha_u, v: at.alpha_v },
        }
    }
}

/// Reflection and refraction by microfacets.
#[derive(Clone, Copy)]
pub struct MicrofacetDielectric<F: Real> {
    eta: F,
    reflectance: Rgb<F>,
    transmittance: Rgb<F>,
    ggx: Ggx<F>,
}

impl MicrofacetDielectric<f64> {
    /// Without tints, of one roughness.
    pub(super) fn white(eta: f64, alpha: f64) -> Self {
        let white = Rgb::all(1.0);
        MicrofacetDielectric {
            eta,
            reflectance: white,
            transmittance: white,
            ggx: Ggx { u: alpha, v: alpha },
        }
    }
}

/// A direction and the half vector that leads to it, with `wo` on the side of +z.
#[derive(Clone, Copy)]
pub(super) struct Bent<F: Real> {
    pub(super) wo: Vec3<F>,
    pub(super) wi: Vec3<F>,
    pub(super) h: Vec3<F>,
    /// Relative index seen from the side of wo.
    pub(super) eta: F,
    /// wo.h
    pub(super) cos_o: F,
    /// wi.h, negative where it is refracted.
    pub(super) cos_i: F,
    /// Are both on one side?
    pub(super) reflects: F::Mask,
    /// Is there such a half vector, seen from outside by both?
    pub(super) valid: F::Mask,
}

impl<F: Real> Bent<F> {
    /// Finds the half vector; `eta` is the index inside (behind z = 0) over that outside.
    #[inline(always)]
    pub(super) fn new(wo: Vec3<F>, wi: Vec3<F>, eta: F) -> Self {
        let eta = F::select(wo.z.gt(F::zero()), eta, eta.recip());
        let wi = Vec3::new(wi.x, wi.y, wi.z.xor_sign(wo.z));
        let wo = Vec3::new(wo.x, wo.y, wo.z.abs());
        let reflects = wi.z.gt(F::zero());
        let h = wi.mul_add(F::select(reflects, F::one(), eta), wo).normalize();
        let h = h.xor_sign(h.z);
        let (cos_o, cos_i) = (wo.dot(h), wi.dot(h));
        let valid = cos_o.gt(F::zero())
            & cos_i.xor_sign(wi.z).gt(F::zero())
            & wi.z.abs().gt(F::zero())
            & wo.z.gt(F::zero());
        Bent { wo, wi, h, eta, cos_o, cos_i, reflects, valid }
    }
    /// |d h / d wi| of the refraction over wo.h: |wi.h| / (wi.h + wo.h / eta)^2.
    #[inline(always)]
    pub(super) fn spread(&self) -> F {
        let sum = self.cos_i + self.cos_o / self.eta;
        self.cos_i.abs() / (sum * sum)
    }
    /// Reflected share at the half vector.
    #[inline(always)]
    pub(super) fn fresnel(&self) -> F {
        fresnel::dielectric(self.cos_o.max(F::zero()), self.eta).0
    }
    /// D G2 / (4 cos_o), for reflection, with the cosine of wi in it.
    #[inline(always)]
    pub(super) fn reflected(&self, ggx: &Ggx<F>) -> F {
        ggx.distribution(self.h) * ggx.shadowing(self.wo, self.wi) * F::lit(0.25) * self.wi.z.abs()
    }
    /// D G2 |wi.h wo.h| / (cos_o (wi.h + wo.h / eta)^2) / eta^2, for refraction, with the cosine of wi in it.
    #[inline(always)]
    pub(super) fn refracted(&self, ggx: &Ggx<F>) -> F {
        let value = ggx.distribution(self.h) * ggx.shadowing(self.wo, self.wi) * self.wi.z.abs();
        value * self.cos_o * self.spread() / (self.eta * self.eta)
    }
}

impl<F: Real> Bsdf<F> for MicrofacetDielectric<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = true;
    const SCALES_RADIANCE: bool = true;
    const ANISOTROPIC: bool = true;

    #[inline(always)]
    fn stretched(&self) -> F::Mask {
        self.ggx.stretched()
    }

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, lobe: F, u: [F; 2]) -> BsdfSample<F> {
        let side = wo.z;
        let eta = F::select(wo.z.gt(F::zero()), self.eta, self.eta.recip());
        let wo = Vec3::new(wo.x, wo.y, wo.z.abs());
        let h = self.ggx.sample(wo, u);
        let cos_o = wo.dot(h);
        let (reflected, cos_t, total) = fresnel::dielectric(cos_o.max(F::zero()), eta);
        let reflects = lobe.lt(reflected) | total;
        // wi = -wo / eta + (wo.h / eta - cos_t) h.
        let inverse = eta.recip();
        let refracted = h.mul_add(cos_o.mul_sub(inverse, cos_t), (-wo).scale(inverse)).normalize();
        let wi = Vec3::select(reflects, reflect(wo, h), refracted);
        let cos_i = wi.dot(h);
        let bent = Bent { wo, wi, h, eta, cos_o, cos_i, reflects, valid: reflects };
        let visible = self.ggx.visible(wo, h);
        let pdf = F::select(
            reflects,
            reflected * visible * F::lit(0.25),
            (F::one() - reflected) * visible * cos_o * bent.spread(),
        );
        let scale = F::select(reflects, F::one(), eta * eta);
        let tint = Rgb::select(reflects, self.reflectance, self.transmittance);
        // Seen from the wrong side of the surface or of the facet, there is nothing.
        let there = F::select(reflects, wi.z, -wi.z).gt(F::zero())
            & F::select(reflects, cos_i, -cos_i).gt(F::zero())
            & cos_o.gt(F::zero());
        let valid = there & wo.z.gt(F::zero()) & pdf.gt(F::zero()) & pdf.lt(F::lit(f32::MAX as f64));
        BsdfSample {
            wi: Vec3::new(wi.x, wi.y, wi.z.xor_sign(side)),
            // The lobe is chosen by its Fresnel reflectance, which therefore is not in the weight.
            weight: tint.scale(self.ggx.seen_again(wo, wi) / scale),
            pdf,
            eta_scale: scale,
            valid,
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let bent = Bent::new(wo, wi, self.eta);
        let reflected = bent.fresnel();
        let one = self.reflectance.scale(reflected * bent.reflected(&self.ggx));
        let other = self.transmittance.scale((F::one() - reflected) * bent.refracted(&self.ggx));
        Rgb::select(bent.valid, Rgb::select(bent.reflects, one, other), Rgb::zero())
    }
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let bent = Bent::new(wo, wi, self.eta);
        let reflected = bent.fresnel();
        let visible = self.ggx.visible(bent.wo, bent.h);
        let one = reflected * visible * F::lit(0.25);
        let other = (F::one() - reflected) * visible * bent.cos_o * bent.spread();
        F::select(bent.valid, F::select(bent.reflects, one, other), F::zero())
    }
}
