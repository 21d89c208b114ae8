//! A scene without a file: a mesh made by procedure on a floor, under a spherical lamp.
//!
//!     cargo run --release --example from_code

use std::error::Error;
use wavepath::glam::DVec3;
use wavepath::meshes::TorusKnot;
use wavepath::scene::{Camera, Film, Geometry, Light, Material, Mesh, SceneDescription};
use wavepath::{Render, Scene};

fn main() -> Result<(), Box<dyn Error>> {
    let camera = Camera::look_at(DVec3::new(0.0, 2.0, -5.0), DVec3::ZERO, DVec3::Y, 35.0);
    let mut scene = SceneDescription {
        camera: camera.ok_or("the camera looks nowhere")?,
        film: Film::whole(96, 72),
        ..SceneDescription::default()
    };
    let diffuse = |r, g, b| Material::Diffuse { reflectance: [r, g, b].into(), sigma: 0.0.into() };
    let (grey, red) = (diffuse(0.6, 0.6, 0.6), diffuse(0.7, 0.15, 0.1));
    let (grey, red, black) =
        (scene.add_material(grey), scene.add_material(red), scene.add_material(diffuse(0.0, 0.0, 0.0)));
    let knot = TorusKnot { segments: 300, sides: 16, ..TorusKnot::default() }.build()?;
    let knot = scene.add_mesh(knot);
    scene.add_shape(knot, red);
    let floor = scene.add_mesh(Mesh {
        positions: vec![[-9.0, -1.6, -9.0], [-9.0, -1.6, 9.0], [9.0, -1.6, 9.0], [9.0, -1.6, -9.0]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    });
    scene.add_shape(floor, grey);
    scene.add_lamp(Geometry::sphere(DVec3::new(2.0, 4.0, -2.0), 0.5), black, [30.0, 28.0, 25.0]);
    scene.lights.push(Light::Infinite { radiance: [0.2, 0.25, 0.3] });

    let scene = Scene::new("knot", scene)?;
    let picture = Render::new(&scene).spp(32).run()?;
    let path = std::env::temp_dir().join("wavepath-knot.png");
    picture.save(&path)?;
    println!("{}: relMSE {:.1e}", path.display(), picture.error().relmse());
    Ok(())
}
