//! Surfaces that are not everywhere there: what a ray passes through.
//!
//! A shape may have an opacity, which is a texture. A ray that meets it where it is not there goes on from the point behind
//! it. Trees know nothing of it: rays are traced once more from where they passed, and scenes without such shapes have
//! none of this.

use crate::intersect::{Accelerator, Closest, Hit, TraversalStack};
use crate::isa::{Isa, Kernel};
use crate::lanes::{Real, Uint};
use crate::math::Vec3;
use crate::queue::{HitQueue, PathQueue, ShadowQueue, SlotTable};
use crate::sampler::mix;
use crate::scene::{MISS, Scene};
use crate::shade::surface::Surface;
use crate::texture::opacity;
use core::num::Wrapping;
use core::ops::Range;

/// What a ray is for: opacities can differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// A path goes on where it ends.
    ByPaths,
    /// It looks for what is between a point and a light.
    ByLight,
}

/// Surfaces that a ray passes at most; what comes behind them is not seen.
const MOST: u32 = 10_000;

/// The kernel: the first hit of a ray that is there, from the first of all.
pub struct Pass<'a, A> {
    /// Scene.
    pub scene: &'a Scene,
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// Where the ray starts.
    pub origin: [f32; 3],
    /// Its unit direction.
    pub direction: [f32; 3],
    /// Its first hit.
    pub hit: Hit,
    /// How far to look.
    pub distance: f32,
    /// What the ray is for.
    pub seen: Seen,
    /// Scratch.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for Pass<'_, A> {
    type Output = Hit;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> Hit {
        let Pass { scene, accelerator, origin, direction, mut hit, distance, seen, stack } = self;
        let geometry = scene.geometry();
        let mut start = origin;
        let mut behind = 0.0f32;
        for passed in 0..MOST {
            if hit.primitive == MISS || behind + hit.t > distance {
                return Hit::none(f32::INFINITY);
            }
            if !geometry.is_cutout(hit.primitive) {
                return Hit { t: behind + hit.t, ..hit };
            }
            let splat = |v: [f32; 3]| Vec3::<I::One>::splat(v);
            let barycentric = (I::One::splat(hit.u), I::One::splat(hit.v));
            let primitive = <I::One as Real>::Uint::splat(hit.primitive);
            // SAFETY: what was hit is a primitive of the scene.
            let surface = unsafe {
                let (origin, direction) = (splat(start), splat(direction));
                Surface::new(geometry, primitive, origin, direction, I::One::splat(hit.t), || barycentric)
            };
            let (opacity, certain) = opacity(scene, hit.primitive, &surface, barycentric, seen);
            let there = if certain {
                opacity != 0.0
            } else {
                opacity >= 1.0 || opacity > chance(origin, direction, hit.primitive, passed)
            };
            if there {
                return Hit { t: behind + hit.t, ..hit };
            }
            start = surface.leave(splat(direction)).lane(0);
            behind = (splat(start) - splat(origin)).dot(splat(direction)).to_array()[0];
            hit = isa.run(Closest { accelerator, origin: start, direction, stack });
        }
        Hit::none(f32::INFINITY)
    }
}

/// A number in \[0, 1) that follows from a ray and what it meets: the same in all engines.
#[inline(always)]
fn chance(origin: [f32; 3], direction: [f32; 3], primitive: u32, passed: u32) -> f32 {
    let mut state = Wrapping(primitive ^ passed << 27);
    for x in origin.into_iter().chain(direction) {
        state = mix(state ^ Wrapping(x.to_bits()));
    }
    f32::unit_from_bits(state)
}

/// The kernel: replaces those of some hits that are on surfaces that are not there.
pub struct PassAll<'a, A> {
    /// Scene.
    pub scene: &'a Scene,
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// The rays.
    pub paths: &'a PathQueue,
    /// Places of those to look at.
    pub range: Range<usize>,
    /// Their hits.
    pub hits: &'a mut HitQueue,
    /// Scratch.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for PassAll<'_, A> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        let PassAll { scene, accelerator, paths, range, hits, stack } = self;
        for i in range {
            let primitive = hits.primitive[i];
            if primitive == MISS || !scene.geometry().is_cutout(primitive) {
                continue;
            }
            let (origin, direction) = paths.ray(i);
            let hit = Hit { t: hits.t[i], primitive, u: hits.u[i], v: hits.v[i] };
            let (distance, seen) = (f32::INFINITY, Seen::ByPaths);
            let hit = isa.run(Pass { scene, accelerator, origin, direction, hit, distance, seen, stack });
            hits.put(i, hit);
        }
    }
}

/// Is there anything within `distance` along a ray that does not let light pass?
pub struct Blocked<'a, A> {
    /// Scene.
    pub scene: &'a Scene,
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// Where the ray starts.
    pub origin: [f32; 3],
    /// Its unit direction.
    pub direction: [f32; 3],
    /// How far to look.
    pub distance: f32,
    /// Scratch.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for Blocked<'_, A> {
    type Output = bool;
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) -> bool {
        let Blocked { scene, accelerator, origin, direction, distance, stack } = self;
        let hit = isa.run(Closest { accelerator, origin, direction, stack });
        let seen = Seen::ByLight;
        let hit = isa.run(Pass { scene, accelerator, origin, direction, hit, distance, seen, stack });
        hit.primitive != MISS
    }
}

/// The kernel: shadow rays in scenes with such surfaces.
pub struct ShadowsPast<'a, A> {
    /// Scene.
    pub scene: &'a Scene,
    /// What rays are traced through.
    pub accelerator: &'a A,
    /// The rays.
    pub shadows: &'a ShadowQueue,
    /// Receives the radiance.
    pub slots: &'a mut SlotTable,
    /// Scratch.
    pub stack: &'a mut TraversalStack,
}

impl<A: Accelerator> Kernel for ShadowsPast<'_, A> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self, isa: I) {
        let ShadowsPast { scene, accelerator, shadows, slots, stack } = self;
        for i in 0..shadows.len {
            let (origin, direction, distance) = shadows.ray(i);
            if !isa.run(Blocked { scene, accelerator, origin, direction, distance, stack }) {
                slots.add_shadow(shadows, i);
            }
        }
    }
}
