//! The claims of a page: numbers, each with the command that gives it and where to read it.

use crate::numeral::{Numeral, Rule, numerals};
use crate::page::{Block, Kind, Mark, Page, Section};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// How long the command of a claim takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Effort {
    /// Seconds.
    Quick,
    /// Minutes: trainings.
    Full,
    /// Hours.
    Long,
}

/// A text of a page that a command gives.
#[derive(Clone, Debug)]
pub(crate) struct Claim {
    pub(crate) command: String,
    /// Commands that must have been run before.
    pub(crate) before: Vec<String>,
    pub(crate) effort: Effort,
    /// Where to read it in what the command leaves.
    pub(crate) source: String,
    pub(crate) rule: Rule,
    /// The numeral; none if it is a text that must be the same.
    pub(crate) numeral: Option<Numeral>,
    /// Its place on the page.
    pub(crate) span: Range<usize>,
}

/// What is wrong on a page.
#[derive(Clone, Debug)]
pub(crate) struct Fault {
    pub(crate) at: usize,
    pub(crate) what: String,
}

/// All claims of a page, and numbers that no command is named for.
pub(crate) fn claims(page: &Page, pages: &[Page]) -> (Vec<Claim>, Vec<Fault>) {
    let (mut claims, mut faults) = (Vec::new(), Vec::new());
    for section in &page.sections {
        for (place, block) in section.blocks.iter().enumerate() {
            let fault = |what: String| Fault { at: block.span.start, what };
            match (&block.kind, &block.mark) {
                (_, Some(Mark::Given)) => {}
                (_, Some(Mark::Timed)) if section.is_timed => {}
                (_, Some(Mark::Timed)) => {
                    faults.push(fault("no line `*Timed on .., date.*` in this section".to_owned()));
                }
                (_, Some(Mark::Numbers(text))) => {
                    let spec = Spec { page, block, text, commands: section.commands_before(place) };
                    match spec.claims(section.is_timed) {
                        Ok(found) => claims.extend(found),
                        Err(what) => faults.push(fault(what)),
                    }
                }
                (Kind::Table { .. }, None)
                    if numerals(&without_code(&page.text[block.span.clone()])).is_empty() => {}
                (Kind::Table { .. }, None) => {
                    faults.push(fault(
                        "no comment says where this table's numbers come from".to_owned(),
                    ));
                }
                (Kind::Paragraph, None) if !section.is_timed => {
                    faults.extend(unfounded(page, section, block, pages));
                }
                (Kind::Paragraph | Kind::Commands(_) | Kind::Code, None) => {}
            }
        }
    }
    (claims, faults)
}

/// Numbers of a paragraph that no table of its section has, nor of a section that it links to.
fn unfounded(page: &Page, own: &Section, block: &Block, pages: &[Page]) -> Vec<Fault> {
    let text = &page.text[block.span.clone()];
    let plain = without_code(text);
    let mut known: Vec<Numeral> = tables(page, std::slice::from_ref(own));
    let paragraphs = own.blocks.iter().filter(|of| matches!(of.kind, Kind::Paragraph));
    let own_text: String = paragraphs.map(|of| &page.text[of.span.clone()]).collect();
    let links = own_text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    for link in links.collect::<BTreeSet<_>>() {
        let Some((file, anchor)) = link.split_once('#') else { continue };
        let there = pages.iter().find(|of| match file {
            "" => of.path == page.path,
            file => of.path.rsplit('/').next() == file.rsplit('/').next(),
        });
        known.extend(there.map(|of| tables(of, of.below(anchor))).unwrap_or_default());
    }
    let is_known = |printed: &Numeral| {
        known.iter().any(|of| {
            (of.value.abs() - printed.value.abs()).abs()
                <= printed.half_unit(of.value) * (1.0 + 1e-6)
        })
    };
    let results = numerals(&plain).into_iter().filter(|of| of.is_result(&plain));
    let unknown = results.filter(|of| !is_known(of));
    let fault = |of: Numeral| Fault {
        at: block.span.start + of.span.start,
        what: format!("{} is in no table of this section or of one linked here", &plain[of.span]),
    };
    unknown.map(fault).collect()
}

/// A text with spaces in place of code and of the targets of links.
fn without_code(text: &str) -> String {
    let mut out = String::new();
    let (mut in_code, mut in_link) = (false, false);
    let mut before = ' ';
    for c in text.chars() {
        in_code ^= c == '`';
        in_link = (in_link || (before == ']' && c == '(')) && c != ')';
        let hidden = in_code || in_link;
        // As many bytes as before, so that places stay.
        if hidden {
            out.extend(std::iter::repeat_n(' ', c.len_utf8()))
        } else {
            out.push(c)
        }
        before = c;
    }
    out
}

fn tables(page: &Page, sections: &[Section]) -> Vec<Numeral> {
    let blocks = sections.iter().flat_map(|section| &section.blocks);
    let tables = blocks.filter(|block| matches!(block.kind, Kind::Table { .. } | Kind::Code));
    tables.flat_map(|block| numerals(&page.text[block.span.clone()])).collect()
}

/// A row of a table.
struct Row<'a> {
    /// Its first cell.
    first: &'a str,
    /// What stands for `{name}`.
    names: BTreeMap<&'a str, &'a str>,
}

/// A comment on numbers with its block.
struct Spec<'a> {
    page: &'a Page,
    block: &'a Block,
    text: &'a str,
    commands: &'a [String],
}

impl Spec<'_> {
    fn claims(&self, is_timed: bool) -> Result<Vec<Claim>, String> {
        let (first, rest) = self.text.split_once('\n').unwrap_or((self.text, ""));
        let least = Some(first.trim()).filter(|word| !word.is_empty()).map(effort).transpose()?;
        let lines: Vec<&str> =
            rest.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        if let Some(heads) = lines.iter().find_map(|line| line.strip_prefix("output timed:")) {
            return self.output(heads, least);
        }
        let Kind::Table { heads, rows } = &self.block.kind else {
            return Err("only a table or an output can be compared".to_owned());
        };
        let columns =
            lines.iter().find(|line| line.starts_with('|')).ok_or("no line of columns")?;
        let columns: Vec<&str> = columns.trim_matches('|').split('|').map(str::trim).collect();
        if columns.len() != heads.len() || rows.iter().any(|row| row.len() != heads.len()) {
            return Err(format!(
                "{} columns are described, the table has {}",
                columns.len(),
                heads.len()
            ));
        }
        if columns.contains(&"timed") && !is_timed {
            return Err("no line `*Timed on .., date.*` in this section".to_owned());
        }
        let lists = lines.iter().filter(|line| !line.starts_with('|'));
        let lists: Vec<(&str, Vec<&str>)> =
            lists.map(|line| list(line, rows.len())).collect::<Result<_, _>>()?;
        let mut claims = Vec::new();
        for place in 0..rows.len() {
            let row = self.variables(heads, rows, place, &lists);
            let least = match row.names.get("effort") {
                None => least,
                Some(&"given") => continue,
                Some(word) => Some(effort(word)?),
            };
            for (column, (spec, cell)) in columns.iter().zip(&rows[place]).enumerate() {
                if !matches!(*spec, "-" | "timed" | "given") {
                    claims.extend(self.cell(spec, (column, cell.clone()), &row, least)?);
                }
            }
        }
        Ok(claims)
    }

    fn text(&self, span: &Range<usize>) -> &str {
        &self.page.text[span.clone()]
    }

    /// What stands for `{name}` in a row: its cell under that head, or the one above if it is empty.
    fn variables<'b>(
        &'b self,
        heads: &[Range<usize>],
        rows: &[Vec<Range<usize>>],
        place: usize,
        lists: &[(&'b str, Vec<&'b str>)],
    ) -> Row<'b> {
        let mut names = BTreeMap::new();
        for (k, head) in heads.iter().enumerate() {
            let cells = rows[..=place].iter().rev().map(|cells| self.text(&cells[k]));
            let filled = cells.into_iter().find(|cell| !cell.is_empty()).unwrap_or_default();
            let code = filled.strip_prefix('`').and_then(|rest| rest.strip_suffix('`'));
            names
                .insert(self.text(head), code.filter(|code| !code.contains('`')).unwrap_or(filled));
        }
        names.extend(lists.iter().map(|(name, values)| (*name, values[place])));
        Row { first: self.text(&rows[place][0]), names }
    }

    /// The claims of a cell: `[net|error] [command:] source[; source]..`.
    fn cell(
        &self,
        spec: &str,
        (column, cell): (usize, Range<usize>),
        row: &Row<'_>,
        least: Option<Effort>,
    ) -> Result<Vec<Claim>, String> {
        let text = self.text(&cell);
        if spec.split_whitespace().next() != Some("text") && numerals(text).is_empty() {
            return Ok(Vec::new());
        }
        let mut claims = Vec::new();
        let mut numerals = numerals(text).into_iter();
        let spec = filled(spec, &row.names)?;
        for (place, spec) in spec.split(';').map(str::trim).enumerate() {
            let (rule, spec) = match spec.split_once(' ') {
                Some(("net", spec)) => (Rule::Net, spec.trim()),
                Some(("error", spec)) => (Rule::Error, spec.trim()),
                Some(("log", spec)) => (Rule::Log, spec.trim()),
                _ => (Rule::Digits, spec),
            };
            let (number, source) = match spec.split_once(':') {
                Some((number, source)) if number.bytes().all(|b| b.is_ascii_digit()) => (
                    number.parse().map_err(|_| format!("`{number}` is no command"))?,
                    source.trim(),
                ),
                _ => (1, spec),
            };
            let (numeral, span) = match source.strip_prefix("text ") {
                Some(_) => (None, cell.clone()),
                None => {
                    // Where all of a spread are the same, one is shown.
                    let Some(mut numeral) = numerals.next() else { break };
                    numeral.span = cell.start + numeral.span.start..cell.start + numeral.span.end;
                    let span = numeral.span.clone();
                    (Some(numeral), span)
                }
            };
            let source = match source {
                "same" => format!("same {place} | {column} | {}", row.first),
                source => source.trim_start_matches("text ").trim().to_owned(),
            };
            claims.push(Claim { source, rule, numeral, span, ..self.command(number, row, least)? });
        }
        match numerals.next() {
            Some(_) if claims.iter().all(|of| of.numeral.is_some()) => {
                Err(format!("`{text}` has more numbers than are described"))
            }
            _ => Ok(claims),
        }
    }

    /// A claim on a command of the block of commands before this one.
    fn command(
        &self,
        number: usize,
        row: &Row<'_>,
        least: Option<Effort>,
    ) -> Result<Claim, String> {
        let before = number.checked_sub(1).filter(|before| *before < self.commands.len());
        let before =
            before.ok_or(format!("no command {number} before this table in its section"))?;
        let command = filled(&self.commands[before], &row.names)?;
        let mut needed = Vec::new();
        for earlier in &self.commands[..before] {
            let earlier = filled(earlier, &row.names).unwrap_or_default();
            let out = earlier.split(" --out ").nth(1).and_then(|rest| rest.split(' ').next());
            if out.is_some_and(|out| command.contains(&format!("{out}/"))) {
                needed.push(earlier);
            }
        }
        let own = if trains(&command) || !needed.is_empty() { Effort::Full } else { Effort::Quick };
        let nothing = Rule::Digits;
        Ok(Claim {
            command,
            before: needed,
            effort: least.unwrap_or(own),
            source: String::new(),
            rule: nothing,
            numeral: None,
            span: 0..0,
        })
    }

    /// The claims of a block that shows what a command prints. Numbers in columns that end below
    /// one of `timed`, and those with a unit of time, are no claims.
    fn output(&self, timed: &str, least: Option<Effort>) -> Result<Vec<Claim>, String> {
        let timed: Vec<&str> = timed.split(',').map(str::trim).collect();
        let row = Row { first: "", names: BTreeMap::new() };
        let mut claims = Vec::new();
        let mut ends = Vec::new();
        let mut at = self.block.span.start;
        for (number, line) in self.text(&self.block.span).split('\n').enumerate().skip(1) {
            at += self.text(&self.block.span).split('\n').nth(number - 1).map_or(0, str::len) + 1;
            if line.starts_with("```") || line.starts_with("report:") {
                continue;
            }
            ends.extend(timed.iter().filter_map(|head| Some(line.find(head)? + head.len())));
            for (word, numeral) in numerals(line).into_iter().enumerate() {
                let behind = line[numeral.span.end..].split_whitespace().next().unwrap_or_default();
                if ends.contains(&numeral.span.end) || behind.trim_matches([':', ',']) == "s" {
                    continue;
                }
                let rule = if numeral.exponent.is_some() { Rule::Error } else { Rule::Net };
                let span = at + numeral.span.start..at + numeral.span.end;
                let numeral = Numeral { span: span.clone(), ..numeral };
                let source = format!("line {} number {}", number - 1, word);
                let claim = self.command(1, &row, least)?;
                claims.push(Claim { source, rule, numeral: Some(numeral), span, ..claim });
            }
        }
        Ok(claims)
    }
}

fn effort(word: &str) -> Result<Effort, String> {
    match word {
        "quick" => Ok(Effort::Quick),
        "full" => Ok(Effort::Full),
        "long" => Ok(Effort::Long),
        other => Err(format!("`{other}` is none of quick, full, long")),
    }
}

/// `name: value; value`, one for each row.
fn list(line: &str, rows: usize) -> Result<(&str, Vec<&str>), String> {
    let (name, values) = line.split_once(':').ok_or(format!("`{line}` is not understood"))?;
    let values: Vec<&str> = values.split(';').map(str::trim).collect();
    match values.len() == rows {
        true => Ok((name.trim(), values)),
        false => Err(format!("`{name}` has {} values for {rows} rows", values.len())),
    }
}

/// A text with the row's values in place of `{name}`; other braces stay.
fn filled(text: &str, row: &BTreeMap<&str, &str>) -> Result<String, String> {
    let mut out = text.to_owned();
    for (name, value) in row.iter().filter(|(name, _)| !name.is_empty()) {
        out = out.replace(&format!("{{{name}}}"), value);
    }
    Ok(out)
}

/// Whether a command trains a net or is a program beside `pinc`.
fn trains(command: &str) -> bool {
    let words: Vec<&str> = command.split_whitespace().collect();
    let pinc = words.first() == Some(&"pinc");
    !pinc || matches!(words.get(1), Some(&("run" | "train" | "choose" | "bench")))
}
