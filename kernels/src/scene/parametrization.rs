//! Coordinates on surfaces, (u, v): for textures. Scenes without them have none of it.

use super::error::{BuildError, exists, finite};
use super::geometry::Geometry;
use crate::lanes::{Mask, Real, Uint, map3};
use crate::math::Vec3;
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
        Ok(Parametrizations { of, numbers, kinds, uvs, round })
    }

    /// Bytes on the heap.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.of[..])
            + size_of_val(&self.numbers[..])
            + size_of_val(&self.kinds[..])
            + size_of_val(&self.uvs[..])
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
            let mixed = [
                a[0].mul_add(w, b[0].mul_add(u, c[0] * v)),
                a[1].mul_add(w, b[1].mul_add(u, c[1] * v)),
            ];
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
