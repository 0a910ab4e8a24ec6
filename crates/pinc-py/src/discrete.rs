//! Models in discrete time at points and rows of points: what nets and integrators have in common.

use crate::arrays::{Array, Given, Points, array};
use crate::errors::{input, of_mpc};
use crate::work::lock;
use pinc_batch::ModelBatch;
use pinc_ode::{Dims, Linearization, Model, Stages};
use pyo3::prelude::*;
use std::fmt;
use std::sync::{Mutex, MutexGuard};

/// From so many points on, threads share them.
const SHARED: usize = 256;

/// Makes one more copy of the model.
type Make = Box<dyn Fn() -> Box<dyn Model> + Send + Sync>;

/// A model with the names of its arguments.
pub(crate) struct Discrete {
    pub(crate) dims: Dims,
    pub(crate) sample_time_s: f64,
    pub(crate) states: Vec<String>,
    pub(crate) inputs: Vec<String>,
    pub(crate) parameters: Vec<String>,
    model: Mutex<Box<dyn Model>>,
    make: Make,
    /// A copy per core, once there is work for them.
    batch: Mutex<Option<ModelBatch>>,
}

impl fmt::Debug for Discrete {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Discrete").field("model", &self.model).finish_non_exhaustive()
    }
}

/// The arguments of a model at some points.
pub(crate) struct Arguments {
    pub(crate) x: Vec<f64>,
    pub(crate) u: Vec<f64>,
    pub(crate) p: Vec<f64>,
    pub(crate) count: usize,
    pub(crate) rows: Option<usize>,
}

impl Arguments {
    /// x, u and p of point `k`.
    pub(crate) fn point(&self, Dims { nx, nu, np, .. }: Dims, k: usize) -> [&[f64]; 3] {
        let part = |width: usize| k * width..(k + 1) * width;
        [&self.x[part(nx)], &self.u[part(nu)], &self.p[part(np)]]
    }
}

impl Discrete {
    /// The model that `make` makes, whose arguments have these names.
    pub(crate) fn new(
        [states, inputs, parameters]: [Vec<String>; 3],
        make: impl Fn() -> Box<dyn Model> + Send + Sync + 'static,
    ) -> Self {
        let model = make();
        Self {
            dims: model.dims(),
            sample_time_s: model.sample_time_s(),
            states,
            inputs,
            parameters,
            model: Mutex::new(model),
            make: Box::new(make),
            batch: Mutex::new(None),
        }
    }

    /// The model, for one call. It has no memory of earlier calls, not even of one that failed.
    fn lock(&self) -> MutexGuard<'_, Box<dyn Model>> {
        lock(&self.model)
    }

    /// Points for x, u and p, with one of each for all where it is given once.
    pub(crate) fn arguments(
        &self,
        x: &Given<'_>,
        u: &Given<'_>,
        p: Option<&Given<'_>>,
    ) -> PyResult<Arguments> {
        let x = Points::read(x, "x", &self.states)?;
        let u = Points::read(u, "u", &self.inputs)?;
        let p = match p {
            Some(p) => Points::read(p, "p", &self.parameters)?,
            None if self.parameters.is_empty() => Points { values: Vec::new(), rows: None },
            None => {
                let names = self.parameters.join(", ");
                return Err(input(format!("p: missing, the net takes parameters ({names})")));
            }
        };
        let rows = [x.rows, u.rows, p.rows].into_iter().flatten().max();
        let count = rows.unwrap_or(1);
        for (name, points) in [("x", &x), ("u", &u), ("p", &p)] {
            if points.rows.is_some() && points.count() != count {
                let found = points.count();
                return Err(input(format!("{name}: {found} rows given, expected {count}")));
            }
        }
        Ok(Arguments {
            x: x.repeated(count),
            u: u.repeated(count),
            p: p.repeated(count),
            count,
            rows,
        })
    }

    /// The state after T. Many points are shared by threads, without the interpreter.
    pub(crate) fn step<'py>(
        &self,
        py: Python<'py>,
        x: &Given<'py>,
        u: &Given<'py>,
        p: Option<&Given<'py>>,
    ) -> PyResult<Array<'py>> {
        let at = self.arguments(x, u, p)?;
        let next = match at.count < SHARED {
            true => self.each(&at),
            false => py.detach(|| self.shared(&at))?,
        };
        array(py, next, at.rows, &[self.dims.nx])
    }

    fn each(&self, at: &Arguments) -> Vec<f64> {
        let nx = self.dims.nx;
        let mut next = vec![0.0; at.count * nx];
        let mut model = self.lock();
        for (k, next) in next.chunks_exact_mut(nx).enumerate() {
            let [x, u, p] = at.point(self.dims, k);
            model.step(x, u, p, next);
        }
        next
    }

    fn shared(&self, at: &Arguments) -> PyResult<Vec<f64>> {
        let mut batch = lock(&self.batch);
        let batch = batch.get_or_insert_with(|| ModelBatch::new(0, || (self.make)()));
        batch.steps(&at.x, &at.u, &at.p).map_err(of_mpc)
    }

    /// The state after T with its Jacobians by the state and the input.
    pub(crate) fn linearize<'py>(
        &self,
        py: Python<'py>,
        x: &Given<'py>,
        u: &Given<'py>,
        p: Option<&Given<'py>>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
        let at = self.arguments(x, u, p)?;
        let Dims { nx, nu, .. } = self.dims;
        let size = |width: usize| vec![0.0; at.count * nx * width];
        let (mut next, mut a, mut b) = (size(1), size(nx), size(nu));
        let mut work = || {
            self.lock().linearize(
                Stages { x: &at.x, u: &at.u, p: &at.p },
                Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
            );
        };
        match at.count < SHARED {
            true => work(),
            false => py.detach(work),
        }
        Ok((
            array(py, next, at.rows, &[nx])?,
            array(py, a, at.rows, &[nx, nx])?,
            array(py, b, at.rows, &[nx, nu])?,
        ))
    }

    /// The free run from a state under a row of inputs per step.
    pub(crate) fn predict<'py>(
        &self,
        py: Python<'py>,
        x: &Given<'py>,
        u: &Given<'py>,
        p: Option<&Given<'py>>,
    ) -> PyResult<Array<'py>> {
        let at = self.arguments(x, u, p)?;
        let nx = self.dims.nx;
        if Points::read(x, "x", &self.states)?.rows.is_some() {
            return Err(input("x: rows given, expected one state, where the run begins"));
        }
        // Without inputs the run is where it begins, of which `at` has no point.
        let mut states = match at.x.get(..nx) {
            Some(x) => x.to_vec(),
            None => Points::read(x, "x", &self.states)?.values,
        };
        states.resize((at.count + 1) * nx, 0.0);
        py.detach(|| {
            let mut model = self.lock();
            for k in 0..at.count {
                let (done, next) = states.split_at_mut((k + 1) * nx);
                let [_, u, p] = at.point(self.dims, k);
                model.step(&done[k * nx..], u, p, &mut next[..nx]);
            }
        });
        array(py, states, Some(at.count + 1), &[nx])
    }
}
