//! The tables that the kernels read: geometry, materials, lights. Flat arrays of `f32` and `u32`, indexed by
//! primitive, material and light; built once, never written while rendering.

mod camera;
mod error;
mod filter;
mod geometry;
pub mod lights;
pub(crate) mod parametrization;
mod picture;
pub(crate) mod rows;
pub mod shapes;

pub use camera::{Camera, CameraParts, Lens, Projection};
pub use error::BuildError;
pub use filter::{Filter, FilterAxis};
pub use geometry::{Geometry, GeometryParts};
pub use parametrization::{Along, Opacity, Parametrization};
pub use picture::{Picture, Texels};
pub use rows::NoRow;

pub use crate::shade::materials::{MaterialClass, MaterialHandle, MaterialTable};

use crate::queue::MAX_DEPTH;
use crate::texture::{Programs, TextureTable};
use core::sync::atomic::{AtomicU64, Ordering};
use error::not_negative;
pub(crate) use error::{exists, finite};

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

/// What a [`Scene`] is made of.
#[derive(Clone, Debug)]
pub struct SceneParts {
    /// Where rays start.
    pub camera: Camera,
    /// Primitives.
    pub geometry: Geometry,
    /// Material parameters.
    pub materials: MaterialTable,
    /// What parameters of materials refer to.
    pub textures: TextureTable,
    /// Lights with a place, and emitting surfaces.
    pub lights: lights::LightTable,
    /// Radiance of the sky, the same in all directions.
    pub environment: [f32; 3],
    /// Longest path, in scattering vertices, at most [`MAX_DEPTH`].
    pub max_depth: u32,
}

/// Everything a kernel reads. Whatever refers to something refers to what exists: kernels rely on it.
#[derive(Clone, Debug)]
pub struct Scene {
    parts: SceneParts,
    programs: Programs,
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
    pub fn new(parts: SceneParts) -> Result<Self, BuildError> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let SceneParts { geometry, materials, lights, .. } = &parts;
        let mut before = None;
        for (id, &tag) in geometry.tags().iter().enumerate() {
            // Most primitives are like the one before.
            if before.replace(tag) == Some(tag) {
                continue;
            }
            let tag = PrimitiveTag(tag);
            let class = tag.class() as usize;
            exists("primitive", id, "material class", class, MaterialClass::COUNT)?;
            let mut row = tag.0 & PrimitiveTag::ID_MASK;
            if tag.emits() {
                exists("primitive", id, "light", row as usize, lights.len())?;
                row = lights.material_of(row as usize);
            }
            if !materials.contains(MaterialHandle { class: MaterialClass::ALL[class], row }) {
                return Err(BuildError::NoMaterial {
                    primitive: id,
                    class: MaterialClass::ALL[class].name(),
                    row,
                });
            }
        }
        not_negative("sky", 0, "its radiance", &parts.environment)?;
        if parts.max_depth > MAX_DEPTH {
            let (found, limit) = (parts.max_depth as usize, MAX_DEPTH as usize);
            return Err(BuildError::TooMany { what: "bounces", found, limit });
        }
        let programs = Programs::new(materials, geometry.opacities(), &parts.textures)?;
        Ok(Scene { parts, programs, id: SceneId(NEXT.fetch_add(1, Ordering::Relaxed)) })
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
    /// What parameters of materials refer to.
    #[inline(always)]
    pub fn textures(&self) -> &TextureTable {
        &self.parts.textures
    }
    /// How the rows of textured materials are made.
    #[inline(always)]
    pub fn programs(&self) -> &Programs {
        &self.programs
    }
    /// The row of the material of a primitive with this tag, which is one of the scene's.
    #[inline(always)]
    pub fn row_of(&self, tag: u32) -> u32 {
        let tag = PrimitiveTag(tag);
        let id = tag.0 & PrimitiveTag::ID_MASK;
        if tag.emits() { self.lights().material_of(id as usize) } else { id }
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
}
