//! Fresnel reflectances, unpolarised.

use crate::lanes::Real;
use crate::math::Rgb;

/// Reflectance of a dielectric for the cosine of incidence `cos_i` >= 0 and the relative index `eta` (transmitted
/// side over incident side), the cosine of refraction, and the lanes of total internal reflection.
#[inline(always)]
pub fn dielectric<F: Real>(cos_i: F, eta: F) -> (F, F, F::Mask) {
    // sin_t^2 = sin_i^2 / eta^2; cos_t^2 = 1 - sin_t^2 = (eta^2 - 1 + cos_i^2) / eta^2. For eta near 1 and grazing
    // light the first form loses all digits; (eta - 1)(eta + 1) does not.
    let scaled = (eta - F::one()).mul_add(eta + F::one(), cos_i * cos_i);
    let total = scaled.le(F::zero());
    // eta cos_t.
    let eta_cos_t = scaled.max(F::zero()).sqrt();
    let cos_t = eta_cos_t / eta;
    let parallel = (eta.mul_sub(cos_i, cos_t)) / (eta.mul_add(cos_i, cos_t));
    let perpendicular = (cos_i - eta_cos_t) / (cos_i + eta_cos_t);
    let mean = F::lit(0.5) * parallel.mul_add(parallel, perpendicular * perpendicular);
    (F::select(total, F::one(), mean), cos_t, total)
}

/// Transmittance of a dielectric, 1 - the reflectance of [`dielectric`], without the cancellation where that is nearly 1.
///
/// For either polarisation 1 - ((a - b) / (a + b))^2 = 4 a b / (a + b)^2.
#[inline(always)]
pub fn transmitted<F: Real>(cos_i: F, eta: F) -> F {
    let scaled = (eta - F::one()).mul_add(eta + F::one(), cos_i * cos_i);
    let eta_cos_t = scaled.max(F::zero()).sqrt();
    let cos_t = eta_cos_t / eta;
    let (perpendicular, parallel) = (cos_i + eta_cos_t, eta.mul_add(cos_i, cos_t));
    let sum = (perpendicular * perpendicular).recip() + (parallel * parallel).recip();
    F::lit(2.0) * cos_i * eta_cos_t * sum
}

/// Reflectance of a conductor of complex index eta + i k, one channel.
#[inline(always)]
fn conductor_channel<F: Real>(cos_i: F, eta: F, k: F) -> F {
    // Born and Wolf, section 14.4.1, in the form of Lagarde (2013): exact, with real arithmetic only. Fourth powers of
    // the index occur; beyond 1e9 the reflectance is 1 to within 4e-9, so larger ones do not matter, and these do not
    // overflow. What is divided by is 0 where the index is 1 (or 0) and the light grazes (or does not).
    let tiny = F::lit(1e-30);
    let (eta, k) = (eta.min(F::lit(1e9)), k.min(F::lit(1e9)));
    let cos2 = cos_i * cos_i;
    let sin2 = F::one() - cos2;
    let (eta2, k2) = (eta * eta, k * k);
    let t0 = eta2 - k2 - sin2;
    let a2_plus_b2 = t0.mul_add(t0, F::lit(4.0) * eta2 * k2).max(F::zero()).sqrt();
    let t1 = a2_plus_b2 + cos2;
    // a^2 = (a2_plus_b2 + t0) / 2, which cancels where t0 < 0 (all good mirrors): there a^2 b^2 = eta^2 k^2 over
    // b^2 = (a2_plus_b2 - t0) / 2.
    let larger2 = F::lit(0.5) * (a2_plus_b2 + t0.abs());
    let a = F::select(t0.lt(F::zero()), eta2 * k2 / larger2.max(tiny), larger2).sqrt();
    let t2 = F::lit(2.0) * cos_i * a;
    // Both numerators are squares of magnitudes; where they are 0 (index 1), rounding makes them -1e-9.
    let rs = (t1 - t2).max(F::zero()) / (t1 + t2).max(tiny);
    let t3 = cos2.mul_add(a2_plus_b2, sin2 * sin2);
    let t4 = t2 * sin2;
    // Where both are 0 (index 0, no slant) this is as much as the other.
    let rp = rs * (t3 - t4).max(tiny) / (t3 + t4).max(tiny);
    F::lit(0.5) * (rp + rs)
}

/// Reflectance of a conductor of complex index `eta` + i `k` for the cosine of incidence `cos_i` >= 0.
#[inline(always)]
pub fn conductor<F: Real>(cos_i: F, eta: Rgb<F>, k: Rgb<F>) -> Rgb<F> {
    Rgb::new(
        conductor_channel(cos_i, eta.r, k.r),
        conductor_channel(cos_i, eta.g, k.g),
        conductor_channel(cos_i, eta.b, k.b),
    )
}
