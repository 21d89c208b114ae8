//! The battery's results as tables: for the terminal, in Markdown, as JSON.

use super::{Row, Verdict};
use serde::Serialize;
use std::fmt::Write;

/// What a battery found.
#[derive(Clone, Debug, Serialize)]
pub struct Results {
    /// Version of wavepath.
    pub version: &'static str,
    /// Processor.
    pub cpu: String,
    /// Engine.
    pub engine: String,
    /// Instruction set.
    pub isa: String,
    /// Rays aimed at edges and vertices for each mesh and traversal.
    pub leak_rays: usize,
    /// Seconds in all.
    pub seconds: f64,
    /// The cases.
    pub rows: Vec<Row>,
}

const STRING: &str = "a string takes everything";
const HEADS: [&str; 8] =
    ["case", "what is measured", "expected", "found", "error", "allowed", "invalid samples", "verdict"];

/// A number with so many digits as a table wants.
pub fn number(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 {
        "0".into()
    } else if !x.is_finite() {
        x.to_string()
    } else if (1e-3..1e5).contains(&size) {
        let digits = (6 - size.log10().floor() as i32).clamp(0, 9) as usize;
        let text = format!("{x:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
    } else {
        format!("{x:.6e}")
    }
}

/// An error: one or two digits.
fn share(x: f64) -> String {
    if x == 0.0 { "0".into() } else { format!("{x:.1e}") }
}

impl Results {
    /// How many have this verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.rows.iter().filter(|row| row.verdict == verdict).count()
    }
    /// Does any case fail?
    pub fn failed(&self) -> bool {
        self.rows.iter().any(|row| row.verdict.is_failure())
    }

    /// One sentence.
    pub fn summary(&self) -> String {
        let lost = self.count(Verdict::InputLost);
        let lost = if lost == 0 {
            String::new()
        } else {
            format!(", in {lost} the input in single precision has lost the geometry")
        };
        let wrong = self.rows.iter().filter(|row| row.verdict.is_failure()).count();
        format!(
            "{} cases: {} pass, {wrong} fail{lost}; {:.0} s, {}, {}, {}",
            self.rows.len(),
            self.count(Verdict::Pass),
            self.seconds,
            self.engine,
            self.isa,
            self.cpu
        )
    }

    /// Texts of a row's cells.
    pub(super) fn cells(row: &Row) -> [String; 8] {
        let bound = if row.at_most { "at most " } else { "" };
        let found = match &row.failure {
            Some(failure) => failure.lines().next().unwrap_or_default().to_string(),
            None if row.standard_error > 0.0 => {
                format!("{} +- {}", number(row.found), share(row.standard_error))
            }
            None => number(row.found),
        };
        [
            row.name.clone(),
            row.what.clone(),
            format!("{bound}{}", number(row.expected)),
            found,
            if row.error.is_nan() { "-".into() } else { share(row.error) },
            share(row.tolerance),
            row.invalid_samples.to_string(),
            row.verdict.name().into(),
        ]
    }

    /// The heads of the columns.
    pub(super) fn heads() -> [&'static str; 8] {
        HEADS
    }

    /// For the terminal: columns under each other.
    pub fn text(&self) -> String {
        let mut lines = vec![HEADS.map(String::from)];
        lines.extend(self.rows.iter().map(Self::cells));
        let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
        let widths: [usize; 8] = core::array::from_fn(width);
        let mut text = String::new();
        for (index, line) in lines.iter().enumerate() {
            let cells: Vec<String> =
                line.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
            writeln!(text, "{}", cells.join("  ").trim_end()).expect(STRING);
            if index == 0 {
                writeln!(text, "{}", "-".repeat(widths.iter().sum::<usize>() + 14)).expect(STRING);
            }
        }
        writeln!(text, "\n{}", self.summary()).expect(STRING);
        text
    }

    /// In Markdown, a table for each family.
    pub fn markdown(&self) -> String {
        let mut text = format!("{}.\n", self.summary());
        let mut family = "";
        for row in &self.rows {
            let of = row.name.split('/').next().unwrap_or_default();
            if of != family {
                family = of;
                writeln!(text, "\n### {family}\n").expect(STRING);
                writeln!(text, "| {} |", HEADS.join(" | ")).expect(STRING);
                writeln!(text, "|{}", "---|".repeat(HEADS.len())).expect(STRING);
            }
            let mut cells = Self::cells(row).map(|cell| cell.replace('|', "\\|"));
            cells[0] = cells[0].split_once('/').map_or("", |(_, name)| name).to_string();
            writeln!(text, "| {} |", cells.join(" | ")).expect(STRING);
        }
        text
    }

    /// As one JSON object.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("numbers and names")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_digits_enough() {
        let cases = [
            (0.5, "0.5"),
            (0.0, "0"),
            (10_001.0, "10001"),
            (0.284_458_25, "0.2844583"),
            (1e-30, "1.000000e-30"),
            (1.25e6, "1.250000e6"),
        ];
        for (x, expected) in cases {
            assert_eq!(number(x), expected);
        }
    }
}
