//! A right-hand side as C, with its derivatives by forward differentiation.

use crate::ExportError;
use crate::error::finite;
use crate::template::constant;
use pinc_expr::{Function, Instruction, Listing};
use std::fmt::Write as _;

/// The body of a function of x and u that writes the results to `to`.
pub(crate) fn values(listing: &Listing, nx: usize, to: &str) -> String {
    let mut body = Body { text: String::new(), nx, tangents: 0 };
    for (i, instruction) in listing.instructions.iter().enumerate() {
        body.value(i, *instruction);
    }
    body.results(listing, to);
    body.finish(listing)
}

/// The same of points side by side, one in each lane of vectors; what is no arithmetic is computed
/// lane by lane.
pub(crate) fn lane_values(listing: &Listing, nx: usize, to: &str) -> String {
    let mut body = Body { text: "    int l;\n".to_owned(), nx, tangents: 0 };
    let mut is_vector: Vec<bool> = Vec::new();
    for (i, instruction) in listing.instructions.iter().enumerate() {
        let varies = instruction.operands().any(|operand| is_vector[operand]);
        match instruction {
            Instruction::Variable(_)
            | Instruction::Add(..)
            | Instruction::Sub(..)
            | Instruction::Mul(..)
            | Instruction::Div(..)
            | Instruction::Neg(_) => {
                let text = body.expression(*instruction, &|operand| format!("v{operand}"));
                let varies = varies || matches!(instruction, Instruction::Variable(_));
                let kind = if varies { "pinc_vector" } else { "const PINC_REAL" };
                let _ = writeln!(body.text, "    {kind} v{i} = {text};");
                is_vector.push(varies);
            }
            _ if varies => {
                let lane = |operand: usize| match is_vector[operand] {
                    true => format!("PINC_LANE(v{operand}, l)"),
                    false => format!("v{operand}"),
                };
                let text = body.expression(*instruction, &lane);
                let _ = writeln!(
                    body.text,
                    "    pinc_vector v{i};\n    for (l = 0; l < PINC_LANES; l++) {{\n        \
                     PINC_LANE(v{i}, l) = {text};\n    }}"
                );
                is_vector.push(true);
            }
            _ => {
                body.value(i, *instruction);
                is_vector.push(false);
            }
        }
    }
    for (row, &result) in listing.results.iter().enumerate() {
        let _ = match is_vector[result] {
            true => writeln!(body.text, "    {to}[{row}] = v{result};"),
            false => writeln!(
                body.text,
                "    for (l = 0; l < PINC_LANES; l++) {{\n        PINC_LANE({to}[{row}], l) = \
                 v{result};\n    }}"
            ),
        };
    }
    if !body.text.contains("(l = 0") {
        body.text = body.text.replacen("    int l;\n", "", 1);
    }
    body.finish(listing)
}

/// A function of x and u with its derivatives by both.
pub(crate) struct Jacobian {
    /// The body of the function: it writes the results, and to f the derivatives that are not 0.
    pub(crate) body: String,
    /// Whether a derivative can differ from 0, by result and argument.
    pub(crate) entries: Vec<Vec<bool>>,
}

/// A function that writes the results to `to` and the derivatives by x and u.
pub(crate) fn jacobian(listing: &Listing, nx: usize, nu: usize, to: &str) -> Jacobian {
    let tangents = nx + nu;
    let mut body = Body { text: String::new(), nx, tangents };
    let wanted = wanted(listing);
    let mut known: Vec<Vec<bool>> = Vec::new();
    for (i, instruction) in listing.instructions.iter().enumerate() {
        body.value(i, *instruction);
        known.push(match wanted[i] {
            true => body.tangents(i, *instruction, &known),
            false => vec![false; tangents],
        });
    }
    body.results(listing, to);
    let entries: Vec<_> = listing.results.iter().map(|&result| known[result].clone()).collect();
    for (row, &result) in listing.results.iter().enumerate() {
        for (t, _) in known[result].iter().enumerate().filter(|(_, there)| **there) {
            let _ = writeln!(body.text, "    f[{row}][{t}] = v{result}_{t};");
        }
    }
    if !entries.iter().flatten().any(|there| *there) {
        body.text += "    (void)f;\n";
    }
    Jacobian { body: body.finish(listing), entries }
}

/// Which values have tangents that a result depends on: none does through a sign or a condition, and
/// a compiler would warn of their variables.
fn wanted(listing: &Listing) -> Vec<bool> {
    let mut wanted = vec![false; listing.instructions.len()];
    for &result in &listing.results {
        wanted[result] = true;
    }
    for (i, instruction) in listing.instructions.iter().enumerate().rev() {
        let through = match *instruction {
            _ if !wanted[i] => continue,
            Instruction::Variable(_)
            | Instruction::Constant(_)
            | Instruction::Function(Function::Sign, _) => [None; 2],
            Instruction::Add(a, b)
            | Instruction::Sub(a, b)
            | Instruction::Mul(a, b)
            | Instruction::Div(a, b)
            | Instruction::Min(a, b)
            | Instruction::Max(a, b)
            | Instruction::Where(_, a, b) => [Some(a), Some(b)],
            Instruction::Neg(a) | Instruction::Power(a, _) | Instruction::Function(_, a) => {
                [Some(a), None]
            }
        };
        for operand in through.into_iter().flatten() {
            wanted[operand] = true;
        }
    }
    wanted
}

struct Body {
    text: String,
    nx: usize,
    tangents: usize,
}

impl Body {
    fn value(&mut self, i: usize, instruction: Instruction) {
        let text = self.expression(instruction, &|operand| format!("v{operand}"));
        let _ = writeln!(self.text, "    const PINC_REAL v{i} = {text};");
    }

    /// A value by its operands, which `v` names.
    fn expression(&self, instruction: Instruction, v: &dyn Fn(usize) -> String) -> String {
        match instruction {
            Instruction::Variable(index) => match index.checked_sub(self.nx) {
                None => format!("x[{index}]"),
                Some(input) => format!("u[{input}]"),
            },
            Instruction::Constant(value) => number(value),
            Instruction::Add(a, b) => format!("{} + {}", v(a), v(b)),
            Instruction::Sub(a, b) => format!("{} - {}", v(a), v(b)),
            Instruction::Mul(a, b) => format!("{} * {}", v(a), v(b)),
            Instruction::Div(a, b) => format!("{} / {}", v(a), v(b)),
            Instruction::Min(a, b) => smaller([&v(a), &v(b)], [&v(a), &v(b)]),
            Instruction::Max(a, b) => larger([&v(a), &v(b)], [&v(a), &v(b)]),
            Instruction::Where(a, b, c) => {
                format!("({} <= PINC_N(0)) ? {} : {}", v(a), v(b), v(c))
            }
            Instruction::Neg(a) => format!("-{}", v(a)),
            Instruction::Power(a, p) => format!("PINC_MATH(pow)({}, {})", v(a), number(p)),
            Instruction::Function(function, a) => call(function, &v(a)),
        }
    }

    /// Writes the tangents of value `i`; gives which are not 0.
    fn tangents(&mut self, i: usize, instruction: Instruction, known: &[Vec<bool>]) -> Vec<bool> {
        let varies = instruction.operands().any(|operand| known[operand].contains(&true));
        let slope = varies.then(|| self.slope(i, instruction)).flatten();
        let mut there = vec![false; self.tangents];
        for (t, there) in there.iter_mut().enumerate() {
            let of = |v: usize| known[v][t].then(|| format!("v{v}_{t}"));
            let or_zero = |part: Option<String>| part.unwrap_or_else(|| "PINC_N(0)".to_owned());
            let text = match instruction {
                Instruction::Variable(index) => (index == t).then(|| "PINC_N(1)".to_owned()),
                Instruction::Constant(_) => None,
                Instruction::Add(a, b) => joined(of(a), "+", of(b)),
                Instruction::Sub(a, b) => joined(of(a), "-", of(b)),
                Instruction::Mul(a, b) => joined(
                    of(a).map(|d| format!("({d} * v{b})")),
                    "+",
                    of(b).map(|d| format!("(v{a} * {d})")),
                ),
                Instruction::Div(a, b) => {
                    let part = of(b).map(|d| format!("(v{i} * {d})"));
                    joined(of(a), "-", part).map(|d| format!("({d}) / v{b}"))
                }
                Instruction::Min(a, b) | Instruction::Max(a, b) => {
                    let least = matches!(instruction, Instruction::Min(..));
                    let pick = if least { smaller } else { larger };
                    let any = known[a][t] || known[b][t];
                    let values = [&*format!("v{a}"), &format!("v{b}")];
                    any.then(|| pick(values, [&or_zero(of(a)), &or_zero(of(b))]))
                }
                Instruction::Where(a, b, c) => {
                    let (yes, no) = (or_zero(of(b)), or_zero(of(c)));
                    let any = known[b][t] || known[c][t];
                    any.then(|| format!("(v{a} <= PINC_N(0)) ? {yes} : {no}"))
                }
                Instruction::Neg(a) => of(a).map(|d| format!("-{d}")),
                Instruction::Power(a, _) | Instruction::Function(_, a) => {
                    let slope = slope.as_ref();
                    slope.and_then(|slope| of(a).map(|d| format!("{slope} * {d}")))
                }
            };
            if let Some(text) = text {
                let _ = writeln!(self.text, "    const PINC_REAL v{i}_{t} = {text};");
                *there = true;
            }
        }
        there
    }

    /// Writes the derivative of a function; gives its name, or none if it is 0 everywhere.
    fn slope(&mut self, i: usize, instruction: Instruction) -> Option<String> {
        let text = match instruction {
            Instruction::Power(a, p) => {
                let slope = format!("({} * PINC_MATH(pow)(v{a}, {}))", number(p), number(p - 1.0));
                // Infinite at 0, and counted as 0.
                match p < 1.0 {
                    true => format!(
                        "((v{a} <= PINC_N(0)) && (v{a} >= PINC_N(0))) ? PINC_N(0) : {slope}"
                    ),
                    false => slope,
                }
            }
            Instruction::Function(function, a) => match function {
                Function::Sqrt => {
                    format!("(v{i} <= PINC_N(0)) ? PINC_N(0) : (PINC_N(0.5) / v{i})")
                }
                Function::Exp => format!("v{i}"),
                Function::Log => format!("PINC_N(1) / v{a}"),
                Function::Sin => format!("PINC_MATH(cos)(v{a})"),
                Function::Cos => format!("-PINC_MATH(sin)(v{a})"),
                Function::Tan => format!("(v{i} * v{i}) + PINC_N(1)"),
                Function::Tanh => format!("PINC_N(1) - (v{i} * v{i})"),
                Function::Atan => format!("PINC_N(1) / ((v{a} * v{a}) + PINC_N(1))"),
                Function::Abs => sign(&format!("v{a}")),
                Function::Sign => return None,
            },
            _ => return None,
        };
        let _ = writeln!(self.text, "    const PINC_REAL s{i} = {text};");
        Some(format!("s{i}"))
    }

    fn results(&mut self, listing: &Listing, to: &str) {
        for (row, result) in listing.results.iter().enumerate() {
            let _ = writeln!(self.text, "    {to}[{row}] = v{result};");
        }
    }

    /// The body; what the equations do not depend on is named as unused.
    fn finish(mut self, listing: &Listing) -> String {
        let reads = |inputs: bool| {
            let mut all = listing.instructions.iter();
            all.any(|i| matches!(i, Instruction::Variable(v) if (*v >= self.nx) == inputs))
        };
        for (argument, used) in [("x", reads(false)), ("u", reads(true))] {
            if !used {
                let _ = writeln!(self.text, "    (void){argument};");
            }
        }
        self.text
    }
}

/// Refuses equations whose constants overflow; `what` names them.
pub(crate) fn check_constants(what: &str, listing: &Listing) -> Result<(), ExportError> {
    let constants = listing.instructions.iter().filter_map(|instruction| match instruction {
        Instruction::Constant(value) | Instruction::Power(_, value) => Some(value),
        _ => None,
    });
    finite(what, constants)
}

fn number(value: f64) -> String {
    format!("PINC_N({})", constant(value))
}

/// The sum or difference of two parts of which one may be 0.
fn joined(a: Option<String>, operator: &str, b: Option<String>) -> Option<String> {
    match (a, b) {
        (Some(a), Some(b)) => Some(format!("{a} {operator} {b}")),
        (Some(a), None) => Some(a),
        (None, Some(b)) if operator == "-" => Some(format!("-{b}")),
        (None, b) => b,
    }
}

/// The item of the smaller of two values; of equal ones, the second; NaN if one is.
fn smaller([a, b]: [&str; 2], [of_a, of_b]: [&str; 2]) -> String {
    format!("({b} <= {a}) ? {of_b} : (({a} <= {b}) ? {of_a} : ({of_a} + {of_b}))")
}

/// The item of the larger of two values, with the same rules.
fn larger([a, b]: [&str; 2], [of_a, of_b]: [&str; 2]) -> String {
    format!("({a} <= {b}) ? {of_b} : (({b} <= {a}) ? {of_a} : ({of_a} + {of_b}))")
}

fn sign(a: &str) -> String {
    format!("({a} > PINC_N(0)) ? PINC_N(1) : (({a} < PINC_N(0)) ? PINC_N(-1) : ({a} * PINC_N(0)))")
}

fn call(function: Function, a: &str) -> String {
    let name = match function {
        Function::Sqrt => "sqrt",
        Function::Exp => "exp",
        Function::Log => "log",
        Function::Sin => "sin",
        Function::Cos => "cos",
        Function::Tan => "tan",
        Function::Tanh => "tanh",
        Function::Atan => "atan",
        Function::Abs => "fabs",
        Function::Sign => return sign(a),
    };
    format!("PINC_MATH({name})({a})")
}
