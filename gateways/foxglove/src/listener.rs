//! Accepts clients. Run by the serving thread.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rcc_process::log_throttle::LogThrottle;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use crate::connection;
use crate::server::Server;

/// Connections, including those that have not shown a token yet.
const CONNECTIONS_MAX: usize = 64;
/// Pause after a connection could not be accepted, for lack of file descriptors.
const ACCEPT_AGAIN: Duration = Duration::from_millis(100);
/// Time in which clients are told the end.
const CLOSE_MAX: Duration = Duration::from_secs(1);

/// Serves until `end` is ready; then every client is told.
pub async fn serve(server: &Arc<Server>, listener: TcpListener, end: impl Future<Output = ()>) {
    let mut connections = JoinSet::new();
    let refusals = Arc::new(Mutex::new(LogThrottle::default()));
    let places = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    let watch = tokio::spawn(Arc::clone(server).watch_parameters());
    tokio::pin!(end);
    loop {
        tokio::select! {
            () = &mut end => break,
            accepted = listener.accept() => match accepted {
                Ok((stream, peer)) => {
                    // Without a place the connection is closed at once.
                    let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
                    let (server, refusals) = (Arc::clone(server), Arc::clone(&refusals));
                    connections.spawn(async move {
                        connection(&server, stream, peer, &refusals).await;
                        drop(place);
                    });
                }
                Err(error) => {
                    tracing::warn!(%error, "a connection cannot be accepted");
                    tokio::time::sleep(ACCEPT_AGAIN).await;
                }
            },
            Some(_) = connections.join_next() => {}
        }
    }
    watch.abort();
    server.viewers.close();
    let all = async { while connections.join_next().await.is_some() {} };
    // A client that takes longer is disconnected.
    let _ = tokio::time::timeout(CLOSE_MAX, all).await;
}

/// Runs one connection, and logs the reason if it was refused or lost.
async fn connection(
    server: &Arc<Server>,
    stream: TcpStream,
    peer: SocketAddr,
    refusals: &Mutex<LogThrottle>,
) {
    let ended = connection::run(server, stream).await;
    if let Err(error) = ended {
        let mut refusals = refusals.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(others) = refusals.admit(Instant::now()) {
            tracing::warn!(%peer, others, "{error}");
        }
    }
}
