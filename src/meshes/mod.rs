//! Meshes made by procedure, of any size from a hundred triangles to tens of millions.
//!
//! One file per idea: each generator is a struct of parameters (also a subcommand of `wavepath mesh`) whose `build`
//! checks the parameters, then returns a [`Mesh`]. What all of them keep:
//!
//! * `cross(p1 - p0, p2 - p0)` of every triangle points out of the solid (up, for a terrain), and so do the normals;
//! * normals have unit length and are stored for every vertex; sharp edges have split vertices;
//! * the same parameters give the same mesh, on any machine up to the rounding of its `sin` and `cos`;
//! * except for the terrain, which has a border, the surface is closed: once vertices are merged by position, every
//!   edge belongs to exactly two triangles, which run along it in opposite directions. [`Topology`] measures this;
//! * parameters that make no sense or too many triangles are refused before anything is allocated.
//!
//! ```
//! use wavepath::meshes::{Topology, TorusKnot};
//!
//! let knot = TorusKnot { p: 2, q: 3, segments: 96, sides: 12, ..TorusKnot::default() }.build()?;
//! assert_eq!(knot.triangles.len(), 2 * 96 * 12);
//! let topology = Topology::of(&knot);
//! assert!(topology.is_closed() && topology.euler_characteristic == 0);
//! # Ok::<(), wavepath::meshes::MeshError>(())
//! ```

mod block;
#[cfg(feature = "cli")]
mod command;
mod displaced_sphere;
mod error;
mod gear;
mod icosphere;
mod julia;
mod lathe;
mod lattice;
mod menger;
mod noise;
mod normals;
pub mod ply;
mod sphere_flake;
mod superellipsoid;
mod terrain;
mod topology;
mod torus_knot;

pub use block::Block;
#[cfg(feature = "cli")]
pub use command::{MeshArgs, MeshKind, generate, run};
pub use displaced_sphere::DisplacedSphere;
pub use error::MeshError;
pub use gear::Gear;
pub use julia::Julia;
pub use lathe::{Lathe, LatheProfile};
pub use menger::Menger;
pub use sphere_flake::SphereFlake;
pub use superellipsoid::Superellipsoid;
pub use terrain::Terrain;
pub use topology::Topology;
pub use torus_knot::TorusKnot;

use crate::scene::Mesh;
use glam::DVec3;

/// The most triangles that a generator makes: 67,108,864, about 2 GB of mesh.
pub const MAX_TRIANGLES: u64 = 1 << 26;

/// Rounds a position or a normal, once, at the end.
fn round(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

/// A mesh in double precision while it is being made.
#[derive(Default)]
struct Builder {
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    /// Adds a vertex and returns its index.
    fn vertex(&mut self, position: DVec3, normal: DVec3) -> u32 {
        let index = self.positions.len() as u32;
        self.positions.push(position);
        self.normals.push(normal);
        index
    }

    /// Adds the quad a, b, c, d, counter-clockwise as seen along its outward normal's tip, as two triangles.
    fn quad(&mut self, a: u32, b: u32, c: u32, d: u32) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }

    /// Rounds to the precision of a [`Mesh`].
    fn finish(self) -> Mesh {
        Mesh {
            positions: self.positions.into_iter().map(|p| round(p).map(f64::from)).collect(),
            normals: self.normals.into_iter().map(round).collect(),
            uvs: Vec::new(),
            triangles: self.triangles,
        }
    }
}
