//! The film by itself: sums, parts, bytes, faults.

use super::*;
use crate::SamplerKind;
use wavepath_kernels::channels::NOTHING;

/// An empty film of a whole image.
pub(crate) fn film(width: u32, height: u32) -> Film {
    Film::new(header(width, height)).unwrap()
}

/// A work unit.
pub(crate) fn unit(block: usize, replicate: u32, samples: Range<u32>) -> Unit {
    Unit { block, replicate, first: samples.start, samples: samples.end - samples.start }
}

fn header(width: u32, height: u32) -> Header {
    Header {
        frame: Frame { image_width: width, image_height: height, bounds: [0, width, 0, height] },
        channels: vec![Channel::Radiance.row()],
        filter_weights: false,
        parts: 8,
        seed: 1,
        more_seeds: Vec::new(),
        sampler: SamplerKind::Sobol,
        estimator: "path".into(),
        arithmetic: "f32".into(),
    }
}

/// Light that splats bring.
static SPLATS: Row = Row {
    name: "splats",
    components: &["R", "G", "B"],
    kind: Kind::Sum { signed: true },
    divisor: Divisor::LightPaths,
    replicated: true,
    holds: "light",
};

/// Names of things.
static NAMES: Row = Row {
    name: "names",
    components: &["id"],
    kind: Kind::Keyed,
    divisor: Divisor::FilterWeight,
    replicated: false,
    holds: "names",
};

/// A channel that is divided by the number of samples.
static COUNTED: Row = Row {
    name: "counted",
    components: &["X", "Y"],
    kind: Kind::Sum { signed: true },
    divisor: Divisor::Samples,
    replicated: true,
    holds: "numbers",
};

/// Everything that a film can have.
fn full() -> Header {
    let channels = vec![Channel::Radiance.row(), Channel::Depth.row(), &SPLATS, &NAMES, &COUNTED];
    Header { channels, filter_weights: true, ..header(40, 30) }
}

/// Random bits of a sample, as the samplers make them: of its place alone.
fn random(block: usize, pixel: usize, replicate: u32, sample: u32, dimension: u32) -> u32 {
    let mut x = [block as u32, pixel as u32, replicate, sample, dimension]
        .iter()
        .fold(7u64, |x, &k| (x ^ u64::from(k)).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(23));
    x ^= x >> 31;
    (x.wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 32) as u32
}

/// A number of any sign and of a size between 2^-40 and 2^40.
fn number(bits: u32) -> f32 {
    f32::from_bits(bits & 0x8000_0000 | (87 + bits % 80) << 23 | bits >> 9 & 0x007F_FFFF)
}

/// Renders some samples into a film of [`full`]'s channels.
fn render(film: &Film, replicate: u32, samples: Range<u32>) {
    let mut sums = film.sums();
    for (block, pixels) in film.blocks().iter().enumerate() {
        sums.clear();
        let mut splats = Vec::new();
        for pixel in 0..pixels.pixels() {
            for sample in samples.clone() {
                let bits = |dimension| random(block, pixel, replicate, sample, dimension);
                let weight = Some(if bits(0) % 5 == 0 { -1.0 } else { 1.0 });
                let radiance = [1, 2, 3].map(|d| if bits(d) % 3 == 0 { 0.0 } else { number(bits(d)).abs() });
                sums.add(pixel, radiance, weight);
                sums.bounces += u64::from(bits(4) % 3);
                let depth = if bits(5) % 4 == 0 { NOTHING } else { number(bits(5)) };
                sums.add_to_channel(0, pixel, [depth, 0.0, 0.0, 0.0], weight);
                sums.add_to_channel(2, pixel, [f32::from_bits(bits(6) % 7), 0.0, 0.0, 0.0], weight);
                sums.add_to_channel(3, pixel, [number(bits(7)), number(bits(8)), 0.0, 0.0], weight);
                if bits(9) % 3 == 0 {
                    let pixel = [bits(10) % 50, bits(11) % 40];
                    let values = [12, 13, 14, 15].map(|d| number(bits(d)));
                    splats.push(Splat { pixel, channel: 2, values });
                }
            }
        }
        let light_paths = splats.len() as u64;
        let unit = unit(block, replicate, samples.clone());
        film.commit(&Commit { unit, sums: &sums, light_paths, splats: &splats }).unwrap();
    }
}

/// All that a film says.
fn said(film: &Film) -> impl PartialEq + std::fmt::Debug {
    let Developed { pixels, samples, invalid, relmse, relmse_interval } = film.develop();
    let channels: Vec<_> =
        (0..film.header().channels.len()).map(|k| (film.develop_channel(k), film.develop_keys(k))).collect();
    (pixels, samples, invalid, relmse, relmse_interval, channels, film.halves())
}

/// A render in parts, each with films of its own that are added in any order, is that in one piece, to the bit: whether or
/// not replicates are kept apart, with negative weights, splats, names, crops.
#[test]
fn parts_in_any_order_make_the_whole() {
    for (parts, bounds) in [(8, [0, 40, 0, 30]), (2, [3, 37, 17, 18]), (1, [0, 40, 0, 30])] {
        let frame = Frame { bounds, ..full().frame };
        let header = Header { parts, frame, ..full() };
        let new = || Film::new(header.clone()).unwrap();
        let whole = new();
        for replicate in 0..5 {
            render(&whole, replicate, 0..7);
        }
        for cut in [1u32, 2, 3, 7] {
            let films: Vec<Film> = (0..cut)
                .map(|k| {
                    let film = new();
                    for replicate in (0..5).rev() {
                        let at = |k: u32| k * 7 / cut;
                        render(&film, replicate, at(k)..at(k + 1));
                    }
                    film
                })
                .collect();
            for turn in 0..cut as usize {
                let sum = new();
                for k in 0..cut as usize {
                    sum.merge(&films[(k * 5 + turn) % cut as usize]).unwrap();
                }
                assert_eq!(sum.to_bytes(), whole.to_bytes(), "{cut} parts");
                assert_eq!(said(&sum), said(&whole));
                // Nothing twice.
                let bytes = sum.to_bytes();
                assert!(matches!(sum.merge(&films[0]), Err(FilmError::Overlap { .. })));
                assert!(matches!(films[0].merge(&sum), Err(FilmError::Overlap { .. })));
                assert!(matches!(sum.merge(&sum), Err(FilmError::Overlap { .. })));
                assert_eq!(sum.to_bytes(), bytes);
            }
        }
    }
}

/// Replicates that are together in a part have the same mean.
#[test]
fn the_mean_does_not_depend_on_the_number_of_parts() {
    let of = |parts| {
        let film = Film::new(Header { parts, ..full() }).unwrap();
        (0..8).for_each(|replicate| render(&film, replicate, 0..3));
        (film.develop().pixels, film.develop_channel(4), film.develop_channel(2))
    };
    let expected = of(8);
    for parts in [1, 2, 4] {
        assert_eq!(of(parts), expected);
    }
}

#[test]
fn channels_are_divided_by_their_divisors() {
    let film = Film::new(full()).unwrap();
    let mut sums = film.sums();
    let (a, b) = (f32::from_bits(11), f32::from_bits(12));
    for (weight, radiance, depth, name) in
        [(1.0, 4.0, 8.0, a), (1.0, 2.0, NOTHING, a), (-1.0, 1.0, 2.0, b), (1.0, 1.0, 3.0, a)]
    {
        sums.add(0, [radiance; 3], Some(weight));
        sums.add_to_channel(0, 0, [depth, 0.0, 0.0, 0.0], Some(weight));
        sums.add_to_channel(2, 0, [name, 0.0, 0.0, 0.0], Some(weight));
        sums.add_to_channel(3, 0, [-radiance, 6.0, 0.0, 0.0], Some(weight));
    }
    let splats = [([0, 0], 3.0), ([0, 0], -1.0), ([39, 29], 5.0), ([40, 0], 7.0)]
        .map(|(pixel, value)| Splat { pixel, channel: 2, values: [value; 4] });
    film.commit(&Commit { unit: unit(0, 0, 0..4), sums: &sums, light_paths: 8, splats: &splats }).unwrap();
    // Weights 1, 1, -1 and 1.
    assert_eq!(film.develop().pixels[0], [(4.0 + 2.0 - 1.0 + 1.0) / 2.0; 3]);
    // Three of the samples have a depth: weights 1, -1 and 1.
    assert_eq!(film.develop_channel(1), [film.develop_channel(1)[0].clone()]);
    assert_eq!(film.develop_channel(1)[0][0], 8.0 - 2.0 + 3.0);
    assert_eq!(film.develop_channel(1)[0][1], 0.0);
    let splatted = film.develop_channel(2);
    assert_eq!((splatted[0][0], splatted[2][1199], splatted[1][40]), (0.25, 0.625, 0.0));
    assert_eq!(film.develop_keys(3)[0], [(11, 1.5), (12, -0.5)]);
    let counted = film.develop_channel(4);
    assert_eq!((counted[0][0], counted[1][0]), (-6.0 / 4.0, 12.0 / 4.0));
    assert!(film.develop_channel(3).is_empty() && film.develop_channel(9).is_empty());
    assert!(film.develop_keys(0).is_empty());
}

/// From emission that single precision can hardly hold to far beyond any scale: no sample is dropped, none is rounded away.
#[test]
fn samples_of_any_size_count() {
    for scale in [1e-36f32, 1e-30, 1e-12, 1.0, 1.5e11, 1e22, 1e30, 1e36] {
        let film = film(16, 16);
        let mut sums = film.sums();
        for pixel in 0..256 {
            for k in 0..16 {
                sums.add(
                    pixel,
                    [scale * (k + 1) as f32, scale / (k + 1) as f32, if k == 3 { scale } else { 0.0 }],
                    None,
                );
            }
        }
        film.add(unit(0, 0, 0..16), &sums).unwrap();
        let developed = film.develop();
        assert_eq!(developed.invalid, 0);
        let scale = f64::from(scale);
        let expected =
            [8.5 * scale, scale * (1..=16).map(|k| 1.0 / f64::from(k)).sum::<f64>() / 16.0, scale / 16.0];
        for (found, expected) in developed.pixels[77].iter().zip(expected) {
            assert!((f64::from(*found) / expected - 1.0).abs() < 2e-7, "{found}, not {expected}");
        }
    }
}

#[test]
fn invalid_samples_are_black_and_counted() {
    let film = film(4, 4);
    let mut sums = film.sums();
    for pixel in 0..16 {
        sums.add(pixel, [1.0, 2.0, 0.5], None);
    }
    for wrong in [f32::NAN, f32::INFINITY, -1.0, -1e-38] {
        sums.add(0, [1.0, wrong, 1.0], None);
    }
    sums.add(0, [-0.0; 3], None);
    // A pixel that is not there.
    sums.add(256, [1.0; 3], Some(1.0));
    film.add(unit(0, 0, 0..1), &sums).unwrap();
    film.add(unit(0, 1, 0..1), &sums).unwrap();
    let picture = film.develop();
    assert_eq!((picture.invalid, picture.samples), (8, 32));
    assert_eq!(picture.pixels[15], [1.0, 2.0, 0.5]);
    assert_eq!(picture.pixels[0], [1.0, 2.0, 0.5]);
    assert_eq!(picture.relmse, Some(0.0));
}

/// Blocks are those of the image, whatever the crop.
#[test]
fn blocks_are_aligned_to_the_image() {
    let frame = Frame { image_width: 100, image_height: 80, bounds: [20, 53, 16, 50] };
    let film = Film::new(Header { frame, ..header(100, 80) }).unwrap();
    let corners: Vec<_> = film.blocks().iter().map(|block| (block.x, block.y)).collect();
    let columns = [16, 32, 48];
    assert_eq!(corners, [16, 32, 48].iter().flat_map(|&y| columns.map(|x| (x, y))).collect::<Vec<_>>());
    assert_eq!(film.blocks().iter().map(|block| block.pixels() as u64).sum::<u64>(), film.pixels());
    for (number, block) in film.blocks().iter().enumerate() {
        for pixel in 0..block.pixels() {
            let at = [block.x + block.columns()[pixel], block.y + block.rows()[pixel]];
            assert!((20..53).contains(&at[0]) && (16..50).contains(&at[1]));
            assert_eq!(film.find(at), Some((number, pixel)));
        }
    }
    assert_eq!(film.find([19, 20]), None);
    assert_eq!(film.block_columns(), 3);
}

#[test]
fn what_cannot_be_is_an_error() {
    let frame = |bounds| Frame { image_width: 40, image_height: 30, bounds };
    for header in [
        Header { frame: frame([5, 5, 0, 30]), ..header(40, 30) },
        Header { frame: frame([7, 5, 0, 30]), ..header(40, 30) },
        Header { frame: frame([0, 41, 0, 30]), ..header(40, 30) },
        Header { frame: frame([0, 40, 30, 31]), ..header(40, 30) },
        Header { frame: frame([0, 40, u32::MAX, 0]), ..header(40, 30) },
        header(u32::MAX, u32::MAX),
        Header { parts: 0, ..header(40, 30) },
        Header { parts: 3, ..header(40, 30) },
        Header { parts: 16, ..header(40, 30) },
        Header { channels: vec![], ..header(40, 30) },
        Header { channels: vec![Channel::Depth.row()], ..header(40, 30) },
        Header { channels: vec![Channel::Radiance.row(); 2], ..header(40, 30) },
        Header { estimator: "x".repeat(1 << 17), ..header(40, 30) },
    ] {
        let error = Film::new(header).unwrap_err();
        assert!(
            matches!(error, FilmError::Header { .. }) && error.to_string().contains("expected"),
            "{error}"
        );
    }

    let film = film(40, 30);
    let sums = film.sums();
    let other = Film::new(full()).unwrap();
    for (unit, sums) in [
        (unit(6, 0, 0..1), &sums),
        (unit(0, 8, 0..1), &sums),
        (unit(0, 0, 3..3), &sums),
        (Unit { block: 0, replicate: 0, first: u32::MAX, samples: 2 }, &sums),
        (unit(0, 0, 0..1), &other.sums()),
    ] {
        assert!(matches!(film.add(unit, sums), Err(FilmError::Unit { .. })), "{unit:?}");
    }
    let add = |range| film.add(unit(1, 2, range), &sums);
    add(5..10).unwrap();
    for range in [9..12, 0..6, 7..8, 5..10, 0..20] {
        assert_eq!(add(range), Err(FilmError::Overlap { pixel: [16, 0], replicate: 2 }));
    }
    add(10..u32::MAX / 2).unwrap();
    assert_eq!(add(u32::MAX / 2..u32::MAX / 2 + 40), Err(FilmError::TooMany));
    assert_eq!(film.held(1, 2), [5..u32::MAX / 2]);
    assert_eq!(film.missing(1, 2, 0..7), [0..5]);
    assert_eq!(film.missing(1, 3, 0..7), [0..7]);
    assert!(
        film.missing(99, 3, 0..7).is_empty() && film.held(99, 0).is_empty() && film.held(0, 99).is_empty()
    );
    assert!(!film.is_empty() && other.is_empty());

    for (header, what) in [
        (Header { seed: 2, ..header(40, 30) }, "seed"),
        (Header { sampler: SamplerKind::Independent, ..header(40, 30) }, "sampler"),
        (Header { estimator: "other".into(), ..header(40, 30) }, "estimator"),
        (Header { arithmetic: "other".into(), ..header(40, 30) }, "arithmetic"),
        (header(30, 40), "image"),
        (Header { frame: frame([0, 39, 0, 30]), ..header(40, 30) }, "crop"),
        (Header { parts: 4, ..header(40, 30) }, "parts"),
        (Header { filter_weights: true, ..header(40, 30) }, "filter weights"),
        (Header { channels: full().channels, ..header(40, 30) }, "channels"),
    ] {
        let error = film.merge(&Film::new(header).unwrap()).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
}

/// A header that a file can have.
fn storable() -> Header {
    Header { channels: vec![Channel::Radiance.row(), Channel::Depth.row()], ..full() }
}

fn stored(parts: u32) -> Film {
    let film = Film::new(Header { parts, ..storable() }).unwrap();
    let mut sums = film.sums();
    for block in [0, 1, 5] {
        for (replicate, samples) in [(0, 0..3), (0, 7..150), (1, 2..3), (5, 0..1)] {
            sums.clear();
            for pixel in 0..film.blocks()[block].pixels() {
                let bits = |dimension| random(block, pixel, replicate, 0, dimension);
                let weight = Some(if bits(0) % 5 == 0 { -1.0 } else { 1.0 });
                sums.add(pixel, [1, 2, 3].map(|d| number(bits(d)).abs()), weight);
                sums.add_to_channel(0, pixel, [number(bits(5)), 0.0, 0.0, 0.0], weight);
            }
            sums.bounces = 3;
            film.add(unit(block, replicate, samples), &sums).unwrap();
        }
    }
    film
}

#[test]
fn bytes_are_the_film() {
    for parts in [1, 2, 8] {
        let film = stored(parts);
        if parts == 2 {
            film.split();
        }
        let bytes = film.to_bytes();
        let back = Film::from_bytes(&bytes).unwrap();
        assert_eq!(back.header(), film.header());
        assert_eq!(back.to_bytes(), bytes);
        assert_eq!(said(&back), said(&film));
        // And it can be gone on with.
        let add = |film: &Film| film.add(unit(0, 0, 3..7), &film.sums());
        add(&back).unwrap();
        assert!(add(&back).is_err());
        add(&film).unwrap();
        assert_eq!(back.to_bytes(), film.to_bytes());
    }
    let empty = Film::new(storable()).unwrap();
    assert_eq!(Film::from_bytes(&empty.to_bytes()).unwrap().to_bytes(), empty.to_bytes());
}

/// Bytes that are cut off or changed are no film or another one, and never a panic, a hang or a lot of memory.
#[test]
fn wrong_bytes_are_no_film() {
    let bytes = stored(2).to_bytes();
    for length in (0..300).chain((300..bytes.len()).step_by(97)) {
        assert!(matches!(Film::from_bytes(&bytes[..length]), Err(FilmError::Bytes { .. })), "{length} bytes");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(Film::from_bytes(&longer).is_err());
    for at in (0..400).chain((400..bytes.len()).step_by(61)) {
        for wrong in [0, 0x7F, 0xFF] {
            let mut changed = bytes.clone();
            changed[at] = wrong;
            if let Ok(film) = Film::from_bytes(&changed) {
                film.develop();
                film.develop_channel(1);
                assert_eq!(film.to_bytes().len(), changed.len());
            }
        }
    }
    let mut version = bytes.clone();
    version[16] = 9;
    assert!(Film::from_bytes(&version).unwrap_err().to_string().contains("version 9"));
    // An image of 2^32 pixels in a few bytes.
    let mut large = bytes;
    for (at, size) in [(20, 1u32 << 16), (24, 1 << 16), (28, 0), (32, 1 << 16), (36, 0), (40, 1 << 16)] {
        large[at..at + 4].copy_from_slice(&size.to_le_bytes());
    }
    assert!(Film::from_bytes(&large).unwrap_err().to_string().contains("not enough bytes"));
}

/// What the film of a render takes: known before, and no more than what is there.
#[test]
fn memory_is_as_stated() {
    let requirements = Requirements::default();
    let frame = |side| Frame { image_width: side, image_height: side, bounds: [0, side, 0, side] };
    let bytes = |side, spp| Film::bytes_for_render(frame(side), requirements, spp);
    // 48 bytes a pixel and part: 15 a component, and the number of its lowest digit.
    assert_eq!(bytes(100, Some(1)), 48 * 10_000);
    assert_eq!(bytes(100, Some(16)), 2 * 48 * 10_000);
    assert_eq!(bytes(100, Some(1024)), 8 * 48 * 10_000);
    assert_eq!(bytes(100, Some(4096)), 8 * 57 * 10_000);
    assert_eq!(Film::replicates_for_render(frame(100), requirements, Some(20)), 4);
    // Above 4 GiB, two parts.
    assert_eq!(Film::replicates_for_render(frame(16384), requirements, None), 2);
    assert_eq!(bytes(16384, Some(64)), (2 * 48) << 28);
}
