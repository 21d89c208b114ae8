//! Curves from scene light to what a screen shows: for files that people look at.

use std::fmt;

/// How linear light becomes the light of a screen, from 0 to 1; the sRGB transfer function follows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Tonemap {
    /// Nothing but the transfer function: what is brighter than 1 is cut off.
    #[default]
    Srgb,
    /// AgX (Troy Sobotka) in the polynomial fit of Benjamin Wrensch, "Minimal AgX Implementation", 2024: a soft curve
    /// in which bright colours fade to white.
    Agx,
    /// The reference and output transforms of ACES for sRGB screens, in Stephen Hill's fit ("BakingLab", 2016): more
    /// contrast, 1 is shown as about 0.8.
    Aces,
}

impl Tonemap {
    /// All curves.
    pub const ALL: [Tonemap; 3] = [Tonemap::Srgb, Tonemap::Agx, Tonemap::Aces];

    /// As the command line calls it.
    pub fn name(self) -> &'static str {
        match self {
            Tonemap::Srgb => "srgb",
            Tonemap::Agx => "agx",
            Tonemap::Aces => "aces",
        }
    }

    /// The linear light of the screen, each channel from 0 to 1; NaN if a channel is NaN.
    pub fn apply(self, colour: [f32; 3]) -> [f64; 3] {
        // The curves mix the channels; and infinity times 0 would be no number.
        if colour.iter().any(|channel| channel.is_nan()) {
            return [f64::NAN; 3];
        }
        let colour = colour.map(|channel| f64::from(channel).clamp(0.0, BRIGHTEST));
        let shown = match self {
            Tonemap::Srgb => colour,
            Tonemap::Agx => agx(colour),
            Tonemap::Aces => aces(colour),
        };
        shown.map(|channel| channel.clamp(0.0, 1.0))
    }
}

impl fmt::Display for Tonemap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// All curves are flat long before.
const BRIGHTEST: f64 = 1e9;

type Matrix = [[f64; 3]; 3];

fn times(matrix: &Matrix, colour: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * colour[0] + row[1] * colour[1] + row[2] * colour[2])
}

/// Factors as published.
#[allow(clippy::excessive_precision)]
fn agx(colour: [f64; 3]) -> [f64; 3] {
    const INSET: Matrix = [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ];
    const OUTSET: Matrix = [
        [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
        [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
        [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
    ];
    // Exposures that the curve spans, in stops.
    const LEAST: f64 = -12.47393;
    const MOST: f64 = 4.026069;
    // Coefficients from the highest power down.
    const CURVE: [f64; 7] = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];
    let encoded = times(&INSET, colour).map(|channel| {
        let x = (channel.max(1e-10).log2().clamp(LEAST, MOST) - LEAST) / (MOST - LEAST);
        CURVE.iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
    });
    // The curve gives values encoded for a screen with an exponent of 2.2.
    times(&OUTSET, encoded).map(|channel| channel.max(0.0).powf(2.2))
}

/// Factors as published.
fn aces(colour: [f64; 3]) -> [f64; 3] {
    const INPUT: Matrix =
        [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]];
    const OUTPUT: Matrix =
        [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]];
    let fitted = times(&INPUT, colour)
        .map(|v| (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081));
    times(&OUTPUT, fitted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_rises_from_black_to_white_and_keeps_greys_grey() {
        for curve in Tonemap::ALL {
            let mut last = -1e-9;
            for step in -20..=20 {
                let [r, g, b] = curve.apply([(step as f32 / 2.0).exp2(); 3]);
                assert!((r - g).abs() < 2e-3 && (g - b).abs() < 2e-3, "{curve}: {r} {g} {b}");
                assert!(g >= last - 1e-3, "{curve} at 2^{}: {g} after {last}", step as f64 / 2.0);
                last = g;
            }
            assert!(curve.apply([0.0; 3])[1] < 1e-3, "{curve}");
            assert!(curve.apply([f32::INFINITY; 3])[1] > 0.95, "{curve}");
            assert!(curve.apply([f32::NAN, 0.0, 0.0])[0].is_nan(), "{curve}");
        }
    }

    /// Middle grey is where each curve is known to put it.
    #[test]
    fn middle_grey() {
        let srgb = |curve: Tonemap| crate::picture::linear_to_srgb(curve.apply([0.18; 3])[1]);
        assert!((srgb(Tonemap::Srgb) - 0.4614).abs() < 1e-3);
        // AgX: 0.18 is shown at about half of the encoded range.
        assert!((srgb(Tonemap::Agx) - 0.5).abs() < 0.04, "{}", srgb(Tonemap::Agx));
        // ACES: 0.18 gives about 0.1 of linear light.
        let aces = Tonemap::Aces.apply([0.18; 3])[1];
        assert!((aces - 0.1055).abs() < 0.01, "{aces}");
    }

    #[test]
    fn bright_colours_fade_to_white_under_agx() {
        let [r, g, b] = Tonemap::Agx.apply([200.0, 0.0, 0.0]);
        assert!(r > g && r > b && g > 0.1 && b > 0.1, "{r} {g} {b}");
        assert_eq!(Tonemap::Srgb.apply([200.0, 0.0, 0.0]), [1.0, 0.0, 0.0]);
    }
}
