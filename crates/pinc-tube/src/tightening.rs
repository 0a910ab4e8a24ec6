//! Bounds that a tube tightens.

use crate::{AlongPlan, BackOffs, Tube};

/// How far beyond a tightened bound a plan may be, relative to 1 + |bound|.
const ROUNDED: f64 = 1e-6;

/// Lower and upper bounds.
pub type Sides = [Vec<f64>; 2];

/// A tube with the bounds that it tightens.
#[derive(Debug)]
pub struct Tightening {
    tube: Box<dyn Tube>,
    back_offs: BackOffs,
    /// The bounds as they are without the tube: on the predicted states, `[N, n]`, and then the free
    /// inputs, `[Nu, m]`; and on outputs, of the last stages.
    pub given: [Sides; 2],
    /// At how many places nothing is left between a lower and an upper bound.
    crossed: usize,
}

/// What a tube did to the bounds of a step.
#[derive(Clone, Copy, Debug)]
pub struct Tightened<'a> {
    /// How far the bounds moved.
    pub back_offs: &'a BackOffs,
    /// Whether the plan is within the tightened bounds, which leave room everywhere. If not, the
    /// plant may break its bounds.
    pub fits: bool,
}

impl Tightening {
    /// The bounds `given` with a tube, for plans with so many predicted states and free inputs, all
    /// their numbers counted, and outputs.
    #[must_use]
    pub fn new(tube: Box<dyn Tube>, [x, u, y]: [usize; 3], given: [Sides; 2]) -> Self {
        let zeros = |size: usize| vec![0.0; size];
        let y = if given[1][0].is_empty() { 0 } else { y };
        let back_offs = BackOffs { states: zeros(x), inputs: zeros(u), outputs: zeros(y) };
        Self { tube, back_offs, given, crossed: 0 }
    }

    /// The tube.
    pub fn tube(&mut self) -> &mut dyn Tube {
        &mut *self.tube
    }

    /// See [`Tube::programs`].
    #[must_use]
    pub fn programs(&self) -> usize {
        self.tube.programs()
    }

    /// Writes the bounds tightened along a plan, in the order of those given. Where a lower bound
    /// would be above its upper one, both are the middle. If a back-off is no number, the bounds
    /// stay as they are.
    pub fn tighten(&mut self, along: AlongPlan<'_>, to: [[&mut [f64]; 2]; 2]) {
        self.tube.write(along, &mut self.back_offs);
        let BackOffs { states, inputs, outputs } = &self.back_offs;
        if !states.iter().chain(inputs).chain(outputs).all(|by| by.is_finite()) {
            return;
        }
        self.crossed = 0;
        let bounded = outputs.len() - self.given[1][0].len();
        let by = [states.iter().chain(inputs), outputs[bounded..].iter().chain(&[])];
        for (([lows, highs], [low, high]), by) in to.into_iter().zip(&self.given).zip(by) {
            let given = low.iter().zip(high);
            for ((to, (low, high)), by) in lows.iter_mut().zip(highs).zip(given).zip(by) {
                let excluded = low + by > high - by;
                self.crossed += usize::from(excluded);
                let middle = 0.5 * (low + high);
                let moved = (low + by, high - by);
                (*to.0, *to.1) = if excluded { (middle, middle) } else { moved };
            }
        }
    }

    /// What became of the bounds, which are `tightened`, for a plan with the outputs `y`.
    #[must_use]
    pub fn judge(&self, tightened: [[&[f64]; 2]; 2], plan: &[f64], y: &[f64]) -> Tightened<'_> {
        let bounded = &y[y.len() - tightened[1][0].len().min(y.len())..];
        let within = |[lows, highs]: [&[f64]; 2], values: &[f64]| {
            let slack = |bound: f64| ROUNDED * (1.0 + bound.abs());
            lows.iter().zip(highs).zip(values).all(|((low, high), value)| {
                *value >= low - slack(*low) && *value <= high + slack(*high)
            })
        };
        let [of_plan, of_outputs] = tightened;
        let fits = self.crossed == 0 && within(of_plan, plan) && within(of_outputs, bounded);
        Tightened { back_offs: &self.back_offs, fits }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_ode::{Dims, Stages};

    /// The bounds of one stage move by these numbers.
    #[derive(Debug)]
    struct By([f64; 3]);

    impl Tube for By {
        fn write(&mut self, _: AlongPlan<'_>, to: &mut BackOffs) {
            let [x, u, y] = self.0;
            (to.states[0], to.inputs[0], to.outputs[0]) = (x, u, y);
        }

        fn set_covariance(&mut self, _: &[f64]) {}
    }

    #[test]
    fn bounds_that_cross_become_their_middle_and_no_plan_fits() {
        let given = || [[vec![0.0, f64::NEG_INFINITY], vec![4.0, 1.0]], [vec![-1.0], vec![1.0]]];
        let along = AlongPlan::new(
            Stages { x: &[0.0], u: &[0.0], p: &[] },
            [&[1.0], &[1.0]],
            Dims::new(1, 1),
            0,
        );
        for (by, expected, fits) in [
            ([1.0, 5.0, 0.5], [1.0, f64::NEG_INFINITY, -0.5, 3.0, -4.0, 0.5], true),
            ([3.0, 5.0, 0.5], [2.0, f64::NEG_INFINITY, -0.5, 2.0, -4.0, 0.5], false),
            ([f64::NAN, 5.0, 0.5], [0.0; 6], true),
        ] {
            let mut tightening = Tightening::new(Box::new(By(by)), [1; 3], given());
            let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
            let ((low_z, low_y), (high_z, high_y)) = (low.split_at_mut(2), high.split_at_mut(2));
            tightening.tighten(along, [[low_z, high_z], [low_y, high_y]]);
            assert_eq!([low, high].concat(), expected);
            if by[0].is_nan() {
                continue;
            }
            let bounds = [[&low[..2], &high[..2]], [&low[2..], &high[2..]]];
            assert_eq!(tightening.judge(bounds, &[2.0, -9.0], &[0.2]).fits, fits);
            assert!(!tightening.judge(bounds, &[0.9, -9.0], &[0.2]).fits);
            assert!(!tightening.judge(bounds, &[2.0, -9.0], &[0.6]).fits);
        }
    }
}
