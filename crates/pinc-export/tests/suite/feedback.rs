//! Controllers with their estimators in C against the library's, step by step.

use super::compile::Sources;
use super::controller::{Case, Draws, tanks_case};
use pinc_estimate::{
    Augmentation, Augmented, Compensated, Disturbance, Ekf, Estimator, Measured, Tuning, Ukf,
};
use pinc_export::{Estimation, ExportError, Filter};
use pinc_mpc::Nmpc;

/// Reads per step: 1 and an input for one that was applied, which measurements are there, these and
/// the reference. Writes both statuses, the input and the estimate.
const DRIVER: &str = r#"
#include "ctl_feedback.h"
#include <math.h>
#include <stdio.h>
static ctl_feedback f;
static int read(CTL_REAL *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        double v;
        if (scanf("%lf", &v) != 1) {
            return 0;
        }
        to[i] = (CTL_REAL)v;
    }
    return 1;
}
int main(void)
{
    CTL_REAL head[1], applied[CTL_NU], there[CTL_NM], y[CTL_NM];
    CTL_REAL reference[CTL_N2 * CTL_NY], u[CTL_NU];
    ctl_feedback_init(&f);
    while (read(head, 1) && read(applied, CTL_NU) && read(there, CTL_NM) && read(y, CTL_NM) &&
           read(reference, CTL_N2 * CTL_NY)) {
        int i;
        ctl_status status;
        if (head[0] > 0) {
            ctl_feedback_set_applied(&f, applied);
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

/// The tanks with sensors in the lower ones.
fn tanks(disturbance: Disturbance, delay: usize) -> (Case, Augmentation, Tuning) {
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
    };
    (case, augmentation, tuning)
}

fn library(filter: Filter, case: &Case, of: &Augmentation, tuning: &Tuning) -> Box<dyn Estimator> {
    let model = Box::new(Augmented::new(case.model(), of.clone()).unwrap());
    match filter {
        Filter::Extended => Box::new(Ekf::new(model, tuning.clone()).unwrap()),
        _ => Box::new(Ukf::new(model, tuning.clone()).unwrap()),
    }
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
    (case, augmentation, tuning): &(Case, Augmentation, Tuning),
    steps: usize,
) -> (Vec<f64>, Vec<Expected>) {
    let mut draws = Draws(7);
    let mut estimator = library(filter, case, augmentation, tuning);
    let model = Compensated::new(case.model(), augmentation.clone()).unwrap();
    let mut nmpc = Nmpc::new(case.problem.clone(), Box::new(model), case.config).unwrap();
    let mut plant = case.model();
    let last = case.problem.delay * NU;
    let mut inputs = vec![0.0; last + NU];
    let (mut x, mut next) = (vec![9.0, 9.0, 2.0, 2.0], vec![0.0; 4]);
    let (mut seen, mut unknowns) = (x.clone(), case.problem.parameters.clone());
    let (mut lines, mut all, mut reference) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..steps {
        let overruled = k > 0 && draws.unit() < 0.1;
        let applied: Vec<f64> = (0..NU).map(|_| draws.between(0.5, 4.0)).collect();
        if overruled {
            inputs[last..].copy_from_slice(&applied);
            nmpc.set_applied_input(&applied).unwrap();
        }
        if k > 0 {
            // The pumps give less than they are told.
            let worn: Vec<f64> = inputs[..NU].iter().map(|u| 0.9 * u).collect();
            plant.step(&x, &worn, &[], &mut next);
            x.copy_from_slice(&next);
            estimator.predict(&inputs[..NU]);
            inputs.copy_within(NU.., 0);
        }
        if k % 15 == 0 {
            let row = [draws.between(8.0, 11.0), draws.between(8.0, 11.0)];
            reference = row.repeat(case.problem.horizon);
        }
        let there: Vec<f64> = (0..2).map(|_| if draws.unit() < 0.2 { 0.0 } else { 1.0 }).collect();
        let y: Vec<f64> = x[..2].iter().map(|x| x + draws.between(-0.1, 0.1)).collect();
        lines.push(if overruled { 1.0 } else { 0.0 });
        lines.extend(applied.iter().chain(&there).chain(&y).chain(&reference));
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

#[track_caller]
fn compare(filter: Filter, disturbance: Disturbance, delay: usize) {
    let parts = tanks(disturbance, delay);
    let (case, augmentation, tuning) = &parts;
    let estimation = Estimation { filter, augmentation, tuning };
    let sources = Sources::new(&case.export(Some(estimation)).unwrap());
    let (lines, expected) = run(filter, &parts, 200);
    let found = sources.drive(DRIVER, &[], &lines);
    let (width, mut missing) = (2 + NU + tuning.initial_estimate.len(), 0);
    assert_eq!(found.len(), expected.len() * width);
    // A mean of the unscented filter is a difference of near points, times a weight of 1e5.
    let allowed = if filter == Filter::Unscented { 1e-6 } else { 1e-8 };
    let words = ["updated", "nothing-measured", "indefinite-covariance", "not-finite"];
    for (k, (found, expected)) in found.chunks_exact(width).zip(&expected).enumerate() {
        let converged = if found[0] < 0.5 { "converged" } else { "another" };
        let (ended, corrected) = (&expected.statuses[0], &expected.statuses[1]);
        assert_eq!(converged == "converged", ended == "converged", "step {k}: {ended}");
        let place = words.iter().position(|word| word == corrected).unwrap();
        let place = f64::from(u8::try_from(place).unwrap());
        assert!(found[1].total_cmp(&place).is_eq(), "step {k}: {corrected}");
        missing += usize::from(corrected == "nothing-measured");
        for (found, expected) in found[2..].iter().zip(expected.u.iter().chain(&expected.z)) {
            assert!((found - expected).abs() < allowed, "step {k}: {found} {expected} {ended}");
        }
    }
    assert!(missing > 2, "{missing} steps without a measurement");
}

#[test]
fn the_extended_filter_in_c_estimates_what_the_librarys_does() {
    compare(Filter::Extended, Disturbance::Input, 0);
    compare(Filter::Extended, Disturbance::Output, 2);
    compare(Filter::Extended, Disturbance::States(vec![1, 0]), 1);
    compare(Filter::Extended, Disturbance::None, 0);
}

#[test]
fn the_unscented_filter_in_c_estimates_what_the_librarys_does() {
    compare(Filter::Unscented, Disturbance::Input, 1);
    compare(Filter::Unscented, Disturbance::Output, 0);
    compare(Filter::Unscented, Disturbance::States(vec![1, 0]), 0);
    compare(Filter::Unscented, Disturbance::None, 0);
}

#[test]
fn the_self_test_with_an_estimator_passes_and_the_code_is_portable() {
    for filter in [Filter::Extended, Filter::Unscented] {
        for disturbance in [Disturbance::Input, Disturbance::Output, Disturbance::None] {
            let (case, augmentation, tuning) = tanks(disturbance, 1);
            let estimation = Estimation { filter, augmentation: &augmentation, tuning: &tuning };
            let sources = Sources::new(&case.export(Some(estimation)).unwrap());
            assert!(sources.selftest("ctl", &[]).contains("20 steps"));
            sources.selftest("ctl", &["-DCTL_REAL=float"]);
            sources.assert_portable("ctl");
        }
    }
}

#[test]
fn estimators_that_cannot_be_generated_are_refused() {
    let (case, augmentation, tuning) = tanks(Disturbance::Input, 0);
    let refused = |augmentation: &Augmentation, word: &str| {
        let estimation = Estimation { filter: Filter::Extended, augmentation, tuning: &tuning };
        match case.export(Some(estimation)) {
            Err(ExportError::Feature { feature, .. }) => assert!(feature.contains(word)),
            other => panic!("{word}: {other:?}"),
        }
    };
    let outputs = vec![Measured::State(0), Measured::Output(0)];
    refused(&Augmentation { measured: outputs, ..augmentation.clone() }, "measured outputs");
    refused(&Augmentation { estimated: vec![0], ..augmentation.clone() }, "estimated parameters");
    // What the library refuses is refused in its words.
    let fewer = Tuning { process_sd: vec![0.1], ..tuning.clone() };
    let estimation =
        Estimation { filter: Filter::Extended, augmentation: &augmentation, tuning: &fewer };
    assert!(matches!(case.export(Some(estimation)), Err(ExportError::Estimator(_))));
}
