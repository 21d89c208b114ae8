//! wavepath: a data-oriented wavefront path tracer for the CPU.
//!
//! | module | what it does |
//! |---|---|
//! | [`pbrt`] | reads scenes in pbrt's format |
//! | [`scene`] | describes a scene apart from any format, and turns it into the tables of the kernels |
//! | [`plan`] | decides once what the scene needs |
//! | [`engine`] | executes paths: the wavefront, and the naive megakernel |
//! | [`film`] | sums samples exactly, in any order |
//! | [`film_file`] | films as files: checkpoints, parts, and what is merged from them |
//! | [`picture`], [`report`], [`compare`] | image files, the record of a render, error measures |
//! | [`converge`] | error against run time of several variants: figures, plots, a page |
//! | [`mod@bench`] | measures engines against each other |
//! | [`check`] | what in a scene is numerically dangerous, or probably a mistake |
//! | [`stability`] | stiff and extreme cases with known answers |
//! | [`tev`] | shows a render in a viewer while it goes on |
//! | [`meshes`] | makes meshes by procedure |
//! | [`memory`] | how much there is, and an orderly end where it runs out |
//! | `mpi` | a render by several processes, behind the feature of that name |
//! | `cli` | the command, behind the feature of that name |
//!
//! The engines, their film and their plan are the crate `wavepath-engine`; queues, kernels and physics are the crate
//! `wavepath-kernels`.
#![deny(missing_docs)]

pub mod atomic_file;
pub mod bench;
pub mod check;
#[cfg(feature = "cli")]
pub mod cli;
mod colour_map;
pub mod compare;
mod contain_panics;
pub mod converge;
pub mod film_file;
#[cfg(feature = "cli")]
pub mod interrupt;
pub mod machine;
pub mod memory;
pub mod meshes;
#[cfg(feature = "mpi")]
pub mod mpi;
pub mod pbrt;
pub mod picture;
#[cfg(feature = "cli")]
pub mod progress;
pub mod render;
pub mod report;
pub mod scene;
pub mod stability;
pub mod tev;
mod time_span;

pub use glam;
pub use render::{Picture, Render, RenderError, Update};
pub use scene::{Scene, SceneError};
pub use wavepath_engine as engine;
pub use wavepath_engine::{film, plan};
pub use wavepath_kernels as kernels;
