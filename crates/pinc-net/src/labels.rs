//! The targets of a distilled net: the plant's states after T.

use crate::sampling::Points;
use crate::{Ansatz, Measurements, NetError, PincNet, TrainingTarget, Workers};
use pinc_ode::{DynRhs, Simulator};
use rayon::prelude::*;

/// Local error tolerance of the integration: far below what nets reach.
const TOLERANCE: f64 = 1e-11;

/// States after T by an accurate integration. A sample that grows keeps its points, so that only
/// the new ones are integrated.
#[derive(Debug)]
pub(crate) struct Labels {
    integrator: Simulator,
    sample_time_s: f64,
    known: Measurements,
}

impl Labels {
    /// Labels without points; `None` for a net that is trained on the equation.
    pub(crate) fn for_net(plant: &dyn DynRhs, net: &PincNet) -> Result<Option<Self>, NetError> {
        if net.source == TrainingTarget::Physics {
            return Ok(None);
        }
        if net.ansatz != Ansatz::HardLinear || net.time_only.is_some() {
            let (key, found) = ("source", "integrator".to_owned());
            let expected =
                "\"physics\" for a net of one scenario or without the hard initial condition";
            return Err(NetError::Setting { key, found, expected });
        }
        let integrator = Simulator::new(plant, TOLERANCE);
        let known = Measurements::new(plant.dims());
        Ok(Some(Self { integrator, sample_time_s: net.sample_time_s, known }))
    }

    /// The states after T from the initial states and inputs of `points`, whose times are
    /// ignored. The first points must be those of the previous call.
    pub(crate) fn of(
        &mut self,
        points: &Points,
        workers: &Workers,
    ) -> Result<&Measurements, NetError> {
        let Self { integrator, sample_time_s, known } = self;
        let new = known.len()..points.len();
        let integrate = |i: usize| {
            let mut y = points.state(i).to_vec();
            // A fresh integrator has adapted no step size yet: the same bits on any number of
            // threads.
            let mut fresh = integrator.clone();
            fresh.set_parameters(points.parameters(i));
            fresh.integrate(&mut y, points.input(i), *sample_time_s)?;
            Ok(y)
        };
        let ends: Result<Vec<_>, NetError> =
            workers.pool.install(|| new.clone().into_par_iter().map(integrate).collect());
        for (i, y) in new.zip(ends?) {
            let y: Vec<_> = y.into_iter().map(Some).collect();
            let [x, u, p] = [points.state(i), points.input(i), points.parameters(i)];
            known.push(*sample_time_s, x, u, p, &y);
        }
        Ok(known)
    }
}
