//! Parts of a step: states with what they depend on, judged apart from the others.

use crate::equation::Equation;
use crate::map::Map;
use crate::problem::StepError;
use pinc_expr::{Instruction, Listing};
use serde::{Deserialize, Serialize};

/// States that depend on the same variables, with the step of all that they depend on.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    pub(crate) error: StepError,
    pub(crate) places: Places,
}

/// Where a part belongs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Places {
    /// Its variables among all, its states first.
    variables: Vec<usize>,
    /// The states that are judged, among all.
    judged: Vec<usize>,
    /// How many of its variables are states.
    states: usize,
}

impl Places {
    /// Which of the part's states are judged.
    pub(crate) fn judged(&self) -> Vec<bool> {
        let states = &self.variables[..self.states];
        states.iter().map(|state| self.judged.contains(state)).collect()
    }

    /// The judged states: the place of each among all, and within the part.
    pub(crate) fn states(&self) -> impl Iterator<Item = (usize, usize)> {
        let states = self.variables[..self.states].iter().enumerate();
        states.filter(|(_, state)| self.judged.contains(state)).map(|(at, state)| (*state, at))
    }

    /// What `all` variables have, for the part's.
    pub(crate) fn pick<T: Copy>(&self, all: &[T]) -> Vec<T> {
        self.variables.iter().map(|place| all[*place]).collect()
    }

    /// What `all` states have, for the part's.
    pub(crate) fn pick_states(&self, all: &[f64]) -> Vec<f64> {
        self.variables[..self.states].iter().map(|place| all[*place]).collect()
    }

    /// Puts what the part's variables have to its places in `all`.
    pub(crate) fn put<T: Copy>(&self, own: &[T], all: &mut [T]) {
        for (place, value) in self.variables.iter().zip(own) {
            all[*place] = *value;
        }
    }
}

impl StepError {
    /// The step in parts. A box in fewer variables is cut less often, and the cuts of states that have
    /// nothing to do with each other are not multiplied.
    pub(crate) fn parts(&self) -> Vec<Part> {
        let mut parts: Vec<Part> = Vec::new();
        for state in 0..self.states() {
            let variables = self.needed_by(state);
            match parts.iter_mut().find(|part| part.places.variables == variables) {
                Some(part) => part.places.judged.push(state),
                None => parts.push(self.part(variables, state)),
            }
        }
        parts
    }

    /// The variables that a state depends on after the step, in both model and flow.
    fn needed_by(&self, state: usize) -> Vec<usize> {
        match &self.map {
            Map::Net(_) => (0..self.variables()).collect(),
            Map::RungeKutta { .. } => needed_by(self.flow.equation.listing(), state),
        }
    }

    /// The part with these variables, in which one state is judged.
    fn part(&self, variables: Vec<usize>, state: usize) -> Part {
        let mut error = self.clone();
        if let Map::RungeKutta { equation, .. } = &mut error.map {
            *equation = Equation::new(within(equation.listing(), &variables));
            error.flow.equation = equation.clone();
            error.variables = variables.len();
        }
        let states = error.states();
        Part { error, places: Places { variables, judged: vec![state], states } }
    }
}

/// The variables that a state depends on, by way of other states as well, in their order.
fn needed_by(listing: &Listing, state: usize) -> Vec<usize> {
    let mut variables = vec![state];
    loop {
        let needed = needed(listing, &variables);
        let instructions = listing.instructions.iter().zip(needed);
        let mut found: Vec<usize> = instructions
            .filter_map(|(instruction, needed)| match instruction {
                Instruction::Variable(index) if needed => Some(*index),
                _ => None,
            })
            .chain(variables.iter().copied())
            .collect();
        found.sort_unstable();
        found.dedup();
        if found == variables {
            return variables;
        }
        variables = found;
    }
}

/// Which instructions the derivatives of the states among `variables` need.
fn needed(listing: &Listing, variables: &[usize]) -> Vec<bool> {
    let mut needed = vec![false; listing.instructions.len()];
    for result in variables.iter().filter_map(|variable| listing.results.get(*variable)) {
        needed[*result] = true;
    }
    for i in (0..needed.len()).rev() {
        if needed[i] {
            listing.instructions[i].operands().for_each(|operand| needed[operand] = true);
        }
    }
    needed
}

/// The derivatives of the states among `variables` in these variables alone; what they do not need
/// becomes a number.
fn within(listing: &Listing, variables: &[usize]) -> Listing {
    let place = |index: usize| variables.iter().position(|variable| *variable == index);
    let instructions = listing.instructions.iter().zip(needed(listing, variables));
    let instructions = instructions.map(|(instruction, needed)| match *instruction {
        Instruction::Variable(index) if needed => {
            Instruction::Variable(place(index).expect("all that is needed is among the variables"))
        }
        instruction if needed => instruction,
        _ => Instruction::Constant(0.0),
    });
    let results = variables.iter().filter_map(|variable| listing.results.get(*variable));
    Listing { instructions: instructions.collect(), results: results.copied().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::StepModel;
    use pinc_expr::PlantEquations;
    use pinc_ode::Tableau;
    use pinc_plants::{FourTanks, VanDerPol};

    /// The upper tanks have a pump each; a lower one has its pump and the tank above it.
    #[test]
    fn tanks_have_parts_and_an_oscillator_has_none() {
        let model = StepModel::RungeKutta(Tableau::CLASSICAL, 1);
        let tanks = PlantEquations::traced(FourTanks::antonelo());
        let whole = StepError::new(&tanks, &[], 2, model, 10.0).unwrap();
        let parts = whole.parts();
        let found: Vec<(&[usize], &[usize])> = parts
            .iter()
            .map(|part| (&part.places.variables[..], &part.places.judged[..]))
            .collect();
        let expected: [(&[usize], &[usize]); 4] =
            [(&[0, 2, 4, 5], &[0]), (&[1, 3, 4, 5], &[1]), (&[2, 5], &[2]), (&[3, 4], &[3])];
        assert_eq!(found, expected);
        // Each part has the step of the whole.
        let point = [7.0, 9.0, 3.0, 2.0, 1.5, 2.5];
        let all = whole.rough(&point);
        for part in &parts {
            let own = part.error.rough(&part.places.pick(&point));
            for (state, at) in part.places.states() {
                assert!((own[at] - all[state]).abs() <= 1e-14, "{own:?} {all:?}");
            }
        }
        let oscillator = PlantEquations::traced(VanDerPol::default());
        let whole = StepError::new(&oscillator, &[], 1, model, 0.5).unwrap();
        assert_eq!(whole.parts().len(), 1);
        assert_eq!(whole.parts()[0].places.judged(), [true, true]);
    }
}
