//! FLIP: the difference that a person sees when two pictures are shown in turn at the same place.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for Alternating
//! Images", HPG 2020; for linear light Andersson, Nilsson, Shirley and Akenine-Möller, "Visualizing Errors in Rendered
//! High Dynamic Range Images", EG 2021. Both pictures are filtered as the eye filters at a viewing distance
//! ([`PIXELS_PER_DEGREE`]), compared in a perceptual colour space, and differences at edges and points count more. With
//! light of any range, the reference decides on a range of exposures; each pixel counts at the one where it differs
//! most.

use rayon::prelude::*;

use crate::picture::Image;

/// A 4K monitor, 0.7 m wide, 0.7 m away.
pub const PIXELS_PER_DEGREE: f64 = 67.020_643;

/// FLIP of two pictures of equal size.
#[derive(Debug, Clone, PartialEq)]
pub struct Flip {
    /// Mean over the pixels, from 0 to 1.
    pub mean: f64,
    /// Of each pixel, rows from top to bottom.
    pub map: Vec<f32>,
    /// Exposures, in stops, at which they were compared; 0 for pictures as a screen shows them.
    pub exposures: Vec<f64>,
}

type Colour = [f32; 3];

/// FLIP of pictures in linear light as a screen of sRGB shows them: what is brighter than 1 is cut off.
///
/// # Panics
/// If the sizes differ.
pub fn of_shown(image: &Image, reference: &Image) -> Flip {
    let clamp = |colour: &Colour| colour.map(|channel| sane(channel).min(1.0));
    let map = map(image, reference, &clamp);
    Flip { mean: mean(&map), map, exposures: vec![0.0] }
}

/// FLIP of pictures in linear light of any range.
///
/// # Panics
/// If the sizes differ.
pub fn of_light(image: &Image, reference: &Image) -> Flip {
    let exposures = exposures(reference);
    let mut most = vec![0.0_f32; image.pixels.len()];
    for &exposure in &exposures {
        let gain = exposure.exp2() as f32;
        let show = |colour: &Colour| colour.map(|channel| film_curve(sane(channel) * gain).clamp(0.0, 1.0));
        let map = map(image, reference, &show);
        most.par_iter_mut().zip(map).for_each(|(most, error)| *most = most.max(error));
    }
    Flip { mean: mean(&most), map: most, exposures }
}

/// No light where there is no number or less than none; a limit where it is infinite.
fn sane(channel: f32) -> f32 {
    if channel.is_nan() { 0.0 } else { channel.clamp(0.0, 1e9) }
}

fn mean(map: &[f32]) -> f64 {
    map.iter().map(|&error| f64::from(error)).sum::<f64>() / map.len() as f64
}

/// Rational approximation of the film curve of ACES (Narkowicz 2015) at 0.6 of the exposure: numerator and denominator,
/// highest power first.
const CURVE: [[f64; 3]; 2] = [[0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0], [0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14]];

fn film_curve(x: f32) -> f32 {
    let [numerator, denominator] = CURVE.map(|c| (c[0] as f32 * x + c[1] as f32) * x + c[2] as f32);
    numerator / denominator
}

/// From where the brightest pixel of the reference is just shown below white to where its median is, at most a stop
/// apart.
fn exposures(reference: &Image) -> Vec<f64> {
    /// What the curve shows where a range of exposures begins and ends.
    const SHOWN: f64 = 0.85;
    let [a, b, c] = std::array::from_fn(|power| CURVE[0][power] - SHOWN * CURVE[1][power]);
    let brightest_shown = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let luminance = |&[r, g, b]: &Colour| {
        0.212_671 * f64::from(sane(r)) + 0.715_16 * f64::from(sane(g)) + 0.072_169 * f64::from(sane(b))
    };
    let mut luminances: Vec<f64> = reference.pixels.iter().map(luminance).collect();
    luminances.sort_unstable_by(f64::total_cmp);
    let count = luminances.len();
    let median = (luminances[(count - 1) / 2] + luminances[count / 2]) / 2.0;
    // Black pictures have no range of their own.
    let brightest = luminances[count - 1].max(1e-4);
    let exposure = |luminance: f64| (brightest_shown / luminance).log2();
    let (first, last) = (exposure(brightest), exposure(median.max(brightest * 2.0_f64.powi(-16))));
    let steps = ((last - first).ceil() as usize).max(2);
    (0..steps).map(|step| first + (last - first) * step as f64 / (steps - 1) as f64).collect()
}

/// FLIP of each pixel, of both pictures as `show` shows them: linear light from 0 to 1.
fn map(image: &Image, reference: &Image, show: &(impl Fn(&Colour) -> Colour + Sync)) -> Vec<f32> {
    assert_eq!((image.width, image.height), (reference.width, reference.height), "sizes differ");
    let width = image.width as usize;
    let [image, reference] = [image, reference].map(|picture| {
        let opponent: Vec<Colour> =
            picture.pixels.par_iter().map(|colour| opponent_of_linear(show(colour))).collect();
        Plane { width, values: opponent }
    });
    let colours = colour_differences(&perceived(&image), &perceived(&reference));
    let features = feature_differences(&image, &reference);
    colours.into_par_iter().zip(features).map(|(colour, feature)| colour.powf(1.0 - feature)).collect()
}

/// Rows of pixels.
struct Plane<T> {
    width: usize,
    values: Vec<T>,
}

/// Reference white of D65 and the matrix of sRGB.
const WHITE: [f32; 3] = [0.950_428_55, 1.0, 1.088_900_4];
const XYZ_FROM_RGB: [[f32; 3]; 3] = [
    [0.412_390_8, 0.357_584_33, 0.180_480_8],
    [0.212_639, 0.715_168_66, 0.072_192_32],
    [0.019_330_82, 0.119_194_78, 0.950_532_14],
];
const RGB_FROM_XYZ: [[f32; 3]; 3] = [
    [3.240_97, -1.537_383_2, -0.498_610_76],
    [-0.969_243_65, 1.875_967_5, 0.041_555_06],
    [0.055_630_08, -0.203_976_96, 1.056_971_5],
];

fn times(matrix: &[[f32; 3]; 3], c: Colour) -> Colour {
    matrix.map(|row| row[0] * c[0] + row[1] * c[1] + row[2] * c[2])
}

/// Relative to the white.
fn relative_xyz(linear: Colour) -> Colour {
    let xyz = times(&XYZ_FROM_RGB, linear);
    std::array::from_fn(|i| xyz[i] / WHITE[i])
}

/// YCxCz: linear in light, one channel of lightness and two of colour.
fn opponent_of_linear(linear: Colour) -> Colour {
    let [x, y, z] = relative_xyz(linear);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn linear_of_opponent([y, cx, cz]: Colour) -> Colour {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    times(&RGB_FROM_XYZ, std::array::from_fn(|i| relative[i] * WHITE[i]))
}

/// CIELAB, with colours the less the darker they are (Hunt).
fn lab_of_linear(linear: Colour) -> Colour {
    const DELTA: f32 = 6.0 / 29.0;
    let [x, y, z] = relative_xyz(linear)
        .map(|t| if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// Contrast sensitivity of the three channels: sums of two Gaussians, `a sqrt(pi / b) exp(-pi^2 x^2 / b)` with x in
/// degrees.
const SENSITIVITIES: [[[f64; 2]; 2]; 3] =
    [[[1.0, 0.0047], [0.0, 1e-5]], [[1.0, 0.0053], [0.0, 1e-5]], [[34.1, 0.04], [13.5, 0.025]]];

/// What the eye resolves of a picture: filtered by the contrast sensitivity, in CIELAB.
fn perceived(picture: &Plane<Colour>) -> Vec<Colour> {
    let radius = (3.0 * (0.04 / (2.0 * std::f64::consts::PI.powi(2))).sqrt() * PIXELS_PER_DEGREE).ceil();
    let radius = radius as i64;
    let mut filtered = vec![[0.0; 3]; picture.values.len()];
    for (channel, gaussians) in SENSITIVITIES.iter().enumerate() {
        let plane = Plane {
            width: picture.width,
            values: picture.values.iter().map(|colour| colour[channel]).collect::<Vec<f32>>(),
        };
        // Two-dimensional weights of both, each the product of its own in one dimension.
        let kernels = gaussians.map(|[amplitude, b]| {
            let gauss = |x: i64| {
                let degrees = x as f64 / PIXELS_PER_DEGREE;
                (-std::f64::consts::PI.powi(2) * degrees * degrees / b).exp()
            };
            let kernel: Vec<f64> = (-radius..=radius).map(gauss).collect();
            let sum: f64 = kernel.iter().sum();
            let weight = amplitude * (std::f64::consts::PI / b).sqrt() * sum * sum;
            (weight, kernel.into_iter().map(|value| (value / sum) as f32).collect::<Vec<f32>>())
        });
        let total: f64 = kernels.iter().map(|(weight, _)| weight).sum();
        for (weight, kernel) in kernels.iter().filter(|(weight, _)| *weight > 0.0) {
            let share = (weight / total) as f32;
            let blurred = columns(&rows(&plane, kernel), kernel);
            for (sum, value) in filtered.iter_mut().zip(&blurred.values) {
                sum[channel] += share * value;
            }
        }
    }
    let finish =
        |colour: &Colour| lab_of_linear(linear_of_opponent(*colour).map(|channel| channel.clamp(0.0, 1.0)));
    filtered.par_iter().map(finish).collect()
}

/// HyAB: lightness and colour apart (Abasi, Tehran and Fairchild 2020).
fn distance(a: Colour, b: Colour) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Differences of colour, from 0 to 1: a power of the distance, of which the smaller ones take most of the range.
fn colour_differences(image: &[Colour], reference: &[Colour]) -> Vec<f32> {
    const POWER: f32 = 0.7;
    const KNEE: f32 = 0.4;
    const SHOWN_AT_KNEE: f32 = 0.95;
    let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(lab_of_linear);
    let largest = distance(green, blue).powf(POWER);
    let knee = KNEE * largest;
    let compress = |distance: f32| {
        let power = distance.powf(POWER);
        let shown = if power < knee {
            SHOWN_AT_KNEE / knee * power
        } else {
            SHOWN_AT_KNEE + (power - knee) / (largest - knee) * (1.0 - SHOWN_AT_KNEE)
        };
        shown.clamp(0.0, 1.0)
    };
    image.par_iter().zip(reference).map(|(&a, &b)| compress(distance(a, b))).collect()
}

/// Differences of edges and of points, from 0 to 1.
fn feature_differences(image: &Plane<Colour>, reference: &Plane<Colour>) -> Vec<f32> {
    /// Width of the features that the eye looks for, in degrees.
    const WIDTH: f64 = 0.082;
    let deviation = 0.5 * WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation).ceil() as i64;
    let sample = |weight: &dyn Fn(f64) -> f64| -> Vec<f64> {
        (-radius..=radius)
            .map(|x| x as f64)
            .map(|x| weight(x) * (-x * x / (2.0 * deviation.powi(2))).exp())
            .collect()
    };
    let blur = normalised(sample(&|_| 1.0));
    let edge = normalised(sample(&|x| -x));
    let point = normalised(sample(&|x| x * x / deviation.powi(2) - 1.0));
    let strengths = |picture: &Plane<Colour>| -> [Vec<f32>; 2] {
        let lightness = Plane {
            width: picture.width,
            values: picture.values.iter().map(|colour| (colour[0] + 16.0) / 116.0).collect(),
        };
        let blurred_rows = rows(&lightness, &blur);
        let blurred_columns = columns(&lightness, &blur);
        [&edge, &point].map(|kernel| {
            let across = rows(&blurred_columns, kernel);
            let down = columns(&blurred_rows, kernel);
            across.values.par_iter().zip(&down.values).map(|(&x, &y)| x.hypot(y)).collect()
        })
    };
    let ([edges, points], [reference_edges, reference_points]) = (strengths(image), strengths(reference));
    (0..edges.len())
        .into_par_iter()
        .map(|i| {
            let edge = (edges[i] - reference_edges[i]).abs();
            let point = (points[i] - reference_points[i]).abs();
            (edge.max(point) / std::f32::consts::SQRT_2).sqrt().min(1.0)
        })
        .collect()
}

/// Positive weights sum to 1, negative ones to -1.
fn normalised(kernel: Vec<f64>) -> Vec<f32> {
    let positive: f64 = kernel.iter().filter(|weight| **weight > 0.0).sum();
    let negative: f64 = -kernel.iter().filter(|weight| **weight < 0.0).sum::<f64>();
    kernel
        .iter()
        .map(|&w| {
            (if w > 0.0 {
                w / positive
            } else if w < 0.0 {
                w / negative
            } else {
                0.0
            }) as f32
        })
        .collect()
}

/// Filters each row; beyond the border the last pixel goes on.
fn rows(plane: &Plane<f32>, kernel: &[f32]) -> Plane<f32> {
    let (width, radius) = (plane.width, kernel.len() / 2);
    let mut values = vec![0.0; plane.values.len()];
    values.par_chunks_mut(width).zip(plane.values.par_chunks(width)).for_each(|(out, row)| {
        let mut padded = vec![row[0]; radius];
        padded.extend_from_slice(row);
        padded.resize(width + 2 * radius, row[width - 1]);
        for (k, &weight) in kernel.iter().enumerate() {
            for (sum, value) in out.iter_mut().zip(&padded[k..]) {
                *sum += weight * value;
            }
        }
    });
    Plane { width, values }
}

/// Filters each column.
fn columns(plane: &Plane<f32>, kernel: &[f32]) -> Plane<f32> {
    let (width, radius) = (plane.width, kernel.len() / 2);
    let height = plane.values.len() / width;
    let mut values = vec![0.0; plane.values.len()];
    values.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (k, &weight) in kernel.iter().enumerate() {
            let from = (y + k).saturating_sub(radius).min(height - 1);
            for (sum, value) in out.iter_mut().zip(&plane.values[from * width..]) {
                *sum += weight * value;
            }
        }
    });
    Plane { width, values }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(colour: impl Fn(u32, u32) -> Colour) -> Image {
        let pixels = (0..48 * 64).map(|i| colour(i % 64, i / 64)).collect();
        Image::new(64, 48, pixels)
    }

    fn gradient(x: u32, y: u32) -> Colour {
        [x as f32 / 64.0, y as f32 / 48.0, 0.25]
    }

    #[test]
    fn equal_pictures_do_not_differ_and_black_and_white_do() {
        let image = picture(gradient);
        assert_eq!(of_shown(&image, &image).mean, 0.0);
        assert_eq!(of_light(&image, &image).mean, 0.0);
        let (black, white) = (picture(|_, _| [0.0; 3]), picture(|_, _| [1.0; 3]));
        let flip = of_shown(&black, &white);
        // Lightness differs by 100, of at most 308 under the metric.
        assert!((0.95..1.0).contains(&flip.mean), "{}", flip.mean);
        assert_eq!(flip.map.len(), 64 * 48);
    }

    #[test]
    fn larger_differences_count_more_and_an_edge_adds_to_them() {
        let image = picture(gradient);
        let tinted = |amount: f32| picture(|x, y| gradient(x, y).map(|channel| channel + amount));
        let errors = [0.01, 0.05, 0.2].map(|amount| of_shown(&tinted(amount), &image).mean);
        assert!(errors.windows(2).all(|pair| pair[0] < pair[1]), "{errors:?}");
        let half = picture(|x, y| if x < 32 { [0.5; 3] } else { gradient(x, y).map(|_| 0.5) });
        let line = picture(|x, _| if x == 32 { [1.0; 3] } else { [0.5; 3] });
        let map = of_shown(&line, &half).map;
        assert!(map[24 * 64 + 32] > map[24 * 64 + 40] && map[24 * 64 + 5] < 0.01);
    }

    #[test]
    fn light_of_any_range_is_judged_at_the_exposure_that_shows_it() {
        // A difference far beyond white: cut off on the screen, seen at a lower exposure.
        let reference = picture(|x, _| if x < 8 { [100.0; 3] } else { [0.5; 3] });
        let image = picture(|x, _| if x < 8 { [60.0; 3] } else { [0.5; 3] });
        assert_eq!(of_shown(&image, &reference).mean, 0.0);
        let flip = of_light(&image, &reference);
        assert!(flip.mean > 0.01 && flip.exposures.len() > 4, "{} {:?}", flip.mean, flip.exposures);
        let spoiled = picture(|x, y| if x == y { [f32::NAN, f32::INFINITY, -1.0] } else { [0.5; 3] });
        assert!(of_light(&spoiled, &reference).mean.is_finite());
        assert!(of_light(&reference, &spoiled).mean.is_finite());
        let black = picture(|_, _| [0.0; 3]);
        assert_eq!(of_light(&black, &black).mean, 0.0);
    }
}
