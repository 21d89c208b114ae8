//! Dielectrics: faint and strong, thin walls, total reflection.
//!
//! - *interface*: a glass floor over a black one: what it reflects of a white sky, [`exact::fresnel`].
//! - *furnace*: glass of any form in a white sky shows 1: what it takes from one direction comes from another.
//! - *sheet*: two parallel faces over a black floor: [`exact::pane`].
//! - *inside*: within glass of index eta the sky is eta^2 times as bright, in directions that can leave.
//! - *trapped*: rays that are totally reflected for ever bring nothing.

use super::text::{Text, above, ceiling, cuboid, diffuse, floor, glass, sphere};
use super::{Case, Computed, Tolerance, exact};
use wavepath_kernels::shade::fresnel;

const REFLECTED: Tolerance =
    Tolerance::relative(2e-3, "noise of choosing a side: of rare reflections, four million paths know 1e-5")
        .and(2e-5);
const FORMULA: Tolerance =
    Tolerance::relative(1e-4, "roundings of the index over its distance from 1, and of 1 itself").and(1e-7);
const FURNACE: Tolerance = Tolerance::relative(1e-4, "paths of 1000 bounces and more");
const SHEET: Tolerance = Tolerance::relative(3e-3, "noise of choosing a side");

/// Indices of which single precision holds the distance from 1: 2^-20 = 9.5e-7, 2^-10 = 9.8e-4.
const INDICES: [(&str, f64); 9] = [
    ("1", 1.0),
    ("1+1e-6", 1.0 + 1.0 / 1_048_576.0),
    ("1-1e-6", 1.0 - 1.0 / 1_048_576.0),
    ("1+1e-3", 1.0 + 1.0 / 1024.0),
    ("1-1e-3", 1.0 - 1.0 / 1024.0),
    ("1.5", 1.5),
    ("2/3", 2.0 / 3.0),
    ("10", 10.0),
    ("0.1", 0.1),
];

/// The family.
pub fn cases() -> Vec<Case> {
    let mut cases = interfaces();
    cases.extend(critical());
    cases.extend(furnaces());
    cases.extend(sheets());
    cases.extend(enclosed());
    cases
}

fn interfaces() -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, eta) in INDICES {
        for theta in [0.0, 45.0, 80.0, 89.9f64] {
            let fov = 0.01 * theta.to_radians().cos().max(1e-3);
            let scene = Text::look(above(theta, 2.0), [0.0; 3], fov)
                .depth(10)
                .sky(1.0)
                .block(format!("{}\n{}", glass(eta), floor(0.0, 3.0)))
                .block(format!("{}\n{}", diffuse(0.0), floor(-0.1, 1e4)));
            cases.push(
                Case::picture(
                    format!("glass/interface-{name}-{theta}"),
                    format!("reflectance of an interface of index {name} at {theta} degrees"),
                    scene.end(),
                    exact::fresnel(theta.to_radians(), eta),
                    REFLECTED,
                )
                .spp(1024),
            );
            // The formula alone, without noise, for the cosine as single precision has it.
            let cos = theta.to_radians().cos() as f32;
            let right = exact::fresnel(f64::from(cos).acos(), f64::from(eta as f32));
            cases.push(Case::compute(
                format!("glass/formula-{name}-{theta}"),
                format!("the formula's reflectance for index {name} at {theta} degrees"),
                right,
                FORMULA,
                move |_| f64::from(fresnel::dielectric::<f32>(cos, eta as f32).0),
            ));
        }
    }
    cases
}

/// Around the critical angle, in steps of the last place: the largest error of the reflectance.
fn critical() -> impl Iterator<Item = Case> {
    [1.000_976_6f32, 1.5, 2.4, 10.0].into_iter().map(|index| {
        Case::compute(
            format!("glass/critical-angle-{index}"),
            format!("reflectance within 64 roundings of the critical angle of index {index}: largest error"),
            0.0,
            Tolerance::relative(0.0, "the root of one rounding of cos^2, over the cosine").and(6e-3),
            move |_| {
                let eta = 1.0 / index;
                let wide = f64::from(eta);
                let critical = (1.0 - wide * wide).sqrt() as f32;
                let (mut worst, mut invalid) = (0.0f64, 0);
                for step in -64..=64i32 {
                    let cos = f32::from_bits(critical.to_bits().wrapping_add_signed(step));
                    let (found, cos_t, _) = fresnel::dielectric::<f32>(cos, eta);
                    let right = exact::fresnel(f64::from(cos).acos(), wide);
                    let possible = found.is_finite() && cos_t.is_finite() && (0.0..=1.0).contains(&found);
                    invalid += u64::from(!possible);
                    worst = worst.max((f64::from(found) - right).abs());
                }
                Computed { value: worst, invalid }
            },
        )
    })
}

fn furnace(name: String, what: String, shapes: &[String]) -> Case {
    let mut scene = Text::look([0.2, 0.1, 4.0], [0.0; 3], 30.0).depth(1000).sky(1.0);
    for shape in shapes {
        scene = scene.block(shape);
    }
    Case::picture(name, what, scene.end(), 1.0, FURNACE).spp(16)
}

fn furnaces() -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, eta) in INDICES {
        cases.push(furnace(
            format!("glass/furnace-{name}"),
            format!("ball of index {name} in a white sky"),
            &[format!("{}\n{}", glass(eta), sphere([0.0; 3], 1.0))],
        ));
    }
    for k in [1, 3, 5, 6, 7] {
        let wall = 10f64.powi(-k);
        cases.push(furnace(
            format!("glass/hollow-1e-{k}"),
            format!("hollow ball of glass, walls 1e-{k} thick, in a white sky"),
            &[
                format!("{}\n{}", glass(1.5), sphere([0.0; 3], 1.0)),
                format!("ReverseOrientation\n{}\n{}", glass(1.5), sphere([0.0; 3], 1.0 - wall)),
            ],
        ));
    }
    cases.push(furnace(
        "glass/nested".into(),
        "three balls of glass, each in the next, in a white sky".into(),
        &[
            format!("{}\n{}", glass(1.5), sphere([0.0; 3], 1.0)),
            format!("{}\n{}", glass(1.2), sphere([0.0; 3], 0.7)),
            format!("{}\n{}", glass(0.8), sphere([0.0; 3], 0.3)),
        ],
    ));
    cases.push(furnace(
        "glass/touching".into(),
        "two balls of glass that touch, in a white sky".into(),
        &[
            format!("{}\n{}", glass(1.5), sphere([-0.5, 0.0, 0.0], 0.5)),
            format!("{}\n{}", glass(1.5), sphere([0.5, 0.0, 0.0], 0.5)),
        ],
    ));
    cases.push(furnace(
        "glass/tangent-inside".into(),
        "a ball of air in one of glass, tangent from inside, in a white sky".into(),
        &[
            format!("{}\n{}", glass(1.5), sphere([0.0; 3], 1.0)),
            format!("ReverseOrientation\n{}\n{}", glass(1.5), sphere([0.0, 0.5, 0.0], 0.5)),
        ],
    ));
    cases
}

fn sheets() -> Vec<Case> {
    let mut cases = Vec::new();
    let black = format!("{}\n{}", diffuse(0.0), floor(-0.5, 3.0));
    for k in [1, 3, 5, 6, 7, 8] {
        let half = 0.5 * 10f64.powi(-k);
        let theta = 60.0;
        let scene = Text::look(above(theta, 2.0), [0.0; 3], 0.05)
            .depth(200)
            .sky(1.0)
            .block(format!("{}\n{}", glass(1.5), floor(half, 1.0)))
            .block(format!("{}\n{}", glass(1.5), ceiling(-half, 1.0)))
            .block(&black);
        cases.push(
            Case::picture(
                format!("glass/sheet-1e-{k}"),
                format!("a sheet of glass 1e-{k} thick over black, at {theta} degrees"),
                scene.end(),
                exact::pane(exact::fresnel(f64::to_radians(theta), 1.5)),
                SHEET,
            )
            .spp(1024),
        );
    }
    for (name, eta) in [("1", 1.0), ("1.5", 1.5), ("10", 10.0), ("1+1e-6", INDICES[1].1)] {
        for theta in [0.0, 60.0, 89.9f64] {
            let fov = 0.01 * theta.to_radians().cos().max(1e-3);
            let scene = Text::look(above(theta, 2.0), [0.0; 3], fov)
                .depth(10)
                .sky(1.0)
                .block(format!("Material \"thindielectric\" \"float eta\" [{eta:e}]\n{}", floor(0.0, 3.0)))
                .block(format!("{}\n{}", diffuse(0.0), floor(-0.1, 1e4)));
            cases.push(
                Case::picture(
                    format!("glass/thin-{name}-{theta}"),
                    format!("thin pane of index {name} over black, at {theta} degrees"),
                    scene.end(),
                    exact::pane(exact::fresnel(theta.to_radians(), eta)),
                    SHEET.and(2e-5),
                )
                .spp(1024),
            );
        }
    }
    cases
}

/// With the camera in the glass.
fn enclosed() -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, eta) in [("1", 1.0), ("1+1e-6", INDICES[1].1), ("1.5", 1.5), ("2.4", 2.4)] {
        // From a third of the radius all directions leave: sin of the angle at the surface is at most 1/3.
        let scene = Text::look([1.0 / 3.0, 0.0, 0.0], [0.3, 1.0, 0.2], 60.0)
            .depth(1000)
            .sky(1.0)
            .block(format!("{}\n{}", glass(eta), sphere([0.0; 3], 1.0)));
        let eta = f64::from(eta as f32);
        cases.push(
            Case::picture(
                format!("glass/inside-{name}"),
                format!("sky seen from inside of a ball of index {name}"),
                scene.end(),
                eta * eta,
                Tolerance::relative(1e-3, "noise of choosing a side"),
            )
            .spp(32),
        );
    }
    for depth in [10, 100, 1000] {
        // Along the diagonal of a cube every face is met at 54.7 degrees, beyond the critical 41.8.
        let scene = Text::look([0.1, 0.2, 0.15], [1.1, 1.2, 1.15], 1.0)
            .depth(depth)
            .resolution(8, 8)
            .sky(1.0)
            .block(format!("{}\n{}", glass(1.5), cuboid([-1.0; 3], [1.0; 3])));
        cases.push(Case::picture(
            format!("glass/trapped-{depth}"),
            format!("light that leaves a chain of {depth} total reflections"),
            scene.end(),
            0.0,
            Tolerance::EXACT,
        ));
    }
    cases
}
