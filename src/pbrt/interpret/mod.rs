//! Turns directives into a [`SceneDescription`]: the step that knows what wavepath supports.
//!
//! One file per kind of thing: `options` (camera, film, filter, sampler, integrator), `values` (parameters that
//! are colours or textures), `materials`, `lights`, `shapes`, `objects` (instances). This file keeps the
//! state, the order of directives and the complaints.

mod lights;
mod materials;
mod objects;
mod options;
mod shapes;
mod values;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use glam::DAffine3;

use crate::scene::{Filter, Material, Parameter, SceneDescription};

use super::dialect::Dialect;
use super::error::{Place, Problem, Result, Span};
use super::graphics_state::{ActiveTransform, GraphicsState};
use super::lexer::shorten;
use super::parameters::Parameters;
use super::parser::{Directive, Entity, Name, Naming, Plain, Statement, TransformOp};
use super::suggest::did_you_mean;
use super::transform::{self, MatrixError};
use materials::MaterialTable;
use objects::Objects;
use options::Options;
use shapes::ShapeTotals;
use values::Textures;

/// Deepest nesting of `AttributeBegin`. It bounds memory: each level is a saved state.
const MAX_NESTING: usize = 10_000;

/// Warnings that are kept; a broken exporter can make one for each of a million shapes.
const MAX_WARNINGS: usize = 200;

/// What was opened and must be closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    Attribute,
    Transform,
    Object,
    Import,
}

impl Block {
    fn begin(self) -> &'static str {
        match self {
            Block::Attribute => "AttributeBegin",
            Block::Transform => "TransformBegin",
            Block::Object => "ObjectBegin",
            Block::Import => "Import",
        }
    }

    fn end(self) -> &'static str {
        match self {
            Block::Attribute => "AttributeEnd",
            Block::Transform => "TransformEnd",
            Block::Object => "ObjectEnd",
            Block::Import => "the end of the imported file",
        }
    }
}

/// A finished scene.
pub(crate) struct Finished {
    pub scene: SceneDescription,
    pub warnings: Vec<Problem>,
    pub inputs: Vec<PathBuf>,
}

/// A scene in the making.
pub(crate) struct Builder {
    scene: SceneDescription,
    dialect: Dialect,
    warnings: Vec<Problem>,
    suppressed_warnings: usize,
    /// Mistakes that are errors in v4 and warnings in v3, found before the version was known.
    deferred: Vec<Problem>,
    /// Files read besides scene files.
    inputs: Vec<PathBuf>,
    /// Of the main file, and of the file of the present directive.
    main_directory: PathBuf,
    directory: PathBuf,
    state: GraphicsState,
    stack: Vec<(Block, Span, GraphicsState)>,
    coordinate_systems: HashMap<String, [DAffine3; 2]>,
    in_world: bool,
    world_ended: Option<Span>,
    options: Options,
    materials: MaterialTable,
    textures: Textures,
    objects: Objects,
    totals: ShapeTotals,
}

impl Builder {
    pub(crate) fn new(dialect: Dialect, directory: PathBuf) -> Builder {
        let mut materials = MaterialTable::default();
        let default_material = materials.intern(Material::Diffuse {
            reflectance: Parameter::Constant([0.5; 3]),
            sigma: Parameter::Constant(0.0),
        });
        Builder {
            scene: SceneDescription { max_depth: 5, ..SceneDescription::default() },
            dialect,
            warnings: Vec::new(),
            suppressed_warnings: 0,
            deferred: Vec::new(),
            inputs: Vec::new(),
            main_directory: directory.clone(),
            directory,
            state: GraphicsState::new(default_material),
            stack: Vec::new(),
            coordinate_systems: HashMap::new(),
            in_world: false,
            world_ended: None,
            options: Options::default(),
            materials,
            textures: Textures::default(),
            objects: Objects::default(),
            totals: ShapeTotals::default(),
        }
    }

    /// Takes the next directive. `directory`: of the file that it stands in.
    pub(crate) fn statement(&mut self, statement: Statement, directory: &Path) -> Result<()> {
        if self.directory != directory {
            self.directory = directory.to_path_buf();
        }
        let Statement { keyword, span, directive, v3_sign } = statement;
        if let Some(span) = v3_sign {
            self.dialect.saw_v3(span)?;
        }
        if let Some(ended) = self.world_ended {
            return Err(Problem::at(span, format!("{keyword} after WorldEnd"))
                .label("expected the end of the file")
                .note(Place::Span(ended), "the scene ends here"));
        }
        self.check_order(keyword, &directive, span)?;
        match directive {
            Directive::Plain(plain) => self.plain(plain, span),
            Directive::Transform(op) => self.transform(keyword, &op, span),
            Directive::ActiveTransform(name) => self.active_transform(&name),
            Directive::Named(naming, name) => self.named(naming, name, span),
            Directive::Entity(entity, name, parameters) => self.entity(entity, name, parameters, span),
            Directive::Texture { name, value_type, class, parameters } => {
                self.texture(name, &value_type, class, parameters)
            }
            Directive::MediumInterface(inside, outside) => medium_interface(&inside, &outside),
            Directive::Option(parameter) => self.option(&parameter),
        }
    }

    fn check_order(&self, keyword: &str, directive: &Directive, span: Span) -> Result<()> {
        match place_of(directive) {
            Where::Options if self.in_world => {
                Err(Problem::at(span, format!("{keyword} inside the world"))
                    .label("expected before WorldBegin"))
            }
            Where::World if !self.in_world => {
                Err(Problem::at(span, format!("{keyword} before WorldBegin"))
                    .label("expected behind WorldBegin"))
            }
            _ => Ok(()),
        }
    }

    fn plain(&mut self, plain: Plain, span: Span) -> Result<()> {
        match plain {
            Plain::AttributeBegin => self.push(Block::Attribute, span),
            Plain::AttributeEnd => self.pop(Block::Attribute, span),
            Plain::TransformBegin => self.push(Block::Transform, span),
            Plain::TransformEnd => self.pop(Block::Transform, span),
            Plain::ImportBegin => self.push(Block::Import, span),
            Plain::ImportEnd => self.pop(Block::Import, span),
            Plain::ObjectEnd => {
                self.pop(Block::Object, span)?;
                self.end_object();
                Ok(())
            }
            Plain::ReverseOrientation => {
                self.state.reverse_orientation = !self.state.reverse_orientation;
                Ok(())
            }
            Plain::WorldBegin => self.world_begin(),
            Plain::WorldEnd => {
                self.dialect.saw_v3(span)?;
                self.check_closed(Some(span))?;
                self.world_ended = Some(span);
                Ok(())
            }
            Plain::Identity => {
                self.state.update(|_| DAffine3::IDENTITY);
                Ok(())
            }
        }
    }

    fn world_begin(&mut self) -> Result<()> {
        self.in_world = true;
        self.state.ctm = [DAffine3::IDENTITY; 2];
        self.state.active = ActiveTransform::All;
        self.coordinate_systems.insert("world".into(), self.state.ctm);
        Ok(())
    }

    fn push(&mut self, block: Block, span: Span) -> Result<()> {
        if self.stack.len() >= MAX_NESTING {
            return Err(Problem::at(span, format!("more than {MAX_NESTING} nested blocks")).label("too deep"));
        }
        self.stack.push((block, span, self.state.clone()));
        Ok(())
    }

    fn pop(&mut self, block: Block, span: Span) -> Result<()> {
        let Some((open, opened_at, saved)) = self.stack.pop() else {
            let message = format!("{} without {}", block.end(), block.begin());
            return Err(Problem::at(span, message).label("nothing is open here"));
        };
        if open != block {
            return Err(Problem::at(span, format!("{} inside {}", block.end(), open.begin()))
                .label(format!("expected {}", open.end()))
                .note(Place::Span(opened_at), "opened here"));
        }
        // In v4 TransformBegin is another word for AttributeBegin.
        if block == Block::Transform && self.dialect.is_v3() {
            self.state.ctm = saved.ctm;
            self.state.active = saved.active;
        } else {
            self.state = saved;
        }
        Ok(())
    }

    fn check_closed(&self, at: Option<Span>) -> Result<()> {
        let Some((block, span, _)) = self.stack.last() else {
            return Ok(());
        };
        let message = format!("{} is never closed", block.begin());
        let problem = Problem::at(*span, message).label(format!("expected {} behind it", block.end()));
        Err(match at {
            Some(end) => problem.note(Place::Span(end), "the scene ends here"),
            None => problem,
        })
    }

    fn transform(&mut self, keyword: &str, op: &TransformOp, span: Span) -> Result<()> {
        let bad = |message: &str| Problem::at(span, format!("{keyword}: {message}"));
        let change = match op {
            TransformOp::Translate(v) => transform::translate(*v),
            TransformOp::Scale(v) => transform::scale(*v).ok_or_else(|| {
                bad("the scale cannot be inverted").label("expected factors that are not 0")
            })?,
            TransformOp::Rotate([angle, x, y, z]) => {
                transform::rotate(*angle, [*x, *y, *z]).ok_or_else(|| bad("the axis has no direction"))?
            }
            TransformOp::LookAt([ex, ey, ez, lx, ly, lz, ux, uy, uz]) => {
                transform::look_at([*ex, *ey, *ez], [*lx, *ly, *lz], [*ux, *uy, *uz]).ok_or_else(|| {
                    bad("no direction follows from these points")
                        .label("expected two different points and an up vector not parallel to the view")
                })?
            }
            TransformOp::Transform(m) | TransformOp::ConcatTransform(m) => {
                transform::matrix(m).map_err(|error| match error {
                    MatrixError::Projective => bad("the matrix is projective")
                        .label("expected 0 0 0 and not 0 as entries 4, 8, 12 and 16"),
                    MatrixError::Singular => bad("the matrix cannot be inverted"),
                })?
            }
            // Times of a motion; without motion they mean nothing.
            TransformOp::Times(_) => return Ok(()),
        };
        match op {
            TransformOp::Transform(_) => self.state.update(|_| change),
            _ => self.state.update(|ctm| ctm * change),
        }
        if self.state.ctm.iter().any(|ctm| transform::invertible(*ctm).is_none()) {
            return Err(bad("the transform that results cannot be inverted"));
        }
        Ok(())
    }

    fn active_transform(&mut self, name: &Name) -> Result<()> {
        self.state.active = match name.text.as_str() {
            "All" => ActiveTransform::All,
            "StartTime" => ActiveTransform::Start,
            "EndTime" => ActiveTransform::End,
            other => {
                return Err(Problem::at(name.span, format!("unknown time `{}`", shorten(other)))
                    .label("expected StartTime, EndTime or All"));
            }
        };
        Ok(())
    }

    /// The present transform, for a thing that cannot move.
    fn static_ctm(&self, span: Span) -> Result<DAffine3> {
        if self.state.ctm[0] == self.state.ctm[1] {
            return Ok(self.state.ctm[0]);
        }
        Err(Problem::at(span, "motion is not supported")
            .label("the transforms at StartTime and EndTime differ here"))
    }

    fn named(&mut self, naming: Naming, name: Name, span: Span) -> Result<()> {
        match naming {
            Naming::CoordinateSystem => {
                self.coordinate_systems.insert(name.text, self.state.ctm);
                Ok(())
            }
            Naming::CoordSysTransform => match self.coordinate_systems.get(&name.text) {
                Some(ctm) => {
                    self.state.ctm = *ctm;
                    Ok(())
                }
                None => Err(unknown("coordinate system", &name, self.coordinate_systems.keys())),
            },
            Naming::NamedMaterial => {
                self.state.material = self.materials.named(&name);
                Ok(())
            }
            Naming::ObjectBegin => self.begin_object(name, span),
            Naming::ObjectInstance => self.instance(&name, span),
            Naming::ColorSpace => match name.text.as_str() {
                "srgb" => Ok(()),
                "aces2065-1" | "rec2020" | "dci-p3" => {
                    Err(Problem::at(name.span, format!("color space \"{}\" is not supported", name.text))
                        .label("expected \"srgb\""))
                }
                _ => Err(unknown_kind("color space", &name, &["srgb"])),
            },
        }
    }

    fn entity(&mut self, entity: Entity, name: Name, parameters: Parameters, span: Span) -> Result<()> {
        match entity {
            Entity::Accelerator => {
                parameters.accept_all();
                Ok(())
            }
            Entity::Attribute => self.attribute(&name, parameters),
            Entity::Camera => self.camera(&name, &parameters, span),
            Entity::Film => self.film(&name, &parameters),
            Entity::Integrator => self.integrator(&name, &parameters),
            Entity::PixelFilter => self.pixel_filter(&name, &parameters),
            Entity::Sampler => self.sampler(&name, &parameters),
            Entity::MakeNamedMedium => Err(Problem::at(span, "participating media are not supported")
                .label("MakeNamedMedium cannot be rendered")),
            Entity::Material => {
                let parameters = parameters.with_defaults(&self.state.defaults.material);
                self.material(&name, &parameters)
            }
            Entity::MakeNamedMaterial => {
                let parameters = parameters.with_defaults(&self.state.defaults.material);
                self.make_named_material(name, &parameters)
            }
            Entity::AreaLightSource => {
                let parameters = parameters.with_defaults(&self.state.defaults.light);
                self.area_light(&name, &parameters, span)
            }
            Entity::LightSource => {
                let parameters = parameters.with_defaults(&self.state.defaults.light);
                self.light(&name, &parameters, span)
            }
            Entity::Shape => {
                let parameters = parameters.with_defaults(&self.state.defaults.shape);
                self.shape(&name, &parameters, span)
            }
        }
    }

    fn attribute(&mut self, target: &Name, parameters: Parameters) -> Result<()> {
        let added = parameters.into_own().into_iter().map(Rc::new);
        let defaults = Rc::make_mut(&mut self.state.defaults);
        match target.text.as_str() {
            "shape" => defaults.shape.extend(added),
            "light" => defaults.light.extend(added),
            "material" => defaults.material.extend(added),
            "texture" => defaults.texture.extend(added),
            // Media are refused where they are used.
            "medium" => {}
            _ => {
                return Err(unknown_kind(
                    "target",
                    target,
                    &["shape", "light", "material", "medium", "texture"],
                ));
            }
        }
        Ok(())
    }

    #[expect(clippy::boxed_local, reason = "problems are made boxed, for the sake of `Result`")]
    fn warn(&mut self, problem: Box<Problem>) {
        if self.warnings.len() < MAX_WARNINGS {
            self.warnings.push(*problem);
        } else {
            self.suppressed_warnings += 1;
        }
    }

    /// Complains about parameters that nobody asked for: an error in v4, a warning in v3.
    fn check_unused(&mut self, parameters: &Parameters, what: &str) -> Result<()> {
        for problem in parameters.shadowed() {
            self.warn(Box::new(problem));
        }
        for problem in parameters.unknown(what) {
            if self.dialect.is_surely_v4() {
                return Err(Box::new(problem));
            }
            if self.dialect.is_v3() {
                self.warn(Box::new(problem));
            } else {
                self.deferred.push(problem);
            }
        }
        Ok(())
    }

    /// A file that a parameter names: relative to the file it stands in, or else to the main file, as pbrt has it.
    fn resolve(&self, name: &str) -> PathBuf {
        let near = self.directory.join(name);
        if near.exists() {
            return near;
        }
        let far = self.main_directory.join(name);
        if far.exists() { far } else { near }
    }

    /// Ends the scene.
    pub(crate) fn finish(mut self) -> Result<Finished> {
        if !self.deferred.is_empty() {
            return Err(Box::new(self.deferred.swap_remove(0)));
        }
        self.check_closed(None)?;
        if !self.in_world {
            return Err(Problem::new(Place::Nowhere, "the scene has no WorldBegin")
                .label("expected WorldBegin between the options and the scene"));
        }
        self.finish_instances()?;
        self.finish_options()?;
        self.finish_filter();
        self.materials.finish(&mut self.scene)?;
        self.scale_lights()?;
        self.final_warnings();
        Ok(Finished { scene: self.scene, warnings: self.warnings, inputs: self.inputs })
    }

    fn finish_filter(&mut self) {
        self.scene.filter = match self.options.filter {
            Some(filter) => filter,
            None if self.dialect.is_v3() => Filter::Box { radius: [0.5; 2] },
            None => Filter::default(),
        };
    }

    fn final_warnings(&mut self) {
        if let Some(warning) = self.totals.degenerate_warning() {
            self.warn(warning);
        }
        let emits = |scene: &SceneDescription| {
            !scene.lights.is_empty() || scene.shapes.iter().any(|shape| shape.emission.is_some())
        };
        if !emits(&self.scene) {
            self.warn(Problem::new(Place::Nowhere, "the scene has no lights: the picture will be black"));
        }
        if self.suppressed_warnings > 0 {
            let text = format!("{} more warnings are not shown", self.suppressed_warnings);
            self.warnings.push(*Problem::new(Place::Nowhere, text));
        }
    }

    /// Applies the film's exposure to everything that shines: the picture is linear in the lights.
    fn scale_lights(&mut self) -> Result<()> {
        let scale = self.options.exposure;
        if scale == 1.0 {
            return Ok(());
        }
        let mut finite = true;
        let mut apply = |rgb: &mut [f32; 3]| {
            for c in rgb {
                *c = (f64::from(*c) * scale) as f32;
                finite &= c.is_finite();
            }
        };
        for shape in &mut self.scene.shapes {
            if let Some(emission) = &mut shape.emission {
                apply(&mut emission.radiance);
            }
        }
        for light in &mut self.scene.lights {
            apply(light.colour_mut());
        }
        if !finite {
            return Err(Problem::new(Place::Nowhere, "a light is too bright")
                .label("its radiance times the film's exposure is not a number"));
        }
        Ok(())
    }
}

/// Where a directive may stand.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Where {
    Options,
    World,
    Anywhere,
}

fn place_of(directive: &Directive) -> Where {
    match directive {
        Directive::Plain(Plain::WorldBegin) => Where::Options,
        Directive::Plain(Plain::Identity) => Where::Anywhere,
        Directive::Plain(_) | Directive::Texture { .. } => Where::World,
        Directive::Named(Naming::CoordinateSystem | Naming::CoordSysTransform | Naming::ColorSpace, _) => {
            Where::Anywhere
        }
        Directive::Named(..) => Where::World,
        Directive::Entity(entity, ..) => match entity {
            Entity::Attribute | Entity::MakeNamedMedium => Where::Anywhere,
            Entity::Accelerator
            | Entity::Camera
            | Entity::Film
            | Entity::Integrator
            | Entity::PixelFilter
            | Entity::Sampler => Where::Options,
            _ => Where::World,
        },
        _ => Where::Anywhere,
    }
}

fn medium_interface(inside: &Name, outside: &Name) -> Result<()> {
    match [inside, outside].into_iter().find(|name| !name.text.is_empty()) {
        None => Ok(()),
        Some(name) => Err(Problem::at(name.span, "participating media are not supported")
            .label("expected \"\", the vacuum, on both sides")),
    }
}

/// A name that was never defined.
fn unknown<'a>(what: &str, name: &Name, known: impl Iterator<Item = &'a String>) -> Box<Problem> {
    let known: Vec<&str> = known.map(String::as_str).collect();
    Problem::at(name.span, format!("unknown {what} \"{}\"", shorten(&name.text)))
        .label(format!("expected one that is defined before{}", did_you_mean(&name.text, &known)))
}

/// A kind that does not exist.
fn unknown_kind(what: &str, name: &Name, known: &[&str]) -> Box<Problem> {
    Problem::at(name.span, format!("unknown {what} \"{}\"", shorten(&name.text))).label(format!(
        "expected one of {}{}",
        known.join(", "),
        did_you_mean(&name.text, known)
    ))
}

/// A kind that pbrt has and wavepath lacks.
fn unsupported_kind(what: &str, name: &Name, supported: &[&str]) -> Box<Problem> {
    Problem::at(name.span, format!("{what} \"{}\" is not supported", name.text))
        .label(format!("expected one of {}", supported.join(", ")))
}
