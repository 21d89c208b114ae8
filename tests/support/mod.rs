//! What integration tests share: scenes from text or from `scenes/`, rendered through the library.
#![allow(dead_code)] // Each test binary uses its own part.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use wavepath::bench::Clock;
use wavepath::engine::stats::Stats;
use wavepath::engine::{Done, EngineKind};
use wavepath::film::Developed;
use wavepath::picture::Image;
use wavepath::render::image_of;
use wavepath::scene::{self, SamplerKind, Scene, SceneDescription, SceneOptions, SphericalLights};
use wavepath_kernels::intersect::Policy;
use wavepath_kernels::isa::Level;

/// Both engines.
pub const ENGINES: [EngineKind; 2] = [EngineKind::Wavefront, EngineKind::Megakernel];
/// Both samplers.
pub const SAMPLERS: [SamplerKind; 2] = [SamplerKind::Sobol, SamplerKind::Independent];

/// The folder of the scenes that ship with the project.
pub fn scenes() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes"))
}

/// A scene from a text; file names in it are relative to the project's scenes.
pub fn scene(text: &str) -> SceneDescription {
    let loaded = wavepath::pbrt::load_str(text, "test", scenes());
    loaded.unwrap_or_else(|error| panic!("{error}")).scene
}

/// One of the project's scenes.
pub fn shipped(name: &str) -> SceneDescription {
    let loaded = wavepath::pbrt::load(&scenes().join(name));
    loaded.unwrap_or_else(|error| panic!("{error}")).scene
}

/// The scene at another resolution.
pub fn sized(mut scene: SceneDescription, width: u32, height: u32) -> SceneDescription {
    scene::set_resolution(&mut scene, width, height);
    scene
}

/// How to render.
#[derive(Clone, Debug)]
pub struct Render {
    pub engine: EngineKind,
    pub sampler: SamplerKind,
    pub threads: usize,
    pub seed: u64,
    pub batch: usize,
    pub level: Level,
    pub policy: Policy,
    pub adaptive: bool,
    pub spp: Option<u32>,
    pub time: Option<Duration>,
    pub spherical: SphericalLights,
}

impl Default for Render {
    fn default() -> Self {
        Render {
            engine: EngineKind::Wavefront,
            sampler: SamplerKind::Sobol,
            threads: 2,
            seed: 1,
            batch: 4096,
            level: Level::detect(),
            policy: Policy::Auto,
            adaptive: false,
            spp: Some(16),
            time: None,
            spherical: SphericalLights::Cone,
        }
    }
}

/// What came of it.
pub struct Rendered {
    pub image: Image,
    pub developed: Developed,
    pub stats: Stats,
    pub seconds: f64,
    /// Seconds of processor time.
    pub processor: f64,
    pub pixels: u64,
    /// Fewest and most samples of a pixel.
    pub sample_range: [u32; 2],
}

impl Rendered {
    /// Mean of all pixels.
    pub fn mean(&self) -> [f64; 3] {
        let n = self.developed.pixels.len() as f64;
        let sum = self
            .developed
            .pixels
            .iter()
            .fold([0.0; 3], |sum: [f64; 3], pixel| std::array::from_fn(|k| sum[k] + pixel[k] as f64));
        sum.map(|x| x / n)
    }

    /// The bits of all pixels.
    pub fn bits(&self) -> Vec<[u32; 3]> {
        self.developed.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
    }

    /// Rays from the camera, from surfaces, towards lights.
    pub fn rays(&self) -> [u64; 3] {
        [self.stats.camera_rays, self.stats.bounce_rays, self.stats.shadow_rays]
    }
}

impl Render {
    /// Renders until the rule says stop.
    pub fn of(&self, description: &SceneDescription) -> Rendered {
        self.watched(description, |_, _| ())
    }

    /// The same as the library has it.
    pub fn render<'s>(&self, scene: &'s Scene) -> wavepath::Render<'s> {
        let render = wavepath::Render::new(scene)
            .engine(self.engine)
            .sampler(self.sampler)
            .threads(self.threads)
            .seed(self.seed)
            .batch(self.batch)
            .level(self.level)
            .traversal(self.policy)
            .adaptive(self.adaptive);
        let render = match self.spp {
            Some(spp) => render.spp(spp),
            None => render,
        };
        match self.time {
            Some(time) => render.time(time),
            None => render,
        }
    }

    /// As [`Render::of`]; `watch` is called about ten times a second and may raise the flag that interrupts.
    pub fn watched(
        &self,
        description: &SceneDescription,
        mut watch: impl FnMut(&Done, &AtomicBool),
    ) -> Rendered {
        let options = SceneOptions { spherical_lights: self.spherical, ..SceneOptions::default() };
        let scene = Scene::new_with("test", description.clone(), &options).unwrap();
        let render = self.render(&scene);
        let interrupted = Arc::new(AtomicBool::new(false));
        let tree = scene.tree(self.engine);
        let (film, render) = (render.film().unwrap(), render.stop_on(interrupted.clone()));
        let mut session = render.session(&tree, &film).unwrap();
        let clock = Clock::start();
        session.run(self.time, |done| watch(done, &interrupted));
        let (stats, elapsed, processor) = (session.stats().clone(), session.elapsed(), clock.processor());
        let developed = film.develop();
        let image = image_of(description, developed.pixels.clone());
        let (seconds, sample_range) = (elapsed.as_secs_f64(), film.sample_range());
        Rendered { image, developed, stats, seconds, processor, pixels: film.pixels(), sample_range }
    }
}
