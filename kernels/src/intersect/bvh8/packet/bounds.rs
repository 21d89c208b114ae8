//! What bounds all rays that go through the tree together: one test tells which of a node's eight children any of them
//! can enter.

use super::{AXES, Prepared};
use crate::intersect::bvh2::beyond;
use crate::intersect::bvh8::Node;
use crate::lanes::{Mask, Real, map3};

/// Bounds of rays.
pub(super) enum Bounds {
    /// They agree in the signs of their directions.
    Beam(Beam),
    /// They go the same way along one axis.
    Frustum(Frustum),
    /// None.
    Without,
}

/// Least and largest of the active lanes.
#[inline(always)]
fn range<F: Real, const V: usize>(x: [F; V], packets: &[Prepared<F>; V]) -> [f32; 2] {
    let (high, low) = (F::lit(f64::INFINITY), F::lit(f64::NEG_INFINITY));
    let (mut least, mut largest) = (high, low);
    for v in 0..V {
        let active = packets[v].active;
        least = least.min(F::select(active, x[v], high));
        largest = largest.max(F::select(active, x[v], low));
    }
    [least.least(), largest.largest()]
}

/// [`range`] of what each packet holds.
macro_rules! range_of {
    ($packets:expr, |$packet:ident| $value:expr) => {{
        let mut x = [F::zero(); V];
        for v in 0..V {
            let $packet = &$packets[v];
            x[v] = $value;
        }
        range(x, $packets)
    }};
}

impl Bounds {
    /// Of the active rays. A packet that is alone gets no frustum: its rays were put together by their origins and go all
    /// over the place.
    #[inline(always)]
    pub fn new<F: Real, const V: usize>(packets: &[Prepared<F>; V]) -> Self {
        // There are no bounds with what is not a number.
        let (mut up, mut down, mut numbers) = ([true; 3], [true; 3], true);
        for packet in packets {
            let active = packet.active.bits();
            for k in 0..3 {
                up[k] &= packet.inverse[k].gt(F::zero()).bits() & active == active;
                down[k] &= packet.inverse[k].lt(F::zero()).bits() & active == active;
                let (origin, inverse) = (packet.origin[k], packet.inverse[k]);
                numbers &= (origin.eq(origin) & inverse.eq(inverse)).bits() & active == active;
            }
        }
        let agree = map3!([0, 1, 2], |k| up[k] || down[k]);
        if numbers && agree[0] && agree[1] && agree[2] {
            return Bounds::Beam(Beam::new(packets, down));
        }
        if V == 1 || !numbers {
            return Bounds::Without;
        }
        match Frustum::new(packets, agree, down) {
            Some(frustum) => Bounds::Frustum(frustum),
            None => Bounds::Without,
        }
    }

    /// The side of each axis that all rays meet first, as a row of [`Node::bounds`], if they agree on it.
    #[inline(always)]
    pub fn near(&self) -> Option<[usize; 3]> {
        match self {
            Bounds::Beam(beam) => Some(beam.near),
            _ => None,
        }
    }

    /// The children of a node that a ray may enter before `limit`, and no fewer.
    #[inline(always)]
    pub fn enters<F: Real>(&self, node: &Node, limit: f32) -> u32 {
        match self {
            Bounds::Beam(beam) => beam.enters::<F>(node, limit),
            Bounds::Frustum(frustum) => frustum.enters::<F>(node, limit),
            // Absent children are inside out.
            Bounds::Without => F::load(&node.bounds[0], 0).le(F::load(&node.bounds[1], 0)).bits(),
        }
    }
}

/// For each axis the origin and the direction of a ray that would enter boxes no later than any of the rays, and of one
/// that would leave them no earlier.
pub(super) struct Beam {
    /// See [`Bounds::near`].
    near: [usize; 3],
    /// The coordinate of the origins that is nearest to those sides, and the smallest inverse direction.
    first: [[f32; 2]; 3],
    /// The coordinate that is furthest from the other sides, and the largest inverse direction.
    last: [[f32; 2]; 3],
}

impl Beam {
    #[inline(always)]
    fn new<F: Real, const V: usize>(packets: &[Prepared<F>; V], down: [bool; 3]) -> Self {
        let origin = map3!([0, 1, 2], |k| range_of!(packets, |packet| packet.origin[k]));
        let inverse = map3!([0, 1, 2], |k| range_of!(packets, |packet| packet.inverse[k]));
        // Upwards, a lower side is met first by rays from the highest origin; downwards it is all the other way round.
        let [least, largest] = [map3!(down, |down| down as usize), map3!(down, |down| !down as usize)];
        Beam {
            near: map3!([0, 1, 2], |k| 2 * k + least[k]),
            first: map3!([0, 1, 2], |k| [origin[k][largest[k]], inverse[k][least[k]]]),
            last: map3!([0, 1, 2], |k| [origin[k][least[k]], inverse[k][largest[k]]]),
        }
    }

    /// See [`Bounds::enters`]. Rounding is monotonic, so what holds for the bounds holds for the rays. (Where a distance
    /// is below 0 it bounds nothing, but then neither does it matter.)
    #[inline(always)]
    fn enters<F: Real>(&self, node: &Node, limit: f32) -> u32 {
        macro_rules! distance {
            ($row:expr, $ray:expr) => {
                (F::load(&node.bounds[$row], 0) - F::splat($ray[0])) * F::splat($ray[1])
            };
        }
        let [x, y, z] = map3!([0, 1, 2], |k| distance!(self.near[k], self.first[k]));
        let enter = x.max(y).max(z).max(F::zero());
        let [x, y, z] = map3!([0, 1, 2], |k| distance!(self.near[k] ^ 1, self.last[k]));
        let leave = beyond(x.min(y).min(z));
        (enter.le(leave) & enter.le(F::splat(limit))).bits()
    }
}

/// At each distance along one axis, a rectangle in the other two, along which rays may go both ways. The axis is the one
/// along which the slowest ray is fastest.
///
/// It would do for rays that agree in all signs, too, but takes longer to build and to test: 1.1 to 1.2 times the time of
/// camera rays with a [`Beam`].
pub(super) struct Frustum {
    /// The axis and the two others.
    axes: [usize; 3],
    /// The side of the axis that the rays meet first, as a row of [`Node::bounds`].
    near: usize,
    /// 1, or -1 if the rays go down the axis.
    sign: f32,
    /// Coordinates along the axis of the ray that starts last, and of the one that starts first.
    starts: [f32; 2],
    /// The largest component along the axis, and no less.
    speed: f32,
    /// Lowest and highest origin along the other axes.
    origin: [[f32; 2]; 2],
    /// Least and largest slope along the other axes, and no less wide.
    slope: [[f32; 2]; 2],
}

impl Frustum {
    /// Along an axis where some ray is slower than that, bounds are too wide to be of use.
    const SLOWEST: f32 = 0.05;
    /// More than slopes and distances can be off by rounding, together. Sums are rounded as well, but that is monotonic,
    /// and what they are compared with is exact.
    const WIDEN: f32 = 16.0 * f32::EPSILON;

    #[inline(always)]
    fn new<F: Real, const V: usize>(
        packets: &[Prepared<F>; V],
        agree: [bool; 3],
        down: [bool; 3],
    ) -> Option<Self> {
        // Least and largest component along each axis, without their sign.
        let speed = map3!([0, 1, 2], |k| if agree[k] {
            range_of!(packets, |packet| packet.direction[k].abs())
        } else {
            [0.0; 2]
        });
        let along = match map3!(speed, |speed| speed[0]) {
            [x, y, z] if x >= y && x >= z => 0,
            [_, y, z] if y >= z => 1,
            _ => 2,
        };
        if speed[along][0] < Self::SLOWEST {
            return None;
        }
        let [a, b, _] = AXES[along];
        let down = down[along];
        macro_rules! slope {
            ($k:expr) => {{
                let [least, largest] =
                    range_of!(packets, |packet| packet.direction[$k] * packet.inverse[along].abs());
                [least - Self::WIDEN * least.abs(), largest + Self::WIDEN * largest.abs()]
            }};
        }
        let [first, last] = range_of!(packets, |packet| packet.origin[along]);
        Some(Frustum {
            axes: [along, a, b],
            near: 2 * along + down as usize,
            sign: if down { -1.0 } else { 1.0 },
            starts: if down { [first, last] } else { [last, first] },
            speed: speed[along][1] * (1.0 + Self::WIDEN),
            origin: [
                range_of!(packets, |packet| packet.origin[a]),
                range_of!(packets, |packet| packet.origin[b]),
            ],
            slope: [slope!(a), slope!(b)],
        })
    }

    /// See [`Bounds::enters`].
    #[inline(always)]
    fn enters<F: Real>(&self, node: &Node, limit: f32) -> u32 {
        let side = |row: usize| F::load(&node.bounds[row], 0);
        let [from, to] = self.starts;
        let sign = F::splat(self.sign);
        let enter = ((side(self.near) - F::splat(from)) * sign).max(F::zero());
        let leave = ((side(self.near ^ 1) - F::splat(to)) * sign).min(F::splat(limit * self.speed));
        let mut lanes = enter.le(leave);
        macro_rules! across {
            ($k:literal) => {
                let ([low, high], [least, largest]) = (self.origin[$k], self.slope[$k]);
                let (least, largest) = (F::splat(least), F::splat(largest));
                let low = F::splat(low) + (least * enter).min(least * leave);
                let high = F::splat(high) + (largest * enter).max(largest * leave);
                let row = 2 * self.axes[1 + $k];
                lanes = lanes & low.le(side(row + 1)) & side(row).le(high);
            };
        }
        across!(0);
        across!(1);
        lanes.bits()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::{EMPTY, WIDTH};
    use super::*;
    use crate::intersect::RayPacket;
    use crate::isa::Level;
    use crate::isa::{Isa, Kernel};
    use crate::math::Vec3;

    /// Random packets of rays in a cone, and boxes around points on them.
    struct Cull {
        seed: u32,
    }

    impl Kernel for Cull {
        /// How often there were a beam, a frustum, neither; boxes that any ray enters, and that the bounds name.
        type Output = ([usize; 3], [usize; 2]);
        #[inline(always)]
        fn run<I: Isa>(self, _: I) -> Self::Output {
            let mut state = self.seed;
            let mut random = || {
                state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                (state >> 8) as f32 / (1 << 24) as f32
            };
            let (mut kinds, mut counts) = ([0; 3], [0; 2]);
            for _ in 0..2000 {
                let towards = [random() - 0.5, random() - 0.5, random() - 0.5];
                let (spread, size) = (random() * 0.8, random() * 0.3);
                let mut packets = [RayPacket::<I::Wide>::none(); 2];
                for packet in &mut packets {
                    let mut lanes = [[0.0f32; 16]; 6];
                    for lane in 0..16 {
                        for k in 0..3 {
                            lanes[k][lane] = 3.0 + size * random();
                            lanes[3 + k][lane] = towards[k] + spread * (random() - 0.5);
                        }
                    }
                    let load = |k: usize| I::Wide::load(&lanes[k], 0);
                    packet.origin = Vec3::new(load(0), load(1), load(2));
                    packet.direction = Vec3::new(load(3), load(4), load(5)).normalize();
                    packet.active = <I::Wide as Real>::Mask::from_bits((random() * 65536.0) as u32 | 1)
                        & <I::Wide as Real>::Mask::first(I::Wide::LANES);
                }
                let prepared = [Prepared::new(&packets[0]), Prepared::new(&packets[1])];
                let bounds = Bounds::new(&prepared);
                kinds[match bounds {
                    Bounds::Beam(_) => 0,
                    Bounds::Frustum(_) => 1,
                    Bounds::Without => 2,
                }] += 1;
                let mut node = Node { bounds: [[0.0; WIDTH]; 6], child: [EMPTY.0; WIDTH], order: [0; 8] };
                for child in 0..WIDTH {
                    let centre = [random() * 6.0, random() * 6.0, random() * 6.0];
                    let half = 2.0 * random() * random();
                    for k in 0..3 {
                        node.bounds[2 * k][child] = centre[k] - half * random();
                        node.bounds[2 * k + 1][child] = centre[k] + half * random();
                    }
                }
                let limit = 0.5 + random() * 5.0;
                let named = bounds.enters::<I::Eight>(&node, limit);
                for child in 0..WIDTH {
                    let mut any = false;
                    for packet in &prepared {
                        let limit = I::Wide::splat(limit);
                        any |= (packet.enter(&node, None, child, limit).1 & packet.active).any();
                    }
                    assert!(!any || named >> child & 1 == 1, "a box was lost");
                    counts[0] += any as usize;
                }
                if !matches!(bounds, Bounds::Without) {
                    counts[1] += named.count_ones() as usize;
                }
            }
            (kinds, counts)
        }
    }

    #[test]
    fn bounds_lose_no_box_and_name_few_too_many() {
        for level in Level::available() {
            let (kinds, [entered, named]) = level.run(Cull { seed: 5 });
            assert!(kinds.iter().all(|&n| n > 50), "{kinds:?}");
            assert!(entered > 300 && named < 3 * entered, "{entered} {named}");
        }
    }

    /// Rays with a coordinate that is no number have no bounds: nothing would be known of the others.
    #[test]
    fn no_number_no_bounds() {
        struct NoNumber;
        impl Kernel for NoNumber {
            type Output = bool;
            #[inline(always)]
            fn run<I: Isa>(self, _: I) -> bool {
                let mut direction = [0.6; 16];
                direction[1] = f32::NAN;
                let packet = RayPacket::<I::Wide> {
                    origin: Vec3::splat([0.0; 3]),
                    direction: Vec3::new(
                        I::Wide::load(&direction, 0),
                        I::Wide::splat(0.64),
                        I::Wide::splat(-0.48),
                    ),
                    active: <I::Wide as Real>::Mask::first(2),
                };
                let prepared = Prepared::new(&packet);
                matches!(Bounds::new(&[prepared; 2]), Bounds::Without)
            }
        }
        for level in Level::available() {
            assert!(level.run(NoNumber), "{}", level.name());
        }
    }
}
