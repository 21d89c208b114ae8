//! Noise from integer hashes: a pure function of the seed and the place.

use glam::DVec3;

/// PCG-RXS-M-XS as a hash (Jarzynski & Olano, "Hash Functions for GPU Rendering", JCGT 2020).
fn pcg(x: u32) -> u32 {
    let state = x.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Noise fields and random numbers that belong to one seed.
#[derive(Clone, Copy)]
pub(super) struct Noise {
    key: u32,
}

impl Noise {
    pub(super) fn new(seed: u32) -> Noise {
        Noise { key: pcg(seed ^ 0x5bd1_e995) }
    }

    /// The `index`th number of the sequence, uniform in [0, 1).
    pub(super) fn uniform(&self, index: u32) -> f64 {
        let high = u64::from(pcg(pcg(index) ^ self.key));
        let low = u64::from(pcg(pcg(index ^ 0x9e37_79b9) ^ self.key));
        ((high << 32 | low) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Dot product of the lattice point's gradient with the way to it. The twelve gradients are the edge midpoints of
    /// a cube (Perlin, "Improving Noise", 2002), four of them twice as likely as they fill sixteen places.
    fn corner(&self, x: i64, y: i64, z: i64, to: DVec3) -> f64 {
        let h = pcg(pcg(pcg(self.key ^ x as u32).wrapping_add(y as u32)).wrapping_add(z as u32));
        let (a, b) = match h >> 30 {
            0 => (to.x, to.y),
            1 => (to.x, to.z),
            2 => (to.y, to.z),
            _ => (to.x, to.y),
        };
        (if h & 1 == 0 { a } else { -a }) + (if h & 2 == 0 { b } else { -b })
    }

    /// Gradient noise in about [-1, 1], 0 at lattice points, twice differentiable.
    pub(super) fn gradient(&self, p: DVec3) -> f64 {
        let cell = p.floor();
        let f = p - cell;
        let (x, y, z) = (cell.x as i64, cell.y as i64, cell.z as i64);
        let w = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
        let at = |i: i64, j: i64, k: i64| {
            self.corner(x + i, y + j, z + k, f - DVec3::new(i as f64, j as f64, k as f64))
        };
        let lerp = |a: f64, b: f64, t: f64| a + t * (b - a);
        let row = |j: i64, k: i64| lerp(at(0, j, k), at(1, j, k), w.x);
        lerp(lerp(row(0, 0), row(1, 0), w.y), lerp(row(0, 1), row(1, 1), w.y), w.z)
    }

    /// Fractal sum of `octaves` of gradient noise, each twice as fine and half as strong as the last; about [-1, 1].
    pub(super) fn fractal(&self, p: DVec3, octaves: u32) -> f64 {
        let (mut sum, mut weight, mut total, mut q) = (0.0, 1.0, 0.0, p);
        for _ in 0..octaves {
            sum += weight * self.gradient(q);
            total += weight;
            weight *= 0.5;
            // An odd shift keeps the octaves' lattices, where all are 0, from falling together.
            q = q * 2.0 + DVec3::new(17.13, 5.71, 11.37);
        }
        if total > 0.0 { sum / total } else { 0.0 }
    }

    /// Ridged multifractal in about [0, 1]: sharp crests where the noise crosses 0, and the finer octaves count where
    /// the coarser are high, so that valleys stay smooth (Musgrave, in Ebert et al., "Texturing & Modeling").
    pub(super) fn ridged(&self, p: DVec3, octaves: u32) -> f64 {
        let (mut sum, mut weight, mut total, mut amplitude, mut q) = (0.0, 1.0, 0.0, 1.0, p);
        for _ in 0..octaves {
            let crest = 1.0 - self.gradient(q).abs();
            let signal = crest * crest * weight;
            sum += amplitude * signal;
            total += amplitude;
            weight = (signal * 1.8).clamp(0.0, 1.0);
            amplitude *= 0.48;
            q = q * 2.03 + DVec3::new(3.71, 19.13, 7.39);
        }
        if total > 0.0 { sum / total } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_numbers_fill_the_unit_interval_evenly() {
        let noise = Noise::new(3);
        let n = 10_000;
        let mean = (0..n).map(|i| noise.uniform(i)).sum::<f64>() / f64::from(n);
        assert!((0..n).all(|i| (0.0..1.0).contains(&noise.uniform(i))));
        // Standard error of the mean: sqrt(1/12/n) = 0.0029; this allows four of them.
        assert!((mean - 0.5).abs() < 0.0116, "{mean}");
    }

    #[test]
    fn noise_is_bounded_continuous_and_depends_on_the_seed() {
        let (a, b) = (Noise::new(1), Noise::new(2));
        let mut differs = false;
        for i in 0..4000 {
            let p = DVec3::new(0.017, -0.031, 0.043) * f64::from(i) - 20.0;
            let here = a.gradient(p);
            assert!(here.abs() <= 1.2);
            assert!((a.gradient(p + 1e-7) - here).abs() < 1e-5);
            assert!((0.0..=1.0).contains(&a.ridged(p, 6)));
            assert!(a.fractal(p, 6).abs() <= 1.2);
            differs |= (b.gradient(p) - here).abs() > 0.1;
        }
        assert!(differs);
    }
}
