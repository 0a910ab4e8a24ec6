//! Controllers with their estimators in C against the library's, step by step.

use super::compile::{READ, Sources};
use super::controller::{Case, Draws, Source, equations, mild, tanks_case};
use super::start::number;
use pinc_estimate::{
    Augmentation, Augmented, Compensated, Disturbance, Ekf, Estimator, Gate, Measured, Mhe, Tuning,
    Ukf,
};
use pinc_export::{Estimation, ExportError, Filter};
use pinc_expr::PlantEquations;
use pinc_mpc::{Bounds, Nmpc, SqpStatus, Tracked};
use pinc_net::{Domain, NetConfig, ParameterRange, PincNet};
use pinc_ode::Integrator;

/// Reads per step: 1 for an input that was applied, 1 for an estimate and a covariance to go on
/// from, that input, which measurements are there, these, the reference, that estimate and
/// covariance. Writes both statuses, the input and the estimate.
const DRIVER: &str = r#"
#include "ctl_feedback.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
static ctl_feedback f;
@READ@
int main(void)
{
    CTL_REAL head[2], applied[CTL_NU], there[CTL_NM], y[CTL_NM];
    CTL_REAL z[CTL_NZ], p[CTL_NZ * CTL_NZ];
    CTL_REAL reference[CTL_N2 * CTL_NY], u[CTL_NU];
    ctl_feedback_init(&f);
    while (read(head, 2) && read(applied, CTL_NU) && read(there, CTL_NM) && read(y, CTL_NM) &&
           read(reference, CTL_N2 * CTL_NY) && read(z, CTL_NZ) && read(p, CTL_NZ * CTL_NZ)) {
        int i;
        ctl_status status;
        if (head[0] > 0) {
            ctl_feedback_set_applied(&f, applied);
        }
        if (head[1] > 0) {
            memcpy(f.estimator.z, z, sizeof(z));
            memcpy(f.estimator.p, p, sizeof(p));
        }
        for (i = 0; i < CTL_NM; i++) {
            if (!(there[i] > 0)) {
                y[i] = (CTL_REAL)NAN;
            }
        }
        status = ctl_feedback_step(&f, y, reference, u);
        printf("%d %d\n", (int)status, (int)f.estimate_status);
        for (i = 0; i < CTL_NU; i++) {
            printf("%.17g\n", (double)u[i]);
        }
        for (i = 0; i < CTL_NZ; i++) {
            printf("%.17g\n", (double)f.estimator.z[i]);
        }
    }
    return 0;
}
"#;

const NU: usize = 2;

/// A controller with what it estimates.
pub(crate) type Parts = (Case, Augmentation, Tuning);

/// The tanks with sensors in the lower ones.
pub(crate) fn tanks(disturbance: Disturbance, delay: usize) -> Parts {
    let mut case = tanks_case();
    let augmentation =
        Augmentation { disturbance, ..Augmentation::measured(Measured::states([0, 1])) };
    let unknowns = augmentation.unknowns(case.model().dims());
    case.problem.parameters = vec![0.0; unknowns];
    case.problem.delay = delay;
    // Levels that can be held.
    (case.low, case.high) = (vec![8.0, 8.0, 1.5, 1.5], vec![11.0, 11.0, 3.0, 3.0]);
    let with = |states: [f64; 4], unknown: f64| [&states[..], &vec![unknown; unknowns]].concat();
    let tuning = Tuning {
        initial_estimate: with([9.0, 9.0, 2.0, 2.0], 0.0),
        initial_sd: with([0.5; 4], 0.3),
        process_sd: with([0.03; 4], 0.01),
        measurement_sd: vec![0.05; 2],
        low: with([7.0, 7.0, 1.8, 0.5], -0.3),
        high: with([14.0, 14.0, 4.0, 4.0], 0.3),
        gate: Gate::Sd(8.0),
        range: vec![6.0; 4],
        ..Tuning::default()
    };
    (case, augmentation, tuning)
}

pub(crate) fn library(
    filter: Filter,
    case: &Case,
    of: &Augmentation,
    tuning: &Tuning,
) -> Box<dyn Estimator> {
    let model = Box::new(Augmented::new(case.model(), of.clone()).unwrap());
    match filter {
        Filter::Extended => Box::new(Ekf::new(model, tuning.clone()).unwrap()),
        Filter::MovingHorizon(steps) => Box::new(Mhe::new(model, tuning.clone(), steps).unwrap()),
        _ => Box::new(Ukf::new(model, tuning.clone()).unwrap()),
    }
}

/// The number in C of an estimator's status.
pub(crate) fn number_of(status: &str) -> f64 {
    let words = [
        "updated",
        "nothing-measured",
        "indefinite-covariance",
        "not-finite",
        "iteration-limit",
        "qp-failed",
        "rejected",
        "reacquired",
    ];
    let place = words.iter().position(|word| *word == status).unwrap();
    f64::from(u8::try_from(place).unwrap())
}

/// What a step is to give.
struct Expected {
    statuses: [String; 2],
    u: Vec<f64>,
    z: Vec<f64>,
}

/// Steps of the library with a plant that its model is not quite right for, sensors with noise that
/// fail, and inputs that others change: the lines for the driver, and what it is to write.
fn run(
    filter: Filter,
    (case, augmentation, tuning): &Parts,
    steps: usize,
) -> (Vec<f64>, Vec<Expected>) {
    let mut draws = Draws(7);
    let mut estimator = library(filter, case, augmentation, tuning);
    let model = Compensated::new(case.model(), augmentation.clone()).unwrap();
    let mut nmpc = Nmpc::new(case.problem.clone(), Box::new(model), case.config).unwrap();
    let mut plant = case.model();
    let last = case.problem.delay * NU;
    let mut before = case.begin.initial_input.clone().unwrap_or_else(|| vec![0.0; NU]);
    let mut inputs = before.repeat(case.problem.delay + 1);
    estimator.reset_input(&before);
    nmpc.reset_input(&before).unwrap();
    let (mut x, mut next) = (vec![9.0, 9.0, 2.0, 2.0], vec![0.0; 4]);
    let (mut seen, mut unknowns) = (x.clone(), case.problem.parameters.clone());
    let p = &augmentation.parameters[..];
    let mut outputs = vec![0.0; plant.dims().ny];
    let (mut lines, mut all, mut reference) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..steps {
        let belief = [estimator.estimate(), estimator.covariance()].concat();
        let random: Vec<f64> = (0..NU).map(|_| draws.between(0.5, 4.0)).collect();
        let overruled = draws.unit() < 0.1 && k > 0;
        let applied = random;
        if overruled {
            inputs[last..].copy_from_slice(&applied);
            nmpc.set_applied_input(&applied).unwrap();
        }
        if k > 0 {
            // The pumps give less than they are told.
            let worn: Vec<f64> = inputs[..NU].iter().map(|u| 0.9 * u).collect();
            plant.step(&x, &worn, p, &mut next);
            x.copy_from_slice(&next);
            before.copy_from_slice(&inputs[..NU]);
            estimator.predict(&before);
            inputs.copy_within(NU.., 0);
        }
        if k % 15 == 0 {
            let mut row = vec![draws.between(8.0, 11.0), draws.between(8.0, 11.0)];
            if case.problem.tracked[0] == Tracked::Output(1) {
                row = vec![1.7 * row[0] + 0.2, row[1]];
            }
            reference = row.repeat(case.problem.horizon);
        }
        let there: Vec<f64> = (0..2).map(|_| if draws.unit() < 0.2 { 0.0 } else { 1.0 }).collect();
        plant.output(&x, &before, p, &mut outputs);
        let exact = augmentation.measured.iter().map(|measured| match *measured {
            Measured::State(state) => x[state],
            Measured::Output(output) => outputs[output],
            _ => 0.0,
        });
        let mut y: Vec<f64> = exact.map(|y| y + draws.between(-0.1, 0.1)).collect();
        // A reading of a broken converter, and a sensor that is off for a while.
        y[0] = if k % 20 == 9 { 65535.0 } else { y[0] };
        y[1] += if (40..60).contains(&k) { 1.5 } else { 0.0 };
        // A mean of the unscented filter is a second difference over alpha = 1e-3 standard
        // deviations: of a next state x, rounding of u = 1.1e-16 makes 2 u |x| / alpha^2 = 3e-9 at
        // levels of 12, in the library as in C. The loop would make more of it: the filters begin
        // every step at the same estimate.
        let again = filter == Filter::Unscented && k > 0;
        lines.extend([overruled, again].map(|yes| if yes { 1.0 } else { 0.0 }));
        let row = applied.iter().chain(&there).chain(&y).chain(&reference).chain(&belief);
        lines.extend(row);
        let told = y.iter().zip(&there).map(|(y, there)| if *there > 0.0 { *y } else { f64::NAN });
        let corrected = estimator.correct(&told.collect::<Vec<_>>()).status;
        augmentation.read(estimator.estimate(), &mut seen, &mut unknowns);
        nmpc.set_parameters(&unknowns).unwrap();
        let step = nmpc.step(&seen, &reference).unwrap();
        inputs[last..].copy_from_slice(step.u);
        all.push(Expected {
            statuses: [step.status.to_string(), corrected.to_string()],
            u: step.u.to_vec(),
            z: estimator.estimate().to_vec(),
        });
    }
    (lines, all)
}

/// Compares them; gives the number of steps whose estimate is at a bound.
#[track_caller]
fn compare(filter: Filter, parts: &Parts) -> usize {
    let (case, augmentation, tuning) = parts;
    let estimation = Estimation { filter, augmentation, tuning };
    let sources = Sources::new(&case.export(Some(estimation)).unwrap());
    let steps = if matches!(filter, Filter::MovingHorizon(_)) { 80 } else { 200 };
    let (lines, expected) = run(filter, parts, steps);
    let found = sources.drive(&DRIVER.replace("@READ@", READ), &[], &lines);
    let (width, mut missing, mut worst) = (2 + NU + tuning.initial_estimate.len(), 0, [0.0_f64; 2]);
    let (mut rejected, mut reacquired) = (0, 0);
    assert_eq!(found.len(), expected.len() * width);
    for (k, (found, expected)) in found.chunks_exact(width).zip(&expected).enumerate() {
        let converged = if found[0] < 0.5 { "converged" } else { "another" };
        let (ended, corrected) = (&expected.statuses[0], &expected.statuses[1]);
        assert_eq!(converged == "converged", ended == "converged", "step {k}: {ended}");
        let place = number_of(corrected);
        assert!(found[1].total_cmp(&place).is_eq(), "step {k}: {corrected}");
        missing += usize::from(corrected == "nothing-measured");
        rejected += usize::from(corrected == "rejected");
        reacquired += usize::from(corrected == "reacquired");
        for (i, (found, expected)) in
            found[2..].iter().zip(expected.u.iter().chain(&expected.z)).enumerate()
        {
            let worst = &mut worst[usize::from(i >= NU)];
            *worst = worst.max((found - expected).abs());
        }
    }
    // For the unscented filter see above, for numbers up to 20 and models that are off by 4 ulps:
    // 2e-8. After its covariance was widened, gains of what is not measured are up to 5; the
    // controllers' gains are up to 4, and what these differ by comes back into the estimates. Where
    // it is widened again at once, both add up.
    let allowed = if filter == Filter::Unscented { [8e-7, 4e-7] } else { [1e-8; 2] };
    assert!(worst[0] < allowed[0] && worst[1] < allowed[1], "inputs, estimates: {worst:?}");
    assert!(missing > steps / 100, "{missing} steps without a measurement");
    assert!(rejected > 3 && reacquired > 0, "{rejected} rejected, {reacquired} reacquired");
    let is_at_bound = |z: &[f64]| {
        let mut bounds = z.iter().zip(tuning.low.iter().zip(&tuning.high));
        bounds.any(|(z, (low, high))| (z - low).min(high - z) < 1e-9)
    };
    expected.iter().filter(|step| is_at_bound(&step.z)).count()
}

#[test]
fn the_extended_filter_in_c_estimates_what_the_librarys_does() {
    compare(Filter::Extended, &tanks(Disturbance::Input, 0));
    compare(Filter::Extended, &tanks(Disturbance::Output, 2));
    compare(Filter::Extended, &tanks(Disturbance::States(vec![1, 0]), 1));
    compare(Filter::Extended, &tanks(Disturbance::None, 0));
}

#[test]
fn the_unscented_filter_in_c_estimates_what_the_librarys_does() {
    compare(Filter::Unscented, &tanks(Disturbance::Input, 1));
    compare(Filter::Unscented, &tanks(Disturbance::Output, 0));
    compare(Filter::Unscented, &tanks(Disturbance::States(vec![1, 0]), 0));
    compare(Filter::Unscented, &tanks(Disturbance::None, 0));
}

#[test]
fn the_moving_horizon_in_c_estimates_what_the_librarys_does() {
    compare(Filter::MovingHorizon(1), &tanks(Disturbance::Input, 0));
    compare(Filter::MovingHorizon(10), &tanks(Disturbance::Output, 2));
    compare(Filter::MovingHorizon(4), &tanks(Disturbance::States(vec![1, 0]), 1));
    // Bounds that hold most of the time.
    let (_, _, tuning) = tanks(Disturbance::Input, 0);
    let low = [7.0, 7.0, 2.2, 2.0, -0.05, 0.0].to_vec();
    let high = [14.0, 9.8, 2.4, 4.0, 0.3, 0.02].to_vec();
    let tight = Tuning { low, high, ..tuning };
    // Without noise, bounds on a disturbance at two steps are one.
    let steady = Tuning { process_sd: vec![0.03, 0.03, 0.03, 0.03, 0.0, 0.0], ..tight.clone() };
    for tuning in [tight, steady] {
        let (case, augmentation, _) = tanks(Disturbance::Input, 0);
        let held = compare(Filter::MovingHorizon(6), &(case, augmentation, tuning));
        assert!(held > 40, "{held} steps with an estimate at a bound");
    }
    let (case, augmentation, tuning) = tanks(Disturbance::None, 0);
    let free = Tuning { low: Vec::new(), high: Vec::new(), ..tuning };
    compare(Filter::MovingHorizon(5), &(case, augmentation, free));
}

/// The tanks with a pump whose constant is estimated, and the sum of the lower levels and a flow
/// as outputs: both are measured, and with the first level tracked and bounded.
pub(crate) fn with_outputs_and_pump(disturbance: Disturbance) -> Parts {
    let (mut case, mut augmentation, mut tuning) = tanks(disturbance, 0);
    case.source = Source::runge_kutta(tanks_with_outputs(), Integrator::Rk4, 2);
    // In alphabetical order: flow, total.
    case.problem.tracked = vec![Tracked::Output(1), Tracked::State(1)];
    case.problem.output_bounds =
        Some(Bounds::new(vec![f64::NEG_INFINITY, 12.0], vec![f64::INFINITY, 22.0]));
    augmentation.measured = vec![Measured::State(1), Measured::Output(1)];
    augmentation.parameters = vec![0.3, 3.33];
    augmentation.estimated = vec![1];
    case.parameters = vec!["split".to_owned(), "k1".to_owned()];
    case.problem.parameters.push(3.33);
    // The first reading of the total is under it.
    case.begin.initial_input = Some(vec![3.0, 2.5]);
    tuning.initial_estimate.push(3.2);
    tuning.initial_sd.push(0.2);
    tuning.process_sd.push(0.01);
    tuning.low.push(2.0);
    tuning.high.push(5.0);
    (case, augmentation, tuning)
}

fn tanks_with_outputs() -> PlantEquations {
    equations(
        r#"{"states": [{"name": "h1"}, {"name": "h2"}, {"name": "h3"}, {"name": "h4"}],
            "inputs": [{"name": "u1"}, {"name": "u2"}], "parameters": {"k1": 1, "split": 1},
            "let": {"w1": "0.071*sqrt(1962*max(h1, 0))", "w2": "0.057*sqrt(1962*max(h2, 0))",
                    "w3": "0.071*sqrt(1962*max(h3, 0))", "w4": "0.057*sqrt(1962*max(h4, 0))"},
            "derivatives": {"h1": "(0.7*k1*u1 + w3 - w1)/28", "h2": "(0.6*3.35*u2 + w4 - w2)/32",
                            "h3": "(0.4*3.35*u2 - w3)/28", "h4": "(split*k1*u1 - w4)/32"},
            "outputs": {"total": "h1 + 0.7*h2 + 0.05*k1*u1", "flow": "0.3*k1*u1 + w3"}}"#,
    )
}

#[test]
fn estimated_parameters_and_measured_outputs_are_the_librarys() {
    for disturbance in [Disturbance::None, Disturbance::Output, Disturbance::States(vec![1])] {
        let parts = with_outputs_and_pump(disturbance);
        compare(Filter::Extended, &parts);
        compare(Filter::Unscented, &parts);
        // An output depends on the input, which is another one at each step of the window.
        compare(Filter::MovingHorizon(6), &parts);
    }
    // An input's disturbance and a pump's constant cannot be told apart from these: one of them.
    let (mut case, mut augmentation, mut tuning) = with_outputs_and_pump(Disturbance::Input);
    (augmentation.estimated, augmentation.parameters) = (Vec::new(), Vec::new());
    case.parameters.clear();
    let mut fixed = tanks_with_outputs();
    fixed = fixed.with_parameters([("k1", 3.33), ("split", 0.3)]);
    case.source = Source::runge_kutta(fixed, Integrator::Rk5, 1);
    case.problem.parameters.pop();
    for side in [
        &mut tuning.initial_estimate,
        &mut tuning.initial_sd,
        &mut tuning.process_sd,
        &mut tuning.low,
        &mut tuning.high,
    ] {
        side.pop();
    }
    let parts = (case, augmentation, tuning);
    compare(Filter::Extended, &parts);
    compare(Filter::Unscented, &parts);
}

/// A net of a family, of whose two parameters one is estimated, with the plant's own outputs.
#[test]
fn a_parameter_of_a_net_is_estimated_as_in_the_library() {
    let mut parts = with_outputs_and_pump(Disturbance::Output);
    let case = &mut parts.0;
    let level = || 1.0..=20.0;
    let domain = Domain::new([level(), level(), 0.5..=8.0, 0.5..=8.0], [0.0..=5.0, 0.0..=5.0])
        .with_parameters([
            ParameterRange::new("split", 0.2..=0.4),
            ParameterRange::new("k1", 2.0..=5.0),
        ]);
    let plant = tanks_with_outputs().compile_with(&["split", "k1"]).unwrap().into_dyn();
    let net = PincNet::new(&*plant, &NetConfig::new(10.0, 2, 10), &domain, 4).unwrap();
    case.source = Source::Net(Box::new(mild(net)));
    case.outputs_of = Some(tanks_with_outputs());
    case.problem.state_bounds = Bounds::none(4);
    let (case, augmentation, tuning) = &parts;
    let estimation = Estimation { filter: Filter::Extended, augmentation, tuning };
    let sources = Sources::new(&case.export(Some(estimation)).unwrap());
    assert!(sources.assert_portable("ctl").contains("20 steps"));
}

/// The self-test passes with any disturbance; with one of them the code is looked at more closely.
#[track_caller]
fn assert_sound(filter: Filter, portable: &Disturbance) {
    for disturbance in [Disturbance::Input, Disturbance::Output, Disturbance::None] {
        let (case, augmentation, tuning) = tanks(disturbance.clone(), 1);
        let estimation = Estimation { filter, augmentation: &augmentation, tuning: &tuning };
        let sources = Sources::new(&case.export(Some(estimation)).unwrap());
        if disturbance == *portable {
            assert!(sources.assert_portable("ctl").contains("20 steps"));
            sources.selftest_in_float();
        } else {
            assert!(sources.selftest("ctl", &[]).contains("20 steps"));
        }
    }
}

#[test]
fn the_extended_filter_passes_its_self_test_and_is_portable() {
    assert_sound(Filter::Extended, &Disturbance::Input);
}

#[test]
fn the_unscented_filter_passes_its_self_test_and_is_portable() {
    assert_sound(Filter::Unscented, &Disturbance::Output);
}

#[test]
fn the_moving_horizon_passes_its_self_test_and_is_portable() {
    assert_sound(Filter::MovingHorizon(3), &Disturbance::Input);
}

/// Tells three controllers of inputs that were applied: the first nothing, the second what it has to
/// refuse, the third one that it takes. Writes the answers, and then what each estimates and chooses.
const APPLIED: &str = r#"
#include "ctl_feedback.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
static ctl_feedback f[3];
int main(void)
{
    const CTL_REAL y[2] = {9.0, 9.0};
    const CTL_REAL beyond[5][2] = {
        {2.0, 5.1}, {-0.1, 2.0}, {2.0, (CTL_REAL)NAN}, {(CTL_REAL)INFINITY, 2.0}, {1e5, 0.0}};
    const CTL_REAL within[2] = {0.0, 5.0};
    CTL_REAL reference[CTL_N2 * CTL_NY], u[CTL_NU];
    int i;
    int k;
    for (i = 0; i < CTL_N2 * CTL_NY; i++) {
        reference[i] = 9.0;
    }
    for (k = 0; k < 3; k++) {
        /* Whatever the memory holds. */
        memset(&f[k], (k == 0) ? 0 : 0xff, sizeof(f[k]));
        if (ctl_feedback_set_applied(&f[k], within) != CTL_NOT_INITIALIZED ||
            ctl_mpc_set_applied(&f[k].controller, within) != CTL_NOT_INITIALIZED) {
            return 1;
        }
        ctl_feedback_init(&f[k]);
        ctl_feedback_step(&f[k], y, reference, u);
    }
    for (i = 0; i < 5; i++) {
        printf("%d\n", (int)ctl_feedback_set_applied(&f[1], beyond[i]));
    }
    printf("%d\n", (int)ctl_feedback_set_applied(&f[2], within));
    for (k = 0; k < 3; k++) {
        ctl_feedback_step(&f[k], y, reference, u);
        printf("%.17g\n%.17g\n%.17g\n", (double)f[k].x[0], (double)u[0], (double)u[1]);
    }
    return 0;
}
"#;

#[test]
fn an_applied_input_beyond_its_bounds_is_refused_and_changes_nothing() {
    let (case, augmentation, tuning) = tanks(Disturbance::Input, 0);
    let (augmentation, tuning) = (&augmentation, &tuning);
    let estimation = Estimation { filter: Filter::Extended, augmentation, tuning };
    let sources = Sources::new(&case.export(Some(estimation)).unwrap());
    let found = sources.drive(APPLIED, &[], &[]);
    let bad = number(SqpStatus::BadArgument);
    let expected = [bad, bad, bad, bad, bad, 0.0];
    assert!(found[..6].iter().zip(expected).all(|(a, b)| a.total_cmp(&b).is_eq()), "{found:?}");
    let [untold, refused, taken] = [6..9, 9..12, 12..15].map(|part| &found[part]);
    assert_eq!(untold, refused);
    assert!((taken[0] - untold[0]).abs() > 0.01 && taken[1..] != untold[1..], "{found:?}");
}

#[test]
fn invalid_estimators_are_refused() {
    let (case, augmentation, tuning) = tanks(Disturbance::Input, 0);
    // What the library refuses is refused in its words.
    let fewer = Tuning { process_sd: vec![0.1], ..tuning.clone() };
    let estimation =
        Estimation { filter: Filter::Extended, augmentation: &augmentation, tuning: &fewer };
    assert!(matches!(case.export(Some(estimation)), Err(ExportError::Estimator(_))));
}
