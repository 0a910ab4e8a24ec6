//! A whole controller in C.

use crate::controller::{Controller, ModelSource};
use crate::feedback_c::{Filter, feedback_core, set_disturbances};
use crate::net_c::net_core;
use crate::origin::{Origin, domain};
use crate::rk4_c::rk4_core;
use crate::template::{Template, array, constant, places, table};
use crate::{ExportError, GeneratedFile, Name, feedback_c};
use pinc_mpc::{Softness, Weight};
use pinc_ode::Dims;

/// Steps of the self-test.
const STEPS: usize = 20;

/// What an input of the self-test may differ by in double and in float, relative to 1 + its size.
/// In float the iteration ends earlier.
const TOLERANCES: [&str; 2] = ["1e-8", "1e-3"];

/// The same with the unscented filter, whose points are near one another in double, which leaves
/// rounding, and far from one another in float, which is another filter.
const UNSCENTED_TOLERANCES: [&str; 2] = ["1e-6", "5e-2"];

/// The smallest residual that single precision can be asked for.
const FLOAT_TOLERANCE: f64 = 1e-3;

/// The controller as C99: the model, the transcription by multiple shooting, Gauss-Newton SQP and
/// the condensed active-set method, in memory of fixed size; with a self-test, build file and a
/// page that says how to use them.
///
/// # Errors
///
/// [`ExportError`] if the controller has something that the generated one has not, or is no
/// sensible one.
pub fn controller_to_c(
    controller: &Controller<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (mut t, mut files) = controller_sources(controller, name, origin)?;
    let [double, float] = controller.estimator.map_or(TOLERANCES, |of| match of.filter {
        Filter::Extended => TOLERANCES,
        Filter::Unscented => UNSCENTED_TOLERANCES,
    });
    t.set("DOUBLE", double).set("FLOAT", float);
    let selftest = match controller.estimator {
        None => {
            set_selftest(&mut t, controller)?;
            include_str!("../templates/mpc_selftest.c")
        }
        Some(estimation) => {
            let steps = feedback_c::set_selftest(&mut t, controller, estimation, STEPS)?;
            t.set("STEPS", steps);
            include_str!("../templates/feedback_selftest.c")
        }
    };
    files.push(t.file("selftest.c", selftest));
    let more = if controller.estimator.is_some() { " pinc_feedback.c" } else { "" };
    t.set("SOURCES", format!("pinc_mpc.c pinc_@MODEL@.c{more}"));
    files.push(t.named("CMakeLists.txt", include_str!("../templates/net_cmake.txt")));
    set_page(&mut t, controller, origin);
    files.push(t.named("README.md", include_str!("../templates/mpc_readme.md")));
    Ok(files)
}

/// Headers and sources of the controller and its model, and what templates are filled with.
pub(crate) fn controller_sources(
    controller: &Controller<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<(Template, Vec<GeneratedFile>), ExportError> {
    let dims = controller.library_model()?.dims();
    controller.check(dims)?;
    let (mut files, model) = match controller.model {
        ModelSource::Net(net) => (net_core(net, name, origin)?, "net"),
        ModelSource::Rk4(model) => (rk4_core(model, name, origin)?, "rk4"),
    };
    let mut t = Template::new(name);
    let net = match controller.model {
        ModelSource::Net(net) => Some(net),
        ModelSource::Rk4(_) => None,
    };
    t.set("BANNER", origin.banner("A nonlinear model predictive controller.", net));
    t.set("MODEL", model);
    set_sizes(&mut t, controller, dims);
    set_problem(&mut t, controller, dims);
    set_disturbances(&mut t, controller.estimator, dims);
    t.set("DENSE", include_str!("../templates/mpc_dense.c"))
        .set("CONDENSE", include_str!("../templates/mpc_condense.c"))
        .set("SQP", include_str!("../templates/mpc_sqp.c"));
    files.push(t.file("mpc.h", include_str!("../templates/mpc.h")));
    files.push(t.file("mpc.c", include_str!("../templates/mpc.c")));
    if let Some(estimation) = controller.estimator {
        files.extend(feedback_core(&mut t, estimation, dims));
    }
    Ok((t, files))
}

fn set_sizes(t: &mut Template, controller: &Controller<'_>, dims: Dims) {
    let (problem, config) = (controller.problem, controller.config);
    t.set("N2", problem.horizon)
        .set("NC", problem.control_horizon)
        .set("NY", problem.tracked.len())
        .set("DELAY", problem.delay)
        .set("MAX_ITERATIONS", config.max_iterations)
        .set("KKT_TOLERANCE", constant(config.tolerance))
        .set("KKT_TOLERANCE_FLOAT", constant(config.tolerance.max(FLOAT_TOLERANCE)))
        .set("CREDIBLE", constant(config.tolerance.sqrt()))
        .set("CREDIBLE_FLOAT", constant(config.tolerance.max(FLOAT_TOLERANCE).sqrt()))
        .set("STATES_EXACT", u8::from(problem.state_softness == Softness::Exact))
        .set("NX", dims.nx)
        .set("NU", dims.nu);
}

/// The numbers of the problem as tables.
fn set_problem(t: &mut Template, controller: &Controller<'_>, dims: Dims) {
    let problem = controller.problem;
    let (states, inputs) = (problem.horizon * dims.nx, problem.control_horizon * dims.nu);
    let expand = |side: &[f64], count: usize| side.repeat(count / side.len().max(1));
    let low =
        [expand(&problem.state_bounds.low, states), expand(&problem.input_bounds.low, inputs)];
    let high =
        [expand(&problem.state_bounds.high, states), expand(&problem.input_bounds.high, inputs)];
    let increment_low = expand(&problem.increment_bounds.low, inputs);
    let increment_high = expand(&problem.increment_bounds.high, inputs);
    let limited = |low: &[f64], high: &[f64]| -> Vec<usize> {
        let sides = low.iter().zip(high).enumerate();
        sides.filter(|(_, (l, h))| l.is_finite() || h.is_finite()).map(|(i, _)| i).collect()
    };
    let state_rows = limited(&low[0], &high[0]);
    let increment_rows = limited(&increment_low, &increment_high);
    let [q, r, w] = weights(controller, dims);
    let size = |values: &[f64]| constant(values.iter().fold(0.0_f64, |s, v| s.max(v.abs())));
    // The first rows and columns of W are those of the input applied last.
    let width = inputs + dims.nu;
    let free = w.chunks_exact(width).skip(dims.nu).flat_map(|row| &row[dims.nu..]).copied();
    let mut tables =
        String::from("/* Bounds on z, and what multipliers of states are at most. */\n");
    tables += &array("low", &low.concat());
    tables += &array("high", &high.concat());
    tables += &array("penalty", &controller.penalties(dims));
    tables += "/* Bounds on increments. */\n";
    tables += &array("increment_low", &increment_low);
    tables += &array("increment_high", &increment_high);
    tables += "/* Weights, twice: of the states, [N2][NX][NX], of increments, [NC][NU][NU]. */\n";
    tables += &array("q", &q);
    tables += &array("r", &r);
    if !w.is_empty() {
        tables += "/* Of all inputs, the one applied last in front. */\n";
        tables += &array("w", &w);
    }
    tables += "/* Tracked states; bounded states and increments among all. */\n";
    tables += &places("tracked", &controller.tracked());
    tables += &places("state_rows", &state_rows);
    tables += &places("increment_rows", &increment_rows);
    t.set("STATE_ROWS", state_rows.len())
        .set("INCREMENT_ROWS", increment_rows.len())
        .set("LARGEST_Q", size(&q))
        .set("LARGEST_R", size(&r))
        .set("LARGEST_W", size(&free.collect::<Vec<_>>()))
        .set("HAS_W", u8::from(!w.is_empty()))
        .set("TABLES", tables);
}

/// 2 Q in terms of all states, 2 R, and 2 W or nothing.
fn weights(controller: &Controller<'_>, dims: Dims) -> [Vec<f64>; 3] {
    let problem = controller.problem;
    let (weights, tracked) = (&problem.weights, controller.tracked());
    let mut q = vec![0.0; problem.horizon * dims.nx * dims.nx];
    for (j, block) in q.chunks_exact_mut(dims.nx * dims.nx).enumerate() {
        let weight = match &weights.terminal {
            Some(terminal) if j + 1 == problem.horizon => terminal,
            _ if j + 1 >= problem.n1 => weights.q.at(j),
            _ => continue,
        };
        for (i, row) in tracked.iter().enumerate() {
            for (k, column) in tracked.iter().enumerate() {
                block[row * dims.nx + column] = 2.0 * weight.entry(i, k);
            }
        }
    }
    let r = (0..problem.control_horizon).flat_map(|i| doubled(weights.r.at(i))).collect();
    [q, r, weights.input_sequence.as_ref().map_or(Vec::new(), doubled)]
}

/// All entries of a weight, twice.
fn doubled(weight: &Weight) -> Vec<f64> {
    let size = weight.size();
    (0..size * size).map(|at| 2.0 * weight.entry(at / size, at % size)).collect()
}

/// Golden vectors: the controller of the library in closed loop with its own model.
fn set_selftest(t: &mut Template, controller: &Controller<'_>) -> Result<(), ExportError> {
    let mut nmpc = controller.library()?;
    let mut model = controller.library_model()?;
    let mut x = controller.initial_state.to_vec();
    let width = controller.reference.outputs();
    let mut window = vec![0.0; controller.problem.horizon * width];
    let (mut states, mut windows, mut inputs) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..STEPS.min(controller.reference.steps()) {
        controller.reference.preview(k + controller.problem.delay, &mut window);
        let u = nmpc.step(&x, &window)?.u.to_vec();
        states.push(x.clone());
        windows.push(window.clone());
        let mut next = vec![0.0; x.len()];
        model.step(&x, &u, &[], &mut next);
        inputs.push(u);
        x = next;
    }
    let tables = [table("x", &states), table("reference", &windows), table("u", &inputs)];
    t.set("STEPS", inputs.len()).set("TABLES", tables.concat());
    Ok(())
}

fn set_page(t: &mut Template, controller: &Controller<'_>, origin: &Origin) {
    let list = |values: &[f64]| values.iter().map(|v| constant(*v)).collect::<Vec<_>>().join(", ");
    let rows = match controller.model {
        ModelSource::Net(net) => {
            let rows =
                domain(net, origin).iter().map(|row| format!("- {row}\n")).collect::<String>();
            format!("The model is a net, which is good where it was trained:\n\n{rows}")
        }
        ModelSource::Rk4(model) => format!(
            "The model is the plant's equation, integrated by {} substeps of the Runge-Kutta method \
             of order 4 per step.\n",
            model.substeps
        ),
    };
    let tracked = controller.tracked().into_iter().map(|i| origin.states[i].name.to_string());
    let tracked: Vec<_> = tracked.collect();
    if let Some(estimation) = controller.estimator {
        let measured = estimation.measured().map(|i| origin.states[i].name.to_string());
        t.set("MEASURED", measured.collect::<Vec<_>>().join(", "));
    }
    t.set("T", constant(controller.sample_time_s()));
    let feedback = controller.estimator.map(|_| include_str!("../templates/feedback_readme.md"));
    t.set("FEEDBACK", feedback.unwrap_or_default());
    t.set("MODEL_TEXT", rows.trim_end())
        .set("X", list(controller.initial_state))
        .set("Y", tracked.join(", "))
        .set("STATES", origin.state_list())
        .set("INPUTS", origin.input_list());
}
