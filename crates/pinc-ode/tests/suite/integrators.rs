//! The promises of every [`Integrator`]: its order, exact Jacobians, its evaluations per substep.

use crate::common::{Oscillator, distance, flows, linearize, order};
use pinc_ad::{Scalar, central_difference};
use pinc_ode::{DynPlant, Integrator, Plant, Variable};
use pinc_plants::FourTanks;
use std::sync::atomic::{AtomicUsize, Ordering};

fn tanks() -> Box<dyn DynPlant> {
    pinc_expr::into_dyn(FourTanks::johansson_nonminimum())
}

#[test]
fn the_error_falls_with_the_order() {
    let (oscillator, x, u) = (Oscillator { damping: 0.2 }, [1.0, -0.5], 0.7);
    for integrator in Integrator::ALL {
        // The errors of a method of higher order reach rounding in a longer step too.
        let t = if integrator.order() > 4 { 8.0 } else { 3.0 };
        let plant = pinc_expr::into_dyn(oscillator.clone());
        let method = |substeps| plant.model(integrator, t, substeps).unwrap();
        let slope = order(method, &x, &[u], &oscillator.exact(&x, u, t));
        assert!((slope - f64::from(integrator.order())).abs() < 0.15, "{integrator}: {slope}");
    }
}

#[test]
fn jacobians_are_the_derivatives_of_the_step() {
    let flow = &flows("johansson-nonminimum")[0];
    for integrator in Integrator::ALL {
        let mut model = tanks().model(integrator, 10.0, 3).unwrap();
        let [next, a, b] = linearize(&mut *model, &flow.x, &flow.u);
        let (nx, nu) = (flow.x.len(), flow.u.len());
        let mut stepped = |x: &[f64], u: &[f64]| {
            let mut next = vec![0.0; nx];
            model.step(x, u, &[], &mut next);
            next
        };
        assert!(distance(&stepped(&flow.x, &flow.u), &next) < 1e-13, "{integrator}");
        for row in 0..nx {
            for column in 0..nx + nu {
                let along = |xu: &[f64]| stepped(&xu[..nx], &xu[nx..])[row];
                let found = match column.checked_sub(nx) {
                    None => a[row * nx + column],
                    Some(input) => b[row * nu + input],
                };
                let at = [&flow.x[..], &flow.u].concat();
                let expected = central_difference(along, &at, column);
                assert!((found - expected).abs() < 1e-7, "{integrator}: {row}, {column}");
            }
        }
    }
}

/// x' = u - x, which counts how often it is asked.
#[derive(Clone, Debug)]
struct Counted;

static CALLS: AtomicUsize = AtomicUsize::new(0);

impl Plant for Counted {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }
    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        CALLS.fetch_add(1, Ordering::Relaxed);
        dx[0] = u[0] - x[0];
    }
}

/// The Rosenbrock method reads the equation once and evaluates its graph.
#[test]
fn an_explicit_step_takes_its_stages_in_each_substep() {
    for integrator in Integrator::ALL.into_iter().filter(|method| method.tableau().is_some()) {
        let mut model = pinc_expr::into_dyn(Counted).model(integrator, 1.0, 5).unwrap();
        let before = CALLS.load(Ordering::Relaxed);
        model.step(&[1.0], &[0.0], &[], &mut [0.0]);
        let calls = CALLS.load(Ordering::Relaxed) - before;
        assert_eq!(calls, 5 * integrator.stages(), "{integrator}");
        assert_eq!(integrator.tableau().unwrap().rows().len(), integrator.stages() + 1);
    }
}

#[test]
fn names_are_different() {
    let names = Integrator::ALL.map(Integrator::name);
    assert_eq!(names, ["rk4", "rk5", "rosenbrock"]);
    assert_eq!(Integrator::ALL.map(Integrator::title), ["RK4", "RK5", "Rosenbrock"]);
}
