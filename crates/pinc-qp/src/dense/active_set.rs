//! The dual active-set method.

use super::DenseQp;
use crate::algebra::{add_scaled, all_finite, dot};
use crate::factor::{Cholesky, ThinQr};
use crate::{FARTHEST, QpWork};

/// A row counts as met when it is off by less than this, relative to 1 + |bound|.
const TOLERANCE: f64 = 1e-11;

/// A row that is off by more than this, and cannot be met, makes the QP infeasible; one that is off
/// by less depends on others that are met to rounding.
const INFEASIBLE: f64 = 1e-8;

/// A normal whose part independent of the working set is below this part of it counts as dependent.
const DEPENDENT: f64 = 1e-10;

/// A working row that is off by more than this, relative to the numbers involved, is not met.
const MET: f64 = 1e-7;

/// How many rows of the guess join the working set between two looks at the clock.
const UNASKED: usize = 8;

/// The dual method of Goldfarb and Idnani (Math. Program. 27 (1983)) for a [`DenseQp`], with bounds
/// on the multipliers and started from any guess of them.
///
/// It keeps the multipliers mu within their bounds and x optimal for the working set: the rows held
/// at a bound, whose multipliers are free. In the unknown y = L'x, where H = L L', a row's normal c
/// is L^-1 c, and the working rows' normals are Q R:
///
/// ```text
/// y = -L^-1 (g + sum_i mu_i c_i)         the minimum of the Lagrangian
/// L^-1 c_p = Q w + z                     a violated row p, split
/// y <- y - s t z,   mu_W <- mu_W - s t R^-1 w,   mu_p <- mu_p + s t
/// ```
///
/// with s = 1 at an upper bound, -1 at a lower one, and t the least at which p is met (it joins the
/// working set), a working row's multiplier comes to a limit (the row leaves it), or p's own
/// multiplier does (p stays violated, or becomes inactive). A limit is 0 or the row's penalty, so a
/// soft row costs no further unknown.
///
/// The dual objective increases with each t > 0, and a step with t = 0 makes the working set
/// smaller, so no working set is met twice except by rounding, which the limit on changes guards
/// against.
///
/// A singular H is left to the proximal point method.
///
/// All memory is allocated at construction.
#[derive(Clone, Debug)]
pub(crate) struct ActiveSet {
    cholesky: Cholesky,
    qr: ThinQr,
    working: Vec<WorkingRow>,
    pub(super) x: Vec<f64>,
    y: Vec<f64>,
    mu: Vec<f64>,
    /// (x, C x)
    pub(super) values: Vec<f64>,
    /// w, then R^-1 w
    w: Vec<f64>,
    rates: Vec<f64>,
    z: Vec<f64>,
    /// delta, 0 where H is regular.
    pub(super) proximal: f64,
    /// The point from which y is counted, 0 where H is regular, with (x, C x) there.
    pub(super) center: Vec<f64>,
    pub(super) at_center: Vec<f64>,
    /// g + H x at the center.
    pub(super) linear: Vec<f64>,
    tolerance: f64,
    pub(super) changes: usize,
    /// What all solutions took.
    pub(crate) work: QpWork,
}

/// How the solution of a [`DenseQp`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DenseStatus {
    Solved,
    /// This row contradicts others, and these do not contradict each other. The multipliers are a
    /// proof (Farkas): a combination of rows whose normals cancel and whose bounds do not.
    Infeasible(usize),
    /// H is not positive semidefinite, there is no lowest cost, or rounding won.
    Failed,
    /// The time was up.
    Expired,
    /// The time was up before the guess had been looked at; the multipliers are of no meaning.
    ExpiredAtStart,
}

/// A row in the working set, with the bound that it is held at and the limits of its multiplier.
#[derive(Clone, Copy, Debug)]
struct WorkingRow {
    row: usize,
    bound: f64,
    least: f64,
    most: f64,
}

/// A row whose multiplier has to change.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    member: WorkingRow,
    /// s
    sign: f64,
    /// By how much the row is off its bound.
    gap: f64,
}

/// What ends a step.
enum Event {
    Met,
    OwnLimit,
    Leaves(usize),
}

impl WorkingRow {
    fn new(qp: &DenseQp, row: usize, upper: bool) -> Self {
        let (low, high, penalty) = (qp.low[row], qp.high[row], qp.penalty[row]);
        let equality = low >= high;
        Self {
            row,
            bound: if upper { high } else { low },
            least: if upper && !equality { 0.0 } else { -penalty },
            most: if upper || equality { penalty } else { 0.0 },
        }
    }

    /// By how much a multiplier is outside its limits.
    fn excess(&self, mu: f64) -> f64 {
        (self.least - mu).max(mu - self.most)
    }
}

impl ActiveSet {
    pub(crate) fn new(unknowns: usize, rows: usize) -> Self {
        Self {
            cholesky: Cholesky::new(unknowns),
            qr: ThinQr::new(unknowns),
            working: Vec::with_capacity(unknowns),
            x: vec![0.0; unknowns],
            y: vec![0.0; unknowns],
            mu: vec![0.0; unknowns + rows],
            values: vec![0.0; unknowns + rows],
            w: vec![0.0; unknowns],
            rates: vec![0.0; unknowns],
            z: vec![0.0; unknowns],
            proximal: 0.0,
            center: vec![0.0; unknowns],
            at_center: vec![0.0; unknowns + rows],
            linear: vec![0.0; unknowns],
            tolerance: TOLERANCE,
            changes: 0,
            work: QpWork::default(),
        }
    }

    /// The solution.
    pub(crate) fn x(&self) -> &[f64] {
        &self.x
    }

    /// The multipliers, of the unknowns and of the rows of C: positive at upper bounds, negative at
    /// lower ones.
    pub(crate) fn multipliers(&self) -> &[f64] {
        &self.mu
    }

    /// The multipliers to start from; which are not 0 is what counts.
    pub(crate) fn guess(&mut self) -> &mut [f64] {
        &mut self.mu
    }

    /// How many rows have joined or left the working set since the start from the guess.
    #[cfg(test)]
    pub(crate) fn changes(&self) -> usize {
        self.changes
    }

    /// Solves `qp`, starting from the guess, which is the last solution if it was not changed.
    /// After each change of the working set `expired` is asked whether the time is up.
    pub(crate) fn solve(&mut self, qp: &DenseQp, expired: &mut dyn FnMut() -> bool) -> DenseStatus {
        self.changes = 0;
        self.tolerance = TOLERANCE;
        self.center.fill(0.0);
        self.at_center.fill(0.0);
        self.linear.copy_from_slice(&qp.gradient);
        match self.factor(qp, 0.0, expired) {
            Some(true) if !self.start(qp, expired) => return DenseStatus::ExpiredAtStart,
            Some(true) => match self.meet_rows(qp, expired) {
                DenseStatus::Failed => {}
                status => return status,
            },
            Some(false) => {}
            None => return DenseStatus::ExpiredAtStart,
        }
        self.solve_singular(qp, expired)
    }

    /// Factors H + delta I; `false` if it is not positive definite, `None` if the time was up.
    pub(super) fn factor(
        &mut self,
        qp: &DenseQp,
        delta: f64,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<bool> {
        self.proximal = delta;
        self.work.factorizations += 1;
        self.cholesky.factor_within(&qp.hessian, delta, expired)
    }

    /// Finds x for the working set and changes this until all rows are met.
    pub(super) fn meet_rows(
        &mut self,
        qp: &DenseQp,
        expired: &mut dyn FnMut() -> bool,
    ) -> DenseStatus {
        let most_changes = 10 * (self.mu.len() + 10);
        let mut fresh = true;
        while self.changes <= most_changes {
            self.find_x(qp);
            match self.worst(qp) {
                Some(_) if self.changes > 0 && expired() => return DenseStatus::Expired,
                Some(candidate) => {
                    fresh = false;
                    if let Some(status) = self.add_row(qp, candidate) {
                        return status;
                    }
                }
                None if fresh && self.is_met(qp) => {
                    self.clear_rounding();
                    return DenseStatus::Solved;
                }
                None if fresh => return DenseStatus::Failed,
                None => {
                    self.resolve(qp);
                    fresh = true;
                }
            }
        }
        DenseStatus::Failed
    }

    /// Brings multipliers that rounding has left outside into their limits: on the other side of a row
    /// there may be none that is finite.
    fn clear_rounding(&mut self) {
        for member in &self.working {
            let mu = &mut self.mu[member.row];
            *mu = mu.clamp(member.least, member.most);
        }
    }

    /// Whether the solution is made of numbers, as comparisons with NaN find no row that is off, and
    /// the working rows are where they are held, which rounding prevents where H is near singular.
    fn is_met(&mut self, qp: &DenseQp) -> bool {
        let near = |set: &mut Self, member: WorkingRow| {
            let off = (set.values[member.row] - member.bound).abs();
            let size = 1.0 + member.bound.abs();
            off <= MET * size || off <= MET * (size + set.terms(qp, member.row))
        };
        all_finite(&self.values)
            && all_finite(&self.mu)
            && (0..self.working.len()).all(|k| near(self, self.working[k]))
    }

    /// The sum of the absolute values of what the row's value is the sum of.
    fn terms(&mut self, qp: &DenseQp, row: usize) -> f64 {
        qp.normal(row, &mut self.z);
        self.z.iter().zip(&self.x).map(|(c, x)| (c * x).abs()).sum()
    }

    /// Makes the working set of the guess, less the rows whose multipliers it gets wrong; whether
    /// it came to the end before the time was up.
    pub(super) fn start(&mut self, qp: &DenseQp, expired: &mut dyn FnMut() -> bool) -> bool {
        self.working.clear();
        self.qr.clear();
        for row in 0..self.mu.len() {
            let mu = self.mu[row];
            // Exact: 0 is what rows outside the working set are given.
            if mu.abs() > 0.0 {
                if self.working.len() % UNASKED == UNASKED - 1 && expired() {
                    return false;
                }
                self.try_warm_row(qp, row, mu);
            }
        }
        self.resolve(qp);
        self.drop_excessive(qp);
        true
    }

    /// Takes the rows out of the working set whose multipliers are outside their limits.
    pub(super) fn drop_excessive(&mut self, qp: &DenseQp) {
        while let Some(gone) = self.most_excessive() {
            let member = self.working[gone];
            self.mu[member.row] = self.mu[member.row].clamp(member.least, member.most);
            self.work.changes += 1;
            self.leave(gone);
            self.resolve(qp);
        }
    }

    fn try_warm_row(&mut self, qp: &DenseQp, row: usize, mu: f64) {
        let member = WorkingRow::new(qp, row, mu > 0.0);
        self.mu[row] = 0.0;
        if !member.bound.is_finite() {
            return;
        }
        if mu.abs() >= qp.penalty[row] {
            self.mu[row] = mu.clamp(member.least, member.most);
            return;
        }
        let (squared, dependent) = self.split(qp, row);
        if !dependent {
            self.qr.push(&self.w, &self.z, squared);
            self.working.push(member);
        }
    }

    /// The multiplier of the working set that is furthest outside its limits.
    fn most_excessive(&self) -> Option<usize> {
        let mut worst = (None, 0.0);
        for (k, member) in self.working.iter().enumerate() {
            let excess = member.excess(self.mu[member.row]);
            if excess > worst.1 {
                worst = (Some(k), excess);
            }
        }
        worst.0
    }

    /// Splits the normal of `row` into w and z; gives |z|^2 and whether that is nothing.
    fn split(&mut self, qp: &DenseQp, row: usize) -> (f64, bool) {
        qp.normal(row, &mut self.z);
        self.cholesky.forward(&mut self.z);
        let whole = dot(&self.z, &self.z);
        let squared = self.qr.split(&mut self.z, &mut self.w);
        (squared, squared <= DEPENDENT * DEPENDENT * whole || self.working.len() == self.x.len())
    }

    /// Splits the normal of `row`, and computes the rates of the working rows' multipliers.
    fn find_rates(&mut self, qp: &DenseQp, row: usize) -> (f64, bool) {
        let split = self.split(qp, row);
        let k = self.working.len();
        self.rates[..k].copy_from_slice(&self.w[..k]);
        self.qr.solve(&mut self.rates);
        split
    }

    /// Computes y and the multipliers of the working set afresh.
    pub(super) fn resolve(&mut self, qp: &DenseQp) {
        let Self { cholesky, qr, working, y, mu, rates, z, linear, .. } = self;
        for member in working.iter() {
            mu[member.row] = 0.0;
        }
        for (y, g) in y.iter_mut().zip(&*linear) {
            *y = -g;
        }
        let mut twice = self.proximal > 0.0;
        for (row, &mu) in mu.iter().enumerate() {
            if mu.abs() > 0.0 {
                qp.normal(row, z);
                add_scaled(y, -mu, z);
                twice = true;
            }
        }
        cholesky.forward(y);
        for (rate, member) in rates.iter_mut().zip(working.iter()) {
            *rate = member.bound - self.at_center[member.row];
        }
        qr.solve_transposed(rates);
        if twice {
            // What no working row holds is as large in y as 1 / delta, or as what violations cost: twice takes
            // off what rounding leaves.
            let held = working.len();
            z[..held].copy_from_slice(&rates[..held]);
            qr.meet(y, z);
            qr.meet(y, rates);
            add_scaled(&mut rates[..held], 1.0, &z[..held]);
        } else {
            qr.meet(y, rates);
        }
        qr.solve(rates);
        for (rate, member) in rates.iter().zip(working.iter()) {
            mu[member.row] = -rate;
        }
    }

    /// The row that is most off, measured in its own units.
    fn worst(&self, qp: &DenseQp) -> Option<Candidate> {
        let mut worst = None;
        let mut largest = 0.0;
        let rows = self.values.iter().zip(&self.mu).zip(qp.low.iter().zip(&qp.high));
        for (row, ((&value, &mu), (&low, &high))) in rows.enumerate() {
            // At a bound that pulls, being inside is as wrong as being outside.
            let above = value - high;
            let below = low - value;
            let off = if mu > 0.0 {
                above.abs()
            } else if mu < 0.0 {
                below.abs()
            } else {
                above.max(below)
            };
            if off > largest {
                let found = self.candidate(qp, row);
                if found.is_some() {
                    (worst, largest) = (found, off);
                }
            }
        }
        worst
    }

    /// How to move the multiplier of `row`, if it is off and can be moved.
    fn candidate(&self, qp: &DenseQp, row: usize) -> Option<Candidate> {
        let (mu, value) = (self.mu[row], self.values[row]);
        let upper = mu > 0.0 || mu >= 0.0 && value > qp.high[row];
        let member = WorkingRow::new(qp, row, upper);
        let off = value - member.bound;
        let sign = off.signum();
        let limit = if sign > 0.0 { member.most } else { member.least };
        let negligible = self.tolerance * (1.0 + member.bound.abs());
        let wrong = off.abs() > negligible
            && sign * (limit - mu) > 0.0
            && self.working.iter().all(|member| member.row != row);
        wrong.then_some(Candidate { member, sign, gap: off.abs() })
    }

    /// Moves the multiplier of a row that is off until the row is met, or the multiplier is at its
    /// limit. Gives a status if neither can be.
    fn add_row(&mut self, qp: &DenseQp, candidate: Candidate) -> Option<DenseStatus> {
        let Candidate { member, sign, mut gap } = candidate;
        let row = member.row;
        let limit = if sign > 0.0 { member.most } else { member.least };
        loop {
            self.changes += 1;
            self.work.changes += 1;
            let (squared, dependent) = self.find_rates(qp, row);
            let full = if dependent { f64::INFINITY } else { gap / squared };
            let (mut step, mut event) = (full, Event::Met);
            let own = sign * (limit - self.mu[row]);
            if own < step {
                (step, event) = (own, Event::OwnLimit);
            }
            if let Some((t, leaving)) = self.first_at_its_limit(sign, dependent)
                && t < step
            {
                (step, event) = (t, Event::Leaves(leaving));
            }
            if step.is_infinite() {
                return self.certify_infeasible(qp, &member, sign);
            }

            self.mu[row] += sign * step;
            for (rate, member) in self.rates.iter().zip(&self.working) {
                self.mu[member.row] -= sign * step * rate;
            }
            if !dependent {
                add_scaled(&mut self.y, -sign * step, &self.z);
                gap -= step * squared;
            }
            match event {
                Event::Met => {
                    self.qr.push(&self.w, &self.z, squared);
                    self.working.push(member);
                    return None;
                }
                Event::OwnLimit => {
                    self.mu[row] = limit;
                    return None;
                }
                Event::Leaves(leaving) => {
                    let WorkingRow { row, least, most, .. } = self.working[leaving];
                    let falling = -sign * self.rates[leaving] < 0.0;
                    self.mu[row] = if falling { least } else { most };
                    self.leave(leaving);
                }
            }
        }
    }

    /// The working row whose multiplier comes to a limit first, at the rates of the step, and when.
    fn first_at_its_limit(&self, sign: f64, dependent: bool) -> Option<(f64, usize)> {
        let rates = &self.rates[..self.working.len()];
        // Against an infinite step a rate that is mere rounding would count.
        let rounding = if dependent { self.rounding() } else { 0.0 };
        let mut first = None;
        for (k, (member, rate)) in self.working.iter().zip(rates).enumerate() {
            let rate = -sign * rate;
            if rate.abs() > 0.0 && (!dependent || self.length(k) > rounding) {
                let limit = if rate > 0.0 { member.most } else { member.least };
                let t = ((limit - self.mu[member.row]) / rate).max(0.0);
                if t < first.map_or(f64::INFINITY, |(t, _)| t) {
                    first = Some((t, k));
                }
            }
        }
        first
    }

    /// A working row's rate times the length of its normal: a number in the units of the row whose
    /// multiplier changes, whatever the units of the working row.
    fn length(&self, k: usize) -> f64 {
        self.qr.norm(k) * self.rates[k].abs()
    }

    /// Where a rate's length is below this it is mere rounding.
    fn rounding(&self) -> f64 {
        let lengths = (0..self.working.len()).map(|k| self.length(k));
        DEPENDENT * lengths.fold(0.0, f64::max)
    }

    fn leave(&mut self, k: usize) {
        self.working.remove(k);
        self.qr.remove(k);
    }

    /// Computes x and (x, C x) from y.
    fn find_x(&mut self, qp: &DenseQp) {
        self.x.copy_from_slice(&self.y);
        self.cholesky.backward(&mut self.x);
        add_scaled(&mut self.x, 1.0, &self.center);
        qp.values(&self.x, &mut self.values);
    }

    /// By how much a row is off, without the rounding of the steps so far, which its rates lose too.
    fn gap_afresh(&mut self, qp: &DenseQp, member: &WorkingRow) -> f64 {
        self.resolve(qp);
        self.find_x(qp);
        self.find_rates(qp, member.row);
        (self.values[member.row] - member.bound).abs()
    }

    /// A row that is off and depends on rows that cannot yield.
    fn certify_infeasible(
        &mut self,
        qp: &DenseQp,
        member: &WorkingRow,
        sign: f64,
    ) -> Option<DenseStatus> {
        let gap = self.gap_afresh(qp, member);
        // The gap may be what rounding leaves of these.
        let terms = self.terms(qp, member.row);
        let size = 1.0 + member.bound.abs();
        if !(gap / (size + terms)).is_finite() {
            return Some(DenseStatus::Failed);
        }
        if gap <= INFEASIBLE * (size + terms) {
            // Met as well as rounding allows. Never tighter than before, or the row would come
            // back.
            self.tolerance = self.tolerance.max(2.0 * gap / size);
            return None;
        }
        self.mu.fill(0.0);
        self.mu[member.row] = sign;
        let rounding = self.rounding();
        for (k, member) in self.working.iter().enumerate() {
            if self.length(k) > rounding {
                self.mu[member.row] = -sign * self.rates[k];
            }
        }
        Some(match self.is_proof(qp) {
            true => DenseStatus::Infeasible(member.row),
            false => DenseStatus::Failed,
        })
    }

    /// Whether no x up to [`FARTHEST`] meets all rows: their combination by mu is `remainder'x`, and
    /// would have to be below `height`.
    fn is_proof(&mut self, qp: &DenseQp) -> bool {
        let remainder = &mut self.y;
        remainder.fill(0.0);
        let mut height = 0.0;
        for (row, &mu) in self.mu.iter().enumerate() {
            if mu.abs() > 0.0 {
                qp.normal(row, &mut self.z);
                add_scaled(remainder, mu, &self.z);
                height += mu * if mu > 0.0 { qp.high[row] } else { qp.low[row] };
            }
        }
        let remainder: f64 = remainder.iter().map(|part| part.abs()).sum();
        height + FARTHEST * remainder < 0.0
    }
}
