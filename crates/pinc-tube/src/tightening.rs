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
    /// inputs, `[Nu, m]`; and on outputs, of the last stages, at the ends of their intervals and at the
    /// starts.
    pub given: [Sides; 3],
    /// At how many places nothing is left between a lower and an upper bound, or a bound would move
    /// without limit.
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
    pub fn new(tube: Box<dyn Tube>, [x, u, y]: [usize; 3], given: [Sides; 3]) -> Self {
        let zeros = |size: usize| vec![0.0; size];
        let of_outputs = |given: &Sides| zeros(if given[0].is_empty() { 0 } else { y });
        let [_, ends, starts] = &given;
        let (outputs, starts) = (of_outputs(ends), of_outputs(starts));
        let back_offs = BackOffs { states: zeros(x), inputs: zeros(u), outputs, starts };
        Self { tube, back_offs, given, crossed: 0 }
    }

    /// The tube.
    pub fn tube(&mut self) -> &mut dyn Tube {
        &mut *self.tube
    }

    /// See [`Tube::programs`].
    #[must_use]
    pub fn programs(&self, is_first: bool) -> usize {
        self.tube.programs(is_first)
    }

    /// Writes the bounds as they are without the tube, in the order of those given.
    pub fn release(&self, to: [[&mut [f64]; 2]; 3]) {
        for (to, given) in to.into_iter().zip(&self.given) {
            let sides = to.into_iter().zip(given);
            sides
                .flat_map(|(to, given)| to.iter_mut().zip(given))
                .for_each(|(to, given)| *to = *given);
        }
    }

    /// Writes the bounds tightened along a plan, in the order of those given. Where a lower bound
    /// would be above its upper one, both are the middle. A bound stays where it is if its back-off is
    /// no number or infinite.
    pub fn tighten(&mut self, along: AlongPlan<'_>, to: [[&mut [f64]; 2]; 3]) {
        self.tube.write(along, &mut self.back_offs);
        let BackOffs { states, inputs, outputs, starts } = &self.back_offs;
        self.crossed = 0;
        let last = |back_offs: &'_ [f64], given: &Sides| back_offs.len() - given[0].len();
        let [_, ends, at_starts] = &self.given;
        let by = [
            states.iter().chain(inputs),
            outputs[last(outputs, ends)..].iter().chain(&[]),
            starts[last(starts, at_starts)..].iter().chain(&[]),
        ];
        for (([lows, highs], [low, high]), by) in to.into_iter().zip(&self.given).zip(by) {
            let given = low.iter().zip(high);
            for ((to, (low, high)), by) in lows.iter_mut().zip(highs).zip(given).zip(by) {
                let is_bounded = low.is_finite() || high.is_finite();
                (*to.0, *to.1) = match by.is_finite() {
                    _ if !is_bounded => (*low, *high),
                    true if low + by <= high - by => (low + by, high - by),
                    known => {
                        self.crossed += 1;
                        let middle = 0.5 * (low + high);
                        if known { (middle, middle) } else { (*low, *high) }
                    }
                };
            }
        }
    }

    /// What became of the bounds, which are `tightened`, for a plan with these outputs at the ends of
    /// the intervals and at their starts.
    #[must_use]
    pub fn judge(
        &self,
        tightened: [[&[f64]; 2]; 3],
        plan: &[f64],
        outputs: [&[f64]; 2],
    ) -> Tightened<'_> {
        let within = |[lows, highs]: [&[f64]; 2], values: &[f64]| {
            let slack = |bound: f64| ROUNDED * (1.0 + bound.abs());
            lows.iter().zip(highs).zip(values).all(|((low, high), value)| {
                *value >= low - slack(*low) && *value <= high + slack(*high)
            })
        };
        let [of_plan, ends, starts] = tightened;
        let mut of_outputs = [ends, starts].into_iter().zip(outputs);
        let fits = self.crossed == 0
            && within(of_plan, plan)
            && of_outputs
                .all(|(bounds, y)| within(bounds, &y[y.len() - bounds[0].len().min(y.len())..]));
        Tightened { back_offs: &self.back_offs, fits }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_ode::{Dims, Stages};

    /// The bounds of one stage move by these numbers.
    #[derive(Debug)]
    struct By([f64; 4]);

    impl Tube for By {
        fn write(&mut self, _: AlongPlan<'_>, to: &mut BackOffs) {
            [to.states[0], to.inputs[0], to.outputs[0], to.starts[0]] = self.0;
        }

        fn set_covariance(&mut self, _: &[f64]) {}
    }

    #[test]
    fn bounds_that_cross_become_their_middle_and_no_plan_fits() {
        const FREE: f64 = f64::NEG_INFINITY;
        let outputs = || [vec![-1.0], vec![1.0]];
        let given = || [[vec![0.0, FREE], vec![4.0, 1.0]], outputs(), outputs()];
        let along = AlongPlan::new(
            Stages { x: &[0.0], u: &[0.0], p: &[] },
            [&[1.0], &[1.0]],
            Dims::new(1, 1),
            0,
        );
        for (by, expected, fits) in [
            ([1.0, 5.0, 0.5, 0.25], [1.0, FREE, -0.5, -0.75, 3.0, -4.0, 0.5, 0.75], true),
            ([3.0, 5.0, 0.5, 0.25], [2.0, FREE, -0.5, -0.75, 2.0, -4.0, 0.5, 0.75], false),
            ([1.0, 5.0, 0.5, 2.0], [1.0, FREE, -0.5, 0.0, 3.0, -4.0, 0.5, 0.0], false),
            ([f64::NAN, 5.0, 0.5, 0.25], [0.0, FREE, -0.5, -0.75, 4.0, -4.0, 0.5, 0.75], false),
            ([1.0, f64::INFINITY, 0.0, 0.0], [1.0, FREE, -1.0, -1.0, 3.0, 1.0, 1.0, 1.0], false),
        ] {
            let mut tightening = Tightening::new(Box::new(By(by)), [1; 3], given());
            let (mut low, mut high) = ([0.0; 4], [0.0; 4]);
            let [low_z, low_y, low_s] = parts(&mut low);
            let [high_z, high_y, high_s] = parts(&mut high);
            tightening.tighten(along, [[low_z, high_z], [low_y, high_y], [low_s, high_s]]);
            assert_eq!([low, high].concat(), expected, "{by:?}");
            let bounds = [0..2, 2..3, 3..4].map(|at| [&low[at.clone()], &high[at]]);
            let fit = |x: f64, y: f64, start: f64| {
                tightening.judge(bounds, &[x, -9.0], [&[y], &[start]]).fits
            };
            assert_eq!(fit(2.0, 0.2, 0.6), fits, "{by:?}");
            if fits {
                assert!(!fit(0.9, 0.2, 0.6) && !fit(2.0, 0.6, 0.6) && !fit(2.0, 0.2, 0.8));
            }
        }
    }

    /// The first plan's back-offs cross a bound, the later ones' do not.
    #[derive(Debug)]
    struct WideAtFirst(bool);

    impl Tube for WideAtFirst {
        fn write(&mut self, _: AlongPlan<'_>, to: &mut BackOffs) {
            to.states[0] = if std::mem::take(&mut self.0) { 3.0 } else { 1.0 };
        }

        fn set_covariance(&mut self, _: &[f64]) {}
    }

    #[test]
    fn a_plan_is_judged_by_its_own_back_offs() {
        let none = || [vec![], vec![]];
        let given = [[vec![0.0], vec![4.0]], none(), none()];
        let mut tightening = Tightening::new(Box::new(WideAtFirst(true)), [1, 0, 0], given);
        let stages = Stages { x: &[0.0], u: &[0.0], p: &[] };
        let along = AlongPlan::new(stages, [&[1.0], &[1.0]], Dims::new(1, 1), 0);
        let (mut low, mut high) = ([0.0], [0.0]);
        for fits in [false, true, true] {
            let [no_low, no_high, no_start, no_end]: [&mut [f64]; 4] = Default::default();
            let to = [[&mut low[..], &mut high[..]], [no_low, no_high], [no_start, no_end]];
            tightening.tighten(along, to);
            let bounds: [[&[f64]; 2]; 3] = [[&low, &high], [&[], &[]], [&[], &[]]];
            assert_eq!(tightening.judge(bounds, &[2.0], [&[], &[]]).fits, fits);
        }
    }

    /// The bounds of state and input, of the output and of the output at the start.
    fn parts(sides: &mut [f64; 4]) -> [&mut [f64]; 3] {
        let (z, rest) = sides.split_at_mut(2);
        let (y, start) = rest.split_at_mut(1);
        [z, y, start]
    }
}
