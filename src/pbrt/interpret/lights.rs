//! Lights, and the emission of surfaces.
//!
//! Units follow pbrt-v4: a light with `rgb L [1 1 1]` has radiance 1 in every channel, spectra are scaled to
//! luminance 1, and `scale` multiplies. See [`crate::pbrt`]'s spectra for v3.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use crate::pbrt::error::{Problem, Result, Span};
use crate::pbrt::graphics_state::AreaLight;
use crate::pbrt::lexer::shorten;
use crate::pbrt::parameters::{ParameterType, Parameters};
use crate::pbrt::parser::Name;
use crate::pbrt::spectra::Rgb64;
use crate::pbrt::transform::keeps_angles;
use crate::scene::{Emission, Fade, Light};
use wavepath_kernels::scene::lights::goniometric;

use super::values::rgb32;
use super::{Builder, singular, unknown_kind, unsupported_kind};

const KNOWN: [&str; 5] = ["infinite", "point", "spot", "distant", "goniometric"];

impl Builder {
    /// `AreaLightSource`: the emission of the following shapes.
    pub(super) fn area_light(&mut self, kind: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        match kind.text.as_str() {
            "diffuse" => {}
            "area" => self.dialect.saw_v3(kind.span)?,
            _ => return Err(unknown_kind("area light", kind, &["diffuse"])),
        }
        self.refuse(
            parameters,
            "filename",
            "pictures on area lights are not supported",
            "it shines with \"L\"",
        );
        let radiance = self.light_color(parameters, "L")?;
        let emission = Emission {
            radiance: rgb32(radiance, parameters, "L")?,
            power: self.power(parameters)?,
            two_sided: parameters.bool_or("twosided", false)?,
        };
        parameters.accept(&["samples", "nsamples"]);
        self.check_unused(parameters, "area light \"diffuse\"")?;
        self.state.area_light = Some(AreaLight { emission, span });
        Ok(())
    }

    /// `LightSource`.
    pub(super) fn light(&mut self, kind: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        let light = match kind.text.as_str() {
            "infinite" | "exinfinite" => self.infinite(parameters)?,
            "point" => self.point(parameters, span)?,
            "spot" => self.spot(parameters, span)?,
            "distant" => self.distant(parameters, span)?,
            "goniometric" => self.goniometric(parameters, span)?,
            "projection" => {
                return Err(unsupported_kind("light", kind, &KNOWN).lacking("the light is left out"));
            }
            _ => return self.mistake(unknown_kind("light", kind, &KNOWN)),
        };
        self.check_vacuum();
        parameters.accept(&["samples", "nsamples"]);
        self.check_unused(parameters, &format!("light \"{}\"", kind.text))?;
        // A dark light would be sampled in vain.
        if light.colour() != [0.0; 3] {
            self.scene.lights.push(light);
        }
        Ok(())
    }

    /// The spectrum of this name (white if missing) times `scale`.
    fn light_color(&mut self, parameters: &Parameters, name: &'static str) -> Result<Rgb64> {
        let color = self.light_spectrum(parameters, name)?.unwrap_or([1.0; 3]);
        // v3's scale is a colour.
        let scale = match parameters.find("scale").map(|p| p.ty) {
            None | Some(ParameterType::Float) => [parameters.float_or("scale", 1.0)?; 3],
            Some(_) => self.surface_spectrum(parameters, "scale")?.unwrap_or([1.0; 3]),
        };
        if scale.iter().any(|&s| s < 0.0) {
            return Err(parameters.bad("scale", "negative", "expected a number that is not negative"));
        }
        Ok(std::array::from_fn(|i| color[i] * scale[i]))
    }

    fn infinite(&mut self, parameters: &Parameters) -> Result<Light> {
        for name in ["filename", "mapname"] {
            self.refuse(
                parameters,
                name,
                "environment maps are not supported yet",
                "a sky of \"L\" times \"scale\"",
            );
        }
        self.refuse(parameters, "portal", "portals are not supported", "light comes from all sides");
        let radiance = self.light_color(parameters, "L")?;
        // Radiance L from all sides gives the irradiance pi L.
        let factor = self.positive(parameters, "illuminance")?.map_or(1.0, |illuminance| illuminance / PI);
        Ok(Light::Infinite { radiance: rgb32(radiance.map(|c| c * factor), parameters, "L")? })
    }

    fn point(&mut self, parameters: &Parameters, span: Span) -> Result<Light> {
        let factor = self.positive(parameters, "power")?.map_or(1.0, |power| power / (4.0 * PI));
        let intensity = self.light_color(parameters, "I")?.map(|c| c * factor);
        let from = parameters.point3("from")?.unwrap_or([0.0; 3]);
        let position = self.world_point(from, span)?;
        Ok(Light::Point { intensity: rgb32(intensity, parameters, "I")?, position })
    }

    fn spot(&mut self, parameters: &Parameters, span: Span) -> Result<Light> {
        let (position, to, direction) = self.aim(parameters, span)?;
        let fade = if self.dialect.is_v3() { Fade::FourthPower } else { Fade::Smoothstep };
        let cone = parameters.float_or("coneangle", 30.0)?;
        let delta = parameters.float_or("conedeltaangle", 5.0)?;
        if !(cone > 0.0 && cone <= 180.0) {
            return Err(parameters.bad(
                "coneangle",
                &cone.to_string(),
                "expected degrees above 0, at most 180",
            ));
        }
        if !(0.0..=cone).contains(&delta) {
            return Err(parameters.bad(
                "conedeltaangle",
                &delta.to_string(),
                "expected degrees from 0 to the cone's angle",
            ));
        }
        let cos_total_width = cone.to_radians().cos();
        let cos_falloff_start = (cone - delta).to_radians().cos();
        // Integral of the profile over directions, as pbrt-v4 takes it. (pbrt-v3 has no power.)
        let solid_angle =
            2.0 * PI * ((1.0 - cos_falloff_start) + (cos_falloff_start - cos_total_width) / 2.0);
        let factor = self.positive(parameters, "power")?.map_or(1.0, |power| power / solid_angle);
        let intensity = self.light_color(parameters, "I")?.map(|c| c * factor);
        // The cone is round in the light's own space.
        let matrix = self.static_ctm(span)?.matrix3;
        let light_from_world = match keeps_angles(&matrix) {
            true => None,
            false => Some(direction_matrix(&matrix).ok_or_else(|| singular(span, "a spot light"))?),
        };
        Ok(Light::Spot {
            intensity: rgb32(intensity, parameters, "I")?,
            position,
            direction: if light_from_world.is_some() { to } else { direction },
            cos_falloff_start,
            cos_total_width,
            fade,
            light_from_world,
        })
    }

    /// pbrt's light with a pattern, around the z axis of its space. The pattern comes from no picture yet: `"string
    /// pattern" "batwing"`, of this program alone, is built in.
    fn goniometric(&mut self, parameters: &Parameters, span: Span) -> Result<Light> {
        for name in ["filename", "mapname"] {
            let message = "pictures on goniometric lights are not supported yet";
            self.refuse(parameters, name, message, "the pattern \"batwing\"");
        }
        match parameters.string("pattern")? {
            Some("batwing") => {}
            Some(other) => {
                return Err(parameters.bad(
                    "pattern",
                    &format!("\"{}\"", shorten(other)),
                    "expected \"batwing\"",
                ));
            }
            None if !self.pending.is_empty() => {}
            None => {
                return Err(Problem::at(span, "a goniometric light without a pattern")
                    .label("expected \"string pattern\" \"batwing\""));
            }
        }
        let factor = self.positive(parameters, "power")?.map_or(1.0, |power| power / goniometric::INTEGRAL);
        let intensity = self.light_color(parameters, "I")?.map(|c| c * factor);
        let axis = self.static_ctm(span)?.transform_vector3(DVec3::Z).try_normalize().ok_or_else(|| {
            Problem::at(span, "the light has no direction")
                .label("its transform leaves nothing of the z axis")
        })?;
        Ok(Light::Goniometric {
            intensity: rgb32(intensity, parameters, "I")?,
            position: self.world_point([0.0; 3], span)?,
            axis,
        })
    }

    fn distant(&mut self, parameters: &Parameters, span: Span) -> Result<Light> {
        let (_, _, direction) = self.aim(parameters, span)?;
        let factor = self.positive(parameters, "illuminance")?.unwrap_or(1.0);
        let radiance = self.light_color(parameters, "L")?.map(|c| c * factor);
        Ok(Light::Distant { radiance: rgb32(radiance, parameters, "L")?, direction })
    }

    /// A number that counts if it is above 0; pbrt-v4 ignores others, and pbrt-v3 does not know it.
    fn positive(&mut self, parameters: &Parameters, name: &'static str) -> Result<Option<f64>> {
        if parameters.has(name) && self.dialect.is_v3() {
            return Ok(None);
        }
        Ok(parameters.float(name)?.filter(|value| *value > 0.0))
    }

    /// The power of an area light, which is applied where its area is known.
    fn power(&mut self, parameters: &Parameters) -> Result<Option<f32>> {
        let power = self.positive(parameters, "power")?.map(|power| power as f32);
        match power {
            Some(value) if !value.is_finite() => {
                Err(parameters.bad("power", "too large", "expected a number below 3e38"))
            }
            _ => Ok(power),
        }
    }

    /// Notes a parameter that is not supported, if it is given and has any effect.
    fn refuse(&mut self, parameters: &Parameters, name: &str, message: &str, instead: &'static str) {
        if let Some(parameter) = parameters.given(name).filter(|parameter| parameter.strings() != [""]) {
            let problem = Problem::at(parameter.span, format!("\"{name}\": {message}"))
                .label("expected a light without it")
                .lacking(instead);
            self.pending.push(*problem);
        }
    }

    /// World position of `from`, and unit vectors from there to `to`, in the light's space and in the world.
    fn aim(&mut self, parameters: &Parameters, span: Span) -> Result<(DVec3, DVec3, DVec3)> {
        let from = DVec3::from_array(parameters.point3("from")?.unwrap_or([0.0; 3]));
        let to = DVec3::from_array(parameters.point3("to")?.unwrap_or([0.0, 0.0, 1.0]));
        let ctm = self.static_ctm(span)?;
        let nowhere = || {
            Problem::at(span, "the light has no direction")
                .label("expected different points \"from\" and \"to\"")
        };
        let local = (to - from).try_normalize().ok_or_else(nowhere)?;
        let direction = ctm.transform_vector3(local).try_normalize().ok_or_else(nowhere)?;
        Ok((self.world_point(from.to_array(), span)?, local, direction))
    }

    fn world_point(&mut self, point: [f64; 3], span: Span) -> Result<DVec3> {
        let position = self.static_ctm(span)?.transform_point3(DVec3::from_array(point));
        if position.as_vec3().is_finite() {
            return Ok(position);
        }
        Err(Problem::at(span, "the light is too far away").label("expected coordinates below 3e38"))
    }
}

/// Takes directions of the world back through a transform; a common factor is left out, so that it fits into single
/// precision.
fn direction_matrix(matrix: &DMat3) -> Option<DMat3> {
    let inverse = matrix.inverse();
    let largest = inverse.to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    let scaled = inverse * largest.recip();
    (largest > 0.0 && scaled.is_finite()).then_some(scaled)
}
