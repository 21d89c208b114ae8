//! A scene that is ready to be rendered: its description, the tables that the kernels read, and what they need.

use super::{BuildError, SceneDescription, SphericalLights, build, release_meshes, set_resolution};
use crate::engine::{EngineKind, Tree};
use crate::film_file::{Contents, Identity};
use crate::pbrt::{self, Diagnostic, LoadOptions, Override};
use crate::plan::Plan;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
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
    overrides: Vec<Override>,
    tables: Tables,
    plan: Plan,
    setup: Vec<(&'static str, Duration)>,
    spherical_lights: SphericalLights,
    contents: Contents,
    identity: OnceLock<Identity>,
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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneOptions {
    /// Width and height of the image, in place of the scene's; at least 1 each. A crop keeps its share.
    pub resolution: Option<[u32; 2]>,
    /// How spherical lamps are sampled.
    pub spherical_lights: SphericalLights,
    /// Replaces or leaves out what wavepath lacks, with a warning for each ([`pbrt::load_leniently`]).
    pub lenient: bool,
    /// What is set in place of what the file says.
    pub set: Vec<Override>,
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
        let path = path.as_ref();
        let load =
            LoadOptions { lenient: options.lenient, set: options.set.clone(), ..LoadOptions::default() };
        Scene::read(path.display().to_string(), options, || Ok(pbrt::load_with_options(path, &load)?))
    }

    /// A scene from a text in pbrt's format; file names in it are relative to the working directory.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn parse(text: &str) -> Result<Scene, SceneError> {
        let options = SceneOptions::default();
        Scene::read("scene".into(), &options, || Ok(pbrt::load_str(text, "scene", Path::new(""))?))
    }

    /// A scene that was described in code. `name` stands for it in messages and reports.
    ///
    /// # Errors
    /// [`SceneError::Build`] names what is wrong with the description.
    pub fn new(name: impl Into<String>, description: SceneDescription) -> Result<Scene, SceneError> {
        Scene::new_with(name, description, &SceneOptions::default())
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
        let (warnings, inputs, places, names) = Default::default();
        let loaded = pbrt::Loaded { scene: description, warnings, inputs, places, names };
        Scene::read(name.into(), options, || Ok(loaded))
    }

    /// As [`Scene::open_with`]; `read` brings the description, and perhaps changes it.
    ///
    /// # Errors
    /// Those of `read`, and as [`Scene::new`].
    pub fn read<E: From<SceneError>>(
        name: String,
        options: &SceneOptions,
        read: impl FnOnce() -> Result<pbrt::Loaded, E>,
    ) -> Result<Scene, E> {
        let (started, meshes_before) = (Instant::now(), pbrt::reading_time());
        let pbrt::Loaded { scene: mut description, warnings, inputs, .. } = read()?;
        // Several threads may read meshes, and together take longer than the clock.
        let reading = started.elapsed();
        let meshes = pbrt::reading_time().saturating_sub(meshes_before).min(reading);
        let started = Instant::now();
        if let Some([width, height]) = options.resolution {
            set_resolution(&mut description, width, height);
        }
        let tables = match build(&description, options.spherical_lights) {
            Ok(tables) => tables,
            Err(error) => return Err(SceneError::Build { name, error }.into()),
        };
        let contents = Contents::of(&description);
        release_meshes(&mut description);
        let plan = Plan::new(&tables);
        let setup = vec![("reading", reading - meshes), ("meshes", meshes), ("tables", started.elapsed())];
        let (spherical_lights, identity) = (options.spherical_lights, OnceLock::new());
        Ok(Scene {
            name,
            description,
            warnings,
            inputs,
            overrides: options.set.clone(),
            tables,
            plan,
            setup,
            spherical_lights,
            contents,
            identity,
        })
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
    /// What its pictures depend on: for film files. Reads its files when asked for the first time.
    ///
    /// # Errors
    /// Those of the file system, with the name of the file.
    pub fn identity(&self) -> io::Result<&Identity> {
        if let Some(identity) = self.identity.get() {
            return Ok(identity);
        }
        let identity = Identity::of(self, self.contents, self.spherical_lights)?;
        Ok(self.identity.get_or_init(|| identity))
    }
    /// What was set in place of what the files say.
    pub fn overrides(&self) -> &[Override] {
        &self.overrides
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
    /// What reading and building took, part by part.
    pub fn setup(&self) -> &[(&'static str, Duration)] {
        &self.setup
    }
    /// The tree that an engine traces rays through. [`crate::Render::run`] builds it if it is not given one: several
    /// renders of a scene may share it.
    pub fn tree(&self, engine: EngineKind) -> Tree<'_> {
        Tree::build(engine, &self.tables)
    }
}
