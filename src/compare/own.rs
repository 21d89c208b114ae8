//! What a picture knows of its own error: where it is, and whether few pixels hold most of it.

use serde::Serialize;

use super::{EPSILON, is_valid, wide};
use crate::picture::{Image, Samples};

/// Side of the blocks that the error is added up over, in pixels.
pub const BLOCK: u32 = 16;

/// Most blocks of [`OwnError::worst`].
const WORST: usize = 8;

/// Where the estimated error of a picture is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OwnError {
    /// Estimated relMSE over the pixels that are here.
    pub relmse: f64,
    /// Shares of all error that the worst 0.1 %, 1 % and 10 % of the pixels hold (at least one pixel each); 0.001, 0.01
    /// and 0.1 where it lies evenly.
    pub shares: [f64; 3],
    /// The blocks of 16 x 16 pixels with the most error, the worst first.
    pub worst: Vec<Block>,
    /// Pixels without a valid value or error, left out of all figures.
    pub invalid_pixels: u64,
}

/// A block of a picture and what error it holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Block {
    /// `x0, x1, y0, y1` in pixels of the full frame, half open: as `--crop` takes them.
    pub crop: [i32; 4],
    /// Its share of all error.
    pub share: f64,
    /// relMSE over its pixels.
    pub relmse: f64,
    /// Mean of its three channels.
    pub mean: f64,
}

/// The standard errors of the three colours, where a picture has them (`--layers` writes them).
pub(super) fn standard_errors(image: &Image) -> Option<[&[f32]; 3]> {
    let layers = ["stderr.R", "stderr.G", "stderr.B"].map(|name| {
        image.channels.iter().find_map(|channel| match &channel.samples {
            Samples::Float(values) if channel.name == name => Some(values.as_slice()),
            _ => None,
        })
    });
    match layers {
        [Some(red), Some(green), Some(blue)] => Some([red, green, blue]),
        _ => None,
    }
}

/// The estimated squared error of each pixel relative to its value, `s^2 / (I^2 + 0.01)` with its standard error `s`,
/// averaged over the channels; NaN for invalid pixels. `None` without the channels that `--layers` writes.
pub fn own_error_map(image: &Image) -> Option<Vec<f32>> {
    let errors = standard_errors(image)?;
    let error = |(pixel, colour): (usize, &[f32; 3])| {
        let (value, error) = (wide(*colour), wide(errors.map(|channel| channel[pixel])));
        let sum = (0..3).map(|c| error[c].powi(2) / (value[c] * value[c] + EPSILON)).sum::<f64>();
        if is_valid(value, value) { (sum / 3.0) as f32 } else { f32::NAN }
    };
    Some(image.pixels.iter().enumerate().map(error).collect())
}

/// Where the error of a picture is, by its [`own_error_map`]. `None` without a valid pixel.
///
/// # Panics
/// If the map is not as large as the picture.
pub fn own_error(image: &Image, map: &[f32]) -> Option<OwnError> {
    assert_eq!(map.len(), image.pixels.len(), "the map of this picture");
    let mut valid: Vec<f32> = map.iter().copied().filter(|error| error.is_finite()).collect();
    if valid.is_empty() {
        return None;
    }
    valid.sort_unstable_by(|a, b| b.total_cmp(a));
    let total = valid.iter().copied().map(f64::from).sum::<f64>();
    let share = |sum: f64| if total > 0.0 { sum / total } else { 0.0 };
    let shares = [1000, 100, 10].map(|part| {
        let worst = (valid.len() / part).max(1);
        share(valid[..worst].iter().copied().map(f64::from).sum())
    });
    let mut worst: Vec<Block> = (0..image.height.div_ceil(BLOCK))
        .flat_map(|row| (0..image.width.div_ceil(BLOCK)).map(move |column| [column * BLOCK, row * BLOCK]))
        .filter_map(|[left, top]| {
            let (right, lower) = ((left + BLOCK).min(image.width), (top + BLOCK).min(image.height));
            let (mut error, mut value, mut pixels) = (0.0, 0.0, 0_u32);
            for pixel in (top..lower).flat_map(|y| (left..right).map(move |x| (y * image.width + x) as usize))
            {
                if map[pixel].is_finite() {
                    error += f64::from(map[pixel]);
                    value += wide(image.pixels[pixel]).iter().sum::<f64>() / 3.0;
                    pixels += 1;
                }
            }
            let [x, y] = [image.window.x, image.window.y];
            let [x0, x1, y0, y1] = [left, right, top, lower].map(|place| place as i32);
            (error > 0.0).then(|| Block {
                crop: [x0 + x, x1 + x, y0 + y, y1 + y],
                share: share(error),
                relmse: error / f64::from(pixels),
                mean: value / f64::from(pixels),
            })
        })
        .collect();
    worst.sort_by(|a, b| b.share.total_cmp(&a.share));
    worst.truncate(WORST);
    Some(OwnError {
        relmse: total / valid.len() as f64,
        shares,
        worst,
        invalid_pixels: (map.len() - valid.len()) as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{Channel, DataWindow};

    fn of(image: &Image) -> Option<OwnError> {
        own_error(image, &own_error_map(image)?)
    }

    /// 40 x 20 pixels of value 1, with a standard error each.
    fn picture(error: impl Fn(usize) -> f32) -> Image {
        let mut image = Image::new(40, 20, vec![[1.0; 3]; 800]);
        let errors: Vec<f32> = (0..800).map(error).collect();
        image.channels = ["stderr.B", "stderr.G", "stderr.R"]
            .map(|name| Channel { name: name.into(), samples: Samples::Float(errors.clone()) })
            .into();
        image
    }

    #[test]
    fn even_error_is_nowhere_in_particular() {
        let own = of(&picture(|_| 0.1)).unwrap();
        assert!((own.relmse - 0.01 / 1.01).abs() < 1e-8, "{own:?}");
        // One pixel of 800, 8, and 80.
        for (share, expected) in own.shares.into_iter().zip([1.0 / 800.0, 0.01, 0.1]) {
            assert!((share - expected).abs() < 1e-6, "{own:?}");
        }
        assert_eq!(own.worst.len(), 6);
        assert!((own.worst[0].share - 256.0 / 800.0).abs() < 1e-6 && own.worst[0].mean == 1.0);
    }

    #[test]
    fn a_pixel_with_most_of_it_is_found() {
        // Row 17, column 35: the block at the lower right, which is not whole.
        let mut image = picture(|pixel| if pixel == 17 * 40 + 35 { 10.0 } else { 0.1 });
        image.window = DataWindow { x: 100, y: 50, full_width: 640, full_height: 480 };
        image.pixels[3] = [f32::NAN; 3];
        let own = of(&image).unwrap();
        let (one, rest) = (100.0 / 1.01, 798.0 * 0.01 / 1.01);
        assert!((own.shares[0] - one / (one + rest)).abs() < 1e-6, "{own:?}");
        assert_eq!((own.worst[0].crop, own.invalid_pixels), ([132, 140, 66, 70], 1));
        assert!(own.worst[0].share > 0.9 && own.worst[1].share < 0.1);
        assert!(own_error_map(&image).unwrap()[3].is_nan());
    }

    #[test]
    fn without_layers_nothing_is_known() {
        assert_eq!(of(&Image::new(2, 1, vec![[1.0; 3]; 2])), None);
        let mut image = picture(|_| 0.1);
        image.pixels.fill([f32::NAN; 3]);
        assert_eq!(of(&image), None);
    }
}
