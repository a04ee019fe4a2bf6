//! `simulate` and `plot` with contact: walls, forces, loads and readings of any sensor from the command line.

use std::fs;
use std::process::Output;

use rcc_testing::folder;

use crate::program::{config, rcc_cli};

fn net(name: &str) -> String {
    config(&format!("nets/{name}"))
}

fn run(verb: &str, arguments: &[&str]) -> Output {
    let mut command = rcc_cli(&[verb, "--output", "json"]);
    command.args(arguments).output().expect("rcc-cli runs")
}

/// Runs `simulate`, which must finish; returns its report.
fn finished(arguments: &[&str]) -> serde_json::Value {
    let output = run("simulate", arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {errors}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(report["reason"], "finished", "{report}");
    report
}

/// Returns the last value of a monitored port.
fn last(report: &serde_json::Value, port: &str) -> f64 {
    let rows = report["monitors"].as_array().expect("rows");
    let row = rows.iter().find(|row| {
        row["name"]
            .as_str()
            .is_some_and(|name| name.ends_with(port))
    });
    row.and_then(|row| row["last"].as_f64())
        .unwrap_or_else(|| panic!("{port}: {report}"))
}

/// Returns the message of an invalid command line.
fn refused(arguments: &[&str]) -> String {
    let output = run("simulate", arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
    errors
}

#[test]
fn the_guarded_line_stops_at_its_wall() {
    let line = net("guarded-line.yaml");
    let free = finished(&[&line]);
    assert!(
        (last(&free, "move.distance") - 0.180_3).abs() < 1e-3,
        "{free}"
    );
    assert_eq!(last(&free, "force.out"), 0.0);
    let wall = finished(&[&line, "--wall", "0,0,0.3,0,0,1"]);
    assert!(last(&wall, "move.distance") < 0.15, "{wall}");
    assert!(last(&wall, "force.out") > 12.0, "{wall}");
    // The same in words of its arm; a wall that appears after the end changes nothing.
    assert_eq!(
        wall,
        finished(&[&line, "--wall", "lwr:0,0,0.3,0,0,1,5000,20@0s"])
    );
    assert_eq!(free, finished(&[&line, "--wall", "0,0,0.3,0,0,1@30s"]));
}

#[test]
fn a_force_a_load_and_a_reading_stop_the_guarded_line() {
    let line = net("guarded-line.yaml");
    let at = |arguments: &[&str]| {
        let all: Vec<&str> = std::iter::once(line.as_str())
            .chain(arguments.iter().copied())
            .collect();
        let report = finished(&all);
        (last(&report, "move.distance"), last(&report, "force.out"))
    };
    let stopped = at(&["--force", "0,0,20@1s"]);
    assert!(
        stopped.0 < 0.15 && (stopped.1 - 20.0).abs() < 1e-9,
        "{stopped:?}"
    );
    // The name of the primitive that reads the sensor, the device's own, and the whole wrench.
    assert_eq!(stopped, at(&["--input", "ft.fz=20@1s"]));
    assert_eq!(stopped, at(&["--input", "lwr.fz=20 N@1s"]));
    assert_eq!(stopped, at(&["--input", "ft.wrench[2]=20@1s"]));
    // 2 kg weigh more than 12 N, 1 kg does not.
    let loaded = at(&["--load", "2@1s"]);
    assert!(
        loaded.0 < 0.15 && (loaded.1 - 2.0 * 9.806_65).abs() < 1e-9,
        "{loaded:?}"
    );
    assert!((at(&["--load", "1@1s"]).0 - 0.180_3).abs() < 1e-3);
    // A broken sensor stops it as well: null is a stop.
    let broken = run("simulate", &[&line, "--input", "ft.fz=null@1s"]);
    let report: serde_json::Value = serde_json::from_slice(&broken.stdout).expect("JSON");
    assert!(last(&report, "move.distance") < 0.15, "{report}");
}

#[test]
fn inputs_have_the_names_of_the_net_too() {
    let folder = folder();
    let text = "net: names
primitives:
  door:  {type: DigitalInput, parameters: {device: io, channel: door_closed}}
  hot:   {type: AnalogInput, parameters: {device: io, channel: temperature}}
  state: {type: JointState, parameters: {device: lwr}}
  speed: {type: Input, parameters: {initial: 0.1 m/s}}
  watch_door:   {type: Monitor, inputs: {value: door.out}}
  watch_hot:    {type: Monitor, inputs: {value: hot.out}}
  watch_torque: {type: Monitor, inputs: {value: state.torque}}
  watch_outer:  {type: Monitor, inputs: {value: state.external_torque}}
  watch_speed:  {type: Monitor, inputs: {value: speed.value}}
  end: {type: Termination, inputs: {done: false}}
discard: [state.position]
";
    let file = folder.path().join("names.yaml").display().to_string();
    fs::write(&file, text).expect("written");
    let arguments = |more: &[&'static str]| -> serde_json::Value {
        let all: Vec<&str> = [file.as_str(), "--for", "2s"]
            .into_iter()
            .chain(more.iter().copied())
            .collect();
        let output = run("simulate", &all);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{errors}");
        serde_json::from_slice(&output.stdout).expect("JSON")
    };
    let report = arguments(&[
        "--input=door.out=true",
        "--input=hot.out=300 K@1s",
        "--input=speed=0.2 m/s",
        "--input=speed=0.3 m/s@1s",
    ]);
    assert_eq!(last(&report, "door.out"), 1.0);
    assert_eq!(last(&report, "hot.out"), 300.0);
    assert_eq!(last(&report, "speed.value"), 0.3);
    // Without contact the joints carry the links; with a load the external torques carry it.
    let weight = last(&report, "state.torque[1]");
    assert!(weight.abs() > 5.0, "{weight}");
    assert_eq!(last(&report, "state.external_torque[1]"), 0.0);
    let loaded = arguments(&["--load=2", "--input=state.torque[0]=7"]);
    assert_eq!(last(&loaded, "state.torque[0]"), 7.0);
    // The flange is 0.538 m in front of J2, whose axis is -y.
    let expected = -2.0 * 9.806_65 * 0.538;
    let external = last(&loaded, "state.external_torque[1]");
    assert!((external - expected).abs() < 0.01, "{external} {expected}");
    let both = last(&loaded, "state.torque[1]");
    assert!((both - external - weight).abs() < 1e-6, "{both}");
}

#[test]
fn an_option_that_means_nothing_is_refused_with_what_there_is() {
    let line = net("guarded-line.yaml");
    for (arguments, parts) in [
        (
            ["--input", "fft.fz=20@1s"],
            vec!["fft", "primitives that measure: ft"],
        ),
        (
            ["--input", "xyz.fz=20"],
            vec!["neither a device nor a primitive", "lwr, io", "ft"],
        ),
        (["--input", "ft.fq=20"], vec!["no input `fq`", "fz"]),
        (["--input", "ft.fz=20 m"], vec!["unit N"]),
        (
            ["--input", "lwr.torque[7]=1"],
            vec!["torque[0] to torque[6]"],
        ),
        (["--input", "ft.fz"], vec!["device.channel=value"]),
        (["--wall", "0,0,0.3"], vec!["PX,PY,PZ"]),
        (["--wall", "0,0,0.3,0,0,0"], vec!["PX,PY,PZ"]),
        (["--wall", "io:0,0,0.3,0,0,1"], vec!["name the arm", "lwr"]),
        (["--force", "1,2"], vec!["FX,FY,FZ"]),
        (["--force", "0,0,20@soon"], vec!["FX,FY,FZ"]),
        (["--load", "-1"], vec!["KG"]),
    ] {
        let text = refused(&[&line, arguments[0], arguments[1]]);
        for part in parts {
            assert!(text.contains(part), "{arguments:?}: {part}: {text}");
        }
    }
    let cell = config("cells/two-arms.yaml");
    let shared = config("two-arms/shared-load.yaml");
    let text = refused(&[&shared, "--config", &cell, "--wall", "0,0,0.3,0,0,1"]);
    assert!(text.contains("name the arm, as in `left:…`"), "{text}");
}

#[test]
fn a_plot_with_contact_shows_force_and_torque() {
    let folder = folder();
    let svg = folder.path().join("wall.svg").display().to_string();
    let read = || fs::read_to_string(&svg).expect("it was written");
    let line = net("guarded-line.yaml");
    let output = run("plot", &[&line, "--wall", "0,0,0.3,0,0,1", "-o", &svg]);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{errors}");
    let text = read();
    assert!(text.contains("force on the flange [N]"), "{text}");
    assert!(text.contains("measured torque [N·m]"), "{text}");
    run("plot", &[&line, "-o", &svg]);
    assert!(!read().contains("force on the flange"));
}
