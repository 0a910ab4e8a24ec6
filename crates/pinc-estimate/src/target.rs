//! The steady state nearest to a reference that cannot be held otherwise.

use faer::Mat;
use faer::linalg::solvers::Solve;
use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Tracked, Weight, Weights,
};
use pinc_ode::{
    Dims, Linearization, LinearizationBuffer, Memory, Model, OutputLinearizationBuffer, Stages,
};

/// The weight of inputs in parts of the weight of states and outputs: they settle what those leave
/// open.
const INPUTS: f64 = 1e-3;

/// The weight of the change from the last steady state, in parts of the largest weight, where both are
/// taken in the sizes of the variables.
const CHANGE: f64 = 1e-6;

/// The part of a state that is taken off in each step where sizes of states are looked for, so that those
/// that integrate have one.
const LEAK: f64 = 0.01;

/// Changes by less than this part of a value are rounding.
const ROUNDING: f64 = 1e-9;

/// How often what is missed is added to what is asked for: each time the inputs' pull on the states
/// and outputs loses a factor of about [`INPUTS`] (the method of multipliers).
const ROUNDS: usize = 4;

/// The steady state x = F(x, u, p) that holds the reference of a control problem best within its
/// bounds: it minimizes the squared errors of states and outputs by Q and, among equals, the errors
/// of the inputs.
///
/// With the reference moved there, references of inputs and of more quantities than there are
/// inputs do not draw the others away: with an estimated disturbance as p the loop has no offset
/// in what can be held, whatever the weights.
#[derive(Debug)]
pub struct SteadyTarget {
    nmpc: Nmpc,
    /// Where the first search begins, (x, u) in their sizes.
    first: Vec<f64>,
    tracked: Vec<Place>,
    /// Of what is tracked: the units of `sought`.
    sizes: Vec<f64>,
    origin: Vec<f64>,
    asked: Vec<f64>,
    /// What is asked for with what was missed added.
    sought: Vec<f64>,
    held: Vec<f64>,
    status: Option<SqpStatus>,
    /// How many calls left a row as it was.
    not_found: usize,
}

impl SteadyTarget {
    /// The targets of `problem` with the model `model`, which are searched from the state `x` and
    /// the input `u` on.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if the problem does not suit the model.
    pub fn new(
        problem: &NmpcProblem,
        model: Box<dyn Model>,
        x: &[f64],
        u: &[f64],
    ) -> Result<Self, MpcError> {
        let mut model = SteadyModel::new(model);
        model.choose_sizes(problem, [x, u]);
        let (dims, inner) = (model.dims(), model.inner.dims());
        let place = |tracked: &Tracked| match *tracked {
            Tracked::State(i) => Place::State(i),
            Tracked::Output(i) => Place::Output(inner.nx + i),
            Tracked::Input(i) => Place::Input(inner.nx + i),
        };
        let tracked: Vec<_> = problem.tracked.iter().map(place).collect();
        let sizes: Vec<f64> = tracked.iter().map(|place| model.size(place)).collect();
        let q = weights(problem.weights.q.at(0), &problem.tracked, &sizes);
        let rest = Bounds::new(vec![0.0; inner.nx], vec![0.0; inner.nx]);
        let free = Bounds::none(inner.ny);
        let in_sizes = |bounds: &Bounds, sizes: &[f64]| {
            let parts = |of: &[f64]| of.iter().zip(sizes).map(|(end, size)| end / size).collect();
            Bounds::new(parts(&bounds.low), parts(&bounds.high))
        };
        let (states, inputs) = model.columns.split_at(inner.nx);
        let outputs = problem.output_bounds.as_ref();
        let outputs = outputs.map(|bounds| in_sizes(bounds, &model.rows[inner.nx..]));
        let steady = NmpcProblem {
            tracked: tracked.iter().map(Place::tracked).collect(),
            state_bounds: chain(rest, outputs.unwrap_or(free)),
            input_bounds: chain(
                in_sizes(&problem.state_bounds, states),
                in_sizes(&problem.input_bounds, inputs),
            ),
            parameters: problem.parameters.clone(),
            ..NmpcProblem::new(dims, 1, Weights::uniform(q, vec![CHANGE; dims.nu]))
        };
        let first: Vec<f64> =
            x.iter().chain(u).zip(&model.columns).map(|(value, size)| value / size).collect();
        let mut nmpc = Nmpc::new(steady, Box::new(model), SqpConfig::default())?;
        nmpc.reset_input(&first)?;
        let numbers = vec![f64::NAN; tracked.len()];
        Ok(Self {
            nmpc,
            first,
            tracked,
            sizes,
            origin: vec![0.0; dims.nx],
            asked: numbers.clone(),
            sought: numbers.clone(),
            held: numbers,
            status: None,
            not_found: 0,
        })
    }

    /// Forgets all searches: the next one begins where the first did.
    pub fn reset(&mut self) {
        // It was taken before, and is again.
        self.nmpc.reset_input(&self.first).ok();
        self.asked.fill(f64::NAN);
        (self.status, self.not_found) = (None, 0);
    }

    /// Moves each row of `reference`, `[stages, tracked]`, to what can be held with the parameters
    /// `p`; whether that succeeded. Where no steady state is found, rows stay.
    pub fn aim(&mut self, p: &[f64], reference: &mut [f64]) -> bool {
        if self.tracked.is_empty() || self.nmpc.set_parameters(p).is_err() {
            return false;
        }
        self.asked.fill(f64::NAN);
        let mut all_found = true;
        for row in reference.chunks_exact_mut(self.tracked.len()) {
            if self.asked[..] != *row {
                self.asked.copy_from_slice(row);
                self.hold();
            }
            all_found &= self.status == Some(SqpStatus::Converged);
            row.copy_from_slice(&self.held);
        }
        self.not_found += usize::from(!all_found);
        all_found
    }

    /// Finds what can be held of the row that is asked for.
    fn hold(&mut self) {
        let Self { nmpc, tracked, sizes, origin, asked, sought, held, status, .. } = self;
        sought.iter_mut().zip(asked.iter().zip(&*sizes)).for_each(|(to, (r, size))| *to = r / size);
        for _ in 0..ROUNDS {
            *status = nmpc.step(origin, sought).ok().map(|step| step.status);
            if *status != Some(SqpStatus::Converged) {
                held.copy_from_slice(asked);
                return;
            }
            let plan = nmpc.plan();
            for (i, place) in tracked.iter().enumerate() {
                let found = match *place {
                    Place::State(v) | Place::Input(v) => plan.inputs()[v],
                    Place::Output(y) => plan.states()[y],
                };
                held[i] = found * sizes[i];
                if !matches!(place, Place::Input(_)) {
                    sought[i] += asked[i] / sizes[i] - found;
                }
            }
        }
    }

    /// Saves or restores where the next search begins.
    pub fn remember(&mut self, memory: &mut Memory<'_>) {
        self.nmpc.remember(memory);
    }

    /// The last row that was asked for, and what can be held of it.
    #[must_use]
    pub fn last(&self) -> [&[f64]; 2] {
        [&self.asked, &self.held]
    }

    /// How many calls of [`SteadyTarget::aim`] left a row as it was: no steady state was found.
    #[must_use]
    pub fn not_found(&self) -> usize {
        self.not_found
    }

    /// How the last search for a steady state ended, if there was one.
    #[must_use]
    pub fn status(&self) -> Option<SqpStatus> {
        self.status
    }
}

/// Where a tracked quantity is in the one-step problem of [`SteadyModel`].
#[derive(Clone, Copy, Debug)]
enum Place {
    /// A state: among the inputs.
    State(usize),
    /// An output: among the states.
    Output(usize),
    /// An input: among the inputs.
    Input(usize),
}

impl Place {
    fn tracked(&self) -> Tracked {
        match *self {
            Self::State(v) | Self::Input(v) => Tracked::Input(v),
            Self::Output(y) => Tracked::State(y),
        }
    }
}

/// Q of quantities in these sizes, with what is tracked of inputs counting less; the largest entry is 1.
fn weights(q: &Weight, tracked: &[Tracked], sizes: &[f64]) -> Vec<Vec<f64>> {
    let part = |tracked: &Tracked| match tracked {
        Tracked::State(_) | Tracked::Output(_) => 1.0,
        Tracked::Input(_) => INPUTS.sqrt(),
    };
    let parts: Vec<f64> = tracked.iter().map(part).zip(sizes).map(|(a, b)| a * b).collect();
    let entry = |i: usize, k: usize| parts[i] * parts[k] * q.entry(i, k);
    let largest = (0..parts.len()).fold(f64::MIN_POSITIVE, |most, i| most.max(entry(i, i)));
    let row = |i: usize| (0..parts.len()).map(|k| entry(i, k) / largest).collect();
    (0..parts.len()).map(row).collect()
}

/// The size of a variable that changes by `change`, or but for rounding not at all and is `value`.
fn or_size(change: f64, value: f64) -> f64 {
    let is_known = |size: &f64| size.is_normal() && *size > ROUNDING * value.abs();
    [change, value.abs()].into_iter().find(is_known).unwrap_or(1.0)
}

/// A matrix that is stored row by row.
fn matrix(m: &[f64], rows: usize, columns: usize) -> Mat<f64> {
    Mat::from_fn(rows, columns, |i, j| m[i * columns + j])
}

fn chain(a: Bounds, b: Bounds) -> Bounds {
    Bounds::new([a.low, b.low].concat(), [a.high, b.high].concat())
}

/// A model whose input is a state and an input of another one, v = (x, u), and whose next state is
/// how far that moves, with its outputs: (F(x, u, p) - x, h(x, u, p)). Both are in parts of their sizes.
#[derive(Debug)]
struct SteadyModel {
    inner: Box<dyn Model>,
    /// The sizes of the states and outputs.
    rows: Vec<f64>,
    /// The sizes of the states and inputs.
    columns: Vec<f64>,
    x: Vec<f64>,
    u: Vec<f64>,
    moved: LinearizationBuffer,
    outputs: OutputLinearizationBuffer,
}

impl SteadyModel {
    fn new(inner: Box<dyn Model>) -> Self {
        let Dims { nx, nu, ny, .. } = inner.dims();
        Self {
            rows: vec![1.0; nx + ny],
            columns: vec![1.0; nx + nu],
            x: vec![0.0; nx],
            u: vec![0.0; nu],
            moved: LinearizationBuffer::new(inner.dims(), 1),
            outputs: OutputLinearizationBuffer::new(inner.dims(), 1),
            inner,
        }
    }

    /// Takes for sizes by how much inputs go over their ranges, and states and outputs change at steady
    /// states with each of them, to first order at the state `x` and the input `u`: dx = A dx + B du,
    /// dy = C dx + D du.
    fn choose_sizes(&mut self, problem: &NmpcProblem, [x, u]: [&[f64]; 2]) {
        let Self { inner, moved, outputs, .. } = self;
        let Dims { nx, nu, ny, .. } = inner.dims();
        let Bounds { low, high } = &problem.input_bounds;
        let range = |i: usize| Some(high[i] - low[i]).filter(|range| range.is_finite());
        let inputs: Vec<f64> = (0..nu).map(|i| or_size(range(i).unwrap_or(0.0), u[i])).collect();
        let point = Stages { x, u, p: &problem.parameters };
        inner.linearize(point, moved.as_mut());
        inner.linearize_output(point, outputs.as_mut());
        let [a, b] = [(&moved.a, nx), (&moved.b, nu)].map(|(m, columns)| matrix(m, nx, columns));
        let du = Mat::from_fn(nu, nu, |i, j| if i == j { inputs[i] } else { 0.0 });
        let kept = Mat::from_fn(nx, nx, |i, j| if i == j { 1.0 + LEAK } else { 0.0 });
        let dx = (kept - a).partial_piv_lu().solve(b * &du);
        let dy = matrix(&outputs.c, ny, nx) * &dx + matrix(&outputs.d, ny, nu) * du;
        let change = |by: &Mat<f64>, i: usize| by.row(i).iter().map(|by| by.abs()).sum::<f64>();
        let states: Vec<f64> = (0..nx).map(|i| or_size(change(&dx, i), x[i])).collect();
        let outputs: Vec<f64> = (0..ny).map(|i| or_size(change(&dy, i), outputs.y[i])).collect();
        self.rows = [&states[..], &outputs].concat();
        self.columns = [states, inputs].concat();
    }

    fn size(&self, place: &Place) -> f64 {
        match *place {
            Place::State(v) | Place::Input(v) => self.columns[v],
            Place::Output(y) => self.rows[y],
        }
    }

    /// Writes the state and the input at `v`.
    fn place(&mut self, v: &[f64]) {
        let values = self.x.iter_mut().chain(&mut self.u);
        values.zip(v.iter().zip(&self.columns)).for_each(|(to, (v, size))| *to = v * size);
    }

    /// One point.
    fn linearize_point(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.place(at.u);
        let Self { inner, rows, columns, x, u, moved, outputs } = self;
        let Dims { nx, nu, np, .. } = inner.dims();
        let point = Stages { x, u, p: at.p };
        inner.linearize(point, moved.as_mut());
        inner.linearize_output(point, outputs.as_mut());
        let wide = nx + nu;
        let Linearization { next, a, b, e: by_p } = out;
        a.fill(0.0);
        let values = moved
            .next
            .iter()
            .zip(x.iter())
            .map(|(moved, x)| moved - x)
            .chain(outputs.y.iter().copied());
        next.iter_mut().zip(values.zip(rows.iter())).for_each(|(to, (v, size))| *to = v / *size);
        for (by_x, by_u, first) in [(&moved.a, &moved.b, 0), (&outputs.c, &outputs.d, nx)] {
            let all = by_x.chunks_exact(nx).zip(by_u.chunks_exact(nu)).enumerate();
            for (i, (by_x, by_u)) in all {
                let row = &mut b[(first + i) * wide..(first + i + 1) * wide];
                row[..nx].copy_from_slice(by_x);
                row[nx..].copy_from_slice(by_u);
                if first == 0 {
                    row[i] -= 1.0;
                }
                let unit = rows[first + i];
                row.iter_mut().zip(&*columns).for_each(|(entry, size)| *entry *= size / unit);
            }
        }
        let all =
            moved.e.chunks_exact(np.max(1)).chain(outputs.e.chunks_exact(np.max(1))).zip(rows);
        for (to, (row, unit)) in by_p.chunks_exact_mut(np.max(1)).zip(all) {
            to.iter_mut().zip(row).for_each(|(to, entry)| *to = entry / *unit);
        }
    }
}

impl Model for SteadyModel {
    fn dims(&self) -> Dims {
        let Dims { nx, nu, np, ny, .. } = self.inner.dims();
        Dims::new(nx + ny, nx + nu).with_parameters(np)
    }

    fn sample_time_s(&self) -> f64 {
        self.inner.sample_time_s()
    }

    fn step(&mut self, _: &[f64], v: &[f64], p: &[f64], next: &mut [f64]) {
        self.place(v);
        let Self { inner, rows, x, u, .. } = self;
        let (moved, y) = next.split_at_mut(x.len());
        inner.step(x, u, p, moved);
        moved.iter_mut().zip(x.iter()).for_each(|(moved, x)| *moved -= x);
        inner.output(x, u, p, y);
        next.iter_mut().zip(rows).for_each(|(next, size)| *next /= *size);
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let dims = self.dims();
        for k in 0..at.count(dims) {
            self.linearize_point(at.point(k, dims), out.point(k, dims));
        }
    }
}
