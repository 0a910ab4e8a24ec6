//! The report's page.

use crate::data::{OfModel, Run};
use crate::number_tables::{NumberTable, flattened, key_numbers, number_tables};
use crate::picture::{Drawn, Picture};
use crate::summary_text::sentences;
use crate::{sweep, zoom};
use pinc_chart::text::escape;
use pinc_record::{Metrics, file};

const STYLE: &str = include_str!("style.css");

/// The whole page, with the pictures already drawn.
pub(crate) fn page(run: &Run, drawn: &[Drawn]) -> String {
    let name = &run.experiment.name;
    let body = match &run.trials {
        None => of_run(run, drawn),
        Some(trials) => {
            pictures(drawn) + &numbers("metrics", "Tables", &sweep::number_tables(run, trials))
        }
    };
    let body = [header(run), body, footer(run)].concat();
    document(&format!("{name} · PINC report"), &body, drawn)
}

/// What readers look for comes first: the first picture, the few numbers of most weight, the run in
/// words. All other pictures and numbers follow.
fn of_run(run: &Run, drawn: &[Drawn]) -> String {
    let (first, others) = drawn.split_at(drawn.len().min(1));
    let said: String =
        escape(&sentences(run)).lines().map(|of| format!("<li>{of}</li>\n")).collect();
    let list = format!("<ul class=\"summary\">\n{said}</ul>\n");
    let summary = if said.is_empty() { said } else { list };
    let key = Vec::from_iter(key_numbers(run));
    let (key, all) = (numbers("key", "At a glance", &key), number_tables(run));
    let all = numbers("metrics", "Metrics", &all);
    [pictures(first), key, summary, pictures(others), all].concat()
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
         <body>\n<main>\n{body}</main>\n{script}</body>\n</html>\n",
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
    if let Some(trials) = &run.trials {
        let summary = sweep::paragraph(run, trials);
        out += &format!("<p class=\"summary\">{}</p>\n", escape(&summary));
    }
    let notes = notes(run);
    if !notes.is_empty() {
        out += &format!("<p class=\"note\">{}</p>\n", escape(&notes.join(" ")));
    }
    out + "</header>\n"
}

/// What is missing: the rest of an unfinished run, or files.
fn notes(run: &Run) -> Vec<String> {
    let unfinished = |what| format!("The {what} is not finished: continue with --resume.");
    let mut notes = Vec::from_iter(run.unfinished.map(unfinished));
    notes.extend(match run.trials {
        // What was only identified has no loops.
        None if run.identification.is_none() => missing_tables(run),
        _ => Vec::new(),
    });
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
    // A stage that did not run has no numbers, and no file is missing.
    let ran = |numbers: fn(&Metrics) -> bool| run.metrics.as_ref().is_none_or(numbers);
    let looped = experiment.control.is_some() && ran(|metrics| !metrics.control.is_empty());
    let files = [
        (
            file::TRAINING,
            "picture of the training",
            experiment.training.is_some() && ran(|metrics| metrics.training.is_some()),
            run.training.as_ref().map(Vec::len),
        ),
        (
            file::PREDICTION,
            "free run",
            experiment.prediction.is_some() && ran(|metrics| metrics.prediction.is_some()),
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
    let no_loop = experiment.control.is_some() && !looped;
    let mut notes = Vec::from_iter(no_loop.then(|| "The closed loop has not run.".to_owned()));
    for (file, content, wanted, rows) in files {
        match rows {
            None if wanted => notes.push(format!("There is no {file}: the {content} is left out.")),
            Some(0) => notes.push(format!("{file} has no rows: the {content} is left out.")),
            _ => {}
        }
    }
    notes
}

/// Tables with their anchor and their title; nothing without any.
pub(crate) fn numbers(id: &str, title: &str, tables: &[NumberTable]) -> String {
    let tables: Vec<String> = tables.iter().map(table).collect();
    if tables.is_empty() {
        return String::new();
    }
    format!(
        "<section id=\"{id}\">\n<h2>{title}</h2>\n<div \
        class=\"tables\">\n{}</div>\n</section>\n",
        tables.concat()
    )
}

fn table(table: &NumberTable) -> String {
    let head = match &table.heads[..] {
        [] => String::new(),
        heads => {
            let cells: String = heads.iter().map(|text| cell("th scope=\"col\"", text)).collect();
            format!("<thead>\n<tr>{cells}</tr>\n</thead>\n")
        }
    };
    let row = |row: &Vec<String>| {
        let tag = |i| if i == 0 { "th scope=\"row\"" } else { "td" };
        let cells: String = row.iter().enumerate().map(|(i, text)| cell(tag(i), text)).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let rows: String = table.rows.iter().map(row).collect();
    format!(
        "<div>\n<table>\n<caption>{}</caption>\n{head}<tbody>\n{rows}</tbody>\n</table>\n</div>\n",
        escape(&table.title)
    )
}

/// A cell of a table; the tag may have attributes.
fn cell(tag: &str, text: &str) -> String {
    let name = tag.split(' ').next().unwrap_or(tag);
    format!("<{tag}>{}</{name}>", escape(text))
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
            format!("<tr>{}{}</tr>\n", cell("th scope=\"row\"", key), cell("td", value))
        };
        let rows: String = facts.iter().map(row).collect();
        out += &format!(
            "<h2>Provenance</h2>\n<table class=\"provenance\" aria-label=\"Provenance\">\n<tbody>\n{rows}</tbody>\n</table>\n"
        );
    }
    out += &format!(
        "<details>\n<summary>The resolved configuration, \
        config.toml</summary>\n<pre>{}</pre>\n</details>\n",
        escape(&run.config_text)
    );
    format!("<footer>\n{out}</footer>\n")
}
