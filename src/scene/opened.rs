//! A scene that is ready to be rendered: its description, the tables that the kernels read, and what they need.

use super::{BuildError, SceneDescription, SphericalLights, build, release_meshes, set_resolution};
use crate::engine::{EngineKind, Tree};
use crate::pbrt::{self, Diagnostic};
use crate::plan::Plan;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use wavepath_kernels::scene::Scene as Tables;

/// A scene, checked and ready: [`crate::Render`] takes it.
///
/// ```
/// let scene = wavepath::Scene::parse(
///     r#"LookAt 0 0 -5  0 0 0  0 1 0
///        Camera "perspective" "float fov" 40
///        Film "rgb" "integer xresolution" 8 "integer yresolution" 8
///        WorldBegin
///        LightSource "infinite" "rgb L" [ 1 1 1 ]
///        Shape "sphere" "float radius" 1"#,
/// )?;
/// assert_eq!(scene.resolution(), [8, 8]);
/// # Ok::<(), wavepath::SceneError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Scene {
    name: String,
    description: SceneDescription,
    warnings: Vec<Diagnostic>,
    inputs: Vec<PathBuf>,
    tables: Tables,
    plan: Plan,
    setup: Duration,
}

/// Why there is no scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file is wrong, or asks for what wavepath cannot render rightly; tells file, line and column.
    #[error(transparent)]
    Read(#[from] pbrt::Error),
    /// The description is wrong.
    #[error("{name}: {error}")]
    Build {
        /// Name of the scene.
        name: String,
        /// What is wrong.
        error: BuildError,
    },
}

/// What to do with a scene between reading and building it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneOptions {
    /// Width and height of the image, in place of the scene's; at least 1 each. A crop keeps its share.
    pub resolution: Option<[u32; 2]>,
    /// How spherical lamps are sampled.
    pub spherical_lights: SphericalLights,
}

impl Scene {
    /// Reads a scene file in pbrt's format, and all files that it refers to.
    ///
    /// # Errors
    /// [`SceneError`] says what is wrong, and where.
    pub fn open(path: impl AsRef<Path>) -> Result<Scene, SceneError> {
        Scene::open_with(path, &SceneOptions::default())
    }

    /// As [`Scene::open`], with options.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn open_with(path: impl AsRef<Path>, options: &SceneOptions) -> Result<Scene, SceneError> {
        let (path, started) = (path.as_ref(), Instant::now());
        let loaded = pbrt::load(path)?;
        Scene::of(path.display().to_string(), loaded, options, started)
    }

    /// A scene from a text in pbrt's format; file names in it are relative to the working directory.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn parse(text: &str) -> Result<Scene, SceneError> {
        let started = Instant::now();
        let loaded = pbrt::load_str(text, "scene", Path::new(""))?;
        Scene::of("scene".into(), loaded, &SceneOptions::default(), started)
    }

    /// A scene that was described in code. `name` stands for it in messages and reports.
    ///
    /// # Errors
    /// [`SceneError::Build`] names what is wrong with the description.
    pub fn new(name: impl Into<String>, description: SceneDescription) -> Result<Scene, SceneError> {
        let loaded = pbrt::Loaded { scene: description, warnings: Vec::new(), inputs: Vec::new() };
        Scene::of(name.into(), loaded, &SceneOptions::default(), Instant::now())
    }

    /// As [`Scene::new`], with options.
    ///
    /// # Errors
    /// As [`Scene::new`].
    pub fn new_with(
        name: impl Into<String>,
        description: SceneDescription,
        options: &SceneOptions,
    ) -> Result<Scene, SceneError> {
        let loaded = pbrt::Loaded { scene: description, warnings: Vec::new(), inputs: Vec::new() };
        Scene::of(name.into(), loaded, options, Instant::now())
    }

    fn of(
        name: String,
        loaded: pbrt::Loaded,
        options: &SceneOptions,
        started: Instant,
    ) -> Result<Scene, SceneError> {
        let pbrt::Loaded { scene: mut description, warnings, inputs } = loaded;
        if let Some([width, height]) = options.resolution {
            set_resolution(&mut description, width, height);
        }
        let tables = match build(&description, options.spherical_lights) {
            Ok(tables) => tables,
            Err(error) => return Err(SceneError::Build { name, error }),
        };
        release_meshes(&mut description);
        let plan = Plan::new(&tables);
        let setup = started.elapsed();
        Ok(Scene { name, description, warnings, inputs, tables, plan, setup })
    }

    /// Its file as given, or the name that it was given.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// What was described, with empty meshes: what was in them is in the tables.
    pub fn description(&self) -> &SceneDescription {
        &self.description
    }
    /// What in the files deserves a look.
    pub fn warnings(&self) -> &[Diagnostic] {
        &self.warnings
    }
    /// Every file that was read.
    pub fn inputs(&self) -> &[PathBuf] {
        &self.inputs
    }
    /// Width and height of the full image, in pixels.
    pub fn resolution(&self) -> [u32; 2] {
        self.description.film.resolution
    }
    /// What it needs, and what is left out.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }
    /// The tables that the kernels read.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }
    /// Time that reading and building took.
    pub fn setup(&self) -> Duration {
        self.setup
    }
    /// The tree that an engine traces rays through. [`crate::Render::run`] builds it if it is not given one: several
    /// renders of a scene may share it.
    pub fn tree(&self, engine: EngineKind) -> Tree<'_> {
        Tree::build(engine, &self.tables)
    }
}
