//! Checks of a description: what tables cannot be made of is named here, in the words of the description.

use super::build::BuildError;
use super::description as d;
use glam::DAffine3;

/// Checks everything but vertices and materials, which are looked at when the tables are made.
pub(super) fn check(scene: &d::SceneDescription) -> Result<(), BuildError> {
    film(&scene.film)?;
    camera(&scene.camera)?;
    filter(scene.filter)?;
    at_least_one("sampler", 0, "the number of samples a pixel", scene.sampler.pixel_samples)?;
    for (id, mesh) in scene.meshes.iter().enumerate() {
        check_mesh(id, mesh)?;
    }
    for (id, shape) in scene.shapes.iter().enumerate() {
        check_shape(scene, id, shape)?;
    }
    for (id, light) in scene.lights.iter().enumerate() {
        check_light(scene, id, light)?;
    }
    Ok(())
}

/// Something that is wrong with number `id` of some things.
fn wrong<T>(of: &'static str, id: usize, what: impl Into<String>) -> Result<T, BuildError> {
    Err(BuildError::Wrong { of, id, what: what.into() })
}

fn at_least_one(of: &'static str, id: usize, what: &str, found: u32) -> Result<(), BuildError> {
    if found >= 1 { Ok(()) } else { wrong(of, id, format!("{what} is 0; expected 1 or more")) }
}

fn finite(of: &'static str, id: usize, what: &str, numbers: &[f64]) -> Result<(), BuildError> {
    match numbers.iter().find(|x| !x.is_finite()) {
        None => Ok(()),
        Some(x) => wrong(of, id, format!("{what} is {x}; expected a finite number")),
    }
}

fn positive(of: &'static str, id: usize, what: &str, numbers: &[f64]) -> Result<(), BuildError> {
    finite(of, id, what, numbers)?;
    match numbers.iter().find(|&&x| x <= 0.0) {
        None => Ok(()),
        Some(x) => wrong(of, id, format!("{what} is {x}; expected more than 0")),
    }
}

fn not_negative(of: &'static str, id: usize, what: &str, numbers: &[f64]) -> Result<(), BuildError> {
    finite(of, id, what, numbers)?;
    match numbers.iter().find(|&&x| x < 0.0) {
        None => Ok(()),
        Some(x) => wrong(of, id, format!("{what} is {x}; expected 0 or more")),
    }
}

fn colour(of: &'static str, id: usize, what: &str, rgb: d::Rgb) -> Result<(), BuildError> {
    not_negative(of, id, what, &rgb.map(f64::from))
}

fn transform(of: &'static str, id: usize, transform: &DAffine3) -> Result<(), BuildError> {
    finite(of, id, "a number of its transform", &transform.to_cols_array())?;
    if transform.inverse().is_finite() { Ok(()) } else { wrong(of, id, "its transform cannot be inverted") }
}

fn film(film: &d::Film) -> Result<(), BuildError> {
    let [width, height] = film.resolution;
    at_least_one("film", 0, "its width", width)?;
    at_least_one("film", 0, "its height", height)?;
    let [x0, x1, y0, y1] = film.pixel_bounds;
    if x0 < x1 && x1 <= width && y0 < y1 && y1 <= height {
        return Ok(());
    }
    wrong(
        "film",
        0,
        format!(
            "its pixels are x {x0} to {x1}, y {y0} to {y1}; expected some of 0 to {width} and 0 to {height}, ascending"
        ),
    )
}

fn camera(camera: &d::Camera) -> Result<(), BuildError> {
    transform("camera", 0, &camera.world_from_camera)?;
    positive("camera", 0, "its field of view", &[camera.fov])?;
    if camera.fov >= 180.0 {
        return wrong("camera", 0, format!("its field of view is {}; expected less than 180", camera.fov));
    }
    if let Some(window) = camera.screen_window {
        finite("camera", 0, "a side of its screen window", &window)?;
    }
    if let Some(aspect) = camera.frame_aspect_ratio {
        positive("camera", 0, "its aspect ratio", &[aspect])?;
    }
    not_negative("camera", 0, "the radius of its lens", &[camera.lens_radius])?;
    if camera.lens_radius > 0.0 {
        positive("camera", 0, "its distance in focus", &[camera.focal_distance])?;
    }
    Ok(())
}

fn filter(filter: d::Filter) -> Result<(), BuildError> {
    let (radius, parameters) = match filter {
        d::Filter::Box { radius } | d::Filter::Triangle { radius } => (radius, [0.0; 2]),
        d::Filter::Gaussian { radius, sigma } => {
            positive("filter", 0, "its standard deviation", &[sigma])?;
            (radius, [0.0; 2])
        }
        d::Filter::Mitchell { radius, b, c } => (radius, [b, c]),
    };
    finite("filter", 0, "a parameter", &parameters)?;
    not_negative("filter", 0, "its radius", &radius)
}

fn check_mesh(id: usize, mesh: &d::Mesh) -> Result<(), BuildError> {
    let vertices = mesh.positions.len();
    for (what, found) in [("normals", mesh.normals.len()), ("texture coordinates", mesh.uvs.len())] {
        if found != 0 && found != vertices {
            return wrong(
                "mesh",
                id,
                format!("{found} {what}; expected one for each of {vertices} vertices"),
            );
        }
    }
    match mesh.triangles.as_flattened().iter().find(|&&k| k as usize >= vertices) {
        None => Ok(()),
        Some(k) => wrong("mesh", id, format!("a triangle has vertex {k}, but there are {vertices}")),
    }
}

fn check_shape(scene: &d::SceneDescription, id: usize, shape: &d::Shape) -> Result<(), BuildError> {
    let refers = |what: &str, found: u32, exist: usize| {
        if (found as usize) < exist {
            return Ok(());
        }
        wrong("shape", id, format!("it refers to {what} {found}, but there are {exist}"))
    };
    refers("material", shape.material.0, scene.materials.len())?;
    let positive = |what: &str, x: f64| positive("shape", id, what, &[x]);
    let finite = |what: &str, x: &[f64]| finite("shape", id, what, x);
    match &shape.geometry {
        d::Geometry::Mesh(mesh) => refers("mesh", mesh.0, scene.meshes.len())?,
        d::Geometry::Sphere { world_from_object, radius, z_min, z_max, phi_max }
        | d::Geometry::Cylinder { world_from_object, radius, z_min, z_max, phi_max } => {
            transform("shape", id, world_from_object)?;
            positive("its radius", *radius)?;
            finite("a height or an angle", &[*z_min, *z_max, *phi_max])?;
        }
        d::Geometry::Disk { world_from_object, height, radius, inner_radius, phi_max } => {
            transform("shape", id, world_from_object)?;
            positive("its radius", *radius)?;
            finite("a height, a radius or an angle", &[*height, *inner_radius, *phi_max])?;
        }
    }
    let Some(emission) = shape.emission else { return Ok(()) };
    colour("shape", id, "its emitted radiance", emission.radiance)?;
    if let Some(image) = emission.image {
        refers_to_image(scene, "shape", id, image)?;
        let d::Geometry::Mesh(mesh) = shape.geometry else {
            return wrong("shape", id, "it is no mesh, on which alone a picture can shine");
        };
        if scene.meshes[mesh.0 as usize].uvs.is_empty() {
            return wrong(
                "shape",
                id,
                "its mesh has no texture coordinates for the picture that shines on it",
            );
        }
    }
    match emission.power {
        Some(power) => not_negative("shape", id, "its power", &[power.into()]),
        None => Ok(()),
    }
}

/// The picture of a light exists, and is one of finite colours.
fn refers_to_image(
    scene: &d::SceneDescription,
    of: &'static str,
    id: usize,
    image: d::LightImage,
) -> Result<(), BuildError> {
    let (found, exist) = (image.image.0, scene.light_images.len());
    let Some(image) = scene.light_images.get(found as usize) else {
        return wrong(of, id, format!("it refers to image {found}, but there are {exist}"));
    };
    match image.first_not_finite() {
        None => Ok(()),
        Some([x, y]) => wrong(of, id, format!("pixel {x}, {y} of its image is not finite")),
    }
}

fn check_light(scene: &d::SceneDescription, id: usize, light: &d::Light) -> Result<(), BuildError> {
    colour("light", id, "its radiance or intensity", light.colour())?;
    let vector = |what: &str, v: glam::DVec3| finite("light", id, what, &v.to_array());
    match *light {
        d::Light::Infinite { .. } => Ok(()),
        d::Light::EnvironmentMap { image, light_from_world, portal, .. } => {
            refers_to_image(scene, "light", id, image)?;
            finite("light", id, "a number of its transform", &light_from_world.to_cols_array())?;
            portal.into_iter().flatten().try_for_each(|v| vector("a coordinate of its portal", v))
        }
        d::Light::PicturePoint { position, image, mapping, light_from_world, half_size, .. } => {
            refers_to_image(scene, "light", id, image)?;
            vector("a coordinate", position)?;
            finite("light", id, "a number of its transform", &light_from_world.to_cols_array())?;
            positive("light", id, "half a side of its picture", &half_size)?;
            if mapping == d::PictureMapping::Surface {
                return wrong("light", id, "it has no surface for a picture");
            }
            Ok(())
        }
        d::Light::Point { position, .. } => vector("a coordinate", position),
        d::Light::Spot { position, direction, cos_falloff_start, cos_total_width, .. } => {
            vector("a coordinate", position)?;
            vector("a component of its direction", direction)?;
            finite("light", id, "the cosine of an angle", &[cos_falloff_start, cos_total_width])
        }
        d::Light::Goniometric { position, axis, .. } => {
            vector("a coordinate", position)?;
            vector("a component of its axis", axis)
        }
        d::Light::Distant { direction, .. } => vector("a component of its direction", direction),
    }
}
