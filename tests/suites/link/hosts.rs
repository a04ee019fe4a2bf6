//! Two network namespaces as two hosts, joined by a veth pair or by a cable with faults. Removed when dropped.

use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use super::cable::Cable;

/// Two hosts, A and B.
#[derive(Debug)]
pub(super) struct Hosts {
    /// Names of the namespaces.
    pub names: [String; 2],
    /// Names of the ends of the cable.
    ends: [String; 2],
}

/// Addresses of A and B.
pub(super) const ADDRESSES: [&str; 2] = ["10.77.0.1", "10.77.0.2"];

fn ip(arguments: &[&str]) -> Result<(), String> {
    let output = Command::new("ip").args(arguments).output();
    let output = output.map_err(|error| format!("needs iproute2: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(format!(
            "needs root and network namespaces: ip {}: {}",
            arguments.join(" "),
            String::from_utf8_lossy(&output.stderr).trim()
        )),
    }
}

impl Hosts {
    /// Makes both, joined by a veth pair; the error says why it cannot be.
    pub fn new() -> Result<Hosts, String> {
        let hosts = Hosts::apart()?;
        let ([a, b], [end_a, end_b]) = (&hosts.names, &hosts.ends);
        ip(&[
            "link", "add", end_a, "netns", a, "type", "veth", "peer", "name", end_b, "netns", b,
        ])?;
        hosts.with_addresses()
    }

    /// Makes both, joined by a cable whose faults are drawn from `seed`.
    pub fn with_faults(seed: u64) -> Result<(Hosts, Cable), String> {
        let hosts = Hosts::apart()?;
        let cable = Cable::new(&hosts.ends, seed)?;
        for (name, end) in hosts.names.iter().zip(&hosts.ends) {
            ip(&["link", "set", end, "netns", name])?;
        }
        Ok((hosts.with_addresses()?, cable))
    }

    /// Makes the namespaces.
    fn apart() -> Result<Hosts, String> {
        if !nix::unistd::geteuid().is_root() {
            return Err("needs root for network namespaces".to_owned());
        }
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let own = format!("{}-{number}", std::process::id());
        let hosts = Hosts {
            names: ["a", "b"].map(|host| format!("rcc-{host}-{own}")),
            // At most 15 characters.
            ends: ["a", "b"].map(|host| format!("v{host}{own}")),
        };
        for name in &hosts.names {
            ip(&["netns", "add", name])?;
            ip(&["-n", name, "link", "set", "lo", "up"])?;
        }
        Ok(hosts)
    }

    /// Gives the ends of the cable their addresses, and switches them on.
    fn with_addresses(self) -> Result<Hosts, String> {
        for ((name, end), address) in self.names.iter().zip(&self.ends).zip(ADDRESSES) {
            let address = format!("{address}/24");
            ip(&["-n", name, "address", "add", &address, "dev", end])?;
            ip(&["-n", name, "link", "set", end, "up"])?;
        }
        Ok(self)
    }

    /// Pulls the cable.
    pub fn cut(&self) {
        self.set("down");
    }

    /// Plugs the cable in again.
    pub fn join(&self) {
        self.set("up");
    }

    fn set(&self, state: &str) {
        let set = ip(&["-n", &self.names[0], "link", "set", &self.ends[0], state]);
        set.expect("the link can be set");
    }
}

impl Drop for Hosts {
    fn drop(&mut self) {
        for name in &self.names {
            // Not made, if making them failed. The cable goes with its namespace.
            let _ = ip(&["netns", "delete", name]);
        }
    }
}
