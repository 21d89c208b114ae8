//! The tables that the kernels read: geometry, materials, lights. Flat arrays of `f32` and `u32`, indexed by
//! primitive, material and light; built once, never written while rendering.

mod camera;
mod error;
mod filter;
mod geometry;
pub mod lights;
pub(crate) mod rows;
pub mod shapes;

pub use camera::{Camera, CameraParts, Lens};
pub use error::BuildError;
pub use filter::{Filter, FilterAxis};
pub use geometry::{Geometry, GeometryParts};
pub use rows::NoRow;

use crate::queue::MAX_DEPTH;
use core::sync::atomic::{AtomicU64, Ordering};
use error::{exists, not_negative};

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

/// What a [`Scene`] is made of.
#[derive(Clone, Debug)]
pub struct SceneParts {
    /// Where rays start.
    pub camera: Camera,
    /// Primitives.
    pub geometry: Geometry,
    /// Material parameters.
    pub materials: MaterialTable,
    /// Lights with a place, and emitting surfaces.
    pub lights: lights::LightTable,
    /// Radiance of the sky, the same in all directions.
    pub environment: [f32; 3],
    /// Longest path, in scattering vertices; what is above [`MAX_DEPTH`] counts as that.
    pub max_depth: u32,
}

/// Everything a kernel reads. Whatever refers to something refers to what exists: kernels rely on it.
#[derive(Clone, Debug)]
pub struct Scene {
    parts: SceneParts,
    id: SceneId,
}

/// Tells scenes apart: what is made for one of them, as a plan or a tree, is not for another. Copies of a scene have the
/// same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SceneId(u64);

impl Scene {
    /// Checks that the parts go together.
    ///
    /// # Errors
    /// [`BuildError`] names the first thing that is wrong.
    pub fn new(mut parts: SceneParts) -> Result<Self, BuildError> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let (materials, lights) = (parts.materials.len(), parts.lights.len());
        for (id, &tag) in parts.geometry.tags().iter().enumerate() {
            let tag = PrimitiveTag(tag);
            exists("primitive", id, "material class", tag.class() as usize, MaterialClass::COUNT)?;
            let (what, exist) = if tag.emits() { ("light", lights) } else { ("material", materials) };
            exists("primitive", id, what, (tag.0 & PrimitiveTag::ID_MASK) as usize, exist)?;
        }
        parts.lights.check_materials(materials)?;
        not_negative("sky", 0, "its radiance", &parts.environment)?;
        parts.max_depth = parts.max_depth.min(MAX_DEPTH);
        Ok(Scene { parts, id: SceneId(NEXT.fetch_add(1, Ordering::Relaxed)) })
    }
    /// Tells it from others.
    pub fn id(&self) -> SceneId {
        self.id
    }
    /// Where rays start.
    #[inline(always)]
    pub fn camera(&self) -> &Camera {
        &self.parts.camera
    }
    /// Primitives.
    #[inline(always)]
    pub fn geometry(&self) -> &Geometry {
        &self.parts.geometry
    }
    /// Material parameters.
    #[inline(always)]
    pub fn materials(&self) -> &MaterialTable {
        &self.parts.materials
    }
    /// Lights with a place, and emitting surfaces.
    #[inline(always)]
    pub fn lights(&self) -> &lights::LightTable {
        &self.parts.lights
    }
    /// Radiance of the sky, the same in all directions.
    #[inline(always)]
    pub fn environment(&self) -> [f32; 3] {
        self.parts.environment
    }
    /// Longest path, in scattering vertices.
    #[inline(always)]
    pub fn max_depth(&self) -> u32 {
        self.parts.max_depth
    }
    /// Largest component of any light's radiance or intensity, the sky's included; 0 without lights.
    pub fn brightest(&self) -> f32 {
        self.environment().into_iter().fold(self.lights().brightest(), f32::max)
    }
}
