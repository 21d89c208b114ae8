//! The wide tree alone: which rays from a point meet a wavy sheet of triangles, and where.
//!
//!     cargo run --release --example bvh
//!
//! What a program needs that wants the tree and not the renderer: a [`Geometry`], a [`Bvh8`] over it, and a kernel that
//! is run on the best instruction set of the machine.

use std::error::Error;
use wavepath::glam::Vec3;
use wavepath::kernels::intersect::bvh8::Bvh8;
use wavepath::kernels::intersect::{Accelerator, Closest};
use wavepath::kernels::isa::Level;
use wavepath::kernels::scene::{Geometry, GeometryParts, MISS};

/// Squares on a side of the sheet.
const SIDE: u32 = 64;

fn main() -> Result<(), Box<dyn Error>> {
    let height = |x: f32, y: f32| 0.1 * (6.0 * x).sin() * (5.0 * y).cos();
    let vertices: Vec<[f32; 3]> = (0..=SIDE)
        .flat_map(|j| (0..=SIDE).map(move |i| [i, j].map(|k| 2.0 * k as f32 / SIDE as f32 - 1.0)))
        .map(|[x, y]| [x, y, height(x, y)])
        .collect();
    let row = SIDE + 1;
    let triangles: Vec<[u32; 3]> = (0..SIDE)
        .flat_map(|j| (0..SIDE).map(move |i| j * row + i))
        .flat_map(|k| [[k, k + 1, k + row], [k + 1, k + row + 1, k + row]])
        .collect();
    // Unit normal of each triangle, and its product with a point of the plane.
    let plane = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|k| Vec3::from(vertices[k as usize]));
        let normal = (b - a).cross(c - a).normalize();
        [normal.x, normal.y, normal.z, normal.dot(a)]
    };
    let planes = triangles.iter().map(plane).collect();
    let tags = vec![0; triangles.len()];
    let geometry = Geometry::new(GeometryParts { vertices, triangles, planes, tags, ..Default::default() })?;
    let tree = Bvh8::new(&geometry);
    let (level, mut stack) = (Level::detect(), tree.stack());

    // A fan of rays from above, as characters: the darker, the farther.
    for y in 0..16 {
        let line = (0..48).map(|x| {
            let direction = Vec3::new(x as f32 / 24.0 - 1.0, y as f32 / 8.0 - 1.0, -1.0).normalize();
            let (origin, direction) = ([0.0, 0.0, 1.2], direction.into());
            let hit = level.run(Closest { accelerator: &tree, origin, direction, stack: &mut stack });
            match hit.primitive {
                MISS => ' ',
                _ => *b"@%#*+=-:.".get(((hit.t - 1.1) * 12.0) as usize).unwrap_or(&b'.') as char,
            }
        });
        println!("{}", line.collect::<String>());
    }
    println!("{} triangles, {} bytes of tree, {}", geometry.primitives(), tree.bytes(), level.name());
    Ok(())
}
