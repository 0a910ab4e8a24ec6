//! A judge of the model where a plan begins, and the controller that takes over.

use crate::Nmpc;
use std::fmt::{self, Debug};

/// Judges the first step of a plan: whether the model can be trusted there.
pub trait Judge: Debug + Send {
    /// Whether the model's step from the state `x` under the input `u` with the parameters `p` can be
    /// trusted. It allocates nothing.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `p`: `np`, of the controller's model.
    fn trusts(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> bool;

    /// Writes the parameters of the substitute's model, after a step that was not trusted; `p` are
    /// the parameters of the controller's own model. By default they are the same.
    ///
    /// # Panics
    ///
    /// The default panics if the models have different numbers of parameters.
    fn substitute_parameters(&self, p: &[f64], substitute: &mut [f64]) {
        substitute.copy_from_slice(p);
    }
}

/// Whether the model was trusted in the first step of a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trust {
    /// There is no [`Judge`], or no plan that was followed.
    #[default]
    NotJudged,
    /// The step is as good as is asked for.
    Trusted,
    /// It is not, and was followed all the same: there is no substitute.
    Doubted,
    /// It is not, and the substitute has chosen the input.
    Substituted,
}

impl fmt::Display for Trust {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotJudged => "not-judged",
            Self::Trusted => "trusted",
            Self::Doubted => "doubted",
            Self::Substituted => "substituted",
        })
    }
}

/// A judge, and the controller that takes over where it does not trust the model.
#[derive(Debug)]
pub(crate) struct Guard {
    pub(crate) judge: Box<dyn Judge>,
    pub(crate) substitute: Option<Box<Nmpc>>,
    /// The parameters of the substitute's model.
    pub(crate) parameters: Vec<f64>,
}

impl Guard {
    pub(crate) fn new(judge: Box<dyn Judge>, substitute: Option<Nmpc>) -> Self {
        let parameters = substitute.as_ref().map_or(0, |nmpc| nmpc.parameters().len());
        Self { judge, substitute: substitute.map(Box::new), parameters: vec![0.0; parameters] }
    }
}
