//! Checks of equations before their expressions are read.

use crate::{Equations, ExpressionError, ExpressionProblem, Start, lexer, parser};
use pinc_ode::Variable;
use std::collections::{BTreeMap, BTreeSet};

impl Equations {
    pub(crate) fn check_names(&self) -> Result<(), ExpressionError> {
        let mut taken: BTreeMap<&str, String> = BTreeMap::new();
        let listed = |field: &'static str, variables: &[Variable]| {
            let keys = variables.iter().enumerate();
            keys.map(|(i, v)| (v.name.to_string(), format!("{field}[{i}]"))).collect::<Vec<_>>()
        };
        let (states, inputs) = (listed("states", &self.states), listed("inputs", &self.inputs));
        let parameters = self.parameters.keys().map(|n| (n.clone(), format!("parameters.{n}")));
        let intermediates = self.intermediates.keys().map(|n| (n.clone(), format!("let.{n}")));
        let outputs = self.outputs.keys().map(|n| (n.clone(), format!("outputs.{n}")));
        let unknowns = self.algebraic.keys().map(|n| (n.clone(), format!("algebraic.{n}")));
        let listed = states.into_iter().chain(inputs).chain(unknowns);
        let all: Vec<_> = listed.chain(parameters).chain(intermediates).chain(outputs).collect();
        for (name, key) in &all {
            if !lexer::is_valid_name(name) {
                return Err(ExpressionProblem::Name(name.clone()).at(key));
            }
            if let Some(meaning) = parser::reserved(name) {
                return Err(ExpressionProblem::Reserved { name: name.clone(), meaning }.at(key));
            }
            if let Some(first) = taken.insert(name, key.clone()) {
                return Err(ExpressionProblem::Duplicate { name: name.clone(), first }.at(key));
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
        let outputs = self.outputs.values().map(|output| &output.expression);
        let starts = self.algebraic.values().filter_map(|unknown| match &unknown.start {
            Some(Start::Expression(text)) => Some(text),
            _ => None,
        });
        let unknowns = self.algebraic.values().map(|unknown| &unknown.equation).chain(starts);
        let texts = self.derivatives.values().chain(self.intermediates.values());
        let texts = texts.chain(outputs).chain(unknowns);
        let mut used: BTreeSet<_> = texts.flat_map(|text| parser::names(text)).collect();
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
