//! A model with disturbances and unknown parameters as further arguments.

use crate::error::check;
use crate::{Disturbance, EstimateError, Measured};
use pinc_ode::{
    ArgumentError, Dims, Linearization, Model, OutputLinearization, OutputLinearizationBuffer,
    Stages,
};

/// How many points are linearized at a time.
pub(crate) const BLOCK: usize = 16;

/// The measured quantities of a plant, and its unknowns beside the state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Augmentation {
    /// The measured quantities, in the order of the measurements.
    pub measured: Vec<Measured>,
    /// Which disturbances are estimated.
    pub disturbance: Disturbance,
    /// p, the parameters of the model, `np`: those that are not estimated keep these values.
    pub parameters: Vec<f64>,
    /// Which of the parameters are estimated, by their indices.
    pub estimated: Vec<usize>,
    /// Which of the parameters are known anew in each step (measured disturbances, prices), by their
    /// indices.
    pub known: Vec<usize>,
}

impl Augmentation {
    /// These quantities are measured; the model is right.
    #[must_use]
    pub fn measured(measured: Vec<Measured>) -> Self {
        Self { measured, ..Self::default() }
    }

    /// How many disturbances and parameters are estimated with a model of dimensions `dims`.
    #[must_use]
    pub fn unknowns(&self, dims: Dims) -> usize {
        self.disturbance.count(dims.nu, self.measured.len()) + self.estimated.len()
    }

    /// The values of the known parameters until they are told.
    #[must_use]
    pub fn known_values(&self) -> Vec<f64> {
        self.known.iter().map(|&place| self.parameters[place]).collect()
    }

    /// The parameters of which a controller is told values, in their order in w: those estimated, then
    /// those known.
    fn told(&self) -> impl Iterator<Item = &usize> {
        self.estimated.iter().chain(&self.known)
    }

    /// Writes what belongs to the estimate z = (x, d, theta): the state that a controller with the
    /// [`Compensated`](crate::Compensated) model sees, and of that model's parameters w = (d, theta,
    /// known) those that are estimated.
    ///
    /// # Shapes
    ///
    /// `x`: `nx` of the plant; `w`: the rest of z, and the known parameters, which stay.
    pub fn read(&self, z: &[f64], x: &mut [f64], w: &mut [f64]) {
        let (state, unknowns) = z.split_at(x.len());
        x.copy_from_slice(state);
        w[..unknowns.len()].copy_from_slice(unknowns);
        if self.disturbance == Disturbance::Output {
            for (measured, d) in self.measured.iter().zip(w) {
                if let Measured::State(state) = *measured {
                    x[state] += *d;
                }
            }
        }
    }

    /// Writes the covariance of what [`Augmentation::read`] gives, (x, w), from that of the estimate of a
    /// plant with `nx` states. Known parameters have none.
    ///
    /// # Shapes
    ///
    /// `of_estimate`: `[nz, nz]`; `covariance`: as many more rows and columns as parameters are known.
    pub fn read_covariance(&self, of_estimate: &[f64], nx: usize, covariance: &mut Vec<f64>) {
        let known = self.known.len();
        let estimated = of_estimate.len().isqrt();
        let nz = estimated + known;
        covariance.clear();
        for row in of_estimate.chunks_exact(estimated.max(1)) {
            covariance.extend(row);
            covariance.resize(covariance.len() + known, 0.0);
        }
        covariance.resize(nz * nz, 0.0);
        if self.disturbance != Disturbance::Output {
            return;
        }
        for (place, measured) in self.measured.iter().enumerate() {
            if let Measured::State(state) = *measured {
                // x + d, by rows and by columns.
                for column in 0..nz {
                    covariance[state * nz + column] += covariance[(nx + place) * nz + column];
                }
                for row in covariance.chunks_exact_mut(nz) {
                    row[state] += row[nx + place];
                }
            }
        }
    }

    /// Turns what a controller with the [`Compensated`](crate::Compensated) model asks, (x, u, w), into
    /// what the model itself is asked: `x` without output disturbances, `u` with input disturbances,
    /// and `p` with the estimated and known parameters.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `w`: disturbances, estimated and known parameters; `p`: `np` of the
    /// model.
    pub fn arguments(&self, x: &mut [f64], u: &mut [f64], w: &[f64], p: &mut [f64]) {
        p.copy_from_slice(&self.parameters);
        let (disturbances, told) = w.split_at(w.len() - self.told().count());
        for (&place, value) in self.told().zip(told) {
            p[place] = *value;
        }
        match &self.disturbance {
            Disturbance::None | Disturbance::States(_) => {}
            Disturbance::Input => u.iter_mut().zip(disturbances).for_each(|(u, d)| *u += d),
            Disturbance::Output => {
                for (measured, d) in self.measured.iter().zip(disturbances) {
                    if let Measured::State(state) = *measured {
                        x[state] -= d;
                    }
                }
            }
        }
    }

    /// Checks it against a model of dimensions `dims`.
    ///
    /// # Errors
    ///
    /// [`EstimateError`], with the reason.
    pub fn validate(&self, dims: Dims) -> Result<(), EstimateError> {
        let Self { measured, disturbance, parameters, estimated, known } = self;
        if measured.is_empty() {
            return Err(EstimateError::NothingMeasured);
        }
        for (i, &quantity) in measured.iter().enumerate() {
            match quantity {
                Measured::State(index) => {
                    ArgumentError::check_places("measured states", &[index], dims.nx)?
                }
                Measured::Output(index) => {
                    ArgumentError::check_places("measured outputs", &[index], dims.ny)?
                }
            }
            if measured[..i].contains(&quantity) {
                return Err(EstimateError::MeasuredTwice { measured: quantity });
            }
        }
        if let Disturbance::States(states) = disturbance {
            ArgumentError::check_places("disturbed states", states, dims.nx)?;
        }
        let (disturbances, measured) = (disturbance.count(dims.nu, measured.len()), measured.len());
        if disturbances > measured {
            return Err(EstimateError::TooManyDisturbances { disturbances, measured });
        }
        check("parameters", parameters, dims.np, "finite", f64::is_finite)?;
        ArgumentError::check_places("estimated parameters", estimated, dims.np)?;
        ArgumentError::check_places("known parameters", known, dims.np)?;
        match known.iter().find(|place| estimated.contains(place)) {
            Some(&index) => Err(EstimateError::KnownAndEstimated { index }),
            None => Ok(()),
        }
    }
}

/// What a model is asked, from what a controller asks of it with or without an augmentation: see
/// [`Augmentation::arguments`].
#[derive(Debug)]
pub struct InnerArguments {
    augmentation: Option<Augmentation>,
    x: Vec<f64>,
    u: Vec<f64>,
    p: Vec<f64>,
}

impl InnerArguments {
    /// Of a model of dimensions `dims`.
    #[must_use]
    pub fn new(dims: Dims, augmentation: Option<Augmentation>) -> Self {
        let [x, u, p] = [dims.nx, dims.nu, dims.np].map(|size| vec![0.0; size]);
        Self { augmentation, x, u, p }
    }

    /// x, u and p of the model.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `p`: `np`, or with an augmentation the disturbances and estimates.
    pub fn of(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> [&[f64]; 3] {
        self.x.copy_from_slice(x);
        self.u.copy_from_slice(u);
        match &self.augmentation {
            Some(of) => of.arguments(&mut self.x, &mut self.u, p, &mut self.p),
            None => self.p.copy_from_slice(p),
        }
        [&self.x, &self.u, &self.p]
    }
}

/// A model whose parameters are the disturbances and the estimated and known parameters, w = (d,
/// theta, known).
#[derive(Debug)]
pub(crate) struct Disturbed {
    model: Box<dyn Model>,
    /// The model's dimensions.
    dims: Dims,
    augmentation: Augmentation,
    disturbances: usize,
    /// The places of theta and of the known parameters.
    told: Vec<usize>,
    /// u + d and p at the points of a block.
    u: Vec<f64>,
    p: Vec<f64>,
    /// dF/dp at these points.
    by_p: Vec<f64>,
    /// The outputs of the model and their Jacobians at one point.
    outputs: OutputLinearizationBuffer,
}

impl Disturbed {
    pub(crate) fn new(
        model: Box<dyn Model>,
        augmentation: Augmentation,
    ) -> Result<Self, EstimateError> {
        let dims = model.dims();
        augmentation.validate(dims)?;
        let Dims { nx, nu, np, .. } = dims;
        Ok(Self {
            disturbances: augmentation.disturbance.count(nu, augmentation.measured.len()),
            told: augmentation.told().copied().collect(),
            augmentation,
            u: vec![0.0; BLOCK * nu],
            p: vec![0.0; BLOCK * np],
            by_p: vec![0.0; BLOCK * nx * np],
            outputs: OutputLinearizationBuffer::new(dims, 1),
            dims,
            model,
        })
    }

    /// The dimensions of the model without w.
    pub(crate) fn dims(&self) -> Dims {
        self.dims
    }

    pub(crate) fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    /// The number of disturbances and estimated parameters.
    pub(crate) fn unknowns(&self) -> usize {
        self.disturbances + self.augmentation.estimated.len()
    }

    /// The number of known parameters.
    pub(crate) fn known(&self) -> usize {
        self.augmentation.known.len()
    }

    pub(crate) fn known_values(&self) -> Vec<f64> {
        self.augmentation.known_values()
    }

    /// The length of w.
    pub(crate) fn width(&self) -> usize {
        self.disturbances + self.told.len()
    }

    /// w without disturbances, the parameters at the values of the augmentation.
    pub(crate) fn nominal(&self) -> Vec<f64> {
        let mut w = vec![0.0; self.disturbances];
        w.extend(self.told.iter().map(|&index| self.augmentation.parameters[index]));
        w
    }

    pub(crate) fn measured(&self) -> &[Measured] {
        &self.augmentation.measured
    }

    pub(crate) fn disturbance(&self) -> &Disturbance {
        &self.augmentation.disturbance
    }

    /// Writes the inputs that the model sees, and its parameters, at the points of a block. Gives
    /// the number of points.
    fn arrange(&mut self, at: Stages<'_>) -> usize {
        let Dims { nx, nu, np, .. } = self.dims;
        let (count, nw) = (at.x.len() / nx, self.width());
        assert!(at.x.len() == count * nx, "length of x");
        assert!(at.u.len() == count * nu, "length of u");
        assert!(at.p.len() == count * nw, "length of p");
        self.u[..count * nu].copy_from_slice(at.u);
        for k in 0..count {
            let w = &at.p[k * nw..(k + 1) * nw];
            let (d, told) = w.split_at(self.disturbances);
            if self.augmentation.disturbance == Disturbance::Input {
                self.u[k * nu..].iter_mut().zip(d).for_each(|(u, d)| *u += d);
            }
            let p = &mut self.p[k * np..(k + 1) * np];
            p.copy_from_slice(&self.augmentation.parameters);
            self.told.iter().zip(told).for_each(|(&index, value)| p[index] = *value);
        }
        count
    }

    /// The disturbed states with their disturbances, of a w.
    fn on_states<'s>(&'s self, w: &'s [f64]) -> impl Iterator<Item = (usize, f64)> + 's {
        let states = match &self.augmentation.disturbance {
            Disturbance::States(states) => &states[..],
            _ => &[],
        };
        states.iter().copied().zip(w.iter().copied())
    }

    /// Writes the next state at one point.
    pub(crate) fn step(&mut self, at: Stages<'_>, next: &mut [f64]) {
        let Dims { nu, np, .. } = self.dims;
        self.arrange(at);
        self.model.step(at.x, &self.u[..nu], &self.p[..np], next);
        for (i, d) in self.on_states(at.p) {
            next[i] += d;
        }
    }

    /// Linearizes at a block of points; `out.e` is the Jacobian by w, or empty.
    pub(crate) fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let Dims { nx, nu, np, .. } = self.dims;
        let nw = self.width();
        let count = self.arrange(at);
        let Linearization { next, a, b, e } = out;
        let with_p = !e.is_empty() && !self.told.is_empty();
        let by_p = if with_p { count * nx * np } else { 0 };
        self.model.linearize(
            Stages { x: at.x, u: &self.u[..count * nu], p: &self.p[..count * np] },
            Linearization { next: &mut *next, a, b: &mut *b, e: &mut self.by_p[..by_p] },
        );
        for k in 0..count {
            for (i, d) in self.on_states(&at.p[k * nw..]) {
                next[k * nx + i] += d;
            }
        }
        if e.is_empty() {
            return;
        }
        e.fill(0.0);
        for (row, e) in e.chunks_exact_mut(nw.max(1)).enumerate() {
            let (by_d, by_told) = e.split_at_mut(self.disturbances);
            match &self.augmentation.disturbance {
                Disturbance::Input => by_d.copy_from_slice(&b[row * nu..(row + 1) * nu]),
                Disturbance::States(states) => {
                    let place = states.iter().position(|&i| i == row % nx);
                    place.into_iter().for_each(|place| by_d[place] = 1.0);
                }
                Disturbance::Output | Disturbance::None => {}
            }
            for (to, index) in by_told.iter_mut().zip(&self.told) {
                *to = self.by_p[row * np + index];
            }
        }
    }

    /// Writes the measured quantities at one point.
    pub(crate) fn measure(&mut self, at: Stages<'_>, y: &mut [f64]) {
        let Dims { nu, np, .. } = self.dims;
        self.arrange(at);
        let is_output = |measured: &Measured| matches!(measured, Measured::Output(_));
        if self.augmentation.measured.iter().any(is_output) {
            self.model.output(at.x, &self.u[..nu], &self.p[..np], &mut self.outputs.y);
        }
        self.select(at, y);
    }

    /// Writes the measured quantities, where the model's outputs are known.
    fn select(&self, at: Stages<'_>, y: &mut [f64]) {
        let quantities = self.augmentation.measured.iter();
        for (i, (y, measured)) in y.iter_mut().zip(quantities).enumerate() {
            *y = measured.read(at.x, &self.outputs.y);
            if self.augmentation.disturbance == Disturbance::Output {
                *y += at.p[i];
            }
        }
    }

    /// Writes all outputs of the model at one point.
    pub(crate) fn all_outputs(&mut self, at: Stages<'_>, y: &mut [f64]) {
        let Dims { nu, np, .. } = self.dims;
        self.arrange(at);
        self.model.output(at.x, &self.u[..nu], &self.p[..np], y);
    }

    /// Whether each output of the model depends on the input, `ny`.
    pub(crate) fn feedthrough(&self) -> Vec<bool> {
        self.model.feedthrough()
    }

    /// Linearizes all outputs of the model at one point; `out.e` is the Jacobian by w, or empty.
    pub(crate) fn linearize_all_outputs(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let Dims { nu, np, .. } = self.dims;
        let nw = self.width();
        self.arrange(at);
        let OutputLinearization { y, c, d, e } = out;
        self.model.linearize_output(
            Stages { x: at.x, u: &self.u[..nu], p: &self.p[..np] },
            OutputLinearization { y, c, d: &mut *d, e: &mut self.outputs.e },
        );
        e.fill(0.0);
        for (o, by_w) in e.chunks_exact_mut(nw.max(1)).enumerate() {
            self.fill_by_w(&d[o * nu..(o + 1) * nu], o, by_w);
        }
    }

    /// Writes the derivatives by w of output `o`, of which `by_u` are those by u.
    fn fill_by_w(&self, by_u: &[f64], o: usize, by_w: &mut [f64]) {
        let (by_d, by_told) = by_w.split_at_mut(self.disturbances);
        if self.augmentation.disturbance == Disturbance::Input {
            by_d.copy_from_slice(by_u);
        }
        for (to, index) in by_told.iter_mut().zip(&self.told) {
            *to = self.outputs.e[o * self.dims.np + index];
        }
    }

    /// Linearizes the measured quantities at one point; `out.e` is the Jacobian by w.
    pub(crate) fn linearize_measurement(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let Dims { nx, nu, np, .. } = self.dims;
        let nw = self.width();
        let is_output = |measured: &Measured| matches!(measured, Measured::Output(_));
        if self.augmentation.measured.iter().any(is_output) {
            self.arrange(at);
            self.model.linearize_output(
                Stages { x: at.x, u: &self.u[..nu], p: &self.p[..np] },
                self.outputs.as_mut(),
            );
        }
        self.select(at, out.y);
        [&mut *out.c, &mut *out.d, &mut *out.e].into_iter().for_each(|part| part.fill(0.0));
        for (i, measured) in self.augmentation.measured.iter().enumerate() {
            let by_w = &mut out.e[i * nw..(i + 1) * nw];
            match *measured {
                Measured::State(state) => out.c[i * nx + state] = 1.0,
                Measured::Output(o) => {
                    let by_u = &self.outputs.d[o * nu..(o + 1) * nu];
                    out.c[i * nx..(i + 1) * nx]
                        .copy_from_slice(&self.outputs.c[o * nx..(o + 1) * nx]);
                    out.d[i * nu..(i + 1) * nu].copy_from_slice(by_u);
                    self.fill_by_w(by_u, o, by_w);
                }
            }
            if self.augmentation.disturbance == Disturbance::Output {
                by_w[i] = 1.0;
            }
        }
    }
}
