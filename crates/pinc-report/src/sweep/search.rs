//! A search: what the candidates gave over each value that was drawn, and the best of them.

use crate::number_tables::NumberTable;
use crate::picture::Picture;
use crate::trials::{self, Cell, Trials};
use pinc_chart::{Axis, Figure, Kind, Label, Panel, Point, Style, state_color, state_mark, text};
use pinc_config::{CANDIDATE, Experiment, SearchRange, SearchSpec};
use pinc_record::TrialMetric;

/// How many candidates the table has.
const NAMED: usize = 10;

/// A candidate with a budget.
struct Entry<'a> {
    cell: &'a Cell,
    /// Its place among the budgets.
    rung: usize,
    median: f64,
}

/// The search of an experiment, with what it minimizes.
pub(super) fn of(experiment: &Experiment) -> Option<(&SearchSpec, TrialMetric)> {
    let search = experiment.sweep.as_ref()?.search.as_ref()?;
    Some((search, TrialMetric::searched(experiment).ok()??))
}

/// The candidates with their medians, the best of the largest budget first.
fn entries<'a>(trials: &'a Trials, search: &SearchSpec, metric: TrialMetric) -> Vec<Entry<'a>> {
    let budgets: Vec<String> = search
        .halving
        .iter()
        .flat_map(|halving| (0..halving.rungs).map(|rung| halving.budget(rung).to_string()))
        .collect();
    let column = search.halving.as_ref().map(|halving| halving.key.as_str());
    let entry = |cell: &'a Cell| {
        let budget = column.and_then(|column| trials.place(cell, column));
        let rung = budget.and_then(|budget| budgets.iter().position(|other| other == budget));
        let median = trials.spread(cell, metric)?.median;
        Some(Entry { cell, rung: rung.unwrap_or(0), median })
    };
    let mut entries: Vec<_> = trials.cells().iter().filter_map(entry).collect();
    entries.sort_by(|a, b| b.rung.cmp(&a.rung).then(a.median.total_cmp(&b.median)));
    entries
}

/// A panel for each number that was drawn.
pub(super) fn picture(
    trials: &Trials,
    (search, metric): (&SearchSpec, TrialMetric),
) -> Option<Picture> {
    let entries = entries(trials, search, metric);
    let positive = entries.iter().all(|entry| entry.median > 0.0);
    let y = Axis::new(&metric.name(), if positive { Kind::Log } else { Kind::Linear });
    let panels: Vec<Panel> = search
        .ranges
        .iter()
        .filter_map(|range| panel(trials, search, range, &y, &entries))
        .collect();
    let columns = if panels.len() > 1 { vec![1.0, 1.0] } else { vec![1.0] };
    let x = Axis::new("", Kind::Linear);
    let title = format!("Search for a small {}", metric.name());
    let caption = format!(
        "A mark is a candidate{}: the median of its trials. The best one of the largest budget is \
         named. From sweep.csv.",
        if search.halving.is_some() { " with a budget" } else { "" }
    );
    let any = !panels.is_empty();
    let figure = Figure::grid(&title, x, columns, panels);
    any.then(|| Picture::new("search", title, figure, caption))
}

/// The candidates over one value; none if it is no number.
fn panel(
    trials: &Trials,
    search: &SearchSpec,
    range: &SearchRange,
    y: &Axis,
    entries: &[Entry<'_>],
) -> Option<Panel> {
    let at = |entry: &Entry<'_>| -> Option<Point> {
        let value = trials.choice(*entry.cell.finished.first()?, &range.key);
        Some((value.parse().ok()?, entry.median))
    };
    let name = trials::short(&range.key);
    let mut panel = Panel::new(&name, y.clone(), 220.0);
    let kind = match (range.log, range.whole) {
        (true, _) => Kind::Log,
        (false, true) => Kind::Count,
        (false, false) => Kind::Linear,
    };
    panel.x = Some(Axis::new(&name, kind));
    let mut any = false;
    for rung in 0..search.rungs() {
        let points: Vec<Point> =
            entries.iter().filter(|entry| entry.rung == rung).filter_map(at).collect();
        any |= !points.is_empty();
        let name = match &search.halving {
            Some(halving) => format!("{} {}", trials::short(&halving.key), halving.budget(rung)),
            None => "candidates".to_owned(),
        };
        if !points.is_empty() {
            panel.add_named(&name, points, Style::new(state_color(rung), state_mark(rung)));
        }
    }
    if let Some(best) = entries.first()
        && let Some(at) = at(best)
    {
        let color = state_color(best.rung);
        panel.labels.push(Label { at, text: candidate(trials, best.cell), color });
    }
    any.then_some(panel)
}

fn candidate(trials: &Trials, cell: &Cell) -> String {
    trials.place(cell, CANDIDATE).map_or_else(String::new, str::to_owned)
}

/// The best candidates with their values.
pub(super) fn number_table(
    trials: &Trials,
    (search, metric): (&SearchSpec, TrialMetric),
) -> NumberTable {
    let entries = entries(trials, search, metric);
    let keys = search.ranges.iter().map(|range| range.key.as_str());
    let keys: Vec<&str> = keys.collect();
    let places = trials.columns().iter().filter(|column| *column != CANDIDATE);
    let places: Vec<&String> = places.collect();
    let mut heads = vec![CANDIDATE.to_owned()];
    heads.extend(places.iter().map(|place| trials::short(place)));
    heads.extend(keys.iter().map(|key| trials::short(key)));
    heads.extend([metric.name(), "trials".to_owned()]);
    let row = |entry: &Entry<'_>| {
        let first = entry.cell.finished.first().copied().unwrap_or(0);
        let mut row = vec![candidate(trials, entry.cell)];
        let place = |column: &&String| trials.place(entry.cell, column).unwrap_or_default();
        row.extend(places.iter().map(|column| trials::shown(place(column))));
        row.extend(keys.iter().map(|key| trials::shown(trials.choice(first, key))));
        row.extend([text::significant(entry.median, 4), text::count(entry.cell.done())]);
        row
    };
    let title = format!("Best candidates by {}", metric.name());
    NumberTable::new(title, heads, entries.iter().take(NAMED).map(row))
}
