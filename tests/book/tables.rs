//! Tables of pages in CSV files.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

/// The file of a line that is nothing but a link to a table.
pub(super) fn link(line: &str) -> Option<&str> {
    let (_, file) = line.strip_prefix('[')?.strip_suffix(')')?.split_once("](")?;
    (file.starts_with("tables/") && file.ends_with(".csv")).then_some(file)
}

/// A table in place of its link: the link as a comment, the mark for `.ci/numbers`, the rows.
pub(super) fn unfolded(folder: &Path, line: &str, file: &str) -> Result<String, String> {
    let path = folder.join(file);
    let text = super::read(&path)?;
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text.as_bytes());
    let mut out = format!("<!-- {line} -->\n");
    let mark = path.with_extension("numbers");
    if mark.exists() {
        out += &format!("<!-- numbers{}-->\n", super::read(&mark)?);
    }
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(|error| format!("{}: {error}", path.display()))?;
        let cells: Vec<String> = record.iter().map(|cell| cell.replace('|', "\\|")).collect();
        out += &format!("| {} |\n", cells.join(" | "));
        if number == 0 {
            out += &format!("|{}\n", "---|".repeat(cells.len()));
        }
    }
    Ok(out)
}

/// A page with links in place of the tables that have files, and these files.
pub(super) fn folded(text: &str) -> Result<(String, Vec<(String, String)>), String> {
    let (mut page, mut files) = (String::new(), Vec::new());
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        let inside = line.strip_prefix("<!-- ").and_then(|rest| rest.strip_suffix(" -->"));
        let Some((inside, file)) = inside.and_then(|inside| Some((inside, link(inside)?))) else {
            page += &format!("{line}\n");
            continue;
        };
        page += &format!("{inside}\n");
        if lines.peek().is_some_and(|line| line.starts_with("<!-- numbers")) {
            let mark = file.replace(".csv", ".numbers");
            files.push((mark, mark_in(&mut lines)));
        }
        let mut rows = Vec::new();
        while let Some(row) = lines.next_if(|line| line.starts_with('|')) {
            rows.push(row);
        }
        files.push((file.to_owned(), as_csv(&rows)?));
    }
    Ok((page, files))
}

/// The inside of a comment of `.ci/numbers`, without the word `numbers`.
fn mark_in<'a>(lines: &mut impl Iterator<Item = &'a str>) -> String {
    let mut mark = String::new();
    for line in lines {
        mark += &format!("{line}\n");
        if line.ends_with("-->") {
            break;
        }
    }
    let inside = mark.trim_end().trim_start_matches("<!-- numbers").trim_end_matches("-->");
    inside.to_owned()
}

/// Rows of Markdown as CSV; the second is the line below the heads.
fn as_csv(rows: &[&str]) -> Result<String, String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for (_, row) in rows.iter().enumerate().filter(|(number, _)| *number != 1) {
        let record: Vec<String> =
            cells(row, 0).into_iter().map(|cell| row[cell].replace("\\|", "|")).collect();
        writer.write_record(record).map_err(|error| format!("{row}: {error}"))?;
    }
    let bytes = writer.into_inner().map_err(|error| error.to_string())?;
    String::from_utf8(bytes).map_err(|error| error.to_string())
}

/// Returns the page with all its tables as files named after their headings, as [`super::write`] takes
/// them. `name` is the folder below `docs/tables/`.
#[must_use]
pub fn moved_to_files(text: &str, name: &str) -> String {
    let (mut out, mut mark, mut heading) = (String::new(), String::new(), String::new());
    let mut counts = BTreeMap::new();
    let (mut before, mut has_file) = ("", false);
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if line.starts_with('#') {
            heading = line.trim_start_matches('#').trim().to_owned();
        }
        has_file |= line.starts_with("<!-- [");
        if line.starts_with("<!-- numbers") {
            mark = format!("{line}\n");
            mark.extend(lines.by_ref().take_while(|line| *line != "-->").map(|l| format!("{l}\n")));
            mark += "-->\n";
            continue;
        }
        if line.starts_with('|') && !before.starts_with('|') {
            let count = counts.entry(heading.clone()).or_insert(0);
            *count += 1;
            let number = if *count == 1 { String::new() } else { format!("-{count}") };
            if !has_file {
                let file = format!("tables/{name}/{}{number}.csv", slug(&heading));
                out += &format!("<!-- [Table]({file}) -->\n");
            }
            has_file = false;
        }
        out += &std::mem::take(&mut mark);
        out += &format!("{line}\n");
        before = line;
    }
    out
}

/// A title as the name of a file.
fn slug(title: &str) -> String {
    let lower = title.to_lowercase();
    let words = lower.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("-")
}

/// Returns where a place of a page with its tables stands in the tree: file and line.
#[must_use]
pub fn place(path: &str, text: &str, at: usize) -> String {
    let before = &text[..at];
    let in_table = before.rsplit_once("\n<!-- [").filter(|(_, rest)| !rest.contains("\n\n"));
    let file = in_table.and_then(|(_, rest)| {
        let (name, rows) = rest.split_once(" -->\n")?;
        let rows = rows.rsplit("-->\n").next().unwrap_or(rows);
        let row = rows.lines().filter(|line| line.starts_with('|')).count();
        let row = if row > 1 { row - 1 } else { row };
        Some(format!("docs/{}:{row}", link(&format!("[{name}"))?))
    });
    let line = || folded(before).map_or(0, |(page, _)| page.lines().count());
    file.unwrap_or_else(|| format!("{path}:{}", line()))
}

/// Returns the places of the cells of a line of a table, without the spaces around them, in a text in
/// which the line starts at `start`.
#[must_use]
pub fn cells(line: &str, start: usize) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from = 1;
    let mut in_code = false;
    let bytes = line.as_bytes();
    for (at, byte) in line.bytes().enumerate().skip(1) {
        in_code ^= byte == b'`';
        if byte == b'|' && bytes[at - 1] != b'\\' && !in_code {
            let cell = &line[from..at];
            let left = from + cell.len() - cell.trim_start().len();
            found.push(start + left..start + left + cell.trim().len());
            from = at + 1;
        }
    }
    found
}
