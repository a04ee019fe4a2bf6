//! Network interfaces of this machine, and which process holds a port. Run by the main thread.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use procfs::net::UdpNetEntry;
use procfs::process::{FDTarget, all_processes};

/// An IPv4 address of this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkInterface {
    /// Name of the interface.
    pub name: String,
    /// Address.
    pub address: Ipv4Addr,
    /// Network mask.
    pub mask: Ipv4Addr,
    /// True if the interface is up and running.
    pub up: bool,
}

impl NetworkInterface {
    /// Returns true if `other` is in the same subnet.
    #[must_use]
    pub fn is_near(&self, other: Ipv4Addr) -> bool {
        let mask = self.mask.to_bits();
        self.address.to_bits() & mask == other.to_bits() & mask
    }

    /// Formats name, address and prefix length: `eth0 192.168.0.1/24`.
    #[must_use]
    pub fn label(&self) -> String {
        format!(
            "{} {}/{}",
            self.name,
            self.address,
            self.mask.to_bits().count_ones()
        )
    }
}

/// Returns all IPv4 addresses of this machine.
#[must_use]
pub fn interfaces() -> Vec<NetworkInterface> {
    let both = InterfaceFlags::IFF_UP | InterfaceFlags::IFF_RUNNING;
    getifaddrs()
        .into_iter()
        .flatten()
        .filter_map(|found| {
            let address = found.address?.as_sockaddr_in()?.ip();
            let mask = found.netmask?.as_sockaddr_in()?.ip();
            Some(NetworkInterface {
                name: found.interface_name,
                address,
                mask,
                up: found.flags.contains(both),
            })
        })
        .collect()
}

/// Returns whether the network interface with this name is up, and whether it has a cable (a carrier); `None` if it does not
/// exist.
#[must_use]
pub fn link_state(name: &str) -> Option<(bool, bool)> {
    let mut all = getifaddrs().into_iter().flatten();
    let found = all.find(|one| one.interface_name == name)?;
    let has = |flag| found.flags.contains(flag);
    let up = has(InterfaceFlags::IFF_UP);
    Some((up, up && has(InterfaceFlags::IFF_RUNNING)))
}

/// Returns name and id of the process that holds this UDP address, as far as `/proc` is readable.
#[must_use]
pub fn holder(address: SocketAddr) -> Option<String> {
    let inode = inode_of(&procfs::net::udp().ok()?, address)?;
    for process in all_processes().into_iter().flatten().flatten() {
        let mut files = process.fd().into_iter().flatten().flatten();
        if files.any(|file| file.target == FDTarget::Socket(inode)) {
            let name = process
                .stat()
                .map_or_else(|_| String::new(), |stat| stat.comm);
            return Some(format!("{name} (pid {})", process.pid));
        }
    }
    Some("a process of another user".to_owned())
}

/// Finds the inode of the socket that holds an IPv4 address.
fn inode_of(table: &[UdpNetEntry], address: SocketAddr) -> Option<u64> {
    let meets = |found: IpAddr| {
        found == address.ip() || found.is_unspecified() || address.ip().is_unspecified()
    };
    let mut rows = table.iter().filter(|_| address.is_ipv4());
    let row = rows
        .find(|row| row.local_address.port() == address.port() && meets(row.local_address.ip()));
    row.map(|row| row.inode)
}

#[cfg(test)]
mod tests {
    use procfs::FromBufReadSI;
    use procfs::net::UdpNetEntries;

    use super::*;

    #[test]
    fn this_machine_has_its_loopback() {
        let all = interfaces();
        let loopback = all.iter().find(|one| one.address == Ipv4Addr::LOCALHOST);
        assert!(
            loopback.is_some_and(|one| one.up && one.is_near(Ipv4Addr::new(127, 0, 0, 2))),
            "{all:?}"
        );
    }

    #[test]
    fn the_holder_of_a_port_is_this_process() -> std::io::Result<()> {
        let socket = std::net::UdpSocket::bind("127.0.0.1:0")?;
        let found = holder(socket.local_addr()?).unwrap_or_default();
        assert!(
            found.ends_with(&format!("(pid {})", std::process::id())),
            "{found}"
        );
        Ok(())
    }

    #[test]
    fn a_free_port_has_no_holder() {
        let table = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n\
                     10: 0100007F:C312 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 4711 2 0 0\n";
        let table = UdpNetEntries::from_buf_read(table.as_bytes(), procfs::current_system_info());
        let table = table.expect("a table").0;
        let at = |text: &str| {
            text.parse()
                .ok()
                .and_then(|address| inode_of(&table, address))
        };
        assert_eq!(at("127.0.0.1:49938"), Some(4711));
        assert_eq!(at("127.0.0.1:49939"), None);
        assert_eq!(at("10.0.0.1:49938"), None);
    }
}
