//! PNG: 8 bits per channel in sRGB, for looking at.

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::{EncodeError, Image};
use crate::atomic_file::WriteSeek;

/// What stands for a pixel with a NaN in it: magenta, which no lit scene shows by chance.
const NAN_COLOUR: [u8; 3] = [255, 0, 255];

/// The sRGB transfer function (IEC 61966-2-1) from linear light to the encoded value.
///
/// Values outside 0 to 1 are clamped; NaN stays NaN.
pub fn linear_to_srgb(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A linear colour as 8-bit sRGB, rounded to nearest; magenta if a channel is NaN.
pub fn to_srgb8(colour: [f32; 3]) -> [u8; 3] {
    if colour.iter().any(|channel| channel.is_nan()) {
        return NAN_COLOUR;
    }
    colour.map(|channel| (255.0 * linear_to_srgb(f64::from(channel))).round() as u8)
}

/// Writes `image` as PNG, its colours multiplied by `2^exposure`.
pub(super) fn encode(image: &Image, exposure: f32, file: &mut dyn WriteSeek) -> Result<(), EncodeError> {
    let gain = exposure.exp2();
    let bytes: Vec<u8> = image.pixels.iter().flat_map(|pixel| to_srgb8(pixel.map(|c| c * gain))).collect();
    let colour = ExtendedColorType::Rgb8;
    Ok(PngEncoder::new(file).write_image(&bytes, image.width, image.height, colour)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;

    #[test]
    fn transfer_function_has_its_published_values() {
        // 0.5 -> 188 and 0.2140411 -> 0.5 are the usual check values of sRGB.
        assert_eq!(to_srgb8([0.0, 0.5, 1.0]), [0, 188, 255]);
        assert!((linear_to_srgb(0.214_041_14) - 0.5).abs() < 1e-6);
        // Both branches meet at the threshold within the standard's own rounding.
        let gap = linear_to_srgb(0.003_130_8) - linear_to_srgb(0.003_130_81);
        assert!(gap.abs() < 1e-6);
    }

    #[test]
    fn values_out_of_range_are_clamped_and_nan_is_shown() {
        assert_eq!(to_srgb8([-1.0, f32::INFINITY, 7.0]), [0, 255, 255]);
        assert_eq!(to_srgb8([f32::NEG_INFINITY, 0.0, -0.0]), [0, 0, 0]);
        assert_eq!(to_srgb8([f32::NAN, 0.0, 0.0]), NAN_COLOUR);
    }

    #[test]
    fn file_holds_the_exposed_colours() {
        let folder = TestFolder::new("png");
        let path = folder.file("a.png");
        let image = Image::new(2, 1, vec![[0.125, 0.25, 0.5], [0.0, 1.0, f32::NAN]]);
        crate::picture::write(&path, &image, 1.0).unwrap();
        let decoder = ::image::ImageReader::open(&path).unwrap();
        let read = decoder.decode().unwrap().into_rgb8();
        assert_eq!(read.dimensions(), (2, 1));
        assert_eq!(read.get_pixel(0, 0).0, to_srgb8([0.25, 0.5, 1.0]));
        assert_eq!(read.get_pixel(1, 0).0, NAN_COLOUR);
        assert_eq!(folder.names(), ["a.png"]);
    }
}
