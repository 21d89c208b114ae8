//! Cameras: narrow and wide, with lenses, in lamps; small and long images.
//!
//! - *fov*: a square lamp in the plane z = 1 whose half side is half the tangent of half the field of view fills a quarter
//!   of the picture: raster coordinates are linear in the tangent.
//! - *lens*: the same in the plane of focus, which a lens of any radius shows as the pinhole does.
//! - *image*: a sky of 1/2 in images of all forms.

use super::text::{Text, lamp, quad, sphere};
use super::{Case, Tolerance};

const QUARTER: Tolerance = Tolerance::relative(1e-3, "noise of the outline");
const SKY: Tolerance = Tolerance::relative(1e-6, "seen as it is");

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let square =
        |half: f64, z: f64| quad([[-half, -half, z], [-half, half, z], [half, half, z], [half, -half, z]]);
    for fov in [1e-4, 1e-3, 1e-1, 1.0, 45.0, 90.0, 150.0, 170.0, 179.0] {
        let half = 0.5 * f64::tan(f64::to_radians(fov) / 2.0);
        let scene = Text::look([0.0; 3], [0.0, 0.0, 1.0], fov).block(format!(
            "{} \"bool twosided\" true\n{}",
            lamp(1.0),
            square(half, 1.0)
        ));
        cases.push(Case::picture(
            format!("cameras/fov-{fov:e}"),
            format!("square that fills a quarter of a picture of {fov:e} degrees"),
            scene.end(),
            0.25,
            QUARTER,
        ));
    }
    for radius in [0.0, 1e-6, 1e-3, 1.0, 1e3] {
        let half = 0.5 * f64::tan(f64::to_radians(40.0) / 2.0);
        let scene = Text::look([0.0; 3], [0.0, 0.0, 1.0], 40.0).lens(radius, 1.0).block(format!(
            "{} \"bool twosided\" true\n{}",
            lamp(1.0),
            square(half, 1.0)
        ));
        cases.push(Case::picture(
            format!("cameras/lens-{radius:e}"),
            format!("square in focus that fills a quarter, through a lens of radius {radius:e}"),
            scene.end(),
            0.25,
            // A point in focus is off by roundings of the lens' coordinates.
            Tolerance::relative(
                1e-3 + 1e-6 * radius,
                "noise of the outline; roundings of points of the lens",
            ),
        ));
    }
    for (name, radius) in [("1e-6", 1e-6), ("1", 1.0), ("1e6", 1e6)] {
        let scene = Text::look([0.3 * radius, 0.0, 0.0], [1.0 * radius, radius, 0.2 * radius], 120.0)
            .block(format!("ReverseOrientation\n{}\n{}", lamp(1.0), sphere([0.0; 3], radius)));
        cases.push(Case::picture(
            format!("cameras/in-a-lamp-{name}"),
            format!("from inside of a lamp of radius {name}"),
            scene.end(),
            1.0,
            SKY,
        ));
    }
    for (width, height) in [(1, 1), (1, 3), (17, 1), (1, 65_536), (65_536, 1)] {
        let scene = Text::look([0.0; 3], [0.0, 0.0, 1.0], 60.0).resolution(width, height).sky(0.5);
        cases.push(
            Case::picture(
                format!("cameras/image-{width}x{height}"),
                format!("sky in an image of {width} x {height}"),
                scene.end(),
                0.5,
                SKY,
            )
            .spp(2),
        );
    }
    for distance in [1e-6, 1e6] {
        let half = 0.5 * distance * f64::tan(f64::to_radians(40.0) / 2.0);
        let scene = Text::look([0.0; 3], [0.0, 0.0, distance], 40.0)
            .lens(0.1 * distance, distance)
            .block(format!("{} \"bool twosided\" true\n{}", lamp(1.0), square(half, distance)));
        cases.push(Case::picture(
            format!("cameras/focus-{distance:e}"),
            format!("square in focus at {distance:e} that fills a quarter"),
            scene.end(),
            0.25,
            QUARTER,
        ));
    }
    cases
}
