//! Text plants with their type erased: their integrators use the sparse Jacobian.

use crate::grouped::GroupedCurved;
use crate::{ExpressionError, ExpressionPlant, Rates, SparseEquations};
use pinc_ad::simd::{Isa, Simd, Task};
use pinc_ode::{
    AnyVectorRhs, DynPlant, DynRhs, Integrator, Model, OdeError, Plant, Scheme, Signature,
    SparseFunction, SparsePlant, SparsityPattern, sparse_rosenbrock, sparse_runge_kutta,
};
use std::sync::Arc;

impl ExpressionPlant {
    /// The plant with its type erased. Its integrators are made of code for the equations and their
    /// Jacobian that runs on many points at once.
    #[must_use]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(TextPlant(self))
    }
}

impl SparseEquations {
    /// The integrator over steps of `sample_time_s` seconds, each in `substeps` parts.
    pub(crate) fn integrator(
        &self,
        integrator: Integrator,
        sample_time_s: f64,
        substeps: usize,
    ) -> Result<Box<dyn Model>, OdeError> {
        let (plant, isa) = (self.plant.clone(), Isa::detect());
        match integrator.scheme() {
            Scheme::Explicit(tableau) => {
                Ok(sparse_runge_kutta(plant, tableau, sample_time_s, substeps, isa))
            }
            Scheme::LinearlyImplicit => {
                let SparsePlant { dims, outputs, .. } = plant;
                let rhs = self.curved().map_err(|error| no_model(integrator, &error))?;
                let plant = SparsePlant { dims, rhs, outputs };
                Ok(sparse_rosenbrock(plant, sample_time_s, substeps, isa))
            }
        }
    }

    /// The derivatives of the states with their second derivatives.
    fn curved(&self) -> Result<GroupedCurved, ExpressionError> {
        let Rates { graph, algebraic, values } = &*self.rates;
        let rhs = GroupedCurved::new(&self.plant.rhs, graph, algebraic, values);
        rhs.map_err(|problem| problem.at("derivatives"))
    }
}

/// Says that an integrator cannot be made, with the reason.
pub(crate) fn no_model(integrator: Integrator, error: &ExpressionError) -> OdeError {
    OdeError::NoModel { integrator, reason: error.to_string() }
}

/// A plant that is no [`Plant`] for others: those have integrators compiled for their equation.
#[derive(Clone, Debug)]
struct TextPlant(ExpressionPlant);

impl DynRhs for TextPlant {
    fn signature(&self) -> Signature<'_> {
        DynRhs::signature(&self.0)
    }

    fn rhs(&self, x: &[f64], u: &[f64], p: &[f64], dx: &mut [f64]) {
        Plant::rhs(&self.0, x, u, p, dx);
    }

    fn output(&self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        Plant::output(&self.0, x, u, p, y);
    }

    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        Plant::explain(&self.0, x, u, p)
    }

    fn jacobian(&self, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
        let function = &self.0.sparse.plant.rhs;
        let at = [x, u, p].concat();
        let entries = Isa::detect().dispatch(Entries { function, at: &at });
        dense(function.pattern(), &entries)
    }

    fn rhs_along(&self, at: [&[f64]; 3], along: [&[f64]; 3], dx: &mut [f64], slope: &mut [f64]) {
        DynRhs::rhs_along(&self.0, at, along, dx, slope);
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        DynRhs::vectorized(&self.0, isa)
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        Arc::new(self.clone())
    }
}

impl DynPlant for TextPlant {
    fn model(
        &self,
        integrator: Integrator,
        sample_time_s: f64,
        substeps: usize,
    ) -> Result<Box<dyn Model>, OdeError> {
        self.0.sparse.integrator(integrator, sample_time_s, substeps)
    }
}

/// The entries of a Jacobian at one point.
struct Entries<'a, F> {
    function: &'a F,
    at: &'a [f64],
}

impl<F: SparseFunction> Task for Entries<'_, F> {
    type Output = Vec<f64>;

    fn run<V: Simd>(self, zero: V) -> Vec<f64> {
        let Self { function, at } = self;
        let pattern = function.pattern();
        let mut memory = function.memory(zero);
        memory.iter_mut().zip(at).for_each(|(to, value)| *to = zero.constant(*value));
        let entries = &function.linearize(&mut memory)[pattern.rows()..];
        let first = |place: &u16| {
            let mut lanes = [0.0; 8];
            memory[usize::from(*place)].write(&mut lanes);
            lanes[0]
        };
        entries.iter().map(first).collect()
    }
}

/// A matrix with these entries, row by row.
fn dense(pattern: &SparsityPattern, entries: &[f64]) -> Vec<f64> {
    let mut matrix = vec![0.0; pattern.rows() * pattern.columns()];
    for (i, row) in matrix.chunks_exact_mut(pattern.columns()).enumerate() {
        for entry in pattern.row(i) {
            row[pattern.places()[entry]] = entries[entry];
        }
    }
    matrix
}
