//! The lock files of the packages beside the workspace, which are built with `--locked`.

use super::{CRATES, crate_manifest, dependencies, parsed, root};
use std::collections::BTreeSet;
use toml::Value;

/// Cargo refuses `--locked` where one of our crates has a dependency that a lock file does not list.
#[test]
fn lock_files_beside_the_workspace_list_what_our_crates_depend_on() {
    for folder in ["crates/pinc-py", "examples/own-plant", "fuzz"] {
        let lock = parsed(&root().join(folder).join("Cargo.lock"));
        let packages = lock["package"].as_array().unwrap();
        let ours = packages.iter().filter(|p| is_member(p["name"].as_str().unwrap()));
        let mut compared = 0;
        for package in ours {
            let name = package["name"].as_str().unwrap();
            let listed = listed(package);
            let manifest = crate_manifest(name);
            let all = dependencies(&manifest, "dependencies");
            let needed: BTreeSet<_> = all
                .iter()
                .copied()
                .filter(|dependency| !is_optional(&manifest["dependencies"][dependency]))
                .collect();
            let missing: Vec<_> = needed.difference(&listed).collect();
            assert!(missing.is_empty(), "{folder}/Cargo.lock: {name} needs {missing:?}");
            let left: Vec<_> = listed.difference(&all).collect();
            assert!(left.is_empty(), "{folder}/Cargo.lock: {name} does not need {left:?}");
            compared += 1;
        }
        assert!(compared > 5, "{folder}: only {compared} of our crates");
    }
}

fn is_member(name: &str) -> bool {
    CRATES.iter().any(|(member, _)| *member == name)
}

fn is_optional(dependency: &Value) -> bool {
    dependency.get("optional").and_then(Value::as_bool) == Some(true)
}

/// The names of a package's dependencies in a lock file, where a version may follow the name.
fn listed(package: &Value) -> BTreeSet<&str> {
    let list = package.get("dependencies").and_then(Value::as_array);
    let texts = list.into_iter().flatten().filter_map(Value::as_str);
    texts.filter_map(|text| text.split(' ').next()).collect()
}
