//! The served controller, without the program around it.

mod commands;
mod lines;
mod port;

use pinc_config::{Experiment, ModelKind, Plants};
use serde_json::Value;
use std::io::{self, BufRead, BufReader, PipeReader, PipeWriter, Write};
use std::path::Path;
use std::thread::{self, JoinHandle};

/// A shipped config with some values set.
fn experiment(config: &str, sets: &[&str]) -> Experiment {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(config);
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    Experiment::load(&path, &sets, &Plants::built_in()).unwrap()
}

/// A server of a config's controller with RK4, line by line.
struct Served {
    serving: JoinHandle<()>,
    input: PipeWriter,
    output: BufReader<PipeReader>,
}

impl Served {
    fn new(config: &str, sets: &[&str]) -> Self {
        let experiment = experiment(config, sets);
        let (lines, input) = io::pipe().unwrap();
        let (output, answers) = io::pipe().unwrap();
        let serving = thread::spawn(move || {
            let (only, lines) = (Some(ModelKind::RK4), BufReader::new(lines));
            pinc_serve::serve(&experiment, None, only, lines, answers).unwrap();
        });
        Self { serving, input, output: BufReader::new(output) }
    }

    fn ask_bytes(&mut self, line: &[u8]) -> Value {
        self.input.write_all(&[line, b"\n"].concat()).unwrap();
        let mut answer = String::new();
        self.output.read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap()
    }

    fn ask(&mut self, request: &Value) -> Value {
        self.ask_bytes(request.to_string().as_bytes())
    }

    /// The first input that a request is answered with.
    #[track_caller]
    fn input(&mut self, request: &Value) -> f64 {
        let answer = self.ask(request);
        answer["u"][0].as_f64().unwrap_or_else(|| panic!("{request}: {answer}"))
    }

    #[track_caller]
    fn refuses(&mut self, line: &[u8], part: &str) {
        let answer = self.ask_bytes(line);
        let error = answer["error"].as_str().unwrap();
        assert!(error.contains(part), "{part}: {error}");
        assert!(answer.get("u").is_none());
    }

    /// Ends the input; the server ends by itself.
    fn end(self) {
        let Self { serving, input, output: _output } = self;
        drop(input);
        serving.join().unwrap();
    }
}
