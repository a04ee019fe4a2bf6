//! Opens the listeners that a cell's configuration asks for, with their access control, and serves them. Opened once by
//! the main thread, before it serves.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::os::unix::net::UnixListener;

use axum::Router;
use nix::unistd::Group;
use rcc_api::token::{Token, TokenError};
use rcc_config::AccessConfig;
use rcc_ipc::events::EventRecorder;
use rcc_ipc::{Cell, CellError};
use tokio::runtime::Handle;

use super::connection::{self, Listener};
use super::socket::{self, SocketError};

/// The reason why a listener cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
    /// The group does not exist.
    #[error("access: group `{name}` not found: create it (`groupadd {name}`), or name another one")]
    NoGroup {
        /// Name of the group.
        name: String,
    },
    /// The runtime folder cannot be opened to the group.
    #[error(
        "access: {source}: the loader must be a member of group `{group}`, or root, to open the folder to that group"
    )]
    Folder {
        /// The group.
        group: String,
        /// The system's error.
        source: CellError,
    },
    /// The Unix socket cannot be created.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The token cannot be used.
    #[error("access: {0}")]
    Token(#[from] TokenError),
    /// Listening on the address failed.
    #[error(
        "access: cannot listen on {address}: {source}; choose another address or port, or stop the program that uses it"
    )]
    Address {
        /// The address.
        address: SocketAddr,
        /// The system's error.
        source: io::Error,
    },
}

impl ListenError {
    /// Returns true if only a change of the configuration helps, not a restart.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(
            self,
            ListenError::NoGroup { .. } | ListenError::Folder { .. } | ListenError::Token(_)
        )
    }
}

/// The open listeners of a cell.
#[derive(Debug)]
pub struct Listeners {
    unix: UnixListener,
    tcp: Option<(TcpListener, Token)>,
    recorder: Option<EventRecorder>,
}

impl Listeners {
    /// Opens the listeners. Call it while holding the loader's announcement.
    ///
    /// # Errors
    /// Returns an error if the group, the token or the address cannot be used; no listener is open then.
    pub fn open(cell: &Cell, access: &AccessConfig) -> Result<Listeners, ListenError> {
        let group = access.group.as_deref().map(group_of).transpose()?;
        let tcp = match &access.tcp {
            Some(tcp) => {
                let token = Token::read(&tcp.token_file)?;
                Some((listen(tcp.listen)?, token))
            }
            None => None,
        };
        cell.open_to_group(group)
            .map_err(|source| ListenError::Folder {
                group: access.group.clone().unwrap_or_default(),
                source,
            })?;
        let unix = socket::listen(&cell.socket(), group)?;
        let recorder = None;
        Ok(Listeners {
            unix,
            tcp,
            recorder,
        })
    }

    /// Also reports disconnected clients to the cell's event log.
    #[must_use]
    pub fn with_event_log(mut self, recorder: EventRecorder) -> Listeners {
        self.recorder = Some(recorder);
        self
    }

    /// Returns the address of the TCP listener, if there is one.
    #[must_use]
    pub fn address(&self) -> Option<SocketAddr> {
        self.tcp
            .as_ref()
            .and_then(|(listener, _)| listener.local_addr().ok())
    }

    /// Serves all listeners forever, all requests but CANCEL and ABORT on the thread of `serving`.
    ///
    /// # Errors
    /// Returns an error if a listener cannot be registered with the event queue.
    pub async fn serve(self, serving: Handle, router: Router) -> io::Result<()> {
        let unix = Listener::Unix(tokio::net::UnixListener::from_std(self.unix)?);
        let (log, to) = (self.recorder, (serving, router));
        let unix = connection::serve(unix, connection::UNIX, None, log.clone(), to.clone());
        match self.tcp {
            Some((listener, token)) => {
                let tcp = Listener::Tcp(tokio::net::TcpListener::from_std(listener)?);
                let tcp = connection::serve(tcp, connection::TCP, Some(token), log, to);
                tokio::select! {
                    never = unix => match never {},
                    never = tcp => match never {},
                }
            }
            None => match unix.await {},
        }
    }
}

fn group_of(name: &str) -> Result<u32, ListenError> {
    let found = Group::from_name(name).ok().flatten();
    found
        .map(|group| group.gid.as_raw())
        .ok_or_else(|| ListenError::NoGroup {
            name: name.to_owned(),
        })
}

fn listen(address: SocketAddr) -> Result<TcpListener, ListenError> {
    let failed = |source| ListenError::Address { address, source };
    let listener = rcc_os::socket::listen_tcp(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    Ok(listener)
}
