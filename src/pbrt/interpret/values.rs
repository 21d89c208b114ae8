//! Parameters that are numbers and colours, or textures of them.

use std::collections::HashMap;

use crate::pbrt::error::{Place, Problem, Result};
use crate::pbrt::lexer::{parse_number, shorten};
use crate::pbrt::parameters::{Parameter, ParameterType, Parameters, Values};
use crate::pbrt::source::open_maybe_gzipped;
use crate::pbrt::spectra::{self, Named, Rgb64, Sampled};
use crate::pbrt::suggest::did_you_mean;

use crate::scene::Parameter as Value;

use super::Builder;
use super::textures::{Lack, Texture};

/// What textures that are not supported are rendered as.
const STAND_IN: f64 = 0.5;

/// Largest file of a spectrum.
const MAX_SPECTRUM_FILE: u64 = 16 << 20;

fn unknown_texture<T>(map: &HashMap<String, Texture<T>>, parameter: &Parameter, kind: &str) -> Box<Problem> {
    let text = &parameter.strings()[0];
    let known: Vec<&str> = map.keys().map(String::as_str).collect();
    parameter
        .problem(format!("unknown {kind} texture \"{}\"", shorten(text)))
        .label(format!("expected one that is defined before{}", did_you_mean(text, &known)))
}

impl Builder {
    /// Notes what a texture lacks, at the parameter that uses it.
    fn note_lacks(&mut self, parameter: &Parameter, lacks: &[Lack]) {
        for lack in lacks {
            let problem = parameter
                .problem(&lack.message)
                .label("expected another texture or a value")
                .note(lack.place.clone(), "the texture is defined here")
                .lacking("the texture is taken for the constant 0.5");
            self.pending.push(*problem);
        }
    }

    /// A number that may be a texture.
    pub(super) fn float_parameter(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
    ) -> Result<Option<Value<f64>>> {
        let types = [ParameterType::Float, ParameterType::Texture];
        let Some(parameter) = parameters.typed(name, &types)? else {
            return Ok(None);
        };
        parameter.single()?;
        if parameter.ty != ParameterType::Texture {
            return Ok(Some(Value::Constant(parameter.numbers()[0])));
        }
        match self.textures.float.get(&parameter.strings()[0]).cloned() {
            Some(texture) => {
                self.note_lacks(parameter, &texture.lacks);
                Ok(Some(self.textures.name(texture.value)))
            }
            None => {
                self.mistake(unknown_texture(&self.textures.float, parameter, "float"))?;
                Ok(None)
            }
        }
    }

    /// A number that is the same everywhere.
    pub(super) fn float_texture(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
    ) -> Result<Option<f64>> {
        Ok(self.float_parameter(parameters, name)?.map(|value| match value {
            Value::Constant(value) => value,
            Value::Texture(_) => {
                self.refuse_texture(parameters, name);
                STAND_IN
            }
        }))
    }

    /// Colour of a surface's property, which may be a texture.
    pub(super) fn spectrum_parameter(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
    ) -> Result<Option<Value<Rgb64>>> {
        use ParameterType::{Rgb, Spectrum, Texture, Xyz};
        let Some(parameter) = parameters.typed(name, &[Rgb, Spectrum, Texture, Xyz])? else {
            return Ok(None);
        };
        let value = match parameter.ty {
            Texture => {
                parameter.single()?;
                match self.textures.spectrum.get(&parameter.strings()[0]).cloned() {
                    Some(texture) => {
                        self.note_lacks(parameter, &texture.lacks);
                        return Ok(Some(self.textures.name(texture.value)));
                    }
                    None => {
                        self.mistake(unknown_texture(&self.textures.spectrum, parameter, "spectrum"))?;
                        return Ok(None);
                    }
                }
            }
            Spectrum => match self.spectrum(parameter)? {
                SpectrumValue::Named(named) => match named.surface_rgb(self.dialect.is_v3()) {
                    Some(rgb) => rgb,
                    None => return Err(parameter.problem("the spectrum of a light for a surface")),
                },
                SpectrumValue::Sampled(sampled) => sampled.surface_rgb(self.dialect.is_v3()),
            },
            _ => three(parameter)?,
        };
        Ok(Some(Value::Constant(value)))
    }

    /// Colour of a surface's property that is the same everywhere.
    pub(super) fn surface_spectrum(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
    ) -> Result<Option<Rgb64>> {
        Ok(self.spectrum_parameter(parameters, name)?.map(|value| match value {
            Value::Constant(value) => value,
            Value::Texture(_) => {
                self.refuse_texture(parameters, name);
                [STAND_IN; 3]
            }
        }))
    }

    /// Notes that a parameter must be the same everywhere.
    fn refuse_texture(&mut self, parameters: &Parameters, name: &'static str) {
        let problem =
            parameters.bad(name, "a texture", "expected a constant: textures of this are not supported");
        self.pending.push(*problem.lacking("the texture is taken for the constant 0.5"));
    }

    /// Colour of a light.
    pub(super) fn light_spectrum(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
    ) -> Result<Option<Rgb64>> {
        use ParameterType::{Blackbody, Rgb, Spectrum, Xyz};
        let Some(parameter) = parameters.typed(name, &[Rgb, Blackbody, Spectrum, Xyz])? else {
            return Ok(None);
        };
        let value = match parameter.ty {
            Blackbody => self.blackbody(parameter)?,
            Spectrum => match self.spectrum(parameter)? {
                SpectrumValue::Named(Named::WhiteLight) => [1.0; 3],
                SpectrumValue::Named(_) => {
                    return Err(parameter.problem("the spectrum of a surface for a light"));
                }
                SpectrumValue::Sampled(sampled) => sampled.light_rgb(self.dialect.is_v3()),
            },
            _ => three(parameter)?,
        };
        match value.iter().position(|&c| c < 0.0) {
            Some(index) => Err(Problem::new(parameter.place(index), format!("\"{name}\" is negative"))
                .label("expected numbers that are not negative")),
            None => Ok(Some(value)),
        }
    }

    fn blackbody(&mut self, parameter: &Parameter) -> Result<Rgb64> {
        let numbers = parameter.numbers();
        let (kelvin, scale) = match *numbers {
            [kelvin] => (kelvin, 1.0),
            // v3: temperature and scale.
            [kelvin, scale] => {
                self.dialect.saw_v3(parameter.values_span)?;
                (kelvin, scale)
            }
            _ => return Err(parameter.problem("a black body has one temperature")),
        };
        if !(1.0..=1e9).contains(&kelvin) {
            return Err(parameter
                .problem(format!("a temperature of {kelvin} K"))
                .label("expected 1 to 1e9 kelvin"));
        }
        Ok(spectra::blackbody_rgb(kelvin, self.dialect.is_v3()).map(|c| c * scale))
    }

    /// A spectrum by name, file or samples.
    pub(super) fn spectrum(&mut self, parameter: &Parameter) -> Result<SpectrumValue> {
        match &parameter.values {
            Values::Numbers(numbers) => {
                let v3 = self.dialect.is_v3();
                let sampled = Sampled::new(numbers, v3);
                let bad = |label| parameter.problem("these samples are not a spectrum").label(label);
                sampled.map(SpectrumValue::Sampled).map_err(bad)
            }
            Values::Strings(_) => {
                parameter.single()?;
                let name = &parameter.strings()[0];
                match spectra::named(name) {
                    Some(named) => Ok(SpectrumValue::Named(named)),
                    None => self.spectrum_file(parameter, name),
                }
            }
            _ => Err(parameter.problem("not a spectrum")),
        }
    }

    fn spectrum_file(&mut self, parameter: &Parameter, name: &str) -> Result<SpectrumValue> {
        let path = self.resolve(name);
        if !path.is_file() {
            let known = |prefix: &&str| name.starts_with(*prefix);
            if spectra::UNSUPPORTED_PREFIXES.iter().any(known) {
                let text = format!("spectrum \"{}\" is not supported", shorten(name));
                return Err(parameter
                    .problem(text)
                    .label("expected numbers instead")
                    .lacking("the defaults of what names it"));
            }
            let names = spectra::NAMED.map(|(name, _)| name);
            return Err(parameter
                .problem(format!("unknown spectrum \"{}\"", shorten(name)))
                .label(format!(
                    "expected a file or one of {}{}",
                    names.join(", "),
                    did_you_mean(name, &names)
                ))
                .note(Place::Nowhere, format!("looked for the file {}", path.display())));
        }
        self.inputs.push(path.clone());
        let numbers = read_spectrum_file(&path)
            .map_err(|(place, message)| {
                Problem::new(Place::Other(format!("{}{place}", path.display())), message)
            })
            .map_err(|problem| problem.note(parameter.place(0), "the file is named here"))?;
        let v3 = self.dialect.is_v3();
        Sampled::new(&numbers, v3).map(SpectrumValue::Sampled).map_err(|label| {
            Problem::new(Place::Other(path.display().to_string()), "the samples are not a spectrum")
                .label(label)
                .note(parameter.place(0), "the file is named here")
        })
    }
}

fn three(parameter: &Parameter) -> Result<Rgb64> {
    parameter.single()?;
    let numbers = parameter.numbers();
    let value = [numbers[0], numbers[1], numbers[2]];
    Ok(if parameter.ty == ParameterType::Xyz {
        spectra::rgb_from_xyz(value).map(|c| c.max(0.0))
    } else {
        value
    })
}

/// A spectrum parameter's value.
pub(super) enum SpectrumValue {
    Named(Named),
    Sampled(Sampled),
}

/// Lines that end with a line feed, a carriage return, or both.
fn lines(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let ends_with_return = |line: &[u8]| line.last() == Some(&b'\r');
    bytes
        .split(|&b| b == b'\n')
        .flat_map(move |line| line[..line.len() - usize::from(ends_with_return(line))].split(|&b| b == b'\r'))
}

/// The numbers of a `.spd` file: wavelength and value alternating, `#` comments.
fn read_spectrum_file(path: &std::path::Path) -> std::result::Result<Vec<f64>, (String, String)> {
    use std::io::Read;
    let mut bytes = Vec::new();
    open_maybe_gzipped(path)
        .and_then(|reader| reader.take(MAX_SPECTRUM_FILE).read_to_end(&mut bytes))
        .map_err(|error| (String::new(), format!("cannot read the file: {error}")))?;
    let mut numbers = Vec::new();
    for (i, line) in lines(&bytes).enumerate() {
        let line = line.split(|&b| b == b'#').next().unwrap_or(&[]);
        for word in line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
            match parse_number(word) {
                Some(number) if number.is_finite() => numbers.push(number),
                _ => {
                    let found = shorten(&String::from_utf8_lossy(word));
                    return Err((format!(":{}", i + 1), format!("`{found}` is not a number")));
                }
            }
        }
    }
    Ok(numbers)
}

/// Rounds to single precision; what overflows is an error at the parameter.
pub(super) fn rgb32(value: Rgb64, parameters: &Parameters, name: &'static str) -> Result<[f32; 3]> {
    let rounded = value.map(|c| c as f32);
    if rounded.iter().all(|c| c.is_finite()) {
        return Ok(rounded);
    }
    Err(parameters.bad(name, "too large for single precision", "expected numbers below 3e38"))
}
