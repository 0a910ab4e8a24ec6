//! Line searches on functions of one variable.

use pinc_net::optim::{Iterate, LineSearch, Objective};

/// A function of one variable, with its slope and the points where it was evaluated.
struct Function<F> {
    f: F,
    steps: Vec<f64>,
}

impl<F: Fn(f64) -> (f64, f64)> Objective for Function<F> {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        self.steps.push(x[0]);
        let (value, slope) = (self.f)(x[0]);
        gradient[0] = slope;
        value
    }
}

/// The step found from 0 along the axis, and all that were tried.
fn search(
    kind: LineSearch,
    f: impl Fn(f64) -> (f64, f64),
    first_step: f64,
) -> (Option<f64>, Vec<f64>) {
    let mut function = Function { f, steps: Vec::new() };
    let start = Iterate::new(&mut function, vec![0.0]);
    function.steps.clear();
    let mut next = start.clone();
    let found = kind.search(&mut function, &start, &[1.0], first_step, &mut next);
    if let Some(step) = found {
        assert_eq!(next.x, [step], "the point evaluated last belongs to the step");
        assert_eq!(function.steps.last(), Some(&step));
    }
    (found, function.steps)
}

/// Minimum 0 at 1; value 1 and slope -2 at 0.
fn parabola(x: f64) -> (f64, f64) {
    ((x - 1.0) * (x - 1.0), 2.0 * (x - 1.0))
}

#[test]
fn weak_wolfe_halves_a_step_that_is_too_long_and_doubles_one_that_is_too_short() {
    let tried = |first| search(LineSearch::WeakWolfe, parabola, first).1;
    // At 2 the value equals the origin's: no decrease.
    assert_eq!(tried(8.0), [8.0, 4.0, 2.0, 1.0]);
    // The slope must rise from -2 to -1.8: at 0.125 it is -1.75.
    assert_eq!(tried(0.03125), [0.03125, 0.0625, 0.125]);
    assert_eq!(tried(1.0), [1.0]);
    // The decrease asked for is 2e-4 step.
    assert_eq!(tried(1.9995), [1.9995]);
    assert_eq!(tried(1.9999), [1.9999, 0.999_95]);
}

#[test]
fn weak_wolfe_bisects_between_too_short_and_too_long() {
    // Slope -1 to the kink at 1, then 100.
    let kink = |x: f64| if x < 1.0 { (-x, -1.0) } else { (-1.0 + 100.0 * (x - 1.0), 100.0) };
    let (_, tried) = search(LineSearch::WeakWolfe, kink, 0.75);
    assert_eq!(tried, [0.75, 1.5, 1.125, 0.9375, 1.03125, 0.984_375, 1.007_812_5]);
}

#[test]
fn searches_give_up_where_no_step_is_good() {
    // A jump at 1, to where the value is above the origin's.
    let cliff = |x: f64| if x < 1.0 { (-x, -1.0) } else { (10.0, 1.0) };
    let (found, tried) = search(LineSearch::WeakWolfe, cliff, 0.75);
    assert_eq!(found, None);
    // One evaluation per bit, until there is no number in between.
    assert!((50..60).contains(&tried.len()), "{}", tried.len());
    // The slope lies: the function rises everywhere.
    let lie = |x: f64| (x, -1.0);
    for kind in [LineSearch::WeakWolfe, LineSearch::HagerZhang] {
        let (found, tried) = search(kind, lie, 1.0);
        assert_eq!((found, tried.len()), (None, 60), "{kind:?}");
        // An endless descent.
        let (found, tried) = search(kind, |x| (-x, -1.0), 1.0);
        assert_eq!((found, tried.len()), (None, 60), "{kind:?}");
        // No descent to begin with.
        for slope in [0.0, 1.0, f64::NAN, f64::NEG_INFINITY] {
            let (found, tried) = search(kind, |x| (slope * x, slope), 1.0);
            assert_eq!((found, tried.len()), (None, 0), "{kind:?}");
        }
    }
}

#[test]
fn hager_zhang_expands_fivefold_and_takes_secants() {
    let tried = |first| search(LineSearch::HagerZhang, parabola, first).1;
    // Slopes -1.98, -1.9 and -1.5, of which -1.8 is asked for.
    let expanded = tried(0.01);
    assert_eq!(expanded.len(), 3, "{expanded:?}");
    assert!((expanded[2] - 0.25).abs() < 1e-15, "{expanded:?}");
    // The slope of a parabola is linear: the secant hits its minimum.
    assert_eq!(tried(3.0), [3.0, 1.0]);
    // Rounding hides the decrease: the slopes decide, which must be at most 1.6.
    let high = |x: f64| (1e20, parabola(x).1);
    assert_eq!(search(LineSearch::HagerZhang, high, 1.75).1, [1.75]);
    assert_eq!(search(LineSearch::HagerZhang, high, 1.875).1, [1.875, 1.0]);
}

/// The functions of Moré and Thuente, "Line search algorithms with guaranteed sufficient
/// decrease", ACM Trans. Math. Softw. 20 (1994), section 5.
fn more_thuente(number: usize, a: f64) -> (f64, f64) {
    let gamma = |b: f64| (1.0 + b * b).sqrt() - b;
    let smooth = |b1: f64, b2: f64| {
        let (left, right) = ((1.0 - a).hypot(b2), a.hypot(b1));
        let value = gamma(b1) * left + gamma(b2) * right;
        (value, gamma(b1) * (a - 1.0) / left + gamma(b2) * a / right)
    };
    match number {
        1 => (-a / (a * a + 2.0), (a * a - 2.0) / (a * a + 2.0).powi(2)),
        2 => {
            let s = a + 0.004;
            (s.powi(5) - 2.0 * s.powi(4), 5.0 * s.powi(4) - 8.0 * s.powi(3))
        }
        3 => {
            let (beta, l) = (0.01, 39.0);
            let half = std::f64::consts::FRAC_PI_2;
            let (base, slope) = if a <= 1.0 - beta {
                (1.0 - a, -1.0)
            } else if a >= 1.0 + beta {
                (a - 1.0, 1.0)
            } else {
                ((a - 1.0).powi(2) / (2.0 * beta) + beta / 2.0, (a - 1.0) / beta)
            };
            let wave = 2.0 * (1.0 - beta) / (l * std::f64::consts::PI) * (l * half * a).sin();
            (base + wave, slope + (1.0 - beta) * (l * half * a).cos())
        }
        4 => smooth(0.001, 0.001),
        5 => smooth(0.01, 0.001),
        _ => smooth(0.001, 0.01),
    }
}

#[test]
fn steps_satisfy_the_conditions_on_the_functions_of_more_and_thuente() {
    for number in 1..=6 {
        let f = |a: f64| more_thuente(number, a);
        let (value, slope) = f(0.0);
        for first_step in [1e-3, 1e-1, 1e1, 1e3] {
            let (found, tried) = search(LineSearch::WeakWolfe, f, first_step);
            let step = found.unwrap_or_else(|| panic!("function {number}, {tried:?}"));
            let at = f(step);
            assert!(at.0 <= value + 1e-4 * step * slope && at.1 >= 0.9 * slope);
            assert!(tried.len() <= 20, "function {number}: {tried:?}");

            let (found, tried) = search(LineSearch::HagerZhang, f, first_step);
            let step = found.unwrap_or_else(|| panic!("function {number}, {tried:?}"));
            let at = f(step);
            let wolfe = at.0 - value <= 0.1 * step * slope;
            let approximate = -0.8 * slope >= at.1 && at.0 <= value + 1e-6 * value.abs();
            assert!(at.1 >= 0.9 * slope && (wolfe || approximate), "function {number}");
            // The reference's own search needs up to 12 on these.
            assert!(tried.len() <= 20, "function {number}: {tried:?}");
        }
    }
}

/// How many points the reference's search tries, and the last of them: from
/// `tests/data/hager_zhang.py`.
#[test]
fn hager_zhang_tries_the_points_of_the_paper() {
    type Function = fn(f64) -> (f64, f64);
    let wall: Function = |a| {
        let rise = (a - 1.0).max(0.0);
        (-a + 0.5e4 * rise * rise, -1.0 + 1e4 * rise)
    };
    let steep: Function = |a| (0.1 * (a - 1.0).powi(10), (a - 1.0).powi(9));
    let waves: Function = |a| (-0.1 * a - (9.0 * a).sin(), -0.1 - 9.0 * (9.0 * a).cos());
    let ripples: Function = |a| {
        let (b, wave) = (a - 1.0, 20.0 * a);
        (0.02 * b * b - 0.1 * wave.sin(), 0.04 * b - 2.0 * wave.cos())
    };
    let well: Function = |a| {
        let d = (a - 1.0).max(0.0);
        (-a + 50.0 * d.powi(4), -1.0 + 200.0 * d.powi(3))
    };
    let valley: Function = |a| {
        let (b, d) = (a - 1.0, (a - 1.0).hypot(0.01));
        (5.0 * d + 4.0 * b, 5.0 * b / d + 4.0)
    };
    let notch: Function = |a| {
        let d = 100.0 * (a - 2.0);
        let bell = (-d * d).exp();
        (-0.2 * a + 3.0 * bell, -0.2 - 600.0 * d * bell)
    };
    let cliff: Function = |a| {
        let t = (200.0 * (a - 1.3)).tanh();
        (-a + 3.0 * (t + 1.0), -1.0 + 600.0 * (1.0 - t * t))
    };
    let barrier: Function = |a| if a >= 2.0 { (f64::INFINITY, 0.0) } else { parabola(a) };
    for (f, first_step, count, last) in [
        (wall, 0.001, 22, 1.006_527_442_335_274_4),
        (wall, 0.1, 7, 1.000_199_980_002_666_2),
        (wall, 1.7, 11, 1.009_837_880_848_223_3),
        (wall, 3.0, 15, 1.008_443_304_557_279_2),
        (wall, 40.0, 25, 1.006_920_123_239_705_1),
        (wall, 1000.0, 31, 1.008_542_289_964_143),
        (steep, 0.001, 3, 0.025),
        (steep, 3.0, 3, 0.113_735_606_860_451_13),
        (steep, 40.0, 3, 0.111_118_148_776_296_75),
        (steep, 1000.0, 11, 0.110_443_134_102_048_31),
        (waves, 0.001, 4, 0.125),
        (waves, 1.2, 5, 0.225_199_158_680_436_8),
        (waves, 1.7, 2, 0.896_220_503_076_545_4),
        (ripples, 1.7, 5, 0.118_241_463_693_881_8),
        (ripples, 2.1, 7, 0.120_925_097_027_369_41),
        (ripples, 3.0, 4, 0.409_949_310_415_161_4),
        (ripples, 5.0, 7, 1.327_699_842_749_235),
        (ripples, 7.3, 6, 1.363_883_529_582_783),
        (ripples, 11.0, 4, 1.335_338_831_204_030_6),
        (ripples, 40.0, 6, 1.639_307_948_174_248_7),
        (ripples, 1000.0, 9, 1.316_418_514_945_794),
        (barrier, 3.0, 2, 1.5),
        (barrier, 40.0, 6, 1.25),
        (barrier, 1000.0, 11, 1.0),
        (well, 0.1, 9, 1.271_233_891_820_805_7),
        (well, 2.1, 8, 1.257_023_637_620_745_3),
        (valley, 0.1, 9, 1.012_355_219_296_434_5),
        (valley, 0.9, 5, 1.093_180_353_686_444_2),
        (valley, 40.0, 8, 1.025_071_750_526_220_8),
        (notch, 0.4, 8, 1.968_75),
        (cliff, 0.001, 15, 1.285_241_216_542_576),
        (cliff, 0.4, 9, 1.283_208_583_328_032_2),
        (cliff, 2.1, 10, 1.285_478_408_984_802_4),
    ] {
        let (found, tried) = search(LineSearch::HagerZhang, f, first_step);
        assert_eq!(tried.len(), count, "from {first_step} to {last}: {tried:?}");
        // The steps are quotients of differences: some digits are lost.
        assert!((found.unwrap() - last).abs() < 1e-9, "from {first_step} to {last}: {tried:?}");
    }
}

#[test]
fn conditions_that_are_met_with_equality_are_met() {
    // Value and slope at 1; from 0 and -1 at 0. All products are exact.
    let tried_from = |origin: f64, kind, value: f64, slope: f64| {
        let line = |a: f64| if a > 0.0 { (origin + a * value, slope) } else { (origin, -1.0) };
        search(kind, line, 1.0).1.len()
    };
    let tried = |kind, value, slope| tried_from(0.0, kind, value, slope);
    assert_eq!(tried(LineSearch::WeakWolfe, -1e-4, 0.0), 1);
    assert_eq!(tried(LineSearch::WeakWolfe, -1.0, -0.9), 1);
    assert_eq!(tried(LineSearch::HagerZhang, -0.1, 5.0), 1);
    assert_eq!(tried(LineSearch::HagerZhang, -1.0, -0.9), 1);
    // The approximate conditions, where the decrease is not enough.
    assert_eq!(tried(LineSearch::HagerZhang, 0.0, 0.8), 1);
    assert!(tried(LineSearch::HagerZhang, 0.0, 0.81) > 1);
    // It is the decrease that counts, not the value.
    assert_eq!(tried_from(8.0, LineSearch::HagerZhang, -1.0, 5.0), 1);
    assert!(tried_from(-8.0, LineSearch::HagerZhang, 1.0, 5.0) > 1);
}
