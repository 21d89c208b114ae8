//! How far a render is, on the standard error stream.

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::report::count;
use crate::time_span::clock;

/// Steps of the bar: it shows a fraction, because a render may end by samples or by time.
const STEPS: u64 = 1000;

/// Time between two lines of JSON.
const SECOND: Duration = Duration::from_secs(1);

/// Where there is no terminal: time between two lines.
const MINUTE: Duration = Duration::from_secs(60);

/// A progress display, to be updated about ten times a second from the main thread.
///
/// On a terminal it is a bar, which vanishes when it is finished or dropped and never takes more than a line. Elsewhere
/// (a file, a pipe, `TERM=dumb`) it is a line at the start, one a minute, and one at the end. Nothing is shown with
/// `quiet`.
pub struct Progress {
    display: Display,
    goal: Goal,
    start: Instant,
}

enum Display {
    Hidden,
    Bar(ProgressBar),
    /// Time of the next line, since the start.
    Lines(Duration),
    /// The same of JSON.
    Json(Duration),
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
        let goal = Goal { total_samples, time_limit, error, samples_before: 0 };
        let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        let display = if quiet {
            Display::Hidden
        } else if is_dumb || !io::stderr().is_terminal() {
            tell(&format!("rendering: {goal}"));
            Display::Lines(MINUTE)
        } else {
            let bounded = total_samples.is_some() || time_limit.is_some() || error.is_some();
            // The message is cut where the terminal ends.
            let template = if bounded { "{bar:12} {wide_msg}" } else { "{spinner} {wide_msg}" };
            let style = ProgressStyle::with_template(template).expect("the template is valid");
            let target = ProgressDrawTarget::stderr_with_hz(10);
            let bar = ProgressBar::with_draw_target(bounded.then_some(STEPS), target);
            bar.set_style(style.progress_chars("=> "));
            Display::Bar(bar)
        };
        Self { display, goal, start: Instant::now() }
    }

    /// As [`Progress::new`], as a line of JSON a second.
    pub fn json(total_samples: Option<u64>, time_limit: Option<Duration>, error: Option<f64>) -> Self {
        let goal = Goal { total_samples, time_limit, error, samples_before: 0 };
        Self { display: Display::Json(Duration::ZERO), goal, start: Instant::now() }
    }

    /// So many of the samples were there when the clock started.
    pub fn begin_at(&mut self, samples: u64) {
        self.goal.samples_before = samples;
    }

    /// Whether the estimated error would be shown if it were known now.
    pub fn is_visible(&self) -> bool {
        match &self.display {
            Display::Hidden => false,
            Display::Bar(bar) => !bar.is_hidden(),
            // Somewhat earlier: the first look at the error sees a part of the film only.
            Display::Lines(next) => self.start.elapsed() + MINUTE / 6 >= *next,
            Display::Json(_) => true,
        }
    }

    /// Shows the state: samples and rays so far, and the estimated relMSE if it is known.
    pub fn update(&mut self, samples: u64, rays: u64, error: Option<f64>) {
        let elapsed = self.start.elapsed();
        match &mut self.display {
            Display::Bar(bar) if !bar.is_hidden() => {
                bar.set_message(message(&self.goal, samples, rays, error, elapsed));
                match self.goal.fraction(samples, elapsed, error) {
                    Some(fraction) => bar.set_position((fraction * STEPS as f64) as u64),
                    None => bar.tick(),
                }
            }
            Display::Lines(next) if elapsed >= *next => {
                *next = elapsed + MINUTE;
                let state = message(&self.goal, samples, rays, error, elapsed);
                tell(&format!("{}: {state}", clock(elapsed)));
            }
            Display::Json(next) if elapsed >= *next => {
                *next = elapsed + SECOND;
                tell(&json_line(&self.goal, samples, rays, error, elapsed));
            }
            _ => {}
        }
    }

    /// Removes the bar, or says that the render is over.
    pub fn finish(self) {
        if let Display::Lines(_) = self.display {
            tell(&format!("rendered in {}", clock(self.start.elapsed())));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Display::Bar(bar) = &self.display {
            bar.finish_and_clear();
        }
    }
}

/// A line on standard error. One that cannot be written costs nothing.
fn tell(line: &str) {
    let _ = io::stderr().lock().write_all(format!("{line}\n").as_bytes());
}

/// What ends a render; shows as that.
struct Goal {
    total_samples: Option<u64>,
    time_limit: Option<Duration>,
    error: Option<f64>,
    /// Samples that were there before the clock started.
    samples_before: u64,
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let samples = self.total_samples.map(|total| format!("{} samples", count(total)));
        let time = self.time_limit.map(clock);
        let error = self.error.map(|error| format!("a relMSE of {error:.2e}"));
        let ends: Vec<String> = [samples, time, error].into_iter().flatten().collect();
        if ends.is_empty() {
            f.write_str("until it is interrupted")
        } else {
            f.write_str(&ends.join(", or "))
        }
    }
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
        let taken = samples.saturating_sub(self.samples_before);
        let by_samples = self.total_samples.filter(|_| taken > 0).and_then(|total| {
            let missing = total.saturating_sub(samples) as f64 / taken as f64;
            Duration::try_from_secs_f64(elapsed.as_secs_f64() * missing).ok()
        });
        let by_time = self.time_limit.map(|limit| limit.saturating_sub(elapsed));
        let by_error = self.by_error(error).filter(|share| *share > 0.0).and_then(|share| {
            Duration::try_from_secs_f64(elapsed.as_secs_f64() * (share.recip() - 1.0)).ok()
        });
        [by_samples, by_time, by_error].into_iter().flatten().min()
    }
}

/// A state for programs. A figure that is unknown is `null`.
fn json_line(goal: &Goal, samples: u64, rays: u64, error: Option<f64>, elapsed: Duration) -> String {
    let seconds = elapsed.as_secs_f64();
    let rate = |count: u64| (seconds > 0.0).then_some(count as f64 / seconds);
    serde_json::json!({
        "seconds": seconds,
        "samples": samples,
        "total_samples": goal.total_samples,
        "fraction": goal.fraction(samples, elapsed, error),
        "seconds_left": goal.time_left(samples, elapsed, error).map(|left| left.as_secs_f64()),
        "estimated_relmse": error,
        "samples_per_second": rate(samples.saturating_sub(goal.samples_before)),
        "rays_per_second": rate(rays),
    })
    .to_string()
}

/// What matters most comes first: a narrow terminal shows the beginning.
fn message(goal: &Goal, samples: u64, rays: u64, error: Option<f64>, elapsed: Duration) -> String {
    let mut parts = Vec::new();
    if let Some(fraction) = goal.fraction(samples, elapsed, error) {
        parts.push(format!("{:.0} %", 100.0 * fraction));
    }
    if let Some(left) = goal.time_left(samples, elapsed, error) {
        parts.push(format!("{} left", clock(left)));
    }
    if let Some(error) = error {
        parts.push(format!("relMSE {error:.2e}"));
    }
    let seconds = elapsed.as_secs_f64();
    if seconds > 0.0 {
        parts.push(format!("{:.2} Mrays/s", rays as f64 / seconds / 1e6));
    }
    parts.push(format!("{} samples", count(samples)));
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearer_end_counts() {
        let goal =
            Goal { total_samples: Some(1000), time_limit: Some(10 * SECOND), error: None, samples_before: 0 };
        assert_eq!(goal.fraction(200, 5 * SECOND, None), Some(0.5));
        assert_eq!(goal.time_left(200, 5 * SECOND, None), Some(5 * SECOND));
        assert_eq!(goal.fraction(800, 4 * SECOND, None), Some(0.8));
        assert_eq!(goal.time_left(800, 4 * SECOND, None), Some(SECOND));
        assert_eq!(goal.fraction(2000, 20 * SECOND, None), Some(1.0));
        assert_eq!(goal.time_left(2000, 20 * SECOND, None), Some(Duration::ZERO));
    }

    #[test]
    fn an_error_is_reached_as_the_inverse_of_the_samples() {
        let goal = Goal { total_samples: None, time_limit: None, error: Some(0.01), samples_before: 0 };
        assert_eq!(goal.fraction(5, SECOND, None), Some(0.0));
        assert_eq!(goal.time_left(5, SECOND, None), None);
        assert_eq!(goal.fraction(5, SECOND, Some(0.04)), Some(0.25));
        assert_eq!(goal.time_left(5, SECOND, Some(0.04)), Some(3 * SECOND));
        assert_eq!(goal.fraction(5, SECOND, Some(0.001)), Some(1.0));
    }

    #[test]
    fn without_an_end_nothing_is_promised() {
        let goal = Goal { total_samples: None, time_limit: None, error: None, samples_before: 0 };
        assert_eq!(goal.fraction(5, SECOND, None), None);
        assert_eq!(goal.time_left(5, SECOND, None), None);
        let text = message(&goal, 2_000_000, 30_000_000, Some(0.0125), 3 * SECOND);
        assert_eq!(text, "relMSE 1.25e-2, 10.00 Mrays/s, 2.00 M samples");
    }

    #[test]
    fn nothing_is_guessed_before_the_first_sample() {
        let goal = Goal { total_samples: Some(100), time_limit: None, error: None, samples_before: 0 };
        assert_eq!(message(&goal, 0, 0, None, Duration::ZERO), "0 %, 0 samples");
    }

    #[test]
    fn programs_read_json() {
        let goal = Goal { total_samples: Some(100), time_limit: None, error: None, samples_before: 20 };
        let line: serde_json::Value =
            serde_json::from_str(&json_line(&goal, 60, 800, None, 4 * SECOND)).unwrap();
        assert_eq!((&line["fraction"], &line["seconds_left"]), (&0.6.into(), &4.0.into()));
        assert_eq!((&line["samples_per_second"], &line["rays_per_second"]), (&10.0.into(), &200.0.into()));
        assert!(line["estimated_relmse"].is_null());
    }

    #[test]
    fn a_narrow_terminal_shows_what_matters() {
        let goal = Goal { total_samples: Some(1000), time_limit: None, error: None, samples_before: 0 };
        let text = message(&goal, 250, 1_000_000, Some(0.02), 100 * SECOND);
        // 40 columns less the bar and a space.
        assert!(text[..27].contains("25 %, 5m00s left"), "{text}");
    }

    #[test]
    fn a_goal_is_told_in_words() {
        let goal = Goal {
            total_samples: Some(2_000_000),
            time_limit: Some(90 * SECOND),
            error: Some(0.01),
            samples_before: 0,
        };
        assert_eq!(goal.to_string(), "2.00 M samples, or 1m30s, or a relMSE of 1.00e-2");
        let none = Goal { total_samples: None, time_limit: None, error: None, samples_before: 0 };
        assert_eq!(none.to_string(), "until it is interrupted");
    }

    #[test]
    fn a_quiet_bar_takes_updates() {
        let mut progress = Progress::new(Some(10), Some(SECOND), None, true);
        progress.update(5, 10, Some(0.1));
        progress.finish();
    }
}
