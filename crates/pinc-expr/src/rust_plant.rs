//! Plants in Rust with their type erased: compiled Runge-Kutta methods, and what reads their graph.

use crate::plant_graph::PlantGraph;
use crate::text_plant::no_model;
use crate::{ExpressionError, SparseEquations};
use pinc_ad::Scalar;
use pinc_ode::{DynPlant, Integrator, Model, OdeError, Plant, Rk4, Rk5, Variable};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// `plant` with its type erased. The right-hand side is compiled for it, and so are the Runge-Kutta
/// methods of a small plant ([`Rk4::suits`]). All other integrators read its graph
/// ([`PlantEquations::traced`](crate::PlantEquations::traced)), which is made when it is asked for.
pub fn into_dyn<P: Plant>(plant: P) -> Box<dyn DynPlant> {
    Box::new(RustPlant { plant, recorded: OnceLock::new() })
}

#[derive(Clone, Debug)]
struct RustPlant<P> {
    plant: P,
    recorded: OnceLock<Result<SparseEquations, ExpressionError>>,
}

impl<P: Plant> Plant for RustPlant<P> {
    fn states(&self) -> &[Variable] {
        self.plant.states()
    }

    fn inputs(&self) -> &[Variable] {
        self.plant.inputs()
    }

    fn parameters(&self) -> &[Variable] {
        self.plant.parameters()
    }

    fn outputs(&self) -> &[Variable] {
        self.plant.outputs()
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        self.plant.rhs(x, u, p, dx);
    }

    #[inline(always)]
    fn output<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], y: &mut [S]) {
        self.plant.output(x, u, p, y);
    }

    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        self.plant.explain(x, u, p)
    }
}

impl<P: Plant> RustPlant<P> {
    fn recorded(&self) -> Result<&SparseEquations, ExpressionError> {
        let record = || {
            let constants: BTreeMap<_, _> = self.plant.constants().into_iter().collect();
            PlantGraph::traced(&self.plant, &constants, &[], false, None)?.into_sparse()
        };
        self.recorded.get_or_init(record).as_ref().map_err(Clone::clone)
    }
}

impl<P: Plant> DynPlant for RustPlant<P> {
    fn model(
        &self,
        integrator: Integrator,
        sample_time_s: f64,
        substeps: usize,
    ) -> Result<Box<dyn Model>, OdeError> {
        let (plant, suits) = (|| self.plant.clone(), Rk4::suits(&self.plant));
        match integrator {
            Integrator::Rk4 if suits => Ok(Box::new(Rk4::new(plant(), sample_time_s, substeps))),
            Integrator::Rk5 if suits => Ok(Box::new(Rk5::new(plant(), sample_time_s, substeps))),
            Integrator::Rk4 | Integrator::Rk5 | Integrator::Rosenbrock => self
                .recorded()
                .map_err(|error| no_model(integrator, &error))?
                .integrator(integrator, sample_time_s, substeps),
        }
    }
}
