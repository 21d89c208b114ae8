//! What is done for a path on a textured material: which textures are evaluated, in which order, and where their values
//! go.
//!
//! A program is a list of steps over a few registers, a colour a lane each. Textures that several others use are
//! evaluated once; a register is free again once its value was used for the last time.

use super::image::{Lookup, sample};
use super::mapping::floor;
use super::pattern::{in_dot, is_first, log2, solid};
use super::table::{Function, Texture, TextureTable};
use super::{Point, relief};
use crate::cutout::Seen;
use crate::lanes::{Real, map3};
use crate::math::{Rgb, Vec3};
use crate::scene::parametrization::{Opacity, Tangents};
use crate::scene::{BuildError, Scene};
use crate::shade::materials::{MaterialClass, MaterialHandle, MaterialTable, Relief};
use crate::shade::parameters::{Range, TextureId, TexturedColumns};
use crate::shade::surface::Surface;

/// Values that can be kept at a time.
const REGISTERS: usize = 16;

/// A step.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// Evaluates a texture.
    Evaluate { texture: u32, inputs: [u8; 3], output: u8 },
    /// Writes a value into columns of the row, kept to the range of the parameter.
    Store { register: u8, column: u32, width: u32, range: Range },
}

/// The steps of a material.
#[derive(Clone, Debug)]
struct Program {
    steps: core::ops::Range<usize>,
    /// The row of the material: what its textures do not give.
    row: usize,
    width: usize,
    /// Computes the columns that follow from others.
    derive: Option<fn(&mut [f32])>,
    /// What turns the normal.
    relief: Option<Value>,
}

/// Steps that compute one value.
#[derive(Clone, Debug)]
struct Value {
    steps: core::ops::Range<usize>,
    register: u8,
    /// It is a normal, not a height.
    is_normal: bool,
}

/// How much of a shape is there.
#[derive(Clone, Debug)]
struct Opaque {
    for_paths: Option<Value>,
    for_light: Option<Value>,
    certain: bool,
}

/// The programs of all materials of the classes some of whose materials are textured.
#[derive(Clone, Debug, Default)]
pub struct Programs {
    steps: Vec<Step>,
    programs: Vec<Program>,
    /// Number of the program of each row, by the place of its first number; none without textures.
    of_row: Vec<u32>,
    classes: [bool; MaterialClass::COUNT],
    widest: usize,
    /// Some of them turn normals.
    reliefs: bool,
    /// By parametrization; empty if everything is there.
    opacities: Vec<Option<Opaque>>,
}

impl Programs {
    /// The programs of a scene.
    ///
    /// # Errors
    /// If a material refers to a texture that does not exist, or one needs more values at a time than there is room for.
    pub(crate) fn new(
        materials: &MaterialTable,
        opacities: &[Option<Opacity>],
        textures: &TextureTable,
    ) -> Result<Self, BuildError> {
        let mut programs = Programs::default();
        let exists = |of: &'static str, id: usize, texture: TextureId| {
            crate::scene::exists(of, id, "texture", texture.0 as usize, textures.textures().len())
        };
        for (id, opacity) in opacities.iter().enumerate() {
            let opaque = match opacity {
                None => None,
                Some(Opacity { for_paths, for_light, certain }) => {
                    let mut value = |texture: Option<TextureId>| match texture {
                        None => Ok(None),
                        Some(texture) => {
                            exists("parametrization", id, texture)?;
                            programs.value(textures, texture, false).map(Some)
                        }
                    };
                    let (for_paths, for_light) = (value(*for_paths)?, value(*for_light)?);
                    Some(Opaque { for_paths, for_light, certain: *certain })
                }
            };
            programs.opacities.push(opaque);
        }
        for (handle, relief) in materials.reliefs() {
            exists("material at row", handle.row as usize, relief.texture())?;
            programs.classes[handle.class as usize] = true;
            programs.reliefs = true;
        }
        for (handle, columns) in materials.textured() {
            for column in columns {
                exists("material at row", handle.row as usize, column.texture)?;
            }
            programs.classes[handle.class as usize] |= !columns.is_empty();
        }
        if !programs.classes.contains(&true) {
            return Ok(programs);
        }
        programs.of_row = vec![u32::MAX; materials.numbers()];
        for (handle, columns) in materials.textured() {
            if !programs.classes[handle.class as usize] {
                continue;
            }
            let first = programs.steps.len();
            let mut compiler = Compiler::new(textures, columns.iter().map(|column| column.texture));
            for column in columns {
                let register = compiler.value(column.texture, &mut programs.steps)?;
                let (column, width, range) = (column.column, column.width, column.range);
                programs.steps.push(Step::Store { register, column, width, range });
            }
            let steps = first..programs.steps.len();
            let relief = materials.reliefs().iter().find(|(other, _)| *other == handle);
            let relief = match relief {
                None => None,
                Some((_, relief)) => {
                    let is_normal = matches!(relief, Relief::NormalMap(_));
                    Some(programs.value(textures, relief.texture(), is_normal)?)
                }
            };
            programs.of_row[handle.row as usize] = programs.programs.len() as u32;
            let width = handle.class.width();
            programs.widest = programs.widest.max(width);
            programs.programs.push(Program {
                steps,
                row: handle.row as usize,
                width,
                derive: derived(materials, handle, columns),
                relief,
            });
        }
        Ok(programs)
    }

    /// The steps of one value.
    fn value(
        &mut self,
        textures: &TextureTable,
        texture: TextureId,
        is_normal: bool,
    ) -> Result<Value, BuildError> {
        let first = self.steps.len();
        let mut compiler = Compiler::new(textures, core::iter::once(texture));
        let register = compiler.value(texture, &mut self.steps)?;
        Ok(Value { steps: first..self.steps.len(), register, is_normal })
    }

    /// Do some of them turn normals?
    #[inline(always)]
    pub fn have_reliefs(&self) -> bool {
        self.reliefs
    }
    /// None: the scene has no textured materials?
    pub fn is_empty(&self) -> bool {
        self.programs.is_empty()
    }
    /// How many.
    pub fn len(&self) -> usize {
        self.programs.len()
    }
    /// Are some materials of this class textured?
    #[inline(always)]
    pub fn has_class(&self, class: MaterialClass) -> bool {
        self.classes[class as usize]
    }
    /// Numbers of the longest row.
    pub fn widest(&self) -> usize {
        self.widest
    }
    /// The program of a row.
    #[inline(always)]
    pub(super) fn of(&self, row: u32) -> u32 {
        self.of_row[row as usize]
    }
}

/// What computes the columns of a material that follow from others, if they follow from those that textures give: some are
/// costly, and follow from what is the same everywhere. Which columns they look at is found by trying.
fn derived(
    materials: &MaterialTable,
    handle: MaterialHandle,
    columns: &[TexturedColumns],
) -> Option<fn(&mut [f32])> {
    let derive = handle.class.derive().filter(|_| !columns.is_empty())?;
    let first = handle.row as usize;
    let row_at = |x: f32| {
        let mut row = materials.rows()[first..first + handle.class.width()].to_vec();
        let set = |row: &mut Vec<f32>, x: f32, clamped: bool| {
            for columns in columns {
                let Range { least, most } = columns.range;
                let x = if clamped { x.clamp(least, most) } else { x };
                row[columns.column as usize..][..columns.width as usize].fill(x);
            }
        };
        set(&mut row, x, true);
        derive(&mut row);
        // Only what follows is compared.
        set(&mut row, 0.0, false);
        row.into_iter().map(f32::to_bits).collect::<Vec<_>>()
    };
    let one = row_at(0.03);
    let same = [0.2, 0.5, 0.9].into_iter().all(|x| row_at(x) == one);
    (!same).then_some(derive)
}

/// Turns textures into steps.
struct Compiler<'a> {
    textures: &'a TextureTable,
    /// For each texture that is needed: how often it will still be used, and its register, once it has one.
    uses: std::collections::HashMap<u32, u32>,
    registers: std::collections::HashMap<u32, u8>,
    free: Vec<u8>,
}

impl<'a> Compiler<'a> {
    fn new(textures: &'a TextureTable, roots: impl Iterator<Item = TextureId>) -> Self {
        let mut uses = std::collections::HashMap::new();
        let mut waiting: Vec<u32> = Vec::new();
        let mut seen = std::collections::HashSet::new();
        for TextureId(root) in roots {
            *uses.entry(root).or_insert(0) += 1;
            waiting.push(root);
            while let Some(id) = waiting.pop() {
                if !seen.insert(id) {
                    continue;
                }
                for TextureId(input) in textures.textures()[id as usize].inputs() {
                    *uses.entry(input).or_insert(0) += 1;
                    waiting.push(input);
                }
            }
        }
        Compiler {
            textures,
            uses,
            registers: std::collections::HashMap::new(),
            free: (0..REGISTERS as u8).rev().collect(),
        }
    }

    /// Appends the steps that evaluate a texture, and returns the register in which its value is for the use that asks.
    fn value(&mut self, TextureId(root): TextureId, steps: &mut Vec<Step>) -> Result<u8, BuildError> {
        let mut waiting = vec![root];
        while let Some(&id) = waiting.last() {
            if self.registers.contains_key(&id) {
                waiting.pop();
                continue;
            }
            let texture = &self.textures.textures()[id as usize];
            let missing: Vec<u32> = texture
                .inputs()
                .map(|TextureId(input)| input)
                .filter(|input| !self.registers.contains_key(input))
                .collect();
            if !missing.is_empty() {
                waiting.extend(missing);
                continue;
            }
            waiting.pop();
            let mut inputs = [0; 3];
            for (register, TextureId(input)) in inputs.iter_mut().zip(texture.inputs()) {
                *register = self.registers[&input];
            }
            // The value may take the place of one that it is made of.
            for TextureId(input) in texture.inputs() {
                self.used(input);
            }
            let Some(output) = self.free.pop() else {
                return Err(BuildError::TooMany {
                    what: "values that a texture is made of at a time",
                    found: REGISTERS + 1,
                    limit: REGISTERS,
                });
            };
            self.registers.insert(id, output);
            steps.push(Step::Evaluate { texture: id, inputs, output });
        }
        let register = self.registers[&root];
        self.used(root);
        Ok(register)
    }

    /// A value was used; it is forgotten if that was the last time.
    fn used(&mut self, id: u32) {
        let left = self.uses.get_mut(&id).expect("it was counted");
        *left -= 1;
        if *left == 0 {
            let register = self.registers.remove(&id).expect("it has a value");
            self.free.push(register);
        }
    }
}

/// Writes the rows of a program at some points: lane `i` to the row of number `positions[i]`.
#[inline(always)]
pub(super) fn evaluate<F: Real>(
    scene: &Scene,
    program: u32,
    at: &Point<F>,
    positions: &[u32],
    rows: &mut [f32],
) {
    let (programs, table) = (scene.programs(), scene.textures());
    let Program { steps, row, width, derive, .. } = &programs.programs[program as usize];
    let width = *width;
    let constant = &scene.materials().rows()[*row..*row + width];
    for &position in positions {
        let first = position as usize * width;
        rows[first..first + width].copy_from_slice(constant);
    }
    let mut registers = [Rgb::<F>::zero(); REGISTERS];
    for step in &programs.steps[steps.clone()] {
        match *step {
            Step::Evaluate { .. } => evaluate_step(table, step, at, &mut registers),
            Step::Store { register, column, width: numbers, range } => {
                let value = registers[register as usize % REGISTERS];
                let (least, most) = (F::splat(range.least), F::splat(range.most));
                let channels = [value.r, value.g, value.b];
                for (channel, value) in channels.iter().enumerate().take(numbers as usize) {
                    // A number that is none becomes the least.
                    let value = value.max(least).min(most).to_array();
                    let column = column as usize + channel;
                    for (lane, &position) in positions.iter().enumerate() {
                        rows[position as usize * width + column] = value[lane];
                    }
                }
            }
        }
    }
    if let Some(derive) = derive {
        for &position in positions {
            let first = position as usize * width;
            derive(&mut rows[first..first + width]);
        }
    }
}

/// A step that evaluates a texture. It is in one place in each kernel, as it is large.
#[inline(always)]
fn evaluate_step<F: Real>(
    table: &TextureTable,
    step: &Step,
    at: &Point<F>,
    registers: &mut [Rgb<F>; REGISTERS],
) {
    if let Step::Evaluate { texture, inputs, output } = *step {
        let inputs = map3!(inputs, |i| registers[i as usize % REGISTERS]);
        let texture = &table.textures()[texture as usize];
        registers[output as usize % REGISTERS] = texture_at(table, texture, inputs, at);
    }
}

/// One value at a point.
#[inline(always)]
fn value_at<F: Real>(scene: &Scene, value: &Value, at: &Point<F>) -> Rgb<F> {
    let mut registers = [Rgb::<F>::zero(); REGISTERS];
    for step in &scene.programs().steps[value.steps.clone()] {
        evaluate_step(scene.textures(), step, at, &mut registers);
    }
    registers[value.register as usize % REGISTERS]
}

/// Is the normal of a material turned?
#[inline(always)]
pub(super) fn has_relief(scene: &Scene, program: u32) -> bool {
    scene.programs().programs[program as usize].relief.is_some()
}

/// The normal of a program that turns it.
#[inline(always)]
pub(super) fn turned_normal<F: Real>(
    scene: &Scene,
    program: u32,
    at: &Point<F>,
    surface: &Surface<F>,
    tangents: &Tangents<F>,
) -> Vec3<F> {
    let Some(relief) = &scene.programs().programs[program as usize].relief else {
        return surface.shading_normal;
    };
    if relief.is_normal {
        return relief::mapped(surface, tangents, value_at(scene, relief, at));
    }
    let steps = relief::steps(at, tangents);
    let mut heights = [F::zero(); 3];
    for (k, height) in heights.iter_mut().enumerate() {
        let du = if k == 1 { steps[0] } else { F::zero() };
        let dv = if k == 2 { steps[1] } else { F::zero() };
        *height = value_at(scene, relief, &relief::shifted(at, tangents, [du, dv])).r;
    }
    relief::displaced(surface, tangents, heights, steps)
}

/// How much of a shape is there at a point, and whether that is so but where it is 0 (see [`Opacity::certain`]).
#[inline(always)]
pub(super) fn opacity_at<F: Real>(
    scene: &Scene,
    parametrization: u32,
    at: &Point<F>,
    seen: Seen,
) -> (F, bool) {
    let Some(opaque) = &scene.programs().opacities[parametrization as usize] else {
        return (F::one(), true);
    };
    let value = match seen {
        Seen::ByPaths => &opaque.for_paths,
        Seen::ByLight => &opaque.for_light,
    };
    // No closure: what is not inlined is compiled without the instruction set.
    let opacity = match value {
        Some(value) => value_at(scene, value, at).r,
        None => F::one(),
    };
    (opacity, opaque.certain)
}

/// `a (1 - t) + b t`.
#[inline(always)]
fn mix<F: Real>(a: Rgb<F>, b: Rgb<F>, t: F) -> Rgb<F> {
    let rest = F::one() - t;
    Rgb::new(a.r.mul_add(rest, b.r * t), a.g.mul_add(rest, b.g * t), a.b.mul_add(rest, b.b * t))
}

/// The value of a texture whose inputs are known.
#[inline(always)]
fn texture_at<F: Real>(
    table: &TextureTable,
    texture: &Texture,
    [a, b, c]: [Rgb<F>; 3],
    at: &Point<F>,
) -> Rgb<F> {
    match texture {
        Texture::Constant(value) => Rgb::splat(*value),
        Texture::Product(..) => a * b,
        Texture::Mix { .. } => mix(a, b, c.r),
        Texture::DirectionMix { direction, .. } => mix(b, a, at.normal.dot(Vec3::splat(*direction)).abs()),
        Texture::Checkerboard { checks, .. } => Rgb::select(is_first(checks, at), a, b),
        Texture::Dots { mapping, .. } => Rgb::select(in_dot(mapping.map(at)), a, b),
        Texture::Bilerp { mapping, corners } => {
            let [s, t] = mapping.map(at);
            let [v00, v01, v10, v11] = corners;
            mix(mix(Rgb::splat(*v00), Rgb::splat(*v01), t), mix(Rgb::splat(*v10), Rgb::splat(*v11), t), s)
        }
        Texture::Uv { mapping } => {
            let [s, t] = mapping.map(at);
            Rgb::new(s - floor(s), t - floor(t), F::zero())
        }
        Texture::Image(sampled) => {
            let lookup =
                Lookup { wrap: sampled.wrap, nearest: sampled.nearest, one_number: sampled.one_number };
            let image = &table.images()[sampled.image as usize];
            let value = sample(image, lookup, sampled.mapping.map(at)).scale(F::splat(sampled.scale));
            if sampled.invert {
                let rest = map3!([value.r, value.g, value.b], |x| (F::one() - x).max(F::zero()));
                Rgb::new(rest[0], rest[1], rest[2])
            } else {
                value
            }
        }
        Texture::Solid { solid: which, texture_from_world } => solid(which, texture_from_world, at),
        Texture::Apply(function, _) => {
            let [r, g, b] = map3!([a.r, a.g, a.b], |x| apply(*function, x));
            Rgb::new(r, g, b)
        }
    }
}

#[inline(always)]
fn apply<F: Real>(function: Function, x: F) -> F {
    let (zero, one) = (F::zero(), F::one());
    match function {
        Function::SquareRoot => x.max(zero).sqrt(),
        Function::AlphaV3 => {
            let x = log2(x.max(F::lit(1e-3))) * F::lit(core::f64::consts::LN_2);
            x.mul_add(F::lit(0.000_640_711), F::lit(0.017_120_1))
                .mul_add(x, F::lit(0.1734))
                .mul_add(x, F::lit(0.819_955))
                .mul_add(x, F::lit(1.621_42))
        }
        Function::AbsorptionOfReflectance => {
            let r = x.max(zero).min(F::lit(0.9999));
            F::lit(2.0) * (r / (one - r)).sqrt()
        }
        Function::Unit => x.max(zero).min(one),
    }
}
