//! Moves a camera: to a place, around what it looks at, as on a turntable.

use crate::pbrt::transform;
use glam::{DAffine3, DMat3, DVec3};

/// Where a camera is put. What is not given stays as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// World position of the camera.
    pub eye: Option<DVec3>,
    /// World point that it looks at.
    pub look: Option<DVec3>,
    /// World direction that is up in the image.
    pub up: Option<DVec3>,
    /// Moves camera and target, in the world.
    pub shift: DVec3,
    /// Degrees around the axis through the target that points up, counter-clockwise seen from above.
    pub orbit: f64,
    /// Degrees upwards around the target, after `orbit`.
    pub elevate: f64,
}

impl Pose {
    /// The transform of a camera at this pose, from that of the camera as it is. `target` is what it looks at and `up` the
    /// direction that its description calls up, both in the world, as far as they are known. Whatever else the transform
    /// does (mirror, scale, roll) stays.
    ///
    /// # Errors
    /// In words, what would have to be given.
    pub fn of(
        &self,
        world_from_camera: DAffine3,
        target: Option<DVec3>,
        up: Option<DVec3>,
    ) -> Result<DAffine3, &'static str> {
        const NO_FRAME: &str = "expected a point to look at that is not where the camera is, and an up that is not \
                                parallel to the view";
        let turns = self.orbit != 0.0 || self.elevate != 0.0;
        if turns && target.is_none() && self.look.is_none() {
            return Err("expected camera.look, too: no LookAt says around which point");
        }
        let eye = world_from_camera.translation;
        let ahead = world_from_camera.matrix3.z_axis.try_normalize().ok_or(NO_FRAME)?;
        let up = up.unwrap_or(world_from_camera.matrix3.y_axis);
        let old = frame(eye, target.unwrap_or(eye + ahead), up).ok_or(NO_FRAME)?;
        let new_up = self.up.unwrap_or(up);
        let mut new_eye = self.eye.unwrap_or(eye);
        // Without a target, the camera keeps its direction.
        let mut look = self.look.or(target).unwrap_or(new_eye + ahead);
        new_eye += self.shift;
        look += self.shift;
        if turns {
            let turn = |degrees, axis: DVec3, v: DVec3| {
                transform::rotate(degrees, axis.to_array()).map(|rotation| rotation.transform_vector3(v))
            };
            let offset = turn(self.orbit, new_up, new_eye - look).ok_or(NO_FRAME)?;
            let right = new_up.cross(-offset);
            let offset = match self.elevate {
                0.0 => offset,
                degrees => {
                    let turned = turn(degrees, right, offset).ok_or(NO_FRAME)?;
                    // Over the top, up would be down.
                    if new_up.cross(-turned).dot(right) <= 0.0 {
                        return Err("expected camera.elevate to stay below the zenith and above the nadir");
                    }
                    turned
                }
            };
            new_eye = look + offset;
        }
        let new = frame(new_eye, look, new_up).ok_or(NO_FRAME)?;
        // Exactly the same where nothing changes.
        if new == old {
            return Ok(world_from_camera);
        }
        Ok(new * (old.inverse() * world_from_camera))
    }
}

/// Orthonormal: right, up, ahead.
fn frame(eye: DVec3, look: DVec3, up: DVec3) -> Option<DAffine3> {
    let ahead = (look - eye).try_normalize()?;
    let right = up.try_normalize()?.cross(ahead);
    if right.length() < 1e-12 {
        return None;
    }
    let right = right.normalize();
    Some(DAffine3::from_mat3_translation(DMat3::from_cols(right, ahead.cross(right), ahead), eye))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> DAffine3 {
        transform::look_at([0.0, 0.0, -5.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]).unwrap().inverse()
    }

    #[test]
    fn orbits_keep_the_distance_and_the_aim() {
        let pose = Pose { orbit: 90.0, ..Pose::default() };
        let turned = pose.of(camera(), Some(DVec3::ZERO), Some(DVec3::Y)).unwrap();
        // Right-handed about y: -z goes to -x.
        assert!((turned.translation - DVec3::new(-5.0, 0.0, 0.0)).length() < 1e-12, "{turned}");
        assert!((turned.matrix3.z_axis - DVec3::X).length() < 1e-12);
        assert!((turned.matrix3.y_axis - DVec3::Y).length() < 1e-12);
        let pose = Pose { elevate: 30.0, ..Pose::default() };
        let raised = pose.of(camera(), Some(DVec3::ZERO), Some(DVec3::Y)).unwrap();
        assert!((raised.translation - DVec3::new(0.0, 2.5, -5.0 * 0.75f64.sqrt())).length() < 1e-12);
        assert!(Pose { elevate: 95.0, ..pose }.of(camera(), Some(DVec3::ZERO), Some(DVec3::Y)).is_err());
        assert!(pose.of(camera(), None, None).unwrap_err().contains("camera.look"));
    }

    #[test]
    fn mirrors_stay() {
        let mirrored = camera() * DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let pose = Pose { eye: Some(DVec3::new(3.0, 4.0, 0.0)), ..Pose::default() };
        let moved = pose.of(mirrored, Some(DVec3::ZERO), Some(DVec3::Y)).unwrap();
        let plain = pose.of(camera(), Some(DVec3::ZERO), Some(DVec3::Y)).unwrap();
        assert!((moved.matrix3.x_axis + plain.matrix3.x_axis).length() < 1e-12);
        assert!((moved.matrix3.z_axis - plain.matrix3.z_axis).length() < 1e-12);
        assert!((plain.matrix3.z_axis * 5.0 + DVec3::new(3.0, 4.0, 0.0)).length() < 1e-12);
    }

    #[test]
    fn nothing_changes_nothing() {
        assert_eq!(Pose::default().of(camera(), Some(DVec3::ZERO), Some(DVec3::Y)), Ok(camera()));
        let shifted = Pose { shift: DVec3::X, ..Pose::default() }.of(camera(), None, None).unwrap();
        assert!((shifted.translation - DVec3::new(1.0, 0.0, -5.0)).length() < 1e-12);
        assert!((shifted.matrix3.z_axis - DVec3::Z).length() < 1e-12);
    }
}
