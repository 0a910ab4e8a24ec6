//! The invariants of the architecture: who depends on whom, who may print, open files or read a
//! clock, where `unsafe` is, how long files are. Several are about what is absent.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Our crates with the ones of ours that each may depend on, from the bottom up.
const CRATES: [(&str, &[&str]); 5] = [
    ("pinc-ad", &[]),
    ("pinc-ode", &["pinc-ad"]),
    ("pinc-net", &["pinc-ad", "pinc-ode"]),
    ("pinc-mpc", &["pinc-ad", "pinc-ode"]),
    ("pinc-bench", &["pinc-ad", "pinc-mpc", "pinc-net", "pinc-ode"]),
];

/// The crates that do arithmetic only.
const LIBRARIES: [&str; 4] = ["pinc-ad", "pinc-ode", "pinc-net", "pinc-mpc"];

/// Files longer than this are listed; a file that passes it wants to be split.
const LONG: usize = 400;
/// No file is longer than this.
const LONGEST: usize = 600;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the tests have a parent folder")
        .to_path_buf()
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn manifest(folder: &str) -> Table {
    let path = root().join(folder).join("Cargo.toml");
    let parsed = read(&path).parse();
    parsed.unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn crate_manifest(name: &str) -> Table {
    manifest(&format!("crates/{name}"))
}

fn table<'t>(manifest: &'t Table, key: &str) -> Option<&'t Table> {
    manifest.get(key).and_then(Value::as_table)
}

/// The names in a table of dependencies.
fn dependencies<'t>(manifest: &'t Table, key: &str) -> BTreeSet<&'t str> {
    let names = table(manifest, key).into_iter().flat_map(Table::keys);
    names.map(String::as_str).collect()
}

fn of_ours(names: BTreeSet<&str>) -> BTreeSet<&str> {
    names.into_iter().filter(|name| name.starts_with("pinc-")).collect()
}

/// All Rust files below `folder`, sorted.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) => panic!("{}: {error}", folder.display()),
    };
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.expect("a readable folder").path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// The sources of a crate, as (path from the root, text).
fn sources(name: &str) -> Vec<(PathBuf, String)> {
    let files = rust_files(&root().join("crates").join(name).join("src"));
    assert!(!files.is_empty(), "{name} has no sources");
    let relative = |path: &PathBuf| path.strip_prefix(root()).map(Path::to_path_buf);
    let relative = |path: PathBuf| (relative(&path).expect("below the root"), read(&path));
    files.into_iter().map(relative).collect()
}

/// What is compiled into the crate: without comments, and without the module of tests at the end.
fn code(text: &str) -> String {
    let lines = text.lines().take_while(|line| line.trim() != "#[cfg(test)]");
    let code = lines.map(|line| line.split("//").next().unwrap_or_default());
    code.collect::<Vec<_>>().join("\n")
}

/// The identifiers and numbers of some code, in order.
fn words(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty())
}

/// What only the binary's crate may use.
const FOR_THE_BINARY: [&str; 15] = [
    "print",
    "println",
    "eprint",
    "eprintln",
    "dbg",
    "stdout",
    "stderr",
    "stdin", // printing
    "fs",
    "File",
    "OpenOptions",
    "env",
    "process", // the world outside
    "Instant",
    "SystemTime", // clocks
];

fn forbidden(code: &str) -> Vec<&str> {
    words(code).filter(|word| FOR_THE_BINARY.contains(word)).collect()
}

#[test]
fn members_are_the_five_crates_and_the_tests() {
    let root = manifest(".");
    let members = table(&root, "workspace").and_then(|w| w.get("members")?.as_array()).unwrap();
    let found: BTreeSet<_> = members.iter().filter_map(Value::as_str).collect();
    let crates = CRATES.map(|(name, _)| format!("crates/{name}"));
    let expected = crates.iter().map(String::as_str).chain(["tests"]).collect();
    assert_eq!(found, expected);
    let folders = fs::read_dir(self::root().join("crates")).unwrap();
    assert_eq!(folders.count(), CRATES.len(), "a folder in crates/ that is no member");
}

#[test]
fn dependencies_point_down() {
    for (name, allowed) in CRATES {
        let manifest = crate_manifest(name);
        let ours = of_ours(dependencies(&manifest, "dependencies"));
        assert_eq!(ours, allowed.iter().copied().collect(), "{name}");
        for other in ["build-dependencies", "target"] {
            assert!(of_ours(dependencies(&manifest, other)).is_empty(), "{name}: {other}");
        }
    }
}

/// Tests of a crate may use what lies below it in [`CRATES`], never what lies above.
#[test]
fn dependencies_of_tests_point_down_too() {
    for (level, (name, _)) in CRATES.iter().enumerate() {
        let below: BTreeSet<_> = CRATES[..level].iter().map(|(name, _)| *name).collect();
        let manifest = crate_manifest(name);
        let ours = of_ours(dependencies(&manifest, "dev-dependencies"));
        assert!(ours.is_subset(&below), "{name}: {ours:?}");
    }
}

#[test]
fn pinc_ad_depends_on_nothing() {
    let manifest = crate_manifest("pinc-ad");
    assert!(dependencies(&manifest, "dependencies").is_empty());
    assert!(!manifest.contains_key("build-dependencies") && !manifest.contains_key("target"));
}

/// Not even in its tests: PINC and RK4 enter by one trait.
#[test]
fn pinc_mpc_does_not_know_what_a_net_is() {
    let manifest = crate_manifest("pinc-mpc");
    for key in ["dependencies", "dev-dependencies"] {
        assert!(!dependencies(&manifest, key).contains("pinc-net"), "{key}");
    }
    for (path, text) in sources("pinc-mpc") {
        let code = code(&text);
        let net = words(&code).find(|word| word.contains("Pinc") || *word == "pinc_net");
        assert_eq!(net, None, "{}", path.display());
    }
}

#[test]
fn members_inherit_from_the_workspace() {
    let inherited =
        |value: Option<&Value>| value.and_then(|v| v.get("workspace")?.as_bool()) == Some(true);
    let folders = CRATES.map(|(name, _)| format!("crates/{name}"));
    for folder in folders.iter().map(String::as_str).chain(["tests"]) {
        let manifest = manifest(folder);
        assert!(inherited(manifest.get("lints")), "{folder}: lints");
        let package = table(&manifest, "package").unwrap();
        for key in ["version", "edition", "rust-version", "license"] {
            assert!(inherited(package.get(key)), "{folder}: {key}");
        }
        assert!(package.contains_key("description"), "{folder}: description");
        for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
            for (name, dependency) in table(&manifest, kind).into_iter().flatten() {
                assert!(inherited(Some(dependency)), "{folder}: {name}");
            }
        }
    }
}

#[test]
fn versions_are_stated_once_and_without_wildcards() {
    let root = manifest(".");
    let workspace = table(&root, "workspace").unwrap();
    for (name, dependency) in table(workspace, "dependencies").unwrap() {
        let version = dependency.as_str().or_else(|| dependency.get("version")?.as_str());
        let version = version.unwrap_or_else(|| panic!("{name} has no version"));
        assert!(!version.contains('*'), "{name}: {version}");
        assert_eq!(name.starts_with("pinc-"), dependency.get("path").is_some(), "{name}");
    }
    let package = table(workspace, "package").unwrap();
    assert_eq!(package["license"].as_str(), Some("MIT OR Apache-2.0"));
    for file in ["Cargo.lock", "LICENSE-MIT", "LICENSE-APACHE"] {
        assert!(self::root().join(file).is_file(), "{file}");
    }
}

#[test]
fn only_the_binary_prints_opens_files_or_reads_a_clock() {
    for name in LIBRARIES {
        for (path, text) in sources(name) {
            let code = code(&text);
            assert_eq!(forbidden(&code), [""; 0], "{}", path.display());
        }
    }
}

/// The check above can fail, and does not take comments and tests for code.
#[test]
fn the_scan_finds_what_it_looks_for() {
    let found = |text: &str| forbidden(&code(text)).join(" ");
    assert_eq!(found("let t = std::time::Instant::now();"), "Instant");
    assert_eq!(found("    println!(\"{x}\");\nstd::fs::read(p)"), "println fs");
    assert_eq!(found("use std::fs::File; File::open(p)"), "fs File File");
    assert_eq!(found("//! println!\n/// File\nlet instantly = 1; // fs"), "");
    assert_eq!(found("fn f() {}\n#[cfg(test)]\nmod tests { println!() }"), "");
    assert_eq!(found("fingerprint(x); offset; Profile"), "");
}

/// Whether a file is the module of vector intrinsics, or part of it.
fn is_simd(path: &Path) -> bool {
    path.starts_with("crates/pinc-ad/src/simd")
}

#[test]
fn unsafe_code_is_in_the_simd_module_only() {
    let mut used = false;
    for (path, text) in CRATES.iter().flat_map(|(name, _)| sources(name)) {
        let code = code(&text);
        let found = words(&code).any(|word| word == "unsafe");
        assert!(!found || is_simd(&path), "{}", path.display());
        used |= found;
    }
    assert!(used, "the scan finds no unsafe code where there is some");
    assert!(is_simd(Path::new("crates/pinc-ad/src/simd/mod.rs")));
    assert!(is_simd(Path::new("crates/pinc-ad/src/simd/avx.rs")));
    assert!(!is_simd(Path::new("crates/pinc-ad/src/simdlike.rs")));
    assert!(!is_simd(Path::new("crates/pinc-net/src/simd/mod.rs")));
}

/// `#[allow]` goes stale unnoticed and needs no reason; `#[expect]` does not, and gives one.
#[test]
fn exceptions_from_lints_are_expected_and_explained() {
    for (path, text) in CRATES.iter().flat_map(|(name, _)| sources(name)) {
        for attribute in text.split("#[").skip(1).chain(text.split("#![").skip(1)) {
            let attribute = attribute.split(']').next().unwrap_or_default();
            assert!(!attribute.starts_with("allow("), "{}: {attribute}", path.display());
            let explained = !attribute.starts_with("expect(") || attribute.contains("reason = ");
            assert!(explained, "{}: {attribute}", path.display());
        }
    }
}

#[test]
fn files_are_readable_in_one_sitting() {
    let mut files = rust_files(&root().join("crates"));
    files.extend(rust_files(&root().join("tests")));
    assert!(files.len() > 20, "only {} files found", files.len());
    let mut too_long = Vec::new();
    for path in files {
        let lines = read(&path).lines().count();
        if lines > LONG {
            println!("{lines} lines: {}", path.display());
        }
        if lines > LONGEST {
            too_long.push((path, lines));
        }
    }
    assert!(too_long.is_empty(), "over {LONGEST} lines: {too_long:?}");
}

/// An example that no test includes is not run; one that the guide does not list is not found.
#[test]
fn every_example_is_run_by_a_test_and_listed_in_the_guide() {
    let guide = read(&root().join("docs/guide.md"));
    for (name, _) in CRATES {
        let folder = root().join("crates").join(name);
        let places = ["tests/suite/examples.rs", "tests/examples.rs"].map(|file| folder.join(file));
        let tests = read(places.iter().find(|path| path.exists()).expect("a test of the examples"));
        let examples = rust_files(&folder.join("examples"));
        assert!(examples.len() >= 2, "{name}: {examples:?}");
        for (number, path) in (1..).zip(examples) {
            let file = path.file_name().expect("a file").to_string_lossy().into_owned();
            assert!(file.starts_with(&format!("{number:02}_")), "{name}: {file}");
            assert!(tests.contains(&format!("../examples/{file}\"")), "{name}: {file}");
            assert!(guide.contains(&format!("crates/{name}/examples/{file})")), "{name}: {file}");
        }
    }
}
