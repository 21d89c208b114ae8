//! Turns directives into a [`SceneDescription`]: the step that knows what wavepath supports.
//!
//! One file per kind of thing: `options` (camera, film, filter, sampler, integrator), `values` (parameters that
//! are colours), `textures`, `materials`, `lights`, `shapes`, `objects` (instances). This file keeps the
//! state, the order of directives and the complaints.

mod images;
mod lights;
mod materials;
mod objects;
mod options;
mod shapes;
mod textures;
mod values;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use glam::DAffine3;

use crate::scene::{Filter, Material, Parameter, Pose, SceneDescription};

use super::dialect::Dialect;
use super::error::{Place, Problem, Result, Span};
use super::graphics_state::{ActiveTransform, GraphicsState, MediumInterface};
use super::lexer::shorten;
use super::parameters::Parameters;
use super::parser::{Directive, Entity, Name, Naming, Plain, Statement, TransformOp};
use super::suggest::did_you_mean;
use super::transform;
use images::Images;
use materials::MaterialTable;
use objects::Objects;
use options::Options;
use shapes::ShapeTotals;
use textures::Textures;

/// Deepest nesting of `AttributeBegin`. It bounds memory: each level is a saved state.
const MAX_NESTING: usize = 10_000;

/// Warnings that are kept; a broken exporter can make one for each of a million shapes.
const MAX_WARNINGS: usize = 200;

/// Distinct things that a scene lacks, of which an error tells.
const MAX_LACKS: usize = 50;

/// Whether the scene goes on.
pub(crate) enum Flow {
    On,
    /// Nothing that follows belongs to it.
    Ended,
}

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
    /// Directive of each shape of the scene.
    pub shape_spans: Vec<Span>,
}

/// A scene in the making.
pub(crate) struct Builder {
    scene: SceneDescription,
    shape_spans: Vec<Span>,
    dialect: Dialect,
    warnings: Vec<Problem>,
    suppressed_warnings: usize,
    /// Mistakes that are errors in v4 and warnings in v3, found before the version was known.
    deferred: Vec<Problem>,
    /// What the present directive asks for and wavepath lacks. A texture, a material or an object takes it along, and it
    /// matters only where they are used.
    pending: Vec<Problem>,
    /// What the scene asks for and wavepath lacks, and how often.
    lacks: Vec<(Problem, u64)>,
    /// What is lacking is replaced, with a warning.
    lenient: bool,
    /// What was left out, counted by kind.
    dropped: Vec<(Dropped, u64, Place)>,
    /// Files read besides scene files.
    inputs: Vec<PathBuf>,
    /// Of the main file, and of the file of the present directive.
    main_directory: PathBuf,
    directory: PathBuf,
    state: GraphicsState,
    stack: Vec<(Block, Span, GraphicsState)>,
    /// Transforms as v3 saves them, which has two stacks: blocks that cross take from both what comes next.
    transforms: Vec<([DAffine3; 2], ActiveTransform)>,
    coordinate_systems: HashMap<String, [DAffine3; 2]>,
    /// No directive so far.
    is_empty: bool,
    in_world: bool,
    world_ended: Option<Span>,
    options: Options,
    materials: MaterialTable,
    textures: Textures,
    images: Images,
    objects: Objects,
    totals: ShapeTotals,
}

impl Builder {
    pub(crate) fn new(dialect: Dialect, directory: PathBuf, lenient: bool) -> Builder {
        let mut materials = MaterialTable::default();
        let default_material = materials.intern(Material::Diffuse {
            reflectance: Parameter::Constant([0.5; 3]),
            sigma: Parameter::Constant(0.0),
        });
        Builder {
            scene: SceneDescription { max_depth: 5, ..SceneDescription::default() },
            shape_spans: Vec::new(),
            dialect,
            warnings: Vec::new(),
            suppressed_warnings: 0,
            deferred: Vec::new(),
            pending: Vec::new(),
            lacks: Vec::new(),
            lenient,
            dropped: Vec::new(),
            inputs: Vec::new(),
            main_directory: directory.clone(),
            directory,
            state: GraphicsState::new(default_material),
            stack: Vec::new(),
            transforms: Vec::new(),
            coordinate_systems: HashMap::new(),
            is_empty: true,
            in_world: false,
            world_ended: None,
            options: Options::default(),
            materials,
            textures: Textures::default(),
            images: Images::default(),
            objects: Objects::default(),
            totals: ShapeTotals::default(),
        }
    }

    /// Whether the scene is of pbrt-v3, as far as that is known.
    pub(crate) fn is_v3(&self) -> bool {
        self.dialect.is_surely_v3()
    }

    /// Puts the camera where something outside of the files says; `span` is where it says so.
    pub(crate) fn set_pose(&mut self, pose: Option<(Pose, Span)>) {
        self.options.pose = pose;
    }

    /// Takes the next directive. `directory`: of the file that it stands in.
    pub(crate) fn statement(&mut self, statement: Statement, directory: &Path) -> Result<Flow> {
        if self.directory != directory {
            self.directory = directory.to_path_buf();
        }
        let Statement { keyword, span, directive, v3_sign } = statement;
        if let Some(span) = v3_sign {
            self.dialect.saw_v3(span)?;
        }
        self.is_empty = false;
        if let Some(ended) = self.world_ended {
            // pbrt-v3 renders every frame of a file.
            self.warn(
                Problem::at(span, format!("{keyword} after WorldEnd"))
                    .label("only what stands before it is rendered: the file's first frame")
                    .note(Place::Span(ended), "the first frame ends here"),
            );
            return Ok(Flow::Ended);
        }
        self.check_order(keyword, &directive, span)?;
        match self.directive(keyword, directive, span) {
            Err(problem) if problem.lacking.is_some() => self.pending.push(*problem),
            result => result?,
        }
        for problem in std::mem::take(&mut self.pending) {
            self.lack(problem);
        }
        Ok(Flow::On)
    }

    fn directive(&mut self, keyword: &'static str, directive: Directive, span: Span) -> Result<()> {
        match directive {
            Directive::Plain(plain) => self.plain(plain, span),
            Directive::Transform(op) => self.transform(keyword, &op, span),
            Directive::ActiveTransform(name) => self.active_transform(&name),
            Directive::Named(naming, name) => self.named(naming, name, span),
            Directive::Entity(entity, name, parameters) => self.entity(entity, name, parameters, span),
            Directive::Texture { name, value_type, class, parameters } => {
                self.texture(name, &value_type, class, parameters)
            }
            Directive::MediumInterface(inside, outside) => {
                self.state.medium = MediumInterface::new(&inside, &outside);
                Ok(())
            }
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
                self.options.aim = Default::default();
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
        self.transforms.push((self.state.ctm, self.state.active));
        Ok(())
    }

    fn pop(&mut self, block: Block, span: Span) -> Result<()> {
        let last = self.stack.last().map(|(open, opened_at, _)| (*open, *opened_at));
        match last {
            Some((open, _)) if open == block => {}
            None => {
                let message = format!("{} without {}", block.end(), block.begin());
                return self.mistake(Problem::at(span, message).label("nothing is open here"));
            }
            Some((open, opened_at)) => {
                let message = format!("{} inside {}", block.end(), open.begin());
                self.mistake(
                    Problem::at(span, message)
                        .label(format!("expected {}", open.end()))
                        .note(Place::Span(opened_at), "opened here"),
                )?;
                self.pop_crossing(block);
                return Ok(());
            }
        }
        let (_, _, saved) = self.stack.pop().expect("it was looked at");
        let (ctm, active) = self.transforms.pop().unwrap_or((saved.ctm, saved.active));
        // In v4 TransformBegin is another word for AttributeBegin.
        if block == Block::Transform && self.dialect.is_v3() {
            (self.state.ctm, self.state.active) = (ctm, active);
        } else {
            self.state = saved;
            (self.state.ctm, self.state.active) = (ctm, active);
        }
        Ok(())
    }

    /// Ends a block that is not the innermost, as v3 does it: attributes and transforms lie on stacks of their own, and
    /// the end of an attribute block takes the uppermost of both.
    fn pop_crossing(&mut self, block: Block) {
        let is_attribute = |open: Block| matches!(open, Block::Attribute | Block::Object);
        let same = |open: Block| if is_attribute(block) { is_attribute(open) } else { open == block };
        let at = self.stack.iter().rposition(|(open, ..)| same(*open));
        match at.map(|at| self.stack.remove(at)) {
            Some((_, _, saved)) if is_attribute(block) => self.state = saved,
            None if is_attribute(block) => return,
            _ => {}
        }
        if let Some((ctm, active)) = self.transforms.pop() {
            (self.state.ctm, self.state.active) = (ctm, active);
        }
    }

    fn check_closed(&mut self, at: Option<Span>) -> Result<()> {
        let open: Vec<(Block, Span)> =
            self.stack.iter().rev().map(|(block, span, _)| (*block, *span)).collect();
        for (block, span) in open {
            let message = format!("{} is never closed", block.begin());
            let problem = Problem::at(span, message).label(format!("expected {} behind it", block.end()));
            self.mistake(match at {
                Some(end) => problem.note(Place::Span(end), "the scene ends here"),
                None => problem,
            })?;
        }
        self.stack.clear();
        Ok(())
    }

    fn transform(&mut self, keyword: &str, op: &TransformOp, span: Span) -> Result<()> {
        let bad = |message: &str| Problem::at(span, format!("{keyword}: {message}"));
        let change = match op {
            TransformOp::Translate(v) => transform::translate(*v),
            TransformOp::Scale(v) => transform::scale(*v),
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
                transform::matrix(m).ok_or_else(|| {
                    bad("the matrix is projective")
                        .label("expected 0 0 0 and not 0 as entries 4, 8, 12 and 16")
                })?
            }
            // Times of a motion; without motion they mean nothing.
            TransformOp::Times(_) => return Ok(()),
        };
        match op {
            TransformOp::Transform(_) => self.state.update(|_| change),
            _ => self.state.update(|ctm| ctm * change),
        }
        if !self.in_world {
            self.options.aim.follow(op, &self.state.ctm[0]);
        }
        // Whether there is a way back matters to what stands under it.
        if self.state.ctm.iter().any(|ctm| !ctm.is_finite()) {
            return Err(bad("the transform that results is not finite"));
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
    fn static_ctm(&mut self, span: Span) -> Result<DAffine3> {
        let [start, end] = self.state.ctm;
        if !transform::same(&start, &end) {
            let problem = Problem::at(span, "motion is not supported")
                .label("the transforms at StartTime and EndTime differ here")
                .lacking("it stands still where it is at StartTime");
            self.pending.push(*problem);
        }
        Ok(start)
    }

    /// Complains if the camera or a light is in a medium.
    fn check_vacuum(&mut self) {
        if self.state.medium.outside {
            self.lack_medium();
        }
    }

    fn lack_medium(&mut self) {
        if let Some(span) = self.state.medium.named {
            let problem = Problem::at(span, "participating media are not supported")
                .label("expected \"\", the vacuum, on both sides")
                .lacking("light goes through the vacuum");
            self.pending.push(*problem);
        }
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
            Naming::NamedMaterial => self.named_material(&name),
            Naming::ObjectBegin => self.begin_object(name, span),
            Naming::ObjectInstance => self.instance(&name, span),
            Naming::ColorSpace => match name.text.as_str() {
                "srgb" => Ok(()),
                "aces2065-1" | "rec2020" | "dci-p3" => {
                    Err(Problem::at(name.span, format!("color space \"{}\" is not supported", name.text))
                        .label("expected \"srgb\"")
                        .lacking("numbers are taken for \"srgb\""))
                }
                _ => Err(unknown_kind("color space", &name, &["srgb"])),
            },
        }
    }

    fn entity(&mut self, entity: Entity, name: Name, mut parameters: Parameters, span: Span) -> Result<()> {
        self.check_arrays(&mut parameters)?;
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
            // A medium matters where a shape, the camera or a light is in it.
            Entity::MakeNamedMedium => {
                parameters.accept_all();
                Ok(())
            }
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

    /// A mistake that ends a scene of v4, and with which v3 lives after a warning.
    fn mistake(&mut self, problem: Box<Problem>) -> Result<()> {
        if self.dialect.is_surely_v4() {
            return Err(problem);
        }
        if self.dialect.is_v3() {
            self.warn(problem);
        } else if self.deferred.len() < MAX_LACKS {
            self.deferred.push(*problem);
        }
        Ok(())
    }

    /// Arrays that are empty, or hold too many numbers.
    fn check_arrays(&mut self, parameters: &mut Parameters) -> Result<()> {
        for problem in parameters.take_mistakes() {
            self.mistake(Box::new(problem))?;
        }
        if self.dialect.is_surely_v3() {
            parameters.forgive_types();
        }
        Ok(())
    }

    /// Complains about parameters that nobody asked for.
    fn check_unused(&mut self, parameters: &Parameters, what: &str) -> Result<()> {
        if let Some(problem) = parameters.unknown_from_outside(what) {
            return Err(problem);
        }
        for problem in parameters.shadowed() {
            self.warn(Box::new(problem));
        }
        for problem in parameters.unknown(what) {
            self.mistake(Box::new(problem))?;
        }
        Ok(())
    }

    /// Notes what the scene needs and wavepath lacks. The same complaint is kept once.
    fn lack(&mut self, problem: Problem) {
        match self.lacks.iter().position(|(known, _)| known.message == problem.message) {
            Some(at) => self.lacks[at].1 += 1,
            None if self.lacks.len() < MAX_LACKS => self.lacks.push((problem, 1)),
            None => {}
        }
    }

    /// What the scene lacks, each with how often.
    fn take_lacks(&mut self) -> Vec<Problem> {
        let with_count = |(problem, count): (Problem, u64)| match count {
            1 => problem,
            _ => {
                let more =
                    if count == 2 { "once more".to_string() } else { format!("{} times more", count - 1) };
                *Box::new(problem).note(Place::Nowhere, format!("the scene has this {more}"))
            }
        };
        std::mem::take(&mut self.lacks).into_iter().map(with_count).collect()
    }

    /// Counts what is left out of the scene.
    fn drop_count(&mut self, what: Dropped, count: u64, place: Place) {
        if count == 0 {
            return;
        }
        match self.dropped.iter_mut().find(|(known, ..)| *known == what) {
            Some((_, total, _)) => *total += count,
            None => self.dropped.push((what, count, place)),
        }
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
    pub(crate) fn finish(mut self) -> std::result::Result<Finished, Vec<Problem>> {
        if let Err(problem) = self.close() {
            return Err(self.failure(*problem));
        }
        let mut lacks = self.take_lacks();
        if !self.deferred.is_empty() || !(lacks.is_empty() || self.lenient) {
            self.deferred.append(&mut lacks);
            return Err(self.deferred);
        }
        for mut problem in lacks {
            if let Some(instead) = problem.lacking {
                problem.label = instead.to_string();
            }
            self.warnings.push(problem);
        }
        self.final_warnings();
        let Builder { scene, warnings, inputs, shape_spans, .. } = self;
        Ok(Finished { scene, warnings, inputs, shape_spans })
    }

    /// Everything there is to say after an error: mistakes that were found before it, and what is lacking.
    pub(crate) fn failure(&mut self, problem: Problem) -> Vec<Problem> {
        let mut all = std::mem::take(&mut self.deferred);
        all.push(problem);
        all.extend(self.take_lacks());
        all
    }

    fn close(&mut self) -> Result<()> {
        self.check_closed(None)?;
        if !self.in_world {
            let what = if self.is_empty { "the file is empty" } else { "the scene has no WorldBegin" };
            return Err(Problem::new(Place::Scene, what)
                .label("expected WorldBegin between the options and the scene"));
        }
        self.finish_instances()?;
        self.finish_options()?;
        self.finish_filter();
        self.finish_materials()?;
        self.finish_textures()?;
        self.scale_lights()
    }

    fn finish_filter(&mut self) {
        self.scene.filter = match self.options.filter {
            Some(filter) => filter,
            None if self.dialect.is_v3() => Filter::Box { radius: [0.5; 2] },
            None => Filter::default(),
        };
    }

    fn final_warnings(&mut self) {
        for (what, count, place) in std::mem::take(&mut self.dropped) {
            self.warnings.push(*what.warning(count, place));
        }
        let emits = |scene: &SceneDescription| {
            !scene.lights.is_empty() || scene.shapes.iter().any(|shape| shape.emission.is_some())
        };
        if !emits(&self.scene) {
            self.warn(Problem::new(Place::Scene, "the scene has no lights: the picture will be black"));
        }
        if self.suppressed_warnings > 0 {
            let text = format!("{} more warnings are not shown", self.suppressed_warnings);
            self.warnings.push(*Problem::new(Place::Nowhere, text));
        }
    }

    /// Applies the film's exposure to everything that shines: the picture is linear in the lights.
    fn scale_lights(&mut self) -> Result<()> {
        let scale = self.options.exposure * self.options.shutter_seconds;
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
            return Err(Problem::new(Place::Scene, "a light is too bright")
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

/// What is left out of a scene, or drawn otherwise than one might expect, with a warning that counts it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Dropped {
    DegenerateTriangles,
    Faces,
    Polygons,
    FoldedQuads,
    UvValues,
    UvArrays,
    Normals,
    NormalArrays,
    Indices,
    SingularShapes,
}

impl Dropped {
    fn warning(self, count: u64, place: Place) -> Box<Problem> {
        let s = if count == 1 { "" } else { "s" };
        let text = match self {
            Dropped::DegenerateTriangles => format!("{count} degenerate triangle{s} (of zero area) left out"),
            Dropped::Faces => {
                format!("{count} face{s} left out: not plane, crossing themselves or without three corners")
            }
            Dropped::Polygons => {
                format!("{count} face{s} with more than four corners cut into triangles (pbrt refuses them)")
            }
            Dropped::FoldedQuads => format!(
                "{count} quad{s} with a reflex corner or crossing edges: drawn as pbrt-v4 does, as folded patches"
            ),
            Dropped::UvValues => format!("{count} texture coordinate{s} left out: not finite"),
            Dropped::Normals => {
                format!("{count} normal{s} left out: not finite; faces with such a corner are shaded flat")
            }
            Dropped::UvArrays => {
                format!("{count} array{s} of texture coordinates left out or cut: not one for each vertex")
            }
            Dropped::NormalArrays => {
                format!("{count} array{s} of normals left out: not one for each vertex")
            }
            Dropped::Indices => {
                let noun = if count == 1 { "index" } else { "indices" };
                format!("{count} {noun} left out behind the last whole face of a mesh")
            }
            Dropped::SingularShapes => {
                format!("{count} shape{s} left out: the transform makes it flat, and cannot be inverted")
            }
        };
        Problem::new(place, text).label("the first is here")
    }
}

/// A thing that must be seen from its own space, under a transform that has no way back.
fn singular(span: Span, what: &str) -> Box<Problem> {
    Problem::at(span, format!("the transform of {what} cannot be inverted"))
        .label("it makes this flat: expected factors that are not 0")
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
