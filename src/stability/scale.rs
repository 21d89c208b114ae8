//! Scenes scaled, moved and turned: the same picture.
//!
//! - *lamp*: a square lamp of half side 0.1 at height 1 over a white floor, seen from aside: [`exact::square_above`].
//! - *ball*: a ball of albedo 1/2 under a white sky. It is convex, so every point sees the whole sky: 1/2, and any other
//!   value is light that got lost in the ball or shone through it. A box of triangles likewise.
//! - *closed*: a mirroring box closed around the camera, in a white sky: any value above 0 is a leak.

use super::text::{
    Point, Text, ceiling, cuboid, diffuse, floor, lamp, numbers, perfect_mirror, quad, sphere,
};
use super::{Case, Tolerance, exact};
use glam::{DMat4, DQuat, DVec3};

const LAMP: Tolerance =
    Tolerance::relative(1e-3, "the field of view of 0.2 degrees is worth 1e-5; the rest is noise");
const FURNACE: Tolerance =
    Tolerance::relative(1e-5, "every path brings the albedo times the sky, exactly; roundings of the film");
const DARK: Tolerance = Tolerance::EXACT;

/// Directions in which scenes are moved: no axis is special.
const AWAY: Point = [1.0, 0.7, 0.3];

fn plus(a: Point, b: Point) -> Point {
    core::array::from_fn(|k| a[k] + b[k])
}
fn times(a: Point, s: f64) -> Point {
    a.map(|x| x * s)
}
fn exponent(value: f64) -> String {
    format!("{value:e}")
}

/// The lamp over the floor, `s` times as large.
fn lamp_scene(s: f64) -> String {
    Text::look([0.3 * s, 2.0 * s, 0.0], [0.0; 3], 0.2)
        .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 5.0 * s)))
        .block(format!("{}\n{}", lamp(100.0), ceiling(s, 0.1 * s)))
        .end()
}

fn lamp_value() -> f64 {
    100.0 * exact::square_above(0.1, 1.0)
}

fn ball_scene(s: f64) -> String {
    Text::look([0.3 * s, 0.5 * s, 3.0 * s], [0.0; 3], 10.0)
        .depth(5)
        .sky(1.0)
        .add(diffuse(0.5))
        .add(sphere([0.0; 3], s))
        .end()
}

fn box_scene(s: f64, at: Point) -> String {
    let corner = |sign: f64| plus(times([0.9, 1.0, 1.1], sign * s), at);
    Text::look(plus(times([3.0, 4.0, 5.0], s), at), at, 8.0)
        .depth(5)
        .sky(1.0)
        .add(diffuse(0.5))
        .add(cuboid(corner(-1.0), corner(1.0)))
        .end()
}

fn closed_scene(s: f64) -> String {
    Text::look(times([0.1, 0.2, 0.3], s), times([0.5, 0.9, -0.4], s), 60.0)
        .depth(30)
        .sky(1.0)
        .add(perfect_mirror())
        .add(cuboid(times([-0.9, -1.0, -1.1], s), times([0.9, 1.0, 1.1], s)))
        .end()
}

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let scales = [-14, -12, -8, -6, -4, -3, -2, -1, 0, 1, 2, 3, 4, 6, 8, 12, 14];
    for k in scales {
        let s = 10f64.powi(k);
        let name = |what: &str| format!("scale/{what}-1e{k}");
        let what = |what: &str| format!("{what}, 1e{k} times as large");
        cases.push(Case::picture(
            name("lamp"),
            what("floor under a square lamp"),
            lamp_scene(s),
            lamp_value(),
            LAMP,
        ));
        cases.push(Case::picture(
            name("ball"),
            what("ball of albedo 1/2 in a white sky"),
            ball_scene(s),
            0.5,
            FURNACE,
        ));
        if k % 2 == 0 {
            cases.push(Case::picture(
                name("box"),
                what("box of albedo 1/2 in a white sky"),
                box_scene(s, [0.0; 3]),
                0.5,
                FURNACE,
            ));
            cases.push(Case::picture(
                name("closed"),
                what("light that leaks into a closed mirror box"),
                closed_scene(s),
                0.0,
                DARK,
            ));
        }
    }
    cases.extend(by_transform());
    cases.extend(moved());
    cases.extend(turned());
    cases.extend(small_beside_large());
    cases
}

/// Scaled by `Scale` instead of by coordinates.
fn by_transform() -> impl Iterator<Item = Case> {
    [-8, -4, 4, 8].into_iter().map(|k| {
        let s = 10f64.powi(k);
        let scene = Text::look([0.3 * s, 2.0 * s, 0.0], [0.0; 3], 0.2)
            .add(format!("Scale {s:e} {s:e} {s:e}"))
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 5.0)))
            .block(format!("{}\n{}", lamp(100.0), ceiling(1.0, 0.1)));
        Case::picture(
            format!("scale/lamp-by-transform-1e{k}"),
            format!("floor under a square lamp, under Scale 1e{k}"),
            scene.end(),
            lamp_value(),
            LAMP,
        )
    })
}

/// Moved by many times their size, by a transform.
fn moved() -> Vec<Case> {
    let mut cases = Vec::new();
    for k in 1..=7 {
        let distance = 10f64.powi(k);
        // Diameters of the ball, which is 2.
        let at = times(AWAY, 2.0 * distance);
        let scene = Text::look(plus([0.3, 0.5, 3.0], at), at, 10.0)
            .depth(5)
            .sky(1.0)
            .add(diffuse(0.5))
            .add(sphere(at, 1.0));
        cases.push(
            Case::picture(
                format!("moved/ball-1e{k}"),
                format!("ball of albedo 1/2 in a white sky, moved by 1e{k} diameters"),
                scene.end(),
                0.5,
                FURNACE,
            )
            .input(plus([0.3, 0.5, 3.0], at), 1.0),
        );
        let scene = Text::look(plus([0.3, 2.0, 0.0], at), at, 0.2)
            .add(format!("Translate {}", numbers(&at)))
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 5.0)))
            .block(format!("{}\n{}", lamp(100.0), ceiling(1.0, 0.1)));
        let corners = [plus(at, [0.1, 1.0, 0.1]), plus(at, [-0.1, 1.0, -0.1]), plus(at, [0.3, 2.0, 0.0])];
        cases.push(
            Case::picture(
                format!("moved/lamp-1e{k}"),
                format!("floor under a square lamp, moved by 1e{k} times twice its height"),
                scene.end(),
                lamp_value(),
                LAMP,
            )
            .input(corners.concat(), 0.1),
        );
        cases.push(
            Case::picture(
                format!("moved/box-1e{k}"),
                format!("box of albedo 1/2 in a white sky, moved by 1e{k} diameters"),
                box_scene(1.0, at),
                0.5,
                FURNACE,
            )
            .input(plus([0.9, 1.0, 1.1], at), 1.0),
        );
    }
    cases
}

/// Turned about axes that are none of the scene's, with the camera.
fn turned() -> Vec<Case> {
    let axes = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 2.0, 3.0], [-3.0, 1.0, 0.5], [0.3, -0.7, 2.0], AWAY];
    let one = |(index, axis): (usize, Point)| {
        let degrees = 17.0 + 61.0 * index as f64;
        let turn = DQuat::from_axis_angle(DVec3::from(axis).normalize(), degrees.to_radians());
        let matrix = DMat4::from_quat(turn).to_cols_array();
        let eye = turn * DVec3::new(0.3, 2.0, 0.0);
        let scene = Text::look(eye.into(), [0.0; 3], 0.2)
            .add(format!("Transform [{}]", numbers(&matrix)))
            .block(format!("{}\n{}", diffuse(1.0), floor(0.0, 5.0)))
            .block(format!("{}\n{}", lamp(100.0), ceiling(1.0, 0.1)));
        Case::picture(
            format!("turned/lamp-{degrees}"),
            format!("floor under a square lamp, turned by {degrees} degrees about {axis:?}"),
            scene.end(),
            lamp_value(),
            LAMP,
        )
    };
    axes.into_iter().enumerate().map(one).collect()
}

/// A ball far from something large and black, seen from its far side, which only sees the sky; and a square on the large
/// thing's surface plane.
fn small_beside_large() -> Vec<Case> {
    let ratio = |k: i32| {
        let large = 10f64.powi(k);
        let scene = Text::look([0.0, 0.0, 3.0], [0.0; 3], 5.0)
            .depth(5)
            .sky(1.0)
            .block(format!("{}\n{}", diffuse(0.0), sphere([0.0, 0.0, -10.0 * large], large)))
            .block(format!("{}\n{}", diffuse(0.5), sphere([0.0; 3], 1.0)));
        Case::picture(
            format!("scale/ball-beside-{}", exponent(large)),
            format!("ball of albedo 1/2, on the far side of a black one 1e{k} times as large"),
            scene.end(),
            0.5,
            Tolerance::relative(1e-3, "points beside the middle of the ball see a little of the large one"),
        )
    };
    let wall = |k: i32| {
        let large = 10f64.powi(k);
        // A white square of side 1 just before a black wall as large: it sees nothing but the sky before it.
        let wall = quad([
            [-large, -large, -1.0],
            [large, -large, -1.0],
            [large, large, -1.0],
            [-large, large, -1.0],
        ]);
        let square = quad([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]]);
        let scene = Text::look([0.1, 0.2, 3.0], [0.0; 3], 3.0)
            .depth(5)
            .sky(1.0)
            .block(format!("{}\n{wall}", diffuse(0.0)))
            .block(format!("{}\n{square}", diffuse(0.5)));
        Case::picture(
            format!("scale/square-before-{}", exponent(large)),
            format!("square of albedo 1/2 before a black wall 1e{k} times as large"),
            scene.end(),
            0.5,
            FURNACE,
        )
    };
    [2, 4, 6].into_iter().map(ratio).chain([2, 4, 6, 8].into_iter().map(wall)).collect()
}
