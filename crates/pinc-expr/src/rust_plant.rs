//! Plants in Rust with their type erased: compiled Runge-Kutta methods, and what reads their graph.

use crate::{ExpressionError, ExpressionPlant, PlantEquations};
use pinc_ad::simd::Isa;
use pinc_ode::{
    AnyVectorRhs, Dims, DynPlant, DynRhs, Integrator, Model, Plant, Rk4, Rk5, Rodas4, Variable,
};
use std::sync::{Arc, OnceLock};

/// `plant` with its type erased. The right-hand side and the Runge-Kutta methods are compiled for
/// it; the Rosenbrock method reads its graph ([`PlantEquations::traced`]), which is made when it is
/// asked for.
pub fn into_dyn<P: Plant>(plant: P) -> Box<dyn DynPlant> {
    Box::new(RustPlant { plant, recorded: OnceLock::new() })
}

#[derive(Debug)]
struct RustPlant<P> {
    plant: P,
    recorded: OnceLock<Result<ExpressionPlant, ExpressionError>>,
}

impl<P: Plant> RustPlant<P> {
    fn recorded(&self) -> Result<&ExpressionPlant, ExpressionError> {
        let record = || PlantEquations::traced(self.plant.clone()).compile_with(&[]);
        self.recorded.get_or_init(record).as_ref().map_err(Clone::clone)
    }
}

impl<P: Plant> DynRhs for RustPlant<P> {
    fn dims(&self) -> Dims {
        DynRhs::dims(&self.plant)
    }

    fn states(&self) -> &[Variable] {
        DynRhs::states(&self.plant)
    }

    fn inputs(&self) -> &[Variable] {
        DynRhs::inputs(&self.plant)
    }

    fn parameters(&self) -> &[Variable] {
        DynRhs::parameters(&self.plant)
    }

    fn outputs(&self) -> &[Variable] {
        DynRhs::outputs(&self.plant)
    }

    fn rhs(&self, x: &[f64], u: &[f64], p: &[f64], dx: &mut [f64]) {
        DynRhs::rhs(&self.plant, x, u, p, dx);
    }

    fn output(&self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        DynRhs::output(&self.plant, x, u, p, y);
    }

    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        DynRhs::explain(&self.plant, x, u, p)
    }

    fn jacobian(&self, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
        DynRhs::jacobian(&self.plant, x, u, p)
    }

    fn rhs_along(&self, at: [&[f64]; 3], along: [&[f64]; 3], dx: &mut [f64], slope: &mut [f64]) {
        self.plant.rhs_along(at, along, dx, slope);
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        self.plant.vectorized(isa)
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        self.plant.to_shared()
    }
}

impl<P: Plant> DynPlant for RustPlant<P> {
    fn model(&self, integrator: Integrator, sample_time_s: f64, substeps: usize) -> Box<dyn Model> {
        let plant = || self.plant.clone();
        match integrator {
            Integrator::Rk4 => Box::new(Rk4::new(plant(), sample_time_s, substeps)),
            Integrator::Rk5 => Box::new(Rk5::new(plant(), sample_time_s, substeps)),
            Integrator::Rosenbrock => self
                .recorded()
                .and_then(|recorded| recorded.rosenbrock(sample_time_s, substeps))
                .unwrap_or_else(|_| Box::new(Rodas4::new(plant(), sample_time_s, substeps))),
        }
    }
}
