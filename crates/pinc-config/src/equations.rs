//! Plants as text, where programs are to be written from their equations.

use crate::PlantSpec;
use crate::registry::four_tanks;
use pinc_expr::Equations;
use pinc_plants::{FourTanks, OneTank, VanDerPol};
use std::collections::BTreeMap;

/// Twice the acceleration of gravity, in cm/s^2.
const TWICE_GRAVITY: f64 = 2.0 * 981.0;

impl PlantSpec {
    /// The plant's equations as text: those of the config, or those of a built-in plant that is
    /// written in a few lines. `None` for plants that are Rust code.
    ///
    /// # Panics
    ///
    /// As for [`PlantSpec::dyn_plant`].
    #[must_use]
    pub fn equations(&self) -> Option<Equations> {
        let (parameters, intermediates, derivatives) = match self {
            Self::Expression(equations) => return Some(equations.clone()),
            Self::VanDerPol(spec) => van_der_pol(VanDerPol { mu: spec.mu }),
            Self::FourTanks(spec) => tanks(&four_tanks(spec)),
            Self::OneTank(_) => one_tank(&OneTank::default()),
            _ => return None,
        };
        let plant = self.dyn_plant();
        Some(Equations {
            states: plant.states().to_vec(),
            inputs: plant.inputs().to_vec(),
            parameters: parameters.into_iter().map(|(name, v)| (name.to_owned(), v)).collect(),
            intermediates: texts(intermediates),
            derivatives: texts(derivatives),
            ..Equations::default()
        })
    }
}

/// Parameters, intermediate expressions and derivatives.
type Parts = (
    Vec<(&'static str, f64)>,
    Vec<(&'static str, &'static str)>,
    Vec<(&'static str, &'static str)>,
);

fn texts(pairs: Vec<(&str, &str)>) -> BTreeMap<String, String> {
    pairs.into_iter().map(|(name, text)| (name.to_owned(), text.to_owned())).collect()
}

fn van_der_pol(plant: VanDerPol) -> Parts {
    let derivatives = vec![("x1", "x2"), ("x2", "(1 - x1*x1)*x2*mu - x1 + u")];
    (vec![("mu", plant.mu)], Vec::new(), derivatives)
}

fn tanks(plant: &FourTanks) -> Parts {
    let FourTanks { area, outlet, gamma, pump } = plant;
    let names =
        [["area1", "area2", "area3", "area4"], ["outlet1", "outlet2", "outlet3", "outlet4"]];
    let mut parameters = vec![
        ("twice_g", TWICE_GRAVITY),
        ("gamma1", gamma[0]),
        ("gamma2", gamma[1]),
        ("pump1", pump[0]),
        ("pump2", pump[1]),
    ];
    for (names, values) in names.into_iter().zip([area, outlet]) {
        parameters.extend(names.into_iter().zip(values.iter().copied()));
    }
    let intermediates = vec![
        ("w1", "outlet1*sqrt(twice_g*max(h1, 0))"),
        ("w2", "outlet2*sqrt(twice_g*max(h2, 0))"),
        ("w3", "outlet3*sqrt(twice_g*max(h3, 0))"),
        ("w4", "outlet4*sqrt(twice_g*max(h4, 0))"),
    ];
    let derivatives = vec![
        ("h1", "(gamma1*pump1*u1 + w3 - w1)/area1"),
        ("h2", "(gamma2*pump2*u2 + w4 - w2)/area2"),
        ("h3", "((1 - gamma2)*pump2*u2 - w3)/area3"),
        ("h4", "((1 - gamma1)*pump1*u1 - w4)/area4"),
    ];
    (parameters, intermediates, derivatives)
}

fn one_tank(plant: &OneTank) -> Parts {
    let OneTank { area, outlet, pump } = *plant;
    let parameters =
        vec![("area", area), ("outlet", outlet), ("pump", pump), ("twice_g", TWICE_GRAVITY)];
    let derivatives = vec![("h", "(pump*u - outlet*sqrt(twice_g*max(h, 0)))/area")];
    (parameters, Vec::new(), derivatives)
}

#[cfg(test)]
mod tests {
    use crate::{FourTanksParameters, FourTanksSpec, OneTankSpec, PlantSpec, VanDerPolSpec};
    use pinc_ode::DynPlant;

    fn rhs(plant: &dyn DynPlant, x: &[f64], u: &[f64]) -> Vec<f64> {
        let mut dx = vec![f64::NAN; x.len()];
        plant.rhs(x, u, &[], &mut dx);
        dx
    }

    /// The text is the plant, at points where tanks are full, empty and below empty.
    #[test]
    fn the_text_of_a_built_in_plant_is_the_plant() {
        let tanks = FourTanksSpec {
            parameters: FourTanksParameters::JohanssonMinimum,
            gamma: None,
            pump: Some([3.0, 4.0]),
        };
        for spec in [
            PlantSpec::VanDerPol(VanDerPolSpec { mu: 1.7 }),
            PlantSpec::FourTanks(tanks),
            PlantSpec::OneTank(OneTankSpec {}),
        ] {
            let plant = spec.dyn_plant();
            let text = spec.equations().unwrap();
            assert_eq!(text.states, plant.states());
            let text = text.compile().unwrap().into_dyn();
            for point in [[1.3, 0.2, 4.0, 7.0], [0.0, -1.0, 15.0, 2.0], [-0.5, 9.0, 0.0, 0.1]] {
                let (x, u) = (&point[..plant.dims().nx], &[1.5, 0.7][..plant.dims().nu]);
                for (a, b) in rhs(&*plant, x, u).iter().zip(rhs(&*text, x, u)) {
                    assert!((a - b).abs() <= 1e-14 * (1.0 + a.abs()), "{a} {b}");
                }
            }
        }
    }
}
