//! The names before the brackets, and the sizes.

use super::index::LARGEST;
use crate::error::{ExpressionError, ExpressionProblem};
use crate::{Equations, lexer, parser};
use pinc_ode::Variable;
use std::collections::BTreeMap;

/// Checks the names before the brackets, and the sizes.
pub(super) fn check_bases(of: &Equations) -> Result<(), ExpressionError> {
    for (name, &size) in &of.sizes {
        if !(1..=LARGEST).contains(&size) {
            return Err(ExpressionProblem::Size(size).at(format!("sizes.{name}")));
        }
    }
    let listed = |field: &'static str, variables: &'_ [Variable]| {
        let keys = variables.iter().enumerate();
        keys.map(|(i, v)| (v.name.to_string(), field, format!("{field}[{i}]"))).collect::<Vec<_>>()
    };
    let keyed = |field: &'static str, names: Vec<&String>| {
        let names = names.into_iter();
        names.map(|name| (name.clone(), field, format!("{field}.{name}"))).collect::<Vec<_>>()
    };
    let all = [
        listed("states", &of.states),
        listed("inputs", &of.inputs),
        keyed("sizes", of.sizes.keys().collect()),
        keyed("parameters", of.parameters.keys().collect()),
        keyed("let", of.intermediates.keys().collect()),
        keyed("outputs", of.outputs.keys().collect()),
        keyed("algebraic", of.algebraic.keys().collect()),
    ];
    let mut taken: BTreeMap<String, (&'static str, bool, String)> = BTreeMap::new();
    for (name, field, key) in all.into_iter().flatten() {
        let (base, is_array) = match name.split_once('[') {
            Some((base, _)) => (base.trim(), true),
            None => (name.as_str(), false),
        };
        if !lexer::is_valid_name(base) {
            return Err(ExpressionProblem::Name(base.to_owned()).at(key));
        }
        if let Some(meaning) = parser::reserved(base) {
            return Err(ExpressionProblem::Reserved { name: base.to_owned(), meaning }.at(key));
        }
        let has_elements_with_keys = is_array && !matches!(field, "states" | "inputs");
        if let Some((other, was_array, first)) = taken.get(base) {
            if *other != field || !was_array || !has_elements_with_keys {
                let (name, first) = (base.to_owned(), first.clone());
                return Err(ExpressionProblem::Duplicate { name, first }.at(key));
            }
        } else {
            taken.insert(base.to_owned(), (field, is_array, key));
        }
    }
    Ok(())
}
