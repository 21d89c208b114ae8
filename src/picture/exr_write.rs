//! OpenEXR, writing: one part of scan lines or tiles, 32-bit or half floating point, any list of channels.

use std::io::{self, Seek, SeekFrom, Write};

use exr::block::writer::ChunksWriter;
use exr::block::{self, BlockIndex, UncompressedBlock};
use exr::error::Error as ExrError;
use exr::math::{RoundingMode, Vec2};
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, Chromaticities, Compression as ExrCompression, IntegerBounds,
    LevelMode, LineOrder, SampleType, Text, TileDescription,
};
use exr::meta::header::{Header, LayerAttributes};
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::f16;
use rayon::prelude::*;

use super::{EncodeError, Encoding, Image, REPORT_ATTRIBUTE, Samples};
use crate::atomic_file::WriteSeek;

/// Blocks that are compressed before their bytes are written: bounds the memory for them.
const BLOCKS_AT_ONCE: usize = 64;

/// Compression of OpenEXR files. All that are here keep every bit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Compression {
    /// None: largest and fastest.
    None,
    /// Runs of equal bytes.
    Rle,
    /// Deflate, line by line.
    Zips,
    /// Deflate over 16 lines.
    #[default]
    Zip,
    /// Wavelets and Huffman codes: small for noisy pictures.
    Piz,
}

/// Largest finite half.
const HALF_MAX: f32 = 65_504.0;

/// Writes `image` as an OpenEXR file.
///
/// Blocks are compressed on the current rayon pool, so that the number of threads is the caller's
/// (the `exr` crate's own feature `rayon` would start a second pool over all cores).
pub(super) fn encode(
    image: &Image,
    encoding: &Encoding,
    file: &mut dyn WriteSeek,
) -> Result<(), EncodeError> {
    let mut planes = planes(image, encoding.half);
    // The format wants channels in the order of their names.
    planes.sort_by(|a, b| a.name.cmp(b.name));
    let header = header(image, encoding, &planes)?;
    let headers = [header].into_iter().collect();
    block::write(Borrowed(file), headers, true, |meta, writer| {
        let indices: Vec<_> = meta.enumerate_ordered_header_block_indices().collect();
        for group in indices.chunks(BLOCKS_AT_ONCE) {
            let chunks: Vec<_> = group
                .par_iter()
                .map(|&(number, index)| Ok((number, compress(image, &planes, &meta, index)?)))
                .collect::<Result<_, ExrError>>()?;
            for (number, chunk) in chunks {
                writer.write_chunk(number, chunk)?;
            }
        }
        Ok(())
    })?;
    Ok(())
}

/// One channel of the file and where its values come from.
struct Plane<'a> {
    name: &'a str,
    source: Source<'a>,
    /// Whether floating point is stored with 16 bits.
    half: bool,
}

enum Source<'a> {
    /// One component of the interleaved colours.
    Colour(&'a [[f32; 3]], usize),
    Float(&'a [f32]),
    Uint(&'a [u32]),
}

impl Plane<'_> {
    fn sample_type(&self) -> SampleType {
        match (&self.source, self.half) {
            (Source::Uint(_), _) => SampleType::U32,
            (_, true) => SampleType::F16,
            (_, false) => SampleType::F32,
        }
    }

    /// Appends `count` values from `start` on in the machine's byte order, as `exr` wants them.
    fn append(&self, start: usize, count: usize, bytes: &mut Vec<u8>) {
        let range = start..start + count;
        match (&self.source, self.half) {
            (Source::Colour(pixels, component), false) => {
                bytes.extend(pixels[range].iter().flat_map(|p| p[*component].to_ne_bytes()));
            }
            (Source::Colour(pixels, component), true) => {
                bytes.extend(pixels[range].iter().flat_map(|p| half(p[*component]).to_ne_bytes()));
            }
            (Source::Float(values), false) => bytes.extend_from_slice(bytemuck::cast_slice(&values[range])),
            (Source::Float(values), true) => {
                bytes.extend(values[range].iter().flat_map(|&value| half(value).to_ne_bytes()));
            }
            (Source::Uint(values), _) => bytes.extend_from_slice(bytemuck::cast_slice(&values[range])),
        }
    }
}

/// To nearest. What is finite stays so: an infinite pixel spoils whatever is done with the picture.
fn half(value: f32) -> f16 {
    f16::from_f32(if value.is_finite() { value.clamp(-HALF_MAX, HALF_MAX) } else { value })
}

fn planes(image: &Image, half: bool) -> Vec<Plane<'_>> {
    let colours = ["R", "G", "B"].into_iter().enumerate();
    let colours = colours.map(|(i, name)| Plane { name, source: Source::Colour(&image.pixels, i), half });
    let others = image.channels.iter().map(|channel| {
        let source = match &channel.samples {
            Samples::Float(values) => Source::Float(values),
            Samples::Uint(values) => Source::Uint(values),
        };
        Plane { name: &channel.name, source, half }
    });
    colours.chain(others).collect()
}

fn compress(
    image: &Image,
    planes: &[Plane],
    meta: &MetaData,
    index: BlockIndex,
) -> Result<block::chunk::Chunk, ExrError> {
    // Whole lines, or the part of them that a tile has.
    let (left, width) = (index.pixel_position.x(), index.pixel_size.width());
    let rows = index.pixel_position.y()..index.pixel_position.y() + index.pixel_size.height();
    let mut data = Vec::with_capacity(rows.len() * width * 4 * planes.len());
    for row in rows {
        for plane in planes {
            plane.append(row * image.width as usize + left, width, &mut data);
        }
    }
    UncompressedBlock { index, data }.compress_to_chunk(&meta.headers)
}

fn header(image: &Image, encoding: &Encoding, planes: &[Plane]) -> Result<Header, EncodeError> {
    let mut channels = Vec::with_capacity(planes.len());
    for plane in planes {
        channels.push(ChannelDescription::named(text(plane.name)?, plane.sample_type()));
    }
    let size = Vec2(image.width as usize, image.height as usize);
    let frame = Vec2(image.window.full_width as usize, image.window.full_height as usize);
    let compression = match encoding.compression {
        Compression::None => ExrCompression::Uncompressed,
        Compression::Rle => ExrCompression::RLE,
        Compression::Zips => ExrCompression::ZIP1,
        Compression::Zip => ExrCompression::ZIP16,
        Compression::Piz => ExrCompression::PIZ,
    };
    let blocks = match encoding.tile {
        None => BlockDescription::ScanLines,
        Some(side) => BlockDescription::Tiles(TileDescription {
            tile_size: Vec2(side.get() as usize, side.get() as usize),
            level_mode: LevelMode::Singular,
            rounding_mode: RoundingMode::Down,
        }),
    };
    let mut header = Header::new(Text::from("wavepath"), size, channels.into())
        .with_encoding(compression, blocks, LineOrder::Increasing)
        .with_display_window(IntegerBounds::new((0, 0), frame))
        .with_attributes(attributes(image)?);
    header.shared_attributes.chromaticities = Some(SRGB);
    Ok(header)
}

/// Primaries and white of sRGB (ITU-R BT.709), in the diagram of CIE 1931.
const SRGB: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

fn attributes(image: &Image) -> Result<LayerAttributes, EncodeError> {
    let metadata = &image.metadata;
    let software = concat!("wavepath ", env!("CARGO_PKG_VERSION"));
    let mut attributes = LayerAttributes {
        layer_name: None,
        software_name: Some(lossy(image.metadata.software.as_deref().unwrap_or(software))),
        owner: image.metadata.owner.as_deref().map(lossy),
        layer_position: Vec2(image.window.x, image.window.y),
        comments: metadata.comments.as_deref().map(lossy),
        capture_date: metadata.capture_date.as_deref().map(lossy),
        utc_offset: metadata.capture_date.is_some().then_some(0.0),
        world_to_camera: metadata.world_to_camera,
        world_to_normalized_device: metadata.world_to_ndc,
        ..LayerAttributes::named("")
    };
    if let Some(report) = &image.metadata.report {
        let report = text(&escape_non_ascii(report))?;
        attributes.other.insert(text(REPORT_ATTRIBUTE)?, AttributeValue::Text(report));
    }
    if let Some(samples) = metadata.samples_per_pixel {
        let samples = AttributeValue::I32(i32::try_from(samples).unwrap_or(i32::MAX));
        attributes.other.insert(text("samplesPerPixel")?, samples);
    }
    if let Some(seconds) = metadata.render_time_seconds {
        attributes.other.insert(text("renderTimeSeconds")?, AttributeValue::F32(seconds));
    }
    Ok(attributes)
}

fn text(string: &str) -> Result<Text, EncodeError> {
    Text::new_or_none(string)
        .ok_or_else(|| EncodeError(format!("\"{string}\" cannot be stored as OpenEXR text")))
}

/// Text with `?` for what OpenEXR cannot store: no reason to lose a picture.
fn lossy(string: &str) -> Text {
    let storable = |c: char| if c.is_ascii() { c as u8 } else { b'?' };
    Text::from_bytes_unchecked(string.chars().map(storable).collect())
}

/// JSON with every character above ASCII as `\uXXXX`, because OpenEXR text has no encoding.
pub(super) fn escape_non_ascii(json: &str) -> String {
    let mut escaped = String::with_capacity(json.len());
    for character in json.chars() {
        if character.is_ascii() {
            escaped.push(character);
        } else {
            for unit in character.encode_utf16(&mut [0; 2]) {
                escaped.push_str(&format!("\\u{unit:04x}"));
            }
        }
    }
    escaped
}

/// `exr` takes its writer by value and by type; this lends it one.
struct Borrowed<'a>(&'a mut dyn WriteSeek);

impl Write for Borrowed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl Seek for Borrowed<'_> {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.0.seek(position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escaped_json_means_the_same() {
        let json = serde_json::json!({ "scene": "Küche/🫖.pbrt" }).to_string();
        let escaped = escape_non_ascii(&json);
        assert!(escaped.is_ascii());
        let parse = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap();
        assert_eq!(parse(&escaped), parse(&json));
    }
}
