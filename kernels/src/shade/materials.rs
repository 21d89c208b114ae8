//! The materials: one table of them all, from which come the classes by which paths are sorted, their names, what they
//! need, the kernel of each, and the rows that hold their parameters.
//!
//! A material is a file beside this one, which declares its [parameters](super::parameters) and makes its lobes from
//! them ([`Material::bsdf`]), and one row of `materials!` below. Without the row its `impl Material` does not compile; a
//! row without the file does not either. What the engines and the plan ask of a material they ask of its [`Bsdf`], and
//! they name none.

use super::Features;
use super::bsdf::Bsdf;
use super::parameters::{
    BadParameter, Parameter, Parameters, TextureId, TexturedColumns, UNIT, checked, note_texture,
};
use crate::lanes::Real;
use crate::material_sort;
use crate::scene::PrimitiveTag;
use core::fmt;

/// A material: [`Parameters`], and how lobes are made from them.
///
/// It needs a row in the table of materials:
///
/// ```compile_fail,E0277
/// use wavepath_kernels::lanes::Real;
/// use wavepath_kernels::shade::lambert::{DiffuseReflection, Evaluated, Lambert};
/// use wavepath_kernels::shade::materials::Material;
/// use wavepath_kernels::shade::parameters::{BadParameter, Parameters, TexturedColumns};
///
/// #[derive(Clone, Copy, Debug, PartialEq)]
/// struct Forgotten;
/// impl Parameters for Forgotten {
///     type Evaluated<F: Real> = Evaluated<F>;
///     const WIDTH: usize = 3;
///     const DERIVES: bool = false;
///     fn write(&self, _: &mut Vec<f32>, _: &mut Vec<TexturedColumns>) -> Result<(), BadParameter> { Ok(()) }
///     fn derive(_row: &mut [f32]) {}
///     unsafe fn evaluate<F: Real>(rows: &[f32], row: F::Uint) -> Evaluated<F> {
///         // SAFETY: the caller's promise.
///         unsafe { <Lambert as Parameters>::evaluate::<F>(rows, row) }
///     }
/// }
/// impl Material for Forgotten {
///     type Bsdf<F: Real> = DiffuseReflection<F>;
///     fn bsdf<F: Real>(at: Evaluated<F>) -> DiffuseReflection<F> { Lambert::bsdf(at) }
/// }
/// ```
pub trait Material: Parameters + Listed {
    /// The lobes over lanes `F`.
    type Bsdf<F: Real>: Bsdf<F>;
    /// The lobes at a point.
    fn bsdf<F: Real>(at: Self::Evaluated<F>) -> Self::Bsdf<F>;
}

mod sealed {
    /// What the table of materials lists.
    pub trait Row {}
}

/// What the table of materials says of each. The table alone implements it: whoever has a class has its row.
pub trait Listed: sealed::Row + Sized {
    /// Its class.
    const CLASS: MaterialClass;
    /// What its kernel can tell apart of the features `P`: those of specular materials sample no lights.
    type Sees<P: Features>: Features;
}

/// Work that is instantiated for every material.
pub trait ForMaterial {
    /// What it returns.
    type Output;
    /// Does the work for a material.
    fn run<M: Material>(self) -> Self::Output;
}

/// Turns [`Bsdf::SPECULAR`] and [`Bsdf::COMMON`] into the features that [`Listed::Sees`].
#[derive(Clone, Copy, Debug)]
pub struct Sees<const SPECULAR: bool, const COMMON: bool>;
/// See [`Sees`].
pub trait Select {
    /// What is seen of the features `P`.
    type Of<P: Features>: Features;
}
impl<const COMMON: bool> Select for Sees<true, COMMON> {
    type Of<P: Features> = P::Specular;
}
impl Select for Sees<false, true> {
    type Of<P: Features> = P;
}
impl Select for Sees<false, false> {
    type Of<P: Features> = P::General;
}

macro_rules! materials {
    ($($(#[doc = $doc:literal])* $name:ident in $module:ident;)*) => {
        $(pub use super::$module::$name;)*

        /// Class of a primitive's material: the key of `material_sort`, one shade kernel each.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u32)]
        pub enum MaterialClass {
            /// Reflects nothing: the path ends here. It has no kernel.
            Absorber = 0,
            $($(#[doc = $doc])* $name,)*
            /// One of two materials, which stage [`mixture`](crate::mixture) chooses: it has no kernel.
            Mixture,
        }

        impl MaterialClass {
            /// All of them, in order.
            pub const ALL: [MaterialClass; Self::COUNT] =
                [MaterialClass::Absorber, $(MaterialClass::$name,)* MaterialClass::Mixture];
            /// How many classes there are.
            pub const COUNT: usize = 2 + [$(stringify!($name)),*].len();

            /// Name for the plan and for profiles.
            pub const fn name(self) -> &'static str {
                match self {
                    MaterialClass::Absorber => "absorber",
                    MaterialClass::Mixture => "mixture",
                    $(MaterialClass::$name => stringify!($module),)*
                }
            }

            /// Does light sampling find anything there? Not on smooth surfaces.
            pub const fn samples_lights(self) -> bool {
                match self {
                    MaterialClass::Absorber | MaterialClass::Mixture => false,
                    $(MaterialClass::$name => !<<$name as Material>::Bsdf<f32> as Bsdf<f32>>::SPECULAR,)*
                }
            }

            /// Is the radiance of light that passes through scaled by the squared index of refraction?
            pub const fn scales_radiance(self) -> bool {
                match self {
                    MaterialClass::Absorber | MaterialClass::Mixture => false,
                    $(MaterialClass::$name => <<$name as Material>::Bsdf<f32> as Bsdf<f32>>::SCALES_RADIANCE,)*
                }
            }

            /// Numbers of a row.
            pub const fn width(self) -> usize {
                match self {
                    MaterialClass::Absorber => 0,
                    MaterialClass::Mixture => MIXTURE,
                    $(MaterialClass::$name => <$name as Parameters>::WIDTH,)*
                }
            }

            /// What computes the columns of a row that follow from others, if some do.
            pub fn derive(self) -> Option<fn(&mut [f32])> {
                match self {
                    MaterialClass::Absorber => None,
                    $(MaterialClass::$name if <$name as Parameters>::DERIVES => {
                        Some(<$name as Parameters>::derive)
                    })*
                    _ => None,
                }
            }

            /// Does the work for the material of this class; none for classes without a kernel.
            #[inline(always)]
            pub fn with<W: ForMaterial>(self, work: W) -> Option<W::Output> {
                match self {
                    MaterialClass::Absorber | MaterialClass::Mixture => None,
                    $(MaterialClass::$name => Some(work.run::<$name>()),)*
                }
            }
        }

        $(impl sealed::Row for $name {}
        impl Listed for $name {
            const CLASS: MaterialClass = MaterialClass::$name;
            type Sees<P: Features> =
                <Sees<
                    { <<$name as Material>::Bsdf<f32> as Bsdf<f32>>::SPECULAR },
                    { <<$name as Material>::Bsdf<f32> as Bsdf<f32>>::COMMON },
                > as Select>::Of<P>;
        })*
    };
}

materials! {
    /// Ideal diffuse reflection.
    Lambert in lambert;
    /// Diffuse reflection of rough surfaces.
    OrenNayar in oren_nayar;
    /// Smooth conductor.
    Conductor in conductor;
    /// Ideal mirror.
    Mirror in mirror;
    /// GGX conductor.
    RoughConductor in rough_conductor;
    /// Smooth dielectric.
    Dielectric in dielectric;
    /// Thin pane of a smooth dielectric.
    ThinDielectric in thin_dielectric;
    /// Diffuse reflection and transmission.
    DiffuseTransmission in diffuse_transmission;
    /// GGX conductor that is rougher along one tangent.
    AnisotropicConductor in anisotropic_conductor;
    /// Rough dielectric.
    RoughDielectric in rough_dielectric;
    /// Diffuse base under a coat.
    Coated in coated;
    /// Conductor under a coat.
    CoatedConductor in coated_conductor;
    /// Diffuse, glossy and specular reflection and transmission at once.
    Uber in uber;
}

const _: () = {
    let mut class = 0;
    while class < MaterialClass::COUNT {
        assert!(
            MaterialClass::ALL[class].width() <= crate::texture::WIDEST,
            "rows must fit the megakernel's"
        );
        class += 1;
    }
};
const _: () = assert!(MaterialClass::COUNT <= 1 << PrimitiveTag::CLASS_BITS, "classes must fit the tag");
const _: () = assert!(material_sort::LISTS <= material_sort::EMITS as usize, "lists must fit the sort's key");

impl MaterialClass {
    /// The classes that scatter light: those with a kernel.
    pub fn scattering() -> impl Iterator<Item = MaterialClass> {
        let without = [MaterialClass::Absorber, MaterialClass::Mixture];
        Self::ALL.into_iter().filter(move |class| !without.contains(class))
    }
}

/// Where a material is: what a [`PrimitiveTag`] or a light holds of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaterialHandle {
    /// Its class.
    pub class: MaterialClass,
    /// Place of its row in the table.
    pub row: u32,
}

impl MaterialHandle {
    /// What reflects nothing: it has no row.
    pub const ABSORBER: MaterialHandle = MaterialHandle { class: MaterialClass::Absorber, row: 0 };
}

/// Why a material is not taken into the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MaterialError {
    /// A parameter is not what it may be.
    Parameter {
        /// Name of the material's class.
        material: &'static str,
        /// Which, and why.
        problem: BadParameter,
    },
    /// There are more numbers than a [`PrimitiveTag`] can tell apart.
    Full,
}

impl fmt::Display for MaterialError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            MaterialError::Parameter { material, problem } => write!(f, "{material}: {problem}"),
            MaterialError::Full => write!(
                f,
                "the parameters of all materials together are more than {} numbers",
                MaterialTable::MAX_NUMBERS
            ),
        }
    }
}

impl core::error::Error for MaterialError {}

/// Parameters of all materials of a scene, a row each, as long as its class has it. Rows are known by the place of
/// their first number.
#[derive(Clone, Debug, Default)]
pub struct MaterialTable {
    rows: Vec<f32>,
    /// Class and place of each row, in order of place.
    materials: Vec<MaterialHandle>,
    /// What textures give of the rows.
    textured: Vec<TexturedColumns>,
    /// For each material, how many of those it and the ones before it have.
    textured_to: Vec<u32>,
    /// What turns the normals of some of the materials.
    reliefs: Vec<(MaterialHandle, Relief)>,
    /// Is one of them a mixture?
    mixes: bool,
}

/// What turns the normals of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Relief {
    /// It is moved along its normal by a texture.
    Displacement(TextureId),
    /// Normals in the frame of the tangents, each coordinate c as (c + 1) / 2.
    NormalMap(TextureId),
}

impl Relief {
    /// The texture.
    pub fn texture(self) -> TextureId {
        let (Relief::Displacement(id) | Relief::NormalMap(id)) = self;
        id
    }
}

/// Numbers in the row of a mixture: the tags of its two materials, as bits, and the share of the second.
const MIXTURE: usize = 5;
/// Where the share stands.
pub(crate) const AMOUNT: usize = 2;

impl MaterialTable {
    /// Most numbers in all rows together.
    pub const MAX_NUMBERS: usize = 1 << PrimitiveTag::ID_BITS;

    /// Adds a material.
    ///
    /// # Errors
    /// [`MaterialError`] names the parameter that is not what it may be.
    pub fn add<M: Material>(&mut self, material: &M) -> Result<MaterialHandle, MaterialError> {
        let row = self.rows.len();
        // Rows without numbers would be in the same place.
        if row + M::WIDTH.max(1) > Self::MAX_NUMBERS {
            return Err(MaterialError::Full);
        }
        material
            .write(&mut self.rows, &mut self.textured)
            .map_err(|problem| MaterialError::Parameter { material: M::CLASS.name(), problem })?;
        assert_eq!(self.rows.len(), row + M::WIDTH, "a row is as long as its material says");
        if M::WIDTH == 0 {
            self.rows.push(0.0);
        }
        let handle = MaterialHandle { class: M::CLASS, row: row as u32 };
        self.materials.push(handle);
        self.textured_to.push(self.textured.len() as u32);
        Ok(handle)
    }

    /// Adds a mixture of two materials that the table has; `amount` is the share of the second.
    ///
    /// # Errors
    /// [`MaterialError`] if the share is not from 0 to 1.
    ///
    /// # Panics
    /// If the table does not have the materials.
    pub fn add_mixture(
        &mut self,
        parts: [MaterialHandle; 2],
        amount: Parameter<[f32; 3]>,
    ) -> Result<MaterialHandle, MaterialError> {
        assert!(parts.into_iter().all(|part| self.contains(part)), "materials of another table");
        let row = self.rows.len();
        if row + MIXTURE > Self::MAX_NUMBERS {
            return Err(MaterialError::Full);
        }
        let class = MaterialClass::Mixture;
        let value = checked("amount", amount, UNIT)
            .map_err(|problem| MaterialError::Parameter { material: class.name(), problem })?;
        self.rows.extend(parts.map(|part| f32::from_bits(PrimitiveTag::material(part).0)));
        self.rows.extend(value);
        note_texture(amount, &mut (AMOUNT as u32), UNIT, &mut self.textured);
        self.textured_to.push(self.textured.len() as u32);
        let handle = MaterialHandle { class, row: row as u32 };
        self.materials.push(handle);
        self.mixes = true;
        Ok(handle)
    }

    /// Is there a mixture?
    #[inline(always)]
    pub fn has_mixtures(&self) -> bool {
        self.mixes
    }

    /// The tags of the two materials of the mixture in this row.
    ///
    /// # Panics
    /// If there is no such row.
    fn parts(&self, row: u32) -> [PrimitiveTag; 2] {
        let row = row as usize;
        [self.rows[row], self.rows[row + 1]].map(|bits| PrimitiveTag(bits.to_bits()))
    }

    /// The classes, each as often as it occurs, that a material can turn out to be: its own, but for mixtures.
    pub fn classes(&self, material: MaterialHandle) -> Vec<MaterialClass> {
        if material.class != MaterialClass::Mixture {
            return vec![material.class];
        }
        let handle = |tag: PrimitiveTag| MaterialHandle {
            class: MaterialClass::ALL[tag.class() as usize],
            row: tag.0 & PrimitiveTag::ID_MASK,
        };
        self.parts(material.row).into_iter().flat_map(|part| self.classes(handle(part))).collect()
    }

    /// Chooses among the materials of the mixture in this row by a uniform number, and among those of the one chosen, as
    /// long as it is a mixture: the tag of the material, and what its light is multiplied by.
    ///
    /// A material is chosen by the mean of its share over the channels; `amount` says what the share of the second material
    /// of a row is, if it knows better than the row.
    ///
    /// # Panics
    /// If there is no such row.
    #[inline(always)]
    pub fn choose(
        &self,
        row: u32,
        mut u: f32,
        mut amount: impl FnMut(u32) -> Option<[f32; 3]>,
    ) -> (PrimitiveTag, [f32; 3]) {
        let (mut row, mut weight) = (row as usize, [1.0f32; 3]);
        loop {
            let own = [self.rows[row + AMOUNT], self.rows[row + AMOUNT + 1], self.rows[row + AMOUNT + 2]];
            let amount = amount(row as u32).unwrap_or(own);
            // Plain arithmetic of one number: the same bits on every instruction set.
            let second = (amount[0] + amount[1] + amount[2]) / 3.0;
            let grey = amount[0] == amount[1] && amount[1] == amount[2];
            let second = if grey { amount[0] } else { second };
            let part = (u < second) as usize;
            for (weight, amount) in weight.iter_mut().zip(amount) {
                if !grey {
                    *weight *= if part == 1 { amount / second } else { (1.0 - amount) / (1.0 - second) };
                }
            }
            u = if part == 1 { u / second } else { (u - second) / (1.0 - second) };
            let tag = PrimitiveTag(self.rows[row + part].to_bits());
            if tag.class() != MaterialClass::Mixture as u32 {
                return (tag, weight);
            }
            row = (tag.0 & PrimitiveTag::ID_MASK) as usize;
        }
    }

    /// Is there such a material?
    pub fn contains(&self, handle: MaterialHandle) -> bool {
        handle.class == MaterialClass::Absorber
            || self
                .materials
                .binary_search_by_key(&handle.row, |material| material.row)
                .is_ok_and(|at| self.materials[at].class == handle.class)
    }

    /// Turns the normals of a material.
    pub fn set_relief(&mut self, material: MaterialHandle, relief: Relief) {
        self.reliefs.retain(|(other, _)| *other != material);
        // What absorbs everything has no row, and no use for it.
        if material.class != MaterialClass::Absorber {
            self.reliefs.push((material, relief));
        }
    }
    /// What turns the normals of some of the materials.
    pub fn reliefs(&self) -> &[(MaterialHandle, Relief)] {
        &self.reliefs
    }
    /// All materials, and what textures give of each.
    pub fn textured(&self) -> impl Iterator<Item = (MaterialHandle, &[TexturedColumns])> {
        let starts = core::iter::once(&0).chain(&self.textured_to);
        let ranges = starts.zip(&self.textured_to).map(|(&start, &end)| start as usize..end as usize);
        self.materials.iter().zip(ranges).map(|(handle, range)| (*handle, &self.textured[range]))
    }
    /// Numbers of all rows.
    pub fn numbers(&self) -> usize {
        self.rows.len()
    }
    /// The rows.
    #[inline(always)]
    pub(crate) fn rows(&self) -> &[f32] {
        &self.rows
    }

    /// How many materials.
    pub fn len(&self) -> usize {
        self.materials.len()
    }
    /// No materials?
    pub fn is_empty(&self) -> bool {
        self.materials.is_empty()
    }
    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.rows[..])
            + size_of_val(&self.materials[..])
            + size_of_val(&self.textured[..])
            + size_of_val(&self.textured_to[..])
    }

    /// The parameters of a material at a point: the one way by which kernels come to them.
    ///
    /// # Safety
    /// At every lane of `row` there is a material `M` in the table ([`MaterialTable::contains`]).
    #[inline(always)]
    pub unsafe fn evaluate<M: Material, F: Real>(&self, row: F::Uint) -> M::Evaluated<F> {
        // SAFETY: the caller's promise; only `add` writes rows.
        unsafe { M::evaluate::<F>(&self.rows, row) }
    }
}
