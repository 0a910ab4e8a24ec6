//! Quadratic programs made convex where they are not.

#[cfg(test)]
mod tests;

use crate::algebra::{all_finite, block_mut, symmetrize};
use crate::{Limits, Multipliers, OcpDims, Qp};

/// An eigenvalue this far below 0, in terms of the largest entry, is negative and not rounding.
const NEGATIVE: f64 = 1e-9;

/// The least curvature by an input: as part of the largest entry of its own block, and as part of
/// the cost's largest slope, so that a step along it is long but finite.
const LEAST: [f64; 2] = [1e-9, 1e-7];

/// A multiplier of a bound above this says that the bound stays active.
const ACTIVE: f64 = 1e-7;

/// The curvature that keeps a row at its limit, in terms of the Hessian's largest entry: in a program
/// that is solved, and where only the sign of other curvature matters.
const HELD: [f64; 2] = [1e4, 1e8];

/// A change of T above this part of the Hessian's largest entry is no cure: unstable dynamics, or what
/// is nearly singular, have made it of a little negative curvature.
const EXCESSIVE: f64 = 10.0;

/// The first and the largest shift that is tried, in the same terms, and by what it grows.
const SHIFTS: [f64; 2] = [1e-6, 1e6];
const GROWTH: f64 = 4.0;

/// The range of a state that weighs 1 where the Hessian is shifted.
const RANGE: f64 = 8.0;

/// Makes a program convex on its dynamics: the Riccati recursion over (`dx_j`, `du_{j-1}`), as the
/// stage-wise method has it, in which the curvature by the increment of a stage,
///
/// ```text
/// G = R_j + T_j + .. + B'P B + ..
/// ```
///
/// must be positive definite. Where it is not, its negative eigenvalues lambda become `|lambda|`
/// (and small ones a little positive), and `T_j` gets the difference. The Hessians of the states
/// may stay indefinite: where G is positive definite at all stages, the program is left as it is
/// and has one solution. Where `T_j` would change by far more than the Hessian's largest entry, delta is added
/// to the diagonal of each T and delta D to that of each Q instead ([`Qp::shift_weights`]), with the least
/// delta of a sequence with which G is
/// positive definite at all stages, as interior-point methods correct the inertia (Waechter and
/// Biegler, Math. Program. 106 (2006), section 3.1); or so it is at once, by choice ([`Convexity`]).
///
/// Before that, a program that is not convex may get curvature along its active rows, c'd = r for one
/// with a multiplier: `rho (c'd - r)^2 / 2`, which is 0 at a solution that keeps the row active, like
/// the term of an augmented Lagrangian. So curvature is changed only in directions that the active rows
/// leave free. Reference: Nocedal and Wright, *Numerical Optimization*, section 17.3.
#[derive(Debug)]
pub struct Convexifier {
    /// M and then P of each node, `[N + 1, n + m, n + m]`.
    cost_to_go: Vec<f64>,
    product: Vec<f64>,
    /// F'P F of a stage.
    merged: Vec<f64>,
    /// F, `[n, n + m]`.
    model: Vec<f64>,
    /// G, `[m, m]`, its eigenvalues, or its factor.
    pivot: Vec<f64>,
    vectors: Vec<f64>,
    /// `G^-1 M_u:`, `[m, n + m]`.
    gain: Vec<f64>,
    /// T as it was.
    plain_t: Vec<f64>,
    holds: bool,
}

/// How a program is made convex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Convexity {
    /// This part of the Hessian's largest entry is added to its diagonal, before all else.
    pub damping: f64,
    /// Whether the Hessian is shifted by a delta where curvature is negative, however little T would change.
    pub shifts: bool,
}

impl Convexifier {
    /// For programs of these sizes.
    #[must_use]
    pub fn new(dims: OcpDims) -> Self {
        let (n, m) = (dims.nx, dims.nu);
        let s = n + m;
        Self {
            cost_to_go: vec![0.0; (dims.horizon + 1) * s * s],
            product: vec![0.0; s * s],
            merged: vec![0.0; s * s],
            model: vec![0.0; n * s],
            pivot: vec![0.0; m * m],
            vectors: vec![0.0; m * m],
            gain: vec![0.0; m * s],
            plain_t: vec![0.0; dims.n_controls * m * m],
            holds: false,
        }
    }

    /// Whether the last program had to have its active rows held: it is then wrong if its solution
    /// has other ones.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.holds
    }

    /// Whether `qp`, whose Hessian is overwritten, has negative curvature along a step that keeps the
    /// rows with multipliers active: if not, a plan that meets the first-order conditions is a
    /// minimum.
    pub fn finds_descent(&mut self, qp: &mut Qp, multipliers: &Multipliers) -> bool {
        hold(qp, multipliers, HELD[1]);
        self.recur(qp, true)
    }

    /// Makes `qp`, which has a stage cost, convex; whether negative curvature was dropped. Active rows
    /// are held, if need be, where their `multipliers` are known.
    pub fn apply(
        &mut self,
        qp: &mut Qp,
        multipliers: Option<&Multipliers>,
        Convexity { damping, shifts }: Convexity,
    ) -> bool {
        self.holds = false;
        let size = largest_entry(qp);
        if damping > 0.0 {
            shift_hessian(qp, damping * size);
        }
        if let Some(multipliers) = multipliers {
            if !self.recur(qp, true) {
                return false;
            }
            hold(qp, multipliers, HELD[0]);
            self.holds = true;
        }
        self.plain_t.copy_from_slice(&qp.t);
        let dropped = self.recur(qp, shifts);
        let changes = qp.t.iter().zip(&self.plain_t).map(|(t, plain)| (t - plain).abs());
        let change = changes.fold(0.0, f64::max);
        if dropped && (shifts || change > EXCESSIVE * size || !all_finite(&qp.t)) {
            qp.t.copy_from_slice(&self.plain_t);
            self.shift(qp, size);
        }
        dropped
    }

    /// Shifts the Hessian until no curvature is negative.
    fn shift(&mut self, qp: &mut Qp, size: f64) {
        let [first, last] = SHIFTS.map(|shift| shift * size);
        let (mut shift, mut next) = (0.0, first);
        // Not from infinity to infinity.
        while next < last {
            shift_hessian(qp, next - shift);
            (shift, next) = (next, GROWTH * next);
            if !self.recur(qp, true) {
                return;
            }
        }
    }

    /// The recursion; whether curvature was negative. If so, it may end there.
    fn recur(&mut self, qp: &mut Qp, ends: bool) -> bool {
        let dims = qp.dims;
        let (n, m) = (dims.nx, dims.nu);
        let s = n + m;
        let slope = qp.gradient.iter().fold(0.0_f64, |most, g| most.max(g.abs()));
        let mut dropped = false;
        self.cost_to_go.fill(0.0);
        for node in (0..=dims.horizon).rev() {
            let (before, here) = self.cost_to_go.split_at_mut(node * s * s);
            let here = &mut here[..s * s];
            if node > 0 {
                add_cross(here, qp.s(node), (n, m));
            }
            if node < dims.n_controls {
                let own = node * m * m..(node + 1) * m * m;
                for (k, row) in qp.t[own.clone()].chunks_exact(m).enumerate() {
                    let to = &mut here[(n + k) * s + n..(n + k + 1) * s];
                    to.iter_mut().zip(row).for_each(|(to, t)| *to += t);
                }
                let (r, t) = (&qp.r[own.clone()], &mut qp.t[own]);
                let work = [&mut self.pivot[..], &mut self.vectors];
                dropped |= correct((r, slope), t, work, (here, n), ends);
                if dropped && ends {
                    return true;
                }
                eliminate(r, [&mut self.pivot, &mut self.gain], here, (n, m));
            }
            let Some(stage) = node.checked_sub(1) else { break };
            for (i, row) in qp.q(node).chunks_exact(n).enumerate() {
                let to = &mut here[i * s..i * s + n];
                to.iter_mut().zip(row).for_each(|(to, q)| *to += q);
            }
            add_cross(here, qp.s_before(node), (n, m));
            let b = &qp.b[stage * n * m..node * n * m];
            write_model(&mut self.model, qp.a(stage), b, (n, m));
            merge(here, &self.model, &mut self.product, &mut self.merged, n);
            let origin = block_mut(before, dims.origin(stage), s * s);
            origin.iter_mut().zip(&self.merged).for_each(|(to, from)| *to += from);
        }
        dropped
    }
}

/// The largest entry of D^-1/2 Q D^-1/2, R and T, at least 1.
pub(crate) fn largest_entry(qp: &Qp) -> f64 {
    let weights = &qp.shift_weights;
    let rows = qp.q.chunks_exact(weights.len()).zip(weights.iter().cycle());
    let of_q = rows
        .flat_map(|(row, d)| row.iter().zip(weights).map(move |(q, e)| q.abs() / (d * e).sqrt()));
    let inputs = qp.t.iter().chain(&qp.r).map(|entry| entry.abs());
    of_q.chain(inputs).fold(1.0, f64::max)
}

impl Qp {
    /// Weighs the states by the ranges that their bounds allow, so that a shift of the Hessian means the
    /// same whatever their units; a state without bounds by how far it goes, `range`, where that is far.
    pub fn weigh_shifts(&mut self, range: impl Fn(usize) -> f64) {
        let Self { dims, bounds, shift_weights, .. } = self;
        for (i, weight) in shift_weights.iter_mut().enumerate() {
            let nodes = (i..dims.all_states()).step_by(dims.nx);
            let widths = nodes.map(|v| bounds.high[v] - bounds.low[v]);
            let widest = widths.filter(|width| width.is_finite()).fold(0.0, f64::max);
            // A plan may go far on the way, which is to change little.
            let range = if widest > 0.0 { widest } else { (0.5 * range(i)).max(RANGE) };
            *weight = (RANGE / range).powi(2);
        }
    }
}

/// Adds delta D to Q and delta I to T.
pub(crate) fn shift_hessian(qp: &mut Qp, delta: f64) {
    let OcpDims { nx, nu, .. } = qp.dims;
    for block in qp.q.chunks_exact_mut(nx * nx) {
        let diagonal = block.iter_mut().step_by(nx + 1);
        diagonal.zip(&qp.shift_weights).for_each(|(entry, weight)| *entry += delta * weight);
    }
    for block in qp.t.chunks_exact_mut(nu * nu) {
        block.iter_mut().step_by(nu + 1).for_each(|entry| *entry += delta);
    }
}

/// Holds the rows with multipliers by curvature, a multiple of the largest entry of the Hessian.
fn hold(qp: &mut Qp, multipliers: &Multipliers, multiple: f64) {
    let rho = multiple * largest_entry(qp);
    let OcpDims { nx: n, nu: m, .. } = qp.dims;
    let states = qp.dims.all_states();
    let Qp { q, t, r, gradient, bounds, increments, dims, .. } = qp;
    for (v, mu) in multipliers.bounds.iter().enumerate() {
        let Some(limit) = held_at(bounds, v, *mu) else { continue };
        gradient[v] -= rho * limit;
        match v.checked_sub(states) {
            None => q[(v / n * n + v % n) * n + v % n] += rho,
            Some(v) => t[(v / m * m + v % m) * m + v % m] += rho,
        }
    }
    for (v, nu) in multipliers.increments.iter().enumerate() {
        let Some(limit) = held_at(increments, v, *nu) else { continue };
        gradient[states + v] -= rho * limit;
        if let Some(before) = dims.entry_before(v) {
            gradient[states + before] += rho * limit;
        }
        r[(v / m * m + v % m) * m + v % m] += rho;
    }
    for row in 0..multipliers.rows.len() {
        if let Some(limit) = held_at(&qp.rows, row, multipliers.rows[row]) {
            hold_row(qp, row, (rho, limit));
        }
    }
}

/// The limit at which a row with a multiplier stays; `None` if it is not active, or violated.
fn held_at(limits: &Limits, row: usize, multiplier: f64) -> Option<f64> {
    let active = multiplier.abs() > ACTIVE && multiplier.abs() < limits.penalty[row] - ACTIVE;
    let limit = if multiplier > 0.0 { limits.high[row] } else { limits.low[row] };
    (active && limit.is_finite()).then_some(limit)
}

/// Holds a row of h, g or outputs.
fn hold_row(qp: &mut Qp, row: usize, (rho, limit): (f64, f64)) {
    let OcpDims { nx: n, nu: m, .. } = qp.dims;
    let (node, input) = qp.dims.row_place(row);
    let Qp { dims, q, s, s_before, t, gradient, rows_x, rows_u, .. } = qp;
    let (by_x, by_u) = (&rows_x[row * n..(row + 1) * n], &rows_u[row * m..(row + 1) * m]);
    let add = |to: &mut [f64], left: &[f64], right: &[f64]| {
        for (to, left) in to.chunks_exact_mut(right.len()).zip(left) {
            to.iter_mut().zip(right).for_each(|(to, right)| *to += rho * left * right);
        }
    };
    let push = |to: &mut [f64], by: &[f64]| {
        to.iter_mut().zip(by).for_each(|(to, by)| *to -= rho * limit * by);
    };
    push(&mut gradient[dims.input(input)], by_u);
    add(&mut t[input * m * m..(input + 1) * m * m], by_u, by_u);
    let Some(state) = node.checked_sub(1) else { return };
    push(&mut gradient[dims.next_state(state)], by_x);
    add(&mut q[state * n * n..(state + 1) * n * n], by_x, by_x);
    let cross = if input == dims.acting(node) { s } else { s_before };
    // Without feedthrough a row has no input in it.
    if let Some(cross) = cross.get_mut(state * m * n..(state + 1) * m * n) {
        add(cross, by_u, by_x);
    }
}

impl Qp {
    /// Whether the rows that are active, and not violated, are the same by two sets of multipliers.
    #[must_use]
    pub fn has_same_active(&self, one: &Multipliers, other: &Multipliers) -> bool {
        let parts = [
            (&self.bounds, &one.bounds, &other.bounds),
            (&self.increments, &one.increments, &other.increments),
            (&self.rows, &one.rows, &other.rows),
        ];
        parts.into_iter().all(|(limits, one, other)| {
            let mut pairs = one.iter().zip(other).enumerate();
            pairs.all(|(row, (a, b))| held_at(limits, row, *a) == held_at(limits, row, *b))
        })
    }
}

/// F = (A B).
fn write_model(model: &mut [f64], a: &[f64], b: &[f64], (n, m): (usize, usize)) {
    for (i, row) in model.chunks_exact_mut(n + m).enumerate() {
        row[..n].copy_from_slice(&a[i * n..(i + 1) * n]);
        row[n..].copy_from_slice(&b[i * m..(i + 1) * m]);
    }
}

/// M = F'P F, with F = (A B; 0 I).
fn merge(p: &[f64], model: &[f64], product: &mut [f64], merged: &mut [f64], n: usize) {
    let s = model.len() / n;
    // P F
    for (row, p) in product.chunks_exact_mut(s).zip(p.chunks_exact(s)) {
        row[..n].fill(0.0);
        row[n..].copy_from_slice(&p[n..]);
        for (p, model) in p[..n].iter().zip(model.chunks_exact(s)) {
            row.iter_mut().zip(model).for_each(|(to, f)| *to += p * f);
        }
    }
    // F'(P F)
    merged[..n * s].fill(0.0);
    merged[n * s..].copy_from_slice(&product[n * s..]);
    for (model, product) in model.chunks_exact(s).zip(product.chunks_exact(s)) {
        for (f, to) in model.iter().zip(merged.chunks_exact_mut(s)) {
            to.iter_mut().zip(product).for_each(|(to, p)| *to += f * p);
        }
    }
    symmetrize(merged, s, s);
}

/// Makes G positive definite by changing `t` and M, unless it `ends` at a negative eigenvalue; whether
/// there was one.
fn correct(
    (r, slope): (&[f64], f64),
    t: &mut [f64],
    [pivot, vectors]: [&mut [f64]; 2],
    (cost_to_go, n): (&mut [f64], usize),
    ends: bool,
) -> bool {
    let m = vectors.len().isqrt();
    let s = n + m;
    let mut size = 0.0_f64;
    for (k, row) in pivot.chunks_exact_mut(m).enumerate() {
        let own = &cost_to_go[(n + k) * s + n..(n + k + 1) * s];
        for ((to, own), r) in row.iter_mut().zip(own).zip(&r[k * m..]) {
            *to = own + r;
            size = size.max(to.abs());
        }
    }
    diagonalize(pivot, vectors, m);
    let least = (LEAST[0] * size).max(LEAST[1] * slope).max(f64::MIN_POSITIVE);
    let negative = -(NEGATIVE * size).max(least);
    let dropped = pivot.iter().step_by(m + 1).any(|value| *value < negative);
    if dropped && ends {
        return true;
    }
    for e in 0..m {
        let value = pivot[e * m + e];
        if value >= least {
            continue;
        }
        let change = value.abs().max(least) - value;
        for i in 0..m {
            for k in 0..m {
                let part = change * vectors[i * m + e] * vectors[k * m + e];
                t[i * m + k] += part;
                cost_to_go[(n + i) * s + n + k] += part;
            }
        }
    }
    dropped
}

/// Minimizes over the increment: M becomes `M - M_:u G^-1 M_u:`.
fn eliminate(
    r: &[f64],
    [pivot, gain]: [&mut [f64]; 2],
    cost_to_go: &mut [f64],
    (n, m): (usize, usize),
) {
    let s = n + m;
    for (k, row) in pivot.chunks_exact_mut(m).enumerate() {
        let own = &cost_to_go[(n + k) * s + n..(n + k + 1) * s];
        row.iter_mut().zip(own).zip(&r[k * m..]).for_each(|((to, own), r)| *to = own + r);
    }
    gain.copy_from_slice(&cost_to_go[n * s..]);
    // L L' = G and L^-1 M_u:
    for i in 0..m {
        for k in 0..=i {
            let sum: f64 = (0..k).map(|l| pivot[i * m + l] * pivot[k * m + l]).sum();
            let left = pivot[i * m + k] - sum;
            pivot[i * m + k] =
                if i == k { left.max(f64::MIN_POSITIVE).sqrt() } else { left / pivot[k * m + k] };
        }
        let (before, here) = gain.split_at_mut(i * s);
        let row = &mut here[..s];
        for (k, before) in before.chunks_exact(s).enumerate() {
            let factor = pivot[i * m + k];
            row.iter_mut().zip(before).for_each(|(to, from)| *to -= factor * from);
        }
        row.iter_mut().for_each(|to| *to /= pivot[i * m + i]);
    }
    for gain in gain.chunks_exact(s) {
        for (factor, to) in gain.iter().zip(cost_to_go.chunks_exact_mut(s)) {
            to.iter_mut().zip(gain).for_each(|(to, gain)| *to -= factor * gain);
        }
    }
}

/// Adds `[m, n]` products of an input and a state.
fn add_cross(to: &mut [f64], products: Option<&[f64]>, (n, m): (usize, usize)) {
    let s = n + m;
    for (k, row) in products.into_iter().flat_map(|of| of.chunks_exact(n)).enumerate() {
        for (i, entry) in row.iter().enumerate() {
            to[i * s + n + k] += entry;
            to[(n + k) * s + i] += entry;
        }
    }
}

/// Jacobi's method: the eigenvalues of a symmetric matrix go to its diagonal, the eigenvectors to
/// the columns of `vectors`. Reference: Golub and Van Loan, *Matrix Computations*, section 8.5.
fn diagonalize(matrix: &mut [f64], vectors: &mut [f64], m: usize) {
    vectors.fill(0.0);
    vectors.iter_mut().step_by(m + 1).for_each(|diagonal| *diagonal = 1.0);
    for _ in 0..30 {
        let mut rotated = false;
        for i in 1..m {
            for k in 0..i {
                let off = matrix[i * m + k];
                let [a, b] = [matrix[k * m + k], matrix[i * m + i]];
                if off.abs() <= f64::EPSILON * (a.abs() * b.abs()).sqrt() + f64::MIN_POSITIVE {
                    continue;
                }
                rotated = true;
                let tau = (b - a) / (2.0 * off);
                let t = tau.signum() / (tau.abs() + tau.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                rotate(matrix, vectors, m, [k, i], [c, t * c]);
            }
        }
        if !rotated {
            return;
        }
    }
}

/// Rotates the plane of two axes.
fn rotate(matrix: &mut [f64], vectors: &mut [f64], m: usize, [k, i]: [usize; 2], [c, s]: [f64; 2]) {
    let turn = |of: &mut [f64], one: usize, other: usize| {
        let [a, b] = [of[one], of[other]];
        (of[one], of[other]) = (c * a - s * b, s * a + c * b);
    };
    for row in 0..m {
        turn(matrix, row * m + k, row * m + i);
    }
    for column in 0..m {
        turn(matrix, k * m + column, i * m + column);
        turn(vectors, column * m + k, column * m + i);
    }
}
