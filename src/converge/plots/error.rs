//! Error against time, both logarithmic.

use super::axis::{LogAxis, Tick};
use super::setting;
use super::svg::{Anchor, Svg, bold_width, shortened};
use crate::converge::figures;
use crate::converge::summary::{BandPoint, Summary};
use crate::converge::{Experiment, Point};

const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 580.0;
const LEFT: f64 = 76.0;
const TOP: f64 = 96.0;
const BOTTOM: f64 = HEIGHT - 58.0;
/// Least distance between the labels at the ends of the lines.
const LABEL_HEIGHT: f64 = 40.0;
/// Longest name that is written out.
const LONGEST_NAME: usize = 30;

/// What the error is plotted against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Against {
    /// Time spent rendering.
    Seconds,
    /// Samples per pixel: what the sampler does, whatever it costs.
    Spp,
}

impl Against {
    fn of_point(self, point: &Point) -> f64 {
        match self {
            Self::Seconds => point.seconds,
            Self::Spp => point.spp,
        }
    }

    fn of_band(self, point: &BandPoint) -> f64 {
        match self {
            Self::Seconds => point.seconds,
            Self::Spp => point.spp,
        }
    }

    fn label(self) -> &'static str {
        match self {
            Self::Seconds => "render time, seconds",
            Self::Spp => "samples per pixel",
        }
    }
}

/// One line for each variant: the geometric mean of its seeds with a band of 95 % confidence, each seed's checkpoints as
/// dots, the fitted slope beside its name; pictures of other programs as stars. A dotted line falls as fast as plain
/// Monte Carlo does.
pub fn error(experiment: &Experiment, summary: &Summary, against: Against) -> String {
    let own = summary.measure.own(&experiment.reference);
    let dots: Vec<Vec<(f64, f64)>> = experiment
        .variants
        .iter()
        .map(|variant| {
            let points = variant.runs.iter().flat_map(|run| &run.points);
            points.map(|point| (against.of_point(point), summary.measure.of(&point.errors) - own)).collect()
        })
        .collect();
    let stars: Vec<(f64, f64)> = match against {
        Against::Seconds => {
            summary.externals.iter().map(|e| (e.seconds, e.error.unwrap_or(f64::NAN))).collect()
        }
        Against::Spp => Vec::new(),
    };
    let drawn = || dots.iter().flatten().chain(&stars).filter(|(x, y)| *x > 0.0 && *y > 0.0);
    let names = experiment.variants.iter().map(|variant| bold_width(&shortened(&variant.name, LONGEST_NAME)));
    let right = WIDTH - 48.0 - names.fold(bold_width("slope −0.98 ± 0.03"), f64::max);
    let x = LogAxis::around(drawn().map(|point| point.0), (LEFT, right));
    let y = LogAxis::around(drawn().map(|point| point.1), (BOTTOM, TOP));

    let measure = summary.measure.name();
    let (title, short) = match against {
        Against::Seconds => (format!("{measure} against render time"), "time"),
        Against::Spp => (format!("{measure} against samples"), "samples"),
    };
    let label = format!("{title}, both axes logarithmic: {}", setting(experiment));
    let mut svg = Svg::new(WIDTH, HEIGHT, &title, &setting(experiment), &label);
    axes(&mut svg, &x, &y, against.label(), measure);
    guide(&mut svg, &x, &y, drawn(), short);
    if own > 0.0 && y.shows(own) {
        svg.line("wp-guide", (LEFT, y.place(own)), (right, y.place(own)));
        svg.text(
            "wp-soft wp-small wp-halo",
            (LEFT + 8.0, y.place(own) - 6.0),
            Anchor::Start,
            "the reference's own error",
        );
    }
    for (index, (variant, dots)) in summary.variants.iter().zip(&dots).enumerate() {
        let band = &variant.band;
        svg.series(index, |svg| {
            let place = |point: &BandPoint, error: f64| (x.place(against.of_band(point)), y.place(error));
            let upper = band.iter().filter_map(|p| Some(place(p, p.error.interval?[1])));
            let lower = band.iter().rev().filter_map(|p| Some(place(p, p.error.interval?[0])));
            let inside = |(x, y): (f64, f64)| (x, y.clamp(TOP, BOTTOM));
            svg.path("wp-band", upper.chain(lower).map(inside), true);
            for &(seconds, error) in
                dots.iter().filter(|(seconds, error)| x.shows(*seconds) && y.shows(*error))
            {
                svg.circle("wp-dot", (x.place(seconds), y.place(error)), 2.0);
            }
            svg.path("wp-line", band.iter().map(|p| place(p, p.error.value)), false);
            band.iter().for_each(|p| svg.mark(index, place(p, p.error.value)));
        });
    }
    let ends = summary.variants.iter().enumerate().filter_map(|(index, variant)| {
        let last = variant.band.last()?;
        Some((index, (x.place(against.of_band(last)), y.place(last.error.value))))
    });
    labels(&mut svg, summary, ends.collect(), right, against);
    let lines = summary.variants.iter().map(|variant| {
        let place = |p: &BandPoint| (x.place(against.of_band(p)), y.place(p.error.value));
        variant.band.iter().map(place).collect::<Vec<_>>()
    });
    let mut taken: Vec<(f64, f64)> = lines.flat_map(|line| along(&line)).collect();
    let shown = summary.externals.iter().zip(&stars).filter(|(_, star)| x.shows(star.0) && y.shows(star.1));
    let shown: Vec<(&str, (f64, f64))> =
        shown.map(|(external, star)| (external.name.as_str(), (x.place(star.0), y.place(star.1)))).collect();
    taken.extend(shown.iter().map(|(_, place)| *place));
    for (name, place) in shown {
        star(&mut svg, name, place, right, &mut taken);
    }
    svg.finish()
}

fn axes(svg: &mut Svg, x: &LogAxis, y: &LogAxis, x_label: &str, y_label: &str) {
    let right = x.place(x.ends().1);
    let class = |tick: &Tick| if tick.digit == 1 || tick.labelled { "wp-grid" } else { "wp-minor" };
    for tick in x.ticks() {
        let place = x.place(tick.value());
        svg.line(class(&tick), (place, TOP), (place, BOTTOM));
    }
    for tick in y.ticks() {
        let place = y.place(tick.value());
        svg.line(class(&tick), (LEFT, place), (right, place));
    }
    tick_labels(svg, x, Anchor::Middle, |place| (place, BOTTOM + 20.0));
    tick_labels(svg, y, Anchor::End, |place| (LEFT - 8.0, place + 4.5));
    svg.line("wp-axis", (LEFT, BOTTOM), (right, BOTTOM));
    svg.text("wp-text wp-bold", ((LEFT + right) / 2.0, BOTTOM + 44.0), Anchor::Middle, x_label);
    svg.text("wp-text wp-bold", (24.0, TOP - 16.0), Anchor::Start, y_label);
}

/// Plain numbers where all of the axis' labels are short as such; powers of ten else.
fn tick_labels(svg: &mut Svg, axis: &LogAxis, anchor: Anchor, at: impl Fn(f64) -> (f64, f64)) {
    let ticks: Vec<Tick> = axis.ticks().into_iter().filter(|tick| tick.labelled).collect();
    let short = ticks.iter().all(|tick| (-3..=4).contains(&tick.exponent));
    for tick in ticks {
        let place = at(axis.place(tick.value()));
        let Tick { digit, exponent, .. } = tick;
        match exponent {
            0.. if short => {
                svg.text("wp-soft", place, anchor, &format!("{digit}{}", "0".repeat(exponent as usize)));
            }
            ..0 if short => {
                let zeros = "0".repeat((-exponent - 1) as usize);
                svg.text("wp-soft", place, anchor, &format!("0.{zeros}{digit}"));
            }
            _ => svg.power_of_ten("wp-soft", place, anchor, digit, exponent),
        }
    }
}

/// A line of slope -1 below all points.
fn guide<'a>(
    svg: &mut Svg,
    x: &LogAxis,
    y: &LogAxis,
    points: impl Iterator<Item = &'a (f64, f64)>,
    short: &str,
) {
    let Some(least) = points.map(|(x, y)| x * y).reduce(f64::min) else { return };
    let product = 0.6 * least;
    let ((x_low, x_high), (y_low, y_high)) = (x.ends(), y.ends());
    let (from, to) = (x_low.max(product / y_high), x_high.min(product / y_low));
    let place = |at: f64| (x.place(at), y.place(product / at));
    // Too short to show anything.
    if from.is_finite() && to.is_finite() && place(to).0 - place(from).0 > 80.0 {
        svg.line("wp-guide", place(from), place(to));
        let (left, top) = place(from);
        // Beside the line, a little down from its upper end.
        let at = left + 14.0;
        let slope = (place(to).1 - top) / (place(to).0 - left);
        let text = format!("1 / {short}");
        let beside = (at - 6.0, top + slope * 14.0 + 18.0);
        if beside.1 < BOTTOM - 6.0 {
            svg.text("wp-soft wp-small wp-halo", (beside.0.max(LEFT + 4.0), beside.1), Anchor::Start, &text);
        }
    }
}

/// Names and slopes to the right of the lines' ends, moved apart where they would overlap.
fn labels(
    svg: &mut Svg,
    summary: &Summary,
    mut ends: Vec<(usize, (f64, f64))>,
    right: f64,
    against: Against,
) {
    ends.sort_by(|a, b| a.1.1.total_cmp(&b.1.1));
    // Down from the top, then up again from the bottom.
    let mut places: Vec<f64> = ends.iter().map(|end| end.1.1).collect();
    for index in 1..places.len() {
        places[index] = places[index].max(places[index - 1] + LABEL_HEIGHT);
    }
    let mut limit = BOTTOM - 12.0;
    for place in places.iter_mut().rev() {
        *place = place.min(limit);
        limit = *place - LABEL_HEIGHT;
    }
    // More labels than there is room for lie on each other at the top, rather than outside.
    places.iter_mut().for_each(|place| *place = place.max(TOP));
    for (&(index, end), &place) in ends.iter().zip(&places) {
        let variant = &summary.variants[index];
        let text = right + 32.0;
        svg.series(index, |svg| {
            svg.path("wp-lead", [(end.0 + 7.0, end.1), (right + 6.0, place), (right + 14.0, place)], false);
            svg.mark(index, (right + 21.0, place));
        });
        svg.text(
            "wp-text wp-bold",
            (text, place + 4.5),
            Anchor::Start,
            &shortened(&variant.name, LONGEST_NAME),
        );
        if let (Some(slope), Against::Seconds) = (&variant.slope, against) {
            let slope = format!("slope {}", figures::slope(slope, "±", "−"));
            svg.text("wp-soft wp-small", (text, place + 20.0), Anchor::Start, &slope);
        }
    }
}

/// Points on the straight lines between points, a few pixels apart.
fn along(line: &[(f64, f64)]) -> Vec<(f64, f64)> {
    const STEPS: u32 = 32;
    let between = |(a, b): (&(f64, f64), &(f64, f64))| {
        let (a, b) = (*a, *b);
        (0..=STEPS).map(move |step| {
            let t = f64::from(step) / f64::from(STEPS);
            (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1))
        })
    };
    line.iter().zip(line.iter().skip(1)).flat_map(between).collect()
}

/// A star with its name on the side where it covers least of what is `taken`; its own place is taken after that.
fn star(svg: &mut Svg, name: &str, (x, y): (f64, f64), right: f64, taken: &mut Vec<(f64, f64)>) {
    svg.group("wp-other", |svg| svg.star((x, y)));
    let name = shortened(name, LONGEST_NAME);
    let width = bold_width(&name);
    // Left end and base line of the name: right of the star, left of it, below, above, and the corners.
    let (near, far) = (x + 12.0, x - 12.0 - width);
    let sides = [(near, 4.5), (far, 4.5), (near, 20.0), (far, 20.0), (near, -11.0), (far, -11.0)];
    let middles = [(x - width / 2.0, 25.0), (x - width / 2.0, -14.0)];
    let covered = |(left, down): (f64, f64)| {
        let inside = |p: &&(f64, f64)| {
            (left - 4.0..left + width + 4.0).contains(&p.0)
                && (y + down - 15.0..y + down + 5.0).contains(&p.1)
        };
        let outside = left < LEFT || left + width > right || y + down - 12.0 < TOP || y + down > BOTTOM;
        taken.iter().filter(inside).count() + if outside { 1000 } else { 0 }
    };
    let (left, down) = sides.into_iter().chain(middles).min_by_key(|side| covered(*side)).unwrap_or(sides[0]);
    let left = left.max(24.0).min(WIDTH - width).max(24.0);
    svg.text("wp-text wp-bold wp-halo", (left, y + down), Anchor::Start, &name);
    let letters = (width / 8.0) as u32;
    taken.extend((0..=letters).map(|letter| (left + 8.0 * f64::from(letter), y + down - 5.0)));
}
