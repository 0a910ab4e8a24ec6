//! Nets distilled from an accurate integrator.

use super::trainings::{
    adam, begin, broyden, finish, growth, small, training, validation_of, van_der_pol,
};
use pinc_net::{
    Ansatz, Measurements, NetError, PincNet, Sampler, Trainer, TrainingConfig, TrainingTarget,
    Validation,
};
use pinc_plants::VanDerPol;

fn distilled(
    training: &TrainingConfig,
    ansatz: Ansatz,
    threads: usize,
) -> Result<Trainer, NetError> {
    let config = TrainingConfig { source: TrainingTarget::Integrator, ..training.clone() };
    begin(&VanDerPol::default(), &small(&config, ansatz, threads))
}

#[test]
fn a_distilled_net_learns_the_integrators_steps_and_says_so_in_its_file() {
    let config = TrainingConfig { growth: growth(), ..training(vec![broyden(300)]) };
    let nets = [1, 2].map(|threads| {
        let mut trainer = distilled(&config, Ansatz::HardLinear, threads).unwrap();
        let (records, _) = finish(&mut trainer);
        let last = records[299];
        // One term alone: neither the equation nor the initial condition is asked for.
        assert_eq!(last.loss.to_bits(), last.loss_measured.to_bits());
        assert!(last.loss < records[0].loss / 1e4, "{} {}", records[0].loss, last.loss);
        assert!(last.collocation_points > 256);
        assert!(trainer.validate().one_step_mse < 1e-4);
        trainer.net()
    });
    assert_eq!(nets[0].to_bytes(), nets[1].to_bytes());
    let read = PincNet::from_bytes(&nets[0].to_bytes()).unwrap();
    assert_eq!(read.source(), TrainingTarget::Integrator);
    // Nothing is asked between the steps, where the net is wrong.
    let Validation { mse_gen, mse_all_normalized, .. } = validation_of(&read);
    assert!(mse_all_normalized < mse_gen, "{mse_all_normalized} {mse_gen}");
    let physics = van_der_pol(&config, Ansatz::HardLinear, 1).net();
    assert!(!String::from_utf8_lossy(&physics.to_bytes()).contains("source"));
}

#[test]
fn what_cannot_be_distilled_is_refused() {
    let config = training(vec![adam(5)]);
    let error = |result: Result<Trainer, NetError>| result.map(|_| ()).unwrap_err().to_string();
    let soft = error(distilled(&config, Ansatz::Direct, 1));
    assert!(soft.starts_with("source: integrator given"), "{soft}");
    let grid = TrainingConfig { sampler: Sampler::CoupledGrid, ..config.clone() };
    let grid = error(distilled(&grid, Ansatz::HardLinear, 1));
    assert!(grid.starts_with("sampler: coupled-grid given"), "{grid}");
    let mut data = Measurements::new(pinc_ode::Dims::new(2, 1));
    data.push(0.1, &[0.0; 2], &[0.0], &[], &[Some(0.1), None]);
    let both = distilled(&config, Ansatz::HardLinear, 1).unwrap().with_measurements(&data, 1.0);
    assert!(error(both).starts_with("source: integrator given"));
}

#[test]
fn a_distilled_training_goes_on_from_its_checkpoint() {
    let config =
        TrainingConfig { collocation_points: 64, growth: growth(), ..training(vec![broyden(120)]) };
    let mut whole = distilled(&config, Ansatz::HardLinear, 1).unwrap();
    let (records, _) = finish(&mut whole);
    assert!(records[119].collocation_points > 64);
    let mut first = distilled(&config, Ansatz::HardLinear, 1).unwrap();
    for _ in 0..80 {
        first.step().unwrap();
        if first.validation_due() {
            first.validate();
        }
    }
    let checkpoint = first.checkpoint().clone();
    let mut second = distilled(&config, Ansatz::HardLinear, 2).unwrap().resume(checkpoint).unwrap();
    assert_eq!(finish(&mut second).0, records[80..]);
}
