//! A page in Markdown, with pictures beside it.

use super::runs::Run;
use pinc_record::Invocation;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::PathBuf;

/// A page being written.
#[derive(Default)]
pub(super) struct Page {
    text: String,
    /// The directory of its pictures, as seen from the page; without one it has none.
    folder: Option<String>,
    pictures: Vec<Copied>,
}

/// A picture of the page: where it is, and what it is called beside the page.
pub(super) struct Copied {
    pub(super) from: PathBuf,
    pub(super) name: String,
}

impl Page {
    /// An empty page with pictures in `folder`.
    pub(super) fn with_pictures(folder: String) -> Self {
        Self { folder: Some(folder), ..Self::default() }
    }

    pub(super) fn heading(&mut self, text: &str) {
        self.paragraph(&format!("## {text}"));
    }

    /// A paragraph, with an empty line after it.
    pub(super) fn paragraph(&mut self, text: &str) {
        self.text += text;
        self.text += "\n\n";
    }

    /// Commands, as code.
    pub(super) fn commands(&mut self, commands: &[&str]) {
        self.paragraph(&format!("```sh\n{}\n```", commands.join("\n")));
    }

    pub(super) fn table<H: AsRef<str>>(&mut self, heads: &[H], rows: &[Vec<String>]) {
        let line = |cells: Vec<&str>| format!("| {} |\n", cells.join(" | "));
        self.text += &line(heads.iter().map(AsRef::as_ref).collect());
        // Writing to a String does not fail.
        let _ = writeln!(self.text, "|{}", "---|".repeat(heads.len()));
        for row in rows {
            self.text += &line(row.iter().map(String::as_str).collect());
        }
        self.text.push('\n');
    }

    /// Says how the numbers of the table after this can be made again: by which of the commands
    /// above it and where to read them. `.ci/numbers` follows it; docs/testing.md has its grammar.
    pub(super) fn made_by(&mut self, lists: &[(&str, Vec<String>)], columns: &str) {
        self.text += "<!-- numbers\n";
        for (name, values) in lists {
            // Writing to a String does not fail.
            let _ = writeln!(self.text, "{name}: {}", values.join(" ; "));
        }
        let _ = writeln!(self.text, "| {columns} |\n-->");
    }

    /// Says where and when the times of a section were measured.
    pub(super) fn timed<'a>(&mut self, runs: impl Iterator<Item = &'a Run>) {
        let last = |run: &'a Run| run.provenance.invocations().last();
        let said = |of: &Invocation| {
            let day = of.started.split('T').next().unwrap_or_default();
            format!("{}, {day}", of.cpu)
        };
        let all: BTreeSet<String> = runs.filter_map(last).map(said).collect();
        let all: Vec<String> = all.into_iter().collect();
        self.paragraph(&format!("*Timed on {}.*", all.join("; ")));
    }

    /// A picture of a run's report, with what it shows above it, if the page has pictures and the
    /// run has this one.
    pub(super) fn picture(&mut self, run: &Run, stem: &str, what: &str) {
        let (Some(folder), Some(from)) = (&self.folder, run.picture(stem)) else { return };
        let preset = run.preset.name();
        let name = format!("{}-{preset}-{stem}.svg", run.experiment);
        let picture = format!("![]({folder}/{name})");
        self.pictures.push(Copied { from, name });
        self.paragraph(&format!("{what}, preset `{preset}`:"));
        self.paragraph(&picture);
    }

    /// The page's text, and its pictures.
    pub(super) fn into_parts(self) -> (String, Vec<Copied>) {
        (self.text.trim_end().to_owned() + "\n", self.pictures)
    }
}

/// A number to three digits, or a dash.
pub(super) fn short(value: f64) -> String {
    match value.abs() {
        _ if !value.is_finite() => "-".to_owned(),
        size if size != 0.0 && !(1e-3..1e5).contains(&size) => format!("{value:.2e}"),
        size if size < 1.0 => format!("{value:.4}"),
        size if size < 100.0 => format!("{value:.3}"),
        _ => format!("{value:.1}"),
    }
}

/// Seconds, in the unit that suits.
pub(super) fn time(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "-".to_owned(),
        s if s < 1e-3 => format!("{:.0} us", 1e6 * s),
        s if s < 1.0 => format!("{:.2} ms", 1e3 * s),
        s if s < 100.0 => format!("{s:.1} s"),
        s if s < 6000.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}
