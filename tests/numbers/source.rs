//! Runs commands, each once, and reads numbers from what they leave.

use crate::claim::Claim;
use crate::numeral::numerals;
use serde_json::Value;
use std::cell::RefCell;
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::rc::Rc;

/// What stands for a claim.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Found {
    Number(f64),
    Text(String),
}

/// What a command printed, and the folder in which it left its files.
#[derive(Debug)]
struct Output {
    printed: String,
    folder: PathBuf,
}

/// The commands that were run.
#[derive(Debug)]
pub(crate) struct Runner {
    root: PathBuf,
    pinc: PathBuf,
    /// Where they are run: a folder with the tree's configs and data.
    work: PathBuf,
    done: RefCell<HashMap<String, Rc<Result<Output, String>>>>,
    read: RefCell<HashMap<(String, String), Result<Found, String>>>,
}

impl Runner {
    /// Commands are run in `target/numbers`, with `pinc` for the program.
    pub(crate) fn new(root: &Path, pinc: &Path) -> Result<Self, String> {
        let problem = |error: std::io::Error| format!("target/numbers: {error}");
        let work = root.join("target/numbers");
        fs::create_dir_all(&work).map_err(problem)?;
        let _ = fs::remove_dir_all(work.join("runs"));
        for entry in fs::read_dir(root).map_err(problem)? {
            let entry = entry.map_err(problem)?;
            let link = work.join(entry.file_name());
            let name = entry.file_name();
            if ["target", "runs", ".git"].iter().all(|other| name != *other) && !link.exists() {
                std::os::unix::fs::symlink(entry.path(), link).map_err(problem)?;
            }
        }
        let pinc = pinc.canonicalize().map_err(|error| format!("{}: {error}", pinc.display()))?;
        Ok(Self {
            root: root.to_path_buf(),
            pinc,
            work,
            done: RefCell::default(),
            read: RefCell::default(),
        })
    }

    /// What a claim's command gives for it.
    pub(crate) fn value(&self, claim: &Claim) -> Result<Found, String> {
        let key = (claim.command.clone(), claim.source.clone());
        if let Some(known) = self.read.borrow().get(&key) {
            return known.clone();
        }
        for earlier in &claim.before {
            self.output(earlier).as_ref().as_ref().map_err(Clone::clone)?;
        }
        let output = self.output(&claim.command);
        let found = match output.as_ref() {
            Ok(output) => read(output, &claim.source),
            Err(problem) => Err(problem.clone()),
        };
        self.read.borrow_mut().insert(key, found.clone());
        found
    }

    fn output(&self, command: &str) -> Rc<Result<Output, String>> {
        if let Some(known) = self.done.borrow().get(command) {
            return Rc::clone(known);
        }
        let output = Rc::new(self.run(command));
        self.done.borrow_mut().insert(command.to_owned(), Rc::clone(&output));
        output
    }

    fn run(&self, command: &str) -> Result<Output, String> {
        crate::say(&format!("$ {command}"));
        let command = command.replacen("cargo run --release --", "pinc", 1);
        let mut words = words(&command)?;
        let program = words.remove(0);
        let place = self.done.borrow().len();
        let mut folder = self.work.join(format!("runs/command-{place}"));
        let kind = words.first().cloned().unwrap_or_default();
        let named = words.iter().position(|word| word == "--out").and_then(|at| words.get(at + 1));
        match named {
            Some(named) => folder = self.work.join(named),
            None if program == "pinc"
                && ["run", "train", "control", "identify"].contains(&kind.as_str()) =>
            {
                words.extend(["--out".to_owned(), folder.display().to_string()]);
            }
            None => {}
        }
        let program = if program == "pinc" { self.pinc.clone() } else { PathBuf::from(program) };
        // Other programs look for `pinc` in the tree's own `target`.
        let folder_of =
            if program == self.pinc { self.work.as_path() } else { self.root.as_path() };
        let output = Command::new(&program).args(&words).current_dir(folder_of).output();
        let output = output.map_err(|error| format!("{}: {error}", program.display()))?;
        let printed = String::from_utf8_lossy(&output.stdout).into_owned();
        if output.status.success() {
            return Ok(Output { printed, folder });
        }
        let errors = String::from_utf8_lossy(&output.stderr);
        Err(format!("`{command}` failed: {}", errors.lines().last().unwrap_or_default()))
    }
}

/// The words of a command, as a shell takes them apart.
fn words(command: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in command.chars() {
        match (c, quote) {
            ('\'' | '"', None) => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (c, Some(open)) if c == open => quote = None,
            (c, None) if c.is_whitespace() => words.extend(word.take()),
            (c, _) => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word.take());
    match (quote, words.is_empty()) {
        (None, false) => Ok(words),
        _ => Err(format!("`{command}` is no command")),
    }
}

/// Reads a source:
///
/// - `control.rk4.iae_dense_sum`: of `metrics.json`;
/// - `sweep[case=plain].rk4_iae_dense_sum`: of the row of `sweep.csv` with this case; likewise
///   `summary[..]` and `estimates[..]`, and `?_iae` for the one column of this ending that has a value;
/// - `steps[first].linearized`: of `steps.csv` the first, or of the others the `median`, the value
///   that `99` per cent do not exceed, or the `most`;
/// - `identification.json k1.value` of any JSON file;
/// - `printed RMSE 2`: the second number behind the word in what is printed;
/// - `row 64 none / 1`: the first number behind these words at the beginning of a line;
/// - `root ..` and `log10 ..`: of what is read there;
/// - `line 3 number 0`: of what is printed;
/// - `same 0 | 2 | name`: in the table that is printed, the first number of the column 2 in the row
///   of this name.
fn read(output: &Output, source: &str) -> Result<Found, String> {
    let (first, rest) = source.split_once(' ').unwrap_or((source, ""));
    match first {
        "printed" => printed(output, rest),
        "line" => line(output, rest),
        "root" => Ok(changed(read(output, rest)?, f64::sqrt)),
        "log10" => Ok(changed(read(output, rest)?, f64::log10)),
        "row" => row(output, rest),
        "same" => same(output, rest),
        file if file.ends_with(".json") => of_json(&output.folder.join(file), rest),
        _ if source.contains('[') => of_table(output, source),
        _ => of_json(&output.folder.join("metrics.json"), source),
    }
}

fn changed(found: Found, change: fn(f64) -> f64) -> Found {
    match found {
        Found::Number(value) => Found::Number(change(value)),
        Found::Text(text) => Found::Text(text),
    }
}

fn printed(output: &Output, rest: &str) -> Result<Found, String> {
    let problem = || format!("`{rest}` is not in what is printed: {}", output.printed.trim());
    let (word, number) = rest.rsplit_once(' ').ok_or_else(problem)?;
    let behind = output.printed.split_once(word).ok_or_else(problem)?.1;
    let number: usize = number.parse().map_err(|_| problem())?;
    let found = numerals(behind).into_iter().nth(number - 1).ok_or_else(problem)?;
    Ok(Found::Number(found.value))
}

fn line(output: &Output, rest: &str) -> Result<Found, String> {
    let problem = || format!("line {rest} is not in what is printed: {}", output.printed.trim());
    let mut places = rest.split(" number ").map(str::parse);
    let (Some(Ok(line)), Some(Ok(number))) = (places.next(), places.next()) else {
        return Err(problem());
    };
    let line = output.printed.lines().nth(line).ok_or_else(problem)?;
    let found = numerals(line).into_iter().nth(number).ok_or_else(problem)?;
    Ok(Found::Number(found.value))
}

fn row(output: &Output, rest: &str) -> Result<Found, String> {
    let problem = || format!("no line `{rest}` is printed: {}", output.printed.trim());
    let (words, number) = rest.split_once(" / ").ok_or_else(problem)?;
    let words: Vec<&str> = words.split_whitespace().collect();
    let number: usize = number.parse().map_err(|_| problem())?;
    let of_line = |line: &str| {
        let all: Vec<&str> = line.split_whitespace().collect();
        all.starts_with(&words).then(|| numerals(&all[words.len()..].join(" ")))
    };
    let found = output.printed.lines().find_map(of_line).ok_or_else(problem)?;
    let found = found.into_iter().nth(number - 1).ok_or_else(problem)?;
    Ok(Found::Number(found.value))
}

fn same(output: &Output, rest: &str) -> Result<Found, String> {
    let problem = || format!("no table with `{rest}` is printed: {}", output.printed.trim());
    let places: Vec<&str> = rest.splitn(3, " | ").collect();
    let [number, column, name] = places[..] else { return Err(problem()) };
    let (Ok(number), Ok(column)) = (number.parse::<usize>(), column.parse::<usize>()) else {
        return Err(problem());
    };
    let cells = output
        .printed
        .lines()
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect());
    let row = cells
        .into_iter()
        .find(|cells: &Vec<&str>| cells.first() == Some(&name))
        .ok_or_else(problem)?;
    let found = row
        .get(column)
        .and_then(|cell| numerals(cell).into_iter().nth(number))
        .ok_or_else(problem)?;
    Ok(Found::Number(found.value))
}

fn of_json(path: &Path, keys: &str) -> Result<Found, String> {
    let text = fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut value: Value =
        serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    for key in keys.split('.') {
        let inner = match &value {
            Value::Array(list) => {
                let named = |of: &&Value| ["model", "name"].iter().any(|name| of[*name] == key);
                list.iter().find(named).or_else(|| list.get(key.parse::<usize>().ok()?))
            }
            other => other.get(key),
        };
        value = inner.cloned().ok_or(format!("{}: no `{key}` of `{keys}`", path.display()))?;
    }
    match &value {
        Value::Number(number) => Ok(Found::Number(number.as_f64().unwrap_or(f64::NAN))),
        Value::String(text) => Ok(Found::Text(text.clone())),
        Value::Object(counts) => {
            let counts: Vec<String> =
                counts.iter().map(|(name, count)| format!("{count} {name}")).collect();
            Ok(Found::Text(counts.join(", ")))
        }
        _ => Err(format!("{}: `{keys}` is no number", path.display())),
    }
}

fn of_table(output: &Output, source: &str) -> Result<Found, String> {
    let problem = || format!("`{source}` is in no table");
    let (table, rest) = source.split_once('[').ok_or_else(problem)?;
    let (wanted, column) = rest.split_once("].").ok_or_else(problem)?;
    let path = output.folder.join(format!("{table}.csv"));
    let mut reader =
        csv::Reader::from_path(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let heads = reader.headers().map_err(|error| error.to_string())?.clone();
    let rows: Vec<csv::StringRecord> =
        reader.records().collect::<Result<_, _>>().map_err(|error| error.to_string())?;
    let places: Vec<usize> = match column.strip_prefix('?') {
        Some(ending) => (0..heads.len()).filter(|k| heads[*k].ends_with(ending)).collect(),
        None => (0..heads.len()).filter(|k| heads[*k] == *column).collect(),
    };
    if table == "steps" {
        let place = *places.first().ok_or_else(problem)?;
        let counts = rows.iter().filter_map(|row| row[place].parse().ok());
        return rank(&counts.collect::<Vec<f64>>(), wanted).map(Found::Number).ok_or_else(problem);
    }
    // A comma belongs to a value where no column follows it.
    let mut pairs: Vec<(&str, String)> = Vec::new();
    for part in wanted.split(',') {
        match part.split_once('=').filter(|(name, _)| heads.iter().any(|head| head == name.trim()))
        {
            Some((name, value)) => pairs.push((name.trim(), value.trim().to_owned())),
            None => pairs.last_mut().ok_or_else(problem)?.1 += &format!(",{part}"),
        }
    }
    let is_wanted = |row: &&csv::StringRecord| {
        pairs.iter().all(|(name, value)| {
            heads.iter().zip(row.iter()).any(|(head, cell)| head == *name && cell == value)
        })
    };
    let row = rows.iter().find(is_wanted).ok_or_else(problem)?;
    let cell = places.iter().map(|k| &row[*k]).find(|cell| !cell.is_empty()).ok_or_else(problem)?;
    Ok(cell.parse().map_or_else(|_| Found::Text(cell.to_owned()), Found::Number))
}

/// The first count, or of the others the one at a rank.
fn rank(counts: &[f64], which: &str) -> Option<f64> {
    let (first, others) = counts.split_first()?;
    let mut sorted = others.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    match which {
        "first" => Some(*first),
        "median" => Some(sorted[(50 * sorted.len()).div_ceil(100) - 1]),
        "99" => Some(sorted[(99 * sorted.len()).div_ceil(100) - 1]),
        "most" => Some(sorted[last]),
        _ => None,
    }
}
