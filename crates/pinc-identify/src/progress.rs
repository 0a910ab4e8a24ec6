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
