//! A picture as its file has it: as many channels, and samples as large. What textures and lights are made of.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::image::codecs::{jpeg::JpegDecoder, tga::TgaDecoder};
use ::image::{ImageDecoder, ImageError as DecoderError};
use half::f16;

use super::png::srgb_to_linear;
use super::{Image, ImageError, Kind, check_size, decode_file, exr_read, hdr_read, pfm_read, png};

/// A picture as its file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    width: u32,
    height: u32,
    channels: u8,
    samples: RasterSamples,
}

/// The samples of a [`Raster`]: rows from top to bottom, in them pixels from left to right, in those the channels.
#[derive(Debug, Clone, PartialEq)]
pub enum RasterSamples {
    /// 8-bit integers: 255 is 1.
    Bytes(Vec<u8>),
    /// 16-bit integers: 65535 is 1.
    Words(Vec<u16>),
    /// 16-bit floating point: also for files of 32-bit numbers all of which are such.
    Halves(Vec<f16>),
    /// 32-bit floating point.
    Floats(Vec<f32>),
}

impl RasterSamples {
    fn len(&self) -> usize {
        match self {
            Self::Bytes(samples) => samples.len(),
            Self::Words(samples) => samples.len(),
            Self::Halves(samples) => samples.len(),
            Self::Floats(samples) => samples.len(),
        }
    }

    /// Integers, which stand for what a [`Transfer`] makes of them? Floating point is linear light.
    pub fn are_integers(&self) -> bool {
        matches!(self, Self::Bytes(_) | Self::Words(_))
    }
}

/// What an integer sample, from 0 to 1, stands for in linear light.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Transfer {
    /// sRGB (IEC 61966-2-1).
    #[default]
    Srgb,
    /// Itself.
    Linear,
    /// Its power with this exponent, above 0.
    Gamma(f64),
}

impl Transfer {
    /// As pbrt's scenes name it: `sRGB`, `linear`, `gamma 2.2`. `None` for anything else.
    pub fn parse(name: &str) -> Option<Self> {
        match name {
            "sRGB" | "srgb" => Some(Self::Srgb),
            "linear" => Some(Self::Linear),
            _ => {
                let exponent = name.strip_prefix("gamma")?.trim().parse::<f64>().ok()?;
                (exponent > 0.0 && exponent.is_finite()).then_some(Self::Gamma(exponent))
            }
        }
    }

    /// Linear light of a sample, both from 0 to 1.
    pub fn linear(self, sample: f64) -> f64 {
        match self {
            Self::Srgb => srgb_to_linear(sample),
            Self::Linear => sample,
            Self::Gamma(exponent) => sample.powf(exponent),
        }
    }

    /// Linear light of each 8-bit sample.
    pub fn table(self) -> [f32; 256] {
        std::array::from_fn(|sample| self.linear(sample as f64 / 255.0) as f32)
    }
}

impl Raster {
    /// Reads OpenEXR, PNG, Radiance HDR, PFM, JPEG (each known by what it holds) or TGA (known by its name). Sizes are
    /// believed as far as the file's length allows.
    ///
    /// # Errors
    /// [`ImageError::Read`], which names the file and the reason.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        decode_file(path, &Kind::ALL, Self::decode)
    }

    pub(super) fn decode(kind: Kind, file: BufReader<File>, length: u64) -> Result<Self, String> {
        match kind {
            Kind::Exr => exr_read::decode_raster(file, length),
            Kind::Png => png::decode_raster(file, length).map(|decoded| decoded.raster),
            Kind::Hdr => hdr_read::decode(file, length),
            Kind::Pfm => pfm_read::decode(file, length),
            // Of each block of 8 x 8 samples at least one bit is stored.
            Kind::Jpeg => Self::decode_by_image(JpegDecoder::new(file).map_err(explain)?, length, 512),
            // Runs of at most 128 pixels in two bytes.
            Kind::Tga => Self::decode_by_image(TgaDecoder::new(file).map_err(explain)?, length, 64),
        }
    }

    fn decode_by_image(decoder: impl ImageDecoder, length: u64, most: u64) -> Result<Self, String> {
        use ::image::ColorType;
        let (width, height) = decoder.dimensions();
        check_size(width.into(), height.into(), length, most)?;
        let channels = match decoder.color_type() {
            ColorType::L8 => 1,
            ColorType::La8 => 2,
            ColorType::Rgb8 => 3,
            ColorType::Rgba8 => 4,
            other => return Err(format!("its pixels are {other:?}; expected 8 bits a channel")),
        };
        let mut bytes = vec![0; width as usize * height as usize * channels];
        decoder.read_image(&mut bytes).map_err(explain)?;
        let bytes = RasterSamples::Bytes(drop_grey_alpha(bytes, channels));
        Self::new(width, height, without_grey_alpha(channels), bytes).ok_or_else(|| "it is incomplete".into())
    }

    /// A picture of `channels` channels (1: grey, 3: red, green, blue, 4: with alpha). `None` if there are not as many
    /// samples as pixels times channels, no pixels, or another number of channels.
    pub fn new(width: u32, height: u32, channels: u8, samples: RasterSamples) -> Option<Self> {
        let all = u64::from(width) * u64::from(height) * u64::from(channels);
        let fits = matches!(channels, 1 | 3 | 4) && all > 0 && samples.len() as u64 == all;
        fits.then_some(Self { width, height, channels, samples })
    }

    /// One of floating point, kept in 16 bits if that loses nothing.
    pub(super) fn of_floats(width: u32, height: u32, channels: u8, samples: Vec<f32>) -> Self {
        let is_half = |sample: &f32| f16::from_f32(*sample).to_f32() == *sample;
        let samples = match samples.iter().all(is_half) {
            true => RasterSamples::Halves(samples.iter().map(|&sample| f16::from_f32(sample)).collect()),
            false => RasterSamples::Floats(samples),
        };
        Self { width, height, channels, samples }
    }

    /// Pixels per row, at least 1.
    pub fn width(&self) -> u32 {
        self.width
    }
    /// Rows, at least 1.
    pub fn height(&self) -> u32 {
        self.height
    }
    /// 1 (grey), 3 (red, green, blue) or 4 (with alpha).
    pub fn channels(&self) -> u8 {
        self.channels
    }
    /// The samples.
    pub fn samples(&self) -> &RasterSamples {
        &self.samples
    }

    /// Red, green, blue and alpha of a pixel, in linear light (alpha is linear always; 1 where there is none). Rows count
    /// from the top.
    ///
    /// # Panics
    /// If it lies outside.
    pub fn linear(&self, x: u32, y: u32, transfer: Transfer) -> [f32; 4] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) outside");
        let channels = self.channels as usize;
        let first = (y as usize * self.width as usize + x as usize) * channels;
        let integer = |sample: f64, channel: usize| {
            if channel == 3 { sample as f32 } else { transfer.linear(sample) as f32 }
        };
        let sample = |channel: usize| match &self.samples {
            RasterSamples::Bytes(samples) => integer(f64::from(samples[first + channel]) / 255.0, channel),
            RasterSamples::Words(samples) => integer(f64::from(samples[first + channel]) / 65535.0, channel),
            RasterSamples::Halves(samples) => samples[first + channel].to_f32(),
            RasterSamples::Floats(samples) => samples[first + channel],
        };
        match channels {
            1 => [sample(0), sample(0), sample(0), 1.0],
            3 => [sample(0), sample(1), sample(2), 1.0],
            _ => [sample(0), sample(1), sample(2), sample(3)],
        }
    }

    /// Column and row of the first pixel that is infinite or no number.
    pub fn first_not_finite(&self) -> Option<[u32; 2]> {
        let sample = match &self.samples {
            RasterSamples::Bytes(_) | RasterSamples::Words(_) => None,
            RasterSamples::Halves(samples) => samples.iter().position(|sample| !sample.is_finite()),
            RasterSamples::Floats(samples) => samples.iter().position(|sample| !sample.is_finite()),
        };
        sample.map(|sample| {
            let pixel = sample / self.channels as usize;
            [pixel % self.width as usize, pixel / self.width as usize].map(|x| x as u32)
        })
    }

    /// The colours of all pixels in linear light, as [`Raster::linear`] has them.
    pub fn colours(&self, transfer: Transfer) -> Vec<[f32; 3]> {
        let channels = self.channels as usize;
        fn spread<T: Copy>(samples: &[T], channels: usize, value: impl Fn(T) -> f32) -> Vec<[f32; 3]> {
            let colour = |pixel: &[T]| match *pixel {
                [r, g, b, ..] => [value(r), value(g), value(b)],
                _ => [value(pixel[0]); 3],
            };
            samples.chunks_exact(channels).map(colour).collect()
        }
        match &self.samples {
            RasterSamples::Bytes(samples) => {
                let table = transfer.table();
                spread(samples, channels, |byte| table[byte as usize])
            }
            RasterSamples::Words(samples) => {
                spread(samples, channels, |word| transfer.linear(f64::from(word) / 65535.0) as f32)
            }
            RasterSamples::Halves(samples) => spread(samples, channels, f16::to_f32),
            RasterSamples::Floats(samples) => spread(samples, channels, |float| float),
        }
    }

    pub(super) fn into_image(self, transfer: Transfer) -> Result<Image, String> {
        Ok(Image::new(self.width, self.height, self.colours(transfer)))
    }
}

/// The number of channels without the alpha of grey pictures.
pub(super) fn without_grey_alpha(channels: usize) -> u8 {
    if channels == 2 { 1 } else { channels as u8 }
}

/// Leaves out the second of two channels.
pub(super) fn drop_grey_alpha<T: Copy>(mut samples: Vec<T>, channels: usize) -> Vec<T> {
    if channels == 2 {
        let half = samples.len() / 2;
        for i in 0..half {
            samples[i] = samples[2 * i];
        }
        samples.truncate(half);
    }
    samples
}

fn explain(error: DecoderError) -> String {
    match error {
        DecoderError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            "it is truncated".into()
        }
        DecoderError::Unsupported(error) => format!("not supported: {error}"),
        error => format!("it is damaged: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;
    use ::image::{DynamicImage, GrayAlphaImage, GrayImage, ImageFormat, RgbImage, RgbaImage};

    #[test]
    fn files_are_kept_as_they_are() {
        let folder = TestFolder::new("raster");
        let grey = DynamicImage::ImageLuma8(GrayImage::from_raw(2, 1, vec![0, 188]).unwrap());
        let grey_alpha = GrayAlphaImage::from_raw(2, 1, vec![0, 7, 188, 9]).unwrap();
        let colours = vec![10, 20, 30, 40, 50, 60];
        let rgb = DynamicImage::ImageRgb8(RgbImage::from_raw(1, 2, colours.clone()).unwrap());
        let with_alpha = vec![10, 20, 30, 128];
        let rgba = DynamicImage::ImageRgba8(RgbaImage::from_raw(1, 1, with_alpha.clone()).unwrap());
        for (name, image, format, channels, samples) in [
            ("a.png", &grey, ImageFormat::Png, 1, vec![0, 188]),
            ("b.png", &DynamicImage::ImageLumaA8(grey_alpha), ImageFormat::Png, 1, vec![0, 188]),
            ("c.png", &rgb, ImageFormat::Png, 3, colours.clone()),
            ("d.png", &rgba, ImageFormat::Png, 4, with_alpha.clone()),
            ("e.tga", &grey, ImageFormat::Tga, 1, vec![0, 188]),
            ("f.TGA", &rgb, ImageFormat::Tga, 3, colours),
            ("g.tga", &rgba, ImageFormat::Tga, 4, with_alpha),
        ] {
            let path = folder.file(name);
            image.save_with_format(&path, format).unwrap();
            let raster = Raster::read(&path).unwrap();
            assert_eq!(
                (raster.channels(), raster.samples()),
                (channels, &RasterSamples::Bytes(samples)),
                "{name}"
            );
        }
        // The same by any name, but for TGA.
        std::fs::copy(folder.file("c.png"), folder.file("c.jpg")).unwrap();
        assert!(Raster::read(&folder.file("c.jpg")).is_ok());
        let read = Raster::read(&folder.file("d.png")).unwrap().linear(0, 0, Transfer::Srgb);
        assert_eq!(read[3], 128.0 / 255.0);
        assert!((f64::from(read[2]) - srgb_to_linear(30.0 / 255.0)).abs() < 1e-7);
    }

    #[test]
    fn jpeg_and_sixteen_bits() {
        let folder = TestFolder::new("raster-jpeg");
        let flat = DynamicImage::ImageRgb8(RgbImage::from_pixel(40, 24, ::image::Rgb([200, 200, 200])));
        flat.save_with_format(folder.file("a.jpg"), ImageFormat::Jpeg).unwrap();
        let raster = Raster::read(&folder.file("a.jpg")).unwrap();
        assert_eq!((raster.width(), raster.height(), raster.channels()), (40, 24, 3));
        let sample = raster.linear(39, 23, Transfer::Linear)[1] * 255.0;
        assert!((sample - 200.0).abs() < 2.0, "{sample}");
        let image = Image::new(2, 1, vec![[0.5, 0.25, 0.125], [1.0, 0.0, 0.75]]);
        let encoding = crate::picture::Encoding { sixteen_bits: true, ..Default::default() };
        crate::picture::write_encoded(&folder.file("a.png"), &image, &encoding).unwrap();
        let raster = Raster::read(&folder.file("a.png")).unwrap();
        assert!(matches!(raster.samples(), RasterSamples::Words(_)));
        assert!((raster.linear(0, 0, Transfer::Srgb)[0] - 0.5).abs() < 2e-5);
    }

    #[test]
    fn floats_that_are_halves_are_kept_as_such() {
        let folder = TestFolder::new("raster-exr");
        for (value, half) in [(0.125, true), (0.1, false), (1e6, false)] {
            let image = Image::new(2, 2, vec![[0.5, value, 2.0]; 4]);
            crate::picture::write(&folder.file("a.exr"), &image, 0.0).unwrap();
            let raster = Raster::read(&folder.file("a.exr")).unwrap();
            assert_eq!(matches!(raster.samples(), RasterSamples::Halves(_)), half, "{value}");
            assert_eq!(raster.linear(1, 1, Transfer::Srgb), [0.5, value, 2.0, 1.0]);
            assert_eq!(raster.colours(Transfer::Srgb), image.pixels);
        }
        let image = Image::new(3, 1, vec![[0.1, 0.2, 0.3]; 3]);
        let encoding = crate::picture::Encoding { half: true, ..Default::default() };
        crate::picture::write_encoded(&folder.file("h.exr"), &image, &encoding).unwrap();
        let raster = Raster::read(&folder.file("h.exr")).unwrap();
        assert_eq!(raster.samples().len(), 9);
        assert!(matches!(raster.samples(), RasterSamples::Halves(_)));
    }

    #[test]
    fn encodings_have_the_names_of_scenes() {
        assert_eq!(Transfer::parse("sRGB"), Some(Transfer::Srgb));
        assert_eq!(Transfer::parse("linear"), Some(Transfer::Linear));
        assert_eq!(Transfer::parse("gamma 2.2"), Some(Transfer::Gamma(2.2)));
        for wrong in ["gamma", "gamma 0", "gamma -1", "gamma x", "rec709", ""] {
            assert_eq!(Transfer::parse(wrong), None, "{wrong}");
        }
        assert!((Transfer::Gamma(2.0).table()[51] - 0.04).abs() < 1e-6);
    }

    #[test]
    fn damaged_files_are_errors() {
        let folder = TestFolder::new("raster-damaged");
        let noise = RgbImage::from_fn(64, 64, |x, y| ::image::Rgb([(x * y % 251) as u8, x as u8, y as u8]));
        for (name, format) in [("a.jpg", ImageFormat::Jpeg), ("a.tga", ImageFormat::Tga)] {
            let path = folder.file(name);
            DynamicImage::ImageRgb8(noise.clone()).save_with_format(&path, format).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            for length in [0, 3, 17, 40] {
                std::fs::write(&path, &bytes[..length]).unwrap();
                let error = Raster::read(&path).unwrap_err().to_string();
                assert!(error.contains(name), "{error}");
            }
        }
        // 60000 x 60000 pixels in a file of 18 bytes.
        let header = [0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x60, 0xea, 0x60, 0xea, 24, 0];
        std::fs::write(folder.file("b.tga"), header).unwrap();
        let error = Raster::read(&folder.file("b.tga")).unwrap_err().to_string();
        assert!(error.contains("beyond the limit"), "{error}");
        let header = [0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x20, 0, 0x20, 24, 0];
        std::fs::write(folder.file("b.tga"), header).unwrap();
        let error = Raster::read(&folder.file("b.tga")).unwrap_err().to_string();
        assert!(error.contains("cannot be in"), "{error}");
    }
}
