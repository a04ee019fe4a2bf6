//! Whose program is at the other end of a loopback TCP connection: the system's table of sockets tells.
//! Read by the thread that accepts connections of a control port.

use std::fs;
use std::io;
use std::net::{IpAddr, SocketAddr, TcpStream};

/// State of a connected socket in the table (include/net/tcp_states.h).
const ESTABLISHED: &str = "01";

/// The user who made the other end of `stream`, which is on this machine; `None` if the table does not know it (any more).
///
/// # Errors
/// The table cannot be read, or the connection is gone.
pub fn user_of(stream: &TcpStream) -> io::Result<Option<u32>> {
    let (peer, own) = (stream.peer_addr()?, stream.local_addr()?);
    let table = match peer {
        SocketAddr::V4(_) => "/proc/net/tcp",
        SocketAddr::V6(_) => "/proc/net/tcp6",
    };
    let text = fs::read_to_string(table)?;
    Ok(text.lines().find_map(|line| user_in(line, peer, own)))
}

/// The user of the socket of a line, if it is the connected one from `local` to `remote`.
fn user_in(line: &str, local: SocketAddr, remote: SocketAddr) -> Option<u32> {
    // sl local remote state queues timer retransmits uid …
    let mut fields = line.split_whitespace().skip(1);
    let is_it = fields.next() == Some(&written(local))
        && fields.next() == Some(&written(remote))
        && fields.next() == Some(ESTABLISHED);
    let user = fields.nth(3)?.parse().ok()?;
    is_it.then_some(user)
}

/// An address as the table writes it: words of 32 bits in the order of the machine, and the port.
fn written(address: SocketAddr) -> String {
    let word = |bytes: &[u8]| {
        let bytes = bytes.try_into().unwrap_or_default();
        format!("{:08X}", u32::from_ne_bytes(bytes))
    };
    let words: String = match address.ip() {
        IpAddr::V4(ip) => word(&ip.octets()),
        IpAddr::V6(ip) => ip.octets().chunks(4).map(word).collect(),
    };
    format!("{words}:{:04X}", address.port())
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_connection_of_ours_is_ours_on_both_protocols() {
        for address in ["127.0.0.1:0", "[::1]:0"] {
            let Ok(listener) = TcpListener::bind(address) else {
                eprintln!("skipped: {address} (this machine has no such address)");
                continue;
            };
            let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let (server, _) = listener.accept().unwrap();
            let ours = nix::unistd::getuid().as_raw();
            assert_eq!(user_of(&server).unwrap(), Some(ours), "{address}");
            assert_eq!(user_of(&client).unwrap(), Some(ours), "{address}");
        }
    }

    #[test]
    fn only_the_line_of_a_connected_socket_with_both_addresses_counts() {
        let (local, remote) = (
            "127.0.0.1:4660".parse().unwrap(),
            "127.0.0.1:1".parse().unwrap(),
        );
        let ip = written(local).split(':').next().unwrap().to_owned();
        let line = |from: &str, to: &str, state: &str| {
            format!(
                "   4: {ip}:{from} {ip}:{to} {state} 00000000:00000000 00:00000000 00000000  1000        0 99 1"
            )
        };
        for (line, user) in [
            (line("1234", "0001", "01"), Some(1000)),
            (line("0001", "1234", "01"), None),
            (line("1234", "0001", "06"), None),
            (line("1235", "0001", "01"), None),
        ] {
            assert_eq!(user_in(&line, local, remote), user, "{line}");
        }
        assert_eq!(
            user_in("  sl  local_address rem_address st", local, remote),
            None
        );
    }
}
