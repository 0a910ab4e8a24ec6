//! Controllers as FMUs, step by step, against the library's.

use super::compile::Sources;
use super::controller::{Begin, Case, oscillator_case};
use super::start::number;
use pinc_export::{Controller, FmiVersion, GeneratedFile, Name, Origin, controller_to_fmu};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpStatus};

/// Begins at a start time, and writes input and status at every sample. The state is set at the
/// start and then only where `set` says so; samples are reached in one communication step or two.
const DRIVER: &str = r#"
#include "ctl_fmu.c"
#include <stdio.h>
#include <stdlib.h>
#define START 7.25
int main(void)
{
    fmi2CallbackFunctions callbacks = {0, calloc, free, 0, 0};
    const fmi2ValueReference u[1] = {0};
    const fmi2ValueReference set[4] = {1, 2, 3, 4};
    const fmi2ValueReference status[1] = {0};
    fmi2Real values[4] = {0.6, -0.2, 0.1, 0.0};
    fmi2Real input;
    fmi2Integer ended;
    int k;
    fmi2Component c = fmi2Instantiate("a", fmi2CoSimulation, CTL_GUID, "", &callbacks, 0, 0);
    fmi2SetupExperiment(c, 0, 0.0, START, 0, 0.0);
    fmi2SetReal(c, set, 4, values);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    for (k = 0; k < 12; k++) {
        const double t = START + (CTL_SAMPLE_TIME_S * (double)k);
        if (k == 5) {
            values[0] = NAN;
            fmi2SetReal(c, set, 1, values);
        }
        if (k == 7) {
            values[0] = -0.4;
            fmi2SetReal(c, set, 1, values);
        }
        if (fmi2GetReal(c, u, 1, &input) != fmi2OK || fmi2GetInteger(c, status, 1, &ended) != fmi2OK) {
            return 1;
        }
        printf("%.17g\n%d\n", input, ended);
        if ((k % 3) == 2) {
            if (fmi2DoStep(c, t, 0.25 * CTL_SAMPLE_TIME_S, 1) != fmi2OK ||
                fmi2GetReal(c, u, 1, &values[3]) != fmi2OK || values[3] < input ||
                values[3] > input ||
                fmi2DoStep(c, t + (0.25 * CTL_SAMPLE_TIME_S), 0.75 * CTL_SAMPLE_TIME_S, 1) != fmi2OK) {
                return 1;
            }
        } else if (fmi2DoStep(c, t, CTL_SAMPLE_TIME_S, 1) != fmi2OK) {
            return 1;
        }
    }
    fmi2FreeInstance(c);
    return 0;
}
"#;

/// An FMU has no clock, and says what bounds a step in place of the config's time.
#[test]
fn a_time_budget_is_replaced_by_a_count_which_is_reported() {
    let description = |budget_us: Option<f64>, version: FmiVersion| {
        let mut case = oscillator_case();
        case.config.max_iterations = 17;
        case.begin.budget_us = budget_us;
        let export = |controller: &Controller<'_>, name: &Name, origin: &Origin| {
            controller_to_fmu((controller, case.library(None)), name, origin, version)
        };
        let files = case.export_by(None, export).unwrap();
        assert_eq!(files[0].path, "modelDescription.xml");
        let bound = "#define CTL_MAX_ITERATIONS 17";
        assert!(files.iter().any(|f| String::from_utf8_lossy(&f.bytes).contains(bound)));
        String::from_utf8(files[0].bytes.clone()).unwrap()
    };
    for version in [FmiVersion::Two, FmiVersion::Three] {
        let said = description(Some(250.0), version);
        assert!(said.contains("at most 17 quadratic programs"), "{said}");
        assert!(said.contains("budget_us of 250.\""), "{said}");
        assert!(!description(None, version).contains("quadratic programs"));
    }
}

/// What `driver` prints about the sources of the controller's FMU.
pub(crate) fn driven(case: &Case, driver: &str) -> Vec<f64> {
    let export = |controller: &Controller<'_>, name: &Name, origin: &Origin| {
        controller_to_fmu((controller, case.library(None)), name, origin, FmiVersion::Two)
    };
    driven_files(case.export_by(None, export).unwrap(), "ctl_fmu.c", driver)
}

/// What `driver` prints, which includes one of the sources of an FMU.
pub(crate) fn driven_files(files: Vec<GeneratedFile>, included: &str, driver: &str) -> Vec<f64> {
    let flat = |file: GeneratedFile| GeneratedFile {
        path: file.path.trim_start_matches("sources/").to_owned(),
        ..file
    };
    let files: Vec<_> = files.into_iter().map(flat).collect();
    let options = ["-Wno-unused-parameter"];
    Sources::with_included(&files, included).drive(driver, &options, &[])
}

/// Increments so small that the input moves on at every sample, though nothing else does; from an
/// initial input on; with a measurement that is missing for two samples.
#[test]
fn a_controller_chooses_anew_at_every_sample() {
    let base = oscillator_case();
    let case = Case {
        problem: NmpcProblem {
            increment_bounds: Bounds::new(vec![-0.06], vec![0.05]),
            ..base.problem
        },
        begin: Begin { initial_input: Some(vec![0.7]), ..Begin::default() },
        ..oscillator_case()
    };
    let found = driven(&case, DRIVER);

    let mut nmpc = Nmpc::new(case.problem.clone(), case.model(), case.config).unwrap();
    nmpc.reset_input(&[0.7]).unwrap();
    let mut inputs = Vec::new();
    for (k, found) in found.chunks(2).enumerate() {
        let first = match k {
            0..=4 => 0.6,
            5 | 6 => f64::NAN,
            _ => -0.4,
        };
        let step = nmpc.step(&[first, -0.2], &[0.1, 0.0].repeat(5)).unwrap();
        assert_eq!(step.status == SqpStatus::BadArgument, (5..=6).contains(&k), "{k}");
        assert!((step.u[0] - found[0]).abs() < 1e-9, "{k}: {} {found:?}", step.u[0]);
        assert_eq!(found[1..], [number(step.status)], "{k}");
        inputs.push(found[0]);
    }
    assert_eq!(inputs.len(), 12);
    // It is the bound on increments that makes a sample differ from the one before.
    assert!((inputs[8] - inputs[7] + 0.06).abs() < 1e-8, "{inputs:?}");
}

/// Says of a step that passes a sample why it is not taken, and begins with the inputs it is given.
const START_DRIVER: &str = r#"
#include "ctl_fmu.c"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
static int told = 0;
static void said(fmi2ComponentEnvironment e, fmi2String i, fmi2Status s, fmi2String c, fmi2String m, ...)
{
    char text[256];
    va_list given;
    (void)e;
    (void)i;
    (void)c;
    va_start(given, m);
    vsnprintf(text, sizeof(text), m, given);
    va_end(given);
    if (strstr(text, "a start value") == 0) {
        printf("%d\n%d\n", (int)s, strstr(text, "samples are every 0.5 s") != 0);
    } else {
        told++;
    }
}
/* Whether a run begins with this input before it, with this upper bound of it. */
static int begins(const fmi2CallbackFunctions *callbacks, double input, double high)
{
    const fmi2ValueReference place[2] = {5, CTL_FIRST_BOUND + 5};
    const fmi2Real values[2] = {input, high};
    fmi2Component c = fmi2Instantiate("a", fmi2CoSimulation, CTL_GUID, "", callbacks, 0, 0);
    const int before = told;
    fmi2Status ended;
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2SetReal(c, place, 2, values);
    fmi2EnterInitializationMode(c);
    ended = fmi2ExitInitializationMode(c);
    fmi2FreeInstance(c);
    return (ended == fmi2OK) == (told == before) ? ended == fmi2OK : 9;
}
int main(void)
{
    fmi2CallbackFunctions callbacks = {said, calloc, free, 0, 0};
    const fmi2ValueReference u[1] = {0};
    const fmi2ValueReference set[5] = {1, 2, 3, 4, 5};
    const fmi2Real values[5] = {0.6, -0.2, 0.1, 0.0, -0.5};
    fmi2Real input;
    fmi2Component c = fmi2Instantiate("a", fmi2CoSimulation, CTL_GUID, "", &callbacks, 0, 0);
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2SetReal(c, set, 5, values);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    fmi2GetReal(c, u, 1, &input);
    printf("%.17g\n", input);
    printf("%d\n%d\n%d\n", begins(&callbacks, 0.9, 1.0), begins(&callbacks, 1.1, 1.0),
           begins(&callbacks, NAN, 1.0));
    printf("%d\n%d\n", begins(&callbacks, 1.1, 1.2), begins(&callbacks, 0.9, 0.8));
    return fmi2DoStep(c, 0.0, 0.7, 1) != fmi2Discard;
}
"#;

#[test]
fn the_inputs_before_the_first_sample_are_given_and_a_refused_step_is_logged() {
    let base = oscillator_case();
    let increment_bounds = Bounds::new(vec![-0.06], vec![0.05]);
    let case = Case {
        problem: NmpcProblem { increment_bounds, ..base.problem },
        begin: Begin { initial_input: Some(vec![0.7]), ..Begin::default() },
        ..oscillator_case()
    };
    let found = driven(&case, START_DRIVER);
    let mut nmpc = Nmpc::new(case.problem.clone(), case.model(), case.config).unwrap();
    nmpc.reset_input(&[-0.5]).unwrap();
    let expected = nmpc.step(&[0.6, -0.2], &[0.1, 0.0].repeat(5)).unwrap().u[0];
    assert!((found[0] - expected).abs() < 1e-9, "{found:?} {expected}");
    assert!((expected + 0.5).abs() < 0.061);
    // Within the bounds as they are set, or with an error that is logged.
    assert_eq!(found[1..6], [1.0, 0.0, 0.0, 1.0, 0.0]);
    // fmi2Discard, with the sentence.
    assert_eq!(found[6..], [2.0, 1.0]);
}

/// Variables of the plant that have names of the FMU's own are refused.
#[test]
fn two_variables_of_one_name_are_refused() {
    let case = oscillator_case();
    for (own, word) in [("status", "`status`,"), ("x1_q", " _q,"), ("x1_low", " _low and _high")] {
        let export = |controller: &Controller<'_>, name: &Name, origin: &Origin| {
            let mut origin = origin.clone();
            origin.states[0].name = own.into();
            controller_to_fmu((controller, case.library(None)), name, &origin, FmiVersion::Three)
        };
        let refused = case.export_by(None, export).unwrap_err().to_string();
        let [named, reason] = [format!("named `{own}`: "), word.to_owned()];
        assert!(refused.contains(&named) && refused.contains(&reason), "{refused}");
    }
}
