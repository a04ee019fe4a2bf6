//! Boards between threads and processes. Run by the test program's threads and by child processes of it.

mod common;

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use bytemuck::{Pod, Zeroable};
use common::{Peer, TestCell, part, refused, run_janitor, wait_for};
use rcc_ipc::{BoardError, Session};
use rcc_protocol::Role;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Measured {
    sequence: u64,
    joints: [f64; 7],
}

/// As large as a status with a command table.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Large {
    words: [u64; 2048],
}

fn measured(sequence: u64) -> Measured {
    Measured {
        sequence,
        joints: [sequence as f64; 7],
    }
}

/// The child process: a driver that writes until it is killed.
#[test]
fn peer() {
    let Some((_, cell, label)) = part() else {
        return;
    };
    let session = Session::join(&cell, Role::Driver, &label).unwrap();
    let mut board = session.create_board::<Measured>("meas").unwrap();
    let announcement = session.announcement().service("meas", board.service());
    let _announced = cell.announce(&announcement).unwrap();
    for sequence in 1.. {
        board.write(&measured(sequence));
        std::thread::yield_now();
    }
}

#[test]
fn a_reader_gets_zero_and_then_the_newest_value() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Driver, "lwr").unwrap();
    let mut writer = session.create_board::<Measured>("meas").unwrap();
    let reader = session.open_board::<Measured>(writer.service()).unwrap();
    assert_eq!(reader.read(), Measured::zeroed());
    for sequence in 1..100 {
        writer.write(&measured(sequence - 1));
        writer.write(&measured(sequence));
        assert_eq!(reader.read(), measured(sequence));
        assert_eq!(reader.read(), measured(sequence));
    }
    assert!(
        reader
            .writer()
            .is_some_and(|instance| instance == session.instance())
    );
}

#[test]
fn reading_and_writing_allocate_nothing() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut small = session.create_board::<Measured>("small").unwrap();
    let mut large = session.create_board::<Large>("large").unwrap();
    let small_reader = session.open_board::<Measured>(small.service()).unwrap();
    let large_reader = session.open_board::<Large>(large.service()).unwrap();
    assert_no_alloc(|| {
        for sequence in 0..1000 {
            small.write(&measured(sequence));
            assert_eq!(small_reader.read().sequence, sequence);
            large.write(&Large {
                words: [sequence; 2048],
            });
            assert!(large_reader.read().words == [sequence; 2048]);
        }
    });
}

#[test]
fn no_reader_ever_sees_a_torn_value() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut writer = session.create_board::<Large>("status").unwrap();
    let readers: Vec<_> = (0..4)
        .map(|_| session.open_board::<Large>(writer.service()).unwrap())
        .map(|reader| {
            std::thread::spawn(move || {
                let mut last = 0;
                while last < 20_000 {
                    let words = reader.read().words;
                    assert!(words == [words[0]; 2048], "torn at {}", words[0]);
                    assert!(words[0] >= last, "went back");
                    last = words[0];
                }
            })
        })
        .collect();
    for sequence in 1..=20_000 {
        writer.write(&Large {
            words: [sequence; 2048],
        });
    }
    for reader in readers {
        reader.join().unwrap();
    }
}

#[test]
fn another_layout_is_refused() {
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    #[repr(C)]
    struct Longer {
        sequence: u64,
        joints: [f64; 8],
    }
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    #[repr(C)]
    struct Namesake {
        joints: [f64; 7],
        sequence: u64,
    }
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Driver, "lwr").unwrap();
    let writer = session.create_board::<Measured>("meas").unwrap();
    let error = refused(session.open_board::<Longer>(writer.service()));
    assert!(
        matches!(error, BoardError::OtherLayout { size: 72, .. }),
        "{error}"
    );
    let error = refused(session.open_board::<Namesake>(writer.service()));
    assert!(
        matches!(error, BoardError::OtherLayout { size: 64, .. }),
        "{error}"
    );
}

#[test]
fn a_missing_board_is_refused() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Driver, "lwr").unwrap();
    let error = refused(session.open_board::<Measured>("driver-lwr/0/meas"));
    assert!(matches!(error, BoardError::DoesNotExist { .. }), "{error}");
    let error = refused(session.create_board::<Measured>("two words"));
    assert!(matches!(error, BoardError::BadName { .. }), "{error}");
    let board = session.create_board::<Measured>("meas").unwrap();
    let error = refused(session.create_board::<Measured>("meas"));
    assert!(matches!(error, BoardError::Failed { .. }), "{error}");
    drop(board);
    session.create_board::<Measured>("meas").unwrap();
}

#[test]
fn handles_may_be_dropped_elsewhere_and_after_the_session() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Driver, "lwr").unwrap();
    let mut writer = session.create_board::<Measured>("meas").unwrap();
    let reader = session.open_board::<Measured>(writer.service()).unwrap();
    drop(session);
    std::thread::spawn(move || {
        writer.write(&measured(3));
        drop(writer);
    })
    .join()
    .unwrap();
    assert_eq!(reader.read(), measured(3));
    std::thread::spawn(move || drop(reader)).join().unwrap();
}

#[test]
fn a_board_has_32_readers_and_no_more() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let writer = session.create_board::<Measured>("status").unwrap();
    let open = || session.open_board::<Measured>(writer.service());
    let readers: Vec<_> = (0..32).map(|_| open().unwrap()).collect();
    refused(open());
    drop(readers);
    open().unwrap();
}

#[test]
fn a_killed_writer_is_replaced_fifty_times_and_leaves_nothing() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let own = session.create_board::<Measured>("status").unwrap();
    run_janitor(&cell).unwrap();
    let before = cell.files();
    let mut last = None;
    for round in 0..50 {
        let (peer, announcement) = Peer::announced(&cell, "writer", "lwr");
        assert_ne!(
            last,
            Some(announcement.incarnation),
            "each incarnation has its own number"
        );
        last = Some(announcement.incarnation);
        let reader = session
            .open_board::<Measured>(&announcement.services["meas"])
            .unwrap();
        wait_for(|| (reader.read().sequence > 2).then_some(()));
        peer.kill();
        assert!(announcement.liveness().is_dead());
        let value = reader.read();
        assert_eq!(
            value,
            measured(value.sequence),
            "round {round}: a torn value"
        );
        // In every second round the reader is still open while the janitor cleans.
        if round % 2 == 0 {
            drop(reader);
            run_janitor(&cell).unwrap();
        } else {
            run_janitor(&cell).unwrap();
            assert_eq!(reader.read(), value, "stays readable after cleaning");
        }
    }
    run_janitor(&cell).unwrap();
    assert_eq!(cell.files(), before, "only files of live processes remain");
    drop(own);
}
