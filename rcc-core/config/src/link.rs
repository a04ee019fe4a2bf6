//! The link of a cell to others: its site, where it listens, what leaves the cell, and which nets another cell may start.
//! Read at start-up by the gateway `rcc-link`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rcc_core::unit::Unit;

use crate::codes;
use crate::diagnostic::Span;
use crate::driver::DriverConfig;
use crate::ports;
use crate::reader::{CELL_NAME, ConfigReader, Fields, NameRule, QuantityRange, error};
use crate::yaml::{Entry, Node};

pub(crate) const KEYS: [&str; 10] = [
    "site",
    "listen",
    "connect",
    "router",
    "publish",
    "rate",
    "start",
    "deploy",
    "configure",
    "tls",
];
/// Keys of `tls`.
pub const TLS_KEYS: [&str; 3] = ["authority", "certificate", "key"];
/// Rates at which topics may leave the cell, Hz.
const RATE_HZ: [f64; 2] = [0.1, 250.0];
const RATE_DEFAULT_HZ: f64 = 100.0;

/// Rule for names of nets.
const NET_NAME: NameRule = NameRule {
    first: |c| c.is_ascii_lowercase(),
    further: |c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-',
    words: "1 to 32 of a-z 0-9 -, beginning with a letter",
};

/// The link of a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkConfig {
    /// Name of the site, the second part of every key: `rcc/SITE/CELL/…`.
    pub site: String,
    /// Endpoints at which others reach the gateway, such as `tcp/192.168.0.1:7447`.
    pub listen: Vec<String>,
    /// Endpoints of other gateways.
    pub connect: Vec<String>,
    /// Endpoints of routers, of which the first that answers is used; then there are no others.
    pub router: Vec<String>,
    /// Patterns of the topics that leave the cell.
    pub publish: Vec<String>,
    /// Greatest rate of each topic, Hz.
    pub rate_hz: f64,
    /// Permissions of other cells and people.
    pub rights: LinkRights,
    /// Files for mutual TLS; then all endpoints are `tls/…`.
    pub tls: Option<TlsFiles>,
}

/// Permissions of other cells and people, by `SITE/NAME`, beyond reading and CANCEL.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LinkRights {
    /// For each peer, the names of the nets that it may start.
    pub start: BTreeMap<String, Vec<String>>,
    /// Peers that may load nets, and unload those again.
    pub deploy: Vec<String>,
    /// Peers that may replace the file of this cell's configuration.
    pub configure: Vec<String>,
}

/// Files in PEM format for mutual TLS; absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// Certificate of the authority that signed the certificates of all cells of the link.
    pub authority: PathBuf,
    /// Certificate of this process; its common name is `SITE/CELL`.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
}

/// Program of a driver whose inputs are topics of another cell.
pub const LINK_DEVICE: &str = "rcc-link-device";

/// Returns true for the program [`LINK_DEVICE`], with or without its folder.
#[must_use]
pub fn is_link_program(program: &str) -> bool {
    program.rsplit('/').next() == Some(LINK_DEVICE)
}

/// Returns true for the driver of a device whose inputs are topics of another cell.
#[must_use]
pub fn is_link_device(driver: &DriverConfig) -> bool {
    matches!(driver, DriverConfig::Program(own) if is_link_program(&own.program))
}

/// Reads the key `link` of a cell; `None` inside: the cell has none.
pub(crate) fn read(
    reader: &mut ConfigReader,
    cell: &Fields<'_>,
    ports: &BTreeMap<String, u16>,
) -> Option<Option<LinkConfig>> {
    let Some(Entry { key, value }) = cell.entry("link") else {
        return Some(None);
    };
    let fields = reader.fields(value, key.span, "the link", &KEYS)?;
    let site = reader.require(&fields, "site").and_then(|node| {
        let text = reader.text(node, "the site")?;
        reader.name(text, node.span, "the site", CELL_NAME)
    });
    let tls = tls(reader, &fields);
    let protocol = match tls {
        Some(None) => Some(Protocol::Tcp),
        Some(Some(_)) => Some(Protocol::Tls),
        None => None,
    };
    let listen = endpoints(reader, (&fields, "listen"), protocol, ports);
    let connect = endpoints(reader, (&fields, "connect"), protocol, ports);
    let router = endpoints(reader, (&fields, "router"), protocol, ports);
    let by_router = fields
        .entry("router")
        .filter(|_| router.as_ref().is_some_and(|it| !it.is_empty()));
    let others = ["listen", "connect"].map(|key| fields.entry(key));
    if let (Some(router), Some(other)) = (by_router, others.into_iter().flatten().next()) {
        let message = format!("`{}` beside `router`", other.key.name);
        let help = "a cell that goes through a router has no other connection: remove one of them";
        reader.report(error(codes::BAD_ADDRESS, router.key.span, message).help(help));
        return None;
    }
    let publish = match fields.get("publish") {
        Some(node) => texts(reader, node, "publish"),
        None => Some(vec!["*".to_owned()]),
    };
    let rate_hz = match fields.get("rate") {
        Some(node) => {
            let [least, most] = RATE_HZ;
            let unit = Unit::HERTZ;
            reader.quantity(node, "rate", QuantityRange { unit, least, most })
        }
        None => Some(RATE_DEFAULT_HZ),
    };
    let start = starts(reader, &fields);
    let [deploy, configure] = ["deploy", "configure"].map(|key| {
        let peers = peers(reader, &fields, key)?;
        if tls == Some(None)
            && let Some(entry) = fields.entry(key).filter(|_| !peers.is_empty())
        {
            let message = format!(
                "`{key}` needs certificates: without them anybody can say to be such a peer"
            );
            let help = "add `tls: {authority: FILE, certificate: FILE, key: FILE}` to the link";
            reader.report(error(codes::BAD_ADDRESS, entry.key.span, message).help(help));
            return None;
        }
        Some(peers)
    });
    let rights = LinkRights {
        start: start?,
        deploy: deploy?,
        configure: configure?,
    };
    let named = rights != LinkRights::default();
    if let Some(router) = by_router.filter(|_| named && matches!(tls, Some(Some(_)))) {
        let message = "`start`, `deploy` and `configure` need to know who asks, and a router shows its own certificate for all";
        let help =
            "let the peers connect directly: `listen: [\"tls/ADDRESS:7447\"]` instead of `router`";
        reader.report(error(codes::BAD_ADDRESS, router.key.span, message).help(help));
        return None;
    }
    let both = |peer: &&String| rights.start.contains_key(*peer);
    let given = [&rights.deploy, &rights.configure];
    if let Some(peer) = given.into_iter().flatten().find(both) {
        let place = fields
            .entry("start")
            .map_or(value.span, |entry| entry.key.span);
        let message = format!("`{peer}` may start nets, and change what is started");
        let help = "give START to one peer and `deploy` or `configure` to another one, so that nobody elsewhere \
                    both makes a net and starts it";
        reader.report(error(codes::BAD_NAME, place, message).help(help));
        return None;
    }
    Some(Some(LinkConfig {
        site: site?,
        listen: listen?,
        connect: connect?,
        router: router?,
        publish: publish?,
        rate_hz: rate_hz?,
        rights,
        tls: tls?,
    }))
}

/// Reads `tls`; `None` inside: there is none.
fn tls(reader: &mut ConfigReader, fields: &Fields<'_>) -> Option<Option<TlsFiles>> {
    let Some(node) = fields.get("tls") else {
        return Some(None);
    };
    let tls = reader.fields(node, node.span, "tls", &TLS_KEYS)?;
    // Read all before returning, so that all faults are reported together.
    let [authority, certificate, key] = TLS_KEYS.map(|key| {
        let node = reader.require(&tls, key)?;
        let text = reader.text(node, key)?;
        if Path::new(text).is_absolute() {
            return Some(PathBuf::from(text));
        }
        let message = format!("`{text}` is not an absolute path");
        let help = "write the path from the root: `/etc/rcc/tls/press.pem`";
        reader.report(error(codes::BAD_ADDRESS, node.span, message).help(help));
        None
    });
    Some(Some(TlsFiles {
        authority: authority?,
        certificate: certificate?,
        key: key?,
    }))
}

/// Reads each element of a list; all of them before returning, so that all faults are reported together.
fn every<T>(list: &[Node], each: impl FnMut(&Node) -> Option<T>) -> Option<Vec<T>> {
    let elements: Vec<Option<T>> = list.iter().map(each).collect();
    elements.into_iter().collect()
}

fn texts(reader: &mut ConfigReader, node: &Node, what: &str) -> Option<Vec<String>> {
    let list = reader.list(node, what)?;
    every(list, |node| reader.text(node, what).map(str::to_owned))
}

/// How a link is reached.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Protocol {
    Tcp,
    Tls,
}

fn endpoints(
    reader: &mut ConfigReader,
    (fields, key): (&Fields<'_>, &'static str),
    protocol: Option<Protocol>,
    ports: &BTreeMap<String, u16>,
) -> Option<Vec<String>> {
    let Some(node) = fields.get(key) else {
        return Some(Vec::new());
    };
    let list = reader.list(node, key)?;
    every(list, |node| {
        let text = reader.text(node, key)?;
        let text = ports::substitute(reader, text, node.span, ports)?;
        endpoint(reader, node.span, &text, protocol)
    })
}

/// Checks `tcp/HOST:PORT` or `tls/HOST:PORT`, and that it is the protocol of the link, if that is known.
fn endpoint(
    reader: &mut ConfigReader,
    place: Span,
    text: &str,
    protocol: Option<Protocol>,
) -> Option<String> {
    if is_endpoint(text) {
        let (message, help) = match (protocol, is_tls(text)) {
            (Some(Protocol::Tcp), true) => (
                format!("`{text}` needs certificates"),
                "add `tls: {authority: FILE, certificate: FILE, key: FILE}` to the link",
            ),
            (Some(Protocol::Tls), false) => (
                format!("`{text}` is not encrypted, but the link has `tls`"),
                "write `tls/HOST:PORT`",
            ),
            _ => return Some(text.to_owned()),
        };
        reader.report(error(codes::BAD_ADDRESS, place, message).help(help));
        return None;
    }
    let message = format!("`{text}` is not an endpoint");
    let help = "write protocol, host and port: `tcp/192.168.0.1:7447` or `tls/…`";
    reader.report(error(codes::BAD_ADDRESS, place, message).help(help));
    None
}

/// Returns true for an endpoint with mutual TLS.
#[must_use]
pub fn is_tls(endpoint: &str) -> bool {
    endpoint.starts_with("tls/")
}

/// Returns true for an endpoint of the link: `tcp/HOST:PORT` or `tls/HOST:PORT`.
#[must_use]
pub fn is_endpoint(text: &str) -> bool {
    let address = text.strip_prefix("tcp/").or(text.strip_prefix("tls/"));
    let Some(address) = address else {
        return false;
    };
    let Some((host, port)) = address.rsplit_once(':') else {
        return false;
    };
    let of_host = |c: char| c.is_ascii_alphanumeric() || ".-_:[]".contains(c);
    !host.is_empty() && host.chars().all(of_host) && port.parse::<u16>().is_ok()
}

/// Returns true for the name of a cell in the keys of the link: `SITE/CELL`.
#[must_use]
pub fn is_cell_key(text: &str) -> bool {
    let is_name = |name: &str| {
        let mut characters = name.chars();
        name.len() <= 32
            && characters.next().is_some_and(CELL_NAME.first)
            && characters.all(CELL_NAME.further)
    };
    text.split_once('/')
        .is_some_and(|(site, cell)| is_name(site) && is_name(cell))
}

fn starts(reader: &mut ConfigReader, fields: &Fields<'_>) -> Option<BTreeMap<String, Vec<String>>> {
    let Some(node) = fields.get("start") else {
        return Some(BTreeMap::new());
    };
    let entries = reader.entries(node, "start")?;
    let mut starts = BTreeMap::new();
    let mut valid = true;
    for Entry { key, value } in entries {
        if !is_cell_key(&key.name) {
            let message = format!("`{}` is not a cell of the link", key.name);
            let help = "write site and cell: `lab/press: [net, net]`";
            reader.report(error(codes::BAD_NAME, key.span, message).help(help));
            valid = false;
        }
        let Some(list) = reader.list(value, "the nets of a cell") else {
            valid = false;
            continue;
        };
        let nets = every(list, |node| {
            let text = reader.text(node, "a net")?;
            reader.name(text, node.span, "a net", NET_NAME)
        });
        match nets {
            Some(nets) => drop(starts.insert(key.name.to_string(), nets)),
            None => valid = false,
        }
    }
    valid.then_some(starts)
}

/// Reads a list of peers.
fn peers(reader: &mut ConfigReader, fields: &Fields<'_>, key: &'static str) -> Option<Vec<String>> {
    let Some(node) = fields.get(key) else {
        return Some(Vec::new());
    };
    let list = reader.list(node, key)?;
    every(list, |node| {
        let text = reader.text(node, "a peer")?;
        if is_cell_key(text) {
            return Some(text.to_owned());
        }
        let message = format!("`{text}` is not a peer of the link");
        let help = "write the common name of its certificate, site and name: `lab/office`";
        reader.report(error(codes::BAD_NAME, node.span, message).help(help));
        None
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::CellConfig;
    use crate::link::LinkRights;

    fn cell(link: &str) -> Result<CellConfig, crate::diagnostic::Faults> {
        let text = format!(
            "cell: press\nperiod: 1 ms\nlink: {link}\ndevices: {{io: {{driver: modbus}}}}\n"
        );
        CellConfig::parse_offline(&text, "cell.yaml", Path::new(""))
    }

    #[test]
    fn a_link_is_read_with_its_defaults() {
        let link = cell("{site: lab}").expect("a cell").link.expect("a link");
        assert_eq!(link.site, "lab");
        assert_eq!((link.publish, link.rate_hz), (vec!["*".to_owned()], 100.0));
        assert!(link.listen.is_empty() && link.connect.is_empty());
        assert_eq!(link.rights, LinkRights::default());
        let all = "{site: lab, listen: [\"tcp/10.0.0.1:7447\"], connect: [\"tcp/host.lab:7447\"], publish: [door/*], rate: 50 Hz, \
                   start: {lab/feeder: [close-door]}}";
        let link = cell(all).expect("a cell").link.expect("a link");
        assert_eq!(
            (link.rate_hz, link.rights.start["lab/feeder"].as_slice()),
            (50.0, &["close-door".to_owned()][..])
        );
        let without = CellConfig::parse_offline(
            "cell: a\nperiod: 1 ms\ndevices: {io: {driver: modbus}}\n",
            "cell.yaml",
            Path::new(""),
        );
        assert_eq!(without.expect("a cell").link, None);
    }

    #[test]
    fn tls_needs_all_files_and_every_endpoint() {
        let files =
            "tls: {authority: /etc/ca.pem, certificate: /etc/press.pem, key: /etc/press.key}";
        let link = cell(&format!(
            "{{site: lab, listen: [\"tls/10.0.0.1:7447\"], {files}}}"
        ));
        let link = link.expect("a cell").link.expect("a link");
        let tls = link.tls.expect("files");
        assert_eq!(tls.certificate, Path::new("/etc/press.pem"));
        let rows = [
            (
                format!("{{site: lab, listen: [\"tcp/10.0.0.1:7447\"], {files}}}"),
                "is not encrypted, but the link has `tls`",
            ),
            (
                "{site: lab, listen: [\"tls/10.0.0.1:7447\"]}".to_owned(),
                "`tls/10.0.0.1:7447` needs certificates",
            ),
            (
                "{site: lab, tls: {authority: ca.pem, certificate: /a, key: /b}}".to_owned(),
                "`ca.pem` is not an absolute path",
            ),
            (
                "{site: lab, tls: {authority: /a, certificate: /b}}".to_owned(),
                "needs a key `key`",
            ),
        ];
        for (link, words) in rows {
            let shown = cell(&link).expect_err(words).render(false);
            assert!(shown.contains(words), "{words}: {shown}");
        }
    }

    #[test]
    fn nets_are_deployed_by_named_certificates_that_start_nothing() {
        let tls = "tls: {authority: /etc/ca.pem, certificate: /etc/press.pem, key: /etc/press.key}";
        let link = cell(&format!("{{site: lab, deploy: [lab/office], {tls}}}"));
        let rights = link.expect("a cell").link.expect("a link").rights;
        assert_eq!(
            (rights.deploy, rights.configure.len()),
            (vec!["lab/office".to_owned()], 0)
        );
        let rows = [
            (
                "{site: lab, deploy: [lab/office]}".to_owned(),
                "`deploy` needs certificates",
            ),
            (
                "{site: lab, configure: [lab/office]}".to_owned(),
                "`configure` needs certificates",
            ),
            (
                format!("{{site: lab, deploy: [office], {tls}}}"),
                "`office` is not a peer of the link",
            ),
            (
                format!("{{site: lab, deploy: [lab/a], start: {{lab/a: [net]}}, {tls}}}"),
                "`lab/a` may start nets, and change what is started",
            ),
            (
                format!("{{site: lab, configure: [lab/a], start: {{lab/a: [net]}}, {tls}}}"),
                "`lab/a` may start nets, and change what is started",
            ),
        ];
        for (link, words) in rows {
            let shown = cell(&link).expect_err(words).render(false);
            assert!(shown.contains(words), "{words}: {shown}");
        }
    }

    #[test]
    fn everything_that_is_wrong_is_told_at_once() {
        let all = "{listen: [\"10.0.0.1:7447\"], connect: [udp/a:1], rate: 1 kHz, start: {feeder: [a], lab/b: [Net]}, publsh: []}";
        let shown = cell(all).expect_err("six faults").render(false);
        for words in [
            "needs a key `site`",
            "`10.0.0.1:7447` is not an endpoint",
            "`udp/a:1` is not an endpoint",
            "rate is 1000 Hz",
            "`feeder` is not a cell of the link",
            "invalid name `Net` for a net",
            "did you mean `publish`?",
        ] {
            assert!(shown.contains(words), "{words}: {shown}");
        }
    }
}
