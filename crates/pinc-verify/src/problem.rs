//! The error of one step of a model, over boxes of states, inputs and parameters.

use crate::basis::Basis;
use crate::equation::Equation;
use crate::error::VerifyError;
use crate::flow::{Flow, FlowArithmetic};
use crate::kernel::{LANES, lanes};
use crate::map::Map;
use crate::polynomial::{Cuts, Polynomial};
use crate::rounding::{UNIT, to_f64};
use crate::taylor::{Arithmetic, Taylor};
use pinc_ad::simd::Isa;
use pinc_expr::PlantEquations;
use pinc_net::{FoldedNet, PincNet};
use pinc_ode::Tableau;

/// The most variables, of states, inputs and parameters together, over which boxes are enclosed.
pub const MOST_VARIABLES: usize = 7;

/// The model whose step is judged.
#[derive(Clone, Copy, Debug)]
pub enum StepModel<'a> {
    /// A net, at t = T.
    Net(&'a PincNet),
    /// An explicit Runge-Kutta method with so many substeps.
    RungeKutta(Tableau, usize),
}

/// One step of a model beside the flow of the equation that it stands for.
///
/// What is enclosed is y(x, u, p) - z(x, u, p), with y the model in exact arithmetic (its weights,
/// or the method's coefficients, as they are stored) and z the exact solution of the equation after
/// `sample_time_s`, with constants as they are stored.
#[derive(Clone, Debug)]
pub struct StepError {
    pub(crate) flow: Flow,
    pub(crate) map: Map,
    pub(crate) variables: usize,
    isa: Isa,
}

/// How boxes are enclosed.
#[derive(Clone, Debug)]
pub(crate) struct Enclosing {
    flow: FlowArithmetic,
    pub(crate) cuts: Cuts,
}

impl Enclosing {
    /// Coefficients of a polynomial in the variables.
    pub(crate) fn coefficients(&self) -> usize {
        self.flow.space.basis.monomials()
    }
}

/// The enclosed error in one box.
#[derive(Clone, Debug)]
pub(crate) struct BoxError {
    /// For each state a polynomial.
    pub(crate) polynomials: Vec<Polynomial>,
    /// Bounds of what the model's and the flow's polynomials miss, for each state.
    pub(crate) of_map: Vec<f64>,
    pub(crate) of_flow: Vec<f64>,
    /// How much the terms of the highest degrees of model and flow change with each variable.
    pub(crate) drives: [Vec<f64>; 2],
    /// Where the flow is not enclosed: the variable that drives what is known worst of the equation.
    pub(crate) obstacle: Option<usize>,
}

impl StepError {
    /// The step of `model` over `sample_time_s` beside the flow of `equations`, in which the
    /// parameters `varying` are variables after states and inputs.
    ///
    /// # Errors
    ///
    /// [`VerifyError`] if the equations cannot be listed, or the net knows one scenario only.
    pub fn new(
        equations: &PlantEquations,
        varying: &[&str],
        inputs: usize,
        model: StepModel<'_>,
        sample_time_s: f64,
    ) -> Result<Self, VerifyError> {
        let listing = equations.listing(varying).map_err(VerifyError::Equations)?;
        let equation = Equation::new(listing);
        let variables = equation.states() + inputs + varying.len();
        let map = match model {
            StepModel::Net(net) => Map::Net(FoldedNet::new(net).map_err(VerifyError::Net)?),
            StepModel::RungeKutta(tableau, substeps) => Map::RungeKutta {
                equation: equation.clone(),
                tableau,
                h: sample_time_s / to_f64(substeps),
                substeps,
            },
        };
        let isa = Isa::detect();
        Ok(Self { flow: Flow { equation, sample_time_s }, map, variables, isa })
    }

    /// The number of states.
    #[must_use]
    pub fn states(&self) -> usize {
        self.flow.equation.states()
    }

    /// The number of states, inputs and parameters together.
    #[must_use]
    pub fn variables(&self) -> usize {
        self.variables
    }

    /// Polynomials of `degree` in the variables, with `order` powers of the time.
    pub(crate) fn enclosing(&self, degree: usize, order: usize) -> Enclosing {
        self.enclosing_in(Basis::of_space(self.variables, degree), order)
    }

    /// Numbers instead of polynomials, for points.
    pub(crate) fn enclosing_points(&self, order: usize) -> Enclosing {
        self.enclosing_in(Basis::of_space(0, 0), order)
    }

    fn enclosing_in(&self, basis: Basis, order: usize) -> Enclosing {
        let cuts = Cuts::new(&basis);
        Enclosing { flow: FlowArithmetic::new(basis, order, self.isa), cuts }
    }

    /// The error in up to [`LANES`] boxes, each given by the ends of all variables, with `steps`
    /// steps of the flow, a power of 2.
    pub(crate) fn enclose(
        &self,
        over: &Enclosing,
        boxes: &[&[[f64; 2]]],
        steps: usize,
    ) -> Vec<BoxError> {
        let space = &over.flow.space;
        let variables: Vec<Taylor> =
            (0..self.variables).map(|i| variable(space, boxes, i)).collect();
        let (states, held) = variables.split_at(self.states());
        let mapped = self.map.run(space, &variables);
        let flown = self.flow.run(&over.flow, states, held, steps);
        let error = |lane: usize| {
            let known = flown.iter().all(|state| state.remainder[lane].is_finite());
            let obstacle =
                if known { None } else { self.flow.equation.driver(space, &variables, lane) };
            BoxError { obstacle, ..box_error(over, lane, &mapped, &flown) }
        };
        (0..boxes.len()).map(error).collect()
    }
}

/// Variable `i` in some boxes: a middle and a radius that cover the ends. The last box fills the
/// lanes that are left.
pub(crate) fn variable(over: &Arithmetic, boxes: &[&[[f64; 2]]], i: usize) -> Taylor {
    let ends = |lane: usize| boxes[lane.min(boxes.len() - 1)][i];
    let middle = lanes(|lane| {
        let [low, high] = ends(lane);
        if low < high { 0.5 * low + 0.5 * high } else { low }
    });
    let radius = lanes(|lane| {
        let [low, high] = ends(lane);
        let radius = (high - middle[lane]).max(middle[lane] - low);
        if radius > 0.0 { radius.next_up() } else { 0.0 }
    });
    let mut model = over.constant(middle);
    match model.coefficients.get_mut(1 + i) {
        // The monomials of degree 1 come after the constant, in the order of the variables.
        Some(coefficient) if over.basis.degree() > 0 => *coefficient = radius,
        _ => model.remainder = radius,
    }
    model
}

pub(crate) fn box_error(
    over: &Enclosing,
    lane: usize,
    mapped: &[Taylor],
    flown: &[Taylor],
) -> BoxError {
    let of = |model: &Taylor| -> Vec<f64> { model.coefficients.iter().map(|c| c[lane]).collect() };
    let remainders = |models: &[Taylor]| models.iter().map(|m| m.remainder[lane]).collect();
    let difference = |(map, flow): (&Taylor, &Taylor)| {
        let pairs = map.coefficients.iter().zip(&flow.coefficients);
        // Each difference is rounded by u; twice that has room for the rounding of the sum.
        let mut size = 0.0;
        let coefficients = pairs.map(|(a, b)| {
            size += a[lane].abs() + b[lane].abs();
            a[lane] - b[lane]
        });
        Polynomial { coefficients: coefficients.collect(), rounding: 2.0 * UNIT * size }
    };
    let high = u32::try_from(over.flow.space.basis.degree().saturating_sub(1)).unwrap_or(0);
    let drives = [mapped, flown].map(|models| {
        let each = models.iter().map(|model| over.cuts.changes(&of(model), high.max(1)));
        each.reduce(|a, b| a.iter().zip(b).map(|(a, b)| a + b).collect()).unwrap_or_default()
    });
    BoxError {
        polynomials: mapped.iter().zip(flown).map(difference).collect(),
        of_map: remainders(mapped),
        of_flow: remainders(flown),
        drives,
        obstacle: None,
    }
}

/// The widths of the lanes in which boxes are enclosed together.
pub(crate) const TOGETHER: usize = LANES;
