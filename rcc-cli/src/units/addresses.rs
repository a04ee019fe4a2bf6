//! Addresses that a driver may communicate with, from its settings. Pure; used by the main thread of `install-units`.

use std::net::{IpAddr, SocketAddr};

use serde_json::Value;

/// What stands in front of an address: endpoints of link devices, and a simulated line of EtherCAT terminals.
const PREFIXES: [&str; 3] = ["tcp/", "tls/", "udp "];

/// Addresses in the settings of a device.
#[derive(Debug, Default)]
struct Found<'a> {
    /// At which the driver listens.
    own: Vec<IpAddr>,
    /// With which it communicates.
    others: Vec<IpAddr>,
    /// Endpoints with the name of a host.
    named: Vec<&'a str>,
}

/// Returns the lines of a unit. If the driver connects to an address (`server`, `connect`) or expects one (`peer`), only those
/// are allowed; if it only listens, the subnet of its address is allowed, assumed as /24 or /64. The address of a host that is
/// named is not known, and may change.
#[must_use]
pub fn allowed(settings: &Value) -> String {
    let mut found = Found::default();
    found.collect("", settings);
    if let Some(name) = found.named.first() {
        // In the comment it must stay one line.
        let name = name.escape_default();
        return format!("# {name} names a host: nothing can be filtered.\nIPAddressAllow=any\n");
    }
    let Found {
        own, mut others, ..
    } = found;
    if others.is_empty() {
        return own.iter().map(|address| listening(*address)).collect();
    }
    others.sort_unstable();
    others.dedup();
    others
        .iter()
        .map(|address| format!("IPAddressAllow={address}\n"))
        .collect()
}

fn listening(address: IpAddr) -> String {
    match address {
        IpAddr::V4(v4) if v4.is_loopback() => "IPAddressAllow=localhost\n".to_owned(),
        any if any.is_unspecified() => {
            "# The driver listens everywhere and names no peer: nothing can be filtered.\nIPAddressAllow=any\n".to_owned()
        }
        IpAddr::V4(v4) => {
            let [a, b, c, _] = v4.octets();
            format!("# The subnet of its listening address, assumed to be /24.\nIPAddressAllow={a}.{b}.{c}.0/24\n")
        }
        IpAddr::V6(v6) if v6.is_loopback() => "IPAddressAllow=localhost\n".to_owned(),
        IpAddr::V6(v6) => {
            let [a, b, c, d, ..] = v6.segments();
            format!("# The subnet of its listening address, assumed to be /64.\nIPAddressAllow={a:x}:{b:x}:{c:x}:{d:x}::/64\n")
        }
    }
}

impl<'a> Found<'a> {
    fn collect(&mut self, key: &str, value: &'a Value) {
        match value {
            Value::Object(entries) => {
                for (key, value) in entries {
                    self.collect(key, value);
                }
            }
            Value::Array(values) => {
                for value in values {
                    self.collect(key, value);
                }
            }
            Value::String(text) => self.add(key, text),
            _ => {}
        }
    }

    fn add(&mut self, key: &str, text: &'a str) {
        let endpoint = PREFIXES.iter().find_map(|prefix| text.strip_prefix(prefix));
        // An endpoint may be followed by options: tcp/192.168.0.1:7447?rel=0#iface=eth1.
        let address = endpoint.map_or(text, |rest| rest.split(['?', '#']).next().unwrap_or(rest));
        let socket = address.parse::<SocketAddr>().map(|socket| socket.ip());
        match socket.or_else(|_| address.parse::<IpAddr>()) {
            Ok(address) if key == "listen" => self.own.push(address),
            Ok(address) => self.others.push(address),
            Err(_) if endpoint.is_some() => self.named.push(text),
            Err(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_driver_may_talk_to_its_device_only() {
        for (settings, lines) in [
            (
                json!({"server": "10.0.0.7:502", "unit": 1}),
                "IPAddressAllow=10.0.0.7\n",
            ),
            (
                json!({"servers": {"a": {"server": "10.0.0.8:502"}, "b": {"server": "10.0.0.7:502"}}}),
                "IPAddressAllow=10.0.0.7\nIPAddressAllow=10.0.0.8\n",
            ),
            (
                json!({"listen": "192.168.0.1:49938", "peer": "192.168.0.20"}),
                "IPAddressAllow=192.168.0.20\n",
            ),
            (
                json!({"listen": "192.168.0.1:49938"}),
                "# The subnet of its listening address, assumed to be /24.\nIPAddressAllow=192.168.0.0/24\n",
            ),
            (
                json!({"listen": "127.0.0.1:1"}),
                "IPAddressAllow=localhost\n",
            ),
            (
                json!({"peer": "lab/press", "connect": ["tcp/192.168.0.1:7447", "tls/[fd00::7]:7447"]}),
                "IPAddressAllow=192.168.0.1\nIPAddressAllow=fd00::7\n",
            ),
            (
                json!({"peer": "lab/press", "router": ["tcp/192.168.0.9:7447#iface=eth1"]}),
                "IPAddressAllow=192.168.0.9\n",
            ),
            (
                json!({"peer": "lab/press", "listen": ["tcp/192.168.0.1:7447"]}),
                "# The subnet of its listening address, assumed to be /24.\nIPAddressAllow=192.168.0.0/24\n",
            ),
            (
                json!({"peer": "lab/press", "connect": ["tcp/192.168.0.1:7447", "tls/press.lab:7447"], "tls": {"key": "/etc/rcc/a.key"}}),
                "# tls/press.lab:7447 names a host: nothing can be filtered.\nIPAddressAllow=any\n",
            ),
            (
                json!({"interface": "udp 127.0.0.1:34980"}),
                "IPAddressAllow=127.0.0.1\n",
            ),
            (
                json!({"connect": ["tcp/a\nExecStart=b"]}),
                "# tcp/a\\nExecStart=b names a host: nothing can be filtered.\nIPAddressAllow=any\n",
            ),
            (json!({"interface": "eth1"}), ""),
            (json!({"command": ["python3", "camera.py"]}), ""),
            (json!({}), ""),
        ] {
            assert_eq!(allowed(&settings), lines, "{settings}");
        }
    }

    #[test]
    fn a_driver_that_listens_everywhere_is_not_filtered() {
        for listen in ["0.0.0.0:49938", "tcp/[::]:7447"] {
            let lines = allowed(&json!({ "listen": listen }));
            assert!(
                lines.ends_with("IPAddressAllow=any\n") && lines.starts_with('#'),
                "{lines}"
            );
        }
    }
}
