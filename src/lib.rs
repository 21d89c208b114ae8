//! wavepath: a data-oriented wavefront path tracer for the CPU.
#![deny(missing_docs)]

pub mod pbrt;
pub mod scene;
