//! Functions of the time as text.

use crate::graph::Graph;
use crate::program::Program;
use crate::{ExpressionError, parser};
use std::collections::BTreeMap;

/// A function of the time t, with the numbers, operators and functions of
/// [`Equations`](crate::Equations).
///
/// ```
/// use pinc_expr::TimeFunction;
///
/// let ramp = TimeFunction::parse("min(2, t/10)")?;
/// assert_eq!((ramp.at(5.0), ramp.at(100.0)), (0.5, 2.0));
/// # Ok::<(), pinc_expr::ExpressionError>(())
/// ```
#[derive(Clone, Debug)]
pub struct TimeFunction(Program);

impl TimeFunction {
    /// The function that the text says.
    ///
    /// # Errors
    ///
    /// What is wrong with the text. The error has no key.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        let mut graph = Graph::default();
        let scope = BTreeMap::from([("t", graph.variable(0))]);
        let value = parser::parse("", text, &scope, &mut graph)?;
        Program::new(&graph, 1, &[value]).map(Self).map_err(|problem| problem.at(""))
    }

    /// Returns its value at the time `t`.
    #[must_use]
    pub fn at(&self, t: f64) -> f64 {
        let mut value = [f64::NAN];
        self.0.run(&[t], &[], &[], &mut value);
        value[0]
    }
}
