//! All that pbrt-v3 lets a surface do at once, its `uber` and `translucent`: diffuse and glossy (GGX) reflection and
//! transmission, mirror reflection, refraction, and holes.
//!
//! | lobe | what it scatters |
//! |---|---|
//! | diffuse reflection, transmission | opacity reflect Kd / pi, opacity transmit Kd / pi |
//! | glossy reflection | opacity reflect Ks F D G2 / (4 cos_i cos_o) |
//! | glossy refraction | opacity transmit Ks (1 - F) times that of [`rough_dielectric`](super::rough_dielectric) |
//! | mirror reflection | opacity Kr F |
//! | refraction | opacity Kt (1 - F), scaled by the squared relative index |
//! | straight on | 1 - opacity |

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::microfacet::{Ggx, reflect};
use super::parameters::{NOT_NEGATIVE, POSITIVE, Range, UNIT, parameters};
use super::rough_dielectric::Bent;
use crate::lanes::Real;
use crate::math::{Rgb, Vec3, cosine_hemisphere};
use core::f64::consts::FRAC_1_PI;

parameters! {
    /// A surface that does all at once.
    Uber {
        /// Diffuse share, Kd.
        diffuse: [f32; 3], UNIT;
        /// Glossy share, Ks.
        glossy: [f32; 3], UNIT;
        /// Share of the mirror reflection, Kr.
        mirrored: [f32; 3], UNIT;
        /// Share of the refraction, Kt.
        refracted: [f32; 3], UNIT;
        /// How much of the surface is there.
        opacity: [f32; 3], UNIT;
        /// Share of the diffuse and glossy light that is reflected.
        reflect: [f32; 3], UNIT;
        /// Share of the diffuse and glossy light that passes.
        transmit: [f32; 3], UNIT;
        /// Index inside over index outside.
        eta: f32, POSITIVE;
        /// GGX alpha along the first tangent.
        alpha_u: f32, Range { least: 1e-4, ..NOT_NEGATIVE };
        /// GGX alpha along the second tangent.
        alpha_v: f32, Range { least: 1e-4, ..NOT_NEGATIVE };
    }
}

impl Material for Uber {
    type Bsdf<F: Real> = AllLobes<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> AllLobes<F> {
        let (reflected, passed) = (at.opacity * at.reflect, at.opacity * at.transmit);
        let rest = |x: F| F::one() - x;
        AllLobes {
            diffuse: [reflected * at.diffuse, passed * at.diffuse],
            glossy: [reflected * at.glossy, passed * at.glossy],
            mirrored: at.opacity * at.mirrored,
            refracted: at.opacity * at.refracted,
            straight: Rgb::new(rest(at.opacity.r), rest(at.opacity.g), rest(at.opacity.b)),
            eta: at.eta,
            ggx: Ggx { u: at.alpha_u, v: at.alpha_v },
        }
    }
}

/// All lobes; of pairs, the first is the reflection.
#[derive(Clone, Copy)]
pub struct AllLobes<F: Real> {
    diffuse: [Rgb<F>; 2],
    glossy: [Rgb<F>; 2],
    mirrored: Rgb<F>,
    refracted: Rgb<F>,
    straight: Rgb<F>,
    eta: F,
    ggx: Ggx<F>,
}

/// Probabilities of sampling the lobes.
#[derive(Clone, Copy)]
struct Shares<F> {
    diffuse: [F; 2],
    glossy: [F; 2],
    mirrored: F,
    refracted: F,
    straight: F,
}

impl<F: Real> AllLobes<F> {
    /// By what each lobe scatters of light along wo, about; `reflected` is the Fresnel reflectance there.
    #[inline(always)]
    fn shares(&self, reflected: F) -> Shares<F> {
        // Facets are seen at other angles, too: where a smooth surface reflects nothing, or all, a rough one does not.
        let [least, most] = [0.05, 0.9].map(F::lit);
        let facets = reflected.mul_add(most, least);
        let diffuse = [self.diffuse[0].max_component(), self.diffuse[1].max_component()];
        let glossy =
            [self.glossy[0].max_component() * facets, self.glossy[1].max_component() * (F::one() - facets)];
        let mirrored = self.mirrored.max_component() * reflected;
        let refracted = self.refracted.max_component() * (F::one() - reflected);
        let straight = self.straight.max_component();
        let sum = diffuse[0] + diffuse[1] + glossy[0] + glossy[1] + mirrored + refracted + straight;
        // Where all are 0 nothing is sampled.
        let scale = sum.max(F::lit(f32::MIN_POSITIVE as f64)).recip();
        Shares {
            diffuse: [diffuse[0] * scale, diffuse[1] * scale],
            glossy: [glossy[0] * scale, glossy[1] * scale],
            mirrored: mirrored * scale,
            refracted: refracted * scale,
            straight: straight * scale,
        }
    }
    /// Relative index seen from the side of wo, and the reflectance, cosine of refraction and total reflection there.
    #[inline(always)]
    fn interface(&self, wo: Vec3<F>) -> (F, (F, F, F::Mask)) {
        let eta = F::select(wo.z.gt(F::zero()), self.eta, self.eta.recip());
        (eta, fresnel::dielectric(wo.z.abs(), eta))
    }
}

/// Lanes whose number falls into the next share; the others go on with what is left of it.
#[inline(always)]
fn take<F: Real>(rest: &mut F, share: F) -> F::Mask {
    let here = rest.lt(share) & rest.ge(F::zero());
    // Past a share rounding may leave less than 0.
    *rest = F::select(here, -F::one(), F::select(rest.ge(F::zero()), (*rest - share).max(F::zero()), *rest));
    here
}

impl<F: Real> Bsdf<F> for AllLobes<F> {
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
        let (eta, (reflected, cos_t, _)) = self.interface(wo);
        let shares = self.shares(reflected);
        let up = Vec3::new(wo.x, wo.y, wo.z.abs());
        let inverse = eta.recip();

        // The lobes one after the other; `rest` is what the lobe number has left.
        let mut rest = lobe;
        let diffuse = [take(&mut rest, shares.diffuse[0]), take(&mut rest, shares.diffuse[1])];
        let glossy = [take(&mut rest, shares.glossy[0]), take(&mut rest, shares.glossy[1])];
        let mirrored = take(&mut rest, shares.mirrored);
        let refracted = take(&mut rest, shares.refracted);
        let straight = take(&mut rest, shares.straight);

        let h = self.ggx.sample(up, u);
        let cos_o = up.dot(h);
        let (_, facet_cos_t, facet_total) = fresnel::dielectric(cos_o.max(F::zero()), eta);
        let bent = h.mul_add(cos_o.mul_sub(inverse, facet_cos_t), (-up).scale(inverse)).normalize();
        let snell = Vec3::new(-wo.x * inverse, -wo.y * inverse, -cos_t).normalize();
        let cosine = cosine_hemisphere(u);
        let mut wi = Vec3::select(diffuse[1], Vec3::new(cosine.x, cosine.y, -cosine.z), cosine);
        wi = Vec3::select(glossy[0], reflect(up, h), wi);
        wi = Vec3::select(glossy[1], bent, wi);
        wi = Vec3::select(mirrored, Vec3::new(-wo.x, -wo.y, up.z), wi);
        wi = Vec3::select(refracted, snell, wi);
        wi = Vec3::select(straight, -up, wi);
        let wi = Vec3::new(wi.x, wi.y, wi.z.xor_sign(wo.z));

        let specular = mirrored | refracted | straight;
        let density = self.pdf(wo, wi);
        let mut weight = self.eval(wo, wi).scale(density.recip());
        let eta2 = eta * eta;
        weight = Rgb::select(mirrored, self.mirrored.scale(reflected / shares.mirrored), weight);
        let passed = (F::one() - reflected) / (shares.refracted * eta2);
        weight = Rgb::select(refracted, self.refracted.scale(passed), weight);
        weight = Rgb::select(straight, self.straight.scale(shares.straight.recip()), weight);
        // The sides on which the lobes lie.
        let above = wi.z.xor_sign(wo.z).gt(F::zero());
        let placed = (glossy[0] & above) | (glossy[1] & !above & !facet_total) | diffuse[0] | diffuse[1];
        let found = density.gt(F::zero()) & density.lt(F::lit(f32::MAX as f64));
        BsdfSample {
            wi,
            weight,
            pdf: F::select(specular, F::zero(), density),
            eta_scale: F::select(refracted | glossy[1], eta2, F::one()),
            valid: (specular | (placed & found)) & wo.z.abs().gt(F::zero()) & wi.z.abs().gt(F::zero()),
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let bent = Bent::new(wo, wi, self.eta);
        let reflected = bent.fresnel();
        let cos = wi.z.abs() * F::lit(FRAC_1_PI);
        let glossy = F::select(
            bent.reflects,
            reflected * bent.reflected(&self.ggx),
            (F::one() - reflected) * bent.refracted(&self.ggx),
        );
        let glossy = F::select(bent.valid, glossy, F::zero());
        let diffuse = Rgb::select(bent.reflects, self.diffuse[0], self.diffuse[1]);
        let tint = Rgb::select(bent.reflects, self.glossy[0], self.glossy[1]);
        Rgb::new(
            diffuse.r.mul_add(cos, tint.r * glossy),
            diffuse.g.mul_add(cos, tint.g * glossy),
            diffuse.b.mul_add(cos, tint.b * glossy),
        )
    }
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let (_, (reflected, _, _)) = self.interface(wo);
        let shares = self.shares(reflected);
        let bent = Bent::new(wo, wi, self.eta);
        let visible = self.ggx.visible(bent.wo, bent.h);
        let glossy = F::select(
            bent.reflects,
            shares.glossy[0] * visible * F::lit(0.25),
            shares.glossy[1] * visible * bent.cos_o * bent.spread(),
        );
        let glossy = F::select(bent.valid, glossy, F::zero());
        let diffuse = F::select(bent.reflects, shares.diffuse[0], shares.diffuse[1]);
        diffuse.mul_add(wi.z.abs() * F::lit(FRAC_1_PI), glossy)
    }
}
