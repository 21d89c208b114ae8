//! Whatever safe code hands over, nothing is read out of bounds, nothing panics and nothing is silently something else:
//! it is refused by name, or does no harm.
#![forbid(unsafe_code)]

use core::num::Wrapping;
use wavepath_kernels::generate::{PixelBlock, camera_ray};
use wavepath_kernels::intersect::bvh2::NaiveBvh;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, Hit, Policy, RayClass, TraversalStack, bounds};
use wavepath_kernels::isa::{Isa, Kernel, Level};
use wavepath_kernels::lanes::Uint;
use wavepath_kernels::sampler::{Sampler, Stream};
use wavepath_kernels::scene::lights::{Emitter, FlatRow, Light, LightList, LightTable, PointRow, SphereRow};
use wavepath_kernels::scene::shapes::{Cylinder, Disk, Quadric, QuadricForm, SpherePart};
use wavepath_kernels::scene::{
    BuildError, Camera, CameraParts, Filter, FilterAxis, Geometry, GeometryParts, Lens, MISS, MaterialClass,
    MaterialHandle, MaterialTable, PrimitiveTag, Scene, SceneParts,
};
use wavepath_kernels::shade::materials::{Lambert, ThinDielectric};

const BAD: [f32; 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];

/// One triangle with normals, one sphere.
fn parts() -> GeometryParts {
    GeometryParts {
        vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        triangles: vec![[0, 1, 2]],
        planes: vec![[0.0, 0.0, 1.0, 0.0]],
        normals: vec![[0.0, 0.0, 1.0]],
        triangle_normals: vec![[0; 3]],
        spheres: vec![[0.0, 0.0, 3.0, 1.0]],
        tags: vec![0; 2],
        ..GeometryParts::default()
    }
}

#[test]
fn geometry_that_is_none_is_refused() {
    assert!(Geometry::new(parts()).is_ok());
    assert_eq!(Geometry::new(GeometryParts::default()).unwrap().primitives(), 0);
    let refused = |what: &str, change: &dyn Fn(&mut GeometryParts)| {
        let mut bad = parts();
        change(&mut bad);
        let error = Geometry::new(bad).expect_err(what).to_string();
        assert!(error.contains(what), "{error}, not {what}");
    };
    refused("triangle 0 refers to vertex 3", &|g| g.triangles[0][1] = 3);
    refused("triangle 0 refers to vertex 4294967295", &|g| g.triangles[0][2] = u32::MAX);
    refused("triangle 0 refers to vertex 2", &|g| g.vertices.truncate(2));
    refused("triangle 0 refers to vertex normal 1", &|g| g.triangle_normals[0][0] = 1);
    refused("triangle 0 refers to vertex normal 0", &|g| g.normals.clear());
    refused("triangles with vertex normals", &|g| g.triangle_normals.push([0; 3]));
    refused("planes of triangles", &|g| g.planes.clear());
    refused("planes of triangles", &|g| g.triangles.push([0, 1, 2]));
    refused("tags of primitives", &|g| g.tags.truncate(1));
    refused("tags of primitives", &|g| g.spheres.push([0.0, 0.0, 0.0, 1.0]));
    refused("its radius is 0", &|g| g.spheres[0][3] = 0.0);
    for bad in BAD {
        refused("vertex 2", &|g| g.vertices[2][1] = bad);
        refused("vertex normal 0", &|g| g.normals[0][0] = bad);
        refused("triangle 0", &|g| g.planes[0][3] = bad);
        refused("sphere 0", &|g| g.spheres[0][0] = bad);
        refused("sphere 0", &|g| g.spheres[0][3] = bad);
    }
}

#[test]
fn quadrics_that_are_none_are_refused() {
    use glam::{DAffine3, DMat3, DVec3};
    let good = Cylinder { radius: 1.0, z_min: 0.0, z_max: 1.0, phi_max: 7.0 };
    let one = DAffine3::IDENTITY;
    assert!(Quadric::new(QuadricForm::Cylinder(good), &one, false).is_ok());
    let sphere = SpherePart { radius: 1.0, z_min: -1.0, z_max: 0.5, phi_max: 7.0 };
    let disk = Disk { height: 0.0, radius: 1.0, inner_radius: 0.0, phi_max: 7.0 };
    for bad in BAD.into_iter().chain([0.0, -1.0]) {
        for form in [
            QuadricForm::Cylinder(Cylinder { radius: bad, ..good }),
            QuadricForm::Sphere(SpherePart { radius: bad, ..sphere }),
            QuadricForm::Disk(Disk { radius: bad, ..disk }),
        ] {
            assert!(Quadric::new(form, &one, false).is_err(), "{form:?}");
        }
    }
    for bad in BAD {
        for form in [
            QuadricForm::Cylinder(Cylinder { z_max: bad, ..good }),
            QuadricForm::Sphere(SpherePart { phi_max: bad, ..sphere }),
            QuadricForm::Disk(Disk { height: bad, ..disk }),
        ] {
            assert!(Quadric::new(form, &one, false).is_err(), "{form:?}");
        }
    }
    assert!(Quadric::new(QuadricForm::Cylinder(Cylinder { z_min: 1.0, ..good }), &one, false).is_err());
    let of = |matrix3: DMat3, translation: DVec3| DAffine3 { matrix3, translation };
    for transform in [
        of(DMat3::ZERO, DVec3::ZERO),
        of(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)), DVec3::ZERO),
        of(DMat3::from_diagonal(DVec3::splat(1e60)), DVec3::ZERO),
        of(DMat3::from_diagonal(DVec3::splat(1e-60)), DVec3::ZERO),
        of(DMat3::IDENTITY, DVec3::splat(1e60)),
        of(DMat3::IDENTITY, DVec3::NAN),
        of(DMat3::NAN, DVec3::ZERO),
    ] {
        for form in [QuadricForm::Cylinder(good), QuadricForm::Sphere(sphere), QuadricForm::Disk(disk)] {
            let error = Quadric::new(form, &transform, false).expect_err("a transform");
            assert!(error.to_string().contains("transform"), "{error}");
        }
    }
    // Angles of nothing, and rings turned inside out, hold nothing.
    let none = QuadricForm::Disk(Disk { inner_radius: 2.0, phi_max: -1.0, ..disk });
    let none = Quadric::new(none, &one, false).unwrap();
    assert_eq!(none.intersect([0.5, 0.1, 5.0], [0.0, 0.0, -1.0], f32::INFINITY), None);
}

fn camera_parts() -> CameraParts {
    CameraParts {
        origin: [0.0; 3],
        corner: [-1.0, 1.0, 1.0],
        right: [0.1, 0.0, 0.0],
        down: [0.0, -0.1, 0.0],
        lens: None,
        filter: Filter::new([FilterAxis::constant(0.5), FilterAxis::constant(0.5)]).unwrap(),
    }
}

#[test]
fn cameras_and_filters_that_are_none_are_refused() {
    assert!(Camera::new(camera_parts()).is_ok());
    let lens = Lens { x: [0.1, 0.0, 0.0], y: [0.0, 0.1, 0.0], focal_distance: 2.0 };
    assert!(Camera::new(CameraParts { lens: Some(lens), ..camera_parts() }).is_ok());
    for bad in BAD {
        assert!(Camera::new(CameraParts { origin: [bad, 0.0, 0.0], ..camera_parts() }).is_err());
        assert!(Camera::new(CameraParts { down: [0.0, 0.0, bad], ..camera_parts() }).is_err());
        let lens = Lens { x: [0.0, bad, 0.0], ..lens };
        assert!(Camera::new(CameraParts { lens: Some(lens), ..camera_parts() }).is_err());
        let filter = Filter::new([FilterAxis::constant(bad as f64), FilterAxis::constant(1.0)]);
        assert!(filter.is_err());
        let filter = Filter::new([FilterAxis::constant(1.0), FilterAxis::tabulate(bad as f64, |x| x)]);
        assert!(filter.is_err());
    }
    for bad in BAD.into_iter().chain([0.0, -1.0]) {
        let lens = Lens { focal_distance: bad, ..lens };
        assert!(Camera::new(CameraParts { lens: Some(lens), ..camera_parts() }).is_err());
    }
    // Filters of nothing, and of no numbers.
    let _ = Filter::new([FilterAxis::tabulate(1.0, |_| 0.0), FilterAxis::tabulate(0.0, |x| x)]);
    let _ =
        Filter::new([FilterAxis::tabulate(1.0, |_| f64::NAN), FilterAxis::tabulate(1.0, |_| f64::INFINITY)]);
}

/// Numbers that are not uniform in [0, 1), as samplers of others may give them, stay within the table.
#[test]
fn filters_take_any_number() {
    let axis = FilterAxis::tabulate(2.0, |x| 2.0 - x.abs());
    let numbers =
        [-1e30f32, -1.0, -0.0, 0.0, 0.999_999_94, 1.0, 1.000_000_1, 2.0, 1e30, f32::INFINITY, f32::NAN];
    for u in numbers {
        let _ = axis.sample::<f32>(u);
        let _ = axis.sample::<f64>(u.into());
    }
    assert!((axis.sample::<f32>(0.5)).abs() < 1e-3);

    #[derive(Clone, Copy)]
    struct Ones;
    impl Sampler for Ones {
        const NAME: &'static str = "ones";
        fn bits<U: Uint>(_: Stream<U>, _: U) -> U {
            U::splat(u32::MAX)
        }
        fn bits2<U: Uint>(_: Stream<U>, _: U) -> [U; 2] {
            [U::splat(u32::MAX); 2]
        }
    }
    let filter = Filter::new([axis.clone(), axis]).unwrap();
    let camera = Camera::new(CameraParts { filter, ..camera_parts() }).unwrap();
    let stream = Stream { seed: Wrapping(u32::MAX), index: Wrapping(u32::MAX) };
    let ray = camera_ray::<f32, Ones>(&camera, stream, Wrapping(u32::MAX), Wrapping(0));
    assert!(ray.direction.x.is_finite());
}

#[test]
fn scenes_whose_parts_do_not_fit_are_refused() {
    let mut materials = MaterialTable::default();
    let lambert = materials.add(&Lambert { reflectance: [0.5; 3].into() }).unwrap();
    let pane = materials.add(&ThinDielectric { eta: 1.5.into() }).unwrap();
    let lights = |material: u32| {
        let mut list = LightList::default();
        let emitter = Emitter { radiance: [1.0; 3], material, power: 1.0, ..Emitter::default() };
        list.push(emitter, Light::Sphere(SphereRow { centre: [0.0, 0.0, 3.0], radius: 1.0 }));
        LightTable::new(list).unwrap()
    };
    let deep = |tags: [u32; 2], lights: LightTable, environment: [f32; 3], max_depth: u32| {
        Scene::new(SceneParts {
            camera: Camera::new(camera_parts()).unwrap(),
            geometry: Geometry::new(GeometryParts { tags: tags.to_vec(), ..parts() }).unwrap(),
            materials: materials.clone(),
            textures: Default::default(),
            lights,
            environment,
            max_depth,
        })
    };
    let scene = |tags, lights, environment| deep(tags, lights, environment, 5);
    let tag = |class, row| PrimitiveTag::material(MaterialHandle { class, row }).0;
    let (pane, lambert) = (pane.row, tag(lambert.class, lambert.row));
    let lamp = PrimitiveTag::light(MaterialClass::Lambert, 0).0;
    let good = scene([lambert, lamp], lights(0), [0.0; 3]).unwrap();
    let endless = deep([lambert, lamp], lights(0), [0.0; 3], u32::MAX).expect_err("too deep");
    assert!(matches!(endless, BuildError::TooMany { what: "bounces", .. }), "{endless}");
    assert_eq!(good.clone().id(), good.id());
    assert_ne!(scene([lambert, lamp], lights(0), [0.0; 3]).unwrap().id(), good.id());
    for (what, tags, table) in [
        // Within a row, behind the last one, and rows of other classes, which may be shorter.
        ("primitive 0 refers to lambert in row 1 ", [lambert + 1, lamp], lights(0)),
        ("lambert in row 4 ", [lambert + 4, lamp], lights(0)),
        ("lambert in row 3 ", [lambert + pane, lamp], lights(0)),
        ("thin_dielectric in row 0 ", [lambert, tag(MaterialClass::ThinDielectric, 0)], lights(0)),
        ("light 1", [lambert, lamp + 1], lights(0)),
        ("light 0", [lambert, lamp], LightTable::default()),
        ("material class", [u32::MAX, lamp], lights(0)),
        ("primitive 1 refers to lambert in row 1 ", [lambert, lamp], lights(1)),
        ("primitive 1 refers to lambert in row 3 ", [lambert, lamp], lights(pane)),
    ] {
        let error = scene(tags, table, [0.0; 3]).expect_err(what);
        assert!(error.to_string().contains(what), "{error}, not {what}");
    }
    for bad in BAD.into_iter().chain([-1.0]) {
        assert!(scene([lambert, lamp], lights(0), [0.0, bad, 0.0]).is_err());
    }
}

#[test]
fn light_tables_take_lights_of_no_extent_and_no_power() {
    let mut list = LightList::default();
    for power in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::MAX, f64::MIN_POSITIVE] {
        let emitter = Emitter { power, material: u32::MAX, ..Emitter::default() };
        list.push(emitter, Light::Triangle(FlatRow::default()));
        list.push(emitter, Light::Point(PointRow::default()));
    }
    assert_eq!(LightTable::new(list).unwrap().len(), 12);
    assert!(LightTable::new(LightList::default()).unwrap().is_empty());
    let mut list = LightList::default();
    list.push(
        Emitter { radiance: [f32::MAX; 3], power: f64::MAX, ..Emitter::default() },
        Light::Point(PointRow::default()),
    );
    assert_eq!(LightTable::new(list).unwrap().brightest(), f32::MAX);
    assert!(matches!(
        LightTable::new({
            let mut list = LightList::default();
            list.push(
                Emitter { radiance: [-1.0; 3], ..Emitter::default() },
                Light::Point(PointRow::default()),
            );
            list
        }),
        Err(BuildError::Number { of: "light", id: 0, .. })
    ));
}

struct Trace<'a, A> {
    tree: &'a A,
    stack: TraversalStack,
}
impl<A: Accelerator> Kernel for Trace<'_, A> {
    type Output = Vec<Hit>;
    fn run<I: Isa>(mut self, isa: I) -> Vec<Hit> {
        let numbers = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1e38, -1e38, 1e-45];
        let mut out = Vec::new();
        for a in numbers {
            for b in numbers {
                let (origin, direction) = ([a, b, 0.1], [b, a, -1.0]);
                out.push(self.tree.closest(isa, origin, direction, &mut self.stack));
                self.tree.occluded(isa, origin, direction, a, &mut self.stack);
            }
        }
        out.push(self.tree.closest(isa, [0.1, 0.1, 5.0], [0.0, 0.0, -1.0], &mut self.stack));
        out
    }
}

/// Stacks of no tree and of other trees, and rays that are no rays.
#[test]
fn trees_take_any_stack_and_any_ray() {
    let small = Geometry::new(parts()).unwrap();
    let mut many = GeometryParts::default();
    for k in 0..5_000 {
        let (x, y) = ((k % 70) as f32, (k / 70) as f32);
        many.spheres.push([x, y, 0.0, 0.3]);
        many.tags.push(0);
    }
    let large = Geometry::new(many).unwrap();
    let empty = Geometry::new(GeometryParts::default()).unwrap();
    let trees = [&small, &large, &empty].map(Bvh8::new);
    for level in Level::available() {
        for tree in &trees {
            for stack in trees.iter().map(Bvh8::stack).chain([TraversalStack::default()]) {
                let hits = level.run(Trace { tree, stack });
                assert!(hits.iter().all(|hit| hit.primitive == MISS || hit.primitive < 5_000));
            }
        }
        for geometry in [&small, &large, &empty] {
            level.run(Trace { tree: &NaiveBvh::new(geometry), stack: TraversalStack::default() });
        }
    }
    for (tree, geometry) in trees.iter().zip([&small, &large, &empty]) {
        assert!(tree.is_of(geometry) && !tree.is_of(&geometry.clone()));
        for class in RayClass::ALL {
            Policy::Auto.pick(tree, class);
        }
    }
    let (low, high) = bounds(&small, 1);
    assert!(low[2] <= 2.0 && high[2] >= 4.0);
}

/// Coordinates near the end of single precision, where sizes and areas overflow.
#[test]
fn trees_take_primitives_of_any_size() {
    let far = f32::MAX;
    let g = GeometryParts {
        vertices: vec![[-far, -far, -far], [far, -far, 0.0], [0.0, far, far], [1e-45, 0.0, 0.0], [0.0; 3]],
        triangles: vec![[0, 1, 2], [3, 4, 4], [4, 4, 4]],
        planes: vec![[0.0, 0.0, 1.0, 0.0]; 3],
        spheres: vec![[far, far, far, far], [0.0, 0.0, 0.0, 1e-45], [-far, 0.0, 0.0, -1.0]],
        tags: vec![0; 6],
        ..GeometryParts::default()
    };
    let g = Geometry::new(g).unwrap();
    let tree = Bvh8::new(&g);
    level_hits(&tree);
    level_hits(&NaiveBvh::new(&g));
}

fn level_hits<A: Accelerator>(tree: &A) {
    for level in Level::available() {
        let hits = level.run(Trace { tree, stack: tree.stack() });
        assert!(hits.iter().all(|hit| hit.primitive == MISS || hit.primitive < 6));
    }
}

#[test]
fn blocks_have_their_pixels() {
    let block = PixelBlock::new(u32::MAX, 0, 3, 2);
    assert_eq!((block.columns().len(), block.rows().len(), block.pixels()), (6, 6, 6));
}
