//! A controller outside the program, which gets the inputs of a loop's controller: generated C, and
//! a process.

use crate::closed::Closed;
use crate::common::{Outcome, outcome, pinc};
use pinc_config::ModelKind;
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// Reads what is measured, step by step, takes the reference by time, and writes the input, the
/// estimate if there is one, and the status.
const DRIVER: &str = r#"
#include HEADER
#include <stdio.h>
static CONTROLLER m;
static int read(double *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        if (scanf("%lf", &to[i]) != 1) {
            return 0;
        }
    }
    return 1;
}
int main(void)
{
    double y[TOLD], reference[LOOP_N2 * LOOP_NY], u[LOOP_NU];
    int k;
    INIT(&m);
    for (k = 0; read(y, TOLD); k++) {
        loop_status status;
        int i;
        loop_reference(LOOP_SAMPLE_TIME_S * k, reference);
        status = STEP(&m, y, reference, u);
        for (i = 0; i < LOOP_NU; i++) {
            printf("%.17g ", u[i]);
        }
        printf("| ");
#ifdef ESTIMATES
        for (i = 0; i < LOOP_NZ; i++) {
            printf("%.17g ", m.estimator.z[i]);
        }
#endif
        printf("%s\n", loop_status_name(status));
    }
    return 0;
}
"#;

/// Compiles all C files of a directory but those that end in one of `without`.
#[track_caller]
pub(crate) fn compile(dir: &Path, without: &str) {
    let names = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name());
    let names = names.filter_map(|name| name.into_string().ok());
    let sources = names.filter(|name| name.ends_with(".c") && !name.ends_with(without));
    let mut command = Command::new("cc");
    command.args(["-std=c99", "-O0"]).args(sources).args(["-lm", "-o", "program"]);
    let ended = outcome(command.current_dir(dir));
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

/// What the program in `dir` writes, line by line, for this input.
pub(crate) fn drive(dir: &Path, input: String) -> Vec<String> {
    let mut command = Command::new(dir.join("program"));
    let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut child = child.unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || {
        stdin.write_all(input.as_bytes()).unwrap();
    });
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

/// What a controller answers in a step.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) u: Vec<f64>,
    pub(crate) status: String,
    /// States and unknowns, if there is an estimator.
    pub(crate) estimate: Vec<f64>,
}

/// A controller in C, compiled with a program that asks it.
#[derive(Debug)]
pub(crate) struct Exported {
    dir: PathBuf,
}

impl Exported {
    /// The controller of `config`, in `dir`, with its estimator if the loop has one; what the
    /// program says if it cannot be exported.
    pub(crate) fn of(
        dir: &Path,
        config: &Path,
        kind: ModelKind,
        more: &[&str],
        estimates: bool,
    ) -> Result<Self, Outcome> {
        let mut command = pinc(&["export", "--to", "c", "--name", "loop", "--out", "c", "--only"]);
        let ended = outcome(command.arg(kind.name()).arg(config).args(more).current_dir(dir));
        if ended.code != Some(0) {
            return Err(ended);
        }
        let dir = dir.join("c");
        let (name, told, more) = match estimates {
            true => ("feedback", "NM", "#define ESTIMATES\n"),
            false => ("mpc", "NX", ""),
        };
        let defines = format!(
            "#define HEADER \"loop_{name}.h\"\n#define CONTROLLER loop_{name}\n\
             #define INIT loop_{name}_init\n#define STEP loop_{name}_step\n\
             #define TOLD LOOP_{told}\n{more}"
        );
        fs::write(dir.join("driver.c"), defines + DRIVER).unwrap();
        compile(&dir, "_selftest.c");
        Ok(Self { dir })
    }

    /// What it answers to these measurements, step by step.
    pub(crate) fn answers(&self, told: &[Vec<f64>]) -> Vec<Answer> {
        let mut input = String::new();
        for v in told.concat() {
            input += &format!("{v:?}\n");
        }
        let numbers = |text: &str| -> Vec<f64> {
            text.split_whitespace().map(|v| v.parse().unwrap()).collect()
        };
        let answer = |line: String| {
            let (u, rest) = line.split_once(" | ").unwrap();
            let (estimate, status) = rest.rsplit_once(' ').unwrap_or(("", rest));
            Answer { u: numbers(u), status: status.to_owned(), estimate: numbers(estimate) }
        };
        drive(&self.dir, input).into_iter().map(answer).collect()
    }
}

/// Checks that the answers of `way` are the inputs of the loop, to `allowed` of 1 + |u|.
#[track_caller]
pub(crate) fn assert_same(way: &str, closed: &Closed, answers: &[Answer], allowed: f64) {
    assert_eq!(answers.len(), closed.steps.len(), "{way}");
    for (k, answer) in answers.iter().enumerate() {
        // The input that acts `delay` steps later.
        let Some(inputs) = closed.inputs.get(k + closed.spec.delay_steps) else { continue };
        assert_eq!(answer.u.len(), inputs.len());
        for (found, expected) in answer.u.iter().zip(inputs) {
            let off = (found - expected).abs() / (1.0 + expected.abs());
            assert!(off < allowed, "{way}, step {k}: {found} {expected}");
        }
    }
}

/// A server, line by line.
pub(crate) struct Served {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Served {
    pub(crate) fn new(config: &Path, more: &[&str]) -> Self {
        Self::of(config, ModelKind::RK4, more)
    }

    /// What the program says if it does not serve the controller of `config`.
    pub(crate) fn refusal(config: &Path, kind: ModelKind, more: &[&str]) -> Option<Outcome> {
        let mut command = pinc(&["serve", "--only", kind.name()]);
        let ended = outcome(command.arg(config).args(more).stdin(Stdio::null()));
        (ended.code != Some(0)).then_some(ended)
    }

    /// The controller of `config` with one of its models.
    pub(crate) fn of(config: &Path, kind: ModelKind, more: &[&str]) -> Self {
        let mut command = pinc(&["serve", "--only", kind.name()]);
        command.arg(config).args(more).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        Self { child, input, output: BufReader::new(output) }
    }

    pub(crate) fn ask(&mut self, request: &Value) -> Value {
        writeln!(self.input, "{request}").unwrap();
        let mut answer = String::new();
        self.output.read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap()
    }

    /// What it answers to these measurements, step by step, each with the values of the parameters
    /// that are measured.
    pub(crate) fn answers(&mut self, told: &[Vec<f64>], parameters: &[Vec<f64>]) -> Vec<Answer> {
        let mut answer = |(k, y): (usize, &Vec<f64>)| {
            let mut request = json!({ "y": y });
            if let Some(parameters) = parameters.get(k) {
                request["parameters"] = json!(parameters);
            }
            let answer = self.ask(&request);
            let numbers = |key: &str| -> Vec<f64> {
                let values = answer[key].as_array().into_iter().flatten();
                values.map(|v| v.as_f64().unwrap()).collect()
            };
            let status = answer["status"].as_str().unwrap_or_else(|| panic!("{answer}"));
            Answer { u: numbers("u"), status: status.to_owned(), estimate: Vec::new() }
        };
        told.iter().enumerate().map(&mut answer).collect()
    }

    /// Ends the input; the program ends by itself.
    pub(crate) fn end(self) {
        let Self { mut child, input, .. } = self;
        drop(input);
        assert!(child.wait().unwrap().success());
    }
}
