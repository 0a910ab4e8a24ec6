//! Arrays, written out: equations with `T[n]`, `T[i=2..n-1]` and sums become plain ones, in which
//! `T[3]` is a name like any other.

mod bases;
mod expand;
mod index;

pub(crate) use expand::LONGEST;
pub(crate) use index::{LARGEST, MOST};

use crate::error::{Excerpt, ExpressionError, ExpressionProblem};
use crate::lexer::Misplaced;
use crate::{AlgebraicVariable, Equations, OutputExpression, Start, parser};
use bases::check_bases;
use expand::{Names, expand};
use index::{Cursor, Indices};
use pinc_ode::Variable;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

/// Plain equations, and where they come from.
struct Unrolled<'a> {
    equations: Equations,
    names: Names<'a>,
    /// By the key of a plain equation or variable.
    sources: BTreeMap<String, Source<'a>>,
}

/// What an element was made of.
#[derive(Clone)]
struct Source<'a> {
    key: String,
    text: &'a str,
    indices: Indices<'a>,
}

/// An equation for one element, or for a variable that is no array.
struct Entry<'a, T> {
    name: String,
    source: Source<'a>,
    value: T,
}

/// A table of expressions, by the names of what they define.
type Table<'a, T> = Vec<(&'a str, &'a str, T)>;

impl Equations {
    /// Calls `then` with the same equations without arrays; what it finds wrong is said of these.
    pub(crate) fn unrolled<T>(
        &self,
        then: impl FnOnce(&Self) -> Result<T, ExpressionError>,
    ) -> Result<T, ExpressionError> {
        self.unrolled_with([], |plain, []| then(plain))
    }

    /// [`Equations::unrolled`] with further expressions, at their keys.
    pub(crate) fn unrolled_with<T, const N: usize>(
        &self,
        texts: [(&'static str, &str); N],
        then: impl FnOnce(&Self, [&str; N]) -> Result<T, ExpressionError>,
    ) -> Result<T, ExpressionError> {
        let written_out = self.with_nets_written_out()?;
        written_out.unrolled_arrays_with(texts, then).map_err(|error| self.explain_nets(error))
    }

    fn unrolled_arrays_with<T, const N: usize>(
        &self,
        texts: [(&'static str, &str); N],
        then: impl FnOnce(&Self, [&str; N]) -> Result<T, ExpressionError>,
    ) -> Result<T, ExpressionError> {
        if !self.has_arrays() && !texts.iter().any(|(_, text)| text.contains('[')) {
            return then(self, texts.map(|(_, text)| text));
        }
        let mut unrolled = Unrolled::new(self)?;
        let mut plain = Vec::new();
        for (key, text) in texts {
            let source = Source { key: key.to_owned(), text, indices: Indices::new(&self.sizes) };
            let expanded = expand(text, &unrolled.names, &mut source.indices.clone());
            plain.push(expanded.map_err(|problem| source.error(problem))?.text);
            unrolled.sources.insert(key.to_owned(), source);
        }
        let plain = std::array::from_fn(|i| plain[i].as_str());
        then(&unrolled.equations, plain).map_err(|error| unrolled.explain(error))
    }

    /// The states, the inputs, and the outputs that are no states, each element of an array by
    /// itself.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with the arrays; other equations are not looked at.
    pub fn variables(&self) -> Result<[Vec<Variable>; 3], ExpressionError> {
        self.unrolled(|plain| {
            Ok([plain.states.clone(), plain.inputs.clone(), plain.output_variables()])
        })
    }

    /// The array and the indices that a name such as `T[3]`, `T[n]` or `T[2..n-1]` is of, with the
    /// sizes of these equations; `None` for another text.
    #[must_use]
    pub fn indices<'a>(&self, name: &'a str) -> Option<(&'a str, RangeInclusive<usize>)> {
        let (mut cursor, sizes) = (Cursor::new(name), Indices::new(&self.sizes));
        let (array, _) = cursor.name().filter(|_| cursor.accept("["))?;
        let range = match cursor.clone().range(&sizes) {
            Ok(_) => cursor.range(&sizes).ok()?,
            Err(_) => cursor.index(&sizes).map(|index| index..=index).ok()?,
        };
        (cursor.accept("]") && cursor.is_at_end()).then_some((array, range))
    }

    fn has_arrays(&self) -> bool {
        let names = self.named().into_iter().map(|named| named.name);
        let names = names.chain(self.derivatives.keys().map(String::as_str));
        !self.sizes.is_empty() || names.chain(self.texts()).any(|text| text.contains(['[', '=']))
    }
}

impl<'a> Unrolled<'a> {
    fn new(of: &'a Equations) -> Result<Self, ExpressionError> {
        let (parameters, time_unit) = (of.parameters.clone(), of.time_unit);
        let plain = Equations { parameters, time_unit, ..Equations::default() };
        let (names, sources) = (Names::default(), BTreeMap::new());
        let mut unrolled = Self { equations: plain, names, sources };
        check_bases(of)?;
        let sizes = Indices::new(&of.sizes);
        unrolled.equations.states = unrolled.declare("states", &of.states, &sizes)?;
        unrolled.equations.inputs = unrolled.declare("inputs", &of.inputs, &sizes)?;
        for name in of.parameters.keys() {
            unrolled.add_name(name);
        }
        let texts = |table: &'a BTreeMap<String, String>| -> Table<'a, ()> {
            table.iter().map(|(name, text)| (name.as_str(), text.as_str(), ())).collect()
        };
        let lets = unrolled.entries("let", texts(&of.intermediates), &sizes)?;
        let derivatives = unrolled.entries("derivatives", texts(&of.derivatives), &sizes)?;
        let outputs = of.outputs.iter().map(|(name, y)| (name.as_str(), &*y.expression, &y.unit));
        let outputs = unrolled.entries("outputs", outputs.collect(), &sizes)?;
        let unknowns = of.algebraic.iter().map(|(name, z)| (name.as_str(), &*z.equation, z));
        let unknowns = unrolled.entries("algebraic", unknowns.collect(), &sizes)?;
        unrolled.names.scalars.extend(of.sizes.keys().map(String::as_str));
        let mut length = 0;
        for (name, text, ()) in unrolled.write_out("let", lets, &mut length)? {
            unrolled.equations.intermediates.insert(name, text);
        }
        for (name, text, ()) in unrolled.write_out("derivatives", derivatives, &mut length)? {
            unrolled.equations.derivatives.insert(name, text);
        }
        for (name, expression, unit) in unrolled.write_out("outputs", outputs, &mut length)? {
            let output = OutputExpression { expression, unit: unit.clone() };
            unrolled.equations.outputs.insert(name, output);
        }
        unrolled.write_out_algebraic(unknowns, &mut length)?;
        unrolled.forget_unused_elements();
        Ok(unrolled)
    }

    fn write_out_algebraic(
        &mut self,
        unknowns: Vec<Entry<'a, &'a AlgebraicVariable>>,
        length: &mut usize,
    ) -> Result<(), ExpressionError> {
        let starts = unknowns.iter().filter_map(|Entry { name, source, value }| {
            let Some(Start::Expression(text)) = &value.start else { return None };
            let key = format!("{}.start", source.key);
            let source = Source { key, text, indices: source.indices.clone() };
            Some(Entry { name: format!("{name}.start"), source, value: name.clone() })
        });
        let starts = starts.collect();
        for (name, equation, unknown) in self.write_out("algebraic", unknowns, length)? {
            let unknown = AlgebraicVariable { equation, ..unknown.clone() };
            self.equations.algebraic.insert(name, unknown);
        }
        for (_, text, name) in self.write_out("algebraic", starts, length)? {
            if let Some(unknown) = self.equations.algebraic.get_mut(&name) {
                unknown.start = Some(Start::Expression(text));
            }
        }
        Ok(())
    }

    fn add_name(&mut self, name: &'a str) {
        match Variable::split_name(name) {
            Some((array, index)) => {
                self.names.arrays.entry(array).or_default().insert(index);
            }
            None => {
                self.names.scalars.insert(name);
            }
        }
    }

    /// States or inputs: `T[n]` has the elements 1 to n.
    fn declare(
        &mut self,
        field: &'static str,
        variables: &'a [Variable],
        sizes: &Indices<'a>,
    ) -> Result<Vec<Variable>, ExpressionError> {
        let mut all = Vec::new();
        for (i, variable) in variables.iter().enumerate() {
            let (key, text) = (format!("{field}[{i}]"), variable.name.as_ref());
            let source = Source { key, text, indices: sizes.clone() };
            let mut cursor = Cursor::new(text);
            let name = cursor.name().map(|(name, _)| name);
            let (Some(name), true) = (name, cursor.accept("[")) else {
                self.names.scalars.insert(text);
                self.sources.insert(format!("{field}[{}]", all.len()), source);
                all.push(variable.clone());
                continue;
            };
            let size = cursor.index(sizes).and_then(|size| {
                let closed = cursor.accept("]") && cursor.is_at_end();
                if closed { Ok(size) } else { Err(cursor.unexpected("`]` and the end")) }
            });
            let size = size.map_err(|problem| source.error(problem))?;
            if size == 0 {
                return Err(ExpressionProblem::Size(size).at(source.key));
            }
            if all.len() + size > MOST {
                return Err(ExpressionProblem::TooMany.at(source.key));
            }
            self.names.arrays.insert(name, (1..=size).collect());
            for element in 1..=size {
                self.sources.insert(format!("{field}[{}]", all.len()), source.clone());
                let name = format!("{name}[{element}]").into();
                all.push(Variable { name, unit: variable.unit.clone() });
            }
        }
        Ok(all)
    }

    /// The elements that the keys of a table name, each once.
    fn entries<T: Copy>(
        &mut self,
        field: &'static str,
        table: Table<'a, T>,
        sizes: &Indices<'a>,
    ) -> Result<Vec<Entry<'a, T>>, ExpressionError> {
        let mut entries = Vec::new();
        let mut given: BTreeMap<String, String> = BTreeMap::new();
        for (key, text, value) in table {
            let whole = format!("{field}.{key}");
            let found = Key::parse(key, sizes).and_then(|parsed| {
                let is_declared = field == "derivatives";
                let values = parsed.values(&self.names, sizes, is_declared)?;
                Ok((parsed, values))
            });
            let source = Source { key: whole.clone(), text: key, indices: sizes.clone() };
            let (parsed, values) = found.map_err(|problem| source.error(problem))?;
            if entries.len() + values.len() > MOST {
                return Err(ExpressionProblem::TooMany.at(source.key));
            }
            for index in values {
                let (array, name) = (parsed.array, parsed.element(index));
                if let Some(first) = given.insert(name.clone(), whole.clone()) {
                    return Err(ExpressionProblem::Duplicate { name, first }.at(whole));
                }
                if field != "derivatives" {
                    match index {
                        Some(i) => {
                            self.names.arrays.entry(array).or_default().insert(i);
                        }
                        None => {
                            self.names.scalars.insert(array);
                        }
                    }
                }
                let mut indices = sizes.clone();
                indices.bound.extend(parsed.bound.zip(index));
                let source = Source { key: whole.clone(), text, indices };
                entries.push(Entry { name, source, value });
            }
        }
        Ok(entries)
    }

    /// The entries with their expressions written out.
    fn write_out<T>(
        &mut self,
        field: &'static str,
        entries: Vec<Entry<'a, T>>,
        length: &mut usize,
    ) -> Result<Vec<(String, String, T)>, ExpressionError> {
        let mut all = Vec::with_capacity(entries.len());
        for Entry { name, source, value } in entries {
            let bound = source.indices.bound.iter().map(|(index, _)| *index);
            if let Some(taken) = { bound }.find(|index| !self.is_free(index, &source)) {
                return Err(ExpressionProblem::IndexTaken(taken.to_owned()).at(source.key));
            }
            let expanded = expand(source.text, &self.names, &mut source.indices.clone());
            let text = expanded.map_err(|problem| source.error(problem))?.text;
            *length += text.len();
            if *length > LONGEST {
                return Err(ExpressionProblem::TooLong.at(source.key));
            }
            self.sources.insert(format!("{field}.{name}"), source);
            all.push((name, text, value));
        }
        Ok(all)
    }

    fn is_free(&self, index: &str, source: &Source<'_>) -> bool {
        self.names.is_free(index, &Indices::new(source.indices.sizes))
    }

    /// Drops elements of parameters that no expression has, if it has others of the same array.
    fn forget_unused_elements(&mut self) {
        let mut parameters = std::mem::take(&mut self.equations.parameters);
        let used: BTreeSet<&str> = self.equations.texts().flat_map(parser::names).collect();
        let array = |name: &str| Variable::split_name(name).map(|(array, _)| array.to_owned());
        let arrays: BTreeSet<_> = used.iter().filter_map(|name| array(name)).collect();
        parameters.retain(|name, _| {
            used.contains(name.as_str()) || !array(name).is_some_and(|a| arrays.contains(&a))
        });
        self.equations.parameters = parameters;
    }

    /// An error about plain equations as one about those that they come from.
    fn explain(&self, mut error: ExpressionError) -> ExpressionError {
        if let ExpressionProblem::UnknownName { known, .. }
        | ExpressionProblem::UnknownState { known, .. }
        | ExpressionProblem::UnknownParameter { known, .. } = &mut error.problem
        {
            in_order(known);
            *known = Variable::grouped_names(known);
        }
        let Some(source) = self.sources.get(&error.key) else { return error };
        let place = |excerpt: Excerpt| {
            let again = expand(source.text, &self.names, &mut source.indices.clone()).ok()?;
            Some(Excerpt { text: source.text.to_owned(), bytes: again.origin(&excerpt.bytes) })
        };
        ExpressionError {
            key: source.key.clone(),
            text: error.text.and_then(place),
            problem: source.indices.at(error.problem),
        }
    }
}

impl Source<'_> {
    fn error(&self, (bytes, problem): Misplaced) -> ExpressionError {
        let text = Some(Excerpt { text: self.text.to_owned(), bytes });
        ExpressionError { key: self.key.clone(), text, problem }
    }
}

/// The key of an equation: `q`, `q[1]`, `q[n]`, `q[i=2..n-1]`, and for the derivatives of a whole
/// array `T[i]`.
struct Key<'a> {
    array: &'a str,
    /// The index in the equation's text.
    bound: Option<&'a str>,
    /// Whether it runs over all elements.
    is_whole: bool,
    /// The place behind the bracket and the index.
    rest: Option<Cursor<'a>>,
}

impl<'a> Key<'a> {
    fn parse(key: &'a str, sizes: &Indices<'_>) -> Result<Self, Misplaced> {
        let mut cursor = Cursor::new(key);
        let Some((array, _)) = cursor.name() else {
            let problem = ExpressionProblem::Name(key.to_owned());
            return Err((0..key.len(), problem));
        };
        if cursor.is_at_end() {
            return Ok(Self { array, bound: None, is_whole: false, rest: None });
        }
        if !cursor.accept("[") {
            return Err((0..key.len(), ExpressionProblem::Name(key.to_owned())));
        }
        let bound = cursor.bound_name().map(|(name, _)| name);
        let mut ahead = cursor.clone();
        let alone = ahead.name().map(|(name, _)| name);
        let alone = alone.filter(|_| ahead.accept("]") && ahead.is_at_end());
        let whole = alone.filter(|name| bound.is_none() && sizes.value(name).is_none());
        Ok(Self { array, bound: bound.or(whole), is_whole: whole.is_some(), rest: Some(cursor) })
    }

    /// The indices of the elements that are meant; one `None` for what is no array.
    fn values(
        &self,
        names: &Names<'_>,
        sizes: &Indices<'_>,
        is_declared: bool,
    ) -> Result<Vec<Option<usize>>, Misplaced> {
        let Some(mut cursor) = self.rest.clone() else {
            if is_declared && names.arrays.contains_key(self.array) {
                let problem = ExpressionProblem::WholeArray(self.array.to_owned());
                return Err((0..self.array.len(), problem));
            }
            return Ok(vec![None]);
        };
        let start = cursor.at;
        if self.is_whole {
            return match names.arrays.get(self.array).filter(|_| is_declared) {
                Some(elements) => Ok(elements.iter().copied().map(Some).collect()),
                // The key of no state: this is found later.
                None if is_declared => Ok(vec![Some(1)]),
                None => {
                    let index = self.bound.unwrap_or_default();
                    let example = format!("{}[{index}=1..n]", self.array);
                    Err((start..cursor.text.len() - 1, ExpressionProblem::NoRange(example)))
                }
            };
        }
        let values: Vec<usize> = match self.bound {
            Some(_) => cursor.range(sizes)?.collect(),
            None => vec![cursor.index(sizes)?],
        };
        if !cursor.accept("]") || !cursor.is_at_end() {
            return Err(cursor.unexpected("`]` and the end"));
        }
        if is_declared {
            for &index in &values {
                // An array that is no state is found later.
                if names.arrays.contains_key(self.array) {
                    let element = names.element(self.array, index);
                    element.map_err(|problem| (start..cursor.at, problem))?;
                }
            }
        }
        Ok(values.into_iter().map(Some).collect())
    }

    fn element(&self, index: Option<usize>) -> String {
        index.map_or_else(|| self.array.to_owned(), |index| format!("{}[{index}]", self.array))
    }
}

/// Sorts names, the elements of an array by their indices.
fn in_order(names: &mut [String]) {
    names.sort_by(|a, b| place(a).cmp(&place(b)));
}

/// What names are sorted by.
pub(crate) fn place(name: &str) -> (&str, usize) {
    Variable::split_name(name).unwrap_or((name, 0))
}
