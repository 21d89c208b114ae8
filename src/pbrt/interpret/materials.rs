//! Materials.

use std::collections::HashMap;
use std::rc::Rc;

use crate::pbrt::error::{Place, Problem, Result, Span};
use crate::pbrt::lexer::shorten;
use crate::pbrt::parameters::{ParameterType, Parameters};
use crate::pbrt::parser::Name;
use crate::pbrt::spectra::{self, Named, Rgb64};
use crate::pbrt::suggest::did_you_mean;
use wavepath_kernels::texture::Function;

use crate::scene::{Coat, Layers, Material, MaterialId, Parameter, Relief, Shape};

use super::textures::widen;
use super::values::{SpectrumValue, rgb32};
use super::{Builder, unknown_kind, unsupported_kind};

/// pbrt's `EffectivelySmooth`: below it a surface is smooth.
const SMOOTH: f64 = 1e-3;

const SUPPORTED: [&str; 15] = [
    "diffuse",
    "coateddiffuse",
    "coatedconductor",
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
    "translucent",
];

const UNSUPPORTED: [&str; 6] = ["subsurface", "hair", "measured", "disney", "fourier", "kdsubsurface"];

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
    /// One of two of the table's materials, and the share of the second.
    Mixture([MaterialId; 2], Parameter<[f32; 3]>),
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
            Read::Mixture(parts, amount) => format!("mixture {parts:?} {amount:?}"),
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

    /// Whether it is not known yet what a material is.
    pub(super) fn may_be_textured(&self, id: MaterialId) -> bool {
        matches!(self.slots[id.0 as usize], Slot::Pending { .. })
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
                    if let Read::Interface = self.materials.known(old as usize)? {
                        match shape.emission {
                            // v3's lamps shine, and let through what comes from behind.
                            Some(_) if self.dialect.is_v3() => {
                                let through = *interface.get_or_insert_with(|| {
                                    self.scene.materials.push(NOT_THERE);
                                    MaterialId(self.scene.materials.len() as u32 - 1)
                                });
                                self.scene.shapes.push(Shape { material: through, ..shape });
                                self.shape_spans.push(span);
                            }
                            // v4's do not: lamps of a surface that is not there are none.
                            _ => {}
                        }
                        continue;
                    }
                    self.finish_material(old, &mut new_ids)?
                }
            };
            self.scene.shapes.push(shape);
            self.shape_spans.push(span);
        }
        Ok(())
    }

    /// Moves a material into the scene, after those that it is a mixture of.
    fn finish_material(&mut self, old: u32, new_ids: &mut HashMap<u32, MaterialId>) -> Result<MaterialId> {
        if let Some(id) = new_ids.get(&old) {
            return Ok(*id);
        }
        self.textures.need_material(MaterialId(old));
        let material = match self.materials.known(old as usize)? {
            Read::Material(material) => material,
            Read::Lacking(material, lacks) => {
                lacks.iter().for_each(|lack| self.lack(lack.clone()));
                material
            }
            Read::Mixture([first, second], amount) => {
                let materials =
                    [self.finish_material(first.0, new_ids)?, self.finish_material(second.0, new_ids)?];
                Material::Mixture { materials, amount }
            }
            // Only shapes and mixtures ask; neither takes one.
            Read::Interface => NOT_THERE,
        };
        self.scene.materials.push(material);
        let id = MaterialId(self.scene.materials.len() as u32 - 1);
        let relief = self.materials.reliefs.get(&MaterialId(old));
        self.scene.reliefs.extend(relief.map(|relief| (id, *relief)));
        new_ids.insert(old, id);
        Ok(id)
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
            Read::Mixture(..) => Read::Lacking(self.stand_in(parameters), lacks.into()),
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
            "matte" | "mirror" | "metal" | "glass" | "plastic" | "substrate" | "uber" | "translucent"
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
            "coateddiffuse" => self.coated_diffuse(parameters)?,
            "coatedconductor" => self.coated_conductor(parameters)?,
            "plastic" => self.plastic(parameters)?,
            "substrate" => self.substrate(parameters)?,
            "uber" => self.uber(parameters)?,
            "translucent" => self.translucent(parameters)?,
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
        Ok(self.clamped(parameters, name, value))
    }

    fn clamped(&mut self, parameters: &Parameters, name: &'static str, value: Rgb64) -> Rgb64 {
        let clamped = value.map(|c| c.clamp(0.0, 1.0));
        if clamped != value {
            let found = format!("outside [0, 1]: {} {} {}", value[0], value[1], value[2]);
            self.warn(parameters.bad(name, &found, "it is clamped"));
        }
        clamped
    }

    /// A share of light, clamped to [0, 1]: that of a texture where it is evaluated.
    fn share(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
        default: f64,
    ) -> Result<Parameter<Rgb64>> {
        Ok(match self.spectrum_parameter(parameters, name)? {
            Some(Parameter::Texture(id)) => Parameter::Texture(id),
            Some(Parameter::Constant(value)) => Parameter::Constant(self.clamped(parameters, name, value)),
            None => Parameter::Constant([default; 3]),
        })
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
        let alpha = self.alpha(parameters, 0.0, Remap::SquareRoot)?;
        if parameters.find("reflectance").is_some() {
            if parameters.find("eta").is_some() || parameters.find("k").is_some() {
                return Err(Problem::new(
                    parameters.find("reflectance").map_or(Place::Nowhere, |p| Place::Span(p.span)),
                    "\"reflectance\" together with \"eta\" or \"k\"",
                )
                .label("expected either the reflectance or the optical constants"));
            }
            let reflectance = self.share(parameters, "reflectance", 1.0)?;
            let k = self.apply(Function::AbsorptionOfReflectance, reflectance, absorption_of_reflectance);
            return Ok(Material::Conductor { eta: [1.0; 3].into(), k: single(k), alpha });
        }
        self.optical_constants(parameters, alpha)
    }

    fn optical_constants(&mut self, parameters: &Parameters, alpha: [Parameter<f32>; 2]) -> Result<Material> {
        let [eta, k] = self.index_of_conductor(parameters, ["eta", "k"])?.map(Parameter::Constant);
        Ok(Material::Conductor { eta, k, alpha })
    }

    /// Real part and absorption coefficient, copper's where they are not given.
    fn index_of_conductor(
        &mut self,
        parameters: &Parameters,
        names: [&'static str; 2],
    ) -> Result<[[f32; 3]; 2]> {
        let mut constants = [[0.0f32; 3]; 2];
        for (constant, (name, default)) in
            constants.iter_mut().zip(names.into_iter().zip(["metal-Cu-eta", "metal-Cu-k"]))
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
        Ok(constants)
    }

    /// v4's coated conductor: a layered material, too.
    fn coated_conductor(&mut self, parameters: &Parameters) -> Result<Material> {
        let names = [
            ["interface.roughness", "interface.uroughness", "interface.vroughness"],
            ["conductor.roughness", "conductor.uroughness", "conductor.vroughness"],
        ];
        let remap = parameters.bool_or("remaproughness", true)?;
        let mut alphas = [0.0; 2];
        for (alpha, names) in alphas.iter_mut().zip(names) {
            let mut values = [self.float_texture(parameters, names[0])?.unwrap_or(0.0); 2];
            for (value, name) in values.iter_mut().zip(&names[1..]) {
                if let Some(own) = self.float_texture(parameters, name)? {
                    *value = own;
                }
                if *value < 0.0 {
                    let name = if parameters.find(name).is_some() { name } else { names[0] };
                    return Err(parameters.bad(
                        name,
                        &value.to_string(),
                        "expected a number that is not negative",
                    ));
                }
            }
            if values[0] != values[1] {
                let name = if parameters.find(names[1]).is_some() { names[1] } else { names[2] };
                let problem = parameters.bad(name, "another than along the other axis", "expected the same");
                self.pending.push(*problem.lacking("the mean roughness"));
            }
            let [u, v] = if remap { values.map(sqrt_remap) } else { values };
            // pbrt's smooth surfaces are none here.
            *alpha = if u.max(v) < SMOOTH { 0.0 } else { (u * v).sqrt().clamp(SMOOTH, 1e4) };
        }
        let (eta, thickness, max_depth) = self.layers(parameters, "interface.eta")?;
        let [conductor_eta, conductor_k] = if parameters.find("reflectance").is_some() {
            let reflectance = self.reflectance(parameters, "reflectance", 1.0)?;
            [[1.0; 3], absorption_of_reflectance(reflectance).map(|k| k as f32)]
        } else {
            self.index_of_conductor(parameters, ["conductor.eta", "conductor.k"])?
        }
        .map(|index| index.map(|x| f64::from(x) / f64::from(eta)));
        Ok(Material::CoatedConductor {
            layers: Layers {
                eta: eta.into(),
                alpha: alphas[0],
                thickness: thickness.into(),
                conductor_eta,
                conductor_k,
                conductor_alpha: alphas[1],
                orders: max_depth.div_ceil(2).min(64),
            },
        })
    }

    /// v3's metal: like a conductor, but always rough, and with another scale of roughness.
    fn metal(&mut self, parameters: &Parameters) -> Result<Material> {
        let both = self.float_parameter(parameters, "roughness")?.unwrap_or(Parameter::Constant(0.01));
        let roughness = self.roughness_along(parameters, [both; 2])?;
        let alpha = self.v3_alpha(parameters, roughness)?;
        self.optical_constants(parameters, alpha)
    }

    fn mirror(&mut self, parameters: &Parameters) -> Result<Material> {
        let reflectance = self.share(parameters, "Kr", 0.9)?;
        Ok(Material::Mirror { reflectance: single(reflectance) })
    }

    fn dielectric(&mut self, parameters: &Parameters) -> Result<Material> {
        let eta = self.index_of_refraction(parameters, "eta")?;
        let white = Parameter::Constant([1.0; 3]);
        let alpha = self.alpha(parameters, 0.0, Remap::SquareRoot)?;
        Ok(Material::Dielectric { eta: eta.into(), reflectance: white, transmittance: white, alpha })
    }

    fn glass(&mut self, parameters: &Parameters) -> Result<Material> {
        let name = if parameters.find("eta").is_some() { "eta" } else { "index" };
        let eta = self.index_of_refraction(parameters, name)?;
        let reflectance = single(self.share(parameters, "Kr", 1.0)?);
        let transmittance = single(self.share(parameters, "Kt", 1.0)?);
        // v3's glass has no "roughness", and is smooth where both others are 0, whatever the remapping says of 0.
        let roughness = self.roughness_along(parameters, [Parameter::Constant(0.0); 2])?;
        let mut alpha = self.v3_alpha(parameters, roughness)?;
        if roughness == [Parameter::Constant(0.0); 2] {
            alpha = [Parameter::Constant(0.0); 2];
        }
        Ok(Material::Dielectric { eta: eta.into(), reflectance, transmittance, alpha })
    }

    /// v4's layers without a medium between them.
    fn coated_diffuse(&mut self, parameters: &Parameters) -> Result<Material> {
        let reflectance = single(self.share(parameters, "reflectance", 0.5)?);
        let alpha = self.alpha(parameters, 0.0, Remap::SquareRoot)?;
        let (eta, thickness, max_depth) = self.layers(parameters, "eta")?;
        Ok(Material::Coated {
            coat: Coat::Layered,
            reflectance,
            specular: [1.0; 3].into(),
            eta: eta.into(),
            alpha,
            thickness,
            max_depth,
        })
    }

    /// Index and thickness of the coat of a layered material, and the longest walk in it.
    fn layers(&mut self, parameters: &Parameters, eta: &'static str) -> Result<(f32, f32, u32)> {
        let eta = self.index_of_refraction(parameters, eta)?;
        let thickness = self.float_texture(parameters, "thickness")?.unwrap_or(0.01);
        if !(0.0..=1e6).contains(&thickness) {
            return Err(parameters.bad("thickness", &thickness.to_string(), "expected 0 to 1000000"));
        }
        let max_depth = parameters.count_or("maxdepth", 10)?;
        if self.surface_spectrum(parameters, "albedo")?.is_some_and(|albedo| albedo != [0.0; 3]) {
            let expected = "expected 0: no medium between the layers scatters light";
            let problem = parameters.bad("albedo", "not 0", expected);
            self.pending.push(*problem.lacking("a medium that only absorbs"));
        }
        // How a walk is sampled, and where what is not there would scatter to.
        parameters.accept(&["nsamples", "g"]);
        Ok((eta, thickness as f32, max_depth))
    }

    /// v3's plastic: light that comes to its coat is reflected as from below, with total reflection.
    fn plastic(&mut self, parameters: &Parameters) -> Result<Material> {
        let roughness = self.v3_roughness(parameters)?;
        self.added_coat(parameters, 1.0 / 1.5, 0.25, [roughness; 2], Coat::Added)
    }

    fn substrate(&mut self, parameters: &Parameters) -> Result<Material> {
        let roughness = self.roughness_along(parameters, [Parameter::Constant(0.1); 2])?;
        self.added_coat(parameters, 1.5, 0.5, roughness, Coat::Blended)
    }

    fn uber(&mut self, parameters: &Parameters) -> Result<Material> {
        let name = if parameters.find("eta").is_some() { "eta" } else { "index" };
        let eta = self.index_of_refraction(parameters, name)?;
        let both = self.v3_roughness(parameters)?;
        let roughness = self.roughness_along(parameters, [both; 2])?;
        let mirrored = single(self.share(parameters, "Kr", 0.0)?);
        let refracted = single(self.share(parameters, "Kt", 0.0)?);
        let opacity = single(self.share(parameters, "opacity", 1.0)?);
        if mirrored == BLACK && refracted == BLACK && opacity == Parameter::Constant([1.0; 3]) {
            return self.added_coat(parameters, eta, 0.25, roughness, Coat::Added);
        }
        let diffuse = single(self.share(parameters, "Kd", 0.25)?);
        let glossy = single(self.share(parameters, "Ks", 0.25)?);
        let alpha = self.v3_alpha(parameters, roughness)?;
        Ok(Material::Uber {
            diffuse,
            glossy,
            mirrored,
            refracted,
            opacity,
            reflect: [1.0; 3].into(),
            transmit: [0.0; 3].into(),
            eta: eta.into(),
            alpha,
        })
    }

    fn translucent(&mut self, parameters: &Parameters) -> Result<Material> {
        let roughness = self.v3_roughness(parameters)?;
        let diffuse = self.share(parameters, "Kd", 0.25)?;
        let glossy = single(self.share(parameters, "Ks", 0.25)?);
        let reflect = self.share(parameters, "reflect", 0.5)?;
        let transmit = self.share(parameters, "transmit", 0.5)?;
        let alpha = self.v3_alpha(parameters, [roughness; 2])?;
        if glossy == BLACK {
            return Ok(Material::DiffuseTransmission {
                reflectance: single(self.product(diffuse, reflect)),
                transmittance: single(self.product(diffuse, transmit)),
            });
        }
        Ok(Material::Uber {
            diffuse: single(diffuse),
            glossy,
            mirrored: BLACK,
            refracted: BLACK,
            opacity: [1.0; 3].into(),
            reflect: single(reflect),
            transmit: single(transmit),
            eta: 1.5.into(),
            alpha,
        })
    }

    /// v3's coats on a diffuse base: `Kd` and `Ks`.
    fn added_coat(
        &mut self,
        parameters: &Parameters,
        eta: f32,
        default: f64,
        roughness: [Parameter<f64>; 2],
        coat: Coat,
    ) -> Result<Material> {
        let reflectance = single(self.share(parameters, "Kd", default)?);
        let specular = single(self.share(parameters, "Ks", default)?);
        let alpha = self.v3_alpha(parameters, roughness)?;
        if specular == BLACK && coat == Coat::Added {
            return Ok(Material::Diffuse { reflectance, sigma: Parameter::Constant(0.0) });
        }
        let (thickness, max_depth) = (0.0, 1);
        Ok(Material::Coated { coat, reflectance, specular, eta: eta.into(), alpha, thickness, max_depth })
    }

    /// `roughness` of v3's coats.
    fn v3_roughness(&mut self, parameters: &Parameters) -> Result<Parameter<f64>> {
        let roughness = self.float_parameter(parameters, "roughness")?.unwrap_or(Parameter::Constant(0.1));
        not_negative(parameters, "roughness", roughness)
    }

    /// GGX alpha of v3's materials, which are never quite smooth.
    fn v3_alpha(
        &mut self,
        parameters: &Parameters,
        roughness: [Parameter<f64>; 2],
    ) -> Result<[Parameter<f32>; 2]> {
        let alpha = self.remapped(parameters, roughness, Remap::V3)?;
        Ok(alpha.map(|alpha| match alpha {
            Parameter::Constant(alpha) => Parameter::Constant(alpha.clamp(SMOOTH, 1e4) as f32),
            Parameter::Texture(id) => Parameter::Texture(id),
        }))
    }

    /// GGX alpha of a roughness, unless `remaproughness` says that it is one.
    fn remapped(
        &mut self,
        parameters: &Parameters,
        [u, v]: [Parameter<f64>; 2],
        remap: Remap,
    ) -> Result<[Parameter<f64>; 2]> {
        if !parameters.bool_or("remaproughness", true)? {
            return Ok([u, v]);
        }
        let mut one = |roughness| match remap {
            Remap::SquareRoot => self.apply(Function::SquareRoot, roughness, sqrt_remap),
            Remap::V3 => self.apply(Function::AlphaV3, roughness, v3_remap),
        };
        // What is the same along both is one texture.
        let first = one(u);
        Ok([first, if u == v { first } else { one(v) }])
    }

    /// `uroughness` and `vroughness`.
    fn roughness_along(
        &mut self,
        parameters: &Parameters,
        default: [Parameter<f64>; 2],
    ) -> Result<[Parameter<f64>; 2]> {
        let mut values = default;
        for (value, name) in values.iter_mut().zip(["uroughness", "vroughness"]) {
            let own = self.float_parameter(parameters, name)?;
            let given = if own.is_some() { name } else { "roughness" };
            *value = not_negative(parameters, given, own.unwrap_or(*value))?;
        }
        Ok(values)
    }

    /// GGX alpha along u and v; `[0, 0]` where pbrt treats the surface as smooth.
    fn alpha(&mut self, parameters: &Parameters, default: f64, remap: Remap) -> Result<[Parameter<f32>; 2]> {
        let both = self.float_parameter(parameters, "roughness")?.unwrap_or(Parameter::Constant(default));
        let roughness = self.roughness_along(parameters, [both; 2])?;
        let alpha = self.remapped(parameters, roughness, remap)?;
        if alpha.iter().all(|alpha| matches!(alpha, Parameter::Constant(alpha) if *alpha < SMOOTH)) {
            return Ok([Parameter::Constant(0.0); 2]);
        }
        Ok(alpha.map(|alpha| match alpha {
            Parameter::Constant(alpha) => Parameter::Constant(alpha.clamp(1e-4, 1e4) as f32),
            Parameter::Texture(id) => Parameter::Texture(id),
        }))
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

    /// `mix`: one of two materials.
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
            // A texture of colours is v3's.
            Some(ParameterType::Texture) if v3 => self.spectrum_parameter(parameters, "amount")?,
            Some(ParameterType::Float | ParameterType::Texture) => {
                self.float_parameter(parameters, "amount")?.map(widen)
            }
            Some(_) => self.spectrum_parameter(parameters, "amount")?,
            None => None,
        };
        let amount = match amount.unwrap_or(Parameter::Constant([0.5; 3])) {
            Parameter::Constant(amount) => Parameter::Constant(amount.map(|c| c.clamp(0.0, 1.0) as f32)),
            Parameter::Texture(id) => Parameter::Texture(id),
        };
        let mut ids = [first, second].map(|(name, _)| self.materials.names.get(name).copied());
        let [mut first, mut second] = found;
        if v3 {
            ids.reverse();
            std::mem::swap(&mut first, &mut second);
        }
        match (&first, &second) {
            (Read::Material(a), Read::Material(b)) if a == b => return Ok(first),
            _ if amount == BLACK => return Ok(first),
            _ if amount == Parameter::Constant([1.0; 3]) => return Ok(second),
            (Read::Interface, _) | (_, Read::Interface) => {}
            _ => {
                if let [Some(first), Some(second)] = ids {
                    return Ok(Read::Mixture([first, second], amount));
                }
            }
        }
        self.pending.push(
            *unsupported_kind("material", kind, &SUPPORTED)
                .label("expected two materials that are there: one of these is an interface")
                .lacking("the material that is there"),
        );
        let lacks = std::mem::take(&mut self.pending);
        Ok(match if let Read::Interface = first { second } else { first } {
            Read::Material(material) => Read::Lacking(material, lacks.into()),
            Read::Lacking(material, more) => {
                Read::Lacking(material, lacks.into_iter().chain(more.iter().cloned()).collect())
            }
            Read::Mixture(..) => Read::Lacking(self.stand_in(parameters), lacks.into()),
            Read::Interface => Read::Interface,
        })
    }
}

/// A surface that does nothing to light: of index 1, it neither reflects nor bends.
const NOT_THERE: Material = Material::Dielectric {
    eta: Parameter::Constant(1.0),
    reflectance: Parameter::Constant([0.0; 3]),
    transmittance: Parameter::Constant([1.0; 3]),
    alpha: [Parameter::Constant(0.0); 2],
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
fn absorption_of_reflectance(reflectance: Rgb64) -> Rgb64 {
    reflectance.map(|r| {
        let r = r.clamp(0.0, 0.9999);
        2.0 * r.sqrt() / (1.0 - r).sqrt()
    })
}

/// How a roughness becomes the alpha of GGX.
#[derive(Clone, Copy)]
enum Remap {
    /// v4.
    SquareRoot,
    /// v3.
    V3,
}

const BLACK: Parameter<[f32; 3]> = Parameter::Constant([0.0; 3]);

/// A value that must not be negative, if it is known.
fn not_negative(
    parameters: &Parameters,
    name: &'static str,
    value: Parameter<f64>,
) -> Result<Parameter<f64>> {
    match value {
        Parameter::Constant(value) if value < 0.0 => {
            Err(parameters.bad(name, &value.to_string(), "expected a number that is not negative"))
        }
        value => Ok(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectance_is_met_at_normal_incidence() {
        for (k, expected) in absorption_of_reflectance([0.0, 0.4, 0.9]).into_iter().zip([0.0, 0.4, 0.9]) {
            let r = k * k / (4.0 + k * k);
            assert!((r - expected).abs() < 1e-12, "{r} {expected}");
        }
    }

    #[test]
    fn v3_roughness_maps_one_to_the_constant_term() {
        assert_eq!(v3_remap(1.0), 1.62142);
        assert!((v3_remap(0.01) - 0.1).abs() < 0.05);
    }
}
