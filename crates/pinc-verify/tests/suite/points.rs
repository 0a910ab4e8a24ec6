//! Proven bounds at points.

use crate::support::{ends, equations, fresh_net, lattice, net_model, truth};
use pinc_expr::PlantEquations;
use pinc_net::Domain;
use pinc_ode::{Integrator, Tableau};
use pinc_plants::{FourTanks, VanDerPol};
use pinc_verify::{StepError, StepModel};

#[test]
fn bounds_at_points_are_close_to_the_truth_and_above_it() {
    let domain = Domain::new([-2.0..=2.0, -3.0..=3.0], [-1.0..=1.0]);
    let (net, plant) = (fresh_net(&domain), VanDerPol::default());
    let equations = PlantEquations::traced(plant);
    let error = StepError::new(&equations, &[], 1, StepModel::Net(&net), 0.3).unwrap();
    let points = lattice(&ends(&domain), 100);
    let mut model = net_model(&net);
    for (point, found) in points.iter().zip(error.at_points(&points, 2)) {
        let exact = truth(&plant, &mut model, point);
        for (i, exact) in exact.iter().enumerate() {
            assert!((found.error[i] - exact).abs() <= found.uncertainty[i] + 1e-11);
            assert!(found.bound()[i] + 1e-11 >= exact.abs());
            assert!(found.bound()[i] <= 1.02 * exact.abs() + 1e-8, "{found:?} {exact}");
            assert!(found.least()[i] <= exact.abs() + 1e-11);
        }
    }
}

/// Equations with each of the functions, judged by an integrator with small steps.
#[test]
fn all_functions_of_equations_can_be_enclosed() {
    let texts = [
        "u - sin(x) + cos(x)^2",
        "exp(-x) - u*log(2 + x)",
        "tanh(x) - atan(x)*u",
        "1/(1 + x^2) - x^1.5/2",
        "sqrt(x) - tan(x/2)",
        "abs(x) - sign(x)*u + min(x, 9) - max(x, -9)",
        "u/x - x/3",
    ];
    for text in texts {
        let equations = equations(&[("x", text)]);
        let model = StepModel::RungeKutta(Tableau::DORMAND_PRINCE, 4);
        let error = StepError::new(&equations, &[], 1, model, 0.5).unwrap();
        let plant = equations.to_dyn().unwrap();
        let points = lattice(&[[0.6, 1.4], [0.0, 1.0]], 10);
        let mut model = plant.model(Integrator::Rk5, 0.5, 4).unwrap();
        for (point, found) in points.iter().zip(error.at_points(&points, 1)) {
            let exact = truth(&*plant, &mut *model, point)[0];
            let bound = found.bound()[0];
            assert!(bound + 1e-11 >= exact.abs() && bound <= 1.05 * exact.abs() + 1e-10, "{text}");
        }
    }
}

#[test]
fn a_point_without_a_bound_is_reported() {
    let tanks = PlantEquations::traced(FourTanks::antonelo());
    let model = StepModel::RungeKutta(Tableau::CLASSICAL, 2);
    let error = StepError::new(&tanks, &[], 2, model, 10.0).unwrap();
    let empty = vec![0.0, 5.0, 5.0, 5.0, 1.0, 1.0];
    let full = vec![5.0, 5.0, 5.0, 5.0, 1.0, 1.0];
    let found = error.at_points(&[empty, full], 1);
    assert!(found[0].bound().iter().any(|bound| bound.is_infinite()), "{found:?}");
    assert!(found[1].bound().iter().all(|bound| *bound < 1e-4), "{found:?}");
}
