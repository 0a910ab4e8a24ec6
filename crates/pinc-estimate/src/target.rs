//! The steady state nearest to a reference that cannot be held otherwise.

use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Tracked, Weight, Weights,
};
use pinc_ode::{Dims, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages};

/// The weight of inputs in parts of the weight of states and outputs: they settle what those leave
/// open.
const INPUTS: f64 = 1e-3;

/// The weight of the change from the last steady state, in parts of the largest weight.
const CHANGE: f64 = 1e-6;

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
    tracked: Vec<Place>,
    origin: Vec<f64>,
    asked: Vec<f64>,
    /// What is asked for with what was missed added.
    sought: Vec<f64>,
    held: Vec<f64>,
    status: Option<SqpStatus>,
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
        let model = SteadyModel::new(model);
        let (dims, inner) = (model.dims(), model.inner.dims());
        let place = |tracked: &Tracked| match *tracked {
            Tracked::State(i) => Place::State(i),
            Tracked::Output(i) => Place::Output(inner.nx + i),
            Tracked::Input(i) => Place::Input(inner.nx + i),
        };
        let tracked: Vec<_> = problem.tracked.iter().map(place).collect();
        let q = weights(problem.weights.q.at(0), &problem.tracked);
        let largest = (0..q.len()).fold(0.0_f64, |most, i| most.max(q[i][i]));
        let rest = Bounds::new(vec![0.0; inner.nx], vec![0.0; inner.nx]);
        let free = Bounds::none(inner.ny);
        let first = |bounds: &Bounds, count: usize| {
            Bounds::new(bounds.low[..count].to_vec(), bounds.high[..count].to_vec())
        };
        let outputs = problem.output_bounds.as_ref().map(|bounds| first(bounds, inner.ny));
        let r = vec![CHANGE * largest.max(f64::MIN_POSITIVE); dims.nu];
        let steady = NmpcProblem {
            tracked: tracked.iter().map(Place::tracked).collect(),
            state_bounds: chain(rest, outputs.unwrap_or(free)),
            input_bounds: chain(
                first(&problem.state_bounds, inner.nx),
                first(&problem.input_bounds, inner.nu),
            ),
            parameters: problem.parameters.clone(),
            ..NmpcProblem::new(dims, 1, Weights::uniform(q, r))
        };
        let mut nmpc = Nmpc::new(steady, Box::new(model), SqpConfig::default())?;
        nmpc.reset_input(&[x, u].concat())?;
        let numbers = vec![f64::NAN; tracked.len()];
        Ok(Self {
            nmpc,
            tracked,
            origin: vec![0.0; dims.nx],
            asked: numbers.clone(),
            sought: numbers.clone(),
            held: numbers,
            status: None,
        })
    }

    /// Moves each row of `reference`, `[stages, tracked]`, to what can be held with the parameters
    /// `p`. Where no steady state is found, rows stay.
    pub fn aim(&mut self, p: &[f64], reference: &mut [f64]) {
        if self.tracked.is_empty() || self.nmpc.set_parameters(p).is_err() {
            return;
        }
        self.asked.fill(f64::NAN);
        for row in reference.chunks_exact_mut(self.tracked.len()) {
            if self.asked[..] != *row {
                self.asked.copy_from_slice(row);
                self.hold();
            }
            row.copy_from_slice(&self.held);
        }
    }

    /// Finds what can be held of the row that is asked for.
    fn hold(&mut self) {
        let Self { nmpc, tracked, origin, asked, sought, held, status } = self;
        sought.copy_from_slice(asked);
        for _ in 0..ROUNDS {
            *status = nmpc.step(origin, sought).ok().map(|step| step.status);
            if *status != Some(SqpStatus::Converged) {
                held.copy_from_slice(asked);
                return;
            }
            let plan = nmpc.plan();
            for (i, place) in tracked.iter().enumerate() {
                held[i] = match *place {
                    Place::State(v) | Place::Input(v) => plan.inputs()[v],
                    Place::Output(y) => plan.states()[y],
                };
                if !matches!(place, Place::Input(_)) {
                    sought[i] += asked[i] - held[i];
                }
            }
        }
    }

    /// The last row that was asked for, and what can be held of it.
    #[must_use]
    pub fn last(&self) -> [&[f64]; 2] {
        [&self.asked, &self.held]
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

/// Q with what is tracked of inputs counting less.
fn weights(q: &Weight, tracked: &[Tracked]) -> Vec<Vec<f64>> {
    let part = |tracked: &Tracked| match tracked {
        Tracked::State(_) | Tracked::Output(_) => 1.0,
        Tracked::Input(_) => INPUTS.sqrt(),
    };
    let parts: Vec<f64> = tracked.iter().map(part).collect();
    let row = |i: usize| (0..parts.len()).map(|k| parts[i] * parts[k] * q.entry(i, k)).collect();
    (0..parts.len()).map(row).collect()
}

fn chain(a: Bounds, b: Bounds) -> Bounds {
    Bounds::new([a.low, b.low].concat(), [a.high, b.high].concat())
}

/// A model whose input is a state and an input of another one, v = (x, u), and whose next state is
/// how far that moves, with its outputs: (F(x, u, p) - x, h(x, u, p)).
#[derive(Debug)]
struct SteadyModel {
    inner: Box<dyn Model>,
    x: Vec<f64>,
    u: Vec<f64>,
    moved: LinearizationBuffer,
    y: Vec<f64>,
    c: Vec<f64>,
    d: Vec<f64>,
    e: Vec<f64>,
}

impl SteadyModel {
    fn new(inner: Box<dyn Model>) -> Self {
        let Dims { nx, nu, np, ny, .. } = inner.dims();
        Self {
            x: vec![0.0; nx],
            u: vec![0.0; nu],
            moved: LinearizationBuffer::new(inner.dims(), 1),
            y: vec![0.0; ny],
            c: vec![0.0; ny * nx],
            d: vec![0.0; ny * nu],
            e: vec![0.0; ny * np],
            inner,
        }
    }

    /// One point.
    fn linearize_point(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let Self { inner, x, u, moved, y, c, d, e } = self;
        let Dims { nx, nu, np, .. } = inner.dims();
        x.copy_from_slice(&at.u[..nx]);
        u.copy_from_slice(&at.u[nx..]);
        let point = Stages { x, u, p: at.p };
        inner.linearize(point, moved.as_mut());
        inner.linearize_output(point, OutputLinearization { y, c, d, e });
        let wide = nx + nu;
        let Linearization { next, a, b, e: by_p } = out;
        a.fill(0.0);
        for i in 0..nx {
            next[i] = moved.next[i] - x[i];
        }
        next[nx..].copy_from_slice(y);
        for (by_x, by_u, first) in [(&moved.a, &moved.b, 0), (&*c, &*d, nx)] {
            let rows = by_x.chunks_exact(nx).zip(by_u.chunks_exact(nu)).enumerate();
            for (i, (by_x, by_u)) in rows {
                let row = &mut b[(first + i) * wide..(first + i + 1) * wide];
                row[..nx].copy_from_slice(by_x);
                row[nx..].copy_from_slice(by_u);
                if first == 0 {
                    row[i] -= 1.0;
                }
            }
        }
        if !by_p.is_empty() {
            by_p[..nx * np].copy_from_slice(&moved.e);
            by_p[nx * np..].copy_from_slice(e);
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
        let n = self.inner.dims().nx;
        let ((x, u), (moved, y)) = (v.split_at(n), next.split_at_mut(n));
        self.inner.step(x, u, p, moved);
        moved.iter_mut().zip(x).for_each(|(moved, x)| *moved -= x);
        self.inner.output(x, u, p, y);
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let dims = self.dims();
        for k in 0..at.count(dims) {
            self.linearize_point(at.point(k, dims), out.point(k, dims));
        }
    }
}
