//! Algorithm 1 with a growing sample, written out with the parts that a trainer is made of.

use super::trainings::{begin, broyden, finish, growth, small, training};
use pinc_net::optim::{Iterate, LeastSquares, Objective, Optimizer, Outcome};
use pinc_net::{
    Ansatz, BatchLoss, LossWeights, PincNet, Points, SelectNet, TrainingConfig, Workers,
};
use pinc_plants::VanDerPol;

struct Loss(BatchLoss);

impl Objective for Loss {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        self.0.loss_gradient(x, gradient).total()
    }
}

impl LeastSquares for Loss {
    fn normal_matrix(&mut self, _: &[f64], _: &mut [f64]) {
        panic!("not asked for by this optimizer");
    }
}

#[test]
fn a_training_whose_sample_grows_has_the_bits_of_the_loop_written_out() {
    let plant = VanDerPol::default();
    let config = TrainingConfig {
        collocation_points: 64,
        growth: growth(),
        keep: SelectNet::Last,
        ..training(vec![broyden(150)])
    };
    let training = small(&config, Ansatz::HardLinear, 1);
    let mut trainer = begin(&plant, &training).unwrap();
    let (records, _) = finish(&mut trainer);

    let net = PincNet::new(&plant, &training.net, &training.domain, training.seed).unwrap();
    let weights =
        LossWeights::new(&net, config.lambda, &config.residual_scale, config.initial_scale);
    let workers = Workers::new(1).unwrap();
    let mut loss = Loss(BatchLoss::new(&plant, &net, &weights.unwrap(), &workers));
    let sample =
        |points: usize| config.sampler.collocation(points, 0.5, &training.domain, 1, training.seed);
    let mut points = config.collocation_points;
    loss.0.set_points(&sample(points), &Points::default());
    let mut at = Iterate::new(&mut loss, net.mlp().parameters().to_vec());
    let mut optimizer = Optimizer::new(&config.phases[0].optimizer, at.x.len());
    let mut growths = 0;
    for record in &records {
        assert_eq!(optimizer.step(&mut loss, &mut at, &workers), Outcome::Moved);
        // Fresh points show that the net fits its own sample better than the equation.
        if record.fresh_loss.is_some_and(|fresh| fresh > 1.2 * at.value) && points < 2048 {
            points *= 2;
            growths += 1;
            loss.0.set_points(&sample(points), &Points::default());
            at.reevaluate(&mut loss);
            optimizer.refresh(&at, &workers);
        }
        assert_eq!(record.collocation_points, points);
        assert_eq!(record.loss.to_bits(), at.value.to_bits(), "iteration {}", record.iteration);
    }
    assert!(growths > 0 && records[149].iteration == 150);
    assert_eq!(trainer.net().mlp().parameters(), at.x);
}
