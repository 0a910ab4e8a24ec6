//! The error of a step at points, and where it is largest.

use crate::problem::{BoxError, Enclosing, StepError, TOGETHER};
use crate::rounding::{to_f64, up};
use crate::taylor::unless_nan;
use crate::workers::in_parallel;

/// Powers of the time for points.
const ORDER: usize = 10;

/// Steps of the flow, at most.
const MOST_STEPS: usize = 512;

/// Moves of a search for a larger error, and steps of the flow where it ends, at most.
pub(crate) const EFFORT: (usize, usize) = (60, MOST_STEPS);

/// What is missing may be this part of the error.
const SHARE: f64 = 1e-2;

/// The error of one step from one point.
#[derive(Clone, Debug, PartialEq)]
pub struct PointError {
    /// The model's state minus the exact one, shape `nx`.
    pub error: Vec<f64>,
    /// How far `error` may be from the true difference, shape `nx`; infinite where nothing is known.
    pub uncertainty: Vec<f64>,
}

impl PointError {
    /// A proven bound of the error's absolute value, shape `nx`; infinite where nothing is known.
    #[must_use]
    pub fn bound(&self) -> Vec<f64> {
        self.pairs().map(|(error, missing)| unless_nan(up(error.abs() + missing))).collect()
    }

    /// What the error's absolute value is at least, shape `nx`.
    #[must_use]
    pub fn least(&self) -> Vec<f64> {
        self.pairs().map(|(error, missing)| (error.abs() - missing).next_down().max(0.0)).collect()
    }

    fn pairs(&self) -> impl Iterator<Item = (f64, f64)> {
        self.error.iter().copied().zip(self.uncertainty.iter().copied())
    }

    pub(crate) fn of(found: &BoxError) -> Self {
        let polynomials = &found.polynomials;
        let missing = found.of_map.iter().zip(&found.of_flow).zip(polynomials);
        Self {
            error: polynomials.iter().map(|of| of.coefficients[0]).collect(),
            uncertainty: missing
                .map(|((map, flow), of)| {
                    let known = of.coefficients[0].is_finite();
                    if known { up(map + flow + of.rounding) } else { f64::INFINITY }
                })
                .collect(),
        }
    }

    fn is_settled(&self) -> bool {
        self.pairs().all(|(error, missing)| missing <= SHARE * error.abs())
    }

    /// Whether it says clearly more than `other`.
    fn improves(&self, other: &Self) -> bool {
        let better = |(new, old): (&f64, &f64)| *new < 0.5 * old || (*old).is_infinite();
        self.uncertainty.iter().zip(&other.uncertainty).any(better)
    }
}

impl StepError {
    /// The errors of one step from `points`, each with all states, inputs and parameters, on so many
    /// threads. The result does not depend on their number.
    #[must_use]
    pub fn at_points(&self, points: &[Vec<f64>], threads: usize) -> Vec<PointError> {
        self.at_points_in(MOST_STEPS, points, threads)
    }

    /// The errors with so many steps of the flow, at most.
    fn at_points_in(
        &self,
        most_steps: usize,
        points: &[Vec<f64>],
        threads: usize,
    ) -> Vec<PointError> {
        let over = self.enclosing_points(ORDER);
        let batches: Vec<&[Vec<f64>]> = points.chunks(TOGETHER).collect();
        let found = in_parallel(&batches, threads, |batch| self.at_few(&over, batch, most_steps));
        found.into_iter().flatten().collect()
    }

    /// At as many points as are computed together: with more and more steps of the flow, until the
    /// error is known well or no better.
    fn at_few(&self, over: &Enclosing, points: &[Vec<f64>], most_steps: usize) -> Vec<PointError> {
        let boxes: Vec<Vec<[f64; 2]>> =
            points.iter().map(|point| point.iter().map(|v| [*v, *v]).collect()).collect();
        let boxes: Vec<&[[f64; 2]]> = boxes.iter().map(Vec::as_slice).collect();
        let mut best: Vec<PointError> = Vec::new();
        let mut steps = 1;
        while steps <= most_steps {
            let found = self.enclose(over, &boxes, steps);
            let found: Vec<PointError> = found.iter().map(PointError::of).collect();
            if best.is_empty() {
                best.clone_from(&found);
            }
            let mut improved = steps < 8;
            for (best, found) in best.iter_mut().zip(found) {
                if !best.is_settled() && found.improves(best) {
                    improved = true;
                    *best = found;
                }
            }
            if !improved || best.iter().all(PointError::is_settled) {
                break;
            }
            steps *= 2;
        }
        best
    }

    /// The fewest steps of the flow, of so many at most, with which boxes as small as `points` lose
    /// at most `allowed` of each state.
    pub(crate) fn steps_for(
        &self,
        (order, most_steps): (usize, usize),
        points: &[Vec<f64>],
        allowed: &[f64],
        threads: usize,
    ) -> usize {
        let over = self.enclosing_points(order);
        let mut steps = 1;
        while steps < most_steps {
            let batches: Vec<&[Vec<f64>]> = points.chunks(TOGETHER).collect();
            let good = in_parallel(&batches, threads, |batch| {
                let boxes: Vec<Vec<[f64; 2]>> =
                    batch.iter().map(|point| point.iter().map(|v| [*v, *v]).collect()).collect();
                let boxes: Vec<&[[f64; 2]]> = boxes.iter().map(Vec::as_slice).collect();
                let found = self.enclose(&over, &boxes, steps);
                let is_good = |of: &BoxError| {
                    let flow = of.of_flow.iter().zip(allowed);
                    // A point without a solution needs no more steps.
                    flow.clone().all(|(missing, allowed)| missing <= allowed)
                        || flow.clone().any(|(missing, _)| missing.is_infinite())
                };
                found.iter().all(is_good)
            });
            if good.into_iter().all(|good| good) {
                break;
            }
            steps *= 2;
        }
        steps
    }
}

/// Points that fill a box evenly, and its corners: the sequence of Roberts, a lattice by powers of
/// the root of x^(n + 1) = x + 1, from a place that `seed` gives.
pub(crate) fn spread(domain: &[[f64; 2]], count: usize, seed: u64) -> Vec<Vec<f64>> {
    let n = domain.len();
    let root = (0..64).fold(1.5_f64, |x, _| (1.0 + x).powf(1.0 / to_f64(n + 1)));
    let begin = (seed as f64 * 0.754_877_666_246_693).fract();
    let share = |k: usize, i: usize| {
        let power = (0..=i).fold(1.0, |power, _| power / root);
        (begin + 0.5 + power * to_f64(k + 1)).fract()
    };
    let at = |[low, high]: [f64; 2], share: f64| (low + share * (high - low)).clamp(low, high);
    let inside = (0..count).map(|k| {
        domain.iter().enumerate().map(|(i, ends)| at(*ends, share(k, i))).collect::<Vec<_>>()
    });
    let corners = (0..1_usize << n).map(|corner| {
        domain.iter().enumerate().map(|(i, ends)| ends[corner >> i & 1]).collect::<Vec<_>>()
    });
    inside.chain(corners).collect()
}

/// The largest error found of one state, and where.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Largest {
    /// What the error is there at least; where that cannot be enclosed, about what it is.
    pub error: f64,
    /// All states, inputs and parameters.
    pub at: Vec<f64>,
}

/// Starts of the search for each state.
const STARTS: usize = 3;

/// The first step of the search and the last, in widths.
const FIRST_STEP: f64 = 0.05;
const LAST_STEP: f64 = 5e-4;

impl StepError {
    /// The `count` points, of 20 times as many that fill the domain, whose errors are largest by
    /// their ratio to `tolerance` (one per state), the largest first; and where searches from the
    /// worst for each state end. The errors are not enclosed.
    #[must_use]
    pub fn worst_points(
        &self,
        domain: &[[f64; 2]],
        count: usize,
        tolerance: &[f64],
        seed: u64,
        threads: usize,
    ) -> Vec<Vec<f64>> {
        let points = spread(domain, 20 * count, seed);
        let ratio = |point: &Vec<f64>| {
            let errors = self.rough(point);
            errors.iter().zip(tolerance).map(|(e, most)| e / most).fold(0.0, f64::max)
        };
        let ratios = in_parallel(&points, threads, ratio);
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|a, b| ratios[*b].total_cmp(&ratios[*a]));
        let climbed =
            self.largest(domain, &points, &vec![true; self.states()], EFFORT, threads).into_iter();
        let climbed = climbed.map(|found| found.at);
        let worst = order.into_iter().take(count).map(|i| points[i].clone());
        climbed.chain(worst).collect()
    }

    /// The largest error of each of the `judged` states among `points`, and where searches from the
    /// worst of them end; 0 for the other states. The search is in plain arithmetic; what it ends at is
    /// enclosed.
    pub(crate) fn largest(
        &self,
        domain: &[[f64; 2]],
        points: &[Vec<f64>],
        judged: &[bool],
        effort: (usize, usize),
        threads: usize,
    ) -> Vec<Largest> {
        let rough = in_parallel(points, threads, |point| self.rough(point));
        let of_state = |state: usize| {
            if !judged[state] {
                return Largest { error: 0.0, at: points[0].clone() };
            }
            let mut order: Vec<usize> = (0..points.len()).collect();
            order.sort_by(|a, b| rough[*b][state].total_cmp(&rough[*a][state]));
            let starts: Vec<usize> = order.into_iter().take(STARTS).collect();
            let climbed = in_parallel(&starts, threads, |&start| {
                self.climb(domain, &points[start], state, effort)
            });
            let better = |a: Largest, b: Largest| if b.error > a.error { b } else { a };
            climbed.into_iter().reduce(better).expect("there is a point")
        };
        (0..self.states()).map(of_state).collect()
    }

    /// The error of one state at a local maximum near `from`: the best of the neighbours along each
    /// variable, with steps that shrink where none is better, in so many moves at most; and steps of
    /// the flow where it ends.
    pub(crate) fn climb(
        &self,
        domain: &[[f64; 2]],
        from: &[f64],
        state: usize,
        (moves, most_steps): (usize, usize),
    ) -> Largest {
        let (mut best, mut step) = (from.to_vec(), FIRST_STEP);
        let mut error = self.rough(&best)[state];
        for _ in 0..moves {
            let before = error;
            for k in 0..2 * domain.len() {
                let mut at = best.clone();
                let [low, high] = domain[k / 2];
                let move_by = if k % 2 == 0 { step } else { -step } * (high - low);
                at[k / 2] = (at[k / 2] + move_by).clamp(low, high);
                let found = self.rough(&at)[state];
                if found > error {
                    (best, error) = (at, found);
                }
            }
            if error <= before {
                step *= 0.5;
            }
            if step < LAST_STEP {
                break;
            }
        }
        let enclosed = self.at_points_in(most_steps, std::slice::from_ref(&best), 1);
        // Where nothing can be enclosed, as at a kink of the equation, the error is not known exactly.
        if enclosed[0].uncertainty[state].is_finite() {
            error = enclosed[0].least()[state];
        }
        Largest { error, at: best }
    }
}
