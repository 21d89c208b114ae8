//! Spans of time, as people type and read them: one parser and one form for all commands.

use std::time::Duration;

/// Longest span that is accepted: a hundred years of 365 days.
const MAX_SECONDS: f64 = 100.0 * 365.0 * 86_400.0;

/// Units from large to small, in seconds.
const UNITS: [(&str, f64); 6] =
    [("d", 86_400.0), ("h", 3600.0), ("min", 60.0), ("m", 60.0), ("s", 1.0), ("ms", 1e-3)];

/// A span of time: `90`, `90s`, `1m30s`, `2h`, `1.5h`, `500ms`. A plain number counts seconds; several units go from
/// large to small.
///
/// # Errors
/// What is expected, in words.
pub fn parse(text: &str) -> Result<Duration, String> {
    let expected = "expected a time such as 30s, 1m30s, 2h or 500ms";
    let seconds = match text.trim().parse::<f64>() {
        Ok(seconds) if seconds.is_finite() => seconds,
        Ok(_) => return Err(expected.into()),
        Err(_) => with_units(text.trim(), expected)?,
    };
    if seconds <= 0.0 {
        return Err("the time must be more than zero".into());
    }
    if seconds > MAX_SECONDS {
        return Err("the time must be at most a hundred years".into());
    }
    let duration = Duration::try_from_secs_f64(seconds).map_err(|_| expected.to_string())?;
    if duration.is_zero() { Err("the time must be at least 1 ns".into()) } else { Ok(duration) }
}

/// Numbers with units, in seconds.
fn with_units(text: &str, expected: &str) -> Result<f64, String> {
    let (mut rest, mut seconds, mut last) = (text, 0.0, f64::INFINITY);
    while !rest.is_empty() {
        let digits = rest.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(rest.len());
        let (number, tail) = rest.split_at(digits);
        let letters = tail.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(tail.len());
        let (name, tail) = tail.split_at(letters);
        let number: f64 = number.trim().parse().map_err(|_| expected.to_string())?;
        // A number without a unit behind one that has one would be a riddle.
        let Some((_, unit)) = UNITS.iter().find(|(unit, _)| *unit == name) else {
            return Err(format!("{expected}; the units are ms, s, m, h and d"));
        };
        if *unit >= last {
            return Err(format!("{expected}; the units go from large to small"));
        }
        if number < 0.0 {
            return Err("the time must be more than zero".into());
        }
        (seconds, last, rest) = (seconds + number * unit, *unit, tail.trim_start());
    }
    if last.is_infinite() { Err(expected.into()) } else { Ok(seconds) }
}

/// `12s`, `3m05s` or `2h07m`; rounded up.
pub fn clock(time: Duration) -> String {
    let seconds = time.as_secs_f64().ceil() as u64;
    match seconds {
        0..60 => format!("{seconds}s"),
        60..3600 => format!("{}m{:02}s", seconds / 60, seconds % 60),
        _ => format!("{}h{:02}m", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans() {
        let seconds = |text| parse(text).unwrap().as_secs_f64();
        for (text, expected) in [
            ("30s", 30.0),
            ("90", 90.0),
            ("0.25", 0.25),
            ("2m", 120.0),
            ("1.5h", 5400.0),
            ("500ms", 0.5),
            (" 2 min ", 120.0),
            ("1m30s", 90.0),
            ("1h30m", 5400.0),
            ("1d 2h 3m 4s 5ms", 93_784.005),
            ("2h", 7200.0),
        ] {
            assert!((seconds(text) - expected).abs() < 1e-9, "{text}");
        }
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
            "5S",
            "1..5s",
            "1e-30s",
            "1m30",
            "30s1m",
            "1m2m",
            "1m-30s",
            "1m2min",
            "1 2",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert!(parse("5 weeks").unwrap_err().contains("units are ms"));
        assert!(parse("1s2m").unwrap_err().contains("from large to small"));
    }

    #[test]
    fn clocks_are_short() {
        let shown = [0, 59, 185, 7620].map(|seconds| clock(Duration::from_secs(seconds)));
        assert_eq!(shown, ["0s", "59s", "3m05s", "2h07m"]);
    }
}
