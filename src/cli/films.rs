//! `wavepath merge`, `info` and `split`: films as files.

use std::fmt::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::output::{self, Voice};
use super::part_args::{InfoArgs, MergeArgs, SplitArgs};
use super::{Failure, render};
use crate::film::Film;
use crate::film_file::{About, FilmFile, FilmFileError, Gap, Holding};
use crate::picture::{self, ImageFormat};
use serde_json::json;

/// Whether a name is that of a film file.
pub(super) fn is_film(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("film"))
}

impl From<FilmFileError> for Failure {
    fn from(error: FilmFileError) -> Self {
        Failure::Input(error.to_string())
    }
}

/// Adds films.
pub(super) fn merge(args: &MergeArgs) -> Result<(), Failure> {
    let (films, images): (Vec<&Path>, Vec<&Path>) =
        args.output.iter().map(PathBuf::as_path).partition(|path| is_film(path));
    images.iter().try_for_each(|path| output::check_image(path))?;
    films.iter().try_for_each(|path| output::check_film(path))?;
    let outputs: Vec<(&str, &Path)> = args
        .output
        .iter()
        .map(|path| ("-o", path.as_path()))
        .chain(args.report.iter().map(|path| ("--report", path.as_path())))
        .collect();
    if let Some(path) = &args.report {
        output::check_report(path)?;
    }
    output::check_distinct(&outputs, &args.parts)?;
    output::check_clobber(&outputs, args.no_clobber)?;
    let paths: Vec<&Path> = outputs.iter().map(|(_, path)| *path).collect();
    let voice = Voice::new(args.quiet, &paths);
    let merged = FilmFile::merge(&args.parts)?;
    let about = &merged.about;
    let gaps = gaps_of(&merged);
    if let Some(text) = tell_gaps(&merged.film, about, &gaps, args.output.iter().find(|path| is_film(path))) {
        if args.complete {
            return Err(Failure::Work(format!("{text}\nnothing is written")));
        }
        if !args.quiet {
            output::note(format_args!("warning: {text}"));
        }
    }
    let seeds = merged.film.header().seeds().count();
    if seeds > 1 && !args.quiet {
        output::note(format_args!(
            "note: renders of {seeds} seeds are independent of each other: each sample counts the same, and the estimate of \
             the error holds. It is not the picture, to the bit, of one render with as many samples, which would have less noise"
        ));
    }
    for path in &films {
        merged.write(path).map_err(|error| failed(path, &error))?;
    }
    let half = about.half;
    let picture = merged.into_picture();
    let layers = if args.layers { picture.layers() } else { Vec::new() };
    let report = picture.report().clone();
    let mut image = picture.into_image();
    image.channels.extend(layers);
    let encoding = args.encoding.encoding(half);
    images.iter().try_for_each(|path| picture::write_encoded(path, &image, &encoding))?;
    if let Some(path) = &args.report {
        output::write_report(path, &report)?;
    }
    voice.tell(&report)?;
    args.output.iter().try_for_each(|path| voice.wrote(path))
}

/// A film file could not be written.
pub(super) fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::Work(format!("cannot write film \"{}\": {error}", path.display()))
}

/// What a film lacks; of several seeds or uneven samples nothing can be said.
fn gaps_of(file: &FilmFile) -> Vec<Gap> {
    let is_plain = file.film.header().more_seeds.is_empty() && !file.about.adaptive;
    if is_plain { Gap::of(&file.film, file.about.target) } else { Vec::new() }
}

/// Says what is missing, with the commands that render it.
fn tell_gaps(film: &Film, about: &About, gaps: &[Gap], merged: Option<&PathBuf>) -> Option<String> {
    if gaps.is_empty() {
        return None;
    }
    let blocks = film.blocks().len();
    let samples: u64 = gaps
        .iter()
        .map(|gap| {
            let pixels: usize = gap.blocks.iter().map(|block| film.blocks()[*block].pixels()).sum();
            gap.samples.len() as u64 * pixels as u64
        })
        .sum();
    let mut text = format!("{} samples are missing:", crate::report::count(samples));
    let mut commands = Vec::new();
    let mut is_whole = true;
    for gap in gaps {
        let Range { start, end } = gap.samples;
        let part = match gap.blocks.len() == blocks {
            true => "all pixels".to_string(),
            false => format!("{} of {blocks} blocks of pixels", gap.blocks.len()),
        };
        let _ = write!(text, "\n  samples {start}..{end} of {part}");
        if gap.blocks.len() == blocks {
            commands.push(format!("--samples {start}..{end}"));
            continue;
        }
        // Whole parts that are blocks of pixels.
        let tiles = about.tile.map_or(1, |[_, count]| count as usize);
        let of_tile = |tile: usize| (tile..blocks).step_by(tiles);
        let lacks = |tile: &usize| of_tile(*tile).all(|block| gap.blocks.binary_search(&block).is_ok());
        let lacking: Vec<usize> = (0..tiles.min(blocks)).filter(lacks).collect();
        let named: usize = lacking.iter().map(|tile| of_tile(*tile).count()).sum();
        is_whole &= named == gap.blocks.len();
        for tile in lacking {
            let samples =
                if start == 0 { format!("--spp {end}") } else { format!("--samples {start}..{end}") };
            commands.push(format!("{samples} --part {}/{tiles} --tiles", tile + 1));
        }
    }
    let base = base_command(about);
    if !commands.is_empty() && is_whole {
        text += "\nThese commands render it:";
        for (number, options) in commands.iter().enumerate() {
            let _ = write!(text, "\n  {base} {options} -o missing-{}.film", number + 1);
        }
    } else {
        let film = merged.map_or("MERGED.film".to_string(), |path| quoted(&path.display().to_string()));
        let target = about.target.map(|target| format!(" --spp {target}")).unwrap_or_default();
        let _ = write!(text, "\nThis command renders it:\n  {base}{target} --resume {film}");
    }
    Some(text)
}

/// A command that renders what a film shows, without its part and its files.
fn base_command(about: &About) -> String {
    let mut words = vec!["wavepath".to_string(), "render".to_string()];
    match about.command.is_empty() {
        true => words.push(about.report.scene.clone()),
        false => {
            let mut skip = false;
            for word in &about.command {
                // The number of samples comes with the part.
                let is_spp = word == "--spp";
                if !skip && !is_spp && !word.starts_with("--spp=") {
                    words.push(word.clone());
                }
                skip = is_spp;
            }
        }
    }
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=@%+".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_string()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// Options of render that belong to one run of many; those with a value.
const OF_ONE_RUN: [&str; 11] = [
    "--output",
    "--samples",
    "--part",
    "--checkpoint",
    "--checkpoint-every",
    "--resume",
    "--report",
    "--save-every",
    "--progress",
    "--threads",
    "--tev",
];

/// The same without a value.
const OF_ONE_RUN_ALONE: [&str; 6] =
    ["--tiles", "--resume-if-there", "--checkpoint-until-done", "--quiet", "-q", "--no-clobber"];

/// The words of a command line behind `render` that other parts of the same render have, too.
pub(super) fn common_words(words: impl Iterator<Item = String>) -> Vec<String> {
    let (mut common, mut skip) = (Vec::new(), false);
    for word in words {
        let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
        if std::mem::take(&mut skip) || OF_ONE_RUN_ALONE.contains(&word.as_str()) {
            continue;
        }
        if OF_ONE_RUN.contains(&name) || word == "-o" {
            skip = !word.contains('=');
            continue;
        }
        if word.starts_with("-o") {
            continue;
        }
        common.push(word);
    }
    common
}

/// Says what a file holds.
pub(super) fn info(args: &InfoArgs) -> Result<(), Failure> {
    let path = &args.file;
    if !is_film(path) && ImageFormat::from_path(path).is_ok() {
        return info_of_picture(args);
    }
    let bytes = std::fs::metadata(path).map(|metadata| metadata.len()).unwrap_or(0);
    let file = FilmFile::read(path)?;
    let gaps = gaps_of(&file);
    let missing = tell_gaps(&file.film, &file.about, &gaps, Some(path));
    let round = file.round.clone();
    let entries: Vec<(String, String)> =
        file.identity.entries().map(|(name, value)| (name.to_string(), value.to_string())).collect();
    let (adaptive, target, tile) = (file.about.adaptive, file.about.target, file.about.tile);
    let holdings = Holding::of(&file.film);
    let picture = file.into_picture();
    let (film, report) = (picture.film(), picture.report());
    let header = film.header();
    let [least, most] = film.sample_range();
    let frame = header.frame;
    if args.json {
        let holdings: Vec<_> = holdings
            .iter()
            .map(|holding| {
                let samples: Vec<_> =
                    holding.samples.iter().map(|range| json!([range.start, range.end])).collect();
                json!({ "seed": holding.seed, "samples": samples, "blocks": holding.blocks.len() })
            })
            .collect();
        let gaps: Vec<_> = gaps
            .iter()
            .map(|gap| json!({ "samples": [gap.samples.start, gap.samples.end], "blocks": gap.blocks.len() }))
            .collect();
        let channels: Vec<&str> = header.channels.iter().map(|row| row.name).collect();
        let identity: serde_json::Map<String, serde_json::Value> =
            entries.into_iter().map(|(name, value)| (name, value.into())).collect();
        return output::say(format_args!(
            "{:#}",
            json!({
                "file": path.display().to_string(),
                "bytes": bytes,
                "width": frame.image_width,
                "height": frame.image_height,
                "pixels": frame.bounds,
                "channels": channels,
                "sampler": header.sampler.name(),
                "seeds": header.seeds().collect::<Vec<_>>(),
                "estimator": header.estimator,
                "arithmetic": header.arithmetic,
                "adaptive": adaptive,
                "target": target,
                "tile": tile,
                "samples": report.samples,
                "least_spp": least,
                "most_spp": most,
                "blocks": film.blocks().len(),
                "holds": holdings,
                "missing": gaps,
                "round": round.map(|round| json!({ "from": round.from, "to": round.to })),
                "estimated_relmse": report.estimated_relmse,
                "report": report,
                "depends_on": identity,
            })
        ));
    }
    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "{name:<16}  {value}");
    };
    let [x0, x1, y0, y1] = frame.bounds;
    row("film", format!("{}, {bytes} bytes", path.display()));
    row("scene", report.scene.clone());
    row("image", format!("{} x {}, pixels {x0},{x1},{y0},{y1}", frame.image_width, frame.image_height));
    row("channels", header.channels.iter().map(|row| row.name).collect::<Vec<_>>().join(", "));
    let seeds: Vec<String> = header.seeds().map(|seed| seed.to_string()).collect();
    row("random numbers", format!("{}, seed {}", header.sampler.name(), seeds.join(", ")));
    row(
        "estimator",
        format!("{}, {}{}", header.estimator, header.arithmetic, if adaptive { ", adaptive" } else { "" }),
    );
    let spread = if least == most { least.to_string() } else { format!("{least} to {most}") };
    let target = target.map(|target| format!(" of {target}")).unwrap_or_default();
    row("samples", format!("{}, {spread}{target} a pixel", crate::report::count(report.samples)));
    if adaptive {
        row("", "spread by the error".into());
    } else {
        for holding in holdings.iter().take(16) {
            let ranges: Vec<String> =
                holding.samples.iter().map(|range| format!("{}..{}", range.start, range.end)).collect();
            let ranges = if ranges.is_empty() { "none".into() } else { ranges.join(", ") };
            let seed = if seeds.len() > 1 { format!(" of seed {}", holding.seed) } else { String::new() };
            row("", format!("{ranges}{seed}: {} of {} blocks", holding.blocks.len(), film.blocks().len()));
        }
        if holdings.len() > 16 {
            row("", format!("and {} other sets of samples", holdings.len() - 16));
        }
    }
    if let Some(round) = round {
        row("round", format!("{} to {} samples a pixel", round.from, round.to));
    }
    match (report.estimated_relmse, report.estimated_relmse_interval) {
        (Some(error), Some([low, high])) => {
            row("relMSE", format!("{error:.3e} (estimated; 95 %: {low:.3e} to {high:.3e})"));
        }
        _ => row("relMSE", "unknown".into()),
    }
    row("time", format!("{:.1} s rendering", report.seconds));
    row("by", format!("wavepath {}, {}, {}", report.version, report.cpu, report.isa));
    if let Some(missing) = missing {
        let _ = write!(text, "{missing}");
    }
    output::say(text.trim_end())
}

fn info_of_picture(args: &InfoArgs) -> Result<(), Failure> {
    let metadata = picture::read_metadata(&args.file)?;
    let Some(report) = metadata.report else {
        let what =
            format!("\"{}\" does not say how it was made: it is no picture of wavepath", args.file.display());
        return Err(Failure::Input(what));
    };
    if args.json {
        return output::say(report);
    }
    match serde_json::from_str::<crate::report::Report>(&report) {
        Ok(report) => output::say(report),
        Err(_) => output::say(report),
    }
}

/// Prints a command for each part, and the one that merges them.
pub(super) fn split(args: &SplitArgs) -> Result<(), Failure> {
    if let Some(word) = args.options.iter().find(|word| {
        let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
        ["--adaptive", "--error", "--time", "--samples", "--part", "--tiles", "-o", "--output"]
            .contains(&name)
    }) {
        return Err(Failure::Usage(format!(
            "{word}: parts cannot have it; expected options that all parts share"
        )));
    }
    let picture = match &args.output {
        Some(path) => {
            output::check_image(path)?;
            path.clone()
        }
        None => render::named_after(&args.scene),
    };
    let stem = picture.with_extension("");
    let digits = args.parts.to_string().len();
    let part = |number: u32| quoted(&format!("{}-{number:0digits$}.film", stem.display()));
    let scene = quoted(&args.scene.display().to_string());
    let options: String = args.options.iter().map(|word| format!(" {}", quoted(word))).collect();
    let tiles = if args.tiles { " --tiles" } else { "" };
    let mut text = String::new();
    for number in 1..=args.parts {
        let file = part(number);
        let _ = writeln!(
            text,
            "wavepath render {scene}{options} --part {number}/{}{tiles} -o {file}",
            args.parts
        );
    }
    let parts: Vec<String> = (1..=args.parts).map(part).collect();
    let _ = write!(text, "wavepath merge -o {} {}", quoted(&picture.display().to_string()), parts.join(" "));
    output::say(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn common(words: &str) -> String {
        common_words(words.split(' ').map(String::from)).join(" ")
    }

    #[test]
    fn parts_have_words_in_common() {
        assert_eq!(common("a.pbrt --spp 64 -o a.film --part 1/3 --tiles -q"), "a.pbrt --spp 64");
        assert_eq!(common("-oa.film a.pbrt --output=b.film --samples 0..3 --seed 3"), "a.pbrt --seed 3");
        assert_eq!(common("--checkpoint c.film --resume-if-there a.pbrt --threads=3"), "a.pbrt");
    }

    #[test]
    fn words_are_quoted_for_shells() {
        assert_eq!(quoted("a/b-1.film"), "a/b-1.film");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
