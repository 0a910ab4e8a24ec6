//! Families of plants: a plant whose parameters vary.

use crate::PlantSpec;
use crate::registry::four_tanks;
use pinc_expr::Equations;
use pinc_ode::{DynPlant, Variable};
use std::collections::BTreeMap;

impl PlantSpec {
    /// The plant's equations as text, if they can be written so. Those of a built-in plant give its
    /// numbers up to rounding.
    #[must_use]
    pub fn equations(&self) -> Option<Equations> {
        match self {
            Self::Expression(equations) => Some(equations.clone()),
            Self::VanDerPol(spec) => Some(van_der_pol(spec.mu)),
            Self::FourTanks(spec) => Some(tanks(&four_tanks(spec))),
            Self::OneTank(_) => Some(one_tank()),
            _ => None,
        }
    }

    /// The parameters that may vary, with their nominal values; none for a plant that cannot be
    /// written as text.
    #[must_use]
    pub fn parameters(&self) -> BTreeMap<String, f64> {
        self.equations().map_or_else(BTreeMap::new, |equations| equations.parameters)
    }

    /// The plant in which the parameters `varying`, in this order, are the p of f(x, u, p);
    /// without any the same as [`PlantSpec::dyn_plant`].
    ///
    /// # Panics
    ///
    /// As [`PlantSpec::dyn_plant`], or if one is not among [`PlantSpec::parameters`].
    #[must_use]
    pub fn family(&self, varying: &[&str]) -> Box<dyn DynPlant> {
        if varying.is_empty() {
            return self.dyn_plant();
        }
        let equations = self.equations().expect("only plants as text have parameters that vary");
        let plant = equations.compile_with(varying);
        plant.expect("the parameters were checked when the config was read").into_dyn()
    }
}

fn van_der_pol(mu: f64) -> Equations {
    Equations {
        states: vec![Variable::new("x1", ""), Variable::new("x2", "")],
        inputs: vec![Variable::new("u", "")],
        parameters: [("mu".to_owned(), mu)].into(),
        derivatives: texts(&[("x1", "x2"), ("x2", "(1 - x1*x1)*x2*mu - x1 + u")]),
        ..Equations::default()
    }
}

fn tanks(plant: &pinc_plants::FourTanks) -> Equations {
    let numbers = [
        ("A", &plant.area[..]),
        ("a", &plant.outlet[..]),
        ("gamma", &plant.gamma[..]),
        ("k", &plant.pump[..]),
    ];
    let parameters = numbers.iter().flat_map(|(name, values)| {
        values.iter().enumerate().map(move |(i, &value)| (format!("{name}{}", i + 1), value))
    });
    let outflow = |i: usize| (format!("w{i}"), format!("sqrt(max(h{i}, 0)*{TWICE_GRAVITY})*a{i}"));
    Equations {
        states: ["h1", "h2", "h3", "h4"].map(|name| Variable::new(name, "cm")).into(),
        inputs: ["u1", "u2"].map(|name| Variable::new(name, "V")).into(),
        parameters: parameters.collect(),
        intermediates: (1..=4).map(outflow).collect(),
        derivatives: texts(&[
            ("h1", "(u1*k1*gamma1 + w3 - w1)/A1"),
            ("h2", "(u2*k2*gamma2 + w4 - w2)/A2"),
            ("h3", "(u2*k2*(1 - gamma2) - w3)/A3"),
            ("h4", "(u1*k1*(1 - gamma1) - w4)/A4"),
        ]),
        ..Equations::default()
    }
}

fn one_tank() -> Equations {
    let plant = pinc_plants::OneTank::default();
    let numbers = [("A", plant.area), ("a", plant.outlet), ("k", plant.pump)];
    let derivative = format!("(u*k - sqrt(max(h, 0)*{TWICE_GRAVITY})*a)/A");
    Equations {
        states: vec![Variable::new("h", "cm")],
        inputs: vec![Variable::new("u", "V")],
        parameters: numbers.map(|(name, value)| (name.to_owned(), value)).into(),
        derivatives: texts(&[("h", &derivative)]),
        ..Equations::default()
    }
}

/// 2 g, in cm/s^2.
const TWICE_GRAVITY: &str = "1962";

fn texts(pairs: &[(&str, &str)]) -> BTreeMap<String, String> {
    pairs.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FourTanksParameters, FourTanksSpec, OneTankSpec, VanDerPolSpec};

    /// The text of each built-in plant gives its numbers, at nominal parameters and at others.
    #[test]
    fn built_in_plants_as_text_have_their_numbers() {
        let tanks = |pump, gamma| {
            let parameters = FourTanksParameters::JohanssonMinimum;
            PlantSpec::FourTanks(FourTanksSpec { parameters, gamma: Some(gamma), pump: Some(pump) })
        };
        let van_der_pol = |mu| PlantSpec::VanDerPol(VanDerPolSpec { mu });
        let one_tank = PlantSpec::OneTank(OneTankSpec {});
        for (spec, other, varying) in [
            (van_der_pol(1.0), van_der_pol(0.6), &["mu"][..]),
            (
                tanks([3.33, 3.35], [0.7, 0.6]),
                tanks([3.0, 3.6], [0.5, 0.4]),
                &["k2", "gamma1", "k1", "gamma2"],
            ),
            (one_tank.clone(), one_tank, &["k", "a"]),
        ] {
            let family = spec.family(varying);
            let p: Vec<f64> = varying.iter().map(|name| other.parameters()[*name]).collect();
            let plant = other.dyn_plant();
            assert_eq!(family.states(), plant.states());
            assert_eq!(family.inputs(), plant.inputs());
            let (nx, nu) = (plant.dims().nx, plant.dims().nu);
            for level in [-0.5, 0.0, 1.0, 13.0] {
                let (x, u) = (vec![level; nx], vec![0.3 * level; nu]);
                let (mut found, mut expected) = (vec![0.0; nx], vec![0.0; nx]);
                family.rhs(&x, &u, &p, &mut found);
                plant.rhs(&x, &u, &[], &mut expected);
                for (found, expected) in found.iter().zip(&expected) {
                    let rounding = 1e-14 * (1.0 + expected.abs()).max(level.powi(3).abs());
                    assert!((found - expected).abs() <= rounding, "{found} {expected}");
                }
            }
        }
    }
}
