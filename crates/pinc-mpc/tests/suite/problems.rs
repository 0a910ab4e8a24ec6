//! The paper's control problems and closed loops.

use pinc_mpc::{Bounds, NmpcProblem, Reference, Tracked, Weights};
use pinc_ode::{Dims, Model, Rk4};
use pinc_plants::{FourTanks, VanDerPol};

/// A closed loop: the problem, what is followed, and the plant with its state at the start.
pub(crate) struct Loop {
    pub(crate) problem: NmpcProblem,
    pub(crate) reference: Reference,
    pub(crate) start: Vec<f64>,
    /// RK4 with so many substeps that its error does not matter.
    pub(crate) plant: Box<dyn Model>,
}

impl Loop {
    /// A loop whose reference has these values, each for so many steps.
    pub(crate) fn new(
        problem: NmpcProblem,
        plant: impl Model + 'static,
        start: &[f64],
        (values, each): (&[&[f64]], usize),
    ) -> Self {
        let outputs = problem.tracked.len();
        let values = values.iter().flat_map(|value| value.repeat(each)).collect();
        let reference = Reference::new(values, outputs).unwrap();
        Self { problem, reference, start: start.to_vec(), plant: Box::new(plant) }
    }

    /// Calls `step` with k, x and the preview of the references at every step; it gives the input.
    pub(crate) fn run(&mut self, mut step: impl FnMut(usize, &[f64], &[f64]) -> Vec<f64>) {
        let mut x = self.start.clone();
        let mut next = x.clone();
        let mut window = vec![0.0; self.problem.horizon * self.reference.outputs()];
        for k in 0..self.reference.steps() {
            self.reference.preview(k, &mut window);
            let u = step(k, &x, &window);
            self.plant.step(&x, &u, &[], &mut next);
            x.copy_from_slice(&next);
        }
    }
}

/// The paper's loop of the oscillator, 120 steps. At the end the reference is on both bounds: rows
/// are active without force there.
pub(crate) fn van_der_pol_loop() -> Loop {
    let values: [&[f64]; 4] = [&[0.0, 0.0], &[-0.5, 0.0], &[0.8, 0.0], &[1.0, 0.0]];
    let plant = Rk4::new(VanDerPol::default(), 0.5, 40);
    Loop::new(van_der_pol(), plant, &[1.0, 0.0], (&values, 30))
}

/// The loop of the tanks, 240 steps.
pub(crate) fn four_tanks_loop() -> Loop {
    let middle = [9.159_582_958_982_018, 14.211_590_549_777_885];
    let upper = [10.151_255_120_853_042, 15.750_223_780_923_415];
    let lower = [8.226_164_209_850_278, 12.763_340_653_079_485];
    let plant = Rk4::new(FourTanks::antonelo(), 10.0, 40);
    let start = [2.0, 2.0, 0.6, 0.6];
    Loop::new(four_tanks(), plant, &start, (&[&middle, &upper, &lower, &middle], 60))
}

/// The paper's problem for the Van der Pol oscillator.
pub(crate) fn van_der_pol() -> NmpcProblem {
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0]);
    NmpcProblem {
        state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        ..NmpcProblem::new(Dims::new(2, 1), 5, weights)
    }
}

/// The paper's problem for the four tanks.
pub(crate) fn four_tanks() -> NmpcProblem {
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0; 2]);
    NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        input_bounds: Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        ..NmpcProblem::new(Dims::new(4, 2), 5, weights)
    }
}
