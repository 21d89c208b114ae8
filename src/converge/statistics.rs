//! Means, intervals and straight lines.
//!
//! All intervals are of 95 % confidence and rest on the spread between seeds alone, by Student's t distribution: the
//! checkpoints of one seed share their samples, so that they are no independent observations. Quantities that are
//! positive and act as factors (errors, times, ratios) are averaged as logarithms: their mean is the geometric one and
//! their interval is never negative.

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// How often an interval covers the truth.
pub const CONFIDENCE: f64 = 0.95;

/// A figure and how far it can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The figure.
    pub value: f64,
    /// Ends of its 95 % interval; `None` if there are too few observations for one.
    pub interval: Option<[f64; 2]>,
}

impl Estimate {
    /// A figure without an interval.
    pub fn bare(value: f64) -> Self {
        Self { value, interval: None }
    }

    /// `value` with the interval of `value +- t * standard_error` for `degrees` degrees of freedom.
    pub fn from_standard_error(value: f64, standard_error: f64, degrees: usize) -> Self {
        let half = student_t(degrees) * standard_error;
        Self { value, interval: Some([value - half, value + half]) }
    }

    /// The figure and its interval put through a function that grows everywhere.
    pub fn map(self, growing: impl Fn(f64) -> f64) -> Self {
        Self { value: growing(self.value), interval: self.interval.map(|ends| ends.map(&growing)) }
    }

    /// One over the figure: the interval's ends change places.
    pub fn recip(self) -> Self {
        Self {
            value: self.value.recip(),
            interval: self.interval.map(|[low, high]| [high.recip(), low.recip()]),
        }
    }

    /// Half the width of the interval.
    pub fn half_width(&self) -> Option<f64> {
        self.interval.map(|[low, high]| (high - low) / 2.0)
    }

    /// Whether the interval lies on one side of `value`: a difference that is more than chance.
    pub fn excludes(&self, value: f64) -> bool {
        self.interval.is_some_and(|[low, high]| value < low || value > high)
    }
}

/// Student's t: half the width of a 95 % interval in standard errors, for at least one degree of freedom.
fn student_t(degrees: usize) -> f64 {
    let degrees = degrees.max(1) as f64;
    let distribution = StudentsT::new(0.0, 1.0, degrees).expect("one degree of freedom or more");
    distribution.inverse_cdf(0.5 + CONFIDENCE / 2.0)
}

/// Arithmetic mean; `None` without observations or if one is not finite. The interval needs two.
pub fn mean(observations: &[f64]) -> Option<Estimate> {
    let count = observations.len();
    if count == 0 || observations.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let mean = observations.iter().sum::<f64>() / count as f64;
    if count == 1 {
        return Some(Estimate::bare(mean));
    }
    let squares: f64 = observations.iter().map(|value| (value - mean).powi(2)).sum();
    let variance = squares / (count - 1) as f64;
    Some(Estimate::from_standard_error(mean, (variance / count as f64).sqrt(), count - 1))
}

/// Geometric mean, the interval taken in the logarithm; `None` without observations or if one is not positive and
/// finite.
pub fn geometric_mean(observations: &[f64]) -> Option<Estimate> {
    let logarithms: Vec<f64> = observations.iter().map(|value| value.ln()).collect();
    mean(&logarithms).map(|estimate| estimate.map(f64::exp))
}

/// Slope of the straight line through `(x, y)` by ordinary least squares; `None` unless two `x` differ.
pub fn least_squares_slope(points: &[(f64, f64)]) -> Option<f64> {
    let count = points.len() as f64;
    let mean_x = points.iter().map(|point| point.0).sum::<f64>() / count;
    let mean_y = points.iter().map(|point| point.1).sum::<f64>() / count;
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in points {
        xx += (x - mean_x) * (x - mean_x);
        xy += (x - mean_x) * (y - mean_y);
    }
    let slope = xy / xx;
    slope.is_finite().then_some(slope)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::synthetic::{Normal, covers_as_promised};

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // The usual printed table, column 97.5 %.
        for (degrees, expected) in [
            (1, 12.706),
            (2, 4.303),
            (3, 3.182),
            (4, 2.776),
            (7, 2.365),
            (9, 2.262),
            (15, 2.131),
            (30, 2.042),
            (120, 1.980),
        ] {
            assert!((student_t(degrees) - expected).abs() < 6e-4, "{degrees}: {}", student_t(degrees));
        }
    }

    #[test]
    fn means_by_hand() {
        let estimate = mean(&[1.0, 2.0, 3.0]).unwrap();
        let half = 4.302_652_7 * (1.0_f64 / 3.0).sqrt();
        assert!((estimate.value - 2.0).abs() < 1e-12);
        assert!((estimate.half_width().unwrap() - half).abs() < 1e-6);
        let estimate = geometric_mean(&[1.0, 4.0]).unwrap();
        let [low, high] = estimate.interval.unwrap();
        assert!((estimate.value - 2.0).abs() < 1e-12 && (low * high - 4.0).abs() < 1e-9 && low > 0.0);
        assert!(estimate.excludes(1e9) && !estimate.excludes(1.0));
    }

    #[test]
    fn what_cannot_be_averaged_is_none() {
        assert_eq!(mean(&[]), None);
        assert_eq!(mean(&[1.0, f64::NAN]), None);
        assert_eq!(geometric_mean(&[1.0, 0.0]), None);
        assert_eq!(geometric_mean(&[1.0, -1.0]), None);
        assert_eq!(mean(&[3.0]), Some(Estimate::bare(3.0)));
        assert!(!Estimate::bare(3.0).excludes(7.0));
    }

    #[test]
    fn reciprocals_turn_the_interval_round() {
        let estimate = Estimate { value: 2.0, interval: Some([1.0, 4.0]) }.recip();
        assert_eq!(estimate, Estimate { value: 0.5, interval: Some([0.25, 1.0]) });
    }

    #[test]
    fn slopes_by_hand() {
        assert_eq!(least_squares_slope(&[(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]), Some(2.0));
        assert_eq!(least_squares_slope(&[(0.0, 0.0), (1.0, 0.0), (2.0, 3.0)]), Some(1.5));
        assert_eq!(least_squares_slope(&[(1.0, 1.0), (1.0, 2.0)]), None);
        assert_eq!(least_squares_slope(&[]), None);
    }

    #[test]
    fn intervals_of_means_cover_as_promised() {
        let mut normal = Normal::new(1);
        covers_as_promised(3.0, || mean(&[0; 4].map(|_| 3.0 + 2.0 * normal.draw())).unwrap());
        covers_as_promised(5.0, || {
            geometric_mean(&[0; 5].map(|_| 5.0 * (0.8 * normal.draw()).exp())).unwrap()
        });
    }
}
