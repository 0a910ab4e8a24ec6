//! The report's page.

use super::ReportError;
use super::data::{OfModel, Run};
use super::number_tables::{NumberTable, flattened, sheets};
use super::picture::Drawn;
use super::summary_text::paragraph;
use super::sweep;
use super::table::Table;
use pinc_chart::text::escape;

const STYLE: &str = include_str!("style.css");

/// The whole page, with the pictures already drawn.
pub(super) fn page(run: &Run, drawn: &[Drawn]) -> Result<String, ReportError> {
    let name = run.title("name", "experiment").unwrap_or_else(|| "Unnamed run".to_owned());
    // Of a run its numbers are few; of a sweep the pictures come first.
    let body = match &run.trials {
        None => [numbers("Metrics", &sheets(run)), pictures(drawn)],
        Some(trials) => [pictures(drawn), numbers("Tables", &sweep::sheets(run, trials)?)],
    };
    let body = [header(run, &name), body.concat(), footer(run)].concat();
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{} · PINC report</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escape(&name)
    ))
}

fn header(run: &Run, name: &str) -> String {
    let about = [("preset", run.title("preset", "preset")), ("seed", run.title("seed", "seed"))];
    let about = about.into_iter().filter_map(|(key, value)| Some((key, value?)));
    let about = about.chain(run.config.get("plant").and_then(plant));
    let about: Vec<String> =
        about.map(|(key, value)| format!("{key} <b>{}</b>", escape(&value))).collect();
    let mut out = format!("<header>\n<h1>{}</h1>\n", escape(name));
    out += &format!("<p class=\"about\">{}</p>\n", about.join(" · "));
    let words = match &run.trials {
        None => paragraph(run),
        Some(trials) => sweep::paragraph(run, trials),
    };
    if !words.is_empty() {
        out += &format!("<p class=\"summary\">{}</p>\n", escape(&words));
    }
    let notes = notes(run);
    if !notes.is_empty() {
        out += &format!("<p class=\"note\">{}</p>\n", escape(&notes.join(" ")));
    }
    out + "</header>\n"
}

/// The plant's name: the one key of its table.
fn plant(plant: &toml::Value) -> Option<(&'static str, String)> {
    let table = plant.as_table()?;
    Some(("plant", table.keys().next()?.clone()))
}

/// What the report would show, were its file there.
fn notes(run: &Run) -> Vec<String> {
    let mut notes = match run.trials {
        None => missing_tables(run),
        Some(_) => Vec::new(),
    };
    for (file, content, missing) in [
        ("config.toml", "header", run.config_text.is_none()),
        ("metrics.json", "table of metrics", run.metrics.is_null() && run.trials.is_none()),
        ("provenance.json", "provenance", run.provenance.is_null()),
    ] {
        if missing {
            notes.push(format!("There is no {file}: the {content} is left out."));
        }
    }
    notes
}

fn missing_tables(run: &Run) -> Vec<String> {
    let rows = |table: &Option<Table>| table.as_ref().map(Table::len);
    let all_rows = |tables: &[OfModel]| tables.iter().map(|of| of.table.len()).reduce(|a, b| a + b);
    let files = [
        ("training.csv", "training", "picture of the training", rows(&run.training)),
        ("prediction.csv", "prediction", "free run", rows(&run.prediction)),
        ("control.csv", "control", "closed loop", all_rows(&run.control)),
        ("steps.csv", "control", "picture of the controller's steps", all_rows(&run.steps)),
    ];
    let mut notes = Vec::new();
    for (file, section, content, rows) in files {
        // A config without the section wants no such file.
        let wanted = run.config_text.is_none() || run.config.contains_key(section);
        match rows {
            None if wanted => notes.push(format!("There is no {file}: the {content} is left out.")),
            Some(0) => notes.push(format!("{file} has no rows: the {content} is left out.")),
            _ => {}
        }
    }
    notes
}

fn numbers(title: &str, sheets: &[NumberTable]) -> String {
    let sheets: Vec<String> = sheets.iter().map(sheet).collect();
    if sheets.is_empty() {
        return String::new();
    }
    format!(
        "<section id=\"metrics\">\n<h2>{title}</h2>\n<div class=\"sheets\">\n{}</div>\n</section>\n",
        sheets.concat()
    )
}

fn sheet(sheet: &NumberTable) -> String {
    let cells = |row: &[String], first: &str, other: &str| {
        let cell = |(i, text): (usize, &String)| {
            let tag = if i == 0 { first } else { other };
            format!("<{tag}>{}</{tag}>", escape(text))
        };
        let cells: String = row.iter().enumerate().map(cell).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let head = match &sheet.heads[..] {
        [] => String::new(),
        heads => format!("<thead>\n{}</thead>\n", cells(heads, "th", "th")),
    };
    let rows: String = sheet.rows.iter().map(|row| cells(row, "th", "td")).collect();
    format!(
        "<div>\n<h3>{}</h3>\n<table>\n{head}<tbody>\n{rows}</tbody>\n</table>\n</div>\n",
        escape(&sheet.title)
    )
}

fn pictures(drawn: &[Drawn]) -> String {
    let section = |Drawn { picture, svg }: &Drawn| {
        format!(
            "<section id=\"{}\">\n<h2>{}</h2>\n<figure>\n{svg}<figcaption>{} \
             Also in figures/{}.svg and .csv.</figcaption>\n</figure>\n</section>\n",
            picture.stem,
            escape(&picture.title),
            escape(&picture.caption),
            picture.stem
        )
    };
    drawn.iter().map(section).collect()
}

fn footer(run: &Run) -> String {
    let mut out = String::new();
    let facts = flattened(&run.provenance);
    if !facts.is_empty() {
        let row = |(key, value): &(String, String)| {
            format!("<tr><th>{}</th><td>{}</td></tr>\n", escape(key), escape(value))
        };
        let rows: String = facts.iter().map(row).collect();
        out += &format!(
            "<h2>Provenance</h2>\n<table class=\"provenance\">\n<tbody>\n{rows}</tbody>\n</table>\n"
        );
    }
    if let Some(text) = &run.config_text {
        out += &format!(
            "<details>\n<summary>The resolved configuration, config.toml</summary>\n<pre>{}</pre>\n</details>\n",
            escape(text)
        );
    }
    format!("<footer>\n{out}</footer>\n")
}
