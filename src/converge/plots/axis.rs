//! Axes: from figures to places, and where the ticks are.

/// A logarithmic axis.
#[derive(Clone, Copy)]
pub struct LogAxis {
    /// Decimal logarithms of the ends.
    low: f64,
    high: f64,
    /// Places of the ends.
    from: f64,
    to: f64,
}

/// A tick of a logarithmic axis at `digit * 10^exponent`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    pub digit: u32,
    pub exponent: i32,
    pub labelled: bool,
}

impl Tick {
    pub fn value(self) -> f64 {
        f64::from(self.digit) * 10_f64.powi(self.exponent)
    }
}

impl LogAxis {
    /// An axis that shows all of the values that are positive and finite, with some room at both ends.
    pub fn around(values: impl IntoIterator<Item = f64>, (from, to): (f64, f64)) -> Self {
        let logarithms = values.into_iter().map(f64::log10).filter(|value| value.is_finite());
        let ends = logarithms.fold(None, |ends: Option<(f64, f64)>, value| {
            Some(ends.map_or((value, value), |(low, high)| (low.min(value), high.max(value))))
        });
        let (low, high) = ends.unwrap_or((-1.0, 1.0));
        // At least a factor of two on each side of a single value.
        let room = (0.035 * (high - low)).max(0.5 * (0.6 - (high - low)));
        Self { low: low - room, high: high + room, from, to }
    }

    /// The place of a value.
    pub fn place(&self, value: f64) -> f64 {
        self.from + (self.to - self.from) * (value.log10() - self.low) / (self.high - self.low)
    }

    /// The values at the ends.
    pub fn ends(&self) -> (f64, f64) {
        (10_f64.powf(self.low), 10_f64.powf(self.high))
    }

    /// Whether it shows this value.
    pub fn shows(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value.log10())
    }

    /// Ticks from the lower end to the upper one, few enough for their labels.
    pub fn ticks(&self) -> Vec<Tick> {
        let decades = self.high - self.low;
        let step = ((decades / 8.0).ceil() as i32).max(1);
        let labelled: &[u32] = match decades {
            d if d < 0.9 => &[1, 2, 3, 4, 5, 6, 7, 8, 9],
            d if d < 2.6 => &[1, 2, 5],
            _ => &[1],
        };
        let shown: &[u32] = if decades < 6.0 { &[1, 2, 3, 4, 5, 6, 7, 8, 9] } else { &[1] };
        let exponents = self.low.floor() as i32..=self.high.ceil() as i32;
        let ticks = exponents.flat_map(|exponent| {
            shown.iter().map(move |&digit| {
                let labelled = labelled.contains(&digit) && exponent.rem_euclid(step) == 0;
                Tick { digit, exponent, labelled }
            })
        });
        ticks.filter(|tick| self.shows(tick.value())).collect()
    }
}

/// Ticks of a linear axis from 0 to at least `most`: about four steps of 1, 2 or 5 times a power of ten.
pub fn linear_ticks(most: f64) -> Vec<f64> {
    if !most.is_finite() || most <= 0.0 {
        return vec![0.0, 1.0];
    }
    let raw = most / 5.0;
    let power = 10_f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power).into_iter().find(|step| *step >= raw);
    let step = step.unwrap_or(10.0 * power);
    let steps = (most / step).ceil() as u32;
    (0..=steps).map(|index| f64::from(index) * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: LogAxis) -> Vec<(u32, i32)> {
        let ticks = axis.ticks().into_iter().filter(|tick| tick.labelled);
        ticks.map(|tick| (tick.digit, tick.exponent)).collect()
    }

    #[test]
    fn few_labels_on_every_range() {
        let axis = |low, high| LogAxis::around([low, high], (0.0, 100.0));
        assert_eq!(labels(axis(0.1, 1000.0)), [(1, -1), (1, 0), (1, 1), (1, 2), (1, 3)]);
        assert_eq!(labels(axis(1.0, 30.0)), [(1, 0), (2, 0), (5, 0), (1, 1), (2, 1)]);
        assert_eq!(labels(axis(1.0, 1.0)), [(6, -1), (7, -1), (8, -1), (9, -1), (1, 0)]);
        assert!(labels(axis(1e-300, 1e300)).len() <= 9);
        for (low, high) in [(1.0, 1.5), (2.0, 30.0), (1e-9, 1e3), (5.0, 5.0)] {
            let labels = labels(axis(low, high)).len();
            assert!((2..=10).contains(&labels), "{low} {high}: {labels}");
        }
    }

    #[test]
    fn places_are_even_in_the_logarithm() {
        let axis = LogAxis::around([1.0, f64::NAN, 0.0, 100.0], (0.0, 200.0));
        assert!((axis.place(10.0) - 100.0).abs() < 1e-9);
        assert!(axis.place(1.0) > 0.0 && axis.shows(1.0) && !axis.shows(1000.0));
        let empty = LogAxis::around([], (0.0, 1.0));
        assert!(empty.shows(1.0));
    }

    #[test]
    fn linear_ticks_reach_the_largest_value() {
        assert_eq!(linear_ticks(100.0), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(linear_ticks(7.0), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(linear_ticks(0.0), [0.0, 1.0]);
        assert!(linear_ticks(3e-7).last().unwrap() >= &3e-7);
    }
}
