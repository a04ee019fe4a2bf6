//! Wiping, removing and repairing cells, and the janitor. Run by the threads of the test harness.

use super::*;

#[test]
fn a_living_cell_is_not_wiped_and_its_process_is_named() {
    let cell = TestCell::new();
    let (peer, announcement) = Peer::announced(&cell, "announced", "lwr");
    let before = cell.files();
    let error = refused(clean::wipe(&cell));
    let output_text = error.to_string();
    assert!(
        matches!(error, WipeError::Living { pid, .. } if pid == announcement.pid),
        "{output_text}"
    );
    assert!(output_text.contains("driver `lwr`"), "{output_text}");
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
    let output_text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert_eq!(janitor(&["--cell"]).status.code(), Some(2));
    assert_eq!(janitor(&["--cell", "Bad"]).status.code(), Some(1));
    assert_eq!(janitor(&["--cell", "test"]).status.code(), Some(0));
    let (peer, _) = Peer::announced(&cell, "announced", "lwr");
    let refused = janitor(&["--cell", "test", "--wipe"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        output_text(&refused.stderr).contains("driver `lwr` is running"),
        "{}",
        output_text(&refused.stderr)
    );
    peer.kill();
    let wiped = janitor(&["--cell", "test", "--wipe"]);
    assert_eq!(
        wiped.status.code(),
        Some(0),
        "{}",
        output_text(&wiped.stderr)
    );
    assert!(cell.files().is_empty());
}
