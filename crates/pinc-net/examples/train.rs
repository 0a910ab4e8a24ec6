//! t
#![allow(clippy::print_stdout)]
use pinc_net::optim::*;
use pinc_net::*;
use pinc_ode::*;
use std::time::Instant;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let which = args.get(1).map(String::as_str).unwrap_or("vdp");
    let seed: u64 = args.get(2).map(|s| s.parse().unwrap()).unwrap_or(0);
    let limit: f64 = args.get(3).map(|s| s.parse().unwrap()).unwrap_or(20.0);
    let ratio: f64 = args.get(4).map(|s| s.parse().unwrap()).unwrap_or(2.0);
    if which == "vdp" {
        let d = Domain {
            state_low: vec![-3.0, -4.35],
            state_high: vec![3.0, 4.35],
            input_low: vec![-1.0],
            input_high: vec![1.0],
        };
        let v = Domain { state_low: vec![-3.0; 2], state_high: vec![3.0; 2], ..d.clone() };
        go(VanDerPol::default(), d, v, 0.5, 10.0, 4, seed, limit, ratio);
    } else {
        let d = Domain {
            state_low: vec![0.05; 4],
            state_high: vec![22.0; 4],
            input_low: vec![0.0; 2],
            input_high: vec![5.0; 2],
        };
        let v = Domain {
            state_low: vec![2.0; 4],
            state_high: vec![20.0; 4],
            input_low: vec![0.5; 2],
            input_high: vec![3.0; 2],
        };
        go(FourTanks::antonelo(), d, v, 10.0, 350.0, 5, seed, limit, ratio);
    }
}
fn go<P: Plant + 'static>(
    plant: P,
    domain: Domain,
    vd: Domain,
    t: f64,
    dur: f64,
    layers: usize,
    seed: u64,
    limit: f64,
    ratio: f64,
) {
    let c = NetConfig {
        horizon_s: t,
        hidden_layers: layers,
        neurons: 20,
        ansatz: Ansatz::HardLinear,
        time_only: None,
    };
    let vc = ValidationConfig {
        scenarios: 10,
        duration_s: dur,
        subintervals: 9,
        domain: vd,
        tolerance: 1e-10,
        one_step_points: 1000,
    };
    let t0 = Instant::now();
    let vs = ValidationSet::generate(&plant, t, &vc, 12345).unwrap();
    println!("validation set {:.3}s", t0.elapsed().as_secs_f64());
    let tc = TrainingConfig {
        sampler: Sampler::Sobol,
        collocation_points: 1024,
        initial_points: 1,
        lambda: 1.0,
        residual_scale: ResidualScale::Normalized,
        initial_scale: InitialScale::Normalized,
        phases: vec![Phase {
            optimizer: OptimizerConfig::SelfScaledBroyden(SelfScaledBroydenConfig {
                initial_step: 0.1,
                gradient_tolerance: 0.0,
            }),
            iterations: 200_000,
            restore_best: false,
        }],
        growth: Some(GrowthConfig {
            max_points: 16384,
            factor: 2,
            overfit_ratio: ratio,
            check_every: 100,
            fresh_points: 4096,
        }),
        validation_every: 200,
        keep: Keep::Best,
    };
    let mut tr = Trainer::new(plant, &c, &domain, &tc, vs, seed, 2).unwrap();
    let mut spent = 0.0;
    let mut tv = 0.0;
    let mut next = 0.25;
    let mut fresh = None;
    loop {
        let s = Instant::now();
        let p = tr.step().unwrap();
        spent += s.elapsed().as_secs_f64();
        if let Progress::Iterated(r) = p {
            fresh = r.fresh_loss.or(fresh);
            if tr.validation_due() && spent >= next {
                let s = Instant::now();
                let v = tr.validate();
                tv += s.elapsed().as_secs_f64();
                println!(
                    "{spent:.2}s it {} ev {} n {} loss {:.2e} fresh {:.2e} gen {:.2e} one {:.2e}  (val {tv:.2}s)",
                    r.iteration,
                    r.loss_evaluations,
                    r.collocation_points,
                    r.loss,
                    fresh.unwrap_or(0.0),
                    v.mse_gen,
                    v.one_step_mse
                );
                next = spent * 1.25;
            }
        } else {
            println!("{p:?}");
            break;
        }
        if spent > limit {
            break;
        }
    }
}
