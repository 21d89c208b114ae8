//! Camera, film, filter, sampler and integrator: what stands before `WorldBegin`.

use crate::pbrt::error::{Problem, Result, Span};
use crate::pbrt::lexer::shorten;
use crate::pbrt::parameters::{Parameter, ParameterType, Parameters, Values};
use crate::pbrt::parser::{Name, TransformOp};
use crate::pbrt::transform::invertible;
use crate::scene::{Camera, CameraKind, Film, Filter, Pose, Sampler, SamplerKind, SkyMapping};
use glam::{DAffine3, DVec3};
use wavepath_kernels::queue::MAX_DEPTH;

use super::{Builder, singular, unknown_kind, unsupported_kind};

/// Largest side of an image.
const MAX_SIDE: i32 = 65_536;

/// Most pixels of an image.
const MAX_PIXELS: u64 = 1 << 28;

/// Largest radius of a filter, in pixels.
const MAX_RADIUS: f64 = 1000.0;

/// What options leave behind for later decisions.
pub(super) struct Options {
    pub filter: Option<Filter>,
    /// v3's integrators crop as well: `[x0, x1, y0, y1]`.
    pub integrator_bounds: Option<([i64; 4], Span)>,
    /// Factor on all light.
    pub exposure: f64,
    seed: Option<u64>,
    /// What the camera looks at.
    pub aim: Aim,
    /// Where the camera is put from outside of the files.
    pub pose: Option<(Pose, Span)>,
    /// How long the shutter is open, where that counts.
    pub shutter_seconds: f64,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            filter: None,
            integrator_bounds: None,
            exposure: 1.0,
            seed: None,
            aim: Aim::default(),
            pose: None,
            shutter_seconds: 1.0,
        }
    }
}

/// What the last `LookAt` before the camera says beside the direction, in camera space, where later transforms do not
/// move it.
#[derive(Clone, Copy, Default)]
pub(super) struct Aim {
    target: Option<DVec3>,
    up: Option<DVec3>,
}

impl Aim {
    /// After a transform, with the present one.
    pub(super) fn follow(&mut self, op: &TransformOp, ctm: &DAffine3) {
        match op {
            TransformOp::LookAt([_, _, _, look @ .., ux, uy, uz]) => {
                self.target = Some(ctm.transform_point3(DVec3::from_array(*look)));
                self.up = Some(ctm.transform_vector3(DVec3::new(*ux, *uy, *uz)));
            }
            TransformOp::Transform(_) => *self = Aim::default(),
            _ => {}
        }
    }
}

impl Builder {
    pub(super) fn camera(&mut self, name: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        const KNOWN: [&str; 3] = ["perspective", "orthographic", "spherical"];
        let kind = match name.text.as_str() {
            "perspective" => CameraKind::Perspective,
            "orthographic" => CameraKind::Orthographic,
            "spherical" => match parameters.string("mapping")?.unwrap_or("equalarea") {
                "equalarea" => CameraKind::Spherical(SkyMapping::EqualArea),
                "equirectangular" => CameraKind::Spherical(SkyMapping::LatLong),
                other => {
                    let found = format!("\"{}\"", shorten(other));
                    let expected = "expected \"equalarea\" or \"equirectangular\"";
                    return Err(parameters.bad("mapping", &found, expected));
                }
            },
            "environment" => {
                self.dialect.saw_v3(name.span)?;
                CameraKind::Spherical(SkyMapping::LatLong)
            }
            "realistic" => {
                let problem = unsupported_kind("camera", name, &KNOWN)
                    .lacking("a perspective camera at the same place");
                self.pending.push(*problem);
                parameters.accept_all();
                CameraKind::Perspective
            }
            _ => return Err(unknown_kind("camera", name, &KNOWN)),
        };
        self.check_vacuum();
        let camera_from_world = self.static_ctm(span)?;
        if invertible(camera_from_world).is_none() {
            return Err(singular(span, "the camera"));
        }
        let mut world_from_camera = camera_from_world.inverse();
        if let Some((pose, span)) = &self.options.pose {
            let Aim { target, up } = self.options.aim;
            let target = target.map(|target| world_from_camera.transform_point3(target));
            let up = up.map(|up| world_from_camera.transform_vector3(up));
            world_from_camera = pose
                .of(world_from_camera, target, up)
                .map_err(|expected| Problem::at(*span, "the camera cannot be put there").label(expected))?;
        }
        if !world_from_camera.translation.as_vec3().is_finite() {
            return Err(
                Problem::at(span, "the camera is too far away").label("expected coordinates below 3e38")
            );
        }
        self.coordinate_systems.insert("camera".into(), [world_from_camera; 2]);
        self.scene.camera = Camera {
            kind,
            world_from_camera,
            fov: self.field_of_view(parameters)?,
            screen_window: screen_window(parameters)?,
            frame_aspect_ratio: match parameters.find("frameaspectratio") {
                Some(_) => Some(parameters.positive_or("frameaspectratio", 1.0)?),
                None => None,
            },
            lens_radius: parameters.non_negative_or("lensradius", 0.0)?,
            focal_distance: parameters.positive_or("focaldistance", 1e6)?,
        };
        // Nothing moves; but v4's film counts the energy that arrives while the shutter is open.
        let [open, close] =
            [parameters.float_or("shutteropen", 0.0)?, parameters.float_or("shutterclose", 1.0)?];
        self.options.shutter_seconds = 1.0;
        if close - open != 1.0 && !self.dialect.is_v3() {
            if close <= open {
                let found = format!("{close}, and the shutter opens at {open}");
                return self.mistake(parameters.bad("shutterclose", &found, "expected a later time"));
            }
            self.options.shutter_seconds = close - open;
        }
        self.check_unused(parameters, &format!("camera \"{}\"", name.text))
    }

    fn field_of_view(&mut self, parameters: &Parameters) -> Result<f64> {
        let mut fov = parameters.float_or("fov", 90.0)?;
        let mut name = "fov";
        if let Some(half) = parameters.float("halffov")? {
            (fov, name) = (2.0 * half, "halffov");
        }
        if fov > 0.0 && fov < 180.0 {
            return Ok(fov);
        }
        let limit = if name == "fov" { 180 } else { 90 };
        Err(parameters.bad(name, &fov.to_string(), format!("expected degrees between 0 and {limit}")))
    }

    pub(super) fn film(&mut self, name: &Name, parameters: &Parameters) -> Result<()> {
        match name.text.as_str() {
            "rgb" => self.dialect.saw_v4(),
            "gbuffer" => {
                self.dialect.saw_v4();
                self.warn(
                    Problem::at(name.span, "film \"gbuffer\" is rendered as \"rgb\"")
                        .label("the picture is the same, the other channels are not written"),
                );
            }
            "image" => self.dialect.saw_v3(name.span)?,
            "spectral" => {
                self.dialect.saw_v4();
                self.pending.push(*unsupported_kind("film", name, &["rgb"]).lacking("film \"rgb\""));
                parameters.accept(&["nbuckets", "lambdamin", "lambdamax"]);
            }
            _ => return Err(unknown_kind("film", name, &["rgb", "gbuffer", "image"])),
        }
        let resolution = resolution(parameters)?;
        self.scene.film = Film {
            resolution,
            pixel_bounds: self.pixel_bounds(parameters, resolution)?,
            filename: parameters.string("filename")?.map(str::to_string),
            half: parameters.bool_or("savefp16", false)?,
        };
        self.exposure(parameters)?;
        for limit in ["maxcomponentvalue", "maxsampleluminance"] {
            if parameters.float(limit)?.is_some_and(|value| value < 1e30) {
                self.warn(parameters.bad(
                    limit,
                    "ignored",
                    "samples are not clamped: the picture is right, but noisier",
                ));
            }
        }
        // Sizes in millimetres matter to realistic cameras only.
        parameters.accept(&["diagonal", "coordinatesystem"]);
        self.check_unused(parameters, &format!("film \"{}\"", name.text))
    }

    /// v3's `scale` and v4's `exposuretime * iso / 100` scale the picture.
    fn exposure(&mut self, parameters: &Parameters) -> Result<()> {
        if let Some(sensor) = parameters.string("sensor")?.filter(|sensor| *sensor != "cie1931") {
            let label = "expected \"cie1931\": other sensors are not supported";
            self.pending.push(*parameters.bad("sensor", sensor, label).lacking("the sensor \"cie1931\""));
        }
        let white = parameters.float_or("whitebalance", 0.0)?;
        if white != 0.0 {
            let label = "expected 0: white balance is not supported";
            let problem = parameters.bad("whitebalance", &white.to_string(), label);
            self.pending.push(*problem.lacking("colours as they are"));
        }
        self.options.exposure = parameters.positive_or("scale", 1.0)?
            * parameters.positive_or("iso", 100.0)?
            * parameters.positive_or("exposuretime", 1.0)?
            / 100.0;
        Ok(())
    }

    fn pixel_bounds(&mut self, parameters: &Parameters, [width, height]: [u32; 2]) -> Result<[u32; 4]> {
        let full = [0, i64::from(width), 0, i64::from(height)];
        let mut bounds = full;
        let mut name = "pixelbounds";
        if let Some(asked) = four_integers(parameters, "pixelbounds")? {
            bounds = intersect(full, asked);
        }
        if let Some(crop) = parameters.floats("cropwindow")? {
            let &[x0, x1, y0, y1] = crop else {
                return Err(parameters.bad("cropwindow", "not four numbers", "expected x0 x1 y0 y1"));
            };
            if parameters.find("pixelbounds").is_some() {
                self.warn(parameters.bad(
                    "pixelbounds",
                    "ignored",
                    "\"cropwindow\" is given as well and wins",
                ));
            }
            name = "cropwindow";
            // pbrt: ceil(resolution * crop) on both ends, so that neighbouring crops share no pixel.
            let at = |size: u32, t: f64| (f64::from(size) * t.clamp(0.0, 1.0)).ceil() as i64;
            bounds = intersect(
                full,
                [
                    at(width, x0.min(x1)),
                    at(width, x0.max(x1)),
                    at(height, y0.min(y1)),
                    at(height, y0.max(y1)),
                ],
            );
        }
        if bounds[0] >= bounds[1] || bounds[2] >= bounds[3] {
            return Err(parameters.bad(name, "empty", "expected at least one pixel of the image"));
        }
        Ok(bounds.map(|b| b as u32))
    }

    pub(super) fn pixel_filter(&mut self, name: &Name, parameters: &Parameters) -> Result<()> {
        const KNOWN: [&str; 4] = ["box", "gaussian", "triangle", "mitchell"];
        let filter = match name.text.as_str() {
            "box" => Filter::Box { radius: self.radius(parameters, 0.5)? },
            "triangle" => Filter::Triangle { radius: self.radius(parameters, 2.0)? },
            "gaussian" => self.gaussian(parameters)?,
            "mitchell" => Filter::Mitchell {
                radius: self.radius(parameters, 2.0)?,
                b: parameters.float_or("B", 1.0 / 3.0)?,
                c: parameters.float_or("C", 1.0 / 3.0)?,
            },
            "sinc" => return Err(unsupported_kind("filter", name, &KNOWN).lacking("the default filter")),
            _ => return Err(unknown_kind("filter", name, &KNOWN)),
        };
        self.options.filter = Some(filter);
        self.check_unused(parameters, &format!("filter \"{}\"", name.text))
    }

    fn gaussian(&mut self, parameters: &Parameters) -> Result<Filter> {
        // v3 writes exp(-alpha x^2), v4 exp(-x^2 / (2 sigma^2)).
        if let Some(alpha) = parameters.find("alpha") {
            let span = alpha.span;
            self.dialect.saw_v3(span)?;
            let alpha = parameters.positive_or("alpha", 2.0)?;
            return Ok(Filter::Gaussian {
                radius: self.radius(parameters, 2.0)?,
                sigma: (2.0 * alpha).sqrt().recip(),
            });
        }
        let names_v3 = parameters.find("xwidth").is_some() || parameters.find("ywidth").is_some();
        let v3 = parameters.find("sigma").is_none() && (names_v3 || self.dialect.is_v3());
        let (radius, sigma) = if v3 { (2.0, 0.5) } else { (1.5, 0.5) };
        Ok(Filter::Gaussian {
            radius: self.radius(parameters, radius)?,
            sigma: parameters.positive_or("sigma", sigma)?,
        })
    }

    fn radius(&mut self, parameters: &Parameters, default: f64) -> Result<[f64; 2]> {
        let mut radius = [default; 2];
        for (r, (v4, v3)) in radius.iter_mut().zip([("xradius", "xwidth"), ("yradius", "ywidth")]) {
            let name = match parameters.find(v3) {
                Some(parameter) => {
                    self.dialect.saw_v3(parameter.span)?;
                    v3
                }
                None => v4,
            };
            *r = parameters.positive_or(name, default)?;
            if *r > MAX_RADIUS {
                return Err(parameters.bad(
                    name,
                    &r.to_string(),
                    format!("expected at most {MAX_RADIUS} pixels"),
                ));
            }
        }
        Ok(radius)
    }

    pub(super) fn sampler(&mut self, name: &Name, parameters: &Parameters) -> Result<()> {
        const KNOWN: [&str; 8] =
            ["zsobol", "sobol", "paddedsobol", "halton", "pmj02bn", "stratified", "independent", "random"];
        if matches!(name.text.as_str(), "random" | "02sequence" | "lowdiscrepancy" | "maxmindist") {
            self.dialect.saw_v3(name.span)?;
        }
        let (kind, default) = match name.text.as_str() {
            "independent" | "random" => (SamplerKind::Independent, 4),
            "zsobol" | "sobol" | "paddedsobol" | "halton" | "pmj02bn" | "stratified" | "02sequence"
            | "lowdiscrepancy" | "maxmindist" => (SamplerKind::Sobol, 16),
            _ => return Err(unknown_kind("sampler", name, &KNOWN)),
        };
        let pixel_samples = if name.text == "stratified" {
            let (x, y) = (parameters.count_or("xsamples", 4)?, parameters.count_or("ysamples", 4)?);
            x.checked_mul(y)
                .ok_or_else(|| parameters.bad("xsamples", "too large", "expected fewer samples"))?
        } else {
            parameters.count_or("pixelsamples", default)?
        };
        let seed = parameters.integer("seed")?.map(|seed| u64::from(seed as u32));
        self.scene.sampler = Sampler { kind, pixel_samples, seed: seed.or(self.options.seed).unwrap_or(0) };
        parameters.accept(&["randomization", "dimensions", "jitter", "samplepixelcenter"]);
        self.check_unused(parameters, &format!("sampler \"{}\"", name.text))
    }

    pub(super) fn integrator(&mut self, name: &Name, parameters: &Parameters) -> Result<()> {
        const KNOWN: [&str; 2] = ["path", "volpath"];
        match name.text.as_str() {
            "path" | "volpath" => {}
            "simplepath" | "simplevolpath" | "lightpath" | "bdpt" | "mlt" | "sppm" => {
                self.warn(
                    Problem::at(name.span, format!("integrator \"{}\" is rendered as \"path\"", name.text))
                        .label("both converge to the same picture"),
                );
                // Their other parameters steer methods that are not used.
                parameters.accept_all();
            }
            "directlighting" | "whitted" => {
                self.warn(
                    Problem::at(name.span, format!("integrator \"{}\" is rendered as \"path\"", name.text))
                        .label("which adds the light that comes by way of several surfaces"),
                );
                parameters.accept_all();
            }
            "ambientocclusion" | "ao" | "randomwalk" | "function" => {
                let problem = unsupported_kind("integrator", name, &KNOWN).lacking("integrator \"path\"");
                self.pending.push(*problem);
                parameters.accept_all();
            }
            _ => return Err(unknown_kind("integrator", name, &KNOWN)),
        }
        match parameters.integer("maxdepth")? {
            None => {}
            Some(depth) if depth >= 0 => {
                self.scene.max_depth = (depth as u32).min(MAX_DEPTH);
                if depth as u32 > MAX_DEPTH {
                    let expected = format!("paths end after {MAX_DEPTH} bounces");
                    self.warn(parameters.bad("maxdepth", &depth.to_string(), &expected));
                }
            }
            Some(depth) => {
                return Err(parameters.bad("maxdepth", &depth.to_string(), "expected at least 0"));
            }
        }
        if parameters.bool_or("regularize", false)? {
            self.warn(parameters.bad("regularize", "ignored", "caustics are not blurred"));
        }
        if let Some(bounds) = four_integers(parameters, "pixelbounds")? {
            let span = parameters.find("pixelbounds").map_or(name.span, |p| p.values_span);
            self.options.integrator_bounds = Some((bounds, span));
        }
        // How fast it converges, not to what.
        parameters.accept(&["lightsampler", "lightsamplestrategy", "rrthreshold"]);
        self.check_unused(parameters, &format!("integrator \"{}\"", name.text))
    }

    /// `Option`: switches of pbrt. Those that change the picture are worth a warning.
    pub(super) fn option(&mut self, option: &Parameter) -> Result<()> {
        const SILENT: [&str; 5] =
            ["rendercoordsys", "msereferenceimage", "msereferenceout", "pixelstats", "wavefront"];
        const LOUD: [&str; 5] = [
            "disablepixeljitter",
            "disabletexturefiltering",
            "disablewavelengthjitter",
            "displacementedgescale",
            "forcediffuse",
        ];
        match option.name.as_str() {
            "seed" => {
                let seed = match &option.values {
                    Values::Integers(values) => values.first().copied().map(f64::from),
                    Values::Numbers(values) => values.first().copied(),
                    _ => None,
                };
                let Some(seed) = seed else {
                    return Err(option.problem("not a number").label("expected an integer"));
                };
                self.options.seed = Some(u64::from(seed as i32 as u32));
                self.scene.sampler.seed = self.options.seed.unwrap_or(0);
                Ok(())
            }
            name if SILENT.contains(&name) => Ok(()),
            name if LOUD.contains(&name) => {
                let off = option.values == Values::Bools(vec![false]);
                if !off {
                    self.warn(Problem::at(option.span, format!("option \"{name}\" is ignored")));
                }
                Ok(())
            }
            _ => {
                let known: Vec<&str> = ["seed"].into_iter().chain(SILENT).chain(LOUD).collect();
                let name = Name { text: option.name.clone(), span: option.span };
                Err(unknown_kind("option", &name, &known))
            }
        }
    }

    /// Puts together what several options decide.
    pub(super) fn finish_options(&mut self) -> Result<()> {
        let Some((bounds, span)) = self.options.integrator_bounds else {
            return Ok(());
        };
        let bounds = intersect(self.scene.film.pixel_bounds.map(i64::from), bounds);
        if bounds[0] >= bounds[1] || bounds[2] >= bounds[3] {
            return Err(Problem::at(span, "no pixel of the image is inside these bounds"));
        }
        self.scene.film.pixel_bounds = bounds.map(|b| b as u32);
        Ok(())
    }
}

fn resolution(parameters: &Parameters) -> Result<[u32; 2]> {
    let mut resolution = [1280, 720];
    for (side, name) in resolution.iter_mut().zip(["xresolution", "yresolution"]) {
        if let Some(pixels) = parameters.integer(name)? {
            if !(1..=MAX_SIDE).contains(&pixels) {
                return Err(parameters.bad(
                    name,
                    &pixels.to_string(),
                    format!("expected 1 to {MAX_SIDE} pixels"),
                ));
            }
            *side = pixels as u32;
        }
    }
    if u64::from(resolution[0]) * u64::from(resolution[1]) > MAX_PIXELS {
        let [x, y] = resolution;
        return Err(parameters.bad(
            "xresolution",
            &format!("{x}, for {x} x {y} pixels"),
            format!("expected at most {MAX_PIXELS} pixels"),
        ));
    }
    Ok(resolution)
}

fn screen_window(parameters: &Parameters) -> Result<Option<[f64; 4]>> {
    let Some(window) = parameters.floats("screenwindow")? else {
        return Ok(None);
    };
    match *window {
        [x0, x1, y0, y1] if x0 < x1 && y0 < y1 => Ok(Some([x0, x1, y0, y1])),
        _ => Err(parameters.bad(
            "screenwindow",
            "not a window",
            "expected x0 x1 y0 y1 with x0 < x1 and y0 < y1",
        )),
    }
}

fn four_integers(parameters: &Parameters, name: &'static str) -> Result<Option<[i64; 4]>> {
    let Some(parameter) = parameters.typed(name, &[ParameterType::Integer])? else {
        return Ok(None);
    };
    match &parameter.values {
        Values::Integers(values) if values.len() == 4 => {
            Ok(Some([values[0], values[1], values[2], values[3]].map(i64::from)))
        }
        _ => Err(parameters.bad(name, "not four integers", "expected x0 x1 y0 y1")),
    }
}

fn intersect(a: [i64; 4], b: [i64; 4]) -> [i64; 4] {
    [a[0].max(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].min(b[3])]
}
