//! The training curves.

use crate::data::Run;
use crate::picture::Picture;
use pinc_chart::{
    Axis, BLACK, BLUE, Event, Figure, GREEN, Kind, Label, PURPLE, Panel, Point, SKY, Shape, Style,
    VERMILLION, extent, present, text,
};
use pinc_net::optim::OptimizerConfig;
use pinc_record::{TrainingRow, file};

/// What the curves are drawn over.
const X_LABEL: &str = "loss evaluations";

/// The training curves, if there was a training.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let rows = run.training.as_ref().filter(|rows| !rows.is_empty())?;
    let validation = present(curve(rows, |row| row.validation_mse));
    let best = validation.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
    let label = run.label_in_all_states_unit("validation MSE", "²");
    let loss = losses(rows, (&label, &validation), best);
    let mut gradient = Panel::new("Gradient", Axis::new("gradient norm", Kind::Log), 120.0);
    let norm = curve(rows, |row| Some(row.gradient_norm));
    gradient.add("gradient norm", norm, Style::new(BLACK, Shape::Line(1.0)).faint(0.75));
    let axis = Axis::ranged(X_LABEL, Kind::Linear, (0.0, extent(rows.iter().map(x)).1));
    let mut figure = Figure::stack("Training curves", axis, vec![loss, gradient]);
    figure.events = events(run, rows);
    Some(Picture::new("training", "Training", figure, caption(rows, best)))
}

/// A row's place on the axis.
fn x(row: &TrainingRow) -> f64 {
    row.loss_evaluations as f64
}

/// The points of what `value` finds in a row, NaN where there is nothing.
fn curve(rows: &[TrainingRow], value: impl Fn(&TrainingRow) -> Option<f64>) -> Vec<Point> {
    rows.iter().map(|row| (x(row), value(row).unwrap_or(f64::NAN))).collect()
}

/// The loss and its terms, and below or above them what the net does on points it was not trained
/// on.
fn losses(rows: &[TrainingRow], validation: (&str, &[Point]), best: Option<Point>) -> Panel {
    let mut panel = Panel::new("Loss", Axis::new("mean squared error", Kind::Log), 340.0);
    let loss = curve(rows, |row| Some(row.loss));
    // A term that the table lacks has no points.
    let term = |value: fn(&TrainingRow) -> f64| present(curve(rows, |row| Some(value(row))));
    let (data, physics) = (term(|row| row.loss_data), term(|row| row.loss_physics));
    let measured = term(|row| row.loss_measured);
    let fresh = present(curve(rows, |row| row.fresh_loss));
    // A term that is the whole loss, or nothing, has no curve of its own.
    let differs = |term: &[Point]| loss.iter().zip(term).any(|(a, b)| !equal(a.1, b.1));
    let vanishes = |term: &[Point]| term.iter().all(|p| equal(p.1, 0.0));
    let terms = [
        ("physics term", &physics, BLUE),
        ("data term", &data, SKY),
        ("measurements", &measured, GREEN),
    ];
    let terms = terms.into_iter().filter(|(_, term, _)| differs(term) && !vanishes(term));
    let terms: Vec<_> = terms.collect();
    let all_physics = !physics.is_empty() && !differs(&physics);
    let (label, style) = match (&terms[..], all_physics) {
        ([], true) => ("loss (the physics term alone)", Style::new(BLUE, Shape::Line(1.4))),
        ([], false) => ("loss", Style::new(BLUE, Shape::Line(1.4))),
        _ => ("loss", Style::new(BLACK, Shape::Line(3.5)).faint(0.3)),
    };
    panel.add_named(label, loss.clone(), style);
    for (label, term, color) in terms {
        panel.add_named(label, term.clone(), Style::new(color, Shape::Line(1.2)));
    }
    panel.add_named("loss on fresh points", fresh, Style::new(PURPLE, Shape::Dots(2.4)));
    let line = Style::new(VERMILLION, Shape::Line(1.2));
    panel.add("", validation.1.to_vec(), line);
    let dots = Style::new(VERMILLION, Shape::Dots(2.6));
    panel.add_named(validation.0, validation.1.to_vec(), dots);
    let ring = Style::new(VERMILLION, Shape::Rings(6.0));
    let tag = |at: Point| Label { at, text: text::number(at.1, 2), color: VERMILLION };
    panel.labels.extend(best.map(tag));
    panel.add_named("its lowest value", best.into_iter().collect(), ring);
    panel
}

/// Equal up to the rounding of a sum or a product.
fn equal(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// Where a phase begins, and where the sample grows inside one.
fn events(run: &Run, rows: &[TrainingRow]) -> Vec<Event> {
    let mut events = Vec::new();
    let mut before: Option<&TrainingRow> = None;
    for row in rows {
        let new_phase = before.is_none_or(|before| before.phase != row.phase);
        let points = row.collocation_points;
        let new_size = before.is_none_or(|before| before.collocation_points != points);
        let size = (points > 0 && new_size).then(|| format!("{} points", text::count(points)));
        if new_phase {
            let label: Vec<String> =
                std::iter::once(phase_name(run, row.phase)).chain(size).collect();
            events.push(Event::major(x(row), label.join(", ")));
        } else if let Some(size) = size {
            events.push(Event::minor(x(row), size));
        }
        before = Some(row);
    }
    events
}

/// A phase is named after its optimizer.
fn phase_name(run: &Run, phase: usize) -> String {
    let training = run.experiment.training.as_ref();
    let phase_of = training.and_then(|training| training.config.phases.get(phase));
    let name = phase_of.map(|phase| match phase.optimizer {
        OptimizerConfig::Adam(_) => "Adam",
        OptimizerConfig::Lbfgs(_) => "L-BFGS",
        OptimizerConfig::SelfScaledBroyden(_) => "self-scaled Broyden",
        OptimizerConfig::LevenbergMarquardt(_) => "Levenberg-Marquardt",
        OptimizerConfig::Auto(_) => "by size",
    });
    name.map_or_else(|| format!("phase {}", phase + 1), str::to_owned)
}

fn caption(rows: &[TrainingRow], best: Option<Point>) -> String {
    let mut caption = format!(
        "The loss and its terms over {X_LABEL}, on a logarithmic axis; solid vertical lines mark \
        the \
         phases, dashed ones the growth of the sample."
    );
    if let Some((x, y)) = best {
        let (x, y) = (text::number(x, 6), text::number(y, 3));
        caption += &format!(" The lowest validation error is {y}, at {x} {X_LABEL} (ringed).");
    }
    let elapsed = extent(rows.iter().map(|row| row.elapsed_s)).1;
    caption += &format!(" The optimizer worked for {}.", text::duration(elapsed));
    format!("{caption} From {}.", file::TRAINING)
}
