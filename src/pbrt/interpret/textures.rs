//! Textures: from `Texture` directives to a graph of which materials name the nodes. What is the same everywhere is
//! computed here and becomes no node.
//!
//! Pictures are read when the scene is complete, and only those that something needs: files define textures that nothing
//! uses.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use wavepath_kernels::texture::{
    Affine, Checks, Encoding, Function, Image, ImageParts, MAX_OCTAVES, Mapping, Sampled, Solid, Texels,
    Texture as Node, Wrap,
};

use crate::pbrt::error::{Place, Problem, Result, Span};
use crate::pbrt::lexer::shorten;
use crate::pbrt::parameters::{ParameterType, Parameters};
use crate::pbrt::parser::Name;
use crate::pbrt::spectra::Rgb64;
use crate::pbrt::transform::invertible;
use crate::picture::{Raster, RasterSamples, Transfer};
use crate::scene::{MaterialId, Parameter, Relief, TextureId};

use super::{Builder, singular, unknown_kind};

/// Classes that pbrt has and wavepath lacks.
const OTHER_CLASSES: [&str; 3] = ["ptex", "checkerboard3d", "bumpmap"];

/// Classes that wavepath has.
const CLASSES: [&str; 14] = [
    "constant",
    "scale",
    "mix",
    "directionmix",
    "checkerboard",
    "imagemap",
    "bilerp",
    "dots",
    "uv",
    "fbm",
    "wrinkled",
    "windy",
    "marble",
    "ptex",
];

/// What a texture lacks: what is not supported, and where it is defined.
#[derive(Clone, Debug)]
pub(super) struct Lack {
    pub(super) message: String,
    pub(super) place: Place,
}

/// A texture: its value or its node, or what is rendered instead.
#[derive(Clone, Debug)]
pub(super) struct Texture<T> {
    pub(super) value: Parameter<T>,
    /// Matters where the texture is used: scenes define textures that nothing uses.
    pub(super) lacks: Rc<[Lack]>,
}

/// A picture that is to be read if something needs it.
#[derive(Clone, Debug)]
struct Request {
    name: String,
    path: PathBuf,
    /// Of the file's name in the scene.
    place: Place,
    transfer: Transfer,
    /// pbrt-v3's number textures: one number a pixel, the luminance of the colour as it is stored.
    luminance: bool,
}

/// The textures by name; numbers and colours have separate names, as in pbrt.
#[derive(Default)]
pub(super) struct Textures {
    pub(super) float: HashMap<String, Texture<f64>>,
    pub(super) spectrum: HashMap<String, Texture<Rgb64>>,
    requests: Vec<Request>,
    /// Nodes that the present directive names.
    named: Vec<TextureId>,
    /// Nodes that materials name.
    of_material: HashMap<MaterialId, Vec<TextureId>>,
    /// Nodes that the scene needs.
    needed: Vec<TextureId>,
}

impl Textures {
    /// The present directive names a node.
    pub(super) fn name<T: Copy>(&mut self, parameter: Parameter<T>) -> Parameter<T> {
        if let Parameter::Texture(id) = parameter {
            self.named.push(id);
        }
        parameter
    }

    /// The nodes that were named since the last call belong to a material.
    pub(super) fn belong_to(&mut self, material: MaterialId) {
        let named = std::mem::take(&mut self.named);
        if !named.is_empty() {
            self.of_material.entry(material).or_default().extend(named);
        }
    }

    /// The nodes that a material names.
    pub(super) fn of_material(&self, material: MaterialId) -> Vec<TextureId> {
        self.of_material.get(&material).cloned().unwrap_or_default()
    }

    /// Names nodes again, for a material that is made of others.
    pub(super) fn name_all(&mut self, ids: Vec<TextureId>) {
        self.named.extend(ids);
    }

    /// The scene needs nodes.
    pub(super) fn need(&mut self, ids: impl Iterator<Item = TextureId>) {
        self.named.clear();
        self.needed.extend(ids);
    }

    /// The scene uses a material.
    pub(super) fn need_material(&mut self, material: MaterialId) {
        self.needed.extend(self.of_material(material));
    }
}

/// What textures that are not supported are rendered as.
const STAND_IN: f64 = 0.5;

/// Whether a texture is one of numbers or of colours.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Float,
    Spectrum,
}

impl Builder {
    /// `Texture "name" "float|spectrum" "class" ...`
    pub(super) fn texture(
        &mut self,
        name: Name,
        value_type: &Name,
        class: Name,
        mut parameters: Parameters,
    ) -> Result<()> {
        self.check_arrays(&mut parameters)?;
        let parameters = parameters.with_defaults(&self.state.defaults.texture);
        let kind = match value_type.text.as_str() {
            "float" => Kind::Float,
            "spectrum" => Kind::Spectrum,
            "color" => {
                self.dialect.saw_v3(value_type.span)?;
                Kind::Spectrum
            }
            _ => {
                return Err(unknown_kind("type of texture", value_type, &["float", "spectrum"]));
            }
        };
        self.check_redefinition(&name, kind)?;
        let mut lacks = Vec::new();
        let value = if OTHER_CLASSES.contains(&class.text.as_str()) {
            let message = format!("textures of class \"{}\" are not supported", class.text);
            lacks.push(Lack { message, place: Place::Span(name.span) });
            Parameter::Constant([STAND_IN; 3])
        } else {
            let value = self.texture_class(kind, &class, &parameters)?;
            self.check_unused(&parameters, &format!("texture \"{}\"", shorten(&class.text)))?;
            value
        };
        self.textures.named.clear();
        lacks.extend(self.take_texture_lacks(name.span));
        let lacks = lacks.into();
        match kind {
            Kind::Float => {
                let value = match value {
                    Parameter::Constant([value, ..]) => Parameter::Constant(value),
                    Parameter::Texture(id) => Parameter::Texture(id),
                };
                self.textures.float.insert(name.text, Texture { value, lacks });
            }
            Kind::Spectrum => {
                self.textures.spectrum.insert(name.text, Texture { value, lacks });
            }
        }
        Ok(())
    }

    /// What the textures lack of which the present one is made.
    fn take_texture_lacks(&mut self, defined: Span) -> Vec<Lack> {
        let lack = |problem: Problem| {
            let root = problem.notes.into_iter().next().map(|(place, _)| place);
            Lack { message: problem.message, place: root.unwrap_or(Place::Span(defined)) }
        };
        std::mem::take(&mut self.pending).into_iter().map(lack).collect()
    }

    /// An error in v4; in v3 the new texture takes the name.
    fn check_redefinition(&mut self, name: &Name, kind: Kind) -> Result<()> {
        let known = match kind {
            Kind::Float => self.textures.float.contains_key(&name.text),
            Kind::Spectrum => self.textures.spectrum.contains_key(&name.text),
        };
        if !known {
            return Ok(());
        }
        let text = format!("texture \"{}\" is defined twice", shorten(&name.text));
        let problem = Problem::at(name.span, text);
        if !self.dialect.is_v3() {
            return Err(problem.label("expected a new name"));
        }
        self.warn(problem.label("the last one counts"));
        Ok(())
    }

    /// What turns the normals of a material: a height (v3: `bumpmap`), or a map of normals.
    pub(super) fn relief(&mut self, parameters: &Parameters) -> Result<Option<Relief>> {
        let normals = parameters.string("normalmap")?.filter(|name| !name.is_empty()).map(str::to_string);
        for name in ["displacement", "bumpmap"] {
            if !parameters.has(name) {
                continue;
            }
            // A height that is the same everywhere does nothing.
            if let Some(Parameter::Texture(height)) = self.float_parameter(parameters, name)? {
                return Ok(Some(Relief::Displacement(height)));
            }
        }
        let Some(name) = normals else { return Ok(None) };
        let place = parameters.find("normalmap").map_or(Place::Nowhere, |p| p.place(0));
        let mapping = Mapping::Uv { scale: [1.0; 2], delta: [0.0; 2] };
        let image = self.request(name, place, Transfer::Linear, false);
        let (wrap, nearest, one_number) = (Wrap::Repeat, false, false);
        let (scale, invert) = (1.0, false);
        let sampled = Sampled { mapping, image, wrap, nearest, one_number, scale, invert };
        let id = self.node(Node::Image(sampled));
        self.textures.name(Parameter::<f64>::Texture(id));
        Ok(Some(Relief::NormalMap(id)))
    }

    /// Asks for a picture; it is known by the number until it is read.
    fn request(&mut self, name: String, place: Place, transfer: Transfer, luminance: bool) -> u32 {
        let path = self.resolve(&name);
        self.textures.requests.push(Request { name, path, place, transfer, luminance });
        self.textures.requests.len() as u32 - 1
    }

    /// Adds a node.
    pub(super) fn node(&mut self, node: Node) -> TextureId {
        self.scene.textures.push(node);
        TextureId(self.scene.textures.len() as u32 - 1)
    }

    /// A node for a value.
    pub(super) fn node_of(&mut self, value: Parameter<Rgb64>) -> TextureId {
        match value {
            Parameter::Constant(value) => self.node(Node::Constant(value.map(|c| c as f32))),
            Parameter::Texture(id) => id,
        }
    }

    /// A function of a value, channel by channel: `constant` of a constant, the node's of a texture.
    pub(super) fn apply<T>(
        &mut self,
        function: Function,
        value: Parameter<T>,
        constant: impl FnOnce(T) -> T,
    ) -> Parameter<T> {
        match value {
            Parameter::Constant(value) => Parameter::Constant(constant(value)),
            Parameter::Texture(id) => Parameter::Texture(self.node(Node::Apply(function, id))),
        }
    }

    /// The product of two values.
    pub(super) fn product(&mut self, a: Parameter<Rgb64>, b: Parameter<Rgb64>) -> Parameter<Rgb64> {
        match (a, b) {
            (Parameter::Constant(a), Parameter::Constant(b)) => {
                Parameter::Constant(std::array::from_fn(|i| a[i] * b[i]))
            }
            (Parameter::Constant([1.0, 1.0, 1.0]), other) | (other, Parameter::Constant([1.0, 1.0, 1.0])) => {
                other
            }
            _ => {
                let (a, b) = (self.node_of(a), self.node_of(b));
                Parameter::Texture(self.node(Node::Product(a, b)))
            }
        }
    }

    /// A number or colour of which a texture is made.
    fn input(
        &mut self,
        kind: Kind,
        parameters: &Parameters,
        name: &'static str,
        default: f64,
    ) -> Result<Parameter<Rgb64>> {
        let value = match kind {
            Kind::Float => self.float_parameter(parameters, name)?.map(widen),
            Kind::Spectrum => self.spectrum_parameter(parameters, name)?,
        };
        let value = value.unwrap_or(Parameter::Constant([default; 3]));
        if let Parameter::Constant(value) = value
            && value.iter().any(|c| !(*c as f32).is_finite())
        {
            let expected = "expected numbers below 3e38";
            return Err(parameters.bad(name, "too large for single precision", expected));
        }
        Ok(value)
    }

    fn texture_class(
        &mut self,
        kind: Kind,
        class: &Name,
        parameters: &Parameters,
    ) -> Result<Parameter<Rgb64>> {
        let node = match class.text.as_str() {
            "constant" => return self.input(kind, parameters, "value", 1.0),
            "scale" => {
                // v4 scales `tex` by a number `scale`, v3 `tex1` by `tex2`.
                let v3 = parameters.find("tex1").is_some() || parameters.find("tex2").is_some();
                let (a, b) = if v3 { ("tex1", "tex2") } else { ("tex", "scale") };
                let a = self.input(kind, parameters, a, 1.0)?;
                let b = self.input(if v3 { kind } else { Kind::Float }, parameters, b, 1.0)?;
                return Ok(self.product(a, b));
            }
            "mix" => {
                let a = self.input(kind, parameters, "tex1", 0.0)?;
                let b = self.input(kind, parameters, "tex2", 1.0)?;
                let amount = self.input(Kind::Float, parameters, "amount", 0.5)?;
                if let (Parameter::Constant(a), Parameter::Constant(b), Parameter::Constant([amount, ..])) =
                    (a, b, amount)
                {
                    let mixed = std::array::from_fn(|i| (1.0 - amount) * a[i] + amount * b[i]);
                    return Ok(Parameter::Constant(mixed));
                }
                let (first, second, amount) = (self.node_of(a), self.node_of(b), self.node_of(amount));
                Node::Mix { first, second, amount }
            }
            "directionmix" => {
                let a = self.input(kind, parameters, "tex1", 0.0)?;
                let b = self.input(kind, parameters, "tex2", 1.0)?;
                let direction = vector(parameters, "dir", DVec3::Y)?;
                let world = self.static_ctm(class.span)?.transform_vector3(direction).try_normalize();
                let Some(world) = world else {
                    return Err(parameters.bad(
                        "dir",
                        "without a direction",
                        "expected a vector that is not 0",
                    ));
                };
                let (first, second) = (self.node_of(a), self.node_of(b));
                Node::DirectionMix { first, second, direction: world.as_vec3().into() }
            }
            "checkerboard" => {
                let first = self.input(kind, parameters, "tex1", 1.0)?;
                let second = self.input(kind, parameters, "tex2", 0.0)?;
                let checks = match parameters.integer("dimension")?.unwrap_or(2) {
                    2 => Checks::Plane(self.mapping(parameters, class.span)?),
                    3 => Checks::Solid(self.solid_space(class.span)?),
                    other => {
                        return Err(parameters.bad("dimension", &other.to_string(), "expected 2 or 3"));
                    }
                };
                // How v3 smooths the edges: all ways agree where there are many samples.
                parameters.accept(&["aamode"]);
                let (first, second) = (self.node_of(first), self.node_of(second));
                Node::Checkerboard { checks, first, second }
            }
            "dots" => {
                let inside = self.input(kind, parameters, "inside", 1.0)?;
                let outside = self.input(kind, parameters, "outside", 0.0)?;
                let mapping = self.mapping(parameters, class.span)?;
                // pbrt takes one for the other, in both versions, and so its scenes mean it.
                let (outside, inside) = (self.node_of(inside), self.node_of(outside));
                Node::Dots { mapping, inside, outside }
            }
            "bilerp" => {
                let mut corners = [[0.0; 3]; 4];
                let names = [("v00", 0.0), ("v01", 1.0), ("v10", 0.0), ("v11", 1.0)];
                for (corner, (name, default)) in corners.iter_mut().zip(names) {
                    let Parameter::Constant(value) = self.input(kind, parameters, name, default)? else {
                        return Err(parameters.bad(name, "a texture", "expected a constant"));
                    };
                    *corner = value.map(|c| c as f32);
                }
                Node::Bilerp { mapping: self.mapping(parameters, class.span)?, corners }
            }
            "uv" => Node::Uv { mapping: self.mapping(parameters, class.span)? },
            "imagemap" => self.image_map(kind, class, parameters)?,
            "fbm" | "wrinkled" | "windy" | "marble" => {
                let octaves = parameters.integer("octaves")?.unwrap_or(8).clamp(0, MAX_OCTAVES as i32) as u32;
                let roughness = parameters.float_or("roughness", 0.5)? as f32;
                let solid = match class.text.as_str() {
                    "fbm" => Solid::Fbm { octaves, roughness },
                    "wrinkled" => Solid::Wrinkled { octaves, roughness },
                    "windy" => Solid::Windy,
                    _ => Solid::Marble {
                        octaves,
                        roughness,
                        scale: parameters.float_or("scale", 1.0)? as f32,
                        variation: parameters.float_or("variation", 0.2)? as f32,
                        // v3 lets the first cubic go on instead of taking the later ones.
                        segments: if self.dialect.is_v3() { 2 } else { 6 },
                    },
                };
                Node::Solid { solid, texture_from_world: self.solid_space(class.span)? }
            }
            _ => return Err(unknown_class(class)),
        };
        Ok(Parameter::Texture(self.node(node)))
    }

    /// The space of a texture, from the world's.
    fn texture_from_world(&mut self, span: Span) -> Result<DAffine3> {
        let world_from_texture = self.static_ctm(span)?;
        match invertible(world_from_texture) {
            Some(transform) => Ok(transform.inverse()),
            None => Err(singular(span, "a texture")),
        }
    }

    /// The space of a solid texture: pbrt-v3 applies the transform itself, not its inverse.
    fn solid_space(&mut self, span: Span) -> Result<Affine> {
        if self.dialect.is_v3() {
            return Ok(affine(&self.static_ctm(span)?));
        }
        Ok(affine(&self.texture_from_world(span)?))
    }

    fn mapping(&mut self, parameters: &Parameters, span: Span) -> Result<Mapping> {
        let name = parameters.string("mapping")?.unwrap_or("uv").to_string();
        let number = |name, default| -> Result<f64> {
            let x = parameters.float_or(name, default)?;
            match (x as f32).is_finite() {
                true => Ok(x),
                false => Err(parameters.bad(name, &x.to_string(), "expected a number below 3e38")),
            }
        };
        Ok(match name.as_str() {
            "uv" => Mapping::Uv {
                scale: [number("uscale", 1.0)? as f32, number("vscale", 1.0)? as f32],
                delta: [number("udelta", 0.0)? as f32, number("vdelta", 0.0)? as f32],
            },
            "spherical" => Mapping::Spherical { texture_from_world: affine(&self.texture_from_world(span)?) },
            "cylindrical" => Mapping::Cylindrical {
                texture_from_world: affine(&self.texture_from_world(span)?),
                of_direction: self.dialect.is_v3(),
            },
            "planar" => {
                let [du, dv] = [number("udelta", 0.0)?, number("vdelta", 0.0)?];
                // v3 takes the vectors to be of the world.
                let space =
                    if self.dialect.is_v3() { DAffine3::IDENTITY } else { self.texture_from_world(span)? };
                let row = |v: DVec3, delta: f64| {
                    let factors = space.matrix3.transpose() * v;
                    [factors.x, factors.y, factors.z, space.translation.dot(v) + delta].map(|x| x as f32)
                };
                Mapping::Planar {
                    s: row(vector(parameters, "v1", DVec3::X)?, du),
                    t: row(vector(parameters, "v2", DVec3::Y)?, dv),
                }
            }
            other => {
                let known = ["uv", "planar", "spherical", "cylindrical"];
                return Err(parameters.bad(
                    "mapping",
                    &format!("\"{}\"", shorten(other)),
                    format!("expected one of {}", known.join(", ")),
                ));
            }
        })
    }

    fn image_map(&mut self, kind: Kind, class: &Name, parameters: &Parameters) -> Result<Node> {
        let mapping = self.mapping(parameters, class.span)?;
        let Some(name) = parameters.string("filename")?.map(str::to_string) else {
            return Err(
                Problem::at(class.span, "imagemap without a file").label("expected \"string filename\"")
            );
        };
        let one_of = |parameter: &'static str, found: &str, known: &[&str]| {
            let expected = format!("expected one of {}", known.join(", "));
            parameters.bad(parameter, &format!("\"{}\"", shorten(found)), expected)
        };
        let wrap = match parameters.string("wrap")?.unwrap_or("repeat") {
            "repeat" => Wrap::Repeat,
            "black" => Wrap::Black,
            "clamp" => Wrap::Clamp,
            "octahedralsphere" => Wrap::OctahedralSphere,
            other => {
                return Err(one_of("wrap", other, &["repeat", "black", "clamp", "octahedralsphere"]));
            }
        };
        let nearest = match parameters.string("filter")?.unwrap_or("bilinear") {
            "point" => true,
            // Each sample looks up four pixels; many samples are the filter.
            "bilinear" | "trilinear" | "ewa" | "EWA" => false,
            other => return Err(one_of("filter", other, &["point", "bilinear", "trilinear", "ewa"])),
        };
        parameters.accept(&["maxanisotropy", "trilinear"]);
        let scale = parameters.float_or("scale", 1.0)?;
        if !(scale as f32).is_finite() {
            return Err(parameters.bad("scale", &scale.to_string(), "expected a number below 3e38"));
        }
        let invert = parameters.bool_or("invert", false)?;
        let ending = |ending: &str| name.to_ascii_lowercase().ends_with(ending);
        let mut transfer = Transfer::Srgb;
        if let Some(encoding) = parameters.string("encoding")? {
            let Some(found) = Transfer::parse(encoding) else {
                return Err(one_of("encoding", encoding, &["sRGB", "linear", "gamma and a number"]));
            };
            // pbrt-v4 asks it of PNG alone.
            if ending(".png") {
                transfer = found;
            }
        }
        if parameters.find("gamma").is_some() && !parameters.bool_or("gamma", true)? {
            transfer = Transfer::Linear;
        }
        let place = parameters.find("filename").map_or(Place::Span(class.span), |p| p.place(0));
        let luminance = kind == Kind::Float && self.dialect.is_v3();
        let image = self.request(name, place, transfer, luminance);
        Ok(Node::Image(Sampled {
            mapping,
            image,
            wrap,
            nearest,
            one_number: kind == Kind::Float,
            scale: scale as f32,
            invert,
        }))
    }

    /// Reads the pictures that the scene needs, each once.
    pub(super) fn finish_textures(&mut self) -> Result<()> {
        let mut needed = HashSet::new();
        let mut waiting: Vec<TextureId> = self.textures.needed.clone();
        while let Some(id) = waiting.pop() {
            if needed.insert(id) {
                waiting.extend(self.scene.textures[id.0 as usize].inputs());
            }
        }
        if needed.is_empty() {
            self.scene.textures.clear();
            return Ok(());
        }
        let mut read: HashMap<(PathBuf, String, bool), u32> = HashMap::new();
        for id in 0..self.scene.textures.len() {
            let Node::Image(sampled) = self.scene.textures[id] else { continue };
            if !needed.contains(&TextureId(id as u32)) {
                self.scene.textures[id] = Node::Constant([STAND_IN as f32; 3]);
                continue;
            }
            let request = self.textures.requests[sampled.image as usize].clone();
            let key = (request.path.clone(), format!("{:?}", request.transfer), request.luminance);
            let image = match read.get(&key) {
                Some(image) => *image,
                None => match self.read_image(&request) {
                    Ok(image) => {
                        self.scene.images.push(Arc::new(image));
                        let number = self.scene.images.len() as u32 - 1;
                        read.insert(key, number);
                        number
                    }
                    Err(problem) if problem.lacking.is_some() => {
                        self.lack(*problem);
                        self.scene.textures[id] = Node::Constant([STAND_IN as f32; 3]);
                        continue;
                    }
                    Err(problem) => return Err(problem),
                },
            };
            self.scene.textures[id] = Node::Image(Sampled { image, ..sampled });
        }
        Ok(())
    }

    fn read_image(&mut self, request: &Request) -> Result<Image> {
        let Request { name, path, place, transfer, luminance } = request;
        if !path.is_file() {
            let mut problem =
                Problem::new(place.clone(), format!("there is no picture \"{}\"", shorten(name)))
                    .label("expected an image file: png, tga, jpg, exr, hdr or pfm")
                    .lacking("it is taken for the constant 0.5")
                    .note(Place::Nowhere, format!("looked for {}", path.display()));
            let far = self.main_directory.join(name);
            if far != *path {
                problem = problem.note(Place::Nowhere, format!("and for {}", far.display()));
            }
            return Err(problem);
        }
        self.inputs.push(path.clone());
        let bad = |text: String| Problem::new(place.clone(), text).label("the picture is named here");
        let raster = Raster::read(path).map_err(|error| bad(error.to_string()))?;
        image_of(&raster, *transfer, *luminance).map_err(|error| bad(format!("{}: {error}", path.display())))
    }
}

/// A picture as textures look it up.
fn image_of(
    raster: &Raster,
    transfer: Transfer,
    luminance: bool,
) -> std::result::Result<Image, wavepath_kernels::scene::BuildError> {
    let encoding = match transfer {
        Transfer::Srgb => Encoding::Srgb,
        Transfer::Linear => Encoding::Linear,
        Transfer::Gamma(power) => Encoding::Gamma(power as f32),
    };
    let (width, height, channels) = (raster.width(), raster.height(), raster.channels() as usize);
    if luminance && channels > 1 {
        // pbrt-v3 takes the luminance of what is stored, and decodes that.
        let stored = raster.colours(Transfer::Linear);
        let integers = raster.samples().are_integers();
        let luminance = |[r, g, b]: [f32; 3]| {
            let y = 0.212_671 * r as f64 + 0.715_160 * g as f64 + 0.072_169 * b as f64;
            (if integers { transfer.linear(y) } else { y }) as f32
        };
        let texels = Texels::F32(stored.into_iter().map(luminance).collect());
        return Image::new(ImageParts { width, height, channels: 1, texels });
    }
    // An opacity of 1 everywhere is none, as in pbrt.
    fn kept<T: Copy>(samples: &[T], channels: usize, is_opaque: impl Fn(T) -> bool) -> (Vec<T>, u32) {
        match channels == 4 && samples.iter().skip(3).step_by(4).all(|&x| is_opaque(x)) {
            true => (samples.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(), 3),
            false => (samples.to_vec(), channels as u32),
        }
    }
    let (texels, channels) = match raster.samples() {
        RasterSamples::Bytes(samples) => {
            let (samples, channels) = kept(samples, channels, |x| x == u8::MAX);
            (Texels::U8(samples, encoding), channels)
        }
        RasterSamples::Words(samples) => {
            let (samples, channels) = kept(samples, channels, |x| x == u16::MAX);
            (Texels::U16(samples, encoding), channels)
        }
        RasterSamples::Halves(samples) => {
            let bits: Vec<u16> = samples.iter().map(|x| x.to_bits()).collect();
            let (samples, channels) = kept(&bits, channels, |x| x == 0x3c00);
            (Texels::F16(samples), channels)
        }
        RasterSamples::Floats(samples) => {
            let (samples, channels) = kept(samples, channels, |x| x == 1.0);
            (Texels::F32(samples), channels)
        }
    };
    Image::new(ImageParts { width, height, channels, texels })
}

/// A number as a colour.
pub(super) fn widen(value: Parameter<f64>) -> Parameter<Rgb64> {
    match value {
        Parameter::Constant(value) => Parameter::Constant([value; 3]),
        Parameter::Texture(id) => Parameter::Texture(id),
    }
}

fn affine(transform: &DAffine3) -> Affine {
    let rows = transform.matrix3.transpose();
    let row = |r: DVec3, t: f64| [r.x, r.y, r.z, t].map(|x| x as f32);
    let t = transform.translation;
    [row(rows.x_axis, t.x), row(rows.y_axis, t.y), row(rows.z_axis, t.z)]
}

fn vector(parameters: &Parameters, name: &'static str, default: DVec3) -> Result<DVec3> {
    let Some(parameter) = parameters.typed(name, &[ParameterType::Vector3])? else {
        return Ok(default);
    };
    parameter.single()?;
    let n = parameter.numbers();
    Ok(DVec3::new(n[0], n[1], n[2]))
}

fn unknown_class(class: &Name) -> Box<Problem> {
    unknown_kind("class of texture", class, &CLASSES)
}
