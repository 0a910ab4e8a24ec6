//! The loss of one panel, and its derivatives in the outputs of the perceptron.

use super::dense::Cell;
use super::panels::{Pair, Panel, Slopes};
use crate::{Ansatz, Normalizer};
use pinc_ad::Dual;
use pinc_ad::simd::Simd;
use pinc_ode::{Dims, VECTOR_DIRECTIONS, VectorRhs};

/// Columns of df/dy that go through the plant together.
const DIRECTIONS: usize = VECTOR_DIRECTIONS;

/// The terms of the loss, in the order of their sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Term {
    /// `MSE_F`: y' - f(y, u) = 0 at collocation points.
    Physics,
    /// `MSE_y`: y(0) = y0 at initial points.
    Initial,
    /// `MSE_D`: y(t) as measured.
    Measured,
}

/// What the loss is made of, besides the net's parameters and the points.
#[derive(Debug)]
pub(super) struct Physics<V> {
    pub(super) plant: Box<dyn VectorRhs<V>>,
    pub(super) ansatz: Ansatz,
    pub(super) sample_time_s: f64,
    pub(super) output: Normalizer,
    /// Factor of each state's residual.
    pub(super) residual_scale: Vec<f64>,
    /// Factor of each state's initial error, and of its error against measurements.
    pub(super) initial_scale: Vec<f64>,
    /// Weight of the squared errors of derivatives relative to squared errors of measured states.
    pub(super) derivatives: f64,
    /// Parameters of the plant that are trained with the net; without any, the points give the
    /// plant's parameters.
    pub(super) unknown: Vec<UnknownParameter>,
}

/// A parameter of the plant that is trained with the net, by the variable q of the optimizer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct UnknownParameter {
    /// Its value at the present q.
    pub(super) value: f64,
    start: f64,
    scale: f64,
}

impl UnknownParameter {
    pub(crate) fn new(start: f64) -> Self {
        Self { value: start, start, scale: if start.abs() > 0.0 { start.abs() } else { 1.0 } }
    }

    /// Its value at `q`.
    pub(crate) fn at(&self, q: f64) -> f64 {
        self.scale.mul_add(q, self.start)
    }
}

/// Memory for the plant's equation on dual numbers.
#[derive(Debug)]
pub(super) struct PlantBuffers<V> {
    x: Vec<Dual<V, DIRECTIONS>>,
    u: Vec<Dual<V, DIRECTIONS>>,
    p: Vec<Dual<V, DIRECTIONS>>,
    f: Vec<Dual<V, DIRECTIONS>>,
    /// y' of each state.
    rate: Vec<V>,
    /// dL/dy of each state, then dL/dp of each unknown parameter.
    state_adjoint: Vec<V>,
    /// dL/dy' of each state.
    rate_adjoint: Vec<V>,
    /// dL/dq of each unknown parameter, summed over a panel.
    pub(super) unknown_adjoint: Vec<V>,
}

impl<V: Simd> PlantBuffers<V> {
    /// For a net of dimensions `dims` on a plant with as many `unknown` parameters.
    pub(super) fn new(dims: Dims, unknown: usize, zero: V) -> Self {
        let states = vec![Dual::lift(zero); dims.nx];
        Self {
            x: states.clone(),
            u: vec![Dual::lift(zero); dims.nu],
            p: vec![Dual::lift(zero); dims.np + unknown],
            f: states,
            rate: vec![zero; dims.nx],
            state_adjoint: vec![zero; dims.nx + unknown],
            rate_adjoint: vec![zero; dims.nx],
            unknown_adjoint: vec![zero; unknown],
        }
    }
}

impl<V: Simd> Physics<V> {
    /// The sum of a panel's squared errors, lane by lane; the derivatives of `weight` times it in
    /// the perceptron's outputs z and their tangents go into `adjoint`.
    ///
    /// # Shapes
    ///
    /// `output`, `adjoint`: one cell per state.
    #[inline(always)]
    pub(super) fn panel(
        &self,
        term: Term,
        weight: f64,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        adjoint: &mut [Cell<V>],
        scratch: &mut PlantBuffers<V>,
    ) -> V {
        let zero = panel.t[0].constant(0.0);
        let mut squares = zero;
        scratch.unknown_adjoint.fill(zero);
        for half in 0..2 {
            let factors = self.factors(panel, half);
            squares = squares
                + match term {
                    Term::Physics => self.residual(weight, panel, output, half, scratch),
                    Term::Initial | Term::Measured => {
                        self.deviation(weight, panel, output, half, scratch)
                    }
                };
            for (i, adjoint) in adjoint.iter_mut().enumerate() {
                let derivatives = (scratch.state_adjoint[i], scratch.rate_adjoint[i]);
                let (value, tangent) = self.through_ansatz(i, factors, derivatives);
                adjoint[half] = value;
                adjoint[half + 2] = tangent;
            }
        }
        squares
    }

    /// The derivatives of each of a panel's errors, times the root of `weight`, in the perceptron's
    /// outputs z and their tangents: with them the loss is the sum of squares. Those in the
    /// unknown parameters go into `unknown`.
    ///
    /// # Shapes
    ///
    /// `output`: one cell per state; `jacobian`: `[errors, states]`, an error per state, followed
    /// by the errors of derivatives if these are fitted; `unknown`: `[errors, unknown parameters]`.
    #[inline(always)]
    pub(super) fn linearize(
        &self,
        term: Term,
        weight: f64,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        (jacobian, unknown): (&mut [Cell<V>], &mut [Pair<V>]),
        scratch: &mut PlantBuffers<V>,
    ) {
        let (states, parameters) = (output.len(), self.unknown.len());
        let scale = match term {
            Term::Physics => &self.residual_scale,
            Term::Initial | Term::Measured => &self.initial_scale,
        };
        for half in 0..2 {
            let factors = self.factors(panel, half);
            let zero = panel.mask[half].constant(0.0);
            if panel.slopes.is_some() {
                let (_, jacobian) = jacobian.split_at_mut(states * states);
                self.linearize_slopes(weight, panel, half, jacobian);
                unknown[states * parameters..].iter_mut().for_each(|to| to[half] = zero);
            }
            for j in 0..states {
                if term == Term::Physics && j.is_multiple_of(DIRECTIONS) {
                    self.evaluate_rhs(panel, output, half, j, scratch);
                }
                for i in 0..states {
                    let mask = match term {
                        Term::Physics => panel.mask[half],
                        Term::Initial | Term::Measured => panel.targets[i].known[half],
                    };
                    let error = mask * (weight.sqrt() * scale[i]);
                    let own = if i == j { error } else { zero };
                    let derivatives = match term {
                        Term::Physics => (-scratch.f[i].eps[j % DIRECTIONS] * error, own),
                        Term::Initial | Term::Measured => (own, zero),
                    };
                    let (value, tangent) = self.through_ansatz(j, factors, derivatives);
                    jacobian[i * states + j][half] = value;
                    jacobian[i * states + j][half + 2] = tangent;
                }
            }
            for (j, parameter) in self.unknown.iter().enumerate() {
                let column = states + j;
                if term == Term::Physics && (j == 0 || column.is_multiple_of(DIRECTIONS)) {
                    let first = column / DIRECTIONS * DIRECTIONS;
                    self.evaluate_rhs(panel, output, half, first, scratch);
                }
                for i in 0..states {
                    let error = panel.mask[half] * (weight.sqrt() * scale[i] * parameter.scale);
                    unknown[i * parameters + j][half] = match term {
                        Term::Physics => -scratch.f[i].eps[column % DIRECTIONS] * error,
                        Term::Initial | Term::Measured => zero,
                    };
                }
            }
        }
    }

    /// Linearizes the errors of derivatives.
    #[inline(always)]
    fn linearize_slopes(
        &self,
        weight: f64,
        panel: Panel<'_, V>,
        half: usize,
        jacobian: &mut [Cell<V>],
    ) {
        let (states, factors) = (panel.targets.len(), self.factors(panel, half));
        let zero = panel.mask[half].constant(0.0);
        let weight = (weight * self.derivatives).sqrt();
        for (i, target) in panel.targets.iter().enumerate() {
            for j in 0..states {
                let error = target.known[half] * (weight * self.initial_scale[i]);
                let own = if i == j { error } else { zero };
                let (value, tangent) = self.through_ansatz(j, factors, (zero, own));
                jacobian[i * states + j][half] = value;
                jacobian[i * states + j][half + 2] = tangent;
            }
        }
    }

    /// The factor p of d in the state, and its derivative where the tangents lead: in time, or
    /// along a direction in which t stays the same.
    #[inline(always)]
    fn factors(&self, panel: Panel<'_, V>, half: usize) -> (V, V) {
        let (factor, rate) = self.ansatz.factor(panel.t[half], self.sample_time_s);
        (factor, if panel.slopes.is_some() { rate.constant(0.0) } else { rate })
    }

    /// From the derivatives in (y, y') of state i to those in the perceptron's output z and its
    /// tangent: y = base + p d, y' = p' d + p d', with d = mean + std z and `factors` (p, p').
    #[inline(always)]
    fn through_ansatz(
        &self,
        i: usize,
        (factor, factor_rate): (V, V),
        (state, rate): (V, V),
    ) -> (V, V) {
        let std = factor.constant(self.output.std[i]);
        (std * factor.mul_add(state, factor_rate * rate), std * factor * rate)
    }

    /// State i and its time derivative, from the perceptron's output.
    #[inline(always)]
    fn state(&self, panel: Panel<'_, V>, output: &[Cell<V>], half: usize, i: usize) -> (V, V) {
        let t = panel.t[half];
        let (mean, std) = (t.constant(self.output.mean[i]), t.constant(self.output.std[i]));
        let d = std.mul_add(output[i][half], mean);
        let d_rate = std * output[i][half + 2];
        let (factor, factor_rate) = self.ansatz.factor(t, self.sample_time_s);
        let y = self.ansatz.state(t, self.sample_time_s, panel.y0[i][half], d);
        (y, factor_rate.mul_add(d, factor * d_rate))
    }

    /// y', f(y, u, p), and the derivatives of f in the states and unknown parameters from `first`
    /// on, into the buffers.
    #[inline(always)]
    fn evaluate_rhs(
        &self,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        half: usize,
        first: usize,
        scratch: &mut PlantBuffers<V>,
    ) {
        let PlantBuffers { x, u, p, f, rate, .. } = scratch;
        for (to, from) in u.iter_mut().chain(&mut *p).zip(panel.u.iter().chain(panel.p)) {
            *to = Dual::lift(from[half]);
        }
        for (i, (x, rate)) in x.iter_mut().zip(rate).enumerate() {
            let (y, y_rate) = self.state(panel, output, half, i);
            *x = Dual::variable(y, i.checked_sub(first).unwrap_or(DIRECTIONS));
            *rate = y_rate;
        }
        for (column, (p, unknown)) in (output.len()..).zip(p.iter_mut().zip(&self.unknown)) {
            let value = panel.t[half].constant(unknown.value);
            *p = Dual::variable(value, column.checked_sub(first).unwrap_or(DIRECTIONS));
        }
        self.plant.rhs(x, u, p, f);
    }

    /// F = y' - f(y, u).
    #[inline(always)]
    fn residual(
        &self,
        weight: f64,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        half: usize,
        scratch: &mut PlantBuffers<V>,
    ) -> V {
        let mut squares = panel.t[half].constant(0.0);
        let columns = output.len() + self.unknown.len();
        for first in (0..columns).step_by(DIRECTIONS) {
            self.evaluate_rhs(panel, output, half, first, scratch);
            let PlantBuffers { f, rate, state_adjoint, rate_adjoint, .. } = &mut *scratch;
            if first == 0 {
                for (i, adjoint) in rate_adjoint.iter_mut().enumerate() {
                    let scale = self.residual_scale[i];
                    let masked = (rate[i] - f[i].re) * panel.mask[half] * scale;
                    squares = masked.mul_add(masked, squares);
                    *adjoint = masked * (2.0 * weight * scale);
                }
            }
            // dL/dy_j = - sum_i dL/dF_i df_i/dy_j
            let width = DIRECTIONS.min(columns - first);
            for (direction, adjoint) in state_adjoint[first..first + width].iter_mut().enumerate() {
                *adjoint = adjoint.constant(0.0);
                for (f, &rate) in f.iter().zip(rate_adjoint.iter()) {
                    *adjoint = f.eps[direction].neg_mul_add(rate, *adjoint);
                }
            }
        }
        let PlantBuffers { state_adjoint, unknown_adjoint, .. } = scratch;
        let of_parameters = state_adjoint[output.len()..].iter().zip(&self.unknown);
        for (sum, (&adjoint, unknown)) in unknown_adjoint.iter_mut().zip(of_parameters) {
            *sum = *sum + adjoint * unknown.scale;
        }
        squares
    }

    /// y less its target: y(0) - y0, or y(t) less its measured value, and its derivative likewise.
    #[inline(always)]
    fn deviation(
        &self,
        weight: f64,
        panel: Panel<'_, V>,
        output: &[Cell<V>],
        half: usize,
        scratch: &mut PlantBuffers<V>,
    ) -> V {
        let mut squares = panel.t[half].constant(0.0);
        for i in 0..scratch.x.len() {
            let (y, _) = self.state(panel, output, half, i);
            let scale = self.initial_scale[i];
            let target = &panel.targets[i];
            let masked = (y - target.value[half]) * target.known[half] * scale;
            squares = masked.mul_add(masked, squares);
            scratch.state_adjoint[i] = masked * (2.0 * weight * scale);
            scratch.rate_adjoint[i] = masked.constant(0.0);
            if let Some(slopes) = panel.slopes {
                let scale = scale * self.derivatives.sqrt();
                let error = self.slope(panel, slopes, output, half, i) - slopes.value[i][half];
                let masked = error * target.known[half] * scale;
                squares = masked.mul_add(masked, squares);
                scratch.rate_adjoint[i] = masked * (2.0 * weight * scale);
            }
        }
        squares
    }

    /// The derivative of state i along the panel's direction: the ansatz is linear in y0 and d.
    #[inline(always)]
    fn slope(
        &self,
        panel: Panel<'_, V>,
        slopes: Slopes<'_, V>,
        output: &[Cell<V>],
        half: usize,
        i: usize,
    ) -> V {
        let d = output[i][half + 2] * self.output.std[i];
        self.ansatz.state(panel.t[half], self.sample_time_s, slopes.direction[i][half], d)
    }
}
