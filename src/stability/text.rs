//! Small scenes as text in pbrt's format.

use crate::scene::Scene;
use std::fmt::Write;

/// A point or a vector, in double precision.
pub type Point = [f64; 3];

/// A scene that is being written: 16 x 16 pixels through a box filter, Sobol points.
#[derive(Clone, Debug)]
pub struct Text {
    camera: String,
    /// Longest path.
    pub depth: u32,
    /// Width and height of the image.
    pub resolution: [u32; 2],
    world: String,
}

impl Text {
    /// With a camera at `from` that looks at `at`; full field of view in degrees.
    pub fn look(from: Point, at: Point, fov: f64) -> Self {
        let d = [at[0] - from[0], at[1] - from[1], at[2] - from[2]];
        // Any axis that is not along the line of sight.
        let up = if d[2].abs() > 0.9 * (d[0].abs().max(d[1].abs())) { "0 1 0" } else { "0 0 1" };
        let camera = format!(
            "LookAt {} {} {up}\nCamera \"perspective\" \"float fov\" [{fov:e}]",
            numbers(&from),
            numbers(&at)
        );
        Text { camera, depth: 1, resolution: [16, 16], world: String::new() }
    }
    /// With a lens.
    pub fn lens(mut self, radius: f64, focal_distance: f64) -> Self {
        write!(
            self.camera,
            " \"float lensradius\" [{radius:e}] \"float focaldistance\" [{focal_distance:e}]"
        )
        .expect(STRING);
        self
    }
    /// Longest path.
    pub fn depth(mut self, depth: u32) -> Self {
        self.depth = depth;
        self
    }
    /// Size of the image.
    pub fn resolution(mut self, width: u32, height: u32) -> Self {
        self.resolution = [width, height];
        self
    }
    /// Adds directives.
    #[allow(clippy::should_implement_trait, reason = "text is added, not summed")]
    pub fn add(mut self, text: impl AsRef<str>) -> Self {
        self.world.push_str(text.as_ref());
        self.world.push('\n');
        self
    }
    /// Adds directives in a block of their own.
    pub fn block(self, text: impl AsRef<str>) -> Self {
        self.add(format!("AttributeBegin\n{}\nAttributeEnd", text.as_ref()))
    }
    /// A white sky.
    pub fn sky(self, radiance: f64) -> Self {
        self.add(format!("LightSource \"infinite\" \"rgb L\" [{radiance:e} {radiance:e} {radiance:e}]"))
    }
    /// The file.
    pub fn end(&self) -> String {
        let [width, height] = self.resolution;
        format!(
            "{}\nSampler \"sobol\" \"integer pixelsamples\" [64]\nIntegrator \"path\" \"integer maxdepth\" [{}]\n\
             PixelFilter \"box\"\nFilm \"rgb\" \"integer xresolution\" [{width}] \"integer yresolution\" [{height}]\n\
             WorldBegin\n{}",
            self.camera, self.depth, self.world
        )
    }
}

const STRING: &str = "a string takes everything";

/// Numbers with blanks between them, each as it is.
pub fn numbers(values: &[f64]) -> String {
    let mut text = String::new();
    for value in values {
        if !text.is_empty() {
            text.push(' ');
        }
        write!(text, "{value:e}").expect(STRING);
    }
    text
}

/// A diffuse material.
pub fn diffuse(reflectance: f64) -> String {
    format!("Material \"diffuse\" \"rgb reflectance\" [{reflectance:e} {reflectance:e} {reflectance:e}]")
}
/// A mirror whose reflectance is 1 in single precision at all angles: 1 - 2 eta.
pub fn perfect_mirror() -> String {
    "Material \"conductor\" \"rgb eta\" [1e-12 1e-12 1e-12] \"rgb k\" [1 1 1]".into()
}
/// A smooth dielectric.
pub fn glass(eta: f64) -> String {
    format!("Material \"dielectric\" \"float eta\" [{eta:e}]")
}
/// What follows emits.
pub fn emits(radiance: f64) -> String {
    format!("AreaLightSource \"diffuse\" \"rgb L\" [{radiance:e} {radiance:e} {radiance:e}]")
}
/// A lamp that reflects nothing: material and emission.
pub fn lamp(radiance: f64) -> String {
    format!("{}\n{}", diffuse(0.0), emits(radiance))
}
/// A sphere around a point.
pub fn sphere(centre: Point, radius: f64) -> String {
    format!("Translate {}\nShape \"sphere\" \"float radius\" [{radius:e}]", numbers(&centre))
}
/// Triangles.
pub fn mesh(points: &[Point], triangles: &[[usize; 3]]) -> String {
    let flat: Vec<f64> = points.iter().flatten().copied().collect();
    let indices: Vec<String> = triangles.iter().flatten().map(usize::to_string).collect();
    format!(
        "Shape \"trianglemesh\" \"point3 P\" [{}] \"integer indices\" [{}]",
        numbers(&flat),
        indices.join(" ")
    )
}
/// A quadrilateral, corners in turn.
pub fn quad(corners: [Point; 4]) -> String {
    mesh(&corners, &[[0, 1, 2], [0, 2, 3]])
}
/// A square of half side `half` in the plane y = `height`, its normal up.
pub fn floor(height: f64, half: f64) -> String {
    quad([[-half, height, -half], [-half, height, half], [half, height, half], [half, height, -half]])
}
/// A square of half side `half` in the plane y = `height`, its normal down.
pub fn ceiling(height: f64, half: f64) -> String {
    quad([[-half, height, -half], [half, height, -half], [half, height, half], [-half, height, half]])
}
/// A closed box, normals outwards.
pub fn cuboid(low: Point, high: Point) -> String {
    let corner = |i: usize| -> Point {
        core::array::from_fn(|k| if i >> (2 - k) & 1 == 0 { low[k] } else { high[k] })
    };
    let points: Vec<Point> = (0..8).map(corner).collect();
    mesh(&points, &CUBOID)
}

/// Triangles of a box whose corner number has the bits x, y, z; normals outwards.
pub const CUBOID: [[usize; 3]; 12] = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 6, 7],
    [4, 7, 5],
    [0, 4, 5],
    [0, 5, 1],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
    [1, 5, 7],
    [1, 7, 3],
];

/// A scene whose only light is a lamp of these shapes, with the camera at the origin: for its tables.
pub fn lit(shapes: &str) -> Scene {
    let text = Text::look([0.0; 3], [0.0, 0.0, 1.0], 40.0).block(format!("{}\n{shapes}", lamp(1.0)));
    Scene::parse(&text.end()).expect("the battery's own scene")
}

/// A point that looks down on the origin of a floor y = 0 at `theta` degrees from its normal, `distance` away.
pub fn above(theta: f64, distance: f64) -> Point {
    let theta = theta.to_radians();
    [distance * theta.sin(), distance * theta.cos(), 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_have_outward_normals() {
        let corner = |i: usize| [i >> 2 & 1, i >> 1 & 1, i & 1].map(|bit| bit as f64 * 2.0 - 1.0);
        for triangle in CUBOID {
            let [a, b, c] = triangle.map(corner).map(glam::DVec3::from);
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0, "{triangle:?}");
        }
    }

    #[test]
    fn scenes_are_read() {
        let text = Text::look([0.0, 2.0, 1e-7], [0.0; 3], 1e-3)
            .lens(1e3, 2.0)
            .sky(1e-30)
            .block(format!("{}\n{}", diffuse(0.5), sphere([0.0, 1e14, 0.0], 1.0)))
            .block(format!("{}\n{}", lamp(1e30), floor(0.0, 1.0)))
            .add(cuboid([-1.0; 3], [1.0; 3]));
        let scene = crate::Scene::parse(&text.end()).unwrap();
        assert_eq!(scene.description().shapes.len(), 3);
        assert!(scene.warnings().is_empty(), "{:?}", scene.warnings());
    }
}
