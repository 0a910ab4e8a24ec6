//! When a linearization is used again.

use super::*;
use crate::Weights;

/// x\[k+1\] = x + u^2
#[derive(Debug)]
struct Square;

impl Model for Square {
    fn dims(&self) -> Dims {
        Dims::new(1, 1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        next[0] = x[0] + u[0] * u[0];
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        for (k, (x, u)) in at.x.iter().zip(at.u).enumerate() {
            (out.next[k], out.a[k], out.b[k]) = (x + u * u, 1.0, 2.0 * u);
        }
    }
}

/// A plan shifted by one stage is known except at its ends; one with the same states and other
/// inputs, or the same inputs and other states, is not.
#[test]
fn only_a_plan_with_the_same_states_and_inputs_is_known() {
    let dims = OcpDims::new(1, 1, 4);
    let (x, u) = ([0.1, 0.2, 0.3, 0.4], [1.0, 2.0, 3.0, 4.0]);
    let moved = [0.2, 0.3, 0.4, 0.7];
    for (x0, states, inputs, evaluated) in [
        (0.1, moved, [2.0, 3.0, 4.0, 9.0], 2),
        (0.1, moved, [2.0, 3.5, 4.0, 9.0], 4),
        (0.1, [0.2, 0.35, 0.4, 0.7], [2.0, 3.0, 4.0, 9.0], 4),
    ] {
        let weights = Weights::uniform(vec![1.0], vec![1.0]);
        let problem = NmpcProblem::new(Dims::new(1, 1), 4, weights);
        let mut cache = LinearizationCache::new(dims, &problem);
        let model: Box<dyn Model> = Box::new(Square);
        let mut horizon = Horizon::new(vec![(model, 4)], 4, dims.tree).unwrap();
        assert!(cache.follow(&mut horizon, [&[0.0], &[x, u].concat()], &mut || false));
        assert_eq!(cache.evaluated, 4);
        let plan = [states, inputs].concat();
        assert!(cache.follow(&mut horizon, [&[x0], &plan], &mut || false));
        assert_eq!(cache.evaluated, 4 + evaluated, "{states:?} {inputs:?}");
        let [next, _, b] = cache.parts();
        let from = [&[x0], &states[..3]].concat();
        for k in 0..4 {
            assert_eq!(next[k].to_bits(), (from[k] + inputs[k] * inputs[k]).to_bits());
            assert_eq!(b[k].to_bits(), (2.0 * inputs[k]).to_bits());
        }
    }
}

/// Two branches at the root: a tree that stays in its place while the plant moves is known except at
/// the stages that leave the root.
#[test]
fn a_tree_in_its_place_is_known_beyond_its_root() {
    let tree = pinc_qp::Tree::new(2, 1).unwrap();
    let dims = OcpDims { n_controls: 5, tree, ..OcpDims::new(1, 1, 6) };
    let problem = NmpcProblem::new(Dims::new(1, 1), 3, Weights::uniform(vec![1.0], vec![1.0]));
    let mut cache = LinearizationCache::new(dims, &problem);
    let model: Box<dyn Model> = Box::new(Square);
    let mut horizon = Horizon::new(vec![(model, 3)], 3, tree).unwrap();
    let plan = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.0, 2.0, 3.0, 4.0, 5.0];
    let mut moved = plan;
    moved[8] = 9.0;
    for (x0, z, evaluated) in [(0.0, plan, 6), (0.5, plan, 2), (0.5, plan, 0), (0.5, moved, 1)] {
        cache.evaluated = 0;
        assert!(cache.follow(&mut horizon, [&[x0], &z], &mut || false));
        assert_eq!(cache.evaluated, evaluated, "{x0}");
        let mut other = LinearizationCache::new(dims, &problem);
        assert!(other.follow(&mut horizon, [&[x0], &z], &mut || false));
        assert_eq!(cache.parts(), other.parts());
    }
}
