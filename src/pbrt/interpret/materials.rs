//! Materials.

use std::collections::HashMap;
use std::rc::Rc;

use crate::pbrt::error::{Place, Problem, Result, Span};
use crate::pbrt::lexer::shorten;
use crate::pbrt::parameters::{ParameterType, Parameters};
use crate::pbrt::parser::Name;
use crate::pbrt::spectra::{self, Named, Rgb64};
use crate::pbrt::suggest::did_you_mean;
use crate::scene::{Material, MaterialId, Parameter, Relief, Shape};

use super::values::{SpectrumValue, rgb32};
use super::{Builder, Dropped, unknown_kind, unsupported_kind};

/// pbrt's `EffectivelySmooth`: below it a surface is smooth.
const SMOOTH: f64 = 1e-3;

const SUPPORTED: [&str; 12] = [
    "diffuse",
    "diffusetransmission",
    "conductor",
    "dielectric",
    "thindielectric",
    "matte",
    "mirror",
    "metal",
    "glass",
    "plastic",
    "substrate",
    "uber",
];

const UNSUPPORTED: [&str; 9] = [
    "coateddiffuse",
    "coatedconductor",
    "subsurface",
    "hair",
    "measured",
    "translucent",
    "disney",
    "fourier",
    "kdsubsurface",
];

/// Materials by handle and by name. A name may be used before it is defined, as in pbrt-v4.
#[derive(Default)]
pub(super) struct MaterialTable {
    slots: Vec<Slot>,
    names: HashMap<String, MaterialId>,
    /// Handles by content: exporters repeat materials for every shape.
    known: HashMap<String, MaterialId>,
    /// What turns the normals of some.
    reliefs: HashMap<MaterialId, Relief>,
}

/// What a material directive says.
#[derive(Clone, Debug)]
enum Read {
    Material(Material),
    /// The surface is not there: it only separates media.
    Interface,
    /// What can be rendered instead, and what is lacking.
    Lacking(Material, Rc<[Problem]>),
}

enum Slot {
    Known(Read),
    /// Used, but not defined so far.
    Pending {
        name: String,
        span: Span,
    },
}

impl MaterialTable {
    fn add(&mut self, slot: Slot) -> MaterialId {
        self.slots.push(slot);
        MaterialId(self.slots.len() as u32 - 1)
    }

    /// The handle of a material.
    pub(super) fn intern(&mut self, material: Material) -> MaterialId {
        self.intern_read(Read::Material(material), None)
    }

    fn intern_read(&mut self, read: Read, relief: Option<Relief>) -> MaterialId {
        // The printed form of a float tells every value apart.
        let mut key = match &read {
            Read::Material(material) => format!("{material:?}"),
            Read::Interface => "interface".into(),
            Read::Lacking(material, lacks) => {
                let lacks: Vec<&str> = lacks.iter().map(|lack| lack.message.as_str()).collect();
                format!("{material:?} {lacks:?}")
            }
        };
        if let Some(relief) = relief {
            key.push_str(&format!("{relief:?}"));
        }
        if let Some(id) = self.known.get(&key) {
            return *id;
        }
        let id = self.add(Slot::Known(read));
        self.known.insert(key, id);
        self.reliefs.extend(relief.map(|relief| (id, relief)));
        id
    }

    /// The handle that a name stands for.
    fn named(&mut self, name: &Name) -> MaterialId {
        if let Some(id) = self.names.get(&name.text) {
            return *id;
        }
        let id = self.add(Slot::Pending { name: name.text.clone(), span: name.span });
        self.names.insert(name.text.clone(), id);
        id
    }

    fn by_name(&self, name: &str) -> Option<Read> {
        match &self.slots[self.names.get(name)?.0 as usize] {
            Slot::Known(read) => Some(read.clone()),
            Slot::Pending { .. } => None,
        }
    }

    /// Whether the name was defined (being used is not enough).
    fn is_defined(&self, name: &str) -> bool {
        self.by_name(name).is_some()
    }

    fn define(&mut self, name: String, read: Read, relief: Option<Relief>) {
        match self.names.get(&name) {
            Some(id) if matches!(self.slots[id.0 as usize], Slot::Pending { .. }) => {
                self.slots[id.0 as usize] = Slot::Known(read);
                self.reliefs.extend(relief.map(|relief| (*id, relief)));
            }
            // v3 redefines names; shapes before keep the former material.
            _ => {
                let id = self.intern_read(read, relief);
                self.names.insert(name, id);
            }
        }
    }

    fn known(&self, index: usize) -> Result<Read> {
        match &self.slots[index] {
            Slot::Known(read) => Ok(read.clone()),
            Slot::Pending { name, span } => Err(self.unknown(name, *span)),
        }
    }

    fn unknown(&self, name: &str, span: Span) -> Box<Problem> {
        let known: Vec<&str> =
            self.names.keys().filter(|name| self.is_defined(name)).map(String::as_str).collect();
        Problem::at(span, format!("unknown material \"{}\"", shorten(name)))
            .label(format!("expected the name of a MakeNamedMaterial{}", did_you_mean(name, &known)))
    }
}

impl Builder {
    /// `NamedMaterial "name"`
    pub(super) fn named_material(&mut self, name: &Name) -> Result<()> {
        // v3 knows what stands before, and goes on with the present material.
        if !self.materials.is_defined(&name.text) && self.dialect.is_v3() {
            self.warn(
                self.materials
                    .unknown(&name.text, name.span)
                    .note(Place::Nowhere, "as in pbrt-v3 the material before it stays"),
            );
            return Ok(());
        }
        self.state.material = self.materials.named(name);
        Ok(())
    }

    /// Moves the materials that shapes use into the scene, and takes out what is not there.
    pub(super) fn finish_materials(&mut self) -> Result<()> {
        let mut new_ids: HashMap<u32, MaterialId> = HashMap::new();
        let mut interface = None;
        let spans = std::mem::take(&mut self.shape_spans);
        for (mut shape, span) in std::mem::take(&mut self.scene.shapes).into_iter().zip(spans) {
            let old = shape.material.0;
            shape.material = match new_ids.get(&old) {
                Some(id) => *id,
                None => {
                    self.textures.need_material(MaterialId(old));
                    let material = match self.materials.known(old as usize)? {
                        Read::Material(material) => material,
                        Read::Lacking(material, lacks) => {
                            lacks.iter().for_each(|lack| self.lack(lack.clone()));
                            material
                        }
                        Read::Interface => match shape.emission {
                            // v3's lamps shine, and let through what comes from behind.
                            Some(_) if self.dialect.is_v3() => {
                                let through = *interface.get_or_insert_with(|| {
                                    self.scene.materials.push(NOT_THERE);
                                    MaterialId(self.scene.materials.len() as u32 - 1)
                                });
                                self.scene.shapes.push(Shape { material: through, ..shape });
                                self.shape_spans.push(span);
                                continue;
                            }
                            lamp => {
                                self.drop_count(Dropped::InterfaceLamps, lamp.is_some().into(), Place::Scene);
                                continue;
                            }
                        },
                    };
                    self.scene.materials.push(material);
                    let id = MaterialId(self.scene.materials.len() as u32 - 1);
                    let relief = self.materials.reliefs.get(&MaterialId(old));
                    self.scene.reliefs.extend(relief.map(|relief| (id, *relief)));
                    new_ids.insert(old, id);
                    id
                }
            };
            self.scene.shapes.push(shape);
            self.shape_spans.push(span);
        }
        Ok(())
    }

    /// `Material "kind" ...`
    pub(super) fn material(&mut self, kind: &Name, parameters: &Parameters) -> Result<()> {
        let relief = self.relief(parameters)?;
        let read = self.read_material(kind, parameters)?;
        self.state.material = self.materials.intern_read(read, relief);
        self.textures.belong_to(self.state.material);
        Ok(())
    }

    /// `MakeNamedMaterial "name" "string type" "kind" ...`
    pub(super) fn make_named_material(&mut self, name: Name, parameters: &Parameters) -> Result<()> {
        let Some(text) = parameters.string("type")? else {
            return Err(Problem::at(name.span, "material without \"string type\"")
                .label("expected \"string type\" with the kind of material"));
        };
        let span = parameters.find("type").map_or(name.span, |p| p.values_span);
        let kind = Name { text: text.to_string(), span };
        let relief = self.relief(parameters)?;
        let material = self.read_material(&kind, parameters)?;
        if self.materials.is_defined(&name.text) {
            let problem =
                Problem::at(name.span, format!("material \"{}\" is defined twice", shorten(&name.text)));
            if !self.dialect.is_v3() {
                return Err(problem);
            }
            self.warn(problem);
        }
        let text = name.text.clone();
        self.materials.define(name.text, material, relief);
        if let Some(id) = self.materials.names.get(&text) {
            self.textures.belong_to(*id);
        }
        Ok(())
    }

    /// Reads all that there is to read, so that everything that is lacking is known at once.
    fn read_material(&mut self, kind: &Name, parameters: &Parameters) -> Result<Read> {
        if matches!(kind.text.as_str(), "interface" | "none" | "") {
            parameters.accept_all();
            return Ok(Read::Interface);
        }
        let read = match self.read_kind(kind, parameters) {
            Ok(read) => {
                // What is lacking may have kept parameters from being looked at.
                if self.pending.is_empty() {
                    self.check_unused(parameters, &format!("material \"{}\"", kind.text))?;
                }
                read
            }
            Err(problem) if problem.lacking.is_some() => {
                self.pending.push(*problem);
                Read::Material(self.stand_in(parameters))
            }
            Err(problem) => return Err(problem),
        };
        let mut lacks = std::mem::take(&mut self.pending);
        Ok(match read {
            read if lacks.is_empty() => read,
            Read::Material(material) => Read::Lacking(material, lacks.into()),
            Read::Lacking(material, more) => {
                lacks.extend(more.iter().cloned());
                Read::Lacking(material, lacks.into())
            }
            Read::Interface => Read::Interface,
        })
    }

    /// A diffuse surface of the colour that the parameters of another material give.
    fn stand_in(&mut self, parameters: &Parameters) -> Material {
        let names = ["reflectance", "Kd", "color", "transmittance"];
        let found = names.into_iter().find(|name| parameters.given(name).is_some());
        let pending = std::mem::take(&mut self.pending);
        let color = found.and_then(|name| self.surface_spectrum(parameters, name).ok().flatten());
        self.pending = pending;
        let reflectance = color.unwrap_or([0.5; 3]).map(|c| c.clamp(0.0, 1.0) as f32);
        Material::Diffuse { reflectance: reflectance.into(), sigma: 0.0.into() }
    }

    fn read_kind(&mut self, kind: &Name, parameters: &Parameters) -> Result<Read> {
        if matches!(
            kind.text.as_str(),
            "matte" | "mirror" | "metal" | "glass" | "plastic" | "substrate" | "uber"
        ) {
            self.dialect.saw_v3(kind.span)?;
        }
        let material = match kind.text.as_str() {
            "diffuse" => self.diffuse(parameters, "reflectance")?,
            "matte" => self.diffuse(parameters, "Kd")?,
            "diffusetransmission" => self.diffuse_transmission(parameters)?,
            "conductor" => self.conductor(parameters)?,
            "metal" => self.metal(parameters)?,
            "mirror" => self.mirror(parameters)?,
            "dielectric" => self.dielectric(parameters)?,
            "glass" => self.glass(parameters)?,
            "thindielectric" => {
                Material::ThinDielectric { eta: self.index_of_refraction(parameters, "eta")?.into() }
            }
            "mix" => return self.mix(kind, parameters),
            "plastic" | "substrate" | "uber" => self.uncoated(kind, parameters)?,
            other if UNSUPPORTED.contains(&other) => {
                return Err(unsupported_kind("material", kind, &SUPPORTED)
                    .lacking("a diffuse surface of the same colour"));
            }
            _ => {
                let known: Vec<&str> = SUPPORTED.into_iter().chain(UNSUPPORTED).collect();
                let problem = unknown_kind("material", kind, &known);
                self.mistake(problem.label(format!(
                    "expected one of {}{}",
                    SUPPORTED.join(", "),
                    did_you_mean(&kind.text, &known)
                )))?;
                // pbrt-v3 takes it for matte.
                self.diffuse(parameters, "Kd")?
            }
        };
        Ok(Read::Material(material))
    }

    /// A reflectance, clamped to [0, 1] as pbrt does.
    fn reflectance(&mut self, parameters: &Parameters, name: &'static str, default: f64) -> Result<Rgb64> {
        let Some(value) = self.surface_spectrum(parameters, name)? else {
            return Ok([default; 3]);
        };
        let clamped = value.map(|c| c.clamp(0.0, 1.0));
        if clamped != value {
            let found = format!("outside [0, 1]: {} {} {}", value[0], value[1], value[2]);
            self.warn(parameters.bad(name, &found, "it is clamped"));
        }
        Ok(clamped)
    }

    /// A share of light, clamped to [0, 1]: that of a texture where it is evaluated.
    fn share(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
        default: f64,
    ) -> Result<Parameter<Rgb64>> {
        match self.spectrum_parameter(parameters, name)? {
            Some(Parameter::Texture(id)) => Ok(Parameter::Texture(id)),
            _ => Ok(Parameter::Constant(self.reflectance(parameters, name, default)?)),
        }
    }

    fn diffuse(&mut self, parameters: &Parameters, name: &'static str) -> Result<Material> {
        let reflectance = self.share(parameters, name, 0.5)?;
        let sigma = self.float_parameter(parameters, "sigma")?.unwrap_or(Parameter::Constant(0.0));
        let sigma = match sigma {
            Parameter::Constant(sigma) if !(0.0..=90.0).contains(&sigma) => {
                return Err(parameters.bad("sigma", &sigma.to_string(), "expected 0 to 90 degrees"));
            }
            Parameter::Constant(sigma) => Parameter::Constant(sigma as f32),
            Parameter::Texture(id) => Parameter::Texture(id),
        };
        Ok(Material::Diffuse { reflectance: single(reflectance), sigma })
    }

    /// Both shares times `scale`, then clamped to [0, 1], as pbrt does.
    fn diffuse_transmission(&mut self, parameters: &Parameters) -> Result<Material> {
        let scale = parameters.float_or("scale", 1.0)?;
        let mut share = |name| -> Result<Parameter<[f32; 3]>> {
            let value = self.share(parameters, name, 0.25)?;
            Ok(match self.product(value, Parameter::Constant([scale; 3])) {
                Parameter::Constant(value) => value.map(|c| c.clamp(0.0, 1.0) as f32).into(),
                Parameter::Texture(id) => Parameter::Texture(id),
            })
        };
        let (reflectance, transmittance) = (share("reflectance")?, share("transmittance")?);
        Ok(Material::DiffuseTransmission { reflectance, transmittance })
    }

    fn conductor(&mut self, parameters: &Parameters) -> Result<Material> {
        let alpha = self.alpha(parameters, 0.0, sqrt_remap)?;
        if parameters.find("reflectance").is_some() {
            if parameters.find("eta").is_some() || parameters.find("k").is_some() {
                return Err(Problem::new(
                    parameters.find("reflectance").map_or(Place::Nowhere, |p| Place::Span(p.span)),
                    "\"reflectance\" together with \"eta\" or \"k\"",
                )
                .label("expected either the reflectance or the optical constants"));
            }
            let reflectance = self.reflectance(parameters, "reflectance", 1.0)?;
            return Ok(conductor_of_reflectance(reflectance, alpha));
        }
        self.optical_constants(parameters, alpha)
    }

    fn optical_constants(&mut self, parameters: &Parameters, alpha: [f32; 2]) -> Result<Material> {
        let mut constants = [[0.0f32; 3]; 2];
        for (constant, (name, default)) in
            constants.iter_mut().zip([("eta", "metal-Cu-eta"), ("k", "metal-Cu-k")])
        {
            let value = match self.surface_spectrum(parameters, name)? {
                Some(value) => value,
                None => {
                    let v3 = self.dialect.is_v3();
                    spectra::named(default).and_then(|named| named.surface_rgb(v3)).unwrap_or([1.0; 3])
                }
            };
            if value.into_iter().any(|c| c < 0.0) {
                return Err(parameters.bad(name, "negative", "expected numbers that are not negative"));
            }
            *constant = rgb32(value, parameters, name)?;
        }
        let [eta, k] = &mut constants;
        for (eta, k) in eta.iter().zip(k) {
            // (0 - 1)^2 + k^2 = (0 + 1)^2 + k^2: everything is reflected, whatever k is. Where it is 0, too, the limit
            // must not be 0 / 0.
            if *eta == 0.0 && *k == 0.0 {
                *k = 1.0;
            }
        }
        let [eta, k] = constants.map(Parameter::Constant);
        Ok(Material::Conductor { eta, k, alpha: alpha.map(Parameter::Constant) })
    }

    /// v3's metal: like a conductor, but always rough, and with another scale of roughness.
    fn metal(&mut self, parameters: &Parameters) -> Result<Material> {
        let alpha = self.alpha(parameters, 0.01, v3_remap)?.map(|alpha| alpha.max(1e-3));
        self.optical_constants(parameters, alpha)
    }

    fn mirror(&mut self, parameters: &Parameters) -> Result<Material> {
        let reflectance = self.share(parameters, "Kr", 0.9)?;
        Ok(Material::Mirror { reflectance: single(reflectance) })
    }

    fn dielectric(&mut self, parameters: &Parameters) -> Result<Material> {
        self.refuse_roughness(parameters, sqrt_remap)?;
        let eta = self.index_of_refraction(parameters, "eta")?;
        let white = Parameter::Constant([1.0; 3]);
        Ok(Material::Dielectric { eta: eta.into(), reflectance: white, transmittance: white })
    }

    fn glass(&mut self, parameters: &Parameters) -> Result<Material> {
        self.refuse_roughness(parameters, v3_remap)?;
        let name = if parameters.find("eta").is_some() { "eta" } else { "index" };
        let eta = self.index_of_refraction(parameters, name)?;
        let reflectance = single(self.share(parameters, "Kr", 1.0)?);
        let transmittance = single(self.share(parameters, "Kt", 1.0)?);
        Ok(Material::Dielectric { eta: eta.into(), reflectance, transmittance })
    }

    fn refuse_roughness(&mut self, parameters: &Parameters, remap: fn(f64) -> f64) -> Result<()> {
        let before = self.pending.len();
        // v3's glass is smooth where the roughness is 0, whatever the remapping says of 0.
        if self.roughness(parameters, 0.0)? == [0.0; 2] {
            parameters.accept(&["remaproughness"]);
            return Ok(());
        }
        // Of a texture that is not supported, that was said.
        if self.alpha(parameters, 0.0, remap)? == [0.0; 2] || self.pending.len() != before {
            return Ok(());
        }
        let name = ["roughness", "uroughness", "vroughness"]
            .into_iter()
            .find(|name| parameters.find(name).is_some())
            .unwrap_or("roughness");
        let problem = parameters.bad(name, "not 0", "expected 0: rough dielectrics are not supported yet");
        self.pending.push(*problem.lacking("the dielectric is smooth"));
        Ok(())
    }

    fn roughness(&mut self, parameters: &Parameters, default: f64) -> Result<[f64; 2]> {
        let both = self.float_texture(parameters, "roughness")?.unwrap_or(default);
        let mut values = [both; 2];
        for (value, name) in values.iter_mut().zip(["uroughness", "vroughness"]) {
            if let Some(own) = self.float_texture(parameters, name)? {
                *value = own;
            }
            if *value < 0.0 {
                let name = if parameters.find(name).is_some() { name } else { "roughness" };
                return Err(parameters.bad(
                    name,
                    &value.to_string(),
                    "expected a number that is not negative",
                ));
            }
        }
        Ok(values)
    }

    /// GGX alpha along u and v; `[0, 0]` where pbrt treats the surface as smooth.
    fn alpha(&mut self, parameters: &Parameters, default: f64, remap: fn(f64) -> f64) -> Result<[f32; 2]> {
        let roughness = self.roughness(parameters, default)?;
        let alpha =
            if parameters.bool_or("remaproughness", true)? { roughness.map(remap) } else { roughness };
        if alpha[0].max(alpha[1]) < SMOOTH {
            return Ok([0.0; 2]);
        }
        Ok(alpha.map(|alpha| alpha.clamp(1e-4, 1e4) as f32))
    }

    /// Index of refraction of a dielectric: a number, or a glass at the yellow line.
    fn index_of_refraction(&mut self, parameters: &Parameters, name: &'static str) -> Result<f32> {
        use ParameterType::{Float, Rgb, Spectrum, Texture};
        let Some(parameter) = parameters.typed(name, &[Float, Rgb, Spectrum, Texture])? else {
            return Ok(1.5);
        };
        let eta = if parameter.ty == Rgb {
            parameter.single()?;
            let numbers = parameter.numbers();
            if numbers.iter().any(|eta| *eta != numbers[1]) {
                let eta = numbers[1];
                let text = format!("dispersion is ignored: the index of refraction is {eta} for all colours");
                self.warn(parameter.problem(text));
            }
            numbers[1]
        } else if parameter.ty == Spectrum {
            let (eta, disperses) = match self.spectrum(parameter)? {
                SpectrumValue::Named(Named::Glass(eta)) => (eta, true),
                SpectrumValue::Named(_) => {
                    return Err(parameter
                        .problem("not the spectrum of a glass")
                        .label("expected a name such as glass-BK7"));
                }
                // The sodium line, 589 nm, to which indices refer.
                SpectrumValue::Sampled(sampled) => {
                    let range = [sampled.index_at(400.0), sampled.index_at(700.0)];
                    (sampled.index_at(589.0), range[0] != range[1])
                }
            };
            if disperses {
                let text =
                    format!("dispersion is ignored: the index of refraction is {eta:.4} for all colours");
                self.warn(parameter.problem(text));
            }
            eta
        } else {
            self.float_texture(parameters, name)?.unwrap_or(1.5)
        };
        if eta > 0.0 && (eta as f32).is_finite() && eta as f32 > 0.0 {
            return Ok(eta as f32);
        }
        Err(parameters.bad(name, &eta.to_string(), "expected an index of refraction above 0"))
    }

    /// A mixture is supported where it is none: of equal materials, or with one of them only.
    fn mix(&mut self, kind: &Name, parameters: &Parameters) -> Result<Read> {
        let names: Vec<(String, Place)> = match parameters.typed("materials", &[ParameterType::String])? {
            Some(list) => {
                list.strings().iter().enumerate().map(|(i, s)| (s.clone(), list.place(i))).collect()
            }
            None => {
                let mut names = Vec::new();
                for name in ["namedmaterial1", "namedmaterial2"] {
                    let Some(text) = parameters.string(name)? else {
                        continue;
                    };
                    names.push((
                        text.to_string(),
                        parameters.find(name).map_or(Place::Nowhere, |p| p.place(0)),
                    ));
                }
                names
            }
        };
        let [first, second] = &names[..] else {
            return Err(Problem::at(kind.span, "material \"mix\" without two materials")
                .label("expected \"string materials\" with two names"));
        };
        let mut found = [Read::Interface, Read::Interface];
        for (read, (name, place)) in found.iter_mut().zip([first, second]) {
            *read = self.materials.by_name(name).ok_or_else(|| {
                Problem::new(place.clone(), format!("unknown material \"{}\"", shorten(name)))
                    .label("expected one that is defined before")
            })?;
            if let Some(id) = self.materials.names.get(name) {
                let textures = self.textures.of_material(*id);
                self.textures.name_all(textures);
            }
        }
        // v4's amount is the share of the second material, v3's of the first.
        let v3 = parameters.find("materials").is_none();
        let amount = match parameters.find("amount").map(|p| p.ty) {
            Some(ParameterType::Float) => self.float_texture(parameters, "amount")?,
            Some(_) => self
                .surface_spectrum(parameters, "amount")
                .ok()
                .flatten()
                .and_then(|[r, g, b]| (r == g && g == b).then_some(r)),
            None => Some(0.5),
        };
        let [first, second] = found;
        let larger = usize::from((amount.is_some_and(|amount| amount > 0.5)) != v3);
        match (&first, &second) {
            (Read::Material(a), Read::Material(b)) if a == b => return Ok(first),
            _ if amount == Some(0.0) || amount == Some(1.0) => {
                return Ok(if larger == 1 { second } else { first });
            }
            _ => {}
        }
        self.pending.push(
            *unsupported_kind("material", kind, &SUPPORTED)
                .label("expected equal materials: true mixtures are not supported")
                .lacking("the material that has the larger share"),
        );
        let mut lacks = std::mem::take(&mut self.pending);
        let mut shown = Material::Diffuse { reflectance: [0.5; 3].into(), sigma: 0.0.into() };
        for (i, read) in [first, second].into_iter().enumerate() {
            let material = match read {
                Read::Material(material) => material,
                Read::Lacking(material, more) => {
                    lacks.extend(more.iter().cloned());
                    material
                }
                Read::Interface => continue,
            };
            if i == larger {
                shown = material;
            }
        }
        Ok(Read::Lacking(shown, lacks.into()))
    }

    /// v3's materials with a specular coat: without one, they are diffuse.
    fn uncoated(&mut self, kind: &Name, parameters: &Parameters) -> Result<Material> {
        let default = if kind.text == "substrate" { 0.5 } else { 0.25 };
        if self.surface_spectrum(parameters, "Ks")?.unwrap_or([default; 3]) != [0.0; 3] {
            let problem =
                Problem::at(kind.span, format!("the specular coat of \"{}\" is not supported", kind.text))
                    .label("expected \"rgb Ks\" [ 0 0 0 ]: the diffuse base \"Kd\" alone")
                    .lacking("its diffuse base \"Kd\" alone");
            self.pending.push(*problem);
        }
        if kind.text == "uber" {
            for (name, neutral) in [("Kr", [0.0; 3]), ("Kt", [0.0; 3]), ("opacity", [1.0; 3])] {
                if self.surface_spectrum(parameters, name)?.is_some_and(|value| value != neutral) {
                    let expected = format!("expected {}: only the diffuse base is supported", neutral[0]);
                    let problem = parameters.bad(name, &format!("not {}", neutral[0]), &expected);
                    self.pending.push(*problem.lacking("its diffuse base \"Kd\" alone"));
                }
            }
            parameters.accept(&["eta", "index"]);
        }
        parameters.accept(&["roughness", "uroughness", "vroughness", "remaproughness"]);
        let reflectance = self.reflectance(parameters, "Kd", default)?.map(|c| c as f32);
        Ok(Material::Diffuse { reflectance: reflectance.into(), sigma: Parameter::Constant(0.0) })
    }
}

/// A surface that does nothing to light: of index 1, it neither reflects nor bends.
const NOT_THERE: Material = Material::Dielectric {
    eta: Parameter::Constant(1.0),
    reflectance: Parameter::Constant([0.0; 3]),
    transmittance: Parameter::Constant([1.0; 3]),
};

/// In single precision.
fn single(value: Parameter<Rgb64>) -> Parameter<[f32; 3]> {
    match value {
        Parameter::Constant(value) => value.map(|c| c as f32).into(),
        Parameter::Texture(id) => Parameter::Texture(id),
    }
}

/// pbrt-v4: alpha = sqrt(roughness).
fn sqrt_remap(roughness: f64) -> f64 {
    roughness.sqrt()
}

/// pbrt-v3's `TrowbridgeReitzDistribution::RoughnessToAlpha`: a polynomial in the logarithm.
fn v3_remap(roughness: f64) -> f64 {
    let x = roughness.max(1e-3).ln();
    1.62142 + x * (0.819955 + x * (0.1734 + x * (0.0171201 + x * 0.000640711)))
}

/// pbrt-v4: eta = 1 and k = 2 sqrt(r) / sqrt(1 - r) reflect r at normal incidence.
fn conductor_of_reflectance(reflectance: Rgb64, alpha: [f32; 2]) -> Material {
    let k = reflectance.map(|r| {
        let r = r.clamp(0.0, 0.9999);
        (2.0 * r.sqrt() / (1.0 - r).sqrt()) as f32
    });
    Material::Conductor {
        eta: Parameter::Constant([1.0; 3]),
        k: k.into(),
        alpha: alpha.map(Parameter::Constant),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectance_is_met_at_normal_incidence() {
        let Material::Conductor { eta, k, .. } = conductor_of_reflectance([0.0, 0.4, 0.9], [0.0; 2]) else {
            panic!()
        };
        let [eta, k] = [eta, k].map(|parameter| parameter.constant().expect("not textured"));
        for (i, expected) in [0.0, 0.4, 0.9].into_iter().enumerate() {
            let (n, k) = (f64::from(eta[i]), f64::from(k[i]));
            let r = ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
            assert!((r - expected).abs() < 1e-6, "{r} {expected}");
        }
    }

    #[test]
    fn v3_roughness_maps_one_to_the_constant_term() {
        assert_eq!(v3_remap(1.0), 1.62142);
        assert!((v3_remap(0.01) - 0.1).abs() < 0.05);
    }
}
