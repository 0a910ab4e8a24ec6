//! Bounds that the plant in a closed loop broke.

use crate::verdict::significant;
use pinc_config::TimeUnit;
use pinc_loop::Violation;
use pinc_mpc::Side;
use serde::{Deserialize, Serialize};

/// The share of a quantity's size from which on a broken bound is worth a word.
const VISIBLE: f64 = 1e-4;

/// The worst violation of a bound, on the dense trace of a closed loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViolationMetrics {
    /// The state, input or output.
    pub of: String,
    /// Its unit; empty if it has none.
    pub unit: String,
    /// Which of its bounds: `low` or `high`.
    pub side: String,
    /// The bound, in that unit.
    pub bound: f64,
    /// Whether it is hard; a soft one may be broken at a cost.
    pub hard: bool,
    /// By how much it was broken, in that unit.
    pub amount: f64,
    /// When, in s from the beginning of the loop.
    pub time_s: f64,
    /// By how much it was broken at the ends of control steps, at most; 0 if it held there.
    pub at_steps: f64,
    /// The amount as a share of the quantity's largest absolute value.
    pub share: f64,
    /// The step of a plan from which on the controller keeps it: `n1` for outputs, 1 for others.
    #[serde(default)]
    pub from_step: usize,
}

impl ViolationMetrics {
    /// The violation of a bound of the quantity `of`, which plans keep from a step on.
    #[must_use]
    pub fn new(violation: &Violation, of: &str, unit: &str, from_step: usize) -> Self {
        Self {
            of: of.to_owned(),
            unit: unit.to_owned(),
            side: match violation.side {
                Side::Low => "low",
                Side::High => "high",
            }
            .to_owned(),
            bound: violation.bound,
            hard: violation.hard,
            amount: violation.amount,
            time_s: violation.time_s,
            at_steps: violation.at_steps,
            share: violation.share(),
            from_step,
        }
    }

    /// Whether a hard bound was broken by more than rounding and the optimizer's tolerance.
    #[must_use]
    pub fn is_noteworthy(&self) -> bool {
        self.hard && self.is_visible()
    }

    /// Whether the bound, of whatever softness, was broken by more than these.
    pub(crate) fn is_visible(&self) -> bool {
        self.share > VISIBLE
    }

    /// Whether the bound held at the ends of control steps, as far as is visible.
    #[must_use]
    pub fn is_between_steps(&self) -> bool {
        self.at_steps * self.share <= VISIBLE * self.amount
    }

    /// The unit as it follows a number: after a space, if there is one.
    pub(crate) fn unit_after_number(&self) -> String {
        match &*self.unit {
            "" => String::new(),
            unit => format!(" {unit}"),
        }
    }

    /// The violation in words, as `0.031 m above 1 m at 3.2 s`.
    #[must_use]
    pub fn shown(&self, time_unit: Option<TimeUnit>) -> String {
        let unit = self.unit_after_number();
        let side = if self.side == "low" { "below" } else { "above" };
        format!(
            "{}{unit} {side} {}{unit} at {}",
            significant(self.amount),
            self.bound,
            TimeUnit::shown(self.time_s, time_unit)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_loop::ClosedLoop;
    use pinc_mpc::{Bounded, Bounds, Nmpc, NmpcProblem, Reference, Softness, SqpConfig, Weights};
    use pinc_ode::{Dopri5, Model, Rk4};
    use pinc_plants::VanDerPol;

    /// What the oscillator breaks that starts at (1, 1), where the first state is to be 2 or more and
    /// the second 0.5 at most.
    fn broken(state_softness: Softness) -> Vec<Violation> {
        let model = Rk4::new(VanDerPol::default(), 0.5, 4);
        let infinite = f64::INFINITY;
        let problem = NmpcProblem {
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            state_bounds: Bounds::new(vec![2.0, -infinite], vec![infinite, 0.5]),
            state_softness,
            ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
        };
        let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
        let plant = Dopri5::new(VanDerPol::default(), 1e-10);
        let reference = Reference::new(vec![0.0, 0.0], 2).unwrap();
        let mut run = ClosedLoop::new(&mut nmpc, plant, reference, &[1.0, 1.0]).unwrap();
        run.run().unwrap();
        run.violations().copied().collect()
    }

    /// Each number of a violation has its place, and the share is that of the larger of the
    /// quantity and its bound.
    #[test]
    fn a_violation_is_recorded_with_its_side_and_share() {
        for (softness, hard) in [(Softness::Hard, true), (Softness::Exact, false)] {
            let violations = broken(softness);
            assert_eq!(violations.len(), 2, "{violations:?}");
            for (of, side, bound) in [(0, "low", 2.0_f64), (1, "high", 0.5)] {
                let is_it = |violation: &&Violation| violation.of == Bounded::State(of);
                let violation = violations.iter().find(is_it).unwrap();
                let recorded = ViolationMetrics::new(violation, "h", "cm", 3);
                let expected = ViolationMetrics {
                    of: "h".to_owned(),
                    unit: "cm".to_owned(),
                    side: side.to_owned(),
                    bound,
                    hard,
                    amount: violation.amount,
                    time_s: violation.time_s,
                    at_steps: violation.at_steps,
                    share: violation.amount / violation.size.max(bound),
                    from_step: 3,
                };
                assert_eq!(recorded, expected);
                assert!(recorded.amount > 0.3 && recorded.amount - recorded.at_steps > 1e-3);
                assert!(recorded.is_visible());
                assert_eq!(recorded.is_noteworthy(), hard);
            }
        }
    }

    /// What is visible is above 1e-4 of the quantity, whatever the bound's softness; only a hard
    /// bound is worth a note. It is said with the unit, if there is one, and the side.
    #[test]
    fn a_violation_is_visible_by_its_share() {
        let of = |share: f64, hard: bool| ViolationMetrics {
            of: "h".to_owned(),
            unit: "cm".to_owned(),
            side: "low".to_owned(),
            bound: -2.0,
            hard,
            amount: 8.0 * share,
            time_s: 12.0,
            at_steps: 0.0,
            share,
            from_step: 1,
        };
        for (share, hard, visible) in
            [(1.01e-4, true, true), (1.01e-4, false, true), (0.99e-4, true, false)]
        {
            let of = of(share, hard);
            assert_eq!((of.is_visible(), of.is_noteworthy()), (visible, visible && hard));
        }
        assert_eq!(of(0.0625, true).shown(None), "0.500 cm below -2 cm at 12 s");
        let high = ViolationMetrics { side: "high".into(), unit: String::new(), ..of(0.25, true) };
        assert_eq!(high.shown(None), "2.00 above -2 at 12 s");
    }
}
