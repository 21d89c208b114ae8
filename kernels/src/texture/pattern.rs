//! Patterns: checks, dots, and what is made of Perlin's noise.
//!
//! Perlin, "Improving Noise" (2002), with gradients chosen as pbrt chooses them, so that its scenes look the same.

use super::mapping::{Affine, floor, transform_point, transform_vector, whole_modulo};
use super::table::Solid;
use super::{Point, table::Checks};
use crate::lanes::{Real, Uint, map3};
use crate::math::{Rgb, Vec3};

/// Perlin's permutation of the bytes (2002), which numbers are hashed through, twice in a row: sums of a byte and a
/// number up to 256 need no modulo.
static PERMUTATION: [u32; 512] = {
    const ONCE: [u8; 256] = [
        151, 160, 137, 91, 90, 15, 131, 13, 201, 95, 96, 53, 194, 233, 7, 225, 140, 36, 103, 30, 69, 142, 8,
        99, 37, 240, 21, 10, 23, 190, 6, 148, 247, 120, 234, 75, 0, 26, 197, 62, 94, 252, 219, 203, 117, 35,
        11, 32, 57, 177, 33, 88, 237, 149, 56, 87, 174, 20, 125, 136, 171, 168, 68, 175, 74, 165, 71, 134,
        139, 48, 27, 166, 77, 146, 158, 231, 83, 111, 229, 122, 60, 211, 133, 230, 220, 105, 92, 41, 55, 46,
        245, 40, 244, 102, 143, 54, 65, 25, 63, 161, 1, 216, 80, 73, 209, 76, 132, 187, 208, 89, 18, 169,
        200, 196, 135, 130, 116, 188, 159, 86, 164, 100, 109, 198, 173, 186, 3, 64, 52, 217, 226, 250, 124,
        123, 5, 202, 38, 147, 118, 126, 255, 82, 85, 212, 207, 206, 59, 227, 47, 16, 58, 17, 182, 189, 28,
        42, 223, 183, 170, 213, 119, 248, 152, 2, 44, 154, 163, 70, 221, 153, 101, 155, 167, 43, 172, 9, 129,
        22, 39, 253, 19, 98, 108, 110, 79, 113, 224, 232, 178, 185, 112, 104, 218, 246, 97, 228, 251, 34,
        242, 193, 238, 210, 144, 12, 191, 179, 162, 241, 81, 51, 145, 235, 249, 14, 239, 107, 49, 192, 214,
        31, 181, 199, 106, 157, 184, 84, 204, 176, 115, 121, 50, 45, 127, 4, 150, 254, 138, 236, 205, 93,
        222, 114, 67, 29, 24, 72, 243, 141, 128, 195, 78, 66, 215, 61, 156, 180,
    ];
    let mut twice = [0; 512];
    let mut i = 0;
    while i < 512 {
        twice[i] = ONCE[i % 256] as u32;
        i += 1;
    }
    twice
};

#[inline(always)]
fn lerp<F: Real>(t: F, a: F, b: F) -> F {
    (b - a).mul_add(t, a)
}

/// The permutation of a number below 512.
#[inline(always)]
fn hash<U: Uint>(i: U) -> U {
    // SAFETY: callers add up to 256 to a byte.
    unsafe { U::gather(&PERMUTATION, i) }
}

/// The product of an offset from a corner and the gradient there, one of twelve (and four of them again), by the hash of
/// the corner.
#[inline(always)]
fn gradient<F: Real>(h: F::Uint, dx: F, dy: F, dz: F) -> F {
    let h = hash(h) & F::Uint::splat(15);
    let along = h.eq(F::Uint::splat(12)) | h.eq(F::Uint::splat(13));
    let u = F::select(h.lt(F::Uint::splat(8)) | along, dx, dy);
    let v = F::select(h.lt(F::Uint::splat(4)) | along, dy, dz);
    // The lowest bits become signs.
    u.xor_sign(F::from_bits(h.shl::<31>())) + v.xor_sign(F::from_bits((h & F::Uint::splat(2)).shl::<30>()))
}

/// t^3 (6 t^2 - 15 t + 10).
#[inline(always)]
fn fade<F: Real>(t: F) -> F {
    t.mul_add(F::lit(6.0), F::lit(-15.0)).mul_add(t, F::lit(10.0)) * (t * t * t)
}

/// Gradient noise, about -1 to 1, 0 at whole numbers.
#[inline(always)]
pub(super) fn noise<F: Real>(p: Vec3<F>) -> F {
    let cell = Vec3::new(floor(p.x), floor(p.y), floor(p.z));
    let d = p - cell;
    let [x, y, z] = map3!([cell.x, cell.y, cell.z], |c| whole_modulo(c, 256.0));
    let one = F::Uint::splat(1);
    let (x0, x1) = (hash(x), hash(x + one));
    let (y00, y10, y01, y11) = (hash(x0 + y), hash(x1 + y), hash(x0 + y + one), hash(x1 + y + one));
    let e = d - Vec3::all(F::one());
    let weight = Vec3::new(fade(d.x), fade(d.y), fade(d.z));
    let [low, high] = {
        let z1 = z + one;
        let a = lerp(weight.x, gradient(y00 + z, d.x, d.y, d.z), gradient(y10 + z, e.x, d.y, d.z));
        let b = lerp(weight.x, gradient(y01 + z, d.x, e.y, d.z), gradient(y11 + z, e.x, e.y, d.z));
        let c = lerp(weight.x, gradient(y00 + z1, d.x, d.y, e.z), gradient(y10 + z1, e.x, d.y, e.z));
        let d = lerp(weight.x, gradient(y01 + z1, d.x, e.y, e.z), gradient(y11 + z1, e.x, e.y, e.z));
        [lerp(weight.y, a, b), lerp(weight.y, c, d)]
    };
    lerp(weight.z, low, high)
}

/// `0` below `a`, `1` above `b`, a cubic between.
#[inline(always)]
fn smooth_step<F: Real>(x: F, a: f64, b: f64) -> F {
    let t = ((x - F::lit(a)) * F::lit(1.0 / (b - a))).max(F::zero()).min(F::one());
    t * t * t.neg_mul_add(F::lit(2.0), F::lit(3.0))
}

/// Binary logarithm of a positive number to about 1e-5: for numbers of octaves.
#[inline(always)]
pub(super) fn log2<F: Real>(x: F) -> F {
    let bits = x.to_bits();
    let exponent = F::from_uint(bits.shr::<23>() & F::Uint::splat(255)) - F::lit(127.0);
    let m = F::from_bits((bits & F::Uint::splat(0x7f_ffff)) | F::Uint::splat(0x3f80_0000));
    // log2(m) = 2 / ln 2 artanh((m - 1) / (m + 1)), the series up to the ninth power.
    let r = (m - F::one()) / (m + F::one());
    let r2 = r * r;
    let series = r2
        .mul_add(F::lit(1.0 / 9.0), F::lit(1.0 / 7.0))
        .mul_add(r2, F::lit(1.0 / 5.0))
        .mul_add(r2, F::lit(1.0 / 3.0))
        .mul_add(r2, F::one());
    exponent + series * r * F::lit(2.0 * core::f64::consts::LOG2_E)
}

/// How many octaves of noise a footprint shows: those whose waves are longer than it.
#[inline(always)]
fn octaves_shown<F: Real>(footprint: [Vec3<F>; 2], most: u32) -> F {
    let length2 = footprint[0].length2().max(footprint[1].length2()).max(F::lit(1e-30));
    log2(length2).neg_mul_add(F::lit(0.5), F::lit(-1.0)).max(F::zero()).min(F::lit(most as f64))
}

/// How the octaves are added.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Sum {
    Noise,
    Magnitude,
}

/// The sum of `most` octaves of noise, each 1.99 times as fine as the one before and `roughness` times as strong. Those
/// that the footprint does not show count as their mean (0, or about 0.2 for magnitudes).
#[inline(always)]
fn octaves<F: Real>(p: Vec3<F>, footprint: [Vec3<F>; 2], most: u32, roughness: f32, how: Sum) -> F {
    let shown = octaves_shown(footprint, most);
    let mean = F::lit(0.2);
    let (mut sum, mut frequency, mut strength) = (F::zero(), 1.0f32, 1.0f32);
    for octave in 0..=most {
        // 1 for whole octaves, a part for the last one, 0 for those behind it.
        let whole = F::lit(octave as f64 + 1.0).le(shown);
        let rest = shown - F::lit(octave as f64);
        let begun = rest.ge(F::zero());
        let share = F::select(whole, F::one(), smooth_step(rest, 0.3, 0.7));
        let share = F::select(begun, share, F::zero());
        let value = noise(p.scale(F::splat(frequency)));
        let value = match how {
            Sum::Noise => share * value,
            Sum::Magnitude => {
                // The octave that is shown in part counts as that and as its mean, as in pbrt.
                let mixed = F::select(begun, lerp(share, mean, value.abs()), F::zero());
                let hidden = if octave < most { mean } else { F::zero() };
                F::select(whole, value.abs(), mixed + hidden)
            }
        };
        sum = value.mul_add(F::splat(strength), sum);
        frequency *= 1.99;
        strength *= roughness;
    }
    sum
}

#[inline(always)]
fn placed<F: Real>(m: &Affine, at: &Point<F>) -> (Vec3<F>, [Vec3<F>; 2]) {
    let [x, y] = at.footprint;
    (transform_point(m, at.position), [transform_vector(m, x), transform_vector(m, y)])
}

/// Is (s, t), or the point, in a cell of the first kind? Cells are unit squares or cubes.
#[inline(always)]
pub(super) fn is_first<F: Real>(checks: &Checks, at: &Point<F>) -> F::Mask {
    let parity = match checks {
        Checks::Plane(mapping) => {
            let [s, t] = mapping.map(at);
            whole_modulo(floor(s), 2.0) + whole_modulo(floor(t), 2.0)
        }
        Checks::Solid(texture_from_world) => {
            let p = transform_point(texture_from_world, at.position);
            whole_modulo(floor(p.x), 2.0) + whole_modulo(floor(p.y), 2.0) + whole_modulo(floor(p.z), 2.0)
        }
    };
    (parity & F::Uint::splat(1)).eq(F::Uint::splat(0))
}

/// Is (s, t) in a dot? About half of the unit cells around whole numbers hold one, of radius 0.35, shifted at random.
#[inline(always)]
pub(super) fn in_dot<F: Real>([s, t]: [F; 2]) -> F::Mask {
    const RADIUS: f64 = 0.35;
    let half = F::lit(0.5);
    let (x, y) = (floor(s + half), floor(t + half));
    let shift = F::lit(0.5 - RADIUS);
    let off_x = s - noise_of_cell([x, y], [1.5, 2.8]).mul_add(shift, x);
    let off_y = t - noise_of_cell([x, y], [4.5, 9.8]).mul_add(shift, y);
    noise_of_cell([x, y], [0.5, 0.5]).gt(F::zero())
        & off_x.mul_add(off_x, off_y * off_y).lt(F::lit(RADIUS * RADIUS))
}

/// Noise of the cell of a dot at (x, y), apart from other noise of it by a shift.
#[inline(always)]
fn noise_of_cell<F: Real>([x, y]: [F; 2], [dx, dy]: [f64; 2]) -> F {
    noise(Vec3::new(x + F::lit(dx), y + F::lit(dy), F::lit(0.5)))
}

/// A solid texture at a point.
#[inline(always)]
pub(super) fn solid<F: Real>(solid: &Solid, m: &Affine, at: &Point<F>) -> Rgb<F> {
    let (p, footprint) = placed(m, at);
    match *solid {
        Solid::Fbm { octaves: most, roughness } => {
            Rgb::all(octaves(p, footprint, most, roughness, Sum::Noise))
        }
        Solid::Wrinkled { octaves: most, roughness } => {
            Rgb::all(octaves(p, footprint, most, roughness, Sum::Magnitude))
        }
        Solid::Windy => {
            let tenth = F::lit(0.1);
            let [x, y] = footprint;
            let strength = octaves(p.scale(tenth), [x.scale(tenth), y.scale(tenth)], 3, 0.5, Sum::Noise);
            Rgb::all(strength.abs() * octaves(p, footprint, 6, 0.5, Sum::Noise))
        }
        Solid::Marble { octaves: most, roughness, scale, variation, segments } => {
            let scale = F::splat(scale);
            let (p, [x, y]) = (p.scale(scale), footprint);
            let sum = octaves(p, [x.scale(scale), y.scale(scale)], most, roughness, Sum::Noise);
            marble(sum.mul_add(F::splat(variation), p.y), segments)
        }
    }
}

/// Colours of veins: a spline through pbrt's nine, of which every four in a row make a cubic.
#[inline(always)]
fn marble<F: Real>(phase: F, segments: u32) -> Rgb<F> {
    const A: [f32; 3] = [0.58, 0.58, 0.6];
    const COLOURS: [[f32; 3]; 9] = [A, A, A, [0.5, 0.5, 0.5], [0.6, 0.59, 0.58], A, A, [0.2, 0.2, 0.33], A];
    // sin(phase), from turns in [0, 1].
    let turns = phase * F::lit(0.5 * core::f64::consts::FRAC_1_PI);
    let turns = (turns - floor(turns)).max(F::zero()).min(F::one());
    let (sine, _) = turns.sin_cos_turns();
    let t = sine.mul_add(F::lit(0.5), F::lit(0.5)) * F::lit(6.0);
    let first = floor(t).max(F::zero()).min(F::lit(segments as f64 - 1.0));
    let t = t - first;
    let place = first.to_uint() * F::Uint::splat(3);
    let [r, g, b] = map3!([0, 1, 2], |channel| veins(t, place + F::Uint::splat(channel), &COLOURS));
    Rgb::new(r, g, b)
}

/// 1.5 times the cubic over the number at `place` and the three that follow in the same channel.
#[inline(always)]
fn veins<F: Real>(t: F, place: F::Uint, colours: &[[f32; 3]; 9]) -> F {
    let colours = colours.as_flattened();
    // SAFETY: the first colour is number 5 at most (`TextureTable::new` checks the segments), so the last of four is number
    // 8, of 9.
    let (a, b, c, d) = unsafe {
        (
            F::gather(colours, place),
            F::gather(colours, place + F::Uint::splat(3)),
            F::gather(colours, place + F::Uint::splat(6)),
            F::gather(colours, place + F::Uint::splat(9)),
        )
    };
    let (ab, bc, cd) = (lerp(t, a, b), lerp(t, b, c), lerp(t, c, d));
    F::lit(1.5) * lerp(t, lerp(t, ab, bc), lerp(t, bc, cd))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_vanishes_at_whole_points_and_is_smooth() {
        for (x, y, z) in [(0.0f32, 0.0, 0.0), (3.0, -2.0, 7.0), (-300.0, 1e9, 5.0)] {
            assert_eq!(noise(Vec3::new(x, y, z)), 0.0);
        }
        let mut largest = 0.0f32;
        for i in 0..10_000 {
            let p = |h: f32| noise(Vec3::new(i as f32 * 0.0137 + h, i as f32 * -0.0071, 0.3));
            largest = largest.max(p(0.0).abs());
            assert!((p(1e-3) - p(0.0)).abs() < 5e-3);
        }
        assert!(largest > 0.5 && largest < 1.1, "{largest}");
    }

    /// From Perlin's definition, by hand: in the cell of the origin the corner (0, 0, 0) hashes to
    /// P(P(P(0))) = P(P(151)) = P(17) = 36, whose low bits 0100 mean x + z; and so on for the others.
    #[test]
    fn noise_is_perlins() {
        fn by_hand(x: f64, y: f64, z: f64) -> f64 {
            let hash = |x: usize, y: usize, z: usize| {
                let p = |i: usize| PERMUTATION[i] as usize;
                p(p(p(x) + y) + z) & 15
            };
            let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
            let mut sum = 0.0;
            for corner in 0..8 {
                let (i, j, k) = (corner & 1, corner >> 1 & 1, corner >> 2);
                let (dx, dy, dz) = (x - i as f64, y - j as f64, z - k as f64);
                let h = hash(i, j, k);
                let gradient = match h >> 2 {
                    0 => (dx, dy),
                    1 => (dx, dz),
                    2 => (dy, dz),
                    _ if h < 14 => (dx, dy),
                    _ => (dy, dz),
                };
                let sign = |v: f64, bit: usize| if h >> bit & 1 == 1 { -v } else { v };
                let weight = |w: f64, at: usize| if at == 1 { w } else { 1.0 - w };
                sum += (sign(gradient.0, 0) + sign(gradient.1, 1))
                    * weight(fade(x), i)
                    * weight(fade(y), j)
                    * weight(fade(z), k);
            }
            sum
        }
        for (x, y, z) in [(0.25f32, 0.5, 0.75), (0.1, 0.9, 0.4), (0.7, 0.2, 0.6)] {
            let (got, want) = (noise(Vec3::new(x, y, z)), by_hand(x.into(), y.into(), z.into()));
            assert!((got as f64 - want).abs() < 1e-6, "{got} {want}");
        }
    }

    #[test]
    fn logarithms() {
        for x in [1e-12f32, 0.3, 1.0, 1.5, 1.999, 2.0, 77.0] {
            assert!((log2(x) - x.log2()).abs() < 2e-5 * x.log2().abs().max(1.0), "{x}");
        }
    }
}
