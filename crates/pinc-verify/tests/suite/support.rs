//! Equations as text, fresh nets, and the error that an accurate integration finds.

use pinc_expr::{Equations, PlantEquations};
use pinc_net::{Domain, NetConfig, PincModel, PincNet};
use pinc_ode::{Dopri5, DynRhs, Model, Rk4};
use pinc_plants::VanDerPol;

/// The states x, y, .. with these derivatives, and the input u.
pub(crate) fn equations(states: &[(&str, &str)]) -> PlantEquations {
    let names: Vec<String> =
        states.iter().map(|(name, _)| format!(r#"{{"name": "{name}"}}"#)).collect();
    let rates: Vec<String> =
        states.iter().map(|(name, rate)| format!(r#""{name}": "{rate}""#)).collect();
    let text = format!(
        r#"{{"states": [{}], "inputs": [{{"name": "u"}}], "derivatives": {{{}}}}}"#,
        names.join(","),
        rates.join(",")
    );
    let equations: Equations = serde_json::from_str(&text).unwrap();
    equations.into()
}

/// A net that was not trained: as far from the oscillator as any.
pub(crate) fn fresh_net(domain: &Domain) -> PincNet {
    PincNet::new(&VanDerPol::default(), &NetConfig::new(0.3, 2, 6), domain, 3).unwrap()
}

pub(crate) fn ends(domain: &Domain) -> Vec<[f64; 2]> {
    domain.ends().map(|(low, high)| [low, high]).collect()
}

/// The error of a step of `model` from (x, u), to about 1e-12.
pub(crate) fn truth(plant: &dyn DynRhs, model: &mut dyn Model, point: &[f64]) -> Vec<f64> {
    let (x, u) = point.split_at(plant.dims().nx);
    let (mut next, mut exact) = (x.to_vec(), x.to_vec());
    model.step(x, u, &[], &mut next);
    let mut integrator = Dopri5::shared(plant.to_shared(), 1e-13);
    integrator.integrate(&mut exact, u, model.sample_time_s()).unwrap();
    next.iter().zip(exact).map(|(y, z)| y - z).collect()
}

pub(crate) fn net_model(net: &PincNet) -> PincModel {
    PincModel::new(net).unwrap()
}

pub(crate) fn rk4(substeps: usize) -> Rk4<VanDerPol> {
    Rk4::new(VanDerPol::default(), 0.3, substeps)
}

/// Points that fill a box, by a lattice.
pub(crate) fn lattice(ends: &[[f64; 2]], count: u32) -> Vec<Vec<f64>> {
    let share = |k: u32, i: usize| {
        let step = [0.618_033_988, 0.754_877_666, 0.569_840_29, 0.819_172_51][i % 4];
        (f64::from(k) * step).fract()
    };
    let point = |k: u32| {
        let of = |(i, [low, high]): (usize, &[f64; 2])| low + share(k, i) * (high - low);
        ends.iter().enumerate().map(of).collect()
    };
    (1..=count).map(point).collect()
}
