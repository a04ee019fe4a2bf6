//! Cells that run side by side, cells that follow each other in the same folder, and cells without enough shared
//! memory. Each test has cells of its own.

use std::fs;
use std::process::{Command, Stdio};

use nix::sys::signal::Signal;
use rcc_protocol::Role;
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::{command_line, ends_with_test, signal, with_runtime_dir};
use rcc_tests::{TestCell, nets, program, repository};

#[test]
fn two_cells_side_by_side_do_not_see_each_other() {
    let (one, two) = (TestCell::demo(), TestCell::demo());
    let line = one.run(&nets::line("line", 0.1, 0.1));
    assert_eq!(two.rest("GET", "/commands", "").body, serde_json::json!([]));
    assert_ne!(one.cell().prefix(), two.cell().prefix());
    let pids = |cell: &TestCell| -> Vec<u32> {
        let status = cell.rest("GET", "/status", "").body;
        let rows = status["processes"].as_array().expect("rows").clone();
        rows.iter()
            .map(|row| row["pid"].as_u64().expect("a number") as u32)
            .collect()
    };
    let (of_one, of_two) = (pids(&one), pids(&two));
    assert!(
        of_one.iter().all(|pid| !of_two.contains(pid)),
        "{of_one:?} {of_two:?}"
    );
    let mut still = two.simulator("lwr-sim");
    let before = still.joints();
    // The death of one cell's processes does not affect the other cell.
    one.assert_ends(line, "finished");
    let (driver, executor) = (
        two.announced(Role::Driver, "lwr"),
        two.announced(Role::Executor, "exec"),
    );
    one.kill(Role::Driver, "lwr");
    one.kill(Role::Executor, "exec");
    one.stop();
    assert!(driver.liveness().is_alive() && executor.liveness().is_alive());
    assert_eq!(two.device("lwr").expect("a row")["losses"], 0);
    assert!(
        still
            .joints()
            .iter()
            .zip(before)
            .all(|(now, then)| (now - then).abs() < 1e-5)
    );
    let line = two.run(&nets::line("line", 0.1, 0.2));
    two.assert_ends(line, "finished");
    two.stop();
}

#[test]
fn a_second_cell_of_the_same_name_is_refused_and_changes_nothing() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    let before = with_runtime_dir(cell.folder());
    let (_, errors) = cell.cli_exits(5, &["up", cell.config().to_str().expect("plain")]);
    assert!(
        errors.contains("RCC4012") && errors.contains("test"),
        "{errors}"
    );
    let named = before.iter().any(|pid| errors.contains(&pid.to_string()));
    assert!(named, "the message names a living process: {errors}");
    assert!(
        errors.contains("`rcc-cli --cell test down`"),
        "the message names the verb that ends the cell: {errors}"
    );
    cell.assert_ends(line, "finished");
    assert_eq!(with_runtime_dir(cell.folder()), before);
    // A second process with the same role is refused, too.
    let mut second = cell.program("rcc-exec");
    let second = second
        .arg("--config")
        .arg(cell.config())
        .output()
        .expect("rcc-exec runs");
    assert_eq!(second.status.code(), Some(1), "{second:?}");
    let executor = cell.announced(Role::Executor, "exec");
    let words = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(words.contains(&executor.pid.to_string()), "{words}");
    let next = cell.run(&nets::line("next", 0.0, 0.2));
    cell.assert_ends(next, "finished");
    cell.stop();
}

#[test]
fn a_dead_cell_is_cleaned_by_the_next_up() {
    let mut cell = TestCell::demo();
    cell.run(&nets::line("line", 0.2, 0.1));
    // The supervisor is killed first, because it restarts dead processes.
    for pid in std::iter::once(cell.supervisor()).chain(with_runtime_dir(cell.folder())) {
        signal(pid, Signal::SIGKILL);
    }
    cell.kill_supervisor();
    cell.await_dead();
    assert!(
        !cell.cell().leftovers().expect("a list").is_empty(),
        "the dead cell has left files"
    );
    cell.up_again();
    assert_eq!(
        cell.rest("GET", "/commands", "").body,
        serde_json::json!([])
    );
    let line = cell.run(&nets::line("line", 0.1, 0.2));
    cell.assert_ends(line, "finished");
    cell.stop();
}

#[test]
fn ctrl_c_in_motion_cancels_waits_for_rest_and_leaves_nothing() {
    let demo = repository().join("configs/cells/demo.yaml");
    let cell = TestCell::start(&demo, |text| text);
    // Below the folder of the simulator's socket; it is removed with the cell.
    let trace = cell.cell().runtime_dir().join("up/trace.csv");
    let mut arm = cell.simulator("lwr-sim");
    let answer = arm.ask(&serde_json::json!({"trace": {"path": "up/trace.csv"}}));
    assert_eq!(answer["ok"], true, "{answer}");
    cell.run(&nets::line("line", 0.2, 0.1));
    cell.run(&nets::lamp("lamp"));
    arm.await_motion();
    let folder = cell.folder().to_owned();
    // An open file stays readable after its folder is removed.
    let mut file = fs::File::open(&trace).expect("the trace is there");
    cell.stop();
    assert!(!folder.exists());
    let mut text = String::new();
    std::io::Read::read_to_string(&mut file, &mut text).expect("the trace can be read");
    // The position of J1 that the driver commanded in each answer.
    let rows = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect::<Vec<_>>());
    let answered = rows.filter(|row| row.get(5) == Some(&"1"));
    let commanded: Vec<f64> = answered
        .filter_map(|row| row.get(13)?.parse().ok())
        .collect();
    let last = &commanded[commanded.len().saturating_sub(20)..];
    let moved = last
        .iter()
        .fold(0.0_f64, |most, q| most.max((q - last[0]).abs()));
    assert!(
        commanded.len() > 100 && moved < 1e-6,
        "the driver ended before the arm was at rest: {last:?}"
    );
}

#[test]
fn a_monitor_may_keep_running_when_the_cell_ends() {
    let cell = TestCell::demo();
    let mut tail = cell.program("rcc-monitor");
    tail.args(["tail", "--output", "json"])
        .stdout(Stdio::piped());
    let mut tail = ends_with_test(&mut tail)
        .spawn()
        .expect("rcc-monitor starts");
    let lamp = cell.run(&nets::lamp("lamp"));
    let mut first = [0];
    let out = tail.stdout.as_mut().expect("a pipe");
    std::io::Read::read_exact(out, &mut first).expect("a first record");
    cell.done(lamp, "cancel");
    let place = cell.interrupt();
    let left: Vec<Vec<String>> = with_runtime_dir(place.folder())
        .iter()
        .map(|pid| command_line(*pid))
        .collect();
    assert!(
        left.iter().all(|line| line[0].ends_with("rcc-monitor")),
        "{left:?}"
    );
    signal(tail.id(), Signal::SIGTERM);
    tail.wait().expect("the child is ours");
    // The next start of the cell removes the files that the monitor still used.
    let again = TestCell::in_fixture(place);
    again.stop();
}

#[test]
fn too_little_shared_memory_is_refused_before_anything_is_created() {
    let may = Command::new("unshare")
        .args([
            "-m", "mount", "-t", "tmpfs", "-o", "size=4m", "rcc", "/dev/shm",
        ])
        .output();
    if !may.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: cannot create a mount namespace (needs root and `unshare`)");
        return;
    }
    // Not in /dev/shm, because the command below mounts another file system there.
    let demo = repository().join("configs/cells/demo.yaml");
    let place = CellFixture::below(&std::env::temp_dir(), &demo, |text| text);
    let script =
        "mount -t tmpfs -o size=4m rcc /dev/shm && \"$@\"; code=$?; ls -A /dev/shm; exit $code";
    let output = Command::new("unshare")
        .args(["-m", "sh", "-c", script, "sh"])
        .arg(program("rcc-cli"))
        .args(["--cell", "test", "up"])
        .arg(place.config())
        .env("RCC_RUNTIME_DIR", place.folder())
        .env("RCC_STATE_DIR", place.state_dir())
        .output()
        .expect("unshare runs");
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(
        errors.contains("RCC4014") && errors.contains("/dev/shm"),
        "{errors}"
    );
    assert_eq!(
        String::from_utf8_lossy(&output.stdout),
        "",
        "nothing was created in shared memory"
    );
    let announced = place.cell().announced_all().expect("a list");
    assert!(announced.is_empty() && place.cell().leftovers().expect("a list").is_empty());
    // The executor checks the space by itself, too.
    let output = Command::new("unshare")
        .args(["-m", "sh", "-c", script, "sh"])
        .arg(program("rcc-exec"))
        .args(["--cell", "test", "--config"])
        .arg(place.config())
        .env("RCC_RUNTIME_DIR", place.folder())
        .env("RCC_STATE_DIR", place.state_dir())
        .output()
        .expect("unshare runs");
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(errors.contains("/dev/shm"), "{errors}");
}

#[test]
fn down_ends_a_cell_as_ctrl_c_does() {
    let mut cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    cell.run(&nets::line("line", 0.2, 0.1));
    arm.await_motion();
    let (out, _) = cell.cli_exits(0, &["down"]);
    assert!(out.contains("cell test  ended"), "{out}");
    assert!(cell.await_end_of_up().success());
    // A cell that does not run cannot be ended.
    let (_, words) = cell.cli_exits(4, &["down"]);
    assert!(words.contains("RCC4004"), "{words}");
    let (_, words) = cell.cli_exits(2, &["--url", "http://127.0.0.1:1", "down"]);
    assert!(words.contains("--url"), "{words}");
    cell.stop();
}

#[test]
fn a_cell_that_is_not_here_is_answered_with_the_cells_that_are() {
    let cell = TestCell::demo();
    let mut look = Command::new(program("rcc-cli"));
    look.args(["--cell", "nobody", "ls"])
        .env("RCC_RUNTIME_DIR", cell.folder());
    let output = look.output().expect("rcc-cli runs");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(4), "{words}");
    assert!(words.contains("cell `nobody` not found"), "{words}");
    assert!(
        words.contains("running cells: ") && words.contains(" (yours, "),
        "{words}"
    );
    // The same cell, looked for in another folder.
    let elsewhere = cell.folder().join("elsewhere");
    let mut look = cell.program("rcc-cli");
    look.arg("ls").env("RCC_RUNTIME_DIR", &elsewhere);
    let output = look.output().expect("rcc-cli runs");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(4), "{words}");
    assert!(
        words.contains("it runs elsewhere: test (yours, "),
        "{words}"
    );
    assert!(words.contains("set RCC_RUNTIME_DIR="), "{words}");
    assert!(!elsewhere.exists(), "looking creates nothing");
    cell.stop();
}

#[test]
fn an_unknown_driver_is_named_as_the_cause() {
    let demo = repository().join("configs/cells/demo.yaml");
    let place = CellFixture::new(&demo, |text| text.replace("driver: modbus", "driver: pins"));
    let mut up = place.program("rcc-cli");
    let output = ends_with_test(up.arg("up").arg(place.config())).output();
    let output = output.expect("rcc-cli runs");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{words}");
    let cause = words.lines().find(|line| line.contains("did not start"));
    let cause = cause.expect("the cell did not start");
    assert!(
        cause.contains("driver/io failed") && cause.contains("unknown driver `pins`"),
        "{words}"
    );
    assert!(!cause.contains("executor, loader"), "{words}");
    place.assert_nothing_left();
}
