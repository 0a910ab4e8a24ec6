//! Random texts and bytes in place of a user's files: they are read, or refused with a message;
//! nothing panics. A text is one of the shipped files with some changes at random.
//!
//! As many as `PINC_RANDOM_CASES` says are tried, from the seed `PINC_RANDOM_SEED` on, each for at
//! most `PINC_RANDOM_HANGS_S`; a long run is described in `docs/testing.md`.

use crate::common::repository;
use pinc_ad::Dual;
use pinc_config::{Experiment, OutsidePolicy, Plants};
use pinc_expr::Equations;
use pinc_net::PincNet;
use pinc_ode::{Plant, Variable};
use pinc_runs::{Options, RunError, Verbosity};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// Cases of a test if nothing else is asked for.
const CASES: u64 = 200;
/// Seconds after which a case hangs if nothing else is asked for: many, for machines with other
/// work.
const HANGS_S: u64 = 40;

/// What is put into files: ends of ranges, and words that mean something.
const WORDS: [&str; 36] = [
    "0",
    "-1",
    "1",
    "1e308",
    "-1e308",
    "1e-308",
    "5e-324",
    "nan",
    "inf",
    "-inf",
    "0.5",
    "1e12",
    "2.5",
    "9223372036854775807",
    "-9223372036854775808",
    "4294967296",
    "1000000",
    "\"",
    "[",
    "]",
    "{",
    "}",
    "=",
    ",",
    "\n",
    "(",
    ")",
    "sqrt(",
    "^",
    "*",
    "/",
    "max(x, ",
    "\"pinc\"",
    "true",
    "é",
    "\0",
];

/// Changes of texts at random.
struct Changes<'a> {
    rng: ChaCha8Rng,
    seeds: &'a [Vec<u8>],
}

impl Changes<'_> {
    fn below(&mut self, end: usize) -> usize {
        self.rng.random_range(0..end.max(1))
    }

    /// One of the seeds with a few changes.
    fn case(&mut self) -> Vec<u8> {
        let mut text = self.seeds[self.below(self.seeds.len())].clone();
        for _ in 0..=self.below(6) {
            self.change(&mut text);
        }
        text
    }

    fn change(&mut self, text: &mut Vec<u8>) {
        let at = self.below(text.len() + 1);
        let end = (at + self.below(20)).min(text.len());
        match self.below(8) {
            0 => drop(text.drain(at..end)),
            1 => {
                let copy = text[at..end].to_vec();
                for _ in 0..=self.below(50) {
                    text.splice(at..at, copy.iter().copied());
                }
            }
            2 => {
                let word = WORDS[self.below(WORDS.len())];
                text.splice(at..at, word.bytes());
            }
            // A number or a word in place of another.
            3..=5 => {
                let is_part = |b: &u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'-' | b'+');
                let begin = at - text[..at].iter().rev().take_while(|b| is_part(b)).count();
                let end = at + text[at..].iter().take_while(|b| is_part(b)).count();
                let word = WORDS[self.below(WORDS.len())];
                text.splice(begin..end, word.bytes());
            }
            6 => {
                let other = &self.seeds[self.rng.random_range(0..self.seeds.len())];
                let from = self.rng.random_range(0..=other.len());
                let to = (from + self.rng.random_range(0..200_usize)).min(other.len());
                text.splice(at..at, other[from..to].iter().copied());
            }
            _ => {
                if let Some(byte) = text.get_mut(at) {
                    *byte ^= 1 << self.rng.random_range(0..8);
                }
            }
        }
    }
}

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().unwrap())
}

/// Tries random cases. One that panics fails the test, one that hangs ends it; either is kept in a
/// file.
fn try_cases(name: &str, share: u64, seeds: &[Vec<u8>], check: impl Fn(&[u8])) {
    let cases = number("PINC_RANDOM_CASES").unwrap_or(CASES) / share;
    let seed = number("PINC_RANDOM_SEED").unwrap_or(1);
    let kept = std::env::temp_dir().join(format!("pinc-random-{name}-{}", std::process::id()));
    let begun = Arc::new(AtomicU64::new(0));
    let (ended, end) = mpsc::channel::<()>();
    let hangs = Duration::from_secs(number("PINC_RANDOM_HANGS_S").unwrap_or(HANGS_S));
    let watch = {
        let begun = Arc::clone(&begun);
        std::thread::spawn(move || {
            let mut last = 0;
            while end.recv_timeout(hangs) == Err(mpsc::RecvTimeoutError::Timeout) {
                let now = begun.load(Ordering::Relaxed);
                if now == last {
                    // No panic reaches a thread that hangs.
                    std::process::abort();
                }
                last = now;
            }
        })
    };
    for case in 0..cases {
        let rng = ChaCha8Rng::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(case));
        let text = Changes { rng, seeds }.case();
        fs::write(&kept, &text).unwrap();
        begun.store(case + 1, Ordering::Relaxed);
        let outcome = catch_unwind(AssertUnwindSafe(|| check(&text)));
        assert!(outcome.is_ok(), "case {case} of seed {seed} is kept as {}", kept.display());
    }
    drop(ended);
    watch.join().unwrap();
    fs::remove_file(kept).unwrap();
}

/// Every shipped config without its comments.
fn configs() -> Vec<Vec<u8>> {
    let mut texts = Vec::new();
    let mut folders = vec![repository("configs")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "toml") {
                let text = fs::read_to_string(path).unwrap();
                let lines = text.lines().filter(|l| !l.is_empty() && !l.starts_with('#'));
                texts.push((lines.collect::<Vec<_>>().join("\n") + "\n").into_bytes());
            }
        }
    }
    texts.sort();
    texts
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn configs_are_read_or_refused() {
    let plants = Plants::built_in();
    let parse = |name: &str, text: &str| Experiment::parse(Path::new(name), text, &[], &plants);
    try_cases("config", 1, &configs(), |bytes| match parse("random.toml", &lossy(bytes)) {
        Ok(experiment) => {
            let written = experiment.to_toml();
            let again = parse("written.toml", &written).expect("what is written can be read");
            assert!(again == experiment, "{written}");
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    });
}

#[test]
fn values_set_are_taken_or_refused() {
    let config = crate::common::smoke();
    let seeds = [
        "control.q=[1.0, 2.0]",
        "training.growth={ max_points = 10 }",
        "model.neurons=8",
        "data={ files = [\"a.csv\"] }",
        "control.references.1.value=[0.0, 1.0]",
        "preset=ours",
    ];
    let seeds: Vec<Vec<u8>> = seeds.iter().map(|seed| seed.as_bytes().to_vec()).collect();
    try_cases("set", 1, &seeds, |bytes| {
        let sets = [lossy(bytes)];
        let path = Path::new("random.toml");
        if let Err(error) = Experiment::parse(path, &config, &sets, &Plants::built_in()) {
            assert!(!error.to_string().is_empty());
        }
    });
}

/// The first two lines are derivatives, further ones `name = expression`.
fn equations(text: &str) -> Equations {
    let mut lines = text.lines();
    let mut derivative = |name: &str| (name.to_owned(), lines.next().unwrap_or("x").to_owned());
    let derivatives = [derivative("x"), derivative("y")].into();
    let intermediates = lines.filter_map(|line| line.split_once('='));
    Equations {
        states: vec![Variable::new("x", ""), Variable::new("y", "m")],
        inputs: vec![Variable::new("u", "")],
        intermediates: intermediates.map(|(n, e)| (n.trim().to_owned(), e.to_owned())).collect(),
        derivatives,
        ..Equations::default()
    }
}

#[test]
fn expressions_are_compiled_or_refused() {
    let seeds = [
        "-x^2 + 1.5e-3*y/(1 + abs(u))\nmin(x, y) - max(u, pi)*sign(x)\n",
        "a*x + b\nb - a\na = sqrt(max(x, 0))\nb = a*exp(-y) + log(2)\n",
        "sin(x)*cos(y) - tan(u)/2\ntanh(x) + atan(y)^2^3\n",
        "1/(x + 0.1)^1.5 - log(x)*x^y\n(((x)))\n",
    ];
    let seeds: Vec<Vec<u8>> = seeds.iter().map(|seed| seed.as_bytes().to_vec()).collect();
    try_cases("expression", 1, &seeds, |bytes| {
        let equations = equations(&lossy(bytes));
        let plant = match equations.compile() {
            Ok(plant) => plant,
            Err(error) => {
                assert!(!error.to_string().is_empty());
                return;
            }
        };
        let terms = equations.critical_terms().expect("they were compiled");
        for (x, u) in [([0.5, -2.0], [1.5]), ([0.0, 0.0], [0.0])] {
            let mut plain = [0.0; 2];
            plant.rhs(&x, &u, &[], &mut plain);
            let mut dual = [Dual::<f64>::lift(0.0); 2];
            plant.rhs(&x.map(|v| Dual::variable(v, 0)), &u.map(Dual::lift), &[], &mut dual);
            for (plain, dual) in plain.iter().zip(dual) {
                // Zeros may differ in sign.
                let same = (plain + 0.0).total_cmp(&(dual.re + 0.0)).is_eq();
                assert!(same || plain.is_nan() && dual.re.is_nan(), "{plain} {}", dual.re);
            }
            assert_eq!(terms.values(&[x[0], x[1], u[0]]).len(), terms.list().len());
        }
    });
}

#[test]
fn model_files_are_read_or_refused() {
    let file = repository("crates/pinc/tests/data/model.safetensors");
    try_cases("model", 1, &[fs::read(file).unwrap()], |bytes| match PincNet::from_bytes(bytes) {
        Ok(net) => {
            let (n, m) = (net.state_names().len(), net.input_names().len());
            assert_eq!(
                net.evaluate(0.0, &vec![0.1; n], &vec![0.1; m], &vec![0.1; net.dims().np]).len(),
                n
            );
            let again = PincNet::from_bytes(&net.to_bytes()).expect("what is written can be read");
            assert_eq!(again.state_names(), net.state_names());
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    });
}

const TRAJECTORY: &str = "scenario,t,u,x1,x2\na,0,0.5,1,0\nb,0,0.0,-1,0.5\na,0.25,0.5,0.95,\n\
                          b,0.3,0.0,,0.9\na,0.5,0.5,0.8,-0.5\n";
const STEPS: &str = "x1_0,x2_0,u,t,x1,x2\n1,0,0.5,0.5,0.8,\n-1,0.5,0,0.25,,0.8\n";

#[test]
fn inputs_of_predictions_are_read_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in.csv"), dir.path().join("out.csv"));
    let model = repository("crates/pinc/tests/data/model.safetensors");
    let seeds = [TRAJECTORY.as_bytes().to_vec()];
    try_cases("predict", 1, &seeds, |bytes| {
        fs::write(&inputs, bytes).unwrap();
        match pinc_runs::predict(&model, &inputs, &output, OutsidePolicy::Report, None) {
            Ok(_) => assert!(output.exists()),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    });
}

#[test]
fn measurements_are_read_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("m.csv");
    let data = format!("[data]\nfiles = [{:?}]\n[training]", file.display().to_string());
    let config = crate::common::smoke().replace("[training]", &data);
    let sets = ["training.phases.0.iterations=1", "training.collocation_points=8"];
    let sets = [&sets[..], &["training.threads=1", "validation.one_step_points=1"]].concat();
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    let experiment =
        Experiment::parse(Path::new("c.toml"), &config, &sets, &Plants::built_in()).unwrap();
    let interrupt = AtomicBool::new(false);
    let options = Options {
        resume: false,
        verbosity: Verbosity::Quiet,
        interrupt: &interrupt,
        arguments: &[],
    };
    let seeds = [TRAJECTORY.as_bytes().to_vec(), STEPS.as_bytes().to_vec()];
    // Each is a training of one iteration, with its files.
    try_cases("data", 20, &seeds, |bytes| {
        fs::write(&file, bytes).unwrap();
        match pinc_runs::train(&experiment, &dir.path().join("run"), &options) {
            Ok(_) => {}
            Err(error @ RunError::Net(_)) => panic!("{error} of {:?}", lossy(bytes)),
            Err(error) => assert!(error.to_string().contains("m.csv"), "{error}"),
        }
    });
}
