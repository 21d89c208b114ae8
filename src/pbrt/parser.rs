//! Knows the format: turns tokens into statements with typed parameters, and follows `Include` and `Import`.
//!
//! It knows nothing of what wavepath supports: that is [`super::interpret`]'s affair.

use std::path::{Path, PathBuf};

use super::error::{Place, Problem, Result, Span};
use super::lexer::{Lexer, Token, TokenKind, Value, parse_number, shorten};
use super::parameters::{Parameter, ParameterType, Parameters, Values};
use super::source::Sources;
use super::suggest::did_you_mean;
use crate::memory;

/// Deepest nesting of `Include`.
const MAX_INCLUDE_DEPTH: usize = 64;

/// Most files that one scene may include, repetitions counted: a file that includes the next one twice, and so on,
/// would otherwise take exponential time.
const MAX_INCLUDES: usize = 100_000;

/// A quoted name and its place.
#[derive(Clone, Debug)]
pub(crate) struct Name {
    pub text: String,
    pub span: Span,
}

/// Directives without arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plain {
    AttributeBegin,
    AttributeEnd,
    TransformBegin,
    TransformEnd,
    ObjectEnd,
    ReverseOrientation,
    WorldBegin,
    WorldEnd,
    Identity,
    /// An imported file begins; made by the parser.
    ImportBegin,
    /// An imported file is over.
    ImportEnd,
}

/// Directives with numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TransformOp {
    Translate([f64; 3]),
    Scale([f64; 3]),
    Rotate([f64; 4]),
    LookAt([f64; 9]),
    Transform(Box<[f64; 16]>),
    ConcatTransform(Box<[f64; 16]>),
    Times([f64; 2]),
}

/// Directives with one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Naming {
    CoordinateSystem,
    CoordSysTransform,
    NamedMaterial,
    ObjectBegin,
    ObjectInstance,
    ColorSpace,
}

/// Directives with a name (a kind, or of a new thing) and parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Entity {
    Accelerator,
    AreaLightSource,
    Attribute,
    Camera,
    Film,
    Integrator,
    LightSource,
    MakeNamedMaterial,
    MakeNamedMedium,
    Material,
    PixelFilter,
    Sampler,
    Shape,
}

/// A directive with its arguments.
#[derive(Debug)]
pub(crate) enum Directive {
    Plain(Plain),
    Transform(TransformOp),
    ActiveTransform(Name),
    Named(Naming, Name),
    Entity(Entity, Name, Parameters),
    Texture { name: Name, value_type: Name, class: Name, parameters: Parameters },
    MediumInterface(Name, Name),
    Option(Parameter),
}

/// A directive and its place.
#[derive(Debug)]
pub(crate) struct Statement {
    pub keyword: &'static str,
    pub span: Span,
    pub directive: Directive,
    /// A way of writing that only pbrt-v3 has.
    pub v3_sign: Option<Span>,
}

/// Every directive, for messages.
pub(crate) const KEYWORDS: [&str; 41] = [
    "Accelerator",
    "ActiveTransform",
    "AreaLightSource",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ColorSpace",
    "ConcatTransform",
    "CoordSysTransform",
    "CoordinateSystem",
    "Film",
    "Identity",
    "Import",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "MakeNamedMedium",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Option",
    "PixelFilter",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "Texture",
    "Transform",
    "TransformBegin",
    "TransformEnd",
    "TransformTimes",
    "Translate",
    "WorldBegin",
    "WorldEnd",
];

struct OpenFile {
    lexer: Lexer,
    /// Canonical path, to find cycles.
    identity: Option<PathBuf>,
    /// Names inside are relative to it.
    directory: PathBuf,
    /// The place that asked for it.
    included_at: Option<Span>,
    imported: bool,
}

/// Statements of a scene, in order.
pub(crate) struct Parser {
    stack: Vec<OpenFile>,
    includes: usize,
    v3_sign: Option<Span>,
}

impl Parser {
    /// Starts with an open file.
    pub(crate) fn new(lexer: Lexer, path: Option<&Path>, directory: &Path) -> Parser {
        let file = OpenFile {
            lexer,
            identity: path.and_then(|p| p.canonicalize().ok()),
            directory: directory.to_path_buf(),
            included_at: None,
            imported: false,
        };
        Parser { stack: vec![file], includes: 0, v3_sign: None }
    }

    /// Directory that file names of the last statement are relative to.
    pub(crate) fn directory(&self) -> &Path {
        self.stack.last().map_or(Path::new(""), |file| &file.directory)
    }

    /// Adds to a complaint which `Include` led to the present file.
    pub(crate) fn trace(&self, mut problem: Box<Problem>) -> Box<Problem> {
        for file in self.stack.iter().rev() {
            if let Some(span) = file.included_at {
                problem = problem.note(Place::Span(span), "included from here");
            }
        }
        problem
    }

    fn lexer(&mut self) -> &mut Lexer {
        &mut self.stack.last_mut().expect("a file is open while a statement is read").lexer
    }

    /// The next statement; `None` when all files are over.
    pub(crate) fn next(&mut self, sources: &mut Sources) -> Result<Option<Statement>> {
        loop {
            let Some(file) = self.stack.last_mut() else {
                return Ok(None);
            };
            let token = file.lexer.next_token()?;
            match token.kind {
                TokenKind::Word(ref word) => {
                    let word = word.clone();
                    if let Some(statement) = self.statement(&word, token.span, sources)? {
                        return Ok(Some(statement));
                    }
                }
                TokenKind::End => {
                    let closed = self.stack.pop().expect("a file was open");
                    if closed.imported {
                        return Ok(Some(plain("Import", token.span, Plain::ImportEnd)));
                    }
                }
                _ => {
                    return Err(Problem::at(
                        token.span,
                        format!("{} where a directive should be", token.describe()),
                    )
                    .label("expected a directive such as Shape"));
                }
            }
        }
    }

    fn statement(&mut self, word: &str, span: Span, sources: &mut Sources) -> Result<Option<Statement>> {
        self.v3_sign = None;
        if word == "Include" || word == "Import" {
            let name = self.name()?;
            return self.include(name, span, word == "Import", sources);
        }
        let (keyword, directive) = match self.directive(word, span) {
            Ok(Some(found)) => found,
            Ok(None) => return Err(unknown_directive(word, span)),
            Err(problem) => return Err(problem),
        };
        Ok(Some(Statement { keyword, span, directive, v3_sign: self.v3_sign }))
    }

    fn directive(&mut self, word: &str, span: Span) -> Result<Option<(&'static str, Directive)>> {
        if let Some((keyword, plain)) = plain_directive(word) {
            return Ok(Some((keyword, Directive::Plain(plain))));
        }
        if let Some((keyword, naming)) = naming_directive(word) {
            return Ok(Some((keyword, Directive::Named(naming, self.name()?))));
        }
        if let Some((keyword, entity)) = entity_directive(word) {
            let name = self.name()?;
            return Ok(Some((keyword, Directive::Entity(entity, name, self.parameters(span)?))));
        }
        let (keyword, directive) = match word {
            "Translate" => ("Translate", Directive::Transform(TransformOp::Translate(self.numbers()?))),
            "Scale" => ("Scale", Directive::Transform(TransformOp::Scale(self.numbers()?))),
            "Rotate" => ("Rotate", Directive::Transform(TransformOp::Rotate(self.numbers()?))),
            "LookAt" => ("LookAt", Directive::Transform(TransformOp::LookAt(self.numbers()?))),
            "Transform" => {
                ("Transform", Directive::Transform(TransformOp::Transform(Box::new(self.numbers()?))))
            }
            "ConcatTransform" => (
                "ConcatTransform",
                Directive::Transform(TransformOp::ConcatTransform(Box::new(self.numbers()?))),
            ),
            "TransformTimes" => ("TransformTimes", Directive::Transform(TransformOp::Times(self.numbers()?))),
            "ActiveTransform" => ("ActiveTransform", Directive::ActiveTransform(self.bare_word()?)),
            "Texture" => ("Texture", self.texture(span)?),
            "MediumInterface" => ("MediumInterface", self.medium_interface()?),
            "Option" => ("Option", Directive::Option(self.option()?)),
            _ => return Ok(None),
        };
        Ok(Some((keyword, directive)))
    }

    fn texture(&mut self, span: Span) -> Result<Directive> {
        let (name, value_type, class) = (self.name()?, self.name()?, self.name()?);
        Ok(Directive::Texture { name, value_type, class, parameters: self.parameters(span)? })
    }

    /// Both names may share one string's place: pbrt takes the second to be the first where it is missing.
    fn medium_interface(&mut self) -> Result<Directive> {
        let inside = self.name()?;
        let outside = match self.lexer().peek()?.kind {
            TokenKind::Quoted(_) => self.name()?,
            _ => inside.clone(),
        };
        Ok(Directive::MediumInterface(inside, outside))
    }

    /// `Option "string name" "value"`, or v4's `Option "name" value` with the type from the value.
    fn option(&mut self) -> Result<Parameter> {
        let token = self.lexer().next_token()?;
        let TokenKind::Quoted(text) = &token.kind else {
            return Err(expected(&token, "expected the option's quoted name"));
        };
        if text.split_whitespace().count() == 2 {
            return self.parameter(&token, &mut Vec::new());
        }
        let (name, value) = (text.clone(), self.lexer().next_token()?);
        let (ty, values) = match &value.kind {
            TokenKind::Quoted(text) => (ParameterType::String, Values::Strings(vec![text.clone()])),
            TokenKind::Word(word) if word == "true" || word == "false" => {
                (ParameterType::Bool, Values::Bools(vec![word == "true"]))
            }
            TokenKind::Word(word) => {
                let number = number(word.as_bytes(), value.span)?;
                (ParameterType::Float, Values::Numbers(vec![number]))
            }
            _ => return Err(expected(&value, "expected the option's value")),
        };
        Ok(Parameter::new(ty, name, values, token.span, value.span))
    }

    fn name(&mut self) -> Result<Name> {
        let token = self.lexer().next_token()?;
        match token.kind {
            TokenKind::Quoted(text) => Ok(Name { text, span: token.span }),
            // pbrt writes names quoted always; old exporters wrote ["name"].
            _ => Err(expected(&token, "expected a quoted name")),
        }
    }

    fn bare_word(&mut self) -> Result<Name> {
        let token = self.lexer().next_token()?;
        match token.kind {
            TokenKind::Word(text) => Ok(Name { text, span: token.span }),
            _ => Err(expected(&token, "expected StartTime, EndTime or All")),
        }
    }

    /// Exactly `N` numbers, in brackets or bare.
    fn numbers<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut token = self.lexer().next_token()?;
        let bracketed = token.kind == TokenKind::LeftBracket;
        if bracketed {
            token = self.lexer().next_token()?;
        }
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            if i > 0 {
                token = self.lexer().next_token()?;
            }
            let TokenKind::Word(word) = &token.kind else {
                return Err(expected(&token, &format!("expected {N} numbers, this is number {}", i + 1)));
            };
            *value = number(word.as_bytes(), token.span)?;
        }
        if bracketed {
            let close = self.lexer().next_token()?;
            if close.kind != TokenKind::RightBracket {
                return Err(expected(&close, &format!("expected `]` behind {N} numbers")));
            }
        }
        Ok(values)
    }

    fn parameters(&mut self, directive: Span) -> Result<Parameters> {
        let mut parameters = Vec::new();
        let mut mistakes = Vec::new();
        while let TokenKind::Quoted(_) = self.lexer().peek()?.kind {
            let declaration = self.lexer().next_token()?;
            let parameter = self.parameter(&declaration, &mut mistakes)?;
            if parameter.len() > 0 {
                parameters.push(parameter);
            }
        }
        Ok(Parameters::new(parameters, directive, mistakes))
    }

    /// Arrays that are empty or hold too many numbers are complained about in `mistakes`; the numbers are cut off.
    fn parameter(&mut self, declaration: &Token, mistakes: &mut Vec<Problem>) -> Result<Parameter> {
        let TokenKind::Quoted(text) = &declaration.kind else {
            return Err(expected(declaration, "expected a quoted \"type name\""));
        };
        let mut words = text.split_whitespace();
        let (Some(ty), Some(name), None) = (words.next(), words.next(), words.next()) else {
            return Err(expected(declaration, "expected a parameter, \"type name\""));
        };
        let Some((ty, is_v3)) = ParameterType::from_name(ty) else {
            return Err(Problem::at(declaration.span, format!("unknown parameter type \"{}\"", shorten(ty)))
                .label(format!(
                    "expected one of {}{}",
                    ParameterType::NAMES.join(", "),
                    did_you_mean(ty, &ParameterType::NAMES)
                )));
        };
        if is_v3 {
            self.v3_sign.get_or_insert(declaration.span);
        }
        let first = self.lexer().next_token()?;
        let values_span = first.span;
        let mut sink = ValueSink::new(ty, declaration);
        if first.kind == TokenKind::LeftBracket {
            self.bracketed_values(&mut sink)?;
        } else {
            sink.push_token(&first)?;
        }
        if sink.quoted_bool {
            self.v3_sign.get_or_insert(values_span);
        }
        let values = sink.finish(values_span, mistakes);
        Ok(Parameter::new(ty, name.to_string(), values, declaration.span, values_span))
    }

    fn bracketed_values(&mut self, sink: &mut ValueSink) -> Result<()> {
        let lexer = self.lexer();
        loop {
            match lexer.next_value()? {
                Value::Close => return Ok(()),
                Value::Word(bytes, span) => sink.push_word(bytes, span)?,
                Value::Other(token) => sink.push_token(&token)?,
            }
        }
    }

    /// Relative to the file that includes, or else to the main file, as pbrt has it.
    fn resolve(&self, name: &str) -> PathBuf {
        let near = self.directory().join(name);
        let far = self.stack.first().map(|main| main.directory.join(name));
        match far {
            Some(far) if !near.exists() && far.exists() => far,
            _ => near,
        }
    }

    fn include(
        &mut self,
        name: Name,
        span: Span,
        import: bool,
        sources: &mut Sources,
    ) -> Result<Option<Statement>> {
        let what = if import { "Import" } else { "Include" };
        let path = self.resolve(&name.text);
        self.includes += 1;
        if self.stack.len() >= MAX_INCLUDE_DEPTH || self.includes > MAX_INCLUDES {
            return Err(Problem::at(name.span, "too many files included")
                .label(format!("expected at most {MAX_INCLUDE_DEPTH} nested and {MAX_INCLUDES} in all")));
        }
        let identity = path.canonicalize().ok();
        if identity.is_some() && self.stack.iter().any(|file| file.identity == identity) {
            return Err(Problem::at(
                name.span,
                format!("{what} of a file that is being read: {}", path.display()),
            )
            .label("a file cannot include itself"));
        }
        let lexer = sources.open(&path).map_err(|error| {
            Problem::at(name.span, format!("cannot read {}: {error}", path.display()))
                .label("expected a scene file")
        })?;
        let directory = path.parent().unwrap_or(Path::new("")).to_path_buf();
        self.stack.push(OpenFile { lexer, identity, directory, included_at: Some(span), imported: import });
        Ok(import.then(|| plain("Import", span, Plain::ImportBegin)))
    }
}

fn plain(keyword: &'static str, span: Span, plain: Plain) -> Statement {
    Statement { keyword, span, directive: Directive::Plain(plain), v3_sign: None }
}

fn expected(token: &Token, label: &str) -> Box<Problem> {
    Problem::at(token.span, format!("unexpected {}", token.describe())).label(label)
}

fn number(bytes: &[u8], span: Span) -> Result<f64> {
    match parse_number(bytes) {
        Some(value) if value.is_finite() => Ok(value),
        Some(_) => Err(Problem::at(span, "number too large").label("expected a finite number")),
        None => {
            Err(Problem::at(span, format!("`{}` is not a number", shorten(&String::from_utf8_lossy(bytes))))
                .label("expected a number"))
        }
    }
}

fn unknown_directive(word: &str, span: Span) -> Box<Problem> {
    let hint = did_you_mean(word, &KEYWORDS);
    Problem::at(span, format!("unknown directive `{}`", shorten(word)))
        .label(format!("expected a directive such as Shape{hint}"))
}

/// As [`number`], also `nan` and `inf` in the ways in which they are printed: exporters leave them in vertices that no
/// face uses, and in normals of faces without area.
fn number_or_none(bytes: &[u8], span: Span) -> Result<f64> {
    const NONE: [&[u8]; 6] = [b"nan", b"nan(ind)", b"nan(snan)", b"1.#ind", b"1.#qnan", b"1.#snan"];
    let unsigned = bytes.strip_prefix(b"-").or(bytes.strip_prefix(b"+")).unwrap_or(bytes);
    let is = |word: &[u8]| unsigned.eq_ignore_ascii_case(word);
    if NONE.into_iter().any(is) {
        return Ok(f64::NAN);
    }
    if is(b"inf") || is(b"infinity") || is(b"1.#inf") {
        return Ok(f64::INFINITY);
    }
    match parse_number(bytes) {
        Some(value) => Ok(value),
        None => number(bytes, span),
    }
}

/// Whole numbers in `i32`, also when written `3.0`, as v3's exporters did.
fn integer(bytes: &[u8], span: Span) -> Result<i32> {
    if let Some(value) = std::str::from_utf8(bytes).ok().and_then(|text| text.parse::<i32>().ok()) {
        return Ok(value);
    }
    let value = number(bytes, span)?;
    if value.fract() != 0.0 {
        return Err(
            Problem::at(span, format!("`{value}` is not a whole number")).label("expected an integer")
        );
    }
    if value < f64::from(i32::MIN) || value > f64::from(i32::MAX) {
        return Err(Problem::at(span, "integer too large").label("expected an integer of 32 bits"));
    }
    Ok(value as i32)
}

/// Collects the values of a parameter according to its type.
struct ValueSink<'a> {
    ty: ParameterType,
    declaration: &'a Token,
    values: Option<Values>,
    quoted_bool: bool,
    count: u64,
    /// Most values that memory holds; a small compressed file can hold very many.
    most: u64,
}

impl<'a> ValueSink<'a> {
    fn new(ty: ParameterType, declaration: &'a Token) -> ValueSink<'a> {
        let values = match ty {
            ParameterType::Integer => Some(Values::Integers(Vec::new())),
            ParameterType::Bool => Some(Values::Bools(Vec::new())),
            ParameterType::String | ParameterType::Texture => Some(Values::Strings(Vec::new())),
            // A spectrum is a name or numbers: its first value tells.
            ParameterType::Spectrum => None,
            _ => Some(Values::Numbers(Vec::new())),
        };
        ValueSink {
            ty,
            declaration,
            values,
            quoted_bool: false,
            count: 0,
            most: memory::limit() / size_of::<f64>() as u64,
        }
    }

    fn push_word(&mut self, bytes: &[u8], span: Span) -> Result<()> {
        self.count += 1;
        if self.count > self.most {
            let limit = memory::in_gib(memory::limit());
            return Err(Problem::at(span, "too many values")
                .label(format!("the values up to here need more than {limit}")));
        }
        match self.values.get_or_insert_with(|| Values::Numbers(Vec::new())) {
            Values::Numbers(numbers) => numbers.push(match self.ty.is_of_a_mesh() {
                true => number_or_none(bytes, span)?,
                false => number(bytes, span)?,
            }),
            Values::Integers(integers) => integers.push(integer(bytes, span)?),
            Values::Bools(bools) => match bytes {
                b"true" => bools.push(true),
                b"false" => bools.push(false),
                _ => return Err(self.wrong(&String::from_utf8_lossy(bytes), span)),
            },
            Values::Strings(_) => return Err(self.wrong(&String::from_utf8_lossy(bytes), span)),
        }
        Ok(())
    }

    fn push_token(&mut self, token: &Token) -> Result<()> {
        let text = match &token.kind {
            TokenKind::Word(word) => return self.push_word(word.as_bytes(), token.span),
            TokenKind::Quoted(text) => text,
            TokenKind::RightBracket | TokenKind::LeftBracket => {
                return Err(expected(token, &format!("expected a value of {}", self.ty.name())));
            }
            TokenKind::End => {
                return Err(Problem::at(token.span, "the file ends inside a parameter")
                    .label("expected a value or `]`")
                    .note(Place::Span(self.declaration.span), "the parameter begins here"));
            }
        };
        match self.values.get_or_insert_with(|| Values::Strings(Vec::new())) {
            Values::Strings(strings) => strings.push(text.clone()),
            Values::Bools(bools) if text == "true" || text == "false" => {
                bools.push(text == "true");
                self.quoted_bool = true;
            }
            _ => return Err(self.wrong(text, token.span)),
        }
        Ok(())
    }

    fn wrong(&self, found: &str, span: Span) -> Box<Problem> {
        let label = match self.ty {
            ParameterType::Bool => "expected true or false",
            ParameterType::String | ParameterType::Texture => "expected a quoted string",
            ParameterType::Integer => "expected an integer",
            _ => "expected a number",
        };
        Problem::at(span, format!("`{}` is not a value of type {}", shorten(found), self.ty.name()))
            .label(label)
    }

    fn finish(self, span: Span, mistakes: &mut Vec<Problem>) -> Values {
        let mut values = self.values.unwrap_or(Values::Numbers(Vec::new()));
        let (count, arity) = match &values {
            Values::Numbers(numbers) => (numbers.len(), self.ty.arity()),
            Values::Integers(integers) => (integers.len(), 1),
            Values::Strings(strings) => (strings.len(), 1),
            Values::Bools(bools) => (bools.len(), 1),
        };
        if count == 0 {
            let problem = Problem::at(span, "parameter without values").label("expected at least one value");
            mistakes.push(*problem);
        }
        if !count.is_multiple_of(arity) {
            let place = Place::Value(span, count - count % arity);
            let problem =
                Problem::new(place, format!("{count} numbers for a parameter of type {}", self.ty.name()))
                    .label(format!("expected a multiple of {arity}; the numbers from here on are left over"));
            mistakes.push(*problem);
            if let Values::Numbers(numbers) = &mut values {
                numbers.truncate(count - count % arity);
            }
        }
        values
    }
}

fn plain_directive(word: &str) -> Option<(&'static str, Plain)> {
    Some(match word {
        "AttributeBegin" => ("AttributeBegin", Plain::AttributeBegin),
        "AttributeEnd" => ("AttributeEnd", Plain::AttributeEnd),
        "TransformBegin" => ("TransformBegin", Plain::TransformBegin),
        "TransformEnd" => ("TransformEnd", Plain::TransformEnd),
        "ObjectEnd" => ("ObjectEnd", Plain::ObjectEnd),
        "ReverseOrientation" => ("ReverseOrientation", Plain::ReverseOrientation),
        "WorldBegin" => ("WorldBegin", Plain::WorldBegin),
        "WorldEnd" => ("WorldEnd", Plain::WorldEnd),
        "Identity" => ("Identity", Plain::Identity),
        _ => return None,
    })
}

fn naming_directive(word: &str) -> Option<(&'static str, Naming)> {
    Some(match word {
        "CoordinateSystem" => ("CoordinateSystem", Naming::CoordinateSystem),
        "CoordSysTransform" => ("CoordSysTransform", Naming::CoordSysTransform),
        "NamedMaterial" => ("NamedMaterial", Naming::NamedMaterial),
        "ObjectBegin" => ("ObjectBegin", Naming::ObjectBegin),
        "ObjectInstance" => ("ObjectInstance", Naming::ObjectInstance),
        "ColorSpace" => ("ColorSpace", Naming::ColorSpace),
        _ => return None,
    })
}

fn entity_directive(word: &str) -> Option<(&'static str, Entity)> {
    Some(match word {
        "Accelerator" => ("Accelerator", Entity::Accelerator),
        "AreaLightSource" => ("AreaLightSource", Entity::AreaLightSource),
        "Attribute" => ("Attribute", Entity::Attribute),
        "Camera" => ("Camera", Entity::Camera),
        "Film" => ("Film", Entity::Film),
        "Integrator" => ("Integrator", Entity::Integrator),
        "LightSource" => ("LightSource", Entity::LightSource),
        "MakeNamedMaterial" => ("MakeNamedMaterial", Entity::MakeNamedMaterial),
        "MakeNamedMedium" => ("MakeNamedMedium", Entity::MakeNamedMedium),
        "Material" => ("Material", Entity::Material),
        "PixelFilter" => ("PixelFilter", Entity::PixelFilter),
        "Sampler" => ("Sampler", Entity::Sampler),
        "Shape" => ("Shape", Entity::Shape),
        _ => return None,
    })
}
