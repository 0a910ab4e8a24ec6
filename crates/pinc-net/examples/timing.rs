//! t
#![allow(clippy::print_stdout)]
use pinc_net::*;
use pinc_ode::*;
use std::time::Instant;
fn main() {
    let plant = VanDerPol::default();
    let domain = Domain {
        state_low: vec![-3.0; 2],
        state_high: vec![3.0; 2],
        input_low: vec![-1.0],
        input_high: vec![1.0],
    };
    let c = NetConfig {
        horizon_s: 0.5,
        hidden_layers: 4,
        neurons: 20,
        ansatz: Ansatz::Direct,
        time_only: None,
    };
    let net = PincNet::new(&plant, &c, &domain, 0).unwrap();
    let w =
        LossWeights::new(&net, 0.1, &ResidualScale::Physical, InitialScale::Normalized).unwrap();
    for isa in Isa::available() {
        for threads in [1, 2] {
            for n in [1024, 4096, 100_000] {
                let mut loss =
                    BatchLoss::new(&plant, &net, &w, &Workers::with_isa(threads, isa).unwrap());
                loss.set_points(
                    &Sampler::Sobol.collocation(n, 0.5, &domain, 1, 0),
                    &initial_conditions(n / 100, &domain, 0),
                );
                let mut g = vec![0.0; net.mlp().parameters().len()];
                let mut best = f64::INFINITY;
                let reps = 2_000_000 / n;
                for _ in 0..reps {
                    let t = Instant::now();
                    std::hint::black_box(loss.loss_gradient(net.mlp().parameters(), &mut g));
                    best = best.min(t.elapsed().as_secs_f64());
                }
                println!(
                    "{isa} threads {threads} n {n}: best {:.3} ms  {:.1} ns/pt {:.1} GF",
                    best * 1e3,
                    best * 1e9 / n as f64,
                    1240.0 * 2.0 * 3.0 * 2.0 * n as f64 / best / 1e9
                );
            }
        }
    }
}
