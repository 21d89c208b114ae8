//! The report as one page that needs nothing beside it: no network, no other file.
//!
//! Text, tables, plots and still pictures are there without scripts; a script adds the viewer. It compares any two
//! pictures by flipping and with a slider, at any exposure and size, reads out pixels and shows error maps, from the
//! pictures' own linear values.

use std::fmt::Write;

use super::escape::{markup, script_json};
use super::figures::{number, seconds};
use super::pictures::{Gallery, ramp};
use super::plots::{self, Against};
use super::sentences::sentences;
use super::summary::Summary;
use super::table::{self, Figures};
use super::{Experiment, Measure};
use crate::compare::EPSILON;
use crate::picture::Image;

pub use super::pictures::{Picture, PictureError};

const PAGE: &str = include_str!("report/page.html");
const IMAGES: &str = include_str!("report/images.html");
const STYLE: &str = include_str!("report/page.css");
const SCRIPT: &str = include_str!("report/page.js");

/// The whole page. `summaries` holds one summary for each measure to plot; headlines and tables are of the first one.
///
/// A page without pictures has no viewer.
///
/// # Errors
/// [`PictureError`] if the pictures and the reference do not fit each other.
///
/// # Panics
/// If `summaries` is empty.
pub fn write(
    experiment: &Experiment,
    summaries: &[Summary],
    reference: &Image,
    pictures: &[Picture],
) -> Result<String, PictureError> {
    let summary = summaries.first().expect("one measure or more");
    let gallery = Gallery::of(reference, pictures)?;
    let ratios = Figures::ratios(experiment, summary);
    let images = gallery.as_ref().map(images);
    let (images, data) = images.unwrap_or_default();
    let version = format!("wavepath {}", experiment.version);
    Ok(fill(
        PAGE,
        &[
            ("generator", &markup(&version)),
            ("title", &markup(&format!("{}: error against run time", experiment.scene))),
            ("style", STYLE),
            ("scene", &markup(&experiment.scene)),
            ("facts", &markup(&facts(experiment))),
            ("sentences", &list(&sentences(experiment, summary))),
            (
                "figures",
                &html_table(&Figures::of(summary), "Each variant: error, how fast it falls, what it costs"),
            ),
            (
                "ratios",
                &if ratios.rows.is_empty() { String::new() } else { details("Ratios of every two", &ratios) },
            ),
            ("error_plots", &error_plots(experiment, summaries)),
            ("efficiency_plot", &plots::efficiency(experiment, summary)),
            ("stages_plot", &plots::stages(experiment, summary)),
            ("images", &images),
            (
                "checks",
                &html_table(
                    &Figures::checks(summary),
                    "Each variant: bias, brightness, and the error that it estimates itself",
                ),
            ),
            ("method", &method(experiment)),
            ("data", &data),
            ("script", SCRIPT),
        ],
    ))
}

/// Puts values where the template has `{{name}}`. What is put in is not looked at again.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut parts = template.split("{{");
    let mut page = parts.next().unwrap_or_default().to_string();
    for part in parts {
        let (name, rest) = part.split_once("}}").expect("the template closes its braces");
        let value = values.iter().find(|value| value.0 == name);
        page.push_str(value.unwrap_or_else(|| panic!("the template asks for {name}")).1);
        page.push_str(rest);
    }
    page
}

fn facts(experiment: &Experiment) -> String {
    let Experiment { width, height, machine, .. } = experiment;
    let plural = if machine.threads == 1 { "" } else { "s" };
    format!("{width} × {height} pixels; {}, {} thread{plural}, {}", machine.cpu, machine.threads, machine.isa)
}

fn list(sentences: &[String]) -> String {
    sentences.iter().map(|sentence| format!("<li>{}</li>\n", cell(sentence))).collect()
}

/// Text for people: signs as they are printed.
fn cell(text: &str) -> String {
    // A hyphen is a minus sign before a digit, unless it joins words or belongs to an exponent.
    let mut printed = String::with_capacity(text.len());
    let mut before = ' ';
    let spaced = text.replace("+-", "±");
    let mut characters = spaced.chars().peekable();
    while let Some(character) = characters.next() {
        let negative = character == '-'
            && (before == ' ' || before == '(' || before == '.')
            && characters.peek().is_some_and(char::is_ascii_digit);
        printed.push(if negative { '−' } else { character });
        before = character;
    }
    markup(&printed)
}

fn html_table(figures: &Figures, caption: &str) -> String {
    let mut html = String::from("<table>");
    write!(html, "<caption>{}</caption>", cell(caption)).expect(STRING);
    html.push_str("<thead><tr>");
    for head in &figures.heads {
        write!(html, "<th scope=\"col\">{}</th>", cell(head)).expect(STRING);
    }
    html.push_str("</tr></thead><tbody>\n");
    for row in &figures.rows {
        html.push_str("<tr>");
        for (column, text) in row.iter().enumerate() {
            let text = if text == "-" { "–".to_string() } else { cell(text) };
            match column {
                0 => write!(html, "<th scope=\"row\">{text}</th>").expect(STRING),
                _ => write!(html, "<td>{text}</td>").expect(STRING),
            }
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody></table>");
    html
}

const STRING: &str = "a string takes everything";

fn details(title: &str, figures: &Figures) -> String {
    let (title, table) = (markup(title), html_table(figures, title));
    format!("<details open><summary>{title}</summary><div class=\"scroll\">{table}</div></details>")
}

fn error_plots(experiment: &Experiment, summaries: &[Summary]) -> String {
    let figure = |title: &str, plot: &str| {
        format!("<figure class=\"plot\" data-title=\"{}\">\n{plot}</figure>\n", markup(title))
    };
    let of_measure = |summary: &Summary| {
        figure(summary.measure.name(), &plots::error(experiment, summary, Against::Seconds))
    };
    let mut figures: String = summaries.iter().map(of_measure).collect();
    let first = summaries.iter().find(|summary| summary.measure == Measure::Relmse);
    if let Some(summary) = first {
        let title = format!("{} against samples", summary.measure.name());
        figures.push_str(&figure(&title, &plots::error(experiment, summary, Against::Spp)));
    }
    figures
}

fn method(experiment: &Experiment) -> String {
    let Experiment { machine, version, commit, command_line, .. } = experiment;
    let commit = commit.as_ref().map_or_else(String::new, |commit| format!(", commit {commit}"));
    let words: Vec<String> = command_line.iter().map(|word| shell_word(word)).collect();
    let seeds: Vec<String> = experiment
        .variants
        .iter()
        .map(|variant| {
            let seeds: Vec<String> = variant.runs.iter().map(|run| run.seed.to_string()).collect();
            let settings = variant.settings.iter().map(|(name, value)| format!(", {name} {value}"));
            format!(
                "{}: {}, {}{}; seeds {}",
                variant.name,
                variant.engine,
                variant.sampler,
                settings.collect::<String>(),
                seeds.join(", ")
            )
        })
        .collect();
    let mut rows = vec![
        ("command", format!("<code>{}</code>", markup(&words.join(" ")))),
        ("program", markup(&format!("wavepath {version}{commit}"))),
        ("processor", markup(&format!("{}, {}", machine.cpu, machine.isa))),
        ("threads", machine.threads.to_string()),
        ("system", markup(&machine.os)),
        ("reference", markup(&table::reference(experiment))),
        ("variants", seeds.iter().map(|seeds| markup(seeds)).collect::<Vec<_>>().join("<br>")),
    ];
    let external = |external: &super::External| {
        markup(&format!("{}: {}, {}", external.name, seconds(external.seconds), external.file))
    };
    if !experiment.externals.is_empty() {
        let externals: Vec<String> = experiment.externals.iter().map(external).collect();
        rows.push(("other programs", externals.join("<br>")));
    }
    rows.iter().map(|(term, value)| format!("<dt>{term}</dt><dd>{value}</dd>\n")).collect()
}

/// A word of a command line as a shell would have to read it.
fn shell_word(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// The section with the images, and the data that its viewer reads.
fn images(gallery: &Gallery) -> (String, String) {
    let reduced = |factor: u32| match factor {
        1 => String::new(),
        factor => format!(" Each pixel is the mean of {factor} × {factor} pixels of the image."),
    };
    let section = fill(
        IMAGES,
        &[
            ("scale", &scale(gallery.scale)),
            ("viewer_note", &reduced(gallery.viewer_factor)),
            ("stills_note", &reduced(gallery.still_factor)),
            ("stills", &stills(gallery)),
        ],
    );
    let (low, high) = gallery.scale;
    let (width, height) = gallery.viewer_size;
    let names: Vec<&str> = gallery.entries.iter().map(|entry| entry.name.as_str()).collect();
    let heat: Vec<u8> = ramp(256).flatten().collect();
    let config = serde_json::json!({
        "width": width, "height": height, "names": names, "low": low, "high": high, "heat": heat, "epsilon": EPSILON,
    });
    let config = script_json(&config.to_string());
    let mut data = format!("<script type=\"application/json\" id=\"config\">{config}</script>\n");
    for (index, entry) in gallery.entries.iter().enumerate() {
        let halves = &entry.halves;
        writeln!(data, "<script type=\"text/plain\" id=\"pixels-{index}\">{halves}</script>").expect(STRING);
    }
    (section, data)
}

fn stills(gallery: &Gallery) -> String {
    let mut html = String::new();
    for entry in &gallery.entries {
        let name = markup(&entry.name);
        write!(html, "<figure><img alt=\"{name}\" src=\"data:image/png;base64,{}\">", entry.still)
            .expect(STRING);
        if let Some(map) = &entry.error_map {
            write!(html, "<img alt=\"error map of {name}\" src=\"data:image/png;base64,{map}\">")
                .expect(STRING);
        }
        let relmse = entry.relmse.map(|relmse| format!("relMSE {}", number(relmse)));
        let facts = [entry.caption.clone(), relmse.unwrap_or_default()];
        let facts: Vec<String> = facts.into_iter().filter(|fact| !fact.is_empty()).collect();
        let facts = cell(&facts.join(", "));
        writeln!(html, "<figcaption><strong>{name}</strong> <span>{facts}</span></figcaption></figure>")
            .expect(STRING);
    }
    html
}

/// The colours of the error maps from the low to the high end, with a tick at each decade.
fn scale((low, high): (i32, i32)) -> String {
    let colours: Vec<String> = ramp(33).map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    let tick = |decade: i32| format!("<span>10<sup>{}</sup></span>", decade.to_string().replace('-', "−"));
    let ticks: String = (low..=high).map(tick).collect();
    format!(
        "<div class=\"ramp\" style=\"background:linear-gradient(90deg,{})\"></div><div class=\"ticks\">{ticks}</div>\
         <div>relative squared error of a pixel</div>",
        colours.join(",")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::synthetic;

    fn page(experiment: &Experiment, reference: &Image, images: &[(String, Image)]) -> String {
        let pictures: Vec<Picture> =
            images.iter().map(|(name, image)| Picture { name, caption: "8.00 s, seed 1", image }).collect();
        let summaries = Measure::ALL.map(|measure| Summary::of(experiment, measure));
        write(experiment, &summaries, reference, &pictures).unwrap()
    }

    #[test]
    fn the_page_needs_nothing_from_outside() {
        let (experiment, reference, images) = synthetic::full();
        let page = page(&experiment, &reference, &images);
        let without_namespace = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for outside in ["http:", "https:", "//cdn", "@import", "url(", "src=\"/", "<iframe", "<object"] {
            assert!(!without_namespace.contains(outside), "{outside}");
        }
        let sources = page.split("src=\"").skip(1);
        assert!(
            sources.clone().count() >= 11
                && sources.clone().all(|source| source.starts_with("data:image/png;base64,"))
        );
        assert!(!page.contains("{{"), "the template is filled");
        for part in [
            "17.5 (16.2..18.9) times less relMSE",
            "8.00 s, seed 1, relMSE",
            "&#39;a folder&#39;",
            "0123abc",
            "seeds 1, 2, 3, 4, 5",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(page.contains("−1.08 ± 0.04"), "{}", page.len());
    }

    #[test]
    fn text_from_outside_stays_text() {
        let (mut experiment, reference, mut images) = synthetic::full();
        let evil = "</script><script>alert(1)</script>{{style}}<img src=x onerror=alert(1)>\" onload=\"x";
        experiment.scene = evil.into();
        experiment.variants[0].name = evil.into();
        experiment.variants[0].settings[0].1 = evil.into();
        experiment.machine.cpu = evil.into();
        experiment.command_line.push(evil.into());
        experiment.externals[0].name = evil.into();
        experiment.externals[0].file = evil.into();
        images[0].0 = evil.into();
        let page = page(&experiment, &reference, &images);
        assert!(
            !page.contains("<script>alert") && !page.contains("<img src=x") && !page.contains("\" onload=\"")
        );
        assert_eq!(page.matches("<script>").count(), 1);
        assert_eq!(page.matches("--on-accent:#fff").count(), 1, "a value is not filled again");
    }

    #[test]
    fn four_variants_at_400_by_400_stay_below_15_megabytes() {
        let (experiment, ..) = synthetic::full();
        let mut normal = synthetic::Normal::new(1);
        // Nothing compresses worse than this.
        let mut noise =
            || Image::new(400, 400, (0..160_000).map(|_| [0; 3].map(|_| normal.uniform() as f32)).collect());
        let images: Vec<_> =
            experiment.variants.iter().map(|variant| (variant.name.clone(), noise())).collect();
        let reference = noise();
        let size = page(&experiment, &reference, &images).len();
        assert!(size < 15_000_000, "{size}");
    }

    #[test]
    fn no_pictures_no_viewer() {
        let (experiment, reference, _) = synthetic::full();
        let page = page(&experiment, &reference, &[]);
        assert!(
            !page.contains("id=\"viewer\"") && !page.contains("id=\"config\"") && page.contains("Figures")
        );
    }

    #[test]
    fn signs_are_printed() {
        assert_eq!(
            cell("-0.98 +- 0.03 (-1.2..-0.9), 1e-5, megakernel-2"),
            "−0.98 ± 0.03 (−1.2..−0.9), 1e-5, megakernel-2"
        );
        assert_eq!(shell_word("it's"), "'it'\\''s'");
        assert_eq!(shell_word("--seeds"), "--seeds");
    }
}
