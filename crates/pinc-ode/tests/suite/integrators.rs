//! The promises of every [`Integrator`]: its order, exact Jacobians, its evaluations per substep.

use crate::common::{Oscillator, distance, flows, linearize, order};
use pinc_ad::{Scalar, central_difference};
use pinc_ode::{
    DynPlant, Gradients, Integrator, LinearizationBuffer, Model, Plant, Stages, Variable,
};
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

/// A plant as text, whose integrators can go backwards but for the Rosenbrock method.
fn text() -> Box<dyn DynPlant> {
    let named = |pairs: &[(&str, &str)]| {
        pairs.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
    };
    let equations = pinc_expr::Equations {
        states: ["x", "y", "z"].map(|name| Variable::new(name, "")).to_vec(),
        inputs: ["u", "v"].map(|name| Variable::new(name, "")).to_vec(),
        parameters: [("a".to_owned(), 0.7), ("b".to_owned(), 1.3)].into(),
        derivatives: named(&[
            ("x", "a*sin(y) - x*u"),
            ("y", "exp(-x)*v - b*y"),
            ("z", "x*y - z*z*b + tanh(u)"),
        ]),
        ..pinc_expr::Equations::default()
    };
    equations.compile_with(&["a", "b"]).unwrap().into_dyn()
}

/// w'F has the gradient w'(A, B, E), by steps backwards or by the Jacobians, at any number of points,
/// whether the Jacobians of all substeps are kept or computed again.
#[test]
fn gradients_are_the_weighted_jacobians() {
    for integrator in Integrator::ALL {
        for (plant, backwards) in [(text(), true), (tanks(), integrator == Integrator::Rosenbrock)]
        {
            for (substeps, counts) in [(3, &[1, 3, 8, 13, 16][..]), (300, &[5])] {
                let mut model = plant.model(integrator, 0.3, substeps).unwrap();
                for &count in counts {
                    assert_gradients(&mut *model, count, backwards);
                }
            }
        }
    }
}

fn assert_gradients(model: &mut dyn Model, count: usize, backwards: bool) {
    let dims = model.dims();
    let numbers = |width: usize, phase: f64| -> Vec<f64> {
        (0..count * width).map(|i| 1.5 + (1.7 * i as f64 + phase).sin()).collect()
    };
    let (x, u, p) = (numbers(dims.nx, 0.0), numbers(dims.nu, 1.0), numbers(dims.np, 2.0));
    let (at, weights) = (Stages { x: &x, u: &u, p: &p }, numbers(dims.nx, 3.0));
    let mut jacobians = LinearizationBuffer::new(dims, count);
    model.linearize(at, jacobians.as_mut());
    let (mut x, mut u, mut p) = (vec![0.0; x.len()], vec![0.0; u.len()], vec![0.0; p.len()]);
    let out = Gradients { x: &mut x, u: &mut u, p: &mut p };
    assert_eq!(model.pull_back(at, &weights, out), backwards);
    let out = Gradients { x: &mut x, u: &mut u, p: &mut p };
    LinearizationBuffer::default().gradients(model, at, &weights, out);
    for (found, jacobian, width) in
        [(&x, &jacobians.a, dims.nx), (&u, &jacobians.b, dims.nu), (&p, &jacobians.e, dims.np)]
    {
        for (i, found) in found.iter().enumerate() {
            let (point, column) = (i / width, i % width);
            let rows = (0..dims.nx).map(|row| point * dims.nx + row);
            let terms = rows.map(|row| weights[row] * jacobian[row * width + column]);
            let expected: f64 = terms.sum();
            let close = (found - expected).abs() <= 1e-12 * (1.0 + expected.abs());
            assert!(close, "{count} points: {found:e}, {expected:e}");
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
