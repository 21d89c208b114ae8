//! A diffuse base under a coat that reflects by GGX microfacets: pbrt-v4's `coateddiffuse`, and what pbrt-v3 has of the
//! kind (`plastic`, `substrate`, `uber` where nothing passes through).
//!
//! f = K / pi s(cos_o) s(cos_i) + coat
//!
//! | [`Coat`] | base K s s | coat |
//! |---|---|---|
//! | `Layered` | light enters through the coat, is reflected by the base, from below by the coat, and leaves | F D G2 / (4 cos_i cos_o) |
//! | `Added` | the base alone: K is its albedo, s is 1 | the same |
//! | `Blended` | 28/23 Kd (1 - Ks), s = 1 - (1 - cos / 2)^5 (Ashikhmin and Shirley 2000) | D S / (4 wi.h max(cos_i, cos_o)), S = Ks + (1 - Ks) (1 - wi.h)^5 |
//!
//! **Layered** is what a random walk between the two interfaces has as its mean, in closed form: as a diffuse base keeps
//! no memory of the direction, every order of reflection has the same shape. With T(cos) the share of light from outside
//! that reaches the base, R the share of the base's light that the coat sends back, eta the index of the coat and `a` the
//! albedo of the base,
//!
//! K s s = a (1 + aR + ... + (aR)^(n-1)) T(cos_o) T(cos_i) / eta^2
//!
//! n is the number of reflections at the base that are followed ([`Coated::orders`]). T and R hold the Fresnel
//! transmittance and reflectance of the microfacets, what they shadow, and exp(-thickness / cos) for each way through the
//! coat. They are integrated when the table is made ([`Passage`]); over the cosine, T is kept as
//! T(cos) = (1 - F(c)) P(cos / (cos + w)), F the Fresnel reflectance, c^2 = cos^2 + r^2 sin^2, P a polynomial of degree
//! 5, r and w proportional to the roughness: relative errors are below 0.006, mostly below 0.001.

use super::bsdf::{Bsdf, BsdfSample};
use super::fresnel;
use super::materials::Material;
use super::microfacet::{Ggx, reflect};
use super::parameters::{NOT_NEGATIVE, POSITIVE, Range, UNIT, parameters};
use crate::lanes::{Real, Uint};
use crate::math::{Rgb, Vec3, cosine_hemisphere};
use core::f64::consts::FRAC_1_PI;

/// How coat and base go together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coat {
    /// Light passes through the coat to the base and back.
    Layered,
    /// Coat and base do not know of each other.
    Added,
    /// What the coat does not reflect is the base's, by Schlick's and Ashikhmin's approximations.
    Blended,
}

impl Coat {
    /// As a column has it.
    pub fn number(self) -> f32 {
        self as u8 as f32
    }
}

/// Most reflections at the base that are counted one by one.
pub const MOST_ORDERS: f32 = 255.0;

parameters! {
    /// A coated diffuse surface.
    Coated {
        /// Albedo of the base.
        reflectance: [f32; 3], UNIT;
        /// Tint of what the coat reflects.
        specular: [f32; 3], UNIT;
        /// Index behind the coat's surface over the index before it; below 1 there is total reflection.
        eta: f32, POSITIVE;
        /// GGX alpha of the coat along the first tangent; 0 along both is smooth.
        alpha_u: f32, NOT_NEGATIVE;
        /// GGX alpha of the coat along the second tangent.
        alpha_v: f32, NOT_NEGATIVE;
        /// Reflections at the base that are followed, of a layered one.
        orders: f32, Range { least: 1.0, most: MOST_ORDERS };
        /// A [`Coat`].
        coat: f32, Range { least: 0.0, most: 2.0 };
        /// What the coat lets through: [`Passage::columns`]. A column for whoever makes the table, once for many
        /// materials: it takes thousands of evaluations.
        passage: [f32; 11], Range { least: f32::MIN, most: f32::MAX };
    }
}

/// Below it pbrt takes a surface for smooth.
const SMOOTH: f64 = 1e-3;

impl Material for Coated {
    type Bsdf<F: Real> = CoatedReflection<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> CoatedReflection<F> {
        let blended = at.coat.gt(F::lit(1.5));
        let base = Rgb::new(
            series(at.reflectance.r, at.passage[0], at.orders),
            series(at.reflectance.g, at.passage[0], at.orders),
            series(at.reflectance.b, at.passage[0], at.orders),
        );
        let left = |s: F| F::select(blended, F::one() - s, F::one());
        let base = base * Rgb::new(left(at.specular.r), left(at.specular.g), left(at.specular.b));
        let least = F::lit(SMOOTH);
        CoatedReflection {
            base,
            specular: at.specular,
            eta: at.eta,
            ggx: Ggx { u: at.alpha_u.max(least), v: at.alpha_v.max(least) },
            smooth: at.alpha_u.lt(least) & at.alpha_v.lt(least),
            blended,
            passage: at.passage,
        }
    }
}

/// a (1 - (aR)^n) / (1 - aR).
#[inline(always)]
fn series<F: Real>(a: F, returned: F, orders: F) -> F {
    let x = a * returned;
    // x^n from the squares of x: n is below 256.
    let n = orders.to_uint();
    let (mut power, mut square) = (F::one(), x);
    let mut rest = n;
    for _ in 0..8 {
        let odd = (rest & F::Uint::splat(1)).eq(F::Uint::splat(1));
        power = F::select(odd, power * square, power);
        square = square * square;
        rest = rest.shr::<1>();
    }
    a * (F::one() - power) / (F::one() - x)
}

/// Diffuse reflection of the base, and the coat's.
#[derive(Clone, Copy)]
pub struct CoatedReflection<F: Real> {
    base: Rgb<F>,
    specular: Rgb<F>,
    eta: F,
    ggx: Ggx<F>,
    smooth: F::Mask,
    blended: F::Mask,
    passage: [F; 11],
}

impl<F: Real> CoatedReflection<F> {
    /// s(cos).
    #[inline(always)]
    fn passes(&self, cos: F) -> F {
        let [_, eta, r2, p, q, c0, c1, c2, c3, c4, c5] = self.passage;
        let cos2 = cos * cos;
        let c = r2.mul_add(F::one() - cos2, cos2).min(F::one()).sqrt();
        let y = cos / cos.mul_add(p, q);
        let poly = c5.mul_add(y, c4).mul_add(y, c3).mul_add(y, c2).mul_add(y, c1).mul_add(y, c0);
        fresnel::transmitted(c, eta) * poly
    }
    /// S(wi.h), for a blended coat; F(wi.h) times the tint for the others.
    #[inline(always)]
    fn reflectance(&self, cos: F) -> Rgb<F> {
        let m = (F::one() - cos).max(F::zero());
        let m5 = (m * m) * (m * m) * m;
        let schlick = |s: F| (F::one() - s).mul_add(m5, s);
        let blended = Rgb::new(schlick(self.specular.r), schlick(self.specular.g), schlick(self.specular.b));
        let once = fresnel::dielectric(cos, self.eta).0;
        Rgb::select(self.blended, blended, self.specular.scale(once))
    }
    /// Probabilities of sampling coat and base: by what they reflect, about.
    #[inline(always)]
    fn shares(&self, wo: Vec3<F>) -> [F; 2] {
        let coat = self.reflectance(wo.z).max_component();
        let base = self.base.max_component() * self.passes(wo.z);
        // Where both are 0 nothing is reflected, whatever is sampled.
        let scale = (coat + base).max(F::lit(f32::MIN_POSITIVE as f64)).recip();
        [coat * scale, base * scale]
    }
}

impl<F: Real> Bsdf<F> for CoatedReflection<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;
    const ANISOTROPIC: bool = true;

    #[inline(always)]
    fn stretched(&self) -> F::Mask {
        self.ggx.stretched()
    }

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, lobe: F, u: [F; 2]) -> BsdfSample<F> {
        let [share, _] = self.shares(wo);
        let coat = lobe.lt(share);
        let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
        let wi = Vec3::select(coat, reflect(wo, self.ggx.sample(wo, u)), cosine_hemisphere(u));
        // A smooth coat reflects into one direction, which no other strategy finds.
        let specular = coat & self.smooth;
        let wi = Vec3::select(specular, mirrored, wi);
        let density = self.pdf(wo, wi);
        let pdf = F::select(specular, F::zero(), density);
        let value = self.eval(wo, wi).scale(density.recip());
        let weight = Rgb::select(specular, self.reflectance(wo.z).scale(share.recip()), value);
        let found = specular | (density.gt(F::zero()) & density.lt(F::lit(f32::MAX as f64)));
        BsdfSample {
            wi,
            weight,
            pdf,
            eta_scale: F::one(),
            valid: wi.z.gt(F::zero()) & wo.z.gt(F::zero()) & found,
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let h = (wo + wi).normalize();
        let cos_h = wi.dot(h).max(F::zero());
        let diffuse = self.passes(wo.z) * self.passes(wi.z) * wi.z * F::lit(FRAC_1_PI);
        let over_cosines = F::select(
            self.blended,
            (cos_h * wi.z.max(wo.z)).max(F::lit(1e-12)).recip(),
            self.ggx.shadowing(wo, wi),
        );
        let glossy = self.ggx.distribution(h) * over_cosines * F::lit(0.25) * wi.z;
        let glossy = F::select(self.smooth, F::zero(), glossy);
        let coat = self.reflectance(cos_h).scale(glossy);
        let sum = Rgb::new(
            self.base.r.mul_add(diffuse, coat.r),
            self.base.g.mul_add(diffuse, coat.g),
            self.base.b.mul_add(diffuse, coat.b),
        );
        Rgb::select(wi.z.gt(F::zero()) & wo.z.gt(F::zero()), sum, Rgb::zero())
    }
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let [coat, base] = self.shares(wo);
        let h = (wo + wi).normalize();
        let glossy = F::select(self.smooth, F::zero(), self.ggx.visible(wo, h) * F::lit(0.25));
        let diffuse = wi.z * F::lit(FRAC_1_PI);
        let density = coat.mul_add(glossy, base * diffuse);
        F::select(wi.z.gt(F::zero()) & wo.z.gt(F::zero()), density, F::zero())
    }
}

/// What a coat lets through, as columns have it: s(cos) = (1 - F(c; eta)) P(cos / (p cos + q)), with
/// c^2 = cos^2 + r^2 sin^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// Share of the base's light that the coat sends back.
    pub returned: f64,
    eta: f64,
    r2: f64,
    p: f64,
    q: f64,
    polynomial: [f64; TERMS],
}

/// Coefficients of the polynomial.
const TERMS: usize = 6;
/// Cosines at which T is integrated.
const COSINES: usize = 24;
/// Points a side of the square over which normals are integrated.
const SIDE: usize = 16;

impl Passage {
    /// As [`Coated::passage`] has it.
    pub fn columns(&self) -> [f32; 11] {
        let [c0, c1, c2, c3, c4, c5] = self.polynomial;
        [self.returned, self.eta, self.r2, self.p, self.q, c0, c1, c2, c3, c4, c5].map(|x| x as f32)
    }

    /// s(cos).
    pub fn at(&self, cos: f64) -> f64 {
        let c = (cos * cos + self.r2 * (1.0 - cos * cos)).min(1.0).sqrt();
        let y = cos / (self.p * cos + self.q);
        let polynomial = self.polynomial.iter().rev().fold(0.0, |sum, c| sum * y + c);
        fresnel::transmitted(c, self.eta) * polynomial
    }

    /// Of a coat with this relative index, roughness along both tangents and optical thickness.
    pub fn new(coat: Coat, eta: f64, alpha: [f64; 2], thickness: f64) -> Self {
        let through = |polynomial, p, q| Passage { returned: 0.0, eta: 1.0, r2: 0.0, p, q, polynomial };
        if coat == Coat::Added {
            return through([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0, 1.0);
        }
        if coat == Coat::Blended {
            // 1 - (1 - c / 2)^5, and the root of the factor 28 / 23.
            let root = (28.0f64 / 23.0).sqrt();
            return through([0.0, 2.5, -2.5, 1.25, -0.3125, 0.03125].map(|c| c * root), 0.0, 1.0);
        }
        // The base sees the microfacets from all sides: it does not matter which way they are stretched.
        let alpha = (alpha[0] * alpha[1]).sqrt();
        let alpha = if alpha < SMOOTH { 0.0 } else { alpha };
        let nodes: [f64; COSINES] =
            // Closer to the horizon, where T changes most.
            core::array::from_fn(|k| ((k as f64 + 0.5) / COSINES as f64).powi(2).max(2e-3));
        // The square root of 1 / eta^2 goes with each T.
        let through = nodes.map(|cos| transmittance(cos, alpha, eta, thickness) / eta);
        let fits = [0.25, 0.5, 0.7, 1.0, 1.4, 2.0].map(|k| Self::fit(&nodes, &through, k * alpha, eta));
        let mut best = fits[0];
        for fit in fits {
            if fit.0 < best.0 {
                best = fit;
            }
        }
        Passage { returned: returned(alpha, eta, thickness), ..best.1 }
    }

    /// The best polynomial, with its largest relative error.
    fn fit(nodes: &[f64; COSINES], through: &[f64; COSINES], width: f64, eta: f64) -> (f64, Self) {
        let mut fit = Passage {
            returned: 0.0,
            eta,
            r2: width * width,
            p: 1.0,
            q: width.max(0.02),
            polynomial: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        };
        // Least squares of relative errors: the terms over T, made orthogonal one after the other (Gram and Schmidt).
        let smooth: [f64; COSINES] = core::array::from_fn(|k| fit.at(nodes[k]) / through[k]);
        let y = nodes.map(|cos| cos / (fit.p * cos + fit.q));
        let mut columns: [[f64; COSINES]; TERMS] =
            core::array::from_fn(|term| core::array::from_fn(|k| smooth[k] * y[k].powi(term as i32)));
        let dot = |a: &[f64; COSINES], b: &[f64; COSINES]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut triangle = [[0.0; TERMS]; TERMS];
        let mut right = [0.0; TERMS];
        let mut rest = [1.0; COSINES];
        for i in 0..TERMS {
            for j in 0..i {
                let before = columns[j];
                triangle[j][i] = dot(&before, &columns[i]);
                for k in 0..COSINES {
                    columns[i][k] -= triangle[j][i] * before[k];
                }
            }
            triangle[i][i] = dot(&columns[i], &columns[i]).sqrt();
            columns[i] = columns[i].map(|x| x / triangle[i][i]);
            right[i] = dot(&columns[i], &rest);
            for k in 0..COSINES {
                rest[k] -= right[i] * columns[i][k];
            }
        }
        for i in (0..TERMS).rev() {
            let known: f64 = (i + 1..TERMS).map(|j| triangle[i][j] * fit.polynomial[j]).sum();
            fit.polynomial[i] = (right[i] - known) / triangle[i][i];
        }
        let errors = (0..COSINES).map(|k| (fit.at(nodes[k]) / through[k] - 1.0).abs());
        (errors.fold(0.0, f64::max), fit)
    }
}

/// The mean of a function of a visible normal of microfacets.
pub(super) fn mean_over_normals(wo: Vec3<f64>, alpha: f64, f: impl Fn(Vec3<f64>) -> f64) -> f64 {
    if alpha == 0.0 {
        return f(Vec3::new(0.0, 0.0, 1.0));
    }
    let ggx = Ggx { u: alpha, v: alpha };
    let at = |k: usize| (k as f64 + 0.5) / SIDE as f64;
    let sum: f64 = (0..SIDE * SIDE).map(|k| f(ggx.sample(wo, [at(k / SIDE), at(k % SIDE)]))).sum();
    sum / (SIDE * SIDE) as f64
}

fn direction(cos: f64) -> Vec3<f64> {
    Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos)
}

fn seen_again(alpha: f64, wo: Vec3<f64>, wi: Vec3<f64>) -> f64 {
    if alpha == 0.0 { 1.0 } else { Ggx { u: alpha, v: alpha }.seen_again(wo, wi) }
}

/// T: share of the light from a direction of this cosine that comes through the surface of the coat and through the coat.
pub fn transmittance(cos: f64, alpha: f64, eta: f64, thickness: f64) -> f64 {
    let wo = direction(cos);
    mean_over_normals(wo, alpha, |h| {
        let cos_o = wo.dot(h);
        let (reflected, cos_t, total) = fresnel::dielectric(cos_o.max(0.0), eta);
        let wi = h.mul_add(cos_o / eta - cos_t, (-wo).scale(1.0 / eta));
        if total || wi.z >= 0.0 || cos_o <= 0.0 {
            return 0.0;
        }
        (1.0 - reflected) * seen_again(alpha, wo, wi) * (thickness / wi.z).exp()
    })
}

/// R: share of diffuse light from below that the surface of the coat sends back, with both ways through the coat.
pub fn returned(alpha: f64, eta: f64, thickness: f64) -> f64 {
    let reflected = |cos: f64| {
        let wo = direction(cos);
        let mean = mean_over_normals(wo, alpha, |h| {
            let cos_o = wo.dot(h);
            let wi = reflect(wo, h);
            if wi.z <= 0.0 || cos_o <= 0.0 {
                return 0.0;
            }
            let reflected = fresnel::dielectric(cos_o, 1.0 / eta).0;
            reflected * seen_again(alpha, wo, wi) * (-thickness / wi.z).exp()
        });
        mean * (-thickness / wo.z).exp()
    };
    // Midpoints over cos^2, of which equal parts hold equal shares of the light. A smooth coat reflects all below the
    // critical angle, and less and less above, like a square root: that is taken out by another square.
    let critical = (1.0 - 1.0 / (eta * eta)).max(0.0);
    let middles = (0..COSINES).map(|k| (k as f64 + 0.5) / COSINES as f64);
    let sum: f64 = middles
        .map(|x| {
            let below = if critical > 0.0 { critical * reflected((critical * x).sqrt()) } else { 0.0 };
            let above = reflected((critical + (1.0 - critical) * x * x).sqrt());
            below + (1.0 - critical) * 2.0 * x * above
        })
        .sum();
    sum / COSINES as f64
}
