//! Rows of numbers with named columns: a struct as it is written, and the same columns as a kernel reads them, one row
//! a lane.

use crate::lanes::{Real, Uint};
use crate::math::Vec3;
use bytemuck::Pod;

/// What stands in a row: one number, or three that belong together.
pub trait Cell: Pod {
    /// The same for a vector of rows.
    type Lanes<F: Real>;
    /// Reads it, where `first` is the place of its first number.
    ///
    /// # Safety
    /// All its numbers exist in every lane.
    unsafe fn gather<F: Real>(numbers: &[f32], first: F::Uint) -> Self::Lanes<F>;
}

impl Cell for f32 {
    type Lanes<F: Real> = F;
    #[inline(always)]
    unsafe fn gather<F: Real>(numbers: &[f32], first: F::Uint) -> F {
        // SAFETY: the caller's promise.
        unsafe { F::gather(numbers, first) }
    }
}

impl Cell for [f32; 3] {
    type Lanes<F: Real> = Vec3<F>;
    #[inline(always)]
    unsafe fn gather<F: Real>(numbers: &[f32], first: F::Uint) -> Vec3<F> {
        // SAFETY: the caller's promise.
        unsafe {
            Vec3::new(
                F::gather(numbers, first),
                F::gather(numbers, first + F::Uint::splat(1)),
                F::gather(numbers, first + F::Uint::splat(2)),
            )
        }
    }
}

/// A struct of numbers that is a row of a table.
pub trait Row: Copy {
    /// How many numbers.
    const LEN: usize;
    /// The columns as kernels read them.
    type Lanes<'a, F: Real>;
    /// The numbers, in the order of the columns.
    fn numbers(&self) -> &[f32];
    /// Rows that begin at the places `first`.
    ///
    /// # Safety
    /// [`Row::LEN`] numbers exist from there on, in every lane.
    unsafe fn lanes<F: Real>(numbers: &[f32], first: F::Uint) -> Self::Lanes<'_, F>;
}

/// A row without columns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoRow;

impl Row for NoRow {
    const LEN: usize = 0;
    type Lanes<'a, F: Real> = ();
    fn numbers(&self) -> &[f32] {
        &[]
    }
    #[inline(always)]
    unsafe fn lanes<F: Real>(_: &[f32], _: F::Uint) {}
}

/// Declares a row, `NAME`, and what kernels read of it, `LANES`.
macro_rules! row {
    ($(#[doc = $doc:literal])* $name:ident $lanes:ident { $($(#[doc = $column_doc:literal])* $column:ident: $type:ty,)* }) => {
        $(#[doc = $doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        pub struct $name {
            $($(#[doc = $column_doc])* pub $column: $type,)*
        }

        #[doc = concat!("Columns of [`", stringify!($name), "`], a row a lane.")]
        #[derive(Clone, Copy)]
        pub struct $lanes<'a, F: $crate::lanes::Real> {
            numbers: &'a [f32],
            first: F::Uint,
        }

        #[allow(dead_code, reason = "not every column is read by every kernel")]
        impl<F: $crate::lanes::Real> $lanes<'_, F> {
            $(
                $(#[doc = $column_doc])*
                #[inline(always)]
                pub fn $column(&self) -> <$type as $crate::scene::rows::Cell>::Lanes<F> {
                    use $crate::lanes::Uint;
                    let column = (core::mem::offset_of!($name, $column) / size_of::<f32>()) as u32;
                    // SAFETY: rows are complete by the promise made to `Row::lanes`.
                    unsafe {
                        <$type as $crate::scene::rows::Cell>::gather::<F>(
                            self.numbers,
                            self.first + F::Uint::splat(column),
                        )
                    }
                }
            )*
        }

        impl $crate::scene::rows::Row for $name {
            const LEN: usize = size_of::<$name>() / size_of::<f32>();
            type Lanes<'a, F: $crate::lanes::Real> = $lanes<'a, F>;
            fn numbers(&self) -> &[f32] {
                bytemuck::cast_slice(core::slice::from_ref(self))
            }
            #[inline(always)]
            unsafe fn lanes<F: $crate::lanes::Real>(numbers: &[f32], first: F::Uint) -> $lanes<'_, F> {
                $lanes { numbers, first }
            }
        }
    };
}
pub(crate) use row;
