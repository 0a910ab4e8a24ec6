//! Controllers in C against the library's, step by step.

use super::compile::{READ, Sources};
use super::guard::Guarded;
use super::variants::{in_odd_units, tracking, with_rk5};
use pinc_export::{
    Controller, Estimation, ExportError, GeneratedFile, ModelSource, Name, Origin, RungeKuttaModel,
    controller_to_c,
};
use pinc_expr::{Equations, PlantEquations};
use pinc_mpc::{
    Bounds, NmpcProblem, Reference, Softness, SqpConfig, SqpHessian, Tracked, Trust, Weights,
};
use pinc_net::{Domain, NetConfig, PincModel, PincNet};
use pinc_ode::{Dims, Integrator, Model, Variable, WithOutputs};
use pinc_plants::{FourTanks, VanDerPol};

/// Reads per step: 1 for a reset before it, 1 and an input for one that was applied, the budget,
/// state and reference. Writes status, iterations, whether the plan is followed, the
/// KKT residual, the trust in the model, and the input.
pub(crate) const DRIVER: &str = r#"
#include "ctl_mpc.h"
#include <stdio.h>
static ctl_mpc m;
@READ@
int main(void)
{
    CTL_REAL head[3], applied[CTL_NU], x[CTL_NX], reference[CTL_N2 * CTL_NY], u[CTL_NU];
    ctl_mpc_init(&m);
    while (read(head, 3) && read(applied, CTL_NU) && read(x, CTL_NX) &&
           read(reference, CTL_N2 * CTL_NY)) {
        int i;
        ctl_status status;
        if (head[0] > 1) {
            ctl_mpc_reset_to(&m, x, applied);
        } else if (head[0] > 0) {
            ctl_mpc_reset(&m);
        }
        if (head[1] > 0) {
            ctl_mpc_set_applied(&m, applied);
        }
        m.budget = (long)head[2];
        status = ctl_mpc_step(&m, x, reference, u);
        printf("%d %d %d %.17g\n", (int)status, m.iterations, m.followed, (double)m.kkt);
        printf("%d\n", @TRUST@);
        for (i = 0; i < CTL_NU; i++) {
            printf("%.17g\n", (double)u[i]);
        }
    }
    return 0;
}
"#;

const STATUSES: [&str; 6] =
    ["converged", "iteration-limit", "deadline", "infeasible-qp", "stalled", "numerical-trouble"];

pub(crate) fn equations(json: &str) -> PlantEquations {
    let text: Equations = serde_json::from_str(json).unwrap();
    text.into()
}

pub(crate) fn oscillator() -> PlantEquations {
    equations(
        r#"{"states": [{"name": "x1"}, {"name": "x2"}], "inputs": [{"name": "u"}],
            "derivatives": {"x1": "x2", "x2": "(1 - x1^2)*x2 - x1 + u"}}"#,
    )
}

fn tanks() -> PlantEquations {
    equations(
        r#"{"states": [{"name": "h1"}, {"name": "h2"}, {"name": "h3"}, {"name": "h4"}],
            "inputs": [{"name": "u1"}, {"name": "u2"}],
            "let": {"w1": "0.071*sqrt(1962*max(h1, 0))", "w2": "0.057*sqrt(1962*max(h2, 0))",
                    "w3": "0.071*sqrt(1962*max(h3, 0))", "w4": "0.057*sqrt(1962*max(h4, 0))"},
            "derivatives": {"h1": "(0.7*3.33*u1 + w3 - w1)/28", "h2": "(0.6*3.35*u2 + w4 - w2)/32",
                            "h3": "(0.4*3.35*u2 - w3)/28", "h4": "(0.3*3.33*u1 - w4)/32"}}"#,
    )
}

/// A generator of numbers in [0, 1), the same in every run.
pub(crate) struct Draws(pub(crate) u64);

impl Draws {
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        f64::from(u32::try_from(self.0 >> 33).unwrap()) / f64::from(1_u32 << 31)
    }

    /// A budget from 1 to `most`, the same for both.
    pub(crate) fn budget(&mut self, most: f64) -> [f64; 2] {
        [(1.0 + most * self.unit()).floor(); 2]
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + self.unit() * (high - low)
    }
}

/// The Hessian that generated C has.
pub(crate) fn gauss_newton() -> SqpConfig {
    SqpConfig { hessian: SqpHessian::GaussNewton, ..SqpConfig::default() }
}

/// A case: a controller, the plant it is tried on, and the box that states are drawn from.
pub(crate) struct Case {
    pub(crate) problem: NmpcProblem,
    pub(crate) config: SqpConfig,
    pub(crate) source: Source,
    /// The parameters that are arguments of the model.
    pub(crate) parameters: Vec<String>,
    pub(crate) low: Vec<f64>,
    pub(crate) high: Vec<f64>,
    pub(crate) sample_time_s: f64,
    /// The plant, where the model is a net and its outputs are used.
    pub(crate) outputs_of: Option<PlantEquations>,
    pub(crate) begin: Begin,
    pub(crate) guard: Option<Guarded>,
}

/// What an exported controller begins with, and what it follows.
#[derive(Default)]
pub(crate) struct Begin {
    pub(crate) initial_input: Option<Vec<f64>>,
    /// By default the middle of the box.
    pub(crate) reference: Option<Reference>,
    pub(crate) without_preview: bool,
    pub(crate) budget_us: Option<f64>,
}

pub(crate) enum Source {
    RungeKutta(Box<PlantEquations>, Integrator, usize),
    Net(Box<PincNet>),
}

impl Source {
    pub(crate) fn runge_kutta(
        equations: PlantEquations,
        method: Integrator,
        substeps: usize,
    ) -> Self {
        Self::RungeKutta(Box::new(equations), method, substeps)
    }
}

impl Case {
    fn source(&self) -> ModelSource<'_> {
        match &self.source {
            Source::Net(net) => ModelSource::Net(net),
            Source::RungeKutta(equations, method, substeps) => {
                ModelSource::RungeKutta(RungeKuttaModel {
                    equations,
                    parameters: &self.parameters,
                    method: *method,
                    sample_time_s: self.sample_time_s,
                    substeps: *substeps,
                })
            }
        }
    }

    pub(crate) fn model(&self) -> Box<dyn Model> {
        match &self.source {
            Source::Net(net) => match &self.outputs_of {
                None => Box::new(PincModel::new(net).unwrap()),
                Some(equations) => {
                    let names: Vec<&str> = net.parameter_names().collect();
                    let plant = equations.compile_with(&names).unwrap().into_dyn();
                    let outputs = plant.model(Integrator::Rk4, self.sample_time_s, 1).unwrap();
                    Box::new(WithOutputs::new(PincModel::new(net).unwrap(), outputs))
                }
            },
            Source::RungeKutta(equations, method, substeps) => {
                let names: Vec<&str> = self.parameters.iter().map(String::as_str).collect();
                let plant = equations.compile_with(&names).unwrap().into_dyn();
                plant.model(*method, self.sample_time_s, *substeps).unwrap()
            }
        }
    }

    pub(crate) fn sources(&self) -> Sources {
        Sources::new(&self.export(None).unwrap())
    }

    pub(crate) fn export(
        &self,
        estimator: Option<Estimation<'_>>,
    ) -> Result<Vec<GeneratedFile>, ExportError> {
        self.export_by(estimator, |controller, name, origin| {
            controller_to_c(controller, (self.library(estimator), Vec::new()), name, origin)
        })
    }

    /// The controller, exported by `export`.
    pub(crate) fn export_by(
        &self,
        estimator: Option<Estimation<'_>>,
        export: impl Fn(&Controller<'_>, &Name, &Origin) -> Result<Vec<GeneratedFile>, ExportError>,
    ) -> Result<Vec<GeneratedFile>, ExportError> {
        let variables = |count: usize, name: &str| -> Vec<Variable> {
            (0..count)
                .map(|i| Variable { name: format!("{name}{i}").into(), unit: String::new().into() })
                .collect()
        };
        let dims = self.model().dims();
        let origin = Origin {
            version: "0".to_owned(),
            hash: "00".to_owned(),
            states: variables(dims.nx, "x"),
            inputs: variables(dims.nu, "u"),
            outputs: variables(dims.ny, "y"),
            proven: None,
        };
        let outputs = self.problem.tracked.len();
        let middle: Vec<f64> =
            self.low.iter().zip(&self.high).map(|(l, h)| f64::midpoint(*l, *h)).collect();
        let tracked = self.tracked_at(&middle).into_iter();
        let held = Reference::new(tracked.collect::<Vec<_>>().repeat(30), outputs).unwrap();
        let begin = &self.begin;
        let controller = Controller {
            problem: &self.problem,
            config: &self.config,
            model: self.source(),
            equations: self.outputs_of.as_ref(),
            estimates_error: false,
            guard: self.guard.as_ref().map(|guard| guard.exported(self)),
            initial_state: &middle,
            initial_input: begin.initial_input.as_deref(),
            reference: begin.reference.as_ref().unwrap_or(&held),
            preview: !begin.without_preview,
            budget_us: begin.budget_us,
            estimator,
            tube: None,
        };
        export(&controller, &Name::new("ctl").unwrap(), &origin)
    }

    /// What is tracked, in this state.
    pub(crate) fn tracked_at(&self, x: &[f64]) -> Vec<f64> {
        let mut model = self.model();
        let Dims { nu, np, ny, .. } = model.dims();
        let mut outputs = vec![0.0; ny];
        model.output(x, &vec![0.0; nu], &vec![1.0; np], &mut outputs);
        let value = |t: &Tracked| match *t {
            Tracked::State(i) => x[i],
            Tracked::Output(i) => outputs[i],
            _ => 0.0,
        };
        self.problem.tracked.iter().map(value).collect()
    }

    /// `steps` steps of the library, with random states and references in episodes of 25 and some
    /// surprises: the lines for the driver, and what it is to write.
    fn run(&self, steps: usize, draws: &mut Draws, budget: Budget) -> (Vec<f64>, Vec<Step>) {
        let mut nmpc = self.library(None);
        let mut model = self.model();
        let Dims { nx, nu, .. } = model.dims();
        let (mut lines, mut found) = (Vec::new(), Vec::new());
        let mut x = vec![0.0; nx];
        let mut reference = Vec::new();
        for k in 0..steps {
            let draw = |draws: &mut Draws| -> Vec<f64> {
                let ends = self.low.iter().zip(&self.high);
                ends.map(|(low, high)| draws.between(*low, *high)).collect()
            };
            let fresh = k % 25 == 0;
            if fresh {
                x = draw(draws);
            }
            if k % 10 == 0 {
                let target = draw(draws);
                reference = self.tracked_at(&target).repeat(self.problem.horizon);
            }
            let bounds = &self.problem.input_bounds;
            let ends = bounds.low.iter().zip(&bounds.high);
            let mut applied: Vec<f64> = ends.map(|(l, h)| draws.between(*l, *h)).collect();
            let reset = if !fresh {
                0.0
            } else if draws.unit() < 0.5 {
                1.0
            } else {
                2.0
            };
            let mut surprise = if draws.unit() < 0.05 { 1.0 } else { 0.0 };
            if let Some(Step { status: 1 | 4, u, .. }) = found.last()
                && !fresh
            {
                // Both go on from one input.
                (surprise, applied) = (1.0, u.clone());
            }
            let [budget, in_c] = budget(k % 25, draws);
            let cut = budget > 0.0;
            if reset > 1.0 {
                nmpc.reset_to(&x, &applied).unwrap();
            } else if reset > 0.0 {
                nmpc.reset();
            }
            if surprise > 0.0 {
                nmpc.set_applied_input(&applied).unwrap();
            }
            lines.extend([reset, surprise, in_c]);
            lines.extend(applied);
            lines.extend(&x);
            lines.extend(&reference);
            let mut spent = 0.0;
            let mut expired = || {
                spent += 1.0;
                budget > 0.0 && spent > budget
            };
            let step = nmpc.step_within(&x, &reference, &mut expired).unwrap();
            let name = step.status.to_string();
            let status = STATUSES.iter().position(|s| *s == name).unwrap();
            let iterations = u32::try_from(step.sqp_iterations).unwrap();
            let (followed, kkt, trust) = (step.followed, step.kkt.max(), step.trust);
            let u = step.u.to_vec();
            let mut next = vec![0.0; nx];
            model.step(&x, &u, &[], &mut next);
            x = next;
            // A disturbance, so that the plan is not just followed.
            let ends = self.low.iter().zip(&self.high);
            for (x, (low, high)) in x.iter_mut().zip(ends) {
                *x += (high - low) * draws.between(-0.01, 0.01);
                if !x.is_finite() {
                    *x = *low;
                }
            }
            found.push(Step { status, iterations, followed, cut, kkt, trust, u });
        }
        assert!(nu > 0);
        (lines, found)
    }
}

#[derive(Debug)]
struct Step {
    status: usize,
    iterations: u32,
    followed: bool,
    cut: bool,
    kkt: f64,
    trust: Trust,
    u: Vec<f64>,
}

/// The budgets of step `k` of an episode, of the library and of C; 0 is no limit.
pub(crate) type Budget = fn(k: usize, draws: &mut Draws) -> [f64; 2];

/// Runs both and compares; gives how often each status was seen.
#[track_caller]
pub(crate) fn compare(case: &Case, steps: usize, seed: u64) -> [usize; 6] {
    // What a budget leaves undone depends on the order of equals: only once, at the end.
    compare_within(case, steps, seed, |k, draws| {
        let cut = k == 24 && draws.unit() < 0.7;
        if cut { draws.budget(8.0) } else { [0.0; 2] }
    })
}

/// Compares the C controller with the library within budgets.
#[track_caller]
pub(crate) fn compare_within(case: &Case, steps: usize, seed: u64, budget: Budget) -> [usize; 6] {
    compare_with((&case.sources(), DRIVER), case, steps, seed, budget)
}

/// Compares C sources and their driver with the library.
#[track_caller]
pub(crate) fn compare_with(
    (sources, driver): (&Sources, &str),
    case: &Case,
    steps: usize,
    seed: u64,
    budget: Budget,
) -> [usize; 6] {
    let (lines, expected) = case.run(steps, &mut Draws(seed), budget);
    let trust = if case.guard.is_some() { "(int)m.trust" } else { "0" };
    let driver = driver.replace("@READ@", READ).replace("@TRUST@", trust);
    let found = sources.drive(&driver, &[], &lines);
    let width = 5 + case.problem.input_bounds.low.len();
    assert_eq!(found.len(), steps * width);
    let (mut seen, mut others, mut apart) = ([0; 6], 0, false);
    // An input of ordinary size counts as it is.
    let largest = case.problem.input_bounds.high[0].max(5.0) / 5.0;
    for (k, (found, expected)) in found.chunks_exact(width).zip(&expected).enumerate() {
        apart &= k % 25 != 0;
        if apart {
            continue;
        }
        if expected.cut && found[1].total_cmp(&f64::from(expected.iterations)).is_ne() {
            // They go on from different plans until the next episode.
            (others, apart) = (others + 1, true);
            continue;
        }
        let wanted = f64::from(u32::try_from(expected.status).unwrap());
        let same = found[5..].iter().zip(&expected.u).all(|(u, v)| (u - v).abs() < 1e-8 * largest);
        // What converges where a bound cannot be met is infeasible, status 3.
        let pair = [found[0].min(wanted), found[0].max(wanted)];
        let are = |of: [f64; 2]| pair.iter().zip(of).all(|(a, b)| a.total_cmp(&b).is_eq());
        let limit = are([0.0, 1.0]) || are([1.0, 3.0]);
        if limit && same && case.problem.output_bounds.is_some() {
            // The last bits of the residual decide whether it is below the tolerance.
            others += 1;
            continue;
        }
        assert!(found[0].total_cmp(&wanted).is_eq(), "step {k}: {found:?} {expected:?}");
        let followed = f64::from(u8::from(expected.followed));
        assert!(found[2].total_cmp(&followed).is_eq(), "step {k}: {found:?} {expected:?}");
        let trust = f64::from(expected.trust as u8);
        assert!(found[4].total_cmp(&trust).is_eq(), "step {k}: {found:?} {expected:?}");
        if expected.status == 2 {
            // Both may be infinite.
            let equal = found[3].total_cmp(&expected.kkt).is_eq();
            let off = (found[3] - expected.kkt).abs();
            assert!(equal || off < 1e-6 * expected.kkt, "step {k}: {found:?} {expected:?}");
        }
        // An iteration that does not converge ends anywhere.
        let allowed = if matches!(expected.status, 1 | 4) { 1e-2 } else { 1e-8 };
        for (found, expected_u) in found[5..].iter().zip(&expected.u) {
            let off = (found - expected_u).abs() / largest;
            assert!(off < allowed, "step {k}: {found} {expected:?}, {off:e}");
        }
        seen[expected.status] += 1;
    }
    // The library condenses with fused products, C without.
    assert!(others <= 2 + steps / 250, "{others} steps cut elsewhere");
    seen
}

pub(crate) fn oscillator_case() -> Case {
    let weights = Weights::uniform(vec![10.0, 10.0], vec![1.0]);
    Case {
        problem: NmpcProblem {
            state_bounds: Bounds::new(vec![-1.0; 2], vec![1.0; 2]),
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            ..NmpcProblem::new(Dims::new(2, 1), 5, weights)
        },
        config: gauss_newton(),
        source: Source::runge_kutta(oscillator(), Integrator::Rk4, 4),
        parameters: Vec::new(),
        low: vec![-1.3, -1.3],
        high: vec![1.3, 1.3],
        sample_time_s: 0.5,
        outputs_of: None,
        begin: Begin::default(),
        guard: None,
    }
}

pub(crate) fn tanks_case() -> Case {
    let weights = Weights::uniform(vec![10.0, 10.0], vec![1.0, 1.0]);
    Case {
        problem: NmpcProblem {
            tracked: Tracked::states([0, 1]),
            state_bounds: Bounds::new(vec![6.0, 6.0, 1.5, 1.5], vec![12.0, 12.0, 4.0, 4.0]),
            input_bounds: Bounds::new(vec![0.0; 2], vec![5.0; 2]),
            ..NmpcProblem::new(Dims::new(4, 2), 10, weights)
        },
        config: gauss_newton(),
        source: Source::runge_kutta(tanks(), Integrator::Rk4, 2),
        parameters: Vec::new(),
        low: vec![1.0, 1.0, 0.3, 0.3],
        high: vec![22.0, 22.0, 7.0, 7.0],
        sample_time_s: 10.0,
        outputs_of: None,
        begin: Begin::default(),
        guard: None,
    }
}

#[test]
fn the_oscillators_controller_takes_the_librarys_steps() {
    let seen = compare(&oscillator_case(), 8000, 1);
    // Ordinary ones, some cut by the budget, some that cannot be met.
    assert!(seen[0] > 4000 && seen[2] > 40 && seen[3] > 200, "{seen:?}");
}

#[test]
fn the_tanks_controller_takes_the_librarys_steps() {
    let seen = compare(&tanks_case(), 250, 2);
    assert!(seen[0] > 10 && seen[2] > 2 && seen[3] > 100, "{seen:?}");
}

/// Delay, bounded increments, soft bounds of both kinds, fewer free inputs, N1, a terminal weight,
/// and a weighted sequence of inputs.
#[test]
fn all_features_take_the_librarys_steps() {
    let base = oscillator_case;
    let with = |change: &dyn Fn(&mut NmpcProblem)| {
        let mut case = base();
        change(&mut case.problem);
        case
    };
    let increments = || Bounds::new(vec![-0.2], vec![0.3]);
    let cases = [
        with(&|p| p.delay = 2),
        with(&|p| (p.increment_bounds, p.delay) = (increments(), 1)),
        with(&|p| p.state_softness = Softness::Exact),
        with(&|p| p.state_softness = Softness::Penalty(vec![50.0, 5.0])),
        with(&|p| (p.control_horizon, p.n1) = (2, 3)),
        with(&|p| p.state_bounds = Bounds::none(2)),
        with(&|p| {
            p.weights = p.weights.clone().with_terminal(vec![40.0, 70.0]);
            p.increment_bounds = increments();
        }),
        with(&|p| {
            let mut w = vec![vec![0.0; 6]; 6];
            for (i, k, v) in [(0, 0, 2.0), (1, 1, 3.0), (0, 1, -1.0), (1, 0, -1.0), (5, 5, 1.0)] {
                w[i][k] = v;
            }
            p.weights = p.weights.clone().with_input_sequence(w);
        }),
        with(&|p| {
            p.tracked = Tracked::states([1]);
            p.weights = Weights::scaled(
                vec![10.0],
                vec![1.0],
                &[5.0, 4.0, 3.0, 2.0, 1.0],
                &[5.0, 4.0, 3.0, 2.0, 1.0],
            );
            p.state_bounds.low[0] = f64::NEG_INFINITY;
            p.state_bounds.high[0] = f64::INFINITY;
        }),
    ];
    for (i, case) in cases.iter().enumerate() {
        let seen = compare(case, 250, 10 + i as u64);
        assert!(seen[0] > 20, "case {i}: {seen:?}");
    }
}

/// The net with weights so small that it is nearly linear, and can be controlled.
pub(crate) fn mild(net: PincNet) -> PincNet {
    let smaller: Vec<f64> = net.mlp().parameters().iter().map(|w| 0.5 * w).collect();
    net.with_parameters(&smaller)
}

/// A net as the model.
#[test]
fn controllers_with_nets_take_the_librarys_steps() {
    let domain = Domain::new([-3.0..=3.0, -4.35..=4.35], [-1.0..=1.0]);
    let plant = VanDerPol::default().into_dyn();
    let net = mild(PincNet::new(&*plant, &NetConfig::new(0.5, 4, 20), &domain, 3).unwrap());
    let case = Case { source: Source::Net(Box::new(net)), ..oscillator_case() };
    let seen = compare(&case, 200, 5);
    assert!(seen[0] > 10 && seen[3] > 50, "{seen:?}");
    let level = || 1.0..=20.0;
    let domain = Domain::new([level(), level(), 0.5..=8.0, 0.5..=8.0], [0.0..=5.0, 0.0..=5.0]);
    let plant = FourTanks::antonelo().into_dyn();
    let net = mild(PincNet::new(&*plant, &NetConfig::new(10.0, 2, 10), &domain, 4).unwrap());
    let case = Case { source: Source::Net(Box::new(net)), ..tanks_case() };
    let seen = compare(&case, 60, 6);
    assert!(seen[1] > 30, "{seen:?}");
}

#[test]
fn the_self_test_passes_and_the_code_is_portable() {
    for (case, portable) in [
        (oscillator_case(), true),
        (tanks_case(), false),
        (with_rk5(), false),
        (in_odd_units(), false),
        (tracking(), true),
    ] {
        let sources = case.sources();
        let printed = match portable {
            true => sources.assert_portable("ctl"),
            false => sources.selftest("ctl", &[]),
        };
        if portable {
            sources.selftest_in_float();
        } else {
            sources.selftest("ctl", &["-DCTL_REAL=float"]);
        }
        assert!(printed.contains("20 steps") && !printed.contains("rounding"), "{printed}");
    }
}

/// The input's effect has the other sign where x is above 1 by a rounding error, and x starts at 1: no input
/// of the self-test is compared.
#[test]
fn inputs_that_depend_on_rounding_are_not_compared() {
    let gain = "(1 - 2*min(max((x - 1)*1e15, 0), 1))";
    let json = format!(
        r#"{{"states": [{{"name": "x"}}], "inputs": [{{"name": "u"}}], "derivatives": {{"x": "{gain}*u"}}}}"#
    );
    let weights = Weights::uniform(vec![10.0], vec![1.0]);
    let case = Case {
        problem: NmpcProblem {
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            ..NmpcProblem::new(Dims::new(1, 1), 2, weights)
        },
        source: Source::runge_kutta(equations(&json), Integrator::Rk4, 1),
        low: vec![0.5],
        high: vec![1.5],
        begin: Begin {
            reference: Some(Reference::new(vec![1.2; 30], 1).unwrap()),
            ..Begin::default()
        },
        ..oscillator_case()
    };
    let printed = case.sources().selftest("ctl", &[]);
    assert!(printed.contains("numbers from step 0 on depend on rounding"), "{printed}");
}
