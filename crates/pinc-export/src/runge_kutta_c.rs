//! An integrator of a plant, in C.

use crate::equation::{check_constants, jacobian, values};
use crate::fmu::{FINE, HALVINGS};
use crate::open::Open;
use crate::origin::Origin;
use crate::template::{Template, constant, numbers};
use crate::{ExportError, GeneratedFile, Name};
use pinc_expr::PlantEquations;
use pinc_ode::{DynPlant, Integrator, LinearizationBuffer, Model, Stages};
use std::fmt::Write as _;

/// A plant by its equations, integrated by a Runge-Kutta method.
#[derive(Clone, Copy, Debug)]
pub struct RungeKuttaModel<'a> {
    /// The plant.
    pub equations: &'a PlantEquations,
    /// The parameters that are arguments p of the model, by their names; the others have the values
    /// in the equations.
    pub parameters: &'a [String],
    /// The method: an explicit one.
    pub method: Integrator,
    /// Length T of a step, in s.
    pub sample_time_s: f64,
    /// Substeps per step.
    pub substeps: usize,
}

impl RungeKuttaModel<'_> {
    /// Whether [`plant_to_fmu`](crate::plant_to_fmu) can integrate the plant from a state under an
    /// input: a stiff one needs shorter substeps than the FMU tries. It can if twice as many substeps
    /// change nothing but a little of the Jacobian of a step, in which every unstable mode is.
    ///
    /// # Errors
    ///
    /// [`ExportError::Equations`] if the equations are none.
    pub fn is_integrable(&self, [x, u]: [&[f64]; 2]) -> Result<bool, ExportError> {
        let plant = self.plant()?;
        let jacobian = |halvings: u32| -> Result<Vec<f64>, ExportError> {
            let substeps = (FINE / 2) << halvings;
            let mut model = plant.model(Integrator::Rk4, self.sample_time_s, substeps)?;
            let mut of = LinearizationBuffer::new(model.dims(), 1);
            model.linearize(Stages { x, u, p: &[] }, of.as_mut());
            Ok(of.a)
        };
        let mut coarse = jacobian(0)?;
        for halvings in 1..=HALVINGS + 1 {
            let fine = jacobian(halvings)?;
            let largest = fine.iter().fold(0.0, |most: f64, entry| most.max(entry.abs()));
            let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 0.1 * largest;
            if largest.is_finite() && fine.iter().zip(&coarse).all(near) {
                return Ok(true);
            }
            coarse = fine;
        }
        Ok(false)
    }

    /// The plant, as the library has it.
    pub(crate) fn plant(&self) -> Result<Box<dyn DynPlant>, ExportError> {
        let names: Vec<&str> = self.parameters.iter().map(String::as_str).collect();
        Ok(self.equations.compile_with(&names)?.into_dyn())
    }

    /// The model, as the library has it.
    pub(crate) fn library(&self) -> Result<Box<dyn Model>, ExportError> {
        let plant = self.plant()?;
        Ok(plant.model(self.method, self.sample_time_s, self.substeps)?)
    }
}

/// Header and source of the integrator by the name `stem`, with the parameters that `open` names
/// behind the inputs.
pub(crate) fn runge_kutta_core(
    model: RungeKuttaModel<'_>,
    stem: &str,
    open: Open<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (equations, names) = open.equations(model.equations, model.parameters);
    let listing = equations.listing(&names)?;
    check_constants("a constant of the plant's equations", &listing)?;
    let (nx, nu) = (origin.states.len(), origin.inputs.len());
    let tableau = model.method.tableau().ok_or(ExportError::Feature {
        feature: "integrator that solves linear systems",
        instead: "rk4 or rk5",
    })?;
    let rows = tableau.rows();
    let stages = rows.len() - 1;
    let mut coefficients = Vec::new();
    for row in rows {
        coefficients.extend_from_slice(row);
        coefficients.resize(coefficients.len() + stages - row.len(), 0.0);
    }
    let h = model.sample_time_s / model.substeps as f64;
    let jacobian = jacobian(&listing, nx, nu + names.len(), "dx");
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("A plant as its own model, by Runge-Kutta steps.", None))
        .set("REAL", include_str!("../templates/real.h"))
        .set("RK", stem)
        .set("NX", nx)
        .set("NU", nu)
        .set("T", constant(model.sample_time_s))
        .set("SUBSTEPS", model.substeps)
        .set("H", constant(h))
        .set("STAGES", stages)
        .set("TABLEAU", numbers(&coefficients))
        .set("VALUES", values(&listing, nx, "dx"))
        .set("JACOBIAN", &jacobian.body)
        .set("SLOPES", slopes(&jacobian.entries, nx))
        .set("UNITS", units(&jacobian.entries, nx));
    open.set(&mut t);
    let file = |suffix: &str| format!("{stem}.{suffix}");
    Ok(vec![
        t.file(&file("h"), include_str!("../templates/runge_kutta.h")),
        t.file(&file("c"), include_str!("../templates/runge_kutta.c")),
    ])
}

/// The products of the Jacobian with the tangents: for each of its rows a sum over the entries.
fn slopes(entries: &[Vec<bool>], nx: usize) -> String {
    let mut text = String::new();
    let constant = |row: &Vec<bool>| !row.contains(&true);
    if entries.iter().any(constant) {
        text += "        const pinc_vector zero = {0};\n";
    }
    if entries.iter().all(constant) {
        text += "        (void)f;\n        (void)stage;\n";
    }
    for (i, row) in entries.iter().enumerate() {
        // Arguments first: their tangents do not change.
        let (states, arguments) = row.split_at(nx);
        let of_arguments = arguments.iter().enumerate().filter(|(_, there)| **there);
        let of_states = states.iter().enumerate().filter(|(_, there)| **there);
        let terms: Vec<String> = of_arguments
            .map(|(k, _)| format!("(PINC_UNIT({k}, v) * f[{i}][{}])", nx + k))
            .chain(of_states.map(|(k, _)| format!("(stage[({k} * PINC_ROW) + v] * f[{i}][{k}])")))
            .collect();
        let sum = if terms.is_empty() { "zero".to_owned() } else { terms.join(" + ") };
        let _ = writeln!(text, "        slope[({i} * PINC_ROW) + v] = {sum};");
    }
    text
}

/// The tangents of the arguments: unit vectors, without the zeros at their ends. None if no argument has
/// an effect, since compilers warn of a table that nothing reads.
fn units(entries: &[Vec<bool>], nx: usize) -> String {
    let arguments = entries.first().map_or(0, |row| row.len() - nx);
    if !entries.iter().any(|row| row[nx..].contains(&true)) {
        return String::new();
    }
    let row = |k: usize| format!("    {{{}PINC_N(1)}},\n", "PINC_N(0), ".repeat(nx + k));
    let rows: String = (0..arguments).map(row).collect();
    format!(
        "/* The tangents of the arguments u: unit vectors. */\n\
         static const PINC_REAL pinc_units[{arguments}][PINC_ROW * PINC_LANES] = {{\n{rows}}};\n\
         #define PINC_UNIT(k, v) (*(const pinc_loose *)(pinc_units[k] + ((v) * PINC_LANES)))\n\n"
    )
}
