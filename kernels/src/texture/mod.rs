//! Stage `texture`: parameters of materials that are not the same everywhere.
//!
//! | file | what it holds |
//! |---|---|
//! | this one | the stage: a row of parameters for each path on a textured material |
//! | `table.rs` | what a scene gives: textures that refer to each other, and pictures |
//! | `program.rs` | for each textured material, the textures that it needs in the order in which they are evaluated |
//! | `mapping.rs` | from a point of a surface to texture coordinates |
//! | `pattern.rs` | checks, dots, noise |
//! | `relief.rs` | normals that textures turn |
//! | `image.rs` | pictures, and how they are looked up |
//!
//! A texture never reaches a kernel of a material. For each path the stage copies the row of the path's material, writes
//! the values of its textures into the columns that they give (kept to the range of the parameter), derives what follows
//! from them, and the kernel of the material reads that row instead of the one of the table. So every parameter of every
//! material can be textured, and a material's file knows nothing of it.

mod image;
mod mapping;
mod pattern;
mod program;
mod relief;
mod table;

pub use image::{Encoding, Image, ImageParts, Texels, Wrap};
pub use mapping::{Affine, Mapping};
pub(crate) use mapping::{azimuth_turns, polar_angle};
pub use program::Programs;
pub use table::{Checks, Function, MAX_OCTAVES, Sampled, Solid, Texture, TextureTable};

use crate::cutout::Seen;
use crate::isa::{Isa, Kernel, Promise};
use crate::lanes::{Real, Uint};
use crate::math::Vec3;
use crate::queue::{HitQueue, PAD, PathQueue, list_lanes};
use crate::scene::Scene;
use crate::scene::parametrization::coordinates;
use crate::scene::parametrization::tangents;
use crate::shade::surface::Surface;
use program::{evaluate, has_relief, opacity_at, turned_normal};

/// Where textures are evaluated.
#[derive(Clone, Copy)]
pub struct Point<F: Real> {
    /// World position.
    pub position: Vec3<F>,
    /// Shading normal, unit.
    pub normal: Vec3<F>,
    /// Parametric coordinates of the surface.
    pub uv: [F; 2],
    /// Two vectors on the surface that span what a part of a pixel sees of it.
    pub footprint: [Vec3<F>; 2],
}

/// The share of a pixel that textures are filtered over: what an image of many samples needs (pbrt-v4 stops there, too).
const PIXEL_SHARE: f64 = 0.125;

impl<F: Real> Point<F> {
    /// The point of a surface.
    #[inline(always)]
    fn new(scene: &Scene, surface: &Surface<F>, uv: [F; 2]) -> Self {
        let camera = scene.camera();
        let to = surface.point - Vec3::splat(camera.origin());
        // A cone from the camera, cut by the plane of the surface: v - to (v.n) / (to.n) for two vectors v across it.
        let footprint = [cut(camera.right(), to, surface.normal), cut(camera.down(), to, surface.normal)];
        Point { position: surface.point, normal: surface.shading_normal, uv, footprint }
    }
}

/// A step of a pixel along the cone around `to`, cut by the plane across `normal`.
#[inline(always)]
fn cut<F: Real>(step: [f32; 3], to: Vec3<F>, normal: Vec3<F>) -> Vec3<F> {
    let (step, length2) = (Vec3::splat(step), to.length2());
    let across = to.mul_add(-(step.dot(to) / length2), step).scale(length2.sqrt() * F::lit(PIXEL_SHARE));
    to.mul_add(-(across.dot(normal) / normal.dot(to)), across)
}

/// Rows of parameters of some paths, one after the other: [`PIECE`] of them.
#[derive(Clone, Debug, Default)]
pub struct TexturedRows {
    rows: Vec<f32>,
    /// Shading normals, a column a coordinate; empty if no texture turns them.
    normals: [Vec<f32>; 3],
    /// Places in the list, in the order of their programs.
    order: Vec<u32>,
    /// For each program, how many paths it has, and then where they go on; zeros between calls.
    counts: Vec<u32>,
    /// Programs of the paths.
    programs: Vec<u32>,
}

/// What the kernel of a material reads of the paths of a piece.
#[derive(Clone, Copy, Debug)]
pub struct TexturedPiece<'a> {
    /// Rows of parameters.
    pub rows: &'a [f32],
    /// Columns of shading normals, where textures turn some.
    pub normals: Option<[&'a [f32]; 3]>,
}

/// Most paths at a time.
pub const PIECE: usize = crate::queue::SHADOW_RAYS;

impl TexturedRows {
    /// Room for the materials of a scene: none if it has no textures.
    pub fn new(scene: &Scene) -> Self {
        let programs = scene.programs();
        if programs.is_empty() {
            return TexturedRows::default();
        }
        TexturedRows {
            rows: vec![0.0; (PIECE + PAD) * programs.widest()],
            normals: [0; 3].map(|_| vec![0.0; if programs.have_reliefs() { PIECE + PAD } else { 0 }]),
            order: vec![0; PIECE],
            counts: vec![0; programs.len()],
            programs: vec![0; PIECE],
        }
    }
    /// The rows, as [`EvaluateTextures`] left them.
    #[inline(always)]
    pub fn piece(&self) -> TexturedPiece<'_> {
        let [x, y, z] = &self.normals;
        TexturedPiece { rows: &self.rows, normals: (!x.is_empty()).then_some([x, y, z]) }
    }
    /// Bytes that a worker needs of them.
    pub fn bytes(scene: &Scene) -> usize {
        let rows = TexturedRows::new(scene);
        size_of_val(&rows.rows[..])
            + 3 * size_of_val(&rows.normals[0][..])
            + 4 * (rows.order.len() + rows.counts.len() + rows.programs.len())
    }
}

/// The kernel: the rows of the paths of a list, which are on materials of one class.
///
/// Promise: the queues are as long as their `new` made them; `list` holds at most [`PIECE`] places of `paths`, each of
/// which has a hit on a primitive of the scene of a class some of whose materials are textured; `rows` was made for the
/// scene; hits have barycentric weights.
pub struct EvaluateTextures<'a> {
    /// Scene.
    pub scene: &'a Scene,
    /// Places in `paths`.
    pub list: &'a [u32],
    /// Paths that arrive.
    pub paths: &'a PathQueue,
    /// Where they arrive.
    pub hits: &'a HitQueue,
    /// Receives a row for each place of `list`, in its order.
    pub rows: &'a mut TexturedRows,
    /// See there.
    pub promise: Promise,
}

impl Kernel for EvaluateTextures<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) {
        textures::<I::Wide>(self.scene, self.list, self.paths, self.hits, self.rows);
    }
}

#[inline(always)]
fn textures<F: Real>(scene: &Scene, list: &[u32], paths: &PathQueue, hits: &HitQueue, to: &mut TexturedRows) {
    let programs = scene.programs();
    let n = list.len();
    // Paths on one material go through one program together: a counting sort, over the programs that occur.
    let TexturedRows { rows, normals, order, counts, programs: of_path } = to;
    let (order, of_path) = (&mut order[..n], &mut of_path[..n]);
    let mut first = u32::MAX;
    let mut alike = true;
    for (program, &place) in of_path.iter_mut().zip(list) {
        // Of mixtures, the hits know what was chosen.
        let tag = match hits.material.get(place as usize) {
            Some(&material) => material,
            None => scene.geometry().tags()[hits.primitive[place as usize] as usize],
        };
        *program = programs.of(scene.row_of(tag));
        first = if first == u32::MAX { *program } else { first };
        alike &= *program == first;
        counts[*program as usize] += 1;
    }
    if alike {
        order.iter_mut().enumerate().for_each(|(k, place)| *place = k as u32);
        if n > 0 {
            counts[first as usize] = 0;
        }
    } else {
        let mut start = 0;
        for &program in of_path.iter() {
            let count = &mut counts[program as usize];
            // The upper bit says that it is no longer a number of paths, but the place of the next one.
            if *count & 1 << 31 == 0 {
                let next = start + *count;
                *count = 1 << 31 | start;
                start = next;
            }
        }
        for (k, &program) in of_path.iter().enumerate() {
            let next = &mut counts[program as usize];
            order[(*next & !(1 << 31)) as usize] = k as u32;
            *next += 1;
        }
        for &program in of_path.iter() {
            counts[program as usize] = 0;
        }
    }
    let mut start = 0;
    while start < n {
        let program = of_path[order[start] as usize];
        let mut end = start + 1;
        while end < n && of_path[order[end] as usize] == program {
            end += 1;
        }
        let group = &order[start..end];
        let mut at = 0;
        while at < group.len() {
            let (position, count) = list_lanes::<F>(group, at);
            // SAFETY: positions are below the length of the list, which holds places of paths with hits on primitives of
            // the scene.
            let (point, surface, primitive) = unsafe {
                let place = F::Uint::gather(list, position);
                let real = |column: &[f32]| F::gather(column, place);
                let primitive = F::Uint::gather(&hits.primitive, place);
                let barycentric = (real(&hits.u), real(&hits.v));
                let surface = Surface::new(
                    scene.geometry(),
                    primitive,
                    Vec3::new(real(&paths.origin_x), real(&paths.origin_y), real(&paths.origin_z)),
                    Vec3::new(real(&paths.direction_x), real(&paths.direction_y), real(&paths.direction_z)),
                    real(&hits.t),
                    || barycentric,
                );
                let uv = coordinates(scene.geometry(), primitive, surface.point, barycentric);
                (Point::new(scene, &surface, uv), surface, primitive)
            };
            if !normals[0].is_empty() {
                let mut normal = surface.shading_normal;
                if has_relief(scene, program) {
                    // SAFETY: as above.
                    let tangents = unsafe { tangents(scene.geometry(), primitive, &surface) };
                    normal = turned_normal(scene, program, &point, &surface, &tangents);
                }
                let values = [normal.x.to_array(), normal.y.to_array(), normal.z.to_array()];
                for (column, values) in normals.iter_mut().zip(&values) {
                    for (lane, &position) in group[at..at + count].iter().enumerate() {
                        column[position as usize] = values[lane];
                    }
                }
            }
            evaluate::<F>(scene, program, &point, &group[at..at + count], rows);
            at += count;
        }
        start = end;
    }
}

/// Most numbers of a row.
pub const WIDEST: usize = 64;

/// The kernel of one path: the row of a material at a point. The lane type is that of the caller.
pub struct EvaluateOne<'a, F: Real<Uint = core::num::Wrapping<u32>>> {
    /// Scene.
    pub scene: &'a Scene,
    /// Primitive that was met.
    pub primitive: u32,
    /// Row of its material: of a class some of whose materials are textured.
    pub material: u32,
    /// Where.
    pub surface: Surface<F>,
    /// Barycentric weights of the second and third corner.
    pub barycentric: [f32; 2],
    /// Receives the row.
    pub row: &'a mut [f32; WIDEST],
}

impl<F: Real<Uint = core::num::Wrapping<u32>>> Kernel for EvaluateOne<'_, F> {
    /// The shading normal.
    type Output = Vec3<F>;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> Vec3<F> {
        let EvaluateOne { scene, primitive, material, surface, barycentric: [u, v], row } = self;
        let barycentric = (F::splat(u), F::splat(v));
        assert!((primitive as usize) < scene.geometry().primitives());
        let program = scene.programs().of(material);
        // SAFETY: the primitive exists.
        let uv =
            unsafe { coordinates(scene.geometry(), F::Uint::splat(primitive), surface.point, barycentric) };
        let point = Point::new(scene, &surface, uv);
        evaluate::<F>(scene, program, &point, &[0], row);
        if !has_relief(scene, program) {
            return surface.shading_normal;
        }
        // SAFETY: as above.
        let tangents = unsafe { tangents(scene.geometry(), F::Uint::splat(primitive), &surface) };
        turned_normal(scene, program, &point, &surface, &tangents)
    }
}

/// How much of a primitive that may not be everywhere there is there at a point; and whether it is there wherever that is
/// not 0, instead of by chance.
#[inline(always)]
pub(crate) fn opacity<F: Real>(
    scene: &Scene,
    primitive: u32,
    surface: &Surface<F>,
    barycentric: (F, F),
    seen: Seen,
) -> (f32, bool) {
    let geometry = scene.geometry();
    let parametrization = geometry.parametrization_of(primitive);
    // SAFETY: a primitive that has a parametrization exists.
    let uv = unsafe { coordinates(geometry, F::Uint::splat(primitive), surface.point, barycentric) };
    let (opacity, certain) = opacity_at(scene, parametrization, &Point::new(scene, surface, uv), seen);
    (opacity.to_array()[0], certain)
}
