//! Plants without an equation to be seen: another program moves their states on in time.

use crate::dyn_plant::{AnyVectorRhs, Signature};
use crate::{
    Dims, DynPlant, DynRhs, Integrator, Linearization, Model, OdeError, OutputLinearization,
    Stages, Variable, VectorDual, VectorRhs,
};
use pinc_ad::simd::{Isa, Simd};
use std::fmt::Debug;
use std::sync::Arc;

/// The flow of a plant, computed by something else: a process, or a simulator loaded at run time.
///
/// What is computed depends on the arguments alone: a program with a memory is put into the state
/// `x` each time. Several threads may ask at once.
pub trait Flow: Debug + Send + Sync {
    /// Moves each of the states `x` on by `duration_s` under its constant input in `u`.
    ///
    /// # Shapes
    ///
    /// `x`: `[points, nx]`; `u`: `[points, nu]`; row by row.
    ///
    /// # Errors
    ///
    /// [`OdeError`] if that cannot be done for one of them; `x` then has no meaning.
    fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError>;

    /// Moves the states on so many times without beginning anew in between, for a simulator that may
    /// remember more than its states; `None` where it always begins anew.
    ///
    /// # Errors
    ///
    /// As [`Flow::advance`].
    fn advance_in_one_run(
        &self,
        _x: &mut [f64],
        _u: &[f64],
        _duration_s: f64,
        _times: u32,
    ) -> Option<Result<(), OdeError>> {
        None
    }

    /// The same as [`Flow::advance`] from each of the points with the exact Jacobians of the step; `None` where they are
    /// not to be had.
    ///
    /// # Errors
    ///
    /// As [`Flow::advance`], also if the derivatives of one of them fail.
    fn linearize(
        &self,
        _at: Stages<'_>,
        _duration_s: f64,
        _out: Linearization<'_>,
    ) -> Option<Result<(), OdeError>> {
        None
    }

    /// Writes the outputs at each of the states `x` under its input in `u`, `[points, ny]`, of a plant
    /// whose outputs are not its states.
    ///
    /// # Errors
    ///
    /// [`OdeError`] if there are none.
    fn outputs(&self, _x: &[f64], _u: &[f64], _y: &mut [f64]) -> Result<(), OdeError> {
        Err(OdeError::External { reason: "it has no outputs but its states".to_owned() })
    }
}

/// A plant of which nothing is known but its [`Flow`], with its variables.
///
/// f(x, u) is NaN everywhere, and so is what its integrators give: there is nothing to integrate.
/// [`Simulator`](crate::Simulator) moves its state, and [`FlowModel`] is a model of it.
#[derive(Clone, Debug)]
pub struct BlackBox {
    /// The states, in order.
    pub states: Vec<Variable>,
    /// The inputs, in order.
    pub inputs: Vec<Variable>,
    /// The outputs, in order; none where they are the states.
    pub outputs: Vec<Variable>,
    /// The change of each state, then of each input, by which differences are taken.
    pub difference_steps: Vec<f64>,
    /// What moves the states.
    pub flow: Arc<dyn Flow>,
}

impl DynRhs for BlackBox {
    fn signature(&self) -> Signature<'_> {
        let Self { states, inputs, outputs, .. } = self;
        let outputs = if outputs.is_empty() { states } else { outputs };
        Signature { states, inputs, parameters: &[], outputs }
    }

    fn rhs(&self, _x: &[f64], _u: &[f64], _p: &[f64], dx: &mut [f64]) {
        dx.fill(f64::NAN);
    }

    fn output(&self, x: &[f64], u: &[f64], _p: &[f64], y: &mut [f64]) {
        if self.outputs.is_empty() {
            y.copy_from_slice(x);
        } else if self.flow.outputs(x, u, y).is_err() {
            y.fill(f64::NAN);
        }
    }

    fn explain(&self, _x: &[f64], _u: &[f64], _p: &[f64]) -> Option<String> {
        Some("a black box has no equation to be seen".to_owned())
    }

    fn jacobian(&self, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
        vec![f64::NAN; x.len() * (x.len() + u.len() + p.len())]
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        AnyVectorRhs::none(isa)
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        Arc::new(self.clone())
    }

    fn black_box(&self) -> Option<&BlackBox> {
        Some(self)
    }
}

impl DynPlant for BlackBox {
    fn model(&self, integrator: Integrator, _: f64, _: usize) -> Result<Box<dyn Model>, OdeError> {
        Err(OdeError::NoModel { integrator, reason: "a black box has no equation".to_owned() })
    }
}

/// The right-hand side that is not to be seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NoEquation;

impl<V: Simd> VectorRhs<V> for NoEquation {
    fn rhs(
        &self,
        x: &[VectorDual<V>],
        _u: &[VectorDual<V>],
        _p: &[VectorDual<V>],
        dx: &mut [VectorDual<V>],
    ) {
        dx.fill(VectorDual::lift(x[0].re.constant(f64::NAN)));
    }
}

/// A black box as a [`Model`]: F by its flow, and the Jacobians too where it has them. Else they
/// are one-sided differences, 1 + nx + nu runs of the flow at each point, as those of outputs are;
/// each change has the sign of its variable, so that a quantity that cannot be negative is not asked
/// for below 0.
///
/// Where the flow fails F is NaN, and the first failure is logged with its reason. The model itself
/// allocates nothing; its flow may.
#[derive(Debug)]
pub struct FlowModel {
    dims: Dims,
    sample_time_s: f64,
    steps: Vec<f64>,
    flow: Arc<dyn Flow>,
    /// Whether the outputs are other quantities than the states.
    has_outputs: bool,
    /// Whether a failure was logged.
    told: bool,
    /// Places in one call of the flow: all points, with their changes.
    x: Vec<f64>,
    u: Vec<f64>,
    /// The outputs there.
    y: Vec<f64>,
}

impl FlowModel {
    /// The model of steps of `sample_time_s`.
    ///
    /// # Panics
    ///
    /// If there is not one difference step per state and input.
    #[must_use]
    pub fn new(plant: &BlackBox, sample_time_s: f64) -> Self {
        let (dims, steps) = (plant.dims(), plant.difference_steps.clone());
        assert_eq!(steps.len(), dims.nx + dims.nu, "one difference step per state and input");
        let (flow, has_outputs) = (plant.flow.clone(), !plant.outputs.is_empty());
        let [x, u, y] = [const { Vec::new() }; 3];
        Self { dims, sample_time_s, steps, flow, has_outputs, told: false, x, u, y }
    }

    /// Whether the flow succeeded. The reason of the first failure is logged.
    fn succeeded(&mut self, result: Result<(), OdeError>) -> bool {
        if let Err(error) = &result
            && !std::mem::replace(&mut self.told, true)
        {
            tracing::warn!(%error, "the plant failed in a step of the model");
        }
        result.is_ok()
    }

    /// The change of variable `j` at `value`.
    fn change(&self, j: usize, value: f64) -> f64 {
        // What is added is what is divided by.
        (value + self.steps[j].copysign(value)) - value
    }

    /// Collects each point, followed by the same with each of its states and inputs changed.
    fn move_points(&mut self, at: Stages<'_>) {
        let Dims { nx, nu, .. } = self.dims;
        self.x.clear();
        self.u.clear();
        for (x, u) in at.x.chunks_exact(nx).zip(at.u.chunks_exact(nu)) {
            for moved in 0..=nx + nu {
                self.x.extend_from_slice(x);
                self.u.extend_from_slice(u);
                let Some(j) = moved.checked_sub(1) else { continue };
                let value = if j < nx { x[j] } else { u[j - nx] };
                let change = self.change(j, value);
                match j.checked_sub(nx) {
                    None => *self.x.iter_mut().nth_back(nx - 1 - j).expect("a state") += change,
                    Some(j) => *self.u.iter_mut().nth_back(nu - 1 - j).expect("an input") += change,
                }
            }
        }
    }

    /// Writes the values at the points, and their differences by states and by inputs, from the
    /// values at all that [`FlowModel::move_points`] collects.
    fn difference(&self, at: Stages<'_>, values: &[f64], [to, by_x, by_u]: [&mut [f64]; 3]) {
        let Dims { nx, nu, .. } = self.dims;
        let rows = to.len() / at.count(self.dims).max(1);
        for (k, values) in values.chunks_exact((1 + nx + nu) * rows).enumerate() {
            let (value, moved) = values.split_at(rows);
            to[k * rows..(k + 1) * rows].copy_from_slice(value);
            let point = at.point(k, self.dims);
            for (j, end) in moved.chunks_exact(rows).enumerate() {
                let (jacobian, width, column, place) = match j.checked_sub(nx) {
                    None => (&mut *by_x, nx, j, point.x[j]),
                    Some(column) => (&mut *by_u, nu, column, point.u[column]),
                };
                let jacobian = &mut jacobian[k * rows * width..(k + 1) * rows * width];
                let change = self.change(j, place);
                for (i, (end, value)) in end.iter().zip(value).enumerate() {
                    jacobian[i * width + column] = (end - value) / change;
                }
            }
        }
    }
}

impl Model for FlowModel {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        next.copy_from_slice(x);
        let result = self.flow.advance(next, u, self.sample_time_s);
        if !self.succeeded(result) {
            next.fill(f64::NAN);
        }
    }

    fn feedthrough(&self) -> Vec<bool> {
        vec![self.has_outputs; self.dims.ny]
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        out.check(at.count(self.dims), self.dims);
        let Linearization { next, a, b, e } = &mut out;
        let own = self.flow.linearize(at, self.sample_time_s, Linearization { next, a, b, e });
        if let Some(result) = own {
            if !self.succeeded(result) {
                [out.next, out.a, out.b].into_iter().for_each(|part| part.fill(f64::NAN));
            }
            return;
        }
        self.move_points(at);
        let result = self.flow.advance(&mut self.x, &self.u, self.sample_time_s);
        if !self.succeeded(result) {
            self.x.fill(f64::NAN);
        }
        self.difference(at, &self.x, [out.next, out.a, out.b]);
    }

    fn output(&mut self, x: &[f64], u: &[f64], _p: &[f64], y: &mut [f64]) {
        if !self.has_outputs {
            return y.copy_from_slice(x);
        }
        let result = self.flow.outputs(x, u, y);
        if !self.succeeded(result) {
            y.fill(f64::NAN);
        }
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let count = at.count(self.dims);
        out.check(count, self.dims);
        out.e.fill(0.0);
        self.move_points(at);
        let mut y = std::mem::take(&mut self.y);
        y.resize(count * (1 + self.steps.len()) * self.dims.ny, 0.0);
        let result = match self.has_outputs {
            true => self.flow.outputs(&self.x, &self.u, &mut y),
            false => {
                y.copy_from_slice(&self.x);
                Ok(())
            }
        };
        if !self.succeeded(result) {
            y.fill(f64::NAN);
        }
        self.difference(at, &y, [out.y, out.c, out.d]);
        self.y = y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x' = u - x, exactly; not defined for x below 0.
    #[derive(Debug)]
    struct Lag;

    impl Flow for Lag {
        fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError> {
            for (x, u) in x.iter_mut().zip(u) {
                if *x < 0.0 {
                    return Err(OdeError::External { reason: "below 0".to_owned() });
                }
                *x = u + (*x - u) * (-duration_s).exp();
            }
            Ok(())
        }
    }

    fn lag(scale: f64) -> BlackBox {
        let variable = |name| vec![Variable::new(name, "")];
        BlackBox {
            states: variable("x"),
            inputs: variable("u"),
            outputs: Vec::new(),
            difference_steps: vec![1e-6 * scale; 2],
            flow: Arc::new(Lag),
        }
    }

    /// Keeps what is logged.
    #[derive(Clone, Debug, Default)]
    struct Log(Arc<std::sync::Mutex<Vec<String>>>);

    impl tracing::field::Visit for Log {
        fn record_debug(&mut self, field: &tracing::field::Field, value: &dyn Debug) {
            self.0.lock().unwrap().push(format!("{field}: {value:?}"));
        }
    }

    impl tracing::Subscriber for Log {
        fn enabled(&self, _: &tracing::Metadata<'_>) -> bool {
            true
        }
        fn new_span(&self, _: &tracing::span::Attributes<'_>) -> tracing::span::Id {
            tracing::span::Id::from_u64(1)
        }
        fn record(&self, _: &tracing::span::Id, _: &tracing::span::Record<'_>) {}
        fn record_follows_from(&self, _: &tracing::span::Id, _: &tracing::span::Id) {}
        fn event(&self, event: &tracing::Event<'_>) {
            event.record(&mut self.clone());
        }
        fn enter(&self, _: &tracing::span::Id) {}
        fn exit(&self, _: &tracing::span::Id) {}
    }

    /// A controller sees NaN where its model fails; the reason is in the log, once.
    #[test]
    fn the_reason_of_a_failure_is_logged() {
        for linearizes in [false, true] {
            let log = Log::default();
            let mut model = FlowModel::new(&lag(1.0), 0.3);
            let next = tracing::subscriber::with_default(log.clone(), || {
                let (mut next, mut a, mut b) = ([0.0], [0.0], [0.0]);
                for _ in 0..2 {
                    if linearizes {
                        let at = Stages { x: &[-1.0], u: &[0.0], p: &[] };
                        let (next, a, b) = (&mut next[..], &mut a[..], &mut b[..]);
                        model.linearize(at, Linearization { next, a, b, e: &mut [] });
                    } else {
                        model.step(&[-1.0], &[0.0], &[], &mut next);
                    }
                }
                next
            });
            assert!(next[0].is_nan());
            let said = log.0.lock().unwrap().join("\n");
            assert_eq!(said.matches("below 0").count(), 1, "{said}");
            assert_eq!(
                said.matches("the plant failed in a step of the model").count(),
                1,
                "{said}"
            );
        }
    }

    #[test]
    fn differences_are_the_derivatives_in_all_units() {
        for scale in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
            let mut model = FlowModel::new(&lag(scale), 0.3);
            let (mut next, mut a, mut b) = ([0.0; 2], [0.0; 2], [0.0; 2]);
            let at = Stages { x: &[0.0, 2.0 * scale], u: &[scale, -3.0 * scale], p: &[] };
            let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
            model.linearize(at, out);
            let decay = (-0.3_f64).exp();
            for k in 0..2 {
                let end = at.u[k] + (at.x[k] - at.u[k]) * decay;
                assert!((next[k] - end).abs() <= 1e-14 * scale * 4.0);
                // Rounding of values near 3, divided by the step of 1e-6.
                assert!((a[k] - decay).abs() < 4e-9 && (b[k] - (1.0 - decay)).abs() < 4e-9);
            }
        }
    }

    /// The same with the outputs x u and u.
    #[derive(Debug)]
    struct Measured;

    impl Flow for Measured {
        fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError> {
            Lag.advance(x, u, duration_s)
        }

        fn outputs(&self, x: &[f64], u: &[f64], y: &mut [f64]) -> Result<(), OdeError> {
            for (y, (x, u)) in y.chunks_exact_mut(2).zip(x.iter().zip(u)) {
                if *x < 0.0 {
                    return Err(OdeError::External { reason: "below 0".to_owned() });
                }
                (y[0], y[1]) = (x * u, *u);
            }
            Ok(())
        }
    }

    #[test]
    fn outputs_have_differences_and_nan_where_they_fail() {
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        for scale in [1e-6, 1.0, 1e6] {
            let outputs = ["product", "input"].map(|name| Variable::new(name, "")).to_vec();
            let plant = BlackBox { outputs, flow: Arc::new(Measured), ..lag(scale) };
            assert_eq!((plant.dims().ny, DynRhs::outputs(&plant).len()), (2, 2));
            let mut model = FlowModel::new(&plant, 0.3);
            assert_eq!(model.feedthrough(), [true; 2]);
            let (x, u) = ([2.0 * scale, 0.0], [-3.0 * scale, scale]);
            let (mut y, mut c, mut d) = ([0.0; 4], [0.0; 4], [0.0; 4]);
            let out = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut [] };
            model.linearize_output(Stages { x: &x, u: &u, p: &[] }, out);
            for k in 0..2 {
                assert_eq!(bits(&y[2 * k..2 * k + 2]), bits(&[x[k] * u[k], u[k]]));
                let slopes = [c[2 * k], c[2 * k + 1], d[2 * k], d[2 * k + 1]];
                let exact = [u[k], 0.0, x[k], 1.0];
                for (i, (found, exact)) in slopes.iter().zip(exact).enumerate() {
                    let size = if i == 3 { 1.0 } else { scale };
                    assert!((found - exact).abs() < 1e-7 * size, "{k}, {i}: {found} {exact}");
                }
            }
            let mut y = [0.0; 2];
            model.output(&[-scale], &[scale], &[], &mut y);
            assert!(y[0].is_nan());
            plant.output(&[2.0 * scale], &[scale], &[], &mut y);
            assert_eq!(bits(&y), bits(&[2.0 * scale * scale, scale]));
        }
        // The states are outputs without feedthrough.
        let mut model = FlowModel::new(&lag(1.0), 0.3);
        assert_eq!(model.feedthrough(), [false]);
        let (mut y, mut c, mut d) = ([0.0], [0.0], [1.0]);
        let out = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut [] };
        model.linearize_output(Stages { x: &[2.0], u: &[5.0], p: &[] }, out);
        assert_eq!(bits(&[y, c, d].concat()), bits(&[2.0, 1.0, 0.0]));
    }

    /// The same, with its derivatives for u >= 0.
    #[derive(Debug)]
    struct Known;

    impl Flow for Known {
        fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError> {
            Lag.advance(x, u, duration_s)
        }

        fn linearize(
            &self,
            at: Stages<'_>,
            duration_s: f64,
            out: Linearization<'_>,
        ) -> Option<Result<(), OdeError>> {
            let decay = (-duration_s).exp();
            out.a.fill(decay);
            out.b.fill(1.0 - decay);
            out.next.copy_from_slice(at.x);
            let unknown = || OdeError::External { reason: "below 0".to_owned() };
            Some(match at.u.iter().all(|u| *u >= 0.0) {
                true => self.advance(out.next, at.u, duration_s),
                false => Err(unknown()),
            })
        }
    }

    #[test]
    fn jacobians_of_the_flow_are_used_and_failures_give_nan() {
        let black_box = BlackBox { flow: Arc::new(Known), ..lag(1.0) };
        let mut model = FlowModel::new(&black_box, 0.3);
        let (mut next, mut a, mut b) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let mut linearize = |u: [f64; 2]| {
            let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
            model.linearize(Stages { x: &[1.0, 2.0], u: &u, p: &[] }, out);
            [next, a, b]
        };
        let decay = (-0.3_f64).exp();
        let [next, a, b] = linearize([0.0, 3.0]);
        // Differences would not have these bits.
        let bits = |values: [f64; 2]| values.map(f64::to_bits);
        assert_eq!([a, b].map(bits), [[decay; 2], [1.0 - decay; 2]].map(bits));
        assert!((next[0] - decay).abs() < 1e-15 && (next[1] - (3.0 - decay)).abs() < 1e-14);
        assert!(linearize([0.0, -3.0]).iter().flatten().all(|value| value.is_nan()));
    }

    #[test]
    fn where_the_flow_fails_the_model_is_nan() {
        let mut model = FlowModel::new(&lag(1.0), 0.3);
        let mut next = [0.0];
        model.step(&[-1.0], &[0.0], &[], &mut next);
        assert!(next[0].is_nan());
        let (mut a, mut b) = ([0.0], [0.0]);
        let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
        model.linearize(Stages { x: &[-1.0], u: &[0.0], p: &[] }, out);
        assert!(next[0].is_nan() && a[0].is_nan() && b[0].is_nan());
    }

    #[test]
    fn integrators_have_nothing_to_integrate() {
        let mut next = [0.0];
        let refused = lag(1.0).model(Integrator::Rk5, 0.1, 4).err().map(|error| error.to_string());
        let reason =
            "the integrator `rk5` cannot be made of the plant: a black box has no equation";
        assert_eq!(refused.as_deref(), Some(reason));
        lag(1.0).rhs(&[1.0], &[0.0], &[], &mut next);
        assert!(next[0].is_nan());
    }
}
