//! wavepath: a data-oriented wavefront path tracer for the CPU.
#![deny(missing_docs)]

pub mod atomic_file;
pub mod cli;
mod colour_map;
pub mod compare;
mod contain_panics;
pub mod engine;
pub mod film;
pub mod interrupt;
pub mod machine;
pub mod meshes;
pub mod picture;
pub mod plan;
pub mod progress;
pub mod report;
pub mod scene;
