//! The equation of an FMU for model exchange, for an integrator.

use super::library::Instance;
use pinc_ad::simd::Isa;
use pinc_ode::{AnyVectorRhs, Dims, DynRhs, Variable};
use std::fmt::{self, Debug};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// f(x) of an instance whose inputs are set. Asked by one integrator, of one thread at a time.
pub(super) struct Equation {
    work: Arc<Mutex<Work>>,
    states: Vec<Variable>,
}

struct Work {
    instance: Instance,
    /// The place of each state in the FMU's vector.
    order: Vec<usize>,
    x: Vec<f64>,
    dx: Vec<f64>,
    /// What the FMU failed with since the last step began.
    failure: Option<String>,
}

impl Debug for Equation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Equation").finish_non_exhaustive()
    }
}

impl Equation {
    pub(super) fn new(instance: Instance, order: Vec<usize>) -> Self {
        let n = order.len();
        let states = vec![Variable::new("", ""); n];
        let work = Work { instance, order, x: vec![0.0; n], dx: vec![0.0; n], failure: None };
        Self { work: Arc::new(Mutex::new(work)), states }
    }

    fn work(&self) -> MutexGuard<'_, Work> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a step with these values of variables.
    pub(super) fn begin(&self, references: &[u32], values: &[f64]) -> Result<(), String> {
        let mut work = self.work();
        work.failure = None;
        work.instance.restart(references, values)?;
        work.instance.begin_continuous_time()
    }

    /// What the FMU failed with since then.
    pub(super) fn failure(&self) -> Option<String> {
        self.work().failure.take()
    }
}

impl DynRhs for Equation {
    fn dims(&self) -> Dims {
        Dims::new(self.states.len(), 0)
    }

    fn states(&self) -> &[Variable] {
        &self.states
    }

    fn inputs(&self) -> &[Variable] {
        &[]
    }

    fn parameters(&self) -> &[Variable] {
        &[]
    }

    fn outputs(&self) -> &[Variable] {
        &self.states
    }

    fn rhs(&self, x: &[f64], _u: &[f64], _p: &[f64], dx: &mut [f64]) {
        let Work { instance, order, x: of_fmu, dx: rates, failure } = &mut *self.work();
        for (place, x) in order.iter().zip(x) {
            of_fmu[*place] = *x;
        }
        match instance.derivatives(of_fmu, rates) {
            Ok(()) => dx.iter_mut().zip(order).for_each(|(dx, place)| *dx = rates[*place]),
            Err(reason) => {
                failure.get_or_insert(reason);
                dx.fill(f64::NAN);
            }
        }
    }

    fn output(&self, x: &[f64], _u: &[f64], _p: &[f64], y: &mut [f64]) {
        y.copy_from_slice(x);
    }

    fn explain(&self, _x: &[f64], _u: &[f64], _p: &[f64]) -> Option<String> {
        self.work().failure.clone()
    }

    fn jacobian(&self, x: &[f64], _u: &[f64], _p: &[f64]) -> Vec<f64> {
        vec![f64::NAN; x.len() * x.len()]
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        AnyVectorRhs::none(isa)
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        let (work, states) = (self.work.clone(), self.states.clone());
        Arc::new(Self { work, states })
    }
}
