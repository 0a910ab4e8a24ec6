//! Requests for an FMU's directional derivatives.

use super::description::{Description, Place};
use super::library::Instance;
use super::simulation::slot;

/// The derivatives of f(x, u) in model exchange, along directions of states and inputs.
#[derive(Clone, Debug)]
pub(super) struct Derivatives {
    /// The variables that f is.
    rates: Vec<u32>,
    /// The variables that change, as many numbers as they are together, and where among these are
    /// the plant's states and inputs.
    changing: Vec<u32>,
    numbers: usize,
    states: Vec<usize>,
    inputs: Vec<usize>,
    /// Whether they are asked for in the initialization: those in a parameter are not to be had
    /// later.
    pub(super) at_start: bool,
}

/// The variables that a step begins with, how many numbers they are, and where among these are the
/// plant's states and inputs.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    pub(super) references: &'a [u32],
    pub(super) numbers: usize,
    pub(super) states: &'a [usize],
    pub(super) inputs: &'a [usize],
}

/// Room for what goes to the FMU and comes from it.
#[derive(Debug, Default)]
pub(super) struct Room {
    seed: Vec<f64>,
    slope: Vec<f64>,
}

impl Derivatives {
    /// Returns the derivatives of an FMU whose plant has these states, in the places `order` of the
    /// FMU's vector, and these inputs.
    pub(super) fn new(
        description: &Description,
        order: &[usize],
        inputs: &[Place],
        start: Start<'_>,
    ) -> Self {
        let rates = description.derivatives.clone();
        if !inputs.iter().all(|place| description.is_input(place.reference)) {
            return Self {
                rates,
                changing: start.references.to_vec(),
                numbers: start.numbers,
                states: start.states.to_vec(),
                inputs: start.inputs.to_vec(),
                at_start: true,
            };
        }
        let mut changing: Vec<u32> = description.states.iter().map(|s| s.reference).collect();
        changing.dedup();
        let mut values = vec![0.0; description.states.len()];
        let add = |place: &Place| slot(description, *place, &mut changing, &mut values);
        let inputs = inputs.iter().map(add).collect();
        let (numbers, states) = (values.len(), order.to_vec());
        Self { rates, changing, numbers, states, inputs, at_start: false }
    }

    /// Writes the derivative along `column`, a direction of the states, and along `input` if it
    /// belongs to one; `column` and `slope` are both in the order of the plant, which is `order` in
    /// the FMU.
    pub(super) fn along(
        &self,
        instance: &mut Instance,
        order: &[usize],
        (column, input): (&[f64], Option<usize>),
        slope: &mut [f64],
        Room { seed, slope: of_fmu }: &mut Room,
    ) -> Result<(), String> {
        of_fmu.resize(slope.len(), 0.0);
        seed.clear();
        seed.resize(self.numbers, 0.0);
        for (place, change) in self.states.iter().zip(column) {
            seed[*place] = *change;
        }
        if let Some(input) = input {
            seed[self.inputs[input]] = 1.0;
        }
        instance.directional_derivative(&self.rates, &self.changing, seed, of_fmu)?;
        slope.iter_mut().zip(order).for_each(|(slope, place)| *slope = of_fmu[*place]);
        Ok(())
    }
}
