use super::*;

/// Which of some control steps begin with the phase, where programs are slow in each but those of
/// `fast` and the phase finds plans in all but `failed`.
fn begun(fast: &[usize], failed: &[usize]) -> Vec<usize> {
    let mut need = Need::default();
    let at_once = |step: &usize| {
        need.begin();
        let at_once = need.is_due(0, false);
        if at_once || need.is_due(PATIENCE, !fast.contains(step)) {
            need.end(!failed.contains(step));
        }
        at_once
    };
    (0..40).filter(at_once).collect()
}

#[test]
fn two_slow_control_steps_are_followed_by_some_that_begin_with_the_phase() {
    let expected: Vec<usize> = (2..17).chain(19..34).chain(36..40).collect();
    assert_eq!(begun(&[], &[]), expected);
    // One alone is not.
    assert!(begun(&(0..40).step_by(2).collect::<Vec<_>>(), &[]).is_empty());
    // Until it fails.
    assert_eq!(
        begun(&(20..40).collect::<Vec<_>>(), &[4]),
        [2, 3, 4].into_iter().chain(7..22).collect::<Vec<_>>()
    );
}

#[test]
fn fast_and_early_programs_are_left_alone() {
    let mut need = Need::default();
    assert!(!need.is_due(PATIENCE - 1, true) && !need.is_due(PATIENCE, false));
    assert!(need.is_due(PATIENCE, true));
}
