//! Terrain: mountains over a square.

use super::error::{check_count, check_range, check_triangles};
use super::noise::Noise;
use super::normals::smooth_normals;
use super::{Builder, MeshError};
use crate::scene::Mesh;
use glam::{DVec2, DVec3};

/// A heightfield of ridged multifractal noise over a square in the xz plane, centred at the origin, y up.
///
/// The only mesh here with a border. Heights run from 0 to about `relief`.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Terrain {
    /// Cells along each side; the mesh has twice its square triangles
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().cells))]
    pub cells: u32,
    /// Length of a side
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().size))]
    pub size: f64,
    /// Height of the mountains
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().relief))]
    pub relief: f64,
    /// Mountain ranges along a side
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().scale))]
    pub scale: f64,
    /// Depth of a basin in the middle, as a part of the height there: room for a lake
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().basin))]
    pub basin: f64,
    /// Octaves of noise
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().octaves))]
    pub octaves: u32,
    /// Seed of the noise
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Self::default().seed))]
    pub seed: u32,
    /// Adds texture coordinates: (0, 0) at the corner of lowest x and z, (1, 1) at the opposite one
    #[cfg_attr(feature = "cli", arg(long))]
    pub uv: bool,
}

impl Default for Terrain {
    fn default() -> Self {
        Terrain {
            cells: 256,
            size: 10.0,
            relief: 2.0,
            scale: 3.0,
            basin: 0.0,
            octaves: 10,
            seed: 1,
            uv: false,
        }
    }
}

impl Terrain {
    /// Makes the mesh: `2 * cells^2` triangles.
    pub fn build(&self) -> Result<Mesh, MeshError> {
        check_count("cells", self.cells, 1, 1 << 20)?;
        check_triangles("cells", self.cells, 2 * u128::from(self.cells).pow(2))?;
        check_range("size", self.size, 1e-6, 1e6)?;
        check_range("relief", self.relief, 0.0, 1e6)?;
        check_range("scale", self.scale, 1e-3, 1e3)?;
        check_range("basin", self.basin, 0.0, 1.0)?;
        check_count("octaves", self.octaves, 0, 20)?;

        let noise = Noise::new(self.seed);
        let n = self.cells;
        let side = n + 1;
        let mut positions = Vec::with_capacity((side as usize).pow(2));
        for j in 0..side {
            for i in 0..side {
                let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                let p = DVec3::new(u, 0.37, v) * self.scale;
                // Bending the domain takes away the look of a lattice.
                let bend = DVec3::new(
                    noise.fractal(p + 31.7, 3),
                    0.0,
                    noise.fractal(p + DVec3::new(-11.3, 47.1, 5.9), 3),
                );
                // The square widens the valleys and sharpens the crests.
                let height = noise.ridged(p + 0.35 * bend, self.octaves).powi(2);
                let out = 2.0 * DVec2::new(u - 0.5, v - 0.5).length() + 0.25 * bend.x;
                let t = ((out - 0.15) / 0.75).clamp(0.0, 1.0);
                let height = height * (1.0 - self.basin * (1.0 - t * t * (3.0 - 2.0 * t)));
                positions.push(DVec3::new(
                    self.size * (u - 0.5),
                    self.relief * height,
                    self.size * (v - 0.5),
                ));
            }
        }
        let mut triangles = Vec::with_capacity(2 * (n as usize).pow(2));
        for j in 0..n {
            for i in 0..n {
                let (a, b) = (j * side + i, (j + 1) * side + i);
                triangles.push([a, b, a + 1]);
                triangles.push([a + 1, b, b + 1]);
            }
        }
        let normals = smooth_normals(&positions, &triangles);
        let mut mesh = Builder { positions, normals, triangles }.finish();
        if self.uv {
            let at = |k: u32| (f64::from(k) / f64::from(n)) as f32;
            mesh.uvs = (0..side).flat_map(|j| (0..side).map(move |i| [at(i), at(j)])).collect();
        }
        Ok(mesh)
    }
}

#[cfg(test)]
mod tests {
    use super::super::topology::assert_sound;
    use super::*;

    #[test]
    fn terrain_is_one_sheet_that_looks_up() {
        let terrain = Terrain { cells: 60, uv: true, ..Terrain::default() };
        let mesh = terrain.build().unwrap();
        let topology = assert_sound(&mesh);
        assert_eq!(mesh.triangles.len(), 2 * 60 * 60);
        assert_eq!(topology.open_edges, 4 * 60);
        assert_eq!(topology.euler_characteristic, 1);
        assert!(mesh.normals.iter().all(|n| n[1] > 0.0));
        assert!(mesh.positions.iter().all(|p| (0.0..=2.0).contains(&p[1])));
        assert_eq!((mesh.uvs[0], mesh.uvs[61 * 61 - 1]), ([0.0, 0.0], [1.0, 1.0]));
        let heights = mesh.positions.iter().map(|p| p[1]);
        assert!(heights.clone().fold(0.0, f64::max) - heights.fold(9.0, f64::min) > 0.5);
    }

    #[test]
    fn too_fine_a_terrain_is_refused_before_it_is_made() {
        let error = Terrain { cells: 1 << 20, ..Terrain::default() }.build().unwrap_err();
        assert!(error.to_string().starts_with("--cells: found 1048576, which makes"), "{error}");
        assert!(Terrain { cells: 0, ..Terrain::default() }.build().is_err());
    }
}
