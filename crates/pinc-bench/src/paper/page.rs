//! A page in Markdown.

use std::fmt::Write;

/// A page being written.
#[derive(Default)]
pub(super) struct Page(String);

impl Page {
    pub(super) fn heading(&mut self, text: &str) {
        self.paragraph(&format!("## {text}"));
    }

    /// A paragraph, with an empty line after it.
    pub(super) fn paragraph(&mut self, text: &str) {
        self.0 += text;
        self.0 += "\n\n";
    }

    /// Commands, as code.
    pub(super) fn commands(&mut self, commands: &[&str]) {
        self.paragraph(&format!("```sh\n{}\n```", commands.join("\n")));
    }

    pub(super) fn table<H: AsRef<str>>(&mut self, heads: &[H], rows: &[Vec<String>]) {
        let line = |cells: Vec<&str>| format!("| {} |\n", cells.join(" | "));
        self.0 += &line(heads.iter().map(AsRef::as_ref).collect());
        // Writing to a String does not fail.
        let _ = writeln!(self.0, "|{}", "---|".repeat(heads.len()));
        for row in rows {
            self.0 += &line(row.iter().map(String::as_str).collect());
        }
        self.0.push('\n');
    }

    pub(super) fn into_text(self) -> String {
        self.0.trim_end().to_owned() + "\n"
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
