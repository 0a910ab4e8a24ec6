//! The terms of equations on which it depends where these are defined and smooth.

use crate::graph::{Function, Graph, Node, Operation, Value};
use crate::implicit::AlgebraicSystem;
use crate::program::apply;
use std::collections::{BTreeMap, BTreeSet, HashSet};

/// Longer texts of terms are cut.
const LONGEST: usize = 60;

/// About how often all equations are computed until the algebraic ones are solved.
const NEWTON_STEPS: usize = 5;

/// The role of a term in an equation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TermRole {
    /// It is divided by: not defined where it is 0.
    Denominator,
    /// Its root is taken: not defined where it is negative.
    Radicand,
    /// Its logarithm is taken: not defined where it is not positive. Also of a base whose exponent
    /// is not a number.
    Logarithm,
    /// It is raised to a power that is not whole: not defined where it is negative.
    Base,
    /// `abs`, `min` or `max`: a kink where it is 0 (of the two, the difference).
    Kink,
    /// `sign`: a jump where it is 0.
    Jump,
    /// A comparison with 0 between two expressions: a kink or a jump where it is 0.
    Switch,
}

/// A term on which it depends whether an equation is defined and smooth.
#[derive(Clone, Debug, PartialEq)]
pub struct CriticalTerm {
    /// Its role.
    pub role: TermRole,
    /// It, in the names of states, inputs and `let`, with parameters as numbers.
    pub text: String,
    /// The key of the equation in which it first stands, as `let.mu`.
    pub key: String,
    /// Which values it is the difference of, or the one that it is.
    values: [Option<Value>; 2],
}

/// All such terms of a plant's equations.
///
/// ```
/// use pinc_expr::{Equations, TermRole};
///
/// let equations: Equations = serde_json::from_str(
///     r#"{"states": [{"name": "S"}], "inputs": [{"name": "u"}],
///         "derivatives": {"S": "u/(S + 0.1)"}}"#,
/// )?;
/// let terms = equations.critical_terms()?;
/// assert_eq!(terms.list()[0].role, TermRole::Denominator);
/// assert_eq!(terms.list()[0].text, "S + 0.1");
/// assert!(terms.values(&[-0.1, 1.0])[0].abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct CriticalTerms {
    nodes: Vec<Node>,
    terms: Vec<CriticalTerm>,
    algebraic: Option<Unknowns>,
}

/// The equations that the algebraic variables in the terms are solved from.
#[derive(Debug)]
struct Unknowns {
    states: usize,
    /// States and inputs.
    variables: usize,
    system: AlgebraicSystem,
}

impl Unknowns {
    /// States and inputs with the algebraic variables behind them.
    fn with_unknowns(&self, at: &[f64]) -> Vec<f64> {
        let mut all = at.to_vec();
        all.resize(at.len() + self.system.names.len(), f64::NAN);
        let (x, u) = at.split_at(self.states);
        self.system.solve(x, u, &[], &mut all[at.len()..]);
        all
    }
}

impl CriticalTerms {
    /// Returns a graph's terms; its first nodes up to `keys[i].0` belong to the equation `keys[i].1`.
    pub(crate) fn new(
        graph: Graph,
        variables: &[&str],
        names: &BTreeMap<Value, String>,
        keys: &[(usize, String)],
    ) -> Self {
        let printer = Printer { nodes: &graph.nodes, variables, names };
        let mut terms: Vec<CriticalTerm> = Vec::new();
        let mut seen = HashSet::new();
        for (i, node) in graph.nodes.iter().enumerate() {
            let Some((role, values)) = role(node) else { continue };
            if !seen.insert((role, values)) {
                continue;
            }
            let key = keys.get(keys.partition_point(|(end, _)| *end <= i));
            let key = key.map_or("", |(_, key)| key.as_str());
            let text = printer.difference(values);
            terms.push(CriticalTerm { role, text, key: key.to_owned(), values });
        }
        Self { nodes: graph.nodes, terms, algebraic: None }
    }

    /// With the equations that the algebraic variables in the terms are solved from.
    pub(crate) fn with_algebraic(
        self,
        [states, inputs]: [usize; 2],
        system: AlgebraicSystem,
    ) -> Self {
        let unknowns = Unknowns { states, variables: states + inputs, system };
        Self { algebraic: (!unknowns.system.blocks.is_empty()).then_some(unknowns), ..self }
    }

    /// They, in the order of the equations.
    #[must_use]
    pub fn list(&self) -> &[CriticalTerm] {
        &self.terms
    }

    /// Their values, in that order.
    ///
    /// # Shapes
    ///
    /// `at`: `nx + nu`, states first.
    #[must_use]
    pub fn values(&self, at: &[f64]) -> Vec<f64> {
        let with_unknowns = match &self.algebraic {
            Some(algebraic) => algebraic.with_unknowns(at),
            None => at.to_vec(),
        };
        let all = evaluate(&self.nodes, &with_unknowns);
        self.terms.iter().map(|term| difference(term.values, &all)).collect()
    }
}

/// The values of nodes at these variables.
fn evaluate(nodes: &[Node], variables: &[f64]) -> Vec<f64> {
    let mut all = Vec::with_capacity(nodes.len());
    for node in nodes {
        let [a, b, c] = node.operands.map(|operand| operand.map_or(0.0, |value| all[value.0]));
        all.push(match node.operation {
            Operation::Variable(i) => variables[i],
            operation => apply(operation, &a, &b, &c),
        });
    }
    all
}

/// What a term is, from the values of all nodes.
fn difference(values: [Option<Value>; 2], all: &[f64]) -> f64 {
    let [one, other] = values.map(|value| value.map_or(0.0, |value| all[value.0]));
    one - other
}

/// One of the [`CriticalTerms`], computed without the others.
#[derive(Clone, Debug)]
pub struct LoneTerm<'a> {
    /// What is computed, with the operands among these.
    nodes: Vec<Node>,
    /// Which of these the term is the difference of, or the one that it is.
    values: [Option<Value>; 2],
    variables: Vec<usize>,
    operations: usize,
    /// If it depends on algebraic variables.
    unknowns: Option<&'a Unknowns>,
}

impl CriticalTerms {
    /// The term `list()[i]` by itself: what it is made of, and nothing else. If algebraic variables
    /// are among that, all algebraic equations are solved for it.
    #[must_use]
    pub fn alone(&self, i: usize) -> LoneTerm<'_> {
        let mut needed: BTreeSet<Value> = BTreeSet::new();
        let mut open: Vec<Value> = self.terms[i].values.into_iter().flatten().collect();
        while let Some(value) = open.pop() {
            if needed.insert(value) {
                open.extend(self.nodes[value.0].operands.into_iter().flatten());
            }
        }
        let needed: Vec<Value> = needed.into_iter().collect();
        // Operands come before what is made of them, so that the order can stay.
        let place = |value: Value| Value(needed.binary_search(&value).unwrap_or_default());
        let node = |value: &Value| {
            let Node { operation, operands } = self.nodes[value.0];
            Node { operation, operands: operands.map(|operand| operand.map(place)) }
        };
        let nodes: Vec<Node> = needed.iter().map(node).collect();
        let mut variables: Vec<usize> =
            nodes.iter().filter_map(|node| node.operation.variable()).collect();
        variables.sort_unstable();
        let mut operations = nodes.len();
        let depends = |unknowns: &&Unknowns| variables.iter().any(|&i| i >= unknowns.variables);
        let unknowns = self.algebraic.as_ref().filter(depends);
        if let Some(unknowns) = unknowns {
            variables = (0..unknowns.variables).collect();
            operations += NEWTON_STEPS * self.nodes.len();
        }
        let values = self.terms[i].values.map(|value| value.map(place));
        LoneTerm { nodes, values, variables, operations, unknowns }
    }
}

impl LoneTerm<'_> {
    /// Its value, the same as in [`CriticalTerms::values`].
    ///
    /// # Shapes
    ///
    /// `at`: `nx + nu`, states first.
    #[must_use]
    pub fn value(&self, at: &[f64]) -> f64 {
        let with_unknowns = self.unknowns.map(|unknowns| unknowns.with_unknowns(at));
        let at = with_unknowns.as_deref().unwrap_or(at);
        difference(self.values, &evaluate(&self.nodes, at))
    }

    /// The states and inputs that it depends on, counted together.
    #[must_use]
    pub fn variables(&self) -> &[usize] {
        &self.variables
    }

    /// About how many values are computed for it.
    #[must_use]
    pub fn operations(&self) -> usize {
        self.operations
    }
}

fn role(node: &Node) -> Option<(TermRole, [Option<Value>; 2])> {
    let [a, b, _] = node.operands;
    Some(match node.operation {
        Operation::Div => (TermRole::Denominator, [b, None]),
        Operation::DivInto(_) => (TermRole::Denominator, [a, None]),
        Operation::Power(_) => (TermRole::Base, [a, None]),
        Operation::Min | Operation::Max => (TermRole::Kink, [a, b]),
        Operation::Where => (TermRole::Switch, [a, None]),
        Operation::Function(Function::Sqrt) => (TermRole::Radicand, [a, None]),
        Operation::Function(Function::Log) => (TermRole::Logarithm, [a, None]),
        Operation::Function(Function::Abs) => (TermRole::Kink, [a, None]),
        Operation::Function(Function::Sign) => (TermRole::Jump, [a, None]),
        _ => return None,
    })
}

/// From values back to text.
struct Printer<'a> {
    nodes: &'a [Node],
    variables: &'a [&'a str],
    names: &'a BTreeMap<Value, String>,
}

/// How strongly the operation of a text binds: sums, products, the rest.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Binding {
    Sum,
    Product,
    Atom,
}

impl Printer<'_> {
    fn difference(&self, values: [Option<Value>; 2]) -> String {
        let parts = values.map(|value| value.map(|value| self.inside(value)));
        let text = match parts {
            [Some(a), Some(b)] => format!("{a} - {b}"),
            [Some(a), None] | [None, Some(a)] => a,
            [None, None] => String::new(),
        };
        if text.chars().count() <= LONGEST {
            return text;
        }
        let cut: String = text.chars().take(LONGEST).collect();
        format!("{cut}..")
    }

    /// The text of a value that is not replaced by its own name.
    fn inside(&self, value: Value) -> String {
        let mut budget = LONGEST;
        self.operation(value, &mut budget).0
    }

    fn text(&self, value: Value, at_least: Binding, budget: &mut usize) -> String {
        if let Some(name) = self.names.get(&value) {
            return name.clone();
        }
        if *budget == 0 {
            return "..".to_owned();
        }
        *budget -= 1;
        let (text, binding) = self.operation(value, budget);
        if binding < at_least { format!("({text})") } else { text }
    }

    fn operation(&self, value: Value, budget: &mut usize) -> (String, Binding) {
        let node = self.nodes[value.0];
        let mut of = |k: usize, at_least: Binding| {
            node.operands[k].map_or_else(String::new, |v| self.text(v, at_least, budget))
        };
        match node.operation {
            Operation::Variable(i) => (self.variables[i].to_owned(), Binding::Atom),
            Operation::Constant(number) => (short(number.value()), Binding::Atom),
            Operation::Add => {
                (format!("{} + {}", of(0, Binding::Sum), of(1, Binding::Sum)), Binding::Sum)
            }
            Operation::Sub => {
                (format!("{} - {}", of(0, Binding::Sum), of(1, Binding::Product)), Binding::Sum)
            }
            Operation::Mul => {
                let text = format!("{}*{}", of(0, Binding::Product), of(1, Binding::Product));
                (text, Binding::Product)
            }
            Operation::Div => {
                let text = format!("{}/{}", of(0, Binding::Product), of(1, Binding::Atom));
                (text, Binding::Product)
            }
            Operation::Min => {
                (format!("min({}, {})", of(0, Binding::Sum), of(1, Binding::Sum)), Binding::Atom)
            }
            Operation::Max => {
                (format!("max({}, {})", of(0, Binding::Sum), of(1, Binding::Sum)), Binding::Atom)
            }
            Operation::Where => {
                let (test, yes, no) =
                    (of(0, Binding::Sum), of(1, Binding::Sum), of(2, Binding::Sum));
                (format!("({yes} where {test} <= 0, else {no})"), Binding::Atom)
            }
            Operation::Neg => (format!("-{}", of(0, Binding::Product)), Binding::Sum),
            Operation::AddNumber(number) => {
                let (sign, size) = signed(number.value());
                (format!("{} {sign} {size}", of(0, Binding::Sum)), Binding::Sum)
            }
            Operation::SubFrom(number) => {
                (format!("{} - {}", short(number.value()), of(0, Binding::Product)), Binding::Sum)
            }
            Operation::MulNumber(number) => {
                let text = format!("{}*{}", short(number.value()), of(0, Binding::Product));
                (text, Binding::Product)
            }
            Operation::DivInto(number) => {
                let text = format!("{}/{}", short(number.value()), of(0, Binding::Atom));
                (text, Binding::Product)
            }
            Operation::Power(number) => {
                let text = format!("{}^{}", of(0, Binding::Atom), short(number.value()));
                (text, Binding::Product)
            }
            Operation::Function(function) => {
                let name = Function::ALL.iter().find(|(_, f)| *f == function);
                let name = name.map_or("", |(name, _)| name);
                (format!("{name}({})", of(0, Binding::Sum)), Binding::Atom)
            }
        }
    }
}

fn signed(value: f64) -> (char, String) {
    if value < 0.0 { ('-', short(-value)) } else { ('+', short(value)) }
}

/// A number with six digits at most.
pub(crate) fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    format!("{rounded}")
}
