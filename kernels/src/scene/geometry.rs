//! Primitives: triangles, spheres, and the surfaces of [`super::shapes`].

use super::error::{BuildError, exists, finite};
use super::parametrization::{Opacity, Parametrization, Parametrizations};
use super::shapes::Quadric;

/// What a [`Geometry`] is made of. Numbers of primitives run over triangles, then spheres, then quadrics.
#[derive(Clone, Debug, Default)]
pub struct GeometryParts {
    /// World-space vertices.
    pub vertices: Vec<[f32; 3]>,
    /// Three vertex numbers a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle its oriented unit normal, and the product of that with any point of its plane. Rays meet triangles
    /// where their planes are.
    pub planes: Vec<[f32; 4]>,
    /// Vertex normals.
    pub normals: Vec<[f32; 3]>,
    /// Numbers of the three normals of each of the first triangles; those behind them have none.
    pub triangle_normals: Vec<[u32; 3]>,
    /// Spheres: centre and radius; a negative radius turns the normal inwards.
    pub spheres: Vec<[f32; 4]>,
    /// Other surfaces.
    pub quadrics: Vec<Quadric>,
    /// [`PrimitiveTag`](super::PrimitiveTag) of each primitive.
    pub tags: Vec<u32>,
    /// For textures: the number of each primitive's parametrization, or empty.
    pub parametrization_of: Vec<u32>,
    /// Where coordinates of primitives come from.
    pub parametrizations: Vec<Parametrization>,
    /// Coordinates of vertices.
    pub uvs: Vec<[f32; 2]>,
    /// How much is there of what has a parametrization, or empty: everything.
    pub opacities: Vec<Option<Opacity>>,
}

/// All primitives. Their numbers run over triangles, then spheres, then quadrics.
///
/// Whatever refers to something refers to what exists, and all numbers are finite: kernels rely on it. (The tags are
/// checked by [`Scene::new`](super::Scene::new), which knows what they refer to.)
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    parts: GeometryParts,
    /// Four numbers a primitive, whatever it is. Triangle: its plane. Sphere: centre and signed radius. Quadric: unused.
    surfaces: Vec<[f32; 4]>,
    parametrizations: Parametrizations,
}

impl Geometry {
    /// Most primitives.
    pub const MAX_PRIMITIVES: usize = 1 << 27;
    /// Most vertices, and most vertex normals: their coordinates are numbered.
    pub const MAX_VERTICES: usize = u32::MAX as usize / 4;

    /// Checks the parts.
    ///
    /// # Errors
    /// [`BuildError`] names the first thing that is wrong.
    pub fn new(mut parts: GeometryParts) -> Result<Self, BuildError> {
        let limit = |what, found, limit| {
            if found > limit { Err(BuildError::TooMany { what, found, limit }) } else { Ok(()) }
        };
        let length = |of, found, expected| {
            if found != expected { Err(BuildError::Length { of, found, expected }) } else { Ok(()) }
        };
        let GeometryParts {
            vertices,
            triangles,
            planes,
            normals,
            triangle_normals,
            spheres,
            quadrics,
            tags,
            ..
        } = &parts;
        let primitives = triangles.len().saturating_add(spheres.len()).saturating_add(quadrics.len());
        limit("primitives", primitives, Self::MAX_PRIMITIVES)?;
        limit("vertices", vertices.len(), Self::MAX_VERTICES)?;
        limit("vertex normals", normals.len(), Self::MAX_VERTICES)?;
        limit("triangles with vertex normals", triangle_normals.len(), triangles.len())?;
        length("planes of triangles", planes.len(), triangles.len())?;
        length("tags of primitives", tags.len(), primitives)?;
        for (id, vertex) in vertices.iter().enumerate() {
            finite("vertex", id, "a coordinate", vertex)?;
        }
        for (id, normal) in normals.iter().enumerate() {
            finite("vertex normal", id, "a component", normal)?;
        }
        for (id, plane) in planes.iter().enumerate() {
            finite("triangle", id, "a number of its plane", plane)?;
        }
        let check = |what, tables: &[[u32; 3]], exist: usize| {
            // Whole vectors at a time; which one it is does not matter until there is one.
            if tables.as_flattened().iter().all(|&n| (n as usize) < exist) {
                return Ok(());
            }
            tables.iter().enumerate().try_for_each(|(id, corners)| {
                corners.iter().try_for_each(|&n| exists("triangle", id, what, n as usize, exist))
            })
        };
        check("vertex", triangles, vertices.len())?;
        check("vertex normal", triangle_normals, normals.len())?;
        for (id, sphere) in spheres.iter().enumerate() {
            finite("sphere", id, "a coordinate or the radius", sphere)?;
            if sphere[3] == 0.0 {
                let what = "its radius is 0; expected another one".into();
                return Err(BuildError::Number { of: "sphere", id, what });
            }
        }
        let parametrizations = Parametrizations::new(
            core::mem::take(&mut parts.parametrization_of),
            &core::mem::take(&mut parts.parametrizations),
            core::mem::take(&mut parts.uvs),
            core::mem::take(&mut parts.opacities),
            &parts.triangles,
            primitives,
        )?;
        let mut surfaces = core::mem::take(&mut parts.planes);
        surfaces.reserve_exact(primitives - surfaces.len());
        surfaces.extend(&parts.spheres);
        surfaces.resize(primitives, [0.0; 4]);
        Ok(Geometry { parts, surfaces, parametrizations })
    }

    /// World-space vertices.
    pub fn vertices(&self) -> &[[f32; 3]] {
        &self.parts.vertices
    }
    /// Three vertex numbers a triangle.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.parts.triangles
    }
    /// The first so many triangles have vertex normals.
    #[inline(always)]
    pub fn smooth_triangles(&self) -> usize {
        self.parts.triangle_normals.len()
    }
    /// For each of those, the numbers of three normals.
    #[inline(always)]
    pub(crate) fn triangle_normals(&self) -> &[u32] {
        self.parts.triangle_normals.as_flattened()
    }
    /// The same, flat.
    #[inline(always)]
    pub(crate) fn corner_numbers(&self) -> &[u32] {
        self.parts.triangles.as_flattened()
    }
    /// Where coordinates of primitives come from.
    #[inline(always)]
    pub(super) fn parametrizations(&self) -> &Parametrizations {
        &self.parametrizations
    }
    /// World-space vertices, flat.
    #[inline(always)]
    pub(crate) fn coordinates_of_vertices(&self) -> &[f32] {
        self.parts.vertices.as_flattened()
    }
    /// How much is there of what has each parametrization; empty: everything.
    pub fn opacities(&self) -> &[Option<Opacity>] {
        self.parametrizations.opacities()
    }
    /// The parametrization of a primitive, where coordinates are kept.
    #[inline(always)]
    pub(crate) fn parametrization_of(&self, primitive: u32) -> u32 {
        self.parametrizations.number(primitive)
    }
    /// Is a primitive perhaps not everywhere there?
    #[inline(always)]
    pub(crate) fn is_cutout(&self, primitive: u32) -> bool {
        let opacities = self.opacities();
        !opacities.is_empty() && opacities[self.parametrization_of(primitive) as usize].is_some()
    }
    /// Does it keep coordinates for textures?
    pub fn has_coordinates(&self) -> bool {
        !self.parametrizations.is_empty()
    }
    /// Vertex normals, three numbers each.
    #[inline(always)]
    pub(crate) fn normals(&self) -> &[f32] {
        self.parts.normals.as_flattened()
    }
    /// Spheres: centre and radius; a negative radius turns the normal inwards.
    #[inline(always)]
    pub fn spheres(&self) -> &[[f32; 4]] {
        &self.parts.spheres
    }
    /// Other surfaces.
    #[inline(always)]
    pub fn quadrics(&self) -> &[Quadric] {
        &self.parts.quadrics
    }
    /// Four numbers a primitive, whatever it is. Triangle: its plane, oriented unit normal and the product of that with
    /// any of its points. Sphere: centre and signed radius. Quadric: unused.
    #[inline(always)]
    pub fn surfaces(&self) -> &[f32] {
        self.surfaces.as_flattened()
    }
    /// [`PrimitiveTag`](super::PrimitiveTag) of each primitive.
    #[inline(always)]
    pub fn tags(&self) -> &[u32] {
        &self.parts.tags
    }
    /// How many primitives.
    pub fn primitives(&self) -> usize {
        self.surfaces.len()
    }
    /// Number of the first sphere.
    #[inline(always)]
    pub fn first_sphere(&self) -> u32 {
        self.parts.triangles.len() as u32
    }
    /// Number of the first quadric.
    #[inline(always)]
    pub fn first_quadric(&self) -> u32 {
        (self.parts.triangles.len() + self.parts.spheres.len()) as u32
    }
    /// Corners of a triangle.
    ///
    /// # Panics
    /// If there is no such triangle.
    #[inline(always)]
    pub fn corners(&self, triangle: usize) -> [[f32; 3]; 3] {
        self.parts.triangles[triangle].map(|v| self.parts.vertices[v as usize])
    }
    /// Bytes on the heap, without the tree.
    pub fn bytes(&self) -> usize {
        let p = &self.parts;
        size_of_val(&p.vertices[..])
            + size_of_val(&p.triangles[..])
            + size_of_val(&p.normals[..])
            + size_of_val(&p.triangle_normals[..])
            + size_of_val(&p.spheres[..])
            + size_of_val(&p.quadrics[..])
            + size_of_val(&self.surfaces[..])
            + size_of_val(&p.tags[..])
            + self.parametrizations.bytes()
    }
}

#[cfg(test)]
impl Geometry {
    /// Triangles that share no vertices, then spheres: what the tests of the trees are about. Tags are not what they stand
    /// for.
    pub(crate) fn soup(vertices: Vec<[f32; 3]>, spheres: Vec<[f32; 4]>) -> Self {
        let triangles: Vec<_> =
            (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let plane = |corners: &[[f32; 3]]| {
            let [a, b, c] = core::array::from_fn(|k| glam::DVec3::from(corners[k].map(f64::from)));
            let n = (b - a).cross(c - a).try_normalize().unwrap_or(glam::DVec3::Z).as_vec3();
            [n.x, n.y, n.z, n.as_dvec3().dot(a) as f32]
        };
        let planes = vertices.chunks_exact(3).map(plane).collect();
        let tags = vec![0; triangles.len() + spheres.len()];
        let parts = GeometryParts { vertices, triangles, planes, spheres, tags, ..GeometryParts::default() };
        Geometry::new(parts).expect("a soup")
    }
}
