//! Plans with whole inputs, against the best of all of them.

use pinc_integer::{BranchAndBound, sum_up};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Softness, SqpConfig, SqpStatus, Weights};
use pinc_ode::{Model, Rk4};
use pinc_plants::{FourTanks, VanDerPol};

const STAGES: usize = 6;

fn model() -> Rk4<VanDerPol> {
    Rk4::new(VanDerPol::default(), 0.5, 4)
}

/// The cost of inputs from the state `x`: squared states by 10, squared changes of the input by 0.5.
fn cost(mut x: [f64; 2], inputs: &[f64]) -> f64 {
    let (mut model, mut before, mut sum) = (model(), 0.0, 0.0);
    for u in inputs {
        let mut next = [0.0; 2];
        model.step(&x, &[*u], &[], &mut next);
        sum += 10.0 * (next[0].powi(2) + next[1].powi(2)) + 0.5 * (u - before).powi(2);
        (x, before) = (next, *u);
    }
    sum
}

/// All inputs of -1, 0 and 1.
fn all_inputs() -> impl Iterator<Item = Vec<f64>> {
    (0..3_u32.pow(u32::try_from(STAGES).unwrap())).map(|number| {
        let digit = |place: u32| f64::from(number / 3_u32.pow(place) % 3) - 1.0;
        (0..u32::try_from(STAGES).unwrap()).map(digit).collect()
    })
}

/// The least cost of all inputs of -1, 0 and 1.
fn least(x: [f64; 2]) -> f64 {
    all_inputs().map(|inputs| cost(x, &inputs)).fold(f64::INFINITY, f64::min)
}

fn controller(programs: usize) -> Nmpc {
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        ..NmpcProblem::new(model().dims(), STAGES, Weights::uniform(vec![10.0; 2], vec![0.5]))
    };
    let search = BranchAndBound::new(&problem, &[0], programs, &[0.5; STAGES]);
    Nmpc::builder(problem).model(Box::new(model())).search(Box::new(search)).build().unwrap()
}

#[test]
fn the_plan_costs_no_more_than_any_other() {
    let mut nmpc = controller(5000);
    for x in [[0.5, 0.0], [-0.3, 0.6], [0.9, -0.4], [0.1, 0.2], [-0.8, -0.7]] {
        nmpc.reset();
        let step = nmpc.step(&x, &[0.0; 2 * STAGES]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        let found = step.cost;
        let inputs = nmpc.plan().inputs();
        assert!(inputs.iter().all(|u| u.fract() == 0.0), "{inputs:?}");
        assert!((found - cost(x, inputs)).abs() < 1e-6 * found, "{found} {}", cost(x, inputs));
        assert!(found < least(x) * (1.0 + 1e-6), "{x:?}: {found} {}", least(x));
    }
}

/// By how much the states from `x` on are outside their bounds of 0.4, in sum.
fn violation(mut x: [f64; 2], inputs: &[f64]) -> f64 {
    let (mut model, mut sum) = (model(), 0.0);
    for u in inputs {
        let mut next = [0.0; 2];
        model.step(&x, &[*u], &[], &mut next);
        sum += next.iter().map(|state| (state.abs() - 0.4).max(0.0)).sum::<f64>();
        x = next;
    }
    sum
}

/// Whole plans are compared by what they cost with their violations: one that keeps all bounds is
/// better where violations count most, and a penalty is part of the cost.
#[test]
fn violations_count_among_whole_plans() {
    let starts = [[0.5, 0.0], [-0.3, 0.6], [0.9, -0.4], [0.1, 0.2], [-0.6, 0.3], [0.45, 0.3]];
    for (softness, weight) in [(Softness::Exact, 1e6), (Softness::Penalty(vec![3.0; 2]), 3.0)] {
        let problem = NmpcProblem {
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            state_bounds: Bounds::new(vec![-0.4; 2], vec![0.4; 2]),
            state_softness: softness.clone(),
            ..NmpcProblem::new(model().dims(), STAGES, Weights::uniform(vec![0.1; 2], vec![0.5]))
        };
        let search = BranchAndBound::new(&problem, &[0], 5000, &[0.5; STAGES]);
        let builder = Nmpc::builder(problem).model(Box::new(model()));
        let mut nmpc = builder.search(Box::new(search)).build().unwrap();
        // The costs above, with Q of 0.1.
        let price = |x: [f64; 2], inputs: &[f64]| {
            let changes = inputs.iter().scan(0.0, |before, u| {
                let change = u - *before;
                *before = *u;
                Some(0.5 * change * change)
            });
            let changes = changes.sum::<f64>();
            changes + 0.01 * (cost(x, inputs) - changes) + weight * violation(x, inputs)
        };
        for x in starts {
            nmpc.reset();
            nmpc.step(&x, &[0.0; 2 * STAGES]).unwrap();
            let found = price(x, nmpc.plan().inputs());
            let least = all_inputs().map(|inputs| price(x, &inputs)).fold(f64::INFINITY, f64::min);
            assert!(found < least * (1.0 + 1e-6), "{softness:?}, {x:?}: {found} {least}");
        }
    }
}

/// Bounds of 1e5 around moves of 1 bound nothing: the plans are those of narrow bounds.
#[test]
fn wide_bounds_change_no_plan() {
    let inputs = |bound: f64| {
        let problem = NmpcProblem {
            input_bounds: Bounds::new(vec![-2.0], vec![bound]),
            increment_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            state_bounds: Bounds::new(vec![-0.6; 2], vec![0.6; 2]),
            ..NmpcProblem::new(model().dims(), STAGES, Weights::uniform(vec![1.0; 2], vec![0.01]))
        };
        let search = BranchAndBound::new(&problem, &[0], 5000, &[0.5; STAGES]);
        let builder = Nmpc::builder(problem).model(Box::new(model()));
        let mut nmpc = builder.search(Box::new(search)).build().unwrap();
        let (mut x, mut inputs) = (vec![0.3, -0.3], Vec::new());
        for _ in 0..12 {
            let step = nmpc.step(&x, &[0.4, 0.0].repeat(STAGES)).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{bound}: {step:?}");
            let (u, mut next) = (step.u.to_vec(), vec![0.0; 2]);
            model().step(&x, &u, &[], &mut next);
            inputs.extend(u);
            x = next;
        }
        inputs
    };
    for bound in [1e3, 1e5, 1e9] {
        assert_eq!(inputs(bound), inputs(4.0), "{bound}");
    }
}

/// Bounds are as they were after a search, and inputs whole in every step of a loop.
#[test]
fn a_search_that_is_cut_short_is_rounded_and_leaves_nothing_behind() {
    let (mut nmpc, mut x) = (controller(1), [0.9, -0.4]);
    let mut rounded = 0;
    for _ in 0..10 {
        let step = nmpc.step(&x, &[0.0; 2 * STAGES]).unwrap();
        assert!(step.u[0].fract() == 0.0 && step.followed, "{step:?}");
        rounded += usize::from(step.status == SqpStatus::Rounded);
        let (u, mut next) = (step.u[0], [0.0; 2]);
        model().step(&x, &[u], &[], &mut next);
        x = next;
    }
    assert!(rounded > 0);
    let mut once = controller(1);
    let first = once.step(&[0.9, -0.4], &[0.0; 2 * STAGES]).unwrap().u[0];
    once.reset();
    let again = once.step(&[0.9, -0.4], &[0.0; 2 * STAGES]).unwrap().u[0];
    assert_eq!(again.to_bits(), first.to_bits());
}

/// An input in whole numbers changes by whole numbers that its increments allow, in plans and in what is
/// applied, however little time there was; from between whole numbers it goes to the next.
#[test]
fn increments_hold_between_whole_inputs() {
    for (limit, most, first) in [(0.8, 0.0, 0.0), (1.0, 1.0, 0.0), (1.7, 1.0, 0.0), (0.3, 0.0, 0.6)]
    {
        for programs in [1, 5000] {
            let problem = NmpcProblem {
                input_bounds: Bounds::new(vec![-2.0], vec![2.0]),
                increment_bounds: Bounds::new(vec![-limit], vec![limit]),
                ..NmpcProblem::new(
                    model().dims(),
                    STAGES,
                    Weights::uniform(vec![10.0; 2], vec![0.5]),
                )
            };
            let search = BranchAndBound::new(&problem, &[0], programs, &[0.5; STAGES]);
            let search = Box::new(search);
            let builder = Nmpc::builder(problem).model(Box::new(model())).search(search);
            let (mut nmpc, mut x) = (builder.build().unwrap(), [0.9, -0.9]);
            nmpc.reset_to(&x, &[first]).unwrap();
            let (mut before, mut largest) = (f64::round(first), 0.0_f64);
            for k in 0..12 {
                let (mut asked, allowed) = (0, if k % 4 == 3 { 2 } else { usize::MAX });
                let mut expired = || {
                    asked += 1;
                    asked > allowed
                };
                let step = nmpc.step_within(&x, &[0.0; 2 * STAGES], &mut expired).unwrap();
                let u = step.u[0];
                let mut inputs = vec![before, u];
                if step.status == SqpStatus::Converged {
                    inputs.extend(nmpc.plan().inputs());
                }
                for pair in inputs.windows(2).filter(|_| k > 0 || first.fract() == 0.0) {
                    largest = largest.max((pair[1] - pair[0]).abs());
                }
                assert!(u.fract() == 0.0, "{limit}: {u}");
                assert!(k > 0 || first.fract() == 0.0 || u.to_bits() == before.to_bits(), "{u}");
                assert!(largest <= most, "{limit}, step {k}: a change of {largest}");
                let mut next = [0.0; 2];
                model().step(&x, &[u], &[], &mut next);
                (x, before) = (next, u);
            }
            assert!(largest >= most, "{limit}: no change above {largest}");
        }
    }
}

/// By hand: what is left over is 2.4 - 4, then -1.6 + 0.5 + 1, then -0.1 + 1.5 - 2.
#[test]
fn stages_count_by_their_lengths_when_they_are_rounded() {
    let mut inputs = [0.2, 0.6, 0.3, 0.5, 0.4, 0.75];
    sum_up(&mut inputs, &[1], &[4.0, 1.0, 2.0]);
    assert_eq!(inputs.map(f64::to_bits), [0.2, 1.0, 0.3, -1.0, 0.4, 1.0].map(f64::to_bits));
}

/// Also where the time is up before anything was searched for.
#[test]
fn an_input_is_whole_however_the_step_ended() {
    let mut nmpc = controller(5000);
    let mut late = 0;
    for most in 0..40 {
        nmpc.reset();
        let mut asked = 0;
        let mut expired = || {
            asked += 1;
            asked > most
        };
        let step = nmpc.step_within(&[0.9, -0.4], &[0.0; 2 * STAGES], &mut expired).unwrap();
        assert!(step.u[0].fract() == 0.0, "{most}: {step:?}");
        late += usize::from(step.status == SqpStatus::Deadline);
    }
    assert!(late > 20, "{late}");
}

/// Programs with most inputs held take fewer QPs than the relaxed one: the plan is whole although that did
/// not converge.
#[test]
fn a_plan_is_whole_where_the_relaxed_one_was_not_found() {
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        ..NmpcProblem::new(model().dims(), STAGES, Weights::uniform(vec![10.0; 2], vec![0.5]))
    };
    let config = SqpConfig { max_iterations: 3, ..SqpConfig::default() };
    let relaxed = Nmpc::new(problem.clone(), Box::new(model()), config).unwrap();
    let search = BranchAndBound::new(&problem, &[0], 5000, &[0.5; STAGES]);
    let builder = Nmpc::builder(problem).model(Box::new(model())).config(config);
    let (mut relaxed, mut nmpc) = (relaxed, builder.search(Box::new(search)).build().unwrap());
    let mut missed = 0;
    for x in [[0.5, 0.0], [-0.3, 0.6], [0.9, -0.4], [-0.8, -0.7]] {
        relaxed.reset();
        nmpc.reset();
        let is_missed =
            relaxed.step(&x, &[0.0; 2 * STAGES]).unwrap().status == SqpStatus::IterationLimit;
        missed += usize::from(is_missed);
        nmpc.step(&x, &[0.0; 2 * STAGES]).unwrap();
        let inputs = nmpc.plan().inputs();
        assert!(inputs.iter().all(|u| u.fract() == 0.0), "{x:?}: {inputs:?}");
    }
    assert!(missed > 0);
}

/// A rate limit that is no whole number admits the whole numbers within it: none but the input before,
/// or one step of 1; also after an input that was no whole number.
#[test]
fn increments_of_whole_inputs_keep_their_bounds() {
    for (rate, expected) in [(0.8, 0.0), (1.7, 1.0), (2.0, 2.0)] {
        let rest = Rk4::new(FourTanks::antonelo(), 10.0, 2);
        let problem = NmpcProblem {
            input_bounds: Bounds::new(vec![0.0; 2], vec![5.0; 2]),
            increment_bounds: Bounds::new(vec![-rate; 2], vec![rate; 2]),
            ..NmpcProblem::new(
                rest.dims(),
                STAGES,
                Weights::uniform(vec![1.0, 1.0, 0.0, 0.0], vec![0.01; 2]),
            )
        };
        let search = BranchAndBound::new(&problem, &[0], 500, &[10.0; STAGES]);
        let nmpc = Nmpc::builder(problem).model(Box::new(rest)).search(Box::new(search)).build();
        let (mut nmpc, x) = (nmpc.unwrap(), [3.0, 4.0, 1.0, 1.0]);
        let reference = [14.0, 15.0, 0.0, 0.0].repeat(STAGES);
        let mut before = 0.0;
        for _ in 0..4 {
            let step = nmpc.step(&x, &reference).unwrap();
            assert_eq!(step.status, SqpStatus::Converged);
            assert!(step.u[0] - before <= expected && step.u[0].fract() == 0.0, "{rate}: {step:?}");
            before = step.u[0];
        }
        assert!(before >= expected.min(5.0), "{rate}: {before}");
        nmpc.set_applied_input(&[0.4, 0.0]).unwrap();
        let step = nmpc.step(&x, &reference).unwrap();
        assert!(step.u[0].fract() == 0.0 && step.u[0] <= (0.4 + rate).floor(), "{rate}: {step:?}");
    }
}

/// One pump is switched in whole volts, the other is not.
#[test]
fn other_inputs_are_free_beside_whole_ones() {
    let tanks = Rk4::new(FourTanks::antonelo(), 10.0, 2);
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![0.0; 2], vec![5.0; 2]),
        ..NmpcProblem::new(
            tanks.dims(),
            STAGES,
            Weights::uniform(vec![1.0, 1.0, 0.0, 0.0], vec![0.1; 2]),
        )
    };
    let search = BranchAndBound::new(&problem, &[0], 500, &[10.0; STAGES]);
    let nmpc = Nmpc::builder(problem).model(Box::new(tanks)).search(Box::new(search)).build();
    let mut nmpc = nmpc.unwrap();
    let reference = [4.0, 5.0, 0.0, 0.0].repeat(STAGES);
    nmpc.step(&[3.0, 4.0, 1.0, 1.0], &reference).unwrap();
    let plan = nmpc.plan().inputs();
    assert!(plan.iter().step_by(2).all(|u| u.fract() == 0.0), "{plan:?}");
    let free = plan.iter().skip(1).step_by(2).filter(|u| u.fract().abs() > 1e-3).count();
    assert!(free > 2, "{plan:?}");
}
