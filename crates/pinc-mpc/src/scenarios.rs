//! Scenario trees.

use crate::error::{check_finite, check_numbers, check_range, check_setting};
use crate::{MpcError, NmpcProblem};
use pinc_ode::{ArgumentError, Dims};
use pinc_qp::{OcpDims, Tree};

/// The most nodes that a tree may have: memory is allocated for them.
const MOST_NODES: usize = 100_000;

/// How far the weights may add up to something else than 1.
const ROUNDING: f64 = 1e-9;

/// Values that parameters of the model may have. The problem is then one on a tree: in each of the
/// first `robust_horizon` stages every node has a child for each branch, and after these a path
/// keeps its last branch. The stage that leads to a node has the branch's values.
///
/// ```text
/// min  sum over nodes of weight(node) (cost of the node),    weight(node) = product of its branches' weights
/// s.t. x(node) = f(x(before), u(before), p(branch))          one input for all that leaves a node
///      all bounds at all nodes
/// ```
///
/// A node has one input, whatever branch follows: that is what makes the first input right for all
/// branches. Reference: Lucia, Finkler and Engell, "Multi-stage nonlinear model predictive control
/// applied to a semi-batch polymerization reactor under uncertainty", J. Process Control 23 (2013).
#[derive(Clone, Debug, PartialEq)]
pub struct Scenarios {
    /// The places of the uncertain parameters among the model's.
    pub parameters: Vec<usize>,
    /// Their values in each branch, `[branches, parameters]`. A shifted plan follows the first.
    pub values: Vec<Vec<f64>>,
    /// The weight of each branch, positive; they add up to 1.
    pub weights: Vec<f64>,
    /// How many stages branch, from 1. With more than one branch it must be less than the control horizon.
    pub robust_horizon: usize,
}

impl Scenarios {
    /// All combinations of these values, of which the last parameter's change first, with equal weights.
    #[must_use]
    pub fn grid(parameters: Vec<usize>, values: &[Vec<f64>], robust_horizon: usize) -> Self {
        let mut grid = vec![Vec::new()];
        for values in values {
            let with = |start: &Vec<f64>| {
                let start = start.clone();
                values.iter().map(move |&value| [start.clone(), vec![value]].concat())
            };
            grid = grid.iter().flat_map(with).collect();
        }
        Self::list(parameters, grid, robust_horizon)
    }

    /// Branches with these values of the parameters, `[branches, parameters]`, and equal weights.
    #[must_use]
    pub fn list(parameters: Vec<usize>, values: Vec<Vec<f64>>, robust_horizon: usize) -> Self {
        let weights = vec![1.0 / values.len() as f64; values.len()];
        Self { parameters, values, weights, robust_horizon }
    }

    /// The shape of the tree; `None` if it is too large to be counted.
    pub(crate) fn tree(&self) -> Option<Tree> {
        Tree::new(self.values.len(), self.robust_horizon)
    }

    /// Checks them for a problem with a model of dimensions `dims`.
    pub(crate) fn validate(&self, problem: &NmpcProblem, dims: Dims) -> Result<(), MpcError> {
        if problem.delay > 0 {
            // One branch alone would be predicted over it.
            return Err(MpcError::WithScenarios("a delay"));
        }
        let branches = self.values.len();
        check_range("the branches of scenarios", branches, 1, usize::MAX)?;
        check_range("the parameters of scenarios", self.parameters.len(), 1, dims.np)?;
        ArgumentError::check_places("scenarios.parameters", &self.parameters, dims.np)?;
        for values in &self.values {
            check_finite("scenarios.values of a branch", values, self.parameters.len())?;
        }
        check_finite("scenarios.weights", &self.weights, branches)?;
        check_numbers("scenarios.weights", &self.weights, "positive", |weight| weight > 0.0)?;
        let sum = self.weights.iter().sum::<f64>();
        check_setting("the sum of scenarios.weights", sum, "1", (sum - 1.0).abs() <= ROUNDING)?;
        let most = if branches > 1 { problem.control_horizon - 1 } else { problem.horizon };
        check_range("scenarios.robust_horizon", self.robust_horizon, 1, most)?;
        let scenarios = self.tree().map_or(usize::MAX, Tree::scenarios);
        let field = "the scenarios of the tree";
        check_range(field, scenarios, 1, (MOST_NODES / problem.horizon).max(1))
    }

    /// Writes the values of the branch of each stage into the parameters of all stages,
    /// `[stages, np]`.
    pub(crate) fn apply(&self, tree: Tree, parameters: &mut [f64], np: usize) {
        for (stage, p) in parameters.chunks_exact_mut(np).enumerate() {
            for (&place, &value) in self.parameters.iter().zip(&self.values[tree.branch(stage)]) {
                p[place] = value;
            }
        }
    }
}

/// Which stage of the horizon the nodes belong to, and what they weigh.
#[derive(Clone, Debug)]
pub(crate) struct Nodes {
    /// The number of stages between the root and each node.
    pub(crate) depths: Vec<usize>,
    /// The product of the weights of the branches on the way there; 1 without scenarios.
    pub(crate) weights: Vec<f64>,
}

impl Nodes {
    pub(crate) fn new(problem: &NmpcProblem, dims: OcpDims) -> Self {
        let tree = dims.tree;
        let (mut depths, mut weights) = (vec![0], vec![1.0]);
        for stage in 0..dims.horizon {
            let origin = tree.origin(stage);
            depths.push(depths[origin] + 1);
            let branches = tree.is_branching(stage);
            let scenarios = problem.scenarios.as_ref().filter(|_| branches);
            let part = scenarios.map_or(1.0, |of| of.weights[tree.branch(stage)]);
            weights.push(weights[origin] * part);
        }
        Self { depths, weights }
    }
}

/// The reference at the nodes of a tree that branches.
#[derive(Debug)]
pub(crate) struct AtNodes {
    nodes: Nodes,
    /// How many quantities are tracked.
    width: usize,
    values: Vec<f64>,
}

impl AtNodes {
    pub(crate) fn new(problem: &NmpcProblem, dims: OcpDims) -> Option<Self> {
        let (nodes, width) = (Nodes::new(problem, dims), problem.tracked.len());
        let values = vec![0.0; dims.horizon * width];
        (!dims.tree.is_chain()).then_some(Self { nodes, width, values })
    }

    /// The reference of each node from `x_1` on, by its stage in `reference`.
    pub(crate) fn spread(&mut self, reference: &[f64]) -> &[f64] {
        let Self { nodes, width, values } = self;
        for (to, &depth) in values.chunks_exact_mut((*width).max(1)).zip(&nodes.depths[1..]) {
            to.copy_from_slice(&reference[(depth - 1) * *width..depth * *width]);
        }
        values
    }
}
