//! What is set from outside of a scene's files: `camera.fov=30`, `material.glass.eta=1.6`.
//!
//! A name is that of a directive and a parameter of it, both as the file has them, so everything that the reader knows can
//! be set, and what it checks in files is checked here: the value replaces the parameter before the directive is read.
//!
//! | name | directive |
//! |---|---|
//! | `camera.P`, `film.P`, `filter.P`, `sampler.P`, `integrator.P` | the one of that kind, or its default |
//! | `material.NAME.P`, `material.N.P` | `MakeNamedMaterial "NAME"`; the `Material` of number N, from 0, in the order of the files |
//! | `light.N.P` | the `LightSource` or `AreaLightSource` of number N |
//! | `texture.NAME.P` | `Texture "NAME"` |
//! | `shape.N.P` | the `Shape` of number N |
//! | `camera.eye`, `.look`, `.up`, `.move`, `.orbit`, `.elevate` | no parameters, but where the camera is: see [`Pose`] |
//!
//! `*` in the place of NAME or N means all of them; the parameter `type` is the kind of the directive.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;

use super::error::{FileId, Place, Problem, Result, Span};
use super::lexer::{parse_number, shorten};
use super::parameters::{Parameter, ParameterType, Parameters, Values};
use super::parser::{Directive, Entity, Name, Plain, Statement};
use super::source::Sources;
use super::suggest::did_you_mean;
use crate::scene::Pose;

/// A value that is set from outside of a scene's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    /// What is set, such as `camera.fov`.
    pub name: String,
    /// Numbers between spaces or commas, or a word; a type as in the file may stand before it: `rgb 0.5 0.2 0.1`.
    pub value: String,
}

impl Override {
    /// Of a name and a value, which need not be right.
    pub fn new(name: impl Into<String>, value: impl Into<String>) -> Self {
        Override { name: name.into(), value: value.into() }
    }
}

impl FromStr for Override {
    type Err = String;
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let expected = || format!("found \"{text}\"; expected NAME=VALUE, such as camera.fov=30");
        let (name, value) = text.split_once('=').ok_or_else(expected)?;
        let (name, value) = (name.trim(), value.trim());
        if name.is_empty() || value.is_empty() || text.chars().any(char::is_control) {
            return Err(expected());
        }
        Ok(Override::new(name, value))
    }
}

impl fmt::Display for Override {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.name, self.value)
    }
}

/// The file that messages name.
const SOURCE: &str = "--set";

/// Directives of which there is one at most.
const SINGLE: [(&str, Entity); 5] = [
    ("camera", Entity::Camera),
    ("film", Entity::Film),
    ("filter", Entity::PixelFilter),
    ("sampler", Entity::Sampler),
    ("integrator", Entity::Integrator),
];

/// Kinds of directives that have a name or a number.
const MANY: [&str; 4] = ["material", "light", "texture", "shape"];

/// Where the camera is.
const POSE: [&str; 6] = ["eye", "look", "up", "move", "orbit", "elevate"];

/// Names that a message or a list has room for.
const MOST_NAMES: usize = 10_000;

/// An [`Override`], taken apart.
struct Item {
    /// Of the directive: `camera`, `material.glass`, `light.*`.
    target: String,
    parameter: String,
    value: String,
    name_span: Span,
    value_span: Span,
    applied: bool,
}

/// All overrides of a scene, and what of it was met so far.
#[derive(Default)]
pub(crate) struct Overrides {
    items: Vec<Item>,
    /// Which of [`SINGLE`] were met.
    met: [bool; SINGLE.len()],
    materials: usize,
    lights: usize,
    shapes: usize,
    /// What could be named: of many shapes, the first.
    targets: Vec<String>,
    /// Names and values of everything that can be set, if someone wants to know.
    names: Option<Vec<(String, String)>>,
}

impl Overrides {
    /// Takes them apart.
    pub(crate) fn new(overrides: &[Override], list: bool, sources: &mut Sources) -> Result<Overrides> {
        let mut all = Overrides { names: list.then(Vec::new), ..Overrides::default() };
        if overrides.is_empty() {
            return Ok(all);
        }
        let clean = |text: &str| text.replace(|c: char| c.is_control(), " ");
        let lines: Vec<[String; 2]> = overrides.iter().map(|o| [clean(&o.name), clean(&o.value)]).collect();
        let text: String = lines.iter().map(|[name, value]| format!("{name}={value}\n")).collect();
        let file = sources.add_text(SOURCE, &text);
        let mut at = 0;
        for (index, [name, value]) in lines.into_iter().enumerate() {
            let item = Item::new(name, value, file, index as u32 + 1, at)?;
            at = item.value_span.end + 1;
            if let Some(first) = all.items.iter().find(|other| other.is_same(&item)) {
                return Err(Problem::at(item.name_span, "this is set twice")
                    .note(Place::Span(first.name_span), "the first is here"));
            }
            all.items.push(item);
        }
        Ok(all)
    }

    /// Where the camera is put, and where that is said.
    pub(crate) fn pose(&self) -> Result<Option<(Pose, Span)>> {
        let mut pose = None;
        for item in self.items.iter().filter(|item| item.is_pose()) {
            let (pose, _) = pose.get_or_insert((Pose::default(), item.name_span));
            let numbers = item.numbers();
            let one = || match numbers.as_deref() {
                Some([number]) => Ok(*number),
                _ => Err(Problem::at(item.value_span, "not a number").label("expected degrees")),
            };
            let three = || match numbers.as_deref() {
                Some([x, y, z]) => Ok(DVec3::new(*x, *y, *z)),
                _ => Err(Problem::at(item.value_span, "not three numbers").label("expected x, y and z")),
            };
            match item.parameter.as_str() {
                "eye" => pose.eye = Some(three()?),
                "look" => pose.look = Some(three()?),
                "up" => pose.up = Some(three()?),
                "move" => pose.shift = three()?,
                "orbit" => pose.orbit = one()?,
                _ => pose.elevate = one()?,
            }
        }
        Ok(pose)
    }

    /// Looks at a statement, and sets what is to be set in it. Returns statements that must come before it: options that
    /// the file does not have, but which are set.
    pub(crate) fn apply(&mut self, statement: &mut Statement, is_v3: bool) -> Result<Vec<Statement>> {
        match &mut statement.directive {
            Directive::Plain(Plain::WorldBegin) => return self.missing(statement.span, is_v3),
            Directive::Entity(entity, name, parameters) => {
                let Some(target) = self.target_of(*entity, &name.text) else { return Ok(Vec::new()) };
                let kind = (*entity != Entity::MakeNamedMaterial).then_some(name);
                self.set(&target, kind, parameters)?;
            }
            Directive::Texture { name, class, parameters, .. } => {
                let target = self.is_wanted().then(|| self.meet(format!("texture.{}", name.text)));
                if let Some(target) = target {
                    self.set(&target, Some(class), parameters)?;
                }
            }
            _ => {}
        }
        Ok(Vec::new())
    }

    /// Whether there is anything to do.
    fn is_wanted(&self) -> bool {
        !self.items.is_empty() || self.names.is_some()
    }

    fn meet(&mut self, target: String) -> String {
        if self.targets.len() < MOST_NAMES && !self.targets.contains(&target) {
            self.targets.push(target.clone());
        }
        target
    }

    fn target_of(&mut self, entity: Entity, name: &str) -> Option<String> {
        if !self.is_wanted() {
            return None;
        }
        if let Some(index) = SINGLE.iter().position(|(_, single)| *single == entity) {
            self.met[index] = true;
            return Some(SINGLE[index].0.into());
        }
        let next = |count: &mut usize| {
            *count += 1;
            *count - 1
        };
        Some(match entity {
            Entity::MakeNamedMaterial => self.meet(format!("material.{name}")),
            Entity::Material => {
                let number = next(&mut self.materials);
                self.meet(format!("material.{number}"))
            }
            Entity::LightSource | Entity::AreaLightSource => {
                let number = next(&mut self.lights);
                self.meet(format!("light.{number}"))
            }
            // There may be millions: those beyond are not looked for in a list.
            Entity::Shape => {
                let number = next(&mut self.shapes);
                match self.shapes {
                    0..=100 => self.meet(format!("shape.{number}")),
                    _ => format!("shape.{number}"),
                }
            }
            _ => return None,
        })
    }

    /// Sets what is to be set in a directive. `kind` is its type, where that is no parameter.
    fn set(&mut self, target: &str, mut kind: Option<&mut Name>, parameters: &mut Parameters) -> Result<()> {
        for item in &mut self.items {
            if item.is_pose() {
                item.applied |= item.target == target;
            } else if item.is_of(target) {
                item.applied = true;
                match &mut kind {
                    Some(kind) if item.parameter == "type" => {
                        **kind = Name { text: item.word().to_string(), span: item.value_span };
                    }
                    _ => {
                        let present = parameters.own().iter().rev().find(|p| p.name == item.parameter);
                        let readings = item.readings(present)?;
                        parameters.replace(&item.parameter, readings);
                    }
                }
            }
        }
        let Some(names) = self.names.as_mut().filter(|names| names.len() < MOST_NAMES) else {
            return Ok(());
        };
        if let Some(kind) = kind {
            names.push((format!("{target}.type"), kind.text.clone()));
        }
        for parameter in parameters.own() {
            let name = format!("{target}.{}", parameter.name);
            // Of several readings, the likeliest is the last.
            match names.last_mut().filter(|(last, _)| *last == name) {
                Some((_, value)) => *value = describe(parameter),
                None => names.push((name, describe(parameter))),
            }
        }
        Ok(())
    }

    /// Directives of which the scene has the default, but which are set.
    fn missing(&mut self, span: Span, is_v3: bool) -> Result<Vec<Statement>> {
        let mut statements = Vec::new();
        for (index, (target, entity)) in SINGLE.into_iter().enumerate() {
            if self.met[index] || !self.items.iter().any(|item| item.target == target) {
                continue;
            }
            self.met[index] = true;
            let (keyword, kind) = match entity {
                Entity::Camera => ("Camera", "perspective"),
                Entity::Film => ("Film", if is_v3 { "image" } else { "rgb" }),
                Entity::PixelFilter => ("PixelFilter", if is_v3 { "box" } else { "gaussian" }),
                Entity::Sampler => ("Sampler", "halton"),
                _ => ("Integrator", "path"),
            };
            let mut name = Name { text: kind.into(), span };
            let mut parameters = Parameters::new(Vec::new(), span, Vec::new());
            self.set(target, Some(&mut name), &mut parameters)?;
            let directive = Directive::Entity(entity, name, parameters);
            statements.push(Statement { keyword, span, directive, v3_sign: None });
        }
        Ok(statements)
    }

    /// Names and values of what can be set, if they were asked for; complains about what was set and is not there.
    pub(crate) fn finish(self) -> Result<Vec<(String, String)>> {
        if let Some(item) = self.items.iter().find(|item| !item.applied) {
            return Err(self.unknown(item));
        }
        Ok(self.names.unwrap_or_default())
    }

    fn unknown(&self, item: &Item) -> Box<Problem> {
        let kind = item.target.split('.').next().unwrap_or_default();
        let single = SINGLE.iter().map(|(name, _)| *name);
        let of_kind: Vec<&str> = self
            .targets
            .iter()
            .map(String::as_str)
            .filter(|target| target.strip_prefix(kind).is_some_and(|rest| rest.starts_with('.')))
            .collect();
        let label = if !MANY.contains(&kind) {
            let known: Vec<&str> = single.chain(MANY).collect();
            format!("expected {}{}", known.join(", "), did_you_mean(kind, &known))
        } else if of_kind.is_empty() {
            format!("the scene has no {kind} of its own")
        } else {
            const ROOM: usize = 40;
            let more = of_kind.len().saturating_sub(ROOM);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let listed = of_kind[..of_kind.len().min(ROOM)].join(", ");
            format!("the scene has {listed}{more}{}", did_you_mean(&item.target, &of_kind))
        };
        Problem::at(item.name_span, format!("the scene has no {}", shorten(&item.target))).label(label)
    }
}

impl Item {
    /// `start` is the offset of its line.
    fn new(name: String, value: String, file: FileId, line: u32, start: u64) -> Result<Item> {
        let middle = start + name.len() as u64;
        let name_span = Span { file, line, line_start: start, start, end: middle };
        let value_span = Span { start: middle + 1, end: middle + 1 + value.len() as u64, ..name_span };
        let Some((target, parameter)) = name.rsplit_once('.').filter(|(a, b)| !a.is_empty() && !b.is_empty())
        else {
            return Err(Problem::at(name_span, format!("\"{}\" names nothing", shorten(&name))).label(
                "expected a directive and its parameter, such as camera.fov, material.NAME.roughness or light.0.scale",
            ));
        };
        let (target, parameter) = (target.to_string(), parameter.to_string());
        Ok(Item { target, parameter, value, name_span, value_span, applied: false })
    }

    fn is_same(&self, other: &Item) -> bool {
        self.target == other.target && self.parameter == other.parameter
    }

    fn is_pose(&self) -> bool {
        self.target == "camera" && POSE.contains(&self.parameter.as_str())
    }

    fn is_of(&self, target: &str) -> bool {
        match self.target.strip_suffix(".*") {
            Some(kind) => target.strip_prefix(kind).is_some_and(|rest| rest.starts_with('.')),
            None => self.target == target,
        }
    }

    /// The value between its spaces, commas, brackets and quotes.
    fn tokens(&self) -> Vec<&str> {
        let separates = |c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']' | '"');
        self.value.split(separates).filter(|token| !token.is_empty()).collect()
    }

    fn word(&self) -> &str {
        self.value.trim_matches(|c: char| c.is_whitespace() || c == '"')
    }

    fn numbers(&self) -> Option<Vec<f64>> {
        self.tokens().into_iter().map(|token| parse_number(token.as_bytes())).collect()
    }

    /// The parameter, once for each type that the value may have, the likeliest last. `present` is what the file has.
    fn readings(&self, present: Option<&Parameter>) -> Result<Vec<Parameter>> {
        use ParameterType::*;
        let make = |ty: ParameterType, values: Values| {
            Parameter::new(ty, self.parameter.clone(), values, self.name_span, self.value_span)
                .set_from_outside()
        };
        let tokens = self.tokens();
        // With a type, as in the file.
        if let [ty, rest @ ..] = tokens.as_slice()
            && !rest.is_empty()
            && let Some((ty, _)) = ParameterType::from_name(ty)
        {
            return match values_of(ty, rest) {
                Some(values) => Ok(vec![make(ty, values)]),
                None => Err(Problem::at(self.value_span, format!("not a value of type {}", ty.name()))
                    .label("expected a type and its values, such as rgb 0.5 0.2 0.1")),
            };
        }
        let mut types: Vec<ParameterType> = match (self.numbers(), tokens.as_slice()) {
            (Some(numbers), _) => match numbers.len() {
                1 => vec![Rgb, Integer, Float],
                2 => vec![Vector2, Point2, Float],
                3 => vec![Float, Normal3, Vector3, Point3, Rgb],
                _ => vec![Spectrum, Integer, Float],
            },
            (None, ["true" | "false"]) => vec![String, Bool],
            (None, _) => vec![Bool, Spectrum, Texture, String],
        };
        // A number in place of a texture or a name is a number.
        let is_word = |ty| matches!(ty, Bool | String | Texture);
        if let Some(present) = present.filter(|p| self.numbers().is_none() || !is_word(p.ty)) {
            types.retain(|ty| *ty != present.ty);
            types.push(present.ty);
        }
        let words;
        let tokens: &[&str] = match self.numbers() {
            Some(_) => &tokens,
            None => {
                words = [self.word()];
                &words
            }
        };
        let fits = |ty: &ParameterType| match (ty, tokens.len()) {
            (Rgb, 1) => true,
            (Point2 | Vector2 | Point3 | Vector3 | Normal3 | Rgb | Xyz, n) => n == ty.arity(),
            // Several samples, or a name.
            (Spectrum, 1) => self.numbers().is_none(),
            (Blackbody | Texture | String | Bool, n) => n == 1,
            _ => true,
        };
        let reading = |ty: ParameterType| {
            let grey = [tokens[0]; 3];
            let tokens = if ty == Rgb && tokens.len() == 1 { &grey[..] } else { tokens };
            values_of(ty, tokens).map(|values| make(ty, values))
        };
        if tokens.is_empty() {
            return Err(Problem::at(self.value_span, "no value").label("expected NAME=VALUE"));
        }
        let readings: Vec<Parameter> = types.into_iter().filter(fits).filter_map(reading).collect();
        if readings.is_empty() {
            return Err(Problem::at(self.value_span, format!("\"{}\" is no value", shorten(&self.value)))
                .label("expected numbers or a word; a type may stand before them, such as rgb 0.5 0.2 0.1"));
        }
        Ok(readings)
    }
}

/// The values of a type, if they can be that.
fn values_of(ty: ParameterType, tokens: &[&str]) -> Option<Values> {
    use ParameterType::*;
    let strings = || Values::Strings(tokens.iter().map(|token| token.to_string()).collect());
    let numbers = || {
        let numbers: Option<Vec<f64>> = tokens.iter().map(|token| parse_number(token.as_bytes())).collect();
        numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite())).map(Values::Numbers)
    };
    match ty {
        Integer => {
            let whole: Option<Vec<i32>> = tokens.iter().map(|token| token.parse().ok()).collect();
            whole.map(Values::Integers)
        }
        Bool => {
            let values: Option<Vec<bool>> = tokens.iter().map(|token| token.parse().ok()).collect();
            values.map(Values::Bools)
        }
        String | Texture => Some(strings()),
        Spectrum => numbers().or_else(|| Some(strings())),
        _ => numbers(),
    }
}

/// Type and value, short.
fn describe(parameter: &Parameter) -> String {
    const ROOM: usize = 9;
    let ty = parameter.ty.name();
    if parameter.len() > ROOM {
        return format!("{ty}, {} values", parameter.len());
    }
    let words: Vec<String> = match &parameter.values {
        Values::Numbers(numbers) => numbers.iter().map(f64::to_string).collect(),
        Values::Integers(integers) => integers.iter().map(i32::to_string).collect(),
        Values::Strings(strings) => strings.iter().map(|text| shorten(text)).collect(),
        Values::Bools(bools) => bools.iter().map(bool::to_string).collect(),
    };
    format!("{ty} {}", words.join(" "))
}
