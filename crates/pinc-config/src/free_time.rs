//! A horizon whose length the controller chooses: `control.free_time`.

use crate::{ControlSpec, Experiment, Variables};
use pinc_mpc::{Bounds, PerStage, Weight};
use pinc_ode::DynPlant;

/// What is added to the weight of the factor's changes after its first: they are 0 by their bounds,
/// and this tells the optimization so where it makes the cost convex.
const STIFFNESS: f64 = 1e3;

/// The plants that a horizon needs beside the one that its models are of.
#[derive(Debug, Default)]
pub struct HorizonPlants {
    /// The plant with the cost of `[control.cost]` beside it, if there is one.
    pub costed: Option<Box<dyn DynPlant>>,
    /// The plant in stretched time, if the horizon has a free length.
    pub stretched: Option<Box<dyn DynPlant>>,
    /// The same with the cost.
    pub stretched_costed: Option<Box<dyn DynPlant>>,
}

impl ControlSpec {
    /// The place of the input that stretches the horizon's time, if there is one.
    #[must_use]
    pub fn stretch(&self, variables: &Variables) -> Option<usize> {
        let name = self.free_time.as_ref()?;
        variables.inputs.iter().position(|input| input.name == *name)
    }

    /// The stages of the horizon as [`ControlSpec::stages`] has them, with whether they are in
    /// stretched time: all but the first, if the length of the horizon is free.
    #[must_use]
    pub fn stretched_stages(&self, sample_time_s: f64) -> Vec<(f64, usize, bool)> {
        let stretches = self.free_time.is_some();
        let stages = self.stages(sample_time_s).into_iter();
        let mut stages: Vec<_> = stages.map(|(length, count)| (length, count, stretches)).collect();
        if stretches && let Some((length_s, count, _)) = stages.first_mut() {
            let first = (*length_s, 1, false);
            *count -= 1;
            stages.insert(0, first);
            stages.retain(|(_, count, _)| *count > 0);
        }
        stages
    }
}

impl Experiment {
    /// The plants that the horizon needs beside the plant itself, with the parameters `varying`.
    ///
    /// # Panics
    ///
    /// If the experiment was not read and checked, and an expression is wrong.
    #[must_use]
    pub fn horizon_plants(&self, varying: &[&str]) -> HorizonPlants {
        let Some(control) = &self.control else { return HorizonPlants::default() };
        let cost = control.cost.as_ref();
        let costed = cost.map(|cost| cost.beside(&self.plant, varying));
        let checked = "the expressions were compiled when the config was read";
        let mut plants =
            HorizonPlants { costed: costed.map(|of| of.expect(checked)), ..Default::default() };
        let stretch = control.stretch(&self.plant.variables());
        if let Some((input, equations)) = stretch.zip(self.plant.equations()) {
            let stretched = |cost| {
                let plant = equations.compile_stretched(varying, cost, input);
                plant.expect(checked).into_dyn()
            };
            plants.stretched = Some(stretched(None));
            plants.stretched_costed = cost.map(|cost| stretched(Some(cost.expressions())));
        }
        plants
    }
}

/// Bounds of increments that hold an input after the first of `free` inputs.
pub(crate) fn held(increments: Bounds, free: usize, input: usize) -> Bounds {
    let inputs = increments.low.len();
    let side = |side: &[f64]| {
        let mut all = side.repeat(free);
        all.iter_mut().skip(input).step_by(inputs).skip(1).for_each(|bound| *bound = 0.0);
        all
    };
    Bounds { low: side(&increments.low), high: side(&increments.high) }
}

/// R with a weight on the changes of such an input.
pub(crate) fn stiff(r: &PerStage<Weight>, free: usize, input: usize) -> PerStage<Weight> {
    let stages = (0..free).map(|stage| match r.at(stage) {
        Weight::Diagonal(diagonal) if stage > 0 => {
            let mut diagonal = diagonal.clone();
            diagonal[input] += STIFFNESS;
            Weight::Diagonal(diagonal)
        }
        Weight::Full(rows) if stage > 0 => {
            let mut rows = rows.clone();
            rows[input][input] += STIFFNESS;
            Weight::Full(rows)
        }
        first => first.clone(),
    });
    PerStage::Each { stages: stages.collect() }
}
