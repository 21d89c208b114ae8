//! How figures are written.

use super::curve::Reading;
use super::statistics::Estimate;

/// What stands for a figure that is not known.
pub const UNKNOWN: &str = "-";

/// A number with three significant digits: `0.0123`, `1.23e-5`, `12300`.
pub fn number(value: f64) -> String {
    fixed(value, decimals(value))
}

/// A value with its interval in the same number of decimals: `5.13 (4.81..5.44)`.
pub fn estimate(estimate: &Estimate) -> String {
    let places = decimals(estimate.value);
    let value = fixed(estimate.value, places);
    match estimate.interval {
        Some([low, high]) => {
            format!("{value} ({}..{})", like(low, estimate.value), like(high, estimate.value))
        }
        None => value,
    }
}

/// As [`estimate`]; extrapolated ones carry a `~` in front.
pub fn reading(reading: &Reading) -> String {
    let mark = if reading.extrapolated { "~" } else { "" };
    format!("{mark}{}", estimate(&reading.estimate))
}

/// As `show` writes it, or [`UNKNOWN`].
pub fn known<T>(figure: Option<&T>, show: impl Fn(&T) -> String) -> String {
    figure.map_or_else(|| UNKNOWN.to_string(), show)
}

/// A slope with the half width of its interval: `-0.98 +- 0.03`, with `plus_minus` in between.
pub fn slope(slope: &Estimate, plus_minus: &str, minus: &str) -> String {
    let value = format!("{:.2}", slope.value).replace('-', minus);
    match slope.half_width() {
        Some(half) if half >= 0.005 => format!("{value} {plus_minus} {half:.2}"),
        Some(half) => format!("{value} {plus_minus} {}", number(half)),
        None => value,
    }
}

/// A time with its unit: `850 ms`, `12.3 s`, `4.5 min`, `3.2 h`.
pub fn seconds(value: f64) -> String {
    match value {
        v if v < 0.9995 => format!("{} ms", number(1e3 * v)),
        v if v < 99.95 => format!("{} s", number(v)),
        v if v < 5970.0 => format!("{} min", number(v / 60.0)),
        v => format!("{} h", number(v / 3600.0)),
    }
}

/// Places after the point that give three significant digits; `None` for numbers in scientific notation.
fn decimals(value: f64) -> Option<usize> {
    let magnitude = value.abs();
    if magnitude == 0.0 {
        return Some(0);
    }
    // Rounded to three digits first, so that 9.996 counts as 10.0.
    let text = format!("{magnitude:.2e}");
    let exponent: i32 = text.split_once('e').and_then(|(_, digits)| digits.parse().ok()).unwrap_or(0);
    (-3..6).contains(&exponent).then(|| (2 - exponent).max(0) as usize)
}

fn fixed(value: f64, places: Option<usize>) -> String {
    if !value.is_finite() {
        return UNKNOWN.to_string();
    }
    places.map_or_else(|| format!("{value:.2e}"), |places| format!("{value:.places$}"))
}

/// The end of an interval, written as the `value` inside is: with as many places, or with the same power of ten.
fn like(end: f64, value: f64) -> String {
    match decimals(value) {
        // A wide interval: so many places would write nothing but zeros, or digits without end.
        Some(places) if end.abs() >= 0.5 * 0.1_f64.powi(places as i32) || end == 0.0 => {
            fixed(end, Some(places))
        }
        _ => number(end),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits() {
        for (value, expected) in [
            (0.0, "0"),
            (1.0, "1.00"),
            (9.996, "10.0"),
            (123.4, "123"),
            (123_456.0, "123456"),
            (1_234_567.0, "1.23e6"),
            (0.012_34, "0.0123"),
            (0.001_234, "0.00123"),
            (0.000_123_4, "1.23e-4"),
            (-0.5, "-0.500"),
            (f64::NAN, "-"),
            (f64::INFINITY, "-"),
        ] {
            assert_eq!(number(value), expected);
        }
    }

    #[test]
    fn intervals_have_the_places_of_their_value() {
        let show = |value, low, high| estimate(&Estimate { value, interval: Some([low, high]) });
        assert_eq!(show(5.13, 4.8, 5.444), "5.13 (4.80..5.44)");
        assert_eq!(show(1.23e-5, 1.1e-5, 1.4e-5), "1.23e-5 (1.10e-5..1.40e-5)");
        assert_eq!(show(120.0, 0.02, 300.4), "120 (0.0200..300)");
        assert_eq!(estimate(&Estimate::bare(2.0)), "2.00");
        let guess = Reading { estimate: Estimate::bare(2.0), extrapolated: true };
        assert_eq!(reading(&guess), "~2.00");
        assert_eq!(known(None, reading), "-");
    }

    #[test]
    fn slopes_and_times() {
        let estimate = Estimate { value: -0.98, interval: Some([-1.01, -0.95]) };
        assert_eq!(slope(&estimate, "+-", "-"), "-0.98 +- 0.03");
        assert_eq!(slope(&estimate, "±", "−"), "−0.98 ± 0.03");
        let narrow = Estimate { value: -1.0, interval: Some([-1.001, -0.999]) };
        assert_eq!(slope(&narrow, "+-", "-"), "-1.00 +- 0.00100");
        let times = [0.85, 1.0, 12.34, 99.96, 270.0, 11_520.0].map(seconds);
        assert_eq!(times, ["850 ms", "1.00 s", "12.3 s", "1.67 min", "4.50 min", "3.20 h"]);
    }
}
