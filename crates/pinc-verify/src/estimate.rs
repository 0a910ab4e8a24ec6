//! The error of one step to first order, from the residual of a net along its own path.
//!
//! With y(t) the net's path from the state x under the input u, z(t) the exact solution and
//! r = dy/dt - f(y, u) the residual, the error e = y - z obeys
//!
//! ```text
//! e' = f(y, u) - f(z, u) + r = J(y, u) e + r(t) + O(|e|^2),       e(0) = y(0) - x
//! ```
//!
//! Hence e(T) = Phi(T, 0) e(0) + integral of Phi(T, s) r(s) ds. The residual of a trained net changes
//! its sign several times within T, and the Jacobian changes slowly. The integral is therefore a
//! Gauss-Legendre quadrature, exact for residuals of degree 2 [`NODES`] - 1, and the trapezoidal
//! rule, which is stable for stiff equations too, carries Phi from node to node. All nodes are known
//! in advance, so net, equation and Jacobian are evaluated at all nodes at once in SIMD lanes.

use crate::{VerifyError, reference};
use pinc_ad::simd::{Isa, Simd, Task, Work, tanh_all};
use pinc_net::{FoldedNet, PincModel, PincNet, TrainingTarget};
use pinc_ode::{DynPlant, Model, VECTOR_DIRECTIONS, Variable, VectorDual, VectorRhs};
use std::fmt::Debug;

/// Nodes of the quadrature, and evaluations of the net: a multiple of the lanes of all vectors.
pub const NODES: usize = 8;

/// Positive nodes and weights of Gauss-Legendre quadrature on [-1, 1] with [`NODES`] nodes
/// (Abramowitz and Stegun, table 25.4), the nearest to 1 last.
const GAUSS: [[f64; 2]; NODES / 2] = [
    [0.183_434_642_495_649_8, 0.362_683_783_378_362],
    [0.525_532_409_916_329, 0.313_706_645_877_887_3],
    [0.796_666_477_413_626_7, 0.222_381_034_453_374_48],
    [0.960_289_856_497_536_3, 0.101_228_536_290_376_26],
];

/// An estimate of the error of one step of a net: the model's state minus the exact solution of the
/// plant's equation, to first order in the error. Estimating allocates nothing.
///
/// A distilled net, which knows t = T alone, has no residual. Its error is estimated as the distance
/// from a [`reference`](crate::reference()).
///
/// ```
/// use pinc_net::{Domain, NetConfig, PincNet};
/// use pinc_plants::VanDerPol;
/// use pinc_verify::ErrorEstimate;
///
/// let plant = VanDerPol::default().into_dyn();
/// let domain = Domain::new([-3.0..=3.0, -3.0..=3.0], [-1.0..=1.0]);
/// let net = PincNet::new(&*plant, &NetConfig::new(0.1, 2, 8), &domain, 1)?;
/// let mut estimate = ErrorEstimate::new(&net, &*plant)?;
/// let mut error = [0.0; 2];
/// estimate.write(&[1.0, 0.0], &[0.5], &[], &mut error);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ErrorEstimate(Method);

#[derive(Debug)]
enum Method {
    Residual(Box<dyn Residual>),
    Reference(Box<Reference>),
}

/// A net beside an integrator that stands for the exact solution.
#[derive(Debug)]
struct Reference {
    net: PincModel,
    exact: Box<dyn Model>,
    found: Vec<f64>,
}

/// [`AtNodes`] with its vector type erased.
trait Residual: Debug + Send {
    fn estimate(&mut self, x: &[f64], u: &[f64], p: &[f64], error: &mut [f64]);
}

impl ErrorEstimate {
    /// The estimate for `net` as a model of `plant`.
    ///
    /// # Errors
    ///
    /// [`VerifyError::NoEquation`] if the plant is a black box; [`VerifyError::OtherPlant`] if its states
    /// or inputs are not the net's; [`VerifyError::Net`] if the net knows one scenario only.
    pub fn new(net: &PincNet, plant: &dyn DynPlant) -> Result<Self, VerifyError> {
        Self::at(net, plant, net.sample_time_s())
    }

    /// The estimate of the net's state at `t` seconds, in (0, T].
    ///
    /// # Errors
    ///
    /// As [`ErrorEstimate::new`]; [`VerifyError::Net`] for another `t`, or one that a distilled net
    /// does not know.
    pub fn at(net: &PincNet, plant: &dyn DynPlant, t: f64) -> Result<Self, VerifyError> {
        if plant.black_box().is_some() {
            return Err(VerifyError::NoEquation);
        }
        let names =
            |of: &[Variable]| of.iter().map(|of| of.name.as_ref()).collect::<Vec<_>>().join(", ");
        for (what, net, plant) in [
            ("states", net.state_names(), names(plant.states())),
            ("inputs", net.input_names(), names(plant.inputs())),
        ] {
            let net = net.join(", ");
            if net != plant {
                return Err(VerifyError::OtherPlant { what, net, plant });
            }
        }
        let model = PincModel::at(net, t).map_err(VerifyError::Net)?;
        Ok(Self(match net.source() {
            TrainingTarget::Physics => {
                let folded = FoldedNet::new(net).map_err(VerifyError::Net)?;
                let isa = Isa::detect();
                Method::Residual(isa.dispatch(Build { net, folded, plant, isa, t }))
            }
            TrainingTarget::Integrator => {
                let (method, substeps) = reference(net, plant, t)?;
                let exact = plant.model(method, t, substeps).map_err(VerifyError::Reference)?;
                let found = vec![0.0; net.dims().nx];
                Method::Reference(Box::new(Reference { net: model, exact, found }))
            }
        }))
    }

    /// Writes the estimated error after one step from the state `x` (`nx`) under the input `u` (`nu`)
    /// with the parameters `p` (`np`) into `error` (`nx`), in the states' units; not finite where the
    /// equation is not.
    pub fn write(&mut self, x: &[f64], u: &[f64], p: &[f64], error: &mut [f64]) {
        match &mut self.0 {
            Method::Residual(residual) => residual.estimate(x, u, p, error),
            Method::Reference(of) => {
                let Reference { net, exact, found } = &mut **of;
                net.step(x, u, p, error);
                exact.step(x, u, p, found);
                error.iter_mut().zip(found).for_each(|(error, exact)| *error -= *exact);
            }
        }
    }
}

struct Build<'a> {
    net: &'a PincNet,
    folded: FoldedNet,
    plant: &'a dyn DynPlant,
    isa: Isa,
    t: f64,
}

impl Task for Build<'_> {
    type Output = Box<dyn Residual>;

    fn run<V: Simd>(self, zero: V) -> Self::Output {
        let Self { net, folded, plant, isa, t } = self;
        let n = net.dims().nx;
        let widest = folded.layers.iter().map(|layer| layer.bias.len()).max().unwrap_or(0);
        let dual = VectorDual::<V>::lift(zero);
        Box::new(AtNodes {
            zero,
            sample_time_s: net.sample_time_s(),
            length_s: t,
            rhs: plant.vectorized(isa).on::<V>(),
            entry: vec![0.0; folded.layers[0].bias.len()],
            from: vec![[zero; 2]; widest],
            to: vec![[zero; 2]; widest],
            states: vec![dual; n],
            inputs: vec![dual; net.dims().nu],
            parameters: vec![dual; net.dims().np],
            rates: vec![dual; n],
            residual: vec![0.0; n * NODES],
            jacobian: vec![0.0; n * n * NODES],
            matrix: vec![0.0; n * n],
            sum: vec![0.0; n],
            net: folded,
        })
    }
}

/// The path of a net at the nodes, one per lane, with what it takes to follow the error.
#[derive(Debug)]
struct AtNodes<V> {
    zero: V,
    /// T.
    sample_time_s: f64,
    /// The time up to which the error is followed.
    length_s: f64,
    net: FoldedNet,
    rhs: Box<dyn VectorRhs<V>>,
    /// The first layer's sums at t = T, which all nodes share but for the time.
    entry: Vec<f64>,
    /// The input and the output of a layer: values, and derivatives by the time.
    from: Vec<[V; 2]>,
    to: Vec<[V; 2]>,
    states: Vec<VectorDual<V>>,
    inputs: Vec<VectorDual<V>>,
    parameters: Vec<VectorDual<V>>,
    rates: Vec<VectorDual<V>>,
    /// r of state i at node k: at i NODES + k.
    residual: Vec<f64>,
    /// Row i, column j of the equation's Jacobian at node k: at (i n + j) NODES + k.
    jacobian: Vec<f64>,
    matrix: Vec<f64>,
    sum: Vec<f64>,
}

/// Node `k` of the quadrature, of [`NODES`], on [0, 1], and its weight there.
#[must_use]
pub fn quadrature_node(k: usize) -> [f64; 2] {
    let half = NODES / 2;
    let [at, weight] = if k < half { GAUSS[half - 1 - k] } else { GAUSS[k - half] };
    [0.5 + 0.5 * if k < half { -at } else { at }, 0.5 * weight]
}

impl<V: Simd> Residual for AtNodes<V> {
    fn estimate(&mut self, x: &[f64], u: &[f64], p: &[f64], error: &mut [f64]) {
        let zero = self.zero;
        zero.vectorize(Pass { nodes: self, x, u, p, error });
    }
}

struct Pass<'a, V> {
    nodes: &'a mut AtNodes<V>,
    x: &'a [f64],
    u: &'a [f64],
    p: &'a [f64],
    error: &'a mut [f64],
}

impl<V: Simd> Work for Pass<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { nodes, x, u, p, error } = self;
        nodes.enter([x, u, p]);
        nodes.begin(x, error);
        for first in (0..NODES).step_by(V::LANES) {
            let t = nodes.zero.generate(|lane| nodes.length_s * quadrature_node(first + lane)[0]);
            nodes.forward(t);
            nodes.judge(t, x, first);
        }
        nodes.carry(error);
    }
}

impl<V: Simd> AtNodes<V> {
    /// The first layer's sums at t = T, and what is held along the step.
    #[inline(always)]
    fn enter(&mut self, [x, u, p]: [&[f64]; 3]) {
        let layer = &self.net.layers[0];
        for ((sum, row), bias) in self.entry.iter_mut().zip(&layer.weights).zip(&layer.bias) {
            *sum = *bias;
            let (by_x, rest) = row.split_at(x.len());
            let (by_u, by_p) = rest.split_at(u.len());
            for (weights, values) in [(by_x, x), (by_u, u), (by_p, p)] {
                for (w, v) in weights.iter().zip(values) {
                    *sum += w * v;
                }
            }
        }
        for (to, from) in [(&mut self.inputs, u), (&mut self.parameters, p)] {
            for (to, from) in to.iter_mut().zip(from) {
                *to = VectorDual::<V>::lift(self.zero.constant(*from));
            }
        }
    }

    /// e(0) = y(0) - x, which a hard initial condition makes 0.
    #[inline(always)]
    fn begin(&mut self, x: &[f64], error: &mut [f64]) {
        error.fill(0.0);
        if !self.net.adds_initial_state {
            self.forward(self.zero);
            let mut lanes = [0.0; NODES];
            for (i, (error, x)) in error.iter_mut().zip(x).enumerate() {
                self.from[i][0].write(&mut lanes);
                *error = lanes[0] - x;
            }
        }
    }

    /// The net's outputs and their derivatives by the time at `t`, into `from`.
    #[inline(always)]
    fn forward(&mut self, t: V) {
        let since = t - self.zero.constant(self.sample_time_s);
        let last = self.net.layers.len() - 1;
        for (i, (sum, slope)) in self.entry.iter().zip(&self.net.time).enumerate() {
            let slope = self.zero.constant(*slope);
            self.to[i] = [slope.mul_add(since, self.zero.constant(*sum)), slope];
        }
        for l in 0..=last {
            if l > 0 {
                self.layer(l);
            }
            if l < last {
                self.activate(self.net.layers[l].bias.len());
            }
            std::mem::swap(&mut self.from, &mut self.to);
        }
    }

    /// z = W a + b, z' = W a'.
    #[inline(always)]
    fn layer(&mut self, l: usize) {
        let rows = self.net.layers[l].bias.len();
        let mut row = 0;
        while row + 4 <= rows {
            self.rows::<4>(l, row);
            row += 4;
        }
        while row < rows {
            self.rows::<1>(l, row);
            row += 1;
        }
    }

    /// `R` neurons from `first`, so many that a sum need not wait for its last product.
    #[inline(always)]
    fn rows<const R: usize>(&mut self, l: usize, first: usize) {
        let layer = &self.net.layers[l];
        let inputs = layer.weights[first].len();
        let mut weights: [&[f64]; R] = [&[]; R];
        let mut sums = [[self.zero; 2]; R];
        for r in 0..R {
            weights[r] = &layer.weights[first + r][..inputs];
            sums[r][0] = self.zero.constant(layer.bias[first + r]);
        }
        for (k, [value, slope]) in self.from[..inputs].iter().enumerate() {
            for r in 0..R {
                let weight = self.zero.constant(weights[r][k]);
                sums[r] = [weight.mul_add(*value, sums[r][0]), weight.mul_add(*slope, sums[r][1])];
            }
        }
        self.to[first..first + R].copy_from_slice(&sums);
    }

    /// a = tanh z, a' = (1 - a^2) z'.
    #[inline(always)]
    fn activate(&mut self, neurons: usize) {
        let (fours, rest) = self.to[..neurons].as_chunks_mut::<4>();
        // A closure would not be compiled for the instruction set.
        for four in fours {
            activate(four);
        }
        for one in rest.as_chunks_mut::<1>().0 {
            activate(one);
        }
    }

    /// Residual and Jacobian at the nodes from `first` on, whose outputs are in `from`.
    #[inline(always)]
    fn judge(&mut self, t: V, x: &[f64], first: usize) {
        let n = x.len();
        let share = t * self.zero.constant(1.0 / self.sample_time_s);
        let inverse = self.zero.constant(1.0 / self.sample_time_s);
        for (i, (state, x)) in self.states.iter_mut().zip(x).enumerate() {
            let [d, slope] = self.from[i];
            // y = x + t/T d, dy/dt = d/T + t/T d', or y = d.
            let (y, slope) = match self.net.adds_initial_state {
                true => (share.mul_add(d, self.zero.constant(*x)), d * inverse + share * slope),
                false => (d, slope),
            };
            *state = VectorDual::<V>::lift(y);
            slope.write(&mut self.residual[i * NODES + first..]);
        }
        for group in (0..n).step_by(VECTOR_DIRECTIONS) {
            let directions = VECTOR_DIRECTIONS.min(n - group);
            for direction in 0..directions {
                self.states[group + direction].eps[direction] = self.zero.constant(1.0);
            }
            self.rhs.rhs(&self.states, &self.inputs, &self.parameters, &mut self.rates);
            for (i, rate) in self.rates.iter().enumerate() {
                if group == 0 {
                    let residual = &mut self.residual[i * NODES + first..];
                    (self.zero.load(residual) - rate.re).write(residual);
                }
                for (direction, slope) in rate.eps[..directions].iter().enumerate() {
                    let place = i * n + group + direction;
                    slope.write(&mut self.jacobian[place * NODES + first..]);
                }
            }
            for direction in 0..directions {
                self.states[group + direction].eps[direction] = self.zero;
            }
        }
    }

    /// e(T) from e(0) in `error`: at each node e jumps by the weighted residual; in between
    /// the trapezoidal rule carries it over h seconds, by (I - h/2 J1) e1 = (I + h/2 J0) e0.
    #[inline(always)]
    fn carry(&mut self, error: &mut [f64]) {
        let n = error.len();
        let length = self.length_s;
        for k in 0..=NODES {
            let begin = if k == 0 { 0.0 } else { quadrature_node(k - 1)[0] };
            let end = if k == NODES { 1.0 } else { quadrature_node(k)[0] };
            // Before the first node and after the last the Jacobian is taken from there.
            let (before, after) = (k.saturating_sub(1), k.min(NODES - 1));
            let half = 0.5 * length * (end - begin);
            if k > 0 || !self.net.adds_initial_state {
                for i in 0..n {
                    let mut slope = 0.0;
                    for (j, error) in error.iter().enumerate() {
                        slope += self.jacobian[(i * n + j) * NODES + before] * error;
                        let own = if i == j { 1.0 } else { 0.0 };
                        let of = self.jacobian[(i * n + j) * NODES + after];
                        self.matrix[i * n + j] = own - half * of;
                    }
                    self.sum[i] = error[i] + half * slope;
                }
                solve(&mut self.matrix, &mut self.sum);
                error.copy_from_slice(&self.sum);
            }
            if k < NODES {
                let weight = length * quadrature_node(k)[1];
                for (i, error) in error.iter_mut().enumerate() {
                    *error += weight * self.residual[i * NODES + k];
                }
            }
        }
    }
}

#[inline(always)]
fn activate<V: Simd, const N: usize>(all: &mut [[V; 2]; N]) {
    let mut values = [all[0][0]; N];
    for i in 0..N {
        values[i] = all[i][0];
    }
    tanh_all(&mut values);
    for i in 0..N {
        let a = values[i];
        all[i] = [a, all[i][1] * a.neg_mul_add(a, a.constant(1.0))];
    }
}

/// Solves `matrix` x = `rhs` by elimination with the largest pivots of the columns; x is in `rhs`
/// afterwards, not finite if the matrix is singular.
fn solve(matrix: &mut [f64], rhs: &mut [f64]) {
    let n = rhs.len();
    for k in 0..n {
        let largest =
            |a: &usize, b: &usize| matrix[*a * n + k].abs().total_cmp(&matrix[*b * n + k].abs());
        let pivot = (k..n).max_by(largest).unwrap_or(k);
        if pivot != k {
            (k..n).for_each(|j| matrix.swap(k * n + j, pivot * n + j));
            rhs.swap(k, pivot);
        }
        for i in k + 1..n {
            let factor = matrix[i * n + k] / matrix[k * n + k];
            for j in k + 1..n {
                matrix[i * n + j] -= factor * matrix[k * n + j];
            }
            rhs[i] -= factor * rhs[k];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| matrix[i * n + j] * rhs[j]).sum();
        rhs[i] = (rhs[i] - known) / matrix[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_integrate_polynomials_of_degree_15_exactly() {
        for power in 0..=16_i32 {
            let sum: f64 =
                (0..NODES).map(quadrature_node).map(|[at, weight]| weight * at.powi(power)).sum();
            let exact = 1.0 / (f64::from(power) + 1.0);
            let is_exact = (sum - exact).abs() < 1e-15;
            assert_eq!(is_exact, power < to_i32(2 * NODES), "{power}: {sum} {exact}");
        }
    }

    fn to_i32(count: usize) -> i32 {
        i32::try_from(count).unwrap()
    }

    #[test]
    fn a_system_whose_first_pivot_is_zero() {
        let (mut matrix, mut rhs) =
            ([0.0, 2.0, 1.0, 1.0, 1.0, 0.0, 3.0, 0.0, 2.0], [7.0, 3.0, 9.0]);
        solve(&mut matrix, &mut rhs);
        // x = (1, 2, 3)
        let expected: [f64; 3] = [1.0, 2.0, 3.0];
        for (found, expected) in rhs.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-14, "{rhs:?}");
        }
    }
}
