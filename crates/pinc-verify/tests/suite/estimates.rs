//! The estimated error beside the true one.

use crate::support::{ends, equations, lattice, net_model, truth};
use pinc_net::{Ansatz, Domain, NetConfig, PincModel, PincNet, TrainingTarget};
use pinc_ode::{LinearizationBuffer, Model, Stages};
use pinc_verify::{ChainedError, ErrorEstimate};

/// A net of two states and one input that has learnt nothing, for a linear plant, whose errors obey
/// the estimate's equation however large they are.
fn estimate_of_a_linear_plant(ansatz: Ansatz, t: f64) -> f64 {
    let equations = equations(&[("x", "y - x/2"), ("y", "u - 2*x - 0.3*y")]);
    let plant = equations.to_dyn().unwrap();
    let domain = Domain::new([-1.0..=1.0, -1.0..=1.0], [-1.0..=1.0]);
    let config = NetConfig { ansatz, ..NetConfig::new(t, 2, 6) };
    let net = PincNet::new(&*plant, &config, &domain, 3).unwrap();
    let mut estimate = ErrorEstimate::new(&net, &*plant).unwrap();
    let mut model = net_model(&net);
    let mut worst = 0.0_f64;
    for point in lattice(&ends(&domain), 40) {
        let exact = truth(&*plant, &mut model, &point);
        let mut found = [0.0; 2];
        estimate.write(&point[..2], &point[2..], &[], &mut found);
        let size = exact.iter().fold(0.0, |size: f64, e| size.max(e.abs()));
        for (found, exact) in found.iter().zip(exact) {
            worst = worst.max((found - exact).abs() / size);
        }
    }
    worst
}

#[test]
fn a_net_of_another_plant_is_refused() {
    let plant_of =
        |names: [&str; 2]| equations(&names.map(|name| (name, "u - 0.3"))).to_dyn().unwrap();
    let domain = Domain::new([-1.0..=1.0, -1.0..=1.0], [-1.0..=1.0]);
    let net = PincNet::new(&*plant_of(["x", "y"]), &NetConfig::new(0.1, 1, 2), &domain, 3).unwrap();
    let error = ErrorEstimate::new(&net, &*plant_of(["y", "x"])).unwrap_err();
    assert_eq!(error.to_string(), "states of the model: x, y; of the plant: y, x");
}

/// What is left is the trapezoidal rule between the nodes, of the order of T^3 in T.
#[test]
fn errors_of_a_linear_plant_are_estimated_but_for_the_transport() {
    for ansatz in [Ansatz::HardLinear, Ansatz::Direct] {
        let [short, long] = [0.1, 0.4].map(|t| estimate_of_a_linear_plant(ansatz, t));
        assert!(long < 4e-3, "{ansatz:?} {long}");
        assert!(short < long / 12.0, "{ansatz:?} {short} {long}");
    }
}

/// The further the net is from the truth, the more the terms of second order count.
#[test]
fn errors_of_a_nonlinear_plant_are_estimated_to_first_order() {
    let equations = equations(&[("x", "u - x^2"), ("y", "x*y - sin(y)")]);
    let plant = equations.to_dyn().unwrap();
    let domain = Domain::new([0.5..=1.0, 0.5..=1.0], [-1.0..=1.0]);
    let relative = |t: f64| {
        let net = PincNet::new(&*plant, &NetConfig::new(t, 2, 6), &domain, 3).unwrap();
        let mut estimate = ErrorEstimate::new(&net, &*plant).unwrap();
        let mut model = net_model(&net);
        let point = [0.8, 0.6, 0.3];
        let exact = truth(&*plant, &mut model, &point);
        let mut found = [0.0; 2];
        estimate.write(&point[..2], &point[2..], &[], &mut found);
        let off = |(found, exact): (&f64, &f64)| ((found - exact) / exact).abs();
        found.iter().zip(&exact).map(off).fold(0.0, f64::max)
    };
    let [short, long] = [0.02, 0.2].map(relative);
    assert!(long < 0.2 && short < long / 8.0, "{short} {long}");
}

/// The net as one that was distilled: it is judged by an integrator.
fn distilled(net: &PincNet) -> PincNet {
    let bytes = net.to_bytes();
    let length = usize::try_from(u64::from_le_bytes(bytes[..8].try_into().unwrap())).unwrap();
    let header = std::str::from_utf8(&bytes[8..8 + length]).unwrap();
    let model = header.replacen(r#"{\"#, r#"{\"source\":\"integrator\",\"#, 1);
    assert_ne!(model, header);
    let mut all = (model.len() as u64).to_le_bytes().to_vec();
    all.extend(model.bytes().chain(bytes[8 + length..].iter().copied()));
    let distilled = PincNet::from_bytes(&all).unwrap();
    assert_eq!(distilled.source(), TrainingTarget::Integrator);
    distilled
}

/// A fast mode makes explicit steps of some number unstable; the estimate is right all the same.
#[test]
fn a_distilled_net_of_a_stiff_plant_is_judged_by_a_stable_integrator() {
    let domain = Domain::new([-1.0..=1.0, -1.0..=1.0], [-1.0..=1.0]);
    for (rate, explicit) in [(2.0, true), (35.0, true), (3000.0, false)] {
        let equations = equations(&[("y", "s"), ("s", &format!("{rate}*(u - y - s)"))]);
        let plant = equations.to_dyn().unwrap();
        let net = PincNet::new(&*plant, &NetConfig::new(1.0, 2, 6), &domain, 3).unwrap();
        let net = distilled(&net);
        let (method, substeps) = pinc_verify::reference(&net, &*plant, 1.0).unwrap();
        assert_eq!(method.tableau().is_some(), explicit, "{rate}: {method} x{substeps}");
        let mut estimate = ErrorEstimate::new(&net, &*plant).unwrap();
        let mut model = net_model(&net);
        for point in lattice(&ends(&domain), 20) {
            let exact = truth(&*plant, &mut model, &point);
            let mut found = [0.0; 2];
            estimate.write(&point[..2], &point[2..], &[], &mut found);
            let size = exact.iter().fold(0.0, |size: f64, e| size.max(e.abs()));
            for (found, exact) in found.iter().zip(exact) {
                assert!((found - exact).abs() < 0.1 * size, "{rate} {point:?}: {found} {exact}");
            }
        }
    }
}

/// After a step an error is what the net makes of it, and the error of the step: also of a step of
/// another length, which a distilled net does not know.
#[test]
fn an_error_is_carried_along_a_chain() {
    let domain = Domain::new([-1.0..=1.0, -1.0..=1.0], [-1.0..=1.0]);
    let equations = equations(&[("x", "y - x/2"), ("y", "u - 2*x - 0.3*y")]);
    let plant = || equations.to_dyn().unwrap();
    let net = PincNet::new(&*plant(), &NetConfig::new(0.4, 2, 6), &domain, 3).unwrap();
    let distilled = distilled(&net);
    let (x, u, before) = ([0.3, -0.2], [0.5], [0.01, -0.03]);
    for (net, t) in [(&net, 0.4), (&distilled, 0.4), (&net, 0.1), (&net, 0.4)] {
        let mut chained = ChainedError::new(net, plant()).unwrap();
        let found = chained.step(net, t, [&x, &u, &[]], &before);
        let mut model = PincModel::at(net, t).unwrap();
        let mut room = LinearizationBuffer::new(model.dims(), 1);
        model.linearize(Stages { x: &x, u: &u, p: &[] }, room.as_mut());
        let mut own = [0.0; 2];
        ErrorEstimate::at(net, &*plant(), t).unwrap().write(&x, &u, &[], &mut own);
        for i in 0..2 {
            let expected = room.a[2 * i] * before[0] + room.a[2 * i + 1] * before[1] + own[i];
            assert!((found[i] - expected).abs() < 1e-12, "{t}: {found:?} {expected}");
        }
        assert!(own.iter().all(|e| e.abs() > 1e-6), "{own:?}");
    }
    let mut chained = ChainedError::new(&distilled, plant()).unwrap();
    let unknown = chained.step(&distilled, 0.1, [&x, &u, &[]], &before);
    assert!(unknown.len() == 2 && unknown.iter().all(|e| e.is_nan()), "{unknown:?}");
    // It still knows its own.
    let known = chained.step(&distilled, 0.4, [&x, &u, &[]], &before);
    assert!(known.iter().all(|e| e.is_finite()), "{known:?}");
}
