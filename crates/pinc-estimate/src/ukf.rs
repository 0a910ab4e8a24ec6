//! The unscented Kalman filter.

use crate::estimator::{limit, variances, write_diagonal};
use crate::gate::{Gatekeeper, Judgement};
use crate::kalman::subtract;
use crate::matrix::{add_scaled, dot, factor, solve_lower};
use crate::{Correction, EstimateError, Estimator, EstimatorStatus, Tuning};
use pinc_ode::{Dims, Memory, Model, Stages};
use pinc_qp::{all_finite, symmetrize};

/// Merwe's parameters of the sigma points, beside alpha.
const BETA: f64 = 2.0;
const KAPPA: f64 = 0.0;

/// The unscented Kalman filter: mean and covariance follow from a few points through the model
/// itself, without its Jacobians. Noise is additive, and the points are drawn afresh from the
/// estimate before each correction and each prediction, alpha sqrt(nx) standard deviations from it: what the
/// model does farther off is not seen.
///
/// Reference: van der Merwe and Wan, "Sigma-point Kalman filters for probabilistic inference in
/// dynamic state-space models" (2004), the scaled points with beta = 2, kappa = 0 and [`Tuning::alpha`].
///
/// ```
/// use pinc_estimate::{Augmentation, Augmented, Estimator, Measured, Tuning, Ukf};
/// use pinc_ode::Rk4;
/// use pinc_plants::VanDerPol;
///
/// let oscillator = Rk4::new(VanDerPol::default(), 0.5, 4);
/// let position = Augmentation::measured(Measured::states([0]));
/// let model = Augmented::new(Box::new(oscillator), position)?;
/// let tuning = Tuning {
///     initial_estimate: vec![0.0; 2],
///     initial_sd: vec![1.0; 2],
///     process_sd: vec![0.02; 2],
///     measurement_sd: vec![0.1],
///     ..Tuning::default()
/// };
/// let mut filter = Ukf::new(Box::new(model), tuning)?;
/// filter.correct(&[0.93]);
/// assert!((filter.estimate()[0] - 0.93).abs() < 0.01);
/// # Ok::<(), pinc_estimate::EstimateError>(())
/// ```
#[derive(Debug)]
pub struct Ukf {
    model: Box<dyn Model>,
    tuning: Tuning,
    weights: Weights,
    /// Variances.
    q: Vec<f64>,
    r: Vec<f64>,
    /// The most that a prediction leaves of each variance.
    most: Vec<f64>,
    gate: Gatekeeper,
    z: Vec<f64>,
    p: Vec<f64>,
    u: Vec<f64>,
    /// The known parameters now.
    parameters: Vec<f64>,
    innovation: Vec<f64>,
    work: Work,
}

/// The weights of the points, for sums of differences from the one in the middle: the weights of
/// the means add up to 1, so that a mean is that point plus `pair` times the sum of the
/// differences.
#[derive(Clone, Copy, Debug)]
struct Weights {
    /// How far the points are, in standard deviations.
    spread: f64,
    /// The weight of each of the outer points.
    pair: f64,
    /// The weight of the middle one in covariances.
    middle: f64,
}

impl Weights {
    fn new(n: usize, alpha: f64) -> Self {
        let n = n as f64;
        let scaled = alpha * alpha * (n + KAPPA);
        Self {
            spread: scaled.sqrt(),
            pair: 0.5 / scaled,
            middle: (scaled - n) / scaled + 1.0 - alpha * alpha + BETA,
        }
    }
}

#[derive(Clone, Debug)]
struct Work {
    /// A root of P.
    root: Vec<f64>,
    point: Vec<f64>,
    /// P before it is widened.
    before: Vec<f64>,
    /// What the model makes of the point in the middle, and of the others less that.
    middle: Vec<f64>,
    outer: Vec<f64>,
    mean: Vec<f64>,
    /// The new estimate and its covariance.
    mean_z: Vec<f64>,
    new_p: Vec<f64>,
    /// The covariance of what is measured, its root, and its covariance with z (column by column).
    s: Vec<f64>,
    s_root: Vec<f64>,
    cross: Vec<f64>,
    /// The measurements that are there.
    present: Vec<usize>,
    residual: Vec<f64>,
}

impl Ukf {
    /// A filter with the outputs of `model` as what is measured. Until the first prediction the
    /// input is taken to be 0, or the one given to [`Estimator::reset_input`].
    ///
    /// # Errors
    ///
    /// [`EstimateError`] if the tuning does not suit the model.
    pub fn new(model: Box<dyn Model>, tuning: Tuning) -> Result<Self, EstimateError> {
        let dims = model.dims();
        tuning.validate(dims)?;
        let Dims { nx, ny, .. } = dims;
        let widest = nx.max(ny);
        let mut filter = Self {
            weights: Weights::new(nx, tuning.alpha.unwrap_or(Tuning::ALPHA)),
            q: variances(&tuning.process_sd),
            r: variances(&tuning.measurement_sd),
            most: tuning.most_variance(),
            gate: Gatekeeper::new(&tuning),
            z: vec![0.0; nx],
            p: vec![0.0; nx * nx],
            parameters: tuning.parameters.clone(),
            tuning,
            u: vec![0.0; dims.nu],
            innovation: vec![f64::NAN; ny],
            work: Work {
                root: vec![0.0; nx * nx],
                point: vec![0.0; nx],
                before: vec![0.0; nx * nx],
                middle: vec![0.0; widest],
                outer: vec![0.0; 2 * nx * widest],
                mean: vec![0.0; widest],
                mean_z: vec![0.0; nx],
                new_p: vec![0.0; nx * nx],
                s: vec![0.0; ny * ny],
                s_root: vec![0.0; ny * ny],
                cross: vec![0.0; ny * nx],
                present: Vec::with_capacity(ny),
                residual: vec![0.0; ny],
            },
            model,
        };
        filter.reset();
        Ok(filter)
    }

    /// Sends the sigma points of the estimate through `f`, which gives `width` numbers. Leaves the
    /// mean in `work.mean`, and the differences of the points from it in `work.outer`.
    fn transform(
        &mut self,
        width: usize,
        f: impl Fn(&mut dyn Model, Stages<'_>, &mut [f64]),
    ) -> EstimatorStatus {
        let n = self.z.len();
        let Self { model, z, p, u, parameters, work, weights, .. } = self;
        if !factor(p, n, &mut work.root) {
            return EstimatorStatus::IndefiniteCovariance;
        }
        f(model.as_mut(), Stages { x: z, u, p: parameters }, &mut work.middle[..width]);
        for (i, to) in work.outer[..2 * n * width].chunks_exact_mut(width).enumerate() {
            let (column, sign) = (i % n, if i < n { 1.0 } else { -1.0 });
            for (k, (point, z)) in work.point.iter_mut().zip(&*z).enumerate() {
                *point = z + sign * weights.spread * work.root[k * n + column];
            }
            f(model.as_mut(), Stages { x: &work.point, u, p: parameters }, to);
            to.iter_mut().zip(&work.middle).for_each(|(to, middle)| *to -= middle);
        }
        let mean = &mut work.mean[..width];
        mean.fill(0.0);
        for outer in work.outer[..2 * n * width].chunks_exact(width) {
            add_scaled(mean, weights.pair, outer);
        }
        for outer in work.outer[..2 * n * width].chunks_exact_mut(width) {
            add_scaled(outer, -1.0, mean);
        }
        if all_finite(&work.middle[..width]) && all_finite(&work.outer[..2 * n * width]) {
            EstimatorStatus::Updated
        } else {
            EstimatorStatus::NotFinite
        }
    }

    /// The covariances of what is measured, with itself and with z, for the measurements that are
    /// there.
    fn measurement_covariances(&mut self) {
        let (n, m) = (self.z.len(), self.r.len());
        let Work { root, outer, mean, s, cross, present, .. } = &mut self.work;
        let Weights { spread, pair, middle } = self.weights;
        let count = present.len();
        for (i, &a) in present.iter().enumerate() {
            for (j, &b) in present.iter().enumerate() {
                let points = outer[..2 * n * m].chunks_exact(m);
                let sum: f64 = points.map(|outer| outer[a] * outer[b]).sum();
                let own = if i == j { self.r[a] } else { 0.0 };
                s[i * count + j] = pair * sum + middle * mean[a] * mean[b] + own;
            }
            let cross = &mut cross[i * n..(i + 1) * n];
            cross.fill(0.0);
            for (k, outer) in outer[..2 * n * m].chunks_exact(m).enumerate() {
                let sign = if k < n { 1.0 } else { -1.0 };
                let factor = pair * sign * spread * outer[a];
                for (row, cross) in cross.iter_mut().enumerate() {
                    *cross += factor * root[row * n + k % n];
                }
            }
        }
    }

    /// The correction of estimate and covariance, once these covariances are known. Gives its status,
    /// and the normalized innovation squared, NaN if the covariance of what is measured is singular.
    fn update(&mut self) -> (EstimatorStatus, f64) {
        let n = self.z.len();
        let Work { mean_z, s, s_root, cross, present, residual, .. } = &mut self.work;
        let count = present.len();
        let (s, s_root) = (&s[..count * count], &mut s_root[..count * count]);
        if !factor(s, count, s_root) || (0..count).any(|i| s_root[i * count + i] <= 0.0) {
            return (EstimatorStatus::IndefiniteCovariance, f64::NAN);
        }
        // With S = L L': first L^-1 v and L^-1 C', then K' = L'^-1 of that.
        for (to, &i) in residual.iter_mut().zip(&*present) {
            *to = self.innovation[i];
        }
        let residual = &mut residual[..count];
        solve_lower(s_root, residual);
        for i in 0..count {
            let (before, own) = cross.split_at_mut(i * n);
            let own = &mut own[..n];
            for (k, before) in before.chunks_exact(n).enumerate() {
                add_scaled(own, -s_root[i * count + k], before);
            }
            own.iter_mut().for_each(|entry| *entry /= s_root[i * count + i]);
        }
        mean_z.copy_from_slice(&self.z);
        for (column, residual) in cross.chunks_exact(n).zip(&*residual) {
            add_scaled(mean_z, *residual, column);
        }
        for i in (0..count).rev() {
            let (upto, behind) = cross.split_at_mut((i + 1) * n);
            let own = &mut upto[i * n..];
            for (k, behind) in (i + 1..count).zip(behind.chunks_exact(n)) {
                add_scaled(own, -s_root[k * count + i], behind);
            }
            own.iter_mut().for_each(|entry| *entry /= s_root[i * count + i]);
        }
        let nis = dot(residual, residual);
        self.correct_covariance();
        (self.accept().err().unwrap_or(EstimatorStatus::Updated), nis)
    }

    /// Writes the covariance of z after the correction: the covariance of the points less the gain
    /// times their measurements, plus K R K'. As in Joseph's form, it is no difference of large
    /// numbers.
    fn correct_covariance(&mut self) {
        let (n, m) = (self.z.len(), self.r.len());
        let Work { root, outer, mean, new_p, point, cross, present, .. } = &mut self.work;
        let Weights { spread, pair, middle } = self.weights;
        new_p.fill(0.0);
        let mut add = |weight: f64, point: &[f64]| {
            for (row, entry) in new_p.chunks_exact_mut(n).zip(point) {
                add_scaled(row, weight * entry, point);
            }
        };
        let gain = || cross.chunks_exact(n).zip(&*present);
        point.fill(0.0);
        gain().for_each(|(gain, &i)| add_scaled(point, mean[i], gain));
        add(middle, point);
        for (i, outer) in outer[..2 * n * m].chunks_exact(m).enumerate() {
            let sign = if i < n { 1.0 } else { -1.0 };
            let column = root.iter().skip(i % n).step_by(n);
            point.iter_mut().zip(column).for_each(|(point, root)| *point = sign * spread * root);
            gain().for_each(|(gain, &i)| add_scaled(point, -outer[i], gain));
            add(pair, point);
        }
        gain().for_each(|(gain, &i)| add(self.r[i], gain));
    }

    /// Takes the mean and covariance in the workspace, if they are any.
    fn accept(&mut self) -> Result<(), EstimatorStatus> {
        let n = self.z.len();
        let Work { new_p, mean_z, root, .. } = &mut self.work;
        if !all_finite(mean_z) || !all_finite(new_p) {
            return Err(EstimatorStatus::NotFinite);
        }
        symmetrize(new_p, n, n);
        if !factor(new_p, n, root) {
            return Err(EstimatorStatus::IndefiniteCovariance);
        }
        self.z.copy_from_slice(mean_z);
        self.p.copy_from_slice(new_p);
        Ok(())
    }

    /// What is expected to be measured, with the innovations of what is.
    fn expect(&mut self, y: &[f64]) -> EstimatorStatus {
        let status = self.transform(y.len(), |model, at, y| model.output(at.x, at.u, at.p, y));
        let Work { middle, mean, residual, .. } = &mut self.work;
        let expected = middle.iter().zip(&*mean).map(|(middle, mean)| middle + mean);
        residual.iter_mut().zip(expected).for_each(|(to, expected)| *to = expected);
        subtract(y, residual, &mut self.innovation);
        status
    }

    /// Whether the measurement of quantity `i` passes the gate.
    fn passes(&self, i: usize) -> bool {
        let (m, Weights { pair, middle, .. }) = (self.r.len(), self.weights);
        let Work { outer, mean, .. } = &self.work;
        let points = outer[..2 * self.z.len() * m].chunks_exact(m);
        let sum: f64 = points.map(|outer| outer[i] * outer[i]).sum();
        let variance = pair * sum + middle * mean[i] * mean[i] + self.r[i];
        self.gate.passes(self.innovation[i], variance)
    }

    /// Judges the measurements that are there, and widens P if one passes only then. Those rejected
    /// are no longer there.
    fn judge(&mut self, y: &[f64]) -> Judgement {
        let (mut judgement, mut due) = (Judgement::default(), None);
        for place in 0..self.work.present.len() {
            let i = self.work.present[place];
            let passes = self.passes(i);
            self.gate.note(i, passes);
            if !passes {
                judgement.rejected += 1;
                due = due.max(self.gate.widening(i));
            }
        }
        if let Some(doublings) = due {
            self.work.before.copy_from_slice(&self.p);
            self.gate.widen(doublings, &mut self.p);
            let status = self.expect(y);
            let mut present = self.work.present.iter();
            judgement.widened = status == EstimatorStatus::Updated
                && present.any(|&i| self.gate.widening(i).is_some() && self.passes(i));
            for place in 0..self.work.present.len() {
                let i = self.work.present[place];
                if judgement.widened && self.gate.is_rejected(i) && self.passes(i) {
                    self.gate.note_reacquired(i);
                    judgement.rejected -= 1;
                }
            }
            if !judgement.widened {
                self.p.copy_from_slice(&self.work.before);
                self.expect(y);
            }
        }
        let Self { gate, innovation, work, .. } = self;
        for &i in work.present.iter().filter(|&&i| gate.is_rejected(i)) {
            innovation[i] = f64::NAN;
        }
        work.present.retain(|&i| !gate.is_rejected(i));
        judgement
    }

    /// Corrects without regard to bounds.
    fn correct_freely(&mut self, y: &[f64]) -> Correction {
        assert_eq!(y.len(), self.innovation.len(), "length of y");
        let present = &mut self.work.present;
        present.clear();
        present.extend((0..y.len()).filter(|&i| y[i].is_finite()));
        let measured = present.len();
        if measured == 0 {
            self.innovation.fill(f64::NAN);
            return Correction::unused(EstimatorStatus::NothingMeasured, 0);
        }
        let status = self.expect(y);
        if status != EstimatorStatus::Updated {
            return Correction::unused(status, measured);
        }
        let judgement = self.judge(y);
        let (mut status, mut nis) = (judgement.status(status), f64::NAN);
        let measured = self.work.present.len();
        if measured > 0 {
            self.measurement_covariances();
            let updated;
            (updated, nis) = self.update();
            if updated != EstimatorStatus::Updated {
                status = updated;
            }
        }
        let Judgement { rejected, .. } = judgement;
        Correction { nis, rejected, ..Correction::unused(status, measured) }
    }
}

impl Estimator for Ukf {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn reset(&mut self) {
        self.z.copy_from_slice(&self.tuning.initial_estimate);
        write_diagonal(&self.tuning.initial_sd, &mut self.p);
        self.gate.reset();
        self.u.fill(0.0);
        self.parameters.copy_from_slice(&self.tuning.parameters);
        self.innovation.fill(f64::NAN);
    }

    fn reset_input(&mut self, u: &[f64]) {
        self.reset();
        self.u.copy_from_slice(u);
    }

    fn set_parameters(&mut self, p: &[f64]) {
        self.parameters.copy_from_slice(p);
    }

    fn correct_within(&mut self, y: &[f64], _expired: &mut dyn FnMut() -> bool) -> Correction {
        let correction = self.correct_freely(y);
        self.tuning.clip(&mut self.z);
        correction
    }

    fn predict(&mut self, u: &[f64]) -> EstimatorStatus {
        self.u.copy_from_slice(u);
        let n = self.z.len();
        let status = self.transform(n, |model, at, next| model.step(at.x, at.u, at.p, next));
        if status != EstimatorStatus::Updated {
            return status;
        }
        let Work { new_p, mean_z, middle, mean, outer, .. } = &mut self.work;
        let Weights { pair, middle: weight, .. } = self.weights;
        for (i, row) in new_p.chunks_exact_mut(n).enumerate() {
            row.iter_mut().zip(&*mean).for_each(|(p, mean_j)| *p = weight * mean[i] * mean_j);
            for outer in outer[..2 * n * n].chunks_exact(n) {
                add_scaled(row, pair * outer[i], outer);
            }
            row[i] += self.q[i];
        }
        limit(&self.most, new_p);
        let both = mean.iter().zip(&*middle);
        mean_z.iter_mut().zip(both).for_each(|(z, (mean, middle))| *z = mean + middle);
        match self.accept() {
            Ok(()) => EstimatorStatus::Updated,
            Err(status) => status,
        }
    }

    fn estimate(&self) -> &[f64] {
        &self.z
    }

    fn covariance(&self) -> &[f64] {
        &self.p
    }

    fn innovation(&self) -> &[f64] {
        &self.innovation
    }

    fn remember(&mut self, memory: &mut Memory<'_>) {
        for part in [&mut self.z, &mut self.p, &mut self.u, &mut self.parameters] {
            memory.numbers(part);
        }
        self.gate.remember(memory);
    }
}
