//! Streams between processes. Run by the test program's threads and by child processes of it.

mod common;

use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use common::{Peer, TestCell, part, refused, run_janitor};
use rcc_ipc::stream::{BATCHES_MAX, batch_records_max};
use rcc_ipc::{Session, StreamError};
use rcc_protocol::Role;

#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Record {
    sequence: u64,
    values: [f64; 7],
}

fn records(from: u64, count: u64) -> Vec<Record> {
    (from..from + count)
        .map(|sequence| Record {
            sequence,
            values: [0.5; 7],
        })
        .collect()
}

/// The child process: publishes 20 records per millisecond forever, or is a reader that only keeps the stream open.
#[test]
fn peer() {
    let Some((part, cell, label)) = part() else {
        return;
    };
    let session = Session::join(&cell, Role::Driver, &label).unwrap();
    if let Some(service) = part.strip_prefix("watch ") {
        let mut reader = session.subscribe::<Record>(service).unwrap();
        common::wait_for(|| reader.next_batch().unwrap());
        let _announced = cell.announce(&session.announcement()).unwrap();
        loop {
            std::thread::park();
        }
    }
    let mut publisher = session.publisher::<Record>("values").unwrap();
    let announcement = session
        .announcement()
        .service("values", publisher.service());
    let _announced = cell.announce(&announcement).unwrap();
    for cycle in 0.. {
        publisher.publish(&records(cycle * 20, 20)).unwrap();
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_reader_that_polls_every_10_ms_loses_nothing_of_20_records_a_millisecond() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut publisher = session.publisher::<Record>("values").unwrap();
    let mut reader = session.subscribe::<Record>(publisher.service()).unwrap();
    let mut got = Vec::new();
    // Counted in cycles, not in time. Occasionally the reader pauses for as long as the buffer lasts.
    for cycle in 0..2000_u64 {
        publisher.publish(&records(cycle * 20, 20)).unwrap();
        if if cycle < 1000 {
            cycle % 10 == 9
        } else {
            cycle % BATCHES_MAX as u64 == 0
        } {
            while reader.read_into(&mut got).unwrap() {}
        }
    }
    while reader.read_into(&mut got).unwrap() {}
    assert_eq!(got, records(0, 2000 * 20));
}

/// Memory that a stray write of a reader could reach, from the kernel's list of mappings.
#[test]
fn a_reader_has_no_board_mapped_and_the_records_only_to_read() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut board = session.create_board::<Record>("command").unwrap();
    let _server = session.serve("control").unwrap();
    let mut publisher = session.publisher::<Record>("values").unwrap();
    let peer = Peer::start(&cell, &format!("watch {}", publisher.service()), "watch");
    common::wait_for(|| {
        board.write(&records(1, 1)[0]);
        publisher.publish(&records(1, 1)).unwrap();
        cell.announced(Role::Driver, "watch").unwrap()
    });
    let maps = std::fs::read_to_string(format!("/proc/{}/maps", peer.id())).unwrap();
    let mut writable: Vec<&str> = Vec::new();
    for line in maps.lines().filter(|line| line.contains(cell.prefix())) {
        assert!(!line.contains("blackboard"), "{line}");
        let kind = line.rsplit('.').next().unwrap();
        if line.split(' ').nth(1).unwrap().contains('w') {
            writable.push(kind);
        }
    }
    writable.sort_unstable();
    writable.dedup();
    // iceoryx2's bookkeeping: participants, the queues between the two, and the counter of nodes. docs/security.md says
    // what garbage in them does.
    let known = ["connection", "dynamic", "global_mgmt"];
    assert!(
        writable.iter().all(|kind| known.contains(kind)),
        "{writable:?}"
    );
    peer.kill();
}

#[test]
fn records_of_a_process_that_died_can_still_be_read() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Monitor, "tail").unwrap();
    let (peer, announcement) = Peer::announced(&cell, "publish", "lwr");
    let mut reader = session
        .subscribe::<Record>(&announcement.services["values"])
        .unwrap();
    let mut all = common::wait_for(|| reader.next_batch().unwrap());
    assert!(!reader.publisher_is_dead());
    peer.kill();
    assert!(reader.publisher_is_dead());
    run_janitor(&cell).unwrap();
    while reader.read_into(&mut all).unwrap() {}
    // It may have been held up long enough to lose some records, but received ones are complete and in order.
    for batch in all.chunks(20) {
        assert_eq!(batch, records(batch[0].sequence, 20));
    }
    assert!(all.is_sorted_by_key(|record| record.sequence));
}

#[test]
fn long_lists_are_split_and_keep_their_order() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut publisher = session.publisher::<Record>("values").unwrap();
    let mut reader = session.subscribe::<Record>(publisher.service()).unwrap();
    assert_eq!(reader.next_batch().unwrap(), None);
    let sent = records(0, 1000);
    publisher.publish(&sent).unwrap();
    assert_eq!(
        reader.next_batch().unwrap().unwrap(),
        &sent[..batch_records_max::<Record>()]
    );
    let mut got = sent[..batch_records_max::<Record>()].to_vec();
    while reader.read_into(&mut got).unwrap() {}
    assert_eq!(got, sent);
}

#[test]
fn a_reader_that_never_polls_keeps_the_newest_and_blocks_nobody() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut publisher = session.publisher::<Record>("values").unwrap();
    let mut reader = session.subscribe::<Record>(publisher.service()).unwrap();
    for cycle in 0..5000 {
        publisher.publish(&records(cycle * 20, 20)).unwrap();
    }
    let mut got = Vec::new();
    while reader.read_into(&mut got).unwrap() {}
    assert_eq!(got, records(5000 * 20 - got.len() as u64, got.len() as u64));
    assert_eq!(got.len(), BATCHES_MAX * 20);
}

#[test]
fn another_layout_or_name_is_refused() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let publisher = session.publisher::<Record>("values").unwrap();
    let error = refused(session.subscribe::<[u64; 8]>(publisher.service()));
    assert!(
        matches!(error, StreamError::OtherLayout { size: 64, .. }),
        "{error}"
    );
    let error = refused(session.subscribe::<Record>("executor-exec/0.0/none"));
    assert!(matches!(error, StreamError::DoesNotExist { .. }), "{error}");
}

#[test]
fn killed_publishers_leave_nothing() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Monitor, "tail").unwrap();
    run_janitor(&cell).unwrap();
    let before = cell.files();
    for _ in 0..20 {
        let (peer, announcement) = Peer::announced(&cell, "publish", "lwr");
        let mut reader = session
            .subscribe::<Record>(&announcement.services["values"])
            .unwrap();
        common::wait_for(|| reader.next_batch().unwrap());
        peer.kill();
        run_janitor(&cell).unwrap();
    }
    run_janitor(&cell).unwrap();
    assert_eq!(cell.files(), before, "only files of live processes remain");
}
