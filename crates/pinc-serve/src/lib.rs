#![doc = include_str!("../README.md")]
//! # Tour
//!
//! [`serve`] answers the lines of a reader, [`serve_clients`] the lines of clients at a port. The
//! requests and answers are in the book's page on serving.

#![forbid(unsafe_code)]

mod lines;

use lines::{answer, refusal};
use pinc_config::{Experiment, ModelKind};
use pinc_record::OutsideDomain;
use pinc_runs::{LiveController, ModelFile, RunError, console};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Condvar, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::Duration;

/// The length of a line, in bytes: so much, and more for each number that a request may hold.
const LINE: usize = 65_536;
const NUMBER: usize = 64;

/// Serves the controller of `experiment`, with its estimator if it has one, and with the model of
/// the file `model`, or `only` one of the config's: reads a line of `input`, writes one to
/// `output`, until the input ends or nobody reads the output. A line that cannot be used is
/// answered with `{"error": ".."}` and changes nothing; so is one that is longer than any request,
/// of which no more than that is kept in memory.
///
/// Without a reference the config's are followed, from the first step on. Returns how often the net
/// was used outside its training domain.
///
/// # Errors
///
/// [`RunError`] if the controller cannot be made, or `output` fails with readers left.
pub fn serve(
    experiment: &Experiment,
    model: Option<&Path>,
    only: Option<ModelKind>,
    input: impl BufRead,
    output: impl Write,
) -> Result<OutsideDomain, RunError> {
    let mut controller = controller(experiment, model, only)?;
    console::written(answer_lines(&mut controller, input, output))?;
    Ok(controller.outside_domain())
}

/// [`serve`] for the clients that connect to `listener`, one at a time: another that connects
/// meanwhile is told so in an `{"error": ".."}` and sent away. The controller goes on from client to
/// client. Writes `{"listening":"address:port"}` to `output` first, and returns only with an error.
///
/// # Errors
///
/// [`RunError`] if the controller cannot be made, or the listener fails.
pub fn serve_clients(
    experiment: &Experiment,
    model: Option<&Path>,
    only: Option<ModelKind>,
    listener: &TcpListener,
    mut output: impl Write,
) -> Result<std::convert::Infallible, RunError> {
    let mut controller = controller(experiment, model, only)?;
    let failed = |error: io::Error| RunError::usage("`--listen`", error.to_string());
    let address = listener.local_addr().map_err(failed)?;
    let said = writeln!(output, "{{\"listening\":\"{address}\"}}").and_then(|()| output.flush());
    console::written(said)?;
    let door = Door::default();
    let (sender, clients) = mpsc::sync_channel(1);
    let error = thread::scope(|scope| {
        let accepting = scope.spawn(|| door.accept(listener, sender));
        for stream in clients {
            // An answer is one small packet, which is not to wait for more. A client that leaves in
            // the middle of a line has left, whatever the error is called.
            let served = stream
                .set_nodelay(true)
                .and_then(|()| answer_lines(&mut controller, BufReader::new(&stream), &stream));
            if let Err(error) = served {
                tracing::debug!(%error, "a client left");
            }
            drop(stream);
            door.open();
        }
        accepting.join()
    });
    match error {
        Ok(error) => Err(failed(error)),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// Lets one client in at a time.
#[derive(Default)]
struct Door {
    is_taken: Mutex<bool>,
    opened: Condvar,
}

/// How long a client may take to be gone once it has closed its connection.
const LEAVING: Duration = Duration::from_millis(200);

impl Door {
    /// Passes clients on, and sends those away that come while one is served. Ends with an error.
    fn accept(&self, listener: &TcpListener, clients: mpsc::SyncSender<TcpStream>) -> io::Error {
        loop {
            let stream = match listener.accept() {
                Ok((stream, _)) => stream,
                Err(error) => return error,
            };
            if !self.enter() {
                let error = "another client is connected; connect again when it has left";
                if let Err(error) = writeln!(&stream, "{}", refusal(error)) {
                    tracing::debug!(%error, "a client that was sent away had left");
                }
            } else if clients.send(stream).is_err() {
                return io::Error::other("nobody serves clients any more");
            }
        }
    }

    /// Whether a client comes in: nobody else is served, or is about to leave.
    fn enter(&self) -> bool {
        let taken = self.is_taken.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.opened.wait_timeout_while(taken, LEAVING, |taken| *taken);
        let (mut taken, _) = waited.unwrap_or_else(PoisonError::into_inner);
        !std::mem::replace(&mut *taken, true)
    }

    fn open(&self) {
        *self.is_taken.lock().unwrap_or_else(PoisonError::into_inner) = false;
        self.opened.notify_all();
    }
}

fn controller(
    experiment: &Experiment,
    model: Option<&Path>,
    only: Option<ModelKind>,
) -> Result<LiveController, RunError> {
    LiveController::new(experiment, model.map(ModelFile::At), only, "pinc serve")
}

/// Answers each line of `input` on `output`, until the input ends or the output fails.
fn answer_lines(
    controller: &mut LiveController,
    mut input: impl BufRead,
    mut output: impl Write,
) -> io::Result<()> {
    let longest = LINE + NUMBER * controller.request_numbers();
    let mut line = Vec::new();
    while let Ok(Some(end)) = read_line(&mut input, longest, &mut line) {
        let answer = match end {
            LineEnd::Reached => answer(controller, &line),
            LineEnd::Beyond => Err(format!("a line of more than {longest} bytes given")),
        };
        let answer = answer.unwrap_or_else(|error| refusal(&console::shortened(&error)));
        writeln!(output, "{answer}").and_then(|()| output.flush())?;
        controller.prepare();
    }
    Ok(())
}

/// Whether a line was read to its end.
enum LineEnd {
    Reached,
    /// The line is longer than allowed; the rest was skipped.
    Beyond,
}

/// Reads a line of at most `longest` bytes into `line`; `None` at the end of the input.
fn read_line(
    input: &mut impl BufRead,
    longest: usize,
    line: &mut Vec<u8>,
) -> io::Result<Option<LineEnd>> {
    line.clear();
    if input.by_ref().take(longest as u64 + 1).read_until(b'\n', line)? == 0 {
        return Ok(None);
    }
    if line.pop_if(|byte| *byte == b'\n').is_some() || line.len() <= longest {
        return Ok(Some(LineEnd::Reached));
    }
    input.skip_until(b'\n')?;
    Ok(Some(LineEnd::Beyond))
}
