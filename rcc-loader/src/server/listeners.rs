//! Opens the doors that a cell's configuration asks for, with their locks, and serves them.
//! Opened once by the main thread, before it serves.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::os::unix::net::UnixListener;

use axum::Router;
use nix::unistd::Group;
use rcc_config::AccessConfig;
use rcc_ipc::events::EventRecorder;
use rcc_ipc::{Cell, CellError};

use super::connection::{self, Listener};
use super::socket::{self, SocketError};
use super::token::{Token, TokenError};

/// Why a door cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
    /// The system does not know the group.
    #[error("access: there is no group `{name}`: `groupadd {name}`, or name another one")]
    NoGroup {
        /// Its name.
        name: String,
    },
    /// The runtime folder cannot be given to the group.
    #[error("access: {source} (to give it to group `{group}`, be in that group or root)")]
    Folder {
        /// The group.
        group: String,
        /// What the system said.
        source: CellError,
    },
    /// The Unix socket.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The token.
    #[error("access: {0}")]
    Token(#[from] TokenError),
    /// The address cannot be listened on.
    #[error(
        "access: {address}: {source}; choose another address or port, or end what listens there"
    )]
    Address {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
}

impl ListenError {
    /// True if only another configuration helps, and starting again does not.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(
            self,
            ListenError::NoGroup { .. } | ListenError::Folder { .. } | ListenError::Token(_)
        )
    }
}

/// The open doors of a cell.
#[derive(Debug)]
pub struct Listeners {
    unix: UnixListener,
    tcp: Option<(TcpListener, Token)>,
    recorder: Option<EventRecorder>,
}

impl Listeners {
    /// Opens them. Call it while holding the loader's announcement.
    ///
    /// # Errors
    /// A group, token or address that cannot be used; then no door is open.
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

    /// Tells of clients that are cut off in the cell's event log, too.
    #[must_use]
    pub fn with_event_log(mut self, recorder: EventRecorder) -> Listeners {
        self.recorder = Some(recorder);
        self
    }

    /// Where the TCP door is.
    #[must_use]
    pub fn address(&self) -> Option<SocketAddr> {
        self.tcp
            .as_ref()
            .and_then(|(listener, _)| listener.local_addr().ok())
    }

    /// Serves all doors, for ever.
    ///
    /// # Errors
    /// The event queue does not take a listener.
    pub async fn serve(self, router: Router) -> io::Result<()> {
        let unix = Listener::Unix(tokio::net::UnixListener::from_std(self.unix)?);
        let log = self.recorder;
        let unix = connection::serve(unix, connection::UNIX, None, log.clone(), router.clone());
        match self.tcp {
            Some((listener, token)) => {
                let tcp = Listener::Tcp(tokio::net::TcpListener::from_std(listener)?);
                let tcp = connection::serve(tcp, connection::TCP, Some(token), log, router);
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
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    Ok(listener)
}
