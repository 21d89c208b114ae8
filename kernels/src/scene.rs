//! The tables that the kernels read: geometry, materials, lights. Flat arrays of `f32` and `u32`, indexed by
//! primitive, material and light; built once, never written while rendering.

use crate::generate::Camera;
pub use crate::shade::materials::{MaterialClass, MaterialHandle, MaterialTable};

/// What a primitive is made of, in 32 bits: class (6 bits), emitting or not (1 bit), and the number of its light if it
/// emits, the row of its material otherwise (25 bits).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrimitiveTag(pub u32);

impl PrimitiveTag {
    /// Bits of the class.
    pub const CLASS_BITS: u32 = 6;
    /// Bits of the light's number or the material's row.
    pub const ID_BITS: u32 = 31 - Self::CLASS_BITS;
    /// Mask of those bits.
    pub const ID_MASK: u32 = (1 << Self::ID_BITS) - 1;
    /// The bit that says "emits".
    pub const EMITS: u32 = 1 << Self::ID_BITS;
    /// Where the class begins.
    pub const CLASS_SHIFT: u32 = Self::ID_BITS + 1;

    /// Of a primitive that only reflects.
    ///
    /// # Panics
    /// If the row does not fit its bits: no [`MaterialTable`] has such a row.
    pub fn material(material: MaterialHandle) -> Self {
        assert!(material.row <= Self::ID_MASK);
        PrimitiveTag((material.class as u32) << Self::CLASS_SHIFT | material.row)
    }
    /// Of a primitive that emits.
    ///
    /// # Panics
    /// If the light's number does not fit its bits.
    pub fn light(class: MaterialClass, light: u32) -> Self {
        assert!(light <= Self::ID_MASK);
        PrimitiveTag((class as u32) << Self::CLASS_SHIFT | Self::EMITS | light)
    }
    /// The class, as a number.
    #[inline(always)]
    pub fn class(self) -> u32 {
        self.0 >> Self::CLASS_SHIFT
    }
    /// Does it emit?
    #[inline(always)]
    pub fn emits(self) -> bool {
        self.0 & Self::EMITS != 0
    }
}

/// No primitive: the ray left the scene.
pub const MISS: u32 = u32::MAX;

/// A clipped or stretched sphere, or a disk: intersected in object space, one at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quadric {
    /// World to object space, three rows of four.
    pub object_from_world: [[f32; 4]; 3],
    /// Origin of object space in the world.
    pub centre: [f32; 3],
    /// Which surface, and how it is clipped.
    pub form: QuadricForm,
    /// Negates the normal.
    pub flip_normal: bool,
}

/// Object-space surfaces. Angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum QuadricForm {
    /// Around the origin; z in `[z_min, z_max]`, azimuth up to `phi_max`.
    Sphere {
        /// Radius.
        radius: f32,
        /// Lowest z.
        z_min: f32,
        /// Highest z.
        z_max: f32,
        /// Largest azimuth.
        phi_max: f32,
    },
    /// In the plane z = `height`; distance from the axis in `[inner_radius, radius]`, azimuth up to `phi_max`.
    Disk {
        /// Height.
        height: f32,
        /// Outer radius.
        radius: f32,
        /// Inner radius.
        inner_radius: f32,
        /// Largest azimuth.
        phi_max: f32,
    },
}

/// All primitives. Their numbers run over triangles, then spheres, then quadrics.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// World-space vertices.
    pub vertices: Vec<[f32; 3]>,
    /// Three vertex numbers a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The first so many triangles have vertex normals.
    pub smooth_triangles: usize,
    /// Vertex normals, three numbers each.
    pub normals: Vec<f32>,
    /// For each of the smooth triangles three places in `normals` (the number of the normal, not of its first float).
    pub triangle_normals: Vec<u32>,
    /// Spheres: centre and radius; a negative radius turns the normal inwards.
    pub spheres: Vec<[f32; 4]>,
    /// Clipped and stretched spheres, disks.
    pub quadrics: Vec<Quadric>,
    /// Four numbers a primitive, whatever it is. Triangle: unit geometric normal and its product with any vertex.
    /// Sphere: centre and signed radius. Quadric: unused.
    pub surfaces: Vec<f32>,
    /// [`PrimitiveTag`] of each primitive.
    pub tags: Vec<u32>,
}

impl Geometry {
    /// How many primitives.
    pub fn primitives(&self) -> usize {
        self.triangles.len() + self.spheres.len() + self.quadrics.len()
    }
    /// Number of the first sphere.
    #[inline(always)]
    pub fn first_sphere(&self) -> u32 {
        self.triangles.len() as u32
    }
    /// Number of the first quadric.
    #[inline(always)]
    pub fn first_quadric(&self) -> u32 {
        (self.triangles.len() + self.spheres.len()) as u32
    }
    /// Corners of a triangle.
    #[inline(always)]
    pub fn corners(&self, triangle: usize) -> [[f32; 3]; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize])
    }
    /// Bytes on the heap, without the tree.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.vertices[..])
            + size_of_val(&self.triangles[..])
            + size_of_val(&self.normals[..])
            + size_of_val(&self.triangle_normals[..])
            + size_of_val(&self.spheres[..])
            + size_of_val(&self.quadrics[..])
            + size_of_val(&self.surfaces[..])
            + size_of_val(&self.tags[..])
    }
}

/// Everything a kernel reads.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Where rays start.
    pub camera: Camera,
    /// Primitives.
    pub geometry: Geometry,
    /// Material parameters.
    pub materials: MaterialTable,
    /// Lights with a place, and emitting surfaces.
    pub lights: crate::light_sample::LightTable,
    /// Radiance of the sky, the same in all directions.
    pub environment: [f32; 3],
    /// Longest path, in scattering vertices.
    pub max_depth: u32,
}

impl Scene {
    /// Largest component of any light's radiance or intensity, the sky's included; 0 without lights.
    pub fn brightest(&self) -> f32 {
        let lights = self.lights.rows.chunks(crate::light_sample::LightTable::STRIDE);
        lights.flat_map(|row| &row[..3]).chain(&self.environment).fold(0.0, |a, &b| a.max(b))
    }
}
