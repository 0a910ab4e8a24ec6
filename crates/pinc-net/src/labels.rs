//! The targets of a distilled net: the plant's states after T, and their derivatives.

use crate::error::check;
use crate::sampling::{Points, Purpose, rng};
use crate::{Ansatz, Measurements, NetError, PincNet, TrainingTarget, Workers};
use pinc_ode::{DynRhs, Simulator, Tangent};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

/// Local error tolerance of the integration: far below what nets reach.
const TOLERANCE: f64 = 1e-11;

/// States after T by an accurate integration. A sample that grows keeps its points, so that only
/// the new ones are integrated.
#[derive(Debug)]
pub(crate) struct Labels {
    source: Source,
    sample_time_s: f64,
    known: Measurements,
}

#[derive(Debug)]
enum Source {
    Values(Simulator),
    /// With the derivative along one direction per point.
    Slopes(Tangent, Box<Directions>),
}

/// Random directions of unit length, where half the width of the domain is 1.
#[derive(Debug)]
struct Directions {
    half_widths: Vec<f64>,
    random: ChaCha8Rng,
}

impl Labels {
    /// Labels without points, with derivatives along directions drawn from `seed` if they are
    /// wanted; `None` for a net that is trained on the equation.
    pub(crate) fn for_net(
        plant: &dyn DynRhs,
        net: &PincNet,
        with_derivatives: bool,
        (seed, purpose): (u64, Purpose),
    ) -> Result<Option<Self>, NetError> {
        if net.source == TrainingTarget::Physics {
            return Ok(None);
        }
        let is_known = net.ansatz == Ansatz::HardLinear && net.time_only.is_none();
        let expected =
            "\"physics\" for a net of one scenario or without the hard initial condition";
        check(is_known, "source", "integrator", expected)?;
        let source = match with_derivatives.then(|| Tangent::new(plant, TOLERANCE)) {
            None => Source::Values(Simulator::new(plant, TOLERANCE)),
            Some(Some(tangent)) => {
                let random = rng(seed, purpose);
                let half_widths = net.domain.ends().map(|(low, high)| (high - low) / 2.0).collect();
                Source::Slopes(tangent, Box::new(Directions { half_widths, random }))
            }
            Some(None) => {
                let (key, found) = ("derivatives", "a weight".to_owned());
                let expected = "none: the plant is a program that has no derivatives";
                return Err(NetError::Setting { key, found, expected });
            }
        };
        let known = Measurements::new(plant.dims());
        Ok(Some(Self { source, sample_time_s: net.sample_time_s, known }))
    }

    /// The states after T from the initial states and inputs of `points`, whose times are ignored.
    /// The first points must be the points of the previous call.
    pub(crate) fn of(
        &mut self,
        points: &Points,
        workers: &Workers,
    ) -> Result<&Measurements, NetError> {
        let Self { source, sample_time_s, known } = self;
        let (new, duration) = (known.len()..points.len(), *sample_time_s);
        // In the order of the points, which have the same directions whenever they are added.
        let directions: Vec<_> = match source {
            Source::Values(_) => vec![Vec::new(); new.len()],
            Source::Slopes(_, directions) => new.clone().map(|_| directions.draw()).collect(),
        };
        let integrate = |(i, direction): (usize, &Vec<f64>)| {
            let mut y = points.state(i).to_vec();
            let (u, p) = (points.input(i), points.parameters(i));
            let mut slope = Vec::new();
            // A fresh integrator has adapted no step size yet: the same bits on any number of
            // threads.
            match &*source {
                Source::Values(integrator) => {
                    let mut fresh = integrator.clone();
                    fresh.set_parameters(p);
                    fresh.integrate(&mut y, u, duration)?;
                }
                Source::Slopes(tangent, _) => {
                    slope.resize(y.len(), 0.0);
                    let along = (&direction[..], &mut slope[..]);
                    tangent.clone().integrate(&mut y, (u, p), along, duration)?;
                }
            }
            Ok((y, slope))
        };
        let ends: Result<Vec<_>, NetError> = workers
            .pool
            .install(|| new.clone().into_par_iter().zip(&directions).map(integrate).collect());
        for ((i, direction), (y, slope)) in new.zip(&directions).zip(ends?) {
            let y: Vec<_> = y.into_iter().map(Some).collect();
            let [x, u, p] = [points.state(i), points.input(i), points.parameters(i)];
            known.push(duration, x, u, p, &y);
            if !slope.is_empty() {
                known.push_slope(direction, &slope);
            }
        }
        Ok(known)
    }
}

impl Directions {
    fn draw(&mut self) -> Vec<f64> {
        let Self { half_widths, random } = self;
        let drawn: Vec<f64> = half_widths.iter().map(|_| random.sample(StandardNormal)).collect();
        let length = drawn.iter().map(|v| v * v).sum::<f64>().sqrt();
        drawn.iter().zip(half_widths).map(|(v, half)| v / length * *half).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Domain, NetConfig};
    use pinc_plants::VanDerPol;

    /// Directions have unit length where half the width of each range is 1, whatever the range is,
    /// and each is another one.
    #[test]
    fn directions_have_the_scale_of_the_domain() {
        let domain = Domain::new([0.0..=1.0, -3.0..=3.0], [-1.0..=3.0]);
        let plant = VanDerPol::default();
        let mut net = PincNet::new(&plant, &NetConfig::new(0.3, 1, 2), &domain, 3).unwrap();
        let labels = |net: &PincNet, derivatives: bool| {
            Labels::for_net(&plant, net, derivatives, (5, Purpose::Directions)).unwrap()
        };
        assert!(labels(&net, true).is_none(), "trained on the equation");
        net.source = TrainingTarget::Integrator;
        assert!(matches!(labels(&net, false).unwrap().source, Source::Values(_)));
        let Source::Slopes(_, mut directions) = labels(&net, true).unwrap().source else {
            panic!("derivatives are wanted");
        };
        let drawn: Vec<Vec<f64>> = (0..40).map(|_| directions.draw()).collect();
        let mut largest = [0.0_f64; 3];
        for of in &drawn {
            let scaled: Vec<f64> =
                of.iter().zip([0.5, 3.0, 2.0]).map(|(v, half)| v / half).collect();
            let length = scaled.iter().map(|v| v * v).sum::<f64>().sqrt();
            assert!((length - 1.0).abs() < 1e-12, "{of:?}");
            largest.iter_mut().zip(scaled).for_each(|(most, v)| *most = most.max(v.abs()));
        }
        assert!(largest.iter().all(|most| *most > 0.8), "all variables move: {largest:?}");
        assert!(drawn.windows(2).all(|pair| pair[0] != pair[1]));
    }
}
