use super::*;
use pinc_ad::Scalar;
use pinc_ode::{Plant, Rk4, Variable};

/// x' = -x^3 + u, with the time and J' = (x - sin t)^2 + u^2; the last output, the cost of the end, is
/// x^4 + u x.
#[derive(Clone, Debug)]
struct Costed;

impl Plant for Costed {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 3] =
            [Variable::new("x", ""), Variable::new("t", "s"), Variable::new("J", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }

    fn outputs(&self) -> &[Variable] {
        static OUTPUTS: [Variable; 1] = [Variable::new("end", "")];
        &OUTPUTS
    }

    fn output<S: Scalar>(&self, x: &[S], u: &[S], _: &[S], y: &mut [S]) {
        y[0] = x[0] * x[0] * x[0] * x[0] + u[0] * x[0];
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _: &[S], dx: &mut [S]) {
        let off = x[0] - x[1].sin();
        dx[0] = u[0] - x[0] * x[0] * x[0];
        dx[1] = x[1].constant(1.0);
        dx[2] = off * off + u[0] * u[0];
    }
}

const PART: f64 = 0.4;
const LAMBDA: f64 = -3.0;
const TIME_S: f64 = 0.7;

fn cost() -> IntegratedCost {
    IntegratedCost::new(vec![(Box::new(Rk4::new(Costed, 0.2, 3)), 2)])
}

/// The gradients of part J + lambda F at two points of a stage, and whether lambda F is in them.
fn gradients(stage: usize) -> (bool, [[f64; 2]; 2]) {
    let at = StagePoint::new((stage, TIME_S), &[0.5, -0.8], &[0.3, 0.1], &[]);
    let (mut by_x, mut by_u) = ([f64::NAN; 2], [f64::NAN; 2]);
    let mut block = QuadBlock::new(1, 1);
    let added = cost().gradients(at, (PART, &[LAMBDA]), &mut block, [&mut by_x[..], &mut by_u[..]]);
    (added, [by_x, by_u])
}

fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-8, "{found} {expected}");
}

#[test]
fn gradients_of_a_stage_are_those_of_cost_and_model() {
    let (added, [by_x, by_u]) = gradients(1);
    assert!(added);
    let value = |x: f64, u: f64| {
        let mut next = [0.0; 3];
        Rk4::new(Costed, 0.2, 3).step(&[x, TIME_S, 0.0], &[u], &[], &mut next);
        PART * next[2] + LAMBDA * next[0]
    };
    let h = 1e-5;
    for (k, (x, u)) in [(0.5, 0.3), (-0.8, 0.1)].into_iter().enumerate() {
        assert_near(by_x[k], (value(x + h, u) - value(x - h, u)) / (2.0 * h));
        assert_near(by_u[k], (value(x, u + h) - value(x, u - h)) / (2.0 * h));
    }
}

#[test]
fn gradients_of_the_end_are_those_of_its_cost() {
    let (added, [by_x, by_u]) = gradients(2);
    assert!(!added);
    for (k, (x, u)) in [(0.5_f64, 0.3), (-0.8, 0.1)].into_iter().enumerate() {
        assert_near(by_x[k], PART * (4.0 * x.powi(3) + u));
        assert_near(by_u[k], PART * x);
    }
}

fn bits(block: &QuadBlock) -> [u64; 3] {
    [block.value, block.by_x[0], block.by_u[0]].map(f64::to_bits)
}

/// Value and gradient at some points in turn, of a cost that is told all of them before if `ahead`.
fn in_turn(points: &[StagePoint<'_>], ahead: bool) -> Vec<[u64; 3]> {
    let models: Vec<(Box<dyn Model>, usize)> =
        vec![(Box::new(Rk4::new(Costed, 0.2, 3)), 2), (Box::new(Rk4::new(Costed, 0.5, 3)), 1)];
    let mut cost = IntegratedCost::new(models);
    if ahead {
        cost.look_ahead(points);
    }
    let mut block = QuadBlock::new(1, 1);
    let each = points.iter().map(|&point| {
        block.clear();
        cost.quadratize(point, &mut block);
        bits(&block)
    });
    each.collect()
}

#[test]
fn points_that_were_linearized_together_have_their_own_numbers() {
    let point = |stage: usize, x: &'static [f64]| {
        StagePoint::new((stage, TIME_S + 0.2 * [0.0, 1.0, 2.0, 4.5][stage]), x, &[0.3], &[])
    };
    // Two stages of one model, one of another, and the end.
    let plan = [point(0, &[0.5]), point(1, &[-0.8]), point(2, &[0.1]), point(3, &[0.7])];
    let expected = in_turn(&plan, false);
    assert!(expected.windows(2).all(|pair| pair[0] != pair[1]), "{expected:?}");
    assert_eq!(in_turn(&plan, true), expected);
    // Asked for others than was said, and of one twice.
    let other = [plan[1], plan[0], plan[0], plan[3], plan[2]];
    let mut cost = cost();
    cost.look_ahead(&plan[..2]);
    let mut block = QuadBlock::new(1, 1);
    for (place, expected) in [(1, expected[1]), (0, expected[0]), (0, expected[0])] {
        block.clear();
        cost.quadratize(plan[place], &mut block);
        assert_eq!(bits(&block), expected, "{place}");
    }
    assert_eq!(in_turn(&other, true), in_turn(&other, false));
}
