//! Shapes: read in object space, then placed into the world.

use std::path::Path;
use std::rc::Rc;

use glam::{DAffine3, DVec3};

use crate::memory;
use crate::pbrt::error::{Place, Problem, Result, Span};
use crate::pbrt::parameters::{ParameterType, Parameters};
use crate::pbrt::parser::Name;
use crate::pbrt::ply;
use crate::pbrt::polygon;
use crate::pbrt::subdivision;
use crate::pbrt::transform::{invertible, normal_matrix, swaps_handedness};
use crate::scene::{Emission, Geometry, MaterialId, Mesh, MeshId, Opacity, Parameter, Shape};

use super::textures::widen;

use super::{Builder, Dropped, unknown_kind, unsupported_kind};

const KNOWN: [&str; 7] =
    ["sphere", "disk", "cylinder", "trianglemesh", "plymesh", "bilinearmesh", "loopsubdiv"];

const UNSUPPORTED: [&str; 7] =
    ["cone", "curve", "paraboloid", "hyperboloid", "heightfield", "heightfield2", "nurbs"];

/// Most triangles of a scene: their handles are 32 bits, one of which is wanted for other ends.
const MAX_TRIANGLES: u64 = (1 << 31) - 1;

/// A mesh as the file has it.
#[derive(Debug, Default)]
pub(super) struct SourceMesh {
    positions: Vec<[f64; 3]>,
    normals: Vec<[f64; 3]>,
    uvs: Vec<[f64; 2]>,
    triangles: Vec<[u32; 3]>,
}

/// The form of a shape in object space.
#[derive(Clone, Debug)]
enum Source {
    Mesh(Rc<SourceMesh>),
    Sphere { radius: f64, z_min: f64, z_max: f64, phi_max: f64 },
    Disk { height: f64, radius: f64, inner_radius: f64, phi_max: f64 },
    Cylinder { radius: f64, z_min: f64, z_max: f64, phi_max: f64 },
}

/// A shape with everything that the state gave it.
#[derive(Debug)]
pub(super) struct PlacedShape {
    source: Source,
    transform: DAffine3,
    reverse_orientation: bool,
    material: MaterialId,
    emission: Option<Emission>,
    opacity: Option<Opacity>,
    visible: bool,
}

/// What the scene has taken so far.
pub(super) struct ShapeTotals {
    triangles: u64,
    bytes: u64,
    memory: u64,
}

impl Default for ShapeTotals {
    fn default() -> ShapeTotals {
        ShapeTotals { triangles: 0, bytes: 0, memory: memory::limit() }
    }
}

impl ShapeTotals {
    /// Complains if a mesh of this size does not fit, before it is made.
    fn check(&self, triangles: usize, vertices: usize, span: Span) -> Result<()> {
        ShapeTotals { ..*self }.add(triangles, vertices, span)
    }

    fn add(&mut self, triangles: usize, vertices: usize, span: Span) -> Result<()> {
        // A vertex with normal and uv; three indices; the shape itself.
        let bytes = (vertices as u64)
            .saturating_mul(44)
            .saturating_add((triangles as u64).saturating_mul(12))
            .saturating_add(size_of::<Shape>() as u64);
        self.triangles = self.triangles.saturating_add(triangles as u64);
        self.bytes = self.bytes.saturating_add(bytes);
        if self.triangles > MAX_TRIANGLES {
            return Err(Problem::at(span, format!("the scene has more than {MAX_TRIANGLES} triangles"))
                .label("too many triangles with this; instances are copies"));
        }
        if self.bytes > self.memory {
            let limit = memory::in_gib(self.memory);
            return Err(Problem::at(span, format!("the scene's shapes need more than {limit}"))
                .label("too much memory with this; instances are copies"));
        }
        Ok(())
    }
}

impl Builder {
    /// `Shape`. What it lacks belongs to the object that is being defined, if there is one.
    pub(super) fn shape(&mut self, kind: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        match self.read_shape(kind, parameters, span) {
            Err(problem) if problem.lacking.is_some() => self.pending.push(*problem),
            result => result?,
        }
        if let Some(lacks) = self.objects.open_lacks() {
            lacks.append(&mut self.pending);
        }
        Ok(())
    }

    fn read_shape(&mut self, kind: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        let sources = match kind.text.as_str() {
            "sphere" => vec![sphere(parameters)?],
            "disk" => vec![disk(parameters)?],
            "cylinder" => vec![cylinder(parameters)?],
            "trianglemesh" => self.triangle_mesh(parameters, span)?,
            "plymesh" => self.ply_mesh(parameters, span)?,
            "bilinearmesh" => self.bilinear_mesh(parameters, span)?,
            "loopsubdiv" => self.loop_subdivision(parameters, span)?,
            other if UNSUPPORTED.contains(&other) => {
                return Err(unsupported_kind("shape", kind, &KNOWN).lacking("the shape is left out"));
            }
            _ => return self.mistake(unknown_kind("shape", kind, &KNOWN)),
        };
        let Some((opacity, visible)) = self.opacity(parameters)? else {
            // Nothing of it is there.
            return self.check_unused(parameters, &format!("shape \"{}\"", kind.text));
        };
        if self.dialect.is_surely_v3() {
            self.refuse_material_overrides(parameters);
        }
        if self.state.medium.is_transition {
            self.lack_medium();
        }
        self.check_unused(parameters, &format!("shape \"{}\"", kind.text))?;
        let transform = self.static_ctm(span)?;
        let emission = self.emission(span);
        if emission.is_some_and(|emission| emission.image.is_some())
            && !sources.iter().all(|source| matches!(source, Source::Mesh(mesh) if !mesh.uvs.is_empty()))
        {
            let problem =
                Problem::at(span, format!("a picture on the area light \"{}\" is not supported", kind.text))
                    .label("expected triangles or patches with texture coordinates")
                    .lacking("the lamp is left out");
            return Err(problem);
        }
        for source in sources {
            let shape = PlacedShape {
                source,
                transform,
                reverse_orientation: self.state.reverse_orientation,
                material: self.state.material,
                emission,
                opacity,
                visible,
            };
            match self.objects.open_shapes() {
                Some(shapes) => shapes.push(shape),
                None => self.emit(&shape, None, span)?,
            }
        }
        Ok(())
    }

    /// How much of the shape is there, and whether rays meet it; none if nothing is there.
    fn opacity(&mut self, parameters: &Parameters) -> Result<Option<(Option<Opacity>, bool)>> {
        let alpha = self.float_parameter(parameters, "alpha")?.unwrap_or(Parameter::Constant(1.0));
        let for_light = match parameters.find("shadowalpha") {
            // pbrt-v3 alone has it: rays towards lights look at both.
            Some(_) => self.float_parameter(parameters, "shadowalpha")?.unwrap_or(Parameter::Constant(1.0)),
            None => Parameter::Constant(1.0),
        };
        let everything = |alpha| matches!(alpha, Parameter::Constant(alpha) if alpha >= 1.0);
        if everything(alpha) && everything(for_light) {
            return Ok(Some((None, true)));
        }
        let certain = self.dialect.is_v3();
        if let (Parameter::Constant(_), Parameter::Constant(_)) = (alpha, for_light)
            && certain
            && [alpha, for_light].iter().all(|alpha| *alpha != Parameter::Constant(0.0))
        {
            // Only what is 0 is not there.
            return Ok(Some((None, true)));
        }
        let lamp = self.state.area_light.is_some() && !self.objects.is_open();
        if lamp && matches!(alpha, Parameter::Constant(alpha) if alpha <= 0.0) {
            // It shines all the same.
            return Ok(Some((None, false)));
        }
        if lamp {
            let problem = parameters.bad("alpha", "not 1", "expected 1: of lamps alpha is not supported");
            self.pending.push(*problem.lacking("the surface is opaque"));
            return Ok(Some((None, true)));
        }
        if alpha == Parameter::Constant(0.0) {
            return Ok(None);
        }
        let mut node = |alpha: Parameter<f64>| match everything(alpha) {
            true => None,
            false => Some(self.node_of(widen(alpha))),
        };
        let for_paths = node(alpha);
        let for_light = match for_paths {
            // Light passes where either says so.
            Some(alpha) => match node(for_light) {
                Some(for_light) => {
                    Some(self.node(wavepath_kernels::texture::Texture::Product(alpha, for_light)))
                }
                None => Some(alpha),
            },
            None => node(for_light),
        };
        self.textures.need(for_paths.into_iter().chain(for_light));
        Ok(Some((Some(Opacity { for_paths, for_light, certain }), true)))
    }

    /// The emission for a shape; objects have none, as in pbrt.
    fn emission(&mut self, span: Span) -> Option<Emission> {
        let light = self.state.area_light.clone()?;
        if !self.objects.is_open() {
            // A lamp without light would be sampled in vain.
            return Some(light.emission).filter(|emission| emission.radiance != [0.0; 3]);
        }
        self.warn(
            Problem::at(span, "area lights inside objects are not supported")
                .label("this shape will not shine")
                .note(Place::Span(light.span), "its light is defined here"),
        );
        None
    }

    /// Puts a shape into the scene, perhaps as part of an instance.
    pub(super) fn emit(&mut self, shape: &PlacedShape, instance: Option<DAffine3>, span: Span) -> Result<()> {
        let transform = match instance {
            Some(world_from_instance) => world_from_instance * shape.transform,
            None => shape.transform,
        };
        if !transform.is_finite() {
            return Err(Problem::at(span, "the transform of a shape is not finite"));
        }
        // Triangles need no way back. A quadric is seen from its own space: pbrt finds nothing there either.
        if !matches!(shape.source, Source::Mesh(_)) && invertible(transform).is_none() {
            self.drop_count(Dropped::SingularShapes, 1, Place::Span(span));
            return Ok(());
        }
        // pbrt flips the normal by the handedness of the shape's own transform; the instance's is applied to the
        // normal as a vector. For a quadric both are told by the same flag. The winding of a mesh is looked at in
        // world space, where the instance's handedness has turned it.
        let flip_quadric = shape.reverse_orientation != swaps_handedness(&shape.transform);
        let (geometry, flip_normal) = match &shape.source {
            Source::Mesh(mesh) => {
                self.totals.add(mesh.triangles.len(), mesh.positions.len(), span)?;
                let Some(id) = self.emit_mesh(mesh, &transform, shape.reverse_orientation, span)? else {
                    return Ok(());
                };
                (Geometry::Mesh(id), shape.reverse_orientation != swaps_handedness(&transform))
            }
            Source::Sphere { radius, z_min, z_max, phi_max } => {
                check_size(&transform, *radius, span)?;
                self.totals.add(0, 0, span)?;
                let [radius, z_min, z_max, phi_max] = [*radius, *z_min, *z_max, *phi_max];
                (
                    Geometry::Sphere { world_from_object: transform, radius, z_min, z_max, phi_max },
                    flip_quadric,
                )
            }
            Source::Disk { height, radius, inner_radius, phi_max } => {
                check_size(&transform, radius.max(height.abs()), span)?;
                self.totals.add(0, 0, span)?;
                let [height, radius, inner_radius, phi_max] = [*height, *radius, *inner_radius, *phi_max];
                (
                    Geometry::Disk { world_from_object: transform, height, radius, inner_radius, phi_max },
                    flip_quadric,
                )
            }
            Source::Cylinder { radius, z_min, z_max, phi_max } => {
                check_size(&transform, radius.max(z_min.abs()).max(z_max.abs()), span)?;
                self.totals.add(0, 0, span)?;
                let [radius, z_min, z_max, phi_max] = [*radius, *z_min, *z_max, *phi_max];
                (
                    Geometry::Cylinder { world_from_object: transform, radius, z_min, z_max, phi_max },
                    flip_quadric,
                )
            }
        };
        self.shape_spans.push(span);
        self.scene.shapes.push(Shape {
            geometry,
            material: shape.material,
            emission: shape.emission,
            flip_normal,
            opacity: shape.opacity,
            visible: shape.visible,
        });
        Ok(())
    }

    /// The mesh in world space; `None` if nothing is left of it.
    fn emit_mesh(
        &mut self,
        source: &SourceMesh,
        transform: &DAffine3,
        reverse: bool,
        span: Span,
    ) -> Result<Option<MeshId>> {
        let positions = world_positions(source, transform, span)?;
        let mut normals = world_normals(source, transform, reverse);
        // A transform that makes everything flat may leave no direction.
        let has_direction = |t: &[u32; 3]| t.iter().any(|i| normals[*i as usize] != [0.0; 3]);
        if !normals.is_empty() && !source.triangles.iter().all(has_direction) {
            normals.clear();
        }
        let triangles: Vec<[u32; 3]> =
            source.triangles.iter().copied().filter(|triangle| has_area(&positions, triangle)).collect();
        let dropped = source.triangles.len() - triangles.len();
        self.drop_count(Dropped::DegenerateTriangles, dropped as u64, Place::Span(span));
        if triangles.is_empty() {
            return Ok(None);
        }
        let uvs: Vec<[f32; 2]> = source.uvs.iter().map(|uv| uv.map(|c| c as f32)).collect();
        if uvs.iter().flatten().any(|c| !c.is_finite()) {
            return Err(Problem::at(span, "a texture coordinate is too large"));
        }
        self.scene.meshes.push(Mesh { positions, normals, uvs, triangles });
        Ok(Some(MeshId(self.scene.meshes.len() as u32 - 1)))
    }

    fn ply_mesh(&mut self, parameters: &Parameters, span: Span) -> Result<Vec<Source>> {
        let Some(name) = parameters.string("filename")? else {
            return Err(Problem::at(span, "plymesh without a file").label("expected \"string filename\""));
        };
        let path = self.resolve(name);
        if let Some(parameter) = parameters.given("displacement") {
            let problem = Problem::at(parameter.span, "\"displacement\" is not supported")
                .label("expected a mesh without displacement")
                .lacking("the mesh as it is");
            self.pending.push(*problem);
        }
        parameters.accept(&["edgelength"]);
        self.inputs.push(path.clone());
        let mesh = ply::read(&path).map_err(|error| ply_problem(&path, &error, parameters))?;
        let place = parameters.find("filename").map_or(Place::Span(span), |p| p.place(0));
        self.drop_count(Dropped::Faces, mesh.skipped, place.clone());
        self.drop_count(Dropped::Polygons, mesh.polygons, place.clone());
        if mesh.triangles.is_empty() {
            self.warn(Problem::at(span, "the mesh has no faces").label("nothing of it is seen"));
        }
        let mut source = SourceMesh {
            positions: mesh.positions,
            normals: mesh.normals,
            uvs: mesh.uvs,
            triangles: mesh.triangles,
        };
        if !mesh.quads.is_empty() {
            self.refuse_power(span);
        }
        let corners = |first: &u32| {
            let ([a, b, c], [_, _, d]) =
                (source.triangles[*first as usize], source.triangles[*first as usize + 1]);
            [a, b, d, c]
        };
        let bent: Vec<u32> =
            mesh.quads.iter().copied().filter(|first| !source.is_flat(corners(first))).collect();
        let patches: Vec<[u32; 4]> = bent.iter().map(corners).collect();
        self.clean(&mut source, &place);
        // pbrt-v3 cuts quads in two.
        if bent.is_empty() || self.dialect.is_v3() {
            if source.uvs.is_empty() && self.shines_with_picture() {
                source.split_triangles();
            }
            return Ok(vec![Source::Mesh(Rc::new(source))]);
        }
        let patches = self.patches(&source, &patches, span)?;
        let mut bent = bent.into_iter().peekable();
        let mut number = 0u32;
        let mut left = 0;
        source.triangles.retain(|_| {
            if bent.peek() == Some(&number) {
                bent.next();
                left = 2;
            }
            number += 1;
            let keep = left == 0;
            left -= u32::from(!keep);
            keep
        });
        Ok(vec![Source::Mesh(Rc::new(source)), patches])
    }

    fn bilinear_mesh(&mut self, parameters: &Parameters, span: Span) -> Result<Vec<Source>> {
        if let Some(parameter) = parameters.given("emissionfilename") {
            let problem = Problem::at(parameter.span, "\"emissionfilename\" is not supported")
                .lacking("it shines with \"L\"");
            self.pending.push(*problem);
        }
        let Some(mut source) = self.vertices(parameters, span)? else {
            return Ok(Vec::new());
        };
        let mut patches: Vec<[u32; 4]> = self.indices(parameters, source.positions.len(), span)?;
        if source.uvs.is_empty() && self.shines_with_picture() {
            patches = source.split_patches(&patches);
        }
        let flat: Vec<[u32; 4]> = patches.iter().copied().filter(|patch| source.is_flat(*patch)).collect();
        let bent: Vec<[u32; 4]> = patches.into_iter().filter(|patch| !source.is_flat(*patch)).collect();
        // Order in the file: 00, 10, 01, 11.
        source.triangles.extend(flat.iter().flat_map(|&[a, b, c, d]| [[a, b, d], [a, d, c]]));
        self.refuse_power(span);
        let place = parameters.find("P").map_or(Place::Span(span), |p| Place::Span(p.span));
        let (mut flat, mut bent) = (flat, bent);
        source.check_used(bent.iter().flatten(), parameters)?;
        if source.uvs.is_empty() && self.needs_coordinates(parameters) {
            source = source.patch_coordinates(&mut flat, &mut bent);
        }
        self.clean(&mut source, &place);
        source.check_used(source.triangles.iter().flatten(), parameters)?;
        if !source.normals.is_empty() && !flat.is_empty() {
            self.warn(
                Problem::at(span, "the patches are rendered as triangles")
                    .label("normals are interpolated over triangles, which differs slightly"),
            );
        }
        let mut sources = Vec::new();
        if !bent.is_empty() {
            sources.push(self.patches(&source, &bent, span)?);
        }
        if !flat.is_empty() {
            sources.insert(0, Source::Mesh(Rc::new(source)));
        }
        Ok(sources)
    }

    /// Whether textures may look at the coordinates of a shape.
    fn needs_coordinates(&self, parameters: &Parameters) -> bool {
        let is_texture = |name: &'static str| {
            parameters.find(name).is_some_and(|parameter| parameter.ty == ParameterType::Texture)
        };
        self.materials.may_be_textured(self.state.material)
            || !self.textures.of_material(self.state.material).is_empty()
            || is_texture("alpha")
    }

    /// A mesh in place of patches that are not plane, with their normals. Corners in the order 00, 10, 01, 11.
    fn patches(&mut self, source: &SourceMesh, patches: &[[u32; 4]], span: Span) -> Result<Source> {
        let mut mesh = SourceMesh::default();
        let mut folded = 0;
        for patch in patches {
            let p = patch.map(|i| source.positions[i as usize]);
            let points = p.map(DVec3::from_array);
            let n = polygon::pieces(points);
            let at = |u: f64, v: f64| polygon::patch_normal(points, u, v);
            // A fold: the normal at a corner is opposed to that in the middle.
            let middle = at(0.5, 0.5);
            let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
            folded += u64::from(corners.iter().any(|normal| normal.dot(middle) < 0.0));
            let given = patch.map(|i| source.normals.get(i as usize).copied().unwrap_or_default());
            let is_given = given.iter().all(|normal| *normal != [0.0; 3]);
            let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
            self.totals.check(
                triangles + 2 * (n * n) as usize,
                vertices + ((n + 1) * (n + 1)) as usize,
                span,
            )?;
            let first = vertices as u32;
            for j in 0..=n {
                for i in 0..=n {
                    let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                    mesh.positions.push(polygon::bilinear(p, u, v));
                    let own = at(u, v).normalize_or_zero();
                    mesh.normals.push(match is_given {
                        true => polygon::bilinear(given, u, v),
                        // At a corner without area that of the middle.
                        false if own == DVec3::ZERO => middle.normalize_or_zero().to_array(),
                        false => own.to_array(),
                    });
                    match source.uvs.is_empty() {
                        true => mesh.uvs.push([u, v]),
                        false => {
                            mesh.uvs.push(polygon::bilinear(patch.map(|i| source.uvs[i as usize]), u, v));
                        }
                    }
                }
            }
            for j in 0..n {
                for i in 0..n {
                    let corner = first + j * (n + 1) + i;
                    let [p00, p10, p01, p11] = [corner, corner + 1, corner + n + 1, corner + n + 2];
                    mesh.triangles.extend([[p00, p10, p11], [p00, p11, p01]]);
                }
            }
        }
        self.drop_count(Dropped::FoldedQuads, folded, Place::Span(span));
        Ok(Source::Mesh(Rc::new(mesh)))
    }

    /// pbrt gives `power` to each patch; here each of the patch's triangles is a light.
    fn refuse_power(&mut self, span: Span) {
        if self.state.area_light.as_ref().is_none_or(|light| light.emission.power.is_none()) {
            return;
        }
        let problem = Problem::at(span, "an area light with \"power\" on quads is not supported")
            .label("each quad would be one light; expected triangles")
            .lacking("each triangle has that power");
        self.pending.push(*problem);
    }

    fn triangle_mesh(&mut self, parameters: &Parameters, span: Span) -> Result<Vec<Source>> {
        // Tangents matter to anisotropic materials and hair, faces to Ptex.
        parameters.accept(&["S", "faceIndices"]);
        let Some(mut source) = self.vertices(parameters, span)? else {
            return Ok(Vec::new());
        };
        source.triangles = self.indices(parameters, source.positions.len(), span)?;
        let place = parameters.find("P").map_or(Place::Span(span), |p| Place::Span(p.span));
        source.check_used(source.triangles.iter().flatten(), parameters)?;
        self.clean(&mut source, &place);
        if source.uvs.is_empty() && self.shines_with_picture() {
            source.split_triangles();
        }
        Ok(vec![Source::Mesh(Rc::new(source))])
    }

    /// Loop's subdivision of a mesh of triangles. What is given beside their vertices and indices does not count, as in
    /// pbrt.
    fn loop_subdivision(&mut self, parameters: &Parameters, span: Span) -> Result<Vec<Source>> {
        let Some(source) = self.vertices(parameters, span)? else {
            return Ok(Vec::new());
        };
        // Version 3 calls it by both names.
        let name = if self.dialect.is_v3() && parameters.has("nlevels") { "nlevels" } else { "levels" };
        parameters.accept(&["levels", "scheme"]);
        let levels = parameters.integer(name)?.unwrap_or(3);
        let levels = u32::try_from(levels).map_err(|_| {
            parameters.bad(name, &levels.to_string(), "expected a whole number that is not negative")
        })?;
        let triangles: Vec<[u32; 3]> = self.indices(parameters, source.positions.len(), span)?;
        source.check_used(triangles.iter().flatten(), parameters)?;
        let (most, vertices) = subdivision::size(triangles.len(), source.positions.len(), levels);
        let fits = |size: u64| usize::try_from(size).unwrap_or(usize::MAX);
        self.totals.check(fits(most), fits(vertices), span)?;
        let finite = |p: &[f64; 3]| if p.iter().all(|c| c.is_finite()) { *p } else { [0.0; 3] };
        let positions = source.positions.iter().map(|p| DVec3::from_array(finite(p))).collect();
        let smooth = subdivision::subdivide(positions, triangles, levels);
        let numbers = |vectors: Vec<DVec3>| vectors.into_iter().map(|v| v.to_array()).collect();
        let mut source = SourceMesh {
            positions: numbers(smooth.positions),
            normals: numbers(smooth.normals),
            uvs: Vec::new(),
            triangles: smooth.triangles,
        };
        self.clean(&mut source, &Place::Span(span));
        Ok(vec![Source::Mesh(Rc::new(source))])
    }

    /// Do the following shapes show a picture that shines?
    fn shines_with_picture(&self) -> bool {
        self.state.area_light.as_ref().is_some_and(|light| light.emission.image.is_some())
    }

    /// Vertices with their normals and texture coordinates; `None` without any.
    fn vertices(&mut self, parameters: &Parameters, span: Span) -> Result<Option<SourceMesh>> {
        let Some(positions) = parameters.array("P", &[ParameterType::Point3])? else {
            parameters.accept(&["N", "uv", "st", "indices"]);
            self.mistake(Problem::at(span, "a mesh without vertices").label("expected \"point3 P\""))?;
            return Ok(None);
        };
        let mut source = SourceMesh { positions: groups(positions.numbers()), ..SourceMesh::default() };
        let vertices = source.positions.len();
        if let Some(parameter) = parameters.array("N", &[ParameterType::Normal3])? {
            source.normals = groups(parameter.numbers());
            if source.normals.len() != vertices {
                source.normals.clear();
                self.drop_count(Dropped::NormalArrays, 1, Place::Span(parameter.span));
            }
        }
        // Texture coordinates: `point2 uv`, v3 also `float uv` and `st`.
        let types = [ParameterType::Point2, ParameterType::Float, ParameterType::Vector2];
        for name in ["uv", "st"] {
            let Some(parameter) = parameters.array(name, &types)? else {
                continue;
            };
            source.uvs = groups(parameter.numbers());
            if source.uvs.len() > vertices && self.dialect.is_v3() {
                source.uvs.truncate(vertices);
                self.drop_count(Dropped::UvArrays, 1, Place::Span(parameter.span));
            } else if source.uvs.len() != vertices || !parameter.numbers().len().is_multiple_of(2) {
                source.uvs.clear();
                self.drop_count(Dropped::UvArrays, 1, Place::Span(parameter.span));
            }
            break;
        }
        parameters.accept(&["uv", "st"]);
        Ok(Some(source))
    }

    /// Indices in groups of `N`; none are needed for exactly one group of vertices.
    fn indices<const N: usize>(
        &mut self,
        parameters: &Parameters,
        vertices: usize,
        span: Span,
    ) -> Result<Vec<[u32; N]>> {
        let Some(values) = parameters.integers("indices")? else {
            if vertices == N {
                return Ok(vec![std::array::from_fn(|i| i as u32)]);
            }
            let problem = Problem::at(span, format!("a mesh of {vertices} vertices without indices"))
                .label(format!("expected \"integer indices\" (or exactly {N} vertices)"));
            self.mistake(problem)?;
            return Ok(Vec::new());
        };
        let place = |i: usize| parameters.find("indices").map_or(Place::Nowhere, |p| p.place(i));
        let left_over = values.len() % N;
        self.drop_count(Dropped::Indices, left_over as u64, place(values.len() - left_over));
        let out_of_range = |value: &i32| usize::try_from(*value).map_or(true, |v| v >= vertices);
        if let Some(i) = values.iter().position(out_of_range) {
            let problem = Problem::new(place(i), format!("index {} is out of range", values[i])).label(
                format!("expected 0 to {}: there are {vertices} vertices", vertices.saturating_sub(1)),
            );
            self.mistake(problem)?;
            // pbrt-v3 leaves out the mesh.
            return Ok(Vec::new());
        }
        Ok(values.as_chunks::<N>().0.iter().map(|group| group.map(|value| value as u32)).collect())
    }

    /// Takes out what is no number, as far as the mesh can do without: normals (a face with such a corner is shaded flat,
    /// as is one whose normals are all 0), texture coordinates, and vertices that no face uses.
    fn clean(&mut self, mesh: &mut SourceMesh, place: &Place) {
        let mut bad_uvs = 0;
        for uv in mesh.uvs.iter_mut().filter(|uv| !uv.iter().all(|c| (*c as f32).is_finite())) {
            *uv = [0.0; 2];
            bad_uvs += 1;
        }
        self.drop_count(Dropped::UvValues, bad_uvs, place.clone());
        for p in mesh.positions.iter_mut().filter(|p| !p.iter().all(|c| c.is_finite())) {
            *p = [0.0; 3];
        }
        let bad_normals = mesh.flatten_faces_without_normals();
        self.drop_count(Dropped::Normals, bad_normals, place.clone());
    }

    /// In v3 a shape's parameters override those of its material: ignoring them would change the picture.
    fn refuse_material_overrides(&mut self, parameters: &Parameters) {
        const NAMES: [&str; 14] = [
            "Kd",
            "Ks",
            "Kr",
            "Kt",
            "sigma",
            "roughness",
            "uroughness",
            "vroughness",
            "eta",
            "k",
            "index",
            "opacity",
            "bumpmap",
            "remaproughness",
        ];
        for parameter in NAMES.iter().filter_map(|name| parameters.given(name)) {
            let problem = Problem::at(parameter.span, "material parameters on a shape are not supported")
                .label("expected in the Material")
                .lacking("the material as it is");
            self.pending.push(*problem);
        }
    }
}

impl SourceMesh {
    /// Whether a patch can be rendered as two triangles. Corners in the order 00, 10, 01, 11.
    /// Vertices of its own for each patch, with the texture coordinates that pbrt gives to those without any; the patches
    /// with these.
    fn split_patches(&mut self, patches: &[[u32; 4]]) -> Vec<[u32; 4]> {
        let mut split = SourceMesh::default();
        for patch in patches {
            for (&vertex, uv) in patch.iter().zip([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) {
                split.push_vertex(self, vertex, uv);
            }
        }
        *self = split;
        (0..patches.len() as u32).map(|k| [4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3]).collect()
    }

    /// The same for triangles.
    fn split_triangles(&mut self) {
        let mut split = SourceMesh::default();
        for triangle in &self.triangles {
            let first = split.positions.len() as u32;
            for (&vertex, uv) in triangle.iter().zip([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]) {
                split.push_vertex(self, vertex, uv);
            }
            split.triangles.push([first, first + 1, first + 2]);
        }
        *self = split;
    }

    fn push_vertex(&mut self, from: &SourceMesh, vertex: u32, uv: [f64; 2]) {
        self.positions.push(from.positions[vertex as usize]);
        self.normals.extend(from.normals.get(vertex as usize));
        self.uvs.push(uv);
    }

    fn is_flat(&self, patch: [u32; 4]) -> bool {
        let [a, b, c, d] = patch.map(|index| DVec3::from_array(self.positions[index as usize]));
        polygon::is_plane_and_convex([a, b, d, c])
    }

    /// The same with coordinates from 0 to 1 on each patch, which then has vertices of its own. Corners in the order 00,
    /// 10, 01, 11.
    fn patch_coordinates(&self, flat: &mut [[u32; 4]], bent: &mut [[u32; 4]]) -> SourceMesh {
        let mut mesh = SourceMesh::default();
        for patch in flat.iter_mut().chain(bent.iter_mut()) {
            let first = mesh.positions.len() as u32;
            for (corner, uv) in patch.iter().zip([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) {
                mesh.positions.push(self.positions[*corner as usize]);
                mesh.normals.extend(self.normals.get(*corner as usize));
                mesh.uvs.push(uv);
            }
            *patch = [0, 1, 2, 3].map(|k| first + k);
        }
        mesh.triangles = flat.iter().flat_map(|&[a, b, c, d]| [[a, b, d], [a, d, c]]).collect();
        mesh
    }

    /// Complains about a vertex that is no number and that a face uses.
    fn check_used<'a>(&self, used: impl Iterator<Item = &'a u32>, parameters: &Parameters) -> Result<()> {
        for index in used {
            let position = self.positions[*index as usize];
            if let Some(i) = position.iter().position(|c| !c.is_finite()) {
                let at = 3 * *index as usize + i;
                let place = parameters.find("P").map_or(Place::Nowhere, |p| p.place(at));
                return Err(Problem::new(place, format!("vertex {index} is not finite, and a face uses it"))
                    .label("expected a finite number"));
            }
        }
        Ok(())
    }

    /// Gives faces of which a normal is no number, or all are 0, vertices of their own with the face's normal, as pbrt
    /// shades them. Returns how many normals were no numbers.
    fn flatten_faces_without_normals(&mut self) -> u64 {
        if self.normals.is_empty() {
            return 0;
        }
        let is_number = |n: &[f64; 3]| n.iter().all(|c| c.is_finite());
        let bad = self.normals.iter().filter(|n| !is_number(n)).count() as u64;
        let has_normals = |t: &[u32; 3]| {
            let normals = t.map(|i| self.normals[i as usize]);
            normals.iter().all(is_number) && normals != [[0.0; 3]; 3]
        };
        let flat: Vec<usize> =
            (0..self.triangles.len()).filter(|i| !has_normals(&self.triangles[*i])).collect();
        if flat.len() == self.triangles.len() {
            self.normals.clear();
            return bad;
        }
        for i in flat {
            let corners = self.triangles[i];
            let [a, b, c] = corners.map(|i| DVec3::from_array(self.positions[i as usize]));
            let normal = (b - a).cross(c - a).normalize_or_zero().to_array();
            self.triangles[i] = corners.map(|corner| {
                self.positions.push(self.positions[corner as usize]);
                self.normals.push(normal);
                if !self.uvs.is_empty() {
                    self.uvs.push(self.uvs[corner as usize]);
                }
                self.positions.len() as u32 - 1
            });
        }
        for n in self.normals.iter_mut().filter(|n| !is_number(n)) {
            *n = [0.0; 3];
        }
        bad
    }
}

fn ply_problem(path: &Path, error: &ply::PlyError, parameters: &Parameters) -> Box<Problem> {
    let name = parameters.find("filename").map_or(Place::Nowhere, |p| p.place(0));
    // `mesh.ply:12` for a line, as in scene files, so that editors find it.
    let place = match error.place.strip_prefix("line ") {
        Some(line) => format!("{}:{line}", path.display()),
        None if error.place.is_empty() => path.display().to_string(),
        None => format!("{}, {}", path.display(), error.place),
    };
    Problem::new(Place::Other(place), error.message.clone()).note(name, "the mesh is named here")
}

fn sphere(parameters: &Parameters) -> Result<Source> {
    let radius = parameters.positive_or("radius", 1.0)?;
    let a = parameters.float_or("zmin", -radius)?.clamp(-radius, radius);
    let b = parameters.float_or("zmax", radius)?.clamp(-radius, radius);
    let (z_min, z_max) = (a.min(b), a.max(b));
    if z_min == z_max {
        return Err(parameters.bad(
            "zmin",
            &a.to_string(),
            "expected zmin below zmax: nothing is left of the sphere",
        ));
    }
    Ok(Source::Sphere { radius, z_min, z_max, phi_max: phi_max(parameters)? })
}

/// Complains about a quadric whose size in the world is not a number in single precision.
fn check_size(transform: &DAffine3, extent: f64, span: Span) -> Result<()> {
    let m = transform.matrix3;
    let sizes = [m.x_axis, m.y_axis, m.z_axis].map(|axis| (axis.length() * extent) as f32);
    let fits = sizes.iter().all(|size| size.is_normal()) && transform.translation.as_vec3().is_finite();
    if fits {
        return Ok(());
    }
    Err(Problem::at(span, "the shape is too large, too small or too far away")
        .label("expected coordinates that fit into single precision"))
}

fn disk(parameters: &Parameters) -> Result<Source> {
    let height = parameters.float_or("height", 0.0)?;
    let radius = parameters.positive_or("radius", 1.0)?;
    let inner_radius = parameters.non_negative_or("innerradius", 0.0)?;
    if inner_radius >= radius {
        return Err(parameters.bad(
            "innerradius",
            &inner_radius.to_string(),
            "expected less than the radius",
        ));
    }
    Ok(Source::Disk { height, radius, inner_radius, phi_max: phi_max(parameters)? })
}

fn cylinder(parameters: &Parameters) -> Result<Source> {
    let radius = parameters.positive_or("radius", 1.0)?;
    let a = parameters.float_or("zmin", -1.0)?;
    let b = parameters.float_or("zmax", 1.0)?;
    let (z_min, z_max) = (a.min(b), a.max(b));
    // Single precision is what the shape is kept in.
    if z_min as f32 >= z_max as f32 {
        return Err(parameters.bad(
            "zmin",
            &a.to_string(),
            "expected zmin below zmax: nothing is left of the cylinder",
        ));
    }
    Ok(Source::Cylinder { radius, z_min, z_max, phi_max: phi_max(parameters)? })
}

fn phi_max(parameters: &Parameters) -> Result<f64> {
    Ok(parameters.positive_or("phimax", 360.0)?.min(360.0))
}

fn groups<const N: usize>(numbers: &[f64]) -> Vec<[f64; N]> {
    numbers.as_chunks::<N>().0.to_vec()
}

fn world_positions(source: &SourceMesh, transform: &DAffine3, span: Span) -> Result<Vec<[f64; 3]>> {
    let to_world = |p: &[f64; 3]| transform.transform_point3(DVec3::from_array(*p));
    let mut positions: Vec<[f64; 3]> = source.positions.iter().map(|p| to_world(p).to_array()).collect();
    // In the single precision of the tables.
    let is_finite = |p: &[f64; 3]| p.iter().all(|&c| (c as f32).is_finite());
    if positions.iter().all(is_finite) {
        return Ok(positions);
    }
    if source.triangles.iter().flatten().any(|i| !is_finite(&positions[*i as usize])) {
        return Err(Problem::at(span, "a vertex is too far away").label("expected coordinates below 3e38"));
    }
    positions.iter_mut().filter(|p| !is_finite(p)).for_each(|p| *p = [0.0; 3]);
    Ok(positions)
}

/// Normals turn by the inverse's transpose, and around with `ReverseOrientation`. One without a direction stays 0.
fn world_normals(source: &SourceMesh, transform: &DAffine3, reverse: bool) -> Vec<[f32; 3]> {
    let matrix = normal_matrix(transform);
    let sign = if reverse { -1.0 } else { 1.0 };
    let to_world = |n: &[f64; 3]| {
        let turned = matrix * DVec3::from_array(*n);
        (turned.normalize_or_zero() * sign).as_vec3().to_array()
    };
    source.normals.iter().map(to_world).collect()
}

fn has_area(positions: &[[f64; 3]], triangle: &[u32; 3]) -> bool {
    let [a, b, c] = triangle.map(|i| DVec3::from_array(positions[i as usize]));
    // The squares of tiny triangles would underflow: compare with 0 by component.
    (b - a).cross(c - a) != DVec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbrt::error::FileId;

    #[test]
    fn instances_cannot_explode() {
        let span = Span { file: FileId(0), line: 1, line_start: 0, start: 0, end: 1 };
        let mut totals = ShapeTotals { memory: u64::MAX, ..ShapeTotals::default() };
        assert!(totals.add(1 << 30, 3, span).is_ok());
        let error = totals.add(1 << 30, 3, span).unwrap_err();
        assert!(error.message.contains("triangles"), "{}", error.message);
        let mut totals = ShapeTotals { memory: 1 << 20, ..ShapeTotals::default() };
        assert!(totals.add(1000, 1000, span).is_ok());
        let error = totals.add(100_000, 1000, span).unwrap_err();
        assert!(error.message.contains("GiB"), "{}", error.message);
        assert!(totals.add(usize::MAX, usize::MAX, span).is_err());
    }
}
