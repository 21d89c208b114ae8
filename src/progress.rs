//! The progress bar of a render, on the terminal behind the standard error stream.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::report::count;

/// Steps of the bar: it shows a fraction, because a render may end by samples or by time.
const STEPS: u64 = 1000;

/// A progress bar, to be updated about ten times a second from the main thread.
///
/// Nothing is shown with `quiet` or where standard error is no terminal. The bar vanishes when it
/// is finished or dropped.
pub struct Progress {
    bar: ProgressBar,
    goal: Goal,
    start: Instant,
}

impl Progress {
    /// Starts the clock. The render ends at `total_samples`, at `time_limit` or at an estimated relMSE of `error`,
    /// whichever is first; with none of them, the bar shows no fraction.
    pub fn new(
        total_samples: Option<u64>,
        time_limit: Option<Duration>,
        error: Option<f64>,
        quiet: bool,
    ) -> Self {
        let visible = !quiet && io::stderr().is_terminal();
        let target =
            if visible { ProgressDrawTarget::stderr_with_hz(10) } else { ProgressDrawTarget::hidden() };
        let goal = Goal { total_samples, time_limit, error };
        let bounded = total_samples.is_some() || time_limit.is_some() || error.is_some();
        let template = if bounded { "[{bar:30}] {msg}" } else { "{spinner} {msg}" };
        let style = ProgressStyle::with_template(template).expect("the template is valid");
        let bar = ProgressBar::with_draw_target(bounded.then_some(STEPS), target);
        bar.set_style(style.progress_chars("=> "));
        Self { bar, goal, start: Instant::now() }
    }

    /// Whether anyone sees it.
    pub fn is_visible(&self) -> bool {
        !self.bar.is_hidden()
    }

    /// Shows the state: samples and rays so far, and the estimated relMSE if it is known.
    pub fn update(&self, samples: u64, rays: u64, error: Option<f64>) {
        if self.bar.is_hidden() {
            return;
        }
        let elapsed = self.start.elapsed();
        let fraction = self.goal.fraction(samples, elapsed, error);
        self.bar.set_message(message(&self.goal, samples, rays, error, elapsed));
        match fraction {
            Some(fraction) => self.bar.set_position((fraction * STEPS as f64) as u64),
            None => self.bar.tick(),
        }
    }

    /// Removes the bar.
    pub fn finish(self) {}
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// What ends a render.
struct Goal {
    total_samples: Option<u64>,
    time_limit: Option<Duration>,
    error: Option<f64>,
}

impl Goal {
    /// Share of the samples that are needed for the error, as far as it is known: it falls as their inverse.
    fn by_error(&self, error: Option<f64>) -> Option<f64> {
        self.error.map(|goal| error.map_or(0.0, |error| if error > goal { goal / error } else { 1.0 }))
    }

    /// Share of the work that is done, from 0 to 1, if an end is known.
    fn fraction(&self, samples: u64, elapsed: Duration, error: Option<f64>) -> Option<f64> {
        let by_samples = self.total_samples.map(|total| samples as f64 / total.max(1) as f64);
        let by_time = self.time_limit.map(|limit| elapsed.as_secs_f64() / limit.as_secs_f64());
        let further = [by_samples, by_time, self.by_error(error)].into_iter().flatten().reduce(f64::max);
        further.map(|share| share.clamp(0.0, 1.0))
    }

    /// Time to the end at the present speed, once it can be guessed.
    fn time_left(&self, samples: u64, elapsed: Duration, error: Option<f64>) -> Option<Duration> {
        let by_samples = self.total_samples.filter(|_| samples > 0).and_then(|total| {
            let missing = total.saturating_sub(samples) as f64 / samples as f64;
            Duration::try_from_secs_f64(elapsed.as_secs_f64() * missing).ok()
        });
        let by_time = self.time_limit.map(|limit| limit.saturating_sub(elapsed));
        let by_error = self.by_error(error).filter(|share| *share > 0.0).and_then(|share| {
            Duration::try_from_secs_f64(elapsed.as_secs_f64() * (share.recip() - 1.0)).ok()
        });
        [by_samples, by_time, by_error].into_iter().flatten().min()
    }
}

fn message(goal: &Goal, samples: u64, rays: u64, error: Option<f64>, elapsed: Duration) -> String {
    let mut parts = Vec::new();
    if let Some(fraction) = goal.fraction(samples, elapsed, error) {
        parts.push(format!("{:.0} %", 100.0 * fraction));
    }
    parts.push(format!("{} samples", count(samples)));
    let seconds = elapsed.as_secs_f64();
    if seconds > 0.0 {
        parts.push(format!("{:.2} Mrays/s", rays as f64 / seconds / 1e6));
    }
    if let Some(error) = error {
        parts.push(format!("relMSE {error:.2e}"));
    }
    if let Some(left) = goal.time_left(samples, elapsed, error) {
        parts.push(format!("{} left", clock(left)));
    }
    parts.join(", ")
}

/// `12s`, `3m05s` or `2h07m`.
fn clock(time: Duration) -> String {
    let seconds = time.as_secs_f64().ceil() as u64;
    match seconds {
        0..60 => format!("{seconds}s"),
        60..3600 => format!("{}m{:02}s", seconds / 60, seconds % 60),
        _ => format!("{}h{:02}m", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn the_nearer_end_counts() {
        let goal = Goal { total_samples: Some(1000), time_limit: Some(10 * SECOND), error: None };
        assert_eq!(goal.fraction(200, 5 * SECOND, None), Some(0.5));
        assert_eq!(goal.time_left(200, 5 * SECOND, None), Some(5 * SECOND));
        assert_eq!(goal.fraction(800, 4 * SECOND, None), Some(0.8));
        assert_eq!(goal.time_left(800, 4 * SECOND, None), Some(SECOND));
        assert_eq!(goal.fraction(2000, 20 * SECOND, None), Some(1.0));
        assert_eq!(goal.time_left(2000, 20 * SECOND, None), Some(Duration::ZERO));
    }

    #[test]
    fn an_error_is_reached_as_the_inverse_of_the_samples() {
        let goal = Goal { total_samples: None, time_limit: None, error: Some(0.01) };
        assert_eq!(goal.fraction(5, SECOND, None), Some(0.0));
        assert_eq!(goal.time_left(5, SECOND, None), None);
        assert_eq!(goal.fraction(5, SECOND, Some(0.04)), Some(0.25));
        assert_eq!(goal.time_left(5, SECOND, Some(0.04)), Some(3 * SECOND));
        assert_eq!(goal.fraction(5, SECOND, Some(0.001)), Some(1.0));
    }

    #[test]
    fn without_an_end_nothing_is_promised() {
        let goal = Goal { total_samples: None, time_limit: None, error: None };
        assert_eq!(goal.fraction(5, SECOND, None), None);
        assert_eq!(goal.time_left(5, SECOND, None), None);
        let text = message(&goal, 2_000_000, 30_000_000, Some(0.0125), 3 * SECOND);
        assert_eq!(text, "2.00 M samples, 10.00 Mrays/s, relMSE 1.25e-2");
    }

    #[test]
    fn nothing_is_guessed_before_the_first_sample() {
        let goal = Goal { total_samples: Some(100), time_limit: None, error: None };
        assert_eq!(message(&goal, 0, 0, None, Duration::ZERO), "0 %, 0 samples");
    }

    #[test]
    fn times_are_short() {
        let shown = [0, 59, 185, 7620].map(|seconds| clock(Duration::from_secs(seconds)));
        assert_eq!(shown, ["0s", "59s", "3m05s", "2h07m"]);
    }

    #[test]
    fn a_quiet_bar_takes_updates() {
        let progress = Progress::new(Some(10), Some(SECOND), None, true);
        progress.update(5, 10, Some(0.1));
        progress.finish();
    }
}
