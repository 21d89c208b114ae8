//! A small writer of SVG, and the look that all plots share.

use std::fmt::{Display, Write};

use crate::converge::escape::markup;

/// Colours, lines and letters. Series have the colours of Okabe and Ito ("Color Universal Design", 2008), which people
/// with any kind of colour vision can tell apart; stages have the "light" scheme of Paul Tol, on which dark text is
/// readable. Colours are set on classes and never by variables, which some viewers of SVG lack; the colours for dark
/// screens are the same hues, lighter.
const STYLE: &str = "\
.wp{font:13px system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}\
.wp-back{fill:#fff}.wp-text{fill:#1f2328}.wp-soft{fill:#5b636c}.wp-title{font-size:17px;font-weight:600}\
.wp-small{font-size:12px}.wp-bold{font-weight:600}.wp-on{fill:#1f2328}\
.wp-grid{stroke:#e6e8eb;stroke-width:1}.wp-minor{stroke:#f3f4f6;stroke-width:1}.wp-axis{stroke:#8b949e;stroke-width:1}\
.wp-guide{stroke:#8b949e;stroke-width:1;stroke-dasharray:2 4;fill:none}\
.wp-halo{paint-order:stroke;stroke:#fff;stroke-width:4;stroke-linejoin:round}\
.wp-edge{stroke:#fff;stroke-width:1.2}.wp-line{fill:none;stroke:currentColor;stroke-width:2.2;stroke-linejoin:round}\
.wp-band{fill:currentColor;opacity:.16}.wp-dot{fill:currentColor;opacity:.38}.wp-mark{fill:currentColor}\
.wp-bar{fill:currentColor;opacity:.85}.wp-lead{stroke:currentColor;stroke-width:1;opacity:.6;fill:none}\
.wp-whisker{stroke:#1f2328;stroke-width:1.5;fill:none}\
.wp-s0{color:#0072b2}.wp-s1{color:#d55e00}.wp-s2{color:#009e73}.wp-s3{color:#cc79a7}.wp-s4{color:#e69f00}\
.wp-s5{color:#56b4e9}.wp-s6{color:#6b5ca5}.wp-s7{color:#4d4d4d}.wp-other{color:#5b636c}\
.wp-t0{fill:#77aadd}.wp-t1{fill:#ee8866}.wp-t2{fill:#eedd88}.wp-t3{fill:#44bb99}.wp-t4{fill:#ffaabb}\
.wp-t5{fill:#bbcc33}.wp-t6{fill:#99ddff}.wp-t7{fill:#dddddd}\
@media screen and (prefers-color-scheme:dark){\
.wp-back{fill:#14171c}.wp-text{fill:#e6e9ec}.wp-soft{fill:#a3abb4}\
.wp-grid{stroke:#2a2f36}.wp-minor{stroke:#1d2127}.wp-axis,.wp-guide{stroke:#6b747e}\
.wp-halo{stroke:#14171c}.wp-edge{stroke:#14171c}.wp-whisker{stroke:#e6e9ec}.wp-band{opacity:.24}\
.wp-s0{color:#4fa8e0}.wp-s1{color:#ff8547}.wp-s2{color:#2fc79c}.wp-s3{color:#e3a0c5}.wp-s4{color:#f2b53a}\
.wp-s5{color:#9ad4f5}.wp-s6{color:#a99be0}.wp-s7{color:#c4c4c4}.wp-other{color:#a3abb4}}";

/// How many series have a colour of their own.
const SERIES: usize = 8;

/// How many stages have a colour of their own.
const STAGES: usize = 8;

/// Where a text begins, ends or has its middle.
#[derive(Clone, Copy)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// A picture that is drawn from back to front.
pub struct Svg {
    width: f64,
    height: f64,
    label: String,
    body: String,
}

impl Svg {
    /// An empty picture with a title and a line below it. `label` describes it to those who cannot see it.
    pub fn new(width: f64, height: f64, title: &str, subtitle: &str, label: &str) -> Self {
        let mut svg = Self { width, height, label: markup(label), body: String::new() };
        svg.text("wp-text wp-title", (24.0, 32.0), Anchor::Start, title);
        let fitting = (width - 48.0) / 6.0;
        svg.text("wp-soft wp-small", (24.0, 52.0), Anchor::Start, &shortened(subtitle, fitting as usize));
        svg
    }

    /// The whole file.
    pub fn finish(self) -> String {
        let Self { width, height, label, body } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"wp\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{label}\">\n<style>{STYLE}</style>\n\
             <rect class=\"wp-back\" width=\"{width}\" height=\"{height}\"/>\n{body}</svg>\n"
        )
    }

    pub fn text(&mut self, class: &str, (x, y): (f64, f64), anchor: Anchor, text: &str) {
        self.raw_text(class, (x, y), anchor, &markup(text));
    }

    /// `digit` times 10 to the power of `exponent`.
    pub fn power_of_ten(
        &mut self,
        class: &str,
        (x, y): (f64, f64),
        anchor: Anchor,
        digit: u32,
        exponent: i32,
    ) {
        let factor = if digit == 1 { String::new() } else { format!("{digit}·") };
        let sign = if exponent < 0 { "−" } else { "" };
        let digits = exponent.unsigned_abs();
        let text = format!("{factor}10<tspan dy=\"-5\" font-size=\"10\">{sign}{digits}</tspan>");
        self.raw_text(class, (x, y), anchor, &text);
    }

    fn raw_text(&mut self, class: &str, (x, y): (f64, f64), anchor: Anchor, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let (x, y) = (Place(x), Place(y));
        self.push(format_args!("<text class=\"{class}\" x=\"{x}\" y=\"{y}\"{anchor}>{text}</text>"));
    }

    pub fn line(&mut self, class: &str, (x1, y1): (f64, f64), (x2, y2): (f64, f64)) {
        let (x1, y1, x2, y2) = (Place(x1), Place(y1), Place(x2), Place(y2));
        self.push(format_args!("<line class=\"{class}\" x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\"/>"));
    }

    /// A rectangle; `title` shows up under the pointer.
    pub fn rect(&mut self, class: &str, (x, y): (f64, f64), (width, height): (f64, f64), title: &str) {
        let title =
            if title.is_empty() { String::new() } else { format!("<title>{}</title>", markup(title)) };
        let (x, y, width, height) = (Place(x), Place(y), Place(width.max(0.0)), Place(height.max(0.0)));
        self.push(format_args!(
            "<rect class=\"{class}\" x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\">{title}</rect>"
        ));
    }

    pub fn circle(&mut self, class: &str, (x, y): (f64, f64), radius: f64) {
        let (x, y) = (Place(x), Place(y));
        self.push(format_args!("<circle class=\"{class}\" cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"/>"));
    }

    /// Straight lines through points, and back to the first one if `closed`.
    pub fn path(&mut self, class: &str, points: impl IntoIterator<Item = (f64, f64)>, closed: bool) {
        let mut data = String::new();
        for (x, y) in points {
            let command = if data.is_empty() { 'M' } else { 'L' };
            write!(data, "{command}{},{}", Place(x), Place(y)).expect("a string takes everything");
        }
        let end = if closed { "Z" } else { "" };
        if !data.is_empty() {
            self.push(format_args!("<path class=\"{class}\" d=\"{data}{end}\"/>"));
        }
    }

    /// The mark of a series; its shape differs too, for those who print without colour.
    pub fn mark(&mut self, series: usize, (x, y): (f64, f64)) {
        const R: f64 = 4.6;
        let corners: &[(f64, f64)] = match series % 6 {
            0 => return self.circle("wp-mark wp-edge", (x, y), R),
            1 => &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
            2 => &[(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)],
            3 => &[(0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)],
            4 => &[(0.0, 1.2), (1.1, -0.8), (-1.1, -0.8)],
            _ => &[(-0.6, -1.1), (0.6, -1.1), (1.2, 0.0), (0.6, 1.1), (-0.6, 1.1), (-1.2, 0.0)],
        };
        self.path("wp-mark wp-edge", corners.iter().map(|(dx, dy)| (x + R * dx, y + R * dy)), true);
    }

    /// The mark of a picture of another program: a four-pointed star.
    pub fn star(&mut self, (x, y): (f64, f64)) {
        let corner = |index: i32| {
            let radius = if index % 2 == 0 { 8.0 } else { 2.8 };
            let angle = f64::from(index) * std::f64::consts::FRAC_PI_4;
            (x + radius * angle.sin(), y - radius * angle.cos())
        };
        self.path("wp-mark wp-edge", (0..8).map(corner), true);
    }

    /// What `draw` draws has the colour of a series.
    pub fn series(&mut self, series: usize, draw: impl FnOnce(&mut Self)) {
        self.group(&format!("wp-s{}", series % SERIES), draw);
    }

    /// What `draw` draws has a class.
    pub fn group(&mut self, class: &str, draw: impl FnOnce(&mut Self)) {
        self.push(format_args!("<g class=\"{class}\">"));
        draw(self);
        self.push(format_args!("</g>"));
    }

    fn push(&mut self, element: std::fmt::Arguments) {
        writeln!(self.body, "{element}").expect("a string takes everything");
    }
}

/// The class with the colour of a stage.
pub fn stage_class(index: usize) -> String {
    format!("wp-t{}", index % STAGES)
}

/// How wide a text is at most, in the font's 13 pixels. Which font a reader has is not known: this is for wide ones.
pub fn text_width(text: &str) -> f64 {
    7.8 * text.chars().count() as f64
}

/// The same for bold letters.
pub fn bold_width(text: &str) -> f64 {
    8.7 * text.chars().count() as f64
}

/// At most `longest` characters of a text.
pub fn shortened(text: &str, longest: usize) -> String {
    if text.chars().count() <= longest {
        return text.to_string();
    }
    let kept: String = text.chars().take(longest.saturating_sub(1)).collect();
    format!("{}…", kept.trim_end())
}

/// A coordinate with two decimals at most.
struct Place(f64);

impl Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Adding 0 turns -0 into 0.
        write!(f, "{}", (100.0 * self.0).round() / 100.0 + 0.0)
    }
}
