//! The optimality conditions, assembled a second time, and loops whose plans are judged by them.

use crate::problems::Loop;
use pinc_mpc::{Bounds, Nmpc, SqpConfig, SqpStatus, Tracked, Weight};
use pinc_ode::{Dims, Linearization, Model, OutputLinearization, Stages};

/// What one step was given.
pub(crate) struct StepInput<'a> {
    pub(crate) x: &'a [f64],
    pub(crate) previous: &'a [f64],
    pub(crate) reference: &'a [f64],
}

fn diagonal(weight: &Weight) -> &[f64] {
    match weight {
        Weight::Diagonal(diagonal) => diagonal,
        Weight::Full(_) => panic!("the problems here have diagonal weights"),
    }
}

/// The residuals of the KKT conditions at the controller's plan: stationarity, feasibility of the
/// dynamics, violation of bounds, complementarity; unscaled, with Jacobians from the model.
pub(crate) fn residuals(nmpc: &Nmpc, model: &mut dyn Model, input: &StepInput<'_>) -> [f64; 4] {
    residuals_with(nmpc, model, input, [&none, &none])
}

/// No cost.
pub(crate) fn none(_: usize, _: &[f64], _: &[f64]) -> Gradient {
    (Vec::new(), Vec::new())
}

/// Derivatives by x and by u.
type Gradient = (Vec<f64>, Vec<f64>);

/// The gradient of a cost at (j, x, u).
type Extra<'a> = &'a dyn Fn(usize, &[f64], &[f64]) -> Gradient;

/// The residuals with a cost of stages and one of outputs, by their gradients in x and u: the first
/// is asked at x\[k+j\] and the input that acts there, the second at x\[k+j\] and the input that
/// leads there. Bounded outputs are seen with these inputs at both ends.
#[expect(clippy::needless_range_loop, reason = "indices as in the formulas")]
pub(crate) fn residuals_with(
    nmpc: &Nmpc,
    model: &mut dyn Model,
    input: &StepInput<'_>,
    [stage, end]: [Extra<'_>; 2],
) -> [f64; 4] {
    let (problem, plan) = (nmpc.problem(), nmpc.plan());
    let Dims { nx: n, nu: m, .. } = model.dims();
    let x = |j: usize| match j {
        0 => input.x,
        _ => &plan.states()[(j - 1) * n..j * n],
    };
    let u = |i: usize| &plan.inputs()[i * m..(i + 1) * m];
    // dJ/dx and dJ/du
    let mut dx = vec![vec![0.0; n]; problem.horizon + 1];
    let mut du = vec![vec![0.0; m]; problem.control_horizon];
    for j in problem.n1..=problem.horizon {
        for (i, tracked) in problem.tracked.iter().enumerate() {
            let &Tracked::State(state) = tracked else { continue };
            let error = x(j)[state] - input.reference[(j - 1) * problem.tracked.len() + i];
            dx[j][state] += 2.0 * diagonal(problem.weights.q.at(j - 1))[i] * error;
        }
    }
    for i in 0..problem.control_horizon {
        for c in 0..m {
            let before = if i == 0 { input.previous[c] } else { u(i - 1)[c] };
            let slope = 2.0 * diagonal(problem.weights.r.at(i))[c] * (u(i)[c] - before);
            du[i][c] += slope;
            if i > 0 {
                du[i - 1][c] -= slope;
            }
        }
    }
    for j in 0..=problem.horizon {
        for (cost, interval) in [(stage, j), (end, j.saturating_sub(1))] {
            let held = interval.min(problem.control_horizon - 1);
            let (by_x, by_u) = cost(j, x(j), u(held));
            dx[j].iter_mut().zip(by_x).for_each(|(sum, entry)| *sum += entry);
            du[held].iter_mut().zip(by_u).for_each(|(sum, entry)| *sum += entry);
        }
    }
    let outputs: Vec<(f64, f64, [f64; 2])> = output_rows(nmpc, &*model)
        .into_iter()
        .map(|OutputRow { state, interval, output, mu, limits }| {
            let held = interval.min(problem.control_horizon - 1);
            let [y, c, d] = outputs_at(model, [x(state), u(held), nmpc.parameters()]);
            let along = |sum: &mut [f64], row: &[f64]| {
                sum.iter_mut().zip(row).for_each(|(sum, entry)| *sum += mu * entry);
            };
            along(&mut dx[state], &c[output * n..]);
            along(&mut du[held], &d[output * m..]);
            (y[output], mu, limits)
        })
        .collect();

    let mut infeasibility: f64 = 0.0;
    let (mut next, mut a, mut b) = (vec![0.0; n], vec![0.0; n * n], vec![0.0; n * m]);
    for j in 0..problem.horizon {
        let acting = j.min(problem.control_horizon - 1);
        model.linearize(
            Stages { x: x(j), u: u(acting), p: nmpc.parameters() },
            Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
        );
        let lambda = &plan.dynamics_multipliers()[j * n..(j + 1) * n];
        for row in 0..n {
            infeasibility = infeasibility.max((next[row] - x(j + 1)[row]).abs());
            dx[j + 1][row] -= lambda[row];
            for column in 0..n {
                dx[j][column] += lambda[row] * a[row * n + column];
            }
            for column in 0..m {
                du[acting][column] += lambda[row] * b[row * m + column];
            }
        }
    }

    let (mut stationarity, mut violation, mut complementarity) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut bounded = |slope: f64, mu: f64, value: f64, low: f64, high: f64| {
        stationarity = stationarity.max((slope + mu).abs());
        violation = violation.max(low - value).max(value - high);
        if mu > 0.0 {
            complementarity = complementarity.max(mu * (high - value));
        }
        if mu < 0.0 {
            complementarity = complementarity.max(-mu * (value - low));
        }
    };
    for j in 1..=problem.horizon {
        for (i, &slope) in dx[j].iter().enumerate() {
            let mu = plan.state_multipliers()[(j - 1) * n + i];
            let Bounds { low, high } = &problem.state_bounds;
            bounded(slope, mu, x(j)[i], low[i], high[i]);
        }
    }
    for (i, slopes) in du.iter().enumerate() {
        for (c, &slope) in slopes.iter().enumerate() {
            let mu = plan.input_multipliers()[i * m + c];
            let Bounds { low, high } = &problem.input_bounds;
            bounded(slope, mu, u(i)[c], low[c], high[c]);
        }
    }
    for (y, mu, [low, high]) in outputs {
        bounded(-mu, mu, y, low, high);
    }
    [stationarity, infeasibility, violation, complementarity]
}

/// A bound on an output at one point of a plan.
struct OutputRow {
    state: usize,
    interval: usize,
    output: usize,
    mu: f64,
    limits: [f64; 2],
}

/// All bounds on outputs: for each interval those without feedthrough at its end, then the others
/// at its end, then these at its start.
fn output_rows(nmpc: &Nmpc, model: &dyn Model) -> Vec<OutputRow> {
    let problem = nmpc.problem();
    let Some(bounds) = &problem.output_bounds else { return Vec::new() };
    let ny = model.dims().ny;
    let (through, plain): (Vec<_>, Vec<_>) = (0..ny).partition(|&o| model.feedthrough()[o]);
    let mut multipliers = nmpc.plan().constraint_multipliers().iter();
    let mut rows = Vec::new();
    for stage in problem.n1..=problem.horizon {
        for (outputs, state) in [(&plain, stage), (&through, stage), (&through, stage - 1)] {
            for &output in outputs {
                let at = (stage - problem.n1) * ny % bounds.low.len() + output;
                rows.push(OutputRow {
                    state,
                    interval: stage - 1,
                    output,
                    mu: *multipliers.next().unwrap(),
                    limits: [bounds.low[at], bounds.high[at]],
                });
            }
        }
    }
    rows
}

/// y, C and D at (x, u, p).
fn outputs_at(model: &mut dyn Model, [x, u, p]: [&[f64]; 3]) -> [Vec<f64>; 3] {
    let Dims { nx, nu, ny, .. } = model.dims();
    let [mut y, mut c, mut d] = [1, nx, nu].map(|width| vec![0.0; ny * width]);
    let out = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut [] };
    model.linearize_output(Stages { x, u, p }, out);
    [y, c, d]
}

/// The scaling that `KktResidual` documents.
pub(crate) fn scale(nmpc: &Nmpc) -> f64 {
    let plan = nmpc.plan();
    let all =
        [plan.dynamics_multipliers(), plan.state_multipliers(), plan.input_multipliers()].concat();
    let count = all.len() + plan.increment_multipliers().len();
    let mean = all.iter().map(|l| l.abs()).sum::<f64>() / count as f64;
    f64::max(1.0, mean / 100.0)
}

/// Runs a closed loop with this model in the controller, judging every step.
pub(crate) fn judge(mut run: Loop, mut model: impl Model + Clone + 'static) {
    let problem = run.problem.clone();
    let mut nmpc = Nmpc::new(problem, Box::new(model.clone()), SqpConfig::default()).unwrap();
    let mut previous = vec![0.0; model.dims().nu];
    run.run(|k, x, reference| {
        let step = nmpc.step(x, reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "step {k}");
        let (u, reported) = (step.u.to_vec(), step.kkt);
        let input = StepInput { x, previous: &previous, reference };
        let [stationarity, dynamics, bounds, complementarity] =
            residuals(&nmpc, &mut model, &input);
        let s = scale(&nmpc);
        let found = [stationarity / s, dynamics, bounds, complementarity / s];
        assert!(found.iter().all(|&r| r <= 1e-8), "step {k}: {found:?}");
        // Sums of some ten terms up to 1e3, in another order: 1e-12.
        let worst = found.iter().fold(0.0, |worst: f64, r| worst.max(*r));
        assert!((worst - reported.max()).abs() < 1e-11, "step {k}: {worst:e} {reported:?}");
        previous.copy_from_slice(&u);
        u
    });
}
