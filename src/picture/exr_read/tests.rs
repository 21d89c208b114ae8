//! Files as other programs write them, and damaged ones.

use std::io::Cursor;
use std::num::NonZeroU16;

use exr::image::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, Layer, LevelMaps, Levels,
};
use exr::math::RoundingMode;
use exr::meta::attribute::{ChannelDescription, IntegerBounds, LineOrder};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{Blocks, SmallVec, WritableImage};

use super::*;
use crate::atomic_file::TestFolder;
use crate::picture::{self, Channel, Samples, read_layers, write, write_encoded};

fn channel(name: &str, samples: FlatSamples) -> AnyChannel<FlatSamples> {
    AnyChannel::new(name, samples)
}

fn floats(values: &[f32]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

fn layer(
    name: &str,
    size: (usize, usize),
    encoding: Encoding,
    channels: Vec<AnyChannel<FlatSamples>>,
) -> Layer<AnyChannels<FlatSamples>> {
    let channels = AnyChannels::sort(channels.into());
    Layer::new(size, LayerAttributes::named(name), encoding, channels)
}

fn file_of(layers: Vec<Layer<AnyChannels<FlatSamples>>>) -> Vec<u8> {
    let size = layers[0].size;
    let layers: SmallVec<[_; 2]> = layers.into();
    let image = ExrImage::from_layers(ImageAttributes::with_size(size), layers);
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn decode_bytes(bytes: &[u8]) -> Result<Image, String> {
    decode(Cursor::new(bytes), bytes.len() as u64, false)
}

fn rgb(scale: f32, count: usize) -> Vec<AnyChannel<FlatSamples>> {
    let values = |offset: f32| (0..count).map(|i| scale * (i as f32 + offset)).collect();
    vec![
        channel("R", FlatSamples::F32(values(0.0))),
        channel("G", FlatSamples::F32(values(0.25))),
        channel("B", FlatSamples::F32(values(0.5))),
    ]
}

fn expected(scale: f32, count: usize) -> Vec<[f32; 3]> {
    let pixel = |i: usize| [0.0, 0.25, 0.5].map(|offset| scale * (i as f32 + offset));
    (0..count).map(pixel).collect()
}

#[test]
fn what_was_written_is_read_with_window_and_metadata() {
    let folder = TestFolder::new("exr-round-trip");
    let path = folder.file("a.exr");
    // More than one group of blocks, the last one cut off.
    let (width, height) = (7, 16 * 70 + 3);
    let mut image = Image::new(width, height, expected(1.5, (width * height) as usize));
    image.pixels[5] = [f32::NAN, f32::INFINITY, -1e-30];
    image.window = DataWindow { x: 3, y: 20, full_width: 40, full_height: 2000 };
    image.metadata = Metadata {
        report: Some("{\"spp\": 4, \"scene\": \"a\\\"b\"}".into()),
        software: None,
        owner: Some("Zoë".into()),
        comments: Some("no comment".into()),
        capture_date: Some("2026:01:02 03:04:05".into()),
        samples_per_pixel: Some(64),
        render_time_seconds: Some(1.5),
        world_to_camera: Some(std::array::from_fn(|i| i as f32)),
        world_to_ndc: Some(std::array::from_fn(|i| -(i as f32))),
    };
    write(&path, &image, 3.0).unwrap();
    let read = crate::picture::read(&path).unwrap();
    let bits =
        |image: &Image| -> Vec<_> { image.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect() };
    assert_eq!(bits(&read), bits(&image));
    assert_eq!(read.window, image.window);
    assert_eq!(read.metadata.report, image.metadata.report);
    assert_eq!(read.metadata.owner.as_deref(), Some("Zo?"));
    let typed = |image: &Image| {
        let Metadata { comments, capture_date, samples_per_pixel, render_time_seconds, .. } =
            image.metadata.clone();
        let matrices = (image.metadata.world_to_camera, image.metadata.world_to_ndc);
        (comments, capture_date, samples_per_pixel, render_time_seconds, matrices)
    };
    assert_eq!(typed(&read), typed(&image));
    assert!(read.metadata.software.unwrap().starts_with("wavepath "));
    assert_eq!(folder.names(), ["a.exr"]);
}

#[test]
fn further_channels_reach_the_file_and_do_not_disturb_the_colours() {
    let folder = TestFolder::new("exr-channels");
    let path = folder.file("a.exr");
    let mut image = Image::new(2, 2, expected(1.0, 4));
    image.channels = vec![
        Channel { name: "error.R".into(), samples: Samples::Float(vec![0.5, 1.5, 2.5, 3.5]) },
        Channel { name: "samples.N".into(), samples: Samples::Uint(vec![7, 8, 9, u32::MAX]) },
        Channel { name: "A".into(), samples: Samples::Float(vec![1.0; 4]) },
    ];
    write(&path, &image, 0.0).unwrap();
    assert_eq!(crate::picture::read(&path).unwrap().pixels, image.pixels);

    let file = exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
    let samples = |name: &str| {
        let mut channels = file.layer_data.channel_data.list.iter();
        channels.find(|channel| channel.name.eq(name)).unwrap().sample_data.clone()
    };
    assert!(samples("error.R") == floats(&[0.5, 1.5, 2.5, 3.5]));
    assert!(samples("samples.N") == FlatSamples::U32(vec![7, 8, 9, u32::MAX]));
}

#[test]
fn tiles_are_written_whole_and_hold_the_same() {
    let folder = TestFolder::new("exr-tiles");
    // Not a multiple of the tile, and smaller than one.
    for (width, height, side) in [(37, 41, 16), (5, 3, 64)] {
        let mut image = Image::new(width, height, expected(0.125, (width * height) as usize));
        let numbers = (0..width * height).collect();
        image.channels = vec![Channel { name: "samples.N".into(), samples: Samples::Uint(numbers) }];
        image.window = DataWindow { x: 3, y: 2, full_width: 64, full_height: 64 };
        let path = folder.file("tiled.exr");
        let encoding = crate::picture::Encoding { tile: NonZeroU16::new(side), ..Default::default() };
        crate::picture::write_encoded(&path, &image, &encoding).unwrap();
        let header = &exr::meta::MetaData::read_from_file(&path, true).unwrap().headers[0];
        let tile = match header.blocks {
            exr::meta::BlockDescription::Tiles(tiles) => tiles.tile_size,
            exr::meta::BlockDescription::ScanLines => panic!("no tiles"),
        };
        assert_eq!(tile, Vec2(usize::from(side), usize::from(side)));
        let back = crate::picture::read_layers(&path).unwrap();
        assert_eq!((back.pixels, back.channels), (image.pixels, image.channels));
        assert_eq!(back.window, image.window);
    }
}

#[test]
fn every_lossless_compression_and_blocking_is_read() {
    let count = 37 * 41;
    for compression in
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ]
    {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 8))] {
            for line_order in [LineOrder::Increasing, LineOrder::Decreasing] {
                let encoding = Encoding { compression, blocks, line_order };
                let bytes = file_of(vec![layer("", (37, 41), encoding, rgb(0.125, count))]);
                let image = decode_bytes(&bytes).unwrap();
                assert_eq!(image.pixels, expected(0.125, count), "{encoding:?}");
            }
        }
    }
}

#[test]
fn lossy_compressions_are_read() {
    let count = 64 * 64;
    let half = |offset: f32| {
        FlatSamples::F16((0..count).map(|i| f16::from_f32(i as f32 / 4096.0 + offset)).collect())
    };
    for compression in [
        Compression::PXR24,
        Compression::B44,
        Compression::B44A,
        Compression::DWAA(None),
        Compression::DWAB(None),
    ] {
        let channels = vec![channel("R", half(0.0)), channel("G", half(0.25)), channel("B", half(0.5))];
        let encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        let bytes = file_of(vec![layer("", (64, 64), encoding, channels)]);
        let image = decode_bytes(&bytes).unwrap_or_else(|e| panic!("{compression:?}: {e}"));
        let error = image
            .pixels
            .iter()
            .zip(expected(1.0 / 4096.0, count))
            .map(|(read, _)| ((read[1] - read[0] - 0.25).abs()).max((read[2] - read[0] - 0.5).abs()));
        assert!(error.fold(0.0, f32::max) < 0.05, "{compression:?}");
    }
}

#[test]
fn types_layers_and_grey_are_understood() {
    let encoding = Encoding::SMALL_LOSSLESS;
    let half = FlatSamples::F16(vec![f16::from_f32(0.5), f16::from_f32(1.0)]);
    let mixed = vec![
        channel("diffuse.B", FlatSamples::U32(vec![3, 4])),
        channel("diffuse.G", half.clone()),
        channel("diffuse.R", floats(&[0.25, 2.0])),
        channel("Y", floats(&[9.0, 9.0])),
        channel("A", half.clone()),
    ];
    let image = decode_bytes(&file_of(vec![layer("", (2, 1), encoding, mixed.clone())])).unwrap();
    assert_eq!(image.pixels, [[0.25, 0.5, 3.0], [2.0, 1.0, 4.0]]);

    // Plain colours of a later part win over those of a layer.
    let parts = vec![layer("aovs", (2, 1), encoding, mixed), layer("beauty", (2, 1), encoding, rgb(1.0, 2))];
    assert_eq!(decode_bytes(&file_of(parts)).unwrap().pixels, expected(1.0, 2));

    let grey = vec![channel("Y", half)];
    let image = decode_bytes(&file_of(vec![layer("", (2, 1), encoding, grey)])).unwrap();
    assert_eq!(image.pixels, [[0.5; 3], [1.0; 3]]);

    let depth = vec![channel("Z", floats(&[1.0, 2.0]))];
    let error = decode_bytes(&file_of(vec![layer("", (2, 1), encoding, depth)])).unwrap_err();
    assert!(error.contains("no channels R, G and B") && error.contains('Z'), "{error}");
}

#[test]
fn of_a_mip_map_the_largest_level_is_read() {
    let levels = |offset: f32| {
        let level = |size: usize| -> FlatSamples {
            floats(&(0..size * size).map(|i| i as f32 + offset).collect::<Vec<_>>())
        };
        let level_data: LevelMaps<FlatSamples> = vec![level(8), level(4), level(2), level(1)];
        Levels::Mip { rounding_mode: RoundingMode::Down, level_data }
    };
    let names = [("B", 0.5), ("G", 0.25), ("R", 0.0)];
    let list = names.map(|(name, offset)| AnyChannel::new(name, levels(offset)));
    let channels = AnyChannels::sort(list.into_iter().collect());
    let encoding = Encoding { blocks: Blocks::Tiles(Vec2(4, 4)), ..Encoding::SMALL_LOSSLESS };
    let layer = Layer::new((8, 8), LayerAttributes::named(""), encoding, channels);
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
    let image = decode_bytes(bytes.get_ref()).unwrap();
    assert_eq!(image.pixels, expected(1.0, 64));
}

#[test]
fn data_window_is_relative_to_the_display_window() {
    let mut part = layer("", (2, 1), Encoding::SMALL_LOSSLESS, rgb(1.0, 2));
    part.attributes.layer_position = Vec2(-3, 12);
    let frame = IntegerBounds::new((-5, 10), (20, 30));
    let parts: SmallVec<[_; 2]> = vec![part].into();
    let image = ExrImage::from_layers(ImageAttributes::new(frame), parts);
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    let window = decode_bytes(bytes.get_ref()).unwrap().window;
    assert_eq!(window, DataWindow { x: 2, y: 2, full_width: 20, full_height: 30 });
}

/// A scan line header of the given compression and size, without any pixels behind it.
fn promise(compression: Compression, size: (usize, usize)) -> Header {
    let channels = ["B", "G", "R"].map(|name| ChannelDescription::named(name, SampleType::F32));
    Header::new("".into(), size, channels.into_iter().collect()).with_encoding(
        compression,
        exr::meta::BlockDescription::ScanLines,
        LineOrder::Increasing,
    )
}

#[test]
fn headers_are_not_taken_at_their_word() {
    let giant = promise(Compression::ZIP16, (1 << 20, 1 << 20));
    assert!(check_plausible(&giant, u64::MAX).unwrap_err().contains("beyond the limit"));
    let large = promise(Compression::ZIP16, (1 << 14, 1 << 14));
    assert!(check_plausible(&large, 100_000).unwrap_err().contains("truncated"));
    check_plausible(&large, 10_000_000).unwrap();
}

#[test]
fn a_black_picture_compresses_well_and_is_plausible() {
    for compression in [Compression::RLE, Compression::ZIP16, Compression::PIZ] {
        let black = || floats(&vec![0.0; 512 * 512]);
        let channels = vec![channel("R", black()), channel("G", black()), channel("B", black())];
        let blocks = Blocks::Tiles(Vec2(512, 512));
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let bytes = file_of(vec![layer("", (512, 512), encoding, channels)]);
        decode_bytes(&bytes).unwrap();
    }
}

#[test]
fn cut_off_files_are_errors() {
    let bytes = file_of(vec![layer("", (37, 41), Encoding::SMALL_LOSSLESS, rgb(1.0, 37 * 41))]);
    for length in (0..bytes.len()).step_by(7) {
        let result = contain_panics(|| decode_bytes(&bytes[..length]));
        assert!(result.is_none_or(|image| image.is_err()), "{length} of {} bytes", bytes.len());
    }
}

#[test]
fn damaged_files_never_abort() {
    let encodings = [
        Encoding::SMALL_LOSSLESS,
        Encoding { blocks: Blocks::Tiles(Vec2(8, 8)), ..Encoding::FAST_LOSSLESS },
        Encoding { compression: Compression::PIZ, ..Encoding::SMALL_LOSSLESS },
    ];
    // xorshift64, fixed seed
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    for encoding in encodings {
        let bytes = file_of(vec![layer("", (19, 23), encoding, rgb(1.0, 19 * 23))]);
        for _ in 0..2000 {
            let mut damaged = bytes.clone();
            for _ in 0..=random(3) {
                // Mostly in the header, where one byte does the most harm.
                let end = if random(4) > 0 { 400.min(bytes.len()) } else { bytes.len() };
                damaged[random(end)] = random(256) as u8;
            }
            let _ = contain_panics(|| decode_bytes(&damaged));
        }
    }
}

#[test]
fn half_keeps_what_is_finite_and_every_compression_keeps_the_rest() {
    let folder = TestFolder::new("exr-half");
    let path = folder.file("a.exr");
    let mut image = Image::new(40, 33, (0..40 * 33).map(|i| [i as f32, 0.1, 1e6]).collect());
    image.pixels[0] = [f32::INFINITY, -1e9, f32::NAN];
    image.channels.push(Channel { name: "stderr.R".into(), samples: Samples::Float(vec![0.5; 40 * 33]) });
    image.channels.push(Channel { name: "samples".into(), samples: Samples::Uint(vec![70_000; 40 * 33]) });
    use picture::Compression;
    for compression in
        [Compression::None, Compression::Rle, Compression::Zips, Compression::Zip, Compression::Piz]
    {
        let encoding = picture::Encoding { half: true, compression, ..Default::default() };
        write_encoded(&path, &image, &encoding).unwrap();
        let read = read_layers(&path).unwrap();
        assert_eq!(read.pixels[7], [7.0, 0.099_975_586, 65_504.0], "{compression:?}");
        assert_eq!(read.pixels[0][..2], [f32::INFINITY, -65_504.0]);
        assert!(read.pixels[0][2].is_nan());
        // In the order of the file.
        assert_eq!(read.channels[0].samples, Samples::Uint(vec![70_000; 40 * 33]));
        assert_eq!((read.channels[1].name.as_str(), read.channels.len()), ("stderr.R", 2));
        write_encoded(&path, &image, &picture::Encoding { compression, ..Default::default() }).unwrap();
        assert_eq!(read_layers(&path).unwrap().pixels[7], image.pixels[7]);
    }
}
