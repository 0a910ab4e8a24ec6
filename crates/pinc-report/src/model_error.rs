//! The error of the net along the closed loop: estimated beside true.

use crate::data::Run;
use crate::decimation::Decimation;
use crate::picture::Picture;
use crate::variables::Variables;
use pinc_chart::{Axis, Figure, INK, Kind, Panel, Shape, Style, extent, present, state_color};
use pinc_config::OnError;
use pinc_record::{PairRow, file};

/// The errors of each state, if the net was judged.
pub(crate) fn picture(run: &Run, variables: &Variables) -> Option<Picture> {
    let table = run.model_error.as_ref().filter(|table| !table.rows.is_empty())?;
    let mut kept = Decimation::new();
    for row in &table.rows {
        let sizes = row.values.iter().flatten().map(|error| error.abs());
        kept.push(row, sizes.collect());
    }
    let rows: Vec<&PairRow> = kept.into_rows().collect();
    let shown = variables.shown(&table.states);
    let panel = |state: &String| {
        let place = table.states.iter().position(|name| name == state).unwrap_or(0);
        panel(run, &rows, (state, place))
    };
    let axis = run.time_axis(extent(rows.iter().map(|row| row.t)));
    let title = "Error of the net along the loop";
    let figure = Figure::stack(title, axis, shown.iter().map(panel).collect());
    Some(Picture::new("model-error", title, figure, caption(run)))
}

fn panel(run: &Run, rows: &[&PairRow], (state, place): (&String, usize)) -> Panel {
    let label = run.label_in_unit_of(&format!("|error of {state}|"), &[state]);
    let mut panel = Panel::new(state, Axis::new(&label, Kind::Log), 130.0);
    let points = |which: usize| {
        present(rows.iter().map(|row| (row.t, row.values[which][place].abs())).collect())
    };
    panel.add_named("true", points(1), Style::new(INK, Shape::Line(1.2)));
    let dots = Style::new(state_color(place), Shape::Dots(2.4));
    panel.add_named("estimated", points(0), dots);
    let control = run.experiment.control.as_ref();
    if let Some(tolerance) = control.and_then(|control| control.error_tolerance.get(state)) {
        panel.add_limits("tolerance", &[*tolerance]);
    }
    panel
}

fn caption(run: &Run) -> String {
    let mut caption = "The error of the net after one step from each state of the loop, under the \
                       input applied there: against an accurate integration of the net's equation, \
                       and as the net's residual lets one estimate it."
        .to_owned();
    let judged = run.metrics.iter().flat_map(|metrics| &metrics.control);
    let judged = judged.filter_map(|of| of.model_error.as_ref()).next();
    if let Some((of, control)) = judged.zip(run.experiment.control.as_ref()) {
        let done = match control.on_error {
            OnError::Count => "the plans of these steps were followed",
            OnError::Integrator => "an integrator made these steps",
            OnError::Correct => "these steps were made with corrected predictions",
        };
        caption += &format!(" Judged at the beginning of plans: {of}; {done}.");
    }
    format!("{caption} From {}.", file::MODEL_ERROR)
}
