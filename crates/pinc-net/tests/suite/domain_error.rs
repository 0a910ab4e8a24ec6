//! The error of one step over a domain, and which scenarios judge a net.

use super::trainings::{small, training, van_der_pol_domain};
use pinc_ad::Scalar;
use pinc_net::{
    Ansatz, Domain, DomainTruth, NetConfig, PincModel, PincNet, ValidationConfig, ValidationSet,
};
use pinc_ode::{Dims, Linearization, Model, Plant, Rk4, Stages, Variable};
use pinc_plants::VanDerPol;
use std::sync::OnceLock;

/// x' = u - x, y' = 2 (x - y).
#[derive(Clone, Copy, Debug)]
struct Linear;

/// x' = x^2 + u: gone to infinity after 1/x.
#[derive(Clone, Copy, Debug)]
struct Explosive;

impl Plant for Linear {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("x", ""), Variable::new("y", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = u[0] - x[0];
        dx[1] = (x[0] - x[1]) * 2.0;
    }
}

impl Plant for Explosive {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 1] = [Variable::new("x", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = x[0] * x[0] + u[0];
    }
}

/// The linear plant, with an error of y that is known.
struct WrongBy {
    exact: Rk4<Linear>,
    by: fn(&[f64], &[f64]) -> f64,
}

impl std::fmt::Debug for WrongBy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("a model with a known error")
    }
}

impl Model for WrongBy {
    fn dims(&self) -> Dims {
        self.exact.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.exact.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.exact.step(x, u, p, next);
        next[1] += (self.by)(x, u);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.exact.linearize(at, out);
    }
}

fn judged(by: fn(&[f64], &[f64]) -> f64, points: usize) -> pinc_net::DomainError {
    // Widths 2, 8 and 4.
    let domain = Domain::new([-1.0..=1.0, 2.0..=10.0], [0.0..=4.0]);
    let mut truth = DomainTruth::draw(&Linear, &domain, 0.1, points, 1e-12, 5);
    assert_eq!((truth.points().len(), truth.unsolved()), (points, 0));
    truth.judge(&mut WrongBy { exact: Rk4::new(Linear, 0.1, 8), by })
}

#[test]
fn errors_are_in_widths_of_the_state_and_percentiles_are_of_the_points() {
    // y is off by 0.8, a tenth of its range, for u > 3.9: in a fortieth of the domain.
    let found = judged(|_, u| if u[0] > 3.9 { 0.8 } else { 0.0 }, 4096);
    assert!((found.max - 0.1).abs() < 1e-6 && (found.p99 - 0.1).abs() < 1e-6, "{found:?}");
    assert!((found.share_beyond(0.05) - 0.025).abs() < 1e-3, "{}", found.share_beyond(0.05));
    // One of two states is wrong.
    let rms = (0.1_f64 * 0.1 * found.share_beyond(0.05) / 2.0).sqrt();
    assert!((found.rms - rms).abs() < 1e-6, "{} {rms}", found.rms);
    assert_eq!((found.worst.state, found.errors.len()), (1, 4096));
    assert!((found.worst.predicted - found.worst.truth - 0.8).abs() < 1e-6, "{:?}", found.worst);
    // In a two hundredth it is beyond the 99th percentile, but not overlooked.
    let found = judged(|_, u| if u[0] > 3.98 { 0.8 } else { 0.0 }, 4096);
    assert!(found.p99 < 1e-6 && (found.max - 0.1).abs() < 1e-6, "{found:?}");
    // Errors that are equally distributed up to a tenth.
    let found = judged(|_, u| 0.2 * u[0], 4096);
    assert!((found.p99 - 0.099).abs() < 1e-4 && found.max > found.p99, "{}", found.p99);
}

#[test]
fn the_largest_error_is_climbed_to_from_the_worst_points() {
    // A hill of 0.8, whose top is met by no point of so few.
    let found = judged(
        |x, u| 0.8 / (1.0 + (x[0] - 0.3).powi(2) + (x[1] - 7.0).powi(2) + (u[0] - 1.0).powi(2)),
        256,
    );
    let best = found.errors.iter().copied().fold(0.0, f64::max);
    assert!(best < 0.09999 && (found.max - 0.1).abs() < 1e-5, "{best} {}", found.max);
    let at = &found.worst;
    let off = [at.x[0] - 0.3, at.x[1] - 7.0, at.u[0] - 1.0];
    assert!(off.iter().all(|off| off.abs() < 1e-2), "{at:?}");
    // And into a corner, which is met exactly.
    let found = judged(|x, u| 0.1 * (x[0] + x[1] - u[0]), 256);
    assert_eq!((&found.worst.x[..], &found.worst.u[..]), (&[1.0, 10.0][..], &[0.0][..]));
}

/// The tops of two hills, as (x, y, u).
static TOPS: OnceLock<[[f64; 3]; 2]> = OnceLock::new();

/// The square of a distance, in widths.
fn square(a: [f64; 3], b: [f64; 3]) -> f64 {
    ((a[0] - b[0]) / 2.0).powi(2) + ((a[1] - b[1]) / 8.0).powi(2) + ((a[2] - b[2]) / 4.0).powi(2)
}

/// Two hills, the lower one with its top at a point of the sample, the higher one where the sample
/// has its largest gap: a search from the worst point alone ends on the lower one.
#[test]
fn the_largest_error_exceeds_the_worst_point_of_the_sample() {
    const POINTS: usize = 1024;
    let domain = Domain::new([-1.0..=1.0, 2.0..=10.0], [0.0..=4.0]);
    let truth = DomainTruth::draw(&Linear, &domain, 0.1, POINTS, 1e-12, 5);
    let points = truth.points();
    let place = |i: usize| [points.state(i)[0], points.state(i)[1], points.input(i)[0]];
    let gap =
        |at: [f64; 3]| (0..POINTS).map(|i| square(at, place(i))).fold(f64::INFINITY, f64::min);
    let inside = |k: usize| 0.1 + 0.05 * f64::from(u32::try_from(k).unwrap());
    let grid = (0..17 * 17 * 17).map(|k| {
        let [a, b, c] = [k % 17, k / 17 % 17, k / 289].map(inside);
        [-1.0 + 2.0 * a, 2.0 + 8.0 * b, 4.0 * c]
    });
    let low = place(17);
    let far = grid.filter(|at| square(*at, low) > 0.1);
    let high = far.max_by(|a, b| gap(*a).total_cmp(&gap(*b))).unwrap();
    // The premise: the sample sees the lower hill higher.
    assert!(0.8 / (1.0 + 400.0 * gap(high)) < 0.5, "{}", gap(high));
    TOPS.set([low, high]).unwrap();
    let hills = |x: &[f64], u: &[f64]| {
        let [low, high] = TOPS.get().unwrap();
        let at = [x[0], x[1], u[0]];
        let hill = |height: f64, top: [f64; 3]| height / (1.0 + 400.0 * square(at, top));
        hill(0.5, *low).max(hill(0.8, *high))
    };
    // 0.8 of a range of 8.
    let found = judged(hills, POINTS);
    assert!((found.max - 0.1).abs() < 1e-4, "{} {:?}", found.max, found.worst);
    assert!((found.worst.x[0] - high[0]).abs() < 1e-2, "{:?}", found.worst);
}

#[test]
fn a_root_mean_square_has_the_uncertainty_of_its_points() {
    // y is off by 0.8, a tenth of its range, at a share p of the points: the mean square is
    // p 0.01/2, and the relative standard error of the root sqrt((1 - p)/(p n))/2.
    let domain = Domain::new([-1.0..=1.0, 2.0..=10.0], [0.0..=4.0]);
    let truth = DomainTruth::draw(&Linear, &domain, 0.1, 1024, 1e-12, 5);
    let by = |_: &[f64], u: &[f64]| if u[0] > 3.0 { 0.8 } else { 0.0 };
    let found = truth.rms_error(&mut WrongBy { exact: Rk4::new(Linear, 0.1, 8), by });
    assert!((found.rms - (0.25_f64 * 0.005).sqrt()).abs() < 2e-4, "{found:?}");
    let uncertainty = 0.5 * (0.75_f64 / (0.25 * 1024.0)).sqrt();
    assert!((found.uncertainty / uncertainty - 1.0).abs() < 0.02, "{found:?}");
}

#[test]
fn what_is_no_number_is_infinitely_wrong_and_what_has_no_solution_is_counted() {
    let found = judged(|x, _| if x[0] > 0.9 { f64::NAN } else { 0.0 }, 256);
    assert!(found.max.is_infinite() && found.worst.x[0] > 0.9 && found.rms.is_nan(), "{found:?}");
    // From x > 1 the plant is gone within 1 s: half of the domain.
    let domain = Domain::new([0.0..=2.0], [0.0..=1e-9]);
    let truth = DomainTruth::draw(&Explosive, &domain, 1.0, 256, 1e-9, 1);
    let unsolved = truth.unsolved();
    assert!((125..=131).contains(&unsolved) && truth.points().len() + unsolved == 256);
}

#[test]
fn a_method_of_order_4_shows_its_order() {
    let truth = DomainTruth::draw(
        &Linear,
        &Domain::new([-1.0..=1.0, 2.0..=10.0], [0.0..=4.0]),
        0.5,
        128,
        1e-13,
        1,
    );
    let rms = |substeps| truth.rms(&mut Rk4::new(Linear, 0.5, substeps));
    let ratio = rms(2) / rms(4);
    assert!((14.0..20.0).contains(&ratio), "{ratio}");
}

/// The oscillator with x2 in units of a 1024th.
#[derive(Clone, Copy, Debug)]
struct Fine;

impl Plant for Fine {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("x1", ""), Variable::new("x2", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        let coarse = [x[0], x[1] * (1.0 / 1024.0)];
        VanDerPol::default().rhs(&coarse, u, p, dx);
        dx[1] = dx[1] * 1024.0;
    }
}

#[test]
fn the_score_of_a_net_does_not_depend_on_units() {
    let (coarse, fine) =
        (van_der_pol_domain(), Domain::new([-3.0..=3.0, -3072.0..=3072.0], [-1.0..=1.0]));
    let score = |plant: &dyn pinc_ode::DynRhs, domain: &Domain| {
        let config = ValidationConfig {
            scenarios: 3,
            one_step_points: 4,
            ..ValidationConfig::new(2.0, domain.clone())
        };
        let set = ValidationSet::generate(plant, 0.5, &config, 1).unwrap();
        let net = PincNet::new(plant, &NetConfig::new(0.5, 2, 8), domain, 3).unwrap();
        set.evaluate(&net)
    };
    let (one, other) = (score(&VanDerPol::default(), &coarse), score(&Fine, &fine));
    assert!((one.score() / other.score() - 1.0).abs() < 1e-6, "{one:?} {other:?}");
    // The paper's criterion sees the state with large numbers only.
    assert!(other.mse_gen > 1e4 * one.mse_gen, "{one:?} {other:?}");
}

#[test]
fn a_net_is_judged_by_other_scenarios_than_it_was_chosen_by() {
    let training = small(&training(vec![super::trainings::broyden(60)]), Ansatz::HardLinear, 1);
    let plant = VanDerPol::default();
    let (chosen_by, judged_by) =
        (training.validation_set(&plant).unwrap(), training.test_set(&plant).unwrap());
    assert_eq!(chosen_by.rows(), judged_by.rows());
    assert_eq!(judged_by, training.test_set(&plant).unwrap());
    let trained = training.run(&plant).unwrap();
    let (chosen, judged) = (chosen_by.evaluate(&trained.net), judged_by.evaluate(&trained.net));
    assert_eq!(trained.validation, judged);
    assert!(
        chosen.mse_gen.to_bits() != judged.mse_gen.to_bits()
            && chosen.one_step_mse.to_bits() != judged.one_step_mse.to_bits(),
        "{chosen:?} {judged:?}"
    );
    // The error over the domain describes the net in the controller.
    let mut truth = DomainTruth::draw(&plant, &training.domain, 0.5, 64, 1e-10, 3);
    let mut model = PincModel::new(&trained.net).unwrap();
    let found = truth.judge(&mut model);
    let first = (truth.points().state(0), truth.points().input(0));
    let by_net = trained.net.evaluate(0.5, first.0, first.1, &[]);
    let by_model = {
        let mut next = vec![0.0; 2];
        model.step(first.0, first.1, &[], &mut next);
        next
    };
    assert!((by_net[0] - by_model[0]).abs() < 1e-12 && found.rms < 0.1, "{found:?}");
}
