use super::*;
use serde_json::json;
use std::collections::BTreeMap;

fn metrics(control: Vec<ControlMetrics>) -> Metrics {
    let text = r#"{ "experiment": "e", "preset": "ours", "variables": {} }"#;
    Metrics { control, ..serde_json::from_str(text).unwrap() }
}

fn of(
    model: ModelKind,
    offsets: [Option<f64>; 3],
    status: &[(SqpStatus, usize)],
) -> ControlMetrics {
    let steps = |(status, steps): &(SqpStatus, usize)| (status.to_string(), *steps);
    let status: BTreeMap<_, _> = status.iter().map(steps).collect();
    let loops = json!({
        "model": model, "wall_s": { "mean": 1.0, "sd": 0.0, "median": 1.0, "runs": 1 },
        "step_us": { "p50": 1.0, "p99": 1.0, "max": 1.0 }, "sqp_iterations_mean": 1.0,
        "rmse": 0.0, "iae": 0.0, "rmse_dense": 0.0, "iae_dense_sum": 0.0, "kkt_max": 0.0,
        "max_violation": 0.0, "status": status, "reference_start_s": [0.0, 10.0, 20.0],
        "offset": { "level": offsets }, "settle_s": [null, null, null],
        "settled_within": { "level": 0.1 }
    });
    serde_json::from_value(loops).unwrap()
}

#[test]
fn a_reference_that_one_model_misses_is_told_from_one_that_all_miss() {
    let fine = [(SqpStatus::Converged, 30)];
    let net = of(ModelKind::Pinc, [Some(0.05), Some(0.3), Some(0.2)], &fine);
    let rk4 = of(ModelKind::RK4, [Some(0.05), Some(0.02), Some(0.2)], &fine);
    let [first, second] = &metrics(vec![net, rk4]).loop_notes()[..] else { panic!("two notes") };
    let said = "2 of its 3 references: it ends 0.300 off on average with the one from 10 s. \
                With RK4 it does,";
    assert!(first.contains(said), "{first}");
    assert!(second.contains("1 of its 3 references") && second.contains("pinc check"));
}

/// A loop may settle just before the next reference, or just not.
#[test]
fn a_model_is_blamed_for_a_clearly_larger_offset_only() {
    let fine = [(SqpStatus::Converged, 30)];
    let missed = |model, offset| of(model, [Some(0.05), Some(offset), None], &fine);
    let reached = |model, offset| {
        let mut reached = missed(model, offset);
        reached.references.settle_s[1] = Some(9.0);
        reached
    };
    let (net, rk4, policy) = (ModelKind::Pinc, ModelKind::RK4, ModelKind::Policy);
    let blamed = "is not accurate enough";
    for (worse, offset, better, said) in [
        (net, 0.3, rk4, blamed),
        (net, 0.12, rk4, "pinc check"),
        // An integrator has the plant's own equations.
        (rk4, 0.3, net, "pinc check"),
        (rk4, 0.3, policy, "pinc check"),
        (policy, 0.3, rk4, "does not know later references"),
    ] {
        let notes = metrics(vec![missed(worse, offset), reached(better, 0.11)]).loop_notes();
        let [note] = &notes[..] else { panic!("{notes:?}") };
        assert!(note.contains(said), "{worse:?} {offset}: {note}");
        assert_eq!(note.contains(blamed), said == blamed, "{note}");
    }
}

/// An offset over few steps has a part of the way to the reference in it.
#[test]
fn a_segment_that_settled_is_no_finding() {
    let mut short = of(ModelKind::RK4, [None, None, Some(0.3)], &[(SqpStatus::Converged, 30)]);
    assert_eq!(metrics(vec![short.clone()]).loop_notes().len(), 1);
    short.references.settle_s[2] = Some(3.0);
    assert_eq!(metrics(vec![short]).loop_notes(), [""; 0]);
}

#[test]
fn advice_is_given_once_where_it_is_the_same() {
    let fine = [(SqpStatus::Converged, 30)];
    let missed = |model| of(model, [Some(0.05), Some(0.02), Some(0.2)], &fine);
    let all = metrics(vec![missed(ModelKind::Pinc), missed(ModelKind::RK4)]);
    let [first, second] = &all.loop_notes()[..] else { panic!("two notes") };
    assert!(first.starts_with("With PINC ") && !first.contains("pinc check"), "{first}");
    assert!(second.starts_with("With RK4 ") && second.contains("pinc check"), "{second}");
}

/// A simulator has no substeps, and the equation's kinks are not known.
#[test]
fn advice_is_about_the_model_at_hand() {
    for (status, model, said, other) in [
        (SqpStatus::Stalled, ModelKind::BlackBox, "difference_step", "substeps"),
        (SqpStatus::IterationLimit, ModelKind::BlackBox, "difference_step", "max_iterations"),
        (SqpStatus::Stalled, ModelKind::RK4, "substeps", "difference_step"),
    ] {
        let notes = metrics(vec![of(model, [None; 3], &[(status, 30)])]).loop_notes();
        assert!(notes[0].contains(said) && !notes[0].contains(other), "{notes:?}");
    }
}

/// There may be a plan with whole inputs that the search did not come to.
#[test]
fn advice_for_infeasible_steps_names_the_programs_for_whole_inputs() {
    let infeasible = of(ModelKind::RK4, [None; 3], &[(SqpStatus::InfeasibleQp, 30)]);
    let notes = metrics(vec![infeasible]).loop_notes();
    assert!(notes[0].contains("No plan was found"), "{notes:?}");
    assert!(notes[0].contains("control.integer_programs for whole inputs"), "{notes:?}");
}

/// A mole fraction that is 0.00052 off is not "0.000 off".
#[test]
fn offsets_have_three_significant_digits() {
    for (offset, shown) in [
        (0.000_521_4, "5.21e-4"),
        (0.005_214, "0.00521"),
        (0.0476, "0.0476"),
        (0.3, "0.300"),
        (2.345, "2.35"),
        (12.34, "12.3"),
        (512.4, "512"),
    ] {
        assert_eq!(significant(offset), shown);
    }
    let mut tight = of(ModelKind::RK4, [None, None, Some(0.000_521_4)], &[]);
    tight.references.settled_within.insert("level".to_owned(), 1e-4);
    let notes = metrics(vec![tight]).loop_notes();
    assert!(notes[0].contains("it ends 5.21e-4 off on average"), "{notes:?}");
}

/// What was broken, by how much, in which unit and when, and what to do about it.
#[test]
fn a_broken_hard_bound_is_named_with_its_unit_and_time() {
    let broken = |amount: f64, at_steps: f64, hard: bool| ViolationMetrics {
        of: "V".to_owned(),
        unit: "V".to_owned(),
        side: "high".to_owned(),
        bound: 3.96,
        hard,
        amount,
        time_s: 12.5,
        at_steps,
        share: amount / 4.0,
        from_step: 1,
    };
    let notes = |violations: &[ViolationMetrics]| {
        let mut all = of(ModelKind::RK4, [None; 3], &[(SqpStatus::Converged, 30)]);
        all.violations = violations.to_vec();
        metrics(vec![all]).loop_notes()
    };
    let between = notes(&[broken(0.046, 1e-9, true)]);
    assert_eq!(
        between,
        ["With RK4 V broke a hard bound between control steps: it was 0.0460 V above 3.96 V at \
          12.5 s. The controller keeps bounds at the ends of its steps only: shorten T, or \
          tighten the bound by as much."]
    );
    // What the optimizer's tolerance leaves at the ends, 1e-4 of the quantity, is between them.
    for (at_steps, said) in [(3.9e-4, "between control steps"), (4.1e-4, "at control steps")] {
        let note = &notes(&[broken(0.046, at_steps, true)])[0];
        assert!(note.contains(said), "{at_steps}: {note}");
    }
    let at_steps =
        notes(&[ViolationMetrics { side: "low".to_owned(), ..broken(0.046, 0.04, true) }]);
    let said = "at control steps, by up to 0.0400 V there: it was 0.0460 V below";
    assert!(at_steps[0].contains(said), "{at_steps:?}");
    let most_at_steps = notes(&[broken(0.046, 0.046, true)]);
    assert!(most_at_steps[0].contains("at control steps: it was 0.0460 V"), "{most_at_steps:?}");
    assert!(at_steps[0].contains("a more accurate model"), "{at_steps:?}");
    // An output has no rows before step n1: neither a model nor T is to blame.
    for at_steps in [0.0, 0.04] {
        let late = ViolationMetrics { from_step: 3, ..broken(0.046, at_steps, true) };
        let note = &notes(&[late])[0];
        assert!(note.ends_with("set control.n1 = 1, or tighten the bound by as much."), "{note}");
    }
    // Soft bounds, and what the optimizer's tolerance leaves, are no news.
    assert_eq!(notes(&[broken(0.046, 0.046, false), broken(3e-4, 3e-4, true)]), [""; 0]);
    assert_eq!(notes(&[broken(5e-4, 0.0, true)]).len(), 1);
}

/// What metrics say of the estimator of a loop of 144 steps with three states.
fn notes_of(estimator: &str) -> Vec<String> {
    notes_with(estimator, r#""estimator_status": {}"#)
}

fn notes_with(estimator: &str, status: &str) -> Vec<String> {
    let mut estimated = of(ModelKind::RK4, [None; 3], &[(SqpStatus::Converged, 144)]);
    let text = format!(
        r#"{{ {estimator}, "estimate_rmse": {{ "a": 0.1, "b": 0.1, "c": 0.1 }},
        "estimator_us": {{ "p50": 1.0, "p99": 1.0, "max": 1.0 }}, {status} }}"#
    );
    estimated.estimator = Some(serde_json::from_str(&text).unwrap());
    metrics(vec![estimated]).loop_notes()
}

#[test]
fn an_inconsistent_estimator_is_named_with_its_numbers_and_what_to_change() {
    let nis = r#""nis_mean": 108.2, "nis_expected": 2.5, "nis_steps": 144"#;
    let notes = notes_of(&format!(r#"{nis}, "nees_mean": 3.0, "nees_steps": 144"#));
    let [note] = &notes[..] else { panic!("{notes:?}") };
    let said = "With RK4 the estimator is inconsistent: its mean NIS is 108, where a \
                consistent one has 2.50 (1.93 to 3.16 over 144 steps). Its errors are larger \
                than it believes: raise process_sd and disturbance_sd in [control.estimator]";
    assert!(note.starts_with(said), "{note}");
    // Errors are normalized by as many states as there are.
    let nis = nis.replace("108.2", "2.5");
    let notes = notes_of(&format!(r#"{nis}, "nees_mean": 5858.0, "nees_steps": 144"#));
    let said = "its mean NEES is 5858, where a consistent one has 3.00 (2.37 to 3.72 over 144";
    assert!(notes.len() == 1 && notes[0].contains(said), "{notes:?}");
    // Errors far smaller than allowed for are no finding: sensors may be better than believed.
    let nis = nis.replace("\"nis_mean\": 2.5", "\"nis_mean\": 0.015");
    assert_eq!(notes_of(&format!(r#"{nis}, "nees_mean": 0.01, "nees_steps": 144"#)), [""; 0]);
}

#[test]
fn steps_without_a_target_are_counted() {
    let notes = notes_of(
        r#""nis_mean": 2.5, "nis_expected": 2.5, "nees_mean": 3.0, "targets_not_found": 7"#,
    );
    let [note] = &notes[..] else { panic!("{notes:?}") };
    let said = "With RK4 the search for a steady-state target failed in 7 of 144 control steps.";
    assert!(note.starts_with(said), "{note}");
}

#[test]
fn a_mean_that_leaves_out_steps_says_so_once() {
    let notes = notes_of(r#""nis_mean": 0.06, "nees_mean": 1.0, "nis_undefined": 103"#);
    let [note] = &notes[..] else { panic!("{notes:?}") };
    let said = "With RK4 the NIS is undefined in 103 of 144 steps and is left out of its mean.";
    assert!(note.starts_with(said) && note.contains("closer together"), "{note}");
}

#[test]
fn estimates_without_a_model_are_counted() {
    let status = r#""estimator_status": { "not-finite": 18 }"#;
    let notes = notes_with(r#""nis_mean": 1.0, "nees_mean": 1.0"#, status);
    let [note] = &notes[..] else { panic!("{notes:?}") };
    let said = "With RK4 the model was not finite at the estimate 18 times in 144 steps,";
    assert!(note.starts_with(said) && note.contains("only a reset"), "{note}");
}

#[test]
fn rejected_measurements_are_counted_by_quantity() {
    let rejected = r#""rejected": { "b": 2, "c": 31 }"#;
    let notes = notes_of(&format!(r#""nis_mean": 1.0, "nees_mean": 1.0, {rejected}"#));
    let [note] = &notes[..] else { panic!("{notes:?}") };
    let said = "With RK4 in 144 steps the estimator's gate rejected measurements: 2 of b, 31 of c.";
    assert!(note.starts_with(said) && note.contains("widen its gate"), "{note}");
}

#[test]
fn segments_without_an_offset_and_steps_out_of_time_are_no_findings() {
    let status = [(SqpStatus::Converged, 5), (SqpStatus::Deadline, 4), (SqpStatus::Prepared, 3)];
    let all = metrics(vec![of(ModelKind::RK4, [None, None, Some(0.1)], &status)]);
    assert_eq!(all.loop_notes(), [""; 0]);
}

#[test]
fn failed_steps_are_counted_with_what_can_be_done() {
    let status =
        [(SqpStatus::Converged, 5), (SqpStatus::InfeasibleQp, 3), (SqpStatus::NumericalTrouble, 1)];
    let all = metrics(vec![of(ModelKind::RK4, [None; 3], &status)]);
    let [said] = &all.loop_notes()[..] else { panic!("one note") };
    assert!(
        said.starts_with(
            "With RK4 4 of 9 control steps failed, most with the status infeasible-qp."
        )
    );
    assert!(said.contains("state_softness"), "{said}");
}
