//! The training curves.

use super::ReportError;
use super::data::Run;
use super::picture::Picture;
use super::table::Table;
use pinc_chart::text;
use pinc_chart::{
    Axis, BLACK, BLUE, Event, Figure, GREEN, Kind, Label, PURPLE, Panel, Point, SKY, Shape, Style,
    VERMILLION, extent, present,
};

/// The training curves, if there was a training.
pub(super) fn picture(run: &Run) -> Result<Option<Picture>, ReportError> {
    let Some(table) = run.training.as_ref().filter(|table| table.len() > 0) else {
        return Ok(None);
    };
    let (column, x_label) = match table.has("loss_evaluations") {
        true => ("loss_evaluations", "loss evaluations"),
        false => ("iteration", "iterations"),
    };
    let x = table.numbers(column)?;
    let validation = present(table.points(column, "validation_mse")?.unwrap_or_default());
    let best = validation.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
    let label = run.label_in_states_unit("validation MSE", "²");
    let loss = losses(table, column, (&label, &validation), best)?;
    let mut gradient = Panel::new("Gradient", Axis::new("gradient norm", Kind::Log), 120.0);
    let norm = table.points(column, "gradient_norm")?.unwrap_or_default();
    gradient.add("gradient norm", norm, Style::new(BLACK, Shape::Line(1.0)).faint(0.75));
    let axis = Axis::ranged(x_label, Kind::Linear, (0.0, extent(x.iter().copied()).1));
    let mut figure = Figure::stack("Training curves", axis, vec![loss, gradient]);
    figure.events = events(run, table, &x)?;
    Ok(Some(Picture {
        stem: "training".to_owned(),
        title: "Training".to_owned(),
        caption: caption(table, x_label, best)?,
        figure,
    }))
}

/// The loss and its terms, and below or above them what the net does on points it was not trained on.
fn losses(
    table: &Table,
    x: &str,
    validation: (&str, &[Point]),
    best: Option<Point>,
) -> Result<Panel, ReportError> {
    let mut panel = Panel::new("Loss", Axis::new("mean squared error", Kind::Log), 340.0);
    let column = |name: &str| table.points(x, name).map(Option::unwrap_or_default);
    let (loss, data, physics) = (column("loss")?, column("loss_data")?, column("loss_physics")?);
    let measured = column("loss_measured")?;
    let fresh = present(column("fresh_loss")?);
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
    let label = |at: Point| Label { at, text: text::number(at.1, 2), color: VERMILLION };
    panel.labels.extend(best.map(label));
    panel.add_named("its lowest value", best.into_iter().collect(), ring);
    Ok(panel)
}

/// Equal up to the rounding of a sum or a product.
fn equal(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// Where a phase begins, and where the sample grows inside one.
fn events(run: &Run, table: &Table, x: &[f64]) -> Result<Vec<Event>, ReportError> {
    let mut events = Vec::new();
    let phases = match table.has("phase") {
        true => table.texts("phase")?,
        false => vec![""; table.len()],
    };
    let sizes = match table.has("collocation_points") {
        true => table.numbers("collocation_points")?,
        false => vec![f64::NAN; table.len()],
    };
    for i in 0..table.len() {
        let new_phase = i == 0 || phases[i] != phases[i - 1];
        let new_size = i == 0 || sizes[i].total_cmp(&sizes[i - 1]).is_ne();
        let size = match sizes[i].is_finite() && new_size {
            true => Some(format!("{} points", text::number(sizes[i], 6))),
            false => None,
        };
        if new_phase && !phases[i].is_empty() {
            let name = phase_name(run, phases[i]);
            let label = std::iter::once(name).chain(size).collect::<Vec<_>>();
            events.push(Event::major(x[i], label.join(", ")));
        } else if let Some(size) = size {
            events.push(Event::minor(x[i], size));
        }
    }
    Ok(events)
}

/// A phase given by its number (from 0) is named after its optimiser, as the config has it.
fn phase_name(run: &Run, phase: &str) -> String {
    let Ok(number) = phase.parse::<usize>() else {
        return optimizer_name(phase);
    };
    let phases = run.setting(&["training", "phases"]);
    let optimizer = phases.and_then(|phases| phases.get(number)?.get("optimizer"));
    let name = match optimizer {
        Some(toml::Value::String(name)) => Some(name.as_str()),
        Some(toml::Value::Table(table)) => table.keys().next().map(String::as_str),
        _ => None,
    };
    name.map_or_else(|| format!("phase {}", number + 1), optimizer_name)
}

fn optimizer_name(key: &str) -> String {
    match key {
        "adam" => "Adam".to_owned(),
        "lbfgs" | "l-bfgs" => "L-BFGS".to_owned(),
        "self-scaled-broyden" => "self-scaled Broyden".to_owned(),
        other => other.to_owned(),
    }
}

fn caption(table: &Table, x_label: &str, best: Option<Point>) -> Result<String, ReportError> {
    let mut caption = format!(
        "The loss and its terms over {x_label}, on a logarithmic axis; solid vertical lines mark the \
         phases, dashed ones the growth of the sample."
    );
    if let Some((x, y)) = best {
        let (x, y) = (text::number(x, 6), text::number(y, 3));
        caption += &format!(" The lowest validation error is {y}, at {x} {x_label} (ringed).");
    }
    if table.has("elapsed_s") {
        let elapsed = extent(table.numbers("elapsed_s")?.into_iter()).1;
        caption += &format!(" The optimiser worked for {}.", text::duration(elapsed));
    }
    Ok(format!("{caption} From {}.", table.file_name()))
}
