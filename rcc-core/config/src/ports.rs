//! Network ports of a cell: fixed numbers, or numbers chosen when the cell is started. Used by the program that starts
//! a cell and by every process that reads the cell's file; never real-time.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::path::Path;
use std::str::FromStr;

use crate::codes;
use crate::diagnostic::{Diagnostic, Faults, Span, closest};
use crate::reader::{ConfigReader, ID, error};
use crate::yaml::{Node, Value};

/// Transport protocol of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// Datagrams.
    Udp,
    /// Streams.
    Tcp,
}

/// Returns a port of 127.0.0.1 that was free a moment ago, chosen by the system from its ephemeral range. Another
/// process can take it first; binding then fails, and the cell must be started again.
///
/// # Errors
/// Returns an error if the system has no free port or forbids sockets.
pub fn free_port(protocol: Protocol) -> io::Result<u16> {
    let any = (Ipv4Addr::LOCALHOST, 0);
    let address = match protocol {
        Protocol::Udp => UdpSocket::bind(any)?.local_addr()?,
        Protocol::Tcp => TcpListener::bind(any)?.local_addr()?,
    };
    Ok(address.port())
}

/// `name=number` on a command line: a port number chosen by the program that started the cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortArgument {
    /// Name of the port in the cell's file.
    pub name: String,
    /// Port number.
    pub number: u16,
}

/// The text is not `name=number`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("invalid port `{given}`: write name=number, for example fri=49938")]
pub struct PortArgumentError {
    /// The given text.
    pub given: String,
}

impl FromStr for PortArgument {
    type Err = PortArgumentError;

    fn from_str(given: &str) -> Result<PortArgument, PortArgumentError> {
        let parts = given.split_once('=').filter(|(name, _)| !name.is_empty());
        let port = parts.and_then(|(name, number)| Some((name, number.parse().ok()?)));
        let (name, number) = port.ok_or_else(|| PortArgumentError {
            given: given.to_owned(),
        })?;
        Ok(PortArgument {
            name: name.to_owned(),
            number,
        })
    }
}

/// Declaration of a port in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PortDeclaration {
    Fixed(u16),
    Automatic(Protocol),
}

/// Source of the numbers of automatic ports.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PortNumbers<'a> {
    /// Chosen by the program that started the cell.
    Chosen(&'a BTreeMap<String, u16>),
    /// No port will be opened: the numbers are 0.
    Offline,
}

/// Returns the ports that must be chosen when the cell is started, in the order of the file.
///
/// # Errors
/// Returns an error if the file cannot be read or a port declaration is invalid. Other faults are left to
/// [`crate::CellConfig::load`].
pub fn auto_ports(path: &Path) -> Result<Vec<(String, Protocol)>, Faults> {
    let file = crate::file::read(path)?;
    let (root, mut reader) = crate::file::tree(&file)?;
    let declared = declared(&mut reader, root.get("ports"));
    file.faults(reader)?;
    let automatic = declared
        .into_iter()
        .filter_map(|(name, _, port)| match port {
            PortDeclaration::Automatic(protocol) => Some((name, protocol)),
            PortDeclaration::Fixed(_) => None,
        });
    Ok(automatic.collect())
}

fn declared(
    reader: &mut ConfigReader,
    node: Option<&Node>,
) -> Vec<(String, Span, PortDeclaration)> {
    let node = node.filter(|node| node.value != Value::Null);
    let entries = node.and_then(|node| reader.entries(node, "ports"));
    let mut ports = Vec::new();
    for entry in entries.unwrap_or_default() {
        let name = reader.key_name(&entry.key, "a port", ID);
        let port = declaration(reader, &entry.value);
        if let Some(name) = name {
            // A faulty port is still declared, so that its uses are not reported as well.
            let port = port.unwrap_or(PortDeclaration::Fixed(0));
            ports.push((name, entry.key.span, port));
        }
    }
    ports
}

fn declaration(reader: &mut ConfigReader, node: &Node) -> Option<PortDeclaration> {
    let found = match &node.value {
        Value::Int(number) => u16::try_from(*number)
            .ok()
            .filter(|number| *number > 0)
            .map(PortDeclaration::Fixed),
        Value::Text(text) => match text.as_str() {
            "auto udp" => Some(PortDeclaration::Automatic(Protocol::Udp)),
            "auto tcp" => Some(PortDeclaration::Automatic(Protocol::Tcp)),
            _ => None,
        },
        _ => None,
    };
    if found.is_none() {
        let message = "a port is a number from 1 to 65535, `auto udp` or `auto tcp`";
        let fault = error(codes::BAD_PORT, node.span, message);
        reader.report(fault.help("with `auto`, a free port is chosen when the cell is started"));
    }
    found
}

/// Returns the numbers of all declared ports.
pub(crate) fn numbers(
    reader: &mut ConfigReader,
    node: Option<&Node>,
    given: PortNumbers<'_>,
) -> BTreeMap<String, u16> {
    let declared = declared(reader, node);
    let mut numbers = BTreeMap::new();
    for (name, span, port) in declared {
        let chosen = match given {
            PortNumbers::Chosen(chosen) => chosen.get(&name).copied(),
            PortNumbers::Offline => None,
        };
        let number = match (chosen, port, given) {
            (Some(number), ..) | (None, PortDeclaration::Fixed(number), _) => number,
            (None, PortDeclaration::Automatic(_), PortNumbers::Offline) => 0,
            (None, PortDeclaration::Automatic(_), PortNumbers::Chosen(_)) => {
                let message =
                    format!("the port `{name}` is automatic, but no number was given for it");
                let help = format!(
                    "`rcc-cli up` chooses one and passes it on; by hand: `--port {name}=NUMBER`"
                );
                reader.report(error(codes::PORT_NOT_CHOSEN, span, message).help(help));
                0
            }
        };
        numbers.insert(name, number);
    }
    if let PortNumbers::Chosen(chosen) = given {
        for name in chosen.keys().filter(|name| !numbers.contains_key(*name)) {
            let message = format!("the cell has no port `{name}`, but a number was given for it");
            let fault = error(codes::PORT_NOT_DECLARED, Span::default(), message).anywhere();
            reader.report(fault.help(known_ports(name, &numbers)));
        }
    }
    numbers
}

fn known_ports(name: &str, numbers: &BTreeMap<String, u16>) -> String {
    let known = numbers.keys().map(String::as_str);
    match closest(name, known.clone()) {
        Some(near) => format!("did you mean `{near}`?"),
        None if numbers.is_empty() => format!("declare it: `ports: {{{name}: auto tcp}}`"),
        None => format!("its ports are: {}", known.collect::<Vec<_>>().join(", ")),
    }
}

/// Replaces each `${name}` by the number of that port.
pub(crate) fn substitute(
    reader: &mut ConfigReader,
    text: &str,
    span: Span,
    numbers: &BTreeMap<String, u16>,
) -> Option<String> {
    let mut result = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once("${") {
        result.push_str(before);
        let Some((name, after)) = after.split_once('}') else {
            let fault = error(codes::BROKEN_PLACEHOLDER, span, "`${` is not closed");
            reader.report(fault.help("write `${name}` for the number of a port"));
            return None;
        };
        match numbers.get(name) {
            Some(number) => result.push_str(&number.to_string()),
            None => {
                reader.report(unknown_port(name, span, numbers));
                return None;
            }
        }
        rest = after;
    }
    result.push_str(rest);
    Some(result)
}

fn unknown_port(name: &str, span: Span, numbers: &BTreeMap<String, u16>) -> Diagnostic {
    let message = format!("`${{{name}}}` is not a port of this cell");
    error(codes::UNKNOWN_PORT, span, message).help(known_ports(name, numbers))
}
