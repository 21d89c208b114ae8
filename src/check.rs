//! What in a scene is numerically dangerous, or probably a mistake.
//!
//! [`check`] looks at all of it; [`add_severe`] at what most likely makes the picture wrong, quickly: `wavepath render`
//! prints it. Where a shape was read from a file, a finding names its line.
//!
//! | finding | what it means |
//! |---|---|
//! | [`Kind::NotFinite`] | numbers that are none |
//! | [`Kind::Precision`] | few digits are left of something small and far away |
//! | [`Kind::Degenerate`], [`Kind::Sliver`], [`Kind::Duplicate`] | triangles without area, very long ones, the same twice |
//! | [`Kind::Albedo`] | a surface that reflects more than it gets |
//! | [`Kind::HiddenLight`] | a light inside of something opaque |
//! | [`Kind::OpenGlass`], [`Kind::InwardGlass`] | glass that encloses nothing, or whose outside is inside |
//! | [`Kind::InsideOut`] | a sphere that a mirroring transform turned |
//! | [`Kind::Brightness`] | a lamp a million times brighter than the others |
//!
//! ```
//! let text = r#"WorldBegin
//!        LightSource "point" "point3 from" [ 0 0 0 ]
//!        Shape "sphere""#;
//! let loaded = wavepath::pbrt::load_str(text, "example", std::path::Path::new("."))?;
//! // The camera is in the sphere, too: a room with its lamp.
//! assert!(wavepath::check::check("example", &loaded).findings.is_empty());
//! # Ok::<(), wavepath::pbrt::Error>(())
//! ```

use crate::pbrt::{Diagnostic, Loaded, Location, Severity};
use crate::scene::{Geometry, Light, Material, Mesh, Parameter, Shape, origin};
use glam::DVec3;
use serde::Serialize;
use std::cell::Cell;
use std::collections::HashMap;
use std::fmt;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Numbers that are NaN or infinite.
    NotFinite,
    /// Something small is so far away that single precision keeps few digits of it.
    Precision,
    /// Triangles without area.
    Degenerate,
    /// Triangles a million times as long as wide.
    Sliver,
    /// The same triangle more than once.
    Duplicate,
    /// Reflects more than it gets.
    Albedo,
    /// A light that something opaque encloses, while the camera is outside of it.
    HiddenLight,
    /// Glass whose surface has holes.
    OpenGlass,
    /// Glass whose normals point inwards.
    InwardGlass,
    /// A sphere of glass or a lamp whose normal a mirroring transform has turned.
    InsideOut,
    /// A lamp a million times brighter than the others of its sort.
    Brightness,
    /// What the reader warned about.
    Reader,
}

/// Something found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What sort of thing.
    pub kind: Kind,
    /// Does it most likely make the picture wrong?
    pub severe: bool,
    /// File of the shape.
    pub file: Option<String>,
    /// Its line, from 1.
    pub line: Option<u32>,
    /// What was found.
    pub message: String,
    /// What to do about it.
    pub hint: String,
}

impl Finding {
    /// As the reader's own warnings are.
    pub fn to_diagnostic(&self) -> Diagnostic {
        let location = self.file.as_ref().zip(self.line).map(|(file, line)| Location {
            file: file.clone(),
            line,
            column: 1,
            excerpt: None,
        });
        Diagnostic {
            severity: Severity::Warning,
            message: self.message.clone(),
            label: self.hint.clone(),
            location,
            notes: Vec::new(),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(if self.severe { "severe: " } else { "note: " })?;
        if let (Some(file), Some(line)) = (&self.file, self.line) {
            write!(f, "{file}:{line}: ")?;
        }
        f.write_str(&self.message)?;
        if self.hint.is_empty() { Ok(()) } else { write!(f, "\n      = {}", self.hint) }
    }
}

/// All that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name of the scene.
    pub scene: String,
    /// Decimal digits that single precision keeps of the shape that loses most, relative to its own size: 7 at the origin.
    pub digits_left: f64,
    /// Diagonal of the box around everything.
    pub extent: f64,
    /// The findings, severe ones first.
    pub findings: Vec<Finding>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for finding in &self.findings {
            writeln!(f, "{finding}")?;
        }
        let severe = self.findings.iter().filter(|finding| finding.severe).count();
        match self.findings.len() {
            0 => writeln!(f, "{}: nothing found", self.scene)?,
            n => writeln!(f, "{}: {severe} severe, {} notes", self.scene, n - severe)?,
        }
        write!(
            f,
            "{:.1} digits are left where most are lost; the scene is {:.3e} long",
            self.digits_left, self.extent
        )
    }
}

/// Decimal digits of single precision.
const DIGITS: f64 = 7.2;
/// With fewer digits, shading and shadows of a shape show steps.
const FEW_DIGITS: f64 = 3.0;
/// With fewer digits, its form does.
const LOST_DIGITS: f64 = 2.0;
/// Length over width from which a triangle is told.
const SLIVER: f64 = 1e6;
/// How much brighter than the others is a mistake in units.
const BRIGHTER: f64 = 1e6;
/// Triangles of a mesh that [`add_severe`] looks at one by one: more would be felt at each start.
const QUICK: usize = 100_000;
/// Triangles that it tests in all when it looks for what lies inside of meshes: some hundredths of a second.
const QUICK_TESTS: usize = 40 * QUICK;

/// Looks at everything.
pub fn check(name: &str, scene: &Loaded) -> Report {
    let mut search = Search::new(scene, usize::MAX);
    search.all();
    for warning in &scene.warnings {
        search.findings.push(Finding {
            kind: Kind::Reader,
            severe: false,
            file: warning.location.as_ref().map(|l| l.file.clone()),
            line: warning.location.as_ref().map(|l| l.line).filter(|&line| line > 0),
            message: warning.message.clone(),
            hint: warning.label.clone(),
        });
    }
    search.findings.sort_by_key(|finding| !finding.severe);
    Report {
        scene: name.to_string(),
        digits_left: search.digits_left,
        extent: search.extent,
        findings: search.findings,
    }
}

/// Adds what most likely makes the picture wrong to the warnings.
pub fn add_severe(scene: &mut Loaded) {
    let mut search = Search::new(scene, QUICK);
    search.all();
    let severe: Vec<_> =
        search.findings.iter().filter(|finding| finding.severe).map(Finding::to_diagnostic).collect();
    scene.warnings.extend(severe);
}

/// An axis-parallel box.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    const NONE: Bounds = Bounds { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    fn add(&mut self, p: DVec3) {
        self.low = self.low.min(p);
        self.high = self.high.max(p);
    }
    fn diagonal(&self) -> f64 {
        (self.high - self.low).length()
    }
    fn is_empty(&self) -> bool {
        self.low.x.is_nan() || self.high.x.is_nan() || self.low.x > self.high.x
    }
    fn contains(&self, other: &Bounds) -> bool {
        self.low.cmple(other.low).all() && self.high.cmpge(other.high).all()
    }
    /// The box of a scene's shape.
    fn of(shape: &Shape, meshes: &[Mesh]) -> Bounds {
        let mut bounds = Bounds::NONE;
        let (m, low, high) = match shape.geometry {
            Geometry::Mesh(id) => {
                let mesh = &meshes[id.0 as usize];
                for corner in mesh.triangles.iter().flatten() {
                    bounds.add(vertex(mesh, *corner));
                }
                return bounds;
            }
            Geometry::Sphere { world_from_object, radius, z_min, z_max, .. } => (
                world_from_object,
                DVec3::new(-radius, -radius, z_min.max(-radius)),
                DVec3::new(radius, radius, z_max.min(radius)),
            ),
            Geometry::Disk { world_from_object, height, radius, .. } => {
                (world_from_object, DVec3::new(-radius, -radius, height), DVec3::new(radius, radius, height))
            }
            Geometry::Cylinder { world_from_object, radius, z_min, z_max, .. } => {
                (world_from_object, DVec3::new(-radius, -radius, z_min), DVec3::new(radius, radius, z_max))
            }
        };
        for corner in 0..8 {
            let pick = |k: usize| if corner >> k & 1 == 0 { low[k] } else { high[k] };
            bounds.add(m.transform_point3(DVec3::new(pick(0), pick(1), pick(2))));
        }
        bounds
    }
}

fn vertex(mesh: &Mesh, index: u32) -> DVec3 {
    DVec3::from(mesh.positions[index as usize])
}

/// Bits of a vertex's position: vertices at one place are one vertex.
type Place = [u64; 3];

fn place(p: DVec3) -> Place {
    // 0 and -0 are one place.
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// Looking through a scene.
struct Search<'a> {
    scene: &'a Loaded,
    bounds: Vec<Bounds>,
    /// Meshes with more triangles are not looked at one triangle after the other.
    most: usize,
    /// Triangles that may still be tested for what lies inside of meshes.
    tests_left: Cell<usize>,
    digits_left: f64,
    extent: f64,
    findings: Vec<Finding>,
}

impl<'a> Search<'a> {
    fn new(scene: &'a Loaded, most: usize) -> Self {
        let description = &scene.scene;
        let bounds: Vec<Bounds> =
            description.shapes.iter().map(|shape| Bounds::of(shape, &description.meshes)).collect();
        let mut all = Bounds::NONE;
        for b in bounds.iter().filter(|b| !b.is_empty()) {
            all.add(b.low);
            all.add(b.high);
        }
        let extent = if all.is_empty() { 0.0 } else { all.diagonal() };
        let tests_left = Cell::new(if most == usize::MAX { usize::MAX } else { QUICK_TESTS });
        Search { scene, bounds, most, tests_left, digits_left: DIGITS, extent, findings: Vec::new() }
    }

    fn all(&mut self) {
        self.numbers();
        self.precision();
        self.triangles();
        self.albedos();
        self.hidden_lights();
        self.glass();
        self.inside_out();
        self.brightness();
    }

    fn shapes(&self) -> &'a [Shape] {
        &self.scene.scene.shapes
    }
    fn meshes(&self) -> &'a [Mesh] {
        &self.scene.scene.meshes
    }
    fn material(&self, shape: &Shape) -> &'a Material {
        &self.scene.scene.materials[shape.material.0 as usize]
    }
    /// The mesh of a shape, if it is one that is looked at.
    fn mesh(&self, shape: &Shape) -> Option<&'a Mesh> {
        match shape.geometry {
            Geometry::Mesh(id) => {
                Some(&self.meshes()[id.0 as usize]).filter(|m| m.triangles.len() <= self.most)
            }
            _ => None,
        }
    }

    fn found(&mut self, kind: Kind, severe: bool, shape: Option<usize>, message: String, hint: &str) {
        let place = shape.and_then(|number| self.scene.places.shape(number));
        let (file, line) = place.map(|(file, line)| (file.to_string(), line)).unzip();
        self.findings.push(Finding { kind, severe, file, line, message, hint: hint.into() });
    }

    fn numbers(&mut self) {
        for (number, shape) in self.shapes().iter().enumerate() {
            let finite = match shape.geometry {
                Geometry::Mesh(id) => {
                    let mesh = &self.meshes()[id.0 as usize];
                    let normals = mesh.normals.iter().flatten().all(|x| x.is_finite());
                    normals && mesh.positions.iter().flatten().all(|x| x.is_finite())
                }
                Geometry::Sphere { world_from_object, radius, .. }
                | Geometry::Disk { world_from_object, radius, .. }
                | Geometry::Cylinder { world_from_object, radius, .. } => {
                    world_from_object.is_finite() && radius.is_finite()
                }
            };
            let emission = shape.emission.is_none_or(|e| e.radiance.iter().all(|x| x.is_finite()));
            if !(finite && emission) {
                let what =
                    if finite { "emits what is no number" } else { "has coordinates that are no numbers" };
                self.found(
                    Kind::NotFinite,
                    true,
                    Some(number),
                    format!("this shape {what}"),
                    "what it touches will be black or missing: look at what wrote the file",
                );
            }
        }
    }

    /// Digits that are left of a shape: those of single precision, less those that its distance from the origin takes, in
    /// units of its size.
    fn precision(&mut self) {
        // Scenes far from the origin are moved before anything is rounded.
        let origin = origin::of(&self.scene.scene);
        let far_of =
            |bounds: &Bounds| (bounds.low - origin).abs().max((bounds.high - origin).abs()).max_element();
        let digits_of = |bounds: &Bounds| {
            let far = far_of(bounds);
            let size = bounds.diagonal();
            if size > 0.0 { DIGITS - (far / size).log10().max(0.0) } else { DIGITS }
        };
        let mut worst: Option<(usize, f64)> = None;
        let mut few = 0;
        for (number, bounds) in self.bounds.iter().enumerate() {
            if bounds.is_empty() || !bounds.diagonal().is_finite() {
                continue;
            }
            let digits = digits_of(bounds);
            few += usize::from(digits < FEW_DIGITS);
            if worst.is_none_or(|(_, least)| digits < least) {
                worst = Some((number, digits));
            }
        }
        let Some((number, digits)) = worst else { return };
        self.digits_left = digits.max(0.0);
        if digits < FEW_DIGITS {
            let bounds = self.bounds[number];
            let size = bounds.diagonal();
            let far = far_of(&bounds);
            let others = if few > 1 { format!("; {few} shapes have fewer than 3") } else { String::new() };
            self.found(
                Kind::Precision,
                digits < LOST_DIGITS,
                Some(number),
                format!(
                    "a shape {size:.1e} in size at {far:.1e}: {:.1} digits of its form are left{others}",
                    digits.max(0.0)
                ),
                "move the scene to the origin, or split it by size",
            );
        }
    }

    fn triangles(&mut self) {
        let mut seen: HashMap<[Place; 3], usize> = HashMap::new();
        let (mut duplicates, mut first_duplicate) = (0, None);
        for (number, shape) in self.shapes().iter().enumerate() {
            // Notes only: not for the quick look.
            let Some(mesh) = self.mesh(shape).filter(|_| self.most == usize::MAX) else { continue };
            let (mut degenerate, mut slivers, mut longest) = (0, 0, 0.0f64);
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.map(|index| vertex(mesh, index));
                let length = (b - a).length().max((c - b).length()).max((a - c).length());
                let height = (b - a).cross(c - a).length() / length;
                if height.is_nan() || height <= 0.0 {
                    degenerate += 1;
                } else if length / height > SLIVER {
                    slivers += 1;
                    longest = longest.max(length / height);
                }
                let mut corners = [a, b, c].map(place);
                corners.sort_unstable();
                if seen.insert(corners, number).is_some() {
                    duplicates += 1;
                    first_duplicate.get_or_insert(number);
                }
            }
            if degenerate > 0 {
                self.found(
                    Kind::Degenerate,
                    false,
                    Some(number),
                    format!("{degenerate} triangles without area"),
                    "they are not seen, but make the tree larger: remove them",
                );
            }
            if slivers > 0 {
                self.found(
                    Kind::Sliver,
                    false,
                    Some(number),
                    format!(
                        "{slivers} triangles more than a million times as long as wide, up to {longest:.1e}"
                    ),
                    "cut them into pieces",
                );
            }
        }
        if duplicates > 0 {
            self.found(
                Kind::Duplicate,
                false,
                first_duplicate,
                format!("{duplicates} triangles stand at the place of another; the first is here"),
                "of two, the one read first is seen; two lamps at one place shine twice on others: remove one",
            );
        }
    }

    fn albedos(&mut self) {
        // The first shape of each material.
        let mut first: HashMap<u32, usize> = HashMap::new();
        for (number, shape) in self.shapes().iter().enumerate() {
            first.entry(shape.material.0).or_insert(number);
        }
        let mut used: Vec<(u32, usize)> = first.into_iter().collect();
        used.sort_unstable();
        for (material, number) in used {
            // Textures are not looked at.
            let largest = |rgb: Parameter<[f32; 3]>| rgb.constant().map_or(0.0, |c| c[0].max(c[1]).max(c[2]));
            let most = match self.scene.scene.materials[material as usize] {
                Material::Diffuse { reflectance, .. } | Material::Mirror { reflectance } => {
                    largest(reflectance)
                }
                Material::DiffuseTransmission { reflectance, transmittance } => {
                    largest(reflectance) + largest(transmittance)
                }
                Material::Dielectric { reflectance, transmittance, .. } => {
                    largest(reflectance).max(largest(transmittance))
                }
                // Its parts are looked at by themselves, where shapes show them.
                Material::Mixture { .. } => 0.0,
                // Of a coat on a base, how much depends on the angle.
                Material::Conductor { .. }
                | Material::ThinDielectric { .. }
                | Material::Coated { .. }
                | Material::CoatedConductor { .. }
                | Material::Uber { .. } => 0.0,
            };
            if most > 1.0 {
                self.found(
                    Kind::Albedo,
                    true,
                    Some(number),
                    format!("the material of this shape reflects {most} of the light that it gets"),
                    "light between such surfaces grows with each bounce: expected at most 1",
                );
            }
        }
    }

    /// Is the point inside of the shape, if that encloses anything?
    fn encloses(&self, number: usize, p: DVec3) -> bool {
        let bounds = &self.bounds[number];
        if !bounds.contains(&Bounds { low: p, high: p }) {
            return false;
        }
        let shape = &self.shapes()[number];
        match shape.geometry {
            Geometry::Sphere { world_from_object, radius, z_min, z_max, phi_max } => {
                let whole = z_min <= -radius && z_max >= radius && phi_max >= 360.0;
                whole && world_from_object.inverse().transform_point3(p).length() < radius
            }
            Geometry::Mesh(_) => {
                let Some(mesh) = self.mesh(shape) else { return false };
                let Some(left) = self.tests_left.get().checked_sub(2 * mesh.triangles.len()) else {
                    return false;
                };
                self.tests_left.set(left);
                // Crossings of rays in two directions that are special to nothing: an open mesh seldom fools both.
                [DVec3::new(0.3527, 0.8113, 0.4663), DVec3::new(-0.7072, 0.1303, 0.6949)]
                    .iter()
                    .all(|&direction| crossings(mesh, p, direction) % 2 == 1)
            }
            Geometry::Disk { .. } | Geometry::Cylinder { .. } => false,
        }
    }

    fn hidden_lights(&mut self) {
        let description = &self.scene.scene;
        let camera = description.camera.world_from_camera.translation;
        let mut lights: Vec<(Option<usize>, DVec3, f64, &str)> = Vec::new();
        for light in &description.lights {
            match *light {
                Light::Point { position, .. } => lights.push((None, position, 0.0, "a point light")),
                Light::Spot { position, .. } => lights.push((None, position, 0.0, "a spot light")),
                Light::Goniometric { position, .. } => {
                    lights.push((None, position, 0.0, "a goniometric light"))
                }
                Light::PicturePoint { position, .. } => {
                    lights.push((None, position, 0.0, "a light with a picture"));
                }
                Light::Infinite { .. } | Light::EnvironmentMap { .. } | Light::Distant { .. } => {}
            }
        }
        for (number, shape) in self.shapes().iter().enumerate() {
            if shape.emission.is_some_and(|e| e.radiance != [0.0; 3]) && !self.bounds[number].is_empty() {
                let Bounds { low, high } = self.bounds[number];
                lights.push((Some(number), 0.5 * (low + high), 0.5 * (high - low).length(), "a lamp"));
            }
        }
        // Meshes of thousands of lamps are looked at by their first hundred.
        lights.truncate(100);
        for (own, position, size, what) in lights {
            let around = (0..self.shapes().len()).find(|&number| {
                let shape = &self.shapes()[number];
                let opaque =
                    matches!(self.material(shape), Material::Diffuse { .. } | Material::Conductor { .. });
                Some(number) != own
                    && opaque
                    && self.bounds[number].diagonal() > 2.0 * size
                    && self.encloses(number, position)
                    && !self.encloses(number, camera)
            });
            if let Some(number) = around {
                self.found(
                    Kind::HiddenLight,
                    true,
                    Some(number),
                    format!("{what} at {position:.4} is inside of this opaque shape, and the camera is not"),
                    "nothing of its light gets out: move it, or make the shape a lamp",
                );
            }
        }
    }

    fn glass(&mut self) {
        let materials = &self.scene.scene.materials;
        let is_glass =
            |shape: &Shape| matches!(materials[shape.material.0 as usize], Material::Dielectric { .. });
        // Glass may be made of several meshes: those of one material are one surface if each alone is open.
        let mut open: HashMap<u32, Vec<usize>> = HashMap::new();
        let mut inward = Vec::new();
        for (number, shape) in self.shapes().iter().enumerate() {
            let Some(mesh) = self.mesh(shape).filter(|_| is_glass(shape)) else { continue };
            match open_edges(&[mesh]) {
                0 => {
                    if volume(mesh) * if faces_outwards(mesh, shape) { 1.0 } else { -1.0 } < 0.0 {
                        inward.push(number);
                    }
                }
                _ => open.entry(shape.material.0).or_default().push(number),
            }
        }
        for number in inward {
            // A bubble in other glass is meant so.
            let bubble = (0..self.shapes().len()).any(|other| {
                other != number
                    && is_glass(&self.shapes()[other])
                    && self.bounds[other].contains(&self.bounds[number])
                    && self.bounds[other].diagonal() > self.bounds[number].diagonal()
            });
            if !bubble {
                self.found(
                    Kind::InwardGlass,
                    true,
                    Some(number),
                    "the normals of this glass point inwards: its inside is taken for its outside".into(),
                    "turn the triangles around, or write ReverseOrientation before the shape",
                );
            }
        }
        let mut open: Vec<_> = open.into_values().collect();
        open.sort_unstable();
        for numbers in open {
            let meshes: Vec<&Mesh> = numbers.iter().filter_map(|&n| self.mesh(&self.shapes()[n])).collect();
            let edges = open_edges(&meshes);
            if edges > 0 {
                self.found(
                    Kind::OpenGlass,
                    true,
                    numbers.first().copied(),
                    format!("glass whose surface is not closed: {edges} edges have no triangle on their other side"),
                    "light that enters does not leave: close it, or make it thindielectric",
                );
            }
        }
    }

    fn inside_out(&mut self) {
        for (number, shape) in self.shapes().iter().enumerate() {
            let Geometry::Sphere { world_from_object, .. } = shape.geometry else { continue };
            // ReverseOrientation and the mirror together would leave the normal outside.
            let mirrored = world_from_object.matrix3.determinant() < 0.0 && shape.flip_normal;
            let glass = matches!(self.material(shape), Material::Dielectric { .. });
            let lamp = shape.emission.is_some_and(|e| !e.two_sided);
            if mirrored && (glass || lamp) {
                let what = if lamp { "lamp shines inwards" } else { "glass has its outside inside" };
                self.found(
                    Kind::InsideOut,
                    true,
                    Some(number),
                    format!("a mirroring transform turns this sphere inside out: the {what}"),
                    "write ReverseOrientation before the shape, or mirror nothing",
                );
            }
        }
    }

    fn brightness(&mut self) {
        let brightness = |rgb: [f32; 3]| rgb.iter().map(|&x| f64::from(x)).sum::<f64>() / 3.0;
        let surfaces: Vec<(Option<usize>, f64)> = self
            .shapes()
            .iter()
            .enumerate()
            .filter_map(|(number, shape)| {
                let emission = shape.emission.filter(|e| e.power.is_none())?;
                Some((Some(number), brightness(emission.radiance)))
            })
            .collect();
        let of_lights = |pick: fn(&Light) -> bool| -> Vec<(Option<usize>, f64)> {
            let lights = self.scene.scene.lights.iter().filter(|light| pick(light));
            lights.map(|light| (None, brightness(light.colour()))).collect()
        };
        let points = of_lights(|light| {
            matches!(light, Light::Point { .. } | Light::Spot { .. } | Light::Goniometric { .. })
        });
        let distant = of_lights(|light| matches!(light, Light::Distant { .. }));
        for (what, mut lamps) in [
            ("a lamp of radiance", surfaces),
            ("a light of intensity", points),
            ("a distant light of", distant),
        ] {
            lamps.retain(|&(_, value)| value > 0.0);
            lamps.sort_by(|a, b| a.1.total_cmp(&b.1));
            let [rest @ .., (number, most)] = lamps.as_slice() else { continue };
            let Some(&(_, next)) = rest.last() else { continue };
            if *most >= BRIGHTER * next {
                self.found(
                    Kind::Brightness,
                    true,
                    *number,
                    format!("{what} {most:.3e}, a million times that of the next, {next:.3e}"),
                    "nothing of the others will be seen: look at the units",
                );
            }
        }
    }
}

/// How often a ray meets the triangles of a mesh, in double precision.
fn crossings(mesh: &Mesh, origin: DVec3, direction: DVec3) -> usize {
    let meets = |triangle: &&[u32; 3]| {
        let [a, b, c] = triangle.map(|index| vertex(mesh, index) - origin);
        let [u, v, w] = [direction.dot(b.cross(c)), direction.dot(c.cross(a)), direction.dot(a.cross(b))];
        let inside = u >= 0.0 && v >= 0.0 && w >= 0.0 || u <= 0.0 && v <= 0.0 && w <= 0.0;
        let normal = (b - a).cross(c - a);
        inside && normal.dot(a) / normal.dot(direction) > 0.0
    };
    mesh.triangles.iter().filter(meets).count()
}

/// Edges that do not have exactly one triangle in each direction.
fn open_edges(meshes: &[&Mesh]) -> usize {
    let mut edges: HashMap<(Place, Place), i32> = HashMap::new();
    for mesh in meshes {
        for triangle in &mesh.triangles {
            let corners = triangle.map(|index| place(vertex(mesh, index)));
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                let (edge, way) = if a < b { ((a, b), 1) } else { ((b, a), -1) };
                *edges.entry(edge).or_insert(0) += way;
            }
        }
    }
    edges.values().filter(|&&balance| balance != 0).count()
}

/// Volume that the triangles enclose, positive where their winding's normal points outwards.
fn volume(mesh: &Mesh) -> f64 {
    let about = mesh.positions.first().map_or(DVec3::ZERO, |_| vertex(mesh, mesh.triangles[0][0]));
    let of = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|index| vertex(mesh, index) - about);
        a.dot(b.cross(c)) / 6.0
    };
    mesh.triangles.iter().map(of).sum()
}

/// Is a mesh's normal on the side of its winding's?
fn faces_outwards(mesh: &Mesh, shape: &Shape) -> bool {
    if mesh.normals.is_empty() {
        return !shape.flip_normal;
    }
    // Vertex normals say which side is out, as in pbrt.
    let agrees = |triangle: &&[u32; 3]| {
        let [a, b, c] = triangle.map(|index| vertex(mesh, index));
        let n: DVec3 =
            triangle.iter().map(|&index| DVec3::from(mesh.normals[index as usize].map(f64::from))).sum();
        (b - a).cross(c - a).dot(n) >= 0.0
    };
    2 * mesh.triangles.iter().filter(agrees).count() >= mesh.triangles.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::text;

    /// The world of a scene with a camera at (0, 0, 10).
    fn found(world: &str) -> Report {
        // A sky at the end: without light the reader has something to say.
        let scene = format!(
            "LookAt 0 0 10  0 0 0  0 1 0\nCamera \"perspective\"\nWorldBegin\n{world}\nLightSource \"infinite\""
        );
        check("scene", &crate::pbrt::load_str(&scene, "scene", std::path::Path::new("")).unwrap())
    }
    fn kinds(world: &str) -> Vec<Kind> {
        found(world).findings.iter().map(|finding| finding.kind).collect()
    }
    const GLASS: &str = "Material \"dielectric\"";

    #[test]
    fn nothing_is_found_where_nothing_is_wrong() {
        let cube = text::cuboid([-1.0; 3], [1.0; 3]);
        let report = found(&format!("{GLASS}\n{cube}\nMaterial \"diffuse\"\n{}", text::floor(-2.0, 10.0)));
        assert_eq!(report.findings, []);
        assert!(report.digits_left > 6.5 && (report.extent - 28.4).abs() < 0.3, "{report}");
        assert!(report.to_string().contains("nothing found"));
    }

    #[test]
    fn precision() {
        let ball = |x: f64| format!("AttributeBegin\nTranslate {x} 0 0\nShape \"sphere\"\nAttributeEnd");
        let far = |x| found(&format!("{}\n{}", ball(0.0), ball(x)));
        assert_eq!(far(1e3).findings, []);
        let report = far(1e5);
        assert_eq!(report.findings.len(), 1, "{report}");
        assert!(!report.findings[0].severe && (report.digits_left - 2.7).abs() < 0.3, "{report}");
        // Third line of the world, the first being the scene's fourth.
        assert_eq!(report.findings[0].line, Some(10));
        assert!(far(1e7).findings[0].severe);
    }

    #[test]
    fn triangles() {
        let mesh = |indices: &[[usize; 3]]| {
            text::mesh(
                &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 1e-9, 0.0], [1.0, 1.0, 0.0]],
                indices,
            )
        };
        assert_eq!(kinds(&mesh(&[[0, 1, 2], [1, 4, 2]])), []);
        assert_eq!(kinds(&mesh(&[[0, 1, 2], [0, 1, 3]])), [Kind::Sliver]);
        let report = found(&format!("{}\n{}", mesh(&[[0, 1, 2]]), mesh(&[[1, 4, 2], [2, 0, 1], [2, 1, 0]])));
        assert_eq!(report.findings.len(), 1);
        assert_eq!((report.findings[0].kind, report.findings[0].line), (Kind::Duplicate, Some(5)));
        assert!(report.findings[0].message.starts_with("2 triangles"), "{report}");
        // The reader leaves these out, and says so.
        assert_eq!(kinds(&mesh(&[[0, 1, 2], [0, 1, 1]])), [Kind::Reader]);
    }

    #[test]
    fn described_in_code() {
        let text = "WorldBegin\nShape \"sphere\"\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]\nLightSource \"infinite\"";
        let mut loaded = crate::pbrt::load_str(text, "scene", std::path::Path::new("")).unwrap();
        loaded.places = Default::default();
        loaded.scene.meshes[0].triangles.push([0, 1, 1]);
        loaded.scene.materials[0] =
            Material::Diffuse { reflectance: [0.5, 1.5, 0.5].into(), sigma: 0.0.into() };
        let report = check("code", &loaded);
        let kinds: Vec<Kind> = report.findings.iter().map(|finding| finding.kind).collect();
        assert_eq!(kinds, [Kind::Albedo, Kind::Degenerate]);
        assert!(report.findings.iter().all(|finding| finding.line.is_none()));
        add_severe(&mut loaded);
        assert_eq!(loaded.warnings.len(), 1);
        assert!(
            loaded.warnings[0].to_string().starts_with("warning: the material"),
            "{}",
            loaded.warnings[0]
        );
        loaded.scene.meshes[0].normals = vec![[f32::NAN; 3]; 3];
        assert_eq!(check("code", &loaded).findings[0].kind, Kind::NotFinite);
    }

    #[test]
    fn albedo_above_one() {
        // The reader clamps it and says so.
        let report = found("Material \"diffuse\" \"rgb reflectance\" [1.5 1 1]\nShape \"sphere\"");
        assert_eq!(report.findings[0].kind, Kind::Reader);
        assert_eq!((report.findings[0].line, report.findings.len()), (Some(4), 1));
    }

    #[test]
    fn lights_inside_of_what_is_opaque() {
        let point = "LightSource \"point\" \"point3 from\" [0.1 0.2 0.3]";
        assert_eq!(kinds(&format!("{point}\nShape \"sphere\"")), [Kind::HiddenLight]);
        let cube = text::cuboid([-1.0; 3], [1.0; 3]);
        assert_eq!(kinds(&format!("{point}\n{cube}")), [Kind::HiddenLight]);
        assert_eq!(kinds(&format!("{point}\n{}", text::cuboid([0.5; 3], [1.0; 3]))), []);
        // Glass lets it out; a room has the camera in it.
        assert_eq!(kinds(&format!("{point}\n{GLASS}\nShape \"sphere\"")), []);
        assert_eq!(kinds(&format!("{point}\n{}", text::cuboid([-20.0; 3], [20.0; 3]))), []);
        let lamp = "AttributeBegin\nAreaLightSource \"diffuse\"\nShape \"sphere\" \"float radius\" 0.5\nAttributeEnd";
        assert_eq!(kinds(&format!("{lamp}\n{cube}")), [Kind::HiddenLight]);
        assert_eq!(kinds(lamp), []);
    }

    #[test]
    fn glass() {
        let corners: Vec<text::Point> =
            (0..8).map(|i| [i >> 2 & 1, i >> 1 & 1, i & 1].map(|b| f64::from(b) * 2.0 - 1.0)).collect();
        let open = text::mesh(&corners, &text::CUBOID[1..]);
        let rest = text::mesh(&corners, &text::CUBOID[..1]);
        let turned = text::mesh(&corners, &text::CUBOID.map(|[a, b, c]| [a, c, b]));
        let cube = text::cuboid([-1.0; 3], [1.0; 3]);
        let report = found(&format!("{GLASS}\n{open}"));
        assert_eq!((report.findings[0].kind, report.findings[0].line), (Kind::OpenGlass, Some(5)));
        assert!(report.findings[0].message.contains("3 edges"), "{report}");
        assert_eq!(kinds(&format!("{GLASS}\n{open}\n{rest}")), [], "closed by another mesh");
        assert_eq!(kinds(&format!("{GLASS}\n{turned}")), [Kind::InwardGlass]);
        assert_eq!(kinds(&format!("{GLASS}\nReverseOrientation\n{turned}")), []);
        assert_eq!(kinds(&format!("{GLASS}\nReverseOrientation\n{cube}")), [Kind::InwardGlass]);
        let around = text::cuboid([-2.0; 3], [2.0; 3]);
        assert_eq!(kinds(&format!("{GLASS}\n{around}\n{turned}")), [], "a bubble");
        // What is no glass may be open.
        assert_eq!(kinds(&open), []);
    }

    #[test]
    fn spheres_inside_out() {
        let mirrored = format!("Scale -1 1 1\n{GLASS}\nShape \"sphere\"");
        let report = found(&mirrored);
        assert_eq!((report.findings[0].kind, report.findings[0].line), (Kind::InsideOut, Some(6)));
        assert_eq!(kinds(&mirrored.replace("Scale", "ReverseOrientation\nScale")), []);
        assert_eq!(kinds("Scale -1 1 1\nShape \"sphere\""), [], "diffuse ones look the same");
        assert_eq!(kinds("Scale -1 1 1\nAreaLightSource \"diffuse\"\nShape \"sphere\""), [Kind::InsideOut]);
    }

    #[test]
    fn units() {
        let lamp = |l: f64, x: f64| {
            format!(
                "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [{l} {l} {l}]\nTranslate {x} 0 0\nShape \"sphere\"\nAttributeEnd\n"
            )
        };
        let report = found(&(lamp(1.0, -5.0) + &lamp(2.0, 0.0) + &lamp(3e6, 5.0)));
        assert_eq!((report.findings[0].kind, report.findings[0].line), (Kind::Brightness, Some(17)));
        assert_eq!(kinds(&(lamp(1.0, -5.0) + &lamp(2.0, 0.0) + &lamp(1e5, 5.0))), []);
        let point = |i: f64| format!("LightSource \"point\" \"rgb I\" [{i} {i} {i}]\n");
        assert_eq!(kinds(&(point(1.0) + &point(1e7))), [Kind::Brightness]);
        // A lamp is not compared with a sun.
        assert_eq!(kinds(&(point(1e7) + &lamp(1.0, 9.0))), []);
    }
}
