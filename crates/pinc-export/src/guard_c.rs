//! The guard of a controller by the estimated error of its net, in C.

use crate::controller::Controller;
use crate::open::Open;
use crate::origin::Origin;
use crate::runge_kutta_c::{RungeKuttaModel, runge_kutta_core};
use crate::template::{Template, array};
use crate::{ExportError, GeneratedFile, Name};

/// Compares the estimated error of the net in the first step of each plan with tolerances.
#[derive(Clone, Copy, Debug)]
pub struct ErrorGuard<'a> {
    /// The tolerance of each state, in its unit; infinite where there is none.
    pub tolerance: &'a [f64],
    /// What follows if one is exceeded.
    pub response: ErrorResponse<'a>,
}

/// What a controller does in a step whose estimated error is beyond a tolerance.
#[derive(Clone, Copy, Debug)]
pub enum ErrorResponse<'a> {
    /// It follows the plan.
    Count,
    /// It repeats the step with this model.
    Integrator(RungeKuttaModel<'a>),
    /// It repeats the step with the net's predictions less the estimated error.
    Correct,
}

/// For sources that call the estimate.
const INCLUDE_ERROR: &str = "#include \"pinc_error.h\"\n";

const TRUST_FIELDS: &str = "    /** Whether the net was trusted in the last step. */
    pinc_trust trust;
    /** The estimated error in the first step of the plan judged last, in the states' units. */
    PINC_REAL model_error[PINC_NX];
";

/// Fills how the controller sees its model and judges it, in the header and the source of the
/// controller. Gives the lines that include what it needs.
pub(crate) fn set_guard(t: &mut Template, controller: &Controller<'_>) -> &'static str {
    for key in ["GUARD_TYPES", "TRUST_FIELDS", "ORIGIN_FIELD", "EITHER", "FORGET_TRUST", "GUARD"] {
        t.set(key, "");
    }
    t.set("CHOOSE", "choose").set("MODEL_STEP", "pinc_@MODEL@_step(");
    t.set("MODEL_LINEARIZE", "pinc_@MODEL@_linearize_all(");
    let Some(guard) = &controller.guard else { return "" };
    let substitute = match guard.response {
        ErrorResponse::Count => "",
        ErrorResponse::Integrator(model) => {
            t.set("RK", model.method.name());
            t.set("EITHER", include_str!("../templates/mpc_either.c"));
            "with an integrator"
        }
        ErrorResponse::Correct => {
            t.set("EITHER", include_str!("../templates/mpc_corrected.c"));
            "with the net's predictions less\n        the estimated error"
        }
    };
    let repeats = !substitute.is_empty();
    if repeats {
        t.set("ORIGIN_FIELD", "    pinc_origin origin;\n");
        t.set("MODEL_STEP", "pinc_either_step(m, ");
        t.set("MODEL_LINEARIZE", "pinc_either_linearize_all(m, ");
    }
    t.set("SUBSTITUTE", if repeats { substitute } else { "with another model; not here" });
    t.set("REPEATS", u8::from(repeats)).set("TOLERANCE", array("tolerance", guard.tolerance));
    t.set("GUARD_TYPES", include_str!("../templates/mpc_guard.h"))
        .set("TRUST_FIELDS", TRUST_FIELDS);
    t.set("FORGET_TRUST", "    m->trust = PINC_NOT_JUDGED;\n").set("CHOOSE", "guarded");
    t.set("GUARD", include_str!("../templates/mpc_guard.c"));
    INCLUDE_ERROR
}

/// The model of steps that are repeated, if they need one.
pub(crate) fn substitute_core(
    guard: Option<ErrorGuard<'_>>,
    open: Open<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    match guard.map(|guard| guard.response) {
        Some(ErrorResponse::Integrator(model)) => {
            runge_kutta_core(model, model.method.name(), open, name, origin)
        }
        _ => Ok(Vec::new()),
    }
}
