//! Fingerprints of devices, differences of two configurations, and changes of the files. Run by the threads of the test
//! harness.

use std::collections::BTreeMap;
use std::path::Path;

use rcc_config::{CellConfig, ConfigChange, FileWatch, fingerprint};

use super::cell;

/// A cell with two devices, one with a robot, and all keys of channels.
const DEVICES: &str = "\
cell: test
period: 2 ms
clock: {device: lwr, offset: 300 us}
ports: {fri: 4000}
devices:
  lwr:
    driver: fri-lwr
    robot: robots/good.yaml
    first_tolerance: deg(0.2)
    base: {xyz: [0 m, 1 m, 0 m]}
    workspace: {box: {z: [0 m, 1 m]}, singularity: 0.05}
    command_timeout: 40 ms
    settings: {listen: \"127.0.0.1:${fri}\", retries: 3, pairs: [1, 2]}
    channels:
      door: {kind: digital input, address: 1}
      torch: {kind: digital output, address: 1, on_release: {safe: true}}
      gas: {kind: digital output, address: 2, on_release: {safe: true}}
      speed: {kind: analog output, address: holding 1, unit: m/s, scale: 2 mm/s, offset: -1 m/s, range: [-1 m/s, 1 m/s], on_release: {safe: -500 mm/s}}
      far: {kind: analog input, address: 4, unit: m}
  two:
    driver: fri-lwr
    robot: robots/good.yaml
    delay: 20 ms
";

/// Returns the parts of the device `lwr` with different fingerprints.
fn changed_parts(text: &str) -> Vec<&'static str> {
    let parts = |text: &str| {
        let devices = cell(text).device_fingerprints();
        let found = devices.into_iter().find(|(name, _)| name == "lwr");
        found.unwrap_or_else(|| panic!("no lwr in {text}")).1
    };
    let both = parts(DEVICES).into_iter().zip(parts(text));
    let rows = fingerprint::PARTS.into_iter().zip(both);
    let changed = rows.filter(|(_, (before, after))| before != after);
    changed.map(|(name, _)| name).collect()
}

#[test]
fn the_fingerprint_of_a_device_depends_on_all_that_its_driver_and_the_executor_agree_on() {
    let torch = "      torch: {kind: digital output, address: 1, on_release: {safe: true}}\n";
    let gas = "      gas: {kind: digital output, address: 2, on_release: {safe: true}}\n";
    let swapped = (format!("{torch}{gas}"), format!("{gas}{torch}"));
    for (from, to, part) in [
        ("driver: fri-lwr", "driver: ideal-arm", "driver"),
        ("period: 2 ms", "period: 1 ms", "timing"),
        ("command_timeout: 40 ms", "command_timeout: 41 ms", "timing"),
        ("offset: 300 us", "offset: 301 us", "timing"),
        ("clock: {device: lwr, offset: 300 us}\n", "", "timing"),
        (
            "first_tolerance: deg(0.2)",
            "first_tolerance: deg(0.3)",
            "robot",
        ),
        ("    base: {xyz: [0 m, 1 m, 0 m]}\n", "", "robot"),
        ("[0 m, 1 m, 0 m]", "[0 m, 1 m, 1 mm]", "robot"),
        ("z: [0 m, 1 m]", "z: [0 m, 2 m]", "robot"),
        ("singularity: 0.05", "singularity: 0.06", "robot"),
        ("fri: 4000", "fri: 4001", "settings"),
        ("retries: 3", "retries: 4", "settings"),
        ("retries: 3", "retries: \"3\"", "settings"),
        ("pairs: [1, 2]", "pairs: [2, 1]", "settings"),
        (&swapped.0, &swapped.1, "channels"),
        (torch, "", "channels"),
        ("torch:", "flame:", "channels"),
        (
            "torch: {kind: digital output, address: 1",
            "torch: {kind: digital output, address: 3",
            "channels",
        ),
        (
            "gas: {kind: digital output, address: 2",
            "gas: {kind: digital output, address: coil 2",
            "channels",
        ),
        ("safe: true", "safe: false", "channels"),
        ("on_release: {safe: true}", "on_release: hold", "channels"),
        ("safe: -500 mm/s", "safe: -499 mm/s", "channels"),
        ("kind: analog input", "kind: digital input", "channels"),
        ("scale: 2 mm/s", "scale: -2 mm/s", "channels"),
        ("offset: -1 m/s", "offset: -2 m/s", "channels"),
        (
            "range: [-1 m/s, 1 m/s]",
            "range: [-1 m/s, 2 m/s]",
            "channels",
        ),
        ("address: 4, unit: m", "address: 4, unit: 1", "channels"),
    ] {
        assert!(DEVICES.contains(from), "{from}");
        let mut text = DEVICES.replacen(from, to, 1);
        if to.starts_with("kind: digital") {
            text = text.replace(", unit: m}", "}");
        }
        assert_eq!(changed_parts(&text), [part], "{from} → {to}");
    }
    let mut robot = cell(DEVICES);
    let before = robot.device_fingerprints();
    robot.devices[0].robot.as_mut().unwrap().joints[3].velocity_rad_s += 1e-9;
    let after = robot.device_fingerprints();
    assert_eq!(
        (before[0] != after[0], before[1] != after[1]),
        (true, false)
    );
}

#[test]
fn the_fingerprint_of_a_device_ignores_what_its_driver_does_not_use() {
    for (from, to) in [
        ("cell: test", "# a comment\ncell: other\nstale_after: 80 ms"),
        (
            "devices:\n",
            "executor: {priority: 50}\ndevices:\n  new: {driver: modbus}\n",
        ),
        ("delay: 20 ms", "delay: 30 ms"),
        (
            "robot: robots/good.yaml",
            "robot: robots/../robots/good.yaml",
        ),
        ("retries: 3, pairs: [1, 2]", "pairs: [1, 2], retries: 3"),
        ("scale: 2 mm/s", "scale: 0.002 m/s"),
        (
            "      door: {kind: digital input, address: 1}\n      torch: {kind: digital output, address: 1, on_release: {safe: true}}\n",
            "      torch: {kind: digital output, address: 1, on_release: {safe: true}}\n      door: {kind: digital input, address: 1}\n",
        ),
    ] {
        assert!(DEVICES.contains(from), "{from}");
        assert_eq!(
            changed_parts(&DEVICES.replacen(from, to, 1)),
            [""; 0],
            "{to}"
        );
    }
    // Every process computes the same values, in every run and build: the expected numbers follow from the formula.
    let io = cell("cell: a\nperiod: 1 ms\ndevices:\n  b: {driver: c}\n");
    assert_eq!(io.device_fingerprints()[0].1[0], 0x8bf9_5d9b_108c_109c);
}

#[test]
fn differences_are_named_by_the_keys_of_the_file() {
    let before = cell(DEVICES);
    for (from, to, told) in [
        ("cell: test", "# a comment\ncell: test", ""),
        ("period: 2 ms", "period: 1 ms", "period"),
        (
            "cell: test",
            "cell: test\nexecutor: {priority: 50}",
            "executor",
        ),
        ("torch:", "flame:", "lwr: channels torch, flame"),
        (
            "address: 1, on_release",
            "address: 3, on_release",
            "lwr: channels torch",
        ),
        ("retries: 3", "retries: 4", "lwr: settings"),
        ("delay: 20 ms", "delay: 30 ms", "two: delay"),
        ("  two:", "  three:", "two: removed; three: new"),
        (
            "robot: robots/good.yaml",
            "robot: robots/../robots/good.yaml",
            "",
        ),
    ] {
        assert!(DEVICES.contains(from), "{from}");
        let after = cell(&DEVICES.replacen(from, to, 1));
        assert_eq!(before.differences(&after).join("; "), told, "{to}");
    }
    let mut swapped = cell(DEVICES);
    swapped.devices.swap(0, 1);
    assert_eq!(before.differences(&swapped), ["order of devices"]);
}

#[test]
fn a_change_of_the_files_is_reported_once() {
    let folder = rcc_testing::folder();
    let robot = std::fs::read_to_string("tests/bad/robots/good.yaml").unwrap();
    let (path, arm) = (
        folder.path().join("cell.yaml"),
        folder.path().join("good.yaml"),
    );
    let text = DEVICES.replace("robots/good.yaml", "good.yaml");
    let text = text.replace("{fri: 4000}", "{fri: auto udp}");
    let write = |path: &Path, text: &str| {
        // Like an editor: another inode, so that the change is noticed even within one tick of the file system's clock.
        std::fs::write(path.with_extension("new"), text).unwrap();
        std::fs::rename(path.with_extension("new"), path).unwrap();
    };
    write(&path, &text);
    write(&arm, &robot);
    let ports = BTreeMap::from([("fri".to_owned(), 4000)]);
    let running = CellConfig::load(&path, &ports).unwrap();
    let mut watch = FileWatch::new(running, ports);
    // Changed, and then unchanged for one poll.
    let mut look = || {
        let looks = [watch.poll().cloned(), watch.poll().cloned()];
        assert_eq!(looks[0], None);
        looks[1].clone()
    };
    assert_eq!(look(), None);
    let differs = |words: &str| ConfigChange::Differs(vec![words.to_owned()]);
    write(&path, &text.replace("retries: 3", "retries: 4"));
    assert_eq!(look(), Some(differs("lwr: settings")));
    assert_eq!(look(), None);
    write(
        &path,
        &format!("# four\n{}", text.replace("retries: 3", "retries: 4")),
    );
    assert_eq!(look(), None, "the same as before");
    write(
        &path,
        &text.replace("{fri: auto udp}", "{fri: auto udp, new: auto tcp}"),
    );
    assert_eq!(look(), Some(differs("ports")));
    write(&path, &text);
    assert_eq!(look(), Some(ConfigChange::None));
    write(&arm, &robot.replacen("deg/s", "rad/s", 1));
    let both = ConfigChange::Differs(vec!["lwr: robot".to_owned(), "two: robot".to_owned()]);
    assert_eq!(look(), Some(both));
    std::fs::remove_file(&arm).unwrap();
    assert!(matches!(look(), Some(ConfigChange::Invalid(why)) if why.contains("cannot be read")));
    write(&arm, &robot);
    assert_eq!(look(), Some(ConfigChange::None));
}
