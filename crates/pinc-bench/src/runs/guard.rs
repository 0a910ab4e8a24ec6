//! Whether a net is used outside the box that it was trained on.

use crate::BenchError;
use pinc_config::OutsidePolicy;
use pinc_net::PincNet;
use pinc_record::{Excess, OutsideDomain};

/// Beyond the box by less than this share of its width is rounding.
const ROUNDING: f64 = 1e-9;

/// Looks at each use of a net: the initial state of a step, and its input.
pub(crate) struct Guard<'n> {
    net: &'n PincNet,
    policy: OutsidePolicy,
    found: OutsideDomain,
}

impl<'n> Guard<'n> {
    pub(crate) fn new(net: &'n PincNet, policy: OutsidePolicy) -> Self {
        Self { net, policy, found: OutsideDomain::default() }
    }

    /// Counts a use in the state `x` under the input `u`; an error if it is to be refused.
    pub(crate) fn look(&mut self, x: &[f64], u: &[f64]) -> Result<(), BenchError> {
        self.found.samples += 1;
        let domain = self.net.domain();
        let widths = domain.state_low.iter().zip(&domain.state_high);
        let widths = widths.chain(domain.input_low.iter().zip(&domain.input_high));
        let names = self.net.state_names().iter().chain(self.net.input_names());
        let mut outside = false;
        for ((name, excess), (low, high)) in names.zip(domain.excess(x, u)).zip(widths) {
            if excess <= ROUNDING * (high - low) {
                continue;
            }
            if self.policy == OutsidePolicy::Refuse {
                let (variable, low, high) = (name.clone(), *low, *high);
                return Err(BenchError::OutsideDomain { variable, excess, low, high });
            }
            outside = true;
            let of = self
                .found
                .variables
                .entry(name.clone())
                .or_insert(Excess { samples: 0, farthest: 0.0 });
            of.samples += 1;
            of.farthest = of.farthest.max(excess);
        }
        self.found.outside += usize::from(outside);
        Ok(())
    }

    /// What was seen.
    pub(crate) fn found(self) -> OutsideDomain {
        self.found
    }
}
