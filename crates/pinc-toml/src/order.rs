//! Lists whose order is that of a table's keys.

use crate::layers::Layers;
use crate::problem::{ConfigError, Problem};
use toml::Value;

impl Layers {
    /// Refuses the list `key` of different numbers, one per key of `table` in alphabetical order, if
    /// the file has the keys of the table in another order: the list may be meant in either. The
    /// elements `q[1]` and `q[2]` of an array are one key.
    ///
    /// # Errors
    ///
    /// [`ConfigError`], which gives the list as a table in the order of the file.
    pub fn in_order_of_keys(&self, key: &str, table: &str) -> Result<(), ConfigError> {
        let mut written = self.keys_as_written(table);
        written.iter_mut().for_each(|name| name.truncate(name.find('[').unwrap_or(name.len())));
        written.dedup();
        let mut keys = key.split('.');
        let first = keys.next().and_then(|key| self.table.get(key));
        let list = keys.fold(first, |value, key| value?.get(key));
        let Some(list) = list.and_then(Value::as_array) else { return Ok(()) };
        if written.is_sorted() || are_equal(list) {
            return Ok(());
        }
        // Lists of another length have numbers for elements of arrays, or for other keys too.
        let value = |i: usize| match list.len() == written.len() {
            true => list[i].to_string(),
            false => "..".to_owned(),
        };
        let entries = written.iter().enumerate().map(|(i, name)| format!("{name} = {}", value(i)));
        let by_name = entries.collect::<Vec<_>>().join(", ");
        written.sort();
        let order = written.join(", ");
        let expected = format!(
            "a table by name, as {{ {by_name} }} in the order of the file: the plant's is {order}"
        );
        let found = Value::Array(list.clone()).to_string();
        Err(self.error(key, Problem::Value { found, expected }))
    }
}

/// Whether all numbers of a list are equal.
fn are_equal(list: &[Value]) -> bool {
    let numbers = Value::Array(list.to_vec()).try_into::<Vec<f64>>();
    numbers.is_ok_and(|all| all.windows(2).all(|two| two[0].total_cmp(&two[1]).is_eq()))
}
