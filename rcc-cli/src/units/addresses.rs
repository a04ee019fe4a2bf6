//! Addresses that a driver may communicate with, from its settings. Pure; used by the main thread of `install-units`.

use std::net::{IpAddr, SocketAddr};

use serde_json::Value;

/// Returns the lines of a unit. If the driver connects to an address (`server`) or expects one (`peer`), only those are
/// allowed; if it only listens, the subnet of its address is allowed, assumed as /24 or /64.
#[must_use]
pub fn allowed(settings: &Value) -> String {
    let mut own = Vec::new();
    let mut others = Vec::new();
    collect("", settings, &mut own, &mut others);
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

fn collect(key: &str, value: &Value, own: &mut Vec<IpAddr>, others: &mut Vec<IpAddr>) {
    match value {
        Value::Object(entries) => {
            for (key, value) in entries {
                collect(key, value, own, others);
            }
        }
        Value::Array(values) => {
            for value in values {
                collect(key, value, own, others);
            }
        }
        Value::String(text) => {
            let address = text.parse::<SocketAddr>().map(|address| address.ip());
            if let Ok(address) = address.or_else(|_| text.parse::<IpAddr>()) {
                let list = if key == "listen" { own } else { others };
                list.push(address);
            }
        }
        _ => {}
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
            (json!({}), ""),
        ] {
            assert_eq!(allowed(&settings), lines, "{settings}");
        }
    }

    #[test]
    fn a_driver_that_listens_everywhere_is_not_filtered() {
        let lines = allowed(&json!({"listen": "0.0.0.0:49938"}));
        assert!(
            lines.ends_with("IPAddressAllow=any\n") && lines.starts_with('#'),
            "{lines}"
        );
    }
}
