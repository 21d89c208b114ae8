//! Microfacets: the GGX distribution of normals (Walter et al. 2007), perhaps wider along one tangent than along the
//! other, with height-correlated Smith shadowing (Heitz 2014), sampled by visible normals (Heitz 2018; the spherical-cap
//! form of Dupuy and Benyoub 2023).
//!
//! All directions are unit and in the frame of the shading normal; `wo` and half vectors are on the side of +z.

use crate::lanes::Real;
use crate::math::Vec3;
use core::f64::consts::PI;

/// A distribution of microfacets.
#[derive(Clone, Copy, Debug)]
pub struct Ggx<F> {
    /// alpha along the first tangent, above 0.
    pub u: F,
    /// alpha along the second.
    pub v: F,
}

impl<F: Real> Ggx<F> {
    /// Lanes in which it matters which way the tangents lie.
    #[inline(always)]
    pub fn stretched(&self) -> F::Mask {
        !self.u.eq(self.v)
    }
    /// D(h), a density over projected solid angle.
    ///
    /// 1 / (pi u v (x^2 / u^2 + y^2 / v^2 + z^2)^2): sums of squares, nothing cancels near the normal.
    #[inline(always)]
    pub fn distribution(&self, h: Vec3<F>) -> F {
        let (x, y) = (h.x / self.u, h.y / self.v);
        let e = x.mul_add(x, y.mul_add(y, h.z * h.z));
        (F::lit(PI) * self.u * self.v * e * e).recip()
    }
    /// sqrt(1 + alpha^2 tan^2) cos: Smith's Lambda is (that / cos - 1) / 2.
    #[inline(always)]
    pub fn smith(&self, w: Vec3<F>) -> F {
        let (x, y) = (self.u * w.x, self.v * w.y);
        x.mul_add(x, y.mul_add(y, w.z * w.z)).sqrt()
    }
    /// A half vector with the density of the normals that `wo` sees, D(h) G1(wo) (wo.h) / cos_o.
    #[inline(always)]
    pub fn sample(&self, wo: Vec3<F>, u: [F; 2]) -> Vec3<F> {
        // The hemisphere configuration, a uniform point on the spherical cap below wo, and back.
        let stretched = Vec3::new(wo.x * self.u, wo.y * self.v, wo.z).normalize();
        // z = (1 - u)(1 + wo.z) - wo.z.
        let z = (F::one() - u[0]).mul_sub(F::one() + stretched.z, stretched.z);
        let r = z.neg_mul_add(z, F::one()).max(F::zero()).sqrt();
        let (sin, cos) = u[1].sin_cos_turns();
        let n = Vec3::new(r * cos, r * sin, z) + stretched;
        Vec3::new(n.x * self.u, n.y * self.v, n.z.max(F::zero())).normalize()
    }
    /// G1(wo) D(h) / cos_o = 2 D(h) / (cos_o + smith(wo)): times wo.h the density of [`Ggx::sample`], over 4 that of the
    /// reflected direction.
    #[inline(always)]
    pub fn visible(&self, wo: Vec3<F>, h: Vec3<F>) -> F {
        self.distribution(h) * F::lit(2.0) / (wo.z + self.smith(wo))
    }
    /// G2(wo, wi) / (cos_o cos_i) = 2 / (cos_i smith(wo) + cos_o smith(wi)), of cosines without sign.
    #[inline(always)]
    pub fn shadowing(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let (co, ci) = (wo.z.abs(), wi.z.abs());
        F::lit(2.0) / ci.mul_add(self.smith(wo), co * self.smith(wi))
    }
    /// G2(wo, wi) / G1(wo): the weight of a direction that was reflected or refracted by a sampled normal.
    #[inline(always)]
    pub fn seen_again(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let (co, ci, so) = (wo.z.abs(), wi.z.abs(), self.smith(wo));
        ci * (co + so) / ci.mul_add(so, co * self.smith(wi))
    }
}

/// wo mirrored by a microfacet with normal `h`.
#[inline(always)]
pub fn reflect<F: Real>(wo: Vec3<F>, h: Vec3<F>) -> Vec3<F> {
    let d = wo.dot(h);
    h.mul_add(d + d, -wo).normalize()
}
