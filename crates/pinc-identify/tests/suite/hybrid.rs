//! Priors, nets inside the equations, and data that are held out.

use crate::support::{noise, oscillator, plant, problem, simulated, steps};
use pinc_expr::{Equations, NetExpression};
use pinc_identify::{
    Channel, Criterion, Diagnosis, Identified, InitialState, Measured, Method, Prior, Problem,
    Recording, Starts, Unknown, identify, identify_from_starts,
};
use pinc_ode::{DynPlant, Integrator, Model, Variable};

/// x' = -k x from 1, measured without noise at k = 0.5, with a prior of k: by the derivative of the
/// cost in closed form.
#[test]
fn a_prior_counts_as_one_more_measurement() {
    let plant = plant(&[("x", "-k*x + 0*u")], &["u"], &[("k", 1.0)], &["k"]);
    let (rows, step, sd) = (20, 0.2, 0.1);
    let time = |i: usize| step * f64::from(u32::try_from(i).unwrap());
    let y: Vec<f64> = (0..rows).map(|i| (-0.5 * time(i)).exp()).collect();
    let mut problem =
        problem(&*plant, &[0], Some(sd), &[(1.0, 0.1, 3.0)], InitialState::Fixed(vec![1.0]));
    let prior = Prior { mean: 0.8, sd: 0.02 };
    problem.unknown[0].prior = Some(prior);
    let recording = Recording { name: "decay", before: None, u: &[0.0; 20], y: &y };
    let mut model = plant.model(Integrator::Rk4, step, 8).unwrap();
    let found = identify(&mut *model, &problem, &[recording]).unwrap();
    let slope = |k: f64| -> f64 {
        let data = (0..rows).map(|i| {
            let x = (-k * time(i)).exp();
            (x - y[i]) * -time(i) * x / (sd * sd)
        });
        data.sum::<f64>() + (k - prior.mean) / (prior.sd * prior.sd)
    };
    let (mut low, mut high) = (0.1, 3.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if slope(middle) > 0.0 { high = middle } else { low = middle }
    }
    assert!((0.55..0.78).contains(&low), "{low}");
    assert!((found.parameters[0].value - low).abs() < 1e-6, "{} {low}", found.parameters[0].value);
    let left = (0..rows).map(|i| 0.5 * (((-low * time(i)).exp() - y[i]) / sd).powi(2));
    let cost = left.sum::<f64>() + 0.5 * ((low - prior.mean) / prior.sd).powi(2);
    assert!((found.cost - cost).abs() < 1e-6 * cost, "{} {cost}", found.cost);
    assert_eq!((found.measurements, found.degrees_of_freedom), (20, 20));
}

/// All criteria have the same minimum, and say how they came to it.
#[test]
fn one_word_chooses_the_shooting() {
    let plant = oscillator();
    let u = steps(7, 80, 15, (-1.0, 1.0));
    let y = simulated(
        &mut *plant.model(Integrator::Rk4, 0.1, 2).unwrap(),
        &[1.0, 0.0],
        &u,
        &[0.8, 1.3],
    );
    let y: Vec<f64> = y.iter().zip(noise(3, 0.01, 160)).map(|(y, e)| y + e).collect();
    let start = [(0.5, 0.0, 5.0), (1.0, 0.1, 20.0)];
    let problem = problem(&*plant, &[0, 1], Some(0.01), &start, InitialState::Free(vec![1.0, 0.0]));
    let by = |criterion| {
        let problem = Problem { criterion, ..problem.clone() };
        let recording = Recording { name: "oscillator", before: None, u: &u, y: &y };
        let mut model = plant.model(Integrator::Rk4, 0.1, 2).unwrap();
        identify(&mut *model, &problem, &[recording]).unwrap()
    };
    let [chosen, single, multiple] =
        [Criterion::Chosen, Criterion::Simulation, Criterion::MultipleShooting].map(by);
    assert!(matches!(single.method, Method::SingleShooting { .. }), "{}", single.method);
    assert!(matches!(multiple.method, Method::MultipleShooting(_)), "{}", multiple.method);
    for found in [single, multiple] {
        assert!((found.cost - chosen.cost).abs() < 1e-7 * chosen.cost, "{}", found.cost);
    }
}

/// A plant whose state `v` is slowed down by `law`, which has the net `drag` in it.
fn with_net(states: &[(&'static str, &str)], inputs: &[&str], neurons: usize) -> Equations {
    let drag = NetExpression {
        inputs: inputs.iter().map(|&text| text.to_owned()).collect(),
        outputs: vec!["drag_force".to_owned()],
        layers: vec![neurons],
        weights: None,
    };
    let mut equations = Equations {
        states: states.iter().map(|(name, _)| Variable::new(name, "")).collect(),
        inputs: vec![Variable::new("u", "")],
        derivatives: states.iter().map(|(n, text)| ((*n).to_owned(), (*text).to_owned())).collect(),
        nets: [("drag".to_owned(), drag)].into(),
        ..Equations::default()
    };
    equations.add_net_weights();
    equations
}

/// The weights of a hybrid that fit the measured states best, with the plant that has them as its
/// parameters.
fn learned(
    equations: &Equations,
    (measured, sd, x0): (&[usize], f64, &[f64]),
    (u, y): (&[f64], &[f64]),
    step: f64,
) -> (Identified, Box<dyn DynPlant>, Problem) {
    let names = equations.net_weights("drag");
    let varying: Vec<&str> = names.iter().map(String::as_str).collect();
    let plant = equations.compile_with(&varying).unwrap().into_dyn();
    let prior = Some(Prior { mean: 0.0, sd: 2.0 });
    let unknown = names.iter().enumerate().map(|(place, name)| Unknown {
        name: name.clone(),
        place,
        initial: equations.parameters[name],
        low: f64::NEG_INFINITY,
        high: f64::INFINITY,
        prior,
    });
    let channel = |&place: &usize| Channel {
        name: plant.states()[place].name.to_string(),
        measured: Measured::State(place),
        sd: Some(sd),
        is_estimated: false,
    };
    let problem = Problem {
        channels: measured.iter().map(channel).collect(),
        parameters: vec![0.0; names.len()],
        unknown: unknown.collect(),
        initial_state: InitialState::Free(x0.to_vec()),
        states: plant.states().iter().map(|state| state.name.to_string()).collect(),
        inputs: vec!["u".to_owned()],
        criterion: Criterion::Chosen,
    };
    let models: Vec<Box<dyn Model>> =
        (0..3).map(|_| plant.model(Integrator::Rk4, step, 2).unwrap()).collect();
    let recording = Recording { name: "hybrid", before: None, u, y };
    let starts = Starts { finished: 1, threads: 2, ..Starts::default() };
    let found = identify_from_starts(models, &problem, &[recording], starts).unwrap();
    (found, plant, problem)
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
    (sum / count).sqrt()
}

/// A mass under a known force, measured by its position; the friction is Coulomb's with a Stribeck
/// part, and the equation has none at all.
#[test]
fn a_law_of_friction_is_found_to_two_percent() {
    let law = |v: f64| 0.5 * v + 0.6 * (v / 0.3).tanh() * (1.0 + 0.5 * (-(v * v)).exp());
    let text = "u - 0.5*v - 0.6*tanh(v/0.3)*(1 + 0.5*exp(-v^2))";
    let truth = plant(&[("x", "v + 0*k"), ("v", text)], &["u"], &[("k", 1.0)], &["k"]);
    let u = steps(4, 400, 10, (-3.0, 3.0));
    let x = simulated(&mut *truth.model(Integrator::Rk4, 0.1, 4).unwrap(), &[0.0, 0.0], &u, &[1.0]);
    let y: Vec<f64> = x.iter().step_by(2).zip(noise(8, 1e-3, 400)).map(|(x, e)| x + e).collect();
    let equations = with_net(&[("x", "v"), ("v", "u - drag_force")], &["v"], 6);
    let (found, plant, _) = learned(&equations, (&[0], 1e-3, &[0.0, 0.0]), (&u, &y), 0.1);
    let (low, high) = x
        .iter()
        .skip(1)
        .step_by(2)
        .fold((0.0, 0.0), |(low, high): (f64, f64), v| (low.min(*v), high.max(*v)));
    assert!(low < -1.0 && high > 1.0, "{low} {high}");
    let at = |i: u32| low + (high - low) * f64::from(i) / 40.0;
    let force = |v: f64| {
        let mut dx = [0.0; 2];
        plant.to_shared().rhs(&[0.0, v], &[0.0], &found.p, &mut dx);
        -dx[1]
    };
    let errors = rms((0..=40).map(|i| force(at(i)) - law(at(i))));
    let size = rms((0..=40).map(|i| law(at(i))));
    assert!(errors < 0.02 * size, "{errors} {size}");
    assert!(found.channels[0].rms < 1.2e-3, "{}", found.channels[0].rms);
}

/// What inputs excite and the equation lacks is seen in the residuals.
#[test]
fn residuals_tell_that_the_equations_lack_something() {
    let lags = [("x", "k*(z - x)"), ("z", "1.5*(u - z)")];
    let truth = plant(&lags, &["u"], &[("k", 0.5)], &["k"]);
    let wrong = plant(&[("x", "k*(u - x)")], &["u"], &[("k", 0.5)], &["k"]);
    let u = steps(6, 300, 2, (-2.0, 2.0));
    let mut model = truth.model(Integrator::Rk4, 0.3, 4).unwrap();
    let x = simulated(&mut *model, &[0.0, 0.0], &u, &[0.5]);
    let y: Vec<f64> = x.iter().step_by(2).zip(noise(2, 0.01, 300)).map(|(x, e)| x + e).collect();
    let recording = Recording { name: "lags", before: None, u: &u, y: &y };
    let findings = |plant: &dyn DynPlant| {
        let problem = problem(
            plant,
            &[0],
            None,
            &[(0.4, 0.1, 2.0)],
            InitialState::Fixed(vec![0.0; plant.dims().nx]),
        );
        let mut model = plant.model(Integrator::Rk4, 0.3, 4).unwrap();
        identify(&mut *model, &problem, &[recording]).unwrap().findings
    };
    let depends = |finding: &Diagnosis| matches!(finding, Diagnosis::InputDependent { .. });
    assert!(findings(&*wrong).iter().any(depends), "{:?}", findings(&*wrong));
    assert!(!findings(&*truth).iter().any(depends), "{:?}", findings(&*truth));
}
