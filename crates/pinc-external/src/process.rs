//! A plant as a process: states and inputs on its standard input, states on its standard output.

use crate::pool::{Failure, Pool, broken, external};
use pinc_ode::{Dims, Flow, OdeError};
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::time::Duration;

/// The most lines that are read ahead; further lines wait in the program.
const READ_AHEAD: usize = 256;

/// A program that moves the state of a plant in time, started when it is first asked; several
/// copies of it if several threads ask at once.
///
/// One JSON object a line: `{"x":[..],"u":[..],"t":0.5,"id":7}` asks for the state that follows `x`
/// after `t` seconds under the constant input `u`; the answer is `{"x":[..],"id":7}`, or
/// `{"error":"..","id":7}` where there is none. There may be any number of requests before the first
/// answer is read; answers are in their order. The program ends when its standard input does, and is
/// ended when an answer takes longer than the time limit.
///
/// An answer's `id`, if given, is its request's. A program may leave the `id` out; lines that
/// nobody asked for are then found once they are read before the next request is written. After any
/// other answer, or none, nothing is asked any more.
#[derive(Debug)]
pub struct Process {
    dims: Dims,
    command: Vec<String>,
    time_limit: Duration,
    copies: Pool<Copy>,
}

/// One at work.
struct Copy {
    child: Child,
    /// Its lines to be, for a thread that writes them: a program that does not read, or not before
    /// its own lines are read, would keep whoever writes waiting for ever.
    requests: Sender<Vec<u8>>,
    /// Its lines, from a thread that reads them, since a read cannot be given up.
    answers: Receiver<Vec<u8>>,
    /// The number of the last request that was answered.
    answered: u64,
}

#[derive(Serialize)]
struct Request<'a> {
    x: &'a [f64],
    u: &'a [f64],
    t: f64,
    id: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    x: Option<Vec<f64>>,
    error: Option<String>,
    id: Option<u64>,
}

/// What to do about lines that are no answers.
const ANSWERS_ONLY: &str =
    "each line on standard output has to answer one request; all else goes to standard error";

impl Process {
    /// The plant of these sizes that `command`, a program and its arguments, simulates, each answer
    /// of which must come within `time_limit`. Nothing is started yet.
    #[must_use]
    pub fn new(command: Vec<String>, dims: Dims, time_limit: Duration) -> Self {
        Self { dims, command, time_limit, copies: Pool::new() }
    }

    fn start(&self) -> Result<Copy, Failure> {
        let (program, arguments) =
            self.command.split_first().ok_or_else(|| broken("no program is named"))?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C asks this program to come to an end in good order, for which it needs the other.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let started = command.spawn();
        let mut child =
            started.map_err(|error| broken(format!("{program} cannot be started: {error}")))?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(broken(format!("{program} has no standard input or output")));
        };
        let (requests, answers) = (writer(input), lines(output, self.dims.nx));
        Ok(Copy { child, requests, answers, answered: 0 })
    }

    /// Asks for all of the states at once, and reads the answers while the requests are written.
    fn exchange(&self, copy: &mut Copy, x: &mut [f64], u: &[f64], t: f64) -> Result<(), Failure> {
        if let Ok(line) = copy.answers.try_recv() {
            let (name, found) = (self.name(), beginning(&line));
            let what = format!("{name} wrote {found:?} without a request: {ANSWERS_ONLY}");
            return Err(broken(what));
        }
        let Dims { nx, nu, .. } = self.dims;
        let mut requests = Vec::new();
        for ((x, u), id) in x.chunks_exact(nx).zip(u.chunks_exact(nu)).zip(copy.answered + 1..) {
            let written = serde_json::to_writer(&mut requests, &Request { x, u, t, id });
            written.map_err(|error| broken(error.to_string()))?;
            requests.push(b'\n');
        }
        // The thread is gone if an earlier request could not be written.
        copy.requests.send(requests).map_err(|_| self.ended(copy))?;
        x.chunks_exact_mut(nx).try_for_each(|x| self.read(copy, x))
    }

    /// Reads one answer.
    fn read(&self, copy: &mut Copy, x: &mut [f64]) -> Result<(), Failure> {
        let answer = match copy.answers.recv_timeout(self.time_limit) {
            Ok(answer) => answer,
            Err(RecvTimeoutError::Disconnected) => return Err(self.ended(copy)),
            Err(RecvTimeoutError::Timeout) => {
                let limit = self.time_limit.as_secs_f64();
                let name = self.name();
                let what = format!("{name} did not answer within {limit} s (time_limit_s)");
                return Err(broken(what));
            }
        };
        copy.answered += 1;
        let asked = copy.answered;
        let expected = || {
            let n = x.len();
            broken(format!(
                "{} answered {:?}, expected one line {{\"x\":[..]}} with {n} numbers, or \
                {{\"error\":\"..\"}}",
                self.name(),
                beginning(&answer)
            ))
        };
        match serde_json::from_slice(&answer) {
            Ok(Answer { id: Some(id), .. }) if id != asked => Err(broken(format!(
                "{} answered request {id} when the answer to request {asked} was due: \
                {ANSWERS_ONLY}",
                self.name()
            ))),
            Ok(Answer { x: Some(next), error: None, .. }) if next.len() == x.len() => {
                x.copy_from_slice(&next);
                Ok(())
            }
            Ok(Answer { x: None, error: Some(error), .. }) => {
                Err(Failure::Unanswerable(external(error)))
            }
            _ => Err(expected()),
        }
    }

    fn name(&self) -> &str {
        self.command.first().map_or("", String::as_str)
    }

    /// Why there is no answer.
    fn ended(&self, copy: &mut Copy) -> Failure {
        let status = copy.child.try_wait().ok().flatten();
        let status = status.map_or_else(String::new, |status| format!(" ({status})"));
        broken(format!("{} ended without an answer{status}", self.name()))
    }
}

/// What a line begins with, for a message.
fn beginning(line: &[u8]) -> String {
    let shown: Vec<u8> = line.iter().copied().take(200).collect();
    String::from_utf8_lossy(&shown).trim_end().to_owned()
}

/// What is sent is written to `input`, by a thread of its own, until nothing more can be sent or
/// written.
fn writer(mut input: ChildStdin) -> Sender<Vec<u8>> {
    let (sender, receiver) = channel::<Vec<u8>>();
    std::thread::spawn(move || {
        let write = |lines: Vec<u8>| input.write_all(&lines).and_then(|()| input.flush());
        // A program that cannot be written to has ended: that it does not answer says so.
        let _ = receiver.into_iter().try_for_each(write);
    });
    sender
}

/// The lines of `output`, read in a thread of its own until nobody wants them any more.
fn lines(output: ChildStdout, states: usize) -> Receiver<Vec<u8>> {
    let (sender, receiver) = sync_channel(READ_AHEAD);
    // Far more than the numbers and their names take.
    let most = 4096 + 64 * states as u64;
    let mut output = BufReader::new(output);
    std::thread::spawn(move || {
        loop {
            let mut line = Vec::new();
            let read = output.by_ref().take(most).read_until(b'\n', &mut line);
            if !matches!(read, Ok(length) if length > 0) || sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

impl Flow for Process {
    fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError> {
        self.copies.with(|| self.start(), |copy| self.exchange(copy, x, u, duration_s))
    }
}

impl Drop for Copy {
    fn drop(&mut self) {
        // It may be stuck, and has nothing that needs to be saved.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
