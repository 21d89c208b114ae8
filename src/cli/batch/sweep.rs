//! Values that change from job to job: lists, and steps from one value to another.

use toml::de::{DeTable, DeValue};

/// Most jobs of a queue.
pub(super) const MOST_JOBS: usize = 100_000;

/// A name and the values that it takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Axis {
    pub name: String,
    pub values: Vec<String>,
}

/// A value as text: a word or a number as written, or numbers with a space between.
pub(super) fn text_of(value: &DeValue) -> Result<String, String> {
    match value {
        DeValue::String(text) => Ok(text.to_string()),
        DeValue::Integer(number) => whole(number.as_str(), number.radix()),
        // As written, but for the separators of TOML.
        DeValue::Float(number) => Ok(number.as_str().replace('_', "")),
        DeValue::Boolean(value) => Ok(value.to_string()),
        DeValue::Array(values) => {
            let texts: Result<Vec<String>, String> =
                values.iter().map(|value| text_of(value.get_ref())).collect();
            Ok(texts?.join(" "))
        }
        other => {
            Err(format!("a {}; expected a number, a word, true, false or a list of them", other.type_str()))
        }
    }
}

fn whole(digits: &str, radix: u32) -> Result<String, String> {
    match i128::from_str_radix(&digits.replace('_', ""), radix) {
        Ok(number) => Ok(number.to_string()),
        Err(_) => Err(format!("{digits}; expected a smaller number")),
    }
}

/// The values of a sweep: `[20, 25, 30]`, or `{ from = 0, to = 360, frames = 36, loop = true }`.
pub(super) fn values(value: &DeValue) -> Result<Vec<String>, String> {
    match value {
        DeValue::Array(list) if !list.is_empty() => {
            list.iter().map(|value| text_of(value.get_ref())).collect()
        }
        DeValue::Array(_) => Err("an empty list; expected values".into()),
        DeValue::Table(table) => steps(table),
        other => {
            Err(format!("a {}; expected a list, or {{ from = A, to = B, frames = N }}", other.type_str()))
        }
    }
}

/// Whether a table is steps and not names with a dot.
pub(super) fn is_steps(table: &DeTable) -> bool {
    table.iter().any(|(key, _)| key.get_ref() == "from") && table.iter().any(|(key, _)| key.get_ref() == "to")
}

fn steps(table: &DeTable) -> Result<Vec<String>, String> {
    let mut from = None;
    let mut to = None;
    let mut frames = None;
    let mut step = None;
    let mut is_loop = false;
    for (key, value) in table.iter() {
        let value = value.get_ref();
        match key.get_ref().as_ref() {
            "from" => from = Some(numbers(value)?),
            "to" => to = Some(numbers(value)?),
            "frames" => frames = Some(numbers(value)?),
            "step" => step = Some(numbers(value)?),
            "loop" => is_loop = value.as_bool().ok_or("loop; expected true or false")?,
            other => return Err(format!("\"{other}\"; expected from, to, frames, step or loop")),
        }
    }
    let (Some(from), Some(to)) = (from, to) else {
        return Err("steps without an end; expected from and to".into());
    };
    if from.len() != to.len() {
        return Err("from and to of different lengths; expected as many numbers in both".into());
    }
    let count = match (frames.as_deref(), step.as_deref()) {
        (Some([frames]), None) if *frames >= 1.0 && frames.fract() == 0.0 => *frames,
        (None, Some([step])) if from.len() == 1 => {
            let intervals = (to[0] - from[0]) / step;
            if intervals.is_nan() || intervals < 0.0 || intervals.is_infinite() {
                return Err("a step that does not lead from one end to the other".into());
            }
            // Up to the end where rounding alone keeps the last step from it.
            let last = (intervals + 1e-9).floor();
            return bounded(last + 1.0)?.map(|k| Ok(number(from[0] + step * k))).collect();
        }
        _ => {
            return Err(
                "steps without their number; expected frames, 1 or more, or step for a single number".into(),
            );
        }
    };
    // With a loop, the end is the beginning and is not repeated.
    let intervals = if is_loop { count } else { (count - 1.0).max(1.0) };
    let at = |k: f64| -> String {
        let mix =
            |(a, b): (&f64, &f64)| number(if k == intervals { *b } else { a + (b - a) * (k / intervals) });
        from.iter().zip(&to).map(mix).collect::<Vec<_>>().join(" ")
    };
    Ok(bounded(count)?.map(at).collect())
}

fn bounded(count: f64) -> Result<impl Iterator<Item = f64>, String> {
    if count > MOST_JOBS as f64 {
        return Err(format!("{count} values; expected at most {MOST_JOBS}"));
    }
    Ok((0..count as u32).map(f64::from))
}

/// Shortest form that reads back as the same number.
fn number(value: f64) -> String {
    (value + 0.0).to_string()
}

fn numbers(value: &DeValue) -> Result<Vec<f64>, String> {
    let one = |value: &DeValue| -> Result<f64, String> {
        let text = match value {
            DeValue::Integer(_) | DeValue::Float(_) => text_of(value)?,
            other => return Err(format!("a {}; expected a number", other.type_str())),
        };
        text.parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
            .ok_or(format!("{text}; expected a number"))
    };
    match value {
        DeValue::Array(values) => values.iter().map(|value| one(value.get_ref())).collect(),
        value => Ok(vec![one(value)?]),
    }
}

/// How axes go together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Combine {
    /// Every value of one with every value of the others, the last axis fastest.
    Cross,
    /// The first values, then the second ones.
    Zip,
}

/// The combinations, each with a value for every axis.
pub(super) fn combinations(axes: &[Axis], combine: Combine) -> Result<Vec<Vec<(String, String)>>, String> {
    let pick = |indices: &[usize]| {
        axes.iter().zip(indices).map(|(axis, &i)| (axis.name.clone(), axis.values[i].clone())).collect()
    };
    match combine {
        Combine::Zip => {
            let Some(first) = axes.first() else { return Ok(vec![Vec::new()]) };
            if let Some(other) = axes.iter().find(|axis| axis.values.len() != first.values.len()) {
                return Err(format!(
                    "\"{}\" has {} values and \"{}\" has {}; expected as many of both with combine = \"zip\"",
                    first.name,
                    first.values.len(),
                    other.name,
                    other.values.len()
                ));
            }
            Ok((0..first.values.len()).map(|i| pick(&vec![i; axes.len()])).collect())
        }
        Combine::Cross => {
            let count = axes.iter().try_fold(1usize, |n, axis| n.checked_mul(axis.values.len()));
            let count = count.filter(|count| *count <= MOST_JOBS);
            let count = count.ok_or(format!("too many combinations; expected at most {MOST_JOBS}"))?;
            let indices = |mut k: usize| {
                let mut indices = vec![0; axes.len()];
                for (index, axis) in indices.iter_mut().zip(axes).rev() {
                    *index = k % axis.values.len();
                    k /= axis.values.len();
                }
                indices
            };
            Ok((0..count).map(|k| pick(&indices(k))).collect())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Vec<String>, String> {
        let value = DeValue::parse(text).unwrap();
        values(value.get_ref())
    }

    #[test]
    fn lists_and_steps() {
        assert_eq!(parse("[20, 0x19, 3e1, \"x\"]").unwrap(), ["20", "25", "3e1", "x"]);
        assert_eq!(parse("[[0, 1], [2, 3.5]]").unwrap(), ["0 1", "2 3.5"]);
        assert_eq!(
            parse("{ from = 0, to = 360, frames = 4, loop = true }").unwrap(),
            ["0", "90", "180", "270"]
        );
        assert_eq!(parse("{ from = 1, to = 2, frames = 3 }").unwrap(), ["1", "1.5", "2"]);
        assert_eq!(parse("{ from = [0, 1], to = [1, 0], frames = 2 }").unwrap(), ["0 1", "1 0"]);
        assert_eq!(parse("{ from = 0, to = 0.3, step = 0.1 }").unwrap().len(), 4);
        assert_eq!(parse("{ from = 5, to = 6, frames = 1 }").unwrap(), ["5"]);
        for (wrong, message) in [
            ("[]", "empty list"),
            ("3", "expected a list"),
            ("{ from = 0 }", "from and to"),
            ("{ from = 0, to = 1 }", "expected frames"),
            ("{ from = 0, to = 1, frames = 0 }", "1 or more"),
            ("{ from = 0, to = 1, frames = 1e9 }", "at most"),
            ("{ from = 0, to = 1, step = -1 }", "does not lead"),
            ("{ from = 0, to = 1, step = 0 }", "does not lead"),
            ("{ from = [0, 1], to = 1, frames = 2 }", "different lengths"),
            ("{ from = 0, to = 1, frames = 2, closed = true }", "\"closed\""),
            ("{ from = nan, to = 1, frames = 2 }", "expected a number"),
        ] {
            let error = parse(wrong).unwrap_err();
            assert!(error.contains(message), "{wrong}: {error}");
        }
    }

    #[test]
    fn axes_go_together() {
        let axis = |name: &str, values: &[&str]| Axis {
            name: name.into(),
            values: values.iter().map(|value| value.to_string()).collect(),
        };
        let axes = [axis("a", &["1", "2"]), axis("b", &["x", "y", "z"])];
        let crossed = combinations(&axes, Combine::Cross).unwrap();
        assert_eq!(crossed.len(), 6);
        assert_eq!(crossed[4], [("a".into(), "2".into()), ("b".into(), "y".into())]);
        assert!(combinations(&axes, Combine::Zip).unwrap_err().contains("\"a\" has 2"));
        let axes = [axis("a", &["1", "2"]), axis("b", &["x", "y"])];
        assert_eq!(combinations(&axes, Combine::Zip).unwrap().len(), 2);
        for combine in [Combine::Zip, Combine::Cross] {
            assert_eq!(combinations(&[], combine).unwrap(), [vec![]]);
        }
        let long = axis("n", &["0"; 1000]);
        assert!(combinations(&[long.clone(), long], Combine::Cross).is_err());
    }
}
