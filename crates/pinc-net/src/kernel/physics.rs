//! The loss of one panel, and its derivatives in the outputs of the perceptron.

use super::dense::Cell;
use super::panels::Panel;
use crate::simd::Simd;
use crate::{Ansatz, Normalizer};
use pinc_ad::Dual;
use pinc_ode::{Dims, Plant};

/// Columns of df/dy that go through the plant together.
const DIRECTIONS: usize = 4;

/// The two terms of the loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Term {
    /// `MSE_F`: y' - f(y, u) = 0 at collocation points.
    Physics,
    /// `MSE_y`: y(0) = y0 at initial points.
    Initial,
}

/// What the loss is made of, besides the net's parameters and the points.
#[derive(Clone, Debug)]
pub(super) struct Physics<P> {
    pub(super) plant: P,
    pub(super) ansatz: Ansatz,
    pub(super) horizon_s: f64,
    pub(super) output: Normalizer,
    /// Factor of each state's residual.
    pub(super) residual_scale: Vec<f64>,
    /// Factor of each state's initial error.
    pub(super) initial_scale: Vec<f64>,
}

/// Memory for the plant's equation on dual numbers.
#[derive(Debug)]
pub(super) struct Scratch<V> {
    x: Vec<Dual<V, DIRECTIONS>>,
    u: Vec<Dual<V, DIRECTIONS>>,
    f: Vec<Dual<V, DIRECTIONS>>,
    /// dL/dy and dL/dy' of each state.
    state_adjoint: Vec<V>,
    rate_adjoint: Vec<V>,
}

impl<V: Simd> Scratch<V> {
    pub(super) fn new(dims: Dims, zero: V) -> Self {
        let states = vec![Dual::lift(zero); dims.states];
        Self {
            x: states.clone(),
            u: vec![Dual::lift(zero); dims.inputs],
            f: states,
            state_adjoint: vec![zero; dims.states],
            rate_adjoint: vec![zero; dims.states],
        }
    }
}

impl<P: Plant> Physics<P> {
    /// The sum of a panel's squared errors, lane by lane; the derivatives of `weight` times it in the
    /// perceptron's outputs z and their time tangents go into `adjoint`.
    ///
    /// # Shapes
    ///
    /// `output`, `adjoint`: one cell per state.
    #[inline(always)]
    pub(super) fn panel<V: Simd>(
        &self,
        term: Term,
        weight: f64,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        adjoint: &mut [Cell<V>],
        scratch: &mut Scratch<V>,
    ) -> V {
        let mut squares = panel.t[0].constant(0.0);
        for half in 0..2 {
            let t = panel.t[half];
            let (factor, factor_rate) = self.ansatz.factor(t, self.horizon_s);
            squares = squares
                + match term {
                    Term::Physics => self.residual(weight, panel, output, half, scratch),
                    Term::Initial => self.initial(weight, panel, output, half, scratch),
                };
            // y = base + p d, y' = p' d + p d', with d = mean + std z.
            for (i, adjoint) in adjoint.iter_mut().enumerate() {
                let std = t.constant(self.output.std[i]);
                let (y, rate) = (scratch.state_adjoint[i], scratch.rate_adjoint[i]);
                adjoint[half] = std * factor.mul_add(y, factor_rate * rate);
                adjoint[half + 2] = std * factor * rate;
            }
        }
        squares
    }

    /// State i and its time derivative, from the perceptron's output.
    #[inline(always)]
    fn state<V: Simd>(
        &self,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        half: usize,
        i: usize,
    ) -> (V, V) {
        let t = panel.t[half];
        let (mean, std) = (t.constant(self.output.mean[i]), t.constant(self.output.std[i]));
        let d = std.mul_add(output[i][half], mean);
        let d_rate = std * output[i][half + 2];
        let (factor, factor_rate) = self.ansatz.factor(t, self.horizon_s);
        let y = self.ansatz.state(t, self.horizon_s, panel.y0[i][half], d);
        (y, factor_rate.mul_add(d, factor * d_rate))
    }

    /// F = y' - f(y, u).
    #[inline(always)]
    fn residual<V: Simd>(
        &self,
        weight: f64,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        half: usize,
        scratch: &mut Scratch<V>,
    ) -> V {
        let mut squares = panel.t[half].constant(0.0);
        let Scratch { x, u, f, state_adjoint, rate_adjoint } = scratch;
        let states = x.len();
        for (to, from) in u.iter_mut().zip(panel.u) {
            *to = Dual::lift(from[half]);
        }
        for first in (0..states).step_by(DIRECTIONS) {
            for (i, x) in x.iter_mut().enumerate() {
                let (y, rate) = self.state(panel, output, half, i);
                *x = Dual::variable(y, i.checked_sub(first).unwrap_or(DIRECTIONS));
                if first == 0 {
                    rate_adjoint[i] = rate;
                }
            }
            self.plant.rhs(x, u, f);
            if first == 0 {
                for (i, rate) in rate_adjoint.iter_mut().enumerate() {
                    let scale = self.residual_scale[i];
                    let masked = (*rate - f[i].re) * panel.mask[half] * scale;
                    squares = masked.mul_add(masked, squares);
                    *rate = masked * (2.0 * weight * scale);
                }
            }
            // dL/dy_j = - sum_i dL/dF_i df_i/dy_j
            let width = DIRECTIONS.min(states - first);
            for (direction, adjoint) in state_adjoint[first..first + width].iter_mut().enumerate() {
                *adjoint = adjoint.constant(0.0);
                for (f, &rate) in f.iter().zip(rate_adjoint.iter()) {
                    *adjoint = f.eps[direction].neg_mul_add(rate, *adjoint);
                }
            }
        }
        squares
    }

    /// y(0) - y0.
    #[inline(always)]
    fn initial<V: Simd>(
        &self,
        weight: f64,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        half: usize,
        scratch: &mut Scratch<V>,
    ) -> V {
        let mut squares = panel.t[half].constant(0.0);
        for i in 0..scratch.x.len() {
            let (y, _) = self.state(panel, output, half, i);
            let scale = self.initial_scale[i];
            let masked = (y - panel.y0[i][half]) * panel.mask[half] * scale;
            squares = masked.mul_add(masked, squares);
            scratch.state_adjoint[i] = masked * (2.0 * weight * scale);
            scratch.rate_adjoint[i] = masked.constant(0.0);
        }
        squares
    }
}
