//! Pictures of lights, from files to what kernels read.

use std::f64::consts::PI;

use glam::DMat3;
use wavepath_kernels::scene::lights::{
    EnvironmentMap, EnvironmentParts, LightPicture, PictureMapping, Portal, SkyMapping,
};
use wavepath_kernels::scene::{BuildError, Picture, Texels};

use super::description as d;
use crate::picture::{Raster, RasterSamples, Transfer};

/// The picture in as few bytes as kernels can read: bytes and 16-bit floating point stay what they are. What is negative
/// becomes 0, as in pbrt.
pub(super) fn picture(raster: &Raster, transfer: Transfer) -> Result<Picture, BuildError> {
    fn spread<T: Copy>(samples: &[T], channels: usize) -> impl Iterator<Item = [T; 3]> {
        samples.chunks_exact(channels).map(|pixel| match *pixel {
            [r, g, b, ..] => [r, g, b],
            _ => [pixel[0]; 3],
        })
    }
    let channels = raster.channels() as usize;
    let texels = match raster.samples() {
        RasterSamples::Bytes(bytes) => Texels::Bytes {
            words: spread(bytes, channels).map(|[r, g, b]| u32::from_le_bytes([r, g, b, 0])).collect(),
            values: transfer.table().to_vec(),
        },
        RasterSamples::Halves(halves) => {
            let bits = |half: half::f16| if half.is_sign_negative() { 0 } else { u32::from(half.to_bits()) };
            let words = spread(halves, channels).flat_map(|[r, g, b]| [bits(r) | bits(g) << 16, bits(b)]);
            Texels::Halves(words.collect())
        }
        RasterSamples::Floats(floats) => {
            // `max` would make a number of what is none.
            let colours = spread(floats, channels).flatten();
            Texels::Floats(colours.map(|x| if x < 0.0 { 0.0 } else { x }).collect())
        }
        RasterSamples::Words(_) => Texels::Floats(raster.colours(transfer).into_iter().flatten().collect()),
    };
    Picture::new(raster.width(), raster.height(), texels)
}

/// The same in grey: the mean of the channels.
fn grey(raster: &Raster, transfer: Transfer) -> Result<Picture, BuildError> {
    let mean = |[r, g, b]: [f32; 3]| ((r + g + b) / 3.0).max(0.0);
    let numbers = raster.colours(transfer).into_iter().flat_map(|colour| [mean(colour); 3]);
    Picture::new(raster.width(), raster.height(), Texels::Floats(numbers.collect()))
}

/// The picture of a light that is no sky.
pub(super) fn light_picture(
    raster: &Raster,
    transfer: Transfer,
    mapping: PictureMapping,
) -> Result<LightPicture, BuildError> {
    // pbrt-v4's goniometric lights have no colours but their own.
    let picture = match mapping {
        PictureMapping::EqualArea => grey(raster, transfer)?,
        _ => picture(raster, transfer)?,
    };
    Ok(LightPicture { picture, mapping })
}

/// The integral of a picture over the directions in which a point shines.
pub(super) fn integral(light: &LightPicture, half_size: [f64; 2]) -> [f64; 3] {
    let picture = &light.picture;
    let (width, height) = (f64::from(picture.width()), f64::from(picture.height()));
    let texels = width * height;
    match light.mapping {
        PictureMapping::Projection | PictureMapping::SmoothProjection => {
            let [a, b] = half_size;
            picture.weighted_sum(|x, y| {
                let at = |k: u32, n: f64, half: f64| ((f64::from(k) + 0.5) / n * 2.0 - 1.0) * half;
                let (x, y) = (at(x, width, a), at(y, height, b));
                4.0 * a * b / texels * (1.0 + x * x + y * y).powf(-1.5)
            })
        }
        PictureMapping::EqualArea => picture.weighted_sum(|_, _| 4.0 * PI / texels),
        PictureMapping::LatLong => {
            let edge = |y: u32| (f64::from(y) / height * PI).cos();
            picture.weighted_sum(|_, y| 2.0 * PI / width * (edge(y) - edge(y + 1)))
        }
        PictureMapping::Surface => [0.0; 3],
    }
}

/// The mean colour of a picture over a triangle with these texture coordinates, about.
pub(super) fn mean_over_triangle(picture: &Picture, corners: [[f64; 2]; 3]) -> [f64; 3] {
    const SIDE: u32 = 8;
    let [p, q, r] = corners;
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for i in 0..SIDE {
        for j in 0..SIDE - i {
            let [a, b] = [i, j].map(|k| (f64::from(k) + 1.0 / 3.0) / f64::from(SIDE));
            let at = |k: usize| (p[k] + a * (q[k] - p[k]) + b * (r[k] - p[k])) as f32;
            let colour = picture.bilinear::<f32>([at(0), 1.0 - at(1)]);
            for (sum, c) in sum.iter_mut().zip([colour.r, colour.g, colour.b]) {
                *sum += f64::from(c);
            }
            count += 1.0;
        }
    }
    sum.map(|x| x / count)
}

/// A picture of the sky; `None` if it is black.
pub(super) fn environment_map(
    raster: &Raster,
    transfer: Transfer,
    scale: d::Rgb,
    mapping: SkyMapping,
    light_from_world: &DMat3,
    portal: Option<[glam::DVec3; 3]>,
) -> Result<Option<EnvironmentMap>, BuildError> {
    let picture = picture(raster, transfer)?;
    let black = |x, y| picture.colour(x, y).iter().zip(scale).all(|(c, s)| c * s == 0.0);
    if (0..picture.height()).all(|y| (0..picture.width()).all(|x| black(x, y))) {
        return Ok(None);
    }
    let portal = portal.map(|[corner, first, second]| {
        let [corner, first, second] = [corner, first, second].map(|v| v.as_vec3().into());
        Portal { corner, first, second }
    });
    let light_from_world = light_from_world.transpose().to_cols_array_2d();
    EnvironmentMap::new(EnvironmentParts { picture, mapping, scale, light_from_world, portal }).map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_keep_their_colours() {
        let bytes = RasterSamples::Bytes(vec![0, 51, 255, 9, 188, 1, 2, 200]);
        let raster = Raster::new(1, 2, 4, bytes).unwrap();
        for transfer in [Transfer::Srgb, Transfer::Linear, Transfer::Gamma(2.2)] {
            let picture = picture(&raster, transfer).unwrap();
            for y in 0..2 {
                let [r, g, b, _] = raster.linear(0, y, transfer);
                assert_eq!(picture.colour(0, y), [r, g, b]);
            }
        }
        let halves = [0.5, -1.0, 60000.0, 0.1].map(half::f16::from_f32).to_vec();
        let raster = Raster::new(4, 1, 1, RasterSamples::Halves(halves)).unwrap();
        let half = picture(&raster, Transfer::Srgb).unwrap();
        let want = [0.5, 0.0, 60000.0, half::f16::from_f32(0.1).to_f32()];
        assert_eq!([0, 1, 2, 3].map(|x| half.colour(x, 0)[1]), want);
        let words = Raster::new(1, 1, 3, RasterSamples::Words(vec![0, 65535, 32768])).unwrap();
        let [r, g, b] = picture(&words, Transfer::Linear).unwrap().colour(0, 0);
        assert!(r == 0.0 && g == 1.0 && (b - 0.5).abs() < 1e-4);
        let floats = Raster::new(1, 1, 3, RasterSamples::Floats(vec![-2.0, 1e9, 0.0])).unwrap();
        assert_eq!(picture(&floats, Transfer::Srgb).unwrap().colour(0, 0), [0.0, 1e9, 0.0]);
        assert_eq!(grey(&floats, Transfer::Srgb).unwrap().colour(0, 0), [1e9f32 / 3.0; 3]);
    }

    #[test]
    fn integrals_of_white_are_solid_angles() {
        let white = Raster::new(64, 32, 1, RasterSamples::Bytes(vec![255; 2048])).unwrap();
        let solid_angle = |mapping, half_size| {
            integral(&light_picture(&white, Transfer::Srgb, mapping).unwrap(), half_size)[0]
        };
        for mapping in [PictureMapping::EqualArea, PictureMapping::LatLong] {
            assert!((solid_angle(mapping, [1.0; 2]) - 4.0 * PI).abs() < 1e-6);
        }
        // A face of a cube, seen from its middle.
        let face = solid_angle(PictureMapping::Projection, [1.0; 2]);
        assert!((face - 4.0 * PI / 6.0).abs() < 1e-3, "{face}");
        let picture = picture(&white, Transfer::Srgb).unwrap();
        assert_eq!(mean_over_triangle(&picture, [[0.0; 2], [1.0, 0.0], [0.0, 1.0]]), [1.0; 3]);
    }
}
