//! What safe code can hand to the library is refused by name, or does no harm.
#![forbid(unsafe_code)]

use glam::{DAffine3, DMat3, DVec3};
use std::ops::RangeInclusive;
use wavepath::engine::schedule::Stop;
use wavepath::engine::session::{Session, SessionError};
use wavepath::engine::wavefront::BATCHES;
use wavepath::engine::{EngineKind, Settings, Tree};
use wavepath::film::Film;
use wavepath::plan::Plan;
use wavepath::scene::{
    self, BuildError, Emission, Filter, Geometry, Light, Material, MaterialId, Mesh, MeshId,
    SceneDescription, Shape, SphericalLights,
};
use wavepath::{Render, RenderError};

/// A triangle, a sphere that shines, a disk, a cylinder; 8 x 8 pixels.
fn description() -> SceneDescription {
    let mut scene = SceneDescription::default();
    scene.film.resolution = [8, 8];
    scene.film.pixel_bounds = [0, 8, 0, 8];
    scene.materials = vec![Material::Diffuse { reflectance: [0.5; 3].into(), sigma: 0.0.into() }];
    scene.meshes = vec![Mesh {
        positions: vec![[-5.0, -5.0, 6.0], [5.0, -5.0, 6.0], [0.0, 5.0, 6.0]],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    }];
    let world_from_object = DAffine3::from_translation(DVec3::new(0.0, 0.0, 3.0));
    let geometries = [
        Geometry::Mesh(MeshId(0)),
        Geometry::Sphere { world_from_object, radius: 0.5, z_min: -0.5, z_max: 0.5, phi_max: 360.0 },
        Geometry::Disk { world_from_object, height: 1.0, radius: 0.5, inner_radius: 0.0, phi_max: 360.0 },
        Geometry::Cylinder { world_from_object, radius: 0.2, z_min: 0.0, z_max: 1.0, phi_max: 180.0 },
    ];
    scene.shapes = geometries
        .into_iter()
        .enumerate()
        .map(|(k, geometry)| Shape {
            geometry,
            material: MaterialId(0),
            emission: (k > 0).then_some(Emission {
                radiance: [1.0; 3],
                power: None,
                two_sided: true,
                image: None,
            }),
            flip_normal: false,
            visible: true,
            opacity: None,
        })
        .collect();
    scene.lights = vec![
        Light::Point { intensity: [1.0; 3], position: DVec3::ZERO },
        Light::Goniometric { intensity: [1.0; 3], position: DVec3::ZERO, axis: DVec3::Z },
    ];
    scene
}

fn assert_refused(what: &str, change: impl Fn(&mut SceneDescription)) {
    let mut bad = description();
    change(&mut bad);
    let error = match scene::build(&bad, SphericalLights::Cone) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("{what} is taken"),
    };
    assert!(error.contains(what), "{error}, not {what}");
    assert!(wavepath::Scene::new("bad", bad).is_err());
}

const BAD: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

#[test]
fn descriptions_of_no_scene_are_refused_by_name() {
    assert!(scene::build(&description(), SphericalLights::Cone).is_ok());
    assert!(scene::build(&SceneDescription::default(), SphericalLights::Area).is_ok());
    assert!(SceneDescription::default().max_depth > 0);

    assert_refused("film 0: its width is 0", |s| s.film.resolution[0] = 0);
    assert_refused("film 0: its pixels", |s| s.film.pixel_bounds = [5, 3, 0, 8]);
    assert_refused("film 0: its pixels", |s| s.film.pixel_bounds = [0, 8, 4, 4]);
    assert_refused("film 0: its pixels", |s| s.film.pixel_bounds = [0, 9, 0, 8]);
    assert_refused("film 0: its pixels", |s| s.film.pixel_bounds = [0, u32::MAX, 0, u32::MAX]);
    assert_refused("sampler 0", |s| s.sampler.pixel_samples = 0);
    assert_refused("shape 1: it refers to material 7", |s| s.shapes[1].material = MaterialId(7));
    assert_refused("shape 0: it refers to material 0", |s| s.materials.clear());
    assert_refused("shape 0: it refers to mesh 9", |s| s.shapes[0].geometry = Geometry::Mesh(MeshId(9)));
    assert_refused("mesh 0: a triangle has vertex 3", |s| s.meshes[0].triangles[0][0] = 3);
    assert_refused("mesh 0: 1 normals", |s| s.meshes[0].normals.push([0.0, 0.0, 1.0]));
    for bad in BAD.into_iter().chain([0.0, -1.0, 180.0]) {
        assert_refused("camera 0: its field of view", |s| s.camera.fov = bad);
    }
    for bad in BAD.into_iter().chain([-1.0]) {
        assert_refused("camera 0: the radius of its lens", |s| s.camera.lens_radius = bad);
        assert_refused("filter 0: its radius", |s| s.filter = Filter::Box { radius: [bad, 1.0] });
        assert_refused("material 0: lambert: reflectance", |s| {
            s.materials[0] =
                Material::Diffuse { reflectance: [0.5, bad as f32, 0.5].into(), sigma: 0.0.into() };
        });
        assert_refused("shape 1: its emitted radiance", |s| {
            s.shapes[1].emission.as_mut().unwrap().radiance[2] = bad as f32;
        });
        assert_refused("light 0: its radiance", |s| *s.lights[0].colour_mut() = [bad as f32; 3]);
    }
    for bad in BAD {
        assert_refused("vertex 1", |s| s.meshes[0].positions[1][1] = bad);
        assert_refused("filter 0: a parameter", |s| {
            s.filter = Filter::Mitchell { radius: [2.0; 2], b: bad, c: 0.3 };
        });
        assert_refused("light 1: a coordinate", |s| {
            s.lights[1] =
                Light::Goniometric { intensity: [1.0; 3], position: DVec3::splat(bad), axis: DVec3::Z };
        });
    }
    // Transforms that leave nothing, and those of no numbers.
    for matrix3 in [DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0)), DMat3::NAN] {
        let transform = DAffine3 { matrix3, translation: DVec3::ZERO };
        assert_refused("camera 0: ", |s| s.camera.world_from_camera = transform);
        for k in 1..4 {
            assert_refused(&format!("shape {k}: "), |s| match &mut s.shapes[k].geometry {
                Geometry::Sphere { world_from_object, .. }
                | Geometry::Disk { world_from_object, .. }
                | Geometry::Cylinder { world_from_object, .. } => *world_from_object = transform,
                Geometry::Mesh(_) => unreachable!(),
            });
        }
    }
    for bad in BAD.into_iter().chain([0.0, -1.0]) {
        for k in 1..4 {
            assert_refused(&format!("shape {k}: its radius"), |s| match &mut s.shapes[k].geometry {
                Geometry::Sphere { radius, .. }
                | Geometry::Disk { radius, .. }
                | Geometry::Cylinder { radius, .. } => *radius = bad,
                Geometry::Mesh(_) => unreachable!(),
            });
        }
    }
}

#[test]
fn no_resolution_is_none() {
    let options = wavepath::scene::SceneOptions { resolution: Some([0, 8]), ..Default::default() };
    assert!(wavepath::Scene::new_with("none", description(), &options).is_err());
}

#[test]
fn renders_of_impossible_choices_are_refused() {
    let scene = wavepath::Scene::new("small", description()).unwrap();
    let refused = |what: &str, render: Render| match render.run() {
        Err(error @ RenderError::Choice { .. }) => assert!(error.to_string().contains(what), "{error}"),
        Err(other) => panic!("{what}: {other}"),
        Ok(_) => panic!("{what} is taken"),
    };
    let render = || Render::new(&scene).threads(1).spp(1);
    refused("samples", render().spp(0));
    refused("threads", render().threads(0));
    for batch in [0, 1, 15, BATCHES.end() + 1, 1 << 21, usize::MAX] {
        refused("pool", render().batch(batch));
    }
    for error in [f64::NAN, 0.0, -1.0] {
        refused("error", render().error(error));
    }
    assert!(render().batch(*BATCHES.start()).run().is_ok());
}

/// What an engine is given belongs together, or is refused.
#[test]
fn parts_of_other_renders_are_refused() {
    let scene = scene::build(&description(), SphericalLights::Cone).unwrap();
    // The same, and yet another one; and one with nothing in it.
    let others = [description(), SceneDescription::default()]
        .map(|description| scene::build(&description, SphericalLights::Cone).unwrap());
    let plan = Plan::new(&scene);
    let wide = Tree::build(EngineKind::Wavefront, &scene);
    let naive = Tree::build(EngineKind::Megakernel, &scene);
    let small = wavepath::Scene::new("small", description()).unwrap();
    let settings = |engine| Settings { engine, threads: 1, ..Render::new(&small).settings().clone() };
    let session = |plan: &Plan, tree: &Tree, settings: &Settings| -> Result<(), SessionError> {
        let stop = Stop { spp: Some(1), time: None, interrupted: Default::default() };
        let frame = small.description().film.frame();
        let film = Film::for_render(frame, plan.requirements(), settings).unwrap();
        let mut session = Session::new(&scene, plan, tree, &film, settings, stop)?;
        session.run(None, |_| ());
        Ok(())
    };
    let foreign = |what: &str, result: Result<(), SessionError>| match result {
        Err(SessionError::Foreign { what: found, .. }) => assert_eq!(found, what),
        other => panic!("{what}: {other:?}"),
    };
    session(&plan, &wide, &settings(EngineKind::Wavefront)).unwrap();
    session(&plan, &wide, &settings(EngineKind::MegakernelWide)).unwrap();
    session(&plan, &naive, &settings(EngineKind::Megakernel)).unwrap();
    session(&Plan::everything(&scene), &wide, &settings(EngineKind::Wavefront)).unwrap();
    foreign("tree", session(&plan, &naive, &settings(EngineKind::Wavefront)));
    foreign("tree", session(&plan, &wide, &settings(EngineKind::Megakernel)));
    for other in &others {
        foreign("plan", session(&Plan::new(other), &wide, &settings(EngineKind::Wavefront)));
        foreign("plan", session(&Plan::everything(other), &naive, &settings(EngineKind::Megakernel)));
        let tree = Tree::build(EngineKind::Wavefront, other);
        foreign("tree", session(&plan, &tree, &settings(EngineKind::Wavefront)));
        foreign("tree", session(&plan, &tree, &settings(EngineKind::MegakernelWide)));
    }
    let choice = |settings: Settings| match session(&plan, &wide, &settings) {
        Err(SessionError::Choice { .. }) => {}
        other => panic!("{settings:?}: {other:?}"),
    };
    let batches: RangeInclusive<usize> = BATCHES;
    for batch in [0, batches.start() - 1, batches.end() + 1, 1 << 21, usize::MAX] {
        choice(Settings { batch, ..settings(EngineKind::Wavefront) });
    }
    for threads in [0, usize::MAX] {
        choice(Settings { threads, ..settings(EngineKind::Wavefront) });
    }
}

/// Errors that come from the tables keep their words.
#[test]
fn errors_name_what_is_wrong() {
    let mut bad = description();
    bad.meshes[0].positions[2] = [f64::NAN; 3];
    let error = scene::build(&bad, SphericalLights::Cone).unwrap_err();
    assert!(matches!(error, BuildError::Tables(_)));
    assert_eq!(error.to_string(), "vertex 2: a coordinate is NaN; expected a finite number");
}
