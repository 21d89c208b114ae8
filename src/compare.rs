//! Error measures of a picture against a reference.
//!
//! With `I` the picture and `R` the reference, each a linear colour channel of a pixel:
//!
//! | measure | definition | unit |
//! |---|---|---|
//! | MSE | mean of `(I - R)^2` | radiance squared |
//! | RMSE | square root of the MSE | radiance |
//! | relMSE | mean of `(I - R)^2 / (R^2 + 0.01)` | none |
//! | relMSE, trimmed | the same without the top 0.1 % of pixels | none |
//! | MAPE | mean of `\|I - R\| / (\|R\| + 0.01)` | none |
//! | SMAPE | mean of `2 \|I - R\| / (\|I\| + \|R\| + 0.01)` | none |
//! | mean ratio | sum of `I` / sum of `R`, for each channel | none |
//!
//! Means are over all valid pixels and their three channels; all sums are in `f64`. A pixel is
//! invalid if any of the six values is NaN, infinite or negative: it is counted and left out.
//!
//! The 0.01 keeps dark pixels from ruling the sum. It is in the picture's own units, so figures are
//! comparable between scenes of similar exposure only (relMSE: Rousselle, Knaus and Zwicker,
//! "Adaptive Sampling and Reconstruction using Greedy Error Minimization", 2011).

pub mod flip;
mod own;

use std::borrow::Cow;
use std::fmt;

use serde::Serialize;

use crate::picture::Image;
use crate::report::Report;

pub use own::{BLOCK, Block, OwnError, own_error, own_error_map};

/// Added to `R^2` in relMSE and to the denominators of MAPE and SMAPE.
pub use wavepath_engine::film::EPSILON;

/// Share of the pixels that the trimmed relMSE leaves out: 1 in 1000, the number rounded down.
const TRIMMED_SHARE: usize = 1000;

/// How far a picture is from a reference; the measures are defined in the [module](self).
///
/// Every figure is NaN (`null` in JSON) if no pixel is valid, and a mean ratio if the reference
/// is black in that channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Mean squared error.
    pub mse: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Relative mean squared error.
    pub relmse: f64,
    /// Relative mean squared error without the 0.1 % of pixels with the largest error (summed over
    /// the channels; the number of pixels left out is rounded down).
    pub relmse_trimmed: f64,
    /// Mean absolute percentage error, as a fraction.
    pub mape: f64,
    /// Symmetric mean absolute percentage error, as a fraction from 0 to 2.
    pub smape: f64,
    /// Mean of the picture over mean of the reference, for red, green, blue: 1 without bias.
    pub mean_ratio: [f64; 3],
    /// Pixels with a NaN, infinite or negative value in either picture, left out of all figures.
    pub invalid_pixels: u64,
}

/// Why two pictures cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the image has {image} pixels, the reference {reference}")]
pub struct SizeMismatch {
    image: Extent,
    reference: Extent,
}

/// Size and place of a picture, for messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Extent {
    size: (u32, u32),
    corner: (i32, i32),
    frame: (u32, u32),
}

impl Extent {
    fn of(image: &Image) -> Self {
        let window = image.window;
        Self {
            size: (image.width, image.height),
            corner: (window.x, window.y),
            frame: (window.full_width, window.full_height),
        }
    }
}

impl fmt::Display for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {}", self.size.0, self.size.1)?;
        if self.size != self.frame || self.corner != (0, 0) {
            let (corner, frame) = (self.corner, self.frame);
            write!(f, " (at {}, {} of {} x {})", corner.0, corner.1, frame.0, frame.1)?;
        }
        Ok(())
    }
}

/// Compares `image` with `reference`.
///
/// Pictures of equal size are compared pixel by pixel, wherever they lie in their frames. Of two that show a part and
/// the whole of the same frame, the part is compared ([`align`]).
///
/// # Errors
/// [`SizeMismatch`] if neither is possible.
pub fn compare(image: &Image, reference: &Image) -> Result<Comparison, SizeMismatch> {
    let (image, reference) = align(image, reference)?;
    Ok(Sums::of(&image, &reference).comparison())
}

/// Both pictures, the larger one cut to the pixels that the other one shows: they have the same size then.
///
/// # Errors
/// [`SizeMismatch`] if neither shows all that the other one shows.
pub fn align<'a>(
    image: &'a Image,
    reference: &'a Image,
) -> Result<(Cow<'a, Image>, Cow<'a, Image>), SizeMismatch> {
    if (image.width, image.height) == (reference.width, reference.height) {
        return Ok((Cow::Borrowed(image), Cow::Borrowed(reference)));
    }
    if let Some(part) = reference.crop(image.window, image.width, image.height) {
        return Ok((Cow::Borrowed(image), Cow::Owned(part)));
    }
    match image.crop(reference.window, reference.width, reference.height) {
        Some(part) => Ok((Cow::Owned(part), Cow::Borrowed(reference))),
        None => Err(SizeMismatch { image: Extent::of(image), reference: Extent::of(reference) }),
    }
}

/// The squared error relative to the reference, `(I - R)^2 / (R^2 + 0.01)`, averaged over the
/// channels of each pixel; NaN for invalid pixels. Rows from top to bottom, of the pixels that [`align`] leaves.
///
/// # Errors
/// As [`compare`].
pub fn relative_error_map(image: &Image, reference: &Image) -> Result<Vec<f32>, SizeMismatch> {
    let (image, reference) = align(image, reference)?;
    let error = |(i, r)| {
        if is_valid(i, r) { relative_error(i, r) / 3.0 } else { f64::NAN }
    };
    Ok(pairs(&image, &reference).map(|pair| error(pair) as f32).collect())
}

/// The relMSE that a reference has itself: from the standard error of each pixel where it has the channels that
/// `--layers` writes, else what its report estimates, if that speaks of the whole picture. `None` if neither is known.
///
/// `whole` is the reference as it was read, `part` what is compared of it.
pub fn own_relmse(whole: &Image, part: &Image) -> Option<f64> {
    if let Some([red, green, blue]) = own::standard_errors(part) {
        let (mut sum, mut pixels) = (0.0, 0_u64);
        for (pixel, colour) in part.pixels.iter().enumerate() {
            let (r, errors) = (wide(*colour), wide([red[pixel], green[pixel], blue[pixel]]));
            let error = (0..3).map(|c| errors[c].powi(2) / (r[c] * r[c] + EPSILON)).sum::<f64>();
            if is_valid(r, r) && error.is_finite() {
                sum += error;
                pixels += 1;
            }
        }
        return (pixels > 0).then(|| sum / (3 * pixels) as f64);
    }
    let report: Report = serde_json::from_str(whole.metadata.report.as_deref()?).ok()?;
    let speaks_of_all = [whole, part].iter().all(|p| (p.width, p.height) == (report.width, report.height));
    report.estimated_relmse.filter(|_| speaks_of_all)
}

/// relMSE of the averages over blocks of `size * size` pixels; partial blocks at the right and
/// lower border and invalid pixels are left out.
///
/// Averaging removes most of the noise, so that a bias shows that single pixels hide. NaN if no
/// block is whole.
///
/// # Errors
/// As [`compare`].
///
/// # Panics
/// If `size` is 0.
pub fn block_relmse(image: &Image, reference: &Image, size: u32) -> Result<f64, SizeMismatch> {
    assert!(size > 0, "blocks have at least one pixel");
    let (image, reference) = align(image, reference)?;
    let (image, reference) = (image.as_ref(), reference.as_ref());
    Ok({
        let (mut sum, mut blocks) = (0.0, 0_u64);
        for top in (0..image.height / size).map(|row| row * size) {
            for left in (0..image.width / size).map(|column| column * size) {
                if let Some((i, r)) = block_means(image, reference, (left, top), size) {
                    sum += relative_error(i, r);
                    blocks += 1;
                }
            }
        }
        sum / (3 * blocks) as f64
    })
}

/// Mean colours over the valid pixels of a block, if it has any.
fn block_means(
    image: &Image,
    reference: &Image,
    (left, top): (u32, u32),
    size: u32,
) -> Option<([f64; 3], [f64; 3])> {
    let mut sums = ([0.0; 3], [0.0; 3]);
    let mut count = 0_u32;
    for (y, x) in (top..top + size).flat_map(|y| (left..left + size).map(move |x| (y, x))) {
        let (i, r) = (wide(image.pixel(x, y)), wide(reference.pixel(x, y)));
        if is_valid(i, r) {
            for channel in 0..3 {
                sums.0[channel] += i[channel];
                sums.1[channel] += r[channel];
            }
            count += 1;
        }
    }
    let mean = |sum: [f64; 3]| sum.map(|value| value / f64::from(count));
    (count > 0).then(|| (mean(sums.0), mean(sums.1)))
}

fn pairs<'a>(image: &'a Image, reference: &'a Image) -> impl Iterator<Item = ([f64; 3], [f64; 3])> + 'a {
    image.pixels.iter().zip(&reference.pixels).map(|(&i, &r)| (wide(i), wide(r)))
}

fn wide(colour: [f32; 3]) -> [f64; 3] {
    colour.map(f64::from)
}

fn is_valid(i: [f64; 3], r: [f64; 3]) -> bool {
    i.iter().chain(&r).all(|value| value.is_finite() && *value >= 0.0)
}

/// `(I - R)^2 / (R^2 + 0.01)`, summed over the channels.
fn relative_error(i: [f64; 3], r: [f64; 3]) -> f64 {
    (0..3).map(|c| (i[c] - r[c]).powi(2) / (r[c] * r[c] + EPSILON)).sum()
}

/// What one pass over the pixels collects.
#[derive(Default)]
struct Sums {
    squared: f64,
    percentage: f64,
    symmetric: f64,
    image: [f64; 3],
    reference: [f64; 3],
    /// Relative squared error of each valid pixel, summed over its channels.
    relative: Vec<f64>,
    invalid: u64,
}

impl Sums {
    fn of(image: &Image, reference: &Image) -> Self {
        let relative = Vec::with_capacity(image.pixels.len());
        let mut sums = Self { relative, ..Self::default() };
        for (i, r) in pairs(image, reference) {
            if is_valid(i, r) {
                sums.add(i, r);
            } else {
                sums.invalid += 1;
            }
        }
        sums
    }

    fn add(&mut self, i: [f64; 3], r: [f64; 3]) {
        for c in 0..3 {
            let difference = (i[c] - r[c]).abs();
            self.squared += difference * difference;
            self.percentage += difference / (r[c] + EPSILON);
            self.symmetric += 2.0 * difference / (i[c] + r[c] + EPSILON);
            self.image[c] += i[c];
            self.reference[c] += r[c];
        }
        self.relative.push(relative_error(i, r));
    }

    fn comparison(mut self) -> Comparison {
        let values = (3 * self.relative.len()) as f64;
        let mse = self.squared / values;
        let relmse = self.relative.iter().sum::<f64>() / values;
        Comparison {
            mse,
            rmse: mse.sqrt(),
            relmse,
            relmse_trimmed: self.trimmed(),
            mape: self.percentage / values,
            smape: self.symmetric / values,
            mean_ratio: std::array::from_fn(|c| ratio(self.image[c], self.reference[c])),
            invalid_pixels: self.invalid,
        }
    }

    /// relMSE without the largest errors; reorders them.
    fn trimmed(&mut self) -> f64 {
        let kept = self.relative.len() - self.relative.len() / TRIMMED_SHARE;
        if kept < self.relative.len() {
            self.relative.select_nth_unstable_by(kept, f64::total_cmp);
        }
        self.relative[..kept].iter().sum::<f64>() / (3 * kept) as f64
    }
}

/// `a / b`, with NaN for every division by zero.
fn ratio(a: f64, b: f64) -> f64 {
    if b == 0.0 { f64::NAN } else { a / b }
}

/// A table of two columns.
impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = [
            ("MSE", self.mse),
            ("RMSE", self.rmse),
            ("relMSE", self.relmse),
            ("relMSE, trimmed", self.relmse_trimmed),
            ("MAPE", self.mape),
            ("SMAPE", self.smape),
        ];
        for (name, value) in rows {
            writeln!(f, "{name:<16}  {value:>12.6e}")?;
        }
        let [red, green, blue] = self.mean_ratio;
        writeln!(f, "{:<16}  {red:.6}  {green:.6}  {blue:.6}", "mean ratio")?;
        write!(f, "{:<16}  {}", "invalid pixels", self.invalid_pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Samples;
    use crate::picture::{Channel, DataWindow};

    fn close(value: f64, expected: f64) {
        assert!((value - expected).abs() <= 1e-12 * expected.abs().max(1.0), "{value} {expected}");
    }

    #[test]
    fn two_pixels_by_hand() {
        let image = Image::new(2, 1, vec![[1.0, 0.5, 0.0], [2.0, 0.0, 3.0]]);
        let reference = Image::new(2, 1, vec![[1.0, 1.0, 0.0], [1.0, 0.0, 4.0]]);
        let result = compare(&image, &reference).unwrap();
        // Differences: 0, 0.5, 0; 1, 0, 1.
        close(result.mse, (0.25 + 1.0 + 1.0) / 6.0);
        close(result.rmse, 0.375_f64.sqrt());
        close(result.relmse, (0.25 / 1.01 + 1.0 / 1.01 + 1.0 / 16.01) / 6.0);
        close(result.relmse_trimmed, result.relmse);
        close(result.mape, (0.5 / 1.01 + 1.0 / 1.01 + 1.0 / 4.01) / 6.0);
        close(result.smape, (1.0 / 1.51 + 2.0 / 3.01 + 2.0 / 7.01) / 6.0);
        for (ratio, expected) in result.mean_ratio.into_iter().zip([1.5, 0.5, 0.75]) {
            close(ratio, expected);
        }
        assert_eq!(result.invalid_pixels, 0);
    }

    #[test]
    fn equal_pictures_have_no_error() {
        let image = Image::new(3, 2, vec![[0.25, 1.0, 1e-20]; 6]);
        let result = compare(&image, &image).unwrap();
        assert_eq!((result.mse, result.relmse, result.smape), (0.0, 0.0, 0.0));
        assert_eq!(result.mean_ratio, [1.0; 3]);
    }

    #[test]
    fn invalid_pixels_are_counted_and_left_out() {
        let good = ([2.0, 2.0, 2.0], [1.0, 1.0, 1.0]);
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1e-9];
        let mut pairs = vec![good];
        for value in bad {
            pairs.push(([1.0, value, 1.0], [1.0; 3]));
            pairs.push(([1.0; 3], [1.0, 1.0, value]));
        }
        let (i, r): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
        let result = compare(&Image::new(9, 1, i), &Image::new(9, 1, r)).unwrap();
        assert_eq!(result.invalid_pixels, 8);
        close(result.mse, 1.0);
        close(result.relmse, 1.0 / 1.01);
        assert_eq!(result.mean_ratio, [2.0; 3]);
    }

    #[test]
    fn without_valid_pixels_nothing_is_known() {
        let image = Image::new(1, 1, vec![[f32::NAN; 3]]);
        let result = compare(&image, &image).unwrap();
        assert_eq!(result.invalid_pixels, 1);
        assert!(result.mse.is_nan() && result.relmse_trimmed.is_nan());
        let json = serde_json::to_value(&result).unwrap();
        assert!(json["mse"].is_null());
    }

    #[test]
    fn trimming_removes_one_pixel_in_a_thousand() {
        let reference = Image::new(2000, 1, vec![[1.0; 3]; 2000]);
        let mut image = Image::new(2000, 1, vec![[1.5; 3]; 2000]);
        image.pixels[17] = [1000.0, 1.0, 1.0];
        image.pixels[1800] = [1.0, 1.0, 500.0];
        image.pixels[3] = [9.0; 3];
        let result = compare(&image, &reference).unwrap();
        let (usual, third) = (3.0 * 0.25 / 1.01, 3.0 * 64.0 / 1.01);
        close(result.relmse_trimmed, (1997.0 * usual + third) / (3.0 * 1998.0));
        assert!(result.relmse > 100.0);
    }

    #[test]
    fn sizes_must_agree() {
        let error = compare(&Image::new(2, 1, vec![[0.0; 3]; 2]), &Image::new(1, 2, vec![[0.0; 3]; 2]));
        let message = error.unwrap_err().to_string();
        assert_eq!(message, "the image has 2 x 1 pixels, the reference 1 x 2");
    }

    #[test]
    fn a_crop_is_compared_with_its_part_of_the_reference() {
        let reference = Image::new(4, 4, (0..16).map(|i| [i as f32; 3]).collect());
        let window = DataWindow { x: 2, y: 1, ..reference.window };
        let crop = reference.crop(window, 2, 3).unwrap();
        assert_eq!(compare(&crop, &reference).unwrap().mse, 0.0);
        assert_eq!(compare(&reference, &crop).unwrap().mse, 0.0);
        // Two parts of which neither holds the other.
        let corner = reference.crop(reference.window, 3, 2).unwrap();
        assert!(compare(&corner, &crop).unwrap_err().to_string().contains("at 2, 1 of 4 x 4"));
    }

    #[test]
    fn the_references_own_error_is_what_its_layers_or_its_report_say() {
        let mut reference = Image::new(2, 1, vec![[1.0; 3], [2.0, 0.0, 1.0]]);
        assert_eq!(own_relmse(&reference, &reference), None);
        for (name, values) in
            [("stderr.R", [0.1, 0.2]), ("stderr.G", [0.0, 0.1]), ("stderr.B", [0.0, f32::NAN])]
        {
            reference.channels.push(Channel { name: name.into(), samples: Samples::Float(values.into()) });
        }
        // The second pixel is not known.
        let own = own_relmse(&reference, &reference).unwrap();
        assert!((own - 0.01 / 1.01 / 3.0).abs() < 1e-8, "{own}");
    }

    #[test]
    fn blocks_average_noise_away() {
        // A checkerboard of 0.5 and 1.5 averages to the reference in every even block.
        let checker = |i: usize| {
            if (i % 5 + i / 5).is_multiple_of(2) { 0.5 } else { 1.5 }
        };
        let image = Image::new(5, 4, (0..20).map(|i| [checker(i); 3]).collect());
        let reference = Image::new(5, 4, vec![[1.0; 3]; 20]);
        close(block_relmse(&image, &reference, 2).unwrap(), 0.0);
        close(block_relmse(&image, &reference, 1).unwrap(), 0.25 / 1.01);
        assert!(block_relmse(&image, &reference, 16).unwrap().is_nan());
        let brighter = Image::new(5, 4, vec![[1.1; 3]; 20]);
        let error = block_relmse(&brighter, &reference, 2).unwrap();
        assert!((error - 0.01 / 1.01).abs() < 1e-6);
    }

    #[test]
    fn the_map_is_the_relative_error_of_each_pixel() {
        let image = Image::new(2, 1, vec![[2.0, 1.0, 1.0], [f32::NAN; 3]]);
        let reference = Image::new(2, 1, vec![[1.0; 3]; 2]);
        let map = relative_error_map(&image, &reference).unwrap();
        assert!((map[0] - 1.0 / 3.03).abs() < 1e-6 && map[1].is_nan());
    }
}
