//! Closed forms, in double precision.

use std::f64::consts::PI;

/// Share of the hemisphere's cosine-weighted directions that a square of half side `half`, parallel at `height`, fills for
/// a point below its centre: four times the form factor of a quarter seen from below its corner (Howell, C-17 or any table
/// of configuration factors).
pub fn square_above(half: f64, height: f64) -> f64 {
    let a = half / height;
    let root = (1.0 + a * a).sqrt();
    let corner = 2.0 * a / root * (a / root).atan();
    4.0 * corner / (2.0 * PI)
}

/// The same for a rectangle that stands on the plane of the point: from -`half` to `half` along its foot, `high`, at the
/// distance `gap` in front of the point (Howell, B-3).
pub fn wall(half: f64, high: f64, gap: f64) -> f64 {
    let (x, y) = (high / half, gap / half);
    let root = (x * x + y * y).sqrt();
    2.0 * ((1.0 / y).atan() - y / root * (1.0 / root).atan()) / (2.0 * PI)
}

/// Unpolarised reflectance of a dielectric, by Fresnel's equations; `eta` is the index beyond over that on this side.
pub fn fresnel(theta: f64, eta: f64) -> f64 {
    let (sin, cos) = theta.sin_cos();
    // 1 - sin^2 / eta^2 without cancellation for eta near 1.
    let cos2_t = ((eta - 1.0) * (eta + 1.0) + cos * cos) / (eta * eta);
    if cos2_t <= 0.0 || sin / eta >= 1.0 {
        return 1.0;
    }
    let cos_t = cos2_t.sqrt();
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    0.5 * (perpendicular * perpendicular + parallel * parallel)
}

/// A complex number.
#[derive(Clone, Copy)]
struct Complex(f64, f64);

impl Complex {
    fn add(self, o: Complex) -> Complex {
        Complex(self.0 + o.0, self.1 + o.1)
    }
    fn sub(self, o: Complex) -> Complex {
        Complex(self.0 - o.0, self.1 - o.1)
    }
    fn mul(self, o: Complex) -> Complex {
        Complex(self.0 * o.0 - self.1 * o.1, self.0 * o.1 + self.1 * o.0)
    }
    fn norm2(self) -> f64 {
        let scale = self.0.abs().max(self.1.abs());
        if scale == 0.0 { 0.0 } else { ((self.0 / scale).powi(2) + (self.1 / scale).powi(2)) * scale * scale }
    }
    fn sqrt(self) -> Complex {
        let length = self.norm2().sqrt();
        // The root that does not cancel, and the other part from the product.
        let larger = (0.5 * (length + self.0.abs())).sqrt();
        let smaller = if larger == 0.0 { 0.0 } else { 0.5 * self.1 / larger };
        if self.0 >= 0.0 { Complex(larger, smaller) } else { Complex(smaller.abs(), larger.copysign(self.1)) }
    }
}

/// Unpolarised reflectance of a conductor of index `eta` + i `k`, by Fresnel's equations with complex numbers.
pub fn conductor(theta: f64, eta: f64, k: f64) -> f64 {
    let (sin, cos) = theta.sin_cos();
    let index2 = Complex(eta, k).mul(Complex(eta, k));
    let normal = index2.sub(Complex(sin * sin, 0.0)).sqrt();
    let perpendicular = Complex(cos, 0.0).sub(normal).norm2() / Complex(cos, 0.0).add(normal).norm2();
    let scaled = index2.mul(Complex(cos, 0.0));
    let parallel = scaled.sub(normal).norm2() / scaled.add(normal).norm2();
    0.5 * (perpendicular + parallel)
}

/// Reflectance of a pane with both surfaces of reflectance `r`, all bounces between them: 2 r / (1 + r).
pub fn pane(r: f64) -> f64 {
    2.0 * r / (1.0 + r)
}

/// 1 + q + q^2 + ... of `terms` terms.
pub fn geometric(q: f64, terms: u32) -> f64 {
    (0..terms).fold(0.0, |sum, _| 1.0 + q * sum)
}

/// Oren and Nayar's constants A and B for a slope deviation in degrees (1994, the qualitative model).
pub fn oren_nayar_constants(sigma: f64) -> (f64, f64) {
    let s2 = sigma.to_radians().powi(2);
    (1.0 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09))
}

/// Their BRDF times pi, for a reflectance of 1; angles from the normal and between the azimuths, in radians.
pub fn oren_nayar(sigma: f64, theta_i: f64, theta_o: f64, phi: f64) -> f64 {
    let (a, b) = oren_nayar_constants(sigma);
    a + b * phi.cos().max(0.0) * theta_i.max(theta_o).sin() * theta_i.min(theta_o).tan()
}

/// Directional albedo of the same: A + (2 B / pi) (tan t (1 - sin^3 t) / 3 + sin t (t - sin t cos t) / 2), from the
/// integral over directions above and below the polar angle t.
pub fn oren_nayar_albedo(sigma: f64, t: f64) -> f64 {
    let (a, b) = oren_nayar_constants(sigma);
    let (sin, cos) = t.sin_cos();
    let beyond = if cos < 1e-12 { 0.0 } else { sin / cos * (1.0 - sin.powi(3)) / 3.0 };
    a + 2.0 * b / PI * (beyond + sin * (t - sin * cos) / 2.0)
}

/// GGX distribution of normals, for the squared tangent of their angle.
pub fn ggx_distribution(alpha: f64, cos: f64) -> f64 {
    let tan2 = (1.0 - cos * cos) / (cos * cos);
    let s = 1.0 + tan2 / (alpha * alpha);
    1.0 / (PI * alpha * alpha * cos.powi(4) * s * s)
}

/// Smith's lambda for GGX.
fn lambda(alpha: f64, cos: f64) -> f64 {
    let tan2 = (1.0 - cos * cos) / (cos * cos);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// Height-correlated shadowing and masking.
pub fn ggx_shadowing(alpha: f64, cos_o: f64, cos_i: f64) -> f64 {
    1.0 / (1.0 + lambda(alpha, cos_o) + lambda(alpha, cos_i))
}

/// Directional albedo of GGX microfacets that reflect everything, by quadrature over the normals that are seen from the
/// direction (by Heitz 2018, "Sampling the GGX Distribution of Visible Normals"): a mean of G2 / G1, which is at most 1.
pub fn ggx_albedo(alpha: f64, theta: f64) -> f64 {
    const N: usize = 512;
    let (sin_o, cos_o) = theta.sin_cos();
    // The direction in the space where microfacets are a hemisphere, and the axes across it.
    let length = (alpha * alpha * sin_o * sin_o + cos_o * cos_o).sqrt();
    let (x, z) = (alpha * sin_o / length, cos_o / length);
    let mut sum = 0.0;
    for i in 0..N {
        let r = ((i as f64 + 0.5) / N as f64).sqrt();
        for j in 0..N {
            let (sin, cos) = ((j as f64 + 0.5) / N as f64 * 2.0 * PI).sin_cos();
            // A point of the projected hemisphere: its lower half is partly hidden, and squeezed.
            let across = r * cos;
            let squeezed = 0.5 * (1.0 - z) * (1.0 - across * across).sqrt() + 0.5 * (1.0 + z) * r * sin;
            let along = (1.0 - across * across - squeezed * squeezed).max(0.0).sqrt();
            // Axes: y, and (-z, 0, x).
            let n = [along * x - squeezed * z, across, along * z + squeezed * x];
            let h = [alpha * n[0], alpha * n[1], n[2].max(0.0)];
            let norm = h.iter().map(|c| c * c).sum::<f64>().sqrt();
            let (h_x, cos_h) = (h[0] / norm, h[2] / norm);
            let o_h = sin_o * h_x + cos_o * cos_h;
            let cos_i = 2.0 * o_h * cos_h - cos_o;
            if cos_i > 0.0 {
                sum += ggx_shadowing(alpha, cos_o, cos_i) * (1.0 + lambda(alpha, cos_o));
            }
        }
    }
    sum / (N * N) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoint rule over the hemisphere: mean over directions of density cos / pi.
    fn hemisphere(f: impl Fn(f64, f64) -> f64) -> f64 {
        const N: usize = 3000;
        let mut sum = 0.0;
        for i in 0..N {
            let sin = ((i as f64 + 0.5) / N as f64).sqrt();
            for j in 0..N {
                sum += f(sin.asin(), (j as f64 + 0.5) / N as f64 * 2.0 * PI);
            }
        }
        sum / (N * N) as f64
    }
    fn near(a: f64, b: f64, tolerance: f64) {
        assert!((a - b).abs() <= tolerance * b.abs(), "{a} {b}");
    }

    #[test]
    fn form_factors_agree_with_quadrature() {
        let is_square = |t: f64, phi: f64| {
            let r = t.tan() * 1.0;
            f64::from((r * phi.cos()).abs() <= 0.7 && (r * phi.sin()).abs() <= 0.7)
        };
        near(square_above(0.7, 1.0), hemisphere(is_square), 2e-3);
        near(square_above(1e6, 1.0), 1.0, 1e-5);
        near(square_above(1e-6, 1.0), 4e-12 / PI, 1e-9);
        // The wall z = 1, |x| <= 0.5, 0 <= y <= 2, before a point whose normal is y.
        let is_wall = |t: f64, phi: f64| {
            let (x, y, z) = (t.sin() * phi.sin(), t.cos(), t.sin() * phi.cos());
            f64::from(z > 0.0 && (x / z).abs() <= 0.5 && y / z <= 2.0)
        };
        near(wall(0.5, 2.0, 1.0), hemisphere(is_wall), 2e-3);
        near(wall(1e9, 1e9, 1e-3), 0.5, 1e-6);
    }

    #[test]
    fn fresnel_agrees_with_known_values() {
        near(fresnel(0.0, 1.5), 0.04, 1e-12);
        near(fresnel(PI / 2.0, 1.5), 1.0, 1e-12);
        assert_eq!(fresnel(0.9, 1.0 / 1.5), 1.0, "total reflection");
        for theta in [0.0, 0.5, 1.2, 1.55] {
            near(conductor(theta, 1.5, 0.0), fresnel(theta, 1.5), 1e-9);
        }
        near(conductor(0.0, 1.0, 1e10), 1.0, 1e-12);
        near(conductor(0.0, 0.2, 3.0), (0.64 + 9.0) / (1.44 + 9.0), 1e-12);
    }

    #[test]
    fn albedos_agree_with_quadrature() {
        for t in [0.0, 0.7, 1.5] {
            near(oren_nayar_albedo(30.0, t), hemisphere(|i, phi| oren_nayar(30.0, i, t, phi)), 1e-3);
        }
        near(ggx_albedo(1e-3, 0.0), 1.0, 1e-5);
        // D cos integrates to 1, so the BRDF times cosine over directions is the albedo.
        let (alpha, o): (f64, f64) = (0.6, 0.4);
        let brdf = |i: f64, phi: f64| {
            let (wi, wo) = ([i.sin() * phi.cos(), i.sin() * phi.sin(), i.cos()], [o.sin(), 0.0, o.cos()]);
            let h: [f64; 3] = core::array::from_fn(|k| wi[k] + wo[k]);
            let length = h.iter().map(|x| x * x).sum::<f64>().sqrt();
            PI * ggx_distribution(alpha, h[2] / length) * ggx_shadowing(alpha, wo[2], wi[2])
                / (4.0 * wo[2] * wi[2])
        };
        near(ggx_albedo(alpha, o), hemisphere(brdf), 2e-3);
    }

    #[test]
    fn series() {
        near(geometric(0.5, 3), 1.75, 1e-15);
        near(geometric(1.0, 10_001), 10_001.0, 1e-15);
    }
}
