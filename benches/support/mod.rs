//! What the benches share: scenes, small and large, and the queues of real rounds of them.
#![allow(dead_code)] // Each bench uses its own part.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use criterion::{Bencher, Criterion};

use wavepath::engine::schedule::{Schedule, Stop};
use wavepath::engine::wavefront::DEFAULT_BATCH;
use wavepath::engine::wavefront::record::{Round, record};
use wavepath::engine::{Done, EngineKind, Job, SamplerKind, Settings};
use wavepath::film::Film;
use wavepath::meshes::{Menger, Terrain, TorusKnot};
use wavepath::plan::Plan;
use wavepath::scene::{self, Mesh, Parameter, SceneDescription, SphericalLights};
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::isa::Level;
use wavepath_kernels::sampler::Sobol;
use wavepath_kernels::scene::Scene;
use wavepath_kernels::scene::lights::{NoLights, Spheres};
use wavepath_kernels::shade::Features;

/// Samples a pixel of the renders that are recorded: most of the scenes that ship with the project have as many. The more,
/// the more of a packet's rays come from the same pixel.
pub const SPP: u32 = 64;

/// Short: all benches together take some minutes.
pub fn short() -> Criterion {
    Criterion::default()
        .sample_size(15)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(1_200))
        .without_plots()
}

/// Measures `work`, each time after `restore` has put back what it changes; that is not measured.
pub fn measure<S>(bencher: &mut Bencher, state: &mut S, restore: impl Fn(&mut S), work: impl Fn(&mut S)) {
    bencher.iter_custom(|times| {
        let mut total = Duration::ZERO;
        for _ in 0..times {
            restore(state);
            let started = Instant::now();
            work(state);
            total += started.elapsed();
        }
        total
    });
}

/// Features of all scenes here but those with a [`Lamp::Square`]: lamps are spheres.
#[derive(Clone, Copy, Debug)]
pub struct SphericalLamps;
impl Features for SphericalLamps {
    type Sampler = Sobol;
    type Lights = Spheres;
    type General = Self;
    type Specular = NoLamps;
}

/// Features of specular materials, which sample no lights.
#[derive(Clone, Copy, Debug)]
pub struct NoLamps;
impl Features for NoLamps {
    type Sampler = Sobol;
    type Lights = NoLights;
    type General = Self;
    type Specular = Self;
}

/// A scene with its plan.
pub struct Loaded {
    /// Name for the results.
    pub name: &'static str,
    /// As it was read or made.
    pub description: SceneDescription,
    /// Its tables.
    pub scene: Scene,
    /// Its plan.
    pub plan: Plan,
}

/// What lights a room.
#[derive(Clone, Copy, Debug)]
pub enum Lamp {
    /// A ball.
    Ball,
    /// Two triangles.
    Square,
}

impl Loaded {
    fn new(name: &'static str, description: SceneDescription) -> Self {
        let scene = scene::build(&description, SphericalLights::Cone).expect("a scene that can be built");
        let plan = Plan::new(&scene);
        Loaded { name, description, scene, plan }
    }

    /// One of the scenes that ship with the project.
    pub fn shipped(name: &'static str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).with_extension("pbrt");
        let loaded = wavepath::pbrt::load(&path).unwrap_or_else(|error| panic!("{error}"));
        Loaded::new(name, loaded.scene)
    }

    /// The scene with all surfaces of paper that lets half of the light through.
    pub fn of_paper(self) -> Self {
        let Loaded { name, mut description, .. } = self;
        for material in &mut description.materials {
            let half = Parameter::Constant([0.5; 3]);
            *material = scene::Material::DiffuseTransmission { reflectance: half, transmittance: half };
        }
        Loaded::new(name, description)
    }

    /// The scene in another resolution.
    pub fn sized(self, width: u32, height: u32) -> Self {
        let Loaded { name, mut description, .. } = self;
        scene::set_resolution(&mut description, width, height);
        Loaded::new(name, description)
    }

    /// A room of 12 triangles, matte like all that is in it: `[x, y, z]` from `low` to `high`, with a lamp around `lamp`.
    /// It is closed, so that paths go on until the roulette ends them.
    fn room(
        name: &'static str,
        look_at: &str,
        low: [f32; 3],
        high: [f32; 3],
        lamp: (Lamp, [f32; 3]),
        mesh: Mesh,
    ) -> Self {
        let [x0, y0, z0] = low;
        let [x1, y1, z1] = high;
        let (lamp, [x, y, z]) = lamp;
        let lamp = match lamp {
            Lamp::Ball => format!("Translate {x} {y} {z}  Shape \"sphere\" \"float radius\" 0.4"),
            Lamp::Square => format!(
                "Translate {x} {y} {z}  Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ] \
                 \"point3 P\" [ -0.4 0 -0.4  0.4 0 -0.4  0.4 0 0.4  -0.4 0 0.4 ]"
            ),
        };
        let text = format!(
            "LookAt {look_at}  0 1 0
             Camera \"perspective\" \"float fov\" 60
             Film \"rgb\" \"integer xresolution\" 512 \"integer yresolution\" 512
             Integrator \"path\" \"integer maxdepth\" 16
             WorldBegin
             Material \"diffuse\" \"rgb reflectance\" [ 0.8 0.75 0.7 ]
             Shape \"trianglemesh\"
               \"point3 P\" [ {x0} {y0} {z0}  {x1} {y0} {z0}  {x0} {y1} {z0}  {x1} {y1} {z0}
                              {x0} {y0} {z1}  {x1} {y0} {z1}  {x0} {y1} {z1}  {x1} {y1} {z1} ]
               \"integer indices\" [ 0 1 3 0 3 2  4 6 7 4 7 5  0 4 5 0 5 1  2 3 7 2 7 6  0 2 6 0 6 4  1 5 7 1 7 3 ]
             AttributeBegin
               AreaLightSource \"diffuse\" \"rgb L\" [ 12 11 9 ] \"bool twosided\" true
               {lamp}
             AttributeEnd
             # Its place is taken by the mesh.
             Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 ] \"point3 P\" [ 0 0 0  1 0 0  0 1 0 ]"
        );
        let loaded = wavepath::pbrt::load_str(&text, name, Path::new("."));
        let mut description = loaded.unwrap_or_else(|error| panic!("{error}")).scene;
        *description.meshes.last_mut().expect("a mesh") = mesh;
        Loaded::new(name, description)
    }

    /// A knot of 80 thousand triangles with vertex normals.
    pub fn knot(lamp: Lamp) -> Self {
        let mesh = TorusKnot { segments: 1000, sides: 40, ..TorusKnot::default() }.build().expect("a knot");
        Loaded::room(
            "knot 80k",
            "0.4 1.1 -2.1  0 0 0",
            [-2.4, -1.0, -2.4],
            [2.4, 2.4, 2.4],
            (lamp, [-1.2, 1.9, -0.6]),
            mesh,
        )
    }

    /// A Menger sponge of 670 thousand triangles, many of them coplanar.
    pub fn menger(lamp: Lamp) -> Self {
        let mesh = Menger { levels: 4, ..Menger::default() }.build().expect("a sponge");
        Loaded::room(
            "sponge 670k",
            "1.7 1.5 -2.7  0.02 -0.12 0",
            [-3.0, -1.2, -3.0],
            [3.0, 3.0, 3.0],
            (lamp, [1.2, 2.2, -1.6]),
            mesh,
        )
    }

    /// Mountains of 2.1 million triangles with vertex normals.
    pub fn terrain(lamp: Lamp) -> Self {
        let terrain = Terrain {
            cells: 1024,
            size: 14.0,
            relief: 4.2,
            scale: 3.2,
            basin: 0.93,
            octaves: 11,
            seed: 12,
            ..Terrain::default()
        };
        Loaded::room(
            "terrain 2.1M",
            "-0.8 1.15 -4.6  0.2 0.95 0",
            [-7.0, -0.1, -7.0],
            [7.0, 6.0, 7.0],
            (lamp, [-2.0, 5.0, -3.0]),
            terrain.build().expect("mountains"),
        )
    }

    /// What is chosen for renders: as little as possible.
    pub fn settings(&self) -> Settings {
        Settings {
            engine: EngineKind::Wavefront,
            sampler: SamplerKind::Sobol,
            threads: 1,
            seed: 1,
            batch: DEFAULT_BATCH,
            level: Level::detect(),
            policy: Policy::Auto,
            adaptive: false,
        }
    }

    /// An empty film.
    pub fn film(&self) -> Film {
        Film::for_render(self.description.film.frame(), self.plan.requirements(), &self.settings())
            .expect("a film")
    }

    /// Renders and hands over each round, until `each` breaks or the image is done. Blocks of pixels come in an order that
    /// is all over the image, so that some rounds show the whole scene.
    pub fn rounds(&self, tree: &Bvh8, spp: u32, each: &mut dyn FnMut(Round) -> ControlFlow<()>) {
        let film = self.film();
        let stop = Stop { spp: Some(spp), time: None, interrupted: Default::default() };
        let schedule = Schedule::new(&film, 1, stop).scattered();
        let done = Done::default();
        let job = Job::new(&self.scene, &self.plan, &film, &schedule, (1, Policy::Auto), &done)
            .expect("all of one scene");
        record(&job, tree, DEFAULT_BATCH, Level::detect(), each).expect("the scene's tree");
    }

    /// The first rounds of a render: many enough that a bench that goes through all of them, again and again, teaches
    /// neither caches nor branch predictors what the next ray does.
    pub fn many(&self, tree: &Bvh8) -> Vec<Round> {
        let mut rounds = Vec::new();
        self.rounds(tree, SPP, &mut |round| {
            rounds.push(round);
            if rounds.len() < 32 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        rounds
    }

    /// The first round, all of whose rays come from the camera; and one deep into the render, most of whose rays have
    /// bounced, some of them often.
    pub fn first_and_deep(&self, tree: &Bvh8) -> [(&'static str, Round); 2] {
        let rounds = self.many(tree);
        [("first", rounds[0].clone()), ("deep", rounds[11].clone())]
    }
}
