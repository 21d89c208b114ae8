//! Engines, traversals, threads, pools and instruction sets: the same bits where they are promised.
//!
//! What is counted is pixels that differ from those of the wavefront on one thread. The baseline instruction set has no
//! fused multiply-add and rounds otherwise: it is only held to itself.

use super::text::{Text, ceiling, cuboid, diffuse, floor, glass, lamp, mesh, perfect_mirror, sphere};
use super::{Case, Computed, Tolerance};
use crate::engine::EngineKind;
use crate::render::Render;
use crate::scene::Scene;
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

/// A scene with every kind of surface, and stiff ones.
fn scenes() -> Vec<(&'static str, String)> {
    let mixed = Text::look([0.3, 1.2, 4.0], [0.0, 0.6, 0.0], 50.0)
        .resolution(24, 24)
        .depth(8)
        .sky(0.3)
        .block(format!("{}\n{}", diffuse(0.6), floor(0.0, 4.0)))
        .block(format!("{}\n{}", lamp(5.0), ceiling(3.0, 0.5)))
        .block(format!("{}\n{}", lamp(20.0), sphere([1.5, 2.0, 0.5], 0.1)))
        .block(format!("{}\n{}", glass(1.5), sphere([-0.9, 0.5, 0.6], 0.5)))
        .block(format!("{}\n{}", perfect_mirror(), sphere([0.4, 0.4, -0.4], 0.4)))
        .block(format!(
            "{} \"float roughness\" 0.1\nTranslate 1.2 0.3 0.8\n{}",
            perfect_mirror(),
            cuboid([-0.3; 3], [0.3; 3])
        ))
        .block(format!("{} \"float sigma\" 30\nTranslate 0 0.2 1.4\nScale 1 0.3 1\nShape \"sphere\" \"float radius\" 0.3", diffuse(0.8)));
    // A closed box stretched by 1e4, seen from inside, with a mirroring wall.
    let stretched = Text::look([0.1, 0.2, 0.3], [0.5, 1.0, 0.1], 80.0)
        .resolution(24, 24)
        .depth(20)
        .sky(1.0)
        .add(perfect_mirror())
        .add(cuboid([-1.0, -1e4, -1.0], [1.0, 1e4, 1.0]));
    let strip = mesh(
        &[[-1e5, 0.0, -0.07], [-1e5, 0.0, 0.08], [1e5, 0.0, 0.08], [1e5, 0.0, -0.07]],
        &[[0, 1, 2], [0, 2, 3]],
    );
    let long = Text::look([0.3, 1.5, 0.1], [0.0; 3], 20.0)
        .resolution(24, 24)
        .depth(4)
        .sky(1.0)
        .block(format!("{}\n{strip}", diffuse(0.8)))
        .block(format!("{}\n{}", diffuse(0.2), sphere([0.0, -1e5 - 0.01, 0.0], 1e5)));
    vec![("mixed", mixed.end()), ("stretched", stretched.end()), ("long", long.end())]
}

#[derive(Clone, Copy)]
struct Choice {
    engine: EngineKind,
    policy: Policy,
    threads: usize,
    batch: usize,
    level: Option<Level>,
}

const PLAIN: Choice = Choice {
    engine: EngineKind::Wavefront,
    policy: Policy::Auto,
    threads: 1,
    batch: crate::engine::wavefront::DEFAULT_BATCH,
    level: None,
};

fn pixels(scene: &Scene, choice: Choice, level: Level) -> Vec<[f32; 3]> {
    let render = Render::new(scene)
        .spp(16)
        .seed(5)
        .engine(choice.engine)
        .traversal(choice.policy)
        .threads(choice.threads)
        .batch(choice.batch)
        .level(choice.level.unwrap_or(level));
    render.run().expect("a small picture").into_image().pixels
}

fn differing(text: &str, choice: Choice, level: Level) -> Computed {
    let scene = Scene::parse(text).expect("the battery's own scene");
    // Fused sets agree with each other, the baseline with itself.
    let of = choice.level.unwrap_or(level);
    let reference = if of == Level::BASELINE { Level::BASELINE } else { level };
    let (a, b) = (pixels(&scene, PLAIN, reference), pixels(&scene, choice, level));
    let bits = |p: &[f32; 3]| p.map(f32::to_bits);
    (a.iter().zip(&b).filter(|(a, b)| bits(a) != bits(b)).count() as f64).into()
}

/// The family.
pub fn cases() -> Vec<Case> {
    let mut choices: Vec<(String, Choice)> = vec![
        ("megakernel".into(), Choice { engine: EngineKind::Megakernel, ..PLAIN }),
        ("megakernel-wide".into(), Choice { engine: EngineKind::MegakernelWide, ..PLAIN }),
        ("single".into(), Choice { policy: Policy::Single, ..PLAIN }),
        ("mixed".into(), Choice { policy: Policy::Mixed, ..PLAIN }),
        ("packets".into(), Choice { policy: Policy::Packets, ..PLAIN }),
        ("sorted".into(), Choice { policy: Policy::Sorted, ..PLAIN }),
        ("interleaved".into(), Choice { policy: Policy::Interleaved, ..PLAIN }),
        ("three-threads".into(), Choice { threads: 3, ..PLAIN }),
        ("small-pool".into(), Choice { batch: 64, ..PLAIN }),
    ];
    for level in Level::available() {
        choices.push((level.name().into(), Choice { level: Some(level), ..PLAIN }));
        let megakernel = Choice { engine: EngineKind::Megakernel, level: Some(level), ..PLAIN };
        choices.push((format!("megakernel-{}", level.name()), megakernel));
    }
    let mut cases = Vec::new();
    for (scene, text) in scenes() {
        for (name, choice) in &choices {
            let (text, choice) = (text.clone(), *choice);
            cases.push(Case::compute(
                format!("bits/{scene}-{name}"),
                format!("pixels of the scene \"{scene}\" that differ with {name}"),
                0.0,
                Tolerance::EXACT,
                move |subject| differing(&text, choice, subject.level),
            ));
        }
    }
    cases
}
