//! States with their derivative along a direction: against differences and exact solutions.

use pinc_ad::Scalar;
use pinc_expr::Equations;
use pinc_ode::{
    AccurateIntegrator, BlackBox, DynRhs, Flow, Linearization, OdeError, Plant, Stages, Tangent,
    Variable,
};
use pinc_plants::{FourTanks, HydraulicServo, SingleTrackCar, VanDerPol};
use std::sync::Arc;

const TOLERANCE: f64 = 1e-12;

/// The state and its derivative along the direction.
fn tangent(
    plant: &dyn DynRhs,
    (x, u, p): (&[f64], &[f64], &[f64]),
    along: &[f64],
    t: f64,
) -> (Vec<f64>, Vec<f64>) {
    let (mut end, mut slope) = (x.to_vec(), vec![f64::NAN; x.len()]);
    let mut integrator = Tangent::new(plant, TOLERANCE).unwrap();
    integrator.integrate(&mut end, (u, p), (along, &mut slope), t).unwrap();
    (end, slope)
}

/// The same by central differences of an accurate integration.
fn differences(
    plant: &dyn DynRhs,
    (x, u, p): (&[f64], &[f64], &[f64]),
    along: &[f64],
    (t, step): (f64, f64),
) -> (Vec<f64>, Vec<f64>) {
    let end = |by: f64| {
        let at: Vec<f64> = [x, u, p].concat();
        let at: Vec<f64> = at.iter().zip(along).map(|(at, v)| at + by * v).collect();
        let mut end = at[..x.len()].to_vec();
        let mut integrator = AccurateIntegrator::shared(plant.to_shared(), TOLERANCE);
        integrator.set_parameters(&at[x.len() + u.len()..]);
        integrator.integrate(&mut end, &at[x.len()..x.len() + u.len()], t).unwrap();
        end
    };
    let slope = end(step).iter().zip(end(-step)).map(|(a, b)| (a - b) / (2.0 * step)).collect();
    (end(0.0), slope)
}

fn close(got: &[f64], want: &[f64], tolerance: f64, what: &str) {
    let size = want.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    for (got, want) in got.iter().zip(want) {
        assert!((got - want).abs() <= tolerance * size, "{what}: {got} {want}");
    }
}

fn check(plant: &dyn DynRhs, at: (&[f64], &[f64], &[f64]), along: &[f64], t: f64) {
    let (end, slope) = tangent(plant, at, along, t);
    let (want_end, want) = differences(plant, at, along, (t, 1e-4));
    close(&end, &want_end, 1e-9, "state");
    // Differences are exact to their step squared, times third derivatives.
    close(&slope, &want, 1e-5, "slope");
}

#[test]
fn built_in_plants_agree_with_differences() {
    check(&VanDerPol::default(), (&[1.3, -0.4], &[0.6], &[]), &[0.3, -1.0, 0.7], 0.5);
    let tanks = FourTanks::antonelo();
    let along = [0.5, -0.2, 1.0, 0.3, 0.8, -0.6];
    check(&tanks, (&[9.0, 11.0, 4.0, 5.0], &[2.5, 3.1], &[]), &along, 10.0);
    let car = SingleTrackCar::default();
    let along = [1.0, 0.3, 0.2, 0.01, 0.02, 50.0];
    check(&car, (&[15.0, 0.3, 0.2, 0.01], &[0.03, 100.0], &[]), &along, 0.1);
}

/// The servo is stiff: what is integrated here turns implicit.
#[test]
fn a_stiff_plant_agrees_with_differences() {
    let servo = HydraulicServo::default();
    let along = [0.01, 0.05, 0.2, 0.1, 0.2];
    check(&servo, (&[0.05, 0.1, 0.5, 0.1], &[0.3], &[]), &along, 0.05);
}

/// A stiff mode that follows the square of another: x2 = b e^(-pt), x1 -> x2^2 within 1e-4 s, with
/// derivatives in the parameter too.
#[derive(Clone, Debug)]
struct Follows;

impl Plant for Follows {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("x1", ""), Variable::new("x2", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }

    fn parameters(&self) -> &[Variable] {
        static PARAMETERS: [Variable; 1] = [Variable::new("p", "")];
        &PARAMETERS
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = (x[1] * x[1] + u[0] - x[0]) * 1e5;
        dx[1] = -p[0] * x[1];
    }
}

#[test]
fn a_stiff_nonlinear_plant_has_its_exact_derivatives_in_states_inputs_and_parameters() {
    let (b, p, t, rate) = (1.5_f64, 0.8_f64, 2.0_f64, 1e5);
    let along = [0.7, 0.4, -0.3, 0.2];
    let (end, slope) = tangent(&Follows, (&[1.0, b], &[0.1], &[p]), &along, t);
    let decay = (-p * t).exp();
    let (x2, of_x2) = (b * decay, decay * (along[1] - b * t * along[3]));
    // x1 = k x2^2 + u with k = rate / (rate - 2p) once the fast mode is gone.
    let k = rate / (rate - 2.0 * p);
    let of_k = 2.0 * rate / (rate - 2.0 * p).powi(2) * along[3];
    close(&end, &[k * x2 * x2 + 0.1, x2], 1e-9, "state");
    close(&slope, &[2.0 * k * x2 * of_x2 + of_k * x2 * x2 + along[2], of_x2], 1e-8, "slope");
}

#[test]
fn equations_as_text_agree_with_the_same_compiled() {
    let names = |names: &[&'static str]| names.iter().map(|n| Variable::new(n, "")).collect();
    let equations = [("x1", "x2"), ("x2", "(1 - x1^2)*x2 - x1 + u")];
    let equations = Equations {
        states: names(&["x1", "x2"]),
        inputs: names(&["u"]),
        derivatives: equations.map(|(x, f)| (x.to_owned(), f.to_owned())).into_iter().collect(),
        ..Equations::default()
    };
    let text = equations.compile().unwrap().into_dyn();
    let (x, u, along) = ([1.3, -0.4], [0.6], [0.3, -1.0, 0.7]);
    let compiled = tangent(&VanDerPol::default(), (&x, &u, &[]), &along, 0.5);
    let text = tangent(&*text, (&x, &u, &[]), &along, 0.5);
    close(&text.0, &compiled.0, 1e-12, "state");
    close(&text.1, &compiled.1, 1e-11, "slope");
}

/// x' = u - x, with derivatives or without; not defined for x below 0.
#[derive(Debug)]
struct Lag {
    is_differentiable: bool,
}

impl Flow for Lag {
    fn advance(&self, x: &mut [f64], u: &[f64], t: f64) -> Result<(), OdeError> {
        for (x, u) in x.iter_mut().zip(u) {
            *x = u + (*x - u) * (-t).exp();
        }
        match x.iter().all(|x| *x >= 0.0) {
            true => Ok(()),
            false => Err(OdeError::External { reason: "below 0".to_owned() }),
        }
    }

    fn linearize(
        &self,
        at: Stages<'_>,
        t: f64,
        out: Linearization<'_>,
    ) -> Option<Result<(), OdeError>> {
        out.next.copy_from_slice(at.x);
        out.a.fill((-t).exp());
        out.b.fill(1.0 - (-t).exp());
        self.is_differentiable.then(|| self.advance(out.next, at.u, t))
    }
}

#[test]
fn a_black_box_is_asked_for_its_derivatives_and_refused_without() {
    let of = |is_differentiable| BlackBox {
        states: vec![Variable::new("x", "")],
        inputs: vec![Variable::new("u", "")],
        outputs: Vec::new(),
        difference_steps: vec![1e-6; 2],
        flow: Arc::new(Lag { is_differentiable }),
    };
    assert!(!of(false).has_derivatives() && Tangent::new(&of(false), TOLERANCE).is_none());
    let (end, slope) = tangent(&of(true), (&[2.0], &[1.0], &[]), &[3.0, -1.0], 0.4);
    let decay = (-0.4_f64).exp();
    close(&end, &[1.0 + decay], 1e-15, "state");
    close(&slope, &[3.0 * decay - (1.0 - decay)], 1e-15, "slope");
    let mut integrator = Tangent::new(&of(true), TOLERANCE).unwrap();
    let along: (&[f64], &mut [f64]) = (&[1.0, 0.0], &mut [0.0]);
    let error = integrator.integrate(&mut [-2.0], (&[0.0], &[]), along, 0.4).unwrap_err();
    assert!(error.to_string().contains("below 0"), "{error}");
}

#[test]
fn where_the_equation_ends_the_error_has_the_plants_state_alone() {
    let mut integrator = Tangent::new(&VanDerPol::default(), TOLERANCE).unwrap();
    let mut slope = [0.0; 2];
    let result = integrator.integrate(
        &mut [f64::INFINITY, 0.0],
        (&[0.0], &[]),
        (&[1.0, 0.0, 0.0], &mut slope),
        0.5,
    );
    match result.unwrap_err() {
        OdeError::NotFinite { state, .. } | OdeError::Undefined { state, .. } => {
            assert_eq!(state.len(), 2);
        }
        other => panic!("{other}"),
    }
}
