//! Efficiency: how much less error a second buys.

use super::axis::linear_ticks;
use super::setting;
use super::svg::{Anchor, Svg, shortened, text_width};
use crate::converge::Experiment;
use crate::converge::figures::{self, number};
use crate::converge::statistics::Estimate;
use crate::converge::summary::Summary;

const WIDTH: f64 = 960.0;
const TOP: f64 = 84.0;
/// From one bar to the next.
const PITCH: f64 = 38.0;
const BAR: f64 = 24.0;
/// Room for what is written behind the longest bar.
const BEHIND: f64 = 190.0;
const LONGEST_NAME: usize = 30;

/// A bar for each variant with its interval, and one for each picture of another program.
pub fn efficiency(experiment: &Experiment, summary: &Summary) -> String {
    let variants = summary.variants.iter().map(|variant| (variant.name.as_str(), variant.efficiency));
    let externals = summary.externals.iter();
    let externals =
        externals.map(|external| (external.name.as_str(), external.efficiency.map(Estimate::bare)));
    let rows: Vec<(&str, Option<Estimate>)> = variants.chain(externals).collect();
    let own_colour = summary.variants.len();
    let bottom = TOP + PITCH * rows.len() as f64;

    let title = format!("Efficiency: 1 / ({} × seconds)", summary.measure.name());
    let label = format!("{title}: {}", setting(experiment));
    let mut svg = Svg::new(WIDTH, bottom + 62.0, &title, &setting(experiment), &label);
    let widest = rows.iter().map(|row| text_width(&shortened(row.0, LONGEST_NAME)));
    let (left, right) = (36.0 + widest.fold(0.0, f64::max), WIDTH - BEHIND);
    let reach = |estimate: &Estimate| estimate.interval.map_or(estimate.value, |[_, high]| high);
    // The interval of a single bar must not make all of them short.
    let largest =
        rows.iter().filter_map(|row| row.1).map(|e| reach(&e).min(2.0 * e.value)).fold(0.0, f64::max);
    let ticks = linear_ticks(largest);
    let most = if largest > 0.0 { largest } else { 1.0 };
    let place = |value: f64| left + (right - left) * (value / most).min(1.0);
    for &tick in ticks.iter().filter(|tick| **tick <= most) {
        svg.line("wp-grid", (place(tick), TOP - 6.0), (place(tick), bottom));
        let text =
            if tick == 0.0 || (1e-3..1e6).contains(&tick) { plain(tick) } else { format!("{tick:.0e}") };
        svg.text("wp-soft", (place(tick), bottom + 18.0), Anchor::Middle, &text);
    }
    for (index, (name, estimate)) in rows.iter().enumerate() {
        let y = TOP + PITCH * index as f64;
        svg.text("wp-text", (left - 12.0, y + 17.0), Anchor::End, &shortened(name, LONGEST_NAME));
        let Some(estimate) = estimate else {
            svg.text("wp-soft", (left + 8.0, y + 17.0), Anchor::Start, "not known");
            continue;
        };
        let class = if index < own_colour { format!("wp-s{}", index % 8) } else { "wp-other".into() };
        svg.group(&class, |svg| {
            svg.rect("wp-bar", (left, y), (place(estimate.value) - left, BAR), &number(estimate.value));
        });
        let mut end = place(estimate.value);
        if let Some([low, high]) = estimate.interval {
            let (low, high, middle) = (place(low), place(high), y + BAR / 2.0);
            svg.line("wp-whisker", (low, middle), (high, middle));
            for x in [low, high] {
                svg.line("wp-whisker", (x, middle - 5.0), (x, middle + 5.0));
            }
            end = end.max(high);
        }
        svg.text("wp-text", (end + 10.0, y + 17.0), Anchor::Start, &figures::estimate(estimate));
    }
    svg.line("wp-axis", (left, TOP - 6.0), (left, bottom));
    let axis = "per second; longer is better";
    svg.text("wp-text wp-bold", ((left + right) / 2.0, bottom + 44.0), Anchor::Middle, axis);
    svg.finish()
}

/// A tick without digits from rounding.
fn plain(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}
