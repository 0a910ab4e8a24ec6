//! The net's control interface against its specification over dual numbers.

use pinc_ad::{Dual, jacobian};
use pinc_net::{Ansatz, Domain, NetConfig, PincModel, PincNet};
use pinc_ode::{Linearization, Model, Plant, Stages};
use pinc_plants::{FourTanks, VanDerPol};
use proptest::prelude::*;

fn check<P: Plant>(plant: &P, ansatz: Ansatz, seed: u64, at: f64) -> Result<(), TestCaseError> {
    let dims = plant.dims();
    let (n, m) = (dims.nx, dims.nu);
    let domain = Domain {
        state_low: vec![0.5; n],
        state_high: vec![6.0; n],
        input_low: vec![-1.0; m],
        input_high: vec![3.0; m],
    };
    let config =
        NetConfig { sample_time_s: 0.7, hidden_layers: 3, neurons: 11, ansatz, time_only: None };
    let net = PincNet::new(plant, &config, &domain, seed).unwrap();
    let mut predictor = PincModel::new(&net);
    let xu: Vec<f64> = (0..n + m).map(|i| at + 0.3 * i as f64).collect();
    let (x, u) = xu.split_at(n);
    let mut next = vec![0.0; n];
    let (mut a, mut b) = (vec![0.0; n * n], vec![0.0; n * m]);
    predictor.linearize(
        Stages { x, u, p: &[] },
        Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
    );
    let expected = net.evaluate(0.7, x, u);
    let parameters: Vec<_> = net.mlp().parameters().iter().map(|&w| Dual::lift(w)).collect();
    let derivatives = jacobian(
        |v, out| out.copy_from_slice(&net.state(&parameters, Dual::lift(0.7), &v[..n], &v[n..])),
        &xu,
        n,
    );
    // Some hundred roundings of numbers of size 10.
    for i in 0..n {
        prop_assert!((next[i] - expected[i]).abs() < 1e-12);
        let row = &derivatives[i * (n + m)..(i + 1) * (n + m)];
        for (j, &derivative) in row.iter().enumerate() {
            let got = if j < n { a[i * n + j] } else { b[i * m + j - n] };
            prop_assert!((got - derivative).abs() < 1e-12, "{i} {j}: {got} {derivative}");
        }
    }
    let mut value = vec![0.0; n];
    predictor.step(x, u, &[], &mut value);
    prop_assert!(value.iter().zip(&next).all(|(p, l)| (p - l).abs() < 1e-13));
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
    }
}
