//! Branch and bound over the programs of a step.

use crate::sum_up;
use pinc_mpc::{NmpcProblem, PlanSearch, Programs, SqpStatus};

/// How far from a whole number an input may be that counts as one.
const WHOLE: f64 = 1e-6;

/// A program is given up if its cost is not lower than the best plan's by this part of it.
const GAP: f64 = 1e-7;

/// A search for the best plan among those in which some inputs are whole numbers.
///
/// It begins with the relaxed plan, over continuous inputs, and with its sum-up rounding (see
/// [`sum_up`]). Then it branches depth-first: the earliest input that is no whole number is bounded
/// by the whole number below it or above it, the nearer one first, and each program is solved from
/// the plan of the last. A program that costs as much as the best plan known is given up. When all
/// are solved or given up, the plan is optimal if the programs are convex, and a local optimum
/// otherwise.
///
/// If that takes more programs than are allowed, the best plan known is followed with the status
/// [`SqpStatus::Rounded`].
#[derive(Debug)]
pub struct BranchAndBound {
    /// The places of the whole inputs among the m inputs.
    whole: Vec<usize>,
    inputs: usize,
    /// The lengths of the stages of the free inputs.
    lengths: Vec<f64>,
    /// The most programs per step.
    programs: usize,
    /// The bounds of the first inputs as they were given.
    given: [Vec<f64>; 2],
    /// The bounds of the inputs, of the first ones within reach of those before.
    low: Vec<f64>,
    high: Vec<f64>,
    /// Where the search turns back, the last branch last.
    branches: Vec<Branch>,
    /// The inputs at which it branches.
    at: Vec<f64>,
    /// The best inputs known, and their cost.
    best: Vec<f64>,
    cost: f64,
}

/// An input with a bound moved to a whole number.
#[derive(Clone, Copy, Debug)]
struct Branch {
    place: usize,
    /// Both bounds before.
    bounds: [f64; 2],
    /// The bounds that were not tried yet, if there are any.
    other: Option<[f64; 2]>,
}

impl BranchAndBound {
    /// The search for `problem` with the inputs at the places `whole`, with `programs` programs per
    /// step at most beside the relaxed and the rounded one. `lengths` are the lengths of the stages of
    /// the free inputs, `Nu`, in any unit.
    ///
    /// # Panics
    ///
    /// If there is no such input, or a length for each free input.
    #[must_use]
    pub fn new(problem: &NmpcProblem, whole: &[usize], programs: usize, lengths: &[f64]) -> Self {
        let inputs = problem.weights.r.at(0).size();
        assert!(whole.iter().all(|place| *place < inputs), "places of inputs");
        assert!(lengths.len() == problem.control_horizon, "a length for each free input");
        let numbers = || vec![0.0; inputs * problem.control_horizon];
        Self {
            whole: whole.to_vec(),
            inputs,
            lengths: lengths.to_vec(),
            programs,
            given: [vec![0.0; inputs], vec![0.0; inputs]],
            low: numbers(),
            high: numbers(),
            // Each branch at a place halves its range at least.
            branches: Vec::with_capacity(64 * lengths.len() * whole.len()),
            at: numbers(),
            best: numbers(),
            cost: f64::INFINITY,
        }
    }

    /// The first whole input of `at` that is no whole number.
    fn fractional(&self) -> Option<usize> {
        let is_whole = |place: &usize| self.whole.contains(&(place % self.inputs));
        let mut places = (0..self.at.len()).filter(is_whole);
        places.find(|place| (self.at[*place] - self.at[*place].round()).abs() > WHOLE)
    }

    /// Bounds the input at `place` by the whole number next to it, and remembers the other side.
    fn branch(&mut self, place: usize, programs: &mut Programs<'_>) {
        let value = self.at[place];
        let bounds = programs.bounds_mut().map(|side| side[place]);
        let below = [bounds[0], value.floor()];
        let above = [value.ceil(), bounds[1]];
        let (first, other) =
            if value - value.floor() < 0.5 { (below, above) } else { (above, below) };
        self.branches.push(Branch { place, bounds, other: Some(other) });
        set(programs, place, first);
    }

    /// Goes to the side of the last branch that was not tried; whether there was one.
    fn turn_back(&mut self, programs: &mut Programs<'_>) -> bool {
        while let Some(Branch { place, bounds, other }) = self.branches.pop() {
            if let Some(other) = other {
                self.branches.push(Branch { place, bounds, other: None });
                set(programs, place, other);
                return true;
            }
            set(programs, place, bounds);
        }
        false
    }

    /// Holds the whole inputs of `best`, and solves for the others.
    fn hold_best(&self, programs: &mut Programs<'_>) -> SqpStatus {
        let [low, high] = programs.bounds_mut();
        low.copy_from_slice(&self.low);
        high.copy_from_slice(&self.high);
        for (place, best) in self.best.iter().enumerate() {
            if self.whole.contains(&(place % self.inputs)) {
                let held = best.round().clamp(self.low[place], self.high[place]);
                (low[place], high[place]) = (held, held);
            }
        }
        programs.solve()
    }

    /// Bounds the first whole inputs by the whole numbers that their increments admit: a program in
    /// which they were farther away would let them go there. Gives the status of the relaxed plan, which
    /// is solved again if it was beyond them.
    fn narrow(&mut self, programs: &mut Programs<'_>) -> SqpStatus {
        for (given, side) in self.given.iter_mut().zip(programs.bounds_mut()) {
            given.copy_from_slice(&side[..self.inputs]);
        }
        let mut is_within = true;
        for &place in &self.whole {
            let bounds = whole_within(programs.reach(place));
            set(programs, place, bounds);
            let u = programs.plan().inputs()[place];
            is_within &= u > bounds[0] - WHOLE && u < bounds[1] + WHOLE;
        }
        if is_within { SqpStatus::Converged } else { programs.solve() }
    }

    /// The search from the relaxed plan in `at` on: how it ended.
    fn explore(&mut self, programs: &mut Programs<'_>) -> SqpStatus {
        let mut solved = 0;
        loop {
            match self.fractional() {
                Some(place) => self.branch(place, programs),
                None => {
                    self.cost = programs.cost();
                    self.best.copy_from_slice(&self.at);
                    if !self.turn_back(programs) {
                        return SqpStatus::Converged;
                    }
                }
            }
            loop {
                if solved == self.programs {
                    return SqpStatus::Rounded;
                }
                solved += 1;
                let status = programs.solve();
                if status == SqpStatus::Deadline {
                    return status;
                }
                let enough = self.cost - GAP * (1.0 + self.cost.abs());
                let promising = !self.cost.is_finite() || programs.cost() < enough;
                if is_solved(status) && promising {
                    self.at.copy_from_slice(programs.plan().inputs());
                    break;
                }
                if !self.turn_back(programs) {
                    return SqpStatus::Converged;
                }
            }
        }
    }
}

impl PlanSearch for BranchAndBound {
    fn search(&mut self, programs: &mut Programs<'_>) -> SqpStatus {
        let narrowed = self.narrow(programs);
        let found = if is_solved(narrowed) { self.search_within(programs) } else { narrowed };
        for (given, side) in self.given.iter().zip(programs.bounds_mut()) {
            side[..self.inputs].copy_from_slice(given);
        }
        found
    }

    fn admit(&self, input: usize, u: f64, reach: [f64; 2]) -> f64 {
        if !self.whole.contains(&input) {
            return u;
        }
        let [least, most] = whole_within(reach);
        u.round().max(least).min(most)
    }
}

impl BranchAndBound {
    /// The search within the bounds that the programs have.
    fn search_within(&mut self, programs: &mut Programs<'_>) -> SqpStatus {
        self.at.copy_from_slice(programs.plan().inputs());
        let [low, high] = programs.bounds_mut();
        self.low.copy_from_slice(low);
        self.high.copy_from_slice(high);
        self.best.copy_from_slice(&self.at);
        sum_up(&mut self.best, &self.whole, &self.lengths);
        let rounded = self.hold_best(programs);
        self.cost = if is_solved(rounded) { programs.cost() } else { f64::INFINITY };
        let [low, high] = programs.bounds_mut();
        low.copy_from_slice(&self.low);
        high.copy_from_slice(&self.high);
        self.branches.clear();
        let found = match self.fractional() {
            None => SqpStatus::Converged,
            Some(_) => self.explore(programs),
        };
        let held = self.hold_best(programs);
        let [low, high] = programs.bounds_mut();
        low.copy_from_slice(&self.low);
        high.copy_from_slice(&self.high);
        if is_solved(held) { found } else { held }
    }
}

/// The least and the largest whole number in this interval, or twice the one nearest to its middle.
fn whole_within([least, most]: [f64; 2]) -> [f64; 2] {
    let both = [(least - WHOLE).ceil(), (most + WHOLE).floor()];
    if both[0] <= both[1] { both } else { [(0.5 * (least + most)).round(); 2] }
}

/// Sets both bounds of an input.
fn set(programs: &mut Programs<'_>, place: usize, bounds: [f64; 2]) {
    for (side, bound) in programs.bounds_mut().into_iter().zip(bounds) {
        side[place] = bound;
    }
}

/// Whether a program has a plan that can be followed.
fn is_solved(status: SqpStatus) -> bool {
    matches!(status, SqpStatus::Converged | SqpStatus::Stalled)
}
