//! Meaning of a cell's file: defaults, numbers, placeholders, models and the fingerprint. Tests of texts; the only
//! files read are those next to them.

mod devices;

use std::collections::BTreeMap;
use std::path::Path;

use rcc_config::cell::{ClockConfig, RealTime, SupervisionConfig};
use rcc_config::diagnostic::Faults;
use rcc_config::{AccessConfig, CellConfig, OnRelease, ports::PortArgument};
use rcc_core::kinematics::Arm;
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;

const TEXT: &str = "\
cell: test
period: 2 ms
ports: {fri: auto udp, io: 502}
simulators:
  sim: {program: lwr-sim, arguments: [\"--driver=127.0.0.1:${fri}\", --seed, 5]}
devices:
  lwr:
    driver: fri-lwr
    robot: robots/good.yaml
    settings: {listen: [\"127.0.0.1:${fri}\", \"${io}-${fri}\"], retries: 3}
    channels:
      door: {kind: digital input, address: 1}
      torch: {kind: digital output, address: 1, on_release: {safe: true}}
      gun: {kind: digital output, address: 2, on_release: hold}
      speed: {kind: analog output, address: holding 1, unit: m/s, scale: 2 mm/s, offset: -1 m/s, range: [-1 m/s, 1 m/s], on_release: {safe: -500 mm/s}}
  io: {driver: modbus}
";

fn parse(text: &str) -> Result<CellConfig, Faults> {
    let chosen = [("fri".to_owned(), 4000)];
    let ports = chosen
        .into_iter()
        .filter(|_| text.contains("auto udp"))
        .collect();
    CellConfig::parse(text, "test.yaml", Path::new("tests/bad"), &ports)
}

fn cell(text: &str) -> CellConfig {
    parse(text).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn omitted_keys_have_their_documented_defaults() {
    let cell = cell("cell: a\nperiod: 1 ms\ndevices:\n  b: {driver: c, robot: robots/good.yaml}\n");
    assert_eq!(cell.stale_after_ns, 50_000_000);
    assert_eq!((cell.executor.priority, cell.executor.core), (80, None));
    assert_eq!(cell.executor.late_in_a_row_max, 100);
    assert_eq!(cell.budget_ns(), 500_000);
    assert!(cell.simulators.is_empty() && cell.ports.is_empty());
    let device = &cell.devices[0];
    assert_eq!(device.delay_ns, 10_000_000);
    assert_eq!(device.command_timeout_ns, 50_000_000);
    assert!((device.first_tolerance_rad.to_degrees() - 0.1).abs() < 1e-15);
    assert_eq!(device.settings, serde_json::json!({}));
}

#[test]
fn the_recorder_is_on_unless_its_memory_is_zero() {
    let with = |recorder: &str| {
        let rest = "devices:\n  b: {driver: c, robot: robots/good.yaml}\n";
        parse(&format!("cell: a\nperiod: 1 ms\n{recorder}{rest}"))
    };
    let usual = with("").expect("valid").recorder;
    assert_eq!(
        (usual.span_ns, usual.memory >> 20, usual.files),
        (10_000_000_000, 64, 16)
    );
    assert_eq!((usual.folder, usual.keep >> 20), (None, 200));
    let large = with("recorder: {memory: 1 GB}\n").expect("valid").recorder;
    assert_eq!((large.memory >> 20, large.keep >> 20), (1024, 1024));
    let own = "recorder: {seconds: 2.5, memory: 8 MB, files: 3, folder: kept, keep: 2 GB}\n";
    let own = with(own).expect("valid").recorder;
    assert_eq!(
        (own.span_ns, own.memory >> 20, own.files),
        (2_500_000_000, 8, 3)
    );
    assert!(own.folder.is_some_and(|folder| folder.ends_with("kept")));
    assert_eq!(own.keep >> 20, 2048);
    assert_eq!(
        with("recorder: {memory: 0 MB}\n")
            .expect("valid")
            .recorder
            .memory,
        0
    );
    for (bad, count) in [
        ("recorder: {memory: 64}\n", 1),
        ("recorder: {memory: -1 MB, seconds: 0, files: 0}\n", 3),
        ("recorder: {memory: 64 GB}\n", 1),
        ("recorder: {keep: 200}\n", 1),
        ("recorder: {keep: 0 MB}\n", 1),
        // Less than the recorder's memory: an incident file would be removed as soon as it is written.
        ("recorder: {keep: 63 MB}\n", 1),
        ("recorder: {memory: 8 MB, keep: 7 MB}\n", 1),
        ("recorder: {second: 3}\n", 1),
    ] {
        let faults = with(bad).expect_err("refused");
        assert_eq!(faults.diagnostics.len(), count, "{bad}: {faults}");
    }
}

#[test]
fn supervision_follows_the_file_and_has_defaults() {
    let devices = "devices:\n  b: {driver: c}\n";
    let usual = cell(&format!("cell: a\nperiod: 1 ms\n{devices}"));
    let SupervisionConfig {
        restarts,
        within_ns,
        stop_timeout_ns,
        watchdog_ns,
    } = usual.supervision;
    assert_eq!((restarts, within_ns), (5, 30_000_000_000));
    assert_eq!(
        (stop_timeout_ns, watchdog_ns),
        (5_000_000_000, 2_000_000_000)
    );
    assert_eq!(usual.executor.rt, RealTime::BestEffort);
    let given = cell(&format!(
        "cell: a\nperiod: 1 ms\nexecutor: {{rt: required}}\n\
         supervision: {{restarts: 0, within: 1 min, stop_timeout: 1 s, watchdog: 500 ms}}\n{devices}"
    ));
    assert_eq!(given.supervision.restarts, 0);
    assert_eq!(given.supervision.within_ns, 60_000_000_000);
    assert_eq!(given.supervision.stop_timeout_ns, 1_000_000_000);
    assert_eq!(given.supervision.watchdog_ns, 500_000_000);
    assert_eq!(given.executor.rt, RealTime::Required);
}

#[test]
fn a_watchdog_time_that_kills_busy_processes_is_refused() {
    let text = "cell: a\nperiod: 1 ms\nsupervision: {watchdog: 10 ms, restarts: -1}\ndevices:\n  b: {driver: c}\n";
    let faults = parse(text).unwrap_err().to_string();
    assert!(
        faults.contains("watchdog is 10 ms, but must be from 500 ms to 60 s"),
        "{faults}"
    );
    assert!(faults.contains("restarts is -1"), "{faults}");
}

#[test]
fn by_default_only_its_user_reaches_a_cell() {
    let text = "cell: a\nperiod: 1 ms\ndevices: {b: {driver: c}}\n";
    assert_eq!(cell(text).access, AccessConfig::default());
    let open =
        "access: {group: rcc, tcp: {listen: \"0.0.0.0:80\", token_file: t, allow_remote: true}}\n";
    let access = cell(&format!("{text}{open}")).access;
    assert_eq!(access.group.as_deref(), Some("rcc"));
    let tcp = access.tcp.expect("it is given");
    assert_eq!(tcp.listen.to_string(), "0.0.0.0:80");
    assert_eq!(tcp.token_file, Path::new("tests/bad/t"));
}

#[test]
fn the_clock_is_the_executors_own_or_follows_a_device() {
    let text = "cell: a\nperiod: 125 us\ndevices: {b: {driver: c}, d: {driver: c}}\n";
    assert_eq!(cell(text).clock, None);
    let clock = |line: &str| cell(&format!("{text}{line}\n")).clock.expect("it is given");
    let ClockConfig { device, offset_ns } = clock("clock: {device: d, offset: 40 us}");
    assert_eq!((device, offset_ns), (1, 40_000));
    assert_eq!(
        clock("clock: {device: b}").offset_ns,
        62_500,
        "at most half of the period"
    );
}

#[test]
fn default_times_fit_the_period() {
    let slow = cell("cell: a\nperiod: 100 ms\ndevices: {b: {driver: c}}\n");
    assert_eq!(slow.stale_after_ns, 300_000_000);
    assert_eq!(slow.devices[0].command_timeout_ns, 300_000_000);
    let fast = cell("cell: a\nperiod: 100 us\ndevices: {b: {driver: c}}\n");
    assert_eq!(fast.period_ns, 100_000);
    assert_eq!(fast.devices[0].delay_ns, 10_000_000);
}

#[test]
fn placeholders_become_the_numbers_of_the_ports() {
    let cell = cell(TEXT);
    assert_eq!(
        cell.ports,
        BTreeMap::from([("fri".into(), 4000), ("io".into(), 502)])
    );
    assert_eq!(
        cell.simulators[0].arguments,
        ["--driver=127.0.0.1:4000", "--seed", "5"]
    );
    let settings = &cell.devices[0].settings;
    assert_eq!(
        settings,
        &serde_json::json!({"listen": ["127.0.0.1:4000", "502-4000"], "retries": 3})
    );
}

#[test]
fn a_number_that_is_given_replaces_a_fixed_port() {
    let given = BTreeMap::from([("fri".to_owned(), 1), ("io".to_owned(), 2)]);
    let cell = CellConfig::parse(TEXT, "test.yaml", Path::new("tests/bad"), &given).unwrap();
    assert_eq!(cell.ports, given);
}

#[test]
fn channels_are_counted_by_kind_and_are_in_si() {
    let cell = cell(TEXT);
    let (index, lwr) = cell.device("lwr").unwrap();
    assert_eq!(index, 0);
    let outputs: Vec<_> = lwr.channels_of(ChannelKind::DigitalOutput).collect();
    let rows: Vec<_> = outputs
        .iter()
        .map(|c| (c.name.as_str(), c.index, c.on_release))
        .collect();
    assert_eq!(
        rows,
        [
            ("torch", 0, Some(OnRelease::Safe(1.0))),
            ("gun", 1, Some(OnRelease::Hold))
        ]
    );
    assert_eq!(
        lwr.channel(ChannelKind::DigitalInput, "door")
            .unwrap()
            .on_release,
        None
    );
    assert!(lwr.channel(ChannelKind::DigitalInput, "torch").is_none());
    let speed = lwr.channel(ChannelKind::AnalogOutput, "speed").unwrap();
    assert_eq!(speed.unit, Unit::METRE_PER_SECOND);
    assert_eq!((speed.scale, speed.offset), (0.002, -1.0));
    assert_eq!(
        (speed.range, speed.on_release),
        (Some([-1.0, 1.0]), Some(OnRelease::Safe(-0.5)))
    );
    assert_eq!(speed.address, "holding 1");
}

#[test]
fn models_have_the_joints_and_channels_of_their_devices() {
    let models = cell(TEXT).models();
    assert_eq!(models[0].channels, [1, 2, 0, 1]);
    assert_eq!((models[0].joints, models[0].limits.joints), (7, 7));
    assert!(models[0].arm.is_some());
    assert!((models[0].limits.velocity_max[6].to_degrees() - 110.0).abs() < 1e-12);
    assert_eq!(models[0].limits.lower[7], 0.0);
    assert_eq!((models[1].joints, models[1].channels), (0, [0; 4]));
    assert!(models[1].arm.is_none());
}

#[test]
fn json_and_yaml_mean_the_same() {
    let tree = rcc_config::yaml::parse(TEXT).unwrap().to_json();
    let json = serde_json::to_string_pretty(&tree).unwrap();
    assert_eq!(cell(&json), cell(TEXT));
}

#[test]
fn the_fingerprint_depends_on_what_a_plan_depends_on() {
    let original = cell(TEXT).fingerprint();
    for (from, to) in [
        ("period: 2 ms", "period: 1 ms"),
        ("lwr:", "arm:"),
        ("robot: robots/good.yaml", "first_tolerance: null"),
        ("door:", "gate:"),
        ("kind: digital input", "kind: analog input"),
        (
            "unit: m/s, scale: 2 mm/s, offset: -1 m/s, range: [-1 m/s, 1 m/s], on_release: {safe: -500 mm/s}",
            "on_release: hold",
        ),
        ("range: [-1 m/s, 1 m/s]", "range: [-1 m/s, 2 m/s]"),
        ("  io: {driver: modbus}", ""),
        (
            "  io: {driver: modbus}",
            "  io: {driver: modbus, channels: {a: {kind: digital input, address: 1}}}",
        ),
    ] {
        assert!(TEXT.contains(from), "{from}");
        assert_ne!(
            cell(&TEXT.replacen(from, to, 1)).fingerprint(),
            original,
            "{to}"
        );
    }
    let mut joint = cell(TEXT);
    joint.devices[0].robot.as_mut().unwrap().joints[3].upper_rad += 1e-9;
    assert_ne!(joint.fingerprint(), original);
    let mut arm = cell(TEXT);
    match &mut arm.devices[0].robot.as_mut().unwrap().arm {
        Arm::Srs(arm) => arm.forearm += 1e-9,
        Arm::OrthoParallel(_) | Arm::Serial(_) => panic!("seven joints"),
    }
    assert_ne!(arm.fingerprint(), original);
    let mut swapped = cell(TEXT);
    swapped.devices.swap(0, 1);
    assert_ne!(swapped.fingerprint(), original);
}

#[test]
fn the_fingerprint_does_not_depend_on_how_devices_are_reached() {
    let original = cell(TEXT).fingerprint();
    for (from, to) in [
        ("io: 502", "io: 503"),
        ("driver: modbus", "driver: ethercat"),
        ("retries: 3", "retries: 4"),
        ("address: 1", "address: 9"),
        ("scale: 2 mm/s", "scale: 3 mm/s"),
        ("cell: test", "# a comment\ncell: test"),
    ] {
        assert!(TEXT.contains(from), "{from}");
        assert_eq!(
            cell(&TEXT.replacen(from, to, 1)).fingerprint(),
            original,
            "{to}"
        );
    }
}

#[test]
fn no_damage_to_a_text_makes_the_reader_panic() {
    let robots = Path::new("tests/bad");
    let read = |text: &str| {
        if let Err(faults) = CellConfig::parse(text, "test.yaml", robots, &BTreeMap::new()) {
            assert!(faults.has_errors(), "{text}");
        }
    };
    for (at, _) in TEXT.char_indices() {
        read(&TEXT[..at]);
        read(&format!("{}{}", &TEXT[..at], &TEXT[at + 1..]));
    }
    let lines: Vec<_> = TEXT.lines().collect();
    for left_out in 0..lines.len() {
        let mut rest = lines.clone();
        rest.remove(left_out);
        read(&rest.join("\n"));
    }
}

#[test]
fn a_port_on_the_command_line_is_name_and_number() {
    let port: PortArgument = "fri=49938".parse().unwrap();
    assert_eq!((port.name.as_str(), port.number), ("fri", 49938));
    for bad in ["fri", "=1", "fri=", "fri=65536", "fri=-1", ""] {
        let error = bad.parse::<PortArgument>().unwrap_err().to_string();
        assert!(error.contains("name=number"), "{error}");
    }
}

#[test]
fn a_workspace_bounds_the_axes_that_it_names() {
    let with = |workspace: &str| {
        let rest = format!("devices:\n  b: {{driver: c, robot: robots/good.yaml{workspace}}}\n");
        parse(&format!("cell: a\nperiod: 1 ms\n{rest}"))
    };
    let none = with("").expect("valid");
    assert_eq!(none.devices[0].workspace, None);
    let space = with(
        ", workspace: {box: {x: [0.2 m, 800 mm], z: [-5 mm, 1 m]}, point: [0 m, 0 m, 0.15 m]}",
    );
    let cell = space.expect("valid");
    let space = cell.models()[0].workspace.expect("a workspace");
    assert_eq!((space.lower[0], space.upper[0]), (0.2, 0.8));
    assert_eq!(
        (space.lower[1], space.upper[1]),
        (f64::NEG_INFINITY, f64::INFINITY)
    );
    assert_eq!((space.lower[2], space.upper[2]), (-0.005, 1.0));
    assert_eq!(space.point, [0.0, 0.0, 0.15]);
    assert_ne!(cell.fingerprint(), none.fingerprint());
    let away = with(", workspace: {singularity: 0.05}").expect("valid");
    let only = away.models()[0].workspace.expect("a workspace");
    assert_eq!((only.singularity_min, space.singularity_min), (0.05, 0.0));
    assert_eq!(only.lower, [f64::NEG_INFINITY; 3]);
    let less = with(", workspace: {singularity: 0.04}").expect("valid");
    assert_ne!(away.fingerprint(), less.fingerprint());
    for (bad, count) in [
        (", workspace: {singularity: 0}", 1),
        (", workspace: {singularity: 1.5}", 1),
        (", workspace: {}", 1),
        (", workspace: {box: {}}", 1),
        (", workspace: {box: {x: [1 m, 0 m], y: [0, 1 m]}}", 2),
        (
            ", workspace: {box: {x: [0 m, 1 m]}, point: [0 m, 1 m], colour: red}",
            2,
        ),
    ] {
        let faults = with(bad).expect_err("refused");
        assert_eq!(faults.diagnostics.len(), count, "{bad}: {faults}");
    }
    let io = parse(
        "cell: a\nperiod: 1 ms\ndevices:\n  b: {driver: c, workspace: {box: {x: [0 m, 1 m]}}}\n",
    );
    assert_eq!(io.expect_err("no arm").diagnostics.len(), 1);
}

#[test]
fn a_base_is_the_pose_of_an_arm() {
    let with = |base: &str| {
        let rest = format!("devices:\n  b: {{driver: c, robot: robots/good.yaml{base}}}\n");
        parse(&format!("cell: a\nperiod: 1 ms\n{rest}"))
    };
    let none = with("").expect("valid");
    assert_eq!(none.models()[0].base, rcc_core::pose::Pose::IDENTITY);
    let cell = with(", base: {xyz: [0 m, 900 mm, 0 m], rpy: [0 deg, 0 deg, 180 deg]}");
    let cell = cell.expect("valid");
    let base = cell.models()[0].base;
    assert_eq!(base.position, [0.0, 0.9, 0.0]);
    let front = base.rotate([1.0, 0.0, 0.0]);
    assert!((front[0] + 1.0).abs() < 1e-15 && front[1].abs() < 1e-15);
    assert_ne!(cell.fingerprint(), none.fingerprint());
    for (bad, count) in [
        (", base: {}", 1),
        (", base: {xyz: [0 m, 1 m]}", 1),
        (
            ", base: {xyz: [0 m, 0 m, 1 deg], rpy: [0 m, 0 deg, 0 deg], height: 1 m}",
            3,
        ),
    ] {
        let faults = with(bad).expect_err("refused");
        assert_eq!(faults.diagnostics.len(), count, "{bad}: {faults}");
    }
    let io =
        parse("cell: a\nperiod: 1 ms\ndevices:\n  b: {driver: c, base: {xyz: [0 m, 0 m, 0 m]}}\n");
    assert_eq!(io.expect_err("no arm").diagnostics.len(), 1);
}
