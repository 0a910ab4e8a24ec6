//! Steps that raise the cost for a while, and an end to steps that gain nothing.
//!
//! An equation with `max`, `min` or a branch has a kink in the cost for every row at which it
//! switches. A descent that must lower the cost in each step crawls along the first kink that it
//! meets, since the linearization holds on one side only.

/// Steps within which the cost must fall below its highest value (Grippo, Lampariello and Lucidi, "A
/// nonmonotone line search technique for Newton's method", SIAM Journal on Numerical Analysis 23
/// (1986)).
const MEMORY: usize = 5;
/// Steps that together must lower the cost by more than the share [`GAIN`].
const IDLE: usize = 30;
/// Of the cost: a gain that is worth further steps.
pub(crate) const GAIN: f64 = 1e-6;

/// The point of a fit: its parameters and the states at its nodes.
pub(crate) type Point = (Vec<f64>, Vec<Vec<f64>>);

/// The costs of the last steps, and the best point.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    recent: Vec<f64>,
    best: Option<(f64, Point)>,
    /// Steps since the cost fell by more than [`GAIN`].
    idle: usize,
    /// The cost then.
    mark: f64,
}

impl Progress {
    /// Whether a step to `cost` may be taken though it raises the cost.
    pub(crate) fn allows(&self, cost: f64) -> bool {
        self.recent.len() == MEMORY && self.recent.iter().any(|&recent| cost < recent)
    }

    /// Notes a step to `cost`, whose point is asked for if it is the best. Gives whether to go on.
    pub(crate) fn step(&mut self, cost: f64, point: impl FnOnce() -> Point) -> bool {
        if self.recent.len() == MEMORY {
            self.recent.remove(0);
        }
        self.recent.push(cost);
        self.idle += 1;
        if self.best.as_ref().is_none_or(|(best, _)| cost < *best) {
            if self.best.is_none() || cost < (1.0 - GAIN) * self.mark {
                (self.idle, self.mark) = (0, cost);
            }
            self.best = Some((cost, point()));
        }
        self.idle < IDLE
    }

    /// The best point, if its cost is below `cost`.
    pub(crate) fn better(&mut self, cost: f64) -> Option<Point> {
        self.best.take().filter(|(best, _)| *best < cost).map(|(_, point)| point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(at: f64) -> impl FnOnce() -> Point {
        move || (vec![at], Vec::new())
    }

    /// A rise is allowed below the highest of the last five costs, and the best point is kept.
    #[test]
    fn costs_may_rise_for_a_while() {
        let mut progress = Progress::default();
        for cost in [9.0, 5.0, 4.0, 3.0] {
            assert!(!progress.allows(8.9));
            assert!(progress.step(cost, point(cost)));
        }
        assert!(progress.step(2.0, point(2.0)));
        assert!(progress.allows(8.9) && !progress.allows(9.0));
        assert!(progress.step(2.5, point(2.5)));
        assert!(progress.allows(4.9) && !progress.allows(5.0), "the first has been forgotten");
        assert_eq!(progress.better(2.5), Some((vec![2.0], Vec::new())));
        assert_eq!(progress.better(2.5), None);
    }

    /// Thirty steps that lower the cost by less than a millionth together are the last, however
    /// many of them lower it.
    #[test]
    fn steps_that_gain_nothing_end() {
        let mut progress = Progress::default();
        let mut cost = 1.0;
        assert!(progress.step(cost, point(cost)));
        for _ in 1..IDLE {
            cost -= 1e-8;
            assert!(progress.step(cost, point(cost)));
        }
        assert!(!progress.step(cost - 1e-8, point(cost)));
        assert!(progress.step(0.9, point(0.9)), "a gain begins anew");
        assert_eq!(progress.idle, 0);
    }
}
