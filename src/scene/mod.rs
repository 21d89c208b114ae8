//! What a scene is, apart from the format it was written in.

mod description;

pub use description::*;
