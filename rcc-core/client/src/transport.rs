//! Requests to a loader: one per connection, over the cell's Unix socket or over TCP with the cell's token. Each blocks
//! the calling thread for at most its time-out.

use std::fmt;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use http_body_util::{BodyExt, Full};
use hyper::body::Bytes;
use hyper::{Method, Request, StatusCode};
use hyper_util::rt::TokioIo;
use rcc_api::bodies::{CommandView, ErrorBody, Loaded, ValuesView};
use rcc_api::codes;
use rcc_api::routes::{TIMEOUT_HEADER, is_stop};
use rcc_api::token::Token;
use serde::de::DeserializeOwned;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};
use tokio::runtime::{Builder, Runtime};

use crate::error::RequestError;

mod download;
mod stream;

pub use stream::Lines;

/// Maximum time for which the answer to LOAD waits for the net to be ready or rejected; nearly all are by then.
const LOAD_WAIT: Duration = Duration::from_secs(5);
/// Interval at which a net that is still being loaded after that is looked at.
const LOAD_POLL: Duration = Duration::from_millis(10);

/// REST client of one cell's loader.
#[derive(Debug)]
pub struct LoaderClient {
    cell: String,
    endpoint: Endpoint,
    timeout: Duration,
    runtime: Runtime,
}

/// Address of a loader.
#[derive(Clone, Debug)]
enum Endpoint {
    Socket(PathBuf),
    Tcp(RemoteLoader),
}

/// Address of a loader that listens on TCP, and the token that authorises the requests.
#[derive(Clone)]
pub struct RemoteLoader {
    /// Host and port.
    pub authority: String,
    /// Value of the `authorization` header; `None` without a token.
    pub authorization: Option<Vec<u8>>,
}

impl fmt::Debug for RemoteLoader {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "RemoteLoader({})", self.authority)
    }
}

impl RemoteLoader {
    /// Parses `url` (`http://HOST:PORT`). The token is read from `token_file`, or else taken from `token`.
    ///
    /// # Errors
    /// Fails if `url` has another form or if the token file cannot be read.
    pub fn new(
        url: &str,
        token_file: Option<&Path>,
        token: Option<&str>,
    ) -> Result<RemoteLoader, RequestError> {
        let bad = |help: &str| {
            let message = format!("invalid loader address `{url}`");
            RequestError::new(codes::BAD_REQUEST, message, help)
        };
        if url.starts_with("https:") {
            return Err(bad(
                "the loader does not support TLS: run `ssh -L 7425:127.0.0.1:7425 HOST` and use http://127.0.0.1:7425",
            ));
        }
        let authority = url
            .strip_prefix("http://")
            .map(|rest| rest.trim_end_matches('/'));
        let has_port = |authority: &&str| {
            let port = authority
                .rsplit_once(':')
                .map(|(_, port)| port.parse::<u16>());
            port.is_some_and(|port| port.is_ok()) && !authority.contains(['/', '@'])
        };
        let authority = authority.filter(has_port);
        let authority =
            authority.ok_or_else(|| bad("write http://HOST:PORT, as in http://127.0.0.1:7425"))?;
        let authorization = match (token_file, token) {
            (Some(file), _) => {
                let token = Token::read(file).map_err(|error| {
                    RequestError::new(codes::NOT_PERMITTED, error.to_string(), "")
                })?;
                Some(token.bearer())
            }
            (None, Some(token)) => Some([b"Bearer ", token.trim().as_bytes()].concat()),
            (None, None) => None,
        };
        Ok(RemoteLoader {
            authority: authority.to_owned(),
            authorization,
        })
    }
}

/// Returns the folder in which each cell of this user has its own; it need not exist.
#[must_use]
pub fn runtime_folder() -> PathBuf {
    let variable = |name| {
        let value = std::env::var_os(name).filter(|value| !value.is_empty());
        value.map(PathBuf::from)
    };
    let uid = nix::unistd::getuid();
    match (variable("RCC_RUNTIME_DIR"), variable("XDG_RUNTIME_DIR")) {
        (Some(folder), _) => folder,
        (None, _) if uid.is_root() => PathBuf::from("/run/rcc"),
        (None, Some(session)) => session.join("rcc"),
        (None, None) => PathBuf::from(format!("/tmp/rcc-{uid}")),
    }
}

impl LoaderClient {
    /// Creates a client of the cell `cell` that uses the Unix socket `socket`; each request takes at most `timeout`.
    ///
    /// # Errors
    /// Fails if the system cannot create an event queue.
    pub fn new(cell: &str, socket: &Path, timeout: Duration) -> Result<LoaderClient, RequestError> {
        LoaderClient::with_endpoint(cell, Endpoint::Socket(socket.to_owned()), timeout)
    }

    /// Creates a client of a cell of this machine, which need not run; each request takes at most `timeout`.
    ///
    /// # Errors
    /// As [`LoaderClient::new`].
    pub fn local(cell: &str, timeout: Duration) -> Result<LoaderClient, RequestError> {
        let socket = runtime_folder().join(cell).join("loader.sock");
        LoaderClient::new(cell, &socket, timeout)
    }

    /// Creates a client that reaches the loader over TCP.
    ///
    /// # Errors
    /// As [`LoaderClient::new`].
    pub fn remote(remote: RemoteLoader, timeout: Duration) -> Result<LoaderClient, RequestError> {
        let cell = remote.authority.clone();
        LoaderClient::with_endpoint(&cell, Endpoint::Tcp(remote), timeout)
    }

    /// Creates another client of the same loader, for another thread.
    pub(crate) fn another(&self, timeout: Duration) -> Result<LoaderClient, RequestError> {
        LoaderClient::with_endpoint(&self.cell, self.endpoint.clone(), timeout)
    }

    fn with_endpoint(
        cell: &str,
        endpoint: Endpoint,
        timeout: Duration,
    ) -> Result<LoaderClient, RequestError> {
        let runtime = Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|error| {
                RequestError::new(
                    codes::PROCESS_FAILED,
                    error.to_string(),
                    "close other programs to free resources",
                )
            })?;
        Ok(LoaderClient {
            cell: cell.to_owned(),
            endpoint,
            timeout,
            runtime,
        })
    }

    /// Sends a GET request.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached, does not answer in time, or refuses the request.
    pub fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, RequestError> {
        self.request(Method::GET, path, String::new())
    }

    /// Sends a POST request with a text body.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn post<T: DeserializeOwned>(&self, path: &str, body: String) -> Result<T, RequestError> {
        self.request(Method::POST, path, body)
    }

    /// Sends a PUT request with a text body.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn put<T: DeserializeOwned>(&self, path: &str, body: String) -> Result<T, RequestError> {
        self.request(Method::PUT, path, body)
    }

    /// LOAD: sends the text of a net, with the name of its file for diagnostics, and returns the command when it is ready or
    /// rejected; `loading` if it is neither after `limit`.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn load(
        &self,
        file: Option<&str>,
        text: &str,
        limit: Duration,
    ) -> Result<CommandView, RequestError> {
        let begun = Instant::now();
        let query = file.map_or(String::new(), |name| format!("&file={}", segment(name)));
        // The answer has to come in time.
        let wait = LOAD_WAIT.min(self.timeout / 2);
        let path = format!("/commands?wait_ms={}{query}", wait.as_millis());
        let Loaded { id, .. } = self.post(&path, text.to_owned())?;
        loop {
            let command: CommandView = self.get(&format!("/commands/{id}?brief=true"))?;
            if command.state != "loading" || begun.elapsed() > limit {
                return Ok(command);
            }
            std::thread::sleep(LOAD_POLL);
        }
    }

    /// Returns the values of the ports that match the patterns, all of one cycle; without patterns, the values of all
    /// outputs.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn values(&self, net: &str, ports: &[String]) -> Result<ValuesView, RequestError> {
        let path = format!("/commands/{}/values", segment(net));
        let ports: Vec<String> = ports.iter().map(|port| segment(port)).collect();
        let query = if ports.is_empty() { "" } else { "?ports=" };
        self.get(&format!("{path}{query}{}", ports.join(",")))
    }

    /// Sends a DELETE request.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn delete<T: DeserializeOwned>(&self, path: &str) -> Result<T, RequestError> {
        self.request(Method::DELETE, path, String::new())
    }

    fn request<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: String,
    ) -> Result<T, RequestError> {
        let bytes = self.answer(method, path, body)?;
        serde_json::from_slice(&bytes).map_err(|error| answer_not_understood(&error))
    }

    /// Returns the body of a successful answer. Not generic: compiled once.
    fn answer(&self, method: Method, path: &str, body: String) -> Result<Bytes, RequestError> {
        let exchange = self.exchange(method, path, body);
        let answer = self
            .runtime
            .block_on(async { tokio::time::timeout(self.timeout, exchange).await });
        let (status, bytes) = match answer {
            Ok(Ok(answer)) => answer,
            Ok(Err(cause)) => return Err(self.unreachable(&cause)),
            Err(_) => {
                return Err(RequestError::new(
                    codes::LOADER_SILENT,
                    format!(
                        "the loader of cell `{}` did not answer within {:?}",
                        self.cell, self.timeout
                    ),
                    timeout_help(path),
                ));
            }
        };
        if status.is_success() {
            return Ok(bytes);
        }
        let body: ErrorBody =
            serde_json::from_slice(&bytes).map_err(|error| answer_not_understood(&error))?;
        Err(RequestError::from_server(body))
    }

    async fn exchange(
        &self,
        method: Method,
        path: &str,
        body: String,
    ) -> io::Result<(StatusCode, Bytes)> {
        let mut request = Request::builder().method(method).uri(path);
        let time = u64::try_from(self.timeout.as_millis()).unwrap_or(u64::MAX);
        request = request.header(TIMEOUT_HEADER, time);
        match &self.endpoint {
            Endpoint::Socket(socket) => {
                let stream = UnixStream::connect(socket).await?;
                send(stream, request.header("host", "rcc"), body).await
            }
            Endpoint::Tcp(remote) => {
                let stream = TcpStream::connect(&remote.authority).await?;
                if let Some(token) = &remote.authorization {
                    request = request.header("authorization", token.as_slice());
                }
                send(stream, request.header("host", &remote.authority), body).await
            }
        }
    }

    fn unreachable(&self, cause: &io::Error) -> RequestError {
        let cell = &self.cell;
        match &self.endpoint {
            Endpoint::Socket(socket) if cause.kind() == io::ErrorKind::PermissionDenied => {
                let owner = socket.parent().and_then(|folder| folder.metadata().ok());
                let owner =
                    owner.map_or_else(|| "another user".to_owned(), |folder| person(folder.uid()));
                RequestError::new(
                    codes::NOT_PERMITTED,
                    format!(
                        "cell `{cell}` belongs to {owner}: permission denied: {}",
                        socket.display()
                    ),
                    "work as that user, or join the group named by its `access` setting",
                )
            }
            Endpoint::Socket(_) => no_loader(cell, &format!(" ({cause})")),
            Endpoint::Tcp(remote) => RequestError::new(
                codes::NO_LOADER,
                format!("no loader answers at {} ({cause})", remote.authority),
                "start the cell with `access: {tcp: …}`; use `ssh -L` through a firewall",
            ),
        }
    }
}

/// Returns the help text for a request that was sent but not answered in time.
fn timeout_help(path: &str) -> &'static str {
    match is_stop(path) {
        true => {
            "the request was sent but is not confirmed yet: the loader still carries it out as soon as it can; \
             check with `rcc-cli state NAME`; repeating the request is harmless"
        }
        false => {
            "the request is dropped unless the loader had already started it: check with `rcc-cli state`; allow more time with --timeout"
        }
    }
}

/// Sends one request over a connection of its own.
async fn send(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    request: hyper::http::request::Builder,
    body: String,
) -> io::Result<(StatusCode, Bytes)> {
    let (mut sender, connection) = hyper::client::conn::http1::handshake(TokioIo::new(stream))
        .await
        .map_err(io::Error::other)?;
    // The connection task ends with the connection, which closes when `sender` is dropped.
    let driven = tokio::spawn(connection);
    let request = request
        .body(Full::new(Bytes::from(body)))
        .map_err(io::Error::other)?;
    let response = sender
        .send_request(request)
        .await
        .map_err(io::Error::other)?;
    let status = response.status();
    let bytes = response
        .into_body()
        .collect()
        .await
        .map_err(io::Error::other)?
        .to_bytes();
    driven.abort();
    Ok((status, bytes))
}

/// Returns the failure for a cell whose loader cannot be reached.
#[must_use]
pub fn no_loader(cell: &str, cause: &str) -> RequestError {
    RequestError::new(
        codes::NO_LOADER,
        format!("cannot reach the loader of cell `{cell}`{cause}"),
        "start the cell with `rcc-cli up FILE`, or name another cell with --cell (RCC_CELL)",
    )
}

fn answer_not_understood(error: &dyn std::fmt::Display) -> RequestError {
    RequestError::new(
        codes::OTHER_BUILD,
        format!("cannot parse the loader's answer: {error}"),
        "install this program and rcc-loader from the same build",
    )
}

/// Describes a user for people: `user rcc (uid 998)`.
fn person(uid: u32) -> String {
    let found = nix::unistd::User::from_uid(nix::unistd::Uid::from_raw(uid));
    match found.ok().flatten() {
        Some(user) => format!("user {} (uid {uid})", user.name),
        None => format!("a user without a name (uid {uid})"),
    }
}

/// Percent-encodes a name as one path segment (RFC 3986, section 2.1).
#[must_use]
pub fn segment(name: &str) -> String {
    let mut out = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            out.push(char::from(byte));
        } else {
            out.push_str(&format!("%{byte:02X}"));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_becomes_one_segment() {
        assert_eq!(segment("line#7"), "line%237");
        assert_eq!(segment("a/../b?"), "a%2F..%2Fb%3F");
    }

    #[test]
    fn a_timed_out_stop_request_is_reported_as_still_pending() {
        for path in ["/commands/line%237/cancel", "/commands/7/abort"] {
            assert!(timeout_help(path).contains("not confirmed yet"), "{path}");
        }
        for path in ["/commands/7/start", "/commands", "/switch"] {
            assert!(
                timeout_help(path).contains("the request is dropped"),
                "{path}"
            );
        }
    }

    #[test]
    fn an_address_is_http_with_host_and_port() {
        for good in [
            "http://127.0.0.1:7425",
            "http://[::1]:80/",
            "http://robot:7425",
        ] {
            assert!(RemoteLoader::new(good, None, None).is_ok(), "{good}");
        }
        for bad in [
            "https://robot:7425",
            "http://robot",
            "robot:7425",
            "http://a@b:80",
            "http://robot:80/x",
            "http://:x",
        ] {
            let refused = RemoteLoader::new(bad, None, None).map_err(|error| error.exit);
            assert!(matches!(refused, Err(2)), "{bad}");
        }
        let remote = RemoteLoader::new("http://robot:1", None, Some("secret\n"));
        let shown = remote.map(|remote| (format!("{remote:?}"), remote.authorization));
        let wanted = (
            "RemoteLoader(robot:1)".to_owned(),
            Some(b"Bearer secret".to_vec()),
        );
        assert_eq!(shown.ok(), Some(wanted));
    }

    #[test]
    fn a_socket_that_is_not_there_is_an_unreachable_loader() -> Result<(), RequestError> {
        let name = format!("rcc-no-such-{}.sock", std::process::id());
        let path = std::env::temp_dir().join(name);
        let client = LoaderClient::new("x", &path, Duration::from_secs(20))?;
        let failed = client.get::<serde_json::Value>("/status");
        assert_eq!(
            failed.map_err(|error| (error.exit, error.body.code)),
            Err((4, "RCC4004".to_owned()))
        );
        Ok(())
    }
}
