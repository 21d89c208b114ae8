//! Queues, batch kernels and physics of the wavepath path tracer.
//!
//! No files, no scene format, no printing: tables in, numbers out.
//!
//! | module | what it holds |
//! |---|---|
//! | [`lanes`], [`isa`] | number types of 1 to 16 lanes, and the choice of instruction set at run time |
//! | [`math`], [`sampler`] | vectors, frames, random numbers |
//! | [`scene`] | the tables that kernels read, made by constructors that check them; kinds of lights and shapes |
//! | [`queue`] | the queues that kernels read and write |
//! | [`channels`] | what a film holds of each pixel, and what fills it at a first hit |
//! | [`generate`] | stage: camera rays |
//! | [`intersect`] | stage: closest hits |
//! | [`cutout`] | surfaces that are not everywhere there |
//! | [`material_sort`] | stage: index lists by material |
//! | [`mod@shade`] | stage: one kernel a material; light that paths find by themselves |
//! | [`mod@texture`] | stage: parameters of materials that are not the same everywhere |
//! | [`light_sample`] | stage: rays towards lights |
//! | [`roulette_compact`] | stage: Russian roulette, compaction |
//!
//! A stage's physics is generic over the lane type: the wavefront runs it 8 or 16 paths wide, the megakernel one at a
//! time, tests in double precision. There is no second copy of a formula.
#![deny(missing_docs)]
// Kernels name their columns one by one.
#![allow(clippy::too_many_arguments)]

pub mod channels;
pub mod cutout;
pub mod generate;
mod huge;
pub mod intersect;
pub mod isa;
pub mod lanes;
pub mod light_sample;
pub mod material_sort;
pub mod math;
pub mod mixture;
pub mod queue;
pub mod roulette_compact;
pub mod sampler;
pub mod scene;
pub mod shade;
pub mod sphere_maps;
pub mod texture;
