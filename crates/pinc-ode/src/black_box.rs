//! Plants without an equation to be seen: another program moves their states on in time.

use crate::dyn_plant::AnyVectorRhs;
use crate::{
    Dims, DynPlant, DynRhs, Integrator, Linearization, Model, OdeError, Stages, Variable,
    VectorDual, VectorRhs,
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

    /// The same from each of the points with the exact Jacobians of the step; `None` where they are
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
}

/// A plant of which nothing is known but its [`Flow`], with its variables; its outputs are its
/// states.
///
/// f(x, u) is NaN everywhere, and so is what its integrators give: there is nothing to integrate.
/// [`Simulator`](crate::Simulator) moves its state, and [`FlowModel`] is a model of it.
#[derive(Clone, Debug)]
pub struct BlackBox {
    /// The states, in order.
    pub states: Vec<Variable>,
    /// The inputs, in order.
    pub inputs: Vec<Variable>,
    /// The change of each state, then of each input, by which differences are taken.
    pub difference_steps: Vec<f64>,
    /// What moves the states.
    pub flow: Arc<dyn Flow>,
}

impl DynRhs for BlackBox {
    fn dims(&self) -> Dims {
        Dims::new(self.states.len(), self.inputs.len())
    }

    fn states(&self) -> &[Variable] {
        &self.states
    }

    fn inputs(&self) -> &[Variable] {
        &self.inputs
    }

    fn parameters(&self) -> &[Variable] {
        &[]
    }

    fn outputs(&self) -> &[Variable] {
        &self.states
    }

    fn rhs(&self, _x: &[f64], _u: &[f64], _p: &[f64], dx: &mut [f64]) {
        dx.fill(f64::NAN);
    }

    fn output(&self, x: &[f64], _u: &[f64], _p: &[f64], y: &mut [f64]) {
        y.copy_from_slice(x);
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
/// are one-sided differences, 1 + nx + nu runs of the flow at each point; each change has the sign
/// of its variable, so that a quantity that cannot be negative is not asked for below 0.
///
/// Where the flow fails F is NaN, and the first failure is logged with its reason. The model itself
/// allocates nothing; its flow may.
#[derive(Debug)]
pub struct FlowModel {
    dims: Dims,
    sample_time_s: f64,
    steps: Vec<f64>,
    flow: Arc<dyn Flow>,
    /// Whether a failure was logged.
    told: bool,
    /// Places in one call of the flow: all points, with their changes.
    x: Vec<f64>,
    u: Vec<f64>,
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
        let flow = plant.flow.clone();
        Self { dims, sample_time_s, steps, flow, told: false, x: Vec::new(), u: Vec::new() }
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
        vec![false; self.dims.ny]
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let Dims { nx, nu, .. } = self.dims;
        let (count, all) = (at.count(self.dims), 1 + nx + nu);
        out.check(count, self.dims);
        let Linearization { next, a, b, e } = &mut out;
        let own = self.flow.linearize(at, self.sample_time_s, Linearization { next, a, b, e });
        if let Some(result) = own {
            if !self.succeeded(result) {
                [out.next, out.a, out.b].into_iter().for_each(|part| part.fill(f64::NAN));
            }
            return;
        }
        self.x.clear();
        self.u.clear();
        for (x, u) in at.x.chunks_exact(nx).zip(at.u.chunks_exact(nu)) {
            for moved in 0..all {
                self.x.extend_from_slice(x);
                self.u.extend_from_slice(u);
                let Some(j) = moved.checked_sub(1) else { continue };
                let last = match j.checked_sub(nx) {
                    None => &mut self.x[..],
                    Some(_) => &mut self.u[..],
                };
                let place = if j < nx { last.len() - nx + j } else { last.len() - nu + j - nx };
                let value = last[place];
                let change = (value + self.steps[j].copysign(value)) - value;
                last[place] = value + change;
            }
        }
        let result = self.flow.advance(&mut self.x, &self.u, self.sample_time_s);
        if !self.succeeded(result) {
            self.x.fill(f64::NAN);
        }
        for (k, ends) in self.x.chunks_exact(all * nx).enumerate() {
            let (next, moved) = ends.split_at(nx);
            out.next[k * nx..(k + 1) * nx].copy_from_slice(next);
            let point = at.point(k, self.dims);
            for (j, end) in moved.chunks_exact(nx).enumerate() {
                let (to, width, column) = match j.checked_sub(nx) {
                    None => (&mut out.a[k * nx * nx..(k + 1) * nx * nx], nx, j),
                    Some(column) => (&mut out.b[k * nx * nu..(k + 1) * nx * nu], nu, column),
                };
                let value = if j < nx { point.x[column] } else { point.u[column] };
                let change = self.change(j, value);
                for (i, (end, next)) in end.iter().zip(next).enumerate() {
                    to[i * width + column] = (end - next) / change;
                }
            }
        }
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
