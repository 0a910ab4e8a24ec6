//! A page of Markdown: its sections, the blocks in them, and what is said of their numbers.

use pinc_tests::book;
use std::ops::Range;

/// A page.
#[derive(Debug)]
pub(crate) struct Page {
    /// Its path from the top of the tree.
    pub(crate) path: String,
    pub(crate) text: String,
    pub(crate) sections: Vec<Section>,
}

/// What is between two headings.
#[derive(Debug)]
pub(crate) struct Section {
    pub(crate) level: usize,
    pub(crate) anchor: String,
    /// Whether it says where and when its times were measured.
    pub(crate) is_timed: bool,
    pub(crate) blocks: Vec<Block>,
}

/// A table, a paragraph or a block of code.
#[derive(Debug)]
pub(crate) struct Block {
    pub(crate) kind: Kind,
    pub(crate) span: Range<usize>,
    /// What the comment before it says of its numbers.
    pub(crate) mark: Option<Mark>,
}

/// What a block is.
#[derive(Debug)]
pub(crate) enum Kind {
    /// Heads and rows, by the places of their cells in the text.
    Table {
        heads: Vec<Range<usize>>,
        rows: Vec<Vec<Range<usize>>>,
    },
    /// Commands.
    Commands(Vec<String>),
    /// Other code.
    Code,
    Paragraph,
}

/// What a comment says of the numbers of the block behind it.
#[derive(Clone, Debug)]
pub(crate) enum Mark {
    /// `<!-- numbers .. -->`: which command gives them, and where to read them.
    Numbers(String),
    /// `<!-- timed -->`: they depend on the machine and its load.
    Timed,
    /// `<!-- given: why -->`: they are not results of this project's commands; `<!-- derived: how
    /// -->`: whoever writes the page computes them from numbers that are compared.
    Given,
}

impl Page {
    pub(crate) fn new(path: &str, text: String) -> Result<Self, String> {
        let mut reader = Reader { path, text: &text, at: 0, mark: None };
        let mut sections = vec![Section::new(0, String::new())];
        while let Some((span, line)) = reader.line() {
            let section = sections.last_mut().expect("there is one");
            match line {
                line if line.trim().is_empty() => {}
                line if line.starts_with('#') => {
                    let title = line.trim_start_matches('#');
                    sections.push(Section::new(line.len() - title.len(), anchor(title)));
                }
                line if line.starts_with("<!--") => reader.comment(span)?,
                line if line.starts_with("```") => section.blocks.push(reader.fence(span, line)),
                line if line.starts_with('|') => section.blocks.push(reader.table(span)),
                line => {
                    section.is_timed |= line.starts_with("*Timed ");
                    section.blocks.push(reader.paragraph(span));
                }
            }
        }
        Ok(Self { path: path.to_owned(), sections, text })
    }

    /// The file and the line in which something stands.
    pub(crate) fn place(&self, at: usize) -> String {
        book::place(&self.path, &self.text, at)
    }

    /// The section of an anchor and those below it.
    pub(crate) fn below(&self, anchor: &str) -> &[Section] {
        let Some(first) = self.sections.iter().position(|of| of.anchor == anchor) else {
            return &[];
        };
        let level = self.sections[first].level;
        let rest = &self.sections[first + 1..];
        let more = rest.iter().position(|of| of.level <= level).unwrap_or(rest.len());
        &self.sections[first..=first + more]
    }
}

impl Section {
    fn new(level: usize, anchor: String) -> Self {
        Self { level, anchor, is_timed: false, blocks: Vec::new() }
    }

    /// The commands nearest above a block.
    pub(crate) fn commands_before(&self, block: usize) -> &[String] {
        let above = self.blocks[..block].iter().rev();
        let commands = above.filter_map(|of| match &of.kind {
            Kind::Commands(commands) => Some(commands.as_slice()),
            _ => None,
        });
        commands.into_iter().next().unwrap_or_default()
    }
}

/// The anchor of a heading, as GitHub makes it.
fn anchor(title: &str) -> String {
    let title = title.trim().to_lowercase();
    let kept = title.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// Reads a page line by line.
struct Reader<'a> {
    path: &'a str,
    text: &'a str,
    at: usize,
    mark: Option<Mark>,
}

impl<'a> Reader<'a> {
    /// The next line and its place.
    fn line(&mut self) -> Option<(Range<usize>, &'a str)> {
        let rest = &self.text[self.at..];
        let length = rest.find('\n').unwrap_or(rest.len());
        let span = self.at..self.at + length;
        (!rest.is_empty()).then(|| {
            self.at = (span.end + 1).min(self.text.len());
            (span.clone(), &self.text[span])
        })
    }

    /// The end of the lines from here on that are of a kind.
    fn while_line(&mut self, mut end: usize, is: impl Fn(&str) -> bool) -> usize {
        loop {
            let before = self.at;
            match self.line() {
                Some((span, line)) if is(line) => end = span.end,
                _ => {
                    self.at = before;
                    return end;
                }
            }
        }
    }

    fn comment(&mut self, first: Range<usize>) -> Result<(), String> {
        let rest = &self.text[first.start..];
        let length = rest.find("-->").ok_or(format!("{}: a comment without end", self.path))?;
        let inside = rest["<!--".len()..length].trim();
        self.at = first.start + length + "-->".len();
        self.mark = match inside.split_once(char::is_whitespace).map_or(inside, |(word, _)| word) {
            "numbers" => Some(Mark::Numbers(inside["numbers".len()..].to_owned())),
            "timed" => Some(Mark::Timed),
            "given:" | "derived:" => Some(Mark::Given),
            // Any other comment is for readers.
            _ => self.mark.take(),
        };
        Ok(())
    }

    fn fence(&mut self, first: Range<usize>, line: &str) -> Block {
        let end = self.while_line(first.end, |line| !line.starts_with("```"));
        let inside = (first.end + 1).min(end)..end;
        let closing = self.line().map_or(end, |(span, _)| span.end);
        let kind = if line == "```sh" {
            let joined = self.text[inside].replace("\\\n", " ");
            let commands = joined
                .lines()
                .map(|line| line.split(" # ").next().unwrap_or_default().trim().to_owned());
            Kind::Commands(
                commands.filter(|line| !line.is_empty() && !line.starts_with('#')).collect(),
            )
        } else {
            Kind::Code
        };
        Block { kind, span: first.start..closing, mark: self.mark.take() }
    }

    fn table(&mut self, first: Range<usize>) -> Block {
        let end = self.while_line(first.end, |line| line.starts_with('|'));
        let span = first.start..end;
        let mut lines = Vec::new();
        let mut at = span.start;
        for line in self.text[span.clone()].split('\n') {
            lines.push(book::cells(line, at));
            at += line.len() + 1;
        }
        let heads = lines.remove(0);
        let rows = lines.split_off(1);
        Block { kind: Kind::Table { heads, rows }, span, mark: self.mark.take() }
    }

    fn paragraph(&mut self, first: Range<usize>) -> Block {
        let starts_other =
            |line: &str| ["#", "|", "```", "<!--"].iter().any(|mark| line.starts_with(mark));
        let end = self.while_line(first.end, |line| !line.trim().is_empty() && !starts_other(line));
        Block { kind: Kind::Paragraph, span: first.start..end, mark: self.mark.take() }
    }
}
