//! Lights, and the emission of surfaces.
//!
//! Units follow pbrt-v4: a light with `rgb L [1 1 1]` has radiance 1 in every channel, spectra are scaled to
//! luminance 1, and `scale` multiplies. See [`crate::pbrt`]'s spectra for v3.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use crate::pbrt::error::{Place, Problem, Result, Span};
use crate::pbrt::graphics_state::AreaLight;
use crate::pbrt::lexer::shorten;
use crate::pbrt::parameters::{ParameterType, Parameters};
use crate::pbrt::parser::Name;
use crate::pbrt::spectra::Rgb64;
use crate::pbrt::transform::keeps_angles;
use crate::picture::{Raster, Transfer};
use crate::scene::{Emission, Fade, Light, LightImage, PictureMapping, SkyMapping};
use wavepath_kernels::math::Vec3;
use wavepath_kernels::scene::lights::goniometric;
use wavepath_kernels::sphere_maps::equal_area_to_sphere;

use super::values::rgb32;
use super::{Builder, singular, unknown_kind};

const KNOWN: [&str; 6] = ["infinite", "point", "spot", "distant", "goniometric", "projection"];

/// Luminance of the primaries of sRGB.
const LUMINANCE: [f64; 3] = [0.212_656, 0.715_158, 0.072_186];

impl Builder {
    /// `AreaLightSource`: the emission of the following shapes.
    pub(super) fn area_light(&mut self, kind: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        match kind.text.as_str() {
            "diffuse" => {}
            "area" => self.dialect.saw_v3(kind.span)?,
            _ => return Err(unknown_kind("area light", kind, &["diffuse"])),
        }
        let image = if self.dialect.is_v3() { None } else { self.light_image(parameters, "filename")? };
        let mut radiance = self.light_color(parameters, "L")?;
        let power = self.power(parameters)?;
        if let Some((image, raster)) = &image {
            self.either_colour_or_image(parameters, "L")?;
            if power.is_some() {
                // The power is that of the mean over the picture.
                let pixels = f64::from(raster.width()) * f64::from(raster.height());
                let mean = luminance_sum(raster, image.transfer, |_, _| pixels.recip());
                radiance = radiance.map(|c| if mean > 0.0 { c / mean } else { 0.0 });
            }
        }
        let emission = Emission {
            radiance: rgb32(radiance, parameters, "L")?,
            power,
            two_sided: parameters.bool_or("twosided", false)?,
            image: image.map(|(image, _)| image),
        };
        parameters.accept(&["samples", "nsamples"]);
        self.check_unused(parameters, "area light \"diffuse\"")?;
        self.state.area_light = Some(AreaLight { emission, span });
        Ok(())
    }

    /// `LightSource`.
    pub(super) fn light(&mut self, kind: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        let light = match kind.text.as_str() {
            "infinite" | "exinfinite" => self.infinite(parameters, span)?,
            "point" => self.point(parameters, span)?,
            "spot" => self.spot(parameters, span)?,
            "distant" => self.distant(parameters, span)?,
            "goniometric" => self.goniometric(parameters, span)?,
            "projection" => self.projection(parameters, span)?,
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

    /// The parameter that names the image of a light: `filename`, of version 3 `mapname`.
    fn map_name(&mut self, parameters: &Parameters) -> Result<&'static str> {
        if let Some(parameter) = parameters.given("mapname").filter(|_| !self.dialect.is_surely_v4()) {
            self.dialect.saw_v3(parameter.span)?;
        }
        Ok(if self.dialect.is_v3() { "mapname" } else { "filename" })
    }

    /// Of pbrt-v4's lights with an image, this colour is not to be given.
    fn either_colour_or_image(&mut self, parameters: &Parameters, name: &'static str) -> Result<()> {
        match parameters.find(name) {
            Some(parameter) if !self.dialect.is_v3() => Err(Problem::at(
                parameter.span,
                format!("both \"{name}\" and \"filename\" say how the light shines"),
            )
            .label("expected one of them")),
            _ => Ok(()),
        }
    }

    fn infinite(&mut self, parameters: &Parameters, span: Span) -> Result<Light> {
        let name = self.map_name(parameters)?;
        let is_v3 = self.dialect.is_v3();
        let image = self.light_image(parameters, name)?;
        let portal = if is_v3 { None } else { self.portal(parameters)? };
        if image.is_some() {
            self.either_colour_or_image(parameters, "L")?;
        }
        let radiance = self.light_color(parameters, "L")?;
        let illuminance = self.positive(parameters, "illuminance")?;
        if image.is_none() && portal.is_none() {
            // Radiance L from all sides gives the irradiance pi L.
            let factor = illuminance.map_or(1.0, |illuminance| illuminance / PI);
            return Ok(Light::Infinite { radiance: rgb32(radiance.map(|c| c * factor), parameters, "L")? });
        }
        let (image, raster) = match image {
            Some(image) => image,
            None => self.white_image(),
        };
        let mapping = if is_v3 { SkyMapping::LatLong } else { SkyMapping::EqualArea };
        if !is_v3 {
            expect_square(parameters, name, &raster)?;
        }
        let factor = match illuminance {
            None => 1.0,
            Some(illuminance) => {
                let above = upper_illuminance(&raster, image.transfer);
                if above > 0.0 { illuminance / above } else { 1.0 }
            }
        };
        let matrix = self.static_ctm(span)?.matrix3;
        Ok(Light::EnvironmentMap {
            radiance: rgb32(radiance.map(|c| c * factor), parameters, "scale")?,
            image,
            mapping,
            light_from_world: direction_matrix(&matrix)
                .ok_or_else(|| singular(span, "an environment map"))?,
            portal,
        })
    }

    /// pbrt-v4's opening through which alone a sky is seen: a rectangle in the world, whatever the transform.
    fn portal(&mut self, parameters: &Parameters) -> Result<Option<[DVec3; 3]>> {
        let Some(parameter) = parameters.typed("portal", &[ParameterType::Point3])? else { return Ok(None) };
        let corners: Vec<DVec3> =
            parameter.numbers().as_chunks::<3>().0.iter().map(|p| DVec3::from_array(*p)).collect();
        let &[a, b, c, d] = corners.as_slice() else {
            return Err(parameter
                .problem(format!("a portal of {} corners", corners.len()))
                .label("expected four"));
        };
        let square = |x: DVec3, y: DVec3| x.dot(y).abs() <= 1e-3 * x.length() * y.length();
        let same = |x: DVec3, y: DVec3| (x - y).length() <= 1e-3 * x.length().max(y.length());
        let (across, up) = (d - a, b - a);
        let is_rectangle = same(across, c - b) && same(up, c - d) && square(across, up);
        let has_area = across.cross(up).length() > 0.0;
        if !is_rectangle || !has_area || !c.as_vec3().is_finite() {
            return Err(parameter
                .problem("the portal is no rectangle")
                .label("expected its corners in order"));
        }
        Ok(Some([a, across, up]))
    }

    /// Light through a picture, around +z of its space.
    fn projection(&mut self, parameters: &Parameters, span: Span) -> Result<Light> {
        let name = self.map_name(parameters)?;
        let is_v3 = self.dialect.is_v3();
        let Some((image, raster)) = self.light_image(parameters, name)? else {
            return Err(Problem::at(span, "a projection light without an image")
                .label(format!("expected \"string {name}\"")));
        };
        let fov = parameters.float_or("fov", if is_v3 { 45.0 } else { 90.0 })?;
        if !(fov > 0.0 && fov < 180.0) {
            return Err(parameters.bad("fov", &fov.to_string(), "expected degrees above 0 and below 180"));
        }
        let aspect = f64::from(raster.width()) / f64::from(raster.height());
        let half_size =
            [aspect.max(1.0), aspect.recip().max(1.0)].map(|x| x * (fov / 2.0).to_radians().tan());
        let factor = match self.positive(parameters, "power")? {
            None => 1.0,
            Some(power) => {
                let [a, b] = half_size;
                let (width, height) = (f64::from(raster.width()), f64::from(raster.height()));
                let integral = luminance_sum(&raster, image.transfer, |x, y| {
                    let at = |k: u32, n: f64, half: f64| ((f64::from(k) + 0.5) / n * 2.0 - 1.0) * half;
                    let (x, y) = (at(x, width, a), at(y, height, b));
                    4.0 * a * b / (width * height) * (1.0 + x * x + y * y).powf(-1.5)
                });
                if integral > 0.0 { power / integral } else { 1.0 }
            }
        };
        // pbrt-v4's has no colour but that of the image.
        let colour = if is_v3 { "I" } else { "scale" };
        let intensity = match is_v3 {
            true => self.light_color(parameters, "I")?,
            false => [parameters.non_negative_or("scale", 1.0)?; 3],
        };
        let matrix = self.static_ctm(span)?.matrix3;
        let mut light_from_world =
            direction_matrix(&matrix).ok_or_else(|| singular(span, "a projection light"))?;
        if !is_v3 {
            // Its picture stands upright, while pbrt-v3's upper edge is at -y.
            light_from_world = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)) * light_from_world;
        }
        Ok(Light::PicturePoint {
            intensity: rgb32(intensity.map(|c| c * factor), parameters, colour)?,
            position: self.world_point([0.0; 3], span)?,
            image,
            mapping: if is_v3 { PictureMapping::SmoothProjection } else { PictureMapping::Projection },
            light_from_world,
            half_size,
        })
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

    /// pbrt's light with a pattern. That of an image is around the y axis of its space; `"string pattern" "batwing"`, of
    /// this program alone, is built in, around the z axis.
    fn goniometric(&mut self, parameters: &Parameters, span: Span) -> Result<Light> {
        let name = self.map_name(parameters)?;
        if let Some((image, raster)) = self.light_image(parameters, name)? {
            return self.goniometric_image(parameters, span, name, image, &raster);
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
            None => {
                return Err(Problem::at(span, "a goniometric light without a pattern")
                    .label(format!("expected \"string {name}\", or \"string pattern\" \"batwing\"")));
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

    fn goniometric_image(
        &mut self,
        parameters: &Parameters,
        span: Span,
        name: &'static str,
        image: LightImage,
        raster: &Raster,
    ) -> Result<Light> {
        let is_v3 = self.dialect.is_v3();
        if !is_v3 {
            expect_square(parameters, name, raster)?;
        }
        let factor = match self.positive(parameters, "power")? {
            None => 1.0,
            Some(power) => {
                let colours = raster.colours(image.transfer);
                let sum: f64 = colours.iter().flatten().map(|&c| f64::from(c.max(0.0))).sum();
                let mean = sum / 3.0 / colours.len() as f64;
                if mean > 0.0 { power / (4.0 * PI * mean) } else { 1.0 }
            }
        };
        let intensity = self.light_color(parameters, "I")?.map(|c| c * factor);
        let matrix = self.static_ctm(span)?.matrix3;
        let light_from_world =
            direction_matrix(&matrix).ok_or_else(|| singular(span, "a goniometric light"))?;
        let swap = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::Y);
        Ok(Light::PicturePoint {
            intensity: rgb32(intensity, parameters, "I")?,
            position: self.world_point([0.0; 3], span)?,
            image,
            mapping: if is_v3 { PictureMapping::LatLong } else { PictureMapping::EqualArea },
            light_from_world: swap * light_from_world,
            half_size: [1.0; 2],
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

/// The sum over the pixels of their luminance, times a weight of their place.
fn luminance_sum(raster: &Raster, transfer: Transfer, weight: impl Fn(u32, u32) -> f64) -> f64 {
    let width = raster.width() as usize;
    let luminance = |[r, g, b]: [f32; 3]| {
        let [r, g, b] = [r, g, b].map(|c| f64::from(c.max(0.0)));
        LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b
    };
    let colours = raster.colours(transfer).into_iter().enumerate();
    colours.map(|(k, colour)| luminance(colour) * weight((k % width) as u32, (k / width) as u32)).sum()
}

/// What pbrt-v4 takes for the illuminance of a horizontal plane under an equal-area map: half of it. Its scenes are meant
/// so.
fn upper_illuminance(raster: &Raster, transfer: Transfer) -> f64 {
    let (width, height) = (f64::from(raster.width()), f64::from(raster.height()));
    luminance_sum(raster, transfer, |x, y| {
        let Vec3 { z, .. } =
            equal_area_to_sphere([(f64::from(x) + 0.5) / width, (f64::from(y) + 0.5) / height]);
        2.0 * PI / (width * height) * z.max(0.0)
    })
}

/// Equal-area maps are square; others are most likely by latitude and longitude.
fn expect_square(parameters: &Parameters, name: &'static str, raster: &Raster) -> Result<()> {
    let (width, height) = (raster.width(), raster.height());
    if width == height {
        return Ok(());
    }
    let place = parameters.find(name).map_or(Place::Scene, |p| p.place(0));
    Err(Problem::new(place, format!("the image has {width} x {height} pixels")).label(
        "expected as many columns as rows: a map of equal areas, which pbrt's \"imgtool makeequiarea\" makes of others",
    ))
}
