//! Transforms in double precision, and the checks that keep impossible ones out.

use glam::{DAffine3, DMat3, DVec3};

/// A translation.
pub(crate) fn translate(v: [f64; 3]) -> DAffine3 {
    DAffine3::from_translation(DVec3::from_array(v))
}

/// A scale.
pub(crate) fn scale(v: [f64; 3]) -> DAffine3 {
    DAffine3::from_scale(DVec3::from_array(v))
}

/// A rotation by `degrees` about an axis; `None` if the axis has no direction.
pub(crate) fn rotate(degrees: f64, axis: [f64; 3]) -> Option<DAffine3> {
    let axis = DVec3::from_array(axis);
    // The largest component first, so that tiny and huge axes neither vanish nor overflow.
    let unit = (axis / axis.abs().max_element()).try_normalize()?;
    let (sin, cos) = sin_cos_degrees(degrees);
    Some(DAffine3::from_mat3(rotation_matrix(unit, sin, cos)))
}

/// Exact for multiples of 90 degrees, so that axis-parallel things stay so.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    let turn = degrees.rem_euclid(360.0);
    match turn {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => turn.to_radians().sin_cos(),
    }
}

/// Rodrigues' formula: cos I + (1 - cos) a a^T + sin [a]x.
fn rotation_matrix(a: DVec3, sin: f64, cos: f64) -> DMat3 {
    let cross =
        DMat3::from_cols(DVec3::new(0.0, a.z, -a.y), DVec3::new(-a.z, 0.0, a.x), DVec3::new(a.y, -a.x, 0.0));
    let outer = DMat3::from_cols(a * a.x, a * a.y, a * a.z);
    DMat3::IDENTITY * cos + outer * (1.0 - cos) + cross * sin
}

/// World to camera space as pbrt's `LookAt`: z towards `look`, x = up cross z (left-handed).
/// `None` if eye and target coincide or `up` is parallel to the view.
pub(crate) fn look_at(eye: [f64; 3], look: [f64; 3], up: [f64; 3]) -> Option<DAffine3> {
    let eye = DVec3::from_array(eye);
    let forward = (DVec3::from_array(look) - eye).try_normalize()?;
    let right = DVec3::from_array(up).try_normalize()?.cross(forward);
    if right.length() < 1e-12 {
        return None;
    }
    let right = right.normalize();
    let up = forward.cross(right);
    let world_from_camera = DAffine3::from_mat3_translation(DMat3::from_cols(right, up, forward), eye);
    Some(world_from_camera.inverse())
}

/// What single precision, in which exporters calculate, cannot tell from 0 beside 1 after a few operations.
const ROUNDING: f64 = 8.0 * f32::EPSILON as f64;

/// A transform from sixteen numbers as they stand in a file: column-major, the translation in 12..15. `None` if the
/// fourth row is not (0, 0, 0, w) with w not 0, but for the rounding of who wrote it.
pub(crate) fn matrix(m: &[f64; 16]) -> Option<DAffine3> {
    let is_rounding = |x: f64| x.abs() <= ROUNDING * m[15].abs();
    if !(is_rounding(m[3]) && is_rounding(m[7]) && is_rounding(m[11])) || m[15] == 0.0 {
        return None;
    }
    let column = |i: usize| DVec3::new(m[i], m[i + 1], m[i + 2]) / m[15];
    Some(DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(4), column(8)), column(12)))
}

/// Whether two transforms are the same but for the rounding of single precision, relative to the largest entry of the
/// linear part and to the translation.
pub(crate) fn same(a: &DAffine3, b: &DAffine3) -> bool {
    let largest = |m: &DMat3| m.to_cols_array().iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
    let linear = largest(&a.matrix3).max(largest(&b.matrix3));
    let far = a.translation.abs().max(b.translation.abs()).max_element();
    largest(&(a.matrix3 - b.matrix3)) <= ROUNDING * linear
        && (a.translation - b.translation).abs().max_element() <= ROUNDING * far.max(linear)
}

/// The transform, if it is finite and has a finite inverse.
pub(crate) fn invertible(transform: DAffine3) -> Option<DAffine3> {
    if !transform.is_finite() {
        return None;
    }
    // Relative to its columns: a scale by 1e-100 is regular, a flattened cube is not.
    let m = transform.matrix3;
    let lengths = [m.x_axis, m.y_axis, m.z_axis].map(|c| c / c.abs().max_element());
    let relative = lengths[0].dot(lengths[1].cross(lengths[2]));
    let regular = relative.abs() > 1e-14 && transform.inverse().is_finite();
    regular.then_some(transform)
}

/// Whether a matrix is a rotation or reflection times a scale, but for rounding (of exporters in single precision, too).
pub(crate) fn keeps_angles(matrix: &DMat3) -> bool {
    let gram = matrix.transpose() * *matrix;
    let square = (gram.x_axis.x + gram.y_axis.y + gram.z_axis.z) / 3.0;
    let off = gram - DMat3::from_diagonal(DVec3::splat(square));
    off.to_cols_array().iter().all(|x| x.abs() <= 1e-6 * square)
}

/// Whether the transform turns left-handed systems into right-handed ones.
pub(crate) fn swaps_handedness(transform: &DAffine3) -> bool {
    transform.matrix3.determinant() < 0.0
}

/// The matrix for normals, but for a positive factor: the inverse's transpose, or for a transform that makes everything
/// flat the cofactors, which are the inverse's transpose times the determinant where there is one.
pub(crate) fn normal_matrix(transform: &DAffine3) -> DMat3 {
    if invertible(*transform).is_some() {
        return transform.matrix3.inverse().transpose();
    }
    let m = transform.matrix3;
    // Scaled, so that the products of tiny or huge entries neither vanish nor overflow.
    let largest = m.to_cols_array().iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
    let m = if largest > 0.0 { m * largest.recip() } else { m };
    let cofactors =
        DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    if m.determinant() < 0.0 { -cofactors } else { cofactors }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: DVec3, b: [f64; 3]) {
        assert!((a - DVec3::from_array(b)).length() < 1e-12, "{a} != {b:?}");
    }

    #[test]
    fn rotation_turns_x_to_y_about_z() {
        let r = rotate(90.0, [0.0, 0.0, 2.0]).unwrap();
        assert_eq!(r.transform_vector3(DVec3::X), DVec3::Y);
        let r = rotate(120.0, [1.0, 1.0, 1.0]).unwrap();
        close(r.transform_vector3(DVec3::X), [0.0, 1.0, 0.0]);
        assert!(rotate(10.0, [0.0; 3]).is_none());
    }

    #[test]
    fn look_at_is_left_handed() {
        let camera = look_at([0.0, 0.0, -5.0], [0.0; 3], [0.0, 1.0, 0.0]).unwrap();
        close(camera.transform_point3(DVec3::new(1.0, 2.0, 0.0)), [1.0, 2.0, 5.0]);
        assert!(look_at([1.0; 3], [1.0; 3], [0.0, 1.0, 0.0]).is_none());
        assert!(look_at([0.0; 3], [0.0, 2.0, 0.0], [0.0, 1.0, 0.0]).is_none());
    }

    #[test]
    fn matrices_are_column_major() {
        let m = [1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 6.0, 7.0, 1.0];
        let t = matrix(&m).unwrap();
        close(t.transform_point3(DVec3::ONE), [6.0, 8.0, 8.0]);
        let mut projective = m;
        projective[11] = 1.0;
        assert!(matrix(&projective).is_none());
        let mut rounded = m;
        rounded[11] = 1e-9;
        assert_eq!(matrix(&rounded), Some(t));
        let mut singular = m;
        singular[5] = 0.0;
        assert!(matrix(&singular).is_some_and(|singular| invertible(singular).is_none()));
    }

    #[test]
    fn small_scales_are_regular_and_mirrors_swap() {
        assert!(invertible(scale([1e-50, 1e-50, 1e-50])).is_some());
        assert!(invertible(scale([1.0, 0.0, 1.0])).is_none());
        assert!(swaps_handedness(&scale([-1.0, 1.0, 1.0])));
        assert!(!swaps_handedness(&rotate(30.0, [1.0, 2.0, 3.0]).unwrap()));
    }

    #[test]
    fn normals_stay_perpendicular() {
        let t = scale([1.0, 4.0, 1.0]);
        let tangent = t.transform_vector3(DVec3::new(1.0, 1.0, 0.0));
        let normal = normal_matrix(&t) * DVec3::new(1.0, -1.0, 0.0);
        assert!(tangent.dot(normal).abs() < 1e-12);
        // Of what is flattened, the normal of the plane is left.
        let flat = normal_matrix(&scale([1.0, 1.0, 0.0]));
        assert_eq!((flat * DVec3::Z, flat * DVec3::X), (DVec3::Z, DVec3::ZERO));
    }

    #[test]
    fn roundings_are_told_from_changes() {
        let t = scale([1.0, 4.0, 1.0]);
        assert!(same(&t, &scale([1.0 + 1e-7, 4.0, 1.0])) && !same(&t, &scale([1.0 + 1e-5, 4.0, 1.0])));
        let far = translate([1e3, 0.0, 0.0]);
        assert!(
            same(&far, &translate([1e3 + 1e-4, 0.0, 0.0])) && !same(&far, &translate([1e3 + 1e-2, 0.0, 0.0]))
        );
        let turned = rotate(30.0, [1.0, 2.0, 3.0]).unwrap();
        assert!(keeps_angles(&(turned.matrix3 * 7.0)) && !keeps_angles(&t.matrix3));
    }
}
