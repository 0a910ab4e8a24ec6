//! Nets in place of controllers: the check against the controller's own cost, closed loops beside
//! the controller's, and the exported C against the library.

use pinc_ad::Scalar;
use pinc_batch::NmpcBatch;
use pinc_export::{
    Controller, GeneratedFile, ModelSource, Name, Origin, RungeKuttaModel, controller_to_c,
};
use pinc_expr::{Equations, OutputExpression, PlantEquations};
use pinc_mpc::{
    Bounds, Constraints, Nmpc, NmpcProblem, Planner, Program, Reference, SqpConfig, SqpStatus,
    StageConstraints, Tracked, Weights,
};
use pinc_ode::{Dims, Integrator, Rk4, Simulator, Variable};
use pinc_plants::VanDerPol;
use pinc_shrink::{
    Checked, Policy, Rater, Region, ShrinkConfig, ShrinkError, Shrunk, policy_to_c, shrink,
};
use std::fmt::Write as _;
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::{env, fs};

/// The paper's problem for the oscillator.
fn problem() -> NmpcProblem {
    NmpcProblem {
        state_bounds: Bounds::new(vec![-1.0; 2], vec![1.0; 2]),
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        ..NmpcProblem::new(Dims::new(2, 1), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
    }
}

fn controller(problem: NmpcProblem) -> Nmpc {
    controller_of(&VanDerPol::default().equations(), problem)
}

fn controller_of(equations: &PlantEquations, problem: NmpcProblem) -> Nmpc {
    let model = equations.to_dyn().unwrap().model(Integrator::Rk4, 0.5, 4).unwrap();
    Nmpc::new(problem, model, SqpConfig::default()).unwrap()
}

/// A pendulum, its height and the force at its joint, which depends on the torque.
fn pendulum() -> PlantEquations {
    pendulum_of("sin(a) + 0.1*min(a, a^3)")
}

fn pendulum_of(height: &str) -> PlantEquations {
    let texts = |pairs: [(&str, &str); 2]| pairs.map(|(of, text)| (of.to_owned(), text.to_owned()));
    let output = |expression: &str| OutputExpression {
        expression: expression.to_owned(),
        unit: String::new(),
    };
    let equations = Equations {
        states: vec![Variable::new("a", "rad"), Variable::new("w", "rad/s")],
        inputs: vec![Variable::new("u", "Nm")],
        derivatives: texts([("a", "w"), ("w", "max(u, -3) - sin(a) - 0.2*abs(w)*w - 0.1*w")])
            .into(),
        outputs: [
            ("force".to_owned(), output("sqrt(1 + w^2) + 0.5*u")),
            ("height".to_owned(), output(height)),
        ]
        .into(),
        ..Equations::default()
    };
    equations.into()
}

/// Follows the height and keeps the force below a limit that is met.
fn pendulum_problem() -> NmpcProblem {
    let no = f64::INFINITY;
    NmpcProblem {
        tracked: vec![Tracked::Output(1), Tracked::State(1)],
        output_bounds: Some(Bounds::new(vec![0.5, -no], vec![1.3, no])),
        ..problem()
    }
}

fn region() -> Region {
    Region {
        states: Bounds::new(vec![-0.6, -0.4], vec![0.9, 0.4]),
        references: Bounds::new(vec![-0.5, 0.0], vec![0.8, 0.0]),
        u_before: vec![0.0],
    }
}

fn shrunk(config: &ShrinkConfig, threads: usize) -> Shrunk {
    shrunk_of(&VanDerPol::default().equations(), &problem(), config, threads)
}

fn shrunk_of(
    equations: &PlantEquations,
    problem: &NmpcProblem,
    config: &ShrinkConfig,
    threads: usize,
) -> Shrunk {
    let make = || Ok::<_, ShrinkError>(controller_of(equations, problem.clone()));
    let mut batch = NmpcBatch::new(threads, make).unwrap();
    let plant = Simulator::new(&*equations.to_dyn().unwrap(), 1e-9);
    shrink(&mut batch, &plant, &region(), config, &mut |_| ControlFlow::Continue(())).unwrap()
}

/// A small training; `PINC_SAMPLES` sets how many plans it has.
fn small() -> ShrinkConfig {
    let samples = env::var("PINC_SAMPLES").ok().map(|samples| samples.parse().unwrap());
    let samples = samples.unwrap_or(1200);
    ShrinkConfig {
        neurons: 12,
        samples,
        iterations: 250,
        loops: 40,
        hold: 20,
        ..Default::default()
    }
}

/// The rating of the controller's own plan is the controller's own cost, and has no violation.
#[test]
fn the_cost_of_a_plan_is_the_controllers() {
    let mut nmpc = controller(problem());
    let mut rater = Rater::new(&mut nmpc);
    for (x, r, u) in [([0.3, 0.1], 0.0, 0.0), ([-0.4, 0.3], 0.6, -0.3), ([0.8, -0.2], -0.5, 0.2)] {
        nmpc.reset_input(&[u]).unwrap();
        let reference = [r, 0.0].repeat(5);
        let cost = nmpc.step(&x, &reference).unwrap().cost;
        let plan = nmpc.plan().inputs().to_vec();
        let mut rate = |plan| rater.rate(&mut nmpc.program(), [&x, &[r, 0.0], &[u]], plan);
        let found = rate(&plan);
        assert!((found.cost - cost).abs() < 1e-6 * cost, "{} is not {cost}", found.cost);
        assert!(found.violation < 1e-6, "{}", found.violation);
        let other: Vec<f64> = plan.iter().map(|u| 0.9 * u + 0.01).collect();
        assert!(rate(&other).cost > cost);
    }
}

/// On loops that it was not trained on, the net follows about as well as the controller; the check
/// breaks no bound that the controller keeps, and the result is the same on one thread and on two.
#[test]
fn a_net_follows_as_its_controller() {
    let found = shrunk(&small(), 1);
    let judged = found.judgement;
    assert_eq!(judged.loops, 40);
    let ratio = judged.checked.iae / judged.nmpc.iae;
    assert!((0.97..1.03).contains(&ratio), "{judged:?}, loss {}", found.loss);
    assert!((0.9..1.1).contains(&(judged.net.iae / judged.nmpc.iae)), "{judged:?}");
    assert_eq!([judged.checked.newly_broken, judged.backed.newly_broken], [0, 0], "{judged:?}");
    assert!(judged.checked.kept > 0.3, "{judged:?}");
    // Shares of steps: the net alone keeps all of its plans, and the controller none.
    assert!((judged.net.kept - 1.0).abs() < 1e-12 && judged.nmpc.kept == 0.0, "{judged:?}");
    assert!((judged.nmpc.optimized - 1.0).abs() < 1e-12, "{judged:?}");
    assert!((1000..=small().samples).contains(&found.labels), "{}", found.labels);
    let config = ShrinkConfig { iterations: 5, loops: 4, threads: 2, ..small() };
    let (one, two) =
        (shrunk(&ShrinkConfig { threads: 1, ..config.clone() }, 1), shrunk(&config, 2));
    assert_eq!((one.loss.to_bits(), one.judgement), (two.loss.to_bits(), two.judgement));
}

/// What a net does not replace is named.
#[test]
fn other_controllers_are_refused() {
    #[derive(Debug)]
    struct Sum;
    impl StageConstraints for Sum {
        fn inequalities(&self) -> usize {
            1
        }
        fn evaluate<S: Scalar>(&self, x: &[S], _: &[S], h: &mut [S], _: &mut [S]) {
            h[0] = x[0] + x[1] - 3.0;
        }
    }
    let constrained = NmpcProblem { constraints: Some(Constraints::new(Sum)), ..problem() };
    let mut ending = problem();
    let bounds = &mut ending.state_bounds;
    for side in [&mut bounds.low, &mut bounds.high] {
        *side = side.repeat(ending.horizon);
    }
    let by_real_time = SqpConfig { real_time: true, max_iterations: 1, ..SqpConfig::default() };
    for (problem, config, expected) in [
        (constrained, SqpConfig::default(), "constraints h and g"),
        (ending, SqpConfig::default(), "bounds that differ between stages"),
        (problem(), by_real_time, "real-time iterations"),
    ] {
        let make = || {
            let model = Rk4::new(VanDerPol::default(), 0.5, 4);
            Ok::<_, ShrinkError>(Nmpc::new(problem.clone(), Box::new(model), config).unwrap())
        };
        let mut batch = NmpcBatch::new(1, make).unwrap();
        let plant = Simulator::new(&VanDerPol::default(), 1e-9);
        let refused =
            shrink(&mut batch, &plant, &region(), &small(), &mut |_| ControlFlow::Continue(()))
                .unwrap_err();
        assert!(refused.to_string().contains(expected), "{refused}");
    }
}

/// Decisions in C for states and references on the input, each of which may begin anew with an input
/// and a plan: which plan was taken, and the plan in use.
const MAIN_C: &str = "\
#include \"vdp_policy.h\"
#include <stdio.h>
static double number(void)
{
    double value = 0.0;
    if (scanf(\"%lf\", &value) != 1) {
        value = 0.0;
    }
    return value;
}
int main(void)
{
    vdp_policy policy;
    double x[2], r[2] = {0.0, 0.0}, u[1], plan[5];
    int begins, i;
    while (scanf(\"%d\", &begins) == 1) {
        if (begins) {
            u[0] = number();
            for (i = 0; i < 5; i++) {
                plan[i] = number();
            }
            vdp_policy_reset(&policy, u);
            vdp_policy_begin(&policy, plan);
        }
        x[0] = number();
        x[1] = number();
        r[0] = number();
        printf(\"%d\", vdp_policy_step(&policy, x, r, u));
        printf(\" %.17g\", u[0]);
        for (i = 0; i < 5; i++) {
            printf(\" %.17g\", policy.plan[i]);
        }
        printf(\"\\n\");
    }
    return 0;
}
";

/// The policy as C, and the controller whose model it uses.
fn files(equations: &PlantEquations, shrunk: &Shrunk, nmpc: &mut Nmpc) -> Vec<GeneratedFile> {
    let problem = nmpc.problem().clone();
    let name = Name::new("vdp").unwrap();
    let variables = |count: usize, letter: &str| {
        let variable =
            |i| Variable { name: format!("{letter}{i}").into(), unit: String::new().into() };
        (0..count).map(variable).collect()
    };
    let origin = Origin {
        version: "0".to_owned(),
        hash: "00".to_owned(),
        states: variables(2, "x"),
        inputs: variables(1, "u"),
        outputs: variables(nmpc.model().dims().ny, "y"),
        proven: None,
    };
    let controller = Controller {
        problem: &problem,
        config: &SqpConfig::default(),
        model: ModelSource::RungeKutta(RungeKuttaModel {
            equations,
            parameters: &[],
            method: Integrator::Rk4,
            sample_time_s: 0.5,
            substeps: 4,
        }),
        equations: None,
        estimates_error: false,
        guard: None,
        initial_state: &[0.6, -0.2],
        initial_input: None,
        reference: &Reference::new([[0.4, 0.0].repeat(10), [-0.3, 0.0].repeat(10)].concat(), 2)
            .unwrap(),
        preview: false,
        budget_us: None,
        estimator: None,
        tube: None,
    };
    let policy = Vec::from(policy_to_c(&shrunk.policy, nmpc, &controller, &name).unwrap());
    let library = controller_of(equations, problem.clone());
    controller_to_c(&controller, (library, policy), &name, &origin).unwrap()
}

/// A check that says which plan it took.
#[derive(Debug)]
struct Noting(Checked, Arc<AtomicUsize>);

impl Planner for Noting {
    fn plan(
        &mut self,
        program: &mut Program<'_>,
        [x, reference, u_before]: [&[f64]; 3],
        inputs: &mut [f64],
    ) -> (SqpStatus, f64) {
        let mut other = inputs.to_vec();
        let (taken, rating) = self.0.decide(program, [x, &reference[..2], u_before], &mut other);
        let more = if rating.violation > 1e-6 { 4 } else { 0 };
        self.1.store(taken + more, Ordering::Relaxed);
        self.0.plan(program, [x, reference, u_before], inputs)
    }
}

/// A state or a reference that is no number, for `MAIN_C`.
const NO_NUMBERS: [&str; 3] = ["0 nan 0 0", "0 0.1 0.1 nan", "0 0.1 0.1 inf"];

/// The exported policy takes the same plans as the library, in double precision.
#[test]
fn exported_c_decides_as_the_library() {
    let of_states = decides_as_the_library(&VanDerPol::default().equations(), &problem(), "policy");
    let of_outputs = decides_as_the_library(&pendulum(), &pendulum_problem(), "policy-outputs");
    let taken = of_states + &of_outputs;
    assert!(['0', '1', '2', '3'].iter().all(|plan| taken.contains(*plan)), "{taken}");
}

/// The self-test of the directory steps the net: it passes in both precisions, and fails if a weight of
/// the net is another.
fn selftest(dir: &Path) {
    let make = |real: &str| {
        let options =
            ["clean", "test", &format!("VDP_REAL={real}"), "CFLAGS=-O1 -Wall -Wextra -Werror"];
        let made = Command::new("make").args(options).current_dir(dir).output().unwrap();
        (made.status.success(), String::from_utf8(made.stdout).unwrap())
    };
    for real in ["double", "float"] {
        let (passed, printed) = make(real);
        let allowed = if real == "double" { "allowed 1.00e-08" } else { "allowed 1.00e-03" };
        assert!(printed.contains(allowed), "{printed}");
        let line = printed.lines().find(|line| line.starts_with("vdp_policy: 20 plans")).unwrap();
        assert!(
            passed && line.contains(" 0 of which differ") && !line.contains(" 0 dec"),
            "{printed}"
        );
    }
    let source = dir.join("vdp_policy.c");
    let text = fs::read_to_string(&source).unwrap();
    let (before, rest) = text.split_once("weights[").unwrap();
    let changed = format!("{before}weights[{}", rest.replacen("VDP_N(", "VDP_N(0.1 + ", 1));
    fs::write(&source, changed).unwrap();
    let (passed, printed) = make("double");
    assert!(!passed, "{printed}");
    fs::write(&source, text).unwrap();
}

/// Takes decisions by C and by the library: along a loop, and from plans of the controller, as they
/// are and with another last input, of which the net's may be better. Returns which plans were taken.
fn decides_as_the_library(equations: &PlantEquations, problem: &NmpcProblem, dir: &str) -> String {
    let config = ShrinkConfig { iterations: 3, samples: 300, loops: 1, ..small() };
    let found = shrunk_of(equations, problem, &config, 1);
    let mut nmpc = controller_of(equations, problem.clone());
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(dir);
    fs::create_dir_all(&dir).unwrap();
    for file in files(equations, &found, &mut nmpc) {
        fs::write(dir.join(&file.path), &file.bytes).unwrap();
    }
    fs::write(dir.join("main.c"), MAIN_C).unwrap();
    let noted = Arc::new(AtomicUsize::new(0));
    // The numbers that a file would keep make the same policy.
    let policy = Policy::new(found.policy.net().clone(), &nmpc).unwrap();
    let checked = Checked::new(policy, &mut nmpc).unwrap().alone();
    nmpc.set_planner(Some(Box::new(Noting(checked, noted.clone()))));
    let mut other = controller_of(equations, problem.clone());
    let (mut asked, mut expected, mut x) = (String::new(), Vec::new(), vec![0.6, -0.2]);
    for k in 0..100_u32 {
        let r = if k < 30 { 0.4 } else { -0.3 };
        let mut first = (k == 0).then(|| vec![0.0; 5]);
        if k >= 60 {
            x = vec![0.6 * f64::from(k).sin(), 0.3 * f64::from(k).cos()];
            other.reset_input(&[0.1]).unwrap();
            other.step(&x, &[r, 0.0].repeat(5)).unwrap();
            let mut plan = other.plan().inputs().to_vec();
            plan[4] -= if k % 2 == 0 { 0.4 } else { 0.0 };
            first = Some(plan);
        }
        asked += if first.is_some() { "1 0.1" } else { "0" };
        if let Some(plan) = &first {
            nmpc.reset_input(&[0.1]).unwrap();
            nmpc.set_first_plan(plan).unwrap();
            plan.iter().for_each(|u| write!(asked, " {u}").unwrap());
        }
        writeln!(asked, " {} {} {r}", x[0], x[1]).unwrap();
        let step = nmpc.step(&x, &[r, 0.0].repeat(5)).unwrap();
        let (u, status, taken) = (step.u.to_vec(), step.status, noted.load(Ordering::Relaxed));
        let good = if taken % 4 == 3 { SqpStatus::Kept } else { SqpStatus::Replaced };
        assert_eq!(status, good, "plan {taken}");
        expected.push((taken, [&u[..], nmpc.plan().inputs()].concat()));
        let mut next = [0.0; 2];
        let mut program = nmpc.program();
        let (model, p) = program.model(0);
        model.step(&x, &u, p, &mut next);
        x.copy_from_slice(&next);
    }
    NO_NUMBERS.iter().for_each(|line| writeln!(asked, "{line}").unwrap());
    // The net is in the library that is built, and on the page that says how.
    let page = fs::read_to_string(dir.join("README.md")).unwrap();
    assert!(page.contains("`vdp_policy.h`") && page.contains(" vdp_policy.c "), "{page}");
    assert!(fs::read_to_string(dir.join("Makefile")).unwrap().contains(" vdp_policy.c"));
    selftest(&dir);
    // One plan in each lane, and one lane.
    for more in [&[][..], &["-DVDP_VECTOR_BYTES=0"]] {
        let built = Command::new("cc")
            .args(["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-o", "run"])
            .args(more)
            .args(["main.c", "vdp_policy.c", "vdp_rk4.c", "-lm"])
            .current_dir(&dir)
            .output()
            .unwrap();
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        let run =
            Command::new(dir.join("run")).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut run = run.unwrap();
        run.stdin.take().unwrap().write_all(asked.as_bytes()).unwrap();
        let printed = String::from_utf8(run.wait_with_output().unwrap().stdout).unwrap();
        assert_eq!(printed.lines().count(), expected.len() + NO_NUMBERS.len());
        let last = printed.lines().skip(expected.len());
        assert!(last.into_iter().all(|line| line.starts_with("4 ")), "{printed}");
        for (k, (line, (taken, plan))) in printed.lines().zip(&expected).enumerate() {
            let (flag, numbers) = line.split_once(' ').unwrap();
            assert_eq!(flag, taken.to_string(), "step {k}");
            for (found, u) in numbers.split(' ').zip(plan) {
                let found: f64 = found.parse().unwrap();
                assert!((found - u).abs() < 1e-9, "step {k}, plan {taken}: {found} is not {u}");
            }
        }
    }
    expected.iter().map(|(taken, _)| taken.to_string()).collect()
}

/// Another equation or output with the same names, or the same one with other substeps, makes other plans.
#[test]
fn a_net_of_plans_with_another_model_is_refused() {
    let config = ShrinkConfig { iterations: 1, samples: 60, loops: 1, ..small() };
    let own = [
        (
            VanDerPol::default().equations(),
            problem(),
            [(VanDerPol::default().equations(), 2), (pendulum(), 4)],
        ),
        (pendulum(), pendulum_problem(), [(pendulum(), 2), (pendulum_of("0.9*sin(a)"), 4)]),
    ];
    for (equations, problem, others) in own {
        let net = shrunk_of(&equations, &problem, &config, 1);
        let checked = |equations: &PlantEquations, substeps| {
            let model = equations.to_dyn().unwrap().model(Integrator::Rk4, 0.5, substeps).unwrap();
            let mut nmpc = Nmpc::new(problem.clone(), model, SqpConfig::default()).unwrap();
            let policy = Policy::new(net.policy.net().clone(), &nmpc).unwrap();
            Checked::new(policy, &mut nmpc)
        };
        checked(&equations, 4).unwrap();
        for (equations, substeps) in others {
            let refused = checked(&equations, substeps).unwrap_err();
            assert!(matches!(refused, ShrinkError::Model), "{refused}");
        }
    }
}
