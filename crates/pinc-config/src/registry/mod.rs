//! From a `[plant]` section to a concrete plant.

#[cfg(test)]
mod tests;

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

    /// The parameters that may vary, with their nominal values; none if another program simulates the plant.
    #[must_use]
    pub fn parameters(&self) -> BTreeMap<String, f64> {
        self.equations().map_or_else(BTreeMap::new, |equations| equations.parameters().clone())
    }

    /// The names of these parameters.
    #[must_use]
    pub fn parameter_names(&self) -> Vec<String> {
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
