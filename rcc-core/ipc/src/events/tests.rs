//! The event log with several writers, rotation, torn and hostile lines.

use std::io::Write;

use rcc_testing::TempDir;

use rcc_protocol::events::{CommandFault, LINE_MAX, TEXT_MAX};

use super::*;

/// The log of a cell in its own folder, removed at the end.
struct TestLog {
    cell: Cell,
    _folder: TempDir,
}

impl TestLog {
    fn new() -> TestLog {
        let folder = rcc_testing::folder();
        TestLog {
            cell: Cell::at("events", folder.path()).unwrap(),
            _folder: folder,
        }
    }

    fn read(&self) -> (Vec<Event>, u64) {
        let mut reader = EventReader::open(&self.cell.state());
        let events = reader.poll().unwrap();
        (events, reader.unreadable())
    }

    fn raw(&self, bytes: &[u8]) {
        opened(&self.cell.state().events_file())
            .unwrap()
            .write_all(bytes)
            .unwrap();
    }
}

impl Drop for TestLog {
    fn drop(&mut self) {
        for path in self.cell.leftovers().unwrap_or_default() {
            let _ = fs::remove_file(path);
        }
    }
}

fn stopping(why: &str) -> EventKind {
    EventKind::Stopping {
        why: why.to_owned(),
    }
}

fn fault() -> EventKind {
    EventKind::Command {
        command: 3,
        state: "terminated".into(),
        reason: Some("fault".into()),
        outcome: None,
        cycles: None,
        fault: Some(CommandFault {
            code: "limit".into(),
            device: Some("lwr".into()),
            joint: Some(4),
            rule: Some("velocity".into()),
            value: Some(2.5),
            limit: Some(2.0),
            unit: Some("rad/s".into()),
        }),
    }
}

#[test]
fn what_is_written_is_read_back() {
    let place = TestLog::new();
    let source = EventSource::this(EventOrigin::Executor, "exec");
    let event = Event::now(source, Some(42), fault());
    append(&place.cell, &event).unwrap();
    assert_eq!(place.read(), (vec![event], 0));
}

#[test]
fn torn_and_hostile_lines_are_counted_and_hide_no_events() {
    let place = TestLog::new();
    tell(&place.cell, EventOrigin::Loader, "loader", stopping("one"));
    // Killed within a write: the next event follows on the same line.
    place.raw(b"{\"time\":\"2026-11-21T16:02:03.12");
    tell(&place.cell, EventOrigin::Loader, "loader", stopping("two"));
    place.raw(b"\xff\xfe\x00 nonsense\n{}\n[[[[\n\n{\"time\":1}\n");
    place.raw(&[b'x'; 3 * LINE_MAX]);
    place.raw(b"\n");
    tell(
        &place.cell,
        EventOrigin::Loader,
        "loader",
        stopping("three"),
    );
    let (events, unreadable) = place.read();
    let words: Vec<EventKind> = events.into_iter().map(|event| event.what).collect();
    assert_eq!(words, ["one", "two", "three"].map(stopping));
    assert_eq!(unreadable, 5);
}

#[test]
fn a_line_that_comes_in_two_pieces_is_read_whole() {
    let place = TestLog::new();
    let mut reader = EventReader::open(&place.cell.state());
    let event = Event::now(
        EventSource::this(EventOrigin::Cli, "x"),
        None,
        stopping("whole"),
    );
    let line = event.line().unwrap();
    place.raw(&line[..20]);
    assert_eq!(reader.poll().unwrap(), []);
    place.raw(&line[20..]);
    assert_eq!(reader.poll().unwrap(), [event]);
}

#[test]
fn a_reader_follows_rotations_and_the_log_stays_bounded() {
    let place = TestLog::new();
    let mut reader = EventReader::open(&place.cell.state());
    let why = "x".repeat(TEXT_MAX);
    let (mut read, count) = (0_u64, 6 * FILE_MAX / TEXT_MAX as u64);
    for number in 0..count {
        tell(
            &place.cell,
            EventOrigin::Loader,
            "loader",
            stopping(&format!("{number} {why}")),
        );
        if number % 500 == 0 {
            for event in reader.poll().unwrap() {
                let expected = stopping(&format!("{read} {why}"));
                assert_eq!(event.what, expected);
                read += 1;
            }
        }
    }
    read += reader.poll().unwrap().len() as u64;
    assert_eq!((read, reader.unreadable()), (count, 0));
    let most = FILE_MAX + LINE_MAX as u64;
    let state = place.cell.state();
    let rotated = state.rotated_events();
    assert!(rotated.len() > 1, "{rotated:?}");
    let files = rotated.into_iter().map(|(_, path)| path);
    for path in files.chain([state.events_file()]) {
        assert!(fs::metadata(&path).unwrap().len() <= most, "{path:?}");
    }
    let (events, _) = place.read();
    assert_eq!(events.len() as u64, count, "all files are read");
}

#[test]
fn a_reader_at_the_end_sees_what_comes_and_nothing_before() {
    let place = TestLog::new();
    let state = place.cell.state();
    fs::write(state.rotated_events_file(3), "").unwrap();
    tell(&place.cell, EventOrigin::Cli, "x", stopping("before"));
    let mut reader = EventReader::open_at_end(&state);
    assert_eq!(reader.poll().unwrap(), []);
    tell(&place.cell, EventOrigin::Cli, "x", stopping("one"));
    place.raw(&vec![b'\n'; FILE_MAX as usize]);
    tell(&place.cell, EventOrigin::Cli, "x", stopping("rotated"));
    tell(&place.cell, EventOrigin::Cli, "x", stopping("new"));
    let whys = reader.poll().unwrap().into_iter().map(|event| event.what);
    let expected = ["one", "rotated", "new"].map(stopping);
    assert_eq!(whys.collect::<Vec<_>>(), expected);
}

#[test]
fn the_oldest_rotated_files_are_removed_and_numbers_are_never_used_again() {
    let place = TestLog::new();
    let state = place.cell.state();
    for number in 5..5 + ROTATED_MAX as u64 {
        fs::write(state.rotated_events_file(number), "").unwrap();
    }
    place.raw(&vec![b'\n'; FILE_MAX as usize]);
    tell(&place.cell, EventOrigin::Cli, "x", stopping("rotated"));
    tell(&place.cell, EventOrigin::Cli, "x", stopping("current"));
    let numbers: Vec<u64> = state
        .rotated_events()
        .iter()
        .map(|(number, _)| *number)
        .collect();
    let expected: Vec<u64> = (6..6 + ROTATED_MAX as u64).collect();
    assert_eq!(numbers, expected);
    let whys = place.read().0.into_iter().map(|event| event.what);
    assert_eq!(
        whys.collect::<Vec<_>>(),
        ["rotated", "current"].map(stopping)
    );
}

#[test]
fn a_new_run_reports_the_last_event_of_one_that_died() {
    let place = TestLog::new();
    begin_log(&place.cell, "cell.yaml", &BTreeMap::new());
    let (events, _) = place.read();
    assert!(matches!(
        &events[..],
        [Event {
            what: EventKind::CellStarted { previous: None, .. },
            ..
        }]
    ));
    tell(
        &place.cell,
        EventOrigin::Loader,
        "loader",
        stopping("the end"),
    );
    begin_log(&place.cell, "cell.yaml", &BTreeMap::new());
    let (events, _) = place.read();
    assert_eq!(
        events.len(),
        3,
        "the log of the previous run can still be read"
    );
    let words = events[2].sentence(&|_, id| id.to_string());
    assert!(words.contains("the end"), "{words}");
}

#[test]
fn a_run_that_ended_in_order_is_kept_and_not_reported_as_dead() {
    let place = TestLog::new();
    begin_log(&place.cell, "cell.yaml", &BTreeMap::new());
    let kept = place.cell.state().path().display().to_string();
    let ended = EventKind::CellEnded { kept };
    tell(&place.cell, EventOrigin::Supervisor, "up", ended);
    // A janitor or a person may write after it.
    tell(&place.cell, EventOrigin::Cli, "cli", stopping("later"));
    begin_log(&place.cell, "cell.yaml", &BTreeMap::new());
    let (events, _) = place.read();
    assert_eq!(events.len(), 4);
    let previous = matches!(
        events[3].what,
        EventKind::CellStarted {
            previous: Some(_),
            ..
        }
    );
    assert!(!previous, "{:?}", events[3]);
}

#[test]
fn a_recorder_writes_in_order_and_counts_what_is_too_much() {
    let place = TestLog::new();
    let recorder = EventRecorder::start(&place.cell, Role::Driver, "lwr").unwrap();
    for number in 0..2000 {
        recorder.tell_in(Some(number), stopping("x"));
    }
    drop(recorder);
    let (events, _) = place.read();
    let mut written = 0;
    let mut suppressed = 0;
    for event in &events {
        match event.what {
            EventKind::Suppressed { count } => suppressed += count,
            _ => written += 1,
        }
    }
    assert_eq!(written + suppressed, 2000);
    assert!(written >= 100, "{written}");
    let cycles: Vec<u64> = events.iter().filter_map(|event| event.cycle).collect();
    assert!(cycles.is_sorted());
}
