//! Accuracy against cost of the models of a sweep with `[one_step]`, each a dot.

use crate::data::Run;
use crate::number_tables::NumberTable;
use crate::picture::Picture;
use crate::trials::{Cell, Trials};
use pinc_chart::text::{self, MISSING};
use pinc_chart::{
    Axis, Figure, Kind, Label, Panel, Point, Shape, Span, Style, extent, state_color, state_mark,
};
use pinc_config::ModelKind;
use pinc_net::TrainingTarget;
use pinc_record::DISTILLED;
use pinc_record::metric::{self, Metric};

/// A loop counts as good if its IAE is at most this much above the most exact model's.
const EQUAL: f64 = 1.01;

/// The least difference of an IAE that a picture shows, in %.
const LEAST_SHOWN: f64 = 1e-3;

/// One model of one cell: medians over the trials. Errors in widths of the domain.
struct Entry {
    name: String,
    /// What curve it belongs to.
    group: String,
    is_net: bool,
    rms: f64,
    median: f64,
    p99: f64,
    jacobian: f64,
    forward_ns: f64,
    both_ns: f64,
    iae: f64,
    violation: f64,
    step_us: f64,
    training_s: Option<f64>,
}

/// Whether there is something to show.
pub(super) fn is_there(trials: &Trials) -> bool {
    ModelKind::ALL.into_iter().any(|model| trials.has(metric::ONE_STEP_RMS.with(model)))
}

fn entries(trials: &Trials) -> Vec<Entry> {
    let of_cell = |cell| ModelKind::ALL.into_iter().filter_map(move |m| entry(trials, cell, m));
    trials.cells().iter().flat_map(of_cell).collect()
}

fn entry(trials: &Trials, cell: &Cell, model: ModelKind) -> Option<Entry> {
    let median = |metric| trials.spread(cell, metric).map(|spread| spread.median);
    let of = |metric: &'static Metric| median(metric.with(model));
    let is_net = model == ModelKind::Pinc;
    // Where a step is not finite, neither is the error.
    let error = |metric| of(metric).unwrap_or(f64::INFINITY);
    let distilled = TrainingTarget::Integrator.to_string();
    Some(Entry {
        step_us: of(&metric::STEP_TIME)?,
        name: trials.name(cell),
        group: match is_net && trials.text(cell, metric::SOURCE.of_net()) == Some(&distilled) {
            true => DISTILLED.to_owned(),
            false => model.title().to_owned(),
        },
        is_net,
        rms: error(&metric::ONE_STEP_RMS),
        median: error(&metric::ONE_STEP_MEDIAN),
        p99: error(&metric::ONE_STEP_P99),
        jacobian: error(&metric::JACOBIAN_RMS),
        forward_ns: of(&metric::FORWARD)?,
        both_ns: of(&metric::FORWARD_JACOBIAN)?,
        iae: of(&metric::IAE_DENSE_SUM)?,
        violation: of(&metric::MAX_VIOLATION)?,
        training_s: median(metric::TRAINING_WALL.of_net()).filter(|_| is_net),
    })
}

/// One step: its error over its time, alone and with Jacobians. The loop: what it loses over its
/// time.
pub(super) fn pictures(run: &Run, trials: &Trials) -> Vec<Picture> {
    let entries = entries(trials);
    if entries.is_empty() {
        return Vec::new();
    }
    vec![steps(&entries), loops(run, &entries)]
}

fn steps(entries: &[Entry]) -> Picture {
    let y = "error of one step (widths of the domain)";
    let panel = |title: &str, silent: bool, time: &dyn Fn(&Entry) -> f64| {
        let mut panel = Panel::new(title, Axis { silent, ..Axis::new(y, Kind::Log) }, 380.0);
        panel.x = Some(Axis::new("time per step of T (ns)", Kind::Log));
        add(&mut panel, entries, &|e| (time(e), e.rms));
        for (i, group) in groups(entries).iter().enumerate() {
            for entry in entries.iter().filter(|e| e.group == *group && e.rms.is_finite()) {
                let (name, y) =
                    (format!("{}, median to 99 %", entry.name), (entry.median, entry.p99));
                panel.spans.push(Span { name, x: time(entry), y, color: state_color(i) });
            }
        }
        panel
    };
    let panels = vec![
        panel("One step alone, each waiting for the one before", false, &|e| e.forward_ns),
        panel("With Jacobians, a horizon's steps at a time", true, &|e| e.both_ns),
    ];
    let x = Axis::new("time per step of T (ns)", Kind::Log);
    let figure = Figure::grid("Error of one step over its time", x, vec![1.0, 1.0], panels);
    let caption = "Further left is cheaper, further down better. A mark is the root mean square \
                   over points that fill the domain; its interval reaches from the median to the \
                   99th percentile. A method that leaves all bounds somewhere has none. From \
                   sweep.csv and timings.csv.";
    Picture::new("accuracy-cost", "One step: accuracy against cost", figure, caption)
}

/// By how much an IAE differs from `truth` in %, as far as a logarithmic axis shows it.
fn off_percent(iae: f64, truth: f64) -> f64 {
    (100.0 * (iae / truth - 1.0)).abs().max(LEAST_SHOWN)
}

fn loops(run: &Run, entries: &[Entry]) -> Picture {
    let x = || Axis::new("controller's time per step (µs)", Kind::Log);
    let truth = iae_of_most_exact(entries);
    let off = |e: &Entry| off_percent(e.iae, truth);
    let mut iae = Panel::new("Tracking", Axis::new("IAE off by (%)", Kind::Log), 300.0);
    add(&mut iae, entries, &|e| (e.step_us, off(e)));
    let violations = || entries.iter().map(|e| e.violation).filter(|v| *v > 0.0);
    let (low, high) = extent(violations());
    let kind = if high > 10.0 * low { Kind::Log } else { Kind::Linear };
    let mut violation = Panel::new("Bounds", Axis::new(metric::MAX_VIOLATION.title, kind), 300.0);
    add(&mut violation, entries, &|e| (e.step_us, e.violation));
    violation.note = Some("No bound is violated.".to_owned());
    (iae.x, violation.x) = (Some(x()), Some(x()));
    let name = "Closed loop over the controller's time";
    let figure = Figure::grid(name, x(), vec![1.0, 1.0], vec![iae, violation]);
    let caption = format!(
        "Median time of a control step, with all that the controller does in it. Left: by how much \
         the IAE on the dense trace differs from {}, that with the numerical model whose steps are \
         the most exact; less than {LEAST_SHOWN} % is shown as that. Right: loops that violate no \
         bound have no place on a logarithmic axis. From sweep.csv and timings.csv.",
        run.label_in_states_unit(&text::significant(truth, 6), ""),
    );
    Picture::new("loop-cost", "Closed loop: quality against time", figure, caption)
}

/// The groups in the order in which they come.
fn groups(entries: &[Entry]) -> Vec<String> {
    let mut groups: Vec<String> = Vec::new();
    for entry in entries {
        if !groups.contains(&entry.group) {
            groups.push(entry.group.clone());
        }
    }
    groups
}

/// A mark for each entry, joined where one method has several numbers of substeps.
fn add(panel: &mut Panel, entries: &[Entry], place: &dyn Fn(&Entry) -> Point) {
    for (i, group) in groups(entries).iter().enumerate() {
        let (color, mark) = (state_color(i), state_mark(i));
        let members: Vec<&Entry> = entries.iter().filter(|e| e.group == *group).collect();
        let points: Vec<Point> = members.iter().map(|e| place(e)).collect();
        if members.iter().all(|e| !e.is_net) {
            // Along the costs, in whatever order the models were tried.
            let mut line = points.clone();
            line.sort_by(|a, b| a.0.total_cmp(&b.0));
            panel.add("", line, Style::new(color, Shape::Line(1.2)).faint(0.6));
        }
        panel.add_named(group, points, Style::new(color, mark));
        panel.labels.extend(members.iter().map(|e| {
            // The legend says the rest.
            let prefix = group.split(' ').next().unwrap_or_default();
            let text = e.name.strip_prefix(prefix).unwrap_or(&e.name).trim().to_owned();
            Label { at: place(e), text, color }
        }));
    }
}

/// The numbers behind the pictures, and for each net the cheapest numerical model that is as good.
pub(super) fn number_tables(trials: &Trials) -> Vec<NumberTable> {
    let entries = entries(trials);
    vec![steps_table(&entries), loops_table(&entries)]
}

fn steps_table(entries: &[Entry]) -> NumberTable {
    let heads = [
        "model",
        "rms",
        "median",
        "99 %",
        "Jacobians, rms",
        "alone, ns",
        "times faster",
        "with Jacobians, ns",
        "times faster",
    ];
    let rows = entries.iter().map(|e| {
        let as_exact = |time: &dyn Fn(&Entry) -> f64| match e.is_net {
            true => faster_step(e, entries, time),
            false => MISSING.to_owned(),
        };
        vec![
            e.name.clone(),
            number(e.rms),
            number(e.median),
            number(e.p99),
            number(e.jacobian),
            number(e.forward_ns),
            as_exact(&|e| e.forward_ns),
            number(e.both_ns),
            as_exact(&|e| e.both_ns),
        ]
    });
    let title = "One step: errors in widths of the domain. \"Times faster\" compares a net with \
    the numerical \
                 method that has the same rms in the least time, between its numbers of substeps \
                 in proportion";
    NumberTable::new(title, heads, rows)
}

fn loops_table(entries: &[Entry]) -> NumberTable {
    let heads =
        ["model", "IAE", "off by", "violation", "control step, µs", "times faster", "training, s"];
    let truth = iae_of_most_exact(entries);
    let rows = entries.iter().map(|e| {
        // A net whose loop is good, and those numerical ones that are, too, and keep bounds as
        // well.
        let is_good = |e: &Entry| e.iae <= EQUAL * truth;
        let as_good = entries.iter().filter(|other| {
            let comparable = e.is_net && !other.is_net && is_good(e) && is_good(other);
            comparable && other.violation <= e.violation.max(1e-6)
        });
        vec![
            e.name.clone(),
            text::significant(e.iae, 6),
            format!("{} %", number(100.0 * (e.iae / truth - 1.0))),
            number(e.violation),
            number(e.step_us),
            faster_loop(e, as_good),
            e.training_s.map_or(MISSING.to_owned(), number),
        ]
    });
    let title = "Closed loop: IAE on the dense trace, and by how much it is off that with the \
    numerical model \
                 whose steps are the most exact. \"Times faster\" compares a net whose IAE is at \
                 most 1 % above that with the \
                 cheapest numerical model of which this holds, too, and which keeps bounds as well";
    NumberTable::new(title, heads, rows)
}

fn number(value: f64) -> String {
    match value.is_finite() {
        true => text::significant(value, 3),
        false => "not finite".to_owned(),
    }
}

/// The IAE with the numerical model whose steps are the most exact (the net's, if there is no
/// other): what a perfect model would give.
fn iae_of_most_exact(entries: &[Entry]) -> f64 {
    let exactest = |nets: bool| {
        let entries = entries.iter().filter(|e| e.is_net == nets);
        entries.min_by(|a, b| a.rms.total_cmp(&b.rms))
    };
    exactest(false).or_else(|| exactest(true)).map_or(f64::NAN, |e| e.iae)
}

/// By which factor a net's step is faster than the cheapest equally exact method's, and which
/// method that is.
fn faster_step(net: &Entry, entries: &[Entry], time: &dyn Fn(&Entry) -> f64) -> String {
    let groups = groups(entries).into_iter();
    let times = groups.filter_map(|group| {
        let mut members: Vec<&Entry> =
            entries.iter().filter(|e| !e.is_net && e.group == group).collect();
        members.sort_by(|a, b| time(a).total_cmp(&time(b)));
        Some((time_for(net.rms, &members, time)?, group))
    });
    times.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(MISSING.to_owned(), |(of, group)| {
        format!("{} ({group})", text::significant(of / time(net), 2))
    })
}

/// The time in which a method, of which these are members by their times, has an error of `rms`:
/// between two of them a power of the error. `None` if none is as exact.
fn time_for(rms: f64, members: &[&Entry], time: &dyn Fn(&Entry) -> f64) -> Option<f64> {
    let k = members.iter().position(|e| e.rms <= rms)?;
    let (after, t) = (members[k], time(members[k]));
    let before = k.checked_sub(1).map(|k| members[k]).filter(|before| before.rms.is_finite());
    let Some(before) = before else { return Some(t) };
    let part = (before.rms / rms).ln() / (before.rms / after.rms).ln();
    Some(time(before) * (t / time(before)).powf(part))
}

/// By which factor a net's loop is faster than the cheapest of some, and which that is.
fn faster_loop<'a>(net: &Entry, others: impl Iterator<Item = &'a Entry>) -> String {
    let cheapest = others.min_by(|a, b| a.step_us.total_cmp(&b.step_us));
    cheapest.map_or(MISSING.to_owned(), |other| {
        format!("{} ({})", text::significant(other.step_us / net.step_us, 2), other.name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(name: &str, group: &str, rms: f64, ns: f64) -> Entry {
        Entry {
            name: name.to_owned(),
            group: group.to_owned(),
            is_net: group == "PINC",
            rms,
            median: rms,
            p99: rms,
            jacobian: rms,
            forward_ns: ns,
            both_ns: ns,
            iae: 1.0,
            violation: 0.0,
            step_us: 1e-3 * ns,
            training_s: None,
        }
    }

    #[test]
    fn loops_are_off_by_per_cent_of_the_most_exact() {
        for (iae, expected) in [(2.2, 10.0), (1.9, 5.0), (2.0, 1e-3), (2.000_000_1, 1e-3)] {
            let found = off_percent(iae, 2.0);
            assert!((found - expected).abs() < 1e-9, "{iae}: {found}");
        }
    }

    #[test]
    fn a_net_is_compared_with_the_method_as_exact() {
        let entries = [
            entry("net", "PINC", 1e-5, 50.0),
            entry("x1", "RK4", 1e-2, 100.0),
            entry("x2", "RK4", 1e-4, 200.0),
            entry("x4", "RK4", 1e-6, 400.0),
            entry("x1", "RK5", 1e-3, 150.0),
        ];
        // Half-way between 200 and 400 ns, in powers: 283 ns. RK5 never is as exact.
        assert_eq!(faster_step(&entries[0], &entries, &|e| e.forward_ns), "5.7 (RK4)");
        let rough = entry("net", "PINC", 1.0, 50.0);
        assert_eq!(faster_step(&rough, &entries, &|e| e.forward_ns), "2.0 (RK4)");
        let unstable = [entry("x1", "RK4", f64::INFINITY, 100.0), entry("x2", "RK4", 1e-4, 200.0)];
        assert_eq!(faster_step(&rough, &unstable, &|e| e.forward_ns), "4.0 (RK4)");
        let exact = entry("net", "PINC", 1e-9, 50.0);
        assert_eq!(faster_step(&exact, &entries, &|e| e.forward_ns), MISSING);
        assert_eq!(faster_loop(&entries[0], entries[2..].iter()), "3.0 (x1)");
    }

    /// The lines go from the cheapest to the dearest, in whatever order the models were tried.
    #[test]
    fn a_method_is_one_line_along_its_cost() {
        let entries = [
            entry("x4", "RK4", 1e-6, 400.0),
            entry("x8", "RK4", 1e-8, 800.0),
            entry("x2", "RK4", 1e-4, 200.0),
            entry("x1", "RK4", 1e-2, 100.0),
        ];
        let mut panel = Panel::new("", Axis::new("", Kind::Log), 100.0);
        add(&mut panel, &entries, &|e| (e.forward_ns, e.rms));
        let line: Vec<f64> = panel.series[0].points.iter().map(|point| point.0).collect();
        assert_eq!(line, [100.0, 200.0, 400.0, 800.0]);
        assert_eq!(panel.labels[0].at.0.to_bits(), 400.0_f64.to_bits());
    }
}
