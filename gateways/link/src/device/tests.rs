use rcc_driver_kit::driver::{Driver, LinkError};
use rcc_driver_kit::rcc_config::{CellConfig, DeviceConfig};
use serde_json::json;

use super::channels::link_channels;
use super::inbox::{ChannelState, Inbox};
use super::*;
use crate::message::{TopicMessage, VERSION};

const MS: u64 = 1_000_000;
const EXPIRES: u64 = 100 * MS;

/// A cell with one link device, with these settings and channels.
fn device(settings: &str, channels: &str) -> DeviceConfig {
    let text = format!(
        "cell: b\nperiod: 1 ms\ndevices:\n  press:\n    driver: {{program: rcc-link-device}}\n    settings: {settings}\n    channels: {channels}\n"
    );
    let cell = CellConfig::parse_offline(&text, "cell.yaml", std::path::Path::new(""));
    cell.unwrap_or_else(|faults| panic!("{faults}"))
        .devices
        .remove(0)
}

const SETTINGS: &str = "{peer: lab/press, connect: [\"tcp/127.0.0.1:1\"]}";
const CHANNELS: &str = "{open: {kind: digital input, address: door/open}, force: {kind: analog input, address: force, unit: N}, \
    second: {kind: analog input, address: 'joints[1]', unit: rad}}";

fn inbox() -> Inbox {
    Inbox::new(link_channels(&device(SETTINGS, CHANNELS)).expect("channels"))
}

fn message(
    sequence: u64,
    sent_ns: u64,
    ty: &str,
    unit: Option<&str>,
    value: Value,
) -> TopicMessage {
    TopicMessage {
        version: VERSION,
        sender: "1".to_owned(),
        sequence,
        sent_ns,
        age_ns: 2 * MS,
        ty: ty.to_owned(),
        unit: unit.map(str::to_owned),
        value,
    }
}

fn take(inbox: &Inbox, topic: &str, message: &TopicMessage, arrival_ns: u64) {
    inbox.take_at(topic, &message.bytes().expect("bytes"), arrival_ns);
}

/// Takes a message of the topic `force`.
fn take_force(inbox: &Inbox, (sequence, sent_ns): (u64, u64), newtons: f64, arrival_ns: u64) {
    let message = message(sequence, sent_ns, "Real", Some("N"), json!(newtons));
    take(inbox, "force", &message, arrival_ns);
}

#[test]
fn each_channel_has_the_newest_value_of_its_topic() {
    let inbox = inbox();
    assert_eq!(inbox.read_at(0, EXPIRES).worst, ChannelState::Never);
    take(
        &inbox,
        "door/open",
        &message(1, 0, "Bool", None, json!(true)),
        MS,
    );
    take_force(&inbox, (1, 0), 12.5, MS);
    take(
        &inbox,
        "joints",
        &message(1, 0, "Real[3]", Some("rad"), json!([0.1, 0.2, null])),
        MS,
    );
    let read = inbox.read_at(2 * MS, EXPIRES);
    assert_eq!((read.worst, read.fresh), (ChannelState::Fresh, 3));
    assert_eq!((read.inputs.digital, read.inputs.digital_known), (1, 1));
    assert_eq!(&read.inputs.analog[..2], &[12.5, 0.2]);
    take(
        &inbox,
        "door/open",
        &message(2, 10 * MS, "Bool", None, json!(false)),
        11 * MS,
    );
    let read = inbox.read_at(12 * MS, EXPIRES);
    assert_eq!((read.inputs.digital, read.inputs.digital_known), (0, 1));
}

#[test]
fn a_value_that_is_too_old_is_null_and_never_the_last_one() {
    let inbox = inbox();
    take_force(&inbox, (1, 0), 12.5, MS);
    // 2 ms at the sender.
    assert_eq!(inbox.read_at(99 * MS, EXPIRES).inputs.analog[0], 12.5);
    assert!(inbox.read_at(100 * MS, EXPIRES).inputs.analog[0].is_nan());
}

/// A link that was cut delivers what waited in its queues: that is as old as the cut was long.
#[test]
fn what_a_cut_has_delayed_is_not_new() {
    let inbox = inbox();
    take_force(&inbox, (1, 0), 1.0, MS);
    take_force(&inbox, (2, 10 * MS), 2.0, 3011 * MS);
    assert!(inbox.read_at(3011 * MS, EXPIRES).inputs.analog[0].is_nan());
    take_force(&inbox, (3, 3010 * MS), 3.0, 3012 * MS);
    assert_eq!(inbox.read_at(3012 * MS, EXPIRES).inputs.analog[0], 3.0);
}

#[test]
fn older_messages_and_those_of_an_earlier_life_change_nothing() {
    let inbox = inbox();
    take_force(&inbox, (5, 50 * MS), 5.0, 51 * MS);
    take_force(&inbox, (4, 40 * MS), 4.0, 52 * MS);
    assert_eq!(inbox.read_at(53 * MS, EXPIRES).inputs.analog[0], 5.0);
    let next = TopicMessage {
        sender: "2".to_owned(),
        ..message(1, 0, "Real", Some("N"), json!(9.0))
    };
    take(&inbox, "force", &next, 60 * MS);
    take_force(&inbox, (6, 60 * MS), 6.0, 61 * MS);
    let read = inbox.read_at(62 * MS, EXPIRES);
    assert_eq!((read.inputs.analog[0], read.out_of_order), (9.0, 2));
}

#[test]
fn another_type_or_unit_is_no_value() {
    for (ty, unit, value) in [
        ("Real", Some("m"), json!(1.0)),
        ("Real", None, json!(1.0)),
        ("Bool", Some("N"), json!(true)),
        ("Int", Some("N"), json!(1)),
        ("Real[2]", Some("N"), json!([1.0, 2.0])),
        ("Real", Some("N"), json!("inf")),
    ] {
        let inbox = inbox();
        take(&inbox, "force", &message(1, 0, ty, unit, value), MS);
        let read = inbox.read_at(MS, EXPIRES);
        assert_eq!(read.worst, ChannelState::OtherKind, "{ty} {unit:?}");
        assert!(read.inputs.analog[0].is_nan());
    }
    let inbox = inbox();
    take(
        &inbox,
        "force",
        &message(1, 0, "Real", Some("m"), json!(1.0)),
        MS,
    );
    let row = &inbox.describe(MS, EXPIRES)["force"];
    assert_eq!(row["state"], "is Real in m, but the channel is Real in N");
}

#[test]
fn bytes_that_are_no_message_are_counted_and_refused() {
    let inbox = inbox();
    take_force(&inbox, (1, 0), 1.0, MS);
    for bytes in [&b"{}"[..], b"", b"\xff"] {
        inbox.take_at("force", bytes, 2 * MS);
    }
    let read = inbox.read_at(2 * MS, EXPIRES);
    assert_eq!((read.refused, read.inputs.analog[0]), (3, 1.0));
}

#[test]
fn what_cannot_work_is_refused_when_the_driver_is_opened() {
    let table = [
        (
            "{connect: [\"tcp/127.0.0.1:1\"]}",
            CHANNELS,
            "settings.peer: is missing",
        ),
        (
            "{peer: lab/press}",
            CHANNELS,
            "settings.connect: is missing",
        ),
        (
            "{peer: press, connect: [\"tcp/127.0.0.1:1\"]}",
            CHANNELS,
            "settings.peer",
        ),
        (
            "{peer: lab/press, connect: [\"127.0.0.1:1\"]}",
            CHANNELS,
            "settings.connect",
        ),
        (
            "{peer: lab/press, connect: [\"tcp/127.0.0.1:1\"], expire: 1 s}",
            CHANNELS,
            "unknown setting",
        ),
        (
            "{peer: lab/press, connect: [\"tcp/127.0.0.1:1\"], on_loss: hold}",
            CHANNELS,
            "settings.on_loss",
        ),
        (
            SETTINGS,
            "{lamp: {kind: digital output, address: lamp, on_release: hold}}",
            "channels.lamp: nothing is written",
        ),
        (
            SETTINGS,
            "{open: {kind: digital input, address: 3}}",
            "channels.open: invalid address 3",
        ),
        (
            SETTINGS,
            "{open: {kind: digital input, address: 'door//open'}}",
            "channels.open: invalid address",
        ),
        (
            SETTINGS,
            "{force: {kind: analog input, address: f, unit: N, scale: 2 N}}",
            "channels.force: topics have SI units",
        ),
        (SETTINGS, "{}", "the device has no channels"),
    ];
    for (settings, channels, words) in table {
        let error = LinkDevice::open(&device(settings, channels)).expect_err(words);
        assert!(error.to_string().contains(words), "{error}");
    }
}

/// Two sessions of one process: a value arrives, and a peer that is not there is a loss with its reason.
#[test]
fn a_topic_of_a_peer_becomes_an_input() {
    let port = rcc_config::free_port(rcc_config::Protocol::Tcp).expect("a port");
    let settings = format!(
        "{{peer: lab/press, connect: [\"tcp/127.0.0.1:{port}\"], period: 1 ms, expires: 10 s}}"
    );
    let mut driver = LinkDevice::open(&device(
        &settings,
        "{force: {kind: analog input, address: force, unit: N}}",
    ))
    .expect("a driver");
    let mut inputs = Inputs::NONE;
    let timeout = Duration::from_millis(10);
    assert_eq!(
        driver.receive(timeout, &mut inputs),
        Err(LinkError::Lost {
            reason: NO_CONNECTION
        })
    );
    let sender = session::open(&[format!("tcp/127.0.0.1:{port}")], &[], None).expect("a session");
    let key = CellKeys::new("lab", "press").topic("force").expect("a key");
    let mut sequence = 0;
    // Messages that do not name their key, or name another one, are not its values.
    let publish = |sequence: u64, value: Value, named: Option<&str>| {
        let bytes = message(sequence, sequence, "Real", Some("N"), value).bytes();
        let put = sender.put(&key, bytes.expect("bytes")).attachment(named);
        put.wait().expect("it is sent");
    };
    let other = CellKeys::new("lab", "press").topic("other").expect("a key");
    while driver.inbox.read(0).refused < 2 {
        publish(u64::MAX, json!(-1.0), Some(&other));
        publish(u64::MAX, json!(-1.0), None);
        assert!(driver.receive(timeout, &mut inputs).is_err());
    }
    let exchange = loop {
        sequence += 1;
        publish(sequence, json!(sequence), Some(&key));
        match driver.receive(timeout, &mut inputs) {
            Ok(exchange) => break exchange,
            Err(error) => assert!(sequence < 20_000, "{error}"),
        }
    };
    assert_eq!((exchange.quality_permille, exchange.reason), (1000, 0));
    assert!(
        inputs.analog[0] >= 1.0 && inputs.analog[0] <= sequence as f64,
        "{inputs:?}"
    );
    let link = driver.diagnosis().expect("a diagnosis").link();
    assert_eq!(link["connections"], 1, "{link}");
    sender.close().wait().expect("it closes");
}
