//! Parsers for the values of options, with messages that say what is expected.

use std::num::IntErrorKind;
use std::ops::RangeInclusive;
use std::time::Duration;

use super::args::Resolution;
use crate::engine::wavefront::BATCHES;
use crate::picture::MAX_PIXELS;

/// Longest duration that is accepted: a hundred years of 365 days.
const MAX_SECONDS: f64 = 100.0 * 365.0 * 86_400.0;

/// A span of time: `30s`, `2m`, `1.5h`, `500ms`; a plain number counts seconds.
pub fn duration(text: &str) -> Result<Duration, String> {
    let expected = "expected a time such as 30s, 2m, 1.5h or 500ms";
    let text = text.trim();
    let digits = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let unit = match unit {
        "ms" => 1e-3,
        "" | "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        "d" => 86_400.0,
        _ => return Err(format!("{expected}; the units are ms, s, m, h and d")),
    };
    let number: f64 = number.trim().parse().map_err(|_| expected.to_string())?;
    let seconds = number * unit;
    if seconds <= 0.0 {
        return Err("the time must be more than zero".into());
    }
    if seconds > MAX_SECONDS {
        return Err("the time must be at most a hundred years".into());
    }
    let duration = Duration::try_from_secs_f64(seconds).map_err(|_| expected.to_string())?;
    if duration.is_zero() { Err("the time must be at least 1 ns".into()) } else { Ok(duration) }
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
    fn durations() {
        let seconds = |text| duration(text).unwrap().as_secs_f64();
        assert_eq!(seconds("30s"), 30.0);
        assert_eq!(seconds("30"), 30.0);
        assert_eq!(seconds("0.25"), 0.25);
        assert_eq!(seconds("2m"), 120.0);
        assert_eq!(seconds("1.5h"), 5400.0);
        assert_eq!(seconds("500ms"), 0.5);
        assert_eq!(seconds(" 2 min "), 120.0);
        for wrong in [
            "",
            "s",
            "-5s",
            "0",
            "0h",
            "nan",
            "inf",
            "infinity",
            "1e400",
            "1e300h",
            "30 parsecs",
            "1h30m",
            "5S",
            "1..5s",
            "1e-30s",
        ] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
        assert!(duration("5 weeks").unwrap_err().contains("units are ms"));
    }

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
    fn exposure_is_finite() {
        assert_eq!(stops("-1.5"), Ok(-1.5));
        for wrong in ["nan", "inf", "1e9", "bright"] {
            assert!(stops(wrong).is_err(), "{wrong}");
        }
    }
}
