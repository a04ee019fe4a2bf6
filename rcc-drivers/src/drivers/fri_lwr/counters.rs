//! Counters of the connection to the controller, for `rcc-cli doctor`.
//! Written by the exchange thread, read by the diagnosis thread. All atomics are Relaxed: each counter is independent,
//! and none of them publishes other data.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use serde_json::{Value, json};

use super::plausibility::Implausibility;
use crate::drivers::fri_socket::peer::Peer;
use crate::fri_lwr::wire::{
    FriControlStrategy, HeaderRule, MeasurementDatagram, Quality, SessionState, WireError,
};
use rcc_driver_kit::driver::LinkDiagnosis;

/// A larger step of the sequence number is a restart of the controller, not a loss of datagrams.
const GAP_MAX: u16 = 1000;

/// Counters of one connection.
#[derive(Debug)]
pub struct FriCounters {
    listen: SocketAddr,
    peer: Option<Peer>,
    header: HeaderRule,
    /// Packed address of the controller that is answered; 0 = none.
    controller: AtomicU64,
    datagrams: AtomicU64,
    accepted: AtomicU64,
    /// Datagrams from another address.
    foreign: AtomicU64,
    foreign_last: AtomicU64,
    wrong_size: AtomicU64,
    /// Size of the last such datagram in bytes, and its first eight bytes.
    wrong_size_last: AtomicU64,
    wrong_size_head: AtomicU64,
    wrong_identity: AtomicU64,
    wrong_identity_last: AtomicU32,
    malformed: AtomicU64,
    disordered: AtomicU64,
    /// Datagrams that waited for the next one to confirm them.
    doubted: AtomicU64,
    /// Index of the last implausibility in [`Implausibility::ALL`].
    doubt_last: AtomicU32,
    sequence: AtomicU32,
    gaps: AtomicU64,
    gaps_datagrams: AtomicU64,
    last_datagram_ns: AtomicU64,
    interval_max_ns: AtomicU64,
    interval_longest_ns: AtomicU64,
    answered: AtomicU64,
    answer_sum_ns: AtomicU64,
    answer_max_ns: AtomicU64,
    answer_longest_ns: AtomicU64,
    wire: DatagramStatistics,
}

/// Fields of the newest measurement datagram; reals are stored as their bits.
#[derive(Debug, Default)]
struct DatagramStatistics {
    session: AtomicU32,
    quality: AtomicU32,
    control: AtomicU32,
    power: AtomicU32,
    error: AtomicU32,
    warning: AtomicU32,
    missed: AtomicU32,
    period: AtomicU32,
    answer_rate: AtomicU32,
    latency: AtomicU32,
    jitter: AtomicU32,
}

impl FriCounters {
    /// Counters of a socket that is bound to `listen` and answers only `peer`, if given.
    #[must_use]
    pub fn new(listen: SocketAddr, peer: Option<Peer>, header: HeaderRule) -> Self {
        let none = AtomicU64::default;
        Self {
            listen,
            peer,
            header,
            controller: none(),
            datagrams: none(),
            accepted: none(),
            foreign: none(),
            foreign_last: none(),
            wrong_size: none(),
            wrong_size_last: none(),
            wrong_size_head: none(),
            wrong_identity: none(),
            wrong_identity_last: AtomicU32::default(),
            malformed: none(),
            disordered: none(),
            doubted: none(),
            doubt_last: AtomicU32::default(),
            sequence: AtomicU32::new(u32::MAX),
            gaps: none(),
            gaps_datagrams: none(),
            last_datagram_ns: none(),
            interval_max_ns: none(),
            interval_longest_ns: none(),
            answered: none(),
            answer_sum_ns: none(),
            answer_max_ns: none(),
            answer_longest_ns: none(),
            wire: DatagramStatistics::default(),
        }
    }

    /// Counts a datagram from an address that is not the controller's.
    pub fn foreign(&self, source: SocketAddr) {
        self.datagrams.fetch_add(1, Relaxed);
        self.foreign.fetch_add(1, Relaxed);
        self.foreign_last.store(packed(source), Relaxed);
    }

    /// Counts a datagram that was refused; `implausibility` is the reason if it was implausible.
    pub fn refused(
        &self,
        bytes: &[u8],
        source: SocketAddr,
        implausibility: Option<Implausibility>,
    ) {
        self.datagrams.fetch_add(1, Relaxed);
        self.controller.store(packed(source), Relaxed);
        if let Some(index) = implausibility.and_then(place) {
            self.doubted.fetch_add(1, Relaxed);
            self.doubt_last.store(index, Relaxed);
        }
        match MeasurementDatagram::decode_as(bytes, self.header) {
            Err(WireError::Size { .. }) => {
                self.wrong_size.fetch_add(1, Relaxed);
                self.wrong_size_last.store(bytes.len() as u64, Relaxed);
                let mut head = [0; 8];
                for (place, byte) in head.iter_mut().zip(bytes) {
                    *place = *byte;
                }
                self.wrong_size_head
                    .store(u64::from_le_bytes(head), Relaxed);
            }
            Err(WireError::Identity { have, .. }) => {
                self.wrong_identity.fetch_add(1, Relaxed);
                self.wrong_identity_last.store(u32::from(have), Relaxed);
            }
            Err(_) => {
                self.malformed.fetch_add(1, Relaxed);
            }
            // A controller whose interface is off sends nothing, so this datagram is malformed.
            Ok(measured) if measured.state == SessionState::Off => {
                self.malformed.fetch_add(1, Relaxed);
            }
            // The datagram can be decoded, so it was out of order, had a value that is not finite, or was not confirmed
            // yet.
            Ok(_) => {
                self.disordered.fetch_add(1, Relaxed);
            }
        }
    }

    /// Counts an accepted datagram; `now_ns` is CLOCK_MONOTONIC.
    pub fn accepted(&self, now_ns: u64, source: SocketAddr, measured: &MeasurementDatagram) {
        self.datagrams.fetch_add(1, Relaxed);
        self.accepted.fetch_add(1, Relaxed);
        self.controller.store(packed(source), Relaxed);
        let last_datagram_ns = self.last_datagram_ns.swap(now_ns, Relaxed);
        if last_datagram_ns > 0 {
            let interval_ns = now_ns.saturating_sub(last_datagram_ns);
            self.interval_max_ns.fetch_max(interval_ns, Relaxed);
            self.interval_longest_ns.fetch_max(interval_ns, Relaxed);
        }
        let before = self
            .sequence
            .swap(u32::from(measured.send_sequence), Relaxed);
        if let Ok(before) = u16::try_from(before) {
            let step = measured.send_sequence.wrapping_sub(before);
            if (2..=GAP_MAX).contains(&step) {
                self.gaps.fetch_add(1, Relaxed);
                self.gaps_datagrams.fetch_add(u64::from(step - 1), Relaxed);
            }
        }
        self.wire.store(measured);
    }

    /// Counts the answer to the last datagram; `now_ns` is CLOCK_MONOTONIC.
    pub fn answered(&self, now_ns: u64) {
        let took_ns = now_ns.saturating_sub(self.last_datagram_ns.load(Relaxed));
        self.answered.fetch_add(1, Relaxed);
        self.answer_sum_ns.fetch_add(took_ns, Relaxed);
        self.answer_max_ns.fetch_max(took_ns, Relaxed);
        self.answer_longest_ns.fetch_max(took_ns, Relaxed);
    }

    /// Resets the connection after a long silence of the controller.
    pub fn forget(&self) {
        self.controller.store(0, Relaxed);
        self.sequence.store(u32::MAX, Relaxed);
        self.last_datagram_ns.store(0, Relaxed);
    }
}

impl LinkDiagnosis for FriCounters {
    fn link(&self) -> Value {
        let number = |figure: &AtomicU64| figure.load(Relaxed);
        let answered = number(&self.answered);
        json!({
            "protocol": "FRI 1.0 (LWR 4+)",
            "listen": self.listen.to_string(),
            "peer": self.peer.map(|peer| peer.to_string()),
            "controller": unpacked(number(&self.controller)),
            "datagrams": number(&self.datagrams),
            "accepted": number(&self.accepted),
            "foreign": number(&self.foreign),
            "foreign_last": unpacked(number(&self.foreign_last)),
            "wrong_size": number(&self.wrong_size),
            "wrong_size_last": number(&self.wrong_size_last),
            "wrong_size_head": number(&self.wrong_size_head).to_le_bytes(),
            "wrong_identity": number(&self.wrong_identity),
            "wrong_identity_last": self.wrong_identity_last.load(Relaxed),
            "malformed": number(&self.malformed),
            "disordered": number(&self.disordered),
            "doubted": number(&self.doubted),
            "doubt_last": (number(&self.doubted) > 0).then(|| description(self.doubt_last.load(Relaxed))),
            "gaps": number(&self.gaps),
            "gaps_datagrams": number(&self.gaps_datagrams),
            // The maximum since the last call, and the maximum since the start.
            "interval_max_ns": self.interval_max_ns.swap(0, Relaxed),
            "interval_longest_ns": number(&self.interval_longest_ns),
            "answered": answered,
            "answer_mean_ns": number(&self.answer_sum_ns).checked_div(answered),
            "answer_max_ns": self.answer_max_ns.swap(0, Relaxed),
            "answer_longest_ns": number(&self.answer_longest_ns),
            "wire": (number(&self.accepted) > 0).then(|| self.wire.to_json()),
        })
    }
}

impl DatagramStatistics {
    fn store(&self, measured: &MeasurementDatagram) {
        self.session.store(measured.state as u32, Relaxed);
        self.quality.store(measured.quality as u32, Relaxed);
        self.control.store(measured.control as u32, Relaxed);
        self.power.store(u32::from(measured.power), Relaxed);
        self.error.store(u32::from(measured.error), Relaxed);
        self.warning.store(u32::from(measured.warning), Relaxed);
        self.missed.store(measured.miss_count, Relaxed);
        let reals = [
            (&self.period, measured.measurement_period),
            (&self.answer_rate, measured.answer_rate),
            (&self.latency, measured.latency),
            (&self.jitter, measured.jitter),
        ];
        for (place, value) in reals {
            place.store(value.to_bits(), Relaxed);
        }
    }

    fn to_json(&self) -> Value {
        let word = |figure: &AtomicU32, names: &[(u32, &'static str)]| {
            let number = figure.load(Relaxed);
            names.iter().find(|row| row.0 == number).map(|row| row.1)
        };
        // NaN becomes null.
        let real = |figure: &AtomicU32| f64::from(f32::from_bits(figure.load(Relaxed)));
        json!({
            "session": word(&self.session, &[
                (SessionState::Monitor as u32, "monitor"),
                (SessionState::Command as u32, "command"),
            ]).unwrap_or("off"),
            "quality": word(&self.quality, &[
                (Quality::Bad as u32, "bad"),
                (Quality::Ok as u32, "ok"),
                (Quality::Perfect as u32, "perfect"),
            ]).unwrap_or("unacceptable"),
            "control": word(&self.control, &[
                (FriControlStrategy::Position as u32, "position"),
                (FriControlStrategy::CartesianImpedance as u32, "cartesian impedance"),
                (FriControlStrategy::JointImpedance as u32, "joint impedance"),
            ]).unwrap_or("other"),
            "power": self.power.load(Relaxed),
            "error": self.error.load(Relaxed),
            "warning": self.warning.load(Relaxed),
            "missed": self.missed.load(Relaxed),
            "period_s": real(&self.period),
            "answer_rate": real(&self.answer_rate),
            "latency_s": real(&self.latency),
            "jitter_s": real(&self.jitter),
        })
    }
}

/// Returns the index of a implausibility in [`Implausibility::ALL`].
fn place(implausibility: Implausibility) -> Option<u32> {
    let mut rows = (0..).zip(Implausibility::ALL);
    rows.find(|(_, row)| row.0 == implausibility)
        .map(|(index, _)| index)
}

fn description(index: u32) -> &'static str {
    let row = usize::try_from(index)
        .ok()
        .and_then(|index| Implausibility::ALL.get(index));
    row.map_or("", |row| row.1)
}

/// Packs an address into 48 bits; FRI 1.0 uses IPv4 only.
fn packed(address: SocketAddr) -> u64 {
    match address {
        SocketAddr::V4(address) => {
            u64::from(address.ip().to_bits()) << 16 | u64::from(address.port())
        }
        SocketAddr::V6(_) => 0,
    }
}

fn unpacked(number: u64) -> Option<String> {
    let address = Ipv4Addr::from_bits((number >> 16) as u32);
    (number != 0).then(|| SocketAddrV4::new(address, number as u16).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fri_lwr::wire::MSR_SIZE;

    fn at(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    fn measured(sequence: u16) -> MeasurementDatagram {
        MeasurementDatagram {
            send_sequence: sequence,
            state: SessionState::Command,
            quality: Quality::Perfect,
            power: 0x7f,
            ..MeasurementDatagram::default()
        }
    }

    #[test]
    fn addresses_survive_being_packed() {
        assert_eq!(
            unpacked(packed(at(49_938))).as_deref(),
            Some("127.0.0.1:49938")
        );
        assert_eq!(unpacked(0), None);
    }

    #[test]
    fn refused_datagrams_are_counted_by_cause() {
        let counters = FriCounters::new(at(1), None, HeaderRule::Exact);
        counters.refused(b"hello", at(2), None);
        let mut other = measured(1).encode();
        other[6] = 9;
        counters.refused(&other, at(2), None);
        counters.refused(&measured(1).encode(), at(2), Some(Implausibility::Period));
        counters.foreign(at(3));
        let link = counters.link();
        assert_eq!(
            (&link["wrong_size"], &link["wrong_size_last"]),
            (&1.into(), &5.into())
        );
        assert_eq!(link["wrong_size_head"][0], 104);
        assert_eq!(
            (&link["wrong_identity"], &link["wrong_identity_last"]),
            (&1.into(), &0x2009.into())
        );
        assert_eq!(
            (&link["disordered"], &link["foreign"]),
            (&1.into(), &1.into())
        );
        assert_eq!(link["foreign_last"], "127.0.0.1:3");
        assert_eq!(link["doubted"], 1);
        let implausibility = link["doubt_last"].as_str().expect("words");
        assert!(
            implausibility.contains("settings.period_tolerance"),
            "{implausibility}"
        );
        assert!(link["wire"].is_null() && MSR_SIZE == 916);
    }

    #[test]
    fn gaps_intervals_and_answers_are_measured() {
        let counters = FriCounters::new(at(1), None, HeaderRule::Exact);
        for (sequence, now_ns) in [(65_534, 1_000_000), (65_535, 2_000_000), (2, 5_000_000)] {
            counters.accepted(now_ns, at(2), &measured(sequence));
            counters.answered(now_ns + 30_000);
        }
        let link = counters.link();
        assert_eq!(
            (&link["gaps"], &link["gaps_datagrams"]),
            (&1.into(), &2.into())
        );
        assert_eq!(link["interval_max_ns"], 3_000_000);
        assert_eq!(
            (&link["answer_mean_ns"], &link["answer_max_ns"]),
            (&30_000.into(), &30_000.into())
        );
        assert_eq!(
            (&link["wire"]["session"], &link["wire"]["quality"]),
            (&"command".into(), &"perfect".into())
        );
        counters.forget();
        counters.accepted(9_000_000_000, at(2), &measured(9));
        let link = counters.link();
        assert_eq!(
            (&link["gaps"], &link["interval_max_ns"]),
            (&1.into(), &0.into())
        );
    }
}
