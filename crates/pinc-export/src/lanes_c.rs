//! A model on several points side by side, in C.

use crate::equation::{check_constants, lane_values};
use crate::template::constant;
use crate::{Controller, ExportError, ModelSource, RungeKuttaModel};
use std::fmt::Write as _;

/// Functions of a controller's model on `PINC_POINTS` points side by side, one in each lane of
/// vectors, for a file that includes the header of the exported model and fills in the prefixes
/// `pinc_` and `PINC_`. Points are rows of states, inputs and outputs,
/// `pinc_vector z[PINC_GROUPS][PINC_ROW]`.
///
/// `pinc_advance(z)` replaces the states by those a step later; `pinc_outputs_of(z)` writes the
/// outputs, if the controller uses any. With them come `pinc_smaller`, `pinc_larger`, `pinc_tanh`
/// and the macros `PINC_WHERE` and `PINC_LANE`.
///
/// # Errors
///
/// [`ExportError`] for an integrator that solves linear systems, or equations with constants that are
/// not finite.
pub fn lanes_to_c(controller: &Controller<'_>) -> Result<String, ExportError> {
    let mut text = format!(
        "#include <math.h>\n\n{}\n/* The number in a lane. */\n#define PINC_LANE(v, l) \
         (((PINC_REAL *)&(v))[l])\n",
        include_str!("../templates/arithmetic.c").trim_end()
    );
    match controller.model {
        ModelSource::Net(_) => text += include_str!("../templates/lanes_net.c"),
        ModelSource::RungeKutta(model) => text += &runge_kutta(model)?,
    }
    if let Some((equations, _)) = controller.outputs()? {
        let (listing, nx) = (equations.output_listing(&[])?, equations.listing(&[])?.results.len());
        check_constants("a constant of the plant's outputs", &listing)?;
        text += &function("outputs_at", "y", &lane_values(&listing, nx, "y"));
        text += include_str!("../templates/lanes_outputs.c");
    }
    Ok(text)
}

/// A function of x and u.
fn function(name: &str, to: &str, body: &str) -> String {
    format!(
        "\nstatic void pinc_{name}(const pinc_vector *x, const pinc_vector *u, pinc_vector *{to})\n\
         {{\n{body}}}\n"
    )
}

/// The steps of a Runge-Kutta method.
fn runge_kutta(model: RungeKuttaModel<'_>) -> Result<String, ExportError> {
    let listing = model.equations.listing(&[])?;
    check_constants("a constant of the plant's equations", &listing)?;
    let tableau = model.method.tableau().ok_or(ExportError::Feature {
        feature: "integrator that solves linear systems",
        instead: "rk4 or rk5",
    })?;
    let h = model.sample_time_s / model.substeps as f64;
    let rows = tableau.rows();
    let nx = listing.results.len();
    let mut stages = String::new();
    for (s, row) in rows.iter().enumerate() {
        let [from, to] = [s == 0, s + 1 == rows.len()].map(|own| if own { "x" } else { "stage" });
        // A line for each state: loops over a few states are not unrolled at -O2.
        for i in (0..nx).filter(|_| s > 0) {
            let mut sum = format!("x[{i}]");
            for (k, weight) in row.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                sum = format!("({sum} + (slopes[{k}][{i}] * PINC_N({})))", constant(h * weight));
            }
            let _ = writeln!(stages, "            {to}[{i}] = {sum};");
        }
        if s + 1 < rows.len() {
            let _ = writeln!(stages, "            pinc_derivative_at({from}, u, slopes[{s}]);");
        }
    }
    let body = lane_values(&listing, nx, "dx");
    let filled = include_str!("../templates/lanes_runge_kutta.c")
        .replace("@STAGES@", &(rows.len() - 1).to_string())
        .replace("@SUBSTEPS@", &model.substeps.to_string())
        .replace("@STEPS@", stages.trim_end());
    Ok(function("derivative_at", "dx", &body) + &filled)
}
