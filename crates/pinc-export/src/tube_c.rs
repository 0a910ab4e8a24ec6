//! The tube of a controller in C.

use crate::controller::Controller;
use crate::template::{Template, array, constant};
use pinc_mpc::ProblemUnits;
use pinc_ode::Dims;
use pinc_tube::Feedback;

/// How far a plant may be from a plan: what bounds are tightened by, from the state's errors in each
/// step.
#[derive(Clone, Debug)]
pub struct ExportedTube {
    /// How many standard deviations a bound is tightened by; 0 in the worst case.
    pub quantile: f64,
    /// Standard deviations of the model's error in a step, `n`, in the states' units; empty if there
    /// are none.
    pub process_sd: Vec<f64>,
    /// Largest errors of the model in a step, likewise.
    pub boxes: Vec<f64>,
    /// The feedback on deviations.
    pub feedback: Feedback,
    /// Whether the bounds of inputs are tightened.
    pub tightens_inputs: bool,
}

const FIELD: &str = "    /**
     * Whether the last plan keeps the bounds that the tube tightened, which leave room everywhere; if
     * not, the plant may break its bounds.
     */
    int fits;
";

const MEMORY: &str =
    "    /* The tightened bounds, and whether the model has been linearized along a plan. */
    PINC_REAL tight_low[PINC_UNKNOWNS];
    PINC_REAL tight_high[PINC_UNKNOWNS];
    PINC_REAL tight_output_low[PINC_ROOM(PINC_OUTPUT_ROWS)];
    PINC_REAL tight_output_high[PINC_ROOM(PINC_OUTPUT_ROWS)];
    int linearized;
    int crossed;
";

const GAINS: &str = "    PINC_REAL gains[PINC_N2 * PINC_NU * PINC_NX];\n";

const BEGIN: &str = "    pinc_copy(m->tight_low, m->low, PINC_UNKNOWNS);
    pinc_copy(m->tight_high, m->high, PINC_UNKNOWNS);
#if PINC_OUTPUT_ROWS > 0
    pinc_copy(m->tight_output_low, pinc_output_low, PINC_OUTPUT_ROWS);
    pinc_copy(m->tight_output_high, pinc_output_high, PINC_OUTPUT_ROWS);
#endif
";

/// The weights of the regulator, which are 1 in the plant's units.
fn regulator(units: &ProblemUnits) -> String {
    let squares = |units: &[f64]| -> Vec<f64> { units.iter().map(|unit| unit * unit).collect() };
    format!(
        "/* The regulator's weights of states and inputs. */\n{}{}",
        array("state_weight", &squares(&units.states)),
        array("input_weight", &squares(&units.inputs))
    )
}

/// Fills what tightens the bounds of a controller with a tube.
pub(crate) fn set_tube(t: &mut Template, controller: &Controller<'_>, dims: Dims) {
    let Some(tube) = controller.tube else {
        for key in
            ["TUBE", "TUBE_TABLES", "TUBE_FIELD", "TUBE_MEMORY", "BEGIN_TUBE", "TIGHTEN", "FIT"]
        {
            t.set(key, "");
        }
        t.set("HAS_TUBE", 0);
        return;
    };
    let units = controller.units(dims);
    let scaled = |list: &[f64]| -> Vec<f64> {
        let all = list.iter().copied().chain(std::iter::repeat(0.0));
        units.states.iter().zip(all).map(|(unit, value)| value / unit).collect()
    };
    let variances: Vec<f64> = scaled(&tube.process_sd).iter().map(|sd| sd * sd).collect();
    let (number, gain) = match &tube.feedback {
        Feedback::None => (0, String::new()),
        Feedback::Given(gain) => {
            let unit = |i: usize| units.states[i % dims.nx] / units.inputs[i / dims.nx];
            let gain: Vec<f64> = gain.iter().enumerate().map(|(i, k)| k * unit(i)).collect();
            (1, format!("/* K, [NU][NX] */\n{}", array("feedback", &gain)))
        }
        Feedback::Riccati => (2, regulator(&units)),
    };
    let tables = format!(
        "/* How many standard deviations bounds are tightened by; the feedback on deviations: 0, none; 1, \
         constant;\n   2, the regulator along the plan; whether bounds of inputs are tightened; how far \
         a plan may be beyond\n   tightened bounds, relative to 1 + |bound|. */\n\
         #define PINC_QUANTILE PINC_N({})\n\
         #define PINC_FEEDBACK {number}\n\
         #define PINC_TIGHTENS_INPUTS {}\n\
         #define PINC_FITTING PINC_PICK(1e-6, 1e-3)\n\
         /* Variances and largest errors of the model in a step. */\n{}{}{gain}",
        constant(tube.quantile),
        u8::from(tube.tightens_inputs),
        array("process_variance", &variances),
        array("box", &scaled(&tube.boxes)),
    );
    t.set("HAS_TUBE", 1)
        .set("TUBE", include_str!("../templates/mpc_tube.c"))
        .set("TUBE_TABLES", tables)
        .set("TUBE_FIELD", FIELD)
        .set("TUBE_MEMORY", [MEMORY, if number == 2 { GAINS } else { "" }].concat())
        .set("BEGIN_TUBE", BEGIN)
        .set("TIGHTEN", "    pinc_tighten(m, reference);\n")
        .set("FIT", "    m->fits = pinc_fits(m);\n");
}
