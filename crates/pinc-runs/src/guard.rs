//! The guard against using a net outside its training box.

use crate::RunError;
use pinc_config::OutsidePolicy;
use pinc_estimate::{Augmentation, InnerArguments};
use pinc_mpc::Scenarios;
use pinc_net::PincNet;
use pinc_ode::Dims;
use pinc_record::{Excess, OutsideDomain, significant};
use std::borrow::Cow;

/// Beyond the box by less than this share of its width is rounding.
const ROUNDING: f64 = 1e-9;

/// Looks at each use of a net: the initial state of a step, its input, and the parameters.
#[derive(Debug)]
pub(crate) struct Guard<'n> {
    net: Cow<'n, PincNet>,
    policy: OutsidePolicy,
    /// What makes it report instead of refuse.
    report: &'static str,
    arguments: InnerArguments,
    scenarios: Option<Scenarios>,
    found: OutsideDomain,
}

impl<'n> Guard<'n> {
    /// Of a net by itself, or with what the controller's model has: an augmentation, or branches whose
    /// parameters are looked at.
    pub(crate) fn new(
        net: Cow<'n, PincNet>,
        policy: OutsidePolicy,
        (augmentation, scenarios): (Option<Augmentation>, Option<Scenarios>),
    ) -> Self {
        let [nx, nu] = [net.state_names(), net.input_names()].map(<[_]>::len);
        let dims = Dims::new(nx, nu).with_parameters(net.parameter_names().count());
        let arguments = InnerArguments::new(dims, augmentation);
        let report = "control.outside_domain = \"report\"";
        Self { net, policy, report, arguments, scenarios, found: OutsideDomain::default() }
    }

    /// Of a net by itself whose policy is an option of a command.
    pub(crate) fn of_command(net: &'n PincNet, policy: OutsidePolicy) -> Self {
        let report = "--outside-domain report";
        Self { report, ..Self::new(Cow::Borrowed(net), policy, (None, None)) }
    }

    /// Counts a use in the state `x` under the input `u` with the parameters `p` of the model; an
    /// error if it is to be refused.
    pub(crate) fn look(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> Result<(), RunError> {
        self.found.samples += 1;
        let [x, u, p] = self.arguments.of(x, u, p);
        let domain = self.net.domain();
        let variables = self.net.state_names().iter().chain(self.net.input_names());
        let names = variables.map(String::as_str).chain(self.net.parameter_names());
        let mut excesses: Vec<f64> = domain.excess(x, u, p).collect();
        if let Some(Scenarios { parameters, values, .. }) = &self.scenarios {
            let mut p = p.to_vec();
            for values in values {
                parameters.iter().zip(values).for_each(|(&place, value)| p[place] = *value);
                let of_branch = domain.excess(x, u, &p);
                excesses.iter_mut().zip(of_branch).for_each(|(most, of)| *most = most.max(of));
            }
        }
        let mut outside = false;
        for ((name, excess), (low, high)) in names.zip(excesses).zip(domain.ends()) {
            if excess <= ROUNDING * (high - low) {
                continue;
            }
            if self.policy == OutsidePolicy::Refuse {
                return Err(RunError::Failed(format!(
                    "the net would be used outside its training domain: {name} is {} \
                     beyond {low} to {high}; train on a larger [domain], or continue with {}",
                    significant(excess),
                    self.report
                )));
            }
            outside = true;
            let of = self
                .found
                .variables
                .entry(name.to_owned())
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

    /// What was seen so far.
    pub(crate) fn seen(&self) -> &OutsideDomain {
        &self.found
    }
}
