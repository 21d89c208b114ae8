//! What comes of a render.

use crate::engine::session::{Ended, Round};
use crate::engine::stats::{Stage, Stats};
use crate::engine::{EngineKind, Settings};
use crate::film::{ErrorEstimate, Film, Frame, PixelStatistics};
use crate::film_file::{self, About, FilmFile};
use crate::machine;
use crate::picture::{self, Channel, DataWindow, Image, ImageError, Samples};
use crate::report::{Rays, Report};
use crate::scene::{CameraKind, Scene, SceneDescription};
use glam::{DMat4, DVec3};
use std::io;
use std::path::Path;
use std::time::Duration;
use wavepath_kernels::channels::Row;

/// A finished picture, with its error and its cost.
#[derive(Debug)]
pub struct Picture {
    image: Image,
    error: PictureError,
    report: Report,
    ended: Ended,
    film: Film,
    about: About,
    round: Option<Round>,
}

/// The estimated error of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureError(Option<ErrorEstimate>);

impl PictureError {
    /// relMSE against the converged picture, the mean of `(I - R)^2 / (R^2 + 0.01)`; infinite where there are too few
    /// samples to say.
    pub fn relmse(&self) -> f64 {
        self.0.map_or(f64::INFINITY, |estimate| estimate.relmse)
    }
    /// Its 95 % interval; from 0 to infinity where there are too few samples to say.
    pub fn interval(&self) -> [f64; 2] {
        self.0.map_or([0.0, f64::INFINITY], |estimate| estimate.interval)
    }
    /// Whether there are samples enough to say.
    pub fn is_known(&self) -> bool {
        self.0.is_some()
    }
}

impl Picture {
    /// What a film shows; what its report says of the film is filled in.
    pub(super) fn new(film: Film, mut about: About, round: Option<Round>, ended: Ended) -> Picture {
        let image = picture_of(&film, &mut about);
        let report = about.report.clone();
        let estimate = report.estimated_relmse.zip(report.estimated_relmse_interval);
        let error = PictureError(estimate.map(|(relmse, interval)| ErrorEstimate { relmse, interval }));
        Picture { image, error, report, ended, film, about, round }
    }

    /// The pixels, in linear light, and their place in the frame; what else was asked for is in its channels.
    pub fn image(&self) -> &Image {
        &self.image
    }
    /// Its estimated error.
    pub fn error(&self) -> PictureError {
        self.error
    }
    /// What it cost, and all that was chosen.
    pub fn report(&self) -> &Report {
        &self.report
    }
    /// What ended the render.
    pub fn ended(&self) -> Ended {
        self.ended
    }
    /// The sums that it was developed from.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// Each pixel's standard error and samples, as channels for [`Image::channels`].
    pub fn layers(&self) -> Vec<Channel> {
        layers(&self.film.statistics())
    }

    /// Writes it, with its report: OpenEXR (`.exr`) in linear light, or PNG (`.png`) in sRGB.
    ///
    /// # Errors
    /// [`ImageError`], which names the file.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ImageError> {
        picture::write(path.as_ref(), &self.image, 0.0)
    }

    /// Writes its film, to be gone on with or added to others: see [`crate::film_file`]. The scene is the one that was rendered.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn save_film(&self, scene: &Scene, path: impl AsRef<Path>) -> io::Result<()> {
        film_file::save(path.as_ref(), &self.film, scene.identity()?, &self.about, self.round.as_ref(), None)
    }

    /// The pixels alone, with their place in the frame.
    pub fn into_image(self) -> Image {
        self.image
    }
}

/// What a film shows. What the report says of the film is filled in.
pub(super) fn picture_of(film: &Film, about: &mut About) -> Image {
    let developed = film.develop();
    let report = &mut about.report;
    report.spp = developed.samples as f64 / film.pixels() as f64;
    report.samples = developed.samples;
    report.invalid_samples = developed.invalid;
    report.estimated_relmse = developed.relmse;
    report.estimated_relmse_interval = developed.relmse_interval;
    report.peak_memory_bytes = report.peak_memory_bytes.max(machine::peak_memory_bytes());
    let Frame { image_width, image_height, bounds: [x0, x1, y0, y1] } = film.header().frame;
    let mut image = Image::new(x1 - x0, y1 - y0, developed.pixels);
    image.window =
        DataWindow { x: x0 as i32, y: y0 as i32, full_width: image_width, full_height: image_height };
    image.metadata.report = Some(about.report.to_json());
    describe(&mut image, about);
    image.channels = channels_of(film);
    image
}

/// What a render has cost so far.
pub(super) fn set_cost(report: &mut Report, stats: &Stats, elapsed: Duration) {
    report.seconds = elapsed.as_secs_f64();
    report.rays = Rays { camera: stats.camera_rays, bounce: stats.bounce_rays, shadow: stats.shadow_rays };
    report.stages = stages(stats);
}

/// A report on a render without its cost and without what follows from its film.
pub(super) fn report_of(scene: &Scene, settings: &Settings, setup: &[(&'static str, Duration)]) -> Report {
    let [x0, x1, y0, y1] = scene.description().film.pixel_bounds;
    Report {
        scene: scene.name().to_string(),
        set: scene.overrides().iter().map(|set| (set.name.clone(), set.value.clone())).collect(),
        inputs: scene.inputs().iter().map(|path| path.display().to_string()).collect(),
        engine: settings.engine.name().to_string(),
        width: x1 - x0,
        height: y1 - y0,
        spp: 0.0,
        seconds: 0.0,
        setup_seconds: setup.iter().map(|(_, time)| time.as_secs_f64()).sum(),
        setup_stages: setup.iter().map(|(name, time)| (name.to_string(), time.as_secs_f64())).collect(),
        samples: 0,
        rays: Rays::default(),
        stages: Vec::new(),
        invalid_samples: 0,
        estimated_relmse: None,
        estimated_relmse_interval: None,
        adaptive: None,
        stopped_by: None,
        peak_memory_bytes: machine::peak_memory_bytes(),
        threads: settings.threads,
        batch: (settings.engine == EngineKind::Wavefront).then_some(settings.batch),
        ranks: Vec::new(),
        imbalance: None,
        cpu: machine::cpu_name(),
        isa: settings.level.name().to_string(),
        sampler: settings.sampler.name().to_string(),
        seed: settings.seed,
        version: env!("CARGO_PKG_VERSION").to_string(),
    }
}

impl FilmFile {
    /// The picture that its film shows.
    pub fn into_picture(self) -> Picture {
        let FilmFile { film, mut about, round, .. } = self;
        about.report.stopped_by = None;
        Picture::new(film, about, round, Ended::Samples)
    }
}

/// The pixels as a picture, with its place in the frame.
pub fn image_of(description: &SceneDescription, pixels: Vec<[f32; 3]>) -> Image {
    let [x0, x1, y0, y1] = description.film.pixel_bounds;
    let [full_width, full_height] = description.film.resolution;
    let mut image = Image::new(x1 - x0, y1 - y0, pixels);
    image.window = DataWindow { x: x0 as i32, y: y0 as i32, full_width, full_height };
    image
}

/// What a film holds beside radiance, as channels for [`Image::channels`]: `depth.Z`.
pub fn channels_of(film: &Film) -> Vec<Channel> {
    let of_row = |(number, row): (usize, &&'static Row)| {
        let planes = row.components.iter().zip(film.develop_channel(number));
        planes.map(|(component, plane)| Channel {
            name: format!("{}.{component}", row.name),
            samples: Samples::Float(plane),
        })
    };
    film.header().channels.iter().enumerate().skip(1).flat_map(of_row).collect()
}

/// Seconds in each stage that took any.
pub fn stages(stats: &Stats) -> Vec<(String, f64)> {
    let seconds = |stage: Stage| (stage.name().to_string(), stats.stages[stage as usize].as_secs_f64());
    Stage::ALL.into_iter().map(seconds).filter(|(_, seconds)| *seconds > 0.0).collect()
}

/// Standard error and samples of each pixel, as channels of an EXR.
fn layers(statistics: &PixelStatistics) -> Vec<Channel> {
    let colours = ["stderr.R", "stderr.G", "stderr.B"].into_iter().enumerate();
    let colours = colours.map(|(index, name)| Channel {
        name: name.into(),
        samples: Samples::Float(statistics.variance.iter().map(|colour| colour[index].sqrt()).collect()),
    });
    let samples = Channel { name: "samples".into(), samples: Samples::Uint(statistics.samples.clone()) };
    colours.chain([samples]).collect()
}

/// What is known of the picture beside its pixels and its report.
fn describe(image: &mut Image, about: &About) {
    let report = &about.report;
    let metadata = &mut image.metadata;
    metadata.samples_per_pixel = Some(report.spp.round() as u32);
    metadata.render_time_seconds = Some(report.seconds as f32);
    metadata.capture_date = machine::utc_now();
    metadata.comments = Some(format!("{}, rendered by wavepath {}", report.scene, report.version));
    metadata.world_to_camera = Some(about.world_to_camera);
    metadata.world_to_ndc = Some(about.world_to_ndc);
}

/// World to camera space, and to the screen, whose shorter axis spans 0 to 1 and whose z goes from 0 at 0.01 to 1 at
/// 1000: what pbrt writes. Rows of matrices for points as columns.
pub(super) fn camera_matrices(description: &SceneDescription) -> ([f32; 16], [f32; 16]) {
    let camera = DMat4::from(description.camera.world_from_camera).inverse();
    let (near, far) = (1e-2, 1000.0);
    let focal = 1.0 / (description.camera.fov.to_radians() / 2.0).tan();
    let screen = DMat4::from_cols_array_2d(&[
        [focal, 0.0, 0.0, 0.0],
        [0.0, focal, 0.0, 0.0],
        [0.0, 0.0, far / (far - near), 1.0],
        [0.0, 0.0, -far * near / (far - near), 0.0],
    ]);
    // The window of an orthographic camera is in units of its space.
    let screen = match description.camera.kind {
        CameraKind::Orthographic => DMat4::IDENTITY,
        CameraKind::Perspective | CameraKind::Spherical(_) => screen,
    };
    let to_unit = DMat4::from_translation(DVec3::splat(0.5)) * DMat4::from_scale(DVec3::new(0.5, 0.5, 1.0));
    let finite = |value: f64| if (value as f32).is_finite() { value as f32 } else { 0.0 };
    let rows = |matrix: DMat4| matrix.transpose().to_cols_array().map(finite);
    (rows(camera), rows(to_unit * screen * camera))
}
