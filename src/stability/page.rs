//! The battery's results as one page that needs nothing beside it.

use super::Verdict;
use super::table::Results;
use crate::converge::escape::markup;
use std::fmt::Write;

const STYLE: &str = include_str!("../converge/report/page.css");
const STRING: &str = "a string takes everything";

/// Name of the page in its folder.
pub const FILE: &str = "stability.html";

/// The whole page.
pub fn write(results: &Results) -> String {
    let mut sections = String::new();
    let mut families: Vec<&str> = Vec::new();
    for row in &results.rows {
        let family = row.name.split('/').next().unwrap_or_default();
        if !families.contains(&family) {
            families.push(family);
        }
    }
    let wrong: Vec<_> = results.rows.iter().filter(|row| row.verdict != Verdict::Pass).collect();
    let mut sentences = vec![results.summary()];
    if wrong.is_empty() {
        sentences.push("Every case is right within its tolerance.".into());
    } else {
        sentences.extend(wrong.iter().map(|row| {
            let [name, what, expected, found, ..] = Results::cells(row);
            format!("{}: {name}, {what}: expected {expected}, found {found}", row.verdict.name())
        }));
    }
    let sentences: String = sentences.iter().map(|s| format!("<li>{}</li>\n", markup(s))).collect();
    for family in families {
        let rows: Vec<_> =
            results.rows.iter().filter(|row| row.name.split('/').next() == Some(family)).collect();
        let right = rows.iter().filter(|row| row.verdict == Verdict::Pass).count();
        let open = if right == rows.len() { "" } else { " open" };
        write!(
            sections,
            "<details{open}><summary>{}: {right} of {} pass</summary><div class=\"scroll\"><table><thead><tr>",
            markup(family),
            rows.len()
        )
        .expect(STRING);
        for head in Results::heads() {
            write!(sections, "<th scope=\"col\">{head}</th>").expect(STRING);
        }
        sections.push_str("<th scope=\"col\">why so much is allowed</th></tr></thead><tbody>\n");
        for row in rows {
            let class = if row.verdict.is_failure() { " class=\"wrong\"" } else { "" };
            write!(sections, "<tr{class}>").expect(STRING);
            for (column, cell) in Results::cells(row).iter().enumerate() {
                let text = markup(&cell.replace("+-", "±"));
                match column {
                    0 => write!(sections, "<th scope=\"row\">{text}</th>").expect(STRING),
                    _ => write!(sections, "<td>{text}</td>").expect(STRING),
                }
            }
            writeln!(sections, "<td>{}</td></tr>", markup(row.why)).expect(STRING);
        }
        sections.push_str("</tbody></table></div></details>\n");
    }
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n\
         <meta name=\"generator\" content=\"wavepath {version}\">\n<title>Numerical stability</title>\n\
         <link rel=\"icon\" href=\"data:,\">\n<style>\n{STYLE}\n.wrong td,.wrong th{{color:#c0392b}}\n</style>\n</head>\n<body>\n\
         <header><p class=\"kicker\">Stiff and extreme cases with known answers</p><h1>Numerical stability</h1>\n\
         <p class=\"facts\">{cpu}, {isa}, {engine}</p></header>\n<main>\n<section aria-label=\"Result\"><ul class=\"sentences\">\n\
         {sentences}</ul></section>\n<section aria-labelledby=\"h-cases\"><h2 id=\"h-cases\">Cases</h2>\n{sections}\
         <p class=\"note\">A picture is rendered with 8 to 512 seeds, until three standard errors are within what is allowed; \
         the figure behind ± is the standard error. The error is relative to the expected value, absolute where that is 0. \
         “Input lost”: rounding the scene's coordinates to single precision changes the value by more than is allowed.</p>\n\
         </section>\n</main>\n</body>\n</html>\n",
        version = results.version,
        cpu = markup(&results.cpu),
        isa = markup(&results.isa),
        engine = markup(&results.engine),
    )
}
