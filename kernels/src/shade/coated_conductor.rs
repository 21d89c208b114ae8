//! A conductor under a dielectric coat: pbrt-v4's `coatedconductor`, in lobes.
//!
//! pbrt walks at random between the two interfaces. Here light that comes back is sorted by how often the conductor
//! reflected it, and each part is one GGX lobe around the mirror direction (Belcour 2018 takes the same way):
//!
//! f = F D G2 / (4 cos_i cos_o) of the coat + sum over k of sqrt(r_k(cos_o) r_k(cos_i)) D_k G2_k / (4 cos_i cos_o)
//!
//! k = 1: reflected once; k = 2: more often. The roughness of D_k, and the share r_k of the light that it reflects, over
//! the cosine and for each colour, come from such a walk, taken when the table is made ([`Layers`]). So the energy of each
//! part is that of the walk (to about 1 %), its shape is approximated.

use super::bsdf::{Bsdf, BsdfSample};
use super::coated::mean_over_normals;
use super::fresnel;
use super::materials::Material;
use super::microfacet::{Ggx, reflect};
use super::parameters::{NOT_NEGATIVE, POSITIVE, Range, parameters};
use super::rough_dielectric::MicrofacetDielectric;
use crate::lanes::Real;
use crate::math::{Rgb, Vec3};

parameters! {
    /// A coated conductor.
    CoatedConductor {
        /// Index of the coat over the index around it.
        eta: f32, POSITIVE;
        /// GGX alpha of the coat; below 0.001 it is smooth.
        alpha: f32, NOT_NEGATIVE;
        /// What the conductor reflects once: [`Layers`].
        once: [f32; 15], Range { least: f32::MIN, most: f32::MAX };
        /// What it reflects more often.
        more: [f32; 15], Range { least: f32::MIN, most: f32::MAX };
    }
}

/// Below it a lobe is a mirror's.
const SMOOTH: f64 = 1e-3;

impl Material for CoatedConductor {
    type Bsdf<F: Real> = CoatedConductorReflection<F>;
    #[inline(always)]
    fn bsdf<F: Real>(at: Evaluated<F>) -> CoatedConductorReflection<F> {
        CoatedConductorReflection {
            eta: at.eta,
            coat: Facets::new(at.alpha),
            lobes: [Lobe::new(at.once), Lobe::new(at.more)],
        }
    }
}

/// Microfacets, or a mirror.
#[derive(Clone, Copy)]
struct Facets<F: Real> {
    ggx: Ggx<F>,
    smooth: F::Mask,
}

impl<F: Real> Facets<F> {
    #[inline(always)]
    fn new(alpha: F) -> Self {
        let least = F::lit(SMOOTH);
        let rough = alpha.max(least);
        Facets { ggx: Ggx { u: rough, v: rough }, smooth: alpha.lt(least) }
    }
    /// D G2 / (4 cos_o), with the cosine of wi in it; 0 for a mirror.
    #[inline(always)]
    fn value(&self, wo: Vec3<F>, wi: Vec3<F>, h: Vec3<F>) -> F {
        let value = self.ggx.distribution(h) * self.ggx.shadowing(wo, wi) * F::lit(0.25) * wi.z;
        F::select(self.smooth, F::zero(), value)
    }
    /// Density of the reflected direction; 0 for a mirror.
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, h: Vec3<F>) -> F {
        F::select(self.smooth, F::zero(), self.ggx.visible(wo, h) * F::lit(0.25))
    }
}

/// What comes back from the conductor, in part.
#[derive(Clone, Copy)]
struct Lobe<F: Real> {
    facets: Facets<F>,
    curve: [F; 15],
}

impl<F: Real> Lobe<F> {
    #[inline(always)]
    fn new(curve: [F; 15]) -> Self {
        Lobe { facets: Facets::new(curve[0]), curve }
    }
    /// r(cos): (1 - F(c)) P(cos / (cos + w)) for each colour, with c^2 = cos^2 + r^2 sin^2.
    #[inline(always)]
    fn reflectance(&self, eta: F, cos: F) -> Rgb<F> {
        let [_, r2, w, r0, r1, r2_, r3, g0, g1, g2, g3, b0, b1, b2, b3] = self.curve;
        let cos2 = cos * cos;
        let c = r2.mul_add(F::one() - cos2, cos2).min(F::one()).sqrt();
        let through = fresnel::transmitted(c, eta);
        let y = cos / (cos + w);
        let polynomial = Rgb::new(
            r3.mul_add(y, r2_).mul_add(y, r1).mul_add(y, r0),
            g3.mul_add(y, g2).mul_add(y, g1).mul_add(y, g0),
            b3.mul_add(y, b2).mul_add(y, b1).mul_add(y, b0),
        );
        let clamp = |x: F| (x * through).max(F::zero()).min(F::one());
        Rgb::new(clamp(polynomial.r), clamp(polynomial.g), clamp(polynomial.b))
    }
}

/// Reflection of coat and conductor.
#[derive(Clone, Copy)]
pub struct CoatedConductorReflection<F: Real> {
    eta: F,
    coat: Facets<F>,
    lobes: [Lobe<F>; 2],
}

impl<F: Real> CoatedConductorReflection<F> {
    /// What each of the three lobes reflects of light from this cosine, about.
    #[inline(always)]
    fn reflectances(&self, cos: F) -> (F, [Rgb<F>; 2]) {
        let coat = fresnel::dielectric(cos, self.eta).0;
        (coat, [self.lobes[0].reflectance(self.eta, cos), self.lobes[1].reflectance(self.eta, cos)])
    }
    /// Probabilities of sampling the lobes.
    #[inline(always)]
    fn shares(coat: F, lobes: [Rgb<F>; 2]) -> [F; 3] {
        let [once, more] = [lobes[0].max_component(), lobes[1].max_component()];
        let scale = (coat + once + more).max(F::lit(f32::MIN_POSITIVE as f64)).recip();
        [coat * scale, once * scale, more * scale]
    }
}

/// sqrt(a b), a channel at a time.
#[inline(always)]
fn between<F: Real>(a: Rgb<F>, b: Rgb<F>) -> Rgb<F> {
    Rgb::new((a.r * b.r).sqrt(), (a.g * b.g).sqrt(), (a.b * b.b).sqrt())
}

impl<F: Real> Bsdf<F> for CoatedConductorReflection<F> {
    const SPECULAR: bool = false;
    const TRANSMITS: bool = false;
    const SCALES_RADIANCE: bool = false;

    #[inline(always)]
    fn sample(&self, wo: Vec3<F>, lobe: F, u: [F; 2]) -> BsdfSample<F> {
        let (coat, lobes) = self.reflectances(wo.z);
        let shares = Self::shares(coat, lobes);
        let first = lobe.lt(shares[0]);
        let second = !first & lobe.lt(shares[0] + shares[1]);
        let pick = |a: F, b: F, c: F| F::select(first, a, F::select(second, b, c));
        let [one, other] = [self.lobes[0].facets, self.lobes[1].facets];
        let alpha = pick(self.coat.ggx.u, one.ggx.u, other.ggx.u);
        let specular = (first & self.coat.smooth) | (second & one.smooth) | (!first & !second & other.smooth);
        let rough = reflect(wo, Ggx { u: alpha, v: alpha }.sample(wo, u));
        let wi = Vec3::select(specular, Vec3::new(-wo.x, -wo.y, wo.z), rough);
        let density = self.pdf(wo, wi);
        let value = self.eval(wo, wi).scale(density.recip());
        let mirrored = Rgb::select(first, Rgb::all(coat), Rgb::select(second, lobes[0], lobes[1]));
        let share = pick(shares[0], shares[1], shares[2]);
        let found = specular | (density.gt(F::zero()) & density.lt(F::lit(f32::MAX as f64)));
        BsdfSample {
            wi,
            weight: Rgb::select(specular, mirrored.scale(share.recip()), value),
            pdf: F::select(specular, F::zero(), density),
            eta_scale: F::one(),
            valid: wi.z.gt(F::zero()) & wo.z.gt(F::zero()) & share.gt(F::zero()) & found,
        }
    }
    #[inline(always)]
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Rgb<F> {
        let h = (wo + wi).normalize();
        let coat = fresnel::dielectric(wi.dot(h).max(F::zero()), self.eta).0 * self.coat.value(wo, wi, h);
        let mut sum = Rgb::all(coat);
        let mut k = 0;
        while k < 2 {
            let lobe = &self.lobes[k];
            let tint = between(lobe.reflectance(self.eta, wo.z), lobe.reflectance(self.eta, wi.z));
            let value = lobe.facets.value(wo, wi, h);
            sum = Rgb::new(
                tint.r.mul_add(value, sum.r),
                tint.g.mul_add(value, sum.g),
                tint.b.mul_add(value, sum.b),
            );
            k += 1;
        }
        Rgb::select(wi.z.gt(F::zero()) & wo.z.gt(F::zero()), sum, Rgb::zero())
    }
    #[inline(always)]
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F {
        let (coat, lobes) = self.reflectances(wo.z);
        let [first, second, third] = Self::shares(coat, lobes);
        let h = (wo + wi).normalize();
        let density = first.mul_add(
            self.coat.pdf(wo, h),
            second.mul_add(self.lobes[0].facets.pdf(wo, h), third * self.lobes[1].facets.pdf(wo, h)),
        );
        F::select(wi.z.gt(F::zero()) & wo.z.gt(F::zero()), density, F::zero())
    }
}

/// Coat and conductor, as a scene has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layers {
    /// Index of the coat over the index around it.
    pub eta: f64,
    /// GGX alpha of the coat; below 0.001 it is smooth.
    pub alpha: f64,
    /// Optical thickness of the coat.
    pub thickness: f64,
    /// Real part of the conductor's index, over that of the coat.
    pub conductor_eta: [f64; 3],
    /// Its absorption coefficient, over the index of the coat.
    pub conductor_k: [f64; 3],
    /// Its GGX alpha.
    pub conductor_alpha: f64,
    /// Reflections at the conductor that are followed.
    pub orders: u32,
}

/// Cosines from which walks start.
const COSINES: usize = 12;
/// Walks from each.
const WALKS: usize = 4096;
/// Coefficients of a polynomial.
const TERMS: usize = 4;

/// Uniform numbers (SplitMix64; Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let x = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((x ^ x >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }
}

impl Layers {
    /// The columns [`CoatedConductor::once`] and [`CoatedConductor::more`].
    pub fn columns(&self) -> [[f32; 15]; 2] {
        let nodes: [f64; COSINES] =
            core::array::from_fn(|k| ((k as f64 + 0.5) / COSINES as f64).powf(1.5).max(0.01));
        let mut random = Random(1);
        // For each part: the light by cosine and colour, and the slopes of the half vectors with what they carry.
        let mut light = [[[0.0; 3]; COSINES]; 2];
        let mut slopes = [const { Vec::new() }; 2];
        for (node, &cos) in nodes.iter().enumerate() {
            let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            for _ in 0..WALKS {
                let Some((part, w, beta)) = self.walk(wo, &mut random) else { continue };
                for c in 0..3 {
                    light[part][node][c] += beta[c] / WALKS as f64;
                }
                if cos > 0.6 {
                    let h = (wo + w).normalize();
                    slopes[part].push(((1.0 / (h.z * h.z) - 1.0).max(0.0), beta[0] + beta[1] + beta[2]));
                }
            }
        }
        core::array::from_fn(|part| {
            let alpha = median(&mut slopes[part]).sqrt();
            self.fit(&nodes, &light[part], alpha)
        })
    }

    /// Follows light that comes from `wo` (or goes there) between the layers until it leaves: in which part it is, its
    /// direction and what is left of it. None for light that the coat reflects.
    fn walk(&self, wo: Vec3<f64>, random: &mut Random) -> Option<(usize, Vec3<f64>, [f64; 3])> {
        let eta = [self.conductor_eta, self.conductor_k].map(|c| Rgb::new(c[0], c[1], c[2]));
        let (mut w, weight) = self.through_coat(wo, random)?;
        if w.z > 0.0 {
            return None;
        }
        let mut beta = [weight; 3];
        for order in 0..self.orders {
            // Down; at the conductor; up again.
            let down = (self.thickness / w.z).exp();
            let at = -w;
            let (h, seen) = if self.conductor_alpha < SMOOTH {
                (Vec3::new(0.0, 0.0, 1.0), None)
            } else {
                let ggx = Ggx { u: self.conductor_alpha, v: self.conductor_alpha };
                (ggx.sample(at, [random.unit(), random.unit()]), Some(ggx))
            };
            let up = reflect(at, h);
            if up.z <= 0.0 {
                return None;
            }
            let reflected = fresnel::conductor(at.dot(h).max(0.0), eta[0], eta[1]);
            let scale =
                seen.map_or(1.0, |ggx| ggx.seen_again(at, up)) * down * (-self.thickness / up.z).exp();
            let (next, weight) = self.through_coat(-up, random)?;
            for (beta, reflected) in beta.iter_mut().zip([reflected.r, reflected.g, reflected.b]) {
                *beta *= reflected * scale * weight;
            }
            w = next;
            if w.z > 0.0 {
                return Some(((order > 0) as usize, w, beta));
            }
        }
        None
    }

    /// Reflects or refracts at the surface of the coat: the direction, and what is left, the index taken out.
    fn through_coat(&self, wo: Vec3<f64>, random: &mut Random) -> Option<(Vec3<f64>, f64)> {
        let lobe = random.unit();
        if self.alpha < SMOOTH {
            let eta = if wo.z > 0.0 { self.eta } else { 1.0 / self.eta };
            let (reflected, cos_t, total) = fresnel::dielectric(wo.z.abs(), eta);
            if lobe < reflected || total {
                return Some((Vec3::new(-wo.x, -wo.y, wo.z), 1.0));
            }
            let refracted = Vec3::new(-wo.x / eta, -wo.y / eta, (-cos_t).xor_sign(wo.z));
            return Some((refracted.normalize(), 1.0));
        }
        let coat = MicrofacetDielectric::white(self.eta, self.alpha);
        let s = coat.sample(wo, lobe, [random.unit(), random.unit()]);
        s.valid.then_some((s.wi, s.weight.r * s.eta_scale))
    }

    /// The columns of a part.
    fn fit(&self, nodes: &[f64; COSINES], light: &[[f64; 3]; COSINES], alpha: f64) -> [f32; 15] {
        // What is reflected once goes through the coat twice, roughly.
        let width = 1.4 * self.alpha.max(0.5 * alpha);
        let w = width.max(0.02);
        let mut columns = [
            alpha as f32,
            (width * width).min(1.0) as f32,
            w as f32,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ];
        if light.iter().flatten().all(|&x| x == 0.0) {
            return columns;
        }
        let basis = |cos: f64| {
            let c = (cos * cos + (width * width).min(1.0) * (1.0 - cos * cos)).sqrt();
            let through = fresnel::transmitted(c, self.eta);
            let y = cos / (cos + w);
            core::array::from_fn::<f64, TERMS, _>(|term| through * y.powi(term as i32))
        };
        let terms = nodes.map(basis);
        let value = |coefficients: &[f64; TERMS], cos: f64| {
            basis(cos).iter().zip(coefficients).map(|(b, c)| b * c).sum::<f64>().clamp(0.0, 1.0)
        };
        let ggx = Ggx { u: alpha.max(SMOOTH), v: alpha.max(SMOOTH) };
        for c in 0..3 {
            // Lobes lose what is shadowed, and what of them is wide lies between cosines: r is changed until the lobe
            // reflects what came back from the walk.
            let mut wanted: [f64; COSINES] = core::array::from_fn(|k| light[k][c]);
            let mut coefficients = least_squares(&terms, &wanted);
            for _ in 0..4 {
                for (k, &cos) in nodes.iter().enumerate() {
                    let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                    let here = value(&coefficients, cos);
                    let albedo = mean_over_normals(wo, if alpha < SMOOTH { 0.0 } else { alpha }, |h| {
                        let wi = reflect(wo, h);
                        if wi.z <= 0.0 {
                            return 0.0;
                        }
                        let seen = if alpha < SMOOTH { 1.0 } else { ggx.seen_again(wo, wi) };
                        seen * (here * value(&coefficients, wi.z)).sqrt()
                    });
                    wanted[k] = (here * (light[k][c] / albedo.max(1e-6)).clamp(0.5, 2.0)).min(1.0);
                }
                coefficients = least_squares(&terms, &wanted);
            }
            for (term, x) in coefficients.into_iter().enumerate() {
                columns[3 + TERMS * c + term] = x as f32;
            }
        }
        columns
    }
}

/// The value that as much light is above as below; 0 if there is none.
fn median(slopes: &mut [(f64, f64)]) -> f64 {
    slopes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * slopes.iter().map(|slope| slope.1).sum::<f64>();
    let mut sum = 0.0;
    for (slope, weight) in slopes.iter() {
        sum += weight;
        if sum >= half {
            return *slope;
        }
    }
    0.0
}

/// Coefficients that make of the terms what is wanted, nearly: normal equations, by elimination. A little of each
/// coefficient's square is counted, too, so that noise makes no waves.
fn least_squares(terms: &[[f64; TERMS]; COSINES], wanted: &[f64; COSINES]) -> [f64; TERMS] {
    let mut system = [[0.0; TERMS + 1]; TERMS];
    for (i, row) in system.iter_mut().enumerate() {
        for (terms, wanted) in terms.iter().zip(wanted) {
            for (sum, factor) in row.iter_mut().zip(terms.iter().chain([wanted])) {
                *sum += terms[i] * factor;
            }
        }
        row[i] += 1e-6;
    }
    for i in 0..TERMS {
        let (above, below) = system.split_at_mut(i + 1);
        for row in below {
            let ratio = row[i] / above[i][i];
            for (x, y) in row.iter_mut().zip(above[i]) {
                *x -= ratio * y;
            }
        }
    }
    let mut solution = [0.0; TERMS];
    for i in (0..TERMS).rev() {
        let known: f64 = (i + 1..TERMS).map(|j| system[i][j] * solution[j]).sum();
        solution[i] = (system[i][TERMS] - known) / system[i][i];
    }
    solution
}
