use super::*;

/// The Hessians of programs with these residuals.
fn hessians(only: Option<Hessian>, residuals: impl Iterator<Item = f64>) -> Vec<Hessian> {
    let mut choice = HessianChoice::new(only);
    let each = residuals.enumerate().map(|(k, residual)| {
        choice.judge(k, residual);
        choice.current()
    });
    each.collect()
}

#[test]
fn a_slow_hessian_is_changed_and_a_fast_one_is_kept() {
    use Hessian::{Exact, GaussNewton};
    let falling = |factor: f64| (0..24).map(move |k| factor.powi(k));
    // 0.5^4 is below a tenth, 0.6^4 above.
    assert_eq!(hessians(None, falling(0.5)), [GaussNewton; 24]);
    let slow = [[GaussNewton; 8], [Exact; 8], [GaussNewton; 8]].concat();
    assert_eq!(hessians(None, falling(0.6)), slow);
    assert_eq!(hessians(Some(Exact), falling(1.0)), [Exact; 24]);
    // A rise at the beginning counts for nothing.
    let late = [1.0, 1e3, 1e3, 1e2, 1.0, 0.1, 1e-2, 1e-3, 1e-4];
    assert_eq!(hessians(None, late.into_iter()), [GaussNewton; 9]);
}

#[test]
fn a_hessian_whose_step_is_no_good_is_given_up_once() {
    let mut choice = HessianChoice::new(None);
    for begin in [0, 20] {
        for next in [Hessian::Exact, Hessian::GaussNewton] {
            assert!(choice.give_up(begin));
            assert_eq!(choice.current(), next);
        }
        assert!(!choice.give_up(begin));
        // The same problem with soft constraints is another one.
        choice.restart(begin + 10);
    }
    assert!((30..=40).any(|k| choice.judge(k, 1.0)));
    assert!(choice.convexity().damping <= 0.0);
    assert!(!HessianChoice::new(Some(Hessian::GaussNewton)).give_up(1));
}

#[test]
fn an_exact_hessian_without_an_alternative_is_damped_until_its_steps_are_good() {
    let mut choice = HessianChoice::new(Some(Hessian::Exact));
    assert!(choice.give_up(1));
    let first = choice.convexity().damping;
    assert!(first > 0.0);
    // A short step, and long ones.
    choice.take_note(0.05);
    assert!(choice.convexity().damping > 5.0 * first);
    choice.take_note(0.5);
    assert!((choice.convexity().damping - first).abs() < 1e-9 * first);
    choice.take_note(1.0);
    assert!(choice.convexity().damping <= 0.0);
    // In the end it is no better.
    assert!((0..20).any(|k| !choice.give_up(k)));
}

#[test]
fn an_exact_hessian_that_is_slow_is_made_convex_otherwise() {
    let mut choice = HessianChoice::new(Some(Hessian::Exact));
    let shifts = (0..24).map(|k| (choice.judge(k, 1.0), choice.convexity().shifts).1);
    assert_eq!(shifts.collect::<Vec<_>>(), [[false; 8], [true; 8], [false; 8]].concat());
    let mut only = HessianChoice::new(Some(Hessian::GaussNewton));
    (0..24).for_each(|k| assert!(!only.judge(k, 1.0)));
    assert!(!only.convexity().shifts && !only.has_been_slow());
}

#[test]
fn another_problem_is_judged_by_its_own_residuals() {
    let mut choice = HessianChoice::new(None);
    (0..5).for_each(|k| assert!(!choice.judge(k, 1e-3)));
    choice.restart(5);
    assert!((5..20).all(|k| !choice.judge(k, 1e3 * 0.5_f64.powi(i32::try_from(k).unwrap()))));
}
