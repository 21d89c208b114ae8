//! How far the first surface is: along the viewing axis, not along the ray, as compositing programs take a channel `Z`, and
//! as pbrt's `P.Z` in camera space is. Of a plane that faces the camera, all depths are the same.
//!
//! z = t (d . a), with the distance t along the unit direction d, and the axis a. A pixel has the mean over those of its
//! samples that hit something, and 0 if none does.

use super::{Divisor, FirstHit, Kind, MOST_COMPONENTS, Row, Values};
use crate::lanes::Real;

pub(super) const ROW: Row = Row {
    name: "depth",
    components: &["Z"],
    kind: Kind::Sum { signed: true },
    divisor: Divisor::Coverage,
    replicated: false,
    holds: "distance of the first surface along the viewing axis, mean over what is hit; 0 where nothing is",
};

#[inline(always)]
pub(super) fn fill<F: Real>(first: &FirstHit<F>) -> Values<F> {
    let mut values = [F::zero(); MOST_COMPONENTS];
    values[0] = first.t * first.direction.dot(first.axis);
    values
}
