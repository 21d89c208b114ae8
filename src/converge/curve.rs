//! The error of one run as a function of time.
//!
//! Between checkpoints a curve is a straight line in log-log coordinates. Outside, it goes on from the nearer end with
//! the slope of the line fitted through all the points; what is read off there is marked as extrapolated.

use serde::Serialize;

use super::statistics::{Estimate, least_squares_slope};
use super::{Measure, Reference, Run};

/// A point whose measured error is less than this many times the reference's own is not used: what would be left after
/// the subtraction is mostly the reference's noise.
pub const REFERENCE_LIMIT: f64 = 1.5;

/// A figure that was read off one or more curves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reading {
    /// The figure.
    #[serde(flatten)]
    pub estimate: Estimate,
    /// Whether a curve had to be continued beyond what was measured.
    pub extrapolated: bool,
}

/// Error against time; both positive.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Logarithms of seconds, strictly growing, and of the error.
    points: Vec<(f64, f64)>,
    /// Of the fitted line, if there is more than one point.
    slope: Option<f64>,
}

impl Curve {
    /// The curve of a run: its errors less the reference's own. Points below the [`REFERENCE_LIMIT`] and those without
    /// a positive time or error are left out; `None` if no point is left.
    pub fn of(run: &Run, measure: Measure, reference: &Reference) -> Option<Self> {
        let own = measure.own(reference);
        let error = |measured: f64| if measured < REFERENCE_LIMIT * own { f64::NAN } else { measured - own };
        let points = run.points.iter().map(|point| (point.seconds, error(measure.of(&point.errors))));
        Self::through(points)
    }

    /// The curve through points of seconds and errors.
    pub fn through(points: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let mut logarithms: Vec<(f64, f64)> = Vec::new();
        for (seconds, error) in points {
            let point = (seconds.ln(), error.ln());
            let later = logarithms.last().is_none_or(|last| point.0 > last.0);
            if point.0.is_finite() && point.1.is_finite() && later {
                logarithms.push(point);
            }
        }
        let slope = least_squares_slope(&logarithms);
        (!logarithms.is_empty()).then_some(Self { points: logarithms, slope })
    }

    /// Slope of the line fitted through the logarithms: -1 for plain Monte Carlo. `None` for a single point.
    pub fn slope(&self) -> Option<f64> {
        self.slope
    }

    /// Points that it goes through.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Never: a curve has a point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Seconds and error of the first point.
    pub fn first(&self) -> (f64, f64) {
        exp(self.points[0])
    }

    /// Seconds and error of the last point.
    pub fn last(&self) -> (f64, f64) {
        exp(self.points[self.points.len() - 1])
    }

    /// The error after `seconds`, and whether that is extrapolated. `None` beyond a single point.
    pub fn error_at(&self, seconds: f64) -> Option<(f64, bool)> {
        let x = seconds.ln();
        let (first, last) = (self.points[0], self.points[self.points.len() - 1]);
        if let Some(end) = self.end_near(x < first.0 - ROUNDING, x > last.0 + ROUNDING) {
            return Some(((end.1 + self.slope? * (x - end.0)).exp(), true));
        }
        let next = self.points.partition_point(|point| point.0 < x).min(self.points.len() - 1);
        let (a, b) = (self.points[next.saturating_sub(1)], self.points[next]);
        let y = if b.0 > a.0 { a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0) } else { b.1 };
        Some((y.exp(), false))
    }

    /// The time from which on the error stays below `error`, and whether that is extrapolated. `None` if the curve
    /// does not fall and would have to be continued, or has a single point.
    pub fn seconds_to(&self, error: f64) -> Option<(f64, bool)> {
        let y = error.ln();
        // The last segment that comes down through the error.
        let above = self.points.iter().rposition(|point| point.1 > y + ROUNDING);
        let last = self.points.len() - 1;
        let starts_below = above.is_none() && self.points[0].1 < y - ROUNDING;
        if let Some(end) = self.end_near(starts_below, above == Some(last)) {
            let slope = self.slope.filter(|slope| *slope < 0.0)?;
            return Some(((end.0 + (y - end.1) / slope).exp(), true));
        }
        let Some(above) = above else { return Some((self.first().0, false)) };
        let (a, b) = (self.points[above], self.points[above + 1]);
        Some(((a.0 + (b.0 - a.0) * (y - a.1) / (b.1 - a.1)).exp(), false))
    }

    fn end_near(&self, before: bool, behind: bool) -> Option<(f64, f64)> {
        if before {
            self.points.first().copied()
        } else if behind {
            self.points.last().copied()
        } else {
            None
        }
    }
}

/// Logarithms that differ by less are the same: an end of a curve, put through `exp` and `ln`, is still on the curve.
const ROUNDING: f64 = 1e-9;

fn exp((x, y): (f64, f64)) -> (f64, f64) {
    (x.exp(), y.exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::{Errors, OwnError, Point, ReferenceKind};

    fn close(value: Option<(f64, bool)>, expected: (f64, bool)) {
        let value = value.unwrap();
        assert!((value.0 / expected.0 - 1.0).abs() < 1e-9 && value.1 == expected.1, "{value:?} {expected:?}");
    }

    #[test]
    fn reads_between_points_and_marks_what_is_beyond() {
        let curve = Curve::through([(1.0, 1.0), (4.0, 0.25), (16.0, 0.0625)]).unwrap();
        assert!((curve.slope().unwrap() + 1.0).abs() < 1e-12);
        close(curve.error_at(2.0), (0.5, false));
        close(curve.error_at(1.0), (1.0, false));
        close(curve.error_at(16.0), (0.0625, false));
        close(curve.error_at(32.0), (0.03125, true));
        close(curve.error_at(0.5), (2.0, true));
        close(curve.seconds_to(0.125), (8.0, false));
        close(curve.seconds_to(1.0), (1.0, false));
        close(curve.seconds_to(0.0625), (16.0, false));
        close(curve.seconds_to(0.01), (100.0, true));
        close(curve.seconds_to(10.0), (0.1, true));
    }

    #[test]
    fn a_curve_that_comes_back_up_counts_from_its_last_way_down() {
        let curve = Curve::through([(1.0, 1.0), (2.0, 0.1), (4.0, 1.0), (8.0, 0.1)]).unwrap();
        let (seconds, extrapolated) = curve.seconds_to(0.5).unwrap();
        assert!(seconds > 4.0 && seconds < 8.0 && !extrapolated);
    }

    #[test]
    fn no_fit_no_extrapolation() {
        let single = Curve::through([(2.0, 0.5)]).unwrap();
        close(single.error_at(2.0), (0.5, false));
        close(single.seconds_to(0.5), (2.0, false));
        assert_eq!((single.error_at(3.0), single.seconds_to(0.1), single.slope()), (None, None, None));
        let rising = Curve::through([(1.0, 0.5), (2.0, 0.6)]).unwrap();
        assert_eq!(rising.seconds_to(0.1), None);
        assert_eq!(Curve::through([(0.0, 1.0), (1.0, 0.0), (f64::NAN, 1.0)]), None);
        assert_eq!(Curve::through([(1.0, 1.0), (1.0, 0.5)]).unwrap().len(), 1);
    }

    #[test]
    fn the_references_own_error_is_subtracted_down_to_its_limit() {
        let point = |seconds: f64, relmse| Point {
            seconds,
            spp: 1.0,
            samples: 1,
            errors: Errors { mse: relmse, relmse, relmse_trimmed: relmse, mean_ratio: [1.0; 3] },
            estimated_relmse: None,
            stage_seconds: vec![],
            invalid_samples: 0,
        };
        let own = 0.01;
        let errors = [1.0, 0.25, 0.0625, 0.004];
        let points = (0..4).map(|i| point(f64::from(4_u32.pow(i)), errors[i as usize] + own)).collect();
        let run = Run { seed: 1, setup_seconds: 0.0, points };
        let kind = ReferenceKind::Replicates { count: 8 };
        let own_error = Some(OwnError { mse: own, relmse: own, relmse_trimmed: own });
        let reference = Reference { kind, spp: None, own_error };
        let curve = Curve::of(&run, Measure::Relmse, &reference).unwrap();
        assert_eq!(curve.len(), 3);
        assert!((curve.slope().unwrap() + 1.0).abs() < 1e-9);
    }
}
