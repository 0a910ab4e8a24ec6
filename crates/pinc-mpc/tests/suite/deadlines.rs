//! Steps that are cut off: which plan is followed.

use crate::problems::van_der_pol;
use pinc_mpc::{Bounds, Nmpc, SqpConfig, SqpStatus};
use pinc_ode::Rk4;
use pinc_plants::VanDerPol;

/// Whether a step whose time is up at the given look at the clock reaches its end, whether its
/// input is of its plan, and whether the plan that the residual is of is true to the model.
fn cut(nmpc: &mut Nmpc, x: &[f64], looks: usize) -> [bool; 3] {
    let mut left = looks;
    let mut expired = || {
        let is_over = left == 0;
        left = left.saturating_sub(1);
        is_over
    };
    let step = nmpc.step_within(x, &[0.8, 0.0].repeat(40), &mut expired).unwrap();
    let tolerance = SqpConfig::default().tolerance;
    [step.status != SqpStatus::Deadline, step.followed, step.kkt.dynamics <= tolerance.sqrt()]
}

/// With a horizon so long that there is a look at the clock between a quadratic program and the
/// linearization that judges it.
fn long_oscillator() -> Nmpc {
    let mut problem = van_der_pol();
    problem.horizon = 40;
    problem.state_bounds = Bounds::none(2);
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap()
}

#[test]
fn a_plan_that_there_was_no_time_to_judge_counts_by_where_it_began() {
    // From a plan that is true to the model it is followed, as a real-time iteration is; a plan
    // that is not even the solution of a program waits.
    let mut followed = [false; 2];
    for looks in 0..40 {
        let mut nmpc = long_oscillator();
        assert_eq!(cut(&mut nmpc, &[0.2, 0.9], usize::MAX), [true; 3]);
        if let [false, of_plan, false] = cut(&mut nmpc, &[1.0, -0.5], looks) {
            followed[usize::from(of_plan)] = true;
        }
    }
    assert_eq!(followed, [true; 2]);
    // From the first guess it is followed for want of a better one, and nothing to go back to.
    let mut cases = 0;
    for looks in 0..40 {
        let mut nmpc = long_oscillator();
        if cut(&mut nmpc, &[1.0, -0.5], looks) != [false, true, false] {
            continue;
        }
        cases += 1;
        for next in [0, 2, 5] {
            let mut nmpc = long_oscillator();
            cut(&mut nmpc, &[1.0, -0.5], looks);
            assert!(cut(&mut nmpc, &[0.2, 0.9], next)[1], "{looks}, then {next}");
        }
    }
    assert!(cases > 5, "{cases}");
}

/// While the time never suffices the plan that was followed goes on for five steps.
#[test]
fn the_last_plan_is_not_followed_for_ever() {
    for looks in [0, 1, 2, 4] {
        let mut nmpc = long_oscillator();
        cut(&mut nmpc, &[0.2, 0.9], usize::MAX);
        let followed = [(); 10].map(|()| cut(&mut nmpc, &[1.0, -0.5], looks)[1]);
        assert_eq!(followed, std::array::from_fn(|step| step >= 5), "{looks}");
    }
}
