//! Parsers for the values of options, with messages that say what is expected.

use std::num::{IntErrorKind, NonZeroU16};
use std::ops::RangeInclusive;
use std::time::Duration;

use super::args::{Aov, Crop, Resolution};
use crate::engine::wavefront::BATCHES;
use crate::picture::MAX_PIXELS;
use crate::time_span;
use wavepath_kernels::channels::{Channel, ChannelSet};
use wavepath_kernels::isa::Level;

/// A span of time: `30s`, `1m30s`, `2h`, `500ms`; a plain number counts seconds.
pub fn duration(text: &str) -> Result<Duration, String> {
    time_span::parse(text)
}

/// An instruction set of this machine, by its name.
pub fn level(text: &str) -> Result<Level, String> {
    let names: Vec<&str> = Level::available().map(Level::name).collect();
    Level::available().find(|level| level.name() == text).ok_or_else(|| {
        format!("found \"{text}\"; expected a set that this machine has: {}", names.join(", "))
    })
}

/// A channel beside radiance by its name, or all of them.
pub fn aov(text: &str) -> Result<Aov, String> {
    let known = || {
        Channel::ALL.iter().filter(|channel| **channel != Channel::Radiance).map(|channel| channel.row().name)
    };
    let text = text.trim();
    if text == "all" {
        return Ok(Aov(ChannelSet::all()));
    }
    match Channel::named(text) {
        Some(channel) if channel != Channel::Radiance => Ok(Aov(ChannelSet::default().with(channel))),
        _ => Err(format!("expected all, or a list of: {}", known().collect::<Vec<_>>().join(", "))),
    }
}

/// A size in pixels: `640x480`.
pub fn resolution(text: &str) -> Result<Resolution, String> {
    let expected = "expected WIDTHxHEIGHT in pixels, such as 640x480";
    let (width, height) = text.split_once(['x', 'X']).ok_or(expected)?;
    let side = |digits: &str| match whole(digits, 1..=65_536) {
        Err(Whole::NotANumber) => Err(expected.to_string()),
        Err(Whole::OutOfRange) => Err("each side must be from 1 to 65536 pixels".into()),
        Ok(side) => Ok(side as u32),
    };
    let (width, height) = (side(width)?, side(height)?);
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!("the image must have at most {MAX_PIXELS} pixels"));
    }
    Ok(Resolution { width, height })
}

/// A part of the image, X0,X1,Y0,Y1: fractions if all of them are at most 1, else pixels.
pub fn crop(text: &str) -> Result<Crop, String> {
    let expected = "expected X0,X1,Y0,Y1, such as 0.25,0.75,0,1 of the image or 100,200,50,80 in pixels";
    let values = four::<f64>(text).ok_or(expected)?;
    if values.iter().all(|value| *value <= 1.0) { fractions(text) } else { pixels(text) }
}

/// A part of the image in fractions, as pbrt's `--cropwindow`.
pub fn fractions(text: &str) -> Result<Crop, String> {
    let expected = || format!("found \"{text}\"; expected X0,X1,Y0,Y1 from 0 to 1, such as 0.25,0.75,0,1");
    let values = four::<f64>(text).ok_or_else(expected)?;
    if !values.iter().all(|value| (0.0..=1.0).contains(value)) {
        return Err(expected());
    }
    let [x0, x1, y0, y1] = values;
    if x0 < x1 && y0 < y1 { Ok(Crop::Fractions(values)) } else { Err(empty(text)) }
}

/// A part of the image in pixels, as pbrt's `--pixelbounds`.
pub fn pixels(text: &str) -> Result<Crop, String> {
    let values = four::<u32>(text).ok_or_else(|| {
        format!("found \"{text}\"; expected X0,X1,Y0,Y1 in whole pixels, such as 100,200,50,80")
    })?;
    let [x0, x1, y0, y1] = values;
    if x0 < x1 && y0 < y1 { Ok(Crop::Pixels(values)) } else { Err(empty(text)) }
}

fn empty(text: &str) -> String {
    format!("found \"{text}\", which is empty; expected X0 below X1 and Y0 below Y1")
}

fn four<T: std::str::FromStr>(text: &str) -> Option<[T; 4]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// Bits of a channel.
pub fn bits(text: &str) -> Result<u8, String> {
    match text {
        "8" => Ok(8),
        "16" => Ok(16),
        _ => Err("expected 8 or 16".into()),
    }
}

/// Pixels on a side of a tile: below 16 a picture is mostly table.
pub fn tile(text: &str) -> Result<NonZeroU16, String> {
    match text.parse() {
        Ok(side @ 16..=8192) => Ok(NonZeroU16::new(side).expect("at least 16")),
        _ => Err("expected a whole number from 16 to 8192, such as 64".into()),
    }
}

/// An axis that points up.
pub fn axis(text: &str) -> Result<[f64; 3], String> {
    let (sign, name) = match text.strip_prefix('-') {
        Some(name) => (-1.0, name),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    let index = ["x", "y", "z"].iter().position(|axis| axis.eq_ignore_ascii_case(name));
    let index = index.ok_or("expected x, y, z, -x, -y or -z")?;
    let mut axis = [0.0; 3];
    axis[index] = sign;
    Ok(axis)
}

/// A factor of two to a power: exposure in stops.
pub fn stops(text: &str) -> Result<f32, String> {
    let stops: f32 = text.trim().parse().map_err(|_| "expected a number of stops, such as -1.5")?;
    let range = -100.0..=100.0;
    if range.contains(&stops) { Ok(stops) } else { Err("must be from -100 to 100 stops".into()) }
}

/// Samples per pixel.
pub fn spp(text: &str) -> Result<u32, String> {
    count(text, 1..=1 << 31).map(|spp| spp as u32)
}

/// A relMSE to reach.
pub fn error(text: &str) -> Result<f64, String> {
    let expected = || format!("found \"{text}\"; expected a relMSE that is more than zero, such as 0.005");
    let error: f64 = text.trim().parse().map_err(|_| expected())?;
    if error.is_finite() && error > 0.0 { Ok(error) } else { Err(expected()) }
}

/// A viewer: `HOST:PORT`.
pub fn host_and_port(text: &str) -> Result<String, String> {
    let expected = || format!("found \"{text}\"; expected HOST:PORT, such as localhost:14158");
    let (host, port) = text.rsplit_once(':').ok_or_else(expected)?;
    match whole(port, 1..=65_535) {
        Ok(_) if !host.is_empty() && !port.is_empty() => Ok(text.into()),
        _ => Err(expected()),
    }
}

/// Runs with a seed each.
pub fn seeds(text: &str) -> Result<usize, String> {
    count(text, 1..=1000).map(|seeds| seeds as usize)
}

/// Worker threads.
pub fn threads(text: &str) -> Result<usize, String> {
    count(text, 1..=4096).map(|threads| threads as usize)
}

/// Bytes: `8G`, `512M`, or a plain number of them.
pub fn memory(text: &str) -> Result<u64, String> {
    let expected = || format!("found \"{text}\"; expected a size such as 8G or 512M");
    let digits = text.trim_end_matches(|c: char| !c.is_ascii_digit());
    let shift =
        match text[digits.len()..].trim().to_ascii_lowercase().trim_end_matches("ib").trim_end_matches('b') {
            "" => 0,
            "k" => 10,
            "m" => 20,
            "g" => 30,
            "t" => 40,
            _ => return Err(expected()),
        };
    let number: f64 = digits.parse().map_err(|_| expected())?;
    let bytes = number * f64::from(shift).exp2();
    if bytes >= 1.0 && bytes < 2f64.powi(63) { Ok(bytes as u64) } else { Err(expected()) }
}

/// Rounds of a benchmark.
pub fn rounds(text: &str) -> Result<usize, String> {
    count(text, 1..=1000).map(|rounds| rounds as usize)
}

/// Paths in the pool of a worker.
pub fn batch(text: &str) -> Result<usize, String> {
    count(text, *BATCHES.start() as u64..=*BATCHES.end() as u64).map(|batch| batch as usize)
}

/// A seed: any 64-bit number.
pub fn seed(text: &str) -> Result<u64, String> {
    count(text, 0..=u64::MAX)
}

fn count(text: &str, range: RangeInclusive<u64>) -> Result<u64, String> {
    let (least, most) = (*range.start(), *range.end());
    whole(text, range).map_err(|_| format!("expected a whole number from {least} to {most}"))
}

enum Whole {
    NotANumber,
    OutOfRange,
}

/// A decimal number without sign.
fn whole(text: &str, range: RangeInclusive<u64>) -> Result<u64, Whole> {
    if !text.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err(Whole::NotANumber);
    }
    match text.parse() {
        Ok(number) if range.contains(&number) => Ok(number),
        Ok(_) => Err(Whole::OutOfRange),
        Err(error) if *error.kind() == IntErrorKind::PosOverflow => Err(Whole::OutOfRange),
        Err(_) => Err(Whole::NotANumber),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resolutions() {
        assert_eq!(resolution("640x480"), Ok(Resolution { width: 640, height: 480 }));
        assert_eq!(resolution("1X65536"), Ok(Resolution { width: 1, height: 65_536 }));
        for (wrong, message) in [
            ("640", "WIDTHxHEIGHT"),
            ("x480", "WIDTHxHEIGHT"),
            ("-1x480", "WIDTHxHEIGHT"),
            ("640x480x3", "WIDTHxHEIGHT"),
            ("6.5x4", "WIDTHxHEIGHT"),
            ("0x480", "1 to 65536"),
            ("65537x1", "1 to 65536"),
            ("99999999999999999999999x1", "1 to 65536"),
            ("65536x65536", "at most 268435456"),
        ] {
            let error = resolution(wrong).unwrap_err();
            assert!(error.contains(message), "{wrong}: {error}");
        }
    }

    #[test]
    fn crops() {
        assert_eq!(crop("0.25,0.75,0,1"), Ok(Crop::Fractions([0.25, 0.75, 0.0, 1.0])));
        assert_eq!(crop("0, 1, 0, 1"), Ok(Crop::Fractions([0.0, 1.0, 0.0, 1.0])));
        assert_eq!(crop("100,200,50,80"), Ok(Crop::Pixels([100, 200, 50, 80])));
        assert_eq!(pixels("0,1,0,1"), Ok(Crop::Pixels([0, 1, 0, 1])));
        for (wrong, message) in [
            ("1,2,3", "X0,X1,Y0,Y1"),
            ("a,b,c,d", "X0,X1,Y0,Y1"),
            ("0.5,0.5,0,1", "is empty"),
            ("-1,1,0,1", "from 0 to 1"),
            ("nan,1,0,1", "X0,X1"),
            ("0.5,200,0,100", "whole pixels"),
            ("200,100,0,100", "is empty"),
        ] {
            let error = crop(wrong).unwrap_err();
            assert!(error.contains(message), "{wrong}: {error}");
        }
        assert!(fractions("0,2,0,1").is_err() && pixels("0.5,1,0,1").is_err());
        // As pbrt rounds.
        let bounds = Crop::Fractions([0.25, 0.75, 0.0, 0.5]).bounds([10, 5]);
        assert_eq!(bounds, Ok([3, 8, 0, 3]));
        let error = Crop::Pixels([0, 11, 0, 5]).bounds([10, 5]).unwrap_err();
        assert!(error.contains("10 x 5"), "{error}");
        assert!(Crop::Fractions([0.01, 0.02, 0.0, 1.0]).bounds([10, 5]).is_err());
    }

    #[test]
    fn axes() {
        assert_eq!(axis("z"), Ok([0.0, 0.0, 1.0]));
        assert_eq!(axis("-Y"), Ok([0.0, -1.0, 0.0]));
        assert!(axis("up").is_err());
    }

    #[test]
    fn counts_have_their_ranges() {
        assert_eq!(spp("1"), Ok(1));
        assert_eq!(spp("2147483648"), Ok(1 << 31));
        assert_eq!(batch("64"), Ok(64));
        assert_eq!(seed("18446744073709551615"), Ok(u64::MAX));
        for wrong in ["0", "2147483649", "-1", "+1", "1.5", "", "4k"] {
            let error = spp(wrong).unwrap_err();
            assert_eq!(error, "expected a whole number from 1 to 2147483648", "{wrong}");
        }
        assert!(threads("4097").is_err() && batch("63").is_err() && batch("262145").is_err());
    }

    #[test]
    fn errors_are_positive_and_finite() {
        assert_eq!(error("0.005"), Ok(0.005));
        assert_eq!(error("5e-4"), Ok(5e-4));
        for wrong in ["0", "-0", "-1", "nan", "inf", "1e400", "1 %", ""] {
            let message = error(wrong).unwrap_err();
            assert_eq!(
                message,
                format!("found \"{wrong}\"; expected a relMSE that is more than zero, such as 0.005")
            );
        }
    }

    #[test]
    fn viewers_have_a_port() {
        assert_eq!(host_and_port("localhost:14158"), Ok("localhost:14158".into()));
        assert_eq!(host_and_port("[::1]:80"), Ok("[::1]:80".into()));
        for wrong in ["", "localhost", ":80", "localhost:", "localhost:0", "localhost:65536", "a:b"] {
            let message = format!("found \"{wrong}\"; expected HOST:PORT, such as localhost:14158");
            assert_eq!(host_and_port(wrong), Err(message));
        }
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(memory("8G"), Ok(8 << 30));
        assert_eq!(memory("1.5 MiB"), Ok(3 << 19));
        assert_eq!(memory("4096"), Ok(4096));
        for wrong in ["", "G", "-1G", "0", "8X", "1e30"] {
            assert!(memory(wrong).unwrap_err().contains("such as 8G"), "{wrong}");
        }
    }

    #[test]
    fn exposure_is_finite() {
        assert_eq!(stops("-1.5"), Ok(-1.5));
        for wrong in ["nan", "inf", "1e9", "bright"] {
            assert!(stops(wrong).is_err(), "{wrong}");
        }
    }
}
