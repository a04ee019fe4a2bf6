//! Cells: announcements, cleaning, wiping, and the isolation of two cells. Run by the test program's threads and by
//! child processes of it.

mod common;

use std::fs::{self, File, FileTimes};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};

use common::{Peer, TestCell, part, paths_below, refused, run_janitor, wait_until_started};
use rcc_ipc::clean::{self, CleanError, WipeError};
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
fn a_living_cell_is_not_wiped_and_its_process_is_named() {
    let cell = TestCell::new();
    let (peer, announcement) = Peer::announced(&cell, "announced", "lwr");
    let before = cell.files();
    let error = refused(clean::wipe(&cell));
    let words = error.to_string();
    assert!(
        matches!(error, WipeError::Living { pid, .. } if pid == announcement.pid),
        "{words}"
    );
    assert!(words.contains("driver `lwr`"), "{words}");
    assert_eq!(cell.files(), before);
    peer.kill();
    let report = clean::wipe(&cell).unwrap();
    assert_eq!(
        (report.shared_memory, report.announcements),
        (before.len(), 1)
    );
    assert!(cell.files().is_empty() && cell.announced_all().unwrap().is_empty());
}

#[test]
fn a_cell_with_an_unannounced_process_is_not_wiped() {
    let cell = TestCell::new();
    let peer = Peer::start(&cell, "unannounced", "lwr");
    wait_until_started(&cell);
    let error = refused(clean::wipe(&cell));
    assert!(matches!(error, WipeError::InUse { .. }), "{error}");
    peer.kill();
    clean::wipe(&cell).unwrap();
    assert!(cell.files().is_empty());
}

#[test]
fn a_wiped_cell_can_be_used_again() {
    let cell = TestCell::new();
    for _ in 0..3 {
        let (peer, _) = Peer::announced(&cell, "announced", "lwr");
        peer.kill();
        clean::wipe(&cell).unwrap();
        let session = Session::join(&cell, Role::Loader, "loader").unwrap();
        session.create_board::<u64>("board").unwrap();
    }
}

#[test]
fn a_cell_whose_first_process_died_while_it_made_the_common_segment_can_be_joined() {
    let cell = TestCell::new();
    drop(Session::join(&cell, Role::Loader, "loader").unwrap());
    let common = cell.files();
    assert!(common.len() == 1 && common[0].to_string_lossy().ends_with("global_mgmt"));
    // Sized but not initialised: its version is zero.
    fs::write(&common[0], [0; 16]).unwrap();
    Session::join(&cell, Role::Loader, "loader")
        .unwrap()
        .create_board::<u64>("board")
        .unwrap();
}

#[test]
fn a_removed_cell_leaves_no_file_and_foreign_files_alone() {
    let cell = TestCell::new();
    drop(Session::join(&cell, Role::Loader, "loader").unwrap());
    fs::write(cell.config_copy(), "cell: test").unwrap();
    let foreign = cell.runtime_dir().join("foreign.txt");
    fs::write(&foreign, "").unwrap();
    clean::remove_cell(&cell).unwrap();
    let left: Vec<_> = fs::read_dir(cell.runtime_dir())
        .unwrap()
        .flatten()
        .collect();
    assert_eq!(left.len(), 1, "{left:?}");
    fs::remove_file(foreign).unwrap();
    clean::remove_cell(&cell).unwrap();
    assert!(!cell.runtime_dir().exists() && cell.leftovers().unwrap().is_empty());
}

#[test]
fn a_removed_cell_takes_the_sockets_of_dead_simulators_along_and_no_others() {
    let cell = TestCell::new();
    let (dead, living) = (cell.simulator_socket("dead"), cell.simulator_socket("lwr"));
    drop(UnixListener::bind(&dead).unwrap());
    let listener = UnixListener::bind(&living).unwrap();
    clean::remove_cell(&cell).unwrap();
    assert!(!dead.exists() && living.exists());
    drop(listener);
    clean::remove_cell(&cell).unwrap();
    assert!(!cell.runtime_dir().exists());
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
fn a_wipe_removes_the_folder_in_memory_too() {
    let cell = TestCell::new();
    drop(Session::join(&cell, Role::Loader, "loader").unwrap());
    assert!(cell.iox_root().is_dir());
    clean::wipe(&cell).unwrap();
    assert!(cell.leftovers().unwrap().is_empty() && !cell.iox_root().exists());
}

fn plant_empty_file(cell: &Cell, like: &Path, made: SystemTime) -> PathBuf {
    let name = like.file_name().unwrap().to_str().unwrap();
    let path = PathBuf::from("/dev/shm").join(format!("{}0000{}", cell.prefix(), &name[19..]));
    let file = File::create(&path).unwrap();
    file.set_times(FileTimes::new().set_modified(made)).unwrap();
    path
}

#[test]
fn half_created_files_are_removed_whatever_their_date() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Driver, "lwr").unwrap();
    let _board = session.create_board::<u64>("board").unwrap();
    let before = cell.files();
    let (now, hour) = (SystemTime::now(), Duration::from_secs(3600));
    // The clock may have been set since: an hour ahead or back.
    for made in [now - hour, now, now + hour] {
        let half = plant_empty_file(&cell, &before[0], made);
        let report = run_janitor(&cell).unwrap();
        assert_eq!(report.half_created, 1, "{made:?}");
        assert!(!half.exists());
        assert_eq!(cell.files(), before, "non-empty files stay");
    }
}

#[test]
fn the_janitor_repairs_a_cell_whose_dead_process_left_an_empty_file() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    run_janitor(&cell).unwrap();
    let before = cell.files();
    let (peer, _) = Peer::announced(&cell, "announced", "lwr");
    peer.kill();
    // As if it had been killed between creating and sizing its files: all that it left are empty now.
    let left: Vec<PathBuf> = cell
        .files()
        .into_iter()
        .filter(|path| !before.contains(path))
        .collect();
    assert!(!left.is_empty());
    let past = FileTimes::new().set_modified(SystemTime::now() - Duration::from_secs(1));
    for path in &left {
        let file = File::create(path).unwrap();
        file.set_times(past).unwrap();
    }
    let report = run_janitor(&cell).unwrap();
    assert_eq!(report.half_created, left.len());
    assert_eq!(cell.files(), before);
    drop(session);
}

#[test]
fn a_janitor_that_hangs_is_killed() {
    let cell = TestCell::new();
    // Only a time limit of zero is certain to be too short.
    let error = refused(clean::run_janitor(&cell, Duration::ZERO));
    assert!(matches!(error, CleanError::TimedOut { .. }), "{error}");
}

#[test]
fn the_janitor_program_reports_by_its_exit_code() {
    let cell = TestCell::new();
    let janitor = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rcc-janitor"));
        command
            .args(arguments)
            .arg("--runtime-dir")
            .arg(cell.runtime_dir())
            .output()
            .unwrap()
    };
    let words = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert_eq!(janitor(&["--cell"]).status.code(), Some(2));
    assert_eq!(janitor(&["--cell", "Bad"]).status.code(), Some(1));
    assert_eq!(janitor(&["--cell", "test"]).status.code(), Some(0));
    let (peer, _) = Peer::announced(&cell, "announced", "lwr");
    let refused = janitor(&["--cell", "test", "--wipe"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        words(&refused.stderr).contains("driver `lwr` is running"),
        "{}",
        words(&refused.stderr)
    );
    peer.kill();
    let wiped = janitor(&["--cell", "test", "--wipe"]);
    assert_eq!(wiped.status.code(), Some(0), "{}", words(&wiped.stderr));
    assert!(cell.files().is_empty());
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

/// Only root can create files of another user.
#[test]
fn a_file_of_another_user_under_the_prefix_does_not_block_the_cell() {
    if !nix::unistd::getuid().is_root() {
        println!("skipped: creating files of another user needs root");
        return;
    }
    let first = TestCell::new();
    drop(Session::join(&first, Role::Loader, "loader").unwrap());
    let common = first.files().remove(0);
    fs::remove_file(&common).unwrap();
    fs::write(&common, [0; 16]).unwrap();
    std::os::unix::fs::chown(&common, Some(65534), None).unwrap();
    // A handle from before the change is refused; a new look-up finds a usable prefix.
    let error = refused(Session::join(&first, Role::Loader, "loader")).to_string();
    let again = Cell::at("test", first.runtime_dir()).unwrap();
    let joined = Session::join(&again, Role::Loader, "loader");
    // While the cell lives, a foreign file does not keep processes out.
    let beside = PathBuf::from("/dev/shm").join(format!("{}beside.global_mgmt", again.prefix()));
    fs::write(&beside, "").unwrap();
    std::os::unix::fs::chown(&beside, Some(65534), None).unwrap();
    let second = Session::join(&again, Role::Driver, "lwr").map(drop);
    let same = Cell::at("test", first.runtime_dir()).unwrap();
    let late = refused(Session::join(&first, Role::Monitor, "late")).to_string();
    let board = joined
        .as_ref()
        .unwrap()
        .create_board::<u64>("board")
        .map(drop);
    drop(joined);
    let wiped = clean::wipe(&again);
    clean::remove_cell(&again).unwrap();
    let stays = common.exists();
    fs::remove_file(&common).unwrap();
    fs::remove_file(&beside).unwrap();
    assert_eq!(same, again, "a living cell keeps its prefix");
    second.unwrap();
    board.unwrap();
    wiped.unwrap();
    assert!(stays, "the file of another user stays");
    assert!(
        error.contains("(uid 65534)") && error.contains("--cell"),
        "{error}"
    );
    assert_ne!(again.prefix(), first.prefix());
    assert!(late.contains("recreated"), "{late}");
    assert!(again.leftovers().unwrap().is_empty());
}

/// Files of the owner of a cell: one that belongs to its run and one in shared memory.
fn keep(cell: &Cell, who: usize) -> [PathBuf; 2] {
    let shared = Path::new("/dev/shm").join(format!("{}kept", cell.prefix()));
    let kept = [cell.running_file(), shared];
    for path in &kept {
        fs::write(path, who.to_string()).unwrap();
    }
    kept
}

#[test]
fn of_concurrent_acquirers_one_gets_the_cell_and_keeps_its_files() {
    let cell = TestCell::new();
    let barrier = std::sync::Barrier::new(8);
    for round in 0..100 {
        if round % 2 == 1 {
            // Left by a run that died.
            keep(&Cell::at("test", cell.runtime_dir()).unwrap(), 99);
        }
        let taken: Vec<_> = std::thread::scope(|scope| {
            let takers: Vec<_> = (0..8)
                .map(|who| {
                    let (cell, barrier) = (&cell, &barrier);
                    scope.spawn(move || {
                        barrier.wait();
                        let taken = acquire(cell, &Announcement::supervisor().unwrap());
                        taken.map(|announced| (announced, who, keep(cell, who)))
                    })
                })
                .collect();
            takers
                .into_iter()
                .map(|taker| taker.join().unwrap())
                .collect()
        });
        let mut has = None;
        for result in taken {
            match result {
                Ok(taken) => assert!(has.replace(taken).is_none(), "two processes own the cell"),
                Err(error) => assert!(
                    matches!(error, WipeError::Living { role: Role::Cli, pid, .. } if pid == std::process::id()),
                    "{error}"
                ),
            }
        }
        let (announced, who, kept) = has.expect("one owns it");
        for path in kept {
            assert_eq!(
                fs::read_to_string(path).unwrap(),
                who.to_string(),
                "round {round}"
            );
        }
        assert!(cell.announced_all().unwrap()[0].is_supervisor());
        release(&cell, &announced).unwrap();
        drop(announced);
        assert!(!cell.runtime_dir().exists() && cell.leftovers().unwrap().is_empty());
    }
}

#[test]
fn a_cell_released_under_contention_never_mixes_two_owners() {
    let cell = TestCell::new();
    let having = std::sync::atomic::AtomicUsize::new(0);
    let lives = std::sync::atomic::AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for who in 0..6 {
            let (cell, having, lives) = (&cell, &having, &lives);
            scope.spawn(move || {
                while lives.load(std::sync::atomic::Ordering::SeqCst) < 200 {
                    // Like a starting process: finds or creates the folder of the cell.
                    let own = Cell::at("test", cell.runtime_dir()).unwrap();
                    let announced = match acquire(&own, &Announcement::supervisor().unwrap()) {
                        Ok(announced) => announced,
                        Err(WipeError::Living { .. }) => continue,
                        Err(error) => panic!("{error}"),
                    };
                    assert_eq!(having.fetch_add(1, std::sync::atomic::Ordering::SeqCst), 0);
                    let kept = keep(&own, who);
                    std::thread::yield_now();
                    for path in kept {
                        assert_eq!(fs::read_to_string(path).unwrap(), who.to_string());
                    }
                    lives.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                    having.fetch_sub(1, std::sync::atomic::Ordering::SeqCst);
                    release(&own, &announced).unwrap();
                }
            });
        }
    });
    assert!(cell.leftovers().unwrap().is_empty());
}
