//! The formulas that cases look at one by one: the kernels' own, or others in their place.
//!
//! A battery that cannot fail shows nothing. Its tests put textbook formulas here, and each is caught by a case.

use wavepath_kernels::intersect::bvh8::Bvh8;
use wavepath_kernels::intersect::{Accelerator, Closest};
use wavepath_kernels::isa::Level;
use wavepath_kernels::lanes::Uint;
use wavepath_kernels::math::Vec3;
use wavepath_kernels::scene::lights::{self, AllLights};
use wavepath_kernels::scene::{Geometry, MISS};
use wavepath_kernels::shade::surface::Surface;

/// A ray: origin, unit direction.
pub type Ray = ([f32; 3], [f32; 3]);

/// Functions that stand for the kernels' formulas.
#[derive(Clone, Copy, Debug)]
pub struct Formulas {
    /// Density over solid angle with which directions to a sphere of this radius are sampled from this distance.
    pub cone_density: fn(radius: f32, distance: f32) -> f32,
    /// For each ray, whether it meets a triangle of the geometry.
    pub meets: fn(&Geometry, &[Ray]) -> Vec<bool>,
    /// Where a ray that leaves a surface starts: the primitive, the ray that came, its distance, the direction to go.
    pub leave: fn(&Geometry, u32, Ray, f32, [f32; 3]) -> [f32; 3],
    /// Polar angle of the point at height `z` on a sphere of this radius.
    pub polar_angle: fn(z: f64, radius: f64) -> f64,
}

impl Default for Formulas {
    fn default() -> Self {
        Formulas { cone_density, meets, leave, polar_angle: wavepath_kernels::scene::shapes::polar_angle }
    }
}

fn cone_density(radius: f32, distance: f32) -> f32 {
    // The lamp is at the origin: tables of a scene that is far from it are moved there.
    let scene = super::text::lit(&super::text::sphere([0.0; 3], radius.into()));
    // SAFETY: the scene has one light.
    let light = unsafe { scene.tables().lights().row::<f32>(Uint::splat(0)) };
    let (below, up) = (Vec3::new(0.0, 0.0, -distance), Vec3::new(0.0, 0.0, 1.0));
    lights::pdf::<f32, AllLights>(&light, below, up, distance - radius, -up)
}

fn meets(geometry: &Geometry, rays: &[Ray]) -> Vec<bool> {
    let tree = Bvh8::new(geometry);
    let (mut stack, level) = (tree.stack(), Level::detect());
    let met = |&(origin, direction): &Ray| {
        level.run(Closest { accelerator: &tree, origin, direction, stack: &mut stack }).primitive != MISS
    };
    rays.iter().map(met).collect()
}

fn leave(geometry: &Geometry, primitive: u32, ray: Ray, t: f32, direction: [f32; 3]) -> [f32; 3] {
    assert!((primitive as usize) < geometry.primitives());
    let vector = |v: [f32; 3]| Vec3::<f32>::splat(v);
    // SAFETY: the primitive exists.
    let surface = unsafe {
        Surface::new(geometry, Uint::splat(primitive), vector(ray.0), vector(ray.1), t, || (0.0, 0.0))
    };
    surface.leave(vector(direction)).lane(0)
}
