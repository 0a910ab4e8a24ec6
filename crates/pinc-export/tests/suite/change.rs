//! Weights and bounds that a running controller in C is given, against a library that has them from
//! the start.

use super::controller::{Case, DRIVER, compare_with, oscillator_case, tanks_case};
use super::fmu::driven;
use super::start::number;
use super::variants::tracking;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpStatus, Weights};

/// A list of numbers in C.
fn numbers(values: &[f64]) -> String {
    let list: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
    format!("{{{}}}", list.join(", ").replace("inf", "INFINITY"))
}

/// Compares the C of `given`, told the diagonals q and r and the bounds of `wanted`, with `wanted`.
#[track_caller]
fn compare_changed(given: &Case, wanted: &Case, [q, r]: [&[f64]; 2], seed: u64) {
    let Bounds { low, high } = &wanted.problem.state_bounds;
    let sides = &wanted.problem.input_bounds;
    let all = [q, r, low, high, &sides.low, &sides.high].map(numbers);
    let names = ["q", "r", "x_low", "x_high", "u_low", "u_high"];
    let declared: String = names
        .iter()
        .zip(all)
        .map(|(name, of)| format!("    const CTL_REAL {name}[] = {of};\n"))
        .collect();
    let init = "    ctl_mpc_init(&m);\n";
    let change = format!(
        "{init}    if (ctl_mpc_set_weights(&m, q, r) != CTL_CONVERGED ||\n        \
         ctl_mpc_set_bounds(&m, x_low, x_high, u_low, u_high) != CTL_CONVERGED) {{\n        \
         return 1;\n    }}\n"
    );
    let driver = DRIVER.replace(init, &format!("{declared}{change}"));
    let driver = driver.replace("#include <stdio.h>", "#include <math.h>\n#include <stdio.h>");
    assert!(driver.contains("x_low["));
    let seen = compare_with((&given.sources(), &driver), wanted, 250, seed, |_, _| [0.0; 2]);
    // Where bounds are met, most references of some cases are beyond them.
    assert!(seen[0] > 10, "{seen:?}");
}

#[test]
fn a_changed_controller_takes_the_steps_of_one_that_was_made_so() {
    let (given, base) = (oscillator_case(), oscillator_case());
    let [q, r] = [[3.0, 0.5], [0.2, 0.0]].map(|of| of.to_vec());
    let wanted = Case {
        problem: NmpcProblem {
            state_bounds: Bounds::new(vec![-0.7, f64::NEG_INFINITY], vec![0.8, 0.9]),
            input_bounds: Bounds::new(vec![-0.6], vec![0.9]),
            weights: Weights::uniform(q.clone(), vec![r[0]]),
            ..base.problem
        },
        ..base
    };
    compare_changed(&given, &wanted, [&q, &r[..1]], 31);
}

#[test]
fn a_part_of_the_states_and_outputs_are_weighted_anew() {
    let (given, base) = (tanks_case(), tanks_case());
    let [q, r] = [[4.0, 7.0], [0.5, 2.0]].map(|of| of.to_vec());
    let weights = Weights::uniform(q.clone(), r.clone());
    let wanted = Case { problem: NmpcProblem { weights, ..base.problem }, ..base };
    compare_changed(&given, &wanted, [&q, &r], 32);

    let (given, base) = (tracking(), tracking());
    let q: Vec<f64> = (0..base.problem.tracked.len())
        .map(|i| 2.0 + f64::from(u8::try_from(i).unwrap()))
        .collect();
    let r = vec![0.7; base.problem.input_bounds.low.len()];
    let weights = Weights::uniform(q.clone(), r.clone());
    let wanted = Case { problem: NmpcProblem { weights, ..base.problem }, ..base };
    compare_changed(&given, &wanted, [&q, &r], 33);
}

/// Weights and bounds that make no sense, or for which the program has no rows; steps that are missed
/// in a row.
const REFUSED: &str = r#"
#include "ctl_mpc.h"
#include <math.h>
#include <stdio.h>
static ctl_mpc m;
int main(void)
{
    const CTL_REAL good[2] = {1, 1}, bad[2] = {1, -1}, none[2] = {(CTL_REAL)NAN, 1};
    const CTL_REAL low[2] = {-1, -INFINITY}, high[2] = {1, INFINITY}, one[2] = {1, 1};
    const CTL_REAL minus[2] = {-1, -1};
    CTL_REAL x[2] = {0, 0}, reference[CTL_N2 * CTL_NY] = {0}, u[CTL_NU];
    int k;
    printf("%d %d\n", (int)ctl_mpc_set_weights(&m, good, good),
           (int)ctl_mpc_set_bounds(&m, low, high, minus, one));
    ctl_mpc_init(&m);
    printf("%d %d %d\n", (int)ctl_mpc_set_weights(&m, bad, good),
           (int)ctl_mpc_set_weights(&m, good, none), (int)ctl_mpc_set_weights(&m, good, good));
    printf("%d %d %d %d\n", (int)ctl_mpc_set_bounds(&m, minus, one, minus, one),
           (int)ctl_mpc_set_bounds(&m, low, high, one, minus),
           (int)ctl_mpc_set_bounds(&m, none, high, minus, one),
           (int)ctl_mpc_set_bounds(&m, low, high, minus, one));
    for (k = 0; k < 4; k++) {
        x[0] = (k == 1 || k == 2) ? (CTL_REAL)NAN : (CTL_REAL)0.1;
        (void)ctl_mpc_step(&m, x, reference, u);
        printf("%u\n", m.missed);
    }
    return 0;
}
"#;

#[test]
fn what_cannot_be_changed_is_refused_and_missed_steps_are_counted() {
    let mut case = oscillator_case();
    let infinity = f64::INFINITY;
    case.problem.state_bounds = Bounds::new(vec![-1.0, -infinity], vec![1.0, infinity]);
    let found = case.sources().drive(REFUSED, &[], &[]);
    let expected = [7, 7, 6, 6, 0, 6, 6, 6, 0, 0, 1, 2, 0].map(f64::from);
    assert_eq!(found.len(), expected.len());
    assert!(found.iter().zip(expected).all(|(a, b)| a.total_cmp(&b).is_eq()), "{found:?}");
    let header = |case: &Case| {
        let files = case.export(None).unwrap();
        let header = files.into_iter().find(|file| file.path == "ctl_mpc.h").unwrap();
        String::from_utf8(header.bytes).unwrap()
    };
    assert!(header(&case).contains("no rows: x1"));
    assert!(!header(&oscillator_case()).contains("no rows"));
}

/// An FMU at one state, with another weight and another bound from the first sample on, and at the
/// sixth with a bound that is refused.
const TUNED: &str = r#"
#include "ctl_fmu.c"
#include <stdio.h>
#include <stdlib.h>
int main(void)
{
    fmi2CallbackFunctions callbacks = {0, calloc, free, 0, 0};
    const fmi2ValueReference set[6] = {1, 2, 3, 4, 6, 14}, u[1] = {0}, status[1] = {0};
    fmi2Real values[6] = {0.6, -0.2, 0.9, 0.0, 3.0, 0.3};
    fmi2Real input;
    fmi2Integer ended;
    int k;
    fmi2Component c = fmi2Instantiate("a", fmi2CoSimulation, CTL_GUID, "", &callbacks, 0, 0);
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    for (k = 0; k < 6; k++) {
        values[5] = (k < 5) ? 0.3 : -2.0;
        fmi2SetReal(c, set, 6, values);
        if (fmi2GetReal(c, u, 1, &input) != fmi2OK || fmi2GetInteger(c, status, 1, &ended) != fmi2OK ||
            fmi2DoStep(c, CTL_SAMPLE_TIME_S * (double)k, CTL_SAMPLE_TIME_S, 1) != fmi2OK) {
            return 1;
        }
        printf("%.17g\n%d\n", input, ended);
    }
    fmi2FreeInstance(c);
    return 0;
}
"#;

#[test]
fn parameters_of_an_fmu_act_at_the_next_sample() {
    let base = oscillator_case();
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-1.0], vec![0.3]),
        weights: Weights::uniform(vec![3.0, 10.0], vec![1.0]),
        ..base.problem.clone()
    };
    let mut nmpc = Nmpc::new(problem, base.model(), base.config).unwrap();
    let reference = [0.9, 0.0].repeat(base.problem.horizon);
    let found = driven(&base, TUNED);
    assert_eq!(found.len(), 12);
    let mut limited = 0;
    for (k, found) in found.chunks(2).enumerate() {
        let step = nmpc.step(&[0.6, -0.2], &reference).unwrap();
        limited += u32::from(step.u[0] > 0.3 - 1e-9);
        assert!((found[0] - step.u[0]).abs() < 1e-8, "sample {k}: {found:?} {:?}", step.u);
        let status = if k < 5 { step.status } else { SqpStatus::BadArgument };
        assert!(found[1].total_cmp(&number(status)).is_eq(), "sample {k}: {found:?}");
    }
    assert!(limited > 0);
}
