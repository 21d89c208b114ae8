//! What every material offers: sample, eval, pdf, in the frame of its shading normal.

use crate::lanes::Real;
use crate::math::Vec3;
use crate::scene::MaterialTable;

/// Parameters of one material a lane.
#[derive(Clone, Copy)]
pub struct MaterialRow<'a, F: Real> {
    table: &'a MaterialTable,
    first: F::Uint,
}

impl<'a, F: Real> MaterialRow<'a, F> {
    /// The row of material `id`.
    ///
    /// # Safety
    /// Every lane of `id` is below `table.len()`.
    #[inline(always)]
    pub unsafe fn new(table: &'a MaterialTable, id: F::Uint) -> Self {
        use crate::lanes::Uint;
        MaterialRow { table, first: id * F::Uint::splat(MaterialTable::STRIDE as u32) }
    }
    /// One number.
    #[inline(always)]
    pub fn get(&self, column: u32) -> F {
        use crate::lanes::Uint;
        debug_assert!((column as usize) < MaterialTable::STRIDE);
        // SAFETY: the table has STRIDE numbers for each material, which exists by the promise made to `new`.
        unsafe { F::gather(&self.table.rows, self.first + F::Uint::splat(column)) }
    }
    /// Three numbers.
    #[inline(always)]
    pub fn vector(&self, column: u32) -> Vec3<F> {
        Vec3::new(self.get(column), self.get(column + 1), self.get(column + 2))
    }
}

/// A sampled direction.
#[derive(Clone, Copy)]
pub struct BsdfSample<F: Real> {
    /// Incident direction (towards the light), unit, in the frame of the shading normal.
    pub wi: Vec3<F>,
    /// f |cos| / pdf; for a specular lobe its reflectance over the probability of choosing it.
    pub weight: Vec3<F>,
    /// Density over solid angle; 0 says specular: no other strategy finds this direction.
    pub pdf: F,
    /// What the sample does to the radiance scaling of the path: the squared relative index where it refracts, 1
    /// elsewhere (see `roulette_compact`).
    pub eta_scale: F,
    /// Lanes in which there is such a direction. Others end the path.
    pub valid: F::Mask,
}

/// A material at a point. Directions are unit, away from the surface, in the frame of the shading normal; `wo` is on
/// the side of +z for materials that do not transmit (the frame is turned), on either side for those that do.
pub trait Bsdf<F: Real>: Copy {
    /// Are all lobes specular? Then lights are not sampled and [`Bsdf::eval`] is not called.
    const SPECULAR: bool;
    /// Does light pass through?
    const TRANSMITS: bool;
    /// Reads the parameters.
    fn load(row: MaterialRow<F>) -> Self;
    /// Samples an incident direction with `u` uniform in the unit square.
    fn sample(&self, wo: Vec3<F>, u: [F; 2]) -> BsdfSample<F>;
    /// f(wo, wi) |cos wi| for radiance.
    fn eval(&self, wo: Vec3<F>, wi: Vec3<F>) -> Vec3<F>;
    /// Density over solid angle with which [`Bsdf::sample`] takes `wi`.
    fn pdf(&self, wo: Vec3<F>, wi: Vec3<F>) -> F;
}
