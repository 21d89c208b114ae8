//! The tables that the kernels read: geometry, materials, lights. Flat arrays of `f32` and `u32`, indexed by
//! primitive, material and light; built once, never written while rendering.

use crate::generate::Camera;

/// Class of a primitive's material: the key of `material_sort`, one shade kernel each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum MaterialClass {
    /// Reflects nothing: the path ends here.
    Absorber = 0,
    /// Lambert.
    Lambert = 1,
    /// Oren-Nayar.
    OrenNayar = 2,
    /// Smooth conductor.
    Conductor = 3,
    /// GGX conductor.
    RoughConductor = 4,
    /// Smooth dielectric.
    Dielectric = 5,
    /// Thin pane of a smooth dielectric.
    ThinDielectric = 6,
}

impl MaterialClass {
    /// How many classes there are.
    pub const COUNT: usize = 7;
    /// All of them, in order.
    pub const ALL: [MaterialClass; Self::COUNT] = [
        MaterialClass::Absorber,
        MaterialClass::Lambert,
        MaterialClass::OrenNayar,
        MaterialClass::Conductor,
        MaterialClass::RoughConductor,
        MaterialClass::Dielectric,
        MaterialClass::ThinDielectric,
    ];

    /// Name for the plan and for profiles.
    pub fn name(self) -> &'static str {
        match self {
            MaterialClass::Absorber => "absorber",
            MaterialClass::Lambert => "lambert",
            MaterialClass::OrenNayar => "oren_nayar",
            MaterialClass::Conductor => "conductor",
            MaterialClass::RoughConductor => "rough_conductor",
            MaterialClass::Dielectric => "dielectric",
            MaterialClass::ThinDielectric => "thin_dielectric",
        }
    }

    /// Does light sampling find anything there? Not on smooth surfaces.
    pub fn samples_lights(self) -> bool {
        matches!(self, MaterialClass::Lambert | MaterialClass::OrenNayar | MaterialClass::RoughConductor)
    }

    /// Does light pass through, so that its radiance is scaled by the squared index of refraction?
    pub fn transmits(self) -> bool {
        self == MaterialClass::Dielectric
    }
}

/// What a primitive is made of, in 32 bits: class (4 bits), emitting or not (1 bit), and the number of its light if
/// it emits, of its material otherwise (27 bits).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrimitiveTag(pub u32);

impl PrimitiveTag {
    /// Bits of the material's or the light's number.
    pub const ID_BITS: u32 = 27;
    /// Mask of those bits.
    pub const ID_MASK: u32 = (1 << Self::ID_BITS) - 1;
    /// The bit that says "emits".
    pub const EMITS: u32 = 1 << Self::ID_BITS;
    /// Where the class begins.
    pub const CLASS_SHIFT: u32 = Self::ID_BITS + 1;

    /// Of a primitive that only reflects.
    pub fn material(class: MaterialClass, material: u32) -> Self {
        assert!(material <= Self::ID_MASK);
        PrimitiveTag((class as u32) << Self::CLASS_SHIFT | material)
    }
    /// Of a primitive that emits.
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

/// Material parameters, [`MaterialTable::STRIDE`] numbers a material; each shade kernel names its own.
#[derive(Clone, Debug, Default)]
pub struct MaterialTable {
    /// The numbers.
    pub rows: Vec<f32>,
}

impl MaterialTable {
    /// Numbers a material.
    pub const STRIDE: usize = 8;

    /// Adds a material and returns its number.
    pub fn push(&mut self, row: [f32; Self::STRIDE]) -> u32 {
        let id = self.rows.len() / Self::STRIDE;
        self.rows.extend(row);
        id as u32
    }
    /// How many materials.
    pub fn len(&self) -> usize {
        self.rows.len() / Self::STRIDE
    }
    /// No materials?
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
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
