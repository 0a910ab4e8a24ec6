//! The `[sweep]` section.

use crate::search::placed;
use crate::validate::Checked;
use crate::validate::values::{at_least_one, ordered, value};
use crate::{SearchSpec, SlurmSpec};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The experiment many times over: one trial for each combination of a seed, a case, a value of
/// each axis of the grid, a candidate of the search, and a draw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepSpec {
    /// Seeds of the trials; if there are none, the seed of the experiment.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seeds: Vec<u64>,
    /// Whether times of trials are measured. Trials then run one at a time, after all trainings.
    #[serde(default)]
    pub timed: bool,
    /// Whether each trial keeps the traces of its closed loops.
    #[serde(default)]
    pub keep_traces: bool,
    /// Alternatives that differ in several keys.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cases: Vec<CaseSpec>,
    /// Axes of the grid. Each is crossed with all others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grid: Vec<AxisSpec>,
    /// Groups of trials with values drawn at random.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub draws: Vec<DrawsSpec>,
    /// A search among candidates drawn at random.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub search: Option<SearchSpec>,
    /// Requests to Slurm: `jobs`, `modules`, and options of `sbatch` by their long names. The
    /// resolved config leaves them out.
    #[serde(default, skip_serializing)]
    pub slurm: toml::Table,
}

/// An axis of the grid: one key and its values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisSpec {
    /// Key path, as `--set` has it: `model.neurons`, `training.phases.0.iterations`.
    pub key: String,
    /// Key paths that take the same value, as `control.nu` beside `control.n2`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<String>,
    /// Values of the key.
    pub values: Vec<toml::Value>,
}

/// An alternative: a name, and values for several keys.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseSpec {
    /// Name of the case in tables and pictures.
    pub name: String,
    /// Values by key path, as `--set` has it.
    pub set: toml::Table,
}

/// A number of trials with values drawn at random from the experiment's own seed: the same draws
/// for all other choices of the sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrawsSpec {
    /// Name of the group in tables and pictures.
    pub name: String,
    /// Number of draws.
    pub count: usize,
    /// Whether each draw has its own `control.noise_seed`.
    #[serde(default)]
    pub seeded: bool,
    /// Seed of the draws; that of the experiment if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Ranges of the values, drawn uniformly and independently.
    #[serde(default)]
    pub ranges: Vec<RangeSpec>,
}

/// A value drawn uniformly from a range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangeSpec {
    /// Key path, as `--set` has it.
    pub key: String,
    /// Lower end of the range.
    pub low: f64,
    /// Upper end of the range.
    pub high: f64,
}

/// Most trials of a sweep.
const MOST_TRIALS: usize = 100_000;

impl SweepSpec {
    /// Checks what can be checked without looking at the trials.
    pub(crate) fn validate(&self, has_loop: bool) -> Checked {
        distinct("sweep.seeds", &self.seeds)?;
        for (i, axis) in self.grid.iter().enumerate() {
            let here = format!("sweep.grid[{i}].values");
            if axis.values.is_empty() {
                return value(&here, "[]", "one value or more");
            }
            distinct(&here, &axis.values)?;
        }
        SlurmSpec::of(&self.slurm)
            .map_err(|(key, problem)| (format!("sweep.slurm.{key}"), problem))?;
        self.names()?;
        for (i, draws) in self.draws.iter().enumerate() {
            let here = format!("sweep.draws[{i}]");
            at_least_one(&format!("{here}.count"), draws.count)?;
            if draws.seeded && !has_loop {
                let expected = "false without [control]: it is for the noise of a loop";
                return value(&format!("{here}.seeded"), true, expected);
            }
            if draws.ranges.is_empty() && !draws.seeded && draws.count > 1 {
                let expected = "one range or more, or seeded = true: the draws are equal otherwise";
                return value(&format!("{here}.ranges"), "[]", expected);
            }
            for (j, range) in draws.ranges.iter().enumerate() {
                ordered(&format!("{here}.ranges[{j}].low"), range.low, range.high)?;
            }
        }
        self.search.as_ref().map_or(Ok(()), SearchSpec::validate)?;
        self.keys()?;
        self.size()
    }

    /// Each part of the sweep has keys of its own: of two values for one key the first would be
    /// ignored. Cases and groups of draws are alternatives, which may set the same keys.
    fn keys(&self) -> Checked {
        let mut known = BTreeSet::new();
        for (i, case) in self.cases.iter().enumerate() {
            for key in case.set.keys() {
                may_be_swept(&format!("sweep.cases[{i}].set"), key)?;
                known.insert(key.as_str());
            }
        }
        let grid = self.grid.iter().enumerate();
        let grid =
            grid.flat_map(|(i, axis)| placed(&format!("sweep.grid[{i}]"), &axis.key, &axis.also));
        for (place, key) in grid.chain(self.search.iter().flat_map(SearchSpec::keys)) {
            set_once(&place, key, &mut known)?;
        }
        for (i, draws) in self.draws.iter().enumerate() {
            let mut known = known.clone();
            for (j, range) in draws.ranges.iter().enumerate() {
                set_once(&format!("sweep.draws[{i}].ranges[{j}].key"), &range.key, &mut known)?;
            }
        }
        Ok(())
    }

    /// Names are cells of tables, which tell trials apart and are opened by other programs.
    fn names(&self) -> Checked {
        let cases = self.cases.iter().enumerate();
        let cases = cases.map(|(i, case)| (format!("sweep.cases[{i}].name"), &case.name));
        let draws = self.draws.iter().enumerate();
        let draws = draws.map(|(i, draws)| (format!("sweep.draws[{i}].name"), &draws.name));
        let mut taken = [BTreeSet::new(), BTreeSet::new()];
        let listed = cases.map(|named| (0, named)).chain(draws.map(|named| (1, named)));
        for (list, (key, name)) in listed {
            if name.starts_with(['=', '+', '-', '@']) || name.contains(char::is_control) {
                let expected = "a name without control characters that does not begin with =, +, - or @, \
                                which start formulas in spreadsheets";
                return value(&key, format!("{name:?}"), expected);
            }
            if !taken[list].insert(name) {
                return value(&key, format!("{name:?}"), "a name that no earlier one has");
            }
        }
        Ok(())
    }

    fn size(&self) -> Checked {
        let drawn: usize =
            self.draws.iter().map(|draws| draws.count).fold(0, usize::saturating_add);
        let candidates = self.search.as_ref();
        let candidates = candidates.map_or(0, |s| s.candidates.saturating_mul(s.rungs()));
        let factors = [self.seeds.len(), self.cases.len(), candidates, drawn];
        let lengths = self.grid.iter().map(|axis| axis.values.len());
        let product = factors.into_iter().chain(lengths).map(|n| n.max(1));
        let trials = product.fold(1_usize, usize::saturating_mul);
        if trials > MOST_TRIALS {
            let expected = format!("{MOST_TRIALS} at most");
            return value("sweep", format!("{trials} trials"), &expected);
        }
        Ok(())
    }
}

/// Checks that no two of these are equal: they would be the same trials, counted twice.
fn distinct<T: PartialEq + std::fmt::Display>(place: &str, values: &[T]) -> Checked {
    match values.iter().enumerate().find(|(i, item)| values[..*i].contains(item)) {
        Some((_, twice)) => value(place, format!("{twice} twice"), "values that differ"),
        None => Ok(()),
    }
}

/// Checks that `key` may be swept, and replaces none of those before it, nor the table or list that
/// one of them is in.
pub(crate) fn set_once<'a>(place: &str, key: &'a str, known: &mut BTreeSet<&'a str>) -> Checked {
    may_be_swept(place, key)?;
    let replaced =
        |other: &&str| other.strip_prefix(key).is_some_and(|r| r.is_empty() || r.starts_with('.'));
    if known.iter().any(replaced) {
        return value(place, format!("{key:?}"), "a key that no other range, axis or case sets");
    }
    known.insert(key);
    Ok(())
}

/// Whether the trials of one sweep may differ in `key`.
fn may_be_swept(place: &str, key: &str) -> Checked {
    let top = key.split('.').next().unwrap_or_default();
    let instead = match top {
        "preset" => "another key: a preset is chosen for the sweep as a whole",
        "seed" => "another key: seeds are listed in sweep.seeds",
        "name" | "sweep" => "a key of the experiment that a trial runs",
        _ => return Ok(()),
    };
    value(place, format!("{key:?}"), instead)
}
