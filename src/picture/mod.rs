//! Pictures in memory and in files: OpenEXR for results, PNG for looking at.
//!
//! ```
//! use wavepath::picture::{Image, ImageFormat};
//!
//! let image = Image::new(2, 1, vec![[0.5, 0.25, 0.125], [1.0, 2.0, 4.0]]);
//! assert_eq!(image.pixel(1, 0), [1.0, 2.0, 4.0]);
//! assert_eq!(ImageFormat::from_path("out.EXR".as_ref()).unwrap(), ImageFormat::Exr);
//! assert!(ImageFormat::from_path("out.jpg".as_ref()).is_err());
//! ```

mod exr_read;
mod exr_write;
mod png;

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::atomic_file::{self, write_whole};

pub use png::{linear_to_srgb, to_srgb8};

/// Most pixels that a picture may have, in memory or in a file's header: 2^28.
pub const MAX_PIXELS: u64 = 1 << 28;

/// Name of the OpenEXR attribute with the render report as JSON text.
pub const REPORT_ATTRIBUTE: &str = "wavepath";

/// Linear RGB picture, `f32` per channel, with room for further channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels per row, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// `width * height` pixels, rows from top to bottom, each red, green, blue in linear light.
    pub pixels: Vec<[f32; 3]>,
    /// Which part of the full frame the pixels are.
    pub window: DataWindow,
    /// Further channels of the same size: written to OpenEXR, ignored by PNG, not read back.
    pub channels: Vec<Channel>,
    /// Text that travels with the picture in OpenEXR files.
    pub metadata: Metadata,
}

/// Where the stored pixels lie in the full frame, in pixels from its top left corner.
///
/// The corner may be negative in files of other programs (overscan).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataWindow {
    /// Column of the first stored pixel.
    pub x: i32,
    /// Row of the first stored pixel.
    pub y: i32,
    /// Width of the full frame, at least 1.
    pub full_width: u32,
    /// Height of the full frame, at least 1.
    pub full_height: u32,
}

/// A channel beside red, green and blue.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name in the file, with its layer in front: `error.R`, `samples.N`.
    pub name: String,
    /// `width * height` values, rows from top to bottom.
    pub samples: Samples,
}

/// The values of a [`Channel`].
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 32-bit floating point.
    Float(Vec<f32>),
    /// 32-bit unsigned integers.
    Uint(Vec<u32>),
}

impl Samples {
    fn len(&self) -> usize {
        match self {
            Self::Float(values) => values.len(),
            Self::Uint(values) => values.len(),
        }
    }
}

/// Text that travels with a picture.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Metadata {
    /// The render report as JSON, in the attribute [`REPORT_ATTRIBUTE`].
    pub report: Option<String>,
    /// The program that made the picture; wavepath's own name and version when writing `None`.
    pub software: Option<String>,
    /// Who owns the picture.
    pub owner: Option<String>,
}

impl Image {
    /// A picture that fills its frame, without metadata.
    ///
    /// # Panics
    /// If `pixels` does not hold `width * height` elements or is empty.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Self {
        assert!(width > 0 && height > 0, "a picture has at least one pixel");
        assert_eq!(pixels.len() as u64, u64::from(width) * u64::from(height), "pixel count");
        let window = DataWindow { x: 0, y: 0, full_width: width, full_height: height };
        let (channels, metadata) = (Vec::new(), Metadata::default());
        Self { width, height, pixels, window, channels, metadata }
    }

    /// The pixel in column `x` and row `y` of the stored pixels.
    ///
    /// # Panics
    /// If it lies outside.
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 3] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) outside");
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// The part of the picture that `window` covers, if it covers no other pixels.
    ///
    /// The result has `width * height` pixels, its top left one at `window`'s corner. `None` if
    /// the full frames differ or a pixel is missing.
    pub fn crop(&self, window: DataWindow, width: u32, height: u32) -> Option<Self> {
        let same_frame =
            (window.full_width, window.full_height) == (self.window.full_width, self.window.full_height);
        let x = u32::try_from(i64::from(window.x) - i64::from(self.window.x)).ok()?;
        let y = u32::try_from(i64::from(window.y) - i64::from(self.window.y)).ok()?;
        let fits = |start: u32, length: u32, all: u32| {
            length > 0 && u64::from(start) + u64::from(length) <= u64::from(all)
        };
        if !same_frame || !fits(x, width, self.width) || !fits(y, height, self.height) {
            return None;
        }
        let rows = self.pixels.chunks_exact(self.width as usize).skip(y as usize);
        let columns = x as usize..x as usize + width as usize;
        let pixels = rows.take(height as usize).flat_map(|row| &row[columns.clone()]);
        Some(Self { window, ..Self::new(width, height, pixels.copied().collect()) })
    }

    /// Checks that every channel has the picture's size and that no name occurs twice.
    fn validate(&self) -> Result<(), String> {
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels == 0 || pixels > MAX_PIXELS || self.pixels.len() as u64 != pixels {
            return Err(format!("{} x {} is no valid size", self.width, self.height));
        }
        let mut names = vec!["R", "G", "B"];
        for channel in &self.channels {
            if channel.samples.len() as u64 != pixels {
                return Err(format!("channel {} has not the picture's size", channel.name));
            }
            if channel.name.is_empty() || names.contains(&channel.name.as_str()) {
                return Err(format!("the channel name \"{}\" is not unique", channel.name));
            }
            names.push(&channel.name);
        }
        Ok(())
    }
}

/// The file formats that can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// OpenEXR: linear 32-bit floating point, with metadata.
    Exr,
    /// PNG: 8 bits per channel, sRGB.
    Png,
}

impl ImageFormat {
    /// The format that the ending of `path` asks for: `.exr` or `.png`, in any case.
    ///
    /// # Errors
    /// [`ImageError::UnknownFormat`] for any other ending.
    pub fn from_path(path: &Path) -> Result<Self, ImageError> {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or("");
        match ending.to_ascii_lowercase().as_str() {
            "exr" => Ok(Self::Exr),
            "png" => Ok(Self::Png),
            _ => Err(ImageError::UnknownFormat { path: path.into() }),
        }
    }
}

/// Why a picture could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file name has an ending that stands for no known format.
    #[error("cannot tell the image format of \"{}\": expected a name ending in .exr or .png", path.display())]
    UnknownFormat {
        /// The file name.
        path: PathBuf,
    },
    /// The file cannot be read, or what it holds is no usable picture.
    #[error("cannot read image \"{}\": {reason}", path.display())]
    Read {
        /// The file name.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The file cannot be written.
    #[error("cannot write image \"{}\": {reason}", path.display())]
    Write {
        /// The file name.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// Reads the colours of the OpenEXR file `path` as linear RGB; see the formats below.
///
/// Channels `R`, `G`, `B` (or a grey `Y`) of type half, float or uint, with or without a layer
/// name in front, in any part; plain colours are preferred to those of a layer, earlier parts to
/// later ones. Scan lines or tiles, the largest resolution level, every compression except HTJ2K.
/// Deep images and images with subsampled channels are refused, as is a file that promises more
/// than [`MAX_PIXELS`] or than its length can hold.
///
/// # Errors
/// [`ImageError::Read`], which names the file and the reason.
pub fn read(path: &Path) -> Result<Image, ImageError> {
    exr_read::read(path).map_err(|reason| ImageError::Read { path: path.into(), reason })
}

/// Writes `image` to `path`, in the format of its ending; the file appears whole or not at all.
///
/// `exposure` brightens what a PNG shows, in stops: colours are multiplied by `2^exposure`.
/// OpenEXR files keep the values as they are.
///
/// # Errors
/// [`ImageError::UnknownFormat`] or [`ImageError::Write`].
pub fn write(path: &Path, image: &Image, exposure: f32) -> Result<(), ImageError> {
    let format = ImageFormat::from_path(path)?;
    let encoded = image.validate().map_err(EncodeError).and_then(|()| {
        write_whole(path, |file| match format {
            ImageFormat::Exr => exr_write::encode(image, file),
            ImageFormat::Png => png::encode(image, exposure, file),
        })
    });
    encoded.map_err(|EncodeError(reason)| ImageError::Write { path: path.into(), reason })
}

/// `image` as the bytes of a PNG file, brightened by `exposure` stops; or why not, in words.
pub(crate) fn png_bytes(image: &Image, exposure: f32) -> Result<Vec<u8>, String> {
    let mut file = io::Cursor::new(Vec::new());
    png::encode(image, exposure, &mut file).map_err(|EncodeError(reason)| reason)?;
    Ok(file.into_inner())
}

/// Checks that `path` has a known ending and can be written: to be called before rendering.
///
/// # Errors
/// [`ImageError::UnknownFormat`] or [`ImageError::Write`].
pub fn check_writable(path: &Path) -> Result<(), ImageError> {
    ImageFormat::from_path(path)?;
    atomic_file::check_writable(path)
        .map_err(|error| ImageError::Write { path: path.into(), reason: error.to_string() })
}

/// Why an encoder failed, in words.
struct EncodeError(String);

impl From<io::Error> for EncodeError {
    fn from(error: io::Error) -> Self {
        Self(error.to_string())
    }
}

impl From<::exr::error::Error> for EncodeError {
    fn from(error: ::exr::error::Error) -> Self {
        Self(error.to_string())
    }
}

impl From<::image::ImageError> for EncodeError {
    fn from(error: ::image::ImageError) -> Self {
        Self(error.to_string())
    }
}

impl fmt::Display for ImageFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Exr => "OpenEXR",
            Self::Png => "PNG",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;

    #[test]
    fn unknown_endings_say_what_is_expected() {
        for name in ["a.jpg", "a", "exr", "a.exr.gz", ".exr"] {
            let error = ImageFormat::from_path(name.as_ref()).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(".exr or .png"), "{error}");
        }
        assert_eq!(ImageFormat::from_path("a/b.PnG".as_ref()).unwrap(), ImageFormat::Png);
    }

    #[test]
    fn crop_takes_the_pixels_of_the_window() {
        let pixels = (0..12).map(|i| [i as f32; 3]).collect();
        let image = Image::new(4, 3, pixels);
        let window = DataWindow { x: 1, y: 1, ..image.window };
        let crop = image.crop(window, 2, 2).unwrap();
        assert_eq!(crop.pixels, [[5.0; 3], [6.0; 3], [9.0; 3], [10.0; 3]]);
        assert!(image.crop(window, 4, 2).is_none());
        assert!(image.crop(DataWindow { full_width: 5, ..window }, 2, 2).is_none());
        assert!(crop.crop(image.window, 1, 1).is_none());
    }

    #[test]
    fn a_failed_write_leaves_no_file() {
        let folder = TestFolder::new("picture-failed");
        let mut image = Image::new(1, 1, vec![[0.0; 3]]);
        image.channels.push(Channel { name: "R".into(), samples: Samples::Uint(vec![1]) });
        let error = write(&folder.file("a.exr"), &image, 0.0).unwrap_err().to_string();
        assert!(error.contains("a.exr") && error.contains("not unique"), "{error}");
        image.channels[0] = Channel { name: "n".into(), samples: Samples::Uint(vec![]) };
        assert!(write(&folder.file("a.exr"), &image, 0.0).is_err());
        assert!(folder.names().is_empty());
    }
}
