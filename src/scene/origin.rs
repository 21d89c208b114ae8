//! Where a scene is moved before its numbers are rounded.
//!
//! Tables are in single precision, which keeps 24 bits of a coordinate: what is small and far from the origin loses them. A
//! scene that stands far from it (a building in the coordinates of its country, a scene under one large `Translate`) is
//! moved, in double precision, to where its camera is, or to the middle of what it shows. pbrt-v4 always renders relative to
//! the camera; here scenes that gain nothing stay where they are, so that they keep their bits.

use super::description as d;
use glam::DVec3;

/// Bits of the average coordinate that moving has to save.
const WORTH: f64 = 6.0;
/// Triangles of a mesh that are looked at.
const MOST: usize = 1 << 12;

/// The description, moved, if that saves bits.
pub fn moved(description: &d::SceneDescription) -> Option<d::SceneDescription> {
    let origin = of(description);
    if origin == DVec3::ZERO {
        return None;
    }
    let mut moved = description.clone();
    moved.camera.world_from_camera.translation -= origin;
    for position in moved.meshes.iter_mut().flat_map(|mesh| &mut mesh.positions) {
        *position = (DVec3::from(*position) - origin).into();
    }
    for shape in &mut moved.shapes {
        match &mut shape.geometry {
            d::Geometry::Mesh(_) => {}
            d::Geometry::Sphere { world_from_object, .. }
            | d::Geometry::Disk { world_from_object, .. }
            | d::Geometry::Cylinder { world_from_object, .. } => world_from_object.translation -= origin,
        }
    }
    for light in &mut moved.lights {
        match light {
            d::Light::Point { position, .. }
            | d::Light::Spot { position, .. }
            | d::Light::Goniometric { position, .. }
            | d::Light::PicturePoint { position, .. } => *position -= origin,
            d::Light::EnvironmentMap { portal, .. } => {
                if let Some([corner, _, _]) = portal {
                    *corner -= origin;
                }
            }
            d::Light::Infinite { .. } | d::Light::Distant { .. } => {}
        }
    }
    Some(moved)
}

/// The point that becomes the origin of the tables.
pub fn of(description: &d::SceneDescription) -> DVec3 {
    if !description.textures.is_empty() {
        // Some are functions of the place in the world.
        return DVec3::ZERO;
    }
    let boxes = boxes(description);
    let sizes = boxes.iter().map(|b| b.size).filter(|&size| size > 0.0 && size.is_finite()).collect();
    let Some(size) = median(sizes) else { return DVec3::ZERO };
    let camera = description.camera.world_from_camera.translation;
    // The camera has to know its distance to what is nearest.
    let nearest = boxes.iter().map(|b| ((b.centre - camera).length() - b.size).abs().max(1e-3 * b.size));
    let nearest = nearest.fold(f64::INFINITY, f64::min);
    let weight = boxes.iter().map(|b| b.weight).sum::<f64>();
    // Bits that coordinates spend on how far from `origin` they are.
    let spent = |origin: DVec3| {
        let all = boxes.iter().map(|b| b.weight * bits(b.centre - origin, b.size)).sum::<f64>();
        all / weight + bits(camera - origin, nearest)
    };
    let middle = DVec3::from_array(core::array::from_fn(|k| {
        median(boxes.iter().map(|b| b.centre[k]).filter(|x| x.is_finite()).collect()).unwrap_or(0.0)
    }));
    // Multiples of a power of two: moving adds no rounding of its own.
    let step = size.log2().ceil().exp2();
    let candidates = [camera, middle].map(|p| (p / step).round() * step);
    let best =
        candidates.into_iter().filter(|p| p.is_finite()).min_by(|&a, &b| spent(a).total_cmp(&spent(b)));
    best.filter(|&p| spent(DVec3::ZERO) - spent(p) >= WORTH).unwrap_or(DVec3::ZERO)
}

/// The box around something.
struct Extent {
    centre: DVec3,
    /// Half of the diagonal.
    size: f64,
    /// How many primitives it stands for.
    weight: f64,
}

fn bits(from: DVec3, size: f64) -> f64 {
    let far = from.abs().max_element();
    if size > 0.0 && size.is_finite() && far.is_finite() { (1.0 + far / size).log2() } else { 0.0 }
}

fn median(mut numbers: Vec<f64>) -> Option<f64> {
    let middle = numbers.len() / 2;
    (!numbers.is_empty()).then(|| *numbers.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Boxes around all primitives; of a large mesh around some that stand for it.
fn boxes(description: &d::SceneDescription) -> Vec<Extent> {
    let around = |low: DVec3, high: DVec3, weight: f64| Extent {
        centre: 0.5 * (low + high),
        size: 0.5 * (high - low).length(),
        weight,
    };
    let mut out = Vec::new();
    for shape in &description.shapes {
        match &shape.geometry {
            d::Geometry::Mesh(id) => {
                // The description is not checked yet.
                let Some(mesh) = description.meshes.get(id.0 as usize) else { continue };
                let every = mesh.triangles.len().div_ceil(MOST).max(1);
                let looked_at = mesh.triangles.len().div_ceil(every);
                let weight = mesh.triangles.len() as f64 / looked_at.max(1) as f64;
                for corners in mesh.triangles.iter().step_by(every) {
                    let [Some(a), Some(b), Some(c)] =
                        corners.map(|k| mesh.positions.get(k as usize).map(|&p| DVec3::from(p)))
                    else {
                        continue;
                    };
                    out.push(around(a.min(b).min(c), a.max(b).max(c), weight));
                }
            }
            d::Geometry::Sphere { world_from_object: m, radius, .. }
            | d::Geometry::Disk { world_from_object: m, radius, .. } => {
                let reach = m.matrix3.abs() * DVec3::splat(*radius);
                out.push(around(m.translation - reach, m.translation + reach, 1.0));
            }
            d::Geometry::Cylinder { world_from_object: m, radius, z_min, z_max, .. } => {
                let reach = m.matrix3.abs() * DVec3::splat(radius.max(0.5 * (z_max - z_min)));
                let centre = m.transform_point3(DVec3::Z * (0.5 * (z_min + z_max)));
                out.push(around(centre - reach, centre + reach, 1.0));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine3;

    fn scene(at: DVec3, scale: f64) -> d::SceneDescription {
        let mut scene = d::SceneDescription::default();
        let material =
            scene.add_material(d::Material::Diffuse { reflectance: [0.5; 3].into(), sigma: 0.0.into() });
        let corner = |x: f64, y: f64| (at + scale * DVec3::new(x, y, 0.0)).into();
        let floor = scene.add_mesh(d::Mesh {
            positions: vec![corner(-30.0, -30.0), corner(30.0, -30.0), corner(30.0, 30.0)],
            triangles: vec![[0, 1, 2]],
            ..d::Mesh::default()
        });
        scene.add_shape(floor, material);
        scene.add_shape(d::Geometry::sphere(at + scale * DVec3::Z, scale), material);
        scene.camera.world_from_camera = DAffine3::from_translation(at + scale * DVec3::new(0.0, -6.0, 1.2));
        scene
    }

    #[test]
    fn scenes_move_if_that_saves_bits() {
        for scale in [1e-6, 1.0, 1e6] {
            for near in [0.0, 1.0, 10.0] {
                assert_eq!(of(&scene(scale * DVec3::new(near, -near, 0.5 * near), scale)), DVec3::ZERO);
            }
            for far in [1e4, 1e6, 1e9] {
                let at = scale * DVec3::new(far, 0.7 * far, 0.3 * far);
                let left = (of(&scene(at, scale)) - at).abs().max_element();
                assert!(left < 40.0 * scale, "{left} of {at}");
            }
        }
        assert_eq!(of(&d::SceneDescription::default()), DVec3::ZERO);
    }
}
