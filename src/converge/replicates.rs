//! A reference from the experiment's own runs, for scenes that have none.
//!
//! A run must not be held against a reference that it is part of. So each run is measured against the mean of the final
//! pictures of all other seeds. Engines draw the same random numbers: of the runs with the same seed and sampler only the
//! one with the most samples counts, the others are parts of it. Pictures are weighed by their samples, and by how noisy a
//! sample of their sampler is, in all pictures of that sampler together; never by their own estimated errors: a picture
//! with a firefly would weigh less, and the mean would be too dark.
//!
//! The references differ, and so do their own errors. Those are known, from the replicates within each film. What is
//! reported is the error that would have been measured against the mean of all, were it independent of the run: the
//! measured one, less the own error of the reference used, plus that of the mean of all.

use super::{Errors, OwnError};
use crate::compare::EPSILON;
use crate::picture::Image;

/// The last picture of a run.
#[derive(Debug)]
pub struct FinalPicture {
    /// Seed of its random numbers.
    pub seed: u64,
    /// Name of its sampler.
    pub sampler: String,
    /// Pixel samples.
    pub samples: u64,
    /// The picture.
    pub image: Image,
    /// Variance of each pixel's mean.
    pub variance: Vec<[f32; 3]>,
}

/// A mean of pictures.
#[derive(Debug)]
pub struct PooledReference {
    /// The mean.
    pub image: Image,
    /// How many pictures.
    pub count: usize,
    /// Samples per pixel of all of them.
    pub spp: f64,
    /// What the mean itself is off by.
    pub own_error: OwnError,
}

impl PooledReference {
    /// The mean of the pictures of all seeds but those in `without`; `None` if there is none.
    pub fn of(pictures: &[FinalPicture], without: &[u64]) -> Option<Self> {
        let others = || pictures.iter().filter(|picture| !without.contains(&picture.seed));
        let is_largest = |index: usize, picture: &FinalPicture| {
            let rivals = others()
                .enumerate()
                .filter(|(_, rival)| rival.seed == picture.seed && rival.sampler == picture.sampler);
            rivals.max_by_key(|(at, rival)| (rival.samples, *at)).is_some_and(|(at, _)| at == index)
        };
        let chosen: Vec<&FinalPicture> = others()
            .enumerate()
            .filter(|(index, picture)| is_largest(*index, picture))
            .map(|p| p.1)
            .collect();
        let first = chosen.first()?;
        let by_samples = vec![1.0; chosen.len()];
        let (mean, variance) = pool(&chosen, &by_samples);
        let by_noise = quality(&chosen, &mean);
        let (mean, variance) = by_noise.map_or((mean, variance), |quality| pool(&chosen, &quality));
        let own_error = own_error(&mean, &variance);
        let pixels: Vec<[f32; 3]> = mean.iter().map(|colour| colour.map(|value| value as f32)).collect();
        let samples: u64 = chosen.iter().map(|picture| picture.samples).sum();
        let spp = samples as f64 / pixels.len() as f64;
        let Image { width, height, window, .. } = first.image;
        let image = Image { window, ..Image::new(width, height, pixels) };
        Some(Self { image, count: chosen.len(), spp, own_error })
    }

    /// Errors measured against this reference, as they would be against an independent one with the error `target`.
    pub fn translate(&self, errors: Errors, target: &OwnError) -> Errors {
        Errors {
            mse: errors.mse - self.own_error.mse + target.mse,
            relmse: errors.relmse - self.own_error.relmse + target.relmse,
            relmse_trimmed: errors.relmse_trimmed - self.own_error.relmse_trimmed + target.relmse_trimmed,
            ..errors
        }
    }
}

/// Means of the pixels, and their variance; each picture weighs as much as its samples, times its quality.
fn pool(pictures: &[&FinalPicture], quality: &[f64]) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let weights = || pictures.iter().zip(quality).map(|(picture, quality)| picture.samples as f64 * quality);
    let total: f64 = weights().sum();
    let mut mean = vec![[0.0_f64; 3]; pictures[0].image.pixels.len()];
    let mut variance = mean.clone();
    for (picture, weight) in pictures.iter().zip(weights()) {
        let weight = weight / total;
        for (index, (mean, variance)) in mean.iter_mut().zip(&mut variance).enumerate() {
            for channel in 0..3 {
                mean[channel] += weight * f64::from(picture.image.pixels[index][channel]);
                variance[channel] += weight * weight * f64::from(picture.variance[index][channel]);
            }
        }
    }
    (mean, variance)
}

/// For each picture, the inverse of what squared relative error one sample has, mean over all pictures of its sampler;
/// none if that is not known.
fn quality(pictures: &[&FinalPicture], mean: &[[f64; 3]]) -> Option<Vec<f64>> {
    let noise = |picture: &FinalPicture| -> f64 {
        let variance: Vec<[f64; 3]> = picture.variance.iter().map(|v| v.map(f64::from)).collect();
        own_error(mean, &variance).relmse * picture.samples as f64
    };
    let noise: Vec<f64> = pictures.iter().map(|picture| noise(picture)).collect();
    let quality = |of: &&FinalPicture| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (_, noise) in pictures.iter().zip(&noise).filter(|(picture, _)| picture.sampler == of.sampler) {
            sum += noise;
            count += 1.0;
        }
        let quality = count / sum;
        (quality.is_finite() && quality > 0.0).then_some(quality)
    };
    pictures.iter().map(quality).collect()
}

fn own_error(mean: &[[f64; 3]], variance: &[[f64; 3]]) -> OwnError {
    let values = (3 * mean.len()) as f64;
    let mse = variance.iter().flatten().sum::<f64>() / values;
    let pixel = |(mean, variance): (&[f64; 3], &[f64; 3])| {
        (0..3).map(|channel| variance[channel] / (mean[channel].powi(2) + EPSILON)).sum::<f64>()
    };
    let mut relative: Vec<f64> = mean.iter().zip(variance).map(pixel).collect();
    relative.sort_by(f64::total_cmp);
    // As in the measure itself: 1 pixel in 1000 is left out.
    let kept = &relative[..relative.len() - relative.len() / 1000];
    OwnError {
        mse,
        relmse: relative.iter().sum::<f64>() / values,
        relmse_trimmed: kept.iter().sum::<f64>() / (3 * kept.len()) as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::compare;
    use crate::converge::synthetic::Normal;

    const PIXELS: u32 = 4096;

    /// Grey 1 with noise.
    fn picture(normal: &mut Normal, seed: u64, sampler: &str, samples: u64) -> FinalPicture {
        let deviation = 0.1 * (1000.0 / samples as f64).sqrt();
        let pixels = (0..PIXELS).map(|_| [0; 3].map(|_| (1.0 + deviation * normal.draw()) as f32)).collect();
        FinalPicture {
            seed,
            sampler: sampler.into(),
            samples,
            image: Image::new(PIXELS, 1, pixels),
            variance: vec![[(deviation * deviation) as f32; 3]; PIXELS as usize],
        }
    }

    #[test]
    fn runs_that_share_random_numbers_count_once() {
        let mut normal = Normal::new(1);
        let pictures: Vec<_> = [(1, "a", 500), (1, "a", 1000), (1, "b", 1000), (2, "a", 2000)]
            .map(|(seed, sampler, samples)| picture(&mut normal, seed, sampler, samples))
            .into();
        let all = PooledReference::of(&pictures, &[]).unwrap();
        assert_eq!((all.count, all.spp), (3, 4000.0 / f64::from(PIXELS)));
        assert_eq!(PooledReference::of(&pictures, &[1]).unwrap().image, pictures[3].image);
        assert!(PooledReference::of(&pictures, &[1, 2]).is_none());
    }

    /// A sampler with a tenth of the noise is not spoiled by the other.
    #[test]
    fn noisy_samplers_weigh_less() {
        let mut normal = Normal::new(3);
        let mut pictures = Vec::new();
        for seed in 1..=4 {
            let mut noisy = picture(&mut normal, seed, "noisy", 100);
            noisy.samples = 1000;
            pictures.extend([noisy, picture(&mut normal, seed, "quiet", 1000)]);
        }
        let quiet: Vec<_> = (1..=4).map(|seed| picture(&mut normal, seed, "quiet", 1000)).collect();
        let [all, quiet] =
            [&pictures, &quiet].map(|some| PooledReference::of(some, &[]).unwrap().own_error.relmse);
        // Inverse variances add up: 4 of 1 and 4 of 1/10.
        assert!((all / quiet * 1.1 - 1.0).abs() < 0.05, "{all} {quiet}");
    }

    /// What is reported is the noise of the run and the own error of the mean of all.
    #[test]
    fn the_own_error_comes_out() {
        let mut normal = Normal::new(2);
        let pictures: Vec<_> = (1..=4).map(|seed| picture(&mut normal, seed, "a", 500 * seed)).collect();
        let all = PooledReference::of(&pictures, &[]).unwrap();
        let truth = Image::new(PIXELS, 1, vec![[1.0; 3]; PIXELS as usize]);
        let expected = compare(&all.image, &truth).unwrap().relmse;
        assert!((all.own_error.relmse / expected - 1.0).abs() < 0.1);
        for run in &pictures {
            let reference = PooledReference::of(&pictures, &[run.seed]).unwrap();
            let measured = Errors::from(&compare(&run.image, &reference.image).unwrap());
            let errors = reference.translate(measured, &all.own_error);
            let expected = compare(&run.image, &truth).unwrap().relmse;
            let found = errors.relmse - all.own_error.relmse;
            assert!((found / expected - 1.0).abs() < 0.1, "{found}, not {expected}");
        }
    }
}
