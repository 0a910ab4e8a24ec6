//! The equation of an FMU for model exchange, for an integrator.

use super::derivatives::{Derivatives, Room};
use super::library::Instance;
use pinc_ad::simd::Isa;
use pinc_ode::{AnyVectorRhs, DynRhs, Signature, Variable};
use std::fmt::{self, Debug};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// f(x) of an instance whose inputs are set, alone or with its variational equation. Asked by one
/// integrator, of one thread at a time.
pub(super) struct Equation {
    work: Arc<Mutex<Work>>,
    /// As many as are integrated: x, and then the columns of dx/d(x, u) at the start.
    states: Vec<Variable>,
}

struct Work {
    instance: Instance,
    /// The place of each state in the FMU's vector.
    order: Vec<usize>,
    derivatives: Option<Arc<Derivatives>>,
    room: Room,
    /// What the step began with: variables, their values, and where among these are the states.
    references: Vec<u32>,
    values: Vec<f64>,
    starts: Vec<usize>,
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
    /// For an instance whose states are in these places of its vector, and are set at the start in
    /// the places `starts`.
    pub(super) fn new(
        instance: Instance,
        order: Vec<usize>,
        starts: Vec<usize>,
        derivatives: Option<Arc<Derivatives>>,
    ) -> Self {
        let n = order.len();
        let states = vec![Variable::new("", ""); n];
        let (references, values) = (Vec::new(), Vec::new());
        let (x, dx) = (vec![0.0; n], vec![0.0; n]);
        let failure = None;
        let work = Work {
            instance,
            order,
            derivatives,
            room: Room::default(),
            references,
            values,
            starts,
            x,
            dx,
            failure,
        };
        Self { work: Arc::new(Mutex::new(work)), states }
    }

    /// The equation with the columns of the Jacobian in its states and this many inputs.
    pub(super) fn variational(&self, inputs: usize) -> Self {
        let n = self.states.len();
        let states = vec![Variable::new("", ""); n * (1 + n + inputs)];
        Self { work: self.work.clone(), states }
    }

    fn work(&self) -> MutexGuard<'_, Work> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a step with these values of variables.
    pub(super) fn begin(&self, references: &[u32], values: &[f64]) -> Result<(), String> {
        let work = &mut *self.work();
        work.failure = None;
        work.references.clear();
        work.references.extend_from_slice(references);
        work.values.clear();
        work.values.extend_from_slice(values);
        work.instance.restart(references, values)?;
        work.instance.begin_continuous_time()
    }

    /// Lets `read` look at the instance.
    pub(super) fn look<R>(&self, read: impl FnOnce(&mut Instance) -> R) -> R {
        read(&mut self.work().instance)
    }

    /// What the FMU failed with since then.
    pub(super) fn failure(&self) -> Option<String> {
        self.work().failure.take()
    }
}

impl Work {
    /// f(x) into `dx`.
    fn rates(&mut self, x: &[f64], dx: &mut [f64]) -> Result<(), String> {
        let Self { instance, order, x: of_fmu, dx: rates, .. } = self;
        for (place, x) in order.iter().zip(x) {
            of_fmu[*place] = *x;
        }
        instance.derivatives(of_fmu, rates)?;
        dx.iter_mut().zip(order).for_each(|(dx, place)| *dx = rates[*place]);
        Ok(())
    }

    /// f(x) into `dx`, and (df/dx) S + df/du into `slopes` for the columns S.
    fn variations(
        &mut self,
        (x, columns): (&[f64], &[f64]),
        (dx, slopes): (&mut [f64], &mut [f64]),
    ) -> Result<(), String> {
        let at_start = self.derivatives.as_ref().is_some_and(|of| of.at_start);
        if !at_start {
            self.rates(x, dx)?;
            return self.slopes(columns, slopes);
        }
        for (place, x) in self.starts.iter().zip(x) {
            self.values[*place] = *x;
        }
        self.instance.initialize(&self.references, &self.values)?;
        self.slopes(columns, slopes)?;
        self.instance.end_initialization()?;
        self.instance.begin_continuous_time()?;
        self.rates(x, dx)
    }

    fn slopes(&mut self, columns: &[f64], slopes: &mut [f64]) -> Result<(), String> {
        let Self { instance, order, derivatives: Some(of), room, .. } = self else { return Ok(()) };
        let n = order.len();
        let columns = columns.chunks_exact(n).zip(slopes.chunks_exact_mut(n)).enumerate();
        for (j, (column, slope)) in columns {
            of.along(instance, order, (column, j.checked_sub(n)), slope, room)?;
        }
        Ok(())
    }
}

impl DynRhs for Equation {
    fn signature(&self) -> Signature<'_> {
        let states = &self.states;
        Signature { states, inputs: &[], parameters: &[], outputs: states }
    }

    fn rhs(&self, x: &[f64], _u: &[f64], _p: &[f64], dx: &mut [f64]) {
        let work = &mut *self.work();
        let n = work.order.len();
        let result = match x.len() > n {
            false => work.rates(x, dx),
            true => work.variations(x.split_at(n), dx.split_at_mut(n)),
        };
        if let Err(reason) = result {
            work.failure.get_or_insert(reason);
            dx.fill(f64::NAN);
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
