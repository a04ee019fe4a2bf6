//! `rcc-cli simulate` as a program: every example net, scripted inputs, tables and plots, reproducibility, exit codes.
//! Virtual time, without a cell. Run by the threads of the test harness.

use std::fs;
use std::path::PathBuf;
use std::process::Output;

use rcc_testing::TempDir;
use serde_json::Value;

use crate::program::{rcc_cli, repository, run_to};

/// A temporary folder of one test, removed at its end.
struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(rcc_testing::folder())
    }

    fn file(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.0.path().join(name)).expect("it was written")
    }
}

fn nets() -> PathBuf {
    repository().join("configs/nets")
}

fn net(name: &str) -> String {
    nets().join(name).display().to_string()
}

fn simulate(arguments: &[&str]) -> Output {
    let mut command = rcc_cli(&["--output", "json", "simulate"]);
    command.args(arguments).output().expect("rcc-cli runs")
}

/// Runs a simulation that must end with this exit code; returns its report.
fn report(exit: i32, arguments: &[&str]) -> Value {
    let output = simulate(arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(exit), "{arguments:?}: {errors}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn every_example_net_runs_and_ends_as_it_is_meant_to() {
    let mut count = 0;
    for file in fs::read_dir(nets()).expect("the example nets") {
        let path = file.expect("a file").path();
        let name = path.display().to_string();
        // A line that cannot be canceled ends by itself earlier.
        let report = report(0, &[&name, "--for", "20s", "--cancel-at", "6s"]);
        assert_eq!(report["state"], "terminated", "{name}: {report}");
        let reason = report["reason"].as_str().unwrap_or_default();
        assert!(
            ["finished", "canceled"].contains(&reason),
            "{name}: {report}"
        );
        count += 1;
    }
    assert!(count >= 10, "{count} nets");
}

#[test]
fn the_line_reaches_its_goal_reproducibly() {
    let folder = Folder::new();
    let run = |name: &str| {
        let (csv, svg) = (
            folder.file(&format!("{name}.csv")),
            folder.file(&format!("{name}.svg")),
        );
        let report = report(0, &[&net("line.yaml"), "--csv", &csv, "--plot", &svg]);
        (
            report.to_string(),
            folder.read(&format!("{name}.csv")),
            folder.read(&format!("{name}.svg")),
        )
    };
    let (first, again) = (run("first"), run("again"));
    assert_eq!(first, again);
    let (report, csv, svg) = first;
    let report: Value = serde_json::from_str(&report).expect("JSON");
    let y = report["monitors"].as_array().and_then(|rows| {
        let row = rows.iter().find(|row| row["name"] == "line/move.pose[1]")?;
        row["last"].as_f64()
    });
    assert!(y.is_some_and(|y| (y - 0.15).abs() < 1e-9), "{report}");
    let mut lines = csv.lines();
    let head = lines.next().unwrap_or_default();
    assert!(head.starts_with("time [s],line/move.pose[0]"), "{head}");
    let times: Vec<f64> = lines
        .filter_map(|line| line.split(',').next()?.parse().ok())
        .collect();
    assert!(
        times.len() > 1000 && times[0] == 0.0 && times[1] == 0.001,
        "{}",
        times.len()
    );
    assert!(svg.starts_with("<svg") && svg.matches(" data-name=").count() >= 10);
    assert!(svg.contains("line/move.distance") && svg.contains("[m]") && svg.contains("time [s]"));
}

#[test]
fn inputs_are_set_at_their_time_and_wires_feed_outputs_back() {
    let folder = Folder::new();
    let (csv, door) = (folder.file("mirror.csv"), "io.door_closed=true@2s");
    let arguments = [
        &net("mirror.yaml"),
        "--input",
        door,
        "--for",
        "3s",
        "--csv",
        &csv,
    ];
    let report = report(0, &arguments);
    assert_eq!(report["state"], "running", "the time is over: {report}");
    let text = folder.read("mirror.csv");
    let rows: Vec<(f64, &str)> = text
        .lines()
        .skip(1)
        .filter_map(|line| line.split_once(','))
        .filter_map(|(time, value)| Some((time.parse().ok()?, value)))
        .collect();
    assert!(
        rows.iter()
            .all(|(time, value)| (*time >= 2.0) == (*value == "1")),
        "{text}"
    );
    // The lamp is wired to an input of the same device.
    let lamp = "net: lamp
primitives:
  on: {type: DigitalOutput, parameters: {device: io, channel: lamp}, inputs: {in: true}}
  seen: {type: DigitalInput, parameters: {device: io, channel: lamp_on}}
  end: {type: Termination, inputs: {done: seen.out}}
";
    fs::write(folder.file("lamp.yaml"), lamp).expect("written");
    let lit = self::report(0, &[&folder.file("lamp.yaml"), "--for", "1s"]);
    assert_eq!(lit["reason"], "finished", "{lit}");
    // An input that is set stays as it is set.
    let dark = [
        &folder.file("lamp.yaml"),
        "--for",
        "1s",
        "--input",
        "io.lamp_on=false",
    ];
    let dark = self::report(0, &dark);
    assert_eq!(dark["state"], "running", "{dark}");
}

#[test]
fn analog_inputs_have_units_and_null_is_shown_as_null() {
    let folder = Folder::new();
    let csv = folder.file("scale.csv");
    let arguments = [
        &net("scale.yaml"),
        "--input",
        "io.temperature=300K",
        "--input",
        "io.temperature=null@1s",
        "--for",
        "2s",
        "--csv",
        &csv,
    ];
    report(0, &arguments);
    let text = folder.read("scale.csv");
    assert!(text.contains(",null") && text.contains(",0.01"), "{text}");
}

#[test]
fn refusals_and_failures_have_the_exit_codes_of_run() {
    let folder = Folder::new();
    let aborted = report(1, &[&net("line.yaml"), "--cancel-at", "500ms"]);
    assert_eq!(aborted["reason"], "aborted", "{aborted}");
    let elsewhere = "net: elsewhere
primitives:
  move:
    type: LinearMotion
    parameters:
      device: lwr
      from: {xyz: [0.5, 0.1, 0.3], rpy: [0, deg(180), 0]}
      to: {xyz: [0.5, 0.2, 0.3], rpy: [0, deg(180), 0]}
      velocity: 0.1 m/s
      acceleration: 0.5 m/s^2
      jerk: 5 m/s^3
  ik: {type: InverseKinematics, parameters: {device: lwr}, inputs: {pose: move.pose}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: ik.joints}}
  end: {type: Termination, inputs: {done: move.done}}
";
    fs::write(folder.file("elsewhere.yaml"), elsewhere).expect("written");
    fs::write(folder.file("bad.yaml"), "net: bad\nprimitives: {}\n").expect("written");
    for (exit, arguments, expected) in [
        (5, vec![folder.file("elsewhere.yaml")], "RCC3011"),
        (3, vec![folder.file("bad.yaml")], "RCC1"),
        (
            2,
            vec![net("mirror.yaml"), "--input=io.door=true".into()],
            "door_closed",
        ),
        (
            2,
            vec![net("mirror.yaml"), "--input=io.door_closed=7".into()],
            "true, false",
        ),
        (
            2,
            vec![net("scale.yaml"), "--input=io.temperature=7 m".into()],
            "unit",
        ),
        (2, vec![folder.file("missing.yaml")], "missing"),
    ] {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = simulate(&arguments);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(exit), "{arguments:?}: {errors}");
        assert!(errors.contains(expected), "{errors}");
    }
}

/// Runs `plot`, which must end with this exit code; returns its output.
fn plot(exit: i32, arguments: &[&str]) -> String {
    let (out, errors) = run_to(exit, &[&["plot"], arguments].concat());
    out + &errors
}

#[test]
fn a_plot_shows_path_and_joints_relative_to_limits_reproducibly() {
    let folder = Folder::new();
    let run = |name: &str| {
        plot(0, &[&net("line.yaml"), "-o", &folder.file(name)]);
        folder.read(name)
    };
    let svg = run("first.svg");
    assert_eq!(svg, run("again.svg"));
    for part in [
        "x [m]",
        "z [m], flange",
        "speed of the flange [m/s]",
        "velocity [% of the limit]",
        "acceleration [% of the limit]",
        "jerk [% of the limit]",
        "J7",
    ] {
        assert!(svg.contains(part), "{part}");
    }
    assert!(svg.len() < 200_000, "{} bytes", svg.len());
    let png = folder.file("line.png");
    plot(0, &[&net("line.yaml"), "-o", &png, "--cancel-at", "500ms"]);
    let bytes = fs::read(png).expect("it was written");
    assert!(bytes.starts_with(b"\x89PNG"));
    let text = plot(2, &[&net("line.yaml"), "-o", &folder.file("line.jpeg")]);
    assert!(text.contains(".svg, .html or .png"), "{text}");
    let text = plot(2, &[&net("blink.yaml"), "-o", &folder.file("blink.svg")]);
    assert!(text.contains("commands no arm"), "{text}");
}

#[test]
fn a_net_that_would_break_a_limit_is_plotted_but_not_simulated() {
    let folder = Folder::new();
    let text = fs::read_to_string(net("line.yaml")).expect("a net");
    // The motion knows nothing of how the net changes the joints: the last joint turns in addition, too fast.
    let hasty = text.replace("position: ik.joints", "position: turned.out")
        + "  turn: {type: Multiply, inputs: {a: move.distance, b: 50 rad/m}}
  turned: {type: SetElement, inputs: {in: ik.joints, index: 6, value: turn.out}}
";
    fs::write(folder.file("hasty.yaml"), hasty).expect("written");
    let (file, svg) = (folder.file("hasty.yaml"), folder.file("hasty.svg"));
    let text = plot(1, &[&file, "-o", &svg]);
    assert!(
        text.contains("would violate a limit") && text.contains("in move"),
        "{text}"
    );
    assert!(folder.read("hasty.svg").contains("jerk"));
    let output = simulate(&[&file]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(5), "{text}");
    assert!(
        text.contains("RCC3023")
            && text.contains("lwr joint J7: velocity")
            && !text.contains("slower"),
        "{text}"
    );
}

#[test]
fn an_arm_without_a_simulator_begins_where_its_driver_does() {
    let configs = nets().join("..");
    let file = |name: &str| configs.join(name).display().to_string();
    let (cell, shared) = ("cells/two-arms.yaml", "two-arms/shared-load.yaml");
    let report = report(0, &[&file(shared), "--config", &file(cell)]);
    assert_eq!(report["reason"], "finished", "{report}");
}

#[test]
fn arms_by_their_joints_move_along_lines_and_arcs() {
    let configs = nets().join("..");
    let file = |name: &str| configs.join(name).display().to_string();
    let (cell, net) = ("cells/by-joints.yaml", "by-joints/line-and-circle.yaml");
    let folder = Folder::new();
    let csv = folder.file("poses.csv");
    let report = report(0, &[&file(net), "--config", &file(cell), "--csv", &csv]);
    assert_eq!(report["reason"], "finished", "{report}");
    // From start to end the legs of the UR5e move its flange by (-0.05, 0.2, 0).
    let text = folder.read("poses.csv");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("names").split(',').collect();
    let columns = [0, 1, 2].map(|axis| {
        let name = format!("line-and-circle/ur5e.pose[{axis}]");
        let place = names.iter().position(|known| known.starts_with(&name));
        place.unwrap_or_else(|| panic!("{name} in {names:?}"))
    });
    let position = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        columns.map(|column| cells[column].parse::<f64>().expect("a number"))
    };
    let first = position(lines.next().expect("a row"));
    let last = position(lines.next_back().expect("a row"));
    for ((from, to), want) in first.iter().zip(last).zip([-0.05, 0.2, 0.0]) {
        assert!((to - from - want).abs() < 1e-6, "{first:?} {last:?}");
    }
}

#[test]
fn check_rehearses_from_where_the_simulators_begin() {
    let check = |file: &str| {
        let mut command = rcc_cli(&["check", "--rehearse", file]);
        command.output().expect("rcc-cli runs")
    };
    let output = check(&net("line.yaml"));
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{printed}");
    assert!(
        printed.contains("checked: ") && printed.contains("s of motion"),
        "{printed}"
    );
    let folder = Folder::new();
    let text = fs::read_to_string(net("sequence.yaml")).expect("a net");
    assert!(text.contains("blend: 20 mm"), "{text}");
    let wide = text.replace("blend: 20 mm", "blend: 300 mm");
    fs::write(folder.file("wide.yaml"), wide).expect("written");
    let output = check(&folder.file("wide.yaml"));
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{printed}");
    assert!(
        printed.contains("instead of 300.0 mm: at most half of a leg"),
        "{printed}"
    );
    let text = fs::read_to_string(net("line.yaml")).expect("a net");
    let beyond = text.replace("0.538, 0.15, 0.384", "0.538, 0.15, 1.384");
    fs::write(folder.file("beyond.yaml"), beyond).expect("written");
    let output = check(&folder.file("beyond.yaml"));
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{errors}");
    assert!(
        errors.contains("RCC3014") && errors.contains("leg 1") && errors.contains("% of its path"),
        "{errors}"
    );
    let fast = text.replace("0.15 m/s\n", "3 m/s\n");
    fs::write(folder.file("fast.yaml"), fast).expect("written");
    let output = check(&folder.file("fast.yaml"));
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{errors}");
    for part in [
        "RCC3014",
        "move, leg 1: at the given speed J1 would reach",
        "rad/s",
        "its limit is",
        "of this speed is possible",
    ] {
        assert!(errors.contains(part), "{part}: {errors}");
    }
}

#[test]
fn a_soft_arm_presses_with_stiffness_times_depth_plus_added_force() {
    let folder = Folder::new();
    let (cell, net) = (
        nets().join("../cells/impedance.yaml").display().to_string(),
        nets().join("../impedance/press.yaml").display().to_string(),
    );
    let csv = folder.file("press.csv");
    let press = |net: &str, cell: &str| -> f64 {
        let run = report(
            0,
            &[net, "--config", cell, "--cancel-at", "3s", "--csv", &csv],
        );
        assert_eq!(run["reason"], "canceled");
        let text = folder.read("press.csv");
        let last = text.lines().last().expect("rows").split(',').nth(1);
        last.and_then(|cell| cell.parse().ok()).expect("a number")
    };
    // The springs of tool and table in series.
    let expected = (500.0 * 0.02 + 5.0) * 30_000.0 / 30_500.0;
    assert!((press(&net, &cell) - expected).abs() < 1e-6);
    // In joint impedance the springs act at the joints, and the original net is refused.
    let text = fs::read_to_string(&cell).expect("a cell");
    let robots = nets().join("../robots/").display().to_string();
    let text = text
        .replace("../robots/", &robots)
        .replace("=cartesian-", "=joint-");
    let joint = folder.file("joint.yaml");
    fs::write(&joint, text).expect("written");
    let springs = |stiffness: &str| {
        let text = fs::read_to_string(&net).expect("a net");
        let (head, rest) = text
            .split_once("    type: CartesianImpedanceCommand")
            .expect("it");
        let (_, rest) = rest.split_once("  over:").expect("its end");
        let command = format!(
            "    type: JointImpedanceCommand\n    parameters: {{device: lwr}}\n    inputs: {{position: ik.joints, stiffness: {stiffness}}}\n"
        );
        let file = folder.file("springs.yaml");
        fs::write(&file, format!("{head}{command}  over:{rest}")).expect("written");
        press(&file, &joint)
    };
    // Joints twice as stiff give nearly twice the force, apart from the table's share.
    let (soft, stiff) = (
        springs("[200, 200, 200, 200, 200, 200, 200]"),
        springs("[400, 400, 400, 400, 400, 400, 400]"),
    );
    let alone = |force: f64| force / (0.02 - force / 30_000.0);
    assert!(
        (alone(stiff) / alone(soft) - 2.0).abs() < 1e-6,
        "{soft} {stiff}"
    );
    let output = simulate(&[&net, "--config", &joint]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("joint impedance control"), "{text}");
}

#[test]
fn polishing_holds_its_force_on_the_table_and_gives_up_without_one() {
    let folder = Folder::new();
    let table = nets().join("../cells/table.yaml").display().to_string();
    let csv = folder.file("polish.csv");
    let net = net("polish.yaml");
    let there = report(0, &[&net, "--config", &table, "--csv", &csv]);
    assert_eq!(there["reason"], "finished");
    let text = folder.read("polish.csv");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("names").split(',').collect();
    let column = |name: &str| {
        names
            .iter()
            .position(|known| known.starts_with(name))
            .expect("a column")
    };
    let columns = [
        column("time"),
        column("polish/press"),
        column("polish/hold.pose_out[1]"),
    ];
    let rows = lines.map(|line| {
        let cells: Vec<f64> = line
            .split(',')
            .map(|cell| cell.parse().unwrap_or(f64::NAN))
            .collect();
        columns.map(|column| cells[column])
    });
    let rows: Vec<[f64; 3]> = rows.collect();
    let most = rows.iter().map(|[_, press, _]| *press).fold(0.0, f64::max);
    assert!((9.9..12.0).contains(&most), "{most} N");
    // From a second after contact until the line brakes, the force is 10 N, while the line continues.
    let held: Vec<_> = rows
        .iter()
        .filter(|[time, _, _]| (2.5..2.8).contains(time))
        .collect();
    assert!(
        held.len() > 200 && held.iter().all(|[_, press, _]| (press - 10.0).abs() < 0.2),
        "{held:?}"
    );
    assert!(
        held[0][2] - held[held.len() - 1][2] > 0.005,
        "{:?}",
        held[0]
    );
    // The demo's cell has no table: `travel` ends the net before the end of the line.
    let gone = report(0, &[&net]);
    assert_eq!(gone["reason"], "finished");
}
