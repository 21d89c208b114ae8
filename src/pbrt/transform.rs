//! Transforms in double precision, and the checks that keep impossible ones out.

use glam::{DAffine3, DMat3, DVec3};

/// A translation.
pub(crate) fn translate(v: [f64; 3]) -> DAffine3 {
    DAffine3::from_translation(DVec3::from_array(v))
}

/// A scale; `None` if a factor is 0.
pub(crate) fn scale(v: [f64; 3]) -> Option<DAffine3> {
    invertible(DAffine3::from_scale(DVec3::from_array(v)))
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

/// Why sixteen numbers are not an affine transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MatrixError {
    /// The fourth row is not (0, 0, 0, w) with w not 0.
    Projective,
    /// It cannot be inverted.
    Singular,
}

/// A transform from sixteen numbers as they stand in a file: column-major, the translation in 12..15.
pub(crate) fn matrix(m: &[f64; 16]) -> Result<DAffine3, MatrixError> {
    if m[3] != 0.0 || m[7] != 0.0 || m[11] != 0.0 || m[15] == 0.0 {
        return Err(MatrixError::Projective);
    }
    let column = |i: usize| DVec3::new(m[i], m[i + 1], m[i + 2]) / m[15];
    let affine =
        DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(4), column(8)), column(12));
    invertible(affine).ok_or(MatrixError::Singular)
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

/// Whether the transform turns left-handed systems into right-handed ones.
pub(crate) fn swaps_handedness(transform: &DAffine3) -> bool {
    transform.matrix3.determinant() < 0.0
}

/// The matrix for normals: the inverse's transpose.
pub(crate) fn normal_matrix(transform: &DAffine3) -> DMat3 {
    transform.matrix3.inverse().transpose()
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
        assert_eq!(matrix(&projective), Err(MatrixError::Projective));
        let mut singular = m;
        singular[5] = 0.0;
        assert_eq!(matrix(&singular), Err(MatrixError::Singular));
    }

    #[test]
    fn small_scales_are_regular_and_mirrors_swap() {
        assert!(scale([1e-50, 1e-50, 1e-50]).is_some());
        assert!(scale([1.0, 0.0, 1.0]).is_none());
        assert!(swaps_handedness(&scale([-1.0, 1.0, 1.0]).unwrap()));
        assert!(!swaps_handedness(&rotate(30.0, [1.0, 2.0, 3.0]).unwrap()));
    }

    #[test]
    fn normals_stay_perpendicular() {
        let t = scale([1.0, 4.0, 1.0]).unwrap();
        let tangent = t.transform_vector3(DVec3::new(1.0, 1.0, 0.0));
        let normal = normal_matrix(&t) * DVec3::new(1.0, -1.0, 0.0);
        assert!(tangent.dot(normal).abs() < 1e-12);
    }
}
