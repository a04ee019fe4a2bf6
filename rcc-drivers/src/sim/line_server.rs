//! A control port: a Unix socket at which each line is a request and gets one line as its answer. Whoever may connect is
//! answered; see [`super::control_socket`].
//! One thread accepts, one thread serves each connection; none of them ever touches a simulator's clock thread.

use rcc_ipc::log_throttle::LogThrottle;
use rcc_process::signals::request_stop;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// Longest line that is read, in bytes.
const LINE_MAX: u64 = 64 * 1024;

/// Longest time for an answer.
const ANSWER_MAX: Duration = Duration::from_secs(30);

/// What follows a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineReply {
    /// The answer, without the line's end.
    pub line: String,
    /// The process ends once the answer is sent.
    pub stop: bool,
}

/// Answers one line, which comes without its end.
pub type LineHandler = Arc<dyn Fn(&str) -> LineReply + Send + Sync>;

/// Serves `answer` to whoever connects, for the rest of the process's life.
///
/// # Errors
/// The system gives no thread.
pub fn serve(listener: UnixListener, answer: LineHandler) -> io::Result<()> {
    thread::Builder::new()
        .name("control".into())
        .spawn(move || {
            let mut complaints = LogThrottle::default();
            for stream in listener.incoming() {
                let answer = answer.clone();
                let served = stream.and_then(|stream| {
                    let serve = move || converse(stream, &answer);
                    thread::Builder::new()
                        .name("control-client".into())
                        .spawn(serve)
                });
                if let Err(error) = served
                    && let Some(more) = complaints.admit(Instant::now())
                {
                    tracing::warn!(%error, more, "a control connection was not served");
                }
            }
        })?;
    Ok(())
}

/// Until the client hangs up, says something too long, or does not read.
fn converse(stream: UnixStream, answer: &LineHandler) {
    let end = answer_lines(stream, answer);
    if let Err(error) = end {
        tracing::debug!(%error, "a control connection ended");
    }
}

fn answer_lines(stream: UnixStream, answer: &LineHandler) -> io::Result<()> {
    let mut writer = stream.try_clone()?;
    let mut reader = BufReader::new(stream);
    let mut line = String::new();
    loop {
        line.clear();
        if reader.by_ref().take(LINE_MAX).read_line(&mut line)? == 0 {
            return Ok(());
        }
        if !line.ends_with('\n') && line.len() as u64 == LINE_MAX {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "a line is longer than 64 KiB",
            ));
        }
        if line.trim().is_empty() {
            continue;
        }
        let LineReply {
            line: mut reply,
            stop,
        } = answer(line.trim());
        reply.push('\n');
        let written = writer.write_all(reply.as_bytes());
        if stop {
            request_stop();
        }
        written?;
    }
}

/// A client of a control port: one request, one answer.
#[derive(Debug)]
pub struct ControlClient {
    stream: BufReader<UnixStream>,
}

impl ControlClient {
    /// Connects; from now on the server has [`ANSWER_MAX`] for each answer.
    ///
    /// # Errors
    /// Nobody listens there.
    pub fn connect(path: impl AsRef<Path>) -> io::Result<Self> {
        let stream = UnixStream::connect(path)?;
        stream.set_read_timeout(Some(ANSWER_MAX))?;
        stream.set_write_timeout(Some(ANSWER_MAX))?;
        Ok(Self {
            stream: BufReader::new(stream),
        })
    }

    /// The answer to a request, with its line's end.
    ///
    /// # Errors
    /// The server is gone, hangs up or does not answer in time; which request it was is in the text.
    pub fn ask(&mut self, request: &str) -> io::Result<String> {
        let mut reply = String::new();
        self.stream
            .get_mut()
            .write_all(format!("{request}\n").as_bytes())
            .and_then(|()| self.stream.read_line(&mut reply))
            .and_then(|size| match size {
                0 => Err(io::ErrorKind::UnexpectedEof.into()),
                _ => Ok(reply),
            })
            .map_err(|error| {
                let text = format!("no answer to {request}: {error}");
                io::Error::new(error.kind(), text)
            })
    }
}
