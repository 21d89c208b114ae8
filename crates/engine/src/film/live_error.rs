//! The estimated error of a film that is being filled, for a share of the time.

use super::{ErrorSum, Film};
use std::time::{Duration, Instant};

/// Looks at blocks of a film, one after another and far apart, as many as the time allows; blocks that were seen with
/// fewer samples count as if their error had fallen as the inverse of the samples since.
#[derive(Debug)]
pub struct LiveError<'a> {
    film: &'a Film,
    /// Time that looking may take, for each second that passes.
    share: f64,
    seen: Vec<Option<(ErrorSum, u64)>>,
    /// Blocks looked at so far.
    looks: u64,
    /// How far the next block is: about 0.618 of all, without common divisor.
    stride: u64,
    started: Instant,
    spent: Duration,
}

impl<'a> LiveError<'a> {
    /// Share of the time of all threads.
    pub const SHARE: f64 = 0.004;

    /// Starts the clock. `threads` are rendering.
    pub fn new(film: &'a Film, threads: usize) -> Self {
        let blocks = film.blocks.len() as u64;
        let divides = |mut a: u64, mut b: u64| {
            while b != 0 {
                (a, b) = (b, a % b);
            }
            a
        };
        let golden = (blocks as f64 * 0.618) as u64;
        let stride = (golden.max(1)..).find(|&stride| divides(stride, blocks) == 1).unwrap_or(1);
        LiveError {
            film,
            share: Self::SHARE * threads as f64,
            seen: vec![None; blocks as usize],
            looks: 0,
            stride,
            started: Instant::now(),
            spent: Duration::ZERO,
        }
    }

    /// The estimated relMSE; none before any block has two replicates.
    pub fn update(&mut self) -> Option<f64> {
        let elapsed = self.started.elapsed();
        let now = Instant::now();
        let blocks = self.seen.len() as u64;
        // At most every block once a second.
        let looks = (blocks as f64 * elapsed.as_secs_f64()) as u64;
        let allowed = elapsed.mul_f64(self.share);
        while self.looks < looks && self.spent + now.elapsed() < allowed {
            let block = (self.looks % blocks * self.stride % blocks) as usize;
            self.seen[block] = Some(self.film.error_of_block(block));
            self.looks += 1;
        }
        // What was not used is not saved up for a long look later.
        self.looks = self.looks.max(looks.saturating_sub(blocks));
        let estimate = self.estimate();
        self.spent += now.elapsed();
        estimate
    }

    /// Time spent looking.
    pub fn spent(&self) -> Duration {
        self.spent
    }

    fn estimate(&self) -> Option<f64> {
        let (mut sum, mut pixels) = (0.0, 0);
        for (block, seen) in self.seen.iter().enumerate() {
            let Some((error, samples)) = seen else { continue };
            let now = self.film.samples(block).max(1);
            sum += error.sum * *samples as f64 / f64::from(now);
            pixels += error.pixels;
        }
        (pixels > 0).then(|| sum / pixels as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::tests::{film, unit};

    /// Every block is seen, and the estimate is that of the film.
    #[test]
    fn it_comes_to_the_estimate_of_the_film() {
        let film = film(80, 48);
        for block in 0..film.blocks.len() {
            for replicate in 0..2 {
                let mut sums = film.sums();
                for pixel in 0..256 {
                    let value = 1.0 + replicate as f32 * 0.01 * block as f32;
                    sums.add(pixel, [value; 3], None);
                }
                film.add(unit(block, replicate, 0..1), &sums).unwrap();
            }
        }
        let mut live = LiveError { share: 1.0, ..LiveError::new(&film, 2) };
        assert_eq!(live.stride, 11);
        live.started -= Duration::from_secs(1);
        let estimate = live.update().unwrap();
        let expected = film.error().unwrap().relmse;
        assert!((estimate / expected - 1.0).abs() < 1e-12, "{estimate}, not {expected}");
        assert!(live.seen.iter().all(Option::is_some));
    }
}
