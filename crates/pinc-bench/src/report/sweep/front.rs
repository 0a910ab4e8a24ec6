//! Accuracy against cost: what the models of a sweep with `[one_step]` come to, each a dot.

use super::super::chart::{
    Axis, Figure, Kind, Label, Panel, Point, Shape, Span, Style, state_color, state_mark,
};
use super::super::data::{DISTILLED, Run, model_name};
use super::super::picture::Picture;
use super::super::sheets::Sheet;
use super::super::text::{self, MISSING};
use super::trials::{Cell, Trials};
use crate::spec::ModelKind;

/// A loop counts as equally good if its IAE is at most this much above the least.
const EQUAL: f64 = 1.01;

/// A one-step error counts as equally small up to this factor.
const AS_SMALL: f64 = 1.05;

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
    ModelKind::ALL.iter().any(|model| trials.has(&format!("{model}_one_step_rms")))
}

fn entries(trials: &Trials) -> Vec<Entry> {
    let of_cell = |cell| ModelKind::ALL.into_iter().filter_map(move |m| entry(trials, cell, m));
    trials.cells().iter().flat_map(of_cell).collect()
}

fn entry(trials: &Trials, cell: &Cell, model: ModelKind) -> Option<Entry> {
    let median = |column: &str| trials.spread(cell, column).map(|spread| spread.median);
    let value = |column: &str| median(&format!("{model}_{column}"));
    let is_net = model == ModelKind::Pinc;
    Some(Entry {
        name: trials.name(cell),
        group: match is_net && trials.text(cell, "source") == Some("integrator") {
            true => DISTILLED.to_owned(),
            false => model_name(model.name()),
        },
        is_net,
        rms: value("one_step_rms")?,
        median: value("one_step_median")?,
        p99: value("one_step_p99")?,
        jacobian: value("jacobian_rms")?,
        forward_ns: value("forward_ns")?,
        both_ns: value("forward_jacobian_ns")?,
        iae: value("iae_dense_sum")?,
        violation: value("max_violation")?,
        step_us: value("step_us")?,
        training_s: median("training_wall_s").filter(|_| is_net),
    })
}

/// One step: its error over its time, alone and with Jacobians. The loop: what it loses over its time.
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
            for entry in entries.iter().filter(|e| e.group == *group) {
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
    Picture {
        stem: "accuracy-cost".to_owned(),
        title: "One step: accuracy against cost".to_owned(),
        figure: Figure::grid("Error of one step over its time", x, vec![1.0, 1.0], panels),
        caption: "Further left is cheaper, further down better. A mark is the root mean square over points \
                  that fill the domain; its interval reaches from the median to the 99th percentile. From \
                  sweep.csv and timings.csv."
            .to_owned(),
    }
}

fn loops(run: &Run, entries: &[Entry]) -> Picture {
    let x = || Axis::new("controller's time per step (µs)", Kind::Log);
    let mut iae = Panel::new(
        "Tracking",
        Axis::new(&run.label_in_states_unit("IAE, dense trace", ""), Kind::Linear),
        300.0,
    );
    add(&mut iae, entries, &|e| (e.step_us, e.iae));
    let mut violation =
        Panel::new("Bounds", Axis::new("largest violation of a bound", Kind::Log), 300.0);
    add(&mut violation, entries, &|e| (e.step_us, e.violation));
    violation.note = Some("No bound is violated.".to_owned());
    (iae.x, violation.x) = (Some(x()), Some(x()));
    let panels = vec![iae, violation];
    Picture {
        stem: "loop-cost".to_owned(),
        title: "Closed loop: quality against time".to_owned(),
        figure: Figure::grid("Closed loop over the controller's time", x(), vec![1.0, 1.0], panels),
        caption: "Median time of a control step, with all that the controller does in it. Loops that violate \
                  no bound have no place on the logarithmic axis. From sweep.csv and timings.csv."
            .to_owned(),
    }
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
            panel.add("", points.clone(), Style::new(color, Shape::Line(1.2)).faint(0.6));
        }
        panel.add_named(group, points, Style::new(color, mark));
        panel.labels.extend(members.iter().map(|e| {
            let text = e.name.strip_prefix(group.as_str()).unwrap_or(&e.name).trim().to_owned();
            Label { at: place(e), text, color }
        }));
    }
}

/// The numbers behind the pictures, and for each net the cheapest numerical model that is as good.
pub(super) fn sheet(trials: &Trials) -> Sheet {
    let entries = entries(trials);
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
        "IAE",
        "violation",
        "control step, µs",
        "times faster",
        "training, s",
    ];
    let least = entries.iter().map(|e| e.iae).fold(f64::INFINITY, f64::min);
    let rows = entries.iter().map(|e| {
        let numerical = || entries.iter().filter(|other| e.is_net && !other.is_net);
        let as_exact = || numerical().filter(|other| other.rms <= AS_SMALL * e.rms);
        // As good as the best, and no worse about bounds than the net.
        let as_good = numerical().filter(|other| {
            e.iae <= EQUAL * least
                && other.iae <= EQUAL * least
                && other.violation <= e.violation.max(1e-6)
        });
        let number = |v: f64| text::significant(v, 3);
        vec![
            e.name.clone(),
            number(e.rms),
            number(e.median),
            number(e.p99),
            number(e.jacobian),
            number(e.forward_ns),
            faster(e, as_exact(), |e| e.forward_ns),
            number(e.both_ns),
            faster(e, as_exact(), |e| e.both_ns),
            text::significant(e.iae, 6),
            number(e.violation),
            number(e.step_us),
            faster(e, as_good, |e| e.step_us),
            e.training_s.map_or(MISSING.to_owned(), number),
        ]
    });
    Sheet {
        title: "Accuracy against cost (errors in widths of the domain). \"Times faster\" compares a net with the \
                cheapest numerical model of the table that is as exact, or whose loop is as good (IAE within \
                1 % of the least, bounds kept as well)"
            .to_owned(),
        heads: heads.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}

/// By which factor a net is faster than the cheapest of some models, and which that is.
fn faster<'a>(
    net: &Entry,
    others: impl Iterator<Item = &'a Entry>,
    time: impl Fn(&Entry) -> f64,
) -> String {
    let cheapest = others.min_by(|a, b| time(a).total_cmp(&time(b)));
    cheapest.map_or(MISSING.to_owned(), |other| {
        format!("{} ({})", text::significant(time(other) / time(net), 2), other.name)
    })
}
