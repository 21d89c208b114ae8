//! Relief: normals that textures turn.
//!
//! Blinn, "Simulation of Wrinkled Surfaces" (1978), as pbrt has it: the surface moved along its normal by a texture, whose
//! tangents come from differences. And maps of normals in the frame of the tangents.

use super::Point;
use crate::lanes::{Real, map3};
use crate::math::{Rgb, Vec3};
use crate::scene::parametrization::Tangents;
use crate::shade::surface::Surface;

/// The steps over which differences are taken: half of what a part of a pixel sees, along u and along v.
#[inline(always)]
pub(super) fn steps<F: Real>(at: &Point<F>, tangents: &Tangents<F>) -> [F; 2] {
    let Tangents { u, v, .. } = tangents;
    // Least squares: the footprint's vectors in coordinates of the tangents.
    let (uu, uv, vv) = (u.length2(), u.dot(*v), v.length2());
    let inverse = (uu * vv - uv * uv).recip();
    let [x, y] = at.footprint;
    let half = F::lit(0.5);
    let along_u = along(x, (vv, *u), (uv, *v), inverse) + along(y, (vv, *u), (uv, *v), inverse);
    let along_v = along(x, (uu, *v), (uv, *u), inverse) + along(y, (uu, *v), (uv, *u), inverse);
    [usable(along_u * half), usable(along_v * half)]
}

/// How far a vector goes along a tangent: |(a m.f - b n.f) / determinant|.
#[inline(always)]
fn along<F: Real>(f: Vec3<F>, (a, m): (F, Vec3<F>), (b, n): (F, Vec3<F>), inverse: F) -> F {
    ((a * m.dot(f) - b * n.dot(f)) * inverse).abs()
}

/// The step, or a fixed one where it is none.
#[inline(always)]
fn usable<F: Real>(step: F) -> F {
    let fine = step.gt(F::lit(1e-7)) & step.lt(F::lit(1e8));
    F::select(fine, step, F::lit(0.0005))
}

/// The point that lies a step further along u, or v.
#[inline(always)]
pub(super) fn shifted<F: Real>(at: &Point<F>, tangents: &Tangents<F>, [du, dv]: [F; 2]) -> Point<F> {
    Point {
        position: tangents.u.mul_add(du, tangents.v.mul_add(dv, at.position)),
        uv: [at.uv[0] + du, at.uv[1] + dv],
        ..*at
    }
}

/// The normal of the surface moved by `heights`: at the point, a step further along u, and along v.
#[inline(always)]
pub(super) fn displaced<F: Real>(
    surface: &Surface<F>,
    tangents: &Tangents<F>,
    heights: [F; 3],
    [du, dv]: [F; 2],
) -> Vec3<F> {
    let [height, further_u, further_v] = heights;
    let n = surface.shading_normal;
    let u = n.mul_add((further_u - height) / du, tangents.normal_u.mul_add(height, tangents.u));
    let v = n.mul_add((further_v - height) / dv, tangents.normal_v.mul_add(height, tangents.v));
    facing(surface, u.cross(v).normalize())
}

/// The normal that a map gives: its channels are coordinates, from -1 to 1, in the frame of u and the normal.
#[inline(always)]
pub(super) fn mapped<F: Real>(surface: &Surface<F>, tangents: &Tangents<F>, colour: Rgb<F>) -> Vec3<F> {
    let [x, y, z] = map3!([colour.r, colour.g, colour.b], |c| c.mul_sub(F::lit(2.0), F::one()));
    let n = surface.shading_normal;
    let s = tangents.u.normalize();
    let t = n.cross(s);
    facing(surface, s.mul_add(x, t.mul_add(y, n.scale(z))).normalize())
}

/// On the side of the geometric normal; what is no direction leaves the surface as it is.
#[inline(always)]
fn facing<F: Real>(surface: &Surface<F>, normal: Vec3<F>) -> Vec3<F> {
    let turned = normal.xor_sign(normal.dot(surface.normal));
    let unit = turned.length2();
    Vec3::select(unit.gt(F::lit(0.5)) & unit.lt(F::lit(2.0)), turned, surface.shading_normal)
}
