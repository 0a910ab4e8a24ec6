//! The state after some time with its derivative along one direction.

use crate::dyn_plant::{AnyVectorRhs, DynRhs, Signature};
use crate::{AccurateIntegrator, BlackBox, Dims, Flow, Linearization, OdeError, Stages, Variable};
use pinc_ad::simd::Isa;
use std::sync::Arc;

/// A plant in time, accurately, with the derivative of its state along a direction v of the initial
/// state, the input and the parameters.
///
/// The variational equation s' = df/dx s + df/d(u, p) v, whose right-hand side is evaluated on dual
/// numbers, is integrated beside the plant's own with the same tolerance; a black box is asked for
/// its Jacobians.
#[derive(Clone, Debug)]
pub struct Tangent(Kind);

#[derive(Clone, Debug)]
enum Kind {
    Equation { dims: Dims, integrator: Box<AccurateIntegrator> },
    BlackBox { dims: Dims, flow: Arc<dyn Flow> },
}

impl BlackBox {
    /// Whether its flow has derivatives.
    #[must_use]
    pub fn has_derivatives(&self) -> bool {
        // Of no point: what is asked is whether there is an answer.
        let out = Linearization { next: &mut [], a: &mut [], b: &mut [], e: &mut [] };
        self.flow.linearize(Stages { x: &[], u: &[], p: &[] }, 1.0, out).is_some()
    }
}

impl Tangent {
    /// Returns the tangent of `plant`, with this local error tolerance, absolute and relative; `None` for a black
    /// box without derivatives.
    ///
    /// # Panics
    ///
    /// If `tolerance` is not positive.
    #[must_use]
    pub fn new(plant: &dyn DynRhs, tolerance: f64) -> Option<Self> {
        let dims = plant.dims();
        let Some(black_box) = plant.black_box() else {
            let both = Arc::new(WithTangent::new(plant));
            let integrator = Box::new(AccurateIntegrator::shared(both, tolerance));
            return Some(Self(Kind::Equation { dims, integrator }));
        };
        let flow = black_box.flow.clone();
        black_box.has_derivatives().then_some(Self(Kind::BlackBox { dims, flow }))
    }

    /// Moves `x` on by `duration` seconds under the constant input `u` of the plant with the
    /// parameters `p`, and writes the derivative of what it becomes along `direction` into `slope`.
    ///
    /// # Shapes
    ///
    /// `x`, `slope`: `nx`; `u`: `nu`; `p`: `np`; `direction`: `nx + nu + np`, of `x`, `u` and `p`.
    ///
    /// # Errors
    ///
    /// See [`Simulator::integrate`](crate::Simulator::integrate), also for a derivative that
    /// is not finite.
    ///
    /// # Panics
    ///
    /// If a length does not fit, or `duration` is negative or not finite.
    pub fn integrate(
        &mut self,
        x: &mut [f64],
        (u, p): (&[f64], &[f64]),
        (direction, slope): (&[f64], &mut [f64]),
        duration: f64,
    ) -> Result<(), OdeError> {
        let (nx, nu) = (x.len(), u.len());
        assert_eq!(direction.len(), nx + nu + p.len(), "length of the direction");
        let (of_x, rest) = direction.split_at(nx);
        let (of_u, of_p) = rest.split_at(nu);
        match &mut self.0 {
            Kind::Equation { dims, integrator } => {
                assert_eq!([nx, nu, p.len()], [dims.nx, dims.nu, dims.np], "lengths");
                let mut both = [&*x, of_x].concat();
                integrator.set_parameters(&[p, of_p].concat());
                integrator
                    .integrate(&mut both, &[u, of_u].concat(), duration)
                    .map_err(|error| of_plant(error, nx))?;
                x.copy_from_slice(&both[..nx]);
                slope.copy_from_slice(&both[nx..]);
                Ok(())
            }
            Kind::BlackBox { dims, flow } => {
                assert_eq!([nx, nu, p.len()], [dims.nx, dims.nu, 0], "lengths");
                let start = x.to_vec();
                let (mut a, mut b) = (vec![0.0; nx * nx], vec![0.0; nx * nu]);
                let out = Linearization { next: x, a: &mut a, b: &mut b, e: &mut [] };
                let at = Stages { x: &start, u, p: &[] };
                flow.linearize(at, duration, out).unwrap_or_else(|| {
                    Err(OdeError::External { reason: "no derivatives here".to_owned() })
                })?;
                for (i, slope) in slope.iter_mut().enumerate() {
                    *slope = dot(&a[i * nx..][..nx], of_x) + dot(&b[i * nu..][..nu], of_u);
                }
                match x.iter().chain(&*slope).all(|value| value.is_finite()) {
                    true => Ok(()),
                    false => Err(OdeError::NotFinite { t: 0.0, state: start }),
                }
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// An error with the plant's own state alone.
fn of_plant(mut error: OdeError, nx: usize) -> OdeError {
    if let OdeError::NotFinite { state, .. } | OdeError::Undefined { state, .. } = &mut error {
        state.truncate(nx);
    }
    error
}

/// A plant with its tangent as a plant: the states x, s, the inputs u, v of u, and the parameters
/// p, v of p.
#[derive(Clone, Debug)]
struct WithTangent {
    plant: Arc<dyn DynRhs>,
    states: Vec<Variable>,
    inputs: Vec<Variable>,
    parameters: Vec<Variable>,
}

impl WithTangent {
    fn new(plant: &dyn DynRhs) -> Self {
        let twice = |variables: &[Variable]| [variables, variables].concat();
        Self {
            states: twice(plant.states()),
            inputs: twice(plant.inputs()),
            parameters: twice(plant.parameters()),
            plant: plant.to_shared(),
        }
    }
}

/// The two halves of a vector.
fn halves(values: &[f64]) -> (&[f64], &[f64]) {
    values.split_at(values.len() / 2)
}

impl DynRhs for WithTangent {
    fn signature(&self) -> Signature<'_> {
        let Self { states, inputs, parameters, .. } = self;
        Signature { states, inputs, parameters, outputs: states }
    }

    fn rhs(&self, x: &[f64], u: &[f64], p: &[f64], dx: &mut [f64]) {
        let ((x, s), (u, of_u), (p, of_p)) = (halves(x), halves(u), halves(p));
        let (dx, ds) = dx.split_at_mut(x.len());
        self.plant.rhs_along([x, u, p], [s, of_u, of_p], dx, ds);
    }

    fn output(&self, x: &[f64], _u: &[f64], _p: &[f64], y: &mut [f64]) {
        y.copy_from_slice(x);
    }

    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        self.plant.explain(halves(x).0, halves(u).0, halves(p).0)
    }

    /// The Jacobian without the second derivatives of f, by which s depends on x. Only the implicit
    /// method asks for it, and extrapolation keeps its order with any matrix in place of the Jacobian.
    /// Its stability depends on the eigenvalues, which are the full Jacobian's.
    fn jacobian(&self, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
        let Dims { nx, nu, np, .. } = self.dims();
        let of_plant = self.plant.jacobian(halves(x).0, halves(u).0, halves(p).0);
        let (n, width) = (nx / 2, nx + nu + np);
        let mut all = vec![0.0; nx * width];
        for (i, row) in of_plant.chunks_exact(width / 2).enumerate() {
            all[i * width..][..n].copy_from_slice(&row[..n]);
            all[(n + i) * width + n..][..n].copy_from_slice(&row[..n]);
        }
        all
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        AnyVectorRhs::none(isa)
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        Arc::new(self.clone())
    }
}
