//! Tells the program what it was built from and with, for the provenance of results.

use std::env;
use std::process::Command;

fn main() {
    let rustc = env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let version = output(&rustc, &["--version"]).unwrap_or_else(|| "unknown".to_owned());
    set("PINC_RUSTC", &version);
    set("PINC_TARGET", &env::var("TARGET").unwrap_or_default());
    set("PINC_PROFILE", &env::var("PROFILE").unwrap_or_default());

    // Every source file of the workspace, so that the commit and its state belong to the build.
    let watched = ["build.rs", "../../Cargo.lock", "../pinc-config/presets"];
    let mut watched: Vec<String> = watched.map(str::to_owned).to_vec();
    let crates = std::fs::read_dir("..").into_iter().flatten().flatten();
    watched.extend(crates.map(|entry| entry.path().join("src").to_string_lossy().into_owned()));
    if let Some(commit) = output("git", &["rev-parse", "HEAD"]) {
        set("PINC_GIT_COMMIT", &commit);
        let state = ["status", "--porcelain", "--", "..", "../../Cargo.lock"];
        let dirty = output("git", &state).is_none_or(|changes| !changes.is_empty());
        set("PINC_GIT_DIRTY", if dirty { "true" } else { "false" });
        watched.extend(output("git", &["rev-parse", "--git-path", "logs/HEAD"]));
    }
    for path in watched.iter().filter(|path| std::path::Path::new(path).exists()) {
        put(&format!("cargo::rerun-if-changed={path}"));
    }
}

/// What a command says, if it can be run and succeeds.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn set(name: &str, value: &str) {
    put(&format!("cargo::rustc-env={name}={value}"));
}

/// Hands a line to Cargo.
fn put(line: &str) {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").expect("cargo reads what a build script writes");
}
