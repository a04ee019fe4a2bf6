//! The control port: a Unix socket on which each line is a request and gets one line as its answer. Every process that
//! can connect is served; see [`super::control_socket`].
//! One thread accepts, and one thread serves each connection; none of them touches a simulator's clock thread.

use rcc_process::log_throttle::LogThrottle;
use rcc_process::signals::request_stop;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// Longest request line, bytes.
const LINE_MAX: u64 = 64 * 1024;

/// Longest time for an answer.
const ANSWER_MAX: Duration = Duration::from_secs(30);

/// Answer to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineReply {
    /// The answer, without a line end.
    pub line: String,
    /// The process ends once the answer has been sent.
    pub stop: bool,
}

/// Handles one request line, given without its line end.
pub type LineHandler = Arc<dyn Fn(&str) -> LineReply + Send + Sync>;

/// Serves every client with `answer`, for the rest of the process's life.
///
/// # Errors
/// Returns an error if the operating system refuses to create a thread.
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

/// Serves a client until it hangs up, sends a line that is too long, or stops reading.
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
    /// Connects; the server then has [`ANSWER_MAX`] for each answer.
    ///
    /// # Errors
    /// Returns an error if nobody listens there.
    pub fn connect(path: impl AsRef<Path>) -> io::Result<Self> {
        let stream = UnixStream::connect(path)?;
        stream.set_read_timeout(Some(ANSWER_MAX))?;
        stream.set_write_timeout(Some(ANSWER_MAX))?;
        Ok(Self {
            stream: BufReader::new(stream),
        })
    }

    /// Sends a request and returns the answer with its line end.
    ///
    /// # Errors
    /// Returns an error, which contains the request, if the server hangs up or does not answer in time.
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
