//! The closed loop: what the plant did under the controller, PINC over RK4.

use super::ReportError;
use super::data::{OfModel, Run};
use super::picture::Picture;
use super::variables::Variables;
use pinc_chart::text;
use pinc_chart::{
    AMBER, Axis, Color, Figure, INK, Kind, Look, Panel, Point, Shape, Style, extent,
    held_since_previous, input_color, present, state_color,
};

/// A run of more steps than this gets a close-up of its first [`CLOSE_UP`] steps.
const LONG: f64 = 60.0;
const CLOSE_UP: f64 = 20.0;
/// Values that differ by less, by ratio, differ by rounding.
const EQUAL: f64 = 1e-13;
/// The form of a reference.
const REFERENCE: Shape = Shape::Dashes(1.4);

/// The whole closed loop, and parts of it enlarged.
pub(super) fn pictures(run: &Run, variables: &Variables) -> Result<Vec<Picture>, ReportError> {
    if run.control.iter().all(|of| of.table.len() == 0) {
        return Ok(Vec::new());
    }
    let loops = Loops { run, variables };
    let mut t = Vec::new();
    for of in &run.control {
        t.extend(of.table.numbers("t")?);
    }
    let t = extent(t.into_iter());
    let axis = Axis::ranged("t (s)", Kind::Linear, t);
    let figure = Figure::stack("Closed loop", axis, loops.panels()?);
    let mut pictures = vec![Picture {
        stem: "control".to_owned(),
        title: "Closed loop".to_owned(),
        caption: loops.caption()?,
        figure,
    }];
    let close_ups = loops.close_ups(&pictures[0].figure, t);
    pictures.extend(close_ups);
    Ok(pictures)
}

/// The closed loops of a run; the last model is drawn first, so that PINC comes to lie over RK4.
struct Loops<'a> {
    run: &'a Run,
    variables: &'a Variables,
}

impl Loops<'_> {
    fn panels(&self) -> Result<Vec<Panel>, ReportError> {
        let states = self.variables.panels_of(&self.variables.states);
        let mut panels = Vec::new();
        for (i, (title, group)) in states.iter().enumerate() {
            let height = if i == 0 { 280.0 } else { 180.0 };
            panels.push(self.state_panel(title, group, height)?);
        }
        panels.push(self.input_panel()?);
        panels.extend(self.difference_panel()?);
        Ok(panels)
    }

    fn state_panel(
        &self,
        title: &str,
        states: &[String],
        height: f64,
    ) -> Result<Panel, ReportError> {
        let label = self.run.axis_label(states);
        let mut panel = Panel::new(title, Axis::new(&label, Kind::Linear), height);
        let color = |state| state_color(self.variables.index_of(state));
        self.add_references(&mut panel, states)?;
        for state in states {
            self.add_curve(&mut panel, state, color(state), |points| points)?;
        }
        for state in states {
            self.add_beneath(&mut panel, state, |points| points)?;
        }
        if states.iter().any(|state| self.variables.controlled.contains(state)) {
            panel.key("reference", Look::Curve(Style::new(INK, REFERENCE)));
        }
        self.add_limits(&mut panel, "state", states, &self.variables.states);
        Ok(panel)
    }

    fn add_references(&self, panel: &mut Panel, states: &[String]) -> Result<(), ReportError> {
        let first = &self.run.control[0].table;
        for state in states {
            let color = state_color(self.variables.index_of(state));
            let name = format!("{state}_ref");
            if let Some(points) = first.points("t", &name)? {
                panel.add(&name, held_since_previous(&points), Style::new(color, REFERENCE));
            }
        }
        Ok(())
    }

    fn input_panel(&self) -> Result<Panel, ReportError> {
        let inputs = &self.variables.inputs;
        let label = self.run.axis_label(inputs);
        let mut panel = Panel::new("Inputs", Axis::new(&label, Kind::Linear), 150.0);
        let steps = |points: Vec<Point>| held_since_previous(&points);
        for (i, input) in inputs.iter().enumerate() {
            self.add_curve(&mut panel, input, input_color(i), steps)?;
        }
        for input in inputs {
            self.add_beneath(&mut panel, input, steps)?;
        }
        self.add_limits(&mut panel, "input", inputs, inputs);
        Ok(panel)
    }

    /// Adds a variable's curve with the first model.
    fn add_curve(
        &self,
        panel: &mut Panel,
        variable: &str,
        color: Color,
        shaped: impl Fn(Vec<Point>) -> Vec<Point>,
    ) -> Result<(), ReportError> {
        let OfModel { model, table } = &self.run.control[0];
        let points = shaped(table.points("t", variable)?.unwrap_or_default());
        let label = match self.run.control.len() {
            1 => variable.to_owned(),
            _ => format!("{variable} with {}", self.run.model_name(model)),
        };
        panel.tag(variable, &points, color);
        panel.add_named(&label, points, Style::new(color, Shape::Line(1.8)));
        Ok(())
    }

    /// Adds a variable's curves with the other models, broad and light beneath what is there.
    fn add_beneath(
        &self,
        panel: &mut Panel,
        variable: &str,
        shaped: impl Fn(Vec<Point>) -> Vec<Point>,
    ) -> Result<(), ReportError> {
        for OfModel { model, table } in &self.run.control[1..] {
            let points = shaped(table.points("t", variable)?.unwrap_or_default());
            let label = format!("with {}", self.run.model_name(model));
            let style = Style::new(AMBER, Shape::Line(5.0)).faint(0.55);
            panel.add_beneath(&label, &format!("{variable} {label}"), points, style);
        }
        Ok(())
    }

    /// Adds the bounds of some of `all` variables, as the config has them.
    fn add_limits(&self, panel: &mut Panel, kind: &str, some: &[String], all: &[String]) {
        for side in ["low", "high"] {
            let key = format!("{kind}_{side}");
            for variable in some {
                let i = all.iter().position(|v| v == variable);
                let limit = i.and_then(|i| self.run.number_at(&["control", &key], i));
                panel.add_limits("limits", limit.as_slice());
            }
        }
    }

    /// How far the first two models' loops are apart.
    fn difference_panel(&self) -> Result<Option<Panel>, ReportError> {
        let [one, two, ..] = &self.run.control[..] else {
            return Ok(None);
        };
        let title =
            format!("|{} − {}|", self.run.model_name(&one.model), self.run.model_name(&two.model));
        let states = &self.variables.states;
        let label = self.run.label_in_unit_of(&title, states);
        let mut panel = Panel::new("Difference of the states", Axis::new(&label, Kind::Log), 170.0);
        for state in states {
            let points = self.differences(state)?;
            let color = state_color(self.variables.index_of(state));
            panel.add_named(state, points, Style::new(color, Shape::Line(1.4)));
        }
        Ok(Some(panel))
    }

    fn differences(&self, state: &str) -> Result<Vec<Point>, ReportError> {
        let [one, two, ..] = &self.run.control[..] else {
            return Ok(Vec::new());
        };
        let read = |of: &OfModel| Ok(of.table.points("t", state)?.unwrap_or_default());
        let (one, two): (Vec<Point>, Vec<Point>) = (read(one)?, read(two)?);
        // Times that are the same number were computed alike; one loop may have ended early.
        let pairs = one.into_iter().zip(two);
        let together = pairs.take_while(|(a, b)| (a.0 - b.0).abs() <= 1e-9 * a.0.abs());
        // What rounding alone makes is no difference, and would stretch a logarithmic axis.
        let differs = |a: f64, b: f64| (a - b).abs() > EQUAL * a.abs().max(b.abs());
        let difference = |a: f64, b: f64| if differs(a, b) { (a - b).abs() } else { 0.0 };
        Ok(together.map(|(a, b)| (a.0, difference(a.1, b.1))).collect())
    }

    /// Enlarged parts of the picture: those that the config asks for, or else the first steps if the
    /// run has many.
    fn close_ups(&self, whole: &Figure, t: (f64, f64)) -> Vec<Picture> {
        let asked = self.run.windows(&["control", "close_ups_s"]);
        let asked = asked.into_iter().filter(|w| w.0 < t.1 && w.1 > t.0);
        let asked: Vec<(f64, f64)> = asked.map(|w| (w.0.max(t.0), w.1.min(t.1))).collect();
        let step = self.run.step_s().filter(|step| t.1 - t.0 > LONG * step);
        let beginning = step.map(|step| (t.0, t.0 + CLOSE_UP * step));
        let windows = if asked.is_empty() { beginning.into_iter().collect() } else { asked };
        windows.into_iter().map(|window| self.close_up(whole, window)).collect()
    }

    fn close_up(&self, whole: &Figure, (from, to): (f64, f64)) -> Picture {
        let (from_s, to_s) = (text::number(from, 6), text::number(to, 6));
        let mut figure = whole.clone();
        figure.name = format!("Closed loop from {from_s} s to {to_s} s");
        figure.x.range = Some((from, to));
        Picture {
            stem: format!("control-{from}-{to}"),
            title: format!("Closed loop: {from_s} s to {to_s} s"),
            figure,
            caption: "A part of the picture above, enlarged. From the same files.".to_owned(),
        }
    }

    fn caption(&self) -> Result<String, ReportError> {
        let files: Vec<_> = self.run.control.iter().map(|of| of.table.file_name()).collect();
        let mut caption = "The plant, integrated accurately, under the controller. Dashed: the \
                           references, in the colours of their states; grey: the bounds."
            .to_owned();
        if let [one, two, ..] = &self.run.control[..] {
            let (one, two) = (self.run.model_name(&one.model), self.run.model_name(&two.model));
            caption += &format!(
                " Thin curves: with {one} as the controller's model; broad amber curves beneath: with \
                 {two}. Where amber is only a rim, both do the same."
            );
            let mut largest = Vec::new();
            for state in &self.variables.states {
                let differences = present(self.differences(state)?);
                let most = extent(differences.iter().map(|p| p.1)).1;
                largest.push(format!("{} in {state}", text::number(most, 2)));
            }
            caption += &format!(
                " They differ by at most {} (lowest panel; no curve where they are equal up to rounding).",
                text::listed(&largest)
            );
        }
        Ok(format!("{caption} From {}.", text::listed(&files)))
    }
}
