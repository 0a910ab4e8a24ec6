//! A plant with some parameters and under some load.

use crate::Dims;
use crate::dyn_plant::{AnyVectorRhs, DynRhs, Signature, VectorDual, VectorRhs};
use pinc_ad::Scalar;
use pinc_ad::simd::{Isa, Simd, Task};
use std::sync::Arc;

/// A plant whose parameters are held, under constant loads:
///
/// ```text
/// x' = f(x, u + d, p) + w,  y = h(x, u + d, p)
/// ```
///
/// It has no parameters of its own.
///
/// ```
/// use pinc_ode::{DynRhs, Loaded};
/// use pinc_plants::VanDerPol;
/// use std::sync::Arc;
///
/// let nominal = Arc::new(VanDerPol::default());
/// let pushed = Loaded::new(nominal, vec![], vec![-0.15], vec![0.0, 0.0]);
/// let mut dx = [0.0; 2];
/// pushed.rhs(&[0.0, 0.0], &[0.15], &[], &mut dx);
/// assert_eq!(dx, [0.0, 0.0]);
/// ```
#[derive(Clone, Debug)]
pub struct Loaded {
    plant: Arc<dyn DynRhs>,
    p: Vec<f64>,
    inputs: Vec<f64>,
    rates: Vec<f64>,
}

impl Loaded {
    /// `plant` with the parameters `p`, under the load d = `inputs` and w = `rates`.
    ///
    /// # Shapes
    ///
    /// `p`: `np` of the plant; `inputs`: `nu`; `rates`: `nx`, in units of the states per second.
    ///
    /// # Panics
    ///
    /// If one of them is of another length.
    #[must_use]
    pub fn new(plant: Arc<dyn DynRhs>, p: Vec<f64>, inputs: Vec<f64>, rates: Vec<f64>) -> Self {
        let Dims { nx, nu, np, .. } = plant.dims();
        assert_eq!((p.len(), inputs.len(), rates.len()), (np, nu, nx), "lengths");
        Self { plant, p, inputs, rates }
    }

    /// u + d
    fn acting(&self, u: &[f64]) -> Vec<f64> {
        u.iter().zip(&self.inputs).map(|(u, d)| u + d).collect()
    }
}

impl DynRhs for Loaded {
    fn signature(&self) -> Signature<'_> {
        Signature { parameters: &[], ..self.plant.signature() }
    }

    fn rhs(&self, x: &[f64], u: &[f64], _p: &[f64], dx: &mut [f64]) {
        self.plant.rhs(x, &self.acting(u), &self.p, dx);
        dx.iter_mut().zip(&self.rates).for_each(|(dx, w)| *dx += w);
    }

    fn output(&self, x: &[f64], u: &[f64], _p: &[f64], y: &mut [f64]) {
        self.plant.output(x, &self.acting(u), &self.p, y);
    }

    fn explain(&self, x: &[f64], u: &[f64], _p: &[f64]) -> Option<String> {
        self.plant.explain(x, &self.acting(u), &self.p)
    }

    fn jacobian(&self, x: &[f64], u: &[f64], _p: &[f64]) -> Vec<f64> {
        let columns = x.len() + u.len();
        let all = self.plant.jacobian(x, &self.acting(u), &self.p);
        let rows = all.chunks_exact(columns + self.p.len());
        rows.flat_map(|row| &row[..columns]).copied().collect()
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        isa.dispatch(Vectorize { plant: self, isa })
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        Arc::new(self.clone())
    }
}

struct Vectorize<'a> {
    plant: &'a Loaded,
    isa: Isa,
}

impl Task for Vectorize<'_> {
    type Output = AnyVectorRhs;

    fn run<V: Simd>(self, _zero: V) -> AnyVectorRhs {
        let Loaded { plant, p, inputs, rates } = self.plant.clone();
        let rhs = plant.vectorized(self.isa).on::<V>();
        AnyVectorRhs::of::<V>(Box::new(LoadedVectors { rhs, p, inputs, rates }))
    }
}

/// The same on vectors.
#[derive(Debug)]
struct LoadedVectors<V> {
    rhs: Box<dyn VectorRhs<V>>,
    p: Vec<f64>,
    inputs: Vec<f64>,
    rates: Vec<f64>,
}

impl<V: Simd> VectorRhs<V> for LoadedVectors<V> {
    fn rhs(
        &self,
        x: &[VectorDual<V>],
        u: &[VectorDual<V>],
        _p: &[VectorDual<V>],
        dx: &mut [VectorDual<V>],
    ) {
        let acting: Vec<_> = u.iter().zip(&self.inputs).map(|(u, d)| *u + *d).collect();
        let p: Vec<_> = self.p.iter().map(|p| x[0].constant(*p)).collect();
        self.rhs.rhs(x, &acting, &p, dx);
        dx.iter_mut().zip(&self.rates).for_each(|(dx, w)| *dx = *dx + *w);
    }
}
