//! Cells: announcements, cleaning, wiping, and the isolation of two cells. Run by the test program's threads and by
//! child processes of it.

#[path = "../common/mod.rs"]
mod common;

mod cleaning;
mod ownership;

use std::fs::{self, File, FileTimes};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};

use common::{Peer, TestCell, part, paths_below, refused, run_janitor, wait_until_started};
use rcc_ipc::clean::{self, WipeError};
use rcc_ipc::ownership::{acquire, release};
use rcc_ipc::{AnnounceError, BoardError, Cell, RequestError, Session, SessionError};
use rcc_os::process_instance::ProcessInstance;
use rcc_protocol::{Announcement, Build, Configuration, Role};

/// The child process: stays in the cell, announced or not, until it is killed.
#[test]
fn peer() {
    let Some((part, cell, label)) = part() else {
        return;
    };
    let session = Session::join(&cell, Role::Driver, &label).unwrap();
    let board = session.create_board::<u64>("board").unwrap();
    if part == "unannounced" {
        fs::write(cell.runtime_dir().join("started"), board.service()).unwrap();
        loop {
            std::thread::park();
        }
    }
    let announcement = session.announcement().service("board", board.service());
    let _announced = cell.announce(&announcement).unwrap();
    loop {
        std::thread::park();
    }
}

fn of_this_process(label: &str) -> Announcement {
    let instance = ProcessInstance::current().unwrap();
    Announcement {
        role: Role::Driver,
        label: label.to_owned(),
        incarnation: instance.incarnation(),
        pid: instance.pid,
        start_time_ticks: instance.start_time_ticks,
        services: [("meas".to_owned(), "driver-lwr/0/meas".to_owned())].into(),
        note: "online".to_owned(),
        configuration: Some(Configuration::new((
            "/etc/rcc/cells/lwr.yaml".to_owned(),
            7,
            ["channels"],
            vec![("lwr".to_owned(), [u64::MAX])],
        ))),
        build: Some(Build::own()),
    }
}

#[test]
fn an_announcement_is_found_until_it_is_dropped() {
    let cell = TestCell::new();
    let announcement = of_this_process("lwr");
    assert_eq!(cell.announced(Role::Driver, "lwr").unwrap(), None);
    let announced = cell.announce(&announcement).unwrap();
    assert_eq!(
        cell.announced(Role::Driver, "lwr").unwrap(),
        Some(announcement.clone())
    );
    assert_eq!(cell.announced_all().unwrap(), [announcement]);
    assert_eq!(cell.announced(Role::Monitor, "lwr").unwrap(), None);
    drop(announced);
    assert_eq!(cell.announced_all().unwrap(), []);
    assert_eq!(
        fs::read_dir(cell.processes_dir()).unwrap().count(),
        0,
        "no file remains"
    );
}

#[test]
fn an_announcement_can_be_replaced_by_its_owner() {
    let cell = TestCell::new();
    let mut announced = cell.announce(&of_this_process("lwr")).unwrap();
    announced.update([].into(), "stopping").unwrap();
    let found = cell.announced(Role::Driver, "lwr").unwrap().unwrap();
    assert_eq!((found.note.as_str(), found.services.len()), ("stopping", 0));
    assert_eq!(&found, announced.announcement());
}

#[test]
fn a_second_living_process_of_the_same_role_and_label_is_refused() {
    let cell = TestCell::new();
    let (peer, _) = Peer::announced(&cell, "announced", "lwr");
    let error = refused(cell.announce(&of_this_process("lwr")));
    let pid = peer.id();
    assert!(
        matches!(&error, AnnounceError::AlreadyRunning { pid: found, .. } if *found == pid),
        "{error}"
    );
    cell.announce(&of_this_process("other")).unwrap();
}

#[test]
fn a_dead_process_is_replaced() {
    let cell = TestCell::new();
    let (peer, announcement) = Peer::announced(&cell, "announced", "lwr");
    assert!(announcement.liveness().is_alive());
    peer.kill();
    let dead = cell.announced(Role::Driver, "lwr").unwrap().unwrap();
    assert_eq!(
        dead, announcement,
        "its announcement stays until it is replaced"
    );
    assert!(dead.liveness().is_dead());
    let _announced = cell.announce(&of_this_process("lwr")).unwrap();
    assert!(
        cell.announced(Role::Driver, "lwr")
            .unwrap()
            .unwrap()
            .liveness()
            .is_alive()
    );
}

#[test]
fn of_concurrent_equal_announcements_one_wins() {
    let cell = TestCell::new();
    let barrier = std::sync::Barrier::new(8);
    for _ in 0..50 {
        let won: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8)
                .map(|_| {
                    scope.spawn(|| {
                        barrier.wait();
                        cell.announce(&of_this_process("lwr")).ok()
                    })
                })
                .collect();
            threads
                .into_iter()
                .filter_map(|thread| thread.join().unwrap())
                .collect()
        });
        assert_eq!(won.len(), 1);
    }
}

#[test]
fn a_broken_announcement_is_an_error_by_name_and_hides_no_other() {
    let cell = TestCell::new();
    let _announced = cell.announce(&of_this_process("lwr")).unwrap();
    fs::write(cell.processes_dir().join("driver-bad.json"), "{").unwrap();
    let error = refused(cell.announced(Role::Driver, "bad"));
    assert!(matches!(error, AnnounceError::Malformed { .. }), "{error}");
    assert_eq!(cell.announced_all().unwrap().len(), 1);
}

#[test]
fn two_cells_never_see_each_other() {
    let (one, two) = (TestCell::new(), TestCell::new());
    assert_ne!(one.prefix(), two.prefix());
    let in_one = Session::join(&one, Role::Driver, "lwr").unwrap();
    let in_two = Session::join(&two, Role::Driver, "lwr").unwrap();
    let board = in_one.create_board::<u64>("board").unwrap();
    let server = in_one.serve("server").unwrap();
    let _announced = one.announce(&in_one.announcement()).unwrap();
    assert!(two.announced_all().unwrap().is_empty());
    let error = refused(in_two.open_board::<u64>(board.service()));
    assert!(matches!(error, BoardError::DoesNotExist { .. }), "{error}");
    let error = refused(in_two.client(server.service()));
    assert!(
        matches!(error, RequestError::DoesNotExist { .. }),
        "{error}"
    );
    drop(in_two);
    let before = one.files();
    clean::wipe(&two).unwrap();
    assert!(two.files().is_empty());
    assert_eq!(one.files(), before, "wiping one leaves the other alone");
    in_one.open_board::<u64>(board.service()).unwrap();
}

#[test]
fn nothing_of_a_living_cell_is_open_to_other_users() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let board = session.create_board::<[u64; 64]>("board").unwrap();
    let server = session.serve("server").unwrap();
    let publisher = session.publisher::<[u64; 8]>("stream").unwrap();
    let _reader = session.open_board::<[u64; 64]>(board.service()).unwrap();
    let _client = session.client(server.service()).unwrap();
    let _subscriber = session.subscribe::<[u64; 8]>(publisher.service()).unwrap();
    let _announced = cell.announce(&session.announcement()).unwrap();
    run_janitor(&cell).unwrap();
    let mut on_disk = paths_below(cell.runtime_dir());
    on_disk.retain(|path| !path.is_dir());
    let in_memory = cell.leftovers().unwrap();
    assert!(on_disk.len() >= 3 && in_memory.len() > 10);
    for path in on_disk.iter().chain(&in_memory) {
        let mode = fs::metadata(path).unwrap().mode() & 0o7777;
        assert_eq!(mode & 0o177, 0, "{} has mode {mode:04o}", path.display());
    }
    for folder in [cell.runtime_dir(), &cell.iox_root(), &cell.processes_dir()] {
        let mode = fs::metadata(folder).unwrap().mode() & 0o7777;
        assert_eq!(mode, 0o700, "{}", folder.display());
    }
}

#[test]
fn iceoryx2_keeps_all_its_files_in_memory() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let _board = session.create_board::<u64>("board").unwrap();
    let all = cell.leftovers().unwrap();
    assert!(all.iter().any(|path| path.starts_with(cell.iox_root())));
    assert!(all.iter().all(|path| path.starts_with("/dev/shm")));
    let names = fs::read_dir(cell.runtime_dir()).unwrap().flatten();
    let names: Vec<_> = names.map(|entry| entry.file_name()).collect();
    assert!(!names.iter().any(|name| name == "iox"), "{names:?}");
}

#[test]
fn labels_that_cannot_be_file_names_are_refused() {
    let cell = TestCell::new();
    for label in ["", "a/b", "../x", ".hidden", "two words", &"x".repeat(65)] {
        let error = refused(Session::join(&cell, Role::Driver, label));
        assert!(
            matches!(error, SessionError::BadLabel { .. }),
            "{label}: {error}"
        );
    }
}
