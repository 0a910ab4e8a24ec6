//! The guard against using a net outside its training box.

use crate::RunError;
use pinc_config::OutsidePolicy;
use pinc_estimate::{Augmentation, InnerArguments};
use pinc_net::PincNet;
use pinc_ode::Dims;
use pinc_record::{OutsideDomain, significant};
use std::borrow::Cow;

/// Beyond the box by less than this share of its width is rounding.
const ROUNDING: f64 = 1e-9;

/// Looks at each use of a net: the initial state of a step and those of a plan, its input, and the parameters.
#[derive(Debug)]
pub(crate) struct Guard<'n> {
    net: Cow<'n, PincNet>,
    policy: OutsidePolicy,
    /// What makes it report instead of refuse.
    report: &'static str,
    arguments: InnerArguments,
    ahead: Ahead,
    /// The parameters of the net, if it is one of a family.
    member: Option<Member>,
    found: OutsideDomain,
}

/// Values that parameters have somewhere in a plan, beside those of the model: the parameters by their
/// places, and sets of values for them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ahead {
    pub(crate) places: Vec<usize>,
    pub(crate) values: Vec<Vec<f64>>,
}

/// A net of a family with values for its parameters.
#[derive(Clone, Debug)]
pub(crate) struct Member {
    /// The net that takes them.
    pub(crate) family: PincNet,
    pub(crate) parameters: Vec<f64>,
}

impl<'n> Guard<'n> {
    /// Of a net by itself, or with what the controller's model has: an augmentation, and parameters
    /// elsewhere in its plans.
    pub(crate) fn new(
        net: Cow<'n, PincNet>,
        policy: OutsidePolicy,
        (augmentation, ahead): (Option<Augmentation>, Ahead),
    ) -> Self {
        let [nx, nu] = [net.state_names(), net.input_names()].map(<[_]>::len);
        let dims = Dims::new(nx, nu).with_parameters(net.parameter_names().count());
        let arguments = InnerArguments::new(dims, augmentation);
        let report = "control.outside_domain = \"report\"";
        let found = OutsideDomain::default();
        Self { net, policy, report, arguments, ahead, member: None, found }
    }

    /// The guard of a net that is a member of a family.
    pub(crate) fn of_member(self, member: Option<Member>) -> Self {
        Self { member, ..self }
    }

    /// Of a net by itself whose policy is an option of a command.
    pub(crate) fn of_command(net: &'n PincNet, policy: OutsidePolicy) -> Self {
        let report = "--outside-domain report";
        Self { report, ..Self::new(Cow::Borrowed(net), policy, (None, Ahead::default())) }
    }

    /// Counts a use in the state `x` under the input `u` with the parameters `p` of the model; an
    /// error if it is to be refused.
    pub(crate) fn look(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> Result<(), RunError> {
        self.look_along(&[], x, u, p)
    }

    /// The same with the states of a plan, `[N, n]`, at whose end the net is not used.
    pub(crate) fn look_along(
        &mut self,
        plan: &[f64],
        x: &[f64],
        u: &[f64],
        p: &[f64],
    ) -> Result<(), RunError> {
        let planned = plan.len().saturating_sub(x.len());
        let later = plan[..planned].chunks_exact(x.len());
        let [x, u, p] = self.arguments.of(x, u, p);
        let (net, p) = match &self.member {
            Some(Member { family, parameters }) => (family, &parameters[..]),
            None => (&*self.net, p),
        };
        let domain = net.domain();
        let variables = net.state_names().iter().chain(net.input_names());
        let names = variables.map(String::as_str).chain(net.parameter_names());
        let mut excesses: Vec<f64> = domain.excess(x, u, p).collect();
        for x in later {
            let there = domain.excess(x, u, p);
            excesses.iter_mut().zip(there).for_each(|(most, of)| *most = most.max(of));
        }
        if !self.ahead.values.is_empty() {
            let mut p = p.to_vec();
            for values in &self.ahead.values {
                self.ahead.places.iter().zip(values).for_each(|(&place, value)| p[place] = *value);
                let there = domain.excess(x, u, &p);
                excesses.iter_mut().zip(there).for_each(|(most, of)| *most = most.max(of));
            }
        }
        let beyond = |((_, excess), (low, high)): &((&str, f64), (f64, f64))| {
            *excess > ROUNDING * (high - low)
        };
        let mut outside = names.zip(excesses).zip(domain.ends()).filter(beyond).peekable();
        if let (OutsidePolicy::Refuse, Some(((name, excess), (low, high)))) =
            (self.policy, outside.peek())
        {
            return Err(RunError::Failed(format!(
                "the net would be used outside its training domain: {name} is {} beyond {low} to \
                 {high}; train on a larger [domain], or continue with {}",
                significant(*excess),
                self.report
            )));
        }
        self.found.add(outside.map(|((name, excess), _)| (name.to_owned(), excess)));
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
