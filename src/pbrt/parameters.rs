//! Typed parameters of a directive: `"float radius" [ 1 ]`.
//!
//! Every look-up marks the parameter as used and remembers the name that was asked for; what nobody asked for is
//! a mistake in the scene, and the names that were asked for tell what was probably meant.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use super::error::{Place, Problem, Result, Span};
use super::lexer::shorten;
use super::suggest::did_you_mean;

/// Type of a parameter, v3's names folded into v4's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ParameterType {
    Integer,
    Float,
    Bool,
    String,
    Point2,
    Vector2,
    Point3,
    Vector3,
    Normal3,
    Rgb,
    Xyz,
    Blackbody,
    Spectrum,
    Texture,
}

impl ParameterType {
    /// By its name in the file, and whether only pbrt-v3 knows that name.
    pub(crate) fn from_name(name: &str) -> Option<(ParameterType, bool)> {
        use ParameterType::*;
        Some(match name {
            "integer" => (Integer, false),
            "float" => (Float, false),
            "bool" => (Bool, false),
            "string" => (String, false),
            "point2" => (Point2, false),
            "vector2" => (Vector2, false),
            "point3" | "point" => (Point3, false),
            "vector3" | "vector" => (Vector3, false),
            "normal3" | "normal" => (Normal3, false),
            "rgb" => (Rgb, false),
            "color" => (Rgb, true),
            "xyz" => (Xyz, true),
            "blackbody" => (Blackbody, false),
            "spectrum" => (Spectrum, false),
            "texture" => (Texture, false),
            _ => return None,
        })
    }

    /// The names that exist, for messages.
    pub(crate) const NAMES: [&'static str; 13] = [
        "integer",
        "float",
        "bool",
        "string",
        "point2",
        "vector2",
        "point3",
        "vector3",
        "normal3",
        "rgb",
        "blackbody",
        "spectrum",
        "texture",
    ];

    /// Its name in pbrt-v4.
    pub(crate) fn name(self) -> &'static str {
        use ParameterType::*;
        match self {
            Integer => "integer",
            Float => "float",
            Bool => "bool",
            String => "string",
            Point2 => "point2",
            Vector2 => "vector2",
            Point3 => "point3",
            Vector3 => "vector3",
            Normal3 => "normal3",
            Rgb => "rgb",
            Xyz => "xyz",
            Blackbody => "blackbody",
            Spectrum => "spectrum",
            Texture => "texture",
        }
    }

    /// The types of vertices, normals and texture coordinates.
    pub(crate) fn is_of_a_mesh(self) -> bool {
        use ParameterType::*;
        matches!(self, Float | Point2 | Vector2 | Point3 | Vector3 | Normal3)
    }

    /// Numbers that make one value.
    pub(crate) fn arity(self) -> usize {
        use ParameterType::*;
        match self {
            Point2 | Vector2 => 2,
            Point3 | Vector3 | Normal3 | Rgb | Xyz => 3,
            _ => 1,
        }
    }
}

/// Values of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    Numbers(Vec<f64>),
    Integers(Vec<i32>),
    Strings(Vec<String>),
    Bools(Vec<bool>),
}

/// A parameter.
#[derive(Clone, Debug)]
pub(crate) struct Parameter {
    pub ty: ParameterType,
    pub name: String,
    pub values: Values,
    /// Of the declaration `"type name"`.
    pub span: Span,
    /// Of the single value, or of the bracket before several.
    pub values_span: Span,
    used: Cell<bool>,
    /// Given from outside of the files, without a type: it stands there once for each type that the value may have.
    is_set: bool,
}

impl Parameter {
    pub(crate) fn new(
        ty: ParameterType,
        name: String,
        values: Values,
        span: Span,
        values_span: Span,
    ) -> Parameter {
        Parameter { ty, name, values, span, values_span, used: Cell::new(false), is_set: false }
    }

    /// Marks what comes from outside of the files.
    pub(crate) fn set_from_outside(mut self) -> Parameter {
        self.is_set = true;
        self
    }

    /// Place of one number or string.
    pub(crate) fn place(&self, index: usize) -> Place {
        Place::Value(self.values_span, index)
    }

    /// Where a number stands that is none (`nan`, `inf`): only arrays of a mesh may hold such.
    fn not_finite(&self) -> Option<Box<Problem>> {
        let index = self.numbers().iter().position(|number| !number.is_finite())?;
        let found = self.numbers()[index];
        let text = match found.is_nan() {
            true => "`nan` is not a number",
            false => "number too large",
        };
        Some(Problem::new(self.place(index), text).label("expected a finite number"))
    }

    /// A complaint about the value.
    pub(crate) fn problem(&self, message: impl Into<String>) -> Box<Problem> {
        Problem::new(self.place(0), message)
    }

    /// The numbers; empty for the types that have none.
    pub(crate) fn numbers(&self) -> &[f64] {
        match &self.values {
            Values::Numbers(numbers) => numbers,
            _ => &[],
        }
    }

    /// The strings; empty for the types that have none.
    pub(crate) fn strings(&self) -> &[String] {
        match &self.values {
            Values::Strings(strings) => strings,
            _ => &[],
        }
    }

    pub(crate) fn len(&self) -> usize {
        match &self.values {
            Values::Numbers(numbers) => numbers.len(),
            Values::Integers(integers) => integers.len(),
            Values::Strings(strings) => strings.len(),
            Values::Bools(bools) => bools.len(),
        }
    }

    /// Complains unless there is exactly one value of the type.
    pub(crate) fn single(&self) -> Result<()> {
        let arity = self.ty.arity();
        if self.len() == arity {
            return Ok(());
        }
        let place = if self.len() > arity { self.place(arity) } else { self.place(0) };
        Err(Problem::new(place, format!("\"{}\" has {} values", self.name, self.len())).label(format!(
            "expected {}",
            match arity {
                1 => "one value".to_string(),
                n => format!("{n} numbers"),
            }
        )))
    }
}

/// The parameters of one directive, and the defaults that `Attribute` gave for its kind.
#[derive(Debug, Default)]
pub(crate) struct Parameters {
    own: Vec<Parameter>,
    defaults: Vec<Rc<Parameter>>,
    asked: RefCell<Vec<&'static str>>,
    /// Of the directive.
    directive: Option<Span>,
    /// Arrays that are empty or hold too many numbers for their type: left out or cut, as pbrt-v3 does; pbrt-v4 refuses
    /// them.
    mistakes: Vec<Problem>,
    /// pbrt-v3 takes no notice of a parameter whose type is not the one that it looks for.
    forgives_types: bool,
}

impl Parameters {
    pub(crate) fn new(own: Vec<Parameter>, directive: Span, mistakes: Vec<Problem>) -> Parameters {
        Parameters { own, directive: Some(directive), mistakes, ..Parameters::default() }
    }

    /// Leaves parameters of an unexpected type unused instead of complaining, as pbrt-v3 does.
    pub(crate) fn forgive_types(&mut self) {
        self.forgives_types = true;
    }

    /// Takes the complaints about arrays.
    pub(crate) fn take_mistakes(&mut self) -> Vec<Problem> {
        std::mem::take(&mut self.mistakes)
    }

    /// Adds the defaults of `Attribute`. They may stay unused.
    pub(crate) fn with_defaults(mut self, defaults: &[Rc<Parameter>]) -> Parameters {
        self.defaults = defaults.to_vec();
        self
    }

    /// The parameters as the directive has them.
    pub(crate) fn own(&self) -> &[Parameter] {
        &self.own
    }

    /// Puts a parameter in the place of all of its name: one for each type that its value may have, the likeliest last.
    pub(crate) fn replace(&mut self, name: &str, readings: Vec<Parameter>) {
        self.own.retain(|p| p.name != name);
        self.own.extend(readings);
    }

    /// Gives up the parameters, to become defaults.
    pub(crate) fn into_own(self) -> Vec<Parameter> {
        self.own
    }

    /// The parameter of this name, the last where there are several, the directive's own before defaults.
    pub(crate) fn find(&self, name: &'static str) -> Option<&Parameter> {
        let mut asked = self.asked.borrow_mut();
        if !asked.contains(&name) {
            asked.push(name);
        }
        self.given(name)
    }

    /// As [`Parameters::find`], for a name that should not be proposed: it is there to be refused.
    pub(crate) fn given(&self, name: &str) -> Option<&Parameter> {
        let own = self.own.iter().rev().find(|p| p.name == name);
        let default = || self.defaults.iter().rev().map(|p| &**p).find(|p| p.name == name);
        let found = own.or_else(default)?;
        found.used.set(true);
        Some(found)
    }

    /// Whether there is a parameter of this name. It does not count as used.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.own.iter().any(|p| p.name == name) || self.defaults.iter().any(|p| p.name == name)
    }

    /// The parameter of this name, which must have one of these types and hold finite numbers.
    pub(crate) fn typed(&self, name: &'static str, types: &[ParameterType]) -> Result<Option<&Parameter>> {
        let found = self.array(name, types)?;
        match found.and_then(Parameter::not_finite) {
            Some(problem) => Err(problem),
            None => Ok(found),
        }
    }

    /// As [`Parameters::typed`], for arrays of a mesh, in which exporters leave numbers that are none.
    pub(crate) fn array(&self, name: &'static str, types: &[ParameterType]) -> Result<Option<&Parameter>> {
        let Some(parameter) = self.find(name) else {
            return Ok(None);
        };
        if types.contains(&parameter.ty) {
            return Ok(Some(parameter));
        }
        // What is set from outside without a type has the one that is looked for.
        if parameter.is_set {
            let fits = |p: &&Parameter| p.name == name && types.contains(&p.ty);
            if let Some(reading) = self.own.iter().rev().find(fits) {
                reading.used.set(true);
                return Ok(Some(reading));
            }
        } else if self.forgives_types {
            parameter.used.set(false);
            return Ok(None);
        }
        let expected: Vec<&str> = types.iter().map(|t| t.name()).collect();
        Err(Problem::at(parameter.span, format!("parameter \"{name}\" has type {}", parameter.ty.name()))
            .label(format!("expected type {}", expected.join(" or "))))
    }

    fn one(&self, name: &'static str, ty: ParameterType) -> Result<Option<&Parameter>> {
        let found = self.typed(name, &[ty])?;
        if let Some(parameter) = found {
            parameter.single()?;
        }
        Ok(found)
    }

    /// A single number.
    pub(crate) fn float(&self, name: &'static str) -> Result<Option<f64>> {
        Ok(self.one(name, ParameterType::Float)?.map(|p| p.numbers()[0]))
    }

    /// A single number with a default.
    pub(crate) fn float_or(&self, name: &'static str, default: f64) -> Result<f64> {
        Ok(self.float(name)?.unwrap_or(default))
    }

    /// A single number above 0 with a default.
    pub(crate) fn positive_or(&self, name: &'static str, default: f64) -> Result<f64> {
        let value = self.float_or(name, default)?;
        if value > 0.0 {
            Ok(value)
        } else {
            Err(self.bad(name, &value.to_string(), "expected a number above 0"))
        }
    }

    /// A single number that is not negative, with a default.
    pub(crate) fn non_negative_or(&self, name: &'static str, default: f64) -> Result<f64> {
        let value = self.float_or(name, default)?;
        if value >= 0.0 {
            Ok(value)
        } else {
            Err(self.bad(name, &value.to_string(), "expected a number that is not negative"))
        }
    }

    /// A complaint about the value of a parameter.
    pub(crate) fn bad(&self, name: &'static str, value: &str, expected: impl Into<String>) -> Box<Problem> {
        // What is not given is a default that another parameter spoils: the directive is at fault.
        let place = match (self.find(name), self.directive) {
            (Some(parameter), _) => parameter.place(0),
            (None, Some(span)) => Place::Span(span),
            (None, None) => Place::Scene,
        };
        Problem::new(place, format!("\"{name}\" is {}", shorten(value))).label(expected)
    }

    /// A single integer.
    pub(crate) fn integer(&self, name: &'static str) -> Result<Option<i32>> {
        let found = self.one(name, ParameterType::Integer)?;
        Ok(found.and_then(|p| match &p.values {
            Values::Integers(values) => values.first().copied(),
            _ => None,
        }))
    }

    /// A single integer of at least 1, with a default.
    pub(crate) fn count_or(&self, name: &'static str, default: u32) -> Result<u32> {
        match self.integer(name)? {
            None => Ok(default),
            Some(value) if value >= 1 => Ok(value as u32),
            Some(value) => Err(self.bad(name, &value.to_string(), "expected at least 1")),
        }
    }

    /// All integers of an array.
    pub(crate) fn integers(&self, name: &'static str) -> Result<Option<&[i32]>> {
        let found = self.typed(name, &[ParameterType::Integer])?;
        Ok(found.map(|p| match &p.values {
            Values::Integers(values) => &values[..],
            _ => &[],
        }))
    }

    /// A truth value.
    pub(crate) fn bool_or(&self, name: &'static str, default: bool) -> Result<bool> {
        let found = self.one(name, ParameterType::Bool)?;
        Ok(found.map_or(default, |p| matches!(&p.values, Values::Bools(values) if values == &[true])))
    }

    /// A single string.
    pub(crate) fn string(&self, name: &'static str) -> Result<Option<&str>> {
        let found = self.one(name, ParameterType::String)?;
        Ok(found.and_then(|p| p.strings().first()).map(String::as_str))
    }

    /// All numbers of an array.
    pub(crate) fn floats(&self, name: &'static str) -> Result<Option<&[f64]>> {
        Ok(self.typed(name, &[ParameterType::Float])?.map(Parameter::numbers))
    }

    /// A single point.
    pub(crate) fn point3(&self, name: &'static str) -> Result<Option<[f64; 3]>> {
        let found = self.one(name, ParameterType::Point3)?;
        Ok(found.map(|p| [p.numbers()[0], p.numbers()[1], p.numbers()[2]]))
    }

    /// Marks names as used that mean nothing here, and change nothing.
    pub(crate) fn accept(&self, names: &[&'static str]) {
        for name in names {
            self.find(name);
        }
    }

    /// Marks everything as used.
    pub(crate) fn accept_all(&self) {
        self.own.iter().for_each(|p| p.used.set(true));
    }

    /// A complaint for each parameter that nobody asked for. `what` is the directive, such as `shape "sphere"`.
    pub(crate) fn unknown(&self, what: &str) -> Vec<Problem> {
        let unknown = self.own.iter().filter(|p| !p.used.get() && !self.is_shadowed(p));
        unknown.map(|p| *self.unknown_problem(p, what)).collect()
    }

    /// A complaint for each parameter that a later one of the same name replaces, as in pbrt.
    pub(crate) fn shadowed(&self) -> Vec<Problem> {
        let shadowed = self.own.iter().filter(|p| !p.is_set && !p.used.get() && self.is_shadowed(p));
        let text = |p: &Parameter| format!("parameter \"{}\" is given twice", shorten(&p.name));
        shadowed.map(|p| *Problem::at(p.span, text(p)).label("the last one counts")).collect()
    }

    /// A complaint about a parameter from outside that nobody asked for.
    pub(crate) fn unknown_from_outside(&self, what: &str) -> Option<Box<Problem>> {
        let unknown = self.own.iter().find(|p| p.is_set && !p.used.get() && !self.is_shadowed(p));
        unknown.map(|p| self.unknown_problem(p, what))
    }

    fn is_shadowed(&self, parameter: &Parameter) -> bool {
        self.own.iter().any(|other| other.used.get() && other.name == parameter.name)
    }

    fn unknown_problem(&self, parameter: &Parameter, what: &str) -> Box<Problem> {
        let name = shorten(&parameter.name);
        let asked = self.asked.borrow();
        let known = match asked.is_empty() {
            true => "no parameters".to_string(),
            false => format!("one of {}", asked.join(", ")),
        };
        let hint = did_you_mean(&parameter.name, &asked);
        Problem::at(parameter.span, format!("unknown parameter \"{name}\" for {what}"))
            .label(format!("expected {known}{hint}"))
    }
}
