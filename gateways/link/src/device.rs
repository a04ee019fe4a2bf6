//! `rcc-link-device`: a driver whose inputs are topics of another cell. Each channel has its newest value; what is older than
//! `expires` is null. Run by the host's exchange thread; Zenoh's threads fill the [`Inbox`].

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use rcc_config::link::{TLS_KEYS, TlsFiles, is_cell_key, is_endpoint};
use rcc_core::impedance::ControlMode;
use rcc_core::message::JOINTS_MAX;
use rcc_core::primitive::ChannelKind;
use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs, PeriodTimer, Settings,
};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::DeviceConfig;
use serde_json::{Value, json};
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use crate::access::Role;
use crate::keys::CellKeys;
use crate::named::is_named;
use crate::session::{self, Connections, Identity, SessionError, has_port};
use channels::LinkChannel;
pub(crate) use channels::link_channels;
use inbox::{ChannelState, Inbox};

mod channels;
mod inbox;

/// Nothing is connected.
pub const NO_CONNECTION: u32 = 100;
/// Connected, but the cell is not there.
pub const NO_CELL: u32 = 101;
/// The cell is there, but a topic is not.
pub const NO_TOPIC: u32 = 102;
/// A topic has another type or unit than its channel.
pub const OTHER_KIND: u32 = 103;
/// Values are too old.
pub const STALE: u32 = 104;
/// Connected with TLS, but to none with the certificate of the cell.
pub const OTHER_NAME: u32 = 105;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[
    (
        NO_CONNECTION,
        "nothing answers at settings.connect or settings.router: check the address, the network, that rcc-link listens there (`link: listen`), and \
         with settings.tls the certificates of both sides",
    ),
    (
        NO_CELL,
        "connected, but the cell settings.peer is not there: start it and its rcc-link, and compare site and name",
    ),
    (
        NO_TOPIC,
        "the other cell is there, but a topic of this device never arrived: start the net that publishes it, and see its `link: publish`",
    ),
    (
        OTHER_KIND,
        "a topic has another type or unit than its channel: `rcc-cli doctor device` shows both",
    ),
    (
        STALE,
        "values of the other cell are older than settings.expires: the network is slow or cut, or the other cell is late",
    ),
    (
        OTHER_NAME,
        "connected, but to nobody with the certificate of settings.peer, so all that arrives is dropped: `rcc-cli doctor device` shows the names",
    ),
];

/// Reaction to the loss of the values of all channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OnLoss {
    /// The device is lost.
    Lost,
    /// The device stays; its inputs are null.
    Null,
}

/// The driver.
#[derive(Debug)]
pub struct LinkDevice {
    timer: PeriodTimer,
    on_loss: OnLoss,
    expires_ns: u64,
    inbox: Arc<Inbox>,
    shared: Arc<SharedLink>,
}

/// State shared by the driver, Zenoh's threads and the diagnosis.
#[derive(Debug)]
struct SharedLink {
    inbox: Arc<Inbox>,
    /// Not there until a router has answered.
    session: OnceLock<Session>,
    peer: String,
    expires_ns: u64,
    /// Liveliness tokens of the other cell. Written by Zenoh's threads only; no other memory depends on it.
    alive: Arc<AtomicUsize>,
    /// Connections, as of the last look. No other memory depends on it.
    connections: AtomicUsize,
    /// With TLS, one of them has the certificate of the other cell. No other memory depends on it.
    named: AtomicBool,
    has_tls: bool,
}

impl Driver for LinkDevice {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let settings = LinkSettings::read(device)?;
        let endpoints = [&settings.listen, &settings.connect, &settings.router];
        for endpoint in endpoints.into_iter().flatten() {
            has_port(endpoint).map_err(|error| DriverError::Setting {
                device: device.name.clone(),
                key: "connect, listen or router".to_owned(),
                cause: error.to_string(),
                expected: "a number from 1 to 65535",
            })?;
        }
        let inbox = Arc::new(Inbox::new(link_channels(device)?));
        let opened = SharedLink::open(&settings, &inbox);
        let LinkSettings {
            listen, connect, ..
        } = &settings;
        let shared = opened.map_err(|error| match error {
            SessionError::Certificate(error) => DriverError::Setting {
                device: device.name.clone(),
                key: "tls".to_owned(),
                cause: error.to_string(),
                expected: "authority, certificate and key of this cell",
            },
            error => DriverError::System {
                device: device.name.clone(),
                key: match listen.as_slice() {
                    [] => "connect",
                    _ => "listen",
                },
                value: format!("{listen:?} {connect:?}"),
                source: std::io::Error::other(error),
            },
        })?;
        Ok(LinkDevice {
            timer: PeriodTimer::new(settings.period),
            on_loss: settings.on_loss,
            expires_ns: settings.expires_ns,
            inbox,
            shared,
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let ticks = self.timer.wait(timeout)?;
        let reading = self.inbox.read(self.expires_ns);
        let reason = self.shared.reason(&reading.worst);
        if reading.fresh == 0 && self.on_loss == OnLoss::Lost {
            return Err(LinkError::Lost { reason });
        }
        *inputs = reading.inputs;
        let channels = self.inbox.channels().len().max(1);
        // At most 1000.
        let quality = (reading.fresh * 1000 / channels) as u32;
        Ok(Exchange {
            commandable: true,
            startable: true,
            strategy: ControlMode::Position,
            mirror: [0.0; JOINTS_MAX],
            ticks,
            period_ns: self.timer.period_ns(),
            quality_permille: quality,
            reason,
            late: reading.out_of_order,
            refused: reading.refused,
        })
    }

    /// It has no outputs.
    fn send(&mut self, _: &Outputs) -> Result<(), LinkError> {
        Ok(())
    }

    fn release(&mut self) {}

    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        Some(Arc::clone(&self.shared) as Arc<dyn LinkDiagnosis>)
    }
}

/// The settings of a device.
#[derive(Clone, Debug)]
pub(crate) struct LinkSettings {
    /// Site and cell whose topics these are.
    pub peer: String,
    /// Endpoints at which the other cell connects.
    pub listen: Vec<String>,
    /// Endpoints of the other cell.
    pub connect: Vec<String>,
    /// Endpoints of routers instead.
    pub router: Vec<String>,
    /// Files for mutual TLS.
    pub tls: Option<TlsFiles>,
    period: Duration,
    expires_ns: u64,
    on_loss: OnLoss,
}

impl LinkSettings {
    /// Reads and checks them.
    ///
    /// # Errors
    /// Returns what is wrong, with the path of the key and the expected value.
    pub fn read(device: &DeviceConfig) -> Result<LinkSettings, DriverError> {
        if device.robot.is_some() {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "topics of another cell move no arm: remove `robot`",
            });
        }
        let mut settings = Settings::of(device);
        let peer = settings.read(
            "peer",
            "site and cell whose topics these are, such as \"lab/press\"",
            None,
            |value| {
                value
                    .as_str()
                    .filter(|text| is_cell_key(text))
                    .map(str::to_owned)
            },
        )?;
        let expected = "endpoints, such as [\"tcp/192.168.0.7:7447\"]";
        let connect = settings.read("connect", expected, Some(Vec::new()), endpoints)?;
        let listen = settings.read("listen", expected, Some(Vec::new()), endpoints)?;
        let router = settings.read("router", expected, Some(Vec::new()), endpoints)?;
        let tls = settings.read(
            "tls",
            "{authority: FILE, certificate: FILE, key: FILE} with absolute paths",
            Some(None),
            |value| tls(value).map(Some),
        )?;
        let period = settings.duration("period", Duration::from_millis(5))?;
        let expires = settings.duration("expires", Duration::from_millis(100))?;
        let words = [("lost", OnLoss::Lost), ("null", OnLoss::Null)];
        let on_loss = settings.word(
            "on_loss",
            "`lost` (the device is lost) or `null` (only its inputs are null)",
            OnLoss::Lost,
            &words,
        )?;
        settings.finish()?;
        let refused = |key: &str, cause: &str| DriverError::Setting {
            device: device.name.clone(),
            key: key.to_owned(),
            cause: cause.to_owned(),
            expected,
        };
        let is_direct = !connect.is_empty() || !listen.is_empty();
        match (is_direct, router.is_empty(), &tls) {
            (false, true, _) => {
                return Err(refused(
                    "connect",
                    "is missing, and `listen` and `router` too",
                ));
            }
            (true, false, _) => {
                return Err(refused("router", "goes without `connect` and `listen`"));
            }
            (false, false, Some(_)) => {
                let cause = "shows its own certificate for all cells, so that `tls` could not tell whose values arrive: use `connect`";
                return Err(refused("router", cause));
            }
            _ => {}
        }
        if let Err(error) = session::of_one_protocol(&[&listen, &connect, &router], tls.is_some()) {
            let key = match (listen.is_empty(), router.is_empty()) {
                (false, _) => "listen",
                (_, false) => "router",
                _ => "connect",
            };
            return Err(refused(key, &error.to_string()));
        }
        Ok(LinkSettings {
            peer,
            listen,
            connect,
            router,
            tls,
            period,
            expires_ns: u64::try_from(expires.as_nanos()).unwrap_or(u64::MAX),
            on_loss,
        })
    }
}

/// Reads the files of mutual TLS: absolute paths, and no other keys.
fn tls(value: &Value) -> Option<TlsFiles> {
    let fields = value.as_object()?;
    let path = |key| {
        let path = PathBuf::from(fields.get(key)?.as_str()?);
        path.is_absolute().then_some(path)
    };
    let [authority, certificate, key] = TLS_KEYS.map(path);
    (fields.len() == TLS_KEYS.len()).then_some(TlsFiles {
        authority: authority?,
        certificate: certificate?,
        key: key?,
    })
}

/// Reads a list of endpoints.
fn endpoints(value: &Value) -> Option<Vec<String>> {
    let list = value.as_array()?.iter();
    list.map(|one| {
        one.as_str()
            .filter(|text| is_endpoint(text))
            .map(str::to_owned)
    })
    .collect()
}

impl SharedLink {
    fn open(settings: &LinkSettings, inbox: &Arc<Inbox>) -> Result<Arc<SharedLink>, SessionError> {
        let LinkSettings {
            listen,
            connect,
            router,
            tls,
            ..
        } = settings;
        let shared = Arc::new(SharedLink {
            inbox: Arc::clone(inbox),
            session: OnceLock::new(),
            peer: settings.peer.clone(),
            expires_ns: settings.expires_ns,
            alive: Arc::new(AtomicUsize::new(0)),
            connections: AtomicUsize::new(0),
            named: AtomicBool::new(false),
            has_tls: tls.is_some(),
        });
        if router.is_empty() {
            let role = Role::Device { peer: &shared.peer };
            let identity = tls.as_ref().map(|files| Identity { files, role });
            shared.begin(session::open(listen, connect, identity)?)?;
            return Ok(shared);
        }
        let own = Arc::clone(&shared);
        session::open_by_router(router, None, move |session| {
            if let Err(error) = session.and_then(|session| own.begin(session)) {
                tracing::error!("{error}");
            }
        })?;
        Ok(shared)
    }

    /// Subscribes to the topics, and to the liveliness of the other cell.
    fn begin(&self, session: Session) -> Result<(), SessionError> {
        let keys = CellKeys::of(&self.peer);
        let declared = |error: zenoh::Error| SessionError::Declare(error.to_string());
        for topic in self.inbox.topics() {
            // Channels have names of topics that are keys.
            let Some(key) = keys.topic(&topic) else {
                continue;
            };
            let filled = Arc::clone(&self.inbox);
            let subscriber = session.declare_subscriber(key).callback(move |sample| {
                if sample.kind() != SampleKind::Put {
                    return;
                }
                match is_named(&sample) {
                    true => filled.take(&topic, &sample.payload().to_bytes()),
                    false => filled.refuse(),
                }
            });
            subscriber.background().wait().map_err(declared)?;
        }
        let count = Arc::clone(&self.alive);
        let tokens = session.liveliness().declare_subscriber(keys.alive("*"));
        let tokens = tokens.history(true).callback(move |sample| {
            // A token that was lost comes back as a new one.
            let changed = match sample.kind() {
                SampleKind::Put => Some(1),
                SampleKind::Delete => None,
            };
            let next = |now: usize| Some(changed.map_or(now.saturating_sub(1), |more| now + more));
            // The closure always returns a value.
            let _ = count.fetch_update(Ordering::Relaxed, Ordering::Relaxed, next);
        });
        tokens.background().wait().map_err(declared)?;
        // It is called once.
        let _ = self.session.set(session);
        Ok(())
    }

    /// Returns the reason number for the worst state of a channel.
    fn reason(&self, worst: &ChannelState) -> u32 {
        match worst {
            ChannelState::Fresh => 0,
            ChannelState::OtherKind => OTHER_KIND,
            _ if self.connections.load(Ordering::Relaxed) == 0 => NO_CONNECTION,
            _ if self.has_tls && !self.named.load(Ordering::Relaxed) => OTHER_NAME,
            _ if self.alive.load(Ordering::Relaxed) == 0 => NO_CELL,
            ChannelState::Never => NO_TOPIC,
            ChannelState::Stale => STALE,
        }
    }
}

impl LinkDiagnosis for SharedLink {
    fn link(&self) -> Value {
        let session = self.session.get();
        let Connections { count, names } = session.map(session::connections).unwrap_or_default();
        let named = names.contains(&self.peer);
        self.named.store(named, Ordering::Relaxed);
        self.connections.store(count, Ordering::Relaxed);
        let now_ns = self.inbox.now_ns();
        json!({
            "peer": self.peer,
            "connections": count,
            "names": names,
            "peer_is_alive": self.alive.load(Ordering::Relaxed) > 0,
            "expires_ms": self.expires_ns as f64 * 1e-6,
            "channels": self.inbox.describe(now_ns, self.expires_ns),
        })
    }
}

/// Returns the kind of a channel in words, as messages have it.
fn wanted(channel: &LinkChannel) -> String {
    let ty = match channel.kind {
        ChannelKind::DigitalInput => "Bool",
        _ => "Real",
    };
    crate::message::kind(ty, channel.unit.as_deref())
}

#[cfg(test)]
mod tests;
