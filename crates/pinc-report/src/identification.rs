//! The identified plant: the fit against the data, the residuals, and the estimates.

use crate::data::Run;
use crate::number_tables::NumberTable;
use crate::picture::Picture;
use pinc_chart::text::{self, MISSING};
use pinc_chart::{
    AMBER, Axis, BLUE, Figure, Kind, Panel, Point, Shape, Style, extent, present, state_color,
};
use pinc_record::{EstimateMetrics, IdentificationMetrics, ResidualRow, ResidualTable};

/// Data and fit, and what is left of them, if there is an identification.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let table = run.residuals.as_ref().filter(|table| !table.rows.is_empty())?;
    let axis = run.time_axis(extent(table.rows.iter().map(|row| row.t)));
    let mut panels: Vec<Panel> = (0..table.measured.len()).map(|i| fit(run, table, i)).collect();
    panels.extend((0..table.measured.len()).map(|i| residuals(run, table, i)));
    let caption = "The recorded data with the fit of the model, and the residuals, measured minus \
                   fitted. Residuals of a model that is right are white: they have no pattern. From \
                   residuals.csv.";
    let figure = Figure::stack("Identification", axis, panels);
    Some(Picture::new("identification", "Identification", figure, caption))
}

/// A value at each row, with a gap from file to file.
fn points(table: &ResidualTable, value: impl Fn(&ResidualRow) -> f64) -> Vec<Point> {
    let mut points = Vec::new();
    for (i, row) in table.rows.iter().enumerate() {
        if i > 0 && table.rows[i - 1].file != row.file {
            points.push((row.t, f64::NAN));
        }
        points.push((row.t, value(row)));
    }
    points
}

fn fit(run: &Run, table: &ResidualTable, i: usize) -> Panel {
    let name = &table.measured[i];
    let mut panel = run.panel(name, &[name], 140.0);
    let measured = present(points(table, |row| row.measured[i]));
    panel.add_named("measured", measured, Style::new(AMBER, Shape::Dots(1.8)).faint(0.7));
    let fitted = points(table, |row| row.fitted[i]);
    panel.add_named("fit", fitted, Style::new(state_color(i), Shape::Line(1.4)));
    panel
}

fn residuals(run: &Run, table: &ResidualTable, i: usize) -> Panel {
    let name = &table.measured[i];
    let label = run.label_in_unit_of("residual", &[name]);
    let title = format!("Residuals of {name}");
    let mut panel = Panel::new(&title, Axis::new(&label, Kind::Linear), 100.0);
    let dots = Style::new(BLUE, Shape::Dots(2.0));
    let left = points(table, |row| row.measured[i] - row.fitted[i]);
    panel.add(&format!("residual_{name}"), present(left), dots);
    panel.limits.push(0.0);
    panel
}

/// The identification in a few sentences.
pub(crate) fn paragraph(of: &IdentificationMetrics) -> String {
    let mut said = format!(
        "{} parameters were identified from {} measured values, by {} ({}): {}.",
        of.parameters.len(),
        of.measurements,
        of.method,
        of.reason,
        of.ended()
    );
    for finding in of.held_out_in_words().chain(of.findings.iter().cloned()) {
        said += &format!(" {finding}.");
    }
    said
}

/// The estimates, and what is left of the data.
pub(crate) fn number_tables(of: &IdentificationMetrics) -> Vec<NumberTable> {
    let parameters = of.parameters.iter().filter(|(name, _)| of.net_of(name).is_none());
    let parameters = parameters.map(|(name, parameter)| {
        let [value, width] = shown(&parameter.estimate);
        vec![name.clone(), value, width, text::number(parameter.initial, 4)]
    });
    let heads = ["", "value", "half width, 95 %", "start"];
    let mut tables = vec![NumberTable::new("Parameters", heads, parameters)];
    let gains = (!of.gains.is_empty()).then(|| ("Gains of the prediction".to_owned(), &of.gains));
    let states = of.initial_states.iter();
    let states = states.map(|of| (format!("Initial state of {}", of.file), &of.states));
    for (title, estimates) in gains.into_iter().chain(states) {
        let rows = estimates.iter().map(|(name, estimate)| {
            let [value, width] = shown(estimate);
            vec![name.clone(), value, width]
        });
        tables.push(NumberTable::new(title, heads[..3].iter().copied(), rows));
    }
    let residuals = of.residuals.iter().map(|(name, left)| {
        vec![
            name.clone(),
            left.measurements.to_string(),
            text::significant(left.rms, 3),
            format!("{:.2}", left.correlation),
            left.with_inputs(),
        ]
    });
    let heads = ["", "values", "rms", "correlation of neighbours", "with inputs (by chance)"];
    tables.push(NumberTable::new("Residuals", heads, residuals));
    let several = of.correlation.names.len() > 1 && of.correlation.names.len() <= 20;
    tables.extend(several.then(|| correlation(of)));
    tables
}

/// An estimate and its half width as text.
fn shown(estimate: &EstimateMetrics) -> [String; 2] {
    let width = estimate.half_width_95;
    [
        text::number(estimate.value, 6),
        width.map_or_else(|| MISSING.to_owned(), |width| text::significant(width, 3)),
    ]
}

fn correlation(of: &IdentificationMetrics) -> NumberTable {
    let names = &of.correlation.names;
    let rows = names.iter().zip(&of.correlation.matrix).map(|(name, row)| {
        let cell = |c: &Option<f64>| c.map_or_else(|| MISSING.to_owned(), |c| format!("{c:.2}"));
        std::iter::once(name.clone()).chain(row.iter().map(cell)).collect()
    });
    let heads = std::iter::once("").chain(names.iter().map(String::as_str));
    NumberTable::new("Correlation of the estimates", heads, rows)
}
