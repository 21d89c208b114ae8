//! Shapes that need not be fast: parts of spheres, disks, cylinders, stretched and turned at will. One ray, one surface,
//! in object space and double precision. They are rare; being right counts.
//!
//! To add one: a file beside `cylinder.rs`, and a line in `quadrics!`.

mod cylinder;
mod disk;
mod sphere_part;

pub use cylinder::Cylinder;
pub use disk::Disk;
pub use sphere_part::{SpherePart, polar_angle};

use super::error::{BuildError, finite};
use glam::{DAffine3, DVec3};

/// A surface in object space, part of a whole one that has an equation.
pub trait QuadricSurface {
    /// All its numbers, to be checked.
    fn numbers(&self) -> [f32; 4];
    /// What is wrong with its numbers, which are finite, if anything is.
    fn fault(&self) -> Option<String>;
    /// Distances at which the line `o + t d` meets the whole surface, the nearer one first; NaN where it does not.
    fn distances(&self, o: [f64; 3], d: [f64; 3]) -> [f64; 2];
    /// Is this point of the whole surface there?
    fn holds(&self, p: [f64; 3]) -> bool;
    /// Length in object space below which a hit is the point itself in which the ray starts.
    fn noise(&self) -> f64;
    /// Left side of the surface's equation `g(p) = 0`, and its gradient, which points to the side of the normal.
    fn equation(&self, p: [f64; 3]) -> (f64, [f64; 3]);
    /// Corners of a box around the part that is there: lowest, highest.
    fn bounds(&self) -> ([f32; 3], [f32; 3]);
    /// The part that is there, drawn over the unit square; the second number goes around.
    fn point(&self, u: f64, v: f64) -> DVec3;
}

/// The table: name, struct.
macro_rules! quadrics {
    ($use:ident) => {
        $use! {
            /// Part of a sphere around the origin.
            Sphere SpherePart;
            /// Disk, or part of a ring, in a plane across the z axis.
            Disk Disk;
            /// Open cylinder around the z axis, or part of one.
            Cylinder Cylinder;
        }
    };
}

macro_rules! forms {
    ($($(#[doc = $doc:literal])* $name:ident $form:ident;)*) => {
        /// Which surface in object space, and how it is clipped. Angles in radians.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum QuadricForm {
            $($(#[doc = $doc])* $name($form),)*
        }

        impl QuadricForm {
            /// The surface, whichever it is.
            #[inline]
            fn surface(&self) -> &dyn QuadricSurface {
                match self {
                    $(QuadricForm::$name(form) => form,)*
                }
            }
        }
    };
}
quadrics!(forms);

/// Is the azimuth of a point at most `phi_max`?
fn azimuth_within(p: [f64; 3], phi_max: f32) -> bool {
    phi_max >= core::f32::consts::TAU || p[1].atan2(p[0]).rem_euclid(core::f64::consts::TAU) <= phi_max as f64
}

/// A surface of [`QuadricForm`] in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quadric {
    /// World to object space, three rows of four.
    object_from_world: [[f32; 4]; 3],
    /// Origin of object space in the world.
    centre: [f32; 3],
    form: QuadricForm,
    /// Negates the normal.
    flip_normal: bool,
}

impl Quadric {
    /// A surface, brought into the world by a transform.
    ///
    /// # Errors
    /// If a number is not finite or out of its range, or the transform cannot be inverted in single precision.
    pub fn new(
        form: QuadricForm,
        world_from_object: &DAffine3,
        flip_normal: bool,
    ) -> Result<Self, BuildError> {
        let wrong = |what: String| BuildError::Number { of: "quadric", id: 0, what };
        finite("quadric", 0, "a number of its form", &form.surface().numbers())?;
        if let Some(what) = form.surface().fault() {
            return Err(wrong(what));
        }
        let inverse = world_from_object.inverse();
        let rows = inverse.matrix3.transpose();
        let t = inverse.translation;
        let row = |r: DVec3, t: f64| [r.x as f32, r.y as f32, r.z as f32, t as f32];
        let quadric = Quadric {
            object_from_world: [row(rows.x_axis, t.x), row(rows.y_axis, t.y), row(rows.z_axis, t.z)],
            centre: world_from_object.translation.as_vec3().into(),
            form,
            flip_normal,
        };
        let (low, high) = quadric.bounds();
        let numbers = [quadric.object_from_world.as_flattened(), &quadric.centre, &low, &high].concat();
        if numbers.iter().any(|x| !x.is_finite()) {
            return Err(wrong("its transform cannot be inverted, or takes it too far away".into()));
        }
        Ok(quadric)
    }

    /// Which surface.
    pub fn form(&self) -> QuadricForm {
        self.form
    }

    /// The nearest distance in (0, t_max] at which a ray meets the surface.
    pub fn intersect(&self, origin: [f32; 3], direction: [f32; 3], t_max: f32) -> Option<f32> {
        let m = self.object_from_world.map(|row| row.map(f64::from));
        let row =
            |i: usize, v: [f32; 3]| m[i][0] * v[0] as f64 + m[i][1] * v[1] as f64 + m[i][2] * v[2] as f64;
        let o: [f64; 3] = core::array::from_fn(|i| row(i, origin) + m[i][3]);
        let d: [f64; 3] = core::array::from_fn(|i| row(i, direction));
        let surface = self.form.surface();
        let noise = surface.noise() / d.iter().map(|x| x * x).sum::<f64>().sqrt();
        let meets = |t: f64| {
            // A ray that starts on the surface meets it at a distance of about 0, which is not a hit.
            t > noise
                && (t as f32) > 0.0
                && t as f32 <= t_max
                && surface.holds(core::array::from_fn(|i| o[i] + t * d[i]))
        };
        surface.distances(o, d).into_iter().find(|&t| meets(t)).map(|t| t as f32)
    }

    /// Corners of a box in the world around the surface: lowest, highest.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let (a, b) = self.form.surface().bounds();
        let m = self.object_from_world;
        let object_from_world =
            DAffine3::from_cols_array_2d(&core::array::from_fn(|c| core::array::from_fn(|r| m[r][c] as f64)));
        let world_from_object = object_from_world.inverse();
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for corner in 0..8 {
            let pick = |k: usize| if corner >> k & 1 == 0 { a[k] } else { b[k] } as f64;
            let p = world_from_object.transform_point3(DVec3::new(pick(0), pick(1), pick(2))).as_vec3();
            for k in 0..3 {
                // Not `min`, which would hide what is no number.
                low[k] = if p[k] > low[k] { low[k] } else { p[k] };
                high[k] = if p[k] < high[k] { high[k] } else { p[k] };
            }
        }
        (low, high)
    }

    /// The point of the surface nearest to `p` (which is near), its oriented unit normal, and how far off it rays start: more
    /// than rounding may move along the normal.
    pub fn surface(&self, p: [f32; 3]) -> ([f32; 3], [f32; 3], f32) {
        let m = self.object_from_world.map(|row| row.map(f64::from));
        let mut q = p.map(f64::from);
        let mut normal = [0.0; 3];
        // Two Newton steps onto the surface, along the normal.
        for _ in 0..2 {
            let local: [f64; 3] =
                core::array::from_fn(|i| m[i][0] * q[0] + m[i][1] * q[1] + m[i][2] * q[2] + m[i][3]);
            // The world gradient is the transposed matrix times that of object space.
            let (g, gradient) = self.form.surface().equation(local);
            let world: [f64; 3] = core::array::from_fn(|k| (0..3).map(|i| m[i][k] * gradient[i]).sum());
            let length2 = world.iter().map(|x| x * x).sum::<f64>();
            let step = if length2 > 0.0 { g / length2 } else { 0.0 };
            q = core::array::from_fn(|k| q[k] - step * world[k]);
            normal = world.map(|x| x / length2.sqrt());
        }
        let sign = if self.flip_normal { -1.0 } else { 1.0 };
        // The point and the start of a ray are rounded; distances are not.
        let rounding = (0..3).map(|k| (q[k] * normal[k]).abs()).sum::<f64>() * f32::EPSILON as f64;
        let size =
            (0..3).map(|k| (self.centre[k] as f64).abs() + (q[k] - self.centre[k] as f64).abs()).sum::<f64>();
        let error = 4.0 * rounding + 1e-12 * size;
        (q.map(|x| x as f32), normal.map(|x| (sign * x) as f32), error as f32)
    }
}

impl QuadricForm {
    /// Area in the world, by the midpoint rule: for `power` and for choosing lights, where a thousandth does not matter.
    pub fn area(&self, world_from_object: &DAffine3) -> f64 {
        const N: usize = 256;
        let surface = self.surface();
        let corner = |i: usize, j: usize| {
            world_from_object.transform_point3(surface.point(i as f64 / N as f64, j as f64 / N as f64))
        };
        let mut area = 0.0;
        for i in 0..N {
            for j in 0..N {
                let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i, j + 1), corner(i + 1, j + 1));
                area += 0.5 * (d - a).cross(c - b).length();
            }
        }
        area
    }
}
