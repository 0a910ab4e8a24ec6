//! A whole controller in C.

use crate::controller::{Controller, ModelSource};
use crate::error::finite;
use crate::error_c::without_estimate;
use crate::feedback_c::{INCLUDE_OUTPUTS, feedback_core, has_units, set_unknowns};
use crate::guard_c::{set_guard, substitute_core};
use crate::net_c::{has_time, net_core, sources};
use crate::origin::{Origin, domain};
use crate::outputs_c::outputs_core;
use crate::runge_kutta_c::runge_kutta_core;
use crate::selftest::{
    FLOAT_TOLERANCE, Precision, check_step, difference, in_float, is_unsolved, set_allowed,
};
use crate::start_c::set_start;
use crate::template::{Template, array, constant, places, table};
use crate::tube_c::set_tube;
use crate::{ExportError, GeneratedFile, Name, feedback_c};
use pinc_mpc::{Nmpc, ProblemUnits, Softness, Weight};
use pinc_ode::{Dims, Memory};

/// Steps of the self-test.
const STEPS: usize = 20;

/// The controller as C99: the model, the transcription by multiple shooting, Gauss-Newton SQP and
/// the condensed active-set method, in memory of fixed size; with a self-test, build file and a
/// page that says how to use them. The self-test takes the steps of `library`, the same controller
/// before its first step. The files `beside` it that are C become part of the library.
///
/// # Errors
///
/// [`ExportError`] if the controller has something that the generated one has not, or is no
/// sensible one.
pub fn controller_to_c(
    controller: &Controller<'_>,
    (library, beside): (Nmpc, Vec<GeneratedFile>),
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (mut t, mut files) = controller_sources(controller, name, origin)?;
    set_beside(&mut t, &beside);
    files.extend(beside);
    match controller.net_error()? {
        Some(estimate) => {
            estimate.set_selftest(&mut t, ESTIMATE_CALL)?;
        }
        None => without_estimate(&mut t),
    }
    let selftest = set_selftest(&mut t, controller, library)?;
    t.set("JUDGE", include_str!("../templates/selftest_judge.c"));
    files.push(t.file("selftest.c", selftest));
    t.set("SOURCES", sources(&files));
    files.push(t.named("CMakeLists.txt", include_str!("../templates/net_cmake.txt")));
    files.push(t.named("Makefile", include_str!("../templates/makefile.txt")));
    set_page(&mut t, controller, origin)?;
    files.push(t.named("README.md", include_str!("../templates/mpc_readme.md")));
    Ok(files)
}

const ESTIMATE_CALL: &str =
    "    pinc_require((pinc_error_off() <= 1.0) ? 1 : 0, -1, \"pinc_error differs\");\n";

/// Fills what page and self-test say of the files beside the controller: headers of functions, and of
/// their self-tests, `NAME_selftest.h` with a function of this name that returns 0 if they do what they
/// should.
fn set_beside(t: &mut Template, beside: &[GeneratedFile]) {
    let (mut text, mut include, mut call) = (String::new(), String::new(), String::new());
    for header in beside.iter().filter_map(|file| file.path.strip_suffix(".h")) {
        if header.ends_with("_selftest") {
            include += &format!("#include \"{header}.h\"\n");
            call += &format!("    pinc_require({header}() == 0, -1, \"{header} failed\");\n");
        } else {
            text += &format!(
                "**Beside the controller.** The library has the functions of `{header}.h` too, which says \
                 what they do.\n\n"
            );
        }
    }
    t.set("BESIDE", text).set("BESIDE_INCLUDE", include).set("BESIDE_CALL", call);
}

/// Headers and sources of the controller and its model, and what templates are filled with.
pub(crate) fn controller_sources(
    controller: &Controller<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<(Template, Vec<GeneratedFile>), ExportError> {
    let dims = controller.library_model()?.dims();
    controller.check(dims)?;
    let open = controller.open();
    let (mut files, model) = match controller.model {
        ModelSource::Net(net) => {
            let estimate = controller.net_error()?;
            let has_path = estimate.is_some() && has_time(net);
            let mut files = net_core((net, has_path), open, name, origin)?;
            if let Some(estimate) = estimate {
                files.extend(estimate.core(name, origin)?);
            }
            files.extend(substitute_core(controller.guard, open, name, origin)?);
            (files, "net")
        }
        ModelSource::RungeKutta(model) => {
            let method = model.method.name();
            (runge_kutta_core(model, method, open, name, origin)?, method)
        }
    };
    if let Some((equations, names)) = controller.outputs()? {
        files.extend(outputs_core(equations, &names, open, (name, model), origin)?);
    }
    let mut t = Template::new(name);
    let net = match controller.model {
        ModelSource::Net(net) => Some(net),
        ModelSource::RungeKutta(_) => None,
    };
    t.set("BANNER", origin.banner("A nonlinear model predictive controller.", net));
    t.set("MODEL", model).set("VECTORS", include_str!("../templates/vectors.c"));
    set_sizes(&mut t, controller, dims);
    set_problem(&mut t, controller, dims)?;
    let guarded = set_guard(&mut t, controller);
    set_unknowns(&mut t, controller, dims)?;
    set_start(&mut t, controller, origin, dims)?;
    set_tube(&mut t, controller, dims);
    let looks = controller.optimizes_outputs();
    t.set("OUTPUTS", if looks { include_str!("../templates/mpc_outputs.c") } else { "" })
        .set("INCLUDE", [if looks { INCLUDE_OUTPUTS } else { "" }, guarded].concat());
    t.set("DENSE", include_str!("../templates/mpc_dense.c"))
        .set("CONDENSE", include_str!("../templates/mpc_condense.c"))
        .set("SQP", include_str!("../templates/mpc_sqp.c"))
        .set("CHANGE", include_str!("../templates/mpc_change.c"))
        .set("SENSITIVITY", include_str!("../templates/mpc_sensitivity.c"));
    files.push(t.file("mpc.h", include_str!("../templates/mpc.h")));
    files.push(t.file("mpc.c", include_str!("../templates/mpc.c")));
    if let Some(estimation) = controller.estimator {
        files.extend(feedback_core(&mut t, estimation, dims)?);
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
        .set("OUTPUTS_EXACT", u8::from(problem.output_softness == Softness::Exact))
        .set("TRACKS_OUTPUTS", u8::from(controller.tracks_outputs()))
        .set("N1", problem.n1)
        .set("Q_WIDTH", if controller.tracks_outputs() { problem.tracked.len() } else { dims.nx })
        .set("HAS_TERMINAL", u8::from(problem.weights.terminal.is_some()))
        .set(
            "TERMINAL_TEXT",
            match problem.weights.terminal {
                Some(_) => "; q_terminal stays",
                None => "",
            },
        )
        .set("BOUNDS_VARY", u8::from(!controller.has_steady_bounds(dims)))
        .set("COST_UNIT", constant(controller.units(dims).cost))
        .set("HAS_UNITS", u8::from(has_units(&controller.units(dims))))
        .set("NX", dims.nx)
        .set("NU", dims.nu);
}

/// The numbers of the problem as tables.
fn set_problem(
    t: &mut Template,
    controller: &Controller<'_>,
    dims: Dims,
) -> Result<(), ExportError> {
    let problem = controller.problem;
    let units = controller.units(dims);
    let (states, inputs) = (problem.horizon * dims.nx, problem.control_horizon * dims.nu);
    let expand = |side: &[f64], count: usize, units: &[f64]| -> Vec<f64> {
        let all = side.repeat(count / side.len().max(1));
        all.iter().enumerate().map(|(i, v)| v / units[i % units.len()]).collect()
    };
    let (of_x, of_u) = (&units.states, &units.inputs);
    let low = [
        expand(&problem.state_bounds.low, states, of_x),
        expand(&problem.input_bounds.low, inputs, of_u),
    ];
    let high = [
        expand(&problem.state_bounds.high, states, of_x),
        expand(&problem.input_bounds.high, inputs, of_u),
    ];
    let increment_low = expand(&problem.increment_bounds.low, inputs, of_u);
    let increment_high = expand(&problem.increment_bounds.high, inputs, of_u);
    let limited = |low: &[f64], high: &[f64]| -> Vec<usize> {
        let sides = low.iter().zip(high).enumerate();
        sides.filter(|(_, (l, h))| l.is_finite() || h.is_finite()).map(|(i, _)| i).collect()
    };
    let state_rows = limited(&low[0], &high[0]);
    let increment_rows = limited(&increment_low, &increment_high);
    let [q, r, w] = weights(controller, &units, dims)?;
    let size = |values: &[f64]| constant(values.iter().fold(0.0_f64, |s, v| s.max(v.abs())));
    // The first rows and columns of W belong to the input applied last.
    let width = inputs + dims.nu;
    let free = w.chunks_exact(width).skip(dims.nu).flat_map(|row| &row[dims.nu..]).copied();
    let mut tables =
        String::from("/* Bounds on z, and what multipliers of states are at most. */\n");
    tables += &array("low", &low.concat());
    tables += &array("high", &high.concat());
    let penalties = controller.penalties(dims);
    tables += &array("penalty", &expand_penalties(&penalties, of_x, units.cost));
    tables += "/* Bounds on increments. */\n";
    tables += &array("increment_low", &increment_low);
    tables += &array("increment_high", &increment_high);
    tables += match controller.tracks_outputs() {
        true => {
            "/* Weights, twice: of what is tracked, [N2][NY][NY], of increments, [NC][NU][NU]. */\n"
        }
        false => {
            "/* Weights, twice: of the states, [N2][NX][NX], of increments, [NC][NU][NU]. */\n"
        }
    };
    tables += &array("q", &q);
    tables += &array("r", &r);
    if !w.is_empty() {
        tables += "/* Of all inputs, the one applied last in front. */\n";
        tables += &array("w", &w);
    }
    tables += "/* What is tracked: states, and behind them outputs; bounded states and increments \
               among all. */\n";
    tables += &places("tracked", &controller.tracked(dims)?);
    tables += &places("state_rows", &state_rows);
    tables += &places("increment_rows", &increment_rows);
    if has_units(&units) {
        tables += "/* Units of states and inputs, in the plant's units. */\n";
        tables += &array("x_unit", of_x);
        tables += &array("u_unit", of_u);
    }
    if controller.open().count() > 0 {
        tables += "/* Parameters before there is an estimate. */\n";
        tables += &array("parameters", &controller.open().initial().collect::<Vec<_>>());
    }
    tables += &output_rows(t, controller, &units, dims)?;
    t.set("STATE_ROWS", state_rows.len())
        .set("INCREMENT_ROWS", increment_rows.len())
        .set("LARGEST_W", size(&free.collect::<Vec<_>>()))
        .set("HAS_W", u8::from(!w.is_empty()))
        .set("TABLES", tables);
    Ok(())
}

/// What multipliers are at most, in the units of the optimization.
fn expand_penalties(penalties: &[f64], units: &[f64], cost: f64) -> Vec<f64> {
    let all = penalties.iter().enumerate();
    all.map(|(i, penalty)| penalty * units[i % units.len()] / cost).collect()
}

/// The tables of the bounds on outputs: of those that have any, interval by interval; outputs
/// with feedthrough at the end of each and at its start.
fn output_rows(
    t: &mut Template,
    controller: &Controller<'_>,
    units: &ProblemUnits,
    dims: Dims,
) -> Result<String, ExportError> {
    let problem = controller.problem;
    let stages = problem.horizon + 1 - problem.n1;
    let bounds = problem.output_bounds.as_ref();
    let side = |side: &[f64]| side.repeat(stages * dims.ny / side.len().max(1));
    let (low, high) = bounds.map_or_else(Default::default, |b| (side(&b.low), side(&b.high)));
    let limited = |o: &usize| {
        let sides = low.iter().zip(&high).skip(*o).step_by(dims.ny);
        sides.into_iter().any(|(low, high)| low.is_finite() || high.is_finite())
    };
    let feedthrough = controller.library_model()?.feedthrough();
    let outputs = (0..if bounds.is_some() { dims.ny } else { 0 }).filter(limited);
    let (through, ends): (Vec<_>, Vec<_>) = outputs.partition(|&o| feedthrough[o]);
    let blocks = [(&ends, 0), (&through, 0), (&through, 1)];
    let here = || blocks.into_iter().flat_map(|(of, start)| of.iter().map(move |&o| (o, start)));
    let rows = (0..stages).flat_map(|j| here().map(move |(o, start)| (j, o, start)));
    let rows: Vec<(usize, usize, usize)> = rows.collect();
    t.set("OUTPUT_ROWS", rows.len())
        .set("OUTPUT_WIDTH", here().count())
        .set("OUTPUT_STARTS", u8::from(!through.is_empty()))
        .set("ALL_OUTPUT_ROWS", low.len() + stages * through.len());
    if controller.tube.is_some() && !through.is_empty() {
        return Err(ExportError::Feature {
            feature: "control.uncertainty with bounds on outputs that depend on the input",
            instead: "bounds on states and inputs, or `pinc serve`",
        });
    }
    let pick = |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        rows.iter().map(|&(j, o, _)| of(j, o)).collect()
    };
    let soft = |o: usize| problem.output_softness.penalty(o) * units.outputs[o] / units.cost;
    let mut text = String::from(
        "/* Rows of bounded outputs: the interval, whose input they are taken with; of the predicted \
         states the one at that end of it (at the measured state any, for it does not move); \
         penalty. */\n",
    );
    let interval = |row: &(usize, usize, usize)| row.0 + problem.n1 - 1;
    let state = |row: &(usize, usize, usize)| interval(row).saturating_sub(row.2);
    text += &places("output_interval", &rows.iter().map(interval).collect::<Vec<_>>());
    text += &places("output_state", &rows.iter().map(state).collect::<Vec<_>>());
    if !rows.is_empty() {
        text += "/* Whether they are at the start of it; output. */\n";
        text += &places("output_start", &rows.iter().map(|row| row.2).collect::<Vec<_>>());
        text += &places("output_number", &rows.iter().map(|row| row.1).collect::<Vec<_>>());
        text += "/* Bounds in the plant's units; the units of the rows. */\n";
        text += &array("output_low", &pick(&|j, o| low[j * dims.ny + o]));
        text += &array("output_high", &pick(&|j, o| high[j * dims.ny + o]));
        text += &array("output_unit", &pick(&|_, o| units.outputs[o]));
    }
    Ok(text + &array("output_penalty", &pick(&|_, o| soft(o))))
}

/// 2 Q in terms of all states, or of what is tracked if outputs are; 2 R, and 2 W or nothing; in
/// the units of the optimization.
fn weights(
    controller: &Controller<'_>,
    units: &ProblemUnits,
    dims: Dims,
) -> Result<[Vec<f64>; 3], ExportError> {
    let problem = controller.problem;
    let weights = &problem.weights;
    let tracked = match controller.tracks_outputs() {
        true => (0..problem.tracked.len()).collect(),
        false => controller.tracked(dims)?,
    };
    let width = if controller.tracks_outputs() { tracked.len() } else { dims.nx };
    // Outputs are tracked in the plant's units.
    let unit = |i: usize| if controller.tracks_outputs() { 1.0 } else { units.states[i] };
    let mut q = vec![0.0; problem.horizon * width * width];
    for (j, block) in q.chunks_exact_mut(width * width).enumerate() {
        let weight = match &weights.terminal {
            Some(terminal) if j + 1 == problem.horizon => terminal,
            _ if j + 1 >= problem.n1 => weights.q.at(j),
            _ => continue,
        };
        for (i, row) in tracked.iter().enumerate() {
            for (k, column) in tracked.iter().enumerate() {
                let scale = unit(*row) * unit(*column) / units.cost;
                block[row * width + column] = 2.0 * weight.entry(i, k) * scale;
            }
        }
    }
    let inputs = |weight: &Weight| -> Vec<f64> {
        let (size, nu) = (weight.size(), dims.nu);
        let entry = |at: usize| {
            let (row, column) = (at / size, at % size);
            let scale = units.inputs[row % nu] * units.inputs[column % nu] / units.cost;
            2.0 * weight.entry(row, column) * scale
        };
        (0..size * size).map(entry).collect()
    };
    let r = (0..problem.control_horizon).flat_map(|i| inputs(weights.r.at(i))).collect();
    let w = weights.input_sequence.as_ref().map_or_else(Vec::new, inputs);
    finite("the weights of the controller, twice,", q.iter().chain(&r).chain(&w))?;
    Ok([q, r, w])
}

/// Fills the self-test with the steps of `library`, and warns of those that generated C does not solve.
pub(crate) fn set_selftest(
    t: &mut Template,
    controller: &Controller<'_>,
    mut library: Nmpc,
) -> Result<&'static str, ExportError> {
    // A step for which generated C lacks the exact Hessian has no other answer here.
    library.leave_out_exact_hessian();
    let (text, [steps, unsolved]) = match controller.estimator {
        None => {
            let steps = set_steps(t, controller, library)?;
            (include_str!("../templates/mpc_selftest.c"), steps)
        }
        Some(estimation) => {
            let steps = feedback_c::set_steps(t, (controller, library), estimation, STEPS)?;
            (include_str!("../templates/feedback_selftest.c"), steps)
        }
    };
    t.set("STEPS", steps);
    if unsolved > 0 {
        tracing::warn!(
            "generated C stalls or reaches its iteration limit in {unsolved} of the first {steps} \
             steps from the initial state: it has the Gauss-Newton Hessian alone; where `pinc control` \
             converges by the exact one, it applies other inputs"
        );
    }
    Ok(text)
}

/// Golden vectors: the controller of the library in closed loop with its own model. Gives the number of
/// steps, and how many of them are unsolved.
fn set_steps(
    t: &mut Template,
    controller: &Controller<'_>,
    mut nmpc: Nmpc,
) -> Result<[usize; 2], ExportError> {
    let mut model = controller.library_model()?;
    let mut x = controller.initial_state.to_vec();
    let width = controller.reference.outputs();
    let mut window = vec![0.0; controller.problem.horizon * width];
    let (mut states, mut windows, mut inputs) = (Vec::new(), Vec::new(), Vec::new());
    let (mut fresh, mut unsolved) = (Vec::new(), 0);
    nmpc.remember(&mut Memory::save(&mut fresh));
    for k in 0..STEPS.min(controller.reference.steps()) {
        controller.window(k, &mut window);
        let step = nmpc.step(&x, &window)?;
        unsolved += usize::from(is_unsolved(step.status));
        let u = step.u.to_vec();
        states.push(x.clone());
        windows.push(window.clone());
        let mut next = vec![0.0; x.len()];
        model.step(&x, &u, &[], &mut next);
        check_step(controller, (k, &x, &u), &next)?;
        inputs.push(u);
        x = next;
    }
    let rows = [&states[..], &windows[..], &inputs[..]];
    let [double, float] = Precision::both(None);
    nmpc.remember(&mut Memory::restore(&fresh));
    let units = controller.units(model.dims()).inputs;
    let in_double = moved(&mut nmpc, rows, &units, double)?;
    nmpc.remember(&mut Memory::restore(&fresh));
    let mut in_float = in_float(controller)?;
    let in_float = moved(in_float.as_mut().unwrap_or(&mut nmpc), rows, &units, float)?;
    set_allowed(t, None, [&in_double, &in_float]);
    let tables = [
        table("x", &states),
        table("rows", &windows),
        table("u", &inputs),
        array("unit_of_u", &units),
    ];
    t.set("TABLES", tables.concat());
    Ok([inputs.len(), unsolved])
}

/// How far the inputs of each step move if the states are off by rounding, as they may where a step does
/// not converge, and if `nmpc` ends its iteration earlier.
fn moved(
    nmpc: &mut Nmpc,
    [states, windows, inputs]: [&[Vec<f64>]; 3],
    units: &[f64],
    precision: Precision,
) -> Result<Vec<f64>, ExportError> {
    let mut moved = Vec::new();
    for (k, ((x, window), u)) in states.iter().zip(windows).zip(inputs).enumerate() {
        moved.push(difference(nmpc.step(&precision.round(k, x), window)?.u, u, units));
    }
    Ok(moved)
}

fn set_page(
    t: &mut Template,
    controller: &Controller<'_>,
    origin: &Origin,
) -> Result<(), ExportError> {
    let dims = controller.library_model()?.dims();
    let list = |values: &[f64]| values.iter().map(|v| constant(*v)).collect::<Vec<_>>().join(", ");
    let rows = match controller.model {
        ModelSource::Net(net) => {
            let rows =
                domain(net, origin).iter().map(|row| format!("- {row}\n")).collect::<String>();
            format!("The model is a net, which is good where it was trained:\n\n{rows}")
        }
        ModelSource::RungeKutta(model) => format!(
            "The model is the plant's equation, integrated by {} substeps of a Runge-Kutta method \
             of order {} per step.\n",
            model.substeps,
            model.method.order(),
        ),
    };
    let names = |places: Vec<usize>| {
        let names = origin.quantities(&places).map(|variable| variable.name.to_string());
        names.collect::<Vec<_>>().join(", ")
    };
    let tracked = names(controller.tracked(dims)?);
    if let Some(estimation) = controller.estimator {
        t.set("MEASURED", names(estimation.measured(dims)?));
    }
    t.set("T", constant(controller.sample_time_s()));
    let feedback = controller.estimator.map(|_| include_str!("../templates/feedback_readme.md"));
    t.set("FEEDBACK", feedback.unwrap_or_default());
    t.set("MODEL_TEXT", rows.trim_end())
        .set("X", list(controller.initial_state))
        .set("Y", tracked)
        .set("STATES", origin.state_list())
        .set("INPUTS", origin.input_list());
    Ok(())
}
