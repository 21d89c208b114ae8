//! What a scene is, apart from the format it was written in.

mod build;
mod check;
mod description;
mod light_images;
mod opened;
pub(crate) mod origin;
mod pose;

pub use build::{BuildError, SphericalLights, build, release_meshes, set_resolution};
pub use description::*;
pub use opened::{Scene, SceneError, SceneOptions};
pub use pose::Pose;
pub use wavepath_engine::SamplerKind;
