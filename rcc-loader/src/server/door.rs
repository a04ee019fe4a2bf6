//! The doors of the loader: a Unix socket, and TCP if it is configured. One request a connection, each bounded in size
//! and time, so many connections and requests a second for each peer; whoever asks too much is answered with words, cut
//! off and told in the log, while the others are served. Run by the one thread that serves connections.

use std::collections::HashMap;
use std::convert::Infallible;
use std::fmt;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::Router;
use axum::http::StatusCode;
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::seldom::Seldom;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, UnixListener};
use tokio::time::timeout;

use super::codes;
use super::error::ApiError;
use super::head::{self, Rewound};
use super::token::Token;

/// Longest head of a request, bytes.
pub const HEAD_MAX: usize = 16 << 10;
/// Most lines in a head.
pub const HEADERS_MAX: usize = 64;
/// So long the head of a request may take, from the connection on.
pub const HEAD_TIME: Duration = Duration::from_secs(2);
/// So long a whole connection may take: request, work, and the client's taking the answer.
pub const CONNECTION_TIME: Duration = Duration::from_secs(20);
/// So long, and so many bytes, a client that was answered early may go on talking: an answer would get lost otherwise.
const LINGER: (Duration, u64) = (Duration::from_millis(500), 1 << 20);
/// Peers that are remembered; beyond, those without a connection are forgotten.
const PEERS_MAX: usize = 1024;
/// Pause after the system gave no connection (no free descriptor).
const ACCEPT_AGAIN: Duration = Duration::from_millis(50);

/// How much a door lets in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at a time.
    pub connections: usize,
    /// Connections of one peer at a time.
    pub connections_of_peer: usize,
    /// Requests of one peer a second, on average.
    pub rate: u32,
    /// Requests of one peer at once, after a quiet time.
    pub burst: u32,
}

/// A peer on the Unix socket is a process.
pub const UNIX: Limits = Limits {
    connections: 64,
    connections_of_peer: 16,
    rate: 1000,
    burst: 2000,
};
/// A peer on TCP is an address.
pub const TCP: Limits = Limits {
    connections: 32,
    connections_of_peer: 8,
    rate: 100,
    burst: 200,
};

/// Where connections come from.
#[derive(Debug)]
pub enum Listener {
    /// The cell's socket.
    Unix(UnixListener),
    /// An address.
    Tcp(TcpListener),
}

/// Who comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Peer {
    Process(i32),
    Address(IpAddr),
}

impl fmt::Display for Peer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Peer::Process(pid) => write!(formatter, "process {pid}"),
            Peer::Address(address) => address.fmt(formatter),
        }
    }
}

/// What a door remembers of a peer.
struct Account {
    connections: usize,
    /// Requests that it may still make at once.
    credit: f64,
    counted: Instant,
}

#[derive(Default)]
struct Accounts {
    connections: usize,
    peers: HashMap<Peer, Account>,
    complaints: Seldom,
}

/// A door.
struct Door {
    limits: Limits,
    token: Option<Token>,
    accounts: Mutex<Accounts>,
    recorder: Option<Recorder>,
}

/// A connection that is counted until it is dropped.
struct Place {
    door: Arc<Door>,
    peer: Peer,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut accounts = self.door.accounts();
        accounts.connections -= 1;
        if let Some(account) = accounts.peers.get_mut(&self.peer) {
            account.connections -= 1;
        }
    }
}

impl Door {
    fn accounts(&self) -> MutexGuard<'_, Accounts> {
        // A panic in another task leaves numbers, and those are whole.
        self.accounts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a connection of this peer, if it has one left.
    fn admit(self: &Arc<Door>, peer: Peer, now: Instant) -> Result<Place, ApiError> {
        let Limits {
            connections,
            connections_of_peer,
            rate,
            burst,
        } = self.limits;
        let mut accounts = self.accounts();
        if accounts.connections >= connections {
            return Err(too_many(format!("{connections} connections are open")));
        }
        if accounts.peers.len() >= PEERS_MAX {
            accounts.peers.retain(|_, account| account.connections > 0);
        }
        let account = accounts.peers.entry(peer).or_insert(Account {
            connections: 0,
            credit: f64::from(burst),
            counted: now,
        });
        if account.connections >= connections_of_peer {
            return Err(too_many(format!(
                "{connections_of_peer} connections of {peer} are open"
            )));
        }
        let earned = now.saturating_duration_since(account.counted).as_secs_f64() * f64::from(rate);
        account.credit = (account.credit + earned).min(f64::from(burst));
        account.counted = now;
        if account.credit < 1.0 {
            return Err(too_many(format!(
                "{peer} asks more than {rate} times a second"
            )));
        }
        account.credit -= 1.0;
        account.connections += 1;
        accounts.connections += 1;
        Ok(Place {
            door: Arc::clone(self),
            peer,
        })
    }

    fn complain(&self, peer: Peer, error: &ApiError) {
        let said = self.accounts().complaints.say(Instant::now());
        if let Some(others) = said {
            let (code, message) = (error.code.code, &error.message);
            tracing::warn!(%peer, code, others, "cut off: {message}");
            if let Some(recorder) = &self.recorder {
                recorder.tell(Kind::ClientCutOff {
                    client: peer.to_string(),
                    why: events::text(&format!("{code} {message}")),
                });
            }
        }
    }
}

fn too_many(what: String) -> ApiError {
    let message = format!("{what}, more are not taken");
    ApiError::new(
        codes::TOO_MANY,
        message,
        "try again in a moment, less often",
    )
}

/// Serves one door for ever. Over TCP nobody gets in without the token.
pub async fn serve(
    listener: Listener,
    limits: Limits,
    token: Option<Token>,
    recorder: Option<Recorder>,
    router: Router,
) -> Infallible {
    let door = Arc::new(Door {
        limits,
        token,
        accounts: Mutex::default(),
        recorder,
    });
    loop {
        let accepted = match &listener {
            Listener::Unix(listener) => listener.accept().await.map(|(stream, _)| {
                let pid = stream.peer_cred().ok().and_then(|peer| peer.pid());
                greet(&door, Peer::Process(pid.unwrap_or(0)), stream, &router);
            }),
            Listener::Tcp(listener) => listener.accept().await.map(|(stream, address)| {
                greet(&door, Peer::Address(address.ip()), stream, &router);
            }),
        };
        if let Err(error) = accepted {
            tracing::warn!(%error, "no connection can be taken");
            tokio::time::sleep(ACCEPT_AGAIN).await;
        }
    }
}

/// Gives a connection a task of its own, or sends it away.
fn greet<I>(door: &Arc<Door>, peer: Peer, mut io: I, router: &Router)
where
    I: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    match door.admit(peer, Instant::now()) {
        Ok(place) => {
            let router = router.clone();
            tokio::spawn(async move {
                if timeout(CONNECTION_TIME, converse(&place, io, router))
                    .await
                    .is_err()
                {
                    let what = format!("the connection took longer than {CONNECTION_TIME:?}");
                    place.door.complain(peer, &too_slow(what));
                }
            });
        }
        Err(error) => {
            door.complain(peer, &error);
            // What goes into the socket's buffer at once is said; nobody is waited for.
            let text = raw(&error);
            let mut context = std::task::Context::from_waker(std::task::Waker::noop());
            let _ = std::pin::Pin::new(&mut io).poll_write(&mut context, &text);
        }
    }
}

/// One request and its answer.
async fn converse<I>(place: &Place, mut io: I, router: Router)
where
    I: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let head = match timeout(HEAD_TIME, head::read(&mut io)).await {
        Ok(Ok(Some(head))) if place.door.lets_in(head.bearer.as_deref()) => head,
        Ok(Ok(Some(_))) => return refuse(place, io, &no_token()).await,
        Ok(Ok(None)) => return,
        Ok(Err(error)) => return refuse(place, io, &error).await,
        Err(_) => {
            let what = format!("the head of the request took longer than {HEAD_TIME:?}");
            return refuse(place, io, &too_slow(what)).await;
        }
    };
    let mut server = hyper::server::conn::http1::Builder::new();
    server
        .keep_alive(false)
        // It would panic while the wall clock shows a time before 1970; RFC 9110 (6.6.1) wants none without a clock.
        .auto_date_header(false)
        .max_headers(HEADERS_MAX)
        .header_read_timeout(None);
    let io = TokioIo::new(Rewound::new(head.bytes, io));
    let connection = server.serve_connection(io, TowerToHyperService::new(router));
    // An error is a client that went away: there is nobody to tell.
    if let Ok(parts) = connection.without_shutdown().await {
        linger(parts.io.into_inner().io).await;
    }
}

impl Door {
    fn lets_in(&self, bearer: Option<&[u8]>) -> bool {
        let token = self.token.as_ref();
        token.is_none_or(|token| token.is(bearer.unwrap_or_default()))
    }
}

fn too_slow(what: String) -> ApiError {
    ApiError::new(codes::TOO_SLOW, what, "send the whole request at once")
}

fn no_token() -> ApiError {
    ApiError::new(
        codes::NO_TOKEN,
        "this door takes only requests with the cell's token, and this is not it",
        "`rcc-cli --token-file FILE`, or RCC_TOKEN; in HTTP: `authorization: Bearer TOKEN`",
    )
}

async fn refuse<I: AsyncRead + AsyncWrite + Unpin>(place: &Place, mut io: I, error: &ApiError) {
    place.door.complain(place.peer, error);
    if io.write_all(&raw(error)).await.is_ok() {
        linger(io).await;
    }
}

/// An answer without an HTTP library: status, code and words.
fn raw(error: &ApiError) -> Vec<u8> {
    let status = StatusCode::from_u16(error.code.status).unwrap_or(StatusCode::BAD_REQUEST);
    // Strings and a list: this cannot fail.
    let body = serde_json::to_string(&error.body()).unwrap_or_default();
    let challenge = if status == StatusCode::UNAUTHORIZED {
        "www-authenticate: Bearer\r\n"
    } else {
        ""
    };
    let length = body.len();
    format!(
        "HTTP/1.1 {status}\r\ncontent-type: application/json\r\n{challenge}connection: close\r\n\
         content-length: {length}\r\n\r\n{body}"
    )
    .into_bytes()
}

/// Ends our side and takes what is still coming, for a short time: closing at once would make the system throw away
/// what the client has not read yet.
async fn linger<I: AsyncRead + AsyncWrite + Unpin>(mut io: I) {
    let (time, bytes) = LINGER;
    // A client that is gone already, or goes on talking, is not our concern any more.
    let _ = timeout(time, async {
        io.shutdown().await?;
        tokio::io::copy(&mut (&mut io).take(bytes), &mut tokio::io::sink()).await
    })
    .await;
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits {
        connections: 3,
        connections_of_peer: 2,
        rate: 10,
        burst: 5,
    };

    fn door() -> Arc<Door> {
        Arc::new(Door {
            limits: LIMITS,
            token: None,
            accounts: Mutex::default(),
            recorder: None,
        })
    }

    #[test]
    fn a_peer_has_so_many_connections_and_others_still_have_theirs() {
        let (door, now) = (door(), Instant::now());
        let one = door.admit(Peer::Process(1), now);
        let _two = door.admit(Peer::Process(1), now);
        assert!(door.admit(Peer::Process(1), now).is_err());
        let _other = door.admit(Peer::Process(2), now);
        assert!(
            door.admit(Peer::Process(3), now).is_err(),
            "the door is full"
        );
        drop(one);
        assert!(door.admit(Peer::Process(3), now).is_ok());
    }

    #[test]
    fn a_peer_makes_so_many_requests_a_second_and_others_theirs() {
        let (door, now) = (door(), Instant::now());
        let peer = Peer::Address(IpAddr::from([127, 0, 0, 1]));
        let admitted = |now| (0..100).filter(|_| door.admit(peer, now).is_ok()).count();
        assert_eq!(admitted(now), 5, "the burst");
        assert_eq!(admitted(now + Duration::from_millis(200)), 2, "10 a second");
        assert!(door.admit(Peer::Process(2), now).is_ok());
        assert_eq!(
            admitted(now + Duration::from_secs(3600)),
            5,
            "no more than the burst"
        );
    }

    #[test]
    fn peers_without_connections_are_forgotten() {
        let (door, now) = (door(), Instant::now());
        let _kept = door.admit(Peer::Process(-1), now);
        for pid in 0..3000 {
            drop(door.admit(Peer::Process(pid), now));
        }
        let accounts = door.accounts();
        assert!(accounts.peers.len() <= PEERS_MAX && accounts.connections == 1);
        assert!(accounts.peers.contains_key(&Peer::Process(-1)));
    }
}
