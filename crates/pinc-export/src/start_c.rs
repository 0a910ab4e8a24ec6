//! The start of a controller in C: the input applied so far, its limits, and its references.

use crate::ExportError;
use crate::controller::Controller;
use crate::origin::{Origin, comment, list};
use crate::template::{Template, array, places};
use pinc_mpc::Bounds;
use pinc_ode::Dims;

/// Fills what headers and sources say of the beginning, the budget and the references.
pub(crate) fn set_start(
    t: &mut Template,
    controller: &Controller<'_>,
    origin: &Origin,
    dims: Dims,
) -> Result<(), ExportError> {
    let first = controller.first_input(dims);
    let text = match controller.initial_input {
        None => "0".to_owned(),
        Some(u) => format!("u = ({})", u.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")),
    };
    let units = controller.units(dims).inputs;
    let scaled: Vec<f64> = first.iter().zip(&units).map(|(u, unit)| u / unit).collect();
    let reference = controller.reference;
    let segments = reference.segments();
    let steps: Vec<usize> = segments.iter().map(|of| of.start).collect();
    let values: Vec<&[f64]> = segments.iter().map(|of| reference.at(of.start)).collect();
    let tables = [
        "/* The input given before the first step, in the units of the optimization. */\n"
            .to_owned(),
        array("initial_input", &scaled),
        "/* The references: from which step on, and their values. */\n".to_owned(),
        places("segment_step", &steps),
        array("segment_value", &values.concat()),
    ];
    t.set("INITIAL_INPUT_TEXT", text)
        .set("HAS_INITIAL_INPUT", u8::from(controller.initial_input.is_some()))
        .set("INITIAL_INPUT", array("initial_input", &first))
        .set(
            "BUDGET_US",
            format!("{}UL", controller.budget_us.map_or(0.0, |us| us.ceil().max(1.0))),
        )
        .set("SEGMENTS", segments.len())
        .set("PREVIEW", u8::from(controller.preview))
        .set("PREVIEW_TEXT", if controller.preview { PREVIEW } else { NO_PREVIEW })
        .set("BAKED_TEXT", fixed_bounds(controller, origin, dims))
        .set("TRACKED", comment(&list(origin.quantities(&controller.tracked(dims)?))))
        .set("START", tables.concat());
    Ok(())
}

/// Which bounds cannot be changed in a running controller.
fn fixed_bounds(controller: &Controller<'_>, origin: &Origin, dims: Dims) -> String {
    if !controller.has_steady_bounds(dims) {
        return ";\n * all others too, since the config's bounds vary along the horizon".to_owned();
    }
    let Bounds { low, high } = &controller.problem.state_bounds;
    let sides = low.iter().zip(high).enumerate();
    let unbounded = sides.filter(|(_, (low, high))| low.is_infinite() && high.is_infinite());
    let places: Vec<usize> = unbounded.map(|(i, _)| i).collect();
    match places.is_empty() {
        true => String::new(),
        false => format!(
            ";\n * a bound of what the config leaves without one, for which the program has no rows: {}",
            comment(&list(origin.quantities(&places)))
        ),
    }
}

const PREVIEW: &str = "Row j is the value at the\n * beginning of the step that begins j steps later \
                       (with a delay of d steps, j + d): the controller\n * knows changes in \
                       advance.";
const NO_PREVIEW: &str = "All rows have the\n * value at t_s: the controller does not know changes \
                          in advance (preview = false).";
