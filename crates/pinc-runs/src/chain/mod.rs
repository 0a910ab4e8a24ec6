//! The free run of a net: its own output fed back every T (self-loop), asked at any time between.

/// Steps that a chain goes at most between two samples.
const MOST_STEPS: f64 = 1e6;

/// A net running freely from an initial state under a piecewise-constant input.
///
/// An interval of T begins at the initial state and where the one before ends: the step mark, whose
/// value is the state chained there. An input that changes within an interval ends it, and the next
/// begins there with the value of that time as its initial state.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    sample_time_s: f64,
    /// The initial time.
    first: f64,
    /// Where the marks are counted from: 0, or the last change within an interval, since `first`.
    origin: f64,
    /// Marks since then.
    marks: f64,
    state: Vec<f64>,
    input: Vec<f64>,
    t: f64,
}

/// One value of a chain.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sample {
    pub(crate) state: Vec<f64>,
    /// Whether it lies on a step mark: an interval ends there and the next begins.
    pub(crate) mark: bool,
}

impl Chain {
    /// A chain of intervals of `sample_time_s` that begins at time `t` in `state`, under `input`.
    pub(crate) fn new(sample_time_s: f64, t: f64, state: &[f64], input: &[f64]) -> Self {
        let (state, input) = (state.to_vec(), input.to_vec());
        Self { sample_time_s, first: t, origin: 0.0, marks: 0.0, state, input, t }
    }

    /// The time of the last sample.
    pub(crate) fn time(&self) -> f64 {
        self.t
    }

    /// Whether a chain can be run up to `t` in reasonable time.
    pub(crate) fn reaches(&self, t: f64) -> bool {
        (t - self.t) / self.sample_time_s <= MOST_STEPS
    }

    /// The value at a later time `t`, from where on `input` holds. `net` is y(t, y0, u).
    pub(crate) fn advance(
        &mut self,
        net: &mut impl FnMut(f64, &[f64], &[f64]) -> Vec<f64>,
        t: f64,
        input: &[f64],
    ) -> Sample {
        self.t = t;
        let since = t - self.first;
        // Times of a clock are large beside T: both were rounded when they were read.
        let rounding = f64::EPSILON * t.abs().max(self.first.abs());
        let slack = (1e-9 * self.sample_time_s.max(since)).max(rounding);
        let slack = slack.min(0.5 * self.sample_time_s);
        while since >= self.origin + (self.marks + 1.0) * self.sample_time_s - slack {
            self.state = net(self.sample_time_s, &self.state, &self.input);
            self.marks += 1.0;
        }
        let begin = self.origin + self.marks * self.sample_time_s;
        let mark = (since - begin).abs() <= slack;
        let state =
            if mark { self.state.clone() } else { net(since - begin, &self.state, &self.input) };
        if input != self.input {
            self.input.copy_from_slice(input);
            if !mark {
                (self.origin, self.marks) = (since, 0.0);
                self.state.copy_from_slice(&state);
            }
        }
        Sample { state, mark }
    }
}

#[cfg(test)]
mod tests;
