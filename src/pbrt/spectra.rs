//! Spectra as linear sRGB.
//!
//! wavepath renders in linear sRGB (Rec. 709 primaries, white D65), so every spectrum of a scene becomes three
//! numbers here. Colour matching functions are the analytic fit to CIE 1931 by Wyman, Sloan and Shirley ("Simple
//! Analytic Approximations to the CIE XYZ Color Matching Functions", JCGT 2(2), 2013), the illuminant is CIE D65
//! (CIE 15:2004, 10 nm steps).
//!
//! * A **surface's** spectrum (reflectance, index of refraction) is looked at under D65, and each channel is
//!   divided by its own response, so that a constant spectrum c gives (c, c, c). pbrt-v3 instead looks at it under
//!   light of equal energy and does not divide: there a constant spectrum c gives (1.205 c, 0.948 c, 0.909 c).
//! * A **light's** spectrum is projected onto the primaries. pbrt-v4 divides lights by their luminance, so that
//!   only the colour of a spectrum matters; pbrt-v3 keeps the magnitude.

/// Linear sRGB in double precision.
pub(crate) type Rgb64 = [f64; 3];

/// Wavelengths of the integrals, in nm, at 1 nm.
const VISIBLE: std::ops::RangeInclusive<u32> = 380..=780;

/// Piecewise linear samples: pairs of wavelength in nm and value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sampled {
    pairs: Vec<[f64; 2]>,
    /// The value of the ends holds beyond them; otherwise 0 does.
    extended: bool,
}

impl Sampled {
    /// From interleaved wavelengths and values. Wavelengths must rise.
    ///
    /// pbrt-v3 extends the ends, pbrt-v4 is 0 beyond them. Samples that span 400 to 700 nm are extended in any
    /// case: what is missing then is the eye's limit and not meant.
    pub(crate) fn new(interleaved: &[f64], v3: bool) -> Result<Sampled, String> {
        if interleaved.is_empty() || !interleaved.len().is_multiple_of(2) {
            return Err("expected pairs of wavelength and value".into());
        }
        let pairs: Vec<[f64; 2]> = interleaved.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
        if pairs.windows(2).any(|pair| pair[1][0] <= pair[0][0]) {
            return Err("expected rising wavelengths".into());
        }
        let spans = pairs[0][0] <= 400.0 && pairs[pairs.len() - 1][0] >= 700.0;
        Ok(Sampled { pairs, extended: v3 || spans })
    }

    fn at(&self, wavelength: f64) -> f64 {
        let after = self.pairs.partition_point(|pair| pair[0] < wavelength);
        let outside = |end: [f64; 2]| {
            if self.extended || end[0] == wavelength { end[1] } else { 0.0 }
        };
        match (after.checked_sub(1).and_then(|i| self.pairs.get(i)), self.pairs.get(after)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (wavelength - a[0]) / (b[0] - a[0]),
            (None, Some(end)) | (Some(end), None) => outside(*end),
            (None, None) => 0.0,
        }
    }

    /// The value, if it is the same everywhere.
    fn constant(&self) -> Option<f64> {
        let value = self.pairs[0][1];
        (self.extended && self.pairs.iter().all(|pair| pair[1] == value)).then_some(value)
    }

    /// Value of a smooth index of refraction at one wavelength.
    pub(crate) fn index_at(&self, wavelength: f64) -> f64 {
        self.at(wavelength.clamp(self.pairs[0][0], self.pairs[self.pairs.len() - 1][0]))
    }

    /// Colour of a surface's property: see above.
    pub(crate) fn surface_rgb(&self, v3: bool) -> Rgb64 {
        if v3 {
            return light_rgb(|w| self.at(w), true);
        }
        if let Some(value) = self.constant() {
            return [value; 3];
        }
        let seen = rgb_from_xyz(integrate(|w| self.at(w) * d65(w)));
        let white = rgb_from_xyz(integrate(d65));
        std::array::from_fn(|i| (seen[i] / white[i]).max(0.0))
    }

    /// Colour of a light; see [`light_rgb`].
    pub(crate) fn light_rgb(&self, v3: bool) -> Rgb64 {
        light_rgb(|w| self.at(w), v3)
    }
}

/// Colour of a light's spectrum: with luminance 1 in pbrt-v4, with the spectrum's own in pbrt-v3
/// (where the constant spectrum 1 has luminance 1). Colours outside sRGB are clipped.
fn light_rgb(spectrum: impl Fn(f64) -> f64, v3: bool) -> Rgb64 {
    let xyz = integrate(spectrum);
    let norm = if v3 { integrate(|_| 1.0)[1] } else { xyz[1] };
    if norm <= 0.0 {
        return [0.0; 3];
    }
    rgb_from_xyz(xyz).map(|c| (c / norm).max(0.0))
}

/// Colour of a black body. pbrt-v4: luminance 1. pbrt-v3: its spectrum is scaled to a maximum of 1.
pub(crate) fn blackbody_rgb(kelvin: f64, v3: bool) -> Rgb64 {
    // Wien: the maximum, below or above which Planck's law would underflow for odd temperatures.
    let peak = 2.897_771_955e6 / kelvin;
    let planck = |w: f64| relative_planck(w, peak);
    light_rgb(planck, v3)
}

/// Planck's law relative to its maximum at `peak` (nm): (p/w)^5 (e^b - 1) / (e^(b p/w) - 1) with Wien's b = 4.9651.
fn relative_planck(wavelength: f64, peak: f64) -> f64 {
    const B: f64 = 4.965_114_231_744_276;
    let ratio = peak / wavelength;
    ratio.powi(5) * B.exp_m1() / (B * ratio).exp_m1()
}

/// Integral of a spectrum with the three colour matching functions.
fn integrate(spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for wavelength in VISIBLE {
        let wavelength = f64::from(wavelength);
        let value = spectrum(wavelength);
        let matching = cie_1931(wavelength);
        for (s, m) in sum.iter_mut().zip(matching) {
            *s += value * m;
        }
    }
    sum
}

/// Multi-lobe fit of Wyman, Sloan and Shirley (2013), equations 4, and table 1.
fn cie_1931(w: f64) -> [f64; 3] {
    let lobe = |scale: f64, mean: f64, below: f64, above: f64| {
        let t = (w - mean) * if w < mean { below } else { above };
        scale * (-0.5 * t * t).exp()
    };
    [
        lobe(0.362, 442.0, 0.0624, 0.0374)
            + lobe(1.056, 599.8, 0.0264, 0.0323)
            + lobe(-0.065, 501.1, 0.0490, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    ]
}

/// CIE standard illuminant D65, relative.
fn d65(wavelength: f64) -> f64 {
    const TABLE: [f64; 41] = [
        49.9755, 54.6482, 82.7549, 91.486, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923,
        108.811, 109.354, 107.802, 104.79, 107.689, 104.405, 104.046, 100.0, 96.3342, 95.788, 88.6856,
        90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091,
        74.349, 61.604, 69.8856, 75.087, 63.5927, 46.4182, 66.8054, 63.3828,
    ];
    let t = ((wavelength - 380.0) / 10.0).clamp(0.0, 40.0);
    let i = (t as usize).min(39);
    TABLE[i] + (TABLE[i + 1] - TABLE[i]) * (t - i as f64)
}

/// IEC 61966-2-1.
pub(crate) fn rgb_from_xyz([x, y, z]: [f64; 3]) -> Rgb64 {
    [
        3.240_969_941_904_521 * x - 1.537_383_177_570_093 * y - 0.498_610_760_293 * z,
        -0.969_243_636_280_87 * x + 1.875_967_501_507_72 * y + 0.041_555_057_407_175 * z,
        0.055_630_079_696_993 * x - 0.203_976_958_888_97 * y + 1.056_971_514_242_878 * z,
    ]
}

/// A spectrum that pbrt-v4 knows by name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Named {
    /// Optical constant of a metal, under light of equal energy.
    Metal(Rgb64),
    /// Index of refraction of a glass at 587.6 nm.
    Glass(f64),
    /// The white of sRGB.
    WhiteLight,
}

/// The named spectra.
///
/// Metals: spectra of Mitsuba's data base (from SOPRA and Palik) converted to linear sRGB, the triples that
/// Mitsuba 0.6 and Tungsten print; pbrt-v4 uses the same measured data. The conversion is pbrt-v3's, in which white of
/// equal energy has a tint: [`Named::surface_rgb`] takes it out. Glasses: n_d of the makers' catalogues (Schott; pbrt's F5, F10, F11 are SF5, SF10, SF11).
pub(crate) const NAMED: [(&str, Named); 22] = [
    ("metal-Ag-eta", Named::Metal([0.155_264_65, 0.116_723_3, 0.138_380_7])),
    ("metal-Ag-k", Named::Metal([4.828_343_3, 3.122_246, 2.146_950_4])),
    ("metal-Al-eta", Named::Metal([1.6575, 0.880405, 0.521244])),
    ("metal-Al-k", Named::Metal([9.22381, 6.2695, 4.837])),
    ("metal-Au-eta", Named::Metal([0.143_118_96, 0.374_957_04, 1.442_478_6])),
    ("metal-Au-k", Named::Metal([3.983_160_4, 2.385_720_7, 1.603_215_3])),
    ("metal-Cu-eta", Named::Metal([0.200_437_7, 0.924_033_4, 1.102_212])),
    ("metal-Cu-k", Named::Metal([3.912_948_5, 2.452_847_7, 2.142_188])),
    ("metal-MgO-eta", Named::Metal([2.089_588_6, 1.650_722_5, 1.594_876])),
    ("metal-MgO-k", Named::Metal([0.0; 3])),
    ("metal-TiO2-eta", Named::Metal([3.456_620_3, 2.801_707_7, 2.905_148_5])),
    ("metal-TiO2-k", Named::Metal([0.000_102_67, 0.0, 0.000_635_69])),
    ("glass-BK7", Named::Glass(1.5168)),
    ("glass-BAF10", Named::Glass(1.6700)),
    ("glass-FK51A", Named::Glass(1.4866)),
    ("glass-LASF9", Named::Glass(1.8503)),
    ("glass-F5", Named::Glass(1.6727)),
    ("glass-SF5", Named::Glass(1.6727)),
    ("glass-F10", Named::Glass(1.7283)),
    ("glass-SF10", Named::Glass(1.7283)),
    ("glass-F11", Named::Glass(1.7847)),
    ("stdillum-D65", Named::WhiteLight),
];

/// How the names of pbrt-v4's other spectra begin: brass, further illuminants, cameras.
pub(crate) const UNSUPPORTED_PREFIXES: [&str; 7] =
    ["metal-CuZn-", "stdillum-", "illum-", "canon_", "nikon_", "sony_", "cie1931"];

impl Named {
    /// Colour of a surface's property; `None` for the spectrum of a light. Metals as pbrt-v3 converts them, or such that a
    /// constant spectrum would be the same in all channels.
    pub(crate) fn surface_rgb(self, v3: bool) -> Option<Rgb64> {
        match self {
            Named::Metal(rgb) if v3 => Some(rgb),
            Named::Metal(rgb) => {
                let white = rgb_from_xyz([1.0; 3]);
                Some(std::array::from_fn(|i| rgb[i] / white[i]))
            }
            Named::Glass(eta) => Some([eta; 3]),
            Named::WhiteLight => None,
        }
    }
}

/// The named spectrum, if there is one.
pub(crate) fn named(name: &str) -> Option<Named> {
    // pbrt-v4 calls SF11 both names.
    let name = if name == "glass-SF11" { "glass-F11" } else { name };
    NAMED.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn d65_is_the_white_of_srgb() {
        let rgb = light_rgb(d65, false);
        assert!(rgb.iter().all(|c| (c - 1.0).abs() < 0.02), "{rgb:?}");
    }

    #[test]
    fn constants_stay_constant() {
        let grey = |v3| Sampled::new(&[400.0, 0.3, 550.0, 0.3, 700.0, 0.3], v3).unwrap().surface_rgb(v3);
        assert_eq!(grey(false), [0.3; 3]);
        let nearly = Sampled::new(&[300.0, 0.3, 800.0, 0.300_000_001], true).unwrap().surface_rgb(false);
        assert!(nearly.iter().all(|c| (c - 0.3).abs() < 1e-8));
        // pbrt-v3's grey has a tint: the row sums of the matrix from XYZ, but for the fit of the matching functions.
        for (c, tint) in grey(true).into_iter().zip([1.205, 0.948, 0.909]) {
            assert!((c / 0.3 - tint).abs() < 0.01, "{c}, not {tint} times 0.3");
        }
    }

    #[test]
    fn named_metals_reflect_as_their_spectra() {
        // Reflectance at normal incidence under the white of sRGB, from the spectra themselves (pbrt-v4).
        let constants = |name: &str, v3| named(name).unwrap().surface_rgb(v3).unwrap();
        for (metal, right) in [
            ("MgO", [0.0720, 0.0731, 0.0749]),
            ("TiO2", [0.232, 0.245, 0.273]),
            ("Al", [0.913, 0.921, 0.924]),
        ] {
            let eta = constants(&format!("metal-{metal}-eta"), false);
            let k = constants(&format!("metal-{metal}-k"), false);
            for i in 0..3 {
                let (n, k2) = (eta[i], k[i] * k[i]);
                let r = ((n - 1.0).powi(2) + k2) / ((n + 1.0).powi(2) + k2);
                assert!((r / right[i] - 1.0).abs() < 0.01, "{metal}: {r}, not {}", right[i]);
            }
        }
        assert_eq!(constants("metal-Cu-eta", true), [0.200_437_7, 0.924_033_4, 1.102_212]);
        assert_eq!(constants("metal-MgO-k", false), [0.0; 3]);
    }

    #[test]
    fn red_spectra_are_red() {
        let [r, g, b] = Sampled::new(&[600.0, 1.0, 700.0, 1.0], false).unwrap().surface_rgb(false);
        assert!(r > 0.5 && g < 0.1 && b < 0.1, "{r} {g} {b}");
    }

    #[test]
    fn black_bodies_have_luminance_one_in_v4() {
        for kelvin in [1500.0, 3000.0, 6500.0, 20000.0] {
            let [r, g, b] = blackbody_rgb(kelvin, false);
            let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
            // Below 1900 K the blue is clipped, which adds a little.
            assert!((luminance - 1.0).abs() < 0.03, "{kelvin} K: {luminance}");
        }
        let [r, g, b] = blackbody_rgb(6500.0, false);
        assert!((r - 1.0).abs() < 0.06 && (g - 1.0).abs() < 0.06 && (b - 1.0).abs() < 0.06, "{r} {g} {b}");
        let [r, g, b] = blackbody_rgb(2700.0, false);
        assert!(r > 1.5 && g < 1.0 && b < 0.4, "{r} {g} {b}");
    }

    #[test]
    fn bad_samples_are_refused() {
        assert!(Sampled::new(&[400.0], false).is_err());
        assert!(Sampled::new(&[400.0, 1.0, 400.0, 2.0], false).is_err());
    }
}
