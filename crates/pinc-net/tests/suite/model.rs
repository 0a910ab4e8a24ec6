//! The net's control interface against its specification over dual numbers.

use super::family::Pendulum;
use pinc_ad::{Dual, jacobian};
use pinc_net::{
    Ansatz, Domain, Isa, NetConfig, NetError, ParameterRange, PincModel, PincNet, Scenario,
};
use pinc_ode::{Linearization, LinearizationBuffer, Model, Plant, Stages};
use pinc_plants::{FourTanks, VanDerPol};
use proptest::prelude::*;

fn check<P: Plant>(plant: &P, ansatz: Ansatz, seed: u64, at: f64) -> Result<(), TestCaseError> {
    let dims = plant.dims();
    let (n, m, np) = (dims.nx, dims.nu, dims.np);
    let ranges = plant.parameters().iter().map(|p| ParameterRange::new(&*p.name, 0.2..=1.4));
    let domain = Domain::new(vec![0.5..=6.0; n], vec![-1.0..=3.0; m]).with_parameters(ranges);
    let config = NetConfig { ansatz, ..NetConfig::new(0.7, 3, 11) };
    let net = PincNet::new(plant, &config, &domain, seed).unwrap();
    let mut model = PincModel::new(&net).unwrap();
    let xup: Vec<f64> = (0..n + m + np).map(|i| at + 0.3 * i as f64).collect();
    let (x, rest) = xup.split_at(n);
    let (u, p) = rest.split_at(m);
    let mut next = vec![0.0; n];
    let (mut a, mut b, mut e) = (vec![0.0; n * n], vec![0.0; n * m], vec![0.0; n * np]);
    model.linearize(
        Stages { x, u, p },
        Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut e },
    );
    let expected = net.evaluate(0.7, x, u, p);
    let parameters: Vec<_> = net.mlp().parameters().iter().map(|&w| Dual::lift(w)).collect();
    let derivatives = jacobian(
        |v, out| {
            let (x, rest) = v.split_at(n);
            let (u, p) = rest.split_at(m);
            out.copy_from_slice(&net.state(&parameters, Dual::lift(0.7), x, u, p));
        },
        &xup,
        n,
    );
    // Some hundred roundings of numbers of size 10.
    for i in 0..n {
        prop_assert!((next[i] - expected[i]).abs() < 1e-12);
        let row = &derivatives[i * (n + m + np)..(i + 1) * (n + m + np)];
        let found = a[i * n..(i + 1) * n].iter().chain(&b[i * m..(i + 1) * m]);
        let found = found.chain(&e[i * np..(i + 1) * np]);
        for (j, (&derivative, got)) in row.iter().zip(found).enumerate() {
            prop_assert!((got - derivative).abs() < 1e-12, "{i} {j}: {got} {derivative}");
        }
    }
    let mut value = vec![0.0; n];
    model.step(x, u, p, &mut value);
    prop_assert!(value.iter().zip(&next).all(|(p, l)| (p - l).abs() < 1e-13));
    // Many points together, without the derivatives by p and with them.
    for points in [2, 9] {
        let [xs, us, ps] = [x, u, p].map(|part| part.repeat(points));
        let at = Stages { x: &xs, u: &us, p: &ps };
        let mut of = LinearizationBuffer::new(dims, points);
        for with in [false, true] {
            let mut out = of.as_mut();
            if !with {
                out.e = &mut [];
            }
            model.linearize(at, out);
        }
        for (found, one) in [(&of.next, &next), (&of.a, &a), (&of.b, &b), (&of.e, &e)] {
            let mut pairs = found.iter().zip(one.iter().cycle());
            prop_assert!(pairs.all(|(found, one)| (found - one).abs() < 1e-12));
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn agrees_with_the_specification(
        seed in any::<u64>(),
        at in -1.0..5.0_f64,
        ansatz in prop_oneof![Just(Ansatz::Direct), Just(Ansatz::HardLinear)],
    ) {
        check(&VanDerPol::default(), ansatz, seed, at)?;
        check(&FourTanks::antonelo(), ansatz, seed, at)?;
        check(&Pendulum, ansatz, seed, at)?;
    }
}

/// Its state depends on neither x nor u: as a model it would have Jacobians of zeros.
#[test]
fn a_conventional_pinn_is_no_model_for_control() {
    let plant = VanDerPol::default();
    let domain = Domain::new(vec![-3.0..=3.0; 2], [-1.0..=1.0]);
    let scenario = Scenario { initial_state: vec![1.0, 0.0], input: vec![0.5] };
    for ansatz in [Ansatz::Direct, Ansatz::HardLinear] {
        let time_only = Some(scenario.clone());
        let config = NetConfig { ansatz, time_only, ..NetConfig::new(0.5, 2, 5) };
        let net = PincNet::new(&plant, &config, &domain, 0).unwrap();
        assert!(matches!(PincModel::new(&net), Err(NetError::OneScenario)));
        // Nor when it comes from a file.
        let net = PincNet::from_bytes(&net.to_bytes()).unwrap();
        assert!(matches!(PincModel::with_isa(&net, Isa::detect()), Err(NetError::OneScenario)));
    }
}

/// A stage of any length up to T is one evaluation of the net at its time.
#[test]
fn a_shorter_step_is_the_net_at_its_time() {
    let plant = FourTanks::antonelo();
    let domain = Domain::new(vec![2.0..=20.0; 4], vec![0.0..=5.0; 2]);
    let (x, u) = ([9.0, 14.0, 2.5, 3.0], [2.0, 3.5]);
    for ansatz in [Ansatz::Direct, Ansatz::HardLinear] {
        let config = NetConfig { ansatz, ..NetConfig::new(160.0, 3, 11) };
        let net = PincNet::new(&plant, &config, &domain, 4).unwrap();
        for t in [10.0, 45.0, 160.0] {
            let mut model = PincModel::at(&net, t).unwrap();
            assert!((model.sample_time_s() - t).abs() < f64::EPSILON);
            let mut next = [0.0; 4];
            model.step(&x, &u, &[], &mut next);
            for (next, expected) in next.iter().zip(net.evaluate(t, &x, &u, &[])) {
                assert!((next - expected).abs() < 1e-11, "{t}: {next} {expected}");
            }
        }
        for t in [0.0, -1.0, 160.1, f64::NAN] {
            assert!(matches!(PincModel::at(&net, t), Err(NetError::Time { .. })), "{t}");
        }
    }
}
