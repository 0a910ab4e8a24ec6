//! Controllers in C against the library: their first input, their references over time, and their
//! answers to missing values.

use super::compile::{READ, Sources};
use super::controller::{Begin, Case, oscillator_case};
use super::variants::in_odd_units;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpStatus, StepReport};

/// Two changes, the first within the horizon of the first step.
fn schedule(scale: [f64; 2]) -> Reference {
    let row = |step: usize| match step {
        0..=3 => [0.2, 0.0],
        4..=8 => [0.5, 0.1],
        _ => [-0.3, 0.05],
    };
    let rows = (0..20).flat_map(|k| [row(k)[0] * scale[0], row(k)[1] * scale[1]]);
    Reference::new(rows.collect(), 2).unwrap()
}

/// The oscillator with increments of 0.1 at most, at a plant that has been given 0.45.
fn begun(delay: usize, without_preview: bool) -> Case {
    let base = oscillator_case();
    Case {
        problem: NmpcProblem {
            increment_bounds: Bounds::new(vec![-0.1], vec![0.1]),
            delay,
            ..base.problem
        },
        begin: Begin {
            initial_input: Some(vec![0.45]),
            reference: Some(schedule([1.0; 2])),
            without_preview,
            budget_us: None,
        },
        ..oscillator_case()
    }
}

/// Begins at a state, with a struct of garbage; then reads a state per step, takes the reference by
/// time, and writes status, input, and that step's reference.
const DRIVER: &str = r#"
#include "ctl_mpc.h"
#include <stdio.h>
#include <string.h>
static ctl_mpc m;
@READ@
int main(void)
{
    CTL_REAL x[CTL_NX], rows[CTL_N2 * CTL_NY], u[CTL_NU];
    int k;
    int i;
    memset(&m, 0xA5, sizeof(m));
    ctl_reference(0.0, rows);
    memset(x, 0, sizeof(x));
    printf("%d\n", (int)ctl_mpc_step(&m, x, rows, u));
    printf("%.17g\n", (double)u[0]);
    ctl_mpc_@INIT@(&m);
    for (k = 0; read(x, CTL_NX); k++) {
        ctl_reference(CTL_SAMPLE_TIME_S * (double)k, rows);
        printf("%d\n", (int)ctl_mpc_step(&m, x, rows, u));
        for (i = 0; i < CTL_NU; i++) {
            printf("%.17g\n", (double)u[i]);
        }
        for (i = 0; i < CTL_N2 * CTL_NY; i++) {
            printf("%.17g\n", (double)rows[i]);
        }
    }
    return 0;
}
"#;

fn nmpc(case: &Case) -> Nmpc {
    let mut nmpc = Nmpc::new(case.problem.clone(), case.model(), case.config).unwrap();
    if let Some(u) = &case.begin.initial_input {
        nmpc.reset_input(u).unwrap();
    }
    nmpc
}

/// The number of a status in C.
pub(crate) fn number(status: SqpStatus) -> f64 {
    let of = [
        SqpStatus::Converged,
        SqpStatus::IterationLimit,
        SqpStatus::Deadline,
        SqpStatus::InfeasibleQp,
        SqpStatus::Stalled,
        SqpStatus::NumericalTrouble,
        SqpStatus::BadArgument,
    ];
    let place = of.iter().position(|known| *known == status).unwrap();
    f64::from(u8::try_from(place).unwrap())
}

/// The rows of step `k`, written out: row j ends with the step that begins j steps later.
fn rows(case: &Case, k: usize) -> Vec<f64> {
    let reference = case.begin.reference.as_ref().unwrap();
    let later = |j: usize| if case.begin.without_preview { 0 } else { case.problem.delay + j };
    (0..case.problem.horizon).flat_map(|j| reference.at(k + later(j)).to_vec()).collect()
}

/// Compares 16 steps, of which those in `missing` have a state without its last number.
fn compare(case: &Case, init: &str, missing: &[usize]) -> Vec<f64> {
    let mut nmpc = nmpc(case);
    let (mut model, horizon) = (case.model(), case.problem.horizon);
    let mut x: Vec<f64> = case.low.iter().map(|low| -0.3 * low).collect();
    let (mut lines, mut expected, mut next) = (Vec::new(), Vec::new(), vec![0.0; 2]);
    for k in 0..16 {
        let mut seen = x.clone();
        if missing.contains(&k) {
            seen[1] = f64::NAN;
        }
        let window = rows(case, k);
        let StepReport { u, status, .. } = nmpc.step(&seen, &window).unwrap();
        lines.extend(&seen);
        expected.push([&[number(status), u[0]][..], &window].concat());
        model.step(&x, u, &[], &mut next);
        x.copy_from_slice(&next);
    }
    let driver = DRIVER.replace("@READ@", READ).replace("@INIT@", init);
    let found = case.sources().drive(&driver, &[], &lines);
    let (garbage, found) = found.split_at(2);
    assert!((garbage[0] - 7.0).abs() < 0.5, "{garbage:?}");
    assert_eq!(found.len(), 16 * (2 + 2 * horizon));
    let size = case.problem.input_bounds.high[0];
    for (k, (found, expected)) in found.chunks(2 + 2 * horizon).zip(&expected).enumerate() {
        assert!((found[1] - expected[1]).abs() < 1e-9 * size, "step {k}: {found:?} {expected:?}");
        let exact = |found: &[f64], expected: &[f64]| {
            found.iter().zip(expected).all(|(a, b)| a.total_cmp(b).is_eq())
        };
        assert!(exact(&found[..1], &expected[..1]), "step {k}: {found:?} {expected:?}");
        assert!(exact(&found[2..], &expected[2..]), "step {k}: {found:?} {expected:?}");
    }
    [garbage[1], found[1]].to_vec()
}

/// The first increment counts from the initial input, also after a reset; the references by time
/// are the closed loop's.
#[test]
fn a_controller_begins_with_the_configs_input() {
    for (delay, without_preview, init) in
        [(0, false, "init"), (2, false, "reset"), (1, true, "init")]
    {
        let [garbage, first] = compare(&begun(delay, without_preview), init, &[])[..] else {
            unreachable!("two numbers")
        };
        assert!(
            (garbage - 0.45).abs() < 1e-15 && (first - 0.45).abs() < 0.1 + 1e-8,
            "{garbage} {first}"
        );
        assert!(begun(delay, without_preview).sources().selftest("ctl", &[]).contains("20 steps"));
    }
    // Numbers of other sizes.
    let mut case = in_odd_units();
    let (x1, x2) = (8192.0, 1.0 / 4096.0);
    case.problem.increment_bounds = Bounds::new(vec![-0.1 * x1], vec![0.1 * x1]);
    case.begin = begun(0, false).begin;
    case.begin.reference = Some(schedule([x1, x2]));
    // The second is out of bounds.
    for (input, begin, change) in [(0.45, 0.45, 0.1), (2.0, 1.0, 0.0)] {
        case.begin.initial_input = Some(vec![input * x1]);
        let [garbage, first] = compare(&case, "init", &[4])[..] else {
            unreachable!("two numbers")
        };
        assert!((garbage - begin * x1).abs() < 1e-9, "{garbage}");
        assert!((first - begin * x1).abs() < change * x1 + 1e-9, "{first}");
    }
    assert!(case.sources().selftest("ctl", &[]).contains("20 steps"));
}

/// Without a state the last input is held, which is under way as any other.
#[test]
fn a_missing_measurement_holds_the_input() {
    for delay in [0, 2] {
        let mut case = begun(delay, false);
        // Inputs that differ from step to step, and are on no bound.
        case.problem.input_bounds = Bounds::new(vec![-50.0], vec![50.0]);
        case.problem.increment_bounds = Bounds::none(1);
        case.problem.state_bounds = Bounds::none(2);
        let [_, first] = compare(&case, "init", &[0, 2, 6])[..] else {
            unreachable!("two numbers")
        };
        assert!((first - 0.45).abs() < 1e-15, "{first}");
    }
}

/// A clock that counts how often it is read, about to begin anew; the same by a count; and a bound
/// on quadratic programs.
const CLOCKS: &str = r#"
#include "ctl_mpc.h"
#include <limits.h>
#include <stdio.h>
static unsigned long ticks = ULONG_MAX - 5UL;
static unsigned long clock_us(void)
{
    return ticks++;
}
static ctl_mpc timed;
static ctl_mpc counted;
static ctl_mpc bounded;
int main(void)
{
    CTL_REAL rows[CTL_N2 * CTL_NY], u[CTL_NU], v[CTL_NU], w[CTL_NU];
    int k;
    ctl_mpc_init(&timed);
    ctl_mpc_init(&counted);
    ctl_mpc_init(&bounded);
    printf("%lu\n%lu\n", timed.budget_us, (unsigned long)CTL_BUDGET_US);
    timed.clock_us = clock_us;
    counted.budget = 2;
    bounded.max_iterations = 1;
    ctl_mpc_reset(&timed);
    for (k = 0; k < 10; k++) {
        CTL_REAL x[CTL_NX] = {0.9, -0.8};
        int status;
        x[0] -= 0.1 * (double)k;
        ctl_reference(0.0, rows);
        status = (int)ctl_mpc_step(&timed, x, rows, u);
        printf("%d\n%d\n", status, (int)ctl_mpc_step(&counted, x, rows, v));
        printf("%.17g\n%.17g\n", (double)u[0], (double)v[0]);
        printf("%d\n", (int)ctl_mpc_step(&bounded, x, rows, w));
        printf("%d\n", bounded.iterations);
        ctl_mpc_reset(&bounded);
    }
    return 0;
}
"#;

#[test]
fn a_clock_ends_a_step_where_a_count_does() {
    let mut case = oscillator_case();
    case.begin.budget_us = Some(2.5);
    let found = case.sources().drive(CLOCKS, &[], &[]);
    assert_eq!(found[..2], [3.0, 3.0]);
    let mut late = 0;
    for step in found[2..].chunks(6) {
        assert_eq!(step[..1], step[1..2]);
        assert_eq!(step[2..3], step[3..4]);
        late += usize::from(step[..1] == [2.0]);
        // It solves one program, which is not enough from a cold start.
        assert_eq!(step[4..], [1.0, 1.0]);
    }
    assert!(late > 3, "{late}");
    case.begin.budget_us = None;
    assert_eq!(case.sources().drive(CLOCKS, &[], &[])[..2], [0.0; 2]);
}

/// All names are the library's, in the order of the numbers.
#[test]
fn statuses_have_the_librarys_names() {
    let driver = r#"
#include "ctl_mpc.h"
#include <string.h>
#include <stdio.h>
int main(void)
{
    static const char *const names[] = {@NAMES@};
    const ctl_status numbers[] = {@NUMBERS@};
    int i;
    for (i = 0; i < 8; i++) {
        printf("%d\n%d\n", (int)numbers[i], strcmp(names[i], ctl_status_name(numbers[i])));
    }
    return 0;
}
"#;
    let names = [
        SqpStatus::Converged,
        SqpStatus::IterationLimit,
        SqpStatus::Deadline,
        SqpStatus::InfeasibleQp,
        SqpStatus::Stalled,
        SqpStatus::NumericalTrouble,
        SqpStatus::BadArgument,
    ]
    .map(|status| status.to_string());
    // The library has no controllers that are not set up.
    let names: Vec<String> = names.into_iter().chain(["not-initialized".to_owned()]).collect();
    let constants =
        names.iter().map(|name| format!("CTL_{}", name.to_uppercase().replace('-', "_")));
    let driver = driver
        .replace("@NAMES@", &names.iter().map(|name| format!("{name:?}, ")).collect::<String>())
        .replace("@NUMBERS@", &constants.collect::<Vec<_>>().join(", "));
    let sources: Sources = oscillator_case().sources();
    let found = sources.drive(&driver, &[], &[]);
    let expected: Vec<f64> = (0..8_u8).flat_map(|i| [f64::from(i), 0.0]).collect();
    assert_eq!(found, expected);
}

/// Steps a controller, copies it, steps on, and steps the copy, put into another struct, likewise.
const COPIES: &str = r#"
#include "ctl_mpc.h"
#include <stdio.h>
static ctl_mpc first;
static ctl_mpc second;
static void steps(ctl_mpc *m, int begin, int end)
{
    CTL_REAL rows[CTL_N2 * CTL_NY], u[CTL_NU];
    int k;
    for (k = begin; k < end; k++) {
        const CTL_REAL x[CTL_NX] = {CTL_N(0.4) - (CTL_N(0.05) * (CTL_REAL)k), CTL_N(0.1)};
        ctl_reference(CTL_SAMPLE_TIME_S * (double)k, rows);
        (void)ctl_mpc_step(m, x, rows, u);
        printf("%.17g\n", (double)u[0]);
    }
}
int main(void)
{
    ctl_mpc_init(&first);
    ctl_mpc_init(&second);
    steps(&first, 0, 5);
    steps(&second, 7, 9);
    second = first;
    steps(&first, 5, 9);
    steps(&second, 5, 9);
    return 0;
}
"#;

#[test]
fn a_copy_of_the_struct_continues_without_a_bump() {
    for delay in [0, 2] {
        let files = begun(delay, false).export(None).unwrap();
        let found = Sources::new(&files).drive(COPIES, &[], &[]);
        let bits: Vec<u64> = found.iter().map(|u| u.to_bits()).collect();
        assert_eq!(bits[7..11], bits[11..15]);
        assert_ne!(bits[7..9], bits[5..7]);
    }
}
