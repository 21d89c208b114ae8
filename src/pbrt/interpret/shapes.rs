//! Shapes: read in object space, then placed into the world.

use std::path::Path;
use std::rc::Rc;

use glam::{DAffine3, DVec3};

use crate::memory;
use crate::pbrt::error::{Place, Problem, Result, Span};
use crate::pbrt::lexer::shorten;
use crate::pbrt::parameters::{Parameter, ParameterType, Parameters};
use crate::pbrt::parser::Name;
use crate::pbrt::ply;
use crate::pbrt::transform::{invertible, normal_matrix, swaps_handedness};
use crate::scene::{Emission, Geometry, MaterialId, Mesh, MeshId, Shape};

use super::{Builder, unknown_kind, unsupported_kind};

const KNOWN: [&str; 6] = ["sphere", "disk", "cylinder", "trianglemesh", "plymesh", "bilinearmesh"];

const UNSUPPORTED: [&str; 8] =
    ["cone", "curve", "loopsubdiv", "paraboloid", "hyperboloid", "heightfield", "heightfield2", "nurbs"];

/// Most triangles of a scene: their handles are 32 bits, one of which is wanted for other ends.
const MAX_TRIANGLES: u64 = (1 << 31) - 1;

/// Distance of a quad's corners from its plane, relative to its size, up to which it counts as plane.
const PLANAR: f64 = 1e-4;

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
}

/// What the scene has taken so far.
pub(super) struct ShapeTotals {
    triangles: u64,
    bytes: u64,
    memory: u64,
    degenerate: u64,
    first_degenerate: Option<Span>,
}

impl Default for ShapeTotals {
    fn default() -> ShapeTotals {
        ShapeTotals { triangles: 0, bytes: 0, memory: memory::limit(), degenerate: 0, first_degenerate: None }
    }
}

impl ShapeTotals {
    fn add(&mut self, triangles: usize, vertices: usize, span: Span) -> Result<()> {
        // A vertex with normal and uv; three indices; the shape itself.
        let bytes = (vertices as u64)
            .saturating_mul(32)
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

    /// One warning about all the triangles without area.
    pub(super) fn degenerate_warning(&self) -> Option<Box<Problem>> {
        let span = self.first_degenerate?;
        let count = self.degenerate;
        let text = format!(
            "{count} degenerate triangle{} (of zero area) left out",
            if count == 1 { "" } else { "s" }
        );
        Some(Problem::at(span, text).label("the first is here"))
    }
}

impl Builder {
    /// `Shape`.
    pub(super) fn shape(&mut self, kind: &Name, parameters: &Parameters, span: Span) -> Result<()> {
        let source = match kind.text.as_str() {
            "sphere" => sphere(parameters)?,
            "disk" => disk(parameters)?,
            "cylinder" => cylinder(parameters)?,
            "trianglemesh" => triangle_mesh(parameters, span)?,
            "plymesh" => self.ply_mesh(parameters, span)?,
            "bilinearmesh" => self.bilinear_mesh(parameters, span)?,
            other if UNSUPPORTED.contains(&other) => {
                return Err(unsupported_kind("shape", kind, &KNOWN));
            }
            _ => return Err(unknown_kind("shape", kind, &KNOWN)),
        };
        for name in ["alpha", "shadowalpha"] {
            let alpha = self.float_texture(parameters, name)?.unwrap_or(1.0);
            if alpha != 1.0 {
                return Err(parameters.bad(name, &alpha.to_string(), "expected 1: alpha is not supported"));
            }
        }
        if self.dialect.is_surely_v3() {
            refuse_material_overrides(parameters)?;
        }
        self.check_unused(parameters, &format!("shape \"{}\"", kind.text))?;
        let shape = PlacedShape {
            source,
            transform: self.static_ctm(span)?,
            reverse_orientation: self.state.reverse_orientation,
            material: self.state.material,
            emission: self.emission(span),
        };
        if let Some(shapes) = self.objects.open_shapes() {
            shapes.push(shape);
            return Ok(());
        }
        self.emit(&shape, None, span)
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
        if invertible(transform).is_none() {
            return Err(Problem::at(span, "the transform of a shape cannot be inverted"));
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
        self.scene.shapes.push(Shape {
            geometry,
            material: shape.material,
            emission: shape.emission,
            flip_normal,
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
        let normals = world_normals(source, transform, reverse);
        let triangles: Vec<[u32; 3]> =
            source.triangles.iter().copied().filter(|triangle| has_area(&positions, triangle)).collect();
        let dropped = source.triangles.len() - triangles.len();
        if dropped > 0 {
            self.totals.degenerate += dropped as u64;
            self.totals.first_degenerate.get_or_insert(span);
        }
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

    fn ply_mesh(&mut self, parameters: &Parameters, span: Span) -> Result<Source> {
        let Some(name) = parameters.string("filename")? else {
            return Err(Problem::at(span, "plymesh without a file").label("expected \"string filename\""));
        };
        let path = self.resolve(name);
        if let Some(parameter) = parameters.given("displacement") {
            return Err(Problem::at(parameter.span, "\"displacement\" is not supported")
                .label("expected a mesh without displacement"));
        }
        parameters.accept(&["edgelength"]);
        self.inputs.push(path.clone());
        let mesh = ply::read(&path).map_err(|error| ply_problem(&path, &error, parameters))?;
        if mesh.triangles.is_empty() {
            self.warn(Problem::at(span, "the mesh has no faces").label("nothing of it is seen"));
        }
        if mesh.quads > 0 {
            self.refuse_power(span)?;
        }
        Ok(Source::Mesh(Rc::new(SourceMesh {
            positions: mesh.positions,
            normals: mesh.normals,
            uvs: mesh.uvs,
            triangles: mesh.triangles,
        })))
    }

    fn bilinear_mesh(&mut self, parameters: &Parameters, span: Span) -> Result<Source> {
        if let Some(parameter) = parameters.given("emissionfilename") {
            return Err(Problem::at(parameter.span, "\"emissionfilename\" is not supported"));
        }
        let positions = points(parameters, span)?;
        let patches: Vec<[u32; 4]> = indices(parameters, positions.len(), span)?;
        let mut triangles = Vec::with_capacity(patches.len() * 2);
        for (i, patch) in patches.iter().enumerate() {
            // Order in the file: 00, 10, 01, 11.
            let [a, b, c, d] = patch.map(|index| DVec3::from_array(positions[index as usize]));
            if !is_plane_and_convex([a, b, d, c]) {
                let place = parameters.find("indices").map_or(Place::Span(span), |p| p.place(4 * i));
                return Err(Problem::new(place, format!("patch {i} is not plane and convex"))
                    .label("expected plane patches: curved bilinear patches are not supported"));
            }
            let [a, b, c, d] = *patch;
            triangles.extend([[a, b, d], [a, d, c]]);
        }
        self.refuse_power(span)?;
        let normals = vectors(parameters, "N", &[ParameterType::Normal3], positions.len())?;
        if !normals.is_empty() {
            self.warn(
                Problem::at(span, "the patches are rendered as triangles")
                    .label("normals are interpolated over triangles, which differs slightly"),
            );
        }
        let uvs = uvs(parameters, positions.len())?;
        Ok(Source::Mesh(Rc::new(SourceMesh { positions, normals, uvs, triangles })))
    }

    /// pbrt gives `power` to each patch; here each of the patch's triangles is a light.
    fn refuse_power(&self, span: Span) -> Result<()> {
        if self.state.area_light.as_ref().is_none_or(|light| light.emission.power.is_none()) {
            return Ok(());
        }
        Err(Problem::at(span, "an area light with \"power\" on quads is not supported")
            .label("each quad would be one light; expected triangles"))
    }
}

/// In v3 a shape's parameters override those of its material: ignoring them would change the picture.
fn refuse_material_overrides(parameters: &Parameters) -> Result<()> {
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
    match NAMES.iter().find_map(|name| parameters.given(name)) {
        None => Ok(()),
        Some(parameter) => {
            Err(Problem::at(parameter.span, "material parameters on a shape are not supported")
                .label("expected in the Material"))
        }
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

fn triangle_mesh(parameters: &Parameters, span: Span) -> Result<Source> {
    let positions = points(parameters, span)?;
    let triangles: Vec<[u32; 3]> = indices(parameters, positions.len(), span)?;
    let normals = vectors(parameters, "N", &[ParameterType::Normal3], positions.len())?;
    let uvs = uvs(parameters, positions.len())?;
    // Tangents matter to anisotropic materials and hair, faces to Ptex.
    parameters.accept(&["S", "faceIndices"]);
    Ok(Source::Mesh(Rc::new(SourceMesh { positions, normals, uvs, triangles })))
}

fn points(parameters: &Parameters, span: Span) -> Result<Vec<[f64; 3]>> {
    match parameters.typed("P", &[ParameterType::Point3])? {
        Some(parameter) => Ok(groups(parameter.numbers())),
        None => Err(Problem::at(span, "a mesh without vertices").label("expected \"point3 P\"")),
    }
}

fn groups<const N: usize>(numbers: &[f64]) -> Vec<[f64; N]> {
    numbers.as_chunks::<N>().0.to_vec()
}

/// Indices in groups of `N`; none are needed for exactly one group of vertices.
fn indices<const N: usize>(parameters: &Parameters, vertices: usize, span: Span) -> Result<Vec<[u32; N]>> {
    let Some(values) = parameters.integers("indices")? else {
        if vertices == N {
            return Ok(vec![std::array::from_fn(|i| i as u32)]);
        }
        return Err(Problem::at(span, format!("a mesh of {vertices} vertices without indices"))
            .label(format!("expected \"integer indices\" (or exactly {N} vertices)")));
    };
    let place = |i: usize| parameters.find("indices").map_or(Place::Nowhere, |p| p.place(i));
    if !values.len().is_multiple_of(N) {
        return Err(Problem::new(
            place(values.len() - values.len() % N),
            format!("{} indices", values.len()),
        )
        .label(format!("expected a multiple of {N}; the indices from here on are left over")));
    }
    if let Some(i) = values.iter().position(|&value| usize::try_from(value).map_or(true, |v| v >= vertices)) {
        return Err(Problem::new(place(i), format!("index {} is out of range", values[i]))
            .label(format!("expected 0 to {}: there are {vertices} vertices", vertices.saturating_sub(1))));
    }
    Ok(values.as_chunks::<N>().0.iter().map(|group| group.map(|value| value as u32)).collect())
}

fn one_per_vertex(parameter: &Parameter, count: usize, vertices: usize) -> Result<()> {
    if count == vertices {
        return Ok(());
    }
    Err(Problem::at(parameter.span, format!("\"{}\" has {count} values", shorten(&parameter.name)))
        .label(format!("expected one for each of {vertices} vertices")))
}

fn vectors(
    parameters: &Parameters,
    name: &'static str,
    types: &[ParameterType],
    vertices: usize,
) -> Result<Vec<[f64; 3]>> {
    let Some(parameter) = parameters.typed(name, types)? else {
        return Ok(Vec::new());
    };
    let values = groups(parameter.numbers());
    one_per_vertex(parameter, values.len(), vertices)?;
    Ok(values)
}

/// Texture coordinates: `point2 uv`, v3 also `float uv` and `st`.
fn uvs(parameters: &Parameters, vertices: usize) -> Result<Vec<[f64; 2]>> {
    let types = [ParameterType::Point2, ParameterType::Float, ParameterType::Vector2];
    for name in ["uv", "st"] {
        let Some(parameter) = parameters.typed(name, &types)? else {
            continue;
        };
        let values = groups(parameter.numbers());
        if !parameter.numbers().len().is_multiple_of(2) {
            return Err(parameter
                .problem("an odd number of texture coordinates")
                .label("expected two for each vertex"));
        }
        one_per_vertex(parameter, values.len(), vertices)?;
        return Ok(values);
    }
    Ok(Vec::new())
}

/// Whether four corners, in order around, are a plane convex quadrilateral.
fn is_plane_and_convex(corners: [DVec3; 4]) -> bool {
    let edge = |i: usize| corners[(i + 1) % 4] - corners[i];
    let size = (0..4).map(|i| edge(i).length()).fold(0.0, f64::max);
    // Twice the area, with the direction of the plane's normal.
    let normal = (corners[2] - corners[0]).cross(corners[3] - corners[1]);
    let Some(unit) = normal.try_normalize() else {
        return false;
    };
    let plane = (1..4).all(|i| (corners[i] - corners[0]).dot(unit).abs() <= PLANAR * size);
    let convex = (0..4).all(|i| edge(i).cross(edge((i + 1) % 4)).dot(unit) >= -PLANAR * size * size);
    plane && convex
}

fn world_positions(source: &SourceMesh, transform: &DAffine3, span: Span) -> Result<Vec<[f32; 3]>> {
    let to_world = |p: &[f64; 3]| transform.transform_point3(DVec3::from_array(*p)).as_vec3();
    let positions: Vec<[f32; 3]> = source.positions.iter().map(|p| to_world(p).to_array()).collect();
    match positions.iter().flatten().all(|c| c.is_finite()) {
        true => Ok(positions),
        false => Err(Problem::at(span, "a vertex is too far away").label("expected coordinates below 3e38")),
    }
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

fn has_area(positions: &[[f32; 3]], triangle: &[u32; 3]) -> bool {
    let [a, b, c] = triangle.map(|i| DVec3::from_array(positions[i as usize].map(f64::from)));
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

    #[test]
    fn plane_quads_are_told_from_others() {
        let quad = |points: [[f64; 3]; 4]| is_plane_and_convex(points.map(DVec3::from_array));
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(quad(square));
        assert!(quad(square.map(|p| p.map(|c| c * 1e-20))));
        let mut bent = square;
        bent[2][2] = 0.1;
        assert!(!quad(bent));
        let mut dented = square;
        dented[2] = [0.2, 0.2, 0.0];
        assert!(!quad(dented));
        assert!(!quad([square[0], square[2], square[1], square[3]]));
    }
}
