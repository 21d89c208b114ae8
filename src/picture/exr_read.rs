//! OpenEXR, reading: the colours of whatever another renderer wrote.
//!
//! A file's header is only believed as far as the file's length allows: nothing is allocated on
//! the word of a header alone.

use std::collections::HashSet;
use std::io::{Read, Seek};
use std::path::Path;

use exr::block::reader::{ChunksReader, Reader};
use exr::block::{self, UncompressedBlock};
use exr::error::Error as ExrError;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, Compression, SampleType, Text};
use exr::meta::header::Header;
use exr::prelude::f16;

use super::raster::{Raster, RasterSamples};
use super::{Channel, DataWindow, Image, MAX_PIXELS, Metadata, REPORT_ATTRIBUTE, Samples};
use crate::contain_panics::contain_panics;

/// First bytes of every OpenEXR file.
pub(super) const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// What travels with the first part of a file, from its header alone; `None` if it is no OpenEXR file.
pub(super) fn read_metadata(path: &Path) -> Option<Metadata> {
    let meta = contain_panics(|| MetaData::read_from_file(path, false)).and_then(Result::ok)?;
    meta.headers.first().map(metadata)
}

/// Decodes an OpenEXR file of `length` bytes; with the further channels of its part if `layers` is set.
pub(super) fn decode(file: impl Read + Seek, length: u64, layers: bool) -> Result<Image, String> {
    let reader = block::read(file, false).map_err(explain)?;
    let source = choose_channels(reader.headers())?;
    for header in reader.headers() {
        check_plausible(header, length)?;
    }
    let header = reader.headers()[source.part].clone();
    let size = u64::from(to_u32(header.layer_size.0)?) * u64::from(to_u32(header.layer_size.1)?);
    if size > MAX_PIXELS {
        return Err(too_large(&header));
    }
    let mut target = Target::new(&header, &source, size as usize, layers);
    let layout = RowLayout::new(&header, &source);
    read_blocks(reader, &header, &source, |block| {
        copy_block(block, &layout, header.layer_size, &mut target)
    })?;
    let Target { pixels, others } = target;
    Ok(Image {
        width: to_u32(header.layer_size.width())?,
        height: to_u32(header.layer_size.height())?,
        pixels,
        window: data_window(&header)?,
        channels: others.into_iter().map(|(_, channel)| channel).collect(),
        metadata: metadata(&header),
    })
}

/// Decodes an OpenEXR file of `length` bytes as it is stored: a grey or red, green and blue, with the alpha of the same
/// layer if there is one; half where all of them are.
pub(super) fn decode_raster(file: impl Read + Seek, length: u64) -> Result<Raster, String> {
    let reader = block::read(file, false).map_err(explain)?;
    let source = choose_channels(reader.headers())?;
    for header in reader.headers() {
        check_plausible(header, length)?;
    }
    let header = reader.headers()[source.part].clone();
    let (width, height) = (to_u32(header.layer_size.width())?, to_u32(header.layer_size.height())?);
    let [red, green, _] = source.channels;
    let mut channels = if red == green { vec![red] } else { source.channels.to_vec() };
    channels.extend(alpha_beside(&header, red).filter(|_| red != green));
    let count = channels.len();
    let size = width as usize * height as usize * count;
    let list = &header.channels.list;
    let half = channels.iter().all(|&channel| list[channel].sample_type == SampleType::F16);
    let (mut halves, mut floats) =
        (vec![f16::ZERO; if half { size } else { 0 }], vec![0.0; if half { 0 } else { size }]);
    let layout = RowLayout::new(&header, &source);
    read_blocks(reader, &header, &source, |block| {
        for_rows(block, &layout, header.layer_size, |start, width, bytes| {
            for (component, &channel) in channels.iter().enumerate() {
                let (before, sample_type) = layout.channels[channel];
                let bytes = &bytes[before * width..];
                let range = start * count..(start + width) * count;
                if half {
                    let targets = halves[range].iter_mut().skip(component).step_by(count);
                    for (target, &bytes) in targets.zip(bytes.as_chunks::<2>().0) {
                        *target = f16::from_ne_bytes(bytes);
                    }
                } else {
                    let targets = floats[range].iter_mut().skip(component).step_by(count);
                    copy_samples(bytes, sample_type, targets);
                }
            }
        })
    })?;
    let count = count as u8;
    if half {
        Raster::new(width, height, count, RasterSamples::Halves(halves))
            .ok_or_else(|| "it has no pixels".into())
    } else {
        Ok(Raster::of_floats(width, height, count, floats))
    }
}

/// The alpha channel of the layer that holds channel `red`.
fn alpha_beside(header: &Header, red: usize) -> Option<usize> {
    let list = &header.channels.list;
    let name = list[red].name.to_string();
    let layer = &name[..name.len() - 1];
    list.iter().position(|channel| channel.name.to_string().eq_ignore_ascii_case(&format!("{layer}A")))
}

/// What is read into.
struct Target {
    pixels: Vec<[f32; 3]>,
    /// Further channels, with their place in the list of the part.
    others: Vec<(usize, Channel)>,
}

impl Target {
    fn new(header: &Header, source: &ColourChannels, size: usize, layers: bool) -> Self {
        let list = header.channels.list.iter().enumerate();
        let further = list.filter(|(index, channel)| {
            layers && !source.channels.contains(index) && channel.sampling == Vec2(1, 1)
        });
        let others = further.map(|(index, channel)| {
            let samples = match channel.sample_type {
                SampleType::U32 => Samples::Uint(vec![0; size]),
                _ => Samples::Float(vec![0.0; size]),
            };
            (index, Channel { name: channel.name.to_string(), samples })
        });
        Target { pixels: vec![[0.0; 3]; size], others: others.collect() }
    }
}

/// The channels to read: their part and, for red, green and blue, their place in its list.
#[derive(Debug, PartialEq)]
struct ColourChannels {
    part: usize,
    channels: [usize; 3],
}

/// Plain red, green, blue first, then those of a layer, then a grey; earlier parts first.
fn choose_channels(headers: &[Header]) -> Result<ColourChannels, String> {
    let mut best: Option<(u32, ColourChannels)> = None;
    for (part, header) in headers.iter().enumerate() {
        let names: Vec<String> =
            header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
        for (rank, channels) in colour_candidates(&names) {
            if best.as_ref().is_none_or(|(best_rank, _)| rank < *best_rank) {
                best = Some((rank, ColourChannels { part, channels }));
            }
        }
    }
    let Some((_, source)) = best else {
        let names = headers.iter().flat_map(|header| &header.channels.list);
        let names: Vec<_> = names.take(16).map(|channel| channel.name.to_string()).collect();
        return Err(format!("it has no channels R, G and B, nor Y, but {}", names.join(", ")));
    };
    if headers[source.part].channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return Err("it has subsampled channels, which are not supported".into());
    }
    Ok(source)
}

/// Every group of channels that makes a colour, with its rank: lower is better.
fn colour_candidates(names: &[String]) -> Vec<(u32, [usize; 3])> {
    let find = |name: String| names.iter().position(|n| n.eq_ignore_ascii_case(&name));
    let mut candidates = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let (layer, base) = name.split_at(name.rfind('.').map_or(0, |dot| dot + 1));
        let in_layer = u32::from(!layer.is_empty());
        if base.eq_ignore_ascii_case("r") {
            let rest = (find(format!("{layer}G")), find(format!("{layer}B")));
            if let (Some(green), Some(blue)) = rest {
                candidates.push((in_layer, [index, green, blue]));
            }
        } else if base.eq_ignore_ascii_case("y") {
            candidates.push((2 + in_layer, [index; 3]));
        }
    }
    candidates
}

/// Refuses a header that promises more than [`MAX_PIXELS`], or than a file of `length` bytes can
/// hold under its compression.
fn check_plausible(header: &Header, length: u64) -> Result<(), String> {
    let Vec2(width, height) = header.layer_size;
    let pixels = width as u128 * height as u128;
    if pixels == 0 {
        return Err("it has no pixels".into());
    }
    if pixels > u128::from(MAX_PIXELS) {
        return Err(too_large(header));
    }
    // Largest factor by which each method can shrink data: runs of at most 128 bytes in 2, the
    // limit 1032 of deflate; the others may stack two such stages.
    let ratio: u128 = match header.compression {
        Compression::Uncompressed => 1,
        Compression::RLE => 64,
        Compression::ZIP1 | Compression::ZIP16 => 1040,
        _ => 1040 * 128,
    };
    let pixel_bytes = pixels * header.channels.bytes_per_pixel as u128;
    // Every block has 8 bytes in the offset table and 8 in front of its data.
    let least = pixel_bytes / ratio + 16 * header.chunk_count as u128;
    if least > u128::from(length) {
        return Err(format!(
            "it is truncated or damaged: {width} x {height} pixels cannot be in {length} bytes"
        ));
    }
    Ok(())
}

fn too_large(header: &Header) -> String {
    let Vec2(width, height) = header.layer_size;
    format!("its size of {width} x {height} is beyond the limit of {MAX_PIXELS} pixels")
}

/// Hands out all blocks of the largest level; every pixel must come exactly once.
fn read_blocks<R: Read + Seek>(
    reader: Reader<R>,
    header: &Header,
    source: &ColourChannels,
    mut copy: impl FnMut(&UncompressedBlock) -> Result<(), String>,
) -> Result<(), String> {
    let wanted = |level: Vec2<usize>| level == Vec2(0, 0);
    let chunks = reader
        .filter_chunks(false, |_, tile, block| block.layer == source.part && wanted(tile.level_index))
        .map_err(explain)?;
    let mut seen = HashSet::new();
    let mut missing = header.layer_size.area();
    for block in chunks.sequential_decompressor(false) {
        let block = block.map_err(explain)?;
        let position = block.index.pixel_position;
        let fresh = seen.insert((position.x(), position.y()));
        if !fresh || block.index.layer != source.part || !wanted(block.index.level) {
            return Err("it is damaged: a block of pixels is stored where another belongs".into());
        }
        copy(&block)?;
        missing = missing.saturating_sub(block.index.pixel_size.area());
    }
    if missing > 0 { Err("it is incomplete".into()) } else { Ok(()) }
}

/// Where the three colours lie in a row of a block: all samples of a channel, then the next's.
struct RowLayout {
    bytes_per_pixel: usize,
    /// For each channel: bytes per pixel of the channels before it, and its own type.
    channels: Vec<(usize, SampleType)>,
    /// Which of them are red, green and blue.
    colours: [usize; 3],
}

impl RowLayout {
    fn new(header: &Header, source: &ColourChannels) -> Self {
        let list = &header.channels.list;
        let mut bytes_per_pixel = 0;
        let channels = list.iter().map(|channel| {
            let before = bytes_per_pixel;
            bytes_per_pixel += channel.sample_type.bytes_per_sample();
            (before, channel.sample_type)
        });
        Self { channels: channels.collect(), bytes_per_pixel, colours: source.channels }
    }
}

/// Hands out the rows of a block: place of the first pixel in the picture, how many, and their bytes.
fn for_rows(
    block: &UncompressedBlock,
    layout: &RowLayout,
    size: Vec2<usize>,
    mut copy: impl FnMut(usize, usize, &[u8]),
) -> Result<(), String> {
    let (Vec2(x, y), Vec2(width, height)) = (block.index.pixel_position, block.index.pixel_size);
    let row_bytes = width * layout.bytes_per_pixel;
    let inside = x + width <= size.width() && y + height <= size.height();
    if !inside || block.data.len() != row_bytes * height {
        return Err("it is damaged: a block of pixels has the wrong size".into());
    }
    for (row, bytes) in block.data.chunks_exact(row_bytes).enumerate() {
        copy((y + row) * size.width() + x, width, bytes);
    }
    Ok(())
}

fn copy_block(
    block: &UncompressedBlock,
    layout: &RowLayout,
    size: Vec2<usize>,
    into: &mut Target,
) -> Result<(), String> {
    for_rows(block, layout, size, |start, width, bytes| {
        let samples = |channel: usize| {
            let (before, sample_type) = layout.channels[channel];
            (&bytes[before * width..], sample_type)
        };
        let pixels = &mut into.pixels[start..start + width];
        for (component, &channel) in layout.colours.iter().enumerate() {
            let (bytes, sample_type) = samples(channel);
            copy_samples(bytes, sample_type, pixels.iter_mut().map(|pixel| &mut pixel[component]));
        }
        for (channel, other) in &mut into.others {
            let (bytes, sample_type) = samples(*channel);
            match &mut other.samples {
                Samples::Float(values) => {
                    copy_samples(bytes, sample_type, values[start..start + width].iter_mut());
                }
                Samples::Uint(values) => {
                    for (target, &bytes) in
                        values[start..start + width].iter_mut().zip(bytes.as_chunks::<4>().0)
                    {
                        *target = u32::from_ne_bytes(bytes);
                    }
                }
            }
        }
    })
}

/// Converts the first samples of `bytes`, in the machine's byte order, one for each target.
fn copy_samples<'a>(bytes: &[u8], sample_type: SampleType, targets: impl Iterator<Item = &'a mut f32>) {
    match sample_type {
        SampleType::F16 => {
            for (target, &bytes) in targets.zip(bytes.as_chunks::<2>().0) {
                *target = f16::from_ne_bytes(bytes).to_f32();
            }
        }
        SampleType::F32 => {
            for (target, &bytes) in targets.zip(bytes.as_chunks::<4>().0) {
                *target = f32::from_ne_bytes(bytes);
            }
        }
        SampleType::U32 => {
            for (target, &bytes) in targets.zip(bytes.as_chunks::<4>().0) {
                *target = u32::from_ne_bytes(bytes) as f32;
            }
        }
    }
}

fn data_window(header: &Header) -> Result<DataWindow, String> {
    let frame = header.shared_attributes.display_window;
    let corner = header.own_attributes.layer_position;
    let offset = |data: i32, frame: i32| {
        data.checked_sub(frame).ok_or_else(|| "its data window is out of range".to_string())
    };
    Ok(DataWindow {
        x: offset(corner.x(), frame.position.x())?,
        y: offset(corner.y(), frame.position.y())?,
        full_width: to_u32(frame.size.width())?,
        full_height: to_u32(frame.size.height())?,
    })
}

fn metadata(header: &Header) -> Metadata {
    let own = &header.own_attributes;
    let report = Text::new_or_none(REPORT_ATTRIBUTE).and_then(|name| own.other.get(&name));
    let report = report.and_then(|value| match value {
        AttributeValue::Text(text) => Some(text.to_string()),
        _ => None,
    });
    let integer = |name: &str| match Text::new_or_none(name).and_then(|name| own.other.get(&name)) {
        Some(AttributeValue::I32(value)) => u32::try_from(*value).ok(),
        _ => None,
    };
    let float = |name: &str| match Text::new_or_none(name).and_then(|name| own.other.get(&name)) {
        Some(AttributeValue::F32(value)) => Some(*value),
        _ => None,
    };
    Metadata {
        report,
        software: own.software_name.as_ref().map(Text::to_string),
        owner: own.owner.as_ref().map(Text::to_string),
        comments: own.comments.as_ref().map(Text::to_string),
        capture_date: own.capture_date.as_ref().map(Text::to_string),
        samples_per_pixel: integer("samplesPerPixel"),
        render_time_seconds: float("renderTimeSeconds"),
        world_to_camera: own.world_to_camera,
        world_to_ndc: own.world_to_normalized_device,
    }
}

fn to_u32(size: usize) -> Result<u32, String> {
    u32::try_from(size).map_err(|_| "its size is out of range".into())
}

fn explain(error: ExrError) -> String {
    match error {
        ExrError::Invalid(what) if what == "reference to missing bytes" => "it is truncated".into(),
        ExrError::Invalid(what) => format!("it is damaged: {what}"),
        ExrError::NotSupported(what) => format!("not supported: {what}"),
        ExrError::Io(error) => error.to_string(),
        ExrError::Aborted => "reading was given up".into(),
    }
}

#[cfg(test)]
mod tests;
