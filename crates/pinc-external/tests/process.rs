//! Processes whose requests and answers are longer than a pipe holds: this program is the process,
//! if its argument says so, and else the tests.

#![expect(clippy::print_stdout, reason = "it says which tests it runs")]

use pinc_external::Process;
use pinc_ode::{Dims, Flow, OdeError};
use serde_json::{Value, json};
use std::io::{BufRead, Write, stdin, stdout};
use std::sync::mpsc::channel;
use std::time::Duration;

/// The last argument but one of this program as a process.
const PROCESS: &str = "process";

/// So many that one request is some 150 kB, as is its answer.
const STATES: usize = 8000;

/// Far longer than anything here takes.
const LONG: Duration = Duration::from_secs(60);

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, first, kind] = &arguments[..]
        && first == PROCESS
    {
        return be_the_process(kind);
    }
    // `cargo test -- --list` and filters work as for other test programs.
    let filter = arguments.iter().skip(1).find(|argument| !argument.starts_with('-'));
    for (name, test) in TESTS {
        if filter.is_none_or(|filter| name.contains(filter)) {
            println!("test {name}");
            test();
        }
    }
}

const TESTS: [(&str, fn()); 7] = [
    ("an_unasked_line_between_numbered_answers_is_found", misplaced_answers_are_found),
    ("an_unasked_line_is_found_before_the_next_request", unasked_lines_are_found),
    ("a_batch_of_long_requests_is_answered_in_order", long_requests_are_answered),
    ("a_program_that_does_not_read_is_ended_in_time", one_that_does_not_read_is_ended),
    ("a_program_that_writes_before_it_reads_is_heard", one_that_writes_first_is_heard),
    ("a_program_that_ends_is_named", one_that_ends_is_named),
    ("an_answer_after_the_time_limit_is_too_late", one_that_is_late_is_ended),
];

/// Answers the requests on standard input with their states.
fn be_the_process(kind: &str) {
    let mut output = stdout().lock();
    match kind {
        // Until it is ended.
        "deaf" => loop {
            std::thread::park();
        },
        // More lines than are read ahead, and more than a pipe holds, before it reads.
        "chatters" => {
            let line = "-".repeat(100);
            // It is ended meanwhile, since this is no answer.
            let _ = (0..2000).try_for_each(|_| writeln!(output, "{line}"));
        }
        "ends" => return,
        "late" => std::thread::sleep(Duration::from_secs(3)),
        _ => {}
    }
    for (number, line) in stdin().lock().lines().enumerate() {
        let request: Value = serde_json::from_str(&line.unwrap()).unwrap();
        let mut answer = json!({ "x": request["x"] });
        if kind.starts_with("numbers") {
            assert_eq!(request["id"], 1 + number);
            answer["id"] = request["id"].clone();
        }
        writeln!(output, "{answer}").unwrap();
        if (kind == "numbers twice" && number == 1) || (kind == "twice" && number == 2) {
            writeln!(output, "{answer}").unwrap();
        }
        output.flush().unwrap();
    }
}

/// Asks for three points at once, and gives up where the two wait for one another.
fn ask(kind: &str, limit: Duration) -> Result<(), OdeError> {
    let program = std::env::current_exe().unwrap().display().to_string();
    let command = vec![program, PROCESS.to_owned(), kind.to_owned()];
    let (sender, receiver) = channel();
    let is_asked_again = kind == "twice" || kind == "numbers";
    std::thread::spawn(move || {
        let process = Process::new(command, Dims::new(STATES, 1), limit);
        let start: Vec<f64> = (0..).map(|i: u32| f64::from(i).sin()).take(3 * STATES).collect();
        let ask = || {
            let mut x = start.clone();
            let result = process.advance(&mut x, &[0.0; 3], 0.1);
            let is_same = x == start;
            result.map(|()| assert!(is_same))
        };
        let first = ask();
        let result = first.and_then(|()| match is_asked_again {
            true => {
                // Until what is written without a request is there.
                std::thread::sleep(Duration::from_secs(1));
                ask()
            }
            false => Ok(()),
        });
        sender.send(result).unwrap();
    });
    receiver.recv_timeout(LONG).expect("they wait for one another")
}

fn long_requests_are_answered() {
    ask("echoes", LONG).unwrap();
}

fn one_that_does_not_read_is_ended() {
    let error = ask("deaf", Duration::from_millis(200)).unwrap_err().to_string();
    assert!(error.contains("did not answer within 0.2 s"), "{error}");
}

fn one_that_writes_first_is_heard() {
    let error = ask("chatters", LONG).unwrap_err().to_string();
    // In place of an answer, or before the request is written.
    let is_found = |how| error.contains(&format!("{how} \"----"));
    assert!(is_found("answered") || is_found("wrote"), "{error}");
}

fn one_that_ends_is_named() {
    let error = ask("ends", LONG).unwrap_err().to_string();
    assert!(error.contains("ended without an answer"), "{error}");
}

fn one_that_is_late_is_ended() {
    let error = ask("late", Duration::from_millis(200)).unwrap_err().to_string();
    assert!(error.contains("did not answer within 0.2 s"), "{error}");
    ask("late", LONG).unwrap();
}

fn misplaced_answers_are_found() {
    ask("numbers", LONG).unwrap();
    let error = ask("numbers twice", LONG).unwrap_err().to_string();
    let expected = "answered request 2 when the answer to request 3 was due";
    assert!(error.contains(expected), "{error}");
}

fn unasked_lines_are_found() {
    let error = ask("twice", LONG).unwrap_err().to_string();
    assert!(
        error.contains("wrote \"{\\\"x\\\":[") && error.contains("without a request"),
        "{error}"
    );
}
