//! Where the time goes.

use super::setting;
use super::svg::{Anchor, Svg, shortened, stage_class, text_width};
use crate::converge::Experiment;
use crate::converge::figures::{self, number};
use crate::converge::summary::{Summary, VariantSummary};
use crate::converge::table::round_number;

const WIDTH: f64 = 960.0;
const TOP: f64 = 84.0;
/// From one bar to the next.
const PITCH: f64 = 36.0;
const BAR: f64 = 24.0;
/// Room for what is written behind the longest bar.
const BEHIND: f64 = 96.0;
const LONGEST_NAME: usize = 30;

/// Above, for each variant the worker time in each stage until its error falls to the summary's target, so that a
/// shorter bar is the better variant and its segments say why; below, the same as shares of the whole.
pub fn stages(experiment: &Experiment, summary: &Summary) -> String {
    let variants: Vec<&VariantSummary> =
        summary.variants.iter().filter(|variant| variant.stages.iter().any(|stage| stage.1 > 0.0)).collect();
    let names = stage_names(&variants);
    let legend = legend_places(&names);
    let legend_rows = legend.last().map_or(0, |place| place.1 + 1);
    let first = TOP + 24.0 * legend_rows as f64 + 26.0;
    let second = first + PITCH * variants.len() as f64 + 48.0;
    let height = if variants.is_empty() { 140.0 } else { second + PITCH * variants.len() as f64 + 12.0 };

    let measure = summary.measure.name();
    let title = format!("Time in each stage to a given {measure}");
    let label = format!("{title}: {}", setting(experiment));
    let mut svg = Svg::new(WIDTH, height, &title, &setting(experiment), &label);
    if variants.is_empty() {
        svg.text("wp-soft", (24.0, TOP + 16.0), Anchor::Start, "No stage times were measured.");
        return svg.finish();
    }
    for (index, (name, (left, row))) in names.iter().zip(&legend).enumerate() {
        let y = TOP + 24.0 * *row as f64;
        svg.rect(&stage_class(index), (*left, y - 11.0), (14.0, 14.0), "");
        svg.text("wp-text", (left + 20.0, y + 1.0), Anchor::Start, &shortened(name, LONGEST_NAME));
    }
    let widest = variants.iter().map(|variant| text_width(&shortened(&variant.name, LONGEST_NAME)));
    let left = 36.0 + widest.fold(0.0, f64::max);

    let target = summary.target_error.map_or_else(String::new, round_number);
    let heading = format!("worker seconds until {measure} is {target}");
    svg.text("wp-text wp-bold", (24.0, first - 12.0), Anchor::Start, &heading);
    let time = |variant: &VariantSummary| variant.seconds_to_target.map(|reading| reading.estimate.value);
    let spent = |variant: &VariantSummary| time(variant).unwrap_or(0.0) * total(variant);
    let most = variants.iter().map(|variant| spent(variant)).fold(0.0, f64::max);
    for (index, variant) in variants.iter().enumerate() {
        let y = first + PITCH * index as f64;
        let Some(seconds) = time(variant) else {
            name_of(&mut svg, variant, left, y);
            svg.text(
                "wp-soft",
                (left, y + 17.0),
                Anchor::Start,
                "not known: the error does not fall that far",
            );
            continue;
        };
        let scale = seconds * (WIDTH - BEHIND - left) / most;
        let title = |stage: &str, value: f64| format!("{stage}: {} worker seconds", number(seconds * value));
        let end = bar(&mut svg, variant, &names, (left, y), scale, title);
        let mark =
            if variant.seconds_to_target.is_some_and(|reading| reading.extrapolated) { "~" } else { "" };
        let text = format!("{mark}{}", figures::seconds(spent(variant)));
        svg.text("wp-text", (end + 8.0, y + 17.0), Anchor::Start, &text);
    }

    svg.text("wp-text wp-bold", (24.0, second - 12.0), Anchor::Start, "share of the worker time");
    for (index, variant) in variants.iter().enumerate() {
        let y = second + PITCH * index as f64;
        let scale = (WIDTH - BEHIND - left) / total(variant);
        let percent = |value: f64| 100.0 * value / total(variant);
        let title = |stage: &str, value: f64| format!("{stage}: {:.1} %", percent(value));
        bar(&mut svg, variant, &names, (left, y), scale, title);
        let mut x = left;
        for name in &names {
            let value = of_stage(variant, name);
            if scale * value > 44.0 {
                let text = format!("{:.0} %", percent(value));
                svg.text("wp-on wp-small", (x + scale * value / 2.0, y + 16.5), Anchor::Middle, &text);
            }
            x += scale * value;
        }
    }
    svg.finish()
}

/// The stages of all variants, in order of appearance.
fn stage_names(variants: &[&VariantSummary]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for (name, _) in variants.iter().flat_map(|variant| &variant.stages) {
        if !names.contains(name) {
            names.push(name.clone());
        }
    }
    names
}

/// Left end and row of each entry.
fn legend_places(names: &[String]) -> Vec<(f64, usize)> {
    let (mut left, mut row) = (24.0, 0);
    let place = |name: &String| {
        let width = 42.0 + text_width(&shortened(name, LONGEST_NAME));
        if left + width > WIDTH && left > 24.0 {
            (left, row) = (24.0, row + 1);
        }
        let place = (left, row);
        left += width;
        place
    };
    names.iter().map(place).collect()
}

fn of_stage(variant: &VariantSummary, name: &str) -> f64 {
    variant.stages.iter().find(|stage| stage.0 == name).map_or(0.0, |stage| stage.1)
}

fn total(variant: &VariantSummary) -> f64 {
    variant.stages.iter().map(|stage| stage.1).sum()
}

fn name_of(svg: &mut Svg, variant: &VariantSummary, left: f64, y: f64) {
    svg.text("wp-text", (left - 12.0, y + 17.0), Anchor::End, &shortened(&variant.name, LONGEST_NAME));
}

/// The segments of a variant, `scale` pixels for each unit; returns where they end.
fn bar(
    svg: &mut Svg,
    variant: &VariantSummary,
    names: &[String],
    (left, y): (f64, f64),
    scale: f64,
    title: impl Fn(&str, f64) -> String,
) -> f64 {
    name_of(svg, variant, left, y);
    let mut x = left;
    for (index, name) in names.iter().enumerate() {
        let value = of_stage(variant, name);
        if value > 0.0 {
            svg.rect(&stage_class(index), (x, y), (scale * value, BAR), &title(name, value));
            x += scale * value;
        }
    }
    x
}
