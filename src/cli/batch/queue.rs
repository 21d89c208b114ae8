//! The file of a queue.
//!
//! ```toml
//! [defaults]                      # for all jobs
//! spp = 64
//!
//! [[job]]
//! scene = "box.pbrt"
//! output = "frames/{scene}.####.exr"
//! set = { light.0.scale = 2 }     # as --set
//! [job.sweep]                     # a job for each
//! camera.orbit = { from = 0, to = 360, frames = 36, loop = true }
//! ```
//!
//! What is not one of [`OWN`] is an option of `wavepath render` by its name, with `_` for `-`. Names of files are relative
//! to the queue.

use clap::Parser;
use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::super::{Cli, Command, Failure};
use super::Job;
use super::names::{self, Fields};
use super::sweep::{self, Axis, Combine, MOST_JOBS};
use crate::pbrt::{Diagnostic, Excerpt, Location, Severity, did_you_mean};

/// What the queue itself understands.
const OWN: [&str; 7] = ["name", "scene", "output", "set", "sweep", "combine", "first_frame"];

/// Options of `render` that are the queue's affair.
const RESERVED: [&str; 7] =
    ["quiet", "report", "checkpoint", "checkpoint-until-done", "resume", "resume-if-there", "progress"];

/// A place in the file, and what is wrong there.
struct Wrong {
    span: Range<usize>,
    message: String,
}

impl Wrong {
    fn at(span: Range<usize>, message: impl Into<String>) -> Wrong {
        Wrong { span, message: message.into() }
    }
}

type Result<T> = std::result::Result<T, Wrong>;

/// The jobs of a queue. `options` go to each of them.
pub(super) fn read(text: &str, file: &str, options: &[String]) -> std::result::Result<Vec<Job>, Failure> {
    let failure = |wrong: Wrong| Failure::Input(diagnostic(text, file, &wrong).to_string());
    let document = DeTable::parse(text).map_err(|error| {
        failure(Wrong::at(error.span().unwrap_or(0..0), error.message().replace('\n', ", ")))
    })?;
    jobs(document.get_ref(), options).map_err(failure)
}

/// What is wrong, with the line.
fn diagnostic(text: &str, file: &str, wrong: &Wrong) -> Diagnostic {
    let start =
        (0..=wrong.span.start.min(text.len())).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    let line_start = text[..start].rfind('\n').map_or(0, |at| at + 1);
    let line_end = text[start..].find(['\n', '\r']).map_or(text.len(), |at| start + at);
    let line = text[line_start..line_end].to_string();
    let before = text[line_start..start].chars().count();
    let end = wrong.span.end.clamp(start, line_end);
    let length = text.get(start..end).map_or(1, |marked| marked.chars().count().max(1));
    let (message, label) = wrong.message.split_once("; ").unwrap_or((&wrong.message, ""));
    let excerpt =
        (line.len() < 400).then_some(Excerpt { text: line, caret_start: before, caret_len: length });
    Diagnostic {
        severity: Severity::Error,
        message: message.into(),
        label: label.into(),
        location: Some(Location {
            file: file.into(),
            line: text[..line_start].matches('\n').count() as u32 + 1,
            column: before as u32 + 1,
            excerpt,
        }),
        notes: Vec::new(),
    }
}

/// Settings of a job, or the defaults: what stands in a table.
#[derive(Clone, Default)]
struct Settings<'a> {
    /// In the order of the file.
    entries: Vec<(String, &'a Spanned<DeValue<'a>>, Range<usize>)>,
}

impl<'a> Settings<'a> {
    fn of(table: &'a DeTable<'a>) -> Self {
        let mut entries: Vec<_> =
            table.iter().map(|(key, value)| (key.get_ref().to_string(), value, key.span())).collect();
        entries.sort_by_key(|(_, _, span)| span.start);
        Settings { entries }
    }

    fn get(&self, name: &str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.entries.iter().find(|(key, ..)| key == name).map(|(_, value, _)| *value)
    }

    fn string(&self, name: &str) -> Result<Option<String>> {
        let Some(value) = self.get(name) else { return Ok(None) };
        match value.get_ref().as_str() {
            Some(text) if !text.is_empty() => Ok(Some(text.to_string())),
            _ => Err(Wrong::at(value.span(), format!("\"{name}\" is no text; expected \"...\""))),
        }
    }
}

fn jobs(document: &DeTable, options: &[String]) -> Result<Vec<Job>> {
    let mut defaults = Settings::default();
    let mut tables: Vec<&Spanned<DeValue>> = Vec::new();
    for (key, value) in document.iter() {
        match (key.get_ref().as_ref(), value.get_ref()) {
            ("defaults", DeValue::Table(table)) => defaults = Settings::of(table),
            ("job", DeValue::Array(list)) => tables.extend(list.iter()),
            ("job", DeValue::Table(_)) => tables.push(value),
            (other, _) => {
                return Err(Wrong::at(
                    key.span(),
                    format!(
                        "unknown \"{other}\"; expected [defaults] and [[job]]{}",
                        did_you_mean(other, &["defaults", "job"])
                    ),
                ));
            }
        }
    }
    if tables.is_empty() {
        return Err(Wrong::at(0..0, "the queue has no jobs; expected [[job]] and a scene"));
    }
    let mut all: Vec<Job> = Vec::new();
    let mut names: HashMap<String, Range<usize>> = HashMap::new();
    let mut outputs: HashMap<PathBuf, String> = HashMap::new();
    for table in tables {
        let span = table.span();
        let DeValue::Table(own) = table.get_ref() else {
            return Err(Wrong::at(span, format!("a {}; expected [[job]]", table.get_ref().type_str())));
        };
        for job in jobs_of(&defaults, &Settings::of(own), &span, options)? {
            if all.len() >= MOST_JOBS {
                return Err(Wrong::at(span, format!("too many jobs; expected at most {MOST_JOBS}")));
            }
            if names.insert(job.name.to_lowercase(), span.clone()).is_some() {
                let message = format!("two jobs are called \"{}\"; expected a name for each", job.name);
                return Err(Wrong::at(span, message));
            }
            for output in &job.outputs {
                if let Some(other) = outputs.insert(output.clone(), job.name.clone()) {
                    return Err(Wrong::at(
                        span,
                        format!(
                            "\"{other}\" and \"{}\" both write \"{}\"; expected a pattern that tells them apart, \
                             such as ####, {{name}} or the name of what is swept",
                            job.name,
                            output.display()
                        ),
                    ));
                }
            }
            all.push(job);
        }
    }
    Ok(all)
}

/// The jobs that a table describes.
fn jobs_of(defaults: &Settings, own: &Settings, span: &Range<usize>, options: &[String]) -> Result<Vec<Job>> {
    let either = |name: &str| own.get(name).or_else(|| defaults.get(name));
    let string = |name: &str| -> Result<Option<String>> {
        own.string(name)?.map_or_else(|| defaults.string(name), |text| Ok(Some(text)))
    };
    let mut set: Vec<(String, String)> = Vec::new();
    for table in [defaults.get("set"), own.get("set")].into_iter().flatten() {
        for (name, value) in flat(table, |_| false)? {
            let text = sweep::text_of(value.get_ref())
                .map_err(|what| Wrong::at(value.span(), format!("\"{name}\" is {what}")))?;
            replace(&mut set, name, text);
        }
    }
    let mut render: Vec<(String, &Spanned<DeValue>, Range<usize>)> = Vec::new();
    for (key, value, place) in defaults.entries.iter().chain(&own.entries) {
        if OWN.contains(&key.as_str()) {
            continue;
        }
        let option = key.replace('_', "-");
        if RESERVED.contains(&option.as_str()) {
            return Err(Wrong::at(
                place.clone(),
                format!("\"{key}\" is the queue's affair; expected no such setting"),
            ));
        }
        render.retain(|(known, ..)| *known != option);
        render.push((option, *value, place.clone()));
    }
    let mut axes = Vec::new();
    if let Some(table) = either("sweep") {
        for (name, value) in flat(table, sweep::is_steps)? {
            let values = sweep::values(value.get_ref())
                .map_err(|what| Wrong::at(value.span(), format!("\"{name}\" is {what}")))?;
            axes.push(Axis { name, values });
        }
    }
    let combine = match string("combine")?.as_deref() {
        None | Some("cross") => Combine::Cross,
        Some("zip") => Combine::Zip,
        Some(other) => {
            let at = either("combine").map_or(span.clone(), Spanned::span);
            return Err(Wrong::at(at, format!("combine is \"{other}\"; expected \"cross\" or \"zip\"")));
        }
    };
    let first_frame = match either("first_frame") {
        None => 1,
        Some(value) => {
            let number = sweep::text_of(value.get_ref()).ok().and_then(|text| text.parse().ok());
            let expected = "first_frame is no number; expected 0 or more";
            number.ok_or(Wrong::at(value.span(), expected))?
        }
    };
    let combinations = sweep::combinations(&axes, combine).map_err(|what| {
        Wrong::at(either("sweep").map_or(span.clone(), Spanned::span), format!("the sweep: {what}"))
    })?;
    let is_swept = combinations.len() > 1;
    let patterns = outputs(either("output"))?;
    let mut jobs = Vec::new();
    for (index, swept) in combinations.into_iter().enumerate() {
        let of_sweep =
            |name: &str| swept.iter().find(|(known, _)| known == name).map(|(_, value)| value.clone());
        let Some(scene) = of_sweep("scene").map_or_else(|| string("scene"), |scene| Ok(Some(scene)))? else {
            return Err(Wrong::at(span.clone(), "a job without a scene; expected scene = \"...\""));
        };
        let mut set = set.clone();
        let mut values = vec![("scene".to_string(), stem(&scene))];
        let mut arguments = vec!["render".to_string(), scene.clone()];
        for (option, value, place) in &render {
            if of_sweep(option).is_some() || of_sweep(&option.replace('-', "_")).is_some() {
                continue;
            }
            let words = words(option, value)
                .map_err(|what| Wrong::at(place.clone(), format!("\"{option}\" is {what}")))?;
            if let [word] = words.as_slice() {
                values.push((
                    option.replace('-', "_"),
                    word.split_once('=').map_or("true", |w| w.1).to_string(),
                ));
            }
            arguments.extend(words);
        }
        for (name, value) in &swept {
            if name == "scene" {
                continue;
            }
            if name.contains('.') {
                replace(&mut set, name.clone(), value.clone());
            } else if OWN.contains(&name.as_str()) || RESERVED.contains(&name.as_str()) {
                let message =
                    format!("\"{name}\" in a sweep; expected an option of render, or a name with a dot");
                return Err(Wrong::at(either("sweep").map_or(span.clone(), Spanned::span), message));
            } else {
                let option = name.replace('_', "-");
                match value.as_str() {
                    "true" => arguments.push(format!("--{option}")),
                    "false" => {}
                    value => arguments.push(format!("--{option}={value}")),
                }
                values.push((name.clone(), value.clone()));
            }
        }
        arguments.extend(set.iter().map(|(name, value)| format!("--set={name}={value}")));
        arguments.extend(options.iter().cloned());
        values.extend(set);
        let frame = first_frame + index as u64;
        let fields = |values: &[(String, String)], pattern: &str| {
            names::fill(pattern, &Fields { frame, values }).map_err(|what| Wrong::at(span.clone(), what))
        };
        let pattern = string("name")?.unwrap_or("{scene}".into());
        let mut name = fields(&values, &pattern)?;
        let tells_apart = axes.iter().any(|axis| pattern.contains(&format!("{{{}}}", axis.name)));
        if is_swept && !names::has_frame(&pattern) && !tells_apart {
            name.push_str(&format!(".{frame:04}"));
        }
        let name = names::file_name(&name);
        values.push(("name".into(), name.clone()));
        let default = if is_swept { "{scene}.####.exr" } else { "{scene}.exr" };
        let own = if patterns.is_empty() { vec![default.to_string()] } else { patterns.clone() };
        let outputs: Vec<PathBuf> =
            own.iter().map(|pattern| fields(&values, pattern).map(PathBuf::from)).collect::<Result<_>>()?;
        let job = Job { name, arguments, outputs, swept };
        check(&job).map_err(|what| {
            let key = render.iter().find(|(option, ..)| what.contains(&format!("--{option}")));
            Wrong::at(key.map_or(span.clone(), |(.., place)| place.clone()), what)
        })?;
        jobs.push(job);
    }
    Ok(jobs)
}

/// Checks the arguments of a job, without looking at its scene.
pub(super) fn check(job: &Job) -> std::result::Result<(), String> {
    let outputs = job.outputs.iter().map(|output| format!("--output={}", output.display()));
    let words = ["wavepath".to_string()].into_iter().chain(job.arguments.iter().cloned()).chain(outputs);
    match Cli::try_parse_from(words) {
        Ok(Cli { command: Command::Render(_) }) => {}
        Ok(_) => return Err("no render; expected options of wavepath render".into()),
        Err(error) => {
            let message = error.to_string();
            let first = message.lines().next().unwrap_or_default();
            let tip = message.lines().find_map(|line| line.trim().strip_prefix("tip: "));
            let tip = tip.map(|tip| format!("; {tip}")).unwrap_or_default();
            return Err(format!("job \"{}\": {}{tip}", job.name, first.trim_start_matches("error: ")));
        }
    }
    match job.outputs.iter().find(|path| crate::atomic_file::is_standard_output(path)) {
        Some(path) => {
            Err(format!("the output \"{}\" is no file; expected a file for each job", path.display()))
        }
        None => Ok(()),
    }
}

/// The options that a setting stands for.
fn words(option: &str, value: &Spanned<DeValue>) -> std::result::Result<Vec<String>, String> {
    let joined =
        |by: &str| Ok(vec![format!("--{option}={}", sweep::text_of(value.get_ref())?.replace(' ', by))]);
    match (option, value.get_ref()) {
        (_, DeValue::Boolean(true)) => Ok(vec![format!("--{option}")]),
        (_, DeValue::Boolean(false)) => Ok(Vec::new()),
        ("resolution", DeValue::Array(_)) => joined("x"),
        ("crop" | "cropwindow" | "pixelbounds" | "aov", DeValue::Array(_)) => joined(","),
        (_, DeValue::Array(values)) => values
            .iter()
            .map(|value| Ok(format!("--{option}={}", sweep::text_of(value.get_ref())?)))
            .collect(),
        (_, value) => Ok(vec![format!("--{option}={}", sweep::text_of(value)?)]),
    }
}

/// Patterns of outputs: a text, or several.
fn outputs(value: Option<&Spanned<DeValue>>) -> Result<Vec<String>> {
    let Some(value) = value else { return Ok(Vec::new()) };
    let wrong =
        || Wrong::at(value.span(), "\"output\" is no name of a file; expected \"...\" or a list of such");
    let text = |value: &DeValue| {
        value.as_str().filter(|text| !text.is_empty()).map(str::to_string).ok_or_else(wrong)
    };
    match value.get_ref() {
        DeValue::Array(list) => list.iter().map(|value| text(value.get_ref())).collect(),
        one => Ok(vec![text(one)?]),
    }
}

/// Names with dots, and their values: `camera.fov = 3` is a table in a table for TOML.
fn flat<'a>(
    table: &'a Spanned<DeValue<'a>>,
    is_value: impl Fn(&DeTable) -> bool + Copy,
) -> Result<Vec<(String, &'a Spanned<DeValue<'a>>)>> {
    let DeValue::Table(_) = table.get_ref() else {
        let message = format!("a {}; expected names and values", table.get_ref().type_str());
        return Err(Wrong::at(table.span(), message));
    };
    fn walk<'a>(
        prefix: &str,
        value: &'a Spanned<DeValue<'a>>,
        is_value: impl Fn(&DeTable) -> bool + Copy,
        all: &mut Vec<(usize, String, &'a Spanned<DeValue<'a>>)>,
    ) {
        let DeValue::Table(table) = value.get_ref() else { return };
        for (key, value) in table.iter() {
            let name = if prefix.is_empty() {
                key.get_ref().to_string()
            } else {
                format!("{prefix}.{}", key.get_ref())
            };
            match value.get_ref() {
                DeValue::Table(inner) if !is_value(inner) => walk(&name, value, is_value, all),
                _ => all.push((key.span().start, name, value)),
            }
        }
    }
    let mut all = Vec::new();
    walk("", table, is_value, &mut all);
    all.sort_by_key(|(at, ..)| *at);
    Ok(all.into_iter().map(|(_, name, value)| (name, value)).collect())
}

fn replace(all: &mut Vec<(String, String)>, name: String, value: String) {
    match all.iter_mut().find(|(known, _)| *known == name) {
        Some((_, old)) => *old = value,
        None => all.push((name, value)),
    }
}

/// Name of a file without folder and ending.
pub(super) fn stem(scene: &str) -> String {
    let name = Path::new(scene).file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    [".pbrt", ".ply"].iter().find_map(|ending| name.strip_suffix(ending)).unwrap_or(name).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs(text: &str) -> Vec<Job> {
        read(text, "q.toml", &[]).unwrap_or_else(|failure| panic!("{failure}"))
    }

    #[test]
    fn defaults_settings_and_sweeps() {
        let jobs = jobs(
            r#"
            [defaults]
            spp = 64
            seed = 3
            set = { light.0.scale = 2, camera.fov = 30 }
            [[job]]
            scene = "a/box.pbrt"
            spp = 16
            adaptive = true
            resolution = [64, 32]
            set.camera.fov = 40
            output = ["out/{scene}.####.exr", "{name}.png"]
            first_frame = 0
            [job.sweep]
            sampler.pixelsamples = [1, 2]
            camera.orbit = { from = 0, to = 360, frames = 3, loop = true }
            [[job]]
            scene = "b.pbrt.gz"
            "#,
        );
        assert_eq!(jobs.len(), 7);
        assert_eq!(
            jobs[4].arguments,
            [
                "render",
                "a/box.pbrt",
                "--seed=3",
                "--spp=16",
                "--adaptive",
                "--resolution=64x32",
                "--set=light.0.scale=2",
                "--set=camera.fov=40",
                "--set=sampler.pixelsamples=2",
                "--set=camera.orbit=120"
            ]
        );
        assert_eq!(jobs[4].name, "box.0004");
        assert_eq!(jobs[4].outputs, [PathBuf::from("out/box.0004.exr"), "box.0004.png".into()]);
        assert_eq!((jobs[6].name.as_str(), &jobs[6].outputs[..]), ("b", &[PathBuf::from("b.exr")][..]));
        let zipped = self::jobs(
            "[[job]]\nname = 'k{seed}'\ncombine = 'zip'\nsweep = { seed = [1, 2], scene = ['a.pbrt', 'b.pbrt'] }",
        );
        assert_eq!(zipped[1].arguments, ["render", "b.pbrt", "--seed=2"]);
        assert_eq!(zipped[1].name, "k2");
    }

    #[test]
    fn mistakes_have_a_place() {
        for (text, place, message) in [
            ("[[job]]\nscene = 3", "q.toml:2:9", "\"scene\" is no text"),
            ("[[job]]\nscene = ", "q.toml:2:", "expected"),
            ("[[jobs]]\nscene = 'a.pbrt'", "q.toml:1:3", "did you mean \"job\"?"),
            ("", "q.toml:1:1", "no jobs"),
            ("[[job]]\nspp = 3", "q.toml:1:1", "without a scene"),
            ("[[job]]\nscene = 'a.pbrt'\nssp = 3", "q.toml:3:1", "--ssp"),
            ("[[job]]\nscene = 'a.pbrt'\nspp = 0", "q.toml:3:1", "from 1 to"),
            ("[[job]]\nscene = 'a.pbrt'\nquiet = true", "q.toml:3:1", "queue's affair"),
            ("[[job]]\nscene = 'a.pbrt'\nset = { a.b = {} }\nsweep = 3", "q.toml:4:9", "expected names"),
            ("[[job]]\nscene = 'a.pbrt'\nsweep.camera.fov = []", "q.toml:3:20", "empty list"),
            ("[[job]]\nscene = 'a.pbrt'\noutput = 'a.exr'\nsweep.seed = [1, 2]", "q.toml:1:1", "both write"),
            (
                "[[job]]\nscene = 'a.pbrt'\n[[job]]\nscene = 'b/a.pbrt'",
                "q.toml:3:1",
                "two jobs are called \"a\"",
            ),
            ("[[job]]\nscene = 'a.pbrt'\noutput = '{nme}.exr'", "q.toml:1:1", "expected frame, scene"),
            ("[[job]]\nscene = 'a.pbrt'\noutput = '-'", "q.toml:1:1", "no file"),
        ] {
            let error = read(text, "q.toml", &[]).unwrap_err();
            assert_eq!(error.exit_code(), 2);
            let error = error.to_string();
            assert!(error.contains(place) && error.contains(message), "{text}: {error}");
        }
    }
}
