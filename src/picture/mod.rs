//! Pictures in memory and in files: OpenEXR for results, PNG for looking at; Radiance HDR, PFM, JPEG and TGA are read.
//! A [`Raster`] is a picture as its file has it, for textures and lights.
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
mod hdr_read;
mod pfm_read;
mod png;
mod raster;
mod tonemap;

use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::num::NonZeroU16;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::atomic_file::{self, write_whole};
use crate::contain_panics::contain_panics;

pub use exr_write::Compression;
pub use png::{linear_to_srgb, srgb_to_linear, to_srgb8};
pub use raster::{Raster, RasterSamples, Transfer};
pub use tonemap::Tonemap;

/// Most pixels that a picture may have, in memory or in a file's header: 2^28.
pub const MAX_PIXELS: u64 = 1 << 28;

/// Name of the OpenEXR attribute, and keyword of the PNG text, with the render report as JSON.
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
    /// Further channels of the same size: written to OpenEXR, ignored by PNG, read by [`read_layers`] only.
    pub channels: Vec<Channel>,
    /// What travels with the picture.
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

/// What travels with a picture. All of it is written to OpenEXR, under the names that pbrt and its tools know; the
/// texts to PNG, too. All are read back from OpenEXR, report and program from PNG.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metadata {
    /// The render report as JSON, in the attribute [`REPORT_ATTRIBUTE`].
    pub report: Option<String>,
    /// The program that made the picture; wavepath's own name and version when writing `None`.
    pub software: Option<String>,
    /// Who owns the picture.
    pub owner: Option<String>,
    /// `comments`: anything.
    pub comments: Option<String>,
    /// `capDate`: when it was rendered, `YYYY:MM:DD hh:mm:ss`, in universal time.
    pub capture_date: Option<String>,
    /// `samplesPerPixel`, rounded where pixels differ.
    pub samples_per_pixel: Option<u32>,
    /// `renderTimeSeconds`.
    pub render_time_seconds: Option<f32>,
    /// `worldToCamera`: rows of the matrix that takes points, as columns, from world to camera space, as pbrt writes it.
    pub world_to_camera: Option<[f32; 16]>,
    /// `worldToNDC`: the same to the screen, whose shorter axis spans 0 to 1.
    pub world_to_ndc: Option<[f32; 16]>,
}

/// How a picture becomes a file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Encoding {
    /// Stops by which a PNG is brighter; OpenEXR files keep the values.
    pub exposure: f32,
    /// Curve of a PNG.
    pub tonemap: Tonemap,
    /// 16 bits a channel in a PNG, not 8.
    pub sixteen_bits: bool,
    /// 16-bit floating point in OpenEXR, not 32-bit: values up to 65504, with 11 bits of precision.
    pub half: bool,
    /// Compression of OpenEXR.
    pub compression: Compression,
    /// OpenEXR in square tiles of so many pixels a side, not in lines: programs that show a part of a big picture read
    /// that part alone. A picture that is smaller is one tile.
    pub tile: Option<NonZeroU16>,
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
    /// The result has `width * height` pixels, its top left one at `window`'s corner, and no metadata: those speak of
    /// the whole. `None` if the full frames differ or a pixel is missing.
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
        let (rows, columns) = (y as usize..(y + height) as usize, x as usize..(x + width) as usize);
        let row_length = self.width as usize;
        let pixels = part(&self.pixels, row_length, &rows, &columns);
        let channels = self.channels.iter().map(|Channel { name, samples }| Channel {
            name: name.clone(),
            samples: match samples {
                Samples::Float(values) => Samples::Float(part(values, row_length, &rows, &columns)),
                Samples::Uint(values) => Samples::Uint(part(values, row_length, &rows, &columns)),
            },
        });
        Some(Self { window, channels: channels.collect(), ..Self::new(width, height, pixels) })
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

fn part<T: Copy>(values: &[T], row_length: usize, rows: &Range<usize>, columns: &Range<usize>) -> Vec<T> {
    let rows = values.chunks_exact(row_length).skip(rows.start).take(rows.len());
    rows.flat_map(|row| &row[columns.clone()]).copied().collect()
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
    /// The format that the ending of `path` asks for: `.exr` or `.png`, in any case. Standard output, `-`, gets OpenEXR;
    /// `exr:-` and `png:-` name its format.
    ///
    /// # Errors
    /// [`ImageError::UnknownFormat`] for any other ending.
    pub fn from_path(path: &Path) -> Result<Self, ImageError> {
        match path.to_str() {
            Some("-" | "exr:-") => return Ok(Self::Exr),
            Some("png:-") => return Ok(Self::Png),
            _ => {}
        }
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
    read_as(path, &[Kind::Exr], false)
}

/// As [`read`], with all further channels of the part that holds the colours.
///
/// # Errors
/// As [`read`].
pub fn read_layers(path: &Path) -> Result<Image, ImageError> {
    read_as(path, &Kind::ALL, true)
}

/// As [`read`], also PNG (8 and 16 bits, as linear light, without alpha), Radiance HDR, PFM, JPEG and TGA (both taken for
/// sRGB). What a file holds decides, not its name; but a TGA is known by its name only, having no mark of its own.
///
/// # Errors
/// As [`read`].
pub fn read_any(path: &Path) -> Result<Image, ImageError> {
    read_as(path, &Kind::ALL, false)
}

/// What travels with the picture in the OpenEXR or PNG file `path`, without reading its pixels where that can be.
///
/// # Errors
/// As [`read`].
pub fn read_metadata(path: &Path) -> Result<Metadata, ImageError> {
    match exr_read::read_metadata(path) {
        Some(metadata) => Ok(metadata),
        None => read_any(path).map(|image| image.metadata),
    }
}

/// Formats that are read, by their first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Exr,
    Png,
    Hdr,
    Pfm,
    Jpeg,
    /// Without a mark: known by the name.
    Tga,
}

impl Kind {
    const ALL: [Kind; 6] = [Kind::Exr, Kind::Png, Kind::Hdr, Kind::Pfm, Kind::Jpeg, Kind::Tga];

    fn of(start: &[u8], path: &Path) -> Option<Kind> {
        let magics: [(&[u8], Kind); 6] = [
            (&exr_read::MAGIC, Kind::Exr),
            (b"\x89PNG", Kind::Png),
            (&hdr_read::MAGIC, Kind::Hdr),
            (b"PF", Kind::Pfm),
            (b"Pf", Kind::Pfm),
            (b"\xff\xd8\xff", Kind::Jpeg),
        ];
        let marked = magics.into_iter().find(|(magic, _)| start.starts_with(magic)).map(|(_, kind)| kind);
        let tga = || path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("tga"));
        marked.or_else(|| tga().then_some(Kind::Tga))
    }
}

/// Opens a file that is one of some formats, hands it to its decoder, with its length, and explains what goes wrong.
fn decode_file<T>(
    path: &Path,
    kinds: &[Kind],
    decode: impl FnOnce(Kind, BufReader<File>, u64) -> Result<T, String>,
) -> Result<T, ImageError> {
    let read = || {
        let mut file = File::open(path).map_err(|error| error.to_string())?;
        let metadata = file.metadata().map_err(|error| error.to_string())?;
        if !metadata.is_file() {
            return Err("it is not a regular file".into());
        }
        let mut start = Vec::new();
        let mut head = (&mut file).take(4);
        head.read_to_end(&mut start).map_err(|error| error.to_string())?;
        let kind = Kind::of(&start, path).filter(|kind| kinds.contains(kind));
        let Some(kind) = kind else {
            let others = if kinds.len() > 1 { ", PNG, Radiance HDR, PFM, JPEG or TGA" } else { "" };
            return Err(format!("it is not an OpenEXR{others} file"));
        };
        file.rewind().map_err(|error| error.to_string())?;
        // The decoders of others index and subtract on what a damaged file says.
        contain_panics(|| decode(kind, BufReader::new(file), metadata.len()))
            .unwrap_or_else(|| Err("its data are damaged".into()))
    };
    read().map_err(|reason: String| ImageError::Read { path: path.into(), reason })
}

fn read_as(path: &Path, kinds: &[Kind], layers: bool) -> Result<Image, ImageError> {
    decode_file(path, kinds, |kind, file, length| match kind {
        Kind::Exr => exr_read::decode(file, length, layers),
        Kind::Png => png::decode(file, length),
        Kind::Hdr | Kind::Pfm | Kind::Jpeg | Kind::Tga => {
            Raster::decode(kind, file, length)?.into_image(Transfer::Srgb)
        }
    })
}

/// Refuses a size that a header states, but no picture has or no file of `length` bytes can hold, of which each makes
/// `most` pixels at most.
fn check_size(width: u64, height: u64, length: u64, most: u64) -> Result<(), String> {
    if width == 0 || height == 0 {
        return Err("it has no pixels".into());
    }
    let pixels = width.saturating_mul(height);
    if pixels > MAX_PIXELS {
        return Err(format!("its size of {width} x {height} is beyond the limit of {MAX_PIXELS} pixels"));
    }
    if pixels / most > length {
        return Err(format!(
            "it is truncated or damaged: {width} x {height} pixels cannot be in {length} bytes"
        ));
    }
    Ok(())
}

/// Writes `image` to `path`, in the format of its ending; the file appears whole or not at all.
///
/// `exposure` brightens what a PNG shows, in stops: colours are multiplied by `2^exposure`.
/// OpenEXR files keep the values as they are.
///
/// # Errors
/// [`ImageError::UnknownFormat`] or [`ImageError::Write`].
pub fn write(path: &Path, image: &Image, exposure: f32) -> Result<(), ImageError> {
    write_encoded(path, image, &Encoding { exposure, ..Encoding::default() })
}

/// As [`write()`], with everything that can be chosen.
///
/// # Errors
/// As [`write()`].
pub fn write_encoded(path: &Path, image: &Image, encoding: &Encoding) -> Result<(), ImageError> {
    let format = ImageFormat::from_path(path)?;
    let encoded = image.validate().map_err(EncodeError).and_then(|()| {
        write_whole(path, |file| match format {
            ImageFormat::Exr => exr_write::encode(image, encoding, file),
            ImageFormat::Png => png::encode(image, encoding, file),
        })
    });
    encoded.map_err(|EncodeError(reason)| ImageError::Write { path: path.into(), reason })
}

/// `image` as the bytes of a PNG file, brightened by `exposure` stops; or why not, in words.
pub(crate) fn png_bytes(image: &Image, exposure: f32) -> Result<Vec<u8>, String> {
    let mut file = io::Cursor::new(Vec::new());
    png::encode(image, &Encoding { exposure, ..Encoding::default() }, &mut file)
        .map_err(|EncodeError(reason)| reason)?;
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

impl From<::png::EncodingError> for EncodeError {
    fn from(error: ::png::EncodingError) -> Self {
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
