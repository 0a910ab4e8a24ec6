//! Proven bounds against random and adversarial points, of ten models.
//!
//! `PINC_SOUNDNESS=100000` takes so many random points of each model, and a tenth of that many
//! adversarial ones, in place of 200.

use crate::support::{equations, lattice, truth};
use pinc_expr::PlantEquations;
use pinc_net::{Domain, NetConfig, PincModel, PincNet};
use pinc_ode::{DynPlant, Integrator, Model, Tableau};
use pinc_plants::{FourTanks, VanDerPol};
use pinc_verify::{Leaf, Search, SearchSettings, StepError, StepModel};

/// Rounds of a search, which need not be over: every leaf has its bound.
const ROUNDS: usize = 12;

/// Moves of an adversarial point.
const MOVES: u32 = 20;

fn count() -> u32 {
    std::env::var("PINC_SOUNDNESS").ok().and_then(|count| count.parse().ok()).unwrap_or(200)
}

struct Case {
    name: &'static str,
    equations: PlantEquations,
    domain: Vec<[f64; 2]>,
    step_s: f64,
    /// Layers and neurons of a net that has learnt nothing, or a method with its substeps.
    model: Kind,
}

enum Kind {
    Net([usize; 2]),
    Method(Integrator, usize),
}

fn cases() -> Vec<Case> {
    let oscillator = || PlantEquations::traced(VanDerPol::default());
    let tanks = || PlantEquations::traced(FourTanks::antonelo());
    let prey = || equations(&[("x", "x - x*y + u"), ("y", "0.5*x*y - y")]);
    let pendulum = || equations(&[("x", "y"), ("y", "u - sin(x) - 0.1*y")]);
    let mixer = || equations(&[("x", "(u - x)/(1 + x^2)"), ("y", "exp(-y)*x - sqrt(1 + y)")]);
    let cart = || equations(&[("v", "u - v*abs(v)")]);
    let square = |size: f64| vec![[-size, size], [-size, size], [-1.0, 1.0]];
    let positive = || vec![[0.2, 2.0], [0.2, 2.0], [0.0, 0.5]];
    let levels = || [vec![[6.0, 9.0]; 4], vec![[1.0, 2.0]; 2]].concat();
    let case =
        |name, equations, domain, step_s, model| Case { name, equations, domain, step_s, model };
    let rk4 = |substeps| Kind::Method(Integrator::Rk4, substeps);
    vec![
        case("oscillator, net", oscillator(), square(2.0), 0.3, Kind::Net([2, 6])),
        case("oscillator, RK4 x1", oscillator(), square(2.0), 0.3, rk4(1)),
        case(
            "oscillator, RK5 x1",
            oscillator(),
            square(1.0),
            0.3,
            Kind::Method(Integrator::Rk5, 1),
        ),
        case("prey, net", prey(), positive(), 0.5, Kind::Net([2, 8])),
        case("prey, RK4 x2", prey(), positive(), 0.5, rk4(2)),
        case("pendulum, net", pendulum(), square(3.0), 0.4, Kind::Net([3, 5])),
        case("pendulum, RK4 x1", pendulum(), square(3.0), 0.4, rk4(1)),
        case("mixer, net", mixer(), positive(), 0.3, Kind::Net([1, 10])),
        case("mixer, RK4 x1", mixer(), positive(), 0.3, rk4(1)),
        case("cart, RK4 x2", cart(), vec![[0.0, 2.0], [0.0, 2.0]], 0.5, rk4(2)),
        case("tanks, RK4 x1", tanks(), levels(), 5.0, rk4(1)),
    ]
}

fn model_of(case: &Case, plant: &dyn DynPlant) -> (Option<PincNet>, Box<dyn Model>) {
    match case.model {
        Kind::Method(method, substeps) => {
            (None, plant.model(method, case.step_s, substeps).unwrap())
        }
        Kind::Net([layers, neurons]) => {
            let (x, u) = case.domain.split_at(plant.dims().nx);
            let range = |ends: &[f64; 2]| ends[0]..=ends[1];
            let domain = Domain::new(x.iter().map(range), u.iter().map(range));
            let config = NetConfig::new(case.step_s, layers, neurons);
            let net = PincNet::new(plant, &config, &domain, 5).unwrap();
            let model = PincModel::new(&net).unwrap();
            (Some(net), Box::new(model))
        }
    }
}

/// The largest ratio of an error to the bounds of the leaves that hold the point.
fn ratio(leaves: &[Leaf], errors: &[f64], point: &[f64]) -> f64 {
    let inside =
        |leaf: &&Leaf| leaf.ends.iter().zip(point).all(|([low, high], v)| low <= v && v <= high);
    let mut ratios = vec![None; errors.len()];
    for (state, bound) in leaves.iter().filter(inside).flat_map(|leaf| &leaf.bounds) {
        // What the integration is off by is no error of the model.
        let ratio = errors[*state].abs() / (bound.unwrap_or(f64::INFINITY) + 1e-11);
        ratios[*state] = Some(ratio.max(ratios[*state].unwrap_or(0.0)));
    }
    let covered = |ratio: Option<f64>| ratio.expect("the leaves of each state cover the domain");
    ratios.into_iter().map(covered).fold(0.0, f64::max)
}

#[test]
fn no_error_is_above_the_bound_of_its_box() {
    for case in cases() {
        let plant = case.equations.to_dyn().unwrap();
        let (net, mut model) = model_of(&case, &*plant);
        let step = match (&net, &case.model) {
            (Some(net), _) => StepModel::Net(net),
            (None, Kind::Method(Integrator::Rk5, n)) => {
                StepModel::RungeKutta(Tableau::DORMAND_PRINCE, *n)
            }
            (None, Kind::Method(_, n)) => StepModel::RungeKutta(Tableau::CLASSICAL, *n),
            (None, Kind::Net(_)) => unreachable!("a net was made"),
        };
        let inputs = plant.dims().nu;
        let error = StepError::new(&case.equations, &[], inputs, step, case.step_s).unwrap();
        let settings = SearchSettings { ratio: 1.3, points: 200, ..SearchSettings::default() };
        let mut search = Search::new(&error, &case.domain, settings, 2).unwrap();
        for _ in 0..ROUNDS {
            if !search.is_over() {
                search.round(&error, 2);
            }
        }
        let leaves: Vec<Leaf> = search.leaves().collect();
        let mut of = |point: &[f64]| ratio(&leaves, &truth(&*plant, &mut *model, point), point);
        let points = lattice(&case.domain, count());
        let mut largest = 0.0_f64;
        for (k, point) in points.iter().enumerate() {
            let mut best = of(point);
            if k % 10 == 0 {
                // Towards larger ratios, by moves that shrink.
                let mut at = point.clone();
                for (step, shift) in lattice(&vec![[-1.0, 1.0]; at.len()], MOVES).iter().enumerate()
                {
                    let scale = 0.2 * 0.8_f64.powi(i32::try_from(step).unwrap());
                    let moved: Vec<f64> = at
                        .iter()
                        .zip(shift)
                        .zip(&case.domain)
                        .map(|((v, s), [low, high])| {
                            (v + scale * s * (high - low)).clamp(*low, *high)
                        })
                        .collect();
                    let found = of(&moved);
                    if found > best {
                        (best, at) = (found, moved);
                    }
                }
            }
            assert!(best <= 1.0, "{}: {point:?} {best}", case.name);
            largest = largest.max(best);
        }
        // Bounds that are never approached would prove little.
        assert!(largest > 0.2, "{}: {largest}", case.name);
    }
}
