//! The port of the gateway: HTTP requests and upgraded connections. One thread accepts; each connection has a thread
//! that reads and, once it is upgraded, one that writes.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use nix::sys::socket::{setsockopt, sockopt};

use crate::devices::DeviceSpec;
use crate::gateway::Gateway;
use crate::http::{RequestError, RequestHead, decoded, form, read_body, read_head, write_answer};
use crate::outbox::Outbox;
use crate::requests::Dialogue;
use crate::websocket::{ACCEPT, CLIENT_KEY, ClientMessage, MessageReader, close_frame, pong_frame};

/// Most connections at a time; a client has two, and one more for each evaluation.
const CONNECTIONS_MAX: usize = 64;
/// Time for a request to come, and for an answer to be taken.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time without a sign of life after which TCP asks an upgraded connection for one, and time between two questions, s.
const PROBE_EVERY_S: u32 = 1;
/// Time without an acknowledgement, or with a full receive buffer, after which TCP ends an upgraded connection, ms. Longer
/// than short losses of a network; after longer ones the library connects again, within the session's time-out.
const UNANSWERED_MAX_MS: u32 = 4000;
const PLAIN: &str = "text/plain; charset=utf-8";

/// Accepts connections for ever.
pub fn serve(listener: &TcpListener, gateway: &Arc<Gateway>) {
    let open = Arc::new(AtomicUsize::new(0));
    loop {
        let stream = match listener.accept() {
            Ok((stream, _)) => stream,
            Err(error) => {
                // For example, too many open files: connections that end make room.
                tracing::warn!(%error, "cannot accept a connection");
                std::thread::sleep(Duration::from_millis(100));
                continue;
            }
        };
        if open.load(Ordering::Acquire) >= CONNECTIONS_MAX {
            refuse(stream);
            continue;
        }
        open.fetch_add(1, Ordering::AcqRel);
        let (gateway, counted) = (Arc::clone(gateway), Arc::clone(&open));
        let connection = move || {
            if let Err(error) = converse(stream, &gateway) {
                tracing::debug!(%error, "a connection has ended");
            }
            counted.fetch_sub(1, Ordering::AcqRel);
        };
        if let Err(error) = std::thread::Builder::new()
            .name("connection".to_owned())
            .spawn(connection)
        {
            open.fetch_sub(1, Ordering::AcqRel);
            tracing::warn!(%error, "cannot start a thread for a connection");
        }
    }
}

fn refuse(mut stream: TcpStream) {
    tracing::warn!("refused a connection: {CONNECTIONS_MAX} are open");
    // A client that does not read must not hold up others; the answer fits into the socket's buffer.
    let _ = stream.set_write_timeout(Some(Duration::from_millis(100)));
    let _ = write_answer(&mut stream, 503, PLAIN, "too many connections\n");
}

fn converse(mut stream: TcpStream, gateway: &Arc<Gateway>) -> Result<(), RequestError> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let head = match read_head(&mut stream) {
        Ok(head) => head,
        Err(error) => return answer_error(&mut stream, error),
    };
    if head.path == "/DirectIO/"
        && head
            .headers
            .get("upgrade")
            .is_some_and(|to| to.eq_ignore_ascii_case("websocket"))
    {
        return upgrade(stream, &head, gateway);
    }
    let body = match read_body(&head, &mut stream) {
        Ok(body) => String::from_utf8_lossy(&body).into_owned(),
        Err(error) => return answer_error(&mut stream, error),
    };
    let (status, content_type, text) = match (head.method.as_str(), head.path.trim_end_matches('/'))
    {
        ("POST", "/eval") => (200, "text/xml; charset=utf-8", evaluate(gateway, &body)),
        ("POST", "/devices") => {
            let (status, text) = change_device(gateway, &body);
            (status, PLAIN, text)
        }
        ("GET", path) if path.starts_with("/nets/") => {
            let name = path
                .strip_prefix("/nets/")
                .and_then(|rest| rest.split('/').next())
                .unwrap_or_default();
            let reason = format!(
                "the XML form of net '{name}' is not kept: the gateway has nets in DirectIONet only\n"
            );
            (404, PLAIN, reason)
        }
        _ => {
            let known = "this port has /DirectIO/ (WebSocket), POST /eval/ and POST /devices/\n";
            (404, PLAIN, known.to_owned())
        }
    };
    write_answer(&mut stream, status, content_type, &text)?;
    Ok(())
}

fn answer_error(stream: &mut TcpStream, error: RequestError) -> Result<(), RequestError> {
    let status = match error {
        RequestError::TooLong => 413,
        RequestError::Malformed => 400,
        RequestError::Ended(_) => return Err(error),
    };
    write_answer(stream, status, PLAIN, &format!("{error}\n"))?;
    Err(error)
}

/// Returns the document with the values of an evaluated net.
fn evaluate(gateway: &Gateway, body: &str) -> String {
    let text = form(body).get("dionet").map(|text| decoded(text));
    let values = match text {
        Some(text) => gateway.evaluate(&mut gateway.paced_loader(), &text),
        None => Err("the body has no dionet".to_owned()),
    };
    let values = values.unwrap_or_else(|reason| {
        tracing::warn!(reason, "an evaluation failed");
        vec![("error".to_owned(), reason)]
    });
    let data = values
        .into_iter()
        .map(|(key, value)| format!("<data key=\"{}\">{}</data>", escaped(&key), escaped(&value)));
    let data: String = data.collect();
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?><eval>{data}</eval>")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// Creates or removes a device; returns status and text.
fn change_device(gateway: &Gateway, body: &str) -> (u16, String) {
    // The library encodes nothing: a `+` is part of a number. Other clients may encode.
    let parameters = form(body).into_iter();
    let mut parameters: BTreeMap<String, String> = parameters
        .map(|(name, value)| (name, decoded(&value.replace('+', "%2B"))))
        .collect();
    let Some(name) = parameters.remove("name") else {
        return (400, "the body has no name\n".to_owned());
    };
    let done = match parameters.remove("action").as_deref() {
        Some("remove") => gateway.remove_device(&name).map(|()| 303),
        Some(other) => Err((400, format!("unknown action '{other}'"))),
        None => create_device(gateway, &name, parameters),
    };
    match done {
        Ok(status) => (status, String::new()),
        Err((status, reason)) => {
            tracing::warn!(device = name, reason, "a device was not changed");
            (status, format!("{reason}\n"))
        }
    }
}

fn create_device(
    gateway: &Gateway,
    name: &str,
    mut parameters: BTreeMap<String, String>,
) -> Result<u16, (u16, String)> {
    let ty = parameters
        .remove("type")
        .ok_or((400, "the body has no type".to_owned()))?;
    let (spec, unknown) =
        DeviceSpec::read(name, &ty, &parameters).map_err(|error| (400, error.to_string()))?;
    if !unknown.is_empty() {
        tracing::warn!(
            device = name,
            parameters = unknown.join(", "),
            "parameters without a meaning here"
        );
    }
    gateway.create_device(spec).map(|()| 201)
}

/// Lets TCP end a connection whose other side does not answer any more, as when its machine has lost power: no packet tells
/// of that. An idle connection is probed; for data that was sent, the limit is that of `TCP_USER_TIMEOUT`, which on Linux is
/// also the one for probes (`tcp(7)`).
fn end_when_unanswered(stream: &TcpStream) -> io::Result<()> {
    setsockopt(stream, sockopt::TcpKeepIdle, &PROBE_EVERY_S)?;
    setsockopt(stream, sockopt::TcpKeepInterval, &PROBE_EVERY_S)?;
    setsockopt(stream, sockopt::TcpUserTimeout, &UNANSWERED_MAX_MS)?;
    setsockopt(stream, sockopt::KeepAlive, &true)?;
    Ok(())
}

fn upgrade(
    mut stream: TcpStream,
    head: &RequestHead,
    gateway: &Arc<Gateway>,
) -> Result<(), RequestError> {
    let key = head.headers.get("sec-websocket-key").map(String::as_str);
    if key != Some(CLIENT_KEY) {
        let reason = format!(
            "this port speaks with the Robotics API, whose Sec-WebSocket-Key is always {CLIENT_KEY}\n"
        );
        write_answer(&mut stream, 400, PLAIN, &reason)?;
        return Ok(());
    }
    // The library compares the name of the header with its capitals. Nothing may follow before its first frame.
    let answer = format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {ACCEPT}\r\n\r\n"
    );
    stream.write_all(answer.as_bytes())?;
    // A data connection carries nothing while nothing changes.
    stream.set_read_timeout(None)?;
    end_when_unanswered(&stream)?;
    let number = gateway.state().number("connection");
    let (outbox, frames) = Outbox::new(number, Arc::new(stream.try_clone()?));
    let mut sink = stream.try_clone()?;
    let write = move || {
        for frame in frames {
            if sink.write_all(&frame).is_err() {
                break;
            }
        }
        // The reading thread then ends, too.
        let _ = sink.shutdown(std::net::Shutdown::Both);
    };
    std::thread::Builder::new()
        .name("writer".to_owned())
        .spawn(write)?;
    let mut dialogue = Dialogue::new(Arc::clone(gateway), outbox.clone());
    let mut reader = MessageReader::new(io::Read::chain(&*head.rest, io::BufReader::new(stream)));
    loop {
        match reader.read() {
            Ok(ClientMessage::Text(text)) => dialogue.answer(&text),
            Ok(ClientMessage::Ping(payload)) => outbox.send_frame(pong_frame(&payload)),
            Ok(ClientMessage::Close) => {
                outbox.send_frame(close_frame());
                return Ok(());
            }
            Err(error) => {
                tracing::info!(connection = number, %error, "a connection has ended");
                outbox.close();
                return Ok(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fake_loader::{connected_pair, socket};
    use crate::gateway::GatewayOptions;
    use nix::sys::socket::getsockopt;

    #[test]
    fn tcp_ends_an_upgraded_connection_whose_other_side_does_not_answer() {
        let folder = rcc_testing::folder();
        let options = GatewayOptions {
            session_timeout: PATIENCE,
        };
        let gateway = Arc::new(Gateway::new(options, socket(&folder), None));
        let (server, mut client) = connected_pair();
        let seen = server.try_clone().expect("a handle");
        let connection = std::thread::spawn(move || converse(server, &gateway));
        let head = format!(
            "GET /DirectIO/ HTTP/1.1\r\nUpgrade: websocket\r\nSec-WebSocket-Key: {CLIENT_KEY}\r\n\r\n"
        );
        client.write_all(head.as_bytes()).expect("a request");
        // The answer to a ping: the connection is served.
        client.write_all(b"\x89\x00").expect("a ping");
        let mut reader = io::BufReader::new(&client);
        let mut line = String::new();
        while line != "\r\n" {
            line.clear();
            io::BufRead::read_line(&mut reader, &mut line).expect("the head of an answer");
        }
        let mut pong = [0; 2];
        io::Read::read_exact(&mut reader, &mut pong).expect("a pong");
        assert_eq!(pong, [0x8a, 0]);
        assert!(getsockopt(&seen, sockopt::KeepAlive).expect("an option"));
        let seconds = [
            getsockopt(&seen, sockopt::TcpKeepIdle).expect("an option"),
            getsockopt(&seen, sockopt::TcpKeepInterval).expect("an option"),
        ];
        assert_eq!(seconds, [PROBE_EVERY_S; 2]);
        let unanswered = getsockopt(&seen, sockopt::TcpUserTimeout).expect("an option");
        assert_eq!(unanswered, UNANSWERED_MAX_MS);
        client
            .shutdown(std::net::Shutdown::Both)
            .expect("a connection");
        let ended = connection.join().expect("no panic");
        ended.expect("an upgraded connection");
    }
}
