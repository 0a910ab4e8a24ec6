//! From a `[plant]` section to a concrete plant.

use crate::PlantSpec;
use crate::black_box::{FmuSpec, ProcessSpec};
use crate::plants::Plants;
use pinc_ode::{Dims, DynPlant, DynRhs, Variable};
use std::collections::BTreeMap;

impl PlantSpec {
    /// Looks a plant of the program's own up among `plants`.
    pub(crate) fn bind(&mut self, plants: &Plants) {
        match self {
            Self::Own(spec) => spec.bind(plants),
            Self::Expression(equations) => equations.add_net_weights(),
            Self::Process(spec) if plants.processes_are_allowed() => spec.bind(),
            Self::Fmu(spec) if plants.processes_are_allowed() => spec.bind(),
            _ => {}
        }
    }

    /// The plant described.
    ///
    /// # Panics
    ///
    /// If the description does not come from an [`Experiment`](crate::Experiment) that was read and
    /// checked, and is unusable.
    #[must_use]
    pub fn dyn_plant(&self) -> Box<dyn DynPlant> {
        match self {
            Self::Process(_) | Self::Fmu(_) => Box::new(
                self.black_box().expect("it was allowed and opened when the config was read"),
            ),
            _ => {
                let plant = self.equations().map(|equations| equations.to_dyn());
                let plant = plant.expect("it was looked up when the config was read");
                plant.expect("the equations were compiled when the config was read")
            }
        }
    }

    /// The parameters that may vary, with their nominal values; none for a plant that another
    /// program simulates.
    #[must_use]
    pub fn parameters(&self) -> BTreeMap<String, f64> {
        self.equations().map_or_else(BTreeMap::new, |equations| equations.parameters().clone())
    }

    /// The names of these parameters.
    pub(crate) fn parameter_names(&self) -> Vec<String> {
        self.parameters().into_keys().collect()
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
        let equations = self.equations().expect("only plants with equations have parameters");
        let plant = equations.compile_with(varying);
        plant.expect("the parameters were checked when the config was read").into_dyn()
    }

    /// The plant's states, inputs and outputs.
    ///
    /// # Panics
    ///
    /// As for [`PlantSpec::dyn_plant`].
    #[must_use]
    pub fn variables(&self) -> Variables {
        if let Self::Expression(equations) = self
            && let Ok([states, inputs, outputs]) = equations.variables()
        {
            let outputs = if outputs.is_empty() { states.clone() } else { outputs };
            return Variables { states, inputs, outputs };
        }
        let declared = match self {
            Self::Process(ProcessSpec { states, inputs, .. }) => Some([states, inputs, states]),
            Self::Fmu(FmuSpec { states, inputs, outputs, .. }) => {
                Some([states, inputs, if outputs.is_empty() { states } else { outputs }])
            }
            _ => None,
        };
        if let Some([states, inputs, outputs]) = declared.map(|of| of.map(Vec::clone)) {
            return Variables { states, inputs, outputs };
        }
        Variables::of(&*self.dyn_plant())
    }
}

/// The states, inputs and outputs of a plant, in its order.
#[derive(Clone, Debug, PartialEq)]
pub struct Variables {
    /// The states.
    pub states: Vec<Variable>,
    /// The inputs.
    pub inputs: Vec<Variable>,
    /// The outputs; of a plant without any of its own, the states.
    pub outputs: Vec<Variable>,
}

/// The names of variables.
pub(crate) fn names(variables: &[Variable]) -> Vec<String> {
    variables.iter().map(|variable| variable.name.to_string()).collect()
}

impl Variables {
    /// Returns the variables of a plant.
    #[must_use]
    pub fn of(plant: &dyn DynRhs) -> Self {
        Self {
            states: plant.states().to_vec(),
            inputs: plant.inputs().to_vec(),
            outputs: plant.outputs().to_vec(),
        }
    }

    /// The names of the states.
    #[must_use]
    pub fn state_names(&self) -> Vec<String> {
        names(&self.states)
    }

    /// The outputs that are no states, by their names, each with its place among all outputs.
    #[must_use]
    pub fn own_outputs(&self) -> Vec<(usize, &Variable)> {
        let is_state = |output: &Variable| self.states.iter().any(|s| s.name == output.name);
        self.outputs.iter().enumerate().filter(|(_, output)| !is_state(output)).collect()
    }

    /// Their names.
    #[must_use]
    pub fn own_output_names(&self) -> Vec<String> {
        self.own_outputs().iter().map(|(_, v)| v.name.to_string()).collect()
    }

    /// The names of all outputs.
    #[must_use]
    pub fn output_names(&self) -> Vec<String> {
        names(&self.outputs)
    }

    /// The numbers of states, inputs and outputs.
    #[must_use]
    pub fn dims(&self) -> Dims {
        Dims::new(self.states.len(), self.inputs.len()).with_outputs(self.outputs.len())
    }

    /// The names of the inputs.
    #[must_use]
    pub fn input_names(&self) -> Vec<String> {
        names(&self.inputs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BuiltInSpec, FourTanksParameters, FourTanksSpec, VanDerPolSpec};

    /// A member of a family has the numbers of the plant with its parameters.
    #[test]
    fn members_of_families_have_the_numbers_of_the_plants() {
        let tanks = |pump, gamma| {
            let parameters = FourTanksParameters::JohanssonMinimum;
            let (gamma, pump) = (Some(gamma), Some(pump));
            let constants = BTreeMap::new();
            PlantSpec::FourTanks(FourTanksSpec { parameters, gamma, pump, constants })
        };
        let van_der_pol = |mu| PlantSpec::VanDerPol(VanDerPolSpec { mu });
        let other = |values: &[(&str, f64)]| {
            let constants = values.iter().map(|(name, value)| ((*name).to_owned(), *value));
            BuiltInSpec { constants: constants.collect() }
        };
        for (spec, other, varying) in [
            (van_der_pol(1.0), van_der_pol(0.6), &["mu"][..]),
            (
                tanks([3.33, 3.35], [0.7, 0.6]),
                tanks([3.0, 3.6], [0.5, 0.4]),
                &["k2", "gamma1", "k1", "gamma2"],
            ),
            (
                PlantSpec::OneTank(other(&[])),
                PlantSpec::OneTank(other(&[("k", 3.0), ("a", 0.08)])),
                &["k", "a"],
            ),
            (
                PlantSpec::HydraulicServo(other(&[("lag", 3e-3)])),
                PlantSpec::HydraulicServo(other(&[("lag", 3e-3), ("mass", 900.0), ("turn", 0.03)])),
                &["turn", "mass"],
            ),
            (
                PlantSpec::TwoLinkArm(other(&[])),
                PlantSpec::TwoLinkArm(other(&[("m2", 1.3), ("l1", 0.6)])),
                &["m2", "l1"],
            ),
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
                    let rounding = 1e-13 * (1.0 + expected.abs()).max(level.powi(3).abs());
                    assert!((found - expected).abs() <= rounding, "{found} {expected}");
                }
            }
        }
    }
}
