//! The event log with several processes: no line is torn, and a killed writer loses at most its last event. Run by the
//! test program's threads and by child processes of it.

mod common;

use std::collections::BTreeMap;

use common::{Peer, TestCell, part, wait_for};
use rcc_ipc::events::{EventReader, tell};
use rcc_protocol::events::{Event, EventKind, EventOrigin};

const LINES: u64 = 1000;
const WRITERS: [&str; 4] = ["a", "b", "c", "d"];

/// The child process: writes its lines, or continues until it is killed.
#[test]
fn peer() {
    let Some((part, cell, label)) = part() else {
        return;
    };
    let lines = if part == "endless" { u64::MAX } else { LINES };
    for count in 0..lines {
        // Lines of different lengths, so that an incomplete write would show.
        let why = "x".repeat((count % 400) as usize);
        tell(
            &cell,
            EventOrigin::Driver,
            &label,
            EventKind::Stopping { why },
        );
        tell(
            &cell,
            EventOrigin::Driver,
            &label,
            EventKind::Suppressed { count },
        );
    }
}

fn counts(events: &[Event]) -> BTreeMap<String, Vec<u64>> {
    let mut all = BTreeMap::<String, Vec<u64>>::new();
    for event in events {
        if let EventKind::Suppressed { count } = event.what {
            all.entry(event.source.label.clone())
                .or_default()
                .push(count);
        }
    }
    all
}

#[test]
fn a_thousand_lines_of_each_of_four_processes_come_whole_and_in_order() {
    let place = TestCell::new();
    let mut reader = EventReader::open(&place.state());
    let peers = WRITERS.map(|label| Peer::start(&place, "lines", label));
    let mut events = Vec::new();
    // The log is rotated meanwhile; a follower misses nothing.
    wait_for(|| {
        events.extend(reader.poll().unwrap());
        (counts(&events).values().map(Vec::len).sum::<usize>() == WRITERS.len() * LINES as usize)
            .then_some(())
    });
    assert_eq!(reader.unreadable(), 0);
    for (label, counts) in counts(&events) {
        let expected: Vec<u64> = (0..LINES).collect();
        assert_eq!(counts, expected, "{label}");
    }
    drop(peers);
}

#[test]
fn killed_writers_hide_no_line_of_others() {
    let place = TestCell::new();
    let mut reader = EventReader::open(&place.state());
    for label in WRITERS {
        let peer = Peer::start(&place, "endless", label);
        let mut seen = 0;
        wait_for(|| {
            seen += reader.poll().unwrap().len();
            (seen > 500).then_some(())
        });
        peer.kill();
    }
    while !reader.poll().unwrap().is_empty() {}
    tell(
        &place,
        EventOrigin::Loader,
        "loader",
        EventKind::Suppressed { count: 7 },
    );
    let events = reader.poll().unwrap();
    assert_eq!(
        events.last().map(|event| &event.what),
        Some(&EventKind::Suppressed { count: 7 })
    );
    assert!(
        reader.unreadable() <= WRITERS.len() as u64,
        "{}",
        reader.unreadable()
    );
}
