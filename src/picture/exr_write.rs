//! OpenEXR, writing: one part of 32-bit scan lines under ZIP, any list of channels.

use std::io::{self, Seek, SeekFrom, Write};

use exr::block::writer::ChunksWriter;
use exr::block::{self, BlockIndex, UncompressedBlock};
use exr::error::Error as ExrError;
use exr::math::Vec2;
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, Compression, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, LayerAttributes};
use exr::meta::{BlockDescription, MetaData};
use rayon::prelude::*;

use super::{EncodeError, Image, REPORT_ATTRIBUTE, Samples};
use crate::atomic_file::WriteSeek;

/// Blocks that are compressed before their bytes are written: bounds the memory for them.
const BLOCKS_AT_ONCE: usize = 64;

/// Writes `image` as an OpenEXR file.
///
/// Blocks are compressed on the current rayon pool, so that the number of threads is the caller's
/// (the `exr` crate's own feature `rayon` would start a second pool over all cores).
pub(super) fn encode(image: &Image, file: &mut dyn WriteSeek) -> Result<(), EncodeError> {
    let mut planes = planes(image);
    // The format wants channels in the order of their names.
    planes.sort_by(|a, b| a.name.cmp(b.name));
    let header = header(image, &planes)?;
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
}

enum Source<'a> {
    /// One component of the interleaved colours.
    Colour(&'a [[f32; 3]], usize),
    Float(&'a [f32]),
    Uint(&'a [u32]),
}

impl Source<'_> {
    fn sample_type(&self) -> SampleType {
        match self {
            Self::Colour(..) | Self::Float(_) => SampleType::F32,
            Self::Uint(_) => SampleType::U32,
        }
    }

    /// Appends `count` values from `start` on in the machine's byte order, as `exr` wants them.
    fn append(&self, start: usize, count: usize, bytes: &mut Vec<u8>) {
        let range = start..start + count;
        match self {
            Self::Colour(pixels, component) => {
                bytes.extend(pixels[range].iter().flat_map(|p| p[*component].to_ne_bytes()));
            }
            Self::Float(values) => bytes.extend_from_slice(bytemuck::cast_slice(&values[range])),
            Self::Uint(values) => bytes.extend_from_slice(bytemuck::cast_slice(&values[range])),
        }
    }
}

fn planes(image: &Image) -> Vec<Plane<'_>> {
    let colours = ["R", "G", "B"].into_iter().enumerate();
    let colours = colours.map(|(i, name)| Plane { name, source: Source::Colour(&image.pixels, i) });
    let others = image.channels.iter().map(|channel| {
        let source = match &channel.samples {
            Samples::Float(values) => Source::Float(values),
            Samples::Uint(values) => Source::Uint(values),
        };
        Plane { name: &channel.name, source }
    });
    colours.chain(others).collect()
}

fn compress(
    image: &Image,
    planes: &[Plane],
    meta: &MetaData,
    index: BlockIndex,
) -> Result<block::chunk::Chunk, ExrError> {
    let width = image.width as usize;
    let rows = index.pixel_position.y()..index.pixel_position.y() + index.pixel_size.height();
    let mut data = Vec::with_capacity(rows.len() * width * 4 * planes.len());
    for row in rows {
        for plane in planes {
            plane.source.append(row * width, width, &mut data);
        }
    }
    UncompressedBlock { index, data }.compress_to_chunk(&meta.headers)
}

fn header(image: &Image, planes: &[Plane]) -> Result<Header, EncodeError> {
    let mut channels = Vec::with_capacity(planes.len());
    for plane in planes {
        channels.push(ChannelDescription::named(text(plane.name)?, plane.source.sample_type()));
    }
    let size = Vec2(image.width as usize, image.height as usize);
    let frame = Vec2(image.window.full_width as usize, image.window.full_height as usize);
    Ok(Header::new(Text::from("wavepath"), size, channels.into())
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_display_window(IntegerBounds::new((0, 0), frame))
        .with_attributes(attributes(image)?))
}

fn attributes(image: &Image) -> Result<LayerAttributes, EncodeError> {
    let software = concat!("wavepath ", env!("CARGO_PKG_VERSION"));
    let mut attributes = LayerAttributes {
        layer_name: None,
        software_name: Some(lossy(image.metadata.software.as_deref().unwrap_or(software))),
        owner: image.metadata.owner.as_deref().map(lossy),
        layer_position: Vec2(image.window.x, image.window.y),
        ..LayerAttributes::named("")
    };
    if let Some(report) = &image.metadata.report {
        let report = text(&escape_non_ascii(report))?;
        attributes.other.insert(text(REPORT_ATTRIBUTE)?, AttributeValue::Text(report));
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
fn escape_non_ascii(json: &str) -> String {
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
