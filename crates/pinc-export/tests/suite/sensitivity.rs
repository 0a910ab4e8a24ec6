//! Derivatives of the input in C against the library's.

use super::compile::READ;
use super::controller::{Case, Draws, oscillator_case, tanks_case};
use super::variants::{in_odd_units, tracking};
use pinc_mpc::{Bounds, SqpStatus, Tracked, Weights};
use pinc_sensitivity::{Given, Regularity, Sensitivity};

/// Reads per step: state, the input before, and reference. Writes the status, the regularity, the
/// derivatives, and whether the next step is the one that a controller takes that was not asked for them.
const DRIVER: &str = r#"
#include "ctl_mpc.h"
#include <stdio.h>
static ctl_mpc m;
static ctl_mpc twin;
static ctl_sensitivity s;
@READ@
static void write(const CTL_REAL *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        printf("%.17g\n", (double)from[i]);
    }
}
int main(void)
{
    CTL_REAL applied[CTL_NU], x[CTL_NX], reference[CTL_N2 * CTL_NY], u[CTL_NU], v[CTL_NU];
    ctl_mpc_init(&m);
    m.budget_us = 1;
    while (read(x, CTL_NX) && read(applied, CTL_NU) && read(reference, CTL_N2 * CTL_NY)) {
        ctl_status status;
        int same = 1, i;
        ctl_mpc_reset_to(&m, x, applied);
        status = ctl_mpc_step(&m, x, reference, u);
        twin = m;
        printf("%d\n", (int)status);
        printf("%d\n", (int)ctl_mpc_sensitivity(&m, reference, applied, &s));
        write(s.by_state, CTL_NU * CTL_NX);
        write(s.by_applied, CTL_NU * CTL_NU);
        write(s.by_reference, CTL_NU * CTL_N2 * CTL_NY);
        same &= m.kkt <= twin.kkt && m.kkt >= twin.kkt && m.budget_us == 1;
        (void)ctl_mpc_step(&m, x, reference, u);
        (void)ctl_mpc_step(&twin, x, reference, v);
        for (i = 0; i < CTL_NU; i++) {
            same &= u[i] <= v[i] && u[i] >= v[i];
        }
        printf("%d\n", same);
    }
    return 0;
}
"#;

/// Compares `points` random steps; gives how many derivatives were those of regular plans.
#[track_caller]
fn compare(case: &Case, points: usize, seed: u64, more: &[&str]) -> usize {
    let mut nmpc = case.library(None);
    let mut draws = Draws(seed);
    let (mut lines, mut expected) = (Vec::new(), Vec::new());
    let bounds = &case.problem.input_bounds;
    for _ in 0..points {
        let mut draw = |low: &[f64], high: &[f64]| -> Vec<f64> {
            low.iter().zip(high).map(|(low, high)| draws.between(*low, *high)).collect()
        };
        let x = draw(&case.low, &case.high);
        let applied = draw(&bounds.low, &bounds.high);
        // A reference of its own for each stage.
        let horizon = 0..case.problem.horizon;
        let reference: Vec<f64> =
            horizon.flat_map(|_| case.tracked_at(&draw(&case.low, &case.high))).collect();
        lines.extend([&x[..], &applied, &reference].concat());
        nmpc.reset_to(&x, &applied).unwrap();
        let status = nmpc.step(&x, &reference).unwrap().status;
        let mut sensitivity = Sensitivity::new(&mut nmpc, &reference, &applied, None).unwrap();
        let units: Vec<Vec<f64>> = (0..applied.len())
            .map(|k| (0..=k).map(|i| if i == k { 1.0 } else { 0.0 }).collect())
            .collect();
        let gradients = units.iter().map(|unit| sensitivity.adjoint(&[], unit).unwrap());
        let gradients: Vec<_> = gradients.collect();
        let of = |kind: Given| gradients.iter().flat_map(move |of| of.get(kind).to_vec());
        let all: Vec<f64> =
            of(Given::State).chain(of(Given::AppliedInput)).chain(of(Given::Reference)).collect();
        expected.push((status, sensitivity.regularity(), all));
    }
    let found = case.sources().drive(&DRIVER.replace("@READ@", READ), more, &lines);
    let in_float = more.iter().any(|option| option.ends_with("float"));
    // All derivatives are 0 where the input is at a bound.
    let smallest = case.high.iter().fold(f64::INFINITY, |least, v| least.min(*v));
    let rounding = if in_float { 1e-2 } else { 1e-6 };
    let least = rounding * bounds.high[0] / smallest;
    let mut regular = 0;
    for (found, (status, regularity, wanted)) in
        found.chunks_exact(3 + expected[0].2.len()).zip(&expected)
    {
        let [of_status, of_plan, derivatives @ .., same] = found else { unreachable!() };
        assert!(same.total_cmp(&1.0).is_eq(), "{found:?}");
        let name = ["regular", "kink", "singular", "not-optimal"].map(str::to_owned);
        let place = name.iter().position(|name| *name == regularity.to_string()).unwrap();
        if *status != SqpStatus::Converged || *of_status > 0.0 || *regularity != Regularity::Regular
        {
            assert!(*of_plan > 0.0 || *regularity == Regularity::Regular || in_float, "{found:?}");
            continue;
        }
        if in_float && *of_plan > 0.0 {
            continue;
        }
        let expected_place = f64::from(u32::try_from(place).unwrap());
        assert!(of_plan.total_cmp(&expected_place).is_eq(), "{regularity} {found:?}");
        let size = wanted.iter().fold(least, |size, v| size.max(v.abs()));
        let allowed = if in_float { 5e-2 } else { 1e-6 };
        for (found, wanted) in derivatives.iter().zip(wanted) {
            let off = (found - wanted).abs() / (size + wanted.abs());
            assert!(off < allowed, "{found} {wanted} {size} {off:e}");
        }
        regular += 1;
    }
    regular
}

/// The derivatives in state, applied input and reference, with rows of all kinds active.
#[test]
fn derivatives_are_the_librarys() {
    const OPTION: &str = "-DCTL_SENSITIVITY";
    let delayed = || {
        let mut case = oscillator_case();
        (case.problem.delay, case.problem.control_horizon) = (1, 3);
        case.problem.increment_bounds = Bounds::new(vec![-0.3], vec![0.3]);
        case.problem.weights = case.problem.weights.clone().with_terminal(vec![40.0, 70.0]);
        case
    };
    let unbounded = || {
        let mut case = tanks_case();
        case.problem.state_bounds = Bounds::none(4);
        case.problem.weights = Weights::uniform(vec![3.0, 10.0], vec![1.0, 2.0]);
        case
    };
    // Where the input is held, the force is the same before and after a control step.
    let held = || {
        let mut case = tracking();
        case.problem.control_horizon = 2;
        case.problem.tracked = vec![Tracked::Output(1), Tracked::State(1)];
        case.problem.output_bounds = Some(Bounds::new(vec![-9.0, -0.4, -9.0], vec![9.0, 0.4, 9.0]));
        case
    };
    for (i, (case, points)) in [
        (oscillator_case(), 400),
        (held(), 400),
        (unbounded(), 40),
        (delayed(), 400),
        (in_odd_units(), 400),
        (tracking(), 400),
    ]
    .iter()
    .enumerate()
    {
        let regular = compare(case, *points, 50 + i as u64, &[OPTION]);
        assert!(10 * regular > *points, "case {i}: {regular} of {points}");
    }
    let regular = compare(&oscillator_case(), 200, 60, &[OPTION, "-DCTL_REAL=float"]);
    assert!(regular > 20, "{regular}");
}
