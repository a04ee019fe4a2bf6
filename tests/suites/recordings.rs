//! Recordings of real cells: a killed recorder leaves a readable file, a full disk ends the recording and nothing else, and
//! an incident becomes a file of every port. Run by the threads of the test harness.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use nix::sys::signal::Signal;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::{CellFixture, TestCell, await_some, nets};
use serde_json::Value;

fn recorder(cell: &CellFixture, file: &Path, further: &[&str]) -> Child {
    let mut recorder = cell.program("rcc-monitor");
    recorder.args(["record", "--output", "json"]);
    recorder.args(further).arg(file);
    recorder.stdout(Stdio::piped()).stderr(Stdio::piped());
    ends_with_test(&mut recorder)
        .spawn()
        .expect("rcc-monitor runs")
}

/// Returns the tables of a file by topic, with their numbers of messages; empty if it cannot be read yet.
fn tables(cell: &CellFixture, file: &Path) -> Vec<(String, u64)> {
    let path = file.to_str().expect("a path");
    let output = cell.cli(&["--output", "json", "import", path]);
    let rows: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let row = |row: &Value| {
        let topic = row["topic"].as_str().unwrap_or_default().to_owned();
        (topic, row["messages"].as_u64().unwrap_or(0))
    };
    rows.as_array().into_iter().flatten().map(row).collect()
}

fn messages(tables: &[(String, u64)], topic: &str) -> u64 {
    let found = tables.iter().find(|(name, _)| name == topic);
    found.map_or(0, |(_, messages)| *messages)
}

#[test]
fn a_killed_recorder_leaves_a_readable_file_and_the_next_one_goes_on() {
    let cell = TestCell::demo();
    let net = cell.run(&nets::clock("clock"));
    let file = cell.folder().join("killed.mcap");
    let mut killed = recorder(&cell, &file, &[]);
    let before = await_some("a second of the net in the file", || {
        let tables = tables(&cell, &file);
        (messages(&tables, "/nets/clock") > 500).then_some(tables)
    });
    signal(killed.id(), Signal::SIGKILL);
    killed.wait().expect("our child");
    let left = tables(&cell, &file);
    assert!(messages(&left, "/nets/clock") >= messages(&before, "/nets/clock"));
    assert!(messages(&left, "/devices/lwr") > 0, "{left:?}");
    // A file that exists is kept.
    let refused = recorder(&cell, &file, &[])
        .wait_with_output()
        .expect("it ends");
    assert_eq!(refused.status.code(), Some(1));
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        text.contains("killed.mcap") && text.contains("exists"),
        "{text}"
    );

    let next = cell.folder().join("next.mcap");
    let going = recorder(&cell, &next, &["--nets", "cl*"]);
    await_some("the net in the next file", || {
        (messages(&tables(&cell, &next), "/nets/clock") > 0).then_some(())
    });
    cell.done(net, "cancel");
    cell.assert_ends(net, "canceled");
    signal(going.id(), Signal::SIGINT);
    let ended = going.wait_with_output().expect("it ends");
    assert!(ended.status.success(), "{ended:?}");
    let report: Value = serde_json::from_slice(&ended.stdout).expect("a report");
    assert_eq!(report["end"], "signal", "{report}");
    assert!(report["bytes"].as_u64().is_some_and(|bytes| bytes > 0));
    cell.stop();
}

#[test]
fn a_recording_goes_on_with_a_restarted_executor() {
    let cell = TestCell::demo();
    let file = cell.folder().join("restart.mcap");
    let going = recorder(&cell, &file, &[]);
    let first = nets::clock("first");
    cell.run(&first);
    await_some("the first net", || {
        (messages(&tables(&cell, &file), "/nets/first") > 0).then_some(())
    });
    let dead = cell.kill(rcc_protocol::Role::Executor, "exec");
    cell.await_successor(rcc_protocol::Role::Executor, "exec", dead);
    cell.await_devices();
    cell.run(&nets::clock("second"));
    await_some("the second net", || {
        (messages(&tables(&cell, &file), "/nets/second") > 0).then_some(())
    });
    signal(going.id(), Signal::SIGTERM);
    assert!(going.wait_with_output().expect("it ends").status.success());
    cell.stop();
}

#[test]
fn a_full_disk_ends_the_recording_and_nothing_else() {
    let cell = TestCell::demo();
    let net = cell.run(&nets::clock("clock"));
    let disk = cell.folder().join("disk");
    fs::create_dir(&disk).expect("a folder");
    let copy = cell.folder().join("copy.mcap");
    // Processes in the namespace see the small disk; the files that are left on it are copied out.
    let script = format!(
        "mount -t tmpfs -o size=2M none {disk} || exit 77; {monitor} --cell {cell} record {disk}/out.mcap; code=$?; \
         cp {disk}/out.mcap {copy}; exit $code",
        disk = disk.display(),
        monitor = rcc_tests::programs::program("rcc-monitor").display(),
        cell = rcc_tests::cell_fixture::NAME,
        copy = copy.display()
    );
    let mut unshare = Command::new("unshare");
    unshare.args(["--mount", "sh", "-c", &script]);
    for (name, value) in cell.program("rcc-monitor").get_envs() {
        unshare.env(name, value.unwrap_or_default());
    }
    let output = unshare.output();
    let Some(output) = output
        .ok()
        .filter(|one| !matches!(one.status.code(), Some(77)))
    else {
        eprintln!("skipped: a full disk ends the recording (needs root, `unshare` and `mount`)");
        return cell.stop();
    };
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    if text.contains("unshare failed") {
        eprintln!("skipped: a full disk ends the recording (needs root)");
        return cell.stop();
    }
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("out.mcap: No space left"), "{text}");
    let left = tables(&cell, &copy);
    assert!(messages(&left, "/nets/clock") > 0, "{left:?}");
    assert_eq!(cell.state(net)["state"], "running");
    cell.done(net, "cancel");
    cell.assert_ends(net, "canceled");
    cell.stop();
}

/// Returns the numbers of a table by cycle, without the time.
fn lines(path: &Path, head: &str) -> Vec<(String, Vec<f64>)> {
    let text = fs::read_to_string(path).expect("a table");
    let mut lines = text.lines();
    assert!(
        lines.next().is_some_and(|line| line.ends_with(head)),
        "{text:.200}"
    );
    let line = |line: &str| {
        let mut cells = line.splitn(3, ',');
        let mut next = || cells.next().unwrap_or_default().to_owned();
        let (cycle, _) = (next(), next());
        let number = |text: &str| text.parse().expect("a number");
        (cycle, next().split(',').map(number).collect())
    };
    lines.map(line).collect()
}

#[test]
fn an_incident_becomes_a_file_of_every_port() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    cell.await_end(line);
    let (out, _) = cell.cli_exits(0, &["--output", "json", "incidents", "record"]);
    let row: Value = serde_json::from_str(&out).expect("a row");
    let incident = row["file"].as_str().expect("a path");
    let path = |name: &str| cell.folder().join(name).display().to_string();
    let (mcap, table, again) = (path("out.mcap"), path("out.csv"), path("again.csv"));
    cell.cli_exits(0, &["replay", incident, "--mcap", &mcap]);
    let show = ["--show", "line/move.pose"];
    cell.cli_exits(
        0,
        &[&["replay", incident, "--csv", &table][..], &show].concat(),
    );
    cell.cli_exits(
        0,
        &[&["import", &mcap, "--csv", &again][..], &show].concat(),
    );
    let head = "line/move.pose[6]";
    let expected = lines(Path::new(&table), head);
    assert!(expected.len() > 100);
    assert_eq!(lines(Path::new(&again), head), expected);
    let tables = tables(&cell, Path::new(&mcap));
    for topic in [
        "/nets/line",
        "/devices/lwr",
        "/devices/io",
        "/executor/cycles",
    ] {
        assert!(messages(&tables, topic) > 0, "{topic}: {tables:?}");
    }
    let svg = path("out.svg");
    cell.cli_exits(0, &["plot", &mcap, "--out", &svg]);
    assert!(
        fs::read_to_string(&svg)
            .expect("a plot")
            .contains("line/move.pose[0]")
    );
    let (_, refused) = cell.cli_exits(2, &["plot", &mcap, "--for", "1s"]);
    assert!(refused.contains("do not apply to a recording"), "{refused}");
    let (_, refused) = cell.cli_exits(2, &["import", &mcap, "--show", "no/such*"]);
    assert!(refused.contains("no value"), "{refused}");
    cell.stop();
}
