//! Access to a cell beyond the user that runs it: a group on the Unix socket, token holders on TCP; nobody by default.
//! Read at start-up by the loader, which creates the listeners.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use crate::codes;
use crate::diagnostic::Span;
use crate::ports;
use crate::reader::{ConfigReader, Fields, error};
use crate::yaml::{Entry, Node};

pub(crate) const KEYS: [&str; 2] = ["group", "tcp"];
const TCP_KEYS: [&str; 3] = ["listen", "token_file", "allow_remote"];

/// Access to a cell for others than its owner.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AccessConfig {
    /// Group whose members may use the Unix socket; `None`: only the user that runs the cell.
    pub group: Option<String>,
    /// TCP access; `None`: no TCP.
    pub tcp: Option<TcpAccess>,
}

/// Access for programs on other machines, or of other users.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TcpAccess {
    /// Numeric address and port to listen on.
    pub listen: SocketAddr,
    /// File that contains the token.
    pub token_file: PathBuf,
}

/// Reads the key `access` of a cell; relative paths start at `base`.
pub(crate) fn read(
    reader: &mut ConfigReader,
    cell: &Fields<'_>,
    base: &Path,
    ports: &BTreeMap<String, u16>,
) -> Option<AccessConfig> {
    let Some(Entry { key, value }) = cell.entry("access") else {
        return Some(AccessConfig::default());
    };
    let fields = reader.fields(value, key.span, "access", &KEYS)?;
    let group = match fields.get("group") {
        Some(node) => Some(reader.text(node, "the group")?.to_owned()),
        None => None,
    };
    let tcp = match fields.entry("tcp") {
        Some(Entry { key, value }) => Some(tcp(reader, value, key.span, base, ports)?),
        None => None,
    };
    Some(AccessConfig { group, tcp })
}

fn tcp(
    reader: &mut ConfigReader,
    node: &Node,
    place: Span,
    base: &Path,
    ports: &BTreeMap<String, u16>,
) -> Option<TcpAccess> {
    let fields = reader.fields(node, place, "tcp", &TCP_KEYS)?;
    let remote = match fields.get("allow_remote") {
        Some(node) => reader.bool(node, "allow_remote"),
        None => Some(false),
    };
    let token_file = reader.require(&fields, "token_file");
    let token_file = token_file.and_then(|node| reader.text(node, "token_file"));
    let listen = reader.require(&fields, "listen").and_then(|node| {
        let text = reader.text(node, "listen")?;
        let text = ports::substitute(reader, text, node.span, ports)?;
        address(reader, node, &text, remote?)
    });
    Some(TcpAccess {
        listen: listen?,
        token_file: base.join(token_file?),
    })
}

fn address(reader: &mut ConfigReader, node: &Node, text: &str, remote: bool) -> Option<SocketAddr> {
    let Ok(address) = text.parse::<SocketAddr>() else {
        let message = format!("`{text}` is not an address with a port");
        let help = "write both as numbers: `127.0.0.1:7425`, `[::1]:7425`";
        reader.report(error(codes::BAD_ADDRESS, node.span, message).help(help));
        return None;
    };
    if remote || address.ip().is_loopback() {
        return Some(address);
    }
    let message = format!("other machines can reach {}", address.ip());
    let help = "nothing is encrypted there: listen on 127.0.0.1 and come through ssh or a VPN, or write \
                `allow_remote: true` when the network itself is safe";
    reader.report(error(codes::REMOTE_ADDRESS, node.span, message).help(help));
    None
}
