//! The part of the error that does not average away.
//!
//! With `e_i = I_i - R` for the pictures `I_i` of `n` seeds and the reference `R`, the measured relMSE of one seed is the
//! mean over pixels and channels of `e_i^2 / (R^2 + 0.01)`: its noise, plus the squared bias, plus the reference's own
//! error. In a product of two different seeds, `e_i e_j / (R^2 + 0.01)`, the independent noise averages to nothing. So
//! the mean over all pairs estimates bias and the reference's own error without any noise in it; it is the same as the
//! error of the mean picture less `1/n` of the variance between seeds:
//!
//! ```text
//! bias^2 + own = (n relMSE(mean picture) - mean relMSE) / (n - 1)
//! ```
//!
//! The interval is a jackknife over the seeds (Efron and Stein, "The Jackknife Estimate of Variance", 1981). Without any
//! bias it is too wide by up to a factor of sqrt 2, never too narrow.

use super::statistics::Estimate;
use crate::compare::{EPSILON, SizeMismatch, compare};
use crate::picture::Image;

/// Fewest seeds that give an interval.
const SEEDS_FOR_INTERVAL: usize = 3;

/// The products `e_i e_j / (R^2 + 0.01)` of all pictures, averaged over the pixels that are valid in every picture (no
/// channel NaN, infinite or negative) and their channels: a symmetric matrix whose diagonal holds the relMSEs.
///
/// # Errors
/// [`SizeMismatch`], as [`compare`].
pub fn error_products(images: &[&Image], reference: &Image) -> Result<Vec<Vec<f64>>, SizeMismatch> {
    for image in images {
        compare(image, reference)?;
    }
    let count = images.len();
    let mut sums = vec![vec![0.0; count]; count];
    let Some(first) = images.first() else { return Ok(sums) };
    let same_size = (first.width, first.height) == (reference.width, reference.height);
    let cropped = if same_size { None } else { reference.crop(first.window, first.width, first.height) };
    let reference = cropped.as_ref().unwrap_or(reference);
    let (mut valid, mut errors) = (0_u64, vec![0.0; count]);
    for (index, truth) in reference.pixels.iter().enumerate() {
        let is_valid = |colour: &[f32; 3]| colour.iter().all(|value| value.is_finite() && *value >= 0.0);
        if !is_valid(truth) || !images.iter().all(|image| is_valid(&image.pixels[index])) {
            continue;
        }
        valid += 1;
        for channel in 0..3 {
            let truth = f64::from(truth[channel]);
            for (error, image) in errors.iter_mut().zip(images) {
                *error = f64::from(image.pixels[index][channel]) - truth;
            }
            let weight = (truth * truth + EPSILON).recip();
            for (row, a) in sums.iter_mut().zip(&errors) {
                for (sum, b) in row.iter_mut().zip(&errors) {
                    *sum += weight * a * b;
                }
            }
        }
    }
    for sum in sums.iter_mut().flatten() {
        *sum /= (3 * valid) as f64;
    }
    Ok(sums)
}

/// Squared bias in relMSE from a matrix of [`error_products`], less the reference's own relMSE (0 if it is not known:
/// then the figure is an upper bound).
///
/// May be negative by chance. `None` unless there are two seeds; the interval needs three.
pub fn squared_bias(products: &[Vec<f64>], own_relmse: f64) -> Option<Estimate> {
    let count = products.len();
    let total = |skip: Option<usize>| {
        let kept = |index: &usize| Some(*index) != skip;
        let pairs = (0..count).filter(kept).flat_map(|i| (0..i).filter(kept).map(move |j| (i, j)));
        pairs.map(|(i, j)| products[i][j]).sum::<f64>()
    };
    let pairs = |seeds: usize| (seeds * (seeds - 1) / 2) as f64;
    if count < 2 {
        return None;
    }
    let value = total(None) / pairs(count) - own_relmse;
    if !value.is_finite() {
        return None;
    }
    if count < SEEDS_FOR_INTERVAL {
        return Some(Estimate::bare(value));
    }
    let without: Vec<f64> = (0..count).map(|seed| total(Some(seed)) / pairs(count - 1)).collect();
    let mean = without.iter().sum::<f64>() / count as f64;
    let squares: f64 = without.iter().map(|estimate| (estimate - mean).powi(2)).sum();
    let variance = squares * (count - 1) as f64 / count as f64;
    Some(Estimate::from_standard_error(value, variance.sqrt(), count - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::synthetic::{Normal, coverage, covers_as_promised};

    const PIXELS: u32 = 64;

    /// Pictures of grey 1 with noise, whose left half is too bright by `bias`.
    fn pictures(normal: &mut Normal, seeds: usize, bias: f64) -> Vec<Image> {
        let pixel = |index: u32, normal: &mut Normal| {
            let shift = if index < PIXELS / 2 { bias } else { 0.0 };
            [0; 3].map(|_| (1.0 + shift + 0.1 * normal.draw()) as f32)
        };
        let mut picture = || Image::new(PIXELS, 1, (0..PIXELS).map(|index| pixel(index, normal)).collect());
        (0..seeds).map(|_| picture()).collect()
    }

    fn estimate(normal: &mut Normal, seeds: usize, bias: f64) -> Estimate {
        let pictures = pictures(normal, seeds, bias);
        let pictures: Vec<&Image> = pictures.iter().collect();
        let reference = Image::new(PIXELS, 1, vec![[1.0; 3]; PIXELS as usize]);
        squared_bias(&error_products(&pictures, &reference).unwrap(), 0.0).unwrap()
    }

    #[test]
    fn the_diagonal_is_the_relmse_and_the_rest_is_the_formula() {
        let pictures = pictures(&mut Normal::new(3), 4, 0.05);
        let reference = Image::new(PIXELS, 1, vec![[1.0; 3]; PIXELS as usize]);
        let products = error_products(&pictures.iter().collect::<Vec<_>>(), &reference).unwrap();
        let relmse = |image: &Image| compare(image, &reference).unwrap().relmse;
        for (index, image) in pictures.iter().enumerate() {
            assert!((products[index][index] - relmse(image)).abs() < 1e-12);
        }
        let mean_of = |index: usize| {
            [0, 1, 2].map(|channel| pictures.iter().map(|p| p.pixels[index][channel]).sum::<f32>() / 4.0)
        };
        let mean = Image::new(PIXELS, 1, (0..PIXELS as usize).map(mean_of).collect());
        let mean_relmse = pictures.iter().map(relmse).sum::<f64>() / 4.0;
        let expected = (4.0 * relmse(&mean) - mean_relmse) / 3.0;
        let estimate = squared_bias(&products, 0.0).unwrap();
        assert!((estimate.value - expected).abs() < 1e-8, "{} {expected}", estimate.value);
        assert!((squared_bias(&products, 0.5).unwrap().value - estimate.value + 0.5).abs() < 1e-12);
    }

    #[test]
    fn invalid_pixels_and_parts_of_a_frame() {
        let reference = Image::new(3, 1, vec![[9.0; 3], [1.0; 3], [1.0; 3]]);
        let window = crate::picture::DataWindow { x: 1, ..reference.window };
        let part = |pixels| Image { window, ..Image::new(2, 1, pixels) };
        let (a, b) = (part(vec![[2.0; 3], [f32::NAN; 3]]), part(vec![[1.5; 3], [7.0; 3]]));
        let products = error_products(&[&a, &b], &reference).unwrap();
        assert!((products[0][1] - 0.5 / 1.01).abs() < 1e-12 && products[0][1] == products[1][0]);
        let wrong = Image::new(2, 2, vec![[0.0; 3]; 4]);
        assert!(error_products(&[&wrong], &reference).is_err());
        assert_eq!(squared_bias(&products[..1], 0.0), None);
        assert_eq!(squared_bias(&products, 0.0).unwrap().interval, None);
    }

    #[test]
    fn intervals_cover_the_true_bias() {
        let mut normal = Normal::new(4);
        // Half of the pixels are off by the bias.
        covers_as_promised(0.5 * 0.2 * 0.2 / 1.01, || estimate(&mut normal, 6, 0.2));
        let unbiased = coverage(0.0, || estimate(&mut normal, 6, 0.0));
        assert!(unbiased >= 0.9, "{unbiased}");
    }
}
