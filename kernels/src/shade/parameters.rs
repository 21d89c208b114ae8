//! Parameters of materials: what a scene gives, what the table holds, what a lobe is made of.
//!
//! A material's file declares its parameters once, with `parameters!`: name, type, range. From that come
//!
//! - the struct that a scene fills in (say [`Lambert`](super::lambert::Lambert)): each field a [`Parameter`], which is
//!   a constant or a texture;
//! - how it is checked and written to a row of the [`MaterialTable`](super::materials::MaterialTable), as long as the
//!   parameters are;
//! - `Evaluated`, the parameters at a point, a value a lane, and how they are read from the row.
//!
//! Columns have no numbers that anybody writes.

use crate::lanes::{Real, Uint};
use crate::math::Rgb;
use core::fmt;

/// Handle of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// A parameter of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameter<T> {
    /// The same everywhere.
    Constant(T),
    /// What a texture says at the point.
    Texture(TextureId),
}

impl<T: Copy> Parameter<T> {
    /// The value, if it is the same everywhere.
    pub fn constant(self) -> Option<T> {
        match self {
            Parameter::Constant(value) => Some(value),
            Parameter::Texture(_) => None,
        }
    }
}

impl<T> From<T> for Parameter<T> {
    fn from(value: T) -> Self {
        Parameter::Constant(value)
    }
}

impl<T: fmt::Display> fmt::Display for Parameter<T> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Parameter::Constant(value) => value.fmt(f),
            Parameter::Texture(TextureId(id)) => write!(f, "texture {id}"),
        }
    }
}

/// What a parameter can be: a number, or a colour as linear red, green, blue.
pub trait Value: Copy + fmt::Debug {
    /// The value, a lane each.
    type Lanes<F: Real>: Copy;
    /// How many numbers it takes in a row.
    const WIDTH: usize;
    /// Its numbers.
    fn numbers(&self) -> &[f32];
    /// From its numbers, the first of these.
    fn from_numbers(numbers: &[f32]) -> Self;
    /// Reads it from the rows at `at`.
    ///
    /// # Safety
    /// Every lane of `at` is at least [`Value::WIDTH`] below `rows.len()`.
    unsafe fn load<F: Real>(rows: &[f32], at: F::Uint) -> Self::Lanes<F>;
}

impl Value for f32 {
    type Lanes<F: Real> = F;
    const WIDTH: usize = 1;
    fn numbers(&self) -> &[f32] {
        core::slice::from_ref(self)
    }
    #[inline(always)]
    fn from_numbers(numbers: &[f32]) -> Self {
        numbers[0]
    }
    #[inline(always)]
    unsafe fn load<F: Real>(rows: &[f32], at: F::Uint) -> F {
        // SAFETY: the caller's promise.
        unsafe { F::gather(rows, at) }
    }
}

impl Value for [f32; 3] {
    type Lanes<F: Real> = Rgb<F>;
    const WIDTH: usize = 3;
    fn numbers(&self) -> &[f32] {
        self
    }
    #[inline(always)]
    fn from_numbers(numbers: &[f32]) -> Self {
        [numbers[0], numbers[1], numbers[2]]
    }
    #[inline(always)]
    unsafe fn load<F: Real>(rows: &[f32], at: F::Uint) -> Rgb<F> {
        // SAFETY: the caller's promise.
        unsafe {
            Rgb::new(
                F::gather(rows, at),
                F::gather(rows, at + F::Uint::splat(1)),
                F::gather(rows, at + F::Uint::splat(2)),
            )
        }
    }
}

/// Numbers that belong together.
macro_rules! several {
    ($($n:literal)*) => {$(
        impl Value for [f32; $n] {
            type Lanes<F: Real> = [F; $n];
            const WIDTH: usize = $n;
            fn numbers(&self) -> &[f32] {
                self
            }
            #[inline(always)]
            fn from_numbers(numbers: &[f32]) -> Self {
                core::array::from_fn(|k| numbers.get(k).copied().unwrap_or(0.0))
            }
            #[inline(always)]
            unsafe fn load<F: Real>(rows: &[f32], at: F::Uint) -> [F; $n] {
                let mut out = [F::zero(); $n];
                let mut k = 0;
                while k < $n {
                    // SAFETY: the caller's promise.
                    out[k] = unsafe { F::gather(rows, at + F::Uint::splat(k as u32)) };
                    k += 1;
                }
                out
            }
        }
    )*};
}
several!(11 15);

/// Where the numbers of a parameter may lie, ends included. Infinite numbers and those that are none lie nowhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The least.
    pub least: f32,
    /// The largest.
    pub most: f32,
}

/// Shares of light.
pub const UNIT: Range = Range { least: 0.0, most: 1.0 };
/// Anything that is not negative.
pub const NOT_NEGATIVE: Range = Range { least: 0.0, most: f32::MAX };
/// Anything above 0 (that is not denormal).
pub const POSITIVE: Range = Range { least: f32::MIN_POSITIVE, most: f32::MAX };

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match (self.least, self.most) {
            (f32::MIN_POSITIVE, f32::MAX) => write!(f, "above 0"),
            (least, f32::MAX) => write!(f, "at least {least}"),
            (least, most) => write!(f, "from {least} to {most}"),
        }
    }
}

/// A parameter that is not what it may be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadParameter {
    /// Its name.
    pub parameter: &'static str,
    /// What it is.
    pub found: String,
    /// What it may be.
    pub expected: String,
}

impl fmt::Display for BadParameter {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} is {}, expected {}", self.parameter, self.found, self.expected)
    }
}

/// The value of a parameter, if all its numbers are in the range.
pub fn checked<T: Value>(
    name: &'static str,
    parameter: Parameter<T>,
    range: Range,
) -> Result<T, BadParameter> {
    let bad = |found, expected| Err(BadParameter { parameter: name, found, expected });
    match parameter {
        Parameter::Constant(value) => {
            match value.numbers().iter().find(|x| !(range.least..=range.most).contains(x)) {
                None => Ok(value),
                Some(x) => bad(x.to_string(), format!("numbers {range}")),
            }
        }
        // Something in the range, until the stage `texture` writes what is there.
        Parameter::Texture(_) => Ok(T::from_numbers(&[0.5f32.clamp(range.least, range.most); 3])),
    }
}

/// Columns of a row that a texture gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexturedColumns {
    /// Which texture. That it exists is checked by [`Scene::new`](crate::scene::Scene::new).
    pub texture: TextureId,
    /// The first of the columns.
    pub column: u32,
    /// How many: 1 or 3.
    pub width: u32,
    /// What its values are kept to.
    pub range: Range,
}

/// Notes a parameter whose columns begin at `column`, which becomes that behind them.
pub fn note_texture<T: Value>(
    parameter: Parameter<T>,
    column: &mut u32,
    range: Range,
    textured: &mut Vec<TexturedColumns>,
) {
    let width = T::WIDTH as u32;
    if let Parameter::Texture(texture) = parameter {
        textured.push(TexturedColumns { texture, column: *column, width, range });
    }
    *column += width;
}

/// The parameters of a material, as a scene gives them. Implemented by the macro `parameters!`.
pub trait Parameters: Copy + fmt::Debug + PartialEq + Send + Sync + 'static {
    /// The parameters at a point, a value a lane.
    type Evaluated<F: Real>: Copy;
    /// Numbers a row.
    const WIDTH: usize;
    /// Do columns follow from others?
    const DERIVES: bool;
    /// Checks them and appends their row, and what textures give of it to `textured`.
    ///
    /// # Errors
    /// If a parameter is out of its range. Rows and textures are then what they were.
    fn write(&self, rows: &mut Vec<f32>, textured: &mut Vec<TexturedColumns>) -> Result<(), BadParameter>;
    /// Computes the columns of a row that follow from others once more.
    fn derive(row: &mut [f32]);
    /// Reads a row.
    ///
    /// # Safety
    /// At every lane of `row`, `rows` holds a row of this material.
    unsafe fn evaluate<F: Real>(rows: &[f32], row: F::Uint) -> Self::Evaluated<F>;
}

/// Declares the parameters of a material: see the [module](self).
///
/// What a lobe needs and follows from constants alone can be `derived`, once, when the table is built: further columns
/// of the row, which stand beside the parameters in `Evaluated`.
macro_rules! parameters {
    (
        $(#[doc = $doc:literal])*
        $material:ident {
            $($(#[doc = $about:literal])* $name:ident: $type:ty, $range:expr;)*
        }
        $(derived {
            $($(#[doc = $derived_about:literal])* $derived:ident: $derived_type:ty = $value:expr;)*
        })?
    ) => {
        $(#[doc = $doc])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $material {
            $($(#[doc = $about])* pub $name: $crate::shade::parameters::Parameter<$type>,)*
        }

        /// The parameters at a point, a value a lane.
        #[derive(Clone, Copy, Debug)]
        pub struct Evaluated<F: $crate::lanes::Real> {
            $($(#[doc = $about])* pub $name: <$type as $crate::shade::parameters::Value>::Lanes<F>,)*
            $($(
                $(#[doc = $derived_about])*
                pub $derived: <$derived_type as $crate::shade::parameters::Value>::Lanes<F>,
            )*)?
        }

        impl $crate::shade::parameters::Parameters for $material {
            type Evaluated<F: $crate::lanes::Real> = Evaluated<F>;
            const WIDTH: usize = 0
                $(+ <$type as $crate::shade::parameters::Value>::WIDTH)*
                $($(+ <$derived_type as $crate::shade::parameters::Value>::WIDTH)*)?;

            const DERIVES: bool = {
                let derived: &[&str] = &[$($(stringify!($derived)),*)?];
                !derived.is_empty()
            };

            #[allow(unused_assignments, unused_mut, unused_variables)]
            fn write(
                &self,
                rows: &mut Vec<f32>,
                textured: &mut Vec<$crate::shade::parameters::TexturedColumns>,
            ) -> Result<(), $crate::shade::parameters::BadParameter> {
                use $crate::shade::parameters::{Value, checked, note_texture};
                $(let $name: $type = checked(stringify!($name), self.$name, $range)?;)*
                let mut column = 0;
                $(note_texture(self.$name, &mut column, $range, textured);)*
                $(rows.extend($name.numbers());)*
                $($({
                    let derived: $derived_type = $value;
                    rows.extend(derived.numbers());
                })*)?
                Ok(())
            }

            #[allow(unused_assignments, unused_mut, unused_variables)]
            fn derive(row: &mut [f32]) {
                use $crate::shade::parameters::Value;
                let mut next = 0;
                $(
                    let $name = <$type as Value>::from_numbers(&row[next..]);
                    next += <$type as Value>::WIDTH;
                )*
                $($({
                    let derived: $derived_type = $value;
                    let width = <$derived_type as Value>::WIDTH;
                    row[next..next + width].copy_from_slice(derived.numbers());
                    next += width;
                })*)?
            }

            #[inline(always)]
            #[allow(unused_assignments)]
            unsafe fn evaluate<F: $crate::lanes::Real>(rows: &[f32], row: F::Uint) -> Evaluated<F> {
                use $crate::lanes::Uint;
                use $crate::shade::parameters::Value;
                let mut next = 0;
                macro_rules! column {
                    ($column_type:ty) => {{
                        let at = row + F::Uint::splat(next);
                        next += <$column_type as Value>::WIDTH as u32;
                        // SAFETY: the caller's promise; `write` wrote the columns in this order.
                        unsafe { <$column_type as Value>::load::<F>(rows, at) }
                    }};
                }
                // Fields are evaluated in the order in which they stand here.
                Evaluated {
                    $($name: column!($type),)*
                    $($($derived: column!($derived_type),)*)?
                }
            }
        }
    };
}
pub(crate) use parameters;
