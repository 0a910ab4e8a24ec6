//! Makes the docstrings of the stub file those of the module, so that `help()` shows what editors show:
//! writes the macro `doc!`, which gives the docstring of a class, method or function by its name.

use std::{env, fs, path::Path};

/// The stub file: below the crate, or beside it in a source distribution.
const STUBS: [&str; 2] = ["python/pinc_nmpc/_native.pyi", "../python/pinc_nmpc/_native.pyi"];

fn main() {
    let stubs = STUBS.iter().find(|path| Path::new(path).exists()).expect("the stub file");
    // In full, since files of source distributions have times that say nothing.
    let path = fs::canonicalize(stubs).expect("the stub file");
    println!("cargo::rerun-if-changed={}", path.display());
    let text = fs::read_to_string(stubs).expect("the stub file is text");
    let (mut class, mut name, mut arms) = (String::new(), String::new(), String::new());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let rest = line.trim_start();
        let indent = line.len() - rest.len();
        let named = |rest: &str| rest.split(['(', ':']).next().unwrap_or_default().to_owned();
        if let Some(rest) = rest.strip_prefix("class ") {
            class = named(rest);
            name.clone_from(&class);
        } else if let Some(rest) = rest.strip_prefix("def ") {
            name = if indent > 0 { format!("{class}.{}", named(rest)) } else { named(rest) };
        } else if let Some(first) = rest.strip_prefix("\"\"\"") {
            let mut doc = first.to_owned();
            while !doc.ends_with("\"\"\"") {
                let line = lines.next().expect("the end of a docstring");
                doc += "\n";
                doc += line.get(indent..).unwrap_or_default();
            }
            let doc = doc.trim_end_matches('"').trim_end();
            arms += &format!("    ({name:?}) => {{ {doc:?} }};\n");
        }
    }
    let out = env::var_os("OUT_DIR").expect("cargo sets it");
    let macros = format!("macro_rules! doc {{\n{arms}}}\n");
    fs::write(Path::new(&out).join("docs.rs"), macros).expect("the build directory is writable");
}
