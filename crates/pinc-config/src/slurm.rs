//! The table `[sweep.slurm]`: what a sweep asks of Slurm.

use crate::Problem;
use toml::{Table, Value};

/// What is said in the scripts themselves.
const OWN: [&str; 9] = [
    "array",
    "chdir",
    "dependency",
    "job-name",
    "ntasks",
    "open-mode",
    "output",
    "requeue",
    "wrap",
];

/// The resources that a sweep asks of Slurm.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlurmSpec {
    /// Options of `sbatch` by their long names, as `partition` or `time`, with their values.
    pub options: Vec<(String, String)>,
    /// Modules to load with `module load` before the program is started.
    pub modules: Vec<String>,
    /// How many jobs share the sweep, at most.
    pub jobs: Option<usize>,
}

impl SlurmSpec {
    /// Reads a table with `jobs`, `modules`, and options of `sbatch`.
    ///
    /// # Errors
    ///
    /// The key that is wrong, and what is wrong with its value.
    pub fn of(table: &Table) -> Result<Self, (String, Problem)> {
        let mut spec = Self::default();
        for (key, value) in table {
            let wrong = |expected: &str| {
                let (found, expected) = (value.to_string(), expected.to_owned());
                Err((key.clone(), Problem::Value { found, expected }))
            };
            match (key.as_str(), value) {
                ("jobs", _) => {
                    let jobs = text(value).and_then(|text| text.parse().ok());
                    let Some(jobs @ 1..=10_000) = jobs else {
                        return wrong("a number from 1 to 10000");
                    };
                    spec.jobs = Some(jobs);
                }
                ("modules", _) => {
                    let Some(modules) = names(value) else {
                        return wrong("a list of names of modules, as [\"gcc/12\"]");
                    };
                    spec.modules = modules;
                }
                (key, _) if OWN.contains(&key) => {
                    return wrong("another option: the scripts set this one");
                }
                (key, _) if !is_option(key) => {
                    return wrong("the long name of an option of sbatch, as `partition` or `time`");
                }
                _ => match text(value).filter(|text| is_plain(text)) {
                    Some(text) => spec.options.push((key.clone(), text)),
                    None => return wrong("a number, or a text without spaces and quotes"),
                },
            }
        }
        Ok(spec)
    }
}

fn text(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Integer(number) => Some(number.to_string()),
        _ => None,
    }
}

/// A list of names, or these with commas between them.
fn names(value: &Value) -> Option<Vec<String>> {
    let names: Vec<String> = match value {
        Value::String(text) => text.split(',').map(str::to_owned).collect(),
        Value::Array(list) => list.iter().map(text).collect::<Option<_>>()?,
        _ => return None,
    };
    names.iter().all(|name| is_plain(name)).then_some(names)
}

fn is_option(key: &str) -> bool {
    key.starts_with(|c: char| c.is_ascii_lowercase())
        && key.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
}

/// Whether a text means itself in a script.
fn is_plain(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || "_-.,:/+=@%".contains(c))
}
