//! In which order algebraic equations can be solved: an equation for each unknown (a maximum
//! matching), then the smallest systems that must be solved at once (strongly connected
//! components). Pantelides, "The consistent initialization of differential-algebraic systems", SIAM
//! J. Sci. Stat. Comput. 9 (1988), has the first, Duff and Reid, "An implementation of Tarjan's
//! algorithm for the block triangularization of a matrix", ACM TOMS 4 (1978), the second.

use crate::error::{Deficiency, ExpressionError, ExpressionProblem};
use crate::graph::{Graph, Value};
use std::collections::BTreeSet;

/// Equations that are solved at once, and as many unknowns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Block {
    pub(crate) unknowns: Vec<usize>,
    pub(crate) equations: Vec<usize>,
}

/// The variables that a value depends on.
pub(crate) fn variables_of(graph: &Graph, value: Value) -> BTreeSet<usize> {
    let needed = graph.needed(&[value]).into_iter().zip(&graph.nodes);
    needed.filter_map(|(is_needed, node)| node.operation.variable().filter(|_| is_needed)).collect()
}

/// The blocks, each after those whose unknowns it needs. The unknowns are the graph's variables
/// from `first` on, and equation i is `names[i]`'s.
pub(crate) fn blocks(
    graph: &Graph,
    first: usize,
    residuals: &[Value],
    names: &[String],
) -> Result<Vec<Block>, ExpressionError> {
    let unknowns_of = |residual: &Value| -> Vec<usize> {
        variables_of(graph, *residual).iter().filter_map(|v| v.checked_sub(first)).collect()
    };
    let contains: Vec<Vec<usize>> = residuals.iter().map(unknowns_of).collect();
    let equation_of = matching(&contains, names)?;
    let mut search = Components::new(&contains, &equation_of);
    (0..names.len()).for_each(|unknown| search.visit(unknown));
    Ok(search.blocks)
}

/// For each unknown the equation that is solved for it.
fn matching(contains: &[Vec<usize>], names: &[String]) -> Result<Vec<usize>, ExpressionError> {
    let mut equation_of: Vec<Option<usize>> = vec![None; names.len()];
    for equation in 0..contains.len() {
        let mut seen = BTreeSet::new();
        if augment(equation, contains, &mut equation_of, &mut seen) {
            continue;
        }
        return Err(deficiency(equation, contains, &equation_of, &seen, names));
    }
    Ok(equation_of.into_iter().flatten().collect())
}

/// What is wrong where no unknown is found for `equation`: as many equations as `seen` has
/// unknowns, and this one, contain no others.
fn deficiency(
    equation: usize,
    contains: &[Vec<usize>],
    equation_of: &[Option<usize>],
    seen: &BTreeSet<usize>,
    names: &[String],
) -> ExpressionError {
    let mut rest = equation_of.to_vec();
    for other in equation + 1..contains.len() {
        augment(other, contains, &mut rest, &mut BTreeSet::new());
    }
    let listed = |places: &mut dyn Iterator<Item = usize>| {
        places.map(|place| names[place].clone()).collect::<Vec<_>>()
    };
    let others = seen.iter().filter_map(|unknown| equation_of[*unknown]);
    let found = Deficiency {
        equations: listed(&mut others.chain([equation])),
        unknowns: listed(&mut seen.iter().copied()),
        undetermined: listed(&mut (0..names.len()).filter(|unknown| rest[*unknown].is_none())),
    };
    ExpressionProblem::Singular(Box::new(found)).at(format!("algebraic.{}", names[equation]))
}

/// Finds an unknown for `equation`, if others can give theirs up (Kuhn's algorithm).
fn augment(
    equation: usize,
    contains: &[Vec<usize>],
    equation_of: &mut [Option<usize>],
    seen: &mut BTreeSet<usize>,
) -> bool {
    for &unknown in &contains[equation] {
        if !seen.insert(unknown) {
            continue;
        }
        let is_free = match equation_of[unknown] {
            None => true,
            Some(other) => augment(other, contains, equation_of, seen),
        };
        if is_free {
            equation_of[unknown] = Some(equation);
            return true;
        }
    }
    false
}

/// Tarjan's search for the strongly connected components of the unknowns. They are few, so that
/// its recursion is not deep.
struct Components<'a> {
    contains: &'a [Vec<usize>],
    equation_of: &'a [usize],
    number: Vec<Option<usize>>,
    lowest: Vec<usize>,
    path: Vec<usize>,
    count: usize,
    blocks: Vec<Block>,
}

impl<'a> Components<'a> {
    fn new(contains: &'a [Vec<usize>], equation_of: &'a [usize]) -> Self {
        let n = equation_of.len();
        let (number, lowest) = (vec![None; n], vec![0; n]);
        let (path, blocks) = (Vec::new(), Vec::new());
        Self { contains, equation_of, number, lowest, path, count: 0, blocks }
    }

    fn visit(&mut self, unknown: usize) {
        if self.number[unknown].is_some() {
            return;
        }
        self.count += 1;
        self.number[unknown] = Some(self.count);
        self.lowest[unknown] = self.count;
        self.path.push(unknown);
        let contains = self.contains;
        for &next in &contains[self.equation_of[unknown]] {
            if self.number[next].is_none() {
                self.visit(next);
                self.lowest[unknown] = self.lowest[unknown].min(self.lowest[next]);
            } else if self.path.contains(&next) {
                let number = self.number[next].unwrap_or(self.count);
                self.lowest[unknown] = self.lowest[unknown].min(number);
            }
        }
        if self.number[unknown] != Some(self.lowest[unknown]) {
            return;
        }
        let begin = self.path.iter().position(|other| *other == unknown).unwrap_or(0);
        let mut unknowns = self.path.split_off(begin);
        unknowns.sort_unstable();
        let equations = unknowns.iter().map(|unknown| self.equation_of[*unknown]).collect();
        self.blocks.push(Block { unknowns, equations });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equation 0 has unknowns 1 and 2, equation 1 has 0, equation 2 has 1 and 2.
    #[test]
    fn unknowns_come_after_those_that_they_need() {
        let contains = [vec![1, 2], vec![0], vec![0, 1, 2]];
        let names = ["a", "b", "c"].map(str::to_owned);
        let equation_of = matching(&contains, &names).unwrap();
        assert_eq!(equation_of[0], 1);
        let mut search = Components::new(&contains, &equation_of);
        (0..3).rev().for_each(|unknown| search.visit(unknown));
        let unknowns: Vec<_> = search.blocks.iter().map(|b| b.unknowns.clone()).collect();
        assert_eq!(unknowns, [vec![0], vec![1, 2]]);
    }

    #[test]
    fn what_no_equation_determines_is_named() {
        let contains = [vec![1], vec![1], vec![0, 1, 2]];
        let names = ["a", "b", "c"].map(str::to_owned);
        let error = matching(&contains, &names).unwrap_err();
        assert_eq!(error.key, "algebraic.b");
        let expected = Deficiency {
            equations: vec!["a".into(), "b".into()],
            unknowns: vec!["b".into()],
            undetermined: vec!["c".into()],
        };
        assert_eq!(error.problem, ExpressionProblem::Singular(Box::new(expected)));
    }
}
