//! A control port: a TCP server on which each line is a request and gets one line as its answer.
//! One thread accepts, one thread serves each connection; none of them ever touches a simulator's clock thread.

use rcc_process::signals::request_stop;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;

/// Longest line that is read, in bytes.
const LINE_MAX: u64 = 64 * 1024;

/// What follows a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// The answer, without the line's end.
    pub line: String,
    /// The process ends once the answer is sent.
    pub stop: bool,
}

/// Answers one line, which comes without its end.
pub type Answer = Arc<dyn Fn(&str) -> Reply + Send + Sync>;

/// Serves `answer` at `address` for the rest of the process's life; returns the address that was really taken.
///
/// # Errors
/// The address cannot be used, or the system gives no thread.
pub fn serve(address: SocketAddr, answer: Answer) -> io::Result<SocketAddr> {
    let listener = TcpListener::bind(address)?;
    let bound = listener.local_addr()?;
    thread::Builder::new()
        .name("control".into())
        .spawn(move || {
            for stream in listener.incoming() {
                let answer = answer.clone();
                let served = stream.and_then(|stream| {
                    let serve = move || converse(stream, &answer);
                    thread::Builder::new()
                        .name("control-client".into())
                        .spawn(serve)
                });
                if let Err(error) = served {
                    tracing::warn!(%error, "a control connection was not served");
                }
            }
        })?;
    Ok(bound)
}

/// Until the client hangs up, says something too long, or does not read.
fn converse(stream: TcpStream, answer: &Answer) {
    let end = answer_lines(stream, answer);
    if let Err(error) = end {
        tracing::debug!(%error, "a control connection ended");
    }
}

fn answer_lines(stream: TcpStream, answer: &Answer) -> io::Result<()> {
    stream.set_nodelay(true)?;
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
        let Reply {
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

/// Says the same to a client that is served in [`serve`]: one request, one answer.
///
/// # Errors
/// The server is gone or hangs up.
pub fn ask(stream: &mut BufReader<TcpStream>, request: &str) -> io::Result<String> {
    stream
        .get_mut()
        .write_all(format!("{request}\n").as_bytes())?;
    let mut reply = String::new();
    if stream.read_line(&mut reply)? == 0 {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(reply)
}
