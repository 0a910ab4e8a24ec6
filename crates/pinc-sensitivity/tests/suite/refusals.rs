//! Controllers whose plans have no derivatives.

use crate::problems::four_tanks;
use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, PlanSearch, Programs, SqpStatus, Tracked, Weights,
};
use pinc_ode::{Model, Rk4};
use pinc_plants::FourTanks;
use pinc_sensitivity::Sensitivity;
use pinc_tube::{EllipsoidTube, Feedback, Sources};

const N: usize = 6;

/// A search that leaves each plan as it is.
#[derive(Debug)]
struct Unchanged;

impl PlanSearch for Unchanged {
    fn search(&mut self, _: &mut Programs<'_>) -> SqpStatus {
        SqpStatus::Converged
    }

    fn admit(&self, _: usize, u: f64, _: [f64; 2]) -> f64 {
        u
    }
}

#[test]
fn searched_plans_have_no_derivatives() {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let nmpc = Nmpc::builder(four_tanks()).model(Box::new(model)).search(Box::new(Unchanged));
    let mut nmpc = nmpc.build().unwrap();
    let reference = [9.2, 14.2].repeat(5);
    nmpc.step(&[8.5, 13.0, 2.2, 2.2], &reference).unwrap();
    let refused = Sensitivity::new(&mut nmpc, &reference, &[0.0; 2], None).unwrap_err();
    assert_eq!(refused, MpcError::SearchedDerivatives);
}

#[test]
fn plans_in_a_tube_have_no_derivatives() {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let dims = model.dims();
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds::new(vec![2.0, 2.0, 0.6, 0.6], vec![9.0, 20.0, 5.5, 5.5]),
        input_bounds: Bounds::new(vec![0.0; 2], vec![3.6; 2]),
        ..NmpcProblem::new(dims, N, Weights::uniform(vec![10.0; 2], vec![1.0; 2]))
    };
    let sources = Sources { boxes: vec![0.05; 4], ..Sources::default() };
    let units = vec![10.0; 4];
    let tube = EllipsoidTube::new((dims, N), sources, None, Feedback::Riccati, units).unwrap();
    let nmpc = Nmpc::builder(problem).model(Box::new(model)).tube(Box::new(tube));
    let mut nmpc = nmpc.build().unwrap();
    let reference = [9.2, 14.2].repeat(N);
    nmpc.step(&[8.5, 13.0, 2.2, 2.2], &reference).unwrap();
    let refused = Sensitivity::new(&mut nmpc, &reference, &[0.0; 2], None).unwrap_err();
    assert_eq!(refused, MpcError::WithTube("derivatives of a plan"));
}
