//! Checks of equations before their expressions are read.

use crate::{Equations, ExpressionError, ExpressionProblem, Start, lexer, parser};
use pinc_ode::Variable;
use std::collections::{BTreeMap, BTreeSet};

/// Something that equations name.
pub(crate) struct Named<'a> {
    pub(crate) name: &'a str,
    /// The table or list that it is in.
    pub(crate) field: &'static str,
    pub(crate) key: String,
}

/// Checks that something may be called `name`.
pub(crate) fn check_name(name: &str) -> Result<(), ExpressionProblem> {
    if !lexer::is_valid_name(name) {
        return Err(ExpressionProblem::Name(name.to_owned()));
    }
    match parser::reserved(name) {
        Some(meaning) => Err(ExpressionProblem::Reserved { name: name.to_owned(), meaning }),
        None => Ok(()),
    }
}

impl Equations {
    /// All that is named; the derivatives have the names of states.
    pub(crate) fn named(&self) -> Vec<Named<'_>> {
        fn listed<'a>(
            field: &'static str,
            variables: &'a [Variable],
        ) -> impl Iterator<Item = Named<'a>> {
            let named = move |(i, variable): (usize, &'a Variable)| Named {
                name: &variable.name,
                field,
                key: format!("{field}[{i}]"),
            };
            variables.iter().enumerate().map(named)
        }
        fn keyed<'a, T>(
            field: &'static str,
            table: &'a BTreeMap<String, T>,
        ) -> impl Iterator<Item = Named<'a>> {
            table.keys().map(move |name| Named { name, field, key: format!("{field}.{name}") })
        }
        let variables = listed("states", &self.states).chain(listed("inputs", &self.inputs));
        let numbers = keyed("sizes", &self.sizes).chain(keyed("algebraic", &self.algebraic));
        let numbers = numbers.chain(keyed("parameters", &self.parameters));
        let values = keyed("let", &self.intermediates).chain(keyed("outputs", &self.outputs));
        variables.chain(numbers).chain(values).collect()
    }

    /// All expressions but those of nets.
    pub(crate) fn texts(&self) -> impl Iterator<Item = &str> {
        let outputs = self.outputs.values().map(|output| &output.expression);
        let starts = self.algebraic.values().filter_map(|unknown| match &unknown.start {
            Some(Start::Expression(text)) => Some(text),
            Some(Start::Number(_)) | None => None,
        });
        let unknowns = self.algebraic.values().map(|unknown| &unknown.equation).chain(starts);
        let texts = self.derivatives.values().chain(self.intermediates.values());
        texts.chain(outputs).chain(unknowns).map(String::as_str)
    }

    pub(crate) fn check_names(&self) -> Result<(), ExpressionError> {
        let mut taken: BTreeMap<&str, String> = BTreeMap::new();
        for Named { name, key, .. } in self.named() {
            check_name(name).map_err(|problem| problem.at(&key))?;
            if let Some(first) = taken.insert(name, key.clone()) {
                return Err(ExpressionProblem::Duplicate { name: name.to_owned(), first }.at(key));
            }
        }
        for (name, &value) in &self.parameters {
            if !value.is_finite() {
                return Err(ExpressionProblem::NotFinite(value).at(format!("parameters.{name}")));
            }
        }
        Ok(())
    }

    pub(crate) fn check_states_have_derivatives(&self) -> Result<(), ExpressionError> {
        for (field, variables) in [("states", &self.states), ("inputs", &self.inputs)] {
            if variables.is_empty() {
                return Err(ExpressionProblem::Empty.at(field));
            }
        }
        let known: Vec<_> = self.states.iter().map(|state| state.name.to_string()).collect();
        if let Some(name) = self.derivatives.keys().find(|name| !known.contains(name)) {
            let problem = ExpressionProblem::UnknownState { found: name.clone(), known };
            return Err(problem.at(format!("derivatives.{name}")));
        }
        match known.into_iter().find(|name| !self.derivatives.contains_key(name)) {
            Some(name) => {
                let key = format!("derivatives.{name}");
                Err(ExpressionProblem::MissingDerivative(name).at(key))
            }
            None => Ok(()),
        }
    }

    /// Of these equations without arrays; `others` may have some.
    pub(crate) fn check_parameters_are_used(&self, others: &[&str]) -> Result<(), ExpressionError> {
        let mut used: BTreeSet<_> = self.texts().flat_map(parser::names).collect();
        let no_name = |c: char| !(c.is_alphanumeric() || c == '_');
        used.extend(others.iter().flat_map(|text| text.split(no_name)));
        let is_used = |name: &str| {
            used.contains(name) || name.split('[').next().is_some_and(|array| used.contains(array))
        };
        match self.parameters.keys().find(|name| !is_used(name)) {
            Some(name) => Err(ExpressionProblem::UnusedParameter.at(format!("parameters.{name}"))),
            None => Ok(()),
        }
    }

    /// Checks the names of parameters that are to vary.
    pub(crate) fn check_varying(&self, varying: &[&str]) -> Result<(), ExpressionError> {
        for (i, &name) in varying.iter().enumerate() {
            let key = format!("varying[{i}]");
            if !self.parameters.contains_key(name) {
                let known = self.parameters.keys().cloned().collect();
                let found = name.to_owned();
                return Err(ExpressionProblem::UnknownParameter { found, known }.at(key));
            }
            if let Some(first) = varying[..i].iter().position(|other| *other == name) {
                let first = format!("varying[{first}]");
                let name = name.to_owned();
                return Err(ExpressionProblem::Duplicate { name, first }.at(key));
            }
        }
        Ok(())
    }

    /// The intermediate expressions in an order in which each comes after those that it needs: a
    /// depth-first search, on a list and not by recursion, so that none is too long.
    pub(crate) fn order(&self) -> Result<Vec<&str>, ExpressionError> {
        let needs = |name: &str| {
            let names = parser::names(&self.intermediates[name]);
            names.filter_map(|name| self.intermediates.get_key_value(name))
        };
        let mut order = Vec::new();
        let mut done = BTreeSet::new();
        for start in self.intermediates.keys() {
            if done.contains(start) {
                continue;
            }
            let mut path = vec![(start, needs(start))];
            while let Some((name, needed)) = path.last_mut() {
                match needed.find(|(next, _)| !done.contains(next)) {
                    Some((next, _)) => {
                        if let Some(first) = path.iter().position(|(name, _)| *name == next) {
                            let mut cycle: Vec<_> =
                                path[first..].iter().map(|(name, _)| (*name).clone()).collect();
                            cycle.push(next.clone());
                            return Err(ExpressionProblem::Cycle(cycle).at(format!("let.{next}")));
                        }
                        path.push((next, needs(next)));
                    }
                    None => {
                        order.push(name.as_str());
                        done.insert(*name);
                        path.pop();
                    }
                }
            }
        }
        Ok(order)
    }
}
