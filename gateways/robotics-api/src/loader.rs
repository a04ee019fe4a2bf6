//! A client of the loader's REST interface over the cell's Unix socket. Each thread that talks to the loader has one of
//! its own; nothing here touches the cycle.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rcc_api::bodies::{
    CommandDetail, CommandRef, DeviceView, ErrorBody, Loaded, Switch, ValuesView,
};
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::pace::Pace;

/// Time for one answer; the loader answers every request within 10 s.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(15);
/// Time for a net to be compiled, installed and rehearsed.
const LOADING_TIME_MAX: Duration = Duration::from_secs(60);
/// Pause between two looks at a net that is loading.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// Largest answer in bytes.
const ANSWER_MAX: u64 = 64 << 20;

/// Why the loader did not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum LoaderError {
    /// It cannot be reached; the cell may be restarting.
    #[error("the cell's loader cannot be reached: {0}")]
    Unreachable(#[from] io::Error),
    /// It refused the request.
    #[error("{}", words(.0))]
    Refused(Box<ErrorBody>),
    /// Its answer is not that of the interface.
    #[error("the loader's answer to {0} cannot be read")]
    Answer(String),
    /// A net is still loading after a long time.
    #[error("the net is still loading after {LOADING_TIME_MAX:?}")]
    Loading,
}

impl LoaderError {
    /// Returns the code of a refusal.
    #[must_use]
    pub fn code(&self) -> &str {
        match self {
            LoaderError::Refused(body) => &body.code,
            _ => "",
        }
    }
}

/// Returns an error as one sentence with its remedy.
fn words(body: &ErrorBody) -> String {
    match &body.help {
        Some(help) if !help.is_empty() => format!("{}: {} ({help})", body.code, body.message),
        _ => format!("{}: {}", body.code, body.message),
    }
}

/// A connection to the loader, opened when it is needed. Commands are named by their net, which is unique: an id means
/// another command once the executor was started again.
#[derive(Debug)]
pub struct LoaderClient {
    socket: PathBuf,
    open: Option<UnixStream>,
    pace: Option<Arc<Pace>>,
}

impl LoaderClient {
    /// Returns a client of the loader with this socket.
    #[must_use]
    pub fn new(socket: &Path) -> LoaderClient {
        LoaderClient {
            socket: socket.to_owned(),
            open: None,
            pace: None,
        }
    }

    /// Returns this client at a common pace of clients. CANCEL and ABORT do not wait for it.
    #[must_use]
    pub fn at(self, pace: Arc<Pace>) -> LoaderClient {
        LoaderClient {
            pace: Some(pace),
            ..self
        }
    }

    /// Loads a net and waits until it is ready or rejected.
    ///
    /// # Errors
    /// Returns an error if the loader takes no net, or if it is still loading after a minute.
    pub fn load(&mut self, text: &str) -> Result<CommandDetail, LoaderError> {
        let Loaded { id, .. } = self.request("POST", "/commands?file=net", text)?;
        let begun = Instant::now();
        loop {
            let state = self.state(&id.to_string())?;
            if state.command.state != "loading" {
                return match state.command.state.as_str() {
                    "rejected" => Ok(state),
                    _ => self.request("GET", &format!("/commands/{id}"), ""),
                };
            }
            if begun.elapsed() > LOADING_TIME_MAX {
                return Err(LoaderError::Loading);
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Returns the state of a command, without its text.
    ///
    /// # Errors
    /// Returns an error if there is no such command.
    pub fn state(&mut self, command: &str) -> Result<CommandDetail, LoaderError> {
        self.request("GET", &format!("/commands/{command}?brief=true"), "")
    }

    /// Carries out `start`, `cancel` or `abort`.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn operate(&mut self, command: &str, operation: &str) -> Result<(), LoaderError> {
        self.request::<Value>("POST", &format!("/commands/{command}/{operation}"), "")
            .map(drop)
    }

    /// Stops some commands and starts others between the same two cycles.
    ///
    /// # Errors
    /// Returns the loader's refusal; nothing has changed then.
    pub fn switch(&mut self, stop: &[String], start: &[String]) -> Result<(), LoaderError> {
        let named = |names: &[String]| names.iter().cloned().map(CommandRef::Name).collect();
        let body = Switch {
            stop: named(stop),
            start: named(start),
            ..Switch::default()
        };
        // Numbers can be serialized.
        let body = serde_json::to_string(&body).unwrap_or_default();
        self.request::<Value>("POST", "/switch", &body).map(drop)
    }

    /// Sets inputs of a command.
    ///
    /// # Errors
    /// Returns the loader's refusal; nothing was set then.
    pub fn set(
        &mut self,
        command: &str,
        inputs: &serde_json::Map<String, Value>,
    ) -> Result<(), LoaderError> {
        let body = Value::Object(inputs.clone()).to_string();
        self.request::<Value>("PUT", &format!("/commands/{command}/inputs"), &body)
            .map(drop)
    }

    /// Reads the inputs of the monitors of a command, which are the values that the application sees.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn values(&mut self, command: &str, ports: &[String]) -> Result<ValuesView, LoaderError> {
        // Ids of monitors need no escapes.
        self.request(
            "GET",
            &format!("/commands/{command}/values?ports={}", ports.join(",")),
            "",
        )
    }

    /// Removes a command that is not active.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn unload(&mut self, command: &str) -> Result<(), LoaderError> {
        self.request::<Value>("DELETE", &format!("/commands/{command}"), "")
            .map(drop)
    }

    /// Lists the devices of the cell.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn devices(&mut self) -> Result<Vec<DeviceView>, LoaderError> {
        self.request("GET", "/devices", "")
    }

    fn request<T: DeserializeOwned>(
        &mut self,
        method: &str,
        path: &str,
        body: &str,
    ) -> Result<T, LoaderError> {
        let is_stop = path.ends_with("/cancel") || path.ends_with("/abort");
        if let Some(pace) = self.pace.as_ref().filter(|_| !is_stop) {
            pace.wait();
        }
        let head = format!(
            "{method} {path} HTTP/1.1\r\nhost: rcc\r\ncontent-length: {}\r\n\r\n",
            body.len()
        );
        // A connection that was idle may have been closed; the request is then sent once more.
        let kept = self.open.take();
        let answer = match kept.map(|stream| exchange(stream, &head, body)) {
            Some(Ok(answer)) => answer,
            Some(Err(error)) if !is_closed(&error) => return Err(error.into()),
            _ => {
                let stream = UnixStream::connect(&self.socket)?;
                stream.set_read_timeout(Some(ANSWER_TIME_MAX))?;
                stream.set_write_timeout(Some(ANSWER_TIME_MAX))?;
                exchange(stream, &head, body)?
            }
        };
        self.open = answer.kept;
        let unread = |_| LoaderError::Answer(format!("{method} {path}"));
        match answer.status {
            200..=299 => serde_json::from_slice(&answer.body).map_err(unread),
            _ => Err(LoaderError::Refused(Box::new(
                serde_json::from_slice(&answer.body).map_err(unread)?,
            ))),
        }
    }
}

/// Returns true if the other side closed the connection before it answered.
fn is_closed(error: &io::Error) -> bool {
    use io::ErrorKind::{BrokenPipe, ConnectionReset, UnexpectedEof};
    matches!(error.kind(), BrokenPipe | ConnectionReset | UnexpectedEof)
}

struct HttpAnswer {
    status: u16,
    body: Vec<u8>,
    /// The connection, if it can carry another request.
    kept: Option<UnixStream>,
}

fn exchange(mut stream: UnixStream, head: &str, body: &str) -> io::Result<HttpAnswer> {
    stream.write_all([head.as_bytes(), body.as_bytes()].concat().as_slice())?;
    let mut received = Vec::new();
    let mut piece = [0; 16 << 10];
    let (head_length, status, length) = loop {
        let read = stream.read(&mut piece)?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        received.extend_from_slice(piece.get(..read).unwrap_or_default());
        if let Some(head) = answer_head(&received)? {
            break head;
        }
    };
    let mut body = received.split_off(head_length);
    let missing = length.saturating_sub(body.len() as u64);
    (&mut stream).take(missing).read_to_end(&mut body)?;
    if (body.len() as u64) < length {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(HttpAnswer {
        status,
        body,
        kept: Some(stream),
    })
}

/// Returns length, status and length of the body of a complete head.
fn answer_head(received: &[u8]) -> io::Result<Option<(usize, u16, u64)>> {
    let invalid = || io::Error::from(io::ErrorKind::InvalidData);
    let mut headers = [httparse::EMPTY_HEADER; 32];
    let mut answer = httparse::Response::new(&mut headers);
    let parsed = answer.parse(received).map_err(|_| invalid())?;
    let httparse::Status::Complete(head_length) = parsed else {
        return Ok(None);
    };
    let status = answer.code.ok_or_else(invalid)?;
    let length = answer
        .headers
        .iter()
        .find(|header| header.name.eq_ignore_ascii_case("content-length"));
    let length =
        length.and_then(|header| std::str::from_utf8(header.value).ok()?.trim().parse().ok());
    let length = length
        .filter(|length| *length <= ANSWER_MAX)
        .ok_or_else(invalid)?;
    Ok(Some((head_length, status, length)))
}
