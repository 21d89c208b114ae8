//! The camera.

use super::error::{BuildError, finite};
use super::filter::Filter;
use super::lights::SkyMapping;

/// What a [`Camera`] is made of: a perspective camera with a thin lens.
#[derive(Clone, Debug)]
pub struct CameraParts {
    /// World position of the pinhole, the centre of the lens.
    pub origin: [f32; 3],
    /// World direction through raster point (0, 0), on the plane at camera z = 1.
    pub corner: [f32; 3],
    /// Change of that direction for a pixel to the right.
    pub right: [f32; 3],
    /// Change of that direction for a pixel down.
    pub down: [f32; 3],
    /// The lens, if it is not a pinhole.
    pub lens: Option<Lens>,
    /// The reconstruction filter.
    pub filter: Filter,
}

/// A camera: perspective with a thin lens, if nothing else is said. All its numbers are finite.
#[derive(Clone, Debug)]
pub struct Camera {
    parts: CameraParts,
    projection: Projection,
}

/// How rays leave a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// From the centre of the lens through points of the image.
    Perspective,
    /// From points of the image, all in one direction. [`CameraParts::corner`] is then the way from the origin to the first of
    /// them.
    Orthographic {
        /// Unit direction in the world.
        axis: [f32; 3],
    },
    /// From the origin in all directions.
    Sphere {
        /// How the image covers them.
        mapping: SkyMapping,
        /// The axes of the map in the world: x, y and z of [`crate::sphere_maps`], of unit length.
        axes: [[f32; 3]; 3],
        /// Camera z in the world.
        axis: [f32; 3],
        /// 1 over the columns and rows of the full image.
        pixel: [f32; 2],
    },
}

impl Camera {
    /// Checks the parts.
    ///
    /// # Errors
    /// If a number is not finite, or the plane in focus is not in front of the lens.
    pub fn new(parts: CameraParts) -> Result<Self, BuildError> {
        let CameraParts { origin, corner, right, down, lens, filter: _ } = &parts;
        finite("camera", 0, "its position", origin)?;
        for (what, vector) in
            [("its first direction", corner), ("the step to the right", right), ("the step down", down)]
        {
            finite("camera", 0, what, vector)?;
        }
        if let Some(lens) = lens {
            finite("camera", 0, "an axis of its lens", &lens.x)?;
            finite("camera", 0, "an axis of its lens", &lens.y)?;
            finite("camera", 0, "the distance in focus", &[lens.focal_distance])?;
            if lens.focal_distance <= 0.0 {
                let what = format!("the distance in focus is {}; expected more than 0", lens.focal_distance);
                return Err(BuildError::Number { of: "camera", id: 0, what });
            }
        }
        Ok(Camera { parts, projection: Projection::Perspective })
    }
    /// The same with another projection.
    ///
    /// # Errors
    /// If a number is not finite.
    pub fn with_projection(self, projection: Projection) -> Result<Self, BuildError> {
        match &projection {
            Projection::Perspective => {}
            Projection::Orthographic { axis } => finite("camera", 0, "its axis", axis)?,
            Projection::Sphere { axes, axis, pixel, .. } => {
                finite("camera", 0, "an axis", axes.as_flattened())?;
                finite("camera", 0, "its axis", axis)?;
                finite("camera", 0, "the size of a pixel", pixel)?;
            }
        }
        Ok(Camera { projection, ..self })
    }
    /// How rays leave it.
    #[inline(always)]
    pub fn projection(&self) -> &Projection {
        &self.projection
    }
    /// World position of the pinhole, the centre of the lens.
    #[inline(always)]
    pub fn origin(&self) -> [f32; 3] {
        self.parts.origin
    }
    /// World direction through raster point (0, 0), on the plane at camera z = 1.
    #[inline(always)]
    pub fn corner(&self) -> [f32; 3] {
        self.parts.corner
    }
    /// Change of that direction for a pixel to the right.
    #[inline(always)]
    pub fn right(&self) -> [f32; 3] {
        self.parts.right
    }
    /// Change of that direction for a pixel down.
    #[inline(always)]
    pub fn down(&self) -> [f32; 3] {
        self.parts.down
    }
    /// The lens, if it is not a pinhole.
    #[inline(always)]
    pub fn lens(&self) -> Option<&Lens> {
        self.parts.lens.as_ref()
    }
    /// The reconstruction filter.
    #[inline(always)]
    pub fn filter(&self) -> &Filter {
        &self.parts.filter
    }
}

/// A thin lens.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// World vector from the centre of the lens to its rim, along camera x.
    pub x: [f32; 3],
    /// The same along camera y.
    pub y: [f32; 3],
    /// Distance of the plane in focus along camera z.
    pub focal_distance: f32,
}
