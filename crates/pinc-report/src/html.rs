//! The report's page.

use crate::data::{OfModel, Run};
use crate::number_tables::{NumberTable, flattened, number_tables};
use crate::picture::{Drawn, Picture};
use crate::summary_text::paragraph;
use crate::{sweep, zoom};
use pinc_chart::text::escape;
use pinc_record::file;

const STYLE: &str = include_str!("style.css");

/// The whole page, with the pictures already drawn.
pub(crate) fn page(run: &Run, drawn: &[Drawn]) -> String {
    let name = &run.experiment.name;
    // A run has few numbers; in a sweep the pictures come first.
    let body = match &run.trials {
        None => [numbers("Metrics", &number_tables(run)), pictures(drawn)],
        Some(trials) => [pictures(drawn), numbers("Tables", &sweep::number_tables(run, trials))],
    };
    let body = [header(run), body.concat(), footer(run)].concat();
    document(&format!("{name} · PINC report"), &body, drawn)
}

/// A page with its style and its scripts inside, which loads nothing.
pub(crate) fn document(title: &str, body: &str, drawn: &[Drawn]) -> String {
    let (style, script) = match drawn.iter().any(|of| of.live.is_some()) {
        true => ([STYLE, zoom::STYLE].concat(), zoom::script()),
        false => (STYLE.to_owned(), String::new()),
    };
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
         style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
         <title>{}</title>\n<style>\n{style}</style>\n</head>\n\
         <body>\n{body}{script}</body>\n</html>\n",
        escape(title)
    )
}

fn header(run: &Run) -> String {
    let experiment = &run.experiment;
    let about = [
        ("preset", experiment.preset.name()),
        ("seed", &experiment.seed.to_string()),
        ("plant", experiment.plant.name()),
    ];
    let about = about.map(|(key, value)| format!("{key} <b>{}</b>", escape(value)));
    let mut out = format!("<header>\n<h1>{}</h1>\n", escape(&experiment.name));
    out += &format!("<p class=\"about\">{}</p>\n", about.join(" · "));
    let summary = match &run.trials {
        None => paragraph(run),
        Some(trials) => sweep::paragraph(run, trials),
    };
    if !summary.is_empty() {
        out += &format!("<p class=\"summary\">{}</p>\n", escape(&summary));
    }
    let notes = notes(run);
    if !notes.is_empty() {
        out += &format!("<p class=\"note\">{}</p>\n", escape(&notes.join(" ")));
    }
    out + "</header>\n"
}

/// What the report would show, were its file there.
fn notes(run: &Run) -> Vec<String> {
    let mut notes = match run.trials {
        // What was only identified has no loops.
        None if run.identification.is_none() => missing_tables(run),
        _ => Vec::new(),
    };
    for (file, content, missing) in [
        (file::METRICS, "table of metrics", run.metrics.is_none() && run.trials.is_none()),
        (file::PROVENANCE, "provenance", run.provenance.is_none()),
    ] {
        if missing {
            notes.push(format!("There is no {file}: the {content} is left out."));
        }
    }
    notes
}

fn missing_tables(run: &Run) -> Vec<String> {
    fn rows<T>(tables: &[OfModel<T>], len: impl Fn(&T) -> usize) -> Option<usize> {
        tables.iter().map(|of| len(&of.table)).reduce(|a, b| a + b)
    }
    let experiment = &run.experiment;
    let looped = experiment.control.is_some();
    let files = [
        (
            file::TRAINING,
            "picture of the training",
            experiment.training.is_some(),
            run.training.as_ref().map(Vec::len),
        ),
        (
            file::PREDICTION,
            "free run",
            experiment.prediction.is_some(),
            run.prediction.as_ref().map(|table| table.rows.len()),
        ),
        ("control.csv", "closed loop", looped, rows(&run.control.loops, |table| table.rows.len())),
        (
            "steps.csv",
            "picture of the controller's steps",
            looped,
            rows(&run.steps, |steps| steps.count),
        ),
    ];
    let mut notes = Vec::new();
    // A config without the section wants no such file.
    for (file, content, wanted, rows) in files {
        match rows {
            None if wanted => notes.push(format!("There is no {file}: the {content} is left out.")),
            Some(0) => notes.push(format!("{file} has no rows: the {content} is left out.")),
            _ => {}
        }
    }
    notes
}

pub(crate) fn numbers(title: &str, tables: &[NumberTable]) -> String {
    let tables: Vec<String> = tables.iter().map(table).collect();
    if tables.is_empty() {
        return String::new();
    }
    format!(
        "<section id=\"metrics\">\n<h2>{title}</h2>\n<div \
        class=\"tables\">\n{}</div>\n</section>\n",
        tables.concat()
    )
}

fn table(table: &NumberTable) -> String {
    let cells = |row: &[String], first: &str, other: &str| {
        let cell = |(i, text): (usize, &String)| {
            let tag = if i == 0 { first } else { other };
            format!("<{tag}>{}</{tag}>", escape(text))
        };
        let cells: String = row.iter().enumerate().map(cell).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let head = match &table.heads[..] {
        [] => String::new(),
        heads => format!("<thead>\n{}</thead>\n", cells(heads, "th", "th")),
    };
    let rows: String = table.rows.iter().map(|row| cells(row, "th", "td")).collect();
    format!(
        "<div>\n<h3>{}</h3>\n<table>\n{head}<tbody>\n{rows}</tbody>\n</table>\n</div>\n",
        escape(&table.title)
    )
}

fn pictures(drawn: &[Drawn]) -> String {
    let section = |of: &Drawn| {
        let Picture { stem, title, caption, .. } = &of.picture;
        let caption = format!("{caption} Also in figures/{stem}.svg and .csv.");
        section(of, (stem, title, &caption))
    };
    drawn.iter().map(section).collect()
}

/// A picture with its anchor, its title and its caption.
pub(crate) fn section(of: &Drawn, (stem, title, caption): (&str, &str, &str)) -> String {
    let live = of.live.as_deref().map(zoom::data).unwrap_or_default();
    format!(
        "<section id=\"{stem}\">\n<h2>{}</h2>\n<figure>\n{}{live}<figcaption>{}</figcaption>\n\
         </figure>\n</section>\n",
        escape(title),
        of.svg,
        escape(caption),
    )
}

fn footer(run: &Run) -> String {
    let mut out = String::new();
    if let Some(provenance) = &run.provenance {
        let facts = flattened(provenance);
        let row = |(key, value): &(String, String)| {
            format!("<tr><th>{}</th><td>{}</td></tr>\n", escape(key), escape(value))
        };
        let rows: String = facts.iter().map(row).collect();
        out += &format!(
            "<h2>Provenance</h2>\n<table class=\"provenance\">\n<tbody>\n{rows}</tbody>\n</table>\n"
        );
    }
    out += &format!(
        "<details>\n<summary>The resolved configuration, \
        config.toml</summary>\n<pre>{}</pre>\n</details>\n",
        escape(&run.config_text)
    );
    format!("<footer>\n{out}</footer>\n")
}
