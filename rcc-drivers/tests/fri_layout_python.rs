//! The layout of the FRI datagrams against Python's `struct`, at offsets that are written only here, in Python.
//! Runs in the test harness; needs `python3`, and reports if it is missing.

use rcc_drivers::fri_lwr::wire::{
    CommandDatagram, FriControlStrategy, KrlBlock, MeasurementDatagram, Quality, SessionState,
};
use std::io::Write;
use std::process::{Command, Stdio};

/// Reads two lines of hexadecimal bytes (MSR, CMD), prints `name: values` for each field.
const PYTHON: &str = r#"
import struct, sys
msr, cmd = [bytes.fromhex(line.strip()) for line in sys.stdin]
assert (len(msr), len(cmd)) == (916, 376), (len(msr), len(cmd))
def show(data, format, offset, name):
    print(name + ':', *struct.unpack_from('<' + format, data, offset))
for name, data in (('msr', msr), ('cmd', cmd)):
    show(data, 'H', 0, name + ' sendSeqCount')
    show(data, 'H', 2, name + ' reflSeqCount')
    show(data, 'H', 4, name + ' packetSize')
    show(data, 'H', 6, name + ' datagramId')
    show(data, '16f', 8, name + ' realData')
    show(data, '16i', 72, name + ' intData')
    show(data, 'H', 136, name + ' boolData')
    show(data, 'H', 138, name + ' filler')
for format, offset, name in (
    ('f', 140, 'timestamp'), ('H', 144, 'state'), ('H', 146, 'quality'), ('f', 148, 'msrSampleTime'),
    ('f', 152, 'cmdSampleTime'), ('f', 156, 'safetyLimits'), ('f', 160, 'answerRate'), ('f', 164, 'latency'),
    ('f', 168, 'jitter'), ('f', 172, 'missRate'), ('I', 176, 'missCounter'), ('H', 180, 'power'),
    ('H', 182, 'control'), ('H', 184, 'error'), ('H', 186, 'warning'), ('7f', 188, 'temperature'),
    ('7f', 216, 'msrJntPos'), ('12f', 244, 'msrCartPos'), ('7f', 292, 'cmdJntPos'), ('7f', 320, 'cmdJntPosFriOffset'),
    ('12f', 348, 'cmdCartPos'), ('12f', 396, 'cmdCartPosFriOffset'), ('7f', 444, 'msrJntTrq'),
    ('7f', 472, 'estExtJntTrq'), ('6f', 500, 'estExtTcpFT'), ('42f', 524, 'jacobian'), ('49f', 692, 'massMatrix'),
    ('7f', 888, 'gravity')):
    show(msr, format, offset, 'msr ' + name)
for format, offset, name in (
    ('I', 140, 'cmdFlags'), ('7f', 144, 'jntPos'), ('12f', 172, 'cartPos'), ('7f', 220, 'addJntTrq'),
    ('6f', 248, 'addTcpFT'), ('7f', 272, 'jntStiffness'), ('7f', 300, 'jntDamping'), ('6f', 328, 'cartStiffness'),
    ('6f', 352, 'cartDamping')):
    show(cmd, format, offset, 'cmd ' + name)
"#;

/// Returns `N` values that occur nowhere else; exact in binary32, so that Python prints them without rounding.
fn ramp<const N: usize>(first: f32) -> [f32; N] {
    std::array::from_fn(|i| first + i as f32 / 64.0)
}

fn krl(first: f32) -> KrlBlock {
    KrlBlock {
        reals: ramp(first),
        integers: std::array::from_fn(|i| -70_000 - i as i32),
        booleans: 0xa5c3,
    }
}

fn measurement() -> MeasurementDatagram {
    MeasurementDatagram {
        send_sequence: 65_535,
        reflected_sequence: 258,
        krl: krl(1.0),
        timestamp: 1.5,
        state: SessionState::Command,
        quality: Quality::Perfect,
        measurement_period: 2.5,
        command_period: 3.5,
        safety_limits: 4.5,
        answer_rate: 5.5,
        latency: 6.5,
        jitter: 7.5,
        miss_rate: 8.5,
        miss_count: 4_000_000_000,
        power: 127,
        control: FriControlStrategy::Position,
        error: 513,
        warning: 1027,
        temperature: ramp(10.0),
        measured_position: ramp(11.0),
        measured_pose: ramp(12.0),
        commanded_position: ramp(13.0),
        commanded_position_offset: ramp(14.0),
        commanded_pose: ramp(15.0),
        commanded_pose_offset: ramp(16.0),
        measured_torque: ramp(17.0),
        external_torque: ramp(18.0),
        external_tcp_wrench: ramp(19.0),
        jacobian: ramp(20.0),
        mass_matrix: ramp(21.0),
        gravity: ramp(22.0),
    }
}

fn command() -> CommandDatagram {
    CommandDatagram {
        send_sequence: 772,
        reflected_sequence: 65_534,
        krl: krl(2.0),
        flags: 0x3537,
        joint_position: ramp(30.0),
        cartesian_position: ramp(31.0),
        additional_joint_torque: ramp(32.0),
        additional_tcp_wrench: ramp(33.0),
        joint_stiffness: ramp(34.0),
        joint_damping: ramp(35.0),
        cartesian_stiffness: ramp(36.0),
        cartesian_damping: ramp(37.0),
    }
}

type Expected = Vec<(&'static str, Vec<f64>)>;

fn numbers(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

fn frame(names: [&'static str; 8], head: [f64; 4], krl: &KrlBlock) -> Expected {
    let [send, reflected, size, id, reals, integers, booleans, filler] = names;
    vec![
        (send, vec![head[0]]),
        (reflected, vec![head[1]]),
        (size, vec![head[2]]),
        (id, vec![head[3]]),
        (reals, numbers(&krl.reals)),
        (
            integers,
            krl.integers.iter().map(|&value| f64::from(value)).collect(),
        ),
        (booleans, vec![f64::from(krl.booleans)]),
        (filler, vec![0.0]),
    ]
}

fn expected_measurement(m: &MeasurementDatagram) -> Expected {
    let mut all = frame(
        [
            "msr sendSeqCount",
            "msr reflSeqCount",
            "msr packetSize",
            "msr datagramId",
            "msr realData",
            "msr intData",
            "msr boolData",
            "msr filler",
        ],
        [65_535.0, 258.0, 916.0, 8198.0],
        &m.krl,
    );
    all.extend([
        ("msr timestamp", vec![1.5]),
        ("msr state", vec![2.0]),
        ("msr quality", vec![3.0]),
        ("msr msrSampleTime", vec![2.5]),
        ("msr cmdSampleTime", vec![3.5]),
        ("msr safetyLimits", vec![4.5]),
        ("msr answerRate", vec![5.5]),
        ("msr latency", vec![6.5]),
        ("msr jitter", vec![7.5]),
        ("msr missRate", vec![8.5]),
        ("msr missCounter", vec![4e9]),
        ("msr power", vec![127.0]),
        ("msr control", vec![1.0]),
        ("msr error", vec![513.0]),
        ("msr warning", vec![1027.0]),
        ("msr temperature", numbers(&m.temperature)),
        ("msr msrJntPos", numbers(&m.measured_position)),
        ("msr msrCartPos", numbers(&m.measured_pose)),
        ("msr cmdJntPos", numbers(&m.commanded_position)),
        (
            "msr cmdJntPosFriOffset",
            numbers(&m.commanded_position_offset),
        ),
        ("msr cmdCartPos", numbers(&m.commanded_pose)),
        ("msr cmdCartPosFriOffset", numbers(&m.commanded_pose_offset)),
        ("msr msrJntTrq", numbers(&m.measured_torque)),
        ("msr estExtJntTrq", numbers(&m.external_torque)),
        ("msr estExtTcpFT", numbers(&m.external_tcp_wrench)),
        ("msr jacobian", numbers(&m.jacobian)),
        ("msr massMatrix", numbers(&m.mass_matrix)),
        ("msr gravity", numbers(&m.gravity)),
    ]);
    all
}

fn expected_command(c: &CommandDatagram) -> Expected {
    let mut all = frame(
        [
            "cmd sendSeqCount",
            "cmd reflSeqCount",
            "cmd packetSize",
            "cmd datagramId",
            "cmd realData",
            "cmd intData",
            "cmd boolData",
            "cmd filler",
        ],
        [772.0, 65_534.0, 376.0, 4101.0],
        &c.krl,
    );
    all.extend([
        ("cmd cmdFlags", vec![f64::from(0x3537)]),
        ("cmd jntPos", numbers(&c.joint_position)),
        ("cmd cartPos", numbers(&c.cartesian_position)),
        ("cmd addJntTrq", numbers(&c.additional_joint_torque)),
        ("cmd addTcpFT", numbers(&c.additional_tcp_wrench)),
        ("cmd jntStiffness", numbers(&c.joint_stiffness)),
        ("cmd jntDamping", numbers(&c.joint_damping)),
        ("cmd cartStiffness", numbers(&c.cartesian_stiffness)),
        ("cmd cartDamping", numbers(&c.cartesian_damping)),
    ]);
    all
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the values that Python reads from both datagrams, or `None` without Python.
fn read_by_python(input: &str) -> Option<String> {
    let mut python = match Command::new("python3")
        .args(["-c", PYTHON])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
    {
        Ok(python) => python,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
        Err(error) => panic!("python3 does not start: {error}"),
    };
    python
        .stdin
        .take()
        .unwrap()
        .write_all(input.as_bytes())
        .unwrap();
    let output = python.wait_with_output().unwrap();
    assert!(
        output.status.success(),
        "python3 ended with {}",
        output.status
    );
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn python_reads_every_field_where_we_wrote_it() {
    let (measurement, command) = (measurement(), command());
    let input = format!(
        "{}\n{}\n",
        hexadecimal(&measurement.encode()),
        hexadecimal(&command.encode())
    );
    let Some(output) = read_by_python(&input) else {
        eprintln!("skipped: no python3 (python_reads_every_field_where_we_wrote_it)");
        return;
    };
    let mut expected = expected_measurement(&measurement);
    expected.extend(expected_command(&command));
    let read: std::collections::BTreeMap<&str, Vec<f64>> = output
        .lines()
        .map(|line| {
            let (name, values) = line.split_once(':').unwrap();
            (
                name,
                values
                    .split_whitespace()
                    .map(|value| value.parse().unwrap())
                    .collect(),
            )
        })
        .collect();
    assert_eq!(read.len(), expected.len());
    for (name, values) in expected {
        assert_eq!(read.get(name), Some(&values), "{name}");
    }
}

#[test]
fn what_was_encoded_decodes_to_the_same_values() {
    assert_eq!(
        MeasurementDatagram::decode(&measurement().encode()),
        Ok(measurement())
    );
    assert_eq!(CommandDatagram::decode(&command().encode()), Ok(command()));
}
