//! Spheres: tiny, huge, near, far, stretched.
//!
//! - *far*: a spherical lamp that fills the picture, from up to 1e7 radii: 1.
//! - *ball-on-sphere*: a black ball of radius 1 on a spherical ground; the ground half a radius beside its foot loses
//!   0.8^1.5 of the sky, and what the curve of the ground takes or gives is of the order of 1 / its radius.
//! - *near*: a camera 1e-k from the surface.
//! - *stretched*: an ellipsoid of albedo 1/2 is convex: 1/2.

use super::text::{Text, diffuse, emits, lamp, sphere};
use super::{Case, Tolerance};

const SEEN: Tolerance = Tolerance::relative(1e-6, "every ray meets it");
const FURNACE: Tolerance = Tolerance::relative(1e-5, "every path brings the albedo times the sky, exactly");

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases = far();
    cases.extend(grounds());
    cases.extend(near());
    cases.extend(stretched());
    cases.extend(disks());
    cases
}

fn far() -> Vec<Case> {
    let mut cases = Vec::new();
    for k in 1..=7 {
        let ratio = 10f64.powi(k);
        for radius in [1e-6, 1.0, 1e6] {
            let distance = ratio * radius;
            // A quarter of its diameter.
            let scene = Text::look([0.0, 0.0, distance], [0.0; 3], (0.5 / ratio).to_degrees())
                .block(format!("{}\n{}", lamp(1.0), sphere([0.0; 3], radius)));
            cases.push(
                Case::picture(
                    format!("spheres/far-1e{k}-radius-{radius:e}"),
                    format!("spherical lamp of radius {radius:e} that fills the picture, from 1e{k} radii"),
                    scene.end(),
                    1.0,
                    SEEN,
                )
                .spp(16),
            );
        }
    }
    // Twice as wide as the lamp: pi / 16 of the picture, whose corners are misses.
    for k in [2, 4, 6] {
        let ratio = 10f64.powi(k);
        // Tangent of the lamp's outline is 1 / sqrt(ratio^2 - 1).
        let outline = 1.0 / (ratio * ratio - 1.0).sqrt();
        let scene = Text::look([0.0, 0.0, ratio], [0.0; 3], 2.0 * (2.0 * outline).atan().to_degrees())
            .resolution(32, 32)
            .block(format!("{}\n{}", lamp(1.0), sphere([0.0; 3], 1.0)));
        cases.push(Case::picture(
            format!("spheres/outline-1e{k}"),
            format!("share of the picture that a sphere fills, from 1e{k} radii"),
            scene.end(),
            std::f64::consts::PI / 16.0,
            Tolerance::relative(1e-3, "noise of the outline; directions are rounded to 1e-7"),
        ));
    }
    cases
}

fn grounds() -> Vec<Case> {
    let mut cases = Vec::new();
    for (k, small) in [(2, 1.0), (3, 1.0), (4, 1.0), (5, 1.0), (6, 1.0), (6, 1e-1), (6, 1e-2), (6, 1e-3)] {
        let ground = 10f64.powi(k);
        let scene = Text::look([3.5 * small, 1.5 * small, 0.0], [0.5 * small, 0.0, 0.0], 0.05)
            .depth(1)
            .sky(1.0)
            .block(format!("{}\n{}", diffuse(1.0), sphere([0.0, -ground, 0.0], ground)))
            .block(format!("{}\n{}", diffuse(0.0), sphere([0.0, small, 0.0], small)));
        cases.push(Case::picture(
            format!("spheres/ball-{small:e}-on-1e{k}"),
            format!("ground of radius 1e{k} beside a black ball of radius {small:e} on it"),
            scene.end(),
            1.0 - 0.8f64.powf(1.5),
            Tolerance::relative(2e-3 + 2.0 * small / ground, "noise; the curve of the ground"),
        ));
    }
    for k in [1, 3, 5, 6, 7] {
        let ground = 10f64.powi(k);
        let scene = Text::look([3.0, 1.0, 0.0], [0.0; 3], 0.5)
            .depth(5)
            .sky(1.0)
            .add(diffuse(0.5))
            .add(sphere([0.0, -ground, 0.0], ground));
        cases.push(Case::picture(
            format!("spheres/ground-1e{k}"),
            format!("ground of albedo 1/2 and radius 1e{k} under a white sky, from 3"),
            scene.end(),
            0.5,
            FURNACE,
        ));
    }
    cases
}

/// Rays that start near the surface.
fn near() -> Vec<Case> {
    let mut cases = Vec::new();
    for radius in [1.0, 1e4] {
        for k in [2, 4, 6] {
            let gap = radius * 10f64.powi(-k);
            let shape = |turned: &str| {
                format!("{turned}\n{}\n{}\n{}", diffuse(0.5), emits(1.0), sphere([0.0; 3], radius))
            };
            let outside = radius + gap;
            let one = |name: &str, what: &str, from: f64, to: f64, turned: &str, expected: f64| {
                let scene = Text::look([0.0, 0.0, from], [0.0, 0.0, to], 20.0).depth(0).block(shape(turned));
                Case::picture(
                    format!("spheres/{name}-{radius:e}-1e-{k}"),
                    format!("{what}, 1e-{k} radii from a lamp of radius {radius:e}"),
                    scene.end(),
                    expected,
                    SEEN,
                )
                .spp(4)
            };
            cases.push(one("towards", "looking at it", outside, 0.0, "", 1.0));
            cases.push(one("away", "looking away from it", outside, 2.0 * radius, "", 0.0));
            let turned = "ReverseOrientation";
            cases.push(one("outwards", "looking out from inside", radius - gap, 2.0 * radius, turned, 1.0));
            cases.push(one("across", "looking across from inside", radius - gap, 0.0, turned, 1.0));
        }
    }
    cases
}

fn stretched() -> impl Iterator<Item = Case> {
    [-3, -2, -1, 1, 2, 3].into_iter().flat_map(|k| {
        let s = 10f64.powi(k);
        let one = |axis: usize| {
            let mut scale = [1.0; 3];
            scale[axis] = s;
            // The picture is filled by it: a tenth of its shortest half axis, at the distance of its longest.
            let distance = 3.0 * s.max(1.0);
            let eye = [0.6, 0.5, 0.62].map(|x: f64| x * distance);
            let fov = (0.2 * s.min(1.0) / distance).to_degrees();
            let scene = Text::look(eye, [0.0; 3], fov)
                .depth(5)
                .sky(1.0)
                .add(diffuse(0.5))
                .add(format!("Scale {}", super::text::numbers(&scale)))
                .add("Shape \"sphere\"");
            Case::picture(
                format!("spheres/stretched-1e{k}-{}", ["x", "y", "z"][axis]),
                format!("ellipsoid of albedo 1/2, stretched by 1e{k} along {}", ["x", "y", "z"][axis]),
                scene.end(),
                0.5,
                FURNACE,
            )
        };
        [one(0), one(2)]
    })
}

fn disks() -> impl Iterator<Item = Case> {
    [-6, 0, 6].into_iter().map(|k| {
        let s = 10f64.powi(k);
        let scene = Text::look([0.0, 0.5 * s, 2.0 * s], [0.0; 3], 5.0)
            .depth(5)
            .sky(1.0)
            .add(diffuse(0.5))
            .add(format!("Shape \"disk\" \"float radius\" [{s:e}]"));
        Case::picture(
            format!("spheres/disk-1e{k}"),
            format!("disk of albedo 1/2 and radius 1e{k} under a white sky"),
            scene.end(),
            0.5,
            FURNACE,
        )
    })
}
