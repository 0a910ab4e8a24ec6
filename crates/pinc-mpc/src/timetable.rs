//! Values that change with the control steps, and a controller that knows them in advance.

use crate::error::{check_length, check_numbers, check_range};
use crate::guess::Phase;
use crate::reference::steps_until;
use crate::{Bounds, MpcError, Nmpc, NmpcProblem};
use pinc_ode::Dims;
use pinc_tube::Tightened;
use std::ops::Range;

/// Rows of numbers, each of which holds from a control step on, until the next: parameters, or the
/// bounds of a [`BoundSchedule`].
///
/// ```
/// use pinc_mpc::Timetable;
///
/// let price = Timetable::new(1, [(0, vec![2.0]), (6, vec![5.0])])?;
/// assert_eq!((price.at(5), price.at(100)), (&[2.0][..], &[5.0][..]));
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Timetable {
    width: usize,
    starts: Vec<usize>,
    rows: Vec<f64>,
}

impl Timetable {
    /// The timetable of `rows` of `width` numbers, each with the step from which on it holds.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a row is of another width, or the steps do not begin with 0 and increase.
    pub fn new(
        width: usize,
        rows: impl IntoIterator<Item = (usize, Vec<f64>)>,
    ) -> Result<Self, MpcError> {
        let mut all = Self { width, starts: Vec::new(), rows: Vec::new() };
        for (start, row) in rows {
            check_length("a row of the timetable", &row, width)?;
            let (low, high) = match all.starts.last() {
                None => (0, 0),
                Some(before) => (before + 1, usize::MAX),
            };
            check_range("the start of a row", start, low, high)?;
            all.starts.push(start);
            all.rows.extend(row);
        }
        check_range("the rows of a timetable", all.starts.len(), 1, usize::MAX)?;
        Ok(all)
    }

    /// The numbers of a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// The steps from which on other rows hold, the first of them 0.
    #[must_use]
    pub fn starts(&self) -> &[usize] {
        &self.starts
    }

    /// Row `i` of all.
    fn row(&self, i: usize) -> &[f64] {
        &self.rows[i * self.width..(i + 1) * self.width]
    }

    /// The row that holds in a step.
    #[must_use]
    pub fn at(&self, step: usize) -> &[f64] {
        self.row(self.starts.partition_point(|start| *start <= step) - 1)
    }

    /// The row that begins at a step, if one does.
    #[must_use]
    pub fn beginning(&self, step: usize) -> Option<&[f64]> {
        self.starts.binary_search(&step).ok().map(|i| self.row(i))
    }

    /// The rows that hold in some of these steps, at least the first's.
    fn holding(&self, steps: Range<usize>) -> impl Iterator<Item = &[f64]> {
        let first = self.starts.partition_point(|start| *start <= steps.start) - 1;
        let end = self.starts.partition_point(|start| *start < steps.end);
        (first..end.max(first + 1)).map(|i| self.row(i))
    }
}

/// Bounds on states, inputs and outputs that change with the control steps.
///
/// The bounds of step k hold in the interval from kT to (k+1)T: for the input that acts there, the states and
/// the outputs. At a mark between two steps both bounds hold; where they exclude each other, the earlier ones.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundSchedule {
    sizes: [usize; 3],
    /// The lower bounds of states, inputs and outputs, then the upper ones.
    rows: Timetable,
}

/// A quantity of the plant that may have bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounded {
    /// A state, by its place.
    State(usize),
    /// An input.
    Input(usize),
    /// An output.
    Output(usize),
}

/// What a bound is of: the place among states, inputs and outputs.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Part {
    State,
    Input,
    Output,
}

impl BoundSchedule {
    /// The bounds `rows` for a controller of `problem` with a model of dimensions `dims`.
    ///
    /// # Shapes
    ///
    /// A row: the lower bounds `[n]` of the states, `[m]` of the inputs and `[ny]` of the outputs
    /// (none of these if the problem has no bounds on outputs), then the upper ones.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a row does not suit the problem: it has finite numbers for the bounds that
    /// are finite there, and no others, and no lower bound above its upper one.
    pub fn new(rows: Timetable, problem: &NmpcProblem, dims: Dims) -> Result<Self, MpcError> {
        let ny = problem.output_bounds.as_ref().map_or(0, |_| dims.ny);
        let sizes = [dims.nx, dims.nu, ny];
        let width: usize = sizes.iter().sum();
        let problem_row = Self::row(problem, dims);
        check_length("the bounds of a step", rows.row(0), 2 * width)?;
        for row in rows.rows.chunks_exact(2 * width) {
            for (i, (value, base)) in row.iter().zip(&problem_row).enumerate() {
                let expected = if base.is_finite() {
                    "finite, as in the problem"
                } else {
                    "no bound, as in the problem"
                };
                let good = value.is_finite() == base.is_finite();
                check_numbers("bound_schedule", &row[i..=i], expected, |_| good)?;
                if let Some(high) = row.get(i + width) {
                    let expected = "at most the upper bound";
                    check_numbers("bound_schedule", &row[i..=i], expected, |low| low <= *high)?;
                }
            }
        }
        Ok(Self { sizes, rows })
    }

    /// The bounds of `problem` at its first stage, as a row.
    #[must_use]
    pub fn row(problem: &NmpcProblem, dims: Dims) -> Vec<f64> {
        let parts = [
            (Some(&problem.state_bounds), dims.nx),
            (Some(&problem.input_bounds), dims.nu),
            (problem.output_bounds.as_ref(), dims.ny),
        ];
        let side = |of: fn(&Bounds) -> &Vec<f64>| {
            parts
                .iter()
                .filter_map(move |(bounds, count)| Some(&of((*bounds)?)[..*count]))
                .flatten()
                .copied()
        };
        side(|bounds| &bounds.low).chain(side(|bounds| &bounds.high)).collect()
    }

    /// The places of a part among the lower bounds of a row.
    fn places(&self, part: Part) -> Range<usize> {
        let [n, m, ny] = self.sizes;
        match part {
            Part::State => 0..n,
            Part::Input => n..n + m,
            Part::Output => n + m..n + m + ny,
        }
    }

    /// Both bounds of a quantity in a step.
    ///
    /// # Panics
    ///
    /// If there is no such quantity.
    #[must_use]
    pub fn at(&self, step: usize, of: Bounded) -> [f64; 2] {
        let (part, i) = match of {
            Bounded::State(i) => (Part::State, i),
            Bounded::Input(i) => (Part::Input, i),
            Bounded::Output(i) => (Part::Output, i),
        };
        let (row, place) = (self.rows.at(step), self.places(part).start + i);
        [row[place], row[place + self.rows.width / 2]]
    }

    /// Writes the bounds, of those of a part that are meant, that hold in all of these steps.
    pub(crate) fn write(
        &self,
        steps: Range<usize>,
        part: Part,
        is_meant: impl Fn(usize) -> bool,
        (low, high): (&mut [f64], &mut [f64]),
    ) {
        let (places, half) = (self.places(part), self.rows.width / 2);
        for (i, row) in self.rows.holding(steps).enumerate() {
            let lows = &row[places.clone()];
            let highs = &row[places.start + half..places.end + half];
            let sides = low.iter_mut().zip(&mut *high).zip(lows.iter().zip(highs));
            for (_, ((low, high), (l, h))) in sides.enumerate().filter(|(i, _)| is_meant(*i)) {
                match i {
                    0 => (*low, *high) = (*l, *h),
                    // What excludes the earlier ones is left out.
                    _ if *l > *high || *h < *low => {}
                    _ => (*low, *high) = (low.max(*l), high.min(*h)),
                }
            }
        }
    }
}

impl Nmpc {
    /// After how many steps each stage of a plan ends.
    #[must_use]
    pub fn stage_ends(&self) -> Vec<usize> {
        let times = self.horizon.times();
        times[1..].iter().map(|&time| steps_until(time, times[1])).collect()
    }

    /// Sets the bounds of the plan that begins at control step `step`: of each stage's steps,
    /// if the controller knows them in advance (`preview`), or else of now.
    pub fn set_bounds_at(&mut self, schedule: &BoundSchedule, step: usize, preview: bool) {
        let times = self.horizon.times();
        let (delay, length) = (self.problem.delay, times[1]);
        let covered = |stage: usize| {
            if !preview {
                return step..step + 1;
            }
            let begin = if stage == 0 { 0 } else { steps_until(times[stage], length) };
            let end = steps_until(times[stage + 1], length);
            step + delay + begin..step + delay + end
        };
        self.sqp.set_bounds(schedule, covered, preview);
        let m = self.problem.input_bounds.low.len().min(schedule.sizes[1]);
        let Bounds { low, high } = &mut self.problem.input_bounds;
        let sides = (&mut low[..m], &mut high[..m]);
        schedule.write(covered(0), Part::Input, |_| true, sides);
        self.begin_anew();
        if let Some(other) = self.guard.as_mut().and_then(|guard| guard.substitute.as_mut()) {
            other.set_bounds_at(schedule, step, preview);
        }
    }

    /// Sets the parameters p of the model, or the last of them, at each stage of the plan that begins
    /// at control step `step`, from a timetable known in advance. The inputs under way, where inputs
    /// are delayed, and the substitute of a guard have the parameters of now at all stages.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if rows are longer than p.
    pub fn set_parameters_ahead(&mut self, p: &Timetable, step: usize) -> Result<(), MpcError> {
        check_range("the parameters of the timetable", p.width, 0, self.parameters.len())?;
        let kept = self.parameters.len() - p.width;
        self.parameters[kept..].copy_from_slice(p.at(step));
        let times = self.horizon.times();
        let first = step + self.problem.delay;
        let of = |stage: usize| {
            let ahead = if stage == 0 { 0 } else { steps_until(times[stage], times[1]) };
            p.at(first + ahead)
        };
        if self.sqp.set_stage_parameters(of) {
            self.begin_anew();
        }
        Ok(())
    }

    /// What its tube did to the bounds of the last step; `None` without a tube.
    #[must_use]
    pub fn tightened(&self) -> Option<Tightened<'_>> {
        self.sqp.transcription.tightened(&self.plan().z)
    }

    /// Where the last plan expects the states after each stage, the least and the greatest of each:
    /// over the branches of scenarios, or as far as the tube reaches; `None` without either.
    #[must_use]
    pub fn expected(&self) -> Option<Vec<[Vec<f64>; 2]>> {
        let dims = self.sqp.dims();
        let reach = self.tightened().map(|of| &of.back_offs.states[..]);
        if dims.tree.is_chain() && reach.is_none() {
            return None;
        }
        let mut stages: Vec<[Vec<f64>; 2]> = Vec::new();
        for (node, x) in (1..).zip(self.plan().states().chunks_exact(dims.nx)) {
            let depth = dims.tree.depth(node);
            if stages.len() < depth {
                stages.push([f64::INFINITY, f64::NEG_INFINITY].map(|end| vec![end; dims.nx]));
            }
            let [low, high] = &mut stages[depth - 1];
            for (i, x) in x.iter().enumerate() {
                let reach = reach.map_or(0.0, |reach| reach[(node - 1) * dims.nx + i]);
                (low[i], high[i]) = (low[i].min(x - reach), high[i].max(x + reach));
            }
        }
        Some(stages)
    }

    /// Whether it has a tube.
    #[must_use]
    pub fn has_tube(&self) -> bool {
        self.sqp.transcription.is_tightened()
    }

    /// Tells the tube, if there is one, how uncertain the state of the next step and the parameters of
    /// the model are: their covariance, `[n + np, n + np]`.
    pub fn set_covariance(&mut self, covariance: &[f64]) {
        if let Some(tube) = self.sqp.transcription.tube() {
            tube.set_covariance(covariance);
        }
    }

    /// What was prepared for other bounds or parameters is prepared again.
    pub(crate) fn begin_anew(&mut self) {
        if self.phase == Phase::Linearized {
            self.phase = Phase::Shifted;
        }
    }
}
