//! The invariants of the architecture: who depends on whom, who may print, open files or read a
//! clock, where `unsafe` is, how long files are. Several are about what is absent.

mod code;
mod locks;

use code::{code, files_of_tests, rust_files, words};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Our crates with the ones of ours that each depends on, from the bottom up.
const CRATES: [(&str, &[&str]); 31] = [
    ("pinc-ad", &[]),
    ("pinc-qp", &["pinc-ad"]),
    ("pinc-chart", &[]),
    ("pinc-ode", &["pinc-ad"]),
    ("pinc-expr", &["pinc-ad", "pinc-ode"]),
    ("pinc-plants", &["pinc-ad", "pinc-expr", "pinc-ode"]),
    ("pinc-analysis", &["pinc-ode"]),
    ("pinc-net", &["pinc-ad", "pinc-ode"]),
    ("pinc-tube", &["pinc-ode"]),
    ("pinc-mpc", &["pinc-ad", "pinc-ode", "pinc-qp", "pinc-tube"]),
    ("pinc-loop", &["pinc-mpc", "pinc-ode"]),
    ("pinc-sensitivity", &["pinc-mpc", "pinc-ode", "pinc-qp"]),
    ("pinc-batch", &["pinc-loop", "pinc-mpc", "pinc-ode", "pinc-sensitivity"]),
    ("pinc-estimate", &["pinc-loop", "pinc-mpc", "pinc-ode", "pinc-qp"]),
    ("pinc-identify", &["pinc-estimate", "pinc-ode"]),
    ("pinc-integer", &["pinc-mpc"]),
    ("pinc-economic", &["pinc-mpc", "pinc-ode"]),
    ("pinc-verify", &["pinc-ad", "pinc-expr", "pinc-net", "pinc-ode"]),
    (
        "pinc-export",
        &[
            "pinc-estimate",
            "pinc-expr",
            "pinc-mpc",
            "pinc-net",
            "pinc-ode",
            "pinc-tube",
            "pinc-verify",
        ],
    ),
    (
        "pinc-shrink",
        &[
            "pinc-ad",
            "pinc-batch",
            "pinc-export",
            "pinc-mpc",
            "pinc-net",
            "pinc-ode",
            "pinc-sensitivity",
        ],
    ),
    ("pinc-external", &["pinc-ad", "pinc-ode"]),
    ("pinc-toml", &["pinc-expr", "pinc-ode"]),
    (
        "pinc-config",
        &[
            "pinc-estimate",
            "pinc-expr",
            "pinc-external",
            "pinc-mpc",
            "pinc-net",
            "pinc-ode",
            "pinc-plants",
            "pinc-toml",
            "pinc-tube",
        ],
    ),
    ("pinc-record", &["pinc-config", "pinc-loop", "pinc-mpc", "pinc-net"]),
    (
        "pinc-check",
        &[
            "pinc-ad",
            "pinc-analysis",
            "pinc-config",
            "pinc-estimate",
            "pinc-expr",
            "pinc-mpc",
            "pinc-net",
            "pinc-ode",
            "pinc-record",
            "pinc-tube",
            "pinc-verify",
        ],
    ),
    ("pinc-choose", &["pinc-config", "pinc-net", "pinc-ode", "pinc-record"]),
    (
        "pinc-report",
        &["pinc-chart", "pinc-config", "pinc-mpc", "pinc-net", "pinc-ode", "pinc-record"],
    ),
    (
        "pinc-runs",
        &[
            "pinc-ad",
            "pinc-batch",
            "pinc-check",
            "pinc-config",
            "pinc-economic",
            "pinc-estimate",
            "pinc-export",
            "pinc-expr",
            "pinc-identify",
            "pinc-integer",
            "pinc-loop",
            "pinc-mpc",
            "pinc-net",
            "pinc-ode",
            "pinc-record",
            "pinc-report",
            "pinc-sensitivity",
            "pinc-shrink",
            "pinc-tube",
            "pinc-verify",
        ],
    ),
    (
        "pinc-bench",
        &[
            "pinc-choose",
            "pinc-config",
            "pinc-mpc",
            "pinc-net",
            "pinc-ode",
            "pinc-record",
            "pinc-runs",
            "pinc-shrink",
        ],
    ),
    ("pinc-serve", &["pinc-config", "pinc-mpc", "pinc-ode", "pinc-record", "pinc-runs"]),
    (
        "pinc",
        &[
            "pinc-ad",
            "pinc-analysis",
            "pinc-batch",
            "pinc-bench",
            "pinc-chart",
            "pinc-config",
            "pinc-estimate",
            "pinc-export",
            "pinc-expr",
            "pinc-identify",
            "pinc-loop",
            "pinc-mpc",
            "pinc-net",
            "pinc-ode",
            "pinc-plants",
            "pinc-qp",
            "pinc-record",
            "pinc-report",
            "pinc-runs",
            "pinc-sensitivity",
            "pinc-serve",
            "pinc-verify",
        ],
    ),
];

/// The Python package, which is no member of the workspace, with the crates that it depends on.
/// None depends on it.
const BINDINGS: (&str, &[&str]) = (
    "pinc-py",
    &[
        "pinc-batch",
        "pinc-bench",
        "pinc-config",
        "pinc-estimate",
        "pinc-export",
        "pinc-mpc",
        "pinc-net",
        "pinc-ode",
        "pinc-qp",
        "pinc-record",
        "pinc-runs",
        "pinc-sensitivity",
    ],
);

/// The program's crates, the only ones that print, read clocks and look at their surroundings.
const PROGRAM: [&str; 3] = ["pinc-runs", "pinc-bench", "pinc"];

/// What pinc-external may do besides: it starts processes and talks with them, and asks for which
/// system it was built.
const OF_PROCESSES: [&str; 4] = ["process", "stdin", "stdout", "env"];

/// The crates that read and write files, besides the program's.
const WITH_FILES: [&str; 4] = ["pinc-external", "pinc-config", "pinc-record", "pinc-report"];

/// The crates with examples, each of which a user may want by itself.
const WITH_EXAMPLES: [&str; 7] =
    ["pinc-ad", "pinc-ode", "pinc-net", "pinc-mpc", "pinc-estimate", "pinc-identify", "pinc"];

/// No crate has more lines in its sources, files of tests left out.
const LARGEST: usize = 8000;

/// Crates that have more: the parts of one iteration read each other's numbers.
const LARGER: [(&str, usize); 1] = [("pinc-mpc", 8500)];

/// Files longer than this are listed; a file that passes it wants to be split.
const LONG: usize = 400;
/// No file is longer than this.
const LONGEST: usize = 600;

/// All crates by their names, with the Python package.
fn all_crates() -> impl Iterator<Item = &'static str> {
    CRATES.into_iter().map(|(name, _)| name).chain([BINDINGS.0])
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the tests have a parent folder")
        .to_path_buf()
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn parsed(path: &Path) -> Table {
    read(path).parse().unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn manifest(folder: &str) -> Table {
    parsed(&root().join(folder).join("Cargo.toml"))
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
    names.into_iter().filter(|name| name.starts_with("pinc")).collect()
}

/// The sources of a crate, as (path from the root, text).
fn sources(name: &str) -> Vec<(PathBuf, String)> {
    let files = rust_files(&root().join("crates").join(name).join("src"));
    assert!(!files.is_empty(), "{name} has no sources");
    let relative = |path: &PathBuf| path.strip_prefix(root()).map(Path::to_path_buf);
    let relative = |path: PathBuf| (relative(&path).expect("below the root"), read(&path));
    files.into_iter().map(relative).collect()
}

/// The sources of a crate that are compiled into it: without the files that are test modules.
fn compiled(name: &str) -> Vec<(PathBuf, String)> {
    let sources = sources(name);
    let tests: BTreeSet<PathBuf> =
        sources.iter().flat_map(|(path, text)| files_of_tests(path, text)).collect();
    let is_test =
        |path: &Path| path.ancestors().any(|part| tests.contains(&part.with_extension("")));
    sources.into_iter().filter(|(path, _)| !is_test(path)).collect()
}

/// What prints, reads a clock or looks at the world outside.
const FOR_THE_PROGRAM: [&str; 12] = [
    "print",
    "println",
    "eprint",
    "eprintln",
    "dbg",
    "stdout",
    "stderr",
    "stdin",
    "env",
    "process",
    "Instant",
    "SystemTime",
];

/// What reads or writes files.
const FILES: [&str; 3] = ["fs", "File", "OpenOptions"];

/// The words in some code of what a crate must not use.
fn forbidden<'c>(code: &'c str, name: &str) -> Vec<&'c str> {
    let opens_files = WITH_FILES.contains(&name);
    let starts_processes = name == "pinc-external";
    let is_forbidden = |word: &&str| {
        let of_processes = starts_processes && OF_PROCESSES.contains(word);
        FOR_THE_PROGRAM.contains(word) && !of_processes || (FILES.contains(word) && !opens_files)
    };
    words(code).filter(is_forbidden).collect()
}

#[test]
fn members_are_the_crates_and_the_tests() {
    let root = manifest(".");
    let members = table(&root, "workspace").and_then(|w| w.get("members")?.as_array()).unwrap();
    let found: BTreeSet<_> = members.iter().filter_map(Value::as_str).collect();
    let crates = CRATES.map(|(name, _)| format!("crates/{name}"));
    let expected = crates.iter().map(String::as_str).chain(["tests"]).collect();
    assert_eq!(found, expected);
    let folders = fs::read_dir(self::root().join("crates")).unwrap();
    assert_eq!(folders.count(), all_crates().count(), "a folder in crates/ that is no member");
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

/// The crates whose tests need plants or closed loops, which lie above them. They have them by path
/// alone, which no release sees.
const TESTED_WITH: [(&str, &[&str]); 3] = [
    ("pinc-ode", &["pinc-expr", "pinc-plants"]),
    ("pinc-expr", &["pinc-plants"]),
    ("pinc-mpc", &["pinc-loop"]),
];

/// Tests of a crate may use what lies below it in [`CRATES`], never what lies above, except in
/// [`TESTED_WITH`].
#[test]
fn dependencies_of_tests_point_down_too() {
    for (level, (name, _)) in CRATES.iter().enumerate() {
        let mut allowed: BTreeSet<_> = CRATES[..level].iter().map(|(name, _)| *name).collect();
        let manifest = crate_manifest(name);
        for (_, above) in TESTED_WITH.iter().filter(|(of, _)| of == name) {
            for &plants in *above {
                let dependency = table(&manifest, "dev-dependencies").and_then(|d| d.get(plants));
                let keys = dependency.and_then(Value::as_table).map(|d| d.keys().collect());
                assert_eq!(keys.unwrap_or(vec![]), ["path"], "{name}: {plants}");
                allowed.insert(plants);
            }
        }
        let ours = of_ours(dependencies(&manifest, "dev-dependencies"));
        assert!(ours.is_subset(&allowed), "{name}: {ours:?}");
    }
}

/// It builds by itself, is the only crate that knows Python, and keeps the rules of the others.
#[test]
fn the_python_package_is_beside_the_workspace() {
    let (name, uses) = BINDINGS;
    let (bindings, root) = (crate_manifest(name), manifest("."));
    let workspace = table(&root, "workspace").unwrap();
    let excluded = workspace["exclude"].as_array().unwrap();
    assert!(excluded.contains(&Value::from(format!("crates/{name}"))), "{excluded:?}");
    assert!(bindings.contains_key("workspace"));
    let ours = of_ours(dependencies(&bindings, "dependencies"));
    assert_eq!(ours, uses.iter().copied().collect());
    for dependency in ours {
        let path = bindings["dependencies"][dependency].get("path").and_then(Value::as_str);
        assert_eq!(path, Some(&*format!("../{dependency}")));
    }
    assert!(!bindings.contains_key("dev-dependencies"), "its tests are in Python");
    for key in ["version", "edition", "rust-version", "license"] {
        assert_eq!(bindings["package"][key], workspace["package"][key], "{key}");
    }
    assert_eq!(bindings["lints"], workspace["lints"]);
    for (member, _) in CRATES {
        let manifest = crate_manifest(member);
        for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let known = dependencies(&manifest, kind);
            assert!(!known.contains("pyo3") && !known.contains(name), "{member}: {kind}");
        }
    }
}

/// Both are compiled into one target directory: what they have in common, once.
#[test]
fn the_program_with_its_own_plant_is_compiled_as_the_workspace_is() {
    let folder = "examples/own-plant";
    let [own, workspace] = [folder, "."].map(|folder| manifest(folder)["profile"]["dev"].clone());
    let lock = parsed(&root().join(folder).join("Cargo.lock"));
    let packages = lock["package"].as_array().unwrap();
    let known: BTreeSet<_> =
        packages.iter().filter_map(|package| package["name"].as_str()).collect();
    let mut expected = workspace.as_table().unwrap().clone();
    let levels = expected["package"].as_table_mut().unwrap();
    levels.retain(|name, _| name == "*" || known.contains(name));
    assert_eq!(own.as_table(), Some(&expected));
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
    for (path, text) in compiled("pinc-mpc") {
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
                let with_plants =
                    TESTED_WITH.iter().any(|(of, _)| folder == format!("crates/{of}"));
                let by_path = with_plants && kind == "dev-dependencies";
                let by_path = by_path && dependency.get("path").is_some();
                assert!(inherited(Some(dependency)) || by_path, "{folder}: {name}");
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
        assert_eq!(name.starts_with("pinc"), dependency.get("path").is_some(), "{name}");
    }
    let package = table(workspace, "package").unwrap();
    assert_eq!(package["license"].as_str(), Some("MIT OR Apache-2.0"));
    for file in ["Cargo.lock", "LICENSE-MIT", "LICENSE-APACHE"] {
        assert!(self::root().join(file).is_file(), "{file}");
    }
}

#[test]
fn only_the_program_prints_or_reads_a_clock_and_few_crates_open_files() {
    for name in all_crates().filter(|name| !PROGRAM.contains(name)) {
        for (path, text) in compiled(name) {
            // The environment of the build is none of the program's.
            let code = code(&text).replace("env!", "");
            assert_eq!(forbidden(&code, name), [""; 0], "{}", path.display());
        }
    }
}

/// The check above can fail, and does not take comments, texts and tests for code.
#[test]
fn the_scan_finds_what_it_looks_for() {
    let found = |text: &str| forbidden(&code(text), "pinc-net").join(" ");
    assert_eq!(found("let t = std::time::Instant::now();"), "Instant");
    assert_eq!(found("    println!(\"{x}\");\nstd::fs::read(p)"), "println fs");
    assert_eq!(found("use std::fs::File; File::open(p)"), "fs File File");
    assert_eq!(found("//! println!\n/// File\nlet instantly = 1; // fs"), "");
    assert_eq!(
        found("f(\"a \\\" File\", r#\"fs \" fs\"#, '\"', b'\\'', 'f'); /* fs */ env"),
        "env"
    );
    assert_eq!(found("fn f<'a>(x: &'a str) { fs } // '"), "fs");
    assert_eq!(found("fingerprint(x); offset; Profile"), "");
    // What follows on a test module or item is code again.
    let tests = "fn f() {}\n#[cfg(test)]\nmod tests { fn g() { println!(\"}\") } }\n";
    assert_eq!(found(tests), "");
    assert_eq!(found(&format!("{tests}fn h() {{ dbg!(1) }}")), "dbg");
    assert_eq!(found("#[cfg(test)]\n#[allow(x)]\nuse std::fs::{File};\nuse std::env;"), "env");
    // Only the crates that may open files do, and these print nothing either.
    assert_eq!(forbidden("fs println", "pinc-record"), ["println"]);
    // A test module in a file of its own.
    let declared = "mod a;\n#[cfg(test)]\nmod tests;\nmod b;";
    assert_eq!(files_of_tests(Path::new("x/mod.rs"), declared), [Path::new("x/tests")]);
    assert_eq!(files_of_tests(Path::new("x/y.rs"), declared), [Path::new("x/y/tests")]);
    let no_tests = compiled("pinc-report").iter().all(|(path, _)| !path.ends_with("tests.rs"));
    assert!(no_tests && sources("pinc-report").len() > compiled("pinc-report").len());
}

/// Whether a file is the module of vector intrinsics, or part of it.
fn is_simd(path: &Path) -> bool {
    path.starts_with("crates/pinc-ad/src/simd")
}

/// Whether a file is the one that calls functions of FMUs.
fn is_loader(path: &Path) -> bool {
    path == Path::new("crates/pinc-external/src/fmu/library.rs")
}

#[test]
fn unsafe_code_is_in_the_simd_module_and_the_loader_only() {
    let mut used = false;
    for (path, text) in all_crates().flat_map(sources) {
        let code = code(&text);
        let found = words(&code).any(|word| word == "unsafe");
        assert!(!found || is_simd(&path) || is_loader(&path), "{}", path.display());
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
    for (path, text) in all_crates().flat_map(sources) {
        for attribute in text.split("#[").skip(1).chain(text.split("#![").skip(1)) {
            let attribute = attribute.split(']').next().unwrap_or_default();
            assert!(!attribute.starts_with("allow("), "{}: {attribute}", path.display());
            let explained = !attribute.starts_with("expect(") || attribute.contains("reason = ");
            assert!(explained, "{}: {attribute}", path.display());
        }
    }
}

#[test]
fn crates_are_small() {
    for name in all_crates() {
        let is_test = |path: &Path| {
            path.components().any(|part| part.as_os_str() == "tests") || path.ends_with("tests.rs")
        };
        let own = sources(name).into_iter().filter(|(path, _)| !is_test(path));
        let lines: usize = own.map(|(_, text)| text.lines().count()).sum();
        let own = LARGER.iter().find(|(larger, _)| *larger == name);
        let most = own.map_or(LARGEST, |(_, most)| *most);
        assert!(lines <= most, "{name}: {lines} lines, at most {most}");
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

/// An example that no test includes is not run; one that no page lists is not found.
#[test]
fn every_example_is_run_by_a_test_and_listed_in_the_guide() {
    let page = read(&root().join("docs/examples.md"));
    for (name, _) in CRATES {
        if !WITH_EXAMPLES.contains(&name) {
            assert!(!root().join("crates").join(name).join("examples").exists(), "{name}");
            continue;
        }
        let folder = root().join("crates").join(name);
        let places = ["tests/suite/examples.rs", "tests/examples.rs"].map(|file| folder.join(file));
        let tests = read(places.iter().find(|path| path.exists()).expect("a test of the examples"));
        let examples = rust_files(&folder.join("examples"));
        assert!(examples.len() >= 2, "{name}: {examples:?}");
        for (number, path) in (1..).zip(examples) {
            let file = path.file_name().expect("a file").to_string_lossy().into_owned();
            assert!(file.starts_with(&format!("{number:02}_")), "{name}: {file}");
            assert!(tests.contains(&format!("../examples/{file}\"")), "{name}: {file}");
            assert!(page.contains(&format!("crates/{name}/examples/{file})")), "{name}: {file}");
        }
    }
}
