//! The names before the brackets, and the sizes.

use super::index::LARGEST;
use crate::Equations;
use crate::checks::{Named, check_name};
use crate::error::{ExpressionError, ExpressionProblem};
use std::collections::BTreeMap;

/// Checks the names before the brackets, and the sizes.
pub(super) fn check_bases(of: &Equations) -> Result<(), ExpressionError> {
    for (name, &size) in &of.sizes {
        if !(1..=LARGEST).contains(&size) {
            return Err(ExpressionProblem::Size(size).at(format!("sizes.{name}")));
        }
    }
    let mut taken: BTreeMap<&str, (&'static str, bool, String)> = BTreeMap::new();
    for Named { name, field, key } in of.named() {
        let (base, is_array) = match name.split_once('[') {
            Some((base, _)) => (base.trim(), true),
            None => (name, false),
        };
        check_name(base).map_err(|problem| problem.at(&key))?;
        let has_elements_with_keys = is_array && !matches!(field, "states" | "inputs");
        if let Some((other, was_array, first)) = taken.get(base) {
            if *other != field || !was_array || !has_elements_with_keys {
                let (name, first) = (base.to_owned(), first.clone());
                return Err(ExpressionProblem::Duplicate { name, first }.at(key));
            }
        } else {
            taken.insert(base, (field, is_array, key));
        }
    }
    Ok(())
}
