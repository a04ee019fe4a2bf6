//! The state folder of a cell: event log, incidents and logs are found after its end and after a restart of the
//! machine, the oldest go first, and the configuration chooses the folder. Each test has a cell and a state folder of
//! its own.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rcc_tests::programs::program;
use rcc_tests::{CellFixture, TestCell, await_some, nets, repository};
use serde_json::Value;

/// Returns the rows of `incidents`, and what it says on stderr.
fn incidents(place: &CellFixture) -> (Vec<Value>, String) {
    let (out, notes) = place.cli_exits(0, &["--output", "json", "incidents"]);
    let rows: Value = serde_json::from_str(&out).expect("JSON");
    (rows.as_array().expect("rows").clone(), notes)
}

fn kinds(place: &CellFixture, arguments: &[&str]) -> (Vec<String>, String) {
    let all = [&["--output", "json", "events"][..], arguments].concat();
    let (out, notes) = place.cli_exits(0, &all);
    let kinds = out.lines().map(|line| {
        let event: Value = serde_json::from_str(line).expect("one object a line");
        event["kind"].as_str().expect("a kind").to_owned()
    });
    (kinds.collect(), notes)
}

#[test]
fn events_incidents_and_logs_of_a_cell_that_has_ended_are_found_even_after_a_restart_of_the_machine()
 {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    cell.cli_exits(0, &["incidents", "record"]);
    cell.done(line, "abort");
    cell.await_end(line);
    let mut other = Command::new(program("rcc-cli"));
    other
        .args(["--cell", "other", "incidents"])
        .env("RCC_RUNTIME_DIR", cell.folder())
        .env("RCC_STATE_DIR", cell.state_dir());
    let output = other.output().expect("rcc-cli runs");
    let refused = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(4), "{refused}");
    assert!(
        refused.contains("nothing is kept") && refused.contains("kept: test"),
        "{refused}"
    );
    let mut place = cell.interrupt();
    place.assert_nothing_left();
    let state = place.cell().state();
    // After the restart of a machine there is no runtime folder at all.
    let _ = fs::remove_dir_all(place.cell().runtime_dir());

    let here = state.path().display().to_string();
    let (rows, note) = incidents(&place);
    assert_eq!(rows.len(), 1, "{rows:?}");
    assert!(
        note.contains("cell `test` is not up") && note.contains(&here),
        "{note}"
    );
    let (found, note) = kinds(&place, &[]);
    assert_eq!(found.first().map(String::as_str), Some("cell-started"));
    assert_eq!(found.last().map(String::as_str), Some("cell-ended"));
    assert!(
        note.contains("cell `test` is not up") && note.contains(&here),
        "{note}"
    );
    let file = PathBuf::from(rows[0]["file"].as_str().expect("a path"));
    let name = file.file_name().expect("a name").to_str().expect("UTF-8");
    for arguments in [&["replay"][..], &["replay", name]] {
        let (out, _) = place.cli_exits(0, &[&["--output", "json"][..], arguments].concat());
        assert!(out.contains("\"identical\":true"), "{out}");
    }
    let (_, refused) = place.cli_exits(4, &["events", "--follow"]);
    assert!(
        refused.contains("not up") && refused.contains("--follow"),
        "{refused}"
    );
    let runs: Vec<_> = fs::read_dir(state.logs_dir())
        .expect("logs")
        .flatten()
        .collect();
    assert_eq!(runs.len(), 1);
    let log = fs::read_to_string(runs[0].path().join("executor.log")).expect("a log");
    assert!(!log.is_empty());

    // The next run does not hide them.
    place = TestCell::in_fixture(place).interrupt();
    let (newest, note) = kinds(&place, &[]);
    assert_eq!(
        newest.iter().filter(|kind| *kind == "cell-started").count(),
        1
    );
    assert!(
        note.contains("earlier runs") && note.contains("--all"),
        "{note}"
    );
    let (all, _) = kinds(&place, &["--all"]);
    assert_eq!(all[..found.len()], found);
    assert_eq!(all[found.len()..], newest);
    assert_eq!(incidents(&place).0.len(), 1);
}

#[test]
fn a_follower_ends_with_the_cell_and_says_where_its_events_stay() {
    let cell = TestCell::demo();
    let mut command = cell.program("rcc-cli");
    let mut follower = command
        .args(["--output", "json", "events", "--follow"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("rcc-cli starts");
    let mut lines = BufReader::new(follower.stdout.take().expect("a pipe")).lines();
    assert!(lines.next().is_some(), "it follows the cell");
    let place = cell.interrupt();
    let events: Result<Vec<String>, _> = lines.collect();
    let events = events.expect("whole lines").join("\n");
    let output = follower.wait_with_output().expect("it ends");
    assert!(output.status.success(), "{output:?}");
    assert!(events.contains("\"cell-stopping\""), "{events}");
    let notes = String::from_utf8_lossy(&output.stderr);
    let path = place.cell().state().path().display().to_string();
    assert!(
        notes.contains("stay in") && notes.contains(&path),
        "{notes}"
    );
}

#[test]
fn a_folder_of_the_configuration_holds_everything_and_is_found_without_the_configuration() {
    // Relative paths begin at the folder of the configuration.
    let cell = TestCell::changed(|text| format!("{text}\nrecorder: {{folder: kept}}\n"));
    cell.cli_exits(0, &["incidents", "record"]);
    let place = cell.interrupt();
    fs::remove_file(place.config()).expect("the configuration");
    let folder = place.folder().join("kept/test");
    assert_eq!(place.cell().state().path(), folder);
    let (rows, note) = incidents(&place);
    let file = rows[0]["file"].as_str().expect("a path");
    assert!(file.starts_with(&folder.display().to_string()), "{file}");
    assert!(note.contains(&folder.display().to_string()), "{note}");
    assert!(folder.join("events.jsonl").is_file() && folder.join("logs").is_dir());
    assert!(
        kinds(&place, &[])
            .0
            .contains(&"incident-written".to_owned())
    );
}

#[test]
fn the_oldest_incidents_go_first_above_the_configured_size() {
    let cell = TestCell::changed(|text| {
        format!("{text}\nrecorder: {{memory: 1 MB, files: 1000, keep: 1 MB}}\n")
    });
    let newest = || {
        let (out, _) = cell.cli_exits(0, &["--output", "json", "incidents", "record"]);
        let row: Value = serde_json::from_str(&out).expect("JSON");
        PathBuf::from(row["file"].as_str().expect("a path"))
    };
    let first = newest();
    let last = await_some("the oldest incident to be removed", || {
        let last = newest();
        (!first.exists()).then_some(last)
    });
    assert!(last.is_file(), "the newest incident stays");
    let size = |path: &Path| fs::metadata(path).map_or(0, |found| found.len());
    let (rows, _) = incidents(&cell);
    let files = rows
        .iter()
        .map(|row| PathBuf::from(row["file"].as_str().expect("a path")));
    let total: u64 = files.map(|path| size(&path)).sum();
    assert!(total <= 1 << 20, "{total}");
    cell.stop();
}

#[test]
fn a_cell_whose_evidence_cannot_be_kept_does_not_start() {
    // Nobody can create a folder below a file, not even root.
    let place = CellFixture::new(&repository().join("configs/cells/demo.yaml"), |text| {
        format!("{text}\nrecorder: {{folder: /proc/version/incidents}}\n")
    });
    let config = place.config().to_str().expect("UTF-8").to_owned();
    let output = place.cli(&["up", &config]);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{output:?}");
    for part in [
        "/proc/version/incidents",
        "recorder: {folder: …}",
        "RCC_STATE_DIR",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
    place.assert_nothing_left();
}
