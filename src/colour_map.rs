//! Colours for numbers: a map whose lightness grows evenly, so that larger always looks larger.

use std::f32::consts::PI;

/// The linear RGB colour of `value` on a scale from 0 (black) through purple, red and orange to 1
/// (pale yellow); values outside are clamped, NaN counts as 0.
///
/// A straight line in the lightness of Oklab with a turning hue, much like matplotlib's "magma".
pub fn heat(value: f32) -> [f32; 3] {
    oklab_to_linear(heat_oklab(value)).map(|channel| channel.clamp(0.0, 1.0))
}

/// Lightness, a and b of the map. The chroma stays inside the gamut of sRGB.
fn heat_oklab(value: f32) -> [f32; 3] {
    let t = if value > 0.0 { value.min(1.0) } else { 0.0 };
    let hue = (285.0 + 180.0 * t).to_radians();
    let chroma = 0.155 * (PI * t).sin() + 0.05 * t;
    [0.97 * t, chroma * hue.cos(), chroma * hue.sin()]
}

/// Oklab to linear sRGB (Björn Ottosson, "A perceptual color space for image processing", 2020).
// The factors are given as published.
#[allow(clippy::excessive_precision)]
fn oklab_to_linear([lightness, a, b]: [f32; 3]) -> [f32; 3] {
    let l = (lightness + 0.3963377774 * a + 0.2158037573 * b).powi(3);
    let m = (lightness - 0.1055613458 * a - 0.0638541728 * b).powi(3);
    let s = (lightness - 0.0894841775 * a - 1.2914855480 * b).powi(3);
    [
        4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
        -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
        -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance([r, g, b]: [f32; 3]) -> f32 {
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }

    #[test]
    fn luminance_grows_all_the_way() {
        let steps: Vec<f32> = (0..=256).map(|i| luminance(heat(i as f32 / 256.0))).collect();
        assert!(steps.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(heat(0.0), [0.0; 3]);
        assert!(steps[256] > 0.85);
    }

    #[test]
    fn the_map_stays_in_the_gamut() {
        for i in 0..=256 {
            let colour = oklab_to_linear(heat_oklab(i as f32 / 256.0));
            assert!(colour.iter().all(|c| (-0.01..=1.01).contains(c)), "{i}: {colour:?}");
        }
    }

    #[test]
    fn values_outside_take_the_ends() {
        assert_eq!(heat(-1.0), heat(0.0));
        assert_eq!(heat(f32::INFINITY), heat(1.0));
        assert_eq!(heat(f32::NAN), heat(0.0));
    }

    #[test]
    fn white_is_white() {
        let white = oklab_to_linear([1.0, 0.0, 0.0]);
        assert!(white.iter().all(|c| (c - 1.0).abs() < 1e-5), "{white:?}");
    }
}
