//! Closed loops with each method for the quadratic programs.

use crate::problems::Loop;
use pinc_mpc::{Nmpc, QpMethod, SqpConfig, SqpStatus};
use pinc_ode::Model;

/// Runs the loop, in which every method is asked about every state; the largest difference of
/// inputs.
pub(crate) fn disagreement(mut run: Loop, model: impl Model + Clone + 'static) -> f64 {
    let methods = [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel, QpMethod::Auto];
    let mut controllers = methods.map(|qp| {
        let config = SqpConfig { qp, ..SqpConfig::default() };
        Nmpc::new(run.problem.clone(), Box::new(model.clone()), config).unwrap()
    });
    let mut worst = 0.0_f64;
    run.run(|k, x, reference| {
        let [first, others @ ..] = controllers.each_mut().map(|nmpc| {
            let method = nmpc.config().qp;
            let step = nmpc.step(x, reference).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "step {k}, {method}");
            step.u.to_vec()
        });
        for other in &others {
            let apart = first.iter().zip(other).map(|(a, b)| (a - b).abs());
            worst = apart.fold(worst, f64::max);
        }
        first
    });
    worst
}
