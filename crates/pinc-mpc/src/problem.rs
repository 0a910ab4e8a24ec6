//! The control problem.

use crate::cost::{Cost, Targets};
use crate::error::{check_finite, check_numbers, check_range};
use crate::outputs::OutputRows;
use crate::scenarios::Nodes;
use crate::units::{ProblemUnits, Units};
use crate::{Bounds, Constraints, MpcError, Scenarios, Softness, Tracked, Weight, Weights};
use pinc_ode::Dims;
use pinc_qp::{OcpDims, Tree};

/// The longest horizon, far beyond any use: memory is allocated for it.
const LONGEST: usize = 10_000;

/// The optimization problem of the paper, Eqs. (`MS:cost`) to (`MS:eq_const`), over the predicted
/// states x\[k+1\]..x\[k+N2\] and the inputs u\[k\]..u\[k+Nu-1\]:
///
/// ```text
/// min  sum_{j=N1..N2} |y[k+j] - yref[k+j]|_Q^2  +  sum_{i=0..Nu-1} |du[k+i]|_R^2
///      + |(u[k-1], .., u[k+Nu-1])|_W^2  +  sum_{j=0..N2} l_j(x[k+j], u[k+j])
/// s.t. x[k+j+1] = f(x[k+j], u[k+j], p)                 j = 0..N2-1
///      u[k+j]   = u[k-1] + du[k] + .. + du[k+j]        j = 0..Nu-1
///      u[k+j]   = u[k+Nu-1]                            j = Nu..N2
///      h(x[k+j], u[k+j]) <= 0,  g(x[k+j], u[k+j]) = 0  j = N1..N2
///      y(x[k+j], u[k+j-1]) and, with feedthrough, y(x[k+j-1], u[k+j-1])
///                          of the model within bounds  j = N1..N2
///      x[k+1]..x[k+N2], u[k]..u[k+Nu-1] and du[k]..du[k+Nu-1] within their bounds
/// ```
///
/// y are the tracked states, outputs and inputs, y\[k+j\] = y(x\[k+j\], u\[k+j-1\]): the readings just before
/// the input changes (see [`Model::output`](pinc_ode::Model::output)). Q and R may differ from stage to stage, and so may bounds.
/// The stage cost l is none unless [`NmpcBuilder::stage_cost`](crate::NmpcBuilder::stage_cost)
/// gives one. The measured state x\[k\] is a fact and not bounded: it can sit a little outside.
#[derive(Clone, Debug)]
pub struct NmpcProblem {
    /// N1, the first predicted state that is tracked, and the first at which h and g hold: from 1 to `horizon`.
    pub n1: usize,
    /// N2, the last one: the prediction horizon, at most 10 000.
    pub horizon: usize,
    /// Nu, the number of free inputs: from 1 to `horizon`.
    pub control_horizon: usize,
    /// The tracked quantities, in the order of `weights.q` and of the references; none, if a stage
    /// cost says it all.
    pub tracked: Vec<Tracked>,
    /// Q, R and what else is weighted.
    pub weights: Weights,
    /// Bounds on each predicted state, `[n]` or `[N2, n]`.
    pub state_bounds: Bounds,
    /// How hard these are, per state.
    pub state_softness: Softness,
    /// Bounds on each input, `[m]` or `[Nu, m]`.
    pub input_bounds: Bounds,
    /// Bounds on each input's change from one step to the next, `[m]` or `[Nu, m]`; they admit 0.
    /// The first input may always go as far as to its nearest bound.
    pub increment_bounds: Bounds,
    /// Bounds on each output of the model, `[ny]` or `[N2 - N1 + 1, ny]`. The bounds of stage j hold
    /// at both ends of the interval that leads to x\[k+j\], with the input of that interval: from
    /// y(x\[k\], u\[k\]) on if N1 = 1. An output without feedthrough at the start of an interval is
    /// what it is at the end of the one before, so that only the ends matter.
    pub output_bounds: Option<Bounds>,
    /// How hard these are, per output.
    pub output_softness: Softness,
    /// h and g.
    pub constraints: Option<Constraints>,
    /// How hard these are, per row of h and then of g.
    pub constraint_softness: Softness,
    /// p, the model's parameters, `np`, until [`Nmpc::set_parameters`](crate::Nmpc::set_parameters).
    pub parameters: Vec<f64>,
    /// How many whole steps pass until an input acts: the input chosen at step k is the plant's in
    /// step k + delay. The problem then starts at the state predicted for step k + delay.
    pub delay: usize,
    /// The typical size of each state, if the bounds do not tell it: what counts as a large error.
    /// Needed for states that are small numbers and not bounded, as a concentration of 1e-7 is. 0
    /// where only the state's values show it.
    pub state_sizes: Option<Vec<f64>>,
    /// Values that parameters may have, if the plan is to be a tree. `weights.input_sequence` and
    /// stages of different lengths do not go with more than one.
    pub scenarios: Option<Scenarios>,
    /// The states that end the horizon where it begins, x\[k+N2\] = x\[k\], by their places in ascending
    /// order: the plan is an orbit in them, whatever [`NmpcProblem::state_softness`].
    pub periodic: Vec<usize>,
    /// The states, by their places, whose bounds at the end of the horizon are met as hard ones, whatever
    /// [`NmpcProblem::state_softness`].
    pub end_states: Vec<usize>,
}

impl NmpcProblem {
    /// The problem with N1 = 1 and Nu = N2 = `horizon` that tracks all states, without any
    /// constraints. Further fields are set by struct update.
    ///
    /// ```
    /// use pinc_mpc::{Bounds, NmpcProblem, Weights};
    /// use pinc_ode::Dims;
    ///
    /// let weights = Weights::uniform(vec![10.0; 2], vec![1.0]);
    /// let problem = NmpcProblem {
    ///     input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
    ///     ..NmpcProblem::new(Dims::new(2, 1), 5, weights)
    /// };
    /// assert_eq!(problem.control_horizon, 5);
    /// ```
    #[must_use]
    pub fn new(dims: Dims, horizon: usize, weights: Weights) -> Self {
        Self {
            n1: 1,
            horizon,
            control_horizon: horizon,
            tracked: Tracked::states(0..dims.nx),
            weights,
            state_bounds: Bounds::none(dims.nx),
            state_softness: Softness::Hard,
            input_bounds: Bounds::none(dims.nu),
            increment_bounds: Bounds::none(dims.nu),
            output_bounds: None,
            output_softness: Softness::Hard,
            constraints: None,
            constraint_softness: Softness::Hard,
            parameters: Vec::new(),
            delay: 0,
            state_sizes: None,
            scenarios: None,
            periodic: Vec::new(),
            end_states: Vec::new(),
        }
    }

    /// The most that a multiplier of state `i` may be, at the end of the horizon or before.
    #[must_use]
    pub fn state_penalty(&self, i: usize, at_end: bool) -> f64 {
        let is_met = at_end && self.is_met_at_end(i);
        if is_met { f64::INFINITY } else { self.state_softness.penalty(i) }
    }

    /// Whether the bounds of state `i` at the end are met whatever the softness.
    pub(crate) fn is_met_at_end(&self, i: usize) -> bool {
        self.periodic.contains(&i) || self.end_states.contains(&i)
    }

    /// Checks the problem against a model of dimensions `dims`.
    ///
    /// # Errors
    ///
    /// [`MpcError`], naming the field and what was expected of it.
    pub fn validate(&self, dims: Dims) -> Result<(), MpcError> {
        check_range("the model's states", dims.nx, 1, usize::MAX)?;
        check_range("the model's inputs", dims.nu, 1, usize::MAX)?;
        check_range("horizon (N2)", self.horizon, 1, LONGEST)?;
        check_range("n1", self.n1, 1, self.horizon)?;
        check_range("control_horizon (Nu)", self.control_horizon, 1, self.horizon)?;
        check_range("delay", self.delay, 0, LONGEST)?;
        self.validate_tracked(dims)?;
        self.validate_weights(dims)?;
        self.validate_bounds(dims)?;
        check_finite("parameters", &self.parameters, dims.np)?;
        if let Some(sizes) = &self.state_sizes {
            check_finite("state_sizes", sizes, dims.nx)?;
            check_numbers("state_sizes", sizes, "not negative", |size| size >= 0.0)?;
        }
        if let Some(scenarios) = &self.scenarios {
            scenarios.validate(self, dims)?;
        }
        for (i, &place) in self.periodic.iter().enumerate() {
            let least = i.checked_sub(1).map_or(0, |before| self.periodic[before] + 1);
            check_range("periodic", place, least, dims.nx - 1)?;
        }
        for &place in &self.end_states {
            check_range("end_states", place, 0, dims.nx - 1)?;
        }
        if !self.periodic.is_empty() && self.scenarios.is_some() {
            return Err(MpcError::WithOrbit("scenarios"));
        }
        let rows = self.constraints.as_ref().map_or(0, |c| c.inequalities() + c.equalities());
        self.constraint_softness.validate("constraint_softness", rows)
    }

    /// The units in which the optimization computes, by bounds, sizes and weights; and by a step, if one is `seen`,
    /// where they say nothing: by its state, `n`, the input before, `m`, and its references, `[N2, outputs]`.
    #[must_use]
    pub fn units(&self, dims: Dims, seen: Option<[&[f64]; 3]>) -> ProblemUnits {
        // One row of each output is enough.
        let rows = OutputRows::new(self, dims, &vec![false; dims.ny]);
        let dims = self.ocp_dims(dims, &rows);
        let cost = Cost::new(self, dims, &Nodes::new(self, dims));
        let mut units = Units::new(self, dims, &rows);
        if let Some([x, previous, reference]) = seen {
            units.follow(x, Some(Targets { reference, previous }));
        }
        units.choose_cost(&cost.state_hessians(), &cost.increment_hessians());
        units.of_problem()
    }

    /// The sizes of the problem with a model of dimensions `dims`.
    pub(crate) fn ocp_dims(&self, dims: Dims, rows: &OutputRows) -> OcpDims {
        let (inequalities, equalities) =
            self.constraints.as_ref().map_or((0, 0), |c| (c.inequalities(), c.equalities()));
        let tree = self.tree();
        OcpDims {
            nx: dims.nx,
            nu: dims.nu,
            horizon: tree.first_node(self.horizon + 1) - 1,
            n_controls: tree.first_node(self.control_horizon),
            n1: tree.first_node(self.n1),
            inequalities,
            equalities,
            outputs: rows.here(),
            feedthrough: rows.through(),
            tree,
        }
    }

    /// The tree on which the plan is; a chain without scenarios.
    #[must_use]
    pub fn tree(&self) -> Tree {
        self.scenarios.as_ref().and_then(Scenarios::tree).unwrap_or(Tree::CHAIN)
    }

    /// Whether fewer quantities are tracked than there are inputs, and changes of an input have no
    /// weight: the Gauss-Newton Hessian is singular then, and its steps along inputs that the cost does
    /// not see are arbitrary.
    #[must_use]
    pub fn leaves_inputs_free(&self) -> bool {
        let inputs = self.input_bounds.low.len();
        let Weights { r, input_sequence, .. } = &self.weights;
        let free = |r: &Weight| (0..r.size()).any(|input| r.entry(input, input) <= 0.0);
        self.tracked.len() < inputs && input_sequence.is_none() && r.all().iter().any(free)
    }

    /// Whether outputs of the model are tracked or bounded.
    #[must_use]
    pub fn uses_outputs(&self) -> bool {
        self.output_bounds.is_some() || self.tracks_outputs()
    }

    /// Whether all that is tracked are states.
    pub(crate) fn tracks_states_only(&self) -> bool {
        self.tracked.iter().all(|tracked| matches!(tracked, Tracked::State(_)))
    }

    /// Whether outputs of the model are tracked.
    #[must_use]
    pub fn tracks_outputs(&self) -> bool {
        self.tracked.iter().any(|tracked| matches!(tracked, Tracked::Output(_)))
    }

    /// Whether something is tracked that may depend on the input: an input, or an output as
    /// `feedthrough` says.
    pub(crate) fn tracks_feedthrough(&self, feedthrough: &[bool]) -> bool {
        let through = |tracked: &Tracked| match *tracked {
            Tracked::State(_) => false,
            Tracked::Output(output) => feedthrough[output],
            Tracked::Input(_) => true,
        };
        self.tracked.iter().any(through)
    }

    fn validate_tracked(&self, dims: Dims) -> Result<(), MpcError> {
        check_range("tracked", self.tracked.len(), 0, dims.nx + dims.ny + dims.nu)?;
        for (i, &tracked) in self.tracked.iter().enumerate() {
            match tracked {
                Tracked::State(index) => check_range("tracked", index, 0, dims.nx - 1)?,
                Tracked::Output(index) => {
                    check_range("the model's outputs", dims.ny, 1, usize::MAX)?;
                    check_range("tracked", index, 0, dims.ny - 1)?;
                }
                Tracked::Input(index) => check_range("tracked", index, 0, dims.nu - 1)?,
            }
            if self.tracked[..i].contains(&tracked) {
                return Err(MpcError::TrackedTwice { tracked });
            }
        }
        Ok(())
    }

    fn validate_weights(&self, dims: Dims) -> Result<(), MpcError> {
        let Weights { q, r, terminal, input_sequence } = &self.weights;
        q.validate("weights.q", self.horizon, self.tracked.len())?;
        r.validate("weights.r", self.control_horizon, dims.nu)?;
        if let Some(terminal) = terminal {
            terminal.validate("weights.terminal", self.tracked.len())?;
        }
        let inputs = (self.control_horizon + 1) * dims.nu;
        let w = input_sequence.as_ref();
        w.map_or(Ok(()), |w| w.validate("weights.input_sequence", inputs))
    }

    fn validate_bounds(&self, dims: Dims) -> Result<(), MpcError> {
        let (last, control) = (self.horizon, self.control_horizon);
        self.state_bounds.validate("state_bounds", last, dims.nx)?;
        self.state_softness.validate("state_softness", dims.nx)?;
        self.input_bounds.validate("input_bounds", control, dims.nu)?;
        self.increment_bounds.validate("increment_bounds", control, dims.nu)?;
        self.increment_bounds.admit_zero("increment_bounds")?;
        if let Some(bounds) = &self.output_bounds {
            bounds.validate("output_bounds", last + 1 - self.n1, dims.ny)?;
            self.output_softness.validate("output_softness", dims.ny)?;
        }
        Ok(())
    }
}
