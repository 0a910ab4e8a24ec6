//! General constraints on states and inputs, written once over the generic scalar.

use pinc_ad::{Dual, Scalar};
use pinc_ode::Dims;
use std::fmt::{self, Debug};
use std::sync::Arc;

/// Directions of differentiation that go through the constraints together.
const DIRECTIONS: usize = 4;

/// The functions h and g of Eqs. (`MS:ineq_const`) and (`MS:eq_const`): h(x, u) <= 0, g(x, u) = 0.
///
/// Written over the generic scalar, they get exact Jacobians.
///
/// ```
/// use pinc_ad::Scalar;
/// use pinc_mpc::StageConstraints;
///
/// /// The pump takes at most 4 W: u i <= 4, with the current i = x2.
/// #[derive(Debug)]
/// struct Power;
///
/// impl StageConstraints for Power {
///     fn inequalities(&self) -> usize {
///         1
///     }
///
///     fn evaluate<S: Scalar>(&self, x: &[S], u: &[S], h: &mut [S], _g: &mut [S]) {
///         h[0] = u[0] * x[1] - 4.0;
///     }
/// }
/// ```
pub trait StageConstraints: Debug + Send + Sync {
    /// The number of rows of h.
    fn inequalities(&self) -> usize {
        0
    }

    /// The number of rows of g.
    fn equalities(&self) -> usize {
        0
    }

    /// Writes h(x, u) and g(x, u). Every entry must be written. It may be called anywhere between
    /// the bounds of states and inputs: by their slopes there, and the sizes that bounds give, the
    /// controller chooses the units in which it computes with them.
    ///
    /// # Shapes
    ///
    /// `x`: `n`; `u`: `m`; `h`: [`StageConstraints::inequalities`]; `g`:
    /// [`StageConstraints::equalities`].
    fn evaluate<S: Scalar>(&self, x: &[S], u: &[S], h: &mut [S], g: &mut [S]);
}

/// [`StageConstraints`] of any type.
#[derive(Clone)]
pub struct Constraints(Arc<dyn Erased>);

impl Constraints {
    /// The constraints `functions`.
    pub fn new(functions: impl StageConstraints + 'static) -> Self {
        Self(Arc::new(functions))
    }

    /// The number of rows of h.
    #[must_use]
    pub fn inequalities(&self) -> usize {
        self.0.sizes().0
    }

    /// The number of rows of g.
    #[must_use]
    pub fn equalities(&self) -> usize {
        self.0.sizes().1
    }

    /// Writes (h, g) at a point and their Jacobians in x and u, row by row.
    pub(crate) fn linearize(
        &self,
        [x, u]: [&[f64]; 2],
        values: &mut [f64],
        [by_x, by_u]: [&mut [f64]; 2],
        work: &mut ConstraintWork,
    ) {
        let (n, m) = (x.len(), u.len());
        for first in (0..n + m).step_by(DIRECTIONS) {
            work.seed(x, u, first);
            self.0.differentiate(work);
            for (i, result) in work.values.iter().enumerate() {
                values[i] = result.re;
                for (column, &derivative) in (first..n + m).zip(&result.eps) {
                    if column < n {
                        by_x[i * n + column] = derivative;
                    } else {
                        by_u[i * m + column - n] = derivative;
                    }
                }
            }
        }
    }
}

impl Debug for Constraints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The arguments and results of the constraints, as dual numbers.
#[derive(Clone, Debug)]
pub(crate) struct ConstraintWork {
    x: Vec<Dual<f64, DIRECTIONS>>,
    u: Vec<Dual<f64, DIRECTIONS>>,
    values: Vec<Dual<f64, DIRECTIONS>>,
}

impl ConstraintWork {
    pub(crate) fn new(dims: Dims, rows: usize) -> Self {
        let zeros = |length| vec![Dual::lift(0.0); length];
        Self { x: zeros(dims.nx), u: zeros(dims.nu), values: zeros(rows) }
    }

    fn seed(&mut self, x: &[f64], u: &[f64], first: usize) {
        let variables = self.x.iter_mut().zip(x).chain(self.u.iter_mut().zip(u));
        for (column, (to, &value)) in variables.enumerate() {
            *to = Dual::variable(value, column.checked_sub(first).unwrap_or(DIRECTIONS));
        }
    }
}

/// What of [`StageConstraints`] can be input of any type.
trait Erased: Debug + Send + Sync {
    /// The numbers of rows of h and g.
    fn sizes(&self) -> (usize, usize);

    fn differentiate(&self, work: &mut ConstraintWork);
}

impl<C: StageConstraints> Erased for C {
    fn sizes(&self) -> (usize, usize) {
        (self.inequalities(), self.equalities())
    }

    fn differentiate(&self, work: &mut ConstraintWork) {
        let (h, g) = work.values.split_at_mut(self.inequalities());
        self.evaluate(&work.x, &work.u, h, g);
    }
}
