use super::*;

/// With one direction only, steps that are a part of what is needed are extended to all of it,
/// and steps that overshoot are cut.
#[test]
fn one_direction_is_solved_at_once() {
    for part in [0.1, 0.5, 1.9, 4.0] {
        let step = |error: f64| [part * error, -2.0 * part * error];
        let mut step_length = BarzilaiBorwein::new(2);
        let mut error = 1.0;
        for _ in 0..PATIENCE {
            assert_eq!(step_length.length(&step(error)), None);
            step_length.remember(&step(error), 0.7);
            error *= 1.0 - 0.7 * part;
        }
        let length = step_length.length(&step(error)).unwrap();
        assert!((length - 1.0 / part).abs() < 1e-12, "{length} {part}");
    }
}
