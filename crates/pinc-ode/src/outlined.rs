//! A plant whose equation is called, and not compiled into what calls it.

use crate::{Plant, Variable};
use pinc_ad::Scalar;

/// A plant for code that no vectors need: its equation is compiled once for each kind of number,
/// whatever is made of it.
#[derive(Clone, Debug)]
pub(crate) struct Outlined<P>(pub(crate) P);

impl<P: Plant> Plant for Outlined<P> {
    const LONG: bool = P::LONG;
    const COLUMNS: Option<usize> = P::COLUMNS;

    fn states(&self) -> &[Variable] {
        self.0.states()
    }

    fn inputs(&self) -> &[Variable] {
        self.0.inputs()
    }

    fn parameters(&self) -> &[Variable] {
        self.0.parameters()
    }

    fn outputs(&self) -> &[Variable] {
        self.0.outputs()
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        evaluate(&self.0, x, u, p, dx);
    }

    fn output<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], y: &mut [S]) {
        self.0.output(x, u, p, y);
    }
}

/// Writes f(x, u, p) into `dx`.
#[inline(never)]
pub(crate) fn evaluate<P: Plant, S: Scalar>(plant: &P, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
    plant.rhs(x, u, p, dx);
}
