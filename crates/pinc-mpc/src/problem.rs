//! The control problem.

use crate::error::check_range;
use crate::{Bounds, Constraints, MpcError, Softness, Weights};
use pinc_ode::Dims;
use pinc_qp::OcpDims;

/// The longest horizon, far beyond any use: memory is allocated for it.
const LONGEST: usize = 10_000;

/// The optimisation problem of the paper, Eqs. (`MS:cost`) to (`MS:eq_const`), over the predicted
/// states x\[k+1\]..x\[k+N2\] and the inputs u\[k\]..u\[k+Nu-1\]:
///
/// ```text
/// min  sum_{j=N1..N2} w_j |y[k+j] - yref[k+j]|_Q^2  +  sum_{i=0..Nu-1} v_i |du[k+i]|_R^2
/// s.t. x[k+j+1] = f(x[k+j], u[k+j])                    j = 0..N2-1
///      u[k+j]   = u[k-1] + du[k] + .. + du[k+j]        j = 0..Nu-1
///      u[k+j]   = u[k+Nu-1]                            j = Nu..N2
///      h(x[k+j], u[k+j]) <= 0,  g(x[k+j], u[k+j]) = 0  j = N1..N2
///      x[k+1]..x[k+N2], u[k]..u[k+Nu-1] and du[k]..du[k+Nu-1] within their bounds
/// ```
///
/// y are the controlled states; w and v come from the profile of the [`Weights`]. The
/// measured state x\[k\] is a fact and not bounded: it can sit a little outside.
#[derive(Clone, Debug)]
pub struct NmpcProblem {
    /// N1, the first predicted state that is tracked, and the first at which h and g hold: from 1 to
    /// `horizon`.
    pub n1: usize,
    /// N2, the last one: the prediction horizon, at most 10 000.
    pub horizon: usize,
    /// Nu, the number of free inputs: from 1 to `horizon`.
    pub control_horizon: usize,
    /// Which states are controlled, in the order of `weights.q` and of the references.
    pub tracked: Vec<usize>,
    /// Q, R and their profile.
    pub weights: Weights,
    /// Bounds on each predicted state.
    pub state_bounds: Bounds,
    /// How hard these are, per state.
    pub state_softness: Softness,
    /// Bounds on each input.
    pub input_bounds: Bounds,
    /// Bounds on each input's change from one step to the next; they admit 0. The first input may always
    /// go as far as to its nearest bound.
    pub increment_bounds: Bounds,
    /// h and g.
    pub constraints: Option<Constraints>,
    /// How hard these are, per row of h and then of g.
    pub constraint_softness: Softness,
    /// How many whole steps pass until an input acts: the input chosen at step k is the plant's in step
    /// k + delay. The problem is then that of the state predicted for step k + delay.
    pub delay: usize,
}

impl NmpcProblem {
    /// The problem with N1 = 1 and Nu = N2 = `horizon` that controls all states, without any
    /// constraints. Further fields are set by struct update.
    #[must_use]
    pub fn new(dims: Dims, horizon: usize, weights: Weights) -> Self {
        Self {
            n1: 1,
            horizon,
            control_horizon: horizon,
            tracked: (0..dims.nx).collect(),
            weights,
            state_bounds: Bounds::none(dims.nx),
            state_softness: Softness::Hard,
            input_bounds: Bounds::none(dims.nu),
            increment_bounds: Bounds::none(dims.nu),
            constraints: None,
            constraint_softness: Softness::Hard,
            delay: 0,
        }
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
        self.validate_weights(dims)?;
        self.state_bounds.validate("state_bounds", dims.nx)?;
        self.state_softness.validate("state_softness", dims.nx)?;
        self.input_bounds.validate("input_bounds", dims.nu)?;
        self.increment_bounds.validate("increment_bounds", dims.nu)?;
        self.increment_bounds.admit_zero("increment_bounds")?;
        let rows = self.constraints.as_ref().map_or(0, |c| c.inequalities() + c.equalities());
        self.constraint_softness.validate("constraint_softness", rows)
    }

    /// The sizes of the problem with a model of dimensions `dims`.
    pub(crate) fn ocp_dims(&self, dims: Dims) -> OcpDims {
        let (inequalities, equalities) =
            self.constraints.as_ref().map_or((0, 0), |c| (c.inequalities(), c.equalities()));
        OcpDims {
            nx: dims.nx,
            nu: dims.nu,
            horizon: self.horizon,
            n_controls: self.control_horizon,
            n1: self.n1,
            inequalities,
            equalities,
        }
    }

    fn validate_weights(&self, dims: Dims) -> Result<(), MpcError> {
        check_range("tracked", self.tracked.len(), 1, dims.nx)?;
        for (i, &state) in self.tracked.iter().enumerate() {
            check_range("tracked", state, 0, dims.nx - 1)?;
            if self.tracked[..i].contains(&state) {
                return Err(MpcError::TrackedTwice { state });
            }
        }
        let Weights { q, r, terminal, .. } = &self.weights;
        q.validate("weights.q", self.tracked.len())?;
        r.validate("weights.r", dims.nu)?;
        let terminal = terminal.as_ref();
        terminal.map_or(Ok(()), |t| t.validate("weights.terminal", self.tracked.len()))
    }
}
