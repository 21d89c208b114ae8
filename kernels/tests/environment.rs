//! Pictures of the sky: the maps of the sphere, samples against density, what is never chosen and what always is, and
//! portals.

mod statistics;

use core::f64::consts::PI;
use core::num::Wrapping;
use statistics::{Mean, Random, assert_distributed, length, normalize, sub};
use wavepath_kernels::lanes::Real;
use wavepath_kernels::math::Vec3;
use wavepath_kernels::scene::lights::{EnvironmentMap, EnvironmentParts, LightSample, Portal, SkyMapping};
use wavepath_kernels::scene::{BuildError, Picture, Texels};
use wavepath_kernels::sphere_maps::{
    equal_area_to_sphere, lat_long_to_sphere, sphere_to_equal_area, sphere_to_lat_long,
};

/// One lane, single or double precision.
trait Scalar: Real<Mask = bool, Uint = Wrapping<u32>> + Into<f64> {}
impl Scalar for f32 {}
impl Scalar for f64 {}

fn lanes<F: Real>(v: [f64; 3]) -> Vec3<F> {
    Vec3::new(F::lit(v[0]), F::lit(v[1]), F::lit(v[2]))
}
fn array<F: Scalar>(v: Vec3<F>) -> [f64; 3] {
    [v.x.into(), v.y.into(), v.z.into()]
}

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// A rotation.
const TURNED: [[f64; 3]; 3] = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
/// Stretched, sheared and mirrored.
const BENT: [[f64; 3]; 3] = [[-3.0, 0.3, 0.0], [0.1, 2.0, 0.4], [0.0, -0.2, 1.5]];

fn floats(width: u32, height: u32, colour: impl Fn(u32, u32) -> [f32; 3]) -> Picture {
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let numbers = places.flat_map(|(x, y)| colour(x, y)).collect();
    Picture::new(width, height, Texels::Floats(numbers)).unwrap()
}

/// Bright and dim texels, some black.
fn patchy(width: u32, height: u32) -> Picture {
    floats(width, height, |x, y| match (x * 7 + y * 13) % 11 {
        0..5 => [0.0; 3],
        5 => [40.0, 10.0, 0.0],
        k => [0.1 * k as f32, 0.02, 0.3],
    })
}

fn map(picture: Picture, mapping: SkyMapping, light_from_world: [[f64; 3]; 3]) -> EnvironmentMap {
    let parts = EnvironmentParts { picture, mapping, scale: [1.0, 0.5, 2.0], light_from_world, portal: None };
    EnvironmentMap::new(parts).unwrap()
}

fn density<F: Scalar>(map: &EnvironmentMap, d: [f64; 3]) -> f64 {
    map.met::<F>(lanes([0.0; 3]), lanes(d)).1.into()
}

fn sample<F: Scalar>(map: &EnvironmentMap, random: &mut Random) -> LightSample<F> {
    let u = [random.unit(), random.unit()].map(F::lit);
    map.sample::<F>(lanes([0.0; 3]), Wrapping(random.bits() as u32), u)
}

#[test]
fn maps_of_the_sphere_are_inverses() {
    fn check<F: Scalar>(rounding: f64) {
        let mut random = Random::new(3);
        let axes = [0, 1, 2].map(|k| IDENTITY[k]);
        let poles = axes.into_iter().chain(axes.map(|a| a.map(|x| -x)));
        let many: Vec<_> = poles.chain((0..20_000).map(|_| random.direction())).collect();
        for d in many {
            let square = sphere_to_equal_area(lanes::<F>(d));
            assert!(square.iter().all(|&x| (0.0..=1.0).contains(&x.into())), "{d:?}");
            let back = array(equal_area_to_sphere(square));
            assert!(length(sub(back, d)) < rounding, "equal area: {d:?} {back:?}");
            let square = sphere_to_lat_long(lanes::<F>(d));
            assert!(square.iter().all(|&x| (0.0..=1.0).contains(&x.into())), "{d:?}");
            let back = array(lat_long_to_sphere(square));
            assert!(length(sub(back, d)) < rounding, "latitude: {d:?} {back:?}");
        }
    }
    check::<f32>(3e-6);
    check::<f64>(3e-7);
    // The middle looks up, the corners down, the right edge's middle along x.
    let square = |d: [f64; 3]| sphere_to_equal_area(lanes::<f64>(d));
    assert_eq!(square([0.0, 0.0, 1.0]), [0.5, 0.5]);
    assert_eq!(square([1.0, 0.0, 0.0]), [1.0, 0.5]);
    assert_eq!(square([0.0, 1.0, 0.0]), [0.5, 1.0]);
    assert_eq!(square([0.0, 0.0, -1.0]), [1.0, 1.0]);
    let [u, v] = sphere_to_lat_long(lanes::<f64>([0.0, 1.0, 0.0]));
    assert!((u - 0.25).abs() < 1e-8 && (v - 0.5).abs() < 1e-8);
}

#[test]
fn the_equal_area_map_has_equal_areas() {
    const SAMPLES: usize = 100_000;
    let mut random = Random::new(4);
    let mut observed = vec![0; 64];
    for _ in 0..SAMPLES {
        let [u, v] = sphere_to_equal_area(lanes::<f64>(random.direction())).map(|x| (x * 8.0) as usize);
        observed[u.min(7) + 8 * v.min(7)] += 1;
    }
    assert_distributed("directions", &observed, &[SAMPLES as f64 / 64.0; 64], 1);
}

fn all_maps() -> Vec<(String, EnvironmentMap)> {
    let mut maps = Vec::new();
    for (mapping, width, height) in
        [(SkyMapping::EqualArea, 12, 12), (SkyMapping::LatLong, 18, 9), (SkyMapping::LatLong, 5, 1)]
    {
        for (name, matrix) in [("as it is", IDENTITY), ("turned", TURNED), ("bent", BENT)] {
            let what = format!("{mapping:?} {width} x {height} {name}");
            maps.push((what, map(patchy(width, height), mapping, matrix)));
        }
    }
    maps
}

const BINS: usize = 12;
fn bin(d: [f64; 3]) -> usize {
    let [u, v] = sphere_to_equal_area(lanes::<f64>(d)).map(|x| ((x * BINS as f64) as usize).min(BINS - 1));
    u + BINS * v
}

#[test]
fn samples_follow_their_density_which_integrates_to_one() {
    const SAMPLES: usize = 100_000;
    const FINE: usize = BINS * 60;
    let maps = all_maps();
    let family = 2 * maps.len();
    for (what, map) in maps {
        // Equal areas of the world's sphere.
        let mut shares = vec![0.0; BINS * BINS];
        for k in 0..FINE * FINE {
            let at = [k % FINE, k / FINE].map(|x| (x as f64 + 0.5) / FINE as f64);
            let d = array(equal_area_to_sphere(at));
            shares[bin(d)] += density::<f64>(&map, d) * 4.0 * PI / (FINE * FINE) as f64;
        }
        let total: f64 = shares.iter().sum();
        assert!((total - 1.0).abs() < 2e-3, "{what}: density integrates to {total}");
        let expected: Vec<f64> = shares.iter().map(|p| p / total * SAMPLES as f64).collect();
        fn observe<F: Scalar>(map: &EnvironmentMap) -> Vec<u64> {
            let mut random = Random::new(1);
            let mut observed = vec![0; BINS * BINS];
            for _ in 0..SAMPLES {
                observed[bin(array(sample::<F>(map, &mut random).direction))] += 1;
            }
            observed
        }
        assert_distributed(&format!("{what}, double"), &observe::<f64>(&map), &expected, family);
        assert_distributed(&format!("{what}, single"), &observe::<f32>(&map), &expected, family);
    }
}

#[test]
fn sampled_and_met_are_one_sky() {
    fn check<F: Scalar>(most_differ: usize) {
        for (what, map) in all_maps() {
            let mut random = Random::new(9);
            let mut differ = 0;
            for _ in 0..20_000 {
                let s = sample::<F>(&map, &mut random);
                let d = array(s.direction);
                assert!((length(d) - 1.0).abs() < 1e-6 && s.valid && !s.delta, "{what}");
                assert!(s.radiance.sum().into() > 0.0, "{what}: a black texel was chosen");
                let (radiance, pdf) = map.met::<F>(lanes([0.0; 3]), s.direction);
                let near = |a: F, b: F| {
                    let (a, b): (f64, f64) = (a.into(), b.into());
                    (a - b).abs() <= 1e-3 * (a.abs() + b.abs()) + 1e-4
                };
                // At the border of a cell rounding leads into the next.
                differ += !(near(pdf, s.pdf) && near(radiance.sum(), s.radiance.sum())) as usize;
            }
            assert!(differ <= most_differ, "{what}: {differ}");
        }
    }
    check::<f64>(4);
    check::<f32>(20);
}

/// Radiance over density, for all samples: its mean is the radiance from everywhere.
fn whole_sky(map: &EnvironmentMap, samples: usize) -> Mean {
    let mut random = Random::new(5);
    Mean::of((0..samples).map(|_| {
        let s = sample::<f32>(map, &mut random);
        f64::from(s.radiance.r / s.pdf)
    }))
}

#[test]
fn the_mean_is_that_of_the_samples() {
    for (what, map) in all_maps() {
        if what.ends_with("bent") {
            // The mean is that of the picture's directions.
            continue;
        }
        // That of interpolated pictures is taken by texels.
        let rounding = if what.starts_with("LatLong") { 0.03 } else { 1e-4 };
        let want = map.mean()[0] * 4.0 * PI;
        whole_sky(&map, 50_000).assert_near(&what, want, rounding * want);
    }
}

#[test]
fn a_sun_of_one_texel_is_found() {
    // A sun of one texel of 4096 x 2048 (or 2048 x 2048) that brings half of the light.
    let sun = |x, y| if (x, y) == (1234, 567) { [1e6, 0.0, 0.0] } else { [0.0; 3] };
    for (mapping, width) in [(SkyMapping::LatLong, 4096), (SkyMapping::EqualArea, 2048)] {
        let height = 2048;
        let picture = floats(width, height, |x, y| {
            let [r, g, b] = sun(x, y);
            [r + 0.2, g + 0.1, b]
        });
        let bytes = picture.bytes();
        let map = map(picture, mapping, TURNED);
        let cells = width as usize * (height as usize + 4);
        assert!(map.bytes() - bytes <= cells * 7 / 4 + 4096, "{}", map.bytes() - bytes);
        let mut random = Random::new(2);
        let found = (0..4000).filter(|_| sample::<f32>(&map, &mut random).radiance.r > 1.0).count();
        let share = {
            let sun = 1e6 / (f64::from(width) * 2048.0);
            let sun = if mapping == SkyMapping::LatLong {
                sun * PI / 2.0 * (567.5 / 2048.0 * PI).sin()
            } else {
                sun
            };
            sun / (sun + 0.25)
        };
        let (mean, sigma) = (4000.0 * share, (4000.0 * share * (1.0 - share)).sqrt());
        assert!(
            (found as f64 - mean).abs() < 5.0 * sigma,
            "{mapping:?}: {found}, expected {mean} +- {sigma}"
        );
        let want = map.mean()[0] * 4.0 * PI;
        whole_sky(&map, 20_000).assert_near("a sky with a sun", want, 0.003 * want);
    }
}

#[test]
fn only_what_shines_is_chosen() {
    // Three texels of 300 x 150: among them the first and the last of a row, one in a corner of the grid.
    let lit = [(0, 10), (299, 149), (299, 70)];
    let picture = floats(300, 150, |x, y| if lit.contains(&(x, y)) { [0.0, 0.0, 1e-6] } else { [0.0; 3] });
    for mapping in [SkyMapping::LatLong, SkyMapping::EqualArea] {
        let map = map(picture.clone(), mapping, TURNED);
        let mut random = Random::new(2);
        for _ in 0..10_000 {
            let s = sample::<f32>(&map, &mut random);
            assert!(s.radiance.b > 0.0 && s.pdf > 0.0 && s.pdf.is_finite());
        }
        assert_eq!(density::<f32>(&map, normalize([0.1, 0.2, 0.3])), 0.0);
    }
}

#[test]
fn all_kinds_of_texels_mean_the_same() {
    let values: Vec<f32> = (0..256).map(|byte| byte as f32 / 8.0).collect();
    let words: Vec<u32> = (0..12).map(|k| (k * 20) | (k << 8) | ((255 - k) << 16)).collect();
    let bytes = Picture::new(4, 3, Texels::Bytes { words, values }).unwrap();
    let numbers: Vec<f32> = (0..12).flat_map(|i| bytes.colour(i % 4, i / 4)).collect();
    let halves = numbers.chunks(3).flat_map(|c| {
        // 16-bit floating point of small multiples of 1/8, exactly.
        let half = |x: f32| if x == 0.0 { 0 } else { (x.to_bits() >> 13) - (112 << 10) };
        [half(c[0]) | half(c[1]) << 16, half(c[2])]
    });
    let halves = Picture::new(4, 3, Texels::Halves(halves.collect())).unwrap();
    let floats = Picture::new(4, 3, Texels::Floats(numbers)).unwrap();
    for (x, y) in [(0, 0), (3, 0), (1, 2), (3, 2), (9, 9)] {
        assert_eq!(floats.colour(x, y), bytes.colour(x, y));
        assert_eq!(floats.colour(x, y), halves.colour(x, y));
    }
    assert_eq!(floats.colour(9, 9), floats.colour(3, 2));
    // The smallest number of 16 bits, and the largest.
    let extremes = Picture::new(1, 1, Texels::Halves(vec![0x7bff_0001, 0x0400])).unwrap();
    assert_eq!(extremes.colour(0, 0), [2f32.powi(-24), 65504.0, 2f32.powi(-14)]);
    // Half way between two centres, and at the edge.
    let at = |u, v| floats.bilinear::<f32>([u, v]).r;
    let mean = (floats.colour(1, 0)[0] + floats.colour(2, 0)[0]) / 2.0;
    assert!((at(0.5, 0.0) - mean).abs() < 1e-5);
    assert_eq!(at(1.0, 1.0), floats.colour(3, 2)[0]);
    assert_eq!(floats.nearest::<f32>([0.3, 0.9]).r, floats.colour(1, 2)[0]);
}

#[test]
fn a_portal_shows_a_part() {
    let portal = Portal { corner: [-1.0, -1.0, 2.0], first: [2.0, 0.0, 0.0], second: [0.0, 2.0, 0.0] };
    let parts = EnvironmentParts {
        picture: floats(8, 8, |_, _| [1.0; 3]),
        mapping: SkyMapping::EqualArea,
        scale: [1.0; 3],
        light_from_world: TURNED,
        portal: Some(portal),
    };
    let map = EnvironmentMap::new(parts).unwrap();
    let sees = |from: [f64; 3], to: [f64; 3]| {
        let d = normalize(sub(to, from));
        map.met::<f32>(lanes(from), lanes(d)).0.r > 0.0
    };
    let from = [0.3, 0.1, 0.5];
    for (x, y, inside) in [(0.9, 0.9, true), (-0.9, 0.2, true), (1.1, 0.0, false), (0.0, -1.1, false)] {
        assert_eq!(sees(from, [x, y, 2.0]), inside, "{x} {y}");
    }
    assert!(!sees(from, [0.0, 0.0, -2.0]), "behind");
    assert!(!sees([0.0, 0.0, 3.0], [0.0, 0.0, 2.0]), "from outside");
    assert!(!sees([0.0, 0.0, 3.0], [0.0, 0.0, 4.0]), "beyond it");
    // Irradiance of a square: twice that of each half (Siegel and Howell, configuration C-11).
    let mut random = Random::new(7);
    let mean = Mean::of((0..200_000).map(|_| {
        let s = sample_from(&map, [0.0; 3], &mut random);
        if s.valid { f64::from(s.direction.z.max(0.0) * s.radiance.g / s.pdf) } else { 0.0 }
    }));
    let corner = [0.5f64; 2];
    let [a, b] = corner.map(|x| x / (1.0 + x * x).sqrt());
    let [c, d] = corner.map(|x| (0.5 / (1.0 + x * x).sqrt()).atan());
    mean.assert_near("irradiance through a window", 4.0 * PI * (a * c + b * d) / (2.0 * PI), 1e-5);
}

fn sample_from(map: &EnvironmentMap, from: [f64; 3], random: &mut Random) -> LightSample<f32> {
    let u = [random.unit() as f32, random.unit() as f32];
    map.sample::<f32>(lanes(from), Wrapping(random.bits() as u32), u)
}

#[test]
fn what_is_no_sky_is_refused() {
    let picture = |numbers: Vec<f32>| Picture::new(2, 1, Texels::Floats(numbers));
    assert!(matches!(picture(vec![0.0; 5]), Err(BuildError::Length { found: 5, expected: 6, .. })));
    for wrong in [-1.0, f32::NAN, f32::INFINITY] {
        let refused = picture(vec![0.0, 0.0, 0.0, 0.0, wrong, 0.0]);
        assert!(matches!(refused, Err(BuildError::Number { id: 1, .. })), "{wrong}");
    }
    let halves = |half: u32| Picture::new(1, 1, Texels::Halves(vec![half << 16, 0]));
    assert!(halves(0x7bff).is_ok());
    for wrong in [0x7c00, 0x7e00, 0x8001] {
        assert!(halves(wrong).is_err(), "{wrong:x}");
    }
    assert!(Picture::new(0, 7, Texels::Floats(vec![])).is_err());
    assert!(Picture::new(1 << 15, 1 << 15, Texels::Floats(vec![])).is_err());
    assert!(Picture::new(1, 1, Texels::Bytes { words: vec![0], values: vec![0.0; 255] }).is_err());
    let parts = |picture: Picture, light_from_world| EnvironmentParts {
        picture,
        mapping: SkyMapping::LatLong,
        scale: [1.0; 3],
        light_from_world,
        portal: None,
    };
    let black = floats(4, 4, |_, _| [0.0; 3]);
    assert!(EnvironmentMap::new(parts(black, IDENTITY)).unwrap_err().to_string().contains("black"));
    for wrong in [[[0.0; 3]; 3], [[1.0, 0.0, 0.0]; 3], [[f64::NAN; 3]; 3]] {
        let refused = EnvironmentMap::new(parts(patchy(4, 4), wrong)).unwrap_err();
        assert!(refused.to_string().contains("inverse"), "{refused}");
    }
}
