//! `pinc serve` beside its steps: what is served, a state that outlives the process, clients of a
//! port.

use crate::common::{outcome, pinc, repository};
use crate::ways::Served;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Steps before and after the restart.
const STEPS: usize = 12;

fn measured(k: usize, base: &[f64]) -> Value {
    let wave = |i: usize| 0.05 * ((3 * k + 5 * i) as f64).sin();
    json!(base.iter().enumerate().map(|(i, y)| y + wave(i)).collect::<Vec<_>>())
}

/// A process that takes the state of another gives the inputs that the other gives.
#[test]
fn a_restarted_process_goes_on_without_a_bump() {
    let oscillator = repository("configs/van-der-pol/control.toml");
    let tanks = repository("configs/estimation/tanks.toml");
    let window = "control.estimator.window=5";
    for (config, base, sets) in [
        (&oscillator, &[0.4, -0.1][..], &[][..]),
        (&oscillator, &[0.4, -0.1], &["control.delay_steps=2", "control.initial_input=[0.3]"]),
        (&oscillator, &[0.4, -0.1], &["control.sqp.real_time=true"]),
        (&tanks, &[2.0, 2.1], &["control.estimator.kind=ekf"]),
        (&tanks, &[2.0, 2.1], &["control.estimator.kind=ukf", "control.delay_steps=1"]),
        (&tanks, &[2.0, 2.1], &["control.estimator.kind=mhe", window]),
    ] {
        let sets: Vec<_> = sets.iter().flat_map(|set| ["--set", *set]).collect();
        let mut first = Served::new(config, &sets);
        // One wild reading in between: what the gate knows goes along.
        let reading = |k: usize| match k {
            7 => json!({ "y": vec![1e5; base.len()] }),
            _ => json!({ "y": measured(k, base) }),
        };
        for k in 0..STEPS {
            first.ask(&reading(k));
        }
        let saved = first.ask(&json!({ "command": "save" }));
        let mut second = Served::new(config, &sets);
        let restore = json!({ "command": "restore", "state": saved["state"] });
        assert_eq!(second.ask(&restore), json!({ "done": "restore" }), "{sets:?}");
        assert_eq!(second.ask(&json!({ "command": "save" })), saved, "{sets:?}");
        for k in STEPS..2 * STEPS {
            let [one, other] = [&mut first, &mut second].map(|served| served.ask(&reading(k)));
            for what in ["u", "x"] {
                let pairs =
                    one[what].as_array().unwrap().iter().zip(other[what].as_array().unwrap());
                for (a, b) in pairs {
                    let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
                    assert!((a - b).abs() < 1e-9, "{sets:?} {k}: {what} {one} {other}");
                }
            }
            assert_eq!(one["estimator"], other["estimator"], "{sets:?} {k}");
        }
        // Afresh, the step is another one: the state was of use.
        assert_eq!(second.ask(&json!({ "command": "reset" })), json!({ "done": "reset" }));
        let mut fresh = Served::new(config, &sets);
        let [again, new] = [&mut second, &mut fresh].map(|served| served.ask(&reading(0)));
        assert_eq!(again["u"], new["u"], "{sets:?}");
        [first, second, fresh].into_iter().for_each(Served::end);
    }
}

#[test]
fn what_is_served_is_described() {
    let config = repository("configs/estimation/tanks.toml");
    let sets = ["--set", "control.delay_steps=1", "--set", "control.budget_us=800.0"];
    let mut served = Served::new(&config, &sets);
    let described = served.ask(&json!({ "command": "describe" }));
    assert_eq!(described["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(described["model"], "rk4");
    assert_eq!(described["sample_time_s"], 10.0);
    assert_eq!(described["delay_steps"], 1);
    assert_eq!(described["budget_us"], 800.0);
    assert_eq!(described["measured"], json!(["h1", "h2"]));
    assert_eq!(described["controlled"], json!(["h1", "h2"]));
    assert_eq!(described["inputs"][0]["name"], "u1");
    assert_eq!(described["inputs"][0]["low"], 0.0);
    assert_eq!(described["states"][3]["name"], "h4");
    assert_eq!(described["states"][3]["unit"], "cm");
    let unknowns = described["unknowns"].as_array().unwrap().len();
    let answer = served.ask(&json!({ "y": [2.0, 2.0] }));
    assert_eq!(answer["unknowns"].as_array().unwrap().len(), unknowns);
    let rows =
        vec![vec![3.0, 3.0]; usize::try_from(described["horizon"].as_u64().unwrap()).unwrap()];
    let answer = served.ask(&json!({ "y": [2.0, 2.0], "reference": rows }));
    assert!(answer["u"].is_array(), "{answer}");
    served.end();
}

#[test]
fn commands_that_cannot_be_carried_out_change_nothing() {
    let tanks = repository("configs/estimation/tanks.toml");
    let config = repository("configs/van-der-pol/control.toml");
    let mut strange = Served::new(&tanks, &[]);
    let of_tanks = strange.ask(&json!({ "command": "save" }))["state"].clone();
    strange.end();
    let mut longer = Served::new(&config, &["--set", "control.n2=9"]);
    let longer_state = longer.ask(&json!({ "command": "save" }))["state"].clone();
    longer.end();
    let mut served = Served::new(&config, &[]);
    let mut other = Served::new(&config, &[]);
    for request in [json!({ "y": [0.5, 0.1] }), json!({ "y": [0.4, 0.0] })] {
        assert_eq!(served.ask(&request)["u"], other.ask(&request)["u"]);
    }
    let mut damaged = served.ask(&json!({ "command": "save" }))["state"].clone();
    damaged["numbers"].as_array_mut().unwrap().pop();
    for (request, part) in [
        (json!({ "command": "stop" }), "unknown variant `stop`"),
        (json!({ "command": "reset", "y": [0.5, 0.1] }), "a command or a step"),
        (json!({ "command": "restore" }), "expected \"state\""),
        (json!({ "command": "save", "state": damaged }), "restore only"),
        (json!({ "y": [0.5, 0.1], "state": damaged }), "restore only"),
        (json!({ "command": "restore", "state": of_tanks }), "with the states h1, h2, h3, h4"),
        (json!({ "command": "restore", "state": longer_state }), "another horizon"),
        (json!({ "command": "restore", "state": damaged }), "another horizon or estimator"),
        (json!({ "y": [0.5, 0.1], "budget_us": -1.0 }), "budget_us: -1 given"),
    ] {
        served.refuses(request.to_string().as_bytes(), part);
    }
    let next = json!({ "y": [0.3, -0.1] });
    assert_eq!(served.ask(&next)["u"], other.ask(&next)["u"]);
    served.end();
    other.end();
}

/// A step with less time than any step takes ends at its deadline.
#[test]
fn a_line_says_how_long_its_step_may_take() {
    let mut served = Served::new(&repository("configs/van-der-pol/control.toml"), &[]);
    let hurried = served.ask(&json!({ "y": [0.5, 0.1], "budget_us": 1e-3 }));
    assert_eq!(hurried["status"], "deadline", "{hurried}");
    assert_eq!(served.ask(&json!({ "y": [0.5, 0.1] }))["status"], "converged");
    served.end();
}

struct AtPort {
    child: Child,
    address: String,
}

impl AtPort {
    fn new(config: &Path) -> Self {
        let mut command = pinc(&["serve", "--only", "rk4", "--listen", "127.0.0.1:0"]);
        let mut child = command.arg(config).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said: Value = serde_json::from_str(&line).unwrap();
        Self { child, address: said["listening"].as_str().unwrap().to_owned() }
    }

    fn ask(stream: &TcpStream, request: &Value) -> Value {
        writeln!(&mut &*stream, "{request}").unwrap();
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap()
    }
}

impl Drop for AtPort {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// One client is served at a time, and others are told so; the controller goes on from one to the
/// next, also where one leaves in the middle of a line.
#[test]
fn one_client_of_a_port_is_served_at_a_time() {
    let config = repository("configs/van-der-pol/control.toml");
    let requests =
        [json!({ "y": [0.5, 0.1] }), json!({ "y": [0.4, 0.0] }), json!({ "y": [0.3, 0.0] })];
    let mut served = Served::new(&config, &[]);
    let expected = requests.clone().map(|request| served.ask(&request)["u"].clone());
    served.end();
    let process = AtPort::new(&config);
    let first = TcpStream::connect(&process.address).unwrap();
    assert_eq!(AtPort::ask(&first, &requests[0])["u"], expected[0]);
    let second = TcpStream::connect(&process.address).unwrap();
    let mut told = String::new();
    BufReader::new(&second).read_to_string(&mut told).unwrap();
    let told: Value = serde_json::from_str(&told).unwrap();
    assert!(told["error"].as_str().unwrap().contains("another client"), "{told}");
    assert_eq!(AtPort::ask(&first, &requests[1])["u"], expected[1]);
    write!(&mut &first, "{{\"y\": [0.").unwrap();
    drop(first);
    let third = TcpStream::connect(&process.address).unwrap();
    assert_eq!(AtPort::ask(&third, &requests[2])["u"], expected[2]);
}

/// The clients of `examples/` close a loop with the controller at a port.
#[test]
fn the_clients_of_the_examples_reach_the_reference() {
    let process = AtPort::new(&repository("configs/van-der-pol/control.toml"));
    let port = process.address.rsplit(':').next().unwrap();
    let here = tempfile::tempdir().unwrap();
    let program = here.path().join("client");
    let source = repository("examples/serve-client/tcp_client.c");
    let mut compiler = Command::new("cc");
    let compiled = compiler.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-o"]);
    assert!(compiled.arg(&program).arg(source).status().unwrap().success());
    let mut python = Command::new("python3");
    python.arg(repository("examples/serve-client/tcp_client.py"));
    for mut client in [python, Command::new(program)] {
        let ended = outcome(client.arg(port));
        assert_eq!(ended.code, Some(0), "{}{}", ended.stdout, ended.stderr);
        let last = ended.stdout.lines().last().unwrap();
        let reached: f64 = last.rsplit(' ').next().unwrap().parse().unwrap();
        assert!((reached + 0.5).abs() < 1e-2, "{last}");
    }
}

#[test]
fn only_addresses_of_this_machine_are_listened_at() {
    let config = repository("configs/van-der-pol/control.toml");
    for address in ["0.0.0.0:5025", "192.168.1.5:5025", "localhost", "5025"] {
        let mut command = pinc(&["serve", "--only", "rk4", "--listen", address]);
        let ended = outcome(command.arg(&config).stdin(Stdio::null()));
        assert_eq!(ended.code, Some(2), "{address}");
        assert!(ended.stderr.contains("127.0.0.1:5025"), "{}", ended.stderr);
    }
}
