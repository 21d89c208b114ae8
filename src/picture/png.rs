//! PNG: 8 or 16 bits per channel in sRGB, for looking at; and what other programs wrote, for comparing.

use std::io::{BufRead, Seek};

use png::{BitDepth, ColorType, Decoder, Limits, SrgbRenderingIntent, Transformations};

use super::exr_write::escape_non_ascii;
use super::raster::{Raster, RasterSamples, Transfer, drop_grey_alpha, without_grey_alpha};
use super::{DataWindow, EncodeError, Encoding, Image, Metadata, REPORT_ATTRIBUTE, check_size};
use crate::atomic_file::WriteSeek;

/// What stands for a pixel with a NaN in it: magenta, which no lit scene shows by chance.
const NAN_COLOUR: [f64; 3] = [1.0, 0.0, 1.0];

/// Keyword of the text with the place in the full frame: `x y width height`, the last two those of the frame.
const WINDOW_KEYWORD: &str = "wavepath window";

/// The sRGB transfer function (IEC 61966-2-1) from linear light to the encoded value.
///
/// Values outside 0 to 1 are clamped; NaN stays NaN.
pub fn linear_to_srgb(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`linear_to_srgb`], for values from 0 to 1.
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// A linear colour as 8-bit sRGB, rounded to nearest; magenta if a channel is NaN.
pub fn to_srgb8(colour: [f32; 3]) -> [u8; 3] {
    encoded(colour, &Encoding::default()).map(|channel| (255.0 * channel).round() as u8)
}

/// A linear colour as it is shown, from 0 to 1.
fn encoded(colour: [f32; 3], encoding: &Encoding) -> [f64; 3] {
    if colour.iter().any(|channel| channel.is_nan()) {
        return NAN_COLOUR;
    }
    let gain = encoding.exposure.exp2();
    encoding.tonemap.apply(colour.map(|channel| channel * gain)).map(linear_to_srgb)
}

/// Writes `image` as PNG.
pub(super) fn encode(
    image: &Image,
    encoding: &Encoding,
    file: &mut dyn WriteSeek,
) -> Result<(), EncodeError> {
    let colours = image.pixels.iter().flat_map(|&pixel| encoded(pixel, encoding));
    let (depth, bytes): (BitDepth, Vec<u8>) = if encoding.sixteen_bits {
        (BitDepth::Sixteen, colours.flat_map(|c| ((65535.0 * c).round() as u16).to_be_bytes()).collect())
    } else {
        (BitDepth::Eight, colours.map(|c| (255.0 * c).round() as u8).collect())
    };
    let mut encoder = png::Encoder::new(file, image.width, image.height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(depth);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    let software = image.metadata.software.clone();
    let software = software.unwrap_or_else(|| concat!("wavepath ", env!("CARGO_PKG_VERSION")).into());
    encoder.add_text_chunk("Software".into(), escape_non_ascii(&software))?;
    if let Some(comments) = &image.metadata.comments {
        encoder.add_itxt_chunk("Comment".into(), comments.clone())?;
    }
    let window = image.window;
    if (window.full_width, window.full_height) != (image.width, image.height) {
        let DataWindow { x, y, full_width, full_height } = window;
        let text = format!("{x} {y} {full_width} {full_height}");
        encoder.add_text_chunk(WINDOW_KEYWORD.into(), text)?;
    }
    if let Some(report) = &image.metadata.report {
        encoder.add_text_chunk(REPORT_ATTRIBUTE.into(), escape_non_ascii(report))?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&bytes)?;
    Ok(writer.finish()?)
}

/// Reads a PNG file of `length` bytes as linear light; an alpha channel is left out.
pub(super) fn decode(file: impl BufRead + Seek, length: u64) -> Result<Image, String> {
    let Decoded { raster, gamma, window, metadata } = decode_raster(file, length)?;
    let transfer = match gamma {
        // What is nearly sRGB's average is meant to be sRGB.
        Some(gamma) if (gamma - 1.0 / 2.2).abs() > 0.01 && gamma > 0.0 => Transfer::Gamma(1.0 / gamma),
        _ => Transfer::Srgb,
    };
    let image = raster.into_image(transfer)?;
    Ok(Image { window: window.unwrap_or(image.window), metadata, ..image })
}

/// What a PNG file holds.
pub(super) struct Decoded {
    pub(super) raster: Raster,
    /// Its chunk `gAMA`, where there is no chunk `sRGB`.
    gamma: Option<f64>,
    window: Option<DataWindow>,
    metadata: Metadata,
}

/// Reads a PNG file of `length` bytes as it is stored, but for palettes and depths below 8 bits, which are spread out. Of
/// grey with alpha the alpha is left out.
pub(super) fn decode_raster(file: impl BufRead + Seek, length: u64) -> Result<Decoded, String> {
    let explain = |error: png::DecodingError| match error {
        png::DecodingError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            "it is truncated".to_string()
        }
        error => format!("it is damaged: {error}"),
    };
    let limits = Limits { bytes: 64 << 20 };
    let mut decoder = Decoder::new_with_limits(file, limits);
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(explain)?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    // Deflate makes at most 1032 bytes of one, a byte at most 8 pixels.
    check_size(width.into(), height.into(), length, 8 * 1040)?;
    let gamma = info.gama_chunk.filter(|_| info.srgb.is_none()).map(|gamma| f64::from(gamma.into_value()));
    let metadata = metadata(info);
    let window = window(info);
    let size = reader.output_buffer_size().ok_or("its size is out of range")?;
    let mut bytes = vec![0; size];
    let frame = reader.next_frame(&mut bytes).map_err(explain)?;
    bytes.truncate(frame.buffer_size());
    let channels = frame.color_type.samples();
    let raster = match frame.bit_depth {
        BitDepth::Sixteen => {
            let words = bytes.as_chunks::<2>().0.iter().map(|&pair| u16::from_be_bytes(pair)).collect();
            let words = RasterSamples::Words(drop_grey_alpha(words, channels));
            Raster::new(width, height, without_grey_alpha(channels), words)
        }
        _ => {
            let bytes = RasterSamples::Bytes(drop_grey_alpha(bytes, channels));
            Raster::new(width, height, without_grey_alpha(channels), bytes)
        }
    };
    Ok(Decoded { raster: raster.ok_or("it is incomplete")?, gamma, window, metadata })
}

fn text<'a>(info: &'a png::Info, keyword: &str) -> Option<&'a str> {
    info.uncompressed_latin1_text
        .iter()
        .find(|chunk| chunk.keyword == keyword)
        .map(|chunk| chunk.text.as_str())
}

fn metadata(info: &png::Info) -> Metadata {
    let [report, software] =
        [REPORT_ATTRIBUTE, "Software"].map(|keyword| text(info, keyword).map(String::from));
    Metadata { report, software, ..Metadata::default() }
}

fn window(info: &png::Info) -> Option<DataWindow> {
    let mut numbers = text(info, WINDOW_KEYWORD)?.split(' ').map(|word| word.parse::<i32>().ok());
    let mut next = || numbers.next().flatten();
    let (x, y, width, height) = (next()?, next()?, next()?, next()?);
    let (full_width, full_height) = (u32::try_from(width).ok()?, u32::try_from(height).ok()?);
    Some(DataWindow { x, y, full_width, full_height })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;
    use crate::picture::Tonemap;

    #[test]
    fn transfer_function_has_its_published_values() {
        // 0.5 -> 188 and 0.2140411 -> 0.5 are the usual check values of sRGB.
        assert_eq!(to_srgb8([0.0, 0.5, 1.0]), [0, 188, 255]);
        assert!((linear_to_srgb(0.214_041_14) - 0.5).abs() < 1e-6);
        // Both branches meet at the threshold within the standard's own rounding.
        let gap = linear_to_srgb(0.003_130_8) - linear_to_srgb(0.003_130_81);
        assert!(gap.abs() < 1e-6);
        for step in 0..=100 {
            let x = f64::from(step) / 100.0;
            assert!((linear_to_srgb(srgb_to_linear(x)) - x).abs() < 1e-6);
        }
    }

    #[test]
    fn values_out_of_range_are_clamped_and_nan_is_shown() {
        assert_eq!(to_srgb8([-1.0, f32::INFINITY, 7.0]), [0, 255, 255]);
        assert_eq!(to_srgb8([f32::NEG_INFINITY, 0.0, -0.0]), [0, 0, 0]);
        assert_eq!(to_srgb8([f32::NAN, 0.0, 0.0]), [255, 0, 255]);
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
        assert_eq!(read.get_pixel(1, 0).0, [255, 0, 255]);
        assert_eq!(folder.names(), ["a.png"]);
    }

    #[test]
    fn files_say_what_they_are_and_are_read_back() {
        let folder = TestFolder::new("png-text");
        let path = folder.file("a.png");
        let mut image = Image::new(2, 2, vec![[0.125, 0.25, 0.5], [0.0, 1.0, 0.7], [0.5; 3], [2.0; 3]]);
        image.window = DataWindow { x: 3, y: 4, full_width: 10, full_height: 20 };
        image.metadata.report = Some("{\"scene\":\"Küche\"}".into());
        let encoding = Encoding { sixteen_bits: true, ..Encoding::default() };
        crate::picture::write_encoded(&path, &image, &encoding).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.windows(4).any(|word| word == b"sRGB"));
        let read = crate::picture::read_any(&path).unwrap();
        assert_eq!(read.window, image.window);
        let report: serde_json::Value = serde_json::from_str(&read.metadata.report.unwrap()).unwrap();
        assert_eq!(report["scene"], "Küche");
        for (read, written) in read.pixels.iter().zip(&image.pixels) {
            for (a, b) in read.iter().zip(written) {
                assert!((a - b.min(1.0)).abs() < 3e-5, "{a} {b}");
            }
        }
    }

    #[test]
    fn a_curve_changes_what_is_shown() {
        let folder = TestFolder::new("png-curve");
        let image = Image::new(1, 1, vec![[4.0; 3]]);
        let shown = |tonemap| {
            let path = folder.file("a.png");
            crate::picture::write_encoded(&path, &image, &Encoding { tonemap, ..Encoding::default() })
                .unwrap();
            crate::picture::read_any(&path).unwrap().pixels[0][1]
        };
        assert_eq!(shown(Tonemap::Srgb), 1.0);
        assert!(shown(Tonemap::Agx) < 0.95 && shown(Tonemap::Aces) < 0.99);
    }

    #[test]
    fn damaged_files_are_errors() {
        let folder = TestFolder::new("png-damaged");
        let path = folder.file("a.png");
        crate::picture::write(&path, &Image::new(30, 30, vec![[0.3, 0.2, 0.1]; 900]), 0.0).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in [8, 20, 40, bytes.len() / 2, bytes.len() - 20] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(crate::picture::read_any(&path).is_err(), "{length}");
        }
        let mut giant = bytes.clone();
        giant[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 0, 16, 0]);
        std::fs::write(&path, &giant).unwrap();
        assert!(crate::picture::read_any(&path).is_err());
    }
}
