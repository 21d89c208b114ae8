//! Vectors, frames and the numerical helpers that more than one stage uses.

use crate::lanes::Real;
use core::ops::{Add, Mul, Neg, Sub};

/// Three coordinates a lane: a point or a direction.
#[derive(Clone, Copy, Debug)]
pub struct Vec3<F> {
    /// First coordinate.
    pub x: F,
    /// Second coordinate.
    pub y: F,
    /// Third coordinate.
    pub z: F,
}

impl<F: Real> Add for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Vec3 { x: self.x + o.x, y: self.y + o.y, z: self.z + o.z }
    }
}
impl<F: Real> Sub for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Vec3 { x: self.x - o.x, y: self.y - o.y, z: self.z - o.z }
    }
}
impl<F: Real> Neg for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Vec3 { x: -self.x, y: -self.y, z: -self.z }
    }
}

impl<F: Real> Vec3<F> {
    /// From lanes.
    #[inline(always)]
    pub fn new(x: F, y: F, z: F) -> Self {
        Vec3 { x, y, z }
    }
    /// The same vector in all lanes.
    #[inline(always)]
    pub fn splat(v: [f32; 3]) -> Self {
        Vec3 { x: F::splat(v[0]), y: F::splat(v[1]), z: F::splat(v[2]) }
    }
    /// The same number in all coordinates.
    #[inline(always)]
    pub fn all(x: F) -> Self {
        Vec3 { x, y: x, z: x }
    }
    /// (0, 0, 0).
    #[inline(always)]
    pub fn zero() -> Self {
        Self::all(F::zero())
    }
    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> F {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }
    /// Vector product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Vec3 {
            x: self.y.mul_sub(o.z, self.z * o.y),
            y: self.z.mul_sub(o.x, self.x * o.z),
            z: self.x.mul_sub(o.y, self.y * o.x),
        }
    }
    /// Times a number.
    #[inline(always)]
    pub fn scale(self, s: F) -> Self {
        Vec3 { x: self.x * s, y: self.y * s, z: self.z * s }
    }
    /// `self * s + o`.
    #[inline(always)]
    pub fn mul_add(self, s: F, o: Self) -> Self {
        Vec3 { x: self.x.mul_add(s, o.x), y: self.y.mul_add(s, o.y), z: self.z.mul_add(s, o.z) }
    }
    /// Squared length.
    #[inline(always)]
    pub fn length2(self) -> F {
        self.dot(self)
    }
    /// Unit length; NaN for (0, 0, 0).
    #[inline(always)]
    pub fn normalize(self) -> Self {
        self.scale(self.length2().sqrt().recip())
    }
    /// `mask ? a : b`.
    #[inline(always)]
    pub fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        Vec3 { x: F::select(mask, a.x, b.x), y: F::select(mask, a.y, b.y), z: F::select(mask, a.z, b.z) }
    }
    /// Negated where `sign` is negative.
    #[inline(always)]
    pub fn xor_sign(self, sign: F) -> Self {
        Vec3 { x: self.x.xor_sign(sign), y: self.y.xor_sign(sign), z: self.z.xor_sign(sign) }
    }
    /// Lane `i` as an array.
    #[inline(always)]
    pub fn lane(self, i: usize) -> [f32; 3] {
        [self.x.to_array()[i], self.y.to_array()[i], self.z.to_array()[i]]
    }
}

/// A colour a lane: radiance, throughput, reflectance. Linear red, green, blue.
///
/// Light of one colour does not turn into light of another, so there is nothing here that mixes channels but what
/// decides about paths ([`Rgb::max_component`], [`Rgb::sum`]).
#[derive(Clone, Copy, Debug)]
pub struct Rgb<F> {
    /// Red.
    pub r: F,
    /// Green.
    pub g: F,
    /// Blue.
    pub b: F,
}

impl<F: Real> Mul for Rgb<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Rgb { r: self.r * o.r, g: self.g * o.g, b: self.b * o.b }
    }
}

impl<F: Real> Rgb<F> {
    /// From lanes.
    #[inline(always)]
    pub fn new(r: F, g: F, b: F) -> Self {
        Rgb { r, g, b }
    }
    /// The same colour in all lanes.
    #[inline(always)]
    pub fn splat(c: [f32; 3]) -> Self {
        Rgb { r: F::splat(c[0]), g: F::splat(c[1]), b: F::splat(c[2]) }
    }
    /// Grey: the same number in all channels.
    #[inline(always)]
    pub fn all(x: F) -> Self {
        Rgb { r: x, g: x, b: x }
    }
    /// Black.
    #[inline(always)]
    pub fn zero() -> Self {
        Self::all(F::zero())
    }
    /// Times a number.
    #[inline(always)]
    pub fn scale(self, s: F) -> Self {
        Rgb { r: self.r * s, g: self.g * s, b: self.b * s }
    }
    /// The largest channel.
    #[inline(always)]
    pub fn max_component(self) -> F {
        self.r.max(self.g).max(self.b)
    }
    /// The sum of the channels: not finite if one of them is not.
    #[inline(always)]
    pub fn sum(self) -> F {
        self.r + self.g + self.b
    }
    /// `mask ? a : b`.
    #[inline(always)]
    pub fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        Rgb { r: F::select(mask, a.r, b.r), g: F::select(mask, a.g, b.g), b: F::select(mask, a.b, b.b) }
    }
    /// Lane `i` as an array.
    #[inline(always)]
    pub fn lane(self, i: usize) -> [f32; 3] {
        [self.r.to_array()[i], self.g.to_array()[i], self.b.to_array()[i]]
    }
}

/// A right-handed orthonormal frame around a unit normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame<F> {
    /// First tangent.
    pub s: Vec3<F>,
    /// Second tangent.
    pub t: Vec3<F>,
    /// The normal.
    pub n: Vec3<F>,
}

impl<F: Real> Frame<F> {
    /// Branchless frame (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
    #[inline(always)]
    pub fn from_normal(n: Vec3<F>) -> Self {
        let sign = F::one().xor_sign(n.z);
        let a = -(sign + n.z).recip();
        let b = n.x * n.y * a;
        let s = Vec3::new((sign * n.x * n.x).mul_add(a, F::one()), sign * b, -(sign * n.x));
        let t = Vec3::new(b, (n.y * n.y).mul_add(a, sign), -n.y);
        Frame { s, t, n }
    }
    /// Around a unit normal, with the first tangent as close as can be to a vector; any tangents where that is 0 or along
    /// the normal.
    #[inline(always)]
    pub fn along(n: Vec3<F>, tangent: Vec3<F>) -> Self {
        let any = Self::from_normal(n);
        // Scenes are of any scale: squares must not leave the range of numbers.
        let largest = tangent.x.abs().max(tangent.y.abs()).max(tangent.z.abs());
        let tangent = tangent.scale(largest.recip());
        let flat = n.mul_add(-n.dot(tangent), tangent);
        // False where it is 0 / 0, too.
        let there = flat.length2().gt(F::lit(1e-8));
        let s = Vec3::select(there, flat.normalize(), any.s);
        Frame { s, t: n.cross(s), n }
    }
    /// From the frame's coordinates to the world's.
    #[inline(always)]
    pub fn to_world(&self, v: Vec3<F>) -> Vec3<F> {
        self.s.mul_add(v.x, self.t.mul_add(v.y, self.n.scale(v.z)))
    }
    /// From the world's coordinates to the frame's.
    #[inline(always)]
    pub fn to_local(&self, v: Vec3<F>) -> Vec3<F> {
        Vec3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }
}

/// Weight of the strategy with density `pdf` when the other has `other`, by the power heuristic with exponent 2
/// (Veach 1997, section 9.2.4), through the ratio so that squares neither overflow nor vanish.
///
/// 1 where `other` is 0; `pdf` above 0.
#[inline(always)]
pub fn power_heuristic<F: Real>(pdf: F, other: F) -> F {
    let ratio = other / pdf;
    ratio.mul_add(ratio, F::one()).recip()
}

/// Uniform direction on the unit sphere; density 1 / (4 pi).
#[inline(always)]
pub fn uniform_sphere<F: Real>(u: [F; 2]) -> Vec3<F> {
    let z = u[0].neg_mul_add(F::lit(2.0), F::one());
    let r = z.neg_mul_add(z, F::one()).max(F::zero()).sqrt();
    let (sin, cos) = u[1].sin_cos_turns();
    Vec3::new(r * cos, r * sin, z)
}

/// Uniform point on the unit disk; density 1 / pi.
#[inline(always)]
pub fn uniform_disk<F: Real>(u: [F; 2]) -> (F, F) {
    let r = u[0].sqrt();
    let (sin, cos) = u[1].sin_cos_turns();
    (r * cos, r * sin)
}

/// Direction around +z with density cos / pi.
#[inline(always)]
pub fn cosine_hemisphere<F: Real>(u: [F; 2]) -> Vec3<F> {
    let (x, y) = uniform_disk(u);
    Vec3::new(x, y, (F::one() - u[0]).max(F::zero()).sqrt())
}
