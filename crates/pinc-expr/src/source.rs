//! The equations of a plant, as text or in Rust, for all that reads them as a graph.

use crate::plant_graph::PlantGraph;
use crate::{
    CostExpressions, CriticalTerms, Equations, ExpressionError, ExpressionPlant, Listing,
    rust_plant,
};
use pinc_ode::{DynPlant, Plant};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::Arc;

/// The equations of a plant, wherever they were written: [`Equations`] as text, or a [`Plant`] in
/// Rust, whose right-hand side is run once on numbers that record it.
///
/// Both are read as one graph of values. From it come the sparse Jacobians, the second derivatives,
/// families of parameters, generated code and the terms on which it depends where the equations are
/// smooth.
///
/// ```
/// use pinc_expr::PlantEquations;
/// use pinc_ode::Plant;
/// use pinc_plants::HydraulicServo;
///
/// let servo = HydraulicServo::default();
/// let recorded = PlantEquations::traced(servo).compile_with(&[])?;
/// let (mut one, mut other) = ([0.0; 4], [0.0; 4]);
/// servo.rhs(&[0.1, 0.02, 3.0, 0.4], &[0.5], &[], &mut one);
/// recorded.rhs(&[0.1, 0.02, 3.0, 0.4], &[0.5], &[], &mut other);
/// assert_eq!(one, other);
/// # Ok::<(), pinc_expr::ExpressionError>(())
/// ```
#[derive(Clone, Debug)]
pub struct PlantEquations(Source);

#[derive(Clone, Debug)]
enum Source {
    Text(Equations),
    Rust { plant: Arc<dyn Trace>, constants: BTreeMap<String, f64> },
}

/// A plant in Rust, with its type erased.
trait Trace: Debug + Send + Sync {
    /// The plant with these constants.
    fn erased(&self, constants: &BTreeMap<String, f64>) -> Box<dyn DynPlant>;

    /// See [`PlantGraph::traced`].
    fn trace(
        &self,
        constants: &BTreeMap<String, f64>,
        varying: &[&str],
        unrolled: bool,
        cost: Option<CostExpressions<'_>>,
    ) -> Result<PlantGraph, ExpressionError>;
}

impl<P: Plant> Trace for P {
    fn erased(&self, constants: &BTreeMap<String, f64>) -> Box<dyn DynPlant> {
        let own = self.constants().into_iter();
        let values: Vec<f64> =
            own.map(|(name, value)| constants.get(&name).copied().unwrap_or(value)).collect();
        rust_plant::into_dyn(self.with_constants(&values))
    }

    fn trace(
        &self,
        constants: &BTreeMap<String, f64>,
        varying: &[&str],
        unrolled: bool,
        cost: Option<CostExpressions<'_>>,
    ) -> Result<PlantGraph, ExpressionError> {
        PlantGraph::traced(self, constants, varying, unrolled, cost)
    }
}

impl From<Equations> for PlantEquations {
    fn from(text: Equations) -> Self {
        Self(Source::Text(text))
    }
}

impl PlantEquations {
    /// The equations of a plant in Rust.
    #[must_use]
    pub fn traced<P: Plant>(plant: P) -> Self {
        let constants = plant.constants().into_iter().collect();
        Self(Source::Rust { plant: Arc::new(plant), constants })
    }

    /// The parameters that may vary, with their values: the parameters of a text, or the
    /// [`Plant::constants`] of a plant in Rust.
    #[must_use]
    pub fn parameters(&self) -> &BTreeMap<String, f64> {
        match &self.0 {
            Source::Text(equations) => &equations.parameters,
            Source::Rust { constants, .. } => constants,
        }
    }

    /// The equations with other values for some parameters. Names that are no parameter's are left
    /// out.
    #[must_use]
    pub fn with_parameters<'n>(mut self, values: impl IntoIterator<Item = (&'n str, f64)>) -> Self {
        let parameters = match &mut self.0 {
            Source::Text(equations) => &mut equations.parameters,
            Source::Rust { constants, .. } => constants,
        };
        for (name, value) in values {
            parameters.entry(name.to_owned()).and_modify(|old| *old = value);
        }
        self
    }

    /// The plant with these equations and its type erased, all parameters fixed. The Runge-Kutta
    /// methods of a plant in Rust are compiled for it; all else reads the graph.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with equations that are text.
    pub fn to_dyn(&self) -> Result<Box<dyn DynPlant>, ExpressionError> {
        match &self.0 {
            Source::Text(equations) => Ok(equations.compile_with(&[])?.into_dyn()),
            Source::Rust { plant, constants } => Ok(plant.erased(constants)),
        }
    }

    /// The plant with these equations, in which the parameters named in `varying` are, in this
    /// order, the last of p. The others are constants.
    ///
    /// # Errors
    ///
    /// As [`Equations::compile_with`]; an equation in Rust that cannot be recorded, or is too large.
    pub fn compile_with(&self, varying: &[&str]) -> Result<ExpressionPlant, ExpressionError> {
        self.graph(varying, false, None)?.compile()
    }

    /// [`PlantEquations::compile_with`] with a cost beside the equations: behind the plant's own
    /// states come the time `t` and the cost integrated so far, and behind its outputs, which are
    /// the states if it has none, the rate of the cost and the cost of an end.
    ///
    /// ```
    /// use pinc_expr::{CostExpressions, PlantEquations};
    /// use pinc_ode::Plant;
    /// use pinc_plants::OneTank;
    ///
    /// let cost = CostExpressions { stage: "p*u + t", terminal: "-h", parameters: &[("p".into(), 2.0)].into() };
    /// let plant = PlantEquations::traced(OneTank::default()).compile_with_cost(&[], cost)?;
    /// let mut dx = [0.0; 3];
    /// plant.rhs(&[4.0, 10.0, 0.0], &[0.5], &[], &mut dx);
    /// assert_eq!(dx[1..], [1.0, 11.0]);
    /// # Ok::<(), pinc_expr::ExpressionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`PlantEquations::compile_with`]; the first thing that is wrong with the cost, at the key
    /// `stage` or `terminal`.
    pub fn compile_with_cost(
        &self,
        varying: &[&str],
        cost: CostExpressions<'_>,
    ) -> Result<ExpressionPlant, ExpressionError> {
        self.graph(varying, false, Some(cost))?.compile()
    }

    /// [`PlantEquations::compile_with`], or with a `cost` [`PlantEquations::compile_with_cost`], in
    /// stretched time: all derivatives, and the rates of the time and the cost, are multiplied by
    /// the input at place `input`. A step of length T of this plant is a step of input times T of the
    /// plant itself.
    ///
    /// # Errors
    ///
    /// As those.
    ///
    /// # Panics
    ///
    /// If there is no such input.
    pub fn compile_stretched(
        &self,
        varying: &[&str],
        cost: Option<CostExpressions<'_>>,
        input: usize,
    ) -> Result<ExpressionPlant, ExpressionError> {
        let mut graph = self.graph(varying, false, cost)?;
        graph.stretch_time(input);
        graph.compile()
    }

    /// The values that they are computed from; `unrolled`: with the steps of what a plant in Rust
    /// solves inside.
    fn graph(
        &self,
        varying: &[&str],
        unrolled: bool,
        cost: Option<CostExpressions<'_>>,
    ) -> Result<PlantGraph, ExpressionError> {
        match &self.0 {
            Source::Text(equations) => equations.graph_with_cost(varying, cost),
            Source::Rust { plant, constants } => plant.trace(constants, varying, unrolled, cost),
        }
    }

    /// The right-hand side as a list of instructions: see [`Equations::listing`]. Equations that a
    /// plant in Rust solves inside are listed as the steps of their solution.
    ///
    /// # Errors
    ///
    /// As [`PlantEquations::compile_with`]; equations solved inside by as many steps as it takes.
    pub fn listing(&self, varying: &[&str]) -> Result<Listing, ExpressionError> {
        self.graph(varying, true, None)?.listing()
    }

    /// The outputs as a list of instructions, if they are not the states.
    ///
    /// # Errors
    ///
    /// As [`PlantEquations::listing`].
    pub fn output_listing(&self, varying: &[&str]) -> Result<Listing, ExpressionError> {
        self.graph(varying, true, None)?.output_listing()
    }

    /// The terms on which it depends where these equations are defined and smooth.
    ///
    /// # Errors
    ///
    /// As [`PlantEquations::compile_with`].
    pub fn critical_terms(&self) -> Result<CriticalTerms, ExpressionError> {
        self.graph(&[], false, None)?.critical_terms()
    }
}
