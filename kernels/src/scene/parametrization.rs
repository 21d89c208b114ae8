//! Coordinates on surfaces, (u, v): for textures. Scenes without them have none of it.

use super::error::{BuildError, exists, finite};
use super::geometry::Geometry;
use crate::lanes::{Mask, Real, Uint, map3};
use crate::math::{Frame, Vec3};
use crate::shade::parameters::TextureId;
use crate::shade::surface::Surface;
use crate::texture::{Affine, azimuth_turns, polar_angle};

/// Where the coordinates of a shape come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parametrization {
    /// Those of a triangle's corners: (0, 0), (1, 0) and (1, 1) for each.
    Corners,
    /// Given at the vertices of a mesh: that of vertex `k` is number `k + offset` (modulo 2^32) of the table.
    Vertices {
        /// Number of a vertex' coordinates, less that of the vertex.
        offset: u32,
    },
    /// Around the z axis of the object's space: u is the azimuth over its largest, v a linear function of another number.
    Round {
        /// Takes points of the world into the object's space.
        object_from_world: Affine,
        /// Largest azimuth, in turns.
        turns: f32,
        /// Which number.
        along: Along,
        /// Where v is 0.
        zero: f32,
        /// Where v is 1.
        one: f32,
    },
}

/// How much of a shape is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Opacity {
    /// For paths: the share of it that is there, 1 and more is all.
    pub for_paths: Option<TextureId>,
    /// For rays towards lights.
    pub for_light: Option<TextureId>,
    /// All of it is there but where the opacity is 0, instead of by chance: pbrt-v3.
    pub certain: bool,
}

/// What v measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Along {
    /// The angle to the z axis, in radians: spheres.
    Polar,
    /// The distance from the z axis: disks.
    Radius,
    /// z: cylinders.
    Height,
}

/// The coordinates of all primitives, flat.
#[derive(Clone, Debug, Default)]
pub(super) struct Parametrizations {
    /// Of each primitive, the number of its parametrization. Empty: there are none.
    of: Vec<u32>,
    /// [`NUMBERS`] each: object from world, factor of the azimuth, factor and summand of the other number.
    numbers: Vec<f32>,
    /// Two each: kind, offset of the vertices.
    kinds: Vec<u32>,
    /// Coordinates of vertices.
    uvs: Vec<[f32; 2]>,
    /// Some of them are round.
    round: bool,
    /// Of each parametrization, how much is there; empty if everything is.
    opacities: Vec<Option<Opacity>>,
}

const NUMBERS: usize = 16;
const CORNERS: u32 = 0;
const VERTICES: u32 = 1;
const POLAR: u32 = 2;
const RADIUS: u32 = 3;
const HEIGHT: u32 = 4;

impl Parametrizations {
    /// Checks them against the triangles of a geometry of so many primitives.
    pub(super) fn new(
        of: Vec<u32>,
        parametrizations: &[Parametrization],
        uvs: Vec<[f32; 2]>,
        opacities: Vec<Option<Opacity>>,
        triangles: &[[u32; 3]],
        primitives: usize,
    ) -> Result<Self, BuildError> {
        if of.is_empty() {
            return Ok(Parametrizations::default());
        }
        if of.len() != primitives {
            let (found, expected) = (of.len(), primitives);
            return Err(BuildError::Length { of: "parametrizations of primitives", found, expected });
        }
        if !opacities.is_empty() && opacities.len() != parametrizations.len() {
            let (found, expected) = (opacities.len(), parametrizations.len());
            return Err(BuildError::Length { of: "opacities of parametrizations", found, expected });
        }
        for (id, uv) in uvs.iter().enumerate() {
            finite("vertex", id, "a texture coordinate", uv)?;
        }
        for (id, &number) in of.iter().enumerate() {
            exists("primitive", id, "parametrization", number as usize, parametrizations.len())?;
            let wrong = |what: &str| Err(BuildError::Number { of: "primitive", id, what: what.into() });
            match (triangles.get(id), parametrizations[number as usize]) {
                (Some(corners), Parametrization::Vertices { offset }) => {
                    for &vertex in corners {
                        let uv = vertex.wrapping_add(offset) as usize;
                        exists("primitive", id, "texture coordinates", uv, uvs.len())?;
                    }
                }
                (Some(_), Parametrization::Corners) | (None, Parametrization::Round { .. }) => {}
                (Some(_), _) => return wrong("a triangle with coordinates of something round"),
                (None, _) => return wrong("something round with coordinates of triangles"),
            }
        }
        let mut numbers = Vec::with_capacity(NUMBERS * parametrizations.len());
        let mut kinds = Vec::with_capacity(2 * parametrizations.len());
        let mut round = false;
        for (id, parametrization) in parametrizations.iter().enumerate() {
            let mut row = [0.0; NUMBERS];
            let (kind, offset) = match *parametrization {
                Parametrization::Corners => (CORNERS, 0),
                Parametrization::Vertices { offset } => (VERTICES, offset),
                Parametrization::Round { object_from_world, turns, along, zero, one } => {
                    row[..12].copy_from_slice(object_from_world.as_flattened());
                    row[12] = 1.0 / turns;
                    row[13] = 1.0 / (one - zero);
                    row[14] = -zero * row[13];
                    round = true;
                    let kind = match along {
                        Along::Polar => POLAR,
                        Along::Radius => RADIUS,
                        Along::Height => HEIGHT,
                    };
                    (kind, 0)
                }
            };
            finite("parametrization", id, "a number", &row)?;
            numbers.extend(row);
            kinds.extend([kind, offset]);
        }
        Ok(Parametrizations { of, numbers, kinds, uvs, round, opacities })
    }

    /// Bytes on the heap.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.of[..])
            + size_of_val(&self.numbers[..])
            + size_of_val(&self.kinds[..])
            + size_of_val(&self.uvs[..])
            + size_of_val(&self.opacities[..])
    }

    /// Opacities of the parametrizations; empty if there are none.
    pub(super) fn opacities(&self) -> &[Option<Opacity>] {
        &self.opacities
    }

    /// The parametrization of a primitive, which has one.
    #[inline(always)]
    pub(super) fn number(&self, primitive: u32) -> u32 {
        self.of[primitive as usize]
    }

    /// Are there none?
    pub(super) fn is_empty(&self) -> bool {
        self.of.is_empty()
    }
}

/// The coordinates of a point of a primitive, or (0, 0) where the scene keeps none.
///
/// # Safety
/// Every lane of `primitive` is below `geometry.primitives()`.
#[inline(always)]
pub(crate) unsafe fn coordinates<F: Real>(
    geometry: &Geometry,
    primitive: F::Uint,
    point: Vec3<F>,
    (u, v): (F, F),
) -> [F; 2] {
    let table = geometry.parametrizations();
    if table.is_empty() {
        return [F::zero(); 2];
    }
    let splat = F::Uint::splat;
    // SAFETY: every primitive has a parametrization, and that two kinds and `NUMBERS` numbers; those of vertices are of
    // triangles, whose corners have coordinates. Lanes that are no triangle look at triangle 0 only if one lane is one.
    unsafe {
        let id = F::Uint::gather(&table.of, primitive);
        let kind = F::Uint::gather(&table.kinds, id + id);
        // Weights (1 - u - v, u, v) of (0, 0), (1, 0), (1, 1).
        let mut out = [u + v, v];
        let given = kind.eq(splat(VERTICES));
        if given.any() {
            let offset = F::Uint::gather(&table.kinds, id + id + splat(1));
            // Lanes without read the first of the lanes with.
            let lane = given.bits().trailing_zeros() as usize & 15;
            let triangle = F::Uint::select(given, primitive, splat(primitive.to_array()[lane]));
            let offset = F::Uint::select(given, offset, splat(offset.to_array()[lane]));
            let first = triangle * splat(3);
            let corners = geometry.corner_numbers();
            let [a, b, c] = map3!([0, 1, 2], |k| {
                let uv = (F::Uint::gather(corners, first + splat(k)) + offset).shl::<1>();
                let uvs = table.uvs.as_flattened();
                [F::gather(uvs, uv), F::gather(uvs, uv + splat(1))]
            });
            let w = F::one() - u - v;
            let mixed =
                [a[0].mul_add(w, b[0].mul_add(u, c[0] * v)), a[1].mul_add(w, b[1].mul_add(u, c[1] * v))];
            out = [F::select(given, mixed[0], out[0]), F::select(given, mixed[1], out[1])];
        }
        if table.round {
            let round = !kind.lt(splat(POLAR));
            if round.any() {
                let first = id.shl::<4>();
                let [x, y, z] = map3!([0, 4, 8], |row| {
                    let number = first + splat(row);
                    let at = [
                        F::gather(&table.numbers, number),
                        F::gather(&table.numbers, number + splat(1)),
                        F::gather(&table.numbers, number + splat(2)),
                        F::gather(&table.numbers, number + splat(3)),
                    ];
                    at[0].mul_add(point.x, at[1].mul_add(point.y, at[2].mul_add(point.z, at[3])))
                });
                let factor = F::gather(&table.numbers, first + splat(12));
                let along = F::gather(&table.numbers, first + splat(13));
                let summand = F::gather(&table.numbers, first + splat(14));
                let u = azimuth_turns(x, y) * factor;
                let polar = kind.eq(splat(POLAR));
                let mut number = F::select(kind.eq(splat(RADIUS)), x.mul_add(x, y * y).sqrt(), z);
                if polar.any() {
                    number = F::select(polar, polar_angle(Vec3::new(x, y, z)), number);
                }
                let v = number.mul_add(along, summand);
                out = [F::select(round, u, out[0]), F::select(round, v, out[1])];
            }
        }
        out
    }
}

/// How point and normal change with u and v.
#[derive(Clone, Copy)]
pub(crate) struct Tangents<F: Real> {
    /// Of the point with u.
    pub u: Vec3<F>,
    /// Of the point with v.
    pub v: Vec3<F>,
    /// Of the shading normal with u.
    pub normal_u: Vec3<F>,
    /// Of the shading normal with v.
    pub normal_v: Vec3<F>,
}

/// The tangents at a point of a primitive. Where coordinates leave none, any two across the normal.
///
/// # Safety
/// Every lane of `primitive` is below `geometry.primitives()`.
#[inline(always)]
pub(crate) unsafe fn tangents<F: Real>(
    geometry: &Geometry,
    primitive: F::Uint,
    surface: &Surface<F>,
) -> Tangents<F> {
    let table = geometry.parametrizations();
    let splat = F::Uint::splat;
    let zero = Vec3::<F>::zero();
    let frame = Frame::from_normal(surface.shading_normal);
    if table.is_empty() {
        return Tangents { u: frame.s, v: frame.t, normal_u: zero, normal_v: zero };
    }
    // SAFETY: as for `coordinates`.
    unsafe {
        let id = F::Uint::gather(&table.of, primitive);
        let kind = F::Uint::gather(&table.kinds, id + id);
        let mut out = Tangents { u: zero, v: zero, normal_u: zero, normal_v: zero };
        let triangles = kind.lt(splat(POLAR));
        if triangles.any() {
            let lane = triangles.bits().trailing_zeros() as usize & 15;
            let triangle = F::Uint::select(triangles, primitive, splat(primitive.to_array()[lane]));
            out = triangle_tangents(geometry, triangle, kind, id, surface);
        }
        if table.round {
            let round = !triangles;
            if round.any() {
                let of = round_tangents(table, kind, id, surface);
                out = Tangents {
                    u: Vec3::select(round, of.u, out.u),
                    v: Vec3::select(round, of.v, out.v),
                    normal_u: Vec3::select(round, of.normal_u, out.normal_u),
                    normal_v: Vec3::select(round, of.normal_v, out.normal_v),
                };
            }
        }
        let there = out.u.cross(out.v).length2().gt(F::zero());
        out.u = Vec3::select(there, out.u, frame.s);
        out.v = Vec3::select(there, out.v, frame.t);
        out
    }
}

/// (x a - y b) s.
#[inline(always)]
fn difference<F: Real>(x: Vec3<F>, a: F, y: Vec3<F>, b: F, s: F) -> Vec3<F> {
    (x.scale(a) - y.scale(b)).scale(s)
}

/// A vector of object space in the world, by the columns of the map over `volume`.
#[inline(always)]
fn to_world<F: Real>([x, y, z]: [Vec3<F>; 3], volume: F, v: Vec3<F>) -> Vec3<F> {
    (x.scale(v.x) + y.scale(v.y) + z.scale(v.z)).scale(volume)
}

/// # Safety
/// Every lane of `triangle` is a triangle, of the kind [`VERTICES`] only if it has coordinates.
#[inline(always)]
unsafe fn triangle_tangents<F: Real>(
    geometry: &Geometry,
    triangle: F::Uint,
    kind: F::Uint,
    id: F::Uint,
    surface: &Surface<F>,
) -> Tangents<F> {
    let table = geometry.parametrizations();
    let splat = F::Uint::splat;
    let (zero, one) = (F::zero(), F::one());
    let first = triangle * splat(3);
    // SAFETY: the caller's promise; corners exist, and so do their coordinates.
    unsafe {
        let given = kind.eq(splat(VERTICES));
        let offset = F::Uint::gather(&table.kinds, id + id + splat(1));
        let default = [(zero, zero), (one, zero), (one, one)];
        let [a, b, c] = map3!([0usize, 1, 2], |k| {
            let vertex = F::Uint::gather(geometry.corner_numbers(), first + splat(k as u32));
            let number = vertex * splat(3);
            let p = Vec3::new(
                F::gather(geometry.coordinates_of_vertices(), number),
                F::gather(geometry.coordinates_of_vertices(), number + splat(1)),
                F::gather(geometry.coordinates_of_vertices(), number + splat(2)),
            );
            let mut uv = default[k];
            if given.any() {
                let lane = given.bits().trailing_zeros() as usize & 15;
                let mine = vertex + offset;
                let number = F::Uint::select(given, mine, splat(mine.to_array()[lane])).shl::<1>();
                let uvs = table.uvs.as_flattened();
                let own = (F::gather(uvs, number), F::gather(uvs, number + splat(1)));
                uv = (F::select(given, own.0, uv.0), F::select(given, own.1, uv.1));
            }
            (p, uv)
        });
        let (p02, p12) = (a.0 - c.0, b.0 - c.0);
        let (u02, v02) = (a.1.0 - c.1.0, a.1.1 - c.1.1);
        let (u12, v12) = (b.1.0 - c.1.0, b.1.1 - c.1.1);
        let determinant = u02 * v12 - v02 * u12;
        let regular = determinant.abs().gt(F::lit(1e-9));
        let inverse = F::select(regular, determinant.recip(), zero);
        let mut out = Tangents {
            u: difference(p02, v12, p12, v02, inverse),
            v: difference(p12, u02, p02, u12, inverse),
            normal_u: Vec3::zero(),
            normal_v: Vec3::zero(),
        };
        let smooth = triangle.lt(splat(geometry.smooth_triangles() as u32));
        if smooth.any() {
            let triangle = F::Uint::select(smooth, triangle, splat(0)) * splat(3);
            let [n0, n1, n2] = map3!([0u32, 1, 2], |k| {
                let number = F::Uint::gather(geometry.triangle_normals(), triangle + splat(k)) * splat(3);
                Vec3::new(
                    F::gather(geometry.normals(), number),
                    F::gather(geometry.normals(), number + splat(1)),
                    F::gather(geometry.normals(), number + splat(2)),
                )
            });
            // As in pbrt: across the shading normal, v by a right angle from u.
            let n = surface.shading_normal;
            let v = n.cross(out.u);
            let u = v.cross(n);
            out = Tangents {
                u: Vec3::select(smooth, u, out.u),
                v: Vec3::select(smooth, v, out.v),
                normal_u: Vec3::select(smooth, difference(n0 - n2, v12, n1 - n2, v02, inverse), Vec3::zero()),
                normal_v: Vec3::select(smooth, difference(n1 - n2, u02, n0 - n2, u12, inverse), Vec3::zero()),
            };
        }
        out
    }
}

/// # Safety
/// Every lane of `id` is a parametrization.
#[inline(always)]
unsafe fn round_tangents<F: Real>(
    table: &Parametrizations,
    kind: F::Uint,
    id: F::Uint,
    surface: &Surface<F>,
) -> Tangents<F> {
    let splat = F::Uint::splat;
    let first = id.shl::<4>();
    // SAFETY: the caller's promise; a parametrization has `NUMBERS` numbers.
    let (rows, turns_inverse, along_inverse, moved) = unsafe {
        let rows = map3!([0u32, 4, 8], |row| {
            let number = first + splat(row);
            Vec3::new(
                F::gather(&table.numbers, number),
                F::gather(&table.numbers, number + splat(1)),
                F::gather(&table.numbers, number + splat(2)),
            )
        });
        let moved = Vec3::new(
            F::gather(&table.numbers, first + splat(3)),
            F::gather(&table.numbers, first + splat(7)),
            F::gather(&table.numbers, first + splat(11)),
        );
        let number = |k: u32| F::gather(&table.numbers, first + splat(k));
        (rows, number(12), number(13), moved)
    };
    let [a, b, c] = rows;
    let p = surface.point;
    let (x, y, z) = (a.dot(p) + moved.x, b.dot(p) + moved.y, c.dot(p) + moved.z);
    // Columns of the inverse map: products of its rows over their volume.
    let (ax, bx, cx) = (b.cross(c), c.cross(a), a.cross(b));
    let volume = a.dot(ax).recip();
    let columns = [ax, bx, cx];
    let around = F::lit(core::f64::consts::TAU) * turns_inverse.recip();
    let u = to_world(columns, volume, Vec3::new(-(y * around), x * around, F::zero()));
    let across = x.mul_add(x, y * y).sqrt();
    let (cos, sin) = (x / across, y / across);
    let span = along_inverse.recip();
    let polar = kind.eq(splat(POLAR));
    let radius = kind.eq(splat(RADIUS));
    // Along the meridian; outwards; along the axis.
    let meridian = Vec3::new(z * cos, z * sin, -across);
    let spoke = Vec3::new(cos, sin, F::zero());
    let axis = Vec3::new(F::zero(), F::zero(), F::one());
    let v = to_world(
        columns,
        volume,
        Vec3::select(polar, meridian, Vec3::select(radius, spoke, axis)).scale(span),
    );
    // Normals turn as points do, over the radius; not along cylinders, nor on disks.
    let r = F::select(polar, across.mul_add(across, z * z).sqrt(), across);
    let size = to_world(columns, volume, Vec3::new(r * cos, r * sin, F::zero())).length2().sqrt();
    let curvature = size.recip();
    let outwards = to_world(columns, volume, Vec3::new(x, y, F::select(polar, z, F::zero())));
    let curvature = curvature.xor_sign(outwards.dot(surface.normal));
    let bent_u = F::select(radius, F::zero(), curvature);
    let bent_v = F::select(polar, curvature, F::zero());
    Tangents { u, v, normal_u: u.scale(bent_u), normal_v: v.scale(bent_v) }
}
